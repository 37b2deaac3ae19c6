//! How much is tried to simplify a failing case.

/// How many values are tried.
#[derive(Clone, Copy, Debug)]
pub(super) struct Effort {
    /// In the first trial of a round, whose first values fail most often; each later trial takes
    /// four times as many as the one before.
    pub(super) first: usize,
    /// In one trial, at most.
    pub(super) most: usize,
    /// In one round.
    pub(super) round: usize,
}

impl Effort {
    /// Of calls in dispatches of this many.
    pub(super) fn of_calls(capacity: usize) -> Self {
        Self { first: 128, most: capacity, round: 16_384 }
    }

    /// Of constants: 64 of them are a kernel to compile.
    pub(super) fn of_constants(capacity: usize) -> Self {
        Self { round: 192, ..Self::of_calls(capacity) }
    }

    /// Of integrals, each of which is thousands of calls.
    pub(super) const INTEGRALS: Self = Self { first: 4, most: 32, round: 192 };
}
