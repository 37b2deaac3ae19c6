//! Checks the licence and the origin of every crate that the workspace depends on, on any target.
//!
//! The accepted licences are in `licences.txt`, each with its reason. The check refuses a crate whose licence isn't in
//! the list, and a line of the list that no crate needs.

use anyhow::{Context, Result, bail, ensure};
use cargo_metadata::{Metadata, MetadataCommand};
use spdx::{Expression, Licensee, ParseMode};

use crate::command;

const ALLOWED: &str = include_str!("../licences.txt");

/// The rules for parsing a licence expression: strict SPDX, except that `/` may stand for `OR`. Older crates write
/// `MIT/Apache-2.0`.
const MODE: ParseMode = ParseMode { allow_slash_as_or_operator: true, ..ParseMode::STRICT };

/// Checks all crates, and prints their number.
pub(crate) fn check() -> Result<()> {
    let metadata = MetadataCommand::new()
        .current_dir(command::root())
        .other_options(["--locked".to_owned()])
        .exec()
        .context(
            "could not resolve the dependency graph; \
             if Cargo.lock is out of date, run `cargo update --workspace`",
        )?;
    let crates = crates(&metadata);
    let allowed = allow_list(ALLOWED)?;
    let problems = problems(&crates, &allowed);
    if !problems.is_empty() {
        bail!("{}", problems.join("\n   "));
    }
    ensure!(!crates.is_empty(), "cargo metadata listed no crates, so nothing was checked");
    eprintln!("{} crates, under {} licences", crates.len(), allowed.len());
    Ok(())
}

/// The facts about a crate that the check needs.
struct Crate {
    /// Name and version, as messages show them.
    name: String,
    licence: Option<String>,
    origin: Origin,
}

enum Origin {
    /// A crate of this workspace.
    Workspace,
    CratesIo,
    /// A crate from a git repository, from another registry, or from a folder outside the workspace.
    Elsewhere(String),
}

fn crates(metadata: &Metadata) -> Vec<Crate> {
    let describe = |package: &cargo_metadata::Package| {
        let origin = match &package.source {
            Some(source) if source.is_crates_io() => Origin::CratesIo,
            Some(source) => Origin::Elsewhere(source.to_string()),
            None if metadata.workspace_members.contains(&package.id) => Origin::Workspace,
            None => Origin::Elsewhere(package.manifest_path.to_string()),
        };
        let name = format!("{} {}", package.name, package.version);
        Crate { name, licence: package.license.clone(), origin }
    };
    metadata.packages.iter().map(describe).collect()
}

/// Reads the list of accepted licences: one SPDX identifier per line, with the reason after `#`.
fn allow_list(text: &str) -> Result<Vec<Licensee>> {
    let mut allowed = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        let (identifier, reason) = line.split_once('#').unwrap_or((line, ""));
        let identifier = identifier.trim();
        if identifier.is_empty() {
            continue;
        }
        ensure!(
            !reason.trim().is_empty(),
            "ci/licences.txt:{number}: `{identifier}` has no reason; add one after `#`"
        );
        let licensee = Licensee::parse(identifier).with_context(|| {
            format!("ci/licences.txt:{number}: `{identifier}` is not an SPDX identifier")
        })?;
        allowed.push(licensee);
    }
    Ok(allowed)
}

/// Returns a message for each problem with a crate or with the list.
fn problems(crates: &[Crate], allowed: &[Licensee]) -> Vec<String> {
    let mut problems = Vec::new();
    let mut needed = vec![false; allowed.len()];
    for Crate { name, licence, origin } in crates {
        if let Origin::Elsewhere(place) = origin {
            problems.push(format!(
                "{name} comes from {place}; \
                 depend on a release from crates.io or on a workspace member"
            ));
        }
        match judge(licence.as_deref(), allowed) {
            Ok(expression) => {
                for (skipped, needed) in needed.iter_mut().enumerate() {
                    *needed |= !satisfied(&expression, allowed, Some(skipped));
                }
            }
            Err(reason) => problems.push(format!("{name} {reason}")),
        }
    }
    // A refused crate may need one of the lines, so the check looks for unneeded lines only if no crate is refused.
    if problems.is_empty() {
        for (licensee, needed) in allowed.iter().zip(needed) {
            if !needed {
                problems.push(format!(
                    "no crate needs `{licensee}` any more; remove its line from ci/licences.txt"
                ));
            }
        }
    }
    problems
}

