//! The interface between checks and executors, which run shaders.

mod accuracy;
mod caller;
mod cpu;
mod endless;
mod jobs;
mod process;
mod serve;
#[cfg(test)]
mod soundness;

use std::borrow::Cow;
use std::fmt::Debug;

pub(crate) use accuracy::measured;
pub use caller::{Caller, Results, Running, View};
pub use serve::serve;

use crate::dispatch::{Afterwards, DispatchError, Passes};
use crate::draw::{DrawError, Drawing};
use crate::fixture::{self, Fixtures};
use crate::image::Image;
use crate::interpret::{self, Interpreted};
use crate::job::{self, Job, Reply};
use crate::path::{self, Ability, Adapter, Device, Opened, Path, PathError};
use crate::probe::{BATCH, Call, Partial, Prepared, ProbeError, Probed, Runner};
use crate::reflect::{Binding, Program};

/// An executor: a driver, or any other program that runs WGSL.
///
/// Checks and frames use executors only through this trait. By default, they use the paths that environment variables
/// such as `KARAT_PATHS` select. To use another executor, pass it to [`Probe::on`](crate::check::Probe::on) or
/// [`Frame::on`](crate::Frame::on).
///
/// ```
/// use karat::unstable::executor::Executor;
/// use karat::unstable::path::Adapter;
/// use karat::Path;
/// use karat::prelude::*;
/// use karat::unstable::probe::{Call, Prepared, ProbeError, Started};
///
/// /// Doubles a number, for any function.
/// #[derive(Debug)]
/// struct Doubler;
///
/// impl Executor for Doubler {
///     fn path(&self) -> Path {
///         Path::CPU
///     }
///
///     fn adapter(&self) -> Adapter {
///         let (path, name) = ("cpu".to_owned(), "Doubler".to_owned());
///         Adapter { path, name, driver: String::new(), software: true }
///     }
///
///     fn prepare<'e>(&'e self, _: &Call<'_>) -> Result<Box<dyn Prepared + 'e>, ProbeError> {
///         Ok(Box::new(Self))
///     }
/// }
/// #
/// # impl Prepared for Doubler {
/// #     fn capacity(&self) -> usize {
/// #         1000
/// #     }
/// #     fn start<'p>(&'p self, _: usize, arguments: &[u32]) -> Result<Started<'p>, ProbeError> {
/// #         let double = |word: &u32| (2.0 * f32::from_bits(*word)).to_bits();
/// #         let results: Vec<u32> = arguments.iter().map(double).collect();
/// #         Ok(Box::new(move |read| {
/// #             read(&results, 1);
/// #             Ok(())
/// #         }))
/// #     }
/// # }
///
/// let package = Package::from_source("m", "fn twice(x: f32) -> f32 { return 2.0 * x; }");
/// package.function("twice").on(&Doubler).over(-1.0..=1.0).agrees_with(|x: f64| 2.0 * x, Ulp(0.0));
/// ```
pub trait Executor: Debug + Sync {
    /// The executor's name in verdicts, tolerances and replays.
    fn path(&self) -> Path;

    /// The executor's description in records.
    fn adapter(&self) -> Adapter;

    /// Reports if the executor has an ability. If a job needs an ability that the executor lacks, Karat refuses
    /// the job without calling the executor.
    fn can(&self, ability: Ability) -> bool {
        let _ = ability;
        true
    }

    /// The smallest and the largest subgroup size. `None` if the executor has no subgroups, or doesn't report
    /// their size.
    fn subgroups(&self) -> Option<[u32; 2]> {
        None
    }

    /// Runs a job. The default implementations of the methods below call `run`.
    ///
    /// # Errors
    /// Returns an error if the executor can't run jobs now. The default implementation runs no job, and always returns
    /// an error.
    fn run(&self, job: &Job) -> Result<Reply, PathError> {
        let _ = job;
        Err(PathError::NoJobs { path: self.path() })
    }

    /// Prepares a function to be called.
    ///
    /// # Errors
    /// Returns an error if this executor can't call the function, or a fixture doesn't fit its variable.
    fn prepare<'e>(&'e self, call: &Call<'_>) -> Result<Box<dyn Prepared + 'e>, ProbeError> {
        jobs::prepare(self.path(), Box::new(|job| self.run(job)), call)
    }

