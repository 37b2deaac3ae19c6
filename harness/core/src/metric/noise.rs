//! Tests if two noisy images have the same expected value.
//!
//! Two runs of a path tracer give different pixels, because of noise. The means of tiles differ much less. How much
//! they may differ follows from the variances of both images (Welch's z). Tiles have several sizes, from 16 pixels to
//! the whole frame: small tiles show small faults, and large tiles show faint faults. Neighbouring tiles overlap by
//! half, so at least one tile contains most of a small fault. Sidak's correction divides the significance level among
//! the tests of all tiles.
//!
//! An error of a few per cent matters as much in dark regions as in bright regions, but the noise of a tile's bright
//! pixels would hide an error in its dark pixels. So each pixel's difference is divided by the brightness of the
//! pixel's neighbours. Karat doesn't divide by the pixel's own brightness, because the weight would then depend on the
//! pixel's own noise. If the golden and the frame had different numbers of samples, such a weight would bias the
//! comparison.
//!
//! If pixels only change places, as in a shifted texture, the means of tiles don't change. So a second test, a
//! chi-square test, compares the squared differences in a tile with the variances. A few pixels may have most of the
//! variance, so the test uses an effective number of pixels as its degrees of freedom.
//!
//! The authors measured this test with a scene of 640 x 360 pixels and 64 samples per pixel, in which the brightest
//! pixel has over 1000 times the light of the darkest one. If 2 % of the frame is 5 % too bright, 199 of 200 renderings
//! fail. With only noise, none of 200 renderings fails. Without the weights and the overlap, only 43 % of the faulty
//! renderings would fail. If each pixel were tested separately, with 0.25 % of outliers allowed, no faulty rendering
//! would fail.
//!
//! The test assumes that the noise of different pixels is independent. Each channel is tested separately, because a
//! wrong hue may have the right luminance.

use glam::{DVec3, DVec4, Vec4};

use super::gate::{DEFAULT_RELATIVE, Gate};
use super::mask::Rect;
use super::pair::Pair;
use super::relative::DARK;
use super::{Measured, Metric};
use crate::image::Image;
use crate::stats::{chi_square_critical, normal_critical, sidak};

/// The side of a cell, in pixels. Tiles consist of cells, and the smallest tile has two by two cells.
const CELL: u32 = 8;

/// The sides of the tiles, in cells: 16, 48 and 144 pixels. The whole frame is also a tile.
const SIDES: [u32; 3] = [2, 6, 18];

/// The probability that a correct frame fails because of noise.
const SIGNIFICANCE: f64 = 0.01;

/// The factor by which the squared differences may exceed the limit of the chi-square test. The test needs this factor
/// because its variances are only estimates, from few samples that aren't normally distributed.
const SCATTER: f64 = 2.0;

/// The brightness that [`Surroundings::weight`] adds to the brightness of the neighbours, as a share of the golden's
/// mean luminance. If the mean luminance is middle grey, the added brightness is 6 of a screen's 255 steps. Without
/// this addition, hardly visible noise in black regions would outweigh other differences.
const BLACK: f64 = 0.01;

/// A metric for noisy images. Its value is the larger of two ratios, and a frame passes if the value is at most 1. The
/// first ratio is the largest z of a tile's mean in any channel, divided by the z that noise alone reaches in one of a
/// hundred frames. The second ratio is the largest sum of squared differences in a tile, divided by twice the sum that
/// noise alone reaches in one of a hundred frames. Differences within the default [`Gate`] don't count, because
/// rounding isn't noise.
///
/// ```
/// use karat::Image;
/// use karat::metric::Noise;
/// use karat::unstable::metric::{Metric, Pair};
///
/// let image = |value| Image::new(32, 32, vec![[value, value, value, 1.0]; 1024]);
/// let (golden, brighter, variance) = (image(0.5), image(0.6), image(1e-4));
/// let noise = Noise { golden: &variance, actual: &variance };
/// assert!(noise.measure(&Pair::new(&golden, &brighter)?).value > 1.0);
/// # Ok::<(), karat::unstable::metric::PairError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Noise<'a> {
    /// The variance of each pixel's mean in the golden, in linear RGB.
    pub golden: &'a Image,
    /// The variance of each pixel's mean in the frame, in linear RGB.
    pub actual: &'a Image,
}

/// Sums over the pixels of a cell or tile: weighted differences, their variances, and other sums for the tests.
#[derive(Clone, Copy, Default)]
struct Sum {
    difference: DVec3,
    slack: DVec3,
    variance: DVec3,
    /// The sum of the squared differences of the pixels. Only the excess over the default gate's allowed difference is
    /// squared.
    squares: DVec3,
    variances: DVec3,
    pixels: u32,
}

