//! The gate: a metric of the difference of each channel of each pixel. It allows no outliers.

use glam::{BVec4A, Vec4};

use super::mask::{Mask, Rect};
use super::pair::{Pair, STRIP};
use super::relative::{DARK, ratio};
use super::{Measured, Metric};
use crate::image::{Image, Precision};
use crate::tolerance::power;

/// The largest relative difference of a channel, unless a frame sets another limit. This default is twice the largest
/// relative rounding error of half floats, the format of most goldens.
pub const DEFAULT_RELATIVE: f32 = 1e-3;

/// An alpha below this value is compared as if it were this value. An opacity of one per cent is invisible, and a small
/// opacity has rounding errors if a shader computes it as `1 - transmittance`.
const CLEAR: f32 = 0.01;

/// A metric that allows each channel to differ by `relative` times the golden's value, or by `absolute`, whichever is
/// larger. The metric's value is the largest ratio of a difference to the allowed difference, so the bound is 1.
///
/// ```
/// use karat::Image;
/// use karat::unstable::metric::{Gate, Pair};
///
/// let golden = Image::new(1, 1, vec![[1.0; 4]]);
/// let actual = Image::new(1, 1, vec![[1.0, 1.0, 1.01, 1.0]]);
/// let pair = Pair::new(&golden, &actual)?;
/// assert!(Gate { relative: 0.1, absolute: None }.passes(&pair).is_some());
/// assert!(Gate { relative: 1e-3, absolute: None }.passes(&pair).is_none());
/// # Ok::<(), karat::unstable::metric::PairError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gate {
    /// The largest allowed difference, divided by the golden's value.
    pub relative: f32,
    /// The difference that is always allowed, even for a dark golden. `None` means, for colours, `relative` times 1e-4
    /// of the golden's logarithmic mean luminance, and for alpha, `relative` times 0.01.
    pub absolute: Option<f32>,
}

/// The pixels that differ by more than the gate allows.
///
/// ```
/// use karat::Image;
/// use karat::unstable::metric::{Gate, Pair};
///
/// let (golden, actual) = (Image::new(1, 1, vec![[0.5; 4]]), Image::new(1, 1, vec![[0.6; 4]]));
/// let outliers = Gate::default().outliers(&Pair::new(&golden, &actual)?).expect("it is 0.6");
/// assert_eq!((outliers.count, outliers.worst.actual), (1, 0.6));
/// # Ok::<(), karat::unstable::metric::PairError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Outliers {
    /// The number of outliers.
    pub count: usize,
    /// The smallest rectangle that contains all outliers.
    pub rect: Rect,
    /// The pixel with the largest ratio.
    pub worst: WorstPixel,
    /// The percentages of pixels that would be outliers if the tolerance were multiplied by 1, 10, 100 and 1000.
    pub sweep: [f32; 4],
}

/// An outlier.
///
/// ```
/// # use karat::Image;
/// # use karat::unstable::metric::{Gate, Pair};
/// # let (golden, actual) = (Image::new(1, 1, vec![[0.5; 4]]), Image::new(1, 1, vec![[0.6; 4]]));
/// let outliers = Gate::default().outliers(&Pair::new(&golden, &actual)?).expect("it is 0.6");
/// let worst = outliers.worst;
/// assert_eq!((worst.x, worst.y, worst.golden, worst.actual), (0, 0, 0.5, 0.6));
/// # Ok::<(), karat::unstable::metric::PairError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorstPixel {
    /// The column of the pixel.
    pub x: u32,
    /// The row of the pixel.
    pub y: u32,
    /// The channel with the largest ratio: 0 is red, 1 green, 2 blue, 3 alpha.
    pub channel: usize,
    /// The golden's value.
    pub golden: f32,
    /// The frame's value.
    pub actual: f32,
    /// The channel's difference divided by the allowed difference.
    pub ratio: f32,
}

