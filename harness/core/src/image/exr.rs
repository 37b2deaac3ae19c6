//! Reads and writes OpenEXR files.
//!
//! A file may be hostile or damaged: one wrong byte in a header can announce gigabytes. So `header` checks the header
//! against the file's length and Karat's limits before Karat reserves memory, and `chunks` and `guard` check each chunk
//! before it is decompressed. The `exr` crate decompresses the chunks, and compresses and writes new files.

mod block;
mod chunks;
mod guard;
mod header;
mod select;
mod write;

use std::path::Path;

use half::f16;
use half::slice::HalfFloatSliceExt;

use self::header::{FileHeader, PartHeader, Sample, shown};
use self::select::{Selection, select};
use super::bytes::bytes;
use super::{Image, ImageError, ImageFormat};

/// The number format in which a file stores samples.
///
/// ```
/// use karat::Image;
/// use karat::image::Precision;
///
/// let tenth = Image::new(1, 1, vec![[0.1; 4]]);
/// assert_ne!(tenth.rounded_to(Precision::Half), tenth);
/// assert_eq!(tenth.rounded_to(Precision::Float), tenth);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Precision {
    /// 16-bit floats, with relative rounding errors of at most 2^-11 = 4.9e-4.
    Half,
    /// 32-bit floats.
    Float,
}

/// An OpenEXR file of one or more parts: a frame, and further data about the frame's pixels, such as their variance.
///
/// ```no_run
/// use karat::Image;
/// use karat::image::Precision;
/// use karat::unstable::image::{ExrFile, Part};
///
/// let image = |value| Image::new(1, 1, vec![[value; 4]]);
/// let frame = Part::new("frame", Precision::Half, image(0.5));
/// let variance = Part::new("variance", Precision::Float, image(1e-7));
/// ExrFile { parts: vec![frame, variance], metadata: None }.write("room.exr".as_ref())?;
/// # Ok::<(), karat::image::ImageError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct ExrFile {
    /// The parts. The first part is the frame.
    pub parts: Vec<Part>,
    /// The value of the first part's string attribute `karat`.
    pub metadata: Option<String>,
}

/// A named image of an [`ExrFile`].
///
/// ```
/// use karat::Image;
/// use karat::image::Precision;
/// use karat::unstable::image::Part;
///
/// let part = Part::new("normal", Precision::Half, Image::new(1, 1, vec![[0.0, 0.0, 1.0, 1.0]]));
/// assert_eq!(part.name, "normal");
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// The part's name, of at most 255 letters, digits, `-`, `_` and `.`. In a file of one part, the name may be empty.
    pub name: String,
    /// The format of the part's samples. Values above 65504 or below 6e-8, such as variances, need `Float`.
    pub precision: Precision,
    /// The part's pixels.
    pub image: Image,
}

impl Part {
    /// Makes a part.
    ///
    /// ```
    /// use karat::Image;
    /// use karat::image::Precision;
    /// use karat::unstable::image::Part;
    ///
    /// let part = Part::new("variance", Precision::Float, Image::new(1, 1, vec![[1e-7; 4]]));
    /// # let _ = part;
    /// ```
    #[must_use]
    pub fn new(name: impl Into<String>, precision: Precision, image: Image) -> Self {
        Self { name: name.into(), precision, image }
    }
}

impl ExrFile {
    /// The primaries of ITU-R BT.709 with the white point D65. An `OpenEXR` file that states no primaries uses these
    /// primaries.
    pub const BT709: [f32; 8] = [0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290];

    /// Reads all parts that contain colours or greys. The function skips other parts (depth, normals).
    ///
    /// From each part, the function reads the channels R, G, B and A, or Y and A. If a part has several sets of
    /// channels, the function prefers colours to greys, and channels without a layer (`R`) to channels of a layer
    /// (`beauty.R`). If the channel A is missing, alpha is 1. A grey part's Y becomes R, G and B. Samples may be 16-bit
    /// or 32-bit floats or 32-bit unsigned integers, and become `f32`. The image has the size of the part's data
    /// window, wherever the window is in the display window. If a part has several mip levels, the function reads the
    /// largest. The function doesn't convert colours: they keep the file's [`chromaticities`](Self::chromaticities).
    ///
    /// ```no_run
    /// use karat::unstable::image::ExrFile;
    ///
    /// for part in ExrFile::read("golden/room.exr".as_ref())?.parts {
    ///     println!("{}: {} x {}", part.name, part.image.width(), part.image.height());
    /// }
    /// # Ok::<(), karat::image::ImageError>(())
    /// ```
    ///
    /// # Errors
    /// Returns an error if the file is missing, unreadable or damaged; if the file is longer than 512 MB; if a side is
    /// longer than 16384 pixels; if a part has over 32 channels; or if a part's pixels take over 512 MB or over 2000
    /// times the file's length. Deep data, subsampled chroma and the compressions HTJ2K, ZSTD and LJ2K aren't
    /// supported.
    pub fn read(path: &Path) -> Result<Self, ImageError> {
        Self::decode(&bytes(path)?).map_err(ImageError::corrupt(path, ImageFormat::OpenExr))
    }

