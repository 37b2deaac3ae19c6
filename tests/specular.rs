//! Specular light from an environment.

use glam::{DVec3, Vec3};
use karat::prelude::*;
use shaders::{PBR, specular};

/// A normal, and a view on its side of the surface, down to 0.06 degrees above it.
fn seen() -> impl Domain<Value = (Vec3, Vec3)> {
    (UnitVector, UnitVector)
        .map(|(n, v)| (n, if n.dot(v) < 0.0 { -v } else { v }))
        .filter(|(n, v)| n.dot(*v) > 1e-3)
}

fn furnace() -> karat::Probe<'static> {
    PBR.function("specular::specular_estimate")
        .with("environment", CubeMap::constant(Vec3::ONE))
        .with("environment_sampler", Sampler::Linear)
}

/// What a mirror-like microfacet surface reflects of a furnace is what masking leaves: at most
/// all. The quadrature by 64 normals is off by up to 5e-3.
#[test]
fn a_white_furnace_gives_no_more_than_its_light() {
    furnace()
        .over(
            (Just(Vec3::ONE), 0.01..=1.0, seen(), Just(64_u32))
                .map(|(f0, alpha, (n, v), count)| (f0, alpha, n, v, count)),
        )
        .cases(8192)
        .satisfies("lies in 0..=1.01", |_, light: Vec3| {
            light.min_element() >= 0.0 && light.max_element() <= 1.01
        });
}

/// Weights and directions of the shader's simplified sum against the general form with D in both
/// f and pdf. A sample on the horizon may be rejected on one side only: its weight is up to 2 / 16.
#[test]
fn it_agrees_with_the_estimator_in_its_general_form() {
    let domain = (UnitRgb, 0.01..=1.0, seen()).map(|(f0, alpha, (n, v))| (f0, alpha, n, v, 16_u32));
    // Away from grazing no sample of these widths comes near the horizon.
    let domain = domain.filter(|(_, alpha, n, v, _)| *alpha < 0.2 && n.dot(*v) > 0.7);
    furnace().over(domain).cases(8192).agrees_with(
        |f0: DVec3, alpha: f64, n: DVec3, v: DVec3, samples: u32| {
            specular::specular_estimate(f0, alpha, n, v, samples, |_| DVec3::ONE)
        },
        Abs(1e-5),
    );
}

/// Width 0 is a mirror: Fresnel, and nothing else.
#[test]
fn a_mirror_reflects_by_fresnel_alone() {
    let domain = (UnitRgb, seen()).map(|(f0, (n, v))| (f0, 0.0_f32, n, v, 1_u32));
    furnace().over(domain).agrees_with(
        |f0: DVec3, _: f64, n: DVec3, v: DVec3, _: u32| shaders::fresnel::schlick(f0, n.dot(v)),
        Abs(2e-6),
    );
}
