//! Checks: what a test asserts of a WGSL function.
//!
//! Each verb runs the function over the domain's cases on every selected path and returns an
//! [`Agreement`] that says how much was compared, or panics with a [`Failure`]. The `try_` forms
//! return the failure and leave the verdict to the caller, so the record of the run doesn't hold
//! theirs. A check that compared nothing is an error.

mod disagreement;
mod identity;
mod integral;
mod reference;
mod session;
mod tally;
mod verdict;

pub use disagreement::{CaseFailure, Disagreement, IntegralFailure, NodeFailure, PathDisagreement};
pub(crate) use identity::Identity;
pub use integral::Integral;
pub use reference::Reference;
use session::{Demand, PathTally, Session};
pub use tally::Census;
use tally::{Class, Judged, compare};
pub use verdict::{Agreement, Failure};

use crate::domain::Domain;
use crate::fixture::{Fixture, Fixtures};
use crate::package::Package;
use crate::record::{self, Record, Subject, Verdict};
use crate::tolerance::{Measure, Tolerance, Unit};
use crate::value::{Arguments, Scalar, Shareable};

/// Cases of a check unless it says otherwise: one dispatch, and enough draws that each edge of
/// six arguments meets each other edge.
const CASES: u64 = 65_536;

/// Values of a finite domain that are all tried unless a number of cases is asked for.
const ENUMERATED: u64 = 1 << 20;

/// A function of a package, to be checked.
///
/// ```no_run
/// use karat::prelude::*;
///
/// static SHADERS: Package = karat::package!("shaders");
///
/// SHADERS.function("fresnel::schlick_scalar")
///     .over((0.0..=1.0, 0.0..=1.0))
///     .agrees_with(|f0: f64, c: f64| f0 + (1.0 - f0) * (1.0 - c).powi(5), Ulp(4.0));
/// ```
#[derive(Clone, Debug)]
#[must_use = "a probe checks nothing until `.over(...)` and a verb such as `.agrees_with(...)`"]
pub struct Probe<'a> {
    package: &'a Package,
    path: String,
    fixtures: Fixtures,
}

impl Package {
    /// Selects a function by its path: `module::name`, or `name` in a package of one module.
    pub fn function(&self, path: &str) -> Probe<'_> {
        Probe { package: self, path: path.to_owned(), fixtures: Vec::new() }
    }
}

impl<'a> Probe<'a> {
    /// Supplies a texture, sampler or buffer for the resource variable `name`.
    pub fn with(mut self, name: &str, fixture: impl Into<Fixture>) -> Self {
        self.fixtures.push((name.to_owned(), fixture.into()));
        self
    }

    /// Chooses the arguments: one domain for a function of one parameter, a tuple of domains for
    /// up to six.
    pub fn over<D: Domain>(self, domain: D) -> Check<'a, D>
    where
        D::Value: Arguments,
    {
        Check { plan: Plan { probe: self, domain, cases: None, seed: None } }
    }
}

/// What every check is made of, whatever its verb.
#[derive(Clone, Debug)]
struct Plan<'a, D> {
    probe: Probe<'a>,
    domain: D,
    cases: Option<u64>,
    seed: Option<u64>,
}

/// A function with the arguments that it is checked over.
#[derive(Clone, Debug)]
#[must_use = "a check compares nothing until a verb such as `.agrees_with(...)`"]
pub struct Check<'a, D> {
    plan: Plan<'a, D>,
}

