//! The kinds of hazards in shaders: one list for operations, passes and reports.

/// The kind of a hazard, the worst first.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize,
)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Kind {
    /// A value is NaN.
    Nan,
    /// An index is outside its array.
    OutOfRange,
    /// An index is inside its array only because a sum or a product wrapped around.
    Wrapped,
    /// An unsigned difference goes below 0, and is converted to a float.
    BelowZero,
    /// Two accesses of an element are unordered.
    Race,
    /// Some invocations of a workgroup miss a barrier, some of a subgroup miss a subgroup operation, or some of a quad
    /// miss a derivative.
    Barrier,
    /// An integer is divided by zero.
    ByZero,
    /// A value is infinite.
    Infinite,
    /// A float is outside the range of the integer type that it is converted to.
    Saturated,
    /// The low edge of `clamp` or `smoothstep` isn't below the high one.
    EdgesReversed,
    /// More than half of a value's digits are rounding errors.
    LostDigits,
    /// Two writes of the same value are unordered.
    EqualWrites,
    /// WGSL allows any result.
    Unbounded,
    /// A loop was stopped.
    Endless,
    /// Workgroup memory is read before an invocation writes it. WGSL (7.3) says that it is zero, but hosts may turn
    /// that off.
    Unwritten,
}

impl Kind {
    /// Its name. `karat.toml` and JSON use the same, but without blanks.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Nan => "NaN",
            Self::OutOfRange => "out of range",
            Self::Wrapped => "wrapped",
            Self::BelowZero => "below zero",
            Self::Race => "race",
            Self::Barrier => "barrier",
            Self::EqualWrites => "equal writes",
            Self::ByZero => "by zero",
            Self::Infinite => "infinite",
            Self::Saturated => "saturated",
            Self::EdgesReversed => "edges reversed",
            Self::LostDigits => "lost digits",
            Self::Unbounded => "unbounded",
            Self::Endless => "endless",
            Self::Unwritten => "unwritten",
        }
    }

    /// The meaning, in a sentence.
    #[must_use]
    pub fn about(self) -> &'static str {
        match self {
            Self::Nan => "it isn't a number, though its operands are",
            Self::OutOfRange => {
                "the index leaves its array: WGSL lets a read give any element or zero, and a write change any or none"
            }
            Self::Wrapped => {
                "a sum or a product of the index goes beyond 32 bits: it finds another element than is meant"
            }
            Self::BelowZero => {
                "a difference of whole numbers without a sign goes below 0: as a float it is some 4.29e9"
            }
            Self::Race => {
                "nothing orders these two accesses of an element: each driver has an order of its own"
            }
            Self::Barrier => {
                "WGSL wants each invocation of a workgroup to reach a barrier, of a subgroup its operation, and of a quad a \
                 derivative, `textureSample`'s too (15.2)"
            }
            Self::EqualWrites => "nothing orders two writes of the same value",
            Self::ByZero => "an integer is divided by zero: in WGSL x / 0 is x, and x % 0 is 0",
            Self::Infinite => "it overflows, or divides by zero",
            Self::Saturated => {
                "the integer type doesn't reach so far: WGSL takes its nearest value, GLSL any"
            }
            Self::EdgesReversed => {
                "the low edge is above the high one, or of `smoothstep` the same: implementations differ in what comes of that"
            }
            Self::LostDigits => "more than half of its digits are rounding errors",
            Self::Unbounded => {
                "WGSL bounds no error here, so drivers may return anything (15.7.4: a divisor outside of 2^-126 to \
                 2^126, an angle beyond pi)"
            }
            Self::Endless => "the loop was stopped after thousands of rounds",
            Self::Unwritten => {
                "workgroup memory is zero where nothing wrote it, but hosts may turn that off"
            }
        }
    }

    /// Returns `true` if WGSL leaves the result open, so that a test of passes fails. Unwritten workgroup memory is
    /// zero: a hazard, but not a failure.
    #[must_use]
    pub fn fails(self) -> bool {
        self != Self::Unwritten
    }

    /// Returns `true` if an index selects another element than the intended one.
    #[must_use]
    pub fn is_of_index(self) -> bool {
        matches!(self, Self::OutOfRange | Self::Wrapped)
    }
}
