//! Rows of pixels, as a device has them.

use half::f16;

/// Channels of a pixel: RGBA.
const CHANNELS: u32 = 4;

/// A row of pixels in a buffer that a texture is copied to.
pub(super) struct Row {
    width: usize,
    half: bool,
    /// Bytes from one row to the next.
    pub(super) stride: u64,
}

impl Row {
    pub(super) fn new(format: wgpu::TextureFormat, width: u32) -> Self {
        let half = format == wgpu::TextureFormat::Rgba16Float;
        let bytes = width * CHANNELS * if half { 2 } else { 4 };
        let stride = u64::from(bytes.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT));
        Self { width: width as usize, half, stride }
    }

    pub(super) fn pixels(&self, bytes: &[u8]) -> Vec<[f32; 4]> {
        if self.half {
            let pixels = &bytes[..self.width * 8];
            let halves: Vec<[u16; 4]> = bytemuck::pod_collect_to_vec(pixels);
            halves.into_iter().map(|p| p.map(|bits| f16::from_bits(bits).to_f32())).collect()
        } else {
            bytemuck::pod_collect_to_vec(&bytes[..self.width * 16])
        }
    }
}
