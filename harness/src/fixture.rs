//! What a test supplies for the resource variables that its function reads.

mod cube_map;
mod texture;

pub use cube_map::{CubeMap, CubeMapError};
use texture::Level;
pub use texture::Texture;

use crate::diagnostic::nearest;
use crate::path::{Device, PathError};
use crate::reflect::{Binding, BindingKind, LayoutError, Program, bytes_of};
use crate::value::{Shape, Shareable};

/// How a texture is sampled. Coordinates outside [0, 1] are clamped to the edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sampler {
    /// Linear between texels and between mip levels.
    Linear,
    /// The nearest texel.
    Nearest,
}

/// A value for a `var<uniform>`, or for a `var<storage>` that holds one value.
#[derive(Clone, Debug)]
pub struct Uniform(Values);

impl Uniform {
    /// The value, laid out as the variable's type.
    pub fn new<T: Shareable>(value: T) -> Self {
        let mut lanes = Vec::new();
        value.store(&mut lanes);
        Self(Values { shape: T::shape(), lanes })
    }
}

/// Elements for a `var<storage>` array.
#[derive(Clone, Debug)]
pub struct Storage(Values);

impl Storage {
    /// The elements, laid out as the variable's type.
    pub fn new<T: Shareable>(elements: impl IntoIterator<Item = T>) -> Self {
        let mut lanes = Vec::new();
        for element in elements {
            element.store(&mut lanes);
        }
        Self(Values { shape: T::shape(), lanes })
    }
}

/// The lanes of a value, or of the elements of an array.
#[derive(Clone, Debug)]
struct Values {
    /// The type of the value or element.
    shape: Shape,
    lanes: Vec<u32>,
}

impl Values {
    /// Whether these are the values of a variable of shape `wgsl`: the type itself, or elements of
    /// that array type.
    fn fit(&self, wgsl: &Shape) -> bool {
        let element = match wgsl {
            Shape::Array { element, .. } => self.shape.stands_for(element, false),
            _ => false,
        };
        element || self.shape.stands_for(wgsl, false)
    }
}

/// What stands behind a resource variable.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Fixture {
    /// `texture_cube<f32>`
    CubeMap(CubeMap),
    /// `texture_2d<f32>`
    Texture(Texture),
    /// `sampler`
    Sampler(Sampler),
    /// `var<uniform>`
    Uniform(Uniform),
    /// `var<storage>`
    Storage(Storage),
}

impl Fixture {
    fn kind(&self) -> &'static str {
        match self {
            Self::CubeMap(_) => "a CubeMap",
            Self::Texture(_) => "a Texture",
            Self::Sampler(_) => "a Sampler",
            Self::Uniform(_) => "a Uniform",
            Self::Storage(_) => "a Storage",
        }
    }

    fn fits(&self, kind: BindingKind) -> bool {
        matches!(
            (self, kind),
            (Self::CubeMap(_), BindingKind::TextureCube)
                | (Self::Texture(_), BindingKind::Texture2d)
                | (Self::Sampler(_), BindingKind::Sampler)
                | (Self::Uniform(_), BindingKind::Uniform | BindingKind::Storage { .. })
                | (Self::Storage(_), BindingKind::Storage { .. } | BindingKind::Uniform)
        )
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

into_fixture!(CubeMap, Texture, Sampler, Uniform, Storage);

/// Why fixtures and variables don't match.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FixtureError {
    /// A variable without a fixture.
    #[error("`{variable}` ({kind}) has no fixture; add `.with(\"{variable}\", ...)`")]
    Missing {
        /// The variable.
        variable: String,
        /// What it is.
        kind: BindingKind,
    },
    /// A fixture without a variable.
    #[error("the shader reads no variable `{name}`{}",
        nearest.as_ref().map_or_else(String::new, |name| format!("; did you mean `{name}`?")))]
    Unused {
        /// What the fixture was called.
        name: String,
        /// The closest variable.
        nearest: Option<String>,
    },
    /// A fixture of another kind than its variable.
    #[error("`{variable}` is a {kind}, the fixture is {fixture}")]
    Kind {
        /// The variable.
        variable: String,
        /// What it is.
        kind: BindingKind,
        /// What was supplied.
        fixture: &'static str,
    },
    /// Values of another type than the variable.
    #[error("`{variable}` holds {wgsl}, the fixture {supplied}")]
    Type {
        /// The variable.
        variable: String,
        /// Its type, or that of its elements.
        wgsl: String,
        /// What was supplied.
        supplied: String,
    },
    /// Two variables of one draw have one binding.
    #[error(
        "`{}` and `{}` are both @group({group}) @binding({binding}), and one draw can bind only one \
         of them: give one another number",
        variables[0],
        variables[1]
    )]
    Shared {
        /// The variables.
        variables: [String; 2],
        /// `@group`
        group: u32,
        /// `@binding`
        binding: u32,
    },
    /// No value, or a texture without a texel.
    #[error("the fixture of `{variable}` is empty")]
    Empty {
        /// The variable.
        variable: String,
    },
    /// A texel that the path's format can't hold.
    #[error(
        "a texel of `{variable}` is {value}, but path `{path}` filters 16-bit floats only, which \
         end at 65504"
    )]
    Range {
        /// The variable.
        variable: String,
        /// The value.
        value: f32,
        /// The path.
        path: crate::path::Path,
    },
    /// Values that don't fill the variable's type.
    #[error("`{variable}`: {source}")]
    Layout {
        /// The variable.
        variable: String,
        /// How they differ.
        source: LayoutError,
    },
    /// The device refused.
    #[error(transparent)]
    Path(#[from] PathError),
}

