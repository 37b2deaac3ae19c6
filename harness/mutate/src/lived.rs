//! Explains why a mutant lived. If possible, finds an input for which the mutant and the original differ.

use std::fmt;

use karat::Package;
use karat::unstable::interpret::equal::{Guard, agree_everywhere, is_same, never_acts};
use karat::unstable::probe::Probed;
use karat::unstable::value::{Scalar, Shape};
use karat_inspect::compare::{Change, Compared, PathChange, Request};
use serde::Serialize;

use crate::Candidate;
use crate::maker::{Mutant, Rule};

/// The reason why a mutant lived.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "why", rename_all = "snake_case")]
pub enum Lived {
    /// For an input that no test has, the mutant's result differs from the original's.
    Differs(Difference),
    /// Karat found no input for which the results differ. The results can still differ for inputs that Karat didn't
    /// try.
    Unseen {
        /// The number of inputs that Karat tried.
        cases: usize,
    },
    /// The mutant changes a sampler of a test, not the shader. No test samples at a coordinate for which the original
    /// and the mutated sampler give different results.
    Sampler,
    /// Karat can't compare the mutant with the original.
    Unknown {
        /// The reason.
        reason: String,
    },
}

/// An input for which the original and the mutant differ.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// The function with different results: `calc::half`.
    pub function: String,
    /// The names and values of the simplest arguments for which the results differ, and of the buffer members that
    /// affect the results.
    pub arguments: Vec<(String, String)>,
    /// The original's result, or the values that its pass writes.
    pub original: String,
    /// The mutant's result, or the values that its pass writes.
    pub mutant: String,
    /// `true` if the results are floats, which tests compare with a tolerance.
    pub floats: bool,
    /// `true` for a compute pass, which writes buffers and returns no value.
    pub leaves: bool,
    /// The arguments' types; `None` if the difference also depends on a resource, an override or a feature.
    #[serde(skip)]
    types: Option<Vec<Shape>>,
    #[serde(skip)]
    result: Option<Shape>,
}

/// The languages in which Karat suggests tests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// A `[[test]]` of a `*.test.toml`.
    Toml,
    /// A function with `@test`.
    Wgsl,
    /// A function with `#[test]`, which uses a package with the name `SHADERS`.
    Rust,
}

/// The proof that no test can see a mutant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Equality {
    /// The mutated function executes the same operations as the original.
    Operations,
    /// The mutant removes a guard that never acts: for all arguments, the guarded value lies within the guard's bounds.
    Intervals,
    /// The mutated function returns the same result for each possible input. Holds the number of inputs.
    Inputs(usize),
}

impl fmt::Display for Equality {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Operations => f.write_str("the mutant executes the same operations as the original"),
            Self::Intervals => f.write_str(
                "the guard does nothing: interval arithmetic proves that the guarded value is always within the bound",
            ),
            Self::Inputs(0 | 1) => f.write_str("the function has no inputs, and the mutant returns the same value as the original"),
            Self::Inputs(count) => write!(f, "the mutant returns the same results as the original for all {count} inputs"),
        }
    }
}

/// The proof that the mutated function is equivalent to the original function; `None` if Karat finds no proof.
pub(crate) fn equality(
    original: &Package,
    mutant: &Package,
    candidate: &Candidate,
) -> Option<Equality> {
    let probed = [original, mutant].map(|package| Probed::new(package, &candidate.path()));
    let [Ok(a), Ok(b)] = &probed else { return None };
    let Mutant { rule, range, original, replacement, .. } = &candidate.mutant;
    let argument = replacement.strip_prefix('(').and_then(|rest| rest.strip_suffix(')'));
    let guard = argument.map(|argument| Guard { at: range.start, text: original, argument });
    let guard = guard.filter(|_| *rule == Rule::Guard);
    match guard.is_some_and(|guard| never_acts(a, &guard)) {
        _ if is_same([a, b]) => Some(Equality::Operations),
        true => Some(Equality::Intervals),
        false => agree_everywhere([a, b]).map(Equality::Inputs),
    }
}

