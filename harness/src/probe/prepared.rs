//! Functions that are ready to be called.

use super::{ProbeError, Probed};
use crate::fixture::Fixtures;

/// The function that an executor must prepare.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Call<'c> {
    /// The function, with its signature and its kernel.
    pub probed: &'c Probed,
    /// The textures, samplers and buffers that it reads, by the variable's name.
    pub fixtures: &'c Fixtures,
    /// The largest number of cases in one batch. An executor may support fewer.
    pub cases: usize,
}

/// A function that is ready to be called on one executor.
pub trait Prepared: Sync {
    /// The largest number of cases in one batch; at least 1.
    fn capacity(&self) -> usize;

    /// Starts a batch of cases. Each case has the lanes of all its arguments, with one 32-bit word per scalar.
    ///
    /// Call the returned function to wait for the results, which it lends to its reader once. The executor guarantees
    /// that the right case wrote each word, or returns an error.
    ///
    /// # Errors
    /// If the batch can't be started.
    fn start<'p>(&'p self, cases: usize, arguments: &[u32]) -> Result<Started<'p>, ProbeError>;

    /// True if the textures that the function reads have 16-bit floats.
    fn reads_half_floats(&self) -> bool {
        false
    }
}

/// A running batch. Call it to wait for the results.
pub type Started<'p> = Box<dyn FnOnce(Reader<'_>) -> Result<(), ProbeError> + 'p>;

/// A function that gets the results of a batch: the words of all cases, and the stride in words from one case
/// to the next. A case may have more words than its result, which the executor uses itself.
pub type Reader<'r> = &'r mut dyn FnMut(&[u32], usize);
