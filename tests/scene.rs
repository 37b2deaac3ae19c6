//! Tests the pure functions of the test scene.

use glam::{DVec2, DVec3, Vec3};
use karat::prelude::*;
use shaders::{PBR, scene};

use crate::drivers::NVIDIA;

#[test]
fn sphere_centre() {
    PBR.function("scene::sphere_centre")
        .over(Integers(0..=63_u32))
        .fails_on(
            NVIDIA,
            "(a - b) * c is computed as a * c - b * c, which is less exact than WGSL allows",
        )
        .agrees_with(scene::sphere_centre, Ulp(1.0));
}

/// If N.V is below 1e-3, the shader moves the normal towards the viewer and normalises it. N.V is then 1e-3 divided by
/// the length of the moved normal, which is at most sqrt(1 + 1e-6).
#[test]
fn facing_normal_faces_the_viewer() {
    // If both vectors are nearly opposite, their sum is too short to keep its digits.
    let pairs = (UnitVector, UnitVector).filter(|(n, v)| n.dot(*v) > -0.9);
    PBR.function("scene::facing_normal").over(pairs).satisfies(
        "has N.V of at least 1e-3, but for rounding, and is n where that faces v already",
        |(n, v), facing: Vec3| {
            let kept = n.dot(v) < 1e-3 || facing == n;
            kept && facing.dot(v) > 9.98e-4 && (facing.length() - 1.0).abs() < 1e-6
        },
    );
}

/// The function computes two sums of values up to 1, each with one rounding, and two exact products.
#[test]
fn mask_coordinate() {
    PBR.function("scene::mask_coordinate")
        .over(UnitVector)
        .agrees_with(|n: DVec3| DVec2::new(0.5 * (n.x + 1.0), 0.5 * (1.0 - n.y)), Abs(6e-8));
}
