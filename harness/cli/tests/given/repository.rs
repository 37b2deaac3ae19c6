//! Uses a folder as a git repository.

use std::path::Path;
use std::process::Command;

/// Runs git in the folder as the author Ada. Returns git's output.
pub(crate) fn git(folder: &Path, arguments: &[&str]) -> String {
    let mut command = Command::new("git");
    command.args(["-c", "user.name=Ada", "-c", "user.email=ada@example.org"]);
    let ran = command.args(arguments).current_dir(folder).output().expect("git is there");
    assert!(ran.status.success(), "{ran:?}");
    String::from_utf8_lossy(&ran.stdout).trim_end().to_owned()
}
