//! OpenEXR files, in and out.
//!
//! A file may be hostile or damaged: one flipped byte of a header can announce gigabytes. The
//! header is read first, and what it announces is checked against the file's size before anything
//! is decoded. Files are written beside their place and then renamed, so a full disk never leaves
//! half a file.

use std::io::Cursor;
use std::path::Path;

use exr::prelude::{
    AttributeValue, Compression, Encoding, Layer, LayerAttributes, MetaData, ReadChannels,
    ReadLayers, SpecificChannels, Text, Vec2, WritableImage,
};
use half::f16;

use super::Image;
use crate::diagnostic::shown;

/// Longest side that is read: a 16k texture.
const LONGEST_SIDE: usize = 16_384;
/// Most channels that are read; no renderer's beauty part has more.
const MOST_CHANNELS: usize = 32;
/// Most memory that a decoded file may take.
const LARGEST_DECODED: usize = 512 << 20;
/// ZIP reaches about 1000:1 on constant images; more than twice that is no image.
const LARGEST_RATIO: usize = 2000;
/// The one attribute that holds all metadata: the encoder writes several in random order.
const ATTRIBUTE: &str = "karat";

/// How samples are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Precision {
    /// 16-bit floats: relative steps of 2^-11 = 4.9e-4.
    Half,
    /// 32-bit floats.
    Float,
}

/// Why an image file can't be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImageError {
    /// There is no such file.
    #[error("there is no image `{path}`")]
    Missing {
        /// The file.
        path: String,
    },
    /// The file can't be read.
    #[error("can't read `{path}`: {source}")]
    Read {
        /// The file.
        path: String,
        /// Why.
        source: std::io::Error,
    },
    /// The file is a Git LFS pointer.
    #[error("`{path}` is a Git LFS pointer, not an image; run `git lfs pull`")]
    LfsPointer {
        /// The file.
        path: String,
    },
    /// The file isn't a sound OpenEXR image.
    #[error("`{path}` isn't a readable OpenEXR image: {reason}")]
    Corrupt {
        /// The file.
        path: String,
        /// What is wrong.
        reason: String,
    },
    /// The file can't be written.
    #[error("can't write `{path}`: {source}")]
    Write {
        /// The file.
        path: String,
        /// Why.
        source: std::io::Error,
    },
}

impl Image {
    /// Reads the first layer with R, G and B channels (A is 1 where missing), and the metadata that
    /// [`write_exr`](Self::write_exr) stored.
    ///
    /// # Errors
    /// If the file is missing, unreadable, damaged, or larger than an image of its size on disk
    /// can be.
    pub fn read_exr(path: &Path) -> Result<(Self, Option<String>), ImageError> {
        let bytes = std::fs::read(path).map_err(|source| match source.kind() {
            std::io::ErrorKind::NotFound => ImageError::Missing { path: shown(path) },
            _ => ImageError::Read { path: shown(path), source },
        })?;
        Self::decode_exr(&bytes, path)
    }

    fn decode_exr(bytes: &[u8], path: &Path) -> Result<(Self, Option<String>), ImageError> {
        let corrupt = |reason: String| ImageError::Corrupt { path: shown(path), reason };
        if bytes.starts_with(b"version https://git-lfs") {
            return Err(ImageError::LfsPointer { path: shown(path) });
        }
        let meta = MetaData::read_from_buffered(Cursor::new(bytes), false)
            .map_err(|error| corrupt(error.to_string()))?;
        let mut decoded = 0_usize;
        for header in &meta.headers {
            let Vec2(width, height) = header.layer_size;
            let channels = header.channels.list.len();
            if width.max(height) > LONGEST_SIDE || channels > MOST_CHANNELS {
                return Err(corrupt(format!(
                    "its header announces {width} x {height} pixels of {channels} channels"
                )));
            }
            decoded = decoded.saturating_add(width * height * channels.max(4) * 4);
        }
        if decoded > LARGEST_DECODED || decoded > bytes.len().saturating_mul(LARGEST_RATIO) {
            return Err(corrupt(format!(
                "its header announces {decoded} bytes of pixels in a file of {}",
                bytes.len()
            )));
        }
        let image = exr::prelude::read()
            .no_deep_data()
            .largest_resolution_level()
            .rgba_channels(
                |size, _| (size, vec![[0.0_f32; 4]; size.area()]),
                |(size, pixels), at, (r, g, b, a): (f32, f32, f32, f32)| {
                    pixels[at.y() * size.width() + at.x()] = [r, g, b, a];
                },
            )
            .first_valid_layer()
            .all_attributes()
            .non_parallel()
            .from_buffered(Cursor::new(bytes))
            .map_err(|error| corrupt(error.to_string()))?;
        let text = Text::from(ATTRIBUTE);
        let metadata = match image.layer_data.attributes.other.get(&text) {
            Some(AttributeValue::Text(text)) => Some(text.to_string()),
            _ => None,
        };
        let (size, pixels) = image.layer_data.channel_data.pixels;
        let side = |length: usize| {
            u32::try_from(length).map_err(|_| corrupt("a side doesn't fit in 32 bits".to_owned()))
        };
        Ok((Self::new(side(size.width())?, side(size.height())?, pixels), metadata))
    }

