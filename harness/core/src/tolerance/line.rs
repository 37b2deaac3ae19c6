//! The ordered line of all `f32`, measured in steps.

/// The number of `f32` steps between two values. `None` if one of the values is NaN.
///
/// `-0` and `+0` are the same point. Each step to a neighbouring `f32` counts as 1, also at zero and at powers of two.
///
/// ```
/// assert_eq!(karat::unstable::tolerance::ulp_distance(-0.0, 0.0), Some(0));
/// assert_eq!(karat::unstable::tolerance::ulp_distance(-f32::from_bits(1), f32::from_bits(1)), Some(2));
/// assert_eq!(karat::unstable::tolerance::ulp_distance(f32::MAX, f32::INFINITY), Some(1));
/// assert_eq!(karat::unstable::tolerance::ulp_distance(f32::NAN, f32::NAN), None);
/// ```
#[must_use]
pub fn ulp_distance(a: f32, b: f32) -> Option<u64> {
    let ordered = |value: f32| {
        let magnitude = i64::from(value.to_bits() & 0x7fff_ffff);
        if value.is_sign_negative() { -magnitude } else { magnitude }
    };
    (!a.is_nan() && !b.is_nan()).then(|| ordered(a).abs_diff(ordered(b)))
}

/// The position of a real number on the ordered line of `f32`. Halfway between the third and the fourth `f32` above
/// zero, the position is 3.5. Beyond `f32::MAX`, the steps keep the size of the last step.
pub(super) fn ordinal(value: f64) -> f64 {
    let magnitude = value.abs();
    #[expect(clippy::cast_possible_truncation, reason = "rounds to the nearest f32, by design")]
    let mut below = (magnitude as f32).min(f32::MAX);
    if f64::from(below) > magnitude {
        below = below.next_down();
    }
    let step = spacing(f64::from(below));
    let index = f64::from(below.to_bits()) + (magnitude - f64::from(below)) / step;
    if value < 0.0 { -index } else { index }
}

/// The distance from the `f32` at `magnitude` to the next larger `f32`.
pub(super) fn spacing(magnitude: f64) -> f64 {
    #[expect(clippy::cast_possible_truncation, reason = "the binade of the nearest f32 is meant")]
    let value = (magnitude.abs() as f32).min(f32::MAX);
    // The exponent field of an `f32` is e + 127. A normal number has the step 2^(e - 23), and a denormal has the step
    // 2^-149. The exponent field of an `f64` is e + 1023, and is set directly, because `exp2` would take as long as all
    // the rest.
    let exponent = (value.to_bits() >> 23).max(1);
    f64::from_bits(u64::from(exponent + 1023 - 150) << 52)
}

/// The distance between two neighbouring `f32` in the binade of `magnitude`. Above this binade, neighbours are at least
/// this far apart. Unlike [`spacing`], the function doesn't round `magnitude` first, and its result has no minimum.
#[inline]
pub(super) fn least_spacing(magnitude: f64) -> f64 {
    // A number without its 52 fraction bits is its binade's power of two.
    let binade = magnitude.min(f64::from(f32::MAX)).to_bits() >> 52 << 52;
    f64::from_bits(binade) * f64::from(f32::EPSILON)
}
