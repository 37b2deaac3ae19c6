//! Judges one configuration on one path: computes the cells, integrates the density over each cell, and counts the
//! samples in each cell.

use super::parts::{Masses, ROUNDING, Stop, point};
use crate::check::Failure;
use crate::check::sampling::calls::{Calls, STRIDE, draw};
use crate::check::sampling::conclude::Functions;
use crate::check::sampling::judgement::{Judgement, Offence};
use crate::check::sampling::picture::Histogram;
use crate::check::sampling::{Configuration, Finding, Other, Sampled, Settings};
use crate::stats::{
    CellIntegral, Cells, ChiSquare, Mean, Moments, Place, binomial_tail, chi_square_power,
    mean_power,
};

/// The relative rounding error of a texel in half-float format, which has eleven significant bits.
const HALF: f64 = 1.0 / 2048.0;

/// The absolute error that Karat allows for a weight, in addition to the relative error. Far from the peak of a lobe,
/// eval and pdf are tiny, and drivers may flush them to 0.
const VANISHED: f64 = 1e-6;

pub(super) struct Run<'r> {
    pub(super) functions: &'r Functions<'r>,
    pub(super) sampler: Sampled<'r, 'r>,
    pub(super) others: &'r [Other<'r>],
    pub(super) configuration: &'r Configuration<'r>,
}

#[derive(Default)]
struct Counts {
    observed: Vec<u64>,
    inside: u64,
    left: u64,
    not_finite: Offence,
    not_unit: Offence,
    outside: Offence,
    impossible: Offence,
    negative: Offence,
    weight: Offence,
    weights: Vec<Moments>,
}

