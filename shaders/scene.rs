//! Twin of `scene.wgsl`: what the frame is drawn from, and references for its pure functions.

use std::f64::consts::{PI, TAU};

use glam::dcamera::rh::{proj::directx::perspective, view::look_at_mat4};
use glam::{DMat4, DVec2, DVec3, Mat4, Vec3};

/// Spheres across and down.
pub const SIDE: u32 = 8;

/// Between the centres of neighbouring spheres, which have radius 1: across, down.
const SPACING: DVec2 = DVec2::new(3.2, 2.2);

/// The lecture's roughnesses, from the top row down. 0 is a mirror.
pub const ROUGHNESSES: [f32; SIDE as usize] = [0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5];

/// Albedo and reflectance at normal incidence of the lecture's materials, from the left column
/// to the right: red, green and blue plastic, iron, copper, gold, aluminium, silver.
///
/// Metals: Akenine-Moeller et al. 2018 (Real-Time Rendering, 4th edition), table 9.2, linear sRGB.
/// Sources differ, most of all for iron; gold's red, 1.022 in linear sRGB as gold is outside its
/// gamut, is clamped to 1. Plastics: 0.04, a dielectric of index 1.5.
const MATERIALS: [(Vec3, Vec3); SIDE as usize] = [
    (Vec3::new(0.80, 0.05, 0.05), PLASTIC_F0),
    (Vec3::new(0.05, 0.80, 0.05), PLASTIC_F0),
    (Vec3::new(0.05, 0.05, 0.80), PLASTIC_F0),
    (Vec3::ZERO, Vec3::new(0.562, 0.565, 0.578)),
    (Vec3::ZERO, Vec3::new(0.955, 0.638, 0.538)),
    (Vec3::ZERO, Vec3::new(1.000, 0.782, 0.344)),
    (Vec3::ZERO, Vec3::new(0.913, 0.922, 0.924)),
    (Vec3::ZERO, Vec3::new(0.972, 0.960, 0.915)),
];

const PLASTIC_F0: Vec3 = Vec3::splat(0.04);

karat::shareable! {
    /// What the spheres of one instance are made of.
    pub struct Material mirrors MaterialMirror {
        /// Albedo per channel; black for metals.
        diffuse: Vec3,
        /// Reflectance at normal incidence per channel.
        f0: Vec3,
        /// GGX width, as the lecture feeds it: not squared.
        roughness: f32,
    }
}

/// The materials of all spheres by instance: a material a column, a roughness a row.
#[must_use]
pub fn materials() -> Vec<Material> {
    let row = |roughness| MATERIALS.map(|(diffuse, f0)| Material { diffuse, f0, roughness });
    ROUGHNESSES.into_iter().flat_map(row).collect()
}

karat::shareable! {
    /// Where the frame is seen from.
    pub struct Camera mirrors CameraMirror {
        /// From world space to clip space: right-handed, depth from 0 (near) to 1.
        view_projection: Mat4,
        /// In world space.
        position: Vec3,
    }
}

/// The camera that sees all spheres, for a frame `aspect` times as wide as high.
///
/// It stands on the +Z axis. The matrix is built in f64 and rounded once.
#[must_use]
pub fn camera(aspect: f64) -> Camera {
    // Narrow, so that the spheres at the border don't look stretched.
    let vertical_fov = 20_f64.to_radians();
    // Half of the grid, the radius and a border of 0.6.
    let half = 0.5 * f64::from(SIDE - 1) * SPACING + DVec2::splat(1.6);
    let distance = half.y.max(half.x / aspect) / (0.5 * vertical_fov).tan();
    let position = DVec3::new(0.0, 0.0, distance);
    // The spheres are within 1 of z = 0: all of the depth range is spent on them.
    let projection = perspective(vertical_fov, aspect, distance - 1.5, distance + 1.5);
    let view = look_at_mat4(position, DVec3::ZERO, DVec3::Y);
    Camera { view_projection: (projection * view).as_mat4(), position: position.as_vec3() }
}

/// The unit sphere as positions, which are its normals too, and triangles that are
/// counter-clockwise seen from outside.
///
/// `rings` bands from pole to pole, each of `segments` pieces. The poles are one vertex each, and
/// no vertex is doubled.
///
/// # Panics
///
/// With fewer than 2 rings or 3 segments, which enclose no volume.
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
            // Azimuth from +Z to +X: counter-clockwise from above, rings go down.
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

/// Where sphere `instance` stands.
#[must_use]
pub fn sphere_centre(instance: u32) -> DVec3 {
    let (row, column) = (instance / SIDE, instance % SIDE);
    let top_left = DVec2::new(-1.0, 1.0) * 0.5 * f64::from(SIDE - 1) * SPACING;
    let offset = DVec2::new(f64::from(column), -f64::from(row)) * SPACING;
    (top_left + offset).extend(0.0)
}

/// The direction in which a camera sees `ndc`, of any length: the far point of the inverse
/// projection, from the near one.
#[must_use]
pub fn view_direction(view_projection: DMat4, ndc: DVec2) -> DVec3 {
    let inverse = view_projection.inverse();
    inverse.project_point3(ndc.extend(1.0)) - inverse.project_point3(ndc.extend(0.0))
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
            // Each directed edge once, each with its opposite: an oriented closed surface.
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
        assert_eq!(materials().len(), 64);
        let gold_second_row = &materials()[8 + 5];
        assert_eq!(gold_second_row.f0, Vec3::new(1.0, 0.782, 0.344));
        assert_eq!(gold_second_row.roughness, 0.05);
        let (first, last) = (sphere_centre(0), sphere_centre(63));
        assert!(first.x < 0.0 && first.y > 0.0);
        assert!(first.abs_diff_eq(-last, 1e-12));
        assert!((sphere_centre(1) - first).abs_diff_eq(DVec3::new(3.2, 0.0, 0.0), 1e-12));
        assert!((sphere_centre(8) - first).abs_diff_eq(DVec3::new(0.0, -2.2, 0.0), 1e-12));
    }

    #[test]
    fn metals_have_no_diffuse_and_plastics_conserve_energy() {
        for (column, material) in materials().into_iter().enumerate() {
            let metal = column % 8 > 2;
            assert_eq!(material.diffuse == Vec3::ZERO, metal);
            assert!(material.f0.min_element() >= 0.04 && material.f0.max_element() <= 1.0);
        }
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

    #[test]
    fn view_directions_reach_what_they_show() {
        let camera = camera(WIDE);
        let eye = camera.position.as_dvec3();
        let matrix = camera.view_projection.as_dmat4();
        for ndc in [DVec2::ZERO, DVec2::new(-0.8, 0.6), DVec2::ONE] {
            let direction = view_direction(matrix, ndc).normalize();
            let seen = matrix.project_point3(eye + 50.0 * direction);
            assert!(seen.truncate().abs_diff_eq(ndc, 1e-6), "{seen} for {ndc}");
        }
        assert!(view_direction(matrix, DVec2::ZERO).normalize().abs_diff_eq(DVec3::NEG_Z, 1e-6));
    }
}
