//! Runs `git` commands that only read.

use std::path::Path;
use std::process::Command;

use karat::unstable::process;

/// Returns a pathspec that git takes literally, whatever characters the path has.
pub(super) fn literal(path: &str) -> String {
    format!(":(literal){path}")
}

/// Returns the output of git as text, or `None` if git isn't installed or fails.
pub(super) fn text(folder: &Path, arguments: &[&str]) -> Option<String> {
    bytes(folder, arguments).map(|bytes| String::from_utf8_lossy(&bytes).into_owned())
}

/// Returns the output of git, or `None` if git isn't installed or fails.
pub(super) fn bytes(folder: &Path, arguments: &[&str]) -> Option<Vec<u8>> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let mut command = Command::new("git");
    command.args(["-c", "core.quotepath=off"]).args(arguments).current_dir(folder);
    command.env("GIT_OPTIONAL_LOCKS", "0").env("LC_ALL", "C");
    // In a git hook, these variables name another repository.
    for name in ["GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"] {
        command.env_remove(name);
    }
    let ran = process::output(&mut command, process::LOOK_UP, u64::MAX).ok()?;
    ran.status.success().then_some(ran.stdout)
}

/// Returns the differences between files of the working tree and a commit. Each entry has a file's path relative to the
/// repository, and the differences in this file as text. Returns `None` if git fails.
pub(super) fn differences(
    folder: &Path,
    commit: &str,
    paths: &[String],
) -> Option<Vec<(String, String)>> {
    /// The largest size of all differences together, in bytes.
    const LONGEST: usize = 200_000;
    let mut arguments =
        vec!["diff", "--no-ext-diff", "--no-textconv", "--no-color", "--no-renames"];
    arguments.extend(["--src-prefix=a/", "--dst-prefix=b/", commit, "--"]);
    arguments.extend(paths.iter().map(String::as_str));
    let mut all = text(folder, &arguments)?;
    if all.len() > LONGEST {
        all.truncate(all.floor_char_boundary(LONGEST));
        all.push_str("\n…");
    }
    let file = |part: &str| {
        let name = part.lines().next()?.rsplit_once(" b/")?.1.to_owned();
        // The text begins at the first change: the lines above repeat the file name.
        let from = part.find("\n@@")? + 1;
        Some((name, part[from..].trim_end().to_owned()))
    };
    Some(format!("\n{all}").split("\ndiff --git ").filter_map(file).collect())
}
