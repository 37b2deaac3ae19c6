//! Expressions that lose digits, or become NaN or infinite, for some inputs in their ranges, and equivalent expressions
//! without these faults. All these expressions compute in `f32`. Some are from chapter 3 of Hamming, *Numerical Methods
//! for Scientists and Engineers*. The others are the 33 single-precision expressions in Herbie's benchmarks.
//! These 33 expressions come from pbrt, from the specification of Direct3D 11.3 (section 7.8.11, on the level of
//! detail), and from three inverse hyperbolic functions of Rust.

#![expect(clippy::approx_constant, reason = "they are the constants that the shaders have")]

use karat::check::HazardKind;
use karat::prelude::*;

/// An expression, the ranges of its inputs, and the same computation in `f32` and in `f64`.
struct Expression {
    text: &'static str,
    inputs: &'static [(&'static str, f64, f64)],
    single: fn(&[f32]) -> f32,
    double: fn(&[f64]) -> f64,
}

macro_rules! expression {
    ($text:expr, [$($x:ident in $from:literal..$to:literal),*], $value:expr) => {
        Expression {
            text: $text,
            inputs: &[$((stringify!($x), $from, $to)),*],
            single: |row| {
                let [$($x),*] = *row else { unreachable!("as many as inputs") };
                $value
            },
            double: |row| {
                let [$($x),*] = *row else { unreachable!("as many as inputs") };
                $value
            },
        }
    };
}

fn of_hamming() -> Vec<Expression> {
    vec![
        expression!("sqrt(x + 1.0) - sqrt(x)", [x in 1e3..1e6], (x + 1.0).sqrt() - x.sqrt()),
        expression!("1.0 / (sqrt(x + 1.0) + sqrt(x))", [x in 1e3..1e6], 1.0 / ((x + 1.0).sqrt() + x.sqrt())),
        expression!("sin(x + y) - sin(x)", [x in 0.1..3.0, y in 1e-6..1e-4], (x + y).sin() - x.sin()),
        expression!(
            "2.0 * sin(0.5 * y) * cos(x + 0.5 * y)",
            [x in 0.1..1.0, y in 1e-6..1e-4],
            2.0 * (0.5 * y).sin() * (x + 0.5 * y).cos()
        ),
        expression!("cos(x + y) - cos(x)", [x in 0.1..3.0, y in 1e-6..1e-4], (x + y).cos() - x.cos()),
        expression!("1.0 / (x + 1.0) - 1.0 / x", [x in 1e3..1e5], 1.0 / (x + 1.0) - 1.0 / x),
        expression!("-1.0 / (x * (x + 1.0))", [x in 1e3..1e5], -1.0 / (x * (x + 1.0))),
        expression!("log(x + 1.0) - log(x)", [x in 1e4..1e6], (x + 1.0).ln() - x.ln()),
        expression!("atan(x + 1.0) - atan(x)", [x in 1e2..1e4], (x + 1.0).atan() - x.atan()),
        expression!(
            "1.0 / sqrt(x) - 1.0 / sqrt(x + 1.0)",
            [x in 1e3..1e5],
            1.0 / x.sqrt() - 1.0 / (x + 1.0).sqrt()
        ),
        expression!("exp(x) - 1.0", [x in 1e-6..1e-3], x.exp() - 1.0),
        expression!("x + 0.5 * x * x", [x in 1e-6..1e-3], x + 0.5 * x * x),
        expression!("exp(x) - 2.0 + exp(-x)", [x in 1e-3..0.1], x.exp() - 2.0 + (-x).exp()),
        expression!("(1.0 - cos(x)) / (x * x)", [x in 1e-3..0.1], (1.0 - x.cos()) / (x * x)),
        expression!(
            "2.0 * sin(0.5 * x) * sin(0.5 * x) / (x * x)",
            [x in 1e-3..0.1],
            2.0 * (0.5 * x).sin() * (0.5 * x).sin() / (x * x)
        ),
        expression!("(1.0 - cos(x)) / sin(x)", [x in 1e-3..0.1], (1.0 - x.cos()) / x.sin()),
        expression!("log((1.0 - x) / (1.0 + x))", [x in 1e-6..1e-3], ((1.0 - x) / (1.0 + x)).ln()),
        expression!("log(1.0 - x) / log(1.0 + x)", [x in 1e-6..1e-3], (1.0 - x).ln() / (1.0 + x).ln()),
        expression!("-x + sqrt(x * x - 1.0)", [x in 1e2..1e4], -x + (x * x - 1.0).sqrt()),
        expression!("-x - sqrt(x * x - 1.0)", [x in 2.0..1e4], -x - (x * x - 1.0).sqrt()),
        expression!(
            "1.0 / (x + 1.0) - 2.0 / x + 1.0 / (x - 1.0)",
            [x in 1e2..1e4],
            1.0 / (x + 1.0) - 2.0 / x + 1.0 / (x - 1.0)
        ),
        expression!("x - sin(x)", [x in 1e-2..0.1], x - x.sin()),
        expression!("1.0 / x - 1.0 / tan(x)", [x in 1e-3..0.1], 1.0 / x - 1.0 / x.tan()),
        expression!("x * x + y * y", [x in -1e3..1e3, y in -1e3..1e3], x * x + y * y),
        expression!("x * x - y * y", [x in 1e3..1.001e3, y in 1e3..1.001e3], x * x - y * y),
        expression!("x * y", [x in 1e-3..1e3, y in 1e-3..1e3], x * y),
        expression!("sqrt(x * x + y * y)", [x in 0.1..1e3, y in 0.1..1e3], (x * x + y * y).sqrt()),
        expression!("x / (1.0 + x)", [x in 0.0..1e4], x / (1.0 + x)),
        expression!("exp(-x) * y", [x in 0.0..10.0, y in 0.5..2.0], (-x).exp() * y),
        expression!("log(1.0 + x) * y", [x in 0.5..1e3, y in 0.5..2.0], (1.0 + x).ln() * y),
    ]
}

