//! Compute entry points: invocations of a workgroup are the lanes of one chunk. And fragment entry points, whose workgroups
//! are tiles of pixels.

use std::time::Instant;

use naga::{BuiltIn, Module, Span, TypeInner};

use crate::arithmetic::{Arithmetic, F32};
use crate::code::{Binding, BufferSlot, Code};
use crate::machine::{Buffer, Machine, Memory, Pause};
use crate::observer::Observer;
use crate::options::Options;
use crate::program::Program;
use crate::races::{Detector, Observed, OfGroup};
use crate::refusal::{Refusal, Stop};
use crate::resources::Resources;
use crate::runs::Runs;
use crate::schedule::Schedule;

/// WebGPU's limit is 256 invocations; devices may offer this many.
const MOST_INVOCATIONS: u32 = 1024;

/// What an entry point is given, and how many invocations a workgroup has.
#[derive(Debug)]
pub(crate) struct Entry {
    size: [u32; 3],
    /// True of a fragment entry point: workgroups are tiles, and invocations the pixels of their quads.
    drawn: bool,
    /// For each scalar of the parameters, the builtin and its component.
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
            return Err(refuse("workgroups of no invocations"));
        }
        let invocations = size.iter().fold(1u32, |n, k| n.saturating_mul(*k));
        if invocations > MOST_INVOCATIONS {
            return Err(refuse(&format!("workgroups of {invocations} invocations")));
        }
        let mut inputs = Vec::new();
        let mut add = |binding: &Option<naga::Binding>, inner: &TypeInner| {
            let Some(naga::Binding::BuiltIn(builtin)) = binding else {
                return Err(refuse("an input that is no builtin"));
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

/// Pixels of a tile, across and down. Four lanes in a row are a quad.
const TILE: [u32; 3] = [8, 8, 1];

/// The place of an invocation of a tile in it.
fn place_in_tile(index: u32) -> [u32; 3] {
    let (quad, pixel) = (index / 4, index % 4);
    let across = TILE[0] / 2;
    [quad % across * 2 + pixel % 2, quad / across * 2 + pixel / 2, 0]
}

/// The tiles of a draw over so many pixels across and down.
fn tiles(pixels: [u32; 3]) -> [u32; 3] {
    [pixels[0].div_ceil(TILE[0]), pixels[1].div_ceil(TILE[1]), 1]
}

/// The pixel of an invocation, by its number and the pixels of the draw across.
#[must_use]
pub fn pixel_of(invocation: usize, across: u32) -> [u32; 2] {
    let of_tile = TILE[0] * TILE[1];
    let (tile, index) = (invocation as u32 / of_tile, invocation as u32 % of_tile);
    let columns = across.div_ceil(TILE[0]);
    let [x, y, _] = place_in_tile(index);
    [tile % columns * TILE[0] + x, tile / columns * TILE[1] + y]
}

/// True of a builtin value whose meaning depends on the size of subgroups.
fn is_of_subgroups(builtin: BuiltIn) -> bool {
    matches!(
        builtin,
        BuiltIn::SubgroupSize
            | BuiltIn::SubgroupInvocationId
            | BuiltIn::SubgroupId
            | BuiltIn::NumSubgroups
    )
}

/// The inputs that all invocations of a workgroup have alike.
struct Given {
    id: [u32; 3],
    workgroups: [u32; 3],
    subgroup: u32,
}

impl Entry {
    /// The word of an input, for an invocation of a workgroup.
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
            // The depth of the near side, and 1/w.
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

/// The turns of machines in a shuffled schedule, which chance decides.
struct Turns(Option<u64>);

impl Turns {
    fn of(schedule: Option<Schedule>) -> Self {
        Self(schedule.map(|schedule| schedule.seed).filter(|seed| *seed != 0))
    }

    /// True if a machine goes on; otherwise others do first.
    fn goes_on(&mut self) -> bool {
        let Some(state) = &mut self.0 else { return true };
        crate::schedule::next(state) & 1 == 1
    }
}

/// A workgroup that runs.
struct Running<'p, 'm, A: Arithmetic> {
    machines: Vec<Machine<'p, A>>,
    /// The machines that can go on, by their numbers, and those that wait at a barrier.
    ready: Vec<usize>,
    held: Vec<usize>,
    /// The number of its first invocation.
    first: usize,
    /// True if others run beside it. Then the fields below are in use while it runs, and kept here otherwise.
    beside: bool,
    /// Its workgroup memory, by its slots.
    own: Vec<(usize, Buffer<'m, A>)>,
    /// The detector's knowledge of it.
    known: OfGroup,
}

impl<'p, 'm, A: Arithmetic> Running<'p, 'm, A> {
    /// Room for a workgroup of so many, of which so many lanes share a machine.
    fn new(
        code: &'p Code,
        options: &'p Options,
        order: &[usize],
        lanes: usize,
        (beside, yields): (bool, bool),
    ) -> Self {
        let machine = |own: &[usize]| {
            let mut machine = Machine::<A>::new(code, options, lanes);
            machine.yields = yields;
            if options.schedule.is_some() {
                machine.order = own.to_vec();
            }
            machine
        };
        let machines = order.chunks(lanes).map(machine).collect();
        let own = code.buffers.iter().enumerate();
        let own = own.filter(|(_, slot)| slot.binding == Binding::Workgroup);
        let bytes = |slot: &BufferSlot| vec![0; slot.least as usize].into();
        let own = own.map(|(number, slot)| (number, Buffer::new(bytes(slot), slot.written)));
        let own = if beside { own.collect() } else { Vec::new() };
        let (ready, held, known) = (Vec::new(), Vec::new(), OfGroup::default());
        Self { machines, ready, held, first: 0, beside, own, known }
    }

    /// True if a machine hasn't ended.
    fn has_more(&self) -> bool {
        !self.ready.is_empty() || !self.held.is_empty()
    }

    /// Swaps its memory, and the detector's knowledge of it, with what is in use.
    fn exchange(&mut self, memory: &mut Memory<'m, A>, detector: &mut Option<Box<Detector>>) {
        if !self.beside {
            return;
        }
        for (slot, buffer) in &mut self.own {
            std::mem::swap(&mut memory.buffers[*slot], buffer);
        }
        if let Some(detector) = detector {
            detector.exchange(&mut self.known);
        }
    }
}

impl Program {
    /// Runs a compute entry point, one workgroup after the other: that is one of the orders that
    /// the specification allows. Storage that it writes is changed in `resources`.
    ///
    /// Of a fragment entry point `workgroups` are the pixels of a draw across and down, and the case of an invocation is the
    /// number that [`pixel_of`] takes. It is given its position and nothing else.
    ///
    /// In intervals nothing can be written; such a program is stopped.
    ///
    /// # Errors
    ///
    /// When a resource is missing, or an invocation spends its fuel; its case is then the index of
    /// the invocation among all, workgroup after workgroup.
    pub fn dispatch<A: Runs>(
        &self,
        workgroups: [u32; 3],
        resources: &mut Resources,
        options: &Options,
        observer: &dyn Observer<A>,
    ) -> Result<(), Stop> {
        A::dispatch(self, workgroups, resources, options, observer)
    }

    /// Runs a compute entry point as [`dispatch`](Self::dispatch) does in `f32`, and says which accesses race and
    /// which barriers weren't reached by all. Of the workgroups, counted from 0, these run; `None`: each. Where a
    /// schedule is serial, barriers aren't looked at.
    ///
    /// # Errors
    ///
    /// As [`dispatch`](Self::dispatch), but for loops that take too long: then the findings until there have the stop.
    pub fn observe_races(
        &self,
        workgroups: [u32; 3],
        resources: &mut Resources,
        options: &Options,
        groups: Option<&[usize]>,
    ) -> Result<Observed, Stop> {
        let watch = Some(groups);
        self.run_workgroups::<F32, false>(workgroups, resources, options, &(), watch)
    }

    /// Invocations of a workgroup in each direction; 1 of a draw, whose pixels are its workgroups. `None` of a function.
    #[must_use]
    pub fn workgroup_size(&self) -> Option<[u32; 3]> {
        self.entry.as_ref().map(|entry| if entry.drawn { [1; 3] } else { entry.size })
    }

    /// True of an entry point whose results may depend on the size of subgroups.
    #[must_use]
    pub fn has_subgroups(&self) -> bool {
        let given = |entry: &Entry| entry.inputs.iter().any(|(one, _)| is_of_subgroups(*one));
        self.code().subgroup.is_some() || self.entry.as_ref().is_some_and(given)
    }

    /// [`dispatch`](Self::dispatch), compiled once for each arithmetic.
    pub(crate) fn run_workgroups<A: Arithmetic, const SEEN: bool>(
        &self,
        workgroups: [u32; 3],
        resources: &mut Resources,
        options: &Options,
        observer: &dyn Observer<A>,
        watch: Option<Option<&[usize]>>,
    ) -> Result<Observed, Stop> {
        let Some(entry) = &self.entry else {
            return Err(Stop::Misuse("a function is called, not dispatched"));
        };
        self.has_rules::<A>()?;
        let code = self.code();
        if let (true, Some(slot)) = (A::UNDECIDED, code.buffers.iter().find(|slot| slot.written)) {
            return Err(Stop::NoRule { what: "a buffer that is written", span: slot.span });
        }
        if let (true, Some(slot)) = (A::UNDECIDED, code.textures.iter().find(|slot| slot.written)) {
            return Err(Stop::NoRule { what: "a texture that is written", span: slot.span });
        }
        let pixels = workgroups;
        let workgroups = if entry.drawn { tiles(pixels) } else { workgroups };
        let [x, y, z] = entry.size;
        let invocations = (x * y * z) as usize;
        let (mut observed, mut stopped) = (Observed::default(), None);
        let (written, textures): (Vec<_>, Vec<_>) = {
            let mut memory = self.memory::<A>(resources)?;
            let [across, down, deep] = workgroups.map(|count| count as usize);
            let all = across * down * deep;
            let subgroup = options.subgroup();
            // The invocations of a subgroup stay together, as do the pixels of a quad. The last one may not be whole, and stays
            // the last.
            let of = match (self.has_subgroups(), entry.drawn) {
                (true, _) => subgroup as usize,
                (_, true) => 4,
                _ => 1,
            };
            let (shuffled, order) = match options.schedule {
                Some(schedule) => {
                    let (groups, order) = schedule.orders(all, invocations / of);
                    (Some(groups), order)
                }
                None => (None, (0..invocations / of).collect()),
            };
            let together = |number: usize| number * of..number * of + of;
            let rest = invocations / of * of..invocations;
            let order: Vec<usize> = order.into_iter().flat_map(together).chain(rest).collect();
            // Of more than fit into memory some run before the deadline.
            let groups: Box<dyn Iterator<Item = usize>> = match (watch.flatten(), &shuffled) {
                (Some(some), _) => Box::new(some.iter().copied()),
                (None, Some(shuffled)) => Box::new(shuffled.iter().copied()),
                (None, None) => Box::new(0..all),
            };
            // The invocations of one machine go from operation to operation side by side.
            let serial = options.schedule.is_some_and(|schedule| schedule.serial);
            let lanes = if serial { of } else { invocations };
            let beside = options.beside.clamp(1, all.max(1));
            let yields = options.beside > 1 && (serial || beside > 1);
            let mut turns = Turns::of(options.schedule.filter(|_| yields));
            let new = |_| Running::<A>::new(code, options, &order, lanes, (beside > 1, yields));
            let mut running: Vec<Running<'_, '_, A>> = (0..beside).map(new).collect();
            let mut detector = watch.map(|_| Box::new(Detector::new(code, &order, serial)));
            let mut groups = groups;
            let mut work = options.work;
            'groups: loop {
                if options.deadline.is_some_and(|deadline| Instant::now() >= deadline) {
                    return Err(Stop::Misuse(
                        "workgroups that weren't done at the deadline (KARAT_TIMEOUT)",
                    ));
                }
                let mut count = 0;
                for (one, group) in running.iter_mut().zip(&mut groups) {
                    count += 1;
                    one.first = group * invocations;
                    one.ready = (0..one.machines.len()).collect();
                    one.exchange(&mut memory, &mut detector);
                    for (slot, buffer) in code.buffers.iter().zip(&mut memory.buffers) {
                        if slot.binding == Binding::Workgroup {
                            buffer.clear();
                        }
                    }
                    if let Some(detector) = &mut detector {
                        detector.begin(one.first);
                    }
                    one.exchange(&mut memory, &mut detector);
                    let id = [group % across, group / across % down, group / (across * down)];
                    let given = Given { id: id.map(|index| index as u32), workgroups, subgroup };
                    for (machine, own) in one.machines.iter_mut().zip(order.chunks(lanes)) {
                        for (&(register, scalar), &input) in
                            code.parameters.iter().zip(&entry.inputs)
                        {
                            let words = own.iter().map(|index| entry.word(input, *index, &given));
                            machine.set(register.index, scalar, words);
                        }
                        machine.start(own.len());
                        if entry.drawn {
                            let is_beyond = |index: &usize| {
                                let [x, y] = pixel_of(one.first + index, pixels[0]);
                                x >= pixels[0] || y >= pixels[1]
                            };
                            machine.set_helpers(own.iter().map(is_beyond));
                        }
                    }
                }
                if count == 0 {
                    break;
                }
                while running[..count].iter().any(Running::has_more) {
                    for one in running[..count].iter_mut().filter(|one| one.has_more()) {
                        one.exchange(&mut memory, &mut detector);
                        if one.ready.is_empty() {
                            std::mem::swap(&mut one.ready, &mut one.held);
                            detector.iter_mut().for_each(|one| one.release());
                        }
                        for number in std::mem::take(&mut one.ready) {
                            if !turns.goes_on() {
                                one.ready.push(number);
                                continue;
                            }
                            let case = one.first + order[number * lanes];
                            let machine = &mut one.machines[number];
                            if let Some(detector) = &mut detector {
                                detector.goes_on(number * lanes);
                            }
                            (machine.work, machine.detector) = (work, detector.take());
                            let paused = machine.resume::<SEEN>(case, &mut memory, observer);
                            (work, detector) = (machine.work, machine.detector.take());
                            match paused {
                                Ok(Pause::Atomic) => one.ready.push(number),
                                Ok(Pause::Barrier) => one.held.push(number),
                                Ok(Pause::End) => {}
                                Err(spent) => {
                                    let own = order[number * lanes + spent.lane];
                                    let stop = spent.stop(one.first + own, options);
                                    if watch.is_none() {
                                        return Err(stop);
                                    }
                                    stopped = Some(stop);
                                    break 'groups;
                                }
                            }
                        }
                        one.exchange(&mut memory, &mut detector);
                    }
                }
            }
            if let Some(detector) = detector {
                let rounds = options.work - work;
                observed = Observed { stopped, rounds, ..detector.end(code) };
                if entry.drawn {
                    // Of the last tiles some are helpers.
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
        resources.textures.extend(textures);
        Ok(observed)
    }
}
