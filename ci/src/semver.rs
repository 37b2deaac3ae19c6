//! `cargo ci semver`: whether the libraries' public interfaces changed more than their versions say.

use anyhow::{Result, ensure};

use crate::command;

/// The revision that interfaces are compared with.
const BASELINE: &str = include_str!("../baseline.txt");

/// Libraries whose users are promised something. The others are Karat's own parts.
const PROMISED: [&str; 3] = ["karat", "karat-gallery", "karat-suite"];

const TOOL: &str =
    "cargo-semver-checks is missing; `cargo install cargo-semver-checks --locked` builds it";

/// Compares with a revision, or else with the one in `ci/baseline.txt`.
pub(crate) fn run(revision: Option<String>) -> Result<()> {
    ensure!(command::succeeds(&mut command::cargo(&["semver-checks", "--version"])), TOOL);
    let revision = revision.unwrap_or_else(|| baseline(BASELINE).to_owned());
    let mut check =
        command::cargo(&["semver-checks", "check-release", "--baseline-rev", &revision]);
    for name in PROMISED {
        check.args(["--package", name]);
    }
    command::run(&mut check)
}

/// The line that isn't a comment.
fn baseline(text: &str) -> &str {
    let mut lines = text.lines().map(str::trim);
    lines.find(|line| !line.is_empty() && !line.starts_with('#')).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_revision_is_named() {
        assert_eq!(baseline("# why\n\n v0.1.0 \n"), "v0.1.0");
        assert!(!baseline(BASELINE).is_empty());
    }
}
