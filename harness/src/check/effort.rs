//! The effort of simplifying a failing case.

/// The numbers of values that Karat tries to simplify a failing case.
#[derive(Clone, Copy, Debug)]
pub(super) struct Effort {
    /// The values in the first trial of a round. The first values of a round fail most often, so this number is
    /// small. Each later trial takes four times as many values as the trial before.
    pub(super) first: usize,
    /// The most values in one trial.
    pub(super) most: usize,
    /// The most values in one round.
    pub(super) round: usize,
}

impl Effort {
    /// The effort for calls, with dispatches of `capacity` calls.
    pub(super) fn of_calls(capacity: usize) -> Self {
        Self { first: 128, most: capacity, round: 16_384 }
    }

    /// The effort for arguments that are constants. It is smaller, because each kernel, which has 64 constants,
    /// must be compiled.
    pub(super) fn of_constants(capacity: usize) -> Self {
        Self { round: 192, ..Self::of_calls(capacity) }
    }

    /// The effort for integrals. It is smaller, because each integral takes thousands of calls.
    pub(super) const INTEGRALS: Self = Self { first: 4, most: 32, round: 192 };
}
