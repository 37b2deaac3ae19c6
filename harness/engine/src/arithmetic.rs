//! The arithmetics in which a program can run: `f32`, `f64` and intervals.

use std::fmt::Debug;

use crate::interval::{Interval, Range, Truth};
use crate::rules::Half;

/// The representation of numbers while a program runs: [`F32`], [`F64`] or [`Intervals`].
///
/// The trait is sealed, so you can't add an arithmetic outside of this crate. In the folder `rules`, each builtin has
/// separate code for each arithmetic.
pub trait Arithmetic: Rules {}

/// IEEE single precision, rounded to nearest, as a conforming GPU computes.
#[derive(Clone, Copy, Debug)]
pub struct F32;

/// Double precision: the program runs with `f64` in place of `f32`. The difference from [`F32`] shows how large
/// rounding errors are. Integers are exact, as in [`F32`].
#[derive(Clone, Copy, Debug)]
pub struct F64;

/// Interval arithmetic: each value is an interval with all results that the WGSL specification allows.
#[derive(Clone, Copy, Debug)]
pub struct Intervals;

impl Arithmetic for F32 {}
impl Arithmetic for F64 {}
impl Arithmetic for Intervals {}

/// An operation that computes floats from floats, with a method for each arithmetic.
pub trait FloatRule<const I: usize, const O: usize> {
    /// Computes the result in [`F32`].
    fn single(x: [f32; I]) -> [f32; O];
    /// Computes the result in [`F64`].
    fn double(x: [f64; I]) -> [f64; O];
    /// Computes the result in [`Intervals`].
    fn interval(x: [Interval; I]) -> [Interval; O];
}

/// An operation that computes an integer from integers, with a method for each arithmetic. Each `u32` has the bits of
/// an `i32` or a `u32`.
pub trait IntRule<const I: usize> {
    /// `true` if the result is an `i32`.
    const SIGNED: bool;
    /// Computes the result in [`F32`] and in [`F64`].
    fn exact(x: [u32; I]) -> u32;
    /// Computes the result in [`Intervals`].
    fn range(x: [Range; I]) -> Range;
}

/// An operation that computes an integer from floats, with a method for each arithmetic.
pub trait ToIntRule<const I: usize> {
    /// `true` if the result is an `i32`.
    const SIGNED: bool;
    /// Computes the result in [`F32`].
    fn single(x: [f32; I]) -> u32;
    /// Computes the result in [`F64`].
    fn double(x: [f64; I]) -> u32;
    /// Computes the result in [`Intervals`].
    fn interval(x: [Interval; I]) -> Range;
}

/// An operation that computes floats from an integer, with a method for each arithmetic.
pub trait FromIntRule<const O: usize> {
    /// Computes the result in [`F32`].
    fn single(x: u32) -> [f32; O];
    /// Computes the result in [`F64`].
    fn double(x: u32) -> [f64; O];
    /// Computes the result in [`Intervals`].
    fn interval(x: Range) -> [Interval; O];
}

/// An operation that computes a float from a float and an integer, with a method for each arithmetic.
pub trait MixedRule {
    /// Computes the result in [`F32`].
    fn single(x: f32, i: u32) -> f32;
    /// Computes the result in [`F64`].
    fn double(x: f64, i: u32) -> f64;
    /// Computes the result in [`Intervals`].
    fn interval(x: Interval, i: Range) -> Interval;
}

/// The least and the greatest value that an integer may have.
pub(crate) type Bounds = (i64, i64);

pub(crate) mod sealed {
    use super::*;

    /// A function that narrows the interval of a result. Its first argument has the intervals of the operation's
    /// arguments. Its second argument is the interval to narrow.
    pub(crate) type Narrow<'n> = &'n dyn Fn(&[Interval], Interval) -> Interval;

    /// The types and operations that the machine needs from an arithmetic.
    pub trait Rules: Copy + Debug + Send + Sync + 'static {
        /// The representation of a WGSL float of any width.
        type Float: Copy + Default + Debug + Send + Sync;
        /// The representation of an `i32` or a `u32`.
        type Int: Copy + Default + Debug + Send + Sync;
        /// A boolean. Masks consist of booleans, too.
        type Bool: Copy + Default + Debug + Send + Sync + PartialEq;

