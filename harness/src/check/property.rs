//! What the verbs about properties share: results of several dispatches, judged case by case.

use super::disagreement::{CaseFailure, arguments};
use super::session::{Batch, LanesOnly, PathTally, Session};
use super::tally::{Judged, Shown, tally};
use super::{Failure, Reference};
use crate::domain::Domain;
use crate::probe::Dispatch;
use crate::value::Arguments;

/// What `returned` is of where arguments are primed.
pub(super) const PRIMED: &str = "returned of the primed arguments, expected of the others";

/// A failing case as it is shown.
pub(super) struct Exhibit {
    /// The lanes of all arguments.
    pub(super) lanes: Vec<u32>,
    /// What else was varied: a name, and a value.
    pub(super) varied: Vec<(String, String)>,
    /// Which results are compared, where the function is called more than once.
    pub(super) compared: &'static str,
    /// The result's words.
    pub(super) actual: Vec<u32>,
    pub(super) expected: Vec<f64>,
    pub(super) judged: Judged,
}

/// The results of one dispatch on one path.
pub(super) struct Results {
    words: Vec<u32>,
    stride: usize,
}

impl Results {
    /// The words of one case.
    pub(super) fn of(&self, case: usize) -> &[u32] {
        &self.words[case * self.stride..][..self.stride - 1]
    }
}

impl<D: Domain> Session<'_, D>
where
    D::Value: Arguments,
{
    /// Runs the batch's cases with other lanes, on every path.
    pub(super) fn results(
        &self,
        batch: &Batch<D::Value>,
        lanes: &[u32],
    ) -> Result<Vec<Results>, Failure> {
        let (first, cases) = (batch.first, batch.values.len());
        self.read(self.dispatch(&LanesOnly { first, cases, lanes: lanes.into() })?)
    }

    /// Reads the results of every path.
    pub(super) fn read(&self, dispatches: Vec<Dispatch>) -> Result<Vec<Results>, Failure> {
        let read = self.runners.iter().zip(dispatches).map(|(runner, dispatch)| {
            let stride = runner.stride_out();
            Ok(runner.read(dispatch, |words| Results { words: words.to_vec(), stride })?)
        });
        read.collect()
    }

    /// The reference's lanes of each case with other arguments, given by their lanes.
    pub(super) fn expected_of(
        &self,
        batch: &Batch<D::Value>,
        reference: &impl Reference<D::Value>,
        lanes: &[u32],
    ) -> Result<Vec<f64>, Failure> {
        let words = lanes.len() / batch.values.len().max(1);
        let mut values = Vec::with_capacity(batch.values.len());
        values.extend(lanes.chunks_exact(words).map(|lanes| D::Value::load_all(&mut lanes.iter())));
        Batch { first: batch.first, values, lanes: Vec::new() }.expected(self, reference)
    }

    /// Judges each case on each path, by the path's index and the case's in the batch.
    pub(super) fn judge_results(
        &self,
        batch: &Batch<D::Value>,
        results: &[Results],
        judge: impl Fn(usize, usize) -> Judged + Sync,
        exhibit: impl Fn(usize, usize) -> Exhibit,
    ) -> Vec<PathTally> {
        let function = &self.probed.function;
        let paths = self.runners.iter().zip(results).enumerate();
        let tally = paths.map(|(path, (runner, results))| {
            let sum =
                tally(batch.first, &results.words, results.stride, &|case, _| judge(path, case));
            PathTally::new(runner.device(), sum, |shown: Shown| {
                let case = usize::try_from(shown.case - batch.first).expect("in this batch");
                let Exhibit { lanes, varied, compared, actual, expected, judged } =
                    exhibit(path, case);
                let mut arguments = arguments(function, &lanes);
                arguments.extend(varied);
                let expected = Some(&*expected);
                let remembered = shown.case >= self.count();
                let case = shown.case;
                CaseFailure {
                    remembered,
                    compared,
                    ..CaseFailure::new(function, case, arguments, &actual, expected, &judged)
                }
            })
        });
        tally.collect()
    }

    /// The numbers in the words of a result.
    pub(super) fn decode(&self, words: &[u32]) -> Vec<f64> {
        self.scalars().iter().zip(words).map(|(scalar, word)| scalar.decode(*word)).collect()
    }

    /// An error of the domain, which leaves nothing to be judged.
    pub(super) fn vacuous<T>(&self, reason: String) -> Result<T, Failure> {
        Err(Failure::Domain { function: self.probed.function.path.clone(), reason })
    }
}