    /// Draws a frame. The image has linear colours and the drawing's size. The top row comes first.
    ///
    /// # Errors
    /// Returns an error if this executor can't draw the frame.
    fn draw(&self, drawing: &Drawing<'_>) -> Result<Image, DrawError> {
        jobs::draw(self.path(), &|job| self.run(job), drawing)
    }

    /// Dispatches compute passes. Returns the index and the words of each resource that the passes write.
    ///
    /// # Errors
    /// Returns an error if this executor can't dispatch the passes.
    fn dispatch(&self, passes: &Passes) -> Result<Afterwards, DispatchError> {
        jobs::dispatch(self.path(), &|job| self.run(job), passes)
    }
}

/// Returns an error if the executor lacks an ability that a function or an entry point needs.
fn expect_able(
    executor: &dyn Executor,
    function: &str,
    program: &Program,
    bindings: &[Binding],
) -> Result<(), ProbeError> {
    if executor.path().api() != path::Api::Cpu {
        interpret::unmeasured(program);
    }
    let lacks = program.abilities(bindings).into_iter().find(|ability| !executor.can(*ability));
    lacks.map_or(Ok(()), |ability| {
        let (function, path) = (function.to_owned(), executor.path());
        Err(ProbeError::Lacks { function, path, ability })
    })
}

/// Dispatches passes on an executor, if the executor has the abilities that the passes need.
pub fn dispatch(executor: &dyn Executor, passes: &Passes) -> Result<Afterwards, DispatchError> {
    for pass in &passes.passes {
        let bindings: Vec<Binding> = pass.bindings.iter().map(|(own, _)| own.clone()).collect();
        expect_able(executor, &pass.name, &pass.program, &bindings)?;
    }
    let names: Vec<&str> = passes.entry_points().collect();
    path::caught(executor.path(), &names, passes.span().as_ref(), || executor.dispatch(passes))
}

/// Draws a frame on an executor, if the executor has the abilities that the frame needs.
pub(crate) fn draw(executor: &dyn Executor, drawing: &Drawing<'_>) -> Result<Image, DrawError> {
    if !executor.can(Ability::Frames) {
        return Err(DrawError::Unable { path: executor.path() });
    }
    interpret::unmeasured(drawing.program());
    let needs = drawing.program().abilities(&drawing.all_bindings());
    match needs.into_iter().find(|ability| !executor.can(*ability)) {
        None => {
            let (names, span) = drawing.entry_points();
            path::caught(executor.path(), &names, span.as_ref(), || executor.draw(drawing))
        }
        Some(ability) => {
            let (path, message) = (executor.path(), format!("the frame needs {ability}"));
            Err(PathError::Route { path, message }.into())
        }
    }
}

/// Runs a job by calling the executor's own `dispatch` or `draw`.
fn raised(executor: &dyn Executor, job: &Job) -> Reply {
    let passes = &|passes: &Passes| dispatch(executor, passes);
    let frame = &|drawing: &Drawing<'_>| draw(executor, drawing);
    job::run(job, passes, frame)
}

/// A driver. Karat uses poison and canaries to check that the driver writes each word once, for the right case.
impl Executor for Device {
    fn path(&self) -> Path {
        Self::path(self)
    }

    fn adapter(&self) -> Adapter {
        Self::adapter(self).clone()
    }

    fn can(&self, ability: Ability) -> bool {
        match ability {
            Ability::F16 => self.has_f16(),
            Ability::Subgroups => Self::subgroups(self).is_some(),
            _ => true,
        }
    }

    fn subgroups(&self) -> Option<[u32; 2]> {
        Self::subgroups(self)
    }

    fn run(&self, job: &Job) -> Result<Reply, PathError> {
        Ok(raised(self, job))
    }

    fn prepare<'e>(&'e self, call: &Call<'_>) -> Result<Box<dyn Prepared + 'e>, ProbeError> {
        let prepared = Box::new(Runner::new(self, call.probed, call.fixtures, call.cases)?);
        endless::guarded(self, call, prepared)
    }

    fn draw(&self, drawing: &Drawing<'_>) -> Result<Image, DrawError> {
        self.render(drawing)
    }

    fn dispatch(&self, passes: &Passes) -> Result<Afterwards, DispatchError> {
        Self::dispatch(self, passes)
    }
}

/// Returns the executor of a path. A process opens each path only once.
///
/// ```
/// use karat::Path;
///
/// let engine = karat::unstable::executor::of(Path::CPU)?;
/// assert_eq!(engine.path(), Path::CPU);
/// # Ok::<(), karat::path::PathError>(())
/// ```
///
/// # Errors
/// Returns an error if the path doesn't open.
pub fn of(path: Path) -> Result<&'static dyn Executor, PathError> {
    path::open(path).map(opened)
}

