//! Tolerances: the allowed difference between a shader's result and its reference.
//!
//! A tolerance is a tree of bounds. The ratio of a lane is the lane's error divided by the bound, and the lane passes
//! if its ratio is at most 1. [`Tolerance::Any`] uses the smallest ratio of its parts, and [`Tolerance::All`] uses the
//! largest. NaN and infinite results have an infinite ratio under every tolerance, so they never pass.

mod line;
mod spec;

pub use line::ulp_distance;
use line::{least_spacing, ordinal, spacing};
pub use spec::{Criterion, DeviceSpec, Spec, SpecTolerance};

use std::fmt;

use crate::value::Scalar;

/// A factor that exceeds 1 by more than the relative rounding error of a few `f64` operations. An estimated error times
/// this factor is an upper bound of the error.
const ROUNDING: f64 = 1.0 + 1e-12;

/// Units in the last place: the number of `f32` steps between the result and the reference.
///
/// The steps are counted in the ordered list of all `f32` values, denormals included, in which `-0` equals `+0`. But if
/// two values differ by less than `f32::MIN_POSITIVE`, their distance counts as 0, because WGSL allows drivers to flush
/// results below `f32::MIN_POSITIVE` to zero. If a function subtracts nearly equal values, use
/// [`near_zero`](Tolerance::near_zero), which allows larger errors near zero.
///
/// ```
/// use karat::{Tolerance, Ulp};
///
/// let tolerance = Tolerance::from(Ulp(1.0));
/// assert!(tolerance.measure(0, 1.0_f32.next_up(), 1.0).passes());
/// assert!(!tolerance.measure(0, 1.000001, 1.0).passes());
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ulp(pub f64);

/// Relative error: `abs(result - reference) <= bound * abs(reference)`.
///
/// ```
/// use karat::{Rel, Tolerance};
///
/// let tolerance = Tolerance::from(Rel(0.01));
/// assert!(tolerance.measure(0, 1000.0, 1005.0).passes());
/// assert!(!tolerance.measure(0, 1e-9, 0.0).passes()); // only 0 passes
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rel(pub f64);

/// Absolute error: `abs(result - reference) <= bound`.
///
/// ```
/// use karat::{Abs, Tolerance};
///
/// assert!(Tolerance::from(Abs(1e-6)).measure(0, 5e-7, 0.0).passes());
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Abs(pub f64);

/// A limit on the error of each lane, made of [`Ulp`], [`Rel`] and [`Abs`].
///
/// Integer and boolean lanes must be equal under every tolerance.
///
/// ```
/// use karat::{Abs, Rel, Tolerance, Ulp};
///
/// let tolerance = Rel(1e-4).or(Abs(1e-6));
/// assert!(tolerance.measure(0, 5e-7, 0.0).passes());
/// assert!(!tolerance.measure(0, f32::NAN, 0.0).passes());
/// // One bound for each component: only the last bound is loose.
/// let tolerance = Tolerance::per_lane([Ulp(1.0).into(), Ulp(1.0).into(), Rel(0.1).into()]);
/// assert!(!tolerance.measure(0, 1.05, 1.0).passes());
/// assert!(tolerance.measure(2, 1.05, 1.0).passes());
/// ```
#[derive(Clone, Debug, PartialEq)]
#[must_use]
pub enum Tolerance {
    /// Limits the distance between the result and the reference, in `f32` steps. Below `band`, all steps are as large
    /// as the step at `band`.
    Ulp {
        /// The largest distance that passes.
        bound: f64,
        /// The magnitude below which the bound is absolute: there, the error may be `bound` times the step at `band`.
        band: f64,
    },
    /// Limits the relative error, as [`Rel`] does.
    Rel(f64),
    /// Limits the absolute error, as [`Abs`] does.
    Abs(f64),
    /// Passes if any part passes.
    Any(Vec<Tolerance>),
    /// Passes if all parts pass.
    All(Vec<Tolerance>),
    /// One tolerance for each lane, in the order of the value's components.
    PerLane(Vec<Tolerance>),
}

