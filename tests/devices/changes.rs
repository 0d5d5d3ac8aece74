//! Files that change, vanish and come back while they are seen.

use super::SIZE;
use super::common::{self, LAVAPIPE};
use super::live::{self, PLENTY, World, tiles};
use super::scene::{self, BRIDGED};
use lasray::attribute::{Channel, ColorMode, ColorTable};
use lasray::gpu::Gpu;
use lasray::limits::LIMITS;
use lasray::load;
use lasray::problems::Problems;
use lasray::render::camera::{Camera, Projection};
use lasray::render::frame::{Renderer, View};
use lasray::render::image::{Image, MISS_CLASS};
use lasray::section::Surface;
use lasray::source::learned::Cache;
use lasray::source::placement::{Placement, PlacementOptions, Treatment};
use lasray::source::{LidarFile, Reading, Returns, Selection};
use lasray::view;
use std::fs;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A window's data, without a window.
pub(super) struct Seen {
    pub gpu: Gpu,
    pub data: view::data::Data,
    pub camera: Camera,
}

impl Seen {
    pub fn open(gpu: Gpu, surface: Surface, paths: &[PathBuf], camera: Camera) -> Seen {
        Seen::with(gpu, surface, paths, camera, None)
    }

    /// Knowing what is kept there.
    pub fn with(gpu: Gpu, surface: Surface, paths: &[PathBuf], camera: Camera, cache: Option<Cache>) -> Seen {
        Seen::reading(gpu, surface, paths, camera, cache, (Selection::default(), None))
    }

    /// Of points that take part, for pictures in a colour.
    fn reading(
        gpu: Gpu,
        surface: Surface,
        paths: &[PathBuf],
        camera: Camera,
        cache: Option<Cache>,
        (selection, color): (Selection, Option<ColorMode>),
    ) -> Seen {
        let options = view::data::ReadOptions {
            surface,
            cell: Some(0.25.into()),
            placement: PlacementOptions::default(),
            rgb_bits: None,
            host_bytes: 1 << 30,
            device_bytes: 1 << 28,
            visibility: BRIDGED(),
            selection,
            color,
            cache,
        };
        let inputs = paths.iter().map(|path| path.clone().into_os_string()).collect();
        let data = view::data::Data::open(&gpu, inputs, &[], options, || ()).unwrap();
        Seen { gpu, data, camera }
    }

    /// One frame's worth.
    pub fn tick(&mut self) {
        self.data.tick(&self.gpu, &self.camera, SIZE, 1.0, true, LIMITS.frame_bytes).unwrap();
    }