        /// `true` if a boolean may be undecided. Then the machine tracks active lanes with `Worlds` in place of
        /// `Masks`.
        const UNDECIDED: bool;

        fn float(x: f32) -> Self::Float;
        /// A literal's value. If the author wrote a decimal such as 0.1, its interval contains all numbers that round
        /// to `x`.
        fn decimal(x: f32, half: bool) -> Self::Float {
            let _ = half;
            Self::float(x)
        }
        fn int(x: u32, signed: bool) -> Self::Int;
        fn bool(x: bool) -> Self::Bool;

        fn float_rule<R: FloatRule<I, O>, const I: usize, const O: usize>(
            x: [Self::Float; I],
        ) -> [Self::Float; O];
        /// In [`Intervals`], narrows the result `y` of an operation with the function in the first argument. In the
        /// other arithmetics, returns `y`.
        fn narrow(_: Narrow<'_>, _: &[Self::Float], y: Self::Float) -> Self::Float {
            y
        }
        fn int_rule<R: IntRule<I>, const I: usize>(x: [Self::Int; I]) -> Self::Int;
        fn to_int<R: ToIntRule<I>, const I: usize>(x: [Self::Float; I]) -> Self::Int;
        fn from_int<R: FromIntRule<O>, const O: usize>(x: Self::Int) -> [Self::Float; O];
        fn mixed<R: MixedRule>(x: Self::Float, i: Self::Int) -> Self::Float;

        fn float_equal(a: Self::Float, b: Self::Float) -> Self::Bool;
        fn float_less(a: Self::Float, b: Self::Float) -> Self::Bool;
        fn float_less_equal(a: Self::Float, b: Self::Float) -> Self::Bool;
        fn int_equal(a: Self::Int, b: Self::Int) -> Self::Bool;
        fn int_less(a: Self::Int, b: Self::Int, signed: bool) -> Self::Bool;

        fn and(a: Self::Bool, b: Self::Bool) -> Self::Bool;
        fn or(a: Self::Bool, b: Self::Bool) -> Self::Bool;
        fn not(a: Self::Bool) -> Self::Bool;
        /// Checks if the boolean may be true.
        fn possible(a: Self::Bool) -> bool;
        /// An undecided boolean. Arithmetics without undecided booleans return `true`.
        fn undecided() -> Self::Bool;
        /// Checks if the boolean may be false.
        fn avoidable(a: Self::Bool) -> bool;

        /// `yes` if `c` is true, `no` if `c` is false, and the join of both if `c` is undecided.
        fn select_float(c: Self::Bool, yes: Self::Float, no: Self::Float) -> Self::Float;
        fn select_int(c: Self::Bool, yes: Self::Int, no: Self::Int) -> Self::Int;
        fn select_bool(c: Self::Bool, yes: Self::Bool, no: Self::Bool) -> Self::Bool;

        /// The least and the greatest value that an index may have. `signed` is `true` if the index is an `i32`.
        fn bounds(i: Self::Int, signed: bool) -> Bounds;

        /// Rounds a value to half precision. `F64` doesn't round. In [`Intervals`], `half` is the error that WGSL
        /// allows, and the result contains each value within this error.
        fn to_half(x: Self::Float, half: Half) -> Self::Float;
        /// Flushes subnormal values to zero.
        fn flush(x: Self::Float) -> Self::Float;
        /// Checks if the float is an unbounded interval. The machine notes the cause of such intervals.
        fn is_unknown(x: Self::Float) -> bool;
        /// Returns `x`. If `x` is unbounded, notes its cause in it: the first cause among `inputs`, or `site` if no
        /// input has a cause.
        fn note(
            x: Self::Float,
            inputs: &mut dyn Iterator<Item = Self::Float>,
            site: u32,
        ) -> Self::Float;
        /// `true` if `note` has an effect.
        const NOTES: bool;
        /// An unbounded float with operation `site` as its cause. `None` if the arithmetic has no such values.
        fn unknown_float(site: u32) -> Option<Self::Float>;
        /// The range of all integers of the type. `None` if the arithmetic has no ranges.
        fn unknown_int(signed: bool) -> Option<Self::Int>;
        /// An undecided boolean. `None` if the arithmetic has no such booleans.
        fn unknown_bool() -> Option<Self::Bool>;

