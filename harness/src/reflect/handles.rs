//! Makes functions with texture and sampler parameters callable. Each such parameter becomes a variable, and a
//! fixture with the parameter's name supplies the variable.
//!
//! Karat appends a variable for each texture and sampler parameter to the linked text. Karat also appends a function
//! that takes only the other arguments, and calls the author's function with these arguments and the variables. Karat
//! calls the appended function in place of the author's function.

use std::fmt::Write;

use naga::common::wgsl::TypeContext as _;
use naga::{Function, Handle, Statement, Type, TypeInner};

use super::{NAMED, Program};
use crate::package::Linked;

const CALLED: &str = "karat_bound";

const VARIABLE: &str = "karat_t";

impl Program {
    /// The linked text with variables in place of a function's textures and samplers. Returns `None` if the function
    /// takes neither textures nor samplers, or if Karat can't pass one of the other parameters.
    pub(super) fn with_variables(&self, path: &str) -> Option<Linked> {
        let name = self.called_name(self.name_of(path));
        let (_, function) = self.declared(name)?;
        function.arguments.iter().find(|argument| self.is_handle(argument.ty))?;
        let module = &self.checked.module;
        let (mut variables, mut parameters, mut passed) = (String::new(), Vec::new(), Vec::new());
        let mut linked = self.linked.clone();
        let mut binding = self.free_binding();
        for (index, argument) in function.arguments.iter().enumerate() {
            let own = argument.name.as_deref().expect(NAMED);
            if self.is_handle(argument.ty) {
                let variable = format!("{VARIABLE}{index}");
                write!(variables, "@group(0) @binding({binding}) var {variable}: ").ok()?;
                module.to_ctx().write_type(argument.ty, &mut variables).ok()?;
                variables.push_str(";\n");
                binding += 1;
                // If a variable has the same name as the parameter, the parameter's path distinguishes the two.
                let own = match self.has_variable(own) {
                    true => format!("{path}::{own}"),
                    false => own.to_owned(),
                };
                linked.names.insert(variable.clone(), own);
                passed.push(variable);
            } else {
                let (ty, how) = self.passed(argument.ty);
                let shape = self.shape(ty).ok()?;
                let ty = match how.space() {
                    None => shape.to_string(),
                    Some(space) => format!("ptr<{space}, {shape}>"),
                };
                parameters.push(format!("karat_a{index}: {ty}"));
                passed.push(format!("karat_a{index}"));
            }
        }
        let (parameters, passed) = (parameters.join(", "), passed.join(", "));
        let body = match &function.result {
            None => format!("fn {CALLED}({parameters}) {{ {name}({passed}); }}\n"),
            Some(result) => {
                let result = self.shape(result.ty).ok()?;
                format!("fn {CALLED}({parameters}) -> {result} {{ return {name}({passed}); }}\n")
            }
        };
        linked.spliced.append(&format!("\n{variables}{body}"));
        Some(linked)
    }

    /// The appended function that Karat calls in place of `function`, if there is one.
    pub(super) fn called_for(&self, function: &Function) -> Option<(Handle<Function>, &Function)> {
        function.arguments.iter().find(|argument| self.is_handle(argument.ty))?;
        self.declared(CALLED)
    }

    pub(super) fn taken(&self, function: &Function) -> Vec<(usize, String, String)> {
        let types = self.checked.module.to_ctx();
        let arguments = function.arguments.iter().enumerate();
        let handles = arguments.filter(|(_, argument)| self.is_handle(argument.ty));
        let one = |(place, argument): (usize, &naga::FunctionArgument)| {
            (place, argument.name.clone().expect(NAMED), types.type_to_string(argument.ty))
        };
        handles.map(one).collect()
    }

    /// The author's function with the texture or sampler parameter that became this variable.
    pub(super) fn taken_by(&self, variable: &str) -> Option<Handle<Function>> {
        let (_, called) = self.declared(CALLED).filter(|_| variable.starts_with(VARIABLE))?;
        called.body.iter().find_map(|statement| match statement {
            Statement::Call { function, .. } => Some(*function),
            _ => None,
        })
    }

    fn has_variable(&self, own: &str) -> bool {
        let variables = self.checked.module.global_variables.iter();
        let mut names = variables.filter_map(|(_, variable)| variable.name.as_deref());
        names.any(|name| self.author_path(name).unwrap_or(name).rsplit("::").next() == Some(own))
    }

    pub(super) fn declared(&self, name: &str) -> Option<(Handle<Function>, &Function)> {
        let mut functions = self.checked.module.functions.iter();
        functions.find(|(_, function)| function.name.as_deref() == Some(name))
    }

    pub(super) fn is_handle(&self, ty: Handle<Type>) -> bool {
        let inner = &self.checked.module.types[ty].inner;
        matches!(inner, TypeInner::Image { .. } | TypeInner::Sampler { .. })
    }
}