    /// Until `done`, and complete.
    pub fn until(&mut self, done: impl Fn(&view::data::Data) -> bool) {
        let start = Instant::now();
        loop {
            self.tick();
            if self.data.is_complete() && self.data.about().is_some() && done(&self.data) {
                return;
            }
            assert!(start.elapsed() < Duration::from_secs(60), "it never ends: {:?}", self.data.status());
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    fn says(&self, words: &str) -> bool {
        self.data.status().messages.iter().any(|line| line.contains(words))
    }

    fn picture(&mut self) -> Image {
        let about = self.data.about().unwrap();
        let (grid, anchor) = self.data.grid();
        let data = scene::Data {
            sections: Vec::new(),
            grid,
            bounds: about.bounds,
            low: Arc::clone(&about.outline.low),
            anchor,
            colors: ColorTable::new(ColorMode::Class, &about.summary, &grid, None, None).unwrap(),
            summary: about.summary.clone(),
            placement: Placement::default(),
        };
        let mut renderer = Renderer::new(self.data.scene(), grid, anchor).unwrap();
        let table = self.data.table(&mut renderer);
        // What lit images end in rests on what was opened first.
        let view = View { slab: None, ..data.lit(&self.camera, SIZE) };
        renderer.draw_table(self.data.scene_mut(), &view, &table).unwrap()
    }
}

#[test]
fn files_that_change_are_seen_as_they_are() {
    live::run("changes::files_that_change_are_seen_as_they_are", LAVAPIPE, |setup, surface| {
        let folder = tempfile::tempdir().unwrap();
        let mut paths = tiles(folder.path());
        paths.extend((0..2).map(|k| {
            scene::town(folder.path(), &format!("far{k}.las"), [160.0 + 100.0 * f64::from(k), -160.0], 100.0)
        }));
        let all = super::town().bounds;
        let camera = Camera::orbit(all.center(), [20.0, 50.0], 500.0, Projection::default()).unwrap();
        let mut seen = Seen::open(setup.gpu(), surface, &paths, camera);
        seen.until(|_| true);
        let whole = seen.picture();
        // In the place of the first, less; the second is gone.
        let less = scene::town(folder.path(), "less.las", [-160.0, -160.0], 90.0);
        fs::rename(&less, &paths[0]).unwrap();
        let kept = fs::read(&paths[1]).unwrap();
        fs::remove_file(&paths[1]).unwrap();
        seen.until(|data| {
            let about = data.about().unwrap();
            about.files[1].is_gone && data.status().messages.iter().any(|line| line.contains("read anew"))
        });
        assert!(seen.says("a.las: has changed, and was read anew") && seen.says("b.laz: is gone"));
        let changed = seen.picture();
        assert!(changed != whole);
        let others = [&paths[..1], &paths[2..]].concat();
        let mut fresh = Seen::open(setup.gpu(), surface, &others, camera);
        fresh.until(|_| true);
        assert_eq!(scene::pixels_that_differ(&changed, &fresh.picture()), 0);
        // And back again.
        fs::write(&paths[1], kept).unwrap();
        scene::town(folder.path(), "a.las", [-160.0, -160.0], 160.0);
        let started = Instant::now();
        seen.until(|data| {
            let about = data.about().unwrap();
            !about.files[1].is_gone && about.files[0].points == 8 * 160 * 160
        });
        println!("back again after {:?}", started.elapsed());
        assert_eq!(scene::pixels_that_differ(&seen.picture(), &whole), 0);
        let status = seen.data.status();
        assert_eq!((status.points_read, status.frames_waited), (status.points, 0));
        assert_eq!(seen.gpu.messages(), [""; 0]);
    });
}

#[test]
fn a_file_may_change_while_it_is_being_read() {
    live::run("changes::a_file_may_change_while_it_is_being_read", LAVAPIPE, |setup, surface| {
        let folder = tempfile::tempdir().unwrap();
        let town = |name: &str, west: f64, side: f64| scene::town(folder.path(), name, [west, -60.0], side);
        let paths = [town("a.las", -120.0, 60.0), town("b.las", 0.0, 60.0), town("c.laz", 60.0, 100.0)];
        let open =
            |paths: &[PathBuf]| load::open(paths, &live::options(surface), &mut Problems::default()).unwrap();
        let gpu = setup.gpu();
        let mut world = World::of(&gpu, surface, open(&paths[..2]), PLENTY, BRIDGED());
        let camera =
            Camera::orbit(world.bounds.center(), [20.0, 50.0], 300.0, Projection::default()).unwrap();
        let sight = world.sight(&camera, 1.0);
        world.live.pause(true);
        world.live.tick(&mut world.scene, &sight, 2 << 20).unwrap();
        // All that is wanted of the first is begun now. In its place comes one that lies elsewhere, and has more chunks.
        let core = open(&paths).core;
        let other = open(&paths[2..]).inputs.pop().unwrap();
        world.live.replace_files(vec![(0, other)], core);
        world.live.pause(false);
        let status = world.complete(&sight);
        let chunks = [&paths[1], &paths[2]].map(|path| LidarFile::open(path).unwrap().chunks.len() as u64);
        assert_eq!((status.progress.lacking, status.progress.chunks), (0, chunks[0] + chunks[1]));
        assert_eq!((status.progress.chunks_known, status.damaged), (status.progress.chunks, 0));
        assert_eq!(world.live.take_errors(), [""; 0]);
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

/// The same file with other bytes, as often as they are found.
fn with(path: &PathBuf, name: &str, old: &[u8], new: &[u8]) -> PathBuf {
    let mut bytes = fs::read(path).unwrap();
    let places: Vec<_> = (0..bytes.len()).filter(|&at| bytes[at..].starts_with(old)).collect();
    assert!(!places.is_empty());
    places.into_iter().for_each(|at| bytes[at..at + new.len()].copy_from_slice(new));
    let path = path.with_file_name(name);
    fs::write(&path, bytes).unwrap();
    path
}

#[test]
fn files_that_are_dropped_come_to_those_that_are_there() {
    live::run("changes::files_that_are_dropped_come_to_those_that_are_there", LAVAPIPE, |setup, surface| {
        let folder = tempfile::tempdir().unwrap();
        let town = |name: &str, west: f64| scene::town(folder.path(), name, [west, -60.0], 60.0);
        let (first, second, third) = (town("a.las", -60.0), town("b.las", 0.0), town("c.las", 60.0));
        // No coordinate system: none of its records is of any kind that is known.
        let unnamed = with(&second, "unnamed.las", b"LASF_Projection", b"OASF_Projection");
        // Another ellipsoid: neither are its coordinates the others', nor is there a way to them.
        let other = with(&third, "other.las", b"6378137", b"6377397");
        let all = super::town().bounds;
        let camera = Camera::orbit(all.center(), [20.0, 50.0], 300.0, Projection::default()).unwrap();
        let mut together =
            Seen::open(setup.gpu(), surface, &[first.clone(), unnamed.clone(), third.clone()], camera);
        together.until(|_| true);

        // One is dropped before the first is open, one later.
        let mut seen = Seen::open(setup.gpu(), surface, std::slice::from_ref(&first), camera);
        seen.data.add(vec![unnamed.clone().into()]);
        seen.until(|data| data.about().unwrap().files.len() == 2);
        let [said] = &seen.data.take_notices()[..] else { panic!("once, and of the one that was dropped") };
        assert!(said.starts_with("unnamed.las: names no coordinate system, and is taken to be in"), "{said}");
        let treatments = seen.data.about().unwrap().files.iter().map(|file| file.treatment.clone());
        let [Treatment::Placed, Treatment::Assumed { .. }] = treatments.collect::<Vec<_>>()[..] else {
            panic!("what was done with each")
        };
        seen.data.add(vec![third.clone().into()]);
        seen.until(|data| data.about().unwrap().files.len() == 3);
        let picture = seen.picture();
        assert_eq!(scene::pixels_that_differ(&picture, &together.picture()), 0);

        // What does not fit is named, and nothing else happens.
        seen.data.take_notices();
        seen.data.add(vec![other.into(), first.clone().into()]);
        seen.until(|data| data.status().messages.iter().any(|line| line.contains("not added")));
        assert!(seen.says("other.las: left out: its coordinate system is"), "{:?}", seen.data.status());
        let [said] = &seen.data.take_notices()[..] else { panic!("once") };
        assert!(said.starts_with("other.las: left out: its coordinate system is"), "{said}");
        seen.data.add(vec![unnamed.into()]);
        seen.until(|data| data.status().messages.iter().any(|line| line.contains("open already")));
        seen.data.add(vec![folder.path().join("nowhere.las").into()]);
        seen.until(|data| data.status().messages.iter().any(|line| line.contains("nowhere.las: not added")));
        assert_eq!((seen.data.about().unwrap().files.len(), seen.data.shown_inputs(false).len()), (3, 3));
        assert_eq!(scene::pixels_that_differ(&seen.picture(), &picture), 0);
        // They stay in the list of those that are not shown.
        let refused: Vec<_> = seen.data.refused().iter().map(|of| (of.short_name(), of.badge)).collect();
        assert_eq!(refused, [("other.las", "left out"), ("nowhere.las", "failed")]);

        // What is hidden or removed is neither framed nor named to others; what is removed can be opened again.
        let whole = seen.data.about().unwrap().shown_hull(true).bounds();
        seen.data.set_visible(2, false);
        let part = seen.data.about().unwrap().shown_hull(true).bounds();
        assert!(
            part.max.x < whole.max.x - 50.0 && (part.min.x - whole.min.x).abs() < 1.0,
            "{part:?} of {whole:?}"
        );
        assert_eq!(seen.data.hidden_files().collect::<Vec<_>>(), [&*third]);
        seen.data.remove(0);
        let rest = seen.data.about().unwrap().shown_hull(true).bounds();
        assert!(rest.min.x > whole.min.x + 50.0, "{rest:?} of {whole:?}");
        assert_eq!(seen.data.shown_inputs(false).len(), 1);
        seen.until(|_| true);
        seen.data.set_visible(2, true);
        seen.data.add(vec![first.into()]);
        seen.until(|data| data.about().unwrap().files.len() == 4);
        assert_eq!(scene::pixels_that_differ(&seen.picture(), &picture), 0, "all is back");
        assert_eq!(seen.data.shown_inputs(false).len(), 3);
        assert_eq!(seen.gpu.messages(), [""; 0]);
    });
}

/// Selections and channels that change again and again while points arrive: what is seen in the end is what was asked for
/// last, as if nothing else had been; until then there is something to see.
#[test]
fn what_is_read_last_is_what_is_seen() {
    common::run("changes::what_is_read_last_is_what_is_seen", LAVAPIPE, |setup| {
        let folder = tempfile::tempdir().unwrap();
        let paths = tiles(folder.path());
        let all = super::town().bounds;
        let camera = Camera::orbit(all.center(), [20.0, 50.0], 500.0, Projection::default()).unwrap();
        let returns = |returns| Selection { returns, ..Selection::default() };
        let high = Selection { heights: "230..".parse().unwrap(), ..Selection::default() };
        let one_line = Selection { source_ids: "1".parse().unwrap(), ..Selection::default() };
        let hits = |image: &Image| image.class.iter().filter(|class| **class != MISS_CLASS).count();
        let mut gpu = setup.gpu();
        for last in [returns(Returns::First), returns(Returns::Last), one_line.clone()] {
            let mut seen = Seen::open(gpu, Surface::Stacks, &paths, camera);
            while seen.data.about().is_none() {
                seen.tick();
            }
            let selections = [returns(Returns::Last), high.clone(), Selection::default(), one_line.clone()];
            for (k, selection) in selections.into_iter().chain([last.clone()]).enumerate() {
                for _ in 0..3 * k {
                    seen.tick();
                    std::thread::sleep(Duration::from_millis(1));
                }
                let channel = if k % 2 == 0 { Channel::ScanAngle } else { Channel::SourceId };
                seen.data.set_reading(Reading { selection, channel });
                assert!(seen.data.status().rereading.is_some() && !seen.data.is_complete());
            }
            seen.until(|_| true);
            assert_eq!(seen.data.status().rereading, None);
            let picture = seen.picture();
            let asked = (last.clone(), Some(ColorMode::ScanAngle));
            let mut fresh = Seen::reading(seen.gpu.clone(), Surface::Stacks, &paths, camera, None, asked);
            fresh.until(|_| true);
            assert_eq!(scene::pixels_that_differ(&picture, &fresh.picture()), 0, "{}", last.words());
            let counts = [&seen, &fresh].map(|seen| seen.data.status().kinds);
            assert!(counts[0].is_exact && counts[0] == counts[1], "{}: {counts:?}", last.words());

            // All of it again: the old versions stay until the new ones are there, and every chunk is read once.
            let before = seen.data.status();
            let everything = Reading { channel: Channel::ScanAngle, ..Reading::default() };
            seen.data.set_reading(everything);
            while !seen.data.is_complete() {
                assert!(hits(&seen.picture()) > hits(&picture) / 2);
                seen.tick();
            }
            let after = seen.data.status();
            let of_files: u64 = paths.iter().map(|path| fs::metadata(path).unwrap().len()).sum();
            assert!(after.bytes_read - before.bytes_read <= of_files, "{before:?} {after:?}");
            assert!(hits(&seen.picture()) >= hits(&picture));
            let points = |status: &view::data::DataStatus| status.kinds.of.values().sum::<u64>();
            assert!(after.kinds.is_exact && points(&after) > points(&before), "{}", last.words());
            // What is highest in its cell is a first return.
            let is_first = last.returns == Returns::First;
            assert!(is_first || scene::pixels_that_differ(&seen.picture(), &picture) > 0, "{}", last.words());
            gpu = seen.gpu.clone();
        }
        assert_eq!(gpu.messages(), [""; 0]);
    });
}
