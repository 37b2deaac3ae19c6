//! HDR-FLIP: the difference that a person sees when a display alternates between two images.
//!
//! Sources: Andersson et al. 2020, "FLIP: A Difference Evaluator for Alternating Images"; Andersson et al. 2021,
//! "Visualizing Errors in Rendered High Dynamic Range Images". HDR-FLIP compares the images at several exposures. The
//! error of a pixel is its largest error at any exposure. The crate `flip-rs` computes the errors, and
//! `harness/tests/metric.rs` compares them with the errors of NVIDIA's implementation.
//!
//! HDR-FLIP is made for colours that a display can show, so it ignores alpha and negative light. If alpha or a negative
//! value differs by more than the default gate allows, the frame fails.

use flip_rs::{HdrOptions, RgbImage, hdr_flip};

use super::exposure::ExposureRange;
use super::exposure_map::ExposureMap;
use super::gate::Gate;
use super::mask::Rect;
use super::pair::Pair;
use super::relative::DARK;
use super::tiles::ErrorMap;
use super::{Measured, Metric};
use crate::image::Image;

/// The HDR-FLIP error of a frame, from 0 to 1.
///
/// ```
/// use karat::Image;
/// use karat::metric::Flip;
/// use karat::unstable::metric::{Metric, Pair};
///
/// let grey = |light: f32| Image::new(32, 32, vec![[light, light, light, 1.0]; 1024]);
/// let (golden, actual) = (grey(0.5), grey(0.6));
/// let flip = Flip::MEAN;
/// assert!(flip.measure(&Pair::new(&golden, &actual)?).value > 0.01);
/// # Ok::<(), karat::unstable::metric::PairError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flip {
    /// Pixels per degree of vision. A display that is 0.7 m and 3840 pixels wide, seen from 0.7 m, has 67 pixels per
    /// degree.
    pub pixels_per_degree: f32,
    /// The method that turns the errors of all pixels into one number.
    pub pool: Pool,
}

/// The method that turns the errors of all pixels into one number.
///
/// ```
/// use karat::metric::{Flip, Pool};
///
/// assert_eq!(Flip::MEAN.pool, Pool::Mean);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pool {
    /// The largest of the mean errors of all tiles of 16 x 16 pixels.
    LargestTile,
    /// The mean error of all pixels.
    Mean,
}

/// The reason why FLIP can't compute the errors of a frame.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FlipFailure {
    /// Alpha differs, and FLIP ignores alpha.
    #[error("alpha differs at ({0}, {1}), and FLIP ignores alpha")]
    Alpha(u32, u32),
    /// A negative value differs, and displays don't show negative values.
    #[error("a negative value differs at ({0}, {1}), and FLIP ignores negative values")]
    Negative(u32, u32),
    /// A value differs, and it is too bright or too dark for all exposures that FLIP can use.
    #[error(
        "the value {light:e} of pixel ({x}, {y}) is more than 128 stops outside of the golden's exposures: \
         clamp the value in the shader, or compare only by the gate"
    )]
    Exposures {
        /// The pixel's largest colour component, in the golden or in the frame.
        light: f32,
        /// The column of the pixel.
        x: u32,
        /// The row of the pixel.
        y: u32,
    },
    /// The exposures or the pixels per degree are invalid.
    #[error("FLIP can't be computed: {0}")]
    Parameters(String),
}

impl Flip {
    /// FLIP with [`Pool::LargestTile`].
    pub const LARGEST_TILE: Self = Self::with(Pool::LargestTile);
    /// FLIP with [`Pool::Mean`].
    pub const MEAN: Self = Self::with(Pool::Mean);

    const fn with(pool: Pool) -> Self {
        Self { pixels_per_degree: flip_rs::DEFAULT_PPD, pool }
    }

    /// The largest distance between two pixels that affect each other's errors: three standard deviations of the widest
    /// filter. Source: Andersson et al. 2020, sections 4.1 and 4.2.
    pub(super) fn reach(&self) -> u32 {
        // The two candidates are the widest Gaussian of contrast sensitivity (b = 0.04), and the features' size of
        // 0.082 degrees.
        let widest = (0.04 / (2.0 * std::f32::consts::PI.powi(2))).sqrt();
        let reach = (3.0 * widest.max(0.5 * 0.082) * self.pixels_per_degree).ceil();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 4096")]
        let reach = reach.clamp(0.0, 4096.0) as u32;
        reach
    }

