//! Errors of tests that files declare, each with its key.

use std::collections::BTreeMap;
use std::path::Path;

use karat::check::{Failure, Vacuous};
use karat::diagnostic::{Diagnostic, Span, shown};
use karat::fixture::FixtureError;
use karat::path::Selector;
use karat::probe::ProbeError;
use karat::reflect::ReflectError;

use crate::declared::Assertion;

/// Why an assertion can't be checked.
#[derive(Debug)]
pub(crate) struct Misdeclared {
    /// The key that is wrong; `None`: the assertion's own.
    key: Option<&'static str>,
    message: String,
    /// `file:line:column`, if it isn't in the file that declares the test.
    place: Option<String>,
}

impl<T: Into<String>> From<T> for Misdeclared {
    fn from(message: T) -> Self {
        Self { key: None, message: message.into(), place: None }
    }
}

impl Misdeclared {
    /// Of a key.
    pub(crate) fn of(key: &'static str) -> impl Fn(String) -> Self {
        move |message| Self { key: Some(key), message, place: None }
    }

    /// Of a line of another file.
    pub(crate) fn at_line(file: &Path, line: usize, message: String) -> Self {
        Self { key: None, message, place: Some(format!("{}:{line}:1", shown(file))) }
    }

    /// The message at its place.
    pub(crate) fn told(self, assertion: &Assertion, whole: &Span) -> String {
        if self.place.is_some() {
            return format!("error: {self}");
        }
        let span = assertion.place_of(self.key).unwrap_or(whole);
        Diagnostic::new(self.to_string()).at(span.clone(), "").to_string()
    }
}

impl std::fmt::Display for Misdeclared {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { key, message, place } = self;
        if let Some(key) = key {
            write!(f, "{key}: ")?;
        }
        f.write_str(message)?;
        place.iter().try_for_each(|place| write!(f, "\n   --> {place}"))
    }
}

/// True of a failure whose message has a place in the shader.
pub(crate) fn has_place(failure: &Failure) -> bool {
    match failure {
        Failure::Disagreement(_) | Failure::Rejection(_) => true,
        Failure::Golden { disagreement, .. } => disagreement.is_some(),
        Failure::Paths(paths) => {
            let stopped = paths.stopped.iter().map(|(_, failure)| failure);
            paths.failures.iter().chain(stopped).any(has_place)
        }
        Failure::Probe(ProbeError::Reflect(error)) => {
            error.diagnostic().is_some_and(|message| message.location().is_some())
        }
        Failure::Probe(ProbeError::Fixture(FixtureError::Declared { .. })) => true,
        _ => false,
    }
}

/// The key that a check's failure is about; `None`: the assertion's own.
pub(crate) fn key_of(assertion: &Assertion, failure: &Failure) -> Option<&'static str> {
    let test = &assertion.test;
    let of_paths = [
        ("fails_on", &test.fails_on),
        ("refused_on", &test.refused_on),
        ("tolerance_on", &test.tolerance_on),
    ];
    let wrong = |paths: &BTreeMap<String, String>| {
        paths.keys().any(|path| !Selector::from(&**path).is_known())
    };
    match failure {
        Failure::Domain { reason, .. } => match **reason {
            Vacuous::NoCases | Vacuous::TooManyCases(_) => Some("cases"),
            _ => (!test.over.is_empty()).then_some("over"),
        },
        Failure::UnexpectedPass { .. } => Some("fails_on"),
        Failure::NotRefused { .. } => Some("refused_on"),
        Failure::Probe(ProbeError::Reflect(ReflectError::Override(_))) => Some("override"),
        Failure::Probe(ProbeError::Path(_)) => {
            of_paths.into_iter().find(|(_, paths)| wrong(paths)).map(|(key, _)| key)
        }
        _ => None,
    }
}
