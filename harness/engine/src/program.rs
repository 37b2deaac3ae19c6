//! Programs. A program is lowered once from a module, and can run many times.

use std::borrow::Cow;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use naga::valid::ModuleInfo;
use naga::{Module, ShaderStage, Span};

use crate::arithmetic::{Arithmetic, Intervals};
use crate::code::{Binding, Code, Site};
use crate::lower::{Lower, Settings};
use crate::machine::{Buffer, Machine, Memory};
use crate::observer::Observer;
use crate::options::Options;
use crate::parallel;
use crate::refusal::{Refusal, Stop};
use crate::resources::Resources;
use crate::results::Results;
use crate::runs::Runs;
use crate::scalar::{File, Scalar};

/// The number of cases that the engine runs together, which is the number of lanes of a register. The engine decodes
/// each operation once for all of these cases. A register of floats needs 1 KiB, so about thirty registers fit into a
/// first-level cache.
const LANES: usize = 256;

/// The smallest number of cases for which a register has `2 * LANES` lanes. With twice as many lanes, the engine
/// decodes operations less often. With this many cases, all cores still have work.
const MANY: usize = 16_384;

/// The largest number of registers of a program: twice as many as the largest variable may need. With this number of
/// registers, a thread needs 32 MiB for floats, or 64 MiB if there are at least [`MANY`] cases.
const MOST_REGISTERS: u32 = 1 << 15;

/// The number of lanes is a multiple of this constant: with fewer than [`LANES`] cases, the engine rounds the number of
/// cases up to the next multiple of 16. 16 lanes are two AVX vectors.
const STEP: usize = 16;

/// A lowered function or entry point.
#[derive(Debug)]
pub struct Program {
    code: Code,
    pub(crate) entry: Option<crate::dispatch::Entry>,
}

impl Program {
    /// Lowers the function `name` of a valid module.
    ///
    /// # Errors
    ///
    /// Returns an error if the engine can't execute the function. The error names the first construct that it can't
    /// execute.
    pub fn function(
        module: &Module,
        info: &ModuleInfo,
        name: &str,
        settings: &Settings,
    ) -> Result<Self, Refusal> {
        let mut functions = module.functions.iter();
        let Some((handle, function)) = functions.find(|(_, f)| f.name.as_deref() == Some(name))
        else {
            return Err(Refusal::new(
                format!("the function `{name}`, because the module has no such function"),
                Span::UNDEFINED,
            ));
        };
        let code =
            Lower::new(module, info, settings, false).program(function, &info[handle], name)?;
        Self::of(code, None)
    }

    /// Lowers the compute or fragment entry point `name` of a valid module.
    ///
    /// # Errors
    ///
    /// Returns an error if the engine can't execute the entry point. The error names the first construct that it can't
    /// execute.
    pub fn entry_point(
        module: &Module,
        info: &ModuleInfo,
        name: &str,
        settings: &Settings,
    ) -> Result<Self, Refusal> {
        let mut points = module.entry_points.iter().enumerate();
        let Some((index, point)) = points.find(|(_, point)| point.name == name) else {
            let what =
                format!("the entry point `{name}`, because the module has no such entry point");
            return Err(Refusal::new(what, Span::UNDEFINED));
        };
        if !matches!(point.stage, ShaderStage::Compute | ShaderStage::Fragment) {
            return Err(Refusal::new(
                format!("entry points of the stage {:?}", point.stage),
                Span::UNDEFINED,
            ));
        }
        let lower = Lower::new(module, info, settings, true);
        let code = lower.entry_point(point, info.get_entry_point(index))?;
        let entry = crate::dispatch::Entry::of(module, point, code.workgroup)?;
        Self::of(code, Some(entry))
    }

    fn of(code: Code, entry: Option<crate::dispatch::Entry>) -> Result<Self, Refusal> {
        let code = crate::allocate::allocated(code);
        let registers: u32 = code.registers.iter().sum();
        if registers > MOST_REGISTERS {
            let what =
                format!("a program that needs {registers} registers (at most {MOST_REGISTERS})");
            return Err(Refusal::new(what, Span::UNDEFINED));
        }
        Ok(Self { code, entry })
    }

