//! Mismatches between a function and a check: the arguments, the expected value or a setting doesn't fit.

use super::Failure;
use crate::output::counted;
use crate::path::Selector;
use crate::reflect::Function;
use crate::stats::Support;
use crate::tolerance::Tolerance;
use crate::value::{Differing, Scalar, Shape};

/// A mismatch between a function and a check.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Mismatch {
    /// The check supplies arguments whose types differ from those of the function's parameters.
    #[error("takes {}, but {who} {}{}", list(declared), list(supplied), hint(declared, supplied))]
    Arguments {
        /// The types of the function's parameters.
        declared: Vec<Shape>,
        /// The types of the supplied arguments.
        supplied: Vec<Shape>,
        /// The words in the message that say who supplies the arguments: `the domain supplies`.
        who: &'static str,
    },
    /// The function's result and the expected value have different types.
    #[error("returns {declared}, but {who} {supplied}{}", member(supplied.differing(declared, true)))]
    Result {
        /// The type of the function's result.
        declared: Shape,
        /// The type of the expected value.
        supplied: Shape,
        /// The words in the message that name the expected value: `the reference returns`.
        who: String,
    },
    /// The function returns a type that the verb can't use.
    #[error("returns {result}, {wanted}")]
    Unsuited {
        /// The type that the function returns.
        result: Shape,
        /// The words in the message that say what the verb needs: `but this check needs a vector of floats`.
        wanted: &'static str,
    },
    /// The check compares the function with itself.
    #[error(
        "is compared with itself, so the check can't find a mistake: name another function, or use \
         `Spec`, which checks that WGSL allows the driver's results"
    )]
    Itself,
    /// The check's range is empty, or contains every number, so the verdict wouldn't depend on the results.
    #[error("is checked for a result that {0}: no result passes this check, or every result does")]
    Range(String),
    /// The check looks for no kind of hazard, or for a kind that no operation can have.
    #[error(
        "can't be checked: {0}; name kinds of hazards that one operation can have, such as `Nan`"
    )]
    Hazard(String),
    /// The declaration that accepts a hazard has no reason, or the hazard occurs in no case.
    #[error("has a declaration that accepts the hazard of `{0}`; the declaration {1}")]
    Accepted(String, &'static str),
    /// A tolerance has an unusable bound.
    #[error(
        "has the tolerance {tolerance}, but {bound:e} can't be a bound: use a number of at least 0, small \
         enough that some results fail"
    )]
    Bound {
        /// The tolerance.
        tolerance: Tolerance,
        /// The unusable bound.
        bound: f64,
    },
    /// The number of the tolerance's bounds differs from the number of the result's components.
    #[error("returns {}, but the tolerance has bounds for {declared}", counted(*lanes, "component"))]
    Lanes {
        /// The number of components of the result.
        lanes: usize,
        /// The number of components for which the tolerance has bounds.
        declared: usize,
    },
    /// The check sets a tolerance for a path, but the verb uses no tolerance.
    #[error(
        "is checked by {check}, which takes no tolerance: remove the tolerance {tolerance} for path {on}"
    )]
    NoTolerance {
        /// The verb.
        check: &'static str,
        /// The paths for which the check sets a tolerance.
        on: Selector,
        /// The tolerance on these paths.
        tolerance: Tolerance,
    },
    /// The function has no parameter with this name.
    #[error("has no parameter `{name}`{}",
        nearest.as_ref().map_or_else(String::new, |name| format!("; did you mean `{name}`?")))]
    NoParameter {
        /// The parameter name that the check uses.
        name: String,
        /// The parameter with the most similar name.
        nearest: Option<String>,
    },
    /// The check selects a parameter by its index, but the function has fewer parameters.
    #[error("has {}, so there is no argument {place} (arguments are counted from 0)",
        counted(*count, "parameter"))]
    NoPlace {
        /// The number of the function's parameters.
        count: usize,
        /// The selected index, counted from 0.
        place: usize,
    },
    /// A parameter isn't a single number.
    #[error("has the parameter `{name}` of type {shape}, which isn't a single number")]
    NoNumber {
        /// The name of the parameter.
        name: String,
        /// The type of the parameter.
        shape: Shape,
    },
    /// The check asks for a result that is perpendicular to a parameter, but the result and the parameter have
    /// different types.
    #[error(
        "returns {result}, and has the parameter `{name}` of type {shape}: only vectors of the same type can be perpendicular"
    )]
    NoDirection {
        /// The name of the parameter.
        name: String,
        /// The type of the parameter.
        shape: Shape,
        /// The type of the function's result.
        result: Shape,
    },
    /// The verb `at_limit` varies a parameter that isn't an `f32`.
    #[error("has the parameter `{0}`, which isn't an f32: only an f32 can approach a limit")]
    NoFloat(String),
    /// The steps of a limit don't approach its target.
    #[error("is checked at the limit {limit}, which {reason}")]
    Limit {
        /// The limit with its steps.
        limit: String,
        /// The reason why the steps don't approach the target.
        reason: String,
    },
    /// A check of a sampler sets an executor (`.on(...)`) for its second function, such as the density.
    #[error("runs on the sampler's executors: call `.on(..)` only on the sampler")]
    Executor,
    /// Karat can't sample random numbers of this type.
    #[error("takes random numbers of type {0}, but Karat makes only f32 and u32")]
    Random(Shape),
    /// The verb needs samples that are directions, but the support contains other points.
    #[error("can't be estimated on {0}: in this check, samples must be directions")]
    NoDirections(Support),
    /// The density takes points of one type, but the support has points of another type.
    #[error("is given points of type {given}, but the points of {support} have type {point}")]
    Point {
        /// The type of the density's points.
        given: Shape,
        /// The support.
        support: Support,
        /// The type of the support's points.
        point: Shape,
    },
}

