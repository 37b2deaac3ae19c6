//! Tests `//karat: print` and `//karat: assert` in a folder of shaders without Rust.

use super::*;

const SHADER: &str = "@if(karat) import karat::{assert, print};

fn half(x: f32) -> f32 {
    //karat: print x
    @if(karat) assert(x < LIMIT);
    return 0.5 * x;
}

@fragment
fn shade(@location(0) uv: vec2f) -> @location(0) vec4f {
    let own = half(uv.x);
    // karat: print own + 1.0
    return vec4f(own);
}
";

const TESTS: &str = "[[test]]\nfunction = \"half\"\nover = { x = \"0..4\" }\nin_range = [0, 2]\n\n\
                     [[frame]]\nname = \"disc\"\nfragment = \"shade\"\nsize = [8, 4]\n";

const OWN: &str = "import package::m::half;\n@test fn halves() { expect_near(half(3.0), 1.5, 0.0); }\n\
     @test fn others() { expect_near(half(1.0), 0.5, 0.0); }\nimport karat::expect_near;\n";

fn folder(limit: &str) -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let shaders = folder.path().join("shaders");
    write(&shaders, "m.wgsl", &SHADER.replace("LIMIT", limit));
    write(&shaders, "m.test.toml", TESTS);
    write(&shaders, "m_test.wgsl", OWN);
    folder
}

/// A call and a passing test print the values of `karat: print` lines. `karat tap` shows these values for all pixels.
// Lesson 37
#[test]
fn print_comments_show_values_in_calls_tests_and_taps() {
    let folder = folder("5.0");
    let called = karat(folder.path(), &["call", "m::half", "3", "--path=cpu"]).good();
    assert!(called.ends_with("shaders/m.wgsl:4:20: `x` (f32): 1 value\n  3\n"), "{called}");
    let ran = karat(folder.path(), &["test", "--paths=cpu", "--no-frames"]);
    let told = format!("{}{}", ran.out, ran.err);
    assert!(
        told.contains("`x` (f32): 65536 values\n  least 0 for x = 0, most 4 for x = 4"),
        "{told}"
    );
    let out = format!("--out={}", folder.path().join("out").display());
    let tapped =
        karat(folder.path(), &["tap", "disc", "karat:print", "--path=vulkan", &out]).good();
    assert!(
        tapped.contains("shaders/m.wgsl:12:21") && tapped.contains("1.03125 at (0, "),
        "{tapped}"
    );
}

/// If no pixel of a frame reaches an assertion, the frame's test names the assertion.
// Lesson 213
#[test]
fn assertions_that_no_pixel_comes_to_are_named() {
    let folder = folder("5.0");
    let shader = SHADER.replace("LIMIT", "5.0").replace(
        "    return vec4f(own);",
        "    if (uv.x > 2.0) {\n        //karat: assert own > 9.0\n        return vec4f(0.0);\n    }\n    return vec4f(own);",
    );
    write(&folder.path().join("shaders"), "m.wgsl", &shader);
    let ran = karat(folder.path(), &["test", "--paths=vulkan"]);
    let told = format!("{}{}", ran.out, ran.err);
    let note = "note: shaders/m.wgsl:14:25: no pixel reaches the assertion `own > 9.0`";
    assert!(told.contains(note), "{told}");
    assert!(!told.contains("reaches the assertion `(x < 5.0)`"), "{told}");
}

/// `karat call` fails if an assertion is false for a single case, for a value in a range, or for a row of a table. A
/// call that fails still shows the values of `karat: print` lines.
// Lesson 37
#[test]
fn calls_fail_by_assertions() {
    let folder = folder("2.0");
    let ran = karat(folder.path(), &["call", "m::half", "3", "--path=cpu"]);
    assert_eq!(ran.code, Some(1), "{}", ran.err);
    assert!(ran.out.contains("`x` (f32): 1 value\n  3\n"), "{}", ran.out);
    assert!(ran.err.contains("the assertion `(x < 2.0)` is false"), "{}", ran.err);
    let ran = karat(folder.path(), &["call", "m::half", "0..4:3", "--path=cpu"]);
    assert_eq!(ran.code, Some(1), "{}", ran.err);
    for part in ["least 0 for x = 0, most 4 for x = 4", "is false 2 of 3 times", "first for x = 2"]
    {
        assert!(ran.err.contains(part), "no `{part}` in {}", ran.err);
    }
    write(folder.path(), "in.csv", "x\n1\n3\n");
    let ran = karat(folder.path(), &["call", "m::half", "--table=in.csv", "--path=cpu"]);
    assert_eq!(ran.code, Some(1), "{}", ran.err);
    assert!(ran.err.contains("is false 1 of 2 times"), "{}", ran.err);
}

/// A test that reaches a false assertion fails at the assertion's line. This holds for declared tests and for tests in
/// WGSL, run singly or with many others.
// Lesson 37
#[test]
fn tests_fail_by_assertions() {
    let folder = folder("2.0");
    for paths in ["--paths=cpu", "--paths=vulkan"] {
        let ran = karat(folder.path(), &["test", paths]);
        assert_eq!(ran.code, Some(1), "{}", ran.out);
        let told = format!("{}{}", ran.out, ran.err);
        for part in [
            "the assertion `(x < 2.0)` is false",
            "shaders/m.wgsl:5:22",
            "@if(karat) assert(x < 2.0);",
            "m::half in_range ... FAILED",
            "m_test::halves ... FAILED",
            "1 passed; 3 failed",
            "m_test::others prints\nshaders/m.wgsl:4:20: `x` (f32): 1 value\n  1\n",
        ] {
            assert!(told.contains(part), "{paths}: no `{part}` in {told}");
        }
        let short = karat(folder.path(), &["test", "--short", paths]).out;
        let line = "shaders/m.wgsl:5:22: error: the assertion `(x < 2.0)` is false";
        assert!(short.contains(line), "{paths}: no `{line}` in {short}");
    }
}
