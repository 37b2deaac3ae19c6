//! Tests the compensation for light that a single reflection loses.

use glam::{Vec2, Vec3};
use karat::prelude::*;
use shaders::{PBR, compensation};

/// Scale and bias of f0, each at least 0. Their sum goes from the sum for the roughest metal at grazing angles to 1.
fn tables() -> impl Domain<Value = Vec2> {
    (0.1..=1.0_f32, 0.0..=1.0_f32).map(|(furnace, bias)| {
        let bias = bias * furnace;
        Vec2::new(furnace - bias, bias)
    })
}

fn light() -> impl Domain<Value = Vec3> {
    (0.0..=50.0_f32, 0.0..=50.0_f32, 0.0..=50.0_f32).map(|(r, g, b)| Vec3::new(r, g, b))
}

/// The function computes a product and a sum of positive terms.
#[test]
fn directional_albedo() {
    PBR.function("compensation::directional_albedo")
        .over((UnitRgb, tables()))
        .agrees_with(compensation::directional_albedo, Ulp(2.0));
}

/// The sum in the quotient is rounded, and the quotient has 2.5 ulp. Nothing cancels: the quotient is at least 1, and
/// the function later adds the number that it subtracts.
#[test]
fn compensated() {
    PBR.function("compensation::compensated")
        .over((UnitRgb, light(), tables()))
        .agrees_with(compensation::compensated, Ulp(6.0).or(Abs(1e-30)));
}

/// If nearly all light is reflected, 1 - E cancels. E is at most 1, and two roundings give it an error of 1.2e-7. The
/// pigment's factor of 50 turns this error into 6e-6.
#[test]
fn coupled() {
    PBR.function("compensation::coupled")
        .over((UnitRgb, light(), light(), tables()))
        .agrees_with(compensation::coupled, Ulp(4.0).or(Abs(8e-6)));
}
