//! Results that stay the same when the arguments are transformed.

use super::called::Running;
use super::demand::Demand;
use super::disagreement::arguments;
use super::plan::{Plan, Recording};
use super::property::{Exhibit, PRIMED};
use super::session::Asserted;
use super::tally::compare;
use super::{Agreement, Check, Failure, Vacuous};
use crate::domain::{Domain, Stream};
use crate::run::or_panic;
use crate::tolerance::Tolerance;
use crate::value::Arguments;

/// Appends the words of transformed arguments.
type Transform<'t> = &'t (dyn Fn(&[u32], &mut Vec<u32>) + Sync);

impl<D: Domain> Check<'_, D>
where
    D::Value: Arguments,
{
    /// Checks that the function returns the same, to within a tolerance, when its arguments are
    /// transformed: reciprocity, symmetry, rotation.
    ///
    /// # Panics
    /// With the [`Failure`], if a case differs or nothing could be compared.
    #[track_caller]
    pub fn invariant_under(
        self,
        transform: impl Fn(D::Value) -> D::Value + Sync,
        tolerance: impl Into<Tolerance>,
    ) -> Agreement {
        or_panic(self.transform(transform, tolerance.into(), Recording::On))
    }

    /// [`invariant_under`](Self::invariant_under) without the panic.
    ///
    /// # Errors
    /// If a case differs or nothing could be compared.
    pub fn try_invariant_under(
        self,
        transform: impl Fn(D::Value) -> D::Value + Sync,
        tolerance: impl Into<Tolerance>,
    ) -> Result<Agreement, Failure> {
        self.transform(transform, tolerance.into(), Recording::Off)
    }

    fn transform(
        self,
        transform: impl Fn(D::Value) -> D::Value + Sync,
        tolerance: Tolerance,
        recording: Recording,
    ) -> Result<Agreement, Failure> {
        let transform = |row: &[u32], lanes: &mut Vec<u32>| {
            transform(D::Value::load_all(&mut row.iter())).store_all(lanes);
        };
        self.plan.is_invariant(&self.stream(), &Self::demand(), &transform, tolerance, recording)
    }
}

impl Plan<'_> {
    pub(super) fn is_invariant(
        &self,
        stream: &dyn Stream,
        demand: &Demand,
        transform: Transform<'_>,
        tolerance: Tolerance,
        recording: Recording,
    ) -> Result<Agreement, Failure> {
        let tolerances = self.tolerances(tolerance);
        let asserted = Asserted::new("invariant_under", tolerances.general.to_string());
        self.conclude(&asserted, stream, demand, recording, &mut |session| {
            tolerances.expect_usable(&session.called)?;
            let called = &session.called;
            let (scalars, tolerances) = (called.scalars(), tolerances.of_paths(&session.called));
            let mut changed = false;
            let tallies = session.run(&mut |batch, dispatches| {
                let before = Running::read_all(dispatches)?;
                let mut lanes = Vec::with_capacity(batch.cases * called.words);
                batch.rows().iter().for_each(|row| transform(row, &mut lanes));
                changed |= *lanes != *batch.lanes();
                let after = session.results(batch, &lanes)?;
                // What the plain arguments gave is what the transformed ones should.
                let expected = |path: usize, case: usize| -> Vec<f64> {
                    let before = before[path].of(case);
                    scalars.iter().zip(before).map(|(s, word)| s.decode(*word)).collect()
                };
                let judge = |path: usize, case: usize| {
                    let actual = after[path].of(case);
                    compare(&scalars, actual, &expected(path, case), tolerances[path])
                };
                let exhibit = |path: usize, case: usize| {
                    let plain = batch.arguments(case).to_vec();
                    let primed = batch.with_lanes(&lanes).of(case);
                    let own = arguments(called.function(), &plain);
                    let primed = arguments(called.function(), primed).into_iter();
                    let changed = primed.zip(&own).filter(|(primed, plain)| primed != *plain);
                    Exhibit {
                        varied: changed.map(|((name, v), _)| (format!("{name}'"), v)).collect(),
                        lanes: plain,
                        compared: PRIMED,
                        actual: after[path].of(case).to_vec(),
                        expected: expected(path, case),
                        judged: judge(path, case),
                    }
                };
                Ok(session.judge_results(batch, &after, judge, exhibit))
            })?;
            session.expect_tested(changed, tallies, Vacuous::Untransformed)
        })
    }
}
