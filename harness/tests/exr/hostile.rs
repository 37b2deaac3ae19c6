//! Damaged and hostile files. Karat reads each file as an image, or refuses the file with a reason, and needs little
//! memory.

use std::fmt::Write;
use std::io::Cursor;
use std::path::Path;

use exr::image::{FlatSamples, Levels};
use exr::math::RoundingMode;
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, Layer, LayerAttributes, LineOrder,
    MetaData, SampleType, SmallVec, Vec2,
};
use karat::Image;
use karat::image::ImageError;
use karat::unstable::image::ExrFile;

use super::{CODECS, SIZE, data, encode, file, layer, message, place, rgba};

/// The memory in bytes that a codec may use in addition to the pixels, for the tables of PIZ and DWA.
const TABLES: u64 = 4 << 20;
/// The memory that decoding may use for pixels, as a multiple of the size of the pixels that the header declares.
const TIMES: u64 = 4;

/// A random number generator. The test doesn't use a crate's generator, so that no update of a crate changes the
/// damaged files.
struct Random(u64);

impl Random {
    /// Returns the next number of SplitMix64 (Steele et al. 2014).
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, end: usize) -> usize {
        (self.next() % end.max(1) as u64) as usize
    }

    fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.below(from.len())]
    }
}

/// A valid file, with the positions of its chunk tables and chunks.
struct Seed {
    bytes: Vec<u8>,
    tables: usize,
    chunks: Vec<usize>,
}

impl Seed {
    /// A file that another program wrote. The test doesn't know the positions of its chunks.
    fn unknown(name: &str) -> Self {
        let bytes = std::fs::read(data(name)).expect("readable");
        let tables = bytes.len() / 2;
        Self { bytes, tables, chunks: vec![tables] }
    }

    fn new(bytes: Vec<u8>) -> Self {
        let mut reader = Cursor::new(&bytes);
        let meta = MetaData::read_from_buffered(&mut reader, false).expect("a sound file");
        let tables = reader.position() as usize;
        let count: usize = meta.headers.iter().map(|header| header.chunk_count).sum();
        let entry = |i: usize| bytes[tables + i * 8..][..8].try_into().expect("a table");
        let chunks = (0..count).map(|i| u64::from_le_bytes(entry(i)) as usize).collect();
        Self { bytes, tables, chunks }
    }
}

const TILES: Blocks = Blocks::Tiles(Vec2(10, 7));

/// An image with mip levels, or with rip levels.
fn levels(rip: bool) -> Vec<u8> {
    let round = RoundingMode::Down;
    let samples = |size: Vec2<usize>| FlatSamples::F32(vec![0.5; size.area()]);
    let level_data = match rip {
        false => exr::meta::mip_map_levels(round, SIZE).map(|(_, size)| samples(size)).collect(),
        true => exr::meta::rip_map_levels(round, SIZE).map(|(_, size)| samples(size)).collect(),
    };
    let levels = match rip {
        false => Levels::Mip { rounding_mode: round, level_data },
        true => Levels::Rip {
            rounding_mode: round,
            level_data: exr::image::RipMaps { level_count: Vec2(5, 5), map_data: level_data },
        },
    };
    let channels = ["B", "G", "R"].map(|name| AnyChannel::new(name, levels.clone()));
    let channels = AnyChannels::sort(SmallVec::<[_; 4]>::from_iter(channels));
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: TILES,
        line_order: LineOrder::Increasing,
    };
    let layer = Layer::new(SIZE, LayerAttributes::default(), encoding, channels);
    encode(&exr::image::Image::from_layer(layer))
}

fn seeds() -> Vec<Seed> {
    let mut seeds = vec![levels(false), levels(true)];
    for codec in CODECS {
        for sample in [SampleType::F16, SampleType::F32] {
            let rows = |name| layer(name, rgba(sample), codec, Blocks::ScanLines);
            let tiles = |name| layer(name, rgba(sample), codec, TILES);
            seeds.push(file(&[rows("rows")]));
            seeds.push(file(&[tiles("tiles")]));
            seeds.push(file(&[rows("rows"), tiles("tiles")]));
        }
    }
    seeds.into_iter().map(Seed::new).collect()
}

