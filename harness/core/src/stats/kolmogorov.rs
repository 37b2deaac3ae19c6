//! Kolmogorov's test: compares one-dimensional samples with a distribution function.

use super::tail::kolmogorov_tail;
use super::{NoVerdict, probability};

/// The smallest number of samples for which Stephens' approximation of the tail is close enough.
const FEWEST: u64 = 40;

/// The result of Kolmogorov's test: the difference between the samples' distribution function and the expected one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kolmogorov {
    /// The largest difference between the two distribution functions.
    pub distance: f64,
    /// The sample at which the difference is largest.
    pub at: f64,
    /// The probability that chance causes a difference at least as large as `distance` minus the slack.
    pub p: f64,
}

impl Kolmogorov {
    /// Sorts the samples, and compares them with the expected distribution function. A difference up to `slack` doesn't
    /// count: `slack` covers the errors of the samples and of the expected function. If the expected function has
    /// steps, the p-value may be too large, but not too small (Conover 1972).
    ///
    /// # Errors
    /// Returns an error if there are fewer than 40 samples, if a sample isn't a number, if a value of the function
    /// isn't between 0 and 1, or if `slack` isn't in [0, 1).
    pub fn of(
        samples: &mut [f64],
        distribution: impl Fn(f64) -> f64,
        slack: f64,
    ) -> Result<Self, NoVerdict> {
        let found = samples.len() as u64;
        if found < FEWEST {
            return Err(NoVerdict::TooFew { found, needed: FEWEST });
        }
        if let Some(value) = samples.iter().find(|value| value.is_nan()) {
            return Err(NoVerdict::NotANumber { what: "a sample", value: *value });
        }
        if !(0.0..1.0).contains(&slack) {
            return Err(NoVerdict::NotANumber { what: "the slack", value: slack });
        }
        samples.sort_unstable_by(f64::total_cmp);
        let count = found as f64;
        let (mut distance, mut at) = (0.0, samples[0]);
        let mut before = 0;
        for ties in samples.chunk_by(|a, b| a == b) {
            let sample = ties[0];
            // Both functions may have a step at the sample, so the code compares them just before and at the sample.
            let own = [distribution(sample.next_down()), distribution(sample)];
            let counted = [before, before + ties.len()].map(|index| index as f64 / count);
            for (value, share) in own.into_iter().zip(counted) {
                if !(-1e-9..=1.0 + 1e-9).contains(&value) {
                    return Err(NoVerdict::NotANumber { what: "the distribution function", value });
                }
                let difference = (value - share).abs();
                if difference > distance {
                    (distance, at) = (difference, sample);
                }
            }
            before += ties.len();
        }
        let counted = (distance - slack).max(0.0);
        Ok(Self { distance, at, p: probability(kolmogorov_tail(counted, count))? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_distance_is_taken_on_both_sides_of_a_step() {
        // Each of the 100 samples is in the middle of a cell, so the distance is 1/200 everywhere. Then the test moves
        // one sample up.
        let middles = || (0..100).map(|i| (f64::from(i) + 0.5) / 100.0).collect::<Vec<_>>();
        let test = Kolmogorov::of(&mut middles(), |x| x, 0.0).expect("100 samples");
        assert!((test.distance - 0.005).abs() < 1e-12 && test.p > 0.999);
        let squeezed = Kolmogorov::of(&mut middles(), |x| x * x, 0.0).expect("100 samples");
        assert!((squeezed.distance - 0.255).abs() < 1e-3 && squeezed.p < 1e-5, "{squeezed:?}");
    }

    #[test]
    fn a_fair_die_passes_and_a_loaded_die_fails() {
        let throws = |fair: bool| -> Vec<f64> {
            (0..6000).map(|i| f64::from(if fair { i % 6 } else { (i % 7) % 6 })).collect()
        };
        let steps = |x: f64| ((x.floor() + 1.0) / 6.0).clamp(0.0, 1.0);
        let test = Kolmogorov::of(&mut throws(true), steps, 0.0).expect("6000 throws");
        assert!(test.distance < 1e-12 && test.p > 0.999, "{test:?}");
        let test = Kolmogorov::of(&mut throws(false), steps, 0.0).expect("6000 throws");
        assert!(test.p < 1e-9, "{test:?}");
    }

    #[test]
    fn without_evidence_there_is_no_verdict() {
        assert!(matches!(
            Kolmogorov::of(&mut [0.5; 39], |x| x, 0.0),
            Err(NoVerdict::TooFew { .. })
        ));
        let mut samples = [0.5; 50];
        assert!(Kolmogorov::of(&mut samples, |_| f64::NAN, 0.0).is_err());
        for slack in [f64::NAN, f64::INFINITY, 1.0, 2.0, -1.0] {
            assert!(Kolmogorov::of(&mut samples, |x| x, slack).is_err(), "{slack}");
        }
        samples[3] = f64::NAN;
        assert!(Kolmogorov::of(&mut samples, |x| x, 0.0).is_err());
    }
}
