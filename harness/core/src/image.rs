//! Images of floats, for frames and goldens.

mod bytes;
mod error;
mod exr;
mod file;
mod png;
mod whole;

use half::f16;
use half::slice::HalfFloatSliceExt;

pub use self::error::{ImageError, ImageFormat};
pub use self::exr::{ExrFile, Part, Precision};
#[doc(hidden)]
pub use self::png::write_colours;
#[doc(hidden)]
pub use self::whole::{Staged, remove_leftover};
pub use self::whole::{append_line, is_beside, is_leftover, write_whole};

use std::sync::Arc;

use crate::diagnostic::FileRead;

/// An image of linear RGBA in 32-bit floats. The first row is the top row.
///
/// ```
/// use karat::Image;
///
/// let mut image = Image::new(2, 1, vec![[0.5, 0.25, 0.0, 1.0]; 2]);
/// image.pixels_mut()[1] = [4.0, 4.0, 4.0, 1.0]; // light can be brighter than 1
/// assert_eq!((image.width(), image.height(), image.pixels().len()), (2, 1, 2));
/// ```
#[derive(Clone, Debug)]
pub struct Image {
    width: u32,
    height: u32,
    pixels: Vec<[f32; 4]>,
    /// The file from which the image was read. Verdicts list this file.
    origin: Option<Arc<FileRead>>,
}

/// Compares sizes and pixels, but not origins.
impl PartialEq for Image {
    fn eq(&self, other: &Self) -> bool {
        (self.width, self.height) == (other.width, other.height) && self.pixels == other.pixels
    }
}

/// Counts of the pixels that contain NaN or an infinity.
///
/// ```
/// use karat::Image;
///
/// let found = Image::new(1, 1, vec![[f32::INFINITY, 0.0, 0.0, 1.0]]).non_finite();
/// assert_eq!((found.nan, found.infinite), (0, 1));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NonFinite {
    /// The number of pixels with a NaN.
    pub nan: usize,
    /// The number of pixels with an infinity and no NaN.
    pub infinite: usize,
    /// The column and the row of the first pixel with a NaN or an infinity.
    pub first: Option<(u32, u32)>,
}

impl Image {
    /// Makes an image from its pixels, row by row from the top.
    ///
    /// ```
    /// use karat::Image;
    ///
    /// let white = Image::new(64, 32, vec![[1.0; 4]; 64 * 32]);
    /// # let _ = white;
    /// ```
    ///
    /// # Panics
    /// Panics if the number of pixels isn't `width * height`.
    #[must_use]
    pub fn new(width: u32, height: u32, pixels: Vec<[f32; 4]>) -> Self {
        let expected = width as usize * height as usize;
        assert_eq!(pixels.len(), expected, "a {width} x {height} image needs {expected} pixels");
        Self { width, height, pixels, origin: None }
    }

    /// The same image, with `file` recorded as its origin. `bytes` are the contents of the file.
    #[doc(hidden)]
    pub fn read_from(self, file: &std::path::Path, bytes: &[u8]) -> Self {
        Self { origin: Some(Arc::new(FileRead::of(file, bytes))), ..self }
    }

    /// The file from which the image was read. Changing the image's pixels doesn't change its origin.
    #[doc(hidden)]
    pub fn origin(&self) -> Option<&FileRead> {
        self.origin.as_deref()
    }

    /// The width in pixels.
    ///
    /// ```
    /// use karat::Image;
    ///
    /// assert_eq!(Image::new(2, 1, vec![[0.0; 4]; 2]).width(), 2);
    /// ```
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// The height in pixels.
    ///
    /// ```
    /// use karat::Image;
    ///
    /// assert_eq!(Image::new(2, 1, vec![[0.0; 4]; 2]).height(), 1);
    /// ```
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// All pixels, row by row from the top.
    ///
    /// ```
    /// use karat::Image;
    ///
    /// let image = Image::new(2, 1, vec![[0.0; 4], [1.0; 4]]);
    /// let (x, y) = (1, 0);
    /// assert_eq!(image.pixels()[y * image.width() as usize + x], [1.0; 4]);
    /// ```
    #[must_use]
    pub fn pixels(&self) -> &[[f32; 4]] {
        &self.pixels
    }

