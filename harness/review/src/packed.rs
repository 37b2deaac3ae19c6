//! Images in the format of the page: planes of bytes that deflate well, in base64.
//!
//! Each channel is a plane of words: 16-bit floats if these can represent every value, and otherwise 32-bit floats. If
//! a frame has the size and the format of its golden, each word of the frame is stored as its difference from the
//! golden's word at the same pixel, which is 0 for equal words. All other words are stored as differences from the
//! previous word. Zigzag encoding turns small differences of either sign into small bytes. In each channel, the highest
//! bytes of all words come first, and the lowest bytes last. `numbers.js` reads this format.

use std::io::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use half::f16;
use karat::Image;
use serde_json::{Value, json};

/// The word for a pixel without a value in a map. No value has this word, because all values are finite.
const HOLE: u16 = f16::NAN.to_bits();

/// The channels of an image as the bits of floats. `format` gives the size of a word.
struct Planes {
    format: Format,
    words: Vec<Vec<u32>>,
}

#[derive(Clone, Copy, PartialEq)]
enum Format {
    Half,
    Float,
}

impl Format {
    fn name(self) -> &'static str {
        match self {
            Self::Half => "f16",
            Self::Float => "f32",
        }
    }

    fn bytes(self) -> u32 {
        match self {
            Self::Half => 2,
            Self::Float => 4,
        }
    }
}

impl Planes {
    /// Converts an image to the smallest format that can represent every value.
    fn of(image: &Image) -> Self {
        let mut values = image.pixels().iter().flatten();
        let fits = |value: &f32| f16::from_f32(*value).to_f32().to_bits() == value.to_bits();
        let format = if values.all(fits) { Format::Half } else { Format::Float };
        let word = |value: f32| match format {
            Format::Half => u32::from(f16::from_f32(value).to_bits()),
            Format::Float => value.to_bits(),
        };
        let plane =
            |channel: usize| image.pixels().iter().map(|pixel| word(pixel[channel])).collect();
        Self { format, words: (0..4).map(plane).collect() }
    }

    /// Returns the bytes of all words, as differences from the words of `base`, or from the previous word if there is
    /// no `base`.
    fn bytes(&self, base: Option<&Self>) -> Vec<u8> {
        let bits = 8 * self.format.bytes();
        let mask = u32::MAX >> (32 - bits);
        let mut out = Vec::new();
        for (channel, plane) in self.words.iter().enumerate() {
            let mut before = 0;
            let zigzag = |(at, word): (usize, &u32)| {
                let from = base.map_or(before, |base| base.words[channel][at]);
                before = *word;
                let distance = word.wrapping_sub(from) & mask;
                ((distance << 1) ^ if distance >> (bits - 1) == 1 { mask } else { 0 }) & mask
            };
            let words: Vec<u32> = plane.iter().enumerate().map(zigzag).collect();
            for byte in (0..self.format.bytes()).rev() {
                out.extend(words.iter().map(|word| (word >> (8 * byte)) as u8));
            }
        }
        out
    }
}

/// Returns the golden's or the frame's image in the format of the page. To store a frame as differences from its
/// golden, pass the golden's image as `golden`.
pub(super) fn image(image: &Image, golden: Option<&Image>) -> Value {
    let same_size =
        |other: &&Image| (other.width(), other.height()) == (image.width(), image.height());
    let planes = Planes::of(image);
    let base = golden.filter(same_size).map(Planes::of);
    let base = base.filter(|base| base.format == planes.format);
    value(image, &planes, base.as_ref())
}

/// Returns a map of scalars as half floats, which are exact enough for viewing. Pixels with an alpha of 0 are holes. A
/// map in colours, unlike a map of scalars, has the same format as an image.
pub(super) fn map(image: &Image) -> Value {
    let scalar = |pixel: &[f32; 4]| pixel[0] == pixel[1] && pixel[0] == pixel[2];
    if !image.pixels().iter().all(scalar) {
        return self::image(image, None);
    }
    let word =
        |pixel: &[f32; 4]| if pixel[3] == 0.0 { HOLE } else { f16::from_f32(pixel[0]).to_bits() };
    let plane = image.pixels().iter().map(|pixel| u32::from(word(pixel))).collect();
    value(image, &Planes { format: Format::Half, words: vec![plane] }, None)
}

fn value(image: &Image, planes: &Planes, base: Option<&Planes>) -> Value {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::new(7));
    let packed = encoder.write_all(&planes.bytes(base)).and_then(|()| encoder.finish());
    json!({
        "width": image.width(),
        "height": image.height(),
        "format": planes.format.name(),
        "packed": { "channels": planes.words.len(), "of_golden": base.is_some() },
        "data": STANDARD.encode(packed.expect("memory takes all")),
    })
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
        // The values are squares, so that all neighbours have different distances.
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
