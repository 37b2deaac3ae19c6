//! Failures that are declared: on a path, with a reason, and for as long as they last.
//!
//! What is declared must fail. A path that passes again is a failure of its own, so that no
//! declaration outlives the bug that it names.

use super::Failure;
use super::path_tally::PathTally;
use crate::path::{Adapter, Path};

/// A failure that was declared with `fails_on`, and was seen.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownIssue {
    /// Path, adapter and driver.
    pub adapter: Adapter,
    /// What its author declared.
    pub reason: String,
    /// Cases (or pixels) that were compared.
    pub cases: u64,
    /// How many of them fail.
    pub failures: u64,
}

/// The declarations of one check or frame.
#[derive(Clone, Debug, Default)]
pub(crate) struct KnownIssues(Vec<(Path, String)>);

impl KnownIssues {
    pub(crate) fn declare(&mut self, path: Path, reason: &str) {
        let reason = reason.trim();
        match self.0.iter_mut().find(|(known, _)| *known == path) {
            Some((_, known)) if known.is_empty() || reason.is_empty() => known.clear(),
            Some((_, known)) => *known = format!("{known}; {reason}"),
            None => self.0.push((path, reason.to_owned())),
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Why a path is to fail; `None`: it isn't.
    pub(crate) fn on(&self, path: Path) -> Option<&str> {
        self.0.iter().find(|(known, _)| *known == path).map(|(_, reason)| &**reason)
    }

    /// The first path that is declared to fail without a reason.
    pub(crate) fn unexplained(&self) -> Option<Path> {
        self.0.iter().find(|(_, reason)| reason.is_empty()).map(|(path, _)| *path)
    }

    pub(super) fn expect_reasons(&self, function: &str) -> Result<(), Failure> {
        self.unexplained().map_or(Ok(()), |path| {
            Err(Failure::UnexplainedIssue { function: function.to_owned(), path })
        })
    }

    /// Takes the paths out of `tallies` that are declared to fail. They are the second result.
    pub(super) fn split(&self, tallies: Vec<PathTally>) -> (Vec<PathTally>, Vec<PathTally>) {
        tallies.into_iter().partition(|tally| self.on(tally.path).is_none())
    }

    /// Wants at least one failure on each of the paths that are declared to fail.
    pub(super) fn expect_failures(
        &self,
        function: &str,
        tallies: &[PathTally],
    ) -> Result<(), Failure> {
        let passing = tallies.iter().find(|tally| tally.tally.census.failures == 0);
        passing.map_or(Ok(()), |tally| {
            let (function, path) = (function.to_owned(), tally.path);
            let reason = self.on(path).unwrap_or_default().to_owned();
            Err(Failure::UnexpectedPass { function, path, reason })
        })
    }

    pub(super) fn seen(&self, tallies: &[PathTally]) -> Vec<KnownIssue> {
        let issue = |tally: &PathTally| KnownIssue {
            adapter: tally.adapter.clone(),
            reason: self.on(tally.path).unwrap_or_default().to_owned(),
            cases: tally.tally.census.cases,
            failures: tally.tally.census.failures,
        };
        tallies.iter().map(issue).collect()
    }
}
