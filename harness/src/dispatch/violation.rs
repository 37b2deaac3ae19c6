//! Violations in compute passes, as data: actions that WGSL doesn't order or define, such as races, barriers that some
//! invocations miss, and indices outside their arrays. The engine finds them.

use serde::{Deserialize, Serialize};

use crate::diagnostic::Diagnostic;
use crate::hazard::Kind;

/// An invocation's access to an element, or its action at a barrier.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ViolationAccess {
    /// `file:line:column`
    pub place: String,
    /// `local (3, 0, 0) of workgroup (1, 0, 0)`
    pub invocation: String,
    /// `writes 7`, `reads 0.5`, `reaches it`, `doesn't`
    pub does: String,
}

/// A violation of WGSL's memory model or bounds: two unordered accesses to an element by different invocations, at
/// least one of which writes; a barrier that not every invocation of a workgroup reaches; or an index outside its
/// array.
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
    /// The violation in one line.
    pub headline: String,
    /// `module::entry_point`
    pub entry_point: String,
    /// The kind of a violation.
    pub kind: Kind,
    /// The author's name of the variable; empty for a barrier or an index.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub variable: String,
    /// The element, `tile[17].sum`; empty for a barrier or an index.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub element: String,
    /// The number of elements with the violation; for a barrier, the number of invocations that miss it; for an index,
    /// the number of times that it is outside.
    pub count: u64,
    /// For a race, the construct that would order it: the barrier, an atomic, or two passes.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub advice: String,
    /// Both accesses, in the order in which Karat's engine made them (WGSL allows this order and others). For an index,
    /// the first access outside.
    pub accesses: Vec<ViolationAccess>,
}

impl Violation {
    /// A violation without an element.
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

/// The findings of the sanitizer in passes.
#[derive(Debug, Default)]
pub struct Examined {
    /// Each violation with its message.
    pub violations: Vec<(Violation, Diagnostic)>,
    /// The extent of the check.
    pub watched: Watched,
    /// A loop that was stopped.
    pub endless: Option<Diagnostic>,
    /// Set if all loops together took more rounds than are tried over generated resources.
    pub too_long: bool,
}

/// The extent of the sanitizer's check of passes.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Watched {
    /// The number of invocations that ran in Karat's engine.
    pub invocations: u64,
    /// The number of invocations in all passes.
    pub of: u64,
    /// The reason why not all ran; empty if all did.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub reason: String,
    /// The number of rounds of all loops together.
    #[serde(skip)]
    pub rounds: u64,
    /// The number of orders of invocations, besides the usual one, in which the assertion held.
    #[serde(default)]
    pub orders: u64,
    /// Set if there are no other orders, except those with the same effect.
    #[serde(default)]
    pub all_orders: bool,
    /// Elements of buffers with a size and no contents that are read before a pass writes them, if the result depends
    /// on that: `partials[3]` and the place.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub unwritten: Vec<String>,
    /// Variables with accepted races, each with its reason.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub accepted: Vec<(String, String)>,
}
