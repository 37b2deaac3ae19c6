//! A golden and a frame that metrics can measure.

use std::any::Any;
use std::borrow::Cow;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

use glam::Vec4;

use super::exposure::ExposureRange;
use super::mask::{Mask, MaskError, Rect};
use super::relative;
use crate::image::{Image, NonFinite};
use crate::output::counted;

/// The number of pixels in a strip. A strip of both images fits in the smallest cache.
pub(super) const STRIP: usize = 512;

/// A golden and a frame. The two images have the same size, all compared values are finite, and pixels outside of the
/// mask are equal.
///
/// ```
/// use karat::Image;
/// use karat::unstable::metric::Pair;
///
/// let (golden, actual) = (Image::new(2, 1, vec![[1.0; 4]; 2]), Image::new(2, 1, vec![[0.5; 4]; 2]));
/// let pair = Pair::new(&golden, &actual)?;
/// assert_eq!((pair.compared_count(), pair.is_identical()), (2, false));
/// # Ok::<(), karat::unstable::metric::PairError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Pair<'a> {
    golden: Cow<'a, Image>,
    actual: Cow<'a, Image>,
    /// One flag for each pixel: `true` if metrics compare the pixel. `None` if there is no mask.
    mask: Option<Vec<bool>>,
    compared: usize,
    different: Vec<Range<usize>>,
    /// The largest relative difference of any channel: the difference divided by the golden's value.
    largest_relative: f32,
    exposures: OnceLock<ExposureRange>,
    key: OnceLock<f32>,
    /// The cached result of a computation that several metrics need.
    memo: OnceLock<Arc<dyn Any + Send + Sync>>,
}

/// The reason why metrics can't compare two images.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PairError {
    /// The images have different sizes.
    #[error("the frame's size is {} x {}, but the golden's size is {} x {}", actual.0, actual.1, golden.0, golden.1)]
    Size {
        /// Width and height of the golden.
        golden: (u32, u32),
        /// Width and height of the frame.
        actual: (u32, u32),
    },
    /// The frame has NaN or infinities.
    #[error("it has {0}")]
    NonFinite(NonFinite),
    /// The golden has NaN or infinities, so no frame can match it.
    #[error("the golden itself has {0}")]
    GoldenNonFinite(NonFinite),
    /// The mask can't be used.
    #[error(transparent)]
    Mask(#[from] MaskError),
}

impl std::fmt::Display for NonFinite {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} with NaN and {} with infinities", counted(self.nan, "pixel"), self.infinite)?;
        self.first.map_or(Ok(()), |(x, y)| write!(f, ", first at ({x}, {y})"))
    }
}

impl<'a> Pair<'a> {
    /// Makes a pair in which metrics compare all pixels.
    ///
    /// ```
    /// use karat::Image;
    /// use karat::unstable::metric::Pair;
    ///
    /// let (small, large) = (Image::new(1, 1, vec![[1.0; 4]]), Image::new(2, 1, vec![[1.0; 4]; 2]));
    /// assert!(Pair::new(&small, &large).is_err());
    /// ```
    ///
    /// # Errors
    /// Returns an error if the images have different sizes, or if a value isn't finite.
    pub fn new(golden: &'a Image, actual: &'a Image) -> Result<Self, PairError> {
        same_size(golden, actual)?;
        Self::scan(Cow::Borrowed(golden), Cow::Borrowed(actual), None)
    }

    /// Makes a pair in which metrics compare only the pixels of a mask. All other pixels of the frame become equal to
    /// the golden's, so they don't affect metrics that use a pixel's neighbours.
    ///
    /// ```
    /// use karat::Image;
    /// use karat::metric::{Mask, Rect};
    /// use karat::unstable::metric::Pair;
    ///
    /// let image = Image::new(4, 4, vec![[1.0; 4]; 16]);
    /// let pair = Pair::masked(&image, &image, &Mask::only(&[Rect::new(0, 0, 2, 2)]))?;
    /// assert_eq!(pair.compared_count(), 4);
    /// # Ok::<(), karat::unstable::metric::PairError>(())
    /// ```
    ///
    /// # Errors
    /// Returns an error if the sizes differ, if a compared pixel isn't finite, or if the mask can't be used.
    pub fn masked(golden: &'a Image, actual: &'a Image, mask: &Mask) -> Result<Self, PairError> {
        same_size(golden, actual)?;
        let flags = mask.flags(golden.width(), golden.height())?;
        let (mut golden, mut actual) = (golden.clone(), actual.clone());
        let pixels = golden.pixels_mut().iter_mut().zip(actual.pixels_mut());
        for ((golden, actual), _) in pixels.zip(&flags).filter(|(_, compared)| !**compared) {
            if !golden.iter().all(|value| value.is_finite()) {
                *golden = [0.0; 4];
            }
            *actual = *golden;
        }
        Self::scan(Cow::Owned(golden), Cow::Owned(actual), Some(flags))
    }