    /// The errors in a rectangle of the frame. The rectangle contains all pixels that differ by more than
    /// [`Gate::default`] allows, and all pixels whose errors depend on them. FLIP for the whole frame would give the
    /// same errors, bit for bit. If a differing pixel is too bright for the golden's exposures, FLIP also uses darker
    /// exposures. If a differing pixel is too dark, FLIP also uses brighter exposures. To choose these exposures, FLIP
    /// treats pixels that are darker than 1e-4 of the golden's mean luminance as if they had this brightness.
    ///
    /// ```
    /// use karat::Image;
    /// use karat::metric::Flip;
    /// use karat::unstable::metric::Pair;
    ///
    /// let grey = |light: f32| Image::new(32, 32, vec![[light, light, light, 1.0]; 1024]);
    /// let (golden, actual) = (grey(0.5), grey(0.6));
    /// let map = Flip::MEAN.map(&Pair::new(&golden, &actual)?)?;
    /// assert!(map.at(16, 16) > 0.01);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// Returns an error if FLIP can't compute the errors, or if alpha or a negative value differs: FLIP ignores alpha
    /// and negative values.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn map(&self, pair: &Pair<'_>) -> Result<ErrorMap, FlipFailure> {
        self.worst(pair).map(|worst| worst.errors)
    }

    /// For each pixel, the exposure at which its error in [`map`](Self::map) is largest, in stops. The exposure is low
    /// for a difference in highlights, and high for a difference in shadows. If several exposures have the largest
    /// error, the map has the darkest of these. The possible exposures are those of [`Pair::exposures`], and those that
    /// `map` adds for very bright or very dark pixels.
    ///
    /// ```
    /// use karat::Image;
    /// use karat::metric::Flip;
    /// use karat::unstable::metric::Pair;
    ///
    /// let grey = |light: f32| Image::new(32, 32, vec![[light, light, light, 1.0]; 1024]);
    /// let (golden, actual) = (grey(0.5), grey(0.6));
    /// let exposures = Flip::MEAN.exposures(&Pair::new(&golden, &actual)?)?;
    /// assert!(exposures.range().is_some());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// The same errors as for [`map`](Self::map).
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn exposures(&self, pair: &Pair<'_>) -> Result<ExposureMap, FlipFailure> {
        self.worst(pair).map(|worst| worst.exposures)
    }

    /// The errors around the differing pixels. For the default viewing distance, `pair` caches the errors.
    fn worst(&self, pair: &Pair<'_>) -> Result<Worst, FlipFailure> {
        if self.pixels_per_degree == flip_rs::DEFAULT_PPD {
            return pair.memo(|| self.compute(pair));
        }
        self.compute(pair)
    }

    fn compute(&self, pair: &Pair<'_>) -> Result<Worst, FlipFailure> {
        let (width, height) = (pair.golden().width(), pair.golden().height());
        let (rect, ranges) = match Off::of(pair)? {
            None => (Rect::new(0, 0, 0, 0), Vec::new()),
            Some(off) => (
                Rect::spanning(off.bounds).grown(self.reach(), width, height),
                off.exposures(pair)?,
            ),
        };
        let pixels = rect.width as usize * rect.height as usize;
        let (mut errors, mut exposures) = (vec![0.0; pixels], vec![f32::NAN; pixels]);
        for range in ranges {
            let found = self.part(pair, rect, range)?;
            let so_far = errors.iter_mut().zip(&mut exposures);
            for ((error, exposure), (found, at)) in so_far.zip(found) {
                if found > *error {
                    (*error, *exposure) = (found, at);
                }
            }
        }
        let exposures = ExposureMap::new(rect, exposures, pair);
        Ok(Worst { errors: ErrorMap::new(rect, errors), exposures })
    }

    /// The errors of all pixels, as in the published method: only at the exposures of [`Pair::exposures`].
    ///
    /// ```
    /// use karat::Image;
    /// use karat::metric::Flip;
    /// use karat::unstable::metric::Pair;
    ///
    /// let grey = Image::new(32, 32, vec![[0.5, 0.5, 0.5, 1.0]; 1024]);
    /// let map = Flip::MEAN.whole(&Pair::new(&grey, &grey)?)?;
    /// assert_eq!(map.at(16, 16), 0.0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// Returns an error if FLIP can't compute the errors.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn whole(&self, pair: &Pair<'_>) -> Result<ErrorMap, FlipFailure> {
        let whole = Rect::new(0, 0, pair.golden().width(), pair.golden().height());
        let found = self.part(pair, whole, pair.exposures())?;
        Ok(ErrorMap::new(whole, found.into_iter().map(|(error, _)| error).collect()))
    }

    /// The error of each pixel in `rect`, and the exposure at which the error is largest. The function also reads the
    /// pixels around `rect` that affect these errors.
    fn part(
        &self,
        pair: &Pair<'_>,
        rect: Rect,
        exposures: ExposureRange,
    ) -> Result<Vec<(f32, f32)>, FlipFailure> {
        let failed = |error: flip_rs::FlipError| FlipFailure::Parameters(error.to_string());
        let (width, height) = (pair.golden().width(), pair.golden().height());
        let read = rect.grown(self.reach(), width, height);
        let [golden, actual] =
            [pair.golden(), pair.actual()].map(|image| crop(image, read, |light| light));
        let mut options = HdrOptions::default();
        options.ppd = self.pixels_per_degree;
        #[expect(clippy::cast_possible_truncation, reason = "stops, to the hundredth")]
        let [start, stop] = [exposures.start as f32, exposures.stop as f32];
        (options.start_exposure, options.stop_exposure) = (Some(start), Some(stop));
        options.num_exposures = Some(exposures.count());
        options.return_exposure_map = true;
        let found = hdr_flip(&golden.map_err(failed)?, &actual.map_err(failed)?, options);
        let found = found.map_err(failed)?;
        let (errors, worst) = (found.error_map, found.exposure_map.expect("it was asked for"));
        // `flip-rs` gives exposures as positions in the range, from 0 to 1.
        let last = (exposures.count() - 1) as f32;
        let step = (stop - start) / last;
        let pixel = |(error, place): (&f32, &f32)| (*error, start + (place * last).round() * step);
        let width = read.width as usize;
        let rows = errors.pixels().chunks(width).zip(worst.pixels().chunks(width));
        let (left, top) = ((rect.left - read.left) as usize, (rect.top - read.top) as usize);
        let columns = left..left + rect.width as usize;
        let rows = rows.skip(top).take(rect.height as usize);
        let rows = rows.flat_map(|(errors, worst)| {
            errors[columns.clone()].iter().zip(&worst[columns.clone()])
        });
        Ok(rows.map(pixel).collect())
    }
}