impl Sum {
    fn add(&mut self, other: &Self) {
        self.difference += other.difference;
        self.slack += other.slack;
        self.variance += other.variance;
        self.squares += other.squares;
        self.variances += other.variances;
        self.pixels += other.pixels;
    }

    fn z(&self) -> f64 {
        let z = (0..3).map(|channel| {
            let beyond = (self.difference[channel].abs() - self.slack[channel]).max(0.0);
            if beyond == 0.0 { 0.0 } else { beyond / self.variance[channel].sqrt() }
        });
        z.fold(0.0, larger)
    }

    /// The largest ratio, over the channels, of the sum of squared differences to the allowed sum.
    fn scatter(&self, significance: f64) -> f64 {
        let scatter = (0..3).map(|channel| {
            let (squares, variance) = (self.squares[channel], self.variance[channel]);
            let ratio = if squares == 0.0 { 0.0 } else { squares / variance };
            if ratio <= SCATTER {
                return ratio / SCATTER; // the critical value divided by the degrees of freedom is above 1
            }
            // If the variances of pixels differ, mostly the pixels with large variances determine the degrees of
            // freedom.
            let freedom = (variance * variance / self.variances[channel]).max(1.0);
            if !freedom.is_finite() {
                return f64::INFINITY;
            }
            ratio / (SCATTER * chi_square_critical(freedom, significance) / freedom)
        });
        scatter.fold(0.0, larger)
    }
}

/// The larger number. Unlike `f64::max`, this function keeps NaN.
fn larger(worst: f64, value: f64) -> f64 {
    if value <= worst { worst } else { value }
}

impl Noise<'_> {
    /// An error message if the images of variances can't be used, and otherwise `None`.
    fn unusable(&self, pair: &Pair<'_>) -> Option<String> {
        let size = (pair.golden().width(), pair.golden().height());
        for (name, image) in [("golden", self.golden), ("frame", self.actual)] {
            let (width, height) = (image.width(), image.height());
            if (width, height) != size {
                return Some(format!(
                    "the variance image of the {name} has {width} x {height} pixels, but the frame has another size"
                ));
            }
            let sound = |pixel: &[f32; 4]| pixel[..3].iter().all(|v| *v >= 0.0 && v.is_finite());
            let places = (0..).map(|index| pair.place(index)).zip(image.pixels());
            let mut unsound = places.filter(|((x, y), p)| pair.is_compared(*x, *y) && !sound(p));
            if let Some(((x, y), [red, green, blue, _])) = unsound.next() {
                return Some(format!(
                    "the variance of the {name} is {red}, {green}, {blue} at ({x}, {y}); each must be a \
                     finite number of at least 0"
                ));
            }
        }
        None
    }

    fn cells(&self, pair: &Pair<'_>) -> Vec<Sum> {
        let (width, height) = (pair.golden().width(), pair.golden().height());
        let columns = width.div_ceil(CELL);
        let mut cells = vec![Sum::default(); (columns * height.div_ceil(CELL)) as usize];
        let surroundings = Surroundings::of(pair);
        let floor = DEFAULT_RELATIVE * DARK * pair.key();
        let colour = |pixel: &[f32; 4]| Vec4::from_array(*pixel).truncate().as_dvec3();
        let images = pair.golden().pixels().iter().zip(pair.actual().pixels());
        let variances = self.golden.pixels().iter().zip(self.actual.pixels());
        for (index, ((golden, actual), (vg, va))) in images.zip(variances).enumerate() {
            let (x, y) = pair.place(index);
            if !pair.is_compared(x, y) {
                continue;
            }
            let (weight, light) = (surroundings.weight(index), colour(golden));
            let slack = (f64::from(DEFAULT_RELATIVE) * light.abs()).max(DVec3::splat(floor.into()));
            let difference = weight * (colour(actual) - light);
            let beyond = (difference.abs() - weight * slack).max(DVec3::ZERO);
            let variance = weight * weight * (colour(vg) + colour(va));
            cells[(y / CELL * columns + x / CELL) as usize].add(&Sum {
                difference,
                slack: weight * slack,
                variance,
                squares: beyond * beyond,
                variances: variance * variance,
                pixels: 1,
            });
        }
        cells
    }

    /// All tiles that contain compared pixels, with their sums. Each tile begins half a side after the previous tile. A
    /// tile at the frame's edge that would be completely inside of the previous tile is left out.
    fn tiles(&self, pair: &Pair<'_>) -> Vec<(Rect, Sum)> {
        let (width, height) = (pair.golden().width(), pair.golden().height());
        let (columns, rows) = (width.div_ceil(CELL), height.div_ceil(CELL));
        let cells = self.cells(pair);
        let starts = |half: u32, cells: u32| {
            (0..cells)
                .step_by(half as usize)
                .filter(move |start| *start == 0 || start + half < cells)
        };
        let mut tiles = Vec::new();
        for side in SIDES.into_iter().chain([columns.max(rows)]) {
            let half = side.div_ceil(2).max(1);
            let places = starts(half, rows)
                .flat_map(|row| starts(half, columns).map(move |column| (column, row)));
            for (column, row) in places {
                let (right, bottom) = ((column + side).min(columns), (row + side).min(rows));
                let mut sum = Sum::default();
                for cell in
                    (row..bottom).flat_map(|y| (column..right).map(move |x| y * columns + x))
                {
                    sum.add(&cells[cell as usize]);
                }
                let (left, top) = (column * CELL, row * CELL);
                let size = (width.min(right * CELL) - left, height.min(bottom * CELL) - top);
                if sum.pixels > 0 {
                    tiles.push((Rect::new(left, top, size.0, size.1), sum));
                }
            }
        }
        tiles
    }
}

