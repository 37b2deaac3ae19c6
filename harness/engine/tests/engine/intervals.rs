//! Tests bounds that follow from the WGSL specification.

use crate::common::{doubles, floats, intervals, program};
use karat_engine::{Intervals, Lane, Options, Resources, Truth};

fn one(expression: &str, x: f32) -> (f32, f32) {
    let found = intervals(&format!("fn f(x: f32) -> f32 {{ return {expression}; }}"), &[x])[0];
    (found.lo(), found.hi())
}

#[test]
fn sums_and_products_have_both_neighbours() {
    // 1 + 2^-25 is between 1 and the next float.
    let next = 1f32.next_up();
    assert_eq!(one("1.0 + x", 2f32.powi(-25)), (1.0, next));
    assert_eq!(one("x + 1.0", 3.0), (4.0, 4.0));
    // (1 + 2^-23)^2 = 1 + 2^-22 + 2^-46
    let square = 1.0 + 2f32.powi(-22);
    assert_eq!(one("x * (x + 0.0)", next), (square, square.next_up()));
    assert_eq!(one("x * x", next), (square, square.next_up()));
    assert_eq!(one("x * 2.0", f32::MAX), (f32::NEG_INFINITY, f32::INFINITY));
}

#[test]
fn quotients_and_roots_have_ulps() {
    // The error is 2.5 ulp of 1 / 3. An ulp of 1 / 3 is 2^-25.
    let third = 1.0 / 3.0f64;
    let (lo, hi) = one("1.0 / x", 3.0);
    let error = 2.5 * 2f64.powi(-25);
    assert_eq!(lo, down(third - error));
    assert_eq!(hi, up(third + error));
    assert_eq!(one("1.0 / x", 0.0), (f32::NEG_INFINITY, f32::INFINITY));
    assert_eq!(one("1.0 / x", 2f32.powi(127)), (f32::NEG_INFINITY, f32::INFINITY));
    let root = 1.0 / 2f64.sqrt();
    let error = 2.0 * 2f64.powi(-24);
    assert_eq!(one("inverseSqrt(x)", 2.0), (down(root - error), up(root + error)));
    assert_eq!(one("sqrt(x)", 0.0), (0.0, 0.0));
    assert_eq!(one("sqrt(x)", -1.0), (f32::NEG_INFINITY, f32::INFINITY));
}

#[test]
fn waves_and_logarithms_have_absolute_errors() {
    let error = 2f64.powi(-11);
    let exact = 1f64.sin();
    assert_eq!(one("sin(x)", 1.0), (down(exact - error), up(exact + error)));
    assert_eq!(one("cos(x)", 3.2), (f32::NEG_INFINITY, f32::INFINITY));
    let exact = 1.5f64.ln();
    let error = 2f64.powi(-21);
    assert_eq!(one("log(x)", 1.5), (down(exact - error), up(exact + error)));
    let exact = 10f64.log2();
    let error = 3.0 * 2f64.powi(-22);
    assert_eq!(one("log2(x)", 10.0), (down(exact - error), up(exact + error)));
    let exact = 3f64.exp2();
    // 8 is a power of two, so its neighbour below is nearer than its neighbour above.
    let error = 9.0 * 2f64.powi(-21);
    assert_eq!(one("exp2(x)", 3.0), (down(exact - error), up(exact + error)));
    assert_eq!(one("pow(x, 5.0)", 0.0), (f32::NEG_INFINITY, f32::INFINITY));
}

fn down(x: f64) -> f32 {
    let y = x as f32;
    if f64::from(y) > x { y.next_down() } else { y }
}

fn up(x: f64) -> f32 {
    let y = x as f32;
    if f64::from(y) < x { y.next_up() } else { y }
}

#[test]
fn subnormals_may_be_flushed() {
    assert_eq!(one("x * 0.5", f32::MIN_POSITIVE), (0.0, 0.5 * f32::MIN_POSITIVE));
    assert_eq!(one("x + 0.0", -1e-40), (-1e-40, 0.0));
    assert_eq!(one("select(0.0, 1.0, x > 0.0)", 1e-40), (0.0, 1.0));
}

#[test]
fn undecided_branches_join() {
    let source = "fn f(x: f32) -> f32 {
        var y = 0.0;
        if sin(x) > 0.5 { y = 1.0; } else { y = 3.0; }
        if x > 0.0 { y += 10.0; }
        return y;
    }";
    // sin(pi / 6) may be above or below 0.5. sin(1) is always above 0.5.
    let rows = [std::f32::consts::FRAC_PI_6, 1.0, -1.0];
    let found = intervals(source, &rows);
    let bounds: Vec<(f32, f32)> = found.iter().map(|x| (x.lo(), x.hi())).collect();
    assert_eq!(bounds, [(11.0, 13.0), (11.0, 11.0), (3.0, 3.0)]);
}

