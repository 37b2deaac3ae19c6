//! `cargo ci semver`: checks that the libraries' public interfaces changed no more than their version numbers allow.
//!
//! cargo-semver-checks gives the verdict, but doesn't detect changed types in signatures. So this command also prints
//! all changes of the interfaces, item by item, and a person decides which of these changes break users.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::SystemTime;

use anyhow::{Context, Result, bail, ensure};
use serde_json::Value;

use crate::command;

/// The file that names the revision to compare with, as long as there is no release.
const FILE: &str = "ci/baseline.txt";
const BASELINE: &str = include_str!("../baseline.txt");

/// The libraries with stable interfaces. Other libraries are internal parts of Karat.
const PROMISED: [&str; 3] = ["karat", "karat-gallery", "karat-suite"];

const TOOLS: [&str; 2] = ["cargo-semver-checks", "cargo-public-api"];

/// Compares the interfaces of the working tree with the interfaces of a revision. The default is the newest release, or
/// the revision in `ci/baseline.txt` if there is no release.
pub(crate) fn run(revision: Option<String>) -> Result<()> {
    for tool in TOOLS {
        let name = tool.trim_start_matches("cargo-");
        ensure!(
            command::succeeds(&mut command::cargo(&[name, "--version"])),
            "{tool} is missing; `cargo install {tool} --locked` builds it"
        );
    }
    let (revision, origin) = match revision {
        Some(revision) => (revision, "the command line"),
        None => match newest(&git(&["tag", "--list"])) {
            Some(tag) => (tag, "the newest release"),
            None => (baseline(BASELINE).to_owned(), FILE),
        },
    };
    expect_there(&revision, origin)?;
    eprintln!("compared with {revision}: {origin}");
    let mut check =
        command::cargo(&["semver-checks", "check-release", "--baseline-rev", &revision]);
    for name in PROMISED {
        check.args(["--package", name]);
    }
    let began = SystemTime::now();
    // List the signatures even if cargo-semver-checks fails.
    let judged = command::run(&mut check);
    for name in PROMISED {
        let [old, new] = interfaces(name, began)?.map(|file| published(&file));
        let (old, new) = (old?, new?);
        eprintln!("\n{name}, item by item:");
        command::run(command::cargo(&["public-api", "diff"]).arg(old).arg(new))?;
    }
    judged
}

/// Returns the tag of the newest release, such as `v0.2.0`.
fn newest(tags: &[String]) -> Option<String> {
    let version = |tag: &&String| -> Option<[u64; 3]> {
        let parts: Vec<&str> = tag.strip_prefix('v')?.split('.').collect();
        let parts: Option<Vec<u64>> = parts.iter().map(|part| part.parse().ok()).collect();
        parts?.try_into().ok()
    };
    tags.iter().filter(|tag| version(tag).is_some()).max_by_key(version).cloned()
}

/// Returns the first line that isn't empty or a comment: the revision in `ci/baseline.txt`.
fn baseline(text: &str) -> &str {
    let mut lines = text.lines().map(str::trim);
    lines.find(|line| !line.is_empty() && !line.starts_with('#')).unwrap_or_default()
}

/// Returns an error if this repository doesn't have the revision. The error says how to get the revision.
fn expect_there(revision: &str, origin: &str) -> Result<()> {
    let commit = format!("{revision}^{{commit}}");
    if !git(&["rev-parse", "--verify", "--quiet", "--end-of-options", &commit]).is_empty() {
        return Ok(());
    }
    if origin != FILE {
        bail!("this repository has no revision `{revision}`, from {origin}");
    }
    let last = git(&["log", "-n", "1", "--format=%h", "--", FILE]);
    let last = last.first().map_or("the first commit", String::as_str);
    bail!(
        "`{FILE}` names `{revision}`, which this repository doesn't have.\n\
         In a shallow clone, `git fetch --unshallow --tags` brings it.\n\
         If the history was rewritten, the commit is gone: write into `{FILE}` the first one of the new history \
         whose interfaces users may rely on. {last} is the one that last changed that file."
    )
}

/// Runs git, and returns the lines that it prints. Returns no lines if git fails.
fn git(arguments: &[&str]) -> Vec<String> {
    let output = Command::new("git").args(arguments).current_dir(command::root()).output();
    let answer = output.ok().filter(|output| output.status.success());
    let text = answer.map(|output| String::from_utf8_lossy(&output.stdout).into_owned());
    text.unwrap_or_default().lines().map(str::to_owned).collect()
}

