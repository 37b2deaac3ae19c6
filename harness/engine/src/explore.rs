//! Explores the orders of a dispatch's atomics. An order is a sequence of turns: in a turn, one [`Actor`] runs one
//! atomic and everything up to its next atomic. Of each class of equivalent orders, the explorer runs one.
//!
//! Two orders are equivalent if one becomes the other by exchanging neighbouring turns that commute. Two accesses
//! commute if they access different words, if both read, or if both add and no operation uses their results. A *source
//! set* contains the turns that the explorer must try at one point of an order, each in its own run. A *sleep set*
//! contains the turns that would only lead to orders that are equivalent to earlier ones (Abdulla et al. 2014, *Optimal
//! dynamic partial order reduction*, algorithm 1).

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use naga::AtomicFunction;

use crate::schedule::{Actor, Turns};

/// A word that invocations share: the variable, the workgroup that has the variable's memory, and the word's offset in
/// bytes.
pub(crate) type Word = (u32, u32, u32);

/// The kind of an atomic access. Two accesses of one word commute if both have the same kind, other than
/// `Changes`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) enum Access {
    Reads,
    /// Adds to the word, and no operation uses the word that the atomic returns. Atomics of the next five kinds also
    /// return a word that no operation uses.
    Adds,
    Ands,
    Ors,
    Xors,
    Mins,
    Maxes,
    /// Any other access.
    Changes,
}

impl Access {
    pub(crate) fn of(function: AtomicFunction, result: bool) -> Self {
        match function {
            _ if result => Self::Changes,
            AtomicFunction::Add | AtomicFunction::Subtract => Self::Adds,
            AtomicFunction::And => Self::Ands,
            AtomicFunction::InclusiveOr => Self::Ors,
            AtomicFunction::ExclusiveOr => Self::Xors,
            AtomicFunction::Min => Self::Mins,
            AtomicFunction::Max => Self::Maxes,
            AtomicFunction::Exchange { .. } => Self::Changes,
        }
    }

    /// Checks if two accesses of one word have the same effect in both orders.
    pub(crate) fn commutes(self, other: Self) -> bool {
        self == other && self != Self::Changes
    }
}

/// The accesses of shared words in the next turn of an [`Actor`]. The first turn of an actor, and the first turn after
/// a barrier, have no such accesses.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Step {
    atomic: bool,
    touches: Vec<(Word, Access)>,
}

impl Step {
    /// The step of an actor whose next turn begins with an atomic. Only the explorer uses `touches`, so it may be empty
    /// in other runs.
    pub(crate) fn atomic(touches: Vec<(Word, Access)>) -> Self {
        Self { atomic: true, touches }
    }

    pub(crate) fn is_atomic(&self) -> bool {
        self.atomic
    }

    fn commutes(&self, other: &Self) -> bool {
        self.touches.iter().all(|(word, access)| {
            let mut others = other.touches.iter().filter(|(own, _)| own == word);
            others.all(|(_, other)| access.commutes(*other))
        })
    }

    fn changes(&self) -> bool {
        self.touches.iter().any(|(_, access)| *access != Access::Reads)
    }
}

/// A vector clock at a point in a run: for each actor, the number of its turns before this point.
type Clock = Vec<u32>;

fn join(to: &mut Clock, from: &[u32]) {
    to.resize(to.len().max(from.len()), 0);
    to.iter_mut().zip(from).for_each(|(own, count)| *own = (*own).max(*count));
}

#[derive(Debug)]
struct Taken {
    actor: Actor,
    step: Step,
    /// The index of the turn's actor in a [`Clock`]. `number` is the turn's number among the actor's turns, and `clock`
    /// counts this turn and all turns that come before it.
    own: usize,
    number: u32,
    clock: Clock,
}

impl Taken {
    /// Checks if this turn is one of the turns that the clock counts.
    fn is_before(&self, clock: &[u32]) -> bool {
        clock.get(self.own).is_some_and(|count| *count >= self.number)
    }
}

#[derive(Debug)]
struct Node {
    ready: BTreeMap<Actor, Step>,
    chosen: Actor,
    /// The actors to try at this point. For each of them, the explorer runs one order in which the actor has its turn
    /// here.
    wanted: BTreeSet<Actor>,
    /// The actors that needn't get a turn at this point, because the turn would lead to an order that is equivalent to
    /// an earlier one.
    asleep: BTreeMap<Actor, Step>,
}

