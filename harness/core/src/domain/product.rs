//! Tuples of domains. The components are independent, except that some samples tie two components.

use std::any::{Any, TypeId};
use std::rc::Rc;

use super::ties::{self, Tie};
use super::{Domain, Emptiness, Origin, Shrinkable, Source};

/// The largest number of cases in which Karat combines edges of different parts. If there are more combinations, Karat
/// combines only the first edges of each part, and tries each other edge once.
const COMBINATIONS: usize = 1024;

/// The domain for functions without parameters.
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

/// Expands to `$value`. A repetition in a macro must use a variable such as `$index`: `$(at!($index, x)),+` repeats `x`
/// for each component.
macro_rules! at {
    ($index:tt, $value:expr) => {
        $value
    };
}

macro_rules! product {
    ($(($($name:ident $index:tt),+))*) => {$(
        impl<$($name: Domain),+> Domain for ($($name,)+) {
            type Value = ($($name::Value,)+);

            fn draw(&self, source: &mut Source) -> Option<Self::Value> {
                let mut starts = [$(at!($index, source.clone())),+];
                let mut value = ($({
                    starts[$index] = source.clone();
                    self.$index.draw(source)?
                },)+);
                let types = [$(TypeId::of::<$name::Value>()),+];
                if !ties::are_drawn(&types, source) {
                    return Some(value);
                }
                ties::draw(&types, &starts, source, &mut |tie| {
                    let from: &dyn Any = match tie.from {
                        $($index => &value.$index,)+
                        _ => return false,
                    };
                    match tie.to {
                        $($index => match tie.value(&self.$index, from) {
                            Some(tied) => value.$index = tied,
                            None => return false,
                        },)+
                        _ => return false,
                    }
                    true
                });
                Some(value)
            }

            fn edges(&self) -> Vec<Self::Value> {
                let edges = ($(self.$index.edges(),)+);
                combinations([$(edges.$index.len()),+])
                    .map(|at| ($(edges.$index[at[$index]].clone(),)+))
                    .collect()
            }

            fn emptiness(&self) -> Option<Emptiness> {
                None$(.or_else(|| Some(self.$index.emptiness()?.in_part($index))))+
            }

            fn ends(&self) -> Option<(Self::Value, Self::Value)> {
                let ends = ($(self.$index.ends()?,)+);
                Some((($(ends.$index.0,)+), ($(ends.$index.1,)+)))
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
                        let mut starts = [$(at!($index, source.clone())),+];
                        let mut parts = ($({
                            starts[$index] = source.clone();
                            self.$index.shrinkable(Origin::Draw(&mut *source))?
                        },)+);
                        let types = [$(TypeId::of::<$name::Value>()),+];
                        if !ties::are_drawn(&types, source) {
                            return Some(parts.whole());
                        }
                        let ties = ties::draw(&types, &starts, source, &mut |tie| {
                            let from: &dyn Any = match tie.from {
                                $($index => parts.$index.value(),)+
                                _ => return false,
                            };
                            match tie.to {
                                $($index => match tie.shrinkable(&self.$index, from) {
                                    Some(tied) => parts.$index = tied,
                                    None => return false,
                                },)+
                                _ => return false,
                            }
                            true
                        });
                        return Some(self.tied(parts, ties.into()));
                    }
                    Origin::Nth(mut index) => ($({
                        let size = self.$index.size()?;
                        let part = self.$index.shrinkable(Origin::Nth(index % size))?;
                        index /= size;
                        part
                    },)+),
                    Origin::Edge(index) => {
                        let at = combinations([$(self.$index.edges().len()),+]).nth(index)?;
                        ($(self.$index.shrinkable(Origin::Edge(at[$index]))?,)+)
                    }
                };
                Some(parts.whole())
            }
        }

        impl<'a, $($name: Domain),+> Tied<'a> for ($($name,)+) {
            type Parts = ($(Shrinkable<'a, $name::Value>,)+);

            fn tied(
                &'a self,
                parts: Self::Parts,
                ties: Rc<[Tie]>,
            ) -> Shrinkable<'a, Self::Value> {
                if ties.is_empty() {
                    return parts.whole();
                }
                let value = ($(parts.$index.value().clone(),)+);
                Shrinkable::new(value, move || {
                    let simpler = ($(parts.$index.simpler(),)+);
                    let mut found = Vec::new();
                    for root in roots(&ties) {
                        let count = match root {
                            $($index => simpler.$index.len(),)+
                            _ => 0,
                        };
                        for step in 0..count {
                            let mut next = parts.clone();
                            match root {
                                $($index => next.$index = simpler.$index[step].clone(),)+
                                _ => {}
                            }
                            let mut moved = [$(root == $index),+];
                            let held = ties.iter().all(|tie| {
                                if !moved[tie.from] {
                                    return true;
                                }
                                moved[tie.to] = true;
                                let from: &dyn Any = match tie.from {
                                    $($index => next.$index.value(),)+
                                    _ => return false,
                                };
                                match tie.to {
                                    $($index => {
                                        let own = simpler.$index.get(step);
                                        match tie.simpler(&self.$index, from, own) {
                                            Some(tied) => next.$index = tied,
                                            None => return false,
                                        }
                                    })+
                                    _ => return false,
                                }
                                true
                            });
                            if held {
                                found.push(self.tied(next, Rc::clone(&ties)));
                            }
                        }
                    }
                    found.extend(parts.clone().whole().simpler());
                    found
                })
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
                    // The parts take turns, so that the simplest values of every part come early.
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

trait Tied<'a>: Domain {
    type Parts;
    /// Makes the tuple from its parts. A simpler tuple either has no ties, or keeps all ties by simplifying tied
    /// components together.
    fn tied(&'a self, parts: Self::Parts, ties: Rc<[Tie]>) -> Shrinkable<'a, Self::Value>;
}

/// The components that determine other components, but that no other component determines. Each component occurs once.
fn roots(ties: &[Tie]) -> Vec<usize> {
    let mut roots: Vec<usize> = Vec::new();
    for tie in ties {
        if !roots.contains(&tie.from) && ties.iter().all(|other| other.to != tie.from) {
            roots.push(tie.from);
        }
    }
    roots
}

/// The parts of a tuple, with the simpler values of each part.
#[doc(hidden)]
pub trait Parts<'a> {
    type Value;
    /// Makes the tuple from its parts. The tuple's first simpler value has the simplest value of each part. In each
    /// other simpler value, only one part is simpler.
    fn whole(self) -> Shrinkable<'a, Self::Value>;
}

/// Combines the edges of a tuple's parts. Each array is one combination: for each part, the index of an edge in the
/// part's list of edges. First come all combinations of the first edges, with as many edges of each part as the limit
/// allows. Then comes each remaining edge, with varying edges of the other parts.
fn combinations<const N: usize>(lengths: [usize; N]) -> impl Iterator<Item = [usize; N]> {
    let product = |most: usize| -> usize {
        lengths.iter().map(|length| *length.min(&most)).fold(1, usize::saturating_mul)
    };
    let longest = lengths.into_iter().max().unwrap_or(0);
    let most = (1..=longest).rev().find(|most| product(*most) <= COMBINATIONS).unwrap_or(1);
    let firsts = lengths.map(|length| length.min(most));
    let all = move |mut rest: usize| {
        firsts.map(|length| {
            let at = rest % length;
            rest /= length;
            at
        })
    };
    let none = lengths.contains(&0);
    let left = move |part: usize| {
        let length = if none { 0 } else { lengths[part] };
        (firsts[part]..length).map(move |edge| {
            let mut at = lengths.map(|length| edge % length);
            at[part] = edge;
            at
        })
    };
    (0..product(most)).map(all).chain((0..N).flat_map(left))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_edge_occurs_in_some_combination() {
        let few: Vec<_> = combinations([2, 3]).collect();
        assert_eq!(few, [[0, 0], [1, 0], [0, 1], [1, 1], [0, 2], [1, 2]]);
        let many: Vec<_> = combinations([60, 8, 8]).collect();
        assert_eq!(many.len(), 16 * 8 * 8 + 44);
        for (part, length) in [60, 8, 8].into_iter().enumerate() {
            assert!((0..length).all(|edge| many.iter().any(|at| at[part] == edge)));
        }
        assert!(many.iter().all(|at| at[0] < 60 && at[1] < 8 && at[2] < 8));
        assert_eq!(combinations([100; 6]).count(), 3_usize.pow(6) + 6 * 97);
        assert_eq!(combinations([5, 0]).count(), 0);
    }
}

product! {
    (A 0)
    (A 0, B 1)
    (A 0, B 1, C 2)
    (A 0, B 1, C 2, D 3)
    (A 0, B 1, C 2, D 3, E 4)
    (A 0, B 1, C 2, D 3, E 4, F 5)
    (A 0, B 1, C 2, D 3, E 4, F 5, G 6)
    (A 0, B 1, C 2, D 3, E 4, F 5, G 6, H 7)
    (A 0, B 1, C 2, D 3, E 4, F 5, G 6, H 7, I 8)
    (A 0, B 1, C 2, D 3, E 4, F 5, G 6, H 7, I 8, J 9)
    (A 0, B 1, C 2, D 3, E 4, F 5, G 6, H 7, I 8, J 9, K 10)
    (A 0, B 1, C 2, D 3, E 4, F 5, G 6, H 7, I 8, J 9, K 10, L 11)
}
