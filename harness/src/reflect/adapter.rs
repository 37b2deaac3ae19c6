//! Wraps a function with pointer parameters in a function that takes and returns values.

use naga::{
    Arena, Block, Expression, Function, FunctionArgument, FunctionResult, GlobalVariable, Handle,
    LocalVariable, Module, Span, Statement, StructMember, Type, TypeInner,
};

use super::signature::Function as Signature;
use super::{Passed, Program, ReflectError};
use naga::valid::ModuleInfo;

pub(crate) const ADAPTER: &str = "karat_call";

impl Program {
    /// Returns a copy of the module with an additional function [`ADAPTER`]. The function [`ADAPTER`] takes values,
    /// calls `function` with pointers to them, and returns the result of `function` and the values behind the pointers.
    /// `None` if `function` needs no such wrapper, because it takes only values and returns a result.
    pub(crate) fn adapted(
        &self,
        function: &Signature,
    ) -> Result<Option<(Module, ModuleInfo)>, ReflectError> {
        let plain = function.form.passed.iter().all(|passed| *passed == Passed::Value);
        if plain && function.form.returns.is_some() {
            return Ok(None);
        }
        let mut module = self.module().clone();
        let name = Some(function.linked.as_str());
        let found = module.functions.iter().find(|(_, known)| known.name.as_deref() == name);
        let Some((callee, _)) = found else { return Ok(None) };
        let state = function.form.passed.iter().filter_map(|passed| match passed {
            Passed::State(name) => Some(name.as_str()),
            _ => None,
        });
        let adapter = adapter(&mut module, callee, &state.collect::<Vec<_>>());
        module.functions.append(adapter, Span::UNDEFINED);
        let program = Self::from_ir(self.linked.clone(), module)?;
        let checked = std::sync::Arc::into_inner(program.checked);
        Ok(checked.map(|checked| (checked.module, checked.info)))
    }
}

fn adapter(module: &mut Module, callee: Handle<Function>, state: &[&str]) -> Function {
    let called = module.functions[callee].clone();
    let mut expressions: Arena<Expression> = Arena::new();
    let mut body = Block::new();
    let mut local_variables = Arena::new();
    let mut arguments = Vec::new();
    let (mut given, mut pointers) = (Vec::new(), Vec::new());
    for (index, argument) in (0..).zip(&called.arguments) {
        let value = expressions.append(Expression::FunctionArgument(index), Span::UNDEFINED);
        let TypeInner::Pointer { base, space } = module.types[argument.ty].inner else {
            arguments.push(FunctionArgument { binding: None, ..argument.clone() });
            given.push(value);
            continue;
        };
        arguments.push(FunctionArgument { name: None, ty: base, binding: None });
        let pointer = if space == naga::AddressSpace::Private {
            let variable = module.global_variables.append(
                GlobalVariable {
                    name: None,
                    space,
                    binding: None,
                    ty: base,
                    init: None,
                    memory_decorations: naga::MemoryDecorations::empty(),
                },
                Span::UNDEFINED,
            );
            Expression::GlobalVariable(variable)
        } else {
            let variable = LocalVariable { name: None, ty: base, init: None };
            Expression::LocalVariable(local_variables.append(variable, Span::UNDEFINED))
        };
        let pointer = expressions.append(pointer, Span::UNDEFINED);
        body.push(Statement::Store { pointer, value }, Span::UNDEFINED);
        given.push(pointer);
        pointers.push((pointer, base));
    }
    for (index, name) in (called.arguments.len()..).zip(state) {
        let mut declared = module.global_variables.iter();
        let found = declared.find(|(_, one)| one.name.as_deref() == Some(name));
        let (variable, ty) = found.map(|(handle, one)| (handle, one.ty)).expect("it is declared");
        arguments.push(FunctionArgument { name: None, ty, binding: None });
        let index = u32::try_from(index).expect("naga numbers arguments so");
        let value = expressions.append(Expression::FunctionArgument(index), Span::UNDEFINED);
        let pointer = Expression::GlobalVariable(variable);
        let pointer = expressions.append(pointer, Span::UNDEFINED);
        body.push(Statement::Store { pointer, value }, Span::UNDEFINED);
        pointers.push((pointer, ty));
    }
    let result = called.result.as_ref().map(|result| {
        (expressions.append(Expression::CallResult(callee), Span::UNDEFINED), result.ty)
    });
    let call = Statement::Call {
        function: callee,
        arguments: given,
        result: result.map(|(result, _)| result),
    };
    body.push(call, Span::UNDEFINED);
    let before = expressions.len();
    let mut outputs: Vec<(Handle<Expression>, Handle<Type>)> = result.into_iter().collect();
    for (pointer, ty) in pointers {
        outputs.push((expressions.append(Expression::Load { pointer }, Span::UNDEFINED), ty));
    }
    let returned = match &*outputs {
        [] => None,
        [one] => Some(*one),
        several => {
            let ty = structure(module, several.iter().map(|(_, ty)| *ty));
            let components = several.iter().map(|(value, _)| *value).collect();
            let value = Expression::Compose { ty, components };
            Some((expressions.append(value, Span::UNDEFINED), ty))
        }
    };
    if expressions.len() > before {
        body.push(Statement::Emit(expressions.range_from(before)), Span::UNDEFINED);
    }
    body.push(Statement::Return { value: returned.map(|(value, _)| value) }, Span::UNDEFINED);
    Function {
        name: Some(ADAPTER.to_owned()),
        arguments,
        result: returned.map(|(_, ty)| FunctionResult { ty, binding: None }),
        local_variables,
        expressions,
        body,
        ..Function::default()
    }
}

fn structure(module: &mut Module, types: impl Iterator<Item = Handle<Type>>) -> Handle<Type> {
    /// The offsets of members are multiples of this number. No type in WGSL has a larger alignment, so such offsets are
    /// valid.
    const APART: u32 = 16;
    let mut members = Vec::new();
    let mut end = 0;
    for (index, ty) in types.enumerate() {
        members.push(StructMember {
            name: Some(format!("m{index}")),
            ty,
            binding: None,
            offset: end,
        });
        end += module.types[ty].inner.size(module.to_ctx()).next_multiple_of(APART);
    }
    let inner = TypeInner::Struct { members, span: end };
    module.types.insert(Type { name: None, inner }, Span::UNDEFINED)
}
