//! A thin coat over any base.

use glam::Vec3;
use karat::prelude::*;
use shaders::{PBR, layering};

/// Radiance per channel, up to what the brightest light of the scene has.
fn radiance() -> impl Domain<Value = Vec3> {
    (0.0..=50.0_f32, 0.0..=50.0_f32, 0.0..=50.0_f32).map(|(r, g, b)| Vec3::new(r, g, b))
}

/// The difference of two radiances up to 50 is rounded to 4e-6, F to 11 ulp of at most 1, which
/// 50 makes 3e-5; the sum cancels where the base is bright and F near 1.
#[test]
fn thin_coat() {
    PBR.function("layering::thin_coat")
        .over((radiance(), radiance(), 0.0..=1.0))
        .agrees_with(layering::thin_coat, Ulp(14.0).or(Abs(3e-5)));
}

/// White furnace: what the coat doesn't reflect, a white base does, to the bit.
#[test]
fn a_coat_over_a_white_base_neither_gains_nor_loses() {
    PBR.function("layering::thin_coat")
        .over((Just(Vec3::ONE), Just(Vec3::ONE), Grid::linear(0.0..=1.0, 4097)))
        .agrees_with(|_: glam::DVec3, _: glam::DVec3, _: f64| glam::DVec3::ONE, Ulp(0.0));
}

#[test]
fn thin_coat_reciprocal_weight() {
    PBR.function("layering::thin_coat_reciprocal_weight")
        .over((0.0..=1.0, 0.0..=1.0))
        .agrees_with(layering::thin_coat_reciprocal_weight, Ulp(14.0).or(Abs(1e-30)));
}

#[test]
fn the_reciprocal_weight_is_reciprocal() {
    PBR.function("layering::thin_coat_reciprocal_weight")
        .over((0.0..=1.0, 0.0..=1.0))
        .invariant_under(|(v, l)| (l, v), Ulp(0.0));
}

/// Three roundings of positive terms, and that of 1 - mask.
#[test]
fn masked_base() {
    PBR.function("layering::masked_base")
        .over((radiance(), radiance(), 0.0..=1.0))
        .agrees_with(layering::masked_base, Ulp(4.0).or(Abs(1e-30)));
}
