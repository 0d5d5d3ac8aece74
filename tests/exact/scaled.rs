//! One scene in other units and at other heights: what is drawn follows from cells and heights in cells, whatever
//! number of units a cell is, and wherever heights lie.

use crate::common::{self, LAVAPIPE};
use crate::scene::{self, Data, MEASURED, points};
use crate::shifted::{exr_planes, render, words};
use crate::{Shot, WIDE, check, shot};
use exr::prelude::FlatSamples;
use lasray::attribute::ClassMask;
use lasray::coords::HEIGHT_STEP;
use lasray::gpu::Gpu;
use lasray::render::camera::{Camera, Projection};
use lasray::render::image::MISS_CLASS;
use lasray::render::reference::ColumnMap;
use lasray::resident::pool::Access;
use lasray::source::FLAG_WITHHELD;
use std::fs;
use std::path::{Path, PathBuf};

/// Copies a LAS file, its scales, offsets and bounds (LAS 1.4 R15, table 3: bytes 131 to 227) multiplied by `factor`,
/// and then offsets and bounds moved by `by`.
fn changed(from: &Path, to: &Path, factor: f64, by: [f64; 3]) {
    let mut bytes = fs::read(from).unwrap();
    for field in 0..12 {
        let at = 131 + 8 * field;
        let value = f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
        // Scales and offsets come as x, y, z; bounds as largest and smallest of each.
        let moved = match field {
            0..3 => 0.0,
            3..6 => by[field - 3],
            _ => by[(field - 6) / 2],
        };
        bytes[at..at + 8].copy_from_slice(&(value * factor + moved).to_le_bytes());
    }
    fs::write(to, bytes).unwrap();
}

/// A corner of the town with its south-western corner at 0, 0 and its ground a little above 0.
fn town(folder: &Path) -> PathBuf {
    let (made, town) = (scene::town(folder, "made.las", [-80.0, -80.0], 90.0), folder.join("town.las"));
    changed(&made, &town, 1.0, [-511_920.0, -5_402_920.0, -200.0]);
    town
}

/// Class and distance of every pixel of an EXR; distances over `factor`.
fn seen(path: &Path, factor: f64) -> Vec<(u32, f64)> {
    let planes = exr_planes(path);
    let plane = |name: &str| &planes.iter().find(|(channel, _)| channel == name).unwrap().1;
    let FlatSamples::F32(distance) = plane("distance") else { panic!("distances are numbers") };
    words(plane("class")).into_iter().zip(distance.iter().map(|d| f64::from(*d) / factor)).collect()
}

#[test]
fn a_scaled_scene_gives_the_same_picture() {
    common::run("scaled::a_scaled_scene_gives_the_same_picture", LAVAPIPE, |_| {
        let folder = tempfile::tempdir().unwrap();
        let town = town(folder.path());
        // Arguments, given what a metre is in units and a place as they are written.
        type Arguments = fn(f64, &dyn Fn([f64; 3]) -> String) -> Vec<String>;
        let cases: [(&str, Arguments); 4] = [
            ("framed", |_, _| vec!["--color=class".into()]),
            ("from a place", |unit, place| {
                let (eye, target) = ([14.3125, 11.25, 26.09375], [61.75, 39.90625, 20.25]);
                vec![
                    "--shade=none".into(),
                    format!("--cell={}", 0.25 * unit),
                    format!("--eye={}", place(eye)),
                    format!("--target={}", place(target)),
                ]
            }),
            ("a map", |unit, _| {
                vec![
                    "--shade=none".into(),
                    format!("--ortho={}", 0.375 * unit),
                    format!("--cell={}", 0.5 * unit),
                ]
            }),
            ("from afar", |unit, _| {
                vec![
                    format!("--cell={}", 0.5 * unit),
                    format!("--orbit=40,20,{}", 50_000.0 * unit),
                    "--fov=0.2".into(),
                ]
            }),
        ];
        for (name, arguments) in cases {
            let picture = |log2: i32, up: f64| {
                let unit = f64::from(log2).exp2();
                let (input, output) = (folder.path().join("scaled.las"), folder.path().join("scaled.exr"));
                changed(&town, &input, unit, [0.0, 0.0, up * unit]);
                let place = |[e, n, u]: [f64; 3]| format!("{},{},{}", e * unit, n * unit, (u + up) * unit);
                render(&input, &output, &arguments(unit, &place));
                seen(&output, unit)
            };
            let wanted = picture(0, 0.0);
            let hits = wanted.iter().filter(|(class, _)| *class != MISS_CLASS).count();
            assert!(hits * 20 > wanted.len(), "{name}: {hits} hits");
            // Height steps are 1/16 to 1/2^20 of a cell, which is felt where rays are flat.
            // In units of a kilometre to a micrometre; at sea level, in mountains, and far above.
            for (log2, up) in [
                (-10, 0.0),
                (-10, 4096.0),
                (-4, 0.0),
                (0, 4096.0),
                (0, 65_536.0),
                (10, 4096.0),
                (13, -65_536.0),
                (20, 0.0),
                (20, 4096.0),
            ] {
                let found = picture(log2, up);
                let class = wanted.iter().zip(&found).filter(|(a, b)| a.0 != b.0).count();
                let far = wanted
                    .iter()
                    .zip(&found)
                    .filter(|(a, b)| a.0 == b.0 && a.0 != MISS_CLASS && (a.1 - b.1).abs() > 0.5 + 1e-6 * a.1)
                    .count();
                println!(
                    "{name}, 2^{log2}, {up} up: {class} of {} pixels differ, {far} in distance",
                    wanted.len()
                );
                assert!(
                    class * 1000 <= wanted.len() && far * 100 <= wanted.len(),
                    "{name}, 2^{log2}, {up} up: {class} of {} pixels differ, {far} in distance",
                    wanted.len()
                );
            }
        }
    });
}

