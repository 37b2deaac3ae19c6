//! Computes the power of a test: the probability that it finds a given fault. Also counts how often a test rejects.

use super::chi_square::POOLED;
use super::tail::{
    chi_square_critical, critical, kolmogorov_tail, noncentral_tail, normal_critical, normal_upper,
};
use super::{NoVerdict, probability};

/// The probability that a chi-square test with `samples` samples rejects at `significance`. The list `actual` has the
/// true probability of each cell, and the list `claimed` has the probability that the test expects. The two lists
/// should have the same sum.
///
/// # Errors
/// Returns an error if the lists have different lengths, if a probability is negative or not a number, or if fewer than
/// two cells are left after pooling.
pub fn chi_square_power(
    claimed: &[f64],
    actual: &[f64],
    samples: f64,
    significance: f64,
) -> Result<f64, NoVerdict> {
    if claimed.len() != actual.len() {
        return Err(NoVerdict::Length { observed: actual.len(), expected: claimed.len() });
    }
    // The order is the same as in `ChiSquare`, so the same cells are pooled.
    let mut cells: Vec<(f64, f64)> = claimed.iter().copied().zip(actual.iter().copied()).collect();
    cells.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut lambda, mut groups, mut impossible) = (0.0, 0_usize, 0.0);
    let mut add = |claimed: f64, actual: f64| {
        let difference = actual - claimed;
        lambda += samples * difference * difference / claimed;
        groups += 1;
    };
    let mut pool = (0.0, 0.0);
    for (claimed, actual) in cells {
        for value in [claimed, actual] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(NoVerdict::NotANumber { what: "the mass of a cell", value });
            }
        }
        if claimed == 0.0 {
            impossible += actual;
        } else if claimed * samples < POOLED || (pool.0 > 0.0 && pool.0 * samples < POOLED) {
            pool = (pool.0 + claimed, pool.1 + actual);
        } else {
            add(claimed, actual);
        }
    }
    if pool.0 > 0.0 {
        add(pool.0, pool.1);
    }
    if groups < 2 {
        return Err(NoVerdict::NoFreedom { cells: groups });
    }
    let dof = (groups - 1) as f64;
    let accepted = 1.0 - noncentral_tail(chi_square_critical(dof, significance), dof, lambda);
    // A sample in a cell with the expected mass 0 also makes the test reject.
    probability(1.0 - accepted * (-samples * impossible).exp())
}

/// The probability that the test of a mean rejects at `significance`, if the true mean differs from the expected mean
/// by `difference`. `error` is the standard error of the samples' mean.
///
/// # Errors
/// Returns an error if an argument isn't a number, if the error or the slack is negative, or if the significance isn't
/// between 0 and 1.
pub fn mean_power(
    difference: f64,
    error: f64,
    slack: f64,
    significance: f64,
) -> Result<f64, NoVerdict> {
    expect_significance(significance)?;
    for (what, value) in [("the standard error", error), ("the slack", slack)] {
        if !(value >= 0.0 && value.is_finite()) {
            return Err(NoVerdict::NotANumber { what, value });
        }
    }
    let shift = difference.abs();
    if error == 0.0 {
        return probability(f64::from(u8::from(shift > slack)));
    }
    let bound = normal_critical(significance);
    let beyond = |shift: f64| normal_upper(bound + (slack - shift) / error);
    probability(beyond(shift) + beyond(-shift))
}

/// A lower bound for the probability that Kolmogorov's test rejects at `significance`, if `samples` samples come from
/// an actual distribution that differs from the claimed one. Each element of `points` has the values of the claimed and
/// of the actual distribution function at one position. More points give a better bound. The number of samples below a
/// position has a binomial distribution (Massey 1950), which Karat approximates by a normal distribution.
///
/// # Errors
/// Returns an error if a value isn't a probability, if there are no points, if the slack is negative, or if the
/// significance isn't between 0 and 1.
pub fn kolmogorov_power(
    points: &[(f64, f64)],
    samples: f64,
    slack: f64,
    significance: f64,
) -> Result<f64, NoVerdict> {
    expect_significance(significance)?;
    if points.is_empty() {
        return Err(NoVerdict::TooFew { found: 0, needed: 1 });
    }
    if !(slack >= 0.0 && slack.is_finite()) {
        return Err(NoVerdict::NotANumber { what: "the slack", value: slack });
    }
    let bound = slack + critical(1.0, significance, |d| kolmogorov_tail(d, samples));
    let mut most = 0.0_f64;
    for (claimed, actual) in points {
        for value in [*claimed, *actual] {
            if !(0.0..=1.0).contains(&value) {
                return Err(NoVerdict::NotANumber { what: "the distribution function", value });
            }
        }
        let shift = actual - claimed;
        let deviation = (actual * (1.0 - actual) / samples).sqrt();
        let rejects = if deviation == 0.0 {
            f64::from(u8::from(shift.abs() > bound))
        } else {
            normal_upper((bound - shift) / deviation) + normal_upper((bound + shift) / deviation)
        };
        most = most.max(rejects);
    }
    probability(most)
}

