//! Directions and colours.

use std::f64::consts::TAU;

use glam::{DVec3, Vec3};

use super::{Domain, Source, shrink};

/// Unit vectors over the whole sphere: uniform, with axes, poles and their close neighbours
/// over-represented. Components are rounded to `f32`, so lengths differ from 1 by up to 1e-7, as
/// in a shader.
#[derive(Clone, Copy, Debug)]
pub struct UnitVector;

/// Unit vectors with `z >= 0`: uniform, with the pole, the horizon and their close neighbours
/// over-represented.
#[derive(Clone, Copy, Debug)]
pub struct Hemisphere;

/// Colours with each channel in `[0, 1]`: greys, single channels, black and white
/// over-represented.
#[derive(Clone, Copy, Debug)]
pub struct UnitRgb;

/// How far a length may be from 1: three components, each rounded to `f32`.
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
                // Close to an axis: the pole is turned onto it by a cyclic swap of components.
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
    fn grazing_and_polar_directions_are_common() {
        let draws: Vec<_> =
            (0..10_000).filter_map(|index| Hemisphere.draw(&mut Source::new(3, index))).collect();
        assert!(draws.iter().filter(|v| v.z < 1e-3).count() > 500);
        assert!(draws.iter().filter(|v| v.z > 1.0 - 1e-6).count() > 400);
    }

    #[test]
    fn colours_stay_in_the_cube() {
        for index in 0..10_000 {
            let c = UnitRgb.draw(&mut Source::new(4, index)).expect("never rejects");
            assert!(c.cmpge(Vec3::ZERO).all() && c.cmple(Vec3::ONE).all());
        }
    }
}
