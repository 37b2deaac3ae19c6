//! Images as the page gets them: planes of bytes that deflate well, in base64.
//!
//! Each channel is a plane of words, 16-bit floats where they hold every value. A word is stored as
//! its distance to the one before it, or, for a frame, to the golden's at the same place, which is
//! nothing wherever both are equal. Distances go up and down in turn from 0 (zigzag), so that small
//! ones have small bytes, and all high bytes stand before all low ones. `numbers.js` reads them.

use std::io::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use half::f16;
use karat::Image;
use serde_json::{Value, json};

/// Where a map has no value; its values are finite.
const HOLE: u16 = f16::NAN.to_bits();

/// An image's channels as the bits of floats.
#[derive(PartialEq)]
enum Planes {
    Half(Vec<Vec<u16>>),
    Float(Vec<Vec<u32>>),
}

impl Planes {
    /// The smallest format that holds every value.
    fn of(image: &Image) -> Self {
        let mut values = image.pixels().iter().flatten();
        let fits = |value: &f32| f16::from_f32(*value).to_f32().to_bits() == value.to_bits();
        let channels = 0..4;
        let plane = |channel: usize| image.pixels().iter().map(move |pixel| pixel[channel]);
        if values.all(fits) {
            Self::Half(
                channels.map(|c| plane(c).map(|v| f16::from_f32(v).to_bits()).collect()).collect(),
            )
        } else {
            Self::Float(channels.map(|c| plane(c).map(f32::to_bits).collect()).collect())
        }
    }
}

/// A side of a part. `golden` is the other one, if this is the frame.
pub(super) fn image(image: &Image, golden: Option<&Image>) -> Value {
    let same_size =
        |other: &&Image| (other.width(), other.height()) == (image.width(), image.height());
    let base = golden.filter(same_size).map(Planes::of);
    let (format, base, bytes) = match (Planes::of(image), base) {
        (Planes::Half(planes), Some(Planes::Half(base))) => {
            ("f16", true, half_bytes(&planes, Some(&base)))
        }
        (Planes::Half(planes), _) => ("f16", false, half_bytes(&planes, None)),
        (Planes::Float(planes), Some(Planes::Float(base))) => {
            ("f32", true, float_bytes(&planes, Some(&base)))
        }
        (Planes::Float(planes), _) => ("f32", false, float_bytes(&planes, None)),
    };
    value(image, format, base, 4, &bytes)
}

/// A map of scalars, which are looked at and not judged: half floats, and nothing where alpha is 0.
/// One in colours is an image.
pub(super) fn map(image: &Image) -> Value {
    let scalar = |pixel: &[f32; 4]| pixel[0] == pixel[1] && pixel[0] == pixel[2];
    if !image.pixels().iter().all(scalar) {
        return self::image(image, None);
    }
    let word =
        |pixel: &[f32; 4]| if pixel[3] == 0.0 { HOLE } else { f16::from_f32(pixel[0]).to_bits() };
    let plane = image.pixels().iter().map(word).collect();
    value(image, "f16", false, 1, &half_bytes(&[plane], None))
}

fn value(image: &Image, format: &str, base: bool, channels: usize, bytes: &[u8]) -> Value {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::new(7));
    let packed = encoder.write_all(bytes).and_then(|()| encoder.finish());
    json!({
        "width": image.width(),
        "height": image.height(),
        "format": format,
        "packed": { "channels": channels, "of_golden": base },
        "data": STANDARD.encode(packed.expect("memory takes all")),
    })
}

fn half_bytes(planes: &[Vec<u16>], base: Option<&[Vec<u16>]>) -> Vec<u8> {
    let mut out = Vec::new();
    for (channel, plane) in planes.iter().enumerate() {
        let mut before = 0;
        let words: Vec<u16> = (0..plane.len())
            .map(|at| {
                let from = base.map_or(before, |base| base[channel][at]);
                before = plane[at];
                let distance = plane[at].wrapping_sub(from);
                (distance << 1) ^ if distance >> 15 == 1 { u16::MAX } else { 0 }
            })
            .collect();
        out.extend(words.iter().map(|word| word.to_be_bytes()[0]));
        out.extend(words.iter().map(|word| word.to_be_bytes()[1]));
    }
    out
}

fn float_bytes(planes: &[Vec<u32>], base: Option<&[Vec<u32>]>) -> Vec<u8> {
    let mut out = Vec::new();
    for (channel, plane) in planes.iter().enumerate() {
        let mut before = 0;
        let words: Vec<u32> = (0..plane.len())
            .map(|at| {
                let from = base.map_or(before, |base| base[channel][at]);
                before = plane[at];
                let distance = plane[at].wrapping_sub(from);
                (distance << 1) ^ if distance >> 31 == 1 { u32::MAX } else { 0 }
            })
            .collect();
        for byte in 0..4 {
            out.extend(words.iter().map(|word| word.to_be_bytes()[byte]));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_format_that_holds_every_value_is_taken() {
        let format =
            |value| image(&Image::new(1, 1, vec![[value, 0.0, -0.0, 1.0]]), None)["format"].clone();
        assert_eq!(format(0.5), "f16");
        assert_eq!(format(f32::INFINITY), "f16");
        assert_eq!(format(0.1), "f32");
        assert_eq!(format(1e6), "f32");
    }

    #[test]
    fn a_frame_that_is_nearly_its_golden_takes_little() {
        // Squares, so that neighbours aren't at the same distance everywhere.
        let noise = |index: usize| {
            let square = (index * index) as u32;
            f32::from((square.wrapping_mul(2_654_435_761) >> 20) as u16) / 4096.0
        };
        let golden = Image::new(
            64,
            64,
            (0..4096).map(|i| [noise(i), noise(i + 7), noise(i + 13), 1.0]).collect(),
        );
        let mut actual = golden.clone();
        actual.pixels_mut()[77][0] = 0.5;
        let length = |value: &Value| value["data"].as_str().expect("text").len();
        let (whole, nearly) = (image(&golden, None), image(&actual, Some(&golden)));
        assert!(
            length(&whole) > 5000 && length(&nearly) < 200,
            "{} {}",
            length(&whole),
            length(&nearly)
        );
        assert_eq!(nearly["packed"]["of_golden"], true);
        assert_eq!(
            image(&actual, Some(&Image::new(1, 1, vec![[0.0; 4]])))["packed"]["of_golden"],
            false
        );
    }
}
