//! Runs a program for a chunk of lanes, one operation after another.

mod control;
mod helpers;
mod images;
mod lanes;
mod masks;
mod memory;
mod subgroups;
mod turns;
mod worlds;
mod wrap;

use std::collections::HashMap;

use naga::Span;

use crate::accuracy::Accuracy;
use crate::arithmetic::sealed::Rules;
use crate::code::{Code, Count, ImageKind, Instruction, Neighbour, Op, Site};
use crate::columns::Columns;
use karat_core::hazard::Kind;

use crate::coverage::count;
use crate::observer::{Here, Lanes, Missing, Observer, Wrong};
use crate::options::{Elsewhere, Options};
use crate::races::{Beyond, Bounds, Detector};
use crate::rules::{Edges, FloatRule, Half, ToInt};
use crate::scalar::{File, Scalar};
use masks::Masks;
pub(crate) use memory::{Buffer, Memory};
pub(crate) use turns::Done;
use turns::Late;
use worlds::Worlds;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Spent {
    pub(crate) span: Span,
    pub(crate) lane: usize,
    pub(crate) by: Limit,
    /// The number of iterations of the open loop that has run the most iterations.
    pub(crate) own: u64,
}

#[derive(Clone, Copy, Debug)]
pub(crate) enum Limit {
    Fuel,
    Work,
    Deadline,
}

impl Spent {
    pub(crate) fn stop(self, case: usize, options: &Options) -> crate::Stop {
        let span = self.span;
        match self.by {
            Limit::Deadline => crate::Stop::Late { span, case },
            Limit::Fuel => crate::Stop::Fuel { span, case, rounds: options.fuel, own: self.own },
            Limit::Work => crate::Stop::Work { span, rounds: options.work },
        }
    }
}

pub(crate) struct Machine<'p, A: Rules> {
    code: &'p Code,
    options: &'p Options,
    pub(crate) floats: Columns<A::Float>,
    pub(crate) ints: Columns<A::Int>,
    pub(crate) bools: Columns<A::Bool>,
    /// The masks for arithmetics in which all conditions are decided.
    masks: Masks<A>,
    /// The masks for arithmetics in which conditions may be undecided.
    worlds: Worlds<'p, A>,
    /// The number of loop iterations that each lane may still run.
    fuel: Vec<u64>,
    /// The number of loop iterations that all lanes together may still run.
    pub(crate) work: u64,
    /// The number of loop iterations that the machine has run, to decide when it reads the clock.
    rounds: u64,
    /// For each lane, the number of further iterations for which the exit of a loop may stay undecided.
    undecided: Vec<u64>,
    /// For each lane, the site at which the lane's results became unbounded: a loop whose exit stayed undecided, or an
    /// operation whose index was outside of its array.
    lost: Vec<Option<u32>>,
    /// The lanes in which the current operation's index is outside of its array.
    strayed: Vec<usize>,
    /// The lanes that were removed because they ran too many iterations, each with its loop.
    pub(crate) long: Vec<(usize, Span)>,
    /// The number of iterations of each open loop, the outermost loop first.
    open: Vec<u64>,
    /// The value that an index would have without wrapping, in the first lane in which it wraps around.
    meant: i64,
    at: usize,
    site: u32,
    width: usize,
    /// The elements that the lanes of a load access, for the detector. Loads reuse this list to save allocations.
    places: Vec<(usize, bool)>,
    /// For each lane, the site at which the lane last became inactive. The reports about missed barriers and
    /// derivatives contain this site.
    parted: Vec<Option<u32>>,
    /// In a draw, the helper lanes, whose effects are invisible. Otherwise empty.
    helpers: Vec<bool>,
    /// The detector of races between invocations, if the caller asked for it.
    pub(crate) detector: Option<Box<Detector>>,
    /// `true` if the machine stops before each atomic, and not only at barriers. `paused` is `true` while the machine
    /// is stopped before an atomic.
    pub(crate) yields: bool,
    paused: bool,
    /// `true` if the machine delays atomic stores: it continues, and the store takes effect later.
    pub(crate) relaxes: bool,
    pub(crate) stores: Vec<Late>,
    /// The newly delayed stores, by number. `dispatch` empties this list. `numbered` counts all stores that were
    /// delayed.
    pub(crate) issued: Vec<u32>,
    numbered: u32,
    pub(crate) turn: usize,
    pub(crate) done: Vec<Done>,
    /// The number of times that each atomic ran with the same words since the machine last changed a word. The key is
    /// a hash of the atomic and its words.
    seen: HashMap<u64, u32>,
    /// `true` if the machine waits: it runs a loop until another invocation changes the word that the loop reads.
    pub(crate) waits: bool,
}

/// The reasons why a machine stops.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Pause {
    /// The next operation is an atomic, and the machine is set to stop before atomics.
    Atomic,
    /// The machine is at the barrier with this site.
    Barrier(u32),
    End,
}

