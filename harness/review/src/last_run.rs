//! The last run's records of frames and functions, which the page shows beside the images.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde_json::{Value, json};

/// The content of a run's record.
#[derive(Clone, Debug, Default)]
pub struct LastRun {
    /// The records of frames, by the names of their goldens.
    pub frames: BTreeMap<String, FrameRun>,
    /// Functions that fail, in the order of the report.
    pub failures: Vec<Failure>,
}

/// The origin of a frame.
#[derive(Clone, Debug, Default)]
pub struct FrameRun {
    /// Name of the test.
    pub test: String,
    /// `file:line:column` of the call.
    pub place: String,
    /// Commands that run it again.
    pub replays: Vec<String>,
    /// Modules that the frame depends on.
    pub modules: Vec<PathBuf>,
}

/// A function that fails.
#[derive(Clone, Debug, Default)]
pub struct Failure {
    /// `fresnel::schlick agrees_with`
    pub name: String,
    /// Name of the test.
    pub test: String,
    /// `file:line:column` of the function.
    pub place: String,
    /// The whole message.
    pub message: String,
    /// Commands that run it again.
    pub replays: Vec<String>,
    /// The largest error divided by its bound.
    pub ratio: Option<f64>,
    /// Plots as markup, with everything escaped.
    pub figures: String,
}

impl FrameRun {
    pub(super) fn value(&self) -> Value {
        json!({ "name": self.test, "place": self.place, "replays": self.replays })
    }
}

impl Failure {
    /// The data for the page.
    pub(super) fn value(&self) -> Value {
        json!({
            "name": self.name,
            "test": { "name": self.test, "place": self.place, "replays": self.replays },
            "message": self.message,
            "figures": self.figures,
        })
    }
}