    /// All pixels, for reading and changing, row by row from the top.
    ///
    /// ```
    /// use karat::Image;
    ///
    /// let mut image = Image::new(2, 1, vec![[0.5; 4]; 2]);
    /// image.pixels_mut().iter_mut().for_each(|pixel| pixel[3] = 1.0);
    /// assert_eq!(image.pixels()[0], [0.5, 0.5, 0.5, 1.0]);
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn pixels_mut(&mut self) -> &mut [[f32; 4]] {
        &mut self.pixels
    }

    /// A copy whose pixels are rounded as if the image were written to a file of this precision and read again.
    ///
    /// ```
    /// use karat::Image;
    /// use karat::image::Precision;
    ///
    /// let third = Image::new(1, 1, vec![[1.0 / 3.0; 4]]).rounded_to(Precision::Half);
    /// assert_eq!(third.pixels()[0][0], 0.33325195);
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn rounded_to(&self, precision: Precision) -> Self {
        let mut rounded = self.clone();
        if precision == Precision::Half {
            // The array fits into the smallest cache. Converting a slice is several times faster than converting its
            // values one by one.
            let mut halves = [f16::ZERO; 4096];
            for values in rounded.pixels.as_flattened_mut().chunks_mut(halves.len()) {
                let halves = &mut halves[..values.len()];
                halves.convert_from_f32_slice(values);
                halves.convert_to_f32_slice(values);
            }
        }
        rounded
    }

    /// A hash of the image's size and of its pixels' bits.
    ///
    /// ```
    /// use karat::Image;
    ///
    /// let image = || Image::new(1, 1, vec![[0.5; 4]]);
    /// assert_eq!(image().hash(), image().hash());
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn hash(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&self.width.to_le_bytes());
        hasher.update(&self.height.to_le_bytes());
        hasher.update(bytemuck::cast_slice(&self.pixels));
        hasher.finalize().to_hex().to_string()
    }

    /// Counts the pixels that contain NaN or an infinity.
    ///
    /// ```
    /// use karat::Image;
    ///
    /// let found = Image::new(2, 1, vec![[f32::NAN; 4], [1.0; 4]]).non_finite();
    /// assert_eq!((found.nan, found.first), (1, Some((0, 0))));
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn non_finite(&self) -> NonFinite {
        let mut census = NonFinite::default();
        for (index, pixel) in (0..).zip(&self.pixels) {
            if pixel.iter().all(|value| value.is_finite()) {
                continue;
            }
            if pixel.iter().any(|value| value.is_nan()) {
                census.nan += 1;
            } else {
                census.infinite += 1;
            }
            census.first = census.first.or(Some((index % self.width, index / self.width)));
        }
        census
    }

    /// The image's key: the logarithmic mean of the pixels' luminance. A photographer would choose the exposure so that
    /// this brightness becomes middle grey. Black and non-finite pixels don't count. If all pixels are black or
    /// non-finite, the key is 1.
    ///
    /// ```
    /// use karat::Image;
    ///
    /// assert!((Image::new(1, 1, vec![[0.5, 0.5, 0.5, 1.0]]).key() - 0.5).abs() < 1e-3);
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn key(&self) -> f32 {
        let logarithms = self.pixels.iter().map(luminance).filter(|l| l.is_normal() && *l > 0.0);
        let (count, sum) =
            logarithms.fold((0_u32, 0.0), |(count, sum), l| (count + 1, sum + f64::from(l).ln()));
        if count == 0 {
            return 1.0;
        }
        #[expect(clippy::cast_possible_truncation, reason = "a mean of f32 luminances")]
        let key = (sum / f64::from(count)).exp() as f32;
        key
    }
}