/// The largest number of turns in an explored order. A longer run has too many orders to explore, or doesn't end.
const MOST_TURNS: usize = 512;

/// Chooses the order of the atomics for each run of the same dispatches, until it has explored all orders.
#[derive(Debug, Default)]
pub struct Explorer {
    nodes: Vec<Node>,
    /// The turns of the current run. `ready` has the actors that can go on, `waiting` those that wait for a changed
    /// word.
    taken: Vec<Taken>,
    ready: BTreeMap<Actor, Step>,
    waiting: BTreeMap<Actor, Step>,
    clocks: BTreeMap<Actor, Clock>,
    numbers: BTreeMap<Actor, usize>,
    work: u64,
    /// A clock that counts all turns of the dispatches before the current one.
    base: Clock,
    begins: Vec<usize>,
    last: Actor,
    last_waits: bool,
    cut: bool,
    has_waited: bool,
    too_long: bool,
    has_begun: bool,
}

impl Explorer {
    /// Begins the next run. Returns `false` if no order is left to run.
    pub fn begin(&mut self) -> bool {
        if std::mem::replace(&mut self.has_begun, true) {
            loop {
                let Some(node) = self.nodes.last_mut() else { return false };
                if let Some(step) = node.ready.get(&node.chosen) {
                    node.asleep.insert(node.chosen, step.clone());
                }
                let left = node.wanted.iter().find(|actor| !node.asleep.contains_key(actor));
                if let Some(next) = left {
                    node.chosen = *next;
                    break;
                }
                self.nodes.pop();
            }
        }
        self.taken.clear();
        self.clocks.clear();
        self.base.clear();
        self.begins.clear();
        self.cut = false;
        true
    }

    /// Begins a dispatch. All turns of earlier dispatches come before the turns of this dispatch.
    pub(crate) fn begin_dispatch(&mut self) {
        let clocks = std::mem::take(&mut self.clocks);
        clocks.values().for_each(|clock| join(&mut self.base, clock));
        for taken in &self.taken {
            join(&mut self.base, &taken.clock);
        }
        self.ready.clear();
        self.waiting.clear();
        self.begins.push(self.taken.len());
    }

    /// Checks if the run was cut short because it is equivalent to an earlier run.
    #[must_use]
    pub fn is_cut(&self) -> bool {
        self.cut
    }

    /// Checks if an invocation waited for other invocations in a loop. In an order that wasn't tried, this invocation
    /// might have left the loop.
    #[must_use]
    pub fn has_waited(&self) -> bool {
        self.has_waited
    }

    /// Checks if the explorer stopped a run because the run had too many turns.
    #[must_use]
    pub fn is_too_long(&self) -> bool {
        self.too_long
    }

    /// The number of pairs of turns that the explorer has compared in all runs so far. This number measures the cost of
    /// exploring.
    #[must_use]
    pub fn work(&self) -> u64 {
        self.work
    }

    /// For each dispatch of the run, the actors in the order of their turns.
    #[must_use]
    pub fn turns(&self) -> Vec<Vec<Actor>> {
        let ends = self.begins.iter().skip(1).copied().chain([self.taken.len()]);
        let of = |(begin, end): (&usize, usize)| {
            self.taken[*begin..end].iter().map(|taken| taken.actor).collect()
        };
        self.begins.iter().zip(ends).map(of).collect()
    }

    fn take(&mut self, actor: Actor) -> Option<Actor> {
        let step = self.ready.remove(&actor)?;
        let base = &self.base;
        let mut clock = self.clocks.get(&actor).cloned().unwrap_or_else(|| base.clone());
        // The clock gets all earlier turns that don't commute with this turn.
        let before = clock.clone();
        for taken in &self.taken {
            if !taken.step.commutes(&step) {
                join(&mut clock, &taken.clock);
            }
        }
        self.work += self.taken.len() as u64;
        self.want_otherwise(actor, &step, &before);
        let next = self.numbers.len();
        let own = *self.numbers.entry(actor).or_insert(next);
        clock.resize(clock.len().max(own + 1), 0);
        clock[own] += 1;
        let number = clock[own];
        self.clocks.insert(actor, clock.clone());
        let changes = step.changes();
        self.taken.push(Taken { actor, step, own, number, clock });
        if changes {
            self.ready.append(&mut self.waiting);
        }
        self.last = actor;
        Some(actor)
    }

