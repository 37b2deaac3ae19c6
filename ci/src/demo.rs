//! `cargo ci demo`: goes from a fresh clone to verdicts on every execution path. To show the first verdicts soon, the
//! demo runs one test program before it builds the program `karat`.

use std::process::ExitCode;

use crate::setup::{self, PATHS};
use crate::step::Steps;
use crate::{command, suite};

/// Installs missing drivers, builds the tests and `karat`, opens the paths, and runs the shader tests. Stops at the
/// first failure.
pub(crate) fn run() -> ExitCode {
    let mut steps = Steps::new("cargo ci demo");
    let _ = steps.run("setup", setup::install_missing)
        && steps.run("build of the functions' tests", build_library)
        && steps.run("first verdict", first_verdict)
        && steps.run("build", build)
        && steps.run("paths", suite::open_paths)
        && steps.run("every function", || shader_tests(&[LIBRARY]))
        && steps.run("every frame", || shader_tests(&[FRAMES]));
    steps.finish()
}

/// Runs `cargo ci setup`: installs what the tests need, builds the harness, and opens the paths with it.
pub(crate) fn set_up() -> ExitCode {
    let mut steps = Steps::new("cargo ci setup");
    let _ = steps.run("setup", setup::install_missing)
        && steps.run("browser", setup::install_browser)
        && steps.run("validators", setup::install_validators)
        && steps.run("tint", setup::install_tint)
        && steps.run("build", build)
        && steps.run("paths", suite::open_paths);
    steps.finish()
}

/// The arguments of the command that builds the demo's programs. With `--workspace` and the tests, Cargo chooses the
/// same features for shared dependencies as in other commands, and compiles these dependencies only once.
pub(crate) const BUILD: &[&str] = &[
    "build",
    "--workspace",
    "--locked",
    "--bin",
    "karat",
    "--test",
    "library",
    "--test",
    "golden",
];

pub(crate) fn build() -> anyhow::Result<()> {
    command::run(&mut command::cargo(BUILD))
}

/// Builds the test program `library`, whose tests give the first verdicts. Cargo compiles crates with the same features
/// as for [`BUILD`].
fn build_library() -> anyhow::Result<()> {
    command::run(&mut command::cargo(&["build", "--workspace", "--locked", LIBRARY]))
}

/// Runs the tests of one module with Rust's own test runner. If a path doesn't open, the tests fail.
fn first_verdict() -> anyhow::Result<()> {
    let mut test = command::cargo(&["test", "--workspace", "--locked", LIBRARY, FIRST]);
    command::run(test.env("KARAT_PATHS", "all").env("KARAT_REQUIRE", PATHS))
}

/// Cargo's argument for the test program that tests the functions of the shader library.
const LIBRARY: &str = "--test=library";
const FRAMES: &str = "--test=golden";

/// The module whose tests run first.
const FIRST: &str = "fresnel::";

fn shader_tests(which: &[&str]) -> anyhow::Result<()> {
    let karat = &["test", "--paths", "all", "--require", PATHS];
    command::run(command::karat(karat)?.args(which))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// No test runs the demo, so only this test detects a wrong name of a program or module in the demo.
    #[test]
    fn the_demo_names_programs_that_are_there() {
        let manifest = std::fs::read_to_string(command::root().join("tests/Cargo.toml"));
        let manifest = manifest.expect("it is in the workspace");
        for program in [LIBRARY, FRAMES] {
            let name = program.trim_start_matches("--test=");
            assert!(manifest.contains(&format!("[[test]]\nname = \"{name}\"\n")), "{name}");
        }
    }
}