const NUMBERS: [u32; 14] = [
    0,
    1,
    2,
    7,
    255,
    256,
    4096,
    16_383,
    16_384,
    65_535,
    0x00ff_ffff,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
];

fn put(bytes: &mut [u8], at: usize, value: &[u8]) {
    if let Some(place) = bytes.get_mut(at..at + value.len()) {
        place.copy_from_slice(value);
    }
}

/// A file with one of ten kinds of damage.
fn damaged(kind: usize, seed: &Seed, other: &Seed, random: &mut Random) -> Vec<u8> {
    let mut bytes = seed.bytes.clone();
    let length = bytes.len();
    match kind {
        0 => bytes[random.below(length)] ^= 1 << random.below(8),
        1 => {
            for _ in 0..1 + random.below(8) {
                let at = seed.tables + random.below(length - seed.tables);
                bytes[at] ^= 1 << random.below(8);
            }
        }
        2 => {
            for _ in 0..1 + random.below(4) {
                bytes[random.below(length)] = random.pick(&[0, 1, 0x7f, 0x80, 0xff]);
            }
        }
        3 => bytes.truncate(random.below(length)),
        4 => {
            let from = random.below(other.bytes.len());
            let count = random.below(64).min(other.bytes.len() - from);
            put(&mut bytes, random.below(length), &other.bytes[from..from + count]);
        }
        5 => {
            // Copies a chunk over another chunk.
            let (from, to) = (random.pick(&seed.chunks), random.pick(&seed.chunks));
            let chunk = bytes[from..(from + 16 + random.below(400)).min(length)].to_vec();
            match random.below(2) {
                0 => put(&mut bytes, to, &chunk),
                _ => drop(bytes.splice(to..to, chunk)),
            }
        }
        6 => {
            // Changes a number in the header, anywhere or in an attribute with a size.
            let names = ["dataWindow", "tiles", "channels", "chunkCount", "compression", "type"];
            let name = random.pick(&names).as_bytes();
            let found = bytes.windows(name.len()).position(|window| window == name);
            let at = match found {
                Some(at) if random.below(4) > 0 => at + name.len() + random.below(32),
                _ => random.below(seed.tables),
            };
            put(&mut bytes, at, &random.pick(&NUMBERS).to_le_bytes());
        }
        7 => {
            let offset = match random.below(4) {
                0 => u64::from(random.pick(&NUMBERS)),
                1 => u64::from(random.pick(&NUMBERS)) << 32,
                2 => random.pick(&seed.chunks) as u64,
                _ => random.below(length + 8) as u64,
            };
            let entry = random.below(seed.chunks.len());
            put(&mut bytes, seed.tables + entry * 8, &offset.to_le_bytes());
        }
        8 => {
            // Changes the beginning of a chunk: its position, its length, or the codec's first bytes.
            let at = random.pick(&seed.chunks) + random.below(128);
            match random.below(3) {
                0 => put(&mut bytes, at, &random.next().to_le_bytes()),
                1 => put(&mut bytes, at & !3, &u64::from(random.pick(&NUMBERS)).to_le_bytes()),
                _ => put(&mut bytes, at & !3, &random.pick(&NUMBERS).to_le_bytes()),
            }
        }
        _ => {
            let from = random.below(length);
            let to = (from + 1 + random.below(64)).min(length);
            drop(bytes.drain(from..to));
        }
    }
    bytes
}

