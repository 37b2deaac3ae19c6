//! PNG files of every kind, and damaged PNG files.

use std::path::Path;

use karat::Image;
use karat::image::ImageError;
use png::{BitDepth, ColorType, Encoder};

use super::{message, place};

fn encode(
    color: ColorType,
    depth: BitDepth,
    width: u32,
    samples: &[u8],
    more: impl FnOnce(&mut Encoder<'_, &mut Vec<u8>>),
) -> Vec<u8> {
    let mut bytes = Vec::new();
    let bits = color.samples() * depth as usize * width as usize;
    let height = (samples.len() / bits.div_ceil(8)) as u32;
    let mut encoder = Encoder::new(&mut bytes, width, height);
    encoder.set_color(color);
    encoder.set_depth(depth);
    more(&mut encoder);
    let mut writer = encoder.write_header().expect("sound");
    writer.write_image_data(samples).expect("as many samples as pixels");
    writer.finish().expect("written");
    bytes
}

fn read(bytes: &[u8]) -> Result<Image, ImageError> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    // The file's content decides, not its name.
    let path = folder.path().join("a.exr");
    std::fs::write(&path, bytes).expect("written");
    Image::read(&path)
}

/// Decodes sRGB by IEC 61966-2-1.
fn srgb(encoded: f64) -> f32 {
    let linear =
        if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) };
    linear as f32
}

fn pixels(bytes: &[u8]) -> Vec<[f32; 4]> {
    read(bytes).expect("readable").pixels().to_vec()
}

#[test]
fn masks_are_read_as_stored() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("mask.png");
    let stored = |bytes: &[u8]| {
        std::fs::write(&path, bytes).expect("written");
        Image::read_stored(&path).expect("readable").pixels().to_vec()
    };
    let gamma = |encoder: &mut Encoder<'_, &mut Vec<u8>>| {
        encoder.set_source_gamma(png::ScaledFloat::new(0.25));
    };
    let eighth = |byte: u8| f32::from(byte) / 255.0;
    let grey = encode(ColorType::Grayscale, BitDepth::Eight, 2, &[127, 128], gamma);
    let reds: Vec<f32> = stored(&grey).iter().map(|pixel| pixel[0]).collect();
    assert_eq!(reds, [eighth(127), eighth(128)]);
    let alpha = encode(ColorType::GrayscaleAlpha, BitDepth::Sixteen, 1, &[128, 0, 0, 0], |_| {});
    let half = 32_768.0 / 65_535.0;
    assert_eq!(stored(&alpha), [[half, half, half, 0.0]]);
    Image::new(1, 1, vec![[0.25, 2.0, -1.0, 0.5]])
        .write_exr(&path, karat::image::Precision::Float, None)
        .expect("written");
    let image = Image::read_stored(&path).expect("readable");
    assert_eq!(image.pixels(), [[0.25, 2.0, -1.0, 0.5]]);
}

#[test]
fn every_kind_of_png_becomes_linear() {
    let plain = |_: &mut Encoder<'_, &mut Vec<u8>>| {};
    let of = |byte: u8| srgb(f64::from(byte) / 255.0);
    let rgb = encode(ColorType::Rgb, BitDepth::Eight, 2, &[0, 10, 255, 1, 2, 3], plain);
    assert_eq!(pixels(&rgb), [[0.0, of(10), 1.0, 1.0], [of(1), of(2), of(3), 1.0]]);
    let rgba = encode(ColorType::Rgba, BitDepth::Eight, 1, &[0, 10, 255, 51], plain);
    assert_eq!(pixels(&rgba), [[0.0, of(10), 1.0, 0.2]]);
    let grey = encode(ColorType::Grayscale, BitDepth::Eight, 1, &[188], plain);
    assert_eq!(pixels(&grey), [[of(188), of(188), of(188), 1.0]]);
    let alpha = encode(ColorType::GrayscaleAlpha, BitDepth::Eight, 1, &[188, 0], plain);
    assert_eq!(pixels(&alpha), [[of(188), of(188), of(188), 0.0]]);
    // 0b10 of two bits is 2/3.
    let two = encode(ColorType::Grayscale, BitDepth::Two, 1, &[0b1000_0000], plain);
    assert_eq!(pixels(&two), [[of(170), of(170), of(170), 1.0]]);
    let deep = encode(ColorType::Rgb, BitDepth::Sixteen, 1, &[0x12, 0x34, 0, 0, 255, 255], plain);
    assert_eq!(pixels(&deep), [[srgb(f64::from(0x1234) / 65535.0), 0.0, 1.0, 1.0]]);
    let palette = encode(ColorType::Indexed, BitDepth::Eight, 2, &[1, 0], |encoder| {
        encoder.set_palette(vec![0, 10, 255, 1, 2, 3]);
        encoder.set_trns(vec![51]);
    });
    assert_eq!(pixels(&palette), [[of(1), of(2), of(3), 1.0], [0.0, of(10), 1.0, 0.2]]);
}