#[test]
fn an_early_return_in_an_undecided_branch_joins() {
    let source = "fn f(x: f32) -> f32 {
        if sin(x) > 0.5 { return 1.0; }
        for (var i = 0; i < 3; i++) { if sin(x) < 0.4 { return f32(i); } }
        return 5.0;
    }";
    let found = intervals(source, &[std::f32::consts::FRAC_PI_6, 1.0, 0.1]);
    let bounds: Vec<(f32, f32)> = found.iter().map(|x| (x.lo(), x.hi())).collect();
    assert_eq!(bounds, [(1.0, 5.0), (1.0, 1.0), (0.0, 0.0)]);
}

#[test]
fn a_decided_loop_in_an_undecided_branch_ends() {
    let source = "fn f(x: f32) -> f32 {
        var y = 0.0;
        if sin(x) > 0.5 {
            for (var i = 0; i < 4; i++) { if i == 2 { continue; } y += 1.0; }
        }
        return y;
    }";
    let found = intervals(source, &[std::f32::consts::FRAC_PI_6, 1.0]);
    assert_eq!((found[0].lo(), found[0].hi()), (0.0, 3.0));
    assert_eq!((found[1].lo(), found[1].hi()), (3.0, 3.0));
}

#[test]
fn the_cause_of_what_is_unbounded_has_a_line() {
    let source = "fn f(x: f32) -> f32 {
        let a = x + 1.0;
        let b = 1.0 / (x - x);
        let c = b * a;
        return max(c, 0.0);
    }";
    let program = program(source, "f");
    let row = [2f32.to_bits()];
    let found =
        program.call::<Intervals>(1, &row, &Resources::new(), &Options::default(), &()).unwrap();
    let Lane::Float(y) = found.row(0)[0] else { panic!() };
    assert!(!y.is_bounded());
    let site = program.cause(y).unwrap();
    assert_eq!(site.span.location(source).line_number, 3);
    assert_eq!(site.function, "f");
}

/// In interval arithmetic, a read with an index outside of its array may return any number. In `f32`, the engine clamps
/// the index.
#[test]
fn reads_out_of_bounds_are_unbounded() {
    let source = "fn f(x: f32) -> f32 { var a = array(1.0, 2.0, 3.0); return a[i32(x)]; }";
    let found = intervals(source, &[1.0, 5.0, -2.0]);
    assert_eq!((found[0].lo(), found[0].hi()), (2.0, 2.0));
    assert!(!found[1].is_bounded() && !found[2].is_bounded());
    let source = "fn f(x: f32) -> f32 { var a = array(1.0, 2.0); a[u32(x)] = 5.0; return a[0]; }";
    let found = intervals(source, &[1.0, 2.0]);
    assert!(found[0].is_bounded() && !found[1].is_bounded());
}

#[test]
fn integers_and_booleans_have_bounds() {
    let source = "struct R { i: i32, b: bool, }
        fn f(x: f32) -> R { let i = i32(sin(x) * 10.0); return R(i * 2 + 1, i > 4); }";
    let program = program(source, "f");
    let row = [std::f32::consts::FRAC_PI_6.to_bits()];
    let found =
        program.call::<Intervals>(1, &row, &Resources::new(), &Options::default(), &()).unwrap();
    let row = found.row(0);
    let Lane::Int(i) = row[0] else { panic!() };
    assert_eq!((i.lo(), i.hi()), (9, 11));
    assert_eq!(row[1], Lane::Bool(Truth::Undecided));
}

