//! How pictures look, by measures: where the data is in the frame, how much light and shade there is, where it ends.

use crate::common::made::{field, write};
use crate::common::{self, LAVAPIPE};
use crate::scene::real_files;
use std::path::{Path, PathBuf};
use std::process::Command;

const SIZE: [usize; 2] = [320, 180];

/// Red, green, blue and alpha of the pixels of a picture, row by row.
pub struct Picture {
    pub width: usize,
    pub pixels: Vec<[u8; 4]>,
}

pub fn render(inputs: &[PathBuf], arguments: &[&str]) -> (Picture, String) {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("picture.png");
    let run = Command::new(env!("CARGO_BIN_EXE_lasray"))
        .arg("render")
        .args(inputs)
        .args([Path::new("--output"), &output])
        .args(["--no-cache"])
        .args(arguments)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(run.status.success(), "{arguments:?}: {said}");
    let file = std::io::BufReader::new(std::fs::File::open(&output).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    let channels = bytes.len() / (info.width * info.height) as usize;
    let pixel = |p: &[u8]| [p[0], p[1], p[2], p.get(3).copied().unwrap_or(255)];
    (Picture { width: info.width as usize, pixels: bytes.chunks_exact(channels).map(pixel).collect() }, said)
}

impl Picture {
    /// Rows and columns, from 0 to 1, in which there is data: first and last, from the left and from the top.
    fn extent(&self) -> [[f64; 2]; 2] {
        let height = self.pixels.len() / self.width;
        let mut ends = [[usize::MAX, 0]; 2];
        for (at, _) in self.pixels.iter().enumerate().filter(|(_, p)| p[3] > 0) {
            for (ends, v) in ends.iter_mut().zip([at % self.width, at / self.width]) {
                *ends = [ends[0].min(v), ends[1].max(v + 1)];
            }
        }
        let share = |[a, b]: [usize; 2], all: usize| [a as f64 / all as f64, b as f64 / all as f64];
        [share(ends[0], self.width), share(ends[1], height)]
    }

    /// Value that this share of the opaque pixels is not above.
    fn quantile(&self, share: f64) -> u8 {
        let mut values: Vec<u8> = self.pixels.iter().filter(|p| p[3] == 255).map(|p| p[1]).collect();
        values.sort_unstable();
        values[(share * (values.len() - 1) as f64) as usize]
    }
}

/// Whether `picture` has the data within 8 % of two opposite edges, and about as far from the one as from the other, both
/// ways.
fn assert_framed(picture: &Picture, what: &str) {
    let ends = picture.extent();
    let margins = ends.map(|[first, last]| [first, 1.0 - last]);
    println!("{what}: margins {margins:.3?}");
    let fills = |[a, b]: &[f64; 2]| (0.004..0.08).contains(a) && (0.004..0.08).contains(b);
    assert!(margins.iter().any(fills), "{what}: neither way fills the frame: {margins:.3?}");
    for [a, b] in margins {
        assert!(a > 0.004 && b > 0.004, "{what}: cut off: {margins:.3?}");
        assert!((a - b).abs() < 0.08, "{what}: not in the middle: {margins:.3?}");
    }
}

#[test]
fn the_data_fills_the_frame() {
    common::run("looks::the_data_fills_the_frame", LAVAPIPE, |_| {
        let folder = tempfile::tempdir().unwrap();
        let corridor = folder.path().join("corridor.las");
        write(
            &corridor,
            field([400.0, 900.0], 2.0, |x, y| ((x - y * 0.4).abs() < 25.0).then_some((x * 0.05, 2))),
        );
        let mut sets = vec![vec![corridor]];
        if let Some(data) = real_files() {
            let real = [
                "powerline/12BZ1_21.laz",
                "urban/fusa.laz",
                "urban/multitile_delft",
                "urban/multitile_ign",
                "forest/MixedConifer.laz",
                "forest/LASexample2.las",
                "water/lake.laz",
                "rgb/red-rocks-merged.laz",
                "ground_truth/samp31-utm.laz",
                "autzen/autzen_trim.laz",
            ];
            sets.extend(real.map(|name| vec![data.join(name)]));
        }
        let size = SIZE.map(|side| side.to_string()).join("x");
        for set in sets {
            let name = set[0].display().to_string();
            for orbit in ["0,35", "60,20"] {
                let arguments = ["--size", &size, "--orbit", orbit, "--background", "none", "--samples", "1"];
                assert_framed(&render(&set, &arguments).0, &format!("{name} from {orbit}"));
                // Without light columns go down without end, but their tops are framed.
                let exact = [&arguments[..], &["--shade", "none", "--detail", "1"]].concat();
                let [[left, right], [top, _]] = render(&set, &exact).0.extent();
                let [left, right, top] = [left, 1.0 - right, top];
                println!("{name} from {orbit}, exact: {left:.3}, {right:.3}, {top:.3}");
                assert!(left > 0.004 && right > 0.004 && top > 0.004, "{name} from {orbit}: cut off");
                assert!((left - right).abs() < 0.08, "{name} from {orbit}: not in the middle");
            }
        }
    });
}

#[test]
fn relief_takes_the_range_of_greys() {
    common::run("looks::relief_takes_the_range_of_greys", LAVAPIPE, |_| {
        let Some(data) = real_files() else { return };
        for name in ["urban/fusa.laz", "urban/multitile_delft"] {
            // Every height has the same grey.
            let grey = ["--color", "height", "--ramp", "grey", "--range=-61550,38450"];
            let map = ["--ortho", "0.5", "--background", "none"];
            // Among crowns that are solid to the ground it is darker.
            for (surface, darkest) in [("columns", 66), ("stacks", 75)] {
                let surface = ["--surface", surface];
                let (picture, _) = render(&[data.join(name)], &[&grey[..], &map, &surface].concat());
                let [low, high] = [0.02, 0.98].map(|share| picture.quantile(share));
                println!("{name}, {surface:?}: 2 to 98 % of the greys are {low} to {high}");
                assert!(low <= darkest && high >= 212, "{name}: {low} to {high}");
            }
        }
    });
}

#[test]
fn the_sky_has_no_step() {
    common::run("looks::the_sky_has_no_step", LAVAPIPE, |_| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flat.las");
        write(&path, field([50.0, 50.0], 1.0, |_, _| Some((0.0, 2))));
        // Away from the data, the horizon in the middle.
        let camera = ["--eye", "500100,5000100,20", "--target", "500200,5000200,20", "--size", "16x400"];
        let (picture, _) = render(&[path], &camera);
        let rows: Vec<[u8; 4]> = picture.pixels.chunks(picture.width).map(|row| row[0]).collect();
        for (at, pair) in rows.windows(2).enumerate() {
            let step = (0..3).map(|k| pair[0][k].abs_diff(pair[1][k])).max().unwrap();
            assert!(step <= 2, "row {at}: {pair:?}");
        }
        assert_ne!(rows[0], rows[200], "it is a sky");
    });
}