/// Returns the crate's licence expression if the list satisfies it, or otherwise a message that says what to do.
fn judge(licence: Option<&str>, allowed: &[Licensee]) -> Result<Expression, String> {
    let Some(licence) = licence else {
        return Err("declares no licence in its manifest; replace the crate".to_owned());
    };
    let expression = Expression::parse_mode(licence, MODE).map_err(|error| {
        format!("declares `{licence}`, which is not an SPDX expression: {}", error.reason)
    })?;
    if satisfied(&expression, allowed, None) {
        Ok(expression)
    } else {
        Err(format!(
            "is under `{licence}`, which nothing in ci/licences.txt satisfies; \
             replace the crate, or add the licence with its reason"
        ))
    }
}

/// Checks if the accepted licences satisfy an expression. If `skipped` is the index of an accepted licence, the check
/// ignores this licence.
fn satisfied(expression: &Expression, allowed: &[Licensee], skipped: Option<usize>) -> bool {
    expression.evaluate(|requirement| {
        let mut lines = allowed.iter().enumerate().filter(|(line, _)| Some(*line) != skipped);
        lines.any(|(_, licensee)| licensee.satisfies(requirement))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn list() -> Vec<Licensee> {
        allow_list("MIT # ours\nApache-2.0 # ours\n").expect("the list parses")
    }

    fn refusal(licence: Option<&str>) -> Option<String> {
        judge(licence, &list()).err()
    }

    fn crate_under(licence: &str, origin: Origin) -> Crate {
        Crate { name: "dep 1.0.0".to_owned(), licence: Some(licence.to_owned()), origin }
    }

    #[test]
    fn alternatives_need_one_side_and_conjunctions_both() {
        assert_eq!(refusal(Some("MIT")), None);
        assert_eq!(refusal(Some("GPL-3.0-only OR MIT")), None);
        assert_eq!(refusal(Some("(MIT OR Apache-2.0) AND MIT")), None);
        assert!(refusal(Some("(MIT OR Apache-2.0) AND Unicode-3.0")).is_some());
        assert!(refusal(Some("GPL-3.0-only")).is_some());
        // A licence with an exception is another licence, so the list must name it, although the exception only adds
        // rights.
        assert!(refusal(Some("Apache-2.0 WITH LLVM-exception")).is_some());
    }

    #[test]
    fn a_slash_between_licences_means_or() {
        assert_eq!(refusal(Some("MIT/Apache-2.0")), None);
        assert_eq!(refusal(Some("Unlicense/MIT")), None);
        assert_eq!(refusal(Some("Apache-2.0 / MIT")), None);
        assert!(refusal(Some("Unlicense/GPL-2.0-only")).is_some());
    }

    #[test]
    fn refusals_say_what_to_do() {
        assert_eq!(
            refusal(None).as_deref(),
            Some("declares no licence in its manifest; replace the crate")
        );
        assert_eq!(
            refusal(Some("MPL-2.0")).as_deref(),
            Some(
                "is under `MPL-2.0`, which nothing in ci/licences.txt satisfies; \
                 replace the crate, or add the licence with its reason"
            )
        );
        let unreadable = refusal(Some("do what you like")).expect("it isn't SPDX");
        assert!(unreadable.starts_with("declares `do what you like`, which is not an SPDX"));
    }

    #[test]
    fn only_crates_io_and_the_workspace_are_origins() {
        let git = Origin::Elsewhere("git+https://example.org/dep".to_owned());
        assert_eq!(
            problems(&[crate_under("MIT", git)], &list()),
            ["dep 1.0.0 comes from git+https://example.org/dep; \
              depend on a release from crates.io or on a workspace member"]
        );
        let fine =
            [crate_under("MIT", Origin::CratesIo), crate_under("Apache-2.0", Origin::Workspace)];
        assert!(problems(&fine, &list()).is_empty());
    }

    #[test]
    fn a_line_that_no_crate_needs_is_refused() {
        let either = [crate_under("MIT", Origin::CratesIo)];
        assert_eq!(
            problems(&either, &list()),
            ["no crate needs `Apache-2.0` any more; remove its line from ci/licences.txt"]
        );
    }

    #[test]
    fn lines_of_the_list_need_a_reason_and_a_known_identifier() {
        let message = |text| allow_list(text).expect_err("the list is wrong").to_string();
        assert_eq!(message("MIT"), "ci/licences.txt:1: `MIT` has no reason; add one after `#`");
        assert_eq!(
            message("# heading\nMITT # typing"),
            "ci/licences.txt:2: `MITT` is not an SPDX identifier"
        );
    }

    #[test]
    fn our_own_list_parses() {
        assert!(allow_list(ALLOWED).is_ok_and(|allowed| !allowed.is_empty()));
    }
}
