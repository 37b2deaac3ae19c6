//! Diffuse light from an environment.

use glam::{DVec3, Vec3};
use karat::prelude::*;
use shaders::{PBR, irradiance};

/// A Lambertian in a furnace of radiance 1, over all normals.
fn furnace() -> karat::Probe<'static> {
    PBR.function("irradiance::diffuse_irradiance_estimate")
        .with("environment", CubeMap::constant(Vec3::ONE))
        .with("environment_sampler", Sampler::Linear)
}

/// Centred points have the mean cosine 1/2 exactly where their number is a power of two; a sum of
/// up to 1024 terms is rounded 1024 times.
#[test]
fn a_white_furnace_returns_its_light() {
    furnace()
        .over((UnitVector, OneOf(vec![1, 2, 64, 256, 1024_u32])))
        .cases(4096)
        .agrees_with(|_: DVec3, _: u32| DVec3::ONE, Abs(1e-5));
}

#[test]
fn it_agrees_with_the_estimator_in_its_general_form() {
    furnace().over((UnitVector, Integers(1..=64_u32))).cases(4096).agrees_with(
        |n: DVec3, samples: u32| irradiance::diffuse_irradiance_estimate(n, samples, |_| DVec3::ONE),
        Abs(2e-6),
    );
}
