//! What a WGSL function takes, returns and needs, read from naga's validated IR.
//!
//! A [`Program`] is the one place from which linked text, IR and source map are reachable;
//! whatever transforms or interprets shaders starts from it.

mod kept;
mod layout;
mod parsed;
mod rounds;
mod validation;

use std::fmt;
use std::ops::Range;
use std::sync::Arc;

pub(crate) use naga::Module as Ir;
use naga::front::wgsl;
use naga::proc::Layouter;
use naga::valid::{Capabilities, GlobalUse, ModuleInfo, ShaderStages, ValidationFlags, Validator};

use kept::Wanted;
pub use layout::LayoutError;
pub(crate) use layout::bytes_of;
pub(crate) use parsed::parsed;
pub(crate) use rounds::{COUNTERS, CountedLoop, Watched, count_rounds};
pub(crate) use validation::validate;
pub use validation::{Invalid, Validated};

use crate::diagnostic::{Diagnostic, FileRead, Span};
use crate::package::{Linked, Package, PackageError};
use crate::value::{Scalar, Shape};

/// A linked and validated shader: text, IR, and the way back to the author's files.
#[derive(Debug)]
pub struct Program {
    linked: Linked,
    module: naga::Module,
    info: ModuleInfo,
    layouter: Layouter,
}

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

/// A resource variable.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Binding {
    /// Author's path: `environment::sky`.
    pub path: String,
    /// `@group`
    pub group: u32,
    /// `@binding`
    pub binding: u32,
    /// What it is.
    pub kind: BindingKind,
    pub(crate) ty: naga::Handle<naga::Type>,
}

impl Binding {
    /// The variable's own name, without its module.
    #[must_use]
    pub fn name(&self) -> &str {
        self.path.rsplit("::").next().unwrap_or_default()
    }
}

/// The kind of a resource variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BindingKind {
    /// `var<uniform>`
    Uniform,
    /// `var<storage>`
    Storage {
        /// `read_write`
        writable: bool,
    },
    /// `texture_2d<f32>`
    Texture2d,
    /// `texture_cube<f32>`
    TextureCube,
    /// `sampler`
    Sampler,
    /// Something that no fixture can supply yet.
    Other,
}

impl fmt::Display for BindingKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Uniform => "uniform buffer",
            Self::Storage { .. } => "storage buffer",
            Self::Texture2d => "texture_2d<f32>",
            Self::TextureCube => "texture_cube<f32>",
            Self::Sampler => "sampler",
            Self::Other => "resource of an unsupported kind",
        })
    }
}

/// A stage of a draw.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// `@vertex`
    Vertex,
    /// `@fragment`
    Fragment,
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Vertex => "vertex",
            Self::Fragment => "fragment",
        })
    }
}

/// Why a shader can't be reflected or a function can't be probed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReflectError {
    /// The package is at fault.
    #[error(transparent)]
    Package(#[from] PackageError),
    /// naga rejects the shader.
    #[error("{0}")]
    Invalid(Box<Diagnostic>),
    /// The function is valid, but can't be called by a compute kernel.
    #[error("{0}")]
    Unprobeable(Box<Diagnostic>),
}

impl Program {
    /// The files that it was linked from.
    pub(crate) fn files(&self) -> &[FileRead] {
        self.linked.sources.files()
    }

    /// Links and validates the closure of one function.
    ///
    /// # Errors
    /// If it can't be linked, or isn't valid WGSL.
    pub fn of_function(package: &Package, path: &str) -> Result<Arc<Self>, ReflectError> {
        let wanted = Wanted::Function(path.to_owned());
        kept::program(package, wanted, || Self::from_linked(package.link(path)?))
    }

    /// Links and validates a whole module with all that it declares. A module that imports nothing
    /// and has no conditions goes to naga as it is.
    ///
    /// # Errors
    /// If it can't be linked, or isn't valid WGSL.
    pub fn of_module(package: &Package, module: &str) -> Result<Arc<Self>, ReflectError> {
        let wanted = Wanted::Module(module.to_owned());
        kept::program(package, wanted, || Self::from_linked(package.link_module(module)?))
    }

