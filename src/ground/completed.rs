//! Completed ground: the surface of stage 2 goes through lowest points; the mean of all ground points around takes its place.
//!
//! At the middle of a cell it is the surface plus the weighted mean of the residuals of ground points against it, so that a slope
//! stays one where points are few (Gao, Nocera, Neumann 2012, section 5.2, of heights). Weights are 1 / distance. Sums of
//! whole numbers: the order of points changes nothing.

use super::grid::{GroundGrid, TILE_SIDE};
use super::lows::NONE;
use super::tile::{GroundTile, RINGED};

/// Ground points that lie around a place, on average.
const POINTS: f64 = 16.0;
/// Weight of a point one cell away.
const UNIT: f64 = 1024.0;
/// Nearer points weigh no more, cells.
const NEAREST: f64 = 1.0 / 16.0;
/// Residuals are counted up to so many steps, far beyond what ground is taken for.
const MOST: f64 = (1 << 24) as f64;
/// Farthest that points count, cells: as far as the surface is filled.
const FARTHEST: f64 = 20.0;

/// The completed ground of a tile while its points arrive.
pub struct Completion {
    /// Cells.
    radius: f64,
    sums: Vec<i64>,
    weights: Vec<i64>,
}

impl Completion {
    /// Of ground points of which there are `density` in a square unit.
    pub fn new(ground: &GroundGrid, density: f64) -> Completion {
        let radius = (POINTS / (std::f64::consts::PI * density)).sqrt() / ground.cell();
        let cells = RINGED * RINGED;
        // NaN is as far as can be.
        Completion { radius: radius.min(FARTHEST), sums: vec![0; cells], weights: vec![0; cells] }
    }

    /// How far from its tile and the ring around that points count, cells.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Takes in a ground point of this tile or of one beside it: where it lies, in cells from the middle of this tile's
    /// south-western one, and its residual, lattice steps above the surface of the tile that it lies in.
    pub fn add(&mut self, [x, y]: [f64; 2], residual: f64) {
        let residual = residual.round().clamp(-MOST, MOST) as i64;
        let cells = |at: f64| {
            let [first, last] = [(at - self.radius).ceil(), (at + self.radius).floor()];
            first.max(-1.0) as i32..=last.min(TILE_SIDE as f64) as i32
        };
        for row in cells(y) {
            for column in cells(x) {
                let distance = (x - f64::from(column)).hypot(y - f64::from(row));
                if distance <= self.radius {
                    let at = GroundTile::index([column, row]);
                    let weight = (UNIT / distance.max(NEAREST)).round() as i64;
                    self.sums[at] += weight * residual;
                    self.weights[at] += weight;
                }
            }
        }
    }

    /// Heights of the middles of `tile`'s cells, lattice steps, row by row with the ring; [`NONE`]: void. Where no ground
    /// point is near they are the surface's.
    pub fn heights(&self, tile: &GroundTile) -> Vec<i32> {
        let residuals = self.sums.iter().zip(&self.weights);
        let moved = tile.heights.iter().zip(residuals).map(|(&height, (&sum, &weight))| {
            if height == NONE || weight == 0 {
                return height;
            }
            let mean = (2 * sum + weight).div_euclid(2 * weight);
            (i64::from(height) + mean).clamp((i32::MIN + 1).into(), (NONE - 1).into()) as i32
        });
        moved.collect()
    }
}
