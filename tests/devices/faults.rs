//! What goes wrong while data is read, and what changes under it: the rest goes on, and nothing more than it must is read.

use super::SIZE;
use super::common::{self, LAVAPIPE, Setup};
use super::live::{Means, PLENTY, World, all_sections, tiles};
use super::scene::{self, BRIDGED};
use lasray::coords::SectionKey;
use lasray::render::camera::{Camera, Projection};
use lasray::source::LidarFile;
use lasray::stream::builds::{Cells, cells_of};
use lasray::stream::pool::Access;
use lasray::stream::residency::{Sight, touches};
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
    let all = all_sections(paths);
    let shown = world.live.shown().to_vec();
    let rest = |key: &SectionKey| !but.iter().any(|[low, high]| touches(*key, *low, *high));
    let rest: Vec<_> = shown.iter().filter(|(at, from)| at == from).map(|(at, _)| *at).filter(rest).collect();
    for key in &rest {
        let is = world.scene.read(*key).unwrap().unwrap().uploaded;
        assert_eq!(Some(&is), all.get(key), "{key:?}");
    }
    rest.len()
}

#[cfg(target_os = "linux")]
#[test]
fn a_disk_that_fails_costs_what_lies_on_it() {
    // It can be opened, but its end cannot be read.
    let failing = Setup { failing: Some(("d.las", 4_000_000)), ..LAVAPIPE };
    common::run("faults::a_disk_that_fails_costs_what_lies_on_it", failing, |setup| {
        assert!(!failing_disk::VARIABLES.is_empty());
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let paths = tiles(folder.path());
        let mut world = World::open(&gpu, &paths, PLENTY, Access::Address, BRIDGED());
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
    common::run("faults::a_file_cut_short_while_it_is_seen_costs_what_lies_in_it", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let paths = tiles(folder.path());
        let mut world = World::open(&gpu, &paths, PLENTY, Access::Address, BRIDGED());
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
    });
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
    common::run("faults::hiding_one_of_many_files_reads_only_its_neighbours", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let paths = many(folder.path());
        let mut world = World::open(&gpu, &paths, PLENTY, Access::Address, BRIDGED());
        let (_, sight) = above(&world, 0.3);
        world.complete(&sight);
        let hidden = 27;
        let its = cells(&world, &paths[hidden]);
        let touched: Vec<SectionKey> =
            world.live.wanted().iter().copied().filter(|key| touches(*key, its[0], its[1])).collect();
        let shares = |path: &PathBuf| {
            let [low, high] = cells(&world, path);
            // A cell more, as bounds of the header are taken.
            let [low, high] = [low.map(|c| c - 1), high.map(|c| c + 1)];
            touched.iter().any(|key| touches(*key, low, high))
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
            world.live.show_file(hidden, is_shown);
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
            world.check(&all_sections(&shown));
        }
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

#[test]
fn with_little_memory_there_is_less_detail_and_with_next_to_none_it_is_said() {
    let name = "faults::with_little_memory_there_is_less_detail_and_with_next_to_none_it_is_said";
    common::run(name, LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let paths = tiles(folder.path());
        let shares = |device_bytes| {
            let means = Means { device_bytes, ..PLENTY };
            let mut world = World::open(&gpu, &paths, means, Access::Address, BRIDGED());
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
