//! Lists a function's parameters and variables, with their types as WGSL text.

use std::collections::BTreeMap;

use naga::common::wgsl::TypeContext;

use super::Program;

/// A function's name, the types of its parameters, and the names and types of its variables. From these names and
/// types, Karat generates WGSL that calls the function and stores its variables.
pub(crate) struct Locals<'p> {
    pub(crate) function: &'p str,
    pub(crate) parameters: Vec<String>,
    pub(crate) variables: BTreeMap<&'p str, String>,
}

impl Program {
    /// The parameters and variables of the function with this path in the author's code.
    pub(crate) fn locals<'p>(&'p self, path: &'p str) -> Option<Locals<'p>> {
        let function = self.name_of(path);
        let named = |f: &naga::Function| f.name.as_deref() == Some(function);
        let (_, found) = self.checked.module.functions.iter().find(|(_, f)| named(f))?;
        let types = self.checked.module.to_ctx();
        let parameters = found.arguments.iter().map(|one| types.type_to_string(one.ty)).collect();
        let variable = |(_, variable): (_, &'p naga::LocalVariable)| {
            Some((variable.name.as_deref()?, types.type_to_string(variable.ty)))
        };
        let variables = found.local_variables.iter().filter_map(variable).collect();
        Some(Locals { function, parameters, variables })
    }
}
