//! Tests Schlick's formula with `pow` instead of multiplications.

use glam::Vec3;
use karat::check::{Agreement, Failure};
use karat::prelude::*;
use karat::unstable::check::Disagreement;
use karat::unstable::path::Adapter;
use shaders::{PBR, fresnel};

#[track_caller]
fn caught<T>(result: Result<T, Failure>) -> Disagreement {
    match result {
        Ok(_) => panic!("the mistake was not caught"),
        Err(Failure::Disagreement(disagreement)) => *disagreement,
        Err(other) => panic!("the check failed for another reason: {other}"),
    }
}

/// The disagreement that the check found; `None` if the check passed and all drivers belong to `families`, the drivers
/// that can hide the mistake.
fn caught_but_on(families: &[&str], result: Result<Agreement, Failure>) -> Option<Disagreement> {
    let may_agree = |adapter: &Adapter| families.contains(&adapter.family().as_str());
    match result {
        Ok(agreement) if agreement.paths.iter().all(|(adapter, _)| may_agree(adapter)) => None,
        result => {
            let found = caught(result);
            assert!(found.agreeing.iter().all(|(adapter, _)| may_agree(adapter)), "{found}");
            Some(found)
        }
    }
}

/// If a mirror is seen at normal incidence, the half vector equals the view vector. For a fifth of the vectors
/// normalised in f32, the dot product of the vector with itself rounds to above 1. Then the base of `pow` is negative,
/// and the result is NaN.
#[test]
fn pow_of_a_cosine_above_one() {
    // The vectors are normalised in f32, as in a shader.
    let unit = (UnitVector, 0.1..=10.0_f32).map(|(v, distance)| (distance * v).normalize());
    let seen = unit.map(|v| (Vec3::splat(0.04), v, v));
    let result = PBR
        .function("as_written::fresnel::schlick")
        .over(seen)
        .unrecorded()
        .try_agrees_with(|f0: glam::DVec3, _: glam::DVec3, _: glam::DVec3| f0, Abs(1e-6));
    // In WGSL the power of a negative number is undefined. SwiftShader and NVIDIA return a small number, so they don't
    // show this mistake.
    let Some(found) = caught_but_on(&["swiftshader", "nvidia"], result) else { return };
    for path in &found.paths {
        let share = path.census.nan as f64 / path.census.cases as f64;
        assert!((0.1..0.3).contains(&share), "{share} are NaN on {}", path.adapter);
        assert_eq!(path.census.nan, path.census.failures);
    }
}

/// Where `pow` is defined, its error is 81 ulp, compared with 6 ulp for multiplications. The reason is that the product
/// of exponent and logarithm is rounded before `exp2`.
#[test]
fn pow_is_less_accurate() {
    // V.H is the z component of H.
    let seen = (UnitRgb, Hemisphere).map(|(f0, h)| (f0, Vec3::Z, h));
    let schlick = |f0, _: glam::DVec3, h: glam::DVec3| fresnel::schlick(f0, h.z);
    let result = PBR
        .function("as_written::fresnel::schlick")
        .over(seen)
        .unrecorded()
        .try_agrees_with(schlick, Ulp(11.0));
    // If the exponent is a constant, NVIDIA multiplies. The engine computes in `f64` and rounds the result.
    let Some(found) = caught_but_on(&["nvidia", "karat"], result) else { return };
    for path in &found.paths {
        let (actual, expected) = (f32::from_bits(path.worst.actual), path.worst.expected);
        #[expect(clippy::cast_possible_truncation, reason = "an ulp is one of f32")]
        let expected = expected.expect("a reference judged") as f32;
        let worst =
            karat::unstable::tolerance::ulp_distance(actual, expected).expect("neither is NaN");
        assert!(worst > 40, "{worst} ulp on {}", path.adapter);
    }
}
