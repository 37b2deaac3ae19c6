//! Describes a function's parameters, result and resources.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

use naga::common::wgsl::{TryToWgsl, TypeContext as _};
use naga::valid::{GlobalUse, ShaderStages};

use super::binding::Binding;
use super::{BindingKind, NAMED, Program, ReflectError, Stage, Texels};
use crate::diagnostic::{Diagnostic, Span};
use crate::package::KERNEL_PREFIX;
use crate::value::{Scalar, Shape};

/// A function that a kernel can call.
#[derive(Clone, Debug)]
pub struct Function {
    /// The author's path: `fresnel::schlick`.
    pub name: String,
    pub(crate) linked: String,
    /// The function's location in the author's file, from `fn` to the closing brace.
    pub span: Span,
    /// The comment lines (`///`) above the function.
    pub doc: String,
    /// The name and the type of each parameter. A pointer has the type of its value.
    pub parameters: Vec<(String, Shape)>,
    /// The type of everything that Karat gets from a call: the function's result, then the values behind the function's
    /// pointers, then the resources that the function writes. If there are several values, the type is a structure with
    /// a member for each value.
    pub result: Shape,
    /// The resources that the function uses, directly or through functions that it calls.
    pub bindings: Vec<Binding>,
    /// The way in which Karat calls the function.
    pub form: Form,
}

/// The way in which Karat calls a function.
#[derive(Clone, Debug, Default)]
pub struct Form {
    /// `true` if a call returns a structure of two members: the function's result, and a flag for a discarded pixel.
    pub discards: bool,
    /// The type of the function's result; `None` if there is no result.
    pub(crate) returns: Option<Shape>,
    pub(crate) passed: Vec<Passed>,
    /// The function's texture and sampler parameters, which Karat replaces by variables. Each entry has the parameter's
    /// position among all parameters, its name and its type.
    pub taken: Vec<(usize, String, String)>,
    /// `true` if Karat must run the cases one by one, because a case could otherwise see the writes of another case.
    pub alone: bool,
    /// `true` if only fragment shaders may call the function. Each case is then a quad of pixels, or one pixel of a
    /// quad if cases run alone. If a case is one pixel, the quad's other pixels are helper invocations. A discarded
    /// pixel becomes a helper, too.
    pub(crate) fragment: bool,
    /// The stage of an entry point, which Karat calls like any function.
    pub stage: Option<Stage>,
    /// The parameters that are builtin values, such as `position`, and the members that are builtin values, such as
    /// `input.pixel`. Each entry has the path and the builtin value's name in WGSL, such as `front_facing`.
    pub builtins: Vec<(String, String)>,
}

const RESULT: &str = "result";

/// The private variables that pass values into or out of a function. The keys are the variables' paths.
pub type State = BTreeMap<String, Variable>;

/// A private variable.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Variable {
    name: String,
    /// The variable's type in the linked text.
    pub ty: String,
    /// The number of scalars in the variable.
    pub lanes: usize,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Passed {
    /// The kernel passes the parameter's value.
    Value,
    /// The kernel passes a pointer to one of its local variables (address space `function`).
    Function,
    /// The kernel passes a pointer to a private variable.
    Private,
    /// The kernel stores the value in the private variable with this name. The author's function reads the variable,
    /// and has no parameter for the value.
    State(String),
}

impl Passed {
    pub(crate) fn space(&self) -> Option<&'static str> {
        match self {
            Self::Value | Self::State(_) => None,
            Self::Function => Some("function"),
            Self::Private => Some("private"),
        }
    }
}

impl Function {
    /// The name of each parameter, and its value as text. `words` has the `u32` words of all arguments.
    #[must_use]
    pub fn arguments(&self, mut words: &[u32]) -> Vec<(String, String)> {
        let mut arguments = Vec::new();
        for (name, shape) in &self.parameters {
            let (own, others) = words.split_at(shape.lanes().len());
            words = others;
            arguments.push((name.clone(), shape.format(own)));
        }
        arguments
    }

    /// The arguments of a case in one line: `x = 1, n = 2`.
    pub(crate) fn shown(&self, words: &[u32]) -> String {
        let all =
            self.arguments(words).into_iter().map(|(name, value)| format!("{name} = {value}"));
        all.collect::<Vec<_>>().join(", ")
    }