impl<'p, A: Rules> Machine<'p, A> {
    pub(crate) fn new(code: &'p Code, options: &'p Options, width: usize) -> Self {
        let [floats, ints, bools] = code.registers.map(|count| count as usize);
        let mut machine = Self {
            code,
            options,
            floats: Columns::new(floats, width),
            ints: Columns::new(ints, width),
            bools: Columns::new(bools, width),
            masks: Masks::new(if A::UNDECIDED { 0 } else { width }),
            worlds: Worlds::new(code, if A::UNDECIDED { width } else { 0 }),
            fuel: vec![0; width],
            work: options.work,
            rounds: 0,
            undecided: vec![0; width],
            lost: vec![None; width],
            long: Vec::new(),
            strayed: Vec::new(),
            open: Vec::new(),
            meant: 0,
            at: 0,
            site: 0,
            width,
            parted: vec![None; width],
            helpers: Vec::new(),
            detector: None,
            places: Vec::new(),
            yields: false,
            paused: false,
            relaxes: false,
            stores: Vec::new(),
            issued: Vec::new(),
            numbered: 0,
            turn: 0,
            done: Vec::new(),
            seen: HashMap::new(),
            waits: false,
        };
        for &(register, constant) in &code.constants {
            let index = register.index;
            match register.file {
                File::Float => {
                    let x = f32::from_bits(constant.word);
                    let half = constant.scalar == Scalar::F16;
                    let x = if options.decimals { A::decimal(x, half) } else { A::float(x) };
                    machine.floats.get_mut(index).fill(x);
                }
                File::Int => {
                    let x = A::int(constant.word, constant.scalar.signed());
                    machine.ints.get_mut(index).fill(x);
                }
                File::Bool => machine.bools.get_mut(index).fill(A::bool(constant.word != 0)),
            }
        }
        machine
    }

    fn argument(scalar: Scalar, word: u32) -> A::Float {
        match scalar {
            Scalar::F16 => {
                let float = A::float(half::f16::from_bits(word as u16).to_f32());
                A::to_half(float, Half::Rounded)
            }
            _ => A::float(f32::from_bits(word)),
        }
    }

    /// Widens the intervals of a register, so that they also contain the values of `words`.
    pub(crate) fn widen(
        &mut self,
        register: u32,
        scalar: Scalar,
        words: impl Iterator<Item = u32>,
    ) {
        let both = A::undecided();
        match scalar {
            Scalar::F32 | Scalar::F16 => {
                for (x, word) in self.floats.get_mut(register).iter_mut().zip(words) {
                    *x = A::select_float(both, *x, Self::argument(scalar, word));
                }
            }
            Scalar::I32 | Scalar::U32 => {
                for (x, word) in self.ints.get_mut(register).iter_mut().zip(words) {
                    *x = A::select_int(both, *x, A::int(word, scalar.signed()));
                }
            }
            Scalar::Bool => {
                for (x, word) in self.bools.get_mut(register).iter_mut().zip(words) {
                    *x = A::select_bool(both, *x, A::bool(word != 0));
                }
            }
        }
    }

    /// Sets one scalar of a parameter in the lanes for which `words` has a word.
    pub(crate) fn set(&mut self, register: u32, scalar: Scalar, words: impl Iterator<Item = u32>) {
        match scalar {
            Scalar::F32 | Scalar::F16 => {
                for (x, word) in self.floats.get_mut(register).iter_mut().zip(words) {
                    *x = Self::argument(scalar, word);
                }
            }
            Scalar::I32 | Scalar::U32 => {
                for (x, word) in self.ints.get_mut(register).iter_mut().zip(words) {
                    *x = A::int(word, scalar.signed());
                }
            }
            Scalar::Bool => {
                for (x, word) in self.bools.get_mut(register).iter_mut().zip(words) {
                    *x = A::bool(word != 0);
                }
            }
        }
    }

    /// Runs an operation, and narrows its result to the measured bounds.
    fn run_measured(&mut self, accuracy: &Accuracy, rule: FloatRule, registers: &[u32]) {
        let (outs, ins) = registers.split_at(rule.arity().1);
        // The arguments are copied, because the result may overwrite one of them.
        let columns: Vec<Box<[A::Float]>> =
            ins.iter().map(|x| self.floats.get(*x).into()).collect();
        rule.run::<A>(&mut self.floats, registers);
        let mut x: Vec<A::Float> = Vec::with_capacity(columns.len());
        for (lane, y) in self.floats.get_mut(outs[0]).iter_mut().enumerate() {
            x.clear();
            x.extend(columns.iter().map(|column| column[lane]));
            *y = A::narrow(&|x, y| accuracy.narrow(rule, x, y), &x, *y);
        }
    }

