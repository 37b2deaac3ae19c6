//! Intervals of floats, ranges of integers, and booleans that may be undecided.

mod chain;
mod half;

use std::f64::consts::PI;
use std::fmt;

use chain::{Chain, Ends};

/// The values that WGSL allows for a float: every `f32` from `lo` to `hi`. An unbounded interval allows any value,
/// including NaN.
///
/// A result is unbounded if it overflows, or if the specification doesn't limit its error. Everything that is computed
/// from an unbounded value is unbounded, too, because an implementation may assume that infinities and NaN don't occur.
/// Bounds are rounded outwards to `f32`.
///
/// WGSL lets an implementation reorder the operations of a sum or a product. So the interval contains the results of
/// all orders. So that this works across variables and calls, an interval remembers its terms or factors.
#[derive(Clone, Copy)]
pub struct Interval {
    lo: f32,
    hi: f32,
    /// The number of the site that made the interval unbounded, plus 1, or 0 if no site is known. The highest bit is
    /// the flag [`REORDERED`].
    cause: u32,
    chain: Chain,
}

/// A flag in `cause`: without reordering, in the order that the author wrote, the interval would be bounded.
const REORDERED: u32 = 1 << 31;

impl fmt::Debug for Interval {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?} to {:?}", self.lo, self.hi)
    }
}

impl Default for Interval {
    fn default() -> Self {
        Self::point(0.0)
    }
}

impl PartialEq for Interval {
    /// Compares bounds, and ignores causes.
    fn eq(&self, other: &Self) -> bool {
        self.lo == other.lo && self.hi == other.hi
    }
}

impl Interval {
    /// All floats, including NaN.
    pub const UNBOUNDED: Self =
        Self { lo: f32::NEG_INFINITY, hi: f32::INFINITY, cause: 0, chain: Chain::Single };

    /// The interval of one float. Unbounded if the float isn't finite.
    #[must_use]
    pub fn point(x: f32) -> Self {
        Self::between(x, x)
    }

    /// The interval of all floats from `lo` to `hi`. Unbounded if an end isn't finite.
    #[must_use]
    pub fn between(lo: f32, hi: f32) -> Self {
        if lo.is_finite() && hi.is_finite() && lo <= hi {
            Self { lo, hi, ..Self::UNBOUNDED }
        } else {
            Self::UNBOUNDED
        }
    }

    /// The least value. Negative infinity if the interval is unbounded.
    #[must_use]
    pub fn lo(self) -> f32 {
        self.lo
    }

    /// The greatest value. Infinity if the interval is unbounded.
    #[must_use]
    pub fn hi(self) -> f32 {
        self.hi
    }

    /// Checks if both bounds are finite.
    #[must_use]
    pub fn is_bounded(self) -> bool {
        self.lo.is_finite() && self.hi.is_finite()
    }

    /// Checks if the interval contains `x`. An unbounded interval contains all values, including NaN and infinities.
    #[must_use]
    pub fn contains(self, x: f64) -> bool {
        !self.is_bounded() || (f64::from(self.lo) <= x && x <= f64::from(self.hi))
    }

    /// Checks if the interval is unbounded only because WGSL allows another order of operations (15.7.5). In such an
    /// order, an intermediate result may overflow, or a divisor may be unbounded.
    #[must_use]
    pub fn is_reordered(self) -> bool {
        self.cause & REORDERED != 0
    }

    /// The site of the operation that made the interval unbounded, if there is one.
    pub(crate) fn cause(self) -> Option<u32> {
        (self.cause & !REORDERED).checked_sub(1)
    }

    pub(crate) fn caused_by(self, site: u32) -> Self {
        Self { cause: (self.cause & REORDERED) | (site + 1), ..self }
    }

    pub(crate) fn caused_as(self, other: Self) -> Self {
        Self { cause: other.cause, ..self }
    }