/// Houses stand at the edge of a slope; below them there is a thin plain slab, and nothing below that.
#[test]
fn data_ends_in_a_thin_plain_slab() {
    common::run("looks::data_ends_in_a_thin_plain_slab", LAVAPIPE, |_| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("slope.las");
        let ground = |x: f64| 0.3 * x;
        write(&path, field([200.0, 200.0], 1.0, |x, _| Some((ground(x), 2))));
        let level = ["--orbit", "0,4", "--size", "800x300", "--background", "none", "--samples", "1"];
        let (picture, _) = render(&[path], &[&level[..], &["--color", "class"]].concat());
        // In each column of pixels: the southern side is one band, plain, as thick at the foot as at the top.
        let plain = |p: &[u8; 4]| p[3] == 255 && p[0].abs_diff(p[1]) < 12 && p[1].abs_diff(p[2]) < 12;
        let side: Vec<usize> = (0..picture.width)
            .map(|x| picture.pixels.iter().skip(x).step_by(picture.width).filter(|p| plain(p)).count())
            .filter(|&rows| rows > 0)
            .collect();
        let (least, most) = (*side.iter().min().unwrap(), *side.iter().max().unwrap());
        println!("{} columns, {least} to {most} pixels thick", side.len());
        // 200 units are some 760 pixels: 1 % and a cell are 12.
        assert!(side.len() > 600 && most <= 20, "{} columns, {least} to {most}", side.len());
    });
}

/// Colours and framing are those of the classes that are asked for, cells those of all.
#[test]
fn a_picture_starts_from_what_is_asked_for() {
    common::run("looks::a_picture_starts_from_what_is_asked_for", LAVAPIPE, |_| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("forest.las");
        // A crown everywhere, and ground every eight units in the western half.
        let crown = field([128.0, 128.0], 0.5, |x, y| Some((20.0 + (x * 0.7).sin() * (y * 0.9).cos(), 5)));
        let ground = field([64.0, 128.0], 8.0, |x, _| Some((0.02 * x, 2)));
        write(&path, crown.chain(ground));
        let arguments = |classes: &'static [&'static str]| {
            [&["--size", "320x180", "--background", "none", "--samples", "1"], classes].concat()
        };
        // Solid to the ground where there is none in the sample, too.
        let (all, said_all) = render(std::slice::from_ref(&path), &arguments(&["--surface", "columns"]));
        let (ground, said) = render(
            std::slice::from_ref(&path),
            &arguments(&["--classes", "2", "--color", "height", "--ramp", "grey", "--cell", "8"]),
        );
        let (_, said_usual) = render(std::slice::from_ref(&path), &arguments(&["--classes", "2"]));
        assert!(said_all.contains("cells of 0.5"), "{said_all}");
        assert!(said_usual.contains("cells of 0.5"), "{said_usual}");
        assert!(said.contains("cells of 8 "), "{said}");
        // From west to east through the whole ramp, not one colour of the low end.
        assert!(ground.quantile(0.95) - ground.quantile(0.05) > 60, "one grey");
        assert_framed(&ground, "the ground alone");
        assert_framed(&all, "everything");
        // Of a larger set, too, what is rare is framed by itself, and all of it: the one pylon of a line.
        if let Some(data) = real_files() {
            let (pylon, _) = render(&[data.join("powerline/12BZ1_21.laz")], &arguments(&["--classes", "15"]));
            assert_framed(&pylon, "a pylon");
        }
    });
}
