//! Tests shadowing and masking against the formulas of the papers.

use karat::prelude::*;
use shaders::{PBR, geometry};

/// A product of tiny values may be below the smallest normal f32, and WGSL may flush such a product to 0. Results below
/// 1e-30 have no visible effect.
const UNDERFLOW: Abs = Abs(1e-30);

/// Widths of the distribution, from the smallest width that the library accepts to the widest lobe.
const ALPHA: std::ops::RangeInclusive<f32> = 1e-4..=1.0;

/// The function computes two products and a division, which has an error of 2.5 ulp. The test leaves out cosines for
/// which a product is denormal, because a denormal product has fewer digits, and so has the quotient.
#[test]
fn v_cavity() {
    let cosines = (0.0..=1.0, 0.0..=1.0, 0.0..=1.0, 0.0..=1.0_f32).filter(|(h, v, l, _)| {
        let product = h * v.min(*l);
        product == 0.0 || product >= f32::MIN_POSITIVE
    });
    PBR.function("geometry::v_cavity")
        .over(cosines)
        .agrees_with(geometry::v_cavity, Ulp(4.0).or(UNDERFLOW));
}

/// If V.H is 0, the lecture's formula divides by 0 (mistake P2 in `shaders/README.md`). The library's function returns
/// 1.
#[test]
fn nothing_is_hidden_where_v_dot_h_vanishes() {
    PBR.function("geometry::v_cavity")
        .over((0.0..=1.0, 0.0..=1.0, 0.0..=1.0, Just(0.0)))
        .satisfies("is 1", |_, g: f32| g == 1.0);
}

/// The function computes two quotients of products, each with an error of 2.5 ulp. The larger cosine is at least 1e-18.
/// The smaller cosine goes down to the smallest normal f32, for which the product 4 N.V N.L underflows to 0. The test's
/// V.H and N.H are at least half the sum of N.V and N.L, which is true for every half vector.
#[test]
fn v_cavity_visibility() {
    let cosines = (-18.0..=0.0_f32, -37.9..=0.0_f32, 0.0..=1.0_f32, 0.0..=1.0_f32, 0.0..=1.0_f32)
        .map(|(larger, smaller, n_dot_h, v_dot_h, swapped)| {
            let (larger, smaller) = (10.0_f32.powf(larger), 10.0_f32.powf(smaller));
            let (larger, smaller) = (larger.max(smaller), smaller.min(larger));
            let least = 0.5 * (larger + smaller);
            let between = |share: f32| least + share * (1.0 - least);
            let (v, l) = if swapped < 0.5 { (larger, smaller) } else { (smaller, larger) };
            (between(n_dot_h), v, l, between(v_dot_h))
        });
    PBR.function("geometry::v_cavity_visibility")
        .over(cosines)
        .agrees_with(geometry::v_cavity_visibility, Ulp(8.0));
}

/// WGSL allows `sqrt` the error of `1 / inverseSqrt`, 4.5 ulp. With the errors of the sum under the root and of the
/// division, the result has an error of up to 10 ulp.
#[test]
fn smith_g1() {
    PBR.function("geometry::smith_g1")
        .over((ALPHA, 0.0..=1.0))
        .agrees_with(geometry::smith_g1, Ulp(10.0));
}

/// The function returns the product of two results of `smith_g1`, so the error is twice the error of `smith_g1`, plus
/// one rounding.
#[test]
fn smith_separable() {
    PBR.function("geometry::smith_separable")
        .over((ALPHA, 0.0..=1.0, 0.0..=1.0))
        .agrees_with(geometry::smith_separable, Ulp(20.0).or(UNDERFLOW));
}

/// The function computes two square roots, divides each by a cosine, adds the quotients and divides again. Nothing
/// cancels.
// Lesson 25
#[test]
fn smith_correlated() {
    PBR.function("geometry::smith_correlated")
        .over((ALPHA, 0.0..=1.0, 0.0..=1.0))
        .agrees_with(geometry::smith_correlated, Ulp(16.0).or(UNDERFLOW));
}

