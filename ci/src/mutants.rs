//! `cargo ci mutants`: runs `karat mutate` over the shader library.

use anyhow::Result;

use crate::command;

/// Tries all mutants, or only the mutants that `names` selects. Each name is a module, a function, or the id of a
/// mutant.
pub(crate) fn run(names: &[String]) -> Result<()> {
    let mut mutate = command::karat(&["mutate", "--tests", "library::"])?;
    mutate.args(names.iter().flat_map(|name| ["--only", name]));
    // The engine draws no frames, so mutants that only frames detect survive: `--fail-under` is 0. The report lists the
    // survivors, and the exit code reports wrong acceptances.
    mutate.args(["--fail-under", "0", "--stryker", "target/karat/mutation.json"]);
    command::run(&mut mutate)
}
