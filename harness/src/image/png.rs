//! Previews: an image as a screen would show it.

use std::path::Path;

use super::{Image, ImageError};
use crate::diagnostic::shown;

/// Where the key of an image is mapped to: middle grey.
const MIDDLE_GREY: f32 = 0.18;

impl Image {
    /// Writes an 8-bit sRGB PNG for looking at. The exposure maps the image's key to middle grey;
    /// highlights are compressed (Reinhard et al. 2002, eq. 3). NaN is magenta, infinities are
    /// yellow.
    ///
    /// # Errors
    /// If the file can't be written.
    pub fn write_png(&self, path: &Path) -> Result<(), ImageError> {
        let failed = |source| ImageError::Write { path: shown(path), source };
        let exposure = MIDDLE_GREY / self.key();
        let mut bytes = Vec::with_capacity(self.pixels.len() * 3);
        for [r, g, b, _] in &self.pixels {
            let rgb = [*r, *g, *b];
            if rgb.iter().any(|value| value.is_nan()) {
                bytes.extend([255, 0, 255]);
            } else if rgb.iter().any(|value| value.is_infinite()) {
                bytes.extend([255, 255, 0]);
            } else {
                bytes.extend(rgb.map(|value| {
                    let exposed = (value * exposure).max(0.0);
                    to_srgb(exposed / (1.0 + exposed))
                }));
            }
        }
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, self.width, self.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
        encoder
            .write_header()
            .and_then(|mut writer| writer.write_image_data(&bytes))
            .map_err(|error| failed(std::io::Error::other(error)))?;
        super::exr::write_whole(path, &file).map_err(failed)
    }
}

/// IEC 61966-2-1, from linear in 0..=1 to 8 bits.
fn to_srgb(linear: f32) -> u8 {
    let encoded =
        if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    let byte = (encoded * 255.0).round().clamp(0.0, 255.0) as u8;
    byte
}