    /// Runs the whole program for the first `active` lanes. `case` is the case of the first lane.
    pub(crate) fn run<const SEEN: bool>(
        &mut self,
        active: usize,
        case: usize,
        memory: &mut Memory<'_, A>,
        observer: &dyn Observer<A>,
    ) -> Result<(), Spent>
    where
        A: crate::arithmetic::Arithmetic,
    {
        self.start(active);
        while self.resume::<SEEN>(case, memory, observer)? != Pause::End {}
        Ok(())
    }

    /// Prepares to run the program for the first `active` lanes.
    pub(crate) fn start(&mut self, active: usize) {
        self.at = 0;
        self.open.clear();
        self.long.clear();
        self.parted.fill(None);
        self.helpers.clear();
        (self.paused, self.waits, self.numbered) = (false, false, 0);
        self.seen.clear();
        if A::UNDECIDED {
            self.worlds.start(active);
        } else {
            self.masks.start(active);
        }
        self.fuel.fill(self.options.fuel);
        self.undecided.fill(self.options.undecided);
        self.lost.fill(None);
    }

    /// Runs to the next stop, or to the end. `case` is the case of the first lane.
    pub(crate) fn resume<const SEEN: bool>(
        &mut self,
        case: usize,
        memory: &mut Memory<'_, A>,
        observer: &dyn Observer<A>,
    ) -> Result<Pause, Spent>
    where
        A: crate::arithmetic::Arithmetic,
    {
        let code = self.code;
        let mut at = self.at;
        let keeps_parting = self.detector.is_some() || SEEN && code.has_neighbours();
        if let (0, Some(counts)) = (at, &self.options.counts) {
            counts.come::<A>(0, case, &self.acting());
        }
        let mut has_turn = std::mem::take(&mut self.paused);
        loop {
            let instruction = &code.instructions[at];
            at += 1;
            self.site = instruction.site;
            let start = instruction.at as usize;
            let registers = &code.pool[start..start + instruction.count as usize];
            let mut before = None;
            if self.yields && code.is_atomic(instruction.op) {
                if !std::mem::take(&mut has_turn) && self.pauses(instruction.op, registers, memory)
                {
                    (self.at, self.paused) = (at - 1, true);
                    return Ok(Pause::Atomic);
                }
                before = Some(self.words_at(instruction.op, registers, memory));
            }
            if SEEN && !instruction.op.is_an_end() {
                let site = self.site(instruction);
                observer.reached(&Here { site, case, lanes: &|| self.acting() });
            }
            match instruction.op {
                Op::Float(rule) => {
                    if SEEN {
                        self.report_order(observer, instruction, case, rule, registers);
                    }
                    let (_, outs) = rule.arity();
                    self.flushing(registers, outs, |machine| {
                        match machine.options.accuracy.as_deref() {
                            Some(accuracy) if A::UNDECIDED && Accuracy::knows(rule) => {
                                machine.run_measured(accuracy, rule, registers);
                            }
                            _ => rule.run::<A>(&mut machine.floats, registers),
                        }
                    });
                    self.note_unbounded(instruction, registers, rule.arity());
                    if SEEN {
                        let (ins, outs) = rule.arity();
                        let (outs, operands) = registers.split_at(outs);
                        self.show(observer, at, case, (outs, &operands[..ins]));
                    }
                }
                Op::Integer(rule) => {
                    if SEEN && rule.divides() {
                        let (zero, divisor) = (A::int(0, false), self.ints.get(registers[2]));
                        self.report_where(observer, instruction, case, Kind::ByZero, |lane| {
                            A::possible(A::int_equal(divisor[lane], zero))
                        });
                    }
                    rule.run::<A>(&mut self.ints, registers);
                    let shown = (File::Int, registers[0], &[][..]);
                    self.show_other::<SEEN>(observer, instruction, case, shown);
                }
                Op::ToInt(rule) => {
                    if SEEN {
                        self.report_conversion(observer, instruction, case, rule, registers);
                    }
                    rule.run::<A>(&self.floats, &mut self.ints, registers);
                    let shown = (File::Int, registers[0], &registers[1..]);
                    self.show_other::<SEEN>(observer, instruction, case, shown);
                }
                Op::FromInt(rule) => {
                    rule.run::<A>(&mut self.floats, &self.ints, registers);
                    self.note_unbounded(instruction, &registers[..rule.arity()], (0, rule.arity()));
                    if SEEN {
                        self.show(observer, at, case, (&registers[..rule.arity()], &[]));
                    }
                }
                Op::Scale(rule) => {
                    self.flushing(&registers[..2], 1, |machine| {
                        rule.run::<A>(&mut machine.floats, &machine.ints, registers);
                    });
                    self.note_unbounded(instruction, &registers[..2], (1, 1));
                    if SEEN {
                        self.show(observer, at, case, (&registers[..1], &[]));
                    }
                }
                Op::ToHalf(half) => {
                    self.floats.map::<1, 1>(registers, |[x]| [A::to_half(x, half)]);
                    self.note_unbounded(instruction, &registers[..2], (1, 1));
                    if SEEN && half == Half::Converted {
                        self.show(observer, at, case, (&registers[..1], &registers[1..2]));
                    }
                }
                Op::Neighbour(neighbour) => {
                    if SEEN {
                        self.report_missing(observer, instruction, case, neighbour);
                    }
                    self.floats.write(registers[0], |floats, out| {
                        let of = floats.get(registers[1]);
                        for (lane, out) in out.iter_mut().enumerate() {
                            *out = of[neighbour.of(lane)];
                        }
                    });
                }
                Op::CompareFloat(_)
                | Op::CompareInt(..)
                | Op::And
                | Op::Or
                | Op::Not
                | Op::Differ
                | Op::IsNan
                | Op::IsInf => {
                    self.decide(instruction.op, registers);
                    let of_floats = matches!(instruction.op, Op::CompareFloat(_) | Op::IsNan);
                    let operands = if of_floats { &registers[1..] } else { &[] };
                    let shown = (File::Bool, registers[0], operands);
                    self.show_other::<SEEN>(observer, instruction, case, shown);
                }
                Op::Select(file) => {
                    if let Some(counts) = &self.options.counts {
                        let condition = self.bools.get(registers[registers.len() - 1]);
                        counts.select::<A>(at - 1, condition, &self.acting());
                    }
                    self.select(file, registers);
                    self.show_other::<SEEN>(observer, instruction, case, (file, registers[0], &[]));
                }
                Op::Move(File::Float) => self.floats.copy(registers[0], registers[1]),
                Op::Move(File::Int) => self.ints.copy(registers[0], registers[1]),
                Op::Move(File::Bool) => self.bools.copy(registers[0], registers[1]),
                Op::Store(file) => self.store(file, registers),
                Op::Gather(file, walk) => {
                    self.gather(file, walk, registers);
                    self.estrange(instruction, registers);
                    self.report::<SEEN>(observer, (instruction, registers), case, memory);
                }
                Op::Scatter(file, walk) => {
                    self.scatter(file, walk, registers);
                    self.report::<SEEN>(observer, (instruction, registers), case, memory);
                }
                Op::Pick(file, count, signed) => {
                    self.pick(file, count, signed, registers);
                    self.estrange(instruction, registers);
                    self.report::<SEEN>(observer, (instruction, registers), case, memory);
                }
                Op::Table(file, table) => {
                    self.table(file, table, registers);
                    self.estrange(instruction, registers);
                    self.report::<SEEN>(observer, (instruction, registers), case, memory);
                }
                Op::Load(scalar, walk) => {
                    self.load(scalar, walk, registers, memory);
                    if !self.stores.is_empty() {
                        self.forward(instruction.op, registers, memory);
                    }
                    self.estrange(instruction, registers);
                    if A::NOTES && scalar.file() == File::Float {
                        self.note_unbounded(instruction, &registers[..1], (0, 1));
                    }
                    self.report::<SEEN>(observer, (instruction, registers), case, memory);
                    if !code.walks[walk as usize].plain {
                        let shown = (scalar.file(), registers[0], &[][..]);
                        self.show_other::<SEEN>(observer, instruction, case, shown);
                    }
                }
                Op::Write(scalar, walk) => {
                    if self.postpones(instruction.op, registers, memory) {
                        before = None;
                    } else {
                        self.write(scalar, walk, registers, memory);
                    }
                    self.report::<SEEN>(observer, (instruction, registers), case, memory);
                }
                Op::ArrayLength(walk) => self.array_length(walk, registers[0], memory),
                Op::Atomic(walk) => {
                    if self.postpones(instruction.op, registers, memory) {
                        before = None;
                    } else {
                        self.atomic(walk, registers, memory);
                    }
                    if code.walks[walk as usize].atomic.is_some_and(|atomic| atomic.result) {
                        let shown = (File::Int, registers[0], &[][..]);
                        self.show_other::<SEEN>(observer, instruction, case, shown);
                    }
                    self.report::<SEEN>(observer, (instruction, registers), case, memory);
                }
                Op::Subgroup(operation) => {
                    self.subgroup(operation, registers);
                    self.estrange(instruction, registers);
                    let [floats, ints, _] = code.shape(instruction.op).outs;
                    if floats > 0 {
                        self.flushing(&registers[..1], 1, |_| {});
                        self.note_unbounded(instruction, &registers[..1], (0, 1));
                        if SEEN {
                            self.show(observer, at, case, (&registers[..1], &[]));
                        }
                    } else {
                        let file = if ints > 0 { File::Int } else { File::Bool };
                        let shown = (file, registers[0], &[][..]);
                        self.show_other::<SEEN>(observer, instruction, case, shown);
                    }
                    self.report::<SEEN>(observer, (instruction, registers), case, memory);
                }
                Op::ImageStore(image) => {
                    self.image_store(image, registers, memory);
                    self.report::<SEEN>(observer, (instruction, registers), case, memory);
                }
                Op::Image(image) => {
                    self.image(image, registers, memory);
                    // In a sample, the last layer replaces a layer that doesn't exist.
                    if !matches!(code.images[image as usize].kind, ImageKind::Sample { .. }) {
                        self.estrange(instruction, registers);
                    }
                    let shape = code.shape(instruction.op);
                    let [floats, from] = [shape.outs[0], shape.ins[0]].map(|n| n as usize);
                    if floats > 0 {
                        self.note_unbounded(
                            instruction,
                            &registers[..floats + from],
                            (from, floats),
                        );
                        if SEEN {
                            self.show(observer, at, case, (&registers[..floats], &[]));
                        }
                    }
                    self.report::<SEEN>(observer, (instruction, registers), case, memory);
                }
                Op::Wrap(wrap) => {
                    let is_index = code.wraps[wrap as usize].step.is_some();
                    if SEEN || is_index && self.detector.is_some() {
                        self.wrapped(wrap, registers, memory);
                        self.report::<SEEN>(observer, (instruction, registers), case, memory);
                    }
                }
                Op::Round => {
                    self.round(instruction)?;
                    if let (Some(counts), Some(round)) = (&self.options.counts, self.open.last()) {
                        counts.round::<A>(at - 1, *round, &self.acting());
                    }
                }
                Op::If
                | Op::Else
                | Op::EndIf
                | Op::Switch
                | Op::Case(_)
                | Op::EndSwitch
                | Op::Loop
                | Op::Continuing
                | Op::BreakIf
                | Op::EndLoop
                | Op::Skip
                | Op::Call
                | Op::EndCall
                | Op::Break(_)
                | Op::Continue(_)
                | Op::Return(_) => {
                    let before = keeps_parting.then(|| self.active().to_vec());
                    let came = self.counted(instruction.op);
                    let jumps = self.control(instruction.op, registers);
                    if let Some(came) = came {
                        self.count(
                            came,
                            (instruction.op, at),
                            case,
                            jumps.then_some(instruction.target),
                        );
                    }
                    if jumps {
                        at = instruction.target as usize;
                    }
                    match instruction.op {
                        Op::Loop => self.open.push(0),
                        Op::EndLoop if !jumps => drop(self.open.pop()),
                        _ => {}
                    }
                    if let Some(before) = before {
                        self.note_parting(&before);
                    }
                }
                Op::Mark(mark) => {
                    if SEEN {
                        let [floats, ints, bools] = code.marks[mark as usize].map(|n| n as usize);
                        let float = registers[..floats].iter().map(|&r| self.floats.get(r));
                        let int = registers[floats..floats + ints].iter();
                        let bool = registers[floats + ints..floats + ints + bools].iter();
                        observer.named(&Lanes {
                            site: &code.sites[instruction.site as usize],
                            case,
                            floats: &float.collect::<Vec<_>>(),
                            operands: &[],
                            ints: &int.map(|&r| self.ints.get(r)).collect::<Vec<_>>(),
                            bools: &bool.map(|&r| self.bools.get(r)).collect::<Vec<_>>(),
                            active: &self.acting(),
                        });
                    }
                }
                Op::Discard => {
                    self.discard();
                    self.count(0, (instruction.op, at), case, None);
                }
                Op::Barrier(barrier) => {
                    if let Some(mut detector) = self.detector.take() {
                        let active = self.active().iter().map(|mask| A::possible(*mask));
                        detector.barrier(code, instruction.site, barrier, (&self.parted, active));
                        self.detector = Some(detector);
                    }
                    self.at = at;
                    return Ok(Pause::Barrier(instruction.site));
                }
                Op::Halt => break,
            }
            if let Some(before) = before {
                self.note_turn(instruction.op, registers, memory, &before);
            }
        }
        self.forget_lost();
        Ok(Pause::End)
    }

