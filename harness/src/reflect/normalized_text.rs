//! Normalizes a program's text. If two programs have the same normalized text, they differ only in comments and blanks.

use super::Program;
use crate::package::plain;

impl Program {
    /// The linked text without comments, and with one blank in place of several blanks.
    #[must_use]
    pub fn normalized_text(&self) -> String {
        plain(self.text())
    }
}
