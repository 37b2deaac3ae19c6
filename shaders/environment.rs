//! Rust counterpart of `environment.wgsl`: the light of the test scene and its cube map.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DVec2, DVec3, Vec2};

/// The number of a cube map's faces. They have the order of WebGPU's array layers: +X, -X, +Y, -Y, +Z, -Z.
pub const FACES: usize = 6;

/// Returns the radiance of a procedural photo studio, in linear RGB, from `direction`. `direction` may have any length
/// except 0.
///
/// The studio has features that distinguish materials: broad dim light for the diffuse term, two soft boxes with edges
/// that blur with roughness, and a sun 50 times as bright as white, for a large dynamic range. Each edge fades over
/// several degrees, so a cube map with faces of 64 x 64 texels shows the edges without aliasing.
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

/// The sun's radiance, which has a warm colour. The red channel is 50 at the sun's centre, and falls smoothly to 0 at
/// 16 degrees from the centre.
///
/// If a shader samples 64 directions on the hemisphere, they are about 18 degrees apart. A sun of a few degrees would
/// fit between two of these directions. Then only a few points of a diffuse sphere would have a direction that hits the
/// sun, and the sphere would show up to 64 bright spots instead of smooth light.
fn sun(d: DVec3) -> DVec3 {
    let radiance = 50.0 * DVec3::new(1.0, 0.84, 0.62);
    let centre = DVec3::new(0.35, 0.75, 0.55).normalize();
    let angle = d.dot(centre).clamp(-1.0, 1.0).acos().to_degrees();
    radiance * (1.0 - ramp(0.0, 16.0, angle))
}

/// An upright rectangle of light at distance 1 along `axis`. It faces the centre.
struct SoftBox {
    axis: DVec3,
    half_width: f64,
    half_height: f64,
    radiance: DVec3,
}

