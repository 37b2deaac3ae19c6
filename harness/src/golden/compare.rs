//! The verdict on a frame, cheapest question first.

use std::fmt;

use crate::image::{Image, NonFinite};

/// How much room a frame that passes has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameMargin {
    /// Pixels compared.
    pub pixels: u64,
    /// Whether every bit is equal.
    pub identical: bool,
    /// The largest difference over its bound.
    pub ratio: f32,
    /// The largest difference relative to the golden's value, or to the golden's key where the
    /// golden is darker.
    pub relative: f32,
}

/// How a frame differs from its golden.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum FrameDifference {
    /// Another size.
    Size {
        /// Width and height of the golden.
        golden: (u32, u32),
        /// Width and height of the frame.
        actual: (u32, u32),
    },
    /// NaN or infinities in the frame.
    NonFinite(NonFinite),
    /// NaN or infinities in the golden: nothing can agree with it.
    GoldenNonFinite(NonFinite),
    /// Values differ by more than is allowed.
    Values {
        /// Pixels with a channel out of bounds.
        outliers: usize,
        /// Pixels compared.
        pixels: usize,
        /// Smallest rectangle that holds them: left, top, right, bottom, inclusive.
        bounds: [u32; 4],
        /// The worst one.
        worst: Outlier,
        /// Largest relative difference allowed.
        relative: f32,
        /// Share of outliers, in per cent, at 1, 10, 100 and 1000 times the tolerance.
        sweep: [f32; 4],
    },
}

/// A pixel that differs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outlier {
    /// Column.
    pub x: u32,
    /// Row.
    pub y: u32,
    /// 0 red, 1 green, 2 blue, 3 alpha.
    pub channel: usize,
    /// The golden's value.
    pub golden: f32,
    /// The frame's value.
    pub actual: f32,
    /// Difference over what is allowed.
    pub ratio: f32,
}

impl fmt::Display for FrameDifference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Size { golden, actual } => write!(
                f,
                "it is {} x {}, the golden {} x {}",
                actual.0, actual.1, golden.0, golden.1
            ),
            Self::NonFinite(census) => write!(f, "it has {census}"),
            Self::GoldenNonFinite(census) => write!(f, "the golden itself has {census}"),
            Self::Values { outliers, pixels, bounds, worst, relative, sweep } => {
                let [left, top, right, bottom] = bounds;
                writeln!(
                    f,
                    "{outliers} of {pixels} pixels are off by more than rel {relative:e}, within \
                     ({left}, {top}) to ({right}, {bottom})"
                )?;
                writeln!(
                    f,
                    "  worst: pixel ({}, {}) {}: {} instead of {}, {} times what is allowed",
                    worst.x,
                    worst.y,
                    ["red", "green", "blue", "alpha"].get(worst.channel).unwrap_or(&"?"),
                    worst.actual,
                    worst.golden,
                    crate::tolerance::significant(f64::from(worst.ratio)),
                )?;
                write!(f, "  pixels off at a tolerance of")?;
                for (factor, share) in [1.0, 10.0, 100.0, 1000.0].into_iter().zip(sweep) {
                    let tolerance = crate::tolerance::significant(f64::from(relative * factor));
                    write!(f, " {tolerance}: {share:.3}%;")?;
                }
                Ok(())
            }
        }
    }
}

impl fmt::Display for NonFinite {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} pixels with NaN and {} with infinities", self.nan, self.infinite)?;
        self.first.map_or(Ok(()), |(x, y)| write!(f, ", first at ({x}, {y})"))
    }
}

/// What is darker than this share of the golden's key is compared as if it were that bright. The
/// key is at middle grey on a screen, so the floor is 1/180 of what 8 bits resolve: black pixels
/// with rounding noise pass, and dark regions of a frame with bright ones are still compared.
const DARK: f32 = 1e-4;

