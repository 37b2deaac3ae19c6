//! These tests plant faults in functions. A check against a reference must find each fault.

use glam::{DVec3, UVec3, Vec3};
use karat::Goldens;
use karat::check::Failure;
use karat::prelude::*;
use karat::unstable::probe::ProbeError;
use shaders::{PBR, geometry};

use crate::{disagreement, mutant, schlick};

// Lesson 40: arguments from storage buffers, with controls
#[test]
fn the_unchanged_library_agrees() {
    let agreement = schlick(&mutant("fresnel", "abs(1.0 - v_dot_h)", "abs(1.0 - v_dot_h)"));
    assert_eq!(agreement.expect("no fault is planted").cases, 65_536);
}

// Lesson 1: functions
// Lesson 28: mutants
#[test]
fn a_wrong_constant_in_schlick() {
    let faults = [
        ("f0 + (1.0 - f0)", "f0 + (0.999 - f0)"),
        ("abs(1.0 - v_dot_h)", "abs(1.0001 - v_dot_h)"),
        ("f0 + (1.0 - f0)", "f0 - (1.0 - f0)"),
        ("pow5(abs(1.0 - v_dot_h))", "abs(1.0 - v_dot_h)"),
    ];
    for (original, fault) in faults {
        let found = disagreement(schlick(&mutant("fresnel", original, fault)));
        assert!(found.paths.iter().all(|path| path.census.failures > 0), "{fault}");
    }
    let found = disagreement(schlick(&mutant("math", "x2 * x2 * x", "x2 * x2")));
    assert_eq!(found.function.name, "fresnel::schlick", "a fault in what it calls is seen too");
}

// Lesson 28: mutants
#[test]
fn swapped_arguments() {
    let package = mutant(
        "geometry",
        "fn smith_g1(alpha: f32, n_dot_x: f32)",
        "fn smith_g1(n_dot_x: f32, alpha: f32)",
    );
    let swapped = package
        .function("geometry::smith_g1")
        .over((1e-4..=1.0, 0.0..=1.0))
        .unrecorded()
        .try_agrees_with(geometry::smith_g1, Ulp(10.0));
    disagreement(swapped);
    let package = mutant("layering", "(environment - base)", "(base - environment)");
    let coat = package
        .function("layering::thin_coat")
        .over((Just(Vec3::ONE), Just(Vec3::ZERO), 0.0..=1.0))
        .unrecorded()
        .try_agrees_with(shaders::layering::thin_coat, Ulp(14.0).or(Abs(3e-5)));
    disagreement(coat);
}

/// For one of 65,536 inputs, the function returns NaN or an infinity. Even with the loosest tolerance, each check finds
/// this input.
// Lesson 5
#[test]
fn one_bad_result_of_65536() {
    for (bits, nan, infinite) in [("0x7fc00000u", 1, 0), ("0x7f800000u", 0, 1)] {
        let wgsl = format!(
            "fn f(i: u32) -> f32 {{ return select(1.0, bitcast<f32>(i - 54321u + {bits}), \
             i == 54321u); }}"
        );
        let package = Package::from_source("planted", wgsl);
        let over = || package.function("f").over(Integers(0..=65_535_u32));
        let loose = Abs(6e38).or(Rel(1e83));
        let found = disagreement(over().unrecorded().try_agrees_with(|_: u32| 1.0, loose));
        for path in &found.paths {
            assert_eq!((path.census.cases, path.census.failures), (65_536, 1));
            assert_eq!((path.census.nan, path.census.infinite), (nan, infinite));
            assert_eq!(path.worst.arguments, [("i".to_owned(), "54321".to_owned())]);
        }
        disagreement(over().unrecorded().try_satisfies("is anything", |_, _: f32| true));
        disagreement(over().unrecorded().try_invariant_under(|i| i ^ 1, Abs(6e38)));
    }
}