    /// The number of lanes that reach an `if`, or 0 for another operation. `None` if the options don't ask for counts.
    #[inline]
    fn counted(&self, op: Op) -> Option<u64> {
        self.options.counts.as_ref()?;
        Some(if op == Op::If { count::<A>(&self.acting()) } else { 0 })
    }

    /// Counts the lanes that are active after an operation. `came` is the number of lanes that reached the operation.
    fn count(&self, came: u64, (op, next): (Op, usize), case: usize, target: Option<u32>) {
        let Some(counts) = &self.options.counts else { return };
        let lanes = self.acting();
        let stay = count::<A>(&lanes);
        match op {
            Op::If => {
                counts.take(next - 1, 0, stay);
                counts.take(next - 1, 1, came.saturating_sub(stay));
            }
            Op::Case(_) => counts.take(next - 1, 0, stay),
            _ => {}
        }
        counts.come::<A>(target.map_or(next, |target| target as usize), case, &lanes);
    }

    /// For each lane that was active before and isn't active any more, notes the site where the lane became inactive.
    fn note_parting(&mut self, before: &[A::Bool]) {
        let now = if A::UNDECIDED { self.worlds.active() } else { self.masks.active() };
        for (parted, (before, now)) in self.parted.iter_mut().zip(before.iter().zip(now)) {
            if A::possible(*before) && !A::possible(*now) {
                *parted = Some(self.site);
            }
        }
    }

