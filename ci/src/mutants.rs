//! `cargo ci mutants`: `karat mutate` over the shader library.

use anyhow::Result;

use crate::command;

/// Tries all mutants, or those of what is named: a module, a function, or the id of a mutant.
pub(crate) fn run(names: &[String]) -> Result<()> {
    let mut mutate = command::karat(&["mutate", "--tests", "library::"])?;
    mutate.args(names.iter().flat_map(|name| ["--only", name]));
    // Mutants that frames alone see live on the engine: the report says which, and the exit code acceptances that don't hold.
    mutate.args(["--fail-under", "0", "--stryker", "target/karat/mutation.json"]);
    command::run(&mut mutate)
}
