//! Mismatches between a function and a check's arguments, expectations or settings.

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
    /// The function takes other arguments than the check supplies.
    #[error("takes {}, {who} {}{}", list(declared), list(supplied), hint(declared, supplied))]
    Arguments {
        /// The types of the function's parameters.
        declared: Vec<Shape>,
        /// The types of the supplied arguments.
        supplied: Vec<Shape>,
        /// The origin of the arguments, for the message: `the domain draws`.
        who: &'static str,
    },
    /// The function's result has another type than the expected value.
    #[error("returns {declared}, {who} {supplied}{}", member(supplied.differing(declared, true)))]
    Result {
        /// The type of the function's result.
        declared: Shape,
        /// The type of the expected value.
        supplied: Shape,
        /// The origin of the expected value, for the message: `the reference returns`.
        who: String,
    },
    /// The function returns a type that the verb can't use.
    #[error("returns {result}, {wanted}")]
    Unsuited {
        /// The type that the function returns.
        result: Shape,
        /// The need of the verb, for the message: `not up to three floats`.
        wanted: &'static str,
    },
    /// The function is its own reference.
    #[error(
        "is compared with itself, so a mistake in it can't be seen: name another function, or take `Spec`, \
         which asks whether a driver computes what WGSL allows"
    )]
    Itself,
    /// A range contains no number, or all numbers.
    #[error("is to have a result that {0}: no result, or every one, does")]
    Range(String),
    /// The check asks for no kind of hazard, or for a kind that operations of functions can't have.
    #[error("is asked for {0}: name kinds that an operation inside of it may have, such as `Nan`")]
    Hazard(String),
    /// An accepted hazard has no reason, or occurs in no case.
    #[error("accepts the hazard of `{0}`, which {1}")]
    Accepted(String, &'static str),
    /// A tolerance has an unusable bound.
    #[error(
        "has the tolerance {tolerance}, but {bound:e} isn't a bound: use a number of at least 0 that an \
         error can exceed"
    )]
    Bound {
        /// The tolerance.
        tolerance: Tolerance,
        /// The unusable bound.
        bound: f64,
    },
    /// A tolerance is for another number of components.
    #[error("returns {}, the tolerance is declared for {declared}", counted(*lanes, "component"))]
    Lanes {
        /// Components of the result.
        lanes: usize,
        /// Components of the tolerance.
        declared: usize,
    },
    /// A path has its own tolerance, but the verb has no tolerance.
    #[error("is checked by {check}, which takes no tolerance: remove {tolerance} for {on}")]
    NoTolerance {
        /// The verb.
        check: &'static str,
        /// The paths.
        on: Selector,
        /// Their tolerance.
        tolerance: Tolerance,
    },
    /// No parameter has this name.
    #[error("has no parameter `{name}`{}",
        nearest.as_ref().map_or_else(String::new, |name| format!("; did you mean `{name}`?")))]
    NoParameter {
        /// The name in the check.
        name: String,
        /// The parameter with the most similar name.
        nearest: Option<String>,
    },
    /// No parameter has this place.
    #[error("has {}, so there is no argument {place} (the first is 0)",
        counted(*count, "parameter"))]
    NoPlace {
        /// The number of the function's parameters.
        count: usize,
        /// The place in the check, counted from 0.
        place: usize,
    },
    /// A parameter isn't one number.
    #[error("has `{name}` of type {shape}, which isn't one number")]
    NoNumber {
        /// The parameter.
        name: String,
        /// Its type.
        shape: Shape,
    },
    /// The check asks for a result that is perpendicular to a parameter, but their types differ.
    #[error(
        "returns {result}, and has `{name}` of type {shape}: two vectors of one type can be perpendicular"
    )]
    NoDirection {
        /// The parameter.
        name: String,
        /// Its type.
        shape: Shape,
        /// The type of the function's result.
        result: Shape,
    },
    /// The parameter of a limit isn't a float.
    #[error("has `{0}`, which isn't f32: only an f32 can approach a limit")]
    NoFloat(String),
    /// The steps of a limit don't approach it.
    #[error("is asked for its limit at {limit}, which {reason}")]
    Limit {
        /// The limit with its steps.
        limit: String,
        /// The reason.
        reason: String,
    },
    /// A second function of a check of samples, such as the density, has its own executor.
    #[error("runs where the sampler runs: call `.on(..)` on the sampler only")]
    Executor,
    /// Karat can't sample random numbers of this type.
    #[error("is sampled with {0}, but random numbers are f32 or u32")]
    Random(Shape),
    /// The verb needs directions, but the support has other points.
    #[error("can't be estimated on {0}: this check needs directions")]
    NoDirections(Support),
    /// The points for a density have another type than the points of the support.
    #[error("is given points of type {given}, but the points of {support} are {point}")]
    Point {
        /// The type of the density's points.
        given: Shape,
        /// The support.
        support: Support,
        /// The type of the support's points.
        point: Shape,
    },
}

