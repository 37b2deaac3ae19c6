//! Proof that each kind of check can fail: a fault is planted, and must be seen.

use std::f64::consts::{PI, TAU};
use std::path::Path as FilePath;
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use glam::{DQuat, DVec3, Vec3};
use karat::check::{Disagreement, Failure};
use karat::golden::Acceptance;
use karat::image::Precision;
use karat::prelude::*;
use karat::probe::ProbeError;
use karat::{Goldens, Image};
use shaders::{PBR, fresnel, geometry};

/// The shader library with one text replaced in one module.
fn mutant(module: &str, original: &str, fault: &str) -> Package {
    let mut modules = Vec::new();
    for name in PBR.modules().expect("the library is readable") {
        let path = PBR.root().join(format!("{}.wgsl", name.replace("::", "/")));
        let mut text = std::fs::read_to_string(path).expect("the library is readable");
        if name == module {
            assert!(text.contains(original), "`{original}` isn't in {module}.wgsl any more");
            text = text.replacen(original, fault, 1);
        }
        modules.push((name, text));
    }
    Package::from_modules("mutant", modules)
}

#[track_caller]
fn disagreement<T>(result: Result<T, Failure>) -> Disagreement {
    match result {
        Ok(_) => panic!("the fault was not seen"),
        Err(Failure::Disagreement(disagreement)) => *disagreement,
        Err(other) => panic!("the check failed for another reason: {other}"),
    }
}

fn schlick(package: &Package) -> Result<karat::check::Agreement, Failure> {
    package
        .function("fresnel::schlick")
        .over((UnitRgb, 0.0..=1.0))
        .try_agrees_with(fresnel::schlick, Ulp(11.0))
}

#[test]
fn the_unchanged_library_agrees() {
    let agreement = schlick(&mutant("fresnel", "abs(1.0 - v_dot_h)", "abs(1.0 - v_dot_h)"));
    assert_eq!(agreement.expect("no fault is planted").cases, 65_536);
}

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
    assert_eq!(found.function.path, "fresnel::schlick", "a fault in what it calls is seen too");
}

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
        .try_agrees_with(geometry::smith_g1, Ulp(10.0));
    disagreement(swapped);
    let package = mutant("layering", "(environment - base)", "(base - environment)");
    let coat = package
        .function("layering::thin_coat")
        .over((Just(Vec3::ONE), Just(Vec3::ZERO), 0.0..=1.0))
        .try_agrees_with(shaders::layering::thin_coat, Ulp(14.0).or(Abs(3e-5)));
    disagreement(coat);
}

/// 65,536 inputs, one of which gives NaN (or an infinity): found under the loosest tolerance.
#[test]
fn one_bad_result_of_65536() {
    for (bits, nan, infinite) in [("0x7fc00000u", 1, 0), ("0x7f800000u", 0, 1)] {
        let wgsl = format!(
            "fn f(i: u32) -> f32 {{ return select(1.0, bitcast<f32>(i - 54321u + {bits}), \
             i == 54321u); }}"
        );
        let package = Package::from_source("planted", wgsl);
        let over = || package.function("f").over(Integers(0..=65_535_u32));
        let loose = Abs(1e300).or(Rel(1e300));
        let found = disagreement(over().try_agrees_with(|_: u32| 1.0, loose));
        for path in &found.paths {
            assert_eq!((path.census.cases, path.census.failures), (65_536, 1));
            assert_eq!((path.census.nan, path.census.infinite), (nan, infinite));
            assert_eq!(path.worst.arguments, [("i".to_owned(), "54321".to_owned())]);
        }
        disagreement(over().try_satisfies("is anything", |_, _: f32| true));
        disagreement(over().try_invariant_under(|i| i ^ 1, Abs(1e300)));
    }
}

#[test]
fn a_statement_that_does_not_hold() {
    let found = PBR
        .function("fresnel::schlick")
        .over((UnitRgb, 0.0..=1.0))
        .try_satisfies("is below 0.999", |_, f: Vec3| f.max_element() < 0.999);
    assert_eq!(disagreement(found).check, "satisfies");
}

#[test]
fn a_function_that_is_not_symmetric() {
    let package = mutant("geometry", "masking + shadowing", "masking + 1.001 * shadowing");
    let found = package
        .function("geometry::smith_correlated")
        .over((1e-4..=1.0, 0.0..=1.0, 0.0..=1.0))
        .try_invariant_under(|(alpha, v, l)| (alpha, l, v), Ulp(2.0));
    assert_eq!(disagreement(found).check, "invariant_under");
}

/// The tolerance of the last component counts: only `z` is wrong, and only `z` is strict.
#[test]
fn a_fault_in_the_last_component() {
    let wgsl = "fn f(x: f32) -> vec3f { return vec3f(x, x, x * 1.001); }";
    let package = Package::from_source("planted", wgsl);
    let tolerance = Tolerance::per_lane([Rel(0.1).into(), Rel(0.1).into(), Ulp(1.0).into()]);
    let found = package.function("f").over(1.0..=2.0).try_agrees_with(DVec3::splat, tolerance);
    assert!(disagreement(found).paths.iter().all(|path| path.worst.component == ".z"));
}

#[test]
fn a_reference_that_is_not_a_number() {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return x; }");
    let found = package.function("f").over(-1.0..=1.0).try_agrees_with(f64::sqrt, Abs(10.0));
    assert!(matches!(found, Err(Failure::Reference { .. })), "{found:?}");
}

#[test]
fn nothing_to_compare() {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return x; }");
    let identity = |x: f64| x;
    let found = [
        package.function("f").over(0.0..=1.0).cases(0).try_agrees_with(identity, Ulp(0.0)),
        package.function("f").over(OneOf::<f32>(vec![])).try_agrees_with(identity, Ulp(0.0)),
        package
            .function("f")
            .over((0.0..=1.0).filter(|_: &f32| false))
            .try_agrees_with(identity, Ulp(0.0)),
        package
            .function("f")
            .over((0.0..=1.0).filter(|x: &f32| x.to_bits() % 1_000_003 == 1))
            .try_agrees_with(identity, Ulp(0.0)),
        package.function("f").over(1.0..=0.0).try_agrees_with(identity, Ulp(0.0)),
    ];
    let reasons = [
        "is asked for 0 cases",
        "is empty: its list is empty",
        "rejects nearly everything that its filter sees",
        "rejects nearly everything that its filter sees",
        "is empty: its range starts at 1 and ends at 0",
    ];
    for (found, reason) in found.into_iter().zip(reasons) {
        let Err(error @ Failure::Domain { .. }) = found else { panic!("{found:?}") };
        let (error, head) = (error.to_string(), format!("the domain of `f` {reason}"));
        assert!(error.starts_with(&head), "{error}");
    }
    let package = Package::from_source("planted", "fn g(x: f32, alpha: f32) -> f32 { return x; }");
    let over = package.function("g").over((0.0..=1.0, 1.0..=f32::NAN));
    let error = over.try_satisfies("holds", |_, _: f32| true).expect_err("empty").to_string();
    assert_eq!(error, "the domain of `g` is empty: the range of `alpha` ends at NaN");
}

/// A transformation that changes nothing, and bounds that bound nothing.
#[test]
fn a_check_that_could_not_fail() {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return x; }");
    let over = || package.function("f").over(0.0..=1.0);
    let found = over().try_invariant_under(|x| x, Ulp(0.0));
    assert!(matches!(found, Err(Failure::Domain { .. })), "{found:?}");
    for bound in [f64::INFINITY, f64::NAN, -1.0] {
        let tolerances = [Tolerance::from(Ulp(bound)), Rel(1.0).or(Abs(bound))];
        for tolerance in tolerances {
            let found = over().try_agrees_with(|_: f64| 5.0, tolerance);
            assert!(matches!(found, Err(Failure::Signature { .. })), "{bound}: {found:?}");
        }
    }
    let pictures = Package::from_source("gradient", include_str!("planted/gradient.wgsl"));
    let goldens = Goldens::open("no such folder".as_ref());
    for relative in [f32::NAN, f32::INFINITY, -1.0] {
        let frame = pictures.frame("", 8, 8).fullscreen("corners", "gradient").tolerance(relative);
        let error = frame.try_matches(&goldens, "gradient").expect_err("a useless tolerance");
        assert!(error.to_string().contains("the tolerance of the frame is"), "{error}");
    }
}

/// A shader's own functions are called, also where they are named as WGSL's that the kernel uses: what
/// they return is seen.
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
        check().try_agrees_with(|_: f64| false, Ulp(0.0)).expect("each returns false");
        let found = check().try_agrees_with(|_: f64| true, Ulp(0.0));
        let error = found.expect_err("none returns true").to_string();
        assert!(error.contains("65536 of 65536 cases fail"), "{error}");
    }
}

