//! Reading and binning beside decoding alone, in one run: M points/s for LAS and LAZ, warm.
//!
//! `cargo bench --bench ingest [-- POINTS]` (default 20M); files are made in a temporary folder and removed.
//! Each figure is the median of five runs taken in turn, so that a machine that slows down slows all of them.

use lasray::coords::Grid;
use lasray::sample::RgbDepth;
use lasray::source::placement::Placement;
use lasray::source::{Decoder, LidarFile};
use lasray::stream::bins::{Bins, Budget};
use lasray::stream::workers::{Input, Progress, read_all};
use lasray::synth::{Format, Tile, Town, write_tile};
use std::hint::black_box;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Instant;

const RUNS: usize = 5;
const CELL: f64 = 1.0;
const PER_M2: f64 = 8.0;

/// Seconds to decode every chunk of `file` on `threads`, throwing the points away.
fn decode(file: &LidarFile, threads: usize) -> f64 {
    let start = Instant::now();
    let next = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                let mut decoder = Decoder::default();
                while let Some(chunk) = file.chunks.get(next.fetch_add(1, Ordering::Relaxed)) {
                    decoder
                        .decode(file, chunk, 0..chunk.records, &mut |block| {
                            black_box(block.z.last());
                        })
                        .expect("the file was just made");
                }
            });
        }
    });
    start.elapsed().as_secs_f64()
}

/// Seconds in the `las` crate's own reader, one thread, all fields: raw records out.
fn crate_alone(path: &Path) -> f64 {
    let start = Instant::now();
    let mut reader = las::Reader::from_path(path).expect("the file was just made");
    let mut points = las::PointDataBuilder::new().for_header(reader.header()).build();
    while reader.fill_points(1 << 16, &mut points).expect("whole") > 0 {
        black_box(points.raw_bytes().last());
    }
    start.elapsed().as_secs_f64()
}

/// Seconds to read and bin.
fn ingest(input: &[Input], threads: usize) -> f64 {
    let start = Instant::now();
    let center = (input[0].file.header.min + input[0].file.header.max) * 0.5;
    let anchor = [center.x, center.y].map(|v| (v / CELL / 16_777_216.0).floor() as i64 * 16_777_216);
    let bins = Bins::new(
        Grid { base_cell: CELL, coarsen: 0, anchor },
        [i64::MIN / 4..i64::MAX / 4, i64::MIN / 4..i64::MAX / 4],
        Budget { host_bytes: u64::MAX, device_bytes: u64::MAX },
    );
    let errors = read_all(input, &bins, threads, &Progress::default());
    assert!(errors.is_empty(), "{errors:?}");
    black_box(bins.finish().expect("no budget").sections.len());
    start.elapsed().as_secs_f64()
}

fn median(mut seconds: Vec<f64>) -> f64 {
    seconds.sort_by(f64::total_cmp);
    seconds[seconds.len() / 2]
}

fn main() {
    let millions = std::env::args().skip(1).find_map(|a| a.trim_end_matches('M').parse().ok()).unwrap_or(20);
    let points: u64 = millions * 1_000_000;
    let folder = tempfile::tempdir().expect("a temporary folder");
    println!(
        "{:<16} {:>8} {:>12} {:>12} {:>12} {:>12} {:>12}",
        "M points/s", "format", "las/laz 1T", "decode 1T", "decode 2T", "bin 1T", "bin 2T"
    );
    for (format, extension) in [(3, "las"), (7, "las"), (3, "laz"), (7, "laz")] {
        let path = folder.path().join(format!("town{format}.{extension}"));
        let side = (points as f64 / PER_M2).sqrt();
        let tile = Tile { corner: [-side / 2.0; 2], size: [side; 2], points };
        let as_format = if format == 3 { Format::Three } else { Format::Seven };
        let never = AtomicBool::new(false);
        write_tile(&Town::new(1), &tile, &path, as_format, extension == "laz", &never, |_| ())
            .expect("written");
        let open = || LidarFile::open(&path).expect("just made");
        let file = open();
        let input = [Input { file: open(), placement: Placement::AsIs, rgb: RgbDepth::Sixteen }];
        let mut seconds: [Vec<f64>; 5] = Default::default();
        decode(&file, 2);
        for _ in 0..RUNS {
            seconds[0].push(crate_alone(&path));
            seconds[1].push(decode(&file, 1));
            seconds[2].push(decode(&file, 2));
            seconds[3].push(ingest(&input, 1));
            seconds[4].push(ingest(&input, 2));
        }
        let rates = seconds.map(|s| file.points() as f64 / median(s) / 1e6);
        println!(
            "{:<16} {:>8} {:>12.1} {:>12.1} {:>12.1} {:>12.1} {:>12.1}",
            extension, format, rates[0], rates[1], rates[2], rates[3], rates[4]
        );
        std::fs::remove_file(&path).expect("removed");
    }
}
