//! Runs entry points. A compute entry point runs in workgroups, with a lane for each invocation. A fragment entry point
//! runs in tiles of pixels, which count as workgroups. The invocations that one machine runs in lockstep are a unit.
//! Units take turns: in a turn, a unit runs to its next atomic or barrier, or to its end.

use std::collections::HashMap;
use std::time::Instant;

use naga::{BuiltIn, Module, Span, TypeInner};

use crate::arithmetic::{Arithmetic, F32};
use crate::code::{Binding, BufferSlot, Code, Site};
use crate::explore::{Explorer, Step};
use crate::machine::{Buffer, Done, Machine, Memory, Pause};
use crate::observer::Observer;
use crate::options::Options;
use crate::program::Program;
use crate::races::{Detector, Observed, OfGroup};
use crate::refusal::{Refusal, Stop};
use crate::resources::Resources;
use crate::runs::Runs;
use crate::schedule::{Actor, ByPriority, Priorities, Schedule, Stores, Turns, shuffled};

/// The largest number of invocations of a workgroup. The default limit of WebGPU is 256, but some GPUs allow 1024.
const MOST_INVOCATIONS: u32 = 1024;

/// The inputs of an entry point, and the size of its workgroups.
#[derive(Debug)]
pub(crate) struct Entry {
    size: [u32; 3],
    /// `true` for a fragment entry point. Then workgroups are tiles, and invocations are pixels in quads.
    drawn: bool,
    /// For each scalar of the parameters: a builtin, and the index of one of the builtin's components.
    inputs: Vec<(BuiltIn, usize)>,
}

impl Entry {
    pub(crate) fn of(
        module: &Module,
        point: &naga::EntryPoint,
        size: [u32; 3],
    ) -> Result<Self, Refusal> {
        let refuse = |what: &str| Refusal::new(what, Span::UNDEFINED);
        let drawn = point.stage == naga::ShaderStage::Fragment;
        let size = if drawn { TILE } else { size };
        if size.contains(&0) {
            return Err(refuse("workgroups without invocations"));
        }
        let invocations = size.iter().fold(1u32, |n, k| n.saturating_mul(*k));
        if invocations > MOST_INVOCATIONS {
            return Err(refuse(&format!("workgroups of {invocations} invocations")));
        }
        let mut inputs = Vec::new();
        let mut add = |binding: &Option<naga::Binding>, inner: &TypeInner| {
            let Some(naga::Binding::BuiltIn(builtin)) = binding else {
                return Err(refuse("an input that isn't a builtin"));
            };
            let components =
                if let TypeInner::Vector { size, .. } = inner { *size as usize } else { 1 };
            inputs.extend((0..components).map(|component| (*builtin, component)));
            Ok(())
        };
        for argument in &point.function.arguments {
            match &module.types[argument.ty].inner {
                TypeInner::Struct { members, .. } => {
                    for member in members {
                        add(&member.binding, &module.types[member.ty].inner)?;
                    }
                }
                inner => add(&argument.binding, inner)?,
            }
        }
        for (builtin, _) in &inputs {
            let given = matches!(
                builtin,
                BuiltIn::GlobalInvocationId
                    | BuiltIn::LocalInvocationId
                    | BuiltIn::LocalInvocationIndex
                    | BuiltIn::WorkGroupId
                    | BuiltIn::NumWorkGroups
                    | BuiltIn::WorkGroupSize
            );
            let given = if drawn { matches!(builtin, BuiltIn::Position { .. }) } else { given };
            if !given && !is_of_subgroups(*builtin) {
                return Err(refuse(&format!("the builtin input {builtin:?}")));
            }
        }
        Ok(Self { size, drawn, inputs })
    }
}

/// The size of a tile in pixels, across and down. In a tile, every four successive lanes are a quad.
const TILE: [u32; 3] = [8, 8, 1];

fn place_in_tile(index: u32) -> [u32; 3] {
    let (quad, pixel) = (index / 4, index % 4);
    let across = TILE[0] / 2;
    [quad % across * 2 + pixel % 2, quad / across * 2 + pixel / 2, 0]
}

/// The number of tiles that cover a draw of `pixels`, across and down.
fn tiles(pixels: [u32; 3]) -> [u32; 3] {
    [pixels[0].div_ceil(TILE[0]), pixels[1].div_ceil(TILE[1]), 1]
}

