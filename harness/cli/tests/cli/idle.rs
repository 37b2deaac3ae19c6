//! Tests that Karat refuses a check that does nothing or can't fail, and reports the line of the check's key. Also
//! tests that Karat counts hazards whose result the shader doesn't use.

use super::*;

const SHADER: &str = "\
fn count(i: u32) -> u32 { return i; }
fn half(x: f32) -> f32 { return 0.5 * x; }
fn open(a: f32, x: f32) -> f32 { return smoothstep(a, a, x); }
fn capped(roughness: f32) -> f32 { return min(1.0 / roughness, 100.0); }
";

fn shaders() -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "m.wgsl", SHADER);
    folder
}

// Lesson 175
#[test]
fn checks_that_cannot_fail_are_errors_at_their_place() {
    for (declared, place, message) in [
        (
            "function = \"count\"\nin_range = [0, 4294967295]\n",
            "m.test.toml:3:1",
            "no result passes this check, or every result does",
        ),
        ("function = \"count\"\nequals = 5.5\n", "m.test.toml:3:1", "5.5 isn't of type u32"),
        ("function = \"count\"\nequals = -1\n", "m.test.toml:3:1", "-1 isn't of type u32"),
        (
            "function = \"half\"\nequals = 1\ntolerance = \"rel 1e300\"\n",
            "m.test.toml:4:1",
            "`rel 1e300` accepts every result",
        ),
        (
            "function = \"half\"\nagrees_with = \"half\"\ntolerance = \"4 ulp\"\n",
            "m.test.toml:3:1",
            "is compared with itself",
        ),
        (
            "function = \"half\"\nin_range = [0, 1]\nover = { x = \"0..1\" }\ntolerance = \"4 ulp\"\n",
            "m.test.toml:5:1",
            "`tolerance` does nothing here",
        ),
    ] {
        let folder = shaders();
        write(folder.path(), "m.test.toml", &format!("[[test]]\n{declared}"));
        let ran = karat(folder.path(), &["test", ".", "--paths", "cpu"]);
        let said = format!("{}{}", ran.out, ran.err);
        assert!(ran.code != Some(0), "{declared}: {said}");
        assert!(said.contains(place) && said.contains(message), "{declared}: {said}");
    }
    // Karat compares a driver's results with the results that WGSL allows.
    let folder = shaders();
    let text = "[[test]]\nfunction = \"half\"\nagrees_with = \"half\"\ntolerance = \"spec\"\n\
                over = { x = \"0..1\" }\n";
    write(folder.path(), "m.test.toml", text);
    karat(folder.path(), &["test", ".", "--paths", "cpu"]).good();
}

/// If WGSL allows any result, a driver may leave out the computation. A call still has a result on each path.
// Lesson 174
#[test]
fn a_call_has_a_result_on_each_path_where_anything_is_allowed() {
    let folder = shaders();
    let paths = open_paths(folder.path());
    let asked: Vec<&str> = paths.iter().flat_map(|path| ["--path", path.as_str()]).collect();
    let call = ["call", "open", "1", "2", "--shaders", "m.wgsl"];
    let ran = karat(folder.path(), &[&call[..], &asked].concat());
    assert_eq!((ran.code, &*ran.err), (Some(0), ""), "{ran:?}");
    assert!(paths.iter().any(|path| path == "cpu"), "{paths:?}");
    for path in &paths {
        let has_result = |line: &str| line.split_whitespace().next() == Some(path.as_str());
        assert!(ran.out.lines().any(has_result), "no {path} in {ran:?}");
    }
}

/// If a later operation discards the result of a hazard, the hazard counts as `dropped`. Only `--all` shows it.
// Lesson 178
#[test]
fn a_dropped_value_is_counted() {
    let folder = shaders();
    let only = ["hazards", "--shaders", "m.wgsl", "--only", "capped", "--input", "roughness=0..1"];
    let ran = karat(folder.path(), &only).good();
    assert!(ran.contains("0 faults and 0 requirements in 1 function, 1 dropped"), "{ran:?}");
    let all = karat(folder.path(), &[&only[..], &["--all"]].concat()).good();
    assert!(all.contains("dropped: infinite  1.0 / roughness"), "{all:?}");
    let dropped = json(&karat(folder.path(), &[&only[..], &["--json"]].concat()).out);
    let others = dropped[0]["others"].as_array().expect("a list");
    assert!(!others.is_empty() && others.iter().all(|one| one["class"] == "dropped"), "{dropped}");
}
