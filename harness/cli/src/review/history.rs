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
    match changed(golden, modules) {
        Ok((commit, diffs)) => json!({
            "since": commit,
            "all": modules.is_none(),
            "changed": diffs.iter().map(|(name, diff)| json!({ "name": name, "diff": diff })).collect::<Vec<_>>(),
        }),
        Err(why) => json!({ "unknown": why }),
    }
}

fn changed(
    golden: &Path,
    modules: Option<&[PathBuf]>,
) -> Result<(String, Vec<(String, String)>), &'static str> {
    let folder = golden.parent().ok_or("the golden has no folder")?;
    let name = golden.file_name().unwrap_or_default().to_string_lossy();
    let none =
        "the golden is in no git repository, which would have the modules that it was made with";
    let root = git(folder, &["rev-parse", "--show-toplevel"]).ok_or(none)?;
    let root = Path::new(root.trim_end());
    let commit =
        git(folder, &["log", "-n", "1", "--format=%h", "--", &literal(&name)]).ok_or(none)?;
    let commit = commit.trim();
    let dirty = git(folder, &["status", "--porcelain", "--", &literal(&name)]).ok_or(none)?;
    if commit.is_empty() || !dirty.is_empty() {
        return Err(
            "the golden isn't committed, so git doesn't know which modules it was made with",
        );
    }
    let paths: Vec<String> = match modules {
        // A link to the repository would make its files others' than git's.
        Some(modules) => {
            let real = |file: &PathBuf| file.canonicalize().unwrap_or_else(|_| file.clone());
            let root = root.canonicalize().unwrap_or_else(|_| root.to_owned());
            let inside =
                |file: PathBuf| Some(literal(&file.strip_prefix(&root).ok()?.to_string_lossy()));
            modules.iter().map(real).filter_map(inside).collect()
        }
        None => ["*.wgsl", "*.wesl"].map(str::to_owned).into(),
    };
    if paths.is_empty() {
        return Ok((commit.to_owned(), Vec::new()));
    }
    let with_paths = |arguments: &[&str]| {
        let paths = paths.iter().map(String::as_str);
        git(root, &arguments.iter().copied().chain(["--"]).chain(paths).collect::<Vec<_>>())
    };
    let failed = "git can't tell how the modules changed";
    let arguments =
        ["diff", "--no-ext-diff", "--no-textconv", "--no-color", "--no-renames", commit];
    let mut text = with_paths(&arguments).ok_or(failed)?;
    if text.len() > LONGEST {
        text.truncate(text.floor_char_boundary(LONGEST));
        text.push_str("\n…");
    }
    let file = |part: &str| {
        let name = part.lines().next()?.rsplit_once(" b/")?.1.to_owned();
        // From the first change on: what is above names the file again.
        let from = part.find("\n@@")? + 1;
        Some((name, part[from..].trim_end().to_owned()))
    };
    let mut diffs: Vec<_> = format!("\n{text}").split("\ndiff --git ").filter_map(file).collect();
    let new = with_paths(&["ls-files", "--others", "--exclude-standard"]).ok_or(failed)?;
    diffs.extend(new.lines().map(|name| (name.to_owned(), "new, and not in git yet".to_owned())));
    Ok((commit.to_owned(), diffs))
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
    let ran = command.stdin(Stdio::null()).stderr(Stdio::null()).output().ok()?;
    ran.status.success().then(|| String::from_utf8_lossy(&ran.stdout).into_owned())
}
