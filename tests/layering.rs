//! Tests a thin coat over any base.

use glam::{DVec3, Vec3};
use karat::prelude::*;
use shaders::{PBR, layering, specular};

/// Colours with radiances up to 50, the radiance of the brightest light in the scene.
fn radiance() -> impl Domain<Value = Vec3> {
    (0.0..=50.0_f32, 0.0..=50.0_f32, 0.0..=50.0_f32).map(|(r, g, b)| Vec3::new(r, g, b))
}

/// The function computes base + F (environment - base), which cancels if the base is bright and F is near 1. F is at
/// most 1 and has an error of 11 ulp, which grows to 3e-5 when multiplied by a difference of up to 50. Rounding the
/// difference adds up to 4e-6.
#[test]
fn thin_coat() {
    PBR.function("layering::thin_coat")
        .over((radiance(), radiance(), 0.0..=1.0))
        .agrees_with(layering::thin_coat, Ulp(14.0).or(Abs(3e-5)));
}

/// In a white furnace, a coated white base stays exactly white: the base returns the light that the coat doesn't
/// reflect.
#[test]
fn a_coat_over_a_white_base_neither_gains_nor_loses() {
    PBR.function("layering::thin_coat")
        .over((Just(Vec3::ONE), Just(Vec3::ONE), Grid::linear(0.0..=1.0, 4097)))
        .agrees_with(|_: DVec3, _: DVec3, _: f64| DVec3::ONE, Ulp(0.0));
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

/// The tolerance covers three roundings of positive terms, and the rounding of 1 - mask.
#[test]
fn masked_base() {
    PBR.function("layering::masked_base")
        .over((radiance(), radiance(), 0.0..=1.0))
        .agrees_with(layering::masked_base, Ulp(4.0).or(Abs(1e-30)));
}

/// The function is a sum of two positive terms. Computing the term with `base` takes four sums, two differences and six
/// products.
#[test]
fn plastic() {
    PBR.function("layering::plastic")
        .over((UnitRgb, radiance(), radiance(), 0.0..=1.0))
        .agrees_with(layering::plastic, Ulp(10.0).or(Abs(1e-30)));
}

#[test]
fn interface_transmittance() {
    PBR.function("layering::interface_transmittance")
        .over((UnitRgb, 0.0..=1.0))
        .agrees_with(layering::interface_transmittance, Ulp(10.0).or(Abs(1e-30)));
}

/// In a white furnace, a plastic returns at most the light that it receives. The specular light is an estimate from 256
/// sampled normals, with an error of at most 2e-3.
#[test]
fn a_plastic_gives_no_more_than_its_light() {
    let f0 = Vec3::splat(0.04);
    let domain = (0.0..=0.8_f32, 0.0..=0.5_f32, 1e-3..=1.0_f32).map(move |(albedo, alpha, c)| {
        let v = DVec3::new((1.0 - f64::from(c * c)).sqrt(), 0.0, f64::from(c));
        let alpha = f64::from(if alpha < 1e-4 { 0.0 } else { alpha });
        let white = |_| DVec3::ONE;
        let specular = specular::estimate(f0.as_dvec3(), alpha, DVec3::Z, v, 256, white);
        (f0, Vec3::splat(albedo), specular.as_vec3(), c)
    });
    PBR.function("layering::plastic")
        .over(domain)
        .cases(4096)
        .satisfies("sends at most what it receives", |_, light: Vec3| {
            light.min_element() >= 0.0 && light.max_element() <= 1.002
        });
}

/// A mirror-like plastic on a white base returns all light: the reflected share and the rest add up to 1, within
/// rounding.
#[test]
fn a_mirror_on_white_neither_gains_nor_loses() {
    let domain = (UnitRgb, 0.0..=1.0_f32).map(|(f0, c)| {
        let specular = shaders::fresnel::schlick(f0.as_dvec3(), f64::from(c)).as_vec3();
        (f0, Vec3::ONE, specular, c)
    });
    PBR.function("layering::plastic")
        .over(domain)
        .agrees_with(|_: DVec3, _: DVec3, _: DVec3, _: f64| DVec3::ONE, Ulp(8.0));
}

/// Less light crosses an interface as the view becomes more grazing.
#[test]
fn less_crosses_toward_grazing() {
    PBR.function("layering::interface_transmittance").over((UnitRgb, 0.0..=1.0)).is_monotone_in(
        "n_dot_x",
        Trend::Increasing,
        Ulp(10.0),
    );
}
