//! What goes wrong while data is read, and what changes under it: the rest goes on, and nothing more than it must is read.

use super::SIZE;
use super::common::{LAVAPIPE, Setup};
use super::live::{self, Means, PLENTY, World, all_sections, options, tiles};
use super::scene::{self, BRIDGED};
use lasray::coords::SectionKey;
use lasray::ingest::builds::{Cells, cells_of};
use lasray::load;
use lasray::problems::Problems;
use lasray::render::camera::{Camera, Projection};
use lasray::resident::cut::Sight;
use lasray::resident::live::Live;
use lasray::section::{PayloadKey, Surface};
use lasray::source::LidarFile;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// All of it, from above.
fn above(world: &World, detail: f64) -> (Camera, Sight) {
    let camera = Camera::frame(&world.bounds, [0.0, 90.0], Projection::default(), SIZE).unwrap();
    let sight = world.sight(&camera, detail);
    (camera, sight)
}

/// Cells that a file's points lie in, by its header.
fn cells(world: &World, path: &Path) -> Cells {
    let header = LidarFile::open(path).unwrap().header;
    cells_of(&world.grid, header.min, header.max).unwrap()
}

/// Sections that are shown and that no file of `but` touches are what all points make of them. Gives their number.
fn rest_is_whole(world: &mut World, paths: &[PathBuf], but: &[Cells]) -> usize {
    let all = all_sections(world.surface, paths);
    let shown = world.live.shown().to_vec();
    let rest = |key: &SectionKey| !but.iter().any(|[low, high]| key.touches(*low, *high));
    let rest: Vec<_> = shown
        .iter()
        .filter(|(at, from)| PayloadKey::columns(*at) == *from)
        .map(|(at, _)| *at)
        .filter(rest)
        .collect();
    for key in &rest {
        let is = world.scene.read_back(*key).unwrap().unwrap().uploaded;
        assert_eq!(Some(&is), all.get(key), "{key:?}");
    }
    rest.len()
}

