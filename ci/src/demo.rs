//! `cargo ci demo`: from a fresh clone to verdicts on every execution path.

use std::process::ExitCode;

use anyhow::Context;

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

/// Sets up, and opens the paths for real: what `setup` alone can't, as it needs the harness built.
pub(crate) fn set_up() -> ExitCode {
    let mut steps = Steps::new("cargo ci setup");
    let _ = steps.run("setup", setup::install_missing)
        && steps.run("browser", setup::install_browser)
        && steps.run("build", build)
        && steps.run("paths", suite::open_paths);
    steps.finish()
}

/// Builds for the whole workspace, as the tests are: for fewer packages Cargo would choose other
/// features of shared dependencies, and compile them twice.
fn build() -> anyhow::Result<()> {
    command::run(&mut command::cargo(&["build", "--workspace", "--locked", "--bin", "karat"]))
}

fn shader_tests() -> anyhow::Result<()> {
    let mut karat = command::karat(&["test", "--paths", "all", "--require", PATHS])?;
    for name in twins()?.iter().map(String::as_str).chain(["golden"]) {
        karat.args(["--test", name]);
    }
    command::run(&mut karat)
}

/// The tests of shader modules: those with the name of a module.
fn twins() -> anyhow::Result<Vec<String>> {
    let mut names = Vec::new();
    let root = command::root();
    for entry in std::fs::read_dir(root.join("shaders")).context("the shader library is gone")? {
        let path = entry?.path();
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let shader = path.extension().is_some_and(|extension| extension == "wgsl");
        if shader && root.join("tests").join(&stem).with_extension("rs").is_file() {
            names.push(stem);
        }
    }
    names.sort();
    Ok(names)
}
