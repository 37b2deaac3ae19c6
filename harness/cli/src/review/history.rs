//! What git knows of a golden: its versions with their reasons, and which modules changed since.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::{Value, json};

/// Versions that are listed.
const MOST: usize = 30;
/// Bytes of a difference that are shown: nobody reads more.
const LONGEST: usize = 200_000;

/// Each commit that changed a golden, the latest first, with the reason that its facts have.
pub(super) fn versions(golden: &Path) -> Vec<Value> {
    let (Some(folder), Some(name), Some(stem)) =
        (golden.parent(), golden.file_name(), golden.file_stem())
    else {
        return Vec::new();
    };
    let (name, facts) = (name.to_string_lossy(), format!("{}.toml", stem.to_string_lossy()));
    let most = MOST.to_string();
    let log = git(
        folder,
        &[
            "log",
            "-n",
            &most,
            "--format=%h%x1f%as%x1f%an%x1f%s",
            "--",
            &literal(&name),
            &literal(&facts),
        ],
    );
    let version = |line: &str| {
        let mut fields = line.split('\u{1f}');
        let (commit, date, author, subject) =
            (fields.next()?, fields.next()?, fields.next()?, fields.next()?);
        let text = git(folder, &["show", &format!("{commit}:./{facts}")]).unwrap_or_default();
        let facts: toml::Table = text.parse().unwrap_or_default();
        let fact = |name: &str| facts.get(name).and_then(toml::Value::as_str).unwrap_or_default();
        Some(json!({
            "commit": commit, "date": date, "author": author, "subject": subject,
            "because": fact("because"), "by": fact("accepted_by"), "at": fact("accepted_at"),
            "pixels": fact("pixels"),
        }))
    };
    log.unwrap_or_default().lines().filter_map(version).collect()
}

/// The modules that differ from what they were when the golden was committed. `modules`: those that the
/// frame depends on, as its last run recorded them; without them, each module of the repository.
pub(super) fn modules(golden: &Path, modules: Option<&[PathBuf]>) -> Value {
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
        let name = literal(&golden.file_name().unwrap_or_default().to_string_lossy());
        let root = git(folder, &["rev-parse", "--show-toplevel"]).ok_or(Untold::NoGit)?;
        // A repository without commits has none of it.
        let commit =
            git(folder, &["log", "-n", "1", "--format=%h", "--", &name]).unwrap_or_default();
        let dirty = git(folder, &["status", "--porcelain", "--", &name]).ok_or(Untold::NoGit)?;
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
            |file: PathBuf| Some(literal(&file.strip_prefix(&root).ok()?.to_string_lossy()));
        modules.iter().map(real).filter_map(inside).collect()
    }

    fn changed(&self, modules: Option<&[PathBuf]>) -> Result<Value, Untold> {
        let own = modules.map(|modules| self.inside(modules)).filter(|paths| !paths.is_empty());
        let all = own.is_none();
        let paths = own.unwrap_or_else(|| ["*.wgsl", "*.wesl"].map(str::to_owned).into());
        let with_paths = |arguments: &[&str]| {
            let paths = paths.iter().map(String::as_str);
            let all: Vec<&str> = arguments.iter().copied().chain(["--"]).chain(paths).collect();
            git(&self.root, &all).ok_or(Untold::Failed)
        };
        let mut diff = vec!["diff", "--no-ext-diff", "--no-textconv", "--no-color", "--no-renames"];
        diff.extend(["--src-prefix=a/", "--dst-prefix=b/", &self.commit]);
        let mut text = with_paths(&diff)?;
        if text.len() > LONGEST {
            text.truncate(text.floor_char_boundary(LONGEST));
            text.push_str("\n…");
        }
        let file = |part: &str| {
            let name = part.lines().next()?.rsplit_once(" b/")?.1.to_owned();
            // From the first change on: what is above names the file again.
            let from = part.find("\n@@")? + 1;
            Some(json!({ "name": name, "diff": part[from..].trim_end() }))
        };
        let mut changed: Vec<Value> =
            format!("\n{text}").split("\ndiff --git ").filter_map(file).collect();
        let new = with_paths(&["ls-files", "--others", "--exclude-standard"])?;
        let new =
            new.lines().map(|name| json!({ "name": name, "diff": "new, and not in git yet" }));
        changed.extend(new);
        Ok(json!({ "since": self.commit, "all": all, "changed": changed }))
    }
}

/// A path that is no pattern, whatever its characters.
fn literal(path: &str) -> String {
    format!(":(literal){path}")
}

/// What git prints; `None` if it isn't there or fails. It changes nothing.
fn git(folder: &Path, arguments: &[&str]) -> Option<String> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let mut command = Command::new("git");
    command.args(["-c", "core.quotepath=off"]).args(arguments).current_dir(folder);
    command.env("GIT_OPTIONAL_LOCKS", "0").env("LC_ALL", "C");
    // Whoever runs this in a hook of git's has another repository in mind.
    for name in ["GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"] {
        command.env_remove(name);
    }
    let ran = command.stdin(Stdio::null()).stderr(Stdio::null()).output().ok()?;
    ran.status.success().then(|| String::from_utf8_lossy(&ran.stdout).into_owned())
}
