//! Runs the tested program without the settings of the person who runs the tests.

use std::path::Path;
use std::process::Command;

/// `karat` with a folder as its working directory.
pub(crate) fn program(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_karat"));
    for (name, _) in std::env::vars_os() {
        if name.to_string_lossy().starts_with("KARAT_") {
            command.env_remove(name);
        }
    }
    for name in [
        "CI",
        "GITHUB_ACTIONS",
        "GITHUB_STEP_SUMMARY",
        "GITHUB_WORKSPACE",
        "CI_PROJECT_DIR",
        "WORKSPACE",
        "CARGO",
        "NO_COLOR",
        "CLICOLOR",
        "CLICOLOR_FORCE",
        "CARGO_TARGET_DIR",
    ] {
        command.env_remove(name);
    }
    // Machines have different versions of Tint, or none, so tests of Tint name one.
    command.env("KARAT_TINT", "off").current_dir(folder);
    command
}