impl Run<'_> {
    pub(super) fn settings(&self) -> &Settings {
        self.sampler.settings
    }

    pub(super) fn calls(&self) -> Calls<'_> {
        self.functions.sampler()
    }

    pub(super) fn other(&self, which: usize) -> Calls<'_> {
        self.functions.other(which)
    }

    /// Evaluates the function with index `which`, such as the density, at points. Returns the words of the
    /// function's arguments and results.
    pub(super) fn at(&self, which: usize, points: &[u32]) -> Result<(Vec<u32>, Vec<u32>), Failure> {
        let (value, made) = (self.configuration.value, self.others[which].made);
        let width = self.settings().support.components();
        self.other(which).at(points, width, &|points, lanes| made(value, points, lanes))
    }

    /// Makes the sampler's arguments for `count` samples, beginning at the sample with index `first`.
    pub(super) fn draw(&self, seed: u64, first: usize, count: usize) -> Vec<u32> {
        let Sampled { random, arguments, .. } = self.sampler;
        let value = self.configuration.value;
        let given = |random: &[u32], lanes: &mut Vec<u32>| arguments(value, random, lanes);
        draw(seed, first, count, &random.lanes(), &given)
    }

    /// The relative error of a function's values if the function reads textures that the path stores as half floats.
    /// Otherwise 0. A single texel may determine the peak of a lobe, so Karat allows the whole error of one texel.
    fn half_rounding(&self, which: usize) -> f64 {
        if self.other(which).called.reads_half_floats() { HALF } else { 0.0 }
    }

    pub(super) fn evidence(&self, reason: impl std::fmt::Display) -> Failure {
        let Configuration { value, index, .. } = self.configuration;
        Failure::Evidence {
            function: self.functions.sampler.function().name.clone(),
            reason: reason.to_string(),
            case: *index,
            configuration: value.shown(),
        }
    }

    /// Judges the samples. If `estimates` is `true`, the samples must also estimate an integral.
    pub(super) fn judge(&self, estimates: bool) -> Result<Judgement, Failure> {
        match self.judge_or_stop(estimates) {
            Ok(judgement) => Ok(judgement),
            Err(Stop::Finding(finding)) => Ok(Judgement::outright(finding)),
            Err(Stop::Failure(failure)) => Err(failure),
        }
    }

    fn judge_or_stop(&self, estimates: bool) -> Result<Judgement, Stop> {
        let cells = self.cells()?;
        let masses = self.masses(cells, 0)?;
        let counts = self.count(&masses.cells, estimates)?;
        let integral = estimates.then(|| self.estimate(&masses.cells)).transpose()?;
        let settings = self.settings();
        let threshold = self.configuration.threshold;
        let mut judgement = Judgement::fitting();
        let Counts { observed, inside, left, .. } = counts;
        let samples = settings.samples;
        let note = format!("{inside} of {samples} samples lie on {}", settings.support);
        judgement.notes.push(("sampled", note));
        let Masses { total, error, .. } = masses;
        let note = format!("{total:.7} +- {error:.1e}, over {} cells", masses.cells.len());
        judgement.notes.push(("integral of the density", note));
        let outright = [
            counts.not_finite.finding(|count, call| Finding::NotFinite { count, call }),
            counts.not_unit.finding(|count, call| Finding::NotUnit { count, call }),
            counts.outside.finding(|count, call| Finding::Outside { count, call }),
            counts.impossible.finding(|count, call| Finding::Impossible { count, call }),
            counts.negative.finding(|count, call| Finding::Negative { count, call }),
            counts.weight.finding(|count, call| Finding::Weight { count, call }),
        ];
        judgement.findings.extend(outright.into_iter().flatten());
        let bound = settings.mass + self.half_rounding(0) + error;
        let off = total - 1.0;
        // If samples may leave the support, the density's integral may be less than 1.
        let right = if settings.may_leave_support { off <= bound } else { off.abs() <= bound };
        if !right {
            judgement.findings.push(Finding::Mass { integral: total, bound });
        }
        if !judgement.findings.is_empty() {
            judgement.p = 0.0;
        }
        // If the density's integral is wrong, the expected number of samples outside the support is unknown.
        if settings.may_leave_support && right {
            // Because of the integral's error, a range of shares is possible. The test uses the share nearest
            // to the samples' share.
            let share = left as f64 / samples as f64;
            let nearest =
                share.clamp((-off - bound).clamp(0.0, 1.0), (bound - off).clamp(0.0, 1.0));
            let p = binomial_tail(left, samples, nearest);
            let expected = (-off).max(0.0) * samples as f64;
            judgement.test(p, threshold, || Finding::Left { left, expected, p });
        }
        // The cells' counts of the samples on the support must fit the density.
        let expected: Vec<f64> =
            masses.mass.iter().map(|mass| (mass / total).max(0.0) * inside as f64).collect();
        let test = match ChiSquare::of(&observed, &expected) {
            Ok(test) => test,
            // If too few samples lie on the support, there is no test, and the earlier findings are the result.
            Err(_) if !judgement.findings.is_empty() => return Ok(judgement),
            Err(none) => return Err(self.evidence(none).into()),
        };
        let ChiSquare { statistic, dof, p, .. } = test;
        judgement.notes.push(("chi-square", format!("{statistic:.1}, {dof} degrees, p {p:.2e}")));
        judgement.test(p, threshold, || Finding::ChiSquare { statistic, dof, p });
        judgement.histogram = Some(Histogram { cells: masses.cells, observed, expected });
        if let Some(CellIntegral { value, error }) = integral {
            for (component, (moments, expected)) in counts.weights.iter().zip(value).enumerate() {
                let slack = error + (ROUNDING + self.half_rounding(0)) * expected.abs();
                let mean = match Mean::of(moments, expected, slack) {
                    Ok(mean) => mean,
                    Err(_) if !judgement.findings.is_empty() => continue,
                    Err(none) => return Err(self.evidence(none).into()),
                };
                let Mean { mean, error, p, .. } = mean;
                let of = format!("the mean of component {component} of eval cos / pdf");
                judgement.test(p, threshold, || Finding::Mean { of, mean, error, expected, p });
            }
        }
        Ok(judgement)
    }

    /// Returns the probability that the check rejects samples of the second density: the larger of the probabilities
    /// for the histogram and for the number of samples outside of the support.
    pub(super) fn power(&self) -> Result<f64, Stop> {
        let claimed = self.masses(self.cells()?, 0)?;
        let actual = self.masses(claimed.cells.clone(), 1)?;
        let settings = self.settings();
        let (samples, threshold) = (settings.samples as f64, self.configuration.threshold);
        let shares = |masses: &Masses| -> Vec<f64> {
            masses.mass.iter().map(|mass| (mass / masses.total).max(0.0)).collect()
        };
        let inside = samples * actual.total.min(1.0);
        let shape = chi_square_power(&shares(&claimed), &shares(&actual), inside, threshold)
            .map_err(|none| self.evidence(none))?;
        let bound = settings.mass + self.half_rounding(0) + claimed.error;
        let off = claimed.total - 1.0;
        if off > bound || !settings.may_leave_support && off < -bound {
            return Ok(1.0); // the check fails for any samples
        }
        if !settings.may_leave_support {
            return Ok(shape);
        }
        let deviation = (actual.total * (1.0 - actual.total) / samples).max(0.0).sqrt();
        let left = mean_power(claimed.total - actual.total, deviation, bound, threshold)
            .map_err(|none| self.evidence(none))?;
        Ok(shape.max(left))
    }

    fn count(&self, cells: &Cells, estimates: bool) -> Result<Counts, Failure> {
        let settings = self.settings();
        let (sampler, pdf) = (self.calls(), self.other(0));
        let mut counts = Counts { observed: vec![0; cells.len()], ..Counts::default() };
        let samples = usize::try_from(settings.samples).unwrap_or(usize::MAX);
        if estimates {
            counts.weights = vec![Moments::default(); self.other(1).words()];
        }
        for first in (0..samples).step_by(STRIDE) {
            let count = STRIDE.min(samples - first);
            let lanes = self.draw(self.configuration.seed, first, count);
            let results = sampler.call(&lanes, count)?;
            let width = lanes.len() / count;
            // The points on the support, as `u32` words, and their cosines.
            let mut inside = Vec::with_capacity(results.len());
            let mut cosines = Vec::with_capacity(count);
            for (index, result) in results.chunks_exact(sampler.words()).enumerate() {
                let shown = || sampler.shown(&lanes[index * width..][..width], result);
                let at = point(result);
                if at.iter().any(|value| !value.is_finite()) {
                    counts.not_finite.add(shown);
                    continue;
                }
                match settings.support.locate(at) {
                    Place::Inside(at) => counts.observed[cells.index(at)] += 1,
                    Place::NotUnit => {
                        counts.not_unit.add(shown);
                        continue;
                    }
                    Place::Outside => {
                        counts.left += 1;
                        // A sample outside of the support reflects no light, so its weight is 0.
                        counts.weights.iter_mut().for_each(|moments| moments.add(0.0));
                        if !settings.may_leave_support {
                            counts.outside.add(shown);
                        }
                        continue;
                    }
                }
                inside.extend_from_slice(result);
                cosines.push(at[2].abs());
            }
            counts.inside += cosines.len() as u64;
            if cosines.is_empty() {
                continue;
            }
            let (lanes, densities) = self.at(0, &inside)?;
            let width = lanes.len() / cosines.len();
            for (index, word) in densities.iter().enumerate() {
                let shown = || pdf.shown(&lanes[index * width..][..width], &[*word]);
                let value = f32::from_bits(*word);
                if !value.is_finite() {
                    counts.not_finite.add(shown);
                } else if value < 0.0 {
                    counts.negative.add(shown);
                } else if value == 0.0 {
                    counts.impossible.add(shown);
                }
            }
            if estimates {
                self.weigh(&mut counts, &inside, &densities, &cosines)?;
            }
        }
        Ok(counts)
    }

    /// Computes the weight eval cos / pdf of each sample on the support, and adds the weight to `counts.weights`.
    fn weigh(
        &self,
        counts: &mut Counts,
        inside: &[u32],
        densities: &[u32],
        cosines: &[f64],
    ) -> Result<(), Failure> {
        let eval = self.other(1);
        let (lanes, results) = self.at(1, inside)?;
        let weighed = (self.others.len() > 2).then(|| self.at(2, inside)).transpose()?;
        let width = lanes.len() / cosines.len();
        for (index, result) in results.chunks_exact(eval.words()).enumerate() {
            let shown = || eval.shown(&lanes[index * width..][..width], result);
            let density = f64::from(f32::from_bits(densities[index]));
            let weights = result
                .iter()
                .map(|word| f64::from(f32::from_bits(*word)) * cosines[index] / density);
            if let Some((lanes, results)) = &weighed {
                let (width, words) = (lanes.len() / cosines.len(), eval.words());
                let rounding =
                    ROUNDING + (0..3).map(|which| self.half_rounding(which)).sum::<f64>();
                let returned = &results[index * words..][..words];
                let right = weights.clone().zip(returned).all(|(weight, word)| {
                    let returned = f64::from(f32::from_bits(*word));
                    (returned - weight).abs() <= rounding * weight + VANISHED
                });
                // Karat has already counted a sample with density 0 as impossible.
                if !right && density > 0.0 {
                    counts.weight.add(|| {
                        let call = self.other(2).shown(&lanes[index * width..][..width], returned);
                        let weights: Vec<f64> = weights.clone().collect();
                        format!("{call}, not {weights:?}")
                    });
                }
            }
            if density > 0.0 && weights.clone().any(|weight| !weight.is_finite()) {
                counts.not_finite.add(shown);
            } else if weights.clone().any(|weight| weight < 0.0) {
                counts.negative.add(shown);
            } else if density > 0.0 {
                counts.weights.iter_mut().zip(weights).for_each(|(sum, weight)| sum.add(weight));
            }
        }
        Ok(())
    }
}
