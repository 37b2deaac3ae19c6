//! Sums of weighted results. The rounding error of a sum doesn't grow with the number of terms.

use crate::judge::{Judged, finite};
use crate::value::Scalar;

#[derive(Clone, Debug)]
pub(super) struct Sum {
    lanes: Vec<Compensated>,
    pub(super) bad: Option<Bad>,
}

/// The first node of a rule at which the function's result isn't finite.
#[derive(Clone, Debug)]
pub(super) struct Bad {
    pub(super) node: usize,
    pub(super) result: Vec<u32>,
    pub(super) judged: Judged,
}

impl Sum {
    pub(super) fn new(lanes: usize) -> Self {
        Self { lanes: vec![Compensated::default(); lanes], bad: None }
    }

    pub(super) fn add(&mut self, scalars: &[Scalar], node: usize, weight: f64, result: &[u32]) {
        for ((sum, scalar), word) in self.lanes.iter_mut().zip(scalars).zip(result) {
            sum.add(weight * scalar.decode(*word));
        }
        if self.bad.is_none() {
            let judged = finite(scalars, result);
            if !judged.measure.passes() {
                self.bad = Some(Bad { node, result: result.to_vec(), judged });
            }
        }
    }

    pub(super) fn totals(&self) -> Vec<f64> {
        self.lanes.iter().map(Compensated::total).collect()
    }
}

/// A sum by Neumaier's method (1974). The method collects the rounding errors of all additions and adds them at
/// the end.
#[derive(Clone, Copy, Debug, Default)]
struct Compensated {
    sum: f64,
    lost: f64,
}

impl Compensated {
    fn add(&mut self, term: f64) {
        let sum = self.sum + term;
        let (large, small) =
            if self.sum.abs() >= term.abs() { (self.sum, term) } else { (term, self.sum) };
        self.lost += (large - sum) + small;
        self.sum = sum;
    }

    /// Returns the sum plus the collected rounding errors. If the plain sum is NaN or infinite, the rounding errors
    /// aren't finite either, so the function returns only the plain sum.
    fn total(&self) -> f64 {
        if self.sum.is_finite() { self.sum + self.lost } else { self.sum }
    }
}

#[cfg(test)]
impl Sum {
    /// Sums `weight * value` over pairs of a weight and a value.
    pub(super) fn of_scalars(terms: &[(f64, f32)]) -> Self {
        let mut sum = Self::new(1);
        for (node, (weight, value)) in terms.iter().enumerate() {
            sum.add(&[Scalar::F32], node, *weight, &[value.to_bits()]);
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cancelling_terms_lose_no_small_terms() {
        let terms = [(1.0, 1.0), (1e100, 1.0), (1.0, 1.0), (-1e100, 1.0)];
        assert_eq!(Sum::of_scalars(&terms).totals(), [2.0]);
        let tenths = Sum::of_scalars(&[(0.1, 1.0); 1_000_000]).totals()[0];
        assert!((tenths - 1e5).abs() < 1e-10, "{tenths}");
    }
}
