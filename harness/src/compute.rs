//! Tests of compute passes. A test dispatches compute entry points that use the test's buffers and textures. Then the
//! test compares the contents of a buffer or texture with a reference, or checks a statement about these contents.
//!
//! ```no_run
//! use karat::prelude::*;
//!
//! static SHADERS: Package = karat::package!("shaders");
//!
//! let values: Vec<u32> = (0..256).collect();
//! let sums = values.iter().scan(0, |sum, value| { *sum += value; Some(*sum) });
//! SHADERS
//!     .compute()
//!     .with("data", Storage::new(values.iter().copied()))
//!     .dispatch("scan::blocks", [4, 1, 1])
//!     .dispatch("scan::add", [4, 1, 1])
//!     .after("data")
//!     .agrees_with(sums, Abs(0.0));
//! ```
//!
//! Before other paths run the passes, Karat's engine runs the passes with the sanitizer, which reports each
//! [`Violation`](crate::unstable::compute::Violation).

mod golden;
pub(crate) mod judge;
pub(crate) mod order;
pub(crate) mod sanitizer;
mod tap;
pub(crate) mod untyped;

use std::fmt;
use std::panic::Location;

use crate::diagnostic::{Blame, Blamed};
use crate::dispatch::{DispatchError, Part, Passes, Wanted};
use crate::executor::{self, Executor};
use crate::fixture::{Fixture, Fixtures};
use crate::golden::ValuesError;
use crate::package::Package;
use crate::path::{Adapter, Path, PathError, Selected, Selector};
use crate::probe::ProbeError;
use crate::record::Details;
use crate::reflect::Overrides;
use crate::run::{
    Fails, KnownIssue, KnownIssues, NotBegun, Passed, PathFailures, Stop, WrongDeclaration,
    or_panic,
};
use crate::tolerance::{LaneError, Tolerance};
use crate::value::{Mirror, Shape, Shareable};

/// Compute passes and their resources.
///
/// ```
/// use karat::prelude::*;
///
/// let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
///             @compute @workgroup_size(4) fn double(@builtin(global_invocation_id) id: vec3u) {
///                 data[id.x] *= 2u;
///             }";
/// let package = Package::from_source("m", text);
/// let doubled = || {
///     let data = Storage::new([1_u32, 2, 3, 4]);
///     package.compute().with("data", data).dispatch("double", [1, 1, 1]).after("data")
/// };
/// doubled().agrees_with([2_u32, 4, 6, 8], Abs(0.0));
/// doubled().satisfies("is even", |data: &[u32]| data.iter().all(|x| x % 2 == 0));
/// ```
#[derive(Clone, Debug)]
#[must_use = "nothing is dispatched until `.after(...)` and a verb such as `.agrees_with(...)`"]
pub struct Compute<'a> {
    package: &'a Package,
    wanted: Vec<Wanted>,
    fixtures: Fixtures,
    /// Pairs of variables. The first variable of a pair shares the resource of the second variable.
    same: Vec<(String, String)>,
    overrides: Overrides,
    executors: Vec<&'a dyn Executor>,
    tolerance_on: Selected<Tolerance>,
    known_issues: KnownIssues,
    /// Races that the test accepts.
    accepted: Vec<sanitizer::Accepted>,
}

/// A resource whose contents a test checks after the compute passes.
///
/// ```
/// # use karat::prelude::*;
/// let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
///             @compute @workgroup_size(1) fn count() { data[0] = 7u; }";
/// let package = Package::from_source("m", text);
/// let passes = package.compute().with("data", Storage::new([0_u32])).dispatch("count", [1, 1, 1]);
/// passes.after("data").satisfies("is odd", |data: &[u32]| data[0] % 2 == 1);
/// ```
#[derive(Clone, Debug)]
#[must_use = "nothing is compared until a verb such as `.agrees_with(...)`"]
pub struct After<'a> {
    compute: Compute<'a>,
    variable: String,
    /// `true` if Karat writes a record of the verdict.
    recorded: bool,
    /// `true` if the check ignores the order of the elements.
    up_to_order: bool,
    /// The numbers of rows and columns that [`After::grid`] sets. `None` if the test doesn't call this method.
    grid: Option<[usize; 2]>,
}

