//! What the device does, by its own clock where it has one: derived passes, uploads, traversal.
//!
//! `cargo bench --bench device [-- FILTER]`; the device is the one that `lasray` takes.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use lasray::attribute::{Attributes, ClassMask, ColorTable, Flags, Record};
use lasray::coords::{Grid, HEIGHT_STEP, Height, SECTION_SIDE, SectionKey};
use lasray::gpu::{Gpu, GpuOptions, Order, QueueKind, Timestamps};
use lasray::ingest::bins::Budget;
use lasray::load::{self, LoadOptions};
use lasray::problems::Problems;
use lasray::render::camera::{Camera, Projection};
use lasray::render::frame::{Background, PASSES, Renderer, Shade, Traversal, View};
use lasray::resident::Work;
use lasray::resident::pool::Access;
use lasray::resident::scene::Scene;
use lasray::resident::visibility::Visibility;
use lasray::section::{Columns, Payload, Surface};
use lasray::source::placement::PlacementOptions;
use lasray::synth::{Format, Tile, Town, write_tile};
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

/// Sections of a scene, a square of them.
const SECTIONS_SIDE: i32 = 4;

const GRID: Grid = Grid { base_cell: 0.25, coarsen: 0, anchor: [0; 2], height_step: HEIGHT_STEP };

const SHOWN: fn(u32) -> Visibility = |bridge| Visibility {
    classes: ClassMask::default(),
    hidden_flags: Flags::WITHHELD,
    bridge,
    near_ties: false,
};

/// Two points a cell: one column in eight is empty, one in four has a second class.
fn section(seed: u32) -> Payload {
    let mut columns = Columns::default();
    for at in 0..SECTION_SIDE * SECTION_SIDE {
        let (x, y) = (at % SECTION_SIDE, at / SECTION_SIDE);
        let random = (at ^ seed << 20).wrapping_mul(2_654_435_761) >> 16;
        let ground = 400 * 1024 + ((x * 7 + y * 3) as i32) + (random % 31) as i32;
        for (class, wanted) in
            [(2, !random.is_multiple_of(8)), (5, !random.is_multiple_of(8) && random % 4 == 1)]
        {
            if wanted {
                let height = Height(ground + i32::from(class - 2) * 2000);
                let attributes =
                    Attributes { height, class, intensity: 900, rgb: [80, 90, 70], returns: 0x11, flags: 0 };
                columns.add(x, y, Record::pack(attributes));
            }
        }
    }
    columns.pack()
}

fn gpu() -> Gpu {
    Gpu::new(&GpuOptions::default()).expect("a device")
}

fn sections() -> Vec<(SectionKey, Payload)> {
    let places = (0..SECTIONS_SIDE).flat_map(|j| (0..SECTIONS_SIDE).map(move |i| (i, j)));
    places.map(|(i, j)| (SectionKey { level: 0, i, j }, section((j * SECTIONS_SIDE + i) as u32))).collect()
}

/// Device time of `work` since the last look; `else_` where the device has no clock.
fn device_time(scene: &mut Scene, work: Work, else_: Duration) -> Duration {
    let times = scene.take_times().expect("times");
    if times.is_empty() {
        return else_;
    }
    times.into_iter().filter(|(of, _)| *of == work).map(|(_, ns)| Duration::from_nanos(ns as u64)).sum()
}

fn deriving(c: &mut Criterion) {
    let (gpu, sections) = (gpu(), sections());
    let mut group = c.benchmark_group("derive");
    group.throughput(Throughput::Elements(sections.len() as u64)).sample_size(10);
    let some = ClassMask::only(&[2]);
    for (name, shown) in [
        ("measured", SHOWN(0)),
        ("measured, one class", Visibility { classes: some, ..SHOWN(0) }),
        ("bridged", SHOWN(4)),
        ("bridged, one class", Visibility { classes: some, ..SHOWN(4) }),
    ] {
        let mut scene =
            Scene::new(&gpu, |o: Order| o, Access::Address, 1 << 30, shown, GRID).expect("a scene");
        for (key, packed) in &sections {
            assert!(scene.upload(*key, packed).expect("copied"));
        }
        scene.settle().expect("built");
        scene.measure();
        // What shows nothing differs from both.
        let other = Visibility { classes: ClassMask::only(&[200]), ..shown };
        group.bench_function(name, |b| {
            b.iter_custom(|n| {
                let mut sum = Duration::ZERO;
                for _ in 0..n {
                    scene.set_visibility(other).expect("built");
                    scene.wait().expect("built");
                    scene.take_times().expect("times");
                    let from = Instant::now();
                    scene.set_visibility(shown).expect("built");
                    scene.wait().expect("built");
                    sum += device_time(&mut scene, Work::Build, from.elapsed());
                }
                sum
            });
        });
    }
}

