//! Checks: what a test asserts of a WGSL function.
//!
//! Each verb runs the function over the domain's cases on every selected path and returns an
//! [`Agreement`] that says how much was compared, or panics with a [`Failure`]. The `try_` forms
//! return the failure and leave the verdict to the caller, so the record of the run doesn't hold
//! theirs. A check that compared nothing is an error.

mod argument;
mod companion;
mod disagreement;
mod equivariance;
mod identity;
mod inputs;
mod integral;
mod known_issue;
mod limit;
mod memory;
mod monotone;
mod parallel;
mod property;
mod quadrature;
mod reference;
pub(crate) mod replay;
mod sampling;
mod session;
mod shrink;
mod tally;
mod tolerances;
mod verdict;

pub use argument::Argument;
pub use disagreement::{
    CaseFailure, Disagreement, IntegralFailure, NodeFailure, PathDisagreement, Simplest,
};
pub(crate) use identity::{Identity, test};
pub use integral::Integral;
pub use known_issue::KnownIssue;
pub(crate) use known_issue::KnownIssues;
pub use limit::Limit;
use memory::Memory;
pub use monotone::Direction;
use property::{Exhibit, PRIMED};
pub use quadrature::Directions;
pub use reference::Reference;
pub use replay::NotReplayed;
pub use sampling::{
    ConfigurationRejection, Finding, Fit, PathRejection, Power, Rejection, Samples,
};
use session::{Demand, PathTally, Session};
pub use tally::Census;
use tally::{Class, Judged, compare};
use tolerances::Tolerances;
pub use verdict::{Agreement, Failure};

use crate::domain::Domain;
use crate::fixture::{Fixture, Fixtures};
use crate::output::visible;
use crate::package::Package;
use crate::path::Path;
use crate::probe::Inputs;
use crate::record::{self, PathRecord, Record, Stopwatch, Subject, Verdict};
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
    /// Where arguments come from; none: from a storage buffer.
    inputs: Vec<Inputs>,
}

impl Package {
    /// Selects a function by its path: `module::name`, or `name` in a package of one module.
    pub fn function(&self, path: &str) -> Probe<'_> {
        Probe { package: self, path: path.to_owned(), fixtures: Vec::new(), inputs: Vec::new() }
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
        Check { plan: Plan::new(self, domain) }
    }
}

/// What every check is made of, whatever its verb.
#[derive(Clone, Debug)]
struct Plan<'a, D> {
    probe: Probe<'a>,
    domain: D,
    cases: Option<u64>,
    seed: Option<u64>,
    tolerance_on: Vec<(Path, Tolerance)>,
    known_issues: KnownIssues,
}

impl<'a, D> Plan<'a, D> {
    fn new(probe: Probe<'a>, domain: D) -> Self {
        let (tolerance_on, known_issues) = (Vec::new(), KnownIssues::default());
        Self { probe, domain, cases: None, seed: None, tolerance_on, known_issues }
    }