    #[inline]
    fn active(&self) -> &[A::Bool] {
        if A::UNDECIDED { self.worlds.active() } else { self.masks.active() }
    }

    /// Runs an operation on floats, and flushes its subnormal operands and results if the options ask for it. WGSL
    /// says: "Any inputs or outputs of operations listed in 15.7.4 Floating Point Accuracy may be flushed to zero", and
    /// "other operations are required to preserve subnormal numbers" (15.7.2). So values that are only loaded, stored,
    /// selected, swizzled, passed, returned or reinterpreted keep their bits.
    fn flushing(&mut self, registers: &[u32], outs: usize, run: impl FnOnce(&mut Self)) {
        if !self.options.flush {
            return run(self);
        }
        let (results, operands) = registers.split_at(outs);
        let mut kept: Vec<(u32, Box<[A::Float]>)> = Vec::new();
        for &operand in operands {
            if kept.iter().all(|(own, _)| *own != operand) {
                kept.push((operand, self.floats.get(operand).into()));
                self.flush(operand);
            }
        }
        run(self);
        for (operand, values) in kept {
            if !results.contains(&operand) {
                self.floats.get_mut(operand).copy_from_slice(&values);
            }
        }
        results.iter().for_each(|out| self.flush(*out));
    }

    fn flush(&mut self, register: u32) {
        self.floats.get_mut(register).iter_mut().for_each(|x| *x = A::flush(*x));
    }

