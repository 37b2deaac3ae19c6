//! `cargo ci test`: all of CI.

use std::process::ExitCode;

use anyhow::Result;

use crate::setup::{self, PATHS};
use crate::step::Steps;
use crate::{command, lint};

/// Runs every step, whatever became of those before it; the tests come last, so that the
/// test runner's closing lines are the last thing on stdout.
pub(crate) fn run() -> ExitCode {
    let mut steps = Steps::new("cargo ci test");
    steps.run("setup", setup::install_missing);
    lint::steps(&mut steps);
    steps.run("build", build);
    steps.run("paths", open_paths);
    steps.run("tests", test);
    steps.finish()
}

fn build() -> Result<()> {
    command::run(&mut command::cargo(&["test", "--workspace", "--locked", "--no-run"]))
}

/// Opens the paths for real, where `setup` only saw that their libraries are there.
pub(crate) fn open_paths() -> Result<()> {
    let karat = ["run", "--quiet", "--locked", "--package", "karat", "--"];
    let doctor = ["doctor", "--require", PATHS];
    command::run(&mut command::cargo(&[&karat[..], &doctor[..]].concat()))
}

fn test() -> Result<()> {
    let mut test = command::cargo(&["test", "--workspace", "--locked", "--no-fail-fast"]);
    // A path that doesn't open must fail the run: a test skipped there would prove nothing.
    command::run(test.env("KARAT_PATHS", "all").env("KARAT_REQUIRE", PATHS))
}
