//! The exposures at which errors are largest.

use std::ops::RangeInclusive;

use super::mask::Rect;
use super::pair::Pair;

/// For each pixel of a part of a frame, the exposure at which its error is largest.
#[derive(Clone, Debug, PartialEq)]
pub struct ExposureMap {
    rect: Rect,
    /// In stops; NaN where there is no error.
    values: Vec<f32>,
}

impl ExposureMap {
    /// Row by row; NaN where there is no error.
    pub(super) fn new(rect: Rect, mut values: Vec<f32>, pair: &Pair<'_>) -> Self {
        for (index, value) in (0..).zip(&mut values) {
            let (x, y) = (rect.left + index % rect.width, rect.top + index / rect.width);
            if !pair.counts(x, y) {
                *value = f32::NAN;
            }
        }
        Self { rect, values }
    }

    /// The part of the frame that was looked at.
    #[must_use]
    pub fn rect(&self) -> Rect {
        self.rect
    }

    /// The exposure of a pixel of the frame, in stops; `None` if it has no error, wasn't looked at,
    /// or isn't compared.
    #[must_use]
    pub fn at(&self, x: u32, y: u32) -> Option<f32> {
        if !self.rect.contains(x, y) {
            return None;
        }
        let (column, row) = ((x - self.rect.left) as usize, (y - self.rect.top) as usize);
        Some(self.values[row * self.rect.width as usize + column]).filter(|stops| !stops.is_nan())
    }

    /// The darkest and the brightest of all pixels; `None` if none has an error.
    #[must_use]
    pub fn range(&self) -> Option<RangeInclusive<f32>> {
        let stops = self.values.iter().copied().filter(|stops| !stops.is_nan());
        let (start, stop) = stops.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), stops| {
            (low.min(stops), high.max(stops))
        });
        (start <= stop).then_some(start..=stop)
    }
}
