//! Calls one WGSL function with many cases.
//!
//! Karat generates a kernel that calls the function. The kernel is ordinary WGSL, which `karat show` prints. Before a
//! dispatch, Karat fills all results with poison. Each invocation writes a canary that only this dispatch uses. So if a
//! kernel doesn't run, or if the results come from another dispatch, Karat reports an error instead of a verdict. An
//! [`Executor`](crate::executor::Executor) runs the kernel.

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

/// A linked function and its kernel.
#[derive(Clone, Debug)]
pub struct Probed {
    /// The linked text with the function.
    pub program: Arc<Program>,
    /// The signature of the function.
    pub function: Function,
    /// The kernel that calls the function.
    pub kernel: Kernel,
}

impl Probed {
    /// Prepares the function `path`, such as `fresnel::schlick`.
    ///
    /// # Errors
    /// Returns an error if the function doesn't exist, if the shader isn't valid, or if a kernel can't call the
    /// function.
    pub fn new(package: &Package, path: &str) -> Result<Self, ProbeError> {
        Self::with_overrides(package, path, &Overrides::new())
    }

    /// Prepares a function as [`new`](Self::new) does, with values for overrides. The keys of `overrides` are names or
    /// `@id` numbers.
    ///
    /// # Errors
    /// Returns the errors of [`new`](Self::new), and an error if an override has no value, or if a name or number is
    /// unknown.
    pub fn with_overrides(
        package: &Package,
        path: &str,
        overrides: &BTreeMap<String, f64>,
    ) -> Result<Self, ProbeError> {
        Self::in_state(package, path, overrides, &State::new())
    }

    /// Prepares a function as [`with_overrides`](Self::with_overrides) does, but private variables become additional
    /// arguments and results. `state` has the variables that the function reads and writes, as [`Program::state_of`]
    /// finds them.
    ///
    /// # Errors
    /// As for [`with_overrides`](Self::with_overrides).
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

    /// Prepares a function for a test, as [`with_overrides`](Self::with_overrides) does. The function's whole module
    /// must be valid, because an application compiles the whole module. Karat doesn't check this for the modules of a
    /// crate, because many of them need features that the test didn't set.
    ///
    /// # Errors
    /// Returns the errors of [`with_overrides`](Self::with_overrides), and an error if the module isn't valid.
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

    /// Rewrites the kernel so that it reads its arguments from another source: a storage buffer, a uniform buffer or
    /// constants.
    ///
    /// # Errors
    /// Returns an error if the arguments of one case don't fit into a uniform buffer, or if the function needs a
    /// storage buffer for its arguments.
    pub(crate) fn with_inputs(self, inputs: Inputs) -> Result<Self, ProbeError> {
        let form = &self.function.form;
        if inputs != Inputs::Storage && (form.alone || form.fragment) {
            let reason =
                "the function writes data that other invocations see, or needs a quad of pixels"
                    .to_owned();
            return Err(ProbeError::Inputs { function: self.function.name, inputs, reason });
        }
        let kernel = Kernel::with_inputs(&self.program, &self.function, inputs);
        if kernel.largest_batch() == Some(0) {
            let reason = "one case's arguments are larger than 16 KiB".to_owned();
            return Err(ProbeError::Inputs { function: self.function.name, inputs, reason });
        }
        Ok(Self { kernel, ..self })
    }

    /// Gives each resource that the function writes the same length as its fixture.
    ///
    /// # Errors
    /// Returns an error if the fixtures don't match the variables.
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

    /// Adds inputs to the kernel: the derivatives of the parameters for which `varying` is `true`. These inputs have an
    /// effect only if the function takes derivatives.
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

    /// Prepares the kernel for arguments of these types. If the function takes derivatives, the kernel also gets the
    /// derivatives of each argument that has a value for each pixel of a quad.
    pub(crate) fn with_quads_of(self, arguments: &[Shape]) -> Self {
        if !self.takes_derivatives() {
            return self;
        }
        let varying: Vec<bool> = arguments.iter().map(|shape| shape.quad().is_some()).collect();
        self.with_quads(&varying)
    }

    /// If the function takes derivatives, adds the derivatives of each parameter that contains a float to the kernel's
    /// inputs. Without these inputs, each derivative would be 0, so the test would check nothing.
    #[must_use]
    pub fn with_varying(self) -> Self {
        if self.takes_derivatives() { self.varying() } else { self }
    }

    /// Adds the derivatives of each parameter that contains a float to the kernel's inputs, even if the function takes
    /// no derivatives.
    pub fn varying(self) -> Self {
        let parameters = self.function.parameters.iter();
        let floats = |shape: &Shape| shape.lanes().iter().any(|scalar| scalar.is_float());
        let varying: Vec<bool> = parameters.map(|(_, shape)| floats(shape)).collect();
        self.with_quads(&varying)
    }

    /// Checks if only fragment shaders may call the function. Each case is then a quad of 2 x 2 pixels.
    #[must_use]
    pub fn takes_derivatives(&self) -> bool {
        self.function.form.fragment
    }

