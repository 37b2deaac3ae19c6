//! Orders of the invocations of a dispatch: WGSL promises none.

use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap, HashMap};

use crate::explore::Step;

/// Invocations of a workgroup that run from operation to operation side by side, or one of their stores that has
/// yet to take effect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Actor {
    /// The number of the invocations' unit, workgroup after workgroup.
    pub(crate) unit: u32,
    /// 0: the invocations themselves; else their store of this number, counted from 1.
    pub(crate) store: u32,
}

/// Which of those that can go on does so, up to its next atomic.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Priorities {
    /// The first by number.
    #[default]
    ByNumber,
    /// The last by number.
    Backwards,
    /// The one that waits longest: each has its turn after all others.
    InTurn,
    /// One by a seed.
    Shuffled(u64),
}

/// When atomic stores take effect. WGSL's atomics are relaxed: nothing but a barrier orders two of them that access
/// different words (15.4, *Memory model*).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Stores {
    /// At once.
    #[default]
    AtOnce,
    /// Some of them, by a seed, when all else has ended or waits; never behind a barrier, or behind an access of
    /// the same word, by their invocation.
    Late(u64),
}

/// An order of the invocations of a dispatch.
///
/// Each runs to its next atomic, and then the one of the highest priority goes on. One that waits in a loop for
/// others, or comes to an atomic where it is to stall, has the lowest priority from then on. Such orders find with a
/// known chance each failure that few changes of turn make (Burckhardt et al. 2010, *A randomized scheduler with
/// probabilistic guarantees of finding bugs*).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Schedule {
    /// Which of them goes on.
    pub priorities: Priorities,
    /// Turns of invocations that wait in loops, before they have the lowest priority: a loop may end by itself.
    pub patience: u32,
    /// Invocations that stall before their n-th atomic, counted from 1.
    pub stalls: Vec<(usize, u32)>,
    /// The turns before priorities decide: those of an order that was explored.
    pub turns: Vec<Actor>,
    /// When atomic stores take effect.
    pub stores: Stores,
    /// Neighbours of a workgroup that go from operation to operation side by side.
    pub together: usize,
    /// Invocations of a subgroup: WebGPU has devices of 4 to 128 (*subgroupMinSize*).
    pub subgroup: u32,
}

impl Schedule {
    /// Invocations of a subgroup where no schedule says another number: most GPUs have 32.
    pub const SUBGROUP: u32 = 32;

    /// The one by numbers in which the invocations of a workgroup run one by one.
    #[must_use]
    pub fn one_by_one() -> Self {
        Self { together: 1, ..Self::default() }
    }
}

impl Default for Schedule {
    /// The usual order: workgroup after workgroup, the invocations of each side by side.
    fn default() -> Self {
        Self {
            priorities: Priorities::ByNumber,
            patience: 0,
            stalls: Vec::new(),
            turns: Vec::new(),
            stores: Stores::AtOnce,
            together: usize::MAX,
            subgroup: Self::SUBGROUP,
        }
    }
}

/// Decides whose turn it is.
pub(crate) trait Turns {
    /// An actor can go on. What it does then to words that others see is `step`.
    fn ready(&mut self, actor: Actor, step: Step);

    /// The actor whose turn it is, which isn't ready any more. `None`: none is, or the run isn't worth its end.
    fn next(&mut self) -> Option<Actor>;

    /// The actor that had its turn last waits for another one to change what it reads.
    fn waits(&mut self);

    /// All that these actors have done comes before all that they do from now on.
    fn joined(&mut self, units: std::ops::Range<u32>);

    /// Returns `true` if it asks what actors do next.
    fn asks(&self) -> bool {
        false
    }
}

/// Turns in a row, after which others have theirs: a loop may wait for them in a way that looks like work.
const MOST_IN_A_ROW: u32 = 1 << 12;

/// Turns by priorities.
pub(crate) struct ByPriority<'s> {
    schedule: &'s Schedule,
    /// Units that stall, each before the atomic of this number.
    stalls: Vec<(u32, u32)>,
    heap: BinaryHeap<(i64, Reverse<Actor>)>,
    /// Of an order that was explored: what changes nothing that others see, which isn't a turn there.
    eager: BTreeSet<Actor>,
    /// Priorities that aren't those of the schedule any more.
    changed: HashMap<u32, i64>,
    atomics: HashMap<u32, u32>,
    lowest: i64,
    /// Turns that are left to those that wait.
    patience: u32,
    last: Actor,
    /// The turns that it has had in a row.
    row: u32,
    turns: std::slice::Iter<'s, Actor>,
}

