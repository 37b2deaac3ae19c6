//! Fixtures: the textures, samplers and buffers that a test binds to resource variables.
//!
//! | variable | fixture |
//! |---|---|
//! | `texture_cube<f32>` | [`CubeMap`] |
//! | all other textures of floats, integers or depths, and storage textures | [`Texture`] |
//! | `sampler`, `sampler_comparison` | [`Sampler`] |
//! | `var<uniform>`, `var<immediate>` | [`Uniform`] for a value, or [`Buffer`] for bytes |
//! | `var<storage>` | [`Storage`] for elements, [`Uniform`] for a value, or [`Buffer`] for bytes |

pub(crate) mod buffer;
mod cube_map;
mod error;
pub(crate) mod given;
pub(crate) mod level;
mod member;
mod sampler;
mod texture;

/// The earlier name of [`Shareable`](crate::value::Shareable), the trait of texels.
pub use crate::value::Shareable as Texel;
pub use buffer::{Buffer, Storage, Uniform};
pub use cube_map::{CubeMap, CubeMapError};
pub use error::FixtureError;
pub(crate) use given::{check_used, expect_apart, resolve};
pub(crate) use level::Level;
pub(crate) use member::with_members;
pub use sampler::{Address, Compare, Filter, Sampler};
pub use texture::Texture;

use crate::diagnostic::FileRead;
use crate::reflect::{Binding, BindingKind, Dimension, Program, Texels, TextureKind};

/// A texture, sampler or buffer that a test binds to a resource variable.
///
/// ```
/// use karat::fixture::Fixture;
/// use karat::prelude::*;
///
/// // `.with("name", ...)` accepts every kind of fixture.
/// let fixtures: [Fixture; 2] = [Sampler::LINEAR.into(), Uniform::new(1.0_f32).into()];
/// assert!(matches!(fixtures[0], Fixture::Sampler(_)));
/// ```
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Fixture {
    /// A fixture for a `texture_cube<f32>`.
    CubeMap(CubeMap),
    /// A fixture for any other texture.
    Texture(Texture),
    /// A fixture for a `sampler` or a `sampler_comparison`.
    Sampler(Sampler),
    /// A buffer with one value.
    Uniform(Uniform),
    /// A buffer with the elements of an array.
    Storage(Storage),
    /// A buffer that is given as bytes.
    Buffer(Buffer),
}

pub(crate) struct View<'f> {
    pub(crate) dimension: Dimension,
    pub(crate) arrayed: bool,
    pub(crate) texels: Texels,
    pub(crate) samples: u32,
    /// The number of layers. Each face of a cube counts as a layer.
    pub(crate) layers: u32,
    pub(crate) levels: &'f [Level],
}

impl Fixture {
    /// Describes the fixture's kind for messages, such as ``a Texture for `texture_2d<u32>` ``.
    fn kind(&self) -> String {
        let words = match self {
            Self::CubeMap(_) => "a CubeMap",
            Self::Sampler(Sampler { compare: Some(_), .. }) => "a Sampler with a comparison",
            Self::Sampler(_) => "a Sampler without a comparison",
            Self::Uniform(_) => "a Uniform",
            Self::Storage(_) => "a Storage",
            Self::Buffer(_) => "a Buffer",
            Self::Texture(Texture { dimension, arrayed, texels, samples, .. }) => {
                let (dimension, arrayed, texels) = (*dimension, *arrayed, *texels);
                let kind = TextureKind { dimension, arrayed, texels, multisampled: *samples > 1 };
                return format!("a Texture for `{kind}`");
            }
        };
        words.to_owned()
    }

    pub(crate) fn read(&self) -> &[FileRead] {
        match self {
            Self::CubeMap(CubeMap { read, .. }) | Self::Texture(Texture { read, .. }) => read,
            Self::Sampler(_) | Self::Uniform(_) | Self::Storage(_) | Self::Buffer(_) => &[],
        }
    }

