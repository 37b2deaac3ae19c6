//! Comments in shaders that assert and print (`//karat: assert x > 0.0`): in calls, checks, passes and frames.

use karat::draw::{Draw, Mesh};
use karat::fixture::Fixtures;
use karat::frame::FrameError;
use karat::metric::Rect;
use karat::package::PackageError;
use karat::prelude::*;
use karat::unstable::compute;
use karat::unstable::frame::Tap;
use karat::unstable::interpret::asserted::printed;
use karat::unstable::path::adapter;
use karat::unstable::probe::{ProbeError, Probed};
use karat::unstable::run::Fails as _;
use karat::{Package, Path};

const FUNCTION: &str = "fn f(x: f32, n: i32) -> f32 {
    let y = x * 2.0;
    // karat: print y
    if x > 1.0 {
        //karat: print vec2f(x, y)
    }
    for (var i = 0; i < n; i++) {
        @if(karat) print(x + f32(i));
    }
    //karat: assert y >= 0.0 || n == 3
    return y;
}
";

fn print(x: f32, n: u32) -> Result<String, ProbeError> {
    let probed = Probed::new(&Package::from_source("m", FUNCTION), "f").expect("it is valid");
    let (text, asserted) = printed(&probed, &Fixtures::new(), &[vec![x.to_bits(), n]]);
    asserted.map(|()| text)
}

/// A `print` comment prints the value of its expression each time control reaches the comment's line.
// Lesson 37
#[test]
fn a_call_prints_its_values() {
    let all = "<m>:3:21: `y` (f32): 1 value\n  4\n<m>:5:24: `vec2f(x, y)` (vec2<f32>): 1 value\n  (2, 4)\n\
               <m>:8:25: `(x + f32(i))` (f32): 2 values\n  least 2, most 3\n  2\n  3\n";
    assert_eq!(print(2.0, 2).expect("its assertion holds"), all);
    let none = "<m>:3:21: `y` (f32): 1 value\n  1\n<m>:5:24: `vec2f(x, y)` (vec2<f32>): 0 values\n\
                <m>:8:25: `(x + f32(i))` (f32): 0 values\n";
    assert_eq!(print(0.5, 0).expect("it holds"), none);
    print(-1.0, 3).expect("the other side holds");
    let error = print(-1.0, 2).expect_err("neither holds").to_string();
    for part in ["the assertion `y >= 0.0 || n == 3` is false", "<m>:10:21", "x = -1, n = 2"] {
        assert!(error.contains(part), "{error}");
    }
}

/// On each path, a check fails if an assertion is false for one input. The failure names the input.
// Lesson 37
#[test]
fn checks_fail_by_assertions() {
    let text = "fn f(x: f32) -> f32 {\n    //karat: assert x < 3.9\n    return x;\n}\n\
                fn sound(x: f32) -> f32 {\n    //karat: assert x <= 4.0 && true\n    return x;\n}\n";
    let package = Package::from_source("m", text);
    let agrees = |function: &str| {
        let check = package.function(function).over(0.0..=4.0).unrecorded();
        check.try_agrees_with(|x: f64| x, Ulp(0.0))
    };
    let failure = agrees("f").expect_err("4 is one of the cases");
    assert!(failure.is_verdict(), "{failure}");
    let told = failure.to_string();
    let case = told.split("x = ").nth(1).and_then(|rest| rest.split('\n').next());
    let case: f32 = case.expect("it names the input").trim().parse().expect("a number");
    assert!(case >= 3.9 && told.contains("<m>:2:21") && told.contains("`x < 3.9`"), "{told}");
    agrees("sound").expect("it holds for all of them");
}

/// Karat evaluates assertions in every call of a check, also in calls with transformed arguments and in the calls of an
/// integral.
#[test]
fn assertions_are_evaluated_in_each_kind_of_check() {
    let text = "fn f(x: f32) -> f32 {\n    //karat: assert x >= 0.0 && x <= 4.0\n    return x;\n}\n\
                fn density(x: f32) -> f32 {\n    //karat: assert x < 0.5\n    return 1.0;\n}\n";
    let package = Package::from_source("m", text);
    let f = || package.function("f").over(0.0..=4.0).unrecorded();
    f().try_invariant_under(|x| 4.0 - x, Abs(9.0)).expect("it holds for both");
    let told =
        f().try_invariant_under(|x| x - 5.0, Abs(9.0)).expect_err("the other argument is below 0");
    assert!(told.to_string().contains("the assertion `x >= 0.0 && x <= 4.0` is false"), "{told}");
    let integral = package.function("density").integral(Just(()), |&()| {
        (0..64)
            .map(|i| ((f64::from(i) + 0.5) / 64.0, 1.0 / 64.0))
            .map(|(x, w)| (x as f32, w))
            .collect()
    });
    let told =
        integral.unrecorded().try_agrees_with(|()| 1.0, Abs(1e-3)).expect_err("half of its nodes");
    assert!(told.to_string().contains("the assertion `x < 0.5` is false"), "{told}");
}