/// The function has the same errors as `smith_correlated`, because it computes nearly the same operations in another
/// order.
#[test]
fn smith_correlated_visibility() {
    // Leaves out pairs of tiny cosines with a denormal product.
    let cosines = (0.0..=1.0, 0.0..=1.0_f32).filter(|(v, l)| v.min(*l) == 0.0 || v.min(*l) > 1e-30);
    PBR.function("geometry::smith_correlated_visibility")
        .over((ALPHA, cosines).map(|(alpha, (v, l))| (alpha, v, l)))
        .agrees_with(geometry::smith_correlated_visibility, Ulp(16.0));
}

/// The function computes two quotients of sums of positive terms.
#[test]
fn smith_schlick_ggx() {
    PBR.function("geometry::smith_schlick_ggx")
        .over((ALPHA, 0.0..=1.0, 0.0..=1.0))
        .agrees_with(geometry::smith_schlick_ggx, Ulp(12.0).or(UNDERFLOW));
}

/// The approximation of erf(a) has an error of 1.5e-7. The denominator of G1 contains `a * erf(a)` and is at least
/// `2a`, so the relative error of G1 is at most half of 1.5e-7. The other 14 ulp come from the exponential (5 ulp at a
/// = 1), a square root and divisions.
#[test]
fn smith_g1_beckmann() {
    PBR.function("geometry::smith_g1_beckmann")
        .over((ALPHA, 0.0..=1.0))
        .agrees_with(geometry::smith_g1_beckmann, Rel(2e-6).or(UNDERFLOW));
}

/// At the horizon, nothing is visible, so the result must be 0. The papers' formulas give 0 / 0 there for a mirror.
#[test]
fn nothing_is_visible_at_the_horizon() {
    for function in ["geometry::smith_g1", "geometry::smith_g1_beckmann"] {
        PBR.function(function).over((0.0..=1.0, Just(0.0))).satisfies("is 0", |_, g: f32| g == 0.0);
    }
    for function in [
        "geometry::smith_separable",
        "geometry::smith_correlated",
        "geometry::smith_correlated_visibility",
        "geometry::smith_schlick_ggx",
    ] {
        let v = (0.0..=1.0, Just(0.0), 0.0..=1.0);
        PBR.function(function).over(v).satisfies("is 0 for v", |_, g: f32| g == 0.0);
        let l = (0.0..=1.0, 0.0..=1.0, Just(0.0));
        PBR.function(function).over(l).satisfies("is 0 for l", |_, g: f32| g == 0.0);
    }
}

/// N.V of two equal unit vectors often rounds to a number just above 1, where 1 - cos^2 is negative. The tangent of
/// such an angle is below 1.5e-3, so the surface hides nothing, and the result is 1.
// Lesson 31
#[test]
fn cosines_that_round_above_one() {
    let above_one = OneOf((1..=8_u32).map(|i| f32::from_bits(1.0_f32.to_bits() + i)).collect());
    PBR.function("geometry::smith_g1_beckmann")
        .over((ALPHA, above_one))
        .agrees_with(|_: f64, _: f64| 1.0, Ulp(0.0));
}

/// Exchanging v and l changes no result.
#[test]
fn masking_is_symmetric_in_v_and_l() {
    for function in
        ["geometry::smith_separable", "geometry::smith_correlated", "geometry::smith_schlick_ggx"]
    {
        PBR.function(function)
            .over((ALPHA, 0.0..=1.0, 0.0..=1.0))
            .invariant_under(|(alpha, v, l)| (alpha, l, v), Ulp(2.0));
    }
    PBR.function("geometry::v_cavity")
        .over((0.0..=1.0, 0.0..=1.0, 0.0..=1.0, 0.0..=1.0))
        .invariant_under(|(h, v, l, v_dot_h)| (h, l, v, v_dot_h), Ulp(0.0));
}