    /// The names and shapes of one invocation's results: the function's result, the values behind pointers, and private
    /// variables.
    pub fn outputs(&self) -> Vec<(String, Shape)> {
        let returned = self.form.returns.iter().map(|shape| (RESULT.to_owned(), shape.clone()));
        let pointers = self.parameters.iter().zip(&self.form.passed);
        let pointers = pointers.filter(|(_, passed)| **passed != Passed::Value);
        returned.chain(pointers.map(|(parameter, _)| parameter.clone())).collect()
    }

    /// The address space of each parameter that is a pointer.
    #[must_use]
    pub fn spaces(&self) -> Vec<&'static str> {
        self.form.passed.iter().filter_map(Passed::space).collect()
    }

    /// The stage of an entry point, which Karat calls like any function.
    #[must_use]
    pub fn stage(&self) -> Option<Stage> {
        self.form.stage
    }

    /// The resources that the function may write. If the function only reads its `read_write` resources, there are
    /// none.
    pub fn written(&self) -> impl Iterator<Item = &Binding> {
        let written = |binding: &&Binding| self.form.alone && binding.kind.is_written();
        self.bindings.iter().filter(written)
    }

    /// Sets the type of everything that a call returns. `written` has the shapes of the resources that the
    /// function writes.
    pub(crate) fn join(&mut self, written: Vec<(String, Shape)>) {
        let mut members = self.outputs();
        members.extend(written);
        self.result = match &*members {
            [(_, shape)] => shape.clone(),
            _ => Shape::Struct { name: "all results of a call".to_owned(), members },
        };
    }
}

impl fmt::Display for Function {
    /// The signature: `fresnel::schlick(f0: vec3<f32>, v_dot_h: f32) -> vec3<f32>`. The signature of an entry
    /// point begins with its stage.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(stage) = self.form.stage {
            write!(f, "@{stage} ")?;
        }
        write!(f, "{}(", self.name)?;
        let spaces = self.form.passed.iter().map(|passed| passed.space());
        let parameters = self.parameters.iter().zip(&self.form.passed);
        let parameters = parameters.filter(|(_, passed)| !matches!(passed, Passed::State(_)));
        let passed =
            parameters.map(|(one, _)| one).zip(spaces).map(|((name, shape), space)| match space {
                None => format!("{name}: {shape}"),
                Some(space) => format!("{name}: ptr<{space}, {shape}>"),
            });
        let mut all: Vec<String> = passed.collect();
        for (place, name, ty) in &self.form.taken {
            all.insert((*place).min(all.len()), format!("{name}: {ty}"));
        }
        write!(f, "{}", all.join(", "))?;
        match (&self.form.returns, self.form.discards) {
            (Some(Shape::Struct { members, .. }), true) => match &members[..] {
                [(_, value), _] => write!(f, ") -> {value}, or discards"),
                _ => write!(f, "), or discards"),
            },
            (Some(shape), _) => write!(f, ") -> {shape}"),
            (None, _) => write!(f, ")"),
        }
    }
}

impl Program {
    /// Reflects the function with this path in the author's code.
    ///
    /// # Errors
    /// Returns an error if a kernel can't call the function. The reason may be a pointer, a runtime-sized array, a
    /// missing result, a 64-bit type, or an operation that only fragment shaders have.
    pub fn function(&self, path: &str) -> Result<Function, ReflectError> {
        self.function_in_state(path, &State::new())
    }

    /// Checks if a function uses a variable of its module, such as a private variable, and so depends on more
    /// than its arguments.
    pub(crate) fn uses_variables(&self, path: &str) -> bool {
        let Some((handle, _)) = self.declared(self.called_name(self.name_of(path))) else {
            return true;
        };
        let info = &self.checked.info[handle];
        self.checked.module.global_variables.iter().any(|(one, _)| !info[one].is_empty())
    }

