//! Sources of a kernel's arguments.

use std::fmt;

/// The source of a kernel's arguments. Compilers treat each source differently.
///
/// WGSL compilers don't evaluate user functions at compile time. But if the arguments are constants, a driver may
/// inline the function and evaluate it at compile time. The compiler may round differently than the GPU.
///
/// ```
/// use karat::prelude::*;
///
/// let package = Package::from_source("m", "fn f(x: f32) -> f32 { return 2.0 * x; }");
/// let agreement = package
///     .function("f")
///     .over(0.0..=1.0)
///     .from_all_sources()
///     .agrees_with(|x: f64| 2.0 * x, Ulp(0.0));
/// assert!(agreement.cases > 0);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Inputs {
    /// A storage buffer with the arguments of a whole batch.
    #[default]
    Storage,
    /// A uniform buffer of 16 KiB, which every device supports. A check then needs many small dispatches.
    Uniform,
    /// Constants in the kernel's text. A check then has at most 64 cases, because each case is a separate call. The
    /// arguments can't be NaN or infinities, for which WGSL has no constants.
    Constant,
}

impl Inputs {
    /// All sources of arguments.
    pub const ALL: [Self; 3] = [Self::Storage, Self::Uniform, Self::Constant];

    /// The name of the source: `storage`, `uniform`, `constant`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Storage => "storage",
            Self::Uniform => "uniform",
            Self::Constant => "constant",
        }
    }

    /// The text that reports add to a path's name to show the source. The text is empty for a storage buffer, the
    /// default.
    pub(crate) fn remark(self) -> &'static str {
        match self {
            Self::Storage => "",
            Self::Uniform => ", arguments from a uniform buffer",
            Self::Constant => ", arguments as constants",
        }
    }
}

impl fmt::Display for Inputs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
