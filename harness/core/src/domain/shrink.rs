//! Simplifies a failing value within its domain.
//!
//! A domain lists its values that are simpler than a given value. A mapping can't be inverted, so Karat simplifies the
//! value before the mapping. To get this value, Karat samples the case again as a [`Shrinkable`], which keeps the
//! values before the mapping. A value is simple if it is easy to read in a report: 0, 1, few decimal digits, a small
//! exponent, no sign.

use std::rc::Rc;

use glam::{DVec3, Vec3};

use super::{Domain, Source};

/// The origin of a case in its domain. Cases come in the order of these variants.
///
/// ```
/// use karat::unstable::domain::{Origin, Source};
/// use karat::prelude::*;
///
/// let domain = 0.0..=4.0;
/// let edge = domain.shrinkable(Origin::Edge(0)).expect("a range has edges");
/// assert_eq!(Some(edge.value()), domain.edges().first());
/// let drawn = domain.shrinkable(Origin::Draw(&mut Source::new(1, 0))).expect("the range has values");
/// assert!(domain.contains(drawn.value()));
/// ```
#[derive(Debug)]
pub enum Origin<'s> {
    /// The value of [`Domain::nth`] with this index.
    Nth(u64),
    /// The element of [`Domain::edges`] with this index.
    Edge(usize),
    /// A value sampled by [`Domain::draw`].
    Draw(&'s mut Source),
}

/// A value of a domain, with the list of its simpler values.
///
/// ```
/// use karat::unstable::domain::Shrinkable;
///
/// let value = Shrinkable::of(&(0.0..=4.0), 2.7182817);
/// let simpler: Vec<f32> = value.simpler().iter().map(|one| *one.value()).collect();
/// assert_eq!(simpler[0], 0.0);
/// ```
pub struct Shrinkable<'a, T> {
    value: T,
    simpler: Rc<dyn Fn() -> Vec<Self> + 'a>,
}

impl<T: Clone> Clone for Shrinkable<'_, T> {
    fn clone(&self) -> Self {
        Self { value: self.value.clone(), simpler: Rc::clone(&self.simpler) }
    }
}

impl<T: std::fmt::Debug> std::fmt::Debug for Shrinkable<'_, T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Shrinkable").field(&self.value).finish()
    }
}

impl<'a, T: Clone + 'a> Shrinkable<'a, T> {
    /// Makes a value. `simpler` returns the list of its simpler values, the simplest first.
    ///
    /// ```
    /// use karat::unstable::domain::Shrinkable;
    ///
    /// let two = Shrinkable::new(2, || vec![Shrinkable::new(1, Vec::new)]);
    /// assert_eq!(*two.simpler()[0].value(), 1);
    /// ```
    pub fn new(value: T, simpler: impl Fn() -> Vec<Self> + 'a) -> Self {
        Self { value, simpler: Rc::new(simpler) }
    }

    /// A value that only [`Domain::shrink`] simplifies.
    ///
    /// ```
    /// use karat::unstable::domain::Shrinkable;
    ///
    /// assert_eq!(*Shrinkable::of(&(0.0..=4.0), 2.5).value(), 2.5);
    /// ```
    pub fn of<D: Domain<Value = T> + ?Sized>(domain: &'a D, value: T) -> Self {
        Self::new(value.clone(), move || {
            domain.shrink(&value).into_iter().map(|value| Self::of(domain, value)).collect()
        })
    }

    /// The value itself.
    ///
    /// ```
    /// use karat::unstable::domain::Shrinkable;
    ///
    /// assert_eq!(*Shrinkable::new(2, Vec::new).value(), 2);
    /// ```
    pub fn value(&self) -> &T {
        &self.value
    }

    /// The simpler values, the simplest first.
    ///
    /// ```
    /// use karat::unstable::domain::Shrinkable;
    ///
    /// assert!(Shrinkable::new(2, Vec::new).simpler().is_empty());
    /// ```
    #[must_use]
    pub fn simpler(&self) -> Vec<Self> {
        (self.simpler)()
    }

    /// Applies `map` to the value and to its simpler values.
    ///
    /// ```
    /// use karat::unstable::domain::Shrinkable;
    ///
    /// let double = |x: i32| 2 * x;
    /// let two = Shrinkable::new(2, || vec![Shrinkable::new(1, Vec::new)]).map(&double);
    /// assert_eq!((*two.value(), *two.simpler()[0].value()), (4, 2));
    /// ```
    pub fn map<U: Clone + 'a>(self, map: &'a impl Fn(T) -> U) -> Shrinkable<'a, U> {
        Shrinkable::new(map(self.value.clone()), move || {
            self.simpler().into_iter().map(|simpler| simpler.map(map)).collect()
        })
    }

    /// Removes the simpler values that `keep` rejects.
    ///
    /// ```
    /// use karat::unstable::domain::Shrinkable;
    ///
    /// let even = |x: &i32| x % 2 == 0;
    /// let two = Shrinkable::new(2, || vec![Shrinkable::new(1, Vec::new)]).filter(&even);
    /// assert!(two.simpler().is_empty());
    /// ```
    #[must_use]
    pub fn filter(self, keep: &'a impl Fn(&T) -> bool) -> Self {
        Self::new(self.value.clone(), move || {
            let simpler = self.simpler().into_iter().filter(|simpler| keep(&simpler.value));
            simpler.map(|simpler| simpler.filter(keep)).collect()
        })
    }
}

