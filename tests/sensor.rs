//! Tests exposure, tone mapping and the sRGB transfer function against their standards.

use glam::{DVec3, UVec3, Vec3};
use karat::check::{Agreement, Failure};
use karat::prelude::*;
use shaders::{PBR, sensor};

/// The tolerance for results near 0, because WGSL may flush results below the smallest normal f32 to 0.
const UNDERFLOW: Abs = Abs(1e-30);

fn colors(most: f32) -> impl Domain<Value = Vec3> {
    (0.0..=most, 0.0..=most, 0.0..=most).map(|(r, g, b)| Vec3::new(r, g, b))
}

fn calling(functions: &str, wgsl: &str) -> Package {
    let text = format!("import pbr::sensor::{{{functions}}};\n{wgsl}");
    Package::from_source("calling", text).depends_on("pbr", &PBR)
}

#[track_caller]
fn holds(result: Result<Agreement, Failure>) {
    if let Err(failure) = result {
        panic!("{failure}");
    }
}

/// WGSL allows `log2` an error of 3 ulp, which is 6e-6 for results of up to 24, and an absolute error of 2^-21 for
/// results near 0. The argument of `log2` has an error of up to 7 ulp, which adds 1.2e-6.
#[test]
fn ev100_from_camera() {
    PBR.function("sensor::ev100_from_camera")
        .over((0.7..=64.0, 1.25e-4..=60.0, 50.0..=102_400.0))
        .agrees_with(sensor::ev100_from_camera, Abs(7e-6));
}

/// WGSL allows `exp2(x)` an error of `3 + 2 * abs(x)` ulp, which is 45 ulp for the largest exposure value, 21. A
/// division adds 2.5 ulp.
#[test]
fn exposure_from_ev100() {
    PBR.function("sensor::exposure_from_ev100")
        .over(-6.0..=21.0)
        .agrees_with(sensor::exposure_from_ev100, Ulp(48.0));
}

/// WGSL allows `exp2(x)` an error of `3 + 2 * abs(x)` ulp, which is 23 ulp for 10 stops. The rounding of the product
/// adds up to 0.5 ulp.
#[test]
fn expose() {
    PBR.function("sensor::expose")
        .over((colors(1e4), -10.0..=10.0))
        .agrees_with(sensor::expose, Ulp(24.0).or(UNDERFLOW));
}

/// The function computes three products and two sums of positive terms. WGSL may flush each product to 0.
#[test]
fn luminance() {
    PBR.function("sensor::luminance")
        .over(colors(1e4))
        .agrees_with(sensor::luminance, Ulp(4.0).or(Abs(3.0 * f64::from(f32::MIN_POSITIVE))));
}

/// The function computes sums of positive terms, and two divisions, each with an error of 2.5 ulp.
#[test]
fn reinhard() {
    PBR.function("sensor::reinhard")
        .over((0.0..=1e4, 0.1..=1e4))
        .agrees_with(sensor::reinhard, Ulp(9.0).or(UNDERFLOW));
}

/// The result has the errors of `reinhard`. The luminance of the colour is also rounded, and occurs in the numerator
/// and in the denominator.
#[test]
fn tone_map() {
    PBR.function("sensor::tone_map")
        .over((colors(1e4), 0.1..=1e4))
        .agrees_with(sensor::tone_map, Ulp(14.0).or(UNDERFLOW));
}

/// Tests white points so small that their square underflows to 0. Almost all colours are brighter than these white
/// points. A channel of 0 stays 0. The test uses only colours for which the results are finite in f32.
// Lesson 31
#[test]
fn a_white_next_to_black() {
    // Channels that are 0, or large enough for normal results.
    let channels = |most| {
        colors(most).filter(|color: &Vec3| color.to_array().iter().all(|c| *c == 0.0 || *c >= 1e-6))
    };
    let domain = (-30.0..=-15.0_f32, channels(1.0)).map(|(log, color)| {
        let white = 10.0_f32.powf(log);
        (color * white, white)
    });
    PBR.function("sensor::tone_map")
        .over(&domain)
        .agrees_with(sensor::tone_map, Ulp(14.0).or(UNDERFLOW));
    PBR.function("sensor::reinhard")
        .over(domain.map(|(color, white)| (color.x, white)))
        .agrees_with(sensor::reinhard, Ulp(9.0).or(UNDERFLOW));
    let bright = (-15.0..=-1.0_f32, channels(1e4)).map(|(log, color)| (color, 10.0_f32.powf(log)));
    PBR.function("sensor::tone_map")
        .over(bright)
        .agrees_with(sensor::tone_map, Ulp(14.0).or(UNDERFLOW));
}

/// For white points below 1e-15, a bright colour exceeds the range of f32, so the result is infinite, but never NaN. No
/// verb accepts infinity as a result, so this test examines the bits of the result.
// Lesson 31
#[test]
fn no_white_makes_a_nan() {
    let package = calling(
        "tone_map",
        "fn bits(color: vec3f, white: f32) -> vec3u {
            return bitcast<vec3u>(tone_map(color, white));
        }",
    );
    let bright = (colors(1e4), -30.0..=-15.0_f32).map(|(color, log)| (color, 10.0_f32.powf(log)));
    let bits = package.function("bits").over(bright).unrecorded().try_satisfies(
        "is 0 where the colour is, and a number or infinity elsewhere",
        |(color, _), bits: UVec3| {
            let mapped = bits.to_array().map(f32::from_bits);
            color
                .to_array()
                .iter()
                .zip(mapped)
                .all(|(c, mapped)| if *c == 0.0 { mapped == 0.0 } else { mapped >= 0.0 })
        },
    );
    holds(bits);
}

