//! Cells, and the sections of the quadtree that they lie in.

use crate::shared::payload;

/// log2 of a section's side in cells.
pub const SECTION_LOG2: u32 = payload::SECTION_LOG2;
/// A section's side in cells.
pub const SECTION_SIDE: u32 = payload::SECTION_SIDE;
/// Columns in a section.
pub const SECTION_COLUMNS: usize = (SECTION_SIDE * SECTION_SIDE) as usize;

/// A finest cell of the grid: indices relative to [`super::Grid::anchor`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CellIndex {
    /// Eastward index.
    pub i: i32,
    /// Northward index.
    pub j: i32,
}

/// A section of the quadtree: `SECTION_SIDE` cells of `c·2^level` on a side, at section indices (i, j)
/// relative to [`super::Grid::anchor`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SectionKey {
    /// Detail level k: cells are `c·2^k` wide.
    pub level: u8,
    /// Eastward section index at this level.
    pub i: i32,
    /// Northward section index at this level.
    pub j: i32,
}

impl SectionKey {
    /// The section that holds `cell` at the finest level.
    #[inline]
    pub fn of(cell: CellIndex) -> SectionKey {
        SectionKey { level: 0, i: cell.i >> SECTION_LOG2, j: cell.j >> SECTION_LOG2 }
    }

    /// The section one level coarser that covers this one.
    pub fn parent(self) -> SectionKey {
        SectionKey { level: self.level + 1, i: self.i >> 1, j: self.j >> 1 }
    }

    /// One of the four one level finer: quarter 0 is south-west, 1 south-east, 2 north-west.
    pub fn child(self, quarter: i32) -> SectionKey {
        SectionKey { level: self.level - 1, i: self.i * 2 + (quarter & 1), j: self.j * 2 + (quarter >> 1) }
    }

    /// First finest cell and the one after the last, along an axis.
    pub fn cells(self, axis: usize) -> [i64; 2] {
        let log2 = SECTION_LOG2 + u32::from(self.level);
        let first = i64::from([self.i, self.j][axis]) << log2;
        [first, first + (1 << log2)]
    }

    /// Whether it holds some of the finest cells from `low` to below `high`.
    pub fn touches(self, low: [i32; 2], high: [i32; 2]) -> bool {
        (0..2).all(|axis| {
            let [first, end] = self.cells(axis);
            first < high[axis].into() && i64::from(low[axis]) < end
        })
    }
}
