//! The aim of a search for failing arguments. The search begins after a check's sampled cases pass.

/// A function that returns the distance between a result and the search's aim.
pub(super) type Distance<'d> = &'d (dyn Fn(&[u32]) -> f64 + Sync);

pub(super) struct Goal<'g> {
    /// The distance between a result and the aim: 0 or less if the result reaches the aim. `None` if the search
    /// has no aim.
    pub(super) distance: Option<Distance<'g>>,
    /// A function that takes a case's arguments and result, and returns `true` if the case fails.
    pub(super) fails: &'g (dyn Fn(&[u32], &[u32]) -> bool + Sync),
    /// A function that returns `true` if Karat proved that the statement holds for all arguments.
    pub(super) is_proved: &'g dyn Fn() -> bool,
}
