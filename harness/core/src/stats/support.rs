//! Supports: the sets on which densities are defined and from which samples come, with their coordinates.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::fmt;

/// The largest difference from 1 that the length of a direction may have, and the largest distance of a sample from the
/// unit disk. WGSL allows errors of 2^-11 for sin and cos, and a length has the errors of two such values.
const LENGTH: f64 = 1e-3;

/// The set on which a density is defined, with the measure that the density refers to.
///
/// ```
/// use karat::Support;
///
/// assert_eq!(Support::Hemisphere.components(), 3); // a sample is a vec3f
/// assert_eq!(Support::Interval(0.0, 1.0).components(), 1);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Support {
    /// Directions. The measure is the solid angle.
    Sphere,
    /// Directions with z >= 0. The measure is the solid angle.
    Hemisphere,
    /// Points of the unit disk. The measure is the area.
    Disk,
    /// Numbers from the first value to the second. A density must be finite at both ends, because Karat evaluates it
    /// there.
    Interval(f64, f64),
}

/// The position of a sample relative to a support.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// The sample is in the support, and has these coordinates.
    Inside([f64; 2]),
    /// The sample is outside of the support: below the horizon, outside of the disk, or beyond an end of the interval.
    Outside,
    /// The sample isn't a direction: its length isn't 1.
    NotUnit,
}

impl Support {
    /// The number of components of a sample: 3 for a direction, 2 for a point of the disk, 1 for a number.
    #[doc(hidden)]
    #[must_use]
    pub fn components(self) -> usize {
        match self {
            Self::Sphere | Self::Hemisphere => 3,
            Self::Disk => 2,
            Self::Interval(..) => 1,
        }
    }

    /// Checks if the support has only one coordinate.
    #[doc(hidden)]
    #[must_use]
    pub fn is_line(self) -> bool {
        matches!(self, Self::Interval(..))
    }

    /// The ranges of the two coordinates. The first coordinate is the angle from +Z for a direction, the radius for a
    /// point of the disk, and the number itself for an interval. The second coordinate is the azimuth, and unused for
    /// an interval.
    #[doc(hidden)]
    #[must_use]
    pub fn extent(self) -> [(f64, f64); 2] {
        match self {
            Self::Sphere => [(0.0, PI), (0.0, TAU)],
            Self::Hemisphere => [(0.0, FRAC_PI_2), (0.0, TAU)],
            Self::Disk => [(0.0, 1.0), (0.0, TAU)],
            Self::Interval(low, high) => [(low, high), (0.0, 1.0)],
        }
    }

    /// The position of a sample. The function reads only the first [`components`](Self::components) numbers of `point`.
    #[doc(hidden)]
    #[must_use]
    pub fn locate(self, point: [f64; 3]) -> Place {
        let [x, y, z] = point;
        let azimuth = || y.atan2(x).rem_euclid(TAU);
        let across = x.hypot(y);
        match self {
            Self::Sphere | Self::Hemisphere => {
                if !((across.hypot(z) - 1.0).abs() <= LENGTH) {
                    Place::NotUnit
                } else if self == Self::Hemisphere && z < 0.0 {
                    Place::Outside
                } else {
                    // Unlike the arc cosine of z, `atan2` is exact near +Z.
                    Place::Inside([across.atan2(z), azimuth()])
                }
            }
            Self::Disk if across <= 1.0 + LENGTH => Place::Inside([across, azimuth()]),
            Self::Interval(low, high) if (low..=high).contains(&x) => Place::Inside([x, 0.5]),
            Self::Disk | Self::Interval(..) => Place::Outside,
        }
    }

    /// The point at these coordinates, and the factor that converts areas in the coordinates to the support's measure
    /// near this point: `sin(a)` for a direction, `a` for a point of the disk, 1 for a number.
    #[doc(hidden)]
    #[must_use]
    pub fn point(self, [a, b]: [f64; 2]) -> ([f64; 3], f64) {
        let (sin_b, cos_b) = b.sin_cos();
        match self {
            Self::Sphere | Self::Hemisphere => {
                let (sin, cos) = a.sin_cos();
                ([sin * cos_b, sin * sin_b, cos], sin)
            }
            Self::Disk => ([a * cos_b, a * sin_b, 0.0], a),
            Self::Interval(..) => ([a, 0.0, 0.0], 1.0),
        }
    }
}

impl fmt::Display for Support {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sphere => f.write_str("the sphere"),
            Self::Hemisphere => f.write_str("the hemisphere"),
            Self::Disk => f.write_str("the unit disk"),
            Self::Interval(low, high) => write!(f, "[{low}, {high}]"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn locating_a_point_returns_its_coordinates() {
        for support in [Support::Sphere, Support::Hemisphere, Support::Disk] {
            let [(a0, a1), (b0, b1)] = support.extent();
            for (s, t) in [(0.01, 0.0), (1e-9, 0.3), (0.5, 0.999), (0.99, 0.6)] {
                let at = [a0 + s * (a1 - a0), b0 + t * (b1 - b0)];
                let Place::Inside(back) = support.locate(support.point(at).0) else {
                    panic!("{support} {at:?}")
                };
                assert!((back[0] - at[0]).abs() < 1e-14 && (back[1] - at[1]).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn directions_outside_the_support_differ_from_invalid_ones() {
        let down = [0.0, 0.6, -0.8];
        assert!(matches!(Support::Sphere.locate(down), Place::Inside(_)));
        assert_eq!(Support::Hemisphere.locate(down), Place::Outside);
        assert_eq!(Support::Hemisphere.locate([0.0, 0.6, 0.9]), Place::NotUnit);
        assert_eq!(Support::Sphere.locate([f64::NAN, 0.0, 1.0]), Place::NotUnit);
        assert_eq!(Support::Disk.locate([1.0, 0.2, 0.0]), Place::Outside);
        assert_eq!(Support::Interval(0.0, 1.0).locate([f64::NAN, 0.0, 0.0]), Place::Outside);
        assert_eq!(Support::Interval(0.0, 1.0).locate([1.0, 0.0, 0.0]), Place::Inside([1.0, 0.5]));
    }
}
