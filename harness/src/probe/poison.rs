//! Fills results with poison on a device.

use crate::path::Device;

/// The number of words in the buffer of poison, which Karat copies several times to fill the results. A buffer of this
/// size stays in the caches, but a buffer for all results would not.
const WORDS: usize = 16_384;

pub(super) struct Poison {
    buffer: wgpu::Buffer,
}

impl Poison {
    /// Makes a buffer of poison for results of `words` words.
    pub(super) fn new(device: &Device, word: u32, words: usize) -> Self {
        let poison = vec![word; words.min(WORDS)];
        let buffer = device.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("poison"),
            size: poison.len() as u64 * 4,
            usage: wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        device.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(&poison));
        Self { buffer }
    }

    pub(super) fn fill(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        results: &wgpu::Buffer,
        bytes: u64,
    ) {
        let mut at = 0;
        while at < bytes {
            let size = self.buffer.size().min(bytes - at);
            encoder.copy_buffer_to_buffer(&self.buffer, 0, results, at, size);
            at += size;
        }
    }
}
