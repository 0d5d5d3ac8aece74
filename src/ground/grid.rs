//! Tiles of the ground: their cells, keys, and what lengths come to in them.

use crate::coords::{CellIndex, Grid};

/// log2 of a tile's side in cells.
const TILE_LOG2: u32 = 8;
/// A tile's side in cells.
pub const TILE_SIDE: usize = 1 << TILE_LOG2;
/// Cells of a tile.
pub const TILE_CELLS: usize = TILE_SIDE * TILE_SIDE;
/// Widest cells, m: wider ones tell nothing of the ground.
const WIDEST_CELL_M: f64 = 4.0;
/// Largest opening, m; so many cells of a metre in its radius.
const WIDEST_WINDOW_M: f64 = 18.0;
/// Most openings: a cell is no smaller than a metre.
pub(super) const MOST_WINDOWS: usize = WIDEST_WINDOW_M as usize;

/// A tile: [`TILE_SIDE`] cells of `c · 2^level` on a side, at tile indices (x, y) relative to [`Grid::anchor`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TileKey {
    /// Its cells are `c · 2^level` wide.
    pub level: u8,
    /// Eastward index.
    pub x: i32,
    /// Northward index.
    pub y: i32,
}

impl TileKey {
    /// The 3 × 3 tiles around it, row by row from the south-west; itself in the middle.
    pub fn around(self) -> [TileKey; 9] {
        std::array::from_fn(|k| {
            let [dx, dy] = [k % 3, k / 3].map(|at| at as i32 - 1);
            TileKey { x: self.x + dx, y: self.y + dy, ..self }
        })
    }
}

/// The cells of the ground: those of the world's grid, by a power of two wider.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundGrid {
    /// The grid of everything.
    pub grid: Grid,
    /// A metre, CRS units.
    pub metre: f64,
    /// Cells are `c · 2^level` wide.
    pub level: u8,
}

impl GroundGrid {
    /// Finest cells of `grid`, doubled until they are a metre wide at least; `None`: they are wider than 4 m. `metre`: in
    /// CRS units.
    pub fn new(grid: Grid, metre: f64) -> Option<GroundGrid> {
        let doublings = (metre / grid.cell()).log2().ceil();
        // Cells are counted in 30 bits.
        let level = doublings.clamp(0.0, 30.0) as u8;
        (grid.cell() <= WIDEST_CELL_M * metre).then_some(GroundGrid { grid, metre, level })
    }

    /// Side of a cell, CRS units.
    pub fn cell(&self) -> f64 {
        self.grid.cell() * f64::from(self.level).exp2()
    }

    /// Tile and cell in it, row by row from its south-west, of a finest cell.
    #[inline]
    pub(super) fn place(&self, cell: CellIndex) -> (TileKey, usize) {
        let [i, j] = [cell.i, cell.j].map(|at| at >> self.level);
        let side = TILE_SIDE as i32 - 1;
        let key = TileKey { level: self.level, x: i >> TILE_LOG2, y: j >> TILE_LOG2 };
        (key, ((j & side) as usize) << TILE_LOG2 | (i & side) as usize)
    }

    /// Tile of a place (CRS units), and where in it, cells from the middle of its south-western one.
    pub fn place_of(&self, [e, n]: [f64; 2]) -> Option<(TileKey, [f64; 2])> {
        let (key, _) = self.place(self.grid.cell_of(e, n)?);
        let within = |v: f64, axis: usize, tile: i32| {
            // Ground cells from the origin of the world; a whole number of them lies before the anchor.
            let anchor = self.grid.anchor[axis] >> self.level;
            v / self.cell() - (anchor + (i64::from(tile) << TILE_LOG2)) as f64 - 0.5
        };
        Some((key, [within(e, 0, key.x), within(n, 1, key.y)]))
    }

    /// Height steps in a length in CRS units; what is beyond counting is the most that can be counted.
    pub(super) fn steps(&self, units: f64) -> u32 {
        (units / self.grid.height_step).round() as u32
    }

    /// Openings: radii of 1 cell, 2, … up to 18 m.
    pub(super) fn windows(&self) -> usize {
        self.cells_of(WIDEST_WINDOW_M, MOST_WINDOWS)
    }

    /// Whole cells in a length in m, one at least and at `most`.
    pub(super) fn cells_of(&self, length_m: f64, most: usize) -> usize {
        let cells = (length_m * self.metre / self.cell() + 1e-9).floor();
        cells.clamp(1.0, most as f64) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(cell: f64) -> Grid {
        Grid { base_cell: cell, coarsen: 0, anchor: [1 << 28, -(1 << 28)], height_step: 1.0 / 1024.0 }
    }

    #[test]
    fn cells_are_a_metre_at_least_and_four_at_most() {
        let ground = |cell: f64, metre: f64| GroundGrid::new(grid(cell), metre).unwrap();
        for (cell, metre, side, windows) in [
            (0.25, 1.0, 1.0, 18),
            (0.125, 1.0, 1.0, 18),
            (0.3, 1.0, 1.2, 15),
            (0.26, 1.0, 1.04, 17),
            (0.13, 1.0, 1.04, 17),
            (0.5, 1.0, 1.0, 18),
            (1.0, 1.0, 1.0, 18),
            (1.5, 1.0, 1.5, 12),
            (2.0, 1.0, 2.0, 9),
            (4.0, 1.0, 4.0, 4),
            // Feet: a metre is 3.28 of them.
            (0.25, 1.0 / 0.3048, 4.0, 14),
            (1.0, 1.0 / 0.3048, 4.0, 14),
            (13.0, 1.0 / 0.3048, 13.0, 4),
        ] {
            let ground = ground(cell, metre);
            assert!((ground.cell() - side).abs() < 1e-12, "{cell}: {}", ground.cell());
            assert_eq!(ground.windows(), windows, "{cell}");
        }
        assert_eq!(ground(1e-12, 1.0).level, 30);
        for (cell, metre) in [(4.01, 1.0), (64.0, 1.0), (13.2, 1.0 / 0.3048)] {
            assert_eq!(GroundGrid::new(grid(cell), metre), None);
        }
    }

    #[test]
    fn places_lie_in_the_cells_of_their_points() {
        for coarsen in [0, 1] {
            let grid = grid(0.25);
            let grid = Grid { coarsen, anchor: grid.anchor.map(|a| a >> coarsen), ..grid };
            let ground = GroundGrid::new(grid, 1.0).unwrap();
            for k in 0..4000 {
                let at = [67_108_864.0 + f64::from(k) * 0.37, -67_108_864.0 - f64::from(k) * 0.61];
                let (key, index) = ground.place(grid.cell_of(at[0], at[1]).unwrap());
                let (same, [x, y]) = ground.place_of(at).unwrap();
                assert_eq!(key, same);
                let cell = [index % TILE_SIDE, index / TILE_SIDE];
                assert_eq!([x, y].map(|v| (v + 0.5).floor() as usize), cell, "{at:?}");
            }
        }
    }

    #[test]
    fn the_middle_of_nine_is_the_tile() {
        let key = TileKey { level: 2, x: -1, y: 5 };
        assert_eq!(key.around()[4], key);
        assert_eq!(key.around()[0], TileKey { level: 2, x: -2, y: 4 });
        assert_eq!(key.around()[5], TileKey { level: 2, x: 0, y: 5 });
    }
}
