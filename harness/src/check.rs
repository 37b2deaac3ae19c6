//! Checks: what a test asserts of a WGSL function.
//!
//! Each verb runs the function over the domain's cases on every selected path and returns an
//! [`Agreement`] that says how much was compared, or panics with a [`Failure`]. The `try_` forms
//! return the failure and leave the verdict to the caller, so the record of the run doesn't hold
//! theirs. A check that compared nothing is an error.

mod disagreement;
mod identity;
mod reference;
mod tally;

use std::fmt;

use rayon::prelude::*;

pub use disagreement::{CaseFailure, Disagreement, PathDisagreement};
pub(crate) use identity::Identity;
pub use reference::Reference;
pub use tally::Census;
use tally::{Class, Judged, Shown, Tally, compare, tally};

use crate::domain::{Cases, Domain};
use crate::fixture::{Fixture, Fixtures};
use crate::package::Package;
use crate::path::{self, Adapter, Path};
use crate::probe::{self, BATCH, Dispatch, ProbeError, Probed, Runner};
use crate::record::{self, PathRecord, Record, Subject, Verdict};
use crate::reflect::Function;
use crate::tolerance::{Measure, Tolerance, Unit};
use crate::value::{Arguments, Scalar, Shape, Shareable};

/// Cases of a check unless it says otherwise: one dispatch, and enough draws that each edge of
/// six arguments meets each other edge.
const CASES: u64 = 65_536;

/// Cases that one task draws or computes the reference of.
const TASK: usize = 2048;

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
        Check { probe: self, domain, cases: CASES, seed: None }
    }
}

/// A function with the arguments that it is checked over.
#[derive(Clone, Debug)]
#[must_use = "a check compares nothing until a verb such as `.agrees_with(...)`"]
pub struct Check<'a, D> {
    probe: Probe<'a>,
    domain: D,
    cases: u64,
    seed: Option<u64>,
}

/// What a check compared, and how close it came.
#[derive(Clone, Debug)]
pub struct Agreement {
    /// The function.
    pub function: String,
    /// Cases compared on each path.
    pub cases: u64,
    /// Each path with its worst error.
    pub paths: Vec<(Adapter, Measure)>,
    /// The worst error of all paths.
    pub worst: Measure,
}

/// Why a check didn't agree.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Failure {
    /// Values differ by more than is allowed.
    #[error("{0}")]
    Disagreement(Box<Disagreement>),
    /// The function gave no results.
    #[error(transparent)]
    Probe(#[from] ProbeError),
    /// Domain, reference and function don't fit together.
    #[error("`{function}` {mismatch}\n  {signature}\n  at {location}")]
    Signature {
        /// The function's path.
        function: String,
        /// What differs.
        mismatch: String,
        /// The function's signature in WGSL.
        signature: String,
        /// Where it is declared.
        location: String,
    },
    /// The domain draws nothing.
    #[error("the domain of `{function}` {reason}")]
    Domain {
        /// The function's path.
        function: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The reference is not a number.
    #[error(
        "the reference of `{function}` returned {value} at {place} for case {case}: {arguments}; \
         a reference is finite on the whole domain, so restrict the domain or mend the reference"
    )]
    Reference {
        /// The function's path.
        function: String,
        /// What it returned.
        value: f64,
        /// The component.
        place: String,
        /// The case.
        case: u64,
        /// Its arguments.
        arguments: String,
    },
}

impl From<path::PathError> for Failure {
    fn from(error: path::PathError) -> Self {
        Self::Probe(ProbeError::Path(error))
    }
}

impl fmt::Display for Agreement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {} cases agree", self.function, self.cases)?;
        for (adapter, worst) in &self.paths {
            write!(f, "; {} worst {worst}", adapter.path)?;
        }
        Ok(())
    }
}

