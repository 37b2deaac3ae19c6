//! Maps of errors, and the mean errors of tiles. A small fault changes a tile's mean, but hardly the frame's mean.

use super::mask::Rect;
use super::pair::Pair;

/// The side of a tile, in pixels. This side is a quarter of a degree of vision. FLIP's filters spread the error of a
/// single pixel about as far, so even a small fault fills a tile.
pub const TILE: u32 = 16;

/// The side of a cell, in pixels. A tile has two by two cells, and begins one cell after the previous tile.
const CELL: u32 = TILE / 2;

/// The error of each pixel in a rectangle of a frame. Outside of the rectangle the error is 0.
///
/// ```
/// use karat::metric::Rect;
/// use karat::unstable::metric::ErrorMap;
///
/// let map = ErrorMap::new(Rect::new(0, 0, 2, 1), vec![0.1, 0.4]);
/// assert_eq!((map.at(1, 0), map.at(5, 5)), (0.4, 0.0));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct ErrorMap {
    rect: Rect,
    values: Vec<f32>,
}

/// The possible upper ends of the colour scale that shows errors. The error at the end has the brightest colour. The
/// scale of other tools always ends at 1, so they show small errors as black. For large errors, Karat's scale also ends
/// at 1, so the pictures are comparable. Errors below 0.001 are invisible to people, so no scale ends below 0.001.
const STEPS: [f32; 10] = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0];

impl ErrorMap {
    /// A map of the errors of a rectangle, row by row.
    ///
    /// ```
    /// use karat::metric::Rect;
    /// use karat::unstable::metric::ErrorMap;
    ///
    /// let map = ErrorMap::new(Rect::new(8, 8, 2, 1), vec![0.1, 0.4]);
    /// assert_eq!(map.values(), [0.1, 0.4]);
    /// ```
    ///
    /// # Panics
    /// Panics if the number of errors differs from the number of pixels in the rectangle.
    #[must_use]
    pub fn new(rect: Rect, values: Vec<f32>) -> Self {
        let expected = rect.width as usize * rect.height as usize;
        assert_eq!(values.len(), expected, "a map of {rect:?} needs {expected} values");
        Self { rect, values }
    }

    /// The rectangle of the frame for which the map has errors.
    ///
    /// ```
    /// use karat::metric::Rect;
    /// use karat::unstable::metric::ErrorMap;
    ///
    /// let map = ErrorMap::new(Rect::new(8, 8, 2, 1), vec![0.1, 0.4]);
    /// assert_eq!(map.rect(), Rect::new(8, 8, 2, 1));
    /// ```
    #[must_use]
    pub fn rect(&self) -> Rect {
        self.rect
    }

    /// The errors of the rectangle, row by row.
    ///
    /// ```
    /// use karat::metric::Rect;
    /// use karat::unstable::metric::ErrorMap;
    ///
    /// let map = ErrorMap::new(Rect::new(8, 8, 2, 1), vec![0.1, 0.4]);
    /// assert_eq!(map.values(), [0.1, 0.4]);
    /// ```
    #[must_use]
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// The error that has the brightest colour in a picture of these errors: the smallest of 0.001, 0.002, 0.005, 0.01
    /// and so on up to 1 that no error exceeds. The result is 1 if all errors are 0.
    ///
    /// ```
    /// use karat::unstable::metric::ErrorMap;
    ///
    /// assert_eq!(ErrorMap::scale(&[0.003, 0.012]), 0.02);
    /// ```
    #[must_use]
    pub fn scale(errors: &[f32]) -> f32 {
        let largest = errors.iter().copied().fold(0.0, f32::max);
        let end = STEPS.into_iter().find(|step| largest <= *step).unwrap_or(1.0);
        if largest == 0.0 { 1.0 } else { end }
    }

    /// The colour, in 8-bit sRGB, with which a picture shows an error from 0 to 1. The scale is matplotlib's magma
    /// (Smith and van der Walt 2015, CC0), which the pictures of NVIDIA's FLIP also use.
    ///
    /// ```
    /// use karat::unstable::metric::ErrorMap;
    ///
    /// let (black, bright) = (ErrorMap::colour(0.0), ErrorMap::colour(1.0));
    /// assert!(black.iter().all(|channel| *channel < 8) && bright[0] > 240);
    /// ```
    #[must_use]
    pub fn colour(error: f32) -> [u8; 3] {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255")]
        let index = (error.clamp(0.0, 1.0) * 255.0).round() as usize; // NaN becomes 0
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255")]
        let bytes = flip_rs::MAGMA[index].map(|value| (value * 255.0).round() as u8);
        bytes
    }

    /// The error of one pixel of the frame.
    ///
    /// ```
    /// use karat::metric::Rect;
    /// use karat::unstable::metric::ErrorMap;
    ///
    /// let map = ErrorMap::new(Rect::new(8, 8, 2, 1), vec![0.1, 0.4]);
    /// assert_eq!((map.at(9, 8), map.at(0, 0)), (0.4, 0.0));
    /// ```
    #[must_use]
    pub fn at(&self, x: u32, y: u32) -> f32 {
        if !self.rect.contains(x, y) {
            return 0.0;
        }
        let (column, row) = ((x - self.rect.left) as usize, (y - self.rect.top) as usize);
        self.values[row * self.rect.width as usize + column]
    }

    fn pixels(&self) -> impl Iterator<Item = (u32, u32, f64)> {
        let Rect { left, top, width, .. } = self.rect;
        let at = move |index: u32| (left + index % width, top + index / width);
        (0..).zip(&self.values).map(move |(index, value)| {
            let (x, y) = at(index);
            (x, y, f64::from(*value))
        })
    }

