//! Tests complete BRDFs: the BRDFs agree with the formulas of the papers, are reciprocal, and never return more light
//! than arrives.

use glam::{DVec3, Vec2, Vec3};
use karat::check::Failure;
use karat::prelude::*;
use shaders::{PBR, brdf};

/// Widths of the distribution, from the smallest width that the library accepts to the widest lobe.
const ALPHA: std::ops::RangeInclusive<f32> = 1e-4..=1.0;

/// The tri-Ace exponents that correspond to the widths in [`ALPHA`].
fn exponent() -> impl Domain<Value = f32> {
    ALPHA.map(exponent_of)
}

fn exponent_of(alpha: f32) -> f32 {
    2.0 * (1.0 - alpha) * (1.0 + alpha) / (alpha * alpha)
}

/// A width, a view and a light direction. Some light directions are anywhere in the hemisphere. The others are near the
/// view's mirror direction (within a few widths), equal to the view, or near the horizon opposite to the view.
fn lobes() -> impl Domain<Value = (f32, Vec3, Vec3)> {
    (ALPHA, Hemisphere, Hemisphere, 0.0..=1.0_f32).map(|(alpha, v, l, choice)| {
        let at_slope = |slope: Vec3| mirrored(v, (slope + Vec3::Z).normalize());
        let l = match choice {
            0.0..0.3 => at_slope(2.0 * alpha * Vec3::new(l.x, l.y, 0.0)),
            0.3..0.35 => at_slope(Vec3::ZERO),
            0.35..0.4 => v,
            0.4..0.5 => Vec3::new(-v.x, -v.y, l.z.min(0.01)).normalize_or(Vec3::X),
            _ => l,
        };
        (alpha, v, l)
    })
}

fn mirrored(v: Vec3, h: Vec3) -> Vec3 {
    let (v, h) = (v.as_dvec3(), h.as_dvec3());
    (2.0 * v.dot(h) * h - v).normalize().as_vec3()
}

/// Reflectances of at least 0.02, the reflectance of ice. For smaller reflectances near normal incidence, F is nearly
/// the fifth power of 1 - cos, which loses digits. Then the error of F is small in absolute terms, but large relative
/// to F.
fn reflectance() -> impl Domain<Value = Vec3> {
    UnitRgb.map(|c| (0.02 + 0.98 * c).min(Vec3::ONE))
}

/// Two numbers in 0..=1. The second number is below 1.
fn square() -> impl Domain<Value = Vec2> {
    (0.0..=1.0_f32, 0.0..=1.0_f32.next_down()).map(|(x, y)| Vec2::new(x, y))
}

/// Returns `false` for directions up to 1e-4 above the horizon. WGSL allows drivers to flush a lobe's exponential to 0
/// if the exponential is below 1e-38. For these directions, the BRDF multiplies the exponential by a large factor.
fn apart_from_the_horizon((_, v, l): &(f32, Vec3, Vec3)) -> bool {
    v.z.min(l.z) > 1e-4 || v.z.min(l.z) <= 0.0
}

/// A bound for values of a lobe that drivers flush to 0. These values are below 1e-23: 1e-38 times the lobe's peak
/// (3e7), divided by the smallest 4 N.V N.L (4e-8).
const VANISHED: Abs = Abs(1e-20);

/// The tolerance for BRDFs with an exponential: 640 ulp, as in `distribution`, plus 87 times the error of the exponent.
/// In the exponent, tan^2 consists of two sums, a root and three quotients, which add 12 ulp.
const EXPONENTIAL: Rel = Rel(2e-4);

/// The only rounding is that of the quotient albedo / pi.
#[test]
fn lambert_eval() {
    PBR.function("brdf::lambert_eval")
        .over((UnitRgb, UnitVector, UnitVector))
        .agrees_with(brdf::lambert_eval, Ulp(3.0));
}

/// WGSL allows sin and cos an error of 2^-11.
#[test]
fn lambert_sample() {
    PBR.function("brdf::lambert_sample")
        .over(square())
        .agrees_with(brdf::lambert_sample, Abs(6e-4));
}

#[test]
fn lambert_pdf() {
    PBR.function("brdf::lambert_pdf").over(UnitVector).agrees_with(brdf::lambert_pdf, Ulp(3.0));
}

/// D is a squared quotient of sums of positive terms (24 ulp). G / (4 N.L N.V) adds 16 ulp, and F adds 12 ulp. The
/// error of V.H (4 ulp) counts at most five times, because f0 is at least 0.02.
// Lesson 15: `eval`
#[test]
fn microfacet_eval() {
    PBR.function("brdf::microfacet_eval")
        .over((reflectance(), lobes()).map(|(f0, (alpha, v, l))| (f0, alpha, v, l)))
        .agrees_with(brdf::microfacet_eval, Ulp(64.0));
}

