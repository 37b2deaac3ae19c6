//! The needs of a verb, and the number of a check's cases.

use super::vacuous::{MOST_CASES, Vacuous};
use super::{Failure, Plan};
use crate::domain::{Numbering, Stream};
use crate::probe::{CONSTANTS, Inputs};
use crate::reflect::Function;
use crate::value::Shape;

/// The number of cases if each case needs its own dispatch, unless the check sets a number. A driver needs about
/// 50 µs per dispatch.
const ALONE: u64 = 2048;

/// The needs of one verb.
pub(super) struct Demand {
    /// Types of the arguments that the host supplies.
    pub(super) arguments: Vec<Shape>,
    /// The origin of the arguments, for messages: `the domain draws`.
    pub(super) who: &'static str,
    /// True if the parts of the stream are the function's arguments.
    pub(super) draws_arguments: bool,
    /// The number of cases if the domain isn't enumerated and the check sets no number.
    pub(super) cases: u64,
    /// The largest finite domain whose values are all tried if the check sets no number of cases.
    pub(super) enumerated: u64,
    /// The most calls of the function per case in one dispatch.
    pub(super) calls: usize,
}

/// The cases of a check for a seed, in the number that the check or its verb sets. No cases are an error.
pub(super) fn number(
    plan: &Plan<'_>,
    function: &Function,
    stream: &dyn Stream,
    demand: &Demand,
    seed: u64,
    inputs: Inputs,
) -> Result<Numbering, Failure> {
    let (cases, enumerated) = match plan.cases {
        Some(cases) => (cases, cases),
        None => (demand.cases, demand.enumerated),
    };
    let (cases, enumerated) = match plan.cases {
        None if function.form.alone => (cases.min(ALONE), enumerated.min(ALONE)),
        _ => (cases, enumerated),
    };
    let few = CONSTANTS as u64;
    let (cases, enumerated) = match inputs {
        Inputs::Storage | Inputs::Uniform => (cases, enumerated),
        Inputs::Constant => (cases.min(few), enumerated.min(few)),
    };
    let cases = Numbering::of(stream, seed, cases, enumerated);
    let reason = match stream.emptiness() {
        Some(emptiness) => {
            let parameters = &function.parameters;
            let named = emptiness.part.filter(|_| demand.draws_arguments);
            let argument = named.and_then(|part| Some(parameters.get(part)?.0.clone()));
            Vacuous::Empty { argument, emptiness }
        }
        None if cases.count == 0 => Vacuous::NoCases,
        None if cases.count > MOST_CASES => Vacuous::TooManyCases(cases.count),
        None => return Ok(cases),
    };
    Err(Failure::Domain { function: function.name.clone(), reason: Box::new(reason) })
}
