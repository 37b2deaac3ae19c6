//! The measured accuracy of one adapter's built-in functions.
//!
//! The specification allows large errors for some built-in functions. For example, a sine may have the error 2^-11
//! between -pi and pi, and any error elsewhere. Karat measures an adapter once, and allows twice the measured error.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use crate::interval::{Interval, ulp};
use crate::rules::{Exponential, FloatRule, Trigonometry};

/// The allowed error divided by the measured error. The factor is above 1 because the error may be larger between
/// two measured arguments than at either of them.
const SAFETY: f64 = 2.0;

/// The number of measured arguments for each sign and exponent.
const PER_EXPONENT: u32 = 256;

/// The largest number of measured arguments close to zeros of a sine, a cosine or a tangent, for each sign and
/// exponent. Near a zero of the function, the absolute error is as large as elsewhere, but an ulp of the result is
/// smaller.
const NEAR_ZEROS: u32 = 8;

/// If an adapter's error near a zero of a sine, a cosine or a tangent is larger than this number of ulps, Karat bounds
/// only the absolute error. A driver that reduces the argument with enough digits has an error of a few ulps near a
/// zero. Other drivers have errors of thousands of ulps.
const NEAR_ZERO_ULPS: f32 = 256.0;

/// The number of buckets of arguments: one bucket for each sign and exponent.
const BUCKETS: usize = 512;

/// The form of a function's graph, from which Karat finds the least and greatest value between two arguments.
#[derive(Clone, Copy, Debug)]
enum Shape {
    Monotonic,
    /// The function is even and has its least value at 0.
    Even,
    /// A wave with the period 2 pi, whose greatest value 1 is at this argument.
    Wave(f64),
    /// The function rises between its poles, which are the odd multiples of pi / 2.
    Tangent,
}

#[derive(Debug)]
struct Function {
    text: &'static str,
    rule: FloatRule,
    exact: fn(f64) -> f64,
    shape: Shape,
    domain: (f64, f64),
}

const ALL: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);
/// Numbers above zero that aren't subnormal, so drivers can't flush them.
const ABOVE_ZERO: (f64, f64) = (f32::MIN_POSITIVE as f64, f64::INFINITY);
const UNIT: (f64, f64) = (-1.0, 1.0);

macro_rules! function {
    ($text:literal, $family:ident::$name:ident, $exact:expr, $shape:expr, $domain:expr) => {
        Function {
            text: concat!($text, "(a)"),
            rule: FloatRule::$family($family::$name),
            exact: $exact,
            shape: $shape,
            domain: $domain,
        }
    };
}

static FUNCTIONS: [Function; 16] = [
    function!("exp", Exponential::Exp, libm::exp, Shape::Monotonic, ALL),
    function!("exp2", Exponential::Exp2, libm::exp2, Shape::Monotonic, ALL),
    function!("log", Exponential::Log, libm::log, Shape::Monotonic, ABOVE_ZERO),
    function!("log2", Exponential::Log2, libm::log2, Shape::Monotonic, ABOVE_ZERO),
    function!("sin", Trigonometry::Sin, libm::sin, Shape::Wave(FRAC_PI_2), ALL),
    function!("cos", Trigonometry::Cos, libm::cos, Shape::Wave(0.0), ALL),
    function!("tan", Trigonometry::Tan, libm::tan, Shape::Tangent, ALL),
    function!("asin", Trigonometry::Asin, libm::asin, Shape::Monotonic, UNIT),
    function!("acos", Trigonometry::Acos, libm::acos, Shape::Monotonic, UNIT),
    function!("atan", Trigonometry::Atan, libm::atan, Shape::Monotonic, ALL),
    function!("sinh", Exponential::Sinh, libm::sinh, Shape::Monotonic, ALL),
    function!("cosh", Exponential::Cosh, libm::cosh, Shape::Even, ALL),
    function!("tanh", Exponential::Tanh, libm::tanh, Shape::Monotonic, ALL),
    function!("asinh", Exponential::Asinh, libm::asinh, Shape::Monotonic, ALL),
    function!("acosh", Exponential::Acosh, libm::acosh, Shape::Monotonic, (1.0, f64::INFINITY)),
    function!("atanh", Exponential::Atanh, libm::atanh, Shape::Monotonic, UNIT),
];
const EXP2: usize = 1;
const LOG2: usize = 3;
const POW: FloatRule = FloatRule::Exponential(Exponential::Pow);

