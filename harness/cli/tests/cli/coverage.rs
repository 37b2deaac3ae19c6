//! Tests `karat coverage`.

use std::process::Command;

use super::*;
use crate::repository::git;

const SHADER: &str = "fn side(x: f32) -> f32 {
    if (x > 0.0) {
        return 2.0 * x;
    }
    return -x;
}

fn lonely(x: f32) -> f32 {
    return x + 1.0;
}

fn looked_at(x: f32) -> f32 {
    let unused = x * 3.0;
    return x + 4.0;
}

@fragment fn shade() -> @location(0) vec4f {
    return vec4f(side(1.0));
}
";

const TESTS: &str = "[[test]]\nfunction = \"side\"\nover = { x = \"1..2\" }\nfinite = true\n\
                     [[test]]\nfunction = \"looked_at\"\nover = { x = 2 }\nequals = 6\ntolerance = \"1 ulp\"\n";

/// A test that calls `side` and ignores the result.
const WGSL_TEST: &str = "import karat::expect_true;\nimport package::calc::side;\n\
                         @test fn throws_away() {\n    let gone = side(-1.0);\n    expect_true(true);\n}\n";

fn folder() -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(&folder.path().join("shaders"), "calc.wgsl", SHADER);
    write(&folder.path().join("shaders"), "calc.test.toml", TESTS);
    write(&folder.path().join("shaders"), "calc_test.wgsl", WGSL_TEST);
    folder
}

// Lesson 28: lines, branches and results that no test compares
#[test]
fn uncovered_lines_branches_and_results_are_listed() {
    let folder = folder();
    let ran = karat(folder.path(), &["coverage", "--missing"]);
    let out = ran.good();
    for part in [
        "calc.wgsl",
        "9 no test runs this code in `calc::lonely`",
        "13 no test checks the value of this code in `calc::looked_at`",
        "18 no test runs this code in `calc::shade`",
        "lines 71.4% (5 of 7), outcomes of branches 100% (2 of 2), functions 50% (2 of 4) by 3 tests",
    ] {
        assert!(out.contains(part), "no `{part}` in:\n{out}");
    }
    // Only a test that discards the result runs `-x`.
    assert!(out.contains("5 no test checks the value of this code in `calc::side`"), "{out}");
    assert!(out.contains("no test checks the value of 2 lines"), "{out}");
    assert!(!out.contains("calc_test"), "tests aren't tested: {out}");
    assert_eq!(karat(folder.path(), &["coverage", "--fail-under-lines", "71"]).code, Some(0));
    let few = karat(folder.path(), &["coverage", "--fail-under-lines", "80"]);
    assert_eq!(few.code, Some(1));
    assert!(few.out.contains("the options require that 80% of lines run"), "{few:?}");
    // A filter runs some of the tests, and the counts show this.
    let part = karat(folder.path(), &["coverage", "--tests", "looked_at"]).good();
    assert!(part.contains("lines 28.5% (2 of 7)") && part.contains("by 1 test"), "{part}");
    let record = folder.path().join("shaders/.karat/run/record");
    assert!(record.is_dir() && !record.join("last").exists(), "it isn't the last run");
}

/// A value counts as checked if an assertion reads it, but not if only a print reads it.
// Lesson 209
#[test]
fn a_value_that_an_assertion_reads_is_covered() {
    let folder = folder();
    let test = "[[test]]\nfunction = \"watched\"\nover = { x = 2 }\nfinite = true\n";
    for (line, seen) in [("assert own < 9.0", true), ("print own", false)] {
        let shader = format!(
            "fn watched(x: f32) -> f32 {{\n    let own = x * 3.0;\n    //karat: {line}\n    return x;\n}}\n"
        );
        write(&folder.path().join("shaders"), "watched.wgsl", &shader);
        write(&folder.path().join("shaders"), "watched.test.toml", test);
        let out = karat(folder.path(), &["coverage", "--missing"]).good();
        let unseen = out.contains("2 no test checks the value of this code in `watched::watched`");
        assert_eq!(unseen, !seen, "{line}:\n{out}");
    }
}

