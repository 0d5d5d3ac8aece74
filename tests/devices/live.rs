//! Live residency: what cameras see is made of everything that touches it, whatever came first and however little
//! memory there is; files that are hidden, gone or broken change what they touch and nothing else.

use super::common::{self, LAVAPIPE, ORDERS, SWIFTSHADER, Setup};
use super::scene::{self, BRIDGED, MEASURED};
use super::{SIZE, cameras};
use glam::DVec3;
use lasray::attribute::{AttributeSummary, ClassMask, ColorTable};
use lasray::coords::{Bounds, Grid, LowSurface, SectionKey};
use lasray::gpu::Gpu;
use lasray::ingest::bins::Budget;
use lasray::ingest::builds::Made;
use lasray::load::{self, LoadOptions, Opening};
use lasray::problems::Problems;
use lasray::render::camera::{Camera, Projection};
use lasray::render::frame::{Renderer, View};
use lasray::render::image::Image;
use lasray::render::sight::sight;
use lasray::resident::cut::{Shown, Sight};
use lasray::resident::live::{Live, Status};
use lasray::resident::pool::Access;
use lasray::resident::scene::Scene;
use lasray::resident::visibility::Visibility;
use lasray::section::{Columns, PayloadKey, Surface};
use lasray::source::placement::{Placement, PlacementOptions};
use std::collections::{HashMap, HashSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

const CELL: f64 = 0.25;

/// As nearly all that streams is seen, and as what it is compared with was made first.
pub(super) const SURFACES: [Surface; 2] = [Surface::Stacks, Surface::Columns];

/// Four tiles of the town, compressed and not.
pub(super) fn tiles(folder: &Path) -> Vec<PathBuf> {
    let tile = |k: i32| {
        let corner = [-160.0 + 160.0 * f64::from(k % 2), -160.0 + 160.0 * f64::from(k / 2)];
        scene::town(folder, ["a.las", "b.laz", "c.laz", "d.las"][k as usize], corner, 160.0)
    };
    (0..4).map(tile).collect()
}

pub(super) fn options(surface: Surface) -> LoadOptions {
    LoadOptions {
        surface,
        cell: Some(CELL.into()),
        placement: PlacementOptions::default(),
        rgb_bits: None,
        asked: lasray::sample::Asked::default(),
        budget: Budget { host_bytes: 1 << 31, device_bytes: 1 << 31 },
        cache: None,
        quiet: true,
    }
}

/// Every section of every level, words as they are uploaded, from all points of `paths`.
pub(super) fn all_sections(surface: Surface, paths: &[PathBuf]) -> HashMap<SectionKey, Vec<u32>> {
    let loaded = load::paths(paths, &options(surface), &mut Problems::default()).unwrap();
    let mut words = HashMap::new();
    let mut level: HashMap<SectionKey, Columns> = loaded.sections.into_iter().collect();
    for above_level in 1..=6 {
        let fresh = || Columns::new(surface, loaded.grid.stacking(above_level));
        let mut above = HashMap::<SectionKey, Columns>::new();
        for (key, columns) in level {
            columns.coarsen_into(key.i, key.j, above.entry(key.parent()).or_insert_with(fresh));
            words.insert(key, columns.pack().words);
        }
        level = above;
    }
    words
}

/// Runs `body` in `setup` with stacks, and again with columns; it opens a device of its own each time.
pub(super) fn run(test: &str, setup: Setup, body: impl Fn(Setup, Surface)) {
    run_with(test, setup, &SURFACES, body);
}

/// The same with other surfaces.
pub(super) fn run_with(test: &str, setup: Setup, surfaces: &[Surface], body: impl Fn(Setup, Surface)) {
    common::run(test, setup, |setup| surfaces.iter().for_each(|&surface| body(setup, surface)));
}

/// What is live of some files.
pub(super) struct World {
    pub live: Live,
    pub scene: Scene,
    pub surface: Surface,
    pub grid: Grid,
    pub bounds: Bounds,
    pub placement: Placement,
    colors: ColorTable,
    summary: AttributeSummary,
}

/// Memory, the way into it, and threads.
#[derive(Clone, Copy)]
pub(super) struct Means {
    pub host_bytes: u64,
    pub device_bytes: u64,
    pub threads: usize,
    pub access: Access,
}

pub(super) const PLENTY: Means =
    Means { host_bytes: 1 << 30, device_bytes: 1 << 30, threads: 2, access: Access::Address };
/// The same, bound as a buffer: what validation sees.
const BOUND: Means = Means { access: Access::StorageBuffer, ..PLENTY };

impl World {
    pub fn open(
        gpu: &Gpu,
        surface: Surface,
        paths: &[PathBuf],
        means: Means,
        visibility: Visibility,
    ) -> World {
        World::with_cell(gpu, surface, paths, CELL, means, visibility)
    }

    /// `cell`: side of a finest one.
    pub fn with_cell(
        gpu: &Gpu,
        surface: Surface,
        paths: &[PathBuf],
        cell: f64,
        means: Means,
        visibility: Visibility,
    ) -> World {
        let options = LoadOptions { cell: Some(cell.into()), ..options(surface) };
        let opening = load::open(paths, &options, &mut Problems::default()).unwrap();
        World::of(gpu, surface, opening, means, visibility)
    }

    pub fn of(gpu: &Gpu, surface: Surface, opening: Opening, means: Means, visibility: Visibility) -> World {
        let Opening { inputs, grid, core, about, reading } = opening;
        let Means { host_bytes, device_bytes, threads, access } = means;
        let placement = inputs[0].input.placement.clone();
        let made = Made { surface, reading };
        World {
            live: Live::new(inputs, made, grid, core, host_bytes, threads, || ()),
            scene: Scene::new(gpu, |order| order, access, device_bytes, visibility, grid).unwrap(),
            surface,
            grid,
            bounds: about.bounds,
            placement,
            colors: ColorTable::new(about.color, &about.summary, &grid, None, None).unwrap(),
            summary: about.summary,
        }
    }

    pub fn sight(&self, camera: &Camera, detail: f64) -> Sight {
        sight(camera, SIZE, [1.0, 0.0], self.bounds.min.z - 10.0, detail).unwrap()
    }

    /// Until all is there that `sight` wants.
    pub fn complete(&mut self, sight: &Sight) -> Status {
        let start = Instant::now();
        loop {
            let tick = self.live.tick(&mut self.scene, sight, 2 << 20).unwrap();
            assert!(!tick.stuck, "the sections do not fit");
            if tick.complete {
                return self.live.status(&self.scene);
            }
            let status = self.live.status(&self.scene);
            assert!(start.elapsed() < Duration::from_secs(60), "it never ends: {status:?}");
            self.live.wait(Duration::from_millis(1));
        }
    }

    /// What is shown is what all points make of it.
    pub fn check(&mut self, all: &HashMap<SectionKey, Vec<u32>>) {
        let shown = self.live.shown().to_vec();
        let own = |(at, from): &&Shown| PayloadKey::columns(*at) == *from;
        for (key, _) in shown.iter().filter(own) {
            let is = self.scene.read_back(*key).unwrap().unwrap().uploaded;
            assert_eq!(Some(&is), all.get(key), "{key:?}");
        }
        // Others stand in only for what is not seen.
        let wanted: Vec<_> = self.live.wanted().collect();
        assert!(shown.iter().filter(own).count() > 0);
        for (at, from) in shown.iter().filter(|(at, from)| PayloadKey::columns(*at) != *from) {
            let seen = |key: &&SectionKey| {
                std::iter::successors(Some(**key), |key| Some(key.parent())).take(8).any(|k| k == *at)
            };
            assert!(wanted.iter().find(seen).is_none(), "{at:?} shows {from:?}");
        }
    }

    /// What pictures of it are drawn with.
    fn data(&self) -> scene::Data {
        scene::Data {
            sections: Vec::new(),
            grid: self.grid,
            bounds: self.bounds,
            low: Arc::new(LowSurface::of(&self.bounds, &[])),
            anchor: self.grid.height(self.bounds.center().z).unwrap(),
            colors: self.colors.clone(),
            summary: self.summary.clone(),
            placement: Placement::default(),
        }
    }

    pub fn picture(&mut self, camera: &Camera) -> Image {
        let data = self.data();
        let mut renderer = Renderer::new(&self.scene, self.grid, data.anchor).unwrap();
        let table = renderer.table_of(&self.scene, self.live.shown());
        let view = if self.scene.visibility().bridge == 0 {
            data.exact(camera, SIZE)
        } else {
            data.lit(camera, SIZE)
        };
        renderer.draw_table(&mut self.scene, &view, &table).unwrap()
    }

    /// To draw frame upon frame of `camera`.
    pub fn frames(&self, camera: &Camera, size: [u32; 2]) -> Frames {
        let data = self.data();
        let renderer = Renderer::new(&self.scene, self.grid, data.anchor).unwrap();
        Frames { data, renderer, camera: *camera, size }
    }
}

/// Draws frames as a window does, one sample each.
pub(super) struct Frames {
    data: scene::Data,
    renderer: Renderer,
    camera: Camera,
    size: [u32; 2],
}

impl Frames {
    /// Draws what is there, and waits for it.
    pub fn draw(&mut self, world: &mut World) {
        let table = self.renderer.table_of_live(&world.scene, &world.live);
        let view = View { samples: 1, ..self.data.lit(&self.camera, self.size) };
        let point = self.renderer.submit_frame(&mut world.scene, &view, &table, None).unwrap();
        world.scene.order.wait(point).unwrap();
    }
}

#[test]
fn what_is_seen_is_made_of_all_points() {
    for setup in [&ORDERS[..], &[LAVAPIPE, SWIFTSHADER]].concat() {
        let surfaces: &[Surface] = match setup {
            LAVAPIPE => &[Surface::Stacks, Surface::Smooth, Surface::Columns],
            _ => &[Surface::Stacks],
        };
        run_with("live::what_is_seen_is_made_of_all_points", setup, surfaces, |setup, surface| {
            let gpu = setup.gpu();
            let folder = tempfile::tempdir().unwrap();
            let paths = tiles(folder.path());
            let all = all_sections(surface, &paths);
            let mut world = World::open(&gpu, surface, &paths, BOUND, BRIDGED());
            let mut levels = [0; 8];
            for camera in cameras(&super::town().bounds) {
                for detail in [1.0, 0.3] {
                    let sight = world.sight(&camera, detail);
                    let status = world.complete(&sight);
                    assert_eq!((status.coarser, status.damaged), (1.0, 0));
                    world.live.shown().iter().for_each(|(at, _)| levels[usize::from(at.level)] += 1);
                    world.check(&all);
                    world.picture(&camera);
                }
            }
            assert!(levels[0] > 0 && levels[1] > 0, "{levels:?}");
            assert_eq!(world.scene.counters().waits, 0);
            assert_eq!(gpu.messages(), [""; 0]);
        });
    }
}

/// The same to the last bit with little memory, one thread, files in another order.
#[test]
fn pictures_do_not_depend_on_means() {
    run("live::pictures_do_not_depend_on_means", LAVAPIPE, |setup, surface| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let mut paths = tiles(folder.path());
        let cameras = cameras(&super::town().bounds);
        let pictures = |paths: &[PathBuf], means| -> Vec<Image> {
            let mut world = World::open(&gpu, surface, paths, means, BRIDGED());
            let picture = |camera: &Camera| {
                let sight = world.sight(camera, 1.0);
                assert_eq!(world.complete(&sight).coarser, 1.0);
                world.picture(camera)
            };
            cameras.iter().map(picture).collect()
        };
        let usual = pictures(&paths, PLENTY);
        paths.reverse();
        let little = Means { host_bytes: 4 << 20, device_bytes: 192 << 20, threads: 1, ..PLENTY };
        for (k, (a, b)) in usual.iter().zip(pictures(&paths, little)).enumerate() {
            assert!(a.distance.iter().any(|d| d.is_finite()), "picture {k} shows nothing");
            assert_eq!((&a.color, &a.distance, &a.class), (&b.color, &b.distance, &b.class), "picture {k}");
        }
    });
}