    /// The fixture's texels, if the fixture is a texture.
    pub(crate) fn view(&self) -> Option<View<'_>> {
        match self {
            Self::CubeMap(CubeMap { levels, .. }) => Some(View {
                dimension: Dimension::Cube,
                arrayed: false,
                texels: Texels::Float,
                samples: 1,
                layers: 6,
                levels,
            }),
            Self::Texture(texture) => Some(View {
                dimension: texture.dimension,
                arrayed: texture.arrayed,
                texels: texture.texels,
                samples: texture.samples,
                layers: texture.layers(),
                levels: &texture.levels,
            }),
            _ => None,
        }
    }

    /// Converts the fixture to a `Texture`, if the fixture has texels.
    pub(crate) fn to_texture(&self) -> Option<Texture> {
        let View { dimension, arrayed, texels, samples, levels, .. } = self.view()?;
        let (levels, read) = (levels.to_vec(), Vec::new());
        Some(Texture { dimension, arrayed, texels, samples, levels, read })
    }

    pub(crate) fn expect(&self, binding: &Binding) -> Result<(), FixtureError> {
        let (variable, kind) = (binding.path.clone(), binding.kind);
        match self.mistake(binding) {
            _ if !self.fits(kind) => {
                Err(FixtureError::Kind { variable, kind, fixture: self.kind() })
            }
            Some(mistake) => Err(mistake),
            None => Ok(()),
        }
    }

    fn fits(&self, kind: BindingKind) -> bool {
        match (self, kind) {
            (_, BindingKind::Texture(kind)) => self.view().is_some_and(|view| {
                let depth = kind.texels == Texels::Depth && view.texels == Texels::Float;
                view.dimension == kind.dimension
                    && view.arrayed == kind.arrayed
                    && (view.texels == kind.texels || depth)
                    && (view.samples > 1) == kind.multisampled
            }),
            (_, BindingKind::StorageTexture { dimension, arrayed, format, .. }) => {
                self.view().is_some_and(|view| {
                    view.dimension == dimension
                        && view.arrayed == arrayed
                        && view.texels == format.texels()
                        && view.samples == 1
                })
            }
            (Self::Sampler(sampler), BindingKind::Sampler { comparison }) => {
                sampler.compare.is_some() == comparison
            }
            (
                Self::Uniform(_) | Self::Storage(_) | Self::Buffer(_),
                BindingKind::Uniform | BindingKind::Storage { .. } | BindingKind::Immediate,
            ) => true,
            _ => false,
        }
    }

    /// The bytes of a buffer in the layout of its variable. `None` if the fixture isn't a buffer.
    pub(crate) fn bytes(
        &self,
        program: &Program,
        binding: &Binding,
    ) -> Option<Result<Vec<u8>, FixtureError>> {
        let bytes = match self {
            Self::Uniform(Uniform(values)) | Self::Storage(Storage(values)) => {
                values.bytes(program, binding)
            }
            Self::Buffer(buffer) => {
                let (bytes, needed) = (buffer.bound(), program.least_bytes(binding));
                match bytes.len() {
                    found if found < needed => {
                        let variable = binding.path.clone();
                        Err(FixtureError::Short { variable, found, needed })
                    }
                    // Devices bind storage buffers in multiples of 4 bytes, and uniform buffers in multiples of
                    // 16 bytes.
                    length => {
                        let mut bytes = bytes.to_vec();
                        let storage = matches!(binding.kind, BindingKind::Storage { .. });
                        bytes.resize(length.next_multiple_of(if storage { 4 } else { 16 }), 0);
                        Ok(bytes)
                    }
                }
            }
            _ => return None,
        };
        // Immediates must have exactly the size of their variable, because devices accept no padding after
        // them.
        let exact = |mut bytes: Vec<u8>| {
            if binding.kind == BindingKind::Immediate {
                bytes.truncate(program.least_bytes(binding).next_multiple_of(4));
            }
            bytes
        };
        Some(bytes.map(exact).map_err(|error| error.at(binding)))
    }

    /// Returns an error if no device accepts the fixture.
    fn mistake(&self, binding: &Binding) -> Option<FixtureError> {
        let variable = || binding.path.clone();
        if let Self::Sampler(sampler) = self {
            let reason = sampler.mistake()?;
            return Some(FixtureError::Unusable { variable: variable(), reason });
        }
        let view = self.view()?;
        let empty = view.levels.iter().any(|level| level.words.is_empty());
        (empty || view.levels.is_empty()).then(|| FixtureError::Empty { variable: variable() })
    }
}

macro_rules! into_fixture {
    ($($name:ident),*) => {$(
        impl From<$name> for Fixture {
            fn from(fixture: $name) -> Self {
                Self::$name(fixture)
            }
        }
    )*};
}

into_fixture!(CubeMap, Texture, Sampler, Uniform, Storage, Buffer);

/// Fixtures, each with the name of its variable: `environment`, or `sky::environment`.
pub type Fixtures = Vec<(String, Fixture)>;