impl<D: Domain> Check<'_, D>
where
    D::Value: Arguments,
{
    /// Sets the number of cases. A finite domain of at most that many values is enumerated instead.
    /// Without this, a finite domain of up to 2^20 values is enumerated, and of others 65,536 cases
    /// are drawn.
    pub fn cases(mut self, cases: u64) -> Self {
        self.plan.cases = Some(cases);
        self
    }

    /// Sets the seed, which otherwise derives from the test's name.
    pub fn seed(mut self, seed: u64) -> Self {
        self.plan.seed = Some(seed);
        self
    }

    /// Checks that the function agrees with a reference to within a tolerance.
    ///
    /// The reference receives the very `f32` values that the shader gets, widened to `f64`.
    ///
    /// # Panics
    /// With the [`Failure`], if a case disagrees or nothing could be compared.
    #[track_caller]
    pub fn agrees_with(
        self,
        reference: impl Reference<D::Value>,
        tolerance: impl Into<Tolerance>,
    ) -> Agreement {
        or_panic(self.compare(reference, tolerance.into(), Recording::On))
    }

    /// [`agrees_with`](Self::agrees_with) without the panic.
    ///
    /// # Errors
    /// If a case disagrees or nothing could be compared.
    pub fn try_agrees_with(
        self,
        reference: impl Reference<D::Value>,
        tolerance: impl Into<Tolerance>,
    ) -> Result<Agreement, Failure> {
        self.compare(reference, tolerance.into(), Recording::Off)
    }

    fn compare(
        self,
        reference: impl Reference<D::Value>,
        tolerance: Tolerance,
        recording: Recording,
    ) -> Result<Agreement, Failure> {
        self.conclude("agrees_with", tolerance.to_string(), recording, |session| {
            session.expect_result(&reference.shape(), "the reference returns", Some(&tolerance))?;
            let scalars = session.scalars();
            session.run(|batch, dispatches| {
                // The device works on the dispatches meanwhile.
                let expected = batch.expected(session, &reference)?;
                let expect = |_, case: usize| {
                    Some(expected[case * scalars.len()..][..scalars.len()].to_vec())
                };
                session.judge(batch, dispatches, expect, |_, case, actual| {
                    let expected = &expected[case * scalars.len()..][..scalars.len()];
                    compare(&scalars, actual, expected, &tolerance)
                })
            })
        })
    }

    /// Checks that a statement holds for each case's arguments and result.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// SHADERS.function("fresnel::schlick")
    ///     .over((UnitRgb, 0.0..=1.0))
    ///     .satisfies("lies between f0 and 1", |(f0, _), f: glam::Vec3| {
    ///         f.cmpge(f0).all() && f.cmple(glam::Vec3::ONE).all()
    ///     });
    /// ```
    ///
    /// A result with a component that is NaN or infinite fails, whatever the statement says.
    ///
    /// # Panics
    /// With the [`Failure`], if a case doesn't satisfy it or nothing could be checked.
    #[track_caller]
    pub fn satisfies<R: Shareable>(
        self,
        statement: &str,
        holds: impl Fn(D::Value, R) -> bool + Sync,
    ) -> Agreement {
        or_panic(self.judge(statement, holds, Recording::On))
    }

    /// [`satisfies`](Self::satisfies) without the panic.
    ///
    /// # Errors
    /// If a case doesn't satisfy the statement or nothing could be checked.
    pub fn try_satisfies<R: Shareable>(
        self,
        statement: &str,
        holds: impl Fn(D::Value, R) -> bool + Sync,
    ) -> Result<Agreement, Failure> {
        self.judge(statement, holds, Recording::Off)
    }

    fn judge<R: Shareable>(
        self,
        statement: &str,
        holds: impl Fn(D::Value, R) -> bool + Sync,
        recording: Recording,
    ) -> Result<Agreement, Failure> {
        self.conclude("satisfies", statement.to_owned(), recording, |session| {
            session.expect_result(&R::shape(), "the statement takes", None)?;
            let scalars = session.scalars();
            session.run(|batch, dispatches| {
                let expect = |_, _| None;
                session.judge(batch, dispatches, expect, |_, case, actual| {
                    let mut judged = finite(&scalars, actual);
                    if judged.measure.passes() {
                        let arguments = batch.values[case].clone();
                        let result = R::load(&mut actual.iter());
                        judged.measure = Measure::statement(holds(arguments, result));
                    }
                    judged
                })
            })
        })
    }

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
        self.conclude("invariant_under", tolerance.to_string(), recording, |session| {
            session.expect_lanes(&tolerance)?;
            let scalars = session.scalars();
            let mut changed = false;
            let tallies = session.run(|batch, dispatches| {
                let mut plain = Vec::with_capacity(dispatches.len());
                for (runner, dispatch) in session.runners.iter().zip(dispatches) {
                    plain.push(runner.read(dispatch, <[u32]>::to_vec)?);
                }
                let transformed = batch.transformed(&transform);
                changed |= transformed.lanes != batch.lanes;
                let dispatches = session.dispatch(&transformed)?;
                // What the plain arguments gave is what the transformed ones should.
                let expect = |path: usize, case: usize| -> Vec<f64> {
                    let stride = scalars.len() + 1;
                    let before = &plain[path][case * stride..][..scalars.len()];
                    scalars.iter().zip(before).map(|(s, word)| s.decode(*word)).collect()
                };
                let shown = |path, case| Some(expect(path, case));
                session.judge(batch, dispatches, shown, |path, case, actual| {
                    compare(&scalars, actual, &expect(path, case), &tolerance)
                })
            })?;
            if !changed {
                let function = session.probed.function.path.clone();
                let reason = "has no case that the transformation changes".to_owned();
                return Err(Failure::Domain { function, reason });
            }
            Ok(tallies)
        })
    }

    fn conclude(
        self,
        name: &'static str,
        assertion: String,
        recording: Recording,
        check: impl FnOnce(&Session<'_, D>) -> Result<Vec<PathTally>, Failure>,
    ) -> Result<Agreement, Failure> {
        let demand = Demand {
            arguments: D::Value::shapes(),
            who: "the domain draws",
            cases: CASES,
            enumerated: ENUMERATED,
            calls: 1,
        };
        self.plan.conclude(name, assertion, &demand, recording, check)
    }
}