/// The engine's own results in `f32` and `f64` are within the bounds of each of these expressions.
#[test]
fn results_lie_within_their_bounds() {
    let expressions = [
        "x + y",
        "x - y",
        "x * y",
        "x / y",
        "x % y",
        "x * x - y",
        "sqrt(abs(x))",
        "inverseSqrt(abs(x) + 0.1)",
        "exp(x)",
        "exp2(y)",
        "log(abs(x) + 0.01)",
        "log2(abs(y) + 0.5)",
        "pow(abs(x) + 0.1, y)",
        "sin(x)",
        "cos(y)",
        "tan(x * 0.3)",
        "asin(x * 0.3)",
        "acos(x * 0.3)",
        "atan(x)",
        "atan2(x, y)",
        "sinh(x)",
        "cosh(x)",
        "tanh(x)",
        "asinh(x)",
        "acosh(abs(x) + 1.0)",
        "atanh(x * 0.3)",
        "mix(x, y, 0.3)",
        "smoothstep(-3.0, 3.0, x)",
        "step(x, y)",
        "fract(x)",
        "fma(x, y, x)",
        "clamp(x, -1.0, 1.0)",
        "length(vec3f(x, y, 1.0))",
        "distance(vec2f(x, y), vec2f(1.0))",
        "normalize(vec3f(x, y, 1.0)).y",
        "dot(vec4f(x, y, 1.0, x), vec4f(y, x, y, 2.0))",
        "cross(vec3f(x, y, 1.0), vec3f(y, 1.0, x)).z",
        "reflect(vec2f(x, y), vec2f(0.6, 0.8)).x",
        "refract(vec2f(x, y) / 5.0, vec2f(0.0, 1.0), 0.7).y",
        "degrees(x)",
        "radians(y)",
        "floor(x)",
        "ceil(x)",
        "round(x)",
        "trunc(x)",
        "sign(x)",
        "min(x, y) * max(x, y)",
        "quantizeToF16(x)",
        "modf(x).fract",
        "frexp(x).fract",
        "ldexp(x, 3)",
        "faceForward(vec2f(x), vec2f(y), vec2f(1.0)).x",
        "unpack2x16snorm(u32(abs(x) * 1e4)).x",
        "(mat2x2f(x, y, 1.0, 2.0) * vec2f(x, y)).y",
        "f32(i32(x)) + f32(u32(abs(y)))",
        "saturate(x)",
        "-x",
        "abs(y)",
    ];
    let mut rows = Vec::new();
    for k in 0..400 {
        let share = |n: i32| ((k * n) % 401) as f32 / 401.0;
        rows.extend([6.0 * share(37) - 3.0, 6.0 * share(151) - 3.0]);
    }
    for expression in expressions {
        let source = format!("fn f(x: f32, y: f32) -> f32 {{ return {expression}; }}");
        let bounds = intervals(&source, &rows);
        let mut bounded = 0;
        for (k, ((bound, single), double)) in
            bounds.iter().zip(floats(&source, &rows)).zip(doubles(&source, &rows)).enumerate()
        {
            let (x, y) = (rows[2 * k], rows[2 * k + 1]);
            assert!(
                bound.contains(f64::from(single)),
                "{expression} of {x} {y}: {single} not in {bound:?}"
            );
            // In `f64`, the result of a builtin that isn't continuous may be on the other side of a jump.
            let steps =
                ["step", "floor", "ceil", "round", "trunc", "fract", "%", "quantize", "modf"];
            if !steps.iter().any(|step| expression.contains(step)) {
                // `f64` results aren't rounded to `f32`, but the bounds are the bounds of `f32` results.
                let slack = f64::from(f32::EPSILON) * double.abs();
                assert!(
                    bound.contains(double)
                        || bound.contains(double + slack)
                        || bound.contains(double - slack),
                    "{expression} of {x} {y}: {double} not in {bound:?}"
                );
            }
            bounded += usize::from(bound.is_bounded());
        }
        assert!(bounded > 300, "{expression}: only {bounded} of 400 are bounded");
    }
}

/// With another implementation's sine, an `if` may take another branch, but the result must still be within the bounds.
/// The test changes the sine by at most the error that the specification allows.
#[test]
fn every_decision_within_the_bounds_is_followed() {
    let body = "
        var sum = 0.0;
        var n = 0;
        for (var i = 0; i < 6; i++) {
            let w = sin(x + f32(i) * 0.37) + e * select(-1.0, 1.0, i % 2 == 0);
            if w > 0.9 { n += 1; continue; }
            if w < -0.6 { if n > 2 { break; } sum += 0.25; }
            switch i32(floor(w * 2.0)) {
                case 0: { sum += 1.0; if w > 0.2501 { continue; } sum += 0.5; }
                case 1, -2: { if w > 0.75 { return sum + 100.0; } sum -= 2.0; }
                default: { n += 1; }
            }
            var j = 0;
            loop {
                if f32(j) * 0.25 > abs(w) { break; }
                sum += 0.125;
                j++;
            }
        }
        return sum + f32(n) * 10.0;";
    let bounded = format!("fn f(x: f32) -> f32 {{ let e = 0.0; {body} }}");
    let moved = format!("fn f(x: f32, e: f32) -> f32 {{ {body} }}");
    let xs: Vec<f32> = (0..1500).map(|k| -3.0 + 4.0 * k as f32 / 1500.0).collect();
    let bounds = intervals(&bounded, &xs);
    let mut undecided = 0;
    // The change is slightly less than 2^-11, so that the rounded sum stays within the error.
    for e in [0.0, 4.8e-4, -4.8e-4, 2e-4, -3e-4] {
        let rows: Vec<f32> = xs.iter().flat_map(|&x| [x, e]).collect();
        for ((x, bound), y) in xs.iter().zip(&bounds).zip(floats(&moved, &rows)) {
            assert!(bound.is_bounded(), "{x}");
            assert!(bound.contains(f64::from(y)), "{x} {e}: {y} not in {bound:?}");
            undecided += usize::from(bound.lo() != bound.hi());
        }
    }
    assert!(undecided > 50, "only {undecided}");
}