    fn scan(
        golden: Cow<'a, Image>,
        actual: Cow<'a, Image>,
        mask: Option<Vec<bool>>,
    ) -> Result<Self, PairError> {
        let mut different: Vec<Range<usize>> = Vec::new();
        // These sums stay 0 if all values are finite. A NaN or an infinity times 0 is NaN.
        let (mut nothing, mut nothing_golden) = (Vec4::ZERO, Vec4::ZERO);
        let mut largest = Vec4::ZERO;
        let pixels = golden.pixels().chunks(STRIP).zip(actual.pixels().chunks(STRIP));
        for (index, (golden, actual)) in pixels.enumerate() {
            nothing_golden = vanishing(golden, nothing_golden);
            if bytemuck::cast_slice::<_, u8>(golden) == bytemuck::cast_slice::<_, u8>(actual) {
                continue;
            }
            for (golden, actual) in golden.iter().zip(actual) {
                nothing += Vec4::from_array(*actual) * 0.0;
                largest = largest.max(relative::ratio(*golden, *actual, Vec4::ONE, Vec4::ZERO));
            }
            let start = index * STRIP;
            match different.last_mut() {
                Some(last) if last.end == start => last.end += golden.len(),
                _ => different.push(start..start + golden.len()),
            }
        }
        if (nothing + nothing_golden) != Vec4::ZERO {
            let census = actual.non_finite();
            return Err(if census.first.is_some() {
                PairError::NonFinite(census)
            } else {
                PairError::GoldenNonFinite(golden.non_finite())
            });
        }
        let compared = match &mask {
            Some(flags) => flags.iter().filter(|compared| **compared).count(),
            None => golden.pixels().len(),
        };
        let largest_relative = largest.max_element();
        let (exposures, key, memo) = Default::default();
        Ok(Self {
            golden,
            actual,
            mask,
            compared,
            different,
            largest_relative,
            exposures,
            key,
            memo,
        })
    }

    /// Sets the exposures for HDR-FLIP. By default, the golden's brightness determines the exposures.
    ///
    /// ```
    /// use karat::Image;
    /// use karat::unstable::metric::{ExposureRange, Pair};
    ///
    /// let image = Image::new(1, 1, vec![[1.0; 4]]);
    /// let pair = Pair::new(&image, &image)?.with_exposures(ExposureRange { start: 0.0, stop: 4.0 });
    /// assert_eq!(pair.exposures().count(), 4);
    /// # Ok::<(), karat::unstable::metric::PairError>(())
    /// ```
    #[must_use]
    pub fn with_exposures(mut self, exposures: ExposureRange) -> Self {
        self.exposures = OnceLock::from(exposures);
        self.memo = OnceLock::new();
        self
    }

    /// The golden.
    ///
    /// ```
    /// use karat::Image;
    /// use karat::unstable::metric::Pair;
    ///
    /// let (golden, actual) = (Image::new(2, 1, vec![[1.0; 4]; 2]), Image::new(2, 1, vec![[0.5; 4]; 2]));
    /// let pair = Pair::new(&golden, &actual)?;
    /// assert_eq!(pair.golden().pixels()[0], [1.0; 4]);
    /// # Ok::<(), karat::unstable::metric::PairError>(())
    /// ```
    #[must_use]
    pub fn golden(&self) -> &Image {
        &self.golden
    }

    /// The frame.
    ///
    /// ```
    /// use karat::Image;
    /// use karat::unstable::metric::Pair;
    ///
    /// let (golden, actual) = (Image::new(2, 1, vec![[1.0; 4]; 2]), Image::new(2, 1, vec![[0.5; 4]; 2]));
    /// let pair = Pair::new(&golden, &actual)?;
    /// assert_eq!(pair.actual().pixels()[0], [0.5; 4]);
    /// # Ok::<(), karat::unstable::metric::PairError>(())
    /// ```
    #[must_use]
    pub fn actual(&self) -> &Image {
        &self.actual
    }

    /// Checks if all compared pixels are equal, bit for bit.
    ///
    /// ```
    /// use karat::Image;
    /// use karat::unstable::metric::Pair;
    ///
    /// let (golden, actual) = (Image::new(2, 1, vec![[1.0; 4]; 2]), Image::new(2, 1, vec![[0.5; 4]; 2]));
    /// let pair = Pair::new(&golden, &actual)?;
    /// assert!(!pair.is_identical());
    /// # Ok::<(), karat::unstable::metric::PairError>(())
    /// ```
    #[must_use]
    pub fn is_identical(&self) -> bool {
        self.different.is_empty()
    }

    /// Checks if the mask has this pixel, so that metrics compare it. Without a mask, metrics compare all pixels.
    ///
    /// ```
    /// use karat::Image;
    /// use karat::unstable::metric::Pair;
    ///
    /// let (golden, actual) = (Image::new(2, 1, vec![[1.0; 4]; 2]), Image::new(2, 1, vec![[0.5; 4]; 2]));
    /// let pair = Pair::new(&golden, &actual)?;
    /// assert!(pair.is_compared(1, 0)); // there is no mask
    /// # Ok::<(), karat::unstable::metric::PairError>(())
    /// ```
    #[must_use]
    pub fn is_compared(&self, x: u32, y: u32) -> bool {
        let index = y as usize * self.golden.width() as usize + x as usize;
        self.mask.as_ref().is_none_or(|flags| flags[index])
    }

