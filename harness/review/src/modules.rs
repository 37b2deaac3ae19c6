//! Which modules changed since a golden: by the hashes that golden and frame have of them, or else as git
//! tells.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use karat::unstable::diagnostic::text_hash;
use karat::unstable::golden::Provenance;
use serde_json::{Value, json};

use super::git;

/// Versions of a module among which the golden's is looked for: each takes a process.
const MOST: &str = "50";

/// The modules that differ by their hashes. `None`: golden or frame is older than this fact.
/// `project`: where their names begin.
pub(super) fn by_hash(project: &Path, golden: &Provenance, actual: &Provenance) -> Option<Value> {
    let (old, new) = (&golden.modules, &actual.modules);
    if old.is_empty() || new.is_empty() {
        return None;
    }
    let names: BTreeSet<&String> = old.keys().chain(new.keys()).collect();
    let changed = names.into_iter().filter_map(|name| match (old.get(name), new.get(name)) {
        (Some(old), Some(new)) if old == new => None,
        (Some(old), Some(new)) => Some(difference(project, name, old, new)),
        (Some(_), None) => Some(json!({ "name": name, "note": "the frame has it no longer" })),
        (None, _) => Some(json!({ "name": name, "note": "the golden didn't have it" })),
    });
    let changed: Vec<Value> = changed.collect();
    // Features and overrides change a program whose modules stay.
    let otherwise = changed.is_empty() && golden.shader != actual.shader;
    Some(json!({ "hashed": new.len(), "otherwise": otherwise, "changed": changed }))
}

/// A module that changed, with its lines if git has the golden's version of it.
fn difference(project: &Path, name: &str, old: &str, new: &str) -> Value {
    let Some(commit) = commit_with(project, name, old) else {
        let note = "git has no version of it with the golden's hash";
        return json!({ "name": name, "note": note });
    };
    let files = git::differences(project, &commit, &[git::literal(name)]).unwrap_or_default();
    let lines = files.into_iter().next().map(|(_, lines)| lines);
    let edited = !std::fs::read(project.join(name)).is_ok_and(|text| text_hash(&text) == new);
    let note = edited.then_some("it was edited again since the frame was drawn");
    json!({ "name": name, "diff": lines, "note": note })
}

/// The latest commit in which a file has this hash.
fn commit_with(project: &Path, name: &str, hash: &str) -> Option<String> {
    let arguments = ["log", "-n", MOST, "--format=%h", "--", &git::literal(name)];
    let commits = git::text(project, &arguments)?;
    let has = |commit: &&str| {
        let text = git::bytes(project, &["show", &format!("{commit}:./{name}")]);
        text.is_some_and(|text| text_hash(&text) == hash)
    };
    commits.lines().find(has).map(str::to_owned)
}

/// The modules that differ from what they were when the golden was committed. `modules`: those that the
/// frame depends on, as it says itself or its last run recorded them; without them, each module of the
/// repository.
pub(super) fn by_commit(golden: &Path, modules: Option<&[PathBuf]>) -> Value {
    match Since::find(golden).and_then(|since| since.changed(modules)) {
        Ok(known) => known,
        Err(why) => json!({ "unknown": why.to_string() }),
    }
}

/// Why it can't be told which modules changed.
#[derive(Clone, Copy, Debug, thiserror::Error)]
enum Untold {
    #[error(
        "the golden is in no git repository, which would have the modules that it was made with"
    )]
    NoGit,
    #[error("the golden isn't committed, so git doesn't know which modules it was made with")]
    Uncommitted,
    #[error("git fails to compare them")]
    Failed,
}

/// The commit that has the golden as it is now.
struct Since {
    root: PathBuf,
    commit: String,
}

impl Since {
    fn find(golden: &Path) -> Result<Self, Untold> {
        let folder = golden.parent().ok_or(Untold::NoGit)?;
        let name = git::literal(&golden.file_name().unwrap_or_default().to_string_lossy());
        let root = git::text(folder, &["rev-parse", "--show-toplevel"]).ok_or(Untold::NoGit)?;
        // A repository without commits has none of it.
        let commit =
            git::text(folder, &["log", "-n", "1", "--format=%h", "--", &name]).unwrap_or_default();
        let dirty =
            git::text(folder, &["status", "--porcelain", "--", &name]).ok_or(Untold::NoGit)?;
        if commit.is_empty() || !dirty.is_empty() {
            return Err(Untold::Uncommitted);
        }
        Ok(Self { root: root.trim_end().into(), commit: commit.trim().to_owned() })
    }

    /// Modules of a record as paths for git. Those of another machine, or of crates from elsewhere, are
    /// none of this repository's.
    fn inside(&self, modules: &[PathBuf]) -> Vec<String> {
        // What is reached by a link is named by its own place, as git names it.
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
        let new =
            new.lines().map(|name| json!({ "name": name, "note": "new, and not in git yet" }));
        changed.extend(new);
        Ok(json!({ "since": self.commit, "all": all, "changed": changed }))
    }
}
