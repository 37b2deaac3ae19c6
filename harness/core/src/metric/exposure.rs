//! Chooses the exposures at which HDR images are compared.

use serde::{Deserialize, Serialize};

use crate::image::Image;
use crate::image::luminance;

/// A range of exposures, in stops: an exposure of `e` multiplies linear colours by 2^e.
///
/// At the darkest exposure, a display shows the golden's highlights at 85 % of white. At the brightest exposure, the
/// display shows the golden's median luminance at 85 % of white (Andersson et al. 2021, section 3.2). Karat differs
/// from the paper in two ways. First, highlights are the 99.9th percentile instead of the maximum, because one firefly
/// can move the maximum by six stops. Second, the median and the highlights ignore black pixels, because most pixels
/// may be black.
///
/// ```
/// use karat::unstable::metric::ExposureRange;
///
/// assert_eq!(ExposureRange { start: -2.0, stop: 2.0 }.count(), 4);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ExposureRange {
    /// The darkest exposure.
    pub start: f64,
    /// The brightest exposure.
    pub stop: f64,
}

/// The linear value that the tone curve of [`Flip`](super::Flip) maps to 0.85. The curve is ACES (Narkowicz 2016),
/// scaled by 0.6: a quotient of two quadratic functions. So `curve(x) = 0.85`, multiplied by the denominator, is a
/// quadratic equation, and this value is its positive root.
const NEAR_WHITE: f64 = {
    let a = 0.6 * 0.6 * (2.51 - 0.85 * 2.43);
    let b = 0.6 * (0.03 - 0.85 * 0.59);
    let c = -0.85 * 0.14;
    // One root is negative, and one is positive. Newton's method finds the positive root, because `sqrt` isn't const.
    let (mut x, mut step) = (10.0, 0);
    while step < 60 {
        x -= (a * x * x + b * x + c) / (2.0 * a * x + b);
        step += 1;
    }
    x
};

/// The width of the widest range, in stops. Such a range covers all normal, positive half floats.
const WIDEST: f64 = 32.0;

/// The largest number of exposures that `flip-rs` compares. This number is also the limit for an exposure's absolute
/// value in stops, because the factor of a larger exposure would overflow a float.
const MOST: usize = flip_rs::MAX_EXPOSURES;

impl ExposureRange {
    /// The range of exposures for a golden. A black golden gets the same range as a white one.
    ///
    /// ```
    /// use karat::Image;
    /// use karat::unstable::metric::ExposureRange;
    ///
    /// // A brighter image needs less exposure.
    /// let of = |light: f32| ExposureRange::of(&Image::new(1, 1, vec![[light, light, light, 1.0]]));
    /// assert!(of(100.0).start < of(1.0).start);
    /// ```
    #[must_use]
    pub fn of(golden: &Image) -> Self {
        Self::of_pixels(golden.pixels())
    }

    pub(super) fn of_pixels(pixels: &[[f32; 4]]) -> Self {
        let bright = |l: &f32| l.is_finite() && *l > 0.0;
        let mut lights: Vec<f32> = pixels.iter().map(luminance).filter(bright).collect();
        if lights.is_empty() {
            return Self { start: stops(1.0), stop: stops(1.0) };
        }
        let mut percentile = |per_mille: usize| {
            let index = (lights.len() * per_mille / 1000).min(lights.len() - 1);
            f64::from(*lights.select_nth_unstable_by(index, f32::total_cmp).1)
        };
        let (median, highlight) = (percentile(500), percentile(999));
        let (start, stop) = (stops(highlight), stops(median));
        Self { start, stop: stop.clamp(start, start + WIDEST) }
    }

