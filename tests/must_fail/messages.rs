//! Tests the messages of failures.

use karat::prelude::*;
use karat::unstable::check::Disagreement;

use crate::{disagreement, mutant, schlick};

/// Compares only parts of the message that are the same on all machines.
// Lesson 19
// Lesson 21
#[test]
fn the_message_shows_line_inputs_values_error_census_and_replay() {
    let fault = "abs(1.0 - v_dot_h) * 1.01";
    let found = disagreement(schlick(&mutant("fresnel", "abs(1.0 - v_dot_h)", fault)));
    let text = found.to_string();
    let at = found.function.span.to_string();
    for part in [
        "error: `fresnel::schlick` fails agrees_with: 11 ulp",
        &at,
        "fn schlick(f0: vec3f, v_dot_h: f32) -> vec3f {",
        "of 65536 cases fail (",
        "too high",
        "worst (case ",
        "     f0 = (",
        "v_dot_h = ",
        " (0x1.",
        "error = ",
        " ulp (11 allowed)",
        "simplest (reduced from case ",
        "replay: KARAT_PATHS=",
        "KARAT_SEED=0x",
        "KARAT_CASE=",
        "cargo test -p tests --test must_fail -- --exact \
         messages::the_message_shows_line_inputs_values_error_census_and_replay",
    ] {
        assert!(text.contains(part), "`{part}` is missing in:\n{text}");
    }
}

/// If several paths fail with the same values, the message shows these values and the replay command once. A path with
/// different values has its own part of the message.
#[test]
fn paths_with_equal_failures_share_one_message() {
    let package = Package::from_source("planted", "fn f(x: u32) -> u32 { return x + 1u; }");
    let check = package.function("f").over(Integers(0..=9_u32)).unrecorded();
    let mut found = disagreement(check.try_satisfies("is 0", |_, y: u32| y == 0));
    let shown = |found: &Disagreement, part: &str| found.to_string().matches(part).count();
    assert_eq!(shown(&found, "\non "), found.paths.len(), "{found}");
    assert_eq!((shown(&found, "worst ("), shown(&found, "replay: ")), (1, 1), "{found}");
    let mut other = found.paths[0].clone();
    other.census.failures -= 1;
    found.paths.push(other);
    assert_eq!((shown(&found, "worst ("), shown(&found, "replay: ")), (2, 2), "{found}");
}

/// If two checks of a function use the same verb, each check has its own cases, name and replay command.
#[test]
fn two_checks_of_one_function_have_different_names() {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return sqrt(x); }");
    let over = |low: f32| package.function("f").over(low..=1.0);
    let is_number = |_, x: f32| x >= 0.0;
    over(0.0).unrecorded().try_satisfies("is a number", is_number).expect("it is");
    let found = disagreement(over(-1.0).unrecorded().try_satisfies("is a number", is_number));
    assert!(
        found
            .paths
            .iter()
            .all(|path| path.replay.to_string().contains("KARAT_CASE=f/satisfies#2/"))
    );
}
