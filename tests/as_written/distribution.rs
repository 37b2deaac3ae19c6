//! Tests common formulas of distributions that lose digits in f32.

use glam::{DVec3, Vec3};
use karat::check::Failure;
use karat::prelude::*;
use karat::unstable::check::Disagreement;
use shaders::{PBR, distribution};

#[track_caller]
fn caught<T: std::fmt::Debug>(result: Result<T, Failure>) -> Disagreement {
    match result {
        Err(Failure::Disagreement(disagreement)) => *disagreement,
        other => panic!("the mistake was not caught: {other:?}"),
    }
}

/// The common formula of GGX rounds alpha^2 - 1, so its error is 2.6 % at alpha = 1e-3.
#[test]
fn ggx_loses_alpha_beside_one() {
    let ggx = || PBR.function("as_written::distribution::ggx");
    // The check has the tolerance of the library's function.
    caught(
        ggx()
            .over((2e-4..=1.0, 0.0..=1.0))
            .unrecorded()
            .try_agrees_with(distribution::ggx, Ulp(14.0)),
    );
    // The shader rounds alpha^2 = 1e-6 to 17 * 2^-24, and then squares it.
    let rounded = 17.0 * 2.0_f64.powi(-24);
    let share = (1e-6 / rounded).powi(2);
    assert!((share - 0.974).abs() < 5e-4, "{share}");
    ggx().over((Just(1e-3), Just(1.0))).agrees_with(
        |alpha: f64, n_dot_h: f64| share * distribution::ggx(alpha, n_dot_h),
        Ulp(8.0),
    );
}

/// If alpha is below 1.7e-4 = 2^-12.5, the result is infinite.
#[test]
fn ggx_divides_by_zero() {
    let found = caught(
        PBR.function("as_written::distribution::ggx")
            .over((1e-4..=1.7e-4, Just(1.0)))
            .unrecorded()
            .try_satisfies("is finite", |_, _: f32| true),
    );
    for path in found.paths {
        assert_eq!(path.census.failures, path.census.cases, "{}", path.adapter.path);
        assert_eq!(path.census.infinite, path.census.cases, "{}", path.adapter.path);
    }
}

/// Half vectors within four widths of +Z. Their dot product with +Z is their z component, so the only error is the
/// rounding of this component.
fn narrow() -> impl Domain<Value = (f32, Vec3, Vec3)> {
    (Just(0.0025_f32), 0.0..=0.01_f32).map(|(alpha, sin)| {
        let cos = (1.0 - f64::from(sin).powi(2)).sqrt();
        (alpha, Vec3::Z, DVec3::new(f64::from(sin), 0.0, cos).as_vec3())
    })
}

/// The rounding of the cosine gives an error of 1.9 % at alpha = 0.0025, although the formula of D is right.
#[test]
fn cosines_lose_narrow_lobes() {
    let of_dot = || PBR.function("as_written::distribution::ggx_of_dot_product").over(narrow());
    let from_vectors = || PBR.function("distribution::ggx_from_vectors").over(narrow());
    let reference = distribution::ggx_from_vectors;
    from_vectors().agrees_with(reference, Ulp(24.0));
    caught(of_dot().unrecorded().try_agrees_with(reference, Rel(0.018)));
    of_dot().agrees_with(reference, Rel(0.020));
}
