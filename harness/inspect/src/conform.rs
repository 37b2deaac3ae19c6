//! Asks an executor questions: jobs with known results. Authors of executors can test their programs in this way.
//!
//! Each question tests one rule of the protocol, so a wrong answer shows which part to fix. Karat runs the jobs through
//! [`Executor::run`], as in tests. The questions also work with drivers and with Karat's own engine.

use std::collections::BTreeMap;
use std::ops::Range;
use std::time::Instant;

use karat::compute::ComputeError;
use karat::draw::DrawError;
use karat::fixture::{Compare, Fixture};
use karat::frame::FrameError;
use karat::path::PathError;
use karat::unstable::dispatch::DispatchError;
use karat::unstable::executor::{self, Executor};
use karat::unstable::job::{Bound, Job, Pass, Problem, Reply, Resource, Shader, Work};
use karat::unstable::path::Ability;
use karat::unstable::path::Adapter;
use karat::unstable::probe::Probed;
use karat::unstable::settings;
use karat::{Package, Path, Sampler, Storage, Texture, Uniform};
use serde::Serialize;

/// The answers of an executor to all questions.
///
/// ```
/// use karat::Path;
/// use karat_inspect::conform::Answer;
///
/// let report = karat_inspect::conform::conform(Path::CPU, &mut |_| {})?;
/// assert_eq!(report.count(Answer::Wrong), 0);
/// # Ok::<(), karat::path::PathError>(())
/// ```
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The executor's adapter, as the executor describes it when it starts.
    pub adapter: Adapter,
    /// All questions with their answers, in order.
    pub answers: Vec<Answered>,
}

impl Report {
    /// Counts the questions with this result.
    #[must_use]
    pub fn count(&self, answer: Answer) -> usize {
        self.answers.iter().filter(|one| one.answer == answer).count()
    }
}

/// A question with its result.
#[derive(Clone, Debug, Serialize)]
pub struct Answered {
    /// The question's name, one word: `untouched`.
    pub name: &'static str,
    /// The protocol rule that the question tests.
    pub rule: &'static str,
    /// The question's result.
    pub answer: Answer,
    /// The reason why the answer isn't right; empty for a right answer.
    pub why: String,
}

/// Karat's verdict on an executor's answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Answer {
    /// The executor gave the expected answer.
    Right,
    /// The executor gave another answer, or no answer.
    Wrong,
    /// The executor refused a shader that executors don't need to support. In a test, `refused_on` declares that an
    /// executor refuses the test's shader.
    Refused,
    /// Karat didn't ask the question: the executor lacks an ability that the question needs, or the executor hung in
    /// earlier questions.
    NotAsked,
}

/// The reason why the answer to a question isn't right.
enum Stop {
    Refused(String),
    Wrong(String),
}

impl<T: Into<String>> From<T> for Stop {
    fn from(why: T) -> Self {
        Self::Wrong(why.into())
    }
}

/// The number of timeouts after which Karat asks no more questions.
const MOST_HUNG: usize = 2;

/// Asks an executor all questions. Calls `tell` with each answer as soon as it arrives.
///
/// # Errors
/// Returns an error if Karat can't open the path. In this case, Karat asks no question.
pub fn conform(path: Path, tell: &mut dyn FnMut(&Answered)) -> Result<Report, PathError> {
    let executor = executor::of(path)?;
    let (mut answers, mut hung) = (Vec::new(), 0);
    for (name, needs, rule, ask) in &QUESTIONS {
        let lacks = needs.filter(|ability| !executor.can(*ability)).map(|ability| {
            let name = serde_json::to_value(ability).expect("an ability serializes to JSON");
            format!(
                "the program's greeting doesn't name the ability `{}`",
                name.as_str().unwrap_or_default()
            )
        });
        let over = (hung >= MOST_HUNG).then(|| format!("the program hung {hung} times"));
        let (answer, why) = match lacks.or(over) {
            Some(why) => (Answer::NotAsked, why),
            None => {
                let began = Instant::now();
                let asked = ask(executor);
                hung += usize::from(began.elapsed() >= settings::deadline());
                match (asked, needs) {
                    (Ok(()), _) => (Answer::Right, String::new()),
                    (Err(Stop::Refused(why)), Some(_)) => (Answer::Refused, why),
                    // Executors must support passes over buffers, so a refusal is wrong here.
                    (Err(Stop::Refused(why) | Stop::Wrong(why)), _) => (Answer::Wrong, why),
                }
            }
        };
        answers.push(Answered { name, rule, answer, why });
        tell(answers.last().expect("the answer was added"));
    }
    Ok(Report { adapter: executor.adapter(), answers })
}