fn of_herbie() -> Vec<Expression> {
    vec![
        expression!(
            "let a = ci * co / v; let b = si * so / v; return exp(-b) * a / (sinh(1.0 / v) * 2.0 * v);",
            [ci in -1.0..1.0, co in -1.0..1.0, si in -1.0..1.0, so in -1.0..1.0, v in 0.1..1.5707964],
            (-(si * so / v)).exp() * (ci * co / v) / ((1.0 / v).sinh() * 2.0 * v)
        ),
        expression!(
            "let a = ci * co / v; let b = si * so / v; return exp(a - b - 1.0 / v + 0.6931 + log(1.0 / (2.0 * v)));",
            [ci in -1.0..1.0, co in -1.0..1.0, si in -1.0..1.0, so in -1.0..1.0, v in -1.5707964..0.1],
            (ci * co / v - si * so / v - 1.0 / v + 0.6931 + (1.0 / (2.0 * v)).ln()).exp()
        ),
        expression!(
            "1.0 + v * log(u + (1.0 - u) * exp(-2.0 / v))",
            [u in 1e-5..1.0, v in 0.0..109.746574],
            1.0 + v * (u + (1.0 - u) * (-2.0 / v).exp()).ln()
        ),
        expression!(
            "let s2 = s * s; return asin(h / sqrt(eta * eta - s2 / sqrt(1.0 - s2)));",
            [s in -1.0..1.0, h in -1.0..1.0, eta in 0.0..10.0],
            (h / (eta * eta - s * s / (1.0 - s * s).sqrt()).sqrt()).asin()
        ),
        expression!(
            "let c = 1.0 - ux + ux * most; let s = sqrt(1.0 - c * c); let phi = uy * 2.0 * 3.1415927; \
             return cos(phi) * s;",
            [ux in 2.328306437e-10..1.0, uy in 2.328306437e-10..1.0, most in 0.0..1.0],
            {
                let c = 1.0 - ux + ux * most;
                let s = (1.0 - c * c).sqrt();
                let phi = uy * 2.0 * 3.141_592_7;
                phi.cos() * s
            }
        ),
        expression!(
            "let c = 1.0 - ux + ux * most; let s = sqrt(1.0 - c * c); let phi = uy * 2.0 * 3.1415927; \
             return sin(phi) * s;",
            [ux in 2.328306437e-10..1.0, uy in 2.328306437e-10..1.0, most in 0.0..1.0],
            {
                let c = 1.0 - ux + ux * most;
                let s = (1.0 - c * c).sqrt();
                let phi = uy * 2.0 * 3.141_592_7;
                phi.sin() * s
            }
        ),
        expression!(
            "1.0 - ux + ux * most",
            [ux in 2.328306437e-10..1.0, most in 0.0..1.0],
            1.0 - ux + ux * most
        ),
        expression!(
            "let c = (1.0 - ux) * most * ux; let s = sqrt(1.0 - c * c); let phi = uy * 2.0 * 3.1415927; \
             return cos(phi) * s * x + sin(phi) * s * y + c * z;",
            [
                x in -1e4..1e4, y in -1e4..1e4, z in -1e4..1e4, ux in 2.328306437e-10..1.0,
                uy in 2.328306437e-10..1.0, most in 0.0..1.0
            ],
            {
                let c = (1.0 - ux) * most * ux;
                let s = (1.0 - c * c).sqrt();
                let phi = uy * 2.0 * 3.141_592_7;
                phi.cos() * s * x + phi.sin() * s * y + c * z
            }
        ),
        expression!(
            "let inverse = 1.0 / sin(a); return sin((1.0 - u) * a) * inverse * n0 + sin(u * a) * inverse * n1;",
            [a in 0.0..1.5707964, n0 in -1.0..1.0, n1 in -1.0..1.0, u in 2.328306437e-10..1.0],
            {
                let inverse = 1.0 / a.sin();
                ((1.0 - u) * a).sin() * inverse * n0 + (u * a).sin() * inverse * n1
            }
        ),
        expression!(
            "let p = x * 3.1415927; return sin(p * tau) / (p * tau) * (sin(p) / p);",
            [x in 1e-5..1.0, tau in 1.0..5.0],
            {
                let p = x * 3.141_592_7;
                (p * tau).sin() / (p * tau) * (p.sin() / p)
            }
        ),
        expression!(
            "sqrt(-log(1.0 - u1)) * cos(2.0 * 3.1415927 * u2)",
            [u1 in 2.328306437e-10..1.0, u2 in 2.328306437e-10..1.0],
            (-(1.0 - u1).ln()).sqrt() * (2.0 * 3.141_592_7 * u2).cos()
        ),
        expression!(
            "sqrt(-log(1.0 - u1)) * sin(2.0 * 3.1415927 * u2)",
            [u1 in 2.328306437e-10..1.0, u2 in 2.328306437e-10..1.0],
            (-(1.0 - u1).ln()).sqrt() * (2.0 * 3.141_592_7 * u2).sin()
        ),
        expression!(
            "sqrt(u1 / (1.0 - u1)) * cos(6.2831853 * u2)",
            [u1 in 2.328306437e-10..1.0, u2 in 2.328306437e-10..1.0],
            (u1 / (1.0 - u1)).sqrt() * (6.283_185_3 * u2).cos()
        ),
        expression!(
            "sqrt(u1 / (1.0 - u1)) * sin(6.2831853 * u2)",
            [u1 in 2.328306437e-10..1.0, u2 in 2.328306437e-10..1.0],
            (u1 / (1.0 - u1)).sqrt() * (6.283_185_3 * u2).sin()
        ),
        expression!(
            "let phi = atan(ay / ax * tan(2.0 * 3.1415927 * u1 + 0.5 * 3.1415927)); \
             let a2 = 1.0 / (cos(phi) * cos(phi) / (ax * ax) + sin(phi) * sin(phi) / (ay * ay)); \
             return 1.0 / sqrt(1.0 + a2 * u0 / (1.0 - u0));",
            [u0 in 2.328306437e-10..1.0, u1 in 2.328306437e-10..0.5, ax in 0.0001..1.0, ay in 0.0001..1.0],
            {
                let phi = (ay / ax * (2.0 * 3.141_592_7 * u1 + 0.5 * 3.141_592_7).tan()).atan();
                let a2 = 1.0 / (phi.cos() * phi.cos() / (ax * ax) + phi.sin() * phi.sin() / (ay * ay));
                1.0 / (1.0 + a2 * u0 / (1.0 - u0)).sqrt()
            }
        ),
        expression!(
            "let e = exp(-abs(x) / s); return e / (s * (1.0 + e) * (1.0 + e));",
            [x in -1e6..1e6, s in 0.0..1.0651631],
            {
                let e = (-x.abs() / s).exp();
                e / (s * (1.0 + e) * (1.0 + e))
            }
        ),
        expression!(
            "1.0 / (1.0 + exp(-x / s))",
            [x in -1e6..1e6, s in 0.0..1.0651631],
            1.0 / (1.0 + (-x / s).exp())
        ),
        expression!(
            "let low = 1.0 / (1.0 + exp(3.1415927 / s)); let high = 1.0 / (1.0 + exp(-3.1415927 / s)); \
             return -s * log(1.0 / (u * (high - low) + low) - 1.0);",
            [u in 2.328306437e-10..1.0, s in 0.0..1.0651631],
            {
                let low = 1.0 / (1.0 + (3.141_592_7 / s).exp());
                let high = 1.0 / (1.0 + (-3.141_592_7 / s).exp());
                -s * (1.0 / (u * (high - low) + low) - 1.0).ln()
            }
        ),
        expression!(
            "let t = sqrt(1.0 - x - x) / x; return 1.0 / (1.0 + c + 1.0 / sqrt(3.1415927) * t * exp(-x * x));",
            [x in 1e-6..0.9999, c in -0.9999..0.9999],
            {
                let t = (1.0 - x - x).sqrt() / x;
                1.0 / (1.0 + c + 1.0 / 1.772_453_9 * t * (-x * x).exp())
            }
        ),
        expression!(
            "-a * a * log(1.0 - u)",
            [a in 0.0001..1.0, u in 2.328306437e-10..1.0],
            -a * a * (1.0 - u).ln()
        ),
        expression!(
            "-log(1.0 - u) / (c2 / (ax * ax) + s2 / (ay * ay))",
            [ax in 0.0001..1.0, ay in 0.0001..1.0, u in 2.328306437e-10..1.0, c2 in 0.0..1.0, s2 in 0.0..1.0],
            -(1.0 - u).ln() / (c2 / (ax * ax) + s2 / (ay * ay))
        ),
        expression!(
            "0.25 * exp(-r / s) / (2.0 * 3.1415927 * s * r) + 0.75 * exp(-r / (3.0 * s)) / (6.0 * 3.1415927 * s * r)",
            [s in 0.0..256.0, r in 1e-6..1e6],
            0.25 * (-r / s).exp() / (2.0 * 3.141_592_7 * s * r) + 0.75 * (-r / (3.0 * s)).exp() / (6.0 * 3.141_592_7 * s * r)
        ),
        expression!(
            "s * log(1.0 / (1.0 - 4.0 * u))",
            [s in 0.0..256.0, u in 2.328306437e-10..0.25],
            s * (1.0 / (1.0 - 4.0 * u)).ln()
        ),
        expression!(
            "3.0 * s * log(1.0 / (1.0 - (u - 0.25) / 0.75))",
            [s in 0.0..256.0, u in 0.25..1.0],
            3.0 * s * (1.0 / (1.0 - (u - 0.25) / 0.75)).ln()
        ),
        expression!(
            "let a2 = a * a; return (a2 - 1.0) / (3.1415927 * log(a2) * (1.0 + (a2 - 1.0) * x * x));",
            [x in 0.0..1.0, a in 0.0001..1.0],
            {
                let a2 = a * a;
                (a2 - 1.0) / (3.141_592_7 * a2.ln() * (1.0 + (a2 - 1.0) * x * x))
            }
        ),
        expression!(
            "let xu = floor(w) * a; let xv = floor(h) * b; let yu = floor(w) * c; let yv = floor(h) * d; \
             let x2 = xu * xu + xv * xv; let y2 = yu * yu + yv * yv; let det = abs(xu * yv - xv * yu); \
             let major = sqrt(max(x2, y2)); let ratio = max(x2, y2) / det; \
             let minor = select(det / major, major / 16.0, ratio > 16.0); return log2(minor);",
            [
                w in 1.0..16384.0, h in 1.0..16384.0, a in 1e-20..1e20, b in 1e-20..1e20, c in 1e-20..1e20,
                d in 1e-20..1e20
            ],
            {
                let (w, h) = (w.floor(), h.floor());
                let (xu, xv, yu, yv) = (w * a, h * b, w * c, h * d);
                let (x2, y2) = (xu * xu + xv * xv, yu * yu + yv * yv);
                let det = (xu * yv - xv * yu).abs();
                let most = if x2 > y2 { x2 } else { y2 };
                let major = most.sqrt();
                let ratio = most / det;
                let minor = if ratio > 16.0 { major / 16.0 } else { det / major };
                minor.log2()
            }
        ),
        expression!(
            "let xu = floor(w) * a; let xv = floor(h) * b; let yu = floor(w) * c; let yv = floor(h) * d; \
             let x2 = xu * xu + xv * xv; let y2 = yu * yu + yv * yv; let det = abs(xu * yv - xv * yu); \
             let major = sqrt(max(x2, y2)); let ratio = max(x2, y2) / det; \
             let minor = select(det / major, major / 16.0, ratio > 16.0); \
             let clamped = select(ratio, 16.0, ratio > 16.0); \
             return select(clamped, max(1.0, clamped * minor), minor < 1.0);",
            [
                w in 1.0..16384.0, h in 1.0..16384.0, a in 1e-20..1e20, b in 1e-20..1e20, c in 1e-20..1e20,
                d in 1e-20..1e20
            ],
            {
                let (w, h) = (w.floor(), h.floor());
                let (xu, xv, yu, yv) = (w * a, h * b, w * c, h * d);
                let (x2, y2) = (xu * xu + xv * xv, yu * yu + yv * yv);
                let det = (xu * yv - xv * yu).abs();
                let most = if x2 > y2 { x2 } else { y2 };
                let major = most.sqrt();
                let ratio = most / det;
                let minor = if ratio > 16.0 { major / 16.0 } else { det / major };
                let clamped = if ratio > 16.0 { 16.0 } else { ratio };
                if minor < 1.0 { if clamped * minor > 1.0 { clamped * minor } else { 1.0 } } else { clamped }
            }
        ),
        expression!(
            "let xu = floor(w) * a; let xv = floor(h) * b; let yu = floor(w) * c; let yv = floor(h) * d; \
             let x2 = xu * xu + xv * xv; let y2 = yu * yu + yv * yv; let normal = 1.0 / sqrt(max(x2, y2)); \
             return select(normal * yu, normal * xu, x2 >= y2);",
            [
                w in 1.0..16384.0, h in 1.0..16384.0, a in 1e-20..1e20, b in 1e-20..1e20, c in 1e-20..1e20,
                d in 1e-20..1e20
            ],
            {
                let (w, h) = (w.floor(), h.floor());
                let (xu, xv, yu, yv) = (w * a, h * b, w * c, h * d);
                let (x2, y2) = (xu * xu + xv * xv, yu * yu + yv * yv);
                let normal = 1.0 / (if x2 > y2 { x2 } else { y2 }).sqrt();
                if x2 >= y2 { normal * xu } else { normal * yu }
            }
        ),
        expression!(
            "let xu = floor(w) * a; let xv = floor(h) * b; let yu = floor(w) * c; let yv = floor(h) * d; \
             let x2 = xu * xu + xv * xv; let y2 = yu * yu + yv * yv; let normal = 1.0 / sqrt(max(x2, y2)); \
             return select(normal * yv, normal * xv, x2 >= y2);",
            [
                w in 1.0..16384.0, h in 1.0..16384.0, a in 1e-20..1e20, b in 1e-20..1e20, c in 1e-20..1e20,
                d in 1e-20..1e20
            ],
            {
                let (w, h) = (w.floor(), h.floor());
                let (xu, xv, yu, yv) = (w * a, h * b, w * c, h * d);
                let (x2, y2) = (xu * xu + xv * xv, yu * yu + yv * yv);
                let normal = 1.0 / (if x2 > y2 { x2 } else { y2 }).sqrt();
                if x2 >= y2 { normal * xv } else { normal * yv }
            }
        ),
        expression!(
            "let x = vec3f(floor(w) * a, floor(h) * b, floor(d) * c); \
             let y = vec3f(floor(w) * p, floor(h) * q, floor(d) * r); return log2(sqrt(max(dot(x, x), dot(y, y))));",
            [
                w in 1.0..16384.0, h in 1.0..16384.0, d in 1.0..4096.0, a in 1e-20..1e20, b in 1e-20..1e20,
                c in 1e-20..1e20, p in 1e-20..1e20, q in 1e-20..1e20, r in 1e-20..1e20
            ],
            {
                let (w, h, d) = (w.floor(), h.floor(), d.floor());
                let (x, y, z) = (w * a, h * b, d * c);
                let (u, v, t) = (w * p, h * q, d * r);
                let (one, two) = (x * x + y * y + z * z, u * u + v * v + t * t);
                (if one > two { one } else { two }).sqrt().log2()
            }
        ),
        expression!(
            "sign(x) * log(abs(x) + sqrt(x * x + 1.0))",
            [x in -3e38..3e38],
            x.signum() * (x.abs() + (x * x + 1.0).sqrt()).ln()
        ),
        expression!("log(x + sqrt(x * x - 1.0))", [x in 1.0..3e38], (x + (x * x - 1.0).sqrt()).ln()),
        expression!(
            "0.5 * log(1.0 + 2.0 * x / (1.0 - x))",
            [x in -1.0..1.0],
            0.5 * (1.0 + 2.0 * x / (1.0 - x)).ln()
        ),
    ]
}

