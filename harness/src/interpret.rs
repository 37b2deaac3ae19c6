//! Functions of a package in Karat's engine, which needs no driver.
//!
//! This is what stands between the two: the engine knows naga's IR and words, and a check knows
//! functions, fixtures and the author's files.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use karat_engine::{
    Arithmetic, Dimension, F32, Filter, Options, Program as Lowered, Refusal, Resources, Results,
    Sampler as EngineSampler, Settings, Stop, Texels, Texture as EngineTexture,
};

use crate::diagnostic::{Diagnostic, Span};
use crate::fixture::{
    CubeMap, Fixture, Fixtures, Level, Sampler, Storage, Texture, Uniform, resolve,
};
use crate::path::{Path, PathError};
#[cfg(feature = "routes")]
use crate::probe::Data;
use crate::probe::{ProbeError, Probed};
#[cfg(feature = "routes")]
use crate::reflect::BindingKind;
use crate::reflect::Program;
use crate::value::Scalar;

/// A function that is lowered, with what it reads.
#[derive(Debug)]
pub(crate) struct Interpreted {
    lowered: Lowered,
    resources: Resources,
    /// The scalars of a case's arguments and of its result.
    arguments: Vec<Scalar>,
    results: Vec<Scalar>,
    name: String,
    /// Knows the author's places.
    program: Arc<Program>,
}

impl Interpreted {
    /// Lowers a function. What the engine doesn't execute is an error with its place.
    pub(crate) fn new(probed: &Probed, fixtures: &Fixtures) -> Result<Self, ProbeError> {
        Self::with(probed, fixtures, &Settings::default())
    }

    fn with(probed: &Probed, fixtures: &Fixtures, settings: &Settings) -> Result<Self, ProbeError> {
        let Probed { program, function, .. } = probed;
        let name = program.name_of(&function.name);
        let lowered = Lowered::function(program.module(), program.info(), name, settings)
            .map_err(|refusal| refused(program, &refusal))?;
        let wrong = |message: String| PathError::Route { path: Path::CPU, message };
        let mut resources = Resources::new();
        for (binding, fixture) in resolve(&function.bindings, fixtures)? {
            let (group, number) = (binding.group, binding.binding);
            match fixture {
                Fixture::Uniform(Uniform(values)) | Fixture::Storage(Storage(values)) => {
                    resources.set_buffer(group, number, values.bytes(program, binding)?);
                }
                Fixture::CubeMap(CubeMap { levels, .. }) => {
                    let texture = texture(Dimension::Cube, levels, 6).map_err(wrong)?;
                    resources.set_texture(group, number, texture);
                }
                Fixture::Texture(Texture { levels, .. }) => {
                    let texture = texture(Dimension::D2, levels, 1).map_err(wrong)?;
                    resources.set_texture(group, number, texture);
                }
                Fixture::Sampler(sampler) => {
                    resources.set_sampler(group, number, filtering(*sampler));
                }
            }
        }
        let arguments = function.parameters.iter().flat_map(|(_, shape)| shape.lanes()).collect();
        Ok(Self {
            lowered,
            resources,
            arguments,
            results: function.result.lanes(),
            name: function.name.clone(),
            program: Arc::clone(program),
        })
    }

    /// The scalars of a result.
    pub(crate) fn results(&self) -> &[Scalar] {
        &self.results
    }

    /// Results of some cases, in the words that a driver would write.
    pub(crate) fn words(&self, cases: usize, arguments: &[u32]) -> Result<Vec<u32>, ProbeError> {
        let mut words = self.call::<F32>(cases, arguments)?.words();
        let whole = |word: &u32| {
            let bits = u16::try_from(*word).unwrap_or_default();
            half::f16::from_bits(bits).to_f32().to_bits()
        };
        each_half(&self.results, || &mut words, whole);
        Ok(words)
    }