/// The pixel of an invocation, from the invocation's number and the width of the draw in pixels.
#[must_use]
pub fn pixel_of(invocation: usize, across: u32) -> [u32; 2] {
    let of_tile = TILE[0] * TILE[1];
    let (tile, index) = (invocation as u32 / of_tile, invocation as u32 % of_tile);
    let columns = across.div_ceil(TILE[0]);
    let [x, y, _] = place_in_tile(index);
    [tile % columns * TILE[0] + x, tile / columns * TILE[1] + y]
}

/// Checks if the meaning of a builtin value depends on the size of subgroups.
fn is_of_subgroups(builtin: BuiltIn) -> bool {
    matches!(
        builtin,
        BuiltIn::SubgroupSize
            | BuiltIn::SubgroupInvocationId
            | BuiltIn::SubgroupId
            | BuiltIn::NumSubgroups
    )
}

struct Given {
    id: [u32; 3],
    workgroups: [u32; 3],
    subgroup: u32,
}

impl Entry {
    fn word(&self, (builtin, k): (BuiltIn, usize), index: usize, given: &Given) -> u32 {
        let Given { id, workgroups, subgroup } = *given;
        let [x, y, z] = self.size;
        let index = index as u32;
        let local = match self.drawn {
            true => place_in_tile(index),
            false => [index % x, index / x % y, index / (x * y)],
        };
        let global = |k: usize| id[k].wrapping_mul(self.size[k]).wrapping_add(local[k]);
        match builtin {
            BuiltIn::Position { .. } if k < 2 => (global(k) as f32 + 0.5).to_bits(),
            // The third component is the depth of the near plane, and the fourth is 1/w.
            BuiltIn::Position { .. } => [0.0_f32, 1.0][k - 2].to_bits(),
            BuiltIn::GlobalInvocationId => global(k),
            BuiltIn::LocalInvocationId => local[k],
            BuiltIn::LocalInvocationIndex => index,
            BuiltIn::WorkGroupId => id[k],
            BuiltIn::NumWorkGroups => workgroups[k],
            BuiltIn::SubgroupSize => subgroup,
            BuiltIn::SubgroupInvocationId => index % subgroup,
            BuiltIn::SubgroupId => index / subgroup,
            BuiltIn::NumSubgroups => (x * y * z).div_ceil(subgroup),
            _ => self.size[k],
        }
    }
}

/// The state of a workgroup that runs. After the workgroup ends, another workgroup reuses the allocated memory.
struct Room<'p, 'm, A: Arithmetic> {
    machines: Vec<Machine<'p, A>>,
    /// The number of the workgroup's first unit, counted over the whole dispatch. `first` is the number of the
    /// workgroup's first invocation. A unit consists of the invocations that one machine runs in lockstep.
    unit: u32,
    first: usize,
    /// The number of machines that are still running. `held` lists those at a barrier, each with the barrier's site.
    open: usize,
    held: Vec<(usize, u32)>,
    stores: usize,
    /// The machines that are at a barrier and have stores that haven't taken effect yet.
    draining: Vec<(usize, u32)>,
    /// The machines that have stopped before an atomic, because one of their own pending stores will change the
    /// atomic's word.
    blocked: Vec<usize>,
    /// While another workgroup runs: this workgroup's memory, by buffer slot. In the same way, `known` keeps the race
    /// detector's state for this workgroup.
    own: Vec<(usize, Buffer<'m, A>)>,
    known: OfGroup,
}

impl<'p, 'm, A: Arithmetic> Room<'p, 'm, A> {
    /// Allocates the state for a workgroup of `invocations` invocations. Each machine runs `lanes` invocations.
    fn new(code: &'p Code, options: &'p Options, invocations: usize, lanes: usize) -> Self {
        let machine =
            |first: usize| Machine::<A>::new(code, options, lanes.min(invocations - first));
        let machines = (0..invocations).step_by(lanes).map(machine).collect();
        let own = code.buffers.iter().enumerate();
        let own = own.filter(|(_, slot)| slot.binding == Binding::Workgroup);
        let bytes = |slot: &BufferSlot| vec![0; slot.least as usize].into();
        let own = own.map(|(number, slot)| (number, Buffer::new(bytes(slot), slot.written)));
        Self {
            machines,
            unit: 0,
            first: 0,
            open: 0,
            held: Vec::new(),
            stores: 0,
            draining: Vec::new(),
            blocked: Vec::new(),
            own: own.collect(),
            known: OfGroup::default(),
        }
    }