/// FLIP's errors, and their exposures, in the rectangle that the differing pixels affect.
#[derive(Clone, Debug)]
pub(super) struct Worst {
    errors: ErrorMap,
    exposures: ExposureMap,
}

/// The differing pixels: the pixels that the default gate rejects.
struct Off {
    /// The first column, the first row, the last column and the last row.
    bounds: [u32; 4],
    /// The largest component of the brightest differing pixel, and the pixel's index.
    brightest: (f32, usize),
    /// The largest component of the dimmest differing pixel, and the pixel's index.
    dimmest: (f32, usize),
}

impl Off {
    /// Finds the differing pixels. `None` if the default gate passes all pixels.
    fn of(pair: &Pair<'_>) -> Result<Option<Self>, FlipFailure> {
        let (mut off, mut unseen): (Option<Self>, _) = (None, None);
        Gate::default().each(pair, |index, golden, actual, ratio| {
            let (x, y) = pair.place(index);
            if !(ratio[3] <= 1.0) {
                unseen = unseen.take().or(Some(FlipFailure::Alpha(x, y)));
            }
            if (0..3).any(|c| !(ratio[c] <= 1.0) && golden[c].min(actual[c]) < 0.0) {
                unseen = unseen.take().or(Some(FlipFailure::Negative(x, y)));
            }
            let light = golden[..3].iter().chain(&actual[..3]).copied().fold(0.0, f32::max);
            let light = (light, index);
            let off =
                off.get_or_insert(Self { bounds: [x, y, x, y], brightest: light, dimmest: light });
            if light.0 > off.brightest.0 {
                off.brightest = light;
            }
            if light.0 < off.dimmest.0 {
                off.dimmest = light;
            }
            let [left, top, right, bottom] = off.bounds;
            off.bounds = [left.min(x), top.min(y), right.max(x), bottom.max(y)];
        });
        unseen.map_or(Ok(off), Err)
    }

    /// The exposures of the pair, and further exposures for differing pixels that are too bright or too dark for the
    /// pair's exposures.
    fn exposures(&self, pair: &Pair<'_>) -> Result<Vec<ExposureRange>, FlipFailure> {
        let exposures = pair.exposures();
        let dark = self.dimmest.0.max(DARK * pair.key());
        let visible = |range: ExposureRange, (light, index)| {
            let (x, y) = pair.place(index);
            let beyond = FlipFailure::Exposures { light, x, y };
            if range.is_visible() { Ok(range) } else { Err(beyond) }
        };
        let below = exposures.below(self.brightest.0).map(|range| visible(range, self.brightest));
        let above = exposures.above(dark).map(|range| visible(range, self.dimmest));
        // Dark exposures come first, because the first of several equal errors counts.
        [below, Some(Ok(exposures)), above].into_iter().flatten().collect()
    }
}

/// The colours in a rectangle of an image. `value` converts each component.
pub(super) fn crop(
    image: &Image,
    rect: Rect,
    value: impl Fn(f32) -> f32,
) -> Result<RgbImage<f32>, flip_rs::FlipError> {
    let (left, width) = (rect.left as usize, rect.width as usize);
    let rows = image.pixels().chunks(image.width().max(1) as usize).skip(rect.top as usize);
    let rows = rows.take(rect.height as usize).flat_map(|row| &row[left..left + width]);
    let colours = rows.flat_map(|[r, g, b, _]| [*r, *g, *b].map(&value)).collect();
    RgbImage::new(width, rect.height as usize, colours)
}

impl Metric for Flip {
    fn most(&self) -> f64 {
        1.0
    }

    fn name(&self) -> String {
        match self.pool {
            Pool::LargestTile => "largest FLIP tile".to_owned(),
            Pool::Mean => "mean FLIP".to_owned(),
        }
    }

    fn measure(&self, pair: &Pair<'_>) -> Measured {
        let map = match self.map(pair) {
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
