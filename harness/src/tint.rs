//! Asks Tint if a text is valid. Tint is the WGSL compiler of Chrome, Edge, Node and Electron.
//!
//! naga and Tint are two implementations of WGSL. Each rejects programs that the other accepts, so a shader for the web
//! needs both verdicts. This module finds Tint on the machine ([`Tint::beside`]), and asks Tint about texts. The module
//! `reflect` decides if Tint's rejection of a module is an error.
//!
//! Three programs contain Tint: the npm package `webgpu` (Dawn for Node), the program `tint`, and Chromium. For Dawn
//! and for Chromium, Karat keeps one process running, which answers line by line.

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

const JUDGE: &str = include_str!("tint/judge.js");

/// The largest answer in bytes. Real answers are much smaller.
const LONGEST: u64 = 16 << 20;

/// The advice for a missing Tint, in one line.
const REMEDY: &str = "run `npm install --save-dev webgpu` in the project (with Node 20 or newer), or set KARAT_TINT to \
                      the path of the installed package, of the program `tint` or of a Chromium browser";

/// The Tint on this machine.
pub struct Tint {
    kind: Kind,
    /// The running process that contains Tint. It is `None` before the first question, and after the process ended.
    resident: Mutex<Option<Resident>>,
}

/// The error for a missing Tint.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{reason}")]
pub struct Missing {
    /// The reason why Tint is missing: ``the npm package `webgpu` isn't installed``.
    pub reason: String,
    /// The advice for the user.
    pub remedy: String,
}

/// A question to Tint: a text with its entry points.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Question {
    /// The WGSL text.
    pub text: String,
    /// `true` asks for WebGPU's compatibility mode. With `false`, Tint assumes a device with all features.
    pub compatibility: bool,
    /// The pipelines that Tint must make from the text.
    pub pipelines: Vec<Pipeline>,
}

/// An entry point, with the data for making a pipeline with an automatic layout.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Pipeline {
    /// The name of the entry point in the text.
    pub entry_point: String,
    /// The stage: `compute`, `vertex` or `fragment`.
    pub(crate) stage: &'static str,
    /// The vertex attributes of a vertex stage. The names of the formats are WebGPU's names.
    pub(crate) attributes: Vec<Attribute>,
    /// A module with a vertex function `karat_feeds`, which supplies the inputs of a fragment stage.
    pub(crate) feeder: String,
    /// The formats of a fragment stage's outputs, by location.
    pub(crate) targets: Vec<Option<&'static str>>,
}

#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub(crate) struct Attribute {
    #[serde(rename = "shaderLocation")]
    pub(crate) location: u32,
    pub(crate) format: &'static str,
}

/// The reason why a text has no verdict: the program that contains Tint didn't give a usable answer.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoVerdict {
    /// The process ended.
    #[error(transparent)]
    Process(#[from] Broken),
    /// Karat can't parse the answer.
    #[error("Tint's answer can't be read: {0}")]
    Garbage(String),
    /// The answer is about a different text.
    #[error("Tint's answer is about another shader")]
    Other,
    /// The question got two answers.
    #[error("Tint answered twice")]
    Twice,
    /// The browser's device lacks a feature that the text needs.
    #[error("this browser's device lacks a feature: {0}")]
    Lacks(String),
}

impl Tint {
    /// Finds the Tint for a folder: the package in the nearest `node_modules`, or else another Tint on this machine. In
    /// one process, Karat searches only once for each folder.
    ///
    /// KARAT_TINT may name another Tint, or be `off`. Chromium takes a second to start. So Karat uses Chromium only if
    /// `needed` is set, or if KARAT_TINT names Chromium.
    ///
    /// # Errors
    /// Returns an error if there is no Tint, with the reason and the remedy.
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
                // Karat's browser uses a software device, which supports less than other devices.
                if matches!(kind, Kind::Browser(_)) {
                    answers.iter_mut().for_each(lacking);
                }
                answers
            }
        }
    }

    /// The version of Tint, such as `webgpu 0.6.2, Node 20.20.2`; `unknown` for the program `tint`. The call starts
    /// Tint.
    ///
    /// # Errors
    /// Returns an error if Tint doesn't run, with the reason.
    pub fn version(&self) -> Result<String, String> {
        match &self.kind {
            Kind::Program(_) => Ok("unknown".to_owned()),
            kind => {
                let mut resident = self.resident.lock().unwrap_or_else(PoisonError::into_inner);
                resident::version(kind, &mut resident).map_err(|error| error.to_string())
            }
        }
    }
}

/// Replaces Tint's rejection by [`NoVerdict::Lacks`], if Tint rejects the text only because the browser's device lacks
/// a feature.
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
    /// The program that contains Tint: ``the npm package in `node_modules/webgpu` ``.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.kind.fmt(f)
    }
}

impl fmt::Debug for Tint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Tint").field("kind", &self.kind).finish_non_exhaustive()
    }
}
