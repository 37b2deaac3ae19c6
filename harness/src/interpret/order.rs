//! Describes the orders in which workgroups and invocations of passes run.

use karat_engine::{Actor, Atomics, Options, Priorities, Schedule, Stores};

use super::dispatch::{Prepared, options};
use crate::dispatch::{Afterwards, DispatchError, Pass, Passes};

/// The subgroup size in the usual order.
pub const SUBGROUP: u32 = Schedule::SUBGROUP;

/// The other subgroup sizes of WebGPU devices.
pub(super) const SUBGROUPS: [u32; 5] = [4, 8, 16, 64, 128];

/// If the passes have at most this number of invocations, each invocation runs alone in sampled orders. In larger
/// passes, groups of [`TOGETHER`] neighbouring invocations run together, which takes an eighth of the time.
pub(super) const ONE_BY_ONE: u64 = 4096;
const TOGETHER: usize = 8;

/// The number of turns in which invocations may wait in loops, in orders where the last invocation runs first. After
/// these turns, a waiting invocation gets the lowest priority. In a turn, an invocation runs up to its next atomic. A
/// loop that gives up after a thousand retries gives up within these turns.
const PATIENCE: u32 = 1 << 13;

/// An order of the invocations in several passes.
#[derive(Clone, Debug)]
pub struct OrderOf {
    of_pass: Vec<Schedule>,
}

impl OrderOf {
    /// The usual order with another subgroup size.
    pub(super) fn of_size(passes: &Passes, subgroup: u32) -> Self {
        Self { of_pass: vec![Schedule { subgroup, ..Schedule::default() }; passes.passes.len()] }
    }

    /// The order in which the explorer ran the passes. For each pass, `turns` lists the invocations (or their late
    /// stores) in the order in which they ran.
    pub(super) fn of_turns(turns: Vec<Vec<Actor>>, stores: Stores) -> Self {
        let of = |turns| Schedule { turns, stores, ..Schedule::one_by_one() };
        Self { of_pass: turns.into_iter().map(of).collect() }
    }

    /// The sampled order with the index `number`. In order 0, the invocation with the lowest index runs first; in order
    /// 1, the one with the highest index; in order 2, the invocations take turns. Later orders run the
    /// invocations by number, backwards, or shuffled. If a pass has atomics, one or two of its invocations then stall:
    /// each of them waits for a long time before one of its atomics. In half of the later orders, other invocations may
    /// see an atomic store late.
    pub(super) fn drawn(passes: &Passes, atomics: &[Atomics], number: u64) -> Self {
        let together = if passes.invocations() > ONE_BY_ONE { TOGETHER } else { 1 };
        let of_pass = passes.passes.iter().zip(atomics).enumerate().map(|(at, (_, atomics))| {
            let mut chance = Chance(number << 8 | at as u64);
            let seed = chance.next();
            let priorities = match number % 3 {
                0 => Priorities::ByNumber,
                1 => Priorities::Backwards,
                _ if number == 2 => Priorities::InTurn,
                _ => Priorities::Shuffled(seed),
            };
            let count = match number {
                0..3 => 0,
                _ => 1 + number / 3 % 2,
            };
            let own: Vec<_> =
                atomics.of_invocation.iter().enumerate().filter(|(_, n)| **n > 0).collect();
            let stall = |_| {
                let (invocation, count) = own.get(chance.below(own.len() as u64) as usize)?;
                Some((*invocation, 1 + chance.below(u64::from(**count)) as u32))
            };
            let stalls = (0..count).filter_map(stall).collect();
            let late = number >= 3 && number % 2 == 1;
            let stores = if late { Stores::Late(seed) } else { Stores::AtOnce };
            // In the backward order, loops with a retry limit reach their limit.
            let patience = if number % 3 == 1 { PATIENCE } else { 0 };
            let subgroup = [SUBGROUP, 4, 64, 8, 16, 128][number as usize % 6];
            Schedule {
                priorities,
                patience,
                stalls,
                stores,
                together,
                subgroup,
                ..Schedule::default()
            }
        });
        Self { of_pass: of_pass.collect() }
    }

    pub(super) fn options(&self, number: usize, base: &Options) -> Options {
        Options { schedule: self.of_pass[number].clone(), ..base.clone() }
    }

    pub(crate) fn subgroup(&self) -> u32 {
        self.of_pass.iter().map(|own| own.subgroup).find(|own| *own != SUBGROUP).unwrap_or(SUBGROUP)
    }

    /// Simpler orders. Each of them lacks one of the differences between this order and the usual order.
    pub(crate) fn simpler(&self) -> impl Iterator<Item = Self> {
        let usual = Schedule::default();
        let of_one = self.of_pass.iter().enumerate().flat_map(move |(at, own)| {
            let mut all = Vec::new();
            if *own == usual {
                return all;
            }
            // Gives this pass the usual order, because usually only one of the passes is the cause.
            all.push((at, usual.clone()));
            all.push((at, Schedule { stores: Stores::AtOnce, ..own.clone() }));
            all.push((at, Schedule { subgroup: SUBGROUP, ..own.clone() }));
            if own.turns.is_empty() {
                all.push((at, Schedule { priorities: Priorities::ByNumber, ..own.clone() }));
                all.push((at, Schedule { together: usize::MAX, ..own.clone() }));
            }
            for left_out in 0..own.stalls.len() {
                let mut stalls = own.stalls.clone();
                stalls.remove(left_out);
                all.push((at, Schedule { stalls, ..own.clone() }));
            }
            all.retain(|(_, other)| other != own);
            all
        });
        of_one.map(|(at, own)| {
            let mut of_pass = self.of_pass.clone();
            of_pass[at] = own;
            Self { of_pass }
        })
    }

