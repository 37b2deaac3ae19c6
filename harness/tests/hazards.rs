//! Hazards, each planted and found at its line.

use karat::check::Failure;
use karat::hazards::{Hazard, HazardError, Kind};
use karat::prelude::*;

fn found(text: &str) -> Vec<Hazard> {
    Package::from_source("planted", text).hazards().run().expect("it is looked at").found
}

/// The hazard of a kind at an operation, which has to be there.
fn at(text: &str, kind: Kind, operation: &str) -> Hazard {
    let all = found(text);
    let one = all.iter().find(|hazard| hazard.kind == kind && hazard.text == operation);
    one.unwrap_or_else(|| panic!("no {kind:?} at `{operation}`: {all:#?}")).clone()
}

#[test]
fn each_is_found_where_it_is_born() {
    let schlick =
        "fn f(v_dot_h: f32) -> f32 {\n    return 0.04 + 0.96 * pow(1.0 - v_dot_h, 5.0);\n}";
    let hazard = at(schlick, Kind::Unbounded, "pow(1.0 - v_dot_h, 5.0)");
    assert!(hazard.location.ends_with(":2:26"), "{hazard:?}");
    assert_eq!(hazard.arguments, [("v_dot_h".to_owned(), "1".to_owned())]);
    assert!(!hazard.guessed);

    let sine = "fn f(n: vec3f, l: vec3f) -> f32 { let c = dot(n, l); return sqrt(1.0 - c * c); }";
    at(sine, Kind::Nan, "sqrt(1.0 - c * c)");

    let half = "fn f(v: vec3f, l: vec3f) -> vec3f { return normalize(v + l); }";
    let hazard = at(half, Kind::Nan, "normalize(v + l)");
    assert!(!hazard.hidden && hazard.cases.0 >= 3, "{hazard:?}");

    let naive = "fn f(n_dot_h: f32, alpha: f32) -> f32 {\n    let a2 = alpha * alpha;\n    \
                 let d = n_dot_h * n_dot_h * (a2 - 1.0) + 1.0;\n    return a2 / (3.1415927 * d * d);\n}";
    let hazard = at(naive, Kind::LostDigits, "n_dot_h * n_dot_h * (a2 - 1.0) + 1.0");
    assert!(hazard.location.ends_with(":3:13") && hazard.values.is_some(), "{hazard:?}");

    let angle = "fn f(n: vec3f, l: vec3f) -> f32 { return acos(dot(n, l)); }";
    at(angle, Kind::Nan, "acos(dot(n, l))");

    let hidden = "fn f(n: vec3f, l: vec3f) -> f32 { return max(acos(dot(n, l) * 1.5), 0.0); }";
    assert!(at(hidden, Kind::Nan, "acos(dot(n, l) * 1.5)").hidden);

    let cavity = "fn f(n_dot_h: f32, n_dot_v: f32, v_dot_h: f32) -> f32 {\n    \
                  return min(1.0, 2.0 * n_dot_h * n_dot_v / v_dot_h);\n}";
    at(cavity, Kind::Nan, "2.0 * n_dot_h * n_dot_v / v_dot_h");

    let remainder = "fn f(u: f32, t: f32) -> f32 { return u % t; }";
    at(remainder, Kind::Nan, "u % t");

    let cancels = "fn f(theta: f32) -> f32 { return 1.0 - cos(theta); }";
    at(cancels, Kind::LostDigits, "1.0 - cos(theta)");

    // All of its digits: 1 - cos(1e-4) is 0 in f32, and the result 0 where it should be a half.
    let all = "fn f(x: f32) -> f32 { return (1.0 - cos(x)) / (x * x); }";
    let package = Package::from_source("planted", all);
    let lost = package.function("f").over(1e-6..=1e-4).cases(500).try_has_no_hazards();
    let told = lost.expect_err("0 is no half").to_string();
    assert!(told.contains("digits lost at `1.0 - cos(x)`"), "{told}");
    // Of a result that is rounding itself nothing is lost.
    let rounding = Package::from_source("planted", "fn f(x: f32) -> f32 { return 1.0 - cos(x); }");
    rounding.function("f").over(1e-6..=1e-5).cases(500).has_no_hazards();

    let index = "fn f(i: u32) -> f32 { var a = array(1.0, 2.0, 3.0); return a[i]; }";
    at(index, Kind::OutOfRange, "a[i]");

    let cell = "fn f(i: u32, columns: u32) -> u32 { return i % columns; }";
    at(cell, Kind::ByZero, "i % columns");
    let guarded = "fn f(i: i32, n: i32) -> i32 { if n == 0 { return 0; } return i / n; }";
    assert_eq!(found(guarded), []);

    let sum = "fn f(t: f32) -> f32 { return 1.0 / t; }";
    at(sum, Kind::Infinite, "1.0 / t");
}

