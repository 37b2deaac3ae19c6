//! What a function takes and returns.

use std::fmt;
use std::sync::Arc;

use naga::valid::{GlobalUse, ShaderStages};

use super::binding::Binding;
use super::{Program, ReflectError};
use crate::diagnostic::{Diagnostic, Span};
use crate::value::{Scalar, Shape};

/// A function as a probe sees it.
#[derive(Clone, Debug)]
pub struct Function {
    /// As its author calls it: `fresnel::schlick`.
    pub name: String,
    /// Its name in the linked text.
    pub(crate) linked: String,
    /// From `fn` to the closing brace, in the author's file.
    pub span: Span,
    /// The comment lines (`///`) above it.
    pub doc: String,
    /// Name and type of each parameter.
    pub parameters: Vec<(String, Shape)>,
    /// Type of the result.
    pub result: Shape,
    /// The resources that it reads, directly or through what it calls.
    pub bindings: Vec<Binding>,
}

impl fmt::Display for Function {
    /// The signature: `fresnel::schlick(f0: vec3<f32>, v_dot_h: f32) -> vec3<f32>`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}(", self.name)?;
        for (index, (name, shape)) in self.parameters.iter().enumerate() {
            let separator = if index > 0 { ", " } else { "" };
            write!(f, "{separator}{name}: {shape}")?;
        }
        write!(f, ") -> {}", self.result)
    }
}

impl Program {
    /// Reflects a function by its author's path.
    ///
    /// # Errors
    /// If a probe can't call it: pointers, runtime-sized arrays, no result, 64-bit types, or
    /// operations that only a fragment shader has.
    pub fn function(&self, path: &str) -> Result<Function, ReflectError> {
        let name = self.linked.name_of(path).unwrap_or(path);
        let found = self
            .checked
            .module
            .functions
            .iter()
            .find(|(_, function)| function.name.as_deref() == Some(name));
        let Some((handle, function)) = found else {
            let span = Span { file: Arc::clone(&self.linked.file), range: 0..0 };
            let message = format!("`{path}` is an entry point or isn't a function");
            return Err(unprobeable(
                Diagnostic::new(message)
                    .at(span, "in this module")
                    .note("a probe calls plain functions: move what should be tested into one"),
            ));
        };
        let span = self.function_span(handle);
        let refuse = |what: String, note: &str| {
            let message = format!("`{path}` can't be probed: {what}");
            unprobeable(Diagnostic::new(message).at(span.clone(), "declared here").note(note))
        };
        let stages = self.checked.info[handle].available_stages;
        if !stages.contains(ShaderStages::COMPUTE) {
            return Err(refuse(
                "it uses operations of fragment shaders (derivatives, implicit-LOD sampling or \
                 discard)"
                    .to_owned(),
                "use textureSampleLevel or textureSampleGrad, or pass derivatives as arguments",
            ));
        }
        if let Some(shared) = self.shared_state(&self.checked.info[handle]) {
            return Err(refuse(
                format!("it {shared}, which other cases of the same dispatch see"),
                "pass values, return values: a result must not depend on its neighbours",
            ));
        }
        let mut parameters = Vec::new();
        for argument in &function.arguments {
            let name = argument.name.clone().unwrap_or_default();
            let shape = self.shape(argument.ty).map_err(|reason| {
                refuse(format!("its parameter `{name}` is {reason}"), "pass values, return values")
            })?;
            parameters.push((name, shape));
        }
        let result = function.result.as_ref().ok_or_else(|| {
            refuse("it returns nothing".to_owned(), "return the value that should be checked")
        })?;
        let result = self.shape(result.ty).map_err(|reason| {
            refuse(format!("its result is {reason}"), "pass values, return values")
        })?;
        Ok(Function {
            name: path.to_owned(),
            linked: name.to_owned(),
            doc: doc_above(&span),
            parameters,
            result,
            bindings: self.bindings(|global| self.checked.info[handle][global]),
            span,
        })
    }

