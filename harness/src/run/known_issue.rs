//! Declared failures: on a path, with a reason, and for as long as they last.
//!
//! A path that is declared to fail must fail. If it passes, the check fails, so that no declaration
//! outlives the bug that it names.

use crate::path::{Adapter, Path, PathError, Selected, Selector};

/// A failure that was declared with `fails_on` and did occur.
///
/// ```
/// # use karat::prelude::*;
/// # let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
/// let agreement = package.function("half").over(0.0..=1.0).agrees_with(|x: f64| 0.5 * x, Ulp(1.0));
/// for issue in &agreement.known_issues {
///     println!("{} of {} fail on {}: {}", issue.failures, issue.cases, issue.adapter, issue.reason);
/// }
/// ```
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
pub(crate) struct KnownIssues(Selected<String>);

impl KnownIssues {
    pub(crate) fn declare(&mut self, on: Selector, reason: &str) {
        let reason = reason.trim();
        match self.0.get_mut(&on) {
            Some(known) if known.is_empty() || reason.is_empty() => known.clear(),
            Some(known) => *known = format!("{known}; {reason}"),
            None => self.0.declare(on, reason.to_owned()),
        }
    }

    /// Refuses a declaration for what is no path.
    pub(crate) fn expect_sound(&self) -> Result<(), PathError> {
        self.0.expect_sound()
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Why a path is to fail; `None`: it isn't.
    pub(crate) fn on(&self, path: Path, adapter: &Adapter) -> Option<&str> {
        self.0.on(path, adapter).map(String::as_str)
    }

    /// The first declaration without a reason.
    pub(crate) fn unexplained(&self) -> Option<&Selector> {
        self.0.iter().find(|(_, reason)| reason.is_empty()).map(|(selector, _)| selector)
    }

    /// What was seen on the paths that are to fail. At least one case of each has to, unless one
    /// that is replayed stands for all.
    pub(crate) fn judge(
        &self,
        seen: impl IntoIterator<Item = Seen>,
        replays: bool,
    ) -> Result<Vec<KnownIssue>, Passes> {
        let issue = |Seen { adapter, path, cases, failures }: Seen| {
            let reason = self.on(path, &adapter).unwrap_or_default().to_owned();
            if failures == 0 && !replays {
                return Err(Passes { path, reason });
            }
            Ok(KnownIssue { adapter, reason, cases, failures })
        };
        seen.into_iter().map(issue).collect()
    }
}

/// What a path gave that is declared to fail.
#[derive(Clone, Debug)]
pub(crate) struct Seen {
    pub(crate) adapter: Adapter,
    pub(crate) path: Path,
    pub(crate) cases: u64,
    pub(crate) failures: u64,
}

/// A path passes that is declared to fail.
#[derive(Clone, Debug)]
pub(crate) struct Passes {
    pub(crate) path: Path,
    /// What was declared.
    pub(crate) reason: String,
}