/// A measure of how complicated a float is to read. The decimal digits and the exponent count most, then the sign, the
/// significant bits, and the size.
pub(super) fn float_complexity(value: f32) -> u64 {
    let negative = u64::from(value.is_sign_negative());
    if value == 0.0 {
        return negative;
    }
    if !value.is_finite() {
        return (u64::from(value.is_nan()) + 1) << 50 | negative;
    }
    let (digits, exponent) = decimal(value, None);
    let digits = digits.trim_end_matches('0').len() as u64;
    let bits = 23 - (value.to_bits() | 0x0080_0000).trailing_zeros().min(23);
    let size = u64::from(value.abs().to_bits());
    let weight = 4 * digits + u64::from(exponent.unsigned_abs());
    weight << 40 | negative << 36 | u64::from(bits) << 31 | size
}

/// The decimal digits of a finite value, and the exponent of the first digit. `places` is the number of digits to which
/// the value is rounded. If `places` is `None`, the result has the fewest digits from which the same bits can be read
/// again.
fn decimal(value: f32, places: Option<usize>) -> (String, i32) {
    let text = match places {
        Some(places) => format!("{:.*e}", places - 1, value.abs()),
        None => format!("{:e}", value.abs()),
    };
    let (digits, exponent) = text.split_once('e').expect("`e` formats with an exponent");
    let exponent = exponent.parse().expect("the exponent is a number");
    (digits.replace('.', ""), exponent)
}

/// Simpler floats, the simplest first: floats that are easy to read, and `value` with fewer digits.
pub(super) fn floats(value: f32, known: &[f32], admits: impl Fn(f32) -> bool) -> Vec<f32> {
    let mut found = vec![0.0, 1.0, -1.0];
    found.extend(known);
    let parsed = |digits: u64, exponent: i32| -> f32 {
        format!("{digits}e{exponent}").parse().expect("a decimal number")
    };
    for exponent in -6..=3 {
        found.extend((1..=9).map(|digit| parsed(digit, exponent)));
    }
    if value.is_finite() && value != 0.0 {
        let (_, exponent) = decimal(value, None);
        for exponent in exponent.min(-6)..=exponent.max(3) {
            found.extend([1, 2, 5].map(|digit| parsed(digit, exponent)));
        }
        // `value` with fewer digits: the nearest decimal number, and its neighbours, one unit of the last digit away.
        for places in 1..=8_usize {
            let (digits, exponent) = decimal(value, Some(places));
            let digits: u64 = digits.parse().expect("at most eight digits");
            let last = exponent + 1 - i32::try_from(places).expect("at most eight");
            found
                .extend((digits.saturating_sub(1)..=digits + 1).map(|digits| parsed(digits, last)));
        }
    }
    for index in 0..found.len() {
        found.push(-found[index]);
    }
    let own = float_complexity(value);
    found.retain(|candidate| admits(*candidate) && float_complexity(*candidate) < own);
    found.sort_by_cached_key(|candidate| float_complexity(*candidate));
    found.dedup_by_key(|candidate| candidate.to_bits());
    found
}

