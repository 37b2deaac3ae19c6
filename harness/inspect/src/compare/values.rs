//! Measures the distance between two results, and shows them as text.

use crate::limits::VISIBLE;
use karat_core::tolerance::ulp_distance;
use karat_core::value::{Scalar, Shape, format_lane};

/// The number of components up to which Karat shows a whole result. Of a larger result, for example a buffer, Karat
/// shows only the changed components.
const WHOLE: usize = 16;

/// A result as text. The text has only the changed components if the result is long, or if `is_whole` is `false`.
pub(super) fn told(shape: &Shape, own: &[u32], changed: &[usize], is_whole: bool) -> String {
    let scalars = shape.lanes();
    if is_whole && scalars.len() <= WHOLE {
        return shape.format(own);
    }
    let names = shape.lane_names();
    let one = |lane: &usize| {
        let (name, value) = (&names[*lane], format_lane(scalars[*lane], own[*lane]));
        match name.trim_start_matches('.') {
            "" => value,
            name => format!("{name} = {value}"),
        }
    };
    let shown = changed.iter().take(4).map(one).collect::<Vec<_>>().join(", ");
    match changed.len().saturating_sub(4) {
        0 => shown,
        more => format!("{shown} and {more} more (of {} numbers)", scalars.len()),
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Distance {
    /// Two integers or booleans that differ.
    Other,
    /// The distance between two floats, in steps of an `f32`.
    Ulp(u64),
    /// A number and NaN.
    Nan,
}

impl Distance {
    pub(super) fn ulp(self) -> Option<u64> {
        if let Self::Ulp(steps) = self { Some(steps) } else { None }
    }

    /// Checks if this distance is close enough to the largest distance to serve as an example of the change. For
    /// floats, the number of steps must be at least the square root of the largest number of steps.
    pub(super) fn is_like(self, farthest: Self) -> bool {
        match (self, farthest) {
            (Self::Ulp(own), Self::Ulp(most)) => own >= most.isqrt(),
            (own, most) => own == most,
        }
    }
}

/// The distance between two lanes; `None` if they have the same bits, or if both are NaN.
pub(super) fn distance(scalar: Scalar, was: u32, is: u32) -> Option<Distance> {
    if was == is {
        return None;
    }
    if !scalar.is_float() {
        return Some(Distance::Other);
    }
    let (a, b) = (f32::from_bits(was), f32::from_bits(is));
    match (a.is_nan(), b.is_nan()) {
        (true, true) => None,
        (false, false) => Some(ulp_distance(a, b).map_or(Distance::Nan, Distance::Ulp)),
        _ => Some(Distance::Nan),
    }
}

/// The clarity with which a case shows a change. Karat shows the clearest case. Numbers that differ visibly are clearer
/// than NaN, because NaN is often the result of unrealistic inputs. A difference in the last digit is the least clear
/// one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Clarity {
    /// The difference is too small to see in an image.
    #[default]
    Slight,
    /// One of the values is NaN or infinite.
    NotFinite,
    /// The numbers differ visibly.
    Plain,
}

/// The clarity with which a lane shows a change; `None` if the lane didn't change.
pub(super) fn clarity(scalar: Scalar, was: u32, is: u32) -> Option<Clarity> {
    distance(scalar, was, is)?;
    if !scalar.is_float() {
        return Some(Clarity::Plain);
    }
    let (a, b) = (f32::from_bits(was), f32::from_bits(is));
    Some(match (b - a).abs() / a.abs().max(b.abs()) {
        _ if !(a.is_finite() && b.is_finite()) => Clarity::NotFinite,
        share if share >= VISIBLE => Clarity::Plain,
        _ => Clarity::Slight,
    })
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Largest {
    /// The largest distance in steps of an `f32`; `None` if a changed lane has no such distance.
    pub(super) ulp: Option<u64>,
    /// The largest change relative to the old value; `None` if a changed lane has no finite relative change, for
    /// example because the old value is 0.
    pub(super) relative: Option<f64>,
}

impl Default for Largest {
    fn default() -> Self {
        Self { ulp: Some(0), relative: Some(0.0) }
    }
}

impl Largest {
    pub(super) fn add(&mut self, scalar: Scalar, was: u32, is: u32) -> Option<Distance> {
        let far = distance(scalar, was, is)?;
        let (a, b) = (f64::from(f32::from_bits(was)), f64::from(f32::from_bits(is)));
        let share = Some((b - a).abs() / a.abs());
        let share = share.filter(|share| share.is_finite() && scalar.is_float());
        self.ulp = self.ulp.zip(far.ulp()).map(|(most, own)| most.max(own));
        self.relative = self.relative.zip(share).map(|(most, own)| most.max(own));
        Some(far)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two NaN with different bits are equal as floats, but differ as integers.
    #[test]
    fn the_distance_of_two_words_depends_on_their_type() {
        let far = |was: f32, is: f32| distance(Scalar::F32, was.to_bits(), is.to_bits());
        let nan = f32::from_bits(f32::NAN.to_bits() ^ 5);
        assert_eq!([far(1.0, 1.0), far(f32::NAN, nan)], [None; 2]);
        assert_eq!([far(1.0, nan), far(nan, 1.0)], [Some(Distance::Nan); 2]);
        assert_eq!(far(1.0, 1.0_f32.next_up()), Some(Distance::Ulp(1)));
        assert_eq!(distance(Scalar::U32, 0x7fc0_0000, 0x7fc0_0001), Some(Distance::Other));
        let like = |own: Distance, most: Distance| own.is_like(most);
        assert!(
            like(Distance::Ulp(10), Distance::Ulp(100))
                && !like(Distance::Ulp(9), Distance::Ulp(100))
        );
        assert!(like(Distance::Nan, Distance::Nan) && !like(Distance::Ulp(9), Distance::Nan));
    }

    #[test]
    fn visible_changes_come_first() {
        let of = |was: f32, is: f32| clarity(Scalar::F32, was.to_bits(), is.to_bits());
        assert_eq!([of(1.0, 1.0), of(f32::NAN, f32::NAN)], [None; 2]);
        assert_eq!([of(1.0, 1.002), of(0.0, 1e-9), of(1.0, -1.0)], [Some(Clarity::Plain); 3]);
        assert_eq!([of(1.0, 1.0001), of(0.0, -0.0)], [Some(Clarity::Slight); 2]);
        assert_eq!([of(1.0, f32::NAN), of(f32::INFINITY, 1.0)], [Some(Clarity::NotFinite); 2]);
        assert_eq!(clarity(Scalar::U32, 1, 2), Some(Clarity::Plain));
        assert!(Clarity::Slight < Clarity::NotFinite && Clarity::NotFinite < Clarity::Plain);
    }

    /// If many components changed, the text shows the first four and counts the others.
    #[test]
    fn the_first_components_that_changed_are_shown() {
        let of = |changed: usize, length: u32| {
            let element = Box::new(Shape::Scalar(Scalar::U32));
            let is: Vec<u32> =
                (0..length).map(|at| if (at as usize) < changed { at + 1 } else { 0 }).collect();
            let changed: Vec<usize> = (0..changed).collect();
            told(&Shape::Array { element, length }, &is, &changed, true)
        };
        assert_eq!(of(1, 17), "[0] = 1");
        assert_eq!(of(4, 17), "[0] = 1, [1] = 2, [2] = 3, [3] = 4");
        assert_eq!(of(5, 17), "[0] = 1, [1] = 2, [2] = 3, [3] = 4 and 1 more (of 17 numbers)");
        assert!(of(1, 16).contains("1, 0, 0"), "fewer are shown whole: {}", of(1, 16));
    }
}
