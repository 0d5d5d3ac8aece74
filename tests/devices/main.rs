//! Scenes on every driver and queue layout: the same pictures, nothing copied twice, no word from validation.

#[cfg(feature = "view")]
mod changes;
#[path = "../common/mod.rs"]
mod common;
mod cut;
mod derived;
mod faults;
mod known;
#[path = "../common/lax.rs"]
mod lax_writer;
mod live;
#[path = "../common/scene.rs"]
mod scene;
mod story;
mod table;

use common::{LAVAPIPE, ORDERS, SWIFTSHADER, Setup};
use lasray::attribute::{ClassMask, ColorMode, ColorTable};
use lasray::gpu::{Edge, Gpu, QueueKind, Timestamps};
use lasray::render::camera::{Bounds, Camera, Projection};
use lasray::render::frame::{FrameError, PASSES, Shade, Traversal, View};
use lasray::render::image::Image;
use lasray::stream::pool::Access;
use lasray::stream::scene::{Scene, Visibility};
use scene::{BRIDGED, Data, MEASURED, hits_that_differ, pixels_that_differ};
use std::fs;
use std::path::{Path, PathBuf};
use story::Story;

const SIZE: [u32; 2] = [256, 144];

/// A corner of the town in four sections.
fn town() -> Data {
    let folder = tempfile::tempdir().unwrap();
    Data::load(&[scene::town(folder.path(), "town.laz", [-80.0, -80.0], 160.0)], Some(0.5))
}

/// Over the whole, from the ground, down, from afar, and parallel.
fn cameras(b: &Bounds) -> Vec<Camera> {
    let wide = Projection::default();
    let center = b.center();
    let ground = center.with_z(b.min.z + 12.0);
    let parallel = Projection::Orthographic { units_per_pixel: 0.9 };
    vec![
        Camera::frame(b, [30.0, 35.0], wide, SIZE).unwrap(),
        Camera::look_at(ground, ground + glam::DVec3::new(-9.0, 31.0, -2.0), wide).unwrap(),
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
        scene.show(only(&[6])).unwrap();
        let roofs = renderer.draw(&mut scene, &data.lit(camera, SIZE)).unwrap();
        assert!(pixels_that_differ(&roofs, &pictures[0]) > 1000);
        let masked = scene.counters();
        assert_eq!((masked.section_bytes, masked.sections), (first.section_bytes, first.sections));
        assert_eq!(masked.builds, first.builds + first.sections);
        scene.show(only(&[6])).unwrap();
        assert_eq!(scene.counters(), masked, "the same mask");
        scene.show(BRIDGED()).unwrap();
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
