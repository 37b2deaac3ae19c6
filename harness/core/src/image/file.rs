//! Files of images, whatever their format.

use std::path::Path;

use super::bytes::{PNG, bytes, found};
use super::png::{Samples, decode};
use super::{ExrFile, Image, ImageError, ImageFormat};
use crate::diagnostic::shown;

impl Image {
    /// Reads an image of either format, told by its content and not by its name: OpenEXR as
    /// [`read_exr`](Self::read_exr) does, or PNG.
    ///
    /// A PNG is made linear: its values are taken to be sRGB-encoded, unless it has a gAMA chunk
    /// and no sRGB chunk. Colour profiles and cICP chunks are ignored. Greys become RGB. Alpha
    /// stays as it is, not multiplied into the colours; it is 1 if the file has none. The first
    /// frame of an animation is read.
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
    /// If the file is missing, unreadable, damaged, of another format or too large.
    pub fn read(path: &Path) -> Result<Self, ImageError> {
        Self::read_as(path, Samples::Colours)
    }

    /// [`read`](Self::read) without making a PNG linear: each value is divided by the largest that
    /// its samples can have. Use it for numbers that aren't colours, such as a painted
    /// [`Mask`](crate::metric::Mask): what a paint program calls 50 % is read as a half.
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
    /// As for [`read`](Self::read).
    ///
    /// *Unstable*: for programs around tests.
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
