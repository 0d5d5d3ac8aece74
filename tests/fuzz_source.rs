//! Broken files at random: nothing panics, hangs, or takes memory on the word of a few bytes.
//!
//! Two thousand cases by default; `LASRAY_FUZZ_SECONDS=3600` goes on for that long.

mod broken;
mod made;

use lasray::source::{Decoder, LidarFile, PointBlock};
use peak_alloc::PeakAlloc;
use proptest::{prelude::*, test_runner::TestCaseError};
use std::{
    cell::Cell,
    path::Path,
    time::{Duration, Instant},
};

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// Memory that opening and decoding a file may take beside a few times its length.
const MEMORY: usize = 64 << 20;
/// Longer than any case of so small files may take in a debug build on a busy machine.
const TIME: Duration = Duration::from_secs(30);

/// What the reader promises of any file; returns the points that it gave.
fn check(path: &Path, len: usize) -> Result<u64, TestCaseError> {
    let before = ALLOCATOR.current_usage();
    ALLOCATOR.reset_peak_usage();
    let start = Instant::now();
    let mut points = 0;
    if let Ok(file) = LidarFile::open(path) {
        prop_assert!(file.header.scale.is_finite() && file.header.scale.cmpgt(glam::DVec3::ZERO).all());
        prop_assert!(file.header.offset.is_finite());
        let mut first_record = 0;
        let mut decoder = Decoder::default();
        for (i, chunk) in file.chunks.iter().enumerate() {
            prop_assert_eq!((chunk.index, chunk.first_record), (i as u64, first_record));
            prop_assert!(chunk.records > 0);
            prop_assert!(chunk.byte_offset + chunk.byte_len <= len as u64);
            first_record += chunk.records;
            let mut next = chunk.first_record;
            let result = decoder.decode(&file, chunk, 0..u64::MAX, &mut |block: &PointBlock| {
                assert_eq!(block.first_record, next);
                next += block.len() as u64;
                let lens = [block.y.len(), block.z.len(), block.class.len(), block.flags.len()];
                assert_eq!(lens, [block.len(); 4]);
                assert_eq!([block.intensity.len(), block.returns.len()], [block.len(); 2]);
                assert!(block.rgb.is_empty() || block.rgb.len() == block.len());
            });
            let read = next - chunk.first_record;
            prop_assert!(read <= chunk.records);
            if let Err(error) = result {
                let said = error.to_string();
                prop_assert!(said.contains(&format!("chunk {i} at byte {}", chunk.byte_offset)), "{}", said);
            }
            points += read;
        }
        decoder.first_points(&file, 100).unwrap();
        prop_assert_eq!(file.points(), first_record);
        for vlr in &file.vlrs {
            if let Ok(payload) = vlr.read(&file.bytes, 1 << 20) {
                prop_assert_eq!(payload.len() as u64, vlr.len);
            }
        }
    }
    let used = ALLOCATOR.peak_usage().saturating_sub(before);
    prop_assert!(used <= MEMORY + 8 * len, "{} bytes of memory for a file of {}", used, len);
    prop_assert!(start.elapsed() < TIME, "{:?}", start.elapsed());
    Ok(points)
}

/// One test only in this binary: the memory that is measured is its own.
#[test]
fn broken_files_are_survived() {
    let points = Cell::new(0u64);
    broken::fuzz("fuzz_source", 2000, |path, len| {
        points.set(points.get() + check(path, len)?);
        Ok(())
    });
    println!("{} points", points.get());
    assert!(points.get() > 1000);
}
