//! Rules for whole parts, fractions and exponents of floats.

use super::{Half, float_rules};
use crate::interval::Interval;

float_rules! {
    /// Whole parts, fractions and exponents.
    Rounding {
        Floor[1, 1] = Floor {
            single: |[x]| [x.floor()],
            double: |[x]| [x.floor()],
            interval: |[x]| [stepped(x, f64::floor)],
        }
        Ceil[1, 1] = Ceil {
            single: |[x]| [x.ceil()],
            double: |[x]| [x.ceil()],
            interval: |[x]| [stepped(x, f64::ceil)],
        }
        /// Rounds to the nearest integer. Ties round to the even integer: 2.5 becomes 2.
        Round[1, 1] = Round {
            single: |[x]| [x.round_ties_even()],
            double: |[x]| [x.round_ties_even()],
            interval: |[x]| [stepped(x, f64::round_ties_even)],
        }
        Trunc[1, 1] = Trunc {
            single: |[x]| [x.trunc()],
            double: |[x]| [x.trunc()],
            interval: |[x]| [stepped(x, f64::trunc)],
        }
        /// `x - floor(x)`. For x just below zero, the result rounds to 1.
        Fract[1, 1] = Fract {
            single: |[x]| [x - x.floor()],
            double: |[x]| [x - x.floor()],
            interval: |[x]| {
                // If all values of the interval have the same floor, the fraction is x minus this floor.
                let floor = stepped(x, f64::floor);
                let fraction = x.sub(floor);
                [if floor.is_bounded() && floor.lo() != floor.hi() {
                    x.with_slack(0.0, 1.0)
                } else {
                    fraction
                }]
            },
        }
        /// `x - trunc(x)`, the fraction of `modf`.
        Fraction[1, 1] {
            single: |[x]| [if x.is_infinite() { 0.0f32.copysign(x) } else { x - x.trunc() }],
            double: |[x]| [if x.is_infinite() { 0.0f64.copysign(x) } else { x - x.trunc() }],
            interval: |[x]| {
                let whole = stepped(x, f64::trunc);
                [if whole.is_bounded() && whole.lo() != whole.hi() {
                    x.with_slack(-1.0, 1.0)
                } else {
                    x.sub(whole)
                }]
            },
        }
        /// The fraction of `frexp`. Its magnitude is in [0.5, 1), or zero.
        Mantissa[1, 1] {
            single: |[x]| [libm::frexpf(x).0],
            double: |[x]| [libm::frexp(x).0],
            interval: |[x]| [mantissa(x)],
        }
        /// Rounds to half precision: to the nearest number, and ties to even. A number outside of the range becomes
        /// infinite.
        Quantize[1, 1] = QuantizeToF16 {
            single: |[x]| [half::f16::from_f32(x).to_f32()],
            double: |[x]| [half::f16::from_f64(x).to_f64()],
            interval: |[x]| [x.halved(Half::Rounded)],
        }
    }
}

fn stepped(x: Interval, f: impl Fn(f64) -> f64) -> Interval {
    match x.bounds() {
        Some((lo, hi)) => Interval::outwards(f(lo), f(hi)),
        None => Interval::UNBOUNDED,
    }
}

fn mantissa(x: Interval) -> Interval {
    match x.bounds() {
        Some((lo, hi)) if lo == hi => Interval::outwards(libm::frexp(lo).0, libm::frexp(lo).0),
        Some(_) => Interval::between(-1.0, 1.0),
        None => Interval::UNBOUNDED,
    }
}
