//! Compares a frame with its golden. The cheapest criteria come first.

use std::fmt;

use super::profile::Profile;
use super::tolerance::{CriterionMargin, FrameCriterion, FrameTolerance, Judgement};
use crate::image::{Image, NonFinite};
use crate::metric::{
    ExposureRange, Gate, Mask, MaskError, Measured, Metric, Noise, Outliers, Pair, PairError, Rect,
    WorstPixel,
};
use crate::output::counted;
use crate::tolerance::significant;

/// The result of a comparison that passes.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameMargin {
    /// Number of pixels that were compared.
    pub pixels: u64,
    /// Number of pixels in the frame.
    pub frame_pixels: u64,
    /// The criterion by which the frame passes.
    pub decided_by: FrameCriterion,
    /// The measured value of `decided_by`, divided by the bound of this criterion.
    pub ratio: f64,
    /// The largest relative difference: a channel's difference divided by the golden's value.
    pub relative: f32,
    /// Number of pixels that differ by more than the gate allows. If this isn't 0, the frame passes by another
    /// criterion.
    pub beyond_gate: usize,
    /// All measurements; empty if every bit is equal.
    pub margins: Vec<CriterionMargin>,
    /// The frame's tolerance, as text.
    pub tolerance: String,
    /// The golden's file.
    pub golden: String,
    /// The profile that owns the golden; `None` if the golden is for all profiles.
    pub profile: Option<Profile>,
}

impl FrameMargin {
    /// Checks if every bit is equal.
    #[must_use]
    pub fn is_identical(&self) -> bool {
        self.decided_by == FrameCriterion::Bits
    }
}

/// `passes by FLIP: the gate is exceeded at 12 pixels, largest FLIP tile 0.004 of 0.01`
impl fmt::Display for FrameMargin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let gate = |f: &mut fmt::Formatter<'_>| match self.beyond_gate {
            0 => Ok(()),
            pixels => write!(f, "the gate is exceeded at {}, ", counted(pixels, "pixel")),
        };
        match self.decided_by {
            FrameCriterion::Bits => f.write_str("equal")?,
            FrameCriterion::Finite => f.write_str("finite")?,
            FrameCriterion::Gate => write!(f, "rel {}", significant(f64::from(self.relative)))?,
            FrameCriterion::Flip | FrameCriterion::Metric | FrameCriterion::Noise => {
                let by = match self.decided_by {
                    FrameCriterion::Flip => "FLIP",
                    FrameCriterion::Noise => "noise",
                    _ => "a metric",
                };
                write!(f, "passes by {by}: ")?;
                gate(f)?;
                let decisive =
                    self.margins.iter().filter(|margin| margin.criterion == self.decided_by);
                for (index, margin) in decisive.enumerate() {
                    f.write_str(if index == 0 { "" } else { ", " })?;
                    let CriterionMargin { name, value, bound, .. } = margin;
                    write!(f, "{name} {} of {}", significant(*value), significant(*bound))?;
                }
            }
        }
        write!(f, "{}", Share { compared: self.pixels, of: self.frame_pixels })
    }
}

/// Displays the percentage of a masked frame's pixels that Karat compared.
struct Share {
    compared: u64,
    of: u64,
}

impl fmt::Display for Share {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.compared == self.of {
            return Ok(());
        }
        let share = 100.0 * self.compared as f64 / self.of as f64;
        write!(f, " (compared: {}% of the frame)", significant(share))
    }
}

/// The reason why a frame doesn't agree with its golden.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum FrameDifference {
    /// Golden and frame have different sizes.
    Size {
        /// Width and height of the golden.
        golden: (u32, u32),
        /// Width and height of the frame.
        actual: (u32, u32),
    },
    /// The frame has NaN or infinities.
    NonFinite(NonFinite),
    /// The golden has NaN or infinities, so no frame can agree with the golden.
    GoldenNonFinite(NonFinite),
    /// The mask can't be used.
    Mask(MaskError),
    /// The tolerance has a useless bound: one that every frame passes, or that no frame passes.
    Tolerance(String),
    /// Values differ by more than the tolerance.
    Values(Box<Deviation>),
}

