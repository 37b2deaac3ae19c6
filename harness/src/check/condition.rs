//! Conditions: statements about a function's arguments, written in WGSL.

use std::fmt::Write as _;
use std::sync::Arc;

use crate::fixture::Fixtures;
use crate::interpret::Interpreted;
use crate::package::{Package, texts};
use crate::probe::{ProbeError, Probed};
use crate::value::{Scalar, Shape};

const MODULE: &str = "condition";

/// The name of the condition's value in the generated module. No parameter can have this name.
const RESULT: &str = "karat_condition";

const FUNCTION: &str = "holds";

/// A statement about a function's arguments: a WGSL expression of type `bool`. The expression can use the
/// names of the parameters and WGSL's builtin functions. Karat's engine evaluates the expression.
///
/// ```
/// use karat::unstable::check::Condition;
/// use karat::unstable::value::{Scalar, Shape};
///
/// let float = |name: &str| (name.to_owned(), Shape::Scalar(Scalar::F32));
/// let below = Condition::parse(&[float("a"), float("b")], "a < b").expect("an expression");
/// assert!(below.holds(&[0.0_f32, 1.0].map(f32::to_bits)));
/// ```
#[derive(Clone)]
pub struct Condition {
    interpreted: Arc<Interpreted>,
    /// The scalars that the condition reads, as indices in a row. For an argument that varies from pixel to pixel, the
    /// condition reads only the pixel's own value, not its neighbours' values.
    lanes: Vec<usize>,
}

impl std::fmt::Debug for Condition {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Condition")
    }
}

impl Condition {
    /// Reads a statement about these parameters.
    ///
    /// # Errors
    /// Returns an error message if the text isn't an expression of type `bool`, or uses none of the parameters.
    pub fn parse(parameters: &[(String, Shape)], text: &str) -> Result<Self, String> {
        let all = texts(text);
        if !parameters.iter().any(|(name, _)| all.contains(&name.as_str())) {
            let names: Vec<_> = parameters.iter().map(|(name, _)| format!("`{name}`")).collect();
            return Err(match &*names {
                [] => "the function takes no arguments, so the condition keeps all cases or none: remove the condition"
                    .to_owned(),
                names => format!(
                    "`{text}` names no argument, so this condition keeps all cases or none: use {}",
                    names.join(", ")
                ),
            });
        }
        // An extra `)` would close the generated bracket. The text after it could then be any statement.
        let depth = all.iter().try_fold(0_u32, |depth, text| match *text {
            "(" => Some(depth + 1),
            ")" => depth.checked_sub(1),
            _ => Some(depth),
        });
        if depth != Some(0) {
            return Err(format!("`{text}`: the condition's brackets don't match"));
        }
        let mut lanes = Vec::new();
        let mut below = 0;
        let (mut structures, mut taken) = (String::new(), Vec::new());
        for (name, shape) in parameters {
            let value = shape.quad().unwrap_or(shape);
            lanes.extend(below..below + value.lanes().len());
            below += shape.lanes().len();
            taken.push(format!("{name}: {}", declared(value, &mut structures)));
        }
        let has = |wanted: Scalar| parameters.iter().any(|(_, s)| s.lanes().contains(&wanted));
        let enable = if has(Scalar::F16) { "enable f16;\n" } else { "" };
        // A `//` comment at the end of `text` would hide the closing bracket. The line break ends the comment.
        let taken = taken.join(", ");
        let source = format!(
            "{enable}{structures}fn {FUNCTION}({taken}) -> bool {{ let {RESULT}: bool = (\n{text}\n); return {RESULT}; }}"
        );
        let package = Package::from_source(MODULE, source);
        let probed = Probed::new(&package, FUNCTION).map_err(|error| sentence(&error, text))?;
        let interpreted = Interpreted::new(&probed, &Fixtures::default());
        let interpreted = Arc::new(interpreted.map_err(|error| sentence(&error, text))?);
        Ok(Self { interpreted, lanes })
    }