/// A result that depends on other cases of its dispatch is no function of its arguments.
#[test]
fn functions_that_share_state_between_cases() {
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
        let found = package.function("f").over(0.0..=1.0).try_agrees_with(|x: f64| x, Ulp(0.0));
        let error = found.expect_err("state is shared").to_string();
        assert!(error.contains("which other cases of the same dispatch see"), "{error}");
        assert!(error.contains(&format!("`{name}`")), "{error}");
    }
}

karat::shareable! {
    struct Gains mirrors GainsMirror { gain: f32, bias: f32 }
}

karat::shareable! {
    struct Swapped mirrors SwappedMirror { bias: f32, gain: f32 }
}

/// Fixtures are compared with their variables by type and by the names of members.
#[test]
fn fixtures_of_another_type() {
    let wgsl = "struct Gains { gain: f32, bias: f32 }\n\
                @group(0) @binding(0) var<uniform> gains: Gains;\n\
                @group(0) @binding(1) var<storage, read> table: array<f32>;\n\
                fn f(x: f32) -> f32 { return gains.gain * x + gains.bias + table[0]; }";
    let package = Package::from_source("planted", wgsl);
    let check = |gains: Uniform, table: Storage| {
        let probe = package.function("f").with("gains", gains).with("table", table);
        probe.over(0.0..=1.0).try_agrees_with(|x: f64| 2.0 * x + 3.5, Abs(1e-6))
    };
    let right = || Uniform::new(Gains { gain: 2.0, bias: 3.0 });
    let table = || Storage::new([0.5_f32]);
    check(right(), table()).expect("the fixtures fit");
    let swapped = Uniform::new(Swapped { bias: 3.0, gain: 2.0 });
    let wrong = [
        (swapped, table(), "holds { gain: f32, bias: f32 }, the fixture { bias: f32, gain: f32 }"),
        (Uniform::new([1.0_f32; 2]), table(), "holds { gain: f32, bias: f32 }, the fixture array"),
        (right(), Storage::new([7_u32]), "holds f32, the fixture u32"),
        (right(), Storage::new(Vec::<f32>::new()), "is empty"),
    ];
    for (gains, table, message) in wrong {
        let error = check(gains, table).expect_err(message).to_string();
        assert!(error.contains(message), "{error}");
    }
}

/// Two variables of a frame may have one binding number, in draws of their own: each draw reads its
/// own fixture. In one draw they can't.
#[test]
fn a_fixture_that_another_one_hides() {
    let wgsl = "@group(0) @binding(0) var<uniform> near: vec4f;\n\
                @group(0) @binding(0) var<uniform> far: vec4f;\n\
                @vertex fn corners(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {\n    \
                    return vec4f(4.0 * f32(i & 1u) - 1.0, 4.0 * f32(i >> 1u) - 1.0, 1.0, 1.0);\n}\n\
                @vertex fn moved(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {\n    \
                    return vec4f(4.0 * f32(i & 1u) - 1.0, 4.0 * f32(i >> 1u) - 1.0, near.w, 1.0);\n}\n\
                @fragment fn first() -> @location(0) vec4f { return near; }\n\
                @fragment fn second() -> @location(0) vec4f { return far; }";
    let package = Package::from_source("planted", wgsl);
    let frame = |vertex: &str| {
        package
            .frame("", 4, 4)
            .fullscreen("corners", "first")
            .fullscreen(vertex, "second")
            .blend(karat::frame::Blend::Add)
            .with("near", Uniform::new(glam::Vec4::splat(0.25)))
            .with("far", Uniform::new(glam::Vec4::ONE))
    };
    for path in selected() {
        let image = frame("corners").render(path).expect("each draw has its fixture");
        assert!(image.pixels().iter().all(|pixel| *pixel == [1.25; 4]), "{:?}", image.pixels()[0]);
        let error = frame("moved").render(path).expect_err("one draw, one binding").to_string();
        assert_eq!(
            error,
            "`near` and `far` are both @group(0) @binding(0), and one draw can bind only one of \
             them: give one another number"
        );
    }
}

/// Functions that are NaN or infinite only where two arguments meet, off the axes and inside of
/// ranges: like components of a tuple do.
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
    sound.function("f").over(sphere()).try_satisfies("is bounded", bounded).expect("no fault");
    for body in [
        "normalize(a - b)",
        "normalize(a + b)",
        "normalize(n - a)",
        "normalize(a + n)",
        "a / f32(!(all(n == a) && all(a == b)))",
        // Close, but not equal.
        "a / f32(!(distance(a, b) > 0.0 && distance(a, b) < 1e-5))",
        "a / f32(!(distance(a, -b) > 0.0 && distance(a, -b) < 1e-5))",
    ] {
        let package = directions(body);
        let found = package.function("f").over(sphere()).try_satisfies("is bounded", bounded);
        let found = disagreement(found);
        assert!(found.paths.iter().all(|path| path.census.failures > 3), "{body}: {found}");
    }
    let upper = || (Hemisphere, Hemisphere, Hemisphere.filter(|l| l.z > 0.0));
    let package = directions("normalize(a - b)");
    let found = package.function("f").over(upper()).try_satisfies("is bounded", bounded);
    let found = disagreement(found);
    // Reduced together, or they would not meet.
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
        disagreement(over.try_satisfies("is any number", |_, _: f32| true));
    }
}

/// Many threads share a device: each gets its own results, every time.
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
                        .try_agrees_with(|x: f64, k: f64| x + k, Ulp(1.0))
                        .expect("each thread reads its own results");
                }
            });
        }
    });
}

#[test]
fn a_domain_or_reference_of_other_types() {
    let package = Package::from_source("planted", "fn f(x: f32, n: u32) -> f32 { return x; }");
    let mismatches = [
        package.function("f").over(0.0..=1.0).try_agrees_with(|x: f64| x, Ulp(0.0)),
        package
            .function("f")
            .over((0.0..=1.0, Integers(0..=7_i32)))
            .try_agrees_with(|x: f64, _: i32| x, Ulp(0.0)),
        package
            .function("f")
            .over((0.0..=1.0, Integers(0..=7_u32)))
            .try_agrees_with(|x: f64, _: u32| DVec3::splat(x), Ulp(0.0)),
        package.function("f").over((0.0..=1.0, Integers(0..=7_u32))).try_agrees_with(
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
        "`f` takes (f32, u32), the domain draws (f32)\n  f(x: f32, n: u32) -> f32\n  at <planted>:1:1"
    );
    assert!(texts[1].contains("takes (f32, u32), the domain draws (f32, i32)"), "{}", texts[1]);
    assert!(texts[2].contains("returns f32, the reference returns vec3<f32>"), "{}", texts[2]);
    assert!(texts[3].contains("returns 1 components, the tolerance is declared for 2"));
}

#[test]
fn an_unknown_function_and_a_missing_fixture() {
    let error =
        PBR.function("fresnel::schlik").over(0.0..=1.0).try_agrees_with(|x: f64| x, Ulp(0.0));
    assert!(error.expect_err("unknown").to_string().contains("did you mean `fresnel::schlick`?"));

    let radiance = || PBR.function("environment::radiance");
    let constant = |_: DVec3| DVec3::ONE;
    let message = |result: Result<karat::check::Agreement, Failure>| match result {
        Err(Failure::Probe(ProbeError::Fixture(error))) => error.to_string(),
        other => panic!("not an error of fixtures: {other:?}"),
    };
    let cube = || CubeMap::constant(Vec3::ONE);
    assert_eq!(
        message(radiance().over(UnitVector).try_agrees_with(constant, Ulp(0.0))),
        "`environment::environment` (texture_cube<f32>) has no fixture; add \
         `.with(\"environment::environment\", ...)`"
    );
    let misspelt =
        radiance().with("enviroment", cube()).with("environment_sampler", Sampler::Linear);
    assert!(
        message(misspelt.over(UnitVector).try_agrees_with(constant, Ulp(0.0)))
            .contains("did you mean `environment`?")
    );
    let wrong = radiance()
        .with("environment", Texture::constant(glam::Vec4::ONE))
        .with("environment_sampler", Sampler::Linear);
    assert!(
        message(wrong.over(UnitVector).try_agrees_with(constant, Ulp(0.0)))
            .contains("is a texture_cube<f32>, the fixture is a Texture")
    );
}

/// What a failure says, with what differs between machines taken out.
#[test]
fn the_message_shows_line_inputs_values_error_census_and_replay() {
    let fault = "abs(1.0 - v_dot_h) * 1.01";
    let found = disagreement(schlick(&mutant("fresnel", "abs(1.0 - v_dot_h)", fault)));
    let text = found.to_string();
    let at = found.function.span.to_string();
    for part in [
        "error: `fresnel::schlick` fails agrees_with: 11 ulp",
        &at,
        "fn schlick(f0: vec3f, v_dot_h: f32) -> vec3f {",
        "of 65536 cases fail (",
        "too high",
        "worst (case ",
        "     f0 = (",
        "v_dot_h = ",
        " (0x1.",
        "error = ",
        " ulp (11 allowed)",
        "first (case ",
        "replay: KARAT_PATHS=",
        "KARAT_SEED=0x",
        "KARAT_CASE=",
        "cargo test -p tests --test must_fail -- --exact \
         the_message_shows_line_inputs_values_error_census_and_replay",
    ] {
        assert!(text.contains(part), "`{part}` is missing in:\n{text}");
    }
}

/// Verbs that call the function twice show both calls, and say which is which.
#[test]
fn messages_of_properties_show_both_calls() {
    let package = Package::from_source(
        "planted",
        "fn f(a: f32, b: f32) -> f32 { return a + 2.0 * b; }\n\
         fn g(x: f32) -> f32 { return select(x, x - 0.002, x > 0.731); }",
    );
    let over = || package.function("f").over((0.0..=1.0, 0.0..=1.0));
    let found = disagreement(over().try_invariant_under(|(a, b)| (b, a), Ulp(4.0)));
    let text = found.to_string();
    let expected = "
  worst (case 1)
           a = 1
           b = 0
          a' = 0
          b' = 1
    returned = 2
               (returned of the primed arguments, expected of the others)
      actual = 2 (0x1p+1)
    expected = 1 (0x1p+0)  nearest f32 of 1
       error = 8.39e6 ulp (4 allowed)
";
    assert!(text.contains(expected), "{text}");
    // A step of 1/500 between numbers that are closer than that.
    let g = package.function("g").over(0.0..=1.0);
    let found = disagreement(g.try_is_monotone_in("x", Trend::Increasing, Ulp(1.0)));
    assert!(found.paths.iter().all(|path| path.census.failures < 100), "{found}");
}

/// A function that is checked twice by one verb: each has its own cases, name and replay.
#[test]
fn two_checks_of_one_function_are_told_apart() {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return sqrt(x); }");
    let over = |low: f32| package.function("f").over(low..=1.0);
    let is_number = |_, x: f32| x >= 0.0;
    over(0.0).try_satisfies("is a number", is_number).expect("it is");
    let found = disagreement(over(-1.0).try_satisfies("is a number", is_number));
    assert!(found.paths.iter().all(|path| path.replay.contains("KARAT_CASE=f/satisfies#2/")));
}