    #[inline]
    fn note_unbounded(
        &mut self,
        instruction: &Instruction,
        registers: &[u32],
        arity: (usize, usize),
    ) {
        let (ins, outs) = arity;
        if A::NOTES {
            // A result never has the register of an argument, because `allocate` gives them different registers.
            let (results, args) = registers.split_at(outs);
            for (&out, lane) in
                results.iter().flat_map(|out| (0..self.width).map(move |k| (out, k)))
            {
                let x = self.floats.get(out)[lane];
                if A::is_unknown(x) {
                    let mut causes = args[..ins].iter().map(|&arg| self.floats.get(arg)[lane]);
                    let noted = A::note(x, &mut causes, instruction.site);
                    self.floats.get_mut(out)[lane] = noted;
                }
            }
        }
    }

    /// Shows the observer the floats that the instruction before `next` computed. If the following operations round
    /// these floats to half precision, shows the rounded floats.
    fn show(
        &self,
        observer: &dyn Observer<A>,
        next: usize,
        case: usize,
        (outs, operands): (&[u32], &[u32]),
    ) where
        A: crate::arithmetic::Arithmetic,
    {
        let (instruction, following) =
            (&self.code.instructions[next - 1], &self.code.instructions[next..]);
        let rounded = |out: &u32| {
            let half = following.iter().take(outs.len()).find_map(|one| match one.op {
                Op::ToHalf(half) if half.is_of_a_result() => {
                    (self.code.pool[one.at as usize + 1] == *out).then_some(half)
                }
                _ => None,
            })?;
            Some(self.floats.get(*out).iter().map(|x| A::to_half(*x, half)).collect::<Vec<_>>())
        };
        let rounded: Vec<Option<Vec<A::Float>>> = outs.iter().map(rounded).collect();
        let floats: Vec<&[A::Float]> = outs
            .iter()
            .zip(&rounded)
            .map(|(out, rounded)| rounded.as_deref().unwrap_or_else(|| self.floats.get(*out)))
            .collect();
        let operands: Vec<&[A::Float]> =
            operands.iter().map(|&register| self.floats.get(register)).collect();
        observer.floats(&Lanes {
            site: self.site(instruction),
            case,
            floats: &floats,
            operands: &operands,
            ints: &[],
            bools: &[],
            active: &self.acting(),
        });
    }