impl<D: Domain> Check<'_, D>
where
    D::Value: Arguments,
{
    /// Sets the number of cases (default 65,536). A finite domain of at most that many values is
    /// enumerated instead.
    pub fn cases(mut self, cases: u64) -> Self {
        self.cases = cases;
        self
    }

    /// Sets the seed, which otherwise derives from the test's name.
    pub fn seed(mut self, seed: u64) -> Self {
        self.seed = Some(seed);
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
            session.run(|batch, dispatches| {
                let mut plain = Vec::with_capacity(dispatches.len());
                for (runner, dispatch) in session.runners.iter().zip(dispatches) {
                    plain.push(runner.read(dispatch, <[u32]>::to_vec)?);
                }
                let transformed = batch.transformed(&transform);
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
            })
        })
    }

    /// Prepares the session, runs `check` and records its verdict.
    fn conclude(
        self,
        name: &'static str,
        assertion: String,
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
        let result = Session::open(&self, &identity, seed, (name, assertion)).and_then(|session| {
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
        record::write(&Record { schema: record::SCHEMA, test, subject, verdict, paths, message });
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

/// A check in progress.
struct Session<'a, D: Domain> {
    probed: Probed,
    runners: Vec<Runner>,
    cases: Cases<'a, D>,
    identity: &'a Identity,
    seed: u64,
    /// The verb and what it asserts.
    assertion: (&'static str, String),
}

/// The cases of one dispatch.
struct Batch<V> {
    first: u64,
    values: Vec<V>,
    lanes: Vec<u32>,
}

/// One path's sum, and what is needed to show its failures.
struct PathTally {
    adapter: Adapter,
    path: Path,
    tally: Tally,
    worst: Option<CaseFailure>,
    first: Option<CaseFailure>,
}

impl PathTally {
    fn record(&self, asserted: &str) -> PathRecord {
        let worst = self.tally.worst.map(|worst| worst.judged.measure);
        PathRecord {
            adapter: self.adapter.clone(),
            cases: self.tally.census.cases,
            failures: self.tally.census.failures,
            worst: worst.map_or_else(String::new, |measure| measure.to_string()),
            ratio: worst.map(|measure| measure.ratio).filter(|ratio| ratio.is_finite()),
            asserted: asserted.to_owned(),
        }
    }
}

impl<'a, D: Domain> Session<'a, D>
where
    D::Value: Arguments,
{
    fn open(
        check: &'a Check<'_, D>,
        identity: &'a Identity,
        seed: u64,
        assertion: (&'static str, String),
    ) -> Result<Self, Failure> {
        let probed = Probed::new(check.probe.package, &check.probe.path)?;
        let function = &probed.function;
        let supplied = D::Value::shapes();
        let declared = probe::parameter_shapes(function);
        let list = |shapes: &[&Shape]| {
            let names: Vec<String> = shapes.iter().map(ToString::to_string).collect();
            format!("({})", names.join(", "))
        };
        let fits = supplied.len() == declared.len()
            && supplied.iter().zip(&declared).all(|(host, wgsl)| host.stands_for(wgsl, false));
        if !fits {
            let supplied: Vec<&Shape> = supplied.iter().collect();
            let mismatch =
                format!("takes {}, the domain draws {}", list(&declared), list(&supplied));
            return Err(signature(function, mismatch));
        }
        let cases = Cases::new(&check.domain, seed, check.cases);
        if cases.count() == 0 {
            let reason = "has no value, so nothing would be checked".to_owned();
            return Err(Failure::Domain { function: function.path.clone(), reason });
        }
        let capacity = usize::try_from(cases.count()).unwrap_or(BATCH).min(BATCH);
        let runners = path::selected()?
            .into_iter()
            .map(|device| Runner::new(device, &probed, &check.probe.fixtures, capacity))
            .collect::<Result<_, _>>()?;
        Ok(Self { probed, runners, cases, identity, seed, assertion })
    }

    fn scalars(&self) -> Vec<Scalar> {
        self.probed.function.result.lanes()
    }

    fn expect_result(
        &self,
        host: &Shape,
        who: &str,
        tolerance: Option<&Tolerance>,
    ) -> Result<(), Failure> {
        let function = &self.probed.function;
        if !host.stands_for(&function.result, true) {
            let mismatch = format!("returns {}, {who} {host}", function.result);
            return Err(signature(function, mismatch));
        }
        tolerance.map_or(Ok(()), |tolerance| self.expect_lanes(tolerance))
    }

    fn expect_lanes(&self, tolerance: &Tolerance) -> Result<(), Failure> {
        let lanes = self.scalars().len();
        match tolerance.lanes() {
            Some(declared) if declared != lanes => {
                let mismatch =
                    format!("returns {lanes} components, the tolerance is declared for {declared}");
                Err(signature(&self.probed.function, mismatch))
            }
            _ => Ok(()),
        }
    }

    /// Draws batch after batch, dispatches it on every path and hands it to `judge`.
    fn run(
        &self,
        mut judge: impl FnMut(&Batch<D::Value>, Vec<Dispatch>) -> Result<Vec<PathTally>, Failure>,
    ) -> Result<Vec<PathTally>, Failure> {
        let (start, end) = match self.identity.case {
            Some(case) if case < self.cases.count() => (case, case + 1),
            Some(case) => {
                let count = self.cases.count();
                let reason = format!("has {count} cases, none with index {case} (KARAT_CASE)");
                let function = self.probed.function.path.clone();
                return Err(Failure::Domain { function, reason });
            }
            None => (0, self.cases.count()),
        };
        let capacity = self.runners.iter().map(Runner::capacity).min().unwrap_or(BATCH);
        let mut sums: Vec<PathTally> = Vec::new();
        let mut first = start;
        while first < end {
            let size = (end - first).min(capacity as u64);
            let batch = self.draw(first, size)?;
            let dispatches = self.dispatch(&batch.lanes_only())?;
            let tallies = judge(&batch, dispatches)?;
            if sums.is_empty() {
                sums = tallies;
            } else {
                sums = sums.into_iter().zip(tallies).map(|(a, b)| a.merge(b)).collect();
            }
            first += size;
        }
        Ok(sums)
    }

    fn draw(&self, first: u64, size: u64) -> Result<Batch<D::Value>, Failure> {
        let size = usize::try_from(size).expect("a batch fits in memory");
        let parts: Option<Vec<(Vec<_>, Vec<_>)>> = (0..size.div_ceil(TASK))
            .into_par_iter()
            .map(|task| {
                let mut values = Vec::with_capacity(TASK);
                let mut lanes = Vec::new();
                for index in task * TASK..size.min((task + 1) * TASK) {
                    let value = self.cases.get(first + index as u64)?;
                    value.store_all(&mut lanes);
                    values.push(value);
                }
                Some((values, lanes))
            })
            .collect();
        let parts = parts.ok_or_else(|| Failure::Domain {
            function: self.probed.function.path.clone(),
            reason: "rejects nearly everything that its filter sees: build the values with `map` \
                     instead"
                .to_owned(),
        })?;
        let (values, lanes): (Vec<_>, Vec<_>) = parts.into_iter().unzip();
        let values = values.into_iter().flatten().collect();
        Ok(Batch { first, values, lanes: lanes.concat() })
    }

    fn dispatch(&self, batch: &LanesOnly<'_>) -> Result<Vec<Dispatch>, Failure> {
        let dispatches = self.runners.iter().map(|runner| {
            let canary = probe::canary(self.seed, batch.first);
            runner.dispatch(batch.cases, &batch.lanes, canary)
        });
        Ok(dispatches.collect::<Result<_, _>>()?)
    }

    /// Reads each path's results and judges them. `judge` gets the path's index, the case's index
    /// in the batch and the result's words; `expect` says what a failing case should have been.
    fn judge(
        &self,
        batch: &Batch<D::Value>,
        dispatches: Vec<Dispatch>,
        expect: impl Fn(usize, usize) -> Option<Vec<f64>>,
        judge: impl Fn(usize, usize, &[u32]) -> Judged + Sync,
    ) -> Result<Vec<PathTally>, Failure> {
        let words = self.scalars().len();
        let mut tallies = Vec::with_capacity(self.runners.len());
        for (path, (runner, dispatch)) in self.runners.iter().zip(dispatches).enumerate() {
            let tally = runner.read(dispatch, |results| {
                let stride = runner.stride_out();
                let sum = tally(batch.first, results, stride, |case, result| {
                    judge(path, case, &result[..words])
                });
                let show = |shown: Shown| {
                    let case = usize::try_from(shown.case - batch.first).expect("in this batch");
                    let actual = &results[case * stride..][..words];
                    let (judged, expected) = (judge(path, case, actual), expect(path, case));
                    let mut arguments = Vec::new();
                    batch.values[case].store_all(&mut arguments);
                    let function = &self.probed.function;
                    let expected = expected.as_deref();
                    CaseFailure::new(function, shown.case, &arguments, actual, expected, &judged)
                };
                let failing = sum.census.failures > 0;
                let worst = sum.worst.filter(|_| failing).map(show);
                (sum, worst, sum.first.map(show))
            })?;
            let (tally, worst, first) = tally;
            let device = runner.device();
            let adapter = device.adapter().clone();
            tallies.push(PathTally { adapter, path: device.path(), tally, worst, first });
        }
        Ok(tallies)
    }

    fn conclude(&self, tallies: Vec<PathTally>) -> Result<Agreement, Failure> {
        let function = self.probed.function.path.clone();
        let compared = tallies.iter().map(|path| path.tally.census.cases).min().unwrap_or(0);
        let declared = if self.identity.case.is_some() { 1 } else { self.cases.count() };
        if compared < declared {
            let reason = format!("declares {declared} cases, but {compared} were compared");
            return Err(Failure::Domain { function, reason });
        }
        if tallies.iter().all(|path| path.tally.census.failures == 0) {
            let worst_of = |path: &PathTally| {
                path.tally.worst.map_or(Measure::ZERO, |worst| worst.judged.measure)
            };
            let worst = tallies.iter().map(worst_of).max_by(|a, b| a.ratio.total_cmp(&b.ratio));
            let paths = tallies.iter().map(|path| (path.adapter.clone(), worst_of(path))).collect();
            let worst = worst.unwrap_or(Measure::ZERO);
            return Ok(Agreement { function, cases: compared, paths, worst });
        }
        let mut agreeing = Vec::new();
        let mut paths = Vec::new();
        for PathTally { adapter, path, tally, worst, first } in tallies {
            let Some(worst) = worst else {
                agreeing.push(adapter);
                continue;
            };
            let replay = self.identity.replay(path, self.seed, worst.case);
            let first = first.filter(|first| first.case != worst.case);
            let census = tally.census;
            paths.push(PathDisagreement { adapter, census, worst, first, replay });
        }
        Err(Failure::Disagreement(Box::new(Disagreement {
            function: self.probed.function.clone(),
            check: self.assertion.0,
            assertion: self.assertion.1.clone(),
            paths,
            agreeing,
            seed: self.seed,
        })))
    }
}

impl PathTally {
    fn merge(self, other: Self) -> Self {
        let tally = self.tally.merge(other.tally);
        let pick = |shown: Option<Shown>, a: Option<CaseFailure>, b: Option<CaseFailure>| {
            let case = shown.map(|shown| shown.case);
            [a, b].into_iter().flatten().find(|failure| Some(failure.case) == case)
        };
        let worst = tally.worst.filter(|_| tally.census.failures > 0);
        Self {
            worst: pick(worst, self.worst, other.worst),
            first: pick(tally.first, self.first, other.first),
            tally,
            ..self
        }
    }
}

/// The arguments of a batch as words.
struct LanesOnly<'a> {
    first: u64,
    cases: usize,
    lanes: std::borrow::Cow<'a, [u32]>,
}

impl<V: Arguments> Batch<V> {
    fn lanes_only(&self) -> LanesOnly<'_> {
        let (first, cases) = (self.first, self.values.len());
        LanesOnly { first, cases, lanes: self.lanes.as_slice().into() }
    }

    fn transformed(&self, transform: impl Fn(V) -> V + Sync) -> LanesOnly<'_> {
        let mut lanes = Vec::with_capacity(self.lanes.len());
        for value in &self.values {
            transform(value.clone()).store_all(&mut lanes);
        }
        LanesOnly { first: self.first, cases: self.values.len(), lanes: lanes.into() }
    }

    /// The reference's lanes of each case. A value that isn't finite is an error.
    fn expected<D: Domain<Value = V>>(
        &self,
        session: &Session<'_, D>,
        reference: &impl Reference<V>,
    ) -> Result<Vec<f64>, Failure> {
        let parts: Vec<Vec<f64>> = self
            .values
            .par_chunks(TASK)
            .map(|values| {
                let mut lanes = Vec::new();
                for value in values {
                    reference.expect(value, &mut lanes);
                }
                lanes
            })
            .collect();
        let expected = parts.concat();
        match expected.iter().position(|value| !value.is_finite()) {
            None => Ok(expected),
            Some(at) => {
                let function = &session.probed.function;
                let names = function.result.lane_names();
                let case = at / names.len();
                Err(Failure::Reference {
                    function: function.path.clone(),
                    value: expected[at],
                    place: format!("result{}", names[at % names.len()]),
                    case: self.first + case as u64,
                    arguments: format!("{:?}", self.values[case]),
                })
            }
        }
    }
}

fn signature(function: &Function, mismatch: String) -> Failure {
    Failure::Signature {
        function: function.path.clone(),
        mismatch,
        signature: function.to_string(),
        location: function.span.to_string(),
    }
}
