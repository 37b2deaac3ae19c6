//! Errors of tests: a text for people, and the same as data.

use std::fmt;

use karat::package::PackageError;
use karat::unstable::diagnostic::Diagnostic;
use karat::unstable::output::headline;
use karat::unstable::record::Subject;
use karat::unstable::reflect::ReflectError;
use serde::{Deserialize, Serialize};

/// Why a test fails, or can't run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Wrong {
    /// It in one line.
    pub headline: String,
    /// `file:line:column`, if it is somewhere.
    pub place: Option<String>,
    /// All of it, with an excerpt of the file.
    pub message: String,
    /// The violations of passes, a line each: all assertions of these passes fail by them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub violations: Option<String>,
}

impl fmt::Display for Wrong {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl Wrong {
    /// A message without a place, or whose text has it. Its first line says what is wrong.
    #[must_use]
    pub fn of(message: String) -> Self {
        Self { headline: headline(&message).to_owned(), place: None, message, violations: None }
    }

    /// The same once it is in the record of the run: no check has put it there.
    pub(crate) fn recorded(&self, subject: Subject) -> Self {
        karat::unstable::run::record_unbegun(subject, &self.headline, &self.message);
        self.clone()
    }

    pub(crate) fn new(headline: &str, place: Option<String>, message: String) -> Self {
        let headline = headline.lines().next().unwrap_or_default().to_owned();
        Self { headline, place, message, violations: None }
    }
}

impl From<Diagnostic> for Wrong {
    fn from(found: Diagnostic) -> Self {
        Self::from(&found)
    }
}

impl From<&Diagnostic> for Wrong {
    fn from(found: &Diagnostic) -> Self {
        let place = found.location().map(ToString::to_string);
        Self::new(&found.message, place, found.to_string())
    }
}

impl From<&ReflectError> for Wrong {
    fn from(error: &ReflectError) -> Self {
        error.diagnostic().map_or_else(|| Self::of(error.to_string()), Self::from)
    }
}

impl From<PackageError> for Wrong {
    fn from(error: PackageError) -> Self {
        Self::from(&ReflectError::from(error))
    }
}
