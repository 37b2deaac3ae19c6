//! Tests whether two noisy images have the same expectation.
//!
//! The pixels of a path tracer differ between runs by their noise. Means of tiles differ much less, and the variances
//! of both images say by how much: Welch's z. Tiles have several sizes, from 16 pixels to the whole frame, so they
//! reveal both small and faint faults. They overlap by half, so that no fault is divided among four tiles. Sidak's
//! correction divides the significance among all of them.
//!
//! An error of some per cent in the light matters as much in dark places as in bright ones, but most of the noise is in
//! bright ones. So each pixel is weighted by the brightness of its neighbours. Its own brightness is left out: a weight
//! with the pixel's own noise in it would favour one image if golden and frame have different numbers of samples.
//!
//! Pixels that only change places, as under a shifted texture, keep their mean. So the squared differences of a tile
//! are compared with the variances, too: a chi-square, with as many degrees of freedom as there are pixels that matter
//! in the sum.
//!
//! Measured on a scene of three decades of light, with 640 x 360 pixels of 64 samples: if 2 % of the frame is 5 % too
//! bright, 199 of 200 renderings fail; with noise alone, none of 200 fails. Without the weights and the overlap, only
//! 43 % of the faulty ones would fail. If pixels were judged one by one, with 0.25 % of outliers allowed, none would
//! fail.
//!
//! The noise of different pixels is assumed to be independent. Each channel is judged separately, because a wrong hue
//! may have the right luminance.

use glam::{DVec3, DVec4, Vec4};

use super::gate::{DEFAULT_RELATIVE, Gate};
use super::mask::Rect;
use super::pair::Pair;
use super::relative::DARK;
use super::{Measured, Metric};
use crate::image::Image;
use crate::stats::{chi_square_critical, normal_critical, sidak};

/// The side of the cells that tiles consist of, in pixels: half of the smallest tile.
const CELL: u32 = 8;

/// The sides of the tiles, in cells: 16, 48 and 144 pixels. The whole frame is one more tile.
const SIDES: [u32; 3] = [2, 6, 18];

/// The probability that noise alone fails a frame.
const SIGNIFICANCE: f64 = 0.01;

/// The factor by which the squared differences may exceed a chi-square's limit: the variances are estimates from few
/// samples that aren't normally distributed.
const SCATTER: f64 = 2.0;

/// Light below this share of the golden's key has the weight of this share. With the key at middle grey it is 6 of the
/// 255 steps of a screen: noise below it hardly shows, and must not outweigh the rest.
const BLACK: f64 = 0.01;

/// The larger of two ratios; its bound is 1. The first is the largest z of a tile's mean in any channel, divided by the
/// z that noise alone reaches in one frame of a hundred. The second is the scatter of a tile's pixels, divided by twice
/// the scatter of noise alone. Differences within the default [`Gate`] don't count: rounding isn't noise.
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
    /// The same for the frame.
    pub actual: &'a Image,
}

/// The brightness difference of a cell or tile, with the quantities to judge it by.
#[derive(Clone, Copy, Default)]
struct Sum {
    difference: DVec3,
    slack: DVec3,
    variance: DVec3,
    /// The squares of each pixel's difference beyond the slack.
    squares: DVec3,
    /// The squares of the variances.
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

    /// The largest z of a channel.
    fn z(&self) -> f64 {
        let z = (0..3).map(|channel| {
            let beyond = (self.difference[channel].abs() - self.slack[channel]).max(0.0);
            if beyond == 0.0 { 0.0 } else { beyond / self.variance[channel].sqrt() }
        });
        z.fold(0.0, larger)
    }

    /// The largest scatter of a channel's pixels, divided by the allowed one.
    fn scatter(&self, significance: f64) -> f64 {
        let scatter = (0..3).map(|channel| {
            let (squares, variance) = (self.squares[channel], self.variance[channel]);
            let ratio = if squares == 0.0 { 0.0 } else { squares / variance };
            if ratio <= SCATTER {
                return ratio / SCATTER; // the critical value is above 1
            }
            // If the variances differ, only the pixels with the larger ones matter.
            let freedom = (variance * variance / self.variances[channel]).max(1.0);
            if !freedom.is_finite() {
                return f64::INFINITY;
            }
            ratio / (SCATTER * chi_square_critical(freedom, significance) / freedom)
        });
        scatter.fold(0.0, larger)
    }
}

/// The larger number. Unlike `f64::max`, it keeps NaN.
fn larger(worst: f64, value: f64) -> f64 {
    if value <= worst { worst } else { value }
}

impl Noise<'_> {
    /// The problem with the variances, if there is one.
    fn unusable(&self, pair: &Pair<'_>) -> Option<String> {
        let size = (pair.golden().width(), pair.golden().height());
        for (name, image) in [("golden", self.golden), ("frame", self.actual)] {
            let (width, height) = (image.width(), image.height());
            if (width, height) != size {
                return Some(format!("the variance of the {name} is {width} x {height}"));
            }
            let sound = |pixel: &[f32; 4]| pixel[..3].iter().all(|v| *v >= 0.0 && v.is_finite());
            let places = (0..).map(|index| pair.place(index)).zip(image.pixels());
            let mut unsound = places.filter(|((x, y), p)| pair.is_compared(*x, *y) && !sound(p));
            if let Some(((x, y), [red, green, blue, _])) = unsound.next() {
                return Some(format!(
                    "the variance of the {name} is {red}, {green}, {blue} at ({x}, {y}); each is a \
                     finite number of at least 0"
                ));
            }
        }
        None
    }

    /// The sums over the cells, row by row.
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

    /// All tiles with compared pixels, and the sums over them. Tiles begin at each half of their side, except where the
    /// previous tile would contain them.
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

/// The brightness around the pixels of both images.
struct Surroundings {
    width: usize,
    /// The last lane is 1, or 0 for a pixel that isn't compared.
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

    /// The inverse mean of a pixel's neighbours, for each channel.
    fn weight(&self, index: usize) -> DVec3 {
        let (x, y) = (index % self.width, index / self.width);
        let rows = y.saturating_sub(1)..(y + 2).min(self.lights.len() / self.width);
        let columns = x.saturating_sub(1)..(x + 2).min(self.width);
        let mut sum = DVec4::ZERO; // as there may be several of the largest floats
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
            let note = Some(format!("alpha is off at ({x}, {y}), which has no noise"));
            return Measured { note, ..Measured::of(f64::INFINITY) };
        }
        let tiles = self.tiles(pair);
        // Three channels, each with a mean and a scatter.
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
            let note = Some("single pixels are off by more than their noise".to_owned());
            return Measured { place: Some(scattered), note, ..Measured::of(scatter) };
        }
        let note = format!("z {z:.2}, noise alone has {critical:.2} in a frame of a hundred");
        Measured { place: (z > 0.0).then_some(place), note: Some(note), ..Measured::of(mean) }
    }
}

#[cfg(test)]
mod tests;
