//! Reads files that may be images, and checks their size and their first bytes.

use std::fs::File;
use std::io::{Error, ErrorKind, Read};
use std::path::Path;

use super::ImageError;
use crate::diagnostic::shown;

/// The longest side, in pixels, of an image that Karat reads or writes. Many GPUs support no larger textures.
pub(super) const LONGEST_SIDE: u32 = 16_384;
/// The largest number of bytes for the pixels of a file, and the largest length of a file that Karat reads.
pub(super) const LARGEST_DECODED: u64 = 512 << 20;
/// The largest ratio of the size of an image's pixels to the size of its file, both in bytes. Deflate reaches 1032:1 on
/// constant images, so a file whose header announces a much larger ratio is damaged or hostile.
pub(super) const LARGEST_RATIO: u64 = 2000;

/// The first bytes of the formats that Karat recognizes, each with the name of the format.
const BEGINNINGS: [(&[u8], &str); 10] = [
    (&exr::meta::magic_number::BYTES, "an OpenEXR image"),
    (PNG, "a PNG image"),
    (b"\xff\xd8\xff", "a JPEG image"),
    (b"#?R", "a Radiance HDR image"),
    (b"II*\0", "a TIFF image"),
    (b"MM\0*", "a TIFF image"),
    (b"DDS ", "a DDS texture"),
    (b"\xabKTX", "a KTX texture"),
    (b"GIF8", "a GIF image"),
    (b"RIFF", "a RIFF file, perhaps a WebP image"),
];
pub(super) const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";

/// The name of the format that a file's first bytes indicate, for a message about an unexpected format.
pub(super) fn found(bytes: &[u8]) -> &'static str {
    let known = BEGINNINGS.iter().find(|(beginning, _)| bytes.starts_with(beginning));
    match known {
        Some((_, name)) => name,
        None if bytes.is_empty() => "empty",
        None => "of an unknown format",
    }
}

/// Reads a file. Fails if the file is longer than [`LARGEST_DECODED`], or is a Git LFS pointer.
pub(super) fn bytes(path: &Path) -> Result<Vec<u8>, ImageError> {
    let failed = |cause: Error| match cause.kind() {
        ErrorKind::NotFound => ImageError::Missing { path: shown(path) },
        _ => ImageError::Read { path: shown(path), cause },
    };
    // On some systems opening a folder succeeds, and on others the error is "permission denied".
    if path.is_dir() {
        return Err(failed(Error::new(ErrorKind::IsADirectory, "it is a folder")));
    }
    let file = File::open(path).map_err(failed)?;
    let announced = file.metadata().map_err(failed)?.len();
    let mut bytes = Vec::new();
    if announced <= LARGEST_DECODED {
        // A device file or a pipe has no known length, and may have no end.
        file.take(LARGEST_DECODED + 1).read_to_end(&mut bytes).map_err(failed)?;
    }
    let length = announced.max(bytes.len() as u64);
    if length > LARGEST_DECODED {
        let reason = format!("the file is longer than {} MB", LARGEST_DECODED >> 20);
        return Err(failed(Error::new(ErrorKind::FileTooLarge, reason)));
    }
    if bytes.starts_with(b"version https://git-lfs") {
        return Err(ImageError::LfsPointer { path: shown(path) });
    }
    Ok(bytes)
}
