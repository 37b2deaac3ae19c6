//! Numbers made of samples: their mean, and their distribution in one dimension.

use super::calls::{STRIDE, draw};
use super::density::Offence;
use super::{Assertion, Configuration, Finding, Fit, Functions, Judgement, Samples};
use super::{conclude, fit_or_panic};
use crate::check::{Failure, Recording};
use crate::domain::Domain;
use crate::stats::{Kolmogorov, Mean, Moments, NoVerdict};
use crate::value::{Arguments, Shareable};

/// What is asserted of the numbers of a configuration.
type Verdict<'v> = &'v mut dyn FnMut(&[f64], &mut Judgement, f64) -> Result<(), NoVerdict>;

impl<D, U, A, F> Samples<'_, D, U, A, F>
where
    D: Domain,
    U: Shareable,
    A: Arguments,
    F: Fn(&D::Value, U) -> A + Sync,
{
    /// Checks the mean of a number made of each sample, by its standard error. `slack` is what of
    /// a difference isn't counted: the rounding of the samples and the error of the expectation.
    ///
    /// ```no_run
    /// # use glam::{Vec2, Vec3};
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// SHADERS
    ///     .function("sampling::cosine_hemisphere")
    ///     .sampled_over(Just(()), |_, u: Vec2| u)
    ///     .has_mean("cos", |l: Vec3| l.z.into(), |_| 2.0 / 3.0, 1e-6);
    /// ```
    ///
    /// # Panics
    /// With the [`Failure`], if a configuration is rejected or has no verdict.
    #[track_caller]
    pub fn has_mean<X: Shareable>(
        self,
        name: &str,
        of: impl Fn(X) -> f64 + Sync,
        expected: impl Fn(&D::Value) -> f64,
        slack: f64,
    ) -> Fit {
        fit_or_panic(self.mean(name, of, expected, slack, Recording::On))
    }

    /// [`has_mean`](Self::has_mean) without the panic.
    ///
    /// # Errors
    /// If a configuration is rejected or has no verdict.
    pub fn try_has_mean<X: Shareable>(
        self,
        name: &str,
        of: impl Fn(X) -> f64 + Sync,
        expected: impl Fn(&D::Value) -> f64,
        slack: f64,
    ) -> Result<Fit, Failure> {
        self.mean(name, of, expected, slack, Recording::Off)
    }

    fn mean<X: Shareable>(
        self,
        name: &str,
        of: impl Fn(X) -> f64 + Sync,
        expected: impl Fn(&D::Value) -> f64,
        slack: f64,
        recording: Recording,
    ) -> Result<Fit, Failure> {
        self.numbers("has_mean", format!("mean of {name}"), of, recording, |value, verdict| {
            let expected = expected(value);
            verdict(&mut |numbers, judgement, threshold| {
                let mut moments = Moments::default();
                numbers.iter().for_each(|number| moments.add(*number));
                let Mean { mean, error, p, .. } = Mean::of(&moments, expected, slack)?;
                let of = format!("the mean of {name}");
                judgement.test(p, threshold, || Finding::Mean { of, mean, error, expected, p });
                Ok(())
            })
        })
    }

    /// Checks the distribution of a number made of each sample, by Kolmogorov's distance to a
    /// distribution function: of a configuration and a number, the probability of at most that
    /// number. `slack` is what of the distance isn't counted: the error of samples and function.
    ///
    /// # Panics
    /// With the [`Failure`], if a configuration is rejected or has no verdict.
    #[track_caller]
    pub fn has_distribution<X: Shareable>(
        self,
        name: &str,
        of: impl Fn(X) -> f64 + Sync,
        distribution: impl Fn(&D::Value, f64) -> f64,
        slack: f64,
    ) -> Fit {
        fit_or_panic(self.distribution(name, of, distribution, slack, Recording::On))
    }

    /// [`has_distribution`](Self::has_distribution) without the panic.
    ///
    /// # Errors
    /// If a configuration is rejected or has no verdict.
    pub fn try_has_distribution<X: Shareable>(
        self,
        name: &str,
        of: impl Fn(X) -> f64 + Sync,
        distribution: impl Fn(&D::Value, f64) -> f64,
        slack: f64,
    ) -> Result<Fit, Failure> {
        self.distribution(name, of, distribution, slack, Recording::Off)
    }

    fn distribution<X: Shareable>(
        self,
        name: &str,
        of: impl Fn(X) -> f64 + Sync,
        distribution: impl Fn(&D::Value, f64) -> f64,
        slack: f64,
        recording: Recording,
    ) -> Result<Fit, Failure> {
        let check = "has_distribution";
        self.numbers(check, format!("distribution of {name}"), of, recording, |value, verdict| {
            verdict(&mut |numbers, judgement, threshold| {
                let of_number = |number| distribution(value, number);
                let test = Kolmogorov::of(&mut numbers.to_vec(), of_number, slack)?;
                let Kolmogorov { distance, at, p } = test;
                let of = name.to_owned();
                judgement.test(p, threshold, || Finding::Distribution { of, distance, at, p });
                Ok(())
            })
        })
    }

    /// Makes the numbers of each configuration and hands them to a verdict.
    pub(super) fn numbers<X: Shareable>(
        &self,
        check: &'static str,
        text: String,
        of: impl Fn(X) -> f64 + Sync,
        recording: Recording,
        judge: impl Fn(
            &D::Value,
            &mut dyn FnMut(Verdict<'_>) -> Result<Judgement, Failure>,
        ) -> Result<Judgement, Failure>,
    ) -> Result<Fit, Failure> {
        let Self { plan, settings, arguments, .. } = self;
        let assertion = Assertion { check, text, tests: 1 };
        let expect = |functions: &Functions<'_, '_, D>| {
            functions.sampler(0, 0).expect_random::<U>()?;
            functions.sampler.expect_result(&X::shape(), "the number is made of", None)
        };
        let functions = (A::shapes(), Vec::new());
        conclude(
            plan,
            settings,
            &assertion,
            functions,
            recording,
            expect,
            |functions, configuration| {
                let Configuration { value, index, path, seed, threshold } = *configuration;
                let sampler = functions.sampler(path, seed);
                let samples = usize::try_from(settings.samples).unwrap_or(usize::MAX);
                let (mut numbers, mut not_finite) = (Vec::new(), Offence::default());
                for first in (0..samples).step_by(STRIDE) {
                    let count = STRIDE.min(samples - first);
                    let lanes = draw(seed, first, count, |u| arguments(value, u));
                    let results = sampler.call(&lanes, count)?;
                    let width = lanes.len() / count;
                    for (index, result) in results.chunks_exact(sampler.words()).enumerate() {
                        let number = of(X::load(&mut result.iter()));
                        if number.is_finite() {
                            numbers.push(number);
                        } else {
                            not_finite
                                .add(|| sampler.shown(&lanes[index * width..][..width], result));
                        }
                    }
                }
                let finding = not_finite.finding(|count, call| Finding::NotFinite { count, call });
                if let Some(finding) = finding {
                    return Ok(Judgement {
                        findings: vec![finding],
                        p: 0.0,
                        ..Judgement::fitting()
                    });
                }
                judge(value, &mut |verdict| {
                    let mut judgement = Judgement::fitting();
                    let judged = verdict(&numbers, &mut judgement, threshold);
                    judged.map(|()| judgement).map_err(|none| Failure::Evidence {
                        function: functions.sampler.probed.function.path.clone(),
                        reason: none.to_string(),
                        case: index,
                        configuration: format!("{value:?}"),
                    })
                })
            },
        )
    }
}
