//! The samples of the guide's chapters on functions: tests of the shaders in the guide.

use std::f64::consts::PI;

use glam::{Vec2, Vec3, Vec4};
use karat::Path;
use karat::prelude::*;

pub(super) static SHADERS: Package = karat::package!("tests/strangers/shaders");

#[test]
fn lambert() {
    SHADERS
        .function("brdf::lambert")
        .over((0.0..=1.0, 0.0..=1.0)) // albedo, n_dot_l
        .agrees_with(|albedo: f64, n_dot_l: f64| albedo / PI * n_dot_l, Ulp(4.0));
}

/// At the peak of the lobe, `d` is the small difference of two numbers near 1. So its relative error grows to 6e-8 /
/// alpha^2, which is 2.4e-5 for the narrowest lobe (alpha = 0.05).
#[test]
fn ggx() {
    let reference = |n_dot_h: f64, alpha: f64| {
        let a2 = alpha * alpha;
        let d = n_dot_h * n_dot_h * (a2 - 1.0) + 1.0;
        a2 / (PI * d * d)
    };
    SHADERS.function("brdf::ggx").over((0.0..=1.0, 0.05..=1.0)).agrees_with(reference, Rel(1e-4));
}

#[test]
fn lambert_is_what_wgsl_allows() {
    SHADERS
        .function("brdf::lambert")
        .over((0.0..=1.0, 0.0..=1.0))
        .agrees_with(|albedo: f64, n_dot_l: f64| albedo / PI * n_dot_l, Spec);
}

#[test]
fn directions_above_the_horizon() {
    // Opposite directions have no halfway vector.
    let apart = (Hemisphere, Hemisphere).filter(|(v, l)| (*v + *l).length() > 0.1);
    SHADERS.function("brdf::halfway").over(apart).is_unit();
}

#[test]
fn schlick() {
    let schlick = || SHADERS.function("brdf::schlick").over((0.0..=1.0, 0.0..=1.0)); // f0, cosine
    schlick().stays_within(0.0..=1.0);
    schlick().is_monotone_in("cosine", Trend::Decreasing, Ulp(2.0));
    let facing = Limit::toward(1.0, [0.5, 0.9, 0.99, 0.999]);
    schlick().at_limit("cosine", facing, |f0: f64, _: f64| f0, Abs(1e-6));
}

#[test]
fn halfway_is_reciprocal() {
    let apart = (Hemisphere, Hemisphere).filter(|(v, l)| (*v + *l).length() > 0.1);
    SHADERS.function("brdf::halfway").over(apart).invariant_under(|(v, l)| (l, v), Ulp(0.0));
}

#[test]
fn cosine_hemisphere() {
    let pdf = || SHADERS.function("sampling::cosine_hemisphere_pdf");
    pdf().over(()).integrates_to(Directions::hemisphere(), |()| 1.0, Rel(1e-6));
    SHADERS
        .function("sampling::cosine_hemisphere")
        .sampled_over(Just(()), |(), u: Vec2| u)
        .follows(pdf(), |(), l: Vec3| l);
}

#[test]
fn grading() {
    let curve = Texture::from_fn(4, 1, |x, _| Vec4::splat(x as f32 / 3.0));
    let reference = |x: f64, channel: u32| {
        let between = (4.0 * x - 0.5).clamp(0.0, 3.0) / 3.0; // centres of texels are at 1/8, 3/8, ..
        2.0 * between + [0.0, 0.25, 0.5][channel as usize]
    };
    SHADERS
        .function("grade::graded")
        .with("curve", curve)
        .with("curve_sampler", Sampler::LINEAR)
        .with("exposure", Uniform::new(2.0_f32))
        .with("offsets", Storage::new([0.0_f32, 0.25, 0.5]))
        .over((0.0..=1.0, Integers(0..=2_u32)))
        .agrees_with(reference, Abs(0.01)); // filters have 8 bits of weight
}

#[test]
fn wrapped() {
    // `next` has a parameter that points to a structure of the module.
    let glue = Package::from_source(
        "glue",
        "import shaders::hash::{Stream, next};

         fn third(seed: u32) -> f32 {
             var stream = Stream(seed);
             next(&stream);
             next(&stream);
             return next(&stream);
         }",
    )
    .depends_on("shaders", &SHADERS);
    glue.function("third").over(Integers(0..=u32::MAX)).stays_within(0.0..=1.0);
}

#[test]
fn random_numbers() {
    let random = || SHADERS.function("hash::random").sampled_over(Just(()), |(), seed: u32| seed);
    random().has_mean("x", |x: f32| x.into(), |()| 0.5, 1e-6);
    random().has_distribution("x", |x: f32| x.into(), |(), x| x.clamp(0.0, 1.0), 1e-6);
}

#[test]
fn reinhard() {
    let reinhard = |x: f64| x / (1.0 + x);
    // The package reads its files when the test runs, so an edit needs no build.
    SHADERS.function("tonemap::reinhard").over(0.0..=100.0).agrees_with(reinhard, Ulp(4.0));
    // The text that was compiled into the engine.
    let built = Package::from_source("tonemap", include_str!("../shaders/tonemap.wgsl"));
    built.function("reinhard").over(0.0..=100.0).agrees_with(reinhard, Ulp(4.0));
}

#[test]
fn another_tolerance_on_one_path() {
    SHADERS
        .function("brdf::schlick")
        .over((0.0..=1.0, 0.0..=1.0))
        .tolerance_on("vulkan@nvidia", Rel(1e-4))
        .agrees_with(|f0: f64, c: f64| f0 + (1.0 - f0) * (1.0 - c).powi(5), Ulp(16.0));
}

#[test]
fn all_modules_are_valid() {
    SHADERS.is_valid();
}

/// The guide's sample of a known issue. The sample is compiled but never run, because `fails_on` requires that the
/// check fails on GL.
#[expect(dead_code, reason = "it would have to fail on GL")]
fn a_known_issue() {
    let mix = SHADERS.function("layering::masked").over((0.0..=1.0, 0.0..=1.0));
    mix.fails_on(Path::GL, "llvmpipe's mix cancels: mesa#1234")
        .agrees_with(|base: f64, mask: f64| base * (1.0 - mask), Ulp(4.0));
}
