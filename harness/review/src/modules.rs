//! Finds the modules that changed since a golden was made: by the hashes in golden and frame, or otherwise with git.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use karat::unstable::diagnostic::text_hash;
use karat::unstable::golden::Provenance;
use serde_json::{Value, json};

use super::git;

/// The largest number of commits in which Karat looks for the golden's version of a module. Karat runs a `git` process
/// for each commit, the latest first.
const MOST: &str = "50";

/// Returns the modules whose hashes differ. Returns `None` if golden or frame have no hashes, as in old files. Module
/// names are relative to `project`.
pub(super) fn by_hash(project: &Path, golden: &Provenance, actual: &Provenance) -> Option<Value> {
    let (old, new) = (&golden.modules, &actual.modules);
    if old.is_empty() || new.is_empty() {
        return None;
    }
    let names: BTreeSet<&String> = old.keys().chain(new.keys()).collect();
    let changed = names.into_iter().filter_map(|name| match (old.get(name), new.get(name)) {
        (Some(old), Some(new)) if old == new => None,
        (Some(old), Some(new)) => Some(difference(project, name, old, new)),
        (Some(_), None) => {
            Some(json!({ "name": name, "note": "the frame no longer uses this module" }))
        }
        (None, _) => Some(json!({ "name": name, "note": "the golden didn't use this module" })),
    });
    let changed: Vec<Value> = changed.collect();
    // Features and overrides change a program without changing its modules.
    let otherwise = changed.is_empty() && golden.shader != actual.shader;
    Some(json!({ "hashed": new.len(), "otherwise": otherwise, "changed": changed }))
}

/// Returns a changed module, with the changed lines if git has the golden's version.
fn difference(project: &Path, name: &str, old: &str, new: &str) -> Value {
    let Some(commit) = commit_with(project, name, old) else {
        let note = "git doesn't have the version of this module that drew the golden";
        return json!({ "name": name, "note": note });
    };
    let files = git::differences(project, &commit, &[git::literal(name)]).unwrap_or_default();
    let lines = files.into_iter().next().map(|(_, lines)| lines);
    let edited = !std::fs::read(project.join(name)).is_ok_and(|text| text_hash(&text) == new);
    let note = edited.then_some("the module was edited again after the frame was drawn");
    json!({ "name": name, "diff": lines, "note": note })
}

/// Returns the latest commit in which a file has this hash.
fn commit_with(project: &Path, name: &str, hash: &str) -> Option<String> {
    let arguments = ["log", "-n", MOST, "--format=%h", "--", &git::literal(name)];
    let commits = git::text(project, &arguments)?;
    let has = |commit: &&str| {
        let text = git::bytes(project, &["show", &format!("{commit}:./{name}")]);
        text.is_some_and(|text| text_hash(&text) == hash)
    };
    commits.lines().find(has).map(str::to_owned)
}

/// Returns the modules that changed since the commit of the golden. `modules` lists the modules that the frame depends
/// on; the list comes from the frame's file or from the last run. If `modules` is `None`, or has no module in this
/// repository, Karat compares all modules of the repository.
pub(super) fn by_commit(golden: &Path, modules: Option<&[PathBuf]>) -> Value {
    match Since::find(golden).and_then(|since| since.changed(modules)) {
        Ok(known) => known,
        Err(why) => json!({ "unknown": why.to_string() }),
    }
}

#[derive(Clone, Copy, Debug, thiserror::Error)]
enum Untold {
    #[error("the golden isn't in a git repository, so its modules are unknown")]
    NoGit,
    #[error("the golden isn't committed, so its modules are unknown")]
    Uncommitted,
    #[error("git can't compare the modules")]
    Failed,
}

/// The commit that last changed a golden. The golden has no uncommitted changes.
struct Since {
    root: PathBuf,
    commit: String,
}

impl Since {
    fn find(golden: &Path) -> Result<Self, Untold> {
        let folder = golden.parent().ok_or(Untold::NoGit)?;
        let name = git::literal(&golden.file_name().unwrap_or_default().to_string_lossy());
        let root = git::text(folder, &["rev-parse", "--show-toplevel"]).ok_or(Untold::NoGit)?;
        // A repository without commits doesn't contain the golden.
        let commit =
            git::text(folder, &["log", "-n", "1", "--format=%h", "--", &name]).unwrap_or_default();
        let dirty =
            git::text(folder, &["status", "--porcelain", "--", &name]).ok_or(Untold::NoGit)?;
        if commit.is_empty() || !dirty.is_empty() {
            return Err(Untold::Uncommitted);
        }
        Ok(Self { root: root.trim_end().into(), commit: commit.trim().to_owned() })
    }

    /// Returns the modules in this repository as paths for git. Leaves out files outside of the repository, such as
    /// modules of a crate or paths from another machine.
    fn inside(&self, modules: &[PathBuf]) -> Vec<String> {
        // If a file is behind a link, git names its real path.
        let real = |file: &PathBuf| file.canonicalize().unwrap_or_else(|_| file.clone());
        let root = real(&self.root);
        let inside =
            |file: PathBuf| Some(git::literal(&file.strip_prefix(&root).ok()?.to_string_lossy()));
        modules.iter().map(real).filter_map(inside).collect()
    }

    fn changed(&self, modules: Option<&[PathBuf]>) -> Result<Value, Untold> {
        let own = modules.map(|modules| self.inside(modules)).filter(|paths| !paths.is_empty());
        let all = own.is_none();
        let paths = own.unwrap_or_else(|| ["*.wgsl", "*.wesl"].map(str::to_owned).into());
        let files = git::differences(&self.root, &self.commit, &paths).ok_or(Untold::Failed)?;
        let lines = files.into_iter().map(|(name, lines)| json!({ "name": name, "diff": lines }));
        let mut changed: Vec<Value> = lines.collect();
        let mut listing = vec!["ls-files", "--others", "--exclude-standard", "--"];
        listing.extend(paths.iter().map(String::as_str));
        let new = git::text(&self.root, &listing).ok_or(Untold::Failed)?;
        let new = new
            .lines()
            .map(|name| json!({ "name": name, "note": "this module is new and isn't in git yet" }));
        changed.extend(new);
        Ok(json!({ "since": self.commit, "all": all, "changed": changed }))
    }
}
