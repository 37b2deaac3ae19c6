//! Why a program isn't lowered, and why a run stops.

use naga::Span;
use thiserror::Error;

/// What the engine doesn't execute, and where it stands.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("the engine doesn't execute {what}")]
pub struct Refusal {
    /// What it is.
    pub what: String,
    /// Its bytes in the source, undefined where naga has none.
    pub span: Span,
}

impl Refusal {
    pub(crate) fn new(what: impl Into<String>, span: Span) -> Self {
        Self { what: what.into(), span }
    }
}

/// Why a run ended before all results were there.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum Stop {
    /// A loop ran for more rounds than the options allow.
    #[error("case {case} spent its fuel of {rounds} loop rounds")]
    Fuel {
        /// The loop.
        span: Span,
        /// The first case that needed more.
        case: usize,
        /// What was allowed.
        rounds: u64,
        /// Rounds of the loop that had gone round most often since it began: few of it are many loops, and no loop without
        /// an end.
        own: u64,
    },
    /// A loop was still running at the deadline.
    #[error("case {case} was still in a loop at the deadline")]
    Late {
        /// The loop.
        span: Span,
        /// A case that was in it.
        case: usize,
    },
    /// Each invocation that runs reads the same words in loops, and none changes any more.
    #[error("case {case} waits in a loop for a word that nothing changes any more")]
    Waits {
        /// A read in such a loop.
        span: Span,
        /// A case that was in it.
        case: usize,
    },
    /// The loops of all cases together ran for more rounds than the options allow.
    #[error("its loops go round more than {rounds} times together")]
    Work {
        /// A loop that was running.
        span: Span,
        /// The rounds that the options allow.
        rounds: u64,
    },
    /// The words aren't whole rows.
    #[error("{found} words aren't {cases} rows of {width}")]
    Rows {
        /// How many words there are.
        found: usize,
        /// Words a row.
        width: usize,
        /// How many rows there should be.
        cases: usize,
    },
    /// The caller's resources lack one, or have another kind.
    #[error("no {kind} `{name}` in group {group}, binding {binding}")]
    Missing {
        /// `buffer`, `texture` or `sampler`, or what of it doesn't fit.
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
    #[error("buffer `{name}` has {found} bytes, its type {needed}")]
    Short {
        /// Its name in the module.
        name: String,
        /// Its size in bytes.
        found: usize,
        /// What the type needs.
        needed: usize,
    },
    /// Something that this arithmetic has no rule for.
    #[error("{what} has no rule in intervals")]
    NoRule {
        /// What it is.
        what: &'static str,
        /// Where it stands.
        span: Span,
    },
    /// A function was dispatched, or an entry point called.
    #[error("{0}")]
    Misuse(&'static str),
}
