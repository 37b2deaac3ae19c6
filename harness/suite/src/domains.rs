//! Parses the domains of arguments.
//!
//! | type | domain |
//! |---|---|
//! | a number | `"0..1"` (with both ends), `0.5`, `[0, 0.5, 1]` (each of these), `"any"` |
//! | a vector or matrix | a number's domain for all components; a list with a number's domain for each component; `"unit_vector"`, `"hemisphere"`, `"hemisphere above 0.01"` (`z` is at least 0.01), `"unit_rgb"`; `"sphere 2"` (of length 2), `"ball 2"` (of length 2 or less); `{ perpendicular_to = "n" }`, a unit vector at right angles to another vector |
//! | any type | `{ one_of = [[0, 0, 1], [1, 0, 0]] }` |
//! | a struct | a table with a domain for each member |
//! | any type, if the function takes derivatives | any domain; or `{ value = "0..1", dx = 0.1, dy = 0 }` with the change to the next pixel |
//!
//! If a test doesn't set an argument's domain, Karat takes the domain from `[inputs]` in `karat.toml`. If `[inputs]`
//! doesn't have the argument, Karat derives the domain from the argument's name and type, as `karat hazards` does: `n`
//! is a unit vector, `roughness` is from 0 to 1.

use karat::unstable::diagnostic::nearest;
use karat::unstable::domain::Part;
use karat::unstable::value::{Scalar, Shape};
use karat_inspect::made_up::{Ranges, suggested};
use toml::Value;

use crate::relations;

/// The parts of a parameter's domain, one for each number or vector in the parameter. If `value` leaves out a member,
/// the member's name and type determine its part.
pub(crate) fn parts(
    name: &str,
    shape: &Shape,
    value: Option<&Value>,
    ranges: &Ranges,
) -> Result<Vec<Part>, String> {
    let Some(value) = value else { return suggested(name, shape, ranges) };
    let wrong = |reason: String| format!("`{name}`: {reason}");
    if let (Value::Table(table), Some(list)) = (value, value.get("one_of"))
        && !matches!(shape, Shape::Struct { .. })
    {
        if table.len() > 1 {
            return Err(wrong("`one_of` must be the only key: remove the other keys".to_owned()));
        }
        let Value::Array(list) = list else {
            return Err(wrong("`one_of` must be a list of values".to_owned()));
        };
        let rows = list.iter().map(|value| lanes(shape, value)).collect::<Result<Vec<_>, _>>();
        return Ok(vec![Part::listed(shape.lanes(), rows.map_err(wrong)?)]);
    }
    if let Some(at_pixel) = shape.quad() {
        return varying(name, shape, at_pixel, value, ranges);
    }
    match shape {
        Shape::Struct { members, .. } => {
            let Value::Table(table) = value else {
                return Err(wrong(
                    "the domain of a struct must be a table of its members' domains".to_owned(),
                ));
            };
            let known = || members.iter().map(|(name, _)| &**name);
            if let Some(unknown) = table.keys().find(|key| known().all(|name| name != key.as_str()))
            {
                return Err(wrong(no_such("member", unknown, known())));
            }
            let parts =
                members.iter().map(|(name, shape)| parts(name, shape, table.get(name), ranges));
            Ok(parts.collect::<Result<Vec<_>, _>>().map_err(wrong)?.into_iter().flatten().collect())
        }
        Shape::Array { element, length } => {
            let of = |at: u32| match value {
                Value::Array(list) if list.len() == *length as usize => &list[at as usize],
                other => other,
            };
            let parts = (0..*length).map(|at| parts(name, element, Some(of(at)), ranges));
            Ok(parts.collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect())
        }
        Shape::Scalar(scalar) => Ok(vec![number(*scalar, value).map_err(wrong)?]),
        _ => {
            if let Value::String(named) = value
                && let Some(part) = vector(named, shape).map_err(wrong)?
            {
                return Ok(vec![part]);
            }
            if let Some(names) = relations::names(value) {
                names.map_err(wrong)?;
                let part = vector("unit_vector", shape).map_err(wrong)?;
                return Ok(part.into_iter().collect());
            }
            let scalars = shape.lanes();
            let of = |lane: usize| match value {
                Value::Array(list) if list.len() == scalars.len() => Ok(&list[lane]),
                Value::Array(list) => Err(format!(
                    "the list must have one entry for each of {} components, but has {}; for a list of \
                     values write {{ one_of = [...] }}",
                    scalars.len(),
                    list.len()
                )),
                other => Ok(other),
            };
            let parts = scalars.iter().enumerate();
            let parts = parts.map(|(lane, scalar)| number(*scalar, of(lane)?));
            parts.collect::<Result<_, String>>().map_err(wrong)
        }
    }
}

