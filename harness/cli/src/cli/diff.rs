//! `karat diff`: measures the difference between two images.

mod comparison;
mod message;

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use karat::Image;
use karat::image::ImageError;
use karat::metric::Mask;
use karat::unstable::golden::Provenance;
use karat::unstable::image::ExrFile;
use karat::unstable::image::ImageFormat;
use karat::unstable::metric::{ExposureRange, Pair, PairError};

use self::comparison::{Bounds, Comparison, LdrResult, Reason, Side};
use super::heatmap::{self, Heatmap};
use super::patience::patiently;
use super::{Ending, Outcome, spare, write_json};

pub(super) const EXAMPLES: &str = "\
Examples:
  karat diff golden/scene.exr golden/scene.new.exr
  karat diff a.exr b.png --rel 0                        requires that all channels are equal
  karat diff a.exr b.exr --flip-tile 0.03 --heatmap flip.png
  karat diff a.exr b.exr --mask sky.png --json

The first image is the expected image. Karat converts a PNG to linear light before it compares the
images. The images agree if each channel is within 1e-3 (the gate), or else if HDR-FLIP is at most
0.01 in every tile of 16 x 16 pixels, and at most 0.005 in the mean. If you give only --rel, Karat
applies only the gate. FLIP uses the exposures that a golden stores, or else exposures that suit the
first image. For two PNGs Karat also prints LDR-FLIP, the number that other FLIP tools print;
no bound applies to LDR-FLIP. Karat compares the stored values without converting primaries, and prints a
note if the chromaticities differ. The data windows of EXR files may have different positions. If an
EXR file has several parts, Karat compares only the first part that contains colours. Without --mask,
Karat uses the second file's part `mask`; a frame has this part if its test declares a mask. A golden may store
the variance of its noise. A test allows for this noise, but `karat diff` doesn't.
Exit codes: 0 the images agree within the bounds; 1 the values or the sizes differ; 2 an image can't
be read or compared; 3 an image is missing. NaN and infinities differ from every value.
JSON: a, b {file, width, height, nan, infinite, first_non_finite, parts, chromaticities (CIE x and y
of red, green, blue and white)}, verdict (equal, within, differs), reason (size, non_finite, values,
or null), tolerance, compared, own_mask, gate {relative, off, bounds, worst, sweep}, flip
{largest_tile, tile, mean, tile_bound, mean_bound, exposures, note}, ldr_flip {largest_tile, tile,
mean}, heatmap, heatmap_full (the error that has the heatmap's last colour).";

#[derive(clap::Args)]
pub(super) struct Args {
    /// The expected image: EXR or PNG
    a: PathBuf,
    /// The actual image, which Karat compares with the expected image: EXR or PNG
    b: PathBuf,
    /// Accepts this relative difference in each channel [default: 1e-3]
    #[arg(long, value_name = "R", value_parser = relative, allow_hyphen_values = true)]
    rel: Option<f64>,
    /// If a channel differs too much, accepts at most this mean HDR-FLIP in each tile of 16 x 16 pixels
    /// [default: 0.01, or no such rule if you give --rel]
    #[arg(long, value_name = "E", value_parser = bound, allow_hyphen_values = true)]
    flip_tile: Option<f64>,
    /// If a channel differs too much, accepts at most this mean HDR-FLIP of the whole image [default: 0.005, or no such
    /// rule if you give --rel]
    #[arg(long, value_name = "E", value_parser = bound, allow_hyphen_values = true)]
    flip_mean: Option<f64>,
    /// Compares only the pixels whose stored red is above a half in this image (128 or more in a PNG of 8 bits). If
    /// the image is an EXR file with a part `mask`, Karat uses that part
    #[arg(long, value_name = "IMAGE")]
    mask: Option<PathBuf>,
    /// Writes HDR-FLIP of each pixel to this file. A PNG has colours (magma, black for 0) and a legend, whose scale
    /// depends on the largest error; an EXR has the errors themselves
    #[arg(long, value_name = "OUT", value_parser = heatmap::file)]
    heatmap: Option<PathBuf>,
    /// Prints JSON
    #[arg(long)]
    json: bool,
}

/// Parses a bound. Reports a negative number as an invalid bound, because clap would report it as an unknown option.
fn bound(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        // Adding 0 turns -0 into 0.
        Ok(bound) if bound >= 0.0 && bound <= f64::from(f32::MAX) => Ok(bound + 0.0),
        _ => Err("a bound must be a finite number of at least 0".to_owned()),
    }
}