/// Checks if the result loses more than half of its digits, or isn't finite, for some inputs in the ranges. Compares
/// the result in `f32` with the result in `f64`.
fn loses(expression: &Expression) -> bool {
    /// The relative error of a result that has lost half of an `f32`'s 24 binary digits.
    const HALF: f64 = 1.0 / 4096.0;
    const POINTS: u64 = 1 << 17;
    let mut state = 1_u64;
    let mut drawn = || {
        // Knuth's constants (MMIX). Only the upper bits are random enough.
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    (0..POINTS).any(|_| {
        let mut at = |(_, least, most): &(&str, f64, f64)| {
            let (kind, share) = (drawn(), drawn());
            match kind {
                _ if kind < 0.125 => *least as f32,
                _ if kind < 0.25 => *most as f32,
                // Each decade has the same number of points.
                _ if *least > 0.0 => (least * (most / least).powf(share)) as f32,
                _ => (least + (most - least) * share) as f32,
            }
        };
        let row: Vec<f32> = expression.inputs.iter().map(&mut at).collect();
        let exact = (expression.double)(&row.iter().map(|x| f64::from(*x)).collect::<Vec<_>>());
        let found = f64::from((expression.single)(&row));
        !((found - exact).abs() <= HALF * exact.abs()) && exact != 0.0
    })
}

/// Karat's verdicts on the expressions. An expression with a fault is `found` or `missed`. An expression without a
/// fault is `wrong` if Karat reports a fault in it, and `right` otherwise.
#[derive(Debug, Default)]
struct Told {
    found: usize,
    missed: Vec<&'static str>,
    wrong: Vec<&'static str>,
    right: usize,
}

fn told(all: Vec<Expression>) -> Told {
    let mut told = Told::default();
    for one in all {
        let names: Vec<String> =
            one.inputs.iter().map(|(name, ..)| format!("{name}: f32")).collect();
        let body = match one.text.contains("return ") {
            true => one.text.to_owned(),
            false => format!("return {};", one.text),
        };
        let source = format!("fn f({}) -> f32 {{ {body} }}", names.join(", "));
        let package = Package::from_source("h", source);
        let declared =
            one.inputs.iter().fold(karat_inspect::hazards(&package), |all, (name, least, most)| {
                all.input(name, *least..=*most)
            });
        let hazards = declared.run().unwrap_or_else(|error| panic!("{}: {error}", one.text));
        // An operation for which WGSL bounds no error is another kind of finding than lost digits.
        let mut faults = hazards.faults().filter(|fault| fault.kind != HazardKind::Unbounded);
        match (loses(&one), faults.next().is_some()) {
            (true, true) => told.found += 1,
            (true, false) => told.missed.push(one.text),
            (false, true) => told.wrong.push(one.text),
            (false, false) => told.right += 1,
        }
    }
    told
}

/// With declared ranges, Karat reports at least 80 % of the expressions that lose digits or aren't finite, and at least
/// 95 % of the reports are correct.
#[test]
fn expressions_that_lose_digits_are_found() {
    for (name, all) in [("Hamming", of_hamming()), ("Herbie", of_herbie())] {
        let told = told(all);
        println!("{name}: {told:#?}");
        // The goal is a recall of 0.8 and a precision of 0.95.
        assert!(
            10 * told.found >= 8 * (told.found + told.missed.len()),
            "{name}: {:#?}",
            told.missed
        );
        assert!(
            20 * told.found >= 19 * (told.found + told.wrong.len()),
            "{name}: {:#?}",
            told.wrong
        );
    }
}