/// The function agrees with its reference for any f0. If f0 is small, so is the BRDF, so the test compares the error
/// with the BRDF of a surface with f0 = 1.
#[test]
fn microfacet_eval_with_little_reflectance() {
    PBR.function("brdf::microfacet_eval")
        .over((UnitRgb, lobes()).map(|(f0, (alpha, v, l))| (f0, alpha, v, l)))
        .satisfies("is off by at most 64 ulp of white", |(f0, alpha, v, l), f: Vec3| {
            let (alpha, v, l) = (f64::from(alpha), v.as_dvec3(), l.as_dvec3());
            let white = brdf::microfacet_eval(DVec3::ONE, alpha, v, l).x;
            let expected = brdf::microfacet_eval(f0.as_dvec3(), alpha, v, l);
            let ulp = f64::from(f32::EPSILON) / 2.0;
            (f.as_dvec3() - expected).abs().max_element() <= 64.0 * ulp * white
        });
}

/// An error in the normal turns the mirrored direction by twice this error. WGSL's sin and cos give the normal an error
/// of at most 2^-11 divided by the length of the halfway vector from which `sampling::ggx_visible_normal` computes the
/// normal. The test leaves out one normal in 64, for which that length is below 1/4.
#[test]
fn microfacet_sample() {
    let domain = (ALPHA, Hemisphere, square()).filter(|(alpha, v, u)| {
        let (alpha, v, u) = (f64::from(*alpha), v.as_dvec3(), u.as_dvec2());
        let h = shaders::sampling::ggx_visible_normal(alpha, v, u);
        let unstretched = (h.truncate() / alpha).extend(h.z).normalize();
        let stretched = (v.truncate() * alpha).extend(v.z).normalize();
        2.0 * stretched.dot(unstretched) > 0.25
    });
    PBR.function("brdf::microfacet_sample")
        .over(domain)
        .agrees_with(brdf::microfacet_sample, Abs(4e-3));
}

/// The error of D is 24 ulp, and G1 adds 10 ulp.
#[test]
fn microfacet_pdf() {
    PBR.function("brdf::microfacet_pdf").over(lobes()).agrees_with(brdf::microfacet_pdf, Ulp(40.0));
}

/// Compares the shader's formula with f cos / pdf for each direction of light, including directions that no sample
/// reaches.
#[test]
fn microfacet_weight() {
    PBR.function("brdf::microfacet_weight")
        .over((reflectance(), lobes()).map(|(f0, (alpha, v, l))| (f0, alpha, v, l)))
        .agrees_with(brdf::microfacet_weight, Ulp(40.0));
}

/// The weight is F G2 / G1, and G2 <= G1, so the weight is at most F.
#[test]
fn microfacet_weight_is_at_most_fresnel() {
    PBR.function("brdf::microfacet_weight")
        .over((UnitRgb, lobes()).map(|(f0, (alpha, v, l))| (f0, alpha, v, l)))
        .satisfies("lies in 0..=1", |_, weight: Vec3| {
            weight.min_element() >= 0.0 && weight.max_element() <= 1.0 + 4.0 * f32::EPSILON
        });
}

/// A sample below the horizon has weight 0. A sample above the horizon has a weight of at most 1.
#[test]
fn microfacet_samples_weigh_at_most_one() {
    PBR.function("brdf::microfacet_sample").over((ALPHA, Hemisphere, square())).satisfies(
        "is a unit vector; eval and pdf are 0 or their quotient at most 1 / cos",
        |(alpha, v, _), l: Vec3| {
            let (alpha, v, l) = (f64::from(alpha), v.as_dvec3(), l.as_dvec3());
            let f = brdf::microfacet_eval(DVec3::ONE, alpha, v, l).x;
            let pdf = brdf::microfacet_pdf(alpha, v, l);
            let unit = (l.length() - 1.0).abs() < 1e-5;
            let above = l.z > 0.0 && v.z > 0.0;
            unit && if above { f * l.z <= pdf * (1.0 + 1e-6) } else { f == 0.0 && pdf == 0.0 }
        },
    );
}

#[test]
fn cook_torrance_eval() {
    let domain = (reflectance(), lobes().filter(apart_from_the_horizon));
    PBR.function("brdf::cook_torrance_eval")
        .over(domain.map(|(f0, (alpha, v, l))| (f0, alpha, v, l)))
        .agrees_with(brdf::cook_torrance_eval, EXPONENTIAL.or(VANISHED));
}

/// WGSL's sin and cos give the normal an error of 2^-11. The function mirrors `v` at this normal, so the direction has
/// twice this error, and the error of V.H adds as much again.
#[test]
fn cook_torrance_sample() {
    PBR.function("brdf::cook_torrance_sample")
        .over((ALPHA, Hemisphere, square()))
        .agrees_with(brdf::cook_torrance_sample, Abs(2.5e-3));
}

