//! Tests samplers against the formulas of the papers.

use glam::{DVec2, Mat3, UVec2, UVec3, Vec2, Vec3};
use karat::prelude::*;
use shaders::{PBR, math, sampling};

use crate::drivers::{SHORT_HALFWAY, SWIFTSHADER};

/// Points of the unit square, including its border, because a bit-reversed counter of 32 bits may round to 1.
fn unit_square() -> impl Domain<Value = Vec2> {
    (0.0..=1.0_f32, 0.0..=1.0_f32).map(|(x, y)| Vec2::new(x, y))
}

/// WGSL allows sin and cos an error of 2^-11 = 4.9e-4 on [-pi, pi], and a portable shader can't rely on a smaller
/// error. The samplers multiply sin and cos by at most 1, so their results have the same error.
const TRIGONOMETRIC: Abs = Abs(6e-4);

#[test]
fn uniform_hemisphere() {
    PBR.function("sampling::uniform_hemisphere")
        .over(unit_square())
        .agrees_with(sampling::uniform_hemisphere, TRIGONOMETRIC);
}

/// The height of the sampled direction is exact, because it doesn't depend on sine and cosine.
#[test]
fn uniform_hemisphere_takes_its_height_from_u() {
    PBR.function("sampling::uniform_hemisphere")
        .over(unit_square())
        .satisfies("has height u.y", |u, direction: Vec3| direction.z == u.y);
}

/// Tests the means of the cosine and of its square for sampled directions. The cosine is `u.y` for one sampler, and the
/// square root of `u.y` for the other. The test computes each mean from 256 evenly spaced values of `u.y`. The mean of
/// the square root then has an error of 0.2 / 256^1.5 = 5e-5, and the mean of the square an error of 1 / (12 * 256^2).
#[test]
fn moments_of_the_cosine() {
    let package = Package::from_source(
        "moments",
        "import library::sampling::{cosine_hemisphere, uniform_hemisphere};\n\n\
         fn of_uniform(u: vec2f) -> vec2f {\n    \
             let z = uniform_hemisphere(u).z;\n    return vec2f(z, z * z);\n}\n\n\
         fn of_cosine(u: vec2f) -> vec2f {\n    \
             let z = cosine_hemisphere(u).z;\n    return vec2f(z, z * z);\n}\n",
    )
    .depends_on("library", &PBR);
    let midpoints = |azimuth: &f32| -> Vec<(Vec2, f64)> {
        let row = |i: u16| Vec2::new(*azimuth, (f32::from(i) + 0.5) / 256.0);
        (0..256).map(|i| (row(i), 1.0 / 256.0)).collect()
    };
    for (sampler, moments) in
        [("of_uniform", [1.0 / 2.0, 1.0 / 3.0]), ("of_cosine", [2.0 / 3.0, 0.5])]
    {
        package
            .function(sampler)
            .integral(0.0..=1.0_f32, midpoints)
            .agrees_with(|_| DVec2::from_array(moments), Abs(1e-4));
    }
}

#[test]
fn uniform_hemisphere_pdf() {
    PBR.function("sampling::uniform_hemisphere_pdf")
        .over(-1.0..=1.0)
        .agrees_with(sampling::uniform_hemisphere_pdf, Ulp(1.0));
}

#[test]
fn ggx_normal() {
    // For alpha below 1e-4, except for 0 (a mirror), alpha^2 vanishes beside 1 in f32.
    let alpha = (1e-4..=1.0_f32).map(|alpha| if alpha < 2e-4 { 0.0 } else { alpha });
    PBR.function("sampling::ggx_normal")
        .over((alpha, unit_square()))
        .agrees_with(sampling::ggx_normal, TRIGONOMETRIC);
}

/// Widths of the distributions, from the smallest width that the library accepts to the widest lobe.
const ALPHA: std::ops::RangeInclusive<f32> = 1e-4..=1.0;

/// The tolerance for tiny densities. WGSL may flush them to 0, which has no visible effect.
const UNDERFLOW: Abs = Abs(1e-30);