/// Returns a hint about arguments of the wrong types: the first member in which two structures differ, or the advice of
/// `mixed_up`.
fn hint(declared: &[Shape], supplied: &[Shape]) -> String {
    if declared.len() != supplied.len() {
        return mixed_up(declared, supplied);
    }
    let mut pairs = supplied.iter().zip(declared);
    let first = pairs.find(|(host, wgsl)| !host.stands_for(wgsl, false));
    member(first.and_then(|(host, wgsl)| host.differing(wgsl, false)))
}

fn member(differing: Option<Differing>) -> String {
    let Some(Differing { structure, place, wgsl, host }) = differing else { return String::new() };
    let told = |side: Option<String>| side.map_or("missing".to_owned(), |side| format!("`{side}`"));
    let (wgsl, host) = (told(wgsl), told(host));
    format!("\n  member {place} of `{structure}` is {wgsl} in the function, but {host} in the test")
}

/// Returns a hint if the test supplies a tuple for one vector or structure, or a vector or structure for several
/// parameters.
fn mixed_up(declared: &[Shape], supplied: &[Shape]) -> String {
    let lanes = |shapes: &[Shape]| shapes.iter().flat_map(Shape::lanes).collect::<Vec<_>>();
    let apart = declared.len() != supplied.len() && lanes(declared) == lanes(supplied);
    match (apart, declared.len() < supplied.len()) {
        (false, _) => String::new(),
        (true, true) => {
            let of_several = declared.iter().find(|shape| shape.lanes().len() > 1);
            let name = of_several.map_or_else(|| "Vec2".to_owned(), host_name);
            format!(": `(..).compose::<{name}>()` makes one value from a tuple")
        }
        (true, false) => ": give each parameter its own domain, in a tuple of domains".to_owned(),
    }
}

/// The name that a WGSL type probably has in a Rust test: `Vec3`, `UVec2`.
fn host_name(shape: &Shape) -> String {
    match shape {
        Shape::Vector { size, scalar: Scalar::U32 } => format!("UVec{size}"),
        Shape::Vector { size, scalar: Scalar::I32 } => format!("IVec{size}"),
        Shape::Vector { size, .. } => format!("Vec{size}"),
        Shape::Struct { name, .. } => name.rsplit("::").next().unwrap_or(name).to_owned(),
        other => other.to_string(),
    }
}

fn list(shapes: &[Shape]) -> String {
    let names: Vec<String> = shapes.iter().map(ToString::to_string).collect();
    format!("({})", names.join(", "))
}