    fn decode(bytes: &[u8]) -> Result<Self, String> {
        let mut file = FileHeader::parse(bytes)?;
        let mut parts = Vec::new();
        for index in 0..file.parts.len() {
            let Some(selection) = select(&file.parts[index]) else { continue };
            let image = decode(bytes, &file, index, &selection)?;
            let name = std::mem::take(&mut file.parts[index].name);
            parts.push(Part { name, precision: selection.precision, image });
        }
        if parts.is_empty() {
            return Err(colourless(&file));
        }
        Ok(Self { parts, metadata: file.parts.swap_remove(0).metadata })
    }

    /// Decodes the first part with colours, or else the first part with greys. Also returns the metadata of the file's
    /// first part.
    pub(super) fn decode_first(bytes: &[u8]) -> Result<(Image, Option<String>), String> {
        let mut file = FileHeader::parse(bytes)?;
        let (index, selection) = first(&file).ok_or_else(|| colourless(&file))?;
        let image = decode(bytes, &file, index, &selection)?;
        Ok((image, file.parts.swap_remove(0).metadata))
    }

    /// The names of the parts that [`read`](Self::read) would read. The function doesn't decode pixels. The part that
    /// [`Image::read_exr`] would read comes first, and the other parts follow in the file's order.
    ///
    /// ```no_run
    /// use karat::unstable::image::ExrFile;
    ///
    /// println!("{:?}", ExrFile::part_names("golden/room.exr".as_ref())?);
    /// # Ok::<(), karat::image::ImageError>(())
    /// ```
    ///
    /// # Errors
    /// The same errors as for [`read`](Self::read), except that the function doesn't notice damaged pixels.
    pub fn part_names(path: &Path) -> Result<Vec<String>, ImageError> {
        let names = |bytes: &[u8]| {
            let file = FileHeader::parse(bytes)?;
            let (index, _) = first(&file).ok_or_else(|| colourless(&file))?;
            let others = file
                .parts
                .iter()
                .enumerate()
                .filter(|(other, part)| *other != index && select(part).is_some());
            let all = std::iter::once(&file.parts[index]).chain(others.map(|(_, part)| part));
            Ok(all.map(|part| part.name.clone()).collect())
        };
        names(&bytes(path)?).map_err(ImageError::corrupt(path, ImageFormat::OpenExr))
    }

    /// The primaries of the part that [`Image::read_exr`] reads: the CIE x and y of red, green, blue and white. Returns
    /// [`Self::BT709`] if the file has no primaries.
    ///
    /// ```no_run
    /// use karat::unstable::image::ExrFile;
    ///
    /// let [red_x, red_y, ..] = ExrFile::chromaticities("golden/room.exr".as_ref())?;
    /// println!("red is at {red_x}, {red_y}");
    /// # Ok::<(), karat::image::ImageError>(())
    /// ```
    ///
    /// # Errors
    /// The same errors as for [`read`](Self::read), except that the function doesn't notice damaged pixels.
    pub fn chromaticities(path: &Path) -> Result<[f32; 8], ImageError> {
        let of = |bytes: &[u8]| {
            let file = FileHeader::parse(bytes)?;
            let (index, _) = first(&file).ok_or_else(|| colourless(&file))?;
            // Writers store attributes that all parts share only in the first part.
            let parts = [&file.parts[index], &file.parts[0]];
            Ok(parts.iter().find_map(|part| part.chromaticities).unwrap_or(Self::BT709))
        };
        of(&bytes(path)?).map_err(ImageError::corrupt(path, ImageFormat::OpenExr))
    }