impl<D: Domain> Plan<'_, D> {
    /// Prepares the session, runs `check` and records its verdict.
    fn conclude(
        &self,
        name: &'static str,
        assertion: String,
        demand: &Demand,
        recording: Recording,
        check: impl FnOnce(&Session<'_, D>) -> Result<Vec<PathTally>, Failure>,
    ) -> Result<Agreement, Failure> {
        let identity = Identity::current();
        let function = self.probe.path.clone();
        let package = self.probe.package.root().display().to_string();
        let seed = self.seed.unwrap_or_else(|| identity.seed(&function, name));
        let mut subject = Subject::Function {
            package,
            function,
            check: name.to_owned(),
            assertion: assertion.clone(),
            location: String::new(),
            seed,
        };
        let mut paths = Vec::new();
        let result = Session::open(self, demand, &identity, seed, (name, assertion));
        let result = result.and_then(|session| {
            if let Subject::Function { location, .. } = &mut subject {
                *location = session.probed.function.span.to_string();
            }
            let tallies = check(&session)?;
            paths = tallies.iter().map(|path| path.record(&session.assertion.1)).collect();
            session.conclude(tallies)
        });
        if recording == Recording::Off {
            return result;
        }
        let (verdict, message) = match &result {
            Ok(_) => (Verdict::Pass, None),
            Err(failure @ Failure::Disagreement(_)) => (Verdict::Fail, Some(failure.to_string())),
            Err(failure) => (Verdict::Error, Some(failure.to_string())),
        };
        let test = identity.test;
        let (schema, overlay) = (record::SCHEMA, record::overlay());
        record::write(&Record { schema, test, subject, verdict, paths, message, overlay });
        result
    }
}

/// Whether a verdict goes into the record of the run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Recording {
    On,
    Off,
}

#[track_caller]
fn or_panic(result: Result<Agreement, Failure>) -> Agreement {
    match result {
        Ok(agreement) => agreement,
        Err(failure) => panic!("{failure}"),
    }
}

/// Fails where a component isn't a finite number.
fn finite(scalars: &[Scalar], actual: &[u32]) -> Judged {
    let bad = scalars
        .iter()
        .zip(actual)
        .position(|(scalar, word)| scalar.is_float() && !f32::from_bits(*word).is_finite());
    let Some(lane) = bad else {
        return Judged { measure: Measure::statement(true), lane: 0, class: Class::Other };
    };
    let nan = f32::from_bits(actual[lane]).is_nan();
    Judged {
        measure: Measure {
            ratio: f64::INFINITY,
            error: f64::NAN,
            bound: 0.0,
            unit: Unit::Statement,
        },
        lane,
        class: if nan { Class::Nan } else { Class::Infinite },
    }
}