/// If the engine can't evaluate an assertion, the check fails.
// Lesson 37: nothing is silent
#[test]
fn an_assertion_that_is_not_looked_at_is_an_error() {
    let text = "@group(0) @binding(0) var<storage, read_write> total: array<f32, 1>;\n\
                fn f(x: f32) -> f32 {\n    total[0] += x;\n    //karat: assert x >= 0.0\n    return x;\n}\n";
    let package = Package::from_source("m", text);
    let check = package.function("f").with("total", Storage::new([0.0_f32])).over(0.0..=4.0);
    let failure = check.unrecorded().try_satisfies("is any", |_, _: f32| true);
    let told = failure.expect_err("nothing looks at it").to_string();
    assert!(told.contains("function `f` writes to variables outside"), "{told}");
}

/// A pass prints the values of each invocation, and fails at the first invocation with a false assertion.
// Lesson 37
#[test]
fn passes_assert_and_print() {
    let text = "@group(0) @binding(0) var<storage, read_write> data: array<f32>;
@compute @workgroup_size(4) fn root(@builtin(global_invocation_id) id: vec3u) {
    let own = data[id.x] + 0.5;
    //karat: print own
    //karat: assert own < LIMIT
    data[id.x] = own;
}
";
    let of = |limit: &str| {
        let package = Package::from_source("m", text.replace("LIMIT", limit));
        let passes = package
            .compute()
            .with("data", Storage::new([0.0_f32, 1.0, 4.0, 9.0, 16.0, 25.0, 9.0, 4.0]));
        let passes = passes.dispatch("root", [2, 1, 1]);
        let after = passes.clone().after("data").unrecorded();
        let judged = after.try_satisfies("is anything", |_: &[f32]| true);
        (judged.map(drop), compute::printed(&passes))
    };
    let (judged, tables) = of("26.0");
    judged.expect("all are below 26");
    let table = tables.expect("it prints").concat();
    for line in [
        "`own` (f32): 8 values",
        "least 0.5 for local (0, 0, 0) of workgroup (0, 0, 0)",
        "  local (2, 0, 0) of workgroup (0, 0, 0)  4.5",
        "  local (1, 0, 0) of workgroup (1, 0, 0)  25.5",
    ] {
        assert!(table.contains(line), "{table}");
    }
    let (judged, tables) = of("16.5");
    let failure = judged.expect_err("16.5 isn't below itself");
    assert!(failure.is_verdict());
    let told = failure.to_string();
    for part in ["`own < 16.5` is false", "<m>:5:21", "local (0, 0, 0) of workgroup (1, 0, 0)"] {
        assert!(told.contains(part), "{told}");
    }
    assert!(tables.is_err());
}

/// The check of a frame fails if an assertion is false in a pixel, also inside a loop. `Frame::tap` reads the values of
/// a `print` comment in the frame's shader.
// Lesson 37
#[test]
fn frames_assert_and_print() {
    let text = "@fragment fn fragment(@builtin(position) at: vec4f) -> @location(0) vec4f {
    var sum = 0.0;
    for (var i = 0; i < 3; i++) {
        sum += at.x;
        //karat: assert i != 1 || at.x < LIMIT
    }
    //karat: assert sum < 9.0 || at.x < LIMIT
    //karat: print sum
    return vec4f(sum);
}
";
    let paths = [Path::VULKAN, Path::GL].into_iter().filter(|path| adapter(*path).is_ok());
    let paths: Vec<Path> = paths.collect();
    assert!(!paths.is_empty(), "no driver opens");
    for path in paths {
        let mean = |limit: &str| {
            let package = Package::from_source("m", text.replace("LIMIT", limit));
            let frame = package.frame("", 4, 2).fragment("fragment").unrecorded();
            let tapped = frame.tap(path, &Tap::new(&frame.prints(path).expect("one line")[0]));
            let tapped = tapped.expect("it is told");
            assert_eq!(f32::from_bits(tapped.lanes[1]), 4.5, "{path}");
            let one = Rect::new(0, 0, 1, 1);
            frame.try_has_mean(one, [1.5; 3], Abs(1e-3)).map(drop)
        };
        mean("4.0").unwrap_or_else(|error| panic!("{path}: {error}"));
        let failure = mean("3.0").expect_err("the last column is at 3.5");
        assert!(failure.is_verdict(), "{failure}");
        let told = failure.to_string();
        for part in [
            "is false for 2 of 8 pixels",
            "<m>:5:25",
            "the first pixel is (3, 0)",
            "<m>:7:21: the assertion `sum < 9.0 ||",
        ] {
            assert!(told.contains(part), "{path}: {told}");
        }
        assert!(matches!(failure, FrameError::Asserted(_) | FrameError::Paths(_)));
    }
}

