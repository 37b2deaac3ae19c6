//! If a driver leaves a loop before its end, the check reports an error instead of the result.

use karat::draw::DrawError;
use karat::frame::FrameError;
use karat::unstable::executor::call;
use karat::unstable::path::adapter;
use karat::unstable::probe::{ProbeError, Probed};
use karat::{Package, Path, Uniform};

const SPIN: &str = "\
    fn spin(n: u32) -> u32 {\n    var s = 0u;\n    for (var i = 0u; i < n; i++) {\n        \
    s += i % 3u;\n    }\n    return s;\n}\n";

fn spun(n: u32) -> u32 {
    (0..n).map(|i| i % 3).sum()
}

fn paths() -> Vec<Path> {
    let paths: Vec<Path> = Path::ALL.into_iter().filter(|path| adapter(*path).is_ok()).collect();
    assert!(!paths.is_empty(), "no path opens");
    paths
}

/// Checks if the driver of this path is llvmpipe, which leaves long loops before their end.
fn leaves(path: Path) -> bool {
    adapter(path).expect("it opens").name.contains("llvmpipe")
}

fn probed(source: &str, function: &str) -> Probed {
    let package = Package::from_source("spin", source);
    Probed::new(&package, function).unwrap_or_else(|error| panic!("{error}"))
}

// Lesson 55
#[test]
fn a_loop_that_the_driver_leaves_is_an_error_with_its_line() {
    let probed = probed(SPIN, "spin");
    for path in paths() {
        let results = call(&probed, path, &[vec![100], vec![65_000], vec![3]], &Vec::new());
        assert_eq!(results.expect("it ends"), [[spun(100)], [spun(65_000)], [spun(3)]]);
        match call(&probed, path, &[vec![100], vec![131_072]], &Vec::new()) {
            Ok(results) => {
                assert!(!leaves(path), "{path} gave {results:?}");
                assert_eq!(results[1], [spun(131_072)]);
            }
            Err(error @ ProbeError::Rounds { case: 1, .. }) => {
                let text = error.to_string();
                for part in ["<spin>:3:5", "for (var i = 0u; i < n; i++)", "65535 iterations"] {
                    assert!(text.contains(part), "{text}");
                }
            }
            Err(error) => panic!("{error}"),
        }
    }
}

/// Karat adds up the iterations of all loops of an invocation, including loops in called functions.
// Lesson 55
#[test]
fn rounds_of_all_loops_of_an_invocation_are_added() {
    let source = format!(
        "{SPIN}fn twice(n: u32) -> u32 {{ return spin(n) + spin(n); }}\n\
         fn grid(n: u32) -> u32 {{ var s = 0u; for (var i = 0u; i < n; i++) {{ s += spin(n); }} return s; }}"
    );
    for path in paths().into_iter().filter(|path| leaves(*path)) {
        for (function, fits, too_many) in [("twice", 32_000, 33_000), ("grid", 250, 300)] {
            let probed = probed(&source, function);
            let factor = if function == "grid" { fits } else { 2 };
            let results = call(&probed, path, &[vec![fits]], &Vec::new()).expect("it ends");
            assert_eq!(results[0], [factor * spun(fits)], "{function} on {path}");
            let result = call(&probed, path, &[vec![too_many]], &Vec::new());
            assert!(matches!(result, Err(ProbeError::Rounds { .. })), "{function} on {path}");
        }
    }
}

/// The driver counts an iteration for a loop each time that the code around the loop runs, even if no case enters the
/// loop. So the driver reaches its limit earlier, and leaves other loops after fewer iterations.
// Lesson 55
#[test]
fn loops_that_are_never_entered_count() {
    let source = format!(
        "{SPIN}fn hidden(n: u32) -> u32 {{\n    var s = 0u;\n    \
         for (var i = 0u; i < n; i++) {{\n        \
         if i > n {{ for (var j = 0u; j < n; j++) {{ s += 7u; }} }}\n        s += i % 3u;\n    }}\n    return s;\n}}\n\
         fn arms(n: u32) -> u32 {{\n    switch n % 2u {{\n        case 0u: {{ return spin(n); }}\n        \
         case 1u: {{ return spin(n); }}\n        default: {{ return 0u; }}\n    }}\n}}\n\
         fn before(n: u32) -> u32 {{\n    if n == 0u {{ return spin(n + 1u); }}\n    return spin(n);\n}}\n"
    );
    let counts = |function: &str, fits: u32, too_many: &[u32]| {
        let probed = probed(&source, function);
        for path in paths() {
            let results = call(&probed, path, &[vec![fits]], &Vec::new()).expect("it ends");
            assert_eq!(results[0], [spun(fits)], "{function} on {path}");
            for n in too_many {
                match call(&probed, path, &[vec![*n]], &Vec::new()) {
                    Err(ProbeError::Rounds { .. }) => {}
                    Ok(results) if !leaves(path) => assert_eq!(results[0], [spun(*n)]),
                    other => panic!("{function}({n}) on {path}: {other:?}"),
                }
            }
        }
    };
    counts("hidden", 32_000, &[32_768, 50_000, 65_000]);
    counts("arms", 65_000, &[65_535, 65_536, 131_072]);
    counts("before", 65_000, &[65_535, 131_072]);
}

