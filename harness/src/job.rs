//! Jobs: work for an executor as data. A job has linked WGSL, resources as words, and the numbers of the resources that
//! it returns.
//!
//! A [`Job`] depends on nothing of wgpu, naga or the harness, so anything can run it: another implementation of WebGPU,
//! an engine, or a device on another machine. KARAT_EXECUTORS names programs that run jobs:
//!
//! ```sh
//! KARAT_EXECUTORS='mine=target/debug/mine' KARAT_PATHS=process@mine cargo test
//! ```
//!
//! Such a program writes a [`Greeting`](crate::path::Greeting) as its first line. Then it reads one job in each line,
//! as JSON, and writes an [`Answer`] for each, as a line. It ends when its input ends. If it ends earlier, Karat shows
//! its stderr. A call of a function is a job, too. Its text has the kernel around the function, and Karat checks that
//! each word was written by the case that it belongs to.
//!
//! [`serve`](crate::executor::serve) turns one of Karat's own paths into such a program.

mod lower;
mod raise;
mod words;

use std::collections::BTreeMap;
use std::ops::Range;

use serde::{Deserialize, Serialize};

pub(crate) use lower::KernelJobs;
pub(crate) use raise::run;

use crate::draw::{Blend, Draw, Format, Source as FrameSource};
use crate::fixture::{Sampler, Texture};

/// Work to run, and the resources whose contents are its result.
///
/// ```
/// use karat::unstable::job::Job;
///
/// let line = r#"{"jobs": 1, "id": 7, "resources": [{"buffer": {"words": [0]}}], "outputs": [0], "seconds": 60.0, "work": {"passes": [{
///     "shader": {"wgsl": "@group(0) @binding(0) var<storage, read_write> x: u32; @compute @workgroup_size(1) fn f() { x = 7u; }",
///                "sources": [], "overrides": {}},
///     "entry_point": "f", "bindings": [{"at": [0, 0], "resource": 0}], "workgroups": [1, 1, 1]}]}}"#;
/// let job: Job = serde_json::from_str(line)?;
/// assert_eq!(job.outputs, [0]);
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Job {
    /// The version of this data: 1.
    pub jobs: u32,
    /// Its number, which its [`Answer`] repeats.
    pub id: u64,
    /// The resources that shaders read and write. Their indices are their numbers.
    pub resources: Vec<Resource>,
    /// The numbers of the resources whose contents are the result. A frame's result is its image.
    pub outputs: Vec<usize>,
    /// The time limit.
    pub seconds: f64,
    /// The passes, or a frame.
    pub work: Work,
}

/// The work of a job.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Work {
    /// Compute passes, one after another, over the same resources.
    Passes(Vec<Pass>),
    /// A frame. Its image is the first output: four linear floats a pixel, as words, with the top row first.
    Frame(Box<Frame>),
}

/// A linked shader.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shader {
    /// Its whole text.
    pub wgsl: String,
    /// The author's files that it was made from.
    pub sources: Vec<Source>,
    /// The values of its overrides by WebGPU's keys: the `@id`s, or the names in the text.
    pub overrides: BTreeMap<String, f64>,
}

/// A stretch of a shader's text that its author wrote.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Source {
    /// Its byte range in the text.
    pub bytes: Range<usize>,
    /// The author's file.
    pub file: String,
    /// The line of that file on which the stretch begins, from 1.
    pub line: usize,
}

/// A dispatch.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pass {
    /// The shader.
    pub shader: Shader,
    /// The name of its compute function.
    pub entry_point: String,
    /// The resources that the function uses.
    pub bindings: Vec<Bound>,
    /// Workgroups in each direction.
    pub workgroups: [u32; 3],
}

/// A resource and its place in a shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bound {
    /// `@group` and `@binding`; `None` for `var<immediate>`.
    pub at: Option<[u32; 2]>,
    /// The number of the resource.
    pub resource: usize,
}

/// A resource that a shader reads or writes.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Resource {
    /// A buffer, in the layout of its variable.
    Buffer {
        /// Its 32-bit words. As an output it has the same number.
        #[serde(with = "words")]
        words: Vec<u32>,
    },
    /// A texture. As an output it has four words for each texel of its first level.
    Texture {
        /// The format of a storage texture, by WGSL's name. Other textures may have any format that keeps their texels.
        format: Option<String>,
        /// Its texels.
        texture: Texture,
    },
    /// A sampler.
    Sampler(Sampler),
}

impl Job {
    /// The number of words in each output.
    pub(crate) fn lengths(&self) -> Vec<usize> {
        match &self.work {
            Work::Passes(_) => {
                self.outputs.iter().map(|number| self.resources[*number].words()).collect()
            }
            Work::Frame(frame) => vec![4 * frame.width as usize * frame.height as usize],
        }
    }
}

impl Resource {
    /// The number of its words as an output.
    pub(crate) fn words(&self) -> usize {
        match self {
            Self::Buffer { words } => words.len(),
            Self::Texture { texture, .. } => {
                4 * texture.levels.first().map_or(0, |level| level.words.len())
            }
            Self::Sampler(_) => 0,
        }
    }
}

/// A frame, with all of its state.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frame {
    /// The shader with all of its functions.
    pub shader: Shader,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// The draws, in order.
    pub draws: Vec<Drawn>,
    /// Set if a depth pre-pass comes first; colour is then drawn where the depth is equal.
    pub prepass: bool,
    /// How a new value combines with a pixel's old value, unless a draw sets it.
    pub blend: Blend,
    /// The formats of the colour targets. `float` is RGBA of 32 bits, or of 16 if a device can't blend or resolve 32
    /// bits.
    pub formats: Vec<Format>,
    /// The source of the image.
    pub result: FrameSource,
    /// Samples a pixel.
    pub samples: u32,
    /// The clear colour of the targets.
    pub clear: [f32; 4],
    /// The clear depth.
    pub clear_depth: f32,
}

/// A draw, with its resources.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drawn {
    /// The draw. If it has no vertex function, it uses that of `covering`.
    pub draw: Draw,
    /// A module with a vertex function whose triangle covers the frame.
    pub covering: Option<String>,
    /// The resources that its functions use.
    pub bindings: Vec<Bound>,
}

/// The line that answers a job.
///
/// ```
/// use karat::unstable::job::{Answer, Reply};
///
/// let answer: Answer = serde_json::from_str(r#"{"id": 7, "reply": {"done": [[7]]}}"#)?;
/// assert_eq!(answer.reply, Reply::Done(vec![vec![7]]));
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Answer {
    /// The job's number.
    pub id: u64,
    /// Its result.
    pub reply: Reply,
}

/// The result of a job.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Reply {
    /// The words of each output, in the job's order.
    Done(#[serde(deserialize_with = "words::all")] Vec<Vec<u32>>),
    /// The shader was refused: nothing has run.
    Refused(Problem),
    /// The job has no result.
    Failed(Problem),
}

/// The reason why a job has no result.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Problem {
    /// The reason, as a sentence.
    pub message: String,
    /// The number of the pass with the problem, or 0.
    #[serde(default)]
    pub pass: usize,
    /// The bytes of that pass's text with the problem.
    #[serde(default)]
    pub bytes: Option<Range<usize>>,
}