    /// Combines this interval, which contains the results of all orders, with the interval of the written order. If
    /// only the interval of the written order is bounded, returns an unbounded interval with the flag [`REORDERED`].
    fn unless_written(self, written: Self) -> Self {
        match (self.is_bounded(), written.is_bounded()) {
            (true, true) => self,
            (false, true) => Self { cause: REORDERED, ..Self::UNBOUNDED },
            (_, false) => written,
        }
    }

    /// The unbounded result of an operation on `self` and `other`, with the flag [`REORDERED`] if an operand has it.
    fn lost(self, other: Self) -> Self {
        Self { cause: (self.cause | other.cause) & REORDERED, ..Self::UNBOUNDED }
    }

    fn chained(self) -> Option<(Ends, Chain)> {
        Some((self.bounds()?, self.chain))
    }

    pub(crate) fn middle(self) -> f32 {
        if self.is_bounded() {
            f64::midpoint(f64::from(self.lo), f64::from(self.hi)) as f32
        } else {
            f32::NAN
        }
    }

    /// The interval with the exact bounds `lo` and `hi`, rounded outwards to `f32`. If one of its values is subnormal,
    /// the interval also contains zero, because an implementation may flush subnormals.
    pub(crate) fn outwards(lo: f64, hi: f64) -> Self {
        if !(lo.abs() <= f64::from(f32::MAX) && hi.abs() <= f64::from(f32::MAX) && lo <= hi) {
            return Self::UNBOUNDED;
        }
        let (low, high) = (lo as f32, hi as f32);
        // There are no branches, because branch prediction would fail half of the time.
        let low = stepped(low, -i32::from(f64::from(low) > lo));
        let high = stepped(high, i32::from(f64::from(high) < hi));
        if !(low.is_finite() && high.is_finite()) {
            return Self::UNBOUNDED;
        }
        Self { lo: low, hi: high, ..Self::UNBOUNDED }.flushed()
    }

    /// Widens the bounds `lo` and `hi` of a remainder such as `x - floor(x)`, because an implementation may add the
    /// terms of `x` (`self`) in any order.
    pub(crate) fn with_slack(self, lo: f64, hi: f64) -> Self {
        let slack = self.chained().map_or(0.0, |(ends, chain)| chain.slack(ends));
        Self::outwards(lo - slack, hi + slack)
    }

    /// Extends the interval to zero if it contains subnormals, because an implementation may flush these.
    pub(crate) fn flushed(self) -> Self {
        let tiny = f32::MIN_POSITIVE;
        let mut flushed = self;
        if self.lo > 0.0 && self.lo < tiny {
            flushed.lo = 0.0;
        }
        if self.hi < 0.0 && self.hi > -tiny {
            flushed.hi = 0.0;
        }
        flushed
    }

    pub(crate) fn join(self, other: Self) -> Self {
        if let (Some(ends), Some(others)) = (self.bounds(), other.bounds()) {
            let chain = self.chain.join(ends, other.chain, others);
            let (lo, hi) = (self.lo.min(other.lo), self.hi.max(other.hi));
            return Self { lo, hi, cause: 0, chain };
        }
        Self { cause: if self.cause == 0 { other.cause } else { self.cause }, ..Self::UNBOUNDED }
    }

    /// The intersection of the two intervals. It is `other` if `self` is unbounded. It is `self` if `other` is
    /// unbounded, or if the two intervals don't overlap.
    pub(crate) fn meet(self, other: Self) -> Self {
        match (self.is_bounded(), other.is_bounded()) {
            (_, false) => self,
            (false, true) => other,
            (true, true) => {
                let (lo, hi) = (self.lo.max(other.lo), self.hi.min(other.hi));
                if lo <= hi { Self { lo, hi, ..Self::UNBOUNDED } } else { self }
            }
        }
    }

