//! The variance of a noisy frame, stored beside it: `scene.variance.exr` of `scene.exr`.

use std::path::{Path, PathBuf};

use crate::image::{Image, ImageError, Precision};

/// The file of a golden's or a pending frame's variance.
pub(super) fn file(image: &Path) -> PathBuf {
    image.with_extension("variance.exr")
}

/// `None`: the image has no variance.
pub(super) fn read(image: &Path) -> Result<Option<Image>, ImageError> {
    match Image::read_exr(&file(image)) {
        Ok((variance, _)) => Ok(Some(variance)),
        Err(ImageError::Missing { .. }) => Ok(None),
        Err(error) => Err(error),
    }
}

/// Half floats hold no variance below 6e-8, so it is stored in floats, of which seven bits of the
/// mantissa are kept: more says nothing of a variance, and doesn't compress.
pub(super) fn write(image: &Path, variance: &Image) -> Result<(), ImageError> {
    let mut coarse = variance.clone();
    for value in coarse.pixels_mut().iter_mut().flatten() {
        *value = f32::from_bits(value.to_bits() & 0xffff_0000);
    }
    coarse.write_exr(&file(image), Precision::Float, None)
}
