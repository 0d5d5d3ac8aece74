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
pub use write::{Format, SynthError, write_tile};

/// Points of the [`demo`] scene.
pub const DEMO_POINTS: u64 = 3_000_000;
/// Side of the demo scene, m, and how many tiles it is made of each way.
const DEMO_SIDE: f64 = 640.0;
const DEMO_TILES: u64 = 2;

/// The tiles of the scene that `render --demo` shows: the middle of the town of seed 1. Each can be
/// [`scan`]ned on its own thread.
pub fn demo() -> (Town, Vec<Tile>) {
    let side = DEMO_SIDE / DEMO_TILES as f64;
    let tiles = (0..DEMO_TILES * DEMO_TILES).map(|k| {
        let (column, row) = (k % DEMO_TILES, k / DEMO_TILES);
        let corner = [column, row].map(|c| c as f64 * side - DEMO_SIDE / 2.0);
        Tile { corner, size: [side; 2], points: DEMO_POINTS / (DEMO_TILES * DEMO_TILES) }
    });
    (Town::new(1), tiles.collect())
}
