//! Closed ranges of numbers.

use std::ops::RangeInclusive;

use super::source::{log_distance, unit};
use super::{Domain, Emptiness, Source, infinite, shrink};

/// Values at which shaders often behave differently. A range that contains such a value also samples it.
const LANDMARKS: [f32; 5] = [0.0, 1.0, -1.0, 0.5, f32::MIN_POSITIVE];

/// Selects one of two numbers without a branch: `a` if `first` is `true`.
#[inline(always)]
fn either(first: bool, a: f64, b: f64) -> f64 {
    let mask = 0_u64.wrapping_sub(u64::from(first));
    f64::from_bits((a.to_bits() & mask) | (b.to_bits() & !mask))
}

impl Domain for RangeInclusive<f32> {
    type Value = f32;

    /// Of 16 samples, 1 is an end, 3 are at a logarithmic distance from an end, 1 is a landmark such as 0 or 1, and 11
    /// are uniform. If the range contains numbers below and above 0, only 7 samples are uniform, and 4 are at a
    /// logarithmic distance from 0. Two of these 4 samples use the size of the range as the scale. The other two use
    /// the scale 1, because shaders often add a small number to a number of about 1.
    fn draw(&self, source: &mut Source) -> Option<f32> {
        let (start, end) = (*self.start(), *self.end());
        let (low, high) = (f64::from(start), f64::from(end));
        if !self.contains(&start) {
            return None;
        }
        let choice = source.bits();
        let from_high = choice & 16 != 0;
        match choice & 15 {
            0 => return Some(if from_high { end } else { start }),
            4 => {
                let pick = LANDMARKS[(choice >> 5) as usize % LANDMARKS.len()];
                return Some(if self.contains(&pick) { pick } else { start });
            }
            _ => {}
        }
        // The function computes both values and selects one without a branch. The choice is random, so branch
        // prediction would fail in a third of the cases. This code runs for each number of each case.
        let bits = source.bits();
        let crowded = choice & 15 < 4;
        let near_zero = (5..9).contains(&(choice & 15)) && low < 0.0 && high > 0.0;
        let side = either(from_high, high, low);
        let side = either(choice & 32 != 0, side, side.clamp(-1.0, 1.0));
        let down = crowded && from_high;
        let (from, width) = (either(down, high, low), either(down, low - high, high - low));
        let (from, width) = (either(near_zero, 0.0, from), either(near_zero, side, width));
        let value = from + width * either(crowded || near_zero, log_distance(bits), unit(bits));
        #[expect(clippy::cast_possible_truncation, reason = "arguments are quantised to f32 first")]
        let value = value as f32;
        Some(value.clamp(start, end))
    }

    fn emptiness(&self) -> Option<Emptiness> {
        let (low, high) = (*self.start(), *self.end());
        let reversed = || (low > high).then(|| format!("starts at {low}, above its end {high}"));
        infinite(low, high).or_else(reversed).map(|fault| Emptiness::of("range", &fault))
    }

    fn edges(&self) -> Vec<f32> {
        let (low, high) = (*self.start(), *self.end());
        let mut edges = vec![low, high];
        let inner = [low.next_up(), high.next_down()].into_iter().chain(LANDMARKS);
        for value in inner {
            if self.contains(&value) && !edges.contains(&value) {
                edges.push(value);
            }
        }
        edges.retain(|value| self.contains(value));
        edges
    }

    fn admits(&self, value: &f32) -> Option<bool> {
        Some(self.contains(value))
    }

    fn ends(&self) -> Option<(f32, f32)> {
        (self.start() <= self.end()).then(|| (*self.start(), *self.end()))
    }

    fn shrink(&self, value: &f32) -> Vec<f32> {
        shrink::floats(*value, &[*self.start(), *self.end()], |value| self.contains(&value))
    }
}

/// A closed range of `i32` or `u32`: `Integers(0..=7_u32)`.
///
/// Rust's ranges of integers are iterators. If they were domains, too, they would have two methods `map` and two
/// methods `filter`.
///
/// ```
/// use karat::{Domain, Integers};
///
/// assert_eq!(Integers(-1..=1).size(), Some(3)); // a check tries all three
/// ```
#[derive(Clone, Debug)]
pub struct Integers<T>(pub RangeInclusive<T>);

