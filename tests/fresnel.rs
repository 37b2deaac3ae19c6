//! Tests Fresnel reflectance against the formulas of the papers.

use glam::{DVec2, Vec2, Vec3};
use karat::prelude::*;
use shaders::{PBR, fresnel};

/// `1 - v_dot_h` is exact or has an error of half an ulp, so its fifth power has an error of up to 2.5 ulp. With the
/// roundings of three products, a difference and a sum, the error is at most 11 ulp.
// Lesson 24
#[test]
fn schlick() {
    PBR.function("fresnel::schlick")
        .over((UnitRgb, 0.0..=1.0))
        .agrees_with(fresnel::schlick, Ulp(11.0));
}

#[test]
fn schlick_lies_between_f0_and_one() {
    PBR.function("fresnel::schlick")
        .over((UnitRgb, 0.0..=1.0))
        .satisfies("lies between f0 and 1, to one rounding", |(f0, _), f: Vec3| {
            f.cmpge(f0).all() && f.max_element() <= 1.0 + f32::EPSILON
        });
}

/// V.H of two equal unit vectors often rounds to a number just above 1, so `schlick` must be right for such a number.
#[test]
fn schlick_survives_cosines_that_round_above_one() {
    let above_one = (0..=8_u32).map(|steps| f32::from_bits(1.0_f32.to_bits() + steps)).collect();
    PBR.function("fresnel::schlick")
        .over((UnitRgb, OneOf(above_one)))
        .satisfies("is f0, and not negative where that is 0", |(f0, _), f: Vec3| {
            f.abs_diff_eq(f0, f32::EPSILON) && f.min_element() >= 0.0
        });
}

/// If light comes from the rarer medium, the only subtraction that cancels is in r_p, near Brewster's angle, where r_s
/// outweighs r_p. Sums, products and one division lose up to 13 ulp of r_s.
#[test]
fn dielectric_into_the_denser_medium() {
    PBR.function("fresnel::dielectric")
        .over((1.0..=2.5, 0.0..=1.0))
        .agrees_with(fresnel::dielectric, Ulp(24.0));
}

/// Near the critical angle, the sum g^2 = eta^2 - 1 + c^2 cancels, and the reflectance has an infinite slope as a
/// function of g^2. The test stays away from this angle: for g^2 >= 0.01, an error of 1e-7 in g^2 is an error of 5e-7
/// in g. The reflectance is a mean of squared amplitudes r, whose slope as a function of g is below 2. So its error is
/// at most 2 * 2 * 5e-7 = 2e-6.
#[test]
fn dielectric_away_from_the_critical_angle() {
    let domain = (0.4..=1.0, 0.0..=1.0_f32).filter(|(eta, cosine): &(f32, f32)| {
        let g2 = f64::from(*eta).powi(2) - 1.0 + f64::from(*cosine).powi(2);
        g2.abs() > 1e-2
    });
    PBR.function("fresnel::dielectric")
        .over(domain)
        .agrees_with(fresnel::dielectric, Ulp(24.0).or(Abs(4e-6)));
}

/// At the critical angle, an error of 1.2e-7 in g^2 is an error of sqrt(1.2e-7) = 3.5e-4 in g. As g grows from 0, the
/// reflectance falls from 1 with a slope of up to 2 (1 + eta^2) / (eta^2 c). No formula in f32 can be more exact near
/// the critical angle.
#[test]
fn dielectric_around_the_critical_angle() {
    PBR.function("fresnel::dielectric")
        .over((0.4..=1.0, 0.0..=1.0))
        .agrees_with(fresnel::dielectric, Abs(2e-3));
}

/// For metals, the numerator of the formula has an error of 6 ulp. The denominators are fourth powers of two moduli, so
/// they have four times the error of the moduli. The last division has an error of 2.5 ulp. The relative error of r_p
/// is largest where r_p is smallest, and there r_s outweighs r_p.
#[test]
fn conductor() {
    PBR.function("fresnel::conductor")
        .over((0.05..=10.0, 0.5..=10.0, 0.0..=1.0))
        .agrees_with(fresnel::conductor, Ulp(32.0));
}

/// A metal with little absorption is nearly a tinted dielectric. If light comes from the rarer medium, only those terms
/// cancel that also cancel for a dielectric.
#[test]
fn conductor_with_little_absorption() {
    let absorption = (0.0..=0.5_f32).filter(|k| *k == 0.0 || *k >= 1e-18);
    PBR.function("fresnel::conductor")
        .over((1.0..=2.5, absorption, 0.0..=1.0))
        .agrees_with(fresnel::conductor, Ulp(32.0));
}