    /// The signature, position, comment and resources of the function.
    #[must_use]
    pub fn function(&self) -> &Function {
        &self.function
    }

    /// The linked text with the function and everything that it uses.
    #[must_use]
    pub fn program(&self) -> &Program {
        &self.program
    }

    /// The name of the kernel's entry point.
    pub const ENTRY_POINT: &str = kernel::ENTRY_POINT;

    /// The WGSL text that drivers compile: the linked text, and then the kernel.
    #[must_use]
    pub fn kernel(&self) -> &str {
        &self.kernel.text
    }
}

impl ProbeError {
    /// Checks if the error is specific to the path: the path lacks an ability, or its driver doesn't compile the
    /// kernel.
    #[must_use]
    pub fn is_of_path(&self) -> bool {
        match self {
            Self::Lacks { .. } | Self::Compile { .. } => true,
            Self::Fixture(error) => error.is_unsupported(),
            _ => false,
        }
    }

    /// Checks if a path refuses the program before any part of the program runs. In this case the compiler or the route
    /// rejects the program, or the path lacks an ability.
    pub(crate) fn is_refusal(&self) -> bool {
        match self {
            Self::Lacks { .. } => true,
            Self::Fixture(error) => error.is_unsupported(),
            Self::Path(error) | Self::Compile { error, .. } => error.is_refusal(),
            _ => false,
        }
    }
}

/// The reason why a function returned no results.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProbeError {
    /// The shader has an error, or a kernel can't call the function.
    #[error(transparent)]
    Reflect(#[from] ReflectError),
    /// The fixtures don't match the variables.
    #[error(transparent)]
    Fixture(#[from] FixtureError),
    /// Karat can't use a path.
    #[error(transparent)]
    Path(#[from] PathError),
    /// The driver doesn't compile the kernel.
    #[error("the kernel of `{function}` doesn't compile: {error}")]
    Compile {
        /// The function.
        function: String,
        /// The driver's message.
        error: PathError,
    },
    /// The path lacks an ability that the function needs.
    #[error("`{function}` needs {ability}, which path `{path}` doesn't have")]
    Lacks {
        /// The function.
        function: String,
        /// The path.
        path: Path,
        /// The missing ability.
        ability: Ability,
    },
    /// The arguments can't come from the chosen source, such as a uniform buffer.
    #[error("Karat can't pass the arguments of `{function}` as {inputs} inputs: {reason}")]
    Inputs {
        /// The function.
        function: String,
        /// The source.
        inputs: Inputs,
        /// The reason.
        reason: String,
    },
    /// Some cases have no result.
    #[error(
        "the kernel of `{function}` wrote no result for {count} of {cases} cases on path `{path}` \
         (the first is case {first} of its dispatch): the driver didn't run the kernel, or ran another kernel"
    )]
    NotWritten {
        /// The function.
        function: String,
        /// The path.
        path: Path,
        /// The index of the first case without a result.
        first: u32,
        /// The number of cases without a result.
        count: usize,
        /// The number of cases in the dispatch.
        cases: usize,
    },
    /// The loops of a case take more iterations than the driver allows.
    #[error("{diagnostic}")]
    Rounds {
        /// The index of the case in its dispatch.
        case: usize,
        /// The message about the loop.
        diagnostic: Box<Diagnostic>,
    },
    /// An assertion of the shader is false.
    #[error("{0}")]
    Asserted(Box<Diagnostic>),
    /// Some results are still poison, because the kernel didn't write them.
    #[error(
        "the kernel of `{function}` ran on path `{path}`, but never wrote {count} of {words} result \
         words (the first is `result{component}` of case {first} of its dispatch): the driver drops writes, \
         or the kernel doesn't run the code that writes them"
    )]
    ResultNotWritten {
        /// The function.
        function: String,
        /// The path.
        path: Path,
        /// The first unwritten component of the result: `""` for a scalar, `.x` for a vector.
        component: String,
        /// The index of the first case with an unwritten component.
        first: u32,
        /// The number of unwritten words.
        count: usize,
        /// The number of words in all results.
        words: usize,
        /// All results, including the unwritten ones.
        partial: Box<Partial>,
    },
    /// The executor doesn't have enough memory for one case.
    #[error(
        "the executor of path `{path}` doesn't have enough memory for one case of `{function}`"
    )]
    NoRoom {
        /// The function.
        function: String,
        /// The path.
        path: Path,
    },
    /// An executor returned results of the wrong length.
    #[error("path `{path}` returned {found} u32 words instead of {expected}")]
    Length {
        /// The path.
        path: Path,
        /// The number of expected words.
        expected: usize,
        /// The number of returned words.
        found: usize,
    },
}

/// Results with unwritten words. An unwritten word still contains the poison, which is a NaN.
#[derive(Debug)]
pub struct Partial {
    /// The words of all cases: for each case, the words of its result and then its canary.
    pub(crate) words: Vec<u32>,
    pub(crate) stride: usize,
    /// The indices of the unwritten words in `words`.
    pub(crate) unwritten: Vec<usize>,
}

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
