//! Tuples: independent domains side by side.

use super::{Domain, Origin, Shrinkable, Source};

/// Combinations of edges that are tried first; more than this are left to the draws, which reach
/// every edge of every part by their bias.
const COMBINATIONS: usize = 1024;

/// The arguments of a function that has none.
impl Domain for () {
    type Value = ();
    fn draw(&self, _: &mut Source) -> Option<()> {
        Some(())
    }
    fn size(&self) -> Option<u64> {
        Some(1)
    }
    fn nth(&self, index: u64) -> Option<()> {
        (index == 0).then_some(())
    }
}

macro_rules! product {
    ($(($($name:ident $index:tt),+))*) => {$(
        impl<$($name: Domain),+> Domain for ($($name,)+) {
            type Value = ($($name::Value,)+);

            fn draw(&self, source: &mut Source) -> Option<Self::Value> {
                Some(($(self.$index.draw(source)?,)+))
            }

            fn edges(&self) -> Vec<Self::Value> {
                let edges = ($(self.$index.edges(),)+);
                let lengths = combined([$(edges.$index.len()),+]);
                let total: usize = lengths.iter().product();
                (0..total.min(COMBINATIONS))
                    .map(|mut rest| {
                        let combination = ($({
                            let length = lengths[$index];
                            let value = edges.$index[rest % length].clone();
                            rest /= length;
                            value
                        },)+);
                        let _ = rest; // 0: the last part leaves none
                        combination
                    })
                    .collect()
            }

            fn is_empty(&self) -> bool {
                $(self.$index.is_empty())||+
            }

            fn size(&self) -> Option<u64> {
                Some(1_u64)$(.and_then(|size| size.checked_mul(self.$index.size()?)))+
            }

            #[expect(unused_assignments, reason = "the last part leaves no rest")]
            fn nth(&self, mut index: u64) -> Option<Self::Value> {
                if index >= self.size()? {
                    return None;
                }
                Some(($({
                    let size = self.$index.size()?;
                    let value = self.$index.nth(index % size)?;
                    index /= size;
                    value
                },)+))
            }

            fn admits(&self, value: &Self::Value) -> Option<bool> {
                let parts = [$(self.$index.admits(&value.$index)),+];
                if parts.contains(&Some(false)) {
                    return Some(false);
                }
                parts.into_iter().all(|part| part.is_some()).then_some(true)
            }

            fn shrink(&self, value: &Self::Value) -> Vec<Self::Value> {
                let parts = ($(Shrinkable::of(&self.$index, value.$index.clone()),)+);
                parts.whole().simpler().iter().map(|simpler| simpler.value().clone()).collect()
            }

            #[expect(unused_assignments, reason = "the last part leaves no rest")]
            fn shrinkable(&self, origin: Origin<'_>) -> Option<Shrinkable<'_, Self::Value>> {
                let parts = match origin {
                    Origin::Draw(source) => {
                        ($(self.$index.shrinkable(Origin::Draw(&mut *source))?,)+)
                    }
                    Origin::Nth(mut index) => ($({
                        let size = self.$index.size()?;
                        let part = self.$index.shrinkable(Origin::Nth(index % size))?;
                        index /= size;
                        part
                    },)+),
                    Origin::Edge(mut rest) => {
                        let lengths = combined([$(self.$index.edges().len()),+]);
                        ($({
                            let length = lengths[$index];
                            let part = self.$index.shrinkable(Origin::Edge(rest % length))?;
                            rest /= length;
                            part
                        },)+)
                    }
                };
                Some(parts.whole())
            }
        }

        impl<'a, $($name: Clone + 'a),+> Parts<'a> for ($(Shrinkable<'a, $name>,)+) {
            type Value = ($($name,)+);

            fn whole(self) -> Shrinkable<'a, Self::Value> {
                let value = ($(self.$index.value().clone(),)+);
                Shrinkable::new(value, move || {
                    let simpler = ($(self.$index.simpler(),)+);
                    let mut together = self.clone();
                    let mut moved = 0;
                    $(if let Some(simplest) = simpler.$index.first() {
                        together.$index = simplest.clone();
                        moved += 1;
                    })+
                    let mut found = Vec::new();
                    if moved > 1 {
                        found.push(together.whole());
                    }
                    // In turns, so that the simplest values of each part are tried early.
                    let rounds = [$(simpler.$index.len()),+].into_iter().max().unwrap_or(0);
                    for round in 0..rounds {
                        $(if let Some(part) = simpler.$index.get(round) {
                            let mut parts = self.clone();
                            parts.$index = part.clone();
                            found.push(parts.whole());
                        })+
                    }
                    found
                })
            }
        }
    )*};
}

/// The parts of a tuple, each of which can be simplified.
pub(crate) trait Parts<'a> {
    type Value;
    /// The tuple: simpler with all parts at their simplest, or with one of them simpler.
    fn whole(self) -> Shrinkable<'a, Self::Value>;
}

/// How many edges of each part are combined: where all combinations are too many, its two ends.
fn combined<const N: usize>(lengths: [usize; N]) -> [usize; N] {
    let full: usize = lengths.iter().product();
    let ends = if full <= COMBINATIONS { usize::MAX } else { 2 };
    lengths.map(|length| length.min(ends))
}

product! {
    (A 0)
    (A 0, B 1)
    (A 0, B 1, C 2)
    (A 0, B 1, C 2, D 3)
    (A 0, B 1, C 2, D 3, E 4)
    (A 0, B 1, C 2, D 3, E 4, F 5)
}
