//! Fixtures on a device: textures, samplers and buffers.

use crate::fixture::{CubeMap, Fixture, FixtureError, Level, Sampler, Storage, Texture, Uniform};
use crate::path::Device;
use crate::reflect::{Binding, BindingKind, Program};

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

/// Puts a fixture on a device.
pub(crate) fn upload(
    device: &Device,
    program: &Program,
    binding: &Binding,
    fixture: &Fixture,
) -> Result<Resource, FixtureError> {
    let resource = match fixture {
        Fixture::Uniform(Uniform(values)) | Fixture::Storage(Storage(values)) => {
            buffer(device, binding, &values.bytes(program, binding)?)?
        }
        Fixture::CubeMap(CubeMap { levels, .. }) => upload_texture(device, binding, levels, 6)?,
        Fixture::Texture(Texture { levels, .. }) => upload_texture(device, binding, levels, 1)?,
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

/// A buffer that holds these bytes.
fn buffer(device: &Device, binding: &Binding, bytes: &[u8]) -> Result<Resource, FixtureError> {
    let usage = match binding.kind {
        BindingKind::Uniform => wgpu::BufferUsages::UNIFORM,
        _ => wgpu::BufferUsages::STORAGE,
    };
    Ok(device.checked(|| {
        let buffer = device.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(&binding.path),
            size: bytes.len() as u64,
            usage: usage | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        device.queue.write_buffer(&buffer, 0, bytes);
        Resource::Buffer(buffer)
    })?)
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
