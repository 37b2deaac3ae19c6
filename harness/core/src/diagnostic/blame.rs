//! The cause of a failure: the place in the shader or in the test that the author must edit.

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
    /// The message about an error in the shader, if the shader has an error.
    pub message: Option<&'f Diagnostic>,
    /// The position of the cause.
    pub at: At<'f>,
}

/// The position of a failure's cause.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum At<'f> {
    /// The failure's text already names the position: a function, or a line of a shader.
    Text,
    /// A list of settings. The cause is the first setting of this list that the test sets, or the whole test if the
    /// test sets none of them.
    Setting(&'f [&'static str]),
    /// The cause is the setting that names this entry point, which doesn't exist.
    EntryPoint(&'f str),
}

/// An error with a cause.
pub trait Blamed {
    /// The cause of the error.
    fn blame(&self) -> Blame<'_>;
}

impl<'f> Blame<'f> {
    /// The cause is the whole test, not one of its settings.
    pub const TEST: Self = Self::setting(&[]);

    /// The cause is a function that returns wrong values.
    pub const VALUES: Self = Self { message: None, at: At::Text };

    /// Makes a cause from a list of settings: the cause is the first setting of the list that the test sets.
    #[must_use]
    pub const fn setting(setting: &'f [&'static str]) -> Self {
        Self { message: None, at: At::Setting(setting) }
    }

    /// Makes a cause from the name of an entry point that doesn't exist: the cause is the setting that contains this
    /// name.
    #[must_use]
    pub const fn entry_point(name: &'f str) -> Self {
        Self { message: None, at: At::EntryPoint(name) }
    }

    /// Makes a cause from a message about the shader: the cause is the message's position in the shader. If the message
    /// has no position, the cause is the first setting of the list that the test sets.
    #[must_use]
    pub fn of(message: Option<&'f Diagnostic>, setting: &'static [&'static str]) -> Self {
        let is_placed = message.is_some_and(|found| found.location().is_some());
        Self { message, at: if is_placed { At::Text } else { At::Setting(setting) } }
    }

    /// If the cause is the whole test, replaces it by the first setting of the list that the test sets. Keeps any
    /// other cause.
    #[must_use]
    pub fn or(self, setting: &'static [&'static str]) -> Self {
        match self.at {
            At::Setting([]) => Self { at: At::Setting(setting), ..self },
            _ => self,
        }
    }
}
