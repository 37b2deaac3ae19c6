//! Reads the header of an OpenEXR file, and checks it against the file's length and Karat's limits.
//!
//! Karat has its own header reader, because the header reader of the `exr` crate reserves the memory that a header
//! announces before it checks the rest of the header. The crate's reader also doesn't return the position of the chunk
//! tables.

mod bytes;

use exr::prelude::Compression;

pub(super) use bytes::Bytes;

use crate::image::bytes::{LARGEST_DECODED, LARGEST_RATIO, LONGEST_SIDE, found};

/// The largest number of channels in a part. Renderers stay below this limit in parts with colours.
const MOST_CHANNELS: usize = 32;
/// The name of the attribute that contains all of Karat's metadata. Karat uses a single attribute, because the encoder
/// would write several attributes in random order, and equal images should give equal files.
pub(super) const ATTRIBUTE: &str = "karat";

const TILED: u32 = 0x200;
const LONG_NAMES: u32 = 0x400;
const DEEP: u32 = 0x800;
const MULTI_PART: u32 = 0x1000;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sample {
    Uint,
    Half,
    Float,
}

impl Sample {
    pub(super) fn bytes(self) -> usize {
        match self {
            Self::Half => 2,
            Self::Uint | Self::Float => 4,
        }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Channel {
    pub(super) name: String,
    pub(super) sample: Sample,
    /// The channel's `pLinear` flag, which tells lossy codecs how to quantise the channel.
    pub(super) linear: bool,
}

/// The division of a part's largest level into chunks: rows, or tiles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Blocks {
    Rows(u32),
    Tiles { width: u32, height: u32 },
}

#[derive(Clone, Debug)]
pub(super) struct PartHeader {
    pub(super) name: String,
    pub(super) width: u32,
    pub(super) height: u32,
    /// The y coordinate of the part's first row in the file. Each chunk of rows states the y of its first row.
    pub(super) top: i32,
    pub(super) channels: Vec<Channel>,
    pub(super) compression: Compression,
    pub(super) blocks: Blocks,
    /// The number of entries in the part's chunk table, which has the chunks of all levels.
    pub(super) chunks: usize,
    pub(super) metadata: Option<String>,
    /// The CIE x and y of red, green, blue and white.
    pub(super) chromaticities: Option<[f32; 8]>,
}

#[derive(Debug)]
pub(super) struct FileHeader {
    pub(super) parts: Vec<PartHeader>,
    /// `true` if each chunk begins with the number of its part.
    pub(super) numbered: bool,
    /// The position in the file, in bytes, of the first part's chunk table. The tables of the other parts follow.
    pub(super) tables: usize,
}

impl FileHeader {
    /// Reads the headers of all parts. Fails if a header exceeds the limits, or if the file is too short for the tables
    /// of chunks.
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, String> {
        let mut rest = Bytes { rest: bytes };
        if bytes.is_empty() {
            return Err("it is empty".to_owned());
        }
        if !bytes.starts_with(&exr::meta::magic_number::BYTES) {
            return Err(format!("it is {}", found(bytes)));
        }
        rest.take(4)?;
        let version = rest.u32()?;
        let flags = version & !0xff;
        if version & 0xff != 2 {
            return Err(format!(
                "the file has version {}, but Karat reads only version 2",
                version & 0xff
            ));
        }
        if flags & !(TILED | LONG_NAMES | DEEP | MULTI_PART) != 0 {
            return Err(format!("the file's version field has unknown flags: {flags:#x}"));
        }
        if flags & DEEP != 0 {
            return Err("the file has deep data, which Karat can't read".to_owned());
        }
        let numbered = flags & MULTI_PART != 0;
        let mut parts = Vec::new();
        loop {
            parts.push(PartHeader::parse(&mut rest, flags & TILED != 0)?);
            if !numbered || rest.ends()? {
                break;
            }
        }
        let header = Self { parts, numbered, tables: bytes.len() - rest.rest.len() };
        header.check(bytes.len(), rest.rest.len())?;
        Ok(header)
    }

