//! The aim of the search for failing arguments, which begins after a check's cases pass.

/// A function that returns the distance of a result from the aim.
pub(super) type Distance<'d> = &'d (dyn Fn(&[u32]) -> f64 + Sync);

/// The aim of a search.
pub(super) struct Goal<'g> {
    /// The distance of a result from the aim: 0 or less if the result reaches it. `None` if there is no aim.
    pub(super) distance: Option<Distance<'g>>,
    /// True if arguments with this result fail.
    pub(super) fails: &'g (dyn Fn(&[u32], &[u32]) -> bool + Sync),
    /// True if it is proved that no arguments fail.
    pub(super) is_proved: &'g dyn Fn() -> bool,
}
