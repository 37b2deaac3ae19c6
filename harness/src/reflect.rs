//! Reads a WGSL function's parameters, result and resources from naga's validated IR.
//!
//! A [`Program`] holds the linked text, the IR and the source map. All code that transforms or interprets shaders
//! starts from a [`Program`].

mod ability;
mod adapter;
mod attributes;
mod binding;
mod covering;
mod dependence;
mod element;
mod handles;
mod inputs;
mod kept;
mod layout;
mod limits;
mod literals;
mod locals;
mod message;
mod native;
mod normalized_text;
mod opinion;
mod outputs;
mod overrides;
mod parsed;
mod pipelines;
mod resource;
mod rounds;
mod signature;
mod subgroups;
mod tapped;
mod validation;

use std::ops::Range;
use std::sync::Arc;

pub(crate) use naga::Module as Ir;
use naga::front::wgsl;
use naga::proc::Layouter;
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};

pub use ability::Ability;
pub(crate) use adapter::ADAPTER;
pub use binding::Binding;
pub(crate) use covering::COVERING;
pub use dependence::Dependence;
pub use inputs::Input;
use kept::Wanted;
pub use layout::LayoutError;
pub(crate) use layout::{bytes_of, lanes_of};
pub use literals::Literals;
use message::{causes, to_author};
pub use opinion::{Opinion, Refused};
pub(crate) use outputs::Output;
pub use overrides::Overrides;
pub use parsed::parsed_with;
pub use resource::{Access, BindingKind, Dimension, Format, Texels, TextureKind};
pub use rounds::Watched;
pub(crate) use rounds::{COUNTERS, CountedLoop, Nesting, count_rounds};
pub(crate) use signature::Passed;
pub use signature::{Function, State};
pub(crate) use tapped::{TOLD, Telling, Valued, WORDS, When};
pub(crate) use validation::validate;
pub use validation::{Invalid, Validated};

use crate::diagnostic::{Blame, Blamed};
use crate::diagnostic::{Diagnostic, FileRead, Span};
pub use crate::package::stage::Stage;
use crate::package::workspace::{self, Kind};
use crate::package::{Linked, LinkedModule, Package, PackageError, as_naga_takes};

/// A linked and validated shader: its text, its IR, and the map from the text to the author's files.
#[derive(Debug)]
pub struct Program {
    linked: Linked,
    checked: Arc<Checked>,
    /// The values of overrides, by the overrides' names in the linked text. The IR contains these values as the
    /// overrides' initial values.
    overrides: Overrides,
}

#[derive(Debug)]
struct Checked {
    module: naga::Module,
    info: ModuleInfo,
    layouter: Layouter,
    subgroups: bool,
}

impl Kind for Checked {
    type Key = blake3::Hash;
    type Value = Arc<Self>;
    // Even a large package has fewer functions and tests than this.
    const MOST: usize = 2048;
}

/// The text for `expect` on names in naga's IR, where names are optional. naga's WGSL front end gives a name to each
/// function, argument, member, variable and override.
const NAMED: &str = "WGSL names it";

/// The reason why Karat can't reflect a shader or probe a function.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReflectError {
    /// The package has an error.
    #[error(transparent)]
    Package(#[from] PackageError),
    /// naga rejects the shader.
    #[error("{0}")]
    Invalid(Box<Diagnostic>),
    /// Tint rejects the shader, or the shader exceeds a limit, and `karat.toml` makes this an error.
    #[error("{0}")]
    Refused(Box<Diagnostic>),
    /// The function is valid, but a compute kernel can't call it.
    #[error("{0}")]
    Unprobeable(Box<Diagnostic>),
    /// An override has no value, or its value is invalid.
    #[error("{0}")]
    Override(Box<Diagnostic>),
}

impl ReflectError {
    /// The error's message with its source locations; `None` if the error has no locations.
    #[must_use]
    pub fn diagnostic(&self) -> Option<&Diagnostic> {
        match self {
            Self::Package(PackageError::Shader(found))
            | Self::Invalid(found)
            | Self::Refused(found)
            | Self::Unprobeable(found)
            | Self::Override(found) => Some(found),
            Self::Package(_) => None,
        }
    }
}

impl Program {
    pub(crate) fn files(&self) -> &[FileRead] {
        self.linked.sources.files()
    }

    /// The program's features, and the values of its overrides, as text: `SHADOWS, SAMPLES=4`.
    #[must_use]
    pub fn variant(&self) -> String {
        let overrides = self.overrides.iter().map(|(name, value)| format!("{name}={value}"));
        let all: Vec<String> =
            self.linked.sources.features().into_iter().chain(overrides).collect();
        all.join(", ")
    }

