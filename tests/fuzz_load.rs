//! Broken files at random, from the opening sample to packed sections: nothing panics, hangs, or outgrows its budget,
//! and a sound file beside a broken one is drawn whole.
//!
//! Three hundred cases by default; `LASRAY_FUZZ_SECONDS=3600` goes on for that long.

mod broken;
mod made;

use lasray::attribute::{ColorMode, ColorTable};
use lasray::ingest::bins::Budget;
use lasray::load::{self, LoadOptions};
use lasray::problems::Problems;
use lasray::render::camera::{Camera, DEFAULT_ORBIT, Projection};
use lasray::section::Surface;
use lasray::source::placement::PlacementOptions;
use made::{Made, Packing};
use peak_alloc::PeakAlloc;
use proptest::{prelude::*, test_runner::TestCaseError};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// Budget, what a few thousand sections take beside it, and what decoders hold.
const MEMORY: usize = 256 << 20;
/// Longer than any case of so small files may take in a debug build on a busy machine.
const TIME: Duration = Duration::from_secs(60);
const POINTS: usize = 70;

fn check(paths: &[PathBuf], cell: Option<f64>, mix_crs: bool) -> Result<Option<u64>, TestCaseError> {
    let options = LoadOptions {
        surface: Surface::Columns,
        cell: cell.map(Into::into),
        placement: PlacementOptions { mix_crs, ..Default::default() },
        rgb_bits: None,
        asked: lasray::sample::Asked::default(),
        budget: Budget { host_bytes: 32 << 20, device_bytes: 64 << 20 },
        cache: None,
        quiet: true,
    };
    let before = ALLOCATOR.current_usage();
    ALLOCATOR.reset_peak_usage();
    let (start, mut problems) = (Instant::now(), Problems::default());
    let loaded = load::paths(paths, &options, &mut problems);
    let mut said = Vec::new();
    problems.finish(true, &mut said).unwrap();
    let said = String::from_utf8_lossy(&said).into_owned();
    let points = match loaded {
        Ok(loaded) => {
            prop_assert!(loaded.about.bounds.min.is_finite() && loaded.about.bounds.max.is_finite());
            prop_assert!(loaded.grid.cell() > 0.0 && loaded.grid.cell().is_finite());
            prop_assert!(
                loaded.grid.height(loaded.about.bounds.center().z).is_some(),
                "{:?}",
                loaded.about.bounds
            );
            Camera::frame(&loaded.about.bounds, DEFAULT_ORBIT, Projection::default(), [64, 36])
                .map_err(|e| TestCaseError::fail(e.to_string()))?;
            for mode in [ColorMode::Rgb, ColorMode::Height, ColorMode::Class, ColorMode::Intensity] {
                ColorTable::new(mode, &loaded.about.summary, &loaded.grid, None, None)
                    .map_err(|e| TestCaseError::fail(e.to_string()))?;
            }
            prop_assert!(!loaded.sections.is_empty());
            for (_, columns) in loaded.sections {
                prop_assert!(!columns.pack().words.is_empty());
            }
            Some(loaded.points)
        }
        Err(error) => {
            let named = said.contains("case.laz") || error.to_string().contains("cell size");
            prop_assert!(named, "{}\n{}", error, said);
            None
        }
    };
    let used = ALLOCATOR.peak_usage().saturating_sub(before);
    prop_assert!(used <= MEMORY, "{} bytes of memory", used);
    prop_assert!(start.elapsed() < TIME, "{:?}", start.elapsed());
    Ok(points)
}

/// One test only in this binary: the memory that is measured is its own.
#[test]
fn broken_files_are_survived() {
    let folder = tempfile::tempdir().unwrap();
    let sound = folder.path().join("sound.las");
    fs::write(&sound, Made::new(3, Packing::Plain, POINTS).bytes()).unwrap();
    let drawn = std::cell::Cell::new(0);
    let cases = broken::fuzz("fuzz_load", 300, |path: &Path, len| {
        // What else is chosen follows from the file, so that a failure comes again.
        let cell = [None, None, Some(0.5), Some(1e-4)][len % 4];
        drawn.set(drawn.get() + u64::from(check(&[path.to_owned()], cell, false)?.is_some()));
        let both = check(&[sound.clone(), path.to_owned()], None, true)?;
        prop_assert!(both.is_some_and(|points| points >= POINTS as u64), "{:?}", both);
        Ok(())
    });
    println!("{} of {cases} files were drawn", drawn.get());
    assert!(drawn.get() > cases / 10);
}