fn uploading(c: &mut Criterion) {
    let (gpu, sections) = (gpu(), sections());
    let mut scene =
        Scene::new(&gpu, |o: Order| o, Access::Address, 1 << 30, SHOWN(0), GRID).expect("a scene");
    let bytes: u64 = sections.iter().map(|(_, p)| 4 * p.words.len() as u64).sum();
    let mut group = c.benchmark_group("upload");
    group.throughput(Throughput::Bytes(bytes)).sample_size(10);
    scene.measure();
    group.bench_function("ring to pool, host clock", |b| {
        b.iter_custom(|n| {
            let mut sum = Duration::ZERO;
            for _ in 0..n {
                let from = Instant::now();
                for (key, packed) in &sections {
                    assert!(scene.upload(*key, packed).expect("copied"));
                }
                scene.wait().expect("copied");
                sum += from.elapsed();
                scene.settle().expect("built");
                scene.take_times().expect("times");
            }
            sum
        });
    });
    group.bench_function("copies, device clock", |b| {
        b.iter_custom(|n| {
            let mut sum = Duration::ZERO;
            for _ in 0..n {
                let from = Instant::now();
                for (key, packed) in &sections {
                    assert!(scene.upload(*key, packed).expect("copied"));
                }
                scene.wait().expect("copied");
                sum += device_time(&mut scene, Work::Copy, from.elapsed());
                scene.settle().expect("built");
                scene.take_times().expect("times");
            }
            sum
        });
    });
}

fn tracing(c: &mut Criterion) {
    const SIZE: [u32; 2] = [640, 360];
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("town.las");
    let tile = Tile { corner: [0.0; 2], size: [250.0; 2], points: 500_000 };
    let never = AtomicBool::new(false);
    write_tile(&Town::new(1), &tile, &path, Format::Three, false, &never, |_| ()).expect("written");
    let options = LoadOptions {
        surface: Surface::Columns,
        cell: Some(0.5.into()),
        placement: PlacementOptions::default(),
        rgb_bits: None,
        asked: lasray::sample::Asked::default(),
        budget: Budget { host_bytes: 1 << 31, device_bytes: 1 << 30 },
        cache: None,
        quiet: true,
    };
    let loaded = load::paths(&[path], &options, &mut Problems::default()).expect("loaded");
    let gpu = gpu();
    let bounds = loaded.about.bounds;
    let anchor = loaded.grid.height(bounds.center().z).expect("on the Earth");
    let colors = ColorTable::new(loaded.about.color, &loaded.about.summary, &loaded.grid, None, None)
        .expect("colours");
    let mut scene =
        Scene::new(&gpu, |o: Order| o, Access::Address, 1 << 30, SHOWN(0), loaded.grid).expect("a scene");
    for (key, columns) in loaded.sections {
        assert!(scene.upload(key, &columns.pack()).expect("copied"));
    }
    scene.settle().expect("built");
    let mut renderer = Renderer::new(&scene, loaded.grid, anchor).expect("passes");
    let mut clock = Timestamps::new(&gpu, "frame", QueueKind::Compute, PASSES).expect("a clock");
    let camera =
        Camera::frame(&bounds, [215.0, 35.0], Projection::Perspective { fov: 45.0 }, SIZE).expect("a camera");
    let mut group = c.benchmark_group("trace");
    group.throughput(Throughput::Elements(u64::from(SIZE[0] * SIZE[1]))).sample_size(10);
    for (name, traversal) in [("fast", Traversal::Fast), ("plain", Traversal::Plain)] {
        let view = View {
            camera: &camera,
            size: SIZE,
            samples: 1,
            z_scale: 1.0,
            pivot: bounds.min.z,
            bounds,
            slab: None,
            colors: &colors,
            shade: Shade::None,
            background: Background::None,
            traversal,
            window: None,
        };
        group.bench_function(name, |b| {
            b.iter_custom(|n| {
                let mut sum = Duration::ZERO;
                for _ in 0..n {
                    let table = renderer.table(&scene);
                    let from = Instant::now();
                    let point =
                        renderer.submit_frame(&mut scene, &view, &table, clock.as_mut()).expect("drawn");
                    scene.order.wait(point).expect("drawn");
                    sum += match &mut clock {
                        Some(clock) => {
                            let stages = clock.resolve(&mut scene.order, point).expect("times");
                            Duration::from_nanos(stages.iter().map(|(_, ns)| *ns as u64).sum())
                        }
                        None => from.elapsed(),
                    };
                }
                sum
            });
        });
    }
}

criterion_group! {
    name = device;
    config = Criterion::default().warm_up_time(Duration::from_secs(1)).measurement_time(Duration::from_secs(3));
    targets = deriving, uploading, tracing
}
criterion_main!(device);