    /// The private variables that pass values into or out of a function: variables that the function writes, and
    /// variables without an initial value. The other private variables keep their initial values in each call.
    pub fn state_of(&self, path: &str) -> State {
        // Each run of an entry point begins with new private variables.
        let declared = self.declared(self.called_name(self.name_of(path)));
        let Some((handle, _)) = declared.filter(|_| self.linked.called.is_none()) else {
            return State::new();
        };
        let info = &self.checked.info[handle];
        let all = self.checked.module.global_variables.iter();
        let used = all.filter(|(handle, one)| {
            let is_private = one.space == naga::AddressSpace::Private;
            let (used, writes) = (info[*handle], info[*handle].contains(GlobalUse::WRITE));
            let is_ours = one.name.as_deref().is_some_and(|name| name.starts_with(KERNEL_PREFIX));
            is_private
                && !is_ours
                && !used.is_empty()
                && (writes || one.init.is_none())
                && self.shape(one.ty).is_ok()
        });
        let of = |one: &naga::GlobalVariable| {
            let name = one.name.clone().expect(NAMED);
            let path = self.author_path(&name).unwrap_or(&name).to_owned();
            let ty = self.checked.module.to_ctx().type_to_string(one.ty);
            let lanes = self.shape(one.ty).map_or(0, |shape| shape.lanes().len());
            (path, Variable { name, ty, lanes })
        };
        used.map(|(_, one)| of(one)).collect()
    }

    /// The type of the private variable with this path.
    pub fn private_type(&self, path: &str) -> Option<String> {
        let one = self.private(self.name_of(path))?;
        Some(self.checked.module.to_ctx().type_to_string(one.ty))
    }

    /// A copy of this program, with declarations of the variables in `state` that the program doesn't declare itself.
    pub fn with_state(self: Arc<Self>, state: &State) -> Result<Arc<Self>, ReflectError> {
        let lacks = |(path, _): &(&String, _)| self.private(self.name_of(path)).is_none();
        let text = state
            .iter()
            .filter(lacks)
            .map(|(_, Variable { name, ty, .. })| format!("var<private> {name}: {ty};\n"));
        match text.collect::<String>() {
            none if none.is_empty() => Ok(self),
            text => Ok(Arc::new(self.followed_by(&format!("\n{text}"))?)),
        }
    }

    fn private(&self, name: &str) -> Option<&naga::GlobalVariable> {
        let mut all = self.checked.module.global_variables.iter().map(|(_, one)| one);
        let is_it = |one: &&naga::GlobalVariable| {
            one.space == naga::AddressSpace::Private && one.name.as_deref() == Some(name)
        };
        all.find(is_it)
    }

