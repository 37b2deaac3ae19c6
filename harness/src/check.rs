//! Checks: assertions about a WGSL function.
//!
//! Each verb, such as `agrees_with`, runs the function with the domain's cases on every selected path. The verb
//! returns an [`Agreement`] with the number of cases that Karat compared, or panics with a
//! [`Failure`]. The `try_` form of a verb returns the failure instead. Both forms write the verdict to the
//! record of the run, unless the check is [unrecorded](Check::unrecorded). A check that compared nothing is an
//! error.

mod agreement;
mod allowances;
mod allowed;
mod batch;
mod called;
pub(crate) mod cause;
mod companion;
mod conclusion;
pub(crate) mod condition;
mod demand;
mod directions;
pub(crate) mod disagreement;
pub(crate) mod dynamic;
mod effort;
mod equivariance;
mod expects;
mod explanation;
pub(crate) mod flush;
mod goal;
mod golden;
mod hazards;
mod inputs;
mod integral;
mod invariance;
mod kinds;
mod limit;
pub(crate) mod mismatch;
mod monotone;
mod ordinary;

pub(crate) mod parameter;
mod path_tally;
mod plan;
mod proof;
mod property;
mod quadrature;
mod recall;
mod sample;
pub(crate) mod sampling;
mod search;
mod session;
mod shrink;
mod statement;

mod tolerances;
mod trial;
pub(crate) mod vacuous;
mod validity;
mod verdict;
pub(crate) mod wgsl_test;

pub use crate::hazard::Kind as HazardKind;
pub(crate) use crate::judge::Census;
pub(crate) use crate::value::Reference;
use demand::Demand;
pub(crate) use disagreement::{CaseFailure, Disagreement, PathDisagreement, Simplest};
pub use integral::Integral;
pub use limit::Limit;
pub(crate) use mismatch::Mismatch;
pub use monotone::Trend;
pub(crate) use parameter::Parameter;
use plan::Plan;
pub use quadrature::Directions;
pub(crate) use sampling::{Fit, Rejection};
pub use sampling::{Power, Sampling};
pub(crate) use vacuous::Vacuous;
pub use verdict::{Agreement, Failure};

use std::marker::PhantomData;
use std::path::PathBuf;
use std::sync::Arc;

use crate::diagnostic::{FileRead, Span};
use crate::domain::{Domain, Stream, Typed};
use crate::executor::{self, Executor};
use crate::fixture::{Fixture, Fixtures};
use crate::package::Package;
use crate::path::{PathError, Selector};
use crate::probe::Inputs;
use crate::reflect::Overrides;
use crate::tolerance::Tolerance;
use crate::value::{Arguments, Shape};

/// The number of cases if the check doesn't set a number. 65,536 cases fit into one dispatch.
const CASES: u64 = 65_536;

/// The largest size of a finite domain for which Karat tries every value, if the check sets no number of cases.
const ENUMERATED: u64 = 1 << 20;

/// A function of a package, before it has a domain.
///
/// ```no_run
/// use karat::prelude::*;
///
/// static SHADERS: Package = karat::package!("shaders");
///
/// SHADERS.function("fresnel::schlick_scalar")
///     .over((0.0..=1.0, 0.0..=1.0))
///     .agrees_with(|f0: f64, c: f64| f0 + (1.0 - f0) * (1.0 - c).powi(5), Ulp(4.0));
/// ```
#[derive(Clone, Debug)]
#[must_use = "a probe checks nothing until you call `.over(...)` and a verb such as `.agrees_with(...)`"]
pub struct Probe<'a> {
    package: &'a Package,
    name: String,
    fixtures: Fixtures,
    overrides: Overrides,
    /// The ways in which the kernel gets its arguments. If the list is empty, the kernel reads a storage
    /// buffer.
    inputs: Vec<Inputs>,
    /// The executors that run the function. If the list is empty, settings such as `KARAT_PATHS` select the executors.
    executors: Vec<&'a dyn Executor>,
    /// For a generated function: the span of the author's test in its file, and the folder of that test's
    /// package.
    place: Option<(Span, PathBuf)>,
    /// For a test in WGSL: a package that has a variant of the test function. The variant also returns the
    /// values that the test's expectations compared.
    telling: Option<&'a Package>,
    /// The shared function that runs this test and other tests, if there is one.
    together: Option<Together<'a>>,
}