/// The function computes two square roots, each with an error of 4.5 ulp, and a division. One of the roots is the
/// modulus. The test leaves out complex numbers so small that the square of their modulus isn't a normal f32, because
/// no index of refraction is that small. The reference uses polar coordinates, in which the cosine of a right angle is
/// 6e-17 instead of 0. The reference multiplies this error by the root of the modulus, which is at most 14 at this
/// angle.
#[test]
fn complex_root() {
    let numbers = (-200.0..=200.0_f32, 0.0..=200.0_f32).map(|(x, y)| Vec2::new(x, y));
    let normal = numbers.filter(|z| z.length_squared() > 1e-35 && (z.y == 0.0 || z.y > 1e-18));
    let root = |z: DVec2| DVec2::from_angle(0.5 * z.to_angle()) * z.length().sqrt();
    PBR.function("fresnel::complex_root").over(normal).agrees_with(root, Ulp(12.0).or(Abs(1e-15)));
}

/// At the critical angle of a metal without absorption, the real and the imaginary part of the root are 0, so the
/// shader must not divide by either part.
#[test]
fn complex_root_of_nothing() {
    let root = |_: DVec2| DVec2::ZERO;
    PBR.function("fresnel::complex_root").over(Just(Vec2::ZERO)).agrees_with(root, Ulp(0.0));
}

/// Without absorption, a conductor is a dielectric. So the test compares `conductor` with the reference of
/// `dielectric`, which uses other formulas.
#[test]
fn conductor_without_absorption_is_a_dielectric() {
    PBR.function("fresnel::conductor")
        .over((1.0..=2.5, Just(0.0), 0.0..=1.0))
        .agrees_with(|eta: f64, _: f64, cosine: f64| fresnel::dielectric(eta, cosine), Ulp(32.0));
}

#[test]
fn conductor_reflects_no_more_than_it_receives() {
    PBR.function("fresnel::conductor")
        .over((0.05..=10.0, 0.0..=10.0, 0.0..=1.0))
        .satisfies("lies in 0..=1, to the error above", |_, f: f32| {
            (0.0..=1.0 + 16.0 * f32::EPSILON).contains(&f)
        });
}

/// The function computes a product, a sum and a division by a constant.
#[test]
fn schlick_average() {
    PBR.function("fresnel::schlick_average")
        .over(UnitRgb)
        .agrees_with(fresnel::schlick_average, Ulp(4.0));
}

/// The error of the quadrature is 5e-7 at eta = 2.5, which is 7 ulp for results between 0.2 and 1. The other 17 ulp of
/// the tolerance cover the rounding of sums whose terms have different signs.
#[test]
fn dielectric_average() {
    PBR.function("fresnel::dielectric_average")
        .over(0.4..=2.5)
        .agrees_with(fresnel::dielectric_average, Ulp(24.0));
}

/// Tests indices of refraction near 1, for which the closed form of the average reflectance F loses all digits in f32.
/// For eta < 1, the formula F(eta) = 1 - eta^2 (1 - F(1 / eta)) would lose most digits.
#[test]
fn dielectric_average_of_almost_no_interface() {
    for side in [0.999..=1.0, 1.0..=1.001] {
        PBR.function("fresnel::dielectric_average")
            .over(side)
            .agrees_with(fresnel::dielectric_average, Ulp(24.0));
    }
}

/// Each reflectance is largest at grazing angles. Each operation of Schlick's formula is monotone, even after rounding.
/// Results of `dielectric` may be too large or too small by the 24 ulp of the function's own check, so the tolerance is
/// 48 ulp.
#[test]
fn reflectance_rises_toward_grazing() {
    PBR.function("fresnel::schlick").over((UnitRgb, 0.0..=1.0)).is_monotone_in(
        "v_dot_h",
        Trend::Decreasing,
        Ulp(2.0),
    );
    // Reflectance falls towards an angle only for polarised light.
    PBR.function("fresnel::dielectric").over((1.2..=2.5, 0.0..=1.0)).is_monotone_in(
        1,
        Trend::Decreasing,
        Ulp(48.0),
    );
}

/// The average reflectance rises with the medium's index of refraction.
#[test]
fn reflectance_rises_with_the_index() {
    PBR.function("fresnel::dielectric_average").over(1.0..=2.5).is_monotone_in(
        0,
        Trend::Increasing,
        Ulp(48.0),
    );
}

/// An interface to almost the same medium reflects almost nothing: about (eta - 1)^2 / (4 c^4). In the last step of the
/// test, eta is 1.003, so for the smallest cosine, c = 0.2, the reflectance is 1.4e-3.
#[test]
fn no_interface_reflects_nothing() {
    PBR.function("fresnel::dielectric").over((Just(1.0), 0.2..=1.0)).at_limit(
        0,
        Limit::toward(1.0, [1.1, 1.03, 1.01, 1.003]),
        |_: f64, _: f64| 0.0,
        Abs(2e-3),
    );
}