/// A fault at one of many edge cases, in one of three arguments.
#[test]
fn every_edge_of_a_tuple_is_tried() {
    let wgsl = "fn f(x: f32, y: f32, z: f32) -> f32 {\n    \
                return select(x, 0.0 * x, bitcast<u32>(x) == 0x4b000001u);\n}"; // 2^23 + 1
    let package = Package::from_source("planted", wgsl);
    for seed in 0..5 {
        let over = package.function("f").over((Edges::f32(), 0.0..=1.0, 0.0..=1.0)).seed(seed);
        let same = over.try_agrees_with(|x: f64, _: f64, _: f64| x, Ulp(0.0));
        disagreement(same);
    }
}

/// What may be flushed is no relative error, and what bounds nothing no tolerance.
#[test]
fn bounds_near_zero() {
    let package = Package::from_source("planted", "fn f(x: f32, y: f32) -> f32 { return x * y; }");
    let over = || package.function("f").over((0.0..=1.0, 0.0..=1.0));
    over().try_agrees_with(|x: f64, y: f64| x * y, Rel(1e-6)).expect("products of edges vanish");
    for band in [f64::NAN, f64::INFINITY, -1.0] {
        let found = over().try_agrees_with(|x: f64, _: f64| 7.0 * x, Ulp(4.0).near_zero(band));
        assert!(matches!(found, Err(Failure::Signature { .. })), "{band}: {found:?}");
    }
    let none = over().try_agrees_with(|x: f64, _: f64| 7.0 * x, Tolerance::Any(Vec::new()));
    assert!(matches!(none, Err(Failure::Signature { .. })), "{none:?}");
}

/// Runs a planted fault in a process of its own.
fn planted(fault: &[&str], environment: &[(&str, &str)]) -> (Output, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_planted"));
    for name in ["CI", "KARAT_PATHS", "KARAT_REQUIRE", "KARAT_RECORD"] {
        command.env_remove(name);
    }
    command.env("KARAT_FAILURES", "off");
    let output = command
        .args(fault)
        .envs(environment.iter().copied())
        .output()
        .expect("the planted program was built with this test");
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    (output, text)
}

#[test]
fn no_fault_succeeds() {
    let (output, text) = planted(&["none"], &[]);
    assert!(output.status.success(), "{text}");
}

/// A replay that replays nothing is red, and says which check was likely meant. One that replays
/// the second check of a program is not.
#[test]
fn a_replay_of_nothing() {
    let (output, text) = planted(&["two"], &[("KARAT_CASE", "g/agrees_with/3")]);
    assert!(output.status.success() && text.contains("both agree"), "{text}");
    for case in
        ["f/agree_with/3", "h/agrees_with/3", "f/agrees_with#2/3", "f/agrees_with@uniform/3"]
    {
        let (output, text) = planted(&["two"], &[("KARAT_CASE", case)]);
        assert!(!output.status.success(), "{case}: {text}");
        assert!(
            text.contains(&format!(
                "test `main` replays nothing: KARAT_CASE={case} is none of its"
            )),
            "{text}"
        );
        assert!(text.contains("; did you mean `f/agrees_with`?"), "{text}");
    }
    let (output, text) = planted(&["two"], &[("KARAT_CASE", "g/agrees_with/65536")]);
    assert!(!output.status.success() && text.contains("none with index 65536"), "{text}");
    // One case that a transformation leaves as it is says nothing of the others.
    for case in ["f/invariant_under/0", "f/invariant_under/1"] {
        let (output, text) = planted(&["mirrored"], &[("KARAT_CASE", case)]);
        assert!(output.status.success(), "{text}");
    }
    let (output, text) = planted(&["in_a_thread"], &[("KARAT_CASE", "g/agrees_with/3")]);
    let reason =
        "`f/agrees_with` isn't `g/agrees_with`, which KARAT_CASE selects, and runs in a thread";
    assert!(!output.status.success() && text.contains(reason), "{text}");
    // A frame has no cases.
    let folder = tempfile::tempdir().expect("a temporary folder");
    let picture = ["golden", &folder.path().display().to_string()];
    let (output, text) = planted(&picture, &[("KARAT_CASE", "gradient/matches/0")]);
    assert!(!output.status.success(), "{text}");
    assert!(text.contains("is none of its checks, `frame gradient`"), "{text}");
}

