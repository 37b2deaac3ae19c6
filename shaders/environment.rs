//! Twin of `environment.wgsl`: the light of the test scene and its cube map.

use std::f64::consts::FRAC_PI_2;

use glam::DVec3;

/// Faces in the order of WebGPU's array layers: +X, -X, +Y, -Y, +Z, -Z.
pub const FACES: usize = 6;

/// A procedural photo studio: radiance in linear RGB from `direction`, of any length but 0.
///
/// It holds what tells materials apart: broad dim light for the diffuse term, two soft boxes whose
/// edges blur with roughness, and a sun 50 times as bright as white for the range. Every edge is
/// smooth over several degrees, so that a cube map of 64 texels a side shows it without aliasing.
#[must_use]
pub fn studio(direction: DVec3) -> DVec3 {
    let d = direction.normalize();

    let wall = DVec3::new(0.27, 0.29, 0.32).lerp(DVec3::new(0.10, 0.11, 0.14), ramp(0.0, 1.0, d.y));
    let floor = DVec3::new(0.060, 0.052, 0.045);
    let room = floor.lerp(wall, ramp(-0.25, 0.05, d.y));

    let key = SoftBox {
        axis: DVec3::new(-0.70, 0.55, 0.60),
        half_width: 0.42,
        half_height: 0.30,
        radiance: DVec3::new(5.0, 4.8, 4.5),
    };
    let fill = SoftBox {
        axis: DVec3::new(0.90, 0.10, 0.35),
        half_width: 0.14,
        half_height: 0.75,
        radiance: DVec3::new(1.9, 2.2, 2.6),
    };
    room + key.seen_from_centre(d) + fill.seen_from_centre(d) + sun(d)
}

/// A warm lamp: radiance 50 at its centre, falling off softly to 0 at 16 degrees.
///
/// 64 directions on the hemisphere are about 18 degrees apart. A sun of a few degrees would fall
/// between them, and each diffuse sphere would show 64 copies of it.
fn sun(d: DVec3) -> DVec3 {
    let radiance = 50.0 * DVec3::new(1.0, 0.84, 0.62);
    let centre = DVec3::new(0.35, 0.75, 0.55).normalize();
    let angle = d.dot(centre).clamp(-1.0, 1.0).acos().to_degrees();
    radiance * (1.0 - ramp(0.0, 16.0, angle))
}

/// A rectangle of light at distance 1 along `axis`, facing the centre, upright.
struct SoftBox {
    axis: DVec3,
    half_width: f64,
    half_height: f64,
    radiance: DVec3,
}

impl SoftBox {
    /// How wide the edges are, at distance 1: about 4 degrees.
    const EDGE: f64 = 0.07;

    fn seen_from_centre(&self, d: DVec3) -> DVec3 {
        let axis = self.axis.normalize();
        let right = DVec3::Y.cross(axis).normalize();
        let up = axis.cross(right);
        let distance = d.dot(axis);
        if distance <= 0.0 {
            return DVec3::ZERO;
        }
        let inside = |offset: f64, half: f64| {
            1.0 - ramp(half - Self::EDGE, half + Self::EDGE, (offset / distance).abs())
        };
        self.radiance * inside(d.dot(right), self.half_width) * inside(d.dot(up), self.half_height)
    }
}

/// 0 up to `from`, 1 beyond `to`, a cosine in between: its slope is continuous.
fn ramp(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    (t * FRAC_PI_2).sin().powi(2)
}

/// The texels of a cube map, `size` a side: face by face, rows from the top, linear RGB and an
/// alpha of 1. Each texel holds `radiance` from its centre.
#[must_use]
pub fn cube_map(size: u32, radiance: impl Fn(DVec3) -> DVec3) -> Vec<[f32; 4]> {
    let centre = |texel: u32| (f64::from(texel) + 0.5) / f64::from(size);
    let mut texels = Vec::with_capacity(FACES * size as usize * size as usize);
    for face in 0..FACES {
        for row in 0..size {
            for column in 0..size {
                let direction = face_direction(face, centre(column), centre(row));
                let [r, g, b] = radiance(direction.normalize()).as_vec3().to_array();
                texels.push([r, g, b, 1.0]);
            }
        }
    }
    texels
}

