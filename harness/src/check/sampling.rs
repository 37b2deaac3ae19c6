//! Samplers: does a function of random numbers return samples of the density that it claims?
//!
//! A sampler is run over configurations (a width, a view), each with a stream of random numbers of
//! its own that depends on the seed and the configuration's index alone. What is asserted of its
//! samples is judged by a p-value for each configuration; the threshold is such that all of a
//! check together reject a right sampler with the stated significance. Samples that aren't
//! finite, aren't where they should be, or can't happen under the density fail outright.
//!
//! Each path runs the same random numbers, so paths don't count as tests of their own.

mod calls;
mod density;
mod picture;
mod power;
mod rejection;
mod statistic;

use std::marker::PhantomData;

pub use power::Power;
pub use rejection::{ConfigurationRejection, Finding, PathRejection, Rejection};

use super::called::{Called, Fitting, Ready};
use super::plan::{Plan, Recording};
use super::session::{Asserted, Demand, Session};
use super::{Failure, Mismatch, Probe, Vacuous};
use crate::domain::{Domain, Held, Source, Stream, Typed};
use crate::path::{Adapter, Selector};
use crate::probe::{BATCH, Inputs};
use crate::record::{PathRecord, Subject};
use crate::run::{Identity, KnownIssue, Replayed, Reporter, Seen};
use crate::stats::{Support, sidak};
use crate::value::{Arguments, Shape, Shareable};
use calls::{Calls, given};

/// Configurations of a check unless it says otherwise: each is a quarter million samples.
const CONFIGURATIONS: u64 = 16;

/// Values of a finite domain that are all tried unless a number of configurations is asked for.
const ENUMERATED: u64 = 4096;

/// Samples of a configuration unless a check says otherwise: each of 512 cells expects 512 of them,
/// and a density that is off by 3 % all over is rejected in all but one of 10^9 runs.
const SAMPLES: u64 = 1 << 18;

/// Probability that a check rejects a right sampler, under one seed. Mitsuba's choice.
const SIGNIFICANCE: f64 = 0.01;

/// How far the integral of a density may be from 1 beyond the error of the quadrature: what a few
/// hundred ulp of the density at each node can add.
const MASS: f64 = 2e-4;

impl<'a> Probe<'a> {
    /// Selects configurations of a sampler. `arguments` makes the sampler's arguments of a
    /// configuration and random numbers: an `f32` in [0, 1), a vector of such, or `u32`s.
    ///
    /// ```no_run
    /// use glam::{Vec2, Vec3};
    /// use karat::prelude::*;
    ///
    /// # static SHADERS: Package = karat::package!("shaders");
    /// SHADERS
    ///     .function("sampling::ggx_normal")
    ///     .sampled_over(OneOf(vec![0.01, 0.5, 1.0]), |&alpha, u: Vec2| (alpha, u))
    ///     .follows(SHADERS.function("sampling::ggx_normal_pdf"), |&alpha, h: Vec3| (alpha, h));
    /// ```
    pub fn sampled_over<D, U, A, F>(
        self,
        configurations: D,
        arguments: F,
    ) -> SamplingCheck<'a, D, U, A, F>
    where
        D: Domain,
        U: Shareable,
        A: Arguments,
        F: Fn(&D::Value, U) -> A + Sync,
    {
        SamplingCheck {
            plan: Plan::new(self),
            configurations,
            arguments,
            settings: Settings {
                support: Support::Hemisphere,
                samples: SAMPLES,
                significance: SIGNIFICANCE,
                mass: MASS,
                may_leave: false,
            },
            types: PhantomData,
        }
    }
}

/// What is the same for each configuration.
#[derive(Clone, Copy, Debug)]
struct Settings {
    support: Support,
    samples: u64,
    significance: f64,
    mass: f64,
    may_leave: bool,
}

/// A sampler with the configurations that it is run over: see [`Probe::sampled_over`].
#[derive(Clone, Debug)]
#[must_use = "nothing is sampled until a verb such as `.follows(...)`"]
pub struct SamplingCheck<'a, D, U, A, F> {
    plan: Plan<'a>,
    configurations: D,
    arguments: F,
    settings: Settings,
    types: PhantomData<fn(U) -> A>,
}

