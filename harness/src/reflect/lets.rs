//! The let-bindings of a function.

use std::ops::Range;

use naga::common::wgsl::TypeContext;
use naga::{Expression, TypeInner};

use super::Program;

/// A function's let-bindings, and what it takes to call it from the same text.
pub(crate) struct Lets<'p> {
    /// Its name in the text.
    pub(crate) function: &'p str,
    /// The types of its parameters, as WGSL.
    pub(crate) parameters: Vec<String>,
    pub(crate) bindings: Vec<LetBinding>,
}

/// A value that a `let` binds.
pub(crate) struct LetBinding {
    /// Its expression in the text.
    pub(crate) value: Range<usize>,
    /// Its type, as WGSL.
    pub(crate) ty: String,
}

impl Program {
    /// The let-bindings of a function, by its author's path; not those of pointers and parameters.
    pub(crate) fn let_bindings(&self, path: &str) -> Option<Lets<'_>> {
        let name = self.name_of(path);
        let (handle, function) =
            self.module.functions.iter().find(|(_, f)| f.name.as_deref() == Some(name))?;
        let (types, info) = (self.module.to_ctx(), &self.info[handle]);
        let parameters =
            function.arguments.iter().map(|argument| types.type_to_string(argument.ty)).collect();
        let bindings = function.named_expressions.keys().filter_map(|expression| {
            let ty = &info[*expression].ty;
            let pointer = matches!(
                ty.inner_with(&self.module.types),
                TypeInner::Pointer { .. } | TypeInner::ValuePointer { .. }
            );
            let parameter =
                matches!(function.expressions[*expression], Expression::FunctionArgument(_));
            let value = function.expressions.get_span(*expression).to_range()?;
            let ty = types.type_resolution_to_string(ty);
            (!pointer && !parameter).then_some(LetBinding { value, ty })
        });
        let function_name = function.name.as_deref().unwrap_or_default();
        Some(Lets { function: function_name, parameters, bindings: bindings.collect() })
    }
}
