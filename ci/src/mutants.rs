//! `cargo ci mutants`: the mutants that `tests/mutants` makes of the shader library.

use anyhow::Result;

use crate::command;

/// Tries all mutants, or those that are named. The test that tries a few of them does the work.
pub(crate) fn run(names: &[String]) -> Result<()> {
    let test = ["test", "--locked", "--package", "tests", "--test", "mutants", "--", "--exact"];
    let mut mutants = command::cargo(&test);
    mutants.args(["mutants_made_by_a_program_are_killed", "--nocapture"]);
    mutants.env("MUTANTS", if names.is_empty() { "all".to_owned() } else { names.join(",") });
    command::run(&mut mutants)
}
