//! Ties: relations between the components of a sampled tuple, such as two equal directions.
//!
//! Many functions fail if two arguments are related: two equal directions have no angle between them, and two opposite
//! directions have no half vector. If Karat sampled each component independently, two arguments would be related only
//! at the edges of their domains. So some samples replace one component by a value made from another component of the
//! same type: an equal value, the opposite value, or a value close to the equal or the opposite value. If the
//! component's own domain doesn't have this value, the component keeps its sampled value.

use std::any::{Any, TypeId};

use glam::{Vec2, Vec3, Vec4};

use super::direction::LENGTH;
use super::{Domain, Origin, Shrinkable, Source};

/// If a tuple has two components of the same type, one in `TIED` of its samples has a tie.
const TIED: u64 = 8;

/// One in `TIED_AGAIN` samples with a tie has a second tie, which ties a third component.
const TIED_AGAIN: u64 = 4;

/// A relation by which one component determines another.
#[derive(Clone, Debug)]
pub(super) struct Tie {
    /// The component that keeps its sampled value.
    pub(super) from: usize,
    /// The component that is replaced.
    pub(super) to: usize,
    relation: Relation,
    /// The random numbers from which the component `from` was sampled. A mapped domain can't check if it has a given
    /// value. So if the domain of `to` is mapped, Karat makes an equal value by sampling `to` from the same random
    /// numbers.
    start: Source,
    place: Source,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Relation {
    Equal,
    Opposite,
    Near,
    NearOpposite,
}

/// Decides if a sampled tuple has ties. Uses no random number if all components have different types. The function runs
/// for each sample, so it isn't generic: a generic one would be compiled with the tests, which are hardly optimised.
pub(super) fn are_drawn(types: &[TypeId], source: &mut Source) -> bool {
    let alike = (1..types.len()).any(|one| (0..one).any(|other| types[one] == types[other]));
    alike && source.below(TIED) == 0
}

/// Samples the ties of a tuple. `types` are the types of the components, and `starts` are the random numbers from which
/// the components were sampled. `apply` replaces a component as a tie demands, and returns `false` if the component's
/// domain doesn't have the new value. `draw` returns the applied ties.
pub(super) fn draw(
    types: &[TypeId],
    starts: &[Source],
    source: &mut Source,
    apply: &mut dyn FnMut(&Tie) -> bool,
) -> Vec<Tie> {
    let mut ties: Vec<Tie> = Vec::new();
    while let Some((from, to)) = like(types, &ties, source) {
        let relation = match source.below(8) {
            0..3 => Relation::Equal,
            3 => Relation::Opposite,
            4..7 => Relation::Near,
            _ => Relation::NearOpposite,
        };
        let (start, place) = (starts[from].clone(), source.clone());
        let tie = Tie { from, to, relation, start, place };
        if !apply(&tie) {
            break;
        }
        ties.push(tie);
        let more = pairs(types, &ties, usize::MAX).0 > 0;
        if !more || source.below(TIED_AGAIN) != 0 {
            break;
        }
    }
    ties
}

/// Chooses two random components of the same type, such that no tie uses the second component yet. `None` if there are
/// no such components.
fn like(types: &[TypeId], ties: &[Tie], source: &mut Source) -> Option<(usize, usize)> {
    let index = source.below(pairs(types, ties, usize::MAX).0 as u64);
    pairs(types, ties, usize::try_from(index).ok()?).1
}

/// Counts the pairs of components of the same type whose second component has no tie yet, and returns the pair with the
/// index `wanted`. The function runs for one sample in eight, so it is a plain loop, which is fast even with few
/// optimisations.
fn pairs(types: &[TypeId], ties: &[Tie], wanted: usize) -> (usize, Option<(usize, usize)>) {
    let (mut count, mut found) = (0, None);
    for from in 0..types.len() {
        for to in 0..types.len() {
            if from == to || types[from] != types[to] || is_tied(to, ties) {
                continue;
            }
            if count == wanted {
                found = Some((from, to));
            }
            count += 1;
        }
    }
    (count, found)
}

fn is_tied(to: usize, ties: &[Tie]) -> bool {
    ties.iter().any(|tie| tie.from == to || tie.to == to)
}

impl Tie {
    /// The value that the tie makes from `from`. `None` if the component's domain doesn't have this value.
    pub(super) fn value<D: Domain>(&self, domain: &D, from: &dyn Any) -> Option<D::Value> {
        let related = self.related::<D::Value>(from)?;
        match domain.admits(&related) {
            Some(true) => Some(related),
            None if self.relation == Relation::Equal => domain.draw(&mut self.start.clone()),
            Some(false) | None => None,
        }
    }

