//! Directions and colours.

use std::f64::consts::TAU;

use glam::{DVec3, Vec3};

use super::{Domain, Emptiness, Source, shrink};

/// Unit vectors on the whole sphere. Their distribution is uniform, except that axes, poles and their close neighbours
/// occur more often. Components are rounded to `f32`, so lengths differ from 1 by up to 1e-7, as in a shader.
///
/// ```
/// use karat::{Domain, UnitVector};
///
/// let n = UnitVector.draw(&mut karat::unstable::domain::Source::new(1, 0)).unwrap();
/// assert!(n.is_normalized());
/// ```
#[derive(Clone, Copy, Debug)]
pub struct UnitVector;

/// Unit vectors with `z >= 0`. Their distribution is uniform, except that the pole, the horizon and their close
/// neighbours occur more often.
///
/// ```
/// use karat::{Domain, Hemisphere};
///
/// assert!(Hemisphere.edges().contains(&glam::Vec3::Z));
/// assert!(Hemisphere.edges().iter().all(|v| v.z >= 0.0));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Hemisphere;

/// Colours with each channel in `[0, 1]`. Greys, black, white, and shades of pure red, green or blue occur more often.
///
/// ```
/// use karat::{Domain, UnitRgb};
///
/// assert!(UnitRgb.edges().contains(&glam::Vec3::ONE));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct UnitRgb;

/// A bound for the error in the length of a unit vector: rounding the three components to `f32` causes a smaller error.
pub(super) const LENGTH: f64 = 2e-7;

const AXES: [Vec3; 6] = [Vec3::Z, Vec3::X, Vec3::Y, Vec3::NEG_Z, Vec3::NEG_X, Vec3::NEG_Y];

fn direction(cosine: f64, turn: f64) -> DVec3 {
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let (y, x) = (TAU * turn).sin_cos();
    DVec3::new(sine * x, sine * y, cosine)
}

impl Domain for UnitVector {
    type Value = Vec3;

    fn draw(&self, source: &mut Source) -> Option<Vec3> {
        let choice = source.bits();
        Some(match choice & 15 {
            0 => AXES[(choice >> 4) as usize % AXES.len()],
            1 | 2 => {
                // A direction close to the pole. A cyclic swap of its components turns it to any axis.
                let near = direction(1.0 - source.log_distance(), source.unit()).as_vec3();
                let near = if choice & 16 == 0 { near } else { -near };
                match (choice >> 5) % 3 {
                    0 => near,
                    1 => Vec3::new(near.z, near.x, near.y),
                    _ => Vec3::new(near.y, near.z, near.x),
                }
            }
            _ => direction(2.0 * source.unit() - 1.0, source.unit()).as_vec3(),
        })
    }

    fn edges(&self) -> Vec<Vec3> {
        AXES.to_vec()
    }

    fn admits(&self, value: &Vec3) -> Option<bool> {
        Some((value.as_dvec3().length() - 1.0).abs() < LENGTH)
    }

    /// Bounds slightly outside of -1 and 1, because rounding can make a vector slightly longer than 1.
    fn ends(&self) -> Option<(Vec3, Vec3)> {
        let most = Vec3::splat(1.0 + LENGTH as f32);
        Some((-most, most))
    }

    fn shrink(&self, value: &Vec3) -> Vec<Vec3> {
        shrink::directions(*value, |value| self.admits(&value) == Some(true))
    }
}

impl Domain for Hemisphere {
    type Value = Vec3;

    fn draw(&self, source: &mut Source) -> Option<Vec3> {
        let choice = source.bits();
        let cosine = match choice & 15 {
            0 if choice & 16 == 0 => return Some(Vec3::Z),
            0 => 0.0,
            1 | 2 => source.log_distance(),
            3 | 4 => 1.0 - source.log_distance(),
            _ => source.unit(),
        };
        Some(direction(cosine, source.unit()).as_vec3())
    }

    fn edges(&self) -> Vec<Vec3> {
        vec![Vec3::Z, Vec3::X, Vec3::Y, Vec3::NEG_X, Vec3::NEG_Y]
    }

    fn admits(&self, value: &Vec3) -> Option<bool> {
        UnitVector.admits(value).map(|unit| unit && value.z >= 0.0)
    }

    fn shrink(&self, value: &Vec3) -> Vec<Vec3> {
        shrink::directions(*value, |value| self.admits(&value) == Some(true))
    }
}

impl Hemisphere {
    /// Keeps only directions with `z` of at least `least`, which excludes grazing directions. `least` is a cosine from
    /// 0 to 1. The rim, the pole and their close neighbours occur more often than other directions.
    ///
    /// ```
    /// use karat::{Domain, Hemisphere};
    ///
    /// assert_eq!(Hemisphere.above(0.01).admits(&glam::Vec3::X), Some(false));
    /// ```
    pub fn above(self, least: f32) -> Above {
        Above { least }
    }
}

/// Unit vectors with `z` of at least a given cosine: see [`Hemisphere::above`].
///
/// ```
/// use karat::{Domain, Hemisphere};
///
/// // The light isn't grazing: z is at least 0.01.
/// let light = Hemisphere.above(0.01);
/// assert!(light.edges().iter().all(|l| l.z >= 0.0099));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Above {
    least: f32,
}