    /// The passes whose order isn't the usual one, each with its order.
    pub(crate) fn passes<'p>(
        &'p self,
        passes: &'p Passes,
    ) -> impl Iterator<Item = (&'p Pass, &'p Schedule)> {
        let usual = Schedule::default();
        let all = passes.passes.iter().zip(&self.of_pass);
        all.filter(move |(_, own)| **own != usual)
    }

    /// Checks if only the subgroup size differs from the usual order.
    pub fn is_of_size(&self) -> bool {
        let usual = Schedule::default();
        self.of_pass.iter().all(|own| Schedule { subgroup: SUBGROUP, ..own.clone() } == usual)
    }

    /// The first words of a finding's headline, if the usual order doesn't show the finding: `in another order`.
    pub(super) fn headline(&self) -> String {
        match self.is_of_size() {
            true => format!("in subgroups of {}", self.subgroup()),
            false => "in another order".to_owned(),
        }
    }

    pub(super) fn note(&self, passes: &Passes) -> String {
        match self.is_of_size() {
            true => format!("a device can have subgroups of {} invocations", self.subgroup()),
            false => format!("WGSL promises no order. In this order, {}", self.told(passes)),
        }
    }

    /// The differences from the usual order, as a clause for messages.
    pub(crate) fn told(&self, passes: &Passes) -> String {
        let several = passes.passes.len() > 1;
        let of_pass = |(pass, own): (&Pass, &Schedule)| {
            let of = if several { format!(" of `{}`", pass.name) } else { String::new() };
            let mut all = Vec::new();
            let plain = own.together == usize::MAX;
            match (own.priorities, &own.turns[..]) {
                (_, [_, ..]) => all.push(format!("the atomics{of} run in another order")),
                (Priorities::ByNumber, _) if plain => {}
                (Priorities::ByNumber, _) => {
                    all.push(format!("the invocations{of} run one after the other"));
                }
                (Priorities::Backwards, _) => all.push(format!(
                    "the invocations{of} run one after the other, the last one first"
                )),
                (Priorities::InTurn, _) => {
                    all.push(format!(
                        "the invocations{of} take turns, and each runs up to its next atomic"
                    ));
                }
                (Priorities::Shuffled(_), _) => all.push(format!(
                    "the invocations{of} run one after the other, in a shuffled order"
                )),
            }
            let size = pass.workgroup_size();
            all.extend(own.stalls.iter().map(|(invocation, at)| {
                let who = super::invocation(pass, size, *invocation);
                format!("{who}{of} stalls before its {}", ordinal(*at))
            }));
            if own.stores != Stores::AtOnce {
                all.push(format!("atomic stores{of} take effect late"));
            }
            if pass.program.has_subgroups() && own.subgroup != SUBGROUP {
                all.push(format!("subgroups{of} have {} invocations", own.subgroup));
            }
            all
        };
        let all: Vec<String> = self.passes(passes).flat_map(of_pass).collect();
        if all.is_empty() {
            "two invocations run in swapped order".to_owned()
        } else {
            all.join(", and ")
        }
    }
}

fn ordinal(number: u32) -> String {
    match number {
        1 => "first atomic".to_owned(),
        2 => "second atomic".to_owned(),
        3 => "third atomic".to_owned(),
        more => format!("atomic number {more}"),
    }
}

/// A random number generator with Knuth's constants, as in MMIX.
struct Chance(u64);

impl Chance {
    fn next(&mut self) -> u64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        self.0 ^ self.0 >> 29
    }

    fn below(&mut self, count: u64) -> u64 {
        (self.next() >> 33) % count.max(1)
    }
}

/// Runs passes in an order, and returns the data that they write. `None` stands for the usual order.
pub fn in_order_of(passes: &Passes, order: Option<&OrderOf>) -> Result<Afterwards, DispatchError> {
    let prepared = Prepared::new(passes, &karat_engine::Settings::default())?;
    prepared.dispatched(&|number| options_in(number, order, &options()))
}

pub(super) fn options_in(number: usize, order: Option<&OrderOf>, base: &Options) -> Options {
    order.map_or_else(|| base.clone(), |order| order.options(number, base))
}

/// The number of orders that a runner tried. `all` is `true` if no other order could give other results.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tried {
    /// The number of tried orders, without the usual order.
    pub(crate) orders: u64,
    pub(crate) all: bool,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dispatch::Wanted;
    use crate::fixture::{Buffer, Fixtures};
    use crate::package::Package;
    use crate::path::Path;
    use crate::reflect::Overrides;

    /// If the engine uses the same subgroup size as a driver, each subgroup operation returns the same results in both.
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
            // A driver with a range of subgroup sizes chooses a size for each pipeline.
            let sizes = SUBGROUPS
                .into_iter()
                .chain([SUBGROUP])
                .filter(|size| (least..=most).contains(size));
            let left = sizes.map(|subgroup| {
                let order = OrderOf::of_size(&passes, subgroup);
                in_order_of(&passes, Some(&order)).expect("the engine runs it")
            });
            let left: Vec<_> = left.collect();
            assert!(left.contains(&drivers), "{operation}: {drivers:?} is none of {left:?}");
        }
    }
}