/// For one of 65,536 inputs, the last of three components is wrong. The first two components are always right. The test
/// plants this fault in a function of floats and in a function of integers.
// Lesson 14
#[test]
fn one_bad_component_of_65536() {
    let floats = "fn f(i: u32) -> vec3f { return vec3f(1.0, 1.0, select(1.0, 2.0, i == 54321u)); }";
    let integers = "fn f(i: u32) -> vec3u { return vec3u(1u, 1u, select(1u, 2u, i == 54321u)); }";
    let over = |package: &Package| {
        let check = package.function("f").over(Integers(0..=65_535_u32)).unrecorded();
        disagreement(check.try_agrees_with(|_: u32| DVec3::ONE, Abs(0.5)))
    };
    let integral = |package: &Package| {
        let check = package.function("f").over(Integers(0..=65_535_u32)).unrecorded();
        disagreement(check.try_agrees_with(|_: u32| UVec3::ONE, Abs(0.5)))
    };
    for found in [
        over(&Package::from_source("planted", floats)),
        integral(&Package::from_source("planted", integers)),
    ] {
        for path in &found.paths {
            assert_eq!((path.census.cases, path.census.failures), (65_536, 1));
            assert_eq!(path.worst.component, ".z");
            assert_eq!(path.worst.arguments, [("i".to_owned(), "54321".to_owned())]);
        }
    }
}

/// Only `z` is wrong, and only `z` has a strict tolerance, so the check must apply the tolerance of the last component.
// Lesson 14
#[test]
fn a_fault_in_the_last_component() {
    let wgsl = "fn f(x: f32) -> vec3f { return vec3f(x, x, x * 1.001); }";
    let package = Package::from_source("planted", wgsl);
    let tolerance = Tolerance::per_lane([Rel(0.1).into(), Rel(0.1).into(), Ulp(1.0).into()]);
    let found =
        package.function("f").over(1.0..=2.0).unrecorded().try_agrees_with(DVec3::splat, tolerance);
    assert!(disagreement(found).paths.iter().all(|path| path.worst.component == ".z"));
}

// Lesson 5: a reference that is NaN
#[test]
fn a_reference_that_is_not_a_number() {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return x; }");
    let found =
        package.function("f").over(-1.0..=1.0).unrecorded().try_agrees_with(f64::sqrt, Abs(10.0));
    assert!(matches!(found, Err(Failure::Reference { .. })), "{found:?}");
}

// Lesson 4
// Lesson 9
#[test]
fn nothing_to_compare() {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return x; }");
    let identity = |x: f64| x;
    let found = [
        package
            .function("f")
            .over(0.0..=1.0)
            .cases(0)
            .unrecorded()
            .try_agrees_with(identity, Ulp(0.0)),
        package
            .function("f")
            .over(OneOf::<f32>(vec![]))
            .unrecorded()
            .try_agrees_with(identity, Ulp(0.0)),
        package
            .function("f")
            .over((0.0..=1.0).filter(|_: &f32| false))
            .unrecorded()
            .try_agrees_with(identity, Ulp(0.0)),
        package
            .function("f")
            .over((0.0..=1.0).filter(|x: &f32| x.to_bits() % 1_000_003 == 1))
            .unrecorded()
            .try_agrees_with(identity, Ulp(0.0)),
        package.function("f").over(1.0..=0.0).unrecorded().try_agrees_with(identity, Ulp(0.0)),
    ];
    let reasons = [
        "has 0 cases",
        "is empty: its list is empty",
        "has a filter that rejects nearly all values",
        "has a filter that rejects nearly all values",
        "is empty: its range starts at 1, above its end 0",
    ];
    for (found, reason) in found.into_iter().zip(reasons) {
        let Err(error @ Failure::Domain { .. }) = found else { panic!("{found:?}") };
        let (error, head) = (error.to_string(), format!("the domain of `f` {reason}"));
        assert!(error.starts_with(&head), "{error}");
    }
    let package = Package::from_source("planted", "fn g(x: f32, alpha: f32) -> f32 { return x; }");
    let over = package.function("g").over((0.0..=1.0, 1.0..=f32::NAN));
    let error =
        over.unrecorded().try_satisfies("holds", |_, _: f32| true).expect_err("empty").to_string();
    assert_eq!(error, "the domain of `g` is empty: the range of `alpha` ends at NaN");
}

