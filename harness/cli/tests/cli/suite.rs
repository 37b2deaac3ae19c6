//! Tests functions with `@test`, and `*.test.toml`.

use super::*;

const BRDF: &str = "/// Schlick's approximation.\n\
fn schlick(f0: f32, v_dot_h: f32) -> f32 {\n    let x = 1.0 - v_dot_h;\n    \
return f0 + (1.0 - f0) * (x * x * x * x * x);\n}\n\
fn by_pow(f0: f32, v_dot_h: f32) -> f32 {\n    \
return f0 + (1.0 - f0) * pow(1.0 - v_dot_h, 5.0);\n}\n\
fn lambert(l: vec3f) -> f32 { return 0.31830987; }\n\
fn blend(a: f32, b: f32) -> f32 { return a * b; }\n";

const DECLARED: &str = "[[test]]\nfunction = \"schlick\"\nover = { f0 = \"0..1\", v_dot_h = \"0..1\" }\n\
in_range = [0, 1]\nfinite = true\nmonotone = { v_dot_h = \"decreasing\" }\n\
agrees_with = \"by_pow\"\ntolerance = \"rel 1e-5 or abs 1e-6\"\n\
[[test]]\nfunction = \"lambert\"\nintegral = { over = \"projected_hemisphere\", equals = 1 }\n\
tolerance = \"rel 1e-6\"\n\
[[test]]\nfunction = \"blend\"\nsymmetric_in = [\"a\", \"b\"]\n\
limit = { a = 0, through = [0.1, 0.01, 0.001], equals = 0 }\nover = { a = 1, b = \"0.5..1\" }\n\
tolerance = \"abs 1e-2\"\n\
[[test]]\nname = \"table\"\nfunction = \"blend\"\ntable = \"blend.csv\"\ntolerance = \"exact\"\n";

const TESTS: &str = "import package::brdf::{schlick, blend};\n\
import karat::{expect_near, expect_in_range, expect_true};\n\
import wgsl_test::expectNear;\n\n\
@test fn grazing() {\n    expect_near(schlick(0.04, 0.0), 1.0, 1e-6);\n    \
expectNear(blend(2.0, 3.0), 6.0);\n}\n\n\
@test @cases(500) fn fraction(@over(0, 1) f0: f32, @over(0, 1) cosine: f32) {\n    \
expect_in_range(schlick(f0, cosine), 0.0, 1.0);\n}\n";

fn folder() -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "brdf.wgsl", BRDF);
    write(folder.path(), "brdf.test.toml", DECLARED);
    write(folder.path(), "blend.csv", "a,b,result\n0.5,0.5,0.25\n2,3,6\n");
    write(folder.path(), "brdf_test.wgsl", TESTS);
    folder
}

fn cpu(folder: &FilePath, more: &[&str]) -> Ran {
    karat(folder, &[&["test", ".", "--paths", "cpu"], more].concat())
}

/// After a run of some tests, `karat list` doesn't know if the other functions are tested, and says so.
#[test]
fn a_list_after_a_part_of_the_tests_says_so() {
    let folder = folder();
    cpu(folder.path(), &[]).good();
    let all = karat(folder.path(), &["list"]).good();
    assert!(all.contains("  no ") && !all.contains("the last run ran only"), "{all}");
    cpu(folder.path(), &["lambert"]).good();
    let part = karat(folder.path(), &["list"]).good();
    assert!(part.contains("not last time"), "{part}");
    assert!(part.contains("the last run ran only the tests that `lambert` selects"), "{part}");
}

/// If a wrong key in a declaration keeps a test from starting, each report has an error with the key's line.
#[test]
fn a_test_that_cannot_begin_is_in_each_report() {
    let folder = folder();
    let declared = "[[test]]\nfunction = \"schlick\"\nover = { f1 = 0 }\nfinite = true\n\
                    [[frame]]\nname = \"sky\"\nfragment = \"sky\"\nsize = [4, 4]\n\
                    formats = [\"rgba8\"]\n";
    write(folder.path(), "brdf.test.toml", declared);
    // The tests of an unreadable file can't start either.
    write(folder.path(), "other.test.toml", "[[test]]\nfunction = \"schlick\"\nfinit = true\n");
    let ran = cpu(folder.path(), &["--short", "--junit", "junit.xml"]);
    assert!(ran.out.contains("other.test.toml:3:1: error: unknown field `finit`"), "{ran:?}");
    let over = "brdf.test.toml:3:1: error: over: there is no parameter `f1`";
    let formats = "brdf.test.toml:9:1: error: formats: ";
    assert!(ran.out.contains(over) && ran.out.contains(formats), "{ran:?}");
    assert!(!ran.out.contains("outside of Karat's checks"), "{ran:?}");
    let junit = std::fs::read_to_string(folder.path().join("junit.xml")).expect("written");
    for place in ["file=\"brdf.test.toml\" line=\"3\"", "file=\"brdf.test.toml\" line=\"9\""] {
        assert!(junit.contains(place), "{junit}");
    }
    let report = output(command(folder.path(), &["report"]).env("GITHUB_ACTIONS", "true"));
    assert!(report.out.contains("::error file=brdf.test.toml,line=3,col=1,"), "{report:?}");
}

/// If the same error stops all tests, the report shows the full message once, and the file and line of each test.
#[test]
fn a_cause_that_stops_all_tests_is_printed_once() {
    let folder = folder();
    let metal = cpu(folder.path(), &["--require", "metal"]);
    assert_eq!(metal.code, Some(1), "{metal:?}");
    let told = |part: &str| metal.out.matches(part).count();
    let (failures, others) = (told("\n---- "), told("` fails with the same error\n"));
    assert!(failures > 2 && others == failures - 1, "{}", metal.out);
    assert_eq!(told("execution path `metal` is required, but unavailable"), failures);
    assert_eq!(told(" --> "), failures, "each has its place:\n{}", metal.out);
}

#[test]
fn a_folder_of_shaders_is_tested_without_cargo() {
    let folder = folder();
    let ran = cpu(folder.path(), &["--junit", "junit.xml"]).good();
    for part in [
        "brdf::schlick",
        "agrees_with",
        "is_monotone_in",
        "lies in 0..=1",
        "brdf::lambert",
        "integral",
        "invariant_under",
        "at_limit",
        "brdf_test::grazing",
        "expects",
        "10 checks",
        "0 failed",
    ] {
        assert!(ran.contains(part), "no `{part}` in {ran}");
    }
    assert!(folder.path().join("junit.xml").is_file());
    // A function that a test in WGSL calls is tested.
    let untested = ran.split("functions without a test").nth(1).unwrap_or_default();
    assert!(untested.contains("brdf::by_pow") && !untested.contains("brdf::blend"), "{ran}");
    // In a folder without Cargo, the project is the folder.
    let here = karat(folder.path(), &["test", "--paths", "cpu"]).good();
    assert!(here.contains("10 checks"), "{here}");
    let some = cpu(folder.path(), &["grazing"]).good();
    assert!(some.contains("1 check"), "{some}");
    let error = cpu(folder.path(), &["brdf_test::grasing"]).failure(3);
    let meant = "none of 10 tests has a name that contains `brdf_test::grasing`; did you mean `brdf_test::grazing`?";
    assert!(error.contains(meant), "{error}");
    let one = karat(folder.path(), &["test", "brdf.wgsl", "--paths", "cpu"]).good();
    assert!(one.contains("8 checks"), "{one}");
    assert!(karat(folder.path(), &["test", "./nowhere"]).error().contains("no folder or file"));
}