    /// Reflects a function as [`function`](Self::function) does, with private variables as additional parameters and
    /// results.
    pub fn function_in_state(&self, path: &str, state: &State) -> Result<Function, ReflectError> {
        let name = self.linked.name_of(path).unwrap_or(path);
        let Some((handle, _)) = self.declared(name) else {
            if let Some(span) = self.entry_point_span(name) {
                let message =
                    format!("`{path}` is an entry point of a stage that Karat doesn't run");
                return Err(unprobeable(Diagnostic::new(message).at(span, "declared here")));
            }
            let span = Span { file: Arc::clone(&self.linked.file), range: 0..0 };
            let message = format!("`{path}` isn't a function that Karat can call");
            return Err(unprobeable(
                Diagnostic::new(message)
                    .at(span, "in this module")
                    .note("move the tested code into a function"),
            ));
        };
        let span = self.function_span(handle);
        let called = self.called_name(name);
        let discards = called != name;
        let (handle, function) = self.declared(called).expect("it is linked");
        let refuse = |what: String, note: &str| {
            let message = format!("Karat can't call `{path}`: {what}");
            unprobeable(Diagnostic::new(message).at(span.clone(), "declared here").note(note))
        };
        // Textures and samplers are variables of the function that Karat calls instead.
        let instead = self.called_for(function);
        let taken = if instead.is_some() { self.taken(function) } else { Vec::new() };
        let own =
            function.arguments.iter().filter(|own| instead.is_none() || !self.is_handle(own.ty));
        let (handle, called) = instead.unwrap_or((handle, function));
        let linked = called.name.clone().expect(NAMED);
        let info = &self.checked.info[handle];
        let fragment = !info.available_stages.contains(ShaderStages::COMPUTE);
        // Karat linked the program for another function. Otherwise a wrapper would return the discard as a flag.
        if fragment && info.may_kill && !discards {
            return Err(refuse(
                "the function may discard, and a discarded call has no result".to_owned(),
                "return the condition under which the function discards",
            ));
        }
        let mut form = Form {
            fragment,
            discards,
            alone: self.shared_state(info).is_some(),
            taken,
            ..Form::default()
        };
        if let Some(entry_point) = &self.linked.called {
            form.stage = Some(entry_point.stage);
            form.builtins.clone_from(&entry_point.builtins);
        }
        if form.stage != Some(Stage::Compute) && self.reaches_subgroups(path) {
            return Err(refuse(
                "the function has subgroup operations, and a call has only one invocation"
                    .to_owned(),
                "test a compute pass that calls the function",
            ));
        }
        let mut parameters = Vec::new();
        for (argument, own) in called.arguments.iter().zip(own) {
            let name = own.name.clone().expect(NAMED);
            let (ty, passed) = self.passed(argument.ty);
            let shape = self.shape(ty).map_err(|reason| {
                refuse(
                    format!("the parameter `{name}` is {reason}"),
                    "use values as parameters and results instead",
                )
            })?;
            if let naga::TypeInner::Struct { members, .. } = &self.checked.module.types[ty].inner {
                form.builtins.extend(members.iter().filter_map(|member| {
                    let Some(naga::Binding::BuiltIn(builtin)) = &member.binding else {
                        return None;
                    };
                    let member = member.name.as_deref().expect(NAMED);
                    Some((format!("{name}.{member}"), builtin.to_wgsl_for_diagnostics()))
                }));
            }
            parameters.push((name, shape));
            form.passed.push(passed);
        }
        form.returns = match &called.result {
            None => None,
            Some(result) => Some(self.shape(result.ty).map_err(|reason| {
                refuse(
                    format!("the result is {reason}"),
                    "use values as parameters and results instead",
                )
            })?),
        };
        for (variable, Variable { name, .. }) in state {
            let linked = self.name_of(variable);
            let of = |linked: &str| {
                Some((linked.to_owned(), self.shape(self.private(linked)?.ty).ok()?))
            };
            let Some((linked, shape)) = of(linked).or_else(|| of(name)) else { continue };
            // The variable's own name, unless another parameter or the result has this name.
            let own = variable.rsplit("::").next().unwrap_or(variable);
            let is_own = |path: &String| path.rsplit("::").next() == Some(own);
            let is_taken = own == RESULT
                || parameters.iter().any(|(name, _)| name == own)
                || state.keys().filter(|path| is_own(path)).count() > 1;
            let shown = if is_taken { format!("private {variable}") } else { own.to_owned() };
            parameters.push((shown, shape));
            form.passed.push(Passed::State(linked));
        }
        let bindings = self.bindings(info);
        let mut function = Function {
            name: path.to_owned(),
            linked,
            doc: doc_above(&span),
            parameters,
            result: Shape::Scalar(Scalar::Bool),
            bindings,
            form,
            span: span.clone(),
        };
        if function.outputs().is_empty() && function.written().next().is_none() {
            return Err(refuse(
                "the function returns nothing and writes nothing that Karat can read".to_owned(),
                "return the value that should be checked",
            ));
        }
        let mut written = Vec::new();
        for binding in function.written() {
            let shape = self.written_shape(binding, None).ok_or_else(|| {
                let what =
                    format!("the function writes `{}`, which Karat can't read", binding.path);
                refuse(what, "use values as parameters and results instead")
            })?;
            written.push((binding.name().to_owned(), shape));
        }
        function.join(written);
        Ok(function)
    }

    /// The name of the function that Karat calls in place of the function `name`. If the function can execute
    /// `discard`, Karat calls the wrapper that reports the discard.
    pub(super) fn called_name<'n>(&'n self, name: &'n str) -> &'n str {
        match &self.linked.discards {
            Some((own, wrapper)) if own == name => wrapper,
            _ => name,
        }
    }

    /// Checks if a function can execute `discard`, and also writes memory that other invocations see.
    pub(super) fn discards_and_writes(&self, path: &str) -> bool {
        let name = self.name_of(path);
        let called = self.called_name(name);
        let info = self.declared(called).map(|(handle, _)| &self.checked.info[handle]);
        called != name && info.is_some_and(|info| self.shared_state(info).is_some())
    }

    pub(super) fn passed(
        &self,
        ty: naga::Handle<naga::Type>,
    ) -> (naga::Handle<naga::Type>, Passed) {
        use naga::AddressSpace;
        match self.checked.module.types[ty].inner {
            naga::TypeInner::Pointer { base, space: AddressSpace::Function } => {
                (base, Passed::Function)
            }
            naga::TypeInner::Pointer { base, space: AddressSpace::Private } => {
                (base, Passed::Private)
            }
            _ => (ty, Passed::Value),
        }
    }

