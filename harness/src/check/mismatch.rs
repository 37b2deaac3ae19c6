//! How a function doesn't fit what a check gives it or expects of it.

use super::Failure;
use crate::output::counted;
use crate::path::Selector;
use crate::reflect::Function;
use crate::stats::Support;
use crate::tolerance::Tolerance;
use crate::value::{Differing, Scalar, Shape};

/// How a function and a check don't fit.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Mismatch {
    /// The function takes other arguments than it is given.
    #[error("takes {}, {who} {}{}", list(declared), list(supplied), hint(declared, supplied))]
    Arguments {
        /// Types of its parameters.
        declared: Vec<Shape>,
        /// Types of what it is given.
        supplied: Vec<Shape>,
        /// Who gives them: `the domain draws`.
        who: &'static str,
    },
    /// The function returns another type than it is compared with.
    #[error("returns {declared}, {who} {supplied}{}", member(supplied.differing(declared, true)))]
    Result {
        /// What it returns.
        declared: Shape,
        /// What it is compared with.
        supplied: Shape,
        /// Whose type that is: `the reference returns`.
        who: String,
    },
    /// The function returns a type that the verb can't use.
    #[error("returns {result}, {wanted}")]
    Unsuited {
        /// What it returns.
        result: Shape,
        /// What the verb wants: `not up to three floats`.
        wanted: &'static str,
    },
    /// The function is its own reference.
    #[error(
        "is compared with itself, so a mistake in it can't be seen: name another function, or take `Spec`, \
         which asks whether a driver computes what WGSL allows"
    )]
    Itself,
    /// A range that holds no number, or every one.
    #[error("is to have a result that {0}: no result, or every one, does")]
    Range(String),
    /// No kind of hazard is asked for, or one that no operation of a function has.
    #[error("is asked for {0}: name kinds that an operation inside of it may have, such as `Nan`")]
    Hazard(String),
    /// A hazard is accepted that no case has, or without a reason.
    #[error("accepts the hazard of `{0}`, which {1}")]
    Accepted(String, &'static str),
    /// A tolerance bounds nothing.
    #[error(
        "has the tolerance {tolerance}, but {bound:e} isn't a bound: use a number of at least 0 that an \
         error can exceed"
    )]
    Bound {
        /// The tolerance.
        tolerance: Tolerance,
        /// The bound in it.
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
    /// A path has a tolerance of its own, but the verb takes none.
    #[error("is checked by {check}, which takes no tolerance: remove {tolerance} for {on}")]
    NoTolerance {
        /// The verb.
        check: &'static str,
        /// The paths.
        on: Selector,
        /// Their tolerance.
        tolerance: Tolerance,
    },
    /// There is no parameter of this name.
    #[error("has no parameter `{name}`{}",
        nearest.as_ref().map_or_else(String::new, |name| format!("; did you mean `{name}`?")))]
    NoParameter {
        /// What was asked for.
        name: String,
        /// The closest parameter.
        nearest: Option<String>,
    },
    /// There is no parameter at this place.
    #[error("has {}, so there is no argument {place} (the first is 0)",
        counted(*count, "parameter"))]
    NoPlace {
        /// Parameters of the function.
        count: usize,
        /// The place, from 0.
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
    /// A result is to be perpendicular to a parameter of another type.
    #[error(
        "returns {result}, and has `{name}` of type {shape}: two vectors of one type can be perpendicular"
    )]
    NoDirection {
        /// The parameter.
        name: String,
        /// Its type.
        shape: Shape,
        /// The type of its result.
        result: Shape,
    },
    /// A parameter that is to go to a limit isn't a float.
    #[error("has `{0}`, which isn't f32: only an f32 can approach a limit")]
    NoFloat(String),
    /// A limit that can't be approached.
    #[error("is asked for its limit at {limit}, which {reason}")]
    Limit {
        /// The limit with its steps.
        limit: String,
        /// Why not.
        reason: String,
    },
    /// A function that runs beside a sampler, such as its density, has an executor of its own.
    #[error("runs where the sampler runs: call `.on(..)` on the sampler only")]
    Executor,
    /// The random numbers are of a type that Karat can't draw.
    #[error("is sampled with {0}, but random numbers are f32 or u32")]
    Random(Shape),
    /// The verb needs directions, and the support has other points.
    #[error("can't be estimated on {0}: this check needs directions")]
    NoDirections(Support),
    /// A density's points are of another type than those of the support.
    #[error("is given points of type {given}, but the points of {support} are {point}")]
    Point {
        /// What the density is given.
        given: Shape,
        /// The support.
        support: Support,
        /// The type of its points.
        point: Shape,
    },
}

/// What differs in arguments whose types may have the same names, or what was perhaps meant.
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

/// What is meant where a tuple stands for one vector or structure, or the other way round.
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

/// What a type is probably called in a test.
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
    /// The failure of a function's signature, with its place.
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
    fn a_tuple_for_one_value_is_told_what_it_may_become() {
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
        // The structure inside has the difference, not the one around it.
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
