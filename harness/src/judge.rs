//! The judges of cases and of buffer elements. A judge checks the words of each result against the check's
//! assertion, and counts the failures.

use std::ops::Range;

use crate::executor::View;
use crate::parallel;
use crate::record::{self, ExpectationDetails};
use crate::tolerance::{LaneError, Tolerance, Unit};
use crate::value::Scalar;

/// The judgement of one case: the error of its worst component.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Judged {
    pub(crate) measure: LaneError,
    pub(crate) lane: usize,
    pub(crate) class: Class,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Class {
    Nan,
    Infinite,
    WrongSign,
    TooLow,
    TooHigh,
    /// No WGSL implementation may return the reference's value for this shader, so the shader is wrong.
    Shader,
    /// WGSL doesn't allow the result, so the driver is wrong.
    Driver,
    /// WGSL allows results that differ from the reference by more than the check permits.
    Conditioning,
    /// WGSL allows any result.
    Unbounded,
    /// In this case, the test in WGSL evaluated no expectation, such as `expect_less`.
    Idle,
    Other,
}

/// The numbers of cases and failures, and the number of failures of each kind.
///
/// ```
/// # use karat::check::Failure;
/// # use karat::prelude::*;
/// let package = Package::from_source("m", "fn f(x: f32) -> f32 { return 0.6 * x; }");
/// let wrong = package.function("f").over(0.1..=1.0).unrecorded().try_agrees_with(|x: f64| 0.5 * x, Ulp(1.0));
/// let Err(Failure::Disagreement(found)) = wrong else { panic!("it is 0.6") };
/// let census = &found.paths[0].census;
/// assert_eq!((census.nan, census.too_high), (0, census.failures));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Census {
    /// The number of cases that Karat compared.
    pub cases: u64,
    /// The number of cases that failed.
    pub failures: u64,
    /// The number of failures with NaN as the worst component.
    pub nan: u64,
    /// The number of failures with an infinite worst component.
    pub infinite: u64,
    /// The number of failures in which the worst component has the opposite sign of the reference.
    pub wrong_sign: u64,
    /// The number of failures in which the worst component is below the reference.
    pub too_low: u64,
    /// The number of failures in which the worst component is above the reference.
    pub too_high: u64,
    /// The number of failures under [`Spec`](crate::Spec) because no WGSL implementation may return the reference's
    /// value for the shader.
    pub shader: u64,
    /// The number of failures under [`Spec`](crate::Spec) because WGSL doesn't allow the result.
    pub driver: u64,
    /// The number of failures under [`Spec`](crate::Spec) because WGSL allows too large a range of results.
    pub ill_conditioned: u64,
    /// The number of failures under [`Spec`](crate::Spec) because WGSL allows any result.
    pub unbounded: u64,
    /// The number of cases in which a test in WGSL evaluated no expectation, such as `expect_less`.
    pub idle: u64,
    /// The number of cases with remembered inputs, on which the test failed before.
    pub remembered: u64,
}

impl Census {
    /// The number of cases in which the check made an assertion.
    pub(crate) fn judged(&self) -> u64 {
        self.cases - self.idle
    }

    /// The number of failures of each kind, as the end of a sentence: `, 3 NaN, 9 too low`.
    pub(crate) fn ways(&self) -> String {
        let ways = [
            (self.nan, "NaN"),
            (self.infinite, "infinite"),
            (self.wrong_sign, "with the wrong sign"),
            (self.too_low, "too low"),
            (self.too_high, "too high"),
            (self.shader, "with a reference value that WGSL doesn't allow"),
            (self.driver, "with a result that WGSL doesn't allow"),
            (self.ill_conditioned, "ill-conditioned"),
            (self.unbounded, "unbounded"),
        ];
        let ways = ways.into_iter().filter(|(count, _)| *count > 0);
        ways.map(|(count, way)| format!(", {count} {way}")).collect()
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Shown {
    pub(crate) case: u64,
    pub(crate) judged: Judged,
}

impl Shown {
    /// The index of the worst component in an array that has `width` words for each case.
    pub(crate) fn at(&self, width: usize) -> usize {
        usize::try_from(self.case).expect("they are in memory") * width + self.judged.lane
    }
}

/// The summed judgements of a path's cases. Karat can merge tallies in any order, with the same result.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Tally {
    pub(crate) census: Census,
    /// The case with the largest ratio. If several cases have the same ratio, the first one counts.
    pub(crate) worst: Option<Shown>,
    /// The failing case with the lowest index. Low indices belong to edges, which are the simplest cases.
    pub(crate) first: Option<Shown>,
}

impl Tally {
    pub(crate) fn add(&mut self, case: u64, judged: Judged) {
        self.census.cases += 1;
        let shown = Shown { case, judged };
        if self.worst.is_none_or(|worst| judged.measure.is_worse_than(&worst.judged.measure)) {
            self.worst = Some(shown);
        }
        if judged.measure.passes() {
            self.census.idle += u64::from(judged.class == Class::Idle);
            return;
        }
        self.census.failures += 1;
        self.first = self.first.or(Some(shown));
        match judged.class {
            Class::Nan => self.census.nan += 1,
            Class::Infinite => self.census.infinite += 1,
            Class::WrongSign => self.census.wrong_sign += 1,
            Class::TooLow => self.census.too_low += 1,
            Class::TooHigh => self.census.too_high += 1,
            Class::Shader => self.census.shader += 1,
            Class::Driver => self.census.driver += 1,
            Class::Conditioning => self.census.ill_conditioned += 1,
            Class::Unbounded => self.census.unbounded += 1,
            Class::Idle | Class::Other => {}
        }
    }

