//! Compute passes for programs that don't know the types at compile time: tests without Rust, and `karat call`. Such a
//! program describes a resource by its WGSL type and by a list of its scalars.

use std::panic::Location;

use super::judge::{Assertion, Each, Expected, Statement};
use super::{After, Compute, ComputeAgreement, ComputeError};
use crate::dispatch::{DispatchError, Part, Violation, Watched};
use crate::executor;
use crate::interpret::asserted::{KEPT, printed_by};
use crate::path::Path;
use crate::tolerance::Tolerance;
use crate::value::{Scalar, Shape};

pub use super::judge::{Broken, Element, Place};

/// A resource and its contents.
///
/// ```
/// use karat::unstable::compute::Content;
/// use karat::unstable::value::{Scalar, Shape};
///
/// let number = Content { name: "total".to_owned(), shape: Shape::Scalar(Scalar::U32), lanes: vec![7] };
/// assert_eq!(number.shape.format(&number.lanes), "7");
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Content {
    /// The name of the variable, or of the fixture that several passes share.
    pub name: String,
    /// The WGSL type, in which every array has a length.
    pub shape: Shape,
    /// The scalars of the resource in order, each as a `u32`.
    pub lanes: Vec<u32>,
}

impl Content {
    /// Returns the element type of an array. Returns any other type unchanged.
    ///
    /// ```
    /// use karat::unstable::compute::Content;
    /// use karat::unstable::value::{Scalar, Shape};
    ///
    /// let shape = Shape::Array { element: Box::new(Shape::Scalar(Scalar::U32)), length: 2 };
    /// let two = Content { name: "keys".to_owned(), shape, lanes: vec![7, 8] };
    /// assert_eq!(*two.element(), Shape::Scalar(Scalar::U32));
    /// ```
    #[must_use]
    pub fn element(&self) -> &Shape {
        match &self.shape {
            Shape::Array { element, .. } => element,
            whole => whole,
        }
    }

    /// Selects a member of the resource, or a member of each of its elements, by a path such as `position` or
    /// `items.position`. An empty path selects the whole resource.
    ///
    /// ```
    /// use karat::unstable::compute::Content;
    /// use karat::unstable::value::{Scalar, Shape};
    ///
    /// let shape = Shape::Vector { size: 2, scalar: Scalar::U32 };
    /// let two = Content { name: "key".to_owned(), shape, lanes: vec![7, 8] };
    /// assert_eq!(two.member("y").map(|own| own.lanes), Some(vec![8]));
    /// ```
    #[must_use]
    pub fn member(self, path: &str) -> Option<Self> {
        let (part, shape) = Part::of(0, &self.shape, path)?;
        Some(Self { shape, lanes: part.pick(self.lanes), ..self })
    }
}

/// Returns the contents that a resource has before the first pass.
///
/// ```
/// # use karat::prelude::*;
/// # let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
/// #             @compute @workgroup_size(1) fn count() { data[0] = 7u; }";
/// # let package = Package::from_source("m", text);
/// let passes = package.compute().with("data", Storage::new([1_u32, 2])).dispatch("count", [1, 1, 1]);
/// let before = karat::unstable::compute::before(&passes, "data")?;
/// assert_eq!((before.shape.to_string().as_str(), &*before.lanes), ("array<u32, 2>", &[1, 2][..]));
/// # Ok::<(), karat::compute::ComputeError>(())
/// ```
///
/// # Errors
/// Returns an error if the passes aren't valid, or no pass uses a buffer of that name.
pub fn before(compute: &Compute<'_>, variable: &str) -> Result<Content, ComputeError> {
    let (name, shape, lanes) = compute.passes()?.content(variable)?;
    Ok(Content { name, shape, lanes })
}

/// Runs passes on one path, and returns the contents of each resource that they write.
///
/// ```
/// # use karat::Path;
/// # use karat::prelude::*;
/// # let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
/// #             @compute @workgroup_size(1) fn count() { data[0] = 7u; }";
/// # let package = Package::from_source("m", text);
/// let passes = package.compute().with("data", Storage::new([1_u32, 2])).dispatch("count", [1, 1, 1]);
/// assert_eq!(karat::unstable::compute::left(&passes, Path::CPU)?[0].lanes, [7, 2]);
/// # Ok::<(), karat::compute::ComputeError>(())
/// ```
///
/// # Errors
/// Returns an error if the path can't run the passes.
pub fn left(compute: &Compute<'_>, path: Path) -> Result<Vec<Content>, ComputeError> {
    let passes = compute.passes()?;
    let afterwards = executor::dispatch(executor::of(path)?, &passes)?;
    let content = |(number, words): (usize, Vec<u32>)| {
        let name = passes.resources[number].name.clone();
        let (_, shape) = passes.written(&name)?;
        let lanes = passes.lanes(number, &words).ok_or(DispatchError::Unable { path })?;
        Ok::<_, ComputeError>(Content { name, shape, lanes })
    };
    afterwards.into_iter().map(content).collect()
}

