//! Verbs that compute a number from each sample: `has_mean` checks the mean of the numbers, `has_distribution`
//! their distribution.

use super::calls::{STRIDE, draw};
use super::conclude::{Functions, conclude};
use super::judgement::{Judgement, Offence};
use super::{Configuration, Finding, Fit, Hypothesis, Sampled, Sampling};
use crate::check::{Check, Failure};
use crate::domain::Held;
use crate::run::or_panic;
use crate::stats::{Kolmogorov, Mean, Moments, NoVerdict};
use crate::value::{Arguments, Shape, Shareable};

/// A function that judges the numbers from a configuration's samples.
type Verdict<'v> = &'v mut dyn FnMut(&[f64], &mut Judgement, f64) -> Result<(), NoVerdict>;

/// A function that judges a configuration. The second argument is a function that computes the configuration's
/// numbers and passes them to a [`Verdict`] function.
type JudgeNumbers<'j> = &'j dyn Fn(
    &Held,
    &mut dyn FnMut(Verdict<'_>) -> Result<Judgement, Failure>,
) -> Result<Judgement, Failure>;

/// A verb that computes a number from each sample.
pub(super) struct Numbers<'n> {
    pub(super) check: &'static str,
    pub(super) text: String,
    pub(super) shape: Shape,
    /// A function that computes the number from the words of a sample.
    pub(super) of: &'n (dyn Fn(&[u32]) -> f64 + Sync),
}

/// Turns a function that takes a sample into a function that takes the sample's words.
pub(super) fn number_of<X: Shareable>(
    of: impl Fn(X) -> f64 + Sync,
) -> impl Fn(&[u32]) -> f64 + Sync {
    move |words| of(X::load(&mut words.iter()))
}

impl<V, U, A, F> Check<'_, Sampling<V, U, A, F>>
where
    V: 'static,
    U: Shareable,
    A: Arguments,
    F: Fn(&V, U) -> A + Sync,
{
    /// Computes a number from each sample, and compares the mean of these numbers with the expected mean. The check
    /// measures the difference between the two means in standard errors. The check ignores a difference of up to
    /// `slack`, which allows for the samples' rounding and the error of the expected mean.
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
    /// Panics with the [`Failure`] if the check rejects a configuration, or can't judge a configuration.
    #[track_caller]
    pub fn has_mean<X: Shareable>(
        self,
        name: &str,
        of: impl Fn(X) -> f64 + Sync,
        expected: impl Fn(&V) -> f64,
        slack: f64,
    ) -> Fit {
        or_panic(self.try_has_mean(name, of, expected, slack))
    }

    /// Runs [`has_mean`](Self::has_mean), but returns the failure instead of panicking.
    ///
    /// # Errors
    /// Returns the failure if the check rejects a configuration, or can't judge a configuration.
    pub fn try_has_mean<X: Shareable>(
        self,
        name: &str,
        of: impl Fn(X) -> f64 + Sync,
        expected: impl Fn(&V) -> f64,
        slack: f64,
    ) -> Result<Fit, Failure> {
        let text = format!("mean of {name}");
        let of = &number_of(of);
        let numbers = Numbers { check: "has_mean", text, shape: X::shape(), of };
        let expected = |value: &Held| expected(value.get());
        self.with_sampler(|sampler| numbers.mean(sampler, name, &expected, slack))
    }

    /// Computes a number from each sample, and checks the Kolmogorov distance between the distribution of these numbers
    /// and a distribution function. The distribution function takes a configuration and a number `x`, and returns the
    /// probability that a sample's number is at most `x`. The check ignores a distance of up to `slack`, which allows
    /// for the errors of the samples and of the distribution function.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let package = Package::from_source("m", "fn root(u: f32) -> f32 { return sqrt(u); }");
    /// let sampler = package.function("root").sampled_over(Just(()), |(), u: f32| u);
    /// sampler.has_distribution("x", |x: f32| x.into(), |(), x| x.clamp(0.0, 1.0).powi(2), 1e-6);
    /// ```
    ///
    /// # Panics
    /// Panics with the [`Failure`] if the check rejects a configuration, or can't judge a configuration.
    #[track_caller]
    pub fn has_distribution<X: Shareable>(
        self,
        name: &str,
        of: impl Fn(X) -> f64 + Sync,
        distribution: impl Fn(&V, f64) -> f64,
        slack: f64,
    ) -> Fit {
        or_panic(self.try_has_distribution(name, of, distribution, slack))
    }

    /// Runs [`has_distribution`](Self::has_distribution), but returns the failure instead of panicking.
    ///
    /// # Errors
    /// Returns the failure if the check rejects a configuration, or can't judge a configuration.
    pub fn try_has_distribution<X: Shareable>(
        self,
        name: &str,
        of: impl Fn(X) -> f64 + Sync,
        distribution: impl Fn(&V, f64) -> f64,
        slack: f64,
    ) -> Result<Fit, Failure> {
        let text = format!("distribution of {name}");
        let of = &number_of(of);
        let numbers = Numbers { check: "has_distribution", text, shape: X::shape(), of };
        let share = |value: &Held, number| distribution(value.get(), number);
        self.with_sampler(|sampler| numbers.distribution(sampler, name, &share, slack))
    }
}

