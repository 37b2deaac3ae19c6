//! What git knows. Nothing is changed.

use std::path::Path;
use std::process::Command;

use karat::unstable::process;

/// A path that is no pattern, whatever its characters.
pub(super) fn literal(path: &str) -> String {
    format!(":(literal){path}")
}

/// What git prints as text; `None` if it isn't there or fails.
pub(super) fn text(folder: &Path, arguments: &[&str]) -> Option<String> {
    bytes(folder, arguments).map(|bytes| String::from_utf8_lossy(&bytes).into_owned())
}

/// What git prints; `None` if it isn't there or fails.
pub(super) fn bytes(folder: &Path, arguments: &[&str]) -> Option<Vec<u8>> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let mut command = Command::new("git");
    command.args(["-c", "core.quotepath=off"]).args(arguments).current_dir(folder);
    command.env("GIT_OPTIONAL_LOCKS", "0").env("LC_ALL", "C");
    // Whoever runs this in a hook of git's has another repository in mind.
    for name in ["GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"] {
        command.env_remove(name);
    }
    let ran = process::output(&mut command, process::LOOK_UP, u64::MAX).ok()?;
    ran.status.success().then_some(ran.stdout)
}

/// What a file of the working tree has otherwise than a commit, by `paths`: one text a file, named from
/// the repository's root. `None` if git fails.
pub(super) fn differences(
    folder: &Path,
    commit: &str,
    paths: &[String],
) -> Option<Vec<(String, String)>> {
    /// Bytes that are shown: nobody reads more.
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
        // From the first change on: what is above names the file again.
        let from = part.find("\n@@")? + 1;
        Some((name, part[from..].trim_end().to_owned()))
    };
    Some(format!("\n{all}").split("\ndiff --git ").filter_map(file).collect())
}