    /// Swaps `own` with the current memory of workgroups, and `known` with the detector's current state.
    fn exchange(&mut self, memory: &mut Memory<'m, A>, detector: &mut Option<Box<Detector>>) {
        for (slot, buffer) in &mut self.own {
            std::mem::swap(&mut memory.buffers[*slot], buffer);
        }
        if let Some(detector) = detector {
            detector.exchange(&mut self.known);
        }
    }
}

/// One atomic in the recorded order of a dispatch's atomics.
#[derive(Clone, Debug)]
pub struct Turn {
    /// The number of the invocation in the dispatch. Invocations are numbered workgroup by workgroup.
    pub invocation: usize,
    /// The atomic's position in the source.
    pub site: Site,
    /// The word that the atomic returned. For an atomic that returns nothing: the word that it wrote.
    pub word: u32,
    /// `true` if another operation uses the word that the atomic returned.
    pub reads: bool,
    /// The atomic that overtook this store: the same invocation ran the atomic after the store, but another
    /// invocation could see the atomic's effect first. `None` if no atomic overtook it.
    pub behind: Option<Site>,
}

/// A request to look for races during a run. `groups` lists the workgroups to run, and `explorer` chooses the order of
/// the atomics.
pub(crate) struct Watch<'w> {
    groups: Option<&'w [usize]>,
    explorer: Option<&'w mut Explorer>,
}

struct Order {
    /// The atomics so far, in the order in which they took effect. `None` if the options don't ask for the order.
    taken: Option<Vec<(Turn, Done)>>,
}

/// The largest number of recorded atomics. This is enough to compare orders, because orders usually differ early.
const MOST_TURNS: usize = 1 << 12;

impl Order {
    fn turn(&self) -> usize {
        self.taken.as_ref().map_or(0, Vec::len)
    }

    /// Records atomics. `first` is the number of the first lane's invocation.
    fn add(&mut self, code: &Code, first: usize, done: impl Iterator<Item = Done>) {
        let Some(taken) = self.taken.as_mut().filter(|all| all.len() < MOST_TURNS) else { return };
        for one in done {
            let (invocation, site) = (first + one.lane, code.sites[one.site as usize].clone());
            let behind = one.late.and_then(|late| Self::behind(taken, invocation, one, late));
            let Done { word, reads, .. } = one;
            taken.push((Turn { invocation, site, word, reads, behind }, one));
        }
    }

    /// The site of the atomic that overtook a store: the same invocation ran the atomic after the store, but another
    /// invocation could see the atomic's effect first.
    fn behind(
        taken: &[(Turn, Done)],
        invocation: usize,
        store: Done,
        (number, came): (u32, usize),
    ) -> Option<Site> {
        let is_later = |done: &Done| done.late.is_none_or(|(other, _)| other > number);
        let own = |(turn, done): &&(Turn, Done)| turn.invocation == invocation && is_later(done);
        let at = came + taken.get(came..)?.iter().position(|one| own(&one))?;
        let (turn, done) = &taken[at];
        let sees = |(other, seen): &(Turn, Done)| {
            other.invocation != invocation && [store.place, done.place].contains(&seen.place)
        };
        taken[at + 1..].iter().any(sees).then(|| turn.site.clone())
    }
}

/// The least number of workgroups that take turns, each in its own [`Room`]. If workgroups are small, more of them take
/// turns, until they have `ROOMY` invocations in total.
const LEAST_ROOMS: usize = 4;
const ROOMY: usize = 4096;

/// Switches from the workgroup `here` to the workgroup `next`: stores the memory and the detector state of `here` in
/// its room, and makes those of `next` current.
fn enter<'m, A: Arithmetic>(
    here: &mut Option<usize>,
    next: Option<usize>,
    rooms: &mut [Room<'_, 'm, A>],
    memory: &mut Memory<'m, A>,
    detector: &mut Option<Box<Detector>>,
) {
    if *here != next {
        for room in here.iter().chain(&next) {
            rooms[*room].exchange(memory, detector);
        }
        *here = next;
    }
}

