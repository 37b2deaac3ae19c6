//! `karat init`

use super::report::function;
use super::*;

/// In a project that depends on Karat what tests wait for is optimised; what somebody chose stays.
#[test]
fn a_project_gets_the_profiles_that_tests_need() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(&folder.path().join("shaders"), "a.wgsl", "fn f(u: f32) -> f32 { return 0.5 * u; }\n");
    let manifest = "[package]\nname = \"a\"\n\n[profile.dev.package]\nkarat.opt-level = 0";
    write(folder.path(), "Cargo.toml", manifest);
    let read = || std::fs::read_to_string(folder.path().join("Cargo.toml")).expect("it is there");
    // Of what isn't there Cargo would warn.
    karat(folder.path(), &["init", "shaders"]).good();
    assert_eq!(read(), manifest);
    write(folder.path(), "Cargo.lock", "[[package]]\nname = \"karat\"\n");
    let ran = karat(folder.path(), &["init", "shaders"]).good();
    assert!(ran.contains("added profiles of karat-engine, naga to Cargo.toml"), "{ran}");
    // Its Rust tests run in CI, too, and what they leave is kept.
    karat(folder.path(), &["init", "--github", "--gitlab"]);
    for file in [".github/workflows/karat.yml", ".gitlab-ci.karat.yml"] {
        let text = std::fs::read_to_string(folder.path().join(file)).expect("it is there");
        assert!(
            text.contains("- run: karat test --paths") || text.contains("- karat test --paths"),
            "{text}"
        );
        assert!(text.contains("target/karat") && !text.contains(".karat/run"), "{text}");
    }
    let now: toml::Table = read().parse().expect("TOML");
    let level = |name: &str| now["profile"]["dev"]["package"][name]["opt-level"].as_integer();
    assert_eq!(["karat", "karat-engine", "naga"].map(level), [Some(0), Some(3), Some(1)]);
    let written = read();
    karat(folder.path(), &["init", "shaders"]).good();
    assert_eq!(read(), written, "once");
}

#[test]
fn a_first_test_is_written_and_passes() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(
        &folder.path().join("shaders"),
        "brdf.wgsl",
        "fn broken(n_dot_l: f32) -> f32 { return log(-1.0 - n_dot_l); }\n\
         fn lambert(n_dot_l: f32) -> f32 { return n_dot_l * 0.31830987; }\n",
    );
    write(folder.path(), ".gitignore", "target");
    let ran = karat(folder.path(), &["init", "--github", "--gitlab"]).good();
    for part in [
        "wrote shaders/brdf.test.toml, a test of `brdf::lambert`",
        "added .karat/run/, *.new.exr, *.new.csv, *.new.png to .gitignore",
        "wrote .github/workflows/karat.yml",
        "wrote .gitlab-ci.karat.yml",
        "2 checks, 0 failed",
        "karat watch shaders",
    ] {
        assert!(ran.contains(part), "no `{part}` in {ran}");
    }
    let read = |file: &str| std::fs::read_to_string(folder.path().join(file)).expect(file);
    assert_eq!(read(".gitignore"), "target\n.karat/run/\n*.new.exr\n*.new.csv\n*.new.png\n");
    assert!(read("shaders/brdf.test.toml").contains("in_range = [0, 1]"));
    assert!(read(".github/workflows/karat.yml").contains("karat test shaders --paths vulkan"));
    // Broken, the first test is red.
    write(
        &folder.path().join("shaders"),
        "brdf.wgsl",
        "fn lambert(n_dot_l: f32) -> f32 { return n_dot_l / 0.31830987; }\n",
    );
    assert_eq!(karat(folder.path(), &["test", "shaders"]).code, Some(1));
    // A second time nothing is overwritten.
    write(
        folder.path(),
        "shaders/brdf.test.toml",
        "[[test]]\nfunction = \"lambert\"\nfinite = true\n",
    );
    let again = karat(folder.path(), &["init", "--github"]).good();
    assert!(
        again.contains("there are tests already") && again.contains("is there already"),
        "{again}"
    );
    assert!(!read("shaders/brdf.test.toml").contains("in_range"));
}

