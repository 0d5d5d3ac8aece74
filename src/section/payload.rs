//! A payload: what is uploaded of a section as a whole, and what it is of that section.

use super::layout::{
    BLOCK_COLUMNS, BLOCK_WORDS, FIRST_BLOCK, HEADER_WORDS, Layout, PLACE_WORDS, SECTION_BLOCKS,
};
use super::slot::slot_bytes;
use crate::attribute::Record;
use crate::coords::{Height, SectionKey};

/// What a payload is of its section. Each kind is made, requested and kept on the device by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum PayloadKind {
    /// The columns of all points.
    Columns,
    /// The columns of a few points of every chunk: what stands in until something of the section itself is there.
    Sample,
}

/// One payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct PayloadKey {
    /// What of the section.
    pub kind: PayloadKind,
    /// Which section.
    pub section: SectionKey,
}

impl PayloadKey {
    /// The columns of a section.
    pub const fn columns(section: SectionKey) -> PayloadKey {
        PayloadKey { kind: PayloadKind::Columns, section }
    }

    /// What the sparse sample has of a section.
    pub const fn sample(section: SectionKey) -> PayloadKey {
        PayloadKey { kind: PayloadKind::Sample, section }
    }
}

impl From<SectionKey> for PayloadKey {
    /// Its columns.
    fn from(section: SectionKey) -> PayloadKey {
        PayloadKey::columns(section)
    }
}

/// Highest record of each (class, withheld) that a section holds.
pub type HighestOf = Vec<(u8, bool, Height)>;

/// A payload ready for upload. Immutable.
pub struct Payload {
    /// Header and runs: `layout.words` words.
    pub words: Vec<u32>,
    /// Offsets of its parts.
    pub layout: Layout,
    /// Points it was made from.
    pub points: u64,
    /// Highest record of each (class, withheld) present.
    pub highest_of: HighestOf,
}

impl Payload {
    /// Bytes that it takes in host memory, and that are uploaded.
    pub fn uploaded_bytes(&self) -> u64 {
        self.layout.uploaded_bytes()
    }

    /// Bytes that it takes on the device: a slot for what is uploaded, one for what is derived from it.
    pub fn device_bytes(&self) -> u64 {
        device_bytes(&self.layout)
    }

    /// Calls `each` for every column that holds anything, in block order: its [`super::column_index`], and its runs, highest
    /// first.
    pub fn columns(&self, mut each: impl FnMut(u16, &[Record])) {
        let (before, further) = self.words.split_at(self.layout.others as usize);
        let (before, counts) = before.split_at(self.layout.counts as usize);
        let (places, blocks) = before[HEADER_WORDS as usize..].split_at(PLACE_WORDS * SECTION_BLOCKS);
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

/// See [`Payload::device_bytes`].
pub fn device_bytes(layout: &Layout) -> u64 {
    slot_bytes(layout.uploaded_bytes()) + slot_bytes(layout.derived_bytes())
}
