//! Filling results with poison on a device.

use crate::path::Device;

/// Words per copy. A small buffer stays in the caches, while one for all results would go through memory.
const WORDS: usize = 16_384;

/// A buffer of poison.
pub(super) struct Poison {
    buffer: wgpu::Buffer,
}

impl Poison {
    /// Creates poison for results of `words` words.
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

    /// Fills the first `bytes` bytes of the results.
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