/// The same in the threads of Rust's test runner: this program runs one of its own tests.
#[test]
fn a_test_that_replays_nothing() {
    let run = |case: &str| {
        let program = std::env::current_exe().expect("a test program");
        let mut command = Command::new(program);
        command.args(["--exact", "the_unchanged_library_agrees"]).env("KARAT_CASE", case);
        command.env_remove("KARAT_RECORD").env("KARAT_FAILURES", "off");
        let output = command.output().expect("it runs");
        (output.status.success(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    // The test wants all cases, so it fails by itself where one is replayed.
    let (passed, text) = run("fresnel::schlick/agrees_with/7");
    assert!(!passed && !text.contains("replays nothing"), "{text}");
    let (passed, text) = run("fresnel::schlik/agrees_with/7");
    assert!(!passed, "{text}");
    assert!(text.contains("test `the_unchanged_library_agrees` replays nothing"), "{text}");
    assert!(text.contains("; did you mean `fresnel::schlick/agrees_with`?"), "{text}");
}

/// Each name and value of the environment is read, or refused.
#[test]
fn settings_with_a_slip() {
    for (name, value, message) in [
        ("KARAT_FAILURES", "banana", "KARAT_FAILURES=banana isn't `on` or `off`"),
        ("KARAT_REQUIER", "vulkan", "did you mean `KARAT_REQUIRE`?"),
        ("KARAT_SEED", "1e9", "KARAT_SEED=1e9 isn't a number"),
        ("KARAT_DEADLINE", "soon", "KARAT_DEADLINE=soon isn't a number of seconds above 0"),
        ("KARAT_CASE", "id", "KARAT_CASE=id isn't a case, `function/check/index`"),
        ("KARAT_INPUT", "3f800000", "KARAT_INPUT needs KARAT_CASE"),
        ("KARAT_PATHS", "all,vulcan", "did you mean `vulkan`?"),
        ("KARAT_PATHS", "gl,gl", "KARAT_PATHS=gl,gl names `gl` twice"),
        ("KARAT_REQUIRE", "vulkan,", "there is no execution path ``"),
    ] {
        let (output, text) = planted(&["none"], &[(name, value)]);
        assert!(!output.status.success() && text.contains(message), "{name}={value}: {text}");
        let folder = tempfile::tempdir().expect("a temporary folder");
        let (passed, text) = golden_fault(folder.path(), &[(name, value)]);
        assert!(!passed && text.contains(message), "of a frame, {name}={value}: {text}");
    }
}

/// A fault that is seen on the last path alone is reduced on that path.
#[test]
fn a_fault_of_the_last_path_is_reduced_there() {
    let (output, text) = planted(&["one_path"], &[("KARAT_PATHS", "all")]);
    assert!(!output.status.success(), "{text}");
    let simplest = text.find("simplest (reduced from").expect("the worst case can be reduced");
    assert!(text[simplest..].contains("x = 1\n") && text[simplest..].contains("n = 3\n"), "{text}");
    let agree = text.matches("  all cases agree").count();
    let open = Path::ALL.into_iter().filter(|path| karat::path::adapter(*path).is_ok()).count();
    assert_eq!(agree, open - 1, "{text}");
}

/// The replay command runs the failing case alone, with the same inputs.
#[test]
fn replay() {
    let (_, text) = planted(&["too_large"], &[]);
    let line = text.lines().find_map(|line| line.trim().strip_prefix("replay: "));
    let words = line.expect("a failure says how to replay it").split(' ');
    let environment: Vec<(&str, &str)> = words.map_while(|word| word.split_once('=')).collect();
    assert_eq!(environment.len(), 3, "path, seed and case: {environment:?}");
    let (output, again) = planted(&["too_large"], &environment);
    assert!(!output.status.success(), "{again}");
    assert!(again.contains("1 of 1 cases fail"), "{again}");
    let worst = |text: &str| {
        let from = text.find("  worst (case").expect("a failure shows the worst case");
        text[from..].lines().take(6).collect::<Vec<_>>().join("\n")
    };
    assert_eq!(worst(&text), worst(&again));
    let (output, text) = planted(&["too_large"], &[("KARAT_CASE", "99999999")]);
    assert!(!output.status.success() && text.contains("none with index 99999999"), "{text}");
}

/// Mesa and the loader find no driver: what is required must run, and something must run at all.
#[test]
fn no_adapter() {
    let hidden = [
        ("VK_DRIVER_FILES", "/dev/null"),
        ("VK_ICD_FILENAMES", "/dev/null"),
        ("KARAT_REQUIRE", "vulkan"),
    ];
    let (output, text) = planted(&["none"], &hidden);
    assert!(!output.status.success(), "{text}");
    assert!(text.contains("execution path `vulkan` is required, but unavailable"), "{text}");
    let (output, text) = planted(&["none"], &[("KARAT_ADAPTER", "no such adapter")]);
    assert!(!output.status.success(), "{text}");
    assert!(text.contains("no execution path opens on this machine"), "{text}");
    let (output, text) = planted(&["none"], &[("KARAT_PATHS", "vulcan")]);
    assert!(!output.status.success() && text.contains("did you mean `vulkan`?"), "{text}");
}

/// A shader that never ends is reported within the deadline, and nothing stays behind.
#[test]
fn an_endless_loop() {
    let open = Path::ALL.into_iter().filter(|path| karat::path::adapter(*path).is_ok());
    let open: Vec<Path> = open.collect();
    assert!(!open.is_empty(), "no execution path opens, so nothing would be checked");
    for path in open {
        let start = Instant::now();
        let environment = [("KARAT_DEADLINE", "1.5"), ("KARAT_PATHS", path.name())];
        let (output, text) = planted(&["endless_loop"], &environment);
        assert!(!output.status.success(), "{text}");
        assert!(text.contains(&format!("`endless` on path {path}")), "{text}");
        assert!(text.contains("did not finish within 1.5 s"), "{text}");
        // Collecting its output has waited for the process: it is gone, not a zombie.
        assert!(start.elapsed() < Duration::from_secs(30), "on {path}: {:?}", start.elapsed());
    }
}

fn golden_fault(folder: &FilePath, environment: &[(&str, &str)]) -> (bool, String) {
    let folder = folder.display().to_string();
    let (output, text) = planted(&["golden", &folder], environment);
    (output.status.success(), text)
}

/// Renders, accepts, agrees; then the golden is damaged in each way there is.
#[test]
fn goldens_that_are_missing_shifted_resized_or_corrupt() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let golden = folder.path().join("gradient.exr");
    let pending = folder.path().join("gradient.new.exr");

    let (agrees, text) = golden_fault(folder.path(), &[]);
    assert!(!agrees && text.contains("has no golden"), "{text}");
    assert!(pending.is_file() && !golden.exists(), "only accepting writes a golden");

    let goldens = Goldens::open(folder.path());
    let accept = |because: &str| {
        let pending = goldens.select("gradient").expect("it is pending").frames;
        let because = because.to_owned();
        goldens
            .accept(&pending[0], &Acceptance { because, any_adapter: true, ..Default::default() })
    };
    assert!(accept(" ").is_err(), "a reason is needed");
    accept("the first one").expect("accepted");
    assert!(golden.is_file() && folder.path().join("gradient.toml").is_file() && !pending.exists());
    let (agrees, text) = golden_fault(folder.path(), &[]);
    assert!(agrees, "{text}");

    let (original, metadata) = Image::read_exr(&golden).expect("just written");
    let bytes = std::fs::read(&golden).expect("just written");
    let plant = |image: &Image| {
        image.write_exr(&golden, Precision::Half, metadata.as_deref()).expect("written");
        let planted = std::fs::read(&golden).expect("just written");
        let (agrees, text) = golden_fault(folder.path(), &[]);
        assert!(!agrees, "the fault was not seen: {text}");
        assert_eq!(std::fs::read(&golden).expect("there"), planted, "goldens aren't overwritten");
        text
    };

    let mut shifted = original.clone();
    shifted.pixels_mut().rotate_right(1);
    assert!(plant(&shifted).contains("pixels are off"));
    let mut one = original.clone();
    one.pixels_mut()[300][2] *= 1.01;
    assert!(plant(&one).contains("1 of 512 pixels are off by more than rel 1e-3"));
    let mut broken = original.clone();
    broken.pixels_mut()[0][0] = f32::NAN;
    assert!(plant(&broken).contains("the golden itself has 1 pixels with NaN"));
    let resized = Image::new(16, 32, original.pixels().to_vec());
    assert!(plant(&resized).contains("it is 32 x 16, the golden 16 x 32"));

    std::fs::write(&golden, &bytes[..bytes.len() / 2]).expect("written");
    let (agrees, text) = golden_fault(folder.path(), &[]);
    assert!(!agrees && text.contains("isn't a readable OpenEXR image"), "{text}");
    assert_eq!(std::fs::metadata(&golden).expect("there").len(), bytes.len() as u64 / 2);

    // The frame that was pending was compared with another golden than this one.
    plant(&shifted);
    original.write_exr(&golden, Precision::Half, metadata.as_deref()).expect("written");
    assert!(accept("stale").is_err_and(|error| error.to_string().contains("has changed since")));
}

/// A frame with NaN is never right: not as a frame, and not as a golden.
#[test]
fn a_frame_with_nan_is_not_accepted() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let folder_name = folder.path().display().to_string();
    let (output, text) = planted(&["nan_frame", &folder_name], &[]);
    assert!(!output.status.success() && text.contains("512 pixels with NaN"), "{text}");
    let goldens = Goldens::open(folder.path());
    let pending = goldens.select("gradient").expect("it is pending").frames;
    let acceptance =
        Acceptance { because: "why".to_owned(), any_adapter: true, ..Default::default() };
    let error = goldens.accept(&pending[0], &acceptance).expect_err("it has NaN");
    assert!(error.to_string().contains("nothing could ever agree with it"), "{error}");
}

/// In CI nothing is written beside the goldens.
#[test]
fn ci_leaves_the_folder_of_goldens_alone() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (agrees, text) = golden_fault(folder.path(), &[("CI", "true")]);
    assert!(!agrees && text.contains("has no golden"), "{text}");
    assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 0);
    assert!(text.contains("gradient.new.exr"), "the pending file is named: {text}");
    assert!(text.contains(" --from "), "the command finds it there: {text}");
    let (_, text) = golden_fault(folder.path(), &[("CI", "false")]);
    assert!(
        !text.contains(" --from ") && folder.path().join("gradient.new.exr").is_file(),
        "{text}"
    );
}