fn expect_significance(value: f64) -> Result<(), NoVerdict> {
    let between = value > 0.0 && value < 1.0;
    if between { Ok(()) } else { Err(NoVerdict::NotANumber { what: "the significance", value }) }
}

/// The number of runs in which a statistical test rejected, out of all runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rate {
    /// The number of runs in which the test rejected.
    pub rejected: u64,
    /// The number of runs.
    pub runs: u64,
}

impl Rate {
    /// Runs a test with each seed. `rejects` runs the test with a seed, and returns `true` if the test rejected.
    pub fn over(seeds: std::ops::Range<u64>, mut rejects: impl FnMut(u64) -> bool) -> Self {
        let runs = seeds.end.saturating_sub(seeds.start);
        Self { rejected: seeds.filter(|seed| rejects(*seed)).count() as u64, runs }
    }

    /// The number of rejections divided by the number of runs. NaN if there were no runs.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.rejected as f64 / self.runs as f64
    }

    /// Checks if the number of rejections is plausible for a test that rejects with the probability `significance`: the
    /// probability of at least this many rejections must be at least 0.001. Returns `false` if there were no runs.
    #[must_use]
    pub fn is_within(&self, significance: f64) -> bool {
        let fewer = (self.rejected as f64) < significance * self.runs as f64;
        let tail = super::tail::binomial_tail(self.rejected, self.runs, significance);
        self.runs > 0 && (fewer || tail / 2.0 >= 1e-3)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn power_grows_from_the_significance_to_one() {
        let even = [0.25; 4];
        let power = |samples| {
            chi_square_power(&even, &[0.26, 0.24, 0.25, 0.25], samples, 0.01).expect("four cells")
        };
        let nothing = chi_square_power(&even, &even, 1e6, 0.01).expect("four cells");
        assert!((nothing - 0.01).abs() < 1e-6);
        assert!(power(100.0) < 0.02 && power(1e4) > 0.2 && power(1e4) < 0.8 && power(1e6) > 0.9999);
    }

    #[test]
    fn the_power_of_a_mean_is_that_of_a_normal_number() {
        let power = |difference, slack| mean_power(difference, 0.1, slack, 0.05).expect("a power");
        assert!((power(0.0, 0.0) - 0.05).abs() < 1e-9);
        // Cohen 1988, table 2.3: the test detects a shift of 1.96 standard deviations in half of the runs.
        assert!((power(0.196, 0.0) - 0.5).abs() < 1e-3 && (power(-0.196, 0.0) - 0.5).abs() < 1e-3);
        assert!((power(0.296, 0.1) - power(0.196, 0.0)).abs() < 1e-3);
        assert_eq!(mean_power(1.0, 0.0, 0.5, 0.05), Ok(1.0));
        assert_eq!(mean_power(0.1, 0.0, 0.5, 0.05), Ok(0.0));
        for (error, slack, significance) in
            [(-1.0, 0.0, 0.1), (f64::NAN, 0.0, 0.1), (1.0, -1.0, 0.1), (1.0, 0.0, 0.0)]
        {
            assert!(mean_power(1.0, error, slack, significance).is_err());
        }
        assert!(mean_power(f64::NAN, 0.1, 0.0, 0.05).is_err());
    }

    #[test]
    fn the_power_of_kolmogorovs_test_grows_with_the_distance() {
        let power = |shift: f64, slack: f64| {
            kolmogorov_power(&[(0.5, 0.5 + shift), (0.1, 0.1)], 1000.0, slack, 0.05)
                .expect("a power")
        };
        // The critical distance at 5 % is 1.358 / sqrt(1000) = 0.043. If the true shift is as large, half of the runs
        // exceed this distance.
        assert!((power(0.0427, 0.0) - 0.5).abs() < 0.02 && power(0.0, 0.0) < 0.05);
        assert!(power(0.1, 0.0) > 0.999 && power(-0.1, 0.0) > 0.999 && power(0.1, 0.06) < 0.5);
        assert!(kolmogorov_power(&[], 10.0, 0.0, 0.1).is_err());
        assert!(kolmogorov_power(&[(0.5, f64::NAN)], 10.0, 0.0, 0.1).is_err());
    }

    /// If one per cent of the samples are impossible, about 1/e of all runs with 100 samples have no impossible sample.
    #[test]
    fn one_impossible_sample_is_detected() {
        let power = chi_square_power(&[0.5, 0.5, 0.0], &[0.495, 0.495, 0.01], 100.0, 1e-6);
        assert!((power.expect("two cells") - (1.0 - (-1.0_f64).exp())).abs() < 1e-4);
    }

    #[test]
    fn rates_are_bounded_by_a_binomial() {
        let rate = |rejected| Rate { rejected, runs: 1000 };
        assert!(rate(0).is_within(0.01) && rate(10).is_within(0.01) && rate(19).is_within(0.01));
        assert!(!rate(25).is_within(0.01) && !Rate { rejected: 0, runs: 0 }.is_within(0.01));
        assert_eq!(Rate::over(0..10, |seed| seed % 5 == 0), Rate { rejected: 2, runs: 10 });
    }
}