/// Compares the mutated function with the original. If that isn't possible, compares the functions that use the mutated
/// code.
pub(crate) fn why(original: &Package, mutant: &Package, candidate: &Candidate) -> Lived {
    if candidate.mutant.rule == Rule::Sampler {
        return Lived::Sampler;
    }
    let own = candidate.path();
    let compared = |only: &[&str]| {
        let request = Request::new(original.clone(), mutant.clone());
        request.only(only.iter().copied()).run().map_err(|error| error.to_string())
    };
    let found = match compared(&[&own]) {
        Ok(found) => found,
        Err(reason) => return Lived::Unknown { reason },
    };
    match verdict(original, found.iter().filter(|one| one.function == own)) {
        // The item is a constant, or a function that can't be called directly, so compare the functions that use it.
        None | Some(Lived::Unknown { .. }) => match compared(&[]) {
            Ok(all) => verdict(original, all.iter()).unwrap_or_else(|| Lived::Unknown {
                reason: "no function that Karat can call directly shows a difference".to_owned(),
            }),
            Err(reason) => Lived::Unknown { reason },
        },
        Some(known) => known,
    }
}

/// Returns the combined result of several comparisons: the first difference, otherwise the first unknown result,
/// otherwise no difference. Returns `None` if nothing was compared.
fn verdict<'c>(original: &Package, compared: impl Iterator<Item = &'c Compared>) -> Option<Lived> {
    let (mut cases, mut unknown) = (0, None);
    for one in compared {
        match &one.change {
            Change::Changed { paths } => {
                if let Some(path) = paths.first() {
                    return Some(Lived::Differs(Difference::of(original, one, path)));
                }
            }
            Change::Same { cases: own } => cases = cases.max(*own),
            Change::Unjudged { reason } => unknown = unknown.or(Some(reason.clone())),
            Change::Signature { .. } | Change::Added | Change::Removed => {
                unknown = unknown.or(Some(
                    "the mutant changes the type of a parameter or of the function's result"
                        .to_owned(),
                ));
            }
            _ => {}
        }
    }
    match (cases, unknown) {
        (0, Some(reason)) => Some(Lived::Unknown { reason }),
        (0, None) => None,
        (cases, _) => Some(Lived::Unseen { cases }),
    }
}

impl Difference {
    fn of(original: &Package, compared: &Compared, change: &PathChange) -> Self {
        let probed = Probed::new(original, &compared.function);
        let is_float =
            |probed: &Probed| probed.function().result.lanes().iter().any(|lane| lane.is_float());
        let floats = probed.as_ref().is_ok_and(is_float);
        let result = probed.as_ref().ok().map(|one| one.function().result.clone());
        let parameters =
            probed.map_or_else(|_| Vec::new(), |one| one.function().parameters.clone());
        // A test's `over` can't set members of buffers, overrides and features.
        let is_parameter =
            |(name, _): &(String, String)| parameters.iter().any(|(own, _)| own == name);
        let is_other = |one: &&(String, String)| change.given.iter().all(|(own, _)| *own != one.0);
        let others: Vec<_> = change.arguments.iter().filter(is_other).cloned().collect();
        let pastes = compared.under.is_empty()
            && compared.dispatched.is_none()
            && change.given.len() == parameters.len()
            && others.iter().all(is_parameter);
        Self {
            function: compared.function.clone(),
            arguments: change.given.iter().cloned().chain(others).collect(),
            original: change.before.clone(),
            mutant: change.after.clone(),
            floats,
            leaves: compared.dispatched.is_some(),
            types: pastes.then(|| parameters.into_iter().map(|(_, shape)| shape).collect()),
            result,
        }
    }

    /// A test for a `*.test.toml` that the original passes and the mutant fails. The test expects the original's
    /// result, so its author must check that the result is right. Returns `None` if the results also depend on inputs
    /// that aren't arguments, if the original's result isn't finite, or if the results differ only in the sign of a 0,
    /// which tests ignore.
    #[must_use]
    pub fn test(&self) -> Option<String> {
        let over = self.arguments.iter().map(|(name, value)| {
            let value = toml_of(value)?;
            // In TOML, a list would mean the domains of a vector's components.
            Some(match value.starts_with('[') {
                true => format!("{name} = {{ one_of = [{value}] }}"),
                false => format!("{name} = {value}"),
            })
        });
        let over = over.collect::<Option<Vec<_>>>()?.join(", ");
        let over = if over.is_empty() { over } else { format!("over = {{ {over} }}\n") };
        let equals = toml_of(&self.original).filter(|_| self.types.is_some())?;
        let tolerance = match self.bound()? {
            Some(bound) => format!("tolerance = \"abs {bound}\"\n"),
            None if self.floats => "tolerance = \"1 ulp\"\n".to_owned(),
            None => String::new(),
        };
        let name = self.function.rsplit("::").next().unwrap_or(&self.function);
        Some(format!("[[test]]\nfunction = \"{name}\"\n{over}equals = {equals}\n{tolerance}"))
    }

