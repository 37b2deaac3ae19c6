//! Options of a run.

use std::sync::Arc;
use std::time::Instant;

use crate::accuracy::Accuracy;
use crate::coverage::Counts;
use crate::schedule::Schedule;

/// The element that a read with an index outside its array gives. WGSL allows any element, or zero (6.4.4, *Out of
/// Bounds Access*).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Elsewhere {
    /// The nearest.
    #[default]
    Clamped,
    /// The element with this number, modulo the number of elements.
    Nth(u32),
    /// The element at the index modulo the number of elements.
    Wrapped,
    /// No element: the read gives this number. WGSL allows zero, and any value that an element may have.
    Number(u8),
}

impl Elsewhere {
    /// The element for an index, if `last` is the last one.
    pub(crate) fn find(self, index: i64, last: i64) -> i64 {
        match self {
            _ if (0..=last).contains(&index) => index,
            Self::Nth(number) => i64::from(number) % (last + 1),
            Self::Wrapped => index.rem_euclid(last + 1),
            Self::Clamped | Self::Number(_) => index.clamp(0, last),
        }
    }
}

/// The effect of reads and writes with an index outside their array.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Choice {
    /// The effect of a read.
    pub reads: Elsewhere,
    /// `true` if such a write has no effect; otherwise it goes to the nearest element.
    pub drops: bool,
}

/// Options of a run.
#[derive(Clone, Debug)]
pub struct Options {
    /// The rounds of all its loops together that a case may run: 2^20 by default. That is far more than a pixel can
    /// afford, and finds an endless loop within seconds.
    pub fuel: u64,
    /// `true` if a call leaves out a case that spends its fuel, and the results list it; otherwise the call stops.
    /// Intervals always stop.
    pub leaves: bool,
    /// The rounds of all loops that all cases of a dispatch may run together; unlimited by default.
    pub work: u64,
    /// The time at which a run that is still in a loop ends; `None` for no limit.
    pub deadline: Option<Instant>,
    /// In intervals, the rounds for which the exit of a loop may stay undecided before its results become unbounded:
    /// 256 by default. Bounds that haven't converged by then rarely do.
    pub undecided: u64,
    /// `true` to flush subnormals to zero, in `f32`: operands and results of each operation for which WGSL allows it
    /// (15.7.2), but no value that is only moved.
    pub flush: bool,
    /// In intervals, `true` if a constant stands for each decimal that rounds to it. `0.1` is then the interval between
    /// its neighbours, because 0.1 in another type is another number. Integers and short binary fractions such as 0.75
    /// are exact.
    pub decimals: bool,
    /// In intervals, the measurements of an adapter. They narrow the specification's bounds.
    pub accuracy: Option<Arc<Accuracy>>,
    /// The effect of indices outside their arrays. If two runs with different choices differ, the result depends on
    /// something that WGSL leaves open.
    pub outside: Choice,
    /// An operation, by its site, that reads another element than `outside` says.
    pub outside_at: Option<(u32, Elsewhere)>,
    /// The order in which workgroups and invocations of a dispatch run.
    pub schedule: Schedule,
    /// The turns that a dispatch may have; unlimited by default.
    pub most_turns: usize,
    /// `true` to return the order of a dispatch's atomics.
    pub shows_order: bool,
    /// Counters of statements and branches, in `f32`.
    pub counts: Option<Arc<Counts>>,
}

impl Options {
    /// The invocations of a subgroup, at most 128: a ballot has that many bits.
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
