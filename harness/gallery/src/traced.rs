//! A traced pixel as text, for another process.

use karat::unstable::frame::TracedPixel;
use karat::unstable::value::format_f32;
use serde::{Deserialize, Serialize};

use crate::steps::{Row, rows};

/// A pixel, its inputs and its steps.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Traced {
    /// The fragment function of the draw that shows there.
    pub function: String,
    /// Its arguments.
    pub arguments: Vec<(String, String)>,
    /// Its operations.
    pub steps: Vec<Row>,
    /// Its result in the engine.
    pub engine: String,
    /// The driver's pixel.
    pub driver: String,
    /// Notes on the values.
    pub notes: Vec<String>,
}

impl From<TracedPixel> for Traced {
    fn from(pixel: TracedPixel) -> Self {
        let driver = pixel.driver.map(format_f32).join(", ");
        Self {
            steps: rows(&pixel.steps),
            function: pixel.function,
            arguments: pixel.arguments,
            engine: pixel.engine,
            driver: format!("({driver})"),
            notes: pixel.notes,
        }
    }
}