/// Parses a relative bound. Karat compares values as `f32`, so a bound that would become 0 as an `f32` is an error.
fn relative(text: &str) -> Result<f64, String> {
    let bound = bound(text)?;
    #[expect(clippy::cast_possible_truncation, reason = "a bound is no larger than a float can be")]
    let float = bound as f32;
    if float == 0.0 && bound != 0.0 {
        return Err(
            "the bound is smaller than the smallest `f32`: write 0, or at least 1e-45".to_owned()
        );
    }
    Ok(bound)
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    if let Some(heatmap) = &args.heatmap {
        let inputs = [Some(&args.a), Some(&args.b), args.mask.as_ref()];
        spare("heatmap", heatmap, inputs.into_iter().flatten().map(PathBuf::as_path))?;
    }
    let (a, b) = (File::read(&args.a)?, File::read(&args.b)?);
    let bounds = Bounds::new(args.rel, args.flip_tile, args.flip_mean);
    let sides = [(&args.a, &a), (&args.b, &b)]
        .map(|(file, read)| Side::of(file, &read.image, read.parts.clone(), read.chromaticities));
    let mask = args.mask.as_deref().map(mask).transpose()?;
    // The second file's own mask excludes the pixels that its test excluded.
    let own = mask.is_none() && b.mask.is_some();
    let mask = mask.or(b.mask);
    let pair = match mask {
        Some(mask) => Pair::masked(&a.image, &b.image, &mask),
        None => Pair::new(&a.image, &b.image),
    };
    let mut comparison = match pair {
        Ok(pair) => {
            let pair = a.exposures.into_iter().fold(pair, Pair::with_exposures);
            let doing = format!("computing FLIP of {} pixels ...", pair.golden().pixels().len());
            patiently(&doing, || -> anyhow::Result<_> {
                let mut comparison = Comparison::measure(sides, &pair, &bounds);
                if a.is_png && b.is_png {
                    comparison.ldr_flip =
                        Some(LdrResult::of(&pair).context("there is no LDR-FLIP")?);
                }
                if let Some(file) = &args.heatmap {
                    let map = Heatmap::flip(&pair).context("there is no heatmap")?;
                    comparison.heatmap_full = map.write(file)?;
                    comparison.heatmap = Some(file.display().to_string());
                }
                Ok(comparison)
            })?
        }
        Err(PairError::Size { .. }) => Comparison::impossible(sides, &bounds, Reason::Size),
        Err(PairError::NonFinite(_) | PairError::GoldenNonFinite(_)) => {
            Comparison::impossible(sides, &bounds, Reason::NonFinite)
        }
        Err(error) => bail!(error),
    };
    comparison.own_mask = own;
    if args.json {
        write_json(&comparison, out)?;
    } else {
        message::write(&comparison, out)?;
    }
    if args.heatmap.is_some() && comparison.heatmap.is_none() {
        super::complain("Karat can't compare the images' pixels, so Karat writes no heatmap");
    }
    Ok(if comparison.passes() { Ending::Good } else { Ending::Bad })
}

/// Reads a mask from a file. If the file has a part `mask`, as goldens have, this part is the mask. Otherwise the image
/// itself is the mask.
fn mask(file: &Path) -> anyhow::Result<Mask> {
    // A file that isn't OpenEXR may be a PNG.
    match ExrFile::read(file).ok().and_then(|file| file.mask()) {
        Some(mask) => Ok(mask),
        None => Ok(Mask::image(Image::read_stored(file)?)),
    }
}

/// An image to compare, and the other data in its file.
struct File {
    image: Image,
    /// The exposures for HDR-FLIP, if the file is a golden that stores them.
    exposures: Option<ExposureRange>,
    /// The names of the parts with colours. Karat compares the first part.
    parts: Vec<String>,
    mask: Option<Mask>,
    chromaticities: [f32; 8],
    /// `true` if the file is a PNG, whose values are made for a display.
    is_png: bool,
}

impl File {
    fn read(file: &Path) -> anyhow::Result<Self> {
        match Image::read_exr(file) {
            Ok((image, metadata)) => {
                let known = metadata.and_then(|text| Provenance::parse(&text).ok());
                let parts = ExrFile::part_names(file)?;
                // A part `mask` of another tool may have another meaning.
                let mask = match &known {
                    Some(_) if parts.len() > 1 => ExrFile::read(file)?.mask(),
                    _ => None,
                };
                let exposures = known.and_then(|known| known.exposures);
                let chromaticities = ExrFile::chromaticities(file)?;
                Ok(Self { image, exposures, parts, mask, chromaticities, is_png: false })
            }
            // The content determines the format, not the name.
            Err(ImageError::Corrupt { format: ImageFormat::OpenExr, .. }) => {
                let image = Image::read(file)?;
                let (exposures, parts, mask) = (None, Vec::new(), None);
                // sRGB has the primaries of BT.709.
                let chromaticities = ExrFile::BT709;
                Ok(Self { image, exposures, parts, mask, chromaticities, is_png: true })
            }
            Err(error) => Err(error.into()),
        }
    }
}
