//! The languages that naga writes, and the translations into these languages.

use std::fmt;
use std::str::FromStr;

use crate::Bindings;

/// A language that naga translates to, in a version that a graphics API accepts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Target {
    /// SPIR-V 1.3, for Vulkan 1.1.
    Spirv,
    /// GLSL 4.50, for OpenGL.
    Glsl,
    /// GLSL ES 3.10, for OpenGL ES.
    GlslEs,
    /// HLSL for shader model 5.1. Microsoft's compiler FXC accepts this HLSL.
    Hlsl,
    /// HLSL for shader model 6.2, which has 16-bit floats. Microsoft's compiler DXC accepts this HLSL.
    Hlsl6,
    /// The Metal Shading Language, version 2.4.
    Msl,
    /// WGSL that naga writes.
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

    /// The file extension of a translation.
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

    /// Checks if a translation into this language has only one entry point.
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
            format!("naga doesn't write the language `{name}`: naga writes {names}")
        })
    }
}

/// A translation's source text or its SPIR-V words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Code {
    /// Source text.
    Text(String),
    /// SPIR-V.
    Words(Vec<u32>),
}

impl Code {
    /// The source text; `None` for SPIR-V.
    #[must_use]
    pub fn text(&self) -> Option<&str> {
        match self {
            Self::Text(text) => Some(text),
            Self::Words(_) => None,
        }
    }

    /// The bytes of the translation's file. SPIR-V is little-endian.
    #[must_use]
    pub fn bytes(&self) -> Vec<u8> {
        match self {
            Self::Text(text) => text.as_bytes().to_vec(),
            Self::Words(words) => words.iter().flat_map(|word| word.to_le_bytes()).collect(),
        }
    }
}

/// A translation of a shader, or of one entry point.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Translation {
    /// The language.
    pub target: Target,
    /// The source text, or the SPIR-V.
    pub code: Code,
    /// The entry points, with the names that they have in the translation.
    pub entry_points: Vec<crate::EntryPoint>,
    /// The bindings of the WGSL variables in the translation.
    pub bindings: Bindings,
    /// A description of the options that naga used, for reports.
    pub options: String,
    /// The structures in the shader's uniform buffers, with the offsets of their members in WGSL.
    pub(crate) uniforms: Vec<crate::layout::Members>,
}