/// A golden that wasn't rendered on lavapipe would fail on every other machine.
#[test]
fn accepting_off_the_canonical_rasteriser_is_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (_, text) = golden_fault(folder.path(), &[("KARAT_PATHS", "gl")]);
    assert!(text.contains("has no golden"), "{text}");
    let goldens = Goldens::open(folder.path());
    let pending = goldens.select_by("*", |_| true).expect("it is pending").frames;
    let acceptance = Acceptance { because: "why".to_owned(), ..Default::default() };
    let error = goldens.accept(&pending[0], &acceptance).expect_err("rendered on GL");
    assert!(error.to_string().contains("goldens are made on lavapipe"), "{error}");
}

/// A rasteriser with other vectors, as another machine has: the golden holds there, too.
#[test]
fn a_golden_holds_at_another_vector_width() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (_, text) = golden_fault(folder.path(), &[]);
    assert!(text.contains("has no golden"), "{text}");
    let goldens = Goldens::open(folder.path());
    let pending = goldens.select("gradient").expect("it is pending").frames;
    let acceptance =
        Acceptance { because: "why".to_owned(), any_adapter: true, ..Acceptance::default() };
    goldens.accept(&pending[0], &acceptance).expect("accepted");
    let open = Path::ALL.into_iter().find_map(|path| karat::path::adapter(path).ok());
    let narrow = [("LP_NATIVE_VECTOR_WIDTH", "128")];
    let (agrees, text) = golden_fault(folder.path(), &narrow);
    assert!(agrees, "{text}");
    // That the variable works shows in the name of the adapter, which a frame that is new has.
    let other = tempfile::tempdir().expect("a temporary folder");
    golden_fault(other.path(), &narrow);
    let pending = Goldens::open(other.path()).select("gradient").expect("it is pending").frames;
    let name = &pending[0].provenance.adapter.name;
    let lavapipe = open.is_some_and(|adapter| adapter.name.contains("llvmpipe"));
    assert!(!lavapipe || name.contains("128 bits"), "{name}");
}

/// Results of software rasterisers depend on their vector width and on the processor.
#[test]
fn a_golden_says_what_it_was_made_on() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (_, text) = golden_fault(folder.path(), &[]);
    assert!(text.contains("has no golden"), "{text}");
    let goldens = Goldens::open(folder.path());
    let pending = goldens.select("gradient").expect("it is pending").frames;
    let acceptance =
        Acceptance { because: "why".to_owned(), any_adapter: true, ..Default::default() };
    goldens.accept(&pending[0], &acceptance).expect("accepted");
    let toml = std::fs::read_to_string(folder.path().join("gradient.toml")).expect("written");
    let adapter = Path::ALL.into_iter().find_map(|path| karat::path::adapter(path).ok());
    let adapter = adapter.expect("the frame was rendered on the first path that opens");
    assert!(toml.contains(&adapter.name) && toml.contains(&adapter.driver), "{toml}");
    assert!(!adapter.name.contains("llvmpipe") || adapter.name.contains(" bits)"), "{adapter}");
    let processor = toml.lines().find_map(|line| line.strip_prefix("processor = "));
    assert!(processor.is_some_and(|name| name.len() > 2), "{toml}");
}

/// The midpoint rule in the squared sine and the azimuth, where the cosine is in the measure: the
/// directions of a hemisphere about +Z and the weights of an integral of `f cos`.
fn hemisphere(size: u16) -> Vec<(Vec3, f64)> {
    let at = |index: u16| (f64::from(index) + 0.5) / f64::from(size);
    let node = |row: u16, column: u16| {
        let (sine_squared, azimuth) = (at(row), TAU * at(column));
        let (sine, cosine) = (sine_squared.sqrt(), (1.0 - sine_squared).sqrt());
        let l = DVec3::new(sine * azimuth.cos(), sine * azimuth.sin(), cosine);
        (l.as_vec3(), PI / (f64::from(size) * f64::from(size)))
    };
    (0..size).flat_map(|row| (0..size).map(move |column| node(row, column))).collect()
}

/// A diffuse BRDF whose factor is planted.
fn diffuse(factor: &str) -> Package {
    let wgsl = format!(
        "fn eval(albedo: vec3f, l: vec3f) -> vec3f {{ return albedo * select(0.0, {factor}, l.z > 0.0); }}"
    );
    Package::from_modules("planted", [("brdf", wgsl)])
}

fn albedo_rule(albedo: &Vec3) -> Vec<((Vec3, Vec3), f64)> {
    hemisphere(16).into_iter().map(|(l, weight)| ((*albedo, l), weight)).collect()
}

/// Rounding of `albedo / pi` and of the planted constant: two steps of `f32`.
const ALBEDO: Rel = Rel(1.2e-7);

#[test]
fn an_integral_that_is_right() {
    let package = diffuse("0.318309886");
    let integral = || package.function("brdf::eval").integral(UnitRgb, albedo_rule);
    let agreement = integral().agrees_with(|albedo| albedo.as_dvec3(), ALBEDO);
    assert_eq!(agreement.cases, 256);
    let agreement = integral().cases(1000).try_is_at_most(|_| 1.0, 1.2e-7);
    assert_eq!(agreement.expect("no albedo is above 1").cases, 1000);
    let cases = OneOf(vec![Vec3::ZERO, Vec3::splat(0.5), Vec3::ONE]);
    let finite = package.function("brdf::eval").integral(cases, albedo_rule);
    let agreement = finite.try_is_at_most(|albedo| albedo.as_dvec3(), 1.2e-7);
    assert_eq!(agreement.expect("each value of a finite domain").cases, 3);
}

/// A third in place of 1/pi makes every albedo pi/3 times as large.
#[test]
fn a_wrong_constant_in_an_integral() {
    let package = diffuse("0.33333334");
    let over = |cases| package.function("brdf::eval").integral(OneOf(cases), albedo_rule);
    let found = over([0.0, 0.25, 0.5, 0.75, 1.0].map(Vec3::splat).to_vec());
    let found = disagreement(found.try_agrees_with(|albedo| albedo.as_dvec3(), ALBEDO));
    assert_eq!((found.check, &*found.assertion), ("integral.agrees_with", "rel 1.2e-7"));
    for path in &found.paths {
        assert_eq!((path.census.cases, path.census.failures, path.census.too_high), (5, 4, 4));
        assert!(path.replay.contains("KARAT_CASE=brdf::eval/integral.agrees_with/"), "{found}");
    }
    let found = over(vec![Vec3::new(0.0, 0.0, 0.75)]);
    let found = disagreement(found.try_agrees_with(|albedo| albedo.as_dvec3(), ALBEDO));
    for path in &found.paths {
        let integral = path.worst.integral.as_ref().expect("the check is one of integrals");
        assert_eq!((&*path.worst.component, integral.nodes), (".z", 256));
        assert!((integral.value - 0.25 * PI).abs() < 1e-7, "{found}");
    }
    let text = found.to_string();
    for part in [
        "error: `brdf::eval` fails integral.agrees_with: rel 1.2e-7",
        "  1 of 1 cases fail (100.000%), 1 too high\n  worst (case 0)\n        \
         case = Vec3(0.0, 0.0, 0.75)\n    integral = (0, 0, 0.785398",
        ")  over 256 nodes\n      actual = 0.785398",
        "  at .z\n    expected = 0.75\n       error = rel 0.0472 (1.20e-7 allowed)\n  replay: KARAT",
    ] {
        assert!(text.contains(part), "`{part}` is missing in:\n{text}");
    }
}

#[test]
fn an_integral_above_its_bound() {
    let package = diffuse("0.33333334");
    let integral = || package.function("brdf::eval").integral(Just(Vec3::splat(0.75)), albedo_rule);
    let found = disagreement(integral().try_is_at_most(|_| 0.75, 0.03));
    assert_eq!(
        (found.check, &*found.assertion),
        ("integral.is_at_most", "its bound, slack abs 3e-2")
    );
    let text = found.to_string();
    let part = "at most = 0.75\n       error = abs 0.0354 (0.03 allowed)";
    assert!(text.contains(part), "`{part}` is missing in:\n{text}");
    integral().try_is_at_most(|_| 0.75, 0.036).expect("the excess is 0.0354");
    integral().try_is_at_most(|_| 0.786, 0.0).expect("the bound is larger");
    // A bound for each component: only that of the last one is exceeded.
    let found = disagreement(integral().try_is_at_most(|_| DVec3::new(1.0, 1.0, 0.7), 0.0));
    assert!(found.paths.iter().all(|path| path.worst.component == ".z"), "{found}");
    // Exactly the bound: each term and their sum are powers of two.
    let package = diffuse("0.5");
    let four = |albedo: &Vec3| vec![((*albedo, Vec3::Z), 0.5); 4];
    let integral = || package.function("brdf::eval").integral(Just(Vec3::splat(0.25)), four);
    integral().try_is_at_most(|_| 0.25, 0.0).expect("the integral is the bound");
    disagreement(integral().try_is_at_most(|_| 0.25_f64.next_down(), 0.0));
}

