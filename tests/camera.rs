//! Tests the camera of frames.

use glam::{DVec2, DVec3, Mat4, Vec2, Vec3};
use karat::prelude::*;
use shaders::{PBR, camera, scene};

/// The shader uses the rows of the matrix in place of its inverse. So the shader's vector is parallel to the reference,
/// but has a different length.
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

/// Tests cameras that look in any direction except steeply up or down. The shader assumes that the rows of the matrix
/// are orthogonal. Each element has a relative rounding error of 6e-8, so the rows of a rotated camera are orthogonal
/// only within a few times 6e-8.
// Lesson 32
#[test]
fn view_direction_along_any_axis() {
    let setups = (UnitVector, -10.0..=10.0_f32, 0.1..=2.0_f32)
        .filter(|(forward, ..): &(Vec3, f32, f32)| forward.y.abs() < 0.9);
    let cameras = (setups, 0.5..=3.0_f32, -1.0..=1.0_f32, -1.0..=1.0_f32).map(
        |((forward, x, field_of_view), aspect, ndc_x, ndc_y)| {
            let position = DVec3::new(x.into(), 2.0, -3.0);
            let setup = camera::Setup {
                position,
                target: position + forward.as_dvec3(),
                field_of_view: field_of_view.into(),
                depth: [0.1, 100.0],
            };
            (setup.camera(aspect.into()).view_projection, Vec2::new(ndc_x, ndc_y))
        },
    );
    PBR.function("camera::view_direction").over(cameras).cases(4096).satisfies(
        "is parallel to the reference",
        |(matrix, ndc): (Mat4, Vec2), direction: Vec3| {
            let expected = camera::view_direction(matrix.as_dmat4(), ndc.as_dvec2());
            direction.as_dvec3().normalize().abs_diff_eq(expected.normalize(), 1e-6)
        },
    );
}

/// The inputs are small integers, so the result is exact.
#[test]
fn covering_corner() {
    PBR.function("camera::covering_corner")
        .over(Integers(0..=2_u32))
        .agrees_with(|index: u32| -> DVec2 { camera::covering_corner(index) }, Ulp(0.0));
}