/// Karat refuses checks that can't fail: their transformation has no effect, or their tolerance allows every error.
// Lesson 13
#[test]
fn a_check_that_could_not_fail() {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return x; }");
    let over = || package.function("f").over(0.0..=1.0);
    let found = over().unrecorded().try_invariant_under(|x| x, Ulp(0.0));
    assert!(matches!(found, Err(Failure::Domain { .. })), "{found:?}");
    for bound in [f64::INFINITY, f64::NAN, -1.0] {
        let tolerances = [Tolerance::from(Ulp(bound)), Rel(1.0).or(Abs(bound))];
        for tolerance in tolerances {
            let found = over().unrecorded().try_agrees_with(|_: f64| 5.0, tolerance);
            assert!(matches!(found, Err(Failure::Signature { .. })), "{bound}: {found:?}");
        }
    }
    let pictures = Package::from_source("gradient", include_str!("../planted/gradient.wgsl"));
    let goldens = Goldens::open("no such folder".as_ref());
    for relative in [f32::NAN, f32::INFINITY, -1.0] {
        let frame = pictures.frame("", 8, 8).fullscreen("corners", "gradient").tolerance(relative);
        let error =
            frame.unrecorded().try_matches(&goldens, "gradient").expect_err("a useless tolerance");
        assert!(error.to_string().contains("the tolerance of the frame is"), "{error}");
    }
}

/// A shader may define functions with the names of builtins, such as `select`, although Karat's own code calls these
/// builtins. The check still calls the shader's function and compares its results.
#[test]
fn shaders_that_redefine_what_the_kernel_uses() {
    let shadows = [
        "fn select(a: u32, b: u32, c: bool) -> u32 { return b; }\n\
         fn f(x: f32) -> bool { return select(0u, 1u, x > 0.0) == 7u; }",
        "fn clamp(x: f32, a: f32, b: f32) -> f32 { return x; }\n\
         fn f(x: f32) -> bool { return clamp(x, 2.0, 3.0) > 1.0; }",
        "fn karat_case(x: f32) -> f32 { return -x; }\n\
         fn f(x: f32) -> bool { return karat_case(x) > 0.0; }",
    ];
    for wgsl in shadows {
        let package = Package::from_source("planted", wgsl);
        let check = || package.function("f").over(0.0..=1.0);
        check().unrecorded().try_agrees_with(|_: f64| false, Ulp(0.0)).expect("each returns false");
        let found = check().unrecorded().try_agrees_with(|_: f64| true, Ulp(0.0));
        let error = found.expect_err("none returns true").to_string();
        assert!(error.contains("65536 of 65536 cases fail"), "{error}");
    }
}

/// No case reads what another case wrote, because each case has its own storage buffers and its own workgroup memory.
// Lesson 124
#[test]
fn functions_that_would_share_state_between_cases() {
    let shared = [
        ("var<workgroup> w: array<f32, 1>;\nfn f(x: f32) -> f32 { w[0] = x; return w[0]; }", "w"),
        (
            "@group(0) @binding(0) var<storage, read_write> s: array<f32, 4>;\n\
          fn f(x: f32) -> f32 { s[0] += x; return s[0]; }",
            "s",
        ),
    ];
    for (wgsl, name) in shared {
        let package = Package::from_source("planted", wgsl);
        let probe = package.function("f");
        match name {
            "w" => {
                let found = probe
                    .over(0.0..=1.0)
                    .cases(200)
                    .unrecorded()
                    .try_agrees_with(|x: f64| x, Ulp(0.0));
                found.expect("no case sees another one's");
            }
            _ => {
                let check = || {
                    let probe = probe.clone().with(name, Storage::new([1.0_f32, 0.0, 0.0, 0.0]));
                    probe.over(0.0..=1.0).cases(200)
                };
                let sound = |x: f64| (1.0 + x, [1.0 + x, 0.0, 0.0, 0.0]);
                check()
                    .unrecorded()
                    .try_agrees_with(sound, Ulp(1.0))
                    .expect("no case sees another one's");
                let wrong = |x: f64| (1.0 + x, [1.0, 0.0, 0.0, 0.0]);
                let error =
                    check().unrecorded().try_agrees_with(wrong, Ulp(1.0)).expect_err("it writes");
                assert!(error.to_string().contains("at .s[0]"), "{error}");
            }
        }
    }
}

