//! Tests computations of irradiance with the mistakes of papers and lectures. In a white environment of radiance 1, the
//! right result is 1.

use glam::{DVec3, Vec3};
use karat::check::{Calls, Failure};
use karat::prelude::*;
use karat::unstable::check::Disagreement;
use shaders::{PBR, irradiance};

#[track_caller]
fn caught<T>(result: Result<T, Failure>) -> Disagreement {
    match result {
        Ok(_) => panic!("the mistake was not seen"),
        Err(Failure::Disagreement(disagreement)) => *disagreement,
        Err(other) => panic!("the check failed for another reason: {other}"),
    }
}

fn in_environment(function: &str, environment: CubeMap) -> karat::check::Probe<'static> {
    PBR.function(&format!("as_written::irradiance::{function}"))
        .with("environment", environment)
        .with("environment_sampler", Sampler::LINEAR)
}

fn furnace(function: &str) -> karat::check::Probe<'static> {
    in_environment(function, CubeMap::constant(Vec3::ONE))
}

/// Mistake E13: the result is 0.5.
#[test]
fn a_factor_of_two_is_missing() {
    let estimate = || {
        let samples = OneOf(vec![1, 64, 1024_u32]);
        furnace("estimate").over((UnitRgb, UnitVector, samples)).cases(1024)
    };
    let correct = |colour: DVec3, _: DVec3, _: u32| colour;
    let found = caught(estimate().unrecorded().try_agrees_with(correct, Abs(1e-5)));
    assert!(found.paths.iter().all(|path| path.census.too_low == path.census.failures), "{found}");
    estimate().agrees_with(|colour: DVec3, _: DVec3, _: u32| 0.5 * colour, Abs(1e-5));
}

/// Normals, except for normals along Y, which show another mistake: E20.
fn normals() -> impl Domain<Value = Vec3> {
    UnitVector.filter(|n| n.x.hypot(n.z) > 1e-3)
}

/// The two step sizes, of azimuth and polar angle, in the article that `shaders/README.md` cites.
const PRINTED: (f32, f32) = (0.025, 0.1);

/// A check of the article's loop in a white environment, for all normals.
fn nested_loop(steps: (f32, f32)) -> karat::Check<'static, Calls<(Vec3, f32, f32)>> {
    furnace("nested_loop").over((normals(), Just(steps.0), Just(steps.1))).cases(16)
}

/// Mistake E18: the result is 0.9805, which is pi / 16 times the sum of cos sin. If each term is multiplied by the true
/// step sizes, the result is 1.0014.
#[test]
fn the_loop_is_dark() {
    let correct = |_: DVec3, _: f64, _: f64| DVec3::ONE;
    let found = caught(nested_loop(PRINTED).unrecorded().try_agrees_with(correct, Abs(1e-3)));
    assert!(found.paths.iter().all(|path| path.census.failures == path.census.cases), "{found}");
    nested_loop(PRINTED).agrees_with(|_: DVec3, _: f64, _: f64| DVec3::splat(0.9805), Abs(5e-5));
    furnace_of_library("irradiance::loop_corrected")
        .over(normals())
        .cases(16)
        .agrees_with(|_: DVec3| DVec3::splat(1.0014), Abs(5e-5));
    furnace_of_library("irradiance::midpoint")
        .over((normals(), Just(252_u32), Just(16_u32)))
        .cases(16)
        .agrees_with(|_: DVec3, _: u32, _: u32| DVec3::ONE, Abs(1e-5));
}

fn furnace_of_library(function: &str) -> karat::check::Probe<'static> {
    PBR.function(function)
        .with("environment", CubeMap::constant(Vec3::ONE))
        .with("environment_sampler", Sampler::LINEAR)
}

/// Mistake E17: the article calls its loop a Monte Carlo estimator, so four times as many terms should halve the error.
/// The loop uses no random numbers, and its error hardly changes: 0.9805 becomes 0.9815. The reason is that 32 steps of
/// 0.05 end at 1.6 instead of pi / 2, just as 16 steps of 0.1 do.
#[test]
fn more_terms_are_not_more_samples() {
    let halved = (PRINTED.0 / 2.0, PRINTED.1 / 2.0);
    let half_of_the_error = |_: DVec3, _: f64, _: f64| DVec3::splat(1.0 - 0.5 * (1.0 - 0.9805));
    caught(nested_loop(halved).unrecorded().try_agrees_with(half_of_the_error, Abs(5e-3)));
    nested_loop(halved).agrees_with(|_: DVec3, _: f64, _: f64| DVec3::splat(0.9815), Abs(5e-5));
}

