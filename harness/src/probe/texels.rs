//! Encodes and decodes the texels of texture formats.

use half::f16;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Number {
    Float,
    Unorm,
    /// Red, green and blue are stored with sRGB's transfer function, and alpha is stored as a linear number.
    Srgb,
    Snorm,
    Uint,
    Sint,
}

/// A format whose texels Karat can write and read. Channels of 8, 16 or 32 bits are stored one after another. Channels
/// of other widths are packed into a 32-bit word.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Codec {
    pub(crate) format: wgpu::TextureFormat,
    number: Number,
    /// The number of bits of each channel, in memory order.
    bits: &'static [u8],
    swapped: bool,
}

const fn codec(format: wgpu::TextureFormat, number: Number, bits: &'static [u8]) -> Codec {
    Codec { format, number, bits, swapped: false }
}

const fn swapped(codec: Codec) -> Codec {
    Codec { swapped: true, ..codec }
}

use Number::{Float, Sint, Snorm, Srgb, Uint, Unorm};
use wgpu::TextureFormat as F;

/// The formats of storage textures and of frames' targets.
const CODECS: [Codec; 41] = [
    codec(F::R8Unorm, Unorm, &[8]),
    codec(F::R8Snorm, Snorm, &[8]),
    codec(F::R8Uint, Uint, &[8]),
    codec(F::R8Sint, Sint, &[8]),
    codec(F::Rg8Unorm, Unorm, &[8, 8]),
    codec(F::Rg8Snorm, Snorm, &[8, 8]),
    codec(F::Rg8Uint, Uint, &[8, 8]),
    codec(F::Rg8Sint, Sint, &[8, 8]),
    codec(F::Rgba8Unorm, Unorm, &[8; 4]),
    codec(F::Rgba8UnormSrgb, Srgb, &[8; 4]),
    codec(F::Rgba8Snorm, Snorm, &[8; 4]),
    codec(F::Rgba8Uint, Uint, &[8; 4]),
    codec(F::Rgba8Sint, Sint, &[8; 4]),
    swapped(codec(F::Bgra8Unorm, Unorm, &[8; 4])),
    swapped(codec(F::Bgra8UnormSrgb, Srgb, &[8; 4])),
    codec(F::R16Unorm, Unorm, &[16]),
    codec(F::R16Snorm, Snorm, &[16]),
    codec(F::R16Uint, Uint, &[16]),
    codec(F::R16Sint, Sint, &[16]),
    codec(F::R16Float, Float, &[16]),
    codec(F::Rg16Unorm, Unorm, &[16, 16]),
    codec(F::Rg16Snorm, Snorm, &[16, 16]),
    codec(F::Rg16Uint, Uint, &[16, 16]),
    codec(F::Rg16Sint, Sint, &[16, 16]),
    codec(F::Rg16Float, Float, &[16, 16]),
    codec(F::Rgba16Unorm, Unorm, &[16; 4]),
    codec(F::Rgba16Snorm, Snorm, &[16; 4]),
    codec(F::Rgba16Uint, Uint, &[16; 4]),
    codec(F::Rgba16Sint, Sint, &[16; 4]),
    codec(F::Rgba16Float, Float, &[16; 4]),
    codec(F::R32Uint, Uint, &[32]),
    codec(F::R32Sint, Sint, &[32]),
    codec(F::R32Float, Float, &[32]),
    codec(F::Rg32Uint, Uint, &[32, 32]),
    codec(F::Rg32Sint, Sint, &[32, 32]),
    codec(F::Rg32Float, Float, &[32, 32]),
    codec(F::Rgba32Uint, Uint, &[32; 4]),
    codec(F::Rgba32Sint, Sint, &[32; 4]),
    codec(F::Rgba32Float, Float, &[32; 4]),
    codec(F::Rgb10a2Unorm, Unorm, &[10, 10, 10, 2]),
    codec(F::Rg11b10Ufloat, Float, &[11, 11, 10]),
];

impl Codec {
    pub(crate) fn of(format: wgpu::TextureFormat) -> Option<Self> {
        CODECS.into_iter().find(|codec| codec.format == format)
    }

    /// The codec of a storage format, by the format's name in WGSL and WebGPU.
    pub(crate) fn named(name: &str) -> Option<Self> {
        CODECS.into_iter().find(|codec| format!("{:?}", codec.format).to_lowercase() == name)
    }

    pub(crate) fn size(self) -> usize {
        self.bits.iter().map(|bits| usize::from(*bits)).sum::<usize>() / 8
    }

    pub(crate) fn channels(self) -> usize {
        self.bits.len()
    }

    /// Checks if the channels are integers. Integers aren't colours.
    pub(crate) fn is_integer(self) -> bool {
        matches!(self.number, Uint | Sint)
    }

    /// Appends a texel. `words` has the bits of four scalars.
    pub(crate) fn encode(self, mut words: [u32; 4], bytes: &mut Vec<u8>) {
        if self.swapped {
            words.swap(0, 2);
        }
        let mut packed = 0_u32;
        let mut at = 0;
        for (channel, (&bits, word)) in self.bits.iter().zip(words).enumerate() {
            let value = f32::from_bits(word);
            let most = f64::from(u32::MAX >> (32 - bits));
            let scaled = |value: f64, scale: f64| (value * scale).round_ties_even();
            let code = match (self.number, bits) {
                (Float, 32) => word,
                (Float, 16) => u32::from(f16::from_f32(value).to_bits()),
                (Float, bits) => small_float(value, bits),
                (Unorm, _) => scaled(f64::from(value).clamp(0.0, 1.0), most) as u32,
                (Srgb, _) => {
                    let value = f64::from(value).clamp(0.0, 1.0);
                    scaled(if channel == 3 { value } else { from_linear(value) }, most) as u32
                }
                (Snorm, _) => {
                    let scale = f64::from(i32::MAX >> (32 - bits));
                    (scaled(f64::from(value).clamp(-1.0, 1.0), scale) as i32).cast_unsigned()
                }
                (Uint, _) => word.min(u32::MAX >> (32 - bits)),
                (Sint, _) => {
                    let most = i32::MAX >> (32 - bits);
                    word.cast_signed().clamp(-most - 1, most).cast_unsigned()
                }
            };
            match bits {
                8 => bytes.push(code as u8),
                16 => bytes.extend((code as u16).to_le_bytes()),
                32 => bytes.extend(code.to_le_bytes()),
                _ => {
                    packed |= code << at;
                    at += bits;
                    if at == 32 {
                        bytes.extend(packed.to_le_bytes());
                    }
                }
            }
        }
    }

