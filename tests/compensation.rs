//! Tests the compensation for light that a single reflection loses.

use glam::{Vec2, Vec3};
use karat::prelude::*;
use shaders::{PBR, compensation};

/// The scale and the bias of f0 from the split sum's table, each at least 0. Their sum is between 0.1 and 1. For GGX,
/// the sum is at least 1 - ln 2 = 0.31.
fn tables() -> impl Domain<Value = Vec2> {
    (0.1..=1.0_f32, 0.0..=1.0_f32).map(|(furnace, bias)| {
        let bias = bias * furnace;
        Vec2::new(furnace - bias, bias)
    })
}

fn light() -> impl Domain<Value = Vec3> {
    (0.0..=50.0_f32, 0.0..=50.0_f32, 0.0..=50.0_f32).map(|(r, g, b)| Vec3::new(r, g, b))
}

/// The function computes a product and a sum of positive terms, so nothing cancels.
#[test]
fn directional_albedo() {
    PBR.function("compensation::directional_albedo")
        .over((UnitRgb, tables()))
        .agrees_with(compensation::directional_albedo, Ulp(2.0));
}

/// The function computes 1 + f0 (1 / (scale + bias) - 1). The sum is rounded, and the division has an error of 2.5 ulp.
/// The subtraction of 1 loses no digits of the result, because the function then adds 1 again.
#[test]
fn compensated() {
    PBR.function("compensation::compensated")
        .over((UnitRgb, light(), tables()))
        .agrees_with(compensation::compensated, Ulp(6.0).or(Abs(1e-30)));
}

/// If nearly all light is reflected, 1 - E cancels, where E is the directional albedo. E is at most 1 and is rounded
/// twice, so its error is at most 1.2e-7. The function multiplies 1 - E by diffuse light of up to 50, so this error
/// grows to 6e-6.
#[test]
fn coupled() {
    PBR.function("compensation::coupled")
        .over((UnitRgb, light(), light(), tables()))
        .agrees_with(compensation::coupled, Ulp(4.0).or(Abs(8e-6)));
}
