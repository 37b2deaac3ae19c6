//! Options of a run.

use std::sync::Arc;
use std::time::Instant;

use crate::accuracy::Accuracy;
use crate::coverage::Counts;
use crate::schedule::Schedule;

/// The element that a read returns if its index is outside of the array. WGSL allows any element, or zero (6.4.4, *Out
/// of Bounds Access*).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Elsewhere {
    /// The element nearest to the index.
    #[default]
    Clamped,
    /// The element at this index, modulo the number of elements.
    Nth(u32),
    /// The element at the invalid index, modulo the number of elements. In an array of 8 elements, index 10 reads
    /// element 2.
    Wrapped,
    /// The read returns this number, which doesn't come from the array. WGSL allows zero, and any value that an element
    /// may have.
    Number(u8),
}

impl Elsewhere {
    /// The index of the element that an access uses in place of `index`, if `index` isn't valid. `last` is the last
    /// valid index.
    pub(crate) fn find(self, index: i64, last: i64) -> i64 {
        match self {
            _ if (0..=last).contains(&index) => index,
            Self::Nth(number) => i64::from(number) % (last + 1),
            Self::Wrapped => index.rem_euclid(last + 1),
            Self::Clamped | Self::Number(_) => index.clamp(0, last),
        }
    }
}

/// The effect of reads and writes whose index is outside of the array.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Choice {
    /// The element that a read returns.
    pub reads: Elsewhere,
    /// `true` if a write outside of the array has no effect. Otherwise the write changes the nearest element.
    pub drops: bool,
}

/// Options of a run.
#[derive(Clone, Debug)]
pub struct Options {
    /// The number of iterations that all loops of a case may run in total. The default is 2^20, which is far more than
    /// a fast shader runs for a pixel. An endless loop reaches this number within seconds.
    pub fuel: u64,
    /// `true` if a call drops each case that exceeds `fuel`, and continues with the other cases. The results then list
    /// the dropped cases. Otherwise the call stops at such a case. In intervals a call always stops.
    pub leaves: bool,
    /// The number of iterations that all loops of all cases of a dispatch may run in total. Unlimited by default.
    pub work: u64,
    /// The time at which Karat stops a run that is still in a loop. `None` if there is no limit.
    pub deadline: Option<Instant>,
    /// In intervals, the number of iterations for which the exit of a loop may stay undecided before the results become
    /// unbounded. The default is 256. Bounds that haven't converged by then rarely converge later.
    pub undecided: u64,
    /// In `f32`, `true` to flush subnormals to zero: the operands and results of each operation for which WGSL allows
    /// it (15.7.2). Values that are only moved aren't flushed.
    pub flush: bool,
    /// In intervals, `true` if the interval of a constant contains each decimal number that rounds to this constant.
    /// The interval of `0.1` then reaches from the next smaller float to the next larger float, because each float type
    /// has its own nearest number to 0.1. Integers and short binary fractions such as 0.75 are exact.
    pub decimals: bool,
    /// In intervals, the measured accuracy of an adapter. With it, Karat computes narrower bounds than from the
    /// accuracy that WGSL requires.
    pub accuracy: Option<Arc<Accuracy>>,
    /// The effect of indices outside of their arrays. If two runs with different choices have different results, the
    /// result depends on something that WGSL doesn't define.
    pub outside: Choice,
    /// The number of one operation's site, and the element that this operation reads if its index is outside of its
    /// array. For all other operations, `outside` decides.
    pub outside_at: Option<(u32, Elsewhere)>,
    /// The order in which the workgroups and invocations of a dispatch run.
    pub schedule: Schedule,
    /// The largest number of turns of a dispatch. In a turn, invocations run to their next atomic or barrier. Unlimited
    /// by default.
    pub most_turns: usize,
    /// `true` to return the order in which a dispatch runs its atomics.
    pub shows_order: bool,
    /// In `f32`, the counters that show how often each statement and each branch runs.
    pub counts: Option<Arc<Counts>>,
}

impl Options {
    /// The number of invocations of a subgroup. It is at most 128, because a ballot has 128 bits.
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