/// The unit of an error.
///
/// ```
/// use karat::tolerance::Tolerance;
/// use karat::unstable::tolerance::Unit;
/// use karat::Abs;
///
/// assert_eq!(Tolerance::from(Abs(0.1)).measure(0, 1.0, 1.0).unit, Unit::Abs);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// `f32` steps.
    Ulp,
    /// The error divided by the reference.
    Rel,
    /// The difference between the result and the reference.
    Abs,
    /// The unit for integers and booleans: the error is 0 if the values are equal, and 1 if they differ.
    Exact,
    /// The unit for a property that a test states: the error is 0 if the property holds, and 1 if it doesn't hold.
    Statement,
    /// The distance between the reference and the range of values that the shader's function may return.
    Shader,
    /// The distance between the result and the range that WGSL allows.
    Driver,
    /// The distance between the result and the range that Karat measured for the adapter.
    Measured,
    /// The width of the range of results that WGSL allows.
    Conditioning,
    /// There is no bound: WGSL allows any result.
    Unbounded,
}

impl Unit {
    /// The text that messages print with the error, such as `ulp`.
    ///
    /// ```
    /// use karat::unstable::tolerance::Unit;
    ///
    /// assert_eq!(Unit::Ulp.name(), "ulp");
    /// ```
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Ulp => "ulp",
            Self::Rel => "rel",
            Self::Abs => "abs",
            Self::Exact => "different",
            Self::Statement => "doesn't hold",
            Self::Shader => "between the reference and the nearest result that WGSL allows",
            Self::Driver => "outside of the range that WGSL allows",
            Self::Measured => "outside of the measured range",
            Self::Conditioning => "wide",
            Self::Unbounded => "unbounded",
        }
    }
}

/// The error of one lane, compared with one bound.
///
/// ```
/// use karat::Ulp;
/// use karat::tolerance::Tolerance;
///
/// let error = Tolerance::from(Ulp(4.0)).measure(0, 1.0, 1.0 + 2.0_f64.powi(-22));
/// assert_eq!(error.to_string(), "2 ulp");
/// assert_eq!(error.ratio, 0.5); // half of the bound
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LaneError {
    /// Error / bound. Infinite if the result is NaN or an infinity.
    pub ratio: f64,
    /// The error in `unit`.
    pub error: f64,
    /// The largest error that passes, in `unit`.
    pub bound: f64,
    /// The unit of `error` and `bound`.
    pub unit: Unit,
}

impl LaneError {
    #[doc(hidden)]
    pub const ZERO: Self = Self { ratio: 0.0, error: 0.0, bound: 0.0, unit: Unit::Exact };

    #[doc(hidden)]
    pub fn new(error: f64, bound: f64, unit: Unit) -> Self {
        // The error 0 with the bound 0 is an exact match, so its ratio is 0. NaN fails.
        let ratio = if error == 0.0 { 0.0 } else { error / bound };
        let ratio = if ratio >= 0.0 { ratio } else { f64::INFINITY };
        Self { ratio, error, bound, unit }
    }

    #[doc(hidden)]
    pub fn equality(equal: bool) -> Self {
        Self::new(if equal { 0.0 } else { 1.0 }, 0.0, Unit::Exact)
    }

    /// An error that is the excess of `value` over `bound`. An excess up to `slack` passes.
    #[doc(hidden)]
    pub fn excess(value: f64, bound: f64, slack: f64) -> Self {
        Self::new(if value <= bound { 0.0 } else { value - bound }, slack, Unit::Abs)
    }

    #[doc(hidden)]
    pub fn statement(holds: bool) -> Self {
        Self { unit: Unit::Statement, ..Self::equality(holds) }
    }

    /// Checks if the error is within the bound. An error of NaN never passes.
    ///
    /// ```
    /// use karat::Abs;
    /// use karat::tolerance::Tolerance;
    ///
    /// let tolerance = Tolerance::from(Abs(0.1));
    /// assert!(tolerance.measure(0, 1.05, 1.0).passes());
    /// assert!(!tolerance.measure(0, f32::NAN, 1.0).passes());
    /// ```
    #[must_use]
    pub fn passes(&self) -> bool {
        self.ratio <= 1.0
    }
}

