//! Tint, the compiler of WGSL in Chrome, Edge, Node and Electron: its verdict on a text.
//!
//! naga is one implementation of WGSL, and Tint is another. Each rejects programs that the other accepts, so
//! a shader for the web needs the verdict of both. This module finds Tint on the machine ([`Tint::beside`])
//! and asks it. It knows texts only: what a verdict means for a package is `reflect`'s.
//!
//! Three programs have Tint inside: the npm package `webgpu` (Dawn for Node), the compiler's own binary
//! `tint`, and a Chromium. The first and the last are one process that stays and answers line by line.

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

/// The script of every process that stays.
const JUDGE: &str = include_str!("tint/judge.js");

/// The longest answer that is read: more than any is.
const LONGEST: u64 = 16 << 20;

/// How to get it, in a line.
const REMEDY: &str = "`npm install --save-dev webgpu` in the project (with Node 20 or newer), or KARAT_TINT=PATH \
                      of an installed one, of a `tint` or of a Chromium";

/// Tint as this machine has it.
pub struct Tint {
    kind: Kind,
    /// The process that stays; `None` before the first question and after it ended.
    resident: Mutex<Option<Resident>>,
}

/// Tint isn't here.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{reason}")]
pub struct Missing {
    /// Why it isn't used: `not here`.
    pub reason: String,
    /// How to get it.
    pub remedy: String,
}

/// A question: a text, and its entry points.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Question {
    /// The text.
    pub text: String,
    /// Asks an implementation in WebGPU's compatibility mode, in place of one with all features.
    pub compatibility: bool,
    /// Pipelines that are made of it.
    pub pipelines: Vec<Pipeline>,
}

/// An entry point, as what a pipeline with an automatic layout is made of.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Pipeline {
    /// Its name in the text.
    pub entry_point: String,
    /// `compute`, `vertex` or `fragment`.
    pub(crate) stage: &'static str,
    /// Attributes of a vertex stage, with WebGPU's names of formats.
    pub(crate) attributes: Vec<Attribute>,
    /// A module whose vertex stage `karat_feeds` feeds a fragment stage.
    pub(crate) feeder: String,
    /// Formats of what a fragment stage writes, by location.
    pub(crate) targets: Vec<Option<&'static str>>,
}

/// A vertex attribute.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub(crate) struct Attribute {
    #[serde(rename = "shaderLocation")]
    pub(crate) location: u32,
    pub(crate) format: &'static str,
}

/// Why there is no verdict on a text: a fault of the program that was asked.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoVerdict {
    /// The process is lost.
    #[error(transparent)]
    Process(#[from] Broken),
    /// It answers in no words that Karat knows.
    #[error("its answer can't be read: {0}")]
    Garbage(String),
    /// It gives no answer to this one.
    #[error("it answered about another text")]
    Other,
    /// It has failed at this one twice.
    #[error("it answered twice")]
    Twice,
    /// It can't make a device for this one.
    #[error("this browser's device lacks a feature: {0}")]
    Lacks(String),
}

impl Tint {
    /// The Tint that checks of a folder ask: that of the nearest `node_modules`, or another one of the machine.
    /// A process looks once for each folder.
    ///
    /// KARAT_TINT names another one, or is `off`. A Chromium takes a second to start, so one that KARAT_TINT
    /// doesn't name is taken only if `needed`.
    ///
    /// # Errors
    /// If there is none, with the reason and how to get it.
    pub fn beside(folder: &Path, needed: bool) -> Result<Arc<Self>, Missing> {
        type Known = Vec<((PathBuf, bool), Result<Arc<Tint>, Missing>)>;
        static KNOWN: Mutex<Known> = Mutex::new(Vec::new());
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        let key = (folder.canonicalize().unwrap_or_else(|_| folder.to_owned()), needed);
        if let Some((_, tint)) = known.iter().find(|(other, _)| *other == key) {
            return tint.clone();
        }
        let tint = find::find(&key.0, needed).map(|kind| {
            // Folders that share one share its process.
            let same = known.iter().find_map(|(_, tint)| {
                tint.as_ref().ok().filter(|tint| tint.kind == kind).map(Arc::clone)
            });
            same.unwrap_or_else(|| Arc::new(Self { kind, resident: Mutex::default() }))
        });
        known.push((key, tint.clone()));
        tint
    }

    /// Its verdict on each text, in the order of the questions.
    pub fn ask(&self, questions: &[Question]) -> Vec<Result<Answer, NoVerdict>> {
        match &self.kind {
            Kind::Program(program) => program::ask(program, questions),
            kind => {
                let mut resident = self.resident.lock().unwrap_or_else(PoisonError::into_inner);
                let mut answers = resident::ask(kind, &mut resident, questions);
                // A browser draws on a device, here a software one, which has less than others.
                if matches!(kind, Kind::Browser(_)) {
                    answers.iter_mut().for_each(lacking);
                }
                answers
            }
        }
    }

    /// Its version: `webgpu 0.6.2, Node 20.20.2`. Asking starts it.
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

/// Makes no verdict of a rejection that is about the device, and not about the text.
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
    /// Which one it is: `webgpu in node_modules`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.kind.fmt(f)
    }
}

impl fmt::Debug for Tint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Tint").field("kind", &self.kind).finish_non_exhaustive()
    }
}