/// The largest f32 below 1. No sequence of random numbers in the library has a larger number.
const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;

/// Points of the unit square with `y` below 1.
fn half_open_square() -> impl Domain<Value = Vec2> {
    (0.0..=1.0_f32, 0.0..=BELOW_ONE).map(|(x, y)| Vec2::new(x, y))
}

#[test]
fn turned() {
    PBR.function("sampling::turned")
        .over((0.0..=1.0, 0.0..=1.0, 0.0..=1.0))
        .agrees_with(sampling::turned, TRIGONOMETRIC);
}

#[test]
fn cosine_hemisphere() {
    PBR.function("sampling::cosine_hemisphere")
        .over(unit_square())
        .agrees_with(sampling::cosine_hemisphere, TRIGONOMETRIC);
}

/// Sampled directions are above the horizon, so their density is positive, and an estimator can divide by the density.
#[test]
fn cosine_hemisphere_stays_above_the_horizon() {
    PBR.function("sampling::cosine_hemisphere")
        .over(half_open_square())
        .satisfies("lies above the horizon", |_, l: Vec3| l.z >= 2.4e-4);
}

/// The function computes one division.
#[test]
fn cosine_hemisphere_pdf() {
    PBR.function("sampling::cosine_hemisphere_pdf")
        .over(-1.0..=1.0)
        .agrees_with(sampling::cosine_hemisphere_pdf, Ulp(4.0));
}

/// Pairs of a width and a normal. Two thirds of the normals come from the GGX sampler, so they are near the peak even
/// for narrow lobes. The other normals have any direction, even below the horizon.
fn normals() -> impl Domain<Value = (f32, Vec3)> {
    (ALPHA, unit_square(), UnitVector, Integers(0..=2_u32)).map(|(alpha, u, any, choice)| {
        let (widened, u) = (f64::from(alpha), u.as_dvec2());
        let h = if choice == 0 { any } else { sampling::ggx_normal(widened, u).as_vec3() };
        (alpha, h)
    })
}

/// The function computes sums of squares (3 ulp) and a division (2.5 ulp), squares the quotient, divides by pi and
/// multiplies by the cosine.
#[test]
fn ggx_normal_pdf() {
    PBR.function("sampling::ggx_normal_pdf")
        .over(normals())
        .agrees_with(sampling::ggx_normal_pdf, Ulp(20.0).or(UNDERFLOW));
}

/// WGSL allows `exp(x)` an error of `3 + 2 * abs(x)` ulp. Here, `abs(x)` is at most 87 and `x` has an error of about 6
/// ulp. All errors together are `87 * (2 + 6) + 20` ulp.
#[test]
fn beckmann_normal_pdf() {
    PBR.function("sampling::beckmann_normal_pdf")
        .over(normals())
        .agrees_with(sampling::beckmann_normal_pdf, Rel(5e-5).or(UNDERFLOW));
    let near = (ALPHA, half_open_square()).map(|(alpha, u)| {
        (alpha, sampling::beckmann_normal(f64::from(alpha), u.as_dvec2()).as_vec3())
    });
    PBR.function("sampling::beckmann_normal_pdf")
        .over(near)
        .agrees_with(sampling::beckmann_normal_pdf, Rel(2e-5).or(UNDERFLOW));
}

#[test]
fn beckmann_normal() {
    PBR.function("sampling::beckmann_normal")
        .over((0.0..=1.0, half_open_square()))
        .agrees_with(sampling::beckmann_normal, TRIGONOMETRIC);
}

/// WGSL allows `log` an absolute error of 2^-21 = 4.8e-7 near 1, and 3 ulp elsewhere. For arguments below 0.1 the
/// shader uses a series. At 0.1 the result is 0.105, so the relative error of `log` is at most 4.5e-6. The series has
/// only the error of one division, whose result WGSL may flush to 0.
#[test]
fn minus_log_of_rest() {
    PBR.function("sampling::minus_log_of_rest")
        .over(0.0..=BELOW_ONE)
        .agrees_with(sampling::minus_log_of_rest, Rel(6e-6).or(UNDERFLOW));
    PBR.function("sampling::minus_log_of_rest").over(0.0..=0.099).agrees_with(
        sampling::minus_log_of_rest,
        Ulp(8.0).or(Abs(2.0 * f64::from(f32::MIN_POSITIVE))),
    );
}

