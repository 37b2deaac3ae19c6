//! Calling one WGSL function over many cases.
//!
//! The kernel is ordinary WGSL (`karat show` prints it). Results are poisoned before a dispatch
//! and each invocation writes back a canary that only this dispatch knows, so a kernel that
//! doesn't run, or runs on other data, is an error and never a verdict. What runs it is an
//! [`Executor`](crate::executor::Executor).

mod borders;
mod bound;
mod dispatcher;
pub(crate) mod evidence;
mod inputs;
mod kept;
mod kernel;
mod lets;
mod painted;
mod poison;
mod prepared;
mod quads;
mod rounds;
mod runner;
mod texels;
mod upload;

pub use inputs::Inputs;
pub(crate) use kept::{Kept, count};
pub(crate) use kernel::RESULTS;
pub(crate) use kernel::{CONSTANTS, Kernel, UNIFORM_WORDS, WORKGROUP};
pub use lets::Let;
pub use lets::lets;
pub use prepared::{Call, Prepared, Reader, Started};
pub(crate) use rounds::VECTOR;
pub(crate) use runner::{BATCH, Runner};
pub(crate) use texels::Codec;
pub(crate) use upload::{Resource, compare, upload, upload_shared};

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::diagnostic::Diagnostic;
use crate::diagnostic::{Blame, Blamed};
use crate::fixture::{self, FixtureError, Fixtures};
use crate::package::Package;
use crate::path::{Ability, Path, PathError};
use crate::reflect::{Function, Overrides, Program, ReflectError, State};
use crate::value::Shape;

/// A function, linked, reflected, and with its kernel.
#[derive(Clone, Debug)]
pub struct Probed {
    /// The text that it stands in.
    pub program: Arc<Program>,
    /// Its signature.
    pub function: Function,
    /// What calls it.
    pub kernel: Kernel,
}

impl Probed {
    /// Prepares a probe of `path` (`fresnel::schlick`).
    ///
    /// # Errors
    /// If there is no such function, the shader isn't valid, or a kernel can't call it.
    pub fn new(package: &Package, path: &str) -> Result<Self, ProbeError> {
        Self::with_overrides(package, path, &Overrides::new())
    }

    /// The same with values of overrides, by their names or numbers.
    ///
    /// # Errors
    /// Those of [`new`](Self::new); and if an override has no value, or there is no such override.
    pub fn with_overrides(
        package: &Package,
        path: &str,
        overrides: &BTreeMap<String, f64>,
    ) -> Result<Self, ProbeError> {
        Self::in_state(package, path, overrides, &State::new())
    }

    /// The same that takes and gives private variables, too, of which a function gets and leaves values, as
    /// [`Program::state_of`] gives them.
    ///
    /// # Errors
    /// Those of [`with_overrides`](Self::with_overrides).
    pub fn in_state(
        package: &Package,
        path: &str,
        overrides: &BTreeMap<String, f64>,
        state: &State,
    ) -> Result<Self, ProbeError> {
        let program = Program::of_function(package, path)?.with_state(state)?;
        let program = program.overridden(overrides)?;
        let function = program.function_in_state(path, state)?;
        fixture::expect_apart(&function.bindings)?;
        let kernel = Kernel::new(&program, &function);
        Ok(Self { program, function, kernel })
    }

    /// The same of a test. An engine takes a module whole, so what the function doesn't reach must be valid, too, but where
    /// somebody else wrote it: modules of crates are whole with some features only.
    ///
    /// # Errors
    /// Those of [`with_overrides`](Self::with_overrides); and if the module isn't valid.
    pub fn in_valid(
        package: &Package,
        path: &str,
        overrides: &BTreeMap<String, f64>,
    ) -> Result<Self, ProbeError> {
        let probed = Self::with_overrides(package, path, overrides)?;
        if !package.is_crate() {
            let module = path.rsplit_once("::").map_or("", |(module, _)| module);
            crate::reflect::validate(package, module, &Program::of_function(package, path)?)?;
        }
        Ok(probed)
    }

