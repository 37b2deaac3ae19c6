//! Common code of verbs that call the function several times for each case, and compare the results.

use super::batch::Batch;
use super::cause::cause;
use super::disagreement::CaseFailure;
use super::path_tally::PathTally;
use super::sample::Sample;
use super::session::Session;
use crate::executor::Results;
use crate::judge::{Judged, Shown, tally};

/// The note beside the function's result in reports of verbs that call the function a second time, with changed
/// arguments. The report marks the changed arguments with a prime.
pub(super) const PRIMED: &str = "returned for the arguments with a prime ('); expected: the result for the arguments without a prime";

/// The parts of a failing case that a report shows.
pub(super) struct Exhibit {
    pub(super) lanes: Vec<u32>,
    /// The names and values of arguments or rotations that the check varied for this case.
    pub(super) varied: Vec<(String, String)>,
    /// The note that says which results the verb compared, if the verb calls the function more than once for each case.
    pub(super) compared: &'static str,
    pub(super) actual: Vec<u32>,
    pub(super) expected: Vec<f64>,
    pub(super) judged: Judged,
}

impl Session<'_> {
    /// Judges each case of a batch. `judge` and `exhibit` receive the case's index in the batch.
    pub(super) fn judge_results(
        &self,
        batch: &Batch,
        results: &Results,
        judge: impl Fn(usize) -> Judged + Sync,
        exhibit: impl Fn(usize) -> Exhibit,
    ) -> PathTally {
        let function = self.called.function();
        let judge = |case: usize, _: &[u32]| judge(case);
        let mut picked = Sample::picked(batch);
        let sum = tally(batch.first, results.view(), &judge, &mut picked);
        let cause = cause(function, batch, &picked.failing, &sum);
        let sample = Sample::of(&self.called.function().parameters, batch, &sum, picked);
        let tally = PathTally::new(&self.called, sum, |shown: Shown| {
            let case = usize::try_from(shown.case - batch.first).expect("in this batch");
            let Exhibit { lanes, varied, compared, actual, expected, judged } = exhibit(case);
            let mut arguments = function.arguments(&lanes);
            arguments.extend(varied);
            let expected = Some(&*expected);
            let remembered = shown.case >= self.count();
            let case = shown.case;
            CaseFailure {
                remembered,
                compared,
                ..CaseFailure::new(function, case, arguments, &actual, expected, &judged)
            }
        });
        tally.with_sample(sample).with_cause(cause)
    }
}