impl LaneError {
    /// Checks if this error has a larger ratio than `other`, or the same ratio and a larger error. NaN counts as the
    /// largest ratio.
    #[doc(hidden)]
    #[must_use]
    pub fn is_worse_than(&self, other: &Self) -> bool {
        let order = self.ratio.total_cmp(&other.ratio);
        order.then(self.error.abs().total_cmp(&other.error.abs())).is_gt()
    }
}

impl fmt::Display for LaneError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.unit {
            Unit::Exact if self.error == 0.0 => f.write_str("equal"),
            Unit::Statement if self.error == 0.0 => f.write_str("holds"),
            Unit::Exact | Unit::Statement | Unit::Unbounded => f.write_str(self.unit.name()),
            Unit::Shader | Unit::Driver | Unit::Measured | Unit::Conditioning => {
                write!(f, "{} {}", significant(self.error), self.unit.name())
            }
            Unit::Ulp => write!(f, "{} ulp", significant(self.error)),
            Unit::Rel | Unit::Abs => write!(f, "{} {}", self.unit.name(), significant(self.error)),
        }
    }
}

/// A phrase for the ratio of an error: `20 times what is allowed`.
#[doc(hidden)]
pub fn times_allowed(ratio: f64) -> String {
    match ratio.is_infinite() {
        // For the bound 0, there is no finite ratio.
        true => "and nothing is allowed".to_owned(),
        false => format!("{} times what is allowed", significant(ratio)),
    }
}

/// Describes an error as [`times_allowed`] does, and adds the error itself if the bound is 0.
#[doc(hidden)]
pub fn beyond(error: f64, ratio: f64) -> String {
    let times = times_allowed(ratio);
    if ratio.is_infinite() { format!("abs {}, {times}", significant(error.abs())) } else { times }
}

/// A number with three significant digits, and with an exponent if plain digits would be long.
#[doc(hidden)]
pub fn significant(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let exponent = value.abs().log10().floor();
    if (-3.0..6.0).contains(&exponent) {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 5")]
        let digits = (2.0 - exponent).clamp(0.0, 5.0) as usize;
        let text = format!("{value:.digits$}");
        if text.contains('.') {
            return text.trim_end_matches('0').trim_end_matches('.').to_owned();
        }
        text
    } else {
        format!("{value:.2e}")
    }
}

/// A number in scientific notation, such as `1e-3`. An exponent of 0 is left out: `2.5`.
#[doc(hidden)]
pub fn power(value: impl fmt::LowerExp) -> String {
    let text = format!("{value:e}");
    text.strip_suffix("e0").unwrap_or(&text).to_owned()
}

/// A bound in scientific notation, as an author would write it. Bounds with many digits are rounded to three digits.
fn exponent(bound: f64) -> String {
    let exact = power(bound);
    if exact.len() <= 7 { exact } else { format!("{bound:.2e}") }
}

impl Tolerance {
    /// One tolerance for each lane (component, matrix element, structure member), in order.
    ///
    /// ```
    /// use karat::tolerance::Tolerance;
    /// use karat::{Abs, Ulp};
    ///
    /// // For a vec2f: x must be equal, y may have an absolute error.
    /// let tolerance = Tolerance::per_lane([Ulp(0.0).into(), Abs(1e-3).into()]);
    /// assert_eq!(tolerance.lanes(), Some(2));
    /// ```
    pub fn per_lane(lanes: impl IntoIterator<Item = Self>) -> Self {
        Self::PerLane(lanes.into_iter().collect())
    }

    /// A tolerance that passes if `self` or `other` passes.
    ///
    /// ```
    /// use karat::{Abs, Rel, Ulp};
    ///
    /// let tolerance = Ulp(4.0).or(Rel(1e-5)).or(Abs(1e-7));
    /// assert_eq!(tolerance.to_string(), "4 ulp or rel 1e-5 or abs 1e-7");
    /// ```
    pub fn or(self, other: impl Into<Self>) -> Self {
        match self {
            Self::Any(mut parts) => {
                parts.push(other.into());
                Self::Any(parts)
            }
            first => Self::Any(vec![first, other.into()]),
        }
    }

