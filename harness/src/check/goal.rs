//! The aim of a search behind the cases of a check.

/// How far a result is from an aim.
pub(super) type Distance<'d> = &'d (dyn Fn(&[u32]) -> f64 + Sync);

/// The aim of a search.
pub(super) struct Goal<'g> {
    /// How far a result is from it, which is 0 or less where it is reached; `None`: there is no such end.
    pub(super) distance: Option<Distance<'g>>,
    /// True if arguments with this result fail.
    pub(super) fails: &'g (dyn Fn(&[u32], &[u32]) -> bool + Sync),
    /// True if no arguments do.
    pub(super) is_proved: &'g dyn Fn() -> bool,
}
