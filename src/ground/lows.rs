//! Stage 1: what points say of a tile's cells, whatever is shown. Minima and bits, so that neither their order nor how they
//! are cut into parts changes anything.

use super::grid::TILE_CELLS;

/// Lowest height of a cell in which there is none. No point has it.
pub const NONE: i32 = i32::MAX;

/// What a point says of its cell.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// Height on the world's lattice.
    pub height: i32,
    /// Its class says that it is ground.
    pub is_trusted: bool,
    /// Its pulse had no other return.
    pub is_only: bool,
}

/// A tile's cells, row by row from its south-west. 265 KiB, 521 KiB where classes tell the ground.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LowTile {
    lowest: Vec<i32>,
    /// Empty as long as no class has told anything.
    trusted: Vec<i32>,
    only: Vec<u64>,
}

impl Default for LowTile {
    fn default() -> LowTile {
        LowTile { lowest: vec![NONE; TILE_CELLS], trusted: Vec::new(), only: vec![0; TILE_CELLS / 64] }
    }
}

impl LowTile {
    #[inline]
    pub(super) fn see(&mut self, cell: usize, seen: Seen) {
        let lowest = &mut self.lowest[cell];
        *lowest = (*lowest).min(seen.height);
        self.only[cell / 64] |= u64::from(seen.is_only) << (cell % 64);
        if seen.is_trusted {
            if self.trusted.is_empty() {
                self.trusted = vec![NONE; TILE_CELLS];
            }
            let trusted = &mut self.trusted[cell];
            *trusted = (*trusted).min(seen.height);
        }
    }

    /// Takes in what other points say of the same tile.
    pub fn merge(&mut self, other: &LowTile) {
        let lower =
            |to: &mut [i32], from: &[i32]| to.iter_mut().zip(from).for_each(|(t, f)| *t = (*t).min(*f));
        lower(&mut self.lowest, &other.lowest);
        self.only.iter_mut().zip(&other.only).for_each(|(to, from)| *to |= from);
        if self.trusted.is_empty() {
            self.trusted.clone_from(&other.trusted);
        } else {
            lower(&mut self.trusted, &other.trusted);
        }
    }

    /// Lowest height of each cell, noise and withheld points aside; [`NONE`]: no point.
    pub fn lowest(&self) -> &[i32] {
        &self.lowest
    }

    /// The same of points whose class is ground or water; `None`: there is no such point.
    pub fn trusted(&self) -> Option<&[i32]> {
        (!self.trusted.is_empty()).then_some(&self.trusted)
    }

    /// Whether a pulse with a single return hit the cell.
    pub fn has_only_return(&self, cell: usize) -> bool {
        self.only[cell / 64] >> (cell % 64) & 1 != 0
    }

    /// Bytes that it takes.
    pub fn bytes(&self) -> usize {
        4 * (self.lowest.capacity() + self.trusted.capacity()) + 8 * self.only.capacity()
    }
}
