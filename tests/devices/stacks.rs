//! Stacks over distance: what is thin stays, and what moves slowly changes slowly.

use crate::common::made::{field, write};
use crate::common::{self, LAVAPIPE};
use crate::looks::{Picture, render};
use lasray::attribute::class_color;
use std::path::PathBuf;

/// Exact colours of classes, by need, as coarse as pixels are.
const PLAIN: [&str; 8] = ["--color", "class", "--shade", "none", "--detail", "1", "--background", "none"];

fn is(class: u8) -> impl Fn(&[u8; 4]) -> bool {
    move |pixel| pixel[3] == 255 && pixel[..3] == class_color(class)
}

#[test]
fn a_wire_is_seen_from_5_kilometres() {
    common::run("stacks::a_wire_is_seen_from_5_kilometres", LAVAPIPE, |_| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("line.las");
        // Along 2 km, as many points as pulses meet.
        let sag = |x: f64| 20.0 + 6.0 * ((x / 200.0).fract() - 0.5).powi(2);
        let wire = (0..4000).map(|k| f64::from(k) * 0.5).map(|x| ([x, 100.3, sag(x)], 14));
        write(&path, field([2000.0, 200.0], 1.0, |x, _| Some((0.002 * x, 2))).chain(wire));
        let eye = "501000,4995670,2500";
        let view = [
            "--eye",
            eye,
            "--target",
            "501000,5000100,0",
            "--fov",
            "13",
            "--size",
            "640x360",
            "--cell",
            "0.5",
        ];
        let (picture, said) = render(&[path], &[&PLAIN[..], &view].concat());
        let seen = |class: u8| {
            let columns = |x: usize| picture.pixels.iter().skip(x).step_by(picture.width);
            (0..picture.width).filter(|&x| columns(x).any(is(class))).count()
        };
        println!("{said}wire in {} of {} columns of pixels", seen(14), seen(2));
        assert!(seen(2) > 500, "it fills the picture");
        assert!(seen(14) * 100 >= seen(2) * 98, "the wire has gaps");
        // Below it there is land, not a curtain: it is a line.
        let pixels = picture.pixels.iter().filter(|p| is(14)(p)).count();
        assert!(pixels < 4 * seen(14), "{pixels} pixels of wire");
    });
}

#[test]
fn on_a_slow_descent_pictures_change_slowly() {
    common::run("stacks::on_a_slow_descent_pictures_change_slowly", LAVAPIPE, |_| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("town.las");
        let run = std::process::Command::new(env!("CARGO_BIN_EXE_lasray"))
            .args(["synth", path.to_str().unwrap(), "--points", "300k"])
            .output()
            .unwrap();
        assert!(run.status.success());
        let frames = |surface: &str| -> Vec<Picture> {
            let frame = |k: i32| {
                let distance = 420.0 * 0.994_f64.powi(k);
                let orbit = format!("20,40,{distance}");
                let view = ["--orbit", &orbit, "--size", "256x144", "--surface", surface];
                render(&[PathBuf::from(&path)], &[&PLAIN[..], &view].concat()).0
            };
            (0..6).map(frame).collect()
        };
        let changed = |frames: &[Picture]| -> Vec<usize> {
            let differ =
                |pair: &[Picture]| pair[0].pixels.iter().zip(&pair[1].pixels).filter(|(a, b)| a != b).count();
            frames.windows(2).map(differ).collect()
        };
        let [columns, stacks] = ["columns", "stacks"].map(|surface| changed(&frames(surface)));
        println!("pixels of 36,864 that change from frame to frame: columns {columns:?}, stacks {stacks:?}");
        // Crowns of single points have more edges than pillars; no frame changes as a whole.
        let mean = |of: &[usize]| of.iter().sum::<usize>() / of.len();
        assert!(mean(&stacks) < 2 * mean(&columns), "{columns:?} {stacks:?}");
        assert!(stacks.iter().all(|&n| n < 2 * mean(&stacks)), "one frame jumps: {stacks:?}");
    });
}
