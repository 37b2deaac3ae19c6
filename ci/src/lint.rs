//! `cargo ci lint`: checks formatting, Clippy, documentation, licences and the content of packages.

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

/// Appends the lint steps, cheapest first.
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

/// Makes Cargo reuse the metadata of the workspace's libraries that Clippy has written. Cargo identifies metadata by
/// the program that wrote it and by that program's arguments. `cargo clippy` passes the program and the arguments in
/// the two environment variables that this function sets. If the variables differ, Cargo checks the libraries again.
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

/// Documents programs first, then libraries. The program `karat` and the library `karat` share a folder, and `cargo`
/// removes the folder before it writes the documentation of one of them. If both are documented at the same time,
/// `cargo` sometimes fails.
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
