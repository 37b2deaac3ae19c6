//! Checks of samplers. A sampler is a function that turns random numbers into samples of a density.
//!
//! A configuration contains the values of the sampler's non-random arguments, such as a roughness and a view direction.
//! A check runs the sampler with several configurations. Each configuration has its own stream of random numbers, which
//! depends only on the seed and the configuration's index. For each configuration, the check compares a p-value with a
//! threshold. Karat computes this threshold so that the whole check rejects a correct sampler with the probability
//! `significance`. The check fails at once if a sample isn't finite, lies outside the support (unless the check allows
//! this), or has density 0.
//!
//! All paths use the same random numbers, so the paths don't count as separate statistical tests.

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

/// The default number of configurations. The number is small, because each configuration has a quarter of a million
/// samples.
const CONFIGURATIONS: u64 = 16;

/// If a finite domain has at most this many values, every value is a configuration by default.
const ENUMERATED: u64 = 4096;

/// The default number of samples per configuration. With this number, each of 512 cells gets 512 samples on average. If
/// the density is wrong by 3 % in every cell, the check accepts the density in only one of 10^9 runs.
const SAMPLES: u64 = 1 << 18;

/// The default probability that a check rejects a correct sampler, for one seed. The tests of the renderer Mitsuba use
/// the same value.
const SIGNIFICANCE: f64 = 0.01;

/// The default limit for the difference between a density's integral and 1. Karat adds the quadrature's error to this
/// limit. If each value of the density has a relative error of at most 2e-4, the integral is within the limit.
const MASS: f64 = 2e-4;

impl<'a> Probe<'a> {
    /// Begins a check of a sampler. A configuration contains the values of the sampler's non-random arguments,
    /// such as a roughness. `configurations` is the domain of the configurations. `arguments` makes the sampler's
    /// arguments from a configuration and random numbers. The random numbers are an `f32` in [0, 1), a vector
    /// of such numbers, or `u32`s.
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

#[derive(Clone, Copy, Debug)]
struct Settings {
    support: Support,
    samples: u64,
    significance: f64,
    mass: f64,
    may_leave_support: bool,
}

/// A marker for a [`Check`] that judges a sampler (see [`Probe::sampled_over`]). `V` is the type of the
/// configurations, `U` the type of the random numbers, and `A` the type of the sampler's arguments. `F` makes
/// the arguments from a configuration and random numbers.
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
    /// Sets the support: the set of points that the sampler can return. The default is the directions of the upper
    /// hemisphere.
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

    /// Sets the number of samples per configuration. The default is 2^18.
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

    /// Sets the probability that the check, with all its configurations, rejects a correct sampler. The default is 1 %.
    /// The seed is fixed, so every run gives the same verdict. If the check rejects your sampler, try ten times as many
    /// samples. If the sampler then passes, the rejection was chance: choose another [`seed`](Self::seed).
    ///
    /// ```
    /// # use karat::prelude::*;
    /// # let package = Package::from_source("m", "fn uniform(u: f32) -> f32 { return u; }");
    /// let sampler = package.function("uniform").sampled_over(Just(()), |(), u: f32| u);
    /// // For one of a thousand seeds, the check rejects a correct sampler.
    /// sampler.significance(1e-3).has_mean("x", |x: f32| x.into(), |()| 0.5, 1e-6);
    /// ```
    pub fn significance(mut self, significance: f64) -> Self {
        self.of.settings.significance = significance;
        self
    }

    /// Declares that samples may lie outside the support, such as directions that are reflected below the horizon. Of
    /// all samples, the share outside the support must be 1 minus the density's integral over the support.
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

    /// Sets the largest allowed difference between the density's integral and 1. Karat adds the quadrature's error to
    /// this limit. The default is 2e-4.
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

/// The result when the check of a sampler passes: the numbers of samples, and the smallest p-values.
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
    /// The name of the sampler.
    pub function: String,
    /// The number of configurations on each path.
    pub configurations: u64,
    /// The number of samples per configuration.
    pub samples: u64,
    /// The paths that pass, each with its smallest p-value.
    pub paths: Vec<(Adapter, f64)>,
    /// The smallest p-value of all paths.
    pub p: f64,
    /// The smallest p-value that passes. Karat computes this threshold from the significance and the number of
    /// statistical tests.
    pub threshold: f64,
    /// The paths that fail as declared. `paths` doesn't contain these paths.
    pub known_issues: Vec<KnownIssue>,
}

impl std::fmt::Display for Fit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { function, configurations, samples, p, threshold, .. } = self;
        write!(
            f,
            "{function}: {configurations} configurations pass, with {samples} samples each; the \
             smallest p is {p:.2e} (threshold {threshold:.2e})"
        )
    }
}

struct Hypothesis {
    check: &'static str,
    /// The text of the assertion, for records and messages.
    text: String,
    /// The number of statistical tests per configuration. The significance is the probability that at least one of the
    /// check's tests rejects a correct sampler.
    tests: u64,
}

/// A configuration for which a check is running on one path.
struct Configuration<'s> {
    value: &'s Held,
    index: u64,
    seed: u64,
    /// The smallest p-value that passes.
    threshold: f64,
}

/// A sampler, without the Rust types of its configurations and random numbers.
#[derive(Clone, Copy)]
struct Sampled<'s, 'a> {
    plan: &'s Plan<'a>,
    recorded: bool,
    settings: &'s Settings,
    configurations: &'s dyn Stream,
    shapes: &'s [Shape],
    /// The type of the random numbers for one sample.
    random: &'s Shape,
    /// A function that takes a configuration and random numbers, and appends the sampler's arguments to a vector.
    arguments: Made<'s>,
}

/// A function that takes a configuration and points (or random numbers) as `u32` words, and appends a function's
/// arguments for each point to a vector.
type Made<'m> = &'m (dyn Fn(&Held, &[u32], &mut Vec<u32>) + Sync);

/// A second function of the check, such as the density.
struct Other<'o> {
    probe: Probe<'o>,
    /// The types of the function's arguments.
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
    /// Calls `then` with the sampler as a `Sampled`. `Sampled` has no type parameters, so the compiler compiles the
    /// functions that take a `Sampled` only once.
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

/// Turns `of`, which returns arguments as Rust values, into a function that appends the arguments' words to a vector.
fn made<V: 'static, X: Shareable, B: Arguments>(
    of: impl Fn(&V, X) -> B + Sync,
) -> impl Fn(&Held, &[u32], &mut Vec<u32>) + Sync {
    move |value, points, lanes| given(|point| of(value.get(), point))(points, lanes)
}
