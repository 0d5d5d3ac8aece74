//! A section as it is uploaded.

use super::layout::{BLOCK_COLUMNS, BLOCK_WORDS, FIRST_BLOCK, HEADER_WORDS, Layout, SECTION_BLOCKS};
use crate::attribute::Record;
use crate::coords::Height;

/// Highest record of each (class, withheld) that a section holds.
pub type HighestOf = Vec<(u8, bool, Height)>;

/// A section ready for upload. Immutable.
pub struct Packed {
    /// Header and runs: `layout.words` words.
    pub words: Vec<u32>,
    /// Offsets of its parts.
    pub layout: Layout,
    /// Points it was made from.
    pub points: u64,
    /// Highest record of each (class, withheld) present.
    pub highest_of: HighestOf,
}

impl Packed {
    /// Calls `each` for every column that holds anything, in block order: its [`column_index`], and its runs, highest
    /// first.
    pub fn columns(&self, mut each: impl FnMut(u16, &[Record])) {
        let (before, further) = self.words.split_at(self.layout.others as usize);
        let (before, counts) = before.split_at(self.layout.counts as usize);
        let (places, blocks) = before[HEADER_WORDS as usize..].split_at(2 * SECTION_BLOCKS);
        let further: &[Record] = bytemuck::cast_slice(further);
        let counts: &[[u8; BLOCK_COLUMNS]] = bytemuck::cast_slice(counts);
        let blocks: &[[Record; BLOCK_COLUMNS]] = bytemuck::cast_slice(blocks);
        let mut runs = Vec::with_capacity(8);
        for (b, &[at, first]) in places.as_chunks().0.iter().enumerate().filter(|(_, [at, _])| *at != 0) {
            let n = (at - FIRST_BLOCK) as usize / BLOCK_WORDS;
            let mut next = first as usize;
            for (c, (highest, &count)) in blocks[n].iter().zip(&counts[n]).enumerate() {
                if highest.is_empty() {
                    continue;
                }
                runs.clear();
                runs.push(*highest);
                runs.extend_from_slice(&further[next..next + usize::from(count)]);
                next += usize::from(count);
                each((b * BLOCK_COLUMNS + c) as u16, &runs);
            }
        }
    }
}
