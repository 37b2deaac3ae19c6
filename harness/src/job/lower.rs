//! Makes jobs from calls of functions, from passes and from frames.

use std::collections::BTreeMap;
use std::ops::Range;

use super::{Bound, Drawn, Frame, Job, Pass, Resource, Shader, Source, Work};
use crate::diagnostic::Span;
use crate::dispatch::{MOST_WORKGROUPS, Passes};
use crate::draw::{DrawError, Drawing};
use crate::fixture::{Fixture, FixtureError, Fixtures, Sampler, resolve};
use crate::path::JOBS;
use crate::probe::evidence::unheard_of;
use crate::probe::{self, Inputs, ProbeError, Probed, UNIFORM_WORDS, WORKGROUP};
use crate::reflect::{Binding, BindingKind, Program, Texels, TextureKind};
use crate::settings;

impl Job {
    /// Makes a job with a unique number. The job's time limit is the one in Karat's settings.
    pub fn new(work: Work, resources: Vec<Resource>, outputs: Vec<usize>) -> Self {
        let id = unheard_of();
        let seconds = settings::deadline().as_secs_f64();
        Self { jobs: JOBS, id, resources, outputs, seconds, work }
    }

    /// Makes a job from passes. Its outputs are the resources that the passes write.
    pub(crate) fn of_passes(passes: &Passes) -> Result<Self, FixtureError> {
        let numbers = 0..passes.resources.len();
        let mut resources = Vec::new();
        for (number, held) in numbers.clone().zip(&passes.resources) {
            // The format of a storage texture comes from a pass that writes the texture.
            let used = passes.writer(number).or_else(|| passes.uses(number).next());
            let (pass, binding) = used.expect("a resource is used");
            resources.push(Resource::of(&pass.program, binding, &held.fixture)?);
        }
        let of = |pass: &crate::dispatch::Pass| Pass {
            shader: Shader::of(&pass.program),
            entry_point: pass.entry_point.clone(),
            bindings: pass.bindings.iter().map(|(b, resource)| Bound::of(b, *resource)).collect(),
            workgroups: pass.workgroups,
        };
        let work = Work::Passes(passes.passes.iter().map(of).collect());
        let outputs = numbers.filter(|number| passes.writer(*number).is_some()).collect();
        Ok(Self::new(work, resources, outputs))
    }

    pub(crate) fn of_drawing(drawing: &Drawing<'_>) -> Result<Self, DrawError> {
        let program = drawing.program();
        let scene = drawing.scene();
        if !scene.clear.iter().chain([&scene.clear_depth]).all(|value| value.is_finite()) {
            let reason =
                "a job can contain only finite numbers, so clear values must be finite".to_owned();
            return Err(DrawError::Unsound { setting: "clear", reason });
        }
        let (mut resources, mut numbers) = (Vec::new(), BTreeMap::new());
        for (binding, fixture) in resolve(&drawing.all_bindings(), drawing.fixtures())? {
            if !numbers.contains_key(&binding.path) {
                numbers.insert(binding.path.clone(), resources.len());
                resources.push(Resource::of(program, binding, fixture)?);
            }
        }
        let mut draws = Vec::new();
        for (draw, bindings) in scene.draws.iter().zip(drawing.bindings()) {
            let covering = draw.covering().map(|fragment| program.covering(fragment));
            let mut bound: Vec<Bound> = Vec::new();
            for binding in bindings.all() {
                let one = Bound::of(binding, numbers[&binding.path]);
                if !bound.contains(&one) {
                    bound.push(one);
                }
            }
            draws.push(Drawn {
                draw: draw.clone().named_as_in(program),
                covering: covering.transpose()?,
                bindings: bound,
            });
        }
        let frame = Frame {
            shader: Shader::of(program),
            width: scene.width,
            height: scene.height,
            draws,
            prepass: scene.prepass,
            blend: scene.blend,
            formats: scene.formats.clone(),
            result: scene.result,
            samples: scene.samples,
            clear: scene.clear,
            clear_depth: scene.clear_depth,
        };
        Ok(Self::new(Work::Frame(Box::new(frame)), resources, Vec::new()))
    }
}

impl Shader {
    fn of(program: &Program) -> Self {
        Self::of_text(program, program.text().to_owned())
    }

    /// Makes a shader from a text that begins with the program's text.
    fn of_text(program: &Program, wgsl: String) -> Self {
        let source = |(bytes, place): (Range<usize>, Span)| {
            let (line, _) = place.file.line_column(place.range.start);
            Source { bytes, file: place.file.name.clone(), line }
        };
        let sources = program.sources().into_iter().map(source).collect();
        Self { wgsl, sources, overrides: program.constants() }
    }
}

impl Bound {
    fn of(binding: &Binding, resource: usize) -> Self {
        let immediate = binding.kind == BindingKind::Immediate;
        Self { at: (!immediate).then_some([binding.group, binding.binding]), resource }
    }
}

