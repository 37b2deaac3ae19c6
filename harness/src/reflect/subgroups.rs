//! Finds programs in which invocations communicate through subgroups.

use naga::{Binding, BuiltIn, Expression, Function, Handle, Module, TypeInner};

use super::Program;

impl Program {
    /// Checks if the program has subgroup operations, or a builtin value that depends on the subgroup size.
    pub(crate) fn has_subgroups(&self) -> bool {
        self.checked.subgroups
    }

    /// Checks if a function, or a function that it calls, has a subgroup operation.
    pub(super) fn reaches_subgroups(&self, path: &str) -> bool {
        // Few modules have subgroup operations.
        if !self.checked.subgroups {
            return false;
        }
        let mut wanted = vec![path.to_owned()];
        let mut seen = std::collections::BTreeSet::new();
        while let Some(path) = wanted.pop() {
            let own = self.declared(self.name_of(&path));
            if own.is_some_and(|(_, function)| operates(function)) {
                return true;
            }
            wanted.extend(self.calls(&path).into_iter().filter(|called| !seen.contains(called)));
            seen.insert(path);
        }
        false
    }
}

fn operates(function: &Function) -> bool {
    let is_result = |expression: &Expression| {
        matches!(
            expression,
            Expression::SubgroupBallotResult | Expression::SubgroupOperationResult { .. }
        )
    };
    function.expressions.iter().any(|(_, expression)| is_result(expression))
}

pub(super) fn has_subgroups(module: &Module) -> bool {
    let is_own = |binding: &Option<Binding>| {
        matches!(
            binding,
            Some(Binding::BuiltIn(
                BuiltIn::SubgroupSize
                    | BuiltIn::SubgroupInvocationId
                    | BuiltIn::SubgroupId
                    | BuiltIn::NumSubgroups
            ))
        )
    };
    let given = |ty: Handle<naga::Type>| match &module.types[ty].inner {
        TypeInner::Struct { members, .. } => members.iter().any(|one| is_own(&one.binding)),
        _ => false,
    };
    let entries = module.entry_points.iter().map(|entry| &entry.function);
    let is_given = |one: &naga::FunctionArgument| is_own(&one.binding) || given(one.ty);
    entries.clone().any(|entry| entry.arguments.iter().any(is_given))
        || module.functions.iter().map(|(_, one)| one).chain(entries).any(operates)
}
