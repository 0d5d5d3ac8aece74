//! Each step from file to packed section by itself, one thread, warm.
//!
//! `cargo bench --bench parts [-- FILTER]`; files are made in a temporary folder and removed.

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use lasray::attribute::{Attributes, Record};
use lasray::coords::{Grid, HEIGHT_STEP, Height, SECTION_SIDE};
use lasray::ingest::bins::{Binner, Bins, Budget};
use lasray::ingest::input::Input;
use lasray::sample::RgbDepth;
use lasray::section::{Columns, Surface};
use lasray::source::placement::Placement;
use lasray::source::{Decoder, LidarFile, PointBlock};
use lasray::synth::{Format, Tile, Town, write_tile};
use std::hint::black_box;
use std::path::Path;
use std::sync::atomic::AtomicBool;

const POINTS: u64 = 500_000;
const SIDE: f64 = 250.0;

/// A scan of 8 points a square metre.
fn town(folder: &Path, format: Format, extension: &str) -> LidarFile {
    let path = folder.join(format!("town.{extension}"));
    let tile = Tile { corner: [0.0; 2], size: [SIDE; 2], points: POINTS };
    let never = AtomicBool::new(false);
    write_tile(&Town::new(1), &tile, &path, format, extension == "laz", &never, |_| ()).expect("written");
    LidarFile::open(&path).expect("just made")
}

fn decode(file: &LidarFile, sink: &mut dyn FnMut(&PointBlock)) {
    let mut decoder = Decoder::default();
    for chunk in &file.chunks {
        decoder.decode(file, chunk, 0..chunk.records, sink).expect("just made");
    }
}

fn decoding(c: &mut Criterion) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut group = c.benchmark_group("decode");
    group.throughput(Throughput::Elements(POINTS)).sample_size(10);
    for (format, number) in [(Format::Three, 3), (Format::Seven, 7)] {
        for extension in ["las", "laz"] {
            let file = town(folder.path(), format, extension);
            group.bench_function(format!("{extension}{number}"), |b| {
                b.iter(|| {
                    decode(&file, &mut |block| {
                        black_box(block.z.last());
                    })
                });
            });
        }
    }
}

fn binning(c: &mut Criterion) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = town(folder.path(), Format::Three, "las");
    let mut blocks = Vec::new();
    decode(&file, &mut |block| blocks.push(block.clone()));
    let input = Input { file, placement: Placement::default(), rgb: RgbDepth::Sixteen };
    let mut group = c.benchmark_group("bin");
    group.throughput(Throughput::Elements(POINTS)).sample_size(20);
    for cell in [0.25, 0.3, 1.0] {
        group.bench_function(format!("cells of {cell} m"), |b| {
            let mut binner = Binner::default();
            let corner = input.file.header.min;
            let anchor = [corner.x, corner.y].map(|v| (v / cell / 16_777_216.0).floor() as i64 * 16_777_216);
            let grid = Grid { base_cell: cell, coarsen: 0, anchor, height_step: HEIGHT_STEP };
            let everywhere = [i64::MIN / 4..i64::MAX / 4, i64::MIN / 4..i64::MAX / 4];
            let plenty = Budget { host_bytes: u64::MAX, device_bytes: u64::MAX };
            b.iter_batched(
                || Bins::new(Surface::Columns, grid, everywhere.clone(), plenty),
                |bins| {
                    blocks.iter().for_each(|block| binner.bin(&bins, &input, block));
                    bins.finish()
                },
                BatchSize::PerIteration,
            );
        });
    }
}

fn record(height: i32, class: u8) -> Record {
    let height = Height(height);
    Record::pack(Attributes { height, class, intensity: 900, rgb: [80, 90, 70], returns: 0x11, flags: 0 })
}

/// Open land: one run in every column.
fn open_land() -> Columns {
    let mut columns = Columns::default();
    for at in 0..SECTION_SIDE * SECTION_SIDE {
        let (x, y) = (at % SECTION_SIDE, at / SECTION_SIDE);
        columns.add(x, y, record((400 * 1024 + x * 7 + y * 3 + (x * y) % 31) as i32, 2));
    }
    columns
}

/// Ground, with one to three layers of vegetation over two columns of three; one column in nine is empty.
fn forest() -> Columns {
    let mut columns = Columns::default();
    for at in 0..SECTION_SIDE * SECTION_SIDE {
        let (x, y) = (at % SECTION_SIDE, at / SECTION_SIDE);
        let random = at.wrapping_mul(2_654_435_761) >> 16;
        let layers = if random % 9 == 0 { 0 } else { [1, 2, 4][random as usize / 9 % 3] };
        for layer in 0..layers {
            columns.add(x, y, record((400 * 1024 + layer * 6000 + random % 5000) as i32, 2 + layer as u8));
        }
    }
    columns
}

fn packing(c: &mut Criterion) {
    let mut group = c.benchmark_group("pack");
    for (name, columns) in [("open land", open_land()), ("forest", forest())] {
        let mut ring = vec![0; columns.layout().words as usize];
        group.throughput(Throughput::Bytes(4 * ring.len() as u64));
        group.bench_function(name, |b| b.iter(|| columns.pack_into(black_box(&mut ring))));
    }
}

criterion_group!(parts, decoding, binning, packing);
criterion_main!(parts);
