//! Rules for angles. The bounds are from WGSL, "Floating Point Accuracy".

use super::float_rules;
use crate::interval::{Interval, ulp};

float_rules! {
    /// Functions of angles, and their inverses.
    Trigonometry {
        Sin[1, 1] = Sin {
            single: |[x]| [if x.abs() < MEDIUM { wave(x, 0) } else { libm::sinf(x) }],
            double: |[x]| [libm::sin(x)],
            interval: |[x]| [x.wave(false)],
        }
        Cos[1, 1] = Cos {
            single: |[x]| [if x.abs() < MEDIUM { wave(x, 1) } else { libm::cosf(x) }],
            double: |[x]| [libm::cos(x)],
            interval: |[x]| [x.wave(true)],
        }
        Tan[1, 1] = Tan {
            single: |[x]| [libm::tanf(x)],
            double: |[x]| [libm::tan(x)],
            interval: |[x]| [x.wave(false).div(x.wave(true))],
        }
        /// The error is at most 6.77e-5 (absolute), or at most the error of `atan2(x, sqrt(1 - x x))`, whichever is
        /// larger.
        Asin[1, 1] = Asin {
            single: |[x]| [libm::asinf(x)],
            double: |[x]| [libm::asin(x)],
            interval: |[x]| {
                let absolute = inside(x).monotonic(libm::asin, |_, _| 6.77e-5);
                [absolute.join(angle(x, opposite(x)))]
            },
        }
        /// The error is at most 6.77e-5 (absolute), or at most the error of `atan2(sqrt(1 - x x), x)`, whichever is
        /// larger.
        Acos[1, 1] = Acos {
            single: |[x]| [libm::acosf(x)],
            double: |[x]| [libm::acos(x)],
            interval: |[x]| {
                let absolute = inside(x).monotonic(libm::acos, |_, _| 6.77e-5);
                [absolute.join(angle(opposite(x), x))]
            },
        }
        Atan[1, 1] = Atan {
            single: |[x]| [libm::atanf(x)],
            double: |[x]| [libm::atan(x)],
            interval: |[x]| [x.monotonic(libm::atan, |_, y| 4096.0 * ulp(y))],
        }
        Atan2[2, 1] = Atan2 {
            single: |[y, x]| [libm::atan2f(y, x)],
            double: |[y, x]| [libm::atan2(y, x)],
            interval: |[y, x]| [angle(y, x)],
        }
        Radians[1, 1] = Radians {
            single: |[x]| [x * 0.017_453_292],
            double: |[x]| [x.to_radians()],
            interval: |[x]| [x.mul(Interval::outwards(1f64.to_radians(), 1f64.to_radians()))],
        }
        Degrees[1, 1] = Degrees {
            single: |[x]| [x * 57.295_78],
            double: |[x]| [x.to_degrees()],
            interval: |[x]| [x.mul(Interval::outwards(1f64.to_degrees(), 1f64.to_degrees()))],
        }
    }
}

/// The end of the range in which [`wave`] is accurate: 2^28 pi / 2, as in FreeBSD's `e_rem_pio2f.c`. For larger
/// numbers, two floats don't represent pi / 2 exactly enough.
const MEDIUM: f32 = f32::from_bits(0x4DC9_0FDB);

