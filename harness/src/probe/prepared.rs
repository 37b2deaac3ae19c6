//! A function that is ready to be called.

use super::{ProbeError, Probed};
use crate::fixture::Fixtures;

/// What an executor is to get ready.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Call<'c> {
    /// The function, with its signature and its kernel.
    pub probed: &'c Probed,
    /// What stands behind the variables that it reads, by name.
    pub fixtures: &'c Fixtures,
    /// Cases that one batch may have; an executor may have room for fewer.
    pub cases: usize,
}

/// A function that is ready to be called on one executor.
pub trait Prepared: Sync {
    /// Cases of one batch, at least 1.
    fn capacity(&self) -> usize;

    /// Starts a batch of cases, each with the lanes of all its arguments, one 32-bit word a scalar.
    ///
    /// What is returned waits for the results, and lends them to its reader, once. Each word was
    /// written once, by its case; an executor that can't tell says so with an error.
    ///
    /// # Errors
    /// If the batch can't be started.
    fn start<'p>(&'p self, cases: usize, arguments: &[u32]) -> Result<Started<'p>, ProbeError>;

    /// Whether it keeps textures, which the function reads, in 16-bit floats.
    fn reads_half_floats(&self) -> bool {
        false
    }
}

/// A batch that runs. Calling it waits for its results.
pub type Started<'p> = Box<dyn FnOnce(Reader<'_>) -> Result<(), ProbeError> + 'p>;

/// What takes the results of a batch: the words of all cases, and how many there are from the first
/// word of one case to that of the next. Words behind a case's result are the executor's own.
pub type Reader<'r> = &'r mut dyn FnMut(&[u32], usize);
