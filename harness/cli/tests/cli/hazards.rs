//! Tests `karat hazards` and `karat call --trace`.

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
fn hazards_are_reported_with_their_line() {
    let folder = shaders(SCHLICK);
    let ran = karat(folder.path(), &["hazards"]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    for part in [
        "fresnel::schlick with f0 = ",
        // The cosine of two unit vectors may round above 1.
        "fault: NaN  pow(1.0 - v_dot_h, 5.0)  shaders/fresnel.wgsl:2:30",
        "other inputs show another hazard: unbounded",
        "it fails where v_dot_h is 1\n",
        "generated from 0 to 1.0000001: v_dot_h",
        "shaders: 1 fault and 0 requirements in 2 functions",
    ] {
        assert!(ran.out.contains(part), "no `{part}` in {}", ran.out);
    }
    let found = json(&karat(folder.path(), &["hazards", "--json"]).out);
    assert_eq!(
        (&found[0]["found"][0]["class"], &found[0]["found"][0]["kind"]),
        (&"fault".into(), &"nan".into())
    );
    karat(folder.path(), &["hazards", "--kind", "lost-digits"]).good();
    // `--kind` also reports this kind if the operation has a worse hazard.
    let unbounded = karat(folder.path(), &["hazards", "--kind", "unbounded"]);
    assert!(unbounded.code == Some(1) && unbounded.out.contains("1 fault"), "{unbounded:?}");
    karat(folder.path(), &["hazards", "--only", "lambert"]).good();
    karat(folder.path(), &["hazards", "--input", "v_dot_h=0..0.999"]).good();
    for (wrong, message) in [
        (&["--input", "v_dot_g=0..1"][..], "did you mean `v_dot_h`?"),
        (&["--input", "v_dot_h=1..0"], "1 to 0 isn't a range"),
        (&["--input", "v_dot_h"], "write NAME=LEAST..MOST"),
        (&["--kind", "nann"], "unknown variant `nann`, expected one of `nan`"),
        (&["--only", "nothing"], "no function of package `shaders` has `nothing` in its name"),
        (&["--cases", "0"], "0 is not in 1..=65536"),
        (&["--deny", "faults"], "[possible values: requirements]"),
    ] {
        let error = karat(folder.path(), &[&["hazards"], wrong].concat()).error();
        assert!(error.contains(message), "{error}");
    }
}

/// Karat counts functions that naga rejects, and the run fails.
#[test]
fn functions_that_are_not_valid_fail_a_run() {
    let folder = shaders("fn twice(x: f32) -> f32 { return 2.0 * x; }\n");
    karat(folder.path(), &["hazards"]).good();
    let text =
        "fn twice(x: f32) -> f32 { return 2.0 * x; }\nfn broken(x: f32) -> f32 { return x.y; }\n";
    write(&folder.path().join("shaders"), "fresnel.wgsl", text);
    let ran = karat(folder.path(), &["hazards"]);
    let counted = "1 function not checked, because naga rejects the code: `karat check` says why";
    assert!(ran.code == Some(1) && ran.out.contains(counted), "{ran:?}");
    assert!(ran.out.contains("0 faults and 0 requirements in 1 function,"), "{ran:?}");
}

/// The report of a requirement names the inputs for which the hazard occurs. With `--deny requirements`, a requirement
/// makes the run fail. The summary counts the requirements that all callers meet (`met`), and the hazards whose
/// result the shader doesn't use (`dropped`).
// Lesson 97
#[test]
fn requirements_fail_a_run_that_denies_them() {
    let union = "fn smooth_union(a: f32, b: f32, k: f32) -> f32 {\n    return a + 0.5 * (b - a) / k + 2.0 * (a / k);\n}\n";
    let safe = "fn safe(s: vec3f) -> vec3f { return select(vec3f(1.0), normalize(s), dot(s, s) > 0.0); }\n";
    let met = "fn inverse(x: f32) -> f32 { return 1.0 / x; }\nfn good(x: f32) -> f32 { return inverse(1.0 + x * x); }\n";
    let folder = shaders(&[union, safe, met].concat());
    let ran = karat(folder.path(), &["hazards"]).good();
    for part in [
        "requirement: NaN  0.5 * (b - a) / k  shaders/fresnel.wgsl:2:16",
        "needs another `k`: it fails where k is ",
        "other findings that depend on the same inputs: 2; the next finding is at shaders/fresnel.wgsl:2:",
        "requirements in 4 functions, 1 met, 1 dropped",
    ] {
        assert!(ran.contains(part), "no `{part}` in {ran}");
    }
    let denied = karat(folder.path(), &["hazards", "--deny", "requirements"]);
    assert_eq!(denied.code, Some(1), "{denied:?}");
    let all = karat(folder.path(), &["hazards", "--all"]).good();
    for part in ["met: infinite  1.0 / x  shaders/", "dropped: NaN  normalize(s)  shaders/"] {
        assert!(all.contains(part), "no `{part}` in {all}");
    }
    // With a declared input, the hazard is a fault.
    let declared = karat(folder.path(), &["hazards", "--input", "k=0..1"]);
    assert_eq!(declared.code, Some(1), "{declared:?}");
    karat(
        folder.path(),
        &["hazards", "--input", "k=0.1..1", "--deny", "requirements", "--kind", "nan"],
    )
    .good();
}

/// A name that implies a range for numbers implies nothing for a `bool`.
#[test]
fn a_bool_may_have_a_name_that_suggests_a_number() {
    let text = "struct Hit { diffuse: bool, roughness: f32 }\n\
                fn f(hit: Hit, albedo: bool) -> f32 { return select(1.0, 0.5 * hit.roughness, \
                hit.diffuse && albedo); }\n";
    let folder = shaders(text);
    let out = karat(folder.path(), &["hazards"]).good();
    assert!(out.contains("0 faults and 0 requirements in 1 function\n"), "{out}");
    let error = karat(folder.path(), &["hazards", "--input", "albedo=0..1"]).error();
    assert!(error.contains("no bool is in this range"), "{error}");
}

/// With several packages, `--input` applies to the package that has the input. An input that no package has is an
/// error.
#[test]
fn an_input_may_be_declared_for_one_of_several_packages() {
    let folder = shaders(SCHLICK);
    write(folder.path(), "other/tone.wgsl", "fn map(gain: f32) -> f32 { return 0.5 * gain; }\n");
    let manifest = "[workspace]\n[workspace.metadata.karat]\npackages = [\"shaders\", \"other\"]\n";
    write(folder.path(), "Cargo.toml", manifest);
    let inputs = ["hazards", "--input", "v_dot_h=0..0.999", "--input", "gain=0..1"];
    let out = karat(folder.path(), &inputs).good();
    assert!(out.contains("shaders: 0 faults") && out.contains("other: 0 faults"), "{out}");
    let error = karat(folder.path(), &[&inputs[..], &["--input", "gian=0..1"]].concat()).error();
    assert!(error.contains("the input `gian` is declared, but no checked function"), "{error}");
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

// Lesson 95
#[test]
fn the_trace_shows_an_index_out_of_bounds() {
    let text = "fn rd(i: u32) -> f32 {\n    var a = array<f32, 3>(1.0, 2.0, 3.0);\n    \
                let x = a[i];\n    return -x * 2.0;\n}\n";
    let folder = shaders(text);
    let call = |i: &str| {
        karat(folder.path(), &["call", "fresnel::rd", i, "--path", "cpu", "--trace"]).good()
    };
    let row = |ran: &str| ran.lines().find(|line| line.contains("-x * 2.0")).map(str::to_owned);
    assert!(row(&call("1")).is_some_and(|row| row.ends_with("-4")), "{}", call("1"));
    assert!(row(&call("7")).is_some_and(|row| row.ends_with("anything")), "{}", call("7"));
    // The minus sign belongs to the operation.
    assert!(call("1").lines().any(|line| line.contains("  -x  ")), "{}", call("1"));
}

// Lesson 96
#[test]
fn loops_that_may_not_end_are_hazards() {
    let folder = shaders(
        "fn forever(n: f32) -> f32 {\n    var x = 0.0;\n    loop {\n        x += n;\n        \
         if x < -1e30 { break; }\n    }\n    return x;\n}\n\
         fn long() -> f32 {\n    var s = 0.0;\n    \
         for (var i = 0; i < 2000000000; i++) { s += 0.1; }\n    return s;\n}\n",
    );
    let ran = karat(folder.path(), &["hazards"]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    for part in [
        "endless  loop {",
        "fresnel.wgsl:3:5",
        "1 function not checked",
        "not checked: fresnel::long: on path `cpu` `fresnel::long` was stopped",
    ] {
        assert!(ran.out.contains(part), "no `{part}` in {}", ran.out);
    }
    // A loop with a bound may run long. The deadline ends it, too.
    let mut long = command(folder.path(), &["call", "fresnel::long", "--path", "cpu"]);
    let error = output(long.env("KARAT_TIMEOUT", "0.2")).error();
    assert!(error.contains("this loop was still running after 0.2 s"), "{error}");
    assert!(error.contains("fresnel.wgsl:11:5"), "{error}");
}

#[test]
fn an_accepted_hazard_must_exist() {
    let folder = shaders(SCHLICK);
    let accept = |functions: &str, text: &str| {
        let declared =
            format!("[[hazard]]\nfunctions = {functions}\ntext = \"{text}\"\nreason = \"meant\"\n");
        write(&folder.path().join("shaders"), "karat.toml", &declared);
        karat(folder.path(), &["hazards"])
    };
    let ran = accept("[\"fresnel::schlick\"]", "pow(1.0 - v_dot_h, 5.0)").good();
    assert!(ran.contains("0 faults and 0 requirements in 2 functions, 1 accepted"), "{ran}");
    let all = karat(folder.path(), &["hazards", "--all", "--accepted"]).good();
    assert!(all.contains("accepted: meant") && all.contains("0 faults and 0 requ"), "{all}");
    // A requirement needs no `accept`.
    let needs = "fn needs(x: f32) -> f32 { return 1.0 / x; }\n";
    write(&folder.path().join("shaders"), "fresnel.wgsl", &format!("{SCHLICK}{needs}"));
    let needless = accept("[\"fresnel::needs\"]", "1.0 / x").out;
    assert!(
        needless.contains("accepts a hazard of fresnel::needs: only a fault needs an entry"),
        "{needless}"
    );
    write(&folder.path().join("shaders"), "fresnel.wgsl", SCHLICK);
    for (functions, text, hint) in [
        (
            "[\"fresnel::schlick\", \"fresnel::shlick\"]",
            "pow(1.0 - v_dot_h, 5.0)",
            "did you mean `fresnel::schlick`?",
        ),
        (
            "[\"fresnel::schlick\"]",
            "pow(1.0-v_dot_h, 5.0)",
            "did you mean `pow(1.0 - v_dot_h, 5.0)`?",
        ),
        ("[\"fresnel::schlick\"]", "sqrt(x)", "delete the declaration"),
    ] {
        let error = accept(functions, text).error();
        assert!(error.contains(hint), "{error}");
    }
}

#[test]
fn each_round_of_a_loop_and_half_precision_have_rows() {
    let folder = shaders(
        "enable f16;\nfn sum(n: i32) -> f32 {\n    var s = 0.0;\n    \
         for (var i = 0; i < n; i++) { s += 0.25; }\n    return s;\n}\n\
         fn half(x: f16) -> f16 { return x * 0.5h; }\n",
    );
    let call = |function: &str, x: &str| {
        karat(folder.path(), &["call", function, x, "--path", "cpu", "--trace"]).good()
    };
    let sum = call("fresnel::sum", "4");
    let rows: Vec<&str> = sum.lines().filter(|line| line.contains("s += 0.25")).collect();
    assert_eq!(rows.len(), 4, "{sum}");
    assert!(rows[3].ends_with("1"), "{sum}");
    let half = call("fresnel::half", "3");
    assert!(half.lines().any(|line| line.contains("x * 0.5h") && line.contains("1.5")), "{half}");
}

/// A trace shows integers with their sign, and the names of `let`s. If rounding decides a condition, the trace shows
/// `false or true`.
#[test]
fn integers_conditions_and_names_are_in_a_trace() {
    let folder = shaders(
        "fn f(x: f32, n: i32) -> f32 {\n    let below = n - 3;\n    let root = sqrt(x);\n    \
         if root * root < x {\n        return select(root, x, below < 0);\n    }\n    return 0.0;\n}\n",
    );
    let trace =
        karat(folder.path(), &["call", "fresnel::f", "2", "1", "--path", "cpu", "--trace"]).good();
    let row = |part: &str| -> Vec<String> {
        let line = trace.lines().find(|line| line.contains(part));
        let line = line.unwrap_or_else(|| panic!("no `{part}` in:\n{trace}"));
        line.split("  ")
            .filter(|cell| !cell.trim().is_empty())
            .map(|c| c.trim().to_owned())
            .collect()
    };
    assert_eq!(row("n - 3")[1..], ["below = n - 3", "-2", "-2", "-2"], "{trace}");
    assert!(row("sqrt(x)")[1].starts_with("root = "), "{trace}");
    // Rounding decides the condition, so WGSL allows both outcomes.
    assert_eq!(row("root * root < x")[4], "false or true", "{trace}");
    // In `f64` the root is exact, so the branch isn't taken.
    assert_eq!(row("below < 0")[2..], ["true", "not run", "true"], "{trace}");
    assert_eq!(row("select(root")[2], "2", "{trace}");
}

/// The shader computes a variance as the difference of two sums. This difference loses its digits if all samples are
/// nearly equal, so Karat tries nearly equal arguments.
#[test]
fn nearly_equal_arguments_are_tried() {
    let folder = shaders(
        "fn variance(a_albedo: f32, b_albedo: f32, c_albedo: f32, d_albedo: f32) -> f32 {\n    \
         let mean = (a_albedo + b_albedo + c_albedo + d_albedo) * 0.25;\n    \
         let squares = (a_albedo * a_albedo + b_albedo * b_albedo + c_albedo * c_albedo + d_albedo * d_albedo) * 0.25;\n    \
         return squares - mean * mean;\n}\n",
    );
    let ran = karat(folder.path(), &["hazards"]);
    assert!(ran.code == Some(0) && ran.out.contains("squares - mean * mean"), "{ran:?}");
    // The message names both operands of the subtraction.
    let about = ran.out.lines().find(|line| line.contains("are rounding errors (0."));
    assert!(about.is_some_and(|line| line.contains(", 0.") && line.contains("in f64")), "{ran:?}");
}

/// If several crates have a folder `shaders`, the output distinguishes the packages by their folders' paths.
#[test]
fn packages_with_the_same_name_are_named_by_their_folders() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let manifest =
        "[workspace]\n[workspace.metadata.karat]\npackages = [\"a/shaders\", \"b/shaders\"]\n";
    write(folder.path(), "Cargo.toml", manifest);
    let (over, plain) = (
        "override A: f32 = 1.0;\nfn f(x: f32) -> f32 { return x * A; }\n",
        "fn g(x: f32) -> f32 { return x; }\n",
    );
    write(&folder.path().join("a/shaders"), "m.wgsl", over);
    write(&folder.path().join("b/shaders"), "m.wgsl", plain);
    // An override that only one of the packages has is no error in the other.
    let ran = karat(folder.path(), &["hazards", "--override", "A=2"]).good();
    assert!(ran.contains("a/shaders: 0 faults") && ran.contains("b/shaders: 0 faults"), "{ran}");
    let checked = karat(folder.path(), &["check"]).good();
    assert!(
        checked.contains("a/shaders: valid") && checked.contains("b/shaders: valid"),
        "{checked}"
    );
    let twice = ["hazards", "--input", "x=0..1", "--input", "x=0..2"];
    let error = karat(folder.path(), &twice).error();
    assert!(error.contains("two --input options name the same input, `x`"), "{error}");
    // Two names set the same override.
    let twice = ["hazards", "--override", "A=2", "--override", "m::A=3"];
    let error = karat(folder.path(), &twice).error();
    assert!(error.contains("has two values, because you set it by two of its names"), "{error}");
    let error = karat(folder.path(), &["hazards", "--override", "B=2"]).error();
    assert!(error.contains("uses an override `B`; did you mean `A`?"), "{error}");
}
