//! The rounding of texels by storage formats.

use naga::StorageFormat as F;

/// Rounds a texel to a format: returns the words that a read of this texel returns after the texel was written.
/// Channels that the format doesn't have are read as 0, 0, 0, 1. `None` for unknown formats.
pub(crate) fn stored(format: F, texel: [u32; 4]) -> Option<[u32; 4]> {
    let float = |word: u32| f64::from(f32::from_bits(word));
    // NaN has no normalised value, so it becomes 0.
    let unorm = |word: u32, scale: f64| {
        (((float(word).clamp(0.0, 1.0) * scale).round_ties_even() / scale) as f32).to_bits()
    };
    let snorm = |word: u32, scale: f64| {
        (((float(word).clamp(-1.0, 1.0) * scale).round_ties_even() / scale) as f32).to_bits()
    };
    let number = |word: u32| if f32::from_bits(word).is_nan() { 0 } else { word };
    let half = |word: u32| half::f16::from_f32(f32::from_bits(word)).to_f32().to_bits();
    // Integers outside of the format's range are clamped, as in Vulkan and Metal.
    let uint = |word: u32, most: u32| word.min(most);
    let sint = |word: u32, most: i32| word.cast_signed().clamp(-most - 1, most).cast_unsigned();
    let one = 1f32.to_bits();
    let [x, y, ..] = texel;
    Some(match format {
        F::R32Float => [x, 0, 0, one],
        F::Rg32Float => [x, y, 0, one],
        F::R32Uint | F::R32Sint => [x, 0, 0, 1],
        F::Rg32Uint | F::Rg32Sint => [x, y, 0, 1],
        F::Rgba32Float | F::Rgba32Uint | F::Rgba32Sint => texel,
        F::R16Float => [half(x), 0, 0, one],
        F::Rg16Float => [half(x), half(y), 0, one],
        F::Rgba16Float => texel.map(half),
        F::Rgba8Unorm | F::Bgra8Unorm => texel.map(|word| unorm(number(word), 255.0)),
        F::Rgba8Snorm => texel.map(|word| snorm(number(word), 127.0)),
        F::Rgba8Uint => texel.map(|word| uint(word, 255)),
        F::Rgba8Sint => texel.map(|word| sint(word, 127)),
        F::Rgba16Uint => texel.map(|word| uint(word, 65535)),
        F::Rgba16Sint => texel.map(|word| sint(word, 32767)),
        F::Rgba16Unorm => texel.map(|word| unorm(number(word), 65535.0)),
        F::Rgba16Snorm => texel.map(|word| snorm(number(word), 32767.0)),
        F::R8Unorm => [unorm(number(x), 255.0), 0, 0, one],
        F::R8Snorm => [snorm(number(x), 127.0), 0, 0, one],
        F::R16Unorm => [unorm(number(x), 65535.0), 0, 0, one],
        F::R16Snorm => [snorm(number(x), 32767.0), 0, 0, one],
        F::Rg8Unorm => [unorm(number(x), 255.0), unorm(number(y), 255.0), 0, one],
        F::Rg8Snorm => [snorm(number(x), 127.0), snorm(number(y), 127.0), 0, one],
        F::Rg16Unorm => [unorm(number(x), 65535.0), unorm(number(y), 65535.0), 0, one],
        F::Rg16Snorm => [snorm(number(x), 32767.0), snorm(number(y), 32767.0), 0, one],
        F::R8Uint => [uint(x, 255), 0, 0, 1],
        F::R8Sint => [sint(x, 127), 0, 0, 1],
        F::R16Uint => [uint(x, 65535), 0, 0, 1],
        F::R16Sint => [sint(x, 32767), 0, 0, 1],
        F::Rg8Uint => [uint(x, 255), uint(y, 255), 0, 1],
        F::Rg8Sint => [sint(x, 127), sint(y, 127), 0, 1],
        F::Rg16Uint => [uint(x, 65535), uint(y, 65535), 0, 1],
        F::Rg16Sint => [sint(x, 32767), sint(y, 32767), 0, 1],
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stored_channels_are_rounded_and_missing_ones_have_defaults() {
        let floats = [0.3, -2.0, f32::NAN, 7.0].map(f32::to_bits);
        let read = |format| stored(format, floats).map(|texel| texel.map(f32::from_bits));
        assert_eq!(read(F::R8Unorm), Some([77.0 / 255.0, 0.0, 0.0, 1.0]));
        assert_eq!(read(F::Rg8Snorm), Some([38.0 / 127.0, -1.0, 0.0, 1.0]));
        assert_eq!(read(F::Rg16Unorm), Some([19661.0 / 65535.0, 0.0, 0.0, 1.0]));
        assert_eq!(read(F::Rgba16Snorm), Some([9830.0 / 32767.0, -1.0, 0.0, 1.0]));
        let words = [300, 70_000, 0, 5];
        assert_eq!(stored(F::Rg8Uint, words), Some([255, 255, 0, 1]));
        assert_eq!(stored(F::R16Sint, words), Some([300, 0, 0, 1]));
        assert_eq!(stored(F::Rg16Sint, words), Some([300, 32767, 0, 1]));
    }
}
