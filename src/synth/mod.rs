//! A town that does not exist, with exactly known geometry, scanned from the air.
//!
//! [`Town`] is a pure function of a seed on an unbounded plane; [`Patch`] answers what stands at a place; [`scan`]
//! flies over a [`Tile`] and hands out its points in blocks; [`write_tile`] makes a LAS or LAZ file of them. So
//! tiles can be made in any order, on any thread, and neighbours fit.

mod cover;
mod object;
mod patch;
mod random;
mod scan;
mod terrain;
mod town;
mod write;

#[cfg(test)]
mod tests;

pub use patch::{Hit, Leaves, PATCH, Patch, Section, class};
pub use scan::{ORIGIN, SCALE, ScanBlock, Tile, scan};
pub use town::Town;
pub use write::{Format, SynthError, is_made_here, write_tile};

/// Points of the [`demo`] scene.
pub const DEMO_POINTS: u64 = 3_000_000;
/// Side of the demo scene, m, and how many tiles it is made of each way.
const DEMO_SIDE: f64 = 640.0;
/// Side of a tile of [`square`], m, or a little more.
const TILE_SIDE: f64 = 320.0;

/// The tiles of the scene that `render --demo` shows: the middle of the town of seed 1. Each can be
/// [`scan`]ned on its own thread.
pub fn demo() -> (Town, Vec<Tile>) {
    (Town::new(1), square([-DEMO_SIDE / 2.0; 2], DEMO_SIDE, DEMO_POINTS))
}

/// Tiles of a square with its south-western corner `corner` from [`ORIGIN`], `side` m wide, `points` in all.
pub fn square(corner: [f64; 2], side: f64, points: u64) -> Vec<Tile> {
    let across = (side / TILE_SIDE).round().max(1.0) as u64;
    let (size, tiles) = (side / across as f64, across * across);
    let share = |k: u64| (u128::from(points) * u128::from(k) / u128::from(tiles)) as u64;
    let tile = |k: u64| {
        let corner = [corner[0] + (k % across) as f64 * size, corner[1] + (k / across) as f64 * size];
        Tile { corner, size: [size; 2], points: share(k + 1) - share(k) }
    };
    (0..tiles).map(tile).filter(|tile| tile.points > 0).collect()
}