impl<'s> ByPriority<'s> {
    /// Of workgroups of so many invocations, of which so many are a unit.
    pub(crate) fn new(schedule: &'s Schedule, invocations: usize, lanes: usize) -> Self {
        let units = invocations.div_ceil(lanes);
        let unit_of = |invocation: usize| {
            let unit = (invocation / invocations) * units + (invocation % invocations) / lanes;
            u32::try_from(unit).unwrap_or(u32::MAX)
        };
        let stalls = schedule.stalls.iter().map(|(invocation, at)| (unit_of(*invocation), *at));
        Self {
            schedule,
            stalls: stalls.collect(),
            heap: BinaryHeap::new(),
            eager: BTreeSet::new(),
            changed: HashMap::new(),
            atomics: HashMap::new(),
            // Below each number of a unit.
            lowest: -(1 << 62),
            patience: schedule.patience,
            last: Actor::default(),
            row: 0,
            turns: schedule.turns.iter(),
        }
    }

    fn priority(&mut self, actor: Actor) -> i64 {
        if actor.store > 0 {
            return match self.schedule.stores {
                Stores::Late(seed) if chance(seed, actor) & 1 == 1 => self.below_all(),
                _ => i64::MAX,
            };
        }
        if let Some(changed) = self.changed.get(&actor.unit) {
            return *changed;
        }
        match self.schedule.priorities {
            Priorities::ByNumber => -i64::from(actor.unit),
            Priorities::Backwards => i64::from(actor.unit),
            Priorities::InTurn => self.below_all(),
            Priorities::Shuffled(seed) => (chance(seed, actor) >> 2) as i64,
        }
    }

    /// A priority below each that there is.
    fn below_all(&mut self) -> i64 {
        self.lowest -= 1;
        self.lowest
    }

    fn lower(&mut self, unit: u32) {
        let lowest = self.below_all();
        self.changed.insert(unit, lowest);
    }
}

impl Turns for ByPriority<'_> {
    fn ready(&mut self, actor: Actor, step: Step) {
        if !step.is_atomic() && !self.schedule.turns.is_empty() {
            self.eager.insert(actor);
            return;
        }
        if actor.store == 0 && step.is_atomic() && !self.stalls.is_empty() {
            let count = self.atomics.entry(actor.unit).or_default();
            *count += 1;
            if self.stalls.contains(&(actor.unit, *count)) {
                self.lower(actor.unit);
            }
        }
        if self.row >= MOST_IN_A_ROW && actor == self.last {
            self.row = 0;
            self.lower(actor.unit);
        }
        let priority = self.priority(actor);
        self.heap.push((priority, Reverse(actor)));
    }

    fn next(&mut self) -> Option<Actor> {
        if let Some(actor) = self.eager.pop_first() {
            self.last = actor;
            return Some(actor);
        }
        // What an explored order didn't come to has no turn in it.
        if let Some(wanted) = self.turns.next()
            && self.heap.iter().any(|(_, actor)| actor.0 == *wanted)
        {
            self.heap.retain(|(_, actor)| actor.0 != *wanted);
            self.last = *wanted;
            return Some(*wanted);
        }
        let next = self.heap.pop()?.1.0;
        self.row = if next == self.last { self.row + 1 } else { 0 };
        self.last = next;
        Some(next)
    }

    fn waits(&mut self) {
        match self.patience.checked_sub(1) {
            Some(left) => self.patience = left,
            None => self.lower(self.last.unit),
        }
    }

    fn joined(&mut self, _: std::ops::Range<u32>) {}
}

/// The numbers below a count, shuffled (Fisher and Yates).
pub(crate) fn shuffled(count: usize, seed: u64) -> Vec<usize> {
    let (mut all, mut state): (Vec<usize>, u64) = ((0..count).collect(), seed);
    for at in (1..count).rev() {
        all.swap(at, (next(&mut state) % (at as u64 + 1)) as usize);
    }
    all
}

/// A number by a seed, for an actor.
fn chance(seed: u64, actor: Actor) -> u64 {
    let mut state = seed ^ (u64::from(actor.unit) << 32 | u64::from(actor.store)).rotate_left(17);
    next(&mut state);
    next(&mut state)
}

/// The next number of `splitmix64`.
pub(crate) fn next(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = (*state ^ (*state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