    /// The shape of a resource that a call wrote. `count` is the number of bytes in a buffer, or the number of texels
    /// in a texture. Without `count`, a runtime-sized array has no elements. `None` if the host can't read the
    /// resource.
    pub fn written_shape(&self, binding: &Binding, count: Option<usize>) -> Option<Shape> {
        if let BindingKind::StorageTexture { format, .. } = binding.kind {
            let scalar = match format.texels() {
                Texels::Sint => Scalar::I32,
                Texels::Uint => Scalar::U32,
                Texels::Float | Texels::Depth => Scalar::F32,
            };
            let length = u32::try_from(count.unwrap_or_default()).ok()?;
            let element = match u8::try_from(format.channels()).ok()? {
                1 => Shape::Scalar(scalar),
                size => Shape::Vector { size, scalar },
            };
            let element = Box::new(element);
            return Some(Shape::Array { element, length });
        }
        self.memory_shape(binding.ty, count.unwrap_or_default())
    }

    /// The shape of a type in memory. An `atomic<u32>` has the shape of a `u32`, and a runtime-sized array fills
    /// `bytes` bytes.
    fn memory_shape(&self, ty: naga::Handle<naga::Type>, bytes: usize) -> Option<Shape> {
        let declared = &self.checked.module.types[ty];
        match &declared.inner {
            naga::TypeInner::Atomic(scalar) => Some(Shape::Scalar(scalar_of(*scalar).ok()?)),
            naga::TypeInner::Array { base, size, stride } => {
                let length = match size {
                    naga::ArraySize::Constant(length) => length.get(),
                    naga::ArraySize::Dynamic => u32::try_from(bytes / *stride as usize).ok()?,
                    naga::ArraySize::Pending(_) => return None,
                };
                Some(Shape::Array { element: Box::new(self.memory_shape(*base, 0)?), length })
            }
            naga::TypeInner::Struct { members, .. } => {
                let members = members.iter().map(|member| {
                    let rest = bytes.saturating_sub(member.offset as usize);
                    let shape = self.memory_shape(member.ty, rest)?;
                    Some((member.name.clone().expect(NAMED), shape))
                });
                let members = members.collect::<Option<_>>()?;
                Some(Shape::Struct { name: declared.name.clone().expect(NAMED), members })
            }
            _ => self.shape(ty).ok(),
        }
    }

    /// The parameters of a `@test` function. A `@test` function needs no result.
    ///
    /// # Errors
    /// Returns an error if the test can't run in a kernel, or if a kernel can't pass one of its parameters.
    pub(crate) fn test_parameters(&self, path: &str) -> Result<Vec<(String, Shape)>, ReflectError> {
        let name = self.linked.name_of(path).unwrap_or(path);
        let mut functions = self.checked.module.functions.iter();
        let found = functions.find(|(_, function)| function.name.as_deref() == Some(name));
        let Some((handle, function)) = found else {
            let message = format!("the test `{path}` isn't a function");
            return Err(unprobeable(Diagnostic::new(message)));
        };
        let span = self.function_span(handle);
        let refuse = |what: String, note: &str| {
            let message = format!("the test `{path}` can't run: {what}");
            unprobeable(Diagnostic::new(message).at(span.clone(), "declared here").note(note))
        };
        if !self.checked.info[handle].available_stages.contains(ShaderStages::COMPUTE) {
            let what = "the test uses operations of fragment shaders (derivatives, implicit-LOD \
                        sampling or discard)";
            return Err(refuse(what.to_owned(), "use textureSampleLevel or textureSampleGrad"));
        }
        if let Some(shared) = self.shared_state(&self.checked.info[handle]) {
            let what =
                format!("the test {shared}, so cases of the same dispatch would affect each other");
            return Err(refuse(
                what,
                "write a `[[compute]]` test for an entry point that calls this code",
            ));
        }
        let parameters = function.arguments.iter().map(|argument| {
            let name = argument.name.clone().expect(NAMED);
            if self.is_handle(argument.ty) {
                let what = format!("the parameter `{name}` is a texture or sampler, which `@test` can't bind");
                let note = format!(
                    "remove `@test`, and declare the test in a `*.test.toml`, where `with` binds the parameter: \
                     `with = {{ {name} = ... }}`"
                );
                return Err(refuse(what, &note));
            }
            let shape = self.shape(argument.ty).map_err(|reason| {
                refuse(format!("the parameter `{name}` is {reason}"), "use values as parameters")
            })?;
            Ok((name, shape))
        });
        parameters.collect()
    }

