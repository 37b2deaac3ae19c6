//! `karat compare`

use super::*;

fn git(folder: &FilePath, arguments: &[&str]) {
    let mut command = Command::new("git");
    command.current_dir(folder).args(["-c", "user.name=a", "-c", "user.email=a@b"]);
    let output = command.args(arguments).output().expect("git runs");
    assert!(output.status.success(), "{output:?}");
}

#[test]
fn an_edit_is_compared_with_a_revision_and_with_a_folder() {
    let folder = project();
    let calc = folder.path().join("shaders").join("calc.wgsl");
    let before = std::fs::read_to_string(&calc).expect("it is there");
    git(folder.path(), &["init", "-q"]);
    git(folder.path(), &["add", "."]);
    git(folder.path(), &["commit", "-qm", "one"]);
    let same = karat(folder.path(), &["compare", "HEAD"]).good();
    assert!(same.contains("0 changed, 0 edited with the same results, 10 untouched"), "{same}");
    let after = before
        .replace("return TWO * x;", "return x + x; /* the same */")
        .replace("return -x;", "return select(-x, x, x > 2);")
        .replace("fn third() -> f32", "fn third() -> f32 /* a third */");
    std::fs::write(&calc, &after).expect("written");
    let ran = karat(folder.path(), &["compare", "HEAD", "--paths", "cpu,vulkan"]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    for part in [
        "same       calc::double",
        "changed    calc::negate  shaders/calc.wgsl:",
        "    cpu: ",
        "    vulkan: ",
        "at x = 3: -3 -> 3",
        "1 changed, 1 edited with the same results, 8 untouched",
    ] {
        assert!(ran.out.contains(part), "no `{part}` in {}", ran.out);
    }
    let old = tempfile::tempdir().expect("a temporary folder");
    write(old.path(), "calc.wgsl", &before);
    write(old.path(), "constants.wgsl", SHADERS[0].1);
    let old = old.path().display().to_string();
    let found = json(&karat(folder.path(), &["compare", &old, "--json", "--only", "negate"]).out);
    assert_eq!(
        (&found[0]["change"], &found[0]["paths"][0]["after"]),
        (&"changed".into(), &"3".into())
    );
    for (wrong, part) in [
        (&["nowhere"][..], "neither a folder nor a revision"),
        (&["--upload-pack=x"], "unexpected argument"),
        (&["HEAD", "--only", "nothing"], "no function to compare"),
        (&["HEAD", "--paths", "vulcan"], "did you mean `vulkan`"),
        (&["HEAD", "--cases", "0"], "0 is not in"),
    ] {
        let error = karat(folder.path(), &[&["compare"], wrong].concat()).error();
        assert!(error.contains(part), "{error}");
    }
}
