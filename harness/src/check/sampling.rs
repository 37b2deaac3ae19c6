//! Samplers: does a function of random numbers return samples of the density that it claims?
//!
//! A sampler is run over configurations (a width, a view), each with a stream of random numbers of
//! its own that depends on the seed and the configuration's index alone. Each configuration is
//! judged by a p-value. The threshold is chosen so that the whole check rejects a correct sampler
//! with the stated significance. Samples that aren't finite, aren't where they should be, or can't
//! happen under the density fail outright.
//!
//! Each path runs the same random numbers, so paths don't count as separate tests.

mod calls;
mod conclude;
mod density;
mod judgement;
mod picture;
mod power;
pub(crate) mod rejection;
mod statistic;

use std::marker::PhantomData;

pub use power::Power;
pub(crate) use rejection::{Finding, Rejection};

use super::plan::Plan;
use super::{Check, Failure, Probe, Vacuous};
use crate::domain::{Domain, Held, Stream, Typed};
use crate::path::Adapter;
use crate::run::KnownIssue;
use crate::stats::Support;
use crate::value::{Arguments, Shape, Shareable};
use calls::given;

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
    /// Chooses the configurations that a sampler is run over. `arguments` makes the sampler's
    /// arguments from a configuration and random numbers. Random numbers are an `f32` in [0, 1), a
    /// vector of those, or `u32`s.
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
    ) -> Check<'a, Sampling<D::Value, U, A, F>>
    where
        D: Domain + 'a,
        U: Shareable,
        A: Arguments,
        F: Fn(&D::Value, U) -> A + Sync,
    {
        let settings = Settings {
            support: Support::Hemisphere,
            samples: SAMPLES,
            significance: SIGNIFICANCE,
            mass: MASS,
            may_leave_support: false,
        };
        let sampling = Sampling { arguments, settings, types: PhantomData };
        Check::new(self, Typed::values(configurations), sampling)
    }
}

/// What is the same for each configuration.
#[derive(Clone, Copy, Debug)]
struct Settings {
    support: Support,
    samples: u64,
    significance: f64,
    mass: f64,
    may_leave_support: bool,
}

/// The way of a [`Check`] that draws samples: see [`Probe::sampled_over`]. `V` are the configurations, `U`
/// random numbers, and `A` the arguments that `F` makes of both.
///
/// ```no_run
/// use glam::{Vec2, Vec3};
/// # use karat::prelude::*;
/// # static SHADERS: Package = karat::package!("shaders");
///
/// // fn cosine_hemisphere(u: vec2f) -> vec3f, and fn cosine_hemisphere_pdf(l: vec3f) -> f32
/// SHADERS
///     .function("sampling::cosine_hemisphere")
///     .sampled_over(Just(()), |(), u: Vec2| u)
///     .follows(SHADERS.function("sampling::cosine_hemisphere_pdf"), |(), l: Vec3| l);
/// ```
#[derive(Clone, Debug)]
pub struct Sampling<V, U, A, F> {
    arguments: F,
    settings: Settings,
    types: PhantomData<fn(V, U) -> A>,
}

