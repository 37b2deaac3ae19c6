//! Whether two noisy images have the same expectation.
//!
//! Pixels of a path tracer differ from run to run by their noise. Means of tiles differ by far
//! less, and by an amount that the variances of both images tell: Welch's z. Tiles are of two
//! sizes, so that both a small fault and a faint one are seen, and Sidak's correction shares the
//! significance among all of them.
//!
//! The noise of pixels is taken to be independent. Each channel is judged by its own, as a wrong hue
//! may have the right luminance.

use super::gate::{DEFAULT_RELATIVE, Gate};
use super::mask::Rect;
use super::pair::Pair;
use super::{Measured, Metric};
use crate::image::Image;
use crate::stats::{normal_critical, sidak};

/// Pixels a side of the tiles.
const SIDES: [u32; 2] = [16, 48];

/// How likely noise alone fails a frame.
const SIGNIFICANCE: f64 = 0.01;

/// The largest z of a tile's mean, of any channel, over what noise alone reaches in one frame of a
/// hundred, so that 1 is its bound. What the default [`Gate`] allows isn't counted: rounding isn't
/// noise.
#[derive(Clone, Debug)]
pub struct Noise<'a> {
    /// Variance of each pixel's mean in the golden, linear RGB.
    pub golden: &'a Image,
    /// The same of the frame.
    pub actual: &'a Image,
}

/// How much brighter a tile is than the golden's, and what there is to compare that with.
#[derive(Clone, Copy, Default)]
struct Sum {
    difference: [f64; 3],
    slack: [f64; 3],
    variance: [f64; 3],
    pixels: u32,
}

impl Sum {
    /// The largest z of a channel.
    fn z(&self) -> f64 {
        let z = (0..3).map(|channel| {
            let beyond = (self.difference[channel].abs() - self.slack[channel]).max(0.0);
            if beyond == 0.0 { 0.0 } else { beyond / self.variance[channel].sqrt() }
        });
        // Not `f64::max`, which drops NaN.
        z.fold(0.0, |worst, z| if z <= worst { worst } else { z })
    }
}

impl Noise<'_> {
    /// What is wrong with the variances.
    fn unusable(&self, pair: &Pair<'_>) -> Option<String> {
        let size = (pair.golden().width(), pair.golden().height());
        for (name, image) in [("golden", self.golden), ("frame", self.actual)] {
            let (width, height) = (image.width(), image.height());
            if (width, height) != size {
                return Some(format!("the variance of the {name} is {width} x {height}"));
            }
            let sound = |pixel: &[f32; 4]| pixel[..3].iter().all(|v| *v >= 0.0 && v.is_finite());
            if let Some(index) = image.pixels().iter().position(|pixel| !sound(pixel)) {
                let (x, y) = pair.place(index);
                return Some(format!("the variance of the {name} is no number at ({x}, {y})"));
            }
        }
        None
    }

    /// Sums over the tiles of one size that have pixels to compare.
    fn tiles(&self, pair: &Pair<'_>, side: u32) -> Vec<(Rect, Sum)> {
        let (width, height) = (pair.golden().width(), pair.golden().height());
        let (columns, rows) = (width.div_ceil(side), height.div_ceil(side));
        let mut sums = vec![Sum::default(); columns as usize * rows as usize];
        let floor = f64::from(DEFAULT_RELATIVE) * 1e-4 * f64::from(pair.key());
        let images = pair.golden().pixels().iter().zip(pair.actual().pixels());
        let variances = self.golden.pixels().iter().zip(self.actual.pixels());
        for (index, ((golden, actual), (vg, va))) in images.zip(variances).enumerate() {
            let (x, y) = pair.place(index);
            if !pair.counts(x, y) {
                continue;
            }
            let sum = &mut sums[(y / side * columns + x / side) as usize];
            for channel in 0..3 {
                let light = f64::from(golden[channel]);
                sum.difference[channel] += f64::from(actual[channel]) - light;
                sum.slack[channel] += (f64::from(DEFAULT_RELATIVE) * light.abs()).max(floor);
                sum.variance[channel] += f64::from(vg[channel]) + f64::from(va[channel]);
            }
            sum.pixels += 1;
        }
        let tile = |index: u32| {
            let (left, top) = (index % columns * side, index / columns * side);
            Rect::new(left, top, side.min(width - left), side.min(height - top))
        };
        let tiles = (0..).zip(sums).map(|(index, sum)| (tile(index), sum));
        tiles.filter(|(_, sum)| sum.pixels > 0).collect()
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
        let tiles: Vec<_> = SIDES.iter().flat_map(|side| self.tiles(pair, *side)).collect();
        let critical = normal_critical(sidak(SIGNIFICANCE, 3 * tiles.len() as u64));
        let largest = tiles.iter().map(|(tile, sum)| (sum.z(), *tile));
        let largest = largest.max_by(|a, b| a.0.total_cmp(&b.0));
        let Some((z, place)) = largest else {
            return Measured::of(f64::NAN);
        };
        let note = format!("z {z:.2}, noise alone has {critical:.2} in a frame of a hundred");
        let note = Some(note);
        Measured { place: (z > 0.0).then_some(place), note, ..Measured::of(z / critical) }
    }
}

