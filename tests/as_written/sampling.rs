//! Tests samplers with the mistakes of papers and lectures.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3, Mat3, Vec2, Vec3};
use karat::check::Failure;
use karat::prelude::*;
use karat::unstable::check::Disagreement;
use shaders::{PBR, sampling};

#[track_caller]
fn caught<T>(result: Result<T, Failure>) -> Disagreement {
    match result {
        Ok(_) => panic!("the mistake was not seen"),
        Err(Failure::Disagreement(disagreement)) => *disagreement,
        Err(other) => panic!("the check failed for another reason: {other}"),
    }
}

/// The share of failing cases on the first path.
fn share(found: &Disagreement) -> f64 {
    let census = &found.paths[0].census;
    census.failures as f64 / census.cases as f64
}

/// Mistake P6. Half of the lecture's azimuths are above pi, where WGSL gives no bound for the error of `sin` and `cos`.
#[test]
fn azimuths_leave_the_range_of_sine_and_cosine() {
    let uniform = (0..4096_u16).map(|i| (f32::from(i) + 0.5) / 4096.0);
    let found = caught(
        PBR.function("as_written::sampling::azimuth")
            .over(OneOf(uniform.collect()))
            .unrecorded()
            .try_satisfies("lies in [-pi, pi]", |_, phi: f32| f64::from(phi.abs()) <= PI),
    );
    assert_eq!(share(&found), 0.5);
    PBR.function("as_written::sampling::azimuth")
        .over(0.0..=1.0)
        .agrees_with(|u: f64| TAU * u, Ulp(1.0));
}

/// Mistake P3. At m = 0 and u.y = 1, the lecture's formula computes 0 / 0. The library's function returns the surface's
/// normal.
#[test]
fn a_mirror_has_no_normal() {
    let edge = || (Just(0.0_f32), Just(Vec2::new(0.5, 1.0)));
    let normal = |alpha: f64, u: DVec2| sampling::ggx_normal(alpha, u);
    let found = caught(
        PBR.function("as_written::sampling::ggx_normal")
            .over(edge())
            .unrecorded()
            .try_agrees_with(normal, Abs(6e38)),
    );
    assert!(found.paths.iter().all(|path| path.census.nan == 1), "{found}");
    PBR.function("sampling::ggx_normal").over(edge()).agrees_with(normal, Ulp(0.0));
}

/// Widths and random numbers for which the lecture's formula loses the digits of the sine.
fn smooth() -> impl Domain<Value = (f32, Vec2)> {
    // Samples well inside the lobe, along -X, for which sine and cosine of the azimuth are nearly exact.
    (1e-4..=1e-3_f32, (0.0..=0.0_f32, 0.1..=0.9_f32).map(|(x, y)| Vec2::new(x, y)))
}

/// Mistake P4. The lecture computes the sine from the rounded cosine, which is nearly 1. In this test, the true sine is
/// 5e-5 to 3e-3, and the lecture's sine has no correct digit.
#[test]
fn sines_of_smooth_surfaces_are_lost() {
    let sine = |alpha: f64, u: DVec2| (alpha * u.y.sqrt()).atan2((1.0 - u.y).sqrt()).sin();
    let as_written = Package::from_source(
        "sines",
        "import library::as_written::sampling::ggx_normal;\n\n\
         fn sine(m: f32, u: vec2f) -> f32 { return length(ggx_normal(m, u).xy); }\n",
    );
    let corrected = Package::from_source(
        "sines",
        "import library::sampling::ggx_normal;\n\n\
         fn sine(m: f32, u: vec2f) -> f32 { return length(ggx_normal(m, u).xy); }\n",
    );
    let found = caught(
        as_written
            .depends_on("library", &PBR)
            .function("sine")
            .over(smooth())
            .unrecorded()
            .try_agrees_with(sine, Rel(1e-3)),
    );
    assert!(share(&found) > 0.9, "{found}");
    // The sine is 0, so it has lost all digits.
    let lost = |path: &karat::unstable::check::PathDisagreement| {
        path.worst.expected.is_some_and(|expected| {
            let actual = f64::from(f32::from_bits(path.worst.actual));
            // On NVIDIA the square root of a negative number is NaN.
            let is_nan = actual.is_nan() && path.adapter.family() == "nvidia";
            is_nan || (actual - expected).abs() >= 0.9 * expected
        })
    };
    assert!(found.paths.iter().all(lost), "{found}");
    corrected
        .depends_on("library", &PBR)
        .function("sine")
        .over(smooth())
        .agrees_with(sine, Rel(1e-6));
}

