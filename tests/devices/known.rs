//! What is known of chunks before they are read changes what is read, and no picture.

use super::common::{self, LAVAPIPE};
use super::lax_writer::{self, Lax};
use super::live::{self, PLENTY, World};
use super::scene::BRIDGED;
use super::{SIZE, cameras};
use glam::DVec3;
use lasray::coords::SectionKey;
use lasray::gpu::Gpu;
use lasray::load::{self, LoadOptions};
use lasray::problems::Problems;
use lasray::render::camera::{Camera, Projection};
use lasray::render::image::Image;
use lasray::resident::live::Status;
use lasray::section::Surface;
use lasray::source::known::RawBounds;
use lasray::source::learned::Cache;
use lasray::source::{Decoder, LidarFile};
use std::collections::HashSet;
use std::fs;
use std::path::PathBuf;

/// A world that knows what is kept there, and what opening it says.
fn open(gpu: &Gpu, paths: &[PathBuf], cache: Option<&Cache>) -> (World, Vec<String>) {
    let options = LoadOptions { cache: cache.cloned(), ..live::options(Surface::Stacks) };
    let mut problems = Problems::default();
    let opening = load::open(paths, &options, &mut problems).unwrap();
    let world = World::of(gpu, Surface::Stacks, opening, PLENTY, BRIDGED());
    if let Some(cache) = cache {
        world.live.save_learned_to(cache.clone());
    }
    (world, problems.lines())
}

fn files(paths: &[PathBuf]) -> Vec<LidarFile> {
    paths.iter().map(|path| LidarFile::open(path).unwrap()).collect()
}

fn known(cache: &Cache, file: &LidarFile) -> Vec<Option<RawBounds>> {
    let known = cache.load(file);
    file.chunks.iter().map(|chunk| known.of(chunk).map(|(_, bounds)| bounds)).collect()
}

/// Other bounds of a chunk, by its first point and the true ones.
type Lie = dyn Fn([i32; 3], RawBounds) -> RawBounds;

/// The first point of each chunk.
fn firsts(file: &LidarFile) -> Vec<[i32; 3]> {
    let first = |chunk| {
        let mut point = None;
        Decoder::default()
            .decode(file, chunk, 0..1, &mut |block| point = Some([block.x[0], block.y[0], block.z[0]]))
            .unwrap();
        point.unwrap()
    };
    file.chunks.iter().map(first).collect()
}

/// Changes the records of a LAS file, and neither its header, nor its size, nor its time.
fn replace_points(path: &PathBuf) {
    let file = LidarFile::open(path).unwrap();
    let (modified, digest) = (file.bytes.modified().unwrap(), file.digest());
    let len = usize::from(file.header.record_len);
    let start = file.header.offset_to_points as usize;
    let end = start + len * file.points() as usize;
    let mut bytes = fs::read(path).unwrap();
    let records: Vec<u8> = bytes[start..end].chunks(len).rev().flatten().copied().collect();
    bytes[start..end].copy_from_slice(&records);
    fs::write(path, bytes).unwrap();
    fs::File::options().write(true).open(path).unwrap().set_modified(modified).unwrap();
    assert_eq!(LidarFile::open(path).unwrap().digest(), digest);
}

