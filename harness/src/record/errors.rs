//! The distribution of a check's errors, for reports.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Counts of errors in a sample of a check's cases. Each error is divided by its tolerance.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Errors {
    /// Number of cases without any error.
    pub exact: u64,
    /// Number of cases by the size of their ratio. Each key is an exponent of two, from -20 to 20. A case counts for
    /// the smallest power of two that is at least the case's ratio: a case with the ratio 0.3 counts for -1, because
    /// 0.3 is between 2^-2 and 2^-1.
    pub powers: BTreeMap<i32, u64>,
    /// Number of cases in which the error is infinite or NaN.
    pub not_finite: u64,
}

impl Errors {
    pub(crate) fn of(ratios: impl Iterator<Item = f64>) -> Self {
        let mut errors = Self::default();
        for ratio in ratios {
            if ratio == 0.0 {
                errors.exact += 1;
            } else if ratio.is_finite() {
                #[expect(clippy::cast_possible_truncation, reason = "it is clamped first")]
                let power = ratio.log2().ceil().clamp(-20.0, 20.0) as i32;
                *errors.powers.entry(power).or_default() += 1;
            } else {
                errors.not_finite += 1;
            }
        }
        errors
    }

    /// The number of cases in all counts together.
    #[must_use]
    pub fn cases(&self) -> u64 {
        self.exact + self.powers.values().sum::<u64>() + self.not_finite
    }
}

/// A sample of the cases of a check that fails: the components of their arguments, and their errors divided by
/// the tolerance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plot {
    /// Names of the components: `n_dot_v`, `f0.x`.
    pub arguments: Vec<String>,
    /// One row for each case: the values of its arguments' components, and then its error divided by the tolerance.
    /// NaN and infinities are `null`.
    #[serde(deserialize_with = "with_nan")]
    pub rows: Vec<Vec<f64>>,
}

/// A sampler's support, divided into cells. Each cell has the number of samples in it, and the expected number.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Histogram {
    /// Names of the two axes, rows first: `theta` and `phi`. The second name is empty if the support is a line.
    pub axes: [String; 2],
    /// The number of cells in each row. Rows may have different numbers of cells.
    pub rows: Vec<usize>,
    /// The number of samples in each cell, row by row.
    pub observed: Vec<u64>,
    /// The number of samples that the density predicts for each cell.
    pub expected: Vec<f64>,
}

/// Reads rows in which `null` stands for NaN and infinities, which JSON can't write. Each `null` becomes NaN.
fn with_nan<'de, D: serde::Deserializer<'de>>(rows: D) -> Result<Vec<Vec<f64>>, D::Error> {
    let rows: Vec<Vec<Option<f64>>> = Deserialize::deserialize(rows)?;
    let number = |value: Option<f64>| value.unwrap_or(f64::NAN);
    Ok(rows.into_iter().map(|row| row.into_iter().map(number).collect()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_counted_by_powers_of_two() {
        let errors = Errors::of([0.0, 1.0, 0.6, 1.5, f64::NAN, f64::INFINITY, 1e-30].into_iter());
        assert_eq!((errors.exact, errors.not_finite, errors.cases()), (1, 2, 7));
        assert_eq!(errors.powers, BTreeMap::from([(-20, 1), (0, 2), (1, 1)]));
    }

    #[test]
    fn nan_and_infinity_are_read_back() {
        let plot = Plot { arguments: vec!["x".to_owned()], rows: vec![vec![1.0, f64::INFINITY]] };
        let text = serde_json::to_string(&plot).expect("plain data");
        let again: Plot = serde_json::from_str(&text).expect("as written");
        assert!(again.rows[0][0] == 1.0 && again.rows[0][1].is_nan(), "{text}");
    }
}
