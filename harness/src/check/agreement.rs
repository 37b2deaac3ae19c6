//! The verb `agrees_with`: compares results with a reference.

use std::sync::atomic::{AtomicBool, Ordering};

use super::allowances::{self, Allowances};
use super::allowed::Allowed;
use super::batch::{Batch, Rows};
use super::demand::Demand;
use super::flush::allowing_flushes;
use super::path_tally::PathTally;
use super::plan::Plan;
use super::session::{Asserted, Expect, Explained, Session};
use super::tolerances::Tolerances;
use super::{Agreement, Calls, Check, Failure, Reference, Vacuous};
use crate::domain::Stream;
use crate::judge::{Judge, Judged, compare, is_within};
use crate::record::{self, Allowance};
use crate::run::or_panic;
use crate::tolerance::{Criterion, SpecTolerance, Tolerance};
use crate::value::{Arguments, Scalar, Shape};

/// A reference, and the type of its results.
pub(super) struct Expected<'e> {
    pub(super) shape: Shape,
    pub(super) expect: Expect<'e>,
}

/// Wraps the reference in an [`Expected`], which has the same type for every reference, and calls `then` with it.
pub(super) fn with_reference<A: Arguments, T>(
    reference: &impl Reference<A>,
    then: impl FnOnce(Expected<'_>) -> T,
) -> T {
    then(Expected {
        shape: reference.shape(),
        expect: &|rows, lanes| {
            // This is a plain loop, because Cargo compiles tests with little optimisation, and because the loop runs
            // for each case.
            let mut row = 0;
            while row < rows.len() {
                reference.expect(&A::load_all(&mut rows.of(row).iter()), lanes);
                row += 1;
            }
        },
    })
}

struct Comparison<'c> {
    scalars: &'c [Scalar],
    /// The expected components of all cases, one case after the other.
    expected: &'c [f64],
    batch: &'c Batch,
    /// The scalar types of the arguments' components. If an argument is subnormal, `expect` computes the
    /// expected result again with 0.
    arguments: &'c [Scalar],
    expect: Expect<'c>,
    tolerance: &'c Tolerance,
    /// The results that WGSL or the adapter allows, if the test asks for `Spec` or `DeviceSpec`.
    allowed: Option<Allowed<'c>>,
    /// `true` after the first conclusive comparison (see `tells`).
    told_apart: &'c AtomicBool,
}

impl<'c> Comparison<'c> {
    fn of(&self, case: usize) -> &'c [f64] {
        &self.expected[case * self.scalars.len()..][..self.scalars.len()]
    }
}

impl Judge for Comparison<'_> {
    fn judge(&self, case: usize, actual: &[u32]) -> Judged {
        let expected = self.of(case);
        if !self.told_apart.load(Ordering::Relaxed) && tells(self.scalars, actual, expected) {
            self.told_apart.store(true, Ordering::Relaxed);
        }
        if let Some(allowed) = &self.allowed {
            return allowed.judge(self.scalars, case, actual, expected);
        }
        let given = compare(self.scalars, actual, expected, self.tolerance);
        allowing_flushes(self.arguments, self.batch.arguments(case), given, |row| {
            let mut expected = Vec::with_capacity(self.scalars.len());
            (self.expect)(Rows::new(row, row.len(), 1), &mut expected);
            // No result passes against a reference that isn't finite.
            compare(self.scalars, actual, &expected, self.tolerance)
        })
    }

    fn is_within(&self, case: usize, actual: &[u32], ratio: f64) -> bool {
        // Until a result has set `told_apart`, `judge` must examine every result.
        self.allowed.is_none()
            && self.told_apart.load(Ordering::Relaxed)
            && is_within(self.scalars, actual, self.of(case), self.tolerance, ratio)
    }
}

/// Checks if the comparison of a result with its reference is conclusive. If result and reference are different
/// subnormal numbers in every component, the comparison is inconclusive, because a driver may flush both to 0.
fn tells(scalars: &[Scalar], actual: &[u32], expected: &[f64]) -> bool {
    scalars.iter().zip(actual).zip(expected).any(|((scalar, word), expected)| {
        let actual = scalar.decode(*word);
        let least = f64::from(f32::MIN_POSITIVE);
        !scalar.is_float() || actual == *expected || !(actual.abs().max(expected.abs()) < least)
    })
}