#[test]
fn cook_torrance_pdf() {
    PBR.function("brdf::cook_torrance_pdf")
        .over(lobes().filter(apart_from_the_horizon))
        .agrees_with(brdf::cook_torrance_pdf, EXPONENTIAL.or(VANISHED));
}

#[test]
fn tri_ace_eval() {
    let lights = lobes().filter(apart_from_the_horizon);
    let domain = (UnitRgb, reflectance(), lights)
        .map(|(albedo, f0, (alpha, v, l))| (albedo, f0, exponent_of(alpha), v, l));
    PBR.function("brdf::tri_ace_eval")
        .over(domain)
        .agrees_with(brdf::tri_ace_eval, EXPONENTIAL.or(VANISHED));
}

/// Below 1/2, the function divides x (2.5 ulp) by 1 plus a term of at most 1/12, so the errors of this term hardly
/// count. From 1/2 on, the function computes (1 - e) / (1 + e), where e = exp(-2 x) is at most 0.37. The error of e is
/// 3 + 4 x ulp: 1.5e-7 at 1/2. As x grows, e shrinks faster than its relative error grows. The error of e counts 1 /
/// 0.63 times in 1 - e and 1 / 1.37 times in 1 + e: 3.5e-7. The division and the roundings of 1 - e and 1 + e add
/// 4.2e-7.
// Lesson 32
#[test]
fn tanh_of() {
    let function = || PBR.function("brdf::tanh_of");
    function().over(1e-30..=0.5_f32.next_down()).agrees_with(|x: f64| x.tanh(), Ulp(4.0));
    function().over(0.5..=40.0).agrees_with(|x: f64| x.tanh(), Rel(8e-7));
    function().over(Just(0.0)).agrees_with(|x: f64| x, Ulp(0.0));
}

/// The tolerance is the same as for `cook_torrance_sample`. For arguments near 1, the shader computes log by a series.
/// Elsewhere WGSL allows log an error of 2^-21, which is small beside the other errors.
#[test]
fn tri_ace_sample() {
    PBR.function("brdf::tri_ace_sample")
        .over((exponent(), Hemisphere, square()))
        .agrees_with(brdf::tri_ace_sample, Abs(2.5e-3));
}

/// For narrow lobes, the error of a sampled direction is at most 1 % of its distance from the mirror direction, or 1 %
/// of the lobe's width if the width is larger. The tolerance also includes the rounding of directions.
#[test]
fn narrow_lobes_keep_their_width() {
    let near = |alpha: f32, v: Vec3, l: Vec3, expected: DVec3| {
        let mirrored = (Vec3::Z * 2.0 * v.z - v).as_dvec3();
        let scale = expected.distance(mirrored).max(alpha.into());
        expected.distance(l.as_dvec3()) <= 1e-2 * scale + 5e-7
    };
    let alpha = || 1e-4..=0.1_f32;
    let views = || Hemisphere.filter(|v: &Vec3| v.z > 0.1);
    PBR.function("brdf::cook_torrance_sample").over((alpha(), views(), square())).satisfies(
        "is as far from the mirror direction as its twin",
        move |(alpha, v, u), l: Vec3| {
            let expected = brdf::cook_torrance_sample(alpha.into(), v.as_dvec3(), u.as_dvec2());
            near(alpha, v, l, expected)
        },
    );
    PBR.function("brdf::tri_ace_sample")
        .over((alpha().map(exponent_of), views(), square()))
        .satisfies("is as far from the mirror direction as its twin", move |(n, v, u), l: Vec3| {
            let expected = brdf::tri_ace_sample(n.into(), v.as_dvec3(), u.as_dvec2());
            near((2.0 / (n + 2.0)).sqrt(), v, l, expected)
        });
}

#[test]
fn tri_ace_pdf() {
    let lights = lobes().filter(apart_from_the_horizon);
    PBR.function("brdf::tri_ace_pdf")
        .over(lights.map(|(alpha, v, l)| (exponent_of(alpha), v, l)))
        .agrees_with(brdf::tri_ace_pdf, EXPONENTIAL.or(VANISHED));
}

/// Down to the horizon, even if V = -L, the BRDFs never compute 0 / 0 and never exceed the largest f32.
#[test]
fn reflectances_are_finite_and_not_negative() {
    for function in ["brdf::microfacet_eval", "brdf::cook_torrance_eval"] {
        PBR.function(function)
            .over((UnitRgb, lobes()).map(|(f0, (alpha, v, l))| (f0, alpha, v, l)))
            .satisfies("is not negative", |_, f: Vec3| f.min_element() >= 0.0);
    }
    let domain = (UnitRgb, UnitRgb, lobes())
        .map(|(albedo, f0, (alpha, v, l))| (albedo, f0, exponent_of(alpha), v, l));
    PBR.function("brdf::tri_ace_eval")
        .over(domain)
        .satisfies("is not negative", |_, f: Vec3| f.min_element() >= 0.0);
}

