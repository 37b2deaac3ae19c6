//! Tests that each check compares as much as it claims, and that Karat refuses checks that can't fail.

use std::collections::HashSet;
use std::sync::Mutex;

use karat::Path;
use karat::check::Failure;
use karat::compute::ComputeError;
use karat::draw::Mesh;
use karat::golden::FrameTolerance;
use karat::image::Precision;
use karat::prelude::*;
use karat::{Goldens, Image};
use karat_inspect::compare::{Change, Request};

use crate::disagreement;

fn package(text: &str) -> Package {
    Package::from_source("weaker", text)
}

/// The function rises, except for steps down over distances of at most 2e-5. The check finds them only if it compares
/// arguments that are very close to each other.
// Lesson 177
#[test]
fn a_function_that_falls_in_short_steps() {
    let text = "fn f(x: f32) -> f32 { return x - 2e-5 * f32(u32(x * 65536.0) & 1u); }";
    let rises = |seed: u64| {
        let check = package(text);
        let check = check.function("f").over(0.0..=1.0).seed(seed).cases(65_536);
        check.unrecorded().try_is_monotone_in("x", Trend::Increasing, Abs(1e-6))
    };
    for path in disagreement(rises(1)).paths {
        // The function falls only over steps of 2e-5 or less. The nearest of 32 samples is rarely that near: in one of
        // 2,000 pairs.
        let share = path.census.failures * 200;
        assert!(share > path.census.cases, "{} of {}", path.census.failures, path.census.cases);
    }
}

/// Karat computes each integral by two quadrature rules. Here, the rules agree in the first component of the result,
/// but not in the second, so the check has no verdict.
// Lesson 177
#[test]
fn rules_of_an_integral_that_differ_in_the_second_component() {
    let lobe = "exp(1e3 * (l.x - 1.0))";
    let text = format!("fn f(l: vec3f) -> vec2f {{ return vec2f(0.25, {lobe}); }}");
    let package = package(&text);
    let over = package.function("f").over(());
    let expected = glam::DVec2::new(std::f64::consts::PI, 6.283e-3);
    let found =
        over.unrecorded().try_integrates_to(Directions::sphere(), move |()| expected, Abs(1e-6));
    let error = found.expect_err("a lobe of 0.03 between rings of 0.05").to_string();
    assert!(error.contains("so there is no verdict: use more rings"), "{error}");
}

// Lesson 177
#[test]
fn integers_have_an_upper_bound_too() {
    let package = package("fn f(i: u32) -> u32 { return i; }\nfn g(i: i32) -> i32 { return i; }");
    let unsigned = |least: f64, most: f64| {
        package.function("f").over(Integers(2..=10_u32)).unrecorded().try_stays_within(least..=most)
    };
    unsigned(2.0, 10.0).expect("they do");
    disagreement(unsigned(2.0, 9.0));
    disagreement(unsigned(3.0, 10.0));
    let signed = |least: f64, most: f64| {
        package
            .function("g")
            .over(Integers(-10..=10_i32))
            .unrecorded()
            .try_stays_within(least..=most)
    };
    signed(-10.0, 10.0).expect("they do");
    disagreement(signed(-10.0, 9.0));
    disagreement(signed(-9.0, 10.0));
}

/// Tests `max(1.0, 1.0 + 1000.0 * sin(x))` at `x` = 0, and the same with `min`. Because WGSL allows the sine an error,
/// `max` may return much more than 1, and `min` much less. So `Spec` counts both cases as ill-conditioned.
// Lesson 177
#[test]
fn an_allowed_interval_is_wide_at_either_end() {
    for (function, side) in [("max", 1.0), ("min", -1.0)] {
        let text =
            format!("fn f(x: f32) -> f32 {{ return {function}(1.0, 1.0 + 1000.0 * sin(x)); }}");
        let package = package(&text);
        let reference = move |x: f64| {
            let wave = 1.0 + 1000.0 * x.sin();
            if side > 0.0 { wave.max(1.0) } else { wave.min(1.0) }
        };
        let found =
            package.function("f").over(Just(0.0)).unrecorded().try_agrees_with(reference, Spec);
        for path in disagreement(found).paths {
            assert_eq!(path.census.ill_conditioned, 1, "{function}: {:?}", path.census);
        }
    }
}

