//! The pure functions of the test scene.

use glam::{Mat4, Vec2, Vec3};
use karat::prelude::*;
use shaders::{PBR, scene};

#[test]
fn sphere_centre() {
    PBR.function("scene::sphere_centre")
        .over(Integers(0..=63_u32))
        .agrees_with(scene::sphere_centre, Ulp(1.0));
}

/// The rows of the matrix stand for its inverse; directions agree but for their length.
#[test]
fn view_direction() {
    let cameras = (0.5..=3.0_f32, -1.0..=1.0_f32, -1.0..=1.0_f32)
        .map(|(aspect, x, y)| (scene::camera(f64::from(aspect)).view_projection, Vec2::new(x, y)));
    PBR.function("scene::view_direction").over(cameras).cases(4096).satisfies(
        "is parallel to the reference",
        |(matrix, ndc): (Mat4, Vec2), direction: Vec3| {
            let expected = scene::view_direction(matrix.as_dmat4(), ndc.as_dvec2());
            direction.as_dvec3().normalize().abs_diff_eq(expected.normalize(), 1e-6)
        },
    );
}

#[test]
fn facing_normal_faces_the_viewer() {
    // Opposite directions leave no way to turn.
    let pairs = (UnitVector, UnitVector).filter(|(n, v)| n.dot(*v) > -0.9);
    PBR.function("scene::facing_normal").over(pairs).satisfies(
        "has N.V of at least 1e-3 / sqrt(1 + 1e-3) and is n where that faces v already",
        |(n, v), facing: Vec3| {
            let kept = n.dot(v) < 1e-3 || facing == n;
            kept && facing.dot(v) > 4e-4 && (facing.length() - 1.0).abs() < 1e-6
        },
    );
}