    /// Shows the observer an integer, a boolean or a selected float, with the floats from which it is computed.
    #[inline]
    fn show_other<const SEEN: bool>(
        &self,
        observer: &dyn Observer<A>,
        instruction: &Instruction,
        case: usize,
        (file, register, operands): (File, u32, &[u32]),
    ) where
        A: crate::arithmetic::Arithmetic,
    {
        if !SEEN {
            return;
        }
        let operands: Vec<&[A::Float]> =
            operands.iter().map(|&register| self.floats.get(register)).collect();
        let floats = (file == File::Float).then(|| self.floats.get(register));
        let ints = (file == File::Int).then(|| self.ints.get(register));
        let bools = (file == File::Bool).then(|| self.bools.get(register));
        observer.others(&Lanes {
            site: self.site(instruction),
            case,
            floats: floats.as_slice(),
            operands: &operands,
            ints: ints.as_slice(),
            bools: bools.as_slice(),
            active: &self.acting(),
        });
    }

    fn decide(&mut self, op: Op, registers: &[u32]) {
        match op {
            Op::CompareFloat(compare) => self.flushing(&registers[1..], 0, |machine| {
                machine.compare_floats(compare, registers);
            }),
            Op::CompareInt(compare, signed) => self.compare_ints(compare, signed, registers),
            Op::And => self.bools.map::<2, 1>(registers, |[a, b]| [A::and(a, b)]),
            Op::Or => self.bools.map::<2, 1>(registers, |[a, b]| [A::or(a, b)]),
            Op::Not => self.bools.map::<1, 1>(registers, |[a]| [A::not(a)]),
            Op::Differ => self.bools.map::<2, 1>(registers, |[a, b]| {
                [A::or(A::and(a, A::not(b)), A::and(A::not(a), b))]
            }),
            Op::IsNan => {
                let x = self.floats.get(registers[1]);
                for (out, &x) in self.bools.get_mut(registers[0]).iter_mut().zip(x) {
                    *out = A::not(A::float_equal(x, x));
                }
            }
            _ => {
                let x = self.floats.get(registers[1]);
                let infinities = [f32::INFINITY, f32::NEG_INFINITY].map(A::float);
                for (out, &x) in self.bools.get_mut(registers[0]).iter_mut().zip(x) {
                    let [a, b] = infinities.map(|infinity| A::float_equal(x, infinity));
                    *out = A::or(a, b);
                }
            }
        }
    }

