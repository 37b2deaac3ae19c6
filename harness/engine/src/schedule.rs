//! The orders in which the invocations of a dispatch run. WGSL guarantees no order.

use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap, HashMap};

use crate::explore::Step;

/// One of the actors of a dispatch, which run in turns: a unit, or a pending store of a unit. A unit is a group of
/// invocations of a workgroup that run side by side, operation by operation. In its turn, a unit runs to its next
/// atomic or barrier, or to its end. In its turn, a pending store takes effect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Actor {
    /// The number of the unit. Units are numbered workgroup after workgroup.
    pub(crate) unit: u32,
    /// 0 if the actor is the unit. Otherwise the number of the pending store, counted from 1.
    pub(crate) store: u32,
}

/// The rule that chooses the [`Actor`] that gets the next turn. A turn ends before the actor's next atomic.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Priorities {
    /// Chooses the actor with the lowest number.
    #[default]
    ByNumber,
    /// Chooses the actor with the highest number.
    Backwards,
    /// Chooses the actor that has waited longest, so all actors take turns.
    InTurn,
    /// Chooses a random actor. The parameter is the seed.
    Shuffled(u64),
}

/// The time at which atomic stores take effect. WGSL's atomics are relaxed: if two atomics access different words, only
/// a barrier orders them (15.4, *Memory model*).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Stores {
    /// Each store takes effect immediately.
    #[default]
    AtOnce,
    /// Some stores, chosen at random, take effect only when all other actors have ended or wait. But each store takes
    /// effect before the next barrier of its invocation, and before its invocation accesses the same word again. The
    /// parameter is the seed.
    Late(u64),
}

/// An order of the invocations of a dispatch.
///
/// Each invocation runs to its next atomic. Then the invocation with the highest priority goes on. An invocation gets
/// the lowest priority if it waits for others in a loop, or if it stalls: if it reaches an atomic that `stalls` lists.
/// If a failure needs only a few switches between invocations, random priorities with random stalls find the failure
/// with a known probability (Burckhardt et al. 2010, *A randomized scheduler with probabilistic guarantees of finding
/// bugs*).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Schedule {
    /// The rule that chooses the actor of the next turn.
    pub priorities: Priorities,
    /// The number of turns in which invocations may wait in loops before a waiting invocation gets the lowest priority.
    /// A loop that waits may end even if no other invocation changes a word, for example after a fixed number of
    /// iterations.
    pub patience: u32,
    /// The invocations that stall, each with the number of an atomic: the invocation stalls before it runs this atomic.
    /// Each invocation counts its atomics from 1.
    pub stalls: Vec<(usize, u32)>,
    /// The actors that get the first turns, one after another, for example as an [`Explorer`](crate::Explorer) chose
    /// them. After these turns, `priorities` decides.
    pub turns: Vec<Actor>,
    /// The time at which atomic stores take effect.
    pub stores: Stores,
    /// The number of successive invocations of a workgroup that run side by side, operation by operation.
    pub together: usize,
    /// The number of invocations of a subgroup. WebGPU allows 4 to 128 (*subgroupMinSize*).
    pub subgroup: u32,
}

impl Schedule {
    /// The default number of invocations of a subgroup. Most GPUs have 32.
    pub const SUBGROUP: u32 = 32;

    /// The order in which the invocations of a workgroup run one after another, by number.
    #[must_use]
    pub fn one_by_one() -> Self {
        Self { together: 1, ..Self::default() }
    }
}

impl Default for Schedule {
    /// The usual order: workgroup after workgroup, and the invocations of a workgroup side by side.
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

/// Decides which actor gets the next turn.
pub(crate) trait Turns {
    /// Announces an actor that can go on. `step` has the actor's next accesses to shared words.
    fn ready(&mut self, actor: Actor, step: Step);

    /// Chooses the actor of the next turn. This actor isn't ready any more until the next call of
    /// [`ready`](Self::ready). `None` if no actor is ready, or if the run needn't be finished.
    fn next(&mut self) -> Option<Actor>;

    /// Announces that the actor of the last turn waits until another actor changes the word that the waiting actor
    /// reads.
    fn waits(&mut self);

    /// Announces that these units have passed a barrier: all their earlier turns come before all their later turns.
    fn joined(&mut self, units: std::ops::Range<u32>);

    /// Checks if [`ready`](Self::ready) needs the accesses of the actor's next step. If not, callers may pass a step
    /// without accesses.
    fn asks(&self) -> bool {
        false
    }
}

/// The largest number of successive turns of one actor. After these turns, other actors get a turn, because the actor
/// may wait for other actors in a loop that Karat doesn't recognise.
const MOST_IN_A_ROW: u32 = 1 << 12;

pub(crate) struct ByPriority<'s> {
    schedule: &'s Schedule,
    /// The units that stall, each with the number of an atomic: the unit stalls before it runs this atomic.
    stalls: Vec<(u32, u32)>,
    heap: BinaryHeap<(i64, Reverse<Actor>)>,
    /// The actors whose next step has no effect that other actors see, so the step doesn't count as a turn. Empty if
    /// the schedule lists no turns.
    eager: BTreeSet<Actor>,
    changed: HashMap<u32, i64>,
    atomics: HashMap<u32, u32>,
    lowest: i64,
    /// The number of further turns in which units may wait before a waiting unit gets the lowest priority.
    patience: u32,
    last: Actor,
    /// The number of successive turns that the current unit has had.
    row: u32,
    turns: std::slice::Iter<'s, Actor>,
}

impl<'s> ByPriority<'s> {
    /// Prepares the schedule. A workgroup has `invocations` invocations, and a unit has `lanes` invocations.
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
            // This is lower than the number of any unit.
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
        // After the last turn of the explored order, priorities decide. They also decide if the order's next actor
        // isn't ready.
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

/// The numbers from 0 to `count - 1` in random order (Fisher and Yates).
pub(crate) fn shuffled(count: usize, seed: u64) -> Vec<usize> {
    let (mut all, mut state): (Vec<usize>, u64) = ((0..count).collect(), seed);
    for at in (1..count).rev() {
        all.swap(at, (next(&mut state) % (at as u64 + 1)) as usize);
    }
    all
}

fn chance(seed: u64, actor: Actor) -> u64 {
    let mut state = seed ^ (u64::from(actor.unit) << 32 | u64::from(actor.store)).rotate_left(17);
    next(&mut state);
    next(&mut state)
}

pub(crate) fn next(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = (*state ^ (*state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