/// If a check has more cases than one dispatch, the later cases are new values, not copies of the first cases.
// Lesson 177
#[test]
fn cases_beyond_the_first_dispatch_are_new() {
    let package = package("fn f(x: f32) -> f32 { return x; }");
    let distinct = |cases: u64| {
        let seen = Mutex::new(HashSet::new());
        let check = package.function("f").over(0.0..=1.0).seed(3).cases(cases);
        check
            .unrecorded()
            .try_satisfies("is seen", |x: f32, _: f32| {
                seen.lock().expect("no panic").insert(x.to_bits());
                true
            })
            .expect("it holds");
        seen.into_inner().expect("no panic").len()
    };
    let (first, all) = (distinct(65_536), distinct(200_000));
    assert!(all > 2 * first, "{first} of 65536, and {all} of 200000");
}

/// In black pixels, the gate allows an error of a small share of the frame's key (its general brightness), and rejects
/// larger errors.
// Lesson 178
#[test]
fn the_floor_of_a_gate() {
    let image = |dark: f32, alpha: f32| {
        let mut pixels = vec![[1.0; 4]; 64 * 64];
        pixels[7] = [dark, dark, dark, alpha];
        Image::new(64, 64, pixels)
    };
    let gate = FrameTolerance::gate(1e-2);
    let passes =
        |dark: f32, alpha: f32| gate.compare(&image(0.0, 0.0), &image(dark, alpha), None).is_ok();
    // The floor is 1e-2 of a ten-thousandth of the key. The key is 1. For alpha, the floor is 1e-2 of a hundredth.
    assert!(passes(0.9e-6, 0.9e-4), "less than the floor");
    assert!(!passes(1.5e-6, 0.0), "more than the floor of a colour");
    assert!(!passes(0.0, 1.5e-4), "more than the floor of alpha");
}

// Lesson 178
#[test]
fn an_edit_of_one_ulp_is_a_change() {
    let before = package("fn f(x: f32) -> f32 { return x; }");
    let after = package("fn f(x: f32) -> f32 { return bitcast<f32>(bitcast<u32>(x) + 1u); }");
    let compared = Request::new(before, after).run().expect("it reads");
    let change = &compared[0].change;
    assert!(matches!(change, Change::Changed { .. }), "{change:?}");
}

/// If one of eight cases reads outside of an array, Karat reports exactly this case.
// Lesson 178
#[test]
fn each_case_out_of_range_is_reported() {
    let text = "fn f(i: u32) -> f32 { var a = array<f32, 3>(1.0, 2.0, 3.0); return a[i]; }";
    let package = package(text);
    for bad in 0..8 {
        let indices = (0..8).map(|case| if case == bad { 3 } else { 1 }).collect::<Vec<u32>>();
        let found = disagreement(
            package.function("f").over(OneOf(indices)).unrecorded().try_has_no_hazards(),
        );
        for path in found.paths {
            assert_eq!((path.census.failures, path.worst.case), (1, bad), "{:?}", path.census);
        }
    }
}

/// Karat refuses tolerances that no error can exceed, and ranges that contain all values of the result's type.
// Lesson 175
#[test]
fn bounds_that_nothing_exceeds_are_refused() {
    let package = package("fn f(x: f32) -> f32 { return x; }\nfn u(i: u32) -> u32 { return i; }");
    let half = |tolerance: Tolerance| {
        let check = package.function("f").over(0.0..=1.0);
        check.unrecorded().try_agrees_with(|x: f64| x, tolerance)
    };
    for bound in [Rel(1e300).into(), Abs(1e39).into(), Ulp(1e10).into(), Ulp(1.0).or(Rel(1e300))] {
        let error = half(bound).expect_err("it can't fail").to_string();
        assert!(error.contains("use a number of at least 0, small enough that some"), "{error}");
    }
    for bound in [Rel(1e30), Rel(1e-30)] {
        half(bound.into()).expect("it is equal");
    }
    let all = |most: f64| {
        package.function("u").over(Integers(0..=9_u32)).unrecorded().try_stays_within(0.0..=most)
    };
    let error = all(f64::from(u32::MAX)).expect_err("every u32 is there").to_string();
    assert!(error.contains("no result passes this check, or every result does"), "{error}");
    all(f64::from(u32::MAX) - 1.0).expect("they do");
}

