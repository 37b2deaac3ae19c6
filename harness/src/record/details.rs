//! A failure or an error as data, for programs. [`Record::message`](super::Record::message) is the same failure
//! as text.

use serde::{Deserialize, Serialize};

use super::Replay;
use crate::diagnostic::Diagnostic;
use crate::dispatch::Violation;
use crate::output::headline;
use crate::path::Adapter;

/// A failure or an error as data.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Details {
    /// The failure or error in one line.
    pub headline: String,
    /// `file:line:column` of the cause; `None` if the cause is at the location of the subject.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<String>,
    /// The paths on which the check fails or gets no values.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub paths: Vec<PathDetails>,
    /// The races, missed barriers and wrong indices that the sanitizer found in compute passes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub violations: Vec<Violation>,
    /// The command that runs the check again, for a failure that belongs to no single path, such as a race. `None` for
    /// other failures: the cases in `paths` have their own commands.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub replay: Option<Replay>,
}

/// A failure on one path.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PathDetails {
    /// The path's name, its adapter and its driver.
    pub adapter: Adapter,
    /// The reason why the check got no values on this path; `None` if the check got values.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stopped: Option<String>,
    /// A property that only the arguments of failing cases have; `None` if Karat found no such property.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cause: Option<String>,
    /// The case with the largest error.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub worst: Option<CaseDetails>,
    /// The failing case with the lowest index, if it isn't the worst case.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub first: Option<CaseDetails>,
    /// The simplest failing case that Karat found. The search starts at the worst case.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub simplest: Option<CaseDetails>,
}

/// One failing case of a function, one element of a buffer, or one set of arguments of a sampler.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct CaseDetails {
    /// Index of the case.
    pub case: u64,
    /// The arguments, each with its name and its value in WGSL.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub arguments: Vec<(String, String)>,
    /// The whole result.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub result: String,
    /// The worst component of the result: empty for a scalar, `.y` for a vector, `[12].x` for an element of a buffer.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub component: String,
    /// The value of the worst component.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub actual: String,
    /// The expected value of the worst component; empty if the check has no expected values.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub expected: String,
    /// The error with its unit and the tolerance; empty if the check compares no values with a tolerance.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub error: String,
    /// Notes by name, such as the interval that WGSL allows and the first let-binding outside of its interval.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<(String, String)>,
    /// The expectations of a WGSL test that fail in this case.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub expectations: Vec<ExpectationDetails>,
    /// The command that runs the case again.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub replay: Option<Replay>,
}

/// An expectation that fails.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ExpectationDetails {
    /// `file:line:column` of the expectation; empty if the kernel's report of the failure is damaged.
    pub place: String,
    /// The text of the expectation, and the values of its arguments.
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
    pub(crate) fn of(message: &str) -> Self {
        Self { headline: headline(message).to_owned(), ..Self::default() }
    }

    pub(crate) fn at(self, diagnostic: Option<&Diagnostic>) -> Self {
        let place = diagnostic.and_then(Diagnostic::location).map(ToString::to_string);
        Self { place, ..self }
    }

    /// The commands that run failing cases again. For each path, the worst case comes first and the simplest case
    /// last. The command for a failure that belongs to no single path comes after all paths.
    pub fn replays(&self) -> impl Iterator<Item = &Replay> {
        self.paths.iter().flat_map(PathDetails::replays).chain(&self.replay)
    }
}

impl PathDetails {
    pub(crate) fn on(adapter: &Adapter) -> Self {
        let (stopped, cause) = (None, None);
        let (worst, first, simplest) = (None, None, None);
        Self { adapter: adapter.clone(), stopped, cause, worst, first, simplest }
    }

    /// The commands that run the path's failing cases again. The command for the simplest case comes last.
    pub fn replays(&self) -> impl Iterator<Item = &Replay> {
        [&self.worst, &self.simplest].into_iter().flatten().filter_map(|case| case.replay.as_ref())
    }
}
