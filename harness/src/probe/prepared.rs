//! Functions that an executor has prepared.

use super::{ProbeError, Probed};
use crate::fixture::Fixtures;

/// The function for an executor to prepare.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Call<'c> {
    /// The function with its signature and its kernel.
    pub probed: &'c Probed,
    /// The textures, samplers and buffers that the function reads, by the names of their variables.
    pub fixtures: &'c Fixtures,
    /// The largest number of cases in a batch. An executor may support fewer cases.
    pub cases: usize,
}

/// A function that one executor has prepared.
pub trait Prepared: Sync {
    /// The largest number of cases in a batch. It is at least 1.
    fn capacity(&self) -> usize;

    /// Starts a batch of cases. `arguments` has the scalars of all cases' arguments, each as a 32-bit word.
    ///
    /// Call the returned function to wait for the results. The returned function calls its reader once, with the
    /// results. The executor guarantees that each case wrote its own words, or returns an error.
    ///
    /// # Errors
    /// Returns an error if the executor can't start the batch.
    fn start<'p>(&'p self, cases: usize, arguments: &[u32]) -> Result<Started<'p>, ProbeError>;

    /// Checks if a texture that the function reads has 16-bit floats.
    fn reads_half_floats(&self) -> bool {
        false
    }
}

/// A running batch. Call this function to wait for the results.
pub type Started<'p> = Box<dyn FnOnce(Reader<'_>) -> Result<(), ProbeError> + 'p>;

/// A function that gets the results of a batch: the words of all cases, and the stride in words from one case to the
/// next. After the result, a case may have more words, which only the executor uses.
pub type Reader<'r> = &'r mut dyn FnMut(&[u32], usize);
