//! PNG files: Karat writes previews as PNG, and reads PNG files of other tools.

mod read;

use std::path::Path;

pub(super) use self::read::decode;

use super::{Image, ImageError, encode_srgb};
use crate::diagnostic::shown;

/// Middle grey: the linear value at which a preview shows the mean luminance of its image ([`Image::key`]).
const MIDDLE_GREY: f32 = 0.18;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Samples {
    /// Light, encoded for screens.
    Colours,
    /// Numbers that aren't colours.
    Data,
}

impl Image {
    /// Writes an 8-bit sRGB PNG as a preview. The exposure maps the image's mean luminance to middle grey. Highlights
    /// are compressed (Reinhard et al. 2002, eq. 3). Pixels with NaN become magenta, pixels with infinities yellow.
    ///
    /// ```no_run
    /// use karat::Image;
    ///
    /// Image::read("golden/dusk.exr".as_ref())?.write_png("dusk.png".as_ref())?;
    /// # Ok::<(), karat::image::ImageError>(())
    /// ```
    ///
    /// # Errors
    /// Returns an error if the file can't be written.
    pub fn write_png(&self, path: &Path) -> Result<(), ImageError> {
        self.write_png_exposed(path, 0.0)
    }

    /// Like [`write_png`](Self::write_png), but brighter by `stops`: 1 doubles the exposure, -1 halves it.
    ///
    /// ```no_run
    /// use karat::Image;
    ///
    /// let dark = Image::read("golden/cave.exr".as_ref())?;
    /// dark.write_png_exposed("cave.png".as_ref(), 3.0)?; // eight times as bright
    /// # Ok::<(), karat::image::ImageError>(())
    /// ```
    ///
    /// # Errors
    /// Returns an error if the file can't be written.
    ///
    /// # Panics
    /// Panics if `stops` isn't finite.
    pub fn write_png_exposed(&self, path: &Path, stops: f32) -> Result<(), ImageError> {
        assert!(stops.is_finite(), "the exposure of {stops} stops isn't finite");
        written(path, (self.width, self.height), png::ColorType::Rgb, &self.exposed(stops))
    }

    /// The 8-bit sRGB colours of the preview, with three bytes for each pixel.
    fn exposed(&self, stops: f32) -> Vec<u8> {
        let exposure = MIDDLE_GREY / self.key() * stops.exp2();
        let mut bytes = Vec::with_capacity(self.pixels.len() * 3);
        for [r, g, b, _] in &self.pixels {
            let rgb = [*r, *g, *b];
            if rgb.iter().any(|value| value.is_nan()) {
                bytes.extend([255, 0, 255]);
            } else if rgb.iter().any(|value| value.is_infinite()) {
                bytes.extend([255, 255, 0]);
            } else {
                bytes.extend(rgb.map(|value| {
                    // This form of the quotient works for an infinite x. Black stays black even if the exposure
                    // overflows (0 * inf), and a value that overflows becomes white.
                    let exposed = (value * exposure).max(0.0);
                    to_srgb(1.0 / (1.0 + 1.0 / exposed))
                }));
            }
        }
        bytes
    }
}

/// Writes a PNG with the given bytes, row by row. Each pixel has four bytes: three for 8-bit sRGB, and one for alpha.
///
/// # Errors
/// Returns an error if the file can't be written.
pub fn write_colours(path: &Path, size: (u32, u32), colours: &[u8]) -> Result<(), ImageError> {
    written(path, size, png::ColorType::Rgba, colours)
}

fn written(
    path: &Path,
    (width, height): (u32, u32),
    kind: png::ColorType,
    bytes: &[u8],
) -> Result<(), ImageError> {
    let failed = |cause| ImageError::Write { path: shown(path), cause };
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_color(kind);
    encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
    encoder
        .write_header()
        .and_then(|mut writer| writer.write_image_data(bytes))
        .map_err(|error| failed(std::io::Error::other(error)))?;
    super::whole::write_whole(path, &file).map_err(failed)
}

/// Encodes a linear value in 0..=1 as 8-bit sRGB.
fn to_srgb(linear: f32) -> u8 {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    let byte = (encode_srgb(linear.into()) * 255.0).round().clamp(0.0, 255.0) as u8;
    byte
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reds(values: &[f32], stops: f32) -> Vec<u8> {
        let pixels: Vec<_> = values.iter().map(|value| [*value, *value, *value, 1.0]).collect();
        let image = Image::new(u32::try_from(pixels.len()).expect("few"), 1, pixels);
        image.exposed(stops).chunks(3).map(|rgb| rgb[0]).collect()
    }

    #[test]
    fn a_stop_is_a_factor_of_two() {
        // The expected value is 0.18 / 1.18, encoded as sRGB.
        assert_eq!(reds(&[5.0], 0.0), [109]);
        assert_eq!(reds(&[5.0], 1.0), reds(&[10.0, 2.5], 0.0)[..1]);
        assert_eq!(reds(&[5.0], -1.0), reds(&[10.0, 2.5], 0.0)[1..]);
    }

    #[test]
    fn the_largest_exposure_keeps_bright_pixels_white() {
        let values = [0.0, -1.0, 1e-30, 1.0, 1e30, f32::MAX];
        assert_eq!(reds(&values, 1000.0), [0, 0, 255, 255, 255, 255]);
        assert_eq!(reds(&values, -1000.0), [0; 6]);
        assert_eq!(reds(&values, 0.0)[5], 255);
    }

    #[test]
    fn nan_and_infinity_have_their_colours() {
        let image = Image::new(2, 1, vec![[f32::NAN, 1.0, 1.0, 1.0], [f32::INFINITY; 4]]);
        assert_eq!(image.exposed(0.0), [255, 0, 255, 255, 255, 0]);
    }
}
