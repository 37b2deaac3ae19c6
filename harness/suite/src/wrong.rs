//! The errors of tests, as text and as data.

use std::fmt;
use std::path::Path;

use karat::package::PackageError;
use karat::unstable::diagnostic::{At, Diagnostic, Span, shown};
use karat::unstable::output::headline;
use karat::unstable::record::Subject;
use karat::unstable::reflect::ReflectError;
use karat::unstable::run::Fails;
use serde::{Deserialize, Serialize};

use crate::declared::Keys;

/// The reason why a test failed or couldn't run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Wrong {
    /// The reason, in one line.
    pub headline: String,
    /// The error's position, `file:line:column`, if it has one.
    pub place: Option<String>,
    /// The whole message, with an excerpt of the file.
    pub message: String,
    /// The error's kind.
    pub fault: Fault,
}

/// The kind of an error.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Fault {
    /// Values violate the assertion.
    Values,
    /// The sanitizer found these violations in the passes, one in each line. All assertions about the passes fail for
    /// this reason.
    Violations(String),
    /// The test could never fail, for example because the result is the same for all inputs.
    Vacuous,
    /// A key of the test doesn't fit the shader, for example an override that the shader doesn't use. No values were
    /// compared.
    Declaration,
    /// The test couldn't begin, or was stopped. No values were compared.
    Unbegun,
}

impl fmt::Display for Wrong {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl Wrong {
    /// Makes an error from a message that has no position, or that contains its position. The first line becomes the
    /// headline.
    #[must_use]
    pub fn of(message: String) -> Self {
        let headline = headline(&message).to_owned();
        Self { headline, place: None, message, fault: Fault::Unbegun }
    }

    /// The cause of the error, if other tests may fail for the same cause. `None` for wrong values, which concern only
    /// this test.
    #[must_use]
    pub fn common(&self) -> Option<String> {
        match &self.fault {
            Fault::Values => None,
            Fault::Violations(all) => Some(all.clone()),
            // Each test has its own position and excerpt.
            Fault::Vacuous | Fault::Declaration | Fault::Unbegun => {
                let is_said = |line: &&str| {
                    let line = line.trim_start();
                    !(line.starts_with("-->") || line.contains('|'))
                };
                Some(self.message.lines().filter(is_said).collect::<Vec<_>>().join("\n"))
            }
        }
    }

    /// Adds the error to the record of the run, because none of the test's checks ran.
    pub(crate) fn recorded(&self, subject: Subject) -> Self {
        karat::unstable::run::record_unbegun(subject, &self.headline, &self.message);
        self.clone()
    }

    /// Makes the error of a test that couldn't begin.
    pub(crate) fn new(headline: &str, place: Option<String>, message: String) -> Self {
        let headline = headline.lines().next().unwrap_or_default().to_owned();
        Self { headline, place, message, fault: Fault::Unbegun }
    }
}

/// Makes a test's error from the failure of the test's check. If the failure blames the shader's text, the error's
/// position is in the shader. If the failure blames a key of the test, the error has the key's position.
pub(crate) fn blamed(
    failure: &impl Fails,
    key_of_entry: &dyn Fn(&str) -> Option<String>,
    place_of: &dyn Fn(&str) -> Option<Span>,
    whole: &Span,
) -> Wrong {
    let blame = failure.blame();
    let fault = match (failure.is_verdict(), failure.is_vacuous()) {
        (true, _) => Fault::Values,
        (false, true) => Fault::Vacuous,
        (false, false) if matches!(blame.at, At::EntryPoint(_) | At::Setting([_, ..])) => {
            Fault::Declaration
        }
        (false, false) => Fault::Unbegun,
    };
    let span = match blame.at {
        At::Text => {
            let place = blame.message.and_then(Diagnostic::location).map(ToString::to_string);
            return Wrong { place, fault, ..Wrong::of(failure.to_string()) };
        }
        At::Setting(keys) => keys.iter().find_map(|key| place_of(key)),
        At::EntryPoint(name) => key_of_entry(name).and_then(|key| place_of(&key)),
    };
    let found = blame.message.cloned().unwrap_or_else(|| {
        let message = failure.to_string();
        Diagnostic::new(message.trim_start_matches("error: ").trim_end().to_owned())
    });
    Wrong { fault, ..Wrong::from(found.at(span.unwrap_or_else(|| whole.clone()), "")) }
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

#[derive(Debug)]
pub(crate) struct Misdeclared {
    /// The path of the wrong key, such as `draws.1.blend`; `None` for the assertion's own key.
    key: Option<String>,
    pub(crate) message: String,
    /// The position of the error, `file:line:column`, if the error isn't in the test file.
    pub(crate) place: Option<String>,
}

impl<T: Into<String>> From<T> for Misdeclared {
    fn from(message: T) -> Self {
        Self { key: None, message: message.into(), place: None }
    }
}

impl Misdeclared {
    pub(crate) fn of(key: &'static str) -> impl Fn(String) -> Self {
        move |message| Self { key: Some(key.to_owned()), message, place: None }
    }

    /// Makes an error about a resource in `with`.
    pub(crate) fn of_resource(name: &str) -> impl Fn(String) -> Self {
        move |message| Self { key: Some(format!("with.{name}")), message, place: None }
    }

    /// Puts `key` before the error's key: below `draws.1`, the key `blend` becomes `draws.1.blend`.
    pub(crate) fn below(self, key: &str) -> Self {
        let key = self.key.map_or_else(|| key.to_owned(), |own| format!("{key}.{own}"));
        Self { key: Some(key), ..self }
    }

    /// Makes the message about a test that Karat can't read, at the position of the error's key. If the error has no
    /// key, the message has the position `whole` of the test.
    pub(crate) fn unread(self, keys: &Keys, whole: &Span) -> Diagnostic {
        let place = self.key.and_then(|key| keys.place_of(&key).cloned());
        Diagnostic::new(self.message).at(place.unwrap_or_else(|| whole.clone()), "")
    }

    /// Makes an error about a line of another file.
    pub(crate) fn at_line(file: &Path, line: usize, message: String) -> Self {
        Self { key: None, message, place: Some(format!("{}:{line}:1", shown(file))) }
    }

    /// Makes the error of a test, at the position of the wrong key, or otherwise at the position of the whole test.
    pub(crate) fn told(
        self,
        place_of: &dyn Fn(Option<&str>) -> Option<Span>,
        whole: &Span,
    ) -> Wrong {
        let first = self.key.as_deref().and_then(|key| key.split('.').next());
        let message = match first {
            Some(key) => format!("{key}: {}", self.message),
            None => self.message,
        };
        if let Some(place) = self.place {
            let text = format!("error: {message}\n   --> {place}");
            return Wrong::new(&message, Some(place), text);
        }
        let span = place_of(self.key.as_deref()).unwrap_or_else(|| whole.clone());
        let fault = if first.is_some() { Fault::Declaration } else { Fault::Unbegun };
        Wrong { fault, ..Wrong::from(Diagnostic::new(message).at(span, "")) }
    }
}
