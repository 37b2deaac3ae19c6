//! How a function doesn't fit what a check gives it or expects of it.

use super::Failure;
use crate::path::Selector;
use crate::reflect::Function;
use crate::stats::Support;
use crate::tolerance::Tolerance;
use crate::value::Shape;

/// How a function and a check don't fit.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Mismatch {
    /// The function takes other arguments than it is given.
    #[error("takes {}, {who} {}{}", list(declared), list(supplied), mixed_up(declared, supplied))]
    Arguments {
        /// Types of its parameters.
        declared: Vec<Shape>,
        /// Types of what it is given.
        supplied: Vec<Shape>,
        /// Who gives them: `the domain draws`.
        who: &'static str,
    },
    /// The function returns another type than it is compared with.
    #[error("returns {declared}, {who} {supplied}")]
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
    /// A range that holds no number, or every one.
    #[error("is to stay within {least} to {most}: no result, or every one, would")]
    Range {
        /// The lower bound.
        least: f64,
        /// The upper bound.
        most: f64,
    },
    /// A tolerance bounds nothing.
    #[error(
        "has the tolerance {tolerance}, but {bound} isn't a bound: use a finite number of at least 0"
    )]
    Bound {
        /// The tolerance.
        tolerance: Tolerance,
        /// The bound in it.
        bound: f64,
    },
    /// A tolerance is for another number of components.
    #[error("returns {lanes} components, the tolerance is declared for {declared}")]
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
    #[error("has {count} parameters, so there is no argument {place} (the first is 0)")]
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

/// What is meant where a tuple stands for one vector or structure, or the other way round.
fn mixed_up(declared: &[Shape], supplied: &[Shape]) -> &'static str {
    let lanes = |shapes: &[Shape]| shapes.iter().flat_map(Shape::lanes).collect::<Vec<_>>();
    let apart = declared.len() != supplied.len() && lanes(declared) == lanes(supplied);
    match (apart, declared.len() < supplied.len()) {
        (false, _) => "",
        (true, true) => ": `(..).composed::<Vec2>()` makes one value of a tuple's",
        (true, false) => ": give each parameter a domain of its own, in a tuple",
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
