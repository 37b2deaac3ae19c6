//! The cases of one dispatch. A row contains, as `u32` words, the arguments of one case and then the companion:
//! additional values that some verbs need.

use std::borrow::Cow;
use std::ops::Range;

/// The index of the first case that a search adds. This index is above the indices of all other cases.
pub(super) const SEARCHED: u64 = 1 << 62;

/// Rows of `u32` words. All rows have the same width and follow each other in memory.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rows<'r> {
    words: &'r [u32],
    width: usize,
    count: usize,
}

impl<'r> Rows<'r> {
    /// Splits `words` into `count` rows of `width` words each. `width` may be 0.
    pub(super) fn new(words: &'r [u32], width: usize, count: usize) -> Self {
        assert_eq!(words.len(), width * count, "the words fill `count` rows of `width` words");
        Self { words, width, count }
    }

    pub(super) fn words(self) -> &'r [u32] {
        self.words
    }

    pub(super) fn len(self) -> usize {
        self.count
    }

    #[inline]
    pub(super) fn of(self, row: usize) -> &'r [u32] {
        &self.words[row * self.width..][..self.width]
    }

    pub(super) fn iter(self) -> impl Iterator<Item = &'r [u32]> {
        (0..self.count).map(move |row| self.of(row))
    }

    pub(super) fn part(self, rows: Range<usize>) -> Self {
        let words = &self.words[rows.start * self.width..rows.end * self.width];
        Self::new(words, self.width, rows.len())
    }
}

/// The cases of one dispatch.
#[derive(Clone, Debug)]
pub(super) struct Batch {
    pub(super) first: u64,
    pub(super) cases: usize,
    /// `true` if Karat sampled the cases for the check. `false` for simplified or remembered cases.
    pub(super) is_drawn: bool,
    rows: Vec<u32>,
    width: usize,
    /// The number of words in a row that are the function's arguments. The other words are the case's
    /// companion.
    words: usize,
}

impl Batch {
    pub(super) fn new(
        first: u64,
        rows: Vec<u32>,
        cases: usize,
        width: usize,
        words: usize,
    ) -> Self {
        assert!(rows.len() == width * cases && words <= width, "each row contains the arguments");
        Self { first, cases, is_drawn: false, rows, width, words }
    }

    pub(super) fn drawn(self) -> Self {
        Self { is_drawn: true, ..self }
    }

    pub(super) fn rows(&self) -> Rows<'_> {
        Rows::new(&self.rows, self.width, self.cases)
    }

    pub(super) fn arguments(&self, case: usize) -> &[u32] {
        &self.rows().of(case)[..self.words]
    }

    /// The companion of a case: values that the check samples in addition to the arguments.
    pub(super) fn companion(&self, case: usize) -> &[u32] {
        &self.rows().of(case)[self.words..]
    }

    /// The arguments of all cases, in the layout of the kernel's input buffer.
    pub(super) fn lanes(&self) -> Cow<'_, [u32]> {
        if self.width == self.words {
            return Cow::Borrowed(&self.rows);
        }
        let mut lanes = Vec::with_capacity(self.cases * self.words);
        self.rows().iter().for_each(|row| lanes.extend_from_slice(&row[..self.words]));
        Cow::Owned(lanes)
    }

    /// Splits `lanes` into rows. `lanes` contains other arguments for the cases of this batch.
    pub(super) fn with_lanes<'l>(&self, lanes: &'l [u32]) -> Rows<'l> {
        Rows::new(lanes, self.words, self.cases)
    }
}
