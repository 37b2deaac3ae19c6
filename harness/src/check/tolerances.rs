//! The tolerance of a check, and those of single paths.

use super::called::Called;
use super::{Failure, Mismatch};
use crate::path::{Adapter, Path, Selected};
use crate::tolerance::Tolerance;

/// A tolerance with its exceptions.
#[derive(Clone, Debug)]
pub(super) struct Tolerances {
    /// On paths that have none of their own.
    pub(super) general: Tolerance,
    pub(super) on: Selected<Tolerance>,
}

impl Tolerances {
    pub(super) fn of(&self, path: Path, adapter: &Adapter) -> &Tolerance {
        self.on.on(path, adapter).unwrap_or(&self.general)
    }

    /// Refuses tolerances that bound nothing or are declared for another number of components.
    pub(super) fn expect_usable(&self, called: &Called<'_>) -> Result<(), Failure> {
        let mut all = self.on.iter().map(|(_, tolerance)| tolerance).chain([&self.general]);
        all.try_for_each(|tolerance| called.expect_lanes(tolerance))
    }

    /// The tolerance of each of a function's paths.
    pub(super) fn of_paths(&self, called: &Called<'_>) -> Vec<&Tolerance> {
        called.ready.iter().map(|ready| self.of(ready.path, &ready.adapter)).collect()
    }
}

/// Refuses a path's own tolerance for a verb that has none.
pub(super) fn expect_none(
    on: &Selected<Tolerance>,
    check: &'static str,
    called: &Called<'_>,
) -> Result<(), Failure> {
    on.iter().next().map_or(Ok(()), |(path, tolerance)| {
        let (on, tolerance) = (path.clone(), tolerance.clone());
        Err(Mismatch::NoTolerance { check, on, tolerance }.of(called.function()))
    })
}
