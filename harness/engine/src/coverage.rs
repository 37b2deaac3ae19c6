//! Coverage: counts how often each statement runs, and how many lanes take each of the statement's branches.
//!
//! Only some operations, such as the ends of branches, change which lanes are active. The operations between two such
//! operations are a straight line: all of them run in the same lanes, so they share one counter.
//! [`Settings::statements`](crate::Settings::statements) lists the statements, and [`Options::counts`](crate::Options)
//! has the counters.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use naga::{Block, Expression, Module, Span};

use crate::allocate::operands;
use crate::arithmetic::sealed::Rules;
use crate::code::{Binding, Code, Op, Walk};
use crate::lower::STACK;

/// A statement of a program. If a function is called twice, its statements are listed twice.
#[derive(Clone, Debug)]
pub struct Statement {
    /// The function that contains the statement.
    pub function: String,
    /// The number of the call that this copy of the statement comes from. Lowering inlines functions, so each call gets
    /// its own copy of the called function's statements.
    pub call: usize,
    /// The byte range of the statement in the source.
    pub span: Span,
    /// The kind of the statement.
    pub kind: StatementKind,
    /// `true` if a test can see an effect of the statement: a changed result, changed memory, a loop that doesn't end,
    /// or a finding of the sanitizer.
    pub needed: bool,
    /// The index of the statement's first operation. `end` is the index after its last operation.
    pub(crate) start: u32,
    pub(crate) end: u32,
}

/// The kind of a statement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StatementKind {
    /// A statement without branches: a let-binding, an assignment, a call, a jump.
    Plain,
    /// A `switch`. Each of its clauses is also a statement.
    Switch,
    /// An `if`, `&&` or `||`. Lanes can go two ways: the condition holds, or the condition doesn't hold. naga
    /// translates `||` into an `if` whose condition is the negated first operand.
    If,
    /// A `select` expression. Lanes can go two ways: the condition holds, or the condition doesn't hold.
    Select,
    /// A clause of a `switch`. The parameter is the clause's index. All lanes that reach a clause go the same way.
    Clause(usize),
    /// A loop. Lanes can go three ways: they leave the loop in the first, in the second, or in a later iteration.
    Loop,
    /// The condition of a `for` or `while`. The lanes that leave are counted at the [`Loop`](Self::Loop).
    Exit,
}

const WAYS: usize = 3;

/// The counters of a program's operations. All runs of the program add to these counters.
#[derive(Debug)]
pub struct Counts(Vec<Counter>);

#[derive(Debug, Default)]
struct Counter {
    lanes: AtomicU64,
    /// The lowest index of a case that reached the operation, plus 1. The number is 0 if no case reached the operation.
    first: AtomicU64,
    ways: [AtomicU64; WAYS],
}

/// The counts of one statement.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Count {
    /// The number of lanes that reached the statement.
    pub lanes: u64,
    /// The lowest index of a case that reached the statement.
    pub first: Option<usize>,
    /// The number of lanes that took each branch (way), in the order in which [`StatementKind`] lists them.
    pub ways: [u64; WAYS],
}

impl Counts {
    /// Counts the lanes that reach the straight line of operations that begins at index `at`.
    pub(crate) fn come<A: Rules>(&self, at: usize, case: usize, lanes: &[A::Bool]) {
        let Some(counter) = self.0.get(at) else { return };
        let count = count::<A>(lanes);
        if count == 0 {
            return;
        }
        counter.lanes.fetch_add(count, Ordering::Relaxed);
        let known = counter.first.load(Ordering::Relaxed);
        if known == 0 || known > case as u64 {
            let lane = lanes.iter().position(|active| A::possible(*active)).unwrap_or_default();
            let number = (case + lane + 1) as u64;
            let first = |known| (known == 0 || number < known).then_some(number);
            let _ = counter.first.fetch_update(Ordering::Relaxed, Ordering::Relaxed, first);
        }
    }

    pub(crate) fn take(&self, at: usize, way: usize, lanes: u64) {
        self.0[at].ways[way].fetch_add(lanes, Ordering::Relaxed);
    }