/// One cosine goes down to 1e-18, and the other to the smallest normal f32, so f32 can't represent their product. If
/// the numerator of D is below exp(-87), a driver may flush the numerator to 0. The factor 1 / (4 N.V N.L) multiplies
/// the error from flushing. The test leaves out results above 1e37, near the largest f32.
// Lesson 31
#[test]
fn cook_torrance_eval_at_the_horizon() {
    let eval = |alpha: f32, v: Vec3, l: Vec3| {
        brdf::cook_torrance_eval(DVec3::ONE, alpha.into(), v.as_dvec3(), l.as_dvec3()).x
    };
    let grazing = (ALPHA, -18.0..=0.0_f32, -37.9..=0.0_f32, 0.0..=1.0_f32, 0.0..=1.0_f32)
        .map(|(alpha, above, low, turn, opposite)| {
            let at = |z: f32, angle: f32| {
                let z = z.min(1.0);
                let from_axis = ((1.0 - z) * (1.0 + z)).sqrt();
                Vec3::new(from_axis * angle.cos(), from_axis * angle.sin(), z)
            };
            let v = at(10.0_f32.powf(above), 0.0);
            let l = at(10.0_f32.powf(low), std::f32::consts::PI * turn);
            // Exactly opposite directions occur, too. Then the half vector is the normal.
            let l = if opposite < 0.3 { Vec3::new(-v.x, -v.y, l.z.min(v.z)) } else { l };
            (Vec3::ONE, alpha, v, l)
        })
        .filter(move |(_, alpha, v, l)| eval(*alpha, *v, *l) < 1e37);
    PBR.function("brdf::cook_torrance_eval").over(grazing).satisfies(
        "is its twin, but for what is flushed",
        move |(_, alpha, v, l), f: Vec3| {
            let h = (v.as_dvec3() + l.as_dvec3()).normalize();
            let width2 = (f64::from(alpha) * h.z).powi(2);
            if h.truncate().length_squared() > 88.0 * width2 {
                return f == Vec3::ZERO;
            }
            let expected = eval(alpha, v, l);
            let peak = (std::f64::consts::PI * width2 * h.z.powi(2)).recip();
            let flushed = (-86.0_f64).exp() * peak / f64::from(v.z.max(l.z)).powi(2);
            let off = (f.as_dvec3() - DVec3::splat(expected)).abs().max_element();
            off <= 2e-4 * expected + flushed
        },
    );
}

/// Light from below has no effect, and nothing is visible from below.
#[test]
fn nothing_happens_below_the_horizon() {
    let below = || {
        (ALPHA, UnitVector, UnitVector)
            .filter(|(_, v, l)| v.z <= 0.0 || l.z <= 0.0)
            .map(|(alpha, v, l)| (Vec3::ONE, alpha, v, l))
    };
    for function in ["brdf::microfacet_eval", "brdf::cook_torrance_eval", "brdf::microfacet_weight"]
    {
        PBR.function(function).over(below()).satisfies("is 0", |_, f: Vec3| f == Vec3::ZERO);
    }
    for function in ["brdf::microfacet_pdf", "brdf::cook_torrance_pdf", "brdf::tri_ace_pdf"] {
        PBR.function(function)
            .over(below().map(|(_, alpha, v, l)| (alpha, v, l)))
            .satisfies("is 0", |_, pdf: f32| pdf == 0.0);
    }
    PBR.function("brdf::tri_ace_eval")
        .over(below().map(|(white, alpha, v, l)| (white, white, exponent_of(alpha), v, l)))
        .satisfies("is 0", |_, f: Vec3| f == Vec3::ZERO);
}

/// The BRDFs are reciprocal (Helmholtz): if `v` and `l` are exchanged, the result stays the same. The tolerance of 4
/// ulp is for compilers that contract one of the two products of a sum into an `fma`.
#[test]
fn reflectances_are_reciprocal() {
    for function in ["brdf::microfacet_eval", "brdf::cook_torrance_eval"] {
        PBR.function(function)
            .over((UnitRgb, lobes()).map(|(f0, (alpha, v, l))| (f0, alpha, v, l)))
            .invariant_under(|(f0, alpha, v, l)| (f0, alpha, l, v), Ulp(4.0));
    }
    PBR.function("brdf::lambert_eval")
        .over((UnitRgb, Hemisphere, Hemisphere))
        .invariant_under(|(albedo, v, l)| (albedo, l, v), Ulp(0.0));
    let specular = lobes().map(|(alpha, v, l)| (Vec3::ZERO, Vec3::ONE, exponent_of(alpha), v, l));
    PBR.function("brdf::tri_ace_eval")
        .over(specular)
        .invariant_under(|(albedo, f0, n, v, l)| (albedo, f0, n, l, v), Ulp(4.0));
}

