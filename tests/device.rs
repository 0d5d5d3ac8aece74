//! Opening a device, and how long things live.

mod common;

use std::fs;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, SystemTime};

use common::{LAVAPIPE, NO_DRIVER, ORDERS, SWIFTSHADER};
use lasray::gpu::{
    BindingCache, BindingKind, Buffer, BufferCopy, ComputePipeline, Gpu, GpuError, GpuOptions, MemoryKind,
    Order, PipelineDesc, QueueKind, Timestamps, UploadRing, list_devices, shaders,
};

#[test]
fn the_software_drivers_have_all_that_is_needed() {
    for setup in [LAVAPIPE, SWIFTSHADER] {
        common::run("the_software_drivers_have_all_that_is_needed", setup, |_| {
            let devices = list_devices().unwrap();
            assert!(!devices.is_empty());
            for (i, device) in devices.iter().enumerate() {
                assert_eq!((device.index, device.missing.as_slice()), (i, &[][..]), "{device}");
                assert!(device.memory_bytes > 0 && !device.name.is_empty(), "{device}");
            }
            let options = GpuOptions { device: Some(99), ..Default::default() };
            let error = Gpu::new(&options).unwrap_err();
            assert!(matches!(error, GpuError::NoSuchDevice { index: 99, .. }), "{error}");
            assert!(error.to_string().contains(&devices[0].name), "the message lists the devices: {error}");
        });
    }
}

#[test]
fn without_a_driver_the_message_says_what_to_install() {
    common::run("without_a_driver_the_message_says_what_to_install", NO_DRIVER, |_| {
        let error = Gpu::new(&GpuOptions::default()).unwrap_err();
        assert!(matches!(error, GpuError::NoDevice), "{error}");
        assert!(error.to_string().contains("mesa-vulkan-drivers"), "{error}");
    });
}

#[test]
fn a_layer_that_is_not_installed_is_named() {
    common::run("a_layer_that_is_not_installed_is_named", LAVAPIPE, |_| {
        let options = GpuOptions { layers: vec!["VK_LAYER_none".into()], ..Default::default() };
        let error = Gpu::new(&options).unwrap_err();
        assert!(error.to_string().contains("VK_LAYER_none"), "{error}");
    });
}

#[test]
fn memory_beyond_the_device_is_an_error() {
    for setup in [LAVAPIPE, SWIFTSHADER] {
        common::run("memory_beyond_the_device_is_an_error", setup, |setup| {
            let gpu = setup.gpu();
            let error = Buffer::new(&gpu, "vast", MemoryKind::Device, u64::MAX / 2).unwrap_err();
            assert!(
                matches!(error, GpuError::Memory { .. }) && error.to_string().contains("vast"),
                "{error}"
            );
            assert_eq!((gpu.allocated_bytes(), gpu.messages()), (0, vec![]));
        });
    }
}

#[test]
fn what_is_free_is_part_of_what_there_is() {
    for setup in [LAVAPIPE, SWIFTSHADER] {
        common::run("what_is_free_is_part_of_what_there_is", setup, |setup| {
            let gpu = setup.gpu();
            let free = gpu.free_bytes();
            assert!((1 << 20..=gpu.info().memory_bytes).contains(&free), "{free} bytes");
            assert_eq!(gpu.bytes_for_sections(1 << 16), 1 << 16);
            assert!(gpu.bytes_for_sections(u64::MAX) < gpu.info().memory_bytes);
            assert_eq!(gpu.messages(), [""; 0]);
        });
    }
}

#[test]
fn compiled_pipelines_are_kept() {
    for setup in [LAVAPIPE, SWIFTSHADER] {
        common::run("compiled_pipelines_are_kept", setup, |setup| {
            let folder = tempfile::tempdir().unwrap();
            let files = || -> Vec<PathBuf> {
                fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path()).collect()
            };
            let open = || setup.gpu_with(Some(folder.path().to_owned()));
            let compile = |gpu: &Gpu| {
                drop(ComputePipeline::new(gpu, "pyramid", shaders::PYRAMID, &[], 16, &[]).unwrap());
                assert_eq!(gpu.messages(), [""; 0]);
            };
            drop(open());
            assert_eq!(files().len(), 0, "nothing was compiled");
            compile(&open());
            let first = files();
            assert_eq!(first.len(), 1);
            let kept = fs::read(&first[0]).unwrap();
            // Nothing new: it is not written again.
            let long_ago = SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000_000);
            let modified = || fs::metadata(&first[0]).unwrap().modified().unwrap();
            fs::File::options().write(true).open(&first[0]).unwrap().set_modified(long_ago).unwrap();
            compile(&open());
            assert_eq!((modified(), files().len()), (long_ago, 1));
            // Damaged: as if there were none.
            let mut damaged = kept.clone();
            damaged[kept.len() / 2] ^= 1;
            fs::write(&first[0], damaged).unwrap();
            compile(&open());
            assert_eq!((fs::read(&first[0]).unwrap().len(), files().len()), (kept.len(), 1));
            // Nowhere to keep it: no fault.
            let file = tempfile::NamedTempFile::new().unwrap();
            compile(&setup.gpu_with(Some(file.path().join("folder"))));
        });
    }
}