/// Holes are bridged across borders, with what is seen and with nothing else.
#[test]
fn pictures_do_not_depend_on_what_was_seen_before() {
    run("live::pictures_do_not_depend_on_what_was_seen_before", LAVAPIPE, |setup, surface| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let paths = tiles(folder.path());
        let open = || World::with_cell(&gpu, surface, &paths, 0.1, PLENTY, BRIDGED());
        let picture = |world: &mut World, camera: &Camera, alone: bool| {
            let sight = world.sight(camera, 1.0);
            world.complete(&sight);
            if alone {
                world.live.evict_unseen(&mut world.scene).unwrap();
            }
            world.picture(camera)
        };
        let cameras = cameras(&super::town().bounds);
        let (mut after_others, mut left) = (open(), 0);
        for camera in cameras.iter().chain(cameras.iter().rev()) {
            let fresh = picture(&mut open(), camera, false);
            left += usize::from(picture(&mut after_others, camera, false).color != fresh.color);
            assert!(picture(&mut after_others, camera, true).color == fresh.color);
        }
        println!("{left} of {} pictures would depend on it", 2 * cameras.len());
        assert!(left > 0, "the test shows nothing");
    });
}

/// At the finest level everywhere the pictures are those of everything in memory.
#[test]
fn finest_cells_give_the_picture_of_everything() {
    run("live::finest_cells_give_the_picture_of_everything", LAVAPIPE, |setup, surface| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let paths = tiles(folder.path());
        let data = scene::Data::load_with(&paths, Some(CELL), |options| LoadOptions { surface, ..options });
        let mut whole = data.scene(&gpu, Access::Address, MEASURED());
        let mut renderer = data.renderer(&whole);
        let mut world = World::open(&gpu, surface, &paths, PLENTY, MEASURED());
        for camera in cameras(&super::town().bounds) {
            let sight = world.sight(&camera, 0.0);
            world.complete(&sight);
            let (a, b) =
                (world.picture(&camera), renderer.draw(&mut whole, &data.exact(&camera, SIZE)).unwrap());
            // Sides of columns that are not seen from above the floor may differ: there is no floor here.
            let differ = a.class.iter().zip(&b.class).filter(|(a, b)| a != b).count();
            assert!(differ * 1000 <= a.class.len(), "{differ} pixels differ");
        }
    });
}

