//! The parts (images) of a golden's EXR file: the frame, and further data about the frame's pixels.

use std::io::{Error, ErrorKind};
use std::path::Path;

use crate::diagnostic::shown;
use crate::image::{ExrFile, Image, ImageError, Part, Precision};
use crate::metric::{MASK, Mask};

/// Name of the part with the frame itself, which is always the first part of the file.
pub const COLOR: &str = "color";
/// Name of the part with the variance of each pixel of a noisy frame.
pub(crate) const VARIANCE: &str = "color.variance";

/// Fails if the path is a pipe or a device, because Karat would wait forever for its content. Also fails if the path is
/// a broken link: the golden exists, but its content is missing.
pub(super) fn check_file(path: &Path) -> Result<(), ImageError> {
    let refused = |kind, what: &str| {
        let cause = Error::new(kind, what);
        Err(ImageError::Read { path: shown(path), cause })
    };
    match path.metadata() {
        Ok(known) if !(known.is_file() || known.is_dir()) => {
            refused(ErrorKind::InvalidInput, "it is neither a file nor a link to a file")
        }
        Err(_) if path.symlink_metadata().is_ok() => {
            let what = "it is a link to a file that doesn't exist; fetch that file";
            refused(ErrorKind::InvalidInput, what)
        }
        // Reading the file reports other errors.
        _ => Ok(()),
    }
}

/// Reads a part of a file. Returns `None` if the file has no part of this name.
pub(super) fn read(path: &Path, name: &str) -> Result<Option<Image>, ImageError> {
    let parts = ExrFile::read(path)?.parts;
    Ok(parts.into_iter().find(|part| part.name == name).map(|part| part.image))
}

/// Makes the part that stores a variance. The part has 32-bit floats, because half floats can't represent a variance
/// below 6e-8. The part keeps seven bits of the mantissa: further bits aren't significant and don't compress.
pub(super) fn variance(image: &Image) -> Part {
    let mut coarse = image.clone();
    for value in coarse.pixels_mut().iter_mut().flatten() {
        *value = f32::from_bits(value.to_bits() & 0xffff_0000);
    }
    Part::new(VARIANCE, Precision::Float, coarse)
}

/// Makes the part that stores a mask. Returns `None` if the mask can't be used for a frame of this size.
pub(super) fn mask(mask: &Mask, width: u32, height: u32) -> Option<Part> {
    Some(Part::new(MASK, Precision::Half, mask.to_image(width, height).ok()?))
}

/// Checks if the frame has a NaN or infinite pixel. If one of the parts is a mask, pixels outside of the mask don't
/// count.
pub(super) fn non_finite(parts: &[Part]) -> bool {
    let Some(color) = parts.first() else { return false };
    let mask = parts.iter().find(|part| part.name == MASK).map(|part| part.image.pixels());
    let counts =
        |index: usize| mask.and_then(|mask| mask.get(index)).is_none_or(|flag| flag[0] > 0.5);
    let pixels = color.image.pixels().iter().enumerate();
    let mut broken = pixels.filter(|(_, pixel)| !pixel.iter().all(|value| value.is_finite()));
    broken.any(|(index, _)| counts(index))
}