/// If a module has a syntax error, Karat doesn't report the module's functions as untested.
#[test]
fn a_syntax_error_makes_no_function_untested() {
    let folder = folder();
    let listed = "\nfunctions without a test: ";
    assert!(cpu(folder.path(), &[]).out.contains(listed));
    for broken in
        [BRDF.replacen("return", "retrun", 1), BRDF.replacen("return", "return nothing +", 1)]
    {
        write(folder.path(), "brdf.wgsl", &broken);
        let ran = cpu(folder.path(), &["--html", "report.html"]);
        let told = "so Karat doesn't list its untested functions";
        assert!(!ran.out.contains(listed) && ran.out.contains(told), "{ran:?}");
    }
}

#[test]
fn a_test_with_a_texture_says_where_it_is_bound() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let text = "import karat::expect_true;\n\
                @test fn t(image: texture_2d<f32>) { expect_true(textureLoad(image, vec2u(), 0).x > 0.0); }\n";
    write(folder.path(), "t.wgsl", text);
    let ran = cpu(folder.path(), &[]);
    for part in [
        "the parameter `image` is a texture or sampler, which `@test` can't bind",
        "declare the test in a `*.test.toml`, where `with` binds the parameter: `with = { image = ... }`",
    ] {
        assert!(ran.out.contains(part), "no `{part}` in {ran:?}");
    }
}

#[test]
fn a_boolean_is_no_value_of_a_u32_override() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "m.wgsl", "override N: u32 = 1;\nfn f() -> u32 { return N; }\n");
    let declared = |value: &str| {
        let text = format!(
            "[[test]]\nfunction = \"f\"\nin_range = [0, 9]\noverride = {{ N = {value} }}\n"
        );
        write(folder.path(), "m.test.toml", &text);
        cpu(folder.path(), &[])
    };
    declared("2").good();
    let wrong = declared("true");
    let part = "override: the override `N` is of type u32, but true isn't a number: write a number";
    assert!(wrong.code != Some(0) && wrong.out.contains(part), "{wrong:?}");
}

// Lesson 100
#[test]
fn each_failing_expectation_is_reported_with_its_place() {
    let folder = folder();
    let text = "import package::brdf::blend;\nimport karat::{expect_near, expect_true, expect_ulp};\n\
           fn both(x: f32) {\n    expect_true(x < 0.5);\n}\n\
           @test fn wrong(@over(0, 1) x: f32) {\n    expect_near(blend(x, 1.0), x, 0.0);\n    \
           expect_near(blend(x, 2.0), x, 1e-3);\n    both(x);\n    \
           expect_ulp(blend(x, 1.0), x, 0.0);\n}\n";
    write(folder.path(), "wrong_test.wgsl", text);
    let ran = cpu(folder.path(), &["wrong"]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    for part in [
        "wrong_test.wgsl:8:5: `expect_near(blend(x, 2.0), x, 1e-3)` saw 2, expected 1 within 0.001",
        "wrong_test.wgsl:4:5: `expect_true(x < 0.5)` saw false, expected true",
        "x = 1",
        "1 check, 1 failed",
    ] {
        assert!(ran.out.contains(part), "no `{part}` in {}", ran.out);
    }
    assert!(!ran.out.contains("wrong_test.wgsl:7:5"), "what holds isn't told: {}", ran.out);
    // Finds the replay command in the output.
    let replay = ran.out.lines().find_map(|line| line.trim().strip_prefix("replay: "));
    let words: Vec<&str> = replay.expect("a replay").split(' ').collect();
    let mut again = command(folder.path(), &[]);
    for word in &words {
        match word.split_once('=') {
            Some((name, value)) if name.starts_with("KARAT_") => drop(again.env(name, value)),
            _ if *word == "karat" => {}
            _ => drop(again.arg(word)),
        }
    }
    let again = output(&mut again);
    assert!(again.code == Some(1) && again.out.contains("1 of 1 case fails"), "{again:?}");
    // Karat tries the failing inputs again.
    assert!(folder.path().join(".karat/failures/suite").is_dir());
}

/// Karat refuses a bound that is larger than any difference of two floats, because such an expectation couldn't fail.
#[test]
fn a_bound_that_nothing_exceeds_fails() {
    let folder = folder();
    let text = |steps: &str| {
        format!(
            "import karat::expect_ulp;\n@test fn far(@over(0, 1) x: f32) \
             {{ expect_ulp(x, -3e38, {steps}); }}\n"
        )
    };
    for paths in ["cpu", "cpu,vulkan"] {
        let ran = |steps: &str| {
            write(folder.path(), "far_test.wgsl", &text(steps));
            karat(folder.path(), &["test", ".", "far", "--paths", paths])
        };
        ran("4e9").good();
        for steps in ["4278190080.0", "1e30"] {
            let ran = ran(steps);
            assert_eq!(ran.code, Some(1), "{ran:?}");
            assert!(ran.out.contains("ulp, which isn't a usable bound"), "{ran:?}");
        }
    }
}

// Lesson 110
#[test]
fn planted_faults_turn_each_assertion_red() {
    for (fault, by, names) in [
        ("x * x * x * x * x", "x * x * x * x", &["agrees_with"][..]),
        ("(1.0 - f0)", "(1.1 - f0)", &["in_range", "agrees_with"]),
        ("let x = 1.0 - v_dot_h", "let x = v_dot_h", &["monotone in v_dot_h"]),
        ("let x = 1.0 - v_dot_h", "let x = 1.0 / v_dot_h", &["finite"]),
        ("0.31830987", "0.3", &["integral"]),
        ("a * b", "a * b * b", &["symmetric_in", "table"]),
        ("a * b", "a * b + 0.1", &["limit of a"]),
    ] {
        let folder = folder();
        write(folder.path(), "brdf.wgsl", &BRDF.replacen(fault, by, 1));
        let ran = cpu(folder.path(), &["brdf::"]);
        assert_eq!(ran.code, Some(1), "{ran:?}");
        for name in names {
            let red = ran.out.lines().any(|line| {
                line.starts_with("test brdf::") && line.ends_with(&format!("{name} ... FAILED"))
            });
            assert!(red, "`{by}` leaves `{name}` green:\n{}", ran.out);
        }
    }
}

/// The tested functions use derivatives, write into buffers, use overrides, or use a buffer with data from a file.
// Lesson 132
#[test]
fn declared_tests_of_each_kind_run() {
    const TEXT: &str = "@group(0) @binding(0) var<storage, read_write> log: array<u32>;\n\
        struct Globals { gain: f32, offset: f32 }\n@group(0) @binding(1) var<uniform> g: Globals;\n\
        override A: f32 = 1.0;\noverride ON: bool = false;\n\
        fn edge(d: f32) -> f32 { return clamp(0.5 - d / fwidth(d), 0.0, 1.0); }\n\
        fn slope(d: f32) -> f32 { return dpdx(d); }\n\
        fn put(i: u32) { log[1] = i + 1u; }\n\
        fn gained(x: f32) -> f32 { return select(0.0, A * g.gain, ON) + x * g.offset; }\n";
    const DECLARED: &str = "[[test]]\nfunction = \"edge\"\nin_range = [0, 1]\n\
           over = { d = { value = \"-1..1\", dx = \"0.1..1\", dy = 0.0 } }\n\
           [[test]]\nfunction = \"slope\"\nequals = 0.25\ntolerance = \"abs 1e-6\"\n\
           over = { d = { value = 0.0, dx = 0.25 } }\n\
           [[test]]\nname = \"free\"\nfunction = \"slope\"\nin_range = [-0.5, 0.5]\n\
           over = { d = \"0..0.001\" }\n\
           [[test]]\nfunction = \"put\"\nequals = [4, 3, 6]\ntolerance = \"exact\"\n\
           over = { i = 2 }\nwith = { log = [4, 5, 6] }\n\
           [[test]]\nfunction = \"gained\"\nequals = 6\ntolerance = \"exact\"\n\
           over = { x = 2 }\nwith = { g = \"g.json\" }\noverride = { A = 2, ON = true }\n";
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "own.wgsl", TEXT);
    write(folder.path(), "own.test.toml", DECLARED);
    write(folder.path(), "g.json", "{\"gain\": 2, \"offset\": 1}");
    let ran = cpu(folder.path(), &[]).good();
    assert!(ran.contains("5 checks") && ran.contains("0 failed"), "{ran}");
    for (fault, by, name) in [
        ("clamp(0.5 - d / fwidth(d), 0.0, 1.0)", "0.5 - d / fwidth(d)", "edge in_range"),
        ("return dpdx(d)", "return dpdy(d)", "slope equals"),
        ("return dpdx(d)", "return 1.0 + dpdx(d)", "free in_range"),
        ("log[1] = i", "log[1] = 2u * i", "put equals"),
        ("A * g.gain", "g.gain", "gained equals"),
    ] {
        write(folder.path(), "own.wgsl", &TEXT.replacen(fault, by, 1));
        let ran = cpu(folder.path(), &[]);
        assert_eq!(ran.code, Some(1), "{ran:?}");
        let red = ran.out.lines().any(|line| line.ends_with(&format!("{name} ... FAILED")));
        assert!(red, "`{by}` leaves `{name}` green:\n{}", ran.out);
    }
}