/// Returns the sanitizer's violations with their messages. Also returns how much of the passes the sanitizer checked.
///
/// ```
/// # use karat::prelude::*;
/// # let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
/// #             @compute @workgroup_size(1) fn count() { data[0] = 7u; }";
/// # let package = Package::from_source("m", text);
/// let passes = package.compute().with("data", Storage::new([1_u32, 2])).dispatch("count", [1, 1, 1]);
/// let (found, watched) = karat::unstable::compute::violations(&passes)?;
/// assert_eq!((found.len(), watched.invocations), (0, 1));
/// # Ok::<(), karat::compute::ComputeError>(())
/// ```
///
/// # Errors
/// Returns an error if the passes aren't valid.
pub fn violations(
    compute: &Compute<'_>,
) -> Result<(Vec<(Violation, String)>, Watched), ComputeError> {
    let examined = super::sanitizer::examined(&compute.passes()?, compute.package);
    let shown = |(violation, message): (Violation, crate::diagnostic::Diagnostic)| {
        let fails = violation.kind.fails();
        (violation, if fails { message.to_string() } else { message.to_warning() })
    };
    Ok((examined.violations.into_iter().map(shown).collect(), examined.watched))
}

/// The tables that the shaders of the passes print.
///
/// # Errors
/// Returns an error if the passes aren't valid, if the engine can't run them, or if an assertion in a shader is false.
pub fn printed(compute: &Compute<'_>) -> Result<Vec<String>, ComputeError> {
    Ok(printed_by(&compute.passes()?, KEPT)?)
}

/// Every intermediate value of one invocation of the last pass. `invocation` is the `global_invocation_id`.
///
/// ```
/// # use karat::prelude::*;
/// let text = "@group(0) @binding(0) var<storage, read_write> data: array<f32>;
///             @compute @workgroup_size(4) fn root(@builtin(global_invocation_id) id: vec3u) {
///                 data[id.x] = sqrt(data[id.x]);
///             }";
/// let package = Package::from_source("m", text);
/// let passes = package.compute().with("data", Storage::new([0.0_f32, 1.0, 4.0, 9.0]));
/// let steps = karat::unstable::compute::trace(&passes.dispatch("root", [1, 1, 1]), [2, 0, 0])?;
/// assert!(steps.iter().any(|step| step.text == "sqrt(data[id.x])"));
/// # Ok::<(), karat::compute::ComputeError>(())
/// ```
///
/// # Errors
/// Returns an error if the passes aren't valid, if the engine can't run them, or if the invocation doesn't exist.
pub fn trace(
    compute: &Compute<'_>,
    invocation: [u32; 3],
) -> Result<Vec<crate::interpret::trace::Step>, ComputeError> {
    Ok(crate::interpret::trace::trace_pass(&compute.passes()?, invocation)?)
}

/// Hazards in the passes: each with its kind, its position in the source file, and its description.
///
/// ```
/// # use karat::prelude::*;
/// # let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
/// #             @compute @workgroup_size(1) fn count() { data[0] = 7u; }";
/// # let package = Package::from_source("m", text);
/// let passes = package.compute().with("data", Storage::new([1_u32, 2])).dispatch("count", [1, 1, 1]);
/// assert!(karat::unstable::compute::hazards(&passes)?.is_empty());
/// # Ok::<(), karat::compute::ComputeError>(())
/// ```
///
/// # Errors
/// Returns an error if Karat's engine can't run the passes.
pub fn hazards(
    compute: &Compute<'_>,
) -> Result<Vec<(crate::interpret::hazards::Kind, String, String)>, ComputeError> {
    use crate::interpret::hazards::Kind;
    let all = crate::interpret::passes::hazards(&compute.passes()?)?;
    let one = |hazard: crate::interpret::passes::FoundInPass| {
        let found = hazard.found;
        // The sanitizer reports wrong indices in more detail.
        if matches!(found.kind, Kind::OutOfRange | Kind::Wrapped) {
            return None;
        }
        let what = format!("{} at `{}` of {}", found.kind.name(), found.text, hazard.invocation);
        Some((found.kind, found.span.to_string(), what))
    };
    Ok(all.into_iter().filter_map(one).collect())
}

fn element_of(after: &After<'_>) -> Result<Shape, ComputeError> {
    let (_, shape) = after.compute.passes()?.written(&after.variable)?;
    Ok(match shape {
        Shape::Array { element, .. } => *element,
        whole => whole,
    })
}

