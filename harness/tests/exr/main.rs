//! Image files: files of other programs, damaged and hostile files, and full disks.
//!
//! The crate `allocation-counter` replaces the global allocator, and counts the memory that the decoding thread
//! allocates.

mod disk;
mod foreign;
mod hostile;
mod parts;
mod png;

use std::path::{Path, PathBuf};

use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Layer, LayerAttributes,
    LineOrder, SampleType, SmallVec, Vec2, WritableImage, f16,
};

/// A file below `data/exr`.
fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/exr").join(name)
}

/// The message of the error that `read` returns for a file with these bytes.
fn message<T>(bytes: &[u8], read: fn(&Path) -> Result<T, karat::image::ImageError>) -> String {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("a.exr");
    std::fs::write(&path, bytes).expect("written");
    let error = read(&path).err().expect("an error").to_string();
    // The path of the temporary folder depends on the system.
    let shown = path.display().to_string();
    assert!(error.contains(&shown), "{error}");
    error.replace(&shown, "a.exr")
}

/// Removes a file, and writes a new one. This is faster than overwriting the old file, which would wait for the disk.
fn place(path: &Path, bytes: &[u8]) {
    if path.exists() {
        std::fs::remove_file(path).expect("removed");
    }
    std::fs::write(path, bytes).expect("written");
}

const SIZE: Vec2<usize> = Vec2(24, 20);

/// A pixel's value. Some regions are smooth, and others are noise.
fn value(channel: usize, index: usize) -> f32 {
    let (x, y) = (index % SIZE.0, index / SIZE.0);
    let noise = (index * 2_654_435_761 + channel * 97) % 1009;
    let noise = if x > SIZE.0 / 2 { noise as f32 / 1009.0 } else { 0.0 };
    (x + y * 2) as f32 / 16.0 + channel as f32 + noise
}

type Channels = AnyChannels<FlatSamples>;

fn channel(name: &str, sample: SampleType, number: usize) -> AnyChannel<FlatSamples> {
    let values = (0..SIZE.area()).map(|index| value(number, index));
    let samples = match sample {
        SampleType::F16 => FlatSamples::F16(values.map(f16::from_f32).collect()),
        SampleType::F32 => FlatSamples::F32(values.collect()),
        SampleType::U32 => FlatSamples::U32(values.map(|v| (v * 1000.0) as u32).collect()),
    };
    AnyChannel::new(name, samples)
}

fn rgba(sample: SampleType) -> Channels {
    let channels = ["A", "B", "G", "R"].iter().enumerate();
    let channels = channels.map(|(number, name)| channel(name, sample, number));
    AnyChannels::sort(channels.collect::<SmallVec<_>>())
}

fn layer(
    name: &str,
    channels: Channels,
    compression: Compression,
    blocks: Blocks,
) -> Layer<Channels> {
    let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
    Layer::new(SIZE, LayerAttributes::named(name), encoding, channels)
}

fn encode<'a, L>(image: &'a exr::image::Image<L>) -> Vec<u8>
where
    L: exr::image::write::layers::WritableLayers<'a>,
{
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write().non_parallel().to_buffered(&mut bytes).expect("encodes");
    bytes.into_inner()
}

/// The bytes of a file with these layers.
fn file(layers: &[Layer<Channels>]) -> Vec<u8> {
    match layers {
        [layer] => encode(&exr::image::Image::from_layer(layer.clone())),
        layers => {
            let attributes = exr::prelude::ImageAttributes::with_size(SIZE);
            encode(&exr::image::Image::from_layers(attributes, layers.to_vec()))
        }
    }
}

/// The compressions that the crate `exr` can both read and write.
const CODECS: [Compression; 10] = [
    Compression::Uncompressed,
    Compression::RLE,
    Compression::ZIP1,
    Compression::ZIP16,
    Compression::PIZ,
    Compression::PXR24,
    Compression::B44,
    Compression::B44A,
    Compression::DWAA(None),
    Compression::DWAB(None),
];
