//! Errors of tests that files declare, each with its key.

use std::collections::BTreeMap;
use std::path::Path;

use karat::check::{Failure, Vacuous};
use karat::compute::ComputeError;
use karat::draw::DrawError;
use karat::fixture::FixtureError;
use karat::frame::FrameError;
use karat::path::Selector;
use karat::unstable::diagnostic::{Diagnostic, Span, shown};
use karat::unstable::dispatch::DispatchError;
use karat::unstable::probe::ProbeError;
use karat::unstable::reflect::ReflectError;

use karat::unstable::run::WrongDeclaration;

use crate::Wrong;
use crate::declared::{Assertion, Frame, Keys};

/// Why an assertion can't be checked.
#[derive(Debug)]
pub(crate) struct Misdeclared {
    /// The key that is wrong, behind those that it is below: `draws.1.blend`; `None`: the assertion's own.
    key: Option<String>,
    pub(crate) message: String,
    /// `file:line:column`, if it isn't in the file that declares the test.
    pub(crate) place: Option<String>,
}

impl<T: Into<String>> From<T> for Misdeclared {
    fn from(message: T) -> Self {
        Self { key: None, message: message.into(), place: None }
    }
}

impl Misdeclared {
    /// Of a key.
    pub(crate) fn of(key: &'static str) -> impl Fn(String) -> Self {
        move |message| Self { key: Some(key.to_owned()), message, place: None }
    }

    /// Of a resource in `with`.
    pub(crate) fn of_resource(name: &str) -> impl Fn(String) -> Self {
        move |message| Self { key: Some(format!("with.{name}")), message, place: None }
    }

    /// The same of a table below a key.
    pub(crate) fn below(self, key: &str) -> Self {
        let key = self.key.map_or_else(|| key.to_owned(), |own| format!("{key}.{own}"));
        Self { key: Some(key), ..self }
    }

    /// The error of a file that isn't read, at its place or else that of the whole test.
    pub(crate) fn unread(self, keys: &Keys, whole: &Span) -> Diagnostic {
        let place = self.key.and_then(|key| keys.place_of(&key).cloned());
        Diagnostic::new(self.message).at(place.unwrap_or_else(|| whole.clone()), "")
    }

    /// Of a line of another file.
    pub(crate) fn at_line(file: &Path, line: usize, message: String) -> Self {
        Self { key: None, message, place: Some(format!("{}:{line}:1", shown(file))) }
    }

    /// It at its place: that of its key, or else of the whole test.
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
        Wrong::from(Diagnostic::new(message).at(span, ""))
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
        other => diagnostic_of(other).is_some_and(|found| found.location().is_some()),
    }
}

/// The message about the shader, if a check failed by one.
pub(crate) fn diagnostic_of(failure: &Failure) -> Option<&Diagnostic> {
    match failure {
        Failure::Probe(ProbeError::Reflect(error)) => error.diagnostic(),
        Failure::Probe(ProbeError::Rounds { diagnostic, .. }) => Some(diagnostic),
        Failure::Probe(ProbeError::Fixture(FixtureError::Declared { diagnostic, .. })) => {
            Some(diagnostic)
        }
        _ => None,
    }
}

/// The same of a frame.
pub(crate) fn frame_diagnostic_of(error: &FrameError) -> Option<&Diagnostic> {
    match error {
        FrameError::Draw(DrawError::Reflect(error)) => error.diagnostic(),
        FrameError::Draw(DrawError::Rounds(found)) => Some(found),
        FrameError::Draw(DrawError::Fixture(FixtureError::Declared { diagnostic, .. })) => {
            Some(diagnostic)
        }
        _ => None,
    }
}

/// The key that a check's failure is about; `None`: the assertion's own.
pub(crate) fn key_of(assertion: &Assertion, failure: &Failure) -> Option<&'static str> {
    let test = &assertion.test;
    match failure {
        Failure::Domain { reason, .. } => match **reason {
            Vacuous::NoCases | Vacuous::TooManyCases(_) => Some("cases"),
            Vacuous::Filtered if test.filter.is_some() => Some("where"),
            Vacuous::Empty { argument: None, .. } if test.filter.is_some() => Some("where"),
            _ => (!test.over.is_empty()).then_some("over"),
        },
        Failure::Declaration(wrong) => Some(of_declaration(wrong)),
        Failure::Probe(ProbeError::Reflect(ReflectError::Override(_))) => Some("override"),
        Failure::Probe(ProbeError::Path(_)) => of_unknown_path([
            ("fails_on", &test.fails_on),
            ("refused_on", &test.refused_on),
            ("tolerance_on", &test.tolerance_on),
        ]),
        Failure::Paths(paths) => {
            let stopped = paths.stopped.iter().map(|(_, failure)| failure);
            let mut all = paths.failures.iter().chain(stopped);
            all.find_map(|failure| key_of(assertion, failure))
        }
        _ => None,
    }
}

/// Values by the names of paths.
type ByPath = BTreeMap<String, String>;

