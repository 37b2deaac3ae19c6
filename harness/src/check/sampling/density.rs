//! Samples against the density that they should have, and what they estimate.

use super::calls::{At, Calls, STRIDE, draw};
use super::picture::Histogram;
use super::{
    Assertion, Configuration, Finding, Fit, Functions, Judgement, Power, Samples, Settings,
};
use super::{conclude, fit_or_panic};
use crate::check::session::signature;
use crate::check::{Failure, Probe, Recording};
use crate::domain::Domain;
use crate::stats::{
    CellIntegral, Cells, ChiSquare, CubatureError, Mean, Moments, NoVerdict, Place, accepts,
    binomial_tail, chi_square_power, integrate, mean_power,
};
use crate::value::{Arguments, Scalar, Shape, Shareable};

/// Samples that lay the cells; thirty for each of 512.
const PILOT: usize = 16_384;

/// The pilot's random numbers are none of the judged samples'.
const PILOT_SEED: u64 = 0x5bf0_3635_dcf8_e1a7;

/// Samples that a cell should get at least, by their number; there are 512 cells at most.
const PER_CELL: u64 = 64;

/// Fewer samples make fewer cells than a density can be told from another by.
const FEWEST: u64 = 1024;

/// Error of a cell's integral over the deviation of its count. All cells together shift
/// chi-square by at most a thousandth of its degrees of freedom.
const QUADRATURE: f64 = 0.03;

/// Error of a cell's integral of what is estimated; of 512 cells together 2e-5. Of large values,
/// the relative error: a tenth of what their rounding may be.
const ESTIMATE: f64 = 1e-6;
const ESTIMATE_RELATIVE: f64 = 0.1 * ROUNDING;

/// Rounding of what is estimated, relative: a few hundred ulp of eval and pdf.
const ROUNDING: f64 = 1e-4;

/// Rounding of a texel to a half float, relative: eleven significant bits.
const HALF: f64 = 1.0 / 2048.0;

/// Weights as small as this are equal: eval and pdf of a lobe's end may be flushed.
const VANISHED: f64 = 1e-6;