    /// Links and validates the closure of some declarations of one module.
    pub(crate) fn of_items(
        package: &Package,
        module: &str,
        items: &[&str],
    ) -> Result<Arc<Self>, ReflectError> {
        let names = items.iter().map(|item| (*item).to_owned()).collect();
        let wanted = Wanted::Items(module.to_owned(), names);
        kept::program(package, wanted, || Self::from_linked(package.link_items(module, items)?))
    }

    fn from_linked(linked: Linked) -> Result<Self, ReflectError> {
        let invalid = |diagnostic| ReflectError::Invalid(Box::new(diagnostic));
        if let Some(at) = linked.text().find('\0') {
            let message = "WGSL has no null character (U+0000), not even in a comment".to_owned();
            let mut diagnostic = Diagnostic::new(message);
            if let Some(span) = linked.spliced.resolve(at..at + 1) {
                diagnostic = diagnostic.at(span, "");
            }
            return Err(invalid(diagnostic));
        }
        if let Some(span) = linked.too_deep() {
            let message = "this expression is too long or too deep to be compiled".to_owned();
            let note = "compilers recurse over it: split it into several statements";
            return Err(invalid(Diagnostic::new(message).at(span, "").note(note)));
        }
        on_deep_stack(|| Self::compiled(linked))
    }

    fn compiled(linked: Linked) -> Result<Self, ReflectError> {
        let invalid = |diagnostic| ReflectError::Invalid(Box::new(diagnostic));
        let module = wgsl::parse_str(linked.text()).map_err(|error| {
            let labels = error.labels().map(|(span, text)| (span.to_range(), text.to_owned()));
            let notes = error.notes().map(str::to_owned).collect();
            invalid(to_author(&linked, error.message().to_owned(), labels, notes))
        })?;
        Self::from_ir(linked, module)
    }

    fn from_ir(linked: Linked, module: naga::Module) -> Result<Self, ReflectError> {
        let invalid = |diagnostic| ReflectError::Invalid(Box::new(diagnostic));
        let info = Validator::new(ValidationFlags::all(), Capabilities::all())
            .validate(&module)
            .map_err(|error| {
                let labels = error.spans().map(|(span, text)| (span.to_range(), text.clone()));
                // The innermost place says most; naga's labels name its own data structures.
                let mut labels: Vec<_> = labels.map(|(range, _)| (range, String::new())).collect();
                labels.sort_by_key(|(range, _)| {
                    range.as_ref().map_or(usize::MAX, ExactSizeIterator::len)
                });
                labels.dedup();
                let (message, notes) = causes(error.as_inner());
                invalid(to_author(&linked, message, labels.into_iter().take(2), notes))
            })?;
        let mut layouter = Layouter::default();
        layouter
            .update(module.to_ctx())
            .map_err(|error| invalid(Diagnostic::new(error.to_string())))?;
        Ok(Self { linked, module, info, layouter })
    }

    /// The linked WGSL.
    #[must_use]
    pub fn text(&self) -> &str {
        self.linked.text()
    }

    /// naga's IR of [`text`](Self::text).
    #[must_use]
    pub fn module(&self) -> &naga::Module {
        &self.module
    }

    /// The author's place for a range of [`text`](Self::text).
    #[must_use]
    pub fn resolve(&self, range: Range<usize>) -> Option<Span> {
        self.linked.spliced.resolve(range)
    }

    pub(crate) fn layouter(&self) -> &Layouter {
        &self.layouter
    }

