//! The ground of files whose classes are the truth, read as everything is.

use crate::made::data_dir;
use lasray::bench::ground::{GroundOptions, run};
use lasray::bench::report::GroundRow;
use lasray::coords::{Grid, HEIGHT_STEP};
use lasray::ground::{
    FILLED, Gatherer, GroundFilter, GroundGrid, GroundTile, LowTile, LowTiles, TileKey, roofs,
};
use lasray::ingest::bins::Budget;
use lasray::load::{self, LoadOptions};
use lasray::problems::Problems;
use lasray::sample::Asked;
use lasray::section::Surface;
use lasray::source::placement::PlacementOptions;
use lasray::synth::{self, ORIGIN, PATCH, Patch, SCALE, Town};
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

fn ground_of(files: &[PathBuf], truth: bool, threads: u32) -> anyhow::Result<GroundRow> {
    ground_in(0.25, files, truth, threads)
}

fn ground_in(cell: f64, files: &[PathBuf], truth: bool, threads: u32) -> anyhow::Result<GroundRow> {
    let options = LoadOptions {
        surface: Surface::Columns,
        cell: Some(cell.into()),
        placement: PlacementOptions::default(),
        rgb_bits: None,
        asked: Asked::default(),
        budget: Budget { host_bytes: u64::MAX, device_bytes: u64::MAX },
        cache: None,
        quiet: true,
    };
    let opening = load::open(files, &options, &mut Problems::default())?;
    run(opening, &GroundOptions { truth, threads, runs: 1 }, &mut |_| {}, &AtomicBool::new(false))
}

/// The samples of the ISPRS' filter test: objects and ground told by hand.
#[test]
fn the_ground_of_unclassified_points_is_that_of_the_truth() {
    let Some(dir) = data_dir() else { return };
    let files = ["samp31", "samp42", "samp53"].map(|name| dir.join(format!("ground_truth/{name}-utm.laz")));
    if let Some(missing) = files.iter().find(|file| !file.is_file()) {
        return eprintln!("skipped: {} is not there", missing.display());
    }
    let row = ground_of(&files, true, 2).unwrap();
    println!("{:#?}", row.truth);
    assert_eq!((row.cell, row.points, row.outside, row.truth.len()), (1.0, 105_710, 0, 3));
    let mean = row.truth.iter().map(|truth| truth.total).sum::<f64>() / 3.0;
    assert!(mean <= 0.045 && row.truth.iter().all(|truth| truth.total <= 0.08), "{mean}");
    // One by one, on one thread: their tiles do not meet.
    for (file, truth) in files.iter().zip(&row.truth) {
        let alone = ground_of(std::slice::from_ref(file), true, 1).unwrap();
        assert_eq!(&alone.truth, std::slice::from_ref(truth));
    }
    // What is told by classes is found by them.
    let told = ground_of(&files, false, 2).unwrap();
    assert!(told.truth.is_empty() && told.shares[0] > 0.0 && told.shares != row.shares);
    // Cells of two metres are no worse by much, and wider ones than four tell nothing.
    for (cell, most) in [(0.5, mean), (1.0, mean), (2.0, 0.06)] {
        let row = ground_in(cell, &files, true, 2).unwrap();
        let mean = row.truth.iter().map(|truth| truth.total).sum::<f64>() / 3.0;
        println!("{cell}: {mean}");
        assert!(row.cell == cell.max(1.0) && mean <= most, "{mean}");
    }
    let error = ground_in(5.0, &files, true, 2).unwrap_err().to_string();
    assert!(error.contains("cells of 5 are 5.000 m wide"), "{error}");
    let unclassified = [dir.join("ground_truth/CSite4_orig-utm.laz")];
    let error = ground_of(&unclassified, true, 2).unwrap_err().to_string();
    assert!(error.contains("CSite4_orig-utm.laz: none of its points is classified as ground"), "{error}");
}

#[test]
fn cells_are_a_metre_at_least_in_feet_too() {
    let Some(dir) = data_dir() else { return };
    for (name, cell) in [("urban/fusa.laz", 1.0), ("autzen/autzen_trim.las", 4.0)] {
        let row = ground_of(&[dir.join(name)], false, 2).unwrap();
        assert!(row.cell == cell && row.shares[0] > 0.05, "{name}: {row:?}");
    }
}

/// The town that does not exist has a ground that is known everywhere.
struct Land {
    ground: GroundGrid,
    lows: HashMap<TileKey, LowTile>,
    tiles: HashMap<TileKey, GroundTile>,
    town: Town,
}

const SIDE: f64 = 320.0;