/// 100,000 nodes in two dispatches, one of which gives NaN or an infinity, at any weight.
#[test]
fn one_bad_node_of_an_integral() {
    for (bits, nan, infinite) in [("0x7fc00000u", 3, 0), ("0xff800000u", 0, 3)] {
        let wgsl = format!(
            "fn f(i: u32, bad: u32) -> f32 {{ return select(1.0, bitcast<f32>(i - bad + {bits}), \
             i == bad); }}"
        );
        let package = Package::from_source("planted", wgsl);
        for weight in [1e-5, 0.0, -1e-5] {
            let bad = OneOf(vec![0_u32, 99_999, 70_000, 100_000]);
            let rule = move |bad: &u32| (0..100_000_u32).map(|i| ((i, *bad), weight)).collect();
            let integral = || package.function("f").integral(bad.clone(), rule);
            let loosest = Abs(1e300).or(Rel(1e300));
            let found = [
                disagreement(integral().try_agrees_with(|_| 1.0, loosest)),
                disagreement(integral().try_is_at_most(|_| 1e300, 1e300)),
            ];
            for path in found.iter().flat_map(|found| &found.paths) {
                assert_eq!((path.census.cases, path.census.failures), (4, 3));
                assert_eq!((path.census.nan, path.census.infinite), (nan, infinite));
                assert_eq!((path.worst.case, path.first.is_none()), (0, true));
            }
        }
        let one = package.function("f").integral(Just(70_000_u32), |bad| {
            (0..100_000_u32).map(|i| ((i, *bad), 0.25)).collect()
        });
        let text = disagreement(one.try_is_at_most(|_| 1e300, 0.0)).to_string();
        let value = if nan > 0 { "NaN" } else { "-inf" };
        let part = format!(
            "        case = 70000\n    integral = {value}  over 100000 nodes\n        node = 70000: \
             i = 70000, bad = 70000 (weight 0.25)\n    returned = {value}\n     at most = 1e300\n"
        );
        assert!(text.contains(&part), "`{part}` is missing in:\n{text}");
    }
}

/// A rule without nodes, with weights that aren't numbers, and expectations that aren't.
#[test]
fn an_integral_of_nothing() {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return x; }");
    let rule = |bad: Option<f64>| {
        move |case: &f32| -> Vec<(f32, f64)> {
            match bad {
                None if *case > 0.5 => Vec::new(),
                Some(weight) if *case > 0.5 => vec![(*case, 0.5), (*case, weight)],
                _ => vec![(*case, 1.0)],
            }
        }
    };
    let integral = |bad| package.function("f").integral(Grid::linear(0.0..=1.0, 5), rule(bad));
    let refused = |found: Result<karat::check::Agreement, Failure>| match found {
        Err(failure @ Failure::Rule { .. }) => failure.to_string(),
        other => panic!("the rule was not refused: {other:?}"),
    };
    let empty = "the quadrature rule of `f` has no nodes, so nothing would be integrated, for case \
                 3: 0.75";
    assert_eq!(refused(integral(None).try_agrees_with(|x| f64::from(*x), Abs(1e300))), empty);
    assert_eq!(refused(integral(None).try_is_at_most(|_| 1e300, 1e300)), empty);
    for weight in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let text = refused(integral(Some(weight)).try_is_at_most(|_| 1e300, 1e300));
        let expected = format!(
            "the quadrature rule of `f` has the weight {weight} at node 1 for case 3: 0.75"
        );
        assert_eq!(text, expected);
    }

    let whole = || package.function("f").integral(0.0..=1.0_f32, |x| vec![(*x, 1.0)]);
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let found =
            [whole().try_agrees_with(|_| value, Abs(1.0)), whole().try_is_at_most(|_| value, 1.0)];
        assert!(found.iter().all(|f| matches!(f, Err(Failure::Reference { .. }))), "{found:?}");
    }
    for bound in [f64::NAN, f64::INFINITY, -1.0] {
        let found =
            [whole().try_agrees_with(|_| 0.5, Abs(bound)), whole().try_is_at_most(|_| 0.5, bound)];
        assert!(found.iter().all(|f| matches!(f, Err(Failure::Signature { .. }))), "{found:?}");
    }
    let none = [
        whole().cases(0).try_is_at_most(|_| 1.0, 0.0),
        package
            .function("f")
            .integral(OneOf::<f32>(vec![]), |x| vec![(*x, 1.0)])
            .try_is_at_most(|_| 1.0, 0.0),
        package
            .function("f")
            .integral((0.0..=1.0).filter(|_: &f32| false), |x| vec![(*x, 1.0)])
            .try_is_at_most(|_| 1.0, 0.0),
    ];
    assert!(none.iter().all(|found| matches!(found, Err(Failure::Domain { .. }))), "{none:?}");
}

#[test]
fn an_integral_of_other_types() {
    let wgsl =
        "fn f(x: f32, n: u32) -> vec2f { return vec2f(x); } fn g(n: u32) -> u32 { return n; }";
    let package = Package::from_source("planted", wgsl);
    let right = |x: &f32| vec![((*x, 7_u32), 1.0)];
    let whole = || package.function("f").integral(0.0..=1.0_f32, right);
    let found = [
        package
            .function("f")
            .integral(0.0..=1.0_f32, |x| vec![(*x, 1.0)])
            .try_is_at_most(|_| 1.0, 0.0),
        whole().try_agrees_with(|_| 1.0, Abs(1.0)),
        whole().try_is_at_most(|_| DVec3::ONE, 0.0),
        whole().try_agrees_with(
            |x| glam::DVec2::splat(f64::from(*x)),
            Tolerance::per_lane([Abs(1.0).into()]),
        ),
        package
            .function("g")
            .integral(Just(7_u32), |n| vec![(*n, 1.0)])
            .try_agrees_with(|n| *n, Abs(1.0)),
    ];
    let expected = [
        "takes (f32, u32), the quadrature rule supplies (f32)\n",
        "returns vec2<f32>, the expected integral is f32\n",
        "returns vec2<f32>, the bound is vec3<f32>\n",
        "returns 2 components, the tolerance is declared for 1\n",
        "returns u32, and an integral is a sum of floats\n",
    ];
    for (found, expected) in found.into_iter().zip(expected) {
        match found {
            Err(failure @ Failure::Signature { .. }) => {
                assert!(failure.to_string().contains(expected), "{failure}");
            }
            other => panic!("not a mismatch of signatures: {other:?}"),
        }
    }
    whole().try_is_at_most(|_| 1.0, 0.0).expect("a bound for both components");
}

/// The replay command takes the failing integral alone; the record counts integrals and nodes.
#[test]
fn an_integral_is_replayed_and_recorded() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let folder_name = folder.path().display().to_string();
    let (output, text) = planted(&["integral"], &[("KARAT_RECORD", &folder_name)]);
    assert!(!output.status.success(), "{text}");
    let records = karat::record::read(folder.path()).expect("the verdict was recorded");
    let [record] = &*records else { panic!("one check, {} records", records.len()) };
    assert_eq!(record.verdict, karat::record::Verdict::Fail);
    for path in &record.paths {
        assert_eq!((path.cases, &*path.asserted), (256, "rel 1e-6 (2560 nodes)"));
        assert!(0 < path.failures && path.failures < 256, "{path:?}");
    }
    let line = text.lines().find_map(|line| line.trim().strip_prefix("replay: "));
    let words = line.expect("a failure says how to replay it").split(' ');
    let environment: Vec<(&str, &str)> = words.map_while(|word| word.split_once('=')).collect();
    let (output, again) = planted(&["integral"], &environment);
    assert!(!output.status.success() && again.contains("1 of 1 cases fail"), "{again}");
    let worst = |text: &str| {
        let from = text.find("  worst (case").expect("a failure shows the worst case");
        text[from..].lines().take(6).collect::<Vec<_>>().join("\n")
    };
    assert_eq!(worst(&text), worst(&again));
}

/// The paths on which a function that is wrong everywhere is checked.
fn selected() -> Vec<Path> {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return x + 1.0; }");
    let found =
        disagreement(package.function("f").over(0.0..=1.0).try_agrees_with(|x: f64| x, Abs(0.5)));
    let paths = found.paths.iter().map(|path| path.adapter.path.parse());
    paths.collect::<Result<_, _>>().expect("a path has its own name")
}

