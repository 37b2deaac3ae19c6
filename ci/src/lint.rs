//! `cargo ci lint`: checks the formatting, Clippy's lints, the documentation, the licences and the content of packages.

use std::path::Path;
use std::process::{Command, ExitCode};

use anyhow::{Context, Result};

use crate::step::Steps;
use crate::{command, licence, packages};

/// Runs only the lint steps.
pub(crate) fn run() -> ExitCode {
    let mut steps = Steps::new("cargo ci lint");
    self::steps(&mut steps);
    steps.finish()
}

/// Runs the lint steps, the fastest step first, and adds their verdicts to `steps`.
pub(crate) fn steps(steps: &mut Steps) {
    steps.run("format", format);
    steps.run("licences", licence::check);
    steps.run("packages", packages::check);
    steps.run("clippy", clippy);
    steps.run("documentation", documentation);
}

fn format() -> Result<()> {
    component("rustfmt", "fmt")?;
    command::run(&mut command::cargo(&["fmt", "--all", "--check"]))
        .context("run `cargo fmt --all` to format")
}

/// Clippy's arguments in addition to the workspace's lints: warnings are errors.
const LINTS: [&str; 2] = ["-D", "warnings"];

fn clippy() -> Result<()> {
    component("clippy", "clippy")?;
    let clippy = ["clippy", "--workspace", "--all-targets", "--locked", "--"];
    command::run(command::cargo(&clippy).args(LINTS))
}

/// Makes `cargo doc` reuse the metadata that Clippy wrote for the workspace's libraries. Cargo reuses metadata only if
/// the same program wrote it with the same arguments. `cargo clippy` names the program `clippy-driver` and its
/// arguments in two environment variables, and this function sets these variables for `cargo doc`. Otherwise Cargo
/// would check the libraries again.
fn after_clippy(doc: &mut Command) {
    let sysroot = Command::new("rustc").args(["--print", "sysroot"]).output();
    let sysroot = sysroot
        .map_or(String::new(), |output| String::from_utf8_lossy(&output.stdout).trim().to_owned());
    let name = format!("clippy-driver{}", std::env::consts::EXE_SUFFIX);
    let driver = Path::new(&sysroot).join("bin").join(name);
    if driver.is_file() {
        doc.env("RUSTC_WORKSPACE_WRAPPER", driver);
        doc.env("CLIPPY_ARGS", LINTS.map(|lint| format!("{lint}__CLIPPY_HACKERY__")).concat());
    }
}

/// Builds the documentation of the programs, and then of the libraries. The documentation of the program `karat` and of
/// the library `karat` goes to the same folder, and `cargo doc` empties this folder first. If one command documented
/// both, it would sometimes fail.
fn documentation() -> Result<()> {
    for targets in ["--bins", "--lib"] {
        let mut doc = command::cargo(&["doc", "--workspace", "--no-deps", "--locked", targets]);
        after_clippy(&mut doc);
        command::run(doc.env("RUSTDOCFLAGS", "-Dwarnings"))?;
    }
    Ok(())
}

/// Installs a component of the Rust toolchain, such as Clippy, if the toolchain lacks this component.
fn component(name: &str, subcommand: &str) -> Result<()> {
    if command::succeeds(&mut command::cargo(&[subcommand, "--version"])) {
        return Ok(());
    }
    command::run(Command::new("rustup").args(["component", "add", name])).with_context(|| {
        format!("`cargo {subcommand}` is missing; install the toolchain's component `{name}`")
    })
}
