//! A failing case is reduced to the simplest that still fails on its path.
//!
//! Each round evaluates the simpler values of the case in hand (see [`Domain::shrink`]) with the
//! verb's own judgement, and goes on from the first that fails. Nothing of this happens in a check
//! that passes. The outcome is determined by the case alone, unless the time runs out.

use std::time::{Duration, Instant};

use super::session::{Batch, PathTally, Session};
use super::{CaseFailure, Failure, Simplest};
use crate::domain::Domain;
use crate::probe::{Dispatch, Inputs};
use crate::value::Arguments;

/// Rounds for one case. A component needs one or two, so this is enough for a matrix.
const ROUNDS: usize = 50;

/// Values of the first dispatch of a round, whose first ones fail most often; later dispatches
/// take four times as many as the one before.
const FIRST: usize = 128;

/// Values of one round.
const ROUND: usize = 16_384;

/// Values of one round where the arguments are constants, and 64 of them are a kernel to compile.
const ROUND_OF_CONSTANTS: usize = 192;

/// Time for one case. Only a slow reference needs it; the case is less simple then.
const TIME: Duration = Duration::from_secs(20);

/// Dispatches of one round that may end without a verdict, as a reference that isn't finite does.
const ERRORS: usize = 64;

/// Judges a batch on every path.
pub(super) trait Judge<V>:
    FnMut(&Batch<V>, Vec<Dispatch>) -> Result<Vec<PathTally>, Failure>
{
}

impl<V, F> Judge<V> for F where F: FnMut(&Batch<V>, Vec<Dispatch>) -> Result<Vec<PathTally>, Failure>
{}

impl<D: Domain> Session<'_, D>
where
    D::Value: Arguments,
{
    /// The simplest failing case that is found from `failure`, which failed on this path.
    pub(super) fn simplest(
        &self,
        path: usize,
        failure: &CaseFailure,
        judge: &mut impl Judge<D::Value>,
    ) -> Option<Simplest> {
        let end = Instant::now() + TIME;
        let mut at = self.shrinkable(failure.case)?;
        let mut simplest = Simplest::new(failure.clone(), words(at.value()));
        for _ in 0..ROUNDS {
            let mut candidates = at.simpler();
            candidates.truncate(match self.inputs {
                Inputs::Constant => ROUND_OF_CONSTANTS,
                Inputs::Storage | Inputs::Uniform => ROUND,
            });
            let values: Vec<_> = candidates.iter().map(|simpler| simpler.value().clone()).collect();
            let Some((step, found)) = self.first_failing(path, &values, judge, end) else { break };
            at = candidates.swap_remove(step);
            simplest.steps.push(step);
            simplest.failure = CaseFailure { case: failure.case, remembered: false, ..found };
            simplest.input = words(at.value());
        }
        Some(simplest)
    }

    /// The first value that fails on this path.
    fn first_failing(
        &self,
        path: usize,
        values: &[D::Value],
        judge: &mut impl Judge<D::Value>,
        end: Instant,
    ) -> Option<(usize, CaseFailure)> {
        let (mut from, mut size, mut errors) = (0, FIRST, 0);
        while from < values.len() && Instant::now() < end {
            let to = values.len().min(from + size.min(self.capacity()));
            let batch = Batch::of(0, values[from..to].to_vec());
            let judged = self.dispatch(&batch.lanes_only()).and_then(|d| judge(&batch, d));
            match judged {
                Ok(mut tallies) => {
                    if let Some(found) = tallies.swap_remove(path).first_failure() {
                        let index = usize::try_from(found.case).expect("in this batch");
                        return Some((from + index, found));
                    }
                    from = to;
                    size *= 4;
                }
                // One of them has no verdict, and is left out: it is looked for by halves.
                Err(_) if errors == ERRORS => return None,
                Err(_) => {
                    errors += 1;
                    if to - from == 1 {
                        from = to;
                        size = FIRST;
                    } else {
                        size = (to - from).div_ceil(2);
                    }
                }
            }
        }
        None
    }
}

/// The lanes of all arguments.
pub(super) fn words(arguments: &impl Arguments) -> Vec<u32> {
    let mut lanes = Vec::new();
    arguments.store_all(&mut lanes);
    lanes
}
