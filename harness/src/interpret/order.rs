//! Compute passes in other orders of their workgroups and invocations.

use karat_engine::{Options, Schedule, Swap};

use super::dispatch::{dispatched, options};
use crate::dispatch::{Afterwards, DispatchError, Pass, Passes};

/// Invocations of a subgroup where no order says another number.
pub(crate) const SUBGROUP: u32 = Schedule::SUBGROUP;

/// Workgroups that run beside each other: any two neighbours do, and a few more.
pub(super) const BESIDE: usize = 4;

/// Invocations of a subgroup, by the seed of an order: those that GPUs have, the least and the most first.
const SUBGROUPS: [u32; 5] = [4, 64, 8, 32, 16];

/// An order of the invocations of passes: the same shuffle in each pass, as far as that has as many.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OrderOf {
    schedule: Schedule,
    /// The pass that has this order, by its number; the others have the usual one. `None`: all passes have it.
    only: Option<usize>,
    /// Workgroups that run beside each other.
    beside: usize,
}

impl OrderOf {
    /// The first orders, which have one of each kind: the reverse one, three in which each invocation runs to its next
    /// barrier by itself, a shuffled one, and one in which chance decides whose turn it is at each atomic.
    pub(crate) const KINDS: u64 = 6;

    /// All swaps of an order. In the second and the third one each invocation runs by itself to the next barrier, once by
    /// their numbers and once backwards: any two of them meet in both orders, wherever their statements stand. The others
    /// have workgroups run beside each other. In the first of them, and in every other one, invocations keep their statements
    /// side by side; in the rest each goes from atomic to atomic by itself, in a turn that chance decides.
    pub(crate) fn whole(passes: &Passes, number: u64) -> Self {
        let subgroup = SUBGROUPS[number as usize % SUBGROUPS.len()];
        // The reverse order is that of the seed 0.
        let (seed, serial) = match number {
            1 | 2 => (0, true),
            _ => (number, number % 2 == 1),
        };
        let beside = if (1..=3).contains(&number) { 1 } else { BESIDE };
        let of_pass = passes.passes.iter().map(|pass| {
            let (groups, together) = counts(pass, subgroup);
            Schedule::whole(seed, groups, together).swaps
        });
        let swaps = if number == 1 { 0 } else { of_pass.max().unwrap_or_default() };
        Self { schedule: Schedule { seed, swaps, serial, subgroup }, only: None, beside }
    }

    /// How one of the passes that have it runs.
    pub(super) fn options(self, base: &Options) -> Options {
        Options { schedule: Some(self.schedule), beside: self.beside, ..base.clone() }
    }

    /// A whole order in words.
    pub(super) fn told(self) -> &'static str {
        let Schedule { seed, swaps, serial, .. } = self.schedule;
        match (serial, seed) {
            (false, 0) => "workgroups and invocations come backwards, from statement to statement",
            (false, _) => {
                "workgroups and invocations are shuffled, and go from statement to statement"
            }
            (true, 0) if swaps == 0 => {
                "each invocation runs to the next barrier, or to its end, before the next one"
            }
            (true, 0) => {
                "each invocation runs to the next barrier, or to its end, before the next one, the last one first"
            }
            (true, _) => "invocations take turns, each to its next atomic",
        }
    }

    /// The swaps that it is made of.
    pub(crate) fn swaps(self) -> usize {
        self.schedule.swaps
    }

    /// Invocations of a subgroup.
    pub(crate) fn subgroup(self) -> u32 {
        self.schedule.subgroup
    }

    /// The invocations by their numbers, in the smallest subgroups.
    pub(super) fn in_small_subgroups() -> Schedule {
        Schedule { seed: 0, swaps: 0, serial: false, subgroup: SUBGROUPS[0] }
    }

    /// The same with the first so many swaps.
    pub(crate) fn first(self, swaps: usize) -> Self {
        Self { schedule: Schedule { swaps, ..self.schedule }, ..self }
    }

    /// The same where no workgroup runs beside another one, and no invocation waits at an atomic.
    pub(crate) fn apart(self) -> Self {
        Self { beside: 1, ..self }
    }

    /// The same in one pass alone.
    pub(crate) fn only(self, pass: usize) -> Self {
        Self { only: Some(pass), ..self }
    }

    /// The passes that have this order.
    pub(crate) fn passes(self, passes: &Passes) -> impl Iterator<Item = &Pass> {
        let all = passes.passes.iter().enumerate();
        all.filter(move |(number, _)| self.only.is_none_or(|only| only == *number))
            .map(|(_, pass)| pass)
    }

    /// The two that change places last, in each pass that has as many.
    pub(crate) fn last(self, passes: &Passes) -> String {
        let sizes = || format!("subgroups have {} invocations", self.schedule.subgroup);
        let sizes = passes.has_subgroups().then(sizes);
        let of_one = self.only.and_then(|number| passes.passes.get(number));
        let of_one = of_one.map_or_else(String::new, |pass| format!(" in `{}`", pass.name));
        let apart = passes.passes.iter().any(|pass| counts(pass, 1).0 > 1);
        let how = match (self.schedule.serial, self.beside > 1) {
            (true, true) => {
                Some(format!("invocations take turns{of_one}, each to its next atomic"))
            }
            (false, true) if apart => {
                Some(format!("workgroups run beside each other{of_one}, each to its next atomic"))
            }
            (true, false) if self.schedule.swaps == 0 => Some(format!(
                "invocations run to the next barrier, or to their ends, one after the other{of_one}"
            )),
            _ => None,
        };
        let of_pass = |pass: &Pass| {
            let (groups, together) = counts(pass, self.schedule.subgroup);
            Some(match self.schedule.last(groups, together)? {
                Swap::Workgroups(one, two) => {
                    let [one, two] = [one, two].map(|group| pass.workgroup(group));
                    format!("workgroups {one} and {two} of `{}` change places", pass.name)
                }
                Swap::Invocations(one, two) => {
                    let who = if pass.program.has_subgroups() {
                        format!("subgroups {one} and {two}")
                    } else {
                        let [one, two] = [one, two].map(|own| pass.local(own));
                        format!("local {one} and {two}")
                    };
                    format!("{who} change places in each workgroup of `{}`", pass.name)
                }
            })
        };
        let swaps = self.passes(passes).filter_map(of_pass);
        let all: Vec<String> = swaps.chain(sizes).chain(how).collect();
        if all.is_empty() { "two invocations change places".to_owned() } else { all.join(", and ") }
    }
}