/// Arguments `alpha`, `v` and `u` of `ggx_visible_normal`. `v` is any direction down to the horizon.
fn seen_normals() -> impl Domain<Value = (f32, Vec3, Vec2)> {
    (ALPHA, Hemisphere, half_open_square())
}

/// The length of the halfway vector from which the shader computes the normal. The shader first stretches the
/// distribution of normals to a hemisphere. There, the length is twice the cosine between the view and the normal.
fn halfway_length(alpha: f32, v: Vec3, u: Vec2) -> f64 {
    let (alpha, v, u) = (f64::from(alpha), v.as_dvec3(), u.as_dvec2());
    let h = sampling::ggx_visible_normal(alpha, v, u);
    let unstretched = (h.truncate() / alpha).extend(h.z).normalize();
    let stretched = (v.truncate() * alpha).extend(v.z).normalize();
    2.0 * stretched.dot(unstretched)
}

/// The error of sin and cos moves the halfway vector by at most 2^-11. The shorter the vector is, the more this error
/// turns the normal. So the test leaves out normals at more than 83 degrees from the view, one in 64. The other halfway
/// vectors are at least 1/4 long, so the error is at most 4.9e-4 / (1/4).
#[test]
fn ggx_visible_normal() {
    let domain = seen_normals().filter(|(alpha, v, u)| halfway_length(*alpha, *v, *u) > 0.25);
    PBR.function("sampling::ggx_visible_normal")
        .over(domain)
        .agrees_with(sampling::ggx_visible_normal, Abs(2e-3));
}

/// Sampled normals are on the side of the view, even the normals that the test `ggx_visible_normal` leaves out. A
/// halfway vector of length s has a component of s^2 / 2 along the view. The error of sin and cos reduces this
/// component by at most sqrt(2) 2^-11. If s is at least 0.04, the component stays positive on each driver.
#[test]
fn visible_normals_are_visible() {
    let visible = |(_, v, _): (f32, Vec3, Vec2), h: Vec3| {
        (h.length() - 1.0).abs() < 1e-6 && h.z > 0.0 && v.dot(h) > -1e-6
    };
    let statement = "is a unit vector of the upper hemisphere, on the side of the view";
    let long = seen_normals().filter(|(alpha, v, u)| halfway_length(*alpha, *v, *u) > 0.04);
    PBR.function("sampling::ggx_visible_normal").over(long).satisfies(statement, visible);
    PBR.function("sampling::ggx_visible_normal")
        .over(seen_normals())
        .fails_on(SWIFTSHADER, SHORT_HALFWAY)
        .satisfies(statement, visible);
}

/// From straight above, all facets are visible, so `ggx_visible_normal` and `ggx_normal` return the same normals.
#[test]
fn all_normals_are_visible_from_above() {
    let domain = (ALPHA, Just(Vec3::Z), half_open_square());
    PBR.function("sampling::ggx_visible_normal").over(domain).agrees_with(
        |alpha: f64, _: glam::DVec3, u: DVec2| sampling::ggx_normal(alpha, u),
        TRIGONOMETRIC,
    );
}

/// V.H has a rounding error of 1e-7, which is a relative error of 1e-5 at V.H = 0.01. If V.H is negative, the density
/// is 0. The test leaves out normals with V.H between -0.01 and 0.01.
#[test]
fn ggx_visible_normal_pdf() {
    let domain = (Hemisphere, normals())
        .map(|(v, (alpha, h))| (alpha, v, h))
        .filter(|(_, v, h)| v.dot(*h).abs() > 0.01);
    PBR.function("sampling::ggx_visible_normal_pdf")
        .over(domain)
        .agrees_with(sampling::ggx_visible_normal_pdf, Rel(2e-5).or(UNDERFLOW));
}