    /// Counts the lanes that begin an iteration of a loop. `round` is the number of the iteration, from 1. A lane
    /// counts for the last iteration that it begins, because it leaves the loop there.
    pub(crate) fn round<A: Rules>(&self, at: usize, round: u64, lanes: &[A::Bool]) {
        let ways = &self.0[at].ways;
        let Ok(way) = usize::try_from(round - 1) else { return };
        if way < WAYS {
            let count = count::<A>(lanes);
            ways[way].fetch_add(count, Ordering::Relaxed);
            if let Some(before) = way.checked_sub(1) {
                ways[before].fetch_sub(count, Ordering::Relaxed);
            }
        }
    }

    /// Counts the lanes in which a condition holds, and the lanes in which it doesn't hold. Once both numbers are above
    /// 0, the function stops counting to save time.
    pub(crate) fn select<A: Rules>(&self, at: usize, condition: &[A::Bool], lanes: &[A::Bool]) {
        let ways = &self.0[at].ways;
        if ways[..2].iter().any(|way| way.load(Ordering::Relaxed) == 0) {
            let both = condition.iter().zip(lanes).map(|(own, lane)| A::and(*own, *lane));
            let yes = both.map(|lane| u64::from(A::possible(lane))).sum();
            self.take(at, 0, yes);
            self.take(at, 1, count::<A>(lanes) - yes);
        }
    }
}

pub(crate) fn count<A: Rules>(lanes: &[A::Bool]) -> u64 {
    lanes.iter().map(|lane| u64::from(A::possible(*lane))).sum()
}

/// Checks if an operation may change which lanes are active.
fn parts(op: Op) -> bool {
    matches!(
        op,
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
            | Op::Return(_)
            | Op::Discard
    )
}

impl crate::Program {
    /// New counters for [`Options::counts`](crate::Options::counts), all zero. `None` if the program was lowered
    /// without [`statements`](crate::Settings::statements).
    #[must_use]
    pub fn counts(&self) -> Option<Arc<Counts>> {
        let code = self.code();
        let counters = || code.instructions.iter().map(|_| Counter::default()).collect();
        (!code.statements.is_empty()).then(|| Arc::new(Counts(counters())))
    }

    /// The program's statements, each with its counts.
    pub fn counted<'p>(
        &'p self,
        counts: &'p Counts,
    ) -> impl Iterator<Item = (&'p Statement, Count)> {
        let code = self.code();
        // For each operation, the first operation of its straight line.
        let mut lines: Vec<usize> = Vec::with_capacity(code.instructions.len() + 1);
        let mut line = 0;
        for (at, instruction) in code.instructions.iter().enumerate() {
            lines.push(line);
            line = if parts(instruction.op) { at + 1 } else { line };
        }
        lines.push(line);
        code.statements.iter().map(move |statement| {
            let of = |at: usize| counts.0.get(at);
            let read = |one: &AtomicU64| one.load(Ordering::Relaxed);
            let line = of(lines[statement.start as usize]);
            let lanes = line.map_or(0, |one| read(&one.lanes));
            let first = line.map_or(0, |one| read(&one.first)).checked_sub(1);
            let ways = statement.branch(code).and_then(of).map(|one| one.ways.each_ref().map(read));
            let count = Count {
                lanes,
                first: first.and_then(|first| usize::try_from(first).ok()),
                ways: ways.unwrap_or_default(),
            };
            (statement, count)
        })
    }
}

impl Statement {
    /// The index of the operation at which the statement's branches are counted. `None` if they aren't counted.
    fn branch(&self, code: &Code) -> Option<usize> {
        let (start, end) = (self.start as usize, self.end as usize);
        let mut own = (start..end).map(|at| (at, code.instructions[at].op));
        let found = match self.kind {
            StatementKind::Plain | StatementKind::Switch | StatementKind::Exit => None,
            StatementKind::If => own.find(|(_, op)| *op == Op::If),
            StatementKind::Select => own.find(|(_, op)| matches!(op, Op::Select(_))),
            StatementKind::Loop => own.find(|(_, op)| *op == Op::Round),
            // The operation of the clause comes first in the list.
            StatementKind::Clause(_) => own.next(),
        };
        found.map(|(at, _)| at)
    }
}

