//! Compute passes in other orders of their workgroups and invocations.

use karat_engine::{Schedule, Swap};

use super::dispatch::{dispatched, options};
use crate::dispatch::{Afterwards, DispatchError, Passes};

/// Invocations of a subgroup, by the seed of an order: those that GPUs have.
const SUBGROUPS: [u32; 5] = [4, 8, 16, 32, 64];

/// An order of the invocations of passes: the same shuffle in each pass, as far as that has as many.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OrderOf(Schedule);

impl OrderOf {
    /// All swaps of an order: 0 is the reverse one.
    pub(crate) fn whole(passes: &Passes, seed: u64) -> Self {
        let of_pass = passes.passes.iter().map(|pass| {
            let (groups, together) = counts(pass, SUBGROUPS[seed as usize % SUBGROUPS.len()]);
            Schedule::whole(seed, groups, together).swaps
        });
        // In two of them each invocation runs by itself from barrier to barrier: the others keep statements side by side.
        let serial = matches!(seed, 1 | 2);
        let subgroup = SUBGROUPS[seed as usize % SUBGROUPS.len()];
        Self(Schedule { seed, swaps: of_pass.max().unwrap_or_default(), serial, subgroup })
    }

    /// The swaps that it is made of.
    pub(crate) fn swaps(self) -> usize {
        self.0.swaps
    }

    /// Invocations of a subgroup.
    pub(crate) fn subgroup(self) -> u32 {
        self.0.subgroup
    }

    /// The same with the first so many swaps.
    pub(crate) fn first(self, swaps: usize) -> Self {
        Self(Schedule { swaps, ..self.0 })
    }

    /// The two that change places last, in each pass that has as many.
    pub(crate) fn last(self, passes: &Passes) -> String {
        let sizes = || format!("subgroups have {} invocations", self.0.subgroup);
        let sizes = passes.has_subgroups().then(sizes);
        if self.0.swaps == 0 {
            let serial =
                "invocations run to the next barrier, or to their ends, one after the other";
            let serial = self.0.serial.then(|| serial.to_owned());
            let both: Vec<String> = sizes.into_iter().chain(serial).collect();
            return both.join(", and ");
        }
        let of_pass = |pass: &crate::dispatch::Pass| {
            let (groups, together) = counts(pass, self.0.subgroup);
            Some(match self.0.last(groups, together)? {
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
        let all: Vec<String> = passes.passes.iter().filter_map(of_pass).chain(sizes).collect();
        if all.is_empty() { "two invocations change places".to_owned() } else { all.join(", and ") }
    }
}

/// Workgroups of a pass, and the invocations of each, or the subgroups if it has any.
fn counts(pass: &crate::dispatch::Pass, subgroup: u32) -> (usize, usize) {
    let groups = pass.workgroups.iter().map(|count| *count as usize).product();
    let invocations: usize = pass.workgroup_size().iter().map(|count| *count as usize).product();
    let together = if pass.program.has_subgroups() { subgroup as usize } else { 1 };
    (groups, invocations.div_ceil(together))
}

/// The words that passes leave in an order of their invocations; `None`: by their numbers.
pub(crate) fn in_order_of(
    passes: &Passes,
    order: Option<OrderOf>,
) -> Result<Afterwards, DispatchError> {
    let schedule = order.map(|order| order.0);
    dispatched(passes, &|_| karat_engine::Options { schedule, ..options() })
}