    fn check(&self, length: usize, rest: usize) -> Result<(), String> {
        let (mut stored, mut decoded, mut entries) = (0_u64, 0_u64, 0_usize);
        for part in &self.parts {
            let area = u64::from(part.width) * u64::from(part.height);
            let samples: usize = part.channels.iter().map(|channel| channel.sample.bytes()).sum();
            stored = stored.saturating_add(area * samples as u64);
            decoded = decoded.saturating_add(area * part.channels.len().max(4) as u64 * 4);
            entries = entries.saturating_add(part.chunks);
        }
        if decoded > LARGEST_DECODED {
            return Err(format!(
                "the file's header announces {} MB of pixels, but Karat reads at most {} MB",
                decoded >> 20,
                LARGEST_DECODED >> 20
            ));
        }
        if stored > (length as u64).saturating_mul(LARGEST_RATIO) {
            return Err(format!(
                "the file's header announces {stored} bytes of pixels, but the file has {length} bytes"
            ));
        }
        if entries > rest / 8 {
            return Err(format!(
                "the file's header announces {entries} chunks, but the file is too short for them"
            ));
        }
        Ok(())
    }
}

#[derive(Default)]
struct Attributes {
    channels: Option<Vec<Channel>>,
    compression: Option<Compression>,
    window: Option<[i32; 4]>,
    tiles: Option<Tiles>,
    kind: Option<String>,
    name: String,
    metadata: Option<String>,
    chromaticities: Option<[f32; 8]>,
}

impl PartHeader {
    fn parse(rest: &mut Bytes<'_>, tiled: bool) -> Result<Self, String> {
        let mut found = Attributes::default();
        while !rest.ends()? {
            let (name, kind) = (rest.name()?, rest.name()?);
            let length = usize::try_from(rest.i32()?).map_err(|_| {
                format!("the file's attribute `{}` has a negative length", shown(&text(name)))
            })?;
            let mut value = Bytes { rest: rest.take(length)? };
            match (name, kind) {
                (b"channels", b"chlist") => found.channels = Some(channels(&mut value)?),
                (b"compression", b"compression") => {
                    found.compression = Some(compression(value.u8()?)?);
                }
                (b"dataWindow", b"box2i") => {
                    found.window = Some([value.i32()?, value.i32()?, value.i32()?, value.i32()?]);
                }
                (b"tiles", b"tiledesc") => found.tiles = Some(Tiles::parse(&mut value)?),
                (b"type", b"string") => found.kind = Some(text(value.rest)),
                (b"name", b"string") => found.name = text(value.rest),
                (b"chromaticities", b"chromaticities") => {
                    let mut numbers = [0.0; 8];
                    for number in &mut numbers {
                        *number = f32::from_le_bytes(value.array()?);
                    }
                    found.chromaticities = Some(numbers);
                }
                (name, b"string") if name == ATTRIBUTE.as_bytes() => {
                    found.metadata = Some(text(value.rest));
                }
                _ => {}
            }
        }
        found.part(tiled)
    }
}

impl Attributes {
    fn part(self, tiled: bool) -> Result<PartHeader, String> {
        let missing = |name: &str| format!("the file's header lacks the attribute `{name}`");
        let channels = self.channels.ok_or_else(|| missing("channels"))?;
        let compression = self.compression.ok_or_else(|| missing("compression"))?;
        let [left, top, right, bottom] = self.window.ok_or_else(|| missing("dataWindow"))?;
        let side = |from: i32, to: i32| i64::from(to) - i64::from(from) + 1;
        let (width, height) = (side(left, right), side(top, bottom));
        let sound = |side: i64| u32::try_from(side).ok().filter(|s| (1..=LONGEST_SIDE).contains(s));
        let (Some(width), Some(height)) = (sound(width), sound(height)) else {
            return Err(format!(
                "the file's header announces {width} x {height} pixels, but each side must have 1 to \
                 {LONGEST_SIDE} pixels"
            ));
        };
        let tiled = match self.kind.as_deref() {
            Some("tiledimage") => true,
            Some("scanlineimage") => false,
            Some("deepscanline" | "deeptile") => {
                return Err("the file has deep data, which Karat can't read".to_owned());
            }
            Some(kind) => {
                return Err(format!("the file has a part of unknown type `{}`", shown(kind)));
            }
            None => tiled,
        };
        let (blocks, chunks) = if tiled {
            let tiles = self.tiles.ok_or_else(|| missing("tiles"))?;
            let blocks = Blocks::Tiles { width: tiles.width, height: tiles.height };
            (blocks, tiles.count(width, height))
        } else {
            let rows = u32::try_from(compression.scan_lines_per_block()).expect("at most 256");
            (Blocks::Rows(rows), u64::from(height.div_ceil(rows)))
        };
        let chunks = usize::try_from(chunks).unwrap_or(usize::MAX);
        let Self { name, metadata, chromaticities, .. } = self;
        Ok(PartHeader {
            name,
            width,
            height,
            top,
            channels,
            compression,
            blocks,
            chunks,
            metadata,
            chromaticities,
        })
    }
}

fn channels(value: &mut Bytes<'_>) -> Result<Vec<Channel>, String> {
    let mut channels: Vec<Channel> = Vec::new();
    while !value.ends()? {
        if channels.len() == MOST_CHANNELS {
            return Err(format!("the file has a part of more than {MOST_CHANNELS} channels"));
        }
        let name = text(value.name()?);
        let of = |problem: String| format!("the file's channel `{}` {problem}", shown(&name));
        let sample = match value.i32()? {
            0 => Sample::Uint,
            1 => Sample::Half,
            2 => Sample::Float,
            other => return Err(of(format!("is of unknown type {other}"))),
        };
        let linear = value.take(4)?[0] != 0;
        if (value.i32()?, value.i32()?) != (1, 1) {
            return Err(of(
                "has fewer pixels than the image; Karat can't read such channels".to_owned()
            ));
        }
        if channels.iter().any(|channel| channel.name == name) {
            return Err(of("exists twice".to_owned()));
        }
        channels.push(Channel { name, sample, linear });
    }
    if channels.is_empty() {
        return Err("the file has a part without channels".to_owned());
    }
    Ok(channels)
}

fn compression(code: u8) -> Result<Compression, String> {
    let name = match code {
        0 => return Ok(Compression::Uncompressed),
        1 => return Ok(Compression::RLE),
        2 => return Ok(Compression::ZIP1),
        3 => return Ok(Compression::ZIP16),
        4 => return Ok(Compression::PIZ),
        5 => return Ok(Compression::PXR24),
        6 => return Ok(Compression::B44),
        7 => return Ok(Compression::B44A),
        8 => return Ok(Compression::DWAA(None)),
        9 => return Ok(Compression::DWAB(None)),
        10 => "HTJ2K256",
        11 => "HTJ2K32",
        12 => "LJ2K",
        13 => "ZSTD",
        other => {
            return Err(format!("the file is compressed by an unknown method, number {other}"));
        }
    };
    Err(format!(
        "the file is compressed by {name}, which Karat can't read: convert the file to ZIP"
    ))
}

struct Tiles {
    width: u32,
    height: u32,
    levels: Levels,
    round_up: bool,
}

enum Levels {
    One,
    Mip,
    Rip,
}

impl Tiles {
    fn parse(value: &mut Bytes<'_>) -> Result<Self, String> {
        let (width, height, mode) = (value.u32()?, value.u32()?, value.u8()?);
        if width == 0 || height == 0 {
            return Err(format!(
                "the file's tiles have {width} x {height} pixels, but each side must be at least 1"
            ));
        }
        let levels = match mode & 0xf {
            0 => Levels::One,
            1 => Levels::Mip,
            2 => Levels::Rip,
            other => {
                return Err(format!("the file's tiles have levels of the unknown type {other}"));
            }
        };
        Ok(Self { width, height, levels, round_up: mode >> 4 != 0 })
    }