impl Function {
    /// A number whose multiples include all zeros of the function: pi / 2 for a sine or a cosine, pi for a tangent,
    /// `None` for any other function. Some multiples aren't zeros: `sin(pi / 2)` is 1.
    fn between_zeros(&self) -> Option<f64> {
        match self.shape {
            Shape::Wave(_) => Some(FRAC_PI_2),
            Shape::Tangent => Some(PI),
            Shape::Monotonic | Shape::Even => None,
        }
    }

    /// The least and the greatest value of the function between two arguments. `None` if the function has a pole
    /// between these arguments, or isn't defined for all arguments between them.
    fn image(&self, lo: f64, hi: f64) -> Option<(f64, f64)> {
        if !(self.domain.0 <= lo && lo <= hi && hi <= self.domain.1) {
            return None;
        }
        let ends = [(self.exact)(lo), (self.exact)(hi)];
        let (least, greatest) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        // Checks if `x`, or `x` plus a whole number of turns, is between the two arguments.
        let holds = |x: f64| x + TAU * ((lo - x) / TAU).ceil() <= hi;
        match self.shape {
            Shape::Monotonic => Some((least, greatest)),
            Shape::Even if lo < 0.0 && hi > 0.0 => Some(((self.exact)(0.0), greatest)),
            Shape::Even => Some((least, greatest)),
            Shape::Wave(top) => Some((
                if holds(top + PI) { -1.0 } else { least },
                if holds(top) { 1.0 } else { greatest },
            )),
            Shape::Tangent => {
                let branch = |x: f64| ((x + FRAC_PI_2) / PI).floor();
                (branch(lo) == branch(hi)).then_some((least, greatest))
            }
        }
    }
}

/// The largest measured errors of a function, absolute and in ulps, over all arguments with the same sign and exponent.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Error {
    ulps: f32,
    absolute: f32,
}

impl Error {
    const NONE: Self = Self { ulps: 0.0, absolute: 0.0 };
    const UNKNOWN: Self = Self { ulps: f32::INFINITY, absolute: f32::INFINITY };

    fn join(self, other: Self) -> Self {
        Self { ulps: self.ulps.max(other.ulps), absolute: self.absolute.max(other.absolute) }
    }

    fn of(self, y: f64) -> f64 {
        SAFETY * (f64::from(self.ulps) * ulp(y)).min(f64::from(self.absolute))
    }
}

/// The measured accuracy of an adapter's built-in functions.
#[derive(Clone, Debug, PartialEq)]
pub struct Accuracy {
    /// The errors of each function, by sign and exponent of the argument.
    functions: Vec<Vec<Error>>,
    /// `true` if all results of `pow` are within the bounds of `exp2(y * log2(x))` with measured `exp2` and `log2`.
    powers: bool,
    /// `true` if `pow(0, y)` is 0 for each y above zero.
    powers_of_zero: bool,
}

/// The expression with which Karat measures `pow`. Karat measures `pow` last, because the bounds of `pow` depend on
/// those of `exp2` and `log2`.
const POWER: &str = "pow(a, b)";

impl Default for Accuracy {
    fn default() -> Self {
        Self::new()
    }
}

impl Accuracy {
    /// The accuracy of an adapter that Karat hasn't measured: only the specification's bounds apply.
    #[must_use]
    pub fn new() -> Self {
        let functions = vec![vec![Error::UNKNOWN; BUCKETS]; FUNCTIONS.len()];
        Self { functions, powers: false, powers_of_zero: false }
    }

