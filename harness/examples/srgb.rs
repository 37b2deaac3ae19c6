//! Testing a shader of one's own: `cargo test -p karat --example srgb`, or `cargo run` to see what
//! a check compares.
//!
//! In a project, this is a file in `tests/`, and the shaders are in a folder beside Cargo.toml.

use karat::prelude::*;

static SHADERS: Package = karat::package!("examples/shaders");

/// The reference: the standard's formula, in f64.
fn encode(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Outside of a test, a check tells what it compared.
#[expect(clippy::print_stdout, reason = "it shows an agreement")]
fn main() {
    let check = SHADERS.function("srgb::encode").over(0.0..=1.0);
    println!("{}", check.agrees_with(encode, Abs(1e-6)));
}

/// WGSL takes pow(x, y) as exp2(y * log2(x)): near 1, log2 has an absolute error of 2^-21 and
/// exp2 one of 3 ulp, so 1e-6 is what one can ask for.
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

/// A round trip alone would miss an error that both directions share; each has its reference.
#[test]
fn decoding_follows_the_standard() {
    let decode = |encoded: f64| {
        if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
    };
    SHADERS.function("srgb::decode").over(0.0..=1.0).agrees_with(decode, Abs(2e-6));
}
