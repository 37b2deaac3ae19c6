//! Tests layers that gain energy, or that aren't reciprocal.

use glam::{DVec3, Vec3};
use karat::check::Failure;
use karat::prelude::*;
use karat::unstable::check::Disagreement;
use shaders::{PBR, fresnel, specular};

#[track_caller]
fn caught<T>(result: Result<T, Failure>) -> Disagreement {
    match result {
        Ok(_) => panic!("the mistake was not seen"),
        Err(Failure::Disagreement(disagreement)) => *disagreement,
        Err(other) => panic!("the check failed for another reason: {other}"),
    }
}

/// The diffuse and the specular light from the lecture's red plastic in a white furnace.
fn red_plastic(alpha: f64, degrees: f32) -> (Vec3, Vec3) {
    let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
    let (f0, v) = (DVec3::splat(0.04), DVec3::new(sin, 0.0, cos));
    let light = specular::estimate(f0, alpha, DVec3::Z, v, 1024, |_| DVec3::ONE);
    (Vec3::new(0.8, 0.05, 0.05), light.as_vec3())
}

#[test]
fn plastic_without_transmittance_gains_energy() {
    for alpha in [0.0, 0.05, 0.1, 0.2, 0.5] {
        let found = PBR
            .function("as_written::layering::plastic")
            .over((0.0..=89.9_f32).map(move |degrees| red_plastic(alpha, degrees)))
            .cases(512)
            .unrecorded()
            .try_satisfies("sends at most what it receives", |_, light: Vec3| {
                light.max_element() <= 1.002
            });
        assert!(caught(found).paths.iter().all(|path| path.census.failures > 10));
    }
    for (alpha, degrees, furnace) in
        [(0.05, 89.6, 1.58), (0.0, 87.0, 1.574), (0.0, 89.9, 1.792), (0.5, 89.9, 1.141)]
    {
        PBR.function("as_written::layering::plastic")
            .over(Just(red_plastic(alpha, degrees)))
            .agrees_with(
                |_: DVec3, specular: DVec3| {
                    DVec3::new(furnace, specular.y + 0.05, specular.z + 0.05)
                },
                Abs(0.005),
            );
    }
}

#[test]
fn the_weight_of_a_thin_coat_is_not_reciprocal() {
    let weight = || PBR.function("as_written::layering::thin_coat_weight");
    let found = weight()
        .over((0.0..=1.0, 0.0..=1.0))
        .unrecorded()
        .try_invariant_under(|(v, l)| (l, v), Abs(0.5));
    assert_eq!(caught(found).check, "invariant_under");
    weight()
        .over(OneOf(vec![(0.1_f32, 1.0_f32), (1.0, 0.1)]))
        .agrees_with(|v: f64, _: f64| if v == 1.0 { 0.96 } else { 0.393 }, Abs(5e-4));
    // This weight conserves energy over a white base: with F, the sum is 1 for each view. The difference of two numbers
    // near 1 is rounded to 1e-7 twice.
    weight()
        .over((0.0..=1.0, 0.0..=1.0))
        .agrees_with(|v: f64, _: f64| 1.0 - fresnel::schlick(DVec3::splat(0.04), v).x, Abs(1e-6));
}
