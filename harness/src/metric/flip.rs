//! HDR-FLIP: what an eye sees of a difference when it flips between two images.
//!
//! Andersson et al. 2020, "FLIP: A Difference Evaluator for Alternating Images"; Andersson et al.
//! 2021, "Visualizing Errors in Rendered High Dynamic Range Images". The images are brought to a
//! display at several exposures, and of each pixel the largest error counts. `flip-rs` computes it,
//! and `harness/tests/metric.rs` compares that with NVIDIA's own implementation.
//!
//! It is made for colours that a display can show. What it doesn't see is no small error here but
//! a failure: alpha, and negative light.

use flip_rs::{HdrOptions, RgbImage, hdr_flip};

use super::exposure::ExposureRange;
use super::gate::{DARK, Gate};
use super::mask::Rect;
use super::pair::Pair;
use super::tiles::ErrorMap;
use super::{Measured, Metric};
use crate::image::Image;

/// The error of HDR-FLIP, 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flip {
    /// Pixels in a degree of sight; 67 of a 0.7 m wide display of 3840 pixels, seen from 0.7 m.
    pub pixels_per_degree: f32,
    /// What is taken of all pixels.
    pub pool: Pool,
}

/// What is taken of the errors of all pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pool {
    /// The largest mean of a tile of 16 x 16 pixels.
    LargestTile,
    /// The mean.
    Mean,
}

/// Why FLIP has no map.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FlipFailure {
    /// Alpha is off, which isn't a colour.
    #[error("alpha is off at ({0}, {1}), which FLIP doesn't see")]
    Alpha(u32, u32),
    /// A negative value is off, which displays don't show.
    #[error("a negative value is off at ({0}, {1}), which FLIP doesn't see")]
    Negative(u32, u32),
    /// The exposures or the distance of sight are none.
    #[error("FLIP can't be computed: {0}")]
    Parameters(String),
}

impl Flip {
    /// Judged by the largest mean of a tile.
    pub const LARGEST_TILE: Self = Self::with(Pool::LargestTile);
    /// Judged by the mean.
    pub const MEAN: Self = Self::with(Pool::Mean);

    const fn with(pool: Pool) -> Self {
        Self { pixels_per_degree: flip_rs::DEFAULT_PPD, pool }
    }

    /// How far a pixel's difference is seen: three deviations of the widest filter. Andersson et
    /// al. 2020, sections 4.1 and 4.2.
    fn reach(&self) -> u32 {
        // The widest Gaussian of contrast sensitivity, b = 0.04, and features of 0.082 degrees.
        let widest = (0.04 / (2.0 * std::f32::consts::PI.powi(2))).sqrt();
        let reach = (3.0 * widest.max(0.5 * 0.082) * self.pixels_per_degree).ceil();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 4096")]
        let reach = reach.clamp(0.0, 4096.0) as u32;
        reach
    }

    /// The errors of the pixels that see what is off by more than [`Gate::default`] allows: they
    /// are those that the whole frame would give, bit for bit. Where the golden's exposures don't
    /// show a pixel that is off, since it is brighter than all but 0.1 % of the golden, darker ones
    /// are added; and brighter ones for what is off in the dark, down to where the gate ends.
    ///
    /// # Errors
    /// If something is off that FLIP doesn't see, or it can't be computed.
    pub fn map(&self, pair: &Pair<'_>) -> Result<ErrorMap, FlipFailure> {
        let exposures = pair.exposures();
        let mut bounds: Option<[u32; 4]> = None;
        let (mut brightest, mut dimmest, mut unseen) = (0.0_f32, f32::INFINITY, None);
        Gate::default().each(pair, |index, golden, actual, ratio| {
            let (x, y) = pair.place(index);
            if !(ratio[3] <= 1.0) {
                unseen = unseen.take().or(Some(FlipFailure::Alpha(x, y)));
            }
            if (0..3).any(|c| !(ratio[c] <= 1.0) && golden[c].min(actual[c]) < 0.0) {
                unseen = unseen.take().or(Some(FlipFailure::Negative(x, y)));
            }
            let light = golden[..3].iter().chain(&actual[..3]).copied().fold(0.0, f32::max);
            (brightest, dimmest) = (brightest.max(light), dimmest.min(light));
            let [left, top, right, bottom] = bounds.unwrap_or([x, y, x, y]);
            bounds = Some([left.min(x), top.min(y), right.max(x), bottom.max(y)]);
        });
        if let Some(unseen) = unseen {
            return Err(unseen);
        }
        let Some(bounds) = bounds else {
            return Ok(ErrorMap::new(Rect::new(0, 0, 0, 0), Vec::new()));
        };
        let (width, height) = (pair.golden().width(), pair.golden().height());
        let seen = Rect::spanning(bounds).grown(self.reach(), width, height);
        let mut map = self.part(pair, seen, exposures)?;
        if let Some(below) = exposures.below(brightest) {
            let dark = self.part(pair, seen, below)?;
            let larger = map.values().iter().zip(dark.values()).map(|(a, b)| a.max(*b)).collect();
            map = ErrorMap::new(seen, larger);
        }
        if let Some(above) = exposures.above(dimmest.max(DARK * pair.key())) {
            let bright = self.part(pair, seen, above)?;
            let larger = map.values().iter().zip(bright.values()).map(|(a, b)| a.max(*b)).collect();
            map = ErrorMap::new(seen, larger);
        }
        Ok(map)
    }