    /// The path in the author's code, such as `fresnel::schlick`, of the function with this name in the linked text.
    pub(crate) fn path_of(&self, linked: &str) -> String {
        self.linked.names.get(linked).map_or(linked, String::as_str).to_owned()
    }

    pub(crate) fn modules(&self) -> &[LinkedModule] {
        self.linked.sources.modules()
    }

    /// Links and validates one function with everything that it uses.
    ///
    /// ```
    /// use karat::Package;
    /// use karat::unstable::reflect::Program;
    ///
    /// let text = "fn f() -> f32 { return 1.0; } fn g() -> f32 { return 2.0; }";
    /// let program = Program::of_function(&Package::from_source("m", text), "f")?;
    /// assert!(!program.text().contains("2.0")); // only what it uses
    /// # Ok::<(), karat::unstable::reflect::ReflectError>(())
    /// ```
    ///
    /// # Errors
    /// Returns an error if the function can't be linked, or the linked text isn't valid WGSL.
    pub fn of_function(package: &Package, path: &str) -> Result<Arc<Self>, ReflectError> {
        dependence::program(package, &Wanted::Function(path.to_owned()))
    }

    /// Links and validates a whole module with everything that the module declares. If a module has no imports and no
    /// conditions, naga gets the module's text unchanged.
    ///
    /// # Errors
    /// Returns an error if the module can't be linked, or the linked text isn't valid WGSL.
    pub fn of_module(package: &Package, module: &str) -> Result<Arc<Self>, ReflectError> {
        dependence::program(package, &Wanted::Module(module.to_owned()))
    }

    /// Links and validates some declarations of one module with everything that these declarations use.
    ///
    /// # Errors
    /// Returns an error if the declarations can't be linked, or the linked text isn't valid WGSL.
    pub fn of_items(
        package: &Package,
        module: &str,
        items: &[&str],
    ) -> Result<Arc<Self>, ReflectError> {
        let names = items.iter().map(|item| (*item).to_owned()).collect();
        dependence::program(package, &Wanted::Items(module.to_owned(), names))
    }

    fn from_linked(linked: Linked) -> Result<Self, ReflectError> {
        let invalid = |diagnostic| ReflectError::Invalid(Box::new(diagnostic));
        if let Some(at) = linked.text().find('\0') {
            let message =
                "WGSL forbids the null character (U+0000), even in comments: remove the character"
                    .to_owned();
            let mut diagnostic = Diagnostic::new(message);
            if let Some(span) = linked.spliced.resolve(at..at + 1) {
                diagnostic = diagnostic.at(span, "");
            }
            return Err(invalid(diagnostic));
        }
        if let Some(span) = linked.too_deep() {
            let message =
                "this expression is too long, or nested too deeply, for compilers".to_owned();
            let note = "split the expression into several statements";
            return Err(invalid(Diagnostic::new(message).at(span, "").note(note)));
        }
        on_deep_stack(|| Self::compiled(linked))
    }

    /// Parses and validates a linked text. A cache keeps the result for each text. After an edit, most functions have
    /// the same linked text as before, so Karat doesn't parse them again.
    fn compiled(linked: Linked) -> Result<Self, ReflectError> {
        let hash = blake3::hash(linked.text().as_bytes());
        if let Some(checked) = workspace::get::<Checked>(&hash) {
            return Ok(Self { linked, checked, overrides: Overrides::new() });
        }
        let program = Self::parsed(linked)?;
        workspace::keep::<Checked>(hash, Arc::clone(&program.checked));
        Ok(program)
    }