#[cfg(test)]
mod tests {
    use rand_core::Rng;
    use rand_pcg::Pcg32;

    use super::*;

    const WIDTH: u32 = 320;
    const HEIGHT: u32 = 180;

    /// The mean of 64 samples a pixel and its variance. Half of the samples are dark, the others of
    /// up to four times the mean. `factor` is what a square of 2 % of the frame is multiplied by.
    fn rendered(seed: u64, factor: f32) -> (Image, Image) {
        let mut random = Pcg32::new(seed, 7);
        let (mut means, mut variances) = (Vec::new(), Vec::new());
        for index in 0..WIDTH * HEIGHT {
            let (x, y) = (index % WIDTH, index / WIDTH);
            let faulty = (100..134).contains(&x) && (60..94).contains(&y);
            let light = (0.2 + 0.6 * x as f32 / WIDTH as f32) * if faulty { factor } else { 1.0 };
            let (mut sum, mut squares) = (0.0, 0.0);
            for _ in 0..64 {
                let bits = random.next_u32();
                let size = (bits >> 8) as f32 / (1 << 24) as f32;
                let sample = if bits.is_multiple_of(2) { 4.0 * light * size } else { 0.0 };
                sum += sample;
                squares += sample * sample;
            }
            let mean = sum / 64.0;
            let variance = ((squares / 64.0 - mean * mean) / 63.0).max(0.0);
            means.push([mean, mean, mean, 1.0]);
            variances.push([variance, variance, variance, 0.0]);
        }
        (Image::new(WIDTH, HEIGHT, means), Image::new(WIDTH, HEIGHT, variances))
    }

    fn measured(golden: &(Image, Image), actual: &(Image, Image)) -> Measured {
        let pair = Pair::new(&golden.0, &actual.0).expect("finite");
        Noise { golden: &golden.1, actual: &actual.1 }.measure(&pair)
    }

    #[test]
    fn noise_alone_passes_and_a_faint_fault_is_seen() {
        let (mut alarms, mut seen) = (0, 0);
        for seed in 0..20 {
            let golden = rendered(seed, 1.0);
            let pair = Pair::new(&golden.0, &golden.0).expect("finite");
            assert_eq!(Gate::default().passes(&pair), Some(0.0));
            alarms += u32::from(!(measured(&golden, &rendered(seed + 100, 1.0)).value <= 1.0));
            seen += u32::from(!(measured(&golden, &rendered(seed + 200, 1.05)).value <= 1.0));
        }
        // One alarm in a hundred is expected. The fault is 5.1 deviations of its largest tile, and
        // 4.1 are asked of 268 tiles: of twenty 16 are seen.
        assert!(alarms <= 1 && seen >= 14, "{alarms} of 20 false alarms, {seen} of 20 faults seen");
    }

    #[test]
    fn what_is_no_variance_passes_nothing() {
        let (golden, actual) = (rendered(1, 1.0), rendered(2, 1.0));
        let mut broken = actual.clone();
        broken.1.pixels_mut()[3][1] = f32::NAN;
        let found = measured(&golden, &broken);
        assert!(found.value.is_nan());
        assert_eq!(found.note.as_deref(), Some("the variance of the frame is no number at (3, 0)"));
        broken.1 = Image::new(1, 1, vec![[0.0; 4]]);
        assert!(measured(&golden, &broken).value.is_nan());
        // Without any noise, a difference is a fault.
        let still = Image::new(WIDTH, HEIGHT, vec![[0.0; 4]; (WIDTH * HEIGHT) as usize]);
        let found = measured(&(golden.0.clone(), still.clone()), &(actual.0, still.clone()));
        assert_eq!(found.value, f64::INFINITY);
        let mut alpha = golden.clone();
        alpha.0.pixels_mut()[5][3] = 0.5;
        assert_eq!(measured(&golden, &alpha).value, f64::INFINITY);
    }
}
