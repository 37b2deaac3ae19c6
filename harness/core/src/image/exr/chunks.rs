//! Finds the chunks of a part by the part's table of offsets, checks the chunks, and decompresses them one by one.
//!
//! Karat passes a chunk to the codecs of the `exr` crate only if the chunk is complete, has the position that the table
//! implies, and isn't longer than the block's pixels. So the codecs reserve only a small multiple of a block's memory.

use std::panic::{AssertUnwindSafe, catch_unwind};

use exr::error::Error;
use exr::meta::BlockDescription;
use exr::meta::attribute::{LevelMode, LineOrder};
use exr::meta::header::Header;
use exr::prelude::{
    ChannelDescription, Compression, IntegerBounds, SampleType, Text, TileDescription, Vec2,
};

use super::block::Block;
use super::guard;
use super::header::{Blocks, Bytes, FileHeader, PartHeader, Sample};

/// Calls `each` with the samples of each block in the largest level of a part. Samples are ordered by row, then by
/// channel.
pub(super) fn decode(
    bytes: &[u8],
    file: &FileHeader,
    index: usize,
    mut each: impl FnMut(Block, &[u8]),
) -> Result<(), String> {
    let part = &file.parts[index];
    let header = codec_header(part);
    let before: usize = file.parts[..index].iter().map(|part| part.chunks).sum();
    let table = &bytes[file.tables + before * 8..];
    // The chunks of the largest level come first in the table.
    for (number, (block, place)) in blocks(part).enumerate() {
        let of = |problem: String| format!("{problem} (chunk {} of {})", number + 1, part.chunks);
        let offset = table[number * 8..][..8].try_into().expect("the table is within the file");
        let mut chunk = usize::try_from(u64::from_le_bytes(offset))
            .ok()
            .filter(|offset| *offset > file.tables)
            .and_then(|offset| bytes.get(offset..))
            .map(|rest| Bytes { rest })
            .ok_or_else(|| {
                of("the file's chunk table has an offset outside of the file".to_owned())
            })?;
        let data = found(&mut chunk, file.numbered.then_some(index), place, block.bytes(part))
            .map_err(of)?;
        each(block, &decompress(part, &header, data, block).map_err(of)?);
    }
    Ok(())
}

/// The position of a block, in the form in which the block's chunk states it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    Row(i64),
    Tile(i32, i32),
}

/// The blocks of the largest level in the order of the part's table. The chunks in the file may have another order.
fn blocks(part: &PartHeader) -> impl Iterator<Item = (Block, Place)> {
    let (width, height) = (part.width, part.height);
    let (across, down) = match part.blocks {
        Blocks::Rows(rows) => (width, rows),
        Blocks::Tiles { width, height } => (width, height),
    };
    let (top, blocks) = (part.top, part.blocks);
    (0..height.div_ceil(down)).flat_map(move |row| {
        (0..width.div_ceil(across)).map(move |column| {
            // A tile may extend beyond the image. The file has only the pixels inside the image.
            let (x, y) = (column * across, row * down);
            let block = Block {
                x: x as usize,
                y: y as usize,
                width: across.min(width - x) as usize,
                height: down.min(height - y) as usize,
            };
            let place = match blocks {
                Blocks::Rows(_) => Place::Row(i64::from(top) + i64::from(y)),
                Blocks::Tiles { .. } => Place::Tile(column.cast_signed(), row.cast_signed()),
            };
            (block, place)
        })
    })
}

/// The compressed data of a chunk. Fails if the chunk states a wrong part, position or length. A chunk that compression
/// wouldn't make smaller is stored uncompressed, so a chunk is never longer than its pixels.
fn found<'a>(
    chunk: &mut Bytes<'a>,
    part: Option<usize>,
    place: Place,
    longest: usize,
) -> Result<&'a [u8], String> {
    let mut number = || chunk.i32().map_err(|_| "the file ends in the middle of a chunk");
    let numbered = match part {
        None => true,
        Some(part) => i32::try_from(part) == Ok(number()?),
    };
    let here = match place {
        Place::Row(row) => i64::from(number()?) == row,
        Place::Tile(column, row) => {
            // The last two numbers are the tile's level in x and y.
            [number()?, number()?, number()?, number()?] == [column, row, 0, 0]
        }
    };
    let length = number()?;
    if !numbered || !here {
        return Err(
            "the file's chunk table has an entry that points to a wrong chunk, or to no chunk"
                .to_owned(),
        );
    }
    usize::try_from(length)
        .ok()
        .filter(|length| (1..=longest).contains(length))
        .and_then(|length| chunk.take(length).ok())
        .ok_or_else(|| {
            format!(
                "the file has a chunk of {length} bytes, but the chunk can have only 1 to {longest} bytes"
            )
        })
}

