//! Points that are spread evenly over each of several ranges at once.

use std::ops::RangeInclusive;

use super::{Domain, Emptiness, Origin, Parts, Shrinkable, Source};

/// A Latin hypercube (McKay, Beckman and Conover 1979): the corners of a box of float ranges, then
/// `points` points. If a range is cut into `points` equal parts, each part has exactly one of them.
///
/// ```
/// use karat::{Domain, LatinHypercube};
///
/// let domain = LatinHypercube::new((0.0..=1.0, -1.0..=1.0), 1000);
/// assert_eq!(domain.size(), Some(4 + 1000));
/// ```
///
/// Use it for slow functions, where a few hundred points must leave no gap in any argument. It is a
/// finite domain, the same in every run: the seed of a check doesn't change it.
#[derive(Clone, Debug)]
pub struct LatinHypercube<R> {
    ranges: R,
    points: u32,
}

impl<R> LatinHypercube<R> {
    /// `points` points in the box of a tuple of two to six ranges of `f32`.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let package = Package::from_source("m", "fn sum(x: f32, y: f32) -> f32 { return x + y; }");
    /// let points = LatinHypercube::new((0.0..=1.0, 0.0..=1.0), 256);
    /// assert_eq!(package.function("sum").over(points).stays_within(0.0..=2.0).cases, 4 + 256); // corners, too
    /// ```
    pub fn new(ranges: R, points: u32) -> Self
    where
        Self: Domain,
    {
        Self { ranges, points }
    }
}

/// The place of point `index` in one dimension: a permutation of `0..count` by a Feistel network
/// over the next even number of bits; what it sends past the end is sent on until it is inside.
fn permuted(index: u32, count: u32, dimension: u64) -> u32 {
    let bits = (32 - (count.max(2) - 1).leading_zeros()).div_ceil(2);
    let mask = (1_u32 << bits) - 1;
    let mut place = u64::from(index);
    loop {
        let (mut left, mut right) = (place >> bits, place & u64::from(mask));
        for round in 0..4 {
            let mixed = Source::new(dimension << 8 | round, right).bits() & mask;
            (left, right) = (right, left ^ u64::from(mixed));
        }
        place = left << bits | right;
        if place < u64::from(count) {
            return u32::try_from(place).expect("below a 32-bit count");
        }
    }
}

fn point(range: &RangeInclusive<f32>, index: u64, corners: u64, points: u32, axis: u32) -> f32 {
    if index < corners {
        return if index >> axis & 1 == 0 { *range.start() } else { *range.end() };
    }
    let index = u32::try_from(index - corners).expect("below a 32-bit count");
    let part = permuted(index, points, u64::from(axis));
    // Where in its part a point lies is another stream than that of the permutation.
    let jitter = Source::new(!u64::from(axis), u64::from(index)).unit();
    let (low, high) = (f64::from(*range.start()), f64::from(*range.end()));
    let value = low + (high - low) * (f64::from(part) + jitter) / f64::from(points);
    #[expect(clippy::cast_possible_truncation, reason = "arguments are quantised to f32 first")]
    let value = value as f32;
    value.clamp(*range.start(), *range.end())
}

macro_rules! latin {
    ($(($count:literal $($range:ident $index:tt),+))*) => {$(
        impl Domain for LatinHypercube<($(latin!(@range $range),)+)> {
            type Value = ($(latin!(@value $range),)+);

            fn draw(&self, source: &mut Source) -> Option<Self::Value> {
                self.nth(source.below(self.size()?))
            }
            fn edges(&self) -> Vec<Self::Value> {
                (0..1 << $count).filter_map(|index| self.nth(index)).collect()
            }
            fn emptiness(&self) -> Option<Emptiness> {
                let none = (self.points == 0).then(|| Emptiness::of("design", "has no points"));
                none$(.or_else(|| Some(Domain::emptiness(&self.ranges.$index)?.in_part($index))))+
            }
            fn size(&self) -> Option<u64> {
                if Domain::is_empty(self) {
                    return Some(0);
                }
                Some((1 << $count) + u64::from(self.points))
            }
            fn nth(&self, index: u64) -> Option<Self::Value> {
                let corners = 1 << $count;
                let points = self.points;
                (index < self.size()?)
                    .then(|| ($(point(&self.ranges.$index, index, corners, points, $index),)+))
            }
            /// Of the whole box.
            fn admits(&self, value: &Self::Value) -> Option<bool> {
                self.ranges.admits(value)
            }
            fn shrink(&self, value: &Self::Value) -> Vec<Self::Value> {
                self.ranges.shrink(value)
            }
            /// Simpler points are any of the box.
            fn shrinkable(&self, origin: Origin<'_>) -> Option<Shrinkable<'_, Self::Value>> {
                let value = match origin {
                    Origin::Nth(index) => self.nth(index),
                    Origin::Edge(index) => self.nth(index as u64),
                    Origin::Draw(source) => self.draw(source),
                }?;
                Some(($(Shrinkable::of(&self.ranges.$index, value.$index),)+).whole())
            }
        }
    )*};
    (@range $range:ident) => { RangeInclusive<f32> };
    (@value $range:ident) => { f32 };
}

latin! {
    (2 A 0, B 1)
    (3 A 0, B 1, C 2)
    (4 A 0, B 1, C 2, D 3)
    (5 A 0, B 1, C 2, D 3, E 4)
    (6 A 0, B 1, C 2, D 3, E 4, F 5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_part_of_each_range_has_one_point() {
        for count in [1_u16, 2, 7, 64, 1000] {
            let domain = LatinHypercube::new((0.0..=1.0, -2.0..=2.0, 5.0..=6.0), count.into());
            let points: Vec<_> = (8..8 + u64::from(count)).filter_map(|i| domain.nth(i)).collect();
            let parts = |place: &dyn Fn(&(f32, f32, f32)) -> f64| {
                let mut parts: Vec<_> =
                    points.iter().map(|p| (place(p) * f64::from(count) + 1e-4).floor()).collect();
                parts.sort_by(f64::total_cmp);
                parts.dedup();
                parts.len()
            };
            let lengths = [
                parts(&|p| f64::from(p.0)),
                parts(&|p| (f64::from(p.1) + 2.0) / 4.0),
                parts(&|p| f64::from(p.2) - 5.0),
            ];
            // A point that rounds across the border of its part is counted with its neighbour.
            let least = usize::from(count) - usize::from(count / 100);
            assert!(lengths.iter().all(|length| *length >= least), "{count}: {lengths:?}");
        }
    }

    #[test]
    fn it_is_finite_has_its_corners_and_is_not_a_diagonal() {
        let domain = LatinHypercube::new((0.0..=1.0, 2.0..=3.0), 500);
        let all: Vec<_> = (0..504).filter_map(|index| domain.nth(index)).collect();
        assert_eq!(all[..4], [(0.0, 2.0), (1.0, 2.0), (0.0, 3.0), (1.0, 3.0)]);
        assert_eq!((all.len(), domain.nth(504)), (504, None));
        let mean: f32 = all[4..].iter().map(|(a, b)| (a - 0.5) * (b - 2.5)).sum::<f32>() / 500.0;
        assert!(mean.abs() < 0.015, "uncorrelated points have 0, the diagonal 1/12: {mean}");
        assert!(Domain::is_empty(&LatinHypercube::new((0.0..=1.0, 3.0..=2.0), 5)));
    }
}
