//! Decoded points to stage 1, on several threads at once.

use super::grid::{GroundGrid, TileKey};
use super::lows::{LowTile, Seen};
use crate::coords::{CellIndex, Height, Ordinary};
use crate::source::{FLAG_WITHHELD, PointBlock, Returns};
use std::collections::HashMap;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Classes whose points are ground, or as low: ground, water, water of bathymetric scans.
const TRUSTED: [u8; 3] = [2, 9, 41];
/// Classes that take no part: low and high noise.
const NOISE: [u8; 2] = [7, 18];
/// Points that are placed at a time.
const BATCH: usize = 128;

/// Whether a point takes part: it is no noise and not withheld.
#[inline]
pub fn takes_part(class: u8, flags: u8) -> bool {
    flags & FLAG_WITHHELD == 0 && !NOISE.contains(&class)
}

type Shared = Arc<Mutex<LowTile>>;

/// What is seen is whole after each point.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// All tiles while points arrive.
pub struct LowTiles {
    ground: GroundGrid,
    core: [Range<i64>; 2],
    erased: bool,
    tiles: Mutex<HashMap<TileKey, Shared>>,
    outside: AtomicU64,
}

/// What one thread keeps between blocks.
#[derive(Default)]
pub struct Gatherer {
    /// The tile of the last point.
    last: Option<(TileKey, Shared)>,
    east: Vec<f64>,
    north: Vec<f64>,
    up: Vec<f64>,
}

impl LowTiles {
    /// Of points in those finest cells of the base grid that lie in `core`; others, strays, would take a tile each.
    pub fn new(ground: GroundGrid, core: [Range<i64>; 2]) -> LowTiles {
        LowTiles { ground, core, erased: false, tiles: Mutex::default(), outside: AtomicU64::new(0) }
    }

    /// As if no point were classified, noise apart.
    pub fn with_classes_erased(self) -> LowTiles {
        LowTiles { erased: true, ..self }
    }

    /// The cells.
    pub fn ground(&self) -> &GroundGrid {
        &self.ground
    }

    /// Takes in the points of `block`. `world(first, axes)` gives E, N, U of as many points from `first` on as the axes
    /// hold, CRS units. O(points).
    pub fn add(&self, own: &mut Gatherer, block: &PointBlock, world: impl Fn(usize, [&mut [f64]; 3])) {
        let ordinary = Ordinary::new(&self.ground.grid, &self.core);
        let Gatherer { last, east, north, up } = own;
        for axis in [&mut *east, &mut *north, &mut *up] {
            axis.resize(BATCH, 0.0);
        }
        let (mut i, mut j, mut heights) = ([0; BATCH], [0; BATCH], [Height(0); BATCH]);
        for first in (0..block.len()).step_by(BATCH) {
            let n = BATCH.min(block.len() - first);
            world(first, [&mut east[..n], &mut north[..n], &mut up[..n]]);
            let mut place = |at: Range<usize>| {
                ordinary.cells(0, &east[at.clone()], &mut i[at.clone()])
                    & ordinary.cells(1, &north[at.clone()], &mut j[at.clone()])
                    & ordinary.heights(&up[at.clone()], &mut heights[at])
            };
            let mut kept: [bool; BATCH] =
                std::array::from_fn(|k| k < n && takes_part(block.class[first + k], block.flags[first + k]));
            if !place(0..n) {
                for (k, kept) in kept.iter_mut().enumerate().filter(|(_, kept)| **kept) {
                    *kept = place(k..k + 1);
                    self.outside.fetch_add(u64::from(!*kept), Ordering::Relaxed);
                }
            }
            let placed = |k: usize| self.ground.place(CellIndex { i: i[k], j: j[k] });
            let mut at = 0;
            while at < n {
                if !kept[at] {
                    at += 1;
                    continue;
                }
                let (key, _) = placed(at);
                let tile = match last {
                    Some((of, tile)) if *of == key => tile,
                    _ => &last.insert((key, self.tile(key))).1,
                };
                // As many as follow in it.
                let mut tile = lock(tile);
                while at < n {
                    let (of, cell) = placed(at);
                    if kept[at] && of != key {
                        break;
                    }
                    if kept[at] {
                        tile.see(cell, self.seen(block, first + at, heights[at]));
                    }
                    at += 1;
                }
            }
        }
    }

    #[inline]
    fn seen(&self, block: &PointBlock, record: usize, height: Height) -> Seen {
        Seen {
            height: height.0,
            is_trusted: !self.erased && TRUSTED.contains(&block.class[record]),
            is_only: Returns::Only.holds(block.returns[record]),
        }
    }

    fn tile(&self, key: TileKey) -> Shared {
        Arc::clone(lock(&self.tiles).entry(key).or_default())
    }

    /// Ends the gathering: tiles with points, the same whatever the order in which these came, and how many points had no
    /// cell or height, or lay outside.
    pub fn finish(self) -> (HashMap<TileKey, LowTile>, u64) {
        let tiles = self.tiles.into_inner().unwrap_or_else(PoisonError::into_inner);
        // Threads that have ended may have left theirs.
        let own = |shared: Shared| match Arc::try_unwrap(shared) {
            Ok(tile) => tile.into_inner().unwrap_or_else(PoisonError::into_inner),
            Err(shared) => lock(&shared).clone(),
        };
        let tiles = tiles.into_iter().map(|(key, tile)| (key, own(tile))).collect();
        (tiles, self.outside.into_inner())
    }
}
