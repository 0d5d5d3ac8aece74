//! A tile of the ground as stage 2 makes it, and what it says of points.

use super::grid::{GroundGrid, TILE_SIDE};
use super::lows::NONE;

/// Cells of a tile's row with those of its neighbours on either side.
pub(super) const RINGED: usize = TILE_SIDE + 2;

/// The surface goes through the cell's lowest point.
pub const MEASURED: u8 = 1;
/// The surface is filled in from cells around.
pub const FILLED: u8 = 2;
/// There are points, all of them above the ground.
pub const OBJECT: u8 = 4;
/// The lowest point is an outlier below the ground.
pub const LOW: u8 = 8;
/// A class says that the lowest point is ground.
pub const CLASSIFIED: u8 = 16;

/// The ground of a tile: its cells row by row from the south-west, and a ring of its neighbours' around them, the same as
/// theirs bit by bit. A cell without [`MEASURED`] and [`FILLED`] is a void.
#[derive(Clone, Debug, PartialEq)]
pub struct GroundTile {
    /// Heights of cells' middles, lattice steps; [`NONE`]: void.
    pub(super) heights: Vec<i32>,
    /// Rise over run.
    pub(super) slopes: Vec<f32>,
    pub(super) flags: Vec<u8>,
}

/// The ground at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundAt {
    /// Lattice steps.
    pub height: f64,
    /// Rise over run.
    pub slope: f64,
}

impl GroundTile {
    pub(super) fn void() -> GroundTile {
        let cells = RINGED * RINGED;
        GroundTile { heights: vec![NONE; cells], slopes: vec![0.0; cells], flags: vec![0; cells] }
    }

    /// Index of a cell; -1 and [`TILE_SIDE`] are those of the ring.
    pub(super) fn index([x, y]: [i32; 2]) -> usize {
        (y + 1) as usize * RINGED + (x + 1) as usize
    }

    /// Height of a cell's middle, lattice steps; `None`: void.
    pub fn height(&self, cell: [i32; 2]) -> Option<i32> {
        Some(self.heights[Self::index(cell)]).filter(|&height| height != NONE)
    }

    /// [`MEASURED`] and its neighbours.
    pub fn flags(&self, cell: [i32; 2]) -> u8 {
        self.flags[Self::index(cell)]
    }

    /// Steepness of a cell, rise over run; 0 in a void.
    pub fn slope(&self, cell: [i32; 2]) -> f32 {
        self.slopes[Self::index(cell)]
    }

    /// The ground at a place of the tile, in cells from the middle of its south-western one: bilinear between the middles of
    /// cells, of those that are no voids; `None` where all four are.
    pub fn at(&self, [x, y]: [f64; 2]) -> Option<GroundAt> {
        let (x0, y0) = (x.floor(), y.floor());
        let (u, v) = (x - x0, y - y0);
        let (mut height, mut slope, mut weights) = (0.0, 0.0, 0.0);
        for (dx, dy, weight) in
            [(0, 0, (1.0 - u) * (1.0 - v)), (1, 0, u * (1.0 - v)), (0, 1, (1.0 - u) * v), (1, 1, u * v)]
        {
            let at = Self::index([x0 as i32 + dx, y0 as i32 + dy]);
            if self.heights[at] != NONE {
                height += weight * f64::from(self.heights[at]);
                slope += weight * f64::from(self.slopes[at]);
                weights += weight;
            }
        }
        (weights > 0.0).then(|| GroundAt { height: height / weights, slope: slope / weights })
    }
}

/// How far from the surface ground is on flat land, m; and how much farther per unit of slope.
const TOLERANCE_M: f64 = 0.5;
const TOLERANCE_OF_SLOPE_M: f64 = 1.25;

impl GroundAt {
    /// Whether a point at a height of `up`, CRS units, is ground.
    pub fn holds(&self, ground: &GroundGrid, up: f64) -> bool {
        let tolerance = (TOLERANCE_M + TOLERANCE_OF_SLOPE_M * self.slope) * ground.metre;
        (up - self.height * ground.grid.height_step).abs() <= tolerance
    }
}