/// What is declared to fail, fails, and isn't counted among the paths that agree.
#[test]
fn a_known_issue_is_no_agreement() {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return x + 1.0; }");
    let over = || package.function("f").over(0.0..=1.0);
    let paths = selected();
    let everywhere = paths.iter().fold(over(), |check, path| check.fails_on(*path, "bug 1"));
    let agreement = everywhere.try_agrees_with(|x: f64| x, Abs(0.5)).expect("it fails as declared");
    assert!(agreement.paths.is_empty(), "{agreement}");
    assert_eq!(agreement.known_issues.len(), paths.len());
    for issue in &agreement.known_issues {
        assert_eq!((&*issue.reason, issue.cases, issue.failures), ("bug 1", 65_536, 65_536));
    }
    assert!(agreement.to_string().contains("fails 65536 as declared: bug 1"), "{agreement}");
    // Other paths are judged as ever.
    for path in &paths {
        let found = over().fails_on(*path, "bug 1").try_agrees_with(|x: f64| x, Abs(0.5));
        if paths.len() == 1 {
            assert!(found.is_ok(), "{found:?}");
            continue;
        }
        let found = disagreement(found);
        assert_eq!(found.paths.len(), paths.len() - 1);
        assert!(found.paths.iter().all(|other| other.adapter.path != path.name()), "{found}");
    }
}

#[test]
fn an_issue_that_is_gone_or_has_no_reason() {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return x; }");
    let path = selected()[0];
    let over = || package.function("f").over(0.0..=1.0);
    let found = over().fails_on(path, "bug 1").try_agrees_with(|x: f64| x, Ulp(0.0));
    let text = found.expect_err("it passes").to_string();
    let expected = format!(
        "`f` passes on {path}, where it is declared to fail: bug 1\n\
         the bug is gone, or hidden: remove `.fails_on(...)`"
    );
    assert_eq!(text, expected);
    for reason in ["", " "] {
        let found = over().fails_on(path, reason).try_satisfies("is not", |_, _: f32| false);
        let text = found.expect_err("no reason").to_string();
        let expected = format!("`f` is declared to fail on {path} without a reason: name the bug");
        assert_eq!(text, expected);
    }
    let integral = package.function("f").integral(0.0..=1.0_f32, |x| vec![(*x, 1.0)]);
    let found = integral.fails_on(path, "bug 1").try_is_at_most(|_| 1.0, 0.0);
    assert!(matches!(found, Err(Failure::UnexpectedPass { .. })), "{found:?}");
}

/// A frame that is declared to differ from its golden must differ, and no declaration makes up for
/// a golden that is missing.
#[test]
fn a_frame_that_is_declared_to_fail() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let goldens = Goldens::open(folder.path());
    let pictures = Package::from_source("gradient", include_str!("planted/gradient.wgsl"));
    let frame = || pictures.frame("", 32, 16).fullscreen("corners", "gradient").tolerance(1e-3);
    let paths = selected();
    let declared = || paths.iter().fold(frame(), |frame, path| frame.fails_on(*path, "bug 1"));
    let error = declared().try_matches(&goldens, "gradient").expect_err("no golden");
    assert!(error.to_string().contains("has no golden"), "{error}");
    let golden = folder.path().join("gradient.exr");
    let mut image = frame().render(paths[0]).expect("rendered");
    image.write_exr(&golden, Precision::Half, None).expect("written");
    let error = declared().try_matches(&goldens, "gradient").expect_err("it matches");
    assert!(error.to_string().contains("where it is declared to fail: bug 1"), "{error}");
    let error = frame().fails_on(paths[0], "").try_matches(&goldens, "gradient");
    assert!(error.expect_err("no reason").to_string().contains("without a reason"));

    // Another size and NaN are other bugs than the one that is known.
    let mut small = pictures.frame("", 16, 16).fullscreen("corners", "gradient");
    small = paths.iter().fold(small, |frame, path| frame.fails_on(*path, "bug 1"));
    let error = small.try_matches(&goldens, "gradient").expect_err("another size");
    assert!(matches!(error, karat::frame::FrameError::Golden { .. }), "{error}");
    // Not a constant: WGSL refuses those.
    let nan = include_str!("planted/gradient.wgsl").replace("0.5, 1.0)", "sqrt(-at.x), 1.0)");
    let nan = Package::from_source("gradient", nan);
    let nan = nan.frame("", 32, 16).fullscreen("corners", "gradient").tolerance(1e-3);
    let nan = paths.iter().fold(nan, |frame, path| frame.fails_on(*path, "bug 1"));
    let error = nan.try_matches(&goldens, "gradient").expect_err("NaN");
    assert!(matches!(error, karat::frame::FrameError::Golden { .. }), "{error}");

    image.pixels_mut()[300][2] *= 1.01;
    image.write_exr(&golden, Precision::Half, None).expect("written");
    let agreement = declared().try_matches(&goldens, "gradient").expect("it fails as declared");
    assert!(agreement.paths.is_empty());
    assert!(agreement.known_issues.iter().all(|issue| (issue.cases, issue.failures) == (512, 1)));
}

/// Samples and means may be declared to fail, and have to, then.
#[test]
fn samples_and_means_that_are_declared_to_fail() {
    let wgsl = "fn same(u: f32) -> f32 { return u; }\nfn squared(u: f32) -> f32 { return u * u; }\n\
                fn one(x: f32) -> f32 { return 1.0; }";
    let package = Package::from_source("planted", wgsl);
    let paths = selected();
    let declared = |sampler: &str, reason: &str| {
        let samples = package.function(sampler).sampled_over(Just(()), |(), u: f32| u);
        let samples = samples.on(Support::Interval(0.0, 1.0)).samples(16_384);
        let samples = paths.iter().fold(samples, |samples, path| samples.fails_on(*path, reason));
        samples.try_follows(package.function("one"), |(), x: f32| x)
    };
    let fit = declared("squared", "bug 1").expect("it fails as declared");
    assert_eq!((fit.paths.len(), fit.known_issues.len()), (0, paths.len()));
    let failure = declared("same", "bug 1").expect_err("it passes").to_string();
    assert!(failure.contains("where it is declared to fail: bug 1"), "{failure}");
    let failure = declared("squared", " ").expect_err("no reason").to_string();
    assert!(failure.contains("without a reason"), "{failure}");

    let pictures = Package::from_source("gradient", include_str!("planted/gradient.wgsl"));
    let frame = || pictures.frame("", 32, 16).fullscreen("corners", "gradient");
    let frame = paths.iter().fold(frame(), |frame, path| frame.fails_on(*path, "bug 1"));
    let whole = karat::metric::Rect { left: 0, top: 0, width: 32, height: 16 };
    let mean = frame.try_expect_mean(whole, [9.0; 3], Abs(0.1)).expect("it fails as declared");
    assert_eq!((mean.paths.len(), mean.known_issues.len()), (0, paths.len()));
    let error = frame.try_expect_mean(whole, [0.0; 3], Abs(9.0)).expect_err("it is right");
    assert!(error.to_string().contains("where it is declared to fail: bug 1"), "{error}");
}

/// Where every result may be flushed to 0, and its reference, too, nothing is compared.
#[test]
fn results_that_may_all_be_flushed() {
    let package = Package::from_source("s", "fn f(d: f32) -> f32 { return exp(-2.0 * d); }");
    let check = |low: f32, tolerance: Tolerance| {
        let check = package.function("f").over(low..=200.0);
        check.try_agrees_with(|d: f64| (-d).exp(), tolerance)
    };
    for tolerance in [Rel(1e-3).into(), Ulp(4.0).into()] {
        let failure = check(90.0, tolerance).expect_err("nothing is compared").to_string();
        assert!(failure.contains("below the least normal f32"), "{failure}");
    }
    assert!(matches!(check(0.5, Rel(1e-3).into()), Err(Failure::Disagreement(_))));
}

/// A tolerance that no change exceeds says nothing of a direction.
#[test]
fn changes_within_the_tolerance() {
    let package = Package::from_source("s", "fn f(x: f32) -> f32 { return x * x; }");
    let check = |tolerance: f64| {
        let check = package.function("f").over(-1.0..=1.0);
        check.try_is_monotone_in("x", Trend::Increasing, Abs(tolerance))
    };
    let failure = check(5.0).expect_err("nothing is compared").to_string();
    assert!(failure.contains("by more than the tolerance"), "{failure}");
    assert!(matches!(check(0.1), Err(Failure::Disagreement(_))));
}

/// The record says what is known, and doesn't call it a pass.
#[test]
fn known_issues_are_recorded() {
    for (fault, verdict) in [
        ("known_issue", karat::record::Verdict::KnownIssue),
        ("unexpected_pass", karat::record::Verdict::Fail),
    ] {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let folder_name = folder.path().display().to_string();
        let (output, text) = planted(&[fault], &[("KARAT_RECORD", &folder_name)]);
        assert_eq!(
            output.status.success(),
            verdict == karat::record::Verdict::KnownIssue,
            "{text}"
        );
        let records = karat::record::read(folder.path()).expect("the verdict was recorded");
        let [record] = &*records else { panic!("one check, {} records", records.len()) };
        assert_eq!(record.verdict, verdict);
        for path in &record.paths {
            assert_eq!(path.known_issue.as_deref(), Some("bug 1234"));
            assert_eq!(path.failures > 0, fault == "known_issue");
        }
    }
}

