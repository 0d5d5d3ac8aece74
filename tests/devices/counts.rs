//! What is said of how many points there are of each class, against counts of the points themselves.

use super::changes::Seen;
use super::common::{self, LAVAPIPE};
use super::scene::{self, real_files};
use glam::DVec3;
use lasray::attribute::{Flags, KindCounts};
use lasray::render::camera::{Camera, Projection};
use lasray::section::Surface;
use lasray::source::learned::Cache;
use lasray::source::placement::Placement;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// A class that no point of the town has.
const RARE: u8 = 200;

fn counted(paths: &[&Path]) -> KindCounts {
    let mut of = BTreeMap::new();
    for point in paths.iter().flat_map(|path| scene::points(path, &Placement::default())) {
        *of.entry((point.class, Flags::of(point.flags))).or_default() += 1;
    }
    KindCounts { of, is_exact: true }
}

/// Twelve points of another class somewhere in a file of format 7 that is not compressed; of chunk `chunk`.
fn make_rare(path: &Path, chunk: usize) {
    let mut bytes = fs::read(path).unwrap();
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    let (start, record) = (word(96), usize::from(u16::from_le_bytes([bytes[105], bytes[106]])));
    for k in 0..12 {
        bytes[start + (50_000 * chunk + 31_000 + k) * record + 16] = RARE;
    }
    fs::write(path, bytes).unwrap();
}

/// The whole of them, from above.
fn above(all: DVec3, distance: f64) -> Camera {
    Camera::orbit(all, [0.0, 80.0], distance, Projection::default()).unwrap()
}

#[test]
fn classes_are_counted_as_they_are_read() {
    common::run("counts::classes_are_counted_as_they_are_read", LAVAPIPE, |setup| {
        let folder = tempfile::tempdir().unwrap();
        // More than the opening sample reads whole; the third comes later, the fourth stands in for the first.
        let town = |name: &str, west: f64, side: f64| scene::town(folder.path(), name, [west, -100.0], side);
        let [large, small] = [town("a.las", -200.0, 200.0), town("b.laz", 0.0, 60.0)];
        let third = town("c.las", 60.0, 50.0);
        make_rare(&large, 3);
        let middle = DVec3::new(511_900.0, 5_403_000.0, 200.0);
        let camera = above(middle, 900.0);
        let paths: Vec<PathBuf> = vec![large.clone(), small.clone()];
        let mut seen = Seen::open(setup.gpu(), Surface::Stacks, &paths, camera);
        let all = counted(&[&large, &small]);
        assert_eq!(all.of_class(RARE), 12);
        // Before all of it is read.
        let start = std::time::Instant::now();
        let first = loop {
            seen.tick();
            let status = seen.data.status();
            if !status.kinds.of.is_empty() {
                break status;
            }
            assert!(start.elapsed().as_secs() < 60);
        };
        if first.points_read < first.points {
            assert!(!first.kinds.is_exact, "{first:?}");
            let sum: u64 = first.kinds.of.values().sum();
            assert!(sum.abs_diff(first.points) * 100 < first.points, "{first:?}");
            let (is, about) = (all.of_class(2), first.kinds.of_class(2));
            assert!(about.abs_diff(is) * 3 < is, "ground: {about}, not {is}");
        }
        seen.until(|_| true);
        assert_eq!(seen.data.status().kinds, all);

        // Hidden, and shown again: what is read once more is not counted once more.
        seen.data.set_visible(0, false);
        seen.until(|_| true);
        assert_eq!(seen.data.status().kinds, counted(&[&small]));
        seen.data.set_visible(0, true);
        seen.until(|_| true);
        assert_eq!(seen.data.status().kinds, all);
        assert!(seen.data.status().bytes_read > fs::metadata(&large).unwrap().len(), "it was read again");

        seen.data.add(vec![third.clone().into()]);
        seen.until(|data| data.about().unwrap().files.len() == 3);
        assert_eq!(seen.data.status().kinds, counted(&[&large, &small, &third]));

        // Another file in the place of the first, then none.
        let other = scene::town(folder.path(), "other.las", [-200.0, -100.0], 70.0);
        fs::rename(&other, &large).unwrap();
        seen.until(|data| data.about().unwrap().files[0].points == 8 * 70 * 70);
        assert_eq!(seen.data.status().kinds, counted(&[&large, &small, &third]));
        fs::remove_file(&large).unwrap();
        seen.until(|data| data.about().unwrap().files[0].is_gone);
        let status = seen.data.status();
        assert_eq!(status.kinds, counted(&[&small, &third]));
        assert_eq!((status.files, status.points_read), ([2, 3], status.points));
        assert_eq!(seen.gpu.messages(), [""; 0]);
    });
}