// Lesson 100
// Lesson 195
#[test]
fn tests_that_check_nothing_or_cannot_run_fail() {
    for (file, text, part) in [
        ("t.wgsl", "@test fn t() { let x = 1.0; }\n", "no case that evaluates an expectation"),
        (
            "t.wgsl",
            "import karat::expect_near;\n@test fn t() { expect_near(1.0, 2.0 }\n",
            "t.wgsl:2",
        ),
        (
            "t.wgsl",
            "import karat::expect_neer;\n@test fn t() { expect_neer(1.0); }\n",
            "expect_neer",
        ),
        (
            "t.wgsl",
            "import karat::expect_true;\n@test fn t(@over(unit) x: f32) { expect_true(true); }\n",
            "isn't a domain of a number",
        ),
        (
            "t.wgsl",
            "import karat::expect_true;\n@test @cases(0) fn t() { expect_true(true); }\n",
            "a whole number of at least 1",
        ),
        (
            "t.wgsl",
            "import karat::expect_true;\n@test fn t() -> f32 { expect_true(true); return 1.0; }\n",
            "has a return type",
        ),
        (
            "t.wgsl",
            "import karat::expect_near;\n@test fn t() { expect_near(1.0, 1.0, -1.0); }\n",
            "t.wgsl:2:16",
        ),
        (
            "t.wgsl",
            "import karat::expect_near;\n@test fn t(@over(0) x: f32) { expect_near(x / x, 1.0, 1e9); }\n",
            "NaN",
        ),
        (
            "brdf.test.toml",
            "[[test]]\nfunction = \"schlik\"\nfinite = true\n",
            "did you mean `brdf::schlick`?",
        ),
        (
            "brdf.test.toml",
            "[[test]]\nfunction = \"schlick\"\nover = { f1 = 1 }\nfinite = true\n",
            "did you mean `f0`?",
        ),
        (
            "brdf.test.toml",
            "[[test]]\nfunction = \"schlick\"\nsymmetric = [\"u\", \"f0\"]\n",
            "did you mean `symmetric_in`?",
        ),
        (
            "brdf.test.toml",
            "[[test]]\nfunction = \"schlick\"\nequals = 1\n",
            "a tolerance is missing",
        ),
        (
            "brdf.test.toml",
            "[[test]]\nfunction = \"schlick\"\nfinite = true\nover = { f1 = 1 }\n",
            "brdf.test.toml:4:1",
        ),
        (
            "brdf.test.toml",
            "[[test]]\nfunction = \"is_odd\"\nfinite = true\n",
            "the function returns no float",
        ),
        (
            "brdf.test.toml",
            "[[test]]\nfunction = \"is_odd\"\nin_range = [0, 1]\n",
            "`in_range` needs numbers",
        ),
        (
            "brdf.test.toml",
            "[[test]]\nfunction = \"gain\"\nfinite = true\n",
            "bind `brdf::params` by `with`",
        ),
        (
            "t.wgsl",
            "import karat::expect_true;\n@group(0) @binding(0) var<uniform> u: vec4f;\n\
             @test fn t() { expect_true(u.x > 0.0); }\n",
            "this test reads `u` (uniform buffer), and a test in WGSL can't bind variables",
        ),
        (
            "brdf.test.toml",
            "[[test]]\nfunction = \"schlik\"\nfinite = true\n",
            "brdf.test.toml:2:1",
        ),
        ("brdf.tests.toml", "[[test]]\n", "Karat reads declared tests from `*.test.toml`"),
        ("t.wgls", "@test fn t() {}\n", "Karat reads tests in WGSL from `*.wgsl` and `*.wesl`"),
        ("t.wgsl", "@tset fn t() {}\n", "tset"),
        (
            "t.wgsl",
            "import karat::expect_true;\n@test fn t(@over(0 1) x: f32) { expect_true(x >= 0.0); }\n",
            "a comma is missing between `0` and `1`",
        ),
        (
            "t.wgsl",
            "import karat::expect_true;\n@test fn t(@over(0,, 1) x: f32) { expect_true(x >= 0.0); }\n",
            "has one comma too many",
        ),
        (
            "t.wgsl",
            "import karat::expect_true;\n@test @cases(10 00) fn t(x: f32) { expect_true(true); }\n",
            "a comma is missing between `10` and `00`",
        ),
        (
            "t.wgsl",
            "import karat::expect_true;\n\
             @test fn t(@over(0, 1) @over(2, 3) x: f32) { expect_true(x >= 0.0); }\n",
            "`@over` occurs twice",
        ),
        (
            "t.wgsl",
            "import karat::expect_true;\n\
             @test @cases(9) @cases(8) fn t(x: f32) { expect_true(x == x); }\n",
            "`@cases` occurs twice",
        ),
        (
            "t.wgsl",
            "import karat::expect_in_range_vec3;\n\
             @test fn t() { expect_in_range_vec3(vec3f(0.0, 1.0, 1.5), 0.0, 1.0); }\n",
            "saw (0, 1, 1.5), expected a value from 0 to 1",
        ),
        (
            "t.wgsl",
            "import karat::expect_near;\n@test fn t(x: f32, n: vec3f, seed: u32) {\n    \
             expect_near(x, 0.0, 100.0);\n}\n",
            "arguments: x from -1048576 to 1048576, with half of the values from -4 to 4; n a unit vector; seed any",
        ),
        (
            "brdf.test.toml",
            "[[test]]\nfunction = \"schlick\"\nfinit = true\n",
            "brdf.test.toml:3:1",
        ),
        (
            "brdf.test.toml",
            "[[test]]\nfunction = \"blend\"\ntable = \"none.csv\"\ntolerance = \"exact\"\n",
            "none.csv",
        ),
        ("brdf.test.toml", "", "declares no test"),
    ] {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let more = "fn is_odd(x: u32) -> bool { return (x & 1u) == 1u; }\n\
                    @group(0) @binding(0) var<uniform> params: vec4f;\n\
                    fn gain(x: f32) -> f32 { return params.x * x; }\n";
        write(folder.path(), "brdf.wgsl", &format!("{BRDF}{more}"));
        write(folder.path(), file, text);
        let ran = cpu(folder.path(), &[]);
        assert!(matches!(ran.code, Some(1..=3)), "{text}: {ran:?}");
        assert!(
            ran.out.contains(part) || ran.err.contains(part),
            "no `{part}` for {text}: {ran:?}"
        );
    }
    let nothing = tempfile::tempdir().expect("a temporary folder");
    write(nothing.path(), "brdf.wgsl", BRDF);
    assert!(cpu(nothing.path(), &[]).failure(3).contains("has no tests: no function with `@test`"));
    // A fault that several tests share is reported once.
    let shared = tempfile::tempdir().expect("a temporary folder");
    let test = |at: u32| format!("@test fn t{at}() {{ expect_true(helper() > {at}.0); }}\n");
    let text = format!(
        "import karat::expect_true;\nfn helper() -> f32 {{ return 1.0 * ; }}\n{}{}{}",
        test(0),
        test(1),
        "@test fn sound() { expect_true(true); }\n"
    );
    write(shared.path(), "t.wgsl", &text);
    let ran = cpu(shared.path(), &[]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    assert!(ran.out.contains("test t::t0 and 1 more ... FAILED"), "{ran:?}");
    let sound = |line: &str| line.starts_with("t::sound ") && line.contains(" expects ");
    assert!(ran.out.lines().any(sound), "{ran:?}");
}

/// A test passes even if all its values are exactly at their bounds. Karat doesn't count cases that evaluate no
/// expectation.
// Lesson 105
#[test]
fn a_value_at_its_bound_passes_and_idle_cases_are_not_counted() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "brdf.wgsl", BRDF);
    let text = "import karat::{expect_near, expect_true};\n\
        @test fn at_the_bound() {\n    \
        for (var i = 0u; i < 3u; i++) { expect_near(f32(i) + 0.5, f32(i), 0.5); }\n}\n\
        @test fn close_to_it() {\n    \
        for (var i = 0u; i < 256u; i++) { expect_near(f32(i) + 0.49999, f32(i), 0.5); }\n}\n\
        @test @cases(1000) fn seldom(@over(0, 999) x: u32) {\n    \
        if x == 7u { expect_true(true); }\n}\n";
    write(folder.path(), "t.wgsl", text);
    let ran = cpu(folder.path(), &["--json", "all.json"]).good();
    let json = std::fs::read_to_string(folder.path().join("all.json")).expect("written");
    let all: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    let records = all["records"].as_array().expect("records");
    let seldom = records.iter().find(|r| r["subject"]["function"] == "t::seldom").expect("it ran");
    assert_eq!(seldom["paths"][0]["cases"], 1, "{ran}");
}