/// The parts of the domain of a value that varies from pixel to pixel. `value` is a domain, or a table `{ value =
/// "0..1", dx = 0.1, dy = 0 }`. Karat chooses the parts that the table leaves out.
fn varying(
    name: &str,
    shape: &Shape,
    at_pixel: &Shape,
    value: &Value,
    ranges: &Ranges,
) -> Result<Vec<Part>, String> {
    const MEMBERS: [&str; 3] = ["value", "dx", "dy"];
    let table = value.as_table();
    let table = table.filter(|table| MEMBERS.iter().any(|own| table.contains_key(*own)));
    let said = |member: &str| match table {
        Some(table) => table.get(member),
        None => Some(value).filter(|_| member == "value"),
    };
    if let Some(unknown) =
        table.and_then(|table| table.keys().find(|key| !MEMBERS.contains(&key.as_str())))
    {
        return Err(format!("`{name}`: {}", no_such("member", unknown, MEMBERS)));
    }
    let mut all = Vec::new();
    let mut made_up = suggested(name, shape, ranges)?.into_iter();
    for member in MEMBERS {
        let mut own: Vec<Part> = Vec::new();
        while own.iter().map(Part::width).sum::<usize>() < at_pixel.lanes().len() {
            own.extend(made_up.next());
        }
        all.extend(match said(member) {
            Some(value) => parts(name, at_pixel, Some(value), ranges)?,
            None => own,
        });
    }
    Ok(all)
}

/// A domain that only vectors have, by its name, such as `"unit_vector"`; `None` if the text isn't such a name.
fn vector(text: &str, shape: &Shape) -> Result<Option<Part>, String> {
    let size = match shape {
        Shape::Vector { size, scalar: Scalar::F32 } => *size,
        _ => 0,
    };
    let words: Vec<&str> = text.split_whitespace().collect();
    let number = |text: &str| text.parse::<f32>().ok();
    let (part, sizes) = match &*words {
        [name] if Part::NAMES.contains(name) => (
            Part::named(name, size),
            if *name == "unit_vector" { "vec2, vec3 or vec4" } else { "vec3" },
        ),
        ["hemisphere", rest @ ..] => {
            let least = match rest {
                ["above", least] => number(least).filter(|least| (0.0..=1.0).contains(least)),
                _ => None,
            };
            let Some(least) = least else {
                return Err(format!(
                    "`{text}` isn't a domain: write `hemisphere above 0.01`, with a cosine from 0 to 1"
                ));
            };
            (Some(Part::hemisphere_above(least)).filter(|_| size == 3), "vec3")
        }
        [name @ ("sphere" | "ball"), rest @ ..] => {
            let radius = match rest {
                [radius] => number(radius).filter(|radius| *radius >= 0.0 && radius.is_finite()),
                _ => None,
            };
            let Some(radius) = radius else {
                return Err(format!("`{text}` isn't a domain: write `{name} 2` for the radius 2"));
            };
            (Part::sphere(size, radius, *name == "ball"), "vec2, vec3 or vec4")
        }
        _ => return Ok(None),
    };
    match part {
        Some(part) => Ok(Some(part)),
        None => {
            Err(format!("`{text}` is a domain for a {sizes} of f32, but the argument is a {shape}"))
        }
    }
}

