//! The verb `at_limit`: checks that results approach a limit as one argument approaches a number.

use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};

use super::agreement::{Expected, with_reference};
use super::batch::Rows;
use super::demand::Demand;
use super::flush::allowing_flushes;
use super::parameter::Parameter;
use super::plan::Plan;
use super::property::Exhibit;
use super::session::Asserted;
use super::{Agreement, Calls, Check, Failure, Mismatch, Reference, Vacuous};
use crate::domain::Stream;
use crate::judge::{Judged, compare};
use crate::run::or_panic;
use crate::tolerance::Tolerance;
use crate::value::{Arguments, Scalar};

/// A target number, and the steps: values of an argument that approach the target.
///
/// ```
/// use karat::Limit;
///
/// let mirror = Limit::toward(0.0, [1e-1, 1e-2, 1e-3, 1e-4]);
/// assert_eq!(mirror.to_string(), "0 through 0.1, 0.01, 0.001, 0.0001");
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Limit {
    target: f32,
    steps: Vec<f32>,
}

impl Limit {
    /// A limit at `target` with at least two steps. Each step must be nearer to the target than the step
    /// before. Karat doesn't call the function at the target.
    ///
    /// ```
    /// use karat::Limit;
    ///
    /// let grazing = Limit::toward(0.0, [0.1, 0.01, 0.001]); // a cosine
    /// # let _ = grazing;
    /// ```
    pub fn toward(target: f32, steps: impl Into<Vec<f32>>) -> Self {
        Self { target, steps: steps.into() }
    }

    /// Describes why the steps don't approach the target. `None` if the steps approach the target.
    fn unusable(&self) -> Option<&'static str> {
        let distance = |step: &f32| (f64::from(*step) - f64::from(self.target)).abs();
        let falls = self.steps.windows(2).all(|pair| distance(&pair[1]) < distance(&pair[0]));
        if self.steps.len() < 2 {
            Some("needs two steps or more")
        } else if !falls || !self.steps.iter().chain([&self.target]).all(|step| step.is_finite()) {
            Some("needs finite steps, each nearer to the target than the step before")
        } else {
            None
        }
    }
}

impl fmt::Display for Limit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.steps.is_empty() {
            return write!(f, "{} through no steps", self.target);
        }
        write!(f, "{} through ", self.target)?;
        for (index, step) in self.steps.iter().enumerate() {
            write!(f, "{}{step}", if index > 0 { ", " } else { "" })?;
        }
        Ok(())
    }
}

impl<V: Arguments> Check<'_, Calls<V>> {
    /// Checks that the result approaches a reference as one argument approaches a limit.
    ///
    /// For each case, Karat calls the function once for each step of the limit: the step replaces the argument, and the
    /// case's other arguments stay the same. The error against the reference must fall at each step until it is within
    /// the tolerance. After that, the error must stay within the tolerance. At the last step the error must be within
    /// the tolerance. The reference receives the limit's target as the value of the argument. Karat ignores the
    /// domain's values for the argument, so use `Just(0.0)` as its domain.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// let unmasked = |_: f64, _: f64| 1.0;
    /// SHADERS
    ///     .function("geometry::smith_g1")
    ///     .over((Just(0.0), 0.1..=1.0)) // at grazing angles a rough surface is opaque
    ///     .at_limit("alpha", Limit::toward(0.0, [1e-1, 1e-2, 1e-3]), unmasked, Abs(1e-4));
    /// ```
    ///
    /// # Panics
    /// Panics with the [`Failure`] if a case's error rises or is too large at the last step, if all cases are within
    /// the tolerance at every step, or if nothing could be compared.
    #[track_caller]
    pub fn at_limit(
        self,
        argument: impl Into<Parameter>,
        limit: Limit,
        reference: impl Reference<V>,
        tolerance: impl Into<Tolerance>,
    ) -> Agreement {
        or_panic(self.try_at_limit(argument, limit, reference, tolerance))
    }

    /// Runs [`at_limit`](Self::at_limit), but returns the failure instead of panicking.
    ///
    /// # Errors
    /// Returns the failure if a case's error rises or is too large at the last step, if all cases are within the
    /// tolerance at every step, or if nothing could be compared.
    pub fn try_at_limit(
        self,
        argument: impl Into<Parameter>,
        limit: Limit,
        reference: impl Reference<V>,
        tolerance: impl Into<Tolerance>,
    ) -> Result<Agreement, Failure> {
        let approach = (&argument.into(), &limit);
        with_reference(&reference, |expected| {
            let (stream, demand) = (&*self.stream, &self.demand());
            self.plan.has_limit(stream, demand, approach, &expected, tolerance.into())
        })
    }
}