impl Numbers<'_> {
    fn mean(
        &self,
        sampler: Sampled<'_, '_>,
        name: &str,
        expected: &dyn Fn(&Held) -> f64,
        slack: f64,
    ) -> Result<Fit, Failure> {
        self.judge(sampler, &|value, verdict| {
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

    fn distribution(
        &self,
        sampler: Sampled<'_, '_>,
        name: &str,
        distribution: &dyn Fn(&Held, f64) -> f64,
        slack: f64,
    ) -> Result<Fit, Failure> {
        self.judge(sampler, &|value, verdict| {
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

    /// Computes the numbers of each configuration, and judges them with `judge`.
    pub(super) fn judge(
        &self,
        sampler: Sampled<'_, '_>,
        judge: JudgeNumbers<'_>,
    ) -> Result<Fit, Failure> {
        let hypothesis = Hypothesis { check: self.check, text: self.text.clone(), tests: 1 };
        let expect = |functions: &Functions<'_>| {
            functions.sampler().expect_random(sampler.random)?;
            functions.sampler.expect_result(&self.shape, "the test's closure takes")
        };
        conclude(sampler, &hypothesis, &[], &expect, &mut |functions, configuration| {
            let Configuration { value, index, threshold, .. } = *configuration;
            let (numbers, not_finite) = self.of_samples(sampler, functions, configuration)?;
            let finding = not_finite.finding(|count, call| Finding::NotFinite { count, call });
            if let Some(finding) = finding {
                return Ok(Judgement { findings: vec![finding], p: 0.0, ..Judgement::fitting() });
            }
            judge(value, &mut |verdict| {
                let mut judgement = Judgement::fitting();
                let judged = verdict(&numbers, &mut judgement, threshold);
                judged.map(|()| judgement).map_err(|none| Failure::Evidence {
                    function: functions.sampler.function().name.clone(),
                    reason: none.to_string(),
                    case: index,
                    configuration: value.shown(),
                })
            })
        })
    }

    /// Computes the numbers from a configuration's samples. Also returns how many numbers aren't finite, and the first
    /// call with such a number.
    fn of_samples(
        &self,
        Sampled { settings, random, arguments, .. }: Sampled<'_, '_>,
        functions: &Functions<'_>,
        Configuration { value, seed, .. }: &Configuration<'_>,
    ) -> Result<(Vec<f64>, Offence), Failure> {
        let sampler = functions.sampler();
        let random = random.lanes();
        let samples = usize::try_from(settings.samples).unwrap_or(usize::MAX);
        let (mut numbers, mut not_finite) = (Vec::new(), Offence::default());
        for first in (0..samples).step_by(STRIDE) {
            let count = STRIDE.min(samples - first);
            let given = |random: &[u32], lanes: &mut Vec<u32>| arguments(value, random, lanes);
            let lanes = draw(*seed, first, count, &random, &given);
            let results = sampler.call(&lanes, count)?;
            let width = lanes.len() / count;
            for (index, result) in results.chunks_exact(sampler.words()).enumerate() {
                let number = (self.of)(result);
                if number.is_finite() {
                    numbers.push(number);
                } else {
                    not_finite.add(|| sampler.shown(&lanes[index * width..][..width], result));
                }
            }
        }
        Ok((numbers, not_finite))
    }
}
