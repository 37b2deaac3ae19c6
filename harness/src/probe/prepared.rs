//! A function that is ready to be called.

use super::{ProbeError, Probed};
use crate::fixture::Fixtures;

/// The function that an executor has to prepare.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Call<'c> {
    /// The function, with its signature and its kernel.
    pub probed: &'c Probed,
    /// The textures, samplers and buffers that it reads, by the variable's name.
    pub fixtures: &'c Fixtures,
    /// The most cases of one batch. An executor may have room for fewer.
    pub cases: usize,
}

/// A function that is ready to be called on one executor.
pub trait Prepared: Sync {
    /// The most cases of one batch; at least 1.
    fn capacity(&self) -> usize;

    /// Starts a batch of cases, each with the lanes of all its arguments, one 32-bit word a scalar.
    ///
    /// Call what is returned to wait for the results; it lends them to its reader, once. The
    /// executor guarantees that each word was written once, by its case, or returns an error.
    ///
    /// # Errors
    /// If the batch can't be started.
    fn start<'p>(&'p self, cases: usize, arguments: &[u32]) -> Result<Started<'p>, ProbeError>;

    /// Whether the textures that the function reads are kept in 16-bit floats.
    fn reads_half_floats(&self) -> bool {
        false
    }
}

/// A batch that runs. Calling it waits for its results.
pub type Started<'p> = Box<dyn FnOnce(Reader<'_>) -> Result<(), ProbeError> + 'p>;

/// Takes the results of a batch: the words of all cases, and the stride in words from one case to
/// the next. A case may have more words than its result; the executor uses those itself.
pub type Reader<'r> = &'r mut dyn FnMut(&[u32], usize);
