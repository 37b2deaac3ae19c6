//! Rust counterpart of `scene.wgsl`: the spheres, materials and cameras of the frame, and references for the shader's
//! pure functions.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3, Vec3, Vec4};
use karat::Texture;

use crate::camera::{Camera, Setup};
use crate::materials::{MATERIALS, ROUGHNESSES};

/// The number of spheres across and down.
pub const SIDE: u32 = 8;

/// The distances between the centres of neighbouring spheres, across and down. The radius is 1.
pub const SPACING: DVec2 = DVec2::new(3.2, 2.2);

karat::shareable! {
    /// The numbers of directions from which each pixel gathers light.
    pub struct Samples mirrors SamplesMirror {
        /// The number of directions for the diffuse term.
        diffuse: u32,
        /// The number of directions for the specular term.
        specular: u32,
    }
}

impl Samples {
    /// Numbers of directions that are small enough for a software rasteriser. The numbers are powers of two, so that
    /// dividing by them causes no rounding.
    pub const DEFAULT: Self = Self { diffuse: 256, specular: 512 };
    /// Numbers of directions for estimators that read higher mip levels.
    pub const FILTERED: Self = Self { diffuse: 64, specular: 64 };
}

/// The material of a sphere, as the texels of the material maps store it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Painted {
    /// The albedo of plastics, or the reflectance of metals at normal incidence: linear, per channel.
    pub base_color: Vec3,
    /// The GGX width. As in the lecture, the width is the roughness, and not its square. 0 means a mirror.
    pub roughness: f32,
    /// 0 for plastics, and 1 for metals.
    pub metallic: f32,
}

/// Returns the spheres in the order of instances, row by row: each column has a material, and each row a roughness.
#[must_use]
pub fn spheres() -> Vec<Painted> {
    let row = |roughness| {
        MATERIALS.map(|(diffuse, f0)| {
            let metal = diffuse == Vec3::ZERO;
            let base_color = if metal { f0 } else { diffuse };
            Painted { base_color, roughness, metallic: f32::from(metal) }
        })
    };
    ROUGHNESSES.into_iter().flat_map(row).collect()
}

/// Returns spheres that reflect all light: the plastics are white, and the metals have a reflectance of 1.
#[must_use]
pub fn white_spheres() -> Vec<Painted> {
    spheres().into_iter().map(|painted| Painted { base_color: Vec3::ONE, ..painted }).collect()
}

/// Returns `base_color_map` and `surface_map`, with a texel for each sphere.
///
/// # Panics
///
/// Panics if `spheres` doesn't have one sphere for each column and row of the scene.
#[must_use]
pub fn material_maps(spheres: &[Painted]) -> [Texture; 2] {
    assert_eq!(spheres.len(), (SIDE * SIDE) as usize, "a material for each sphere");
    let at = |column: u32, row: u32| spheres[(row * SIDE + column) as usize];
    [
        Texture::from_fn(SIDE, SIDE, |column, row| at(column, row).base_color.extend(1.0)),
        Texture::from_fn(SIDE, SIDE, |column, row| {
            Vec4::new(at(column, row).roughness, at(column, row).metallic, 0.0, 1.0)
        }),
    ]
}

/// The width of a mask in texels. 64 texels are enough, because a sphere in the largest frame is 60 pixels wide.
const MASK: u32 = 64;

/// Makes a mask in the channel R. `value` gives the mask at each point of the square around a sphere, seen from the
/// front: x to the right, y up, both in [-1, 1].
fn mask(value: impl Fn(DVec2) -> f64) -> Texture {
    let centre = |texel: u32| (2.0 * f64::from(texel) + 1.0) / f64::from(MASK) - 1.0;
    Texture::from_fn(MASK, MASK, |column, row| {
        let value = value(DVec2::new(centre(column), -centre(row)));
        Vec4::new(value as f32, 0.0, 0.0, 1.0)
    })
}

/// Returns a mask that is 0 everywhere.
#[must_use]
pub fn no_mask() -> Texture {
    mask(|_| 0.0)
}

