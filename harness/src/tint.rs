//! Asks Tint, the WGSL compiler of Chrome, Edge, Node and Electron, for its verdict on a text.
//!
//! naga is one implementation of WGSL, and Tint is another. Each rejects programs that the other accepts, so a shader
//! for the web needs both verdicts. This module finds Tint on the machine ([`Tint::beside`]) and asks it. It handles
//! only texts; `reflect` decides what a verdict means for a package.
//!
//! Three programs contain Tint: the npm package `webgpu` (Dawn for Node), the compiler's own binary `tint`, and
//! Chromium. For the first and the last, one process keeps running and answers line by line.

mod answer;
mod browser;
mod find;
mod program;
mod reason;
mod resident;

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

pub(crate) use answer::{Answer, Message, Severity};
pub(crate) use browser::Page;
use find::Kind;
pub use find::installed;
pub(crate) use find::{browser, dawn};
pub use reason::Reason;
use resident::Resident;

use crate::lines::Broken;

/// The script of every process that keeps running.
const JUDGE: &str = include_str!("tint/judge.js");

/// The longest answer that is read, in bytes: far more than any is.
const LONGEST: u64 = 16 << 20;

/// The remedy, in one line.
const REMEDY: &str = "`npm install --save-dev webgpu` in the project (with Node 20 or newer), or KARAT_TINT=PATH \
                      of an installed one, of a `tint` or of a Chromium";

/// Tint, as this machine has it.
pub struct Tint {
    kind: Kind,
    /// The process that keeps running; `None` before the first question, and after the process ended.
    resident: Mutex<Option<Resident>>,
}

/// The error that Tint isn't available.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{reason}")]
pub struct Missing {
    /// The reason: `not here`.
    pub reason: String,
    /// The remedy.
    pub remedy: String,
}

/// A question: a text with its entry points.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Question {
    /// The text.
    pub text: String,
    /// Set to ask for WebGPU's compatibility mode, instead of a device with all features.
    pub compatibility: bool,
    /// The pipelines to make of the text.
    pub pipelines: Vec<Pipeline>,
}

/// An entry point, with the data for a pipeline with an automatic layout.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Pipeline {
    /// Its name in the text.
    pub entry_point: String,
    /// `compute`, `vertex` or `fragment`.
    pub(crate) stage: &'static str,
    /// The attributes of a vertex stage, with WebGPU's names of formats.
    pub(crate) attributes: Vec<Attribute>,
    /// A module whose vertex stage `karat_feeds` supplies a fragment stage's inputs.
    pub(crate) feeder: String,
    /// The formats of a fragment stage's outputs, by location.
    pub(crate) targets: Vec<Option<&'static str>>,
}

/// A vertex attribute.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub(crate) struct Attribute {
    #[serde(rename = "shaderLocation")]
    pub(crate) location: u32,
    pub(crate) format: &'static str,
}

/// The reason why there is no verdict on a text: a fault of the program that was asked.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoVerdict {
    /// The process ended.
    #[error(transparent)]
    Process(#[from] Broken),
    /// The answer isn't in a form that Karat knows.
    #[error("its answer can't be read: {0}")]
    Garbage(String),
    /// There is no answer to this question.
    #[error("it answered about another text")]
    Other,
    /// The process has failed at this question twice.
    #[error("it answered twice")]
    Twice,
    /// The process can't make a device for this question.
    #[error("this browser's device lacks a feature: {0}")]
    Lacks(String),
}

impl Tint {
    /// The Tint for checks of a folder: the one in the nearest `node_modules`, or another one of the machine. A process
    /// looks once for each folder.
    ///
    /// KARAT_TINT names another Tint, or is `off`. Chromium takes a second to start, so unless KARAT_TINT names it, it
    /// is used only if `needed`.
    ///
    /// # Errors
    /// If there is none, with the reason and the remedy.
    pub fn beside(folder: &Path, needed: bool) -> Result<Arc<Self>, Missing> {
        type Known = Vec<((PathBuf, bool), Result<Arc<Tint>, Missing>)>;
        static KNOWN: Mutex<Known> = Mutex::new(Vec::new());
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        let key = (folder.canonicalize().unwrap_or_else(|_| folder.to_owned()), needed);
        if let Some((_, tint)) = known.iter().find(|(other, _)| *other == key) {
            return tint.clone();
        }
        let tint = find::find(&key.0, needed).map(|kind| {
            // Folders with the same Tint share its process.
            let same = known.iter().find_map(|(_, tint)| {
                tint.as_ref().ok().filter(|tint| tint.kind == kind).map(Arc::clone)
            });
            same.unwrap_or_else(|| Arc::new(Self { kind, resident: Mutex::default() }))
        });
        known.push((key, tint.clone()));
        tint
    }

    /// The verdict on each text, in the order of the questions.
    pub fn ask(&self, questions: &[Question]) -> Vec<Result<Answer, NoVerdict>> {
        match &self.kind {
            Kind::Program(program) => program::ask(program, questions),
            kind => {
                let mut resident = self.resident.lock().unwrap_or_else(PoisonError::into_inner);
                let mut answers = resident::ask(kind, &mut resident, questions);
                // The browser draws on a software device here, which supports less than others.
                if matches!(kind, Kind::Browser(_)) {
                    answers.iter_mut().for_each(lacking);
                }
                answers
            }
        }
    }

    /// The version: `webgpu 0.6.2, Node 20.20.2`. This starts Tint.
    ///
    /// # Errors
    /// If it doesn't run, with the reason.
    pub fn version(&self) -> Result<String, String> {
        match &self.kind {
            Kind::Program(_) => Ok("it says none".to_owned()),
            kind => {
                let mut resident = self.resident.lock().unwrap_or_else(PoisonError::into_inner);
                resident::version(kind, &mut resident).map_err(|error| error.to_string())
            }
        }
    }
}

/// Turns a rejection because of the device, and not of the text, into "no verdict".
fn lacking(answer: &mut Result<Answer, NoVerdict>) {
    let is_device = |reason: &&str| {
        reason.contains("not allowed in the current environment")
            || reason.contains("is not supported")
    };
    let lacks = answer.as_ref().ok().and_then(Answer::reason).filter(is_device);
    if let Some(reason) = lacks.map(str::to_owned) {
        *answer = Err(NoVerdict::Lacks(reason));
    }
}

impl fmt::Display for Tint {
    /// The kind of program: `webgpu in node_modules`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.kind.fmt(f)
    }
}

impl fmt::Debug for Tint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Tint").field("kind", &self.kind).finish_non_exhaustive()
    }
}