impl<D, U, A, F> SamplingCheck<'_, D, U, A, F>
where
    D: Domain,
    U: Shareable,
    A: Arguments,
    F: Fn(&D::Value, U) -> A + Sync,
{
    /// Says where samples lie. Without this: directions of the upper hemisphere.
    pub fn on(mut self, support: Support) -> Self {
        self.settings.support = support;
        self
    }

    /// Sets the number of samples of a configuration. Without this: 2^18.
    pub fn samples(mut self, samples: u64) -> Self {
        self.settings.samples = samples;
        self
    }

    /// Sets the probability that the check rejects a right sampler, whatever the number of its
    /// configurations. Without this: 1 %. As the seed is fixed, a right sampler is rejected in every
    /// run or in none: look at one that is with ten times the samples, and if it fits then,
    /// [`seed`](Self::seed) gives the check other random numbers.
    pub fn significance(mut self, significance: f64) -> Self {
        self.settings.significance = significance;
        self
    }

    /// Declares that samples may lie beside the support, as directions reflected below the horizon
    /// do: as many as the density's integral falls short of 1.
    pub fn may_leave(mut self) -> Self {
        self.settings.may_leave = true;
        self
    }

    /// Sets how far the density's integral may be from 1, beyond the error of its quadrature.
    /// Without this: 2e-4.
    pub fn mass_within(mut self, tolerance: f64) -> Self {
        self.settings.mass = tolerance;
        self
    }

    /// Sets the number of configurations. A finite domain of at most that many values is
    /// enumerated instead. Without this, a finite domain of up to 4,096 values is enumerated, and
    /// of others 16 are drawn.
    pub fn configurations(mut self, configurations: u64) -> Self {
        self.plan.cases = Some(configurations);
        self
    }

    /// Sets the seed, which otherwise derives from the test's name.
    pub fn seed(mut self, seed: u64) -> Self {
        self.plan.seed = Some(seed);
        self
    }

    /// Declares that the check fails on a path, and why: see
    /// [`Check::fails_on`](super::Check::fails_on).
    pub fn fails_on(mut self, on: impl Into<Selector>, reason: &str) -> Self {
        self.plan.known_issues.declare(on.into(), reason);
        self
    }
}

/// What a check of samples compared, and how close it came.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The sampler.
    pub function: String,
    /// Configurations, on each path.
    pub configurations: u64,
    /// Samples of a configuration.
    pub samples: u64,
    /// The least p-value of each path.
    pub paths: Vec<(Adapter, f64)>,
    /// The least p-value of all.
    pub p: f64,
    /// What it had to reach: the significance, shared out over all configurations.
    pub threshold: f64,
    /// Paths that fail as was declared. They are not among `paths`.
    pub known_issues: Vec<KnownIssue>,
}

impl std::fmt::Display for Fit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { function, configurations, samples, p, threshold, .. } = self;
        write!(
            f,
            "{function}: {configurations} configurations of {samples} samples fit, \
             least p {p:.2e} (above {threshold:.2e})"
        )
    }
}

/// What a verb asserts of a sampler.
struct Hypothesis {
    /// The verb.
    check: &'static str,
    /// What it says, for records and messages.
    text: String,
    /// Tests of one configuration, which share the significance.
    tests: u64,
}

/// What one configuration gave.
struct Judgement {
    /// What is wrong; nothing if it fits.
    findings: Vec<Finding>,
    /// The least p-value; 0 if something is wrong outright.
    p: f64,
    /// Facts, for the message.
    notes: Vec<(&'static str, String)>,
    histogram: Option<picture::Histogram>,
}

/// A configuration of a check that is running on one path.
struct Configuration<'s> {
    value: &'s Held,
    index: u64,
    path: usize,
    seed: u64,
    /// What a p-value has to reach.
    threshold: f64,
}

/// A sampler without the types of its configurations and random numbers.
#[derive(Clone, Copy)]
struct Sampled<'s, 'a> {
    plan: &'s Plan<'a>,
    settings: &'s Settings,
    configurations: &'s dyn Stream,
    /// Types of the arguments.
    shapes: &'s [Shape],
    /// The type of the random numbers of a sample.
    random: &'s Shape,
    /// Appends the arguments for random numbers, which follow one another as words.
    arguments: Made<'s>,
}

/// Appends the arguments that a function is given in a configuration at points, or for random
/// numbers, which follow one another as words.
type Made<'m> = &'m (dyn Fn(&Held, &[u32], &mut Vec<u32>) + Sync);

/// A function beside the sampler.
struct Other<'o> {
    probe: Probe<'o>,
    /// Types of its arguments.
    shapes: Vec<Shape>,
    made: Made<'o>,
}