#[test]
fn sampled_directions_have_unit_length() {
    // sin^2 + cos^2 has up to twice the error of sin and of cos.
    let unit = |length: f32| (length - 1.0).abs() <= 1e-3;
    PBR.function("sampling::uniform_hemisphere")
        .over(unit_square())
        .satisfies("has unit length", |_, direction: Vec3| unit(direction.length()));
    PBR.function("sampling::ggx_normal")
        .over((1e-4..=1.0, unit_square()))
        .satisfies("has unit length", |_, normal: Vec3| unit(normal.length()));
    PBR.function("sampling::cosine_hemisphere")
        .over(unit_square())
        .satisfies("has unit length", |_, direction: Vec3| unit(direction.length()));
    PBR.function("sampling::beckmann_normal")
        .over((0.0..=1.0, half_open_square()))
        .satisfies("has unit length", |_, normal: Vec3| unit(normal.length()));
}

/// The shader keeps the highest 24 bits, which fit into an f32. The reference keeps all 32 bits, so the results may
/// differ by 2^-24.
#[test]
fn radical_inverse() {
    PBR.function("sampling::radical_inverse")
        .over(Integers(0..=u32::MAX))
        .agrees_with(sampling::radical_inverse, Abs(2.0_f64.powi(-24)));
    PBR.function("sampling::radical_inverse")
        .over(Integers(0..=u32::MAX))
        .satisfies("lies in [0, 1)", |_, x: f32| (0.0..1.0).contains(&x));
}

/// An index `i` and a number of points `n`, with `i < n`. `n` is at most 2^22, more than renderers use.
fn counters() -> impl Domain<Value = (u32, u32)> {
    (0.0..=1.0_f32, Integers(1..=1_u32 << 22))
        .map(|(share, n)| (((share * n as f32) as u32).min(n - 1), n))
}

/// The function computes one division, with an error of 2.5 ulp. Its radical inverse drops the bits below 2^-24.
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

/// The length of the normal differs from 1 by up to 1e-7, so the basis has a similar error.
#[test]
fn orthonormal_basis() {
    PBR.function("sampling::orthonormal_basis")
        .over(UnitVector)
        .agrees_with(sampling::orthonormal_basis, Abs(1e-6));
}

/// The basis is right even at the poles. The construction of Duff et al. 2017 works for all directions, while Frisvad's
/// older construction fails at -Z.
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

/// The function adds three products of numbers up to 1.
#[test]
fn to_world() {
    PBR.function("sampling::to_world")
        .over((UnitVector, UnitVector, UnitVector, UnitVector))
        .agrees_with(sampling::to_world, Abs(5e-7));
}

/// Three integers of any value.
fn triples() -> impl Domain<Value = UVec3> {
    let any = || Integers(0..=u32::MAX);
    (any(), any(), any()).map(|(x, y, z)| UVec3::new(x, y, z))
}

/// The results are integers, so they must equal the results of the reference. Integers wrap around in WGSL and in the
/// reference.
#[test]
fn hashes() {
    PBR.function("sampling::pcg").over(Integers(0..=u32::MAX)).agrees_with(sampling::pcg, Ulp(0.0));
    PBR.function("sampling::pcg3d").over(triples()).agrees_with(sampling::pcg3d, Ulp(0.0));
    PBR.function("sampling::stirred").over(triples()).agrees_with(sampling::stirred, Ulp(0.0));
}

/// Random numbers have 24 bits, which fit into an f32. So the results are exactly those of the reference, and below 1.
#[test]
fn random_numbers() {
    PBR.function("sampling::unit_float")
        .over(Integers(0..=u32::MAX))
        .agrees_with(sampling::unit_float, Ulp(0.0));
    PBR.function("sampling::random")
        .over(Integers(0..=u32::MAX))
        .agrees_with(sampling::random, Ulp(0.0));
    let pixels = (Integers(0..=8191_u32), Integers(0..=8191_u32)).map(|(x, y)| UVec2::new(x, y));
    PBR.function("sampling::random_point")
        .over((pixels, Integers(0..=u32::MAX)))
        .agrees_with(sampling::random_point, Ulp(0.0));
    PBR.function("sampling::unit_float")
        .over(Integers(0..=u32::MAX))
        .satisfies("lies in [0, 1)", |_, x: f32| (0.0..1.0).contains(&x));
}

