//! Tests `karat doctor PACKAGE`, which proposes lines for `karat.toml`.

use super::*;

/// A package with an error of each kind that a line of karat.toml can fix.
fn broken() -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let shaders = folder.path().join("shaders");
    write(&shaders, "whole.wgsl", "fn one() -> f32 { return 1.0; }\n");
    write(&shaders, "macros.wgsl", "fn size() -> u32 { return BLOCK_SIZE * 2u + ACT(3u); }\n");
    write(&shaders, "template.wgsl", "{{EXTRA}}\nfn rows() -> u32 { return {{ROWS}}u; }\n");
    write(&shaders, "value.wgsl", "fn lights() -> u32 { return #{MAX_LIGHTS}u; }\n");
    write(&shaders, "fast.wesl", "@if(fast) fn f() -> f32 { return 1.0; }\n");
    write(
        &shaders,
        "uses.wesl",
        "import package::fast::f;\nimport noise::value::hash;\nfn g() -> f32 { return f() + hash(1.0); }\n",
    );
    // The module itself declares the name, under a condition.
    write(&shaders, "own.wesl", "@if(slow) const J = 1.0;\nfn j() -> f32 { return J; }\n");
    write(
        &folder.path().join("noise"),
        "value.wgsl",
        "fn hash(x: f32) -> f32 { return fract(x); }\n",
    );
    folder
}

