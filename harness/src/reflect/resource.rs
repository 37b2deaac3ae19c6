//! The kinds of resource variables, with the names that WGSL uses.

use std::fmt;

use naga::{ImageClass, ImageDimension, ScalarKind, StorageFormat};

/// The dimension of a texture: `1d`, `2d`, `3d` or `cube`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub enum Dimension {
    /// One coordinate.
    #[serde(rename = "1d")]
    D1,
    /// Two coordinates.
    #[serde(rename = "2d")]
    D2,
    /// Three coordinates.
    #[serde(rename = "3d")]
    D3,
    /// A direction.
    #[serde(rename = "cube")]
    Cube,
}

impl fmt::Display for Dimension {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::D1 => "1d",
            Self::D2 => "2d",
            Self::D3 => "3d",
            Self::Cube => "cube",
        })
    }
}

/// The type of a texture's texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Texels {
    /// `f32`
    Float,
    /// `i32`
    Sint,
    /// `u32`
    Uint,
    /// Depths, as in `texture_depth_2d`.
    Depth,
}

/// The type of a texture that shaders sample or load from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct TextureKind {
    /// The coordinates.
    pub dimension: Dimension,
    /// `true` if the texture is an array of layers.
    pub arrayed: bool,
    /// The type of texels.
    pub texels: Texels,
    /// `true` if a texel has several samples.
    pub multisampled: bool,
}

impl fmt::Display for TextureKind {
    /// `texture_depth_2d_array`, `texture_multisampled_2d<u32>`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { dimension, arrayed, texels, multisampled } = self;
        let (samples, layers) = (
            if *multisampled { "multisampled_" } else { "" },
            if *arrayed { "_array" } else { "" },
        );
        let scalar = match texels {
            Texels::Depth => return write!(f, "texture_depth_{samples}{dimension}{layers}"),
            Texels::Float => "f32",
            Texels::Sint => "i32",
            Texels::Uint => "u32",
        };
        write!(f, "texture_{samples}{dimension}{layers}<{scalar}>")
    }
}

/// The ways in which a shader may access a storage texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Access {
    /// `true` if the access is `read` or `read_write`.
    pub reads: bool,
    /// `true` if the access is `write` or `read_write`.
    pub writes: bool,
}

impl fmt::Display for Access {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match (self.reads, self.writes) {
            (true, true) => "read_write",
            (false, true) => "write",
            _ => "read",
        })
    }
}

/// The format of a storage texture's texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Format(StorageFormat);

impl Format {
    /// The type of the format's texels.
    #[must_use]
    pub fn texels(self) -> Texels {
        match naga::Scalar::from(self.0).kind {
            ScalarKind::Sint => Texels::Sint,
            ScalarKind::Uint => Texels::Uint,
            _ => Texels::Float,
        }
    }

    /// The number of the format's channels: 1, 2 or 4, or 3 for `rg11b10ufloat`.
    pub(crate) fn channels(self) -> usize {
        let name = self.name();
        match () {
            () if ["rgba", "bgra", "rgb10a2"].iter().any(|prefix| name.starts_with(prefix)) => 4,
            () if name.starts_with("rg11b10") => 3,
            () if name.starts_with("rg") => 2,
            () => 1,
        }
    }

    /// The text of a texel, with only the channels that the format has.
    pub(crate) fn shown(self, texel: [u32; 4]) -> String {
        let shown = |word: &u32| match self.texels() {
            Texels::Sint => word.cast_signed().to_string(),
            Texels::Uint => word.to_string(),
            _ => crate::value::format_f32(f32::from_bits(*word)),
        };
        let all: Vec<String> = texel.iter().take(self.channels()).map(shown).collect();
        if let [one] = &*all { one.clone() } else { format!("({})", all.join(", ")) }
    }

    /// The distance between two neighbouring numbers in a normalized format, which stores fractions as integers.
    /// Returns 0 for other formats.
    pub fn step(self) -> f32 {
        let name = self.name();
        let most = match () {
            () if name.contains("8unorm") => 255.0,
            () if name.contains("8snorm") => 127.0,
            () if name.contains("16unorm") => 65_535.0,
            () if name.contains("16snorm") => 32_767.0,
            // The two-bit alpha channel has a larger step.
            () if name.contains("10a2unorm") => 1023.0,
            () => return 0.0,
        };
        1.0 / most
    }

