//! Compares the mean of samples with the expected mean, in units of the standard error of the mean.

use super::tail::normal_tail;
use super::{NoVerdict, probability};

/// The smallest number of samples for which the mean is close to normally distributed.
const FEWEST: u64 = 100;

/// The number of samples that the test needs for each unit of squared skewness. Source: Cochran 1977, section 2.15.
const PER_SKEWNESS: f64 = 25.0;

/// The count, mean, variance and skewness of a stream of numbers (Welford 1962). You can divide a stream into parts and
/// merge the moments of the parts (Chan et al. 1983, Pebay 2008). However you divide the stream, the result is the same
/// except for rounding.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moments {
    count: u64,
    mean: f64,
    squares: f64,
    cubes: f64,
}

impl Moments {
    /// Adds a number.
    pub fn add(&mut self, value: f64) {
        self.count += 1;
        let (n, before) = (self.count as f64, value - self.mean);
        let step = before / n;
        let square = before * step * (n - 1.0);
        self.mean += step;
        self.cubes += square * step * (n - 2.0) - 3.0 * step * self.squares;
        self.squares += square;
    }

    /// The moments of both streams together.
    #[must_use]
    pub fn merge(self, other: Self) -> Self {
        let count = self.count + other.count;
        if count == 0 {
            return self;
        }
        let (a, b, n) = (self.count as f64, other.count as f64, count as f64);
        let difference = other.mean - self.mean;
        let mean = self.mean + difference * b / n;
        let squares = self.squares + other.squares + difference * difference * a * b / n;
        let cubes = self.cubes
            + other.cubes
            + difference.powi(3) * a * b * (a - b) / (n * n)
            + 3.0 * difference * (a * other.squares - b * self.squares) / n;
        Self { count, mean, squares, cubes }
    }

    /// The number of values in the stream.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The mean of the values.
    #[must_use]
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// The estimated variance of the distribution from which the values come.
    #[must_use]
    pub fn variance(&self) -> f64 {
        self.squares / (self.count.max(2) - 1) as f64
    }

    /// The skewness of the values. It is 0 if all values are equal.
    #[must_use]
    pub fn skewness(&self) -> f64 {
        if self.squares == 0.0 {
            return 0.0;
        }
        (self.count as f64).sqrt() * self.cubes / self.squares.powf(1.5)
    }
}

/// The result of a test that compares a mean with the expected mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mean {
    /// The mean of the samples.
    pub mean: f64,
    /// The standard error of the mean.
    pub error: f64,
    /// The difference between the mean and the expected mean, minus the slack, in standard errors. It is 0 if the slack
    /// covers the difference.
    pub z: f64,
    /// The probability that chance causes a difference at least as large as `z`.
    pub p: f64,
}

