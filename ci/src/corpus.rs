//! `cargo ci corpus` and `cargo ci found`: checks of shaders of published crates. cargo fetches the crates, and doesn't
//! compile them.

use std::path::PathBuf;
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};

use crate::{command, setup};

/// The text above the table in the documentation.
const HEAD: &str = "\
# Shaders that others wrote

Made by `cargo ci corpus` from the list in `ci/corpus.toml`; nothing of the crates is kept here. A
module *opens* if its functions can be listed. It is *whole* if it links and is valid with all that it
holds, under the features that the list sets: `karat check --crate bevy_pbr@0.20.1` alone says that many
modules of Bevy's aren't valid, since they need values that the engine sets. A function is *callable* if `karat call` and tests can
call it.

Where a crate's Rust puts its text together, the list has the `karat.toml` that says the same: features, `[values]`, a
`preprocess` command. Below the table stands why the other functions are refused.

";

/// The text above the table of translations.
const ROUTES_HEAD: &str = "\
# Shaders that others wrote, on each route

Made by `cargo ci corpus --routes` from the list in `ci/corpus.toml`. *In the matrix* are functions that a
kernel can call and entry points of valid modules; [corpus.md](corpus.md) says why the others aren't. A
function runs on 64 inputs that are made up from its signature, and agrees if another column returns the
same within 1e-3. *Wrong* are cells whose results differ, that a validator rejects, or that naga doesn't
write; most of the rejections are glslang's of naga's HLSL. Digits in messages are `#`.

";

/// The text above the table of both compilers.
const COMPILERS_HEAD: &str = "\
# Shaders that others wrote, by both compilers

Made by `cargo ci corpus --compilers` from the list in `ci/corpus.toml`, with the features that the list sets.
Each module is asked about as `karat check --crate NAME@VERSION` does it: naga is the compiler of wgpu and
Firefox, Tint that of Chrome, Edge, Node and Electron. *On purpose* are modules that use what wgpu alone has,
such as ray queries; the others don't run in Chrome, and nothing in them says that they aren't meant to.
*Neither* are mostly modules that another program makes WGSL of: [corpus.md](corpus.md) says which.

";

/// Runs both compilers on the shaders of a list.
pub(crate) fn run_compilers(list: Option<PathBuf>) -> Result<()> {
    setup::install_tint()?;
    table(list, "corpus_compilers", None, ("docs/corpus-compilers.md", COMPILERS_HEAD))
}

/// Takes the shaders of a list through each translation.
pub(crate) fn run_routes(list: Option<PathBuf>, json: Option<PathBuf>) -> Result<()> {
    table(list, "corpus_matrix", json, ("docs/corpus-translations.md", ROUTES_HEAD))
}

/// A program of `ci/corpus`.
pub(crate) fn program(name: &str) -> Command {
    command::cargo(&["run", "--locked", "--bin", name, "--"])
}

/// Runs a program over the shaders of a list, and prints its table. The table of the usual list is a page of the
/// documentation.
fn table(
    list: Option<PathBuf>,
    name: &str,
    json: Option<PathBuf>,
    (page, head): (&str, &str),
) -> Result<()> {
    let documented = list.is_none();
    let list = list.unwrap_or_else(|| command::root().join("ci/corpus.toml"));
    let mut corpus = program(name);
    corpus.arg(list).stderr(Stdio::inherit());
    if let Some(folder) = json {
        corpus.arg("--json").arg(folder);
    }
    let output = corpus.output().context("cargo doesn't run")?;
    let table = String::from_utf8(output.stdout).context("the table isn't text")?;
    eprint!("{table}");
    ensure!(output.status.success(), "the corpus has faults");
    if documented {
        let file = command::root().join(page);
        std::fs::write(&file, format!("{head}{table}"))
            .with_context(|| format!("can't write `{}`", file.display()))?;
    }
    Ok(())
}

/// Runs the checks that find faults of released shaders, and writes their pages.
pub(crate) fn run_found() -> Result<()> {
    let mut found = program("found");
    found.arg(command::root().join("docs/found"));
    ensure!(found.status().context("cargo doesn't run")?.success(), "a finding isn't one");
    ensure!(
        program("passes").status().context("cargo doesn't run")?.success(),
        "a crate's passes fail"
    );
    Ok(())
}

/// Checks the shaders of a list.
pub(crate) fn run(list: Option<PathBuf>, json: Option<PathBuf>) -> Result<()> {
    table(list, "corpus", json, ("docs/corpus.md", HEAD))
}