impl SoftBox {
    /// Half the width of an edge's ramp at distance 1: about 4 degrees.
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

/// A ramp from 0 at `from` to 1 at `to`. The ramp has the form of a cosine, so its slope is continuous.
fn ramp(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    (t * FRAC_PI_2).sin().powi(2)
}

/// Returns the texels of a cube map with faces `size` texels wide: face by face, with rows from the top, in linear RGB
/// with an alpha of 1. Each texel has the `radiance` from the direction of its centre.
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

/// Returns the point at the texture coordinates `u` and `v` of a face, on the surface of the cube of side 2. `u` goes
/// from 0 at the left to 1 at the right, and `v` from 0 at the top to 1 at the bottom.
///
/// WebGPU uses the convention of Direct3D: seen from inside the cube, with Y up, faces appear mirrored. (Vulkan 1.3,
/// section 16.5.4, has the same table.)
///
/// # Panics
///
/// Panics if `face` isn't below 6.
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

karat::shareable! {
    /// A point on a cube's surface.
    pub struct FacePoint mirrors FacePointMirror {
        /// The number of the face, below 6.
        face: u32,
        /// The position on the face, from the top left, in 0..=1.
        uv: Vec2,
    }
}

/// Converts a direction to a face and a position on it, as a sampler does: by the table in Vulkan 1.3, section 16.5.4,
/// and the equations in 16.5.5. On an edge between two faces, the Z face takes precedence over Y, and Y over X.
#[must_use]
pub fn face_point(r: DVec3) -> FacePointMirror {
    let major = r.abs().max_element();
    let (face, s, t) = if r.z == major {
        (4, r.x, -r.y)
    } else if r.z == -major {
        (5, -r.x, -r.y)
    } else if r.y == major {
        (2, r.x, r.z)
    } else if r.y == -major {
        (3, r.x, -r.z)
    } else if r.x == major {
        (0, -r.z, -r.y)
    } else {
        (1, r.z, -r.y)
    };
    FacePointMirror { face, uv: 0.5 * (DVec2::new(s, t) / major + DVec2::ONE) }
}

/// Converts a direction to texture coordinates as OpenEXR's ImfEnvmap.h does. Longitude falls from pi at u = 0 to -pi
/// at u = 1, and latitude from pi / 2 at v = 0 to -pi / 2 at v = 1. The poles have longitude 0.
#[must_use]
pub fn equirectangular_uv(direction: DVec3) -> DVec2 {
    let d = direction.normalize();
    let longitude = if d.x == 0.0 && d.z == 0.0 { 0.0 } else { d.x.atan2(d.z) };
    DVec2::new((PI - longitude) / TAU, d.y.acos() / PI)
}

/// Converts texture coordinates to a direction as OpenEXR's ImfEnvmap.h does: (sin longitude cos latitude, sin
/// latitude, cos longitude cos latitude).
#[must_use]
pub fn equirectangular_direction(uv: DVec2) -> DVec3 {
    let (longitude, latitude) = (PI * (1.0 - 2.0 * uv.x), PI * (0.5 - uv.y));
    DVec3::new(longitude.sin() * latitude.cos(), latitude.sin(), longitude.cos() * latitude.cos())
}

/// Returns the vector from `centre` to the point at which a ray leaves a box. As in Kay and Kajiya 1986, a box is the
/// intersection of three slabs, so the ray leaves the box at the first point where it leaves one of the slabs.
///
/// `position` and `centre` are in the box. A ray parallel to a slab never leaves the slab.
#[must_use]
pub fn parallax_box(
    position: DVec3,
    direction: DVec3,
    centre: DVec3,
    low: DVec3,
    high: DVec3,
) -> DVec3 {
    let mut leave = f64::INFINITY;
    for axis in (0..3).filter(|axis| direction[*axis] != 0.0) {
        let one = (low[axis] - position[axis]) / direction[axis];
        let other = (high[axis] - position[axis]) / direction[axis];
        leave = leave.min(one.max(other));
    }
    position + leave * direction - centre
}

/// Returns the vector from `centre` to the point at which a ray leaves a sphere: q + t d, where q = position - centre.
/// t is the greater solution of (d.d) t^2 + 2 (q.d) t + q.q - r^2 = 0. `position` is in the sphere.
#[must_use]
pub fn parallax_sphere(position: DVec3, direction: DVec3, centre: DVec3, radius: f64) -> DVec3 {
    let q = position - centre;
    let (a, b) = (direction.dot(direction), 2.0 * q.dot(direction));
    let c = q.dot(q) - radius * radius;
    q + (-b + (b * b - 4.0 * a * c).sqrt()) / (2.0 * a) * direction
}

/// Computes the level of Krivanek and Colbert 2008: max(0, 1/2 log2(Omega_s / Omega_p)). A sample covers Omega_s = 1 /
/// (N pdf) sr, and a texel covers Omega_p = 4 pi / (6 size^2) sr on average.
#[must_use]
pub fn mip_level(pdf: f64, samples: u32, size: u32) -> f64 {
    let sample = 1.0 / (f64::from(samples) * pdf);
    let texel = 4.0 * PI / (6.0 * f64::from(size).powi(2));
    (0.5 * (sample / texel).log2()).max(0.0)
}

/// Returns an environment of radiance 1 + slope . d: a constant and the first band of spherical harmonics. The length
/// of `slope` is at most 1.
pub fn linear(slope: DVec3) -> impl Fn(DVec3) -> DVec3 {
    move |d| DVec3::splat(1.0 + slope.dot(d))
}

/// Returns an environment that is white on the side of `axis` and black on the opposite side.
pub fn half_sky(axis: DVec3) -> impl Fn(DVec3) -> DVec3 {
    move |d| DVec3::splat(if axis.dot(d) >= 0.0 { 1.0 } else { 0.0 })
}

/// Returns a black sky with a sun around the unit vector `axis`. `half_angle` is the sun's angular radius in radians. A
/// surface that faces the sun gets the irradiance pi, the same as from a white sky.
pub fn small_sun(axis: DVec3, half_angle: f64) -> impl Fn(DVec3) -> DVec3 {
    // The radiance is pi / int cos dw = pi / (pi sin^2).
    let radiance = half_angle.sin().powi(-2);
    move |d| DVec3::splat(if axis.dot(d) >= half_angle.cos() { radiance } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    const AXES: [DVec3; FACES] =
        [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z];

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
                let found = face_point(7.0 * face_direction(face, u, v));
                assert_eq!(found.face as usize, face);
                assert!(found.uv.abs_diff_eq(DVec2::new(u, v), 1e-15), "{face}");
            }
        }
    }

    #[test]
    fn sides_meet_at_their_edges() {
        // The four upright faces, from left to right, surround the cube: +X, -Z, -X, +Z.
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
        // The test follows great circles in steps of 0.05 degrees. The sun has the steepest slope: 50 times pi/2 over
        // 16 degrees, or 4.9 per degree. No soft box adds more than 1.
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

    #[test]
    fn edges_belong_to_z_then_y() {
        assert_eq!(face_point(DVec3::ONE).face, 4);
        assert_eq!(face_point(DVec3::NEG_ONE).face, 5);
        assert_eq!(face_point(DVec3::new(-1.0, 1.0, 0.5)).face, 2);
        assert_eq!(face_point(DVec3::new(1.0, -1.0, 0.5)).face, 3);
    }

    #[test]
    fn latitude_and_longitude_are_where_openexr_has_them() {
        let cases = [
            (DVec3::Z, 0.5, 0.5),
            (DVec3::X, 0.25, 0.5),
            (DVec3::NEG_X, 0.75, 0.5),
            (DVec3::Y, 0.5, 0.0),
            (DVec3::NEG_Y, 0.5, 1.0),
            (DVec3::NEG_Z, 0.0, 0.5),
            (DVec3::new(-0.0, 0.0, -1.0), 1.0, 0.5),
        ];
        for (direction, u, v) in cases {
            let uv = equirectangular_uv(direction);
            assert!(uv.abs_diff_eq(DVec2::new(u, v), 1e-15), "{direction}: {uv}");
            assert!(equirectangular_direction(uv).abs_diff_eq(direction, 1e-15), "{direction}");
        }
        let tilted = DVec3::new(0.36, -0.48, -0.8);
        assert!(equirectangular_direction(equirectangular_uv(tilted)).abs_diff_eq(tilted, 1e-15));
    }

    const LOW: DVec3 = DVec3::new(-2.0, -1.0, -3.0);
    const HIGH: DVec3 = DVec3::new(1.0, 1.5, 2.0);
    const CENTRE: DVec3 = DVec3::new(-0.2, 0.3, 0.1);

    #[test]
    fn parallax_ends_on_the_wall_ahead() {
        let position = DVec3::new(0.5, -0.7, 1.2);
        for axis in AXES {
            let seen = CENTRE + parallax_box(position, axis, CENTRE, LOW, HIGH);
            let wall = if axis.dot(DVec3::ONE) > 0.0 { HIGH } else { LOW };
            let expected = position + axis * axis.dot(wall - position);
            assert!(seen.abs_diff_eq(expected, 1e-15), "{axis}: {seen}");

            let seen = parallax_sphere(position, axis, CENTRE, 4.0);
            assert!((seen.length() - 4.0).abs() < 1e-14);
            assert!((CENTRE + seen - position).normalize().abs_diff_eq(axis, 1e-15));
        }
        // The rays start in a wall: one along the wall, one out of the room.
        let wall = DVec3::new(HIGH.x, 0.0, 0.0);
        let up = CENTRE + parallax_box(wall, DVec3::Y, CENTRE, LOW, HIGH);
        assert!(up.abs_diff_eq(DVec3::new(HIGH.x, HIGH.y, 0.0), 1e-15));
        assert!((CENTRE + parallax_box(wall, DVec3::X, CENTRE, LOW, HIGH)).distance(wall) < 1e-15);
    }

    #[test]
    fn parallax_vanishes_at_the_centre() {
        let d = DVec3::new(0.36, -0.48, -0.8);
        let seen = parallax_box(CENTRE, d, CENTRE, LOW, HIGH).normalize();
        assert!(seen.abs_diff_eq(d, 1e-15));
        assert!(parallax_sphere(CENTRE, d, CENTRE, 3.0).abs_diff_eq(3.0 * d, 1e-14));
    }

    #[test]
    fn parallax_is_continuous() {
        // The test follows a great circle through all walls, in steps of 0.01 degrees. The hit point moves by less than
        // 65 per radian: the longest way (4.4), divided by the cosine at which the ray meets a wall. This cosine is the
        // distance to the wall, at least 0.3, divided by the way.
        let position = DVec3::new(0.5, -0.7, 1.2);
        let step = 0.01_f64.to_radians();
        let at = |i: i32| {
            let (sin, cos) = (f64::from(i) * step).sin_cos();
            let d = DVec3::new(0.6 * cos, sin, 0.8 * cos);
            [
                parallax_box(position, d, CENTRE, LOW, HIGH),
                parallax_sphere(position, d, CENTRE, 4.0),
            ]
        };
        for i in 0..36_000 {
            for (here, next) in at(i).into_iter().zip(at(i + 1)) {
                assert!(here.distance(next) < 65.0 * step, "{i}: {here} {next}");
            }
        }
    }

    #[test]
    fn a_sample_as_large_as_a_texel_takes_the_first_level() {
        let texel = 4.0 * PI / (6.0 * 64.0 * 64.0);
        assert!(mip_level(1.0 / texel, 1, 64).abs() < 1e-12);
        // Four texels cover one texel of the next level. An area below one texel gives level 0.
        assert!((mip_level(0.25 / texel, 1, 64) - 1.0).abs() < 1e-12);
        assert!((mip_level(0.25 / texel, 16, 64)).abs() < 1e-12);
        // One sample for the whole sphere averages six texels, so its level is log4(6) below the level with one texel.
        assert!((mip_level(1.0 / (4.0 * PI), 1, 64) - 6.0 - 0.5 * 6.0_f64.log2()).abs() < 1e-12);
    }

    #[test]
    fn levels_fall_as_densities_rise() {
        let level = |i: i32| mip_level(1.01_f64.powi(i), 32, 64);
        for i in -1000..1000 {
            assert!(level(i + 1) <= level(i), "{i}");
        }
        assert!(level(-1000) > 10.0 && level(1000) == 0.0);
    }

    #[test]
    fn the_small_sun_is_as_bright_as_a_white_sky() {
        // The expected result is int L cos dw over the cap, from the angle to its axis.
        let half_angle = 0.1;
        let sun = small_sun(DVec3::Z, half_angle);
        let n = 10_000;
        let irradiance: f64 = (0..n)
            .map(|i| (f64::from(i) + 0.5) / f64::from(n) * half_angle)
            .map(|t| TAU * sun(DVec3::new(t.sin(), 0.0, t.cos())).x * t.cos() * t.sin())
            .sum::<f64>()
            * half_angle
            / f64::from(n);
        assert!((irradiance - PI).abs() < 1e-8, "{irradiance}");
    }
}