/// The result of a check that passed.
///
/// ```
/// # use karat::prelude::*;
/// let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
///             @compute @workgroup_size(1) fn count() { data[0] = 7u; }";
/// let package = Package::from_source("m", text);
/// let passes = package.compute().with("data", Storage::new([0_u32])).dispatch("count", [1, 1, 1]);
/// let agreement = passes.after("data").agrees_with([7_u32], Abs(0.0));
/// assert_eq!((agreement.variable.as_str(), agreement.elements), ("data", 1));
/// ```
#[derive(Clone, Debug)]
pub struct ComputeAgreement {
    /// The name of the resource's variable.
    pub variable: String,
    /// The number of elements that the check compared on each path.
    pub elements: usize,
    /// Each path with its largest error.
    pub paths: Vec<(Adapter, LaneError)>,
    /// The paths on which the check fails, as the test declared with `fails_on`.
    pub known_issues: Vec<KnownIssue>,
}

/// The reason why passes fail, or why Karat can't judge them.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ComputeError {
    /// Karat can't dispatch the passes.
    #[error(transparent)]
    Dispatch(#[from] DispatchError),
    /// An environment variable has an unusable value, or asks Karat to replay another check.
    #[error(transparent)]
    NotBegun(#[from] NotBegun),
    /// The elements of the reference and of the resource differ in type.
    #[error("`{variable}` holds {declared} after `{entry_point}`, but {who} {supplied}")]
    Type {
        /// The name of the resource's variable.
        variable: String,
        /// The entry point of the last pass.
        entry_point: String,
        /// The type of the resource's elements.
        declared: String,
        /// A phrase for messages that names the source of the wrong type: `the reference gives`.
        who: &'static str,
        /// The wrong type.
        supplied: String,
    },
    /// The reference and the resource differ in their number of elements.
    #[error(
        "`{variable}` has {found} elements after `{entry_point}`, but the reference has {expected}"
    )]
    Count {
        /// The name of the resource's variable.
        variable: String,
        /// The entry point of the last pass.
        entry_point: String,
        /// The number of elements in the resource.
        found: usize,
        /// The number of elements in the reference.
        expected: usize,
    },
    /// The number of elements isn't the number of rows times the number of columns in [`After::grid`].
    #[error("`{variable}` has {elements} elements, but {} rows of {} columns have {}: correct the rows or the columns", grid[0], grid[1], grid[0].saturating_mul(grid[1]))]
    Grid {
        /// The name of the resource's variable.
        variable: String,
        /// The number of elements in the resource.
        elements: usize,
        /// The numbers of rows and columns that the test sets.
        grid: [usize; 2],
    },
    /// There are no elements to compare.
    #[error("nothing is compared: {0}")]
    Nothing(String),
    /// The passes didn't change the resource.
    #[error(
        "`{variable}` has the same contents after the passes as before, so the check can't show that the passes \
         did anything: start with other contents"
    )]
    Unchanged {
        /// The name of the resource's variable.
        variable: String,
    },
    /// A value of the reference isn't finite.
    #[error(
        "the reference of `{variable}` is {value} at [{index}], but a reference must be finite"
    )]
    Reference {
        /// The name of the resource's variable.
        variable: String,
        /// The index of the element.
        index: usize,
        /// The value of the reference.
        value: f64,
    },
    /// The bound of a tolerance is negative or NaN, or is so large that every result would pass.
    #[error(
        "the tolerance {tolerance} isn't usable, because its bound is {bound:e}: use a number of at least 0, small enough that some results fail"
    )]
    Bound {
        /// The tolerance that a test set.
        tolerance: Tolerance,
        /// The bound that can't be used.
        bound: f64,
    },
    /// A declaration about a path, such as `fails_on`, is wrong or has no reason.
    #[error(transparent)]
    Declaration(#[from] WrongDeclaration),
    /// Several paths fail in different ways, or some paths have no verdict.
    #[error("{0}")]
    Paths(Box<PathFailures<Self>>),
    /// The sanitizer finds violations in the passes, such as a race.
    #[error("{0}")]
    Violations(Box<Violations>),
    /// The test accepts a race that doesn't occur, gives no reason for accepting a race, or names an unknown variable.
    #[error("`{verb}` of `{variable}` {what}")]
    Accepted {
        /// The method that accepts the race.
        verb: &'static str,
        /// The variable on which invocations race.
        variable: String,
        /// The mistake in the declaration.
        what: String,
    },
    /// The results of passes depend on the order of their invocations.
    #[error("{0}")]
    Order(Box<OrderDependence>),
    /// Elements differ.
    #[error("{0}")]
    Differs(Box<Difference>),
    /// Elements differ from their golden, or the golden doesn't exist.
    #[error("{}{cause}", difference.as_ref().map_or_else(String::new, ToString::to_string))]
    Golden {
        /// The elements that differ.
        difference: Option<Box<Difference>>,
        /// The cause, and what to do.
        cause: Box<ValuesError>,
    },
}

