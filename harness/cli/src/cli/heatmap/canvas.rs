//! An image of 8-bit colours, into which Karat draws pixels, rectangles and numbers.

/// The colour of the background. This grey differs from the first and the last colour of the scale for errors.
const GROUND: [u8; 3] = [56, 56, 56];

/// An image in 8-bit sRGB colours. Its bytes begin with the top row.
#[derive(Debug)]
pub(super) struct Canvas {
    pub(super) width: u32,
    bytes: Vec<u8>,
}

/// The numbers of columns and rows of a glyph.
pub(super) const GLYPH: (u32, u32) = (3, 5);

/// The glyphs of the digits and the decimal point. The first row is the top row, and the highest of a row's three bits
/// is the leftmost pixel. Numbers need only these glyphs, so Karat doesn't use a crate with fonts, which would bring a
/// drawing library.
const GLYPHS: [(char, [u8; 5]); 11] = [
    ('0', [0b111, 0b101, 0b101, 0b101, 0b111]),
    ('1', [0b010, 0b110, 0b010, 0b010, 0b111]),
    ('2', [0b111, 0b001, 0b111, 0b100, 0b111]),
    ('3', [0b111, 0b001, 0b111, 0b001, 0b111]),
    ('4', [0b101, 0b101, 0b111, 0b001, 0b001]),
    ('5', [0b111, 0b100, 0b111, 0b001, 0b111]),
    ('6', [0b111, 0b100, 0b111, 0b101, 0b111]),
    ('7', [0b111, 0b001, 0b001, 0b010, 0b010]),
    ('8', [0b111, 0b101, 0b111, 0b101, 0b111]),
    ('9', [0b111, 0b101, 0b111, 0b001, 0b111]),
    ('.', [0b000, 0b000, 0b000, 0b000, 0b010]),
];

impl Canvas {
    pub(super) fn new(width: u32, height: u32) -> Self {
        let pixels = width as usize * height as usize;
        Self { width, bytes: GROUND.repeat(pixels) }
    }

    pub(super) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    pub(super) fn height(&self) -> u32 {
        #[expect(clippy::cast_possible_truncation, reason = "it was made of a height")]
        let height = (self.bytes.len() / 3 / self.width.max(1) as usize) as u32;
        height
    }

    pub(super) fn set(&mut self, x: u32, y: u32, colour: [u8; 3]) {
        let start = (y as usize * self.width as usize + x as usize) * 3;
        self.bytes[start..start + 3].copy_from_slice(&colour);
    }

    pub(super) fn fill(
        &mut self,
        (left, top): (u32, u32),
        (width, height): (u32, u32),
        colour: [u8; 3],
    ) {
        for y in top..top + height {
            (left..left + width).for_each(|x| self.set(x, y, colour));
        }
    }

    /// Returns the width of a number in pixels of the image, if each pixel of a glyph is `size` pixels wide.
    pub(super) fn measure(number: &str, size: u32) -> u32 {
        let glyphs = u32::try_from(number.len()).unwrap_or(u32::MAX);
        (glyphs * (GLYPH.0 + 1)).saturating_sub(1) * size
    }

    /// Writes a number.
    pub(super) fn write(
        &mut self,
        number: &str,
        (left, top): (u32, u32),
        size: u32,
        colour: [u8; 3],
    ) {
        for (column, character) in (0..).zip(number.chars()) {
            let Some((_, rows)) = GLYPHS.iter().find(|(known, _)| *known == character) else {
                continue;
            };
            for (y, row) in (0..).zip(rows) {
                for x in (0..GLYPH.0).filter(|x| row >> (GLYPH.0 - 1 - x) & 1 == 1) {
                    let corner = (left + (column * (GLYPH.0 + 1) + x) * size, top + y * size);
                    self.fill(corner, (size, size), colour);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drawn_numbers_have_their_measured_size() {
        let mut canvas = Canvas::new(Canvas::measure("0.7", 1), GLYPH.1);
        canvas.write("0.7", (0, 0), 1, [255; 3]);
        let rows = canvas.bytes().chunks(3 * canvas.width as usize);
        let text = |row: &[u8]| {
            row.chunks(3).map(|pixel| if pixel[0] == 255 { '#' } else { ' ' }).collect::<String>()
        };
        let rows: Vec<String> = rows.map(text).collect();
        let expected = ["###     ###", "# #       #", "# #       #", "# #      # ", "###  #   # "];
        assert_eq!(rows, expected);
        assert_eq!((canvas.width, canvas.height()), (11, 5));
        assert_eq!(Canvas::measure("0.7", 3), 33);
    }
}
