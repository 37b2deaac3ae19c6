//! Values as words, for types that are known only at run time.

use super::{Emptiness, Source};

/// A domain of numbers, vectors or matrices, whose values are given as words.
pub(super) trait Words: Send + Sync {
    fn width(&self) -> usize;
    fn draw(&self, source: &mut Source) -> Option<Vec<u32>>;
    fn edges(&self) -> Vec<Vec<u32>>;
    fn emptiness(&self) -> Option<Emptiness>;
    fn size(&self) -> Option<u64>;
    fn nth(&self, index: u64) -> Option<Vec<u32>>;
    fn admits(&self, words: &[u32]) -> Option<bool>;
    fn ends(&self) -> Option<[Vec<u32>; 2]> {
        None
    }
    /// Values that are simpler than the value with these words, the simplest first.
    fn shrink(&self, words: &[u32]) -> Vec<Vec<u32>>;
}