    /// The value that the tie makes from `from`, with its simpler values.
    pub(super) fn shrinkable<'a, D: Domain>(
        &self,
        domain: &'a D,
        from: &dyn Any,
    ) -> Option<Shrinkable<'a, D::Value>> {
        let again = || domain.shrinkable(Origin::Draw(&mut self.start.clone()));
        self.of_related(domain, from, again)
    }

    /// The value that the tie makes from the simplified value `from`. A mapped domain can't check if it has this value.
    /// So if the domain is mapped and the tie is an equality, the function returns the argument `simpler`: the value to
    /// which the component itself would be simplified.
    pub(super) fn simpler<'a, D: Domain>(
        &self,
        domain: &'a D,
        from: &dyn Any,
        simpler: Option<&Shrinkable<'a, D::Value>>,
    ) -> Option<Shrinkable<'a, D::Value>> {
        self.of_related(domain, from, || simpler.cloned())
    }

    fn of_related<'a, D: Domain>(
        &self,
        domain: &'a D,
        from: &dyn Any,
        unknown: impl FnOnce() -> Option<Shrinkable<'a, D::Value>>,
    ) -> Option<Shrinkable<'a, D::Value>> {
        let related = self.related::<D::Value>(from)?;
        match domain.admits(&related) {
            Some(true) => Some(Shrinkable::of(domain, related)),
            None if self.relation == Relation::Equal => unknown(),
            Some(false) | None => None,
        }
    }

    fn related<T: Clone + 'static>(&self, from: &dyn Any) -> Option<T> {
        let moved = match self.relation {
            Relation::Equal => return from.downcast_ref::<T>().cloned(),
            Relation::Opposite => opposite(from)?,
            Relation::Near => near(from, &mut self.place.clone())?,
            Relation::NearOpposite => near(&*opposite(from)?, &mut self.place.clone())?,
        };
        moved.downcast::<T>().ok().map(|moved| *moved)
    }
}

/// Applies a function to the floats of a value. `None` if the value isn't made of floats.
fn floats(value: &dyn Any, change: impl FnOnce(&mut [f32])) -> Option<Box<dyn Any>> {
    if let Some(value) = value.downcast_ref::<f32>() {
        let mut floats = [*value];
        change(&mut floats);
        Some(Box::new(floats[0]))
    } else if let Some(value) = value.downcast_ref::<Vec2>() {
        let mut floats = value.to_array();
        change(&mut floats);
        Some(Box::new(Vec2::from(floats)))
    } else if let Some(value) = value.downcast_ref::<Vec3>() {
        let mut floats = value.to_array();
        change(&mut floats);
        Some(Box::new(Vec3::from(floats)))
    } else {
        let mut floats = value.downcast_ref::<Vec4>()?.to_array();
        change(&mut floats);
        Some(Box::new(Vec4::from(floats)))
    }
}

fn opposite(value: &dyn Any) -> Option<Box<dyn Any>> {
    if let Some(value) = value.downcast_ref::<i32>() {
        return Some(Box::new(value.checked_neg()?));
    }
    // The opposite of 0 is 0, because no other sample is -0.
    floats(value, |floats| floats.iter_mut().for_each(|float| *float = 0.0 - *float))
}

/// A value near `value`. An integer changes by 1. Each float changes by at most a random share of the value's length.
/// The share is between 2^-24 and 1, and its logarithm is uniform. A unit vector stays a unit vector.
fn near(value: &dyn Any, source: &mut Source) -> Option<Box<dyn Any>> {
    let up = source.bits() & 1 == 0;
    if let Some(value) = value.downcast_ref::<i32>() {
        return Some(Box::new(value.checked_add(if up { 1 } else { -1 })?));
    }
    if let Some(value) = value.downcast_ref::<u32>() {
        return Some(Box::new(value.checked_add_signed(if up { 1 } else { -1 })?));
    }
    floats(value, |floats| {
        let length = length(floats);
        let size = if length > 0.0 { length } else { 1.0 };
        let distance = size * source.log_distance();
        let mut moved: Vec<f64> = floats
            .iter()
            .map(|float| f64::from(*float) + distance * (2.0 * source.unit() - 1.0))
            .collect();
        if floats.len() > 1 && (length - 1.0).abs() < LENGTH {
            let length = moved.iter().map(|float| float * float).sum::<f64>().sqrt();
            moved.iter_mut().for_each(|float| *float /= length);
        }
        for (float, moved) in floats.iter_mut().zip(moved) {
            #[expect(clippy::cast_possible_truncation, reason = "arguments are f32")]
            let nearest = moved as f32;
            *float = nearest;
        }
    })
}

