//! `cargo ci demo`: from a fresh clone to verdicts on every execution path.

use std::process::ExitCode;

use crate::setup::{self, PATHS};
use crate::step::Steps;
use crate::{command, suite};

/// Sets up, builds, opens the paths and runs the shader tests; stops at the first failure.
pub(crate) fn run() -> ExitCode {
    let mut steps = Steps::new("cargo ci demo");
    let _ = steps.run("setup", setup::install_missing)
        && steps.run("build", build)
        && steps.run("paths", suite::open_paths)
        && steps.run("shader tests", shader_tests);
    steps.finish()
}

fn build() -> anyhow::Result<()> {
    command::run(&mut command::cargo(&["build", "--locked", "--package", "karat"]))
}

fn shader_tests() -> anyhow::Result<()> {
    let karat = ["run", "--quiet", "--locked", "--package", "karat", "--"];
    let test = ["test", "-p", "tests", "--paths", "all", "--require", PATHS];
    command::run(&mut command::cargo(&[&karat[..], &test[..]].concat()))
}
