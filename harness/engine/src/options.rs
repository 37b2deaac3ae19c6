//! How a program runs.

use std::sync::Arc;
use std::time::Instant;

use crate::accuracy::Accuracy;
use crate::schedule::Schedule;

/// How a program runs.
#[derive(Clone, Debug)]
pub struct Options {
    /// Rounds of all loops together that a case may run: 2^20 by default, far above what a pixel
    /// can afford and some seconds at most until a loop without end is found.
    pub fuel: u64,
    /// Rounds of all loops of all cases together that a dispatch may run; all that there are by default.
    pub work: u64,
    /// When a run ends that is still in a loop; `None`: never.
    pub deadline: Option<Instant>,
    /// Rounds for which the exit of a loop may be undecided before its results are unbounded, in
    /// intervals: 256 by default. Bounds that haven't converged by then rarely do.
    pub undecided: u64,
    /// Whether subnormals are flushed to zero, in `f32`: operands and results of each operation that WGSL lets do so
    /// (15.7.2), but nothing that is only moved.
    pub flush: bool,
    /// Whether a constant stands for each decimal that is rounded to it, in intervals: `0.1` is then
    /// all between its neighbours, as whoever computes with another type has another 0.1. Integers
    /// and short binary fractions such as 0.75 are what they are.
    pub decimals: bool,
    /// What was measured of an adapter, whose bounds are then asked for in place of the
    /// specification's, in intervals.
    pub accuracy: Option<Arc<Accuracy>>,
    /// The number that is read with an index outside of its array, or at a texel that isn't there, where WGSL
    /// allows any element or zero; `None`: the nearest one that is there. With a number, nothing is
    /// written there. What differs between two such runs depends on what WGSL leaves open.
    pub outside: Option<u8>,
    /// The one operation of which that is so; `None`: each.
    pub outside_at: Option<u32>,
    /// The order in which workgroups and invocations of a dispatch run; `None`: by their numbers.
    pub schedule: Option<Schedule>,
    /// Workgroups that run beside each other, each to its next atomic or barrier before the next one goes on: 1 by default.
    /// So one of them may act upon what an atomic gave it after another one has changed that. In a serial schedule each
    /// invocation does so, and in a shuffled one chance decides whose turn it is.
    pub beside: usize,
}

impl Options {
    /// Invocations of a subgroup. A ballot has a bit for each of 128.
    pub(crate) fn subgroup(&self) -> u32 {
        self.schedule.map_or(Schedule::SUBGROUP, |schedule| schedule.subgroup).clamp(1, 128)
    }
}

impl Default for Options {
    fn default() -> Self {
        Self {
            fuel: 1 << 20,
            work: u64::MAX,
            deadline: None,
            undecided: 256,
            flush: false,
            decimals: false,
            accuracy: None,
            outside: None,
            outside_at: None,
            schedule: None,
            beside: 1,
        }
    }
}