    /// The bounds in `f64`. If the interval contains subnormals, the bounds include them and zero, to which they may be
    /// flushed. `None` if the interval is unbounded.
    pub(crate) fn bounds(self) -> Option<(f64, f64)> {
        let flushed = self.flushed();
        self.is_bounded().then(|| (f64::from(flushed.lo), f64::from(flushed.hi)))
    }

    /// Applies a monotonic function `f` to both bounds, and widens the result by `error`.
    pub(crate) fn monotonic(self, f: impl Fn(f64) -> f64, error: impl Fn(f64, f64) -> f64) -> Self {
        let Some((lo, hi)) = self.bounds() else { return Self::UNBOUNDED };
        let mut ends = [(lo, f(lo)), (hi, f(hi))];
        ends.sort_by(|(_, y), (_, z)| y.total_cmp(z));
        let [(at_least, least), (at_most, most)] = ends;
        let (below, above) = widened(least, most, |end, y| {
            error(if end == End::Least { at_least } else { at_most }, y)
        });
        Self::outwards(below, above)
    }

    pub(crate) fn add(self, other: Self) -> Self {
        match (self.chained(), other.chained()) {
            (Some(x), Some(y)) => chain::add(x, y),
            _ => self.lost(other),
        }
    }

    pub(crate) fn neg(self) -> Self {
        Self { lo: -self.hi, hi: -self.lo, chain: self.chain.neg(), ..self }
    }

    pub(crate) fn sub(self, other: Self) -> Self {
        self.add(other.neg())
    }

    pub(crate) fn mul(self, other: Self) -> Self {
        match (self.chained(), other.chained()) {
            (Some(x), Some(y)) => chain::multiply(x, y, false),
            _ => self.lost(other),
        }
    }

    pub(crate) fn square(self) -> Self {
        match self.chained() {
            Some(x) => chain::multiply(x, x, true),
            None => self.lost(self),
        }
    }

    /// The quotient. WGSL allows an error of 2.5 ulp for divisors with a magnitude of 2^-126 to 2^126.
    pub(crate) fn div(self, other: Self) -> Self {
        let (Some(x), Some(y)) = (self.chained(), other.chained()) else {
            return self.lost(other);
        };
        let ((a, b), (c, d)) = (x.0, y.0);
        let least_divisor = c.abs().min(d.abs());
        let greatest_divisor = c.abs().max(d.abs());
        if (c <= 0.0 && d >= 0.0)
            || least_divisor < LEAST_DIVISOR
            || greatest_divisor > GREATEST_DIVISOR
        {
            return Self::UNBOUNDED;
        }
        let quotients = [a / c, a / d, b / c, b / d];
        let (lo, hi) = (least(&quotients), greatest(&quotients));
        // No implementation returns a quotient with the wrong sign, although an error of 2.5 ulp around 0 would allow
        // this. With the wrong sign, `sqrt(0 / x)` would be unbounded.
        let (below, above) = widened(lo, hi, |_, y| 2.5 * ulp(y));
        let (below, above) = match (lo >= 0.0, hi <= 0.0) {
            (true, true) => (lo, hi),
            (true, false) => (below.max(0.0), above),
            (false, true) => (below, above.min(0.0)),
            (false, false) => (below, above),
        };
        chain::divide(x, y, Self::outwards(below, above))
    }

    pub(crate) fn min(self, other: Self) -> Self {
        self.both(other, f32::min)
    }

    pub(crate) fn max(self, other: Self) -> Self {
        self.both(other, f32::max)
    }

    /// The float for an integer of a normalised format. WGSL allows an error of 3 ulp from the exact quotient for
    /// `unpack4x8unorm` and similar functions (15.7.4), and Karat allows the same error for this float. 0 is exact.
    pub(crate) fn normalized(exact: f64) -> Self {
        let error = 3.0 * ulp(exact);
        match exact == 0.0 {
            true => Self::point(0.0),
            false => Self::outwards(exact - error, exact + error),
        }
    }

