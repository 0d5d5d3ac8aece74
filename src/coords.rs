//! Units as types: world points, heights on one lattice, cells, sections.

use glam::DVec3;

/// A point in the file's CRS: E, N, U in CRS units (f64 on the host only, never on the GPU).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldPoint(pub DVec3);

/// Height steps in one CRS unit: heights lie on a lattice of 2⁻¹⁰ unit, anchored at U = 0.
pub const HEIGHT_STEPS_PER_UNIT: f64 = 1024.0;

/// log2 of a section's side in cells.
pub const SECTION_LOG2: u32 = 8;
/// A section's side in cells.
pub const SECTION_SIDE: u32 = 1 << SECTION_LOG2;
/// Columns in a section.
pub const SECTION_COLUMNS: usize = (SECTION_SIDE * SECTION_SIDE) as usize;

/// Largest distance of a cell index from the grid's origin that the device can address (i32 with room).
pub const CELL_LIMIT: i64 = 1 << 29;

/// A height on the lattice: `ceil(U · 1024)`. `i32::MIN` never occurs: it stands for "no point".
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Height(pub i32);

impl Height {
    /// The lattice height at or just above `u` (CRS units); `None` beyond ±2,097,151 units or NaN.
    #[inline]
    pub fn from_units(u: f64) -> Option<Height> {
        let h = (u * HEIGHT_STEPS_PER_UNIT).ceil();
        // NaN fails both comparisons.
        if h > -2_147_483_648.0 && h < 2_147_483_647.0 { Some(Height(h as i32)) } else { None }
    }

    /// CRS units above U = 0.
    pub fn units(self) -> f64 {
        f64::from(self.0) / HEIGHT_STEPS_PER_UNIT
    }
}

/// A finest cell of the grid: indices relative to [`Grid::anchor`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CellIndex {
    /// Eastward index.
    pub i: i32,
    /// Northward index.
    pub j: i32,
}

/// A section of the quadtree: `SECTION_SIDE` cells of `c·2^level` on a side, at section indices (i, j)
/// relative to [`Grid::anchor`].
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
}

/// The one grid that every file and every run shares: cell index = floor(E / c), anchored at the CRS
/// origin, optionally coarsened by whole powers of two (index >> coarsen).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Cell size c before coarsening, CRS units.
    pub base_cell: f64,
    /// Doublings applied on top of `base_cell`.
    pub coarsen: u32,
    /// Added to device-side indices to get absolute ones (in coarsened cells; a multiple of
    /// `SECTION_SIDE`), so that northing 6,000,000 is as small a number as 0.
    pub anchor: [i64; 2],
}

impl Grid {
    /// Side of a finest cell, CRS units.
    pub fn cell(&self) -> f64 {
        self.base_cell * f64::from(self.coarsen).exp2()
    }

    /// West and south borders of `cell`, CRS units.
    pub fn corner(&self, cell: CellIndex) -> [f64; 2] {
        let c = self.cell();
        [(i64::from(cell.i) + self.anchor[0]) as f64 * c, (i64::from(cell.j) + self.anchor[1]) as f64 * c]
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

/// A number for people: at most six digits behind the point, none of them idle; an exponent where it would be long.
pub fn tidy(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && !(1e-6..1e15).contains(&size) {
        // Four digits, again without idle ones.
        return format!("{value:.3e}")
            .parse::<f64>()
            .map_or_else(|_| value.to_string(), |v| format!("{v:e}"));
    }
    let fixed = format!("{value:.6}");
    fixed.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_tidy() {
        let numbers =
            [0.0, 1.0, -0.25, 17.275000000000002, 6_277_568.0, 100.0, 1e-6, 1e-30, 1.0 / 3e9, 1e300];
        let words =
            ["0", "1", "-0.25", "17.275", "6277568", "100", "0.000001", "1e-30", "3.333e-10", "1e300"];
        assert_eq!(numbers.map(tidy), words);
        assert_eq!(tidy(f64::NAN), "NaN");
    }

    #[test]
    fn heights_round_up_onto_the_lattice() {
        assert_eq!(Height::from_units(1.0), Some(Height(1024)));
        assert_eq!(Height::from_units(1.0001), Some(Height(1025)));
        assert_eq!(Height::from_units(-1.0001), Some(Height(-1024)));
        assert_eq!(Height::from_units(f64::NAN), None);
        assert_eq!(Height::from_units(3e6), None);
        assert_eq!(Height::from_units(-3e6), None);
    }

    #[test]
    fn coarsening_equals_a_shift_of_the_fine_index() {
        let fine = Grid { base_cell: 0.3, coarsen: 0, anchor: [0, 0] };
        let coarse = Grid { base_cell: 0.3, coarsen: 1, anchor: [0, 0] };
        for k in -2000..2000 {
            let e = f64::from(k) * 0.1;
            let (f, g) = (fine.cell_of(e, -e).unwrap(), coarse.cell_of(e, -e).unwrap());
            assert_eq!((f.i >> 1, f.j >> 1), (g.i, g.j));
        }
    }

    #[test]
    fn a_far_northing_is_a_small_index() {
        let grid = Grid { base_cell: 0.5, coarsen: 0, anchor: [1_000_192, 12_000_000] };
        assert_eq!(grid.cell_of(500_100.0, 6_000_000.25), Some(CellIndex { i: 8, j: 0 }));
        assert_eq!(grid.cell_of(f64::INFINITY, 0.0), None);
        assert_eq!(grid.cell_of(1e12, 0.0), None);
    }
}
