//! Grids: values at equal distances or at equal ratios.

use super::emptiness::{Emptiness, infinite};
use super::{Domain, SIMPLER, Source, shrink};

/// Values at equal distances or at equal ratios, including both ends.
///
/// ```
/// use karat::{Domain, Grid};
///
/// assert_eq!(Grid::linear(0.0..=1.0, 5).nth(1), Some(0.25));
/// assert_eq!(Grid::logarithmic(1.0..=100.0, 3).nth(1), Some(10.0));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Grid {
    first: f32,
    last: f32,
    count: u32,
    spacing: Spacing,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Spacing {
    Linear,
    Logarithmic,
}

impl Grid {
    /// `count` values in `range` at equal distances. A grid of one value contains only the range's start.
    ///
    /// ```
    /// use karat::{Domain, Grid};
    ///
    /// assert_eq!(Grid::linear(0.0..=1.0, 5).edges(), [0.0, 1.0]);
    /// assert_eq!(Grid::linear(0.0..=1.0, 5).nth(1), Some(0.25));
    /// ```
    #[must_use]
    pub fn linear(range: std::ops::RangeInclusive<f32>, count: u32) -> Self {
        Self { first: *range.start(), last: *range.end(), count, spacing: Spacing::Linear }
    }

    /// `count` values in `range` at equal ratios, for roughness, exposure or distance. The ends must have the same sign
    /// and mustn't be zero. Otherwise the grid is empty, and the check fails with an error.
    ///
    /// ```
    /// use karat::{Domain, Grid};
    ///
    /// let alpha = Grid::logarithmic(0.01..=1.0, 3);
    /// assert!((alpha.nth(1).expect("the middle") - 0.1).abs() < 1e-6);
    /// ```
    #[must_use]
    pub fn logarithmic(range: std::ops::RangeInclusive<f32>, count: u32) -> Self {
        Self { spacing: Spacing::Logarithmic, ..Self::linear(range, count) }
    }
}

impl Domain for Grid {
    type Value = f32;
    fn draw(&self, source: &mut Source) -> Option<f32> {
        self.nth(source.below(u64::from(self.count)))
    }
    fn edges(&self) -> Vec<f32> {
        if self.count > 1 { vec![self.first, self.last] } else { vec![self.first] }
    }
    fn emptiness(&self) -> Option<Emptiness> {
        let (first, last) = (self.first, self.last);
        let no_ratio = !(f64::from(first) * f64::from(last) > 0.0);
        if self.count == 0 {
            return Some(Emptiness::of("grid", "has no points"));
        }
        if let Some(fault) = infinite(first, last) {
            return Some(Emptiness::of("grid", &fault));
        }
        (self.spacing == Spacing::Logarithmic && no_ratio).then(|| {
            let fault = format!("is logarithmic, so its ends {first} and {last} must both be above 0 or both below 0");
            Emptiness::of("grid", &fault)
        })
    }
    fn size(&self) -> Option<u64> {
        Some(u64::from(self.count))
    }
    fn nth(&self, index: u64) -> Option<f32> {
        let index = u32::try_from(index).ok().filter(|index| *index < self.count)?;
        if index + 1 == self.count && index > 0 {
            return Some(self.last);
        }
        let t = f64::from(index) / f64::from((self.count - 1).max(1));
        let (first, last) = (f64::from(self.first), f64::from(self.last));
        #[expect(clippy::cast_possible_truncation, reason = "arguments are quantised to f32 first")]
        let value = match self.spacing {
            Spacing::Linear => first + (last - first) * t,
            Spacing::Logarithmic => first * (last / first).powf(t),
        } as f32;
        Some(value)
    }
    fn admits(&self, value: &f32) -> Option<bool> {
        let mut values = (0..u64::from(self.count)).filter_map(|index| self.nth(index));
        Some(values.any(|own| own.to_bits() == value.to_bits()))
    }
    fn shrink(&self, value: &f32) -> Vec<f32> {
        let own = shrink::float_complexity(*value);
        let values = (0..u64::from(self.count)).filter_map(|index| self.nth(index));
        let mut simpler: Vec<_> =
            values.filter(|value| shrink::float_complexity(*value) < own).collect();
        simpler.sort_by_cached_key(|value| shrink::float_complexity(*value));
        simpler.truncate(SIMPLER);
        simpler
    }
}
