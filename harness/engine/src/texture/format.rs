//! What storage formats keep of a texel.

use naga::StorageFormat as F;

/// The words of a texel as they are read after it has been written: rounded to the format, with
/// 0, 0, 0, 1 for the channels that it lacks. `None` for formats that aren't known here.
pub(crate) fn stored(format: F, texel: [u32; 4]) -> Option<[u32; 4]> {
    let float = |word: u32| f64::from(f32::from_bits(word));
    // NaN has no normalised value; it becomes 0.
    let unorm = |word: u32, scale: f64| {
        (((float(word).clamp(0.0, 1.0) * scale).round_ties_even() / scale) as f32).to_bits()
    };
    let snorm = |word: u32, scale: f64| {
        (((float(word).clamp(-1.0, 1.0) * scale).round_ties_even() / scale) as f32).to_bits()
    };
    let number = |word: u32| if f32::from_bits(word).is_nan() { 0 } else { word };
    let half = |word: u32| half::f16::from_f32(f32::from_bits(word)).to_f32().to_bits();
    // Integers that don't fit are clamped, as Vulkan and Metal have it.
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
        _ => return None,
    })
}
