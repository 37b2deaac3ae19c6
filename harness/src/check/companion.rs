//! Companions: additional values that some verbs need for each case. Examples are a second value of an
//! argument, and a rotation.
//!
//! Karat samples a companion after the arguments, from the same stream of random numbers. In a row, the
//! companion's words follow the arguments' words. So Karat simplifies, remembers and replays the arguments and
//! the companion together.

use crate::domain::{Emptiness, Held, Origin, Parts, Shrinkable, Source, Stream};

/// The seed for the companions of edges and of enumerated values. Sampled cases use the check's seed instead.
const LISTED: u64 = 0x6c69_7374_6564;

pub(super) trait Companion: Sync {
    fn words(&self) -> usize;

    fn draw(&self, arguments: &[u32], source: &mut Source) -> Vec<u32>;

    /// Reports if sampling can return this companion. `None` if that is unknown.
    fn admits(&self, arguments: &[u32], companion: &[u32]) -> Option<bool>;

    /// Returns simpler companions than this one, the simplest first.
    fn shrink(&self, arguments: &[u32], companion: &[u32]) -> Vec<Vec<u32>>;
}

pub(super) struct WithCompanion<'a> {
    pub(super) arguments: &'a dyn Stream,
    pub(super) companion: &'a dyn Companion,
}

impl WithCompanion<'_> {
    /// Makes the arguments with `make`, and returns the arguments and the source of random numbers for the companion.
    fn drawn<T>(
        &self,
        origin: Origin<'_>,
        make: impl FnOnce(Origin<'_>) -> Option<T>,
    ) -> Option<(T, Source)> {
        let listed = |index| Source::new(LISTED, index);
        match origin {
            Origin::Draw(source) => {
                let made = make(Origin::Draw(&mut *source))?;
                Some((made, source.clone()))
            }
            Origin::Edge(index) => Some((make(origin)?, listed(index as u64))),
            Origin::Nth(index) => Some((make(origin)?, listed(index))),
        }
    }

    fn split<'r>(&self, row: &'r [u32]) -> (&'r [u32], &'r [u32]) {
        row.split_at(self.arguments.width())
    }

    fn simplified(&self, arguments: Vec<u32>, companion: Vec<u32>) -> Shrinkable<'_, Vec<u32>> {
        Shrinkable::new(companion.clone(), move || {
            let simpler = self.companion.shrink(&arguments, &companion);
            simpler.into_iter().map(|simpler| self.simplified(arguments.clone(), simpler)).collect()
        })
    }
}

impl Stream for WithCompanion<'_> {
    fn width(&self) -> usize {
        self.arguments.width() + self.companion.words()
    }

    fn size(&self) -> Option<u64> {
        self.arguments.size()
    }

    fn emptiness(&self) -> Option<Emptiness> {
        self.arguments.emptiness()
    }

    fn edges(&self) -> usize {
        self.arguments.edges()
    }

    fn described(&self) -> String {
        self.arguments.described()
    }

    fn row(&self, origin: Origin<'_>, rows: &mut Vec<u32>) -> bool {
        let start = rows.len();
        let made = |origin: Origin<'_>| self.arguments.row(origin, rows).then_some(());
        let Some(((), mut source)) = self.drawn(origin, made) else { return false };
        let companion = self.companion.draw(&rows[start..], &mut source);
        rows.extend(companion);
        true
    }

    fn value(&self, origin: Origin<'_>) -> Option<Held> {
        let (value, mut source) = self.drawn(origin, |origin| self.arguments.value(origin))?;
        Some(value.with(&self.companion.draw(&value.row, &mut source)))
    }

    fn shrinkable(&self, origin: Origin<'_>) -> Option<Shrinkable<'_, Held>> {
        let make = |origin: Origin<'_>| self.arguments.shrinkable(origin);
        // The returned value borrows the stream but not the origin.
        let (arguments, mut source) = self.drawn(origin, make)?;
        let row = arguments.value().row.clone();
        let companion = self.companion.draw(&row, &mut source);
        let join = &|(value, companion): (Held, Vec<u32>)| value.with(&companion);
        Some((arguments, self.simplified(row, companion)).whole().map(join))
    }

    fn admits(&self, row: &[u32]) -> Option<bool> {
        let (arguments, companion) = self.split(row);
        match (self.arguments.admits(arguments), self.companion.admits(arguments, companion)) {
            (Some(true), Some(true)) => Some(true),
            (Some(false), _) | (_, Some(false)) => Some(false),
            _ => None,
        }
    }

    fn shrink(&self, _: &[u32]) -> Vec<Vec<u32>> {
        Vec::new() // `shrinkable` simplifies the cases instead
    }

    fn show(&self, row: &[u32]) -> String {
        self.arguments.show(self.split(row).0)
    }
}