impl<D, U, A, F> SamplingCheck<'_, D, U, A, F>
where
    D: Domain,
    U: Shareable,
    A: Arguments,
    F: Fn(&D::Value, U) -> A + Sync,
{
    /// Hands the sampler to what is compiled once.
    fn with_sampler<T>(&self, then: impl FnOnce(Sampled<'_, '_>) -> T) -> T {
        then(Sampled {
            plan: &self.plan,
            settings: &self.settings,
            configurations: &Typed::values(&self.configurations),
            shapes: &A::shapes(),
            random: &U::shape(),
            arguments: &|value, random, lanes| {
                given(|u| (self.arguments)(value.get(), u))(random, lanes);
            },
        })
    }
}

/// What a function is given in a configuration.
fn made<V: 'static, X: Shareable, B: Arguments>(
    of: impl Fn(&V, X) -> B + Sync,
) -> impl Fn(&Held, &[u32], &mut Vec<u32>) + Sync {
    move |value, points, lanes| given(|point| of(value.get(), point))(points, lanes)
}

/// A sampler in progress, and the other functions that a check needs.
struct Functions<'s> {
    sampler: &'s Called<'s>,
    others: &'s [Called<'s>],
}

impl Functions<'_> {
    fn sampler(&self, path: usize) -> Calls<'_> {
        Calls { called: self.sampler, ready: &self.sampler.ready[path] }
    }

    fn other(&self, which: usize, path: usize) -> Calls<'_> {
        let called = &self.others[which];
        Calls { called, ready: &called.ready[path] }
    }
}