impl Land {
    /// Its middle, of so many points.
    fn new(points: u64) -> Land {
        let grid = Grid {
            base_cell: 0.25,
            coarsen: 0,
            anchor: [2_048_000, 21_612_000].map(|anchor: i64| anchor >> 8 << 8),
            height_step: HEIGHT_STEP,
        };
        let (ground, town) = (GroundGrid::new(grid, 1.0).unwrap(), Town::new(1));
        let lows = LowTiles::new(ground, [0..1 << 30, 0..1 << 30]).with_classes_erased();
        let mut own = Gatherer::default();
        for tile in synth::square([-SIDE / 2.0; 2], SIDE, points) {
            let Ok(()) = synth::scan(&town, &tile, |scan| {
                let block = &scan.points;
                lows.add(&mut own, block, |first, [e, n, u]| {
                    let axes = [(e, &block.x, ORIGIN[0]), (n, &block.y, ORIGIN[1]), (u, &block.z, 0.0)];
                    for (to, raw, offset) in axes {
                        to.iter_mut()
                            .zip(&raw[first..])
                            .for_each(|(to, v)| *to = f64::from(*v) * SCALE + offset);
                    }
                });
                Ok::<(), std::convert::Infallible>(())
            });
        }
        let (lows, outside) = lows.finish();
        assert_eq!(outside, 0);
        let mut filter = GroundFilter::default();
        let mut make = |key: TileKey| filter.tile(&ground, key.around().map(|key| lows.get(&key)));
        let tiles = lows.keys().map(|&key| (key, make(key))).collect();
        Land { ground, lows, tiles, town }
    }

    /// Calls `each` with the middles of cells, m from the town's origin, their tile and place in it, and what stands there.
    fn each(&self, mut each: impl FnMut([f64; 2], TileKey, [i32; 2], &Patch)) {
        let patches = SIDE / 2.0 / PATCH;
        let range = (-patches).floor() as i64..patches.ceil() as i64;
        for (i, j) in range.clone().flat_map(|i| range.clone().map(move |j| (i, j))) {
            let patch = Patch::new(&self.town, i, j);
            for (x, y) in (0..PATCH as i32).flat_map(|x| (0..PATCH as i32).map(move |y| (x, y))) {
                let at = [(i, x), (j, y)].map(|(k, v)| k as f64 * PATCH + f64::from(v) + 0.5);
                // Not where the scan ends.
                if at.iter().all(|v| v.abs() < SIDE / 2.0 - 20.0) {
                    let (key, [x, y]) = self.ground.place_of([at[0] + ORIGIN[0], at[1] + ORIGIN[1]]).unwrap();
                    each(at, key, [x, y].map(|v| v.round() as i32), &patch);
                }
            }
        }
    }
}

#[test]
fn ground_and_roofs_of_the_town_are_found() {
    let land = Land::new(800_000);
    // How far the ground is off, where it was measured and where it was filled in.
    let mut off = [const { Vec::new() }; 2];
    let of_tile = |key: TileKey| {
        let around = key.around();
        roofs(&land.ground, around.map(|key| land.lows.get(&key)), around.map(|key| land.tiles.get(&key)))
    };
    let roofs: HashMap<_, _> = land.tiles.keys().map(|&key| (key, of_tile(key))).collect();
    let (mut told, mut true_roofs, mut both) = (0, 0, 0);
    land.each(|[x, y], key, [i, j], patch| {
        let tile = &land.tiles[&key];
        if let Some(height) = tile.height([i, j]) {
            let height = f64::from(height) * HEIGHT_STEP - patch.ground(x, y);
            off[usize::from(tile.flags([i, j]) & FILLED != 0)].push(height.abs());
        }
        // A roof all over the cell, or nowhere in it.
        let corners = [[-0.4, -0.4], [0.4, -0.4], [-0.4, 0.4], [0.4, 0.4]];
        let is_roof = corners.map(|[dx, dy]| patch.roof(x + dx, y + dy).is_some());
        if is_roof.iter().all(|is| *is == is_roof[0]) {
            let is_told = roofs[&key][(j * 256 + i) as usize];
            told += u32::from(is_told);
            true_roofs += u32::from(is_roof[0]);
            both += u32::from(is_told && is_roof[0]);
        }
    });
    for (off, [most, share]) in off.iter_mut().zip([[0.5, 0.98], [1.0, 0.95]]) {
        off.sort_by(f64::total_cmp);
        let at = |share: f64| off[(share * (off.len() - 1) as f64) as usize];
        println!(
            "{} cells, off by {:.2} at 50 %, {:.2} at 95 %, {:.2} m at 99 %",
            off.len(),
            at(0.5),
            at(0.95),
            at(0.99)
        );
        assert!(off.len() > 5000 && at(share) < most);
    }
    println!("roofs: {true_roofs} cells, {told} told, {both} of them right");
    assert!(true_roofs > 5000 && f64::from(both) > 0.95 * f64::from(told.max(true_roofs)));
}