    /// The same with another source of the arguments.
    ///
    /// # Errors
    /// If one case's arguments don't fit into a uniform buffer.
    pub(crate) fn with_inputs(self, inputs: Inputs) -> Result<Self, ProbeError> {
        let form = &self.function.form;
        if inputs != Inputs::Storage && (form.alone || form.fragment) {
            let reason = "it writes what others would see, or needs a quad of pixels".to_owned();
            return Err(ProbeError::Inputs { function: self.function.name, inputs, reason });
        }
        let kernel = Kernel::with_inputs(&self.program, &self.function, inputs);
        if kernel.largest_batch() == Some(0) {
            let reason = "one case's arguments are larger than 16 KiB".to_owned();
            return Err(ProbeError::Inputs { function: self.function.name, inputs, reason });
        }
        Ok(Self { kernel, ..self })
    }

    /// Takes note of how long what it writes is, which its fixtures say.
    ///
    /// # Errors
    /// If fixtures and variables don't match.
    pub fn fit(&mut self, fixtures: &Fixtures) -> Result<(), ProbeError> {
        if self.function.written().next().is_none() {
            return Ok(());
        }
        let mut written = Vec::new();
        for (binding, fixture) in fixture::resolve(&self.function.bindings, fixtures)? {
            if binding.kind.is_written() {
                let count = count(&self.program, binding, fixture)?;
                let shape = self.program.written_shape(binding, Some(count));
                written.extend(shape.map(|shape| (binding.name().to_owned(), shape)));
            }
        }
        self.function.join(written);
        Ok(())
    }

    /// The same where these parameters are given with their derivatives. Others are too, in vain, if
    /// the function isn't one of fragments.
    #[must_use]
    pub fn with_quads(mut self, varying: &[bool]) -> Self {
        if varying.contains(&true) {
            for ((_, shape), _) in
                self.function.parameters.iter_mut().zip(varying).filter(|(_, varies)| **varies)
            {
                *shape = shape.as_quad();
            }
            self.kernel = Kernel::with_inputs(&self.program, &self.function, self.kernel.inputs());
        }
        self
    }

    /// The same for arguments of these types: those that are quads vary, if it takes derivatives.
    pub(crate) fn with_quads_of(self, arguments: &[Shape]) -> Self {
        if !self.takes_derivatives() {
            return self;
        }
        let varying: Vec<bool> = arguments.iter().map(|shape| shape.quad().is_some()).collect();
        self.with_quads(&varying)
    }

    /// The same where each parameter that has a float is given with its derivatives, if the function
    /// takes any: with arguments that don't vary each derivative is 0, and nothing is tried.
    #[must_use]
    pub fn with_varying(self) -> Self {
        if self.takes_derivatives() { self.varying() } else { self }
    }

    /// The same where each parameter that has a float is given with its derivatives, be they taken or
    /// not.
    pub fn varying(self) -> Self {
        let parameters = self.function.parameters.iter();
        let floats = |shape: &Shape| shape.lanes().iter().any(|scalar| scalar.is_float());
        let varying: Vec<bool> = parameters.map(|(_, shape)| floats(shape)).collect();
        self.with_quads(&varying)
    }

    /// Whether only fragment shaders may call it, so that each case is a quad of pixels.
    #[must_use]
    pub fn takes_derivatives(&self) -> bool {
        self.function.form.fragment
    }

    /// The function's signature, place, comment and resources.
    #[must_use]
    pub fn function(&self) -> &Function {
        &self.function
    }

    /// The function with all that it uses.
    #[must_use]
    pub fn program(&self) -> &Program {
        &self.program
    }

    /// The entry point of the kernel.
    pub const ENTRY_POINT: &str = kernel::ENTRY_POINT;

    /// The whole text that is compiled: the function with all that it uses, then the kernel.
    #[must_use]
    pub fn kernel(&self) -> &str {
        &self.kernel.text
    }
}

impl ProbeError {
    /// Whether it is the path that can't do what the function needs, so that others may.
    #[must_use]
    pub fn is_of_path(&self) -> bool {
        match self {
            Self::Lacks { .. } | Self::Compile { .. } => true,
            Self::Fixture(error) => error.is_unsupported(),
            _ => false,
        }
    }