impl Resource {
    fn of(program: &Program, binding: &Binding, fixture: &Fixture) -> Result<Self, FixtureError> {
        if let Some(bytes) = fixture.bytes(program, binding) {
            return Ok(Self::Buffer { words: bytemuck::pod_collect_to_vec(&bytes?) });
        }
        let format = match binding.kind {
            BindingKind::StorageTexture { format, .. } => Some(format.name()),
            _ => None,
        };
        Ok(match (fixture, fixture.to_texture()) {
            (_, Some(mut texture)) => {
                // A test may bind a texture of floats to a variable for depths.
                if let BindingKind::Texture(TextureKind { texels: Texels::Depth, .. }) =
                    binding.kind
                {
                    texture.texels = Texels::Depth;
                }
                Self::Texture { format, texture }
            }
            // JSON can't write infinity. No texture has more than 32 levels, so 32 has the same effect.
            (Fixture::Sampler(sampler), _) => {
                let (least, most) = sampler.lod;
                Self::Sampler(Sampler { lod: (least.min(32.0), most.min(32.0)), ..*sampler })
            }
            _ => unreachable!("a fixture is bytes, texels or a sampler"),
        })
    }
}

/// The kernel of a function, with its resources. Karat makes one job from each batch of cases.
pub(crate) struct KernelJobs {
    probed: Probed,
    /// The resources that the function uses. `bindings` contains the binding of each resource.
    resources: Vec<Resource>,
    bindings: Vec<Bound>,
    /// The numbers of the resources that the function writes, with their variables.
    written: Vec<(usize, Binding)>,
}

impl KernelJobs {
    pub(crate) fn new(probed: &Probed, fixtures: &Fixtures) -> Result<Self, ProbeError> {
        let (mut resources, mut bindings, mut written) = (Vec::new(), Vec::new(), Vec::new());
        for (binding, fixture) in resolve(&probed.function().bindings, fixtures)? {
            if binding.kind.is_written() {
                written.push((resources.len(), binding.clone()));
            }
            bindings.push(Bound::of(binding, resources.len()));
            resources.push(Resource::of(probed.program(), binding, fixture)?);
        }
        Ok(Self { probed: probed.clone(), resources, bindings, written })
    }

    /// The largest number of cases in a job. The size of the argument buffer limits this number.
    pub(crate) fn largest_batch(&self) -> usize {
        self.probed.kernel.largest_batch().unwrap_or(usize::MAX)
    }

    /// The number of words in a case's arguments, and the number of words in a case's results, without the
    /// canary.
    pub(crate) fn words(&self) -> (usize, usize) {
        self.probed.kernel.words()
    }

    /// Finds the place in the author's file for a byte range of the kernel's text.
    pub(crate) fn resolve(&self, bytes: Range<usize>) -> Option<Span> {
        self.probed.program().resolve(bytes)
    }

    /// Decodes the components of the resources that the function wrote. `outputs` contains the job's outputs, except
    /// the first output, which contains the results.
    pub(crate) fn written(&self, outputs: &[Vec<u32>]) -> Vec<u32> {
        let lanes = |((_, binding), words): (&(usize, Binding), &Vec<u32>)| {
            self.probed.program().lanes_of_words(binding, words)
        };
        self.written.iter().zip(outputs).flat_map(lanes).collect()
    }

    /// Makes the job for some cases. The results' buffer contains poison at first. The outputs are the results,
    /// and the resources that the function writes. If other cases could see the function's writes, each job has
    /// a single case.
    pub(crate) fn job(
        &self,
        cases: usize,
        arguments: &[u32],
        canary: u32,
        poison: u32,
    ) -> Result<Job, ProbeError> {
        let Probed { program, function, kernel, .. } = &self.probed;
        let (words_in, words_out) = kernel.words();
        let unfit = |reason| {
            let (function, inputs) = (function.name.clone(), kernel.inputs());
            ProbeError::Inputs { function, inputs, reason }
        };
        let wgsl = match kernel.inputs() {
            Inputs::Constant => kernel.of_constants(arguments).map_err(unfit)?,
            _ => kernel.text.clone(),
        };
        let count = u32::try_from(cases).expect("a batch fits in 32 bits");
        let (workgroups, batch) = match function.form.alone {
            true => ([1; 3], [1, canary, 0, 0]),
            false => {
                let [columns, rows] = probe::Kernel::workgroups(count, MOST_WORKGROUPS);
                ([columns, rows, 1], [count, canary, columns * WORKGROUP, 1])
            }
        };
        let mut arguments = arguments.to_vec();
        if kernel.inputs() == Inputs::Uniform {
            arguments.resize(UNIFORM_WORDS, 0);
        }
        let (mut resources, mut bindings) = (self.resources.clone(), self.bindings.clone());
        let mut own = |place: u32, words: Vec<u32>| {
            bindings.push(Bound {
                at: Some([0, kernel.first_binding() + place]),
                resource: resources.len(),
            });
            resources.push(Resource::Buffer { words });
            resources.len() - 1
        };
        if words_in > 0 && kernel.inputs() != Inputs::Constant {
            own(0, arguments);
        }
        let results = own(1, vec![poison; cases * (words_out + 1)]);
        own(2, batch.to_vec());
        let shader = Shader::of_text(program, wgsl);
        let entry_point = Probed::ENTRY_POINT.to_owned();
        let work = Work::Passes(vec![Pass { shader, entry_point, bindings, workgroups }]);
        let outputs = [results].into_iter().chain(self.written.iter().map(|(number, _)| *number));
        Ok(Job::new(work, resources, outputs.collect()))
    }
}