fn codec_header(part: &PartHeader) -> Header {
    let channels = part.channels.iter().map(|channel| ChannelDescription {
        name: Text::from_slice_unchecked(channel.name.as_bytes()),
        sample_type: match channel.sample {
            Sample::Uint => SampleType::U32,
            Sample::Half => SampleType::F16,
            Sample::Float => SampleType::F32,
        },
        quantize_linearly: channel.linear,
        sampling: Vec2(1, 1),
    });
    let size = Vec2(part.width as usize, part.height as usize);
    let blocks = match part.blocks {
        Blocks::Rows(_) => BlockDescription::ScanLines,
        Blocks::Tiles { width, height } => BlockDescription::Tiles(TileDescription {
            tile_size: Vec2(width as usize, height as usize),
            level_mode: LevelMode::Singular,
            rounding_mode: exr::math::RoundingMode::Down,
        }),
    };
    Header::new(Text::from_slice_unchecked(b""), size, channels.collect()).with_encoding(
        part.compression,
        blocks,
        LineOrder::Increasing,
    )
}

fn decompress(
    part: &PartHeader,
    header: &Header,
    data: &[u8],
    block: Block,
) -> Result<Vec<u8>, String> {
    let codec = name(part.compression);
    let failed =
        |reason: &str| format!("the file's pixels can't be decompressed by {codec}: {reason}");
    // A chunk that is as long as its pixels is uncompressed.
    if data.len() < block.bytes(part) {
        match part.compression {
            Compression::DWAA(_) | Compression::DWAB(_) => guard::check_dwa(data, part, block),
            Compression::B44 | Compression::B44A => guard::check_b44(data, part, block),
            _ => Ok(()),
        }
        .map_err(|reason| failed(&reason))?;
    }
    let (x, y) = (i32::try_from(block.x), i32::try_from(block.y));
    let position = Vec2(x.expect("within the limits"), y.expect("within the limits"));
    let section = IntegerBounds { position, size: Vec2(block.width, block.height) };
    // No known file passes the checks and makes a codec panic. But the codecs have assertions about valid files, and a
    // damaged file mustn't end a whole test run.
    let decoded = catch_unwind(AssertUnwindSafe(|| {
        header.compression.decompress_image_section_from_le(header, data.to_vec(), section, false)
    }));
    match decoded {
        Ok(Ok(pixels)) => Ok(pixels),
        Ok(Err(Error::Invalid(reason) | Error::NotSupported(reason))) => {
            Err(failed(unwrapped(&reason)))
        }
        Ok(Err(error)) => Err(failed(&error.to_string())),
        Err(_) => Err(failed("the decoder panicked")),
    }
}

/// A codec's message without the words that the `exr` crate adds. If the message gives no reason (`compressed data`),
/// the function returns a clearer message.
fn unwrapped(message: &str) -> &str {
    let inside = message.split_once("(invalid: ").and_then(|(_, inside)| inside.strip_suffix(')'));
    match inside.unwrap_or(message) {
        "compressed data" | "compression data" => "the data are damaged",
        "decompressed data" => "the decompressed data have a wrong length",
        reason => reason,
    }
}

fn name(compression: Compression) -> &'static str {
    match compression {
        Compression::Uncompressed => "none",
        Compression::RLE => "RLE",
        Compression::ZIP1 => "ZIPS",
        Compression::ZIP16 => "ZIP",
        Compression::PIZ => "PIZ",
        Compression::PXR24 => "PXR24",
        Compression::B44 => "B44",
        Compression::B44A => "B44A",
        Compression::DWAA(_) => "DWAA",
        Compression::DWAB(_) => "DWAB",
        _ => "an unknown codec",
    }
}