impl From<ValuesError> for ComputeError {
    fn from(source: ValuesError) -> Self {
        Self::Golden { difference: None, cause: Box::new(source) }
    }
}

/// The old name of [`HazardKind`](crate::check::HazardKind).
///
/// ```
/// #[expect(deprecated, reason = "its name is another one")]
/// use karat::compute::ViolationKind;
///
/// #[expect(deprecated, reason = "its name is another one")]
/// let barrier = ViolationKind::Barrier;
/// assert_eq!(barrier, karat::check::HazardKind::Barrier);
/// ```
#[deprecated(
    note = "use `check::HazardKind`, which has `Race` instead of `ReadWrite` and `WriteWrite`, and `OutOfRange` instead of `Outside`"
)]
pub type ViolationKind = crate::hazard::Kind;
pub(crate) use judge::Difference;
pub(crate) use order::OrderDependence;
pub(crate) use sanitizer::Violations;

impl From<PathError> for ComputeError {
    fn from(error: PathError) -> Self {
        Self::Dispatch(error.into())
    }
}

impl Blamed for ComputeError {
    fn blame(&self) -> Blame<'_> {
        match self {
            Self::Differs(_) | Self::Violations(_) | Self::Order(_) => Blame::VALUES,
            Self::Dispatch(error) => error.blame(),
            Self::Declaration(wrong) => wrong.blame(),
            Self::Accepted { verb, .. } => Blame::setting(std::slice::from_ref(verb)),
            Self::Grid { .. } => Blame::setting(&["shape"]),
            Self::Paths(paths) => paths.blame(),
            _ => Blame::TEST,
        }
    }
}

impl Fails for ComputeError {
    fn is_verdict(&self) -> bool {
        match self {
            Self::Differs(_) | Self::Order(_) | Self::Violations(_) | Self::Accepted { .. } => true,
            Self::Dispatch(error) => {
                matches!(error, DispatchError::Probe(ProbeError::Asserted(_)))
            }
            Self::Declaration(wrong) => wrong.is_verdict(),
            Self::Golden { cause, .. } => cause.is_failure(),
            Self::Paths(paths) => paths.all().any(Self::is_verdict),
            _ => false,
        }
    }

    fn details(&self) -> Details {
        match self {
            Self::Differs(difference) => difference.details(),
            Self::Violations(found) => found.details(),
            Self::Order(order) => order.details(),
            Self::Paths(failures) => failures.details(Self::details),
            other => Details::of(&other.to_string()).at(self.blame().message),
        }
    }
}

impl Stop for ComputeError {
    fn is_refusal(&self) -> bool {
        matches!(self, Self::Dispatch(error) if error.is_refusal())
    }

    fn of_paths(failures: PathFailures<Self>) -> Self {
        Self::Paths(Box::new(failures))
    }
}

impl Passed for ComputeAgreement {
    fn known_issues(&self) -> &[KnownIssue] {
        &self.known_issues
    }
}

impl fmt::Display for ComputeAgreement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {} elements agree", self.variable, self.elements)?;
        for (adapter, worst) in &self.paths {
            write!(f, "; {} worst {worst}", adapter.path)?;
        }
        Ok(())
    }
}

impl Package {
    /// Begins a list of compute passes.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
    ///             @compute @workgroup_size(1) fn count() { data[0] = 7u; }";
    /// let package = Package::from_source("m", text);
    /// let passes = package.compute().with("data", Storage::new([0_u32])).dispatch("count", [1, 1, 1]);
    /// passes.after("data").agrees_with([7_u32], Abs(0.0));
    /// ```
    pub fn compute(&self) -> Compute<'_> {
        Compute {
            package: self,
            wanted: Vec::new(),
            fixtures: Vec::new(),
            same: Vec::new(),
            overrides: Overrides::new(),
            executors: Vec::new(),
            tolerance_on: Selected::default(),
            known_issues: KnownIssues::default(),
            accepted: Vec::new(),
        }
    }
}

