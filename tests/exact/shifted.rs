//! The same scene elsewhere in its CRS: header offsets moved by (500,000; 6,000,000). The pictures that the
//! program writes must be the same, bit by bit.

use crate::common::{self, LAVAPIPE};
use crate::scene;
use exr::prelude::{FlatSamples, ReadChannels, ReadLayers, read};
use std::fs;
use std::path::Path;
use std::process::Command;

const SHIFT: [f64; 2] = [500_000.0, 6_000_000.0];

/// Copies a LAS file, its offsets (LAS 1.4 R15, table 3: bytes 155 on) and bounds (bytes 179 on) moved.
fn shift(from: &Path, to: &Path, [e, n]: [f64; 2]) {
    let mut bytes = fs::read(from).unwrap();
    for (at, by) in [(155, e), (163, n), (179, e), (187, e), (195, n), (203, n)] {
        let value = f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
        bytes[at..at + 8].copy_from_slice(&(value + by).to_le_bytes());
    }
    fs::write(to, bytes).unwrap();
}

pub fn render(input: &Path, output: &Path, arguments: &[String]) {
    let run = Command::new(env!("CARGO_BIN_EXE_lasray"))
        .arg("render")
        .args([input, Path::new("-o"), output])
        .args(["--size", "320x180", "--quiet", "--no-cache"])
        .args(arguments)
        .output()
        .unwrap();
    assert!(run.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&run.stderr));
}

/// Pixels of a PNG: what it says of eye and target differs.
fn png_pixels(path: &Path) -> Vec<u8> {
    let mut reader =
        png::Decoder::new(std::io::BufReader::new(fs::File::open(path).unwrap())).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut pixels).unwrap();
    pixels
}

pub fn exr_planes(path: &Path) -> Vec<(String, FlatSamples)> {
    let image =
        read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer().all_attributes();
    let channels = image.from_file(path).unwrap().layer_data.channel_data.list;
    channels.into_iter().map(|c| (c.name.to_string(), c.sample_data)).collect()
}

pub fn words(samples: &FlatSamples) -> Vec<u32> {
    match samples {
        FlatSamples::F32(values) => values.iter().map(|v| v.to_bits()).collect(),
        FlatSamples::U32(values) => values.clone(),
        FlatSamples::F16(_) => panic!("no channel is half"),
    }
}

#[test]
fn a_shifted_scene_gives_the_same_picture_bit_by_bit() {
    common::run("shifted::a_shifted_scene_gives_the_same_picture_bit_by_bit", LAVAPIPE, |_| {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let town = scene::town(folder.path(), "town.las", [-80.0, -80.0], 170.0);
        // Near 0; 0 numbers are finer than far from it.
        let (made, moved) = (at("made.las"), at("moved.las"));
        shift(&town, &made, [-511_950.0, -5_402_930.0]);
        shift(&made, &moved, SHIFT);
        let place = |[e, n, u]: [f64; 3], moved: bool| {
            let [de, dn] = if moved { SHIFT } else { [0.0; 2] };
            format!("{},{},{u}", e + de, n + dn)
        };
        // Close to the ground, where the last bits of a place are felt; numbers that are as fine elsewhere, since the
        // direction of view is that of the places as they are given.
        let (eye, target) = ([64.3125, 41.234375, 224.09375], [91.703125, 69.90625, 220.296875]);
        let cases: [(&str, &[&str], bool); 7] = [
            ("lit", &[], false),
            ("a cell given", &["--cell", "0.5"], false),
            ("lit, from a place", &[], true),
            ("exact, from a place", &["--shade", "none", "--cell", "0.25"], true),
            ("exaggerated", &["--z-scale", "2", "--orbit", "230,20", "--color", "height"], false),
            ("a map", &["--ortho", "0.5", "--shade", "none", "--color", "class"], false),
            ("from afar", &["--orbit", "40,20,50000", "--fov", "0.3"], false),
        ];
        for (name, arguments, placed) in cases {
            for kind in ["png", "exr"] {
                let [a, b] = [&made, &moved].map(|input| {
                    let mut arguments: Vec<String> = arguments.iter().map(|a| a.to_string()).collect();
                    // Coarser cells lie on a grid of their own, which is not shifted along.
                    if kind == "png" && !arguments.iter().any(|a| a == "--shade") {
                        arguments.extend(["--detail".to_owned(), "0".to_owned()]);
                        // What stacks are filled by ends at sections, whose borders are not shifted along.
                        arguments.extend(["--surface".to_owned(), "columns".to_owned()]);
                    }
                    if placed {
                        let [eye, target] = [eye, target].map(|p| place(p, input == &moved));
                        arguments.extend([format!("--eye={eye}"), format!("--target={target}")]);
                    }
                    let output = at(if input == &moved { "moved" } else { "made" }).with_extension(kind);
                    render(input, &output, &arguments);
                    output
                });
                if kind == "png" {
                    let (a, b) = (png_pixels(&a), png_pixels(&b));
                    let differ = a.chunks(3).zip(b.chunks(3)).filter(|(a, b)| a != b).count();
                    assert!(a.len() == b.len() && differ == 0, "{name}: {differ} pixels of the PNG differ");
                    assert!(a.iter().any(|&v| v != a[0]), "{name}: nothing is in the picture");
                } else {
                    let (a, b) = (exr_planes(&a), exr_planes(&b));
                    assert_eq!(a.len(), 8);
                    for ((channel, a), (_, b)) in a.iter().zip(&b) {
                        let differ = words(a).iter().zip(words(b)).filter(|(a, b)| *a != b).count();
                        println!("{name}: {differ} pixels of {channel} differ");
                        assert!(differ == 0, "{name}: {differ} pixels of {channel} differ");
                    }
                }
            }
        }
    });
}
