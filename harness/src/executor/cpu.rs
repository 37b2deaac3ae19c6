//! The path `cpu`: Karat's own engine, which needs no driver.

use std::borrow::Cow;
use std::sync::Arc;

use karat_engine::{
    Dimension, F32, Filter, Options, Program as Lowered, Resources, Sampler as EngineSampler,
    Settings, Stop, Texels, Texture as EngineTexture,
};

use super::Executor;
use crate::diagnostic::Diagnostic;
use crate::fixture::{CubeMap, Fixture, Level, Sampler, Storage, Texture, Uniform, resolve};
use crate::path::{Adapter, Path, PathError, cpu};
use crate::probe::{Call, Prepared, ProbeError, Probed, Reader, Started};
use crate::reflect::Program;
use crate::value::Scalar;

/// The engine: WGSL on the CPU in `f32`, as a conforming GPU computes it. It calls functions, and
/// draws no frames.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cpu;

impl Executor for Cpu {
    fn path(&self) -> Path {
        Path::CPU
    }

    fn adapter(&self) -> Adapter {
        cpu::adapter()
    }

    fn prepare<'e>(&'e self, call: &Call<'_>) -> Result<Box<dyn Prepared + 'e>, ProbeError> {
        Ok(Box::new(Ready::new(call)?))
    }
}

/// A function that is lowered, with what it reads.
#[derive(Debug)]
struct Ready {
    lowered: Lowered,
    resources: Resources,
    cases: usize,
    /// The scalars of a case's arguments and of its result.
    arguments: Vec<Scalar>,
    results: Vec<Scalar>,
    name: String,
    /// Knows the author's places, for loops that don't end.
    program: Arc<Program>,
}

impl Ready {
    fn new(call: &Call<'_>) -> Result<Self, ProbeError> {
        let Call { probed, fixtures, cases } = *call;
        let Probed { program, function, .. } = probed;
        let refused = |message: String| PathError::Route { path: Path::CPU, message };
        let name = program.name_of(&function.name);
        let (module, info) = (program.module(), program.info());
        let lowered =
            Lowered::function(module, info, name, &Settings::default()).map_err(|refusal| {
                let place = refusal.span.to_range().and_then(|range| program.resolve(range));
                let place = place.map_or_else(String::new, |place| format!(" ({place})"));
                refused(format!("{refusal}{place}"))
            })?;
        let mut resources = Resources::new();
        for (binding, fixture) in resolve(&function.bindings, fixtures)? {
            let (group, number) = (binding.group, binding.binding);
            match fixture {
                Fixture::Uniform(Uniform(values)) | Fixture::Storage(Storage(values)) => {
                    resources.set_buffer(group, number, values.bytes(program, binding)?);
                }
                Fixture::CubeMap(CubeMap { levels, .. }) => {
                    let texture = texture(Dimension::Cube, levels, 6).map_err(refused)?;
                    resources.set_texture(group, number, texture);
                }
                Fixture::Texture(Texture { levels, .. }) => {
                    let texture = texture(Dimension::D2, levels, 1).map_err(refused)?;
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
            cases: cases.max(1),
            arguments,
            results: function.result.lanes(),
            name: function.name.clone(),
            program: Arc::clone(program),
        })
    }

    fn stopped(&self, stop: &Stop) -> ProbeError {
        let Stop::Fuel { span, case, rounds } = stop else {
            let message = stop.to_string();
            return PathError::Route { path: Path::CPU, message }.into();
        };
        let message = format!(
            "on path `cpu` `{}` doesn't end: this loop goes round {rounds} times",
            self.name
        );
        let mut diagnostic = Diagnostic::new(message);
        if let Some(place) = span.to_range().and_then(|range| self.program.resolve(range)) {
            diagnostic = diagnostic.at(place.first_line(), "");
        }
        ProbeError::Rounds { case: *case, diagnostic: Box::new(diagnostic) }
    }
}

impl Prepared for Ready {
    fn capacity(&self) -> usize {
        self.cases
    }