impl Mean {
    /// Compares the mean with the expected mean. A difference up to `slack` doesn't count: `slack` covers the rounding
    /// of the samples and the error of the expected mean. Without a slack, samples that should all be equal would fail
    /// because of their rounding.
    ///
    /// # Errors
    /// Returns an error if there are fewer than 100 samples, if a number isn't finite, or if the slack is negative. If
    /// the mean differs from the expected mean, the result is also an error if a few samples dominate the mean, or if
    /// all samples are 0: the standard error can't be estimated from such samples.
    pub fn of(moments: &Moments, expected: f64, slack: f64) -> Result<Self, NoVerdict> {
        let found = moments.count;
        if found < FEWEST {
            return Err(NoVerdict::TooFew { found, needed: FEWEST });
        }
        let error = (moments.variance() / found as f64).sqrt();
        for (what, value) in [
            ("the mean", moments.mean),
            ("the standard error", error),
            ("the expected mean", expected),
        ] {
            if !value.is_finite() {
                return Err(NoVerdict::NotANumber { what, value });
            }
        }
        if !(slack >= 0.0 && slack.is_finite()) {
            return Err(NoVerdict::NotANumber { what: "the slack", value: slack });
        }
        let counted = (moments.mean - expected).abs() - slack;
        let skewness = moments.skewness();
        let unseen = error == 0.0 && moments.mean == 0.0;
        let skewed = PER_SKEWNESS * skewness * skewness > found as f64;
        if counted > 0.0 && (unseen || skewed) {
            let mean = moments.mean;
            return Err(NoVerdict::TooSkewed { found, mean, expected, skewness });
        }
        let z = if counted <= 0.0 { 0.0 } else { counted / error };
        Ok(Self { mean: moments.mean, error, z, p: probability(normal_tail(z))? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moments(values: impl IntoIterator<Item = f64>) -> Moments {
        let mut moments = Moments::default();
        values.into_iter().for_each(|value| moments.add(value));
        moments
    }

    #[test]
    fn merged_moments_equal_those_of_all_values() {
        let values: Vec<f64> = (0..1000).map(|i| 1e6 + f64::from(i % 37)).collect();
        let whole = moments(values.iter().copied());
        let parts = values.chunks(77).map(|part| moments(part.iter().copied()));
        let merged = parts.fold(Moments::default(), Moments::merge);
        assert_eq!(whole.count(), merged.count());
        assert!((whole.mean() - merged.mean()).abs() < 1e-6);
        assert!((whole.variance() - merged.variance()).abs() < 1e-6 * whole.variance());
        let variance = |n: f64| (n * n - 1.0) / 12.0; // of the uniform distribution of 0..n
        assert!((merged.variance() / variance(37.0) - 1.0).abs() < 0.01);
    }

    // Lesson 72
    #[test]
    fn a_mean_is_judged_by_its_error() {
        // 10,000 coin tosses have a standard error of 0.005.
        let coin = moments((0..10_000).map(|i| f64::from(i % 2)));
        let at = |expected| Mean::of(&coin, expected, 0.0).expect("10,000 samples");
        assert_eq!(at(0.5).p, 1.0);
        assert!((at(0.51).z - 2.0).abs() < 1e-3 && (at(0.51).p - 0.0455).abs() < 1e-4);
        assert!(Mean::of(&coin, 0.51, 0.01).expect("10,000 samples").p > 0.999);
        // Only the difference beyond the slack counts.
        let beyond = Mean::of(&coin, 0.53, 0.01).expect("10,000 samples");
        assert!((beyond.z - 4.0).abs() < 1e-3 && beyond.p < 1e-4, "{beyond:?}");
    }

    /// A rare event occurs in a few samples or in none, so the error of the mean can't be estimated from the samples.
    #[test]
    fn the_mean_of_a_rare_event_has_no_verdict() {
        let rare = |hits: u32| moments((0..65_536).map(|i| f64::from(u8::from(i < hits))));
        for hits in 0..=20 {
            assert!(Mean::of(&rare(hits), 1e-3, 0.0).is_err(), "{hits}");
        }
        let often = Mean::of(&rare(60), 1e-3, 0.0).expect("60 hits");
        assert!(often.z < 1.0, "{often:?}");
        assert!(Mean::of(&rare(300), 1e-3, 0.0).expect("300 hits").p < 1e-9);
        let merged = (0..8).map(|part| moments((0..100).map(|i| f64::from((i * part) % 11))));
        let merged = merged.fold(Moments::default(), Moments::merge);
        let whole =
            moments((0..8).flat_map(|part| (0..100).map(move |i| f64::from((i * part) % 11))));
        assert!((merged.skewness() - whole.skewness()).abs() < 1e-12);
        // An exponential distribution has the skewness 2.
        let exponential = moments((0..100_000).map(|i| -((f64::from(i) + 0.5) / 1e5).ln()));
        assert!((exponential.skewness() - 2.0).abs() < 0.02, "{}", exponential.skewness());
    }

    #[test]
    fn a_constant_sample_has_p_value_one_or_zero() {
        let ones = moments([1.0; 500]);
        assert_eq!(Mean::of(&ones, 1.0, 0.0).map(|test| test.p), Ok(1.0));
        assert_eq!(Mean::of(&ones, 1.001, 0.0).map(|test| test.p), Ok(0.0));
    }

    #[test]
    fn without_evidence_there_is_no_verdict() {
        assert!(Mean::of(&moments([1.0; 99]), 1.0, 0.0).is_err());
        assert!(Mean::of(&moments([f64::NAN; 200]), 1.0, 0.0).is_err());
        assert!(Mean::of(&moments([1.0; 200]), f64::NAN, 0.0).is_err());
        assert!(Mean::of(&moments([1.0; 200]), 1.0, f64::INFINITY).is_err());
    }
}
