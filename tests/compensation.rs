//! Tests the compensation for light that a single reflection loses.

use glam::{Vec2, Vec3};
use karat::prelude::*;
use shaders::{PBR, compensation};

/// Scale and bias of f0: at least 0. Their sum goes from that of the roughest metal at grazing to 1.
fn tables() -> impl Domain<Value = Vec2> {
    (0.1..=1.0_f32, 0.0..=1.0_f32).map(|(furnace, bias)| {
        let bias = bias * furnace;
        Vec2::new(furnace - bias, bias)
    })
}

fn light() -> impl Domain<Value = Vec3> {
    (0.0..=50.0_f32, 0.0..=50.0_f32, 0.0..=50.0_f32).map(|(r, g, b)| Vec3::new(r, g, b))
}

/// A product and a sum of positive terms.
#[test]
fn directional_albedo() {
    PBR.function("compensation::directional_albedo")
        .over((UnitRgb, tables()))
        .agrees_with(compensation::directional_albedo, Ulp(2.0));
}

/// The sum in the quotient is rounded, and the quotient by 2.5 ulp. Nothing cancels, since the quotient is at least 1,
/// and the subtracted number is added again.
#[test]
fn compensated() {
    PBR.function("compensation::compensated")
        .over((UnitRgb, light(), tables()))
        .agrees_with(compensation::compensated, Ulp(6.0).or(Abs(1e-30)));
}

/// 1 - E cancels if nearly all light is reflected: E is up to 1 and rounded twice, by 1.2e-7 in all, which the
/// pigment's 50 turns into 6e-6.
#[test]
fn coupled() {
    PBR.function("compensation::coupled")
        .over((UnitRgb, light(), light(), tables()))
        .agrees_with(compensation::coupled, Ulp(4.0).or(Abs(8e-6)));
}