/// Every verdict under an overlay says so in the record: of values, samples and frames.
#[test]
fn records_name_the_overlay() {
    let (folder, overlay) = (tempfile::tempdir(), tempfile::tempdir());
    let [folder, overlay] = [folder, overlay].map(|folder| folder.expect("a temporary folder"));
    let names = [&folder, &overlay].map(|folder| folder.path().display().to_string());
    for named in [None, Some(&*names[1])] {
        let mut environment = vec![("KARAT_RECORD", &*names[0])];
        environment.extend(named.map(|overlay| ("KARAT_OVERLAY", overlay)));
        let (output, text) = planted(&["records"], &environment);
        assert!(output.status.success(), "{text}");
        let records = karat::record::read(folder.path()).expect("the verdicts were recorded");
        let own: Vec<_> = records.iter().filter(|r| r.overlay.as_deref() == named).collect();
        assert_eq!(own.len(), 3, "{records:?}");
    }
}

/// A path's own tolerance is its own, and as strict as any.
#[test]
fn a_tolerance_of_one_path() {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return x + 0.25; }");
    let over = || package.function("f").over(0.0..=1.0);
    let paths = selected();
    let loose = paths.iter().fold(over(), |check, path| check.tolerance_on(*path, Abs(0.26)));
    loose.clone().try_agrees_with(|x: f64| x, Ulp(1.0)).expect("each path has its own");
    let halves = loose.try_invariant_under(|x| 0.5 * x, Ulp(1.0));
    assert!(halves.is_err(), "the difference is up to 0.5");
    for path in &paths {
        let strict = over().tolerance_on(*path, Abs(0.24)).try_agrees_with(|x: f64| x, Abs(0.26));
        let found = disagreement(strict);
        assert!(found.paths.iter().all(|other| other.adapter.path == path.name()), "{found}");
        let refused = [
            over().tolerance_on(*path, Abs(f64::NAN)).try_agrees_with(|x: f64| x, Abs(1.0)),
            over().tolerance_on(*path, Abs(1.0)).try_satisfies("is anything", |_, _: f32| true),
        ];
        for found in refused {
            assert!(matches!(found, Err(Failure::Signature { .. })), "{found:?}");
        }
    }
}

/// A bump of a hundredth of the range, a slope of the wrong sign, NaN.
#[test]
fn a_function_that_is_not_monotone() {
    let check = |body: &str, direction, tolerance: Tolerance| {
        let wgsl = format!("fn f(k: vec2f, x: f32, n: u32) -> vec2f {{ return {body}; }}");
        let package = Package::from_source("planted", wgsl);
        let pairs = (-1.0..=1.0_f32, -1.0..=1.0_f32).map(|(x, y)| glam::Vec2::new(x, y));
        let over = package.function("f").over((pairs, 0.0..=1.0, Integers(0..=9_u32)));
        over.try_is_monotone_in("x", direction, tolerance)
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

#[test]
fn a_monotone_check_of_nothing() {
    let wgsl = "fn f(alpha: f32, c: f32, d: vec3f) -> f32 { return c; }";
    let package = Package::from_source("planted", wgsl);
    let over = || package.function("f").over((0.0..=1.0, Just(0.5), UnitVector));
    let up = Trend::Increasing;
    let vacuous = [
        (over().try_is_monotone_in("alpha", up, Ulp(0.0)), "no case whose result changes"),
        (over().try_is_monotone_in(1, up, Ulp(0.0)), "has one value of argument 1 only"),
    ];
    for (found, message) in vacuous {
        assert!(matches!(found, Err(Failure::Domain { .. })), "{found:?}");
        assert!(found.expect_err("nothing").to_string().contains(message), "{message}");
    }
    let unknown = [
        (over().try_is_monotone_in("alhpa", up, Ulp(0.0)), "did you mean `alpha`?"),
        (over().try_is_monotone_in(3, up, Ulp(0.0)), "has 3 parameters, none at place 3"),
        (over().try_is_monotone_in("d", up, Ulp(0.0)), "which isn't one number"),
        (over().try_is_monotone_in("c", up, Ulp(f64::NAN)), "bounds nothing"),
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
        // The reference is given the limit, not what the domain draws.
        let limit = |x: f64, alpha: f64| x + alpha;
        over.try_at_limit("alpha", Limit::toward(0.0, steps), limit, Abs(2e-3))
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
        package.function("f").over((UnitVector, UnitVector)).try_equivariant_under(
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
    let fault = over().try_equivariant_under(|n, q| angle(q, n), |z: f32, _| z.into(), Abs(0.1));
    disagreement(fault);
    let nothing = over().try_equivariant_under(|n, _| n, |z: f32, _| z.into(), Abs(1e300));
    assert!(matches!(nothing, Err(Failure::Domain { .. })), "{nothing:?}");
}

/// A wrong constant; a lobe that falls between the rings, where no rule tells the integral.
#[test]
fn an_integral_over_directions() {
    let check = |body: &str, directions, expected: f64| {
        let wgsl = format!("fn f(k: f32, l: vec3f) -> f32 {{ return k * {body}; }}");
        let package = Package::from_source("planted", wgsl);
        let over = package.function("f").over(0.0..=2.0).cases(16);
        let integral =
            over.clone().try_integrates_to_at_most(directions, |k| f64::from(*k) * expected, 1e-6);
        let equal = over.try_integrates_to(directions, |k| f64::from(*k) * expected, Abs(1e-6));
        (equal, integral)
    };
    let agrees = |(equal, below): (
        Result<karat::check::Agreement, _>,
        Result<karat::check::Agreement, _>,
    )| {
        assert_eq!(equal.expect("it is right").cases, 16);
        assert_eq!(below.expect("it is right").cases, 16);
    };
    agrees(check("max(l.z, 0.0) / radians(180.0)", Directions::hemisphere(), 1.0));
    agrees(check("1.0 / radians(180.0)", Directions::projected_hemisphere(), 1.0));
    agrees(check("l.z * l.z / radians(240.0)", Directions::sphere().rings(8), 1.0));
    let (equal, below) = check("1.001 * l.z / radians(180.0)", Directions::hemisphere(), 1.0);
    assert!(disagreement(equal).paths.iter().all(|path| path.census.too_high > 0));
    disagreement(below);
    let (equal, below) = check("0.999 * l.z / radians(180.0)", Directions::hemisphere(), 1.0);
    disagreement(equal);
    below.expect("it is less");
    // Both rules are far from what is expected, and farther than from each other: a failure, which
    // shows both.
    let lobe = "1e5 * exp(1e3 * (l.z - 1.0))";
    let coarse = Directions::hemisphere().rings(32);
    for found in <[_; 2]>::from(check(lobe, coarse, 1.0)) {
        let found = disagreement(found);
        for path in &found.paths {
            let integral = path.worst.integral.as_ref().expect("an integral");
            let expected = path.worst.expected.expect("a number");
            let (control, nodes) = integral.control.expect("the rules differ");
            assert!(integral.value > 500.0 * expected && expected > 0.0, "{found}");
            assert!(control > 300.0 * expected && nodes == 2 * 24 * 24, "{found}");
        }
        assert!(found.to_string().contains("     control = "), "{found}");
    }
    // What fails is a verdict, although other cases have none.
    let mixed =
        "select(2.0 * l.z / radians(180.0), exp(1e3 * (l.z - 1.0)) / 6.2831853e-3, k < 1.0)";
    for found in <[_; 2]>::from(check(mixed, coarse, 1.0)) {
        let found = disagreement(found);
        for path in &found.paths {
            assert!((1..16).contains(&path.census.failures), "{found}");
            let value = path.worst.integral.as_ref().expect("an integral").value;
            assert!((value / path.worst.expected.expect("a number") - 2.0).abs() < 1e-4, "{found}");
        }
    }
    for found in <[_; 2]>::from(check("exp(1e3 * (l.x - 1.0))", Directions::sphere(), 6.283e-3)) {
        let error = found.expect_err("a lobe of 0.03 between rings of 0.05");
        assert!(matches!(error, Failure::Rule { .. }), "{error}");
        assert!(
            error.to_string().contains("so that neither is a verdict: use more rings"),
            "{error}"
        );
    }
    let (equal, _) = check("sqrt(l.z)", Directions::sphere(), 1.0);
    assert!(disagreement(equal).paths.iter().all(|path| path.census.nan > 0));
    // No arguments but the direction.
    let package = Package::from_source("planted", "fn f(l: vec3f) -> f32 { return 0.25; }");
    let found =
        package.function("f").over(()).try_integrates_to(Directions::sphere(), |()| PI, Rel(1e-6));
    assert_eq!(found.expect("a quarter of 4 pi").cases, 1);
}