impl Mismatch {
    /// Turns the mismatch into a failure, with the function's signature and its position in the source file.
    pub(super) fn of(self, function: &Function) -> Failure {
        Failure::Signature {
            function: function.name.clone(),
            mismatch: Box::new(self),
            signature: function.to_string(),
            location: function.span.to_string(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn structure(name: &str, members: &[(&str, Shape)]) -> Shape {
        let own = |(name, shape): &(&str, Shape)| ((*name).to_owned(), shape.clone());
        Shape::Struct { name: name.to_owned(), members: members.iter().map(own).collect() }
    }

    #[test]
    fn a_tuple_for_one_value_has_a_hint() {
        let number = Shape::Scalar(Scalar::F32);
        let vector = |size, scalar| Shape::Vector { size, scalar };
        let hinted = hint(&[vector(3, Scalar::F32)], &vec![number.clone(); 3]);
        assert!(hinted.contains("`(..).compose::<Vec3>()`"), "{hinted}");
        let whole = Shape::Scalar(Scalar::U32);
        let hinted =
            hint(&[vector(2, Scalar::U32), number.clone()], &[whole.clone(), whole, number]);
        assert!(hinted.contains("`(..).compose::<UVec2>()`"), "{hinted}");
    }

    #[test]
    fn the_first_member_that_differs_is_named() {
        let number = Shape::Scalar(Scalar::F32);
        let colour = Shape::Vector { size: 3, scalar: Scalar::F32 };
        let [rough, f0] = [("roughness", number.clone()), ("f0", colour.clone())];
        let wgsl = structure("Material", &[rough.clone(), f0.clone()]);
        let told = |declared: &Shape, supplied: &Shape| {
            let (declared, supplied) = (vec![declared.clone()], vec![supplied.clone()]);
            Mismatch::Arguments { declared, supplied, who: "the domain supplies" }.to_string()
        };
        let swapped = structure("Material", &[f0.clone(), rough.clone()]);
        assert_eq!(
            told(&wgsl, &swapped),
            "takes (Material), but the domain supplies (Material)\n  \
             member 1 of `Material` is `roughness: f32` in the function, but `f0: vec3<f32>` in the test"
        );
        let short = structure("Material", std::slice::from_ref(&rough));
        let part =
            "member 2 of `Material` is `f0: vec3<f32>` in the function, but missing in the test";
        assert!(told(&wgsl, &short).ends_with(part), "{}", told(&wgsl, &short));
        // The message names the inner structure, which contains the difference, and not the outer structure.
        let [inside, other] = [&wgsl, &structure("Material", &[rough, ("f0", number.clone())])]
            .map(|material| {
                let pair = Shape::Array { element: Box::new(material.clone()), length: 2 };
                structure("Scene", &[("exposure", number.clone()), ("materials", pair)])
            });
        let part =
            "member 2 of `Material` is `f0: vec3<f32>` in the function, but `f0: f32` in the test";
        assert!(told(&inside, &other).ends_with(part), "{}", told(&inside, &other));
        assert_eq!(told(&number, &colour), "takes (f32), but the domain supplies (vec3<f32>)");
        let returned = |supplied: &Shape| {
            let (declared, supplied) = (wgsl.clone(), supplied.clone());
            let who = "the reference returns".to_owned();
            Mismatch::Result { declared, supplied, who }.to_string()
        };
        let text = returned(&swapped);
        assert!(
            text.contains("returns Material, but the reference returns Material\n  member 1"),
            "{text}"
        );
        let wrong =
            crate::package::Package::from_source("s", "\nfn f(x: f32) -> f32 { return x; }");
        let check = wrong.function("f").over((0.0..=1.0_f32, 0.0..=1.0_f32));
        let failure = check.unrecorded().try_is_finite().expect_err("it takes one");
        let located = crate::run::Fails::location(&failure);
        assert!(located.is_some_and(|place| place.ends_with(":2:1")), "{failure:?}");
        let text = returned(&<(f64, f64) as crate::value::Mirror>::shape());
        assert_eq!(text, "returns Material, but the reference returns (f32, f32)");
    }
}
