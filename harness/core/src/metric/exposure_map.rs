//! Maps of the exposures at which the FLIP errors of pixels are largest.

use std::ops::RangeInclusive;

use super::mask::Rect;
use super::pair::Pair;

/// For each pixel in a rectangle of a frame, the exposure at which the pixel's FLIP error is largest.
///
/// ```
/// use karat::Image;
/// use karat::metric::Flip;
/// use karat::unstable::metric::Pair;
///
/// let grey = |light: f32| Image::new(32, 32, vec![[light, light, light, 1.0]; 1024]);
/// let (golden, actual) = (grey(0.5), grey(0.6));
/// let exposures = Flip::MEAN.exposures(&Pair::new(&golden, &actual)?)?;
/// assert!(exposures.at(16, 16).is_some(), "the pixel has an error");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct ExposureMap {
    rect: Rect,
    /// The exposures in stops. NaN for pixels without an error.
    values: Vec<f32>,
}

impl ExposureMap {
    /// Makes a map from the exposures of a rectangle, row by row. NaN marks a pixel without an error.
    pub(super) fn new(rect: Rect, mut values: Vec<f32>, pair: &Pair<'_>) -> Self {
        for (index, value) in (0..).zip(&mut values) {
            let (x, y) = (rect.left + index % rect.width, rect.top + index / rect.width);
            if !pair.is_compared(x, y) {
                *value = f32::NAN;
            }
        }
        Self { rect, values }
    }

    /// The rectangle of the frame for which FLIP computed errors.
    ///
    /// ```
    /// # use karat::Image;
    /// use karat::metric::{Flip, Rect};
    /// use karat::unstable::metric::Pair;
    ///
    /// # let grey = |light: f32| Image::new(32, 32, vec![[light, light, light, 1.0]; 1024]);
    /// # let (golden, actual) = (grey(0.5), grey(0.6));
    /// let exposures = Flip::MEAN.exposures(&Pair::new(&golden, &actual)?)?;
    /// assert_eq!(exposures.rect(), Rect::new(0, 0, 32, 32)); // all pixels differ
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn rect(&self) -> Rect {
        self.rect
    }

    /// The exposure of one pixel of the frame, in stops. `None` if the pixel has no error, is outside of the rectangle,
    /// or isn't compared.
    ///
    /// ```
    /// # use karat::Image;
    /// # use karat::metric::Flip;
    /// # use karat::unstable::metric::Pair;
    /// # let grey = |light: f32| Image::new(32, 32, vec![[light, light, light, 1.0]; 1024]);
    /// # let (golden, actual) = (grey(0.5), grey(0.6));
    /// let exposures = Flip::MEAN.exposures(&Pair::new(&golden, &actual)?)?;
    /// assert!(exposures.at(0, 0).is_some());
    /// assert_eq!(exposures.at(32, 0), None); // outside of the frame
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn at(&self, x: u32, y: u32) -> Option<f32> {
        if !self.rect.contains(x, y) {
            return None;
        }
        let (column, row) = ((x - self.rect.left) as usize, (y - self.rect.top) as usize);
        Some(self.values[row * self.rect.width as usize + column]).filter(|stops| !stops.is_nan())
    }

    /// The darkest and the brightest exposure in the map. `None` if no pixel has an error.
    ///
    /// ```
    /// # use karat::Image;
    /// # use karat::metric::Flip;
    /// # use karat::unstable::metric::Pair;
    /// # let grey = |light: f32| Image::new(32, 32, vec![[light, light, light, 1.0]; 1024]);
    /// # let (golden, actual) = (grey(0.5), grey(0.6));
    /// let exposures = Flip::MEAN.exposures(&Pair::new(&golden, &actual)?)?;
    /// let range = exposures.range().expect("the frames differ");
    /// assert!(exposures.at(16, 16).is_some_and(|stops| range.contains(&stops)));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn range(&self) -> Option<RangeInclusive<f32>> {
        let stops = self.values.iter().copied().filter(|stops| !stops.is_nan());
        let (start, stop) = stops.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), stops| {
            (low.min(stops), high.max(stops))
        });
        (start <= stop).then_some(start..=stop)
    }
}