/// The sine of a number plus `quarters` quarter turns, within 0.51 ulp. As in libm, the range reduction and the
/// polynomials are those of FreeBSD's `sinf` and `cosf`. The code has no branches, because branch prediction would fail
/// for random angles.
#[inline(always)]
fn wave(x: f32, quarters: u64) -> f32 {
    // Adding this number rounds to an integer, which is in the last bits of the sum.
    const ROUNDING: f64 = 1.5 * (1u64 << 52) as f64;
    // The first 25 bits of pi / 2, and the remaining bits.
    const HALF_PI: [f64; 2] = [1.570_796_310_901_641_8, 1.589_325_477_352_819_7e-8];
    const SIN: [f64; 4] = [
        -0.166_666_666_416_265_24,
        0.008_333_329_385_889_463,
        -0.000_198_393_348_360_966_32,
        0.000_002_718_311_493_989_822,
    ];
    const COS: [f64; 4] = [
        -0.499_999_997_251_031,
        0.041_666_623_323_739_06,
        -0.001_388_676_377_460_993,
        0.000_024_390_448_796_277_41,
    ];
    let x = f64::from(x);
    let rounded = x * std::f64::consts::FRAC_2_PI + ROUNDING;
    let (whole, quarter) = (rounded - ROUNDING, rounded.to_bits().wrapping_add(quarters));
    let y = x - whole * HALF_PI[0] - whole * HALF_PI[1];
    let z = y * y;
    let of = |k: [f64; 4]| (k[0] + z * k[1]) + z * z * (k[2] + z * k[3]);
    let (sin, cos) = (y * (1.0 + z * of(SIN)), 1.0 + z * of(COS));
    let (odd, sign) = (0_u64.wrapping_sub(quarter & 1), (quarter & 2) << 62);
    f64::from_bits((sin.to_bits() & !odd | cos.to_bits() & odd) ^ sign) as f32
}

/// Returns `x` if the whole interval is in the domain of `asin` and `acos`, and otherwise an unbounded interval.
fn inside(x: Interval) -> Interval {
    if x.lo() >= -1.0 && x.hi() <= 1.0 { x } else { Interval::UNBOUNDED }
}

fn opposite(x: Interval) -> Interval {
    Interval::point(1.0).sub(x.mul(x)).sqrt()
}

/// The angle of the point (x, y), as in `atan2`. WGSL allows an error of 4096 ulp if the magnitude of x is from 2^-126
/// to 2^126 and y is normal.
fn angle(y: Interval, x: Interval) -> Interval {
    let (Some((a, b)), Some((c, d))) = (y.bounds(), x.bounds()) else {
        return Interval::UNBOUNDED;
    };
    let outside = |x: f64| x.abs() < 2f64.powi(-126) || x.abs() > 2f64.powi(126);
    if (c <= 0.0 && d >= 0.0) || outside(c) || outside(d) {
        return Interval::UNBOUNDED;
    }
    if a <= 0.0 && b >= 0.0 {
        // WGSL doesn't limit the error for zero and subnormals, so the result is unbounded if the interval contains
        // zero.
        return Interval::UNBOUNDED;
    }
    let corners = [libm::atan2(a, c), libm::atan2(a, d), libm::atan2(b, c), libm::atan2(b, d)];
    let lo = corners.iter().copied().fold(f64::INFINITY, f64::min);
    let hi = corners.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let error = 4096.0 * ulp(lo.abs().max(hi.abs()));
    Interval::outwards(lo - error, hi + error)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tests each exponent and sign, and all floats near multiples of pi / 2.
    #[test]
    fn sine_and_cosine_agree_with_double_precision() {
        let near = (1..100_000_u32).flat_map(|k| {
            let x = (f64::from(k) * std::f64::consts::FRAC_PI_2) as f32;
            [x.next_down(), x, x.next_up()]
        });
        let spread = (0..1u32 << 20).map(|k| f32::from_bits(k.wrapping_mul(0x9E37_79B9)));
        let both = near.chain(spread).flat_map(|x| [x, -x]);
        let mut worst: f64 = 0.0;
        for x in both.filter(|x| x.abs() < MEDIUM) {
            for (found, exact) in
                [(wave(x, 0), f64::from(x).sin()), (wave(x, 1), f64::from(x).cos())]
            {
                worst = worst.max((f64::from(found) - exact).abs() / ulp(exact));
            }
        }
        assert!(worst > 0.49 && worst < 0.51, "off by {worst} ulp");
        assert_eq!(wave(-0.0, 0).to_bits(), (-0.0_f32).to_bits());
        assert_eq!((wave(0.0, 0).to_bits(), wave(0.0, 1)), (0, 1.0));
    }
}