/// The bounds of a square root in half precision contain 0 if the argument is subnormal (below 2^-14), but not if the
/// argument is normal.
#[test]
fn roots_of_halves_that_may_be_flushed_may_be_zero() {
    let source = "enable f16; fn f(x: f32) -> f32 { return f32(sqrt(f16(x))); }";
    let least = 2f32.powi(-14);
    let [subnormal, normal, four] = intervals(source, &[least / 2.0, least, 4.0])[..] else {
        panic!("three rows")
    };
    assert!(subnormal.contains(0.0) && subnormal.contains(f64::from(least / 2.0).sqrt()));
    assert!(!normal.contains(0.0) && normal.contains(1.0 / 128.0), "{normal:?}");
    assert!(four.contains(2.0) && four.lo() > 1.98 && four.hi() < 2.03, "{four:?}");
}

/// In half precision, the bounds contain all results that WGSL allows, and few others. Each row has an expression, its
/// argument, its least and its greatest result, and the largest allowed distance between these results and the bounds.
#[test]
fn functions_of_halves_are_as_exact_as_wgsl_says() {
    let tiny = 2f32.powi(-15);
    for (expression, x, [least, most], slack) in [
        // A subnormal may be flushed, whatever its sign is.
        ("f16(x)", -tiny, [-tiny, 0.0], 0.0),
        // Above a power of two, 6 ulp are twice as large.
        ("sqrt(f16(x))", 4.0, [2.0 - 6.0 / 1024.0, 2.0 + 6.0 / 512.0], 0.02),
        // Squares below 2^-14 may be flushed to 0, and have an error of a step, 2^-24.
        ("length(vec2h(f16(x), 0.0h))", 2f32.powi(-8), [0.0, 2f32.powi(-8)], 1e-4),
        ("length(vec2h(f16(x), 0.0h))", 2f32.powi(-12), [0.0, 1.7 * 2f32.powi(-12)], 1e-4),
        ("exp(f16(x))", 5.0, [148.4 - 11.0 * 0.125, 148.4 + 11.0 * 0.125], 4.0),
        ("exp(f16(x))", -20.0, [0.0, 0.0077], 1e-3),
        ("log2(f16(x))", 1.0, [-1.0 / 128.0, 1.0 / 128.0], 1e-3),
        ("log2(f16(x))", 2f32.powi(-14), [-14.0 - 3.0 / 128.0, -14.0 + 3.0 / 128.0], 0.04),
        ("log(f16(x))", 2f32.powi(-13), [-9.01 - 3.0 / 128.0, -9.01 + 3.0 / 128.0], 0.04),
        ("sin(f16(x))", 0.5, [0.4794 - 1.0 / 128.0, 0.4794 + 1.0 / 128.0], 1e-3),
    ] {
        let source = format!("enable f16; fn f(x: f32) -> f32 {{ return f32({expression}); }}");
        let bound = intervals(&source, &[x])[0];
        assert!(bound.is_bounded(), "{expression} of {x}");
        assert!(bound.lo() <= least && most <= bound.hi(), "{expression} of {x}: {bound:?}");
        let reaches = bound.lo() < least - slack || most + slack < bound.hi();
        assert!(!reaches, "{expression} of {x}: {bound:?}");
    }
    // For x = 200, the sum of the squares is 80000, which overflows in half precision.
    let long = |x: f32| {
        let source = "enable f16; fn f(x: f32) -> f32 { return f32(length(vec2h(f16(x)))); }";
        intervals(source, &[x])[0].is_bounded()
    };
    assert!(long(100.0) && !long(200.0));
    let log = "enable f16; fn f(x: f32) -> f32 { return f32(log2(f16(x))); }";
    assert!(!intervals(log, &[tiny])[0].is_bounded(), "it may be 0");
}
