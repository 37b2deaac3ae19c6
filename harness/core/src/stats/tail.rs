//! Tails of distributions: the probabilities that a random value is at least as extreme as a given value.

use statrs::function::erf::erfc;
use statrs::function::gamma::{checked_gamma_ur, ln_gamma};

/// The probability that a chi-square variable with `dof` degrees of freedom is at least `x`. NaN for a negative `x`, or
/// if `dof` isn't positive. Source: Abramowitz and Stegun 26.4.19.
#[must_use]
pub fn chi_square_tail(x: f64, dof: f64) -> f64 {
    if x.is_nan() || !(dof > 0.0) || x < 0.0 {
        f64::NAN
    } else if x == 0.0 {
        1.0
    } else if x == f64::INFINITY {
        0.0
    } else {
        checked_gamma_ur(dof / 2.0, x / 2.0).unwrap_or(f64::NAN)
    }
}

/// The value that a chi-square variable exceeds with the probability `significance`.
#[must_use]
pub fn chi_square_critical(dof: f64, significance: f64) -> f64 {
    let (mut low, mut high) = (0.0, dof.max(1.0));
    while chi_square_tail(high, dof) > significance && high < 1e12 {
        (low, high) = (high, 2.0 * high);
    }
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if chi_square_tail(middle, dof) > significance { low = middle } else { high = middle }
    }
    high
}

/// The probability that a non-central chi-square variable is at least `x`. The distribution of this variable is a
/// mixture of central chi-square distributions with `dof + 2 j` degrees of freedom, where j has a Poisson distribution
/// with the mean `lambda / 2`. Source: Abramowitz and Stegun 26.4.25.
#[must_use]
pub fn noncentral_tail(x: f64, dof: f64, lambda: f64) -> f64 {
    if lambda == 0.0 {
        return chi_square_tail(x, dof);
    }
    if !(lambda > 0.0) || !lambda.is_finite() {
        return f64::NAN;
    }
    let mean = lambda / 2.0;
    // Terms that are more than 12 standard deviations from the mean are below 1e-30.
    let width = 12.0 * mean.sqrt() + 12.0;
    let (first, last) = ((mean - width).max(0.0).floor(), (mean + width).ceil());
    // A wide mixture has too many terms, so only every `step`-th term is computed. The relative difference of
    // neighbouring terms is at most 1e-3.
    let step = ((last - first) / 2000.0).floor().max(1.0);
    let (mut sum, mut weights, mut j) = (0.0, 0.0, first);
    while j <= last {
        let weight = (j * mean.ln() - mean - ln_gamma(j + 1.0)).exp();
        sum += weight * chi_square_tail(x, dof + 2.0 * j);
        weights += weight;
        j += step;
    }
    sum / weights
}

/// The probability that a standard normal variable is at least as far from 0 as `z`, in either direction.
#[must_use]
pub fn normal_tail(z: f64) -> f64 {
    erfc(z.abs() / std::f64::consts::SQRT_2)
}

/// The distance from 0 that a standard normal variable exceeds with the probability `significance`, in either
/// direction.
#[must_use]
pub fn normal_critical(significance: f64) -> f64 {
    // Beyond 40 standard deviations, the tail is below the smallest double.
    critical(40.0, significance, normal_tail)
}

pub(super) fn normal_upper(z: f64) -> f64 {
    0.5 * erfc(z / std::f64::consts::SQRT_2)
}

/// The argument, between 0 and `most`, at which the falling function `tail` has the value `significance`.
pub(super) fn critical(most: f64, significance: f64, tail: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (0.0, most);
    // Each step adds one bit to the result.
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if tail(middle) > significance { low = middle } else { high = middle }
    }
    high
}

/// The probability that the number of successes in `trials` trials is at least as far from the expected number as
/// `successes`. As is usual for a binomial test, the result is twice the smaller tail of the binomial distribution.
#[must_use]
pub fn binomial_tail(successes: u64, trials: u64, probability: f64) -> f64 {
    if successes > trials || !(0.0..=1.0).contains(&probability) {
        return f64::NAN;
    }
    let (n, mean) = (trials as f64, trials as f64 * probability);
    if probability == 0.0 || probability == 1.0 {
        return if successes as f64 == mean { 1.0 } else { 0.0 };
    }
    let ln_choose = |k: f64| ln_gamma(n + 1.0) - ln_gamma(k + 1.0) - ln_gamma(n - k + 1.0);
    let mut k = successes as f64;
    let mut term = (ln_choose(k) + k * probability.ln() + (n - k) * (-probability).ln_1p()).exp();
    let odds = probability / (1.0 - probability);
    let upwards = k >= mean;
    let mut tail = 0.0;
    // Away from the mean, each term is smaller than the previous term, by a ratio that falls from term to term.
    while term > tail * 1e-17 && term > 0.0 {
        tail += term;
        if upwards {
            term *= (n - k) / (k + 1.0) * odds;
            k += 1.0;
        } else {
            term *= k / (n - k + 1.0) / odds;
            k -= 1.0;
        }
    }
    (2.0 * tail).min(1.0)
}