    /// The number of exposures that FLIP compares: the width of the range in stops, rounded up, and at least two. The
    /// two ends of the range are the first and the last of these exposures.
    ///
    /// ```
    /// use karat::unstable::metric::ExposureRange;
    ///
    /// assert_eq!(ExposureRange { start: 0.0, stop: 3.0 }.count(), 3);
    /// ```
    #[must_use]
    pub fn count(&self) -> usize {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "2 to 128")]
        let count = (self.stop - self.start).ceil().clamp(2.0, MOST as f64) as usize;
        count
    }

    /// A range of darker exposures for a pixel that is too bright for this range. At the darkest exposure of the new
    /// range, a display shows `luminance` at 85 % of white or less. `None` if this range already has such an exposure.
    pub(super) fn below(&self, luminance: f32) -> Option<Self> {
        let missing = (self.start - stops(f64::from(luminance))).ceil();
        (missing > 0.0).then_some(Self { start: self.start - missing, stop: self.start - 1.0 })
    }

    /// A range of brighter exposures for a pixel that is too dark for this range. At the brightest exposure of the new
    /// range, a display shows `luminance` at 85 % of white or more. `None` if this range already has such an exposure.
    pub(super) fn above(&self, luminance: f32) -> Option<Self> {
        let missing = (stops(f64::from(luminance)) - self.stop).ceil();
        (missing > 0.0).then_some(Self { start: self.stop + 1.0, stop: self.stop + missing })
    }

    /// Checks if the range is within the limits of `flip-rs`: narrower than [`MOST`] stops, with both ends less than
    /// [`MOST`] stops from 0.
    pub(super) fn is_visible(&self) -> bool {
        let most = MOST as f64;
        self.stop - self.start < most && self.start > -most && self.stop < most
    }
}

/// The exposure at which a display shows a luminance at 85 % of white, rounded to a hundredth of a stop.
fn stops(luminance: f64) -> f64 {
    ((NEAR_WHITE / luminance).log2() * 100.0).round() / 100.0
}

impl std::fmt::Display for ExposureRange {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:+} to {:+} stops", self.start, self.stop)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn white_with(fireflies: usize, value: f32) -> Image {
        let mut image = Image::new(100, 100, vec![[0.5, 0.5, 0.5, 1.0]; 10_000]);
        image.pixels_mut()[..fireflies].fill([value; 4]);
        image
    }

    #[test]
    fn fireflies_do_not_move_the_range() {
        let plain = ExposureRange::of(&white_with(0, 0.0));
        assert_eq!(ExposureRange::of(&white_with(9, 1e4)), plain);
        assert!(ExposureRange::of(&white_with(11, 1e4)).start < plain.start - 14.0);
        assert_eq!(plain.count(), 2);
    }

    #[test]
    fn the_range_of_black_is_finite() {
        let black = ExposureRange::of(&white_with(10_000, 0.0));
        assert_eq!(black.start, black.stop);
        assert!(black.start.is_finite());
        // More than half of the pixels are black, but only the other pixels decide the range.
        let half = ExposureRange::of(&white_with(6_000, 0.0));
        assert_eq!(half, ExposureRange::of(&white_with(0, 0.0)));
    }

    #[test]
    fn brighter_light_gets_darker_exposures() {
        let range = ExposureRange { start: -2.0, stop: 3.0 };
        assert_eq!(range.count(), 5);
        assert_eq!(range.below(0.5), None);
        let below = range.below(1e3).expect("brighter than white at -2 stops");
        assert_eq!(below.stop, -3.0);
        assert!(below.start < -8.0 && below.start > -11.0, "{below}");
        assert_eq!(range.above(10.0), None);
        let above = range.above(1e-3).expect("darker than the median");
        assert_eq!(above.start, 4.0);
        assert!(above.stop > 10.0 && above.stop < 14.0, "{above}");
        assert!(below.is_visible() && above.is_visible());
        let beyond = range.below(f32::MAX).expect("brighter still");
        assert!(beyond.is_visible() && !ExposureRange { start: -128.0, ..beyond }.is_visible());
        assert!(!ExposureRange { start: -90.0, stop: 90.0 }.is_visible());
        assert!(!ExposureRange { start: f64::NAN, stop: 90.0 }.is_visible());
    }
}