/// From near, from above, and from ever farther away, all of it in the picture.
fn shots(data: &Data) -> Vec<Shot> {
    let (b, center) = (data.bounds, data.bounds.center());
    let radius = 0.5 * (b.max - b.min).length();
    let mut shots = vec![
        shot("oblique", Camera::frame(&b, [215.0, 35.0], WIDE, crate::SIZE).unwrap()),
        shot("down", Camera::frame(&b, [0.0, 90.0], WIDE, crate::SIZE).unwrap()),
    ];
    for (name, angles, far) in [
        ("2^21 units above", [0.0, 90.0], 21),
        ("2^24 units above", [0.0, 90.0], 24),
        ("2^24 units away", [37.0, 35.0], 24),
        ("2^30 units away", [37.0, 5.0], 30),
    ] {
        let distance = f64::from(far).exp2() + 0.3;
        let narrow = Projection::Perspective { fov: (2.2 * (radius / distance).atan()).to_degrees() };
        let parallel = Projection::Orthographic { units_per_pixel: 2.2 * radius / f64::from(crate::SIZE[1]) };
        for projection in [narrow, parallel] {
            shots.push(shot(name, Camera::orbit(center, angles, distance, projection).unwrap()));
        }
    }
    shots
}

fn check_town(
    gpu: &Gpu,
    path: &Path,
    cell: f64,
    step: f64,
    more: impl Fn(&Data) -> Vec<Shot>,
) -> Vec<String> {
    let data = Data::load(&[path.to_owned()], Some(cell));
    assert_eq!(data.grid.height_step, step, "cells of {cell}, {:?}", data.bounds);
    let mut scene = data.scene(gpu, Access::Address, MEASURED());
    let mut renderer = data.renderer(&scene);
    let points = points(path, &data.placement);
    let lattice = [data.grid.cell(), step];
    let map = ColumnMap::build(points, lattice, &ClassMask::default(), FLAG_WITHHELD);
    let name = path.file_name().unwrap().to_string_lossy().into_owned();
    let wrong = check(&data, &map, &mut scene, &mut renderer, &name, &more(&data));
    assert_eq!(gpu.messages(), [""; 0]);
    wrong
}

#[test]
fn far_eyes_and_heights_of_any_size_are_drawn_exactly() {
    common::run("scaled::far_eyes_and_heights_of_any_size_are_drawn_exactly", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let folder = tempfile::tempdir().unwrap();
        let town = town(folder.path());
        let made = |name: &str, factor: f64, by: [f64; 3]| {
            let path = folder.path().join(name);
            changed(&town, &path, factor, by);
            path
        };
        let mut wrong = check_town(&gpu, &town, 0.5, HEIGHT_STEP, shots);
        let millimetres = made("millimetres at 3000 m.las", 1000.0, [0.0, 0.0, 3e6]);
        wrong.extend(check_town(&gpu, &millimetres, 512.0, 2.0, shots));
        let centimetres = made("centimetres at 10^8.las", 100.0, [1e8, -1e8, 1e8]);
        wrong.extend(check_town(&gpu, &centimetres, 50.0, 0.125, shots));
        let deep = made("centimetres at -10^8.las", 100.0, [0.0, 0.0, -1e8]);
        wrong.extend(check_town(&gpu, &deep, 50.0, 0.125, shots));
        // A picture that is taller than whole height steps can be counted in.
        let wide = made("wide.las", 4096.0, [0.0, 0.0, -200_000.0]);
        wrong.extend(check_town(&gpu, &wide, 2048.0, HEIGHT_STEP, |data| {
            let center = data.bounds.center();
            let tall = |angles, far: f64| Camera::orbit(center, angles, far, WIDE).unwrap();
            vec![
                shot("tall", tall([215.0, 35.0], 3e6)),
                shot("level", tall([10.0, 3.0], 4.5e6)),
                shot(
                    "wide",
                    Camera::orbit(center, [20.0, 10.0], 1.2e6, Projection::Perspective { fov: 100.0 })
                        .unwrap(),
                ),
            ]
        }));
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    });
}

/// Files after what people ran into with other readers, which are no part of the repository.
#[test]
fn wide_files_are_drawn_like_small_ones() {
    let Some(folder) = scene::real_files().map(|folder| folder.join("reports")).filter(|f| f.is_dir()) else {
        return println!("skipped: no reports beside the real files");
    };
    common::run("scaled::wide_files_are_drawn_like_small_ones", LAVAPIPE, |_| {
        let output = tempfile::tempdir().unwrap();
        let picture = |name: &str, unit: f64| {
            let path = output.path().join("picture.exr");
            let arguments = ["--shade=none".to_owned(), format!("--cell={}", 1024.0 * unit)];
            render(&folder.join(name), &path, &arguments);
            seen(&path, unit)
        };
        let (control, wide) =
            (picture("wide_0.4M_units_control.laz", 1.0), picture("wide_2M_units.laz", 5.0));
        let differ = control.iter().zip(&wide).filter(|(a, b)| a.0 != b.0).count();
        let hits = control.iter().filter(|(class, _)| *class != MISS_CLASS).count();
        println!("{differ} of {} pixels differ, {hits} hits", control.len());
        assert!(hits * 10 > control.len() && differ * 1000 <= control.len(), "{differ} pixels differ");
    });
}