#[test]
fn what_is_not_read_stays_an_estimate() {
    common::run("counts::what_is_not_read_stays_an_estimate", LAVAPIPE, |setup| {
        let folder = tempfile::tempdir().unwrap();
        let far = |k: i32| {
            let corner = [-1000.0 + 300.0 * f64::from(k), -100.0];
            scene::town(folder.path(), &format!("{k}.laz"), corner, 130.0)
        };
        let paths: Vec<_> = (0..3).map(far).collect();
        let place = DVec3::new(511_065.0, 5_402_965.0, 210.0);
        // Close over the first; how coarse the others are seen needs all of their points, unless they are out of sight.
        let camera = Camera::orbit(place, [0.0, 89.0], 40.0, Projection::default()).unwrap();
        let mut seen = Seen::open(setup.gpu(), Surface::Stacks, &paths, camera);
        seen.until(|_| true);
        let status = seen.data.status();
        println!("{} of {} points, {:?}", status.points_read, status.points, status.kinds);
        assert!(status.points_read < status.points && !status.kinds.is_exact, "{status:?}");
        let all = counted(&[&paths[0], &paths[1], &paths[2]]);
        let (is, about) = (all.of_class(2), status.kinds.of_class(2));
        assert!(about.abs_diff(is) * 4 < is, "ground: {about}, not {is}");
        // From afar all of it is needed, and known then.
        seen.camera = above(place + DVec3::X * 350.0, 1500.0);
        seen.until(|data| data.status().points_read == data.status().points);
        assert_eq!(seen.data.status().kinds, all);
        assert_eq!(seen.gpu.messages(), [""; 0]);
    });
}

#[test]
fn what_was_counted_is_known_when_it_is_opened_again() {
    common::run("counts::what_was_counted_is_known_when_it_is_opened_again", LAVAPIPE, |setup| {
        let folder = tempfile::tempdir().unwrap();
        let path = scene::town(folder.path(), "a.las", [-200.0, -100.0], 200.0);
        let cache = Cache::at(folder.path().join("cache"));
        let camera = above(DVec3::new(511_900.0, 5_403_000.0, 200.0), 900.0);
        let all = counted(&[&path]);
        let gpu = setup.gpu();
        let open = || {
            Seen::with(setup.gpu(), Surface::Stacks, std::slice::from_ref(&path), camera, Some(cache.clone()))
        };
        let at_first = |seen: &mut Seen| {
            while seen.data.status().kinds.of.is_empty() {
                seen.tick();
            }
            seen.data.status()
        };
        let mut seen = open();
        seen.until(|_| true);
        assert_eq!(seen.data.status().kinds, all);
        drop(seen);
        let mut again = open();
        let status = at_first(&mut again);
        assert_eq!(status.kinds, all, "{} of {} points are read", status.points_read, status.points);
        again.until(|_| true);
        let status = again.data.status();
        assert_eq!((status.kinds, status.points_read), (all.clone(), status.points));
        drop(again);
        // What is kept may be wrong: what is counted counts.
        let file = lasray::source::LidarFile::open(&path).unwrap();
        let wrong = all.of.iter().map(|(kind, n)| (*kind, n.div_ceil(2))).collect();
        let unknown = vec![None; file.chunks.len()];
        cache.save_all(&file, &unknown, &wrong).unwrap();
        let mut seen = open();
        assert_eq!(at_first(&mut seen).kinds.of, wrong);
        seen.until(|_| true);
        assert_eq!(seen.data.status().kinds, all);
        drop(seen);
        assert_eq!(cache.load_all(&file).1, all.of, "and is kept");
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

#[test]
fn classes_of_real_files_are_as_a_scan_counts_them() {
    let Some(folder) = real_files() else { return };
    common::run("counts::classes_of_real_files_are_as_a_scan_counts_them", LAVAPIPE, |setup| {
        for (name, class) in [("powerline/12BZ1_21.laz", 15), ("autzen/autzen_trim.las", 2)] {
            let path = folder.join(name);
            let about = lasray::sample::open_all(std::slice::from_ref(&path)).pop().unwrap().unwrap();
            let header = &about.file.header;
            let middle = (header.min + header.max) / 2.0;
            let mut seen =
                Seen::open(setup.gpu(), Surface::Stacks, std::slice::from_ref(&path), above(middle, 2000.0));
            seen.until(|data| data.status().points_read == data.status().points);
            let (is, all) = (seen.data.status().kinds, counted(&[&path]));
            println!("{name}: {is:?}");
            assert_eq!(is, all, "{name}");
            assert!(is.of_class(class) > 0, "{name}: class {class}");
            assert_eq!(seen.gpu.messages(), [""; 0]);
        }
    });
}
