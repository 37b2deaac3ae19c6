//! Compute entry points: run on each column, and what they wrote compared.

use super::execute::{Comparison, not_run};
use super::row::conclude;
use super::{Buffer, Cell, Request, Status, Stop};
use crate::interpret::strays;
use crate::path::{Device, Path};
use crate::probe::{Data, ProbeError, run_entry_point};
use crate::reflect::{BindingKind, Program};
use crate::tolerance::Tolerance;
use crate::value::Scalar;

/// Runs a compute entry point on each column that got so far, and compares what it wrote.
pub(super) fn run_entry_point_on_each(
    request: &Request,
    program: &Program,
    name: &str,
    data: Result<&(Vec<Data>, u32), &String>,
    cells: &mut [Cell],
) {
    let mut ran: Vec<(usize, Vec<u32>)> = Vec::new();
    // What doesn't end on one column isn't tried on others.
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
        let words = match (data, column.path) {
            (_, None) => Err(Stop::Unavailable(column.without_path())),
            (Err(why), _) => Err(Stop::NotRun(why.clone())),
            (Ok(data), Some(path)) => {
                written(path, program, name, data).map_err(|error| match error {
                    Unwritten::Stop(stop) => stop,
                    Unwritten::Error(error) => {
                        let rounds = matches!(error, ProbeError::Rounds { .. });
                        let stop = Stop::NotRun(not_run(error));
                        if rounds {
                            endless = Some(stop.clone());
                        }
                        stop
                    }
                })
            }
        };
        match words {
            Ok(words) => {
                cell.status = Some(Status::Executed);
                ran.push((index, words));
            }
            Err(stop) => cell.stopped = Some(stop),
        }
    }
    let before = data.map_or_else(|_| Vec::new(), |(data, _)| initial(data));
    // Buffers that nobody has written agree on each column, and show nothing.
    if ran.iter().all(|(_, words)| *words == before) {
        for (index, _) in &ran {
            let what = if before.is_empty() { "it writes no buffer" } else { UNCHANGED };
            cells[*index].stopped = Some(Stop::NothingToCompare(what.to_owned()));
        }
        return;
    }
    let Some(((first, expected), others)) = ran.split_first() else { return };
    let differs =
        |at: &usize, actual: &[u32]| !same_word(expected[*at], actual[*at], &request.within);
    // The same buffers were read back on each. Only where they differ is it asked what may.
    let all = 0..expected.len();
    let differ = others.iter().any(|(_, actual)| all.clone().any(|at| differs(&at, actual)));
    let open = match data {
        Ok(data) if differ => open(program, name, data, expected),
        _ => vec![false; expected.len()],
    };
    let mut agreeing = None;
    for (index, actual) in others {
        let (baseline, cell) = (request.columns[*first], &mut cells[*index]);
        cell.against = Some(baseline.to_string());
        let (left_open, places): (Vec<usize>, Vec<usize>) =
            all.clone().filter(|at| differs(at, actual)).partition(|at| open[*at]);
        let compared = expected.len() - left_open.len();
        (cell.compared, cell.differing, cell.open) = (compared, places.len(), left_open.len());
        if let Some(place) = places.first() {
            cell.stopped = Some(Stop::Differs(format!(
                "{} of {compared} words of its buffers differ from `{baseline}`: word {place} is \
                 {:#010x}, there {:#010x}",
                places.len(),
                actual[*place],
                expected[*place]
            )));
        } else if compared == 0 {
            let none = "WGSL leaves open what each word of its buffers is".to_owned();
            cell.stopped = Some(Stop::NothingToCompare(none));
        } else {
            cell.status = Some(Status::Agrees);
            agreeing = Some(compared);
        }
    }
    let agreeing = agreeing.map(|compared| Comparison { compared, ..Comparison::default() });
    conclude(&mut cells[*first], agreeing, others.len());
}

/// Why there are no words to compare.
enum Unwritten {
    Stop(Stop),
    Error(ProbeError),
}

