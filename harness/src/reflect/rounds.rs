//! Counts the iterations of loops.
//!
//! Some drivers stop all loops of an invocation after a number of iterations, and continue with wrong values. If naga's
//! IR shows that all loops end sooner, Karat doesn't count their iterations. Otherwise a copy of the kernel counts
//! the iterations of its loops. The verdict uses the results of the original kernel.

mod bounds;
mod watched;

use std::collections::BTreeSet;
use std::sync::Arc;

use naga::{
    BinaryOperator, Block, Expression, Function, GlobalVariable, Handle, Literal, Module, Statement,
};

pub use watched::Watched;

use super::Program;
use crate::diagnostic::Span;

/// The prefix of the counters in the copy of a kernel. Each counter is a private variable, such as `karat_rounds0`.
pub(crate) const COUNTERS: &str = "karat_rounds";

impl Program {
    /// The number of barriers in an entry point and in the functions that it calls.
    pub fn barriers(&self, entry_point: &str) -> usize {
        let module = &self.checked.module;
        let entry = module.entry_points.iter().find(|entry| entry.name == entry_point);
        let (mut open, mut seen) = (Vec::from_iter(entry.map(|entry| &entry.function)), Vec::new());
        let mut count = 0;
        while let Some(function) = open.pop() {
            walk(&function.body, false, &mut |statement, _, _| match statement {
                Statement::ControlBarrier(_) => count += 1,
                Statement::Call { function, .. } if !seen.contains(function) => {
                    seen.push(*function);
                    open.push(&module.functions[*function]);
                }
                _ => {}
            });
        }
        count
    }

    /// The functions that a function or an entry point calls directly, by the functions' paths in the author's code.
    pub fn calls(&self, path: &str) -> BTreeSet<String> {
        let (name, functions) = (self.name_of(path), &self.checked.module.functions);
        let found =
            functions.iter().map(|(_, one)| one).find(|one| one.name.as_deref() == Some(name));
        let entry = self.checked.module.entry_points.iter().find(|entry| entry.name == name);
        let mut called = BTreeSet::new();
        if let Some(function) = found.or(entry.map(|entry| &entry.function)) {
            walk(&function.body, false, &mut |statement, _, _| {
                if let Statement::Call { function, .. } = statement
                    && let Some(name) = &functions[*function].name
                {
                    called.insert(self.author_path(name).unwrap_or(name).to_owned());
                }
            });
        }
        called
    }

    /// The number of loops. [`count_rounds`] numbers the loops in the order of the text. Each loop has two counters:
    /// the first counts the loop's iterations, and the second counts how often an invocation enters the loop.
    pub(crate) fn loops(&self) -> usize {
        let functions = self.checked.module.functions.iter().map(|(_, function)| &function.body);
        functions.map(|body| loops_of(body).len()).sum()
    }
}

/// A module that counts the iterations of its loops, and the location of each loop in the author's files.
pub(crate) struct Counting {
    pub(crate) module: Module,
    pub(crate) loops: Vec<CountedLoop>,
    pub(crate) nesting: Nesting,
}

/// The innermost loop, function or entry point around a loop or a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Around {
    /// The entry point, which runs once.
    Entry,
    Function(usize),
    Loop(usize),
}

/// The nesting of loops, also through calls of functions. `loops` and `owners` have an element for each loop, and
/// `calls` has an element for each function.
///
/// Some drivers run cases in the lanes of a vector. Such a driver executes both branches of each `if`. The driver also
/// runs at least one iteration of each loop in a branch, even if no case takes the branch. So whenever the code around
/// a loop runs, the driver counts an iteration of the loop, even if no case enters the loop.
#[derive(Clone, Debug, Default)]
pub(crate) struct Nesting {
    /// For each loop, the innermost loop, function or entry point around it.
    loops: Vec<Around>,
    owners: Vec<usize>,
    /// For each function, the loops, functions and entry points that contain calls of the function.
    calls: Vec<Vec<Around>>,
}

impl Nesting {
    fn of(module: &Module) -> Self {
        let calls = vec![Vec::new(); module.functions.len()];
        let mut nesting = Self { calls, ..Self::default() };
        for (handle, function) in module.functions.iter() {
            let own = handle.index();
            nesting.add(&function.body, own, Around::Function(own));
        }
        for entry in &module.entry_points {
            nesting.add(&entry.function.body, usize::MAX, Around::Entry);
        }
        nesting
    }