impl Default for Gate {
    fn default() -> Self {
        Self { relative: DEFAULT_RELATIVE, absolute: None }
    }
}

impl Gate {
    /// The allowed relative difference of each channel, and the allowed absolute difference of each channel. If a bound
    /// is invalid, all bounds become NaN, so every pixel fails.
    fn bounds(&self, pair: &Pair<'_>) -> (Vec4, Vec4) {
        let floor = self.absolute.unwrap_or_else(|| self.relative * DARK * pair.key());
        let alpha = self.absolute.unwrap_or(self.relative * CLEAR);
        if !(self.relative >= 0.0 && floor >= 0.0) {
            return (Vec4::NAN, Vec4::NAN);
        }
        (Vec4::splat(self.relative), Vec4::new(floor, floor, floor, alpha))
    }

    /// The largest ratio of a channel's difference to its allowed difference. `None` if a ratio is above 1. If
    /// `absolute` is `None`, computing its default needs a loop over all pixels of the golden. If `relative` alone
    /// already allows all differences, the function skips this loop, and the ratio depends only on `relative`.
    ///
    /// ```
    /// use karat::Image;
    /// use karat::unstable::metric::{Gate, Pair};
    ///
    /// let image = Image::new(1, 1, vec![[1.0; 4]]);
    /// assert_eq!(Gate::default().passes(&Pair::new(&image, &image)?), Some(0.0));
    /// # Ok::<(), karat::unstable::metric::PairError>(())
    /// ```
    #[must_use]
    pub fn passes(&self, pair: &Pair<'_>) -> Option<f32> {
        if pair.is_identical() {
            return Some(0.0);
        }
        let ratio = pair.largest_relative() / self.relative;
        // If the ratio is close to the bound, the exact ratio is computed, as in the other functions.
        if self.absolute.is_none() && (0.0..0.9999).contains(&ratio) {
            return Some(ratio);
        }
        largest(pair, self.bounds(pair))
    }

    /// The precision that a file needs to store an image for this gate. Half floats are enough if rounding to them
    /// changes each compared channel by at most half of the allowed difference. Then two almost equal frames still pass
    /// even if one is rounded up and the other down. A file needs 32-bit floats for values above 65504, for small
    /// values in a dark image, or if `relative` is below 2^-10. Karat also uses 32-bit floats if the image can't be
    /// compared, because the image contains NaN or the mask has another size.
    ///
    /// ```
    /// use karat::Image;
    /// use karat::image::Precision;
    /// use karat::unstable::metric::Gate;
    ///
    /// let image = Image::new(1, 1, vec![[0.3; 4]]);
    /// assert_eq!(Gate::default().precision_for(&image, None), Precision::Half);
    /// ```
    #[must_use]
    pub fn precision_for(&self, image: &Image, mask: Option<&Mask>) -> Precision {
        let rounded = image.rounded_to(Precision::Half);
        let pair = match mask {
            None => Pair::new(image, &rounded),
            Some(mask) => Pair::masked(image, &rounded, mask),
        };
        let half = Self { relative: self.relative / 2.0, absolute: self.absolute.map(|a| a / 2.0) };
        match pair {
            Ok(pair) if half.passes(&pair).is_some() => Precision::Half,
            _ => Precision::Float,
        }
    }