macro_rules! integer {
    ($($integer:ty),*) => {$(
        impl Domain for Integers<$integer> {
            type Value = $integer;

            /// One sample in 8 is an end. The other samples are uniform.
            fn draw(&self, source: &mut Source) -> Option<$integer> {
                let (low, high) = (*self.0.start(), *self.0.end());
                let count = u64::try_from(i64::from(high) - i64::from(low) + 1).ok()?;
                Some(match source.below(16) {
                    0 => low,
                    1 => high,
                    _ => {
                        let offset = i64::try_from(source.below(count)).ok()?;
                        <$integer>::try_from(i64::from(low) + offset).ok()?
                    }
                })
            }

            fn edges(&self) -> Vec<$integer> {
                let mut edges = vec![*self.0.start(), *self.0.end()];
                for value in [0, 1] {
                    if self.0.contains(&value) && !edges.contains(&value) {
                        edges.push(value);
                    }
                }
                edges.dedup();
                edges.retain(|value| self.0.contains(value));
                edges
            }

            fn emptiness(&self) -> Option<Emptiness> {
                let (low, high) = (self.0.start(), self.0.end());
                let fault = || format!("starts at {low}, above its end {high}");
                (low > high).then(|| Emptiness::of("range", &fault()))
            }

            fn size(&self) -> Option<u64> {
                let count = i64::from(*self.0.end()) - i64::from(*self.0.start()) + 1;
                Some(u64::try_from(count).unwrap_or(0)) // the count of an empty range is negative
            }

            fn nth(&self, index: u64) -> Option<$integer> {
                let value = i64::from(*self.0.start()).checked_add(i64::try_from(index).ok()?)?;
                <$integer>::try_from(value).ok().filter(|value| self.0.contains(value))
            }

            fn admits(&self, value: &$integer) -> Option<bool> {
                Some(self.0.contains(value))
            }

            fn ends(&self) -> Option<($integer, $integer)> {
                (self.0.start() <= self.0.end()).then(|| (*self.0.start(), *self.0.end()))
            }

            fn shrink(&self, value: &$integer) -> Vec<$integer> {
                let (low, high) = (i64::from(*self.0.start()), i64::from(*self.0.end()));
                let simpler = shrink::integers(i64::from(*value), low, high).into_iter();
                simpler.filter_map(|value| <$integer>::try_from(value).ok()).collect()
            }
        }
    )*};
}

integer!(i32, u32);

#[cfg(test)]
mod tests {
    use super::*;

    /// Computes the same value as [`draw`](Domain::draw), with branches.
    fn plainly(range: &RangeInclusive<f32>, source: &mut Source) -> f32 {
        let (low, high) = (f64::from(*range.start()), f64::from(*range.end()));
        let choice = source.bits();
        let from_high = choice & 16 != 0;
        let value = match choice & 15 {
            0 => {
                if from_high {
                    high
                } else {
                    low
                }
            }
            1..=3 => {
                let distance = (high - low) * source.log_distance();
                if from_high { high - distance } else { low + distance }
            }
            4 => {
                let pick = LANDMARKS[(choice >> 5) as usize % LANDMARKS.len()];
                f64::from(if range.contains(&pick) { pick } else { *range.start() })
            }
            5..=8 if low < 0.0 && high > 0.0 => {
                let end = if from_high { high } else { low };
                let end = if choice & 32 == 0 { end.clamp(-1.0, 1.0) } else { end };
                end * source.log_distance()
            }
            _ => low + (high - low) * source.unit(),
        };
        (value as f32).clamp(*range.start(), *range.end())
    }

    #[test]
    fn draws_of_a_range_equal_those_of_the_reference_code() {
        for range in [0.0..=1.0, -1.0..=1.0, -0.0..=0.0, 3.0..=3.5, -1e30..=1e-3, 1e-45..=2e-38] {
            for case in 0..20_000 {
                let (mut one, mut other) = (Source::new(5, case), Source::new(5, case));
                let drawn = range.draw(&mut one).expect("it has values");
                let plain = plainly(&range, &mut other);
                assert_eq!(drawn.to_bits(), plain.to_bits(), "{range:?}, case {case}");
                assert_eq!(one.bits(), other.bits(), "{range:?}, case {case}");
            }
        }
    }

    /// Even in a wide range, some samples are as small as 2^-24. Smaller numbers matter less: 1 plus such a number is
    /// 1.
    #[test]
    fn a_zero_inside_is_drawn_on_every_scale() {
        let within = |range: &RangeInclusive<f32>, least: f32, most: f32| {
            let draw = |case| range.draw(&mut Source::new(7, case)).expect("it has values");
            let found = |x: &f32| (least..most).contains(&x.abs());
            let near: Vec<f32> = (0..8000).map(draw).filter(found).collect();
            assert!(near.iter().all(|x| range.contains(x)));
            let below = near.iter().filter(|x| **x < 0.0).count();
            [below, near.len() - below]
        };
        for range in [-1.0..=1.0, -1e6..=1e6, -0.25..=3.0, -1e30..=0.5] {
            for (least, most) in [(1e-7, 1e-6), (1e-5, 1e-4), (1e-3, 1e-2)] {
                let sides = within(&range, least, most);
                assert!(sides.iter().all(|side| *side > 20), "{range:?}, {least:e}: {sides:?}");
            }
        }
        let sides = within(&(-1e6..=1e6), 1.0, 1e4);
        assert!(sides.iter().all(|side| *side > 100), "also near the ends: {sides:?}");
        // A range that begins at 0 has as many samples near 0 as near its other end.
        assert_eq!(within(&(-0.5..=-0.25), 0.0, 0.2), [0, 0]);
    }

    #[test]
    fn a_range_without_values_draws_none() {
        for range in [1.0..=0.0, f32::NAN..=1.0, 0.0..=f32::NAN] {
            assert_eq!(range.draw(&mut Source::new(1, 2)), None, "{range:?}");
        }
    }
}
