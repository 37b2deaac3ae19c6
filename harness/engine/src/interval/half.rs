//! Bounds of results in half precision.

use super::chain::{exponent, power};
use super::{Interval, REORDERED};
use crate::rules::Half;

pub(super) const GREATEST: f64 = 65_504.0;

/// The exponent of the least normal `f16`. `LEAST_STEP` is the exponent of the least subnormal `f16`.
pub(super) const LEAST_NORMAL: i16 = -14;
pub(super) const LEAST_STEP: i16 = -24;

impl Interval {
    /// The half-precision values that a result may have if its exact value is in this interval. `how` is the error that
    /// the operation may have.
    pub(crate) fn halved(self, how: Half) -> Self {
        let Some((lo, hi)) = self.bounds() else { return self };
        let normal = power(LEAST_NORMAL);
        // Above the next power of two, errors are twice as large, and may reach further than the error at the end.
        let by = |ulps: f64| Self::rounded(lo - ulps * ulp(2.0 * lo), hi + ulps * ulp(2.0 * hi));
        match how {
            Half::Rounded | Half::Converted | Half::Operand => Self::rounded(lo, hi),
            Half::Chained(roundings) => {
                let Some((below, above)) = self.chain.in_half((lo, hi), roundings) else {
                    let written = Self::rounded(lo, hi);
                    let cause = if written.is_bounded() { REORDERED } else { 0 };
                    return Self { cause, ..Self::UNBOUNDED };
                };
                let bounds = Self::rounded(below.min(lo), above.max(hi));
                if bounds.is_bounded() { Self { chain: self.chain, ..bounds } } else { bounds }
            }
            Half::Ulps(ulps) => by(f64::from(ulps)),
            Half::Length(components) => {
                // `ulps` covers half of the relative error of a sum of rounded squares, and the rounding of the root.
                // `steps` covers an error of one step for each subnormal square.
                let steps = f64::from(components) * power(LEAST_STEP);
                let hi = (hi * hi + steps).sqrt();
                let ulps = f64::from(components) + 6.0;
                // Each square below 2^-14 may be flushed to 0.
                let lo = (lo * lo - f64::from(components) * normal).max(0.0).sqrt();
                let bounds = Self::rounded(lo - ulps * ulp(2.0 * lo), hi + ulps * ulp(2.0 * hi));
                // The sum of squares overflows if the length is above the square root of 65504. Rounding errors make
                // this limit smaller.
                if hi > 250.0 { Self::UNBOUNDED } else { bounds }
            }
            Half::Power => {
                let error = |y: f64| {
                    let x = y.abs().max(power(LEAST_STEP)).log2().abs();
                    (1.0 + 2.0 * x) * ulp(2.0 * y)
                };
                // If the result is 0, the argument may be any number down to -65504.
                let any = (1.0 + 2.0 * GREATEST) * power(LEAST_STEP);
                let more = if lo < power(LEAST_STEP) { any } else { 0.0 };
                Self::rounded((lo - error(lo)).max(0.0), hi + error(hi).max(more))
            }
            Half::Logarithm => {
                let error = |y: f64| (3.0 * ulp(2.0 * y)).max(1.0 / 128.0 /* 2^-7 */);
                Self::rounded(lo - error(lo), hi + error(hi))
            }
            Half::Wave => Self::rounded(lo - 1.0 / 128.0, hi + 1.0 / 128.0),
        }
    }

    /// The interval with the bounds `lo` and `hi`, rounded outwards to `f16`. If one of its values is subnormal, the
    /// interval also contains zero, because an implementation may flush subnormals.
    fn rounded(lo: f64, hi: f64) -> Self {
        let (lo, hi) = (outwards(lo, -1.0), outwards(hi, 1.0));
        if !(lo.abs() <= GREATEST && hi.abs() <= GREATEST) {
            return Self::UNBOUNDED;
        }
        let normal = power(LEAST_NORMAL);
        let lo = if lo > 0.0 && lo < normal { 0.0 } else { lo };
        let hi = if hi < 0.0 && hi > -normal { 0.0 } else { hi };
        // Each `f16` is also an `f32`.
        Self::between(lo as f32, hi as f32)
    }
}

fn ulp(x: f64) -> f64 {
    power(exponent(x).max(LEAST_NORMAL) - 10)
}

/// Rounds `x` up to a multiple of an `f16` ulp, or down if `sign` is -1.
fn outwards(x: f64, sign: f64) -> f64 {
    let step = ulp(x);
    sign * (sign * x / step).ceil() * step
}