    fn call<A: Arithmetic>(
        &self,
        cases: usize,
        arguments: &[u32],
    ) -> Result<Results<A>, ProbeError> {
        // Cases carry 16-bit floats as 32-bit ones; the engine takes their own bits.
        let mut rows = Cow::Borrowed(arguments);
        let half = |word: &u32| u32::from(half::f16::from_f32(f32::from_bits(*word)).to_bits());
        each_half(&self.arguments, || rows.to_mut(), half);
        self.lowered
            .call::<A>(cases, &rows, &self.resources, &Options::default(), &())
            .map_err(|stop| stopped(&self.program, &self.name, &stop))
    }
}

/// Runs a compute entry point, by its name in the program's text. The words of the buffers that it may
/// write, in the order of `data`.
#[cfg(feature = "routes")]
pub(crate) fn run_entry_point(
    program: &Program,
    name: &str,
    workgroups: u32,
    data: &[Data],
) -> Result<Vec<Vec<u32>>, ProbeError> {
    let settings = Settings::default();
    let lowered = Lowered::entry_point(program.module(), program.info(), name, &settings)
        .map_err(|refusal| refused(program, &refusal))?;
    let mut resources = Resources::new();
    for one in data {
        resources.set_buffer(one.group, one.binding, one.bytes.clone());
    }
    lowered
        .dispatch::<F32>([workgroups, 1, 1], &mut resources, &Options::default(), &())
        .map_err(|stop| stopped(program, name, &stop))?;
    let written = data.iter().filter(|one| one.kind == BindingKind::Storage { writable: true });
    let words = |one: &Data| {
        let bytes = resources.buffer(one.group, one.binding).unwrap_or_default();
        bytemuck::pod_collect_to_vec(bytes)
    };
    Ok(written.map(words).collect())
}

/// What the engine doesn't execute, with its place in the author's file.
fn refused(program: &Program, refusal: &Refusal) -> PathError {
    let place = place(program, refusal.span.to_range());
    let place = place.map_or_else(String::new, |place| format!(" ({place})"));
    PathError::Route { path: Path::CPU, message: format!("{refusal}{place}") }
}

fn place(program: &Program, range: Option<Range<usize>>) -> Option<Span> {
    range.and_then(|range| program.resolve(range))
}

fn stopped(program: &Program, name: &str, stop: &Stop) -> ProbeError {
    let Stop::Fuel { span, case, rounds } = stop else {
        let message = stop.to_string();
        return PathError::Route { path: Path::CPU, message }.into();
    };
    let message =
        format!("on path `cpu` `{name}` doesn't end: this loop goes round {rounds} times");
    let mut diagnostic = Diagnostic::new(message);
    if let Some(place) = place(program, span.to_range()) {
        diagnostic = diagnostic.at(place.first_line(), "");
    }
    ProbeError::Rounds { case: *case, diagnostic: Box::new(diagnostic) }
}

/// Changes the 16-bit floats of rows.
fn each_half<'w>(
    scalars: &[Scalar],
    words: impl FnOnce() -> &'w mut Vec<u32>,
    change: impl Fn(&u32) -> u32,
) {
    if scalars.contains(&Scalar::F16) {
        let words = words().iter_mut().zip(scalars.iter().cycle());
        words.filter(|(_, s)| **s == Scalar::F16).for_each(|(word, _)| *word = change(word));
    }
}

fn filtering(sampler: Sampler) -> EngineSampler {
    let filter = match sampler {
        Sampler::Linear => Filter::Linear,
        Sampler::Nearest => Filter::Nearest,
    };
    EngineSampler { mag: filter, min: filter, mip: filter, ..EngineSampler::default() }
}

fn texture(dimension: Dimension, levels: &[Level], layers: u32) -> Result<EngineTexture, String> {
    let first = levels.first().ok_or("a texture without a level")?;
    let texels = levels.iter().map(|level| Texels::Float(level.texels.clone())).collect();
    EngineTexture::new(dimension, [first.width, first.height, layers], 1, texels)
        .map_err(|error| error.to_string())
}