        /// The word that memory stores for a float: the nearest `f32`, or the middle of an interval.
        fn float_word(x: Self::Float) -> u32;
        /// The word that memory stores for an integer. For a range, memory stores the least integer.
        fn int_word(x: Self::Int) -> u32;
        /// The word that memory stores for a boolean: 1 if it may be true, otherwise 0.
        fn bool_word(x: Self::Bool) -> u32 {
            u32::from(Self::possible(x))
        }

        /// The result of a texture filter: `sum` is the weighted sum of texels, whose values are all within `hull`.
        fn filtered(sum: f64, hull: (f32, f32)) -> Self::Float;
        /// A texel's channel in a normalised format such as `rgba8unorm`, converted from an integer to `x`.
        fn normalized(x: f32) -> Self::Float {
            Self::float(x)
        }
        /// Converts a texture coordinate to the number that filters use. For an interval, this is its middle.
        fn coordinate(x: Self::Float) -> f64;
    }
}

use sealed::{Narrow, Rules};

macro_rules! exact_integers_and_booleans {
    () => {
        type Int = u32;
        type Bool = bool;
        const UNDECIDED: bool = false;
        const NOTES: bool = false;

        fn int(x: u32, _signed: bool) -> u32 {
            x
        }
        fn bool(x: bool) -> bool {
            x
        }
        #[inline(always)]
        fn int_rule<R: IntRule<I>, const I: usize>(x: [u32; I]) -> u32 {
            R::exact(x)
        }
        #[inline(always)]
        fn float_equal(a: Self::Float, b: Self::Float) -> bool {
            a == b
        }
        #[inline(always)]
        fn float_less(a: Self::Float, b: Self::Float) -> bool {
            a < b
        }
        #[inline(always)]
        fn float_less_equal(a: Self::Float, b: Self::Float) -> bool {
            a <= b
        }
        #[inline(always)]
        fn int_equal(a: u32, b: u32) -> bool {
            a == b
        }
        #[inline(always)]
        fn int_less(a: u32, b: u32, signed: bool) -> bool {
            if signed { a.cast_signed() < b.cast_signed() } else { a < b }
        }
        #[inline(always)]
        fn and(a: bool, b: bool) -> bool {
            a & b
        }
        #[inline(always)]
        fn or(a: bool, b: bool) -> bool {
            a | b
        }
        #[inline(always)]
        fn not(a: bool) -> bool {
            !a
        }
        #[inline(always)]
        fn possible(a: bool) -> bool {
            a
        }
        #[inline(always)]
        fn undecided() -> bool {
            true
        }
        #[inline(always)]
        fn avoidable(a: bool) -> bool {
            !a
        }
        #[inline(always)]
        fn select_float(c: bool, yes: Self::Float, no: Self::Float) -> Self::Float {
            if c { yes } else { no }
        }
        #[inline(always)]
        fn select_int(c: bool, yes: u32, no: u32) -> u32 {
            if c { yes } else { no }
        }
        #[inline(always)]
        fn select_bool(c: bool, yes: bool, no: bool) -> bool {
            (c & yes) | (!c & no)
        }
        #[inline(always)]
        fn bounds(i: u32, signed: bool) -> Bounds {
            let value = if signed { i64::from(i.cast_signed()) } else { i64::from(i) };
            (value, value)
        }
        fn is_unknown(_: Self::Float) -> bool {
            false
        }
        #[inline(always)]
        fn note(x: Self::Float, _: &mut dyn Iterator<Item = Self::Float>, _: u32) -> Self::Float {
            x
        }
        fn unknown_float(_: u32) -> Option<Self::Float> {
            None
        }
        fn unknown_int(_: bool) -> Option<u32> {
            None
        }
        fn unknown_bool() -> Option<bool> {
            None
        }
        fn int_word(x: u32) -> u32 {
            x
        }
    };
}

impl Rules for F32 {
    type Float = f32;
    exact_integers_and_booleans!();