impl<V, U, A, F> Check<'_, Sampling<V, U, A, F>>
where
    V: 'static,
    U: Shareable,
    A: Arguments,
    F: Fn(&V, U) -> A + Sync,
{
    /// Says where samples lie. Without this: directions of the upper hemisphere.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let package = Package::from_source("m", "fn uniform(u: f32) -> f32 { return u; }");
    /// let sampler = package.function("uniform").sampled_over(Just(()), |(), u: f32| u);
    /// sampler.support(Support::Interval(0.0, 1.0)).has_mean("x", |x: f32| x.into(), |()| 0.5, 1e-6);
    /// ```
    pub fn support(mut self, support: Support) -> Self {
        self.of.settings.support = support;
        self
    }

    /// Sets the number of samples of a configuration. Without this: 2^18.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let package = Package::from_source("m", "fn uniform(u: f32) -> f32 { return u; }");
    /// let sampler = package.function("uniform").sampled_over(Just(()), |(), u: f32| u);
    /// sampler.samples(65536).has_mean("x", |x: f32| x.into(), |()| 0.5, 1e-6);
    /// ```
    pub fn samples(mut self, samples: u64) -> Self {
        self.of.settings.samples = samples;
        self
    }

    /// Sets the probability that the whole check rejects a correct sampler, however many
    /// configurations it has. Without this: 1 %. The seed is fixed, so a correct sampler is
    /// rejected in every run or in none. If yours is rejected, try ten times the samples. If it
    /// fits then, give the check other random numbers with [`seed`](Self::seed).
    ///
    /// ```
    /// # use karat::prelude::*;
    /// # let package = Package::from_source("m", "fn uniform(u: f32) -> f32 { return u; }");
    /// let sampler = package.function("uniform").sampled_over(Just(()), |(), u: f32| u);
    /// // Rejects a right sampler in one of a thousand seeds.
    /// sampler.significance(1e-3).has_mean("x", |x: f32| x.into(), |()| 0.5, 1e-6);
    /// ```
    pub fn significance(mut self, significance: f64) -> Self {
        self.of.settings.significance = significance;
        self
    }

    /// Declares that samples may lie outside the support, as directions reflected below the horizon
    /// do. Their share has to be 1 less the density's integral.
    ///
    /// ```no_run
    /// use glam::{Vec2, Vec3};
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// SHADERS
    ///     .function("ggx::sample") // reflects below the horizon, too
    ///     .sampled_over(0.05..=1.0, |&alpha, u: Vec2| (alpha, u))
    ///     .may_leave_support()
    ///     .follows(SHADERS.function("ggx::pdf"), |&alpha, l: Vec3| (alpha, l));
    /// ```
    pub fn may_leave_support(mut self) -> Self {
        self.of.settings.may_leave_support = true;
        self
    }

    /// Sets how far the density's integral may be from 1, beyond the error of its quadrature.
    /// Without this: 2e-4.
    ///
    /// ```no_run
    /// use glam::{Vec2, Vec3};
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// SHADERS
    ///     .function("ggx::sample")
    ///     .sampled_over(0.05..=1.0, |&alpha, u: Vec2| (alpha, u))
    ///     .mass_within(1e-3) // the density is a fit
    ///     .follows(SHADERS.function("ggx::pdf"), |&alpha, l: Vec3| (alpha, l));
    /// ```
    pub fn mass_within(mut self, tolerance: f64) -> Self {
        self.of.settings.mass = tolerance;
        self
    }
}

/// What a check of samples compared, and how close it came.
///
/// ```
/// # use karat::prelude::*;
/// let package = Package::from_source("m", "fn uniform(u: f32) -> f32 { return u; }");
/// let sampler = package.function("uniform").sampled_over(Just(()), |(), u: f32| u);
/// let fit = sampler.has_mean("u", |x: f32| x.into(), |()| 0.5, 1e-6);
/// assert_eq!(fit.configurations, 1);
/// assert!(fit.p >= fit.threshold);
/// ```
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
    /// The least p-value that passes: the significance, shared out over all configurations.
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

/// A configuration of a check that is running on one path.
struct Configuration<'s> {
    value: &'s Held,
    index: u64,
    seed: u64,
    /// What a p-value has to reach.
    threshold: f64,
}

/// A sampler without the types of its configurations and random numbers.
#[derive(Clone, Copy)]
struct Sampled<'s, 'a> {
    plan: &'s Plan<'a>,
    /// True if the verdict goes into the record of the run.
    recorded: bool,
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

impl<V, U, A, F> Check<'_, Sampling<V, U, A, F>>
where
    V: 'static,
    U: Shareable,
    A: Arguments,
    F: Fn(&V, U) -> A + Sync,
{
    /// Hands the sampler to what is compiled once.
    fn with_sampler<T>(&self, then: impl FnOnce(Sampled<'_, '_>) -> T) -> T {
        then(Sampled {
            plan: &self.plan,
            recorded: self.plan.recorded,
            settings: &self.of.settings,
            configurations: &*self.stream,
            shapes: &A::shapes(),
            random: &U::shape(),
            arguments: &|value, random, lanes| {
                given(|u| (self.of.arguments)(value.get(), u))(random, lanes);
            },
        })
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

/// What a function is given in a configuration.
fn made<V: 'static, X: Shareable, B: Arguments>(
    of: impl Fn(&V, X) -> B + Sync,
) -> impl Fn(&Held, &[u32], &mut Vec<u32>) + Sync {
    move |value, points, lanes| given(|point| of(value.get(), point))(points, lanes)
}
