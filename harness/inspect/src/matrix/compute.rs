//! Runs compute entry points on each column, and compares the results in their buffers and textures.

use karat::fixture::{self, Fixture};
use karat::path::Path;
use karat::unstable::dispatch::{Afterwards, DispatchError, Pass, Passes};
use karat::unstable::executor;
use karat::unstable::fixture::{bytes, laid_out, levels};
use karat::unstable::interpret::{Runner, dispatch_briefly, strays};
use karat::unstable::path::{self, Device};
use karat::unstable::path::{Api, Via};
use karat::unstable::probe::ProbeError;
use karat::unstable::reflect::{Binding, BindingKind, Texels, Watched};
use karat_core::diagnostic::Diagnostic;
use karat_core::tolerance::Tolerance;
use karat_core::value::Scalar;

use super::execute::{Comparison, conclude, flushed, not_run};
use super::suspect::{self, Side};
use super::{Buffer, Cell, Request, Status, Stop};
use crate::limits::ORDERS;

/// Runs a compute entry point on each column whose translation is valid, and compares the 32-bit words that the entry
/// point writes.
pub(super) fn run_entry_point_on_each(
    request: &Request,
    passes: Result<&Passes, &String>,
    cells: &mut [Cell],
) {
    let mut ran: Vec<(usize, Vec<u32>)> = Vec::new();
    // If the entry point doesn't end on one column, the other columns don't run it.
    let mut endless: Option<Stop> = None;
    for (index, column) in request.columns.iter().enumerate() {
        let cell = &mut cells[index];
        if cell.stopped.is_some() {
            continue;
        }
        if let Some(stop) = endless.as_ref().filter(|_| column.path.is_some()) {
            cell.stopped = Some(stop.clone());
            continue;
        }
        let words = match (passes, column.path) {
            (_, None) => Err(Stop::Unavailable(column.without_path())),
            (Err(why), _) => Err(Stop::NotRun(why.clone())),
            (Ok(passes), Some(path)) => written(path, passes).map_err(|error| match error {
                Unwritten::Stop(stop) => stop,
                Unwritten::Error(error) => {
                    let rounds = matches!(
                        error,
                        DispatchError::Rounds(_) | DispatchError::Probe(ProbeError::Rounds { .. })
                    );
                    let stop = Stop::NotRun(match error {
                        DispatchError::Probe(error) => not_run(error),
                        other => other.to_string(),
                    });
                    if rounds {
                        endless = Some(stop.clone());
                    }
                    stop
                }
            }),
        };
        match words {
            Ok(words) => {
                cell.status = Some(Status::Executed);
                ran.push((index, words));
            }
            Err(stop) => cell.stopped = Some(stop),
        }
    }
    let before = passes.map_or_else(|_| Vec::new(), initial);
    // If no column changed a word, all words are equal, which proves nothing.
    if ran.iter().all(|(_, words)| *words == before) {
        for (index, _) in &ran {
            let what = if before.is_empty() { "the entry point writes nothing" } else { UNCHANGED };
            cells[*index].stopped = Some(Stop::NothingToCompare(what.to_owned()));
        }
        return;
    }
    let Some(((first, expected), others)) = ran.split_first() else { return };
    let (steps, floats) =
        passes.map_or_else(|_| Default::default(), |all| (steps(all), floats(all)));
    let are_apart = |at: &usize, was: u32, is: u32| {
        let step = steps.get(*at).copied().unwrap_or_default();
        let is_float = floats.get(*at).copied().unwrap_or_default();
        let [was, is] = [was, is].map(|word| if is_float { flushed(word) } else { word });
        !same_word(was, is, &request.within) && !is_next(was, is, step)
    };
    let differs = |at: &usize, actual: &[u32]| are_apart(at, expected[*at], actual[*at]);
    // All columns have the same resources. If no words differ, it doesn't matter which results WGSL leaves open.
    let all = 0..expected.len();
    let differ = others.iter().any(|(_, actual)| all.clone().any(|at| differs(&at, actual)));
    let open = match passes {
        Ok(passes) if differ => open(passes, expected, &floats),
        _ => Ok(vec![false; expected.len()]),
    };
    let mut agreeing = None;
    for (index, actual) in others {
        let (baseline, cell) = (request.columns[*first], &mut cells[*index]);
        cell.against = Some(baseline.to_string());
        let (left_open, places): (Vec<usize>, Vec<usize>) = all
            .clone()
            .filter(|at| differs(at, actual))
            .partition(|at| open.as_ref().is_ok_and(|open| open[*at]));
        let compared = expected.len() - left_open.len();
        (cell.compared, cell.differing, cell.open) = (compared, places.len(), left_open.len());
        if let Some(place) = places.first() {
            let unknown = open.as_ref().err().map_or_else(String::new, |reason| {
                format!("; Karat can't tell which words WGSL leaves undefined: {reason}")
            });
            cell.stopped = Some(Stop::Differs(format!(
                "{} of {compared} words that the pass writes differ from `{baseline}`: word {place} is \
                 {:#010x}, and on `{baseline}` {:#010x}{unknown}",
                places.len(),
                actual[*place],
                expected[*place]
            )));
            let is_near = |was: u32, is: u32| !are_apart(place, was, is);
            let side = |(index, words): &(usize, Vec<u32>)| {
                let own = words[*place];
                let side = match (is_near(expected[*place], own), is_near(actual[*place], own)) {
                    (true, false) => Side::First,
                    (false, true) => Side::Other,
                    _ => Side::Neither,
                };
                (request.columns[*index].to_string(), side)
            };
            suspect::name(cell, &ran.iter().map(side).collect::<Vec<_>>());
        } else if compared == 0 {
            let none = "WGSL doesn't define the value of any word that the pass writes".to_owned();
            cell.stopped = Some(Stop::NothingToCompare(none));
        } else {
            cell.status = Some(Status::Agrees);
            agreeing = Some(compared);
        }
    }
    let agreeing = agreeing.map(|compared| Comparison { compared, ..Comparison::default() });
    conclude(&mut cells[*first], agreeing, others.len());
}

