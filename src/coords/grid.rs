//! The one grid of all files, from world coordinates to cells and lattice heights.

use super::heights::Height;
use super::section::CellIndex;
use super::stacking::Stacking;

/// Largest distance of a cell index from the grid's origin that the device can address (i32 with room).
pub const CELL_LIMIT: i64 = 1 << 29;

/// Where a file's points are believed to lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// First finest cell, east and north.
    pub low: [i32; 2],
    /// The cell after the last.
    pub high: [i32; 2],
    /// Lowest and highest point, CRS units.
    pub up: [f64; 2],
}

/// The one grid that every file and every run shares: cell index = floor(E / c), anchored at the CRS
/// origin, optionally coarsened by whole powers of two (index >> coarsen); and the lattice that heights lie on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Cell size c before coarsening, CRS units.
    pub base_cell: f64,
    /// Doublings applied on top of `base_cell`.
    pub coarsen: u32,
    /// Added to device-side indices to get absolute ones (in coarsened cells; a multiple of
    /// `SECTION_SIDE`), so that northing 6,000,000 is as small a number as 0.
    pub anchor: [i64; 2],
    /// Step of the heights' lattice, CRS units; a power of two, chosen once (see [`super::height_step`]). Coarser cells keep it.
    pub height_step: f64,
}

impl Grid {
    /// The lattice height at or just above `u` (CRS units); `None` for NaN and from ±(2³¹ - 1) steps on.
    #[inline]
    pub fn height(&self, u: f64) -> Option<Height> {
        let h = (u / self.height_step).ceil();
        // NaN fails both comparisons.
        if h > -2_147_483_648.0 && h < 2_147_483_647.0 { Some(Height(h as i32)) } else { None }
    }

    /// CRS units above U = 0.
    pub fn units(&self, height: Height) -> f64 {
        f64::from(height.0) * self.height_step
    }

    /// Height steps in the side of a cell of detail level `level`.
    pub fn cell_steps(&self, level: u8) -> f64 {
        self.cell() * f64::from(level).exp2() / self.height_step
    }

    /// What columns of detail level `level` are stacked by: their thickness is a cell, rounded up; their slices are the
    /// smallest power of two of steps that is at least two cells of `base_cell`, doubled with each level and each doubling
    /// of the cell.
    pub fn stacking(&self, level: u8) -> Stacking {
        let stacking = Stacking::new(self.base_cell / self.height_step, self.coarsen + u32::from(level));
        Stacking { reach: Stacking::REACH.checked_shr(level.into()).unwrap_or(0), ..stacking }
    }

    /// Side of a finest cell, CRS units.
    pub fn cell(&self) -> f64 {
        self.base_cell * f64::from(self.coarsen).exp2()
    }

    /// The cell that holds (e, n); `None` when it lies more than [`CELL_LIMIT`] cells from the anchor
    /// or is not finite.
    #[inline]
    pub fn cell_of(&self, e: f64, n: f64) -> Option<CellIndex> {
        let i = (e / self.base_cell).floor();
        let j = (n / self.base_cell).floor();
        if !(i.abs() < 9e15 && j.abs() < 9e15) {
            return None;
        }
        let i = ((i as i64) >> self.coarsen) - self.anchor[0];
        let j = ((j as i64) >> self.coarsen) - self.anchor[1];
        let inside = -CELL_LIMIT..CELL_LIMIT;
        (inside.contains(&i) && inside.contains(&j)).then_some(CellIndex { i: i as i32, j: j as i32 })
    }
}

#[cfg(test)]
mod tests {
    use super::super::heights::HEIGHT_STEP;
    use super::*;

    #[test]
    fn heights_round_up_onto_the_lattice() {
        let grid = Grid { base_cell: 0.5, coarsen: 0, anchor: [0; 2], height_step: HEIGHT_STEP };
        assert_eq!(grid.height(1.0), Some(Height(1024)));
        assert_eq!(grid.height(1.0001), Some(Height(1025)));
        assert_eq!(grid.height(-1.0001), Some(Height(-1024)));
        assert_eq!(grid.height(f64::NAN), None);
        assert_eq!(grid.height(3e6), None);
        assert_eq!(grid.height(-3e6), None);
        assert_eq!((grid.cell_steps(0), grid.cell_steps(3)), (512.0, 4096.0));
    }

    #[test]
    fn coarsening_equals_a_shift_of_the_fine_index() {
        let fine = Grid { base_cell: 0.3, coarsen: 0, anchor: [0, 0], height_step: HEIGHT_STEP };
        let coarse = Grid { coarsen: 1, ..fine };
        for k in -2000..2000 {
            let e = f64::from(k) * 0.1;
            let (f, g) = (fine.cell_of(e, -e).unwrap(), coarse.cell_of(e, -e).unwrap());
            assert_eq!((f.i >> 1, f.j >> 1), (g.i, g.j));
        }
    }

    #[test]
    fn a_far_northing_is_a_small_index() {
        let grid =
            Grid { base_cell: 0.5, coarsen: 0, anchor: [1_000_192, 12_000_000], height_step: HEIGHT_STEP };
        assert_eq!(grid.cell_of(500_100.0, 6_000_000.25), Some(CellIndex { i: 8, j: 0 }));
        assert_eq!(grid.cell_of(f64::INFINITY, 0.0), None);
        assert_eq!(grid.cell_of(1e12, 0.0), None);
    }
}