impl<'a> Compute<'a> {
    /// Supplies a texture, sampler or buffer for the resource variable `name`. All passes share it.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// let passes = SHADERS
    ///     .compute()
    ///     .with("source", Texture::from_fn(8, 8, |x, y| (x + y) as f32))
    ///     .with("sums", karat::fixture::Buffer::zeros(32)); // the passes fill this buffer
    /// # let _ = passes;
    /// ```
    pub fn with(mut self, name: &str, fixture: impl Into<Fixture>) -> Self {
        self.fixtures.push((name.to_owned(), fixture.into()));
        self
    }

    /// Gives the variable `name` the resource of the variable `other`. Add the fixture of `other` first. For example,
    /// one pass writes a texture as `target`, and the next pass reads that texture as `source`.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let text = "@group(0) @binding(0) var<storage, read_write> made: array<u32>;
    ///             @group(0) @binding(1) var<storage> source: array<u32>;
    ///             @group(0) @binding(2) var<storage, read_write> target_: array<u32>;
    ///             @compute @workgroup_size(2) fn make(@builtin(local_invocation_index) i: u32) { made[i] = i; }
    ///             @compute @workgroup_size(2) fn double(@builtin(local_invocation_index) i: u32) {
    ///                 target_[i] = 2u * source[i];
    ///             }";
    /// Package::from_source("m", text)
    ///     .compute()
    ///     .with("made", Storage::new([0_u32, 0]))
    ///     .with("target_", Storage::new([0_u32, 0]))
    ///     .alias("source", "made")
    ///     .dispatch("make", [1, 1, 1])
    ///     .dispatch("double", [1, 1, 1])
    ///     .after("target_")
    ///     .agrees_with([0_u32, 2], Abs(0.0));
    /// ```
    ///
    /// # Panics
    /// Panics if `other` has no fixture.
    pub fn alias(mut self, name: &str, other: &str) -> Self {
        let known = self.fixtures.iter().any(|(known, _)| known == other);
        assert!(
            known,
            "`{other}` has no fixture; add `.with(\"{other}\", ...)` before `.alias(...)`"
        );
        self.same.push((name.to_owned(), other.to_owned()));
        self
    }

    /// Sets an `override` of the shaders, by its name or its `@id`: see [`Probe::with_override`].
    ///
    /// [`Probe::with_override`]: crate::check::Probe::with_override
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let text = "override COUNT: u32;
    ///             @group(0) @binding(0) var<storage, read_write> data: array<u32>;
    ///             @compute @workgroup_size(1) fn count() { data[0] = COUNT; }";
    /// let package = Package::from_source("m", text);
    /// let passes = package.compute().with("data", Storage::new([0_u32])).with_override("COUNT", 7);
    /// passes.dispatch("count", [1, 1, 1]).after("data").agrees_with([7_u32], Abs(0.0));
    /// ```
    pub fn with_override(mut self, name: &str, value: impl Into<f64>) -> Self {
        self.overrides.insert(name.to_owned(), value.into());
        self
    }

    /// Adds a pass: dispatches a compute entry point (`module::name`) with `workgroups` workgroups in x, y and z.
    /// Passes run in the order in which the test adds them.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # let values = vec![1_u32; 256];
    /// SHADERS
    ///     .compute()
    ///     .with("data", Storage::new(values))
    ///     .dispatch("scan::blocks", [4, 1, 1]) // workgroups
    ///     .dispatch("scan::add", [4, 1, 1]) // the next pass, over the same buffer
    ///     .after("data")
    ///     .satisfies("rises", |sums: &[u32]| sums.is_sorted());
    /// ```
    pub fn dispatch(mut self, entry_point: &str, workgroups: [u32; 3]) -> Self {
        self.wanted.push(Wanted { name: entry_point.to_owned(), workgroups });
        self
    }

    /// Dispatches the passes on `executor`, instead of on the paths that the environment variables select. Each call
    /// adds an executor.
    ///
    /// ```no_run
    /// use karat::unstable::executor::Executor;
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    ///
    /// fn is_seven_on(mine: &dyn Executor) {
    ///     let passes = SHADERS.compute().with("data", Storage::new([0_u32])).on(mine);
    ///     passes.dispatch("count::main", [1, 1, 1]).after("data").agrees_with([7_u32], Abs(0.0));
    /// }
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn on(mut self, executor: &'a dyn Executor) -> Self {
        self.executors.push(executor);
        self
    }

