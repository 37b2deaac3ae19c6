//! Runs compute passes in the engine, one after another.

use std::sync::Arc;

use karat_engine::{F32, Options, Program as Lowered, Resources, Settings, Stop};

use super::supply::{self, after};
use super::{counted, lowering, refused, stopped};
use crate::dispatch::{Afterwards, DispatchError, Pass, Passes};
use crate::path::{self, Path, Via};
use crate::settings;

/// The largest workgroup that the engine accepts, in invocations.
const MOST_INVOCATIONS: u32 = 1024;

/// Dispatches passes, and returns the data that they write. To stay quick, returns an error if a pass's loops take more
/// than 65,536 iterations in all invocations together.
pub fn dispatch_briefly(passes: &Passes) -> Result<Afterwards, DispatchError> {
    const WORK: u64 = 1 << 16;
    dispatched(passes, &|_| Options { work: WORK, ..options() })
}

/// Dispatches passes, and returns the data that they write. `via` selects the arithmetic: ordinary, `cpu:fma` or
/// `cpu:ftz`.
pub fn dispatch_rounding(passes: &Passes, via: Via) -> Result<Afterwards, DispatchError> {
    let flush = via == Via::Ftz;
    dispatched_by(passes, &lowering(via), &|_| Options { flush, ..options() })
}

/// A function that returns the engine's options for a pass, by the pass's index.
pub(super) type OfPass<'o> = &'o dyn Fn(usize) -> Options;

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
    Prepared::new(passes, settings)?.dispatched(options_of)
}

pub(super) fn options() -> Options {
    let deadline = std::time::Instant::now().checked_add(settings::deadline());
    Options { fuel: settings::fuel(), deadline, ..Options::default() }
}

pub(super) fn lowered(pass: &Pass, settings: &Settings) -> Result<Lowered, DispatchError> {
    let program = &pass.program;
    let lowered =
        Lowered::entry_point(program.module(), program.info(), &pass.entry_point, settings);
    Ok(lowered.map_err(|refusal| refused(program, &refusal))?)
}

/// A function that runs one pass, and changes its resources. It returns `false` if later passes must not run.
type Run<'r> = &'r mut dyn FnMut(&Pass, &Lowered, &mut Resources) -> Result<bool, Stop>;

/// Runs passes one after another with `run`, and returns all resources. The resource with the number N has binding N in
/// group 0.
pub(super) fn in_order(passes: &Passes, run: Run<'_>) -> Result<Resources, DispatchError> {
    Prepared::new(passes, &Settings::default())?.run(run)
}

/// Passes that are ready to run several times.
pub(super) struct Prepared<'p> {
    pub(super) passes: &'p Passes,
    lowered: Arc<[Lowered]>,
    /// The resources before the first pass. A resource's binding in group 0 is its number.
    resources: Resources,
}

impl<'p> Prepared<'p> {
    pub(super) fn new(passes: &'p Passes, settings: &Settings) -> Result<Self, DispatchError> {
        passes.expect_sizes(Path::CPU, [MOST_INVOCATIONS; 3], MOST_INVOCATIONS)?;
        let mut resources = Resources::new();
        for (number, one) in (0..).zip(&passes.resources) {
            let (pass, binding) = passes.uses(number as usize).next().expect("a resource is used");
            // A pass that writes a storage texture declares the texture's format.
            let (pass, binding) = passes.writer(number as usize).unwrap_or((pass, binding));
            let mut binding = binding.clone();
            (binding.group, binding.binding) = (0, number);
            supply::supply(&mut resources, &pass.program, &binding, &one.fixture)?;
        }
        let lowered = passes.passes.iter().map(|pass| lowered(pass, settings));
        Ok(Self { passes, lowered: lowered.collect::<Result<_, _>>()?, resources })
    }

    /// Runs the prepared passes one after another, and returns all resources, like [`in_order`].
    pub(super) fn run(&self, run: Run<'_>) -> Result<Resources, DispatchError> {
        let mut held = self.resources.clone();
        for (pass, lowered) in self.passes.passes.iter().zip(&*self.lowered) {
            let mut resources = Resources::new();
            for (binding, number) in &pass.bindings {
                let from = [0, *number as u32];
                resources.take_from(&held, from, [binding.group, binding.binding]);
            }
            let span = pass.span();
            let goes_on = path::caught(Path::CPU, &[&pass.name], span.as_ref(), || {
                run(pass, lowered, &mut resources)
                    .map_err(|stop| DispatchError::from(stopped(&pass.program, &pass.name, &stop)))
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

    /// A copy of the passes in which each blank buffer (one without given contents) is filled with `word`.
    pub(super) fn filled(&self, word: u32) -> Self {
        let mut resources = self.resources.clone();
        for bytes in resources.blank_mut() {
            bytes.chunks_exact_mut(4).for_each(|own| own.copy_from_slice(&word.to_le_bytes()));
        }
        Self { resources, lowered: Arc::clone(&self.lowered), passes: self.passes }
    }

    pub(super) fn dispatched(&self, options_of: OfPass<'_>) -> Result<Afterwards, DispatchError> {
        let mut number = 0..;
        let held = self.run(&mut |pass, lowered, resources| {
            let counts = lowered.counts();
            let own = options_of(number.next().unwrap_or_default());
            let options = Options { counts: counts.clone(), ..own };
            lowered.dispatch::<F32>(pass.workgroups, resources, &options, &())?;
            counted::note(&pass.program, lowered, counts, &|_| None);
            Ok(true)
        })?;
        Ok(self.left(&held))
    }

    pub(super) fn left(&self, held: &Resources) -> Afterwards {
        let of = |number: usize| {
            let mut binding = self.passes.writer(number)?.1.clone();
            (binding.group, binding.binding) = (0, number as u32);
            Some((number, after(held, &binding)))
        };
        (0..self.passes.resources.len()).filter_map(of).collect()
    }

    pub(super) fn has_subgroups(&self) -> bool {
        self.lowered.iter().any(Lowered::has_subgroups)
    }
}
