//! Copies the resources that shaders write: their original contents, and their contents after each run.

use std::sync::Arc;

use super::texels::Codec;
use super::{ProbeError, Resource, upload};
use crate::fixture::Fixture;
use crate::path::Device;
use crate::reflect::{Binding, BindingKind, Program};

/// A resource that the shader writes, with a copy of its original contents.
pub(crate) struct Kept {
    program: Arc<Program>,
    binding: Binding,
    live: Memory,
    before: Memory,
    after: wgpu::Buffer,
    staging: wgpu::Buffer,
    /// The size in bytes of one copy in `after`, which has a copy of the contents for each run.
    stride: u64,
}

enum Memory {
    Buffer(wgpu::Buffer),
    Texture(wgpu::Texture, Codec),
}

impl Memory {
    fn of(resource: &Resource) -> Option<Self> {
        Some(match resource {
            Resource::Buffer(buffer) => Self::Buffer(buffer.clone()),
            Resource::View(view) => {
                let texture = view.texture().clone();
                let codec = Codec::of(texture.format())?;
                Self::Texture(texture, codec)
            }
            Resource::Sampler(_) | Resource::Immediate(_) => return None,
        })
    }

    /// The size of a copy in bytes. Each row of texels is padded to the alignment that wgpu requires.
    fn size(&self) -> u64 {
        match self {
            Self::Buffer(buffer) => buffer.size(),
            Self::Texture(texture, codec) => {
                let rows = texture.height() * texture.depth_or_array_layers();
                row(texture, *codec) * u64::from(rows)
            }
        }
    }
}

/// The number of bytes that a row of texels takes in a buffer, including padding.
fn row(texture: &wgpu::Texture, codec: Codec) -> u64 {
    let bytes = texture.width() * codec.size() as u32;
    u64::from(bytes.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT))
}

impl Kept {
    /// Prepares a resource that the shader writes, with buffers for its contents after `runs` runs.
    pub(crate) fn new(
        device: &Device,
        program: &Arc<Program>,
        (binding, fixture): (&Binding, &Fixture),
        resource: &Resource,
        runs: usize,
    ) -> Result<Option<Self>, ProbeError> {
        if !binding.kind.is_written() {
            return Ok(None);
        }
        let again = upload(device, program, binding, fixture)?;
        let (Some(live), Some(before)) = (Memory::of(resource), Memory::of(&again)) else {
            return Ok(None);
        };
        let stride = live.size();
        let buffer = |usage| {
            device.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("written"),
                size: stride * runs as u64,
                usage,
                mapped_at_creation: false,
            })
        };
        use wgpu::BufferUsages as Usage;
        let (after, staging) = device.checked(|| {
            (buffer(Usage::COPY_SRC | Usage::COPY_DST), buffer(Usage::MAP_READ | Usage::COPY_DST))
        })?;
        let (program, binding) = (Arc::clone(program), binding.clone());
        Ok(Some(Self { program, binding, live, before, after, staging, stride }))
    }

    pub(crate) fn reset(&self, encoder: &mut wgpu::CommandEncoder) {
        match (&self.before, &self.live) {
            (Memory::Buffer(before), Memory::Buffer(live)) => {
                encoder.copy_buffer_to_buffer(before, 0, live, 0, live.size());
            }
            (Memory::Texture(before, _), Memory::Texture(live, _)) => {
                let (from, to) = (before.as_image_copy(), live.as_image_copy());
                encoder.copy_texture_to_texture(from, to, live.size());
            }
            _ => unreachable!("both values have the same kind"),
        }
    }

    /// Copies the resource's contents into the buffer `after`, at the place for run number `run`.
    pub(crate) fn keep(&self, encoder: &mut wgpu::CommandEncoder, run: usize) {
        let offset = self.stride * run as u64;
        match &self.live {
            Memory::Buffer(live) => {
                encoder.copy_buffer_to_buffer(live, 0, &self.after, offset, live.size());
            }
            Memory::Texture(live, codec) => {
                let layout = wgpu::TexelCopyBufferLayout {
                    offset,
                    bytes_per_row: u32::try_from(row(live, *codec)).ok(),
                    rows_per_image: Some(live.height()),
                };
                let to = wgpu::TexelCopyBufferInfo { buffer: &self.after, layout };
                encoder.copy_texture_to_buffer(live.as_image_copy(), to, live.size());
            }
        }
    }

    /// Copies the first `runs` copies in `after`, one for each run, into `staging`, which the host can read.
    pub(crate) fn stage(&self, encoder: &mut wgpu::CommandEncoder, runs: usize) {
        let size = self.stride * runs as u64;
        encoder.copy_buffer_to_buffer(&self.after, 0, &self.staging, 0, size);
    }

    /// The contents after each of the first `runs` runs, each as a list of scalars.
    pub(crate) fn lanes(&self, device: &Device, runs: usize) -> Result<Vec<Vec<u32>>, ProbeError> {
        let words = self.words(device, runs)?;
        let lanes = |words: &Vec<u32>| self.program.lanes_of_words(&self.binding, words);
        Ok(words.iter().map(lanes).collect())
    }

    /// The contents after each of the first `runs` runs, as 32-bit words. A texel has four words.
    pub(crate) fn words(&self, device: &Device, runs: usize) -> Result<Vec<Vec<u32>>, ProbeError> {
        let size = self.stride * runs as u64;
        let of = |bytes: &[u8]| {
            let runs = bytes.chunks_exact(self.stride as usize);
            runs.map(|bytes| self.decode(bytes)).collect::<Vec<_>>()
        };
        Ok(device.read_back(&self.staging, size, of)?)
    }

    fn decode(&self, bytes: &[u8]) -> Vec<u32> {
        match &self.live {
            Memory::Buffer(_) => bytemuck::pod_collect_to_vec(bytes),
            Memory::Texture(texture, codec) => {
                let row = row(texture, *codec) as usize;
                let width = texture.width() as usize * codec.size();
                let rows = bytes.chunks_exact(row).map(|row| &row[..width]);
                let texels = rows.flat_map(|row| row.chunks_exact(codec.size()));
                texels.flat_map(|texel| codec.decode(texel)).collect()
            }
        }
    }
}

/// The length of a resource that the shader writes, in bytes for a buffer, and in texels for a texture.
pub(crate) fn count(
    program: &Program,
    binding: &Binding,
    fixture: &Fixture,
) -> Result<usize, ProbeError> {
    if let BindingKind::StorageTexture { .. } = binding.kind {
        let view = fixture.view();
        return Ok(view.and_then(|view| Some(view.levels.first()?.words.len())).unwrap_or(0));
    }
    match fixture.bytes(program, binding) {
        Some(bytes) => Ok(bytes?.len()),
        None => Ok(0),
    }
}
