//! Jobs: requests to an executor, as data. A job contains linked WGSL, resources as `u32` words, and the
//! numbers of the resources to return.
//!
//! A [`Job`] doesn't depend on wgpu, naga or the harness. So any program can run a job: another implementation
//! of WebGPU, an engine, or a program that uses a device on another machine. `KARAT_EXECUTORS` names programs
//! that run jobs:
//!
//! ```sh
//! KARAT_EXECUTORS='mine=target/debug/mine' KARAT_PATHS=process@mine cargo test
//! ```
//!
//! Such a program writes a [`Greeting`](crate::path::Greeting) as its first line. Then the program reads jobs, each as
//! one line of JSON, and answers each job with an [`Answer`], also as one line. The program ends when its input ends.
//! If the program ends earlier, Karat shows the program's stderr. To call a function, Karat sends a job whose WGSL
//! contains a generated entry point that calls the function. Karat then checks that the right case wrote each word of
//! the results.
//!
//! [`serve`](crate::executor::serve) makes such a program from one of Karat's own paths.

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

/// A request to an executor: the work, its resources, and the numbers of the resources to return.
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
    /// The version of the job format: 1.
    pub jobs: u32,
    /// The job's number. The [`Answer`] to the job repeats the number.
    pub id: u64,
    /// The resources that shaders read and write. A resource's number is its index in this list.
    pub resources: Vec<Resource>,
    /// The numbers of the resources to return. For a frame, the executor ignores this list and returns the image.
    pub outputs: Vec<usize>,
    /// The time limit in seconds.
    pub seconds: f64,
    /// The work: compute passes, or a frame.
    pub work: Work,
}

/// The work of a job: compute passes, or a frame.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Work {
    /// Compute passes, one after another, over the same resources.
    Passes(Vec<Pass>),
    /// A frame. The only output is the frame's image, with the top row first. Each pixel is four linear floats, as
    /// words.
    Frame(Box<Frame>),
}

/// A linked shader.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shader {
    /// The shader's whole text.
    pub wgsl: String,
    /// The parts of the text that come from the author's files.
    pub sources: Vec<Source>,
    /// The values of the shader's overrides by WebGPU's keys: each key is the override's `@id`, or the
    /// override's name.
    pub overrides: BTreeMap<String, f64>,
}

/// A part of a shader's text that the author wrote.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Source {
    /// The byte range of the part in the shader's text.
    pub bytes: Range<usize>,
    /// The author's file.
    pub file: String,
    /// The line of `file` on which the part begins, counted from 1.
    pub line: usize,
}

/// One dispatch of an entry point.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pass {
    /// The shader that contains the entry point.
    pub shader: Shader,
    /// The name of the compute entry point.
    pub entry_point: String,
    /// The resources that the entry point uses.
    pub bindings: Vec<Bound>,
    /// The number of workgroups in each direction.
    pub workgroups: [u32; 3],
}

/// A binding of the shader, and the resource for this binding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bound {
    /// The numbers in `@group` and `@binding`. `None` for `var<immediate>`.
    pub at: Option<[u32; 2]>,
    /// The number of the resource.
    pub resource: usize,
}

/// A resource that a shader reads or writes.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Resource {
    /// A buffer, in the memory layout of its WGSL variable.
    Buffer {
        /// The buffer's 32-bit words. As an output, the buffer has the same number of words.
        #[serde(with = "words")]
        words: Vec<u32>,
    },
    /// A texture. As an output, the texture has four words for each texel of its first mip level.
    Texture {
        /// The WGSL name of the format of a storage texture. Other textures may have any format that can store
        /// their texels exactly.
        format: Option<String>,
        /// The texels of the texture.
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
    /// The number of words that the resource has as an output.
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

/// A frame, with its whole render state.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frame {
    /// The shader, with all functions that the frame uses.
    pub shader: Shader,
    /// The width in pixels.
    pub width: u32,
    /// The height in pixels.
    pub height: u32,
    /// The draws, in the order in which they run.
    pub draws: Vec<Drawn>,
    /// `true` if a depth pre-pass comes first. The colour passes then draw only pixels whose depth equals the depth
    /// from the pre-pass.
    pub prepass: bool,
    /// The operation that combines a new value with a pixel's old value, unless a draw sets its own operation.
    pub blend: Blend,
    /// The formats of the colour targets. `float` means RGBA with 32 bits per channel, or with 16 bits if a
    /// device can't blend or resolve 32 bits.
    pub formats: Vec<Format>,
    /// The target that becomes the image.
    pub result: FrameSource,
    /// The number of samples per pixel.
    pub samples: u32,
    /// The colour to which the targets are cleared.
    pub clear: [f32; 4],
    /// The depth to which the depth buffer is cleared.
    pub clear_depth: f32,
}

/// A draw, with its resources.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drawn {
    /// The draw. If the draw has no vertex function, the draw uses the vertex function in `covering`.
    pub draw: Draw,
    /// A module with a vertex function that draws a triangle over the whole frame.
    pub covering: Option<String>,
    /// The resources that the draw's functions use.
    pub bindings: Vec<Bound>,
}

/// The answer to a job. The program that ran the job writes the answer as one line of JSON.
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
    /// The job's result.
    pub reply: Reply,
}

/// The result of a job.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Reply {
    /// The words of each output, in the order of the job's `outputs`.
    Done(#[serde(deserialize_with = "words::all")] Vec<Vec<u32>>),
    /// The executor refused the shader, and ran nothing.
    Refused(Problem),
    /// The job failed while it ran.
    Failed(Problem),
}

/// The reason why a job has no result.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Problem {
    /// The reason, as a sentence.
    pub message: String,
    /// The index of the pass with the problem, counted from 0. The index is 0, too, if the problem belongs to no pass.
    #[serde(default)]
    pub pass: usize,
    /// The byte range of the problem in the WGSL of that pass, or of the frame.
    #[serde(default)]
    pub bytes: Option<Range<usize>>,
}
