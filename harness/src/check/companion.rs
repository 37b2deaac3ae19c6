//! Cases of verbs that need more than the function's arguments: another value of one, a rotation.
//!
//! A companion is drawn after the arguments, from the same stream, and travels as words behind
//! theirs. So it is simplified with them, remembered and replayed.

use crate::domain::{Domain, Origin, Parts, Shrinkable, Source};
use crate::value::{Arguments, Shape};

/// Tells the streams of companions of edges and of enumerated values from those of draws.
const LISTED: u64 = 0x6c69_7374_6564;

/// Draws companions of `N` words.
pub(super) trait Companion<V, const N: usize>: Send + Sync {
    /// A companion of these arguments.
    fn draw(&self, arguments: &V, source: &mut Source) -> [u32; N];

    /// Whether such a companion could be drawn; `None` if that can't be told.
    fn admits(&self, arguments: &V, companion: &[u32; N]) -> Option<bool>;

    /// Companions that are simpler than this one, the simplest first.
    fn shrink(&self, arguments: &V, companion: [u32; N]) -> Vec<[u32; N]>;
}

/// The arguments of a case, and its companion.
#[derive(Clone, Debug)]
pub(super) struct Accompanied<V, const N: usize>(pub(super) V, pub(super) [u32; N]);

impl<V: Arguments, const N: usize> Arguments for Accompanied<V, N> {
    fn shapes() -> Vec<Shape> {
        let mut shapes = V::shapes();
        shapes.extend([const { Shape::Scalar(crate::value::Scalar::U32) }; N]);
        shapes
    }
    fn store_all(&self, lanes: &mut Vec<u32>) {
        self.0.store_all(lanes);
        lanes.extend(self.1);
    }
    fn load_all(lanes: &mut std::slice::Iter<'_, u32>) -> Self {
        let arguments = V::load_all(lanes);
        Self(arguments, std::array::from_fn(|_| lanes.next().copied().unwrap_or_default()))
    }
}

/// A domain whose values have companions.
#[derive(Debug)]
pub(super) struct WithCompanion<'a, D, C, const N: usize> {
    pub(super) domain: &'a D,
    pub(super) companion: C,
}

impl<D: Domain, C: Companion<D::Value, N>, const N: usize> WithCompanion<'_, D, C, N> {
    fn joined(&self, value: D::Value, source: &mut Source) -> Accompanied<D::Value, N> {
        let companion = self.companion.draw(&value, source);
        Accompanied(value, companion)
    }
}

impl<D: Domain, C: Companion<D::Value, N>, const N: usize> Domain for WithCompanion<'_, D, C, N> {
    type Value = Accompanied<D::Value, N>;

    fn draw(&self, source: &mut Source) -> Option<Self::Value> {
        Some(self.joined(self.domain.draw(source)?, source))
    }

    fn edges(&self) -> Vec<Self::Value> {
        let edges = (0..).zip(self.domain.edges());
        edges.map(|(index, edge)| self.joined(edge, &mut Source::new(LISTED, index))).collect()
    }

    fn is_empty(&self) -> bool {
        self.domain.is_empty()
    }

    fn size(&self) -> Option<u64> {
        self.domain.size()
    }

    fn nth(&self, index: u64) -> Option<Self::Value> {
        Some(self.joined(self.domain.nth(index)?, &mut Source::new(LISTED, index)))
    }

    fn admits(&self, Accompanied(value, companion): &Self::Value) -> Option<bool> {
        match (self.domain.admits(value), self.companion.admits(value, companion)) {
            (Some(true), Some(true)) => Some(true),
            (Some(false), _) | (_, Some(false)) => Some(false),
            _ => None,
        }
    }

    fn shrinkable(&self, origin: Origin<'_>) -> Option<Shrinkable<'_, Self::Value>> {
        let (arguments, companion) = match origin {
            Origin::Draw(source) => {
                let arguments = self.domain.shrinkable(Origin::Draw(&mut *source))?;
                let companion = self.companion.draw(arguments.value(), source);
                (arguments, companion)
            }
            Origin::Edge(index) => {
                let arguments = self.domain.shrinkable(Origin::Edge(index))?;
                let mut source = Source::new(LISTED, index as u64);
                let companion = self.companion.draw(arguments.value(), &mut source);
                (arguments, companion)
            }
            Origin::Nth(index) => {
                let arguments = self.domain.shrinkable(Origin::Nth(index))?;
                let mut source = Source::new(LISTED, index);
                let companion = self.companion.draw(arguments.value(), &mut source);
                (arguments, companion)
            }
        };
        let companion = self.simplified(arguments.value().clone(), companion);
        let join = &|(value, companion)| Accompanied(value, companion);
        Some((arguments, companion).whole().map(join))
    }
}

impl<D: Domain, C: Companion<D::Value, N>, const N: usize> WithCompanion<'_, D, C, N> {
    fn simplified(&self, arguments: D::Value, companion: [u32; N]) -> Shrinkable<'_, [u32; N]> {
        Shrinkable::new(companion, move || {
            let simpler = self.companion.shrink(&arguments, companion);
            simpler.into_iter().map(|simpler| self.simplified(arguments.clone(), simpler)).collect()
        })
    }
}