/// Mistake E20: for a normal along Y, at the centre of faces 2 and 3, the result is NaN. If a map's side is odd, for
/// example 1, a texel is at this centre.
#[test]
fn nothing_is_right_of_up() {
    let upright = || OneOf(vec![Vec3::Y, Vec3::NEG_Y]);
    let found = caught(
        PBR.function("as_written::irradiance::right_of")
            .over(upright())
            .unrecorded()
            .try_satisfies("is of unit length", |_, right: Vec3| right.is_normalized()),
    );
    assert!(found.paths.iter().all(|path| path.census.nan == 2), "{found}");
    // A texture lookup turns the NaN into some texel, but not into the texel that lights a floor.
    let sky = || CubeMap::from_fn(64, |d| Vec3::splat(1.0 + 0.9 * d.y));
    let below = |n: DVec3| DVec3::splat(irradiance::linear(n, 1.0, 0.9 * DVec3::Y));
    caught(
        in_environment("nested_loop", sky())
            .over((upright(), Just(PRINTED.0), Just(PRINTED.1)))
            .unrecorded()
            .try_agrees_with(|n: DVec3, _: f64, _: f64| below(n), Abs(0.1)),
    );
    PBR.function("irradiance::midpoint")
        .with("environment", sky())
        .with("environment_sampler", Sampler::LINEAR)
        .over((upright(), Just(64_u32), Just(32_u32)))
        .agrees_with(|n: DVec3, _: u32, _: u32| below(n), Abs(5e-4));
}

/// An irradiance map of a sky that is brighter towards +Z: E / pi is 1 + 0.6 z, apart from errors of the texture
/// filter.
fn irradiance_map() -> CubeMap {
    let gradient = 0.9 * DVec3::Z;
    CubeMap::from_fn(32, |n| Vec3::splat(irradiance::linear(n.as_dvec3(), 1.0, gradient) as f32))
}

/// Mistake E7: seen at grazing angles, a white floor has the radiance 1 instead of 1.6.
#[test]
fn a_lambertian_looks_the_same_from_everywhere() {
    let floor = |v: Vec3| {
        in_environment("lambert_lookup_by_outgoing", irradiance_map()).over((
            Just(Vec3::ONE),
            Just(Vec3::Z),
            Just(v),
        ))
    };
    let all = in_environment("lambert_lookup_by_outgoing", irradiance_map())
        .over((Just(Vec3::ONE), Just(Vec3::Z), Hemisphere))
        .cases(1024);
    caught(all.unrecorded().try_invariant_under(
        |(colour, n, v)| (colour, n, Vec3::new(v.y, v.z, v.x.abs())),
        Abs(0.1),
    ));
    let below =
        |_: DVec3, n: DVec3, _: DVec3| DVec3::splat(irradiance::linear(n, 1.0, 0.9 * DVec3::Z));
    // On GL, the error at the edges of faces is half of the difference between two texels: 0.6 / 32.
    let filter = Abs(0.02);
    let found = caught(floor(Vec3::X).unrecorded().try_agrees_with(below, filter));
    for path in &found.paths {
        assert!((f64::from(f32::from_bits(path.worst.actual)) - 1.0).abs() < 0.02, "{found}");
        assert!(path.worst.expected.is_some_and(|e| (e - 1.6).abs() < 1e-6), "{found}");
    }
    floor(Vec3::Z).agrees_with(below, filter);
}

/// Mistake E8: the result is the correct radiance divided by pi.
#[test]
fn stored_irradiance_is_already_divided_by_pi() {
    let white = || PBR.function("as_written::irradiance::lambert").over((UnitRgb, Just(Vec3::ONE)));
    caught(white().unrecorded().try_agrees_with(irradiance::lambert, Ulp(1.0)));
    let found = caught(
        PBR.function("as_written::irradiance::lambert")
            .over((Just(Vec3::ONE), Just(Vec3::ONE)))
            .unrecorded()
            .try_agrees_with(irradiance::lambert, Ulp(1.0)),
    );
    for path in &found.paths {
        let actual = f64::from(f32::from_bits(path.worst.actual));
        assert!((actual - std::f64::consts::FRAC_1_PI).abs() < 1e-7, "{found}");
    }
}

/// Mistake E19: a parenthesis is missing in the article's shader: `return float4( PI * sampledColour / index), 1 );`.
/// The test contains this line, translated to WGSL.
#[test]
fn an_unbalanced_parenthesis_is_shown_where_it_is() {
    let text = "const PI: f32 = 3.14159265;\n\n\
        fn averaged(sampled_colour: vec3f, index: f32) -> vec4f {\n    \
            return vec4f(PI * sampled_colour / index), 1.0);\n\
        }\n";
    let package = Package::from_modules("article", [("convolve", text)]);
    let found = package
        .function("convolve::averaged")
        .over((UnitRgb, 1.0..=2.0))
        .unrecorded()
        .try_satisfies("is anything", |_, _: glam::Vec4| true);
    let message = found.expect_err("it doesn't compile").to_string();
    for part in ["expected `;`, found \",\"", "<convolve>:4:46", "/ index), 1.0);"] {
        assert!(message.contains(part), "`{part}` is missing in:\n{message}");
    }
    let mended =
        Package::from_modules("article", [("convolve", text.replace("vec4f(PI", "vec4f((PI"))]);
    mended
        .function("convolve::averaged")
        .over((UnitRgb, 1.0..=2.0))
        .satisfies("is opaque", |_, colour: glam::Vec4| colour.w == 1.0);
}