/// Each faulty function returns NaN, an infinity or a huge number only if two arguments are equal, opposite or very
/// close to each other. The check finds the fault, because Karat also tries such values for arguments of the same type.
// Lesson 64
#[test]
fn arguments_that_meet() {
    let slanted = "all(abs(a) > vec3f(0.1))";
    let directions = |body: &str| {
        let wgsl = format!(
            "fn f(n: vec3f, a: vec3f, b: vec3f) -> f32 {{\n    \
                 return select(1.0, length({body}), {slanted});\n}}"
        );
        Package::from_source("planted", wgsl)
    };
    let bounded = |_: (Vec3, Vec3, Vec3), length: f32| length < 1e3;
    let sound = directions("a + 2.0 * b");
    let sphere = || (UnitVector, UnitVector, UnitVector);
    sound
        .function("f")
        .over(sphere())
        .unrecorded()
        .try_satisfies("is bounded", bounded)
        .expect("no fault");
    for body in [
        "normalize(a - b)",
        "normalize(a + b)",
        "normalize(n - a)",
        "normalize(a + n)",
        "a / f32(!(all(n == a) && all(a == b)))",
        // The arguments are close to each other, but not equal.
        "a / f32(!(distance(a, b) > 0.0 && distance(a, b) < 1e-5))",
        "a / f32(!(distance(a, -b) > 0.0 && distance(a, -b) < 1e-5))",
    ] {
        let package = directions(body);
        let found =
            package.function("f").over(sphere()).unrecorded().try_satisfies("is bounded", bounded);
        let found = disagreement(found);
        assert!(found.paths.iter().all(|path| path.census.failures > 3), "{body}: {found}");
    }
    let upper = || (Hemisphere, Hemisphere, Hemisphere.filter(|l| l.z > 0.0));
    let package = directions("normalize(a - b)");
    let found =
        package.function("f").over(upper()).unrecorded().try_satisfies("is bounded", bounded);
    let found = disagreement(found);
    // Karat simplifies both arguments together, because otherwise they would no longer be equal.
    for path in &found.paths {
        let simplest = path.simplest.as_ref().unwrap_or_else(|| panic!("it is reduced: {found}"));
        let arguments = &simplest.failure.arguments;
        assert_eq!(arguments[1].1, arguments[2].1, "{found}");
        assert!(arguments[1].1.len() < path.worst.arguments[1].1.len(), "{found}");
    }
    let numbers = |body: &str| {
        let wgsl = format!(
            "fn f(a: f32, b: f32) -> f32 {{ return select(1.0, {body}, a > 0.2 && a < 0.4); }}"
        );
        Package::from_source("planted", wgsl)
    };
    for body in ["1.0 / (a - b)", "1.0 / f32(a == b || abs(a - b) > 1e-5)", "1.0 / (a + b)"] {
        let package = numbers(body);
        let over = package.function("f").over((0.0..=1.0, -1.0..=1.0));
        disagreement(over.unrecorded().try_satisfies("is any number", |_, _: f32| true));
    }
}