    /// The bits of the four scalars that a shader reads from a texel. A colour channel that the format lacks is 0, and
    /// a missing alpha is 1.
    pub(crate) fn decode(self, bytes: &[u8]) -> [u32; 4] {
        let one = if self.is_integer() { 1 } else { 1_f32.to_bits() };
        let mut words = [0, 0, 0, one];
        let mut at = 0;
        for (channel, &bits) in self.bits.iter().enumerate() {
            let mut code = 0_u32;
            // Reads bit by bit if channels aren't whole bytes. Such formats are rare.
            for bit in 0..u32::from(bits) {
                let place = at + bit as usize;
                code |= u32::from(bytes[place / 8] >> (place % 8) & 1) << bit;
            }
            at += usize::from(bits);
            let shift = 32 - bits;
            let signed = (code << shift).cast_signed() >> shift;
            let most = f64::from(u32::MAX >> shift);
            words[channel] = match (self.number, bits) {
                (Float, 32) => code,
                (Float, 16) => f16::from_bits(code as u16).to_f32().to_bits(),
                (Float, bits) => of_small_float(code, bits).to_bits(),
                (Unorm, _) => ((f64::from(code) / most) as f32).to_bits(),
                (Srgb, _) => {
                    let value = f64::from(code) / most;
                    let value = if channel == 3 { value } else { to_linear(value) };
                    (value as f32).to_bits()
                }
                (Snorm, _) => {
                    let scale = f64::from(i32::MAX >> shift);
                    ((f64::from(signed) / scale).max(-1.0) as f32).to_bits()
                }
                (Uint, _) => code,
                (Sint, _) => signed.cast_unsigned(),
            };
        }
        if self.swapped {
            words.swap(0, 2);
        }
        words
    }
}

/// The bits of an unsigned float with five bits of exponent: the upper bits of a half float, rounded to nearest.
fn small_float(value: f32, bits: u8) -> u32 {
    let drop = 15 - u32::from(bits);
    let half = u32::from(f16::from_f32(value.max(0.0)).to_bits());
    if value.is_nan() { (half >> drop) | 1 } else { (half + (1 << (drop - 1))) >> drop }
}

fn of_small_float(code: u32, bits: u8) -> f32 {
    f16::from_bits((code << (15 - bits)) as u16).to_f32()
}

/// Decodes sRGB according to IEC 61966-2-1.
fn to_linear(value: f64) -> f64 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

fn from_linear(value: f64) -> f64 {
    if value <= 0.003_130_8 { value * 12.92 } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn again(format: wgpu::TextureFormat, words: [u32; 4]) -> [u32; 4] {
        let codec = Codec::of(format).expect("it is known");
        let mut bytes = Vec::new();
        codec.encode(words, &mut bytes);
        assert_eq!(bytes.len(), codec.size());
        codec.decode(&bytes)
    }

    fn floats(format: wgpu::TextureFormat, texel: [f32; 4]) -> [f32; 4] {
        again(format, texel.map(f32::to_bits)).map(f32::from_bits)
    }

    #[test]
    fn texels_are_rounded_to_their_format() {
        let texel = [0.5, 2.0, -1.0, 0.25];
        assert_eq!(floats(F::Rgba32Float, texel), texel);
        assert_eq!(floats(F::Rg16Float, texel), [0.5, 2.0, 0.0, 1.0]);
        assert_eq!(floats(F::Rgba8Unorm, texel), [128.0 / 255.0, 1.0, 0.0, 64.0 / 255.0]);
        assert_eq!(floats(F::Bgra8Unorm, texel), floats(F::Rgba8Unorm, texel));
        assert_eq!(floats(F::Rgba8Snorm, texel), [64.0 / 127.0, 1.0, -1.0, 32.0 / 127.0]);
        assert_eq!(floats(F::Rg11b10Ufloat, texel), [0.5, 2.0, 0.0, 1.0]);
        assert_eq!(floats(F::Rgb10a2Unorm, [1.0, 0.0, 1.0, 1.0]), [1.0, 0.0, 1.0, 1.0]);
        assert_eq!(
            again(F::Rgba8Sint, [1, 200, (-200_i32).cast_unsigned(), 7]),
            [1, 127, (-128_i32).cast_unsigned(), 7]
        );
    }

    /// sRGB isn't linear: 188 of 255 is about half of the light.
    #[test]
    fn srgb_is_decoded_to_linear() {
        let codec = Codec::of(F::Rgba8UnormSrgb).expect("it is known");
        let half = f32::from_bits(codec.decode(&[188, 0, 255, 128])[0]);
        assert!((half - 0.5).abs() < 0.005, "{half}");
        let mut bytes = Vec::new();
        codec.encode([0.5_f32, 0.0, 1.0, 0.5].map(f32::to_bits), &mut bytes);
        assert_eq!(bytes, [188, 0, 255, 128]);
    }
}
