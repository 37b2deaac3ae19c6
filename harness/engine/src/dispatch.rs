//! Compute entry points: invocations of a workgroup are the lanes of one chunk.

use std::time::Instant;

use naga::{BuiltIn, Module, Span, TypeInner};

use crate::arithmetic::{Arithmetic, F32};
use crate::code::Binding;
use crate::machine::Machine;
use crate::observer::Observer;
use crate::options::Options;
use crate::program::Program;
use crate::races::{Detector, Observed};
use crate::refusal::{Refusal, Stop};
use crate::resources::Resources;
use crate::runs::Runs;

/// WebGPU's limit is 256 invocations; devices may offer this many.
const MOST_INVOCATIONS: u32 = 1024;

/// What an entry point is given, and how many invocations a workgroup has.
#[derive(Debug)]
pub(crate) struct Entry {
    size: [u32; 3],
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
            if !given && !is_of_subgroups(*builtin) {
                return Err(refuse(&format!("the builtin input {builtin:?}")));
            }
        }
        Ok(Self { size, inputs })
    }
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

impl Program {
    /// Runs a compute entry point, one workgroup after the other: that is one of the orders that
    /// the specification allows. Storage that it writes is changed in `resources`.
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
    /// which barriers weren't reached by all. Of the workgroups, counted from 0, these run; `None`: each. A schedule
    /// may give subgroups a size, and no order.
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
        if options.schedule.is_some_and(|schedule| schedule.serial || schedule.swaps > 0) {
            return Err(Stop::Misuse("races are looked for in the usual order"));
        }
        let watch = Some(groups);
        self.run_workgroups::<F32, false>(workgroups, resources, options, &(), watch)
    }

    /// Invocations of a workgroup in each direction; `None` of a function.
    #[must_use]
    pub fn workgroup_size(&self) -> Option<[u32; 3]> {
        self.entry.as_ref().map(|entry| entry.size)
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
        let [x, y, z] = entry.size;
        let invocations = (x * y * z) as usize;
        let (mut observed, mut stopped) = (Observed::default(), None);
        let (written, textures): (Vec<_>, Vec<_>) = {
            let mut memory = self.memory::<A>(resources)?;
            let [across, down, deep] = workgroups.map(|count| count as usize);
            let all = across * down * deep;
            let subgroup = options.subgroup();
            // The invocations of a subgroup stay together, and the last one, which may not be whole, stays the last.
            let of = if self.has_subgroups() { subgroup as usize } else { 1 };
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
            let new = |_| Machine::<A>::new(code, options, lanes);
            let mut machines: Vec<Machine<'_, A>> = order.chunks(lanes).map(new).collect();
            machines[0].detector = watch.map(|_| Box::new(Detector::new(code, invocations)));
            'groups: for group in groups {
                if options.deadline.is_some_and(|deadline| Instant::now() >= deadline) {
                    return Err(Stop::Misuse(
                        "workgroups that weren't done at the deadline (KARAT_TIMEOUT)",
                    ));
                }
                let id = [group % across, group / across % down, group / (across * down)];
                let id = id.map(|index| index as u32);
                for (slot, buffer) in code.buffers.iter().zip(&mut memory.buffers) {
                    if slot.binding == Binding::Workgroup {
                        buffer.clear();
                    }
                }
                let first = group * invocations;
                if let Some(detector) = &mut machines[0].detector {
                    detector.begin(first);
                }
                for (machine, own) in machines.iter_mut().zip(order.chunks(lanes)) {
                    for (&(register, scalar), &(builtin, k)) in
                        code.parameters.iter().zip(&entry.inputs)
                    {
                        let word = |index: &usize| {
                            let index = *index as u32;
                            let local = [index % x, index / x % y, index / (x * y)][k];
                            match builtin {
                                BuiltIn::GlobalInvocationId => {
                                    id[k].wrapping_mul(entry.size[k]).wrapping_add(local)
                                }
                                BuiltIn::LocalInvocationId => local,
                                BuiltIn::LocalInvocationIndex => index,
                                BuiltIn::WorkGroupId => id[k],
                                BuiltIn::NumWorkGroups => workgroups[k],
                                BuiltIn::SubgroupSize => subgroup,
                                BuiltIn::SubgroupInvocationId => index % subgroup,
                                BuiltIn::SubgroupId => index / subgroup,
                                BuiltIn::NumSubgroups => (x * y * z).div_ceil(subgroup),
                                _ => entry.size[k],
                            }
                        };
                        machine.set(register.index, scalar, own.iter().map(word));
                    }
                    machine.start(own.len());
                }
                let mut waiting: Vec<usize> = (0..machines.len()).collect();
                while !waiting.is_empty() {
                    let mut next = Vec::new();
                    for number in waiting {
                        let case = first + order[number * lanes];
                        let machine = &mut machines[number];
                        match machine.resume::<SEEN>(case, &mut memory, observer) {
                            Ok(waits) => next.extend(waits.then_some(number)),
                            Err(spent) => {
                                let own = order[number * lanes + spent.lane];
                                let stop = spent.stop(first + own, options);
                                if watch.is_none() {
                                    return Err(stop);
                                }
                                stopped = Some(stop);
                                break 'groups;
                            }
                        }
                    }
                    waiting = next;
                }
            }
            if let Some(detector) = machines[0].detector.take() {
                observed = Observed { stopped, ..detector.end(code) };
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