    /// The parameters of a function that needn't return anything: a test.
    ///
    /// # Errors
    /// If it can't run in a kernel, or has a parameter that a kernel can't pass.
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
            let what = "it uses operations of fragment shaders (derivatives, implicit-LOD \
                        sampling or discard)";
            return Err(refuse(what.to_owned(), "use textureSampleLevel or textureSampleGrad"));
        }
        if let Some(shared) = self.shared_state(&self.checked.info[handle]) {
            let what = format!("it {shared}, which other cases of the same dispatch see");
            return Err(refuse(what, "a case must not depend on its neighbours"));
        }
        let parameters = function.arguments.iter().map(|argument| {
            let name = argument.name.clone().unwrap_or_default();
            let shape = self.shape(argument.ty).map_err(|reason| {
                refuse(format!("its parameter `{name}` is {reason}"), "take values")
            })?;
            Ok((name, shape))
        });
        parameters.collect()
    }

    /// Whether an expression of a function, by its index, is `-x`.
    #[cfg(feature = "engine")]
    pub(crate) fn negates(&self, function: &str, expression: usize) -> bool {
        let mut functions = self.checked.module.functions.iter().map(|(_, function)| function);
        let function = functions.find(|known| known.name.as_deref() == Some(function));
        let mut expressions = function.into_iter().flat_map(|f| f.expressions.iter());
        matches!(
            expressions.nth(expression),
            Some((_, naga::Expression::Unary { op: naga::UnaryOperator::Negate, .. }))
        )
    }

    /// How many numbers an expression of a function is, by its index; 1 if that isn't known.
    #[cfg(feature = "engine")]
    pub(crate) fn components(&self, function: &str, expression: usize) -> usize {
        let mut functions = self.checked.module.functions.iter();
        let found = functions.find(|(_, known)| known.name.as_deref() == Some(function));
        let of = |(handle, function): (naga::Handle<naga::Function>, &naga::Function)| {
            let (at, _) = function.expressions.iter().nth(expression)?;
            Some(match self.checked.info[handle][at].ty.inner_with(&self.checked.module.types) {
                naga::TypeInner::Vector { size, .. } => *size as usize,
                naga::TypeInner::Matrix { columns, rows, .. } => *columns as usize * *rows as usize,
                _ => 1,
            })
        };
        found.and_then(of).unwrap_or(1)
    }

    /// The name that a `let` of a function gives an expression, by its index.
    #[cfg(feature = "engine")]
    pub(crate) fn let_name(&self, function: &str, expression: usize) -> Option<&str> {
        let mut functions = self.checked.module.functions.iter().map(|(_, function)| function);
        let function = functions.find(|known| known.name.as_deref() == Some(function))?;
        let (at, _) = function.expressions.iter().nth(expression)?;
        function.named_expressions.get(&at).map(String::as_str)
    }

    /// Whether an expression of a function is an `i32`, or a vector of them.
    #[cfg(feature = "engine")]
    pub(crate) fn is_signed(&self, function: &str, expression: usize) -> bool {
        let mut functions = self.checked.module.functions.iter();
        let found = functions.find(|(_, known)| known.name.as_deref() == Some(function));
        let of = |(handle, function): (naga::Handle<naga::Function>, &naga::Function)| {
            let (at, _) = function.expressions.iter().nth(expression)?;
            let inner = self.checked.info[handle][at].ty.inner_with(&self.checked.module.types);
            Some(inner.scalar()?.kind == naga::ScalarKind::Sint)
        };
        found.and_then(of).unwrap_or(false)
    }

    /// The author's path of a declaration by its name in the linked text.
    pub(crate) fn author_path(&self, linked: &str) -> Option<&str> {
        self.linked.names.get(linked).map(String::as_str)
    }

    /// What a function shares with other invocations, if anything.
    fn shared_state(&self, info: &naga::valid::FunctionInfo) -> Option<String> {
        use naga::AddressSpace;
        use naga::valid::UniformityRequirements;
        if info.uniformity.requirements.contains(UniformityRequirements::WORK_GROUP_BARRIER) {
            return Some("waits at a barrier".to_owned());
        }
        self.checked.module.global_variables.iter().find_map(|(handle, global)| {
            let name = global.name.as_deref().unwrap_or_default();
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

    /// The shape of a buffer variable's type, or of an element of its runtime-sized array; `None`
    /// if the type has no shape.
    pub(crate) fn buffer_shape(&self, ty: naga::Handle<naga::Type>) -> Option<Shape> {
        match &self.checked.module.types[ty].inner {
            naga::TypeInner::Array { base, size: naga::ArraySize::Dynamic, .. } => {
                self.shape(*base).ok()
            }
            _ => self.shape(ty).ok(),
        }
    }

    /// The shapes of a structure that ends in an array without a length: of its other members, as a
    /// structure, and of the array's elements. `None` if the type isn't one, or has no shape.
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
            Some((member.name.clone().unwrap_or_default(), self.shape(member.ty).ok()?))
        };
        let members = head.iter().map(member).collect::<Option<_>>()?;
        let name = types[ty].name.clone().unwrap_or_default();
        Some((Shape::Struct { name, members }, self.shape(base).ok()?))
    }

    /// The bytes of a buffer, from the lanes of its value or of its elements.
    #[cfg(feature = "routes")]
    pub(crate) fn bytes(
        &self,
        binding: &Binding,
        lanes: &[u32],
    ) -> Result<Vec<u8>, super::LayoutError> {
        super::bytes_of(&self.checked.module, &self.checked.layouter, binding.ty, lanes)
    }

    /// The shape of the data of a buffer, or of an element of it where its array has no length; and
    /// which of the two it is. `None` if it isn't a buffer whose type has a shape.
    #[must_use]
    pub fn buffer_data(&self, binding: &Binding) -> Option<(Shape, bool)> {
        let endless = matches!(
            &self.checked.module.types[binding.ty].inner,
            naga::TypeInner::Array { size: naga::ArraySize::Dynamic, .. }
        );
        Some((self.buffer_shape(binding.ty)?, endless))
    }

    fn function_span(&self, handle: naga::Handle<naga::Function>) -> Span {
        let range = self.checked.module.functions.get_span(handle).to_range().unwrap_or(0..0);
        self.resolve(range).unwrap_or(Span { file: Arc::clone(&self.linked.file), range: 0..0 })
    }

    /// The shape of a naga type, or what it is that a probe can't pass.
    fn shape(&self, ty: naga::Handle<naga::Type>) -> Result<Shape, String> {
        use naga::{ArraySize, TypeInner};
        let ty = &self.checked.module.types[ty];
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
                let name = ty.name.clone().unwrap_or_default();
                let members = members
                    .iter()
                    .map(|member| {
                        Ok((member.name.clone().unwrap_or_default(), self.shape(member.ty)?))
                    })
                    .collect::<Result<_, String>>()?;
                Shape::Struct { name, members }
            }
            TypeInner::Atomic(_) => return Err("an atomic".to_owned()),
            TypeInner::Image { .. } | TypeInner::Sampler { .. } => {
                return Err("a texture or sampler; bind it as a variable instead".to_owned());
            }
            _ => return Err("of a type that can't be passed".to_owned()),
        })
    }
}

fn scalar_of(scalar: naga::Scalar) -> Result<Scalar, String> {
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

/// The `///` lines right above a function.
fn doc_above(span: &Span) -> String {
    let before = span.file.text.get(..span.range.start).unwrap_or_default();
    // The line that the function starts on, up to the function, holds attributes at most.
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