    /// The same test as [`test`](Self::test) in another language, with a name that ends in `ending`. Also returns
    /// `None` if an argument or the result is a structure, an array or a matrix.
    #[must_use]
    pub fn test_as(&self, form: Form, ending: &str) -> Option<String> {
        let (types, result) = (self.types.as_ref()?, self.result.as_ref()?);
        let toml = self.test()?;
        let function = &self.function;
        let (module, name) = function.rsplit_once("::").unwrap_or(("", function));
        let values = || self.arguments.iter().zip(types);
        let bound = self.bound()?;
        match form {
            Form::Toml => Some(toml),
            Form::Wgsl => {
                let of = |((_, value), shape): (&(String, String), &Shape)| wgsl_of(value, shape);
                let arguments = values().map(of).collect::<Option<Vec<_>>>()?.join(", ");
                let (call, equals) =
                    (format!("{name}({arguments})"), wgsl_of(&self.original, result)?);
                let (expects, suffix, behind) = match (result, self.floats) {
                    (Shape::Scalar(Scalar::Bool), _) => {
                        ("true", String::new(), format!("{call} == {equals}"))
                    }
                    (_, true) => {
                        let (verb, bound) =
                            bound.map_or(("ulp", "1.0".to_owned()), |bound| ("near", bound));
                        (verb, suffix_of(result)?, format!("{call}, {equals}, {bound}"))
                    }
                    (_, false) => ("equal", suffix_of(result)?, format!("{call}, {equals}")),
                };
                let path =
                    if module.is_empty() { name.to_owned() } else { format!("{module}::{name}") };
                Some(format!(
                    "import package::{path};\nimport karat::expect_{expects}{suffix};\n\
                     @test fn {name}_{ending}() {{ expect_{expects}{suffix}({behind}); }}\n"
                ))
            }
            Form::Rust => {
                let of = |((_, value), shape): (&(String, String), &Shape)| {
                    Some((rust_of(value, shape, false)?, rust_type(shape)?))
                };
                let all = values().map(of).collect::<Option<Vec<_>>>()?;
                let just: Vec<String> =
                    all.iter().map(|(value, _)| format!("Just({value})")).collect();
                let over =
                    if let [one] = &*just { one.clone() } else { format!("({})", just.join(", ")) };
                let takes: Vec<String> = all.iter().map(|(_, ty)| format!("_: {ty}")).collect();
                let equals = rust_of(&self.original, result, true)?;
                let bound = match (bound, self.floats) {
                    (Some(bound), _) => format!("Abs({bound})"),
                    (None, true) => "Ulp(1.0)".to_owned(),
                    (None, false) => "Abs(0.0)".to_owned(),
                };
                (!all.is_empty()).then(|| {
                    format!(
                        "#[test]\nfn {name}_{ending}() {{\n    SHADERS.function(\"{function}\").over({over})\
                         .agrees_with(|{}| {equals}, {bound});\n}}\n",
                        takes.join(", ")
                    )
                })
            }
        }
    }

    /// Half of the distance between the two results, as an absolute tolerance. `Some(None)` if a test needs no
    /// tolerance, because a result isn't a finite float. `None` if the results differ only in the sign of a 0, which no
    /// test sees.
    fn bound(&self) -> Option<Option<String>> {
        let [own, others] = [&self.original, &self.mutant].map(|text| numbers(text));
        if self.floats && own == others {
            return None;
        }
        let far: Vec<f64> = own.iter().zip(&others).map(|(a, b)| (a - b).abs()).collect();
        // NaN fails every tolerance, so a test that expects a number needs no absolute tolerance here.
        let is_number = far.iter().all(|one| one.is_finite());
        let far = far.into_iter().fold(0.0, f64::max);
        let has = self.floats && is_number && far > 0.0;
        Some(has.then(|| format!("{:.1e}", far / 2.0)))
    }
}

