//! Means of tiles: what is wrong in one place isn't diluted by the rest of the frame.

use super::mask::Rect;
use super::pair::Pair;

/// Pixels a side of a tile. A tile is as wide as a degree of sight's quarter, about what the
/// filters of FLIP reach, so that a small fault fills one.
pub const TILE: u32 = 16;

/// An error for each pixel of a part of a frame; outside of the part it is 0.
#[derive(Clone, Debug, PartialEq)]
pub struct ErrorMap {
    rect: Rect,
    values: Vec<f32>,
}

/// Ends of scales. 1 is that of other tools, so that pictures of large errors compare with theirs;
/// small errors would all be black there. Below a thousandth nobody sees anything, and everything
/// would look wrong.
const STEPS: [f32; 10] = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0];

impl ErrorMap {
    /// The errors of a rectangle, row by row.
    ///
    /// # Panics
    /// If there isn't one for each pixel of the rectangle.
    #[must_use]
    pub fn new(rect: Rect, values: Vec<f32>) -> Self {
        let expected = rect.width as usize * rect.height as usize;
        assert_eq!(values.len(), expected, "a map of {rect:?} has {expected} values");
        Self { rect, values }
    }

    /// The part of the frame that has errors.
    #[must_use]
    pub fn rect(&self) -> Rect {
        self.rect
    }

    /// The errors of that part, row by row.
    #[must_use]
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// The error that the last colour of a picture of these errors stands for: the least of 1, 0.5,
    /// 0.2, 0.1 and so on down to 0.001 that none exceeds, and 1 if there is no error at all.
    #[must_use]
    pub fn scale(errors: &[f32]) -> f32 {
        let largest = errors.iter().copied().fold(0.0, f32::max);
        let end = STEPS.into_iter().find(|step| largest <= *step).unwrap_or(1.0);
        if largest == 0.0 { 1.0 } else { end }
    }

    /// The colour that pictures show an error from 0 to 1 in, as 8-bit sRGB: matplotlib's magma
    /// (Smith and van der Walt 2015, CC0), as in the pictures of NVIDIA's FLIP.
    #[must_use]
    pub fn colour(error: f32) -> [u8; 3] {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255")]
        let index = (error.clamp(0.0, 1.0) * 255.0).round() as usize; // NaN is 0
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255")]
        let bytes = flip_rs::MAGMA[index].map(|value| (value * 255.0).round() as u8);
        bytes
    }

    /// The error of a pixel of the frame.
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

    /// The mean over all pixels that are compared.
    #[must_use]
    pub fn mean(&self, pair: &Pair<'_>) -> f64 {
        let counted = self.pixels().filter(|(x, y, _)| pair.counts(*x, *y));
        counted.map(|(_, _, value)| value).sum::<f64>() / pair.compared() as f64
    }

    /// The largest mean of a [`TILE`] over those of its pixels that are compared, and the tile. A
    /// tile at the edge of the frame has fewer. A mean that isn't a number is larger than all.
    #[must_use]
    pub fn largest_tile(&self, pair: &Pair<'_>) -> (f64, Rect) {
        let (width, height) = (pair.golden().width(), pair.golden().height());
        let (columns, rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
        let mut sums = vec![0.0; columns as usize * rows as usize];
        for (x, y, value) in self.pixels().filter(|(x, y, _)| pair.counts(*x, *y)) {
            sums[(y / TILE * columns + x / TILE) as usize] += value;
        }
        let tile = |index: u32| {
            let (left, top) = (index % columns * TILE, index / columns * TILE);
            Rect::new(left, top, TILE.min(width - left), TILE.min(height - top))
        };
        let mut largest = (0.0, tile(0));
        for (index, sum) in (0..).zip(&sums) {
            if *sum == 0.0 {
                continue;
            }
            let tile = tile(index);
            let mean = sum / pair.compared_in(tile) as f64;
            // NaN is the largest, and stays.
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

    #[test]
    fn the_scale_ends_at_the_next_step() {
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