    fn both(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        if !self.is_bounded() || !other.is_bounded() {
            return Self::UNBOUNDED;
        }
        let (a, b) = (self.flushed(), other.flushed());
        Self { lo: f(a.lo, b.lo), hi: f(a.hi, b.hi), ..Self::UNBOUNDED }
    }

    /// The inverse square root. WGSL allows an error of 2 ulp for arguments above zero.
    pub(crate) fn inverse_sqrt(self) -> Self {
        match self.bounds() {
            Some((lo, _)) if lo > 0.0 => self.monotonic(|x| 1.0 / x.sqrt(), |_, y| 2.0 * ulp(y)),
            _ => Self::UNBOUNDED,
        }
    }

    pub(crate) fn sqrt(self) -> Self {
        let Some((lo, hi)) = self.bounds() else { return Self::UNBOUNDED };
        if lo < 0.0 {
            return Self::UNBOUNDED;
        }
        if hi == 0.0 {
            return Self::point(0.0);
        }
        let one = Self::point(1.0);
        if lo == 0.0 {
            // A subnormal argument may be flushed to 0, which has no inverse root. The root of the least normal number
            // is larger than the root of any subnormal number.
            let hi = (hi as f32).max(f32::MIN_POSITIVE);
            return one.div(Self::point(hi).inverse_sqrt()).join(Self::point(0.0));
        }
        one.div(self.inverse_sqrt())
    }

    /// A sine, or a cosine if `cosine` is set. WGSL allows an absolute error of 2^-11 on [-pi, pi].
    pub(crate) fn wave(self, cosine: bool) -> Self {
        let Some((lo, hi)) = self.bounds() else { return Self::UNBOUNDED };
        // The end of the domain is the `f32` nearest to pi, which is slightly above pi.
        let end = f64::from(std::f32::consts::PI);
        if lo < -end || hi > end {
            return Self::UNBOUNDED;
        }
        let f = |x: f64| if cosine { x.cos() } else { x.sin() };
        let tops = if cosine { [0.0, f64::NAN] } else { [PI / 2.0, f64::NAN] };
        let bottoms = if cosine { [PI, -PI] } else { [-PI / 2.0, f64::NAN] };
        let inside = |points: [f64; 2]| points.iter().any(|&p| lo <= p && p <= hi);
        let most = if inside(tops) { 1.0 } else { f(lo).max(f(hi)) };
        let least = if inside(bottoms) { -1.0 } else { f(lo).min(f(hi)) };
        let error = 1.0 / 2048.0; // 2^-11
        Self::outwards(least - error, most + error)
    }

    pub(crate) fn exp2(self) -> Self {
        self.monotonic(f64::exp2, |x, y| (3.0 + 2.0 * x.abs()) * ulp(y))
    }

    pub(crate) fn exp(self) -> Self {
        self.monotonic(f64::exp, |x, y| (3.0 + 2.0 * x.abs()) * ulp(y))
    }

    /// A logarithm. WGSL allows an absolute error of 2^-21 on [0.5, 2], and 3 ulp for other arguments above zero.
    pub(crate) fn logarithm(self, f: impl Fn(f64) -> f64) -> Self {
        match self.bounds() {
            Some((lo, hi)) if lo > 0.0 => {
                let error = |x: f64, y: f64| {
                    if (0.5..=2.0).contains(&x) {
                        1.0 / 2_097_152.0 /* 2^-21 */
                    } else {
                        3.0 * ulp(y)
                    }
                };
                let mut all = self.monotonic(&f, error);
                // Inside the interval, the error may be larger than at both ends.
                for edge in [0.5, 2.0] {
                    if lo < edge && edge < hi {
                        all = all.join(Self::point(edge as f32).monotonic(&f, error));
                    }
                }
                all
            }
            _ => Self::UNBOUNDED,
        }
    }