enum Unwritten {
    Stop(Stop),
    Error(DispatchError),
}

impl From<DispatchError> for Unwritten {
    fn from(error: DispatchError) -> Self {
        Self::Error(error)
    }
}

fn written(path: Path, passes: &Passes) -> Result<Vec<u32>, Unwritten> {
    let device = path::device(path);
    let device = device.map_err(|error| Unwritten::Stop(Stop::Unavailable(error.to_string())))?;
    if let Some(device) = device {
        let Pass { program, entry_point, .. } = pass(passes);
        let barriers = program.barriers(entry_point);
        if is_slow(device, barriers) {
            let name = &device.adapter().name;
            let why = format!(
                "{name} may take minutes to compile the pass's {barriers} barriers on `{path}`"
            );
            return Err(Unwritten::Stop(Stop::NotRun(why)));
        }
        expect_ends(device, passes)?;
    }
    let executor = executor::of(path).map_err(DispatchError::from)?;
    Ok(executor::dispatch(executor, passes)?.into_iter().flat_map(|(_, words)| words).collect())
}

/// Checks if a pass changes any word of its resources; `None` if the engine can't run the pass, or takes too long.
pub(super) fn changes(passes: &Passes) -> Option<bool> {
    let left = dispatch_briefly(passes).ok()?;
    Some(!left.into_iter().flat_map(|(_, words)| words).eq(initial(passes)))
}

/// The only pass of `passes`.
fn pass(passes: &Passes) -> &Pass {
    &passes.passes[0]
}

/// The largest number of loop iterations that an invocation may run. For more iterations, a software driver would need
/// seconds.
const PATIENCE: u32 = 4096;

/// Refuses a pass whose loops run too long on the generated data, because such a pass may hang a driver. If naga's
/// module shows no bound for the loops, this function runs a copy of the pass that leaves each loop after [`PATIENCE`]
/// iterations.
fn expect_ends(device: &Device, passes: &Passes) -> Result<(), DispatchError> {
    let Pass { program, entry_point, workgroups, bindings, .. } = pass(passes);
    if program.most_rounds().is_some_and(|rounds| rounds < u64::from(PATIENCE)) {
        return Ok(());
    }
    let number = program.free_binding();
    let Watched { program, loops } = program.watching_rounds(number, PATIENCE, true);
    let is_count = |binding: &Binding| (binding.group, binding.binding) == (0, number);
    let bound = program.compute_entry_point(entry_point).map(|(bindings, _)| bindings);
    // The loops may be in another entry point of the module.
    let Some(count) = bound.into_iter().flatten().find(is_count) else { return Ok(()) };
    let held = |(binding, held): &(Binding, usize)| {
        (binding.clone(), passes.resources[*held].fixture.clone())
    };
    let mut resources: Vec<_> = bindings.iter().map(held).collect();
    resources.push((count, fixture::Buffer::zeros(4 * loops.len()).into()));
    let counted = Passes::over(program.into(), entry_point, *workgroups, &resources);
    // In this copy, all loops end early, so no driver stops it.
    let afterwards: Afterwards = device.dispatch_with(&counted, false)?;
    let (_, counts) = afterwards.last().expect("the counts are written");
    let most = loops.iter().zip(counts).max_by_key(|(_, count)| **count);
    let Some((place, count)) = most.filter(|(_, count)| **count > 0) else { return Ok(()) };
    let message = format!("with generated data, this loop runs {count} iterations or more");
    let mut diagnostic = Diagnostic::new(message);
    if let Some(place) = place {
        diagnostic = diagnostic.at(place.first_line(), "");
    }
    Err(DispatchError::Rounds(Box::new(diagnostic)))
}