    /// The type of each scalar in a row of arguments.
    #[must_use]
    pub fn parameters(&self) -> Vec<Scalar> {
        self.code.parameters.iter().map(|(_, scalar)| *scalar).collect()
    }

    /// The type of each scalar in a row of results.
    #[must_use]
    pub fn results(&self) -> Vec<Scalar> {
        self.code.results.iter().map(|(_, scalar)| *scalar).collect()
    }

    /// The positions of the program's operations in the source.
    #[must_use]
    pub fn sites(&self) -> &[Site] {
        &self.code.sites
    }

    /// The sites of the operations that [`Observer::reached`](crate::Observer::reached) may report. A site may occur
    /// twice. The iterator leaves out the sites of constants.
    pub fn operations(&self) -> impl Iterator<Item = &Site> {
        let all = self.code.instructions.iter().filter(|one| !one.op.is_an_end());
        all.map(|one| &self.code.sites[one.site as usize])
    }

    /// The site of the operation that caused `interval`, an unbounded result of this program.
    #[must_use]
    pub fn cause(&self, interval: crate::Interval) -> Option<&Site> {
        self.code.sites.get(interval.cause()? as usize)
    }

    /// Checks if both programs consist of the same operations, and so compute the same results. The positions of the
    /// operations in the source may differ. Unused code is ignored.
    #[must_use]
    pub fn is_same(&self, other: &Self) -> bool {
        let without_places = |code: &Code| {
            let mut code = code.clone();
            code.sites.clear();
            code.statements.clear();
            let pool = std::mem::take(&mut code.pool);
            for one in &mut code.instructions {
                let start = one.at as usize;
                (one.site, one.at) = (0, code.pool.len() as u32);
                code.pool.extend(&pool[start..start + one.count as usize]);
            }
            let buffers = code.buffers.iter_mut().map(|slot| &mut slot.span);
            let handles = code.textures.iter_mut().chain(&mut code.samplers);
            buffers
                .chain(handles.map(|slot| &mut slot.span))
                .for_each(|span| *span = Span::UNDEFINED);
            [&mut code.subgroup, &mut code.half]
                .into_iter()
                .for_each(|at| *at = at.map(|_| Span::UNDEFINED));
            format!("{code:?}")
        };
        without_places(&self.code) == without_places(&other.code)
    }

    /// The number of the program's operations, and the numbers of its registers of floats, integers and booleans.
    #[must_use]
    pub fn size(&self) -> (usize, [u32; 3]) {
        (self.code.instructions.len(), self.code.registers)
    }

    pub(crate) fn code(&self) -> &Code {
        &self.code
    }

    /// Calls the function for `cases` rows of arguments.
    ///
    /// # Errors
    ///
    /// Returns an error if the rows are incomplete, if a resource is missing, or if a case runs too many loop
    /// iterations.
    pub fn call<A: Runs>(
        &self,
        cases: usize,
        rows: &[u32],
        resources: &Resources,
        options: &Options,
        observer: &dyn Observer<A>,
    ) -> Result<Results<A>, Stop> {
        A::call(self, &Call { cases, rows, to: None, resources, options }, observer)
    }

    /// Calls the function in interval arithmetic. The interval of an argument begins at the argument's value in `rows`
    /// and ends at its value in `to`.
    ///
    /// # Errors
    ///
    /// Returns the same errors as [`call`](Self::call).
    pub fn call_between(
        &self,
        cases: usize,
        [rows, to]: [&[u32]; 2],
        resources: &Resources,
        options: &Options,
        observer: &dyn Observer<Intervals>,
    ) -> Result<Results<Intervals>, Stop> {
        if to.len() != rows.len() {
            let width = self.code.parameters.len();
            return Err(Stop::Rows { found: to.len(), width, cases });
        }
        Intervals::call(self, &Call { cases, rows, to: Some(to), resources, options }, observer)
    }

