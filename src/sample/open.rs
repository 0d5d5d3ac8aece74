//! The files of a set, opened at once, each with the coordinate system that it names.

use super::parallel::parallel;
use crate::source::crs::{self, Crs, CrsError};
use crate::source::known::Known;
use crate::source::learned::Counts;
use crate::source::{LidarFile, SourceError};
use std::path::{Path, PathBuf};

/// A file that is open, and the coordinate system it names.
#[derive(Debug)]
pub struct Opened {
    /// Header, records, chunks.
    pub file: LidarFile,
    /// Its coordinate system.
    pub crs: Option<Crs>,
    /// Definitions that had to be passed over.
    pub crs_errors: Vec<CrsError>,
    /// What is known of where its chunks lie, beside what it says itself: nothing, unless somebody has looked.
    pub known: Known,
    /// How many points it has of each kind; empty: nobody has counted.
    pub counts: Counts,
}

/// Opens every path on all cores; results in the order of `paths`. Handles are released again: thousands
/// of files may be listed at a time.
pub fn open_all(paths: &[PathBuf]) -> Vec<Result<Opened, SourceError>> {
    let open = |path: &Path| {
        let file = LidarFile::open(path)?;
        let (crs, crs_errors) = crs::of_file(&file)?;
        file.bytes.release();
        Ok(Opened { file, crs, crs_errors, known: Known::default(), counts: Counts::new() })
    };
    parallel(paths.len(), |_, index| open(&paths[index]))
}
