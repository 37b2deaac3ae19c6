//! A traced pixel as JSON. One process writes the JSON, and another process reads it.

use karat::unstable::frame::TracedPixel;
use karat::unstable::value::format_f32;
use serde::{Deserialize, Serialize};

use crate::steps::{Row, rows};

/// A pixel with its inputs and its steps.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Traced {
    /// The fragment function of the draw that is visible at the pixel.
    pub function: String,
    /// The names and values of the function's arguments.
    pub arguments: Vec<(String, String)>,
    /// The operations of the function.
    pub steps: Vec<Row>,
    /// The result of the function in the engine.
    pub engine: String,
    /// The pixel that the driver drew.
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
