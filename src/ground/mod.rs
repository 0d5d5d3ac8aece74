//! The ground below points, whether they are classified or not.
//!
//! Stage 1 gathers what points say of the cells of **ground tiles** ([`LowTiles`], [`LowTile`]): minima and bits, in any
//! order, from any thread. Stage 2 ([`GroundFilter`]) makes of 3 × 3 such tiles the ground of the one in the middle
//! ([`GroundTile`]), the same bit by bit however it came about.
//! [`Completion`] moves it from the lowest points to the mean of all that are ground.

mod buildings;
mod completed;
mod fill;
mod gather;
mod grid;
mod lows;
mod opening;
mod smrf;
#[cfg(test)]
mod tests;
mod tile;
#[cfg(test)]
mod twin;

pub use buildings::roofs;
pub use completed::Completion;
pub use gather::{Gatherer, LowTiles, takes_part};
pub use grid::{GroundGrid, TILE_CELLS, TILE_SIDE, TileKey};
pub use lows::{LowTile, NONE};
pub use smrf::{GroundFilter, MARGIN};
pub use tile::{CLASSIFIED, FILLED, GroundAt, GroundTile, LOW, MEASURED, OBJECT};