/// The differences between the values of a frame and its golden.
#[derive(Clone, Debug, PartialEq)]
pub struct Deviation {
    /// Number of pixels with a channel whose difference exceeds the gate.
    pub outliers: usize,
    /// Number of pixels that were compared.
    pub pixels: usize,
    /// Number of pixels in the frame.
    pub frame_pixels: usize,
    /// Smallest rectangle that contains all pixels that exceed the gate.
    pub bounds: Rect,
    /// The pixel with the largest difference, relative to the gate; `None` if no pixel exceeds the gate.
    pub worst: Option<WorstPixel>,
    /// The gate of the tolerance.
    pub gate: Gate,
    /// Four percentages: the pixels whose difference exceeds 1, 10, 100 and 1000 times the gate.
    pub sweep: [f32; 4],
    /// All measurements.
    pub margins: Vec<CriterionMargin>,
    /// The exposures that HDR-FLIP used.
    pub exposures: ExposureRange,
    /// `true` if the exposures come from the golden's file.
    pub pinned: bool,
}

impl FrameDifference {
    /// Checks if the frame's values differ from the golden's values, or are NaN or infinite.
    pub(crate) fn is_of_values(&self) -> bool {
        matches!(self, Self::Values(_) | Self::NonFinite(_))
    }
}

impl fmt::Display for FrameDifference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Size { golden, actual } => {
                let (golden, actual) = (*golden, *actual);
                write!(f, "{}", PairError::Size { golden, actual })
            }
            Self::NonFinite(census) => write!(f, "{}", PairError::NonFinite(*census)),
            Self::GoldenNonFinite(census) => write!(f, "{}", PairError::GoldenNonFinite(*census)),
            Self::Mask(error) => write!(f, "the frame can't be compared: {error}"),
            Self::Tolerance(reason) => write!(f, "its tolerance is {reason}"),
            Self::Values(deviation) => write!(f, "{deviation}"),
        }
    }
}

pub(super) struct Terms<'a> {
    pub(super) tolerance: &'a FrameTolerance,
    pub(super) mask: Option<&'a Mask>,
    /// The exposures that the golden's file stores.
    pub(super) exposures: Option<ExposureRange>,
    /// For noisy frames: the golden's variance, if the golden has one, and the frame's variance.
    pub(super) noise: Option<(Option<&'a Image>, &'a Image)>,
}

impl<'a> Terms<'a> {
    pub(super) fn of(tolerance: &'a FrameTolerance) -> Self {
        Self { tolerance, mask: None, exposures: None, noise: None }
    }
}

/// Compares two images: first their sizes, then their bits, then each criterion of the tolerance in order. NaN and
/// infinities fail.
pub(super) fn compare(
    golden: &Image,
    actual: &Image,
    terms: &Terms<'_>,
) -> Result<FrameMargin, FrameDifference> {
    let pair = match terms.mask {
        None => Pair::new(golden, actual),
        Some(mask) => Pair::masked(golden, actual, mask),
    };
    let pair = pair.map_err(|error| match error {
        PairError::Size { golden, actual } => FrameDifference::Size { golden, actual },
        PairError::NonFinite(census) => FrameDifference::NonFinite(census),
        PairError::GoldenNonFinite(census) => FrameDifference::GoldenNonFinite(census),
        PairError::Mask(error) => FrameDifference::Mask(error),
    })?;
    // Pinned exposures come from all pixels, so a comparison with a mask doesn't use them: masked pixels must not
    // count.
    let pair = match terms.exposures.filter(|_| terms.mask.is_none()) {
        Some(exposures) => pair.with_exposures(exposures),
        None => pair,
    };
    judge(&pair, terms)
}

impl FrameTolerance {
    /// Compares two images with the criteria that [`Frame::matches`](crate::Frame::matches) uses for a frame and
    /// its golden. Karat derives HDR-FLIP's exposures from the golden.
    ///
    /// # Errors
    /// Returns an error if the images differ by more than the tolerance, or can't be compared.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn compare(
        &self,
        golden: &Image,
        actual: &Image,
        mask: Option<&Mask>,
    ) -> Result<FrameMargin, FrameDifference> {
        if let Some(unusable) = self.unusable() {
            return Err(FrameDifference::Tolerance(unusable));
        }
        compare(golden, actual, &Terms { mask, ..Terms::of(self) })
    }
}