    fn float(x: f32) -> f32 {
        x
    }
    #[inline(always)]
    fn float_rule<R: FloatRule<I, O>, const I: usize, const O: usize>(x: [f32; I]) -> [f32; O] {
        R::single(x)
    }
    #[inline(always)]
    fn to_int<R: ToIntRule<I>, const I: usize>(x: [f32; I]) -> u32 {
        R::single(x)
    }
    #[inline(always)]
    fn from_int<R: FromIntRule<O>, const O: usize>(x: u32) -> [f32; O] {
        R::single(x)
    }
    #[inline(always)]
    fn mixed<R: MixedRule>(x: f32, i: u32) -> f32 {
        R::single(x, i)
    }
    fn to_half(x: f32, _: Half) -> f32 {
        half::f16::from_f32(x).to_f32()
    }
    #[inline(always)]
    fn flush(x: f32) -> f32 {
        if x.abs() < f32::MIN_POSITIVE { 0.0f32.copysign(x) } else { x }
    }
    fn float_word(x: f32) -> u32 {
        x.to_bits()
    }
    fn filtered(sum: f64, _: (f32, f32)) -> f32 {
        // In a 2D filter, a weight is a product of two `f32`. GPUs compute weights with fewer bits.
        sum as f32
    }
    fn coordinate(x: f32) -> f64 {
        f64::from(x)
    }
}

impl Rules for F64 {
    type Float = f64;
    exact_integers_and_booleans!();

    fn float(x: f32) -> f64 {
        f64::from(x)
    }
    #[inline(always)]
    fn float_rule<R: FloatRule<I, O>, const I: usize, const O: usize>(x: [f64; I]) -> [f64; O] {
        R::double(x)
    }
    #[inline(always)]
    fn to_int<R: ToIntRule<I>, const I: usize>(x: [f64; I]) -> u32 {
        R::double(x)
    }
    #[inline(always)]
    fn from_int<R: FromIntRule<O>, const O: usize>(x: u32) -> [f64; O] {
        R::double(x)
    }
    #[inline(always)]
    fn mixed<R: MixedRule>(x: f64, i: u32) -> f64 {
        R::double(x, i)
    }
    fn to_half(x: f64, _: Half) -> f64 {
        x
    }
    #[inline(always)]
    fn flush(x: f64) -> f64 {
        x
    }
    fn float_word(x: f64) -> u32 {
        (x as f32).to_bits()
    }
    fn filtered(sum: f64, _: (f32, f32)) -> f64 {
        sum
    }
    fn coordinate(x: f64) -> f64 {
        x
    }
}

impl Rules for Intervals {
    type Float = Interval;
    type Int = Range;
    type Bool = Truth;
    const UNDECIDED: bool = true;
    const NOTES: bool = true;