#[test]
fn pictures_do_not_depend_on_what_is_known() {
    common::run("known::pictures_do_not_depend_on_what_is_known", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let paths = live::tiles(folder.path());
        let cameras = &cameras(&super::town().bounds)[..3];
        let chunks: usize = files(&paths).iter().map(|file| file.chunks.len()).sum();
        let cache = Cache::at(folder.path().join("cache"));
        // Pictures, what was said, and how many chunks were known when the first one was begun.
        let pictures = |paths: &[PathBuf], cache| -> (Vec<Image>, Vec<String>, u64) {
            let (mut world, mut said) = open(&gpu, paths, cache);
            let at_first = world.live.status(&world.scene).progress.chunks_known;
            let picture = |camera: &Camera| {
                let sight = world.sight(camera, 1.0);
                world.complete(&sight);
                world.picture(camera)
            };
            let images = cameras.iter().map(picture).collect();
            said.extend(world.live.take_errors());
            said.extend(world.live.take_warnings());
            (images, said, at_first)
        };
        let (usual, said, at_first) = pictures(&paths, None);
        assert_eq!((said, at_first), (vec![], 0));
        let check = |paths: &[PathBuf], cache, what: &str| {
            let (images, said, at_first) = pictures(paths, cache);
            for (k, (a, b)) in usual.iter().zip(&images).enumerate() {
                assert!(a.distance.iter().any(|d| d.is_finite()), "picture {k} shows nothing");
                let same = (&a.color, &a.distance, &a.class) == (&b.color, &b.distance, &b.class);
                assert!(same, "{what}: picture {k} is another one");
            }
            (said, at_first)
        };

        assert_eq!(check(&paths, Some(&cache), "empty"), (vec![], 0));
        let truth: Vec<_> = files(&paths).iter().map(|file| known(&cache, file)).collect();
        assert!(truth.iter().flatten().all(Option::is_some), "the first camera sees everything");
        assert_eq!(check(&paths, Some(&cache), "full"), (vec![], chunks as u64));

        // Poisoned: sound entries that tell lies which opening does not see.
        let poison = |lie: &Lie| {
            for (file, truth) in files(&paths).iter().zip(&truth) {
                let lies: Vec<_> = firsts(file)
                    .into_iter()
                    .zip(truth)
                    .map(|(p, truth)| Some(lie(p, truth.unwrap())))
                    .collect();
                cache.forget(file);
                cache.save(file, &lies).unwrap();
            }
        };
        let lies: [(&str, &Lie); 3] = [
            ("a point", &|first, _| RawBounds { min: first, max: first }),
            ("the west", &|first, truth| RawBounds { max: [first[0], truth.max[1], truth.max[2]], ..truth }),
            ("elsewhere", &|first, truth| RawBounds {
                min: truth.min,
                max: [truth.min[0].max(first[0] - 1), truth.max[1], truth.max[2]],
            }),
        ];
        for (what, lie) in lies {
            poison(lie);
            let (said, _) = check(&paths, Some(&cache), what);
            assert!(
                !said.is_empty() && said.iter().all(|line| line.contains("that were kept of it")),
                "{said:?}"
            );
            let now: Vec<_> = files(&paths).iter().map(|file| known(&cache, file)).collect();
            assert!(now == truth, "{what}: what is kept now is true");
        }

        // An index, and one that lies likewise.
        for (what, honest) in [("an index", true), ("a lying index", false)] {
            for file in files(&paths) {
                let mut points = lax_writer::points(&file);
                if !honest {
                    for chunk in &file.chunks {
                        let records =
                            chunk.first_record as usize..(chunk.first_record + chunk.records) as usize;
                        let first = points[records.start];
                        points[records].fill(first);
                    }
                    // The extent of the tree stays.
                    let (low, high) = (file.header.min, file.header.max);
                    let last = points.len() - 1;
                    (points[last - 1], points[last]) = ([low.x, low.y], [high.x, high.y]);
                }
                fs::write(file.path().with_extension("lax"), Lax::of(&points, 5, 0).bytes()).unwrap();
            }
            let (said, at_first) = check(&paths, None, what);
            assert_eq!(at_first, chunks as u64, "{what}");
            assert_eq!(said.is_empty(), honest, "{what}: {said:?}");
            assert!(said.iter().all(|line| line.contains("spatial index (.lax)")), "{said:?}");
        }
        paths.iter().for_each(|path| fs::remove_file(path.with_extension("lax")).unwrap());

        // Stale: the same points in another order, in files of the same size, time, header and chunks.
        [0, 3].iter().for_each(|&k| replace_points(&paths[k]));
        let (said, _) = check(&paths, Some(&cache), "stale");
        assert!(
            !said.is_empty() && said.iter().all(|line| line.contains("that were kept of it")),
            "{said:?}"
        );
        assert_eq!(check(&paths, Some(&cache), "learned anew").0, [""; 0]);
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

/// Straight down on a small place: of files that nothing is known of, those are read whose headers touch what is wanted;
/// once bounds are known, the chunks that do.
#[test]
fn a_small_place_reads_the_chunks_that_touch_it() {
    common::run("known::a_small_place_reads_the_chunks_that_touch_it", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let paths = live::tiles(folder.path());
        let files = files(&paths);
        let cache = Cache::at(folder.path().join("cache"));
        let look = |camera: &dyn Fn(&World) -> Camera| -> (Status, HashSet<SectionKey>, World) {
            let (mut world, said) = open(&gpu, &paths, Some(&cache));
            assert_eq!(said, [""; 0]);
            let sight = world.sight(&camera(&world), 1.0);
            let status = world.complete(&sight);
            assert_eq!(world.live.take_warnings(), [""; 0]);
            (status, world.live.wanted().collect(), world)
        };
        // Over the middle of the first tile.
        let down = |world: &World| {
            let size = world.bounds.max - world.bounds.min;
            let at = world.bounds.min + DVec3::new(0.22 * size.x, 0.22 * size.y, 0.0);
            Camera::look_at(at.with_z(world.bounds.min.z + 50.0), at, Projection::default()).unwrap()
        };
        let touching = |world: &World, wanted: &HashSet<SectionKey>, low: DVec3, high: DVec3| {
            let (low, high) =
                (world.grid.cell_of(low.x, low.y).unwrap(), world.grid.cell_of(high.x, high.y).unwrap());
            // A cell around, as where the bounds of headers and of chunks are used.
            wanted.iter().any(|key| key.touches([low.i - 1, low.j - 1], [high.i + 2, high.j + 2]))
        };
        let (status, wanted, world) = look(&down);
        let of_files: u64 = files
            .iter()
            .filter(|file| touching(&world, &wanted, file.header.min, file.header.max))
            .flat_map(|file| &file.chunks)
            .map(|chunk| chunk.byte_len)
            .sum();
        let all: u64 = files.iter().flat_map(|file| &file.chunks).map(|chunk| chunk.byte_len).sum();
        assert!(status.progress.bytes_read <= of_files && of_files < all, "{status:?}: {of_files} of {all}");
        drop(world);

        look(&|world| Camera::frame(&world.bounds, [0.0, 90.0], Projection::default(), SIZE).unwrap());
        let (status, again, world) = look(&down);
        assert_eq!(again, wanted);
        let mut of_chunks = 0;
        for file in &files {
            for (chunk, bounds) in file.chunks.iter().zip(known(&cache, file)) {
                let [low, high] = bounds.expect("all was read").unpacked(&file.header);
                of_chunks += if touching(&world, &wanted, low, high) { chunk.byte_len } else { 0 };
            }
        }
        let read = status.progress.bytes_read;
        println!(
            "{read} bytes read, {of_chunks} in chunks and {of_files} in files that touch it, {all} in all"
        );
        assert!(read > 0 && read <= of_chunks && of_chunks < of_files, "{read}, {of_chunks}, {of_files}");
        assert_eq!(gpu.messages(), [""; 0]);
    });
}
