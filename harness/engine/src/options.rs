//! How a program runs.

use std::sync::Arc;
use std::time::Instant;

use crate::accuracy::Accuracy;
use crate::coverage::Counts;
use crate::schedule::Schedule;

/// The element that an index outside of its array finds. WGSL allows a read there to give any element, or zero
/// (6.4.4, *Out of Bounds Access*).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Elsewhere {
    /// The nearest.
    #[default]
    Clamped,
    /// The one of this number, modulo that of elements.
    Nth(u32),
    /// The one that the index is modulo the number of elements.
    Wrapped,
    /// None: it reads this number. WGSL allows zero, and any that an element may hold.
    Number(u8),
}

impl Elsewhere {
    /// The element of an index, of so many.
    pub(crate) fn find(self, index: i64, last: i64) -> i64 {
        match self {
            _ if (0..=last).contains(&index) => index,
            Self::Nth(number) => i64::from(number) % (last + 1),
            Self::Wrapped => index.rem_euclid(last + 1),
            Self::Clamped | Self::Number(_) => index.clamp(0, last),
        }
    }
}

/// What indices outside of their arrays read and write.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Choice {
    /// What is read.
    pub reads: Elsewhere,
    /// `true` if nothing is written there; else the nearest element is.
    pub drops: bool,
}

/// How a program runs.
#[derive(Clone, Debug)]
pub struct Options {
    /// Rounds of all loops together that a case may run: 2^20 by default, far above what a pixel
    /// can afford and some seconds at most until a loop without end is found.
    pub fuel: u64,
    /// `true` if a call leaves out a case that spends its fuel, where it would stop: the results say which. Intervals
    /// stop.
    pub leaves: bool,
    /// Rounds of all loops of all cases together that a dispatch may run; all that there are by default.
    pub work: u64,
    /// When a run ends that is still in a loop; `None`: never.
    pub deadline: Option<Instant>,
    /// Rounds for which the exit of a loop may be undecided before its results are unbounded, in
    /// intervals: 256 by default. Bounds that haven't converged by then rarely do.
    pub undecided: u64,
    /// `true` if subnormals are flushed to zero, in `f32`: operands and results of each operation that WGSL lets do so
    /// (15.7.2), but nothing that is only moved.
    pub flush: bool,
    /// `true` if a constant stands for each decimal that is rounded to it, in intervals: `0.1` is then all between its
    /// neighbours, as whoever computes with another type has another 0.1. Integers and short binary fractions such as
    /// 0.75 are what they are.
    pub decimals: bool,
    /// What was measured of an adapter, whose bounds are then asked for in place of the
    /// specification's, in intervals.
    pub accuracy: Option<Arc<Accuracy>>,
    /// What indices outside of their arrays read and write. What differs between two such runs depends on what WGSL
    /// leaves open.
    pub outside: Choice,
    /// One operation that reads elsewhere than the others, by its site.
    pub outside_at: Option<(u32, Elsewhere)>,
    /// The order in which workgroups and invocations of a dispatch run.
    pub schedule: Schedule,
    /// Turns that a dispatch may have: all that there are by default.
    pub most_turns: usize,
    /// `true` if a dispatch returns the order of its atomics.
    pub shows_order: bool,
    /// Counts what runs, in `f32`.
    pub counts: Option<Arc<Counts>>,
}

impl Options {
    /// Invocations of a subgroup. A ballot has a bit for each of 128.
    pub(crate) fn subgroup(&self) -> u32 {
        self.schedule.subgroup.clamp(1, 128)
    }
}

impl Default for Options {
    fn default() -> Self {
        Self {
            fuel: 1 << 20,
            leaves: false,
            work: u64::MAX,
            deadline: None,
            undecided: 256,
            flush: false,
            decimals: false,
            accuracy: None,
            outside: Choice::default(),
            outside_at: None,
            schedule: Schedule::default(),
            most_turns: usize::MAX,
            shows_order: false,
            counts: None,
        }
    }
}
