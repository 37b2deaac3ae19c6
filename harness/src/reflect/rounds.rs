//! How often loops go round.
//!
//! Some drivers leave all loops of an invocation after a number of rounds, with whatever values
//! there are then. Where naga's IR shows that loops end sooner there is nothing to watch. Where it
//! doesn't, rounds are counted by a copy of the kernel whose loops count; the verdict's own kernel
//! stays the author's text.

use naga::{
    AtomicFunction, BinaryOperator, Block, Expression, Function, GlobalVariable, Handle, Literal,
    LocalVariable, Module, Scalar, Statement, Type, TypeInner,
};

use std::sync::Arc;

use super::Program;
use crate::diagnostic::Span;

/// The counters' name in a kernel that counts: a private array with an element a loop.
pub(crate) const COUNTERS: &str = "karat_rounds";

impl Program {
    /// The most rounds that all loops of a call make together, whichever function is called;
    /// `None` where the IR shows no bound.
    pub(crate) fn most_rounds(&self) -> Option<u64> {
        let entry_points = self.module.entry_points.iter().map(|entry| &entry.function);
        let mut calls = vec![None; self.module.functions.len()];
        // naga's functions stand after those that they call.
        for (handle, function) in self.module.functions.iter() {
            calls[handle.index()] =
                Rounds { module: &self.module, function, calls: &calls }.of_function();
        }
        let entries = entry_points
            .map(|function| Rounds { module: &self.module, function, calls: &calls }.of_function());
        let all: Option<Vec<u64>> = calls.iter().copied().chain(entries).collect();
        all.map(|all| all.into_iter().max().unwrap_or(0))
    }

    /// How many loops there are, in the order in which [`count_rounds`] numbers them.
    pub(crate) fn loops(&self) -> usize {
        let functions = self.module.functions.iter().map(|(_, function)| &function.body);
        functions.map(|body| loops_of(body).len()).sum()
    }
}

/// A module whose loops count their rounds, and the author's place of each loop.
pub(crate) struct Counting {
    pub(crate) module: Module,
    pub(crate) loops: Vec<CountedLoop>,
}

/// A loop whose rounds are counted.
#[derive(Clone, Debug)]
pub(crate) struct CountedLoop {
    /// The author's place.
    pub(crate) span: Option<Span>,
    /// Whether it is inside of another loop of its function, or its function is called in a loop.
    pub(crate) nested: bool,
}

/// Lets each loop of a kernel's functions add 1 to an element of [`COUNTERS`] in each round.
/// `text` is the program's text and the kernel behind it, which declares the counters.
///
/// # Panics
/// If the kernel doesn't parse: it is the verdict's but for the counters.
pub(crate) fn count_rounds(program: &Program, text: &str) -> Counting {
    let module = super::parsed(text).expect("it is the verdict's kernel but for the counters");
    let mut module = Arc::unwrap_or_clone(module);
    let counters = global(&module, COUNTERS);
    let mut loops = Vec::new();
    for (_, function) in module.functions.iter() {
        for (span, nested) in loops_of(&function.body) {
            let span = span.to_range().and_then(|range| program.resolve(range));
            loops.push(CountedLoop { span, nested });
        }
    }
    let mut index = 0;
    let handles: Vec<_> = module.functions.iter().map(|(handle, _)| handle).collect();
    let called_in_loops = called_in_loops(&module);
    for handle in handles {
        let function = module.functions.get_mut(handle);
        let mut body = std::mem::take(&mut function.body);
        let first = index;
        instrument(&mut body, &mut index, &mut |own| count(function, counters, own));
        function.body = body;
        if called_in_loops.contains(&handle) {
            loops[first as usize..index as usize]
                .iter_mut()
                .for_each(|counted| counted.nested = true);
        }
    }
    Counting { module, loops }
}