/// Measures the noise-corrected difference: the part of the difference that the noise of the two images doesn't
/// explain.
fn judge_noise(pair: &Pair<'_>, golden: Option<&Image>, actual: &Image) -> CriterionMargin {
    let measured = match golden {
        Some(golden) => Noise { golden, actual }.measure(pair),
        None => {
            let note = "the golden stores no pixel variance: accept the frame again".to_owned();
            Measured { note: Some(note), ..Measured::of(f64::NAN) }
        }
    };
    let Measured { value, place, note, .. } = measured;
    let (criterion, name) = (FrameCriterion::Noise, "noise".to_owned());
    CriterionMargin { criterion, name, value, bound: 1.0, place, note }
}

fn judge(pair: &Pair<'_>, terms: &Terms<'_>) -> Result<FrameMargin, FrameDifference> {
    let tolerance = terms.tolerance;
    let frame_pixels = pair.golden().pixels().len();
    let mut margin = FrameMargin {
        pixels: pair.compared_count() as u64,
        frame_pixels: frame_pixels as u64,
        decided_by: FrameCriterion::Bits,
        ratio: 0.0,
        relative: 0.0,
        beyond_gate: 0,
        margins: Vec::new(),
        tolerance: tolerance.to_string(),
        golden: String::new(),
        profile: None,
    };
    if pair.is_identical() {
        return Ok(margin);
    }
    let Judgement { mut passes, mut margins, mut decisive } = tolerance.judge(pair);
    if let Some((golden, actual)) = terms.noise.filter(|_| !passes) {
        let noise = judge_noise(pair, golden, actual);
        (passes, decisive) = (noise.passes(), margins.len());
        margins.push(noise);
    }
    let gate = tolerance.first_gate().unwrap_or_default();
    let decisive = &margins[decisive];
    if passes && decisive.criterion == FrameCriterion::Gate {
        #[expect(clippy::cast_possible_truncation, reason = "it was an f32")]
        let ratio = decisive.value as f32;
        margin.relative = ratio * gate.relative;
        (margin.decided_by, margin.ratio) = (FrameCriterion::Gate, decisive.value);
        return Ok(FrameMargin { margins, ..margin });
    }
    let out = gate.outliers(pair);
    if passes {
        margin.relative = out.as_ref().map_or(0.0, |out| out.worst.ratio * gate.relative);
        margin.beyond_gate = out.map_or(0, |out| out.count);
        (margin.decided_by, margin.ratio) = (decisive.criterion, decisive.ratio());
        return Ok(FrameMargin { margins, ..margin });
    }
    let whole = Rect::new(0, 0, pair.golden().width(), pair.golden().height());
    let (outliers, bounds, worst, sweep) = match out {
        Some(Outliers { count, rect, worst, sweep }) => (count, rect, Some(worst), sweep),
        None => (0, whole, None, [0.0; 4]),
    };
    Err(FrameDifference::Values(Box::new(Deviation {
        outliers,
        pixels: pair.compared_count(),
        frame_pixels,
        bounds,
        worst,
        gate,
        sweep,
        margins,
        exposures: pair.exposures(),
        pinned: terms.exposures.is_some() && terms.mask.is_none(),
    })))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn compare(
        golden: &Image,
        actual: &Image,
        relative: f32,
    ) -> Result<FrameMargin, FrameDifference> {
        let tolerance = &FrameTolerance::gate(relative);
        super::compare(golden, actual, &Terms::of(tolerance))
    }

    fn ramp() -> Image {
        Image::new(16, 16, (0..256).map(|i| [i as f32 / 64.0, 0.5, 2.0, 1.0]).collect())
    }

    // Lesson 16
    #[test]
    fn equal_images_pass_and_one_changed_channel_fails() {
        assert_eq!(compare(&ramp(), &ramp(), 1e-3).map(|m| m.is_identical()), Ok(true));
        for (index, channel) in [(0, 0), (128, 1), (255, 2), (255, 3)] {
            let mut changed = ramp();
            changed.pixels_mut()[index][channel] += 0.01;
            let Err(FrameDifference::Values(deviation)) = compare(&ramp(), &changed, 1e-3) else {
                panic!("a change of channel {channel} in pixel {index} passed");
            };
            let place = (index as u32 % 16, index as u32 / 16, channel);
            let worst = deviation.worst.expect("there is one");
            assert_eq!((deviation.outliers, (worst.x, worst.y, worst.channel)), (1, place));
        }
    }

    // Lesson 16
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

    // Lesson 46: NaN
    #[test]
    fn images_with_nan_or_infinity_fail() {
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

    // Lesson 20
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
