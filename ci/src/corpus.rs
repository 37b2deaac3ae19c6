//! `cargo ci corpus`: shaders of published crates, which cargo fetches and doesn't compile.

use std::path::PathBuf;

use anyhow::Result;

use crate::command;

/// Reads the shaders of a list, and prints what became of them as a table.
pub(crate) fn run(list: Option<PathBuf>, json: Option<PathBuf>) -> Result<()> {
    let list = list.unwrap_or_else(|| command::root().join("ci/corpus.toml"));
    let mut corpus =
        command::cargo(&["run", "--locked", "--package", "karat", "--example", "corpus", "--"]);
    corpus.arg(list);
    if let Some(file) = json {
        corpus.arg("--json").arg(file);
    }
    command::run(&mut corpus)
}
