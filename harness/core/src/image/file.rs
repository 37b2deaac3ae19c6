//! Reads image files of any supported format.

use std::path::Path;

use super::bytes::{PNG, bytes, found};
use super::png::{Samples, decode};
use super::{ExrFile, Image, ImageError, ImageFormat};
use crate::diagnostic::shown;

impl Image {
    /// Reads an OpenEXR image, as [`read_exr`](Self::read_exr) does, or a PNG image. The function recognizes the format
    /// by the file's content, not by its name.
    ///
    /// The colours of a PNG are converted to linear values. Karat decodes them as sRGB, or by the gAMA chunk if the
    /// file has a gAMA chunk and no sRGB chunk. Karat ignores colour profiles and cICP chunks. Greys become RGB. Alpha
    /// isn't converted, and the colours aren't multiplied by alpha. If the file has no alpha, alpha is 1. From an
    /// animation, Karat reads the first frame.
    ///
    /// ```no_run
    /// use karat::Image;
    ///
    /// let golden = Image::read("golden/dusk.exr".as_ref())?;
    /// println!("{} x {}", golden.width(), golden.height());
    /// # Ok::<(), karat::image::ImageError>(())
    /// ```
    ///
    /// # Errors
    /// Returns an error if the file is missing, unreadable, damaged, of another format or too large.
    pub fn read(path: &Path) -> Result<Self, ImageError> {
        Self::read_as(path, Samples::Colours)
    }

    /// Like [`read`](Self::read), but doesn't convert a PNG to linear values: each value is the sample divided by the
    /// largest possible sample. Use this function for images of numbers that aren't colours, such as a painted
    /// [`Mask`](crate::metric::Mask): a grey of 50 % in a paint program becomes 0.5.
    ///
    /// ```no_run
    /// use karat::Image;
    ///
    /// let stored = Image::read_stored("screenshot.png".as_ref())?; // 0 to 1, as encoded
    /// # let _ = stored;
    /// # Ok::<(), karat::image::ImageError>(())
    /// ```
    ///
    /// # Errors
    /// The same errors as for [`read`](Self::read).
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn read_stored(path: &Path) -> Result<Self, ImageError> {
        Self::read_as(path, Samples::Data)
    }

    fn read_as(path: &Path, samples: Samples) -> Result<Self, ImageError> {
        let bytes = bytes(path)?;
        if bytes.starts_with(&exr::meta::magic_number::BYTES) {
            let (image, _) = ExrFile::decode_first(&bytes)
                .map_err(ImageError::corrupt(path, ImageFormat::OpenExr))?;
            return Ok(image.read_from(path, &bytes));
        }
        if bytes.starts_with(PNG) {
            let image =
                decode(&bytes, samples).map_err(ImageError::corrupt(path, ImageFormat::Png))?;
            return Ok(image.read_from(path, &bytes));
        }
        Err(ImageError::Unknown { path: shown(path), found: found(&bytes) })
    }
}