/// Says when it is dropped.
struct Flag(Arc<AtomicBool>);

impl Drop for Flag {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

#[test]
fn what_is_retired_lives_until_its_work_is_done() {
    // Transfers are held back until something demands them: the copy is in flight for as long as we like.
    common::run("what_is_retired_lives_until_its_work_is_done", ORDERS[1], |setup| {
        let gpu = setup.gpu();
        let mut order = Order::new(&gpu, 2).unwrap();
        let mut ring = UploadRing::new(&gpu, "ring", 64).unwrap();
        let slot = Buffer::new(&gpu, "slot", MemoryKind::Device, 64).unwrap();
        let offset = ring.push(&mut order, &[7; 64]).unwrap().unwrap();
        let mut copy = order.begin_copy("copy", &[]).unwrap();
        copy.copy(ring.buffer(), &slot, &[BufferCopy { from: offset, to: 0, size: 64 }]);
        let kept = Arc::new(AtomicBool::new(false));
        copy.keep(Flag(kept.clone()));
        let point = order.submit(copy).unwrap();
        ring.seal(point);
        let retired = Arc::new(AtomicBool::new(false));
        order.retire(point, Flag(retired.clone()));
        drop((ring, slot)); // the commands hold the buffers
        let held = gpu.allocated_bytes();
        order.collect().unwrap(); // this poll lets the copy go, but has seen it undone
        assert_eq!((kept.load(Ordering::Relaxed), retired.load(Ordering::Relaxed)), (false, false));
        assert!(held > 0 && gpu.allocated_bytes() == held);
        order.wait(point).unwrap();
        assert!(order.is_live(point).unwrap());
        order.collect().unwrap();
        assert_eq!((kept.load(Ordering::Relaxed), retired.load(Ordering::Relaxed)), (true, true));
        assert_eq!((gpu.allocated_bytes(), gpu.messages()), (0, vec![]));
    });
}

#[test]
fn stages_of_a_frame_are_timed() {
    for setup in [LAVAPIPE, SWIFTSHADER] {
        common::run("stages_of_a_frame_are_timed", setup, |setup| {
            let gpu = setup.gpu();
            let mut order = Order::new(&gpu, 1).unwrap();
            let Some(mut times) = Timestamps::new(&gpu, "times", QueueKind::Compute, 2).unwrap() else {
                assert_eq!(gpu.limits().timestamp_bits[0], 0);
                return;
            };
            let bytes = 16 << 20;
            let image = Buffer::new(&gpu, "image", MemoryKind::Device, bytes).unwrap();
            let readback = Buffer::new(&gpu, "readback", MemoryKind::Readback, bytes).unwrap();
            for _ in 0..2 {
                let (mut frame, turn) = order.begin_frame("frame").unwrap();
                assert_eq!(turn, 0);
                times.begin(&mut frame);
                times.end(&mut frame, "nothing");
                let all = BufferCopy { from: 0, to: 0, size: bytes };
                order.readback(&mut frame, &[(&image, &readback, all)]);
                times.end(&mut frame, "readback");
                let point = order.submit(frame).unwrap();
                let stages = times.resolve(&mut order, point).unwrap();
                assert_eq!(stages.iter().map(|(name, _)| *name).collect::<Vec<_>>(), ["nothing", "readback"]);
                assert!(stages.iter().all(|(_, ns)| (0.0..60e9).contains(ns)), "{stages:?}");
                assert!(stages[1].1 > 0.0, "16 MiB take time: {stages:?}");
            }
            assert_eq!(gpu.messages(), [""; 0]);
        });
    }
}

/// A frame finds the descriptor sets of the last one again, and makes one only where pipeline or buffers are others.
#[test]
fn descriptor_sets_serve_again() {
    common::run("descriptor_sets_serve_again", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let pipeline = |wide: u32| {
            let (words, bindings) = (shaders::TOPS_SSBO, &[BindingKind::Storage; 3]);
            let desc =
                PipelineDesc { name: "tops", words, constants: vec![(0, wide)], push_bytes: 0, bindings };
            desc.make(&gpu).unwrap()
        };
        let (narrow, wide) = (pipeline(0), pipeline(1));
        let buffer = |name: &str| Buffer::new(&gpu, name, MemoryKind::Device, 1024).unwrap();
        let [a, b, c, d] = ["a", "b", "c", "d"].map(buffer);
        let mut cache = BindingCache::default();
        cache.begin();
        let first = cache.get(&narrow, &[&a, &b, &c]).unwrap();
        assert!(first == cache.get(&narrow, &[&a, &b, &c]).unwrap());
        assert!(first != cache.get(&narrow, &[&a, &b, &d]).unwrap());
        assert!(first != cache.get(&wide, &[&a, &b, &c]).unwrap());
        // Of the last frame, but not of one before.
        cache.begin();
        assert!(first == cache.get(&narrow, &[&a, &b, &c]).unwrap());
        cache.begin();
        cache.begin();
        assert!(first != cache.get(&narrow, &[&a, &b, &c]).unwrap());
        assert_eq!(gpu.messages(), [""; 0]);
    });
}