fn length(floats: &[f32]) -> f64 {
    floats.iter().map(|float| f64::from(*float).powi(2)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::super::stream::tests::Cases;
    use super::super::{Hemisphere, Integers, UnitRgb, UnitVector};
    use super::*;

    const COUNT: u64 = 65_536;

    fn all<D: Domain>(domain: &D) -> Vec<D::Value> {
        let cases = Cases::new(domain, 5, COUNT, COUNT);
        (0..COUNT).map(|index| cases.get(index).expect("the domain draws")).collect()
    }

    fn off_axes(v: Vec3) -> bool {
        v.to_array().into_iter().all(|component| component.abs() > 0.01)
    }

    // Lesson 64
    #[test]
    fn two_drawn_directions_are_sometimes_equal_or_opposite() {
        let cases = all(&(UnitVector, UnitVector));
        let count = |holds: &dyn Fn(Vec3, Vec3) -> bool| {
            cases.iter().filter(|(v, l)| off_axes(*v) && holds(*v, *l)).count()
        };
        assert!(count(&|v, l| v == l) > 1000);
        assert!(count(&|v, l| v == -l) > 300);
        for distance in [1e-6, 1e-3, 0.1] {
            let close = |v: Vec3, l: Vec3| v != l && v.distance(l) < distance;
            assert!(count(&close) > 100, "{distance}");
            assert!(count(&|v, l| close(v, -l)) > 50, "{distance}");
        }
        // Seven of eight cases have no ties.
        assert!(count(&|v, l| v.distance(l) > 0.2 && v.distance(-l) > 0.2) > 40_000);
    }

    /// The test has three directions, one of them from a narrower domain. In some cases two directions are equal, and
    /// in other cases all three directions are equal.
    // Lesson 64
    #[test]
    fn three_drawn_directions_are_sometimes_equal() {
        let upper = || UnitVector.filter(|v| v.z > 0.0);
        let cases = all(&(UnitVector, upper(), Hemisphere));
        assert!(cases.iter().all(|(_, b, c)| b.z > 0.0 && c.z >= 0.0));
        let count = |holds: &dyn Fn(&(Vec3, Vec3, Vec3)) -> bool| {
            cases.iter().filter(|case| off_axes(case.0) && holds(case)).count()
        };
        assert!(count(&|(a, b, _)| a == b) > 300);
        assert!(count(&|(_, b, c)| b == c) > 300);
        assert!(count(&|(a, _, c)| *a == -*c) > 50);
        assert!(count(&|(a, b, c)| a == b && b == c) > 50);
    }

    // Lesson 64
    #[test]
    fn two_numbers_of_overlapping_ranges_are_sometimes_equal() {
        let cases = all(&(0.0..=1.0_f32, 0.5..=2.0_f32, Integers(-9..=9_i32), Integers(0..=9_i32)));
        let inside = |(a, b, _, d): &(f32, f32, i32, i32)| {
            (0.0..=1.0).contains(a) && (0.5..=2.0).contains(b) && (0..=9).contains(d)
        };
        assert!(cases.iter().all(inside));
        let plain = |x: f32| x > 0.51 && x < 0.99;
        assert!(cases.iter().filter(|(a, b, ..)| a == b && plain(*a)).count() > 100);
        let close = |a: f32, b: f32| a != b && (a - b).abs() < 1e-6 && plain(a);
        assert!(cases.iter().filter(|(a, b, ..)| close(*a, *b)).count() > 20);
        assert!(!cases.iter().any(|(a, ..)| a.to_bits() == (-0.0_f32).to_bits()));
        let colours = all(&(UnitRgb, UnitRgb));
        assert!(colours.iter().all(|(_, b)| UnitRgb.admits(b) == Some(true)));
        assert!(colours.iter().filter(|(a, b)| a == b && a.x != a.y).count() > 1000);
    }

    /// A mapped domain can't check if it has a given value. So Karat samples equal values from the same random numbers.
    // Lesson 64
    #[test]
    fn mapped_components_are_equal_in_some_cases() {
        let point = || (-9.0..=9.0_f32, 0.0..=1.0_f32).map(|(x, y)| Vec3::new(x, y, x * y));
        let cases = all(&(point(), point()));
        let inside = |p: &Vec3| p.x.abs() <= 9.0 && (0.0..=1.0).contains(&p.y) && p.z == p.x * p.y;
        assert!(cases.iter().all(|(a, b)| inside(a) && inside(b)));
        assert!(cases.iter().filter(|(a, b)| a == b && off_axes(*a)).count() > 1000);
    }

    #[test]
    fn unlike_components_are_drawn_as_they_would_be_alone() {
        let domain = (UnitVector, 0.0..=1.0_f32, Integers(0..=9_u32));
        for index in 0..1000 {
            let (source, alone) = (&mut Source::new(3, index), &mut Source::new(3, index));
            let (v, x, i) = domain.draw(source).expect("never rejects");
            assert_eq!(UnitVector.draw(alone), Some(v));
            assert_eq!((0.0..=1.0_f32).draw(alone), Some(x));
            assert_eq!(Integers(0..=9_u32).draw(alone), Some(i));
        }
    }
}