/// Returns a mask with rings around the middle of each sphere. Each soft edge is about a fifth as wide as a ring, so
/// the frame also shows values between 0 and 1.
#[must_use]
pub fn rings() -> Texture {
    mask(|point| (0.5 + 1.5 * (3.0 * PI * point.length()).sin()).clamp(0.0, 1.0))
}

/// Returns a mask with dots in a square pattern. The dots have the value 0.85: semi-transparent white.
#[must_use]
pub fn dots() -> Texture {
    mask(|point| {
        // The distance between the middles of dots is two thirds.
        let from_dot = point - (1.5 * point).round() / 1.5;
        0.85 * ((0.2 - from_dot.length()) / 0.05).clamp(0.0, 1.0)
    })
}

/// Returns a camera that sees all spheres, for a frame `aspect` times as wide as high. The camera is on the +Z axis.
#[must_use]
pub fn camera(aspect: f64) -> Camera {
    // The field of view is narrow, so that spheres at the border don't look stretched.
    let field_of_view = 20_f64.to_radians();
    // The sum of half of the grid, the radius, and a border of 0.6.
    let half = 0.5 * f64::from(SIDE - 1) * SPACING + DVec2::splat(1.6);
    let distance = half.y.max(half.x / aspect) / (0.5 * field_of_view).tan();
    Setup {
        position: DVec3::new(0.0, 0.0, distance),
        target: DVec3::ZERO,
        field_of_view,
        // All points of the spheres are within 1 of z = 0. The depth range covers only the spheres.
        depth: [distance - 1.5, distance + 1.5],
    }
    .camera(aspect)
}

/// Returns a camera that sees the spheres from the side, one behind another. The frame draws the farthest spheres
/// first.
#[must_use]
pub fn oblique_camera(aspect: f64) -> Camera {
    Setup {
        position: DVec3::new(45.0, -3.0, 8.0),
        target: DVec3::ZERO,
        field_of_view: 25_f64.to_radians(),
        depth: [25.0, 65.0],
    }
    .camera(aspect)
}

/// Returns the unit sphere: the positions of its vertices, which are also the normals, and the indices of its
/// triangles. Seen from outside, the triangles are counter-clockwise.
///
/// The sphere has `rings` bands from pole to pole, each of `segments` pieces. Each pole is one vertex, and no vertex is
/// doubled.
///
/// # Panics
///
/// Panics with fewer than 2 rings or 3 segments, which enclose no volume.
#[must_use]
pub fn sphere(rings: u32, segments: u32) -> (Vec<Vec3>, Vec<u32>) {
    assert!(
        rings >= 2 && segments >= 3,
        "a sphere needs 2 rings and 3 segments, not {rings} and {segments}"
    );
    let mut positions = vec![Vec3::Y];
    for ring in 1..rings {
        let (sin_theta, cos_theta) = (PI * f64::from(ring) / f64::from(rings)).sin_cos();
        for segment in 0..segments {
            let (sin_phi, cos_phi) = (TAU * f64::from(segment) / f64::from(segments)).sin_cos();
            // The azimuth goes from +Z to +X, counter-clockwise from above, and rings go down.
            let position = DVec3::new(sin_theta * sin_phi, cos_theta, sin_theta * cos_phi);
            positions.push(position.as_vec3());
        }
    }
    positions.push(Vec3::NEG_Y);

    let vertex = |ring: u32, segment: u32| match ring {
        0 => 0,
        _ if ring == rings => (rings - 1) * segments + 1,
        _ => (ring - 1) * segments + segment % segments + 1,
    };
    let mut indices = Vec::new();
    for ring in 0..rings {
        for segment in 0..segments {
            let [a, b] = [vertex(ring, segment), vertex(ring, segment + 1)];
            let [c, d] = [vertex(ring + 1, segment), vertex(ring + 1, segment + 1)];
            // At a pole, one triangle of each quadrilateral has no area.
            if ring + 1 < rings {
                indices.extend([a, c, d]);
            }
            if ring > 0 {
                indices.extend([a, d, b]);
            }
        }
    }
    (positions, indices)
}