/// tri-Ace's diffuse part depends on N.L but not on N.V. Light along the horizon and a view from above give black. If
/// the two directions are exchanged, the result is 1 / pi.
#[test]
fn tri_ace_is_not_reciprocal() {
    let swapped = PBR
        .function("brdf::tri_ace_eval")
        .over((UnitRgb, UnitRgb, 0.0..=1e4, Hemisphere, Hemisphere))
        .unrecorded()
        .try_invariant_under(|(albedo, f0, n, v, l)| (albedo, f0, n, l, v), Rel(0.5));
    assert!(matches!(swapped, Err(Failure::Disagreement(_))), "{swapped:?}");

    let low = Vec3::new(0.8_f32.sqrt(), 0.0, 0.2_f32.sqrt()); // no lobe joins it to +Z
    let narrow = |v, l| {
        PBR.function("brdf::tri_ace_eval").over((
            Just(Vec3::ONE),
            Just(Vec3::ZERO),
            Just(1e4),
            Just(v),
            Just(l),
        ))
    };
    let transmitted = |cos: f64| (1.0 - (1.0 - cos).powi(5)) / std::f64::consts::PI;
    let expected =
        move |_: DVec3, _: DVec3, _: f64, _: DVec3, l: DVec3| DVec3::splat(transmitted(l.z));
    narrow(low, Vec3::Z).agrees_with(expected, Ulp(16.0)); // 0.318
    narrow(Vec3::Z, low).agrees_with(expected, Ulp(16.0)); // 0.302
}

/// 8 widths combined with 8 views, for integrals. The views go from 0 to 89 degrees from the normal.
fn views() -> impl Domain<Value = (f32, Vec3)> {
    (Grid::linear(0.01..=1.0, 8), Grid::linear(0.0..=89.0, 8))
        .map(|(alpha, degrees)| (alpha, view(degrees)))
}

fn view(degrees: f32) -> Vec3 {
    let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
    DVec3::new(0.6 * sin, -0.8 * sin, cos).as_vec3()
}

/// Directions of light with their weights. The weights don't include the cosine.
fn lights(alpha: f32, v: Vec3) -> impl Iterator<Item = (Vec3, f64)> {
    brdf::half_vector_rule(f64::from(alpha), v.as_dvec3(), 32, 32)
        .into_iter()
        .map(|(l, weight)| (l.as_vec3(), weight))
}

/// Computes the integral of a reference in f64, with more nodes than `lights`.
fn integral((alpha, v): (f32, Vec3), f: impl Fn(f64, DVec3, DVec3) -> f64) -> f64 {
    let (alpha, v) = (f64::from(alpha), v.as_dvec3());
    brdf::integral(alpha, v, |l| f(alpha, v, l))
}

/// A white surface in white light returns all light.
#[test]
fn lambert_in_a_furnace() {
    PBR.function("brdf::lambert_eval")
        .integral(views(), |&(alpha, v): &(f32, Vec3)| {
            lights(alpha, v).map(|(l, w)| ((Vec3::ONE, v, l), w * f64::from(l.z))).collect()
        })
        .agrees_with(|_| DVec3::ONE, Abs(1e-4));
}

/// Single scattering loses light and never adds light. At 89 degrees, the error of the quadrature is 2e-5. Rounding the
/// nodes to f32 moves a lobe of width 0.01 by 1e-5 of its width.
#[test]
fn microfacets_in_a_furnace() {
    let furnace = || {
        PBR.function("brdf::microfacet_eval").integral(views(), |&(alpha, v): &(f32, Vec3)| {
            lights(alpha, v).map(|(l, w)| ((Vec3::ONE, alpha, v, l), w * f64::from(l.z))).collect()
        })
    };
    furnace().is_at_most(|_| 1.0, 1e-4);
    furnace().agrees_with(
        |&view| {
            let f = |alpha, v, l: DVec3| brdf::microfacet_eval(DVec3::ONE, alpha, v, l).x * l.z;
            DVec3::splat(integral(view, f))
        },
        Abs(1e-4),
    );
}

/// At alpha = 1, seen from above, the result is 1 - ln 2.
#[test]
fn widest_microfacets_in_a_furnace() {
    PBR.function("brdf::microfacet_eval")
        .integral(Just((1.0, Vec3::Z)), |&(alpha, v): &(f32, Vec3)| {
            lights(alpha, v).map(|(l, w)| ((Vec3::ONE, alpha, v, l), w * f64::from(l.z))).collect()
        })
        .agrees_with(|_| DVec3::splat(1.0 - std::f64::consts::LN_2), Abs(1e-6));
}

