//! Selectors, for programs around tests.

use super::{Adapter, Path, PathError, Selector};

/// Refuses a selector whose text names no path.
///
/// # Errors
/// Says what it names instead.
pub fn expect_sound(selector: &Selector) -> Result<(), PathError> {
    selector.expect_sound()
}

/// Whether a path is selected.
#[must_use]
pub fn selects(selector: &Selector, path: Path, adapter: &Adapter) -> bool {
    selector.selects(path, adapter)
}
