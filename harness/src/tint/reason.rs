//! Kinds of reasons for which Tint rejects what naga accepts, and what to do about each.

/// A kind of reason.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Reason {
    /// A derivative, an implicit level of a texture or a barrier under a condition that may differ.
    Uniformity,
    /// A constant that its type can't hold.
    Range,
    /// A constant expression without a value: a division by 0, an index out of bounds, reversed edges.
    Constant,
    /// Operators that WGSL doesn't order.
    Precedence,
    /// An atomic used as a plain value.
    Atomic,
    /// A feature without its `enable`.
    Enable,
    /// Pointers to one variable.
    Aliasing,
    /// Storage that a vertex stage may write.
    VertexStorage,
    /// A name that WGSL keeps for itself.
    Reserved,
    /// Something that this WGSL doesn't have: of wgpu alone, or misspelt.
    Unknown,
    /// A pipeline that can't be made of an entry point.
    Pipeline,
    /// Something else.
    Other,
}

/// Parts of Tint's messages, which have no codes. A test asks Tint for one of each kind, so other words are seen.
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
    /// The kind of one of Tint's messages.
    #[must_use]
    pub fn of(message: &str) -> Self {
        let of = PARTS.iter().find(|(part, _)| message.contains(part));
        of.map_or(Self::Other, |(_, reason)| *reason)
    }

    /// Its name in tables.
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

    /// The remedy, in a line.
    #[must_use]
    pub const fn remedy(self) -> &'static str {
        match self {
            Self::Uniformity => {
                "call it before the condition and choose a result, take `textureSampleLevel` or \
                 `textureSampleGrad`, or make the condition uniform: all invocations must get there together"
            }
            Self::Range => {
                "write a value that the type has: the largest of f32 is 0x1.fffffep+127f, or 3.4028234e+38"
            }
            Self::Constant => {
                "WGSL has no value for it, and no program that computes it at compile time is valid: change \
                 the arguments, or compute it from a variable"
            }
            Self::Precedence => {
                "write the parentheses that you mean: WGSL doesn't order these operators"
            }
            Self::Atomic => "use `atomicStore`, `atomicLoad` and the other atomic functions",
            Self::Enable => {
                "begin the module with `enable` and the extension's name; naga takes f16, clip_distances, \
                 dual_source_blending and primitive_index, and not yet subgroups: no text with those is for both"
            }
            Self::Aliasing => "copy the value into a variable of its own before the call",
            Self::VertexStorage => "declare it `read`, or write it in a compute pass",
            Self::Reserved => "give it another name",
            Self::Unknown => {
                "Chrome's WGSL has no such thing: write it otherwise, or leave it to wgpu"
            }
            Self::Pipeline | Self::Other => {
                "the shader doesn't run in Chrome, Edge, Node and Electron"
            }
        }
    }
}
