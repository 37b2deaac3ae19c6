//! Tests distributions of microfacet normals against the formulas of the papers.

use glam::Vec3;
use karat::prelude::*;
use shaders::{PBR, distribution};

/// Widths of the distribution, from the smallest width that the library accepts to the widest lobe.
const ALPHA: std::ops::RangeInclusive<f32> = 1e-4..=1.0;

/// A bound for values of D that WGSL may flush to 0: the smallest normal f32 (1.2e-38) times the peak of the lobe,
/// 1 / (pi alpha^2), which is at most 3.2e7.
const VANISHED: Abs = Abs(1e-30);

/// The tolerance for lobes with an exponential. WGSL allows exp(x) an error of 3 + 2 abs(x) ulp. The error of x, from a
/// division of 2.5 ulp and two products, adds 5 abs(x) ulp. The shader returns 0 for x <= -87, so both errors together
/// are at most 612 ulp. With the errors of the other factors, the result stays within 640 ulp, or 7.6e-5.
const EXPONENTIAL: Ulp = Ulp(640.0);

/// Pairs of a normal and a half vector on the normal's side of the surface. Some half vectors are close to the normal,
/// so that they are inside narrow lobes.
fn pairs() -> impl Domain<Value = (Vec3, Vec3)> {
    (UnitVector, UnitVector, 1e-5..=1.0_f32)
        .map(|(n, other, share)| {
            let h =
                n.as_dvec3().lerp(other.as_dvec3(), f64::from(share)).normalize_or(n.as_dvec3());
            (n, h.as_vec3())
        })
        .filter(|(n, h)| {
            // If a cosine is below its rounding error, the order of three products decides its sign. A small cosine has
            // few correct digits, and Beckmann's D contains its fourth power.
            n.as_dvec3().dot(h.as_dvec3()) > 1e-2
        })
}

/// D of GGX contains a squared quotient. Squaring doubles the 2.5 ulp of the division and the rounding errors of
/// numerator and denominator. Two other products are rounded, too.
#[test]
fn ggx() {
    PBR.function("distribution::ggx")
        .over((ALPHA, -1.0..=1.0))
        .agrees_with(distribution::ggx, Ulp(14.0));
}

/// sin^2 has the errors of a difference, two products and a sum. The cosine is a sum of products and at least 0.01, so
/// its relative error is at most 1e-7 / 0.01. This error hardly matters, because at such small cosines alpha^2 cos^2 is
/// at most 1e-4 of sin^2.
#[test]
fn ggx_from_vectors() {
    PBR.function("distribution::ggx_from_vectors")
        .over((ALPHA, pairs()).map(|(alpha, (n, h))| (alpha, n, h)))
        .agrees_with(distribution::ggx_from_vectors, Ulp(24.0));
}

#[test]
fn beckmann() {
    PBR.function("distribution::beckmann")
        .over((ALPHA, -1.0..=1.0))
        .agrees_with(distribution::beckmann, Tolerance::from(EXPONENTIAL).or(VANISHED));
}

/// The exponent is tan^2 / alpha^2. Where D isn't 0, the exponent is at most 87, so tan^2 < 87 and N.H > 0.1. The
/// relative error of the dot product N.H is then at most 1e-7 / 0.1 = 1e-6. The exponent has twice this relative error,
/// so the relative error of D is at most 2 * 87 * 1e-6.
#[test]
fn beckmann_from_vectors() {
    PBR.function("distribution::beckmann_from_vectors")
        .over((ALPHA, pairs()).map(|(alpha, (n, h))| (alpha, n, h)))
        .agrees_with(distribution::beckmann_from_vectors, Rel(2e-4).or(VANISHED));
}

/// The shader computes the logarithm of the cosine by a series below 60 degrees, with an error of 4 ulp, and by WGSL's
/// `log` above 60 degrees, with an error of 3 ulp.
#[test]
fn blinn_phong() {
    let exponent = ALPHA.map(|alpha| 2.0 / (alpha * alpha) - 2.0);
    PBR.function("distribution::blinn_phong")
        .over((exponent, -1.0..=1.0))
        .agrees_with(distribution::blinn_phong, Tolerance::from(EXPONENTIAL).or(VANISHED));
    PBR.function("distribution::blinn_phong")
        .over((0.0..=300.0, -1.0..=1.0))
        .agrees_with(distribution::blinn_phong, Tolerance::from(EXPONENTIAL).or(VANISHED));
}