/// Mistake E14. If normals follow the GGX distribution, the median of the tangents of their polar angles is alpha. The
/// lecture has alpha = roughness, and Karis has alpha = roughness^2, so the lecture's lobe is `1 / roughness` times as
/// wide.
#[test]
fn roughness_is_not_squared() {
    let median = || PBR.function("as_written::sampling::median_tangent").over(0.05..=0.9);
    caught(
        median().unrecorded().try_agrees_with(|roughness: f64| roughness * roughness, Rel(0.05)),
    );
    median().agrees_with(|roughness: f64| roughness, Rel(1e-4));
}

/// If the lowest 25 bits of the argument are set, the result is 1: the exact result is less than half an ulp below 1,
/// and rounds to 1.
#[test]
fn a_radical_inverse_returns_one() {
    let inverse = || PBR.function("as_written::sampling::radical_inverse");
    let ends: Vec<u32> = (0..128).map(|high| high << 25 | ((1 << 25) - 1)).collect();
    let found = caught(
        inverse()
            .over(OneOf(ends.clone()))
            .unrecorded()
            .try_satisfies("lies in [0, 1)", |_, x: f32| (0.0..1.0).contains(&x)),
    );
    assert_eq!(share(&found), 1.0);
    inverse().over(OneOf(ends)).agrees_with(|_: u32| 1.0, Ulp(0.0));
    // Integers below 2^24 convert to f32 exactly, so a smaller counter is safe.
    inverse()
        .over(Integers(0..=(1_u32 << 24) - 1))
        .agrees_with(sampling::radical_inverse, Ulp(1.0));
}

/// In a white environment, an estimate with N Hammersley points that aren't centred is exactly 1 - 1/N instead of 1.
#[test]
fn plain_points_are_dark() {
    let furnace = || {
        PBR.function("as_written::sampling::plain_furnace").over(OneOf(vec![1, 16, 64, 1024_u32]))
    };
    caught(furnace().unrecorded().try_agrees_with(|_: u32| 1.0, Abs(9e-4)));
    furnace().agrees_with(|n: u32| 1.0 - 1.0 / f64::from(n), Abs(1e-6));
}

/// The error of a basis: the largest entry of its Gram matrix minus the identity.
fn defect(basis: Mat3) -> f32 {
    let difference = basis.transpose() * basis - Mat3::IDENTITY;
    difference.to_cols_array().into_iter().fold(0.0, |worst, entry| worst.max(entry.abs()))
}

/// Vectors near -Z, but outside the special case of Frisvad's paper. The paper's divisor 1 + n.z goes down to 2^-23.
fn near_the_lower_pole() -> impl Domain<Value = Vec3> {
    let around = (4.5e-4..=0.02_f32, 0.0..=1.0_f32).map(|(sine, turn)| {
        let (sine, phi) = (f64::from(sine), TAU * f64::from(turn));
        DVec3::new(sine * phi.cos(), sine * phi.sin(), -(1.0 - sine * sine).sqrt()).as_vec3()
    });
    around.filter(|n| n.z >= -0.999_999_9)
}

/// The library's basis is orthonormal within 1e-6 everywhere. Frisvad's basis has an error of 1.2 near -Z.
#[test]
fn a_basis_breaks_at_the_lower_pole() {
    let frisvad = || PBR.function("as_written::sampling::frisvad_basis");
    let found = caught(
        frisvad()
            .over(Just(Vec3::NEG_Z))
            .unrecorded()
            .try_satisfies("is orthonormal", |_, basis: Mat3| defect(basis) <= 1e-6),
    );
    assert!(found.paths.iter().all(|path| path.census.nan + path.census.infinite == 1), "{found}");
    // A divisor of 2^-23 has an error of about a quarter here. An entry is about 1 - 2 (5/4) = -1.48 instead of -1, and
    // its square minus 1 is 1.2 instead of 0.
    let near = |most: f32| {
        frisvad()
            .over(near_the_lower_pole())
            .unrecorded()
            .try_satisfies("is orthonormal", move |_, basis: Mat3| defect(basis) <= most)
    };
    caught(near(1.0));
    near(1.25).expect("nothing is further off");
    PBR.function("sampling::orthonormal_basis")
        .over(near_the_lower_pole())
        .satisfies("is orthonormal", |_, basis: Mat3| defect(basis) <= 1e-6);
    // In the upper half both bases are equal.
    frisvad().over(Hemisphere).agrees_with(sampling::orthonormal_basis, Abs(1e-6));
}