/// The luminance of a linear sRGB colour (ITU-R BT.709).
#[doc(hidden)]
pub fn luminance([r, g, b, _]: &[f32; 4]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// Encodes linear light as sRGB (IEC 61966-2-1). The argument and the result are from 0 to 1.
#[doc(hidden)]
pub fn encode_srgb(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

impl approx::AbsDiffEq for Image {
    type Epsilon = f32;

    fn default_epsilon() -> f32 {
        f32::EPSILON
    }

    /// Compares sizes, and checks that each channel differs by at most `epsilon`. NaN is unequal to everything.
    fn abs_diff_eq(&self, other: &Self, epsilon: f32) -> bool {
        self.all_channels(other, |a, b| a.abs_diff_eq(&b, epsilon))
    }
}

impl approx::RelativeEq for Image {
    fn default_max_relative() -> f32 {
        f32::EPSILON
    }

    /// Compares sizes, and checks that each channel differs by at most `epsilon`, or by at most `max_relative` times
    /// the larger value.
    fn relative_eq(&self, other: &Self, epsilon: f32, max_relative: f32) -> bool {
        self.all_channels(other, |a, b| a.relative_eq(&b, epsilon, max_relative))
    }
}

impl Image {
    fn all_channels(&self, other: &Self, equal: impl Fn(f32, f32) -> bool) -> bool {
        (self.width, self.height) == (other.width, other.height)
            && self
                .pixels
                .iter()
                .flatten()
                .zip(other.pixels.iter().flatten())
                .all(|(a, b)| equal(*a, *b))
    }
}

#[cfg(test)]
mod tests {
    use approx::{AbsDiffEq, RelativeEq};

    use super::*;

    fn grey(value: f32) -> Image {
        Image::new(3, 2, vec![[value, value, value, 1.0]; 6])
    }

    // Lesson 19
    #[test]
    fn non_finite_pixels_are_counted_and_placed() {
        let mut image = grey(0.5);
        image.pixels_mut()[4][2] = f32::NAN;
        image.pixels_mut()[5][0] = f32::INFINITY;
        let expected = NonFinite { nan: 1, infinite: 1, first: Some((1, 1)) };
        assert_eq!(image.non_finite(), expected);
        assert!(!image.abs_diff_eq(&image, 1.0), "an image with NaN equals nothing");
    }

    #[test]
    fn comparisons_see_one_channel_of_one_pixel() {
        let (a, mut b) = (grey(0.5), grey(0.5));
        assert!(a.relative_eq(&b, 0.0, 0.0));
        b.pixels_mut()[5][2] += 0.01;
        assert!(!a.relative_eq(&b, 0.0, 1e-3));
        assert!(a.abs_diff_eq(&b, 0.011));
        assert_ne!(a.hash(), b.hash());
    }

    #[test]
    fn values_are_rounded_as_each_alone() {
        let values = (0..5000).map(|i| (i as f32 - 2500.0) * 1.37_f32.powi(i % 61 - 40));
        let odd = [0.0, -0.0, 65_504.0, 65_519.9, 65_520.0, 7e4, -1e9, 3e-8, 2.9e-8, 6.1e-5];
        let values: Vec<f32> = values.chain(odd).chain([0.5; 2]).collect();
        let pixels = values.as_chunks().0.to_vec();
        let image = Image::new(values.len() as u32 / 4, 1, pixels);
        let rounded = image.rounded_to(Precision::Half);
        for (value, rounded) in values.iter().zip(rounded.pixels().as_flattened()) {
            let expected = f16::from_f32_const(*value).to_f32_const();
            assert_eq!(rounded.to_bits(), expected.to_bits(), "{value:e}");
        }
        assert_eq!(image.rounded_to(Precision::Float), image);
    }

    #[test]
    fn the_key_is_the_logarithmic_mean() {
        assert!((grey(0.25).key() - 0.25).abs() < 1e-6);
        assert_eq!(grey(0.0).key(), 1.0);
    }
}
