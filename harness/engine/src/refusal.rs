//! The reasons why a program can't be lowered, and why a run stops.

use naga::Span;
use thiserror::Error;

/// A construct that the engine doesn't execute, and its place.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("the engine doesn't execute {what}")]
pub struct Refusal {
    /// The construct.
    pub what: String,
    /// Its bytes in the source, undefined if naga has none.
    pub span: Span,
}

impl Refusal {
    pub(crate) fn new(what: impl Into<String>, span: Span) -> Self {
        Self { what: what.into(), span }
    }
}

/// The reason why a run ended before all results were there.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum Stop {
    /// A loop ran for more rounds than the options allow.
    #[error("case {case} ran more than {rounds} loop rounds")]
    Fuel {
        /// The loop.
        span: Span,
        /// The first case that ran out of rounds.
        case: usize,
        /// The rounds that were allowed.
        rounds: u64,
        /// The rounds of the open loop with the most rounds. A small number means many loops, but no endless one.
        own: u64,
    },
    /// A loop was still running at the deadline.
    #[error("case {case} was still in a loop at the deadline")]
    Late {
        /// The loop.
        span: Span,
        /// A case in that loop.
        case: usize,
    },
    /// Each running invocation reads the same words in a loop, and none of them changes a word.
    #[error("case {case} waits in a loop for a word that nothing changes")]
    Waits {
        /// A read in such a loop.
        span: Span,
        /// A case in that loop.
        case: usize,
    },
    /// The loops of all cases together ran for more rounds than the options allow.
    #[error("its loops run more than {rounds} rounds in total")]
    Work {
        /// A loop that was running.
        span: Span,
        /// The rounds that the options allow.
        rounds: u64,
    },
    /// The words aren't whole rows.
    #[error("{found} words don't make {cases} rows of {width} words")]
    Rows {
        /// The number of words.
        found: usize,
        /// Words a row.
        width: usize,
        /// The number of rows that were expected.
        cases: usize,
    },
    /// A resource of the caller is missing, or has another kind.
    #[error("no {kind} `{name}` in group {group}, binding {binding}")]
    Missing {
        /// `buffer`, `texture` or `sampler`, or the property of it that doesn't fit.
        kind: &'static str,
        /// Its name in the module.
        name: String,
        /// Its group.
        group: u32,
        /// Its binding.
        binding: u32,
        /// Its declaration.
        span: Span,
    },
    /// A buffer is smaller than its type.
    #[error("buffer `{name}` has {found} bytes, but its type needs {needed}")]
    Short {
        /// Its name in the module.
        name: String,
        /// Its size in bytes.
        found: usize,
        /// The size that its type needs, in bytes.
        needed: usize,
    },
    /// This arithmetic has no rule for something.
    #[error("{what} has no rule in intervals")]
    NoRule {
        /// The operation or type without a rule.
        what: &'static str,
        /// Its place in the source.
        span: Span,
    },
    /// An attempt to dispatch a function, or to call an entry point.
    #[error("{0}")]
    Misuse(&'static str),
}