/// The function computes three products.
#[test]
fn pow5() {
    PBR.function("math::pow5").over(-1.0..=1.0).agrees_with(math::pow5, Ulp(4.0));
}

/// Widths of lobes: the narrowest is hard to sample in f32, and the widest is 1.
fn widths() -> impl Domain<Value = f32> {
    OneOf(vec![0.01, 0.1, 0.5, 1.0])
}

/// Pairs of a width and a view. The views go from straight above to half a degree above the horizon. The horizontal
/// part of a view is never along the X or Y axis.
fn seen() -> impl Domain<Value = (f32, Vec3)> {
    let view = |degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        glam::DVec3::new(0.6 * sin, -0.8 * sin, cos).as_vec3()
    };
    (widths(), OneOf(vec![0.0, 45.0, 80.0, 89.5]))
        .map(move |(alpha, degrees)| (alpha, view(degrees)))
}

#[test]
fn uniform_hemisphere_follows_its_pdf() {
    PBR.function("sampling::uniform_hemisphere")
        .sampled_over(Just(()), |(), u: Vec2| u)
        .follows(PBR.function("sampling::uniform_hemisphere_pdf"), |(), l: Vec3| l.z);
}

#[test]
fn cosine_hemisphere_follows_its_pdf() {
    PBR.function("sampling::cosine_hemisphere")
        .sampled_over(Just(()), |(), u: Vec2| u)
        .follows(PBR.function("sampling::cosine_hemisphere_pdf"), |(), l: Vec3| l.z);
}

#[test]
fn ggx_normal_follows_its_pdf() {
    PBR.function("sampling::ggx_normal")
        .sampled_over(widths(), |&alpha, u: Vec2| (alpha, u))
        .follows(PBR.function("sampling::ggx_normal_pdf"), |&alpha, h: Vec3| (alpha, h));
}

#[test]
fn beckmann_normal_follows_its_pdf() {
    PBR.function("sampling::beckmann_normal")
        .sampled_over(widths(), |&alpha, u: Vec2| (alpha, u))
        .follows(PBR.function("sampling::beckmann_normal_pdf"), |&alpha, h: Vec3| (alpha, h));
}

#[test]
fn ggx_visible_normal_follows_its_pdf() {
    PBR.function("sampling::ggx_visible_normal")
        .sampled_over(seen(), |&(alpha, v), u: Vec2| (alpha, v, u))
        .fails_on(SWIFTSHADER, SHORT_HALFWAY) // a normal that faces away from the view has no density
        .follows(PBR.function("sampling::ggx_visible_normal_pdf"), |&(alpha, v), h: Vec3| {
            (alpha, v, h)
        });
}

/// The mean of the sampled cosine is 2/3, because the density of the cosine is 2 cos.
#[test]
fn cosine_hemisphere_has_its_mean() {
    let sampled =
        || PBR.function("sampling::cosine_hemisphere").sampled_over(Just(()), |(), u: Vec2| u);
    sampled().has_mean("cos", |l: Vec3| l.z.into(), |()| 2.0 / 3.0, 1e-6);
    sampled().has_distribution("cos", |l: Vec3| l.z.into(), |(), cos| cos * cos, 1e-6);
}

/// Tests the constants themselves. In other tests, the allowed error of sin and cos, 5e-4, would hide a pi with too few
/// digits.
#[test]
fn constants() {
    use std::f64::consts::{PI, TAU};
    let text = "import library::math::{INV_TAU, PI, TAU};\n\n\
         fn constant(i: u32) -> f32 { return array(PI, TAU, INV_TAU)[i]; }\n";
    let package = Package::from_source("constants", text).depends_on("library", &PBR);
    package
        .function("constant")
        .over(Integers(0..=2_u32))
        .agrees_with(|i: u32| [PI, TAU, 1.0 / TAU][i as usize], Ulp(0.5));
}