/// The brightness at each pixel, from which the weights of the neighbouring pixels are computed.
struct Surroundings {
    width: usize,
    /// For each pixel, the mean RGB of the two images. The fourth lane is 1 for a compared pixel, and 0 for all others.
    lights: Vec<Vec4>,
    key: f64,
}

impl Surroundings {
    fn of(pair: &Pair<'_>) -> Self {
        let images = pair.golden().pixels().iter().zip(pair.actual().pixels());
        let light = |(index, (golden, actual)): (usize, (&[f32; 4], &[f32; 4]))| {
            let (x, y) = pair.place(index);
            let halves = [golden, actual].map(|pixel| 0.5 * Vec4::from_array(*pixel).abs());
            if pair.is_compared(x, y) { (halves[0] + halves[1]).with_w(1.0) } else { Vec4::ZERO }
        };
        Self {
            width: pair.golden().width() as usize,
            lights: images.enumerate().map(light).collect(),
            key: pair.key().into(),
        }
    }

    /// The weight of a pixel's difference in each channel: 1 / (the mean brightness of the neighbours + [`BLACK`]).
    fn weight(&self, index: usize) -> DVec3 {
        let (x, y) = (index % self.width, index / self.width);
        let rows = y.saturating_sub(1)..(y + 2).min(self.lights.len() / self.width);
        let columns = x.saturating_sub(1)..(x + 2).min(self.width);
        let mut sum = DVec4::ZERO; // a sum of several large floats would overflow `f32`
        for y in rows {
            for neighbour in y * self.width + columns.start..y * self.width + columns.end {
                if neighbour != index {
                    sum += self.lights[neighbour].as_dvec4();
                }
            }
        }
        let mean = if sum.w > 0.0 { sum.truncate() / sum.w } else { DVec3::splat(self.key) };
        (mean + BLACK * self.key).recip()
    }
}

impl Metric for Noise<'_> {
    fn name(&self) -> String {
        "noise".to_owned()
    }

    fn measure(&self, pair: &Pair<'_>) -> Measured {
        if let Some(note) = self.unusable(pair) {
            return Measured { note: Some(note), ..Measured::of(f64::NAN) };
        }
        let alpha_is_off = {
            let mut off = None;
            Gate::default().each(pair, |index, _, _, ratio| {
                if !(ratio[3] <= 1.0) {
                    off = off.or(Some(pair.place(index)));
                }
            });
            off
        };
        if let Some((x, y)) = alpha_is_off {
            let note =
                Some(format!("alpha differs at ({x}, {y}), but noise is allowed only in colours"));
            return Measured { note, ..Measured::of(f64::INFINITY) };
        }
        let tiles = self.tiles(pair);
        // There are six tests for each tile: three channels, each with a mean and a scatter.
        let significance = sidak(SIGNIFICANCE, 6 * tiles.len() as u64);
        let critical = normal_critical(significance);
        let largest = |value: &dyn Fn(&Sum) -> f64| {
            let values = tiles.iter().map(|(tile, sum)| (value(sum), *tile));
            values.max_by(|a, b| a.0.total_cmp(&b.0))
        };
        let (Some((z, place)), Some((scatter, scattered))) =
            (largest(&Sum::z), largest(&|sum| sum.scatter(significance)))
        else {
            return Measured::of(f64::NAN);
        };
        let mean = z / critical;
        if scatter > mean {
            let note = Some("single pixels differ by more than their noise allows".to_owned());
            return Measured { place: Some(scattered), note, ..Measured::of(scatter) };
        }
        let note = format!("z-score {z:.2}; noise alone exceeds {critical:.2} in one frame of 100");
        Measured { place: (z > 0.0).then_some(place), note: Some(note), ..Measured::of(mean) }
    }
}

#[cfg(test)]
mod tests;
