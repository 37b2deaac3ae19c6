//! Small pictures of frames that fail, for people: the golden, the frame, and where they differ.
//!
//! GitHub shows no image in a summary that isn't at a URL, and strips `data:`, so they travel in
//! the artefact of the run, and the summary names them.

use std::path::{Path, PathBuf};

use karat::record::{Record, Subject};
use karat::review::Case;
use karat::{Goldens, Image, Pair};

use crate::cli::heatmap::Heatmap;
use crate::cli::project::Project;

/// Pixels across, at most; a larger frame is shown by every other pixel, and so on.
const WIDEST: u32 = 480;

/// The pictures of a frame, by what they show; those that could be made.
pub(super) fn write(
    record: &Record,
    project: &Project,
    folder: &Path,
) -> anyhow::Result<Vec<(&'static str, PathBuf)>> {
    let Subject::Frame { golden: case, folder: goldens, .. } = &record.subject else {
        return Ok(Vec::new());
    };
    if goldens.is_empty() {
        return Ok(Vec::new());
    }
    let goldens = Goldens::open(Path::new(goldens));
    // With `CI` set, nothing is written beside the goldens.
    let waiting = [Goldens::open(&project.output().join("pending")), goldens.clone()];
    let pending = waiting.iter().find_map(|folder| folder.select(case).ok()?.frames.pop());
    let Some(loaded) = pending.and_then(|pending| Case::load(&goldens, &pending).ok()) else {
        return Ok(Vec::new());
    };
    let (golden, actual) = (&loaded.parts[0].golden, &loaded.parts[0].actual);

    let mut written = Vec::new();
    let mut place = |name| {
        let file = folder.join(format!("{case}.{name}.png"));
        written.push((name, file.clone()));
        file
    };
    for (name, image) in [("golden", golden), ("actual", actual)] {
        if let Some(image) = image {
            // The frame at the golden's exposure: a brighter one is to look brighter.
            let stops = golden.as_ref().map_or(0.0, |golden| (image.key() / golden.key()).log2());
            let small = small(image);
            let stops = stops - (image.key() / small.key()).log2();
            small.write_png_exposed(&place(name), if stops.is_finite() { stops } else { 0.0 })?;
        }
    }
    if let (Some(golden), Some(actual)) = (golden, actual) {
        let mask = loaded.mask();
        let pair = match &mask {
            Some(mask) => Pair::masked(golden, actual, mask),
            None => Pair::new(golden, actual),
        };
        if let Some(map) = pair.ok().and_then(|pair| Heatmap::flip(&pair).ok()) {
            map.write(&place("flip"))?;
        }
    }
    Ok(written)
}

fn small(image: &Image) -> Image {
    let step = image.width().div_ceil(WIDEST).max(1);
    let (width, height) = (image.width().div_ceil(step), image.height().div_ceil(step));
    let at = |x: u32, y: u32| image.pixels()[(y * step * image.width() + x * step) as usize];
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| at(x, y));
    Image::new(width, height, pixels.collect())
}