const UNCHANGED: &str =
    "with generated data, the pass changes no value in its buffers and textures";

/// The writable resources with their initial 32-bit words. A texture has four words for each texel.
fn writable(passes: &Passes) -> impl Iterator<Item = (&Binding, Vec<u32>)> {
    let Pass { program, bindings, .. } = pass(passes);
    bindings.iter().filter(|(binding, _)| binding.kind.is_written()).map(|(binding, held)| {
        let fixture = &passes.resources[*held].fixture;
        if let Some(level) = levels(fixture).first() {
            return (binding, level.words.iter().flatten().copied().collect());
        }
        let bytes = laid_out(fixture, program, binding);
        let bytes = bytes.and_then(Result::ok).expect("the buffer has a known size");
        (binding, bytemuck::pod_collect_to_vec(&bytes))
    })
}

fn initial(passes: &Passes) -> Vec<u32> {
    writable(passes).flat_map(|(_, words)| words).collect()
}

/// Finds the 32-bit words for which WGSL leaves the value open, in all writable resources. `expected` has the first
/// column's results. A word is open if it depends on an access outside of an array, on the order of invocations or on
/// the size of subgroups, or if it is a float that isn't finite. Returns an error if the engine can't run the pass.
fn open(passes: &Passes, expected: &[u32], floats: &[bool]) -> Result<Vec<bool>, String> {
    let mut open = strays(passes).map_err(|error| error.to_string())?;
    open.resize(expected.len(), false);
    let mut usual: Vec<u32> = Vec::new();
    // If more orders take too long, Karat assumes that the pass doesn't depend on the order.
    for run in Runner::new(passes).few(ORDERS) {
        let Some(left) = run.left else {
            // An order in which the pass doesn't end proves nothing. Without the results of the usual order, no
            // comparison is possible.
            if run.order.is_none() {
                return Err("the pass doesn't end when Karat's engine runs it".to_owned());
            }
            continue;
        };
        let words: Vec<u32> = left.into_iter().flat_map(|(_, words)| words).collect();
        let Some(order) = run.order else {
            usual = words;
            continue;
        };
        let pairs = usual.iter().zip(&words).map(|(usual, word)| usual != word);
        if order.is_of_size() {
            open.iter_mut().zip(pairs).for_each(|(open, differs)| *open |= differs);
            continue;
        }
        // Each driver has its own order. If two orders differ in one word of a resource, other orders may differ in
        // other words of this resource.
        let differs: Vec<bool> = pairs.collect();
        let mut begin = 0;
        for (_, own) in writable(passes) {
            let own = begin..begin + own.len();
            begin = own.end;
            if differs.get(own.clone()).is_some_and(|differs| differs.contains(&true)) {
                open[own].fill(true);
            }
        }
    }
    let words = open.iter_mut().zip(expected).zip(floats);
    for ((open, word), is_float) in words {
        *open |= *is_float && !f32::from_bits(*word).is_finite();
    }
    Ok(open)
}

/// For each 32-bit word, the distance between two neighbouring values that the word may have. A texture may store a
/// channel as a multiple of a fraction such as 1/255, and columns may round to different multiples. For all other
/// words, the distance is 0.
fn steps(passes: &Passes) -> Vec<f32> {
    let of = |(binding, words): (&Binding, Vec<u32>)| {
        let step = match binding.kind {
            BindingKind::StorageTexture { format, .. } => format.step(),
            _ => 0.0,
        };
        std::iter::repeat_n(step, words.len())
    };
    writable(passes).flat_map(of).collect()
}