    fn parsed(linked: Linked) -> Result<Self, ReflectError> {
        let invalid = |diagnostic| ReflectError::Invalid(Box::new(diagnostic));
        let module = wgsl::parse_str(&as_naga_takes(linked.text())).map_err(|error| {
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
                // Of naga's locations, the innermost one is the most useful. naga's labels name its own data
                // structures, so Karat drops the labels' text.
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
        let subgroups = subgroups::has_subgroups(&module);
        let checked = Arc::new(Checked { module, info, layouter, subgroups });
        Ok(Self { linked, checked, overrides: Overrides::new() })
    }

    /// A copy of the program with generated declarations after its text.
    pub fn followed_by(&self, text: &str) -> Result<Self, ReflectError> {
        let mut linked = self.linked.clone();
        linked.spliced.append(text);
        Self::compiled(linked)
    }

    /// Parses and validates the text of a kernel for this program. Returns naga's IR, and the facts that naga's
    /// validator finds.
    pub(crate) fn kernel(&self, text: &str) -> Result<(naga::Module, ModuleInfo), String> {
        let module = parsed_with(text, &self.overrides)?;
        let mut validator = Validator::new(ValidationFlags::all(), Capabilities::all());
        let info = validator.validate(&module).map_err(|error| error.to_string())?;
        Ok((naga::Module::clone(&module), info))
    }

    /// The linked WGSL.
    #[must_use]
    pub fn text(&self) -> &str {
        self.linked.text()
    }

    /// The values of overrides, by the overrides' names in the linked text.
    pub fn overrides(&self) -> &Overrides {
        &self.overrides
    }

    /// naga's IR of [`text`](Self::text).
    #[must_use]
    pub fn module(&self) -> &naga::Module {
        &self.checked.module
    }

    /// The location in the author's file for a range of [`text`](Self::text).
    #[must_use]
    pub fn resolve(&self, range: Range<usize>) -> Option<Span> {
        self.linked.spliced.resolve(range)
    }

    pub(crate) fn abilities(&self, bindings: &[Binding]) -> Vec<Ability> {
        use BindingKind as K;
        let has = |is: fn(K) -> bool| bindings.iter().any(|binding| is(binding.kind));
        let textures = has(|kind| {
            matches!(kind, K::Texture(_) | K::StorageTexture { .. } | K::Sampler { .. })
        });
        let immediates = has(|kind| kind == K::Immediate);
        let f16 = self.linked.enables("f16");
        let all = [
            (Ability::F16, f16),
            (Ability::Textures, textures),
            (Ability::Immediates, immediates),
            (Ability::Subgroups, self.has_subgroups()),
        ];
        all.into_iter().filter_map(|(ability, needed)| needed.then_some(ability)).collect()
    }

    /// The location of the expectation with the number `call`.
    pub(crate) fn expectation(&self, call: u32) -> Option<&Span> {
        self.linked.calls.get(&call)
    }

    /// The ranges of [`text`](Self::text) that authors wrote, with their locations.
    pub(crate) fn sources(&self) -> Vec<(Range<usize>, Span)> {
        self.linked.spliced.stretches()
    }

    /// Converts the `u32` words in a resource's memory into the scalars of the resource's value. A texture has four
    /// words per texel.
    pub(crate) fn lanes_of_words(&self, binding: &Binding, words: &[u32]) -> Vec<u32> {
        match binding.kind {
            BindingKind::StorageTexture { format, .. } => {
                // The engine and drivers return four words per texel in every format.
                let texels = words.chunks_exact(4);
                texels.flat_map(|texel| &texel[..format.channels()]).copied().collect()
            }
            _ => {
                let bytes = bytemuck::cast_slice(words);
                lanes_of(self.module(), binding.ty, bytes)
                    .expect("a resource is as large as its type, which has a shape")
            }
        }
    }

    pub(crate) fn info(&self) -> &ModuleInfo {
        &self.checked.info
    }

    /// The name in the linked text, for the declaration that has this path in the author's code.
    pub fn name_of<'a>(&'a self, path: &'a str) -> &'a str {
        self.linked.name_of(path).unwrap_or(path)
    }

    pub(crate) fn layouter(&self) -> &Layouter {
        &self.checked.layouter
    }

    /// The name in the linked text, for the entry point with this name in the author's code.
    pub fn entry_point_name<'a>(&'a self, name: &'a str) -> &'a str {
        let is_it = |path: &str| path.rsplit("::").next() == Some(name);
        let mut names = self.linked.names.iter();
        let known = |text: &str| self.checked.module.entry_points.iter().any(|e| e.name == text);
        names.find(|(text, path)| is_it(path) && known(text)).map_or(name, |(text, _)| text)
    }
}

/// Runs code that recurses once for each level of nesting in a shader. The stack suffices for the deepest shader that
/// [`Linked::too_deep`] accepts.
pub(crate) fn on_deep_stack<T>(work: impl FnOnce() -> T) -> T {
    /// naga's lowering takes up to about 20 KB of stack per term in builds without optimisation.
    const STACK: usize = 256 << 20;
    stacker::grow(STACK, work)
}

/// The text of the expression at `range`. For a call, naga stores only the range of the function's name, so this
/// function adds the arguments.
pub(crate) fn whole_call(text: &str, range: Range<usize>) -> Option<&str> {
    let rest = text.get(range.end..)?;
    let mut depth = 0;
    let mut brackets = rest.char_indices().filter(|(_, c)| "()".contains(*c));
    let length = rest.trim_start().starts_with('(').then(|| {
        brackets.find(|(_, bracket)| {
            depth += if *bracket == '(' { 1 } else { -1 };
            depth == 0
        })
    });
    let end = length.flatten().map_or(range.end, |(at, _)| range.end + at + 1);
    text.get(range.start..end)
}

impl Blamed for ReflectError {
    fn blame(&self) -> Blame<'_> {
        let setting: &[_] = if matches!(self, Self::Override(_)) { &["override"] } else { &[] };
        Blame::of(self.diagnostic(), setting)
    }
}

#[cfg(test)]
mod tests;