    /// The format's name in WGSL: `rgba8unorm`.
    #[must_use]
    pub fn name(self) -> String {
        format!("{:?}", self.0).to_lowercase()
    }
}

/// The kind of a resource variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BindingKind {
    /// `var<uniform>`
    Uniform,
    /// `var<storage>`
    Storage {
        /// `true` if the access is `read_write`.
        writable: bool,
    },
    /// `var<immediate>`: bytes that a program sets along with its commands. In Vulkan, such bytes are push constants.
    Immediate,
    /// A texture that shaders sample or load from.
    Texture(TextureKind),
    /// `texture_storage_...`
    StorageTexture {
        /// The coordinates.
        dimension: Dimension,
        /// `true` if the texture is an array of layers.
        arrayed: bool,
        /// The format of the texels.
        format: Format,
        /// The shader's access.
        access: Access,
    },
    /// `sampler`, `sampler_comparison`
    Sampler {
        /// `true` if the sampler is a comparison sampler.
        comparison: bool,
    },
    /// A resource that no fixture can supply: an array of bindings, an acceleration structure, or an external texture.
    Other,
}

impl BindingKind {
    /// `texture_cube<f32>`
    pub const TEXTURE_CUBE: Self = Self::Texture(TextureKind {
        dimension: Dimension::Cube,
        arrayed: false,
        texels: Texels::Float,
        multisampled: false,
    });

    /// Checks if a shader can write the resource.
    #[must_use]
    pub fn is_written(self) -> bool {
        match self {
            Self::Storage { writable } => writable,
            Self::StorageTexture { access, .. } => access.writes,
            _ => false,
        }
    }

    pub(super) fn of(global: &naga::GlobalVariable, inner: &naga::TypeInner) -> Self {
        use naga::{AddressSpace, TypeInner};
        match (global.space, inner) {
            (AddressSpace::Uniform, _) => Self::Uniform,
            (AddressSpace::Immediate, _) => Self::Immediate,
            (AddressSpace::Storage { access }, _) => {
                Self::Storage { writable: access.contains(naga::StorageAccess::STORE) }
            }
            (_, TypeInner::Sampler { comparison }) => Self::Sampler { comparison: *comparison },
            (_, TypeInner::Image { dim, arrayed, class }) => {
                let (dimension, arrayed) = (dimension(*dim), *arrayed);
                let texture = |texels, multisampled| {
                    Self::Texture(TextureKind { dimension, arrayed, texels, multisampled })
                };
                match class {
                    ImageClass::Sampled { kind: ScalarKind::Float, multi } => {
                        texture(Texels::Float, *multi)
                    }
                    ImageClass::Sampled { kind: ScalarKind::Sint, multi } => {
                        texture(Texels::Sint, *multi)
                    }
                    ImageClass::Sampled { kind: ScalarKind::Uint, multi } => {
                        texture(Texels::Uint, *multi)
                    }
                    ImageClass::Depth { multi } => texture(Texels::Depth, *multi),
                    ImageClass::Storage { format, access } => Self::StorageTexture {
                        dimension,
                        arrayed,
                        format: Format(*format),
                        access: Access {
                            reads: access.contains(naga::StorageAccess::LOAD),
                            writes: access.contains(naga::StorageAccess::STORE),
                        },
                    },
                    _ => Self::Other,
                }
            }
            _ => Self::Other,
        }
    }
}

fn dimension(of: ImageDimension) -> Dimension {
    match of {
        ImageDimension::D1 => Dimension::D1,
        ImageDimension::D2 => Dimension::D2,
        ImageDimension::D3 => Dimension::D3,
        ImageDimension::Cube => Dimension::Cube,
    }
}

impl fmt::Display for BindingKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Uniform => f.write_str("uniform buffer"),
            Self::Storage { .. } => f.write_str("storage buffer"),
            Self::Immediate => f.write_str("immediate"),
            Self::Texture(kind) => kind.fmt(f),
            Self::StorageTexture { dimension, arrayed, format, access } => {
                let layers = if *arrayed { "_array" } else { "" };
                write!(f, "texture_storage_{dimension}{layers}<{}, {access}>", format.name())
            }
            Self::Sampler { comparison: true } => f.write_str("sampler_comparison"),
            Self::Sampler { comparison: false } => f.write_str("sampler"),
            Self::Other => f.write_str("resource of an unsupported kind"),
        }
    }
}