/// Simpler integers from `low` to `high`: first the integer closest to zero, then the integer halfway from there to
/// `value`, and so on.
pub(super) fn integers(value: i64, low: i64, high: i64) -> Vec<i64> {
    let goal = if low > high { return Vec::new() } else { 0_i64.clamp(low, high) };
    let distance = value - goal;
    let mut found = vec![goal, goal + distance.signum()];
    found.extend((1..33).map(|shift| value - distance / (1_i64 << shift)));
    let complexity = |value: i64| (value.unsigned_abs(), value < 0);
    if (low..=high).contains(&-value) {
        found.push(-value);
    }
    found.push(value - distance.signum());
    found.retain(|candidate| complexity(*candidate) < complexity(value));
    found.sort_by_cached_key(|candidate| complexity(*candidate));
    found.dedup();
    found
}

fn vector_complexity(value: Vec3) -> u64 {
    value.to_array().into_iter().map(float_complexity).sum()
}

fn sorted(mut found: Vec<Vec3>, value: Vec3, admits: impl Fn(Vec3) -> bool) -> Vec<Vec3> {
    let own = vector_complexity(value);
    found.retain(|candidate| admits(*candidate) && vector_complexity(*candidate) < own);
    found.sort_by_cached_key(|candidate| vector_complexity(*candidate)); // stable: of equal vectors, +Z comes first
    found.dedup_by_key(|candidate| candidate.to_array().map(f32::to_bits));
    found
}

/// Simpler unit vectors: axes, vectors like (0.6, 0.8), diagonals, and vectors near `value` that lie in a coordinate
/// plane or have a component with few decimal digits.
pub(super) fn directions(value: Vec3, admits: impl Fn(Vec3) -> bool) -> Vec<Vec3> {
    let mut found = vec![Vec3::Z, Vec3::X, Vec3::Y, Vec3::NEG_Z, Vec3::NEG_X, Vec3::NEG_Y];
    let signs = [1.0, -1.0];
    // Pairs of decimals that form a vector of length 1.
    for (a, b) in [(0.6, 0.8), (0.8, 0.6), (0.28, 0.96), (0.96, 0.28)] {
        for (a, b) in signs.iter().flat_map(|s| signs.map(|t| (s * a, t * b))) {
            found.extend([Vec3::new(a, 0.0, b), Vec3::new(0.0, a, b), Vec3::new(a, b, 0.0)]);
        }
    }
    let steps = [0.0, 1.0, -1.0];
    for x in steps {
        for y in steps {
            found.extend(steps.map(|z| DVec3::new(x, y, z).normalize_or_zero().as_vec3()));
        }
    }
    let wide = value.as_dvec3();
    for axis in 0..3 {
        let mut flat = wide;
        flat[axis] = 0.0;
        found.push(flat.normalize_or_zero().as_vec3());
        // Vectors with a short decimal on this axis and `value`'s azimuth, and vectors in a coordinate plane.
        let (left, right) = ((axis + 1) % 3, (axis + 2) % 3);
        let rest = (wide[left] * wide[left] + wide[right] * wide[right]).sqrt();
        for short in floats(value[axis], &[], |short| short.abs() <= 1.0) {
            let short = f64::from(short);
            let sine = (1.0 - short * short).max(0.0).sqrt();
            let mut place = |a: f64, b: f64| {
                let mut candidate = DVec3::ZERO;
                (candidate[axis], candidate[left], candidate[right]) = (short, a, b);
                found.push(candidate.as_vec3());
            };
            for sine in [sine, -sine] {
                place(sine, 0.0);
                place(0.0, sine);
            }
            if rest > 0.0 {
                place(sine * wide[left] / rest, sine * wide[right] / rest);
            }
        }
    }
    sorted(found, value, admits)
}