/// The domain of one number.
fn number(scalar: Scalar, value: &Value) -> Result<Part, String> {
    match value {
        Value::Array(list) => {
            let rows = list.iter().map(|value| Ok(vec![lane(scalar, value)?]));
            Ok(Part::listed(vec![scalar], rows.collect::<Result<_, String>>()?))
        }
        Value::String(text) if text == "any" => Ok(Part::any(scalar)),
        Value::String(text) => {
            vector(text, &Shape::Scalar(scalar))?;
            let Some((least, most)) = text.split_once("..") else {
                let names = Part::NAMES.into_iter().chain(["any"]);
                let near = nearest(text, names);
                let near =
                    near.map_or_else(String::new, |near| format!("; did you mean `{near}`?"));
                return Err(format!(
                    "`{text}` isn't a domain of a number: write a range such as `0..1`{near}"
                ));
            };
            let end = |text: &str| {
                let text = text.strip_prefix('=').unwrap_or(text).trim();
                if text.starts_with('.') {
                    // Rejects `0...1`, which isn't `0..` followed by the fraction `.1`.
                    return Err(format!(
                        "`{text}` isn't a number: write a range with two dots, and `0.5` instead of `.5`"
                    ));
                }
                text.parse::<f64>().map_err(|_| match text.starts_with('<') {
                    true => "a domain includes both ends: write `0..1` without `<`".to_owned(),
                    false => format!("`{text}` isn't a number"),
                })
            };
            let range = end(least)?..=end(most)?;
            Part::range(scalar, range)
                .ok_or_else(|| format!("`{text}` isn't a range of {scalar}", scalar = name(scalar)))
        }
        one => Ok(Part::just(scalar, lane(scalar, one)?)),
    }
}

fn name(scalar: Scalar) -> String {
    Shape::Scalar(scalar).to_string()
}

/// The bits of one number, exactly as the shader receives it.
fn lane(scalar: Scalar, value: &Value) -> Result<u32, String> {
    let wrong = || format!("`{value}` isn't of type {}", name(scalar));
    #[expect(clippy::cast_possible_truncation, reason = "arguments are f32")]
    match (scalar, value) {
        (Scalar::F32 | Scalar::F16, Value::Float(number)) => {
            let single = *number as f32;
            // `inf` means an infinity. A decimal number that overflows is a mistake.
            match single.is_infinite() && number.is_finite() {
                true => Err(format!("`{value}` is too large for {}", name(scalar))),
                false => Ok(single.to_bits()),
            }
        }
        #[expect(clippy::cast_precision_loss, reason = "as a literal of WGSL would")]
        (Scalar::F32 | Scalar::F16, Value::Integer(number)) => Ok((*number as f32).to_bits()),
        (Scalar::I32, Value::Integer(number)) => {
            i32::try_from(*number).map(i32::cast_unsigned).map_err(|_| wrong())
        }
        (Scalar::U32, Value::Integer(number)) => u32::try_from(*number).map_err(|_| wrong()),
        (Scalar::Bool, Value::Boolean(value)) => Ok(u32::from(*value)),
        _ => Err(wrong()),
    }
}

pub(crate) fn is_number(value: &Value) -> bool {
    matches!(value, Value::Float(_) | Value::Integer(_) | Value::Boolean(_))
}

/// The scalars of a whole value, as `u32` words. One number sets each component of a vector.
pub(crate) fn lanes(shape: &Shape, value: &Value) -> Result<Vec<u32>, String> {
    match (shape, value) {
        (Shape::Scalar(scalar), value) => Ok(vec![lane(*scalar, value)?]),
        (Shape::Struct { members, .. }, Value::Table(table)) => {
            let known = || members.iter().map(|(name, _)| &**name);
            if let Some(unknown) = table.keys().find(|key| known().all(|name| name != key.as_str()))
            {
                return Err(no_such("member", unknown, known()));
            }
            let mut all = Vec::new();
            for (name, shape) in members {
                let value = table.get(name).ok_or_else(|| format!("member `{name}` is missing"))?;
                all.extend(lanes(shape, value).map_err(|error| format!("`{name}`: {error}"))?);
            }
            Ok(all)
        }
        // In an array of vectors or matrices, each number of the list sets one component.
        (Shape::Array { element, length }, Value::Array(list))
            if list.iter().all(is_number) && !matches!(**element, Shape::Scalar(_)) =>
        {
            let width = element.lanes().len();
            if list.len() != *length as usize * width {
                return Err(format!(
                    "{length} elements of {element} have {} components, but the list has {}",
                    *length as usize * width,
                    list.len()
                ));
            }
            let all =
                shape.lanes().into_iter().zip(list).map(|(scalar, value)| lane(scalar, value));
            all.collect()
        }
        (Shape::Array { element, length }, Value::Array(list))
            if list.len() == *length as usize =>
        {
            let all =
                list.iter().map(|value| lanes(element, value)).collect::<Result<Vec<_>, _>>()?;
            Ok(all.concat())
        }
        (Shape::Vector { .. } | Shape::Matrix { .. }, Value::Array(list)) => {
            let scalars = shape.lanes();
            // A matrix may be a list of columns.
            let flat: Vec<&Value> = list
                .iter()
                .flat_map(|value| match value {
                    Value::Array(column) => column.iter().collect(),
                    one => vec![one],
                })
                .collect();
            if flat.len() != scalars.len() {
                let count = scalars.len();
                return Err(format!(
                    "a {shape} has {count} components, but the list has {}",
                    flat.len()
                ));
            }
            scalars.iter().zip(flat).map(|(scalar, value)| lane(*scalar, value)).collect()
        }
        (Shape::Array { length, .. }, Value::Array(list)) => {
            Err(format!("the list must have {length} entries, but has {}", list.len()))
        }
        (Shape::Vector { .. } | Shape::Matrix { .. }, one) => {
            shape.lanes().iter().map(|scalar| lane(*scalar, one)).collect()
        }
        _ => Err(format!("`{value}` isn't of type {shape}")),
    }
}

