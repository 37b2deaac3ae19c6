//! The arguments and cases that a verb needs, and the number of a check's cases.

use super::vacuous::{MOST_CASES, Vacuous};
use super::{Failure, Plan};
use crate::domain::{Numbering, Stream};
use crate::probe::{CONSTANTS, Inputs};
use crate::reflect::Function;
use crate::value::Shape;

/// The default number of cases if each case needs its own dispatch. A driver needs about 50 µs per dispatch.
const ALONE: u64 = 2048;

pub(super) struct Demand {
    pub(super) arguments: Vec<Shape>,
    /// The words in messages that say who supplies the arguments: `the domain supplies`.
    pub(super) who: &'static str,
    /// `true` if each part of the domain supplies one argument, so that an error can name this argument.
    pub(super) draws_arguments: bool,
    /// The number of sampled cases, if the check sets no number.
    pub(super) cases: u64,
    /// The largest size of a finite domain for which Karat tries every value, if the check sets no number of
    /// cases.
    pub(super) enumerated: u64,
    /// The largest number of calls that one case makes in one dispatch.
    pub(super) calls: usize,
}

/// Determines the cases of a check, and gives each case an index. If the check sets no number of cases, the verb's
/// default in `demand` applies. Returns an error if there are no cases, or too many.
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
