//! Runs calls, passes and frames as jobs.

use crate::dispatch::{Afterwards, DispatchError, Passes};
use crate::draw::{DrawError, Drawing};
use crate::image::Image;
use crate::job::{Job, KernelJobs, Problem, Reply};
use crate::path::{Path, PathError};
use crate::probe::evidence::{self, Evidence, canary};
use crate::probe::{Call, Prepared, ProbeError, Reader, Started};

/// The largest number of cases in a job.
const BATCH: usize = 4096;

/// The largest number of words in a job's arguments or results. A job of this size is a few megabytes of JSON.
const WORDS: usize = 1 << 19;

/// The number of cases in a batch if each case needs its own job.
const ALONE: usize = 64;

type Run<'e> = Box<dyn Fn(&Job) -> Result<Reply, PathError> + Sync + 'e>;

/// A function that Karat calls through jobs.
struct ByJobs<'e> {
    run: Run<'e>,
    kernel: KernelJobs,
    evidence: Evidence,
    capacity: usize,
    alone: bool,
}

/// Prepares a function that Karat calls through jobs.
pub(super) fn prepare<'e>(
    path: Path,
    run: Run<'e>,
    call: &Call<'_>,
) -> Result<Box<dyn Prepared + 'e>, ProbeError> {
    let Call { probed, fixtures, cases } = *call;
    let form = &probed.function().form;
    if form.fragment {
        let message = "the function takes derivatives, or discards pixels and writes memory, so it runs only \
                       on drawn pixels: use one of wgpu's drivers or Karat's engine, such as the paths `vulkan` and `cpu`";
        return Err(PathError::Route { path, message: message.to_owned() }.into());
    }
    let kernel = KernelJobs::new(probed, fixtures)?;
    let (words_in, words_out) = kernel.words();
    let fit = (WORDS / words_in.max(words_out + 1)).clamp(1, BATCH);
    let most = if form.alone { ALONE } else { fit.min(kernel.largest_batch()) };
    let (capacity, alone) = (cases.clamp(1, most), form.alone);
    let evidence = Evidence::of(probed.function(), path, words_out);
    Ok(Box::new(ByJobs { run, kernel, evidence, capacity, alone }))
}

impl ByJobs<'_> {
    /// Runs a job for some cases. The results' buffer contains `poison` at first. Checks the canaries. Returns the
    /// words of the results, and the job's other outputs.
    fn outputs(
        &self,
        cases: usize,
        arguments: &[u32],
        poison: u32,
    ) -> Result<(Vec<u32>, Vec<Vec<u32>>), ProbeError> {
        let canary = canary();
        let job = self.kernel.job(cases, arguments, canary, poison)?;
        let path = self.evidence.path;
        let place = |problem: &Problem| located(problem, |_, bytes| self.kernel.resolve(bytes));
        let mut outputs = done((self.run)(&job)?, path, &job, place)?;
        let words = outputs.remove(0);
        self.evidence.expect_canaries(&words, cases, canary)?;
        Ok((words, outputs))
    }

    /// Runs all cases in one job, or each case in its own job if `alone` is set. Returns the results' words.
    /// If `alone` is set, also returns the values that each case wrote into resources.
    fn over(
        &self,
        cases: usize,
        arguments: &[u32],
        poison: u32,
    ) -> Result<(Vec<u32>, Vec<Vec<u32>>), ProbeError> {
        if !self.alone {
            return Ok((self.outputs(cases, arguments, poison)?.0, Vec::new()));
        }
        let (words_in, _) = self.kernel.words();
        let (mut words, mut written) = (Vec::new(), Vec::new());
        for case in 0..cases {
            let own = &arguments[case * words_in..][..words_in];
            let (own, others) = self.outputs(1, own, poison)?;
            words.extend(own);
            written.push(self.kernel.written(&others));
        }
        Ok((words, written))
    }

    /// Returns the rows of results for all cases, and the number of words in a row. Checks that the executor wrote
    /// every word of the results.
    fn rows(&self, cases: usize, arguments: &[u32]) -> Result<(Vec<u32>, usize), ProbeError> {
        let (words, written) = self.over(cases, arguments, evidence::WORD)?;
        let places = self.evidence.poisoned(&words);
        if !places.is_empty() {
            let (again, _) = self.over(cases, arguments, evidence::OTHER)?;
            self.evidence.expect_written(&words, places, &self.evidence.poisoned(&again))?;
        }
        if !self.alone {
            return Ok((words, self.evidence.stride));
        }
        let mut rows = Vec::new();
        for (words, written) in words.chunks_exact(self.evidence.stride).zip(&written) {
            rows.extend_from_slice(&words[..self.evidence.stride - 1]);
            rows.extend_from_slice(written);
        }
        let stride = rows.len() / cases.max(1);
        Ok((rows, stride))
    }
}