    /// Implements [`call`](Self::call). The Rust compiler makes one copy of this function for each arithmetic.
    pub(crate) fn run<A: Arithmetic, const SEEN: bool>(
        &self,
        call: &Call<'_>,
        observer: &dyn Observer<A>,
    ) -> Result<Results<A>, Stop> {
        let Call { cases, rows, to, resources, options } = *call;
        if self.entry.is_some() {
            return Err(Stop::Misuse(
                "this program is an entry point: use `dispatch`, because `call` runs only functions",
            ));
        }
        let width = self.code.parameters.len();
        if Some(rows.len()) != width.checked_mul(cases) {
            return Err(Stop::Rows { found: rows.len(), width, cases });
        }
        self.has_rules::<A>()?;
        let memory = self.memory::<A>(resources)?;
        let scalars = self.results();
        let most = if cases < MANY { LANES } else { 2 * LANES };
        let chunks = cases.div_ceil(most);
        // After a chunk fails, later chunks needn't run. An earlier chunk may still fail, and then its error is
        // returned.
        let failed = AtomicUsize::new(usize::MAX);
        let lanes = most.min(cases.next_multiple_of(STEP));
        let run = |state: &mut (Machine<'_, A>, Memory<'_, A>), chunk: usize| {
            if failed.load(Ordering::Relaxed) < chunk {
                return Ok(Results {
                    scalars: Vec::new(),
                    floats: vec![],
                    ints: vec![],
                    bools: vec![],
                    cases: 0,
                    long: vec![],
                });
            }
            let first = chunk * most;
            let active = most.min(cases - first);
            let (machine, memory) = state;
            let chunk_rows = &rows[first * width..(first + active) * width];
            for (k, &(register, scalar)) in self.code.parameters.iter().enumerate() {
                let column = chunk_rows.iter().skip(k).step_by(width).copied();
                machine.set(register.index, scalar, column);
            }
            if let Some(to) = to {
                let chunk_rows = &to[first * width..(first + active) * width];
                for (k, &(register, scalar)) in self.code.parameters.iter().enumerate() {
                    let column = chunk_rows.iter().skip(k).step_by(width).copied();
                    machine.widen(register.index, scalar, column);
                }
            }
            match machine.run::<SEEN>(active, first, memory, observer) {
                Ok(()) => Ok(self.collect(machine, (first, active))),
                Err(spent) => {
                    failed.fetch_min(chunk, Ordering::Relaxed);
                    let case = first + spent.lane;
                    Err(spent.stop(case, options))
                }
            }
        };
        let machine = || (Machine::<A>::new(&self.code, options, lanes), memory.clone());
        let parts: Vec<OnceLock<Result<Results<A>, Stop>>> =
            (0..chunks).map(|_| OnceLock::new()).collect();
        parallel::run(chunks, &|next| {
            let mut own = None;
            while let Some(chunk) = next() {
                let own = own.get_or_insert_with(machine);
                parts[chunk].get_or_init(|| run(own, chunk));
            }
        });
        let mut all =
            Results { scalars, floats: vec![], ints: vec![], bools: vec![], cases, long: vec![] };
        for part in parts {
            let part = part.into_inner().expect("each chunk has run")?;
            all.floats.extend_from_slice(&part.floats);
            all.ints.extend_from_slice(&part.ints);
            all.bools.extend_from_slice(&part.bools);
            all.long.extend(part.long);
        }
        Ok(all)
    }

    fn collect<A: Arithmetic>(
        &self,
        machine: &Machine<'_, A>,
        (first, active): (usize, usize),
    ) -> Results<A> {
        let of = |file: File| self.code.results.iter().filter(move |(r, _)| r.file == file);
        let floats: Vec<&[A::Float]> =
            of(File::Float).map(|(r, _)| machine.floats.get(r.index)).collect();
        let ints: Vec<&[A::Int]> = of(File::Int).map(|(r, _)| machine.ints.get(r.index)).collect();
        let bools: Vec<&[A::Bool]> =
            of(File::Bool).map(|(r, _)| machine.bools.get(r.index)).collect();
        Results {
            scalars: Vec::new(),
            floats: interleaved(&floats, active),
            ints: interleaved(&ints, active),
            bools: interleaved(&bools, active),
            cases: active,
            long: machine.long.iter().map(|(lane, span)| (first + lane, *span)).collect(),
        }
    }