/// Returns the two JSON files, newer than `since`, in which cargo-semver-checks describes a library's interface: first
/// at the revision, then in the working tree.
fn interfaces(name: &str, since: SystemTime) -> Result<[PathBuf; 2]> {
    let folder = command::root().join("target/semver-checks");
    let crate_name = name.replace('-', "_");
    let newest = |folders: &[PathBuf]| -> Option<PathBuf> {
        let files = folders.iter().flat_map(|folder| below(folder)).filter(|folder| {
            let name = folder.file_name().unwrap_or_default().to_string_lossy();
            name.starts_with(&format!("local-{crate_name}-"))
        });
        let files = files.map(|folder| folder.join(format!("target/doc/{crate_name}.json")));
        let made = |file: &PathBuf| file.metadata().and_then(|facts| facts.modified()).ok();
        let newest = files.filter(|file| made(file).is_some()).max_by_key(made)?;
        (made(&newest)? >= since).then_some(newest)
    };
    let of_revisions: Vec<PathBuf> = below(&folder)
        .into_iter()
        .filter(|folder| {
            folder.file_name().unwrap_or_default().to_string_lossy().starts_with("git-")
        })
        .collect();
    let both = newest(&of_revisions).zip(newest(std::slice::from_ref(&folder)));
    let (old, new) = both.with_context(|| {
        format!("cargo-semver-checks left no interfaces of {name} in `{}`", folder.display())
    })?;
    Ok([old, new])
}

/// Writes a copy of an interface's description without the private items, and returns the path of the copy.
/// cargo-semver-checks makes rustdoc describe private items, too.
fn published(file: &Path) -> Result<PathBuf> {
    let text = std::fs::read(file).with_context(|| format!("can't read `{}`", file.display()))?;
    let mut described = serde_json::from_slice(&text).context("rustdoc wrote no JSON")?;
    leave_public(&mut described);
    let public = file.with_extension("public.json");
    std::fs::write(&public, described.to_string())
        .with_context(|| format!("can't write `{}`", public.display()))?;
    Ok(public)
}

/// Removes private items from the lists of items in modules, types and `impl`s. The items' own descriptions stay,
/// because a module may reexport the items.
fn leave_public(described: &mut Value) {
    const LISTS: [&str; 3] =
        ["/inner/module/items", "/inner/impl/items", "/inner/struct/kind/plain/fields"];
    let Some(index) = described["index"].as_object_mut() else { return };
    // Items of a trait have the visibility `default`.
    let is_public =
        |item: &Value| item["visibility"] == "public" || item["visibility"] == "default";
    let hidden = index.iter().filter(|(_, item)| !is_public(item));
    let hidden: BTreeSet<String> = hidden.map(|(id, _)| id.clone()).collect();
    for item in index.values_mut() {
        for list in LISTS {
            if let Some(list) = item.pointer_mut(list).and_then(Value::as_array_mut) {
                list.retain(|id| !hidden.contains(&id.to_string()));
            }
        }
    }
}

/// Returns the files and folders directly inside a folder.
fn below(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_revision_is_named() {
        assert_eq!(baseline("# why\n\n v0.1.0 \n"), "v0.1.0");
        assert!(!baseline(BASELINE).is_empty());
    }

    #[test]
    fn the_newest_release_comes_first() {
        let newest =
            |tags: &[&str]| newest(&tags.iter().map(ToString::to_string).collect::<Vec<_>>());
        assert_eq!(newest(&["v0.9.0", "v0.10.0", "v0.2.11"]).as_deref(), Some("v0.10.0"));
        assert_eq!(newest(&["v1.0.0-rc.1", "nightly", "v1", "0.1.0", "version"]), None);
    }

    #[test]
    fn private_items_are_left_out() {
        let item =
            |visibility: Value, inner: Value| json!({ "visibility": visibility, "inner": inner });
        let function = || json!({ "function": {} });
        let mut described = json!({ "index": {
            "0": item("public".into(), json!({ "module": { "items": [1, 2, 3] } })),
            "1": item("public".into(), function()),
            "2": item("crate".into(), json!({ "module": { "items": [] } })),
            "3": item("default".into(), json!({ "impl": { "items": [1, 4, 5] } })),
            "4": item("default".into(), function()),
            "5": item(json!({ "restricted": { "parent": 0, "path": "::m" } }), function()),
        } });
        leave_public(&mut described);
        let index = &described["index"];
        assert_eq!(index["0"]["inner"]["module"]["items"], json!([1, 3]));
        assert_eq!(index["3"]["inner"]["impl"]["items"], json!([1, 4]));
        assert!(index["2"].is_object(), "what it holds may be reexported");
    }

    #[test]
    fn a_missing_revision_is_an_error_with_a_remedy() {
        // No object of git has a name of only zeros.
        let gone = "0".repeat(40);
        let why = expect_there(&gone, FILE).expect_err("there is none").to_string();
        assert!(why.contains("names `000") && why.contains("git fetch --unshallow"), "{why}");
        let why = expect_there("v99.0.0", "the command line").expect_err("none").to_string();
        assert_eq!(why, "this repository has no revision `v99.0.0`, from the command line");
    }
}