impl Prepared for ByJobs<'_> {
    fn capacity(&self) -> usize {
        self.capacity
    }

    fn start<'p>(&'p self, cases: usize, arguments: &[u32]) -> Result<Started<'p>, ProbeError> {
        let arguments = arguments.to_vec();
        Ok(Box::new(move |read: Reader<'_>| {
            let (rows, stride) = self.rows(cases, &arguments)?;
            read(&rows, stride);
            Ok(())
        }))
    }
}

pub(super) fn dispatch(
    path: Path,
    run: &dyn Fn(&Job) -> Result<Reply, PathError>,
    passes: &Passes,
) -> Result<Afterwards, DispatchError> {
    let job = Job::of_passes(passes)?;
    let place = |problem: &Problem| {
        located(problem, |pass, bytes| passes.passes.get(pass)?.program.resolve(bytes))
    };
    let reply = run(&job).map_err(|error| match error {
        PathError::NoJobs { path } => DispatchError::Unable { path },
        error => error.into(),
    })?;
    let outputs = done(reply, path, &job, place)?;
    Ok(job.outputs.iter().copied().zip(outputs).collect())
}

pub(super) fn draw(
    path: Path,
    run: &dyn Fn(&Job) -> Result<Reply, PathError>,
    drawing: &Drawing<'_>,
) -> Result<Image, DrawError> {
    let job = Job::of_drawing(drawing)?;
    let place = |problem: &Problem| located(problem, |_, bytes| drawing.program().resolve(bytes));
    let reply = run(&job).map_err(|error| match error {
        PathError::NoJobs { path } => DrawError::Unable { path },
        error => error.into(),
    })?;
    let words = done(reply, path, &job, place)?.remove(0);
    let (width, height) = drawing.size();
    let pixels = words.chunks_exact(4).map(|pixel| [0, 1, 2, 3].map(|k| f32::from_bits(pixel[k])));
    Ok(Image::new(width, height, pixels.collect()))
}