    pub(crate) fn merge(self, other: Self) -> Self {
        let (a, b) = (self.census, other.census);
        let worse = |a: Shown, b: Shown| {
            let [of_a, of_b] = [a, b].map(|shown| shown.judged.measure);
            let is_first = a.case <= b.case;
            let keeps = of_a.is_worse_than(&of_b) || is_first && !of_b.is_worse_than(&of_a);
            if keeps { a } else { b }
        };
        let earlier = |a: Shown, b: Shown| if a.case <= b.case { a } else { b };
        Self {
            census: Census {
                cases: a.cases + b.cases,
                failures: a.failures + b.failures,
                nan: a.nan + b.nan,
                infinite: a.infinite + b.infinite,
                wrong_sign: a.wrong_sign + b.wrong_sign,
                too_low: a.too_low + b.too_low,
                too_high: a.too_high + b.too_high,
                shader: a.shader + b.shader,
                driver: a.driver + b.driver,
                ill_conditioned: a.ill_conditioned + b.ill_conditioned,
                unbounded: a.unbounded + b.unbounded,
                idle: a.idle + b.idle,
                remembered: a.remembered + b.remembered,
            },
            worst: either(self.worst, other.worst, worse),
            first: either(self.first, other.first, earlier),
        }
    }
}

fn either(
    a: Option<Shown>,
    b: Option<Shown>,
    pick: impl Fn(Shown, Shown) -> Shown,
) -> Option<Shown> {
    match (a, b) {
        (Some(a), Some(b)) => Some(pick(a, b)),
        (a, b) => a.or(b),
    }
}

/// The number of cases that one task judges. A task of this size takes longer to run than to start.
const TASK: usize = 2048;

/// The text that a message shows instead of the result of a failing case.
pub(crate) struct Described {
    pub(crate) expectations: Vec<ExpectationDetails>,
    pub(crate) notes: Vec<(&'static str, String)>,
}

/// A judge of the cases of a batch. `judge` receives a case's index in the batch, and the words of its result.
pub(crate) trait Judge: Sync {
    fn judge(&self, case: usize, actual: &[u32]) -> Judged;

    /// Checks quickly if the case passes with a ratio of at most `ratio`. If this function returns `false`,
    /// [`judge`](Self::judge) must decide.
    fn is_within(&self, case: usize, actual: &[u32], ratio: f64) -> bool {
        let _ = (case, actual, ratio);
        false
    }

    /// Translates a failing case's result into text, if the result is an encoded report, such as that of a WGSL test.
    fn describe(&self, actual: &[u32]) -> Option<Described> {
        let _ = actual;
        None
    }