/// The key that names a path which isn't one.
fn of_unknown_path<const N: usize>(keys: [(&'static str, &ByPath); N]) -> Option<&'static str> {
    let is_unknown = |path: &String| !Selector::from(&**path).is_known();
    keys.into_iter().find(|(_, paths)| paths.keys().any(is_unknown)).map(|(key, _)| key)
}

/// The key of a declaration that doesn't hold.
fn of_declaration(wrong: &WrongDeclaration) -> &'static str {
    match wrong {
        WrongDeclaration::UnexpectedPass { .. } => "fails_on",
        WrongDeclaration::NotRefused { .. } => "refused_on",
        WrongDeclaration::Unexplained { setting, .. } => setting,
    }
}

/// True of a frame's error that has a place in the shader.
pub(crate) fn frame_has_place(error: &FrameError) -> bool {
    match error {
        FrameError::Paths(paths) => {
            let stopped = paths.stopped.iter().map(|(_, error)| error);
            paths.failures.iter().chain(stopped).any(frame_has_place)
        }
        other => frame_diagnostic_of(other).is_some_and(|found| found.location().is_some()),
    }
}

/// The key that a frame's error is about; `None`: the whole frame. `unknown` is the key that names a function
/// which isn't there.
pub(crate) fn frame_key_of<'k>(
    frame: &Frame,
    unknown: Option<&'k str>,
    error: &FrameError,
) -> Option<&'k str> {
    match error {
        FrameError::Tolerance(_) => Some("tolerance"),
        FrameError::Declaration(wrong) => Some(of_declaration(wrong)),
        FrameError::Draw(DrawError::Path(_)) => {
            of_unknown_path([("refused_on", &frame.refused_on), ("fails_on", &frame.fails_on)])
        }
        FrameError::Draw(DrawError::Size { .. }) => Some("size"),
        FrameError::Draw(DrawError::Unsound { setting, .. }) => Some(setting),
        FrameError::Draw(DrawError::Fixture(_)) => Some("with"),
        FrameError::Draw(DrawError::Reflect(ReflectError::Override(_))) => Some("override"),
        FrameError::Draw(DrawError::EntryPoint { .. } | DrawError::Reflect(_)) => unknown,
        FrameError::Paths(paths) => {
            let stopped = paths.stopped.iter().map(|(_, error)| error);
            let mut all = paths.failures.iter().chain(stopped);
            all.find_map(|error| frame_key_of(frame, unknown, error))
        }
        _ => None,
    }
}

/// The message about the shader, if passes fail by one.
pub(crate) fn compute_diagnostic_of(error: &ComputeError) -> Option<&Diagnostic> {
    match error {
        ComputeError::Dispatch(DispatchError::Reflect(error)) => error.diagnostic(),
        ComputeError::Dispatch(DispatchError::Rounds(found)) => Some(found),
        ComputeError::Dispatch(DispatchError::Fixture(FixtureError::Declared {
            diagnostic,
            ..
        })) => Some(diagnostic),
        _ => None,
    }
}

/// True of an error of passes whose message has a place in the shader.
pub(crate) fn compute_has_place(error: &ComputeError) -> bool {
    match error {
        ComputeError::Differs(_) | ComputeError::Violations(_) | ComputeError::Order(_) => true,
        ComputeError::Paths(paths) => {
            let stopped = paths.stopped.iter().map(|(_, error)| error);
            paths.failures.iter().chain(stopped).any(compute_has_place)
        }
        other => compute_diagnostic_of(other).is_some_and(|found| found.location().is_some()),
    }
}

/// The entry point that isn't there.
pub(crate) fn missing_entry_of(error: &ComputeError) -> Option<&str> {
    match error {
        ComputeError::Dispatch(DispatchError::EntryPoint { name, .. }) => Some(name),
        ComputeError::Paths(paths) => {
            let stopped = paths.stopped.iter().map(|(_, error)| error);
            paths.failures.iter().chain(stopped).find_map(missing_entry_of)
        }
        _ => None,
    }
}

/// The key that an error of passes is about; `None`: the assertion's own.
pub(crate) fn compute_key_of(
    assertion: &crate::compute::Assertion,
    error: &ComputeError,
) -> Option<&'static str> {
    match error {
        ComputeError::Dispatch(DispatchError::Path(_)) => of_unknown_path([
            ("fails_on", &assertion.declared.fails_on),
            ("refused_on", &assertion.declared.refused_on),
            ("tolerance_on", &assertion.tolerance_on),
        ]),
        ComputeError::Declaration(wrong) => Some(of_declaration(wrong)),
        ComputeError::Dispatch(DispatchError::Fixture(_)) => Some("with"),
        ComputeError::Dispatch(
            DispatchError::Override { .. } | DispatchError::Reflect(ReflectError::Override(_)),
        ) => Some("override"),
        ComputeError::Dispatch(
            DispatchError::Workgroups { .. } | DispatchError::WorkgroupSize { .. },
        ) => Some("workgroups"),
        ComputeError::Dispatch(DispatchError::EntryPoint { .. } | DispatchError::Reflect(_)) => {
            Some("entry")
        }
        ComputeError::Accepted { verb, .. } => Some(verb),
        ComputeError::Grid { .. } => Some("shape"),
        ComputeError::Paths(paths) => {
            let stopped = paths.stopped.iter().map(|(_, error)| error);
            let mut all = paths.failures.iter().chain(stopped);
            all.find_map(|error| compute_key_of(assertion, error))
        }
        _ => None,
    }
}
