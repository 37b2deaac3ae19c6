//! Shows that each word of a batch was written once, by its case.
//!
//! Behind each result its case writes a canary that only this dispatch knows, and all words are poison before.

use super::{Partial, ProbeError};
use crate::domain::Source;
use crate::path::Path;
use crate::reflect::Function;

/// A quiet NaN that hardly a function returns. A result that still is this word is computed again
/// over the [`OTHER`] one: it is the function's if it is the same again, and was never written if
/// not.
pub(crate) const WORD: u32 = 0x7fc0_dead;

/// The other poison, for results that are computed again.
pub(crate) const OTHER: u32 = 0x7fc1_beef;

/// A number that no earlier run of Karat had, so that results that are kept from then are seen: one for each call.
pub(crate) fn unheard_of() -> u64 {
    use std::hash::{BuildHasher, RandomState};
    use std::sync::LazyLock;
    use std::sync::atomic::{AtomicU64, Ordering};
    static FIRST: LazyLock<u64> = LazyLock::new(|| RandomState::new().hash_one(std::process::id()));
    static COUNT: AtomicU64 = AtomicU64::new(0);
    // JavaScript's numbers have 53 bits.
    FIRST.wrapping_add(COUNT.fetch_add(1, Ordering::Relaxed)) & ((1 << 53) - 1)
}

/// A word that another dispatch writes back by chance only, once in 2^32.
pub(crate) fn canary() -> u32 {
    Source::new(0, unheard_of()).bits()
}

/// The results of a function on a path: their shape and their names.
pub(crate) struct Evidence {
    pub(crate) function: String,
    pub(crate) path: Path,
    /// Words from one case to the next: those of a result, and the canary.
    pub(crate) stride: usize,
    /// The names of a result's words: `""` of a scalar, `.x`.
    lane_names: Vec<String>,
}

impl Evidence {
    /// Of results of so many words.
    pub(crate) fn of(function: &Function, path: Path, words: usize) -> Self {
        let lane_names = function.result.lane_names();
        Self { function: function.name.clone(), path, stride: words + 1, lane_names }
    }

    /// Refuses results of another length, and those whose canary isn't this dispatch's.
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

    /// The places of result words that are poison.
    pub(crate) fn poisoned(&self, words: &[u32]) -> Vec<usize> {
        // Nearly always there are none, which this sees at the speed of memory: a loop that ends
        // at the first one isn't made of vector instructions.
        let is_in = |part: &[u32]| part.iter().fold(false, |is, word| is | (*word == WORD));
        if !words.chunks(1024).any(is_in) {
            return Vec::new();
        }
        let canary = |place: &usize| place % self.stride == self.stride - 1;
        let places = words.iter().enumerate().filter(|(_, word)| **word == WORD);
        places.map(|(place, _)| place).filter(|place| !canary(place)).collect()
    }

    /// Refuses words that are poison, and were the other poison when they were computed again over that.
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