#[test]
fn doctor_prints_and_writes_the_lines_that_karat_toml_lacks() {
    let folder = broken();
    let ran = karat(folder.path(), &["doctor", "shaders"]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    for part in [
        "2 of 7 modules valid",
        "BLOCK_SIZE = 64 # invented value: no module declares this name",
        "ACT = \"\" # empty",
        "EXTRA = \"\" # empty",
        "ROWS = 64 # invented",
        "MAX_LIGHTS = 4 # invented",
        "fast = true # a declaration needs this feature",
        "slow = true # a declaration needs this feature",
        "noise = { path = \"../noise\" }",
        "with these lines, 7 of 7 modules are valid",
    ] {
        assert!(ran.out.contains(part), "{part}: {ran:?}");
    }
    assert!(!folder.path().join("shaders/karat.toml").exists(), "it only says so");
    write(&folder.path().join("shaders"), "karat.toml", "# ours\n[values] # by hand\nOWN = 1\n");
    write(&folder.path().join("shaders"), "mine.wgsl", "fn own() -> i32 { return OWN; }\n");
    let report = karat(folder.path(), &["doctor", "shaders", "--write", "--json"]).good();
    let report: serde_json::Value = serde_json::from_str(&report).expect("JSON");
    assert_eq!((&report["whole"], &report["then_whole"]), (&3.into(), &8.into()), "{report}");
    let text = std::fs::read_to_string(folder.path().join("shaders/karat.toml")).expect("written");
    assert!(
        text.starts_with("# ours\n[values] # by hand\n") && text.contains("OWN = 1\n"),
        "{text}"
    );
    let again = karat(folder.path(), &["doctor", "shaders"]).good();
    // Karat also examines a path that is required.
    let required = karat(folder.path(), &["doctor", "shaders", "--require", "banana"]).error();
    assert!(required.contains("banana"), "{required}");
    karat(folder.path(), &["doctor", "shaders", "--require", "cpu"]).good();
    assert!(again.contains("8 modules, all valid"), "{again}");
    karat(folder.path(), &["check", "--shaders", "shaders"]).good();
}

#[test]
fn doctor_reports_errors_that_karat_toml_cannot_repair() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let shaders = folder.path().join("shaders");
    write(&shaders, "a.wgsl", "#use Mode\nfn f() -> f32 { return 1.0; }\n");
    write(&shaders, "b.wgsl", "fn g() -> f32 { return lower; }\n");
    write(&shaders, "c.wesl", "import sky::sun::colour;\nfn h() -> vec3f { return colour(); }\n");
    let ran = karat(folder.path(), &["doctor", "shaders", "--write"]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    for part in [
        "0 of 3 modules valid",
        "preprocess = [..]",
        "no definition in scope for identifier: `lower`",
        "[dependencies] sky = { path = \"../sky\" }, or { crate = \"sky@1.2.3\" }",
        "3 modules not valid",
    ] {
        assert!(ran.out.contains(part), "{part}: {ran:?}");
    }
    assert!(!shaders.join("karat.toml").exists(), "there is nothing to write");
    // An engine sets the feature, but no condition uses it.
    write(&shaders, "karat.toml", "[features]\nMAX_LIGHTS = 3\n");
    let ran = karat(folder.path(), &["doctor", "shaders"]);
    assert!(ran.out.contains("set_by_engine = [\"MAX_LIGHTS\"]"), "{ran:?}");
    // A misspelt feature doesn't count as the engine's.
    write(&shaders, "d.wesl", "@if(SHADOWS) fn s() -> f32 { return 1.0; }\n");
    write(&shaders, "karat.toml", "[features]\nSHADOW = true\n");
    let ran = karat(folder.path(), &["doctor", "shaders"]);
    assert!(!ran.out.contains("set_by_engine"), "{ran:?}");
    write(&shaders, "karat.toml", "[features\n");
    let error = karat(folder.path(), &["doctor", "shaders"]).error();
    assert!(error.contains("shaders/karat.toml"), "{error}");
    let missing = karat(folder.path(), &["doctor", "shader"]).error();
    assert!(missing.contains("`shader`"), "{missing}");
    let without = karat(folder.path(), &["doctor", "--write"]).error();
    assert!(without.contains("<PACKAGE>"), "{without}");
}

/// If `karat doctor --write` adds lines to `karat.toml`, the file stays valid and keeps its format.
#[test]
fn doctor_does_not_damage_karat_toml() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let shaders = folder.path().join("shaders");
    write(&shaders, "a.wgsl", "fn rows() -> u32 { return {{ROWS}}u + OLD; }\n");
    let file = shaders.join("karat.toml");
    for text in ["values = { OLD = 3 }\n", "values.OLD = 3\n"] {
        write(&shaders, "karat.toml", text);
        let ran = karat(folder.path(), &["doctor", "shaders", "--write"]);
        assert_eq!(ran.code, Some(1), "{ran:?}");
        assert!(
            ran.out.contains("karat.toml may also need these lines")
                && ran.out.contains("ROWS = 64"),
            "{ran:?}"
        );
        assert_eq!(std::fs::read_to_string(&file).expect("there"), text, "nothing is written");
    }
    write(&shaders, "karat.toml", "[values]\r\nOLD = 3\r\n");
    karat(folder.path(), &["doctor", "shaders", "--write"]).good();
    let text = std::fs::read_to_string(&file).expect("there");
    assert!(
        text.starts_with("[values]\r\nROWS = 64") && text.ends_with("\r\nOLD = 3\r\n"),
        "{text:?}"
    );
    // A value without a placeholder isn't a reason to write nothing. `karat check` refuses it.
    write(&shaders, "karat.toml", "[values]\nROWS = 1\nOLD = 3\nROW = 2\n");
    let ran = karat(folder.path(), &["doctor", "shaders"]);
    assert!(ran.code == Some(1) && ran.out.contains("`ROW`"), "{ran:?}");
    // The placeholder stands for a type, so a number doesn't help, and Karat writes none.
    write(&shaders, "a.wgsl", "alias S = {SCALAR};\nfn s(x: S) -> S { return x; }\n");
    std::fs::remove_file(&file).expect("it is there");
    let ran = karat(folder.path(), &["doctor", "shaders", "--write"]);
    assert!(
        ran.code == Some(1) && ran.out.contains("no module becomes valid with them"),
        "{ran:?}"
    );
    assert!(!file.exists(), "{ran:?}");
}