    /// A tolerance that passes if both `self` and `other` pass.
    ///
    /// ```
    /// use karat::{Abs, Rel, Ulp};
    ///
    /// let tolerance = Rel(1e-3).and(Abs(0.1)).and(Ulp(1e6));
    /// assert!(tolerance.measure(0, 1.0, 1.0).passes());
    /// ```
    pub fn and(self, other: impl Into<Self>) -> Self {
        match self {
            Self::All(mut parts) => {
                parts.push(other.into());
                Self::All(parts)
            }
            first => Self::All(vec![first, other.into()]),
        }
    }

    /// Makes ulps near zero larger: below `magnitude`, all steps are as large as the steps at `magnitude`. The result
    /// of a function that subtracts values of this magnitude can't be more exact than these steps. Bounds in other
    /// units stay unchanged.
    ///
    /// ```
    /// use karat::{Abs, Ulp};
    ///
    /// // The difference of two numbers near 1 is a multiple of the steps near 1, even if the difference is nearly 0.
    /// let tolerance = Ulp(2.0).or(Abs(0.0)).near_zero(1.0);
    /// assert!(tolerance.measure(0, 1.2e-7, 0.0).passes());
    /// ```
    pub fn near_zero(self, magnitude: f64) -> Self {
        let map = |parts: Vec<Self>| parts.into_iter().map(|t| t.near_zero(magnitude)).collect();
        match self {
            Self::Ulp { bound, .. } => Self::Ulp { bound, band: magnitude },
            Self::Any(parts) => Self::Any(map(parts)),
            Self::All(parts) => Self::All(map(parts)),
            Self::PerLane(parts) => Self::PerLane(map(parts)),
            other => other,
        }
    }

    /// The number of lanes that a value must have for this tolerance. `None` if the tolerance fits any number of lanes.
    ///
    /// ```
    /// use karat::tolerance::Tolerance;
    /// use karat::{Abs, Ulp};
    ///
    /// assert_eq!(Tolerance::from(Ulp(4.0)).lanes(), None);
    /// assert_eq!(Tolerance::per_lane([Ulp(4.0).into(), Abs(0.1).into()]).lanes(), Some(2));
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn lanes(&self) -> Option<usize> {
        match self {
            Self::PerLane(lanes) => Some(lanes.len()),
            Self::Any(parts) | Self::All(parts) => parts.iter().find_map(Self::lanes),
            _ => None,
        }
    }

    /// The first unusable bound: NaN, a negative bound, or a bound so large that every finite result passes.
    #[doc(hidden)]
    pub fn unusable(&self) -> Option<f64> {
        // The largest bounds: the distance from the smallest to the largest number, the largest quotient of two
        // numbers, and the number of steps between the smallest and the largest number.
        let apart = 2.0 * f64::from(f32::MAX);
        let quotient = apart / f64::from(f32::from_bits(1));
        let steps = 2.0 * f64::from(f32::MAX.to_bits());
        let nothing = |most: f64| move |bound: &f64| !(*bound >= 0.0 && *bound < most);
        match self {
            Self::Ulp { bound, band } => {
                let band = Some(*band).filter(nothing(apart));
                Some(*bound).filter(nothing(steps)).or(band)
            }
            Self::Rel(bound) => Some(*bound).filter(nothing(quotient)),
            Self::Abs(bound) => Some(*bound).filter(nothing(apart)),
            // Without parts, `Any` could never pass, and `All` would always pass.
            Self::Any(parts) | Self::All(parts) if parts.is_empty() => Some(f64::NAN),
            Self::Any(parts) | Self::All(parts) | Self::PerLane(parts) => {
                parts.iter().find_map(Self::unusable)
            }
        }
    }

    /// The error of one `f32` lane. If a [`PerLane`](Self::PerLane) tolerance lacks the lane, the lane fails.
    ///
    /// ```
    /// use karat::Rel;
    /// use karat::tolerance::Tolerance;
    ///
    /// let error = Tolerance::from(Rel(0.1)).measure(0, 1.05, 1.0);
    /// assert!((error.ratio - 0.5).abs() < 1e-6); // half of the bound
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn measure(&self, lane: usize, actual: f32, expected: f64) -> LaneError {
        self.measure_sum(lane, f64::from(actual), expected)
    }