/// Fixtures by the name of their variable: `environment`, or `sky::environment`.
pub(crate) type Fixtures = Vec<(String, Fixture)>;

/// A fixture on a device.
pub(crate) enum Resource {
    Buffer(wgpu::Buffer),
    View(wgpu::TextureView),
    Sampler(wgpu::Sampler),
}

impl Resource {
    pub(crate) fn binding(&self) -> wgpu::BindingResource<'_> {
        match self {
            Self::Buffer(buffer) => buffer.as_entire_binding(),
            Self::View(view) => wgpu::BindingResource::TextureView(view),
            Self::Sampler(sampler) => wgpu::BindingResource::Sampler(sampler),
        }
    }
}

fn named(binding: &Binding, name: &str) -> bool {
    binding.path == name || binding.name() == name
}

/// Refuses a fixture that no variable is called by: a misspelt name would be ignored otherwise.
pub(crate) fn check_used(bindings: &[Binding], fixtures: &Fixtures) -> Result<(), FixtureError> {
    for (name, _) in fixtures {
        if !bindings.iter().any(|binding| named(binding, name)) {
            let known = bindings.iter().map(Binding::name);
            let nearest = nearest(name, known).map(str::to_owned);
            return Err(FixtureError::Unused { name: name.clone(), nearest });
        }
    }
    Ok(())
}

/// The fixture of each variable, the last one given where there are several.
pub(crate) fn resolve<'a>(
    bindings: &'a [Binding],
    fixtures: &'a Fixtures,
) -> Result<Vec<(&'a Binding, &'a Fixture)>, FixtureError> {
    bindings
        .iter()
        .map(|binding| {
            let (variable, kind) = (binding.path.clone(), binding.kind);
            match fixtures.iter().rev().find(|(name, _)| named(binding, name)) {
                None => Err(FixtureError::Missing { variable, kind }),
                Some((_, fixture)) if !fixture.fits(kind) => {
                    Err(FixtureError::Kind { variable, kind, fixture: fixture.kind() })
                }
                Some((_, fixture)) => Ok((binding, fixture)),
            }
        })
        .collect()
}

