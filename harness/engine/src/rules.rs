//! What each operation does, in each arithmetic: one file a family.
//!
//! A rule stands in one place: its name, how many numbers it takes and gives, the builtin of naga
//! that it is, and what it computes in `f32`, in `f64` and in intervals. The macros below make of a
//! family an enum, which programs hold, and a function that finds the loop for each of them.

mod arithmetic;
mod conversion;
mod exponential;
mod geometry;
mod integer;
mod rounding;
mod trigonometry;

use naga::MathFunction;

pub(crate) use arithmetic::Basic;
pub(crate) use conversion::{FromInt, Scale, ToInt};
pub(crate) use exponential::Exponential;
pub(crate) use geometry::Geometry;
pub(crate) use integer::Integer;
pub(crate) use rounding::Rounding;
pub(crate) use trigonometry::Trigonometry;

use crate::arithmetic::sealed::Rules;
use crate::columns::Columns;

/// A family of rules from floats to floats.
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
            /// How many floats it takes, and how many it gives.
            pub(crate) fn arity(self) -> (usize, usize) {
                match self { $(Self::$name => ($i, $o),)* }
            }

            /// The rule that a builtin applies to each component.
            pub(crate) fn builtin(function: naga::MathFunction) -> Option<Self> {
                $($(if function == naga::MathFunction::$math { return Some(Self::$name); })?)*
                let _ = function;
                None
            }

            /// Runs it over all lanes.
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

/// A family of rules from integers to an integer. The signedness is that of the result, and of the
/// arguments where they matter to a range.
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
                // One integer each has one result, whatever the rule.
                let words = x.map(|x| x.word());
                if words.iter().all(|word| word.is_some()) {
                    let word = Self::exact(words.map(|word| word.unwrap_or_default()));
                    return crate::interval::Range::of_word(word, $signed);
                }
                $(if let Some(range) = (|$xr: [crate::interval::Range; $i]| $range)(x) { return range; })?
                crate::interval::Range::full($signed)
            }
        })*

        impl $family {
            /// How many integers it takes.
            pub(crate) fn arity(self) -> usize {
                match self { $(Self::$name => $i,)* }
            }

            /// The rule that a builtin applies to each component.
            pub(crate) fn builtin(function: naga::MathFunction, signed: bool) -> Option<Self> {
                $($(if function == naga::MathFunction::$math && signed == $signed {
                    return Some(Self::$name);
                })?)*
                None
            }

            /// Runs it over all lanes.
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

/// A rule from floats to floats, of any family.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FloatRule {
    Basic(Basic),
    Exponential(Exponential),
    Geometry(Geometry),
    Rounding(Rounding),
    Trigonometry(Trigonometry),
}

impl FloatRule {
    pub(crate) fn arity(self) -> (usize, usize) {
        match self {
            Self::Basic(rule) => rule.arity(),
            Self::Exponential(rule) => rule.arity(),
            Self::Geometry(rule) => rule.arity(),
            Self::Rounding(rule) => rule.arity(),
            Self::Trigonometry(rule) => rule.arity(),
        }
    }

    /// The rule that a builtin applies to each component.
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
