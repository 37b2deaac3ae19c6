//! What results are set to before a dispatch, so that a word that nobody writes is seen.

use crate::path::Device;

/// A quiet NaN that hardly a function returns. A result that still is this word is computed again
/// over the [`OTHER`] one: it is the function's if it is the same again, and was never written if
/// not.
pub(super) const WORD: u32 = 0x7fc0_dead;

/// What results are set to before they are computed again.
pub(super) const OTHER: u32 = 0x7fc1_beef;

/// Words that are copied at once. A small buffer stays in the caches, where one for all results
/// would be written, uploaded and read from memory.
const WORDS: usize = 16_384;

/// A buffer of poison.
pub(super) struct Poison {
    buffer: wgpu::Buffer,
}

impl Poison {
    /// Poison for `words` words of results.
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

    /// Sets the first `bytes` of the results.
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