fn opened(opened: Opened) -> &'static dyn Executor {
    match opened {
        Opened::Device(device) => device,
        Opened::Process(process) => process,
        Opened::Cpu(path) => cpu::of(path),
    }
}

/// Calls a function on one path. Each entry of `cases` contains the words of one case's arguments. Returns the
/// words of each case's result.
///
/// ```
/// use karat::unstable::probe::Probed;
/// use karat::{Package, Path};
///
/// let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
/// let cases = [vec![1.0_f32.to_bits()], vec![3.0_f32.to_bits()]];
/// let results = karat::unstable::executor::call(&Probed::new(&package, "half")?, Path::CPU, &cases, &Vec::new())?;
/// assert_eq!(results, [[0.5_f32.to_bits()], [1.5_f32.to_bits()]]);
/// # Ok::<(), karat::unstable::probe::ProbeError>(())
/// ```
///
/// # Errors
/// Returns an error if the path doesn't open, if a fixture is missing, or if Karat can't get the function's results on
/// this path.
///
/// # Panics
/// Panics if the number of words in a case doesn't match the function's arguments.
pub fn call(
    probed: &Probed,
    path: Path,
    cases: &[Vec<u32>],
    fixtures: &Fixtures,
) -> Result<Vec<Vec<u32>>, ProbeError> {
    fixture::check_used(&probed.function().bindings, fixtures)?;
    let calls = cases.len().min(BATCH);
    let caller = Caller::new(of(path)?, Cow::Borrowed(probed), fixtures, calls)?;
    let whole = cases.iter().all(|case| case.len() == caller.words);
    assert!(whole, "each case has all its arguments: {} words", caller.words);
    let results = caller.results(&cases.concat(), cases.len())?;
    let width = probed.function().result.lanes().len();
    Ok(results.chunks_exact(width).map(<[u32]>::to_vec).collect())
}

/// Accepts results in which the driver left some words unwritten, if WGSL sets no bounds for these words. Unwritten
/// words keep their previous value, a NaN. Returns `error` if WGSL sets bounds for an unwritten word, because then the
/// driver lost a write.
pub(crate) fn left_open(
    (probed, fixtures): (&Probed, &Fixtures),
    (cases, rows): (usize, &[u32]),
    error: ProbeError,
) -> Result<Partial, ProbeError> {
    let ProbeError::ResultNotWritten { partial, .. } = &error else { return Err(error) };
    let Partial { stride, unwritten, .. } = &**partial;
    let (width, lanes) = (rows.len() / cases.max(1), probed.function().result.lanes().len());
    let mut named: Vec<usize> = unwritten.iter().map(|place| place / stride).collect();
    named.dedup();
    let own: Vec<u32> =
        named.iter().flat_map(|case| &rows[case * width..][..width]).copied().collect();
    let bounds = Interpreted::new(probed, fixtures).and_then(|one| one.bounds(named.len(), &own));
    let Ok(bounds) = bounds else { return Err(error) };
    let is_open = |place: &usize| {
        let case = named.binary_search(&(place / stride)).ok();
        let bound = case.and_then(|case| bounds.get(case * lanes + place % stride));
        bound.is_some_and(|bound| bound.ends().is_none())
    };
    match error {
        ProbeError::ResultNotWritten { partial, .. } if partial.unwritten.iter().all(is_open) => {
            Ok(*partial)
        }
        error => Err(error),
    }
}

/// The adapter of an executor. The field `path` has the executor's name in verdicts and replays.
pub(crate) fn adapter(executor: &dyn Executor) -> Adapter {
    Adapter { path: executor.path().to_string(), ..executor.adapter() }
}

/// Returns the executors in `own`. If `own` is empty, returns the executors of the paths that environment variables
/// such as `KARAT_PATHS` select. The list has at least one executor.
pub(crate) fn or_selected<'e>(
    own: &[&'e dyn Executor],
) -> Result<Vec<&'e dyn Executor>, PathError> {
    if !own.is_empty() {
        path::expect_own(own.iter().map(|executor| executor.path()))?;
        return Ok(own.to_vec());
    }
    Ok(path::chosen()?.into_iter().map(|one| opened(one) as &'e dyn Executor).collect())
}