    fn add(&mut self, block: &Block, owner: usize, around: Around) {
        for statement in block.iter() {
            let inside = match statement {
                Statement::Loop { .. } => {
                    self.loops.push(around);
                    self.owners.push(owner);
                    Around::Loop(self.loops.len() - 1)
                }
                Statement::Call { function, .. } => {
                    self.calls[function.index()].push(around);
                    continue;
                }
                _ => around,
            };
            for (inner, _) in blocks(statement) {
                self.add(inner, owner, inside);
            }
        }
    }

    /// For each loop, the number that an iteration of the loop adds to the driver's count: 1, plus 1 for each loop
    /// directly inside of it. A driver counts an iteration of an inner loop even if no case enters the inner loop.
    fn weights(&self) -> Vec<u32> {
        // For each function, the number of its loops that are in no other loop of the function, plus the numbers
        // of the functions that it calls outside of loops.
        let mut outermost = vec![0_u32; self.calls.len()];
        let within = |around: Around, outermost: &[u32]| -> u32 {
            let own = self.loops.iter().filter(|known| **known == around).count();
            let called = self.calls.iter().zip(outermost).map(|(sites, loops)| {
                let sites = sites.iter().filter(|site| **site == around).count();
                u32::try_from(sites).unwrap_or(u32::MAX).saturating_mul(*loops)
            });
            called.fold(u32::try_from(own).unwrap_or(u32::MAX), u32::saturating_add)
        };
        // naga's IR has each function after the functions that it calls.
        for function in 0..self.calls.len() {
            outermost[function] = within(Around::Function(function), &outermost);
        }
        let weight = |at| within(Around::Loop(at), &outermost).saturating_add(1);
        (0..self.loops.len()).map(weight).collect()
    }

    /// The number of iterations that a driver counts for each loop in one case. `counters` has the iterations of each
    /// loop, and then the number of times that a case entered each loop.
    pub(crate) fn rounds(&self, counters: &[u32]) -> Vec<u64> {
        let (rounds, entered) = counters.split_at(self.loops.len().min(counters.len()));
        let mut totals = vec![0_u64; self.loops.len()];
        let mut runs = vec![0_u64; self.calls.len()];
        // naga's IR has each function after the functions that it calls.
        for function in (0..self.calls.len()).rev() {
            let times = |around: &Around, totals: &[u64], runs: &[u64]| match around {
                Around::Entry => 1,
                Around::Function(at) => runs[*at],
                Around::Loop(at) => totals[*at],
            };
            runs[function] =
                self.calls[function].iter().map(|around| times(around, &totals, &runs)).sum();
            for at in (0..self.loops.len()).filter(|at| self.owners[*at] == function) {
                let around = times(&self.loops[at], &totals, &runs);
                let skipped = around.saturating_sub(u64::from(entered[at]));
                totals[at] = u64::from(rounds[at]) + skipped;
            }
        }
        totals
    }
}

#[derive(Clone, Debug)]
pub(crate) struct CountedLoop {
    pub(crate) span: Option<Span>,
    /// `true` if the loop is inside another loop of its function, or if a loop calls its function.
    pub(crate) nested: bool,
}

/// Makes each loop of a kernel's functions add 1 to one of the [`COUNTERS`] in each iteration, and 1 to another
/// counter when an invocation enters the loop. `text` is the program's text with the kernel, which declares the
/// counters.
///
/// # Panics
/// Panics if the kernel doesn't parse. This can't happen for a valid kernel, because Karat only adds counters to its
/// text.
pub(crate) fn count_rounds(program: &Program, text: &str) -> Counting {
    let module = super::parsed_with(text, program.overrides())
        .expect("it is the verdict's kernel but for the counters");
    let mut module = Arc::unwrap_or_clone(module);
    let nesting = Nesting::of(&module);
    let mut loops = Vec::new();
    for (_, function) in module.functions.iter() {
        for (span, nested) in loops_of(&function.body) {
            let span = span.to_range().and_then(|range| program.resolve(range));
            loops.push(CountedLoop { span, nested });
        }
    }
    let mut index = 0;
    let counter = |index: usize| global(&module, &format!("{COUNTERS}{index}"));
    let counters: Vec<_> = (0..2 * loops.len()).map(counter).collect();
    let handles: Vec<_> = module.functions.iter().map(|(handle, _)| handle).collect();
    let called_in_loops = called_in_loops(&module);
    for handle in handles {
        let function = module.functions.get_mut(handle);
        let mut body = std::mem::take(&mut function.body);
        let first = index;
        instrument(&mut body, &mut index, &mut |own, enters| {
            let own = own as usize;
            count(function, counters[if enters { loops.len() + own } else { own }])
        });
        function.body = body;
        if called_in_loops.contains(&handle) {
            loops[first as usize..index as usize]
                .iter_mut()
                .for_each(|counted| counted.nested = true);
        }
    }
    Counting { module, loops, nesting }
}

