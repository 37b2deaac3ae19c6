//! The part of a text that means something: two texts with one normalized text are the same program.

use super::Program;
use crate::package::plain;

impl Program {
    /// The linked text without comments, and with one blank in place of many.
    #[must_use]
    pub fn normalized_text(&self) -> String {
        plain(self.text())
    }
}