/// Simpler vectors in the unit cube: black, greys, and `value` with one simplified component.
pub(super) fn colours(value: Vec3) -> Vec<Vec3> {
    let mut found = vec![Vec3::ZERO, Vec3::ONE, Vec3::X, Vec3::Y, Vec3::Z];
    let inside = |component: f32| (0.0..=1.0).contains(&component);
    for component in value.to_array() {
        found.push(Vec3::splat(component));
        found.extend(floats(component, &[], inside).into_iter().map(Vec3::splat));
    }
    for index in 0..3 {
        for component in floats(value[index], &[], inside) {
            let mut candidate = value;
            candidate[index] = component;
            found.push(candidate);
        }
    }
    sorted(found, value, |candidate| candidate.to_array().into_iter().all(inside))
}

#[cfg(test)]
mod tests {
    use super::super::stream::tests::Cases;
    use super::super::{Hemisphere, Integers, Just, OneOf, UnitRgb, UnitVector};
    use super::*;

    /// Replaces a value by its first simpler value that fails, until none fails, as a check does.
    fn simplest<D: Domain>(domain: &D, index: u64, fails: impl Fn(&D::Value) -> bool) -> D::Value {
        let cases = Cases::new(domain, 7, 65_536, 65_536);
        let mut at = cases.shrinkable(index).expect("the domain draws");
        for _ in 0..200 {
            match at.simpler().into_iter().find(|simpler| fails(simpler.value())) {
                Some(simpler) => at = simpler,
                None => return at.value().clone(),
            }
        }
        panic!("the simplification doesn't end");
    }

    fn from_any<D: Domain>(domain: &D, fails: impl Fn(&D::Value) -> bool) -> D::Value {
        let cases = Cases::new(domain, 7, 65_536, 65_536);
        let last = cases.count();
        let failing = (0..last).rev().find(|index| cases.get(*index).is_some_and(|v| fails(&v)));
        simplest(domain, failing.expect("a case fails"), fails)
    }

    #[test]
    fn floats_become_short_decimals() {
        assert_eq!(from_any(&(0.0..=1.0_f32), |_| true), 0.0);
        assert_eq!(from_any(&(0.5..=3.0_f32), |_| true), 1.0);
        assert_eq!(from_any(&(0.0..=1.0_f32), |x| *x > 0.0), 1.0);
        assert_eq!(from_any(&(0.0..=1.0_f32), |x| *x > 0.3 && *x < 0.9), 0.5);
        assert_eq!(from_any(&(0.0..=1.0_f32), |x| *x > 0.731 && *x < 0.7329), 0.732);
        assert_eq!(from_any(&(-1e6..=1e6_f32), |x| *x > 123_400.0), 200_000.0);
        assert_eq!(from_any(&(-2.0..=-1.5_f32), |_| true), -2.0);
        assert_eq!(from_any(&(1.234_56..=1.3_f32), |_| true), 1.3);
    }

    #[test]
    fn floats_keep_to_their_range() {
        for index in 0..100 {
            let range = 0.001_23..=0.7_f32;
            let mut at = range.draw(&mut Source::new(3, index)).expect("draws");
            for _ in 0..20 {
                let simpler = range.shrink(&at);
                assert!(simpler.iter().all(|v| range.contains(v)), "{at}: {simpler:?}");
                let Some(last) = simpler.last() else { break };
                at = *last;
            }
        }
    }

