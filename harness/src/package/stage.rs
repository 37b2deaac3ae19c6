//! The stage of an entry point.

use std::fmt;

/// The stage of an entry point.
///
/// ```
/// use karat::Package;
/// use karat::unstable::reflect::Stage;
///
/// let package = Package::from_source("m", "@fragment fn main() -> @location(0) vec4f { return vec4f(); }");
/// assert_eq!(package.functions()?[0].entry_point, Some(Stage::Fragment));
/// # Ok::<(), karat::package::PackageError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// A vertex stage: `@vertex`.
    Vertex,
    /// A fragment stage: `@fragment`.
    Fragment,
    /// A compute stage: `@compute`.
    Compute,
    /// A stage that Karat doesn't run, such as the stage of a mesh shader.
    Other,
}

impl Stage {
    /// The stage that an attribute such as `vertex` declares; `None` if the attribute declares no stage.
    pub(super) fn of(attribute: &str) -> Option<Self> {
        Some(match attribute {
            "vertex" => Self::Vertex,
            "fragment" => Self::Fragment,
            "compute" => Self::Compute,
            "task" | "mesh" | "ray_generation" | "miss" | "any_hit" | "closest_hit" => Self::Other,
            _ => return None,
        })
    }
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Vertex => "vertex",
            Self::Fragment => "fragment",
            Self::Compute => "compute",
            Self::Other => "other_stage",
        })
    }
}