/// Checks that a resource contains the expected numbers, within a tolerance.
///
/// ```
/// # use karat::prelude::*;
/// # let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
/// #             @compute @workgroup_size(1) fn count() { data[0] = 7u; }";
/// # let package = Package::from_source("m", text);
/// let passes = package.compute().with("data", Storage::new([1_u32, 2])).dispatch("count", [1, 1, 1]);
/// karat::unstable::compute::agrees_with(&passes.after("data"), vec![7.0, 2.0], Ulp(0.0).into())?;
/// # Ok::<(), karat::compute::ComputeError>(())
/// ```
///
/// # Errors
/// Returns an error if a number differs, or Karat can't compare the numbers.
#[track_caller]
pub fn agrees_with(
    after: &After<'_>,
    expected: Vec<f64>,
    tolerance: Tolerance,
) -> Result<ComputeAgreement, ComputeError> {
    let shape = element_of(after)?;
    let expected = Expected { shape, lanes: expected };
    after.judge(Assertion::Agrees(expected, tolerance), Location::caller())
}

/// Records a statement about the passes, with a verdict that the caller already knows. Karat doesn't check the
/// statement in other orders of invocations.
///
/// ```
/// # use karat::prelude::*;
/// # let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
/// #             @compute @workgroup_size(1) fn count() { data[0] = 7u; }";
/// # let package = Package::from_source("m", text);
/// let passes = package.compute().with("data", Storage::new([1_u32, 2])).dispatch("count", [1, 1, 1]);
/// karat::unstable::compute::settled(&passes.after("data"), "nothing goes wrong inside", None)?;
/// # Ok::<(), karat::compute::ComputeError>(())
/// ```
///
/// # Errors
/// Returns an error if `broken` is `Some`, or the passes can't be dispatched.
#[track_caller]
pub fn settled(
    after: &After<'_>,
    text: &str,
    broken: Option<Broken>,
) -> Result<ComputeAgreement, ComputeError> {
    let shape = element_of(after)?;
    let breaks = |_: &[u32]| broken.clone();
    let text = text.to_owned();
    let statement = Statement { text, shape, may_stay: true, settled: true, breaks: &breaks };
    after.judge(Assertion::Holds(statement), Location::caller())
}

/// Checks a statement about all scalars of a resource. `may_stay` says if the passes may leave the resource unchanged.
///
/// ```
/// # use karat::prelude::*;
/// # let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
/// #             @compute @workgroup_size(1) fn count() { data[0] = 7u; }";
/// # let package = Package::from_source("m", text);
/// let passes = package.compute().with("data", Storage::new([1_u32, 2])).dispatch("count", [1, 1, 1]);
/// let after = passes.after("data");
/// karat::unstable::compute::satisfies(&after, "has two elements", false, &|lanes| {
///     use karat::unstable::compute::Broken;
///     (lanes.len() != 2).then_some(Broken { failures: 1, first: None })
/// })?;
/// # Ok::<(), karat::compute::ComputeError>(())
/// ```
///
/// # Errors
/// Returns an error if the statement doesn't hold, or Karat can't read the scalars.
#[track_caller]
pub fn satisfies(
    after: &After<'_>,
    text: &str,
    may_stay: bool,
    breaks: &dyn Fn(&[u32]) -> Option<Broken>,
) -> Result<ComputeAgreement, ComputeError> {
    let shape = element_of(after)?;
    let text = text.to_owned();
    let statement = Statement { text, shape, may_stay, settled: false, breaks };
    after.judge(Assertion::Holds(statement), Location::caller())
}

/// Checks a statement about each number of a resource. `expected` describes the numbers that satisfy the statement.
///
/// ```
/// # use karat::prelude::*;
/// # let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
/// #             @compute @workgroup_size(1) fn count() { data[0] = 7u; }";
/// # let package = Package::from_source("m", text);
/// let passes = package.compute().with("data", Storage::new([1_u32, 2])).dispatch("count", [1, 1, 1]);
/// let texts = ("each number is below 8", "less than 8");
/// karat::unstable::compute::each(&passes.after("data"), texts, &|_, value| value < 8.0)?;
/// # Ok::<(), karat::compute::ComputeError>(())
/// ```
///
/// # Errors
/// Returns an error if a number breaks the statement, or Karat can't read the numbers.
#[track_caller]
pub fn each(
    after: &After<'_>,
    (text, expected): (&str, &str),
    holds: &(dyn Fn(Scalar, f64) -> bool + Sync),
) -> Result<ComputeAgreement, ComputeError> {
    let each = Each { text, shape: element_of(after)?, expected, holds };
    after.judge(Assertion::Each(each), Location::caller())
}