/// Cook and Torrance's G has kinks, at which a quadrature of high order loses its accuracy. The error is up to 8e-4.
#[test]
fn cook_torrance_in_a_furnace() {
    let furnace = || {
        PBR.function("brdf::cook_torrance_eval").integral(views(), |&(alpha, v): &(f32, Vec3)| {
            lights(alpha, v).map(|(l, w)| ((Vec3::ONE, alpha, v, l), w * f64::from(l.z))).collect()
        })
    };
    furnace().is_at_most(|_| 1.0, 1e-3);
    furnace().agrees_with(
        |&view| {
            let f = |alpha, v, l: DVec3| brdf::cook_torrance_eval(DVec3::ONE, alpha, v, l).x * l.z;
            DVec3::splat(integral(view, f))
        },
        Abs(1e-3),
    );
}

/// Triples of exponent, f0 and view. The exponents go from 0, which gives no lobe, to 1e6, the narrowest lobe. f0 goes
/// from 0 to 1.
fn tri_ace_views() -> impl Domain<Value = (f32, Vec3, Vec3)> {
    let exponents = vec![0.0_f32, 1.0, 10.0, 100.0, 1e4, 1e6];
    let angles = vec![0.0_f32, 30.0, 60.0, 75.0, 80.4, 85.0, 89.0];
    let reflectances = vec![0.0_f32, 0.04, 0.5, 1.0];
    (OneOf(exponents), OneOf(reflectances), OneOf(angles))
        .map(|(exponent, f0, degrees)| (exponent, Vec3::splat(f0), view(degrees)))
}

/// Albedo, f0, exponent, v and l.
type TriAce = (Vec3, Vec3, f32, Vec3, Vec3);

/// The nodes for an integral of `tri_ace_eval` with a white albedo.
fn tri_ace_nodes(&(exponent, f0, v): &(f32, Vec3, Vec3)) -> Vec<(TriAce, f64)> {
    let alpha = (2.0 / (exponent + 2.0)).sqrt();
    lights(alpha, v).map(|(l, w)| ((Vec3::ONE, f0, exponent, v, l), w * f64::from(l.z))).collect()
}

/// The paper says that the model "basically follows" the conservation of energy. The reflectance comes close to 20/21 +
/// 5^5 / 6^6 = 1.0194, the bound that the tests of the reference derive, and never exceeds it.
#[test]
fn tri_ace_in_a_furnace() {
    let furnace = || PBR.function("brdf::tri_ace_eval").integral(tri_ace_views(), tri_ace_nodes);
    furnace().is_at_most(|_| 20.0 / 21.0 + 3125.0 / 46656.0, 2e-4);
    let conserving = furnace().unrecorded().try_is_at_most(|_| 1.0, 0.018);
    assert!(matches!(conserving, Err(Failure::Disagreement(_))), "{conserving:?}");
    PBR.function("brdf::tri_ace_eval")
        .integral(Just((1e6, Vec3::ZERO, view(80.4))), tri_ace_nodes)
        .agrees_with(|_| DVec3::splat(1.0190), Abs(2e-4));
}

/// The integral of a density over the directions above the horizon is 1 minus the part of the lobe below the horizon.
/// For `microfacet_pdf` at alpha = 1, the integral is 1 / (1 + N.V).
// Lesson 15: sample, density and eval against each other
#[test]
fn densities_integrate_to_what_stays_above() {
    let nodes = |&(alpha, v): &(f32, Vec3)| {
        lights(alpha, v).map(|(l, w)| ((alpha, v, l), w)).collect::<Vec<_>>()
    };
    PBR.function("brdf::microfacet_pdf")
        .integral(views(), nodes)
        .agrees_with(|&view| integral(view, brdf::microfacet_pdf), Abs(1e-5));
    PBR.function("brdf::microfacet_pdf")
        .integral(views().filter(|(alpha, _)| *alpha == 1.0), nodes)
        .cases(64)
        .agrees_with(|(_, v)| 1.0 / (1.0 + f64::from(v.z)), Abs(1e-5));
    PBR.function("brdf::cook_torrance_pdf")
        .integral(views(), nodes)
        .agrees_with(|&view| integral(view, brdf::cook_torrance_pdf), Abs(1e-4));
    PBR.function("brdf::tri_ace_pdf")
        .integral(views(), |&(alpha, v): &(f32, Vec3)| {
            lights(alpha, v).map(|(l, w)| ((exponent_of(alpha), v, l), w)).collect()
        })
        .agrees_with(
            |&view| {
                integral(view, |alpha, v, l| brdf::tri_ace_pdf(2.0 / (alpha * alpha) - 2.0, v, l))
            },
            Abs(1e-4),
        );
    PBR.function("brdf::lambert_pdf")
        .integral(views(), |&(alpha, v): &(f32, Vec3)| lights(alpha, v).collect())
        .agrees_with(|_| 1.0, Abs(1e-4));
}