    fn site(&self, instruction: &Instruction) -> &'p Site {
        &self.code.sites[instruction.site as usize]
    }

    #[inline]
    fn report<const SEEN: bool>(
        &mut self,
        observer: &dyn Observer<A>,
        (instruction, registers): (&Instruction, &[u32]),
        case: usize,
        memory: &Memory<'_, A>,
    ) where
        A: crate::arithmetic::Arithmetic,
    {
        if SEEN {
            let site = self.site(instruction);
            let kind = match instruction.op {
                Op::Wrap(wrap) if self.code.wraps[wrap as usize].step.is_none() => Kind::BelowZero,
                Op::Wrap(_) => Kind::Wrapped,
                _ => Kind::OutOfRange,
            };
            for &lane in &self.strayed {
                let case = case + lane;
                observer.wrong(&Wrong { kind, site, case, missing: None });
            }
        }
        let is_float =
            |op| matches!(op, Op::Wrap(wrap) if self.code.wraps[wrap as usize].step.is_none());
        if self.detector.is_some()
            && !self.defines_outside(instruction.op)
            && !is_float(instruction.op)
        {
            let lanes = self.active().iter().filter(|mask| A::possible(**mask)).count();
            let writes = matches!(instruction.op, Op::Write(..) | Op::Atomic(_) | Op::Scatter(..));
            let bounds = self.bounds(instruction.op);
            let first = self.strayed.first();
            let index = first.and_then(|lane| self.beyond(instruction, registers, *lane, memory));
            let (variable, nested) = self.array_of(instruction.op);
            let beyond = Beyond { writes, bounds, variable, nested, index };
            let Some(detector) = &mut self.detector else { return };
            detector.run(self.site, lanes);
            for lane in &self.strayed {
                detector.leaves(self.code, self.site, *lane, beyond);
            }
        }
        self.strayed.clear();
    }

    /// The kind of bounds that an operation checks. A fixed-size array inside a runtime-sized array counts as fixed.
    fn bounds(&self, op: Op) -> Bounds {
        let is_runtime = |walk: u32| {
            let steps = &self.code.walks[walk as usize].steps;
            !steps.is_empty()
                && steps.iter().all(|step| matches!(step.count, Count::Runtime { .. }))
        };
        match op {
            Op::Subgroup(_) => Bounds::Subgroup,
            Op::Wrap(_) => Bounds::Wrapped,
            Op::Image(_) => Bounds::Texture,
            Op::Load(_, walk) | Op::Write(_, walk) | Op::Atomic(walk) if is_runtime(walk) => {
                Bounds::Runtime
            }
            _ => Bounds::Fixed,
        }
    }

    /// Checks if WGSL defines the effect of a texture operation whose index is too large: a store writes nothing, and
    /// sampling uses the nearest layer.
    fn defines_outside(&self, op: Op) -> bool {
        match op {
            Op::ImageStore(_) => true,
            Op::Image(image) => {
                matches!(self.code.images[image as usize].kind, ImageKind::Sample { .. })
            }
            _ => false,
        }
    }

    /// Reports each active lane for which `wrong` returns `true`, as a hazard of the given kind.
    fn report_where(
        &self,
        observer: &dyn Observer<A>,
        instruction: &Instruction,
        case: usize,
        kind: Kind,
        wrong: impl Fn(usize) -> bool,
    ) where
        A: crate::arithmetic::Arithmetic,
    {
        let site = self.site(instruction);
        let here = (0..self.active().len()).filter(|lane| self.acts(*lane));
        for lane in here.filter(|lane| wrong(*lane)) {
            let case = case + lane;
            observer.wrong(&Wrong { kind, site, case, missing: None });
        }
    }

    /// Reports each active lane with an inactive neighbour in its quad.
    fn report_missing(
        &self,
        observer: &dyn Observer<A>,
        instruction: &Instruction,
        case: usize,
        neighbour: Neighbour,
    ) where
        A: crate::arithmetic::Arithmetic,
    {
        let (site, active) = (self.site(instruction), self.active());
        let comes = |lane: usize| A::possible(active[lane]);
        let parted = |lane| (lane, neighbour.of(lane));
        let lanes = (0..active.len()).map(parted);
        for (lane, other) in lanes.filter(|(lane, other)| self.acts(*lane) && !comes(*other)) {
            let parted = self.parted[other].map(|site| &self.code.sites[site as usize]);
            let [case, other] = [case + lane, case + other];
            let missing = Some(Missing { case: other, parted });
            observer.wrong(&Wrong { kind: Kind::Barrier, site, case, missing });
        }
    }

    /// Reports the lanes in which the low edge of an operation such as `clamp` is above its high edge.
    fn report_order(
        &self,
        observer: &dyn Observer<A>,
        instruction: &Instruction,
        case: usize,
        rule: FloatRule,
        registers: &[u32],
    ) where
        A: crate::arithmetic::Arithmetic,
    {
        let Some(Edges { low, high, distinct }) = rule.edges() else { return };
        let outs = rule.arity().1;
        let [low, high] = [low, high].map(|at| self.floats.get(registers[outs + at]));
        self.report_where(observer, instruction, case, Kind::EdgesReversed, |lane| {
            let (low, high) = (low[lane], high[lane]);
            A::possible(A::float_less(high, low))
                || distinct && A::possible(A::float_equal(high, low))
        });
    }

    fn report_conversion(
        &self,
        observer: &dyn Observer<A>,
        instruction: &Instruction,
        case: usize,
        rule: ToInt,
        registers: &[u32],
    ) where
        A: crate::arithmetic::Arithmetic,
    {
        let Some((least, most)) = rule.holds() else { return };
        let x = self.floats.get(registers[1]);
        self.report_where(observer, instruction, case, Kind::Saturated, |lane| {
            let whole = A::coordinate(x[lane]).trunc();
            whole < least || whole > most
        });
    }

    /// If the options say that reads outside of an array or a texture return a fixed number, writes this number into
    /// the results of such reads.
    #[inline]
    fn estrange(&mut self, instruction: &Instruction, registers: &[u32]) {
        if self.strayed.is_empty() {
            return;
        }
        let Elsewhere::Number(number) = self.elsewhere() else { return };
        let [floats, ints, bools] = self.code.shape(instruction.op).outs.map(|n| n as usize);
        for &lane in &self.strayed {
            for &out in &registers[..floats] {
                self.floats.get_mut(out)[lane] = A::float(f32::from(number));
            }
            for &out in &registers[floats..floats + ints] {
                self.ints.get_mut(out)[lane] = A::int(u32::from(number), false);
            }
            for &out in &registers[floats + ints..floats + ints + bools] {
                self.bools.get_mut(out)[lane] = A::bool(number != 0);
            }
        }
    }

    fn forget_lost(&mut self) {
        for lane in 0..self.width {
            let Some(site) = self.lost[lane] else { continue };
            for &(register, scalar) in &self.code.results {
                match register.file {
                    File::Float => {
                        if let Some(x) = A::unknown_float(site) {
                            self.floats.get_mut(register.index)[lane] = x;
                        }
                    }
                    File::Int => {
                        if let Some(x) = A::unknown_int(scalar.signed()) {
                            self.ints.get_mut(register.index)[lane] = x;
                        }
                    }
                    File::Bool => {
                        if let Some(x) = A::unknown_bool() {
                            self.bools.get_mut(register.index)[lane] = x;
                        }
                    }
                }
            }
        }
    }
}