    /// Measures each component of a value, given as 32-bit words. Returns the index of the component with the largest
    /// ratio, and the error of this component. Integer components pass only if they are equal.
    ///
    /// ```
    /// use karat::prelude::*;
    /// use karat::unstable::value::Scalar;
    ///
    /// let words = [2.0_f32.to_bits(), 3];
    /// let tolerance = karat::Tolerance::from(Abs(1.0));
    /// let (component, error) = tolerance.measure_words(&[Scalar::F32, Scalar::U32], &words, &[2.5, 4.0]);
    /// assert!(component == 1 && !error.passes());
    /// ```
    ///
    /// # Panics
    /// Panics if `words` or `expected` has fewer elements than `scalars`.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn measure_words(
        &self,
        scalars: &[Scalar],
        words: &[u32],
        expected: &[f64],
    ) -> (usize, LaneError) {
        let mut worst = (0, LaneError::ZERO);
        for (lane, scalar) in scalars.iter().enumerate() {
            let (word, expected) = (words[lane], expected[lane]);
            #[expect(clippy::float_cmp, reason = "both are integers")]
            let measure = match scalar.is_float() {
                true => self.measure(lane, f32::from_bits(word), expected),
                false => LaneError::equality(scalar.decode(word) == expected),
            };
            if lane == 0 || measure.is_worse_than(&worst.1) {
                worst = (lane, measure);
            }
        }
        worst
    }

    /// Like [`measure`](Self::measure), for a value that was summed up in `f64`, and isn't rounded to `f32` first.
    #[doc(hidden)]
    pub fn measure_sum(&self, lane: usize, value: f64, expected: f64) -> LaneError {
        let error = (value - expected).abs();
        if !value.is_finite() || !expected.is_finite() {
            return LaneError {
                ratio: f64::INFINITY,
                error: f64::NAN,
                bound: 0.0,
                unit: self.unit(),
            };
        }
        match self {
            Self::Ulp { bound, band } => {
                // Below `band`, the steps have the same size as at `band`. Values that a flush to zero could make equal
                // count as equal.
                let distance = if value.abs().max(expected.abs()) <= *band {
                    error / spacing(*band)
                } else {
                    (ordinal(value) - ordinal(expected)).abs().min(error / spacing(*band))
                };
                let flushed = error < f64::from(f32::MIN_POSITIVE);
                LaneError::new(if flushed { 0.0 } else { distance }, *bound, Unit::Ulp)
            }
            Self::Rel(bound) => {
                // As with ulps, a value that may be flushed to zero counts as zero.
                let flushed = error < f64::from(f32::MIN_POSITIVE);
                let relative = if flushed { 0.0 } else { error / expected.abs() };
                LaneError::new(relative, *bound, Unit::Rel)
            }
            Self::Abs(bound) => {
                // Under an absolute bound, only the result 0 counts as flushed. If the expected number is subnormal,
                // the result 0 has the error 0.
                let flushed = value == 0.0 && expected.abs() < f64::from(f32::MIN_POSITIVE);
                LaneError::new(if flushed { 0.0 } else { error }, *bound, Unit::Abs)
            }
            Self::Any(parts) => parts
                .iter()
                .map(|part| part.measure_sum(lane, value, expected))
                .min_by(|a, b| a.ratio.total_cmp(&b.ratio))
                .unwrap_or(LaneError::equality(false)),
            Self::All(parts) => parts
                .iter()
                .map(|part| part.measure_sum(lane, value, expected))
                .max_by(|a, b| a.ratio.total_cmp(&b.ratio))
                .unwrap_or(LaneError::equality(false)),
            Self::PerLane(lanes) => lanes
                .get(lane)
                .map_or(LaneError::equality(false), |t| t.measure_sum(lane, value, expected)),
        }
    }

    /// Checks quickly, by an estimate, if a lane's ratio is at most `ratio`. `true` is certain, but `false` isn't: the
    /// lane's exact ratio may still be at most `ratio`. This estimate is enough for most results, so Karat rarely
    /// computes the exact ratio.
    #[inline]
    #[doc(hidden)]
    pub fn is_within(&self, lane: usize, value: f64, expected: f64, ratio: f64) -> bool {
        let error = (value - expected).abs();
        if !(error < f64::INFINITY) {
            return false;
        }
        let at_most = |bound: f64| error * ROUNDING <= ratio * bound;
        let flushed = || error < f64::from(f32::MIN_POSITIVE) && 0.0 <= ratio;
        match self {
            // A step between two numbers of the same sign is at least as large as the step at the smaller number and
            // the step at `band`.
            Self::Ulp { bound, band } => {
                let smaller = value.abs().min(expected.abs());
                let smaller = if value * expected > 0.0 { smaller.max(*band) } else { *band };
                at_most(*bound * least_spacing(smaller)) || flushed()
            }
            Self::Rel(bound) => at_most(*bound * expected.abs()) || flushed(),
            Self::Abs(bound) => at_most(*bound),
            Self::Any(_) | Self::All(_) | Self::PerLane(_) => {
                self.is_within_parts(lane, value, expected, ratio)
            }
        }
    }

    fn is_within_parts(&self, lane: usize, value: f64, expected: f64, ratio: f64) -> bool {
        let within = |part: &Self| part.is_within(lane, value, expected, ratio);
        match self {
            Self::Any(parts) => parts.iter().any(within),
            Self::All(parts) => !parts.is_empty() && parts.iter().all(within),
            Self::PerLane(lanes) => lanes.get(lane).is_some_and(within),
            Self::Ulp { .. } | Self::Rel(_) | Self::Abs(_) => within(self),
        }
    }

    fn unit(&self) -> Unit {
        match self {
            Self::Ulp { .. } => Unit::Ulp,
            Self::Rel(_) => Unit::Rel,
            Self::Abs(_) => Unit::Abs,
            Self::Any(parts) | Self::All(parts) | Self::PerLane(parts) => {
                parts.first().map_or(Unit::Exact, Self::unit)
            }
        }
    }
}