    /// Writes the file, with the metadata as its attribute `karat`. The same parts and metadata always give the same
    /// bytes. An existing file is replaced completely or not at all.
    ///
    /// ```no_run
    /// use karat::Image;
    /// use karat::image::Precision;
    /// use karat::unstable::image::{ExrFile, Part};
    ///
    /// let grey = Part::new("", Precision::Half, Image::new(1, 1, vec![[0.5; 4]]));
    /// ExrFile { parts: vec![grey], metadata: None }.write("grey.exr".as_ref())?;
    /// # Ok::<(), karat::image::ImageError>(())
    /// ```
    ///
    /// # Errors
    /// Returns an error if there are no parts, if a part's name has invalid characters or occurs twice, if a side is 0
    /// or longer than 16384 pixels, or if the folder or file can't be written.
    pub fn write(&self, path: &Path) -> Result<(), ImageError> {
        write::write(path, &self.layers(), self.metadata.as_deref())
    }

    /// The bytes that [`write`](Self::write) would write. Errors name `path`.
    #[doc(hidden)]
    pub fn bytes(&self, path: &Path) -> Result<Vec<u8>, ImageError> {
        write::bytes(path, &self.layers(), self.metadata.as_deref())
    }

    fn layers(&self) -> Vec<write::Layer<'_>> {
        let parts = self.parts.iter();
        parts
            .map(|Part { name, precision, image }| write::Layer {
                name,
                precision: *precision,
                image,
            })
            .collect()
    }
}

impl Image {
    /// Reads one part: the first part with colours, or else the first part with greys. [`ExrFile::read`] describes the
    /// supported channels and formats. Also reads the metadata of the file's first part. Other parts aren't decoded.
    ///
    /// ```no_run
    /// use karat::Image;
    ///
    /// let (golden, facts) = Image::read_exr("golden/dusk.exr".as_ref())?;
    /// println!("{} pixels, {facts:?}", golden.pixels().len());
    /// # Ok::<(), karat::image::ImageError>(())
    /// ```
    ///
    /// # Errors
    /// The same errors as for [`ExrFile::read`].
    pub fn read_exr(path: &Path) -> Result<(Self, Option<String>), ImageError> {
        let bytes = bytes(path)?;
        let (image, metadata) = ExrFile::decode_first(&bytes)
            .map_err(ImageError::corrupt(path, ImageFormat::OpenExr))?;
        Ok((image.read_from(path, &bytes), metadata))
    }

    /// Writes an OpenEXR file as [`ExrFile::write`] does, with this image as its only part. The part has no name.
    ///
    /// ```no_run
    /// use karat::Image;
    /// use karat::image::Precision;
    ///
    /// let grey = Image::new(1, 1, vec![[0.5; 4]]);
    /// grey.write_exr("grey.exr".as_ref(), Precision::Half, None)?;
    /// # Ok::<(), karat::image::ImageError>(())
    /// ```
    ///
    /// # Errors
    /// The same errors as for [`ExrFile::write`].
    pub fn write_exr(
        &self,
        path: &Path,
        precision: Precision,
        metadata: Option<&str>,
    ) -> Result<(), ImageError> {
        write::write(path, &[write::Layer { name: "", precision, image: self }], metadata)
    }
}

/// The index of the first part with colours, or else of the first part with greys.
fn first(file: &FileHeader) -> Option<(usize, Selection)> {
    let selected = || file.parts.iter().map(select).enumerate();
    selected()
        .find_map(|(index, selection)| Some((index, selection.filter(|s| s.coloured)?)))
        .or_else(|| selected().find_map(|(index, selection)| Some((index, selection?))))
}

fn colourless(file: &FileHeader) -> String {
    let names = file.parts.iter().flat_map(|part| &part.channels);
    let names: Vec<_> = names.map(|channel| shown(&channel.name)).take(8).collect();
    format!(
        "the file has neither the channels R, G and B nor the channel Y; its channels are {}",
        names.join(", ")
    )
}

fn decode(
    bytes: &[u8],
    file: &FileHeader,
    index: usize,
    selection: &Selection,
) -> Result<Image, String> {
    let PartHeader { width, height, channels, .. } = &file.parts[index];
    let row = *width as usize;
    let mut pixels = vec![[0.0, 0.0, 0.0, 1.0]; row * *height as usize];
    let mut samples = vec![0.0; row];
    chunks::decode(bytes, file, index, |block, mut data| {
        let samples = &mut samples[..block.width];
        for y in block.y..block.y + block.height {
            let pixels = &mut pixels[y * row + block.x..][..block.width];
            for (channel, fills) in channels.iter().zip(&selection.fills) {
                let (line, rest) = data.split_at(block.width * channel.sample.bytes());
                data = rest;
                if !fills.is_empty() {
                    convert(line, channel.sample, samples);
                }
                for &fill in *fills {
                    for (pixel, sample) in pixels.iter_mut().zip(&*samples) {
                        pixel[fill] = *sample;
                    }
                }
            }
        }
    })?;
    Ok(Image::new(*width, *height, pixels))
}