/// After this number of successive turns in which units only wait, Karat assumes that they wait forever. For units of
/// several invocations, the limit is `WAITS_TOGETHER`, because the invocations of a unit may wait for each other.
const WAITS: usize = 1 << 14;
const WAITS_TOGETHER: usize = 1 << 10;

/// The number of turns between two readings of the clock.
const TURNS: usize = 1024;

impl Program {
    /// Runs a compute entry point, one workgroup after another. This is one of the orders that the specification
    /// allows. Writes to storage change `resources`.
    ///
    /// For a fragment entry point, `workgroups` is the size of a draw in pixels, across and down. [`pixel_of`] converts
    /// an invocation's case number to its pixel. The entry point can have only the inputs `position` and the builtins
    /// of subgroups.
    ///
    /// In [`Intervals`](crate::Intervals), a program that writes a buffer or a texture stops with an error, because
    /// memory can't store intervals.
    ///
    /// # Errors
    ///
    /// Fails if a resource is missing, or if an invocation runs too many loop iterations. For too many iterations, the
    /// error's `case` is the number of the invocation, counted workgroup by workgroup.
    pub fn dispatch<A: Runs>(
        &self,
        workgroups: [u32; 3],
        resources: &mut Resources,
        options: &Options,
        observer: &dyn Observer<A>,
    ) -> Result<(), Stop> {
        A::dispatch(self, workgroups, resources, options, observer)
    }

    /// Runs a compute entry point in `f32`, as [`dispatch`](Self::dispatch) does, and reports racing accesses and
    /// barriers that some invocations missed. Runs only the workgroups whose numbers, counted from 0, are in `groups`,
    /// or all workgroups if `groups` is `None`.
    ///
    /// # Errors
    ///
    /// Fails like [`dispatch`](Self::dispatch), with one exception: if a loop runs too long, returns the findings so
    /// far and the reason for the stop.
    pub fn observe_races(
        &self,
        workgroups: [u32; 3],
        resources: &mut Resources,
        options: &Options,
        groups: Option<&[usize]>,
    ) -> Result<Observed, Stop> {
        let watch = Some(Watch { groups, explorer: None });
        self.run_workgroups::<F32, false>(workgroups, resources, options, &(), watch)
    }

    /// Does the same as [`observe_races`](Self::observe_races), but in the explorer's next order instead of the
    /// schedule's order. Runs all workgroups.
    ///
    /// # Errors
    ///
    /// Fails like [`observe_races`](Self::observe_races).
    pub fn explore(
        &self,
        workgroups: [u32; 3],
        resources: &mut Resources,
        options: &Options,
        explorer: &mut Explorer,
    ) -> Result<Observed, Stop> {
        explorer.begin_dispatch();
        let watch = Some(Watch { groups: None, explorer: Some(explorer) });
        self.run_workgroups::<F32, false>(workgroups, resources, options, &(), watch)
    }

    /// Checks if the program has atomics. With atomics, the order of invocations may change the results without a race.
    #[must_use]
    pub fn has_atomics(&self) -> bool {
        let code = self.code();
        code.instructions.iter().any(|one| code.is_atomic(one.op))
    }

    /// The number of invocations of a workgroup in each direction. For a fragment entry point, each number is 1,
    /// because a draw's size is in pixels. `None` for a function.
    #[must_use]
    pub fn workgroup_size(&self) -> Option<[u32; 3]> {
        self.entry.as_ref().map(|entry| if entry.drawn { [1; 3] } else { entry.size })
    }

    /// Checks if the program's results may depend on the size of subgroups.
    #[must_use]
    pub fn has_subgroups(&self) -> bool {
        let given = |entry: &Entry| entry.inputs.iter().any(|(one, _)| is_of_subgroups(*one));
        self.code().subgroup.is_some() || self.entry.as_ref().is_some_and(given)
    }

