//! Checks that each case wrote its own words.
//!
//! Before a dispatch, all words of the results are poison. Each case writes its result, and then a canary that only
//! this dispatch uses.

use super::{Partial, ProbeError};
use crate::domain::Source;
use crate::path::Path;
use crate::reflect::Function;

/// The poison: a quiet NaN that functions rarely return. If a result equals the poison, Karat runs the kernel again
/// over the poison [`OTHER`]. If the second run gives the same result, the function returned it. Otherwise the kernel
/// never wrote the result.
pub(crate) const WORD: u32 = 0x7fc0_dead;

/// The second poison, for running a kernel again.
pub(crate) const OTHER: u32 = 0x7fc1_beef;

/// A number that Karat has never used before, in this process or in an earlier one. With this number, Karat recognises
/// results that an earlier run left in a buffer.
pub(crate) fn unheard_of() -> u64 {
    use std::hash::{BuildHasher, RandomState};
    use std::sync::LazyLock;
    use std::sync::atomic::{AtomicU64, Ordering};
    static FIRST: LazyLock<u64> = LazyLock::new(|| RandomState::new().hash_one(std::process::id()));
    static COUNT: AtomicU64 = AtomicU64::new(0);
    // JavaScript's numbers have only 53 bits for integers.
    FIRST.wrapping_add(COUNT.fetch_add(1, Ordering::Relaxed)) & ((1 << 53) - 1)
}

/// A new canary. The probability that another dispatch has the same canary is 1 in 2^32.
pub(crate) fn canary() -> u32 {
    Source::new(0, unheard_of()).bits()
}

/// The layout of a function's results on a path. With this layout, Karat finds canaries and unwritten words.
pub(crate) struct Evidence {
    pub(crate) function: String,
    pub(crate) path: Path,
    /// The number of words from one case to the next: the result's words and the canary.
    pub(crate) stride: usize,
    /// The names of a result's words: `""` for a scalar, `.x` for a vector.
    lane_names: Vec<String>,
}

impl Evidence {
    /// The layout for results of `words` words.
    pub(crate) fn of(function: &Function, path: Path, words: usize) -> Self {
        let lane_names = function.result.lane_names();
        Self { function: function.name.clone(), path, stride: words + 1, lane_names }
    }

    /// Returns an error if the results have the wrong length, or if a canary isn't the canary of this dispatch.
    pub(crate) fn expect_canaries(
        &self,
        words: &[u32],
        cases: usize,
        canary: u32,
    ) -> Result<(), ProbeError> {
        let expected = cases * self.stride;
        if words.len() != expected {
            let found = words.len();
            return Err(ProbeError::Length { path: self.path, expected, found });
        }
        let unwritten = || {
            let cases = (0_u32..).zip(words.chunks_exact(self.stride));
            cases.filter(|(case, result)| result.last().is_none_or(|word| *word != canary ^ *case))
        };
        let Some((first, _)) = unwritten().next() else { return Ok(()) };
        let (function, path, count) = (self.function.clone(), self.path, unwritten().count());
        Err(ProbeError::NotWritten { function, path, first, count, cases })
    }

    /// The indices of result words that equal the poison. Canaries don't count.
    pub(crate) fn poisoned(&self, words: &[u32]) -> Vec<usize> {
        // Usually no word is poison, and this loop checks that as fast as memory allows. Compilers don't vectorise a
        // loop that stops at the first match.
        let is_in = |part: &[u32]| part.iter().fold(false, |is, word| is | (*word == WORD));
        if !words.chunks(1024).any(is_in) {
            return Vec::new();
        }
        let canary = |place: &usize| place % self.stride == self.stride - 1;
        let places = words.iter().enumerate().filter(|(_, word)| **word == WORD);
        places.map(|(place, _)| place).filter(|place| !canary(place)).collect()
    }

    /// Returns an error if the kernel left a word of the results unwritten. Such a word is [`WORD`] after the first
    /// run, but has another value after the second run, which started with the poison [`OTHER`].
    pub(crate) fn expect_written(
        &self,
        words: &[u32],
        poisoned: Vec<usize>,
        again: &[usize],
    ) -> Result<(), ProbeError> {
        let is_written = |place: &usize| again.binary_search(place).is_ok();
        let unwritten: Vec<usize> =
            poisoned.into_iter().filter(|place| !is_written(place)).collect();
        let Some(first) = unwritten.first().copied() else { return Ok(()) };
        Err(ProbeError::ResultNotWritten {
            function: self.function.clone(),
            path: self.path,
            component: self.lane_names[first % self.stride].clone(),
            first: u32::try_from(first / self.stride).expect("a batch fits in 32 bits"),
            count: unwritten.len(),
            words: words.len() / self.stride * (self.stride - 1),
            partial: Box::new(Partial { words: words.to_vec(), stride: self.stride, unwritten }),
        })
    }
}
