//! Domains of vectors that are perpendicular to other arguments: `t = { perpendicular_to = "n" }`.

use std::collections::BTreeMap;
use std::ops::Range;

use karat::unstable::domain::Dynamic;
use karat::unstable::value::{Scalar, Shape};
use toml::Value;

use crate::domains::no_such;

/// The key that makes a vector perpendicular to other vectors.
pub(crate) const KEY: &str = "perpendicular_to";

/// A vector that is an argument or a part of an argument: `n`, `surface.tangent`, `frames[1].t`.
#[derive(Clone, Debug)]
struct Vector {
    path: String,
    lanes: Range<usize>,
    /// The names of the vectors to which this vector is perpendicular, as the test file writes them.
    to: Vec<String>,
}

/// The names in the domain `{ perpendicular_to = ... }`; `None` if the domain doesn't have this key.
pub(crate) fn names(value: &Value) -> Option<Result<Vec<String>, String>> {
    let said = value.as_table()?.get(KEY)?;
    let one = |value: &Value| value.as_str().map(str::to_owned);
    let all: Option<Vec<String>> = match said {
        Value::Array(list) => list.iter().map(one).collect(),
        other => one(other).map(|name| vec![name]),
    };
    Some(match all {
        Some(all) if !all.is_empty() && value.as_table().is_some_and(|table| table.len() == 1) => {
            Ok(all)
        }
        Some(all) if !all.is_empty() => {
            Err(format!("`{KEY}` must be the only key: remove the other keys"))
        }
        _ => Err(format!("`{KEY}` must be the name of a vector, or a list of names")),
    })
}

/// Restricts `domain`: a vector with `perpendicular_to` in `over` becomes perpendicular to the named vectors.
pub(crate) fn related(
    domain: Dynamic,
    parameters: &[(String, Shape)],
    over: &BTreeMap<String, Value>,
) -> Result<Dynamic, String> {
    let mut all = Vec::new();
    let mut first = 0;
    for (name, shape) in parameters {
        vectors(name, shape, over.get(name), first, &mut all)?;
        first += shape.lanes().len();
    }
    let mut pending: Vec<(&Vector, Vec<&Vector>)> = Vec::new();
    for vector in all.iter().filter(|vector| !vector.to.is_empty()) {
        let of = |name: &String| found(vector, name, &all);
        let to = vector.to.iter().map(of).collect::<Result<Vec<_>, _>>()?;
        if to.len() >= vector.lanes.len() {
            return Err(format!(
                "`{}`: a vector of {} components can't be perpendicular to {} vectors",
                vector.path,
                vector.lanes.len(),
                to.len()
            ));
        }
        pending.push((vector, to));
    }
    let mut domain = domain;
    while !pending.is_empty() {
        let waits = |other: &Vector| pending.iter().any(|(own, _)| own.path == other.path);
        let Some(next) = pending.iter().position(|(_, to)| !to.iter().any(|to| waits(to))) else {
            let names: Vec<_> = pending.iter().map(|(own, _)| format!("`{}`", own.path)).collect();
            return Err(format!(
                "the keys `{KEY}` of {} form a cycle: each key applies in both directions, so remove the key of one vector",
                names.join(", ")
            ));
        };
        let (vector, to) = pending.remove(next);
        let starts = to.iter().map(|to| to.lanes.start).collect();
        let names: Vec<&str> = to.iter().map(|to| &*to.path).collect();
        domain = domain.perpendicular(vector.lanes.clone(), starts, &names.join(", "));
    }
    Ok(domain)
}

/// Finds the vector with a given name: a member of the same structure, or a path that begins at a parameter.
fn found<'v>(own: &Vector, name: &str, all: &'v [Vector]) -> Result<&'v Vector, String> {
    let beside = own.path.rfind('.').map(|end| format!("{}.{name}", &own.path[..end]));
    let by = |path: &str| all.iter().find(|vector| vector.path == path);
    let wrong = |what: String| format!("`{}`: {what}", own.path);
    let beside = beside.as_deref().and_then(by);
    if let (Some(one), Some(other)) = (beside, by(name))
        && one.path != other.path
    {
        return Err(wrong(format!(
            "the name `{name}` could mean `{}` or the parameter `{name}`: write `{}`, or rename the parameter",
            one.path, one.path
        )));
    }
    let Some(other) = beside.or_else(|| by(name)) else {
        let others = all.iter().filter(|vector| vector.path != own.path);
        let paths: Vec<&str> = others.map(|vector| &*vector.path).collect();
        return Err(wrong(match &*paths {
            [] => format!("there is no vector `{name}`"),
            paths => no_such("vector", name, paths.iter().copied()),
        }));
    };
    if other.path == own.path {
        return Err(wrong("a unit vector can't be perpendicular to itself".to_owned()));
    }
    match other.lanes.len() == own.lanes.len() {
        true => Ok(other),
        false => Err(wrong(format!(
            "the vector has {} components, but `{name}` has {}",
            own.lanes.len(),
            other.lanes.len()
        ))),
    }
}