/// A generated function that calls one of several functions. The first argument selects the function. Then come the
/// arguments of each selectable function, one function after the other.
#[derive(Clone, Debug)]
struct Together<'a> {
    package: &'a Package,
    /// The name of the generated function, such as `brdf_test::counted`.
    function: &'a str,
    shapes: &'a [Shape],
    which: u32,
    /// The index of the `u32` word at which the selected function's own arguments begin.
    first: usize,
    /// The number of `u32` words of all arguments.
    words: usize,
}

impl Package {
    /// Selects a function: `module::name`, or `name` in a package of one module.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
    /// package.function("half").over(0.0..=1.0).stays_within(0.0..=0.5);
    /// ```
    pub fn function(&self, name: &str) -> Probe<'_> {
        let (fixtures, overrides, inputs, executors, place) = Default::default();
        let (package, name, telling, together) = (self, name.to_owned(), None, None);
        Probe { package, name, fixtures, overrides, inputs, executors, place, telling, together }
    }
}

impl<'a> Probe<'a> {
    /// Supplies a texture, sampler or buffer for the resource variable `name`. Call `with` once for each
    /// variable.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let text = "@group(0) @binding(0) var<uniform> gain: f32;
    ///             fn louder(x: f32) -> f32 { return gain * x; }";
    /// let package = Package::from_source("m", text);
    /// let louder = package.function("louder").with("gain", Uniform::new(2.0_f32));
    /// louder.over(0.0..=1.0).agrees_with(|x: f64| 2.0 * x, Ulp(0.0));
    /// ```
    pub fn with(mut self, name: &str, fixture: impl Into<Fixture>) -> Self {
        self.fixtures.push((name.to_owned(), fixture.into()));
        self
    }

    /// Sets an `override` of the shader, by its name or its `@id`. A `bool` is 0 or 1.
    ///
    /// An `override` without an initialiser needs a value.
    ///
    /// ```
    /// use karat::prelude::*;
    ///
    /// let text = "override GAIN: f32;
    ///             fn f(x: f32) -> f32 { return GAIN * x; }";
    /// let package = Package::from_source("m", text);
    /// let check = package.function("f").with_override("GAIN", 2.0).over(0.0..=1.0);
    /// check.agrees_with(|x: f64| 2.0 * x, Ulp(0.0));
    /// ```
    pub fn with_override(mut self, name: &str, value: impl Into<f64>) -> Self {
        self.overrides.insert(name.to_owned(), value.into());
        self
    }

    /// Runs the function on this executor, instead of on the paths that environment variables select. Further calls add
    /// more executors.
    ///
    /// With `on`, the variables `KARAT_PATHS` and `KARAT_REQUIRE` select no paths: Karat only checks these variables
    /// for mistakes. Some verbs take a second function, such as the density of a sampler. The second function runs on
    /// the executors of the first function, and can't have executors of its own. Don't give an executor the path of a
    /// driver, such as `vulkan`. Name the executor's path `cpu`, or add your own name to a driver's path, as in
    /// `vulkan@mine`.
    ///
    /// ```no_run
    /// use karat::unstable::executor::Executor;
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    ///
    /// fn is_good_on(mine: &dyn Executor) {
    ///     SHADERS.function("tone::map").on(mine).over(0.0..=16.0).stays_within(0.0..=1.0);
    /// }
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn on(mut self, executor: &'a dyn Executor) -> Self {
        self.executors.push(executor);
        self
    }

    fn root(&self) -> PathBuf {
        let root = || self.package.root();
        self.place.as_ref().map_or_else(root, |(_, root)| root.clone())
    }