    /// The mean error of all compared pixels.
    ///
    /// ```
    /// use karat::Image;
    /// use karat::metric::Rect;
    /// use karat::unstable::metric::Pair;
    /// use karat::unstable::metric::ErrorMap;
    ///
    /// let image = Image::new(2, 1, vec![[0.5; 4]; 2]);
    /// let map = ErrorMap::new(Rect::new(0, 0, 2, 1), vec![0.25, 0.75]);
    /// assert_eq!(map.mean(&Pair::new(&image, &image)?), 0.5);
    /// # Ok::<(), karat::unstable::metric::PairError>(())
    /// ```
    #[must_use]
    pub fn mean(&self, pair: &Pair<'_>) -> f64 {
        let counted = self.pixels().filter(|(x, y, _)| pair.is_compared(*x, *y));
        // The empty sum is -0, and adding 0.0 makes it 0.
        (0.0 + counted.map(|(_, _, value)| value).sum::<f64>()) / pair.compared_count() as f64
    }

    /// The largest mean error of a tile's compared pixels, and the rectangle of this tile. Neighbouring tiles overlap
    /// by half, so at least one tile contains most of a small fault. A tile at the edge of the frame has fewer pixels.
    /// A mean of NaN counts as the largest.
    ///
    /// ```
    /// use karat::Image;
    /// use karat::metric::Rect;
    /// use karat::unstable::metric::Pair;
    /// use karat::unstable::metric::ErrorMap;
    ///
    /// let image = Image::new(2, 1, vec![[0.5; 4]; 2]);
    /// let map = ErrorMap::new(Rect::new(0, 0, 2, 1), vec![0.25, 0.75]);
    /// let (error, tile) = map.largest_tile(&Pair::new(&image, &image)?);
    /// println!("{error} in {tile}");
    /// # Ok::<(), karat::unstable::metric::PairError>(())
    /// ```
    #[must_use]
    pub fn largest_tile(&self, pair: &Pair<'_>) -> (f64, Rect) {
        let (width, height) = (pair.golden().width(), pair.golden().height());
        let (columns, rows) = (width.div_ceil(CELL), height.div_ceil(CELL));
        let mut cells = vec![0.0; columns as usize * rows as usize];
        for (x, y, value) in self.pixels().filter(|(x, y, _)| pair.is_compared(*x, *y)) {
            cells[(y / CELL * columns + x / CELL) as usize] += value;
        }
        let cell = |column: u32, row: u32| {
            let inside = column < columns && row < rows;
            if inside { cells[(row * columns + column) as usize] } else { 0.0 }
        };
        // Tiles begin at every second cell, and at the cells between. The last tile must not be a part of the tile
        // before it.
        let starts = |cells: u32| (0..cells).filter(move |at| at % 2 == 0 || at + 1 < cells);
        let mut largest = (0.0, Rect::new(0, 0, TILE.min(width), TILE.min(height)));
        for (column, row) in starts(rows).flat_map(|row| starts(columns).map(move |c| (c, row))) {
            let sum = (cell(column, row) + cell(column + 1, row))
                + (cell(column, row + 1) + cell(column + 1, row + 1));
            if sum == 0.0 {
                continue;
            }
            let (left, top) = (column * CELL, row * CELL);
            let tile = Rect::new(left, top, TILE.min(width - left), TILE.min(height - top));
            let mean = sum / pair.compared_in(tile) as f64;
            // NaN counts as the largest, so no later mean replaces it.
            if !(mean <= largest.0) && !largest.0.is_nan() {
                largest = (mean, tile);
            }
        }
        largest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Wherever a spot of 8 x 8 pixels is, some tile contains at least 9/16 of the spot.
    // Lesson 20
    #[test]
    fn some_tile_contains_most_of_a_spot_at_any_place() {
        let image = crate::image::Image::new(50, 40, vec![[0.5; 4]; 2000]);
        let pair = Pair::new(&image, &image).expect("finite");
        let (whole, largest) = (64.0 / 256.0, |left: u32, top: u32| {
            let inside = |index: u32| {
                let (x, y) = (index % 50, index / 50);
                (left..left + 8).contains(&x) && (top..top + 8).contains(&y)
            };
            let values = (0..2000).map(|index| if inside(index) { 1.0 } else { 0.0 });
            ErrorMap::new(Rect::new(0, 0, 50, 40), values.collect()).largest_tile(&pair)
        });
        for (left, top) in (0..32).flat_map(|y| (0..40).map(move |x| (x, y))) {
            let (mean, tile) = largest(left, top);
            assert!(mean >= whole * 9.0 / 16.0, "({left}, {top}): {mean} in {tile}");
        }
        assert_eq!(largest(8, 8), (whole, Rect::new(0, 0, 16, 16)));
        assert_eq!(largest(12, 12).1, Rect::new(8, 8, 16, 16), "an overlapping tile contains it");
    }

    #[test]
    fn the_end_of_the_scale_is_rounded_up_to_a_step() {
        for (largest, full) in [
            (0.0, 1.0),
            (1e-9, 0.001),
            (0.0011, 0.002),
            (0.05, 0.05),
            (0.050_001, 0.1),
            (0.3, 0.5),
            (0.51, 1.0),
            (1.0, 1.0),
        ] {
            assert_eq!(ErrorMap::scale(&[0.0, largest]), full, "{largest}");
        }
    }
}
