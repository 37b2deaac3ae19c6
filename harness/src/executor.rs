//! The seam between checks and what runs shaders.

use std::fmt::Debug;

use crate::draw::{DrawError, Drawing};
use crate::image::Image;
use crate::path::{self, Adapter, Device, Path, PathError};
use crate::probe::{Call, Prepared, ProbeError, Runner};

/// Something that runs WGSL: a driver, or whatever stands in for one.
///
/// Checks and frames know executors by this trait alone. wgpu's drivers are those that the
/// environment selects; [`Probe::on`](crate::check::Probe::on) and
/// [`Frame::on`](crate::Frame::on) take any other one.
pub trait Executor: Debug + Sync {
    /// What it is called in verdicts, tolerances and replays.
    fn path(&self) -> Path;

    /// What it is, as records tell.
    fn adapter(&self) -> Adapter;

    /// Gets a function ready to be called.
    ///
    /// # Errors
    /// If the function can't be called here, or a fixture isn't what it reads.
    fn prepare<'e>(&'e self, call: &Call<'_>) -> Result<Box<dyn Prepared + 'e>, ProbeError>;

    /// Draws a frame: linear colour, as large as the drawing, with its top row first.
    ///
    /// # Errors
    /// If it can't be drawn here. Unless an executor has its own, it draws nothing and says so.
    fn draw(&self, drawing: &Drawing<'_>) -> Result<Image, DrawError> {
        let _ = drawing;
        Err(DrawError::Unable { path: self.path() })
    }
}

/// A driver keeps the contract that each word is written once, by its case, by poison and canaries.
impl Executor for Device {
    fn path(&self) -> Path {
        Self::path(self)
    }

    fn adapter(&self) -> Adapter {
        Self::adapter(self).clone()
    }

    fn prepare<'e>(&'e self, call: &Call<'_>) -> Result<Box<dyn Prepared + 'e>, ProbeError> {
        Ok(Box::new(Runner::new(self, call.probed, call.fixtures, call.cases)?))
    }

    fn draw(&self, drawing: &Drawing<'_>) -> Result<Image, DrawError> {
        self.render(drawing)
    }
}

/// These executors, or where there is none those that the environment selects. Never empty.
pub(crate) fn or_selected<'e>(
    own: &[&'e dyn Executor],
) -> Result<Vec<&'e dyn Executor>, PathError> {
    if !own.is_empty() {
        path::expect_own(own.iter().map(|executor| executor.path()))?;
        return Ok(own.to_vec());
    }
    Ok(path::devices()?.into_iter().map(|device| device as &dyn Executor).collect())
}
