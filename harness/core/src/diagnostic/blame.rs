//! The cause of a failure: the position that an author must look at and edit.

use super::Diagnostic;

/// The cause of a failure.
///
/// ```
/// use karat::prelude::*;
/// use karat::unstable::diagnostic::{At, Blamed};
///
/// let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * y; }");
/// let check = package.function("half").over(0.0..=1.0).unrecorded();
/// let failure = check.try_agrees_with(|x: f64| 0.5 * x, Ulp(0.0)).expect_err("there is no `y`");
/// let blame = failure.blame();
/// assert!(matches!(blame.at, At::Text));
/// assert_eq!(blame.message.and_then(|found| found.location()).map(|at| at.to_string()).as_deref(), Some("<m>:1:39"));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Blame<'f> {
    /// The message about the shader, if there is one.
    pub message: Option<&'f Diagnostic>,
    /// The position of the cause.
    pub at: At<'f>,
}

/// The position of a failure's cause.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum At<'f> {
    /// The failure's text already names the position: a function, or a line of a shader.
    Text,
    /// A setting of the test: the first of these settings that the test has, or the whole test if it has none of them.
    Setting(&'f [&'static str]),
    /// The setting that names this missing entry point.
    EntryPoint(&'f str),
}

/// An error with a cause.
pub trait Blamed {
    /// The cause of the error.
    fn blame(&self) -> Blame<'_>;
}

impl<'f> Blame<'f> {
    /// The test as a whole is the cause.
    pub const TEST: Self = Self::setting(&[]);

    /// The values that a function returns are the cause.
    pub const VALUES: Self = Self { message: None, at: At::Text };

    /// The first of these settings that the test has is the cause.
    #[must_use]
    pub const fn setting(setting: &'f [&'static str]) -> Self {
        Self { message: None, at: At::Setting(setting) }
    }

    /// The setting that names a missing entry point is the cause.
    #[must_use]
    pub const fn entry_point(name: &'f str) -> Self {
        Self { message: None, at: At::EntryPoint(name) }
    }

    /// A message about the shader is the cause. If the message has no position, the first of these settings that the
    /// test has is the cause.
    #[must_use]
    pub fn of(message: Option<&'f Diagnostic>, setting: &'static [&'static str]) -> Self {
        let is_placed = message.is_some_and(|found| found.location().is_some());
        Self { message, at: if is_placed { At::Text } else { At::Setting(setting) } }
    }

    /// If the test as a whole is the cause, replaces this cause by the first of these settings that the test has.
    #[must_use]
    pub fn or(self, setting: &'static [&'static str]) -> Self {
        match self.at {
            At::Setting([]) => Self { at: At::Setting(setting), ..self },
            _ => self,
        }
    }
}
