//! Normalizes a program's text: two texts with the same normalized text are the same program.

use super::Program;
use crate::package::plain;

impl Program {
    /// The linked text without comments, and with one blank in place of several.
    #[must_use]
    pub fn normalized_text(&self) -> String {
        plain(self.text())
    }
}
