//! The kinds of reasons why Tint rejects modules that naga accepts, with a remedy for each kind.

/// The kind of reason why Tint rejects a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Reason {
    /// A derivative, an implicit mip level or a barrier after a condition that may differ between invocations.
    Uniformity,
    /// A constant that is too large for its type.
    Range,
    /// A constant expression without a value: a division by 0, an index outside of the array, or bounds of `clamp` in
    /// the wrong order.
    Constant,
    /// Operators that need parentheses, because WGSL defines no precedence for them.
    Precedence,
    /// An atomic that is used as a plain value.
    Atomic,
    /// A language extension without its `enable`, such as `f16` without `enable f16;`.
    Enable,
    /// Several pointers to one variable.
    Aliasing,
    /// Writable storage in a vertex stage.
    VertexStorage,
    /// A name that WGSL reserves.
    Reserved,
    /// A name that Tint doesn't know. The name exists only in wgpu, or it is misspelt.
    Unknown,
    /// An entry point from which Tint can't make a pipeline.
    Pipeline,
    /// Another reason.
    Other,
}

/// Parts of Tint's messages, by which Karat recognizes the kind of a message, because the messages have no codes. A
/// test asks Tint for a message of each kind, to detect changes in Tint's texts.
const PARTS: [(&str, Reason); 32] = [
    ("must only be called from uniform control flow", Reason::Uniformity),
    ("must be uniform", Reason::Uniformity),
    ("cannot be represented as", Reason::Range),
    ("' to 'atomic<", Reason::Atomic),
    ("(atomic<", Reason::Atomic),
    ("returned 'atomic<", Reason::Atomic),
    ("value of type 'atomic<", Reason::Atomic),
    ("greater than 'high'", Reason::Constant),
    ("equal to 'high'", Reason::Constant),
    ("division by zero is invalid", Reason::Constant),
    ("must be called with a value", Reason::Constant),
    ("zero length vector", Reason::Constant),
    ("out of bounds", Reason::Constant),
    ("must be less than the bit width", Reason::Constant),
    ("must be a const-expression", Reason::Constant),
    ("requires parenthesis", Reason::Precedence),
    ("type used without", Reason::Enable),
    ("without extension '", Reason::Enable),
    ("requires enabling extension", Reason::Enable),
    ("aliased pointer argument", Reason::Aliasing),
    ("cannot be used by vertex pipeline stage", Reason::VertexStorage),
    ("is a reserved keyword", Reason::Reserved),
    ("expected extension", Reason::Unknown),
    ("unresolved", Reason::Unknown),
    ("language feature, which is not allowed", Reason::Unknown),
    ("expected builtin value name", Reason::Unknown),
    ("expected attribute", Reason::Unknown),
    ("expected '<' for", Reason::Unknown),
    ("expected access", Reason::Unknown),
    ("pipeline", Reason::Pipeline),
    ("layout", Reason::Pipeline),
    ("limit", Reason::Pipeline),
];

impl Reason {
    /// The kind of a message from Tint.
    #[must_use]
    pub fn of(message: &str) -> Self {
        let of = PARTS.iter().find(|(part, _)| message.contains(part));
        of.map_or(Self::Other, |(_, reason)| *reason)
    }

    /// The name of the kind of reason, for tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Uniformity => "uniformity",
            Self::Range => "range of a constant",
            Self::Constant => "constant expression",
            Self::Precedence => "precedence",
            Self::Atomic => "atomics",
            Self::Enable => "`enable`",
            Self::Aliasing => "aliasing",
            Self::VertexStorage => "storage in a vertex stage",
            Self::Reserved => "reserved word",
            Self::Unknown => "unknown to Tint",
            Self::Pipeline => "pipeline",
            Self::Other => "other",
        }
    }

    /// The advice for the user, in one line.
    #[must_use]
    pub const fn remedy(self) -> &'static str {
        match self {
            Self::Uniformity => {
                "call the function before the condition and select the result later, use `textureSampleLevel` or \
                 `textureSampleGrad`, or make the condition the same for all invocations"
            }
            Self::Range => {
                "write a value that fits the type: the largest f32 is 0x1.fffffep+127f, or 3.4028234e+38"
            }
            Self::Constant => {
                "WGSL has no value for this expression, so it is an error at compile time: change \
                 the operands, or compute the value from a variable"
            }
            Self::Precedence => "add parentheses: WGSL has no precedence for these operators",
            Self::Atomic => "use `atomicStore`, `atomicLoad` and the other atomic functions",
            Self::Enable => {
                "begin the module with `enable` and the extension's name. naga supports f16, clip_distances, \
                 dual_source_blending and primitive_index, but not subgroups, so no shader with subgroups works in both naga and Tint"
            }
            Self::Aliasing => "copy the value into a variable of its own before the call",
            Self::VertexStorage => {
                "declare the variable as `read`, or write to it in a compute pass"
            }
            Self::Reserved => "WGSL reserves this name: use another name",
            Self::Unknown => {
                "Chrome's WGSL doesn't have this name: write the code without the name, or run the shader only with wgpu"
            }
            Self::Pipeline | Self::Other => {
                "the shader can't run in Chrome, Edge, Node or Electron"
            }
        }
    }
}
