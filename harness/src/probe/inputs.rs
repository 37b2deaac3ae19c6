//! Where a kernel takes its arguments from.

use std::fmt;

/// The source of the arguments: compilers treat each in another way.
///
/// WGSL has no functions of the author's that are evaluated when a shader is compiled; but
/// arguments that are constants are folded into the function by drivers once it is inlined, with
/// arithmetic of their own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Inputs {
    /// A storage buffer, which holds the arguments of a whole batch.
    #[default]
    Storage,
    /// A uniform buffer of 16 KiB, which every device has: many small dispatches.
    Uniform,
    /// Constants in the kernel's text: at most 64 cases, as each is a call of its own. NaN and
    /// infinities can't be constants in WGSL.
    Constant,
}

impl Inputs {
    /// Every source.
    pub const ALL: [Self; 3] = [Self::Storage, Self::Uniform, Self::Constant];

    /// `storage`, `uniform`, `constant`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Storage => "storage",
            Self::Uniform => "uniform",
            Self::Constant => "constant",
        }
    }

    /// What a report adds to a path; nothing for a storage buffer.
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
