//! Simplifies a failing case on its path, to the simplest case that still fails.
//!
//! Each round judges simpler values of the current case (see `Domain::shrink`) with the verb, and continues with the
//! first failing value. The same failing case always gives the same simplest case, unless the time runs out.

use std::time::{Duration, Instant};

use super::effort::Effort;
use super::path_tally::PathTally;
use super::session::Session;
use super::{CaseFailure, Failure, Simplest};
use crate::domain::Held;
use crate::run::Descent;

/// The largest number of rounds for one case. A component needs one or two rounds, so 50 rounds are enough for
/// a matrix.
const ROUNDS: usize = 50;

/// The time limit for one case. Only checks with slow references reach the limit. If the time runs out, Karat reports
/// the simplest case that it has found so far.
const TIME: Duration = Duration::from_secs(20);

/// The largest number of errors that one round tolerates. For example, a value gives an error instead of a verdict if
/// its reference isn't finite. After more errors, the round ends without a simpler value.
const ERRORS: usize = 64;

pub(super) type JudgeValues<'j> = &'j mut dyn FnMut(&[Held]) -> Result<PathTally, Failure>;

impl Session<'_> {
    /// Simplifies `failure`. Returns the simplest case that still fails, and its value.
    pub(super) fn simplest(
        &self,
        failure: &CaseFailure,
        effort: Effort,
        judge: JudgeValues<'_>,
    ) -> Option<(Simplest, Held)> {
        let end = Instant::now() + TIME;
        let mut source = self.cases.source(failure.case);
        let mut at = self.stream.shrinkable(self.cases.origin(failure.case, &mut source))?;
        let descent = Descent { seed: self.cases.seed, case: failure.case, steps: Vec::new() };
        let mut simplest = Simplest::new(failure.clone(), descent);
        for _ in 0..ROUNDS {
            let mut candidates = at.simpler();
            candidates.truncate(effort.round);
            let values: Vec<_> = candidates.iter().map(|simpler| simpler.value().clone()).collect();
            let Some((step, found)) = first_failing(&values, effort, judge, end) else {
                break;
            };
            at = candidates.swap_remove(step);
            simplest.descent.steps.push(step);
            simplest.failure = CaseFailure { case: failure.case, remembered: false, ..found };
        }
        Some((simplest, at.value().clone()))
    }
}

/// Finds the first failing value. Returns its index in `values`, and its failure. Each call of `judge` judges a part of
/// `values`.
fn first_failing(
    values: &[Held],
    effort: Effort,
    judge: JudgeValues<'_>,
    end: Instant,
) -> Option<(usize, CaseFailure)> {
    let (mut from, mut size, mut errors) = (0, effort.first, 0);
    while from < values.len() && Instant::now() < end {
        let to = values.len().min(from + size.min(effort.most));
        match judge(&values[from..to]) {
            Ok(tally) => {
                if let Some(found) = tally.first {
                    let index = usize::try_from(found.case).expect("among these values");
                    return Some((from + index, found));
                }
                from = to;
                size *= 4;
            }
            // One of the values causes an error. Halving the set of values finds this value, and the loop skips
            // it.
            Err(_) if errors == ERRORS => return None,
            Err(_) => {
                errors += 1;
                if to - from == 1 {
                    from = to;
                    size = effort.first;
                } else {
                    size = (to - from).div_ceil(2);
                }
            }
        }
    }
    None
}