    /// Writes an OpenEXR file, with `metadata` as its one attribute of ours. The same image and
    /// metadata give the same bytes.
    ///
    /// # Errors
    /// If the folder or file can't be written. Nothing is left in the file's place then.
    pub fn write_exr(
        &self,
        path: &Path,
        precision: Precision,
        metadata: Option<&str>,
    ) -> Result<(), ImageError> {
        let failed = |source| ImageError::Write { path: shown(path), source };
        let bytes = self
            .encode_exr(precision, metadata)
            .map_err(|error| failed(std::io::Error::other(error.to_string())))?;
        write_whole(path, &bytes).map_err(failed)
    }

    fn encode_exr(
        &self,
        precision: Precision,
        metadata: Option<&str>,
    ) -> Result<Vec<u8>, exr::error::Error> {
        let at =
            |position: Vec2<usize>| self.pixels[position.y() * self.width as usize + position.x()];
        let mut bytes = Cursor::new(Vec::new());
        // Scan lines of 16 rows, deflated: small, and read by every tool.
        let encoding = Encoding { compression: Compression::ZIP16, ..Encoding::SMALL_LOSSLESS };
        let size = (self.width as usize, self.height as usize);
        macro_rules! write {
            ($pixel:expr) => {{
                let channels = SpecificChannels::rgba($pixel);
                let mut attributes = LayerAttributes::default();
                if let Some(metadata) = metadata {
                    let value = AttributeValue::Text(Text::from(metadata));
                    attributes.other.insert(Text::from(ATTRIBUTE), value);
                }
                let layer = Layer::new(size, attributes, encoding, channels);
                let image = exr::image::Image::from_layer(layer);
                image.write().non_parallel().to_buffered(&mut bytes)?;
            }};
        }
        match precision {
            Precision::Half => {
                write!(|position| <(f16, f16, f16, f16)>::from(at(position).map(f16::from_f32)))
            }
            Precision::Float => write!(|position| <(f32, f32, f32, f32)>::from(at(position))),
        }
        Ok(bytes.into_inner())
    }
}

/// Writes a file beside its place, then renames it there.
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    if let Some(folder) = folder {
        std::fs::create_dir_all(folder)?;
    }
    let beside = path.with_extension(format!("tmp{}", std::process::id()));
    let written = std::fs::write(&beside, bytes).and_then(|()| std::fs::rename(&beside, path));
    if written.is_err() {
        // The error that matters is the first one.
        drop(std::fs::remove_file(&beside));
    }
    written
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gradient() -> Image {
        let pixels = (0..20 * 12).map(|i| {
            let value = i as f32 * 0.37;
            [value, value * value, 1.0 / (1.0 + value), 1.0]
        });
        Image::new(20, 12, pixels.collect())
    }

    #[test]
    fn files_give_back_what_was_written_and_are_the_same_each_time() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("a.exr");
        for precision in [Precision::Half, Precision::Float] {
            gradient().write_exr(&path, precision, Some("{\"a\":1}")).expect("written");
            let first = std::fs::read(&path).expect("readable");
            let (image, metadata) = Image::read_exr(&path).expect("readable");
            assert_eq!(image, gradient().rounded_to(precision));
            assert_eq!(metadata.as_deref(), Some("{\"a\":1}"));
            gradient().write_exr(&path, precision, Some("{\"a\":1}")).expect("written");
            assert_eq!(std::fs::read(&path).expect("readable"), first);
        }
        let left: Vec<_> = std::fs::read_dir(folder.path()).expect("a folder").collect();
        assert_eq!(left.len(), 1, "no temporary file stays behind");
    }

    #[test]
    fn damaged_files_are_errors_and_take_no_memory() {
        let bytes = gradient().encode_exr(Precision::Half, None).expect("encodes");
        let decode = |bytes: &[u8]| Image::decode_exr(bytes, Path::new("damaged.exr"));
        assert!(decode(&bytes).is_ok());
        assert!(matches!(decode(&[]), Err(ImageError::Corrupt { .. })));
        let pointer = b"version https://git-lfs.github.com/spec/v1\n";
        assert!(matches!(decode(pointer), Err(ImageError::LfsPointer { .. })));
        for length in (0..bytes.len()).step_by(7) {
            assert!(decode(&bytes[..length]).is_err(), "cut to {length} bytes");
        }
        // The data window's upper corner, made huge.
        let window = bytes.windows(10).position(|w| w == b"dataWindow").expect("has one");
        let mut huge = bytes.clone();
        huge[window + 10 + 1 + 6 + 4 + 8 + 2] = 0x7f;
        assert!(matches!(decode(&huge), Err(ImageError::Corrupt { .. })));
    }

    #[test]
    fn an_unwritable_place_is_an_error() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = folder.path().join("file");
        std::fs::write(&file, "x").expect("written");
        let error = gradient().write_exr(&file.join("a.exr"), Precision::Half, None);
        assert!(matches!(error, Err(ImageError::Write { .. })));
        assert!(matches!(
            Image::read_exr(&folder.path().join("no.exr")),
            Err(ImageError::Missing { .. })
        ));
    }
}
