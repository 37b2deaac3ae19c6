//! Work for an executor, as data: linked WGSL, resources as words, and the numbers of those that are wanted back.
//!
//! A [`Job`] has nothing of wgpu, of naga or of the harness in it, so that anything can run it: another
//! implementation of WebGPU, an engine, a device on another machine. KARAT_EXECUTORS names programs that do:
//!
//! ```sh
//! KARAT_EXECUTORS='mine=target/debug/mine' KARAT_PATHS=process@mine cargo test
//! ```
//!
//! Such a program writes a [`Greeting`](crate::path::Greeting) as its first line. Then it reads a job a line, as JSON,
//! and writes an [`Answer`] for each, as a line. It ends when its input ends. If it ends earlier, Karat shows its stderr.
//! Calls of functions are jobs, too: the kernel around the function is in the text, and Karat judges whether
//! each word was written, by the case that it belongs to.
//!
//! [`serve`](crate::executor::serve) makes such a program of one of Karat's own paths.

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

/// Something to run, and the resources whose contents are its result.
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
    /// The resources that shaders read and write, by their numbers.
    pub resources: Vec<Resource>,
    /// The numbers of the resources whose contents are the result. A frame's result is its image.
    pub outputs: Vec<usize>,
    /// How long it may take.
    pub seconds: f64,
    /// Passes, or a frame.
    pub work: Work,
}

/// The work of a job.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Work {
    /// Compute passes, one after the other, over the same resources.
    Passes(Vec<Pass>),
    /// A frame. Its image is the first output: four words a pixel, which are linear floats, with the top row
    /// first.
    Frame(Box<Frame>),
}

/// A linked shader.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shader {
    /// Its whole text.
    pub wgsl: String,
    /// The author's files that it is made of.
    pub sources: Vec<Source>,
    /// Values of its overrides, as WebGPU names them: by their `@id`, or by their names in the text.
    pub overrides: BTreeMap<String, f64>,
}

/// A stretch of a shader's text that its author wrote.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Source {
    /// Its bytes in the text.
    pub bytes: Range<usize>,
    /// The author's file.
    pub file: String,
    /// The line, from 1, on which the stretch begins there.
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
    /// `@group` and `@binding`; `None` of `var<immediate>`.
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
        /// Its 32-bit words. Wanted back, it is as many.
        #[serde(with = "words")]
        words: Vec<u32>,
    },
    /// A texture. Wanted back, it is four words a texel of its first level.
    Texture {
        /// The format of a storage texture, by WGSL's name. Others have any that keeps their texels.
        format: Option<String>,
        /// Its texels.
        texture: Texture,
    },
    /// A sampler.
    Sampler(Sampler),
}

impl Job {
    /// The words of each output.
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
    /// The words that it has when it is wanted back.
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

/// A frame, and all state that it is drawn with.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frame {
    /// The shader that has all of its functions.
    pub shader: Shader,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// The draws, in this order.
    pub draws: Vec<Drawn>,
    /// True if depth alone is drawn first, and colour then where depth is equal.
    pub prepass: bool,
    /// The blending of pixels that are drawn again, unless a draw says otherwise.
    pub blend: Blend,
    /// The formats of the colour targets; `float` is RGBA of 32 bits, or of 16 where a device can't blend or
    /// resolve these.
    pub formats: Vec<Format>,
    /// The source of the image.
    pub result: FrameSource,
    /// Samples a pixel.
    pub samples: u32,
    /// The colour that targets are cleared to.
    pub clear: [f32; 4],
    /// The depth that pixels are cleared to.
    pub clear_depth: f32,
}

/// A draw and what it uses.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drawn {
    /// The draw. Without a vertex function it has that of `covering`.
    pub draw: Draw,
    /// A module whose vertex function covers the frame with a triangle.
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
    /// It takes no such shader: nothing has run.
    Refused(Problem),
    /// It has no result.
    Failed(Problem),
}

/// Why a job has no result.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Problem {
    /// The reason, in a sentence.
    pub message: String,
    /// The number of the pass that it is about, or 0.
    #[serde(default)]
    pub pass: usize,
    /// The bytes of that pass's text that it is about.
    #[serde(default)]
    pub bytes: Option<Range<usize>>,
}