/// Many threads share one GPU device. Each thread gets its own results, every time.
#[test]
fn many_threads_on_one_device() {
    let package = Package::from_source("s", "fn f(x: f32, k: f32) -> f32 { return x + k; }");
    std::thread::scope(|scope| {
        for thread in 0..8_u8 {
            let package = &package;
            scope.spawn(move || {
                for round in 0..25_u8 {
                    let k = f32::from(thread) + f32::from(round);
                    package
                        .function("f")
                        .over((0.0..=1.0, Just(k)))
                        .cases(257)
                        .unrecorded()
                        .try_agrees_with(|x: f64, k: f64| x + k, Ulp(1.0))
                        .expect("each thread reads its own results");
                }
            });
        }
    });
}

// Lesson 13
#[test]
fn a_domain_or_reference_of_other_types() {
    let package = Package::from_source("planted", "fn f(x: f32, n: u32) -> f32 { return x; }");
    let mismatches = [
        package.function("f").over(0.0..=1.0).unrecorded().try_agrees_with(|x: f64| x, Ulp(0.0)),
        package
            .function("f")
            .over((0.0..=1.0, Integers(0..=7_i32)))
            .unrecorded()
            .try_agrees_with(|x: f64, _: i32| x, Ulp(0.0)),
        package
            .function("f")
            .over((0.0..=1.0, Integers(0..=7_u32)))
            .unrecorded()
            .try_agrees_with(|x: f64, _: u32| DVec3::splat(x), Ulp(0.0)),
        package.function("f").over((0.0..=1.0, Integers(0..=7_u32))).unrecorded().try_agrees_with(
            |x: f64, _: u32| x,
            Tolerance::per_lane([Ulp(0.0).into(), Ulp(0.0).into()]),
        ),
    ];
    let texts = mismatches.map(|found| match found {
        Err(failure @ Failure::Signature { .. }) => failure.to_string(),
        other => panic!("not a mismatch of signatures: {other:?}"),
    });
    assert_eq!(
        texts[0],
        "`f` takes (f32, u32), but the domain supplies (f32)\n  f(x: f32, n: u32) -> f32\n  at <planted>:1:1"
    );
    assert!(
        texts[1].contains("takes (f32, u32), but the domain supplies (f32, i32)"),
        "{}",
        texts[1]
    );
    assert!(texts[2].contains("returns f32, but the reference returns vec3<f32>"), "{}", texts[2]);
    assert!(texts[3].contains("returns 1 component, but the tolerance has bounds for 2"));
}

#[test]
fn an_unknown_function_and_a_missing_fixture() {
    let error = PBR
        .function("fresnel::schlik")
        .over(0.0..=1.0)
        .unrecorded()
        .try_agrees_with(|x: f64| x, Ulp(0.0));
    assert!(error.expect_err("unknown").to_string().contains("did you mean `fresnel::schlick`?"));

    let radiance = || PBR.function("environment::radiance");
    let constant = |_: DVec3| DVec3::ONE;
    let message = |result: Result<karat::check::Agreement, Failure>| match result {
        Err(Failure::Probe(ProbeError::Fixture(error))) => error.to_string(),
        other => panic!("not an error of fixtures: {other:?}"),
    };
    let cube = || CubeMap::constant(Vec3::ONE);
    let missing =
        message(radiance().over(UnitVector).unrecorded().try_agrees_with(constant, Ulp(0.0)));
    for part in [
        "`environment::environment` (texture_cube<f32>) has no fixture: bind \
         `environment::environment` by `with`",
        "environment.wgsl:",
        "bound here",
    ] {
        assert!(missing.contains(part), "{part} in:\n{missing}");
    }
    let misspelt =
        radiance().with("enviroment", cube()).with("environment_sampler", Sampler::LINEAR);
    assert!(
        message(misspelt.over(UnitVector).unrecorded().try_agrees_with(constant, Ulp(0.0)))
            .contains("did you mean `environment`?")
    );
    let wrong = radiance()
        .with("environment", Texture::constant(glam::Vec4::ONE))
        .with("environment_sampler", Sampler::LINEAR);
    assert!(
        message(wrong.over(UnitVector).unrecorded().try_agrees_with(constant, Ulp(0.0)))
            .contains("is a texture_cube<f32>, but the fixture is a Texture")
    );
}

