//! The power of checks of samplers: the probability that a check rejects a sampler with a given error.

use super::statistic::{Numbers, number_of};
use super::{Sampled, Sampling};
use crate::check::{Check, Failure};
use crate::domain::Held;
use crate::stats::{Mean, Moments, kolmogorov_power, mean_power};
use crate::value::{Arguments, Shareable};

/// The power of a check: the probability that the check rejects samples of an alternative distribution.
///
/// ```
/// # use karat::prelude::*;
/// let package = Package::from_source("m", "fn uniform(u: f32) -> f32 { return u; }");
/// let sampler = package.function("uniform").sampled_over(Just(()), |(), u: f32| u);
/// let power = sampler.mean_power_against(|x: f32| x.into(), |()| 0.5, |()| 0.51, 1e-6)?;
/// println!("at least {} (of {})", power.least, power.configuration);
/// # Ok::<(), karat::check::Failure>(())
/// ```
#[derive(Clone, Debug)]
pub struct Power {
    /// The smallest power of all configurations on all paths.
    pub least: f64,
    /// The configuration with the smallest power.
    pub configuration: String,
}

impl Power {
    pub(super) fn none() -> Self {
        Self { least: f64::INFINITY, configuration: String::new() }
    }

    /// Adds the power for one configuration. NaN counts as the smallest power.
    pub(super) fn add(&mut self, power: f64, configuration: &Held) {
        if !(power >= self.least) {
            *self = Self { least: power, configuration: configuration.shown() };
        }
    }
}

impl<V, U, A, F> Check<'_, Sampling<V, U, A, F>>
where
    V: 'static,
    U: Shareable,
    A: Arguments,
    F: Fn(&V, U) -> A + Sync,
{
    /// Returns the probability that [`has_mean`](Self::has_mean) rejects a sampler with the mean `alternative`
    /// and the same variance as this sampler. This method asserts nothing.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let package = Package::from_source("m", "fn uniform(u: f32) -> f32 { return u; }");
    /// let sampler = package.function("uniform").sampled_over(Just(()), |(), u: f32| u);
    /// // Would the check find a mean of 0.51 instead of 0.5?
    /// let power = sampler.mean_power_against(|x: f32| x.into(), |()| 0.5, |()| 0.51, 1e-6)?;
    /// assert!(power.least > 0.99);
    /// # Ok::<(), karat::check::Failure>(())
    /// ```
    ///
    /// # Errors
    /// Returns the failure if Karat can't judge the samples.
    pub fn mean_power_against<X: Shareable>(
        &self,
        of: impl Fn(X) -> f64 + Sync,
        expected: impl Fn(&V) -> f64,
        alternative: impl Fn(&V) -> f64,
        slack: f64,
    ) -> Result<Power, Failure> {
        let power = std::cell::RefCell::new(Power::none());
        let numbers = Numbers {
            check: "mean_power_against",
            text: "power of the mean".to_owned(),
            shape: X::shape(),
            of: &number_of(of),
        };
        self.with_sampler(|sampler| {
            numbers.judge(Sampled { recorded: false, ..sampler }, &|value, verdict| {
                let expected = expected(value.get());
                let difference = alternative(value.get()) - expected;
                verdict(&mut |numbers, _, threshold| {
                    let mut moments = Moments::default();
                    numbers.iter().for_each(|number| moments.add(*number));
                    let Mean { error, .. } = Mean::of(&moments, expected, slack)?;
                    let found = mean_power(difference, error, slack, threshold)?;
                    power.borrow_mut().add(found, value);
                    Ok(())
                })
            })
        })?;
        Ok(power.into_inner())
    }

    /// Returns a lower bound for the probability that [`has_distribution`](Self::has_distribution) rejects samples with
    /// the distribution function `alternative`. This method asserts nothing. Karat compares the functions
    /// `distribution` and `alternative` at the sampler's own samples.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let package = Package::from_source("m", "fn uniform(u: f32) -> f32 { return u; }");
    /// let sampler = package.function("uniform").sampled_over(Just(()), |(), u: f32| u);
    /// let uniform = |_: &(), x: f64| x.clamp(0.0, 1.0);
    /// let squared = |_: &(), x: f64| x.clamp(0.0, 1.0).powi(2);
    /// let power = sampler.distribution_power_against(|x: f32| x.into(), uniform, squared, 1e-6)?;
    /// assert!(power.least > 0.99);
    /// # Ok::<(), karat::check::Failure>(())
    /// ```
    ///
    /// # Errors
    /// Returns the failure if Karat can't judge the samples, or a function returns something that isn't a probability.
    pub fn distribution_power_against<X: Shareable>(
        &self,
        of: impl Fn(X) -> f64 + Sync,
        distribution: impl Fn(&V, f64) -> f64,
        alternative: impl Fn(&V, f64) -> f64,
        slack: f64,
    ) -> Result<Power, Failure> {
        let power = std::cell::RefCell::new(Power::none());
        let numbers = Numbers {
            check: "distribution_power_against",
            text: "power of the distribution".to_owned(),
            shape: X::shape(),
            of: &number_of(of),
        };
        self.with_sampler(|sampler| {
            numbers.judge(Sampled { recorded: false, ..sampler }, &|value, verdict| {
                verdict(&mut |numbers, _, threshold| {
                    let at = |number: &f64| {
                        let configuration = value.get();
                        (distribution(configuration, *number), alternative(configuration, *number))
                    };
                    let points: Vec<(f64, f64)> = numbers.iter().map(at).collect();
                    let found = kolmogorov_power(&points, numbers.len() as f64, slack, threshold)?;
                    power.borrow_mut().add(found, value);
                    Ok(())
                })
            })
        })?;
        Ok(power.into_inner())
    }
}