    /// The number of tiles in all levels of an image of this size, which must be within Karat's limits.
    fn count(&self, width: u32, height: u32) -> u64 {
        let size = |side: u32, level: u32| {
            let divided = if self.round_up { side.div_ceil(1 << level) } else { side >> level };
            divided.max(1)
        };
        let last = |side: u32| match self.round_up {
            true => side.next_power_of_two().ilog2(),
            false => side.ilog2(),
        };
        let across = |level| u64::from(size(width, level).div_ceil(self.width));
        let down = |level| u64::from(size(height, level).div_ceil(self.height));
        match self.levels {
            Levels::One => across(0) * down(0),
            Levels::Mip => (0..=last(width.max(height))).map(|l| across(l) * down(l)).sum(),
            Levels::Rip => {
                let columns: u64 = (0..=last(width)).map(across).sum();
                columns * (0..=last(height)).map(down).sum::<u64>()
            }
        }
    }
}

/// Decodes a text as UTF-8, or as Latin-1 if it isn't valid UTF-8. Some writers use Latin-1.
fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec())
        .unwrap_or_else(|_| bytes.iter().copied().map(char::from).collect())
}

pub(super) fn shown(name: &str) -> String {
    name.chars().take(64).flat_map(char::escape_debug).collect()
}

#[cfg(test)]
mod tests;