/// The program `lcov` can read the file that `karat coverage --lcov` writes, and prints the expected sums.
#[test]
fn the_program_lcov_reads_the_report_with_equal_sums() {
    let folder = folder();
    karat(folder.path(), &["coverage", "--lcov", "lcov.info"]).good();
    let text = std::fs::read_to_string(folder.path().join("lcov.info")).expect("it is written");
    // The file has a record for the whole run, and a record for each test.
    let names: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix("TN:")).collect();
    assert_eq!(
        names,
        ["", "calc__looked_at_equals", "calc__side_finite", "calc_test__throws_away"],
        "{text}"
    );
    assert_eq!(text.matches("end_of_record").count(), 4);
    let side = text.split("TN:").nth(3).expect("the third record");
    for line in ["DA:2,65536", "DA:3,65536", "DA:5,0", "BRDA:2,0,0,65536", "BRDA:2,0,1,0"] {
        assert!(side.lines().any(|own| own == line), "no `{line}` in:\n{side}");
    }
    let summary = Command::new("lcov")
        .args(["--rc", "lcov_branch_coverage=1", "--summary", "lcov.info"])
        .current_dir(folder.path())
        .output();
    let Ok(summary) = summary else {
        // `cargo ci setup` installs `lcov` in CI.
        assert!(!cfg!(target_os = "linux") || std::env::var_os("CI").is_none(), "CI has lcov");
        return;
    };
    let both = [summary.stdout, summary.stderr].concat();
    let said = String::from_utf8_lossy(&both);
    for part in ["71.4% (5 of 7 lines)", "50.0% (2 of 4 functions)", "100.0% (2 of 2 branches)"] {
        assert!(said.contains(part), "no `{part}` in:\n{said}");
    }
}

