//! What drivers do wrong, declared: each of these is found as long as it lasts.

use karat::prelude::*;

/// WGSL's `mix` is as accurate as x (1 - a) + y a, which is y at a = 1. (So the library's masks are
/// written out: white over a bright base would show what rounding leaves of the base.)
#[test]
fn mix_ends_at_its_second_value() {
    let module = "fn blend(x: f32, y: f32, a: f32) -> f32 { return mix(x, y, a); }";
    Package::from_modules("blending", [("blending", module)])
        .function("blending::blend")
        .over((1.0..=50.0, 1e-4..=1.0, Just(1.0)))
        .fails_on(Path::GL, "Mesa's llvmpipe computes mix as x + (y - x) * a, which cancels")
        .agrees_with(|_: f64, y: f64, _: f64| y, Ulp(1.0));
}
