//! The rules: how each operation is computed in each arithmetic. Each family of rules has one file.
//!
//! A rule is defined in one place: its name, the number of its arguments and results, naga's name of the builtin, and
//! its computation in `f32`, in `f64` and in intervals. For each family, the macros below make an enum of the rules,
//! and a function that applies a rule to all lanes. The operations of a program contain values of these enums.

mod arithmetic;
mod conversion;
mod exponential;
mod geometry;
mod half;
mod integer;
mod rounding;
mod trigonometry;

use naga::MathFunction;

pub(crate) use arithmetic::Basic;
pub(crate) use conversion::{FromInt, Scale, ToInt};
pub(crate) use exponential::Exponential;
pub(crate) use geometry::Geometry;
pub(crate) use half::Half;
pub(crate) use integer::Integer;
pub(crate) use rounding::Rounding;
pub(crate) use trigonometry::Trigonometry;

use crate::arithmetic::sealed::Rules;
use crate::columns::Columns;

/// Defines a family of rules from floats to floats.
macro_rules! float_rules {
    ($(#[$meta:meta])* $family:ident {
        $($(#[$doc:meta])* $name:ident [$i:literal, $o:literal] $(= $math:ident)? {
            single: |$xs:pat_param| $single:expr,
            double: |$xd:pat_param| $double:expr,
            interval: |$xi:pat_param| $interval:expr $(,)?
        })*
    }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub(crate) enum $family { $($(#[$doc])* $name,)* }

        mod rule {
            $(#[derive(Debug)] pub(super) struct $name;)*
        }

        $(impl crate::arithmetic::FloatRule<$i, $o> for rule::$name {
            #[inline(always)]
            fn single($xs: [f32; $i]) -> [f32; $o] { $single }
            #[inline(always)]
            fn double($xd: [f64; $i]) -> [f64; $o] { $double }
            fn interval($xi: [crate::interval::Interval; $i]) -> [crate::interval::Interval; $o] { $interval }
        })*

        impl $family {
            #[cfg(test)]
            pub(crate) const ALL: &[Self] = &[$(Self::$name,)*];

            /// The number of floats that the rule takes, and the number that it returns.
            pub(crate) fn arity(self) -> (usize, usize) {
                match self { $(Self::$name => ($i, $o),)* }
            }

            /// The rule that a builtin applies to each component. `None` if this family has no such rule.
            pub(crate) fn builtin(function: naga::MathFunction) -> Option<Self> {
                $($(if function == naga::MathFunction::$math { return Some(Self::$name); })?)*
                let _ = function;
                None
            }

            pub(crate) fn run<A: crate::arithmetic::sealed::Rules>(
                self,
                floats: &mut crate::columns::Columns<A::Float>,
                registers: &[u32],
            ) {
                match self {
                    $(Self::$name => floats.map::<$i, $o>(registers, A::float_rule::<rule::$name, $i, $o>),)*
                }
            }
        }
    };
}
pub(crate) use float_rules;

/// Defines a family of rules from integers to an integer. The last letter of a rule's name says if the result is signed
/// (`I`) or unsigned (`U`). `range` computes the bounds of the result from the bounds of the arguments. If the sign
/// matters, `range` assumes that the arguments have the type of the result.
macro_rules! integer_rules {
    ($(#[$meta:meta])* $family:ident {
        $($(#[$doc:meta])* $name:ident [$i:literal] $signed:literal $(= $math:ident)? {
            exact: |$x:pat_param| $exact:expr
            $(, range: |$xr:pat_param| $range:expr)? $(,)?
        })*
    }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub(crate) enum $family { $($(#[$doc])* $name,)* }

        mod rule {
            $(#[derive(Debug)] pub(super) struct $name;)*
        }

        $(impl crate::arithmetic::IntRule<$i> for rule::$name {
            const SIGNED: bool = $signed;
            #[inline(always)]
            fn exact($x: [u32; $i]) -> u32 { $exact }
            fn range(x: [crate::interval::Range; $i]) -> crate::interval::Range {
                // If each argument is a single integer, the result is a single integer, too.
                let words = x.map(|x| x.word());
                if words.iter().all(|word| word.is_some()) {
                    let word = Self::exact(words.map(|word| word.expect("each has one")));
                    return crate::interval::Range::of_word(word, $signed);
                }
                $(if let Some(range) = (|$xr: [crate::interval::Range; $i]| $range)(x) { return range; })?
                crate::interval::Range::full($signed)
            }
        })*

        impl $family {
            pub(crate) fn arity(self) -> usize {
                match self { $(Self::$name => $i,)* }
            }

            /// The rule that a builtin applies to each component. `None` if this family has no such rule.
            pub(crate) fn builtin(function: naga::MathFunction, signed: bool) -> Option<Self> {
                $($(if function == naga::MathFunction::$math && signed == $signed {
                    return Some(Self::$name);
                })?)*
                None
            }

            pub(crate) fn run<A: crate::arithmetic::sealed::Rules>(
                self,
                ints: &mut crate::columns::Columns<A::Int>,
                registers: &[u32],
            ) {
                match self {
                    $(Self::$name => ints.map::<$i, 1>(registers, |x| {
                        [A::int_rule::<rule::$name, $i>(x)]
                    }),)*
                }
            }
        }
    };
}
pub(crate) use integer_rules;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FloatRule {
    Basic(Basic),
    Exponential(Exponential),
    Geometry(Geometry),
    Rounding(Rounding),
    Trigonometry(Trigonometry),
}

/// The positions of the `low` and the `high` operand of `clamp` or `smoothstep`.
pub(crate) struct Edges {
    pub(crate) low: usize,
    pub(crate) high: usize,
    /// `true` if equal edges are a hazard, too.
    pub(crate) distinct: bool,
}

impl FloatRule {
    /// The two operands that must be in order, if the rule has such operands. WGSL 17.5 lets `clamp` of floats be
    /// "either min(max(e, low), high), or the median of the three values". The two results differ if low is above high.
    /// `smoothstep` divides by high - low, and the languages into which WGSL is translated define `smoothstep` only if
    /// low is below high.
    pub(crate) fn edges(self) -> Option<Edges> {
        match self {
            Self::Basic(Basic::Clamp) => Some(Edges { low: 1, high: 2, distinct: false }),
            Self::Basic(Basic::SmoothStep) => Some(Edges { low: 0, high: 1, distinct: true }),
            _ => None,
        }
    }

    pub(crate) fn arity(self) -> (usize, usize) {
        match self {
            Self::Basic(rule) => rule.arity(),
            Self::Exponential(rule) => rule.arity(),
            Self::Geometry(rule) => rule.arity(),
            Self::Rounding(rule) => rule.arity(),
            Self::Trigonometry(rule) => rule.arity(),
        }
    }

    /// The rule that a builtin applies to each component. `None` if this family has no such rule.
    pub(crate) fn builtin(function: MathFunction) -> Option<Self> {
        Basic::builtin(function)
            .map(Self::Basic)
            .or_else(|| Exponential::builtin(function).map(Self::Exponential))
            .or_else(|| Rounding::builtin(function).map(Self::Rounding))
            .or_else(|| Geometry::builtin(function).map(Self::Geometry))
            .or_else(|| Trigonometry::builtin(function).map(Self::Trigonometry))
    }

    pub(crate) fn run<A: Rules>(self, floats: &mut Columns<A::Float>, registers: &[u32]) {
        match self {
            Self::Basic(rule) => rule.run::<A>(floats, registers),
            Self::Exponential(rule) => rule.run::<A>(floats, registers),
            Self::Geometry(rule) => rule.run::<A>(floats, registers),
            Self::Rounding(rule) => rule.run::<A>(floats, registers),
            Self::Trigonometry(rule) => rule.run::<A>(floats, registers),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arithmetic::Intervals;
    use crate::interval::Interval;

    /// Random numbers from a seed, by SplitMix64.
    struct Random(u64);

    impl Random {
        fn next(&mut self) -> u64 {
            self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut z = self.0;
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            z ^ (z >> 31)
        }

        fn below(&mut self, end: u64) -> u64 {
            self.next() % end
        }

        /// A random float between two floats. All floats between them are equally likely.
        fn between(&mut self, lo: f32, hi: f32) -> f32 {
            let (lo, hi) = (place(lo), place(hi));
            from_place(lo + i64::try_from(self.below((hi - lo + 1) as u64)).expect("32 bits"))
        }

        /// A random interval: near a power of two, near 1, or anywhere. The interval may be a single number, narrow or
        /// wide.
        fn interval(&mut self) -> Interval {
            let power = (self.below(9) as f32 - 4.0).exp2();
            let size = match self.below(4) {
                0 => power,
                1 => 1.0,
                2 => (self.below(61) as f32 - 30.0).exp2() * 1.3,
                _ => self.below(1 << 20) as f32 / f32::from(1u16 << 15),
            };
            let start = if self.below(3) == 0 { -size } else { size };
            let steps = match self.below(4) {
                0 => 0,
                1 => self.below(8),
                2 => self.below(1 << 12),
                _ => self.below(1 << 25),
            };
            let back = self.below(steps + 1);
            let step = |by: i64| from_place(place(start) + by);
            Interval::between(step(-back.cast_signed()), step((steps - back).cast_signed()))
        }
    }

    fn place(x: f32) -> i64 {
        let bits = i64::from(x.to_bits() & 0x7fff_ffff);
        if x.is_sign_negative() { -bits } else { bits }
    }

    fn from_place(at: i64) -> f32 {
        let bits = u32::try_from(at.unsigned_abs()).expect("31 bits");
        f32::from_bits(bits | if at < 0 { 1 << 31 } else { 0 })
    }

    fn apply(rule: FloatRule, x: &[Interval]) -> Vec<Interval> {
        let (ins, outs) = rule.arity();
        let mut columns = Columns::new(ins + outs, 1);
        for (k, &x) in x.iter().enumerate() {
            columns.get_mut((outs + k) as u32)[0] = x;
        }
        let registers: Vec<u32> = (0..(ins + outs) as u32).collect();
        rule.run::<Intervals>(&mut columns, &registers);
        (0..outs as u32).map(|out| columns.get(out)[0]).collect()
    }

    /// Bounds for single numbers must lie within the bounds for intervals that contain these numbers. Otherwise a
    /// result that WGSL allows could be outside of the bounds.
    // Lesson 109
    #[test]
    fn wider_arguments_have_wider_results() {
        let families: [Vec<FloatRule>; 5] = [
            Basic::ALL.iter().map(|rule| FloatRule::Basic(*rule)).collect(),
            Exponential::ALL.iter().map(|rule| FloatRule::Exponential(*rule)).collect(),
            Geometry::ALL.iter().map(|rule| FloatRule::Geometry(*rule)).collect(),
            Rounding::ALL.iter().map(|rule| FloatRule::Rounding(*rule)).collect(),
            Trigonometry::ALL.iter().map(|rule| FloatRule::Trigonometry(*rule)).collect(),
        ];
        let mut random = Random(1);
        let mut compared = 0;
        for rule in families.into_iter().flatten() {
            for _ in 0..2000 {
                let wide: Vec<Interval> = (0..rule.arity().0).map(|_| random.interval()).collect();
                let bounds = apply(rule, &wide);
                for _ in 0..16 {
                    let points: Vec<f32> =
                        wide.iter().map(|x| random.between(x.lo(), x.hi())).collect();
                    let narrow: Vec<Interval> =
                        points.iter().map(|&x| Interval::point(x)).collect();
                    for (inner, outer) in apply(rule, &narrow).into_iter().zip(&bounds) {
                        if !outer.is_bounded() {
                            continue;
                        }
                        compared += 1;
                        let holds = inner.is_bounded()
                            && outer.lo() <= inner.lo()
                            && inner.hi() <= outer.hi();
                        assert!(
                            holds,
                            "{rule:?} of {points:?} is in {inner:?}, and of {wide:?} in {outer:?}"
                        );
                    }
                }
            }
        }
        assert!(compared > 100_000, "{compared}");
    }
}
