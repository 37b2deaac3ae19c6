//! `karat hazards`, and `karat call --trace`.

use super::*;

const SCHLICK: &str = "fn schlick(f0: f32, v_dot_h: f32) -> f32 {\n    \
                       return f0 + (1.0 - f0) * pow(1.0 - v_dot_h, 5.0);\n}\n\
                       fn lambert(albedo: f32) -> f32 { return albedo / 3.1415927; }\n";

fn shaders(text: &str) -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "Cargo.toml", "[workspace]\n");
    write(&folder.path().join("shaders"), "fresnel.wgsl", text);
    folder
}

#[test]
fn hazards_are_told_with_their_line() {
    let folder = shaders(SCHLICK);
    let ran = karat(folder.path(), &["hazards"]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    for part in [
        "unbounded by WGSL  pow(1.0 - v_dot_h, 5.0)  shaders/fresnel.wgsl:2:30",
        "fresnel::schlick with f0 = 0; v_dot_h = 1",
        "shaders: 1 hazard in 2 functions",
    ] {
        assert!(ran.out.contains(part), "no `{part}` in {}", ran.out);
    }
    let found = json(&karat(folder.path(), &["hazards", "--json"]).out);
    assert_eq!(found[0]["found"][0]["kind"], "unbounded");
    karat(folder.path(), &["hazards", "--only", "lambert"]).good();
    karat(folder.path(), &["hazards", "--input", "v_dot_h=0..0.999"]).good();
    for (wrong, message) in [
        (&["--input", "v_dot_g=0..1"][..], "did you mean `v_dot_h`?"),
        (&["--input", "v_dot_h=1..0"], "1 to 0 is no range"),
        (&["--input", "v_dot_h"], "write NAME=LEAST..MOST"),
        (&["--only", "nothing"], "no function of package `shaders` can be looked at"),
        (&["--cases", "0"], "0 is not in 1..=65536"),
    ] {
        let error = karat(folder.path(), &[&["hazards"], wrong].concat()).error();
        assert!(error.contains(message), "{error}");
    }
}

#[test]
fn each_intermediate_of_a_call_is_shown() {
    let folder = shaders(SCHLICK);
    let call = ["call", "fresnel::schlick", "0.04", "0.5", "--path", "cpu"];
    let ran = karat(folder.path(), &[&call[..], &["--trace", "--html", "t.html"]].concat()).good();
    let line = |operation: &str| {
        let line = ran.lines().find(|line| line.contains(operation)).map(str::to_owned);
        line.unwrap_or_else(|| panic!("no `{operation}` in {ran}"))
    };
    assert!(line("1.0 - v_dot_h ").contains("0.5"), "{ran}");
    let power = line("  pow(1.0 - v_dot_h, 5.0) ");
    assert!(power.contains("0.03125") && power.contains(" to "), "{power}");
    let page = std::fs::read_to_string(folder.path().join("t.html")).expect("it is written");
    assert!(page.contains("pow(1.0 - v_dot_h, 5.0)") && page.contains("<td>0.03125"), "{page}");
    let anything = ["call", "fresnel::schlick", "0.04", "1", "--path", "cpu", "--trace"];
    assert!(karat(folder.path(), &anything).good().contains("anything"));
    let over = [&call[..], &["--html", "shaders/fresnel.wgsl"]].concat();
    assert!(karat(folder.path(), &over).error().contains("name another file"));
}