/// A question: its name, the ability that it needs, the rule that it tests, and the function that asks it.
type Question =
    (&'static str, Option<Ability>, &'static str, fn(&dyn Executor) -> Result<(), Stop>);

const QUESTIONS: [Question; 21] = [
    (
        "bits",
        None,
        "all bits come back unchanged, even the bits of NaN, -0 and subnormal numbers",
        bits,
    ),
    (
        "untouched",
        None,
        "a buffer has the job's values at first, and elements that no shader writes keep their values",
        untouched,
    ),
    (
        "outputs",
        None,
        "a reply has only the requested resources, in the job's order and with the job's lengths",
        outputs,
    ),
    ("grid", None, "`workgroups` counts workgroups in each direction", grid),
    (
        "workgroup",
        None,
        "workgroup memory is zero at first, and barriers order its reads and writes",
        workgroup,
    ),
    ("atomics", None, "atomic operations of all workgroups use the same buffer", atomics),
    ("passes", None, "passes run one after the other, over the same resources", passes),
    (
        "layout",
        None,
        "resources are found by group and binding, and uniforms have WGSL's layout",
        layout,
    ),
    ("overrides", None, "overrides are found by their `@id`, or by their names", overrides),
    ("long", None, "lines of several megabytes are read and written completely", long),
    ("function", None, "the kernel that calls a function runs once for each case", function),
    (
        "refusal",
        None,
        "a job with an invalid shader is `refused`, with a message and the pass's number; the next job runs",
        refusal,
    ),
    (
        "levels",
        Some(Ability::Textures),
        "a texture keeps the contents of each mip level, with the top row first",
        levels,
    ),
    ("sampling", Some(Ability::Textures), "samplers filter and repeat as the job says", sampling),
    (
        "depths",
        Some(Ability::Textures),
        "`textureSampleCompare` compares depths with a reference",
        depths,
    ),
    (
        "stored",
        Some(Ability::Textures),
        "a storage texture comes back as four 32-bit numbers for each texel",
        stored,
    ),
    ("halves", Some(Ability::F16), "`enable f16;` runs", halves),
    ("subgroups", Some(Ability::Subgroups), "operations of subgroups run", subgroups),
    (
        "immediates",
        Some(Ability::Immediates),
        "a resource with the key `at` = null becomes the value of `var<immediate>`",
        immediates,
    ),
    (
        "pixels",
        Some(Ability::Frames),
        "an image has its top row first, and pixels without a fragment are transparent black",
        pixels,
    ),
    (
        "nearest",
        Some(Ability::Frames),
        "if two draws cover a pixel, the nearer draw is visible",
        nearest,
    ),
];

/// The passes of one question, with their resources. One of the resources is the buffer `out`.
struct Passes<'a> {
    wgsl: &'a str,
    with: Vec<(&'a str, Fixture)>,
    overrides: &'a [(&'a str, f64)],
    dispatches: &'a [(&'a str, [u32; 3])],
}