/// Karat compiles several tests into one shader, and runs each failing test again on its own. The failing test's
/// message is the same as on the path `cpu`, where Karat compiles nothing.
// Lesson 104
#[test]
fn tests_that_are_counted_together_have_their_own_verdicts() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let good = (0..9).map(|at| {
        format!(
            "@test fn good{at}(@over({at}) a: f32, @over(0, 1) b: vec2f, @over({at}, {}) p: u32) {{\n    \
             expect_near(a, {at}.0, 0.0);\n    expect_true(all(b >= vec2f(0.0)) && all(b <= vec2f(1.0)));\n    \
             expect_true(p == {at}u || p == {}u);\n}}\n",
            at + 1,
            at + 1
        )
    });
    let text = format!(
        "import karat::{{expect_true, expect_near}};\n{}\
         @test @cases(300) fn wrong(@over(0, 15) i: u32, flag: bool) {{\n    \
         expect_true(i != 7u || flag);\n}}\n\
         @test fn idle() {{}}\n\
         @test fn begin() {{ expect_true(true); }}\n@test fn counts() {{ expect_true(true); }}\n\
         fn spin(n: i32) -> f32 {{ var s = 0.0; for (var i = 0; i < n; i++) {{ s += 1.0; }} return s; }}\n\
         @test fn long(@over(1, 2, 200000) n: i32) {{ expect_true(spin(n) < 100000.0); }}\n\
         @test fn short(@over(1, 2, 20) n: i32) {{ expect_true(spin(n) < 100000.0); }}\n",
        good.collect::<String>()
    );
    write(folder.path(), "t.wgsl", &text);
    let run = |path: &str| {
        let mut command =
            command(folder.path(), &["test", ".", "--paths", path, "--json", "all.json"]);
        let ran = output(command.env("KARAT_FAILURES", "off"));
        assert_eq!(ran.code, Some(1), "{ran:?}");
        for part in [
            "t.wgsl:48:5: `expect_true(i != 7u || flag)` saw false",
            "i = 7",
            "15 checks, 3 failed",
        ] {
            assert!(ran.out.contains(part), "no `{part}` on {path}: {}", ran.out);
        }
        assert!(ran.out.contains("no case that evaluates an expectation"), "{}", ran.out);
        let json = std::fs::read_to_string(folder.path().join("all.json")).expect("written");
        let all: serde_json::Value = serde_json::from_str(&json).expect("JSON");
        let facts = |record: &serde_json::Value| {
            let path = &record["paths"][0];
            let subject = &record["subject"];
            let facts = [
                &subject["function"],
                &subject["seed"],
                &subject["location"],
                &record["verdict"],
                &path["cases"],
                &path["failures"],
            ];
            facts.map(ToString::to_string)
        };
        let mut facts: Vec<_> =
            all["records"].as_array().expect("records").iter().map(facts).collect();
        facts.sort();
        facts
    };
    let (mut together, mut alone) = (run("vulkan"), run("cpu"));
    // A loop that the driver leaves early is an error on this driver.
    for facts in [&mut together, &mut alone] {
        let long = facts.iter().position(|facts| facts[0].contains("long")).expect("it ran");
        assert_ne!(facts.remove(long)[3], "\"pass\"");
    }
    assert_eq!(together, alone);
    assert!(
        together.iter().any(|facts| facts[0].contains("good3") && facts[4] == "4096"),
        "{together:?}"
    );
}

