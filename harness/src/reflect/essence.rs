//! What of a text means something: two texts with the same essence are the same program.

use super::Program;
use crate::package::plain;

impl Program {
    /// The linked text without comments, and with one blank in place of many.
    ///
    /// ```
    /// # use karat::Package;
    /// use karat::reflect::{Program, ReflectError};
    ///
    /// let essence = |text: &str| -> Result<String, ReflectError> {
    ///     Ok(Program::of_module(&Package::from_source("m", text), "")?.essence())
    /// };
    /// let (plain, with_comment) = ("const A = 1;", "// One.\nconst  A = 1;");
    /// assert_eq!(essence(plain)?, essence(with_comment)?);
    /// # Ok::<(), ReflectError>(())
    /// ```
    #[must_use]
    pub fn essence(&self) -> String {
        plain(self.text())
    }
}
