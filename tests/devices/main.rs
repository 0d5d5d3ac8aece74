//! Scenes on every driver and queue layout: the same pictures, nothing copied twice, no word from validation.

#[cfg(feature = "view")]
mod changes;
#[path = "../common/mod.rs"]
mod common;
#[cfg(feature = "view")]
mod counts;
mod cut;
mod derived;
mod faults;
mod filled;
mod known;
#[path = "../common/lax.rs"]
mod lax_writer;
mod layers;
mod live;
mod looks;
#[cfg(feature = "view")]
mod picks;
#[path = "../common/scene.rs"]
mod scene;
mod smooth;
mod stacks;
mod story;
mod table;
mod twins;

use common::{LAVAPIPE, ORDERS, SWIFTSHADER, Setup};
use lasray::attribute::{Attributes, ClassMask, ColorMode, ColorTable, Record};
use lasray::bench::log::Counts;
use lasray::coords::{Bounds, Height, SectionKey};
use lasray::gpu::{Edge, Gpu, QueueKind, Timestamps};
use lasray::render::camera::{Camera, Projection};
use lasray::render::frame::{
    FrameError, Logged, PASSES, PassOptions, PassRepeats, Renderer, Shade, Traversal, View,
};
use lasray::render::image::Image;
use lasray::resident::pool::Access;
use lasray::resident::scene::{Scene, Upload};
use lasray::resident::visibility::Visibility;
use lasray::section::{Columns, Payload};
use scene::{BRIDGED, Data, MEASURED, hits_that_differ, pixels_that_differ};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};
use story::Story;

const SIZE: [u32; 2] = [256, 144];

/// A corner of the town in four sections.
fn town() -> Data {
    let folder = tempfile::tempdir().unwrap();
    Data::load(&[scene::town(folder.path(), "town.laz", [-80.0, -80.0], 160.0)], Some(0.5))
}

/// Over the whole, from above the roofs, down, from afar, and parallel.
fn cameras(b: &Bounds) -> Vec<Camera> {
    let wide = Projection::default();
    let center = b.center();
    let roof = glam::DVec3::new(center.x + 3.0, b.min.y + 5.0, b.max.z);
    let parallel = Projection::Orthographic { units_per_pixel: 0.9 };
    vec![
        Camera::frame(b, [30.0, 35.0], wide, SIZE).unwrap(),
        Camera::look_at(roof, center, wide).unwrap(),
        Camera::frame(b, [0.0, 90.0], wide, SIZE).unwrap(),
        Camera::orbit(center, [250.0, 8.0], 50_000.0, Projection::Perspective { fov: 0.25 }).unwrap(),
        Camera::frame(b, [300.0, 20.0], parallel, SIZE).unwrap(),
    ]
}

/// Every camera, exact and lit.
fn pictures(gpu: &Gpu, data: &Data, access: Access, traversal: Traversal) -> Vec<Image> {
    let mut images = Vec::new();
    for visibility in [MEASURED(), BRIDGED()] {
        let mut scene = data.scene(gpu, access, visibility);
        let mut renderer = data.renderer(&scene);
        for camera in &cameras(&data.bounds) {
            let view = if visibility.bridge == 0 { data.exact(camera, SIZE) } else { data.lit(camera, SIZE) };
            images.push(renderer.draw(&mut scene, &View { traversal, ..view }).unwrap());
        }
    }
    images
}

/// At most one pixel in a thousand differs by more than 1/255, or hits in one and misses in the other.
fn assert_alike(a: &[Image], b: &[Image], what: &str) {
    assert_eq!(a.len(), b.len());
    for (k, (a, b)) in a.iter().zip(b).enumerate() {
        let (pixels, hits) = (pixels_that_differ(a, b), hits_that_differ(a, b));
        println!("{what}, picture {k}: {pixels} pixels differ, {hits} of them hit or miss");
        assert!(a.distance.iter().filter(|d| d.is_finite()).count() > 1000, "picture {k} shows nothing");
        assert!(pixels.max(hits) * 1000 <= a.color.len(), "{what}, picture {k}: {pixels} pixels differ");
    }
}

