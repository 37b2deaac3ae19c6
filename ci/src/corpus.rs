//! `cargo ci corpus`: shaders of published crates, each with Karat's verdict beside naga's.

use std::fmt::Write;
use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use cargo_metadata::MetadataCommand;

use crate::command;

/// Fetches crates by exact name and version, compiles none of them, and reads their shaders.
pub(crate) fn run(crates: &[String]) -> Result<()> {
    ensure!(
        !crates.is_empty(),
        "name crates with their versions: `cargo ci corpus glyphon@0.12.0`"
    );
    let folder = std::env::temp_dir().join(format!("karat-corpus-{}", std::process::id()));
    let folders = fetch(crates, &folder);
    // What was fetched is in cargo's own cache.
    drop(std::fs::remove_dir_all(&folder));
    let mut corpus =
        command::cargo(&["run", "--locked", "--package", "karat", "--example", "corpus", "--"]);
    command::run(corpus.args(folders?))
}

/// The folders of the crates' sources.
fn fetch(crates: &[String], folder: &std::path::Path) -> Result<Vec<PathBuf>> {
    let mut manifest = String::from(
        "[package]\nname = \"corpus\"\nversion = \"0.0.0\"\nedition = \"2024\"\n[workspace]\n\
         [dependencies]\n",
    );
    let mut wanted = Vec::new();
    for (index, name) in crates.iter().enumerate() {
        let (name, version) = name
            .split_once('@')
            .with_context(|| format!("`{name}` names no version: write `{name}@1.2.3`"))?;
        writeln!(
            manifest,
            "crate{index} = {{ package = \"{name}\", version = \"={version}\", default-features = false }}"
        )?;
        wanted.push((name, version));
    }
    std::fs::create_dir_all(folder.join("src"))?;
    std::fs::write(folder.join("src/lib.rs"), "")?;
    let path = folder.join("Cargo.toml");
    std::fs::write(&path, manifest)?;
    // A crate that declares a newer Rust is read all the same: it isn't compiled.
    let metadata = MetadataCommand::new()
        .manifest_path(&path)
        .current_dir(folder)
        .env("CARGO_RESOLVER_INCOMPATIBLE_RUST_VERSIONS", "allow")
        .exec()
        .context("cargo can't fetch these crates")?;
    let mut folders = Vec::new();
    for (name, version) in wanted {
        let found = metadata.packages.iter().find(|package| {
            package.name.as_str() == name && package.version.to_string() == version
        });
        let found = found.with_context(|| format!("cargo fetched no {name} {version}"))?;
        let manifest = found.manifest_path.parent().context("a manifest is in a folder")?;
        folders.push(manifest.to_path_buf().into_std_path_buf());
    }
    Ok(folders)
}
