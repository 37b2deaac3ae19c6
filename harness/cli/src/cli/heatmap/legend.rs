//! The legend of a heat map: a strip of all colours, with numbers.

use karat::unstable::metric::ErrorMap;

use super::canvas::{Canvas, GLYPH};

const INK: [u8; 3] = [230, 230, 230];

/// The margin of the legend, in units. A unit is one or more pixels wide (see [`UNIT`]).
const MARGIN: u32 = 4;
const BAR: u32 = 8;
const TICK: u32 = 3;
/// The width and height of a glyph's dot, in units. A glyph is only 3 dots wide and 5 dots high, so dots of one unit
/// would be too small to read.
const DOT: u32 = 2;
/// The image width for which a unit is one pixel wide. In an image that is twice as wide, a unit is 2 pixels wide.
/// People view wide images scaled down, so a wide image needs a larger legend.
const UNIT: u32 = 960;
/// The smallest width, in units, of a bar with [`PARTS`] parts. A narrower bar has numbers only at its two ends.
const WIDE: u32 = 300;
/// The number of equal parts into which the ticks divide a wide bar. The scale ends at a number such as 0.1, 0.2 or
/// 0.5, so a fifth of this number has few digits.
const PARTS: u32 = 5;
/// The smallest width of a bar, in units.
const SHORT: u32 = 60;

/// The legend below an image.
#[derive(Debug)]
pub(super) struct Legend {
    /// The number of pixels per unit.
    unit: u32,
    /// The distance from the left edge of the image to the bar, in pixels. Each number is centred below its tick, so
    /// half of the widest possible number fits into this distance.
    left: u32,
    /// The width of the bar in pixels.
    bar: u32,
    /// The numbers below the bar, at equal distances. The first is 0, and the last is the error at the right end of the
    /// bar.
    numbers: Vec<String>,
}

impl Legend {
    /// Makes the legend for an image of this width. `full` is the error at the right end of the bar.
    pub(super) fn of(width: u32, full: f32) -> Self {
        let unit = (width / UNIT).max(1);
        // The count of numbers isn't known yet, so the width of the widest possible number is used.
        let widest = numbers(full, PARTS).iter().map(|number| Canvas::measure(number, DOT)).max();
        let left = (MARGIN + widest.unwrap_or(0).div_ceil(2)) * unit;
        let bar = width.saturating_sub(2 * left).max(SHORT * unit);
        let numbers = numbers(full, if bar < WIDE * unit { 1 } else { PARTS });
        Self { unit, left, bar, numbers }
    }

    pub(super) fn width(&self) -> u32 {
        self.bar + 2 * self.left
    }

    pub(super) fn height(&self) -> u32 {
        (MARGIN + BAR + TICK + DOT + GLYPH.1 * DOT + MARGIN) * self.unit
    }

    /// Draws the legend below the image.
    pub(super) fn draw(&self, canvas: &mut Canvas, below: u32) {
        let Self { unit, left, bar, ref numbers } = *self;
        let top = below + MARGIN * unit;
        let last = bar.saturating_sub(1).max(1);
        for x in 0..bar {
            #[expect(clippy::cast_precision_loss, reason = "sides of an image")]
            let error = x as f32 / last as f32;
            canvas.fill((left + x, top), (1, BAR * unit), ErrorMap::colour(error));
        }
        let parts = u32::try_from(numbers.len()).unwrap_or(1).saturating_sub(1).max(1);
        let ticks = top + BAR * unit;
        for (index, number) in (0..).zip(numbers) {
            let x = left + last * index / parts;
            canvas.fill((x.saturating_sub(unit / 2), ticks), (unit, TICK * unit), INK);
            let start = x.saturating_sub(Canvas::measure(number, DOT * unit) / 2);
            canvas.write(number, (start, ticks + (TICK + DOT) * unit), DOT * unit, INK);
        }
    }
}

/// Formats the numbers that divide the range from 0 to `full` into equal parts.
fn numbers(full: f32, parts: u32) -> Vec<String> {
    // A fifth of a thousandth has four decimals, and no scale is shorter.
    let number =
        |index: u32| format!("{:.4}", f64::from(full) * f64::from(index) / f64::from(parts));
    let short = |number: String| number.trim_end_matches('0').trim_end_matches('.').to_owned();
    (0..=parts).map(number).map(short).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        assert_eq!(numbers(1.0, 5), ["0", "0.2", "0.4", "0.6", "0.8", "1"]);
        assert_eq!(numbers(0.05, 5), ["0", "0.01", "0.02", "0.03", "0.04", "0.05"]);
        assert_eq!(numbers(0.001, 5), ["0", "0.0002", "0.0004", "0.0006", "0.0008", "0.001"]);
        assert_eq!(numbers(0.2, 1), ["0", "0.2"]);
    }

    #[test]
    fn a_legend_fits_below_any_picture() {
        for width in [1, 8, 47, 100, 333, 960, 1919, 16_384] {
            for full in [1.0, 0.05, 0.001] {
                let legend = Legend::of(width, full);
                let wide = width.max(legend.width());
                let mut canvas = Canvas::new(wide, legend.height());
                legend.draw(&mut canvas, 0);
                assert!(wide < width + 200, "{width} became {wide}");
                // The bar shows all colours from the first to the last.
                let row = (MARGIN * legend.unit) as usize * wide as usize;
                let at = |x: u32| {
                    let start = (row + x as usize) * 3;
                    [0, 1, 2].map(|channel| canvas.bytes()[start + channel])
                };
                assert_eq!(at(legend.left), ErrorMap::colour(0.0));
                assert_eq!(at(legend.left + legend.bar - 1), ErrorMap::colour(1.0));
            }
        }
    }
}
