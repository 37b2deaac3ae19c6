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
    steps.run("browser", setup::install_browser);
    lint::steps(&mut steps);
    steps.run("build", build);
    steps.run("paths", open_paths);
    steps.run("tests", test);
    steps.finish()
}

/// Builds with the features that `cargo test` will ask for: with `--package karat` some
/// dependencies would lack features that other members turn on, and be compiled twice.
fn build() -> Result<()> {
    // Not `--bins`: this program runs, and Windows doesn't replace what runs.
    let build =
        ["build", "--workspace", "--locked", "--bin", "karat", "--bin", "planted", "--tests"];
    command::run(&mut command::cargo(&build))
}

/// Opens the paths for real, where `setup` only saw that their libraries are there.
pub(crate) fn open_paths() -> Result<()> {
    command::run(&mut command::karat(&["doctor", "--require", PATHS])?)
}

fn test() -> Result<()> {
    let mut test = command::cargo(&["test", "--workspace", "--locked", "--no-fail-fast"]);
    // A path that doesn't open must fail the run: a test skipped there would prove nothing.
    command::run(test.env("KARAT_PATHS", "all").env("KARAT_REQUIRE", PATHS))
}
