//! Types for the judgement of a configuration.

use crate::check::Failure;
use crate::check::sampling::Finding;
use crate::stats::Cells;

/// The allowed relative rounding error of eval cos / pdf: a few hundred ulp of eval and pdf.
pub(super) const ROUNDING: f64 = 1e-4;

/// The density's integrals over the cells, their total, and its error.
pub(super) struct Masses {
    pub(super) cells: Cells,
    pub(super) mass: Vec<f64>,
    pub(super) total: f64,
    pub(super) error: f64,
}

/// The reason why the judgement of a configuration ends early.
pub(super) enum Stop {
    Failure(Failure),
    Finding(Finding),
}

impl From<Failure> for Stop {
    fn from(failure: Failure) -> Self {
        Self::Failure(failure)
    }
}

/// Decodes the point that a sampler returned.
pub(super) fn point(result: &[u32]) -> [f64; 3] {
    let mut point = [0.0; 3];
    for (value, word) in point.iter_mut().zip(result) {
        *value = f64::from(f32::from_bits(*word));
    }
    point
}
