//! Tests verbs for statements, symmetries, monotonicity and limits, most of which need no reference.

use glam::{DQuat, Vec3};
use karat::check::Failure;
use karat::prelude::*;
use shaders::PBR;

use crate::{disagreement, mutant};

#[test]
fn a_statement_that_does_not_hold() {
    let found = PBR
        .function("fresnel::schlick")
        .over((UnitRgb, 0.0..=1.0))
        .unrecorded()
        .try_satisfies("is below 0.999", |_, f: Vec3| f.max_element() < 0.999);
    assert_eq!(disagreement(found).check, "satisfies");
}

#[test]
fn a_function_that_is_not_symmetric() {
    let package = mutant("geometry", "masking + shadowing", "masking + 1.001 * shadowing");
    let found = package
        .function("geometry::smith_correlated")
        .over((1e-4..=1.0, 0.0..=1.0, 0.0..=1.0))
        .unrecorded()
        .try_invariant_under(|(alpha, v, l)| (alpha, l, v), Ulp(2.0));
    assert_eq!(disagreement(found).check, "invariant_under");
}

/// Swapping the directions of a reciprocal BRDF that includes the cosine multiplies the result by the quotient of the
/// two cosines. For a BRDF that isn't reciprocal, the check fails. If the test gives a factor that isn't finite, the
/// check has an error and no verdict.
#[test]
fn a_function_that_does_not_scale() {
    let eval = |body: &str| {
        let wgsl = format!("fn eval(v: vec3f, l: vec3f) -> f32 {{ return {body}; }}");
        let package = Package::from_source("planted", &wgsl);
        let above = Hemisphere.above(0.01);
        let quotient = |(v, l): (Vec3, Vec3)| f64::from(v.z) / f64::from(l.z);
        let check = package.function("eval").over((above, above));
        check.unrecorded().try_scales_under(|(v, l)| (l, v), quotient, Rel(1e-5))
    };
    assert!(eval("l.z / (v.z + l.z)").is_ok());
    let found = disagreement(eval("l.z / (v.z + 1.01 * l.z)"));
    assert_eq!(found.check, "scales_under");
    assert!(
        found
            .to_string()
            .contains("expected: the result for the arguments without a prime, times the factor")
    );
    let package = Package::from_source("planted", "fn f(x: f32, y: f32) -> f32 { return x; }");
    let over = package.function("f").over((0.0..=1.0, 0.0..=1.0));
    let error =
        over.unrecorded().try_scales_under(|(x, y)| (y, x), |(x, y)| f64::from(y / x), Rel(1e-5));
    let error = error.expect_err("0 is divided by").to_string();
    assert!(error.contains("at factor for case"), "{error}");
}

/// If all failing cases have a property that the other cases don't have, such as a range of a quotient, the message
/// describes this property.
#[test]
fn the_cause_is_named() {
    let package = Package::from_source(
        "planted",
        "fn window(distance: f32, radius: f32) -> f32 {\n\
         let q = distance / radius;\n\
         return select(q, 1.01 * q, q > 0.2 && q < 0.97);\n}",
    );
    let window = package.function("window").over((0.01..=10.0, 0.1..=10.0));
    let found = disagreement(window.unrecorded().try_agrees_with(|d: f64, r: f64| d / r, Ulp(4.0)))
        .to_string();
    let cause = "it fails where distance / radius is from 0.2 to 0.97, and nowhere else";
    assert!(found.contains(cause), "{found}");
}