    /// Checks if the function's expression with the index `expression` is a negation, such as `-x`.
    pub(crate) fn negates(&self, function: &str, expression: usize) -> bool {
        let found = self.body(function).and_then(|(f, _)| f.expressions.iter().nth(expression));
        let negate = naga::UnaryOperator::Negate;
        matches!(found, Some((_, naga::Expression::Unary { op, .. })) if *op == negate)
    }

    pub(crate) fn declares_var(&self, function: &str, name: &str) -> bool {
        let variables = self.body(function).map(|(function, _)| &function.local_variables);
        variables.is_some_and(|all| all.iter().any(|(_, one)| one.name.as_deref() == Some(name)))
    }

    pub(crate) fn is_derivative(&self, function: &str, expression: usize) -> bool {
        let found = self.body(function).and_then(|(f, _)| f.expressions.iter().nth(expression));
        matches!(found, Some((_, naga::Expression::Derivative { .. })))
    }

    /// The number of components of the function's expression with the index `expression`; 1 if the type is unknown.
    pub(crate) fn components(&self, function: &str, expression: usize) -> usize {
        let components = |inner: &naga::TypeInner| match inner {
            naga::TypeInner::Vector { size, .. } => *size as usize,
            naga::TypeInner::Matrix { columns, rows, .. } => *columns as usize * *rows as usize,
            _ => 1,
        };
        self.type_of(function, expression).map_or(1, components)
    }

    /// The name of the `let` whose value is the function's expression with the index `expression`.
    pub(crate) fn let_name(&self, function: &str, expression: usize) -> Option<&str> {
        let (function, _) = self.body(function)?;
        let (at, _) = function.expressions.iter().nth(expression)?;
        function.named_expressions.get(&at).map(String::as_str)
    }

    /// Checks if the function's expression with the index `expression` has `i32` components.
    pub(crate) fn is_signed(&self, function: &str, expression: usize) -> bool {
        let scalar = self.type_of(function, expression).and_then(naga::TypeInner::scalar);
        scalar.is_some_and(|scalar| scalar.kind == naga::ScalarKind::Sint)
    }

    fn type_of(&self, function: &str, expression: usize) -> Option<&naga::TypeInner> {
        let (function, info) = self.body(function)?;
        let (at, _) = function.expressions.iter().nth(expression)?;
        Some(info[at].ty.inner_with(&self.checked.module.types))
    }

    pub(super) fn body(&self, name: &str) -> Option<(&naga::Function, &naga::valid::FunctionInfo)> {
        let super::Checked { module, info, .. } = &*self.checked;
        let mut functions = module.functions.iter();
        let found = functions.find(|(_, known)| known.name.as_deref() == Some(name));
        let function = found.map(|(handle, function)| (function, &info[handle]));
        function.or_else(|| {
            let entry = module.entry_points.iter().position(|entry| entry.name == name)?;
            Some((&module.entry_points[entry].function, info.get_entry_point(entry)))
        })
    }

    /// The signature of one of the program's functions, with the author's names for types.
    #[must_use]
    pub fn signature(&self, function: &Function) -> String {
        let (mut shown, text) = (String::new(), function.to_string());
        // The function's path is already the author's path.
        let (path, types) =
            text.split_once('(').map_or((text.as_str(), ""), |(path, _)| text.split_at(path.len()));
        shown.push_str(path);
        let is_part = |c: char| c.is_alphanumeric() || c == '_';
        let mut word = String::new();
        for c in types.chars().chain(['\0']) {
            if is_part(c) {
                word.push(c);
                continue;
            }
            let own = self.author_path(&word).and_then(|path| path.rsplit("::").next());
            shown.push_str(own.unwrap_or(&word));
            word.clear();
            shown.extend(Some(c).filter(|c| *c != '\0'));
        }
        shown
    }