    /// Implements [`dispatch`](Self::dispatch) for each arithmetic.
    ///
    /// Invocations that run in lockstep may wait for each other forever. If this happens while whole workgroups run in
    /// lockstep, Karat restarts the dispatch, and runs the invocations one by one.
    pub(crate) fn run_workgroups<A: Arithmetic, const SEEN: bool>(
        &self,
        workgroups: [u32; 3],
        resources: &mut Resources,
        options: &Options,
        observer: &dyn Observer<A>,
        watch: Option<Watch<'_>>,
    ) -> Result<Observed, Stop> {
        let is_explored = watch.as_ref().is_some_and(|watch| watch.explorer.is_some());
        let side_by_side = options.schedule.together == usize::MAX && !is_explored;
        let before = (side_by_side && self.has_atomics()).then(|| resources.clone());
        let groups = watch.as_ref().map(|watch| watch.groups);
        let ran = self.run_in_order::<A, SEEN>(workgroups, resources, options, observer, watch);
        let waits = match &ran {
            Ok(observed) => matches!(observed.stopped, Some(Stop::Waits { .. })),
            Err(stop) => matches!(stop, Stop::Waits { .. }),
        };
        let Some(before) = before.filter(|_| waits) else { return ran };
        *resources = before;
        let schedule = Schedule { together: 1, ..options.schedule.clone() };
        let options = Options { schedule, ..options.clone() };
        let watch = groups.map(|groups| Watch { groups, explorer: None });
        self.run_in_order::<A, SEEN>(workgroups, resources, &options, observer, watch)
    }

