//! Pearson's chi-square test: compares a histogram with the expected counts.

use super::tail::chi_square_tail;
use super::{NoVerdict, probability};

/// Cells with fewer expected samples than this number are pooled, because their counts aren't close to the normal
/// distribution that the test assumes. The number is a rule of thumb (Cochran 1952).
pub const POOLED: f64 = 5.0;

/// The result of a chi-square test: the difference between a histogram and the expected histogram.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChiSquare {
    /// The sum of (observed - expected)^2 / expected. Infinite if a sample is in a cell with the expected count 0.
    pub statistic: f64,
    /// The degrees of freedom: the number of cells minus 1. All pooled cells together count as one cell.
    pub dof: usize,
    /// The probability that chance causes a sum at least as large as `statistic`.
    pub p: f64,
    /// The number of pooled cells.
    pub pooled: usize,
    /// The number of samples in cells with the expected count 0.
    pub impossible: u64,
}

impl ChiSquare {
    /// Compares the observed count of each cell with its expected count. The two lists should have the same sum. Cells
    /// with an expected count below [`POOLED`] are pooled into one. If the pool's expected count is still below
    /// [`POOLED`], the cell with the next larger expected count joins the pool. Cells with the expected count 0 must
    /// have no samples: a single sample there makes the p-value 0.
    ///
    /// # Errors
    /// Returns an error if there are no samples, if an expected count is negative or not a number, or if fewer than two
    /// cells are left after pooling.
    pub fn of(observed: &[u64], expected: &[f64]) -> Result<Self, NoVerdict> {
        if observed.len() != expected.len() {
            let (observed, expected) = (observed.len(), expected.len());
            return Err(NoVerdict::Length { observed, expected });
        }
        if let Some(value) = expected.iter().find(|value| !(**value >= 0.0 && value.is_finite())) {
            return Err(NoVerdict::NotANumber { what: "an expected count", value: *value });
        }
        if observed.iter().all(|count| *count == 0) {
            return Err(NoVerdict::TooFew { found: 0, needed: 1 });
        }
        let mut cells: Vec<(f64, u64)> =
            expected.iter().copied().zip(observed.iter().copied()).collect();
        // The sort is stable, so cells with equal expected counts are always pooled in the same order.
        cells.sort_by(|a, b| a.0.total_cmp(&b.0));
        let impossible = cells.iter().filter(|cell| cell.0 == 0.0).map(|cell| cell.1).sum();
        let (mut statistic, mut groups, mut pooled) = (0.0, 0, 0);
        let mut pool = (0.0, 0_u64);
        let mut add = |(expected, observed): (f64, u64)| {
            let difference = observed as f64 - expected;
            statistic += difference * difference / expected;
            groups += 1;
        };
        for cell in cells.into_iter().filter(|cell| cell.0 > 0.0) {
            if cell.0 < POOLED || (pool.0 > 0.0 && pool.0 < POOLED) {
                pool = (pool.0 + cell.0, pool.1 + cell.1);
                pooled += 1;
            } else {
                add(cell);
            }
        }
        if pool.0 > 0.0 {
            add(pool);
        }
        if groups < 2 {
            return Err(NoVerdict::NoFreedom { cells: groups });
        }
        let dof = groups - 1;
        if impossible > 0 {
            return Ok(Self { statistic: f64::INFINITY, dof, p: 0.0, pooled, impossible });
        }
        let p = probability(chi_square_tail(statistic, dof as f64))?;
        Ok(Self { statistic, dof, p, pooled, impossible })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mendel counted 315, 108, 101 and 32 peas of four kinds. His theory expects 9 : 3 : 3 : 1.
    #[test]
    fn the_chi_square_test_of_the_peas_of_mendel_has_the_known_p_value() {
        let expected = [9.0, 3.0, 3.0, 1.0].map(|share| 556.0 * share / 16.0);
        let test = ChiSquare::of(&[315, 108, 101, 32], &expected).expect("four cells");
        assert_eq!((test.dof, test.pooled), (3, 0));
        assert!((test.statistic - 0.470_024).abs() < 1e-6 && (test.p - 0.925_4).abs() < 1e-4);
    }

    #[test]
    fn small_cells_are_pooled_until_they_expect_five() {
        // The cells with the expected counts 1, 2 and 6 are pooled: 8 samples, 9 expected. The other cell has 11
        // samples, 10 expected.
        let test = ChiSquare::of(&[1, 2, 5, 11], &[1.0, 2.0, 6.0, 10.0]).expect("two cells");
        assert_eq!((test.dof, test.pooled), (1, 3));
        assert!((test.statistic - (1.0 / 9.0 + 0.1)).abs() < 1e-12);
    }

    #[test]
    fn without_evidence_there_is_no_verdict() {
        let of = ChiSquare::of;
        assert_eq!(of(&[5], &[5.0]), Err(NoVerdict::NoFreedom { cells: 1 }));
        assert_eq!(of(&[2, 3], &[2.0, 3.0]), Err(NoVerdict::NoFreedom { cells: 1 }));
        assert_eq!(of(&[9, 0], &[9.0, 0.0]), Err(NoVerdict::NoFreedom { cells: 1 }));
        assert_eq!(of(&[], &[]), Err(NoVerdict::TooFew { found: 0, needed: 1 }));
        assert_eq!(of(&[0, 0], &[9.0, 9.0]), Err(NoVerdict::TooFew { found: 0, needed: 1 }));
        assert!(matches!(of(&[1], &[1.0, 2.0]), Err(NoVerdict::Length { .. })));
        for bad in [f64::NAN, f64::INFINITY, -1.0] {
            assert!(matches!(of(&[9, 9], &[9.0, bad]), Err(NoVerdict::NotANumber { .. })));
        }
    }

    #[test]
    fn an_impossible_sample_has_probability_zero() {
        let test = ChiSquare::of(&[10, 10, 1], &[10.0, 11.0, 0.0]).expect("two cells");
        assert_eq!((test.p, test.impossible), (0.0, 1));
    }
}