/// Tests the purpose of eq. 4 of the paper: the luminance of the white point becomes 1, and darker luminances become at
/// most 1.
#[test]
fn reinhard_ends_at_white() {
    let darker = (0.0..=1.0_f32, 0.1..=1e4_f32).map(|(share, white)| (share * white, white));
    PBR.function("sensor::reinhard").over(darker).satisfies("is at most 1", |_, mapped: f32| {
        (0.0..=1.0 + 4.0 * f32::EPSILON).contains(&mapped)
    });
    let white = (0.1..=1e4_f32).map(|white| (white, white));
    PBR.function("sensor::reinhard").over(white).agrees_with(|_: f64, _: f64| 1.0, Ulp(9.0));
}

/// WGSL computes a power x^y as exp2(y log2 x), here with y = 1 / 2.4. On the curved part of 0..=1, log2 x is between 0
/// and -8.4, with an error of up to 3 ulp, 2.9e-6 (2^-21 near x = 1). Multiplied by y and ln 2, this is a relative
/// error of 8.3e-7 of the power. Computing exp2 of exponents between -3.5 and 0 adds 10 ulp, or 1.2e-6. Subtracting
/// 0.055 raises the relative error to 3e-6 for the darkest results, 0.04. For colours from 1 to 100, log2 x is at most
/// 6.7 and the exponent at most 2.8, so the same bound holds.
#[test]
fn srgb_from_linear() {
    PBR.function("sensor::srgb_from_linear")
        .over(colors(1.0))
        .agrees_with(sensor::srgb_from_linear, Rel(5e-6).or(UNDERFLOW));
    PBR.function("sensor::srgb_from_linear")
        .over(colors(100.0))
        .agrees_with(sensor::srgb_from_linear, Rel(5e-6).or(UNDERFLOW));
}

/// WGSL computes a power x^y as exp2(y log2 x), here with y = 2.4. On the curved part of 0..=1, log2 x is between -3.5
/// and 0, with an error of up to 7.2e-7. Multiplied by y and ln 2, this is a relative error of 1.2e-6 of the power. The
/// error of x, 4 ulp, adds 4 ulp times y (1.2e-6). Computing exp2 of exponents between -8.3 and 0 adds 20 ulp (2.4e-6).
#[test]
fn linear_from_srgb() {
    PBR.function("sensor::linear_from_srgb")
        .over(colors(1.0))
        .agrees_with(sensor::linear_from_srgb, Rel(5e-6).or(UNDERFLOW));
}

/// Tests all 256 codes of textures with 8 bits per channel.
#[test]
fn linear_from_all_eight_bit_codes() {
    let codes = Integers(0..=255_u32).map(|code| Vec3::splat(code as f32 / 255.0));
    PBR.function("sensor::linear_from_srgb")
        .over(codes)
        .agrees_with(sensor::linear_from_srgb, Rel(5e-6));
}

/// The functions don't clamp negative values and don't return NaN for them, but continue the straight part of the sRGB
/// curve.
#[test]
fn srgb_is_not_clamped() {
    let negative = (-1.0..=0.0_f32).map(Vec3::splat);
    PBR.function("sensor::srgb_from_linear")
        .over(&negative)
        .agrees_with(|color: DVec3| 12.92 * color, Ulp(1.0));
    PBR.function("sensor::linear_from_srgb")
        .over(&negative)
        .agrees_with(|color: DVec3| color / 12.92, Ulp(3.0));
}

/// Converting each code of 8 bits to linear light and back gives the same code.
#[test]
fn eight_bit_codes_survive_a_round_trip() {
    let package = calling(
        "linear_from_srgb, srgb_from_linear",
        "fn round_trip(code: u32) -> u32 {
            let linear = linear_from_srgb(vec3f(f32(code) / 255.0));
            return u32(srgb_from_linear(linear).x * 255.0 + 0.5);
        }",
    );
    let codes = package.function("round_trip").over(Integers(0..=255_u32));
    holds(codes.unrecorded().try_agrees_with(|code: u32| code, Ulp(0.0)));
}

/// Converting a colour to sRGB and back gives the same colour, except for the errors of both functions. The slope of
/// the second function multiplies the error of the first function.
#[test]
fn colors_survive_a_round_trip() {
    let package = calling(
        "linear_from_srgb, srgb_from_linear",
        "fn round_trip(color: vec3f) -> vec3f {
            return linear_from_srgb(srgb_from_linear(color));
        }",
    );
    let colors = package.function("round_trip").over(colors(1.0));
    holds(colors.unrecorded().try_agrees_with(|color: DVec3| color, Rel(1.5e-5).or(UNDERFLOW)));
}

/// One step of the exposure value EV100 is one stop: brightening light by `ev100` stops cancels the exposure for
/// `ev100`, except for its factor of 1 / 1.2.
#[test]
fn a_stop_of_exposure_value_is_a_stop_of_light() {
    let package = calling(
        "exposure_from_ev100, expose",
        "fn exposed(radiance: vec3f, ev100: f32) -> vec3f {
            return expose(radiance, ev100) * exposure_from_ev100(ev100);
        }",
    );
    let light = package.function("exposed").over((colors(1e4), -6.0..=20.0));
    holds(
        light
            .unrecorded()
            .try_agrees_with(|radiance: DVec3, _: f64| radiance / 1.2, Ulp(90.0).or(UNDERFLOW)),
    );
}