    fn run_in_order<A: Arithmetic, const SEEN: bool>(
        &self,
        workgroups: [u32; 3],
        resources: &mut Resources,
        options: &Options,
        observer: &dyn Observer<A>,
        watch: Option<Watch<'_>>,
    ) -> Result<Observed, Stop> {
        let Some(entry) = &self.entry else {
            return Err(Stop::Misuse(
                "this program is a function: use `call`, because `dispatch` runs only entry points",
            ));
        };
        self.has_rules::<A>()?;
        let code = self.code();
        if let (true, Some(slot)) = (A::UNDECIDED, code.buffers.iter().find(|slot| slot.written)) {
            return Err(Stop::NoRule { what: "a buffer that the shader writes", span: slot.span });
        }
        if let (true, Some(slot)) = (A::UNDECIDED, code.textures.iter().find(|slot| slot.written)) {
            return Err(Stop::NoRule { what: "a texture that the shader writes", span: slot.span });
        }
        let watch_is_on = watch.is_some();
        let pixels = workgroups;
        let workgroups = if entry.drawn { tiles(pixels) } else { workgroups };
        let [x, y, z] = entry.size;
        let invocations = (x * y * z) as usize;
        let mut observed = Observed::default();
        let schedule = &options.schedule;
        // The invocations of a subgroup must stay together. The pixels of a quad, too.
        let of = match (self.has_subgroups(), entry.drawn) {
            (true, _) => options.subgroup() as usize,
            (_, true) => 4,
            _ => 1,
        };
        let lanes = schedule.together.max(1).checked_next_multiple_of(of).unwrap_or(invocations);
        let lanes = lanes.min(invocations);
        let units = invocations.div_ceil(lanes);
        let (some, explorer) = match watch {
            Some(Watch { groups, explorer }) => (groups, explorer),
            None => (None, None),
        };
        let mut by_priority = ByPriority::new(schedule, invocations, lanes);
        let is_explored = explorer.is_some() || !schedule.turns.is_empty();
        let turns: &mut dyn Turns = match explorer {
            Some(explorer) => explorer,
            None => &mut by_priority,
        };
        let (written, textures): (Vec<_>, Vec<_>) = {
            let mut memory = self.memory::<A>(resources)?;
            let [across, down, deep] = workgroups.map(|count| count as usize);
            let all = across * down * deep;
            // If not all workgroups fit into memory, the function runs some of them before the deadline.
            let mut groups: Box<dyn Iterator<Item = usize>> = match (some, schedule.priorities) {
                (Some(some), _) => Box::new(some.iter().copied()),
                (None, Priorities::ByNumber | Priorities::InTurn) => Box::new(0..all),
                (None, Priorities::Backwards) => Box::new((0..all).rev()),
                (None, Priorities::Shuffled(seed)) => Box::new(shuffled(all, seed).into_iter()),
            };
            let yields = self.has_atomics() && (all > 1 || invocations > 1);
            let live = match (yields || units > 1, is_explored) {
                (_, true) => all,
                (true, _) => LEAST_ROOMS.max(ROOMY / invocations),
                _ => 1,
            };
            let new = |_| Room::<A>::new(code, options, invocations, lanes);
            let mut rooms: Vec<Room<'_, '_, A>> = (0..live.min(all)).map(new).collect();
            for machine in rooms.iter_mut().flat_map(|room| &mut room.machines) {
                machine.yields = yields;
                machine.relaxes = yields && schedule.stores != Stores::AtOnce;
            }
            let blank = &resources.blank;
            let mut detector =
                watch_is_on.then(|| Box::new(Detector::new(code, invocations, blank)));
            let mut order = Order { taken: options.shows_order.then(Vec::new) };
            let (mut stopped, mut work, mut count) = (None, options.work, 0_usize);
            // The number of turns in a row in which units only waited, and the number at which they count as waiting
            // forever.
            let mut idle = 0;
            let for_ever = if lanes > 1 { WAITS_TOGETHER } else { WAITS };
            let for_ever = for_ever.max(2 * rooms.len() * units);
            let mut room_of: HashMap<u32, usize> = HashMap::new();
            // A machine's next accesses to shared words, if `turns` asks for them.
            let step = |machine: &Machine<'_, A>, memory: &Memory<'_, A>, group, asks| match asks {
                true => machine.next_step(memory, group),
                false => Step::atomic(Vec::new()),
            };
            // The workgroup whose memory is current.
            let mut here: Option<usize> = None;
            let mut free: Vec<usize> = (0..rooms.len()).rev().collect();
            loop {
                while let Some(number) = free.last().copied() {
                    let Some(group) = groups.next() else { break };
                    free.pop();
                    enter(&mut here, Some(number), &mut rooms, &mut memory, &mut detector);
                    let room = &mut rooms[number];
                    room.first = group * invocations;
                    room.unit = u32::try_from(group * units).unwrap_or(u32::MAX);
                    room.open = units;
                    for (slot, buffer) in code.buffers.iter().zip(&mut memory.buffers) {
                        if slot.binding == Binding::Workgroup {
                            buffer.clear();
                        }
                    }
                    if let Some(detector) = &mut detector {
                        detector.begin(room.first);
                    }
                    let id = [group % across, group / across % down, group / (across * down)];
                    let subgroup = options.subgroup();
                    let given = Given { id: id.map(|index| index as u32), workgroups, subgroup };
                    for (own, machine) in room.machines.iter_mut().enumerate() {
                        let base = own * lanes;
                        let here = base..invocations.min(base + lanes);
                        for (&(register, scalar), &input) in
                            code.parameters.iter().zip(&entry.inputs)
                        {
                            let words = here.clone().map(|index| entry.word(input, index, &given));
                            machine.set(register.index, scalar, words);
                        }
                        machine.start(here.len());
                        if entry.drawn {
                            let is_beyond = |index: usize| {
                                let [x, y] = pixel_of(room.first + index, pixels[0]);
                                x >= pixels[0] || y >= pixels[1]
                            };
                            machine.set_helpers(here.map(is_beyond));
                        }
                        let unit = room.unit + own as u32;
                        room_of.insert(unit, number);
                        turns.ready(Actor { unit, store: 0 }, Step::default());
                    }
                }
                let Some(actor) = turns.next() else { break };
                count += 1;
                if count.is_multiple_of(TURNS)
                    && options.deadline.is_some_and(|deadline| Instant::now() >= deadline)
                {
                    return Err(Stop::Misuse(
                        "the workgroups didn't end before the deadline (KARAT_TIMEOUT)",
                    ));
                }
                if count > options.most_turns {
                    stopped =
                        Some(Stop::Misuse("the invocations execute more steps than Karat allows"));
                    break;
                }
                let number = room_of[&actor.unit];
                enter(&mut here, Some(number), &mut rooms, &mut memory, &mut detector);
                let room = &mut rooms[number];
                let (own, group) = ((actor.unit - room.unit) as usize, actor.unit / units as u32);
                let base = own * lanes;
                let machine = &mut room.machines[own];
                if let Some(detector) = &mut detector {
                    detector.goes_on(base);
                }
                idle += 1;
                if actor.store > 0 {
                    idle = 0;
                    let done = machine.settle(actor.store, &mut memory);
                    order.add(code, room.first + base, done.into_iter());
                    room.stores -= 1;
                    let unit = Actor { store: 0, ..actor };
                    if let Some(at) = room.blocked.iter().position(|one| *one == own)
                        && !machine.is_blocked(&memory)
                    {
                        room.blocked.swap_remove(at);
                        turns.ready(unit, step(machine, &memory, group, turns.asks()));
                    }
                    if machine.stores.is_empty()
                        && let Some(at) = room.draining.iter().position(|(one, _)| *one == own)
                    {
                        room.held.push(room.draining.swap_remove(at));
                    }
                } else {
                    machine.turn = order.turn();
                    (machine.work, machine.detector) = (work, detector.take());
                    let paused = machine.resume::<SEEN>(room.first + base, &mut memory, observer);
                    (work, detector) = (machine.work, machine.detector.take());
                    order.add(code, room.first + base, machine.done.drain(..));
                    for store in std::mem::take(&mut machine.issued) {
                        room.stores += 1;
                        turns.ready(Actor { store, ..actor }, machine.step_of_store(store, group));
                    }
                    match paused {
                        Ok(Pause::Atomic) => {
                            match std::mem::take(&mut machine.waits) {
                                true => turns.waits(),
                                false => idle = 0,
                            }
                            if idle > for_ever {
                                let (span, lane) = machine.place();
                                let stop = Stop::Waits { span, case: room.first + base + lane };
                                if detector.is_none() {
                                    return Err(stop);
                                }
                                stopped = Some(stop);
                                break;
                            }
                            if machine.relaxes && machine.is_blocked(&memory) {
                                room.blocked.push(own);
                            } else {
                                turns.ready(actor, step(machine, &memory, group, turns.asks()));
                            }
                        }
                        Ok(Pause::Barrier(site)) if machine.stores.is_empty() => {
                            room.held.push((own, site));
                        }
                        Ok(Pause::Barrier(site)) => room.draining.push((own, site)),
                        Ok(Pause::End) => (room.open, idle) = (room.open - 1, 0),
                        Err(spent) => {
                            let own = base + spent.lane;
                            let stop = spent.stop(room.first + own, options);
                            if detector.is_none() {
                                return Err(stop);
                            }
                            stopped = Some(stop);
                            break;
                        }
                    }
                }
                if room.open > 0 && room.held.len() == room.open && room.stores == 0 {
                    let held = std::mem::take(&mut room.held);
                    if let Some(detector) = &mut detector {
                        let here = held.iter().map(|(own, site)| (own * lanes, *site));
                        detector.release(code, &here.collect::<Vec<_>>(), lanes);
                    }
                    turns.joined(room.unit..room.unit + units as u32);
                    idle = 0;
                    for (own, _) in held {
                        let unit = room.unit + own as u32;
                        turns.ready(Actor { unit, store: 0 }, Step::default());
                    }
                }
                if room.open == 0 && room.stores == 0 {
                    free.push(number);
                }
            }
            enter(&mut here, None, &mut rooms, &mut memory, &mut detector);
            if let Some(detector) = detector {
                let rounds = options.work - work;
                let order = order.taken.into_iter().flatten().map(|(turn, _)| turn).collect();
                let turns = count as u64;
                observed = Observed { stopped, rounds, turns, order, ..detector.end(code) };
                if entry.drawn {
                    // The last tiles contain helpers, which don't count.
                    let pixels = pixels.iter().map(|count| *count as usize).product();
                    observed.invocations = observed.invocations.min(pixels);
                }
            }
            let textures = code.textures.iter().zip(memory.textures);
            let textures = textures
                .filter(|(slot, _)| slot.written)
                .map(|(slot, texture)| ((slot.group, slot.binding), texture.into_owned()))
                .collect();
            let slots = code.buffers.iter().zip(memory.buffers);
            let buffers = slots
                .filter(|(slot, _)| slot.written)
                .filter_map(|(slot, buffer)| match slot.binding {
                    Binding::Resource { group, binding } => {
                        Some(((group, binding), buffer.bytes.into_owned()))
                    }
                    Binding::Workgroup => None,
                })
                .collect();
            (buffers, textures)
        };
        resources.buffers.extend(written);
        for (at, touched) in &observed.written {
            resources.blank.entry(*at).and_modify(|own| own.clone_from(touched));
        }
        resources.textures.extend(textures);
        Ok(observed)
    }
}