/// A package with an estimator for each sampler of the library: f cos / pdf, or 0 for samples below the horizon.
fn estimators() -> Package {
    let names = ["lambert", "microfacet", "cook_torrance", "tri_ace"];
    let import =
        |name| format!("import library::brdf::{{{name}_eval, {name}_sample, {name}_pdf}};\n");
    let estimate = |(name, eval, sample, pdf)| {
        format!(
            "fn {name}(alpha: f32, v: vec3f, u: vec2f) -> f32 {{\n\
                 let n = 2.0 / (alpha * alpha) - 2.0;\n\
                 let l = {name}_sample({sample});\n\
                 let density = {name}_pdf({pdf});\n\
                 if (density == 0.0) {{ return 0.0; }}\n\
                 return {name}_eval({eval}, v, l).x * l.z / density;\n\
             }}\n"
        )
    };
    let estimates = [
        ("lambert", "vec3f(1.0)", "u", "l"),
        ("microfacet", "vec3f(1.0), alpha", "alpha, v, u", "alpha, v, l"),
        ("cook_torrance", "vec3f(1.0), alpha", "alpha, v, u", "alpha, v, l"),
        ("tri_ace", "vec3f(1.0), vec3f(0.04), n", "n, v, u", "n, v, l"),
    ];
    let text = names.map(import).concat() + &estimates.map(estimate).concat();
    Package::from_modules("estimators", [("estimators", text)]).depends_on("library", &PBR)
}

/// No sample has a weight above 2. G2 / G1 is at most 1. G of the V-cavity is at most 2 N.H N.V / V.H, so the weight F
/// G V.H / (N.H N.V) is at most 2 F. The exponentials in eval and in pdf have equal errors, which cancel in the weight.
// Lesson 15: sample, density and eval against each other
#[test]
fn samples_have_bounded_weights() {
    let package = estimators();
    for (name, bound) in [("lambert", 1.0), ("microfacet", 1.0), ("cook_torrance", 2.0)] {
        package
            .function(&format!("estimators::{name}"))
            .over((ALPHA, Hemisphere, square()))
            .satisfies("is at most its bound", move |_, weight: f32| {
                (0.0..=bound * (1.0 + 1e-5)).contains(&weight)
            });
    }
}

/// Sampler, density and BRDF fit together: the mean of the weights f cos / pdf over the unit square of random numbers
/// is the albedo that the quadrature over directions finds. A curve in the square separates samples above the horizon
/// from samples below. The curve crosses up to 256 of the 16384 cells of the midpoint rule, and causes an error in
/// each. At the curve, the weights jump by up to 2, or fall continuously to 0 if G goes to 0 with N.L. If the errors of
/// cells have random signs, the mean has an error of 2 sqrt(256) / 16384 = 2e-3. If the curve runs along the grid, the
/// error is twice as large. Lambert's samples have no such curve.
// Lesson 15: sample, density and eval against each other
#[test]
fn the_mean_weight_of_samples_is_the_albedo() {
    const SIDE: u32 = 128;
    let package = estimators();
    let nodes = |&(alpha, v): &(f32, Vec3)| {
        let at = |index: u32| (index as f32 + 0.5) / SIDE as f32;
        (0..SIDE * SIDE)
            .map(|i| ((alpha, v, Vec2::new(at(i / SIDE), at(i % SIDE))), f64::from(SIDE).powi(-2)))
            .collect::<Vec<_>>()
    };
    let mean = |name: &str, bound, albedo: &(dyn Fn(f64, DVec3, DVec3) -> f64 + Sync)| {
        package
            .function(&format!("estimators::{name}"))
            .integral(views(), nodes)
            .agrees_with(|&view| integral(view, |a, v, l| albedo(a, v, l) * l.z), Abs(bound));
    };
    mean("lambert", 1e-6, &|_, v, l| brdf::lambert_eval(DVec3::ONE, v, l).x);
    mean("microfacet", 1.5e-3, &|alpha, v, l| brdf::microfacet_eval(DVec3::ONE, alpha, v, l).x);
    mean("cook_torrance", 4e-3, &|alpha, v, l| brdf::cook_torrance_eval(DVec3::ONE, alpha, v, l).x);
    mean("tri_ace", 3e-3, &|alpha, v, l| {
        let exponent = 2.0 / (alpha * alpha) - 2.0;
        brdf::tri_ace_eval(DVec3::ONE, DVec3::splat(0.04), exponent, v, l).x
    });
}

