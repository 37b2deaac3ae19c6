//! Runs a function that writes to module-scope variables, such as storage buffers. Each case is one dispatch of a
//! kernel: a generated compute entry point that calls the function.

use std::sync::Arc;

use karat_engine::{F32, Observer, Options, Program as Lowered, Resources, Runs};

use super::Quads;
use super::trace::Traced;
use super::{counted, lowering, refused, stopped, supply};
use crate::fixture::{Fixtures, resolve};
use crate::path::{Path, PathError, Via};
use crate::probe::{Inputs, ProbeError, Probed, UNIFORM_WORDS};
use crate::reflect::{Binding, Program};
use crate::settings;

/// A kernel that is lowered (translated) for the engine, with its resources.
#[derive(Debug)]
pub struct Alone {
    lowered: Lowered,
    resources: Resources,
    program: Arc<Program>,
    name: String,
    written: Vec<Binding>,
    /// The first of three binding numbers in group 0: for the arguments, the results, and the numbers that describe the
    /// batch.
    first: u32,
    words_in: usize,
    words_out: usize,
    least: usize,
    /// The layout of a quad's four pixels. `Some` if the function takes derivatives between these pixels.
    quads: Option<Quads>,
    /// The largest number of loop iterations that a case may take.
    fuel: u64,
    /// `true` if the arithmetic treats subnormals as zero.
    flush: bool,
}

impl Alone {
    /// Lowers the kernel of a function, with the ordinary arithmetic: rounding to the nearest float.
    ///
    /// # Errors
    /// Returns an error if the engine can't execute the function.
    pub fn new(probed: &Probed, fixtures: &Fixtures) -> Result<Self, ProbeError> {
        Self::rounding(probed, fixtures, Via::Direct)
    }

    /// Lowers the kernel of a function for the arithmetic that `via` selects: ordinary, `cpu:fma` or `cpu:ftz`.
    pub(crate) fn rounding(
        probed: &Probed,
        fixtures: &Fixtures,
        via: Via,
    ) -> Result<Self, ProbeError> {
        let Probed { program, function, .. } = probed;
        let unfit = |message: String| PathError::Route { path: Path::CPU, message };
        let (module, info) = program.kernel(probed.kernel()).map_err(unfit)?;
        let settings = lowering(via);
        let lowered = Lowered::entry_point(&module, &info, Probed::ENTRY_POINT, &settings)
            .map_err(|refusal| refused(program, &refusal))?;
        let mut resources = Resources::new();
        for (binding, fixture) in resolve(&function.bindings, fixtures)? {
            supply::supply(&mut resources, program, binding, fixture)?;
        }
        let (words_in, words_out) = probed.kernel.words();
        let first = probed.kernel.first_binding();
        let (program, name) = (Arc::clone(program), function.name.clone());
        let written = function.written().cloned().collect();
        let least = if probed.kernel.inputs() == Inputs::Uniform { 4 * UNIFORM_WORDS } else { 0 };
        let fuel = settings::fuel();
        let flush = via == Via::Ftz;
        Ok(Self {
            lowered,
            resources,
            program,
            name,
            written,
            first,
            words_in,
            words_out,
            least,
            quads: function.form.fragment.then(|| Quads::of(function)),
            fuel,
            flush,
        })
    }

    /// Sets the largest number of loop iterations.
    pub(crate) fn with_fuel(self, fuel: u64) -> Self {
        Self { fuel, ..self }
    }

    /// For each word of the results, `true` if the word depends on something that WGSL leaves open: a read or a write
    /// outside of an array or a texture, a derivative, or the mip level of a sampled texture.
    pub fn strays(&self, cases: usize, arguments: &[u32]) -> Result<Vec<bool>, ProbeError> {
        let mut open = self.of_outside(cases, arguments)?;
        if let Some(quads) = &self.quads {
            quads.open(arguments, &mut open, |rows| self.words(cases, rows))?;
        }
        Ok(open)
    }

    /// For each word of the results, `true` if the word depends on a read or a write outside of an array or a texture.
    pub(super) fn of_outside(
        &self,
        cases: usize,
        arguments: &[u32],
    ) -> Result<Vec<bool>, ProbeError> {
        super::differing(|outside| {
            self.words_with(cases, arguments, &Options { outside, ..Options::default() })
        })
    }

    /// The results of each case as words: the function's result, the values to which its pointer arguments point, and
    /// the resources that the function writes.
    pub(crate) fn words(&self, cases: usize, arguments: &[u32]) -> Result<Vec<u32>, ProbeError> {
        let counts = self.lowered.counts();
        let options = Options { counts: counts.clone(), ..Options::default() };
        let words = self.words_with(cases, arguments, &options)?;
        counted::note(&self.program, &self.lowered, counts, &|_| None);
        Ok(words)
    }

    fn words_with(
        &self,
        cases: usize,
        arguments: &[u32],
        options: &Options,
    ) -> Result<Vec<u32>, ProbeError> {
        let mut rows = Vec::new();
        for case in 0..cases {
            let own = &arguments[case * self.words_in..][..self.words_in];
            let words = self.case(own, options).map_err(|error| match error {
                ProbeError::Rounds { diagnostic, .. } => ProbeError::Rounds { case, diagnostic },
                error => error,
            });
            rows.extend(words?);
        }
        Ok(rows)
    }

    fn case(&self, arguments: &[u32], options: &Options) -> Result<Vec<u32>, ProbeError> {
        let resources = self.observed::<F32>(arguments, options, &())?;
        let results = resources.buffer(0, self.first + 1).expect("each case binds the results");
        let mut words: Vec<u32> = bytemuck::pod_collect_to_vec(results);
        words.truncate(self.words_out);
        self.written.iter().for_each(|binding| {
            words.extend(self.program.lanes_of_words(binding, &supply::after(&resources, binding)));
        });
        Ok(words)
    }

    /// Runs one case, and returns the resources with their new contents.
    fn observed<A: Runs>(
        &self,
        arguments: &[u32],
        options: &Options,
        observer: &dyn Observer<A>,
    ) -> Result<Resources, ProbeError> {
        let mut resources = self.resources.clone();
        let bytes = |words: &[u32]| bytemuck::cast_slice::<u32, u8>(words).to_vec();
        let mut given = bytes(arguments);
        given.resize(given.len().max(self.least), 0);
        resources.set_buffer(0, self.first, given);
        resources.set_buffer(0, self.first + 1, vec![0; 4 * (self.words_out + 1)]);
        resources.set_buffer(0, self.first + 2, bytes(&[0; 4]));
        let deadline = std::time::Instant::now().checked_add(settings::deadline());
        let options = Options { fuel: self.fuel, deadline, flush: self.flush, ..options.clone() };
        self.lowered
            .dispatch::<A>([1; 3], &mut resources, &options, observer)
            .map_err(|stop| stopped(&self.program, &self.name, &stop))?;
        Ok(resources)
    }
}

impl Traced for Alone {
    fn run<A: Runs>(&self, row: &[u32], observer: &dyn Observer<A>) -> Result<(), ProbeError> {
        self.observed(row, &Options::default(), observer).map(drop)
    }

    fn parts(&self) -> (&Lowered, &Program) {
        (&self.lowered, &self.program)
    }
}
