//! HDR-FLIP of each pixel as a picture.

use std::path::{Path, PathBuf};

use anyhow::Context;
use karat::{ErrorMap, Flip, FlipFailure, Image, Pair, Precision};

/// An error for each pixel of an image, 0 to 1.
#[derive(Debug)]
pub(super) struct Heatmap {
    width: u32,
    height: u32,
    errors: Vec<f32>,
}

impl Heatmap {
    /// HDR-FLIP of all pixels: as published and, where that is too bright to see what is off, as
    /// verdicts have it, which look at darker exposures there.
    pub(super) fn flip(pair: &Pair<'_>) -> Result<Self, FlipFailure> {
        let whole = Flip::LARGEST_TILE.whole(pair)?;
        let judged = Flip::LARGEST_TILE.map(pair).ok();
        let (width, height) = (pair.golden().width(), pair.golden().height());
        let judged = |x, y| judged.as_ref().map_or(0.0, |map| map.at(x, y));
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let errors = pixels.map(|(x, y)| whole.at(x, y).max(judged(x, y))).collect();
        Ok(Self { width, height, errors })
    }

    /// Writes the errors themselves as EXR, or their colours as PNG.
    pub(super) fn write(&self, path: &Path) -> anyhow::Result<()> {
        if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("exr")) {
            let pixels = self.errors.iter().map(|error| [*error, *error, *error, 1.0]).collect();
            let image = Image::new(self.width, self.height, pixels);
            return Ok(image.write_exr(path, Precision::Float, None)?);
        }
        let colours: Vec<u8> =
            self.errors.iter().flat_map(|error| ErrorMap::colour(*error)).collect();
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, self.width, self.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
        encoder.write_header()?.write_image_data(&colours)?;
        std::fs::write(path, file).with_context(|| format!("can't write `{}`", path.display()))
    }
}

/// A file for a heatmap, by its name.
pub(super) fn file(name: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(name);
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    if extension == "png" || extension == "exr" {
        return Ok(path);
    }
    Err("name a .png (colours) or an .exr (the errors themselves)".to_owned())
}
