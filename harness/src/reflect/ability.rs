//! The abilities that a shader may need in addition to compute passes over buffers.

use std::fmt;

/// An ability that only some executors have.
///
/// ```
/// use karat::unstable::path::Ability;
///
/// assert_eq!(Ability::F16.to_string(), "f16");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Ability {
    /// 16-bit floats: `enable f16;`.
    F16,
    /// Textures and samplers.
    Textures,
    /// `var<immediate>`.
    Immediates,
    /// Subgroup operations such as `subgroupAdd`.
    Subgroups,
    /// Vertex and fragment functions, to draw frames.
    Frames,
    /// Transfers of buffers as base64. No shader needs this ability; it only makes transfers faster.
    Packed,
}

impl fmt::Display for Ability {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::F16 => "f16",
            Self::Textures => "textures",
            Self::Immediates => "immediates",
            Self::Subgroups => "subgroups",
            Self::Frames => "vertex and fragment functions",
            Self::Packed => "packed words",
        })
    }
}