/// Returns the outputs of a reply. Returns an error if the executor refused the job, if the job failed, or if an output
/// has the wrong length. `place` finds the position of a problem in the author's file.
fn done(
    reply: Reply,
    path: Path,
    job: &Job,
    place: impl Fn(&Problem) -> String,
) -> Result<Vec<Vec<u32>>, PathError> {
    match reply {
        Reply::Done(outputs) => {
            let found: Vec<usize> = outputs.iter().map(Vec::len).collect();
            let expected = job.lengths();
            if found == expected {
                return Ok(outputs);
            }
            let message = format!(
                "the executor returned outputs of {found:?} words, but the job needs {expected:?}"
            );
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

/// Returns the position of a problem, such as ` (shaders/a.wgsl:3:5)`, or an empty text.
fn located(
    problem: &Problem,
    resolve: impl Fn(usize, std::ops::Range<usize>) -> Option<crate::diagnostic::Span>,
) -> String {
    let place = problem.bytes.clone().and_then(|bytes| resolve(problem.pass, bytes));
    place.map_or_else(String::new, |place| format!(" ({place})"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::{Buffer, Fixtures, Texture};
    use crate::package::Package;
    use crate::probe::Probed;

    /// Calls a function through jobs that the engine runs, and returns the results row by row.
    fn called(text: &str, fixtures: Fixtures, rows: &[u32]) -> Vec<Vec<u32>> {
        called_with(&|_, _| {}, text, fixtures, rows).expect("it runs")
    }

    /// Calls the function like `called`. `fault` changes the words that a job returns.
    fn called_with(
        fault: &(dyn Fn(&Job, &mut Vec<Vec<u32>>) + Sync),
        text: &str,
        fixtures: Fixtures,
        rows: &[u32],
    ) -> Result<Vec<Vec<u32>>, String> {
        let engine = super::super::of(Path::CPU).expect("it opens");
        let package = Package::from_source("p", text);
        let mut probed = Probed::new(&package, "f").expect("it is called");
        probed.fit(&fixtures).expect("they fit");
        let call = Call { probed: &probed, fixtures: &fixtures, cases: rows.len() };
        let run: Run<'_> = Box::new(|job| {
            let mut reply = super::super::raised(engine, job);
            if let Reply::Done(outputs) = &mut reply {
                fault(job, outputs);
            }
            Ok(reply)
        });
        let prepared = prepare(Path::CPU, run, &call).expect("it is prepared");
        let mut found = Vec::new();
        let started = prepared.start(rows.len(), rows).expect("it starts");
        let lanes = probed.function().result.lanes().len();
        let mut read = |words: &[u32], stride: usize| {
            found = words.chunks_exact(stride).map(|row| row[..lanes].to_vec()).collect();
        };
        started(&mut read).map_err(|error| error.to_string())?;
        Ok(found)
    }

    #[test]
    fn each_case_of_a_function_that_writes_has_its_own_arguments() {
        let text = "@group(0) @binding(0) var<storage, read_write> seen: array<u32, 2>;
            fn f(x: u32) -> u32 { seen[x % 2u] += x; return x + 1u; }";
        let seen = vec![("seen".to_owned(), Buffer::from_pod(&[5_u32, 6]).into())];
        let found = called(text, seen, &[10, 20, 31]);
        assert_eq!(found, [[11, 15, 6], [21, 25, 6], [32, 5, 37]]);
        let two = "@group(0) @binding(0) var<storage, read_write> sum: u32;
            @group(0) @binding(1) var<storage, read_write> last: u32;
            fn f(x: u32) -> u32 { sum += x; last = 2u * x; return 0u; }";
        let both = ["sum", "last"].map(|name| (name.to_owned(), Buffer::from_pod(&[1_u32]).into()));
        assert_eq!(called(two, both.to_vec(), &[10, 20]), [[0, 11, 20], [0, 21, 40]]);
        let plain = "fn f(x: u32) -> vec2u { return vec2u(x, 2u * x); }";
        assert_eq!(called(plain, Vec::new(), &[1, 4, 9]), [[1, 2], [4, 8], [9, 18]]);
    }

    /// Karat doesn't accept unwritten words, words from another dispatch, or too few words as results.
    #[test]
    fn unwritten_and_missing_results_of_a_job_are_errors() {
        let text = "fn f(x: u32) -> vec2u { return vec2u(x, 2u * x); }";
        let error = |fault: &(dyn Fn(&Job, &mut Vec<Vec<u32>>) + Sync)| {
            called_with(fault, text, Vec::new(), &[1, 4, 9]).expect_err("it is a fault")
        };
        let unwritten = error(&|job, outputs| {
            let crate::job::Resource::Buffer { words } = &job.resources[job.outputs[0]] else {
                panic!("results are a buffer")
            };
            outputs[0][4] = words[4];
        });
        assert!(unwritten.contains("never wrote 1 of 6 result words"), "{unwritten}");
        let other = error(&|_, outputs| outputs[0][5] ^= 1);
        assert!(other.contains("wrote no result for 1 of 3 cases"), "{other}");
        let short = error(&|_, outputs| outputs[0].truncate(8));
        assert!(
            short.contains("the executor returned outputs of [8] words, but the job needs [9]"),
            "{short}"
        );
        let none = error(&|_, outputs| outputs.clear());
        assert!(
            none.contains("the executor returned outputs of [] words, but the job needs [9]"),
            "{none}"
        );
    }

    /// A result may equal the poison. Karat then computes the result again with another poison.
    #[test]
    fn a_result_may_equal_the_value_that_marks_unwritten_memory() {
        let text = format!("fn f(x: u32) -> u32 {{ return {}u + x; }}", evidence::WORD);
        let rows = [0, 1, evidence::OTHER - evidence::WORD];
        let expected = [[evidence::WORD], [evidence::WORD + 1], [evidence::OTHER]];
        assert_eq!(called(&text, Vec::new(), &rows), expected);
        let immediate = "var<immediate> k: u32; fn f(x: u32) -> u32 { return 10u * k + x; }";
        let four = vec![("k".to_owned(), Buffer::from_pod(&[4_u32]).into())];
        assert_eq!(called(immediate, four, &[1, 2]), [[41], [42]]);
    }

    /// A job is at most a few megabytes of text.
    #[test]
    fn the_number_of_cases_of_a_job_is_limited_by_its_size() {
        let capacity = |text: &str, fixtures: Fixtures, cases: usize| {
            let package = Package::from_source("p", text);
            let mut probed = Probed::new(&package, "f").expect("it is called");
            probed.fit(&fixtures).expect("they fit");
            let call = Call { probed: &probed, fixtures: &fixtures, cases };
            let run: Run<'_> = Box::new(|_| unreachable!("it isn't called"));
            prepare(Path::CPU, run, &call).expect("it is prepared").capacity()
        };
        let of = |text: &str, cases| capacity(text, Vec::new(), cases);
        let twice = "fn f(x: f32) -> f32 { return 2.0 * x; }";
        assert_eq!([of(twice, 0), of(twice, 100), of(twice, 100_000)], [1, 100, 4096]);
        // 1,023 words and a canary.
        let large = "fn f(x: f32) -> array<f32, 1023> { return array<f32, 1023>(); }";
        assert_eq!(of(large, 100_000), 512);
        assert_eq!(of("fn f(x: array<f32, 2048>) -> f32 { return x[1]; }", 100_000), 256);
        let writes = "@group(0) @binding(0) var<storage, read_write> sum: u32;
            fn f(x: u32) -> u32 { sum += x; return x; }";
        let sum = vec![("sum".to_owned(), Buffer::zeros(4).into())];
        assert_eq!(capacity(writes, sum, 100_000), 64);
    }

    /// JSON can't write infinity.
    #[test]
    fn a_job_round_trips_through_json() {
        let text = "@group(0) @binding(0) var image: texture_2d<f32>;
            @group(0) @binding(1) var linear: sampler;
            fn f(x: f32) -> f32 { return textureSampleLevel(image, linear, vec2f(x), 0.0).x; }";
        let probed = Probed::new(&Package::from_source("p", text), "f").expect("it is called");
        let image = Texture::from_fn(2, 1, |x, _| glam::Vec4::splat(x as f32));
        let fixtures: Fixtures = vec![
            ("image".to_owned(), image.into()),
            ("linear".to_owned(), crate::fixture::Sampler::LINEAR.lod(0.5, f32::INFINITY).into()),
        ];
        let kernel = KernelJobs::new(&probed, &fixtures).expect("it is a job");
        let job = kernel.job(1, &[0], 1, 0).expect("it is a job");
        let text = serde_json::to_string(&job).expect("it is text");
        let back: Job = serde_json::from_str(&text).expect("it is the same");
        let crate::job::Resource::Sampler(sampler) = back.resources[1] else { panic!("{text}") };
        assert_eq!(sampler.lod, (0.5, 32.0));
    }

    /// A job contains the format of a storage texture, even if the first pass doesn't write the texture.
    #[test]
    fn a_texture_that_a_later_pass_stores_has_its_format() {
        let text = "@group(0) @binding(0) var read: texture_2d<f32>;
            @group(0) @binding(1) var sum: texture_storage_2d<r32float, write>;
            @group(0) @binding(2) var<storage, read_write> data: array<f32>;
            @compute @workgroup_size(1) fn first() { data[0] = textureLoad(read, vec2u(0u), 0).x; }
            @compute @workgroup_size(1) fn second() { textureStore(sum, vec2u(0u), vec4f(data[0])); }";
        let package = Package::from_source("p", text);
        let wanted = ["first", "second"]
            .map(|name| crate::dispatch::Wanted { name: name.to_owned(), workgroups: [1; 3] });
        let image = Texture::from_fn(1, 1, |_, _| glam::Vec4::ONE);
        let fixtures: Fixtures =
            vec![("read".to_owned(), image.into()), ("data".to_owned(), Buffer::zeros(4).into())];
        let shared = [("sum".to_owned(), "read".to_owned())];
        let passes = Passes::new(&package, &wanted, (&fixtures, &shared), &Default::default());
        let job = Job::of_passes(&passes.expect("they fit")).expect("it is a job");
        let formats = job.resources.iter().filter_map(|resource| match resource {
            crate::job::Resource::Texture { format, .. } => Some(format.clone()),
            _ => None,
        });
        assert_eq!(formats.collect::<Vec<_>>(), [Some("r32float".to_owned())]);
    }

    /// Programs other than Karat make textures only from the job's data, so the job must say that a texture
    /// contains depths.
    #[test]
    fn a_texture_for_depths_is_one_of_depths() {
        let ramp = || Texture::from_fn(2, 1, |x, _| 0.25 + x as f32 / 2.0);
        let texels = |kind: &str, load: &str| {
            let text = format!(
                "@group(0) @binding(0) var image: {kind};
                fn f(x: u32) -> f32 {{ return textureLoad(image, vec2u(x, 0u), 0){load}; }}"
            );
            let fixtures: Fixtures = vec![("image".to_owned(), ramp().into())];
            let found = called(&text, fixtures.clone(), &[0, 1]);
            assert_eq!(found, [[0.25_f32.to_bits()], [0.75_f32.to_bits()]]);
            let probed = Probed::new(&Package::from_source("p", text), "f").expect("it is called");
            let kernel = KernelJobs::new(&probed, &fixtures).expect("it is a job");
            let job = kernel.job(1, &[0], 1, 0).expect("it is a job");
            let texels = job.resources.iter().find_map(|resource| match resource {
                crate::job::Resource::Texture { texture, .. } => Some(texture.texels),
                _ => None,
            });
            texels.expect("a texture")
        };
        use crate::reflect::Texels;
        assert_eq!(texels("texture_depth_2d", ""), Texels::Depth);
        assert_eq!(texels("texture_2d<f32>", ".x"), Texels::Float);
    }
}