    /// True if a path refuses what it is given before any of it runs: its compiler or its route doesn't take
    /// it, or the path lacks what it needs.
    pub(crate) fn is_refusal(&self) -> bool {
        match self {
            Self::Lacks { .. } => true,
            Self::Fixture(error) => error.is_unsupported(),
            Self::Path(error) | Self::Compile { error, .. } => error.is_refusal(),
            _ => false,
        }
    }
}

/// Why a function gave no results.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProbeError {
    /// The shader is at fault, or can't be probed.
    #[error(transparent)]
    Reflect(#[from] ReflectError),
    /// Fixtures and variables don't match.
    #[error(transparent)]
    Fixture(#[from] FixtureError),
    /// A path can't be used.
    #[error(transparent)]
    Path(#[from] PathError),
    /// The driver doesn't compile the kernel.
    #[error("the probe of `{function}` doesn't compile: {error}")]
    Compile {
        /// The function.
        function: String,
        /// What the driver says.
        error: PathError,
    },
    /// The path hasn't all that the function needs.
    #[error("`{function}` needs {ability}, which path `{path}` doesn't have")]
    Lacks {
        /// The function.
        function: String,
        /// The path.
        path: Path,
        /// The ability that it lacks.
        ability: Ability,
    },
    /// The arguments can't come from this source.
    #[error("the arguments of `{function}` can't come from {inputs} inputs: {reason}")]
    Inputs {
        /// The function.
        function: String,
        /// The source.
        inputs: Inputs,
        /// Why not.
        reason: String,
    },
    /// Some cases have no result.
    #[error(
        "the kernel of `{function}` wrote no result for {count} of {cases} cases on path `{path}` \
         (first: case {first} of its dispatch): the driver didn't run it, or ran something else"
    )]
    NotWritten {
        /// The function.
        function: String,
        /// The path.
        path: Path,
        /// First case without a result.
        first: u32,
        /// How many have none.
        count: usize,
        /// Of how many.
        cases: usize,
    },
    /// The loops of a case take more rounds than the driver allows.
    #[error("{diagnostic}")]
    Rounds {
        /// Index of the case in its dispatch.
        case: usize,
        /// The loop.
        diagnostic: Box<Diagnostic>,
    },
    /// An assertion of the shader is false.
    #[error("{0}")]
    Asserted(Box<Diagnostic>),
    /// Some results weren't written: they still are what they were set to before the kernel ran.
    #[error(
        "the kernel of `{function}` ran on path `{path}`, but never wrote {count} of {words} result \
         words (first: `result{component}` of case {first} of its dispatch): the driver drops \
         writes, or the kernel doesn't reach them"
    )]
    ResultNotWritten {
        /// The function.
        function: String,
        /// The path.
        path: Path,
        /// The first component that wasn't written: `""` for a scalar, `.x`.
        component: String,
        /// Its case.
        first: u32,
        /// How many words weren't written.
        count: usize,
        /// Of how many.
        words: usize,
        /// The text that was written.
        partial: Box<Partial>,
    },
    /// The executor has no room for even one case.
    #[error("the executor of path `{path}` has room for no case of `{function}`")]
    NoRoom {
        /// The function.
        function: String,
        /// The path.
        path: Path,
    },
    /// The read-back has the wrong length.
    #[error("path `{path}` returned {found} words instead of {expected}")]
    Length {
        /// The path.
        path: Path,
        /// Words that were asked for.
        expected: usize,
        /// Words that were returned.
        found: usize,
    },
}

/// Results of which some words were never written. They still are a NaN.
#[derive(Debug)]
pub struct Partial {
    /// The words of each case, and one more.
    pub(crate) words: Vec<u32>,
    pub(crate) stride: usize,
    /// Which of them weren't written.
    pub(crate) unwritten: Vec<usize>,
}

/// The shapes of a function's parameters.
pub(crate) fn parameter_shapes(function: &Function) -> Vec<&Shape> {
    function.parameters.iter().map(|(_, shape)| shape).collect()
}

impl Blamed for ProbeError {
    fn blame(&self) -> Blame<'_> {
        match self {
            Self::Reflect(error) => error.blame(),
            Self::Fixture(error) => error.blame(),
            Self::Rounds { diagnostic, .. } | Self::Asserted(diagnostic) => {
                Blame::of(Some(diagnostic), &[])
            }
            _ => Blame::TEST,
        }
    }
}
