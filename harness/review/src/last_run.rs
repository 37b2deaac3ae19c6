//! The last run's records of frames and functions, which the page shows beside the images.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde_json::{Value, json};

/// The records of a run.
#[derive(Clone, Debug, Default)]
pub struct LastRun {
    /// The records of frames, by the names of their goldens.
    pub frames: BTreeMap<String, FrameRun>,
    /// The failing functions, in the order of the report.
    pub failures: Vec<Failure>,
}

/// The last run's record of the check that compared a frame with its golden.
#[derive(Clone, Debug, Default)]
pub struct FrameRun {
    /// The name of the test.
    pub test: String,
    /// The location of the frame's check in the test: `file:line:column`.
    pub place: String,
    /// The commands that run the test again.
    pub replays: Vec<String>,
    /// The modules that the frame depends on.
    pub modules: Vec<PathBuf>,
}

/// A failing function.
#[derive(Clone, Debug, Default)]
pub struct Failure {
    /// The function and its check: `fresnel::schlick agrees_with`.
    pub name: String,
    /// The name of the test.
    pub test: String,
    /// The location of the function: `file:line:column`.
    pub place: String,
    /// The whole message.
    pub message: String,
    /// The commands that run the test again.
    pub replays: Vec<String>,
    /// The largest error divided by its bound.
    pub ratio: Option<f64>,
    /// The plots of the failure as HTML, in which all text is escaped.
    pub figures: String,
}

impl FrameRun {
    pub(super) fn value(&self) -> Value {
        json!({ "name": self.test, "place": self.place, "replays": self.replays })
    }
}

impl Failure {
    pub(super) fn value(&self) -> Value {
        json!({
            "name": self.name,
            "test": { "name": self.test, "place": self.place, "replays": self.replays },
            "message": self.message,
            "figures": self.figures,
        })
    }
}