/// A frame can pass although its vertex function has a false assertion, because nothing evaluates that assertion.
// Lesson 213
#[test]
fn vertex_functions_are_not_looked_at() {
    let text = "@vertex fn vertex(@location(0) position: vec3f) -> @builtin(position) vec4f {
    //karat: assert position.x > 9.0
    return vec4f(position, 1.0);
}
@fragment fn fragment() -> @location(0) vec4f { return vec4f(0.25); }
";
    let package = Package::from_source("m", text);
    let corner = |x: f32, y: f32| glam::Vec3::new(x, y, 0.0);
    let corners = vec![corner(-1.0, -1.0), corner(3.0, -1.0), corner(-1.0, 3.0)];
    let mesh = Mesh::new(corners, vec![0, 1, 2]);
    let frame = package.frame("", 2, 2).draw(Draw::mesh("vertex", "fragment", mesh));
    for path in [Path::VULKAN, Path::GL].into_iter().filter(|path| adapter(*path).is_ok()) {
        let mean =
            frame.clone().unrecorded().try_has_mean(Rect::new(0, 0, 1, 1), [0.25; 3], Abs(0.0));
        mean.map(drop).unwrap_or_else(|error| panic!("{path}: {error}"));
    }
}

/// Assertions and prints can't change a value, because Karat refuses calls with side effects in them. An assertion that
/// reads out of bounds is false.
// Lesson 37
#[test]
fn assertion_comments_cannot_write_or_read_out_of_bounds() {
    let told = |text: &str, function: &str, row: &[u32]| {
        let package = Package::from_source("m", text);
        let probed = Probed::new(&package, function).expect("it is valid");
        let (text, asserted) = printed(&probed, &Fixtures::new(), &[row.to_vec()]);
        asserted.map_or_else(|error| error.to_string(), |()| text)
    };
    let bump = "var<private> count = 0;\nfn bump() -> i32 { count += 1; return count; }\n\
                fn plain() -> i32 { return count; }\n\
                fn put(p: ptr<function, f32>) -> f32 { *p = 9.0; return *p; }\n";
    for (line, is_refused) in
        [("bump()", true), ("plain()", false), ("put(&y)", true), ("y", false)]
    {
        let text = format!(
            "{bump}fn f(x: f32) -> f32 {{\n    var y = x;\n    //karat: print {line}\n    return y + f32(count);\n}}\n"
        );
        let told = told(&text, "f", &[1.0_f32.to_bits()]);
        let refused = told.contains("has a side effect") && told.contains("<m>:7:20");
        assert_eq!(refused, is_refused, "{line}: {told}");
    }
    let text = "fn f(i: u32) -> f32 {\n    var all = array<f32, 2>(1.0, 2.0);\n    //karat: assert all[i] > 0.0\n    \
                //karat: print all[i]\n    return 1.0;\n}\n";
    assert!(told(text, "f", &[1]).contains("`all[i]` (f32): 1 value\n  2\n"));
    let outside = told(text, "f", &[2]);
    assert!(outside.contains("`all[i] > 0.0` reads outside of an array"), "{outside}");
}

/// The table of printed values counts the NaNs, and ignores them for the smallest and the largest value.
// Lesson 37
#[test]
fn nan_is_counted() {
    let text = "fn f(x: f32) -> f32 {\n    //karat: print sqrt(x)\n    return x;\n}\n";
    let package = Package::from_source("m", text);
    let probed = Probed::new(&package, "f").expect("it is valid");
    let rows: Vec<Vec<u32>> = [4.0_f32, -1.0, 0.01].map(|x| vec![x.to_bits()]).to_vec();
    let (table, _) = printed(&probed, &Fixtures::new(), &rows);
    let expected = "`sqrt(x)` (f32): 3 values, NaN 1 times\n  least 0.1 for x = 0.01, most 2 for x = 4\n  x = 4  2\n";
    assert!(table.contains(expected), "{table}");
}

/// A misspelt keyword and an invalid expression are errors at their positions.
// Lesson 37: nothing is silent
#[test]
fn misspelt_assertion_comments_are_errors_at_their_place() {
    let wrong = |line: &str| {
        let text = format!("fn f(x: f32) -> f32 {{\n    {line}\n    return x;\n}}\n");
        match Probed::new(&Package::from_source("m", &text), "f") {
            Err(ProbeError::Reflect(error)) => error.to_string(),
            other => panic!("{other:?}"),
        }
    };
    for (line, part) in [
        ("//karat: prnt x", "did you mean `print`?"),
        ("//karat: print z", "z"),
        ("//karat: assert x", "bool"),
    ] {
        let told = wrong(line);
        assert!(told.contains("<m>:2") && told.contains(part), "{told}");
    }
    let error = PackageError::Asserts { place: "m:2".to_owned(), reason: "it is".to_owned() };
    assert!(error.to_string().contains("//karat: assert x >= 0.0"));
}