    /// The expressions to measure, in this order. Each expression uses the argument `a`, or the arguments `a` and `b`.
    pub fn functions() -> impl Iterator<Item = &'static str> {
        FUNCTIONS.iter().map(|function| function.text).chain([POWER])
    }

    /// The arguments with which to measure an expression: one number for each result, or two if the expression uses
    /// `b`.
    #[must_use]
    pub fn arguments(function: &str) -> Vec<f32> {
        // Spreads arguments evenly over a range: the fractional parts of the multiples of an irrational number do this.
        let spread = |case: u32| case.wrapping_mul(0x9e37_79b9);
        if function != POWER {
            let known = FUNCTIONS.iter().find(|one| one.text == function);
            let between = known.and_then(Function::between_zeros);
            let cases = 0..(BUCKETS as u32) * PER_EXPONENT;
            return cases
                .map(|case| {
                    let (bucket, step) = (case / PER_EXPONENT, case % PER_EXPONENT);
                    let nth = step.checked_sub(2).filter(|nth| *nth < NEAR_ZEROS);
                    if let Some(x) =
                        between.zip(nth).and_then(|(of, nth)| multiple(of, bucket, nth))
                    {
                        return x;
                    }
                    let mantissa = match step {
                        0 => 0,
                        1 => (1 << 23) - 1,
                        _ => spread(case) >> 9,
                    };
                    f32::from_bits(bucket << 23 | mantissa)
                })
                // Infinities and NaN are no test arguments, so 1 replaces them.
                .map(|x| if x.is_finite() { x } else { 1.0 })
                .collect();
        }
        let cases = 0..1u32 << 17;
        cases
            .flat_map(|case| {
                let unit = |salt: u32| spread(case.wrapping_add(salt)) as f32 / 4_294_967_296.0;
                let base = match case % 4 {
                    0 => 0.0,
                    1 => unit(1),
                    2 => 100.0 * unit(2),
                    _ => (80.0 * unit(3) - 40.0).exp2(),
                };
                let exponent = match case / 4 % 3 {
                    0 => ((case / 12) % 16) as f32 + 1.0,
                    1 => 4.0 * unit(0x5bd1_e995) + 1.0 / 64.0,
                    _ => 200.0 * unit(0x27d4_eb2f) - 100.0,
                };
                [base, exponent]
            })
            .collect()
    }

    /// Measures the errors of an adapter's results. The results must be in the order of
    /// [`arguments`](Self::arguments). Ignores the results if the function is unknown or the number of results is
    /// wrong.
    pub fn take(&mut self, function: &str, results: &[f32]) {
        let arguments = Self::arguments(function);
        if function == POWER && arguments.len() == 2 * results.len() {
            self.take_powers(&arguments, results);
        }
        let Some(index) = FUNCTIONS.iter().position(|one| one.text == function) else { return };
        if results.len() != arguments.len() {
            return;
        }
        let (of, function) = (&mut self.functions[index], &FUNCTIONS[index]);
        let mut measured = vec![None; BUCKETS];
        for (&x, &result) in arguments.iter().zip(results) {
            let Some((exact, _)) = function.image(f64::from(x), f64::from(x)) else { continue };
            // The bounds of a result that overflows are infinite, so its error doesn't matter.
            if !(exact.abs() <= f64::from(f32::MAX)) {
                continue;
            }
            let bucket = &mut measured[bucket(x)];
            *bucket = Some(bucket.unwrap_or(Error::NONE).join(error(exact, result)));
        }
        for (error, measured) in of.iter_mut().zip(measured) {
            *error = measured.unwrap_or(Error::UNKNOWN);
        }
    }

    fn take_powers(&mut self, arguments: &[f32], results: &[f32]) {
        self.powers = true;
        self.powers_of_zero = true;
        for (row, &result) in arguments.chunks_exact(2).zip(results) {
            let (x, y) = (row[0], row[1]);
            if x == 0.0 {
                // The specification allows any result for 0 to a power at or below zero.
                self.powers_of_zero &= y <= 0.0 || result == 0.0;
                continue;
            }
            let bound = self.power(Interval::point(x), Interval::point(y));
            self.powers &= bound.contains(f64::from(result));
        }
    }

    /// Narrows the interval `allowed` of an operation's result to this adapter's measured accuracy.
    pub(crate) fn narrow(&self, rule: FloatRule, x: &[Interval], allowed: Interval) -> Interval {
        let bound = match x {
            [x, y] if rule == POW && self.powers => self.power(*x, *y),
            [x] => match FUNCTIONS.iter().position(|function| function.rule == rule) {
                Some(index) => self.bound(index, *x),
                None => return allowed,
            },
            _ => return allowed,
        };
        allowed.meet(bound)
    }

    /// Checks if [`narrow`](Self::narrow) can narrow the results of an operation.
    pub(crate) fn knows(rule: FloatRule) -> bool {
        rule == POW || FUNCTIONS.iter().any(|function| function.rule == rule)
    }

    fn bound(&self, index: usize, x: Interval) -> Interval {
        let Some((lo, hi)) = x.bounds() else { return Interval::UNBOUNDED };
        let Some((least, greatest)) = FUNCTIONS[index].image(lo, hi) else {
            return Interval::UNBOUNDED;
        };
        let errors = &self.functions[index];
        let mut error = buckets(x.lo(), x.hi()).fold(Error::NONE, |all, one| all.join(errors[one]));
        if FUNCTIONS[index].between_zeros().is_some() && error.ulps > NEAR_ZERO_ULPS {
            // Closer to a zero, the same absolute error is even more ulps. So only the absolute error counts.
            error.ulps = f32::INFINITY;
        }
        // The size of an ulp may double between the two ends.
        let wider = if least == greatest { 1.0 } else { 2.0 };
        Interval::outwards(least - wider * error.of(least), greatest + wider * error.of(greatest))
    }

    /// The bounds of `exp2(y * log2(x))` with the measured `exp2` and `log2`.
    fn power(&self, x: Interval, y: Interval) -> Interval {
        if x.flushed().lo() == 0.0 && y.lo() > 0.0 && self.powers_of_zero {
            let zero = Interval::point(0.0);
            return match x.hi() {
                0.0 => zero,
                // Larger bases have larger powers. A subnormal base has no logarithm, so the least normal number
                // replaces it.
                hi => zero.join(self.power(Interval::point(hi.max(f32::MIN_POSITIVE)), y)),
            };
        }
        let logarithm = x.logarithm(libm::log2).meet(self.bound(LOG2, x));
        let product = y.mul(logarithm);
        product.exp2().meet(self.bound(EXP2, product))
    }

    /// The measurements encoded as `u32`s, for storing in a file.
    #[must_use]
    pub fn words(&self) -> Vec<u32> {
        let flags = [u32::from(self.powers), u32::from(self.powers_of_zero)];
        let errors = self.functions.iter().flatten();
        flags
            .into_iter()
            .chain(errors.flat_map(|e| [e.ulps, e.absolute].map(f32::to_bits)))
            .collect()
    }

    /// Restores the measurements from the result of [`words`](Self::words). `None` if the words are invalid.
    #[must_use]
    pub fn from_words(words: &[u32]) -> Option<Self> {
        let (flags, errors) = words.split_at_checked(2)?;
        if errors.len() != 2 * BUCKETS * FUNCTIONS.len() || flags.iter().any(|flag| *flag > 1) {
            return None;
        }
        let error = |pair: &[u32]| {
            let [ulps, absolute] = [pair[0], pair[1]].map(f32::from_bits);
            (ulps >= 0.0 && absolute >= 0.0).then_some(Error { ulps, absolute })
        };
        let errors: Vec<Error> = errors.chunks_exact(2).map(error).collect::<Option<_>>()?;
        Some(Self {
            functions: errors.chunks_exact(BUCKETS).map(<[Error]>::to_vec).collect(),
            powers: flags[0] == 1,
            powers_of_zero: flags[1] == 1,
        })
    }
}