/// Runs a check: `expect` compares signatures, and each configuration on each path is handed to
/// `judge`.
fn conclude(
    sampler: Sampled<'_, '_>,
    hypothesis: &Hypothesis,
    others: &[Other<'_>],
    recording: Recording,
    expect: &dyn Fn(&Functions<'_>) -> Result<(), Failure>,
    judge: &mut dyn FnMut(&Functions<'_>, &Configuration<'_>) -> Result<Judgement, Failure>,
) -> Result<Fit, Failure> {
    let Sampled { plan, settings, configurations, shapes, .. } = sampler;
    let function = plan.probe.name.clone();
    let reporter = Reporter::start();
    let check = hypothesis.check;
    let identity = Identity::of(&function, check)?;
    let seed = plan.seed.unwrap_or_else(|| identity.seed(&function, &identity.check));
    let package = plan.probe.package.root().display().to_string();
    let mut subject = Subject::Function {
        package,
        function: function.clone(),
        check: check.to_owned(),
        assertion: hypothesis.text.clone(),
        location: String::new(),
        seed,
    };
    let mut paths = Vec::new();
    let mut read: Vec<_> = plan.probe.module_file().into_iter().collect();
    let result = (|| {
        settings.check(&function)?;
        plan.expect_reasons()?;
        let asserted = Asserted { check, text: hypothesis.text.clone() };
        let demand = Demand {
            arguments: shapes.to_vec(),
            who: "the sampler is given",
            draws_arguments: false,
            cases: CONFIGURATIONS,
            enumerated: ENUMERATED,
            calls: BATCH,
        };
        let inputs = Inputs::Storage;
        let session =
            Session::open(plan, configurations, &demand, &identity, seed, asserted, inputs)?;
        if let Subject::Function { location, .. } = &mut subject {
            *location = session.called.function().span.to_string();
        }
        read.extend(session.called.files(&plan.probe.fixtures));
        let executors = plan.probe.executors()?;
        let mut open = |Other { probe, shapes, .. }: &Other<'_>| {
            let function = (probe.package, &*probe.name);
            let fitting = Fitting::find(function, inputs, shapes, "it is given")?;
            if !probe.executors.is_empty() {
                return Err(Mismatch::Executor.of(fitting.function()));
            }
            // Where the sampler runs: what they return is compared with its samples.
            let called = fitting.on(&executors, &probe.fixtures, BATCH)?;
            read.extend(called.files(&probe.fixtures));
            Ok(called)
        };
        let others: Vec<Called<'_>> =
            others.iter().map(&mut open).collect::<Result<_, Failure>>()?;
        let functions = Functions { sampler: &session.called, others: &others };
        expect(&functions)?;
        let count = session.count();
        let threshold = sidak(settings.significance, count * hypothesis.tests);
        let selected = session.selected()?;
        let ready = &session.called.ready;
        let mut sums: Vec<Sum> = ready.iter().map(|_| Sum::default()).collect();
        for index in selected.clone() {
            let value = &session.case(index)?;
            let seed = configuration_seed(seed, index);
            for (path, sum) in sums.iter_mut().enumerate() {
                let configuration = Configuration { value, index, path, seed, threshold };
                let judgement = judge(&functions, &configuration)?;
                sum.add(index, value.shown(), judgement);
            }
        }
        let (mut fits, mut rejections, mut agreeing) = (Vec::new(), Vec::new(), Vec::new());
        let mut known = Vec::new();
        for (Ready { path, adapter, .. }, sum) in ready.iter().zip(sums) {
            let (path, adapter) = (*path, adapter.clone());
            let known_issue = plan.known_issues.on(path, &adapter).map(str::to_owned);
            let is_known = known_issue.is_some();
            paths.push(PathRecord {
                adapter: adapter.clone(),
                cases: sum.configurations * settings.samples,
                failures: sum.rejected,
                worst: format!("p {:.2e}", sum.p),
                ratio: Some(threshold / sum.p).filter(|ratio| ratio.is_finite()),
                asserted: hypothesis.text.clone(),
                known_issue,
            });
            if sum.configurations < selected.end - selected.start || sum.configurations == 0 {
                let declared = selected.end - selected.start;
                let reason = Vacuous::Uncompared { declared, compared: sum.configurations };
                return Err(Failure::Domain {
                    function: function.clone(),
                    reason: Box::new(reason),
                });
            }
            if is_known {
                let failures = sum.rejected;
                known.push(Seen { adapter, path, cases: sum.configurations, failures });
                continue;
            }
            let Some(worst) = sum.worst.filter(|_| sum.rejected > 0) else {
                agreeing.push(adapter.clone());
                fits.push((adapter, sum.p));
                continue;
            };
            let replayed = Replayed { case: worst.configuration, steps: &[], input: None };
            let label = &identity.check;
            let replay =
                identity.replay(session.selectable(path), seed, &function, label, replayed);
            let check = format!("{}-{function}-{label}", identity.test);
            let place = (check, path.to_string());
            let worst = worst.reported(settings.support, place);
            rejections.push(PathRejection {
                adapter,
                configurations: sum.configurations,
                rejected: sum.rejected,
                worst,
                replay,
            });
        }
        if rejections.is_empty() {
            let p = fits.iter().map(|fit| fit.1).fold(1.0, f64::min);
            let (configurations, samples) = (selected.end - selected.start, settings.samples);
            let known_issues = plan.known(known, session.is_replay())?;
            let paths = fits;
            return Ok(Fit {
                function,
                configurations,
                samples,
                paths,
                p,
                threshold,
                known_issues,
            });
        }
        Err(Failure::Rejection(Box::new(Rejection {
            function: session.called.function().clone(),
            check,
            assertion: hypothesis.text.clone(),
            significance: settings.significance,
            threshold,
            paths: rejections,
            agreeing,
            seed,
        })))
    })();
    if recording == Recording::On {
        reporter.record(subject, paths, read, &result);
    }
    result
}

/// The seed of a configuration's random numbers.
fn configuration_seed(seed: u64, index: u64) -> u64 {
    let mut source = Source::new(seed, index);
    u64::from(source.bits()) << 32 | u64::from(source.bits())
}

/// The configurations of one path.
struct Sum {
    configurations: u64,
    rejected: u64,
    /// The least p-value.
    p: f64,
    worst: Option<rejection::Worst>,
}

impl Default for Sum {
    fn default() -> Self {
        Self { configurations: 0, rejected: 0, p: 1.0, worst: None }
    }
}

impl Sum {
    fn add(&mut self, configuration: u64, shown: String, judgement: Judgement) {
        self.configurations += 1;
        let Judgement { findings, p, notes, histogram } = judgement;
        if findings.is_empty() {
            self.p = self.p.min(p);
            return;
        }
        self.rejected += 1;
        if self.worst.is_none() || p < self.p {
            self.worst =
                Some(rejection::Worst { configuration, shown, findings, notes, histogram });
        }
        self.p = self.p.min(p);
    }
}

impl Settings {
    fn check(&self, function: &str) -> Result<(), Failure> {
        let reason = if !(self.significance > 0.0 && self.significance < 1.0) {
            Vacuous::Significance(self.significance)
        } else if !(self.mass >= 0.0 && self.mass.is_finite()) {
            Vacuous::Mass(self.mass)
        } else if let Support::Interval(low, high) = self.support
            && !(low < high && low.is_finite() && high.is_finite())
        {
            Vacuous::Interval(low, high)
        } else {
            return Ok(());
        };
        Err(Failure::Domain { function: function.to_owned(), reason: Box::new(reason) })
    }
}
