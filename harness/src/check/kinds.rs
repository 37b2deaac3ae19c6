//! The kinds of hazards that a check looks for, and the hazards that its author accepts.

use crate::interpret::hazards::Kind;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Kinds(u16);

impl Kinds {
    /// The kinds of hazards that an operation inside of a function can have.
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

#[derive(Clone, Debug)]
pub(super) struct Accepted {
    /// The operation's source text, in which each sequence of white space is replaced by a single space.
    pub(super) text: String,
    pub(super) reason: String,
}