    pub(crate) fn author_path(&self, linked: &str) -> Option<&str> {
        self.linked.names.get(linked).map(String::as_str)
    }

    /// Describes how the invocations of a function share memory or wait for each other: ``uses the workgroup variable
    /// `sums` ``. `None` for other functions.
    fn shared_state(&self, info: &naga::valid::FunctionInfo) -> Option<String> {
        use naga::AddressSpace;
        use naga::valid::UniformityRequirements;
        if info.uniformity.requirements.contains(UniformityRequirements::WORK_GROUP_BARRIER) {
            return Some("waits at a barrier".to_owned());
        }
        self.checked.module.global_variables.iter().find_map(|(handle, global)| {
            let name = global.name.as_deref().expect(NAMED);
            let inner = &self.checked.module.types[global.ty].inner;
            if !info[handle].is_empty()
                && let kind @ BindingKind::StorageTexture { .. } = BindingKind::of(global, inner)
                && kind.is_written()
            {
                return Some(format!("writes the storage texture `{name}`"));
            }
            match global.space {
                AddressSpace::WorkGroup if !info[handle].is_empty() => {
                    Some(format!("uses the workgroup variable `{name}`"))
                }
                AddressSpace::Storage { .. }
                    if info[handle].intersects(GlobalUse::WRITE | GlobalUse::ATOMIC) =>
                {
                    Some(format!("writes the storage buffer `{name}`"))
                }
                _ => None,
            }
        })
    }

    /// The shape of a buffer's type. For a runtime-sized array, the shape of one element. `None` if the type has no
    /// shape.
    pub(crate) fn buffer_shape(&self, ty: naga::Handle<naga::Type>) -> Option<Shape> {
        match &self.checked.module.types[ty].inner {
            naga::TypeInner::Array { base, size: naga::ArraySize::Dynamic, .. } => {
                self.shape(*base).ok()
            }
            _ => self.shape(ty).ok(),
        }
    }

    /// The shapes of a structure that ends in a runtime-sized array: the other members as a structure, and one
    /// element of the array. `None` if the type isn't such a structure, or has no shape.
    pub(crate) fn headed_shape(&self, ty: naga::Handle<naga::Type>) -> Option<(Shape, Shape)> {
        let types = &self.checked.module.types;
        let naga::TypeInner::Struct { members, .. } = &types[ty].inner else { return None };
        let (last, head) = members.split_last()?;
        let naga::TypeInner::Array { base, size: naga::ArraySize::Dynamic, .. } =
            types[last.ty].inner
        else {
            return None;
        };
        let member = |member: &naga::StructMember| {
            Some((member.name.clone().expect(NAMED), self.shape(member.ty).ok()?))
        };
        let members = head.iter().map(member).collect::<Option<_>>()?;
        let name = types[ty].name.clone().expect(NAMED);
        Some((Shape::Struct { name, members }, self.shape(base).ok()?))
    }

    /// The shape of a buffer's contents. If the buffer is, or ends in, a runtime-sized array, that array has `elements`
    /// elements. An `atomic<u32>` has the shape of a `u32`. `None` if the variable isn't a buffer.
    #[must_use]
    pub fn buffer_of(&self, binding: &Binding, elements: usize) -> Option<Shape> {
        use naga::{ArraySize, TypeInner};
        let types = &self.checked.module.types;
        let endless = |ty: naga::Handle<naga::Type>| match types[ty].inner {
            TypeInner::Array { size: ArraySize::Dynamic, stride, .. } => Some(stride as usize),
            _ => None,
        };
        let bytes = match &types[binding.ty].inner {
            TypeInner::Struct { members, .. } => members
                .last()
                .and_then(|last| Some(last.offset as usize + endless(last.ty)? * elements)),
            _ => endless(binding.ty).map(|stride| stride * elements),
        };
        self.memory_shape(binding.ty, bytes.unwrap_or_default())
    }

    /// The path of each member of a buffer, such as `.lights[].color`, and the offset of the member in bytes.
    pub fn places(&self, binding: &Binding) -> Vec<(String, u32)> {
        super::layout::places(&self.checked.module, binding.ty, "", 0)
    }