    pub(crate) fn less(self, other: Self) -> Truth {
        let (Some((a, b)), Some((c, d))) = (self.bounds(), other.bounds()) else {
            return Truth::Undecided;
        };
        Truth::between(b < c, a >= d)
    }

    pub(crate) fn less_equal(self, other: Self) -> Truth {
        let (Some((a, b)), Some((c, d))) = (self.bounds(), other.bounds()) else {
            return Truth::Undecided;
        };
        Truth::between(b <= c, a > d)
    }

    pub(crate) fn equals(self, other: Self) -> Truth {
        let (Some((a, b)), Some((c, d))) = (self.bounds(), other.bounds()) else {
            return Truth::Undecided;
        };
        Truth::between(a == b && b == c && c == d, b < c || d < a)
    }
}

/// The least divisor for which the specification limits the error of a division: 2^-126. The greatest such divisor is
/// 2^126.
const LEAST_DIVISOR: f64 = f32::MIN_POSITIVE as f64;
const GREATEST_DIVISOR: f64 = 1.0 / LEAST_DIVISOR;

/// The smallest distance between two neighbouring `f32` near `x`. At a power of two, the neighbour below is nearer than
/// the neighbour above.
pub(crate) fn ulp(x: f64) -> f64 {
    /// The biased exponent in `f64` of the least normal `f32`, 2^-126.
    const LEAST: u64 = 1023 - 126;
    let power_of_two = x.to_bits() << 12 == 0;
    let exponent = (x.to_bits() >> 52) & 0x7ff;
    let exponent = exponent - u64::from(power_of_two && exponent > LEAST);
    f64::from_bits((exponent.max(LEAST) - 23) << 52)
}

#[derive(Clone, Copy, PartialEq)]
enum End {
    Least,
    Most,
}

/// Widens a range of exact results by their errors.
///
/// An ulp doubles at a power of two. So the lowest result, including its error, may come from an exact result just
/// above a power of two, and not from `least`. In a negative range, the same holds for the highest result and `most`.
/// An error such as `3 + 2 |x|` may have slightly more ulps at the power of two than at the end of the range.
/// `ELSEWHERE` covers this difference, which is less than 2^-20 of the error.
fn widened(least: f64, most: f64, error: impl Fn(End, f64) -> f64) -> (f64, f64) {
    const ELSEWHERE: f64 = 1.0 + 1.0 / 1_048_576.0;
    let mut below = least - error(End::Least, least);
    let mut above = most + error(End::Most, most);
    // The error at one end may reach beyond the other end.
    below = below.min(most - error(End::Most, most));
    above = above.max(least + error(End::Least, least));
    if least > 0.0 && power_above(least) < most {
        let power = power_above(least);
        below = below.min(power - ELSEWHERE * error(End::Least, power.next_up()));
    }
    if most < 0.0 && power_above(-most) < -least {
        let power = -power_above(-most);
        above = above.max(power + ELSEWHERE * error(End::Most, power.next_down()));
    }
    (below, above)
}

/// The smallest power of two that is at least `x`, and at least 2^-126.
fn power_above(x: f64) -> f64 {
    // The exponent without the fraction.
    let floor = f64::from_bits(x.to_bits() & 0x7FF << 52).max(f64::from(f32::MIN_POSITIVE));
    if floor < x { 2.0 * floor } else { floor }
}

/// The exact rounding error of the sum `a + b` in `f64`. Source: Knuth, TAOCP 4.2.2, theorem B.
fn lost(a: f64, b: f64, sum: f64) -> f64 {
    let part = sum - a;
    (a - (sum - part)) + (b - part)
}

fn lower_sum(a: f64, b: f64) -> f64 {
    let sum = a + b;
    if lost(a, b, sum) < 0.0 { sum.next_down() } else { sum }
}

fn upper_sum(a: f64, b: f64) -> f64 {
    let sum = a + b;
    if lost(a, b, sum) > 0.0 { sum.next_up() } else { sum }
}

