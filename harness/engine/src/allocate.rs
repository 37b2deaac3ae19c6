//! Allocates registers: values that aren't needed at the same time share a register. Also removes unused operations.
//!
//! A program is one list of operations. Only the end of a loop jumps backwards. So a value's register is in use from
//! the first to the last operation that mentions the value. If a loop uses a value that was defined before the loop,
//! the register stays in use to the end of the loop.

use crate::code::{Code, Op, Shape};
use crate::scalar::File;

/// The first and the last position in the list at which a register occurs, and the number of its writes and reads.
#[derive(Clone, Copy, Debug)]
struct Life {
    first: u32,
    last: u32,
    writes: u32,
    reads: u32,
}

const NEVER: Life = Life { first: u32::MAX, last: 0, writes: 0, reads: 0 };

/// A register that an operation reads or writes. `at` is the position in [`Code::pool`] that names the register.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Operand {
    pub(crate) file: File,
    pub(crate) at: usize,
    pub(crate) written: bool,
}

const FILES: [File; 3] = [File::Float, File::Int, File::Bool];

pub(crate) fn operands(shape: Shape, start: u32) -> impl Iterator<Item = Operand> {
    let mut at = start as usize;
    let parts = [(shape.outs, true), (shape.ins, false)];
    let each = parts.into_iter().flat_map(|(counts, written)| {
        FILES.into_iter().flat_map(move |file| {
            std::iter::repeat_n((file, written), counts[file as usize] as usize)
        })
    });
    each.map(move |(file, written)| {
        at += 1;
        Operand { file, at: at - 1, written }
    })
}

/// Propagates copies, removes unused operations, and assigns registers.
pub(crate) fn allocated(mut code: Code) -> Code {
    if !code.statements.is_empty() {
        let needed = crate::coverage::needed(&code);
        for statement in &mut code.statements {
            let own = &needed[statement.start as usize..statement.end as usize];
            // A statement without operations, such as a new name for a value, counts as needed.
            statement.needed = own.is_empty() || own.contains(&true);
        }
    }
    forward_copies(&mut code);
    remove_unused(&mut code);
    assign(&mut code);
    code
}

/// A value for each register of each register file.
type Table<T> = [Vec<T>; 3];

fn table<T: Clone>(code: &Code, value: &T) -> Table<T> {
    std::array::from_fn(|file| vec![value.clone(); code.registers[file] as usize])
}

fn lives(code: &Code) -> Table<Life> {
    let mut lives = table(code, &NEVER);
    for (register, _) in &code.parameters {
        let life = &mut lives[register.file as usize][register.index as usize];
        life.first = 0;
        life.writes += 1;
    }
    for (place, instruction) in code.instructions.iter().enumerate() {
        for operand in operands(code.shape(instruction.op), instruction.at) {
            let life = &mut lives[operand.file as usize][code.pool[operand.at] as usize];
            life.first = life.first.min(place as u32);
            life.last = life.last.max(place as u32);
            life.writes += u32::from(operand.written);
            life.reads += u32::from(!operand.written);
        }
    }
    for (register, _) in &code.results {
        let life = &mut lives[register.file as usize][register.index as usize];
        life.last = code.instructions.len() as u32;
        life.reads += 1;
    }
    lives
}

/// The loops of a program. Each has the positions of its first and last operation, and the index of the loop around it.
struct Loops {
    /// For each position in the list, the index of the innermost loop around it.
    of: Vec<Option<u32>>,
    loops: Vec<(u32, u32, Option<u32>)>,
}

impl Loops {
    fn of(code: &Code) -> Self {
        let mut open: Vec<u32> = Vec::new();
        let mut loops: Vec<(u32, u32, Option<u32>)> = Vec::new();
        let mut of = Vec::with_capacity(code.instructions.len() + 1);
        for (place, instruction) in code.instructions.iter().enumerate() {
            if instruction.op == Op::Loop {
                loops.push((place as u32, u32::MAX, open.last().copied()));
                open.push(loops.len() as u32 - 1);
            }
            of.push(open.last().copied());
            if instruction.op == Op::EndLoop
                && let Some(ended) = open.pop()
            {
                loops[ended as usize].1 = place as u32;
            }
        }
        of.push(None);
        Self { of, loops }
    }

    /// The last position at which a value is needed. An operation defines the value at position `defined`, and another
    /// operation uses it at `used`. If the use is in a loop, the next iteration may need the value again.
    fn needed(&self, defined: u32, used: u32) -> u32 {
        let mut last = used;
        let mut inner = self.of[used as usize];
        while let Some(index) = inner {
            let (start, end, outer) = self.loops[index as usize];
            // A parameter is defined before the first operation, which may be a loop. A loop operation defines nothing.
            if start >= defined {
                last = last.max(end);
            }
            inner = outer;
        }
        last
    }
}

