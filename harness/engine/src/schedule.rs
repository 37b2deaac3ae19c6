//! Orders of workgroups and of invocations within them: WGSL promises none.

/// An order of the workgroups of a dispatch, and one of the invocations of each workgroup.
///
/// It is made of swaps, so that an order of which only the first swaps are made is simpler: the one that makes a
/// difference tells two workgroups or two invocations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Schedule {
    /// Which order: 0 is the reverse one, others are shuffled.
    pub seed: u64,
    /// How many of its swaps are made, of workgroups first.
    pub swaps: usize,
    /// True if each invocation runs to its end, or to the next barrier, before the next one runs. Otherwise they go
    /// from operation to operation side by side.
    pub serial: bool,
    /// Invocations of a subgroup: WebGPU has devices of 4 to 128 (*subgroupMinSize*).
    pub subgroup: u32,
}

/// Two that change places.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Swap {
    /// Workgroups, by their numbers.
    Workgroups(usize, usize),
    /// Invocations of each workgroup, by their numbers.
    Invocations(usize, usize),
}

impl Schedule {
    /// Invocations of a subgroup where no schedule says another number: most GPUs have 32.
    pub const SUBGROUP: u32 = 32;

    /// All swaps of an order of so many workgroups and invocations.
    #[must_use]
    pub fn whole(seed: u64, groups: usize, invocations: usize) -> Self {
        let all = Self { seed, swaps: usize::MAX, serial: false, subgroup: Self::SUBGROUP };
        Self { swaps: all.all(groups).count() + all.all(invocations).count(), ..all }
    }

    /// The last swap that is made; `None` if none is.
    #[must_use]
    pub fn last(&self, groups: usize, invocations: usize) -> Option<Swap> {
        let (of_groups, of_invocations) = self.orders(groups, invocations);
        let before = Self { swaps: self.swaps.checked_sub(1)?, ..*self };
        let (groups_before, invocations_before) = before.orders(groups, invocations);
        let other = |now: &[usize], before: &[usize]| {
            let at = now.iter().zip(before).position(|(now, before)| now != before)?;
            Some((before[at], now[at]))
        };
        let of_groups = other(&of_groups, &groups_before);
        let of_groups = of_groups.map(|(one, two)| Swap::Workgroups(one, two));
        of_groups.or_else(|| {
            let (one, two) = other(&of_invocations, &invocations_before)?;
            Some(Swap::Invocations(one, two))
        })
    }

    /// Workgroups in their order, and the invocations of each in theirs.
    pub(crate) fn orders(&self, groups: usize, invocations: usize) -> (Vec<usize>, Vec<usize>) {
        let [mut of_groups, mut of_invocations] =
            [groups, invocations].map(|count| (0..count).collect::<Vec<usize>>());
        let mut left = self.swaps;
        for list in [&mut of_groups, &mut of_invocations] {
            for (one, two) in self.all(list.len()).take(left) {
                list.swap(one, two);
                left -= 1;
            }
        }
        (of_groups, of_invocations)
    }

    /// The swaps that make an order of so many, of places. Each is of two neighbours, so that it turns these two around and
    /// no others, unless there are too many: the neighbours of a reverse order of n change places n^2 / 2 times.
    fn all(&self, count: usize) -> Box<dyn Iterator<Item = (usize, usize)>> {
        /// As many invocations as a workgroup may have on any device.
        const MOST: usize = 1024;
        if count > MOST {
            return self.shuffle(count);
        }
        let mut wanted: Vec<usize> = (0..count).collect();
        self.shuffle(count).for_each(|(one, two)| wanted.swap(one, two));
        let mut list: Vec<usize> = (0..count).collect();
        Box::new(wanted.into_iter().enumerate().flat_map(move |(to, one)| {
            let from = list.iter().position(|other| *other == one).unwrap_or(to);
            list[to..=from].rotate_right(1);
            (to..from).rev().map(|at| (at, at + 1))
        }))
    }

    /// Fisher and Yates' shuffle; or the reverse order.
    fn shuffle(&self, count: usize) -> Box<dyn Iterator<Item = (usize, usize)>> {
        if self.seed == 0 {
            return Box::new((0..count / 2).map(move |at| (at, count - 1 - at)));
        }
        let mut state = self.seed;
        Box::new(
            (1..count).rev().map(move |at| (at, (next(&mut state) % (at as u64 + 1)) as usize)),
        )
    }
}

/// The next number of `splitmix64`.
pub(crate) fn next(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = (*state ^ (*state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_order_is_made_swap_by_swap() {
        for seed in 0..20 {
            let whole = Schedule::whole(seed, 5, 8);
            let (groups, invocations) = whole.orders(5, 8);
            for (mut list, count) in [(groups, 5), (invocations, 8)] {
                list.sort_unstable();
                assert_eq!(list, (0..count).collect::<Vec<_>>(), "each once");
            }
            // Each swap turns two around, and no others.
            for swaps in 1..=whole.swaps {
                let [(groups, own), (groups_before, before)] =
                    [swaps, swaps - 1].map(|swaps| Schedule { swaps, ..whole }.orders(5, 8));
                let turned = |now: &[usize], before: &[usize]| {
                    now.iter().zip(before).filter(|(now, before)| now != before).count()
                };
                let of_both = turned(&groups, &groups_before) + turned(&own, &before);
                assert_eq!(of_both, 2, "seed {seed}, {swaps} swaps");
            }
            let none = Schedule { swaps: 0, ..whole };
            assert_eq!(none.orders(5, 8), ((0..5).collect(), (0..8).collect()));
            assert_eq!(none.last(5, 8), None);
        }
        let reverse = Schedule::whole(0, 1, 4);
        assert_eq!(reverse.orders(1, 4), (vec![0], vec![3, 2, 1, 0]));
        assert_eq!(reverse.last(1, 4), Some(Swap::Invocations(0, 1)));
        assert_eq!(
            Schedule { seed: 0, swaps: 1, serial: false, subgroup: Schedule::SUBGROUP }.last(4, 4),
            Some(Swap::Workgroups(2, 3))
        );
        assert_ne!(Schedule::whole(1, 1, 8).orders(1, 8), Schedule::whole(2, 1, 8).orders(1, 8));
    }
}