/// The driver runs several invocations in one vector, and one counter adds up their iterations. Karat still returns
/// the right result for each case.
// Lesson 55
#[test]
fn a_loop_is_not_stopped_by_the_rounds_of_other_invocations() {
    let source = format!(
        "{SPIN}fn either(n: u32, first: u32) -> u32 {{\n\
         if first == 1u {{ return spin(n); }}\nvar s = 0u;\n\
         for (var i = 0u; i < n; i++) {{ s += i % 3u; }}\nreturn s + 1u;\n}}\n\
         fn turns(n: u32, mine: u32) -> u32 {{\n    var s = 0u;\n    \
         for (var i = 0u; i < 16u; i++) {{\n        if i == mine {{ s += spin(n); }}\n    }}\n    \
         return s;\n}}"
    );
    for path in paths() {
        let cases: Vec<Vec<u32>> = (0..64).map(|i| vec![40_000 + i, i % 2]).collect();
        let expected: Vec<Vec<u32>> =
            (0..64).map(|i| vec![spun(40_000 + i) + u32::from(i % 2 == 0)]).collect();
        let results =
            call(&probed(&source, "either"), path, &cases, &Vec::new()).expect("each ends");
        assert_eq!(results, expected, "on {path}");

        // Each invocation runs another loop, so the driver counts 16 times as many iterations.
        let cases: Vec<Vec<u32>> = (0..64).map(|i| vec![9_000 + i, i % 16]).collect();
        let expected: Vec<Vec<u32>> = (0..64).map(|i| vec![spun(9_000 + i)]).collect();
        let results =
            call(&probed(&source, "turns"), path, &cases, &Vec::new()).expect("each ends");
        assert_eq!(results, expected, "on {path}");
    }
}

/// If naga's IR shows that a function's loops are bounded, the function's kernel contains no counter of iterations.
// Lesson 55: loops that need no counter
#[test]
fn bounded_loops_have_the_plain_kernel() {
    let source =
        "fn f(x: f32) -> f32 { var s = 0.0; for (var i = 0; i < 64; i++) { s += x; } return s; }";
    assert!(!probed(source, "f").kernel().contains("karat_index"));
    assert!(probed(SPIN, "spin").kernel().contains("karat_index"));
}

/// Karat also counts the iterations of loops in frames: in vertex and fragment functions, and in the functions that
/// they call.
// Lesson 55
#[test]
fn loops_of_frames_are_watched() {
    let shader = |vertex: &str, fragment: &str| {
        format!(
            "@group(0) @binding(1) var<uniform> n: u32;\n{SPIN}\
             @vertex fn vertex(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {{\n\
             let at = vec2f(f32(i & 1u), f32(i >> 1u)) * 4.0 - 1.0;\n\
             return vec4f(at, 0.5 + 1e-9 * f32({vertex}), 1.0);\n}}\n\
             @fragment fn fragment() -> @location(0) vec4f {{ return vec4f(f32({fragment})); }}"
        )
    };
    for (vertex, fragment) in [("0", "spin(n)"), ("spin(n)", "0")] {
        let package = Package::from_source("frame", shader(vertex, fragment));
        let render = |path, n: u32| {
            package
                .frame("", 8, 8)
                .fullscreen("vertex", "fragment")
                .with("n", Uniform::new(n))
                .render(path)
        };
        for path in paths() {
            let image = render(path, 60_000).expect("it ends");
            let expected = if vertex == "0" { spun(60_000) as f32 } else { 0.0 };
            assert_eq!(image.pixels()[36][0], expected, "on {path}");
            match render(path, 70_000) {
                Ok(_) => assert!(!leaves(path), "on {path}"),
                Err(FrameError::Draw(DrawError::Rounds(diagnostic))) => {
                    let text = diagnostic.to_string();
                    assert!(text.contains("<frame>:4:5") && text.contains("65535"), "{text}");
                }
                Err(error) => panic!("{error}"),
            }
        }
    }
}