#[test]
fn hidden_files_are_taken_out_and_come_back() {
    run("live::hidden_files_are_taken_out_and_come_back", LAVAPIPE, |setup, surface| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let paths = tiles(folder.path());
        let (all, without) = (all_sections(surface, &paths), all_sections(surface, &paths[1..]));
        let mut world = World::open(&gpu, surface, &paths, PLENTY, BRIDGED());
        let above = Camera::frame(&world.bounds, [0.0, 90.0], Projection::default(), SIZE).unwrap();
        let sight = world.sight(&above, 0.3);
        let sections = |world: &World| world.scene.counters().sections;
        world.complete(&sight);
        world.check(&all);
        let before = world.picture(&above);
        let (made, shown) = (sections(&world), world.live.shown().len());

        world.live.set_file_visible(0, false);
        world.complete(&sight);
        world.check(&without);
        // Only what the tile touches, and the sparse sample, were made anew.
        let anew = (sections(&world) - made) as usize;
        assert!(anew > 0 && anew < shown * 3 / 4 + 5, "{anew} of {shown}");
        let hidden = world.picture(&above);
        assert!(hidden.class.iter().zip(&before.class).filter(|(a, b)| a != b).count() > 500);

        world.live.set_file_visible(0, true);
        world.complete(&sight);
        world.check(&all);
        assert_eq!(world.picture(&above).color, before.color);
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

#[test]
fn files_that_fail_are_named_once_and_the_rest_goes_on() {
    run("live::files_that_fail_are_named_once_and_the_rest_goes_on", LAVAPIPE, |setup, surface| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let paths = tiles(folder.path());
        let without = all_sections(surface, &paths[1..]);
        // Gone after it was opened, before anyone reads it for good: threads do so from the start.
        let opening = load::open(&paths, &options(surface), &mut Problems::default()).unwrap();
        fs::remove_file(&paths[0]).unwrap();
        let mut world = World::of(&gpu, surface, opening, PLENTY, BRIDGED());
        let above = Camera::frame(&world.bounds, [0.0, 90.0], Projection::default(), SIZE).unwrap();
        let sight = world.sight(&above, 0.3);
        let status = world.complete(&sight);
        world.check(&without);
        assert!(status.damaged > 0);
        let errors = world.live.take_errors();
        assert_eq!(errors.len(), 1, "{errors:?}");
        assert!(errors[0].contains("a.las"), "{errors:?}");

        // Broken in the middle: what is before and behind it stays.
        let mut bytes = fs::read(&paths[1]).unwrap();
        let opening = load::open(&paths[1..], &options(surface), &mut Problems::default()).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle..middle + 4000].fill(0xFF);
        let modified = fs::metadata(&paths[1]).unwrap().modified().unwrap();
        fs::write(&paths[1], bytes).unwrap();
        fs::File::options().write(true).open(&paths[1]).unwrap().set_modified(modified).unwrap();
        let mut world = World::of(&gpu, surface, opening, PLENTY, BRIDGED());
        world.complete(&sight);
        world.live.take_errors().iter().for_each(|error| assert!(error.contains("b.laz"), "{error}"));
        assert!(world.picture(&above).distance.iter().filter(|d| d.is_finite()).count() > 1000);
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

/// Memory of this process, where the system tells.
fn resident_bytes() -> Option<u64> {
    let text = fs::read_to_string("/proc/self/statm").ok()?;
    Some(text.split(' ').nth(1)?.parse::<u64>().ok()? * 4096)
}

/// Jumps before memory is looked at: the allocator has its share by then.
const FIRST_JUMPS: u32 = 200;

/// Jumps over all of the data, never waiting, in a pool that holds a part of it. LASRAY_JUMPS: more than every day.
#[test]
fn jumps_neither_leak_nor_wait() {
    let surfaces = [Surface::Stacks, Surface::Smooth, Surface::Columns];
    run_with("live::jumps_neither_leak_nor_wait", ORDERS[1], &surfaces, |setup, surface| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let paths = tiles(folder.path());
        let means = Means { host_bytes: 24 << 20, device_bytes: 24 << 20, ..BOUND };
        let mut world = World::open(&gpu, surface, &paths, means, BRIDGED());
        let random = AtomicU64::new(7);
        let next = |below: f64| {
            let state =
                random.load(Ordering::Relaxed).wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            random.store(state, Ordering::Relaxed);
            (state >> 33) as f64 / (1u64 << 31) as f64 * below
        };
        let size = world.bounds.max - world.bounds.min;
        let jumps = std::env::var("LASRAY_JUMPS").map_or(300, |n| n.parse().expect("a number of jumps"));
        let above = Camera::frame(&world.bounds, [0.0, 90.0], Projection::default(), SIZE).unwrap();
        let above = world.sight(&above, 1.0);
        // What is left when nothing but that is kept.
        let rest = |world: &mut World| {
            world.complete(&above);
            let wanted: HashSet<SectionKey> = world.live.wanted().collect();
            let gone: Vec<_> = world.scene.resident().filter(|key| !wanted.contains(&key.section)).collect();
            world.scene.evict(&gone).unwrap();
            let bytes: u64 = wanted.iter().map(|&key| world.scene.bytes_of(key)).sum();
            (world.scene.resident().count(), bytes, world.scene.pool().held_bytes(), resident_bytes())
        };
        let mut first = None;
        for jump in 0..FIRST_JUMPS + jumps {
            if jump == FIRST_JUMPS + jumps / 5 {
                first = Some(rest(&mut world));
            }
            let eye = world.bounds.min + DVec3::new(next(size.x), next(size.y), 20.0 + next(300.0));
            let target = eye + DVec3::new(next(2.0) - 1.0, next(2.0) - 1.0, -0.2 - next(1.0)) * 50.0;
            let camera = Camera::look_at(eye, target, Projection::default()).unwrap();
            let sight = world.sight(&camera, 1.0);
            for _ in 0..3 {
                world.live.tick(&mut world.scene, &sight, 2 << 20).unwrap();
                assert!(world.scene.pool().held_bytes() <= means.device_bytes);
                let held = world.live.status(&world.scene).host_bytes;
                assert!(held <= means.host_bytes, "{held} bytes of host memory");
                world.live.wait(Duration::from_micros(300));
            }
            if jump % 30 == 0 {
                world.picture(&camera);
            }
        }
        let (first, last) = (first.unwrap(), rest(&mut world));
        let name = surface.name();
        println!(
            "{name}: sections, their bytes, the pool's, the process's: {first:?}, after {jumps} jumps {last:?}"
        );
        assert_eq!((first.0, first.1), (last.0, last.1));
        assert!(last.2 <= first.2);
        if let (Some(first), Some(last)) = (first.3, last.3) {
            assert!(last <= first + first / 10 + (32 << 20), "{first} bytes, then {last}");
        }
        assert_eq!(world.scene.counters().waits, 0);
        assert!(world.live.take_errors().is_empty());
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

/// A steady flight: sections that come into sight are there when they do, in most cases.
#[test]
fn what_comes_into_sight_is_read_before() {
    run("live::what_comes_into_sight_is_read_before", LAVAPIPE, |setup, surface| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let paths = tiles(folder.path());
        let mut world = World::open(&gpu, surface, &paths, PLENTY, BRIDGED());
        let from = world.bounds.min + DVec3::new(40.0, 20.0, 70.0);
        let sight = |world: &World, north: f64| {
            let eye = from + DVec3::new(north, north, 0.0);
            let camera = Camera::look_at(eye, eye + DVec3::new(0.0, 10.0, -25.0), Projection::default());
            world.sight(&camera.unwrap(), 1.0)
        };
        let start = sight(&world, 0.0);
        world.complete(&start);
        let mut known: HashSet<SectionKey> = world.live.wanted().collect();
        let (mut new, mut there) = (0, 0);
        for frame in 1..200 {
            let now = sight(&world, f64::from(frame));
            world.live.tick(&mut world.scene, &now, 2 << 20).unwrap();
            for key in world.live.wanted() {
                // The first second tells where it goes.
                if known.insert(key) && frame > 30 {
                    new += 1;
                    there += usize::from(world.scene.is_published(key));
                }
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        println!("{there} of {new} sections were there");
        assert!(new > 8 && there * 4 > new * 3, "{there} of {new}");
        assert_eq!(world.scene.counters().waits, 0);
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

/// The section table is made when what it names has changed, not in every frame.
#[test]
fn tables_are_kept_while_nothing_changes() {
    run("live::tables_are_kept_while_nothing_changes", LAVAPIPE, |setup, surface| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let paths = tiles(folder.path());
        let mut world = World::open(&gpu, surface, &paths, PLENTY, MEASURED());
        let camera = Camera::frame(&world.bounds, [0.0, 90.0], Projection::default(), SIZE).unwrap();
        let above = world.sight(&camera, 1.0);
        world.complete(&above);
        let anchor = world.grid.height(world.bounds.center().z).unwrap();
        let mut renderer = Renderer::new(&world.scene, world.grid, anchor).unwrap();
        let first = renderer.table_of_live(&world.scene, &world.live);
        for _ in 0..3 {
            world.live.tick(&mut world.scene, &above, 2 << 20).unwrap();
            assert!(Arc::ptr_eq(&first, &renderer.table_of_live(&world.scene, &world.live)));
        }
        // Other classes have other highest points.
        let visibility = world.scene.visibility();
        let ground = Visibility { classes: ClassMask::only(&[2]), ..visibility };
        world.scene.set_visibility(ground).unwrap();
        let second = renderer.table_of_live(&world.scene, &world.live);
        assert!(!Arc::ptr_eq(&first, &second));
        assert!(Arc::ptr_eq(&second, &renderer.table_of_live(&world.scene, &world.live)));
    });
}
