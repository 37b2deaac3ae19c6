//! A failure or an error as data. [`Record::message`](super::Record::message) is made of the same values, for
//! people; programs read these.

use serde::{Deserialize, Serialize};

use super::Replay;
use crate::diagnostic::Diagnostic;
use crate::dispatch::Violation;
use crate::output::headline;
use crate::path::Adapter;

/// A failure as data.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Details {
    /// It in one line.
    pub headline: String,
    /// `file:line:column` of what is wrong, if that is another place than the subject's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<String>,
    /// Each path that fails, or that stopped.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub paths: Vec<PathDetails>,
    /// Violations of compute passes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub violations: Vec<Violation>,
    /// The command that runs a check again that no path alone fails, as that of passes whose invocations race.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub replay: Option<Replay>,
}

/// What one path has of a failure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PathDetails {
    /// Path, adapter and driver.
    pub adapter: Adapter,
    /// Why it has no verdict; `None`: it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stopped: Option<String>,
    /// The property that tells the arguments of failing cases from the others, if one does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cause: Option<String>,
    /// The case with the largest error.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub worst: Option<CaseDetails>,
    /// The failing case of the lowest index, if it is another one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub first: Option<CaseDetails>,
    /// The simplest case that the worst one could be reduced to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub simplest: Option<CaseDetails>,
}

/// One failing case: of a function, an element of a buffer, or a configuration of a sampler.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct CaseDetails {
    /// Index of the case.
    pub case: u64,
    /// Each argument: its name, and its value as WGSL would write it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub arguments: Vec<(String, String)>,
    /// The whole result.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub result: String,
    /// The worst component: empty for a scalar, `.y`, or the element of a buffer, `[12].x`.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub component: String,
    /// The component's value.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub actual: String,
    /// The expected value; empty if a statement judged.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub expected: String,
    /// The error in its unit, with what is allowed; empty if a statement judged.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub error: String,
    /// Notes by name: the interval that WGSL allows, and the first let-binding outside of it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<(String, String)>,
    /// The expectations of a test in WGSL that fail.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub expectations: Vec<ExpectationDetails>,
    /// The command that runs it again.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub replay: Option<Replay>,
}

/// An expectation that fails.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ExpectationDetails {
    /// `file:line:column`; empty if the report is broken.
    pub place: String,
    /// Its text and what it saw.
    pub seen: String,
}

impl std::fmt::Display for ExpectationDetails {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &*self.place {
            "" => f.write_str(&self.seen),
            place => write!(f, "{place}: {}", self.seen),
        }
    }
}

impl Details {
    /// A failure that isn't about values: its message in one line.
    pub(crate) fn of(message: &str) -> Self {
        Self { headline: headline(message).to_owned(), ..Self::default() }
    }

    /// With the place of a message, if that has one.
    pub(crate) fn at(self, diagnostic: Option<&Diagnostic>) -> Self {
        let place = diagnostic.and_then(Diagnostic::location).map(ToString::to_string);
        Self { place, ..self }
    }

    /// The commands that run failing cases again: for each path that of the worst case, then that of the
    /// simplest one; and that of a failure that is no path's.
    pub fn replays(&self) -> impl Iterator<Item = &Replay> {
        self.paths.iter().flat_map(PathDetails::replays).chain(&self.replay)
    }
}

impl PathDetails {
    /// A path without values.
    pub(crate) fn on(adapter: &Adapter) -> Self {
        let (stopped, cause) = (None, None);
        let (worst, first, simplest) = (None, None, None);
        Self { adapter: adapter.clone(), stopped, cause, worst, first, simplest }
    }

    /// The commands that run its failing cases again: that of the simplest one comes last.
    pub fn replays(&self) -> impl Iterator<Item = &Replay> {
        [&self.worst, &self.simplest].into_iter().flatten().filter_map(|case| case.replay.as_ref())
    }
}
