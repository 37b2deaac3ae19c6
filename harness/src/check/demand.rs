//! What a verb asks for, and how many cases a check gets.

use super::vacuous::{MOST_CASES, Vacuous};
use super::{Failure, Plan};
use crate::domain::{Numbering, Stream};
use crate::probe::{CONSTANTS, Inputs};
use crate::reflect::Function;
use crate::value::Shape;

/// Cases that have a dispatch each, unless the check says otherwise: a driver takes some 50 us for one.
const ALONE: u64 = 2048;

/// What one verb asks of a session.
pub(super) struct Demand {
    /// Types of the arguments that the host supplies.
    pub(super) arguments: Vec<Shape>,
    /// Who supplies them: `the domain draws`.
    pub(super) who: &'static str,
    /// Whether the parts of the stream are the function's arguments.
    pub(super) draws_arguments: bool,
    /// Cases of a domain that isn't enumerated, unless the check says otherwise.
    pub(super) cases: u64,
    /// Values of a finite domain that are all tried unless a number of cases is asked for.
    pub(super) enumerated: u64,
    /// Calls of the function that a case makes in one dispatch, at most.
    pub(super) calls: usize,
}

/// The cases of a check under a seed, as many as its author and its verb want. None is an error.
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
