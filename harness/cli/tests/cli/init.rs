//! `karat init`

use super::*;

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
        "added .karat/run/ and *.new.exr to .gitignore",
        "wrote .github/workflows/karat.yml",
        "wrote .gitlab-ci.karat.yml",
        "2 checks, 0 failed",
        "karat watch shaders",
    ] {
        assert!(ran.contains(part), "no `{part}` in {ran}");
    }
    let read = |file: &str| std::fs::read_to_string(folder.path().join(file)).expect(file);
    assert_eq!(read(".gitignore"), "target\n.karat/run/\n*.new.exr\n");
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

#[test]
fn what_has_nothing_to_test_is_told() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let init = || karat(folder.path(), &["init"]).error();
    assert!(init().contains("has no .wgsl or .wesl file"), "{}", init());
    write(folder.path(), "a.wgsl", "@compute @workgroup_size(1) fn main() {}\n");
    assert!(init().contains("no function of `.` can be called"), "{}", init());
    write(folder.path(), "a.wgsl", "fn f(x: f32) -> f32 { return sqrt(-1.0 - x * x); }\n");
    assert!(init().contains("karat hazards"), "{}", init());
    let none = karat(folder.path(), &["init", "nowhere"]).error();
    assert!(none.contains("there is no folder `nowhere`"), "{none}");
}