/// The point of the cube of side 2 that a face's texture coordinates show: `u` from 0 at the left
/// to 1 at the right, `v` from 0 at the top to 1 at the bottom.
///
/// WebGPU takes the convention of Direct3D: seen from inside the cube, with Y up, faces appear
/// mirrored. (Vulkan 1.3, section 16.5.4, prints the same table.)
///
/// # Panics
///
/// If `face` isn't below 6.
#[must_use]
pub fn face_direction(face: usize, u: f64, v: f64) -> DVec3 {
    let (s, t) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    match face {
        0 => DVec3::new(1.0, -t, -s),
        1 => DVec3::new(-1.0, -t, s),
        2 => DVec3::new(s, 1.0, t),
        3 => DVec3::new(s, -1.0, -t),
        4 => DVec3::new(s, -t, 1.0),
        5 => DVec3::new(-s, -t, -1.0),
        _ => panic!("a cube has 6 faces, there is no face {face}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AXES: [DVec3; FACES] =
        [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z];

    /// From direction to (face, u, v), the way a sampler goes: Vulkan 1.3, tables of sections
    /// 16.5.4 and 16.5.5.
    fn look_up(r: DVec3) -> (usize, f64, f64) {
        let major = r.abs().max_element();
        let (face, s, t) = if r.x.abs() == major {
            if r.x > 0.0 { (0, -r.z, -r.y) } else { (1, r.z, -r.y) }
        } else if r.y.abs() == major {
            if r.y > 0.0 { (2, r.x, r.z) } else { (3, r.x, -r.z) }
        } else if r.z > 0.0 {
            (4, r.x, -r.y)
        } else {
            (5, -r.x, -r.y)
        };
        (face, 0.5 * (s / major + 1.0), 0.5 * (t / major + 1.0))
    }

    #[test]
    fn faces_look_along_the_axes() {
        for (face, axis) in AXES.into_iter().enumerate() {
            assert_eq!(face_direction(face, 0.5, 0.5), axis);
        }
    }

    #[test]
    fn faces_invert_the_look_up_of_a_sampler() {
        for face in 0..FACES {
            for (u, v) in [(0.1, 0.2), (0.9, 0.3), (0.4, 0.8)] {
                let (found, s, t) = look_up(face_direction(face, u, v));
                assert_eq!(found, face);
                assert!((s - u).abs() < 1e-15 && (t - v).abs() < 1e-15, "{face}");
            }
        }
    }

    #[test]
    fn sides_meet_at_their_edges() {
        // Walking right along the four upright faces goes round the cube: +X, -Z, -X, +Z.
        for v in [0.0, 0.3, 1.0] {
            for (left, right) in [(0, 5), (5, 1), (1, 4), (4, 0)] {
                assert_eq!(face_direction(left, 1.0, v), face_direction(right, 0.0, v));
            }
        }
    }

    #[test]
    fn texels_come_face_by_face_from_the_top_left() {
        let size = 4;
        let texels = cube_map(size, |direction| direction);
        assert_eq!(texels.len(), 96);
        for (face, axis) in AXES.into_iter().enumerate() {
            let first = face_direction(face, 0.125, 0.125).normalize().as_vec3();
            assert_eq!(texels[16 * face][..3], first.to_array());
            let [x, y, z, alpha] = texels[16 * face + 5];
            assert!(axis.dot(DVec3::new(x.into(), y.into(), z.into())) > 0.9);
            assert_eq!(alpha, 1.0);
        }
    }

    #[test]
    fn the_studio_is_positive_and_as_bright_as_said() {
        let texels = cube_map(32, studio);
        assert!(texels.iter().flatten().all(|value| *value > 0.0));
        let peak = studio(DVec3::new(0.35, 0.75, 0.55)).x;
        assert!((50.0..51.0).contains(&peak), "{peak}");
        assert_eq!(studio(DVec3::NEG_Y), DVec3::new(0.060, 0.052, 0.045));
    }

    #[test]
    fn the_studio_has_no_hard_edge() {
        // Along great circles in steps of 0.05 degrees. The steepest slope is the sun's, 50 times
        // pi/2 over 16 degrees or 4.9 a degree; no soft box adds more than 1.
        let step = 0.05_f64.to_radians();
        for tilt in 0..36 {
            let (sin, cos) = (f64::from(tilt) * 5.0).to_radians().sin_cos();
            let at = |i: i32| {
                let (s, c) = (f64::from(i) * step).sin_cos();
                studio(DVec3::new(c, s * sin, s * cos))
            };
            for i in 0..7200 {
                assert!((at(i + 1) - at(i)).abs().max_element() < 0.05 * 5.9, "{tilt}, {i}");
            }
        }
    }
}
