//! `cargo ci nextest`: runs tests with cargo-nextest, once completely and once in three parts, and compares the
//! reports.

use std::io::Write;
use std::process::Command;

use anyhow::{Context, Result, ensure};

use crate::command;

const TOOL: &str =
    "cargo-nextest is missing; https://nexte.st has it, or `cargo install cargo-nextest --locked`";

/// The tests to run: enough tests for three parts, and few enough to take only seconds.
const TESTS: &str = "test(/^fresnel::/)";

/// Runs tests in one run and in three parts, and compares the reports.
pub(crate) fn run() -> Result<()> {
    ensure!(command::succeeds(&mut command::cargo(&["nextest", "--version"])), TOOL);
    let folder = command::root().join("target/karat/nextest");
    if folder.exists() {
        std::fs::remove_dir_all(&folder).context("the last run's records can't be removed")?;
    }
    let part = |name: &str| folder.join(name).display().to_string();
    let record = |name: &str, more: &[&str]| {
        let runner = ["cargo", "nextest", "run", "--locked", "--package", "tests", "-E", TESTS];
        let into = part(name);
        let arguments = [&["record", "--into", &into, "--"], &runner[..], more].concat();
        command::run(&mut command::karat(&arguments)?)
    };
    record("whole", &[])?;
    for number in ["1", "2", "3"] {
        record(number, &["--partition", &format!("count:{number}/3")])?;
    }
    let whole = table(&mut command::karat(&["report", "--all", "--record", &part("whole")])?)?;
    let parts = [part("2"), part("3"), part("1")];
    let [second, third, first] = parts.each_ref().map(String::as_str);
    let merged =
        table(&mut command::karat(&["report", "--all", "--merge", second, third, first])?)?;
    ensure!(merged == whole, "of the parts:\n{merged}\nof the whole:\n{whole}");
    let lines = whole.lines().count();
    writeln!(std::io::stdout(), "three parts report what the whole does, in {lines} lines")
        .context("nobody reads the output any more")
}

/// Returns the report's text without the lines that differ between runs: the path of the record, and the slowest tests.
fn table(report: &mut Command) -> Result<String> {
    let output = report.output().context("the report can't be made")?;
    ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let lines = text
        .lines()
        .filter(|line| !["record: ", "slowest: "].iter().any(|of| line.starts_with(of)));
    Ok(lines.collect::<Vec<_>>().join("\n"))
}