/// A hint about the difference between arguments whose types may have the same names, or about a likely mix-up.
fn hint(declared: &[Shape], supplied: &[Shape]) -> String {
    if declared.len() != supplied.len() {
        return mixed_up(declared, supplied);
    }
    let mut pairs = supplied.iter().zip(declared);
    let first = pairs.find(|(host, wgsl)| !host.stands_for(wgsl, false));
    member(first.and_then(|(host, wgsl)| host.differing(wgsl, false)))
}

/// The first member in which two structures differ.
fn member(differing: Option<Differing>) -> String {
    let Some(Differing { structure, place, wgsl, host }) = differing else { return String::new() };
    let told = |side: Option<String>| side.map_or("missing".to_owned(), |side| format!("`{side}`"));
    let (wgsl, host) = (told(wgsl), told(host));
    format!(
        "\n  member {place} of the function's `{structure}` is {wgsl}, of the other one it is {host}"
    )
}

/// A hint if the check has a tuple in place of one vector or structure, or the other way round.
fn mixed_up(declared: &[Shape], supplied: &[Shape]) -> String {
    let lanes = |shapes: &[Shape]| shapes.iter().flat_map(Shape::lanes).collect::<Vec<_>>();
    let apart = declared.len() != supplied.len() && lanes(declared) == lanes(supplied);
    match (apart, declared.len() < supplied.len()) {
        (false, _) => String::new(),
        (true, true) => {
            let of_several = declared.iter().find(|shape| shape.lanes().len() > 1);
            let name = of_several.map_or_else(|| "Vec2".to_owned(), host_name);
            format!(": `(..).compose::<{name}>()` makes one value of a tuple's")
        }
        (true, false) => ": give each parameter a domain of its own, in a tuple".to_owned(),
    }
}

/// The probable name of a type in a test.
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
    /// Makes the mismatch a failure, with the function's signature and its place.
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
            Mismatch::Arguments { declared, supplied, who: "the domain draws" }.to_string()
        };
        let swapped = structure("Material", &[f0.clone(), rough.clone()]);
        assert_eq!(
            told(&wgsl, &swapped),
            "takes (Material), the domain draws (Material)\n  \
             member 1 of the function's `Material` is `roughness: f32`, of the other one it is `f0: vec3<f32>`"
        );
        let short = structure("Material", std::slice::from_ref(&rough));
        let part = "member 2 of the function's `Material` is `f0: vec3<f32>`, of the other one it is missing";
        assert!(told(&wgsl, &short).ends_with(part), "{}", told(&wgsl, &short));
        // The message names the inner structure, which has the difference, and not the outer structure.
        let [inside, other] = [&wgsl, &structure("Material", &[rough, ("f0", number.clone())])]
            .map(|material| {
                let pair = Shape::Array { element: Box::new(material.clone()), length: 2 };
                structure("Scene", &[("exposure", number.clone()), ("materials", pair)])
            });
        let part = "member 2 of the function's `Material` is `f0: vec3<f32>`, of the other one it is `f0: f32`";
        assert!(told(&inside, &other).ends_with(part), "{}", told(&inside, &other));
        assert_eq!(told(&number, &colour), "takes (f32), the domain draws (vec3<f32>)");
        let returned = |supplied: &Shape| {
            let (declared, supplied) = (wgsl.clone(), supplied.clone());
            let who = "the reference returns".to_owned();
            Mismatch::Result { declared, supplied, who }.to_string()
        };
        let text = returned(&swapped);
        assert!(
            text.contains("returns Material, the reference returns Material\n  member 1"),
            "{text}"
        );
        let wrong =
            crate::package::Package::from_source("s", "\nfn f(x: f32) -> f32 { return x; }");
        let check = wrong.function("f").over((0.0..=1.0_f32, 0.0..=1.0_f32));
        let failure = check.unrecorded().try_is_finite().expect_err("it takes one");
        let located = crate::run::Fails::location(&failure);
        assert!(located.is_some_and(|place| place.ends_with(":2:1")), "{failure:?}");
        let text = returned(&<(f64, f64) as crate::value::Mirror>::shape());
        assert_eq!(text, "returns Material, the reference returns (f32, f32)");
    }
}
