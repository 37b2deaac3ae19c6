//! Finds upper bounds for the numbers of iterations of loops, from naga's IR.

use std::ops::Range;

use naga::{
    BinaryOperator, Block, Expression, Function, Handle, Literal, LocalVariable, Module, Scalar,
    Statement, TypeInner,
};

use super::{blocks, walk};
use crate::reflect::Program;

impl Program {
    /// The largest number of iterations that all loops together can have in one call of any function of the program.
    /// `None` if the IR shows no such bound.
    pub fn most_rounds(&self) -> Option<u64> {
        let entry_points = self.checked.module.entry_points.iter().map(|entry| &entry.function);
        let mut calls = vec![None; self.checked.module.functions.len()];
        // naga's IR has each function after the functions that it calls.
        for (handle, function) in self.checked.module.functions.iter() {
            calls[handle.index()] =
                Rounds { module: &self.checked.module, function, calls: &calls }.of_function();
        }
        let entries = entry_points.map(|function| {
            Rounds { module: &self.checked.module, function, calls: &calls }.of_function()
        });
        let all: Option<Vec<u64>> = calls.iter().copied().chain(entries).collect();
        all.map(|all| all.into_iter().max().unwrap_or(0))
    }
}

impl Program {
    /// The ranges in the text of all loops that run a constant number of iterations in each call. No `break` or
    /// `return` ends such a loop early.
    pub(crate) fn fixed_loops(&self) -> Vec<Range<usize>> {
        let module = &self.checked.module;
        let entries = module.entry_points.iter().map(|entry| &entry.function);
        let functions = module.functions.iter().map(|(_, function)| function).chain(entries);
        let mut found = Vec::new();
        for function in functions {
            let rounds = Rounds { module, function, calls: &[] };
            rounds.fixed(&function.body, false, &mut found);
        }
        found
    }
}

struct Rounds<'a> {
    module: &'a Module,
    function: &'a Function,
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

    /// The number of iterations of the loop at `index` of `block`. Karat finds this number if the loop's variable runs
    /// from one constant to another in constant steps. For other loops, returns `None`.
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
        // No other statement in the loop may write the counter.
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
        // If the last step leaves the type's range, the counter wraps and the loop never ends.
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

    fn fixed(&self, block: &Block, in_loop: bool, found: &mut Vec<Range<usize>>) {
        for (index, (statement, span)) in block.span_iter().enumerate() {
            if let Statement::Loop { body, .. } = statement
                && self.rounds(block, index, in_loop).is_some()
                && exits(body) == 1
            {
                found.extend(span.to_range());
            }
            for (inner, repeats) in blocks(statement) {
                self.fixed(inner, in_loop || repeats, found);
            }
        }
    }

    fn is_unsigned(&self, variable: Handle<LocalVariable>) -> bool {
        let ty = self.function.local_variables[variable].ty;
        let unsigned = TypeInner::Scalar(Scalar::U32);
        self.module.types[ty].inner == unsigned
    }

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

    /// The value of an integer that is constant in all calls.
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

    /// The constant that a `continuing` block adds to a variable. `None` if the block changes the variable in another
    /// way.
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

    /// The number of times that a statement writes a variable. Statements inside of this statement don't count.
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

    /// The value of a variable at the beginning of a loop: the last constant that `block` stores before the loop, or
    /// the variable's initial value if only the loop's step writes the variable.
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

fn leaves(block: &Block) -> bool {
    matches!(block.first(), Some(Statement::Break)) && block.len() == 1
}

/// The operator that gives the same result as `op` after the operands are swapped: `>` for `<`.
fn flipped(op: BinaryOperator) -> Option<BinaryOperator> {
    Some(match op {
        BinaryOperator::Less => BinaryOperator::Greater,
        BinaryOperator::LessEqual => BinaryOperator::GreaterEqual,
        BinaryOperator::Greater => BinaryOperator::Less,
        BinaryOperator::GreaterEqual => BinaryOperator::LessEqual,
        _ => return None,
    })
}

fn negated(op: BinaryOperator) -> Option<BinaryOperator> {
    Some(match op {
        BinaryOperator::Less => BinaryOperator::GreaterEqual,
        BinaryOperator::LessEqual => BinaryOperator::Greater,
        BinaryOperator::Greater => BinaryOperator::LessEqual,
        BinaryOperator::GreaterEqual => BinaryOperator::Less,
        _ => return None,
    })
}
/// The number of `break` and `return` statements in a loop's body, including the statements in inner loops.
fn exits(body: &Block) -> usize {
    let mut count = 0;
    walk(body, true, &mut |statement, _, _| {
        count += usize::from(matches!(statement, Statement::Break | Statement::Return { .. }));
    });
    count
}
