//! Kinds of hazards that a check asks for, and hazards that are meant.

use crate::interpret::hazards::Kind;

/// Kinds of hazards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Kinds(u16);

impl Kinds {
    /// Those that an operation inside of a function may have.
    pub(super) const ALL: [Kind; 11] = [
        Kind::Nan,
        Kind::OutOfRange,
        Kind::Wrapped,
        Kind::BelowZero,
        Kind::Barrier,
        Kind::ByZero,
        Kind::Infinite,
        Kind::Saturated,
        Kind::EdgesReversed,
        Kind::LostDigits,
        Kind::Unbounded,
    ];

    pub(super) fn of(kinds: &[Kind]) -> Self {
        Self(kinds.iter().fold(0, |all, kind| all | 1 << *kind as u16))
    }

    pub(super) fn contains(self, kind: Kind) -> bool {
        self.0 >> kind as u16 & 1 == 1
    }
}

/// A hazard that is meant.
#[derive(Clone, Debug)]
pub(super) struct Accepted {
    /// The operation, as its author wrote it.
    pub(super) text: String,
    pub(super) reason: String,
}
