//! Calls, passes and frames for what runs jobs.

use crate::dispatch::{Afterwards, DispatchError, Passes};
use crate::domain::Source;
use crate::draw::{DrawError, Drawing};
use crate::image::Image;
use crate::job::{Job, Kernel, Problem, Reply};
use crate::path::{Path, PathError};
use crate::probe::evidence::Evidence;
use crate::probe::{Call, Prepared, ProbeError, Reader, Started};
use crate::reflect::Program;

/// Cases of a job: some hundred kilobytes of JSON.
const BATCH: usize = 4096;

/// Cases of a batch where each is a job of its own.
const ALONE: usize = 64;

/// Runs a job.
type Run<'e> = Box<dyn Fn(&Job) -> Result<Reply, PathError> + Sync + 'e>;

/// A function whose calls are jobs.
struct ByJobs<'e> {
    run: Run<'e>,
    kernel: Kernel,
    program: std::sync::Arc<Program>,
    evidence: Evidence,
    capacity: usize,
    alone: bool,
}

/// Makes a function ready to be called by jobs.
pub(super) fn prepare<'e>(
    path: Path,
    run: Run<'e>,
    call: &Call<'_>,
) -> Result<Box<dyn Prepared + 'e>, ProbeError> {
    let Call { probed, fixtures, cases } = *call;
    let form = &probed.function().form;
    if form.fragment {
        let message = "it takes derivatives, for which a quad of pixels has to be drawn: only drivers of wgpu \
                       and Karat's engine do that";
        return Err(PathError::Route { path, message: message.to_owned() }.into());
    }
    let kernel = Kernel::new(probed, fixtures)?;
    let most = if form.alone { ALONE } else { BATCH.min(kernel.largest_batch()) };
    let (capacity, alone) = (cases.clamp(1, most), form.alone);
    let evidence = Evidence::of(probed.function(), path, kernel.words().1);
    let program = std::sync::Arc::clone(&probed.program);
    Ok(Box::new(ByJobs { run, kernel, program, evidence, capacity, alone }))
}

/// A word that another job of the process writes back by chance only, once in 2^32.
fn canary() -> u32 {
    use std::sync::atomic::{AtomicU64, Ordering};
    static JOBS: AtomicU64 = AtomicU64::new(0);
    Source::new(1, JOBS.fetch_add(1, Ordering::Relaxed)).bits()
}

impl ByJobs<'_> {
    /// The results of some cases over a poison, with their canaries, and the other outputs.
    fn outputs(
        &self,
        cases: usize,
        arguments: &[u32],
        poison: u32,
    ) -> Result<(Vec<u32>, Vec<Vec<u32>>), ProbeError> {
        let canary = canary();
        let job = self.kernel.job(cases, arguments, canary, poison)?;
        let path = self.evidence.path;
        let place = |problem: &Problem| located(problem, |_, bytes| self.program.resolve(bytes));
        let mut outputs = done((self.run)(&job)?, path, job.outputs.len(), place)?;
        let words = outputs.remove(0);
        self.evidence.expect_canaries(&words, cases, canary)?;
        Ok((words, outputs))
    }

    /// The same once each word of a result has been written.
    fn written(
        &self,
        cases: usize,
        arguments: &[u32],
    ) -> Result<(Vec<u32>, Vec<Vec<u32>>), ProbeError> {
        let [poison, other] = Kernel::POISON;
        let (words, others) = self.outputs(cases, arguments, poison)?;
        let places = self.evidence.poisoned(&words);
        if !places.is_empty() {
            let (again, _) = self.outputs(cases, arguments, other)?;
            self.evidence.expect_written(&words, places, &self.evidence.poisoned(&again))?;
        }
        Ok((words, others))
    }
}

impl Prepared for ByJobs<'_> {
    fn capacity(&self) -> usize {
        self.capacity
    }

    fn start<'p>(&'p self, cases: usize, arguments: &[u32]) -> Result<Started<'p>, ProbeError> {
        let (words_in, words_out) = self.kernel.words();
        if !self.alone {
            let (words, _) = self.written(cases, arguments)?;
            let stride = self.evidence.stride;
            return Ok(Box::new(move |read: Reader<'_>| {
                read(&words, stride);
                Ok(())
            }));
        }
        let mut rows = Vec::new();
        for case in 0..cases {
            let own = &arguments[case * words_in..][..words_in];
            let (words, others) = self.written(1, own)?;
            rows.extend_from_slice(&words[..words_out]);
            rows.extend(self.kernel.written(&others));
        }
        let stride = rows.len() / cases.max(1);
        Ok(Box::new(move |read: Reader<'_>| {
            read(&rows, stride);
            Ok(())
        }))
    }
}

/// Dispatches passes as a job.
pub(super) fn dispatch(
    path: Path,
    run: &dyn Fn(&Job) -> Result<Reply, PathError>,
    passes: &Passes,
) -> Result<Afterwards, DispatchError> {
    let job = Job::of_passes(passes)?;
    let place = |problem: &Problem| {
        located(problem, |pass, bytes| passes.passes.get(pass)?.program.resolve(bytes))
    };
    let outputs = done(run(&job)?, path, job.outputs.len(), place)?;
    let afterwards: Afterwards = job.outputs.iter().copied().zip(outputs).collect();
    for (number, words) in &afterwards {
        let expected = job.resources[*number].words();
        if words.len() != expected {
            let found = words.len();
            return Err(ProbeError::Length { path, expected, found }.into());
        }
    }
    Ok(afterwards)
}

/// Draws a frame as a job.
pub(super) fn draw(
    path: Path,
    run: &dyn Fn(&Job) -> Result<Reply, PathError>,
    drawing: &Drawing<'_>,
) -> Result<Image, DrawError> {
    let job = Job::of_drawing(drawing)?;
    let place = |problem: &Problem| located(problem, |_, bytes| drawing.program().resolve(bytes));
    let words = done(run(&job)?, path, 1, place)?.remove(0);
    let (width, height) = drawing.size();
    let expected = 4 * width as usize * height as usize;
    if words.len() != expected {
        let message = format!("it returned {} words of an image that has {expected}", words.len());
        return Err(PathError::Driver { path, message }.into());
    }
    let pixels = words.chunks_exact(4).map(|pixel| [0, 1, 2, 3].map(|k| f32::from_bits(pixel[k])));
    Ok(Image::new(width, height, pixels.collect()))
}

/// The outputs of a reply. `place` is where a problem is, in the author's file.
fn done(
    reply: Reply,
    path: Path,
    expected: usize,
    place: impl Fn(&Problem) -> String,
) -> Result<Vec<Vec<u32>>, PathError> {
    match reply {
        Reply::Done(outputs) if outputs.len() == expected => Ok(outputs),
        Reply::Done(outputs) => {
            let message =
                format!("it returned {} outputs, and {expected} are wanted", outputs.len());
            Err(PathError::Driver { path, message })
        }
        Reply::Refused(problem) => {
            let message = format!("{}{}", problem.message, place(&problem));
            Err(PathError::Refused { path, message })
        }
        Reply::Failed(problem) => {
            let message = format!("{}{}", problem.message, place(&problem));
            Err(PathError::Driver { path, message })
        }
    }
}

/// Where a problem is: ` (shaders/a.wgsl:3:5)`, or nothing.
fn located(
    problem: &Problem,
    resolve: impl Fn(usize, std::ops::Range<usize>) -> Option<crate::diagnostic::Span>,
) -> String {
    let place = problem.bytes.clone().and_then(|bytes| resolve(problem.pass, bytes));
    place.map_or_else(String::new, |place| format!(" ({place})"))
}