/// The number of bytes that a file's pixels need according to its data windows, or Karat's limit if the limit is
/// smaller.
fn announced(bytes: &[u8]) -> u64 {
    let name = b"dataWindow\0box2i\0";
    let windows = bytes.windows(name.len() + 20).filter(|window| window.starts_with(name));
    let sizes = windows.map(|window| {
        let number = |index: usize| {
            let at = name.len() + 4 + index * 4;
            i64::from(i32::from_le_bytes(window[at..at + 4].try_into().expect("four")))
        };
        let side = |side: i64| if (1..=16_384).contains(&side) { side as u64 } else { 0 };
        side(number(2) - number(0) + 1) * side(number(3) - number(1) + 1) * 16
    });
    sizes.sum::<u64>().min(512 << 20).min(bytes.len() as u64 * 2000 * 8)
}

/// Checks that a message names the file and says in one line what is wrong with it.
fn is_sentence(text: &str, path: &Path) -> bool {
    let Some((file, reason)) = text.split_once(" isn't a readable OpenEXR image: ") else {
        return false;
    };
    let ours = ["it is ", "the file ", "the file's "];
    file == format!("`{}`", path.display())
        && ours.iter().any(|start| reason.starts_with(start))
        && reason.len() < 700
        && !reason.chars().any(char::is_control)
        && !["panicked", "(invalid", "(None)", "Error", ": :"]
            .iter()
            .any(|raw| reason.contains(raw))
}

#[test]
fn damaged_files_are_images_or_refused_and_take_little_memory() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("damaged.exr");
    let (mut seeds, mut random) = (seeds(), Random(20_260_101));
    let others = ["deep", "zstd", "htj2k32", "mixed", "uint", "layered", "window", "parts"];
    seeds.extend(others.map(|name| Seed::unknown(&format!("{name}.exr"))));
    let (mut accepted, mut refused, mut worst) = (0, 0, (0, 0));
    let mut report = String::new();
    for seed in &seeds {
        for round in 0..110 {
            let kind = round % 10;
            let other = &seeds[random.below(seeds.len())];
            let bytes = damaged(kind, seed, other, &mut random);
            place(&path, &bytes);
            let mut result = None;
            let memory = allocation_counter::measure(|| {
                result = Some(match round % 2 {
                    0 => ExrFile::read(&path).map(|file| file.parts[0].image.clone()),
                    _ => Image::read_exr(&path).map(|(image, _)| image),
                });
            });
            let allowed = bytes.len() as u64 * 2 + announced(&bytes) * TIMES + TABLES;
            assert!(memory.bytes_max <= allowed, "{} > {allowed}: {result:?}", memory.bytes_max);
            worst = worst.max((memory.bytes_max, bytes.len()));
            match result.expect("it was read") {
                Ok(_) => accepted += 1,
                Err(error @ ImageError::Corrupt { .. }) => {
                    let text = error.to_string();
                    assert!(is_sentence(&text, &path), "{text}");
                    refused += 1;
                }
                Err(ImageError::LfsPointer { .. }) => refused += 1,
                Err(error) => panic!("{error}"),
            }
        }
    }
    writeln!(report, "{accepted} read, {refused} refused, at most {worst:?} bytes").expect("text");
    assert!(accepted + refused >= 5000 && accepted > 100 && refused > 3000, "{report}");
    // `cargo test -- --nocapture` prints this report.
    eprint!("{report}");
}

#[test]
fn sound_files_of_every_codec_are_read() {
    for seed in seeds() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("sound.exr");
        std::fs::write(&path, &seed.bytes).expect("written");
        let file = ExrFile::read(&path).expect("sound");
        assert!(file.parts.iter().all(|part| part.image.pixels().len() == SIZE.area()));
        // A file that ends before its last needed chunk is refused.
        place(&path, &seed.bytes[..seed.tables + 3]);
        assert!(ExrFile::read(&path).is_err());
    }
}