/// The functions that are called in a loop, or by such a function.
fn called_in_loops(module: &Module) -> Vec<Handle<Function>> {
    let mut found: Vec<Handle<Function>> = Vec::new();
    // Callers stand behind what they call: the last first.
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

/// The loops of a body with their places, outer ones first, and whether a loop is around them.
fn loops_of(body: &Block) -> Vec<(naga::Span, bool)> {
    let mut found = Vec::new();
    walk(body, false, &mut |statement, span, in_loop| {
        if matches!(statement, Statement::Loop { .. }) {
            found.push((span, in_loop));
        }
    });
    found
}

/// Visits all statements of a block in order, with their places and whether a loop is around.
fn walk(block: &Block, in_loop: bool, visit: &mut dyn FnMut(&Statement, naga::Span, bool)) {
    for (statement, span) in block.span_iter() {
        visit(statement, *span, in_loop);
        for (inner, looped) in blocks(statement) {
            walk(inner, in_loop || looped, visit);
        }
    }
}

/// The blocks of a statement, and whether it repeats them.
fn blocks(statement: &Statement) -> Vec<(&Block, bool)> {
    match statement {
        Statement::Block(block) => vec![(block, false)],
        Statement::If { accept, reject, .. } => vec![(accept, false), (reject, false)],
        Statement::Switch { cases, .. } => cases.iter().map(|case| (&case.body, false)).collect(),
        Statement::Loop { body, continuing, .. } => vec![(body, true), (continuing, true)],
        _ => Vec::new(),
    }
}

/// Puts what `counted` makes for a loop at the beginning of its rounds; loops are numbered in the
/// order of [`loops_of`].
fn instrument(block: &mut Block, index: &mut u32, counted: &mut dyn FnMut(u32) -> Block) {
    for statement in block.iter_mut() {
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
                let mut round = counted(own);
                round.append(body);
                *body = round;
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

/// Adds 1 to an element of an array.
fn count(function: &mut Function, counters: Handle<GlobalVariable>, index: u32) -> Block {
    let mut add = |expression| function.expressions.append(expression, NOWHERE);
    let base = add(Expression::GlobalVariable(counters));
    let one = add(Expression::Literal(Literal::U32(1)));
    let pointer = add(Expression::AccessIndex { base, index });
    let left = add(Expression::Load { pointer });
    let value = add(Expression::Binary { op: BinaryOperator::Add, left, right: one });
    let mut block = Block::new();
    block.push(Statement::Emit(naga::Range::new_from_bounds(pointer, value)), NOWHERE);
    block.push(Statement::Store { pointer, value }, NOWHERE);
    block
}

/// The variable that holds the rounds of an invocation of a frame's shader.
const OWN: &str = "karat_rounds";

/// A frame's program whose invocations tell which loop made their rounds too many.
pub(crate) struct Watched {
    pub(crate) program: Program,
    /// The author's place of each loop.
    pub(crate) loops: Vec<Option<Span>>,
}

impl Watched {
    /// The buffer where invocations leave how often they went round, an element a loop.
    pub(crate) const VARIABLE: &str = "karat_most";
}

impl Program {
    /// A copy in which an invocation that has made `limit` rounds in all its loops writes their
    /// number to the storage buffer at this binding of group 0, at the index of the loop.
    pub(crate) fn watching_rounds(&self, binding: u32, limit: u32) -> Watched {
        let loops: Vec<_> = self
            .bodies()
            .flat_map(loops_of)
            .map(|(span, _)| span.to_range().and_then(|range| self.resolve(range)))
            .collect();
        let mut module = self.module.clone();
        let scalar = |inner| Type { name: None, inner };
        let u32_type = module.types.insert(scalar(TypeInner::Scalar(Scalar::U32)), NOWHERE);
        let atomic = module.types.insert(scalar(TypeInner::Atomic(Scalar::U32)), NOWHERE);
        let length = u32::try_from(loops.len()).ok().and_then(std::num::NonZeroU32::new);
        let size = naga::ArraySize::Constant(length.expect("there are loops to watch"));
        let array = TypeInner::Array { base: atomic, size, stride: 4 };
        let array = module.types.insert(scalar(array), NOWHERE);
        let variable = |name: &str, space, binding, ty| GlobalVariable {
            name: Some(name.to_owned()),
            space,
            binding,
            ty,
            init: None,
            memory_decorations: naga::MemoryDecorations::empty(),
        };
        let own = variable(OWN, naga::AddressSpace::Private, None, u32_type);
        let own = module.global_variables.append(own, NOWHERE);
        let access = naga::StorageAccess::LOAD | naga::StorageAccess::STORE;
        let place = Some(naga::ResourceBinding { group: 0, binding });
        let most =
            variable(Watched::VARIABLE, naga::AddressSpace::Storage { access }, place, array);
        let most = module.global_variables.append(most, NOWHERE);

        let mut index = 0;
        let mut watch = |function: &mut Function| {
            let mut body = std::mem::take(&mut function.body);
            instrument(&mut body, &mut index, &mut |loop_index| {
                let mut block = Block::new();
                let mut add = |expression| function.expressions.append(expression, NOWHERE);
                let pointer = add(Expression::GlobalVariable(own));
                let one = add(Expression::Literal(Literal::U32(1)));
                let right = add(Expression::Literal(Literal::U32(limit)));
                let left = add(Expression::Load { pointer });
                let value = add(Expression::Binary { op: BinaryOperator::Add, left, right: one });
                let op = BinaryOperator::GreaterEqual;
                let condition = add(Expression::Binary { op, left: value, right });
                let emitted = naga::Range::new_from_bounds(left, condition);
                block.push(Statement::Emit(emitted), NOWHERE);
                block.push(Statement::Store { pointer, value }, NOWHERE);

                let base = add(Expression::GlobalVariable(most));
                let result = add(Expression::AtomicResult { ty: u32_type, comparison: false });
                let pointer = add(Expression::AccessIndex { base, index: loop_index });
                let mut accept = Block::new();
                let emitted = naga::Range::new_from_bounds(pointer, pointer);
                accept.push(Statement::Emit(emitted), NOWHERE);
                let fun = AtomicFunction::Max;
                let atomic = Statement::Atomic { pointer, fun, value, result: Some(result) };
                accept.push(atomic, NOWHERE);
                let reject = Block::new();
                block.push(Statement::If { condition, accept, reject }, NOWHERE);
                block
            });
            function.body = body;
        };
        let handles: Vec<_> = module.functions.iter().map(|(handle, _)| handle).collect();
        for handle in handles {
            watch(module.functions.get_mut(handle));
        }
        for entry in &mut module.entry_points {
            watch(&mut entry.function);
        }
        let program = Self::from_ir(self.linked.clone(), module);
        let program = program.expect("it was valid before its loops were watched");
        Watched { program, loops }
    }

    /// The bodies of functions, then of entry points.
    fn bodies(&self) -> impl Iterator<Item = &Block> {
        let functions = self.module.functions.iter().map(|(_, function)| &function.body);
        functions.chain(self.module.entry_points.iter().map(|entry| &entry.function.body))
    }
}

/// Looks for bounds in one function.
struct Rounds<'a> {
    module: &'a Module,
    function: &'a Function,
    /// The rounds of functions, by their index.
    calls: &'a [Option<u64>],
}

impl Rounds<'_> {
    fn of_function(&self) -> Option<u64> {
        self.of_block(&self.function.body, false)
    }

    fn of_block(&self, block: &Block, in_loop: bool) -> Option<u64> {
        let mut sum = 0_u64;
        for (index, statement) in block.iter().enumerate() {
            let rounds = match statement {
                Statement::Call { function, .. } => self.calls[function.index()]?,
                Statement::Loop { body, continuing, .. } => {
                    let inner =
                        self.of_block(body, true)?.checked_add(self.of_block(continuing, true)?)?;
                    let rounds = self.rounds(block, index, in_loop)?;
                    rounds.checked_mul(inner.checked_add(1)?)?
                }
                other => {
                    let inner = blocks(other).into_iter();
                    let inner: Option<Vec<u64>> =
                        inner.map(|(block, _)| self.of_block(block, in_loop)).collect();
                    inner?.into_iter().try_fold(0_u64, u64::checked_add)?
                }
            };
            sum = sum.checked_add(rounds)?;
        }
        Some(sum)
    }

    /// The rounds of the loop at `index` of `block`, if it counts a variable of its own from one
    /// constant to another in constant steps.
    fn rounds(&self, block: &Block, index: usize, in_loop: bool) -> Option<u64> {
        let Statement::Loop { body, continuing, .. } = &block[index] else { return None };
        let condition = body.iter().find_map(|statement| match statement {
            Statement::If { condition, accept, reject } if leaves(reject) && accept.is_empty() => {
                Some(Some((*condition, true)))
            }
            Statement::If { condition, accept, reject } if leaves(accept) && reject.is_empty() => {
                Some(Some((*condition, false)))
            }
            Statement::Emit(_) => None,
            _ => Some(None),
        });
        let (condition, stays) = condition.flatten()?;
        let expressions = &self.function.expressions;
        let Expression::Binary { op, left, right } = expressions[condition] else { return None };
        let (variable, op, end) = match (self.loaded(left), self.loaded(right)) {
            (Some(variable), None) => (variable, op, self.constant(right)?),
            (None, Some(variable)) => (variable, flipped(op)?, self.constant(left)?),
            _ => return None,
        };
        let op = if stays { op } else { negated(op)? };
        let step = self.step(continuing, variable)?;
        // Nothing else in the loop may write the counter.
        let mut writes = 0;
        for inner in [body, continuing] {
            walk(inner, true, &mut |statement, _, _| writes += self.writes(statement, variable));
        }
        if writes != 1 {
            return None;
        }
        let start = self.start(block, index, variable, in_loop)?;
        let span = match op {
            BinaryOperator::Less if step > 0 => end - start,
            BinaryOperator::LessEqual if step > 0 => end - start + 1,
            BinaryOperator::Greater if step < 0 => start - end,
            BinaryOperator::GreaterEqual if step < 0 => start - end + 1,
            _ => return None,
        };
        // Where the last step would leave the type's range, the counter wraps and never ends.
        let last = end + step * 2;
        if !(i128::from(i32::MIN)..=i128::from(u32::MAX)).contains(&last)
            || (self.is_unsigned(variable) && last < 0)
            || (!self.is_unsigned(variable) && last > i128::from(i32::MAX))
        {
            return None;
        }
        let step = step.abs();
        u64::try_from((span.max(0) + step - 1) / step).ok()
    }

    fn is_unsigned(&self, variable: Handle<LocalVariable>) -> bool {
        let ty = self.function.local_variables[variable].ty;
        let unsigned = TypeInner::Scalar(Scalar::U32);
        self.module.types[ty].inner == unsigned
    }

    /// The variable that an expression loads.
    fn loaded(&self, expression: Handle<Expression>) -> Option<Handle<LocalVariable>> {
        let Expression::Load { pointer } = self.function.expressions[expression] else {
            return None;
        };
        self.variable(pointer)
    }

    fn variable(&self, pointer: Handle<Expression>) -> Option<Handle<LocalVariable>> {
        match self.function.expressions[pointer] {
            Expression::LocalVariable(variable) => Some(variable),
            _ => None,
        }
    }

    /// The value of an integer that is the same in all calls.
    fn constant(&self, expression: Handle<Expression>) -> Option<i128> {
        let literal = |expression: &Expression| match expression {
            Expression::Literal(Literal::U32(value)) => Some(i128::from(*value)),
            Expression::Literal(Literal::I32(value)) => Some(i128::from(*value)),
            _ => None,
        };
        match &self.function.expressions[expression] {
            Expression::Constant(constant) => {
                literal(&self.module.global_expressions[self.module.constants[*constant].init])
            }
            other => literal(other),
        }
    }

    /// By how much a `continuing` block changes a variable, if that is all it does to it.
    fn step(&self, continuing: &Block, variable: Handle<LocalVariable>) -> Option<i128> {
        let mut stores = continuing.iter().filter_map(|statement| match statement {
            Statement::Store { pointer, value } if self.variable(*pointer) == Some(variable) => {
                Some(*value)
            }
            _ => None,
        });
        let (value, None) = (stores.next()?, stores.next()) else { return None };
        let Expression::Binary { op, left, right } = self.function.expressions[value] else {
            return None;
        };
        if self.loaded(left) != Some(variable) {
            return None;
        }
        let step = match op {
            BinaryOperator::Add => self.constant(right)?,
            BinaryOperator::Subtract => -self.constant(right)?,
            _ => return None,
        };
        (step != 0).then_some(step)
    }

    /// How often a statement itself may write a variable.
    fn writes(&self, statement: &Statement, variable: Handle<LocalVariable>) -> u32 {
        let touches = |pointer: &Handle<Expression>| self.variable(*pointer) == Some(variable);
        match statement {
            Statement::Store { pointer, .. } | Statement::Atomic { pointer, .. } => {
                u32::from(touches(pointer))
            }
            Statement::Call { arguments, .. } => {
                u32::try_from(arguments.iter().filter(|a| touches(a)).count()).unwrap_or(u32::MAX)
            }
            _ => 0,
        }
    }

    /// The value of a variable where a loop begins: the last one that the same block stores, or
    /// the one that it is declared with if nothing else writes it.
    fn start(
        &self,
        block: &Block,
        index: usize,
        variable: Handle<LocalVariable>,
        in_loop: bool,
    ) -> Option<i128> {
        for statement in block.iter().take(index).rev() {
            match statement {
                Statement::Store { pointer, value }
                    if self.variable(*pointer) == Some(variable) =>
                {
                    return self.constant(*value);
                }
                other => {
                    let mut writes = self.writes(other, variable);
                    for (inner, _) in blocks(other) {
                        walk(inner, false, &mut |s, _, _| writes += self.writes(s, variable));
                    }
                    if writes > 0 {
                        return None;
                    }
                }
            }
        }
        let mut writes = 0;
        walk(&self.function.body, false, &mut |s, _, _| writes += self.writes(s, variable));
        let declared = self.function.local_variables[variable].init;
        (writes == 1 && !in_loop).then(|| self.constant(declared?)).flatten()
    }
}

/// Whether a block does nothing but leave the loop.
fn leaves(block: &Block) -> bool {
    matches!(block.first(), Some(Statement::Break)) && block.len() == 1
}

/// The operator with its sides swapped.
fn flipped(op: BinaryOperator) -> Option<BinaryOperator> {
    Some(match op {
        BinaryOperator::Less => BinaryOperator::Greater,
        BinaryOperator::LessEqual => BinaryOperator::GreaterEqual,
        BinaryOperator::Greater => BinaryOperator::Less,
        BinaryOperator::GreaterEqual => BinaryOperator::LessEqual,
        _ => return None,
    })
}

/// The operator that holds where this one doesn't.
fn negated(op: BinaryOperator) -> Option<BinaryOperator> {
    Some(match op {
        BinaryOperator::Less => BinaryOperator::GreaterEqual,
        BinaryOperator::LessEqual => BinaryOperator::Greater,
        BinaryOperator::Greater => BinaryOperator::LessEqual,
        BinaryOperator::GreaterEqual => BinaryOperator::Less,
        _ => return None,
    })
}

#[cfg(test)]
mod tests;