    /// Sets another tolerance for the paths that a [`Selector`] selects, for example because a driver is less exact.
    ///
    /// ```no_run
    /// # use karat::Path;
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # let (image, means) = (Texture::from_fn(8, 8, |x, y| (x + y) as f32), [7.0]);
    /// let passes = SHADERS.compute().with("source", image).with("mean", Storage::new([0.0_f32]));
    /// passes
    ///     .dispatch("reduce::main", [1, 1, 1])
    ///     .tolerance_on(Path::GL, Rel(1e-3))
    ///     .after("mean")
    ///     .agrees_with(means, Rel(1e-5));
    /// ```
    pub fn tolerance_on(
        mut self,
        on: impl Into<Selector>,
        tolerance: impl Into<Tolerance>,
    ) -> Self {
        self.tolerance_on.declare(on.into(), tolerance.into());
        self
    }

    /// Declares that the check fails on a path, and gives the reason. If the check passes on that path, the test fails.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # let sums = [1_u32];
    /// let passes = SHADERS.compute().with("data", Storage::new([1_u32])).dispatch("scan::add", [1, 1, 1]);
    /// passes.fails_on("gl@llvmpipe", "mesa#1234").after("data").agrees_with(sums, Abs(0.0));
    /// ```
    pub fn fails_on(mut self, on: impl Into<Selector>, reason: &str) -> Self {
        self.known_issues.declare(on.into(), reason);
        self
    }

    /// Declares that a path refuses the passes, and gives the reason: see
    /// [`Check::refused_on`](crate::Check::refused_on).
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # let sums = [1_u32];
    /// let passes = SHADERS.compute().with("data", Storage::new([1_u32])).dispatch("scan::add", [1, 1, 1]);
    /// passes.refused_on("gl", "naga#1234").after("data").agrees_with(sums, Abs(0.0));
    /// ```
    pub fn refused_on(mut self, on: impl Into<Selector>, reason: &str) -> Self {
        self.known_issues.declare_refusal(on.into(), reason);
        self
    }

    /// Selects a resource by the name of its variable, to check its contents after all passes. At least one pass must
    /// write the resource.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let text = "struct Totals { sum: f32, count: u32 }
    ///             @group(0) @binding(0) var<storage, read_write> totals: Totals;
    ///             @compute @workgroup_size(1) fn reset() { totals = Totals(0.5, 3u); }";
    /// karat::shareable! { struct Totals mirrors TotalsMirror { sum: f32, count: u32 } }
    ///
    /// let package = Package::from_source("m", text);
    /// let passes = package.compute().with("totals", karat::fixture::Buffer::zeros(8));
    /// let expected = TotalsMirror { sum: 0.5, count: 3 };
    /// passes.dispatch("reset", [1, 1, 1]).after("totals").agrees_with([expected], Ulp(0.0));
    /// ```
    pub fn after(self, variable: &str) -> After<'a> {
        After {
            compute: self,
            variable: variable.to_owned(),
            recorded: true,
            up_to_order: false,
            grid: None,
        }
    }

    fn passes(&self) -> Result<Passes, DispatchError> {
        let fixtures = (&self.fixtures, &*self.same);
        Passes::new(self.package, &self.wanted, fixtures, &self.overrides)
    }
}