impl Plan<'_> {
    pub(super) fn has_limit(
        &self,
        stream: &dyn Stream,
        demand: &Demand,
        (argument, limit): (&Parameter, &Limit),
        expected: &Expected<'_>,
        tolerance: Tolerance,
    ) -> Result<Agreement, Failure> {
        let tolerances = self.tolerances(tolerance);
        let text = format!("{argument} toward {limit}: {}", tolerances.general);
        let asserted = Asserted::new("at_limit", text);
        self.conclude(&asserted, stream, demand, &mut |session| {
            let called = &session.called;
            let function = called.function();
            called.expect_result(&expected.shape, "the reference returns")?;
            tolerances.expect_usable(&session.called)?;
            let (scalars, tolerance) = (called.scalars(), tolerances.of(called));
            let arguments = called.argument_scalars();
            let varied = argument.scalar(function)?;
            if !matches!(varied.scalar, Scalar::F32) {
                return Err(Mismatch::NoFloat(varied.name).of(function));
            }
            if let Some(reason) = limit.unusable() {
                let (limit, reason) = (limit.to_string(), reason.into());
                return Err(Mismatch::Limit { limit, reason }.of(function));
            }
            let approaches = AtomicBool::new(false);
            let tally = session.run(&mut |batch, running| {
                running.read()?; // results for the domain's own values of the argument
                let at = |step: f32| {
                    let mut lanes = batch.lanes().into_owned();
                    for lanes in lanes.chunks_exact_mut(called.words) {
                        lanes[varied.lane] = step.to_bits();
                    }
                    lanes
                };
                let target = at(limit.target);
                let rows = batch.with_lanes(&target);
                let lanes = session.expected(batch, rows, expected.expect)?;
                let given = |case: usize| &lanes[case * scalars.len()..][..scalars.len()];
                let results = limit.steps.iter().map(|step| session.results(batch, &at(*step)));
                let results = results.collect::<Result<Vec<_>, _>>()?;
                // Returns the step that decides if the case passes, and the judgement of this step.
                let decisive = |case: usize, expected: &[f64]| -> (usize, Judged) {
                    let judged = |step: usize| {
                        compare(&scalars, results[step].of(case), expected, tolerance)
                    };
                    let mut before = judged(0);
                    for step in 1..limit.steps.len() {
                        let now = judged(step);
                        // If both errors are infinite, the error doesn't fall, because neither ratio is smaller.
                        let falls = now.measure.ratio < before.measure.ratio;
                        if !now.measure.passes() && !falls {
                            return (step, now);
                        }
                        before = now;
                    }
                    (limit.steps.len() - 1, before)
                };
                let exhibit = |case: usize| {
                    let (step, judged) = decisive(case, given(case));
                    let mut lanes = batch.arguments(case).to_vec();
                    lanes[varied.lane] = limit.steps[step].to_bits();
                    let actual = results[step].of(case).to_vec();
                    let expected = given(case).to_vec();
                    Exhibit { lanes, varied: Vec::new(), compared: "", actual, expected, judged }
                };
                let last = &results[results.len() - 1];
                let judge = |case: usize| {
                    let near = compare(&scalars, results[0].of(case), given(case), tolerance);
                    if !near.measure.passes() {
                        approaches.store(true, Ordering::Relaxed);
                    }
                    let judged = decisive(case, given(case)).1;
                    allowing_flushes(&arguments, rows.of(case), judged, |row| {
                        let mut flushed = Vec::with_capacity(scalars.len());
                        (expected.expect)(Rows::new(row, row.len(), 1), &mut flushed);
                        decisive(case, &flushed).1
                    })
                };
                Ok(session.judge_results(batch, last, judge, exhibit))
            })?;
            let otherwise = Vacuous::AtLimit { argument: argument.clone(), step: limit.steps[0] };
            session.expect_tested(approaches.into_inner(), tally, otherwise)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_that_lead_nowhere_are_refused() {
        assert_eq!(Limit::toward(0.0, [1.0, 0.1]).unusable(), None);
        assert_eq!(Limit::toward(1.0, [2.0, 0.5]).unusable(), None, "from either side");
        for steps in [&[][..], &[0.1], &[0.1, 0.1], &[0.1, 0.2], &[f32::NAN, 0.1], &[0.1, f32::NAN]]
        {
            assert!(Limit::toward(0.0, steps).unusable().is_some(), "{steps:?}");
        }
        assert!(Limit::toward(f32::NAN, [0.2, 0.1]).unusable().is_some());
        assert!(Limit::toward(f32::INFINITY, [1.0, 2.0]).unusable().is_some());
    }
}