    /// Checks that arithmetic `A` has a rule for each operation of the program.
    pub(crate) fn has_rules<A: Arithmetic>(&self) -> Result<(), Stop> {
        match (self.code.half, self.code.subgroup) {
            (Some(span), _) if A::UNDECIDED => {
                Err(Stop::NoRule { what: "this operation on `f16` values", span })
            }
            (_, Some(span)) if A::UNDECIDED => {
                Err(Stop::NoRule { what: "subgroup operations", span })
            }
            _ => Ok(()),
        }
    }

    pub(crate) fn memory<'r, A: Arithmetic>(
        &self,
        resources: &'r Resources,
    ) -> Result<Memory<'r, A>, Stop> {
        let mut memory = Memory { buffers: Vec::new(), textures: Vec::new(), samplers: Vec::new() };
        for slot in &self.code.buffers {
            let bytes = match slot.binding {
                Binding::Workgroup => Cow::Owned(vec![0; slot.least as usize]),
                Binding::Resource { group, binding } => {
                    let Some(bytes) = resources.buffers.get(&(group, binding)) else {
                        let (name, span) = (slot.name.clone(), slot.span);
                        return Err(Stop::Missing { kind: "buffer", name, group, binding, span });
                    };
                    Cow::Borrowed(bytes.as_slice())
                }
            };
            if bytes.len() < slot.least as usize {
                let (found, needed) = (bytes.len(), slot.least as usize);
                return Err(Stop::Short { name: slot.name.clone(), found, needed });
            }
            memory.buffers.push(Buffer::new(bytes, slot.written));
        }
        for slot in &self.code.textures {
            match resources.textures.get(&(slot.group, slot.binding)) {
                Some(texture) if slot.image.is_some_and(|image| texture.is(image)) => {
                    memory.textures.push(Cow::Borrowed(texture));
                }
                Some(_) => return Err(slot.missing("texture with the dimension and texel type of")),
                None => return Err(slot.missing("texture")),
            }
        }
        for slot in &self.code.samplers {
            match resources.samplers.get(&(slot.group, slot.binding)) {
                Some(sampler) => memory.samplers.push(sampler),
                None => return Err(slot.missing("sampler")),
            }
        }
        Ok(memory)
    }
}

/// The input of a call.
#[derive(Debug)]
pub struct Call<'c> {
    pub(crate) cases: usize,
    pub(crate) rows: &'c [u32],
    /// The upper ends of the arguments' intervals, for a call in interval arithmetic. `rows` has the lower ends.
    pub(crate) to: Option<&'c [u32]>,
    pub(crate) resources: &'c Resources,
    pub(crate) options: &'c Options,
}

/// Runs a program without parameters and resources, and returns the first word of its result.
pub(crate) fn evaluated(code: Code) -> Option<u32> {
    let program = Program { code, entry: None };
    let (resources, options) = (Resources::new(), Options::default());
    let results = program.call::<crate::arithmetic::F32>(1, &[], &resources, &options, &());
    results.ok()?.words().first().copied()
}

impl crate::code::HandleSlot {
    fn missing(&self, kind: &'static str) -> Stop {
        let (name, span) = (self.name.clone(), self.span);
        Stop::Missing { kind, name, group: self.group, binding: self.binding, span }
    }
}

/// Converts columns to rows, one row for each of the first `active` lanes.
fn interleaved<T: Copy>(columns: &[&[T]], active: usize) -> Vec<T> {
    let mut rows = Vec::with_capacity(columns.len() * active);
    for lane in 0..active {
        rows.extend(columns.iter().map(|column| column[lane]));
    }
    rows
}