/// Compares by size, finiteness, bits, and then each channel of each pixel: the difference may be
/// `relative` times the golden's value, or (but for alpha) times the share `DARK` of the golden's
/// key where that is more. There is no allowance for outliers.
pub(super) fn compare(
    golden: &Image,
    actual: &Image,
    relative: f32,
) -> Result<FrameMargin, FrameDifference> {
    let size = |image: &Image| (image.width(), image.height());
    if size(golden) != size(actual) {
        return Err(FrameDifference::Size { golden: size(golden), actual: size(actual) });
    }
    let census = actual.non_finite();
    if census.first.is_some() {
        return Err(FrameDifference::NonFinite(census));
    }
    let census = golden.non_finite();
    if census.first.is_some() {
        return Err(FrameDifference::GoldenNonFinite(census));
    }
    let pixels = golden.pixels().len();
    if golden.pixels() == actual.pixels() {
        return Ok(FrameMargin {
            pixels: pixels as u64,
            identical: true,
            ratio: 0.0,
            relative: 0.0,
        });
    }
    let floor = DARK * golden.key();
    let mut outliers = [0_usize; 4];
    let mut bounds = [u32::MAX, u32::MAX, 0, 0];
    let mut worst = Outlier { x: 0, y: 0, channel: 0, golden: 0.0, actual: 0.0, ratio: 0.0 };
    for (index, (expected, value)) in (0..).zip(golden.pixels().iter().zip(actual.pixels())) {
        let (x, y) = (index % golden.width(), index / golden.width());
        let mut largest = 0.0_f32;
        for channel in 0..4 {
            let (golden, actual) = (expected[channel], value[channel]);
            // Alpha is no light: it has no exposure that could hide a difference.
            let floor = if channel == 3 { 0.0 } else { floor };
            let ratio = (actual - golden).abs() / (relative * golden.abs().max(floor));
            // Equal is equal, also under a tolerance of 0; what isn't a ratio of at least 0 comes
            // of a tolerance that isn't one, and lets nothing pass.
            let ratio = match ratio {
                _ if actual == golden => 0.0,
                ratio if ratio >= 0.0 => ratio,
                _ => f32::INFINITY,
            };
            largest = largest.max(ratio);
            if ratio > worst.ratio {
                worst = Outlier { x, y, channel, golden, actual, ratio };
            }
        }
        for (count, factor) in outliers.iter_mut().zip([1.0, 10.0, 100.0, 1000.0]) {
            *count += usize::from(!(largest <= factor));
        }
        if !(largest <= 1.0) {
            let [left, top, right, bottom] = bounds;
            bounds = [left.min(x), top.min(y), right.max(x), bottom.max(y)];
        }
    }
    if outliers[0] == 0 {
        let ratio = worst.ratio;
        let relative = ratio * relative;
        return Ok(FrameMargin { pixels: pixels as u64, identical: false, ratio, relative });
    }
    let sweep = outliers.map(|count| 100.0 * count as f32 / pixels as f32);
    let outliers = outliers[0];
    Err(FrameDifference::Values { outliers, pixels, bounds, worst, relative, sweep })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp() -> Image {
        Image::new(16, 16, (0..256).map(|i| [i as f32 / 64.0, 0.5, 2.0, 1.0]).collect())
    }

    #[test]
    fn equal_images_pass_and_one_changed_channel_fails() {
        assert_eq!(compare(&ramp(), &ramp(), 1e-3).map(|m| m.identical), Ok(true));
        for (index, channel) in [(0, 0), (128, 1), (255, 2), (255, 3)] {
            let mut changed = ramp();
            changed.pixels_mut()[index][channel] += 0.01;
            let Err(FrameDifference::Values { outliers, worst, .. }) =
                compare(&ramp(), &changed, 1e-3)
            else {
                panic!("a change of channel {channel} in pixel {index} passed");
            };
            let place = (index as u32 % 16, index as u32 / 16, channel);
            assert_eq!((outliers, (worst.x, worst.y, worst.channel)), (1, place));
        }
    }

    #[test]
    fn small_drift_passes_with_its_margin() {
        let mut drifted = ramp();
        for pixel in drifted.pixels_mut() {
            *pixel = pixel.map(|value| value * 1.0004);
        }
        let margin = compare(&ramp(), &drifted, 1e-3).expect("within rel 1e-3");
        assert!((0.39..0.41).contains(&margin.ratio), "{margin:?}");
        assert!(compare(&ramp(), &drifted, 3e-4).is_err());
        assert!(compare(&ramp(), &drifted, 0.0).is_err());
    }

    #[test]
    fn nothing_that_is_not_a_number_passes() {
        for value in [f32::NAN, f32::INFINITY] {
            let mut broken = ramp();
            broken.pixels_mut()[7][1] = value;
            let error = compare(&ramp(), &broken, 1e9);
            assert!(matches!(error, Err(FrameDifference::NonFinite(_))));
            let error = compare(&broken, &ramp(), 1e9);
            assert!(matches!(error, Err(FrameDifference::GoldenNonFinite(_))));
            assert!(compare(&broken, &broken, 1e9).is_err(), "equal bits are no excuse");
        }
    }

    #[test]
    fn a_tolerance_that_is_not_a_number_lets_nothing_pass() {
        let mut changed = ramp();
        changed.pixels_mut()[7][1] = 0.9;
        for relative in [f32::NAN, -1.0] {
            assert!(compare(&ramp(), &changed, relative).is_err(), "{relative}");
        }
    }

    #[test]
    fn dark_regions_of_bright_frames_and_alpha_are_compared() {
        let mut golden = Image::new(16, 16, vec![[6e4, 6e4, 6e4, 1.0]; 256]);
        golden.pixels_mut()[..32].fill([0.05, 0.05, 0.05, 1.0]);
        for changed in [[0.15, 0.05, 0.05, 1.0], [0.05, 0.05, 0.05, 0.9]] {
            let mut actual = golden.clone();
            actual.pixels_mut()[3] = changed;
            assert!(compare(&golden, &actual, 1e-3).is_err(), "{changed:?}");
        }
    }

    #[test]
    fn another_size_fails() {
        let other = Image::new(8, 32, ramp().pixels().to_vec());
        assert!(matches!(compare(&ramp(), &other, 1.0), Err(FrameDifference::Size { .. })));
    }
}
