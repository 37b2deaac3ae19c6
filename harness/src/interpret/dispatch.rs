//! Compute passes in the engine, one after the other.

use karat_engine::{F32, Options, Program as Lowered, Resources, Settings};

use super::alone::after;
use super::{refused, stopped, supply};
use crate::dispatch::{Afterwards, DispatchError, Passes};
use crate::path::Path;
use crate::settings;

/// Invocations of a workgroup: the engine refuses more.
const MOST_INVOCATIONS: u32 = 1024;

/// Dispatches passes, and returns what they write.
pub(crate) fn dispatch(passes: &Passes) -> Result<Afterwards, DispatchError> {
    dispatched(passes, None)
}

/// The same where a number stands for what is read outside of arrays.
pub(super) fn dispatched(
    passes: &Passes,
    outside: Option<u8>,
) -> Result<Afterwards, DispatchError> {
    passes.expect_sizes(Path::CPU, [MOST_INVOCATIONS; 3], MOST_INVOCATIONS)?;
    // What each resource holds, bound under its number as a binding of group 0.
    let mut held = Resources::new();
    let mut afterwards = Vec::new();
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
        let settings = Settings::default();
        let lowered =
            Lowered::entry_point(program.module(), program.info(), &pass.entry_point, &settings);
        let lowered = lowered.map_err(|refusal| refused(program, &refusal))?;
        let mut resources = Resources::new();
        for (binding, number) in &pass.bindings {
            let from = [0, *number as u32];
            resources.take_from(&held, from, [binding.group, binding.binding]);
        }
        let deadline = std::time::Instant::now().checked_add(settings::deadline());
        let options = Options { fuel: settings::fuel(), deadline, outside, ..Options::default() };
        lowered
            .dispatch::<F32>(pass.workgroups, &mut resources, &options, &())
            .map_err(|stop| stopped(program, &pass.name, &stop))?;
        for (binding, number) in &pass.bindings {
            let to = [0, *number as u32];
            held.take_from(&resources, [binding.group, binding.binding], to);
        }
    }
    for number in 0..passes.resources.len() {
        if let Some((_, binding)) = passes.writer(number) {
            let mut binding = binding.clone();
            (binding.group, binding.binding) = (0, number as u32);
            afterwards.push((number, after(&held, &binding)));
        }
    }
    Ok(afterwards)
}