/// Each masking function returns a probability, a number in 0..=1.
#[test]
fn masking_is_a_probability() {
    // The functions return products of two quotients, and WGSL allows a division 2.5 ulp.
    let rounding = 6.0 * f32::EPSILON;
    for function in
        ["geometry::smith_separable", "geometry::smith_correlated", "geometry::smith_schlick_ggx"]
    {
        PBR.function(function)
            .over((ALPHA, 0.0..=1.0, 0.0..=1.0))
            .satisfies("lies in 0..=1", move |_, g: f32| (0.0..=1.0 + rounding).contains(&g));
    }
    PBR.function("geometry::smith_g1_beckmann")
        .over((ALPHA, 0.0..=1.0))
        .satisfies("lies in 0..=1", |_, g: f32| (0.0..=1.0 + f32::EPSILON).contains(&g));
}

/// A surface hides more of itself as the view becomes more grazing and as the distribution becomes wider. The tolerance
/// is twice the tolerance of the function's own check, because both compared results have an error.
#[test]
fn masking_grows_toward_grazing_and_with_the_width() {
    for (function, ulp) in [("geometry::smith_g1", 20.0), ("geometry::smith_g1_beckmann", 40.0)] {
        let over = || PBR.function(function).over((ALPHA, 0.0..=1.0));
        over().is_monotone_in(1, Trend::Increasing, Ulp(ulp).or(UNDERFLOW));
        over().is_monotone_in("alpha", Trend::Decreasing, Ulp(ulp).or(UNDERFLOW));
    }
    for (function, ulp) in [
        ("geometry::smith_separable", 40.0),
        ("geometry::smith_correlated", 32.0),
        ("geometry::smith_schlick_ggx", 24.0),
    ] {
        let over = || PBR.function(function).over((ALPHA, 0.0..=1.0, 0.0..=1.0));
        over().is_monotone_in("n_dot_v", Trend::Increasing, Ulp(ulp).or(UNDERFLOW));
        over().is_monotone_in("n_dot_l", Trend::Increasing, Ulp(ulp).or(UNDERFLOW));
        over().is_monotone_in("alpha", Trend::Decreasing, Ulp(ulp).or(UNDERFLOW));
    }
    PBR.function("geometry::v_cavity")
        .over((0.0..=1.0, 0.0..=1.0, 0.0..=1.0, 0.0..=1.0))
        .is_monotone_in("n_dot_v", Trend::Increasing, Ulp(8.0).or(UNDERFLOW));
}

/// A mirror hides nothing. For a narrow lobe and one direction, 1 - G1 is at most (alpha tan)^2 / 4. For alpha = 1e-4
/// and cosines above 0.05, this is 1e-6. Karis's formula with k = alpha / 2 hides more: alpha / (2 cos) for each
/// direction.
#[test]
fn a_mirror_hides_nothing() {
    let limit = || Limit::toward(0.0, [1e-1, 1e-2, 1e-3, 1e-4]);
    for function in ["geometry::smith_g1", "geometry::smith_g1_beckmann"] {
        let unmasked = |_: f64, _: f64| 1.0;
        PBR.function(function).over((Just(0.0), 0.05..=1.0)).at_limit(
            "alpha",
            limit(),
            unmasked,
            Abs(5e-5),
        );
    }
    for (function, left) in [
        ("geometry::smith_separable", 1e-4),
        ("geometry::smith_correlated", 1e-4),
        ("geometry::smith_schlick_ggx", 2e-3),
    ] {
        let unmasked = |_: f64, _: f64, _: f64| 1.0;
        PBR.function(function).over((Just(0.0), 0.05..=1.0, 0.05..=1.0)).at_limit(
            "alpha",
            limit(),
            unmasked,
            Abs(left),
        );
    }
}
