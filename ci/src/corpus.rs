//! `cargo ci corpus` and `cargo ci found`: check the shaders of published crates. cargo fetches the crates, and doesn't
//! compile them.

use std::path::PathBuf;
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};

use crate::{command, setup};

/// The text above the table in `docs/corpus.md`.
const HEAD: &str = "\
# Shaders that others wrote

`cargo ci corpus` makes this page from the list of crates in `ci/corpus.toml`. This repository contains no text of
these crates. A module is *open* if Karat can list its functions. A module is *whole* if it links and all of it is
valid, with the features that the list sets. Without these features many modules aren't valid, because
`karat check --crate bevy_pbr@0.20.1` doesn't know the values that the engine sets. A function is *callable* if
`karat call` and tests can call it.

If a crate's Rust code generates the crate's WGSL, the list contains a `karat.toml` that generates the same WGSL, with
features, `[values]` or a `preprocess` command. The last table explains why Karat refuses the functions that aren't
callable.

";

/// The text above the table in `docs/corpus-translations.md`.
const ROUTES_HEAD: &str = "\
# Shaders that others wrote, on each route

`cargo ci corpus --routes` makes this page from the list of crates in `ci/corpus.toml`. The column *in the matrix*
counts functions that a kernel can call, and entry points of valid modules; [corpus.md](corpus.md) explains why the
matrix leaves out other functions. Karat runs each function on 64 inputs, which Karat generates from the function's
signature. A cell agrees if another column returns the same results within 1e-3. A cell is *wrong* if its results
differ from another column's results, if a validator rejects the translation, or if naga can't write the translation.
Most rejections are rejections of naga's HLSL by glslang. In messages `#` replaces digits.

";

/// The text above the table in `docs/corpus-compilers.md`.
const COMPILERS_HEAD: &str = "\
# Shaders that others wrote, by both compilers

`cargo ci corpus --compilers` makes this page from the list of crates in `ci/corpus.toml`, with the features that the
list sets. Both compilers validate each module as `karat check --crate NAME@VERSION` does. naga is the compiler of wgpu
and Firefox. Tint is the compiler of Chrome, Edge, Node and Electron. The column *naga alone, on purpose* counts
modules with features that only wgpu has, such as ray queries. The column *naga alone* counts the other modules that
only naga accepts. Most modules in the column *neither* become WGSL only after another program has processed them:
[corpus.md](corpus.md) lists these modules.

";

/// Validates the shaders of a list with naga and with Tint.
pub(crate) fn run_compilers(list: Option<PathBuf>) -> Result<()> {
    setup::install_tint()?;
    table(list, "corpus_compilers", None, ("docs/corpus-compilers.md", COMPILERS_HEAD))
}

/// Translates the shaders of a list on each route, and runs the translations.
pub(crate) fn run_routes(list: Option<PathBuf>, json: Option<PathBuf>) -> Result<()> {
    table(list, "corpus_matrix", json, ("docs/corpus-translations.md", ROUTES_HEAD))
}

/// Returns the command that runs a program of `ci/corpus`.
pub(crate) fn program(name: &str) -> Command {
    command::cargo(&["run", "--locked", "--bin", name, "--"])
}

/// Runs a program over the shaders of a list, and prints the program's table. Without a list, the program reads
/// `ci/corpus.toml`, and the table also becomes a page of the documentation.
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

/// Runs the checks that find faults of released shaders, writes a page for each fault, and compares vello's passes.
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

/// Checks which shaders of a list are valid, and which functions Karat can call.
pub(crate) fn run(list: Option<PathBuf>, json: Option<PathBuf>) -> Result<()> {
    table(list, "corpus", json, ("docs/corpus.md", HEAD))
}