/// A white Lambertian returns all light, and its density integrates to 1.
#[test]
fn lambert_is_a_density() {
    PBR.function("brdf::lambert_pdf").over(()).integrates_to(
        Directions::sphere().rings(256),
        |()| 1.0,
        Abs(1e-4),
    );
    PBR.function("brdf::lambert_eval")
        .over((UnitRgb, Hemisphere.filter(|v: &Vec3| v.z > 0.0)))
        .integrates_to(
            Directions::projected_hemisphere(),
            |(albedo, _)| albedo.as_dvec3(),
            // If albedo / pi is below the least normal f32, WGSL may flush it in all directions.
            Rel(1e-6).or(Abs(std::f64::consts::PI * f64::from(f32::MIN_POSITIVE))),
        );
}

/// No rough metal returns more light than arrives. The quadrature has 96 rings, which are enough for lobes of width 0.4
/// and more.
#[test]
fn rough_microfacets_return_no_more_than_they_receive() {
    PBR.function("brdf::microfacet_eval")
        .over((Just(Vec3::ONE), 0.4..=1.0, Hemisphere.filter(|v: &Vec3| v.z > 0.05)))
        .cases(32)
        .integrates_to_at_most(Directions::projected_hemisphere().rings(96), |_| 1.0, 1e-3);
}

/// Widths and views for samples. The widths go from the narrowest width that f32 resolves well to the widest. The views
/// go from straight above to half a degree above the horizon.
fn sampled_views() -> impl Domain<Value = (f32, Vec3)> {
    (OneOf(vec![0.01, 0.3, 1.0]), OneOf(vec![0.0, 60.0, 89.5]))
        .map(|(alpha, degrees)| (alpha, view(degrees)))
}

/// Samples, density and BRDF fit together: the mean of the samples' weights f cos / pdf is the albedo.
#[test]
fn lambert_samples_follow_their_pdf_and_estimate_its_albedo() {
    PBR.function("brdf::lambert_sample")
        .sampled_over(Just(Vec3::new(0.2, 0.5, 1.0)), |_, u: Vec2| u)
        .estimates(
            (PBR.function("brdf::lambert_eval"), |&albedo: &Vec3, l: Vec3| (albedo, Vec3::Z, l)),
            (PBR.function("brdf::lambert_pdf"), |_: &Vec3, l: Vec3| l),
        );
}

// Lesson 15: all three, by a chi-square test
#[test]
fn microfacet_samples_follow_their_pdf_and_estimate_its_albedo() {
    PBR.function("brdf::microfacet_sample")
        .sampled_over(sampled_views(), |&(alpha, v), u: Vec2| (alpha, v, u))
        .may_leave_support()
        .estimates_with_weight(
            (PBR.function("brdf::microfacet_eval"), |&(alpha, v): &(f32, Vec3), l: Vec3| {
                (Vec3::new(0.04, 0.5, 1.0), alpha, v, l)
            }),
            (PBR.function("brdf::microfacet_pdf"), |&(alpha, v): &(f32, Vec3), l: Vec3| {
                (alpha, v, l)
            }),
            (PBR.function("brdf::microfacet_weight"), |&(alpha, v): &(f32, Vec3), l: Vec3| {
                (Vec3::new(0.04, 0.5, 1.0), alpha, v, l)
            }),
        );
}

#[test]
fn cook_torrance_samples_follow_their_pdf_and_estimate_its_albedo() {
    PBR.function("brdf::cook_torrance_sample")
        .sampled_over(sampled_views(), |&(alpha, v), u: Vec2| (alpha, v, u))
        .may_leave_support()
        .estimates(
            (PBR.function("brdf::cook_torrance_eval"), |&(alpha, v): &(f32, Vec3), l: Vec3| {
                (Vec3::new(0.04, 0.5, 1.0), alpha, v, l)
            }),
            (PBR.function("brdf::cook_torrance_pdf"), |&(alpha, v): &(f32, Vec3), l: Vec3| {
                (alpha, v, l)
            }),
        );
}

#[test]
fn tri_ace_samples_follow_their_pdf_and_estimate_its_albedo() {
    PBR.function("brdf::tri_ace_sample")
        .sampled_over(sampled_views(), |&(alpha, v), u: Vec2| (exponent_of(alpha), v, u))
        .may_leave_support()
        .estimates(
            (PBR.function("brdf::tri_ace_eval"), |&(alpha, v): &(f32, Vec3), l: Vec3| {
                (Vec3::splat(0.5), Vec3::new(0.04, 0.5, 1.0), exponent_of(alpha), v, l)
            }),
            (PBR.function("brdf::tri_ace_pdf"), |&(alpha, v): &(f32, Vec3), l: Vec3| {
                (exponent_of(alpha), v, l)
            }),
        );
}
