//! Reads PNG files as linear floats.

use std::io::Cursor;

use png::{BitDepth, ColorType, Decoder, Info, Limits, Transformations};

use super::Samples;
use crate::image::Image;
use crate::image::bytes::{LARGEST_DECODED, LARGEST_RATIO, LONGEST_SIDE};

/// The largest number of bytes that the decoder may reserve in addition to the pixels, for a row and for chunks.
const BESIDE_PIXELS: usize = 1 << 20;

pub(in crate::image) fn decode(bytes: &[u8], kind: Samples) -> Result<Image, String> {
    let limits = Limits { bytes: BESIDE_PIXELS };
    let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), limits);
    decoder.set_transformations(Transformations::EXPAND);
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    check(decoder.read_header_info().map_err(|error| error.to_string())?, bytes.len())?;
    let mut reader = decoder.read_info().map_err(|error| error.to_string())?;
    let linear = match kind {
        Samples::Colours => Linear::of(reader.info())?,
        Samples::Data => Linear::Power(1.0),
    };
    let length = reader.output_buffer_size().ok_or("the file's pixels don't fit in memory")?;
    let mut samples = vec![0; length];
    let frame = reader.next_frame(&mut samples).map_err(|error| error.to_string())?;
    // Reads to the end of the file. A file that was cut off after its pixels is damaged, too.
    reader.finish().map_err(|error| error.to_string())?;
    let pixels = match frame.bit_depth {
        BitDepth::Sixteen => {
            let (table, opaque) = (linear.table(65_536), 65_535.0);
            let value = |two: &[u8; 2]| u16::from_be_bytes(*two);
            let values = samples.as_chunks().0.iter().map(value);
            let values: Vec<u16> = values.collect();
            gather(&values, frame.color_type, &table, opaque)
        }
        _ => gather(&samples, frame.color_type, &linear.table(256), 255.0),
    };
    let expected = frame.width as usize * frame.height as usize;
    if pixels.len() != expected {
        return Err(format!("the file has {} pixels instead of {expected}", pixels.len()));
    }
    Ok(Image::new(frame.width, frame.height, pixels))
}

/// Checks the same limits as for OpenEXR files. For the limit [`LARGEST_RATIO`], the size of the pixels is their size
/// in the PNG's own format, not their size as floats.
fn check(info: &Info<'_>, length: usize) -> Result<(), String> {
    let Info { width, height, .. } = *info;
    if width.max(height) > LONGEST_SIDE {
        return Err(format!(
            "the file's header announces {width} x {height} pixels, but each side must have 1 to {LONGEST_SIDE} pixels"
        ));
    }
    let area = u64::from(width) * u64::from(height);
    let decoded = area * size_of::<[f32; 4]>() as u64;
    if decoded > LARGEST_DECODED {
        return Err(format!(
            "the file's header announces {} MB of pixels, but Karat reads at most {} MB",
            decoded >> 20,
            LARGEST_DECODED >> 20
        ));
    }
    let stored = area * info.bits_per_pixel() as u64 / 8;
    if stored > (length as u64).saturating_mul(LARGEST_RATIO) {
        return Err(format!(
            "the file's header announces {stored} bytes of pixels, but the file has {length} bytes"
        ));
    }
    Ok(())
}

/// Converts samples to pixels. Alpha is already linear, so the function only scales alpha to 0..=1.
fn gather<T: Copy + Into<usize> + Into<f32>>(
    samples: &[T],
    color: ColorType,
    table: &[f32],
    opaque: f32,
) -> Vec<[f32; 4]> {
    let light = |sample: T| table[Into::<usize>::into(sample)];
    let alpha = |sample: T| Into::<f32>::into(sample) / opaque;
    let grey = |value: f32, alpha: f32| [value, value, value, alpha];
    match color {
        ColorType::Grayscale => samples.iter().map(|v| grey(light(*v), 1.0)).collect(),
        ColorType::GrayscaleAlpha => {
            let pixels = samples.as_chunks().0.iter();
            pixels.map(|[v, a]| grey(light(*v), alpha(*a))).collect()
        }
        ColorType::Rgb => {
            let pixels = samples.as_chunks().0.iter();
            pixels.map(|[r, g, b]| [light(*r), light(*g), light(*b), 1.0]).collect()
        }
        ColorType::Rgba => {
            let pixels = samples.as_chunks().0.iter();
            pixels.map(|[r, g, b, a]| [light(*r), light(*g), light(*b), alpha(*a)]).collect()
        }
        // The decoder has already replaced indices by colours.
        ColorType::Indexed => Vec::new(),
    }
}

/// The function that converts samples to linear values.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Linear {
    /// The curve of sRGB, IEC 61966-2-1.
    Srgb,
    /// The power function with this exponent.
    Power(f64),
}

impl Linear {
    /// The conversion that a file's chunks demand (PNG, third edition, 4.3). An sRGB chunk overrides a gAMA chunk.
    fn of(info: &Info<'_>) -> Result<Self, String> {
        match info.gama_chunk {
            Some(gamma) if info.srgb.is_none() => {
                let gamma = f64::from(gamma.into_scaled()) / 100_000.0;
                // With an exponent outside of this range, almost all 8-bit samples would become 0 or 1.
                if !(0.01..=100.0).contains(&gamma) {
                    return Err(format!(
                        "the file's gAMA chunk has the value {gamma}, but Karat reads only 0.01 to 100"
                    ));
                }
                Ok(Self::Power(1.0 / gamma))
            }
            _ => Ok(Self::Srgb),
        }
    }

    fn table(self, samples: u32) -> Vec<f32> {
        let linear = |sample: u32| {
            let encoded = f64::from(sample) / f64::from(samples - 1);
            let value = match self {
                Self::Srgb if encoded <= 0.040_45 => encoded / 12.92,
                Self::Srgb => ((encoded + 0.055) / 1.055).powf(2.4),
                Self::Power(power) => encoded.powf(power),
            };
            #[expect(clippy::cast_possible_truncation, reason = "what an image holds")]
            let value = value as f32;
            value
        };
        (0..samples).map(linear).collect()
    }
}
