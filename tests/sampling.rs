//! Samplers against the formulas of the papers.

use glam::{Mat3, Vec2, Vec3};
use karat::prelude::*;
use shaders::{PBR, math, sampling};

/// Two numbers in 0..=1. The ends are included: a bit-reversed counter may round to 1.
fn unit_square() -> impl Domain<Value = Vec2> {
    (0.0..=1.0_f32, 0.0..=1.0_f32).map(|(x, y)| Vec2::new(x, y))
}

/// WGSL promises 2^-11 = 4.9e-4 for sin and cos on [-pi, pi], which is all that a portable shader
/// can rely on; a factor of at most 1 scales it.
const TRIGONOMETRIC: Abs = Abs(6e-4);

#[test]
fn uniform_hemisphere() {
    PBR.function("sampling::uniform_hemisphere")
        .over(unit_square())
        .agrees_with(sampling::uniform_hemisphere, TRIGONOMETRIC);
}

/// What doesn't depend on sine and cosine is exact: the height.
#[test]
fn uniform_hemisphere_takes_its_height_from_u() {
    PBR.function("sampling::uniform_hemisphere")
        .over(unit_square())
        .satisfies("has height u.y", |u, direction: Vec3| direction.z == u.y);
}

#[test]
fn uniform_hemisphere_pdf() {
    PBR.function("sampling::uniform_hemisphere_pdf")
        .over(-1.0..=1.0)
        .agrees_with(sampling::uniform_hemisphere_pdf, Ulp(1.0));
}

#[test]
fn ggx_normal() {
    // Below 1e-4 (but for 0, the mirror) alpha^2 vanishes beside 1 in f32.
    let alpha = (1e-4..=1.0_f32).map(|alpha| if alpha < 2e-4 { 0.0 } else { alpha });
    PBR.function("sampling::ggx_normal")
        .over((alpha, unit_square()))
        .agrees_with(sampling::ggx_normal, TRIGONOMETRIC);
}

#[test]
fn sampled_directions_have_unit_length() {
    // sin^2 + cos^2 is off by up to twice the error of each.
    let unit = |length: f32| (length - 1.0).abs() <= 1e-3;
    PBR.function("sampling::uniform_hemisphere")
        .over(unit_square())
        .satisfies("has unit length", |_, direction: Vec3| unit(direction.length()));
    PBR.function("sampling::ggx_normal")
        .over((1e-4..=1.0, unit_square()))
        .satisfies("has unit length", |_, normal: Vec3| unit(normal.length()));
}

/// The shader keeps the top 24 bits, which f32 holds exactly; the reference keeps all 32.
#[test]
fn radical_inverse() {
    PBR.function("sampling::radical_inverse")
        .over(Integers(0..=u32::MAX))
        .agrees_with(sampling::radical_inverse, Abs(2.0_f64.powi(-24)));
    PBR.function("sampling::radical_inverse")
        .over(Integers(0..=u32::MAX))
        .satisfies("lies in [0, 1)", |_, x: f32| (0.0..1.0).contains(&x));
}

/// `i < n`, for as many points as anyone draws.
fn counters() -> impl Domain<Value = (u32, u32)> {
    (0.0..=1.0_f32, Integers(1..=1_u32 << 22))
        .map(|(share, n)| (((share * n as f32) as u32).min(n - 1), n))
}

/// One division (2.5 ulp); the radical inverse drops what is below 2^-24.
#[test]
fn hammersley() {
    let tolerance = Ulp(4.0).or(Abs(2.0_f64.powi(-24)));
    PBR.function("sampling::hammersley")
        .over(counters())
        .agrees_with(sampling::hammersley, tolerance.clone());
    PBR.function("sampling::hammersley_centred")
        .over(counters())
        .agrees_with(sampling::hammersley_centred, tolerance);
}

/// The input is a unit vector to 1e-7 only; the basis can't be better.
#[test]
fn orthonormal_basis() {
    PBR.function("sampling::orthonormal_basis")
        .over(UnitVector)
        .agrees_with(sampling::orthonormal_basis, Abs(1e-6));
}

/// Poles included: Duff et al. 2017 has no hole, where the older construction breaks at -Z.
#[test]
fn orthonormal_basis_is_a_rotation_onto_n() {
    PBR.function("sampling::orthonormal_basis").over(UnitVector).satisfies(
        "is orthonormal, right-handed, and its third axis is n",
        |n, basis: Mat3| {
            let gram = basis.transpose() * basis;
            gram.abs_diff_eq(Mat3::IDENTITY, 1e-6)
                && (basis.determinant() - 1.0).abs() < 1e-6
                && basis.z_axis == n
        },
    );
}

/// Three products.
#[test]
fn pow5() {
    PBR.function("math::pow5").over(-1.0..=1.0).agrees_with(math::pow5, Ulp(4.0));
}