    /// Checks if the text contains the name of this parameter.
    #[must_use]
    pub fn names(text: &str, parameter: &str) -> bool {
        texts(text).contains(&parameter)
    }

    /// Checks if the condition holds for a row of arguments. Returns `false` if the engine can't evaluate the
    /// condition for this row.
    #[must_use]
    pub fn holds(&self, row: &[u32]) -> bool {
        let taken: Vec<u32> = self.lanes.iter().map(|lane| row[*lane]).collect();
        self.interpreted.words(1, &taken).is_ok_and(|words| words == [1])
    }
}

/// Returns the WGSL name of a type. Appends declarations of the structures that the type needs, the innermost
/// first.
fn declared(shape: &Shape, structures: &mut String) -> String {
    match shape {
        Shape::Array { element, length } => {
            format!("array<{}, {length}>", declared(element, structures))
        }
        Shape::Struct { members, .. } => {
            let members: Vec<String> = members
                .iter()
                .map(|(name, shape)| format!("{name}: {}", declared(shape, structures)))
                .collect();
            let name = format!("Karat{}", structures.len());
            // Writing to a string can't fail.
            let _ = writeln!(structures, "struct {name} {{ {} }}", members.join(", "));
            name
        }
        plain => plain.to_string(),
    }
}

/// Returns the compiler's message about the expression, without the location in the generated module.
fn sentence(error: &ProbeError, text: &str) -> String {
    let told = match error {
        ProbeError::Reflect(error) => error.diagnostic().map(|own| own.message.clone()),
        _ => None,
    };
    let told = told.unwrap_or_else(|| error.to_string());
    format!("`{text}`: {}", told.replace(&format!("`{RESULT}`"), "the condition"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Result<Condition, String> {
        let vector = Shape::Vector { size: 3, scalar: Scalar::F32 };
        let members =
            vec![("n".to_owned(), vector.clone()), ("k".to_owned(), Shape::Scalar(Scalar::U32))];
        let surface = Shape::Struct { name: "a::Surface".to_owned(), members };
        Condition::parse(&[("s".to_owned(), surface), ("v".to_owned(), vector)], text)
    }

    #[test]
    fn a_condition_may_use_members_and_builtin_functions() {
        let above = of("dot(s.n, v) > 0.0 && s.k != 3u // above").expect("an expression");
        let row = |n: f32, k: u32| {
            let mut row = [0.0, 0.0, n].map(f32::to_bits).to_vec();
            row.push(k);
            row.extend([0.0, 0.6, 0.8].map(f32::to_bits));
            row
        };
        assert!(above.holds(&row(1.0, 2)));
        assert!(!above.holds(&row(-1.0, 2)) && !above.holds(&row(1.0, 3)));
        assert!(!above.holds(&row(f32::NAN, 2)), "NaN is above nothing");
    }

    #[test]
    fn an_invalid_condition_says_why() {
        for (text, part) in [
            ("s.k", "`s.k`: "),
            ("v.x >", "`v.x >`: "),
            ("dot(s.m, v) > 0.0", "m"),
            ("w > v.x", "w"),
            ("true // v.x > 0.0", "names no argument"),
            ("true /* /* s */ v */", "names no argument"),
            ("v.x) > (0.0", "the condition's brackets don't match"),
            ("true", "names no argument, so this condition keeps all cases or none: use `s`, `v`"),
            ("vv.x > 0.0", "names no argument"),
        ] {
            let error = of(text).expect_err(text);
            assert!(error.contains(part), "{text}: {error}");
            assert!(!error.contains("condition.wgsl") && !error.contains('\n'), "{error}");
        }
        let own = Condition::parse(
            &[("condition".to_owned(), Shape::Scalar(Scalar::F32))],
            "condition > 0.5",
        );
        assert!(own.expect("a name like another").holds(&[1.0_f32.to_bits()]));
        let none = Condition::parse(&[], "true").expect_err("nothing to filter");
        assert!(none.contains("takes no arguments"), "{none}");
    }
}
