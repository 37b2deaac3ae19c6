//! Writes OpenEXR files in blocks of 16 rows, compressed by ZIP. Such files are small, and every tool can read them.

use std::io::{Cursor, Error, ErrorKind};
use std::path::Path;

use exr::block::BlockIndex;
use exr::block::chunk::{Chunk, CompressedBlock, CompressedScanLineBlock};
use exr::block::writer::ChunksWriter;
use exr::meta::BlockDescription;
use exr::meta::header::{Header, LayerAttributes};
use exr::prelude::{
    AttributeValue, ChannelDescription, Compression, IntegerBounds, LineOrder, SampleType, Text,
    Vec2,
};
use half::f16;
use half::slice::HalfFloatSliceExt;

use super::Precision;
use super::header::ATTRIBUTE;
use crate::diagnostic::shown;
use crate::image::bytes::LONGEST_SIDE;
use crate::image::whole::write_whole;
use crate::image::{Image, ImageError};

pub(super) struct Layer<'a> {
    pub(super) name: &'a str,
    pub(super) precision: Precision,
    pub(super) image: &'a Image,
}

/// The names of the channels, in alphabetical order as the format requires, with their indices in a pixel of [`Image`].
const CHANNELS: [(&str, usize); 4] = [("A", 3), ("B", 2), ("G", 1), ("R", 0)];

pub(super) fn write(
    path: &Path,
    layers: &[Layer<'_>],
    metadata: Option<&str>,
) -> Result<(), ImageError> {
    let bytes = bytes(path, layers, metadata)?;
    write_whole(path, &bytes).map_err(|cause| ImageError::Write { path: shown(path), cause })
}

/// Checks the parts and returns the bytes of the file. The function uses `path` only in the messages of errors.
pub(super) fn bytes(
    path: &Path,
    layers: &[Layer<'_>],
    metadata: Option<&str>,
) -> Result<Vec<u8>, ImageError> {
    check_names(layers)?;
    let failed = |cause| ImageError::Write { path: shown(path), cause };
    check_sizes(layers).map_err(failed)?;
    encode(layers, metadata).map_err(|error| failed(Error::other(error)))
}

fn check_names(layers: &[Layer<'_>]) -> Result<(), ImageError> {
    let sound = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    for (index, Layer { name, .. }) in layers.iter().enumerate() {
        let reason = if name.is_empty() && layers.len() > 1 {
            "in an image with several parts, each part needs a name"
        } else if !name.chars().all(sound) {
            "use letters, digits, `-`, `_` and `.`"
        } else if name.len() > 255 {
            "the name is longer than 255 characters"
        } else if layers[..index].iter().any(|layer| layer.name == *name) {
            "another part has this name"
        } else {
            continue;
        };
        return Err(ImageError::PartName { name: (*name).to_owned(), reason });
    }
    Ok(())
}

fn check_sizes(layers: &[Layer<'_>]) -> std::io::Result<()> {
    let invalid = |reason| Error::new(ErrorKind::InvalidInput, reason);
    if layers.is_empty() {
        return Err(invalid("the image has no parts".to_owned()));
    }
    let sides = 1..=LONGEST_SIDE;
    for Layer { image, .. } in layers {
        if !sides.contains(&image.width) || !sides.contains(&image.height) {
            let (width, height) = (image.width, image.height);
            return Err(invalid(format!(
                "the image has {width} x {height} pixels, but each side must have 1 to {LONGEST_SIDE} pixels"
            )));
        }
    }
    Ok(())
}

pub(super) fn encode(
    layers: &[Layer<'_>],
    metadata: Option<&str>,
) -> Result<Vec<u8>, exr::error::Error> {
    let window = size(layers[0].image);
    let mut headers: Vec<_> = layers.iter().map(|layer| header(layer, window)).collect();
    if let Some(metadata) = metadata {
        let value = AttributeValue::Text(Text::from_slice_unchecked(metadata.as_bytes()));
        headers[0].own_attributes.other.insert(Text::from(ATTRIBUTE), value);
    }
    let mut bytes = Cursor::new(Vec::new());
    exr::block::write(&mut bytes, headers.into(), true, |meta, writer| {
        for (layer_index, (header, layer)) in meta.headers.iter().zip(layers).enumerate() {
            let blocks =
                exr::block::enumerate_ordered_header_block_indices(std::slice::from_ref(header));
            for (index, block) in blocks {
                let chunk =
                    Chunk { layer_index, compressed_block: compress(header, layer, block)? };
                writer.write_chunk(index, chunk)?;
            }
        }
        Ok(())
    })?;
    Ok(bytes.into_inner())
}

fn size(image: &Image) -> Vec2<usize> {
    Vec2(image.width as usize, image.height as usize)
}

fn header(layer: &Layer<'_>, window: Vec2<usize>) -> Header {
    let sample_type = match layer.precision {
        Precision::Half => SampleType::F16,
        Precision::Float => SampleType::F32,
    };
    let channels = CHANNELS.map(|(name, _)| ChannelDescription::named(name, sample_type));
    let name = (!layer.name.is_empty()).then(|| Text::from(layer.name));
    Header::new(Text::from("unnamed"), size(layer.image), channels.into_iter().collect())
        .with_encoding(Compression::ZIP16, BlockDescription::ScanLines, LineOrder::Increasing)
        .with_display_window(IntegerBounds::from_dimensions(window))
        .with_attributes(LayerAttributes { layer_name: name, ..LayerAttributes::default() })
}

/// Compresses a block of rows. In each row, all samples of a channel come before the samples of the next channel.
fn compress(
    header: &Header,
    layer: &Layer<'_>,
    block: BlockIndex,
) -> Result<CompressedBlock, exr::error::Error> {
    let Vec2(width, rows) = block.pixel_size;
    let top = block.pixel_position.y();
    let mut data = Vec::with_capacity(width * rows * header.channels.bytes_per_pixel);
    let (mut line, mut halves) = (Vec::with_capacity(width), vec![f16::ZERO; width]);
    for row in layer.image.pixels[top * width..][..rows * width].chunks_exact(width) {
        for (_, channel) in CHANNELS {
            line.clear();
            line.extend(row.iter().map(|pixel| pixel[channel]));
            match layer.precision {
                Precision::Half => {
                    halves.convert_from_f32_slice(&line);
                    data.extend_from_slice(bytemuck::cast_slice(halves.reinterpret_cast()));
                }
                Precision::Float => data.extend_from_slice(bytemuck::cast_slice(&line)),
            }
        }
    }
    let y = i32::try_from(top)?;
    let section = IntegerBounds { position: Vec2(0, y), size: block.pixel_size };
    let compressed_pixels_le =
        header.compression.compress_image_section_to_le(header, data, section)?;
    let block = CompressedScanLineBlock { y_coordinate: y, compressed_pixels_le };
    Ok(CompressedBlock::ScanLine(block))
}
