//! Tests BRDFs with the mistakes of papers and lectures. `shaders/README.md` lists the mistakes by number.

use std::f64::consts::{FRAC_1_PI, FRAC_PI_4, PI};

use glam::{DVec3, Vec3};
use karat::check::Failure;
use karat::prelude::*;
use karat::unstable::check::Disagreement;
use shaders::{PBR, brdf};

#[track_caller]
fn caught<T: std::fmt::Debug>(result: Result<T, Failure>) -> Disagreement {
    match result {
        Err(Failure::Disagreement(disagreement)) => *disagreement,
        other => panic!("the mistake was not caught: {other:?}"),
    }
}

/// Directions at least 6 degrees above the horizon, where rounding and clamps have little effect.
fn above() -> impl Domain<Value = Vec3> {
    Hemisphere.filter(|direction: &Vec3| direction.z > 0.1)
}

/// Reflectances of at least 0.02, for which Schlick's formula keeps its relative precision.
fn reflectance() -> impl Domain<Value = Vec3> {
    UnitRgb.map(|c| (0.02 + 0.98 * c).min(Vec3::ONE))
}

/// GGX widths for which rounding the half vector to f32 has little effect.
const WIDE: std::ops::RangeInclusive<f32> = 0.1..=1.0;

fn view(degrees: f64) -> Vec3 {
    let (sin, cos) = degrees.to_radians().sin_cos();
    DVec3::new(sin, 0.0, cos).as_vec3()
}

/// Directions of light, with weights for an integral over the hemisphere. Each weight includes the cosine.
fn lights(alpha: f32, v: Vec3) -> impl Iterator<Item = (Vec3, f64)> {
    brdf::half_vector_rule(f64::from(alpha), v.as_dvec3(), 32, 32)
        .into_iter()
        .map(|(l, weight)| (l.as_vec3(), weight * l.z))
}

/// The arguments of a BRDF with a white `f0`, with weights for the integral in a white furnace.
fn white(&(alpha, v): &(f32, Vec3)) -> Vec<((Vec3, f32, Vec3, Vec3), f64)> {
    lights(alpha, v).map(|(l, weight)| ((Vec3::ONE, alpha, v, l), weight)).collect()
}

/// Mistake P1: the result is too bright by the factor pi.
#[test]
fn lambert_of_shaders_lacks_its_pi() {
    let lambert = || PBR.function("as_written::brdf::lambert");
    let domain = || (UnitRgb, Just(Vec3::Z), above());
    let irradiated = |albedo: DVec3, n: DVec3, l: DVec3| brdf::lambert_eval(albedo, n, l) * l.z;
    caught(lambert().over(domain()).unrecorded().try_agrees_with(irradiated, Rel(2.0)));
    lambert().over(domain()).agrees_with(
        move |albedo: DVec3, n: DVec3, l: DVec3| PI * irradiated(albedo, n, l),
        Ulp(4.0),
    );
}

/// Mistake P1: in a white furnace, the diffuse part of the result is pi instead of at most 1.
#[test]
fn mixed_conventions_return_more_than_pi() {
    let furnace = || {
        PBR.function("as_written::brdf::lambert_and_microfacet").integral(
            Just((0.5_f32, view(30.0))),
            |&(alpha, v): &(f32, Vec3)| {
                let f0 = Vec3::splat(0.04);
                lights(alpha, v).map(|(l, w)| ((Vec3::ONE, f0, alpha, v, l), w)).collect()
            },
        )
    };
    caught(furnace().unrecorded().try_is_at_most(|_| 1.0, 2.0));
    let specular = |&(alpha, v): &(f32, Vec3)| {
        let (alpha, v, f0) = (f64::from(alpha), v.as_dvec3(), DVec3::splat(0.04));
        brdf::integral(alpha, v, |l| brdf::microfacet_eval(f0, alpha, v, l).x * l.z)
    };
    furnace().agrees_with(|view| DVec3::splat(PI + specular(view)), Abs(1e-4));
}

/// Mistake E9: the result is too bright by exactly the factor 4 / pi, so a narrow lobe returns 1.27 in a white furnace.
#[test]
fn cook_torrance_as_quoted_is_too_bright() {
    let quoted = || PBR.function("as_written::brdf::cook_torrance");
    let domain = || (reflectance(), WIDE, above(), above());
    caught(
        quoted().over(domain()).unrecorded().try_agrees_with(brdf::cook_torrance_eval, Rel(0.27)),
    );
    // The corrected form has an error of 2e-4. V.H and H are computed from rounded vectors. Their error of 1e-7 is 2e-6
    // of a tangent at N.H = 0.1, and an exponent of up to 87 doubles it.
    quoted().over(domain()).agrees_with(
        |f0: DVec3, alpha: f64, v: DVec3, l: DVec3| {
            brdf::cook_torrance_eval(f0, alpha, v, l) / FRAC_PI_4
        },
        Rel(5e-4).or(Abs(1e-20)),
    );
    // A narrow lobe, seen from above, hides nothing, so it should return exactly all light. The quoted form returns 27
    // % more.
    let furnace = || quoted().integral(Just((0.05_f32, Vec3::Z)), white);
    caught(furnace().unrecorded().try_is_at_most(|_| 1.0, 0.27));
    furnace().agrees_with(|_| DVec3::splat(FRAC_PI_4.recip()), Abs(1e-4));
}