    #[test]
    fn integers_become_small() {
        assert_eq!(from_any(&Integers(-1000..=1000_i32), |n| *n > 617), 618);
        assert_eq!(from_any(&Integers(-1000..=1000_i32), |n| n.abs() > 617), 618);
        assert_eq!(from_any(&Integers(5..=u32::MAX), |_| true), 5);
        assert_eq!(from_any(&Integers(i32::MIN..=i32::MAX), |n| *n < -70_000), -70_001);
        assert!(!from_any(&OneOf(vec![true, false]), |_| true));
    }

    #[test]
    fn directions_and_colours_become_plain() {
        assert_eq!(from_any(&UnitVector, |_| true), Vec3::Z);
        assert_eq!(from_any(&UnitVector, |v| v.x < -0.9), Vec3::NEG_X);
        assert_eq!(from_any(&Hemisphere, |v| v.z < 0.9 && v.z > 0.7), Vec3::new(0.6, 0.0, 0.8));
        let low = from_any(&Hemisphere, |v| v.z > 0.05 && v.z < 0.13);
        assert_eq!(low, Vec3::new(0.997_547, 0.0, 0.07));
        for index in 0..50 {
            let v = Hemisphere.draw(&mut Source::new(5, index)).expect("draws");
            for simpler in Hemisphere.shrink(&v) {
                assert_eq!(Hemisphere.admits(&simpler), Some(true), "{v}: {simpler}");
            }
        }
        assert_eq!(from_any(&UnitRgb, |c| c.y > 0.5), Vec3::Y);
        assert_eq!(from_any(&UnitRgb, |c| c.y > 0.5 && c.y < 0.9), Vec3::new(0.0, 0.6, 0.0));
    }

    #[test]
    fn tuples_filters_and_maps_shrink_their_components() {
        let domain = (UnitVector, 0.0..=1.0_f32, Just(7_u32));
        assert_eq!(from_any(&domain, |(_, x, _)| *x > 0.45), (Vec3::Z, 1.0, 7));
        let domain = (0.0..=1.0_f32, 0.0..=1.0_f32).filter(|(a, b)| a < b);
        let (a, b) = from_any(&domain, |(a, _)| *a > 0.2);
        assert!(a < b && (a, b) == (0.5, 1.0), "{a}, {b}");
        let domain = (0.0..=1.0_f32, Integers(0..=9_u32)).map(|(x, n)| [x * 8.0, n as f32]);
        assert_eq!(from_any(&domain, |[x, n]| *x > 3.0 && *n > 2.0), [8.0, 3.0]);
        let filtered = (-4.0..=4.0_f32).filter(|x| x.abs() > 0.3).map(|x| x * x);
        assert_eq!(from_any(&filtered, |_| true), 1.0);
    }

    /// A case has the same value if it is sampled again.
    #[test]
    fn a_shrinkable_case_has_the_value_of_the_plain_case() {
        let domain = (UnitVector, 0.0..=1.0_f32)
            .filter(|(n, x)| n.z > *x)
            .map(|(n, x)| (n * x, OneOf(vec![1, 2]).nth(0)));
        let cases = Cases::new(&domain, 11, 3000, 3000);
        for index in 0..3000 {
            let shrinkable = cases.shrinkable(index).expect("the filter keeps enough");
            assert_eq!(Some(*shrinkable.value()), cases.get(index), "{index}");
        }
        let finite = (OneOf(vec![3.0, 1.0_f32]), Integers(-2..=2_i32));
        let cases = Cases::new(&finite, 11, 3000, 3000);
        for index in 0..10 {
            let shrinkable = cases.shrinkable(index).expect("ten values");
            assert_eq!(Some(*shrinkable.value()), cases.get(index));
        }
    }
}
