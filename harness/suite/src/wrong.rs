//! What is wrong with a test: a text for people, and the same as data.

use std::fmt;

use karat::diagnostic::Diagnostic;
use karat::package::PackageError;
use karat::reflect::ReflectError;
use serde::{Deserialize, Serialize};

/// Why a test fails, or can't run.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Wrong {
    /// It in one line.
    pub headline: String,
    /// `file:line:column`, if it is somewhere.
    pub place: Option<String>,
    /// All of it, with an excerpt of the file.
    pub message: String,
}

impl fmt::Display for Wrong {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl Wrong {
    /// Something that has no place, or whose text has it; `headline` is it in one line.
    pub(crate) fn new(headline: &str, place: Option<String>, message: String) -> Self {
        let headline = headline.lines().next().unwrap_or_default().to_owned();
        Self { headline, place, message }
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
        let text = error.to_string();
        error.diagnostic().map_or_else(|| Self::new(&text, None, text.clone()), Self::from)
    }
}

impl From<PackageError> for Wrong {
    fn from(error: PackageError) -> Self {
        Self::from(&ReflectError::from(error))
    }
}