#[test]
fn other_file_formats_are_named() {
    let read = |bytes: &[u8]| message(bytes, Image::read_exr);
    let not = |what: &str| format!("`a.exr` isn't a readable OpenEXR image: it is {what}");
    assert_eq!(read(b""), not("empty"));
    assert_eq!(read(b"\x89PNG\r\n\x1a\n...."), not("a PNG image"));
    assert_eq!(read(b"#?RADIANCE\n"), not("a Radiance HDR image"));
    assert_eq!(read(b"not an image"), not("of an unknown format"));
    let pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n";
    let expected = "`a.exr` is a Git LFS pointer, not an image; run `git lfs pull`";
    assert_eq!(read(pointer), expected);
    let image = |bytes: &[u8]| message(bytes, Image::read);
    assert_eq!(image(pointer), expected);
    let neither = "`a.exr` is neither an OpenEXR nor a PNG image: it is a JPEG image";
    assert_eq!(image(b"\xff\xd8\xff\xe0"), neither);
}

#[test]
fn folders_and_files_that_are_too_long_are_refused_unread() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let error = Image::read_exr(folder.path()).expect_err("a folder").to_string();
    assert!(error.ends_with("it is a folder"), "{error}");
    let path = folder.path().join("long.exr");
    let long = std::fs::File::create(&path).expect("created");
    long.set_len((512 << 20) + 1).expect("a file with a hole");
    let mut error = None;
    let memory = allocation_counter::measure(|| error = Image::read(&path).err());
    let error = error.expect("an error").to_string();
    assert!(error.ends_with("the file is longer than 512 MB"), "{error}");
    assert!(memory.bytes_max < 1 << 16, "{memory:?}");
}

#[test]
fn exceeded_limits_are_errors() {
    let mut sound = seeds().swap_remove(2).bytes;
    let channels = (0..33).map(|i| super::channel(&format!("c{i:02}"), SampleType::F16, i));
    let many = AnyChannels::sort(channels.collect::<SmallVec<_>>());
    let many = file(&[layer("many", many, Compression::ZIP1, Blocks::ScanLines)]);
    let read = |bytes: &[u8]| {
        let text = message(bytes, Image::read_exr);
        text.rsplit_once(": ").expect("a reason").1.to_owned()
    };
    assert_eq!(read(&many), "the file has a part of more than 32 channels");
    let flags = sound.iter().position(|byte| *byte == 2).expect("the version");
    sound[flags + 1] |= 8;
    assert_eq!(read(&sound), "the file has deep data, which Karat can't read");
    sound[flags] = 3;
    assert_eq!(read(&sound), "the file has version 3, but Karat reads only version 2");
    let chroma = AnyChannels::sort(SmallVec::<[_; 4]>::from_iter([super::channel(
        "BY",
        SampleType::F16,
        0,
    )]));
    let mut chroma = file(&[layer("a", chroma, Compression::ZIP1, Blocks::ScanLines)]);
    // After the name come the type, a flag for quantisation, and the sampling of columns and rows.
    let sampling = chroma.windows(3).position(|w| w == b"BY\0").expect("a channel") + 3 + 8;
    chroma[sampling] = 2;
    // An interrupted writer leaves a chunk table of zeros.
    assert_eq!(
        read(&chroma),
        "the file's channel `BY` has fewer pixels than the image; Karat can't read such channels"
    );
    let stopped = Seed::new(seeds().swap_remove(2).bytes);
    let mut bytes = stopped.bytes;
    bytes[stopped.tables..stopped.tables + 8].fill(0);
    assert_eq!(
        read(&bytes),
        "the file's chunk table has an offset outside of the file (chunk 1 of 20)"
    );
}

#[test]
fn files_of_the_library_cut_anywhere_are_refused_or_whole() {
    for name in ["dwaa.exr", "piz.exr", "tiled.exr", "parts.exr"] {
        let whole = ExrFile::read(&data(name)).expect("sound");
        let bytes = std::fs::read(data(name)).expect("readable");
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path: &Path = &folder.path().join("cut.exr");
        for length in (0..bytes.len()).step_by(5) {
            place(path, &bytes[..length]);
            // Chunks may have any order, but each part is needed.
            assert!(ExrFile::read(path).is_err_and(|_| whole.parts.len() < 9), "{name} {length}");
        }
    }
}