/// The message about an unknown name, which suggests the nearest known name.
pub(crate) fn no_such<'a>(
    what: &str,
    unknown: &str,
    known: impl IntoIterator<Item = &'a str> + Clone,
) -> String {
    match nearest(unknown, known.clone()) {
        Some(near) => format!("there is no {what} `{unknown}`; did you mean `{near}`?"),
        None => {
            let known: Vec<_> = known.into_iter().map(|name| format!("`{name}`")).collect();
            format!("there is no {what} `{unknown}`; the known names are {}", known.join(", "))
        }
    }
}

/// The domain of a WGSL test's parameter, from the words in its `@over`.
pub(crate) fn over(name: &str, shape: &Shape, words: &[String]) -> Result<Vec<Part>, String> {
    let number = |word: &String| {
        let plain = word.trim_end_matches(['f', 'u', 'i', 'h']);
        match (plain.parse::<i64>(), plain.parse::<f64>()) {
            (Ok(whole), _) => Some(Value::Integer(whole)),
            (_, Ok(number)) => Some(Value::Float(number)),
            _ => None,
        }
    };
    let numbers: Option<Vec<Value>> = words.iter().map(number).collect();
    let value = match (words, numbers) {
        ([], _) => return Err("`@over` is empty: write a range, as in `@over(0, 1)`".to_owned()),
        ([one], None) => Value::String(one.clone()),
        ([name, least], None) if name == "hemisphere" => {
            Value::String(format!("hemisphere above {}", least.trim_end_matches(['f', 'h'])))
        }
        ([name, radius], None) if name == "sphere" || name == "ball" => {
            Value::String(format!("{name} {}", radius.trim_end_matches(['f', 'h'])))
        }
        ([name, list @ ..], None) if name == "one_of" => {
            let list = list.iter().map(number).collect::<Option<Vec<_>>>();
            let list = list.filter(|list| !list.is_empty() && matches!(shape, Shape::Scalar(_)));
            Value::Array(
                list.ok_or(
                    "`@over(one_of, -1, 1)` needs numbers, and a parameter that is a number",
                )?,
            )
        }
        (_, None) => {
            return Err("`@over` needs numbers, or one name such as `unit_vector`".to_owned());
        }
        ([_], Some(mut one)) => one.remove(0),
        ([least, most], Some(_)) => {
            let plain = |word: &String| word.trim_end_matches(['f', 'u', 'i', 'h']).to_owned();
            Value::String(format!("{}..{}", plain(least), plain(most)))
        }
        (_, Some(list)) => match shape {
            Shape::Scalar(_) => Value::Array(list),
            _ => {
                return Err(
                    "a list of values, as in `@over(0, 0.5, 1)`, needs a parameter that is a number".to_owned()
                );
            }
        },
    };
    parts(name, shape, Some(&value), &Ranges::default())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(shape: &Shape, text: &str) -> Result<usize, String> {
        let table: toml::Table = format!("x = {text}").parse().expect("TOML");
        Ok(parts("x", shape, Some(&table["x"]), &Ranges::default())?.iter().map(Part::width).sum())
    }

    #[test]
    fn each_form_of_a_domain_draws_its_type() {
        let float = Shape::Scalar(Scalar::F32);
        let count = Shape::Scalar(Scalar::U32);
        let vector = Shape::Vector { size: 3, scalar: Scalar::F32 };
        let matrix = Shape::Matrix { columns: 2, rows: 2, scalar: Scalar::F32 };
        for text in ["\"0..1\"", "\"0..=1\"", "\"-1e3 .. 2\"", "0.5", "1", "[0, 0.5]", "\"any\""] {
            assert_eq!(of(&float, text), Ok(1), "{text}");
        }
        for text in ["\"0..7\"", "3", "[1, 2, 4]"] {
            assert_eq!(of(&count, text), Ok(1), "{text}");
        }
        for text in [
            "\"unit_vector\"",
            "\"hemisphere above 0.01\"",
            "\"0..1\"",
            "[0, \"0..1\", [1, 2]]",
            "{ one_of = [[0, 0, 1], 0.5] }",
            "\"sphere 2\"",
            "\"ball 0.5\"",
            "{ perpendicular_to = \"n\" }",
        ] {
            assert_eq!(of(&vector, text), Ok(3), "{text}");
        }
        for text in ["\"unit_vector\"", "\"sphere 2\""] {
            for size in [2, 4] {
                let vector = Shape::Vector { size, scalar: Scalar::F32 };
                assert_eq!(of(&vector, text), Ok(usize::from(size)), "{text}");
            }
        }
        let words = ["one_of", "-1", "1"].map(str::to_owned);
        let two = over("x", &float, &words).expect("a list of two");
        assert_eq!(format!("{two:?}"), "[Part(one of 2)]");
        let words = ["ball", "2.0f"].map(str::to_owned);
        let ball = over("x", &vector, &words).expect("a radius");
        assert_eq!(format!("{ball:?}"), "[Part(a vector with a length of at most 2)]");
        assert_eq!(of(&matrix, "\"-1..1\""), Ok(4));
        let members = vec![("n".to_owned(), vector.clone()), ("k".to_owned(), count)];
        let own = Shape::Struct { name: "S".to_owned(), members };
        assert_eq!(of(&own, "{ k = 1 }"), Ok(4), "n comes from its name");
    }

    #[test]
    fn a_hemisphere_may_begin_above_the_horizon() {
        let vector = Shape::Vector { size: 3, scalar: Scalar::F32 };
        let expected = "[Part(a unit vector with z of at least 0.25)]";
        let table: toml::Table = "v = \"hemisphere above 0.25\"".parse().expect("TOML");
        let declared =
            parts("v", &vector, Some(&table["v"]), &Ranges::default()).expect("a domain");
        assert_eq!(format!("{declared:?}"), expected);
        let words = |least: &str| ["hemisphere", least].map(str::to_owned);
        let in_wgsl = over("v", &vector, &words("0.25f")).expect("a domain");
        assert_eq!(format!("{in_wgsl:?}"), expected);
        let error = over("v", &vector, &words("a")).expect_err("no number");
        assert!(error.contains("write `hemisphere above 0.01`"), "{error}");
    }

    #[test]
    fn an_invalid_domain_says_why() {
        let float = Shape::Scalar(Scalar::F32);
        let count = Shape::Scalar(Scalar::U32);
        let vector = Shape::Vector { size: 2, scalar: Scalar::F32 };
        for (shape, text, part) in [
            (&float, "\"0-1\"", "isn't a domain"),
            (&float, "\"a..1\"", "`a` isn't a number"),
            (&float, "\"-1...1\"", "write a range with two dots"),
            (&float, "true", "isn't of type f32"),
            (&float, "\"ani\"", "did you mean `any`?"),
            (
                &float,
                "\"unit_vector\"",
                "is a domain for a vec2, vec3 or vec4 of f32, but the argument is a f32",
            ),
            (&count, "\"-1..1\"", "isn't a range of u32"),
            (&count, "0.5", "of type u32"),
            (&vector, "\"unit_rgb\"", "is a domain for a vec3 of f32"),
            (&vector, "\"hemisphere above 0.5\"", "is a domain for a vec3 of f32"),
            (
                &float,
                "\"hemisphere above 0.5\"",
                "is a domain for a vec3 of f32, but the argument is a f32",
            ),
            (&vector, "\"sphere\"", "write `sphere 2`"),
            (&vector, "\"ball -1\"", "write `ball 2`"),
            (&float, "\"hemisphere over 0.5\"", "write `hemisphere above 0.01`"),
            (&vector, "\"hemisphere above 1.5\"", "a cosine from 0 to 1"),
            (&vector, "\"hemisphere above NaN\"", "a cosine from 0 to 1"),
            (&vector, "[1, 2, 3]", "each of 2 components"),
        ] {
            let error = of(shape, text).expect_err(text);
            assert!(error.contains(part), "{text}: {error}");
        }
    }
}
