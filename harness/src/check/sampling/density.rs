//! Compares samples with their density, and with the integral that the samples estimate.

mod masses;
mod parts;
mod run;

use super::conclude::{Functions, conclude};
use super::judgement::Judgement;
use super::{Configuration, Fit, Hypothesis, Other, Power, Sampled, Sampling, made};
use crate::check::{Check, Failure, Mismatch, Probe};
use crate::run::or_panic;
use crate::value::{Arguments, Scalar, Shape, Shareable};
use parts::Stop;
use run::Run;

impl<V, U, A, F> Check<'_, Sampling<V, U, A, F>>
where
    V: 'static,
    U: Shareable,
    A: Arguments,
    F: Fn(&V, U) -> A + Sync,
{
    /// Checks that samples follow a density. Pearson's chi-square test compares the number of samples in each
    /// cell of the support with the integral of the density over that cell. `arguments` makes the density's
    /// arguments from a configuration and a point of the support. The point is a `Vec3` for directions, a
    /// `Vec2` for the disk, or an `f32` for an interval.
    ///
    /// There are about 512 cells. The cells are smaller where samples are dense. The test misses errors that cancel
    /// each other within a cell. The test also misses a spike of the density that no sample and no quadrature node
    /// hits. To find such errors, also compare the density with a reference.
    ///
    /// The density's integral must be 1. With [`may_leave_support`](Self::may_leave_support) the integral may be less
    /// than 1. Then the share of samples outside the support must be 1 minus the integral. If the density is 0 at even
    /// one sample, the check fails.
    ///
    /// ```no_run
    /// use glam::{Vec2, Vec3};
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// SHADERS
    ///     .function("sampling::cosine_hemisphere")
    ///     .sampled_over(Just(()), |(), u: Vec2| u)
    ///     .follows(SHADERS.function("sampling::cosine_hemisphere_pdf"), |(), l: Vec3| l);
    /// ```
    ///
    /// # Panics
    /// Panics with the [`Failure`] if the check rejects a configuration, or can't judge a configuration. Karat
    /// writes a picture of the worst configuration below `target/karat/samples`.
    #[track_caller]
    pub fn follows<X: Shareable, B: Arguments>(
        self,
        density: Probe<'_>,
        arguments: impl Fn(&V, X) -> B + Sync,
    ) -> Fit {
        or_panic(self.try_follows(density, arguments))
    }

    /// Runs [`follows`](Self::follows), but returns the failure instead of panicking.
    ///
    /// # Errors
    /// Returns the failure if the check rejects a configuration, or can't judge a configuration.
    pub fn try_follows<X: Shareable, B: Arguments>(
        self,
        density: Probe<'_>,
        arguments: impl Fn(&V, X) -> B + Sync,
    ) -> Result<Fit, Failure> {
        let (shapes, made) = (B::shapes(), &made(arguments));
        let others = [Other { probe: density, shapes, made }];
        self.with_sampler(|sampler| sampler.follows(&others, &X::shape()))
    }

    /// Checks a sampler together with the function whose integral the samples estimate, such as a BRDF. Samples must
    /// follow the density. For each component, the mean of eval cos / pdf must equal the integral of eval cos. The
    /// check fails if the sampler misses directions at which `eval` isn't 0. The check can't find mistakes in `eval`,
    /// because the mean and the integral use the same `eval`.
    ///
    /// `eval` and `density` are pairs of a function and a closure. The closure makes the function's arguments
    /// from a configuration and a direction. "cos" is the absolute value of the direction's z.
    ///
    /// ```no_run
    /// use glam::{Vec2, Vec3};
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// // fn sample(alpha: f32, u: vec2f) -> vec3f; fn eval and fn pdf (alpha: f32, l: vec3f)
    /// let sampler = SHADERS.function("ggx::sample").sampled_over(0.05..=1.0, |&a, u: Vec2| (a, u));
    /// sampler.estimates(
    ///     (SHADERS.function("ggx::eval"), |&a: &f32, l: Vec3| (a, l)),
    ///     (SHADERS.function("ggx::pdf"), |&a: &f32, l: Vec3| (a, l)),
    /// );
    /// ```
    ///
    /// # Panics
    /// Panics with the [`Failure`] if the check rejects a configuration, or can't judge a configuration.
    #[track_caller]
    pub fn estimates<X: Shareable, B: Arguments, E: Arguments>(
        self,
        eval: (Probe<'_>, impl Fn(&V, X) -> E + Sync),
        density: (Probe<'_>, impl Fn(&V, X) -> B + Sync),
    ) -> Fit {
        or_panic(self.try_estimates(eval, density))
    }

    /// Runs [`estimates`](Self::estimates), but returns the failure instead of panicking.
    ///
    /// # Errors
    /// Returns the failure if the check rejects a configuration, or can't judge a configuration.
    pub fn try_estimates<X: Shareable, B: Arguments, E: Arguments>(
        self,
        eval: (Probe<'_>, impl Fn(&V, X) -> E + Sync),
        density: (Probe<'_>, impl Fn(&V, X) -> B + Sync),
    ) -> Result<Fit, Failure> {
        self.check_estimate(eval, density, None::<Unweighted<'_, V, X>>)
    }

    /// Checks a sampler like [`estimates`](Self::estimates). Also checks that a third function, `weight`,
    /// returns eval cos / pdf for each sample, with a relative error of at most 1e-4.
    ///
    /// ```no_run
    /// use glam::{Vec2, Vec3};
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// let sampler = SHADERS.function("ggx::sample").sampled_over(0.05..=1.0, |&a, u: Vec2| (a, u));
    /// sampler.estimates_with_weight(
    ///     (SHADERS.function("ggx::eval"), |&a: &f32, l: Vec3| (a, l)),
    ///     (SHADERS.function("ggx::pdf"), |&a: &f32, l: Vec3| (a, l)),
    ///     (SHADERS.function("ggx::weight"), |&a: &f32, l: Vec3| (a, l)),
    /// );
    /// ```
    ///
    /// # Panics
    /// Panics with the [`Failure`] if the check rejects a configuration, or can't judge a configuration.
    #[track_caller]
    pub fn estimates_with_weight<X: Shareable, B: Arguments, E: Arguments, W: Arguments>(
        self,
        eval: (Probe<'_>, impl Fn(&V, X) -> E + Sync),
        density: (Probe<'_>, impl Fn(&V, X) -> B + Sync),
        weight: (Probe<'_>, impl Fn(&V, X) -> W + Sync),
    ) -> Fit {
        or_panic(self.try_estimates_with_weight(eval, density, weight))
    }

    /// Runs [`estimates_with_weight`](Self::estimates_with_weight), but returns the failure instead of panicking.
    ///
    /// # Errors
    /// Returns the failure if the check rejects a configuration, or can't judge a configuration.
    pub fn try_estimates_with_weight<X: Shareable, B: Arguments, E: Arguments, W: Arguments>(
        self,
        eval: (Probe<'_>, impl Fn(&V, X) -> E + Sync),
        density: (Probe<'_>, impl Fn(&V, X) -> B + Sync),
        weight: (Probe<'_>, impl Fn(&V, X) -> W + Sync),
    ) -> Result<Fit, Failure> {
        self.check_estimate(eval, density, Some(weight))
    }

    fn check_estimate<X: Shareable, B: Arguments, E: Arguments, W: Arguments>(
        self,
        (eval, of_eval): (Probe<'_>, impl Fn(&V, X) -> E + Sync),
        (density, of_density): (Probe<'_>, impl Fn(&V, X) -> B + Sync),
        weight: Option<(Probe<'_>, impl Fn(&V, X) -> W + Sync)>,
    ) -> Result<Fit, Failure> {
        let (of_density, of_eval) = (&made(of_density), &made(of_eval));
        let (weight, of_weight) = weight.unzip();
        let of_weight = of_weight.map(made);
        let mut others = vec![
            Other { probe: density, shapes: B::shapes(), made: of_density },
            Other { probe: eval, shapes: E::shapes(), made: of_eval },
        ];
        if let (Some(probe), Some(made)) = (weight, &of_weight) {
            others.push(Other { probe, shapes: W::shapes(), made });
        }
        self.with_sampler(|sampler| sampler.estimates(&others, &X::shape()))
    }

    /// Returns the probability that [`follows`](Self::follows) rejects samples with the density `alternative`.
    /// `alternative` takes the same arguments as `density`. This method asserts nothing.
    ///
    /// The sampler's own samples determine the cells of the chi-square test. Karat computes the probability from
    /// a non-central chi-square distribution.
    ///
    /// ```no_run
    /// use glam::{Vec2, Vec3};
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// let uniform = SHADERS.function("sampling::uniform_hemisphere_pdf");
    /// let power = SHADERS
    ///     .function("sampling::cosine_hemisphere")
    ///     .sampled_over(Just(()), |(), u: Vec2| u)
    ///     .power_against(SHADERS.function("sampling::cosine_hemisphere_pdf"), |(), l: Vec3| l, uniform)?;
    /// println!("a uniform sampler would be found: {power:?}");
    /// # Ok::<(), karat::check::Failure>(())
    /// ```
    ///
    /// # Errors
    /// Returns the failure if Karat can't judge the densities.
    pub fn power_against<X: Shareable, B: Arguments>(
        &self,
        density: Probe<'_>,
        arguments: impl Fn(&V, X) -> B + Sync,
        alternative: Probe<'_>,
    ) -> Result<Power, Failure> {
        let made = &made(arguments);
        let others = [density, alternative].map(|probe| Other { probe, shapes: B::shapes(), made });
        self.with_sampler(|sampler| sampler.power(&others, &X::shape()))
    }
}

impl Sampled<'_, '_> {
    /// Checks that samples follow the density `others[0]`.
    fn follows(self, others: &[Other<'_>], point: &Shape) -> Result<Fit, Failure> {
        let settings = self.settings;
        let text = format!("{} on {}", others[0].probe.name, settings.support);
        let hypothesis = Hypothesis { check: "follows", text, tests: settings.tests() };
        let expect = |functions: &Functions<'_>| self.expect_density(functions, point);
        conclude(self, &hypothesis, others, &expect, &mut |functions, configuration| {
            Run { functions, sampler: self, others, configuration }.judge(false)
        })
    }

    /// Checks that samples follow the density `others[0]`, and estimate the integral of `others[1]`. If there is an
    /// `others[2]`, checks that this function returns the samples' weights.
    fn estimates(self, others: &[Other<'_>], point: &Shape) -> Result<Fit, Failure> {
        let settings = self.settings;
        let (density, eval) = (&others[0].probe.name, &others[1].probe.name);
        let text = format!("integral of {eval} with density {density} on {}", settings.support);
        // A reflectance has up to three components. The mean of each component is a separate statistical test.
        let hypothesis = Hypothesis { check: "estimates", text, tests: settings.tests() + 3 };
        let expect = |functions: &Functions<'_>| {
            self.expect_density(functions, point)?;
            let eval = &functions.others[1];
            let scalars = eval.scalars();
            if settings.support.components() != 3 {
                return Err(Mismatch::NoDirections(settings.support).of(eval.function()));
            }
            if scalars.len() > 3 || !scalars.into_iter().all(Scalar::is_float) {
                let (result, wanted) =
                    (eval.function().result.clone(), "but this check needs one to three floats");
                return Err(Mismatch::Unsuited { result, wanted }.of(eval.function()));
            }
            functions.others.get(2).map_or(Ok(()), |weight| {
                weight.expect_result(&eval.function().result, "eval returns")
            })
        };
        conclude(self, &hypothesis, others, &expect, &mut |functions, configuration| {
            Run { functions, sampler: self, others, configuration }.judge(true)
        })
    }

    /// Returns the probability that [`follows`](Self::follows) rejects samples of the alternative density `others[1]`:
    /// the smallest such probability of all configurations and paths.
    fn power(self, others: &[Other<'_>], point: &Shape) -> Result<Power, Failure> {
        let (density, alternative) = (&others[0].probe.name, &others[1].probe.name);
        let text = format!("{density} against {alternative}");
        let hypothesis = Hypothesis { check: "power_against", text, tests: self.settings.tests() };
        let expect = |functions: &Functions<'_>| {
            self.expect_density(functions, point)?;
            expect_scalar(functions, 1)
        };
        let mut power = Power::none();
        let mut judge = |functions: &Functions<'_>, configuration: &Configuration<'_>| match (Run {
            functions,
            sampler: self,
            others,
            configuration,
        })
        .power()
        {
            Ok(found) => {
                power.add(found, configuration.value);
                Ok(Judgement::fitting())
            }
            Err(Stop::Failure(failure)) => Err(failure),
            Err(Stop::Finding(finding)) => Ok(Judgement::outright(finding)),
        };
        let sampler = Self { recorded: false, ..self };
        conclude(sampler, &hypothesis, others, &expect, &mut judge)?;
        Ok(power)
    }

    /// Returns an error if the sampler and the density don't return the types that the support needs. `given` is the
    /// type of the points that the density takes.
    fn expect_density(self, functions: &Functions<'_>, given: &Shape) -> Result<(), Failure> {
        functions.sampler().expect_random(self.random)?;
        let support = self.settings.support;
        let point = match support.components() {
            1 => Shape::Scalar(Scalar::F32),
            size => Shape::Vector { size: if size == 2 { 2 } else { 3 }, scalar: Scalar::F32 },
        };
        functions.sampler.expect_result(&point, &format!("a point of {support} is"))?;
        if *given != point {
            let mismatch = Mismatch::Point { given: given.clone(), support, point };
            return Err(mismatch.of(functions.others[0].function()));
        }
        expect_scalar(functions, 0)
    }
}

fn expect_scalar(functions: &Functions<'_>, which: usize) -> Result<(), Failure> {
    functions.others[which].expect_result(&Shape::Scalar(Scalar::F32), "a density is")
}

/// The type of the argument `weight` in checks without weights, which pass `None`.
type Unweighted<'a, V, X> = (Probe<'a>, fn(&V, X) -> f32);
