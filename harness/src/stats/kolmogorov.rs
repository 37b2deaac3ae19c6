//! Kolmogorov's test of one-dimensional samples against a distribution function.

use super::tail::kolmogorov_tail;
use super::{NoVerdict, probability};

/// Fewer samples don't follow Stephens' approximation of the tail closely enough.
const FEWEST: u64 = 40;

/// How far the distribution function of samples is from what it should be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kolmogorov {
    /// The largest difference of the two functions.
    pub distance: f64,
    /// The sample at which it is.
    pub at: f64,
    /// Probability of so large a distance by chance.
    pub p: f64,
}

impl Kolmogorov {
    /// Compares samples, which are sorted by this, with a distribution function. `slack` is what
    /// of the distance isn't counted: the error of samples and function.
    ///
    /// # Errors
    /// If there are fewer than 40 samples, or a sample or the function isn't a number in range.
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
        samples.sort_unstable_by(f64::total_cmp);
        let count = found as f64;
        let (mut distance, mut at) = (0.0, samples[0]);
        for (index, sample) in samples.iter().enumerate() {
            let value = distribution(*sample);
            if !(-1e-9..=1.0 + 1e-9).contains(&value) {
                return Err(NoVerdict::NotANumber { what: "the distribution function", value });
            }
            let below = value - index as f64 / count;
            let above = (index + 1) as f64 / count - value;
            let larger = below.max(above);
            if larger > distance {
                (distance, at) = (larger, *sample);
            }
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
        // 100 samples at the middles of cells are 1/200 off everywhere, and one is moved up.
        let middles = || (0..100).map(|i| (f64::from(i) + 0.5) / 100.0).collect::<Vec<_>>();
        let test = Kolmogorov::of(&mut middles(), |x| x, 0.0).expect("100 samples");
        assert!((test.distance - 0.005).abs() < 1e-12 && test.p > 0.999);
        let squeezed = Kolmogorov::of(&mut middles(), |x| x * x, 0.0).expect("100 samples");
        assert!((squeezed.distance - 0.255).abs() < 1e-3 && squeezed.p < 1e-5, "{squeezed:?}");
    }

    #[test]
    fn without_evidence_there_is_no_verdict() {
        assert!(matches!(
            Kolmogorov::of(&mut [0.5; 39], |x| x, 0.0),
            Err(NoVerdict::TooFew { .. })
        ));
        let mut samples = [0.5; 50];
        assert!(Kolmogorov::of(&mut samples, |_| f64::NAN, 0.0).is_err());
        samples[3] = f64::NAN;
        assert!(Kolmogorov::of(&mut samples, |x| x, 0.0).is_err());
    }
}
