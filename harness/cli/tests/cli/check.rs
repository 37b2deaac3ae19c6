//! Tests that `karat check` validates functions that no test calls.

use super::report::function;
use super::*;

/// A project in which a script replaces `cargo test`: the script records a passing check.
fn tested() -> TempDir {
    let project = project();
    let script = "mkdir -p \"$KARAT_RECORD\"\ncp verdict \"$KARAT_RECORD/1.jsonl\"\n";
    write(project.path(), "test", script);
    write(project.path(), "verdict", &function("calc::double", "gl", "pass", None));
    project
}

fn run_tests(project: &TempDir) -> Ran {
    output(command(project.path(), &["test"]).env("CARGO", "/bin/sh"))
}

// Lesson 53
#[test]
fn a_broken_entry_point_fails_check_list_and_test() {
    let project = tested();
    let out = karat(project.path(), &["check"]).good();
    assert!(out.contains("3 modules") && out.contains("1 entry point)"), "{out}");
    assert_eq!(run_tests(&project).code, Some(0));

    for (text, place) in [
        (
            "fn f() -> f32 { return 1.0; }\n@fragment fn main() -> @location(0) vec4f { return colr; }",
            "2:52",
        ),
        ("fn f() -> f32 {", "1:"),
        ("import package::calc::dubble;\nfn f() -> f32 { return 1.0; }", "1:23"),
    ] {
        write(project.path(), "shaders/debug.wgsl", text);
        let place = format!("shaders/debug.wgsl:{place}");
        for ran in [
            karat(project.path(), &["check"]),
            karat(project.path(), &["list"]),
            run_tests(&project),
        ] {
            assert_eq!(ran.code, Some(1), "{text}\n{ran:?}");
            assert!(ran.out.contains(&place), "{text}\n{}", ran.out);
        }
        // Valid functions are still listed and called.
        assert!(karat(project.path(), &["list"]).out.contains("calc::double"));
        karat(project.path(), &["call", "calc::double", "2"]).good();
    }
}

/// Karat validates each package that tests use, even if the package's folder isn't called `shaders`. An invalid module
/// in a folder that no test uses doesn't make the run fail.
#[test]
fn the_packages_that_tests_use_are_validated() {
    let project = tested();
    let used = |package: &str| {
        let verdict = function("calc::double", "gl", "pass", None);
        let own = format!("\"package\":\"{package}\"");
        write(project.path(), "verdict", &verdict.replace("\"package\":\"shaders\"", &own));
    };
    write(project.path(), "wgsl/calc.wgsl", "fn double(x: f32) -> f32 { return 2.0 * x; }");
    write(project.path(), "shaders/debug.wgsl", "fn f() -> f32 {");
    used("wgsl");
    assert_eq!(run_tests(&project).code, Some(0), "no test uses `shaders`");
    write(project.path(), "wgsl/debug.wgsl", "fn f() -> f32 { return colr; }");
    let ran = run_tests(&project);
    assert!(ran.code == Some(1) && ran.out.contains("wgsl/debug.wgsl:1:24"), "{ran:?}");
    used("shaders");
    assert_eq!(run_tests(&project).code, Some(1), "`shaders` isn't valid either");
}

#[test]
fn modules_that_need_features_say_so() {
    let project = tested();
    let debug = "@if(DEBUG) const SCALE = 2.0;\nfn f() -> f32 { return SCALE; }";
    write(project.path(), "shaders/debug/overlay.wgsl", debug);
    assert_eq!(karat(project.path(), &["check"]).code, Some(1));
    let manifest = |module: &str| {
        format!("[workspace]\n[workspace.metadata.karat.features]\n\"{module}\" = [\"DEBUG\"]\n")
    };
    write(project.path(), "Cargo.toml", &manifest("debug::overlay"));
    karat(project.path(), &["check"]).good();
    assert_eq!(run_tests(&project).code, Some(0));
    write(project.path(), "Cargo.toml", &manifest("debug::overlai"));
    let error = karat(project.path(), &["check"]).error();
    assert!(error.contains("did you mean `debug::overlay`?"), "{error}");
}

#[test]
fn a_package_of_nothing_is_no_success() {
    let project = tempfile::tempdir().expect("a folder");
    write(project.path(), "shaders/a.wgsl", "const A = 1;\n");
    let ran = karat(project.path(), &["check"]);
    assert!(ran.code == Some(1) && ran.out.contains("declares no function"), "{ran:?}");
    write(project.path(), "empty/readme", "");
    let ran = karat(project.path(), &["check", "--shaders", "empty"]);
    assert!(ran.code != Some(0), "{ran:?}");
}

/// The inputs, functions and rows that karat.toml names must exist in the package.
// Lesson 198
#[test]
fn names_in_karat_toml_are_those_of_the_package() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let text = "// A half of what was.\nstruct Params { groups: u32 }\n\
                @group(0) @binding(0) var<uniform> params: Params;\n\
                fn half(alpha: f32) -> f32 { return 0.5 * alpha * f32(params.groups); }\n";
    write(folder.path(), "shaders/calc.wgsl", text);
    let view = "const ONE = 1.0;\n@if(debug) fn shown(hidden: f32) -> f32 { return hidden; }\n";
    write(folder.path(), "shaders/view.wgsl", view);
    let check = |file: &str, declared: &str| {
        write(folder.path(), &format!("shaders/{file}"), declared);
        let ran = karat(folder.path(), &["check", "--shaders", "shaders"]);
        std::fs::remove_file(folder.path().join("shaders").join(file)).expect("it is there");
        ran
    };
    let hazard =
        |name: &str| format!("[[hazard]]\nfunctions = [\"{name}\"]\nreason = \"as planned\"\n");
    let row = |name: &str| {
        format!(
            "[[matrix]]\nrows = [\"{name}\"]\ncolumns = [\"gl\"]\nstatus = \"valid\"\nreason = \"x\"\n"
        )
    };
    for declared in [
        "[inputs]\nalpha = [0, 1]\nparams.groups = [1, 8]\n",
        &hazard("calc::half"),
        &hazard("calc::*"),
        &row("calc::half"),
        // The name exists only under another condition.
        &hazard("view::shown"),
        &hazard("view::*"),
        &row("view::shown"),
        "[inputs]\nhidden = [0, 1]\n",
    ] {
        check("karat.toml", declared).good();
    }
    for (declared, part) in [
        ("[inputs]\nalhpa = [0, 1]\n", "the input `alhpa` is declared, but nothing"),
        ("[inputs]\nparams.gruops = [1, 8]\n", "the input `params.gruops` is declared"),
        (
            &hazard("calc::hlaf"),
            "names `calc::hlaf`, but the package has no function of this name; did you mean",
        ),
        (&hazard("clac::*"), "names `clac::*`, but the package has no function of this name"),
        (&hazard("clac::half"), "names `clac::half`"),
        (&hazard("calc::was"), "names `calc::was`"),
        (&hazard("*"), "names `*`"),
        (&row("calc::*"), "names `calc::*`"),
        (&row("calc::hlaf"), "did you mean `calc::half`?"),
    ] {
        let ran = check("karat.toml", declared);
        assert!(ran.code == Some(2) && ran.err.contains(part), "{declared}: {ran:?}");
        assert!(ran.err.contains("shaders/karat.toml"), "{ran:?}");
    }
    let ran = check("Karat.toml", "[inputs]\nalpha = [0, 1]\n");
    assert!(ran.code == Some(2) && ran.err.contains("name must be `karat.toml`"), "{ran:?}");
}
