//! The reasons why a program can't be lowered, and why a run stops.

use naga::Span;
use thiserror::Error;

/// A construct that the engine can't execute, and its position.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("the engine doesn't support {what}")]
pub struct Refusal {
    /// The construct.
    pub what: String,
    /// The construct's bytes in the source. Undefined if naga has no position for the construct.
    pub span: Span,
}

impl Refusal {
    pub(crate) fn new(what: impl Into<String>, span: Span) -> Self {
        Self { what: what.into(), span }
    }
}

/// The reason why a run ended before all its results were computed.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum Stop {
    /// A loop ran for more iterations than the options allow.
    #[error("case {case} ran more than {rounds} loop iterations")]
    Fuel {
        /// The loop.
        span: Span,
        /// The first case that ran too many iterations.
        case: usize,
        /// The number of iterations that were allowed.
        rounds: u64,
        /// The number of iterations of the open loop that ran the most iterations. If this number is small, there are
        /// many loops, but none is endless.
        own: u64,
    },
    /// A loop was still running at the deadline.
    #[error("case {case} was still in a loop at the deadline")]
    Late {
        /// The loop.
        span: Span,
        /// A case that is in the loop.
        case: usize,
    },
    /// All running invocations wait in loops: they read the same words again and again, and none of them changes a
    /// word.
    #[error("case {case} waits in a loop for a value that no invocation changes")]
    Waits {
        /// A read in one of the loops that wait.
        span: Span,
        /// A case that is in the loop.
        case: usize,
    },
    /// The loops of all cases ran more iterations in total than the options allow.
    #[error("the loops of all cases run more than {rounds} iterations in total")]
    Work {
        /// A loop that was running.
        span: Span,
        /// The number of iterations that the options allow.
        rounds: u64,
    },
    /// The number of argument words isn't the number of cases times the width of a row.
    #[error("the arguments have {found} scalars, but {cases} cases need {width} scalars each")]
    Rows {
        /// The number of words.
        found: usize,
        /// The number of words in a row.
        width: usize,
        /// The number of rows that were expected.
        cases: usize,
    },
    /// A resource of the caller is missing, or has a wrong kind.
    #[error("no {kind} `{name}` is bound to group {group}, binding {binding}")]
    Missing {
        /// `buffer`, `texture` or `sampler`, or a property that the resource doesn't have.
        kind: &'static str,
        /// The resource's name in the module.
        name: String,
        /// The resource's group.
        group: u32,
        /// The resource's binding.
        binding: u32,
        /// The resource's declaration in the source.
        span: Span,
    },
    /// A buffer is smaller than its type.
    #[error("buffer `{name}` has {found} bytes, but its type needs {needed} bytes")]
    Short {
        /// The buffer's name in the module.
        name: String,
        /// The buffer's size in bytes.
        found: usize,
        /// The size that its type needs, in bytes.
        needed: usize,
    },
    /// The arithmetic has no rule for an operation or a type.
    #[error("the interval arithmetic has no rule for {what}")]
    NoRule {
        /// The operation or type without a rule.
        what: &'static str,
        /// The position in the source.
        span: Span,
    },
    /// The caller dispatched a function, or called an entry point.
    #[error("{0}")]
    Misuse(&'static str),
}