impl<D, U, A, F> Samples<'_, D, U, A, F>
where
    D: Domain,
    U: Shareable,
    A: Arguments,
    F: Fn(&D::Value, U) -> A + Sync,
{
    /// Checks that samples have a density: Pearson's chi-square over cells of the support, against
    /// integrals of the density over them. `arguments` makes the density's arguments of a
    /// configuration and a point of the support: a `Vec3`, a `Vec2` of the disk, an `f32`.
    ///
    /// There are some 512 cells, laid where samples are. What averages out within one of them isn't
    /// seen, nor is a spike of the density that no sample meets and no quadrature node either:
    /// compare the density itself with a reference as well.
    ///
    /// The density's integral has to be 1; with [`may_leave`](Self::may_leave), what it falls
    /// short of 1 has to be the share of the samples beside the support. A sample whose density
    /// is 0 fails, whatever the others do.
    ///
    /// # Panics
    /// With the [`Failure`], if a configuration is rejected or has no verdict. A picture of the
    /// worst is written below `target/karat/samples`.
    #[track_caller]
    pub fn follows<X: Shareable, B: Arguments>(
        self,
        density: Probe<'_>,
        arguments: impl Fn(&D::Value, X) -> B + Sync,
    ) -> Fit {
        fit_or_panic(self.check_density(density, arguments, Recording::On))
    }

    /// [`follows`](Self::follows) without the panic.
    ///
    /// # Errors
    /// If a configuration is rejected or has no verdict.
    pub fn try_follows<X: Shareable, B: Arguments>(
        self,
        density: Probe<'_>,
        arguments: impl Fn(&D::Value, X) -> B + Sync,
    ) -> Result<Fit, Failure> {
        self.check_density(density, arguments, Recording::Off)
    }

    fn check_density<X: Shareable, B: Arguments>(
        self,
        density: Probe<'_>,
        arguments: impl Fn(&D::Value, X) -> B + Sync,
        recording: Recording,
    ) -> Result<Fit, Failure> {
        let Self { plan, settings, .. } = &self;
        let text = format!("{} on {}", density.path, settings.support);
        let assertion = Assertion { check: "follows", text, tests: settings.tests() };
        let functions = (A::shapes(), vec![(density, B::shapes())]);
        let expect =
            |functions: &Functions<'_, '_, D>| expect_density::<D, X, U>(functions, settings);
        conclude(
            plan,
            settings,
            &assertion,
            functions,
            recording,
            expect,
            |functions, configuration| {
                let density_at = |point: X, lanes: &mut Vec<u32>| {
                    arguments(configuration.value, point).store_all(lanes);
                };
                let run = Run {
                    functions,
                    settings,
                    configuration,
                    draw: &|seed, first, count| {
                        draw(seed, first, count, |u| (self.arguments)(configuration.value, u))
                    },
                };
                run.judge(&density_at, None)
            },
        )
    }

    /// Checks a sampler with the function that it is made for: samples follow the density, and
    /// the mean of eval cos / pdf is the integral of eval cos, component by component. That shows
    /// that eval is sampled wherever it isn't 0, with weights of finite variance. It doesn't show
    /// that `eval` is right: the mean of any other function would be its own integral. `eval` and
    /// `density` come with what makes their arguments of a configuration and a direction; cos is
    /// the direction's z, or what is left of its sign on the whole sphere.
    ///
    /// # Panics
    /// With the [`Failure`], if a configuration is rejected or has no verdict.
    #[track_caller]
    pub fn estimates<X: Shareable, B: Arguments, E: Arguments>(
        self,
        eval: (Probe<'_>, impl Fn(&D::Value, X) -> E + Sync),
        density: (Probe<'_>, impl Fn(&D::Value, X) -> B + Sync),
    ) -> Fit {
        fit_or_panic(self.check_estimate(
            eval,
            density,
            None::<Unweighted<'_, D, X>>,
            Recording::On,
        ))
    }

    /// [`estimates`](Self::estimates) without the panic.
    ///
    /// # Errors
    /// If a configuration is rejected or has no verdict.
    pub fn try_estimates<X: Shareable, B: Arguments, E: Arguments>(
        self,
        eval: (Probe<'_>, impl Fn(&D::Value, X) -> E + Sync),
        density: (Probe<'_>, impl Fn(&D::Value, X) -> B + Sync),
    ) -> Result<Fit, Failure> {
        self.check_estimate(eval, density, None::<Unweighted<'_, D, X>>, Recording::Off)
    }

    /// [`estimates`](Self::estimates), and a third function, `weight`, returns eval cos / pdf of
    /// each sample, to 1e-4 of it.
    ///
    /// # Panics
    /// With the [`Failure`], if a configuration is rejected or has no verdict.
    #[track_caller]
    pub fn estimates_with_weight<X: Shareable, B: Arguments, E: Arguments, W: Arguments>(
        self,
        eval: (Probe<'_>, impl Fn(&D::Value, X) -> E + Sync),
        density: (Probe<'_>, impl Fn(&D::Value, X) -> B + Sync),
        weight: (Probe<'_>, impl Fn(&D::Value, X) -> W + Sync),
    ) -> Fit {
        fit_or_panic(self.check_estimate(eval, density, Some(weight), Recording::On))
    }

    /// [`estimates_with_weight`](Self::estimates_with_weight) without the panic.
    ///
    /// # Errors
    /// If a configuration is rejected or has no verdict.
    pub fn try_estimates_with_weight<X: Shareable, B: Arguments, E: Arguments, W: Arguments>(
        self,
        eval: (Probe<'_>, impl Fn(&D::Value, X) -> E + Sync),
        density: (Probe<'_>, impl Fn(&D::Value, X) -> B + Sync),
        weight: (Probe<'_>, impl Fn(&D::Value, X) -> W + Sync),
    ) -> Result<Fit, Failure> {
        self.check_estimate(eval, density, Some(weight), Recording::Off)
    }

    fn check_estimate<X: Shareable, B: Arguments, E: Arguments, W: Arguments>(
        self,
        (eval, of_eval): (Probe<'_>, impl Fn(&D::Value, X) -> E + Sync),
        (density, of_density): (Probe<'_>, impl Fn(&D::Value, X) -> B + Sync),
        weight: Option<(Probe<'_>, impl Fn(&D::Value, X) -> W + Sync)>,
        recording: Recording,
    ) -> Result<Fit, Failure> {
        let Self { plan, settings, .. } = &self;
        let text = format!("{} by {} on {}", eval.path, density.path, settings.support);
        // A reflectance has up to three components, whose means are tests of their own.
        let assertion = Assertion { check: "estimates", text, tests: settings.tests() + 3 };
        let (weight, of_weight) = weight.unzip();
        let weight = weight.map(|weight| (weight, W::shapes()));
        let others = [(density, B::shapes()), (eval, E::shapes())].into_iter().chain(weight);
        let functions = (A::shapes(), others.collect());
        let expect = |functions: &Functions<'_, '_, D>| {
            expect_density::<D, X, U>(functions, settings)?;
            let eval = &functions.others[1];
            let scalars = eval.scalars();
            if settings.support.components() != 3 {
                let mismatch = format!("is estimated on {}, not by directions", settings.support);
                return Err(signature(&eval.probed.function, mismatch));
            }
            if scalars.len() > 3 || !scalars.into_iter().all(Scalar::is_float) {
                let result = &eval.probed.function.result;
                let mismatch = format!("returns {result}, not up to three floats");
                return Err(signature(&eval.probed.function, mismatch));
            }
            functions.others.get(2).map_or(Ok(()), |weight| {
                weight.expect_result(&eval.probed.function.result, "eval returns", None)
            })
        };
        conclude(
            plan,
            settings,
            &assertion,
            functions,
            recording,
            expect,
            |functions, configuration| {
                let value = configuration.value;
                let density_at = |point: X, lanes: &mut Vec<u32>| {
                    of_density(value, point).store_all(lanes);
                };
                let eval_at =
                    |point: X, lanes: &mut Vec<u32>| of_eval(value, point).store_all(lanes);
                let weight_at = of_weight.as_ref().map(|of_weight| {
                    |point: X, lanes: &mut Vec<u32>| of_weight(value, point).store_all(lanes)
                });
                let run = Run {
                    functions,
                    settings,
                    configuration,
                    draw: &|seed, first, count| {
                        draw(seed, first, count, |u| (self.arguments)(value, u))
                    },
                };
                let weight = weight_at.as_ref().map(|weight| weight as At<'_, X>);
                run.judge(&density_at, Some(&Estimate { eval: &eval_at, weight }))
            },
        )
    }

    /// How likely [`follows`](Self::follows) is to reject a sampler whose samples have another
    /// density, `alternative`, which takes the same arguments. Nothing is asserted.
    ///
    /// The cells are laid by the sampler's own samples; chi-square is non-central then.
    ///
    /// # Errors
    /// If there is no verdict to be had of the densities.
    pub fn power_against<X: Shareable, B: Arguments>(
        &self,
        density: Probe<'_>,
        arguments: impl Fn(&D::Value, X) -> B + Sync,
        alternative: Probe<'_>,
    ) -> Result<Power, Failure> {
        let Self { plan, settings, .. } = self;
        let text = format!("{} against {}", density.path, alternative.path);
        let assertion = Assertion { check: "power_against", text, tests: settings.tests() };
        let functions = (A::shapes(), vec![(density, B::shapes()), (alternative, B::shapes())]);
        let expect = |functions: &Functions<'_, '_, D>| {
            expect_density::<D, X, U>(functions, settings)?;
            expect_scalar(functions, 1)
        };
        let mut power = Power::none();
        conclude(
            plan,
            settings,
            &assertion,
            functions,
            Recording::Off,
            expect,
            |functions, configuration| {
                let at = |point: X, lanes: &mut Vec<u32>| {
                    arguments(configuration.value, point).store_all(lanes);
                };
                let run = Run {
                    functions,
                    settings,
                    configuration,
                    draw: &|seed, first, count| {
                        draw(seed, first, count, |u| (self.arguments)(configuration.value, u))
                    },
                };
                match run.power(&at) {
                    Ok(found) => {
                        power.add(found, configuration.value);
                        Ok(Judgement::fitting())
                    }
                    Err(Stop::Failure(failure)) => Err(failure),
                    Err(Stop::Finding(finding)) => Ok(Judgement::outright(finding)),
                }
            },
        )?;
        Ok(power)
    }
}

impl Settings {
    /// Tests of one configuration: the histogram, and the number of samples beside it.
    fn tests(&self) -> u64 {
        if self.may_leave { 2 } else { 1 }
    }

    /// Rows and columns of cells.
    fn grid(&self) -> (usize, usize) {
        let cells = (self.samples / PER_CELL).clamp(2, 512) as usize;
        if self.support.is_line() {
            return (cells, 1);
        }
        // Twice as many columns as rows: azimuths go all around.
        let rows = ((cells as f64 / 2.0).sqrt() as usize).clamp(1, 16);
        (rows, cells / rows)
    }
}

/// No function that returns weights.
type Unweighted<'a, D, X> = (Probe<'a>, fn(&<D as Domain>::Value, X) -> f32);

/// What samples estimate the integral of, and what returns their weights.
struct Estimate<'f, X> {
    eval: At<'f, X>,
    weight: Option<At<'f, X>>,
}

/// Compares the signatures of sampler and density with the support.
fn expect_density<D: Domain, X: Shareable, U: Shareable>(
    functions: &Functions<'_, '_, D>,
    settings: &Settings,
) -> Result<(), Failure> {
    functions.sampler(0, 0).expect_random::<U>()?;
    let support = settings.support;
    let point = match support.components() {
        1 => Shape::Scalar(Scalar::F32),
        size => Shape::Vector { size: if size == 2 { 2 } else { 3 }, scalar: Scalar::F32 },
    };
    let sampler = functions.sampler;
    sampler.expect_result(&point, &format!("a point of {support} is"), None)?;
    if X::shape() != point {
        let shape = X::shape();
        let mismatch = format!("is given {shape} of {support}, whose points are {point}");
        return Err(signature(&functions.others[0].probed.function, mismatch));
    }
    expect_scalar(functions, 0)
}

fn expect_scalar<D: Domain>(functions: &Functions<'_, '_, D>, which: usize) -> Result<(), Failure> {
    functions.others[which].expect_result(&Shape::Scalar(Scalar::F32), "a density is", None)
}

/// Why a configuration isn't judged to its end.
enum Stop {
    Failure(Failure),
    Finding(Finding),
}

impl From<Failure> for Stop {
    fn from(failure: Failure) -> Self {
        Self::Failure(failure)
    }
}

impl Judgement {
    /// Nothing to object to.
    pub(super) fn fitting() -> Self {
        Self { findings: Vec::new(), p: 1.0, notes: Vec::new(), histogram: None }
    }

    fn outright(finding: Finding) -> Self {
        Self { findings: vec![finding], p: 0.0, ..Self::fitting() }
    }

    /// Adds a test's result.
    pub(super) fn test(&mut self, p: f64, threshold: f64, finding: impl FnOnce() -> Finding) {
        self.p = self.p.min(p);
        if !accepts(p, threshold) {
            self.findings.push(finding());
        }
    }
}

/// How many calls offend, and the first of them.
#[derive(Default)]
pub(super) struct Offence {
    count: u64,
    first: String,
}

impl Offence {
    pub(super) fn add(&mut self, call: impl FnOnce() -> String) {
        if self.count == 0 {
            self.first = call();
        }
        self.count += 1;
    }

    pub(super) fn finding(self, finding: impl FnOnce(u64, String) -> Finding) -> Option<Finding> {
        (self.count > 0).then(|| finding(self.count, self.first))
    }
}

/// One configuration on one path.
struct Run<'r, 's, 'd, D: Domain> {
    functions: &'r Functions<'s, 'd, D>,
    settings: &'r Settings,
    configuration: &'r Configuration<'r, D::Value>,
    /// Arguments of calls of the sampler: seed, first sample, how many.
    draw: &'r dyn Fn(u64, usize, usize) -> Vec<u32>,
}

/// The density's integrals.
struct Masses {
    cells: Cells,
    mass: Vec<f64>,
    total: f64,
    error: f64,
}

/// What the samples of a configuration came to.
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
    /// Of eval cos / pdf, by component.
    weights: Vec<Moments>,
}

impl<D: Domain> Run<'_, '_, '_, D> {
    fn sampler(&self) -> Calls<'_> {
        self.functions.sampler(self.configuration.path, self.configuration.seed)
    }

    fn other(&self, which: usize) -> Calls<'_> {
        self.functions.other(which, self.configuration.path, self.configuration.seed)
    }

    /// What a function's values are off by, relative, where it reads textures that the path keeps
    /// in half floats: the peak of a lobe may come from one texel.
    fn half_rounding(&self, which: usize) -> f64 {
        if self.other(which).runner.reads_half_floats() { HALF } else { 0.0 }
    }

    fn evidence(&self, reason: impl std::fmt::Display) -> Failure {
        let Configuration { value, index, .. } = self.configuration;
        Failure::Evidence {
            function: self.functions.sampler.probed.function.path.clone(),
            reason: reason.to_string(),
            case: *index,
            configuration: format!("{value:?}"),
        }
    }

    fn judge<X: Shareable>(
        &self,
        density: At<'_, X>,
        estimate: Option<&Estimate<'_, X>>,
    ) -> Result<Judgement, Failure> {
        match self.judge_or_stop(density, estimate) {
            Ok(judgement) => Ok(judgement),
            Err(Stop::Finding(finding)) => Ok(Judgement::outright(finding)),
            Err(Stop::Failure(failure)) => Err(failure),
        }
    }

    fn judge_or_stop<X: Shareable>(
        &self,
        density: At<'_, X>,
        estimate: Option<&Estimate<'_, X>>,
    ) -> Result<Judgement, Stop> {
        let cells = self.cells()?;
        let masses = self.masses(cells, 0, density)?;
        let counts = self.count(&masses.cells, density, estimate)?;
        let integral = estimate.map(|of| self.estimate(&masses.cells, of.eval)).transpose()?;
        let settings = self.settings;
        let threshold = self.configuration.threshold;
        let mut judgement = Judgement::fitting();
        let Counts { observed, inside, left, .. } = counts;
        let samples = settings.samples;
        let note = format!("{inside} of {samples} samples on {}", settings.support);
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
        // A density that leaves samples out is short of 1 by as much as they are.
        let right = if settings.may_leave { off <= bound } else { off.abs() <= bound };
        if !right {
            judgement.findings.push(Finding::Mass { integral: total, bound });
        }
        if !judgement.findings.is_empty() {
            judgement.p = 0.0;
        }
        // A density whose integral is wrong says nothing of how many samples leave.
        if settings.may_leave && right {
            // Of all shares within the integral's error, the one that the samples speak for most.
            let share = left as f64 / samples as f64;
            let nearest =
                share.clamp((-off - bound).clamp(0.0, 1.0), (bound - off).clamp(0.0, 1.0));
            let p = binomial_tail(left, samples, nearest);
            let expected = (-off).max(0.0) * samples as f64;
            judgement.test(p, threshold, || Finding::Left { left, expected, p });
        }
        // Given how many are on the support, they should be shared out like the density.
        let expected: Vec<f64> =
            masses.mass.iter().map(|mass| (mass / total).max(0.0) * inside as f64).collect();
        let test = match ChiSquare::of(&observed, &expected) {
            Ok(test) => test,
            // Of no sample on the support nothing more can be said than was found already.
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
                let of = format!("component {component} of eval cos / pdf");
                judgement.test(p, threshold, || Finding::Mean { of, mean, error, expected, p });
            }
        }
        Ok(judgement)
    }

    /// The power of the histogram's test, or of those of the integral, against the second density.
    fn power<X: Shareable>(&self, at: At<'_, X>) -> Result<f64, Stop> {
        let claimed = self.masses(self.cells()?, 0, at)?;
        let actual = self.masses(claimed.cells.clone(), 1, at)?;
        let settings = self.settings;
        let (samples, threshold) = (settings.samples as f64, self.configuration.threshold);
        let shares = |masses: &Masses| -> Vec<f64> {
            masses.mass.iter().map(|mass| (mass / masses.total).max(0.0)).collect()
        };
        let inside = samples * actual.total.min(1.0);
        let shape = chi_square_power(&shares(&claimed), &shares(&actual), inside, threshold)
            .map_err(|none| self.evidence(none))?;
        let bound = settings.mass + self.half_rounding(0) + claimed.error;
        let off = claimed.total - 1.0;
        if off > bound || !settings.may_leave && off < -bound {
            return Ok(1.0); // whatever the samples
        }
        if !settings.may_leave {
            return Ok(shape);
        }
        let deviation = (actual.total * (1.0 - actual.total) / samples).max(0.0).sqrt();
        let left = mean_power(claimed.total - actual.total, deviation, bound, threshold)
            .map_err(|none| self.evidence(none))?;
        Ok(shape.max(left))
    }

    /// The cells, laid by samples that are not judged.
    fn cells(&self) -> Result<Cells, Stop> {
        let settings = self.settings;
        if settings.samples < FEWEST {
            let (found, needed) = (settings.samples, FEWEST);
            return Err(self.evidence(NoVerdict::TooFew { found, needed }).into());
        }
        let sampler = self.sampler();
        let lanes = (self.draw)(self.configuration.seed ^ PILOT_SEED, 0, PILOT);
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

    /// Integrates a density over the cells.
    fn masses<X: Shareable>(
        &self,
        cells: Cells,
        which: usize,
        at: At<'_, X>,
    ) -> Result<Masses, Stop> {
        let samples = self.settings.samples as f64;
        // Of an expected count of 0.1 nothing need be known. All cells together are also known four
        // times better than their sum is judged, however few the samples.
        let per_root = (QUADRATURE / samples.sqrt()).min(self.settings.mass.max(1e-6) / 4.0);
        let tolerance = |mass: &[f64]| per_root * mass[0].max(0.1 / samples).sqrt();
        let calls = self.other(which);
        let integrals = integrate(self.settings.support, &cells, 1, tolerance, |points| {
            self.evaluate(&calls, points, at)
        });
        let integrals = integrals.map_err(|error| self.stop(&calls, error))?;
        let mass: Vec<f64> = integrals.iter().map(|cell| cell.value[0]).collect();
        let error = integrals.iter().map(|cell| cell.error * cell.error).sum::<f64>().sqrt();
        let total = mass.iter().sum();
        if !(total > 0.0) {
            let bound = self.settings.mass;
            return Err(Stop::Finding(Finding::Mass { integral: total, bound }));
        }
        Ok(Masses { cells, mass, total, error })
    }

    /// Integrates eval cos over the support.
    fn estimate<X: Shareable>(&self, cells: &Cells, at: At<'_, X>) -> Result<CellIntegral, Stop> {
        let calls = self.other(1);
        let components = calls.words();
        let support = self.settings.support;
        let integrals = integrate(
            support,
            cells,
            components,
            |known| known.iter().fold(ESTIMATE, |most, v| most.max(ESTIMATE_RELATIVE * v.abs())),
            |points| {
                let mut values = self.evaluate(&calls, points, at)?;
                for (values, point) in values.chunks_exact_mut(components).zip(points) {
                    values.iter_mut().for_each(|value| *value *= point[2].abs());
                }
                Ok(values)
            },
        );
        let integrals = integrals.map_err(|error| self.stop(&calls, error))?;
        let mut sum = CellIntegral { value: vec![0.0; components], error: 0.0 };
        for integral in integrals {
            sum.error = sum.error.hypot(integral.error);
            for (sum, value) in sum.value.iter_mut().zip(integral.value) {
                *sum += value;
            }
        }
        Ok(sum)
    }

    fn stop(&self, calls: &Calls<'_>, error: CubatureError<Stop>) -> Stop {
        match error {
            CubatureError::Evaluation(stop) => stop,
            diverges @ CubatureError::Diverges { .. } => {
                let function = &calls.probed.function.path;
                let reason = match diverges {
                    CubatureError::Diverges { nodes } => {
                        format!(
                            "of `{function}` two quadrature rules disagree after {nodes} nodes: it \
                             jumps along too many edges, or its results are noisy"
                        )
                    }
                    CubatureError::Evaluation(_) => String::new(),
                };
                Stop::Failure(self.evidence(reason))
            }
        }
    }

    /// What a function returns at points, which has to be finite and not negative.
    fn evaluate<X: Shareable>(
        &self,
        calls: &Calls<'_>,
        points: &[[f64; 3]],
        at: At<'_, X>,
    ) -> Result<Vec<f64>, Stop> {
        let components = self.settings.support.components();
        let points: Vec<X> = points
            .iter()
            .map(|point| {
                #[expect(clippy::cast_possible_truncation, reason = "arguments are f32")]
                let words = point.map(|value| (value as f32).to_bits());
                X::load(&mut words[..components].iter())
            })
            .collect();
        let (lanes, results) = calls.at(&points, at)?;
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

    /// Draws the samples, and counts them by cell.
    fn count<X: Shareable>(
        &self,
        cells: &Cells,
        density: At<'_, X>,
        estimate: Option<&Estimate<'_, X>>,
    ) -> Result<Counts, Failure> {
        let settings = self.settings;
        let (sampler, pdf) = (self.sampler(), self.other(0));
        let mut counts = Counts { observed: vec![0; cells.len()], ..Counts::default() };
        let samples = usize::try_from(settings.samples).unwrap_or(usize::MAX);
        if estimate.is_some() {
            counts.weights = vec![Moments::default(); self.other(1).words()];
        }
        for first in (0..samples).step_by(STRIDE) {
            let count = STRIDE.min(samples - first);
            let lanes = (self.draw)(self.configuration.seed, first, count);
            let results = sampler.call(&lanes, count)?;
            let width = lanes.len() / count;
            let mut inside: Vec<X> = Vec::with_capacity(count);
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
                        // It reflects nothing, and counts as such.
                        counts.weights.iter_mut().for_each(|moments| moments.add(0.0));
                        if !settings.may_leave {
                            counts.outside.add(shown);
                        }
                        continue;
                    }
                }
                inside.push(X::load(&mut result.iter()));
                cosines.push(at[2].abs());
            }
            counts.inside += inside.len() as u64;
            if inside.is_empty() {
                continue;
            }
            let (lanes, densities) = pdf.at(&inside, density)?;
            let width = lanes.len() / inside.len();
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
            if let Some(estimate) = estimate {
                self.weigh(&mut counts, &inside, estimate, &densities, &cosines)?;
            }
        }
        Ok(counts)
    }

    /// Adds eval cos / pdf of samples on the support.
    fn weigh<X: Shareable>(
        &self,
        counts: &mut Counts,
        inside: &[X],
        estimate: &Estimate<'_, X>,
        densities: &[u32],
        cosines: &[f64],
    ) -> Result<(), Failure> {
        let eval = self.other(1);
        let (lanes, results) = eval.at(inside, estimate.eval)?;
        let weighed = match estimate.weight {
            Some(at) => Some(self.other(2).at(inside, at)?),
            None => None,
        };
        let width = lanes.len() / inside.len();
        for (index, result) in results.chunks_exact(eval.words()).enumerate() {
            let shown = || eval.shown(&lanes[index * width..][..width], result);
            let density = f64::from(f32::from_bits(densities[index]));
            let weights = result
                .iter()
                .map(|word| f64::from(f32::from_bits(*word)) * cosines[index] / density);
            if let Some((lanes, results)) = &weighed {
                let (width, words) = (lanes.len() / inside.len(), eval.words());
                let rounding =
                    ROUNDING + (0..3).map(|which| self.half_rounding(which)).sum::<f64>();
                let returned = &results[index * words..][..words];
                let right = weights.clone().zip(returned).all(|(weight, word)| {
                    let returned = f64::from(f32::from_bits(*word));
                    (returned - weight).abs() <= rounding * weight + VANISHED
                });
                // What is 0 / 0 is an impossible sample already.
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

/// The point that a sampler returned.
pub(super) fn point(result: &[u32]) -> [f64; 3] {
    let mut point = [0.0; 3];
    for (value, word) in point.iter_mut().zip(result) {
        *value = f64::from(f32::from_bits(*word));
    }
    point
}
