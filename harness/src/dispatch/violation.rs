//! Violations in compute passes, as data. A violation breaks a rule of WGSL: two invocations race, some
//! invocations miss a barrier, or an index is outside of its array. The engine finds violations.

use serde::{Deserialize, Serialize};

use crate::diagnostic::Diagnostic;
use crate::hazard::Kind;

/// An invocation's access to an element, or its action at a barrier.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ViolationAccess {
    /// The position of the access in the source, as `file:line:column`.
    pub place: String,
    /// The invocation, such as `local (3, 0, 0) of workgroup (1, 0, 0)`.
    pub invocation: String,
    /// The invocation's action, such as `writes 7` or `reads 0.5`. At a barrier, `reaches it`, `doesn't` or
    /// `takes another branch here`.
    pub does: String,
}

/// A violation of WGSL's memory model or of an array's bounds. In a race, two invocations access the same
/// element in no defined order, and at least one of them writes. Other violations are a barrier that some
/// invocations of a workgroup miss, and an index outside of its array.
///
/// ```
/// use karat::check::HazardKind;
/// use karat::compute::ComputeError;
/// # use karat::prelude::*;
///
/// let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
///             @compute @workgroup_size(4) fn shift(@builtin(local_invocation_index) i: u32) {
///                 data[i] = data[i ^ 1u];
///             }";
/// let package = Package::from_source("m", text);
/// let passes = package.compute().with("data", Storage::new([1_u32, 2, 3, 4]));
/// let passes = passes.dispatch("shift", [1, 1, 1]).after("data").unrecorded();
/// let Err(ComputeError::Violations(found)) = passes.try_agrees_with([2_u32, 1, 4, 3], Abs(0.0)) else {
///     panic!("each driver has an order of its own");
/// };
/// assert_eq!((found.all[0].kind, &*found.all[0].element), (HazardKind::Race, "data[0]"));
/// ```
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Violation {
    /// A description of the violation, in one line.
    pub headline: String,
    /// The entry point, such as `module::entry_point`.
    pub entry_point: String,
    /// The kind of the violation.
    pub kind: Kind,
    /// The variable's name in the author's file. Empty for a missed barrier or a wrong index.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub variable: String,
    /// The element, such as `tile[17].sum`. Empty for a missed barrier or a wrong index.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub element: String,
    /// The number of elements with the violation. For a barrier, the number of invocations that miss the barrier. For a
    /// wrong index, the number of times that the index is outside of its array.
    pub count: u64,
    /// For a race, the construct that would order the accesses: a barrier, an atomic, or two passes.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub advice: String,
    /// For a race, the two accesses, in the order in which Karat's engine made them. For a missed barrier, an
    /// invocation that reaches the barrier, and one that misses it. For a wrong index, only the first access outside of
    /// the array.
    pub accesses: Vec<ViolationAccess>,
}

impl Violation {
    /// Makes a violation. The variable, the element and the advice are empty.
    pub fn new(
        entry_point: &str,
        kind: Kind,
        (headline, count): (String, u64),
        accesses: Vec<ViolationAccess>,
    ) -> Self {
        let (variable, element, advice) = <(String, String, String)>::default();
        let entry_point = entry_point.to_owned();
        Self { headline, entry_point, kind, variable, element, count, advice, accesses }
    }
}

/// The results of the sanitizer's check of passes.
#[derive(Debug, Default)]
pub struct Examined {
    /// The violations, each with its message.
    pub violations: Vec<(Violation, Diagnostic)>,
    /// The part of the passes that the sanitizer checked.
    pub watched: Watched,
    /// The message about a loop that Karat stopped, if there is one.
    pub endless: Option<Diagnostic>,
    /// `true` if Karat stopped a pass because its loops together took too many iterations.
    pub too_long: bool,
}

/// The part of the passes that the sanitizer checked.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Watched {
    /// The number of invocations that ran in Karat's engine.
    pub invocations: u64,
    /// The number of invocations in all passes.
    pub of: u64,
    /// The reason why Karat's engine didn't run all invocations. The text is empty if the engine ran all invocations.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub reason: String,
    /// The number of iterations of all loops together.
    #[serde(skip)]
    pub rounds: u64,
    /// The number of orders of invocations that Karat tried in addition to its default order.
    #[serde(default)]
    pub orders: u64,
    /// `true` if Karat tried all orders that could have different effects.
    #[serde(default)]
    pub all_orders: bool,
    /// Elements that a pass reads before any pass writes them. Each text has the element, such as `partials[3]`, and
    /// the position of the read. The list is empty if the passes' results don't depend on these elements. The elements
    /// are in buffers for which the test sets only a size and no contents.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub unwritten: Vec<String>,
    /// The variables on which the test allows races, each with the test's reason.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub accepted: Vec<(String, String)>,
}
