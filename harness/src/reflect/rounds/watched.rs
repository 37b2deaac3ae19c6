//! Counts the iterations of loops in frames. An invocation that draws can't return its counters. So if a loop takes too
//! many iterations, the invocation writes the number of iterations to a buffer.

use naga::{
    AtomicFunction, BinaryOperator, Block, Expression, Function, GlobalVariable, Literal, Scalar,
    Statement, Type, TypeInner,
};

use super::{NOWHERE, Nesting, instrument, loops_of};
use crate::diagnostic::Span;
use crate::reflect::Program;

const OWN: &str = "karat_rounds";

/// A frame's program whose invocations report loops that took too many iterations.
pub struct Watched {
    /// The program that counts.
    pub program: Program,
    /// The location of each loop in the author's file.
    pub loops: Vec<Option<Span>>,
}

impl Watched {
    /// The name of the buffer in which invocations store their numbers of iterations. The buffer has one element for
    /// each loop.
    pub(crate) const VARIABLE: &str = "karat_most";
}

impl Program {
    /// A copy of the program whose invocations report too many iterations. If an invocation reaches `limit` iterations
    /// in all its loops together, the invocation writes the number of iterations to the current loop's element of a
    /// storage buffer. The buffer is at `binding` of group 0. If `leave` is `true`, the invocation also leaves the
    /// loop.
    pub fn watching_rounds(&self, binding: u32, limit: u32, leave: bool) -> Watched {
        let loops: Vec<_> = self
            .bodies()
            .flat_map(loops_of)
            .map(|(span, _)| span.to_range().and_then(|range| self.resolve(range)))
            .collect();
        let mut module = self.checked.module.clone();
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

        // A driver runs a loop that no invocation enters once, in each iteration of the code around the loop.
        let weights = Nesting::of(&module).weights();
        let mut index = 0;
        let mut watch = |function: &mut Function| {
            let mut body = std::mem::take(&mut function.body);
            instrument(&mut body, &mut index, &mut |loop_index, enters| {
                let mut block = Block::new();
                if enters {
                    return block;
                }
                let mut add = |expression| function.expressions.append(expression, NOWHERE);
                let pointer = add(Expression::GlobalVariable(own));
                let weight = weights.get(loop_index as usize).copied().unwrap_or(1);
                let one = add(Expression::Literal(Literal::U32(weight)));
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
                if leave {
                    accept.push(Statement::Break, NOWHERE);
                }
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

    fn bodies(&self) -> impl Iterator<Item = &Block> {
        let functions = self.checked.module.functions.iter().map(|(_, function)| &function.body);
        functions.chain(self.checked.module.entry_points.iter().map(|entry| &entry.function.body))
    }
}
