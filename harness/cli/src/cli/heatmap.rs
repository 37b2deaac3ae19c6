//! Writes an image that shows the HDR-FLIP error of each pixel.

mod canvas;
mod legend;

use std::path::{Path, PathBuf};

use anyhow::Context;
use karat::Image;
use karat::image::Precision;
use karat::metric::{Flip, Rect};
use karat::unstable::image::write_whole;
use karat::unstable::metric::ErrorMap;
use karat::unstable::metric::{FlipFailure, Pair};

use self::canvas::Canvas;
use self::legend::Legend;

/// The errors of an image's pixels, each from 0 to 1.
#[derive(Debug)]
pub(super) struct Heatmap {
    width: u32,
    height: u32,
    errors: Vec<f32>,
}

impl Heatmap {
    /// Computes HDR-FLIP of all pixels at the exposures that the published method chooses, and at darker exposures if
    /// the chosen exposures are too bright to show the error. The verdict uses the same exposures, so the heatmap shows
    /// the errors that decide the verdict.
    pub(super) fn flip(pair: &Pair<'_>) -> Result<Self, FlipFailure> {
        let (width, height) = (pair.golden().width(), pair.golden().height());
        let judged = Flip::LARGEST_TILE.map(pair).ok();
        // If the verdict's map covers every pixel, it already includes the published exposures.
        let all = Rect::new(0, 0, width, height);
        if let Some(judged) = judged.as_ref().filter(|map| map.rect() == all) {
            return Ok(Self { width, height, errors: judged.values().to_vec() });
        }
        let whole = Flip::LARGEST_TILE.whole(pair)?;
        let judged = |x, y| judged.as_ref().map_or(0.0, |map| map.at(x, y));
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let errors = pixels.map(|(x, y)| whole.at(x, y).max(judged(x, y))).collect();
        Ok(Self { width, height, errors })
    }

    /// Writes an EXR image with the errors as numbers, or a PNG image with the errors as colours and a legend below.
    /// For a PNG, returns the error that the last colour of the legend stands for. If writing fails, an existing file
    /// stays unchanged.
    pub(super) fn write(&self, path: &Path) -> anyhow::Result<Option<f32>> {
        if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("exr")) {
            let pixels = self.errors.iter().map(|error| [*error, *error, *error, 1.0]).collect();
            let image = Image::new(self.width, self.height, pixels);
            image.write_exr(path, Precision::Float, None)?;
            return Ok(None);
        }
        let full = ErrorMap::scale(&self.errors);
        let canvas = self.picture(full);
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, canvas.width, canvas.height());
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
        encoder.write_header()?.write_image_data(canvas.bytes())?;
        write_whole(path, &file).with_context(|| format!("can't write `{}`", path.display()))?;
        Ok(Some(full))
    }

    /// Draws the errors of all pixels as colours, and the legend below them. The error `full` has the last colour.
    fn picture(&self, full: f32) -> Canvas {
        let legend = Legend::of(self.width, full);
        let mut canvas = Canvas::new(self.width.max(legend.width()), self.height + legend.height());
        let pixels = (0..self.height).flat_map(|y| (0..self.width).map(move |x| (x, y)));
        for ((x, y), error) in pixels.zip(&self.errors) {
            canvas.set(x, y, ErrorMap::colour(error / full));
        }
        legend.draw(&mut canvas, self.height);
        canvas
    }
}

/// Parses the file name of a heatmap, which must end in `.png` or `.exr`.
pub(super) fn file(name: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(name);
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    if extension == "png" || extension == "exr" {
        return Ok(path);
    }
    Err("name a .png file (for colours) or an .exr file (for the errors as numbers)".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(largest: f32) -> Heatmap {
        Heatmap { width: 2, height: 1, errors: vec![0.0, largest] }
    }

    #[test]
    fn the_largest_error_is_bright_however_small() {
        for largest in [0.002, 0.2, 1.0] {
            let canvas = map(largest).picture(largest);
            assert_eq!(canvas.bytes()[..6], [0, 0, 4, 252, 253, 191], "magma's ends");
        }
    }
}
