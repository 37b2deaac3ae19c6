//! Blocks: rectangles of pixels, each compressed as one chunk.

use super::header::PartHeader;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Block {
    pub(super) x: usize,
    pub(super) y: usize,
    pub(super) width: usize,
    pub(super) height: usize,
}

impl Block {
    /// The size of the block's uncompressed pixels, in bytes.
    pub(super) fn bytes(self, part: &PartHeader) -> usize {
        let pixel: usize = part.channels.iter().map(|channel| channel.sample.bytes()).sum();
        self.width * self.height * pixel
    }
}