/// The function computes 1 - alpha and 1 + alpha, which are exact or have an error of half an ulp, and then products
/// and a division.
#[test]
fn blinn_phong_exponent() {
    PBR.function("distribution::blinn_phong_exponent")
        .over(ALPHA)
        .agrees_with(distribution::blinn_phong_exponent, Ulp(6.0));
}

/// N.H of two equal unit vectors often rounds to a number just above 1, where a GGX formula without a guard has a pole:
/// at alpha = 3.45e-4, sin^2 = -alpha^2.
#[test]
fn cosines_that_round_above_one() {
    let above_one =
        || OneOf((0..=8_u32).map(|steps| f32::from_bits(1.0_f32.to_bits() + steps)).collect());
    PBR.function("distribution::ggx")
        .over((ALPHA, above_one()))
        .agrees_with(distribution::ggx, Ulp(14.0));
    PBR.function("distribution::beckmann")
        .over((ALPHA, above_one()))
        .agrees_with(distribution::beckmann, Tolerance::from(EXPONENTIAL).or(VANISHED));
    PBR.function("distribution::blinn_phong").over((0.0..=1e4, above_one())).satisfies(
        "is the peak, to 1 %",
        |(exponent, _), d: f32| {
            let peak = (exponent + 2.0) / std::f32::consts::TAU;
            (d / peak - 1.0).abs() < 0.01
        },
    );
}

/// For each exponent, the function treats a cosine just above 1 like the cosine that is equally far below 1. If the
/// cosine is 1 + d, where d is at most 1e-6, tan^2 of half the angle has a relative error of d. The lobe contains
/// exp(-x) with x up to 87, so this error adds up to 9e-5 to the error of the exponential.
// Lesson 31
#[test]
fn blinn_phong_mirrors_cosines_above_one() {
    let above_one = OneOf((1..=8_u32).map(|i| f32::from_bits(1.0_f32.to_bits() + i)).collect());
    PBR.function("distribution::blinn_phong")
        .over((ALPHA.map(|alpha| 2.0 / (alpha * alpha) - 2.0), above_one))
        .agrees_with(
            |exponent: f64, n_dot_h: f64| distribution::blinn_phong(exponent, 2.0 - n_dot_h),
            Rel(1.7e-4).or(VANISHED),
        );
}

/// D is 0 at the horizon and below the horizon, although the formula of GGX approaches alpha^2 / pi at the horizon.
#[test]
fn lobes_end_at_the_horizon() {
    let perpendicular = (ALPHA, UnitVector)
        .filter(|(_, d): &(f32, Vec3)| d.x != 0.0 || d.y != 0.0)
        .map(|(alpha, d)| (alpha, Vec3::Z, Vec3::new(d.x, d.y, 0.0).normalize()));
    for function in ["distribution::ggx_from_vectors", "distribution::beckmann_from_vectors"] {
        PBR.function(function).over(&perpendicular).satisfies("is 0", |_, d: f32| d == 0.0);
        // At cosines of 1e-6 and more, the dot product of three terms has the right sign.
        let below = (ALPHA, UnitVector, UnitVector)
            .filter(|(_, n, h): &(f32, Vec3, Vec3)| n.as_dvec3().dot(h.as_dvec3()) < -1e-6);
        PBR.function(function).over(below).satisfies("is 0 below", |_, d: f32| d == 0.0);
    }
    for function in ["distribution::ggx", "distribution::beckmann"] {
        PBR.function(function).over((ALPHA, Just(0.0))).satisfies("is 0", |_, d: f32| d == 0.0);
    }
    PBR.function("distribution::blinn_phong")
        .over((0.0..=1e4, Just(0.0)))
        .satisfies("is 0", |_, d: f32| d == 0.0);
}

/// At the pole, where both vectors are equal, D is 1 / (pi alpha^2).
#[test]
fn equal_vectors_are_at_the_peak() {
    for function in ["distribution::ggx_from_vectors", "distribution::beckmann_from_vectors"] {
        PBR.function(function).over((ALPHA, UnitVector).map(|(alpha, n)| (alpha, n, n))).satisfies(
            "is 1 / (pi alpha^2), but for the length of the vector",
            |(alpha, ..), d: f32| {
                let peak = 1.0 / (std::f64::consts::PI * f64::from(alpha).powi(2));
                (f64::from(d) / peak - 1.0).abs() < 3e-6
            },
        );
    }
}