/// Puts a fixture on a device.
pub(crate) fn upload(
    device: &Device,
    program: &Program,
    binding: &Binding,
    fixture: &Fixture,
) -> Result<Resource, FixtureError> {
    let resource = match fixture {
        Fixture::Uniform(Uniform(values)) | Fixture::Storage(Storage(values)) => {
            let variable = || binding.path.clone();
            let wgsl = program.buffer_shape(binding.ty);
            if let Some(wgsl) = wgsl.filter(|wgsl| !values.fit(wgsl)) {
                let (wgsl, supplied) = (members(&wgsl), members(&values.shape));
                return Err(FixtureError::Type { variable: variable(), wgsl, supplied });
            }
            if values.lanes.is_empty() {
                return Err(FixtureError::Empty { variable: variable() });
            }
            let bytes = bytes_of(program.module(), program.layouter(), binding.ty, &values.lanes)
                .map_err(|source| FixtureError::Layout { variable: variable(), source })?;
            let usage = match binding.kind {
                BindingKind::Uniform => wgpu::BufferUsages::UNIFORM,
                _ => wgpu::BufferUsages::STORAGE,
            };
            device.checked(|| {
                let buffer = device.device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some(&binding.path),
                    size: bytes.len() as u64,
                    usage: usage | wgpu::BufferUsages::COPY_DST,
                    mapped_at_creation: false,
                });
                device.queue.write_buffer(&buffer, 0, &bytes);
                Resource::Buffer(buffer)
            })?
        }
        Fixture::CubeMap(CubeMap { levels }) => upload_texture(device, binding, levels, 6)?,
        Fixture::Texture(Texture { levels }) => upload_texture(device, binding, levels, 1)?,
        Fixture::Sampler(sampler) => {
            let (filter, mipmap_filter) = match sampler {
                Sampler::Linear => (wgpu::FilterMode::Linear, wgpu::MipmapFilterMode::Linear),
                Sampler::Nearest => (wgpu::FilterMode::Nearest, wgpu::MipmapFilterMode::Nearest),
            };
            device.checked(|| {
                Resource::Sampler(device.device.create_sampler(&wgpu::SamplerDescriptor {
                    mag_filter: filter,
                    min_filter: filter,
                    mipmap_filter,
                    ..wgpu::SamplerDescriptor::default()
                }))
            })?
        }
    };
    Ok(resource)
}

fn upload_texture(
    device: &Device,
    binding: &Binding,
    levels: &[Level],
    layers: u32,
) -> Result<Resource, FixtureError> {
    let variable = || binding.path.clone();
    let format = device.float_format();
    let half = format == wgpu::TextureFormat::Rgba16Float;
    let overflows = |v: &&f32| v.is_finite() && !half::f16::from_f32(**v).is_finite();
    let texels = || levels.iter().flat_map(|level| level.texels.iter().flatten());
    if texels().next().is_none() {
        return Err(FixtureError::Empty { variable: variable() });
    }
    if let Some(value) = texels().find(overflows).filter(|_| half) {
        let path = device.path();
        return Err(FixtureError::Range { variable: variable(), value: *value, path });
    }
    let extent = |level: &Level| wgpu::Extent3d {
        width: level.width,
        height: level.height,
        depth_or_array_layers: layers,
    };
    let resource = device.checked(|| {
        let texture = device.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: extent(&levels[0]),
            mip_level_count: levels.len() as u32,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        for (mip_level, level) in (0..).zip(levels) {
            let bytes = if half { halves(&level.texels) } else { words(&level.texels) };
            let texel_size = if half { 8 } else { 16 };
            let layout = wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(level.width * texel_size),
                rows_per_image: Some(level.height),
            };
            let target = wgpu::TexelCopyTextureInfo { mip_level, ..texture.as_image_copy() };
            device.queue.write_texture(target, &bytes, layout, extent(level));
        }
        let dimension = (layers == 6).then_some(wgpu::TextureViewDimension::Cube);
        Resource::View(texture.create_view(&wgpu::TextureViewDescriptor {
            dimension,
            ..wgpu::TextureViewDescriptor::default()
        }))
    })?;
    Ok(resource)
}

fn words(texels: &[[f32; 4]]) -> Vec<u8> {
    bytemuck::cast_slice(texels).to_vec()
}

fn halves(texels: &[[f32; 4]]) -> Vec<u8> {
    texels.iter().flatten().flat_map(|value| half::f16::from_f32(*value).to_le_bytes()).collect()
}

/// A type with its members, where it has any.
fn members(shape: &Shape) -> String {
    match shape {
        Shape::Struct { members, .. } => {
            let members: Vec<String> =
                members.iter().map(|(name, shape)| format!("{name}: {shape}")).collect();
            format!("{{ {} }}", members.join(", "))
        }
        other => other.to_string(),
    }
}
