//! Ratios of differences to the allowed ones, and the brightness that they are relative to.

use glam::Vec4;

use crate::image::luminance;

/// Values below this share of the golden's key are compared as if they were that bright. With the key at middle grey on
/// a screen, this is 1/180 of an 8-bit step: black pixels with rounding noise pass, and dark regions of a frame with
/// bright ones are still compared.
pub(super) const DARK: f32 = 1e-4;

/// The difference of each channel, divided by the allowed one. Equal values have the ratio 0, even with a tolerance of
/// 0.
pub(super) fn ratio(golden: [f32; 4], actual: [f32; 4], relative: Vec4, floor: Vec4) -> Vec4 {
    let (golden, actual) = (Vec4::from_array(golden), Vec4::from_array(actual));
    let difference = (actual - golden).abs();
    let ratio = difference / (relative * golden.abs()).max(floor);
    Vec4::select(difference.cmpeq(Vec4::ZERO), Vec4::ZERO, ratio)
}

/// The logarithmic mean of luminance, as in [`Image::key`](crate::Image::key). It takes the logarithm of products of
/// eight values, which fit in the exponent of an `f64`, because the logarithm takes as long as everything else.
pub(super) fn key(pixels: &[[f32; 4]]) -> f32 {
    let (mut sum, mut count) = (0.0, 0_u32);
    for pixels in pixels.chunks(8) {
        // 2^-126 to the eighth power is 2^-1008. Black and non-finite pixels are left out.
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
    fn the_key_is_that_of_the_image() {
        for scale in [1e-30, 1.0, 1e30] {
            let pixels = (0..1003).map(|i| [scale * (i % 17) as f32; 4]).collect();
            let image = Image::new(1003, 1, pixels);
            let (ours, theirs) = (key(image.pixels()), image.key());
            assert!((ours - theirs).abs() <= 1e-6 * theirs, "{ours} {theirs}");
        }
        assert_eq!(key(&[[0.0; 4]]), 1.0);
    }
}