/// Arguments of the tri-Ace BRDF: albedo, f0, exponent, v and l.
fn tri_ace(
    exponent: impl Domain<Value = f32>,
) -> impl Domain<Value = (Vec3, Vec3, f32, Vec3, Vec3)> {
    (UnitRgb, reflectance(), exponent, above(), above())
}

/// Mistake E10: the result is infinite at n = 2. At n = 4 the highlight is the correct highlight times -7/8, and at n =
/// 100 the highlight is nearly 0.
#[test]
fn tri_ace_s_printed_normalisation_has_a_pole() {
    let printed = || PBR.function("as_written::brdf::tri_ace_normalisation");
    let reference = brdf::tri_ace_eval;
    caught(printed().over(tri_ace(0.0..=100.0)).unrecorded().try_agrees_with(reference, Rel(0.5)));

    let found = caught(
        printed()
            .over(tri_ace(Just(2.0)))
            .unrecorded()
            .try_satisfies("is finite", |_, _: Vec3| true),
    );
    for path in found.paths {
        assert_eq!(path.census.infinite, path.census.cases, "{}", path.adapter.path);
    }

    let black =
        || (reflectance(), above(), above()).map(|(f0, v, l)| (Vec3::ZERO, f0, 4.0_f32, v, l));
    caught(
        printed()
            .over(black())
            .unrecorded()
            .try_satisfies("is not negative", |_, f: Vec3| f.min_element() >= 0.0),
    );
    printed().over(black()).agrees_with(
        move |albedo: DVec3, f0: DVec3, n: f64, v: DVec3, l: DVec3| {
            -7.0 / 8.0 * reference(albedo, f0, n, v, l)
        },
        Rel(1e-4),
    );
}

/// Mistake E11: a black surface has no highlight. On a white surface, the highlight is the correct highlight divided by
/// pi.
#[test]
fn tri_ace_s_printed_bracket_takes_the_highlight() {
    let printed = || PBR.function("as_written::brdf::tri_ace_bracket");
    caught(
        printed()
            .over(tri_ace(0.0..=100.0))
            .unrecorded()
            .try_agrees_with(brdf::tri_ace_eval, Rel(0.5)),
    );
    printed()
        .over(tri_ace(0.0..=100.0).map(|(_, f0, n, v, l)| (Vec3::ZERO, f0, n, v, l)))
        .satisfies("is black", |_, f: Vec3| f == Vec3::ZERO);
    // A white f0 leaves no light for the diffuse part.
    printed()
        .over(tri_ace(0.0..=100.0).map(|(_, _, n, v, l)| (Vec3::ONE, Vec3::ONE, n, v, l)))
        .agrees_with(
            |albedo: DVec3, f0: DVec3, n: f64, v: DVec3, l: DVec3| {
                FRAC_1_PI * brdf::tri_ace_eval(albedo, f0, n, v, l)
            },
            // An exponent of 100 multiplies the error of N.H (1e-6 at 0.1) by 100. The error of `pow` adds to it.
            Rel(5e-4).or(Abs(1e-20)),
        );
}

/// In a white furnace at alpha = 1, the result is 1 / (2 N.V). For a view at 89.5 degrees, this is 57.3, and a correct
/// BRDF returns at most 1.
#[test]
fn without_g_grazing_views_glow() {
    let without = || PBR.function("as_written::brdf::microfacet_without_g");
    let domain = (reflectance(), WIDE, above(), above());
    caught(without().over(domain).unrecorded().try_agrees_with(brdf::microfacet_eval, Rel(0.5)));
    let furnace = || without().integral(Just((1.0_f32, view(89.5))), white);
    caught(furnace().unrecorded().try_is_at_most(|_| 1.0, 56.0));
    let expected = 0.5 / 0.5_f64.to_radians().sin();
    assert!((expected - 57.3).abs() < 0.01, "{expected}");
    furnace().agrees_with(|_| DVec3::splat(expected), Rel(1e-4));
}

/// With clamped cosines, the BRDF isn't 0 for light from below. At alpha = 1, seen from above, the BRDF is 1 / (2.002
/// pi) = 0.159 for light from each tested direction.
#[test]
fn clamped_dots_reflect_light_from_below() {
    let clamped = || PBR.function("as_written::brdf::microfacet_of_clamped_dots");
    let below = || {
        Hemisphere
            .filter(|l: &Vec3| l.z > 0.0 && l.z < 0.9)
            .map(|l| (Vec3::ONE, 1.0_f32, Vec3::Z, Vec3::new(l.x, l.y, -l.z)))
    };
    caught(clamped().over(below()).unrecorded().try_agrees_with(brdf::microfacet_eval, Abs(0.15)));
    clamped().over(below()).agrees_with(
        |_: DVec3, _: f64, _: DVec3, _: DVec3| DVec3::splat(0.5 / (1.001 * PI)),
        Rel(1e-5),
    );
    // For cosines above the clamps, the result is right.
    clamped()
        .over((reflectance(), WIDE, above(), above()))
        .agrees_with(brdf::microfacet_eval, Rel(2e-4));
}
