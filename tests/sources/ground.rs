//! The ground of files whose classes are the truth, read as everything is.

use crate::made::data_dir;
use lasray::bench::ground::{GroundOptions, run};
use lasray::bench::report::GroundRow;
use lasray::ingest::bins::Budget;
use lasray::load::{self, LoadOptions};
use lasray::problems::Problems;
use lasray::sample::Asked;
use lasray::section::Surface;
use lasray::source::placement::PlacementOptions;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

fn ground_of(files: &[PathBuf], truth: bool, threads: u32) -> anyhow::Result<GroundRow> {
    let options = LoadOptions {
        surface: Surface::Columns,
        cell: Some(0.25.into()),
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
        assert_eq!(alone.truth, [truth.clone()]);
    }
    // What is told by classes is found by them.
    let told = ground_of(&files, false, 2).unwrap();
    assert!(told.truth.is_empty() && told.shares[0] > 0.0 && told.shares != row.shares);
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