/// One thread may be told of a count while another one tells the next.
#[test]
fn progress_never_goes_backwards() {
    let text: String =
        (0..12).map(|at| format!("fn f{at}(x: f32) -> f32 {{ return x; }}\n")).collect();
    let told = std::sync::Mutex::new(Vec::new());
    let package = Package::from_source("many", &text);
    let ran = package.hazards().run_with(&|done, of| {
        if done % 3 == 1 {
            std::thread::sleep(std::time::Duration::from_millis(50));
        }
        told.lock().expect("nobody panics").push((done, of));
    });
    assert_eq!(ran.expect("it is looked at").functions, 12);
    let expected: Vec<_> = (1..=12).map(|done| (done, 12)).collect();
    assert_eq!(told.into_inner().expect("nobody panics"), expected);
}

/// What is right stays silent: few findings are read, many aren't.
#[test]
fn what_is_right_has_none() {
    for text in [
        "fn f(n_dot_l: f32, albedo: vec3f) -> vec3f { return albedo * n_dot_l / 3.1415927; }",
        "fn f(f0: vec3f, v_dot_h: f32) -> vec3f { let c = 1.0 - v_dot_h; let c2 = c * c;\n\
         return f0 + (1.0 - f0) * (c2 * c2 * c); }",
        "fn f(n: vec3f, v: vec3f) -> f32 { return clamp(dot(n, v), 0.0, 1.0); }",
        "fn f(u: vec2f) -> vec2f { return mix(u, u.yx, 0.25); }",
        "fn f(samples: u32) -> f32 { return 1.0 / f32(samples); }",
        "fn f(alpha: f32) -> f32 { return sqrt(max(1.0 - alpha, 0.0)); }",
    ] {
        assert_eq!(found(text), [], "{text}");
    }
}

#[test]
fn inputs_are_declared_and_hazards_accepted() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| {
        std::fs::write(folder.path().join(name), text).expect("it is ours");
    };
    write("maths.wgsl", "fn rcp(t: f32) -> f32 { return 1.0 / t; }\n");
    let package = Package::open(folder.path()).expect("it is there");
    let look = || package.hazards().run();
    assert_eq!(look().expect("read").found.len(), 1);
    assert_eq!(package.hazards().input("t", 0.5..=1.0).run().expect("read").found, []);
    write("karat.toml", "[inputs]\nt = [0.5, 1]\n");
    assert_eq!(look().expect("read").found, []);
    write("karat.toml", "[inputs]\ntt = [0.5, 1]\n");
    match look() {
        Err(HazardError::Declaration(text)) => {
            assert!(text.contains("did you mean `t`?"), "{text}")
        }
        other => panic!("{other:?}"),
    }
    let accepted = |function: &str| {
        format!(
            "[[hazard]]\nfunctions = [\"{function}\"]\ntext = \"1.0 / t\"\nreason = \"callers know\"\n"
        )
    };
    write("karat.toml", &accepted("maths::rcp"));
    let hazards = look().expect("read");
    assert_eq!((hazards.found.len(), hazards.accepted), (0, 1));
    write("karat.toml", &accepted("maths::*"));
    assert_eq!(look().expect("read").accepted, 1);
    write("karat.toml", &accepted("maths::other"));
    match look() {
        Err(HazardError::Declaration(text)) => {
            assert!(text.contains("there is none: delete it"), "{text}")
        }
        other => panic!("{other:?}"),
    }
    write("karat.toml", "");
    write("maths.wgsl", "fn f(x: f32) -> f32 { if x > 1.0 { discard; } return x; }\n");
    assert!(matches!(look(), Err(HazardError::Nothing { .. })), "no verdict without evidence");
}

#[test]
fn a_domain_is_checked_for_hazards() {
    let text = "fn f(x: f32) -> f32 { return max(sqrt(x - 0.5), 0.0); }";
    let package = Package::from_source("planted", text);
    package.function("f").over(0.5..=1.0).cases(500).has_no_hazards();
    let failure = package.function("f").over(0.0..=1.0).cases(500).try_has_no_hazards();
    let Err(Failure::Disagreement(found)) = failure else { panic!("{failure:?}") };
    let text = found.to_string();
    assert!(text.contains("hazard = NaN at `sqrt(x - 0.5)` ("), "{text}");
    assert!(text.contains("a later operation hides it"), "{text}");
    let refused = Package::from_source("planted", "fn f(x: f32) -> f32 { return dpdx(x); }");
    assert!(refused.function("f").over(0.0..=1.0).try_has_no_hazards().is_err());
}

/// A check that ends in an error has a dispatch that nobody reads. Its driver must not be at work when the
/// process ends: one in three such processes crashed.
#[test]
fn nothing_runs_when_the_process_ends() {
    let program = std::env::current_exe().expect("it runs");
    for _ in 0..8 {
        let mut tests = std::process::Command::new(&program);
        tests.args(["--skip", "nothing_runs_when_the_process_ends"]);
        let ended = tests.output().expect("it starts");
        assert!(ended.status.success(), "{}: {ended:?}", ended.status);
    }
}
