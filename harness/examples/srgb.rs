//! Tests a shader of your own. Run `cargo test -p karat --example srgb`, or `cargo run -p karat --example srgb` to see
//! what a check compares.
//!
//! In a project, this file would be in `tests/`, and the shaders in a folder beside Cargo.toml.

use karat::prelude::*;

static SHADERS: Package = karat::package!("examples/shaders");

/// The reference, which computes the formula of the sRGB standard in `f64`.
fn encode(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Outside of a test, the program prints the paths and cases that the check compared.
#[expect(clippy::print_stdout, reason = "it shows an agreement")]
fn main() {
    let check = SHADERS.function("srgb::encode").over(0.0..=1.0);
    println!("{}", check.agrees_with(encode, Abs(1e-6)));
}

/// WGSL computes pow(x, y) as exp2(y * log2(x)). Near 1, WGSL allows `log2` an absolute error of 2^-21 and `exp2` an
/// error of 3 ulp, so a tolerance below 1e-6 would be too strict.
#[test]
fn encoding_follows_the_standard() {
    SHADERS.function("srgb::encode").over(0.0..=1.0).agrees_with(encode, Abs(1e-6));
}

#[test]
fn encoding_stays_in_range() {
    SHADERS
        .function("srgb::encode")
        .over(0.0..=1.0)
        .satisfies("lies in 0..=1", |_, e: f32| (0.0..=1.0 + 1e-6).contains(&e));
}

/// A test of only the round trip would miss errors that cancel each other, so each direction has its own reference.
#[test]
fn decoding_follows_the_standard() {
    let decode = |encoded: f64| {
        if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
    };
    SHADERS.function("srgb::decode").over(0.0..=1.0).agrees_with(decode, Abs(2e-6));
}
