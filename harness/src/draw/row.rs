//! Decodes rows of pixels that the GPU copied into a buffer.

use crate::probe::Codec;

/// The layout of a row of pixels in a buffer into which the GPU copied a texture.
pub(super) struct Row {
    width: usize,
    codec: Codec,
    /// The number of bytes from the start of one row to the start of the next.
    pub(super) stride: u64,
}

impl Row {
    /// Makes the layout of `width` pixels in a texture's format. In a depth format, each pixel takes one 32-bit float.
    pub(super) fn new(format: wgpu::TextureFormat, width: u32) -> Self {
        let copied = match format.is_depth_stencil_format() {
            true => wgpu::TextureFormat::R32Float,
            false => format,
        };
        let codec = Codec::of(copied).expect("the format of each target has a codec");
        let bytes = width * codec.size() as u32;
        let stride = u64::from(bytes.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT));
        Self { width: width as usize, codec, stride }
    }

    /// The first integer in a row that an `f32` can't represent exactly, such as 2^24 + 1. `None` if an `f32` can
    /// represent all integers of the row.
    pub(super) fn inexact(&self, bytes: &[u8]) -> Option<i64> {
        if !self.codec.is_integer() {
            return None;
        }
        let signed = self.codec.format == wgpu::TextureFormat::R32Sint;
        let size = self.codec.size();
        let words = bytes[..self.width * size].chunks_exact(size);
        let whole = |word: u32| if signed { word.cast_signed().into() } else { i64::from(word) };
        let mut all = words.flat_map(|texel| self.codec.decode(texel)).map(whole);
        #[expect(clippy::cast_precision_loss, reason = "whether it is lossless is the question")]
        all.find(|value| f64::from(*value as f32) != *value as f64)
    }

    pub(super) fn words(&self, bytes: &[u8]) -> Vec<[u32; 4]> {
        let size = self.codec.size();
        bytes[..self.width * size]
            .chunks_exact(size)
            .map(|texel| self.codec.decode(texel))
            .collect()
    }

    pub(super) fn pixels(&self, bytes: &[u8]) -> Vec<[f32; 4]> {
        let size = self.codec.size();
        let pixels = &bytes[..self.width * size];
        match self.codec.format {
            wgpu::TextureFormat::Rgba32Float => bytemuck::pod_collect_to_vec(pixels),
            wgpu::TextureFormat::Rgba16Float => {
                let halves: Vec<[u16; 4]> = bytemuck::pod_collect_to_vec(pixels);
                halves.into_iter().map(|p| p.map(|h| half::f16::from_bits(h).to_f32())).collect()
            }
            format => {
                let signed = format == wgpu::TextureFormat::R32Sint;
                let integer = self.codec.is_integer();
                let value = |word: u32| match (integer, signed) {
                    (false, _) => f32::from_bits(word),
                    #[expect(clippy::cast_precision_loss, reason = "as its documentation has it")]
                    (true, true) => word.cast_signed() as f32,
                    #[expect(clippy::cast_precision_loss, reason = "as its documentation has it")]
                    (true, false) => word as f32,
                };
                pixels.chunks_exact(size).map(|texel| self.codec.decode(texel).map(value)).collect()
            }
        }
    }
}