impl fmt::Display for Tolerance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let join = |f: &mut fmt::Formatter<'_>, parts: &[Self], separator: &str| {
            for (index, part) in parts.iter().enumerate() {
                if index > 0 {
                    f.write_str(separator)?;
                }
                write!(f, "{part}")?;
            }
            Ok(())
        };
        match self {
            Self::Ulp { bound, band } if *band <= f64::from(f32::MIN_POSITIVE) => {
                write!(f, "{bound} ulp")
            }
            Self::Ulp { bound, band } => write!(f, "{bound} ulp (absolute below {band})"),
            Self::Rel(bound) => write!(f, "rel {}", exponent(*bound)),
            Self::Abs(bound) => write!(f, "abs {}", exponent(*bound)),
            Self::Any(parts) => join(f, parts, " or "),
            Self::All(parts) => join(f, parts, " and "),
            Self::PerLane(parts) => {
                f.write_str("[")?;
                join(f, parts, ", ")?;
                f.write_str("]")
            }
        }
    }
}

macro_rules! leaf {
    ($($leaf:ident => $tree:expr;)*) => {$(
        impl From<$leaf> for Tolerance {
            fn from(leaf: $leaf) -> Self {
                let tree: fn($leaf) -> Self = $tree;
                tree(leaf)
            }
        }

        impl $leaf {
            /// A tolerance that passes if `self` or `other` passes.
            pub fn or(self, other: impl Into<Tolerance>) -> Tolerance {
                Tolerance::from(self).or(other)
            }

            /// A tolerance that passes if both `self` and `other` pass.
            pub fn and(self, other: impl Into<Tolerance>) -> Tolerance {
                Tolerance::from(self).and(other)
            }
        }
    )*};
}

leaf! {
    Ulp => |ulp| Tolerance::Ulp { bound: ulp.0, band: f64::from(f32::MIN_POSITIVE) };
    Rel => |rel| Tolerance::Rel(rel.0);
    Abs => |abs| Tolerance::Abs(abs.0);
}

impl Ulp {
    /// See [`Tolerance::near_zero`].
    ///
    /// ```
    /// use karat::Ulp;
    ///
    /// let tolerance = Ulp(2.0).near_zero(1.0);
    /// assert!(tolerance.measure(0, 1.2e-7, 0.0).passes());
    /// ```
    pub fn near_zero(self, magnitude: f64) -> Tolerance {
        Tolerance::from(self).near_zero(magnitude)
    }
}

#[cfg(test)]
mod tests;
