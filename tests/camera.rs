//! Where frames are seen from.

use glam::{DVec2, Mat4, Vec2, Vec3};
use karat::prelude::*;
use shaders::{PBR, camera, scene};

/// The rows of the matrix stand for its inverse; directions agree but for their length.
#[test]
fn view_direction() {
    let cameras = (0.5..=3.0_f32, -1.0..=1.0_f32, -1.0..=1.0_f32)
        .map(|(aspect, x, y)| (scene::camera(f64::from(aspect)).view_projection, Vec2::new(x, y)));
    PBR.function("camera::view_direction").over(cameras).cases(4096).satisfies(
        "is parallel to the reference",
        |(matrix, ndc): (Mat4, Vec2), direction: Vec3| {
            let expected = camera::view_direction(matrix.as_dmat4(), ndc.as_dvec2());
            direction.as_dvec3().normalize().abs_diff_eq(expected.normalize(), 1e-6)
        },
    );
}

/// Small integers: exact.
#[test]
fn covering_corner() {
    PBR.function("camera::covering_corner")
        .over(Integers(0..=2_u32))
        .agrees_with(|index: u32| -> DVec2 { camera::covering_corner(index) }, Ulp(0.0));
}