/// The float that is `by` steps above `x`, or below `x` if `by` is negative. From -0 to +0 is one step.
fn stepped(x: f32, by: i32) -> f32 {
    // The bits of negative floats count downwards. `turned` makes all bits count upwards.
    let turned = |bits: i32| bits ^ ((bits >> 31) & i32::MAX);
    let place = turned(x.to_bits().cast_signed()).wrapping_add(by);
    f32::from_bits(turned(place).cast_unsigned())
}

fn least(of: &[f64; 4]) -> f64 {
    let less = |a: f64, b: f64| if a < b { a } else { b };
    less(less(of[0], of[1]), less(of[2], of[3]))
}

fn greatest(of: &[f64; 4]) -> f64 {
    let more = |a: f64, b: f64| if a > b { a } else { b };
    more(more(of[0], of[1]), more(of[2], of[3]))
}

/// The values that WGSL allows for an integer: each integer from `lo` to `hi`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Range {
    lo: i64,
    hi: i64,
}

impl Range {
    /// The integers from `lo` to `hi`. Both ends must be in the range of an `i32`, or both in the range of a `u32`.
    pub(crate) fn between(lo: i64, hi: i64) -> Self {
        debug_assert!(lo <= hi, "{lo} to {hi}");
        Self { lo, hi }
    }

    /// The integers from `lo` to `hi`, or all integers of the type if `lo` or `hi` is outside of the type's range.
    pub(crate) fn or_full(lo: i64, hi: i64, signed: bool) -> Self {
        let full = Self::full(signed);
        if full.lo <= lo && lo <= hi && hi <= full.hi { Self { lo, hi } } else { full }
    }

    pub(crate) fn of_word(x: u32, signed: bool) -> Self {
        let x = if signed { i64::from(x.cast_signed()) } else { i64::from(x) };
        Self { lo: x, hi: x }
    }

    pub(crate) fn full(signed: bool) -> Self {
        if signed {
            Self { lo: i64::from(i32::MIN), hi: i64::from(i32::MAX) }
        } else {
            Self { lo: 0, hi: i64::from(u32::MAX) }
        }
    }

    /// The least integer.
    #[must_use]
    pub fn lo(self) -> i64 {
        self.lo
    }

    /// The greatest integer.
    #[must_use]
    pub fn hi(self) -> i64 {
        self.hi
    }

    /// If the range contains only one integer: the integer's bits. Otherwise `None`.
    pub(crate) fn word(self) -> Option<u32> {
        (self.lo == self.hi).then_some(self.lo as u32)
    }

    pub(crate) fn join(self, other: Self) -> Self {
        Self { lo: self.lo.min(other.lo), hi: self.hi.max(other.hi) }
    }

    pub(crate) fn less(self, other: Self) -> Truth {
        Truth::between(self.hi < other.lo, self.lo >= other.hi)
    }

    pub(crate) fn equals(self, other: Self) -> Truth {
        let one = self.lo == self.hi && self == other;
        Truth::between(one, self.hi < other.lo || other.hi < self.lo)
    }
}

/// A boolean that may be undecided.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Truth {
    /// The boolean is false.
    #[default]
    False,
    /// The boolean is true.
    True,
    /// The specification allows both values.
    Undecided,
}

impl From<bool> for Truth {
    fn from(x: bool) -> Self {
        if x { Self::True } else { Self::False }
    }
}

impl Truth {
    fn between(surely: bool, never: bool) -> Self {
        match (surely, never) {
            (true, _) => Self::True,
            (_, true) => Self::False,
            _ => Self::Undecided,
        }
    }

    pub(crate) fn and(self, other: Self) -> Self {
        Self::between(
            self == Self::True && other == Self::True,
            self == Self::False || other == Self::False,
        )
    }

    pub(crate) fn or(self, other: Self) -> Self {
        self.not().and(other.not()).not()
    }