/// If passes change nothing in the checked buffer, the check fails, even if the buffer is as expected.
// Lesson 176
#[test]
fn passes_that_change_no_word() {
    let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
                @compute @workgroup_size(1) fn idle() { if data[0] > 9u { data[1] = 0u; } }
                @compute @workgroup_size(1) fn swap() {
                    let first = data[0];
                    data[0] = data[1];
                    data[1] = first;
                }";
    let package = package(text);
    let after = |entry_point: &str, data: [u32; 2]| {
        let passes = package.compute().with("data", Storage::new(data));
        passes.dispatch(entry_point, [1, 1, 1]).after("data")
    };
    let in_order = |data: &[u32]| data.is_sorted();
    let unchanged = |error: &ComputeError| matches!(error, ComputeError::Unchanged { .. });
    let found = after("idle", [1, 2]).unrecorded().try_satisfies("is in order", in_order);
    assert!(unchanged(&found.expect_err("it was in order")));
    let found = after("idle", [1, 2]).unrecorded().try_agrees_with([1_u32, 2], Abs(0.0));
    assert!(unchanged(&found.expect_err("it was so")));
    after("swap", [2, 1])
        .unrecorded()
        .try_satisfies("is in order", in_order)
        .expect("it is sorted");
    // A failure is still a verdict.
    let found = after("idle", [2, 1]).unrecorded().try_satisfies("is in order", in_order);
    assert!(!unchanged(&found.expect_err("it isn't in order")));
}

/// If a mesh is completely outside of the frame, the check fails, with and without a golden.
// Lesson 176
#[test]
fn a_draw_that_touches_no_pixel() {
    let text = "struct Out { @builtin(position) at: vec4f }
                @vertex fn vertex(@location(0) position: vec3f) -> Out {
                    return Out(vec4f(position.xy + vec2f(OFFSET, 0.0), 0.5, 1.0));
                }
                @fragment fn white() -> @location(0) vec4f { return vec4f(1.0); }";
    let folder = tempfile::tempdir().expect("a folder");
    let goldens = Goldens::open(folder.path());
    let corners = [[-1.0, -1.0], [1.0, -1.0], [0.0, 1.0]];
    let corners = corners.map(|[x, y]| glam::Vec3::new(x, y, 0.0)).to_vec();
    let path = Path::ALL.into_iter().find(|path| karat::unstable::path::adapter(*path).is_ok());
    let path = path.expect("a driver that draws");
    let compared = |offset: &str| {
        let package = package(&text.replace("OFFSET", offset));
        let mesh = Mesh::new(corners.clone(), vec![0, 1, 2]);
        let frame = package.frame("", 16, 16).mesh("vertex", "white", mesh, 1);
        let found = frame.clone().unrecorded().try_matches(&goldens, "mesh");
        (found.map_err(|error| error.to_string()), frame.render(path))
    };
    // The test compares with an empty golden, and without a golden.
    let (without, empty) = compared("8.0");
    assert!(without.expect_err("nothing is drawn").contains("no draw touches a pixel"));
    let empty = empty.expect("it is drawn");
    empty.write_exr(&folder.path().join("mesh.exr"), Precision::Float, None).expect("written");
    assert!(compared("8.0").0.expect_err("nothing is drawn").contains("no draw touches a pixel"));
    // If the frame differs from the golden, the message says so.
    assert!(compared("0.0").0.expect_err("it is drawn").contains("differs from its golden"));
}

/// Karat refuses two fixtures for one variable, because it could use only one of them.
// Lesson 175
#[test]
fn a_variable_is_given_once() {
    let text = "@group(0) @binding(0) var<uniform> gain: f32;
                @group(0) @binding(1) var<storage, read_write> data: array<f32>;
                fn louder(x: f32) -> f32 { return gain * x; }
                @compute @workgroup_size(1) fn fill() { data[0] = gain; }
                @fragment fn gray() -> @location(0) vec4f { return vec4f(gain); }";
    let package = package(text);
    let gain = |value: f32| Uniform::new(value);
    let twice = |error: String| assert!(error.contains("`gain` has two fixtures"), "{error}");
    let function = package.function("louder").with("gain", gain(1.0)).with("gain", gain(2.0));
    let found = function.over(0.0..=1.0).unrecorded().try_agrees_with(|x: f64| 2.0 * x, Ulp(0.0));
    let Err(found @ Failure::Probe(_)) = found else { panic!("{found:?}") };
    twice(found.to_string());
    let passes = package.compute().with("gain", gain(1.0)).with("gain", gain(2.0));
    let passes = passes.with("data", Storage::new([0.0_f32])).dispatch("fill", [1, 1, 1]);
    twice(
        passes
            .after("data")
            .unrecorded()
            .try_agrees_with([2.0], Ulp(0.0))
            .expect_err("twice")
            .to_string(),
    );
    let frame = package.frame("", 4, 4).fragment("gray");
    let frame = frame.with("gain", gain(1.0)).with("gain", gain(2.0));
    let whole = karat::metric::Rect { left: 0, top: 0, width: 4, height: 4 };
    let found = frame.unrecorded().try_has_mean(whole, [2.0; 3], Abs(1e-3));
    twice(found.expect_err("twice").to_string());
}