/// All statements of all functions and entry points of a module.
#[must_use]
pub fn statements(module: &Module) -> Vec<Statement> {
    let functions = module.functions.iter();
    let functions = functions.map(|(_, one)| (one.name.clone().unwrap_or_default(), one));
    let points = module.entry_points.iter().map(|one| (one.name.clone(), &one.function));
    let mut all = Vec::new();
    for (name, function) in functions.chain(points) {
        let mut list = |span: Span, kind| {
            if span.is_defined() {
                let function = name.clone();
                let own =
                    Statement { function, call: 0, span, kind, needed: true, start: 0, end: 0 };
                all.push(own);
            }
        };
        for (handle, expression) in function.expressions.iter() {
            if matches!(expression, Expression::Select { .. }) {
                list(function.expressions.get_span(handle), StatementKind::Select);
            }
        }
        list_block(&function.body, &mut list);
    }
    all
}

fn list_block(block: &Block, list: &mut dyn FnMut(Span, StatementKind)) {
    stacker::maybe_grow(STACK.0, STACK.1, || {
        for (statement, span) in block.span_iter() {
            if let Some(kind) = StatementKind::of(statement) {
                list(*span, kind);
            }
            match statement {
                naga::Statement::Block(block) => list_block(block, list),
                naga::Statement::If { accept, reject, .. } => {
                    list_block(accept, list);
                    list_block(reject, list);
                }
                naga::Statement::Loop { body, continuing, .. } => {
                    list_block(body, list);
                    list_block(continuing, list);
                }
                naga::Statement::Switch { cases, .. } => {
                    // A clause with several values has several cases in naga. The last of these cases has the clause's
                    // statements.
                    for (clause, case) in cases.iter().filter(|case| !case.fall_through).enumerate()
                    {
                        list(*span, StatementKind::Clause(clause));
                        list_block(&case.body, list);
                    }
                }
                _ => {}
            }
        }
    });
}

impl StatementKind {
    /// The kind of a statement of naga. `None` for a block, which only groups statements.
    pub(crate) fn of(statement: &naga::Statement) -> Option<Self> {
        let leaves = |block: &Block| matches!(block.last(), Some(naga::Statement::Break));
        Some(match statement {
            naga::Statement::Block(_) => return None,
            naga::Statement::If { accept, reject, .. } if accept.is_empty() && leaves(reject) => {
                Self::Exit
            }
            naga::Statement::If { .. } => Self::If,
            naga::Statement::Loop { .. } => Self::Loop,
            naga::Statement::Switch { .. } => Self::Switch,
            _ => Self::Plain,
        })
    }
}

/// Finds the operations that can affect something that a test sees. A test sees results, the let-bindings that
/// observers receive, written buffers and textures, and endless loops. A test of a pass also sees the findings of the
/// sanitizer. A branch, a loop or a jump is needed if it decides whether a needed operation runs.
pub(crate) fn needed(code: &Code) -> Vec<bool> {
    let mut frames: Vec<(Option<usize>, bool)> = Vec::new();
    let mut frame_of: Vec<Option<usize>> = Vec::with_capacity(code.instructions.len());
    let mut open: Vec<usize> = Vec::new();
    for instruction in &code.instructions {
        let ends = matches!(instruction.op, Op::EndIf | Op::EndSwitch | Op::EndLoop | Op::EndCall);
        if matches!(instruction.op, Op::If | Op::Switch | Op::Loop | Op::Call) {
            frames.push((open.last().copied(), false));
            open.push(frames.len() - 1);
        }
        frame_of.push(open.last().copied());
        if ends {
            open.pop();
        }
    }
    let mut analysis = Needed {
        code,
        frames,
        registers: code.registers.map(|count| vec![false; count as usize]),
        buffers: code.buffers.iter().map(|slot| slot.binding != Binding::Workgroup).collect(),
    };
    for (register, _) in &code.results {
        analysis.registers[register.file as usize][register.index as usize] = true;
    }
    let mut needed = vec![false; code.instructions.len()];
    loop {
        let mut changed = false;
        for at in (0..code.instructions.len()).rev() {
            if !needed[at] && analysis.is_needed(at, frame_of[at]) {
                analysis.need(at, frame_of[at]);
                (needed[at], changed) = (true, true);
            }
        }
        if !changed {
            return needed;
        }
    }
}