#[test]
fn a_gamma_chunk_counts_unless_there_is_an_srgb_chunk() {
    let gamma = png::ScaledFloat::new(0.5);
    let power = encode(ColorType::Grayscale, BitDepth::Eight, 1, &[51], |encoder| {
        encoder.set_source_gamma(gamma);
    });
    assert!((pixels(&power)[0][0] - 0.04).abs() < 1e-7);
    let srgb_too = encode(ColorType::Grayscale, BitDepth::Eight, 1, &[51], |encoder| {
        encoder.set_source_gamma(gamma);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    });
    assert_eq!(pixels(&srgb_too)[0][0], srgb(0.2));
    let none = encode(ColorType::Grayscale, BitDepth::Eight, 1, &[51], |encoder| {
        encoder.set_source_gamma(png::ScaledFloat::new(0.001));
    });
    let expected = "`a.exr` isn't a readable PNG image: the file's gAMA chunk has the value 0.001, but Karat reads only 0.01 to 100";
    assert_eq!(message(&none, Image::read), expected);
}

/// `data/png/make_interlaced.py` wrote the files, because the crate `png` can't write interlaced files.
#[test]
fn interlaced_files_are_read() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/png/interlaced.png");
    let bytes = std::fs::read(path).expect("readable");
    assert_eq!(bytes[28], 1, "it is interlaced");
    let image = read(&bytes).expect("readable");
    assert_eq!((image.width(), image.height()), (11, 7));
    for (i, pixel) in (0..).zip(image.pixels()) {
        let (x, y) = (i % 11, i / 11);
        let of = |byte: u32| srgb(f64::from(byte) / 255.0);
        assert_eq!(*pixel, [of(x * 20), of(y * 30), of(x * y), 1.0], "({x}, {y})");
    }
}

#[test]
fn previews_are_read_back() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("a.png");
    Image::new(3, 1, vec![[0.5, 0.5, 0.5, 1.0]; 3]).write_png(&path).expect("written");
    let image = Image::read(&path).expect("readable");
    // 0.18 / 1.18, in 8 bits.
    assert!((image.pixels()[0][0] - 0.1525).abs() < 2e-3, "{image:?}");
}

#[test]
fn limits_hold_for_png_too() {
    let plain = |_: &mut Encoder<'_, &mut Vec<u8>>| {};
    let bytes = encode(ColorType::Grayscale, BitDepth::One, 16_384, &[0; 2048 * 4096], plain);
    let reason = |bytes: &[u8]| {
        let mut text = String::new();
        let memory = allocation_counter::measure(|| text = message(bytes, Image::read));
        assert!(memory.bytes_max < 1 << 20, "{memory:?}");
        text.rsplit_once(": ").expect("a reason").1.to_owned()
    };
    assert_eq!(
        reason(&bytes),
        "the file's header announces 1024 MB of pixels, but Karat reads at most 512 MB"
    );
    let wide = encode(ColorType::Grayscale, BitDepth::One, 16_385, &[0; 2049], plain);
    assert_eq!(
        reason(&wide),
        "the file's header announces 16385 x 1 pixels, but each side must have 1 to 16384 pixels"
    );
    // The header declares many pixels, and none follow. The checksum of the header is right.
    let mut many = encode(ColorType::Rgba, BitDepth::Sixteen, 5000, &[0; 40_000], plain);
    many.truncate(33);
    many[20..24].copy_from_slice(&5000_u32.to_be_bytes());
    let mut checksum = u32::MAX;
    for byte in &many[12..29] {
        checksum ^= u32::from(*byte);
        for _ in 0..8 {
            checksum = (checksum >> 1) ^ (0xedb8_8320 * (checksum & 1));
        }
    }
    many[29..33].copy_from_slice(&(!checksum).to_be_bytes());
    assert_eq!(
        reason(&many),
        "the file's header announces 200000000 bytes of pixels, but the file has 33 bytes"
    );
}

#[test]
fn damaged_files_are_images_or_refused() {
    let samples: Vec<u8> = (0..24 * 20 * 4).map(|i| (i * i % 251) as u8).collect();
    let text = |encoder: &mut Encoder<'_, &mut Vec<u8>>| {
        encoder.add_ztxt_chunk("Comment".into(), "long ".repeat(100)).expect("sound");
    };
    let seeds = [
        encode(ColorType::Rgba, BitDepth::Eight, 24, &samples, text),
        encode(ColorType::Rgb, BitDepth::Sixteen, 20, &samples, |_| {}),
        encode(ColorType::Indexed, BitDepth::Eight, 24, &samples, |encoder| {
            encoder.set_palette((0..=255).flat_map(|i| [i, i / 2, 7]).collect::<Vec<u8>>());
            encoder.set_source_gamma(png::ScaledFloat::new(0.45455));
        }),
    ];
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("damaged.png");
    let (mut accepted, mut refused) = (0, 0);
    let mut state = 20_260_102_u64;
    let mut below = |end: usize| {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % end
    };
    for seed in &seeds {
        for round in 0..400 {
            let mut bytes = seed.clone();
            let at = below(bytes.len());
            match round % 4 {
                0 => bytes[at] ^= 1 << below(8),
                1 => bytes.truncate(at),
                2 => bytes[at] = [0, 0x7f, 0x80, 0xff][below(4)],
                _ => drop(bytes.drain(at..(at + 1 + below(40)).min(seed.len()))),
            }
            place(&path, &bytes);
            let mut result = None;
            let memory = allocation_counter::measure(|| result = Some(Image::read(&path)));
            // The files are small. The decoder's own buffers are larger than the pixels.
            assert!(memory.bytes_max < 4 << 20, "{memory:?}");
            match result.expect("it was read") {
                Ok(_) => accepted += 1,
                Err(ImageError::Corrupt { .. } | ImageError::Unknown { .. }) => refused += 1,
                Err(error) => panic!("{error}"),
            }
        }
    }
    assert!(refused > 1000, "{accepted} read, {refused} refused");
}
