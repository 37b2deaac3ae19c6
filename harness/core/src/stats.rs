//! Statistical tests of random samples. The tests run on the CPU, without a GPU.
//!
//! Each test compares observed values with expected values. Its result is a p-value: the probability that chance causes
//! a difference at least as large as the observed one. [`accepts`] decides if a p-value is large enough. If a test gets
//! too few samples, only one cell, or a value that isn't a number, its result is [`NoVerdict`], never a p-value of NaN.
//!
//! [`Cells`] divides the support of a density into the cells of a histogram. A pilot run of the sampler chooses the
//! cells so that all cells get about the same number of samples. The expected share of the samples in a cell is the
//! integral of the density over the cell, which [`integrate`] computes adaptively.

mod cells;
mod chi_square;
mod cubature;
mod gauss;
mod kolmogorov;
mod mean;
mod power;
mod support;
mod tail;

pub use cells::Cells;
pub use chi_square::{ChiSquare, POOLED};
pub use cubature::{CellIntegral, CubatureError, Rectangle, integrate};
pub use gauss::gauss_legendre;
pub use kolmogorov::Kolmogorov;
pub use mean::{Mean, Moments};
pub use power::{Rate, chi_square_power, kolmogorov_power, mean_power};
pub use support::{Place, Support};
pub use tail::{
    binomial_tail, chi_square_critical, chi_square_tail, kolmogorov_tail, noncentral_tail,
    normal_critical, normal_tail,
};

/// The reason why a statistical test has no p-value.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NoVerdict {
    /// There are too few samples for the approximation that the test uses.
    #[error("{found} samples are too few: the test needs at least {needed}")]
    TooFew {
        /// The number of samples.
        found: u64,
        /// The smallest number of samples that the test needs.
        needed: u64,
    },
    /// After cells with few samples were pooled, too few cells are left to compare.
    #[error(
        "after cells with few samples are pooled, the number of cells is {cells}, but the test needs at least 2"
    )]
    NoFreedom {
        /// The number of cells that are left. All pooled cells count as one cell.
        cells: usize,
    },
    /// The number of observed counts differs from the number of expected counts.
    #[error("{observed} cells have observed values, but {expected} cells have expected values")]
    Length {
        /// The number of cells with observed counts.
        observed: usize,
        /// The number of cells with expected counts.
        expected: usize,
    },
    /// The mean differs from the expected mean, but depends on very few of the samples, so the test can't estimate the
    /// mean's error.
    #[error(
        "the mean {mean:e} of {found} samples differs from the expected {expected:e}, but this mean depends on \
         too few samples (skewness {skewness:.0}) to judge the difference: take more samples, or draw \
         them where the function is large"
    )]
    TooSkewed {
        /// The number of samples.
        found: u64,
        /// The mean of the samples.
        mean: f64,
        /// The expected mean.
        expected: f64,
        /// The skewness of the samples.
        skewness: f64,
    },
    /// The test got a value that it can't use, such as NaN.
    #[error("{what} is {value}")]
    NotANumber {
        /// The name of the value in messages.
        what: &'static str,
        /// The value.
        value: f64,
    },
}

/// Checks if a p-value is at least `threshold`, so that the test passes. NaN is never accepted.
#[must_use]
pub fn accepts(p: f64, threshold: f64) -> bool {
    p >= threshold
}

/// The threshold for each of `tests` independent tests. With this threshold, the probability that at least one of the
/// tests rejects a true hypothesis is `significance`. Source: Sidak 1967.
#[must_use]
pub fn sidak(significance: f64, tests: u64) -> f64 {
    // 1 - (1 - s)^(1/m), computed without cancellation.
    -((-significance).ln_1p() / tests.max(1) as f64).exp_m1()
}

fn probability(value: f64) -> Result<f64, NoVerdict> {
    if (0.0..=1.0 + 1e-9).contains(&value) {
        return Ok(value.min(1.0)); // rounding may make a sum of tails larger than 1
    }
    Err(NoVerdict::NotANumber { what: "the p-value", value })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nan_is_never_accepted() {
        assert!(!accepts(f64::NAN, 0.01) && !accepts(0.5, f64::NAN) && accepts(0.01, 0.01));
        assert!(probability(f64::NAN).is_err() && probability(-0.1).is_err());
    }

    #[test]
    fn many_tests_keep_the_significance_of_one() {
        assert_eq!(sidak(0.01, 1), 0.01);
        for tests in [2_u64, 10, 1000, 1_000_000] {
            let threshold = sidak(0.01, tests);
            let any = 1.0 - (1.0 - threshold).powf(tests as f64);
            assert!((any - 0.01).abs() < 1e-9, "{tests}: {any}");
            assert!(threshold >= 0.01 / tests as f64, "above Bonferroni's");
        }
    }
}