/// Workgroups of a pass, and the invocations of each, or the subgroups if it has any.
fn counts(pass: &Pass, subgroup: u32) -> (usize, usize) {
    let groups = pass.workgroups.iter().map(|count| *count as usize).product();
    let invocations: usize = pass.workgroup_size().iter().map(|count| *count as usize).product();
    let together = if pass.program.has_subgroups() { subgroup as usize } else { 1 };
    (groups, invocations / together)
}

/// The words that passes leave in an order of their invocations; `None`: by their numbers.
pub(crate) fn in_order_of(
    passes: &Passes,
    order: Option<OrderOf>,
) -> Result<Afterwards, DispatchError> {
    dispatched(passes, &|pass| options_in(passes, pass, order))
}

/// How one of some passes runs in an order.
pub(super) fn options_in(passes: &Passes, pass: &Pass, order: Option<OrderOf>) -> Options {
    let has_it = |order: &OrderOf| order.passes(passes).any(|own| std::ptr::eq(own, pass));
    match order.filter(has_it) {
        Some(order) => order.options(&options()),
        None => options(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dispatch::Wanted;
    use crate::fixture::{Buffer, Fixtures};
    use crate::package::Package;
    use crate::path::Path;
    use crate::reflect::Overrides;

    /// Each operation in the engine, by the size that a driver has, leaves the driver's words.
    #[test]
    fn subgroups_are_those_of_a_driver_of_their_size() {
        let vulkan = crate::executor::of(Path::VULKAN).expect("a driver of Vulkan is here");
        let [least, most] = vulkan.subgroups().expect("it has subgroups");
        for operation in [
            "subgroupAdd(x)",
            "subgroupMul(x | 1u)",
            "subgroupMin(x)",
            "subgroupMax(x)",
            "subgroupAnd(x | 4u)",
            "subgroupOr(x)",
            "subgroupXor(x)",
            "u32(subgroupAll(x < 12u))",
            "u32(subgroupAny(x == 12u))",
            "subgroupExclusiveAdd(x)",
            "subgroupInclusiveAdd(x)",
            "subgroupExclusiveMul(x | 1u)",
            "subgroupInclusiveMul(x | 1u)",
            "subgroupBroadcast(x, 2u)",
            "subgroupBroadcastFirst(x)",
            "subgroupShuffle(x, size - 1u - own)",
            "subgroupShuffleXor(x, 3u)",
            "select(0u, subgroupShuffleUp(x, 1u), own > 0u)",
            "select(0u, subgroupShuffleDown(x, 1u), own + 1u < size)",
            "quadBroadcast(x, 1u)",
            "quadSwapX(x)",
            "quadSwapY(x)",
            "quadSwapDiagonal(x)",
            "subgroupBallot(x < 6u).x",
            "u32(subgroupMax(vec2f(f32(x), -f32(x))).x)",
            "bitcast<u32>(subgroupMin(-i32(x)))",
            "own + 100u * group + 10000u * groups",
        ] {
            let text = format!(
                "@group(0) @binding(0) var<storage, read_write> out: array<u32>;
                 @compute @workgroup_size(64) fn main(@builtin(local_invocation_index) i: u32,
                     @builtin(subgroup_size) size: u32, @builtin(subgroup_id) group: u32,
                     @builtin(subgroup_invocation_id) own: u32, @builtin(num_subgroups) groups: u32) {{
                     let x = (i * 7u + 3u) % 13u;
                     out[i] = {operation};
                 }}"
            );
            let package = Package::from_source("m", text);
            let wanted = [Wanted { name: "main".to_owned(), workgroups: [1, 1, 1] }];
            let fixtures: Fixtures = vec![("out".to_owned(), Buffer::zeros(256).into())];
            let passes = Passes::new(&package, &wanted, (&fixtures, &[]), &Overrides::new());
            let passes = passes.expect("they fit");
            let drivers = crate::executor::dispatch(vulkan, &passes).expect("the driver runs it");
            // A driver with a range has a size of its own for each pipeline.
            let sizes = SUBGROUPS.into_iter().filter(|size| (least..=most).contains(size));
            let left = sizes.map(|subgroup| {
                let order = Schedule { seed: 0, swaps: 0, serial: false, subgroup };
                in_order_of(&passes, Some(OrderOf { schedule: order, only: None, beside: 1 }))
                    .expect("the engine runs it")
            });
            let left: Vec<_> = left.collect();
            assert!(left.contains(&drivers), "{operation}: {drivers:?} is none of {left:?}");
        }
    }
}