/// The words that an entry point writes on a path.
fn written(
    path: Path,
    program: &Program,
    name: &str,
    (data, workgroups): &(Vec<Data>, u32),
) -> Result<Vec<u32>, Unwritten> {
    #[cfg(feature = "engine")]
    if path == Path::CPU {
        let run = crate::interpret::run_entry_point(program, name, *workgroups, data);
        return run.map_err(Unwritten::Error);
    }
    let opened = crate::path::open(path)
        .map_err(|error| Unwritten::Stop(Stop::Unavailable(error.to_string())))?;
    let Some(device) = opened.device() else {
        let why = "a program of KARAT_EXECUTORS takes the author's own WGSL alone".to_owned();
        return Err(Unwritten::Stop(Stop::NotRun(why)));
    };
    if is_slow(device, program) {
        return Err(Unwritten::Stop(Stop::NotRun(format!(
            "{} takes minutes to compile the {} barriers of its module",
            device.adapter().name,
            program.barriers()
        ))));
    }
    run_entry_point(device, program, name, *workgroups, data).map_err(Unwritten::Error)
}

const UNCHANGED: &str = "with made-up data it changes no word of its buffers";

/// The words of the buffers that may be written, before they are.
fn initial(data: &[Data]) -> Vec<u32> {
    let writable = |data: &&Data| data.kind == BindingKind::Storage { writable: true };
    let words = |data: &Data| bytemuck::pod_collect_to_vec::<u8, u32>(&data.bytes);
    data.iter().filter(writable).flat_map(words).collect()
}

/// Which words of the buffers that may be written WGSL leaves open, of those that the first column wrote:
/// they depend on what is read or written outside of an array, or are floats that aren't finite.
fn open(
    program: &Program,
    name: &str,
    (data, workgroups): &(Vec<Data>, u32),
    expected: &[u32],
) -> Vec<bool> {
    let mut open = strays(program, name, *workgroups, data).unwrap_or_default();
    open.resize(expected.len(), false);
    let floats = floats(program, name, data);
    let words = open.iter_mut().zip(expected).zip(floats);
    for ((open, word), is_float) in words {
        *open |= is_float && !f32::from_bits(*word).is_finite();
    }
    open
}

/// Which of these words are floats.
fn floats(program: &Program, name: &str, data: &[Data]) -> Vec<bool> {
    let bindings =
        program.compute_entry_point(name).map_or_else(Vec::new, |(bindings, _)| bindings);
    let of_buffer = |data: &Data| {
        let binding = bindings.iter().find(|b| (b.group, b.binding) == (data.group, data.binding));
        let marked = binding.and_then(|binding| {
            // As many elements as there may be words: what is beyond the data is cut off.
            let shape = program.buffer_of(binding, data.bytes.len() / 4)?;
            let marks = shape.lanes().into_iter().map(|s| u32::from(s == Scalar::F32) * u32::MAX);
            program.bytes(binding, &marks.collect::<Vec<_>>()).ok()
        });
        let mut words: Vec<u32> = bytemuck::pod_collect_to_vec(&marked.unwrap_or_default());
        words.resize(data.bytes.len() / 4, 0);
        words.into_iter().map(|word| word == u32::MAX)
    };
    let writable = |data: &&Data| data.kind == BindingKind::Storage { writable: true };
    data.iter().filter(writable).flat_map(of_buffer).collect()
}

/// Whether a driver wouldn't compile a module's entry points in time. llvmpipe makes a coroutine of
/// each barrier; vello's `binning`, with four, takes minutes, and `flatten`, with none, a second.
fn is_slow(device: &Device, program: &Program) -> bool {
    const MOST_BARRIERS: usize = 3;
    device.adapter().is_llvmpipe() && program.barriers() > MOST_BARRIERS
}

impl Buffer {
    pub(super) fn of(data: Data) -> Self {
        Self { group: data.group, binding: data.binding, bytes: data.bytes }
    }
}

/// Whether two words of a buffer are the same number. It isn't known which of them are floats: a pair
/// whose words differ is one of floats if both are normal ones.
fn same_word(expected: u32, actual: u32, within: &Tolerance) -> bool {
    let [a, b] = [expected, actual].map(f32::from_bits);
    let both_normal = a.is_normal() && b.is_normal();
    // `==` of floats: 0 and -0 are one number.
    expected == actual || a == b || (both_normal && within.measure(0, b, f64::from(a)).passes())
}
