//! `cargo ci bench`: the harness's benchmarks.

use anyhow::Result;

use crate::command;

/// Runs the benchmarks, handing `arguments` to them.
pub(crate) fn run(arguments: &[String]) -> Result<()> {
    // The profile of `cargo test`: its speed is what an author waits for.
    let karat = ["bench", "--locked", "--profile", "dev", "--package", "tests", "--bench", "karat"];
    let mut bench = command::cargo(&karat);
    if !arguments.is_empty() {
        bench.arg("--").args(arguments);
    }
    command::run(&mut bench)
}