fn is_pinned(code: &Code, file: File, register: u32) -> bool {
    code.pinned
        .iter()
        .any(|&(pinned, base, count)| pinned == file && (base..base + count).contains(&register))
}

/// Replaces reads of a copy by reads of its source, if no operation between the copy and the read writes the source.
fn forward_copies(code: &mut Code) {
    let lives = lives(code);
    let loops = Loops::of(code);
    // For each register, the positions at which it is written, in order.
    let mut writes: Table<Vec<u32>> = table(code, &Vec::new());
    // For each register, the last position at which its value is needed.
    let mut needed: Table<u32> = table(code, &0);
    for (place, instruction) in code.instructions.iter().enumerate() {
        if let Op::Scatter(file, _) = instruction.op {
            let base = code.pool[instruction.at as usize];
            for &(pinned, first, count) in &code.pinned {
                if pinned == file && (first..first + count).contains(&base) {
                    for register in first..first + count {
                        writes[file as usize][register as usize].push(place as u32);
                    }
                }
            }
            continue;
        }
        for operand in operands(code.shape(instruction.op), instruction.at) {
            let (file, register) = (operand.file as usize, code.pool[operand.at] as usize);
            if operand.written {
                writes[file][register].push(place as u32);
            } else {
                let defined = lives[file][register].first;
                let until = loops.needed(defined, place as u32);
                needed[file][register] = needed[file][register].max(until);
            }
        }
    }
    for (register, _) in &code.results {
        needed[register.file as usize][register.index as usize] = code.instructions.len() as u32;
    }
    let mut renamed: Table<Option<u32>> = table(code, &None);
    for (place, instruction) in code.instructions.iter().enumerate() {
        let Op::Move(file) = instruction.op else { continue };
        let [to, from] = [0, 1].map(|k| code.pool[instruction.at as usize + k]);
        let f = file as usize;
        // The source of a copy may also be a copy.
        let from = renamed[f][from as usize].unwrap_or(from);
        let life = lives[f][to as usize];
        if life.writes != 1 || is_pinned(code, file, to) {
            continue;
        }
        let until = needed[f][to as usize];
        let after = writes[f][from as usize].partition_point(|&write| write <= place as u32);
        if writes[f][from as usize].get(after).is_some_and(|&write| write <= until) {
            continue;
        }
        renamed[f][to as usize] = Some(from);
        needed[f][from as usize] = needed[f][from as usize].max(until);
    }
    for instruction in 0..code.instructions.len() {
        let instruction = code.instructions[instruction];
        for operand in operands(code.shape(instruction.op), instruction.at) {
            let register = code.pool[operand.at] as usize;
            if let (false, Some(other)) =
                (operand.written, renamed[operand.file as usize][register])
            {
                code.pool[operand.at] = other;
            }
        }
    }
    for (register, _) in &mut code.results {
        if let Some(other) = renamed[register.file as usize][register.index as usize] {
            register.index = other;
        }
    }
}

/// Checks if the only effect of an operation is to write its results.
fn is_pure(op: Op) -> bool {
    matches!(
        op,
        Op::Float(_)
            | Op::Integer(_)
            | Op::ToInt(_)
            | Op::FromInt(_)
            | Op::Scale(_)
            | Op::ToHalf(_)
            | Op::Neighbour(_)
            | Op::CompareFloat(_)
            | Op::CompareInt(..)
            | Op::And
            | Op::Or
            | Op::Not
            | Op::Differ
            | Op::IsNan
            | Op::IsInf
            | Op::Select(_)
            | Op::Move(_)
            | Op::Store(_)
            | Op::Gather(..)
            | Op::Pick(..)
            | Op::Table(..)
            | Op::Load(..)
            | Op::Image(_)
            | Op::ArrayLength(_)
    )
}

