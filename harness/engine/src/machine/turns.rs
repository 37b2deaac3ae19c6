//! The turns of invocations: atomics before which other invocations may run, and stores that take effect late.

use std::hash::{DefaultHasher, Hash, Hasher};

use naga::AtomicFunction;

use super::memory::{Buffer, changed_by, walk_lane};
use super::{Machine, Memory};
use crate::arithmetic::sealed::Rules;
use crate::code::{Code, Instruction, Op, Walk};
use crate::explore::{Access, Step, Word};
use crate::options::Elsewhere;

/// If an invocation repeats the same reads more than this number of times, it counts as waiting for another invocation.
/// After a word has changed, the count begins again.
const PATIENCE: u32 = 3;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Late {
    pub(crate) number: u32,
    lane: usize,
    slot: u32,
    at: usize,
    /// The function of an atomic such as `atomicAdd`. `None` for `atomicStore`, which replaces the word.
    function: Option<AtomicFunction>,
    signed: bool,
    word: u32,
    site: u32,
    /// The number of atomics that `dispatch` had recorded when the invocation reached the store.
    pub(crate) turn: usize,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Done {
    pub(crate) lane: usize,
    pub(crate) site: u32,
    /// The word that the atomic returned (then `reads` is `true`), or the word that the atomic wrote.
    pub(crate) word: u32,
    pub(crate) reads: bool,
    pub(crate) place: (u32, usize),
    /// For a store that took effect late: the store's number, and [`Late::turn`].
    pub(crate) late: Option<(u32, usize)>,
}

impl Walk {
    /// The kind of an atomic access. `writes` is `true` for an `atomicStore`, and `false` for an `atomicLoad`.
    pub(super) fn access(&self, writes: bool) -> Access {
        match self.atomic {
            Some(atomic) => Access::of(atomic.function, atomic.used),
            None if writes => Access::Changes,
            None => Access::Reads,
        }
    }
}

impl Code {
    /// Checks if an operation is an atomic access, including `atomicLoad` and `atomicStore`.
    pub(crate) fn is_atomic(&self, op: Op) -> bool {
        self.walk_of(op).is_some()
    }

    fn walk_of(&self, op: Op) -> Option<&Walk> {
        match op {
            Op::Load(_, walk) | Op::Write(_, walk) | Op::Atomic(walk) => {
                Some(&self.walks[walk as usize]).filter(|walk| !walk.plain)
            }
            _ => None,
        }
    }

    /// The function of an atomic whose result no operation uses, or `Some(None)` for `atomicStore`. An invocation can
    /// continue before such an atomic takes effect. `None` for all other operations.
    fn stored(&self, op: Op) -> Option<Option<AtomicFunction>> {
        let walk = self.walk_of(op)?;
        match (op, walk.atomic) {
            (Op::Write(..), _) => Some(None),
            (Op::Atomic(_), Some(atomic)) if !atomic.used => Some(Some(atomic.function)),
            _ => None,
        }
    }

    fn operands_of<'r>(&self, op: Op, walk: &Walk, registers: &'r [u32]) -> (&'r [u32], u32) {
        let shape = self.shape(op);
        let all = shape.outs.iter().chain(&shape.ins).sum::<u32>() as usize;
        let outs = shape.outs.iter().sum::<u32>() as usize;
        (&registers[all - walk.steps.len()..all], registers[outs.min(all - 1)])
    }
}