/// The function is wrong only for one of many edges of its first argument. The check finds this edge with each seed,
/// although the function has three arguments.
#[test]
fn every_edge_of_a_tuple_is_tried() {
    let wgsl = "fn f(x: f32, y: f32, z: f32) -> f32 {\n    \
                return select(x, 0.0 * x, bitcast<u32>(x) == 0x4b000001u);\n}"; // 2^23 + 1
    let package = Package::from_source("planted", wgsl);
    for seed in 0..5 {
        let over = package.function("f").over((Edges::f32(), 0.0..=1.0, 0.0..=1.0)).seed(seed);
        let same = over.unrecorded().try_agrees_with(|x: f64, _: f64, _: f64| x, Ulp(0.0));
        disagreement(same);
    }
}

/// A check with a relative tolerance passes even if a driver flushes a tiny result to 0. Karat refuses a tolerance that
/// allows every error.
#[test]
fn bounds_near_zero() {
    let package = Package::from_source("planted", "fn f(x: f32, y: f32) -> f32 { return x * y; }");
    let over = || package.function("f").over((0.0..=1.0, 0.0..=1.0));
    over()
        .unrecorded()
        .try_agrees_with(|x: f64, y: f64| x * y, Rel(1e-6))
        .expect("products of edges vanish");
    for band in [f64::NAN, f64::INFINITY, -1.0] {
        let found =
            over().unrecorded().try_agrees_with(|x: f64, _: f64| 7.0 * x, Ulp(4.0).near_zero(band));
        assert!(matches!(found, Err(Failure::Signature { .. })), "{band}: {found:?}");
    }
    let none =
        over().unrecorded().try_agrees_with(|x: f64, _: f64| 7.0 * x, Tolerance::Any(Vec::new()));
    assert!(matches!(none, Err(Failure::Signature { .. })), "{none:?}");
}

/// If all results are so small that a driver may flush them to 0, the check compares nothing, so it fails.
// Lesson 77
#[test]
fn results_that_may_all_be_flushed() {
    let package = Package::from_source("s", "fn f(d: f32) -> f32 { return exp(-2.0 * d); }");
    let check = |low: f32, tolerance: Tolerance| {
        let check = package.function("f").over(low..=200.0);
        check.unrecorded().try_agrees_with(|d: f64| (-d).exp(), tolerance)
    };
    for tolerance in [Rel(1e-3).into(), Ulp(4.0).into()] {
        let failure = check(90.0, tolerance).expect_err("nothing is compared").to_string();
        assert!(failure.contains("below the smallest normal f32"), "{failure}");
    }
    assert!(matches!(check(0.5, Rel(1e-3).into()), Err(Failure::Disagreement(_))));
}

/// Builds a function `f` that returns `body`. `body` can call `flush`, which replaces numbers closer to 0 than `least`
/// by 0. So `f` gives the same results on drivers that flush and on drivers that don't.
fn flushing(least: &str, body: &str) -> Package {
    let wgsl = format!(
        "fn flush(x: f32) -> f32 {{\n    let size = bitcast<u32>(x) & 0x7fffffffu;\n    \
         return select(x, 0.0, size < {least});\n}}\n\
         fn size(x: f32) -> f32 {{ return f32(bitcast<u32>(x) & 0x7fffffffu); }}\n\
         fn f(x: f32, y: f32) -> f32 {{ return {body}; }}"
    );
    Package::from_source("planted", &wgsl)
}

/// The bits of the smallest normal f32, below which all positive numbers are subnormal.
const SUBNORMAL: &str = "0x800000u";
const ONE_NORMAL: &str = "0x800001u";

