//! Actions of compute passes that WGSL doesn't order or define, as data: races, barriers that some invocations miss,
//! indices that leave their arrays. The engine finds them.

use serde::{Deserialize, Serialize};

use crate::diagnostic::Diagnostic;
use crate::hazard::Kind;

/// The action of an invocation on an element, or at a barrier.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ViolationAccess {
    /// `file:line:column`
    pub place: String,
    /// `local (3, 0, 0) of workgroup (1, 0, 0)`
    pub invocation: String,
    /// `writes 7`, `reads 0.5`, `reaches it`, `doesn't`
    pub does: String,
}

/// Two accesses of an element by different invocations, of which at least one writes and which nothing orders; a
/// barrier that not every invocation of a workgroup reaches; or an index that leaves its array.
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
    /// It in one line.
    pub headline: String,
    /// `module::entry_point`
    pub entry_point: String,
    /// The kind of a violation.
    pub kind: Kind,
    /// The variable, as its author names it; empty of a barrier and an index.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub variable: String,
    /// The element: `tile[17].sum`; empty of a barrier and an index.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub element: String,
    /// How many elements have it; of a barrier, how many invocations don't reach it; of an index, how often it is so.
    pub count: u64,
    /// Of a race what orders it: the barrier, an atomic, or two passes.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub advice: String,
    /// Both accesses, in the order in which Karat's engine made them, which is one of those that WGSL allows; of an
    /// index the first that leaves.
    pub accesses: Vec<ViolationAccess>,
}

impl Violation {
    /// One of no element.
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
    /// Each with its message.
    pub violations: Vec<(Violation, Diagnostic)>,
    /// How much of them was looked at.
    pub watched: Watched,
    /// A loop that was stopped.
    pub endless: Option<Diagnostic>,
    /// True if all loops together went round more often than is tried over made-up resources.
    pub too_long: bool,
}

/// How much of passes was looked through by the sanitizer.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Watched {
    /// Invocations that ran in Karat's engine.
    pub invocations: u64,
    /// Invocations of all passes.
    pub of: u64,
    /// Why it isn't all; empty if it is.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub reason: String,
    /// Rounds of all loops together.
    #[serde(skip)]
    pub rounds: u64,
    /// Orders of invocations, beside the usual one, in which the assertion held.
    #[serde(default)]
    pub orders: u64,
    /// True if there are no others, but for those that lead to the same.
    #[serde(default)]
    pub all_orders: bool,
    /// Elements of buffers that are given by their size alone, read before a pass writes them, where what passes leave
    /// depends on it: `partials[3]` and where.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub unwritten: Vec<String>,
    /// Variables whose races are accepted, each with its reason.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub accepted: Vec<(String, String)>,
}