/// A variant is a set of features and overrides. The report has a row for each variant, and a sum of all variants.
#[test]
fn coverage_is_counted_for_each_variant_and_for_all() {
    let folder = folder();
    let scaled = "override SCALE: f32 = 1.0;\nfn scaled(x: f32) -> f32 {\n    if (SCALE > 1.5) {\n        return x * SCALE;\n    }\n    return x;\n}\n";
    write(&folder.path().join("shaders"), "scaled.wgsl", scaled);
    let test = |scale: &str, equals: u32| {
        format!(
            "[[test]]\nfunction = \"scaled\"\n{scale}over = {{ x = 2 }}\nequals = {equals}\ntolerance = \"1 ulp\"\n"
        )
    };
    let tests = test("", 2) + &test("override = { SCALE = 2 }\n", 4);
    write(&folder.path().join("shaders"), "scaled.test.toml", &tests);
    let ran = karat(folder.path(), &["coverage", "--missing"]);
    assert_eq!(ran.code, Some(0), "{ran:?}");
    assert!(ran.out.contains("lines 80% (8 of 10), outcomes of branches 100% (4 of 4)"), "{ran:?}");
    let row = |name: &str| {
        let line = ran.out.lines().find(|line| line.starts_with(name)).unwrap_or_default();
        line.split_whitespace().rev().take(2).map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!([row("no feature"), row("SCALE=2")], [["6", "7"], ["1", "2"]], "{ran:?}");
}

/// The page shows how often each line ran, and the first input with which each test reached the line.
#[test]
fn the_coverage_page_shows_which_tests_reach_a_line() {
    let folder = folder();
    karat(folder.path(), &["coverage", "--html", "page.html"]).good();
    let page = std::fs::read_to_string(folder.path().join("page.html")).expect("it is written");
    for part in [
        "<details class=\"line never\"><summary><span class=\"number\">9</span><span class=\"count\">0</span>",
        "<details class=\"line weak\"><summary><span class=\"number\">5</span><span class=\"count\">1</span>",
        "calc::looked_at equals: 1, first for <code>x = 2</code>",
        "true: 65536",
    ] {
        assert!(page.contains(part), "no `{part}` in:\n{page}");
    }
}

#[test]
fn coverage_in_a_diff_counts_only_edited_lines() {
    let folder = folder();
    let at = folder.path();
    git(at, &["init", "--quiet"]);
    git(at, &["add", "."]);
    git(at, &["commit", "--quiet", "--message", "first"]);
    let none = karat(at, &["coverage", "--in-diff", "HEAD", "--fail-under-lines", "100"]);
    assert_eq!(none.code, Some(0), "{none:?}");
    write(&at.join("shaders"), "calc.wgsl", &SHADER.replace("x + 1.0", "x + 9.0"));
    let edited = karat(at, &["coverage", "--in-diff", "HEAD", "--fail-under-lines", "50"]);
    assert_eq!(edited.code, Some(1));
    assert!(edited.out.contains("lines 0% (0 of 1)"), "{edited:?}");
}

/// If the engine doesn't draw a frame, the frame's functions are unmeasured, not uncovered.
// Lesson 209
#[test]
fn functions_of_frames_are_not_measured() {
    let folder = folder();
    let frame =
        format!("{TESTS}[[frame]]\nname = \"shade\"\nfragment = \"shade\"\nsize = [4, 4]\n");
    write(&folder.path().join("shaders"), "calc.test.toml", &frame);
    let out = karat(folder.path(), &["coverage", "--missing"]).good();
    assert!(!out.contains("18 no test runs this code"), "{out}");
    assert!(
        out.contains("1 line not measured: this code ran only in frames or on drivers"),
        "{out}"
    );
    assert!(out.contains("9 no test runs this code in `calc::lonely`"), "{out}");
}

/// If a command gets only one shader file, the tests in other files of the folder don't run, and the output names these
/// files.
#[test]
fn tests_beside_a_file_are_named() {
    let folder = folder();
    let beside = "the tests in `shaders/calc_test.wgsl` didn't run: name the folder, not the file";
    for verb in ["test", "coverage", "mutate"] {
        let ran = karat(folder.path(), &[verb, "shaders/calc.wgsl"]);
        assert!(format!("{}{}", ran.out, ran.err).contains(beside), "{verb}: {ran:?}");
        let whole = karat(folder.path(), &[verb, "shaders"]);
        assert!(
            !format!("{}{}", whole.out, whole.err).contains("didn't run:"),
            "{verb}: {whole:?}"
        );
    }
}

/// `karat coverage` fails if a test fails, if the path can't count lines, or if the filter matches no test.
// Lesson 28: lines, branches and results that no test compares
#[test]
fn coverage_is_refused_if_tests_fail_or_none_runs() {
    let folder = folder();
    let path = karat(folder.path(), &["coverage", "--paths", "vulkan"]);
    assert_eq!(path.code, Some(2));
    assert!(path.err.contains("the only path that counts lines"), "{path:?}");
    let none = karat(folder.path(), &["coverage", "--tests", "nothing_has_this_name"]);
    assert!(matches!(none.code, Some(2 | 3)), "{none:?}");
    write(
        &folder.path().join("shaders"),
        "calc.test.toml",
        &TESTS.replace("equals = 6", "equals = 5"),
    );
    let red = karat(folder.path(), &["coverage"]);
    assert_eq!(red.code, Some(1));
    assert!(red.out.contains("tests failed, see above"), "{red:?}");
    assert!(red.err.contains("calc::looked_at equals"), "{red:?}");
    // Karat counts invalid modules. A file that it can't write is an error.
    write(&folder.path().join("shaders"), "broken.wgsl", "fn f() -> f32 { return true; }\n");
    let broken = karat(folder.path(), &["coverage"]);
    assert!(broken.out.contains("1 module not valid: broken"), "{broken:?}");
    let unwritable = karat(folder.path(), &["coverage", "--lcov", "shaders/calc.wgsl/lcov.info"]);
    assert_eq!(unwritable.code, Some(2));
    assert!(unwritable.err.contains("can't write `shaders/calc.wgsl/lcov.info`"), "{unwritable:?}");
}
