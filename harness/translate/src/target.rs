//! The languages that naga writes, and the translations.

use std::fmt;
use std::str::FromStr;

use crate::Bindings;

/// A language that naga translates to, in a version that some API accepts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Target {
    /// SPIR-V 1.3, for Vulkan 1.1.
    Spirv,
    /// GLSL 4.50, for OpenGL.
    Glsl,
    /// GLSL ES 3.10, for OpenGL ES.
    GlslEs,
    /// HLSL for shader model 5.1, which FXC compiles.
    Hlsl,
    /// HLSL for shader model 6.2, which DXC compiles, and which has 16-bit floats.
    Hlsl6,
    /// Metal's language, version 2.4.
    Msl,
    /// WGSL, as naga writes it.
    Wgsl,
}

impl Target {
    /// All languages.
    pub const ALL: [Self; 7] =
        [Self::Spirv, Self::Glsl, Self::GlslEs, Self::Hlsl, Self::Hlsl6, Self::Msl, Self::Wgsl];

    /// The name on the command line and in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Spirv => "spirv",
            Self::Glsl => "glsl",
            Self::GlslEs => "glsl-es",
            Self::Hlsl => "hlsl",
            Self::Hlsl6 => "hlsl6",
            Self::Msl => "msl",
            Self::Wgsl => "wgsl",
        }
    }

    /// The extension of its files.
    #[must_use]
    pub const fn extension(self) -> &'static str {
        match self {
            Self::Spirv => "spv",
            Self::Glsl | Self::GlslEs => "glsl",
            Self::Hlsl | Self::Hlsl6 => "hlsl",
            Self::Msl => "metal",
            Self::Wgsl => "wgsl",
        }
    }

    /// Returns `true` if a text has only one entry point.
    #[must_use]
    pub const fn is_of_one_entry_point(self) -> bool {
        matches!(self, Self::Glsl | Self::GlslEs)
    }
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Target {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let known = Self::ALL.into_iter().find(|target| target.name() == name);
        known.ok_or_else(|| {
            let names = Self::ALL.map(Self::name).join(", ");
            format!("naga writes no `{name}`; it writes {names}")
        })
    }
}

/// The text or the words of a translation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Code {
    /// Source text.
    Text(String),
    /// SPIR-V.
    Words(Vec<u32>),
}

impl Code {
    /// The text, if it is one.
    #[must_use]
    pub fn text(&self) -> Option<&str> {
        match self {
            Self::Text(text) => Some(text),
            Self::Words(_) => None,
        }
    }

    /// The bytes of its file. SPIR-V is little-endian.
    #[must_use]
    pub fn bytes(&self) -> Vec<u8> {
        match self {
            Self::Text(text) => text.as_bytes().to_vec(),
            Self::Words(words) => words.iter().flat_map(|word| word.to_le_bytes()).collect(),
        }
    }
}

/// A translation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Translation {
    /// The language.
    pub target: Target,
    /// The text, or the words.
    pub code: Code,
    /// Its entry points, with their names in it.
    pub entry_points: Vec<crate::EntryPoint>,
    /// The binding of each WGSL variable in it.
    pub bindings: Bindings,
    /// naga's options, in words.
    pub options: String,
    /// The structures in uniform buffers, with the offsets of their members.
    pub(crate) uniforms: Vec<crate::layout::Members>,
}