    /// The same over another domain.
    fn over<E>(&self, domain: E) -> Plan<'a, E> {
        Plan {
            probe: self.probe.clone(),
            domain,
            cases: self.cases,
            seed: self.seed,
            tolerance_on: self.tolerance_on.clone(),
            known_issues: self.known_issues.clone(),
        }
    }

    /// A verb's tolerance with those of single paths.
    fn tolerances(&self, general: Tolerance) -> Tolerances {
        Tolerances { general, on: self.tolerance_on.clone() }
    }
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

    /// Sets another tolerance for one path, whose driver or formats are less exact. The verb's own
    /// tolerance remains that of the others.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # let blue = |_: glam::DVec3| glam::DVec3::Z;
    /// SHADERS
    ///     .function("environment::radiance")
    ///     .with("environment", CubeMap::constant(glam::Vec3::Z))
    ///     .with("environment_sampler", Sampler::Linear)
    ///     .over(UnitVector)
    ///     .tolerance_on(Path::Gl, Rel(4.9e-4)) // filters half floats
    ///     .agrees_with(blue, Ulp(2.0));
    /// ```
    pub fn tolerance_on(mut self, path: Path, tolerance: impl Into<Tolerance>) -> Self {
        self.plan.tolerance_on.push((path, tolerance.into()));
        self
    }

    /// Declares that the check fails on a path, and why: a driver's bug by its number.
    ///
    /// On that path at least one case must fail; if none does, the check fails until the
    /// declaration is removed. Whatever else fails there is declared with it: for lost digits
    /// [`tolerance_on`](Self::tolerance_on) says more. Other paths are judged as ever. `karat test` counts the check as a
    /// known issue, never as one that passes.
    pub fn fails_on(mut self, path: Path, reason: &str) -> Self {
        self.plan.known_issues.declare(path, reason);
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
        let tolerances = self.plan.tolerances(tolerance);
        let assertion = tolerances.general.to_string();
        self.conclude("agrees_with", assertion, recording, |session| {
            session.expect_result(&reference.shape(), "the reference returns", None)?;
            tolerances.expect_usable(session)?;
            let (scalars, tolerances) = (session.scalars(), tolerances.of_runners(session));
            session.run(|batch, dispatches| {
                // The device works on the dispatches meanwhile.
                let expected = batch.expected(session, &reference)?;
                let expect = |_, case: usize| {
                    Some(expected[case * scalars.len()..][..scalars.len()].to_vec())
                };
                session.judge(batch, dispatches, expect, |path, case, actual| {
                    let expected = &expected[case * scalars.len()..][..scalars.len()];
                    compare(&scalars, actual, expected, tolerances[path])
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
        let tolerance_on = self.plan.tolerance_on.clone();
        self.conclude("satisfies", statement.to_owned(), recording, |session| {
            tolerances::expect_none(&tolerance_on, session)?;
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
        let tolerances = self.plan.tolerances(tolerance);
        let assertion = tolerances.general.to_string();
        self.conclude("invariant_under", assertion, recording, |session| {
            tolerances.expect_usable(session)?;
            let (scalars, tolerances) = (session.scalars(), tolerances.of_runners(session));
            let mut changed = false;
            let tallies = session.run(|batch, dispatches| {
                let before = session.read(dispatches)?;
                let transformed = batch.transformed(&transform);
                changed |= transformed.lanes != batch.lanes;
                let lanes = transformed.lanes;
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
                    let words = lanes.len() / batch.values.len();
                    let own = |lanes: &[u32]| lanes[case * words..][..words].to_vec();
                    let (plain, primed) = (own(&batch.lanes), own(&lanes));
                    let function = &session.probed.function;
                    let arguments = disagreement::arguments(function, &plain);
                    let primed = disagreement::arguments(function, &primed).into_iter();
                    let changed = primed.zip(&arguments).filter(|(primed, plain)| primed != *plain);
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
        check: impl Fn(&Session<'_, D>) -> Result<Vec<PathTally>, Failure>,
    ) -> Result<Agreement, Failure> {
        self.plan.conclude(name, assertion, &Self::demand(), recording, check)
    }

    fn demand() -> Demand {
        Demand {
            arguments: D::Value::shapes(),
            who: "the domain draws",
            cases: CASES,
            enumerated: ENUMERATED,
            calls: 1,
        }
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
        check: impl Fn(&Session<'_, D>) -> Result<Vec<PathTally>, Failure>,
    ) -> Result<Agreement, Failure> {
        let stopwatch = Stopwatch::start();
        let function = self.probe.path.clone();
        let identity = Identity::of(&function, name)?;
        let package = self.probe.package.root().display().to_string();
        let seed = self.seed.unwrap_or_else(|| identity.seed(&function, &identity.check));
        let mut subject = Subject::Function {
            package,
            function,
            check: name.to_owned(),
            assertion: assertion.clone(),
            location: String::new(),
            seed,
        };
        let mut paths = Vec::new();
        let mut run = || {
            self.known_issues.expect_reasons(&self.probe.path)?;
            inputs::each(self, &identity, |inputs| {
                let own = |(path, own): &(Path, Tolerance)| format!("; on {path} {own}");
                let own: String = self.tolerance_on.iter().map(own).collect();
                let asserted = (name, format!("{assertion}{own}"));
                let session = Session::open(self, demand, &identity, seed, asserted, inputs)?;
                // What is declared to fail needn't be remembered.
                let remembered = recording == Recording::On && self.known_issues.is_empty();
                let memory = Memory::open(&identity).filter(|_| remembered);
                let session = session.remembering(memory);
                if let Subject::Function { location, .. } = &mut subject {
                    *location = session.probed.function.span.to_string();
                }
                let tallies = check(&session)?;
                let asserted = format!("{assertion}{}", inputs.remark());
                paths.extend(tallies.iter().map(|tally| self.record(tally, &asserted)));
                self.verdict(&session, tallies)
            })
        };
        let result = run();
        if recording == Recording::Off {
            return result;
        }
        let (verdict, message) = match &result {
            Ok(agreement) if agreement.known_issues.is_empty() => (Verdict::Pass, None),
            Ok(_) => (Verdict::KnownIssue, None),
            Err(failure @ (Failure::Disagreement(_) | Failure::UnexpectedPass { .. })) => {
                (Verdict::Fail, Some(failure.to_string()))
            }
            Err(failure) => (Verdict::Error, Some(failure.to_string())),
        };
        let test = identity.test;
        let (schema, overlay) = (record::SCHEMA, record::overlay());
        let time = Some(stopwatch.time());
        record::write(&Record { schema, test, subject, verdict, paths, message, overlay, time });
        result
    }

    /// Judges the paths that are to pass; of those that are declared to fail, wants a failure.
    fn verdict(
        &self,
        session: &Session<'_, D>,
        tallies: Vec<PathTally>,
    ) -> Result<Agreement, Failure> {
        let function = &session.probed.function.path;
        let (judged, known) = self.known_issues.split(tallies);
        let mut agreement = if judged.is_empty() && !known.is_empty() {
            let cases = known.iter().map(|tally| tally.tally.census.cases).min().unwrap_or(0);
            let (function, paths) = (function.clone(), Vec::new());
            Agreement { function, cases, paths, worst: Measure::ZERO, known_issues: Vec::new() }
        } else {
            session.conclude(judged)?
        };
        // One case that is replayed may be one that passes.
        if !session.is_replay() {
            self.known_issues.expect_failures(function, &known)?;
        }
        agreement.known_issues = self.known_issues.seen(&known);
        Ok(agreement)
    }

    fn record(&self, tally: &PathTally, assertion: &str) -> PathRecord {
        let asserted = match tolerances::own(&self.tolerance_on, tally.path) {
            Some(own) => format!("{assertion}; on {} {own}", tally.path),
            None => assertion.to_owned(),
        };
        let known_issue = self.known_issues.on(tally.path).map(str::to_owned);
        PathRecord { known_issue, ..tally.record(&asserted) }
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
        Err(failure) => {
            replay::done();
            panic!("{}", visible(&failure.to_string()))
        }
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