    /// The errors of all pixels, as published: of the pair's exposures and no others.
    ///
    /// # Errors
    /// If it can't be computed.
    pub fn whole(&self, pair: &Pair<'_>) -> Result<ErrorMap, FlipFailure> {
        let whole = Rect::new(0, 0, pair.golden().width(), pair.golden().height());
        self.part(pair, whole, pair.exposures())
    }

    /// The errors of a rectangle, from all that its pixels see.
    fn part(
        &self,
        pair: &Pair<'_>,
        rect: Rect,
        exposures: ExposureRange,
    ) -> Result<ErrorMap, FlipFailure> {
        let failed = |error: flip_rs::FlipError| FlipFailure::Parameters(error.to_string());
        let (width, height) = (pair.golden().width(), pair.golden().height());
        let read = rect.grown(self.reach(), width, height);
        let [golden, actual] = [pair.golden(), pair.actual()].map(|image| crop(image, read));
        let mut options = HdrOptions::default();
        options.ppd = self.pixels_per_degree;
        #[expect(clippy::cast_possible_truncation, reason = "stops, to the hundredth")]
        let [start, stop] = [exposures.start as f32, exposures.stop as f32];
        (options.start_exposure, options.stop_exposure) = (Some(start), Some(stop));
        options.num_exposures = Some(exposures.count());
        options.return_exposure_map = false;
        let found = hdr_flip(&golden.map_err(failed)?, &actual.map_err(failed)?, options);
        let errors = found.map_err(failed)?.error_map;
        let (left, top) = ((rect.left - read.left) as usize, (rect.top - read.top) as usize);
        let rows = errors.pixels().chunks(read.width as usize).skip(top);
        let rows = rows.take(rect.height as usize);
        let values = rows.flat_map(|row| &row[left..left + rect.width as usize]).copied();
        Ok(ErrorMap::new(rect, values.collect()))
    }
}

fn crop(image: &Image, rect: Rect) -> Result<RgbImage<f32>, flip_rs::FlipError> {
    let (left, width) = (rect.left as usize, rect.width as usize);
    let rows = image.pixels().chunks(image.width().max(1) as usize).skip(rect.top as usize);
    let rows = rows.take(rect.height as usize).flat_map(|row| &row[left..left + width]);
    let colours = rows.flat_map(|[r, g, b, _]| [*r, *g, *b]).collect();
    RgbImage::new(width, rect.height as usize, colours)
}

impl Metric for Flip {
    fn name(&self) -> String {
        match self.pool {
            Pool::LargestTile => "largest FLIP tile".to_owned(),
            Pool::Mean => "mean FLIP".to_owned(),
        }
    }

    fn measure(&self, pair: &Pair<'_>) -> Measured {
        let cached = self.pixels_per_degree == flip_rs::DEFAULT_PPD;
        let map =
            if cached { pair.flip.get_or_init(|| self.map(pair)).clone() } else { self.map(pair) };
        let map = match map {
            Ok(map) => map,
            Err(failure) => {
                let note = Some(failure.to_string());
                return Measured { note, ..Measured::of(f64::INFINITY) };
            }
        };
        let (value, place) = match self.pool {
            Pool::LargestTile => map.largest_tile(pair),
            Pool::Mean => (map.mean(pair), map.rect()),
        };
        let place = (value > 0.0 && self.pool == Pool::LargestTile).then_some(place);
        Measured { value, place, map: Some(map), note: None }
    }
}
