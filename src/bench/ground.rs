//! The ground of unclassified points: what its stages take, and how it compares with classes that are the truth.
//!
//! Files are read twice: into tiles of stage 1, and, once the ground is there, point by point to compare.

use super::failure::Stopped;
use super::report::{GroundRow, Stat, TruthRow};
use crate::ground::{
    FILLED, GroundFilter, GroundGrid, GroundTile, LOW, LowTile, LowTiles, MEASURED, OBJECT, TILE_CELLS,
    TILE_SIDE, TileKey, takes_part,
};
use crate::ingest::input::Input;
use crate::ingest::meaning::Meaning;
use crate::ingest::workers::{ReadProgress, Sink, read_all};
use crate::load::Opening;
use crate::source::{Fields, LayerMemory, PointBlock, SourceError};
use anyhow::{Context, ensure};
use cpu_time::ThreadTime;
use std::collections::HashMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// How it is measured.
#[derive(Clone, Copy, Debug)]
pub struct GroundOptions {
    /// Classes are the truth: nothing is known of them but to compare.
    pub truth: bool,
    /// Threads that read and infer.
    pub threads: u32,
    /// Times that stage 2 is run.
    pub runs: u32,
}

/// Classes whose points are ground where classes are the truth: ground, water, rails, roads, water of bathymetric scans.
const GROUND: [u8; 5] = [2, 9, 10, 11, 41];

type Tiles<T> = HashMap<TileKey, T>;

/// Points by truth and by what was told of them.
#[derive(Default)]
struct Counts {
    /// [truth is ground][told to be ground].
    points: [[AtomicU64; 2]; 2],
}

/// Compares points with the ground.
struct Judge<'a> {
    ground: &'a GroundGrid,
    tiles: &'a Tiles<GroundTile>,
    /// File by file.
    counts: Vec<Counts>,
}

/// A thread's places of a block.
#[derive(Default)]
struct Places {
    axes: [Vec<f64>; 3],
}

impl Sink for Judge<'_> {
    type Own = Places;
    fn fields(&self) -> Fields {
        Fields::default()
    }
    fn take(&self, own: &mut Places, index: usize, input: &Input, block: &PointBlock) {
        own.axes.iter_mut().for_each(|axis| axis.resize(block.len(), 0.0));
        let [east, north, up] = &mut own.axes;
        input.world_of_many(block, 0, [east, north, up]);
        let mut counts = [[0; 2]; 2];
        let mut last: Option<(TileKey, &GroundTile)> = None;
        for record in (0..block.len()).filter(|&k| takes_part(block.class[k], block.flags[k])) {
            let Some((key, at)) = self.ground.place_of([east[record], north[record]]) else { continue };
            let tile = match last {
                Some((of, tile)) if of == key => tile,
                _ => {
                    // Points that lie too far outside were not gathered.
                    let Some(tile) = self.tiles.get(&key) else { continue };
                    last.insert((key, tile)).1
                }
            };
            let told = tile.at(at).is_some_and(|ground| ground.holds(self.ground, up[record]));
            let truth = GROUND.contains(&block.class[record]);
            counts[usize::from(truth)][usize::from(told)] += 1;
        }
        for (to, from) in self.counts[index].points.iter().flatten().zip(counts.iter().flatten()) {
            to.fetch_add(*from, Ordering::Relaxed);
        }
    }
}

/// Of points by truth and by what was told: see [`Counts`].
fn row_of(file: String, [object, ground]: [[u64; 2]; 2]) -> anyhow::Result<TruthRow> {
    let [objects, grounds] = [object, ground].map(|told| told[0] + told[1]);
    let points = objects + grounds;
    ensure!(grounds > 0, "{file}: none of its points is classified as ground: no truth to compare with");
    let share = |part: u64, of: u64| part as f64 / of as f64;
    let wrong = share(object[1] + ground[0], points);
    // By chance.
    let told_ground = share(object[1] + ground[1], points);
    let by_chance = told_ground * share(grounds, points) + (1.0 - told_ground) * share(objects, points);
    Ok(TruthRow {
        file,
        points,
        ground: share(grounds, points),
        total: wrong,
        type_1: share(ground[0], grounds),
        type_2: (objects > 0).then(|| share(object[1], objects)),
        kappa: (objects > 0).then_some((1.0 - wrong - by_chance) / (1.0 - by_chance)),
    })
}

/// The ground of all tiles, and the time of one core that it took.
fn infer(
    ground: &GroundGrid,
    lows: &Tiles<LowTile>,
    threads: u32,
    stop: &AtomicBool,
) -> (Tiles<GroundTile>, Duration) {
    let mut keys: Vec<_> = lows.keys().copied().collect();
    keys.sort_unstable();
    let (next, done) = (AtomicUsize::new(0), Mutex::new((Tiles::new(), Duration::ZERO)));
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                let mut filter = GroundFilter::default();
                while let Some(&key) = keys.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if stop.load(Ordering::Relaxed) {
                        break;
                    }
                    let near = key.around().map(|key| lows.get(&key));
                    let start = ThreadTime::now();
                    let tile = filter.tile(ground, near);
                    let took = start.elapsed();
                    let mut done = done.lock().unwrap_or_else(|e| e.into_inner());
                    done.0.insert(key, tile);
                    done.1 += took;
                }
            });
        }
    });
    done.into_inner().unwrap_or_else(|e| e.into_inner())
}