    /// Judges cases of a batch and adds them to the tally. The first case of the batch has the index
    /// `first_case`.
    fn add(
        &self,
        (tally, picked): (&mut Tally, &mut Picked),
        first_case: u64,
        cases: Range<usize>,
        results: View<'_>,
    ) {
        for case in cases {
            let actual = results.of(case);
            // Judges each case only once, because a judge may call a closure of the test's author.
            if picked.wants(case) {
                let judged = self.judge(case, actual);
                picked.ratios.push((case, judged.measure.ratio));
                picked.add_failing(case, judged);
                tally.add(first_case + case as u64, judged);
                continue;
            }
            // A passing case that isn't worse than the worst case only needs to be counted.
            let worst = tally.worst.map_or(f64::NEG_INFINITY, |worst| worst.judged.measure.ratio);
            if self.is_within(case, actual, worst.min(1.0)) {
                tally.census.cases += 1;
            } else {
                let judged = self.judge(case, actual);
                picked.add_failing(case, judged);
                tally.add(first_case + case as u64, judged);
            }
        }
    }
}

impl<F: Fn(usize, &[u32]) -> Judged + Sync> Judge for F {
    fn judge(&self, case: usize, actual: &[u32]) -> Judged {
        self(case, actual)
    }
}

/// The cases of a batch that Karat stores: some evenly spaced cases with their errors, and the cases that fail.
#[derive(Clone, Debug, Default)]
pub(crate) struct Picked {
    /// `true` if Karat stores failing cases.
    wants_failing: bool,
    pub(crate) failing: Vec<usize>,
    /// The distance between two evenly spaced cases. 0 if Karat stores only failing cases.
    every: usize,
    /// The indices of the evenly spaced cases in the batch, each with the case's ratio.
    pub(crate) ratios: Vec<(usize, f64)>,
}

impl Picked {
    /// Selects about `count` evenly spaced cases of a batch that has `of` cases, and stores their errors.
    pub(crate) fn some(count: usize, of: usize) -> Self {
        Self { every: of.div_ceil(count).max(1), ..Self::default() }
    }

    /// Also stores the failing cases.
    pub(crate) fn and_failing(self) -> Self {
        Self { wants_failing: true, ..self }
    }

    fn empty(&self) -> Self {
        Self { every: self.every, wants_failing: self.wants_failing, ..Self::default() }
    }

    fn add_failing(&mut self, case: usize, judged: Judged) {
        if self.wants_failing && !judged.measure.passes() {
            self.failing.push(case);
        }
    }

