//! Uploads fixtures to a device: textures, samplers and buffers.

use super::painted::{self, Layer};
use super::texels::Codec;
use crate::fixture::{
    Address, Compare, Filter, Fixture, FixtureError, Level, Sampler, View as Given,
};
use crate::path::{Api, Device};
use crate::reflect::{Binding, BindingKind, Dimension, Program, Texels};

pub(crate) enum Resource {
    Buffer(wgpu::Buffer),
    View(wgpu::TextureView),
    Sampler(wgpu::Sampler),
    /// The bytes of immediates, which Karat sets in the commands of each run.
    Immediate(Vec<u8>),
}

impl Resource {
    /// The resource for a bind group. `None` for immediates, which aren't bound.
    pub(crate) fn binding(&self) -> Option<wgpu::BindingResource<'_>> {
        Some(match self {
            Self::Buffer(buffer) => buffer.as_entire_binding(),
            Self::View(view) => wgpu::BindingResource::TextureView(view),
            Self::Sampler(sampler) => wgpu::BindingResource::Sampler(sampler),
            Self::Immediate(_) => return None,
        })
    }
}

/// Uploads a fixture to a device. The fixture must fit the kind of the variable.
pub(crate) fn upload(
    device: &Device,
    program: &Program,
    binding: &Binding,
    fixture: &Fixture,
) -> Result<Resource, FixtureError> {
    upload_shared(device, program, &[binding], fixture)
}

/// Uploads a fixture that several variables share. `program` declares the variable of the first binding. The fixture
/// must fit the kind of each variable.
pub(crate) fn upload_shared(
    device: &Device,
    program: &Program,
    bindings: &[&Binding],
    fixture: &Fixture,
) -> Result<Resource, FixtureError> {
    let first = bindings.first().expect("each fixture has a variable");
    if device.path().api() == Api::Gl
        && first.kind == BindingKind::Uniform
        && program.has_narrow_matrix(first)
    {
        // wgpu uploads the buffer in WGSL's layout for GL, but naga declares the block as std140.
        let reason = "GLSL's layout of matrices with two rows differs from WGSL's, and wgpu ignores the \
                      difference: use a storage buffer, or vectors instead of the matrix";
        let (variable, path) = (first.path.clone(), device.path());
        return Err(FixtureError::Unsupported { variable, reason, path });
    }
    if let Some(bytes) = fixture.bytes(program, first) {
        let bytes = bytes?;
        return match first.kind {
            BindingKind::Immediate => Ok(Resource::Immediate(bytes)),
            _ => buffer(device, bindings, &bytes),
        };
    }
    match (fixture, fixture.view()) {
        (_, Some(view)) => texture(device, bindings, &view),
        (Fixture::Sampler(sampler), _) => sample(device, sampler),
        _ => unreachable!("a fixture is bytes, texels or a sampler"),
    }
}

fn buffer(device: &Device, bindings: &[&Binding], bytes: &[u8]) -> Result<Resource, FixtureError> {
    use wgpu::BufferUsages as Usage;
    let usage = |binding: &&Binding| match binding.kind {
        BindingKind::Uniform => Usage::UNIFORM,
        _ => Usage::STORAGE | Usage::COPY_SRC,
    };
    let usage = bindings.iter().map(usage).fold(Usage::COPY_DST, |all, usage| all | usage);
    Ok(device.checked(|| {
        let buffer = device.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(&bindings[0].path),
            size: bytes.len() as u64,
            usage,
            mapped_at_creation: false,
        });
        device.queue.write_buffer(&buffer, 0, bytes);
        Resource::Buffer(buffer)
    })?)
}

pub(crate) fn compare(compare: Compare) -> wgpu::CompareFunction {
    match compare {
        Compare::Never => wgpu::CompareFunction::Never,
        Compare::Less => wgpu::CompareFunction::Less,
        Compare::Equal => wgpu::CompareFunction::Equal,
        Compare::LessEqual => wgpu::CompareFunction::LessEqual,
        Compare::Greater => wgpu::CompareFunction::Greater,
        Compare::NotEqual => wgpu::CompareFunction::NotEqual,
        Compare::GreaterEqual => wgpu::CompareFunction::GreaterEqual,
        Compare::Always => wgpu::CompareFunction::Always,
    }
}