/// The reference: `y` plus a step from 0 to 1 at `x` = 0.
fn step(x: f64, y: f64) -> f64 {
    if x > 0.0 { 1.0 + y } else { y }
}

/// A result passes if it is right for the given arguments, or right after some or all subnormal arguments are replaced
/// by 0. A function that replaces other arguments fails.
// Lesson 48
#[test]
fn only_subnormal_arguments_may_be_flushed() {
    let numbers = || (Edges::f32(), OneOf(vec![0.0_f32, 1e-45, 0.5]));
    let check = |least: &str, body: &str| {
        let package = flushing(least, body);
        package.function("f").over(numbers()).unrecorded().try_agrees_with(step, Ulp(1.0))
    };
    let right = "select(y, 1.0 + y, flush(x) > 0.0)";
    check("0u", "select(y, 1.0 + y, size(x) > 0.0 && bitcast<i32>(x) > 0)").expect("as given");
    check(SUBNORMAL, right).expect("subnormals are zeros");
    check("0x400000u", right).expect("some of them are");
    for (least, body) in [
        (ONE_NORMAL, right),                                // also flushes normal numbers
        (SUBNORMAL, "select(y, 1.0 + y, flush(x) >= 0.0)"), // is also wrong at 0
        (SUBNORMAL, "select(y, 1.0 + y, flush(x) > 0.5)"),  // is wrong at normal numbers
        (SUBNORMAL, "select(y, 1.0 + y, flush(x) > 0.0) + select(0.0, 0.5, size(x) == 1.0)"),
        (SUBNORMAL, "select(0.0, 1.0 + y, flush(x) > 0.0)"), // also flushes y
        (SUBNORMAL, "select(y, 1.0 + y, flush(x) > 0.0) / select(1.0, 0.0, size(x) == 1.0)"),
    ] {
        let found = disagreement(check(least, body));
        let path = &found.paths[0];
        assert!(path.census.failures < path.census.cases, "{body} is right in places");
    }
}

/// `satisfies` and `at_limit` also accept results that are right if subnormal arguments are replaced by 0.
#[test]
fn statements_and_limits_may_be_those_of_flushed_arguments() {
    let holds = |x: f32, result: f32| f64::from(result) == step(f64::from(x), 0.0);
    let check = |least: &str| {
        let package = flushing(least, "select(y, 1.0 + y, flush(x) > 0.0)");
        let function = package.function("f").over((Edges::f32(), Just(0.0)));
        function
            .unrecorded()
            .try_satisfies("is the step", move |(x, _), result: f32| holds(x, result))
    };
    check(SUBNORMAL).expect("subnormals are zeros");
    disagreement(check(ONE_NORMAL));

    let steps = Limit::toward(0.0, [0.1, 0.01, 0.001]);
    let limit = |least: &str| {
        let package = flushing(least, "select(y, 1.0 + y, flush(x) > 0.0)");
        let function = package.function("f").over((Edges::f32(), Just(0.0)));
        function.unrecorded().try_at_limit("y", steps.clone(), step, Abs(2e-3))
    };
    limit(SUBNORMAL).expect("subnormals are zeros");
    disagreement(limit(ONE_NORMAL));
}

/// If the reference isn't finite at 0, Karat can't compare with the flushed argument. So the result must be right for
/// the given argument.
#[test]
fn nothing_is_excused_where_the_flushed_argument_has_no_reference() {
    let check = |result: &str| {
        let package = flushing(SUBNORMAL, result);
        let function = package.function("f").over((OneOf(vec![1e-45_f32, 1.0]), Just(0.0)));
        function.unrecorded().try_agrees_with(|x: f64, _: f64| x.ln() / 100.0, Abs(1e-2))
    };
    check("select(-1.0328, 0.0, size(x) > 1.0)").expect("ln(1e-45) / 100, and ln(1)");
    disagreement(check("select(-1.06, 0.0, size(x) > 1.0)"));
}