    fn wants(&self, case: usize) -> bool {
        self.every > 0 && case.is_multiple_of(self.every)
    }
}

/// Judges each case of a batch, and adds the ratios to `picked`. The batch's first case has the index `first_case`.
pub(crate) fn tally(
    first_case: u64,
    results: View<'_>,
    judge: &dyn Judge,
    picked: &mut Picked,
) -> Tally {
    let empty = picked.empty();
    let tallies = parallel::map(results.len().div_ceil(TASK), |task| {
        let (mut tally, mut picked) = (Tally::default(), empty.clone());
        let first = task * TASK;
        let cases = first..results.len().min(first + TASK);
        judge.add((&mut tally, &mut picked), first_case, cases, results);
        (tally, picked)
    });
    let all = tallies.into_iter().fold(Tally::default(), |sum, (tally, part)| {
        picked.ratios.extend(part.ratios);
        picked.failing.extend(part.failing);
        sum.merge(tally)
    });
    let ratio = all.worst.map_or(0.0, |worst| worst.judged.measure.ratio);
    record::saw(&mut (0..results.len()).map(|case| results.of(case)), ratio);
    all
}

/// Compares a result with its reference, component by component. The worst component decides the judgement.
pub(crate) fn compare(
    scalars: &[Scalar],
    actual: &[u32],
    expected: &[f64],
    tolerance: &Tolerance,
) -> Judged {
    let (lane, measure) = tolerance.measure_words(scalars, actual, expected);
    let told = !measure.passes() && scalars.get(lane).is_some_and(|scalar| scalar.is_float());
    let class = match told {
        true => classify(scalars[lane].decode(actual[lane]), expected[lane]),
        false => Class::Other,
    };
    Judged { measure, lane, class }
}

/// Checks if each component passes with a ratio of at most `ratio`. See [`Tolerance::is_within`].
#[inline]
pub(crate) fn is_within(
    scalars: &[Scalar],
    actual: &[u32],
    expected: &[f64],
    tolerance: &Tolerance,
    ratio: f64,
) -> bool {
    // A loop is faster than iterators in tests, which Cargo compiles with little optimisation. The loop runs
    // for each case.
    for (lane, scalar) in scalars.iter().enumerate() {
        let (word, expected) = (actual[lane], expected[lane]);
        let within = if scalar.is_float() {
            tolerance.is_within(lane, f64::from(f32::from_bits(word)), expected, ratio)
        } else {
            scalar.decode(word) == expected && 0.0 <= ratio
        };
        if !within {
            return false;
        }
    }
    true
}

pub(crate) fn classify(actual: f64, expected: f64) -> Class {
    if actual.is_nan() {
        Class::Nan
    } else if actual.is_infinite() {
        Class::Infinite
    } else if actual * expected < 0.0 {
        Class::WrongSign
    } else if actual < expected {
        Class::TooLow
    } else if actual > expected {
        Class::TooHigh
    } else {
        Class::Other
    }
}

/// Judges a result. The result fails if a component is NaN or infinite.
pub(crate) fn finite(scalars: &[Scalar], actual: &[u32]) -> Judged {
    let bad = scalars
        .iter()
        .zip(actual)
        .position(|(scalar, word)| scalar.is_float() && !f32::from_bits(*word).is_finite());
    let Some(lane) = bad else {
        return Judged { measure: LaneError::statement(true), lane: 0, class: Class::Other };
    };
    let nan = f32::from_bits(actual[lane]).is_nan();
    Judged {
        measure: LaneError {
            ratio: f64::INFINITY,
            error: f64::NAN,
            bound: 0.0,
            unit: Unit::Statement,
        },
        lane,
        class: if nan { Class::Nan } else { Class::Infinite },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tolerance::{Abs, Ulp};

    // Lesson 19
    #[test]
    fn one_bad_case_of_many_is_found_wherever_it_is() {
        let scalars = [Scalar::F32, Scalar::F32];
        let tolerance = Tolerance::from(Ulp(1.0));
        for bad in [0, 1, 2047, 2048, 4999] {
            for value in [f32::NAN, f32::INFINITY, -1.0, 0.5, 1.5] {
                let mut words = vec![1.0_f32.to_bits(); 10_000];
                words[2 * bad + 1] = value.to_bits();
                let results = View { words: &words, stride: 2, width: 2 };
                let mut picked = Picked::some(50, 5000);
                let judge =
                    |_: usize, actual: &[u32]| compare(&scalars, actual, &[1.0, 1.0], &tolerance);
                let sum = tally(100, results, &judge, &mut picked);
                assert_eq!(picked.ratios.len(), 50);
                assert_eq!((sum.census.cases, sum.census.failures), (5000, 1));
                let worst = sum.worst.expect("5000 cases");
                assert_eq!((worst.case, worst.judged.lane), (100 + bad as u64, 1));
                assert_eq!(sum.first.map(|first| first.case), Some(worst.case));
            }
        }
    }

    /// If the tolerance is 0, the ratio of every failure is infinite, so the error decides which case is the
    /// worst.
    #[test]
    fn the_worst_of_exact_cases_is_the_farthest() {
        let tolerance = Tolerance::from(Abs(0.0));
        let judge = |case: usize, actual: &[u32]| {
            assert!(case < 5000);
            compare(&[Scalar::F32], actual, &[1.0], &tolerance)
        };
        for (far, worst) in [(9.0, 4000), (1.25, 7), (f32::NAN, 4000)] {
            let mut words = vec![1.0_f32.to_bits(); 5000];
            words[7] = 1.5_f32.to_bits();
            words[4000] = far.to_bits();
            let view = View { words: &words, stride: 1, width: 1 };
            let sum = tally(0, view, &judge, &mut Picked::default());
            assert_eq!(sum.worst.map(|shown| shown.case), Some(worst), "{far}");
            assert_eq!(sum.first.map(|shown| shown.case), Some(7));
        }
    }

    #[test]
    fn integers_must_be_equal_under_any_tolerance() {
        let tolerance = Tolerance::from(Abs(10.0));
        let judged = compare(&[Scalar::U32], &[3], &[4.0], &tolerance);
        assert!(!judged.measure.passes());
        assert!(compare(&[Scalar::U32], &[4], &[4.0], &tolerance).measure.passes());
    }

    // Lesson 19
    #[test]
    fn failures_are_classed() {
        assert_eq!(classify(f64::NAN, 1.0), Class::Nan);
        assert_eq!(classify(f64::INFINITY, 1.0), Class::Infinite);
        assert_eq!(classify(-0.1, 0.1), Class::WrongSign);
        assert_eq!(classify(0.1, 0.2), Class::TooLow);
        assert_eq!(classify(0.3, 0.2), Class::TooHigh);
    }
}