fn sample(device: &Device, sampler: &Sampler) -> Result<Resource, FixtureError> {
    let address = |address| match address {
        Address::Clamp => wgpu::AddressMode::ClampToEdge,
        Address::Repeat => wgpu::AddressMode::Repeat,
        Address::Mirror => wgpu::AddressMode::MirrorRepeat,
    };
    let filter = |filter| match filter {
        Filter::Nearest => wgpu::FilterMode::Nearest,
        Filter::Linear => wgpu::FilterMode::Linear,
    };
    let [u, v, w] = sampler.address.map(address);
    Ok(device.checked(|| {
        Resource::Sampler(device.device.create_sampler(&wgpu::SamplerDescriptor {
            label: None,
            address_mode_u: u,
            address_mode_v: v,
            address_mode_w: w,
            mag_filter: filter(sampler.mag),
            min_filter: filter(sampler.min),
            mipmap_filter: match sampler.mip {
                Filter::Nearest => wgpu::MipmapFilterMode::Nearest,
                Filter::Linear => wgpu::MipmapFilterMode::Linear,
            },
            lod_min_clamp: sampler.lod.0,
            lod_max_clamp: sampler.lod.1,
            compare: sampler.compare.map(compare),
            anisotropy_clamp: sampler.anisotropy,
            border_color: None,
        }))
    })?)
}

fn texture(
    device: &Device,
    bindings: &[&Binding],
    given: &Given<'_>,
) -> Result<Resource, FixtureError> {
    // A storage texture declares its format. A sampled texture that shares the fixture gets this format, too.
    let is_storage =
        |binding: &&&Binding| matches!(binding.kind, BindingKind::StorageTexture { .. });
    let binding = *bindings.iter().find(is_storage).unwrap_or(&bindings[0]);
    let sampled = bindings.iter().any(|binding| !is_storage(&binding));
    if let Some(reason) = unsupported(device, binding, given) {
        let (variable, path) = (binding.path.clone(), device.path());
        return Err(FixtureError::Unsupported { variable, reason, path });
    }
    let (format, usage) = match binding.kind {
        BindingKind::StorageTexture { format, .. } => {
            let name = format.name();
            let codec = Codec::named(&name).ok_or_else(|| {
                unusable(binding, format!("Karat can't write texels of the format {name}"))
            })?;
            (codec.format, wgpu::TextureUsages::STORAGE_BINDING)
        }
        BindingKind::Texture(kind) => {
            let format = match kind.texels {
                Texels::Depth => wgpu::TextureFormat::Depth32Float,
                Texels::Float if kind.multisampled => device.multisampled_format(),
                // A texture that no sampler filters has full precision on each path.
                Texels::Float if !bindings.iter().any(|binding| binding.sampled) => {
                    wgpu::TextureFormat::Rgba32Float
                }
                Texels::Float => device.float_format(),
                Texels::Sint if kind.multisampled => wgpu::TextureFormat::Rgba16Sint,
                Texels::Sint => wgpu::TextureFormat::Rgba32Sint,
                Texels::Uint if kind.multisampled => wgpu::TextureFormat::Rgba16Uint,
                Texels::Uint => wgpu::TextureFormat::Rgba32Uint,
            };
            (format, wgpu::TextureUsages::TEXTURE_BINDING)
        }
        _ => unreachable!("a variable that takes texels is a texture"),
    };
    let drawn = format.is_depth_stencil_format() || given.samples > 1;
    let codec = Codec::of(format);
    expect_kept(device, binding, given, format, codec)?;
    let usage = match sampled {
        true => usage | wgpu::TextureUsages::TEXTURE_BINDING,
        false => usage,
    };
    let fill = if drawn {
        wgpu::TextureUsages::RENDER_ATTACHMENT
    } else {
        wgpu::TextureUsages::COPY_DST | wgpu::TextureUsages::COPY_SRC
    };
    let first = &given.levels[0];
    let size = wgpu::Extent3d {
        width: first.width,
        height: first.height,
        depth_or_array_layers: first.depth * given.layers,
    };
    let texture = device.checked(|| {
        device.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(&binding.path),
            size,
            mip_level_count: given.levels.len() as u32,
            sample_count: given.samples,
            dimension: match given.dimension {
                Dimension::D1 => wgpu::TextureDimension::D1,
                Dimension::D2 | Dimension::Cube => wgpu::TextureDimension::D2,
                Dimension::D3 => wgpu::TextureDimension::D3,
            },
            format,
            usage: usage | fill,
            view_formats: &[],
        })
    })?;
    for (index, level) in (0..).zip(given.levels) {
        match codec.filter(|_| !drawn) {
            Some(codec) => write(device, &texture, index, level, given.layers, codec)?,
            None => {
                let texels = level.words.len() / given.layers as usize;
                for (layer, words) in (0..).zip(level.words.chunks_exact(texels)) {
                    let width = level.width;
                    painted::paint(
                        device,
                        &Layer { texture: &texture, level: index, layer, width, words },
                    )?;
                }
            }
        }
    }
    Ok(device.checked(|| {
        Resource::View(texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(match (given.dimension, given.arrayed) {
                (Dimension::D1, _) => wgpu::TextureViewDimension::D1,
                (Dimension::D2, false) => wgpu::TextureViewDimension::D2,
                (Dimension::D2, true) => wgpu::TextureViewDimension::D2Array,
                (Dimension::D3, _) => wgpu::TextureViewDimension::D3,
                (Dimension::Cube, false) => wgpu::TextureViewDimension::Cube,
                (Dimension::Cube, true) => wgpu::TextureViewDimension::CubeArray,
            }),
            ..wgpu::TextureViewDescriptor::default()
        }))
    })?)
}

