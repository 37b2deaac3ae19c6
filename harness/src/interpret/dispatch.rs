//! Compute passes in the engine, one after the other.

use karat_engine::{F32, Options, Program as Lowered, Resources, Settings, Stop};

use super::supply::{self, after};
use super::{lowering, refused, stopped};
use crate::dispatch::{Afterwards, DispatchError, Pass, Passes};
use crate::path::{self, Path, Via};
use crate::settings;

/// Invocations of a workgroup: the engine refuses more.
const MOST_INVOCATIONS: u32 = 1024;

/// Dispatches passes whose loops go round less than some ten thousand times together, which takes a moment, and
/// returns what they write.
#[cfg(feature = "routes")]
pub(crate) fn dispatch_briefly(passes: &Passes) -> Result<Afterwards, DispatchError> {
    const WORK: u64 = 1 << 16;
    dispatched(passes, &|_| Options { work: WORK, ..options() })
}

/// Dispatches passes in an arithmetic of the path `cpu`, and returns what they write.
pub(crate) fn dispatch_rounding(passes: &Passes, via: Via) -> Result<Afterwards, DispatchError> {
    let flush = via == Via::Ftz;
    dispatched_by(passes, &lowering(via), &|_| Options { flush, ..options() })
}

/// How each pass runs.
pub(super) type OfPass<'o> = &'o dyn Fn(&Pass) -> Options;

/// The same where each pass runs in its own way.
pub(super) fn dispatched(
    passes: &Passes,
    options_of: OfPass<'_>,
) -> Result<Afterwards, DispatchError> {
    dispatched_by(passes, &Settings::default(), options_of)
}

fn dispatched_by(
    passes: &Passes,
    settings: &Settings,
    options_of: OfPass<'_>,
) -> Result<Afterwards, DispatchError> {
    let held = in_order_by(passes, settings, &mut |pass, lowered, resources| {
        lowered.dispatch::<F32>(pass.workgroups, resources, &options_of(pass), &())?;
        Ok(true)
    })?;
    Ok(left(passes, &held))
}

/// The contents of the resources that passes write.
pub(super) fn left(passes: &Passes, held: &Resources) -> Afterwards {
    let mut afterwards = Vec::new();
    for number in 0..passes.resources.len() {
        if let Some((_, binding)) = passes.writer(number) {
            let mut binding = binding.clone();
            (binding.group, binding.binding) = (0, number as u32);
            afterwards.push((number, after(held, &binding)));
        }
    }
    afterwards
}

/// How passes run.
pub(super) fn options() -> Options {
    let deadline = std::time::Instant::now().checked_add(settings::deadline());
    Options { fuel: settings::fuel(), deadline, ..Options::default() }
}

/// A pass as the engine executes it.
pub(super) fn lowered(pass: &Pass, settings: &Settings) -> Result<Lowered, DispatchError> {
    let program = &pass.program;
    let lowered =
        Lowered::entry_point(program.module(), program.info(), &pass.entry_point, settings);
    Ok(lowered.map_err(|refusal| refused(program, &refusal))?)
}

/// Runs a pass over its resources; `false`: none may follow.
type Run<'r> = &'r mut dyn FnMut(&Pass, &Lowered, &mut Resources) -> Result<bool, Stop>;

/// Runs passes one after the other, and returns all resources, each bound under its number in group 0.
pub(super) fn in_order(passes: &Passes, run: Run<'_>) -> Result<Resources, DispatchError> {
    in_order_by(passes, &Settings::default(), run)
}

fn in_order_by(
    passes: &Passes,
    settings: &Settings,
    run: Run<'_>,
) -> Result<Resources, DispatchError> {
    passes.expect_sizes(Path::CPU, [MOST_INVOCATIONS; 3], MOST_INVOCATIONS)?;
    let mut held = Resources::new();
    for (number, one) in (0..).zip(&passes.resources) {
        let (pass, binding) = passes.uses(number as usize).next().expect("a resource is used");
        // A storage texture says its format.
        let (pass, binding) = passes.writer(number as usize).unwrap_or((pass, binding));
        let mut binding = binding.clone();
        (binding.group, binding.binding) = (0, number);
        supply::supply(&mut held, &pass.program, &binding, &one.fixture)?;
    }
    for pass in &passes.passes {
        let program = &pass.program;
        let lowered = lowered(pass, settings)?;
        let mut resources = Resources::new();
        for (binding, number) in &pass.bindings {
            let from = [0, *number as u32];
            resources.take_from(&held, from, [binding.group, binding.binding]);
        }
        let span = pass.span();
        let goes_on = path::caught(Path::CPU, &[&pass.name], span.as_ref(), || {
            run(pass, &lowered, &mut resources)
                .map_err(|stop| DispatchError::from(stopped(program, &pass.name, &stop)))
        })?;
        for (binding, number) in &pass.bindings {
            let to = [0, *number as u32];
            held.take_from(&resources, [binding.group, binding.binding], to);
        }
        if !goes_on {
            break;
        }
    }
    Ok(held)
}