    fn float(x: f32) -> Interval {
        Interval::point(x)
    }
    fn decimal(x: f32, half: bool) -> Interval {
        /// The largest number of significant bits in a literal that counts as exact, such as 0.625. Literals with more
        /// bits, such as 0.1, count as rounded decimals.
        const SHORT: u32 = 12;
        /// `SHORT` for half precision, whose floats have 11 significant bits.
        const SHORT_HALF: u32 = 6;
        let digits = if half { SHORT_HALF } else { SHORT };
        let short = x.to_bits() & ((1 << (24 - digits)) - 1) == 0;
        let whole = x == x.trunc() && x.abs() < 16_777_216.0;
        match (short || whole, half) {
            (true, _) => Interval::point(x),
            (false, false) => Interval::between(x.next_down(), x.next_up()),
            (false, true) => Interval::point(x).halved(Half::Ulps(1)),
        }
    }
    fn int(x: u32, signed: bool) -> Range {
        Range::of_word(x, signed)
    }
    fn bool(x: bool) -> Truth {
        Truth::from(x)
    }
    fn float_rule<R: FloatRule<I, O>, const I: usize, const O: usize>(
        x: [Interval; I],
    ) -> [Interval; O] {
        R::interval(x)
    }
    fn narrow(narrow: Narrow<'_>, x: &[Interval], y: Interval) -> Interval {
        narrow(x, y)
    }
    fn int_rule<R: IntRule<I>, const I: usize>(x: [Range; I]) -> Range {
        R::range(x)
    }
    fn to_int<R: ToIntRule<I>, const I: usize>(x: [Interval; I]) -> Range {
        R::interval(x)
    }
    fn from_int<R: FromIntRule<O>, const O: usize>(x: Range) -> [Interval; O] {
        R::interval(x)
    }
    fn mixed<R: MixedRule>(x: Interval, i: Range) -> Interval {
        R::interval(x, i)
    }
    fn float_equal(a: Interval, b: Interval) -> Truth {
        a.equals(b)
    }
    fn float_less(a: Interval, b: Interval) -> Truth {
        a.less(b)
    }
    fn float_less_equal(a: Interval, b: Interval) -> Truth {
        a.less_equal(b)
    }
    fn int_equal(a: Range, b: Range) -> Truth {
        a.equals(b)
    }
    fn int_less(a: Range, b: Range, _signed: bool) -> Truth {
        a.less(b)
    }
    fn and(a: Truth, b: Truth) -> Truth {
        a.and(b)
    }
    fn or(a: Truth, b: Truth) -> Truth {
        a.or(b)
    }
    fn not(a: Truth) -> Truth {
        a.not()
    }
    fn undecided() -> Truth {
        Truth::Undecided
    }
    fn possible(a: Truth) -> bool {
        a != Truth::False
    }
    fn avoidable(a: Truth) -> bool {
        a != Truth::True
    }
    fn select_float(c: Truth, yes: Interval, no: Interval) -> Interval {
        match c {
            Truth::True => yes,
            Truth::False => no,
            Truth::Undecided => yes.join(no),
        }
    }
    fn select_int(c: Truth, yes: Range, no: Range) -> Range {
        match c {
            Truth::True => yes,
            Truth::False => no,
            Truth::Undecided => yes.join(no),
        }
    }
    fn select_bool(c: Truth, yes: Truth, no: Truth) -> Truth {
        match c {
            Truth::True => yes,
            Truth::False => no,
            Truth::Undecided if yes == no => yes,
            Truth::Undecided => Truth::Undecided,
        }
    }
    fn bounds(i: Range, _signed: bool) -> Bounds {
        (i.lo(), i.hi())
    }
    fn to_half(x: Interval, half: Half) -> Interval {
        x.halved(half)
    }
    fn flush(x: Interval) -> Interval {
        x
    }
    fn is_unknown(x: Interval) -> bool {
        !x.is_bounded()
    }
    fn note(x: Interval, inputs: &mut dyn Iterator<Item = Interval>, site: u32) -> Interval {
        if x.is_bounded() {
            return x;
        }
        match inputs.filter_map(|input| input.cause().map(|_| input)).next() {
            Some(input) => x.caused_as(input),
            None => x.caused_by(site),
        }
    }
    fn unknown_float(site: u32) -> Option<Interval> {
        Some(Interval::UNBOUNDED.caused_by(site))
    }
    fn unknown_int(signed: bool) -> Option<Range> {
        Some(Range::full(signed))
    }
    fn unknown_bool() -> Option<Truth> {
        Some(Truth::Undecided)
    }
    fn float_word(x: Interval) -> u32 {
        x.middle().to_bits()
    }
    fn int_word(x: Range) -> u32 {
        x.lo() as u32
    }
    fn filtered(_: f64, hull: (f32, f32)) -> Interval {
        /// The largest error of a filter's result, relative to the largest texel. A filter adds at most 16 texels
        /// (eight of each of two levels). The weight of a texel is a product of four numbers. So each texel's part of
        /// the result is rounded at most 20 times. Each rounding has an error of less than 2^-23 of the largest texel.
        const SLACK: f64 = 1.0 / 262_144.0; // 2^-18
        // WGSL and WebGPU don't limit the error of a filter. A filter's result is a weighted mean of texels with any
        // weights, so it lies between the least and the greatest texel. But weights are rounded, so their sum may be
        // slightly more or less than 1. If all texels have the same sign, the mean has this sign, too.
        let [lo, hi] = [hull.0, hull.1].map(f64::from);
        let size = lo.abs().max(hi.abs());
        let below = if lo >= 0.0 { lo } else { size };
        let above = if hi <= 0.0 { -hi } else { size };
        Interval::outwards(lo - SLACK * below, hi + SLACK * above)
    }
    fn normalized(x: f32) -> Interval {
        Interval::normalized(f64::from(x))
    }
    fn coordinate(x: Interval) -> f64 {
        f64::from(x.middle())
    }
}
