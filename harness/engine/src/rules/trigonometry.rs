//! Angles. Bounds: WGSL, "Floating Point Accuracy".

use super::float_rules;
use crate::interval::{Interval, ulp};

float_rules! {
    /// Angles.
    Trigonometry {
        Sin[1, 1] = Sin {
            single: |[x]| [libm::sinf(x)],
            double: |[x]| [libm::sin(x)],
            interval: |[x]| [x.wave(false)],
        }
        Cos[1, 1] = Cos {
            single: |[x]| [libm::cosf(x)],
            double: |[x]| [libm::cos(x)],
            interval: |[x]| [x.wave(true)],
        }
        Tan[1, 1] = Tan {
            single: |[x]| [libm::tanf(x)],
            double: |[x]| [libm::tan(x)],
            interval: |[x]| [x.wave(false).div(x.wave(true))],
        }
        /// The worse of an absolute 6.77e-5 and atan2(x, sqrt(1 - x x)).
        Asin[1, 1] = Asin {
            single: |[x]| [libm::asinf(x)],
            double: |[x]| [libm::asin(x)],
            interval: |[x]| {
                let absolute = inside(x).monotonic(libm::asin, |_, _| 6.77e-5);
                [absolute.join(angle(x, opposite(x)))]
            },
        }
        /// The worse of an absolute 6.77e-5 and atan2(sqrt(1 - x x), x).
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

/// `x` where arcs are defined on all of it.
fn inside(x: Interval) -> Interval {
    if x.lo() >= -1.0 && x.hi() <= 1.0 { x } else { Interval::UNBOUNDED }
}

/// sqrt(1 - x x).
fn opposite(x: Interval) -> Interval {
    Interval::point(1.0).sub(x.mul(x)).sqrt()
}

/// 4096 ulp, where x is of magnitude 2^-126 to 2^126 and y is normal.
fn angle(y: Interval, x: Interval) -> Interval {
    let (Some((a, b)), Some((c, d))) = (y.bounds(), x.bounds()) else {
        return Interval::UNBOUNDED;
    };
    let outside = |x: f64| x.abs() < 2f64.powi(-126) || x.abs() > 2f64.powi(126);
    if (c <= 0.0 && d >= 0.0) || outside(c) || outside(d) {
        return Interval::UNBOUNDED;
    }
    if a <= 0.0 && b >= 0.0 {
        // Zero and subnormals have no bound, so no interval about zero has one.
        return Interval::UNBOUNDED;
    }
    let corners = [libm::atan2(a, c), libm::atan2(a, d), libm::atan2(b, c), libm::atan2(b, d)];
    let lo = corners.iter().copied().fold(f64::INFINITY, f64::min);
    let hi = corners.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let error = 4096.0 * ulp(lo.abs().max(hi.abs()));
    Interval::outwards(lo - error, hi + error)
}