impl Above {
    /// The direction at an angle from +Z with this cosine, and with the azimuth `turn`. Rounding may move the direction
    /// to the rim, but not below the rim.
    fn direction(self, cosine: f64, turn: f64) -> Vec3 {
        let rounded = direction(cosine, turn).as_vec3();
        rounded.with_z(rounded.z.max(self.least))
    }
}

impl Domain for Above {
    type Value = Vec3;

    fn draw(&self, source: &mut Source) -> Option<Vec3> {
        if Domain::emptiness(self).is_some() {
            return None;
        }
        let choice = source.bits();
        let least = f64::from(self.least);
        let height = match choice & 15 {
            0 if choice & 16 == 0 => return Some(Vec3::Z),
            0 => 0.0,
            1 | 2 => source.log_distance(),
            3 | 4 => 1.0 - source.log_distance(),
            _ => source.unit(),
        };
        Some(self.direction(least + (1.0 - least) * height, source.unit()))
    }

    fn emptiness(&self) -> Option<Emptiness> {
        let fault = format!("needs a smallest cosine in 0..=1, not {}", self.least);
        (!(0.0..=1.0).contains(&self.least)).then(|| Emptiness::of("hemisphere", &fault))
    }

    fn edges(&self) -> Vec<Vec3> {
        let rim = |turn| self.direction(f64::from(self.least), turn);
        let mut edges = vec![Vec3::Z];
        if self.least < 1.0 {
            edges.extend([0.0, 0.25, 0.5, 0.75].map(rim));
        }
        edges
    }

    fn admits(&self, value: &Vec3) -> Option<bool> {
        UnitVector.admits(value).map(|unit| unit && value.z >= self.least)
    }

    fn shrink(&self, value: &Vec3) -> Vec<Vec3> {
        shrink::directions(*value, |value| self.admits(&value) == Some(true))
    }
}

impl Domain for UnitRgb {
    type Value = Vec3;

    fn draw(&self, source: &mut Source) -> Option<Vec3> {
        let range = 0.0..=1.0_f32;
        let choice = source.bits();
        Some(match choice & 7 {
            0 => Vec3::splat(range.draw(source)?),
            1 => Vec3::AXES[(choice >> 3) as usize % 3] * range.draw(source)?,
            _ => Vec3::new(range.draw(source)?, range.draw(source)?, range.draw(source)?),
        })
    }

    fn edges(&self) -> Vec<Vec3> {
        vec![Vec3::ZERO, Vec3::ONE, Vec3::X, Vec3::Y, Vec3::Z]
    }

    fn admits(&self, value: &Vec3) -> Option<bool> {
        Some(value.cmpge(Vec3::ZERO).all() && value.cmple(Vec3::ONE).all())
    }

    fn ends(&self) -> Option<(Vec3, Vec3)> {
        Some((Vec3::ZERO, Vec3::ONE))
    }

    fn shrink(&self, value: &Vec3) -> Vec<Vec3> {
        shrink::colours(*value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_have_unit_length_and_the_right_side() {
        for index in 0..10_000 {
            let v = UnitVector.draw(&mut Source::new(1, index)).expect("never rejects");
            assert!((v.as_dvec3().length() - 1.0).abs() < LENGTH, "{v}");
            let h = Hemisphere.draw(&mut Source::new(2, index)).expect("never rejects");
            assert!((h.as_dvec3().length() - 1.0).abs() < LENGTH && h.z >= 0.0, "{h}");
        }
    }

    #[test]
    fn grazing_directions_can_be_excluded() {
        for least in [0.0, 0.01, 0.5, 1.0_f32] {
            let domain = Hemisphere.above(least);
            let draws = (0..5_000).filter_map(|index| domain.draw(&mut Source::new(6, index)));
            let all: Vec<_> = draws.chain(domain.edges()).collect();
            assert!(all.len() > 5_000);
            for v in &all {
                assert_eq!(domain.admits(v), Some(true), "{v} above {least}");
            }
            assert!(all.iter().filter(|v| v.z < least + 1e-3).count() > 200, "{least}");
        }
        for nonsense in [-0.1, 1.1, f32::NAN] {
            let domain = Hemisphere.above(nonsense);
            assert!(domain.emptiness().is_some() && domain.draw(&mut Source::new(7, 0)).is_none());
        }
    }

    // Lesson 41
    #[test]
    fn grazing_and_polar_directions_are_common() {
        let draws: Vec<_> =
            (0..10_000).filter_map(|index| Hemisphere.draw(&mut Source::new(3, index))).collect();
        assert!(draws.iter().filter(|v| v.z < 1e-3).count() > 500);
        assert!(draws.iter().filter(|v| v.z > 1.0 - 1e-6).count() > 400);
    }

    #[test]
    fn drawn_colours_are_between_zero_and_one() {
        for index in 0..10_000 {
            let c = UnitRgb.draw(&mut Source::new(4, index)).expect("never rejects");
            assert!(c.cmpge(Vec3::ZERO).all() && c.cmple(Vec3::ONE).all());
        }
    }
}