    /// The pixels that differ by more than the gate allows.
    ///
    /// ```
    /// use karat::Image;
    /// use karat::unstable::metric::{Gate, Pair};
    ///
    /// let golden = Image::new(2, 1, vec![[1.0; 4]; 2]);
    /// let actual = Image::new(2, 1, vec![[1.0; 4], [0.5; 4]]);
    /// let outliers = Gate::default().outliers(&Pair::new(&golden, &actual)?).expect("one pixel is off");
    /// assert_eq!((outliers.count, outliers.rect.left), (1, 1));
    /// # Ok::<(), karat::unstable::metric::PairError>(())
    /// ```
    #[must_use]
    pub fn outliers(&self, pair: &Pair<'_>) -> Option<Outliers> {
        let mut outliers = [0_usize; 4];
        let mut bounds = [u32::MAX, u32::MAX, 0, 0];
        let mut worst: Option<WorstPixel> = None;
        self.each(pair, |index, golden, actual, ratio| {
            let (x, y) = pair.place(index);
            let largest = ratio.into_iter().fold(0.0, f32::max);
            for (count, factor) in outliers.iter_mut().zip([1.0, 10.0, 100.0, 1000.0]) {
                *count += usize::from(!(largest <= factor));
            }
            let [left, top, right, bottom] = bounds;
            bounds = [left.min(x), top.min(y), right.max(x), bottom.max(y)];
            if worst.is_none_or(|worst| largest > worst.ratio) {
                let channel = ratio.iter().position(|r| *r == largest).unwrap_or(0);
                let (golden, actual) = (golden[channel], actual[channel]);
                worst = Some(WorstPixel { x, y, channel, golden, actual, ratio: largest });
            }
        });
        let sweep = outliers.map(|count| 100.0 * count as f32 / pair.compared_count() as f32);
        let (count, rect) = (outliers[0], worst.map(|_| Rect::spanning(bounds)));
        Some(Outliers { count, rect: rect?, worst: worst?, sweep })
    }

    /// Calls `out` for each outlier with its index, the golden's pixel, the frame's pixel, and the ratio of each
    /// channel.
    pub(super) fn each(
        &self,
        pair: &Pair<'_>,
        mut out: impl FnMut(usize, [f32; 4], [f32; 4], [f32; 4]),
    ) {
        let (relative, floor) = self.bounds(pair);
        for (start, golden, actual) in pair.different() {
            for (index, (golden, actual)) in (start..).zip(golden.iter().zip(actual)) {
                let ratio = ratio(*golden, *actual, relative, floor);
                if !ratio.cmple(Vec4::ONE).all() {
                    // An invalid tolerance gives a ratio of NaN, which fails the pixel.
                    let sound = |r: f32| if r >= 0.0 { r } else { f32::INFINITY };
                    out(index, *golden, *actual, ratio.to_array().map(sound));
                }
            }
        }
    }
}

/// The largest ratio, or `None` if there is an outlier. The function compares the four channels of a pixel at once, and
/// stops at the first outlier.
fn largest(pair: &Pair<'_>, (relative, floor): (Vec4, Vec4)) -> Option<f32> {
    let (mut largest, mut all) = (Vec4::ZERO, BVec4A::TRUE);
    for (_, golden, actual) in pair.different() {
        for (golden, actual) in golden.chunks(STRIP).zip(actual.chunks(STRIP)) {
            for (golden, actual) in golden.iter().zip(actual) {
                let ratio = ratio(*golden, *actual, relative, floor);
                // A ratio of NaN counts as an outlier.
                all &= ratio.cmple(Vec4::ONE);
                largest = largest.max(ratio);
            }
            if !all.all() {
                return None;
            }
        }
    }
    Some(largest.max_element())
}

impl Metric for Gate {
    fn name(&self) -> String {
        match self.absolute {
            None => format!("gate rel {}", power(self.relative)),
            Some(absolute) => {
                format!("gate rel {} or abs {}", power(self.relative), power(absolute))
            }
        }
    }

    fn measure(&self, pair: &Pair<'_>) -> Measured {
        if let Some(ratio) = self.passes(pair) {
            return Measured::of(f64::from(ratio));
        }
        let outliers = self.outliers(pair);
        let value = outliers.as_ref().map_or(f64::NAN, |o| f64::from(o.worst.ratio));
        let place = outliers.map(|Outliers { worst, .. }| Rect::new(worst.x, worst.y, 1, 1));
        Measured { place, ..Measured::of(value) }
    }
}