/// Karat removes the tests from a module before the module is listed, validated, shown or drawn.
#[test]
fn tests_are_stripped_from_what_is_drawn_and_listed() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let text = format!(
        "import karat::expect_true;\n{BRDF}@test fn own() {{ expect_true(blend(1.0, 2.0) == 2.0); }}\n"
    );
    write(folder.path(), "brdf.wgsl", &text);
    cpu(folder.path(), &[]).good();
    let list = karat(folder.path(), &["list", "--shaders", "."]).good();
    assert!(list.contains("blend") && !list.contains("own"), "{list}");
    karat(folder.path(), &["check", "--shaders", "."]).good();
    let show = karat(folder.path(), &["show", "brdf::blend", "--shaders", "."]).good();
    assert!(!show.contains("karat::") && !show.contains("own"), "{show}");
}

/// Karat ends a test that runs forever, and reports its line. The other tests get their verdicts.
#[test]
fn a_runaway_test_is_stopped() {
    let folder = folder();
    write(
        folder.path(),
        "slow_test.wgsl",
        "import karat::expect_true;\n@test fn slow() {\n    var x = 1.0;\n    \
         loop {\n        x += 1.0;\n        if x < 0.0 { break; }\n    }\n    \
         expect_true(x > 0.0);\n}\n",
    );
    let ran = cpu(folder.path(), &[]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    assert!(ran.out.contains("slow_test.wgsl:4:5"), "{}", ran.out);
    assert!(ran.out.contains("11 checks, 1 failed"), "{}", ran.out);
}

/// After a run in the folder `shaders`, commands in the parent folder find the run's record, goldens and failures, even
/// if the commands don't name `shaders`.
#[test]
fn pending_and_goldens_are_found_from_the_parent_folder() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (path, shaders) = (folder.path(), folder.path().join("shaders"));
    let module = "fn half(x: f32) -> f32 { return 0.5 * x; }\n\
                  @fragment fn fs() -> @location(0) vec4f { return vec4f(0.5); }\n";
    write(&shaders, "a.wgsl", module);
    let declared = "[[test]]\nfunction = \"half\"\nover = { x = \"0..1\" }\nin_range = [0, 1]\n\n\
                    [[frame]]\nname = \"grey\"\nfragment = \"fs\"\nsize = [8, 8]\n";
    write(&shaders, "a.test.toml", declared);
    let ran = karat(path, &["test", "shaders", "--paths", "vulkan", "--github"]);
    assert!(ran.code == Some(1) && ran.out.contains("frame `grey` has no golden"), "{ran:?}");
    // The file and line of a frame are those of its declaration.
    let place = "file=shaders/a.test.toml,line=6,col=1,";
    assert!(ran.out.contains(place), "{ran:?}");
    let pending = karat(path, &["pending"]);
    assert!(pending.code == Some(3) && pending.out.contains("grey"), "{pending:?}");
    let accepted =
        karat(path, &["accept", "grey", "--any-adapter", "--because", "it is grey"]).good();
    assert_eq!(accepted, "accepted grey\n");
    karat(path, &["test", "--paths", "vulkan"]).good();
    let listed = karat(path, &["list"]).good();
    assert!(
        listed.lines().any(|line| line.contains("a::half") && line.contains("yes")),
        "{listed}"
    );
    assert!(karat(path, &["report"]).good().contains("a::half"));
    // A failure can be replayed from both folders.
    write(&shaders, "a.wgsl", &module.replace("0.5 * x", "1.5 * x"));
    let ran = karat(path, &["test", "shaders", "half", "--paths", "cpu"]);
    assert!(ran.code == Some(1), "{ran:?}");
    for from in [path, &shaders] {
        let again = karat(from, &["replay"]);
        assert!(again.code == Some(1) && again.out.contains("1 of 1 case fails"), "{again:?}");
    }
    // After a later run in the parent folder, commands use this folder.
    write(path, "own.wgsl", "@test fn own() { karat::expect_true(true); }\n");
    let misspelt = karat(path, &["test", "shader", "--paths", "cpu"]).err;
    assert!(misspelt.contains("did you mean `shaders`?"), "{misspelt}");
    let misspelt = karat(path, &["test", "a::halv", "--paths", "cpu"]).err;
    assert!(misspelt.contains("did you mean `a::half`?"), "{misspelt}");
    let without = karat(path, &["test", "--paths", "cpu"]);
    assert!(
        without.out.contains("Karat didn't run 1 test outside of `shaders`; `karat test .`"),
        "{without:?}"
    );
    karat(path, &["test", ".", "own", "--paths", "cpu"]).good();
    assert!(karat(path, &["report"]).good().contains("own::own"));
}

#[test]
fn a_declared_frame_is_compared_with_its_golden() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let shader = "struct Tint { color: vec3f, gain: f32 }\n\
        @group(0) @binding(0) var<uniform> tint: Tint;\n\
        @vertex fn vs(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {\n    \
        return vec4f(f32(i & 1u) * 4.0 - 1.0, f32(i >> 1u) * 4.0 - 1.0, 0.0, 1.0);\n}\n\
        @fragment fn fs(@builtin(position) p: vec4f) -> @location(0) vec4f {\n    \
        return vec4f(tint.color * tint.gain * p.x / 32.0, 1.0);\n}\n";
    write(folder.path(), "grad.wgsl", shader);
    let declared = |with: &str| {
        let text = format!(
            "[[frame]]\nname = \"gradient\"\nvertex = \"vs\"\nfragment = \"fs\"\nsize = [32, 16]\n\
             with = {{ {with} }}\n"
        );
        write(folder.path(), "grad.test.toml", &text);
        karat(folder.path(), &["test", ".", "--paths", "vulkan"])
    };
    let tint = "tint = { color = [1.0, 0.5, 0.25], gain = 2 }";
    let missing = declared(tint);
    assert_eq!(missing.code, Some(1), "{missing:?}");
    assert!(missing.out.contains("frame `gradient` has no golden"), "{missing:?}");
    assert!(!missing.err.contains("panicked"), "{missing:?}");
    karat(folder.path(), &["accept", "gradient", "--any-adapter", "--because", "it is the first"])
        .good();
    assert!(declared(tint).good().contains("1 check, 0 failed"));
    let brighter = declared("tint = { color = [1.0, 0.5, 0.25], gain = 3 }");
    assert_eq!(brighter.code, Some(1), "{brighter:?}");
    for (with, part) in [
        ("tint = { color = [1.0, 0.5, 0.25], gian = 2 }", "did you mean `gain`?"),
        ("tent = 1", "did you mean `tint`?"),
        ("tint = { color = [1.0, 0.5], gain = 2 }", "has 3 components"),
    ] {
        let ran = declared(with);
        assert!(ran.code != Some(0) && ran.out.contains(part), "{ran:?}");
        assert!(ran.out.contains("grad.test.toml:6:10"), "the resource's place: {ran:?}");
    }
    // The test runs singly, with the same result.
    let alone = format!(
        "[[frame]]\nname = \"gradient\"\nfragment = \"fs\"\nsize = [32, 16]\nsamples = 4\n\
         with = {{ {tint} }}\n"
    );
    write(folder.path(), "grad.test.toml", &alone);
    karat(folder.path(), &["test", ".", "--paths", "vulkan"]).good();
    let left_out = karat(folder.path(), &["test", ".", "--no-frames"]);
    assert_ne!(left_out.code, Some(0), "nothing is compared: {left_out:?}");
}

