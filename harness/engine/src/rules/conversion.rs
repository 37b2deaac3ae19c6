//! Rules for conversions between floats and integers, and for their bits and exponents.

use crate::arithmetic::{FromIntRule, MixedRule, ToIntRule, sealed::Rules};
use crate::columns::Columns;
use crate::interval::{Interval, Range};

/// Defines a family of rules from floats to an integer.
macro_rules! to_int_rules {
    ($family:ident { $($(#[$doc:meta])* $name:ident [$i:literal] $signed:literal {
        single: $single:expr, double: $double:expr, interval: $interval:expr $(,)?
    })* }) => {
        /// Functions from floats to an integer.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub(crate) enum $family { $($(#[$doc])* $name,)* }

        mod to_int {
            $(#[derive(Debug)] pub(super) struct $name;)*
        }

        $(impl ToIntRule<$i> for to_int::$name {
            const SIGNED: bool = $signed;
            #[inline(always)]
            fn single(x: [f32; $i]) -> u32 { ($single)(x) }
            #[inline(always)]
            fn double(x: [f64; $i]) -> u32 { ($double)(x) }
            fn interval(x: [Interval; $i]) -> Range { ($interval)(x) }
        })*

        impl $family {
            pub(crate) fn arity(self) -> usize {
                match self { $(Self::$name => $i,)* }
            }

            /// Applies the rule to all lanes. `registers` has the integer first, then the floats.
            pub(crate) fn run<A: Rules>(
                self,
                floats: &Columns<A::Float>,
                ints: &mut Columns<A::Int>,
                registers: &[u32],
            ) {
                match self {
                    $(Self::$name => {
                        let args: [&[A::Float]; $i] =
                            std::array::from_fn(|k| floats.get(registers[1 + k]));
                        for (lane, out) in ints.get_mut(registers[0]).iter_mut().enumerate() {
                            *out = A::to_int::<to_int::$name, $i>(std::array::from_fn(|k| args[k][lane]));
                        }
                    })*
                }
            }
        }
    };
}

/// Defines a family of rules from an integer to floats.
macro_rules! from_int_rules {
    ($family:ident { $($(#[$doc:meta])* $name:ident [$o:literal] {
        single: $single:expr, double: $double:expr, interval: $interval:expr $(,)?
    })* }) => {
        /// Functions from an integer to floats.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub(crate) enum $family { $($(#[$doc])* $name,)* }

        mod from_int {
            $(#[derive(Debug)] pub(super) struct $name;)*
        }

        $(impl FromIntRule<$o> for from_int::$name {
            #[inline(always)]
            fn single(x: u32) -> [f32; $o] { ($single)(x) }
            #[inline(always)]
            fn double(x: u32) -> [f64; $o] { ($double)(x) }
            fn interval(x: Range) -> [Interval; $o] { ($interval)(x) }
        })*

        impl $family {
            pub(crate) fn arity(self) -> usize {
                match self { $(Self::$name => $o,)* }
            }

            /// Applies the rule to all lanes. `registers` has the floats first, then the integer.
            pub(crate) fn run<A: Rules>(
                self,
                floats: &mut Columns<A::Float>,
                ints: &Columns<A::Int>,
                registers: &[u32],
            ) {
                match self {
                    $(Self::$name => {
                        let arg = ints.get(registers[$o]);
                        for (lane, &x) in arg.iter().enumerate() {
                            let y = A::from_int::<from_int::$name, $o>(x);
                            for k in 0..$o {
                                floats.get_mut(registers[k])[lane] = y[k];
                            }
                        }
                    })*
                }
            }
        }
    };
}

to_int_rules! {
    ToInt {
        /// Rounds towards zero. A float outside of the integer type's range becomes the nearest end of the range, and
        /// NaN becomes 0.
        Signed[1] true {
            single: |[x]: [f32; 1]| saturate_signed(f64::from(x)).cast_unsigned(),
            double: |[x]: [f64; 1]| saturate_signed(x).cast_unsigned(),
            interval: |[x]: [Interval; 1]| whole(x, |x| i64::from(saturate_signed(x)), true),
        }
        Unsigned[1] false {
            single: |[x]: [f32; 1]| saturate_unsigned(f64::from(x)),
            double: |[x]: [f64; 1]| saturate_unsigned(x),
            interval: |[x]: [Interval; 1]| whole(x, |x| i64::from(saturate_unsigned(x)), false),
        }
        /// The bits of the float. `f64` arithmetic first rounds the float to `f32`.
        BitsSigned[1] true {
            single: |[x]: [f32; 1]| x.to_bits(),
            double: |[x]: [f64; 1]| (x as f32).to_bits(),
            interval: |[x]: [Interval; 1]| bits(x, true),
        }
        BitsUnsigned[1] false {
            single: |[x]: [f32; 1]| x.to_bits(),
            double: |[x]: [f64; 1]| (x as f32).to_bits(),
            interval: |[x]: [Interval; 1]| bits(x, false),
        }
        /// The exponent of `frexp`.
        Exponent[1] true {
            single: |[x]: [f32; 1]| exponent(f64::from(x)).cast_unsigned(),
            double: |[x]: [f64; 1]| exponent(x).cast_unsigned(),
            interval: |[x]: [Interval; 1]| match x.bounds() {
                Some((lo, hi)) if lo > 0.0 => {
                    Range::between(i64::from(exponent(lo)), i64::from(exponent(hi)))
                }
                Some((lo, hi)) if lo == 0.0 && hi == 0.0 => Range::between(0, 0),
                // The range is from the exponent of the least subnormal to the exponent of the greatest float.
                Some(_) => Range::between(-148, 128),
                None => Range::full(true),
            },
        }
        /// Packs four floats of [-1, 1] into bytes.
        Snorm8[4] false {
            single: |x: [f32; 4]| u32::from_le_bytes(x.map(|x| snorm(f64::from(x), 127.0) as u8)),
            double: |x: [f64; 4]| u32::from_le_bytes(x.map(|x| snorm(x, 127.0) as u8)),
            interval: packed,
        }
        /// Packs four floats of [0, 1] into bytes.
        Unorm8[4] false {
            single: |x: [f32; 4]| u32::from_le_bytes(x.map(|x| unorm(f64::from(x), 255.0) as u8)),
            double: |x: [f64; 4]| u32::from_le_bytes(x.map(|x| unorm(x, 255.0) as u8)),
            interval: packed,
        }
        Snorm16[2] false {
            single: |x: [f32; 2]| halves(x.map(|x| snorm(f64::from(x), 32767.0) as u16)),
            double: |x: [f64; 2]| halves(x.map(|x| snorm(x, 32767.0) as u16)),
            interval: packed,
        }
        Unorm16[2] false {
            single: |x: [f32; 2]| halves(x.map(|x| unorm(f64::from(x), 65535.0) as u16)),
            double: |x: [f64; 2]| halves(x.map(|x| unorm(x, 65535.0) as u16)),
            interval: packed,
        }
        /// Packs two floats in half precision.
        Half2[2] false {
            single: |x: [f32; 2]| halves(x.map(|x| half::f16::from_f32(x).to_bits())),
            double: |x: [f64; 2]| halves(x.map(|x| half::f16::from_f64(x).to_bits())),
            interval: packed,
        }
    }
}

from_int_rules! {
    FromInt {
        /// The nearest float. In `f64` arithmetic, the result is exact. In interval arithmetic, the result begins and
        /// ends at the floats next to the integer, or at the integer itself if it is a float.
        Signed[1] {
            single: |x: u32| [x.cast_signed() as f32],
            double: |x: u32| [f64::from(x.cast_signed())],
            interval: |x: Range| [Interval::outwards(x.lo() as f64, x.hi() as f64)],
        }
        Unsigned[1] {
            single: |x: u32| [x as f32],
            double: |x: u32| [f64::from(x)],
            interval: |x: Range| [Interval::outwards(x.lo() as f64, x.hi() as f64)],
        }
        Bits[1] {
            single: |x: u32| [f32::from_bits(x)],
            double: |x: u32| [f64::from(f32::from_bits(x))],
            interval: |x: Range| [match x.word() {
                Some(word) => Interval::point(f32::from_bits(word)).flushed(),
                None => Interval::UNBOUNDED,
            }],
        }
        Snorm8[4] {
            single: |x: u32| x.to_le_bytes().map(|x| (f32::from(x.cast_signed()) / 127.0).max(-1.0)),
            double: |x: u32| x.to_le_bytes().map(|x| (f64::from(x.cast_signed()) / 127.0).max(-1.0)),
            interval: |x: Range| unpacked(x, |x| {
                x.to_le_bytes().map(|x| (f64::from(x.cast_signed()) / 127.0).max(-1.0))
            }),
        }
        Unorm8[4] {
            single: |x: u32| x.to_le_bytes().map(|x| f32::from(x) / 255.0),
            double: |x: u32| x.to_le_bytes().map(|x| f64::from(x) / 255.0),
            interval: |x: Range| unpacked(x, |x| x.to_le_bytes().map(|x| f64::from(x) / 255.0)),
        }
        Snorm16[2] {
            single: |x: u32| words(x).map(|x| (f32::from(x.cast_signed()) / 32767.0).max(-1.0)),
            double: |x: u32| words(x).map(|x| (f64::from(x.cast_signed()) / 32767.0).max(-1.0)),
            interval: |x: Range| unpacked(x, |x| {
                words(x).map(|x| (f64::from(x.cast_signed()) / 32767.0).max(-1.0))
            }),
        }
        Unorm16[2] {
            single: |x: u32| words(x).map(|x| f32::from(x) / 65535.0),
            double: |x: u32| words(x).map(|x| f64::from(x) / 65535.0),
            interval: |x: Range| unpacked(x, |x| words(x).map(|x| f64::from(x) / 65535.0)),
        }
        Half2[2] {
            single: |x: u32| words(x).map(|x| half::f16::from_bits(x).to_f32()),
            double: |x: u32| words(x).map(|x| half::f16::from_bits(x).to_f64()),
            interval: |x: Range| match x.word() {
                Some(word) => words(word).map(|x| {
                    let x = half::f16::from_bits(x);
                    let exact = Interval::point(x.to_f32());
                    // Subnormals of half precision may be flushed.
                    if x.is_normal() { exact } else { exact.join(Interval::point(0.0)) }
                }),
                None => [Interval::UNBOUNDED; 2],
            },
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scale {
    /// `x 2^i`.
    Ldexp,
}

mod scale {
    #[derive(Debug)]
    pub(super) struct Ldexp;
}

impl MixedRule for scale::Ldexp {
    fn single(x: f32, i: u32) -> f32 {
        libm::ldexpf(x, i.cast_signed())
    }
    fn double(x: f64, i: u32) -> f64 {
        libm::ldexp(x, i.cast_signed())
    }
    fn interval(x: Interval, i: Range) -> Interval {
        let (Some((lo, hi)), Some(word)) = (x.bounds(), i.word()) else {
            return Interval::UNBOUNDED;
        };
        let exponent = word.cast_signed();
        // Above 128, the specification leaves the result open.
        if exponent > 128 {
            return Interval::UNBOUNDED;
        }
        Interval::outwards(libm::ldexp(lo, exponent), libm::ldexp(hi, exponent))
    }
}

impl Scale {
    /// Applies the rule to all lanes. `registers` has the result, then the float, then the integer.
    pub(crate) fn run<A: Rules>(
        self,
        floats: &mut Columns<A::Float>,
        ints: &Columns<A::Int>,
        registers: &[u32],
    ) {
        let Self::Ldexp = self;
        let exponents = ints.get(registers[2]);
        floats.write(registers[0], |floats, out| {
            let x = floats.get(registers[1]);
            for (lane, out) in out.iter_mut().enumerate() {
                *out = A::mixed::<scale::Ldexp>(x[lane], exponents[lane]);
            }
        });
    }
}

impl ToInt {
    /// If the rule converts a number to an integer: the least and the greatest number of the integer type. `None` for
    /// all other rules, such as rules that return the bits of a float.
    pub(crate) fn holds(self) -> Option<(f64, f64)> {
        match self {
            Self::Signed => Some((f64::from(i32::MIN), f64::from(i32::MAX))),
            Self::Unsigned => Some((0.0, f64::from(u32::MAX))),
            _ => None,
        }
    }
}

/// WGSL converts to the nearest value that is in the integer type and also in `f32`. So 2^31 becomes 2147483520, the
/// greatest `f32` below 2^31. naga's back ends clamp to the same number.
fn saturate_signed(x: f64) -> i32 {
    x.clamp(-2_147_483_648.0, 2_147_483_520.0) as i32
}

fn saturate_unsigned(x: f64) -> u32 {
    x.clamp(0.0, 4_294_967_040.0) as u32
}

fn whole(x: Interval, f: impl Fn(f64) -> i64, signed: bool) -> Range {
    match x.bounds() {
        Some((lo, hi)) => Range::between(f(lo), f(hi)),
        None => Range::full(signed),
    }
}

fn bits(x: Interval, signed: bool) -> Range {
    if x.is_bounded() && x.lo().to_bits() == x.hi().to_bits() {
        Range::of_word(x.lo().to_bits(), signed)
    } else {
        Range::full(signed)
    }
}

fn exponent(x: f64) -> i32 {
    if x == 0.0 || !x.is_finite() { 0 } else { libm::frexp(x).1 }
}

/// `floor(0.5 + scale * clamp(x, -1, 1))`, as in the specification. NaN becomes 0.
fn snorm(x: f64, scale: f64) -> i32 {
    (0.5 + scale * x.clamp(-1.0, 1.0)).floor() as i32
}

fn unorm(x: f64, scale: f64) -> u32 {
    (0.5 + scale * x.clamp(0.0, 1.0)).floor() as u32
}

fn halves([low, high]: [u16; 2]) -> u32 {
    u32::from(low) | (u32::from(high) << 16)
}

fn words(x: u32) -> [u16; 2] {
    [x as u16, (x >> 16) as u16]
}

/// Returns the range of all words: packing may round up or down, so the bits of the result are unknown.
fn packed<const N: usize>(_: [Interval; N]) -> Range {
    Range::full(false)
}

/// Unpacks the components of a word by `f`, each with the error of 3 ulp that WGSL allows.
fn unpacked<const N: usize>(x: Range, f: impl Fn(u32) -> [f64; N]) -> [Interval; N] {
    let Some(word) = x.word() else {
        let most = Interval::normalized(1.0);
        return [Interval::normalized(-1.0).join(most); N];
    };
    f(word).map(Interval::normalized)
}