    /// Converts the scalars of a buffer's value to the bytes of the buffer.
    ///
    /// # Errors
    /// Returns an error if the number of scalars doesn't fit the type.
    pub fn bytes(&self, binding: &Binding, lanes: &[u32]) -> Result<Vec<u8>, super::LayoutError> {
        super::bytes_of(&self.checked.module, &self.checked.layouter, binding.ty, lanes)
    }

    pub(super) fn function_span(&self, handle: naga::Handle<naga::Function>) -> Span {
        let range = self.checked.module.functions.get_span(handle).to_range().unwrap_or(0..0);
        self.resolve(range).unwrap_or(Span { file: Arc::clone(&self.linked.file), range: 0..0 })
    }

    pub(crate) fn declaration_span(&self, name: &str) -> Option<Span> {
        let mut functions = self.checked.module.functions.iter();
        let found = functions.find(|(_, known)| known.name.as_deref() == Some(name));
        match found {
            Some((handle, _)) => Some(self.function_span(handle)),
            None => self.entry_point_span(name),
        }
    }

    /// The shape of a naga type. The error describes the part of the type that a kernel can't pass.
    pub(super) fn shape(&self, ty: naga::Handle<naga::Type>) -> Result<Shape, String> {
        self.shape_of(&self.checked.module.types[ty])
    }

    /// The shape of a naga type. The type needn't be in the module.
    pub(super) fn shape_of(&self, ty: &naga::Type) -> Result<Shape, String> {
        use naga::{ArraySize, TypeInner};
        Ok(match &ty.inner {
            TypeInner::Scalar(scalar) => Shape::Scalar(scalar_of(*scalar)?),
            TypeInner::Vector { size, scalar } => {
                Shape::Vector { size: *size as u8, scalar: scalar_of(*scalar)? }
            }
            TypeInner::Matrix { columns, rows, scalar } => Shape::Matrix {
                columns: *columns as u8,
                rows: *rows as u8,
                scalar: scalar_of(*scalar)?,
            },
            TypeInner::Array { base, size: ArraySize::Constant(length), .. } => {
                Shape::Array { element: Box::new(self.shape(*base)?), length: length.get() }
            }
            TypeInner::Array { .. } => return Err("an array without a fixed size".to_owned()),
            TypeInner::Pointer { .. } | TypeInner::ValuePointer { .. } => {
                return Err("a pointer, which has no value outside the shader".to_owned());
            }
            TypeInner::Struct { members, .. } => {
                let name = ty.name.clone().expect(NAMED);
                let members = members
                    .iter()
                    .map(|member| Ok((member.name.clone().expect(NAMED), self.shape(member.ty)?)))
                    .collect::<Result<_, String>>()?;
                Shape::Struct { name, members }
            }
            TypeInner::Atomic(_) => return Err("an atomic".to_owned()),
            TypeInner::Image { .. } | TypeInner::Sampler { .. } => {
                return Err("a texture or sampler; bind it as a variable instead".to_owned());
            }
            _ => return Err("of a type that Karat can't pass".to_owned()),
        })
    }
}

pub(super) fn scalar_of(scalar: naga::Scalar) -> Result<Scalar, String> {
    use naga::ScalarKind;
    match (scalar.kind, scalar.width) {
        (ScalarKind::Float, 4) => Ok(Scalar::F32),
        (ScalarKind::Float, 2) => Ok(Scalar::F16),
        (ScalarKind::Sint, 4) => Ok(Scalar::I32),
        (ScalarKind::Uint, 4) => Ok(Scalar::U32),
        (ScalarKind::Bool, _) => Ok(Scalar::Bool),
        (_, width) => Err(format!("made of {}-bit scalars", u32::from(width) * 8)),
    }
}

fn unprobeable(diagnostic: Diagnostic) -> ReflectError {
    ReflectError::Unprobeable(Box::new(diagnostic))
}

fn doc_above(span: &Span) -> String {
    let before = span.file.text.get(..span.range.start).unwrap_or_default();
    // On the function's own line, only attributes may come before the function.
    let above = before.rfind('\n').map_or("", |newline| &before[..newline]);
    let mut lines: Vec<&str> = above
        .lines()
        .rev()
        .map(str::trim_start)
        .take_while(|line| line.starts_with("//") || line.starts_with('@'))
        .filter_map(|line| line.strip_prefix("///"))
        .map(|line| line.strip_prefix(' ').unwrap_or(line))
        .collect();
    lines.reverse();
    lines.join("\n")
}