    /// Reflects a function by its author's path.
    ///
    /// # Errors
    /// If a probe can't call it: pointers, runtime-sized arrays, no result, 64-bit types, or
    /// operations that only a fragment shader has.
    pub fn function(&self, path: &str) -> Result<Function, ReflectError> {
        let name = self.linked.name_of(path).unwrap_or(path);
        let found = self
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
        let stages = self.info[handle].available_stages;
        if !stages.contains(ShaderStages::COMPUTE) {
            return Err(refuse(
                "it uses operations of fragment shaders (derivatives, implicit-LOD sampling or \
                 discard)"
                    .to_owned(),
                "use textureSampleLevel or textureSampleGrad, or pass derivatives as arguments",
            ));
        }
        if let Some(shared) = self.shared_state(&self.info[handle]) {
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
            bindings: self.bindings(|global| self.info[handle][global]),
            span,
        })
    }

    /// The resources of an entry point.
    pub(crate) fn entry_point_bindings(&self, stage: Stage, name: &str) -> Option<Vec<Binding>> {
        let name = self.entry_point_name(name);
        let naga_stage = match stage {
            Stage::Vertex => naga::ShaderStage::Vertex,
            Stage::Fragment => naga::ShaderStage::Fragment,
        };
        let mut entries = self.module.entry_points.iter();
        let index = entries.position(|entry| entry.name == name && entry.stage == naga_stage)?;
        let info = self.info.get_entry_point(index);
        Some(self.bindings(|global| info[global]))
    }

    /// The name in the text of an entry point of the linked module.
    pub(crate) fn entry_point_name<'a>(&'a self, name: &'a str) -> &'a str {
        let is_it = |path: &str| path.rsplit("::").next() == Some(name);
        let mut names = self.linked.names.iter();
        let known = |text: &str| self.module.entry_points.iter().any(|e| e.name == text);
        names.find(|(text, path)| is_it(path) && known(text)).map_or(name, |(text, _)| text)
    }

    /// The first binding number of group 0 that the program leaves free.
    pub(crate) fn free_binding(&self) -> u32 {
        let used = self.module.global_variables.iter().filter_map(|(_, global)| {
            global.binding.as_ref().filter(|binding| binding.group == 0).map(|b| b.binding + 1)
        });
        used.max().unwrap_or(0)
    }

    /// What a function shares with other invocations, if anything.
    fn shared_state(&self, info: &naga::valid::FunctionInfo) -> Option<String> {
        use naga::AddressSpace;
        use naga::valid::UniformityRequirements;
        if info.uniformity.requirements.contains(UniformityRequirements::WORK_GROUP_BARRIER) {
            return Some("waits at a barrier".to_owned());
        }
        self.module.global_variables.iter().find_map(|(handle, global)| {
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
        match &self.module.types[ty].inner {
            naga::TypeInner::Array { base, size: naga::ArraySize::Dynamic, .. } => {
                self.shape(*base).ok()
            }
            _ => self.shape(ty).ok(),
        }
    }

    fn bindings(
        &self,
        usage: impl Fn(naga::Handle<naga::GlobalVariable>) -> GlobalUse,
    ) -> Vec<Binding> {
        let mut bindings: Vec<Binding> = self
            .module
            .global_variables
            .iter()
            .filter(|(handle, _)| !usage(*handle).is_empty())
            .filter_map(|(_, global)| {
                let resource = global.binding.as_ref()?;
                let name = global.name.clone().unwrap_or_default();
                Some(Binding {
                    path: self.linked.names.get(&name).cloned().unwrap_or(name),
                    group: resource.group,
                    binding: resource.binding,
                    kind: self.binding_kind(global),
                    ty: global.ty,
                })
            })
            .collect();
        bindings.sort_by_key(|binding| (binding.group, binding.binding));
        bindings
    }

    fn binding_kind(&self, global: &naga::GlobalVariable) -> BindingKind {
        use naga::{AddressSpace, ImageClass, ImageDimension, ScalarKind, TypeInner};
        match (global.space, &self.module.types[global.ty].inner) {
            (AddressSpace::Uniform, _) => BindingKind::Uniform,
            (AddressSpace::Storage { access }, _) => {
                BindingKind::Storage { writable: access.contains(naga::StorageAccess::STORE) }
            }
            (_, TypeInner::Sampler { comparison: false }) => BindingKind::Sampler,
            (
                _,
                TypeInner::Image {
                    dim,
                    arrayed: false,
                    class: ImageClass::Sampled { kind: ScalarKind::Float, multi: false },
                },
            ) => match dim {
                ImageDimension::D2 => BindingKind::Texture2d,
                ImageDimension::Cube => BindingKind::TextureCube,
                ImageDimension::D1 | ImageDimension::D3 => BindingKind::Other,
            },
            _ => BindingKind::Other,
        }
    }

    fn function_span(&self, handle: naga::Handle<naga::Function>) -> Span {
        let range = self.module.functions.get_span(handle).to_range().unwrap_or(0..0);
        self.resolve(range).unwrap_or(Span { file: Arc::clone(&self.linked.file), range: 0..0 })
    }

    /// The shape of a naga type, or what it is that a probe can't pass.
    fn shape(&self, ty: naga::Handle<naga::Type>) -> Result<Shape, String> {
        use naga::{ArraySize, TypeInner};
        let ty = &self.module.types[ty];
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

/// Runs what recurses as deep as a shader nests, on a stack that fits the deepest one that
/// [`Linked::too_deep`] lets through.
pub(crate) fn on_deep_stack<T>(work: impl FnOnce() -> T) -> T {
    /// naga's lowering takes up to some 20 KB a term in builds without optimisation.
    const STACK: usize = 256 << 20;
    stacker::grow(STACK, work)
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

/// The innermost cause of an error, then what led to it.
fn causes(error: &dyn std::error::Error) -> (String, Vec<String>) {
    let chain = std::iter::successors(Some(error), |cause| cause.source());
    let mut messages: Vec<String> =
        chain.map(|cause| without_handles(&cause.to_string())).collect();
    let message = messages.pop().unwrap_or_default();
    messages.reverse();
    (message, messages)
}

/// naga's messages without its handles, `[6]` and `Some([6])`, which mean nothing to an author.
fn without_handles(message: &str) -> String {
    let is_handle = |word: &str| {
        let word = word.trim_matches(|c| matches!(c, ',' | '.' | ':'));
        let word = word.strip_prefix("Some(").and_then(|w| w.strip_suffix(')')).unwrap_or(word);
        let digits = word.strip_prefix('[').and_then(|word| word.strip_suffix(']'));
        digits.is_some_and(|digits| digits.bytes().all(|byte| byte.is_ascii_digit()))
    };
    message.split(' ').filter(|word| !is_handle(word)).collect::<Vec<_>>().join(" ")
}

fn to_author(
    linked: &Linked,
    message: String,
    labels: impl Iterator<Item = (Option<Range<usize>>, String)>,
    notes: Vec<String>,
) -> Diagnostic {
    let mut diagnostic = Diagnostic { message, labels: Vec::new(), notes };
    for (range, text) in labels {
        if let Some(span) = range.and_then(|range| linked.spliced.resolve(range)) {
            // naga speaks of mangled names; the author's are shown.
            diagnostic = diagnostic.at(span, demangle(linked, &text));
        }
    }
    diagnostic.message = demangle(linked, &diagnostic.message);
    diagnostic.notes = diagnostic.notes.iter().map(|note| demangle(linked, note)).collect();
    if diagnostic.labels.is_empty() {
        let span = Span { file: Arc::clone(&linked.file), range: 0..0 };
        diagnostic = diagnostic.at(span, "in this module");
    }
    diagnostic
}

/// The author's names for mangled ones. Longer names first: one may begin another.
fn demangle(linked: &Linked, text: &str) -> String {
    let is_mangled = |(name, path): &(&String, &String)| path.rsplit("::").next() != Some(name);
    let mut mangled: Vec<_> = linked.names.iter().filter(is_mangled).collect();
    mangled.sort_by_key(|(name, _)| std::cmp::Reverse(name.len()));
    mangled.into_iter().fold(text.to_owned(), |text, (name, path)| text.replace(name, path))
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

#[cfg(test)]
mod tests;