    fn called(&self) -> &str {
        match &self.together {
            Some(together) if std::ptr::eq(together.package, self.package) => together.function,
            _ => &self.name,
        }
    }

    /// The file of the function's module. `None` if the module is text in memory.
    fn module_file(&self) -> Option<FileRead> {
        let module = self.name.rsplit_once("::").map_or("", |(module, _)| module);
        self.package.file_of(module)
    }

    fn executors(&self) -> Result<Vec<&'a dyn Executor>, PathError> {
        executor::or_selected(&self.executors)
    }

    /// Chooses the arguments' values: one domain for a function of one parameter, a tuple of domains for up to
    /// twelve parameters, `()` for a function without parameters.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let package = Package::from_source(
    ///     "m",
    ///     "fn half(x: f32) -> f32 { return 0.5 * x; }
    ///      fn pull(strength: f32, n: vec3f) -> vec3f { return strength * n; }",
    /// );
    /// package.function("half").over(0.0..=1.0).is_finite();
    /// package.function("pull").over((0.0..=1.0, UnitVector)).is_finite();
    /// ```
    pub fn over<D: Domain + 'a>(self, domain: D) -> Check<'a, Calls<D::Value>>
    where
        D::Value: Arguments,
    {
        let calls = Calls { shapes: D::Value::shapes(), values: PhantomData };
        Check::new(self, Typed::arguments(domain), calls)
    }
}

/// A function with its domain. The type `C` says how the check uses the domain's values: to call the function
/// ([`Calls`]), as parameters of an integral of the function ([`Integral`]), or as arguments of a sampler
/// ([`Sampling`]).
///
/// ```
/// # use karat::prelude::*;
/// let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
/// let check = package.function("half").over(0.0..=1.0).cases(1000).seed(7);
/// check.agrees_with(|x: f64| 0.5 * x, Ulp(0.0));
/// ```
#[derive(Clone)]
#[must_use = "a check compares nothing until you call a verb such as `.agrees_with(...)`"]
pub struct Check<'a, C> {
    plan: Plan<'a>,
    stream: Arc<dyn Stream + 'a>,
    of: C,
}

impl<C> std::fmt::Debug for Check<'_, C> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Check").field("plan", &self.plan).finish_non_exhaustive()
    }
}

/// A marker for a [`Check`] that calls the function with values of the type `V`, or with
/// [words](crate::unstable::check::Words).
///
/// ```
/// use karat::check::{Calls, Check};
/// use karat::prelude::*;
///
/// fn is_kept(half: Check<'_, Calls<f32>>) {
///     half.stays_within(0.0..=0.5);
/// }
/// let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
/// is_kept(package.function("half").over(0.0..=1.0));
/// ```
#[derive(Clone, Debug)]
pub struct Calls<V> {
    shapes: Vec<Shape>,
    values: PhantomData<fn(V)>,
}

impl<'a, C> Check<'a, C> {
    fn new(probe: Probe<'a>, stream: impl Stream + 'a, of: C) -> Self {
        Self { plan: Plan::new(probe), stream: Arc::new(stream), of }
    }

    /// Sets the number of cases. If the domain has at most that many values, Karat tries each value once.
    ///
    /// The default is 65,536 calls, 256 integrals, or 16 sets of values for a sampler's arguments that aren't random.
    /// By default, Karat tries every value of a domain that has at most 2^20 values (65,536 for integrals, 4,096 for
    /// samplers).
    ///
    /// ```
    /// use karat::prelude::*;
    ///
    /// let package = Package::from_source("m", "fn f(x: f32) -> f32 { return 0.5 * x; }");
    /// let check = package.function("f").over(0.0..=1.0).cases(1000);
    /// assert_eq!(check.agrees_with(|x: f64| 0.5 * x, Ulp(1.0)).cases, 1000);
    /// ```
    pub fn cases(mut self, cases: u64) -> Self {
        self.plan.cases = Some(cases);
        self
    }

