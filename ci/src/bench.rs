//! `cargo ci bench`: the harness's benchmarks.

use anyhow::Result;

use crate::command;

/// Runs the benchmarks, handing `arguments` to them.
pub(crate) fn run(arguments: &[String]) -> Result<()> {
    let mut bench =
        command::cargo(&["bench", "--locked", "--package", "tests", "--bench", "karat"]);
    if !arguments.is_empty() {
        bench.arg("--").args(arguments);
    }
    command::run(&mut bench)
}
