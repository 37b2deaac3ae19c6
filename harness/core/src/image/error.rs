//! Errors of reading and writing image files.

use std::path::Path;

use crate::diagnostic::shown;

/// A format of image files.
///
/// ```
/// assert_eq!(karat::unstable::image::ImageFormat::Png.to_string(), "PNG");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ImageFormat {
    /// OpenEXR: floats in named channels.
    OpenExr,
    /// PNG: integers, usually encoded as sRGB.
    Png,
}

impl std::fmt::Display for ImageFormat {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::OpenExr => "OpenEXR",
            Self::Png => "PNG",
        })
    }
}

/// The reason why an image file can't be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImageError {
    /// There is no such file.
    #[error("there is no image `{path}`")]
    Missing {
        /// The path of the file.
        path: String,
    },
    /// The file can't be read.
    #[error("can't read `{path}`: {cause}")]
    Read {
        /// The path of the file.
        path: String,
        /// The reason for the failure.
        cause: std::io::Error,
    },
    /// The file is a Git LFS pointer.
    #[error("`{path}` is a Git LFS pointer, not an image; run `git lfs pull`")]
    LfsPointer {
        /// The path of the file.
        path: String,
    },
    /// The file is damaged, is larger than the limits allow, or uses features that Karat doesn't support.
    #[error("`{path}` isn't a readable {format} image: {reason}")]
    Corrupt {
        /// The path of the file.
        path: String,
        /// The format that Karat expected.
        format: ImageFormat,
        /// The problem with the file.
        reason: String,
    },
    /// The file is neither OpenEXR nor PNG.
    #[error("`{path}` is neither an OpenEXR nor a PNG image: it is {found}")]
    Unknown {
        /// The path of the file.
        path: String,
        /// The format that the file's first bytes suggest.
        found: &'static str,
    },
    /// A part of an OpenEXR file can't have this name.
    #[error("an image's part can't have the name `{name}`: {reason}")]
    PartName {
        /// The name of the part.
        name: String,
        /// The reason for the failure.
        reason: &'static str,
    },
    /// The file can't be written.
    #[error("can't write `{path}`: {cause}")]
    Write {
        /// The path of the file.
        path: String,
        /// The reason for the failure.
        cause: std::io::Error,
    },
}

impl ImageError {
    /// A closure for `map_err` that makes a [`Corrupt`](Self::Corrupt) error from a reason.
    pub(super) fn corrupt(path: &Path, format: ImageFormat) -> impl FnOnce(String) -> Self {
        move |reason| Self::Corrupt { path: shown(path), format, reason }
    }
}
