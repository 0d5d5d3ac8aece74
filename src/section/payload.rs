//! A payload: what is uploaded of a section as a whole, and what it is of that section.

use super::layout::{BLOCK_COLUMNS, COUNT_WORDS, HEADER_WORDS, Layout, SECTION_BLOCKS};
use super::slot::slot_bytes;
use crate::attribute::{Kind, Record, bias};
use crate::coords::{Height, SectionKey};
use crate::shared::payload::MOST_NARROW_CODE;

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

/// Height of the highest record of each kind that a section holds, in the order of kinds.
pub type HighestOf = Vec<(Kind, Height)>;

/// A payload ready for upload. Immutable.
pub struct Payload {
    /// Header and runs: `layout.words` words.
    pub words: Vec<u32>,
    /// Offsets of its parts.
    pub layout: Layout,
    /// Points it was made from.
    pub points: u64,
    /// Highest record of each kind present.
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
        self.columns_with_depths(|column, runs, _| each(column, runs));
    }

    /// The record of a run, and of stacks how deep it reaches.
    fn run(&self, words: &[u32]) -> (Record, Option<u16>) {
        if self.layout.floats.is_none() {
            return (Record([words[0], words[1], words[2]]), None);
        }
        let (code, depth) = match words {
            &[code, _, _, depth] => (code, depth as u16),
            _ => (words[0] & MOST_NARROW_CODE, (words[0] >> 16) as u16),
        };
        (Record([bias(self.layout.code.decode(code)), words[1], words[2]]), Some(depth))
    }

    /// The same, and of stacks how deep each reaches, as [`crate::coords::Stacking::height_at_depth`] reads it; of columns none.
    pub fn columns_with_depths(&self, mut each: impl FnMut(u16, &[Record], &[u16])) {
        let sizes = self.layout.sizes();
        let words = |at: usize, n: usize| &self.words[at..at + n];
        let (mut runs, mut depths) = (Vec::with_capacity(8), Vec::with_capacity(8));
        for b in 0..SECTION_BLOCKS {
            let place = words(HEADER_WORDS as usize + sizes.place * b, 2);
            let (at, mut next) = (place[0], self.layout.others as usize + sizes.run * place[1] as usize);
            if at == 0 {
                continue;
            }
            let n = ((at - sizes.first_block) / sizes.block) as usize;
            let highest = words(at as usize, sizes.block as usize).chunks_exact(sizes.run);
            let counts = words(self.layout.counts as usize + COUNT_WORDS * n, COUNT_WORDS);
            let counts: &[u8] = bytemuck::cast_slice(counts);
            for (c, (highest, &count)) in highest.zip(counts).enumerate() {
                if highest[0] == 0 {
                    continue;
                }
                runs.clear();
                depths.clear();
                let further = words(next, usize::from(count) * sizes.run);
                for run in std::iter::once(highest).chain(further.chunks_exact(sizes.run)) {
                    let (record, depth) = self.run(run);
                    runs.push(record);
                    depths.extend(depth);
                }
                next += further.len();
                each((b * BLOCK_COLUMNS + c) as u16, &runs, &depths);
            }
        }
    }
}

/// See [`Payload::device_bytes`].
pub fn device_bytes(layout: &Layout) -> u64 {
    slot_bytes(layout.uploaded_bytes()) + slot_bytes(layout.derived_bytes())
}