/// Converts samples to `f32`. The codecs return samples in the machine's byte order.
fn convert(line: &[u8], sample: Sample, samples: &mut [f32]) {
    match sample {
        Sample::Half => {
            let halves = line.as_chunks().0.iter().map(|bytes| f16::from_ne_bytes(*bytes));
            let halves: Vec<f16> = halves.collect();
            halves.convert_to_f32_slice(samples);
        }
        Sample::Float => {
            for (value, bytes) in samples.iter_mut().zip(line.as_chunks().0) {
                *value = f32::from_ne_bytes(*bytes);
            }
        }
        Sample::Uint => {
            for (value, bytes) in samples.iter_mut().zip(line.as_chunks().0) {
                #[expect(clippy::cast_precision_loss, reason = "an image has no other numbers")]
                let number = u32::from_ne_bytes(*bytes) as f32;
                *value = number;
            }
        }
    }
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

    fn encoded(image: &Image, precision: Precision) -> Vec<u8> {
        write::encode(&[write::Layer { name: "", precision, image }], None).expect("encodes")
    }

    #[test]
    fn exr_files_round_trip_and_are_reproducible() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("a.exr");
        // The metadata contain a reviewer's reason, which may be any text.
        let metadata = Some("{\"because\":\"größer → kleiner\"}");
        for precision in [Precision::Half, Precision::Float] {
            gradient().write_exr(&path, precision, metadata).expect("written");
            let first = std::fs::read(&path).expect("readable");
            let (image, read) = Image::read_exr(&path).expect("readable");
            assert_eq!(image, gradient().rounded_to(precision));
            assert_eq!(read.as_deref(), metadata);
            gradient().write_exr(&path, precision, metadata).expect("written");
            assert_eq!(std::fs::read(&path).expect("readable"), first);
        }
        let left: Vec<_> = std::fs::read_dir(folder.path()).expect("a folder").collect();
        assert_eq!(left.len(), 1, "no temporary file stays behind");
    }

    // Lesson 2
    #[test]
    fn damaged_files_are_errors_and_take_no_memory() {
        let bytes = encoded(&gradient(), Precision::Half);
        let decode = |bytes: &[u8]| ExrFile::decode_first(bytes).map(|_| ());
        assert_eq!(decode(&bytes), Ok(()));
        assert_eq!(decode(&[]), Err("it is empty".to_owned()));
        for length in 0..bytes.len() {
            assert!(decode(&bytes[..length]).is_err(), "cut to {length} bytes");
        }
        // The data window's right and lower edges.
        let window = bytes.windows(10).position(|w| w == b"dataWindow").expect("has one");
        let edges = window + "dataWindow\0box2i\0".len() + 4 + 8;
        let announcing = |right: i32, bottom: i32| {
            let mut changed = bytes.clone();
            changed[edges..edges + 4].copy_from_slice(&right.to_le_bytes());
            changed[edges + 4..edges + 8].copy_from_slice(&bottom.to_le_bytes());
            decode(&changed).expect_err("another size")
        };
        let sides = "the file's header announces 16385 x 12 pixels, but each side must have 1 to 16384 pixels";
        assert_eq!(announcing(16_384, 11), sides);
        let sides = "the file's header announces -2147483647 x 12 pixels, but each side must have 1 to 16384 pixels";
        assert_eq!(announcing(i32::MIN, 11), sides);
        let memory =
            "the file's header announces 4096 MB of pixels, but Karat reads at most 512 MB";
        assert_eq!(announcing(16_383, 16_383), memory);
        let ratio = format!(
            "the file's header announces 83886080 bytes of pixels, but the file has {} bytes",
            bytes.len()
        );
        assert_eq!(announcing(16_383, 639), ratio);
    }

    #[test]
    fn constant_images_are_within_the_ratio() {
        let image = Image::new(4096, 512, vec![[0.0; 4]; 4096 * 512]);
        let bytes = encoded(&image, Precision::Half);
        let (read, _) = ExrFile::decode_first(&bytes).expect("no more than deflate can do");
        assert!(read == image);
    }

    #[test]
    fn an_unwritable_place_is_an_error() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = folder.path().join("file");
        std::fs::write(&file, "x").expect("written");
        let error = gradient().write_exr(&file.join("a.exr"), Precision::Half, None);
        assert!(matches!(error, Err(ImageError::Write { .. })));
        let error = Image::read_exr(&folder.path().join("no.exr"));
        assert!(matches!(error, Err(ImageError::Missing { .. })));
    }
}