    fn start<'p>(&'p self, cases: usize, arguments: &[u32]) -> Result<Started<'p>, ProbeError> {
        // Cases carry 16-bit floats as 32-bit ones; the engine takes their own bits.
        let mut rows = Cow::Borrowed(arguments);
        let half = |word: &u32| u32::from(half::f16::from_f32(f32::from_bits(*word)).to_bits());
        each_half(&self.arguments, || rows.to_mut(), half);
        let options = Options::default();
        let results = self
            .lowered
            .call::<F32>(cases, &rows, &self.resources, &options, &())
            .map_err(|stop| self.stopped(&stop))?;
        let mut words = results.words();
        let whole = |word: &u32| {
            let bits = u16::try_from(*word).unwrap_or_default();
            half::f16::from_bits(bits).to_f32().to_bits()
        };
        each_half(&self.results, || &mut words, whole);
        let width = self.results.len();
        Ok(Box::new(move |read: Reader<'_>| {
            read(&words, width);
            Ok(())
        }))
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::Fixtures;
    use crate::package::Package;

    fn call(
        text: &str,
        function: &str,
        fixtures: Fixtures,
        rows: &[u32],
    ) -> Result<Vec<u32>, String> {
        let package = Package::from_source("cpu", text);
        let probed = Probed::new(&package, function).map_err(|error| error.to_string())?;
        let width: usize =
            probed.function().parameters.iter().map(|(_, shape)| shape.lanes().len()).sum();
        let cases = rows.len() / width.max(1);
        let call = Call { probed: &probed, fixtures: &fixtures, cases };
        let prepared = Cpu.prepare(&call).map_err(|error| error.to_string())?;
        let mut found = Vec::new();
        let mut read = |words: &[u32], stride: usize| {
            assert_eq!(stride, probed.function().result.lanes().len());
            found.extend_from_slice(words);
        };
        let started = prepared.start(cases, rows).map_err(|error| error.to_string())?;
        started(&mut read).map_err(|error| error.to_string())?;
        Ok(found)
    }

    #[test]
    fn functions_are_called_with_their_rows() {
        let text = "enable f16;\nstruct S { a: vec2f, b: bool }\n\
                    fn f(s: S, n: i32) -> vec2f { return select(s.a, s.a.yx, s.b) * f32(n); }\n\
                    fn half(h: f16) -> f16 { return h * 2.0h; }\n";
        let rows = [1.5_f32.to_bits(), 4.0_f32.to_bits(), 1, (-2_i32).cast_unsigned()];
        let found = call(text, "f", Fixtures::new(), &rows).expect("it runs");
        assert_eq!(found, [-8.0_f32, -3.0].map(f32::to_bits));
        let found = call(text, "half", Fixtures::new(), &[0.25_f32.to_bits()]).expect("it runs");
        assert_eq!(found, [0.5_f32.to_bits()]);
    }

    #[test]
    fn fixtures_are_read() {
        let text = "@group(0) @binding(0) var<uniform> scale: f32;\n\
                    @group(0) @binding(1) var image: texture_2d<f32>;\n\
                    @group(0) @binding(2) var linear: sampler;\n\
                    fn f(u: f32) -> f32 {\n    \
                    return scale * textureSampleLevel(image, linear, vec2f(u, 0.5), 0.0).x;\n}\n";
        let ramp = Texture::from_fn(2, 1, |x, _| glam::Vec4::splat(x as f32));
        let fixtures: Fixtures = [
            ("scale".to_owned(), Uniform::new(8.0_f32).into()),
            ("image".to_owned(), ramp.into()),
            ("linear".to_owned(), Sampler::Linear.into()),
        ]
        .into_iter()
        .collect();
        // Texels' centres are at 0.25 and 0.75.
        let rows = [0.25_f32, 0.5, 0.75, 1.0].map(f32::to_bits);
        let found = call(text, "f", fixtures, &rows).expect("it runs");
        assert_eq!(found, [0.0_f32, 4.0, 8.0, 8.0].map(f32::to_bits));
        let missing = call(text, "f", Fixtures::new(), &rows).expect_err("nothing is supplied");
        assert!(missing.contains("scale"), "{missing}");
    }

    #[test]
    fn a_loop_without_an_end_is_told_with_its_line() {
        let text = "fn f(x: f32) -> f32 {\n    var y = x;\n    while y >= x { y += 0.0; }\n    return y;\n}\n";
        let error = call(text, "f", Fixtures::new(), &[1.0_f32.to_bits()]).expect_err("endless");
        assert!(error.contains("doesn't end: this loop goes round 1048576 times"), "{error}");
        assert!(error.contains(":3:5"), "{error}");
    }
}