impl<A: Rules> Machine<'_, A> {
    fn here(&self) -> (&Instruction, &[u32]) {
        let instruction = &self.code.instructions[self.at];
        let start = instruction.at as usize;
        (instruction, &self.code.pool[start..start + instruction.count as usize])
    }

    /// For each lane that is active and isn't a helper: the lane, and the offset of the word that an atomic operation
    /// accesses. Indices outside of their array are clamped.
    fn places(&self, op: Op, registers: &[u32], memory: &Memory<'_, A>) -> Vec<(usize, usize)> {
        let Some(walk) = self.code.walk_of(op) else { return Vec::new() };
        let (indices, _) = self.code.operands_of(op, walk, registers);
        let length = memory.buffers[walk.buffer as usize].bytes.len();
        let mut all = Vec::new();
        for lane in (0..self.width).filter(|lane| self.acts(*lane)) {
            let clamped = Elsewhere::Clamped;
            walk_lane::<A>((walk, clamped), indices, &self.ints, lane, length, |at| {
                all.push((lane, at));
            });
        }
        all
    }

    fn waiting_at(&self, slot: u32, (lane, at): (usize, usize)) -> Option<&Late> {
        self.stores.iter().find(|one| (one.slot, one.lane, one.at) == (slot, lane, at))
    }

    /// Checks if the machine must stop before this atomic, so that other invocations can run.
    pub(super) fn pauses(&self, op: Op, registers: &[u32], memory: &Memory<'_, A>) -> bool {
        if !self.relaxes {
            return (0..self.width).any(|lane| self.acts(lane));
        }
        let Some(walk) = self.code.walk_of(op) else { return false };
        let places = self.places(op, registers, memory);
        let own = |place: &(usize, usize)| self.waiting_at(walk.buffer, *place);
        match self.code.stored(op) {
            Some(_) => places.iter().any(|place| own(place).is_some()),
            None => !places.is_empty(),
        }
    }

    /// Checks if the machine's next operation accesses a word that one of its own pending stores will change.
    pub(crate) fn is_blocked(&self, memory: &Memory<'_, A>) -> bool {
        let (instruction, registers) = self.here();
        let Some(walk) = self.code.walk_of(instruction.op) else { return false };
        // A load sees the pending stores of its own invocation, so they don't block it.
        let is_load = matches!(instruction.op, Op::Load(..));
        let blocks = |one: &Late| !is_load || one.function.is_some();
        let places = self.places(instruction.op, registers, memory);
        places.iter().any(|place| self.waiting_at(walk.buffer, *place).is_some_and(blocks))
    }

    /// The source position of the machine's next operation, and the first lane that runs it.
    pub(crate) fn place(&self) -> (naga::Span, usize) {
        let site = self.code.instructions[self.at].site;
        let lane = (0..self.width).find(|lane| self.acts(*lane)).unwrap_or_default();
        (self.code.sites[site as usize].span, lane)
    }

    pub(crate) fn next_step(&self, memory: &Memory<'_, A>, group: u32) -> Step {
        let (instruction, registers) = self.here();
        let Some(walk) = self.code.walk_of(instruction.op) else { return Step::default() };
        let access = walk.access(!matches!(instruction.op, Op::Load(..)));
        let places = self.places(instruction.op, registers, memory);
        let touches = places.iter().map(|(_, at)| (self.word_of(walk.buffer, *at, group), access));
        Step::atomic(touches.collect())
    }

    pub(crate) fn step_of_store(&self, number: u32, group: u32) -> Step {
        let store = self.stores.iter().find(|store| store.number == number);
        let touches = store.iter().map(|store| {
            let access = store.function.map_or(Access::Changes, |own| Access::of(own, false));
            (self.word_of(store.slot, store.at, group), access)
        });
        Step::atomic(touches.collect())
    }

    fn word_of(&self, slot: u32, at: usize, group: u32) -> Word {
        let own = self.code.buffers[slot as usize].binding == crate::code::Binding::Workgroup;
        (slot, if own { group + 1 } else { 0 }, at as u32)
    }

    /// Delays the stores of an atomic operation. If the operation isn't a store, or if the schedule lets stores take
    /// effect at once, delays nothing and returns `false`.
    pub(super) fn postpones(&mut self, op: Op, registers: &[u32], memory: &Memory<'_, A>) -> bool {
        let (true, Some(function)) = (self.relaxes, self.code.stored(op)) else { return false };
        let Some(walk) = self.code.walk_of(op) else { return false };
        let (_, value) = self.code.operands_of(op, walk, registers);
        let signed = matches!(op, Op::Write(crate::Scalar::I32, _))
            || walk.atomic.is_some_and(|atomic| atomic.scalar.signed());
        for (lane, at) in self.places(op, registers, memory) {
            self.numbered += 1;
            let word = A::int_word(self.ints.get(value)[lane]);
            let (number, site, slot) = (self.numbered, self.site, walk.buffer);
            // The atomics of this turn come first.
            let turn = self.turn + self.done.len();
            self.stores.push(Late { number, lane, slot, at, function, signed, word, site, turn });
            self.issued.push(number);
        }
        true
    }

    /// Makes a load return the value of a pending store of its own invocation.
    pub(super) fn forward(&mut self, op: Op, registers: &[u32], memory: &Memory<'_, A>) {
        let Op::Load(scalar, walk) = op else { return };
        let slot = self.code.walks[walk as usize].buffer;
        for place in self.places(op, registers, memory) {
            if let Some(word) = self.waiting_at(slot, place).map(|one| one.word) {
                self.ints.get_mut(registers[0])[place.0] = A::int(word, scalar.signed());
            }
        }
    }

    pub(crate) fn settle(&mut self, number: u32, memory: &mut Memory<'_, A>) -> Option<Done> {
        let at = self.stores.iter().position(|store| store.number == number)?;
        let Late { lane, slot, at, function, signed, word, site, turn, .. } =
            self.stores.remove(at);
        let buffer: &mut Buffer<'_, A> = &mut memory.buffers[slot as usize];
        let new = match function {
            Some(function) => changed_by(function, buffer.word(at), word, signed),
            None => word,
        };
        buffer.put(at, &new.to_le_bytes());
        let late = Some((number, turn));
        Some(Done { lane, site, word: new, reads: false, place: (slot, at), late })
    }

    /// Records an atomic that has taken effect. Sets `waits` if the machine seems to wait in a loop until another
    /// invocation changes the word.
    pub(super) fn note_turn(
        &mut self,
        op: Op,
        registers: &[u32],
        memory: &Memory<'_, A>,
        before: &[u32],
    ) {
        let Some(walk) = self.code.walk_of(op) else { return };
        let places = self.places(op, registers, memory);
        let buffer = &memory.buffers[walk.buffer as usize];
        let reads = self.code.stored(op).is_none();
        let mut hasher = DefaultHasher::new();
        self.site.hash(&mut hasher);
        let mut changes = false;
        for ((lane, at), before) in places.iter().zip(before) {
            let now = buffer.word(*at);
            changes |= now != *before;
            let word = if reads { A::int_word(self.ints.get(registers[0])[*lane]) } else { now };
            (lane, at, word).hash(&mut hasher);
            let (lane, site, place) = (*lane, self.site, (walk.buffer, *at));
            self.done.push(Done { lane, site, word, reads, place, late: None });
        }
        if changes {
            self.seen.clear();
            return;
        }
        let seen = self.seen.entry(hasher.finish()).or_default();
        *seen += 1;
        self.waits |= reads && *seen > PATIENCE;
    }

    pub(super) fn words_at(&self, op: Op, registers: &[u32], memory: &Memory<'_, A>) -> Vec<u32> {
        let Some(walk) = self.code.walk_of(op) else { return Vec::new() };
        let buffer = &memory.buffers[walk.buffer as usize];
        let places = self.places(op, registers, memory);
        places.iter().map(|(_, at)| buffer.word(*at)).collect()
    }
}