#[test]
fn the_plain_traversal_gives_the_same_pictures() {
    common::run("the_plain_traversal_gives_the_same_pictures", LAVAPIPE, |setup| {
        let (gpu, data) = (setup.gpu(), town());
        let fast = pictures(&gpu, &data, Access::Address, Traversal::Fast);
        let plain = pictures(&gpu, &data, Access::Address, Traversal::Plain);
        assert_alike(&fast, &plain, "fast and plain");
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

#[test]
fn both_ways_into_the_pool_give_the_same_pictures() {
    common::run("both_ways_into_the_pool_give_the_same_pictures", LAVAPIPE, |setup| {
        let (gpu, data) = (setup.gpu(), town());
        for traversal in [Traversal::Fast, Traversal::Plain] {
            let by_address = pictures(&gpu, &data, Access::Address, traversal);
            let by_buffer = pictures(&gpu, &data, Access::StorageBuffer, traversal);
            assert!(by_address == by_buffer, "{traversal:?}");
            let by_texels = pictures(&gpu, &data, Access::Texels, traversal);
            assert!(by_address == by_texels, "{traversal:?}");
        }
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

#[test]
fn pictures_do_not_depend_on_how_passes_are_cut() {
    common::run("pictures_do_not_depend_on_how_passes_are_cut", LAVAPIPE, |setup| {
        let (gpu, data) = (setup.gpu(), town());
        let base = PassOptions::default();
        let groups = [[8, 4], [32, 1], [16, 16]].map(|group| PassOptions { group, ..base });
        let beams = PassOptions { beam_group: [8, 8], dealt: false, ..base };
        // Groups hang over the edges.
        let size = [SIZE[0] - 3, SIZE[1] - 3];
        let camera = &cameras(&data.bounds)[0];
        for access in [Access::Address, Access::Texels] {
            let mut scene = data.scene(&gpu, access, MEASURED());
            let mut draw = |options, view: &View| {
                let renderer = Renderer::with_options(&scene, data.grid, data.anchor, options);
                renderer.unwrap().draw(&mut scene, view).unwrap()
            };
            for view in [data.exact(camera, size), View { samples: 1, ..data.lit(camera, size) }] {
                for traversal in [Traversal::Fast, Traversal::Plain] {
                    let view = View { traversal, ..view.clone() };
                    let usual = draw(base, &view);
                    for options in groups.into_iter().chain([beams]) {
                        let this = draw(options, &view);
                        assert!(this == usual, "{access:?} {traversal:?} {:?} {options:?}", view.shade);
                    }
                }
                let [from_the_eye, usual] =
                    [false, true].map(|beams| draw(PassOptions { beams, ..base }, &view));
                assert!(from_the_eye.steps > usual.steps);
                assert_alike(&[from_the_eye], &[usual], "without beams");
            }
        }
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

#[test]
fn passes_are_counted_and_repeated() {
    common::run("passes_are_counted_and_repeated", LAVAPIPE, |setup| {
        let (gpu, data) = (setup.gpu(), town());
        let mut scene = data.scene(&gpu, Access::Address, MEASURED());
        let camera = &cameras(&data.bounds)[0];
        let view = data.exact(camera, SIZE);
        let mut renderer = data.renderer(&scene);
        let picture = renderer.draw(&mut scene, &view).unwrap();
        let mut counts = |logged, traversal| {
            let options = PassOptions { logged: Some(logged), ..PassOptions::default() };
            let renderer = Renderer::with_options(&scene, data.grid, data.anchor, options);
            let mut counts = Counts::default();
            let add = |across: usize, words: &[u32]| counts.add(across, words);
            renderer.unwrap().log(&mut scene, &View { traversal, ..view.clone() }, add).unwrap();
            counts
        };
        // The log has the very steps that hit records tell, and a load or more for each.
        let fast = counts(Logged::Trace, Traversal::Fast);
        assert_eq!((fast.threads, fast.steps), (picture.class.len() as u64, picture.steps));
        assert!((1.0..2.0).contains(&fast.loads_per_step()), "{fast:?}");
        let [block, row] = fast.efficiency();
        assert!(0.2 < row && row < block && block < 1.0, "{fast:?}");
        assert!(fast.lines_per_step() > 1.0 && fast.lines <= fast.loads && fast.cut == 0, "{fast:?}");
        let plain = counts(Logged::Trace, Traversal::Plain);
        assert!(plain.threads == fast.threads && plain.steps > fast.steps, "{plain:?}");
        for (logged, side) in [(Logged::Beams, 8), (Logged::WideBeams, 64)] {
            let tiles = SIZE.map(|pixels| u64::from(pixels.div_ceil(side)));
            let beams = counts(logged, Traversal::Fast);
            assert_eq!(beams.threads, tiles[0] * tiles[1]);
            assert!(beams.steps >= beams.threads && beams.loads > 0, "{beams:?}");
        }
        // Runs before are a stage of the clock, those that are timed have one for each pass.
        let repeats = PassRepeats { before: 2, timed: 3 };
        let clock = Timestamps::new(&gpu, "repeats", QueueKind::Compute, repeats.stages(PASSES)).unwrap();
        let mut clock = clock.expect("the reference driver has timestamps");
        let table = renderer.table(&scene);
        for (repeats, names) in [
            (repeats, [&["before"][..], &["wide beams", "beams", "trace"].repeat(3)].concat()),
            (PassRepeats::ONCE, vec!["wide beams", "beams", "trace"]),
        ] {
            renderer.repeat(repeats);
            let point = renderer.submit_frame(&mut scene, &view, &table, Some(&mut clock)).unwrap();
            let stages = clock.resolve(&mut scene.order, point).unwrap();
            assert_eq!(stages.iter().map(|stage| stage.0).collect::<Vec<_>>(), names);
            assert!(stages.iter().all(|stage| stage.1 > 0.0), "{stages:?}");
        }
        assert!(renderer.draw(&mut scene, &view).unwrap() == picture);
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

#[test]
fn columns_carry_what_a_picture_asks_for() {
    common::run("columns_carry_what_a_picture_asks_for", LAVAPIPE, |setup| {
        let (gpu, data) = (setup.gpu(), town());
        let camera = &cameras(&data.bounds)[0];
        let of = |mode| ColorTable::new(mode, &data.summary, &data.grid, None, None).unwrap();
        let (rgb, intensity, returns) = (of(ColorMode::Rgb), of(ColorMode::Intensity), of(ColorMode::Return));
        let draw = |scene: &mut Scene, colors: &ColorTable| {
            let view = View { colors, ..data.exact(camera, SIZE) };
            data.renderer(scene).draw(scene, &view).unwrap()
        };
        for visibility in [MEASURED(), BRIDGED()] {
            let mut scene = data.scene(&gpu, Access::Texels, visibility);
            let pictures = [&rgb, &intensity, &returns, &rgb].map(|colors| draw(&mut scene, colors));
            assert!(pictures[0] == pictures[3]);
            for (a, b) in [(0, 1), (0, 2), (1, 2)] {
                assert!(pixels_that_differ(&pictures[a], &pictures[b]) > 1000, "{a}, {b}");
            }
            let mut fresh = data.scene(&gpu, Access::Address, visibility);
            assert!(pictures[1] == draw(&mut fresh, &intensity));
        }
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

#[test]
fn frames_of_any_size_are_submitted_in_bands() {
    common::run("frames_of_any_size_are_submitted_in_bands", LAVAPIPE, |setup| {
        let (gpu, data) = (setup.gpu(), town());
        let mut scene = data.scene(&gpu, Access::Address, MEASURED());
        let mut renderer = data.renderer(&scene);
        let table = renderer.table(&scene);
        let camera = &cameras(&data.bounds)[0];
        let mut clock = Timestamps::new(&gpu, "frame", QueueKind::Compute, PASSES).unwrap();
        // One band, and two, the last of which is not whole.
        for size in [[64, 36], [2560, 1440]] {
            for shade in [Shade::None, Shade::Lit] {
                let view = View { shade, ..data.exact(camera, size) };
                let point = renderer.submit_frame(&mut scene, &view, &table, clock.as_mut()).unwrap();
                scene.order.wait(point).unwrap();
                let Some(clock) = &mut clock else { continue };
                let times = clock.resolve(&mut scene.order, point).unwrap();
                let names: Vec<_> = times.iter().map(|(name, _)| *name).collect();
                let passes = ["wide beams", "beams", "trace", "shade"];
                assert_eq!(names, passes[..if shade == Shade::Lit { 4 } else { 3 }]);
                assert!(times.iter().all(|(_, ns)| *ns >= 0.0), "{times:?}");
            }
        }
        let wide = View { ..data.exact(camera, [70_000, 1]) };
        let error = renderer.submit_frame(&mut scene, &wide, &table, None).unwrap_err();
        assert!(matches!(error, FrameError::Size { .. }), "{error}");
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

/// Where the reference driver's pictures wait for the second driver's.
fn kept() -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join("pictures of the reference driver")
}

#[test]
fn a_second_driver_gives_the_same_pictures() {
    let test = "a_second_driver_gives_the_same_pictures";
    let draw = |setup: Setup| {
        let gpu = setup.gpu();
        let images = pictures(&gpu, &town(), Access::Address, Traversal::Fast);
        assert_eq!(gpu.messages(), [""; 0]);
        images
    };
    common::run(test, LAVAPIPE, |setup| {
        let images = draw(setup);
        let planes = images.iter().flat_map(|i| {
            [bytemuck::cast_slice(&i.color), bytemuck::cast_slice::<f32, u8>(&i.distance)].concat()
        });
        fs::write(kept(), planes.collect::<Vec<u8>>()).unwrap();
    });
    common::run(test, SWIFTSHADER, |setup| {
        let images = draw(setup);
        let bytes = fs::read(kept()).unwrap();
        let reference: Vec<Image> = bytes
            .chunks(bytes.len() / images.len())
            .zip(&images)
            .map(|(bytes, image)| {
                let mut kept = image.clone();
                let (color, distance) = bytes.split_at(16 * image.color.len());
                bytemuck::cast_slice_mut(&mut kept.color).copy_from_slice(color);
                bytemuck::cast_slice_mut(&mut kept.distance).copy_from_slice(distance);
                kept
            })
            .collect();
        assert_alike(&reference, &images, "lavapipe and SwiftShader");
    });
}

#[test]
fn a_resting_camera_copies_nothing_and_no_version_is_copied_twice() {
    common::run("a_resting_camera_copies_nothing_and_no_version_is_copied_twice", LAVAPIPE, |setup| {
        let (gpu, data) = (setup.gpu(), town());
        let mut scene = data.scene(&gpu, Access::Address, BRIDGED());
        let mut renderer = data.renderer(&scene);
        let camera = &cameras(&data.bounds)[0];
        let payloads: u64 = data.sections.iter().map(|(_, packed)| 4 * packed.words.len() as u64).sum();
        let first = scene.counters();
        assert_eq!((first.section_bytes, first.sections), (payloads, data.sections.len() as u64));
        let pictures: Vec<_> = (0..3)
            .map(|_| {
                scene.advance().unwrap();
                renderer.draw(&mut scene, &data.lit(camera, SIZE)).unwrap()
            })
            .collect();
        assert_eq!(scene.counters(), first, "a resting camera");
        assert!(pictures.iter().all(|p| *p == pictures[0]));

        // Another mask builds every section once and copies none.
        let only = |classes: &[u8]| Visibility { classes: ClassMask::only(classes), ..BRIDGED() };
        scene.set_visibility(only(&[6])).unwrap();
        let roofs = renderer.draw(&mut scene, &data.lit(camera, SIZE)).unwrap();
        assert!(pixels_that_differ(&roofs, &pictures[0]) > 1000);
        let masked = scene.counters();
        assert_eq!((masked.section_bytes, masked.sections), (first.section_bytes, first.sections));
        assert_eq!(masked.builds, first.builds + first.sections);
        scene.set_visibility(only(&[6])).unwrap();
        assert_eq!(scene.counters(), masked, "the same mask");
        scene.set_visibility(BRIDGED()).unwrap();
        assert!(renderer.draw(&mut scene, &data.lit(camera, SIZE)).unwrap() == pictures[0]);

        // A new version of one section is copied, and nothing beside it.
        let (key, packed) = &data.sections[0];
        scene.upload(*key, packed).unwrap();
        scene.settle().unwrap();
        renderer.draw(&mut scene, &data.lit(camera, SIZE)).unwrap();
        let again = scene.counters();
        assert_eq!(again.section_bytes, payloads + 4 * packed.words.len() as u64);
        assert_eq!(again.sections, first.sections + 1);
    });
}

#[test]
fn streaming_shows_what_is_resident_on_every_driver_and_in_every_order() {
    let test = "streaming_shows_what_is_resident_on_every_driver_and_in_every_order";
    let setups = [LAVAPIPE, SWIFTSHADER].into_iter().chain(ORDERS);
    for setup in setups {
        common::run(test, setup, |setup| {
            let story = Story::new();
            // Barriers within a workgroup are slow on SwiftShader.
            let accesses = [Access::Address, Access::Texels, Access::StorageBuffer].into_iter();
            for access in accesses.take(if setup == SWIFTSHADER { 1 } else { 3 }) {
                let gpu = setup.gpu();
                assert!(gpu.has_transfer_queue() || setup.queue_order().is_none());
                assert_eq!(story.run(&gpu, access, None), [""; 0], "{access:?}");
                assert_eq!(gpu.messages(), [""; 0], "{access:?}");
                assert_eq!(gpu.allocated_bytes(), 0, "all buffers are given back");
            }
        });
    }
}

#[test]
fn what_submits_use_is_given_back_while_a_picture_is_drawn() {
    common::run("what_submits_use_is_given_back_while_a_picture_is_drawn", LAVAPIPE, |setup| {
        let (gpu, data) = (setup.gpu(), town());
        let mut scene = data.scene(&gpu, Access::Texels, BRIDGED());
        let mut renderer = data.renderer(&scene);
        let camera = cameras(&data.bounds)[0];
        let view = View { samples: 100, ..data.lit(&camera, [64, 36]) };
        renderer.draw(&mut scene, &view).unwrap();
        // Those under way at once, and what the scene was made by.
        assert!(scene.order.in_flight() < 12, "{} of 100 submits", scene.order.in_flight());
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

/// A section of many classes, larger than the ring that uploads go through.
fn large() -> Payload {
    let mut columns = Columns::default();
    for class in 0..28 {
        for at in 0..1 << 16 {
            let height = Height(1000 + class * 16 + at % 7);
            let record = Attributes {
                height,
                class: class as u8,
                intensity: at as u16,
                rgb: [class as u8; 3],
                returns: 0x11,
                flags: 0,
            };
            columns.add(at as u32 & 255, at as u32 >> 8, Record::pack(record));
        }
    }
    columns.pack()
}

#[test]
fn sections_larger_than_the_ring_hold_no_frame_up() {
    for setup in [LAVAPIPE, ORDERS[1]] {
        common::run("sections_larger_than_the_ring_hold_no_frame_up", setup, |setup| {
            let (gpu, mut data) = (setup.gpu(), town());
            let small = Arc::new(data.sections.pop().unwrap().1);
            let mut scene = data.empty(&gpu, Access::Address, |order| order, MEASURED(), 1 << 30);
            let packed = Arc::new(large());
            let bytes = packed.layout.uploaded_bytes();
            assert!(bytes > 17 << 20, "{bytes} bytes");
            let keys = [0, 1, 2].map(|i| SectionKey { level: 0, i, j: 0 });
            assert_eq!(scene.try_upload(keys[0], &packed).unwrap(), Upload::Started);
            assert!(scene.is_uploading(keys[0]) && scene.staged_bytes() == bytes);
            assert_eq!(scene.try_upload(keys[1], &packed).unwrap(), Upload::Later, "one at a time");
            // Others pass, and more of them than the ring holds wait for a later frame.
            let of_ring = (16 << 20) / small.layout.uploaded_bytes() as i32;
            let more = (0..=of_ring).map(|j| SectionKey { level: 0, i: 9, j: 1 + j });
            let came: Vec<_> = more.map(|key| scene.try_upload(key, &small).unwrap()).collect();
            assert_eq!((came[0], came[came.len() - 1]), (Upload::Started, Upload::Later));
            let start = Instant::now();
            while !scene.is_published(keys[0]) {
                assert!(start.elapsed() < Duration::from_secs(60), "it never comes");
                scene.advance().unwrap();
                std::thread::sleep(Duration::from_millis(2));
            }
            assert_eq!((scene.counters().waits, scene.staged_bytes()), (0, 0));
            // One that is taken out on its way leaves nothing behind, and one that comes again is whole.
            assert_eq!(scene.try_upload(keys[1], &packed).unwrap(), Upload::Started);
            scene.advance().unwrap();
            scene.evict(&keys[1..2]).unwrap();
            assert_eq!(scene.try_upload(keys[2], &packed).unwrap(), Upload::Started);
            scene.advance().unwrap();
            assert!(scene.upload(keys[2], &packed).unwrap());
            scene.settle().unwrap();
            for key in [keys[0], keys[2]] {
                assert!(scene.read_back(key).unwrap().unwrap().uploaded == packed.words);
            }
            assert!(!scene.is_published(keys[1]) && !scene.is_busy());
            assert_eq!(gpu.messages(), [""; 0]);
        });
    }
}

#[test]
fn what_derived_passes_read_is_used_again() {
    common::run("what_derived_passes_read_is_used_again", LAVAPIPE, |setup| {
        let (gpu, data) = (setup.gpu(), town());
        let mut scene = data.scene(&gpu, Access::Address, BRIDGED());
        let mut show = |classes: &[u8]| {
            scene.set_visibility(Visibility { classes: ClassMask::only(classes), ..BRIDGED() }).unwrap();
            scene.settle().unwrap();
            scene.wait().unwrap();
            scene.order.collect().unwrap();
            gpu.allocated_bytes()
        };
        let first = show(&[6]);
        for _ in 0..5 {
            assert_eq!((show(&[2]), show(&[6])), (first, first));
        }
    });
}

/// Edges of which a scene shows that they are missing. Not the others, which `tests/ordering` shows: a scene
/// uses a slot again and builds a copy only when the host has seen the work before over (CopyAfterUse,
/// BuildAfterCopy); each upload polls, which lets the copies before go on (RingReuse); pictures are read one
/// by one (TableReuse, FrameAfterReadback); software drivers write host memory (HostAfterReadback).
const STALE: (Edge, Setup) = (Edge::HostRead, ORDERS[2]);
const REPORTED: [Edge; 5] = [
    Edge::BuildAfterEarlier,
    Edge::BuildPass,
    Edge::FrameAfterEarlier,
    Edge::FramePass,
    Edge::ReadbackAfterPass,
];

#[test]
fn a_scene_without_a_wait_shows_stale_data() {
    let (edge, setup) = STALE;
    common::run("a_scene_without_a_wait_shows_stale_data", setup, |setup| {
        let wrong = Story::new().run(&setup.gpu(), Access::Address, Some(edge));
        assert!(!wrong.is_empty(), "without {edge:?} every picture was right");
    });
}

#[test]
fn a_scene_without_a_barrier_is_reported() {
    let test = "a_scene_without_a_barrier_is_reported";
    if !common::layer_sees_queues(test) {
        return;
    }
    common::run(test, LAVAPIPE, |setup| {
        let story = Story::new();
        for edge in REPORTED {
            let gpu = setup.gpu();
            story.run(&gpu, Access::StorageBuffer, Some(edge));
            let messages = gpu.messages();
            assert!(messages.iter().any(|m| m.contains("SYNC-HAZARD")), "without {edge:?}: {messages:?}");
        }
    });
}
