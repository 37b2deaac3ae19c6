//! Tests the mistakes E3 to E6: irradiance without a cosine, `<` instead of `<=` for the conservation of energy, the
//! wrong cosine, and a mirror whose BRDF is 1.

use std::f64::consts::PI;

use karat::check::Failure;
use karat::prelude::*;
use karat::unstable::check::Disagreement;
use shaders::{PBR, radiometry};

/// The disagreement that a check found. Panics if the check passed.
#[track_caller]
fn caught<T>(result: Result<T, Failure>) -> Disagreement {
    match result {
        Ok(_) => panic!("the mistake was not caught"),
        Err(Failure::Disagreement(disagreement)) => *disagreement,
        Err(other) => panic!("the check failed for another reason: {other}"),
    }
}

/// Pairs of a sky's radiance and the number of rings into which the shader divides the hemisphere. A sum over 64 rings
/// has 64 roundings.
fn skies() -> impl Domain<Value = (f32, u32)> {
    (1e-3..=1e3_f32, Integers(1..=64_u32))
}

const SUM: Ulp = Ulp(64.0);

/// Mistake E3. A uniform sky of radiance L gives an irradiance of pi L. A sum without the cosine gives 2 pi L.
#[test]
fn radiance_summed_without_its_cosine() {
    let sky = || PBR.function("as_written::radiometry::irradiance_of_sky").over(skies());
    let right = |radiance: f64, _: u32| radiometry::irradiance_from_cap(radiance, PI / 2.0);
    let found = caught(sky().unrecorded().try_agrees_with(right, SUM));
    for path in &found.paths {
        let census = path.census;
        assert_eq!((census.failures, census.too_high), (census.cases, census.cases));
    }
    sky().agrees_with(|radiance: f64, _: u32| 2.0 * PI * radiance, SUM);
}

/// Mistake E4: the law of conservation of energy has `<` instead of `<=`. This law is wrong for one albedo only: it
/// forbids the white Lambertian, whose albedo is 1.
#[test]
fn conservation_without_white() {
    let albedos = Grid::linear(0.0..=2.0, 201);
    let law = PBR.function("as_written::radiometry::conserves_energy").over(albedos);
    let found = caught(law.unrecorded().try_agrees_with(radiometry::conserves_energy, Ulp(0.0)));
    for path in &found.paths {
        assert_eq!((path.census.cases, path.census.failures), (201, 1));
        let albedo = ("directional_albedo".to_owned(), "1".to_owned());
        assert_eq!(path.worst.arguments, [albedo]);
        assert_eq!((path.worst.actual, path.worst.expected), (0, Some(1.0)));
    }
}

/// Mistake E5. For light from any direction, the share that a Lambertian reflects is its albedo. The printed law
/// computes 2 albedo (N.L) instead. For a white Lambertian at normal incidence the law gives 2, as if the surface
/// created energy. For a Lambertian of albedo 2 at N.L = 1/8 the law gives 1/2 and is satisfied, although this surface
/// does create energy.
#[test]
fn conservation_with_the_incoming_cosine() {
    let over = |albedos: std::ops::RangeInclusive<f32>, n_dot_l: f32| {
        PBR.function("as_written::radiometry::directional_albedo").over((
            albedos,
            Just(n_dot_l),
            Just(64_u32),
        ))
    };
    let everywhere = || {
        PBR.function("as_written::radiometry::directional_albedo").over((
            0.0..=2.0,
            0.0..=1.0,
            Just(64_u32),
        ))
    };
    caught(everywhere().unrecorded().try_agrees_with(|albedo: f64, _: f64, _: u32| albedo, SUM));
    let claimed = |albedo: f64, n_dot_l: f64, _: u32| 2.0 * albedo * n_dot_l;
    everywhere().agrees_with(claimed, SUM.or(Abs(1e-30)));

    // The purpose of the law is that conserving surfaces reflect at most 1, and other surfaces more.
    let conserves = |_, reflected: f32| reflected <= 1.0 + 1e-5;
    caught(over(1.0..=1.0, 1.0).unrecorded().try_satisfies("conserves energy", conserves));
    over(2.0..=2.0, 0.125).satisfies("is 1/2", |_, reflected: f32| (reflected - 0.5).abs() < 1e-5);
}

/// Mistake E6. A mirror keeps the radiance that arrives through a small solid angle dw, so its BRDF is 1 / (cos dw). A
/// BRDF of 1 would multiply the radiance by cos dw: the mirror image of the sun at normal incidence would have only
/// 6.8e-5 of the sun's radiance.
#[test]
fn a_mirror_of_one() {
    let mirror = || PBR.function("as_written::radiometry::mirror_brdf");
    let light = (1e-4..=1.0, 1e-8..=1.0);
    let found = caught(
        mirror().over(light).unrecorded().try_agrees_with(radiometry::mirror_brdf, Ulp(6.0)),
    );
    for path in &found.paths {
        let census = path.census;
        assert_eq!(census.too_low, census.failures);
        assert!(census.failures > census.cases * 99 / 100, "right for a cosine and 1 sr of 1 only");
    }
    let sun = radiometry::cap_solid_angle(0.004_65);
    assert!((sun - 6.8e-5).abs() < 1e-6);
    let kept = move |(n_dot_l, solid_angle): (f32, f32), brdf: f32| {
        let irradiance =
            radiometry::irradiance_from_radiance(1.0, f64::from(solid_angle), f64::from(n_dot_l));
        (f64::from(brdf) * irradiance / sun - 1.0).abs() < 1e-6
    };
    #[expect(clippy::cast_possible_truncation, reason = "arguments are f32")]
    let sun = sun as f32;
    mirror().over((Just(1.0), Just(sun))).satisfies("keeps 6.8e-5 of the sun's radiance", kept);
}
