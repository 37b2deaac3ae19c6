//! The cells of a configuration, and the integrals of the densities over the cells.

use super::parts::{Masses, ROUNDING, Stop, point};
use super::run::Run;
use crate::check::sampling::judgement::Offence;
use crate::check::sampling::{Finding, Settings};
use crate::stats::{CellIntegral, Cells, CubatureError, NoVerdict, Place, integrate};

/// The number of pilot samples, which determine the cells. For each of 512 cells, there are about thirty pilot
/// samples.
const PILOT: usize = 16_384;

/// A part of the seed for the pilot samples. Karat combines this number with the configuration's seed, so the pilot
/// samples use other random numbers than the judged samples.
const PILOT_SEED: u64 = 0x5bf0_3635_dcf8_e1a7;

/// The smallest average number of samples per cell. If 512 cells would get fewer samples, Karat uses fewer cells.
const PER_CELL: u64 = 64;

/// The smallest number of samples per configuration that a check accepts. With fewer samples, there are too few cells
/// to distinguish densities.
const FEWEST: u64 = 1024;

/// The largest allowed error of a cell's integral, divided by the standard deviation of the cell's count. With
/// this limit, the errors of all cells shift chi-square by at most a thousandth of its degrees of freedom.
const QUADRATURE: f64 = 0.03;

/// The largest allowed error of the integral of eval cos over a cell. If the errors of 512 cells are independent,
/// their sum is about sqrt(512) times this limit: 2e-5. For large integrals, `ESTIMATE_RELATIVE` limits the
/// relative error to a tenth of `ROUNDING`.
const ESTIMATE: f64 = 1e-6;
const ESTIMATE_RELATIVE: f64 = 0.1 * ROUNDING;

impl Run<'_> {
    /// Determines the cells from pilot samples, which the check doesn't judge.
    pub(super) fn cells(&self) -> Result<Cells, Stop> {
        let settings = self.settings();
        if settings.samples < FEWEST {
            let (found, needed) = (settings.samples, FEWEST);
            return Err(self.evidence(NoVerdict::TooFew { found, needed }).into());
        }
        let sampler = self.calls();
        let lanes = self.draw(self.configuration.seed ^ PILOT_SEED, 0, PILOT);
        let results = sampler.call(&lanes, PILOT)?;
        let located = results.chunks_exact(sampler.words()).filter_map(|result| {
            match settings.support.locate(point(result)) {
                Place::Inside(at) => Some(at),
                Place::Outside | Place::NotUnit => None,
            }
        });
        let (rows, columns) = settings.grid();
        Ok(Cells::new(settings.support, &located.collect::<Vec<_>>(), rows, columns))
    }

    pub(super) fn masses(&self, cells: Cells, which: usize) -> Result<Masses, Stop> {
        let settings = self.settings();
        let samples = settings.samples as f64;
        // For an expected count below 0.1, the accuracy of a count of 0.1 is enough. For any number of samples,
        // the error of the sum over all cells is at most a quarter of the tolerance for the sum.
        let per_root = (QUADRATURE / samples.sqrt()).min(settings.mass.max(1e-6) / 4.0);
        let tolerance = |mass: &[f64]| per_root * mass[0].max(0.1 / samples).sqrt();
        let evaluate = |points: &[[f64; 3]]| self.evaluate(which, points);
        let integrals = integrate(settings.support, &cells, 1, tolerance, evaluate);
        let integrals = integrals.map_err(|error| self.stop(which, error))?;
        let mass: Vec<f64> = integrals.iter().map(|cell| cell.value[0]).collect();
        let error = integrals.iter().map(|cell| cell.error * cell.error).sum::<f64>().sqrt();
        let total = mass.iter().sum();
        if !(total > 0.0) {
            let bound = settings.mass;
            return Err(Stop::Finding(Finding::Mass { integral: total, bound }));
        }
        Ok(Masses { cells, mass, total, error })
    }

    /// Integrates eval cos, component by component, over the support.
    pub(super) fn estimate(&self, cells: &Cells) -> Result<CellIntegral, Stop> {
        let components = self.other(1).words();
        let support = self.settings().support;
        let integrals = integrate(
            support,
            cells,
            components,
            |known| known.iter().fold(ESTIMATE, |most, v| most.max(ESTIMATE_RELATIVE * v.abs())),
            |points| {
                let mut values = self.evaluate(1, points)?;
                for (values, point) in values.chunks_exact_mut(components).zip(points) {
                    values.iter_mut().for_each(|value| *value *= point[2].abs());
                }
                Ok(values)
            },
        );
        let integrals = integrals.map_err(|error| self.stop(1, error))?;
        let mut sum = CellIntegral { value: vec![0.0; components], error: 0.0 };
        for integral in integrals {
            sum.error = sum.error.hypot(integral.error);
            for (sum, value) in sum.value.iter_mut().zip(integral.value) {
                *sum += value;
            }
        }
        Ok(sum)
    }

    pub(super) fn stop(&self, which: usize, error: CubatureError<Stop>) -> Stop {
        match error {
            CubatureError::Evaluation(stop) => stop,
            CubatureError::Diverges { nodes } => {
                let function = &self.functions.others[which].function().name;
                Stop::Failure(self.evidence(format!(
                    "two quadrature rules for `{function}` disagree after {nodes} nodes: this function is \
                     discontinuous in too many places, or its results are noisy"
                )))
            }
        }
    }

    /// Evaluates a function at points. Returns an error if a result is negative or isn't finite.
    pub(super) fn evaluate(&self, which: usize, points: &[[f64; 3]]) -> Result<Vec<f64>, Stop> {
        let (calls, components) = (self.other(which), self.settings().support.components());
        let mut flat = Vec::with_capacity(points.len() * components);
        for point in points {
            #[expect(clippy::cast_possible_truncation, reason = "arguments are f32")]
            let words = point.map(|value| (value as f32).to_bits());
            flat.extend_from_slice(&words[..components]);
        }
        let (lanes, results) = self.at(which, &flat)?;
        let (words, width) = (calls.words(), lanes.len() / points.len().max(1));
        let mut values = Vec::with_capacity(results.len());
        let (mut not_finite, mut negative) = (Offence::default(), Offence::default());
        for (index, result) in results.chunks_exact(words).enumerate() {
            let shown = || calls.shown(&lanes[index * width..][..width], result);
            let decoded = result.iter().map(|word| f64::from(f32::from_bits(*word)));
            if decoded.clone().any(|value| !value.is_finite()) {
                not_finite.add(shown);
            } else if decoded.clone().any(|value| value < 0.0) {
                negative.add(shown);
            }
            values.extend(decoded);
        }
        let finding = not_finite
            .finding(|count, call| Finding::NotFinite { count, call })
            .or(negative.finding(|count, call| Finding::Negative { count, call }));
        finding.map_or(Ok(values), |finding| Err(Stop::Finding(finding)))
    }
}

impl Settings {
    /// The number of statistical tests per configuration: one for the histogram, and if samples may leave the support,
    /// one for the number of samples outside.
    pub(super) fn tests(&self) -> u64 {
        if self.may_leave_support { 2 } else { 1 }
    }

    fn grid(&self) -> (usize, usize) {
        let cells = (self.samples / PER_CELL).clamp(2, 512) as usize;
        if self.support.is_line() {
            return (cells, 1);
        }
        // There are twice as many columns as rows, because azimuths cover the full circle.
        let rows = ((cells as f64 / 2.0).sqrt() as usize).clamp(1, 16);
        (rows, cells / rows)
    }
}