impl<'a> Passes<'a> {
    /// Makes passes over a buffer `out` with these initial values.
    fn over(wgsl: &'a str, out: Vec<u32>, dispatches: &'a [(&'a str, [u32; 3])]) -> Self {
        Self { wgsl, with: vec![("out", Storage::new(out).into())], overrides: &[], dispatches }
    }

    fn with(mut self, name: &'a str, fixture: impl Into<Fixture>) -> Self {
        self.with.push((name, fixture.into()));
        self
    }

    fn leave(self, executor: &dyn Executor, expected: &[u32]) -> Result<(), Stop> {
        let package = Package::from_source("asked", self.wgsl);
        let mut compute = package.compute();
        for (name, fixture) in self.with {
            compute = compute.with(name, fixture);
        }
        for (name, value) in self.overrides {
            compute = compute.with_override(name, *value);
        }
        for (name, workgroups) in self.dispatches {
            compute = compute.dispatch(name, *workgroups);
        }
        let words = compute.after("out").read::<u32>(executor.path());
        let words = words.map_err(|error| match &error {
            ComputeError::Dispatch(DispatchError::Path(PathError::Refused { message, .. })) => {
                Stop::Refused(message.clone())
            }
            error => Stop::Wrong(error.to_string()),
        })?;
        Ok(same("word", &words, expected)?)
    }
}

fn same(what: &str, words: &[u32], expected: &[u32]) -> Result<(), String> {
    if words.len() != expected.len() {
        return Err(format!(
            "the program returned {} {what}s, not {}",
            words.len(),
            expected.len()
        ));
    }
    let differing: Vec<usize> = (0..words.len()).filter(|at| words[*at] != expected[*at]).collect();
    let Some(at) = differing.first() else { return Ok(()) };
    let (word, wanted) = (words[*at], expected[*at]);
    let (of, count) = (words.len(), differing.len());
    Err(format!("{what} {at} is {word:#010x}, not {wanted:#010x}; {count} of {of} differ"))
}

fn bits(executor: &dyn Executor) -> Result<(), Stop> {
    // Quiet and signalling NaN with a payload, -0, the smallest subnormal number, infinity, and a word of ones.
    let words = vec![0x7fc0_1234, 0x7f80_0001, 0x8000_0000, 1, 0x7f80_0000, u32::MAX];
    let wgsl = "@group(0) @binding(0) var<storage, read_write> out: array<u32>;
        @compute @workgroup_size(1) fn swap() { let first = out[0]; out[0] = out[5]; out[5] = first; }";
    let expected: Vec<u32> = (0..6).map(|at| words[[5, 1, 2, 3, 4, 0][at]]).collect();
    Passes::over(wgsl, words, &[("swap", [1, 1, 1])]).leave(executor, &expected)
}

fn untouched(executor: &dyn Executor) -> Result<(), Stop> {
    let wgsl = "@group(0) @binding(0) var<storage, read_write> out: array<u32>;
        @compute @workgroup_size(1) fn one() { out[2] += 1u; }";
    let words: Vec<u32> = (0..8).map(|at| 0xdead_0000 + at).collect();
    let mut expected = words.clone();
    expected[2] += 1;
    Passes::over(wgsl, words, &[("one", [1, 1, 1])]).leave(executor, &expected)
}

fn grid(executor: &dyn Executor) -> Result<(), Stop> {
    let wgsl = "@group(0) @binding(0) var<storage, read_write> out: array<u32>;
        @compute @workgroup_size(2, 1, 3) fn number(@builtin(global_invocation_id) at: vec3u,
            @builtin(workgroup_id) group: vec3u) {
            out[at.x + 4u * (at.y + 3u * at.z)] = 100u * group.x + 10u * group.y + group.z;
        }";
    let number = |at: u32| 100 * (at % 4 / 2) + 10 * (at / 4 % 3) + at / 12 / 3;
    let expected: Vec<u32> = (0..72).map(number).collect();
    Passes::over(wgsl, vec![u32::MAX; 72], &[("number", [2, 3, 2])]).leave(executor, &expected)
}

fn workgroup(executor: &dyn Executor) -> Result<(), Stop> {
    let wgsl = "@group(0) @binding(0) var<storage, read_write> out: array<u32>;
        var<workgroup> seen: array<u32, 64>;
        @compute @workgroup_size(64) fn reverse(@builtin(local_invocation_index) i: u32) {
            let before = seen[i];
            seen[i] = before + i * i;
            workgroupBarrier();
            out[i] = seen[63u - i];
        }";
    let expected: Vec<u32> = (0..64).map(|i: u32| (63 - i).pow(2)).collect();
    Passes::over(wgsl, vec![7; 64], &[("reverse", [1, 1, 1])]).leave(executor, &expected)
}

fn atomics(executor: &dyn Executor) -> Result<(), Stop> {
    let wgsl = "@group(0) @binding(0) var<storage, read_write> out: array<atomic<u32>>;
        @compute @workgroup_size(64) fn count(@builtin(global_invocation_id) at: vec3u) {
            atomicAdd(&out[0], 1u);
            atomicMax(&out[1], at.x);
        }";
    Passes::over(wgsl, vec![5, 0], &[("count", [16, 1, 1])]).leave(executor, &[1029, 1023])
}

fn passes(executor: &dyn Executor) -> Result<(), Stop> {
    let wgsl = "@group(0) @binding(0) var<storage, read_write> out: array<u32>;
        @compute @workgroup_size(1) fn first() { out[0] = 3u; }
        @compute @workgroup_size(1) fn second() { out[1] = out[0] * 5u; }";
    let both = [("first", [1, 1, 1]), ("second", [1, 1, 1])];
    Passes::over(wgsl, vec![0; 2], &both).leave(executor, &[3, 15])
}

fn layout(executor: &dyn Executor) -> Result<(), Stop> {
    let wgsl = "struct Given { a: f32, b: vec3f, c: mat2x3f, d: u32 }
        @group(1) @binding(3) var<uniform> given: Given;
        @group(0) @binding(2) var<storage> more: array<vec3u>;
        @group(0) @binding(7) var<storage, read_write> out: array<u32>;
        @compute @workgroup_size(1) fn collect() {
            out[0] = u32(given.a); out[1] = u32(given.b.z); out[2] = u32(given.c[1].x); out[3] = given.d;
            out[4] = more[1].y; out[5] = arrayLength(&more);
        }";
    // The offsets are: `a` 0, `b` 16, `c` 32 (its columns have 16 bytes), `d` 64. The structure has 80 bytes (WGSL
    // 14.4.1).
    let mut given = [0_u32; 20];
    for (at, value) in [(0, 2.0_f32), (6, 3.0), (12, 5.0)] {
        given[at] = value.to_bits();
    }
    given[16] = 7;
    let more: [u32; 12] = std::array::from_fn(|at| if at == 5 { 11 } else { 0 });
    Passes::over(wgsl, vec![0; 6], &[("collect", [1, 1, 1])])
        .with("given", karat::fixture::Buffer::from_pod(&given))
        .with("more", karat::fixture::Buffer::from_pod(&more))
        .leave(executor, &[2, 3, 5, 7, 11, 3])
}

fn overrides(executor: &dyn Executor) -> Result<(), Stop> {
    let wgsl = "override lanes: u32; @id(7) override offset: f32 = 1.0; override kept: u32 = 9u;
        @group(0) @binding(0) var<storage, read_write> out: array<u32>;
        @compute @workgroup_size(lanes) fn fill(@builtin(local_invocation_index) i: u32) {
            out[i] = u32(2.0 * (f32(i) + offset)) + kept;
        }";
    let all = [("lanes", 4.0), ("offset", 0.5)];
    let fill = Passes::over(wgsl, vec![0; 5], &[("fill", [1, 1, 1])]);
    Passes { overrides: &all, ..fill }.leave(executor, &[10, 12, 14, 16, 0])
}

fn long(executor: &dyn Executor) -> Result<(), Stop> {
    let wgsl = "@group(0) @binding(0) var<storage, read_write> out: array<u32>;
        @compute @workgroup_size(256) fn invert(@builtin(global_invocation_id) at: vec3u) {
            out[at.x] = ~out[at.x];
        }";
    // A quarter of a million words with ten digits each take 2.6 MB.
    let words: Vec<u32> = (0..1 << 18).collect();
    let expected: Vec<u32> = words.iter().map(|word| !word).collect();
    Passes::over(wgsl, words, &[("invert", [1 << 10, 1, 1])]).leave(executor, &expected)
}

fn function(executor: &dyn Executor) -> Result<(), Stop> {
    let wgsl = "fn half(x: f32, n: i32) -> vec2f { return vec2f(0.5 * x, f32(n)); }";
    let package = Package::from_source("asked", wgsl);
    let probed = Probed::new(&package, "half").map_err(|error| error.to_string())?;
    let cases: Vec<Vec<u32>> =
        (0..1000_u16).map(|n| vec![f32::from(n).to_bits(), u32::from(n)]).collect();
    let rows = executor::call(&probed, executor.path(), &cases, &Vec::new());
    let rows = rows.map_err(|error| error.to_string())?.concat();
    let pair = |n| [(0.5 * f32::from(n)).to_bits(), f32::from(n).to_bits()];
    Ok(same("lane", &rows, &(0..1000_u16).flat_map(pair).collect::<Vec<_>>())?)
}

/// A job with a pass for each WGSL text in `texts`. All passes have the same bindings.
fn job(texts: &[&str], resources: &[&[u32]], outputs: &[usize]) -> Job {
    let shader = |wgsl: &str| Shader {
        wgsl: wgsl.to_owned(),
        sources: Vec::new(),
        overrides: BTreeMap::new(),
    };
    let bound = |(binding, resource)| Bound { at: Some([0, binding]), resource };
    let pass = |text: &&str| Pass {
        shader: shader(text),
        entry_point: "f".to_owned(),
        bindings: (0..).zip(0..resources.len()).map(bound).collect(),
        workgroups: [1, 1, 1],
    };
    let held = |words: &&[u32]| Resource::Buffer { words: words.to_vec() };
    let (passes, held) = (texts.iter().map(pass).collect(), resources.iter().map(held).collect());
    Job::new(Work::Passes(passes), held, outputs.to_vec())
}

fn shown(reply: &Reply) -> String {
    serde_json::to_string(reply).expect("a reply serializes to JSON")
}

fn outputs(executor: &dyn Executor) -> Result<(), Stop> {
    let wgsl = "@group(0) @binding(0) var<storage, read_write> a: array<u32>;
        @group(0) @binding(1) var<storage, read_write> b: array<u32>;
        @group(0) @binding(2) var<storage, read_write> c: array<u32>;
        @compute @workgroup_size(1) fn f() { a[0] = 1u; b[0] = 2u; c[0] = 3u; }";
    let job = job(&[wgsl], &[&[0], &[0, 0], &[0, 8, 9]], &[2, 0]);
    let wanted = Reply::Done(vec![vec![3, 8, 9], vec![1]]);
    match executor.run(&job).map_err(|error| error.to_string())? {
        reply if reply == wanted => Ok(()),
        reply => Err(format!(
            "the job asks for the outputs 2 and 0, and the program's reply is {}, not {}",
            shown(&reply),
            shown(&wanted)
        )
        .into()),
    }
}

fn refusal(executor: &dyn Executor) -> Result<(), Stop> {
    let valid = "@group(0) @binding(0) var<storage, read_write> x: array<u32>;
        @compute @workgroup_size(1) fn f() { x[0] = 1u; }";
    let invalid = valid.replace("1u", "missing");
    let ask = |texts: &[&str]| {
        executor.run(&job(texts, &[&[0]], &[0])).map_err(|error| error.to_string())
    };
    let reply = ask(&[valid, &invalid])?;
    let is_inside = |bytes: &Range<usize>| bytes.start <= bytes.end && bytes.end <= invalid.len();
    match &reply {
        Reply::Refused(Problem { message, pass: 1, bytes })
            if !message.is_empty() && bytes.as_ref().is_none_or(is_inside) => {}
        _ => {
            return Err(format!(
                "the second pass isn't valid: answer `refused` with a message and \"pass\": 1, and name no \"bytes\" \
                 outside of that pass's text; the program's reply is {}",
                shown(&reply)
            )
            .into());
        }
    }
    match ask(&[valid])? {
        Reply::Done(words) if words == [[1]] => Ok(()),
        reply => Err(format!(
            "after a refused job, the program's reply to a valid job is {}",
            shown(&reply)
        )
        .into()),
    }
}

/// A texture of 4 x 2 texels. Each texel's value is its number, counted from 0 at the top left, row by row.
fn numbered() -> Texture {
    Texture::from_fn(4, 2, |x, y| (x + 4 * y) as f32)
}

fn levels(executor: &dyn Executor) -> Result<(), Stop> {
    let wgsl = "@group(0) @binding(0) var image: texture_2d<f32>;
        @group(0) @binding(1) var<storage, read_write> out: array<u32>;
        @compute @workgroup_size(1) fn load() {
            out[0] = textureNumLevels(image);
            out[1] = u32(textureLoad(image, vec2u(1u, 0u), 0).x);
            out[2] = u32(textureLoad(image, vec2u(2u, 1u), 0).x);
            out[3] = u32(textureLoad(image, vec2u(1u, 0u), 1).x);
        }";
    let image = numbered().with_levels([Texture::from_fn(2, 1, |x, _| (50 + x) as f32)]);
    let load = Passes::over(wgsl, vec![0; 4], &[("load", [1, 1, 1])]);
    load.with("image", image).leave(executor, &[2, 1, 6, 51])
}

fn sampling(executor: &dyn Executor) -> Result<(), Stop> {
    let wgsl = "@group(0) @binding(0) var image: texture_2d<f32>;
        @group(0) @binding(1) var linear: sampler;
        @group(0) @binding(2) var same: texture_2d<f32>; // GL uses only one sampler with each texture
        @group(0) @binding(3) var nearest: sampler;
        @group(0) @binding(4) var<storage, read_write> out: array<u32>;
        @compute @workgroup_size(1) fn look() {
            out[0] = u32(2.0 * textureSampleLevel(image, linear, vec2f(0.5, 0.25), 0.0).x);
            out[1] = u32(2.0 * textureSampleLevel(image, linear, vec2f(2.0, 0.25), 0.0).x);
            out[2] = u32(2.0 * textureSampleLevel(same, nearest, vec2f(2.0, 0.75), 0.0).x);
        }";
    // The samples lie halfway between texels 1 and 2, halfway between 3 and 0 of the repeated image, and at the edge of
    // the second row.
    Passes::over(wgsl, vec![0; 3], &[("look", [1, 1, 1])])
        .with("image", numbered())
        .with("linear", Sampler::LINEAR.repeat())
        .with("same", numbered())
        .with("nearest", Sampler::NEAREST)
        .leave(executor, &[3, 3, 14])
}

fn depths(executor: &dyn Executor) -> Result<(), Stop> {
    let wgsl = "@group(0) @binding(0) var image: texture_depth_2d;
        @group(0) @binding(1) var compared: sampler_comparison;
        @group(0) @binding(2) var<storage, read_write> out: array<u32>;
        @compute @workgroup_size(1) fn look() {
            out[0] = u32(textureSampleCompareLevel(image, compared, vec2f(0.25, 0.5), 0.375));
            out[1] = u32(textureSampleCompareLevel(image, compared, vec2f(0.75, 0.5), 0.375));
        }";
    Passes::over(wgsl, vec![7; 2], &[("look", [1, 1, 1])])
        .with("image", Texture::from_fn(2, 1, |x, _| 0.25 + 0.25 * x as f32))
        .with("compared", Sampler::NEAREST.compare(Compare::Less))
        .leave(executor, &[0, 1])
}

fn stored(executor: &dyn Executor) -> Result<(), Stop> {
    let wgsl = "@group(0) @binding(0) var image: texture_storage_2d<rgba32uint, write>;
        @compute @workgroup_size(1) fn f() { textureStore(image, vec2u(1u, 0u), vec4u(1u, 2u, 3u, 4u)); }";
    let texture = Texture::from_fn(2, 1, |x, _| glam::UVec4::splat(90 + x));
    let mut job = job(&[wgsl], &[&[0]], &[0]);
    job.resources = vec![Resource::Texture { format: Some("rgba32uint".to_owned()), texture }];
    match executor.run(&job).map_err(|error| error.to_string())? {
        Reply::Done(words) if words == [[90, 90, 90, 90, 1, 2, 3, 4]] => Ok(()),
        Reply::Refused(problem) => Err(Stop::Refused(problem.message)),
        reply => {
            let wanted = shown(&Reply::Done(vec![vec![90, 90, 90, 90, 1, 2, 3, 4]]));
            Err(format!("the program's reply is {}, not {wanted}", shown(&reply)).into())
        }
    }
}

fn halves(executor: &dyn Executor) -> Result<(), Stop> {
    let wgsl = "enable f16;
        @group(0) @binding(0) var<storage, read_write> out: array<u32>;
        @compute @workgroup_size(1) fn f() { out[0] = u32(f16(out[0]) * 0.5h * 4.0h); }";
    Passes::over(wgsl, vec![7], &[("f", [1, 1, 1])]).leave(executor, &[14])
}

fn subgroups(executor: &dyn Executor) -> Result<(), Stop> {
    let wgsl = "enable subgroups;
        @group(0) @binding(0) var<storage, read_write> out: array<atomic<u32>>;
        @compute @workgroup_size(64) fn count(@builtin(subgroup_invocation_id) lane: u32) {
            let all = subgroupAdd(1u);
            if lane == 0u { atomicAdd(&out[0], all); }
        }";
    Passes::over(wgsl, vec![0], &[("count", [1, 1, 1])]).leave(executor, &[64])
}

fn immediates(executor: &dyn Executor) -> Result<(), Stop> {
    let wgsl = "var<immediate> given: vec2u;
        @group(0) @binding(0) var<storage, read_write> out: array<u32>;
        @compute @workgroup_size(1) fn f() { out[0] = given.x; out[1] = given.y; }";
    let copy = Passes::over(wgsl, vec![0; 2], &[("f", [1, 1, 1])]);
    copy.with("given", Uniform::new(glam::UVec2::new(3, 5))).leave(executor, &[3, 5])
}

/// WGSL for a triangle that covers the whole frame, at depth `z`.
const CORNERS: &str = "fn corner(i: u32, z: f32) -> vec4f {
        return vec4f(f32(i & 1u) * 4.0 - 1.0, f32(i >> 1u) * 4.0 - 1.0, z, 1.0);
    }
    @vertex fn near(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f { return corner(i, 0.25); }
    @vertex fn far(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f { return corner(i, 0.75); }";

fn image(frame: &karat::Frame<'_>, executor: &dyn Executor) -> Result<Vec<u32>, Stop> {
    let image = frame.render(executor.path()).map_err(|error| match &error {
        FrameError::Draw(DrawError::Path(PathError::Refused { message, .. })) => {
            Stop::Refused(message.clone())
        }
        error => Stop::Wrong(error.to_string()),
    })?;
    Ok(image.pixels().iter().flatten().map(|channel| channel.to_bits()).collect())
}

fn pixels(executor: &dyn Executor) -> Result<(), Stop> {
    let wgsl = format!(
        "{CORNERS}
        @fragment fn place(@builtin(position) at: vec4f) -> @location(0) vec4f {{
            if at.x > 3.0 {{ discard; }}
            return vec4f(at.xy, 0.0, 1.0);
        }}"
    );
    let package = Package::from_source("asked", &wgsl);
    let frame = package.frame("", 4, 2).clear([8.0, 8.0, 8.0, 0.0]).fullscreen("near", "place");
    let expected = (0..2_u8).flat_map(|y| (0..4_u8).map(move |x| (x, y))).flat_map(|(x, y)| {
        let centre = [f32::from(x) + 0.5, f32::from(y) + 0.5, 0.0, 1.0];
        if x == 3 { [8.0, 8.0, 8.0, 0.0] } else { centre }
    });
    Ok(same("channel", &image(&frame, executor)?, &expected.map(f32::to_bits).collect::<Vec<_>>())?)
}

fn nearest(executor: &dyn Executor) -> Result<(), Stop> {
    let wgsl = format!(
        "{CORNERS}
        @fragment fn red() -> @location(0) vec4f {{ return vec4f(1.0, 0.0, 0.0, 1.0); }}
        @fragment fn green() -> @location(0) vec4f {{ return vec4f(0.0, 1.0, 0.0, 1.0); }}"
    );
    let package = Package::from_source("asked", &wgsl);
    let frame = package.frame("", 2, 2).fullscreen("near", "red").fullscreen("far", "green");
    let expected = [1.0_f32, 0.0, 0.0, 1.0].map(f32::to_bits).repeat(4);
    Ok(same("channel", &image(&frame, executor)?, &expected)?)
}