fn bucket(x: f32) -> usize {
    (x.to_bits() >> 23) as usize
}

/// A multiple of `of` in a bucket, chosen by the index `nth`. If the bucket has more than [`NEAR_ZEROS`] multiples, the
/// choice is among [`NEAR_ZEROS`] of them, spread over the bucket. `None` if no multiple has this index.
fn multiple(of: f64, bucket: u32, nth: u32) -> Option<f32> {
    let least = f32::from_bits(bucket << 23);
    let size = f64::from(least.abs());
    let (first, last) = ((size / of).ceil(), (2.0 * size / of).floor());
    let steps = last - first;
    let (nth, most) = (f64::from(nth), f64::from(NEAR_ZEROS - 1));
    let turn = first + if steps <= most { nth } else { (nth * steps / most).floor() };
    let x = (turn * of) as f32;
    (first >= 1.0 && turn <= last && x.is_finite()).then(|| x.copysign(least))
}

fn buckets(lo: f32, hi: f32) -> impl Iterator<Item = usize> {
    const NEGATIVE: usize = BUCKETS / 2;
    let negative = if lo < 0.0 {
        bucket(if hi < 0.0 { hi } else { -0.0 })..bucket(lo) + 1
    } else {
        NEGATIVE..NEGATIVE
    };
    let positive =
        if hi >= 0.0 { bucket(if lo > 0.0 { lo } else { 0.0 })..bucket(hi) + 1 } else { 0..0 };
    negative.chain(positive)
}