/// Some verbs call the function twice for each case. Their messages show the arguments of both calls, such as `a` and
/// `a'`.
#[test]
fn messages_of_properties_show_both_calls() {
    let package = Package::from_source(
        "planted",
        "fn f(a: f32, b: f32) -> f32 { return a + 2.0 * b; }\n\
         fn g(x: f32) -> f32 { return select(x, x - 0.002, x > 0.731); }",
    );
    let over = || package.function("f").over((0.0..=1.0, 0.0..=1.0));
    let found = disagreement(over().unrecorded().try_invariant_under(|(a, b)| (b, a), Ulp(4.0)));
    let text = found.to_string();
    let expected = "
  worst (case 1)
           a = 1
           b = 0
          a' = 0
          b' = 1
    returned = 2
               (returned for the arguments with a prime ('); expected: the result for the arguments without a prime)
      actual = 2 (0x1p+1)
    expected = 1 (0x1p+0)  nearest f32 of 1
       error = 8.39e6 ulp (4 allowed), rel 1, abs 1
";
    assert!(text.contains(expected), "{text}");
    // The step is 1/500 high, between numbers that are closer together.
    let g = package.function("g").over(0.0..=1.0);
    let found = disagreement(g.unrecorded().try_is_monotone_in("x", Trend::Increasing, Ulp(1.0)));
    assert!(found.paths.iter().all(|path| path.census.failures < 100), "{found}");
}

/// If the tolerance is larger than all changes of the function, `is_monotone_in` compares nothing, so the check fails.
// Lesson 77
#[test]
fn changes_within_the_tolerance() {
    let package = Package::from_source("s", "fn f(x: f32) -> f32 { return x * x; }");
    let check = |tolerance: f64| {
        let check = package.function("f").over(-1.0..=1.0);
        check.unrecorded().try_is_monotone_in("x", Trend::Increasing, Abs(tolerance))
    };
    let failure = check(5.0).expect_err("nothing is compared").to_string();
    assert!(failure.contains("by more than the tolerance"), "{failure}");
    assert!(matches!(check(0.1), Err(Failure::Disagreement(_))));
}

/// The planted faults are a bump over a hundredth of the range, a small slope with the wrong sign, NaN, and an
/// infinity.
#[test]
fn a_function_that_is_not_monotone() {
    let check = |body: &str, direction, tolerance: Tolerance| {
        let wgsl = format!("fn f(k: vec2f, x: f32, n: u32) -> vec2f {{ return {body}; }}");
        let package = Package::from_source("planted", wgsl);
        let pairs = (-1.0..=1.0_f32, -1.0..=1.0_f32).map(|(x, y)| glam::Vec2::new(x, y));
        let over = package.function("f").over((pairs, 0.0..=1.0, Integers(0..=9_u32)));
        over.unrecorded().try_is_monotone_in("x", direction, tolerance)
    };
    let up = Trend::Increasing;
    let exact = || Tolerance::from(Ulp(0.0));
    let right = check("vec2f(k.y, k.x + x * f32(n))", up, Ulp(1.0).near_zero(1.0));
    assert_eq!(right.expect("it rises, or stays").cases, 65_536);
    check("vec2f(1.0 - x, -x * x)", Trend::Decreasing, exact()).expect("both fall");
    let faults = [
        "vec2f(x, x - 0.02 * step(0.5, x) * step(x, 0.51))",
        "vec2f(x, -1e-6 * x)",
        "vec2f(x, select(x, sqrt(-1.0 - x), x > 0.999))",
        "vec2f(1.0 / x, x)",
    ];
    for fault in faults {
        let found = disagreement(check(fault, up, exact()));
        assert_eq!(found.check, "is_monotone_in", "{fault}");
        let worst = &found.paths[0].worst;
        let names: Vec<&str> = worst.arguments.iter().map(|(name, _)| &**name).collect();
        assert_eq!(names, ["k", "x", "n", "x'"], "both values are shown");
    }
    let found = disagreement(check("vec2f(x, x)", Trend::Decreasing, Abs(0.5).into()));
    assert_eq!(found.assertion, "decreasing in `x`, abs 5e-1");
}

// Lesson 4
#[test]
fn a_monotone_check_of_nothing() {
    let wgsl = "fn f(alpha: f32, c: f32, d: vec3f) -> f32 { return c; }";
    let package = Package::from_source("planted", wgsl);
    let over = || package.function("f").over((0.0..=1.0, Just(0.5), UnitVector));
    let up = Trend::Increasing;
    let vacuous = [
        (
            over().unrecorded().try_is_monotone_in("alpha", up, Ulp(0.0)),
            "no case in which `alpha` changes",
        ),
        (
            over().unrecorded().try_is_monotone_in(1, up, Ulp(0.0)),
            "has only one value for argument 1",
        ),
    ];
    for (found, message) in vacuous {
        assert!(matches!(found, Err(Failure::Domain { .. })), "{found:?}");
        assert!(found.expect_err("nothing").to_string().contains(message), "{message}");
    }
    let unknown = [
        (over().unrecorded().try_is_monotone_in("alhpa", up, Ulp(0.0)), "did you mean `alpha`?"),
        (
            over().unrecorded().try_is_monotone_in(3, up, Ulp(0.0)),
            "has 3 parameters, so there is no argument 3",
        ),
        (over().unrecorded().try_is_monotone_in("d", up, Ulp(0.0)), "which isn't a single number"),
        (over().unrecorded().try_is_monotone_in("c", up, Ulp(f64::NAN)), "can't be a bound"),
    ];
    for (found, message) in unknown {
        assert!(matches!(found, Err(Failure::Signature { .. })), "{found:?}");
        assert!(found.expect_err("nothing").to_string().contains(message), "{message}");
    }
}

#[test]
fn a_limit_that_is_not_approached() {
    let check = |error: &str, steps: &[f32]| {
        let wgsl = format!("fn f(x: f32, alpha: f32) -> f32 {{ return x + {error}; }}");
        let package = Package::from_source("planted", wgsl);
        let over = package.function("f").over((0.0..=1.0, Just(7.0)));
        // The reference gets the limit instead of the domain's values.
        let limit = |x: f64, alpha: f64| x + alpha;
        over.unrecorded().try_at_limit("alpha", Limit::toward(0.0, steps), limit, Abs(2e-3))
    };
    let steps = [0.1, 0.01, 0.001];
    check("alpha", &steps).expect("the error is alpha");
    let rises = "select(alpha, 0.2, alpha < 0.05 && alpha > 0.005)";
    for (fault, step) in [("alpha + 0.003", "0.001"), (rises, "0.01"), ("sqrt(alpha)", "0.001")] {
        let found = disagreement(check(fault, &steps));
        assert_eq!(found.assertion, "`alpha` toward 0 through 0.1, 0.01, 0.001: abs 2e-3");
        let worst = &found.paths[0].worst;
        assert_eq!(worst.arguments[1], ("alpha".to_owned(), step.to_owned()), "{fault}");
    }
    disagreement(check("alpha / (alpha - 0.001)", &steps)); // infinite at the last step
    let found = check("0.0", &steps);
    assert!(matches!(found, Err(Failure::Domain { .. })), "{found:?}");
    for steps in [&[][..], &[0.1], &[0.01, 0.1], &[0.1, f32::NAN]] {
        let found = check("alpha", steps);
        assert!(matches!(found, Err(Failure::Signature { .. })), "{steps:?} {found:?}");
    }
}

#[test]
fn a_function_that_knows_which_way_is_up() {
    let check = |body: &str| {
        let wgsl = format!("fn f(n: vec3f, v: vec3f) -> vec3f {{ return {body}; }}");
        let package = Package::from_source("planted", wgsl);
        let turned = |q: DQuat, d: Vec3| (q * d.as_dvec3()).as_vec3();
        package.function("f").over((UnitVector, UnitVector)).unrecorded().try_equivariant_under(
            move |(n, v), q| (turned(q, n), turned(q, v)),
            |l: Vec3, q| q * l.as_dvec3(),
            Abs(2e-6),
        )
    };
    check("reflect(-v, n)").expect("a reflection has no preferred direction");
    for fault in ["reflect(-v, n) + vec3f(0.0, 0.0, 1e-5)", "vec3f(v.xy, -v.z)", "abs(v)"] {
        let found = disagreement(check(fault));
        assert_eq!(found.paths[0].worst.arguments[2].0, "rotation", "{fault}");
    }
    let package = Package::from_source("planted", "fn f(n: vec3f) -> f32 { return n.z; }");
    let angle = |q: DQuat, d: Vec3| (q * d.as_dvec3()).as_vec3();
    let over = || package.function("f").over(UnitVector);
    let fault = over().unrecorded().try_equivariant_under(
        |n, q| angle(q, n),
        |z: f32, _| z.into(),
        Abs(0.1),
    );
    disagreement(fault);
    let nothing =
        over().unrecorded().try_equivariant_under(|n, _| n, |z: f32, _| z.into(), Abs(6e38));
    assert!(matches!(nothing, Err(Failure::Domain { .. })), "{nothing:?}");
}