fn floats(passes: &Passes) -> Vec<bool> {
    let program = &pass(passes).program;
    let of_resource = |(binding, words): (&Binding, Vec<u32>)| {
        if let BindingKind::StorageTexture { format, .. } = binding.kind {
            return vec![format.texels() == Texels::Float; words.len()];
        }
        // The type has as many elements as there are words. Elements after the end of the data are removed.
        let marked = program.buffer_of(binding, words.len()).and_then(|shape| {
            let marks = shape.lanes().into_iter().map(|s| u32::from(s == Scalar::F32) * u32::MAX);
            program.bytes(binding, &marks.collect::<Vec<_>>()).ok()
        });
        let mut marks: Vec<u32> = bytemuck::pod_collect_to_vec(&marked.unwrap_or_default());
        marks.resize(words.len(), 0);
        marks.into_iter().map(|word| word == u32::MAX).collect()
    };
    writable(passes).flat_map(of_resource).collect()
}

/// Checks if a driver may take too long to compile an entry point with this number of barriers. vello's `binning` has
/// four barriers: on Vulkan, llvmpipe compiles naga's output in 0.3 s. On GL, or for glslang's output, llvmpipe takes
/// more than 40 s.
fn is_slow(device: &Device, barriers: usize) -> bool {
    const MOST_BARRIERS: usize = 3;
    let path = device.path();
    let of_naga = matches!(path.via(), Via::Direct | Via::Wgsl | Via::Spirv);
    let is_quick = path.api() == Api::Vulkan && of_naga;
    device.adapter().is_llvmpipe() && !is_quick && barriers > MOST_BARRIERS
}

impl Buffer {
    /// The buffer of a fixture; `None` for a texture or a sampler.
    pub(super) fn of((binding, fixture): &(Binding, Fixture)) -> Option<Self> {
        let Fixture::Buffer(buffer) = fixture else { return None };
        let bytes = bytes(buffer).to_vec();
        Some(Self { group: binding.group, binding: binding.binding, bytes })
    }
}

/// Checks if two floats are at most one step apart.
fn is_next(expected: u32, actual: u32, step: f32) -> bool {
    /// A difference of this many steps counts as one step, because floats represent fractions such as 1/255 only
    /// approximately.
    const ROUNDED: f32 = 1.001;
    step > 0.0 && (f32::from_bits(expected) - f32::from_bits(actual)).abs() <= ROUNDED * step
}

/// Checks if two words of a buffer are equal within the tolerance. The types of words are unknown. Two different words
/// count as floats if both are normal floats.
fn same_word(expected: u32, actual: u32, within: &Tolerance) -> bool {
    let [a, b] = [expected, actual].map(f32::from_bits);
    let both_normal = a.is_normal() && b.is_normal();
    // `==` on floats treats 0 and -0 as equal.
    expected == actual || a == b || (both_normal && within.measure(0, b, f64::from(a)).passes())
}

#[cfg(test)]
mod tests {
    use super::{initial, open};
    use crate::made_up::Ranges;
    use karat::package::Package;

    /// Each driver runs the invocations in its own order, so the elements of `found` may have any order.
    #[test]
    fn results_that_depend_on_the_order_are_open() {
        let text = "@group(0) @binding(0) var<storage, read_write> next: atomic<u32>;
            @group(0) @binding(1) var<storage, read_write> found: array<u32, 64>;
            @group(0) @binding(2) var<storage, read_write> twice: array<u32, 64>;
            @compute @workgroup_size(64) fn main(@builtin(local_invocation_index) i: u32) {
                found[atomicAdd(&next, 1u) % 64u] = i;
                twice[i] = 2u * i;
            }";
        let package = Package::from_source("append", text);
        let ranges = Ranges::of(&package).expect("`karat.toml` declares no ranges");
        let made = crate::passes::arbitrary(
            &package,
            "main",
            None,
            &ranges,
            (crate::made_up::Content::OF_PASSES[0], None, &Vec::new()),
        );
        let (passes, _) = made.expect("the resources are generated");
        let expected = initial(&passes);
        let open = open(&passes, &expected, &vec![false; expected.len()])
            .expect("the engine runs the pass");
        // The counter's buffer contains more words than the counter.
        let list = expected.len() - 128..expected.len() - 64;
        assert!((0..open.len()).all(|at| open[at] == list.contains(&at)), "{open:?}");
    }
}
