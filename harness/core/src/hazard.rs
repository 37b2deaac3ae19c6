//! The kinds of hazards in shaders.

/// The kind of a hazard. The kinds are ordered from the worst to the least serious.
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
    /// An unsigned subtraction wraps around below 0, and its result is converted to a float.
    BelowZero,
    /// Two accesses of the same element have no defined order, and at least one is a write.
    Race,
    /// Some invocations of a workgroup miss a barrier, some invocations of a subgroup miss a subgroup operation, or
    /// some invocations of a quad miss a derivative.
    Barrier,
    /// An integer is divided by zero.
    ByZero,
    /// A value is infinite.
    Infinite,
    /// A float is outside the range of the integer type that it is converted to.
    Saturated,
    /// The low edge of `clamp` or `smoothstep` is above the high edge, or both edges of `smoothstep` are equal.
    EdgesReversed,
    /// More than half of a value's digits are rounding errors.
    LostDigits,
    /// Two writes of the same value to the same element have no defined order.
    EqualWrites,
    /// WGSL allows any result for these operands.
    Unbounded,
    /// The engine stopped a loop after too many iterations.
    Endless,
    /// An invocation reads workgroup memory that no invocation has written. WGSL (7.3) says that this memory is zero,
    /// but hosts may turn this initialization off.
    Unwritten,
}

impl Kind {
    /// The kind's name. `karat.toml` and JSON use the name in lower case, with `_` instead of spaces.
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

    /// An explanation of the kind, as a clause for messages.
    #[must_use]
    pub fn about(self) -> &'static str {
        match self {
            Self::Nan => "the result is NaN for operands that aren't NaN",
            Self::OutOfRange => {
                "the index is outside of its array: WGSL lets a read return any element or zero, and lets a write change any element or none"
            }
            Self::Wrapped => {
                "a sum or a product in the index overflows 32 bits, so the index selects a wrong element"
            }
            Self::BelowZero => {
                "the difference of two unsigned integers is below 0 and wraps around: converted to a float, the result is about 4.29e9"
            }
            Self::Race => {
                "these two accesses of one element have no defined order: each driver may choose its own order"
            }
            Self::Barrier => {
                "some invocations don't reach this operation: a barrier needs all invocations of the workgroup, a subgroup \
                 operation needs all invocations of the subgroup, and a derivative or `textureSample` needs all invocations of \
                 the quad (WGSL 15.2)"
            }
            Self::EqualWrites => "two writes of the same value have no defined order",
            Self::ByZero => "an integer is divided by zero: in WGSL x / 0 is x, and x % 0 is 0",
            Self::Infinite => "the operation overflows or divides by zero",
            Self::Saturated => {
                "the float is outside of the integer type's range: WGSL converts the float to the nearest integer of the type, GLSL to any integer"
            }
            Self::EdgesReversed => {
                "the low edge is above the high edge, or equal to it in `smoothstep`: implementations return different results"
            }
            Self::LostDigits => "more than half of the result's digits are rounding errors",
            Self::Unbounded => {
                "WGSL doesn't limit the error of this operation here, so drivers may return anything (WGSL 15.7.4: for \
                 example, for a divisor outside of 2^-126 to 2^126, or for an angle beyond pi)"
            }
            Self::Endless => "Karat stopped the loop after thousands of iterations",
            Self::Unwritten => {
                "the shader reads workgroup memory before writing it: WGSL sets the memory to zero, but a host can turn this initialization off"
            }
        }
    }

    /// Checks if a test of a pass fails when the pass has a hazard of this kind. A test allows reads of unwritten
    /// workgroup memory, because WGSL says that this memory is zero. All other kinds fail the test.
    #[must_use]
    pub fn fails(self) -> bool {
        self != Self::Unwritten
    }

    /// Checks if hazards of this kind are indices that select a wrong element.
    #[must_use]
    pub fn is_of_index(self) -> bool {
        matches!(self, Self::OutOfRange | Self::Wrapped)
    }
}
