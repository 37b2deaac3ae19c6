use super::called::Called;
use super::{Failure, Mismatch};
use crate::path::Selected;
use crate::tolerance::Tolerance;

/// A tolerance, and the tolerances that replace it on single paths.
#[derive(Clone, Debug)]
pub(super) struct Tolerances {
    /// The tolerance on paths that don't have their own tolerance.
    pub(super) general: Tolerance,
    pub(super) on: Selected<Tolerance>,
}

impl Tolerances {
    pub(super) fn of(&self, called: &Called<'_>) -> &Tolerance {
        self.own(called).unwrap_or(&self.general)
    }

    pub(super) fn own(&self, called: &Called<'_>) -> Option<&Tolerance> {
        self.on.on(called.path, &called.adapter)
    }

    /// Returns an error if a tolerance has an unusable bound, or has more or fewer bounds than the result has
    /// components.
    pub(super) fn expect_usable(&self, called: &Called<'_>) -> Result<(), Failure> {
        let mut all = self.on.iter().map(|(_, tolerance)| tolerance).chain([&self.general]);
        all.try_for_each(|tolerance| called.expect_lanes(tolerance))
    }
}

/// Returns an error if the test sets a tolerance for a path, although the verb uses no tolerance.
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
