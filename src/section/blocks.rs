//! Sets of a section's blocks.

use super::layout::SECTION_BLOCKS;

/// A bit a block.
#[derive(Clone, Copy, Default)]
pub(super) struct Blocks([u64; SECTION_BLOCKS / 64]);

impl Blocks {
    #[inline]
    pub(super) fn has(&self, block: usize) -> bool {
        self.0[block / 64] >> (block % 64) & 1 != 0
    }

    pub(super) fn insert(&mut self, block: usize) {
        self.0[block / 64] |= 1 << (block % 64);
    }

    /// Those among the `n` (a power of two, 64 at most) that `block` is one of.
    pub(super) fn among(&self, block: usize, n: usize) -> u64 {
        self.0[block / 64] >> (block % 64 / n * n) & (u64::MAX >> (64 - n))
    }

    pub(super) fn count(&self) -> u32 {
        self.0.iter().map(|bits| bits.count_ones()).sum()
    }
}