/// The float vectors in a value, each with its domain.
fn vectors(
    path: &str,
    shape: &Shape,
    value: Option<&Value>,
    first: usize,
    all: &mut Vec<Vector>,
) -> Result<(), String> {
    let member = |name: &str| value.and_then(Value::as_table).and_then(|table| table.get(name));
    if let Some(at_pixel) = shape.quad() {
        let width = at_pixel.lanes().len();
        let own = member("value").or(value.filter(|_| member("dx").or(member("dy")).is_none()));
        vectors(path, at_pixel, own, first, all)?;
        for (at, change) in ["dx", "dy"].into_iter().enumerate() {
            let path = format!("{path}.{change}");
            vectors(&path, at_pixel, member(change), first + (at + 1) * width, all)?;
        }
        return Ok(());
    }
    match shape {
        Shape::Vector { size, scalar: Scalar::F32 } => {
            let to = value.and_then(names).transpose()?.unwrap_or_default();
            let lanes = first..first + usize::from(*size);
            all.push(Vector { path: path.to_owned(), lanes, to });
        }
        Shape::Struct { members, .. } => {
            let mut first = first;
            for (name, shape) in members {
                vectors(&format!("{path}.{name}"), shape, member(name), first, all)?;
                first += shape.lanes().len();
            }
        }
        Shape::Array { element, length } => {
            let width = element.lanes().len();
            for at in 0..*length as usize {
                let own = match value {
                    Some(Value::Array(list)) if list.len() == *length as usize => list.get(at),
                    other => other,
                };
                vectors(&format!("{path}[{at}]"), element, own, first + at * width, all)?;
            }
        }
        Shape::Scalar(_) | Shape::Vector { .. } | Shape::Matrix { .. } => {}
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domains::parts;
    use karat_inspect::made_up::Ranges;

    fn of(parameters: &[(&str, Shape)], text: &str) -> Result<String, String> {
        let parameters: Vec<_> =
            parameters.iter().map(|(name, shape)| ((*name).to_owned(), shape.clone())).collect();
        let over: BTreeMap<String, Value> = toml::from_str(text).expect("TOML");
        let all = parameters
            .iter()
            .map(|(name, shape)| parts(name, shape, over.get(name), &Ranges::default()));
        let domain = Dynamic::new(&parameters, all.collect::<Result<_, _>>()?);
        Ok(related(domain, &parameters, &over)?.described())
    }

    fn vector(size: u8) -> Shape {
        Shape::Vector { size, scalar: Scalar::F32 }
    }

    #[test]
    fn a_frame_is_described_in_words() {
        let frame = [("b", vector(3)), ("t", vector(3)), ("n", vector(3))];
        let text = "n = \"hemisphere\"\nt = { perpendicular_to = \"n\" }\n\
                    b = { perpendicular_to = [\"t\", \"n\"] }";
        let expected = "b a unit vector perpendicular to t, n; t a unit vector perpendicular to n; \
                        n a unit vector with z of at least 0";
        assert_eq!(of(&frame, text), Ok(expected.to_owned()));
        let members = vec![("normal".to_owned(), vector(3)), ("tangent".to_owned(), vector(3))];
        let vertex = Shape::Struct { name: "Vertex".to_owned(), members };
        let text = "v = { tangent = { perpendicular_to = \"normal\" } }";
        let told = of(&[("v", vertex)], text).expect("a neighbour's name");
        assert!(told.ends_with("a unit vector perpendicular to v.normal"), "{told}");
    }

    #[test]
    fn an_impossible_relation_is_an_error() {
        let three = [("n", vector(3)), ("t", vector(3)), ("uv", vector(2)), ("w", vector(2))];
        for (text, part) in [
            ("t = { perpendicular_to = \"m\" }", "`t`: there is no vector `m`"),
            ("t = { perpendicular_to = \"nn\" }", "did you mean `n`?"),
            ("t = { perpendicular_to = \"t\" }", "perpendicular to itself"),
            ("t = { perpendicular_to = \"uv\" }", "the vector has 3 components, but `uv` has 2"),
            ("t = { perpendicular_to = 1 }", "the name of a vector, or a list"),
            ("t = { perpendicular_to = [] }", "the name of a vector, or a list"),
            ("t = { perpendicular_to = \"n\", x = 1 }", "must be the only key"),
            ("uv = { perpendicular_to = [\"w\", \"w\"] }", "can't be perpendicular to 2 vectors"),
            (
                "t = { perpendicular_to = \"n\" }\nn = { perpendicular_to = \"t\" }",
                "of `n`, `t` form a cycle",
            ),
        ] {
            let error = of(&three, text).expect_err(text);
            assert!(error.contains(part), "{text}: {error}");
        }
        let number = of(&[("x", Shape::Scalar(Scalar::F32))], "x = { perpendicular_to = \"x\" }");
        assert!(number.expect_err("a number").contains("f32"));
    }
}