/// A project with Rust tests gets one of a function that they leave out, and keeps the record of its last run.
#[test]
fn what_rust_tests_check_is_left_to_them() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path();
    let module = "fn f(u: f32) -> f32 { return 0.5 * u; }\nfn g(u: f32) -> f32 { return 0.5 + u; }\n\
                  fn h(u: f32) -> f32 { return 0.5 - u; }\n";
    write(path, "shaders/a.wgsl", module);
    write(path, "Cargo.toml", "[package]\nname = \"a\"\n");
    write(path, ".gitignore", "/target\n.karat/\n*.new.exr\n*.new.csv\n");
    write(path, "tests/a.rs", "SHADERS.function(\"a::f\").over(0.0..=1.0).is_finite();\n");
    let record = path.join("target/karat/record");
    write(&record, "1.jsonl", &function("a::g", "cpu", "pass", None));
    write(&record, "run.json", r#"{"schema":2,"selected":[],"passed":true}"#);
    // Who asks for a workflow wants that alone.
    let ran = karat(path, &["init", "--github"]).good();
    assert!(ran.contains("there are tests in Rust: none is written"), "{ran}");
    assert!(!path.join("shaders/a.test.toml").exists());
    write(path, ".gitignore", "/target\n.karat/\n*.new.exr\n*.new.csv\n");
    let ran = karat(path, &["init"]).good();
    assert!(ran.contains("a test of `a::h`"), "{ran}");
    assert!(ran.contains("added *.new.png to .gitignore"), "{ran}");
    assert!(ran.contains("1 passed") && ran.contains("the record of the last run stays"), "{ran}");
    let report = karat(path, &["report"]).good();
    assert!(report.contains("a::g") && !report.contains("a::h"), "{report}");
    // With a test of each there is nothing to write, and nothing to run.
    std::fs::remove_file(path.join("shaders/a.test.toml")).expect("it was written");
    write(path, "tests/more/b.rs", "SHADERS.function(\"a::h\");\n");
    let ran = karat(path, &["init"]).good();
    assert!(ran.contains("each function has a test already: none is written"), "{ran}");
    assert!(!path.join("shaders/a.test.toml").exists());
}

/// Lobes that are infinite where roughness or a cosine is 0 are tested away from it.
#[test]
fn a_pole_at_the_end_is_left_out() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let module =
        "fn lobe(roughness: f32, n_dot_v: f32) -> f32 { return 0.25 / (roughness * n_dot_v); }\n";
    write(folder.path(), "shaders/a.wgsl", module);
    let ran = karat(folder.path(), &["init"]).good();
    assert!(ran.contains("a test of `a::lobe`") && ran.contains("1 check, 0 failed"), "{ran}");
    let test = std::fs::read_to_string(folder.path().join("shaders/a.test.toml"));
    let test = test.expect("it was written");
    let over = "\nover = { roughness = \"0.01..1\", n_dot_v = \"0.01..1\" }\nfinite = true\n";
    assert!(test.ends_with(over), "{test}");
}

#[test]
fn what_has_nothing_to_test_is_told() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let init = || karat(folder.path(), &["init"]).error();
    assert!(init().contains("has no .wgsl or .wesl file"), "{}", init());
    write(folder.path(), "a.wgsl", "@compute @workgroup_size(1) fn main() {}\n");
    assert!(init().contains("no function of `.` can be called"), "{}", init());
    write(folder.path(), "a.wgsl", "fn f(x: f32) -> f32 { return sqrt(-1.0 - x * x); }\n");
    assert!(init().contains("karat hazards"), "{}", init());
    // The rest is there.
    assert!(folder.path().join(".gitignore").exists());
    let none = karat(folder.path(), &["init", "nowhere"]).error();
    assert!(none.contains("there is no folder `nowhere`"), "{none}");
}