#[cfg(target_os = "linux")]
#[test]
fn a_disk_that_fails_costs_what_lies_on_it() {
    // It can be opened, but its end cannot be read.
    let failing = Setup { failing: Some(("d.las", 4_000_000)), ..LAVAPIPE };
    live::run("faults::a_disk_that_fails_costs_what_lies_on_it", failing, |setup, surface| {
        assert!(!failing_disk::VARIABLES.is_empty());
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let paths = tiles(folder.path());
        let mut world = World::open(&gpu, surface, &paths, PLENTY, BRIDGED());
        let (_, sight) = above(&world, 0.3);
        let status = world.complete(&sight);
        assert!(status.damaged > 0, "{status:?}");
        let errors = world.live.take_errors();
        assert_eq!(errors.len(), 1, "{errors:?}");
        assert!(errors[0].contains("d.las") && errors[0].contains("os error 5"), "{errors:?}");
        let lost = cells(&world, &paths[3]);
        assert!(rest_is_whole(&mut world, &paths[..3], &[lost]) > 3);
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

#[test]
fn a_file_cut_short_while_it_is_seen_costs_what_lies_in_it() {
    live::run(
        "faults::a_file_cut_short_while_it_is_seen_costs_what_lies_in_it",
        LAVAPIPE,
        |setup, surface| {
            let gpu = setup.gpu();
            let folder = tempfile::tempdir().unwrap();
            let paths = tiles(folder.path());
            let mut world = World::open(&gpu, surface, &paths, PLENTY, BRIDGED());
            // A place in the third, and then all.
            let lost = cells(&world, &paths[2]);
            let size = world.bounds.max - world.bounds.min;
            let place = world.bounds.min + size * glam::DVec3::new(0.2, 0.8, 0.5);
            let near = Camera::orbit(place, [0.0, 90.0], 60.0, Projection::default()).unwrap();
            let sight = world.sight(&near, 1.0);
            world.complete(&sight);
            assert!(world.live.take_errors().is_empty());
            let len = fs::metadata(&paths[2]).unwrap().len();
            fs::File::options().write(true).open(&paths[2]).unwrap().set_len(len / 3).unwrap();
            let (_, sight) = above(&world, 0.3);
            let status = world.complete(&sight);
            assert!(status.damaged > 0, "{status:?}");
            let errors = world.live.take_errors();
            assert_eq!(errors.len(), 1, "{errors:?}");
            assert!(errors[0].contains("c.laz") && errors[0].contains("changed"), "{errors:?}");
            let others = [&paths[..2], &paths[3..]].concat();
            assert!(rest_is_whole(&mut world, &others, &[lost]) > 3);
            assert_eq!(gpu.messages(), [""; 0]);
        },
    );
}

/// Sixty-four tiles of 40 m, compressed and not.
fn many(folder: &Path) -> Vec<PathBuf> {
    let tile = |k: usize| {
        let corner = [k % 8, k / 8].map(|v| -160.0 + 40.0 * v as f64);
        scene::town(folder, &format!("{k:02}.{}", ["las", "laz"][k % 2]), corner, 40.0)
    };
    (0..64).map(tile).collect()
}

#[test]
fn hiding_one_of_many_files_reads_only_its_neighbours() {
    live::run("faults::hiding_one_of_many_files_reads_only_its_neighbours", LAVAPIPE, |setup, surface| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let paths = many(folder.path());
        let mut world = World::open(&gpu, surface, &paths, PLENTY, BRIDGED());
        let (_, sight) = above(&world, 0.3);
        world.complete(&sight);
        let hidden = 27;
        let its = cells(&world, &paths[hidden]);
        let touched: Vec<SectionKey> =
            world.live.wanted().filter(|key| key.touches(its[0], its[1])).collect();
        let shares = |path: &PathBuf| {
            let [low, high] = cells(&world, path);
            // A cell more, as bounds of the header are taken.
            let [low, high] = [low.map(|c| c - 1), high.map(|c| c + 1)];
            touched.iter().any(|key| key.touches(low, high))
        };
        let shared: Vec<&PathBuf> = paths.iter().filter(|path| shares(path)).collect();
        let most: u64 = shared.iter().map(|path| fs::metadata(path).unwrap().len()).sum();
        println!("{} of {} sections, {} of 64 files", touched.len(), world.live.wanted().len(), shared.len());
        assert!(touched.len() * 2 < world.live.wanted().len() && shared.len() < 40);
        let all: u64 = paths.iter().map(|path| fs::metadata(path).unwrap().len()).sum();
        for is_shown in [false, true] {
            let before = world.live.status(&world.scene);
            let made = world.scene.counters().sections;
            let start = Instant::now();
            world.live.set_file_visible(hidden, is_shown);
            let after = world.complete(&sight);
            let took = start.elapsed();
            let read = after.progress.bytes_read - before.progress.bytes_read;
            let anew = (world.scene.counters().sections - made) as usize;
            println!("shown: {is_shown}: {anew} sections, {read} of {all} bytes, {took:?}");
            assert!(read <= most, "{read} bytes read, {most} in the files that share its sections");
            // The sparse sample's own beside them.
            assert!(anew <= touched.len() + 4, "{anew} sections anew, it touches {}", touched.len());
            let shown: Vec<_> =
                (0..64).filter(|k| is_shown || *k != hidden).map(|k| paths[k].clone()).collect();
            world.check(&all_sections(surface, &shown));
        }
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

#[test]
fn with_little_memory_there_is_less_detail_and_with_next_to_none_it_is_said() {
    let name = "faults::with_little_memory_there_is_less_detail_and_with_next_to_none_it_is_said";
    live::run(name, LAVAPIPE, |setup, surface| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let paths = tiles(folder.path());
        let shares = |device_bytes| {
            let means = Means { device_bytes, ..PLENTY };
            let mut world = World::open(&gpu, surface, &paths, means, BRIDGED());
            let (camera, sight) = above(&world, 0.3);
            let coarser = loop {
                let tick = world.live.tick(&mut world.scene, &sight, 2 << 20).unwrap();
                assert!(world.scene.pool().held_bytes() <= device_bytes);
                if tick.stuck {
                    break None;
                }
                if tick.complete {
                    break Some(world.live.status(&world.scene).coarser);
                }
                world.live.wait(Duration::from_millis(1));
            }?;
            let hits = world.picture(&camera).distance.iter().filter(|d| d.is_finite()).count();
            Some((coarser, hits))
        };
        let (full, little, none) = (shares(64 << 20), shares(6 << 20), shares(100 << 10));
        println!("{full:?}, {little:?}, {none:?}");
        let ((one, all), (coarser, hits)) = (full.unwrap(), little.unwrap());
        assert!(one == 1.0 && coarser > 1.0);
        // Nothing is lost from sight.
        assert!(hits as f64 > 0.98 * all as f64, "{hits} of {all}");
        assert!(none.is_none());
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

/// What `paths` come to, and the first of them such that reading any chunk of it is a fault of the program.
fn open_with_fault(surface: Surface, paths: &[PathBuf]) -> load::Opening {
    let mut opening = load::open(paths, &options(surface), &mut Problems::default()).unwrap();
    opening.inputs[0].input.file.header.record_len = 0;
    opening
}

#[test]
fn a_fault_of_the_program_costs_the_chunk_it_happened_at() {
    live::run("faults::a_fault_of_the_program_costs_the_chunk_it_happened_at", LAVAPIPE, |setup, surface| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let paths = tiles(folder.path());
        let lost = LidarFile::open(&paths[0]).unwrap();
        let opening = open_with_fault(surface, &paths);
        let mut world = World::of(&gpu, surface, opening, PLENTY, BRIDGED());
        let (_, sight) = above(&world, 0.3);
        assert!(world.complete(&sight).damaged > 0);
        let mut errors = world.live.take_errors();
        errors.sort();
        errors.dedup();
        assert_eq!(errors.len(), lost.chunks.len(), "{errors:?}");
        for (index, error) in errors.iter().enumerate() {
            assert!(error.contains(&format!("a.las: chunk {index} at byte ")), "{error}");
            assert!(error.contains("a fault of the program: attempt to divide by zero"), "{error}");
        }
        let its = cells(&world, &paths[0]);
        assert!(rest_is_whole(&mut world, &paths[1..], &[its]) > 3);
        assert_eq!(world.live.failed(), None);
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

#[test]
fn when_no_thread_reads_any_more_nobody_waits() {
    live::run("faults::when_no_thread_reads_any_more_nobody_waits", LAVAPIPE, |setup, surface| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let paths = tiles(folder.path());
        let mut world = World::open(&gpu, surface, &paths, PLENTY, BRIDGED());
        let (_, sight) = above(&world, 0.3);
        let opening = load::open(&paths, &options(surface), &mut Problems::default()).unwrap();
        world.live = Live::new(opening.inputs, surface, opening.grid, opening.core, 1 << 30, 2, || {
            panic!("nobody is there")
        });
        let start = Instant::now();
        let tick = loop {
            let tick = world.live.tick(&mut world.scene, &sight, 2 << 20).unwrap();
            if tick.failed || tick.complete {
                break tick;
            }
            assert!(start.elapsed() < Duration::from_secs(60), "it waits for ever");
            world.live.wait(Duration::from_millis(1));
        };
        assert!(tick.failed && !tick.complete);
        let why = world.live.failed().unwrap();
        assert!(why.contains("fault of the program: nobody is there"), "{why}");
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

#[test]
fn no_frame_waits_for_threads_that_read() {
    live::run("faults::no_frame_waits_for_threads_that_read", LAVAPIPE, |setup, surface| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let paths = tiles(folder.path());
        let without = all_sections(surface, &paths[1..]);
        let mut world = World::open(&gpu, surface, &paths, PLENTY, BRIDGED());
        let (_, sight) = above(&world, 0.3);
        // Some has arrived, some is under way.
        for _ in 0..5 {
            world.live.tick(&mut world.scene, &sight, 2 << 20).unwrap();
            world.live.wait(Duration::from_millis(5));
        }
        let holder = world.live.holder();
        let (is_held, held) = std::sync::mpsc::channel();
        let (let_go, may_go) = std::sync::mpsc::channel::<()>();
        let thread = std::thread::spawn(move || {
            holder(&mut || {
                is_held.send(()).unwrap();
                let _ = may_go.recv_timeout(Duration::from_secs(20));
            });
        });
        held.recv().unwrap();
        let start = Instant::now();
        let more = load::open(&paths[..1], &options(surface), &mut Problems::default()).unwrap();
        let opened = start.elapsed();
        world.live.set_file_visible(0, false);
        world.live.pause(true);
        world.live.pause(false);
        let added = world.live.add_files(more.inputs, more.core);
        world.live.set_files_visible(&added, false);
        for _ in 0..20 {
            let tick = world.live.tick(&mut world.scene, &sight, 2 << 20).unwrap();
            assert!(!tick.complete, "what was hidden is still there");
            assert_eq!(world.live.try_status(&world.scene).map(|_| ()), None);
        }
        let took = start.elapsed() - opened;
        assert!(took < Duration::from_secs(5), "{took:?}");
        let_go.send(()).unwrap();
        thread.join().unwrap();
        assert_eq!(added, [4]);
        world.complete(&sight);
        world.check(&without);
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

#[test]
fn a_chunk_too_large_for_the_memory_is_named() {
    live::run("faults::a_chunk_too_large_for_the_memory_is_named", LAVAPIPE, |setup, surface| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let paths = tiles(folder.path());
        let means = Means { host_bytes: 256 << 10, ..PLENTY };
        let mut world = World::open(&gpu, surface, &paths, means, BRIDGED());
        let (_, sight) = above(&world, 0.1);
        assert!(world.complete(&sight).damaged > 0);
        let errors = world.live.take_errors();
        assert!(!errors.is_empty());
        for error in errors {
            assert!(error.contains(".laz: chunk ") && error.contains("32768 are allowed"), "{error}");
        }
        let lost = [1, 2].map(|k| cells(&world, &paths[k]));
        rest_is_whole(&mut world, &paths, &lost);
        assert_eq!(gpu.messages(), [""; 0]);
    });
}