fn remove_unused(code: &mut Code) {
    let mut reads = table(code, &0u32);
    for instruction in &code.instructions {
        for operand in operands(code.shape(instruction.op), instruction.at) {
            if !operand.written {
                reads[operand.file as usize][code.pool[operand.at] as usize] += 1;
            }
        }
    }
    for (register, _) in &code.results {
        reads[register.file as usize][register.index as usize] += 1;
    }
    for &(file, base, count) in &code.pinned {
        for register in base..base + count {
            reads[file as usize][register as usize] += 1;
        }
    }
    let mut removed = vec![false; code.instructions.len()];
    // A loop may read a variable at a position before the write, so several passes are needed.
    loop {
        let mut changed = false;
        for place in (0..code.instructions.len()).rev() {
            let instruction = code.instructions[place];
            // "A read accesses all locations of its memory view" (WGSL, *Memory Operation*), so an unused read may
            // race. The sanitizer must see it.
            let races = match instruction.op {
                Op::Load(_, walk) => code.may_race(walk),
                _ => false,
            };
            if removed[place] || races || !is_pure(instruction.op) {
                continue;
            }
            let all = || operands(code.shape(instruction.op), instruction.at);
            let read = |o: Operand| reads[o.file as usize][code.pool[o.at] as usize] > 0;
            if all().any(|operand| operand.written && read(operand)) {
                continue;
            }
            removed[place] = true;
            changed = true;
            for operand in all().filter(|operand| !operand.written) {
                reads[operand.file as usize][code.pool[operand.at] as usize] -= 1;
            }
        }
        if !changed {
            break;
        }
    }
    for instruction in &code.instructions {
        let Op::Atomic(walk) = instruction.op else { continue };
        let mut all = operands(code.shape(instruction.op), instruction.at);
        let used = all.any(|o| o.written && reads[o.file as usize][code.pool[o.at] as usize] > 0);
        if let Some(atomic) = &mut code.walks[walk as usize].atomic {
            atomic.used = used;
        }
    }
    let mut next = 0;
    let mut moved: Vec<u32> = Vec::with_capacity(removed.len() + 1);
    for &removed in &removed {
        moved.push(next);
        next += u32::from(!removed);
    }
    moved.push(next);
    let mut kept = removed.iter().map(|removed| !removed);
    code.instructions.retain(|_| kept.next().unwrap_or(true));
    for instruction in &mut code.instructions {
        if let Some(&target) = moved.get(instruction.target as usize) {
            instruction.target = target;
        }
    }
    for statement in &mut code.statements {
        for place in [&mut statement.start, &mut statement.end] {
            *place = moved[*place as usize];
        }
    }
}

fn assign(code: &mut Code) {
    let mut lives = lives(code);
    let loops = Loops::of(code);
    for (place, instruction) in code.instructions.iter().enumerate() {
        for operand in operands(code.shape(instruction.op), instruction.at) {
            let life = &mut lives[operand.file as usize][code.pool[operand.at] as usize];
            life.last = life.last.max(loops.needed(life.first, place as u32));
        }
    }
    let mut assigned: Table<Option<u32>> = table(code, &None);
    let mut counts = [0u32; 3];
    let mut fresh = |file: File| {
        counts[file as usize] += 1;
        counts[file as usize] - 1
    };
    // Constants, and registers that are selected by an index, don't share a register with other values.
    for &(file, base, count) in &code.pinned {
        for register in base..base + count {
            assigned[file as usize][register as usize] = Some(fresh(file));
        }
    }
    code.constants.retain(|(register, _)| {
        let life = lives[register.file as usize][register.index as usize];
        let used = life.reads > 0;
        if used {
            assigned[register.file as usize][register.index as usize] = Some(fresh(register.file));
        }
        used
    });
    for file in FILES {
        let f = file as usize;
        let mut order: Vec<u32> = (0..code.registers[f])
            .filter(|&r| assigned[f][r as usize].is_none() && lives[f][r as usize].writes > 0)
            .collect();
        order.sort_by_key(|&register| lives[f][register as usize].first);
        let mut active: std::collections::BinaryHeap<std::cmp::Reverse<(u32, u32)>> =
            Default::default();
        let mut free: Vec<u32> = Vec::new();
        for register in order {
            let life = lives[f][register as usize];
            // A register stays taken at the last position of its value, because an operation's results mustn't
            // overwrite its operands.
            while let Some(&std::cmp::Reverse((last, old))) = active.peek()
                && last < life.first
            {
                active.pop();
                free.push(old);
            }
            let new = free.pop().unwrap_or_else(|| fresh(file));
            assigned[f][register as usize] = Some(new);
            active.push(std::cmp::Reverse((life.last.max(life.first), new)));
        }
    }
    let of = |file: File, register: u32| assigned[file as usize][register as usize].unwrap_or(0);
    for instruction in 0..code.instructions.len() {
        let instruction = code.instructions[instruction];
        for operand in operands(code.shape(instruction.op), instruction.at) {
            code.pool[operand.at] = of(operand.file, code.pool[operand.at]);
        }
    }
    for (register, _) in code.parameters.iter_mut().chain(&mut code.results) {
        register.index = of(register.file, register.index);
    }
    for (register, _) in &mut code.constants {
        register.index = of(register.file, register.index);
    }
    for place in 0..code.instructions.len() {
        let Shape { outs, ins } = code.shape(code.instructions[place].op);
        code.instructions[place].count = outs.iter().chain(&ins).sum();
    }
    let mut mutable: [Vec<u32>; 3] = Default::default();
    for instruction in &code.instructions {
        if let Op::Store(file) = instruction.op {
            mutable[file as usize].push(code.pool[instruction.at as usize]);
        }
    }
    for &(file, base, count) in &code.pinned {
        mutable[file as usize].extend((base..base + count).map(|register| of(file, register)));
    }
    for registers in &mut mutable {
        registers.sort_unstable();
        registers.dedup();
    }
    code.mutable = mutable;
    code.registers = counts;
}
