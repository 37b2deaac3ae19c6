//! What the last run said of frames and functions, beside the images.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde_json::{Value, json};

/// What the record of a run says.
#[derive(Clone, Debug, Default)]
pub(crate) struct LastRun {
    /// Of frames, by the names of their goldens.
    pub(crate) frames: BTreeMap<String, FrameRun>,
    /// Functions that fail, in the order of the report.
    pub(crate) failures: Vec<Failure>,
}

/// Where a frame comes from.
#[derive(Clone, Debug, Default)]
pub(crate) struct FrameRun {
    /// Name of the test.
    pub(crate) test: String,
    /// `file:line:column` of the call.
    pub(crate) place: String,
    /// Commands that do it again.
    pub(crate) replays: Vec<String>,
    /// Modules that the frame depends on.
    pub(crate) modules: Vec<PathBuf>,
}

/// A function that fails.
#[derive(Clone, Debug, Default)]
pub(crate) struct Failure {
    /// `fresnel::schlick agrees_with`
    pub(crate) name: String,
    /// Name of the test.
    pub(crate) test: String,
    /// `file:line:column` of the function.
    pub(crate) place: String,
    /// The whole message.
    pub(crate) message: String,
    /// Commands that do it again.
    pub(crate) replays: Vec<String>,
    /// The largest error divided by its bound.
    pub(crate) ratio: Option<f64>,
    /// Plots as markup, in which all is escaped.
    pub(crate) figures: String,
}

impl FrameRun {
    pub(super) fn value(&self) -> Value {
        json!({ "name": self.test, "place": self.place, "replays": self.replays })
    }
}

impl Failure {
    /// What the page loads of it.
    pub(super) fn value(&self) -> Value {
        json!({
            "name": self.name,
            "test": { "name": self.test, "place": self.place, "replays": self.replays },
            "message": self.message,
            "figures": self.figures,
        })
    }
}