    /// Sets the seed. By default, the seed derives from the test's name.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// # let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
    /// let half = || package.function("half").over(0.0..=1.0);
    /// half().seed(1).is_finite();
    /// half().seed(2).is_finite(); // other numbers
    /// ```
    pub fn seed(mut self, seed: u64) -> Self {
        self.plan.seed = Some(seed);
        self
    }

    /// Sets another tolerance for paths whose driver or formats are less exact: `Path::GL`, `"vulkan@nvidia"`,
    /// `"@llvmpipe"` (see [`Selector`]). On all other paths, the verb's own tolerance applies.
    ///
    /// ```no_run
    /// # use karat::Path;
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # let blue = |_: glam::DVec3| glam::DVec3::Z;
    /// SHADERS
    ///     .function("environment::radiance")
    ///     .with("environment", CubeMap::constant(glam::Vec3::Z))
    ///     .with("environment_sampler", Sampler::LINEAR)
    ///     .over(UnitVector)
    ///     .tolerance_on(Path::GL, Rel(4.9e-4)) // filters half floats
    ///     .agrees_with(blue, Ulp(2.0));
    /// ```
    pub fn tolerance_on(
        mut self,
        on: impl Into<Selector>,
        tolerance: impl Into<Tolerance>,
    ) -> Self {
        self.plan.tolerance_on.declare(on.into(), tolerance.into());
        self
    }

    /// Declares that the check fails on a path. The reason is a text, such as the number of a driver's bug.
    ///
    /// On that path at least one case must fail. If every case passes, the check fails until you remove the
    /// declaration. The declaration excuses every wrong value on that path, including NaN. If a path only loses digits,
    /// use [`tolerance_on`](Self::tolerance_on) instead. An endless loop is an error in spite of the declaration. Karat
    /// judges the other paths as usual. `karat test` counts the check as a known issue, never as a pass.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// SHADERS
    ///     .function("layering::masked")
    ///     .over((0.0..=1.0, 0.0..=1.0))
    ///     .fails_on("gl@llvmpipe", "its mix cancels: mesa#1234")
    ///     .agrees_with(|base: f64, mask: f64| base * (1.0 - mask), Ulp(4.0));
    /// ```
    pub fn fails_on(mut self, on: impl Into<Selector>, reason: &str) -> Self {
        self.plan.known_issues.declare(on.into(), reason);
        self
    }

    /// Declares that a path can't run the function: the path's compiler rejects the function, or the path lacks a
    /// resource that the function reads. `reason` names the cause. If the function runs on that path, the check fails
    /// until you remove the declaration, even if all values are right. For wrong values, use
    /// [`fails_on`](Self::fails_on).
    ///
    /// ```no_run
    /// # use karat::Path;
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # let (depths, depth) = (Texture::from_fn(2, 2, |x, _| x as f32), |i: u32| f64::from(i));
    /// SHADERS
    ///     .function("shadow::depth_of")
    ///     .with("shadow", depths)
    ///     .over(Integers(0..=1_u32))
    ///     .refused_on(Path::GL, "naga's GLSL has no textureLoad of depths")
    ///     .agrees_with(depth, Abs(0.0));
    /// ```
    pub fn refused_on(mut self, on: impl Into<Selector>, reason: &str) -> Self {
        self.plan.known_issues.declare_refusal(on.into(), reason);
        self
    }

    /// Writes no record of this check. Call this method in tests that expect the check to fail.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// # let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
    /// let check = package.function("half").over(0.0..=1.0).unrecorded();
    /// check.try_agrees_with(|x: f64| x, Ulp(4.0)).expect_err("it halves");
    /// ```
    pub fn unrecorded(mut self) -> Self {
        self.plan.recorded = false;
        self
    }
}

impl<V> Check<'_, Calls<V>> {
    fn demand(&self) -> Demand {
        Demand {
            arguments: self.of.shapes.clone(),
            who: "the domain supplies",
            draws_arguments: true,
            cases: CASES,
            enumerated: ENUMERATED,
            calls: 1,
        }
    }
}
