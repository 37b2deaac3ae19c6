//! A traced pixel as JSON. The gallery writes the JSON, and `karat trace` reads it.

use karat::unstable::frame::TracedPixel;
use karat::unstable::value::format_f32;
use serde::{Deserialize, Serialize};

use crate::steps::{Row, rows};

/// A pixel, with the arguments and the steps of the fragment function that computes it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Traced {
    /// The fragment function of the traced draw.
    pub function: String,
    /// The names and values of the function's arguments.
    pub arguments: Vec<(String, String)>,
    /// The operations of the function.
    pub steps: Vec<Row>,
    /// The result of the function in the engine.
    pub engine: String,
    /// The colour that the driver drew at the pixel.
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