/// A test in TOML can compare a function's results with a golden: one CSV file that also contains the provenance.
#[test]
fn declared_values_are_compared_with_their_golden() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let folder = folder.path();
    let tone = |gain: &str| {
        write(folder, "tone.wgsl", &format!("fn tone(x: f32) -> f32 {{ return x * {gain}; }}\n"));
    };
    let declare = |more: &str| {
        let text = format!(
            "[[test]]\nfunction = \"tone\"\nover = {{ x = \"0..4\" }}\ngolden = \"tone/linear\"\n{more}"
        );
        write(folder, "tone.test.toml", &text);
    };
    let run = || karat(folder, &["test", ".", "--paths", "cpu"]);
    tone("0.5");
    declare("");
    let ran = run();
    assert!(ran.code == Some(1) && ran.out.contains("a tolerance is missing"), "{ran:?}");
    declare("cases = 20\ntolerance = \"exact\"\n");
    let missing = run();
    assert_eq!(missing.code, Some(1), "{missing:?}");
    assert!(missing.out.contains("the values `tone/linear` have no golden"), "{missing:?}");
    let pending = karat(folder, &["pending"]);
    assert_eq!(pending.code, Some(3), "{pending:?}");
    assert!(pending.out.contains("20 rows") && pending.out.contains("cpu: "), "{pending:?}");
    // Karat's engine returns the same values on each machine.
    karat(folder, &["accept", "tone/*", "--any-adapter", "--because", "it is linear"]).good();
    assert!(run().good().contains("1 check, 0 failed"));
    let golden = folder.join("golden/tone/linear.csv");
    assert!(golden.is_file() && !golden.with_extension("toml").exists());
    let unreferenced = |goldens: &str, rest: &str| {
        let ran = karat(folder, &["unreferenced", "--record", ".karat/run/record"]);
        assert!(ran.out.contains(&format!("{goldens} compared, {rest}")), "{ran:?}");
    };
    unreferenced("1 golden", "0 unreferenced, 0 stray");
    // Other commands can read the golden as a table.
    let call = ["call", "tone", "--table", "golden/tone/linear.csv", "--tolerance", "exact"];
    let call = [&call[..], &["--expect", "result", "--shaders", "tone.wgsl"]].concat();
    karat(folder, &call).good();

    tone("0.25");
    let differs = run();
    assert_eq!(differs.code, Some(1), "{differs:?}");
    assert!(differs.out.contains("rows on cpu"), "{differs:?}");
    assert_eq!(karat(folder, &["pending"]).code, Some(1));
    assert_ne!(karat(folder, &call).code, Some(0), "nor does it agree there");
    karat(folder, &["reject", "tone/linear"]).good();
    assert!(karat(folder, &["pending"]).good().contains("nothing is pending"));
    std::fs::copy(&golden, folder.join("golden/tone/other.csv")).expect("copied");
    tone("0.5");
    run().good();
    unreferenced("1 golden", "1 unreferenced");
    let delete = ["unreferenced", "--record", ".karat/run/record", "--delete"];
    karat(folder, &delete).good();
    assert!(golden.is_file() && !folder.join("golden/tone/other.csv").exists());
}

/// If a test doesn't compare a target that the frame draws, the message says how to compare this target.
#[test]
fn declared_frames_have_targets_formats_and_overrides() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let folder = folder.path();
    let shader = "override GAIN: f32;\nstruct Out { @location(0) a: vec4f, @location(1) b: f32, @builtin(frag_depth) d: f32 }\n\
        @fragment fn fs(@location(0) uv: vec2f) -> Out { return Out(vec4f(uv * GAIN, 0.0, 1.0), uv.y, uv.x); }\n";
    write(folder, "g.wgsl", shader);
    let declare = |frames: &[&str]| {
        let head = "fragment = \"fs\"\nsize = [8, 8]\n";
        let all: Vec<String> =
            frames.iter().map(|more| format!("[[frame]]\n{head}{more}\n")).collect();
        write(folder, "g.test.toml", &all.concat());
        karat(folder, &["test", ".", "--paths", "vulkan"])
    };
    let formats = "formats = [\"float\", \"rgba8unorm-srgb\"]";
    for (more, part) in [
        ("override = { GAIN = 2 }", "add `formats` with a format for each location"),
        ("override = { GAIN = 2 }", "sets `target` to 1"),
        ("", "`override` in a test file"),
        ("override = { GIAN = 2 }", "no override `GIAN`; did you mean `GAIN`?"),
        ("formats = [\"float\", \"rgba8\"]", "no format `rgba8`"),
        ("target = 1\ndepth = true", "`target` and `depth` exclude each other"),
    ] {
        let ran = declare(&[&format!("name = \"a\"\n{more}")]);
        assert!(ran.code == Some(1) && ran.out.contains(part), "no `{part}` in {ran:?}");
    }
    let twice = declare(&["name = \"a\"", "name = \"a\""]);
    assert!(
        twice.code == Some(1) && twice.out.contains("another frame has the name `a`"),
        "{twice:?}"
    );
    let all = |gain: u32| {
        let own = format!(
            "override = {{ GAIN = {gain} }}\n{}",
            formats.replace("rgba8unorm-srgb", "r8unorm")
        );
        let named = |name: &str, more: &str| format!("name = \"{name}\"\n{more}\n{own}");
        let [a, b, d] = [named("a", ""), named("b", "target = 1"), named("d", "depth = true")];
        declare(&[&a, &b, &d])
    };
    assert_eq!(all(2).code, Some(1), "no golden");
    karat(folder, &["accept", "*", "--any-adapter", "--because", "the first"]).good();
    assert!(all(2).good().contains("3 checks, 0 failed"));
    let changed = all(3);
    assert!(changed.out.contains("3 checks, 1 failed"), "{changed:?}");
    for (from, to) in [("uv.y, uv.x", "uv.x, uv.x"), ("uv.y, uv.x", "uv.y, uv.y")] {
        write(folder, "g.wgsl", &shader.replace(from, to));
        let ran = all(2);
        assert!(ran.out.contains("3 checks, 1 failed"), "{to}: {ran:?}");
    }
}

