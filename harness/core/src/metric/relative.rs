//! Ratios of differences to allowed differences, which are relative to the golden's brightness.

use glam::Vec4;

use crate::image::luminance;

/// The share of the golden's mean luminance below which a channel counts as dark. A dark channel may differ by as much
/// as a channel with exactly this brightness. If the mean luminance is middle grey, this brightness is 1/17 of an 8-bit
/// sRGB step. So black pixels with rounding noise pass, and dark regions of a frame are still compared.
pub(super) const DARK: f32 = 1e-4;

/// The difference of each channel divided by the allowed difference. Equal values have the ratio 0, even if the
/// tolerance is 0.
pub(super) fn ratio(golden: [f32; 4], actual: [f32; 4], relative: Vec4, floor: Vec4) -> Vec4 {
    let (golden, actual) = (Vec4::from_array(golden), Vec4::from_array(actual));
    let difference = (actual - golden).abs();
    let ratio = difference / (relative * golden.abs()).max(floor);
    Vec4::select(difference.cmpeq(Vec4::ZERO), Vec4::ZERO, ratio)
}

/// The logarithmic mean of luminance, as in [`Image::key`](crate::Image::key). To save time, the function multiplies
/// eight luminances and takes the logarithm of their product, instead of eight logarithms. The product's exponent fits
/// in an `f64`.
pub(super) fn key(pixels: &[[f32; 4]]) -> f32 {
    let (mut sum, mut count) = (0.0, 0_u32);
    for pixels in pixels.chunks(8) {
        // The smallest product is 2^-126 to the eighth power, 2^-1008. Black and non-finite pixels don't count.
        let factor = |pixel: Option<&[f32; 4]>| {
            let luminance = pixel.map_or(0.0, luminance);
            let counts = (f32::MIN_POSITIVE..=f32::MAX).contains(&luminance);
            (if counts { f64::from(luminance) } else { 1.0 }, u32::from(counts))
        };
        let factors: [_; 8] = std::array::from_fn(|index| factor(pixels.get(index)));
        let [a, b, c, d, e, f, g, h] = factors.map(|(factor, _)| factor);
        sum += (((a * b) * (c * d)) * ((e * f) * (g * h))).ln();
        count += factors.iter().map(|(_, counts)| counts).sum::<u32>();
    }
    if count == 0 {
        return 1.0;
    }
    #[expect(clippy::cast_possible_truncation, reason = "a mean of f32 luminances")]
    let key = (sum / f64::from(count)).exp() as f32;
    key
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;

    #[test]
    fn the_fast_key_is_close_to_the_key_of_the_image() {
        for scale in [1e-30, 1.0, 1e30] {
            let pixels = (0..1003).map(|i| [scale * (i % 17) as f32; 4]).collect();
            let image = Image::new(1003, 1, pixels);
            let (ours, theirs) = (key(image.pixels()), image.key());
            assert!((ours - theirs).abs() <= 1e-6 * theirs, "{ours} {theirs}");
        }
        assert_eq!(key(&[[0.0; 4]]), 1.0);
    }
}