/// Shares of cells with each of the flags.
fn shares(tiles: &Tiles<GroundTile>) -> [f64; 4] {
    let mut counts = [0; 4];
    for tile in tiles.values() {
        for cell in 0..TILE_CELLS {
            let flags = tile.flags([cell % TILE_SIDE, cell / TILE_SIDE].map(|at| at as i32));
            let flag = [MEASURED, FILLED, OBJECT, LOW];
            counts.iter_mut().zip(flag).for_each(|(n, flag)| *n += u64::from(flags & flag != 0));
        }
    }
    counts.map(|n: u64| n as f64 / (tiles.len() * TILE_CELLS) as f64)
}

/// Measures the ground of what is open.
///
/// # Errors
/// The first thing that cannot be read, files without truth, [`Stopped`].
pub fn run(
    opening: Opening,
    options: &GroundOptions,
    progress: &mut dyn FnMut(&str),
    stop: &AtomicBool,
) -> anyhow::Result<GroundRow> {
    let metre = opening.about.unit.as_ref().map_or(1.0, |unit| unit.si.recip());
    let ground = GroundGrid::new(opening.grid, metre).with_context(|| {
        let cell = opening.grid.cell();
        format!(
            "--cell: cells of {cell} are {:.3} m wide; the ground is told in cells of 4 m at most",
            cell / metre
        )
    })?;
    let inputs: Vec<_> = opening.inputs.into_iter().map(|open| open.input).collect();
    let GroundOptions { truth, threads, runs } = *options;
    let layers = LayerMemory::default();
    let whole = |errors: Vec<SourceError>| match errors.into_iter().next() {
        _ if stop.load(Ordering::Relaxed) => Err(anyhow::Error::from(Stopped)),
        Some(error) => Err(error.into()),
        None => Ok(()),
    };
    progress("ground: reading");
    let lows = LowTiles::new(ground, opening.core);
    let lows = if truth { lows.with_classes_erased() } else { lows };
    let (start, read) = (Instant::now(), ReadProgress::default());
    whole(read_all(&inputs, &lows, threads as usize, &layers, &read))?;
    let gather_s = start.elapsed().as_secs_f64();
    let (lows, outside) = lows.finish();
    ensure!(!lows.is_empty(), "no point has a ground cell");
    let (mut tiles, mut infer_us) = (Tiles::new(), Vec::new());
    for run in 1..=runs {
        progress(&format!("ground: {} tiles, run {run} of {runs}", lows.len()));
        let (made, took) = infer(&ground, &lows, threads, stop);
        whole(Vec::new())?;
        infer_us.push(took.as_secs_f64() * 1e6 / (made.len() * TILE_CELLS) as f64);
        tiles = made;
    }
    let mut rows = Vec::new();
    if truth {
        progress("ground: comparing");
        let counts = inputs.iter().map(|_| Counts::default()).collect();
        let judge = Judge { ground: &ground, tiles: &tiles, counts };
        whole(read_all(&inputs, &judge, threads as usize, &layers, &ReadProgress::default()))?;
        for (input, counts) in inputs.iter().zip(judge.counts) {
            let counts = counts.points.map(|told| told.map(AtomicU64::into_inner));
            rows.push(row_of(input.file.path().display().to_string(), counts)?);
        }
    }
    Ok(GroundRow {
        points: read.points.into_inner(),
        outside,
        cell: ground.cell(),
        tiles: lows.len() as u64,
        threads,
        gather_s,
        infer_us: Stat::of(infer_us).context("at least one run")?,
        shares: shares(&tiles),
        truth: rows,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_shares_of_what_is_true() {
        // 60 points of ground, 12 of them told to be objects; 40 objects, 4 told to be ground.
        let row = row_of("a".to_owned(), [[36, 4], [12, 48]]).unwrap();
        let near = |a: f64, b: f64| (a - b).abs() < 1e-12;
        assert!(near(row.total, 0.16) && near(row.type_1, 0.2) && near(row.type_2.unwrap(), 0.1));
        assert!(near(row.kappa.unwrap(), (0.84 - 0.504) / 0.496) && row.points == 100 && row.ground == 0.6);
        let bare = row_of("b".to_owned(), [[0, 0], [1, 9]]).unwrap();
        assert!(bare.type_2.is_none() && bare.kappa.is_none() && near(bare.total, 0.1));
        assert!(
            row_of("c.las".to_owned(), [[5, 5], [0, 0]]).unwrap_err().to_string().starts_with("c.las: none")
        );
    }
}
