//! Limits on the work of simplifying a failing case.

/// Limits on the number of values that Karat tries when it simplifies a failing case. A round tries simpler values of
/// the current case, until one of these values fails. The next round begins with this value.
#[derive(Clone, Copy, Debug)]
pub(super) struct Effort {
    /// The number of values in the first trial of a round. This number is small, because the first values of a round
    /// fail most often. Each later trial tries four times as many values as the trial before.
    pub(super) first: usize,
    pub(super) most: usize,
    pub(super) round: usize,
}

impl Effort {
    /// The limits for checks that call the function. A dispatch has at most `capacity` calls.
    pub(super) fn of_calls(capacity: usize) -> Self {
        Self { first: 128, most: capacity, round: 16_384 }
    }

    /// The limits for arguments that are constants in the kernel. A round tries fewer values, because Karat must
    /// compile a kernel for every 64 cases.
    pub(super) fn of_constants(capacity: usize) -> Self {
        Self { round: 192, ..Self::of_calls(capacity) }
    }

    /// The limits for integrals. These limits are smaller, because each integral takes thousands of calls.
    pub(super) const INTEGRALS: Self = Self { first: 4, most: 32, round: 192 };
}