/// The error of a result. If the result is infinite or NaN, the error is infinite.
fn error(exact: f64, result: f32) -> Error {
    let distance = (f64::from(result) - exact).abs();
    if !distance.is_finite() {
        return Error::UNKNOWN;
    }
    // Errors are rounded up, so that the bound is never too small.
    let up = |x: f64| (x as f32).next_up();
    Error { ulps: up(distance / ulp(exact)), absolute: up(distance) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The accuracy of an adapter that rounds all functions correctly, except the function `wrong`, which has an error
    /// of `ulps`.
    fn measured(wrong: &str, ulps: f64) -> Accuracy {
        let mut accuracy = Accuracy::new();
        for function in &FUNCTIONS {
            let arguments = Accuracy::arguments(function.text);
            let off = if function.text == wrong { ulps } else { 0.0 };
            let result = |x: &f32| {
                let y = (function.exact)(f64::from(*x));
                (y + off * ulp(y)) as f32
            };
            accuracy.take(function.text, &arguments.iter().map(result).collect::<Vec<_>>());
        }
        let rows = Accuracy::arguments(POWER);
        let power = |row: &[f32]| libm::pow(f64::from(row[0]), f64::from(row[1])) as f32;
        accuracy.take(POWER, &rows.chunks_exact(2).map(power).collect::<Vec<_>>());
        accuracy
    }

    fn width_in_ulps(bound: Interval) -> f64 {
        (f64::from(bound.hi()) - f64::from(bound.lo())) / ulp(f64::from(bound.middle()))
    }

    #[test]
    fn bounds_are_twice_what_was_measured() {
        let rounded = measured("", 0.0);
        let off = measured("exp(a)", 10.0);
        let rule = FloatRule::Exponential(Exponential::Exp);
        let x = Interval::point(0.3);
        let narrow = |accuracy: &Accuracy| accuracy.narrow(rule, &[x], Interval::UNBOUNDED);
        assert!(width_in_ulps(narrow(&rounded)) <= 4.0, "{:?}", narrow(&rounded));
        let wide = width_in_ulps(narrow(&off));
        assert!((38.0..=46.0).contains(&wide), "{wide}");
    }

    /// Near a zero, the sine is tiny but its error stays 1e-6. The measured bounds must allow this error.
    // Lesson 165
    #[test]
    fn a_constant_error_of_sine_near_its_zeros_is_within_the_bound() {
        let mut accuracy = Accuracy::new();
        let off = |x: &f32| (libm::sin(f64::from(*x)) + 1e-6) as f32;
        let results: Vec<f32> = Accuracy::arguments("sin(a)").iter().map(off).collect();
        accuracy.take("sin(a)", &results);
        let sine = FloatRule::Trigonometry(Trigonometry::Sin);
        for turn in [1.0, 3.0, 14.0, 15.0, 100.0] {
            for aside in [0.0, 1e-5, 1e-3] {
                let x = (turn * PI + aside) as f32;
                let bound = accuracy.narrow(sine, &[Interval::point(x)], Interval::UNBOUNDED);
                assert!(bound.contains(f64::from(off(&x))), "{x}: {bound:?}");
            }
        }
        let rounded = measured("", 0.0).narrow(sine, &[Interval::point(44.0)], Interval::UNBOUNDED);
        assert!(width_in_ulps(rounded) <= 4.0, "{rounded:?}");
        // Each driver's tangent has large errors next to its poles. Another bound covers them.
        let off = |x: &f32| ((libm::sin(f64::from(*x)) + 1e-6) / libm::cos(f64::from(*x))) as f32;
        let results: Vec<f32> = Accuracy::arguments("tan(a)").iter().map(off).collect();
        accuracy.take("tan(a)", &results);
        let tangent = FloatRule::Trigonometry(Trigonometry::Tan);
        for x in [3.0, std::f32::consts::PI, 44.0] {
            let bound = accuracy.narrow(tangent, &[Interval::point(x)], Interval::UNBOUNDED);
            let width = f64::from(bound.hi()) - f64::from(bound.lo());
            assert!(bound.contains(f64::from(off(&x))) && width < 1e-2, "{x}: {bound:?}");
        }
    }

    // Lesson 92
    #[test]
    fn bounds_are_never_wider_than_the_specification() {
        let off = measured("exp(a)", 1000.0);
        let rule = FloatRule::Exponential(Exponential::Exp);
        let x = Interval::point(0.3);
        assert_eq!(off.narrow(rule, &[x], x.exp()), x.exp());
        // If a driver's result is outside of what WGSL allows, the measured interval and the allowed interval don't
        // overlap.
        let elsewhere = Interval::point(5.0);
        assert_eq!(measured("", 0.0).narrow(rule, &[x], elsewhere), elsewhere);
    }

    #[test]
    fn there_are_bounds_where_the_specification_has_none() {
        let accuracy = measured("", 0.0);
        let sine = FloatRule::Trigonometry(Trigonometry::Sin);
        let bound = accuracy.narrow(sine, &[Interval::point(10.0)], Interval::UNBOUNDED);
        assert!(bound.contains(f64::from(10f32).sin()) && width_in_ulps(bound) <= 4.0, "{bound:?}");
        let turn = Interval::between(7.0, 8.0);
        let bound = accuracy.narrow(sine, &[turn], Interval::UNBOUNDED);
        assert!(bound.contains(1.0) && !bound.contains(0.5), "{bound:?}");
        let [zero, five] = [0.0, 5.0].map(Interval::point);
        let bound = accuracy.narrow(POW, &[zero, five], Interval::UNBOUNDED);
        assert_eq!((bound.lo(), bound.hi()), (0.0, 0.0));
        let bound = accuracy.narrow(POW, &[Interval::between(0.0, 0.5), five], Interval::UNBOUNDED);
        assert!(bound.contains(0.03125) && !bound.contains(0.0313), "{bound:?}");
    }

    // Lesson 92
    #[test]
    fn unmeasured_accuracy_is_unbounded() {
        let rule = FloatRule::Exponential(Exponential::Exp);
        let x = Interval::point(0.3);
        assert!(!Accuracy::new().narrow(rule, &[x], Interval::UNBOUNDED).is_bounded());
        let mut nan = measured("", 0.0);
        nan.take("exp(a)", &vec![f32::NAN; Accuracy::arguments("exp(a)").len()]);
        assert!(!nan.narrow(rule, &[x], Interval::UNBOUNDED).is_bounded());
        // The errors of these powers are too large to follow from the errors of the logarithm and of `exp2`.
        let rows = Accuracy::arguments(POWER).len() / 2;
        nan.take(POWER, &vec![0.5; rows]);
        assert!(!nan.powers && !nan.powers_of_zero);
    }

    #[test]
    fn a_measured_accuracy_is_restored_from_its_words() {
        let accuracy = measured("log(a)", 3.0);
        assert_eq!(Accuracy::from_words(&accuracy.words()), Some(accuracy.clone()));
        assert_eq!(Accuracy::from_words(&accuracy.words()[1..]), None);
        let mut wrong = accuracy.words();
        wrong[5] = f32::NAN.to_bits();
        assert_eq!(Accuracy::from_words(&wrong), None);
    }
}