/// The functions that a loop calls, directly or through another function.
fn called_in_loops(module: &Module) -> Vec<Handle<Function>> {
    let mut found: Vec<Handle<Function>> = Vec::new();
    // naga's IR has callers after the functions that they call, so this order begins with the callers.
    let bodies = module.functions.iter().map(|(handle, function)| (Some(handle), &function.body));
    let bodies: Vec<_> = bodies
        .chain(module.entry_points.iter().map(|entry| (None, &entry.function.body)))
        .collect();
    for (handle, body) in bodies.into_iter().rev() {
        let inside = handle.is_some_and(|handle| found.contains(&handle));
        walk(body, inside, &mut |statement, _, in_loop| {
            if let Statement::Call { function, .. } = statement
                && in_loop
                && !found.contains(function)
            {
                found.push(*function);
            }
        });
    }
    found
}

/// The spans of a body's loops, outer loops first, each with a flag: `true` if the loop is inside another loop.
fn loops_of(body: &Block) -> Vec<(naga::Span, bool)> {
    let mut found = Vec::new();
    walk(body, false, &mut |statement, span, in_loop| {
        if matches!(statement, Statement::Loop { .. }) {
            found.push((span, in_loop));
        }
    });
    found
}

/// Visits all statements of a block in order, with their spans. `visit` also gets a flag: `true` if the statement is in
/// a loop.
pub(super) fn walk(
    block: &Block,
    in_loop: bool,
    visit: &mut dyn FnMut(&Statement, naga::Span, bool),
) {
    for (statement, span) in block.span_iter() {
        visit(statement, *span, in_loop);
        for (inner, looped) in blocks(statement) {
            walk(inner, in_loop || looped, visit);
        }
    }
}

/// The blocks in a statement, each with a flag: `true` if the statement is a loop, which repeats the block.
fn blocks(statement: &Statement) -> Vec<(&Block, bool)> {
    match statement {
        Statement::Block(block) => vec![(block, false)],
        Statement::If { accept, reject, .. } => vec![(accept, false), (reject, false)],
        Statement::Switch { cases, .. } => cases.iter().map(|case| (&case.body, false)).collect(),
        Statement::Loop { body, continuing, .. } => vec![(body, true), (continuing, true)],
        _ => Vec::new(),
    }
}

/// Inserts a block at the beginning of each loop's body, and another block before the loop. `counted` makes both
/// blocks. `counted` gets the loop's index in the result of [`loops_of`], and `true` for the block before the loop.
fn instrument(block: &mut Block, index: &mut u32, counted: &mut dyn FnMut(u32, bool) -> Block) {
    for (statement, span) in block.span_iter_mut() {
        match statement {
            Statement::Block(inner) => instrument(inner, index, counted),
            Statement::If { accept, reject, .. } => {
                instrument(accept, index, counted);
                instrument(reject, index, counted);
            }
            Statement::Switch { cases, .. } => {
                for case in cases {
                    instrument(&mut case.body, index, counted);
                }
            }
            Statement::Loop { body, continuing, .. } => {
                let own = *index;
                *index += 1;
                instrument(body, index, counted);
                instrument(continuing, index, counted);
                let mut round = counted(own, false);
                round.append(body);
                *body = round;
                let mut entered = counted(own, true);
                let place = span.map_or(NOWHERE, |span| *span);
                entered.push(std::mem::replace(statement, Statement::Kill), place);
                *statement = Statement::Block(entered);
            }
            _ => {}
        }
    }
}

fn global(module: &Module, name: &str) -> Handle<GlobalVariable> {
    let mut globals = module.global_variables.iter();
    let found = globals.find(|(_, global)| global.name.as_deref() == Some(name));
    found.map(|(handle, _)| handle).expect("the text declares it")
}

const NOWHERE: naga::Span = naga::Span::UNDEFINED;

fn count(function: &mut Function, counter: Handle<GlobalVariable>) -> Block {
    let mut add = |expression| function.expressions.append(expression, NOWHERE);
    let pointer = add(Expression::GlobalVariable(counter));
    let one = add(Expression::Literal(Literal::U32(1)));
    let left = add(Expression::Load { pointer });
    let value = add(Expression::Binary { op: BinaryOperator::Add, left, right: one });
    let mut block = Block::new();
    block.push(Statement::Emit(naga::Range::new_from_bounds(left, value)), NOWHERE);
    block.push(Statement::Store { pointer, value }, NOWHERE);
    block
}

#[cfg(test)]
mod tests;