impl After<'_> {
    /// Tells Karat to write no record of this check. Use this method in a test that expects a failure.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
    ///             @compute @workgroup_size(1) fn count() { data[0] = 7u; }";
    /// let package = Package::from_source("m", text);
    /// let passes = package.compute().with("data", Storage::new([0_u32])).dispatch("count", [1, 1, 1]);
    /// passes.after("data").unrecorded().try_agrees_with([8_u32], Abs(0.0)).expect_err("it is 7");
    /// ```
    pub fn unrecorded(mut self) -> Self {
        self.recorded = false;
        self
    }

    /// Compares each element of the resource with an element of the reference. The elements of a texture are its
    /// texels. A resource that is neither an array nor a texture is one element. In the reference, a texel of four
    /// channels is a `DVec4`, `IVec4` or `UVec4`. The resource and the reference must have the same number of elements.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let text = "@group(0) @binding(0) var<storage, read_write> data: array<f32>;
    ///             @compute @workgroup_size(2) fn halve(@builtin(local_invocation_index) i: u32) {
    ///                 data[i] *= 0.5;
    ///             }";
    /// let package = Package::from_source("m", text);
    /// let halves = package.compute().with("data", Storage::new([1.0_f32, 3.0]));
    /// halves.dispatch("halve", [1, 1, 1]).after("data").agrees_with([0.5, 1.5], Ulp(0.0));
    /// ```
    ///
    /// # Panics
    /// Panics if an element differs, or if the check can't compare the elements.
    #[track_caller]
    pub fn agrees_with<T: Mirror>(
        self,
        reference: impl IntoIterator<Item = T>,
        tolerance: impl Into<Tolerance>,
    ) -> ComputeAgreement {
        or_panic(self.try_agrees_with(reference, tolerance))
    }

    /// Runs [`agrees_with`](Self::agrees_with), but returns the error instead of panicking.
    ///
    /// # Errors
    /// Returns an error if an element differs, or if the check can't compare the elements.
    #[track_caller]
    pub fn try_agrees_with<T: Mirror>(
        self,
        reference: impl IntoIterator<Item = T>,
        tolerance: impl Into<Tolerance>,
    ) -> Result<ComputeAgreement, ComputeError> {
        let (lanes, place) = (lanes(reference), Location::caller());
        let expected = judge::Expected { shape: T::shape(), lanes };
        self.judge(judge::Assertion::Agrees(expected, tolerance.into()), place)
    }

    /// Checks a statement about all elements, such as "they are in order" or "their sum didn't change".
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # let keys = vec![3_u32, 1, 2];
    /// SHADERS
    ///     .compute()
    ///     .with("keys", Storage::new(keys))
    ///     .dispatch("sort::main", [1, 1, 1])
    ///     .after("keys")
    ///     .satisfies("is in order", |keys: &[u32]| keys.is_sorted());
    /// ```
    ///
    /// # Panics
    /// Panics if the statement doesn't hold, or if the check can't read the elements.
    #[track_caller]
    pub fn satisfies<T: Shareable>(
        self,
        statement: &str,
        holds: impl Fn(&[T]) -> bool,
    ) -> ComputeAgreement {
        or_panic(self.try_satisfies(statement, holds))
    }

    /// Runs [`satisfies`](Self::satisfies), but returns the error instead of panicking.
    ///
    /// # Errors
    /// Returns an error if the statement doesn't hold, or if the check can't read the elements.
    #[track_caller]
    pub fn try_satisfies<T: Shareable>(
        self,
        statement: &str,
        holds: impl Fn(&[T]) -> bool,
    ) -> Result<ComputeAgreement, ComputeError> {
        let width = T::shape().lanes().len().max(1);
        let breaks = |words: &[u32]| {
            let elements = words.chunks_exact(width).map(|words| T::load(&mut words.iter()));
            let holds = holds(&elements.collect::<Vec<T>>());
            (!holds).then_some(judge::Broken { failures: 1, first: None })
        };
        let (text, shape) = (statement.to_owned(), T::shape());
        let statement =
            judge::Statement { text, shape, may_stay: false, settled: false, breaks: &breaks };
        self.judge(judge::Assertion::Holds(statement), Location::caller())
    }

    /// Checks that the passes write every element or texel. This check finds a dispatch of too few workgroups, or a
    /// bounds check in the shader that skips the last element. Karat's engine records the writes.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
    ///             @compute @workgroup_size(4) fn fill(@builtin(global_invocation_id) id: vec3u) {
    ///                 if id.x < arrayLength(&data) { data[id.x] = 0u; }
    ///             }";
    /// let package = Package::from_source("m", text);
    /// let passes = |groups| {
    ///     package.compute().with("data", Storage::new([0_u32; 6])).dispatch("fill", [groups, 1, 1])
    /// };
    /// passes(2).after("data").is_written();
    /// let wrong = passes(1).after("data").unrecorded().try_is_written();
    /// assert!(wrong.unwrap_err().to_string().contains("[4]"));
    /// ```
    ///
    /// # Panics
    /// Panics if an element isn't written, or the passes can't be dispatched.
    #[track_caller]
    pub fn is_written(self) -> ComputeAgreement {
        or_panic(self.try_is_written())
    }

    /// Runs [`is_written`](Self::is_written), but returns the error instead of panicking.
    ///
    /// # Errors
    /// Returns an error if an element isn't written, or the passes can't be dispatched.
    #[track_caller]
    pub fn try_is_written(self) -> Result<ComputeAgreement, ComputeError> {
        let passes = self.compute.passes()?;
        let (part, shape) = passes.written(&self.variable)?;
        let shape = match shape {
            Shape::Array { element, .. } => *element,
            whole => whole,
        };
        let lanes = part.pick(crate::interpret::written(&passes, part.number)?);
        let width = shape.lanes().len().max(1);
        let missed = lanes.chunks(width).filter(|element| element.contains(&false)).count();
        let first = lanes.iter().position(|written| !written);
        let element = first.map(|at| judge::Element {
            place: judge::Place::of_element(at / width, &shape.lane_names()[at % width]),
            actual: "not written".to_owned(),
            expected: "written".to_owned(),
            error: "different".to_owned(),
        });
        let broken = judge::Broken { failures: missed, first: element };
        let breaks = |_: &[u32]| (missed > 0).then(|| broken.clone());
        let text = "in Karat's engine, the passes write each element".to_owned();
        let statement =
            judge::Statement { text, shape, may_stay: true, settled: true, breaks: &breaks };
        self.judge(judge::Assertion::Holds(statement), Location::caller())
    }

    /// Runs the passes on one path, and returns the elements.
    ///
    /// ```
    /// # use karat::Path;
    /// # use karat::prelude::*;
    /// let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
    ///             @compute @workgroup_size(1) fn count() { data[0] = 7u; }";
    /// let package = Package::from_source("m", text);
    /// let passes = package.compute().with("data", Storage::new([0_u32])).dispatch("count", [1, 1, 1]);
    /// assert_eq!(passes.after("data").read::<u32>(Path::CPU).unwrap(), [7]);
    /// ```
    ///
    /// # Errors
    /// Returns an error if the path can't run the passes, or if the type of the elements isn't `T`.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn read<T: Shareable>(&self, path: Path) -> Result<Vec<T>, ComputeError> {
        let passes = self.compute.passes()?;
        let (part, shape) = passes.written(&self.variable)?;
        let element = self.element(&passes, &shape, &T::shape(), "the test reads", false)?;
        let words = words(executor::of(path)?, &passes, &part)?;
        let elements = words.chunks_exact(element.lanes().len().max(1));
        Ok(elements.map(|words| T::load(&mut words.iter())).collect())
    }

    /// Returns the type of the elements of a resource with the type `shape`. Returns an error if the Rust type `host`
    /// doesn't match that type.
    fn element(
        &self,
        passes: &Passes,
        shape: &Shape,
        host: &Shape,
        who: &'static str,
        result: bool,
    ) -> Result<Shape, ComputeError> {
        let element = match shape {
            Shape::Array { element, .. } if host.stands_for(element, result) => element,
            whole if host.stands_for(whole, result) => whole,
            whole => {
                return Err(ComputeError::Type {
                    variable: self.variable.clone(),
                    entry_point: passes.entry_points().last().unwrap_or_default().to_owned(),
                    declared: whole.to_string(),
                    who,
                    supplied: host.to_string(),
                });
            }
        };
        Ok(element.clone())
    }

    fn executors(&self) -> Result<Vec<&dyn Executor>, PathError> {
        executor::or_selected(&self.compute.executors)
    }
}

/// Runs the passes, and returns the scalars of the checked part of the resource, each as a `u32`.
fn words(executor: &dyn Executor, passes: &Passes, part: &Part) -> Result<Vec<u32>, DispatchError> {
    let afterwards = executor::dispatch(executor, passes)?;
    let found = afterwards.into_iter().find(|(of, _)| *of == part.number);
    let lanes = found.and_then(|(_, words)| passes.lanes(part.number, &words));
    lanes.map(|lanes| part.pick(lanes)).ok_or(DispatchError::Unable { path: executor.path() })
}

fn lanes<T: Mirror>(reference: impl IntoIterator<Item = T>) -> Vec<f64> {
    let mut lanes = Vec::new();
    reference.into_iter().for_each(|element| element.lanes(&mut lanes));
    lanes
}