impl<V: Arguments> Check<'_, Calls<V>> {
    /// Checks that the function agrees with a reference to within a tolerance.
    ///
    /// The reference receives the same `f32` values as the shader, widened to `f64`. WGSL lets drivers flush
    /// subnormal arguments to 0. If a result disagrees and some arguments are subnormal, Karat calls the
    /// reference again with 0 instead of these arguments.
    ///
    /// Instead of a tolerance, [`Spec`](crate::Spec) accepts the results that the WGSL specification allows for
    /// this code, if the allowed interval is narrow enough. [`DeviceSpec`](crate::tolerance::DeviceSpec)
    /// accepts the results that the adapter's measured accuracy allows. [`tolerance_on`](Self::tolerance_on)
    /// sets a tolerance for one path. On that path, the tolerance replaces `Spec` and `DeviceSpec`.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let text = "fn lambert(albedo: f32, cosine: f32) -> f32 { return albedo / 3.14159265 * cosine; }";
    /// let lambert = |albedo: f64, cosine: f64| albedo / std::f64::consts::PI * cosine;
    /// Package::from_source("brdf", text)
    ///     .function("lambert")
    ///     .over((0.0..=1.0, 0.0..=1.0))
    ///     .agrees_with(lambert, Ulp(4.0));
    /// ```
    ///
    /// # Panics
    /// Panics with the [`Failure`] if a case disagrees or nothing could be compared.
    #[track_caller]
    pub fn agrees_with(
        self,
        reference: impl Reference<V>,
        tolerance: impl Into<Criterion>,
    ) -> Agreement {
        or_panic(self.try_agrees_with(reference, tolerance))
    }

    /// Runs [`agrees_with`](Self::agrees_with), but returns the failure instead of panicking.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// # let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
    /// let check = package.function("half").over(0.0..=1.0);
    /// let failure = check.unrecorded().try_agrees_with(|x: f64| x, Ulp(4.0)).unwrap_err();
    /// assert!(failure.to_string().contains("`half` fails agrees_with: 4 ulp"));
    /// ```
    ///
    /// # Errors
    /// Returns the failure if a case disagrees or nothing could be compared.
    pub fn try_agrees_with(
        self,
        reference: impl Reference<V>,
        tolerance: impl Into<Criterion>,
    ) -> Result<Agreement, Failure> {
        let criterion = tolerance.into();
        with_reference(&reference, |expected| {
            self.plan.agrees(&*self.stream, &self.demand(), &expected, &criterion)
        })
    }
}

impl Plan<'_> {
    pub(super) fn agrees(
        &self,
        stream: &dyn Stream,
        demand: &Demand,
        expected: &Expected<'_>,
        criterion: &Criterion,
    ) -> Result<Agreement, Failure> {
        let (general, spec_tolerance) = match criterion {
            Criterion::Within(tolerance) => (tolerance.clone(), None),
            Criterion::Allowed(spec_tolerance) => {
                (spec_tolerance.need.clone(), Some(spec_tolerance))
            }
        };
        let tolerances = self.tolerances(general);
        let explained = Explained::ByBounds;
        let asserted =
            Asserted { explained, ..Asserted::new("agrees_with", criterion.to_string()) };
        self.conclude(&asserted, stream, demand, &mut |session| {
            session.agrees(expected, &tolerances, spec_tolerance)
        })
    }
}

impl Session<'_> {
    pub(super) fn agrees(
        &self,
        expected: &Expected<'_>,
        tolerances: &Tolerances,
        spec_tolerance: Option<&SpecTolerance>,
    ) -> Result<PathTally, Failure> {
        let session = self;
        session.called.expect_result(&expected.shape, "the reference returns")?;
        tolerances.expect_usable(&session.called)?;
        if let Some(otherwise) =
            spec_tolerance.and_then(|spec_tolerance| spec_tolerance.otherwise.as_ref())
        {
            session.called.expect_lanes(otherwise)?;
        }
        // A path's own tolerance replaces the bounds of WGSL on that path.
        let spec_tolerance = spec_tolerance.filter(|_| tolerances.own(&session.called).is_none());
        let witness = spec_tolerance.map(|_| session.witness()).transpose()?;
        let measured = match spec_tolerance.filter(|spec_tolerance| spec_tolerance.measured) {
            Some(_) => Some(session.measured()?),
            None => None,
        };
        let judged = AtomicBool::new(false);
        let (scalars, tolerance) = (session.called.scalars(), tolerances.of(&session.called));
        let arguments = session.called.argument_scalars();
        let told_apart = AtomicBool::new(false);
        // For the record, Karat also computes the largest error that WGSL allows.
        let wanted = spec_tolerance.is_none() && self.recorded && record::wanted();
        let granter = wanted.then(|| session.witness().ok()).flatten();
        let mut allowance: Option<Allowance> = None;
        let mut left = allowances::wanted(&session.called.probed.program);
        let mut tally = session.run(&mut |batch, running| {
            // The device runs the dispatch while the host computes the reference.
            let lanes = session.expected(batch, batch.rows(), expected.expect)?;
            if let Some(granter) = granter.as_ref().filter(|_| left > 0)
                && let Ok(found) = Allowances::of(granter, batch, &mut left)
            {
                let more = found.against(&scalars, &lanes, tolerance);
                allowance = Some(allowance.map_or(more, |allowance| allowance.merge(more)));
            }
            // The bounds from the specification, or from the adapter's measured accuracy.
            let bounds = match (&witness, &measured) {
                (None, _) => Vec::new(),
                (Some(witness), None) => witness.bounds(batch.cases, &batch.lanes())?,
                (Some(witness), Some(accuracy)) => {
                    witness.measured_bounds(batch.cases, &batch.lanes(), accuracy)?
                }
            };
            let comparison = Comparison {
                allowed: spec_tolerance.map(|spec_tolerance| Allowed {
                    spec_tolerance,
                    bounds: &bounds,
                    judged: &judged,
                }),
                scalars: &scalars,
                expected: &lanes,
                batch,
                arguments: &arguments,
                expect: expected.expect,
                tolerance,
                told_apart: &told_apart,
            };
            let expect = |case| Some(comparison.of(case).to_vec());
            session.judge(batch, running, expect, &comparison)
        })?;
        tally.allowed = allowance;
        let tally = session.expect_tested(told_apart.into_inner(), tally, Vacuous::Flushed)?;
        let by_spec = witness.is_some();
        session.expect_tested(!by_spec || judged.into_inner(), tally, Vacuous::Ungranted)
    }
}