/// The test sets an override for the tested function. The comparison works even if the reference lacks this override.
#[test]
fn a_reference_function_may_lack_the_override_that_a_test_sets() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let folder = folder.path();
    let shader = "override GAIN: f32 = 1.0;\nfn gain(x: f32) -> f32 { return x * GAIN; }\n\
                  fn twice(x: f32) -> f32 { return 2.0 * x; }\n";
    write(folder, "m.wgsl", shader);
    let run = |name: &str, value: &str| {
        let text = format!(
            "[[test]]\nfunction = \"gain\"\nover = {{ x = \"0..1\" }}\nagrees_with = \"twice\"\n\
             tolerance = \"exact\"\noverride = {{ {name} = {value} }}\n"
        );
        write(folder, "m.test.toml", &text);
        cpu(folder, &[])
    };
    run("GAIN", "2").good();
    assert_eq!(run("GAIN", "3").code, Some(1), "it isn't ignored");
    let unknown = run("GIAN", "2");
    assert!(unknown.out.contains("did you mean `GAIN`?"), "{unknown:?}");
}

/// Runs `karat record` with `karat suite` as the test runner.
fn recorded(folder: &FilePath, options: &[&str], tests: &[&str]) -> Ran {
    let runner = env!("CARGO_BIN_EXE_karat");
    let arguments = [&["record"], options, &["--", runner, "suite", "."], tests].concat();
    output(command(folder, &arguments).env("KARAT_PATHS", "cpu"))
}

#[test]
fn record_keeps_a_run_of_another_test_runner() {
    let folder = folder();
    let ran = recorded(folder.path(), &[], &[]).good();
    assert!(ran.contains("10 checks, 0 failed"), "{ran}");
    let again = karat(folder.path(), &["report"]).good();
    assert!(again.contains("10 checks, 0 failed"), "{again}");
    write(folder.path(), "brdf.wgsl", &BRDF.replace("(x * x * x * x * x)", "(x * x)"));
    let failed = recorded(folder.path(), &["--short"], &[]);
    assert_eq!(failed.code, Some(1), "{failed:?}");
    assert!(failed.out.contains("brdf.wgsl:2:"), "{failed:?}");
    let runner = env!("CARGO_BIN_EXE_karat");
    for (command, part) in [
        (&["record", "--", runner, "--version"][..], "no test ran a check"),
        (&["record", "--", "./no-such-runner"], "can't run `./no-such-runner`"),
        (&["record"], "<COMMAND>"),
        (&["record", "--into", "brdf.wgsl", "--", runner, "--version"], "brdf.wgsl"),
    ] {
        let ran = karat(folder.path(), command);
        assert!(ran.code == Some(2) && ran.err.contains(part), "{ran:?}");
    }
}

#[test]
fn merged_records_of_another_runner_equal_its_whole_run() {
    let folder = folder();
    let record = |name: &str, tests: &[&str]| {
        recorded(folder.path(), &["--into", name], tests).good();
    };
    record("whole", &[]);
    record("p1", &["schlick"]);
    record("p2", &["lambert"]);
    record("p3", &["blend"]);
    // The table finds tests in WGSL by the functions that they call. Some ran in two parts.
    let table = |options: &[&str]| {
        let ran = karat(folder.path(), &[&["report", "--all"], options].concat()).good();
        // On a busy machine, Karat may list a slow check.
        let own =
            |line: &&str| ["record: ", "slowest: "].iter().all(|head| !line.starts_with(head));
        ran.lines().filter(own).map(str::to_owned).collect::<Vec<_>>().join("\n")
    };
    let whole = table(&["--record", "whole"]);
    assert!(whole.contains("10 checks"), "{whole}");
    record("p4", &["table"]);
    assert_eq!(table(&["--merge", "p3", "p1", "p4", "p2"]), whole);
    assert_ne!(table(&["--merge", "p1", "p2"]), whole);
    let same = karat(folder.path(), &["report", "--merge", "p1", "p2", "./p1"]).error();
    assert!(same.contains("--merge names `./p1` twice"), "{same}");
    let twice = recorded(folder.path(), &["--into", "p1"], &["schlick"]);
    assert!(twice.code == Some(2) && twice.err.contains("`p1` isn't empty"), "{twice:?}");
}

/// The tests of a folder are only a part of a Cargo project's tests, so `karat unreferenced` refuses to judge the
/// project's goldens by such a run.
#[test]
fn a_run_of_one_folder_of_a_cargo_project_is_incomplete() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(
        folder.path(),
        "Cargo.toml",
        "[package]\nname = \"engine\"\nversion = \"0.1.0\"\nedition = \"2024\"\n[workspace]\n",
    );
    for place in ["src", "golden", "shaders"] {
        std::fs::create_dir(folder.path().join(place)).expect("a folder");
    }
    write(folder.path(), "src/lib.rs", "");
    write(folder.path(), "shaders/brdf.wgsl", BRDF);
    write(folder.path(), "shaders/brdf_test.wgsl", TESTS);
    karat(folder.path(), &["test", "shaders", "--paths", "cpu"]).good();
    let refused = karat(folder.path(), &["unreferenced"]).failure(3);
    assert!(refused.contains("the last run ran only some tests (`shaders`)"), "{refused}");
}

/// If a test sets a tolerance for integers, the message explains why the tolerance has no effect.
#[test]
fn integers_have_no_tolerance() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "m.wgsl", "fn next(i: u32) -> u32 { return i + 2u; }\n");
    let declared =
        "[[test]]\nfunction = \"next\"\nover = { i = 0 }\nequals = 1\ntolerance = \"abs 1\"\n";
    write(folder.path(), "m.test.toml", declared);
    let failed = cpu(folder.path(), &[]);
    assert_eq!(failed.code, Some(1), "{failed:?}");
    assert!(failed.out.contains("not equal: tolerances are only for floats"), "{failed:?}");
    // WGSL allows only one result, and the driver's result is another.
    assert!(!failed.out.contains("anything"), "{failed:?}");
}