/// The centre of sphere `instance`.
#[must_use]
pub fn sphere_centre(instance: u32) -> DVec3 {
    let (row, column) = (instance / SIDE, instance % SIDE);
    let top_left = DVec2::new(-1.0, 1.0) * 0.5 * f64::from(SIDE - 1) * SPACING;
    let offset = DVec2::new(f64::from(column), -f64::from(row)) * SPACING;
    (top_left + offset).extend(0.0)
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    const WIDE: f64 = 16.0 / 9.0;

    fn triangles(indices: &[u32]) -> impl Iterator<Item = [u32; 3]> {
        indices.chunks_exact(3).map(|corners| [corners[0], corners[1], corners[2]])
    }

    #[test]
    fn spheres_are_closed() {
        for (rings, segments) in [(2, 3), (3, 4), (16, 32)] {
            let (positions, indices) = sphere(rings, segments);
            let faces = indices.len() / 3;
            let edges: HashSet<(u32, u32)> =
                triangles(&indices).flat_map(|[a, b, c]| [(a, b), (b, c), (c, a)]).collect();
            // Each directed edge occurs once, and so does its opposite: this is an oriented closed surface.
            assert_eq!(edges.len(), 3 * faces);
            assert!(edges.iter().all(|&(a, b)| edges.contains(&(b, a))));
            // Euler's characteristic of the sphere is 2.
            assert_eq!(positions.len() + faces, edges.len() / 2 + 2);
        }
    }

    #[test]
    fn spheres_have_unit_normals_that_point_outwards() {
        let (positions, indices) = sphere(16, 32);
        for position in &positions {
            assert!((position.as_dvec3().length() - 1.0).abs() < 1e-7);
        }
        for corners in triangles(&indices) {
            let [a, b, c] = corners.map(|corner| positions[corner as usize]);
            assert!((b - a).cross(c - a).dot(a + b + c) > 0.0);
        }
    }

    #[test]
    #[should_panic(expected = "a sphere needs 2 rings and 3 segments, not 1 and 8")]
    fn flat_spheres_are_refused() {
        let _ = sphere(1, 8);
    }

    #[test]
    fn the_grid_reads_like_a_page() {
        let gold_second_row = spheres()[8 + 5];
        assert_eq!(gold_second_row.base_color, Vec3::new(1.0, 0.782, 0.344));
        assert_eq!((gold_second_row.roughness, gold_second_row.metallic), (0.05, 1.0));
        let (first, last) = (sphere_centre(0), sphere_centre(63));
        assert!(first.x < 0.0 && first.y > 0.0);
        assert!(first.abs_diff_eq(-last, 1e-12));
        assert!((sphere_centre(1) - first).abs_diff_eq(DVec3::new(3.2, 0.0, 0.0), 1e-12));
        assert!((sphere_centre(8) - first).abs_diff_eq(DVec3::new(0.0, -2.2, 0.0), 1e-12));
    }

    #[test]
    fn five_columns_are_metal() {
        for (instance, painted) in spheres().into_iter().enumerate() {
            assert_eq!(painted.metallic == 1.0, instance % 8 > 2);
        }
        assert!(white_spheres().iter().all(|painted| painted.base_color == Vec3::ONE));
    }

    #[test]
    fn the_camera_sees_all_spheres() {
        let (positions, _) = sphere(32, 64);
        for aspect in [WIDE, 1.0] {
            let matrix = camera(aspect).view_projection;
            let mut reach = Vec3::ZERO;
            for instance in 0..64 {
                for position in &positions {
                    let world = *position + sphere_centre(instance).as_vec3();
                    let ndc = matrix.project_point3(world);
                    assert!((0.0..1.0).contains(&ndc.z), "{ndc}");
                    reach = reach.max(ndc.abs());
                }
            }
            assert!(reach.x < 0.97 && reach.y < 0.97, "{reach}");
            assert!(reach.x.max(reach.y) > 0.9, "{reach}");
        }
    }

    #[test]
    fn the_frame_is_upright() {
        let matrix = camera(WIDE).view_projection;
        let first = matrix.project_point3(sphere_centre(0).as_vec3());
        assert!(first.x < 0.0 && first.y > 0.0);
        let nearer = matrix.project_point3(Vec3::Z).z;
        assert!(nearer < matrix.project_point3(Vec3::ZERO).z);
    }
}