/// The scalars in a value's text: a vector's components, or one scalar.
fn components<'v>(value: &'v str, shape: &Shape) -> Option<(Scalar, Vec<&'v str>)> {
    let scalar = match shape {
        Shape::Scalar(scalar) | Shape::Vector { scalar, .. } => *scalar,
        _ => return None,
    };
    let inner = value.trim_start_matches('(').trim_end_matches(')');
    Some((scalar, inner.split(", ").collect()))
}

/// Formats a number as a float literal that is valid in WGSL and in Rust.
fn float(text: &str) -> String {
    if text.contains(['.', 'e']) { text.to_owned() } else { format!("{text}.0") }
}

fn wgsl_of(value: &str, shape: &Shape) -> Option<String> {
    let (scalar, parts) = components(value, shape)?;
    let one = |part: &str| match scalar {
        Scalar::F32 => float(part),
        Scalar::F16 => format!("{}h", float(part)),
        Scalar::U32 => format!("{part}u"),
        Scalar::I32 | Scalar::Bool => part.to_owned(),
    };
    let all: Vec<String> = parts.into_iter().map(one).collect();
    Some(match shape {
        Shape::Vector { .. } => format!("{shape}({})", all.join(", ")),
        _ => all.concat(),
    })
}

/// The suffix that an expectation's name has for a type, such as `_vec3` or `_vec2u`.
fn suffix_of(shape: &Shape) -> Option<String> {
    Some(match shape {
        Shape::Scalar(Scalar::F32) => String::new(),
        Shape::Scalar(scalar @ (Scalar::I32 | Scalar::U32)) => format!("_{}", scalar.wgsl()),
        Shape::Vector { size, scalar: Scalar::F32 } => format!("_vec{size}"),
        Shape::Vector { size, scalar: Scalar::I32 } => format!("_vec{size}i"),
        Shape::Vector { size, scalar: Scalar::U32 } => format!("_vec{size}u"),
        _ => return None,
    })
}

/// The Rust code for a value. If `reference` is `true`, the code is for the result of a reference, in `f64`; otherwise
/// for an argument.
fn rust_of(value: &str, shape: &Shape, reference: bool) -> Option<String> {
    let (scalar, parts) = components(value, shape)?;
    let one = |part: &str| match scalar {
        Scalar::F32 => float(part),
        _ => part.to_owned(),
    };
    let all = parts.into_iter().map(one).collect::<Vec<_>>().join(", ");
    let double = if reference && scalar == Scalar::F32 { "D" } else { "" };
    Some(match (shape, rust_type(shape)?) {
        (Shape::Vector { .. }, ty) => {
            format!("{double}{}::new({all})", ty.trim_start_matches('D'))
        }
        (_, ty) if ty == "f64" => {
            if reference {
                all
            } else {
                format!("{all}_f32")
            }
        }
        (_, ty) if ty == "bool" => all,
        (_, ty) => format!("{all}_{ty}"),
    })
}

fn rust_type(shape: &Shape) -> Option<String> {
    Some(match shape {
        Shape::Scalar(Scalar::F32) => "f64".to_owned(),
        Shape::Scalar(Scalar::F16) => return None,
        Shape::Scalar(scalar) => scalar.wgsl().to_owned(),
        Shape::Vector { size, scalar } => match scalar {
            Scalar::F32 => format!("DVec{size}"),
            Scalar::I32 => format!("IVec{size}"),
            Scalar::U32 => format!("UVec{size}"),
            Scalar::F16 | Scalar::Bool => return None,
        },
        _ => return None,
    })
}

fn numbers(text: &str) -> Vec<f64> {
    let is_part = |c: char| c.is_ascii_alphanumeric() || ".+-".contains(c);
    text.split(|c| !is_part(c)).filter_map(|word| word.parse().ok()).collect()
}

/// Converts a number, `true`, `false` or a vector to TOML.
fn toml_of(value: &str) -> Option<String> {
    let plain = |c: char| c.is_ascii_digit() || " ,.+-e()".contains(c);
    let is_plain = value.chars().all(plain) || matches!(value, "true" | "false");
    // TOML reads `-0` as an integer, which has no negative zero.
    let is_signed_zero = value.split(|c: char| " ,()".contains(c)).any(|word| word == "-0");
    (is_plain && !is_signed_zero).then(|| value.replace('(', "[").replace(')', "]"))
}