    pub(crate) fn not(self) -> Self {
        match self {
            Self::False => Self::True,
            Self::True => Self::False,
            Self::Undecided => Self::Undecided,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A subnormal number may be flushed to 0. Both 0 and the subnormal number have a root.
    #[test]
    fn roots_of_subnormal_numbers_are_bounded() {
        for x in [f32::from_bits(1), 1e-38, 1e-40] {
            let (lo, hi) = Interval::point(x).sqrt().bounds().expect("it is bounded");
            assert!(lo <= 0.0 && hi >= f64::from(x).sqrt() && hi < 1.2e-19, "{x}: {lo} to {hi}");
        }
        assert!(Interval::point(f32::from_bits(1)).inverse_sqrt().bounds().is_none());
    }

    #[test]
    fn bounds_of_a_number_are_its_neighbouring_floats() {
        for x in [0.0, 1e-60, -1e-60, 1e-45, 1.0, 1.0 + 1e-12, -1.0 - 1e-12, -3.5, 1e38, 0.1] {
            let bounds = Interval::outwards(x, x);
            let (lo, hi) = (f64::from(bounds.lo()), f64::from(bounds.hi()));
            assert!(lo <= x && x <= hi, "{x}: {bounds:?}");
            // No other float is between the bounds, except zero, to which a subnormal may be flushed.
            let near = bounds.lo() == bounds.hi() || bounds.lo().next_up() == bounds.hi();
            assert!(near || lo == 0.0 || hi == 0.0, "{x}: {bounds:?}");
        }
        let most = f64::from(f32::MAX);
        assert!(Interval::outwards(most, most).is_bounded());
        assert!(!Interval::outwards(0.0, most * (1.0 + 1e-9)).is_bounded());
        assert!(!Interval::outwards(f64::NAN, 0.0).is_bounded());
    }

    /// Just above x = 0, an ulp of 2^x is twice as large as just below.
    // Lesson 91
    #[test]
    fn errors_double_behind_a_power_of_two() {
        let crossing = Interval::point(-1e-7).join(Interval::point(1.0)).exp2();
        assert!(f64::from(crossing.lo()) <= 1.0 - 6.0 * ulp(0.9), "{crossing:?}");
    }

    #[test]
    fn ulps_are_those_of_f32() {
        assert_eq!(ulp(1.0), f64::from(f32::EPSILON) / 2.0);
        assert_eq!(ulp(1.001), f64::from(f32::EPSILON));
        assert_eq!(ulp(-1.999), f64::from(f32::EPSILON));
        assert_eq!(ulp(0.999), f64::from(f32::EPSILON) / 2.0);
        assert_eq!(ulp(0.0), f64::from(f32::from_bits(1)));
        assert_eq!(ulp(1e-42), f64::from(f32::from_bits(1)));
    }

    #[test]
    fn comparisons_of_overlapping_intervals_are_undecided() {
        use Truth::{False, True, Undecided};
        assert_eq!(
            [Undecided.and(False), Undecided.and(True), True.and(True)],
            [False, Undecided, True]
        );
        assert_eq!(
            [Undecided.or(False), Undecided.or(True), False.or(False)],
            [Undecided, True, False]
        );
        assert_eq!(Interval::between(1.0, 2.0).less(Interval::between(2.0, 3.0)), Undecided);
        assert_eq!(Interval::between(1.0, 2.0).less_equal(Interval::between(2.0, 3.0)), True);
        assert_eq!(Interval::UNBOUNDED.equals(Interval::UNBOUNDED), Undecided);
    }

    #[test]
    fn an_overflowing_range_admits_any_integer() {
        assert_eq!(Range::or_full(0, 1 << 31, true), Range::full(true));
        assert_eq!(Range::or_full(-1, 5, false), Range::full(false));
        assert_eq!(Range::or_full(-1, 5, true), Range::between(-1, 5));
    }
}