    /// If the actor's turn races with an earlier turn, adds an actor to try at the point of the earlier turn. So a
    /// later run has the two racing turns in the opposite order.
    fn want_otherwise(&mut self, actor: Actor, step: &Step, before: &[u32]) {
        let mut racing: Vec<usize> = Vec::new();
        let mut dependent: Vec<usize> = Vec::new();
        for at in (0..self.taken.len()).rev() {
            let one = &self.taken[at];
            if one.actor == actor || one.step.commutes(step) || one.is_before(before) {
                continue;
            }
            // The two turns race if no turn between them orders them.
            if !dependent.iter().any(|between| one.is_before(&self.taken[*between].clock)) {
                racing.push(at);
            }
            dependent.push(at);
        }
        for at in racing {
            let one = &self.taken[at];
            // The actors that may go first among the turns after `one` that don't depend on `one`, and this turn.
            let mut firsts: Vec<Actor> = Vec::new();
            let mut seen: Vec<&Taken> = Vec::new();
            let free = self.taken[at + 1..].iter().filter(|other| !one.is_before(&other.clock));
            for other in free {
                if !seen.iter().any(|before| before.is_before(&other.clock)) {
                    firsts.push(other.actor);
                }
                seen.push(other);
            }
            let depends = |other: &&Taken| other.is_before(before) || !other.step.commutes(step);
            if !seen.iter().any(depends) {
                firsts.push(actor);
            }
            let node = &mut self.nodes[at];
            if firsts.iter().any(|first| node.wanted.contains(first)) {
                continue;
            }
            match firsts.iter().find(|first| node.ready.contains_key(first)) {
                Some(first) => drop(node.wanted.insert(*first)),
                None => node.wanted.extend(node.ready.keys()),
            }
        }
    }
}

impl Turns for Explorer {
    fn ready(&mut self, actor: Actor, step: Step) {
        // A pending store comes after everything that its invocation has done so far.
        if actor.store > 0 {
            let unit = Actor { store: 0, ..actor };
            let clock = self.clocks.get(&unit).unwrap_or(&self.base).clone();
            self.clocks.insert(actor, clock);
        }
        let waits = std::mem::take(&mut self.last_waits) && actor == self.last;
        if waits { &mut self.waiting } else { &mut self.ready }.insert(actor, step);
    }

    fn next(&mut self) -> Option<Actor> {
        // A step without an atomic isn't a turn, because other actors can't see it.
        if let Some(actor) =
            self.ready.iter().find(|(_, step)| !step.atomic).map(|(actor, _)| *actor)
        {
            self.ready.remove(&actor);
            self.last = actor;
            return Some(actor);
        }
        if self.ready.is_empty() {
            // All other actors wait. They may still go on, because a loop may end without a change.
            self.ready.append(&mut self.waiting);
        }
        let at = self.taken.len();
        if at >= MOST_TURNS {
            (self.cut, self.too_long) = (true, true);
            return None;
        }
        if at == self.nodes.len() {
            let mut asleep = BTreeMap::new();
            if let (Some(node), Some(taken)) = (self.nodes.last(), self.taken.last()) {
                let still = |(_, step): &(&Actor, &Step)| step.commutes(&taken.step);
                let still = node.asleep.iter().filter(still);
                asleep.extend(still.map(|(actor, step)| (*actor, step.clone())));
            }
            let ready = self.ready.clone();
            let chosen = ready.keys().find(|actor| !asleep.contains_key(actor)).copied();
            let Some(chosen) = chosen else {
                self.cut = !ready.is_empty();
                return None;
            };
            self.nodes.push(Node { ready, chosen, wanted: BTreeSet::from([chosen]), asleep });
        }
        self.take(self.nodes[at].chosen)
    }

    fn waits(&mut self) {
        (self.last_waits, self.has_waited) = (true, true);
    }

    fn joined(&mut self, units: Range<u32>) {
        let mut all = self.base.clone();
        let is_own = |actor: &Actor| units.contains(&actor.unit);
        for (_, clock) in self.clocks.iter().filter(|(actor, _)| is_own(actor)) {
            join(&mut all, clock);
        }
        for unit in units {
            self.clocks.insert(Actor { unit, store: 0 }, all.clone());
        }
    }

    fn asks(&self) -> bool {
        true
    }
}
