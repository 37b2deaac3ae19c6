//! All orders of the atomics of a dispatch, but for those that lead to the same.
//!
//! Two orders lead to the same if they differ by neighbours that commute: accesses of different words, two reads, two
//! sums whose results nothing uses. One of each class is run: *source sets* say which turns have to be taken instead
//! of one that was taken, *sleep sets* which lead to a class that was run (Abdulla et al. 2014, *Optimal dynamic
//! partial order reduction*, algorithm 1).

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use naga::AtomicFunction;

use crate::schedule::{Actor, Turns};

/// A word that invocations share: its variable, the workgroup whose memory it is in, its byte.
pub(crate) type Word = (u32, u32, u32);

/// The kind of an atomic, as far as others notice it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) enum Access {
    Reads,
    /// Changes the word in a way that commutes with itself, and nothing uses what it returns.
    Adds,
    Ands,
    Ors,
    Xors,
    Mins,
    Maxes,
    /// Any other.
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

    /// Returns `true` if two of these on one word lead to the same in both orders.
    pub(crate) fn commutes(self, other: Self) -> bool {
        self == other && self != Self::Changes
    }
}

/// An actor's next access of words that others see: none of the actor that begins or has passed a barrier.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Step {
    atomic: bool,
    touches: Vec<(Word, Access)>,
}

impl Step {
    /// An atomic, with what it accesses if turns ask for that.
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

/// For each actor, by its number, how many of its turns come before.
type Clock = Vec<u32>;

fn join(to: &mut Clock, from: &[u32]) {
    to.resize(to.len().max(from.len()), 0);
    to.iter_mut().zip(from).for_each(|(own, count)| *own = (*own).max(*count));
}

/// A turn that was taken.
#[derive(Debug)]
struct Taken {
    actor: Actor,
    step: Step,
    /// Its actor's number, that of the turn among those of its actor, and all that comes before it, itself included.
    own: usize,
    number: u32,
    clock: Clock,
}

impl Taken {
    /// Returns `true` if it comes before all that has this clock.
    fn is_before(&self, clock: &[u32]) -> bool {
        clock.get(self.own).is_some_and(|count| *count >= self.number)
    }
}

/// A place at which an actor's turn was chosen.
#[derive(Debug)]
struct Node {
    ready: BTreeMap<Actor, Step>,
    chosen: Actor,
    /// Those whose turn it has to be here in some order.
    wanted: BTreeSet<Actor>,
    /// Those whose turn here leads to what was run.
    asleep: BTreeMap<Actor, Step>,
}

/// Turns that an order may have: of more there are too many orders, or it has no end.
const MOST_TURNS: usize = 512;

/// Explores the orders of dispatches, run by run.
#[derive(Debug, Default)]
pub struct Explorer {
    nodes: Vec<Node>,
    /// Of the run: the turns taken, who can go on, and who waits for a word to change.
    taken: Vec<Taken>,
    ready: BTreeMap<Actor, Step>,
    waiting: BTreeMap<Actor, Step>,
    clocks: BTreeMap<Actor, Clock>,
    /// The numbers of actors.
    numbers: BTreeMap<Actor, usize>,
    /// Pairs of turns that were looked at, in all runs.
    work: u64,
    /// All that has come before the dispatch that runs.
    base: Clock,
    /// The first turn of each dispatch.
    begins: Vec<usize>,
    last: Actor,
    last_waits: bool,
    cut: bool,
    has_waited: bool,
    too_long: bool,
    has_begun: bool,
}

impl Explorer {
    /// Begins the next run. `false`: no order is left.
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

    /// Begins a dispatch of the run, which is behind all that has run.
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

    /// Returns `true` if the run was ended, as it leads to the same as one before.
    #[must_use]
    pub fn is_cut(&self) -> bool {
        self.cut
    }

    /// Returns `true` if an invocation waited in a loop for others: it may have gone on, in orders that weren't tried.
    #[must_use]
    pub fn has_waited(&self) -> bool {
        self.has_waited
    }

    /// Returns `true` if a run had too many turns to explore its orders.
    #[must_use]
    pub fn is_too_long(&self) -> bool {
        self.too_long
    }

    /// Pairs of turns that were looked at, in all runs so far: what they cost.
    #[must_use]
    pub fn work(&self) -> u64 {
        self.work
    }

    /// The turns of each dispatch of the run.
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
        // All that doesn't commute with it and was before.
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

    /// Where a turn races with one before, wants an actor to go first there that leads to the other outcome.
    fn want_otherwise(&mut self, actor: Actor, step: &Step, before: &[u32]) {
        let mut racing: Vec<usize> = Vec::new();
        let mut dependent: Vec<usize> = Vec::new();
        for at in (0..self.taken.len()).rev() {
            let one = &self.taken[at];
            if one.actor == actor || one.step.commutes(step) || one.is_before(before) {
                continue;
            }
            // Nothing between both orders them.
            if !dependent.iter().any(|between| one.is_before(&self.taken[*between].clock)) {
                racing.push(at);
            }
            dependent.push(at);
        }
        for at in racing {
            let one = &self.taken[at];
            // All behind it that doesn't depend on it, and then this turn.
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
        // A store that has yet to take effect comes behind what its invocation has done.
        if actor.store > 0 {
            let unit = Actor { store: 0, ..actor };
            let clock = self.clocks.get(&unit).unwrap_or(&self.base).clone();
            self.clocks.insert(actor, clock);
        }
        let waits = std::mem::take(&mut self.last_waits) && actor == self.last;
        if waits { &mut self.waiting } else { &mut self.ready }.insert(actor, step);
    }

    fn next(&mut self) -> Option<Actor> {
        // What others don't see is no turn.
        if let Some(actor) =
            self.ready.iter().find(|(_, step)| !step.atomic).map(|(actor, _)| *actor)
        {
            self.ready.remove(&actor);
            self.last = actor;
            return Some(actor);
        }
        if self.ready.is_empty() {
            // Those that wait, wait for nobody: a loop may end by itself.
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