/// For each key, Karat rounds a decimal such as `0.3` to the same `f32` as WGSL does. Each check fails if the shader
/// uses the next larger `f32`.
// Lesson 170
#[test]
fn declared_decimals_are_rounded_as_in_wgsl() {
    const TEXT: &str = "fn third() -> f32 { return 0.3; }\n\
        fn same(x: f32) -> f32 { return 0.3 + x; }\n\
        fn stepped(x: f32) -> f32 { return select(0.3, 0.5, abs(x) > 0.05); }\n\
        fn turn() -> f32 { return 3.14159265358979; }\n\
        fn both() -> vec2f { return vec2f(0.3, 0.1); }\n\
        fn glow(n: vec3f) -> f32 { return 0.3 + 0.0 * n.x; }\n";
    const DECLARED: &str = "[[test]]\nfunction = \"third\"\nequals = 0.3\ntolerance = \"exact\"\n\
        [[test]]\nfunction = \"both\"\nequals = [0.3, 0.1]\ntolerance = \"exact\"\n\
        [[test]]\nfunction = \"turn\"\nequals = 3.14159265358979\ntolerance = \"exact\"\n\
        [[test]]\nname = \"ends\"\nfunction = \"third\"\nin_range = [0.3, 0.3]\n\
        [[test]]\nname = \"rows\"\nfunction = \"same\"\ntable = \"rows.csv\"\ntolerance = \"exact\"\n\
        [[test]]\nname = \"near\"\nfunction = \"stepped\"\ntolerance = \"exact\"\n\
        limit = { x = 0, through = [0.1, 0.01], equals = 0.3 }\n\
        [[test]]\nname = \"light\"\nfunction = \"glow\"\ntolerance = \"1 ulp\"\n\
        integral = { over = \"sphere\", equals = 3.7699113 }\n";
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "own.wgsl", TEXT);
    write(folder.path(), "own.test.toml", DECLARED);
    write(folder.path(), "rows.csv", "x,result\n0,0.3\n");
    let ran = cpu(folder.path(), &[]);
    assert!(ran.out.contains("0 failed"), "{ran:?}");
    write(folder.path(), "own.wgsl", &TEXT.replace("0.3", "0.30000004"));
    let ran = cpu(folder.path(), &[]);
    assert_eq!(
        ran.out.matches("... FAILED").count(),
        6,
        "all but `turn`, which has no 0.3: {ran:?}"
    );
}

/// The README's first test prints the output that the README shows.
#[test]
fn the_readme_shows_what_its_first_test_says() {
    let readme = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../README.md"));
    let readme = readme.expect("the repository's");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut files = 0;
    for (before, block) in readme.split("```wgsl\n").zip(readme.split("```wgsl\n").skip(1)) {
        let text = block.split("```").next().unwrap_or_default();
        let name = before.trim_end().trim_end_matches("`:").rsplit('`').next().expect("a name");
        let path = folder.path().join(name);
        write(
            path.parent().expect("a folder"),
            &path.file_name().expect("a name").to_string_lossy(),
            text,
        );
        files += 1;
    }
    assert_eq!(files, 2, "a shader and its test");
    let ran = karat(folder.path(), &["test", "shaders", "--paths", "cpu"]);
    let shown = readme.split("```text\n").nth(1).and_then(|rest| rest.split("```").next());
    let shown = shown.expect("what it prints");
    let lines: Vec<&str> = ran.out.lines().map(str::trim).collect();
    // Skips the line with the driver, which differs between machines.
    for line in shown.lines().map(str::trim).filter(|line| !line.starts_with("on ")) {
        assert!(lines.contains(&line), "`{line}` isn't in {}", ran.out);
    }
    assert!(shown.lines().count() > 5, "{shown}");
}

/// If a test gives a buffer only its size, the buffer may contain any data in a real program. If a pass reads such data
/// before any pass writes it, and results depend on the data, Karat counts the words that were read.
// Lesson 221
#[test]
fn unwritten_words_are_counted() {
    let shader = "@group(0) @binding(0) var<storage, read> values: array<f32>;
@group(0) @binding(1) var<storage, read_write> parts: array<f32>;
@group(0) @binding(2) var<storage, read_write> total: array<f32>;
@group(0) @binding(3) var<storage, read_write> counts: array<atomic<u32>>;
@group(0) @binding(4) var<storage, read_write> fixed: array<f32, 4>;
@compute @workgroup_size(4) fn some(@builtin(local_invocation_index) i: u32) { if i < 3u { parts[i] = values[i]; } }
@compute @workgroup_size(4) fn all(@builtin(local_invocation_index) i: u32) { parts[i] = values[i]; }
@compute @workgroup_size(1) fn sum() { total[0] = parts[0] + parts[1] + parts[2] + parts[3]; }
@compute @workgroup_size(1) fn given_up() { total[0] = select(parts[3], 6.0, values[0] > 0.0); }
@compute @workgroup_size(1) fn own() { total[0] += values[0]; }
@compute @workgroup_size(4) fn count(@builtin(local_invocation_index) i: u32) { atomicAdd(&counts[i / 2u], 1u); }
@compute @workgroup_size(1) fn of_fixed() { fixed[0] = 1.0; total[0] = fixed[0] + fixed[1] + values[0]; }
";
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "m.wgsl", shader);
    let run = |passes: &str, with: &str, after: &str| {
        let declared = format!(
            "[[compute]]\npasses = [{passes}]\nwith = {{ {with} }}\n[compute.after.{after}]\nin_range = [0, 99]\n"
        );
        write(folder.path(), "m.test.toml", &declared);
        cpu(folder.path(), &[]).out
    };
    let values = "values = [1, 2, 3, 0]";
    let sized = format!("{values}, parts = {{ size = 4 }}, total = {{ size = 1 }}");
    let cleared = format!("{values}, parts = {{ size = 4, value = 0 }}, total = {{ size = 1 }}");
    let one = |name: &str| format!("{{ entry = \"{name}\", workgroups = 1 }}");
    let two = |first: &str, second: &str| format!("{}, {}", one(first), one(second));
    for (passes, with, after, read) in [
        (two("some", "sum"), sized.clone(), "total", Some("`parts[3]` at m.wgsl:8:84")),
        (two("all", "sum"), sized.clone(), "total", None),
        (two("some", "sum"), cleared, "total", None),
        (two("some", "given_up"), sized, "total", None),
        (
            one("own"),
            format!("{values}, total = {{ size = 1 }}"),
            "total",
            Some("`total[0]` at m.wgsl:10:"),
        ),
        (one("own"), format!("{values}, total = [0]"), "total", None),
        (
            one("count"),
            "counts = { size = 2 }".to_owned(),
            "counts",
            Some("`counts[0]` at m.wgsl:11:"),
        ),
        (one("count"), "counts = { size = 2, value = 0 }".to_owned(), "counts", None),
        (one("count"), "counts = { size = 2, range = \"0..3\" }".to_owned(), "counts", None),
        (
            one("of_fixed"),
            format!("{values}, fixed = {{}}, total = {{ size = 1 }}"),
            "total",
            Some("`fixed[1]` at m.wgsl:12:"),
        ),
        (
            one("of_fixed"),
            format!("{values}, fixed = [0, 0, 0, 0], total = {{ size = 1 }}"),
            "total",
            None,
        ),
    ] {
        let out = run(&passes, &with, after);
        match read {
            Some(read) => {
                let expected = format!("1 line reads elements that no pass has written: {read}");
                assert!(out.contains(&expected), "{passes} {with}: {out}");
                assert!(out.contains("add `value = 0` beside `size`"), "{out}");
            }
            None => assert!(!out.contains("no pass has written"), "{passes} {with}: {out}"),
        }
        assert!(out.contains("1 check, 0 failed"), "{passes} {with}: {out}");
    }
    let both = run(&one("count"), "counts = { size = 2, value = 0, range = \"0..3\" }", "counts");
    assert!(both.contains("elements can't have both a `value` and a `range`"), "{both}");
}