fn unusable(binding: &Binding, reason: String) -> FixtureError {
    FixtureError::Unusable { variable: binding.path.clone(), reason }
}

/// Returns the reason why wgpu's GL can't bind a texture. Without this check, GL would silently bind another kind of
/// texture (`Texture::get_info_from_desc` of wgpu-hal 30).
fn unsupported(device: &Device, binding: &Binding, given: &Given<'_>) -> Option<&'static str> {
    if device.path().api() != Api::Gl {
        return None;
    }
    let square = given.levels.first().is_some_and(|level| level.width == level.height);
    let plain_array = given.dimension == Dimension::D2 && given.arrayed;
    let storage = matches!(binding.kind, BindingKind::StorageTexture { .. });
    if storage && (given.dimension == Dimension::D3 || given.arrayed) {
        Some("wgpu's GL binds only the first slice of a storage texture")
    } else if given.samples > 1 {
        Some("on wgpu's GL, shaders can't read multisampled textures")
    } else if given.dimension == Dimension::D1 {
        Some("wgpu's GL turns a 1D texture into a 2D texture")
    } else if plain_array && given.layers == 1 {
        Some("wgpu's GL turns an array of one layer into a texture without layers")
    } else if plain_array && square && given.layers.is_multiple_of(6) {
        Some(
            "wgpu's GL turns an array into a cube map if the layers are square and their number is a multiple of six",
        )
    } else if given.dimension == Dimension::Cube && given.arrayed && given.layers == 6 {
        Some("wgpu's GL turns an array of one cube map into a single cube map")
    } else {
        None
    }
}

/// Returns an error if a texel of the fixture is out of range for the texture's format. Rounding is allowed.
fn expect_kept(
    device: &Device,
    binding: &Binding,
    given: &Given<'_>,
    format: wgpu::TextureFormat,
    codec: Option<Codec>,
) -> Result<(), FixtureError> {
    let words = || given.levels.iter().flat_map(|level| level.words.iter().flatten().copied());
    let storage = matches!(binding.kind, BindingKind::StorageTexture { .. });
    if format == wgpu::TextureFormat::Rgba16Float && !storage {
        let overflows = |v: &f32| v.is_finite() && !half::f16::from_f32(*v).is_finite();
        if let Some(value) = words().map(f32::from_bits).find(overflows) {
            let (path, variable) = (device.path(), binding.path.clone());
            return Err(FixtureError::Range { variable, value, path });
        }
    }
    if format.is_depth_stencil_format() {
        let depths = given.levels.iter().flat_map(|level| level.words.iter());
        let wrong = |depth: &f32| !(0.0..=1.0).contains(depth);
        if let Some(depth) = depths.map(|words| f32::from_bits(words[0])).find(wrong) {
            let reason = format!("a texel has the depth {depth}, but depths must be from 0 to 1");
            return Err(unusable(binding, reason));
        }
    }
    let Some(codec) = codec.filter(|codec| codec.is_integer()) else { return Ok(()) };
    let mut bytes = Vec::new();
    for texel in given.levels.iter().flat_map(|level| &level.words) {
        bytes.clear();
        codec.encode(*texel, &mut bytes);
        let kept = codec.decode(&bytes);
        let changed = texel.iter().zip(kept).position(|(given, kept)| *given != kept);
        // A format with fewer than four channels drops the other channels of a texel, which isn't an error.
        if let Some(channel) = changed.filter(|channel| *channel < codec.channels()) {
            let value = texel[channel];
            let reason =
                format!("a texel has the value {value}, which the format {format:?} can't store");
            return Err(unusable(binding, reason));
        }
    }
    Ok(())
}

fn write(
    device: &Device,
    texture: &wgpu::Texture,
    mip_level: u32,
    level: &Level,
    layers: u32,
    codec: Codec,
) -> Result<(), FixtureError> {
    let mut bytes = Vec::with_capacity(level.words.len() * codec.size());
    match texture.format() {
        wgpu::TextureFormat::Rgba32Float
        | wgpu::TextureFormat::Rgba32Uint
        | wgpu::TextureFormat::Rgba32Sint => {
            bytes.extend_from_slice(bytemuck::cast_slice(&level.words));
        }
        _ => level.words.iter().for_each(|words| codec.encode(*words, &mut bytes)),
    }
    let size = wgpu::Extent3d {
        width: level.width,
        height: level.height,
        depth_or_array_layers: level.depth * layers,
    };
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(level.width * codec.size() as u32),
        rows_per_image: Some(level.height),
    };
    let target = wgpu::TexelCopyTextureInfo { mip_level, ..texture.as_image_copy() };
    Ok(device.checked(|| device.queue.write_texture(target, &bytes, layout, size))?)
}