/// The probability that the Kolmogorov-Smirnov distance between `samples` random samples and their distribution is at
/// least `distance`. Source: Stephens 1970, with Kolmogorov's series.
#[must_use]
pub fn kolmogorov_tail(distance: f64, samples: f64) -> f64 {
    let root = samples.sqrt();
    let x = (root + 0.12 + 0.11 / root) * distance;
    if x.is_nan() {
        return f64::NAN;
    }
    if x < 0.2 {
        return 1.0; // here the tail differs from 1 by at most 5e-13, and the series would converge slowly
    }
    let mut sum = 0.0;
    for k in 1..=100 {
        let k = f64::from(k);
        let term = (-2.0 * k * k * x * x).exp();
        sum += if k % 2.0 == 1.0 { term } else { -term };
        if term < 1e-18 {
            break;
        }
    }
    (2.0 * sum).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: f64, b: f64, relative: f64) -> bool {
        (a - b).abs() <= relative * b.abs()
    }

    /// For an even number of degrees of freedom, the tail is a finite sum. Source: Abramowitz and Stegun 26.4.5.
    #[test]
    fn chi_square_is_a_sum_of_poisson_terms() {
        for (dof, x) in [(2_u32, 3.0), (4, 0.5), (10, 30.0), (100, 150.0), (500, 430.0)] {
            let (mut term, mut sum) = ((-x / 2.0_f64).exp(), 0.0);
            for j in 0..dof / 2 {
                sum += term;
                term *= x / 2.0 / f64::from(j + 1);
            }
            assert!(close(chi_square_tail(x, f64::from(dof)), sum, 1e-9), "{dof} {x}");
        }
    }

    #[test]
    fn invalid_arguments_of_a_tail_give_nan() {
        assert!(chi_square_tail(1.0, 0.0).is_nan() && chi_square_tail(f64::NAN, 3.0).is_nan());
        assert!(chi_square_tail(-1.0, 3.0).is_nan() && noncentral_tail(1.0, 2.0, -1.0).is_nan());
        assert!(binomial_tail(3, 2, 0.5).is_nan() && binomial_tail(1, 2, f64::NAN).is_nan());
        assert!(kolmogorov_tail(f64::NAN, 100.0).is_nan() && normal_tail(f64::NAN).is_nan());
        assert_eq!(chi_square_tail(f64::INFINITY, 3.0), 0.0);
    }

    #[test]
    fn critical_values_invert_the_tail() {
        for (dof, significance) in [(1.0, 0.05), (10.0, 0.01), (511.0, 1e-4), (511.0, 1e-9)] {
            let x = chi_square_critical(dof, significance);
            assert!(close(chi_square_tail(x, dof), significance, 1e-6));
        }
        assert!(close(chi_square_critical(1.0, 0.05), 3.841_458_821, 1e-8)); // 1.96^2
    }

    /// With one degree of freedom, a non-central chi-square variable is the square of a normal variable with the mean
    /// sqrt(lambda).
    #[test]
    fn the_noncentral_tail_of_one_degree_is_normal() {
        for (x, lambda) in [(3.84, 1.0), (3.84, 10.0), (1.0, 4.0), (10.0, 1000.0)] {
            let (root, shift) = (f64::sqrt(x), f64::sqrt(lambda));
            let upper = |z: f64| 0.5 * erfc(z / std::f64::consts::SQRT_2);
            let expected = upper(root - shift) + upper(root + shift);
            assert!(close(noncentral_tail(x, 1.0, lambda), expected, 1e-6), "{x} {lambda}");
        }
        // A wide mixture, in which only some terms are summed. The result is approximately normal.
        let (dof, lambda) = (511.0_f64, 1e6_f64);
        let (mean, deviation) = (dof + lambda, (2.0 * (dof + 2.0 * lambda)).sqrt());
        let tail = noncentral_tail(mean + deviation, dof, lambda);
        assert!((tail - 0.1587).abs() < 1e-3, "{tail}");
    }

    #[test]
    fn binomial_tails_are_exact() {
        // In 10 coin tosses, 8 or more heads have the probability 56/1024. `binomial_tail` doubles this probability.
        assert!(close(binomial_tail(8, 10, 0.5), 112.0 / 1024.0, 1e-12));
        assert!(close(binomial_tail(2, 10, 0.5), 112.0 / 1024.0, 1e-12));
        assert_eq!(binomial_tail(5, 10, 0.5), 1.0);
        assert_eq!((binomial_tail(0, 9, 0.0), binomial_tail(1, 9, 0.0)), (1.0, 0.0));
        // With a million trials, the standard deviation is 500. Three standard deviations have the tail 0.0027, minus
        // the continuity correction.
        let tail = binomial_tail(501_500, 1_000_000, 0.5);
        assert!(close(tail, normal_tail(1499.5 / 500.0), 1e-4), "{tail}");
    }

    /// The tables of Stephens 1970 have 1.358 for 5 % and 1.628 for 1 %.
    #[test]
    fn kolmogorov_has_its_tabled_points() {
        assert!(close(kolmogorov_tail(1.358_1e-3, 1e6), 0.05, 2e-3));
        assert!(close(kolmogorov_tail(1.627_6e-3, 1e6), 0.01, 2e-3));
        assert_eq!(kolmogorov_tail(0.0, 100.0), 1.0);
    }
}