    /// The number of compared pixels. It is 0 only if the images are empty.
    ///
    /// ```
    /// use karat::Image;
    /// use karat::unstable::metric::Pair;
    ///
    /// let (golden, actual) = (Image::new(2, 1, vec![[1.0; 4]; 2]), Image::new(2, 1, vec![[0.5; 4]; 2]));
    /// let pair = Pair::new(&golden, &actual)?;
    /// assert_eq!(pair.compared_count(), 2);
    /// # Ok::<(), karat::unstable::metric::PairError>(())
    /// ```
    #[must_use]
    pub fn compared_count(&self) -> usize {
        self.compared
    }

    /// The number of compared pixels in a rectangle.
    ///
    /// ```
    /// use karat::Image;
    /// use karat::metric::Rect;
    /// use karat::unstable::metric::Pair;
    ///
    /// let image = Image::new(2, 2, vec![[0.5; 4]; 4]);
    /// assert_eq!(Pair::new(&image, &image)?.compared_in(Rect::new(0, 0, 2, 1)), 2);
    /// # Ok::<(), karat::unstable::metric::PairError>(())
    /// ```
    #[must_use]
    pub fn compared_in(&self, rect: Rect) -> usize {
        let Rect { left, top, width, height } = rect;
        if self.mask.is_none() {
            return width as usize * height as usize;
        }
        let all = (top..top + height).flat_map(|y| (left..left + width).map(move |x| (x, y)));
        all.filter(|(x, y)| self.is_compared(*x, *y)).count()
    }

    /// Returns the result of `compute`, and caches it in the pair. The cache has room for a single result: if it has a
    /// result of another type, `compute` runs at each call.
    pub(super) fn memo<T: Any + Clone + Send + Sync>(&self, compute: impl Fn() -> T) -> T {
        let kept = self.memo.get_or_init(|| Arc::new(compute()));
        kept.downcast_ref::<T>().map_or_else(&compute, T::clone)
    }

    /// The exposures for HDR-FLIP.
    ///
    /// ```
    /// use karat::Image;
    /// use karat::unstable::metric::Pair;
    ///
    /// let (golden, actual) = (Image::new(2, 1, vec![[1.0; 4]; 2]), Image::new(2, 1, vec![[0.5; 4]; 2]));
    /// let pair = Pair::new(&golden, &actual)?;
    /// assert!(pair.exposures().count() >= 2);
    /// # Ok::<(), karat::unstable::metric::PairError>(())
    /// ```
    #[must_use]
    pub fn exposures(&self) -> ExposureRange {
        *self.exposures.get_or_init(|| ExposureRange::of_pixels(&self.compared_pixels()))
    }

    fn compared_pixels(&self) -> Cow<'_, [[f32; 4]]> {
        let pixels = self.golden.pixels();
        match &self.mask {
            None => pixels.into(),
            Some(flags) => {
                let compared = pixels.iter().zip(flags).filter(|(_, compared)| **compared);
                compared.map(|(pixel, _)| *pixel).collect::<Vec<_>>().into()
            }
        }
    }

    /// The largest relative difference of any channel: the difference divided by the golden's value, however small this
    /// value is.
    pub(super) fn largest_relative(&self) -> f32 {
        self.largest_relative
    }

    /// The logarithmic mean of the golden's luminance, computed once. See [`relative::key`].
    pub(super) fn key(&self) -> f32 {
        *self.key.get_or_init(|| relative::key(&self.compared_pixels()))
    }

    /// The strips in which the golden and the frame aren't identical. Adjacent strips are joined into one range. Each
    /// item consists of the index of the range's first pixel, the golden's pixels and the frame's pixels.
    pub(super) fn different(&self) -> impl Iterator<Item = (usize, &[[f32; 4]], &[[f32; 4]])> {
        let (golden, actual) = (self.golden.pixels(), self.actual.pixels());
        let strip = move |range: &Range<usize>| {
            (range.start, &golden[range.clone()], &actual[range.clone()])
        };
        self.different.iter().map(strip)
    }

    pub(super) fn place(&self, index: usize) -> (u32, u32) {
        let width = self.golden.width() as usize;
        #[expect(clippy::cast_possible_truncation, reason = "both are sides of an image")]
        let place = ((index % width) as u32, (index / width) as u32);
        place
    }
}

fn same_size(golden: &Image, actual: &Image) -> Result<(), PairError> {
    let size = |image: &Image| (image.width(), image.height());
    if size(golden) == size(actual) {
        return Ok(());
    }
    Err(PairError::Size { golden: size(golden), actual: size(actual) })
}

/// Adds 0 or NaN to each lane of `start`: NaN if a pixel's value in this lane isn't finite. The function has no
/// branches, and processes four channels at once.
fn vanishing(pixels: &[[f32; 4]], start: Vec4) -> Vec4 {
    pixels.iter().fold(start, |sum, pixel| sum + Vec4::from_array(*pixel) * 0.0)
}