/// D depends only on the angle between the two vectors, so swapping the vectors doesn't change D. The tolerance is
/// twice the tolerance of the function's own check, because both results have an error.
#[test]
fn lobes_are_symmetric_in_their_vectors() {
    let swapped = |(alpha, n, h)| (alpha, h, n);
    PBR.function("distribution::ggx_from_vectors")
        .over((ALPHA, pairs()).map(|(alpha, (n, h))| (alpha, n, h)))
        .invariant_under(swapped, Ulp(48.0));
    PBR.function("distribution::beckmann_from_vectors")
        .over((ALPHA, pairs()).map(|(alpha, (n, h))| (alpha, n, h)))
        .invariant_under(swapped, Rel(4e-4).or(VANISHED));
}

/// Each lobe has one peak: D rises with N.H up to the pole. For Beckmann, this holds if 2 alpha^2 is at most 1. A wider
/// Beckmann lobe has its peak on a ring around the pole, where cos^2 = 1 / (2 alpha^2), because the fourth power of the
/// cosine outweighs the exponential. The tolerance is twice the tolerance of the function's own check, because both
/// compared results have an error.
#[test]
fn lobes_rise_to_their_pole() {
    let up = Trend::Increasing;
    let exponential = || Ulp(2.0 * EXPONENTIAL.0).or(VANISHED);
    PBR.function("distribution::ggx").over((ALPHA, -1.0..=1.0)).is_monotone_in(
        "n_dot_h",
        up,
        Ulp(28.0),
    );
    let beckmann = |alpha| PBR.function("distribution::beckmann").over((alpha, -1.0..=1.0));
    beckmann(1e-4..=0.7).is_monotone_in("n_dot_h", up, exponential());
    let ring = beckmann(0.8..=1.0).unrecorded().try_is_monotone_in("n_dot_h", up, exponential());
    assert!(matches!(ring, Err(karat::check::Failure::Disagreement(_))), "{ring:?}");
    PBR.function("distribution::blinn_phong").over((0.0..=300.0, -1.0..=1.0)).is_monotone_in(
        "n_dot_h",
        up,
        exponential(),
    );
}

/// All microfacets of a mirror have the normal at the pole, so D is 0 in other directions. More than 18 degrees away
/// from the pole, D of a narrow lobe is at most alpha^2 / (pi sin^4), which approaches 0 with alpha.
#[test]
fn the_lobe_of_a_mirror_is_its_pole() {
    let beside = |_: f64, _: f64| 0.0;
    let limit = Limit::toward(0.0, [0.1, 0.03, 0.01, 0.003, 0.001]);
    PBR.function("distribution::ggx").over((Just(0.0), 0.0..=0.95)).at_limit(
        "alpha",
        limit,
        beside,
        Abs(4e-5),
    );
}

/// D depends only on the angle between the vectors, not on their directions. Rotating both vectors rounds their
/// components by up to 1e-7. The lobes are at least 1e-2 wide, so this rounding changes D by at most 1e-4 of its value.
#[test]
fn lobes_turn_with_their_normal() {
    let turned = |q: glam::DQuat, d: Vec3| (q * d.as_dvec3()).as_vec3();
    PBR.function("distribution::ggx_from_vectors")
        .over((1e-2..=1.0_f32, pairs()).map(|(alpha, (n, h))| (alpha, n, h)))
        .equivariant_under(
            move |(alpha, n, h), q| (alpha, turned(q, n), turned(q, h)),
            |d: f32, _| f64::from(d),
            Rel(1e-4),
        );
}

/// The projected areas of all microfacets add up to the area of the surface: the integral of D cos is 1.
#[test]
fn lobes_cover_the_surface() {
    let package = Package::from_modules(
        "lobes",
        [("lobes", "import pbr::distribution::ggx;\nfn lobe(alpha: f32, h: vec3f) -> f32 { return ggx(alpha, h.z); }")],
    )
    .depends_on("pbr", &PBR);
    package.function("lobes::lobe").over(0.2..=1.0).integrates_to(
        Directions::projected_hemisphere().rings(96),
        |_| 1.0,
        Abs(1e-5),
    );
}