struct Needed<'c> {
    code: &'c Code,
    /// For each branch, loop and call: the index of the construct around it, and `true` if the branch, loop or call
    /// contains a needed operation.
    frames: Vec<(Option<usize>, bool)>,
    registers: [Vec<bool>; 3],
    buffers: Vec<bool>,
}

impl Needed<'_> {
    fn is_needed(&self, at: usize, frame: Option<usize>) -> bool {
        let instruction = self.code.instructions[at];
        let registers = || operands(self.code.shape(instruction.op), instruction.at);
        let is = |file: crate::scalar::File, at: usize| {
            self.registers[file as usize][self.code.pool[at] as usize]
        };
        match instruction.op {
            // A jump decides if the operations after it run, up to the end of the construct that it leaves.
            Op::Break(depth) | Op::Continue(depth) | Op::Return(depth) => {
                let mut target = frame;
                for _ in 0..depth {
                    target = target.and_then(|frame| self.frames[frame].0);
                }
                target.is_some_and(|frame| self.frames[frame].1)
            }
            // A test sees if a loop ends. In a pass, the sanitizer checks each access and each index.
            Op::ImageStore(_)
            | Op::Discard
            | Op::Barrier(_)
            | Op::Round
            | Op::BreakIf
            | Op::Mark(_) => true,
            Op::Load(_, walk) if self.code.may_race(walk) => true,
            Op::Write(..) | Op::Atomic(_) | Op::Gather(..) | Op::Scatter(..)
                if self.code.workgroup != [0; 3] =>
            {
                true
            }
            Op::Write(_, walk) | Op::Atomic(walk) => {
                let written = self.buffers[self.walk(walk).buffer as usize];
                written || registers().any(|one| one.written && is(one.file, one.at))
            }
            Op::Scatter(file, _) => {
                self.range(file, instruction.at).any(|own| self.registers[file as usize][own])
            }
            // `Skip` only saves time, and belongs to the loop before it.
            Op::Skip | Op::Wrap(_) | Op::Halt => false,
            op if parts(op) => frame.is_some_and(|frame| self.frames[frame].1),
            _ => registers().any(|one| one.written && is(one.file, one.at)),
        }
    }

    fn need(&mut self, at: usize, mut frame: Option<usize>) {
        let code = self.code;
        let instruction = code.instructions[at];
        for one in operands(code.shape(instruction.op), instruction.at) {
            if !one.written {
                self.registers[one.file as usize][code.pool[one.at] as usize] = true;
            }
        }
        match instruction.op {
            Op::Gather(file, _) => {
                // The results come first, then the range.
                let ranges: Vec<usize> = self.range(file, instruction.at + 1).collect();
                ranges.into_iter().for_each(|own| self.registers[file as usize][own] = true);
            }
            Op::Load(_, walk) | Op::Atomic(walk) => {
                let buffer = self.walk(walk).buffer as usize;
                self.buffers[buffer] = true;
            }
            _ => {}
        }
        while let Some(own) = frame {
            self.frames[own].1 = true;
            frame = self.frames[own].0;
        }
    }

    fn walk(&self, walk: u32) -> &Walk {
        &self.code.walks[walk as usize]
    }

    /// The registers of the range in [`Code::pinned`] that contains the register `pool[at]`. If there is no such range,
    /// only this register.
    fn range(&self, file: crate::scalar::File, at: u32) -> impl Iterator<Item = usize> + use<> {
        let base = self.code.pool[at as usize];
        let is_own = |&&(pinned, first, count): &&(crate::scalar::File, u32, u32)| {
            pinned == file && (first..first + count).contains(&base)
        };
        let found = self.code.pinned.iter().find(is_own);
        let (first, count) = found.map_or((base, 1), |&(_, first, count)| (first, count));
        first as usize..(first + count) as usize
    }
}
