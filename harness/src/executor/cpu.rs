//! The path `cpu`: Karat's own engine, which needs no driver.

use super::Executor;
use crate::dispatch::{Afterwards, DispatchError, Passes};
use crate::interpret::{Alone, Interpreted};
use crate::job::{Job, Reply};
use crate::path::{Ability, Adapter, Path, PathError, Via, cpu};
use crate::probe::{Call, Prepared, ProbeError, Reader, Started};

/// The engine as an executor. The engine runs WGSL on the CPU in `f32`, with results that WGSL allows. The engine calls
/// functions and dispatches passes, but draws no frames.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cpu {
    /// The arithmetic: plain, with fused multiply-add, or with flush-to-zero.
    via: Via,
}

pub(crate) fn of(path: Path) -> &'static Cpu {
    match path.via() {
        Via::Fma => &Cpu { via: Via::Fma },
        Via::Ftz => &Cpu { via: Via::Ftz },
        _ => &Cpu { via: Via::Direct },
    }
}

impl Executor for Cpu {
    fn path(&self) -> Path {
        Path::CPU.through(self.via)
    }

    fn adapter(&self) -> Adapter {
        cpu::adapter(self.path())
    }

    fn can(&self, ability: Ability) -> bool {
        ability != Ability::Frames
    }

    fn subgroups(&self) -> Option<[u32; 2]> {
        Some([crate::interpret::SUBGROUP; 2])
    }

    fn run(&self, job: &Job) -> Result<Reply, PathError> {
        Ok(super::raised(self, job))
    }

    fn prepare<'e>(&'e self, call: &Call<'_>) -> Result<Box<dyn Prepared + 'e>, ProbeError> {
        let Call { probed, fixtures, cases } = *call;
        let cases = cases.max(1);
        if probed.function().form.alone {
            let function = Alone::rounding(probed, fixtures, self.via)?;
            let width = probed.function().result.lanes().len();
            return Ok(Box::new(ReadyAlone { function, cases, width }));
        }
        let function = Interpreted::rounding(probed, fixtures, self.via)?;
        Ok(Box::new(Ready { function, cases }))
    }

    fn dispatch(&self, passes: &Passes) -> Result<Afterwards, DispatchError> {
        crate::interpret::dispatch_rounding(passes, self.via)
    }
}

#[derive(Debug)]
struct Ready {
    function: Interpreted,
    cases: usize,
}

impl Prepared for Ready {
    fn capacity(&self) -> usize {
        self.cases
    }

    fn start<'p>(&'p self, cases: usize, arguments: &[u32]) -> Result<Started<'p>, ProbeError> {
        let words = self.function.words(cases, arguments)?;
        let width = self.function.results().len();
        Ok(Box::new(move |read: Reader<'_>| {
            read(&words, width);
            Ok(())
        }))
    }
}

/// A prepared function that runs each case alone, so no case sees the writes of earlier cases.
#[derive(Debug)]
struct ReadyAlone {
    function: Alone,
    cases: usize,
    width: usize,
}

impl Prepared for ReadyAlone {
    fn capacity(&self) -> usize {
        self.cases
    }

    fn start<'p>(&'p self, cases: usize, arguments: &[u32]) -> Result<Started<'p>, ProbeError> {
        let words = self.function.words(cases, arguments)?;
        Ok(Box::new(move |read: Reader<'_>| {
            read(&words, self.width);
            Ok(())
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::{Fixtures, Sampler, Texture, Uniform};
    use crate::package::Package;
    use crate::probe::Probed;

    fn call(
        text: &str,
        function: &str,
        fixtures: Fixtures,
        rows: &[u32],
    ) -> Result<Vec<u32>, String> {
        call_on(Path::CPU, text, function, fixtures, rows)
    }

    fn call_on(
        path: Path,
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
        let prepared = of(path).prepare(&call).map_err(|error| error.to_string())?;
        let mut found = Vec::new();
        let mut read = |words: &[u32], stride: usize| {
            assert_eq!(stride, probed.function().result.lanes().len());
            found.extend_from_slice(words);
        };
        let started = prepared.start(cases, rows).map_err(|error| error.to_string())?;
        started(&mut read).map_err(|error| error.to_string())?;
        Ok(found)
    }

    // Lesson 115
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
    fn cpu_paths_can_flush_subnormals_or_fuse_products() {
        let text = "@group(0) @binding(0) var<storage, read_write> out: f32;\n\
                    fn square(x: f32) -> f32 { return x * x - 1.0; }\n\
                    fn half(x: f32) -> f32 { return x * 0.5; }\n\
                    fn store(x: f32) -> f32 { out = x * x - 1.0; return x * 0.5; }\n";
        let on = |path: &str, function: &str, x: f32| {
            let path = path.parse().expect("a path");
            let fixtures: Fixtures = match function {
                "store" => vec![("out".to_owned(), crate::fixture::Buffer::zeros(4).into())],
                _ => Fixtures::new(),
            };
            let words = call_on(path, text, function, fixtures, &[x.to_bits()]).expect("it runs");
            words.into_iter().map(f32::from_bits).collect::<Vec<_>>()
        };
        let x = 1.0 + 2.0_f32.powi(-12);
        let (twice, once) = (x * x - 1.0, x.mul_add(x, -1.0));
        assert_ne!(twice, once);
        assert_eq!((on("cpu", "square", x), on("cpu:fma", "square", x)), (vec![twice], vec![once]));
        let tiny = f32::MIN_POSITIVE;
        assert_eq!(
            (on("cpu", "half", tiny), on("cpu:ftz", "half", tiny)),
            (vec![0.5 * tiny], vec![0.0])
        );
        assert_eq!(on("cpu:fma", "store", x), [0.5 * x, once]);
        assert_eq!(on("cpu:ftz", "store", tiny), [0.0, -1.0]);
        for wrong in ["vulkan:fma", "cpu:hlsl", "cpu:ftz@llvmpipe"] {
            let path: Path = wrong.parse().expect("a name");
            assert!(super::super::of(path).is_err(), "{wrong}");
        }
    }

    // Lesson 115
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
            ("linear".to_owned(), Sampler::LINEAR.into()),
        ]
        .into_iter()
        .collect();
        // The centres of the two texels are at 0.25 and 0.75.
        let rows = [0.25_f32, 0.5, 0.75, 1.0].map(f32::to_bits);
        let found = call(text, "f", fixtures, &rows).expect("it runs");
        assert_eq!(found, [0.0_f32, 4.0, 8.0, 8.0].map(f32::to_bits));
        let missing = call(text, "f", Fixtures::new(), &rows).expect_err("nothing is supplied");
        assert!(missing.contains("scale"), "{missing}");
    }

    // Lesson 115
    #[test]
    fn an_endless_loop_is_reported_with_its_line() {
        let text = "fn f(x: f32) -> f32 {\n    var y = x;\n    while y >= x { y += 0.0; }\n    return y;\n}\n";
        let error = call(text, "f", Fixtures::new(), &[1.0_f32.to_bits()]).expect_err("endless");
        assert!(error.contains("was stopped: this loop had run 1048576 iterations"), "{error}");
        assert!(error.contains(":3:5"), "{error}");
    }
}
