//! What people type in their first minutes: each line does what it says, or says what to type.

use super::made::{Made, Packing, data_dir};
use super::{las, points_at, run, words};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// Runs `line` in `folder`; exit code, standard error, standard output.
fn typed(folder: &Path, line: &str) -> (Option<i32>, String, String) {
    let ran = run(folder, &words(line.split_whitespace()), &[]);
    assert!(!ran.said.contains("panicked"), "{line}: {}", ran.said);
    (ran.code, ran.said, ran.printed)
}

/// The same, which must succeed; what it said.
fn done(folder: &Path, line: &str) -> String {
    let (code, said, _) = typed(folder, line);
    assert_eq!(code, Some(0), "{line}: {said}");
    said
}

/// The same, which must be refused as wrong arguments, with these words, and leave everything as it is.
fn refused(folder: &Path, line: &str, says: &str) {
    let before = names(folder);
    let (code, said, _) = typed(folder, line);
    assert_eq!(code, Some(2), "{line}: {said}");
    assert!(said.contains(says), "{line}: {said}");
    assert_eq!(names(folder), before, "{line}");
}

/// Files in a folder, caches aside.
fn names(folder: &Path) -> Vec<String> {
    let entries =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned());
    let mut names: Vec<_> = entries.filter(|name| name != "cache").collect();
    names.sort();
    names
}

/// Width, height, pixels and texts of a PNG.
fn png(path: &Path) -> ([u32; 2], Vec<u8>, BTreeMap<String, String>) {
    let file = std::io::BufReader::new(fs::File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut pixels).unwrap();
    let info = reader.info();
    let texts = info.uncompressed_latin1_text.iter().map(|t| (t.keyword.clone(), t.text.clone())).collect();
    ([info.width, info.height], pixels, texts)
}

/// A flat field of 3 points a unit over 60 x 40 units from `corner` on, in steps of 0.01, 100 units high; the points of
/// its eastern half are 116 units high and of class 5, the others of class 2. `vlrs` name its system.
fn field(corner: [f64; 2], vlrs: Vec<(&'static str, u16, Vec<u8>)>) -> Vec<u8> {
    let mut made = Made::new(3, Packing::Plain, 60 * 40 * 3);
    for (k, record) in made.records.chunks_mut(34).enumerate() {
        let (x, y) = (k % 180, k / 180);
        let is_tree = x >= 90;
        let at = [x as i32 * 33 + 16, y as i32 * 100 + 50, if is_tree { 11_600 } else { 10_000 }];
        for (axis, at) in at.into_iter().enumerate() {
            record[4 * axis..4 * axis + 4].copy_from_slice(&at.to_le_bytes());
        }
        record[14] = 0x09;
        record[15] = if is_tree { 5 } else { 2 };
        record[28..34].copy_from_slice(&[0; 6]);
    }
    made.vlrs = vlrs;
    made.header = Some(([0.01; 3], [corner[0], corner[1], 0.0]));
    made.bytes()
}

/// GeoTIFF keys of a projected system in a unit: 9001 metre, 9003 US survey foot.
fn projected(unit: u16) -> Vec<(&'static str, u16, Vec<u8>)> {
    let keys = [1u16, 1, 0, 3, 1024, 0, 1, 1, 3072, 0, 1, 32767, 3076, 0, 1, unit];
    vec![("LASF_Projection", 34735, keys.iter().flat_map(|key| key.to_le_bytes()).collect())]
}

/// GeoTIFF keys of WGS 84 in degrees.
fn degrees() -> Vec<(&'static str, u16, Vec<u8>)> {
    let keys = [1u16, 1, 0, 2, 1024, 0, 1, 2, 2048, 0, 1, 4326];
    vec![("LASF_Projection", 34735, keys.iter().flat_map(|key| key.to_le_bytes()).collect())]
}

const FLY: &str = r#"{"version": 1, "fps": 2, "keyframes": [
    {"time": 0, "eye": [0, -300, 500], "target": [0, 0, 0]}, {"time": 1, "eye": [9, -300, 500], "target": [0, 0, 0]}]}"#;

#[test]
fn without_a_name_a_picture_has_the_first_inputs() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir_all(at("tiles v2/sub")).unwrap();
    for name in ["good.las", "b.LAS", "tiles v2/first.las", "tiles v2/sub/second.las"] {
        fs::write(at(name), las(300)).unwrap();
    }
    fs::write(at("c.copc.laz"), Made::new(7, Packing::Copc(vec![30, 50]), 80).bytes()).unwrap();
    fs::write(at("list.txt"), "good.las\nb.LAS\n").unwrap();
    fs::write(at("fly.json"), FLY).unwrap();
    let cases: [(&[&str], &[&str]); 11] = [
        (&["good.las"], &["good.png"]),
        (&["b.LAS", "good.las"], &["b.png"]),
        (&["good.las", "b.LAS"], &["good.png"]),
        (&["c.copc.laz"], &["c.png"]),
        (&["tiles v2/", "good.las"], &["tiles v2.png"]),
        (&["tiles v2/sub/.."], &["tiles v2.png"]),
        (&["./tiles v2/sub/second.las"], &["second.png"]),
        (&["@list.txt"], &["list.png"]),
        (&["tiles v2/*.las"], &["first.png"]),
        (&["tiles v2", "--each"], &["first.png", "second.png"]),
        (&["good.las", "--path", "fly.json"], &["good-0000.png", "good-0001.png"]),
    ];
    for (line, pictures) in cases {
        let before = names(folder.path());
        // Twice: what was written here is written again.
        for _ in 0..2 {
            let arguments = [&["render"], line, &["--size", "32x18"]].concat();
            let ran = run(folder.path(), &words(arguments.iter().copied()), &[]);
            assert_eq!(ran.code, Some(0), "{line:?}: {}", ran.said);
        }
        let new: Vec<_> = names(folder.path()).into_iter().filter(|name| !before.contains(name)).collect();
        assert_eq!(new, pictures, "{line:?}");
        pictures.iter().for_each(|name| fs::remove_file(at(name)).unwrap());
    }
    // Nothing is lost that the user did not name: a picture of another program, an input, a point cloud.
    fs::write(at("good.png"), b"\x89PNG\r\n\x1a\nof another program").unwrap();
    refused(
        folder.path(),
        "render good.las",
        "-o good.png: refused: the file there is not of lasray's making",
    );
    assert_eq!(fs::read(at("good.png")).unwrap(), b"\x89PNG\r\n\x1a\nof another program");
    // The same name, typed, is meant.
    done(folder.path(), "render good.las -o good.png --size 32x18");
    fs::remove_file(at("good.png")).unwrap();
    fs::hard_link(at("good.las"), at("good.png")).unwrap();
    refused(folder.path(), "render good.las", "-o good.png: refused: it is an input of this command");
    fs::remove_file(at("good.png")).unwrap();
    fs::write(at("good.png"), las(30)).unwrap();
    refused(folder.path(), "render good.las", "-o good.png: refused: the file there is a point cloud");
}

#[test]
fn the_last_word_may_be_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir(at("tiles")).unwrap();
    ["tiles/a.las", "tiles/b.las", "good.las"].iter().for_each(|name| fs::write(at(name), las(300)).unwrap());
    fs::write(at("cloud.png"), las(300)).unwrap();
    fs::write(at("photo.png"), b"\x89PNG\r\n\x1a\nof another program").unwrap();
    let here = folder.path();
    for line in ["render tiles out.png", "render good.las tiles out.exr", "render --size 32x18 tiles out.JPG"]
    {
        let (said, name) = (
            done(
                here,
                &format!("{line} --size 32x18").replacen(
                    "--size 32x18 ",
                    "",
                    usize::from(line.contains("--size")),
                ),
            ),
            line.rsplit(' ').next().unwrap(),
        );
        assert!(said.contains(&format!("{name}: 32x18 pixels")) && at(name).exists(), "{said}");
        // Again, over what was written.
        done(here, &format!("render tiles {name} --size 32x18"));
    }
    done(here, "render tiles --each {stem}.png --size 32x18");
    // So it may of a saved view, whose inputs are not typed.
    let camera = r#""version": 1, "keyframes": [{"time": 0, "eye": [0, 0, 900], "target": [0, 1, 0]}]"#;
    fs::write(at("view.json"), format!(r#"{{{camera}, "view": {{"inputs": ["good.las"]}}}}"#)).unwrap();
    let said = done(here, "render --path view.json seen.png --size 32x18");
    assert!(said.contains("seen.png: 1 picture of 32x18 pixels") && at("seen.png").exists(), "{said}");
    assert!(at("a.png").exists() && at("b.png").exists());
    // A point cloud by its bytes is an input, whatever it is called.
    let said = done(here, "render good.las cloud.png -o both.png --size 32x18");
    assert!(said.contains("600 points"), "{said}");
    let said = done(here, "render good.las cloud.png --size 32x18");
    assert!(said.contains("good.png: 32x18 pixels, 600 points"), "{said}");
    refused(here, "render tiles photo.png", "photo.png: is it the picture to write, or an input?");
    refused(here, "render tiles new.png -o other.png", "new.png and -o other.png: two names for the picture");
    refused(here, "render new.png tiles", "new.png: no such file; the picture to write comes last");
    refused(here, "render new.png", "no INPUT");
    refused(here, "render tiles new.tif", "new.tif: pictures are written as .png, .jpg or .exr");
    refused(here, "render --demo tiles", "--demo cannot be used with inputs, such as tiles");
    assert_eq!(fs::read(at("photo.png")).unwrap(), b"\x89PNG\r\n\x1a\nof another program");
}

#[test]
fn a_jpeg_is_written_with_what_belongs_to_it() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir(at("tiles")).unwrap();
    fs::write(at("tiles/a.las"), field([500.0, 700.0], projected(9001))).unwrap();
    let here = folder.path();
    let size = |name: &str| {
        let mut decoder =
            jpeg_decoder::Decoder::new(std::io::BufReader::new(fs::File::open(at(name)).unwrap()));
        let pixels = decoder.decode().unwrap();
        let info = decoder.info().unwrap();
        (info.width, info.height, pixels)
    };
    done(here, "render tiles -o x.jpg --size 64x36");
    done(here, "render tiles -o x.png --size 64x36");
    let ((width, height, lossy), (_, exact, _)) = (size("x.jpg"), png(&at("x.png")));
    assert_eq!((width, height), (64, 36));
    let off: u64 = lossy.iter().zip(&exact).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    assert!(off < 6 * exact.len() as u64, "{off} over {} bytes", exact.len());
    // A map among the inputs, time and again: it is known as ours, and so is what lies beside it.
    for units in ["1", "2"] {
        let said = done(here, &format!("render tiles --ortho {units} -o tiles/map.jpeg"));
        assert!(!said.contains("map.jgw"), "{said}");
        let world = fs::read_to_string(at("tiles/map.jgw")).unwrap();
        assert!(world.starts_with(&format!("{units}\n0\n0\n-{units}\n")), "{world}");
        assert_eq!(size("tiles/map.jpeg").0, if units == "1" { 60 } else { 30 });
    }
    refused(here, "render tiles -o y.jpg --background none", "y.jpg: a JPEG has no transparent background");
    refused(
        here,
        "render tiles --ortho 1 -o y.jpg --json y.jgw",
        "--json y.jgw: refused: it is written beside the map",
    );
}

#[test]
fn sizes_and_pixels_as_they_are_typed() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir(at("tiles")).unwrap();
    fs::write(at("tiles/a.las"), field([500.0, 700.0], projected(9001))).unwrap();
    let here = folder.path();
    for (line, size) in [
        ("--size 64", [64, 36]),
        ("--size 80,60", [80, 60]),
        ("--size 80x60", [80, 60]),
        // A pixel a cell, whatever stands behind it.
        ("--ortho --cell 2", [30, 20]),
        ("--cell 0.5 --ortho", [119, 78]),
        ("--ortho --cell 50cm", [119, 78]),
        ("--ortho=cell --cell 1m", [60, 40]),
        ("--ortho 2", [30, 20]),
        ("--ortho 200cm", [30, 20]),
        ("--ortho=4", [15, 10]),
    ] {
        done(here, &format!("render {line} tiles -o a.png"));
        assert_eq!(png(&at("a.png")).0, size, "{line}");
        done(here, &format!("render tiles {line} -o a.png"));
        assert_eq!(png(&at("a.png")).0, size, "{line}");
    }
    refused(
        here,
        "render tiles --size wide -o b.png",
        "'wide' is not WIDTHxHEIGHT such as 1280x720, nor a width",
    );
    refused(here, "render tiles --ortho 0 -o b.png", "0 is not above 0");
    refused(here, "render --ortho -o b.png", "<INPUT>");
    let help = typed(here, "render --help").2;
    assert!(help.contains("a width alone, 800, is 16:9"), "{help}");
}

#[test]
fn cells_have_units() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    for (name, vlrs) in
        [("metres.las", projected(9001)), ("feet.las", projected(9003)), ("none.las", Vec::new())]
    {
        fs::write(here.join(name), field([500.0, 700.0], vlrs)).unwrap();
    }
    for (input, cell, cells) in [
        ("metres.las", "50cm", "cells of 0.5 m"),
        ("metres.las", "0.5", "cells of 0.5 m"),
        ("metres.las", "500mm", "cells of 0.5 m"),
        ("metres.las", "1.5ft", "cells of 0.4572 m"),
        ("feet.las", "2us-ft", "cells of 2 ftUS"),
        ("feet.las", "1m", "cells of 3.280833 ftUS"),
        ("feet.las", "2", "cells of 2 ftUS"),
        ("none.las", "2", "cells of 2 units"),
    ] {
        let said = done(here, &format!("render {input} --cell {cell} -o a.png --size 32x18"));
        assert!(said.contains(cells), "{cell}: {said}");
    }
    let line = "render none.las -o b.png --size 32x18";
    refused(
        here,
        &format!("{line} --cell 50cm"),
        "--cell 50cm: nothing says which unit the coordinates are in",
    );
    refused(
        here,
        &format!("{line} --ortho 50cm"),
        "--ortho 50cm: nothing says which unit the coordinates are in",
    );
    refused(here, &format!("{line} --cell 5furlong"), "'furlong' is no unit: mm, cm, m, km, ft, us-ft or in");
}

/// Words for colours and classes come to the same picture as numbers and names of their own.
#[test]
fn colours_and_classes_have_words() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    fs::write(here.join("a.las"), field([500.0, 700.0], projected(9001))).unwrap();
    let draw = |more: &str| {
        done(here, &format!("render a.las -o a.png --size 64x36 --shade none {more}"));
        png(&here.join("a.png")).1
    };
    let all = draw("");
    for (typed, meant) in [
        ("--colour elevation", "--color height"),
        ("--color z", "--color height"),
        ("--color classification", "--color class"),
        ("--color returns", "--color return"),
        ("--colour=Intensity", "--color intensity"),
        ("--hide vegetation", "--hide 3,4,5"),
        ("--hide High-Vegetation", "--hide 5"),
        ("--classes building,ground", "--classes 2,6"),
        ("--classes GROUND,noise", "--classes 2,7,18"),
    ] {
        let (typed, meant) = (draw(typed), draw(meant));
        assert!(typed == meant && meant.len() == all.len(), "{typed:?}");
    }
    assert!(draw("--hide vegetation") != draw("") && draw("--color z") != draw("--color class"));
    refused(
        here,
        "render a.las --hide vegetaton",
        "'vegetaton' is not a class: those are 0 to 255, or ground (2), vegetation (3,4,5)",
    );
    refused(here, "render a.las --color beige", "height (or elevation, z)");
}

/// `+3` is three above what is shown at that place: of the visible classes, where cells are finest.
#[test]
fn eyes_stand_above_what_is_shown() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    fs::write(here.join("a.las"), field([500.0, 700.0], projected(9001))).unwrap();
    let eye = |more: &str| {
        done(here, &format!("render a.las -o a.png --size 32x18 --cell 0.5 {more}"));
        let text = |key: &str| png(&here.join("a.png")).2[key].clone();
        [text("Eye"), text("Target")]
    };
    let west_and_east = "--eye 510.25,720.75,+3 --target 550.25,720.75,+0.5";
    for way in ["", "--shade none", "--wait none", "--detail 0"] {
        let places = eye(&format!("{west_and_east} {way}"));
        assert_eq!(places, ["510.250,720.750,103.000", "550.250,720.750,116.500"], "{way}");
    }
    assert_eq!(eye("--eye 550.25,720.75,+3 --target 510,720,0")[0], "550.250,720.750,119.000");
    // As it is shown: twice as high above the lowest point.
    assert_eq!(eye("--eye 550.25,720.75,+3 --target 510,720,0 --z-scale 2")[0], "550.250,720.750,135.000");
    assert_eq!(
        eye("--eye 550.25,720.75,+3 --target 510,720,0 --z-scale 900")[0],
        "550.250,720.750,14503.000"
    );
    let picture = |more: &str| {
        eye(more);
        png(&here.join("a.png")).1
    };
    assert!(picture(west_and_east) == picture("--eye 510.25,720.75,103 --target 550.25,720.75,116.5"));
    for place in ["800,720", "550.25,720.75"] {
        // Outside of the data; where everything is hidden.
        let line =
            format!("render a.las -o b.png --eye {place},+3 --target 510,720,0 --cell 0.5 --hide vegetation");
        refused(here, &line, &format!("--eye {place},+3: nothing is shown there"));
    }
    refused(
        here,
        "render a.las -o b.png --eye 1,2 --target 1,2,3",
        "U may be +3: 3 above what is shown there",
    );
    if cfg!(feature = "view") {
        refused(here, "view a.las --eye 510,720,+3 --target 1,2,3", "or draw it with `lasray render`");
    }
}

#[test]
fn words_that_are_no_commands_are_inputs() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    if cfg!(feature = "view") {
        for line in ["nosuchfolder", "view nosuchfolder", "north", "./nosuch", "gone.las --size 800"] {
            let (code, said, _) = typed(here, line);
            assert_eq!(code, Some(1), "{line}: {said}");
            let name = line.split(' ').find(|word| *word != "view").unwrap();
            assert!(said.starts_with(&format!("error: {name}: no such file or folder\n")), "{line}: {said}");
            assert!(said.ends_with("\n1 of 1 input left out or failed\n"), "{said}");
        }
    }
    for (line, tip) in [("rendre a.las", Some("'render'")), ("inof a.las", Some("'info'"))] {
        let (code, said, _) = typed(here, line);
        assert_eq!(code, Some(2), "{line}: {said}");
        assert!(tip.is_none_or(|tip| said.contains(tip)), "{line}: {said}");
    }
    fs::write(here.join("a.las"), las(30)).unwrap();
    for option in ["--sun 3", "--north", "--legend", "--wrong"] {
        for command in ["render", "info", "bench"] {
            let (code, said, _) = typed(here, &format!("{command} a.las {option}"));
            assert_eq!(code, Some(2), "{said}");
            let name = option.split(' ').next().unwrap();
            assert!(
                said.contains(&format!("'{name}'")) && !said.contains("tip"),
                "{command} {option}: {said}"
            );
            assert!(!said.contains("--json"), "{command} {option}: {said}");
        }
    }
    let (_, said, _) = typed(here, "render a.las --clases 2");
    assert!(said.contains("a similar argument exists: '--classes'"), "{said}");
}

/// The six numbers of a world file.
fn world(path: &Path) -> [f64; 6] {
    let text = fs::read_to_string(path).unwrap();
    let numbers: Vec<f64> = text.lines().map(|line| line.parse().unwrap()).collect();
    numbers.try_into().unwrap()
}

/// Neighbours that were drawn apart fit: their pixels lie on one grid.
#[test]
fn maps_of_neighbours_fit() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    // Corners that are no multiples of anything.
    fs::write(here.join("west.las"), field([500_000.13, 6_000_000.37], projected(9001))).unwrap();
    fs::write(here.join("east.las"), field([500_060.29, 6_000_011.91], projected(9001))).unwrap();
    for units in ["0.5", "0.7", "2", "25cm"] {
        let of = |name: &str, more: &str| {
            done(here, &format!("render {name}.las -o {name}.png --ortho {units} {more}"));
            (world(&here.join(name).with_extension("pgw")), png(&here.join(name).with_extension("png")).0)
        };
        for more in ["", "--size 33x20", "--target 500020.2,6000013.3,0"] {
            let ([(west, size), (east, _)], side) = ([of("west", more), of("east", more)], west_side(units));
            assert_eq!(west[..4], [side, 0.0, 0.0, -side], "{units}");
            for (axis, sign) in [(4, 1.0), (5, -1.0)] {
                let apart = (east[axis] - west[axis]) / side;
                assert!((apart - apart.round()).abs() < 1e-6, "{units} {more}: {apart} pixels apart");
                // Edges, half a pixel from centres, lie on multiples of a pixel.
                let edge = (west[axis] - sign * 0.5 * side) / side;
                assert!((edge - edge.round()).abs() < 1e-4, "{units} {more}: {edge}");
            }
            if more.is_empty() {
                // All points are in it, with less than a pixel around them.
                let [east_most, south_most] = [
                    west[4] + (f64::from(size[0]) - 0.5) * side,
                    west[5] - (f64::from(size[1]) - 0.5) * side,
                ];
                let points = [500_000.13 + 179.0 * 0.33 + 0.16, 6_000_000.37 + 0.5];
                assert!((-1e-6..side).contains(&(east_most - points[0])), "{east_most}");
                assert!((-1e-6..side).contains(&(points[1] - south_most)), "{south_most}");
            }
        }
    }
    // A place that was typed stays where it is.
    let line = "render west.las -o placed.png --ortho 2 --size 10x10 --eye 500020.3,6000013.3,300 --target 500020.3,6000013.3,0";
    done(here, line);
    let [.., e, n] = world(&here.join("placed.pgw"));
    assert!((e - 500_011.3).abs() < 1e-6 && (n - 6_000_022.3).abs() < 1e-6, "{e} {n}");
}

fn west_side(units: &str) -> f64 {
    units.strip_suffix("cm").map_or_else(|| units.parse().unwrap(), |cm| cm.parse::<f64>().unwrap() / 100.0)
}

/// `--each`: one cell size, one range of colours, one grid, and a name for each.
#[test]
fn pictures_of_each_file_go_together() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    for name in ["a", "b", "c"] {
        fs::create_dir(here.join(name)).unwrap();
    }
    // The second is coarser, the third far higher; all are called the same.
    fs::write(here.join("a/tile.las"), field([500.13, 700.37], projected(9001))).unwrap();
    let mut sparse = Made::new(3, Packing::Plain, 400);
    for (k, record) in sparse.records.chunks_mut(34).enumerate() {
        for (axis, at) in
            [(k % 20) as i32 * 300, (k / 20) as i32 * 200, 13_000 + k as i32].into_iter().enumerate()
        {
            record[4 * axis..4 * axis + 4].copy_from_slice(&at.to_le_bytes());
        }
        record[15] = 2;
        record[28..34].copy_from_slice(&[0; 6]);
    }
    sparse.vlrs = projected(9001);
    sparse.header = Some(([0.01; 3], [560.0, 700.0, 0.0]));
    fs::write(here.join("b/tile.las"), sparse.bytes()).unwrap();
    fs::write(here.join("c/other.las"), field([620.77, 700.0], projected(9001))).unwrap();
    let said = done(here, "render a b c --each -o {stem}.png --ortho --color height");
    assert_eq!(
        names(here).into_iter().filter(|name| name.ends_with(".png")).collect::<Vec<_>>(),
        ["a-tile.png", "b-tile.png", "other.png"],
        "{said}"
    );
    let lines: Vec<_> = said.lines().filter(|line| line.contains(" pixels, ")).collect();
    let shared = |line: &str| line.split("cells of ").nth(1).unwrap().to_owned();
    assert_eq!(lines.len(), 3, "{said}");
    assert!(lines.iter().all(|line| shared(line) == shared(lines[0])), "{said}");
    let maps: Vec<_> =
        ["a-tile", "b-tile", "other"].iter().map(|n| world(&here.join(n).with_extension("pgw"))).collect();
    for map in &maps {
        assert_eq!(map[..4], maps[0][..4]);
        for axis in [4, 5] {
            let apart = (map[axis] - maps[0][axis]) / maps[0][0];
            assert!((apart - apart.round()).abs() < 1e-6, "{apart}");
        }
    }
    // Alone, the same file has cells and a range of its own.
    let alone = done(here, "render b --ortho --color height -o alone.png");
    let alone = alone.lines().find(|line| line.contains(" pixels, ")).unwrap();
    assert!(shared(alone) != shared(lines[0]), "{alone}");
    // Lit ones end below their own points, exact ones are drawn, too.
    for more in ["", "--shade none"] {
        done(here, &format!("render a b c --each -o lit-{{stem}}.png --size 64x36 {more}"));
        for name in ["lit-a-tile.png", "lit-b-tile.png", "lit-other.png"] {
            let pixels = png(&here.join(name)).1;
            assert!(pixels.chunks(3).any(|p| p != &pixels[..3]), "{name} {more}: nothing is in the picture");
        }
    }
}

/// Many files share an opening sample, which sees little of each: each picture holds all of its file's points even so.
#[test]
fn pictures_of_many_files_are_whole() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let made = typed(here, "synth tiles --points 900k --tiles 3x2 --size 80 -q");
    assert_eq!(made.0, Some(0), "{}", made.1);
    let said = done(here, "render tiles --each --ortho 2 -o {stem}.png");
    let pictures: Vec<_> = said.lines().filter(|line| line.contains(" pixels, ")).collect();
    assert_eq!(pictures.len(), 6, "{said}");
    for line in pictures {
        // Tiles begin at multiples of a pixel; a stray edge of a pixel more is no fault.
        let [width, height] = png(&here.join(line.split(':').next().unwrap())).0;
        assert!((40..=41).contains(&width) && (40..=41).contains(&height), "{line}");
    }
    let Some(data) = data_dir() else { return };
    let tiles = data.join("urban/multitile_ign").canonicalize().unwrap();
    let ran = run(here, &words(["render", tiles.to_str().unwrap(), "--each", "--ortho", "1", "-q"]), &[]);
    assert_eq!(ran.code, Some(0), "{}", ran.said);
    let pictures: Vec<_> =
        names(here).into_iter().filter(|n| n.starts_with("test_data") && n.ends_with("png")).collect();
    assert_eq!(pictures.len(), 6);
    for name in pictures {
        assert_eq!(png(&here.join(&name)).0, [50, 50], "{name}");
    }
}

/// What lies in degrees has a world file in degrees, and says so; asked for, one in metres of a system that is named.
#[test]
fn a_map_of_degrees_is_in_degrees() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let mut bytes = field([9.2, 48.8], degrees());
    // Steps of 1e-7 degrees, a centimetre, east and north, and the bounds that come of them.
    let scale = 1e-7f64;
    for at in [131, 139] {
        bytes[at..at + 8].copy_from_slice(&scale.to_le_bytes());
    }
    for (at, value) in [(179, 9.2 + 5923.0 * scale), (187, 9.2), (195, 48.8 + 3950.0 * scale), (203, 48.8)] {
        bytes[at..at + 8].copy_from_slice(&value.to_le_bytes());
    }
    assert!(points_at(&bytes) > 227);
    fs::write(here.join("a.las"), bytes).unwrap();
    let said = done(here, "render a.las --ortho 1 -o a.png");
    assert!(said.contains("degrees are drawn in metres"), "{said}");
    let [a, d, b, e, c, f] = world(&here.join("a.pgw"));
    // A metre, and where the north-western corner is, in degrees.
    assert!(
        (1.2e-5..1.5e-5).contains(&a) && (-9.1e-6..-8.9e-6).contains(&e) && (d, b) == (0.0, 0.0),
        "{a} {e}"
    );
    assert!((c - 9.2).abs() < 2.0 * a && (f - 48.800_395).abs() < 2.0 * a, "{c} {f}");
    let prj = fs::read_to_string(here.join("a.prj")).unwrap();
    assert!(prj.starts_with("GEOGCS[\"WGS 84\"") && prj.contains("UNIT[\"degree\""), "{prj}");
    // Pixels lie on one grid in degrees, too.
    let edge = (c - 0.5 * a) / a;
    assert!((edge - edge.round()).abs() < 1e-3, "{edge}");
    done(here, "render a.las --ortho 1 -o utm.png --crs EPSG:25832");
    let [a, .., c, f] = world(&here.join("utm.pgw"));
    assert!(
        a == 1.0 && (500_000.0..530_000.0).contains(&c) && (5_300_000.0..5_500_000.0).contains(&f),
        "{c} {f}"
    );
    let prj = fs::read_to_string(here.join("utm.prj")).unwrap();
    assert!(prj.starts_with("PROJCS[") && prj.contains("UTM zone 32N"), "{prj}");
}

/// A table is no wider than the terminal, and every file is told from the others.
#[test]
fn info_fits_the_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let tiles = here.join("a project with a long name/flight of 2026-11-28");
    fs::create_dir_all(&tiles).unwrap();
    for k in 0..7 {
        let corner = [500_000.0 + 100.0 * f64::from(k), 5_400_000.0];
        let name = format!("tile_{}_5400_with_a_long_name_that_says_nothing.las", 500 + k);
        fs::write(tiles.join(name), field(corner, projected(9001))).unwrap();
    }
    fs::write(
        tiles.join("点群データ_東京都_航空測量_2026年.las"),
        field([501_000.0, 5_400_000.0], projected(9001)),
    )
    .unwrap();
    // A file with something to say.
    fs::write(tiles.join("cut.las"), &field([502_000.0, 5_400_000.0], projected(9001))[..90_000]).unwrap();
    let page = |columns: &str| {
        let ran = run(here, &words(["info", "."]), &[("COLUMNS", columns)]);
        assert_eq!(ran.code, Some(0), "{}", ran.said);
        ran.printed
    };
    let wide = |line: &str| unicode_width::UnicodeWidthStr::width(line);
    for columns in [50, 80, 100, 132, 200] {
        let page = page(&columns.to_string());
        assert!(page.lines().all(|line| wide(line) <= columns), "{columns}:\n{page}");
        let table: Vec<_> =
            page.lines().take_while(|line| !line.is_empty()).filter(|l| l.contains(".las")).collect();
        assert_eq!(table.len(), 9, "{columns}:\n{page}");
        let mut names: Vec<_> = table.iter().map(|line| line.rsplit("  ").next().unwrap()).collect();
        names.sort();
        names.dedup();
        assert!(columns < 80 || names.len() == 9, "{columns}:\n{page}");
        assert!(
            table.iter().all(|line| line.contains("7,200") || line.contains("cut.las")),
            "{columns}:\n{page}"
        );
        assert!(page.contains("E from") == (columns >= 80), "{columns}:\n{page}");
        assert!(
            page.contains("density") && page.contains("of 7200 points") || page.contains("are missing"),
            "{page}"
        );
    }
    // For a file or a pipe nothing is shortened.
    let ran = run(here, &words(["info", "."]), &[("COLUMNS", "")]);
    assert!(ran.printed.contains(
        "a project with a long name/flight of 2026-11-28/tile_506_5400_with_a_long_name_that_says_nothing.las"
    ));
    assert!(!ran.printed.contains('…') && ran.printed.contains("density"), "{}", ran.printed);
}

/// Numbers that come of a sample say so; a scan counts.
#[test]
fn info_says_which_numbers_are_estimates() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    // 400,000 points in chunks of 10,000, of which few are of class 15, in one chunk that no sample need see.
    let count = 400_000;
    let mut made = Made::new(6, Packing::Plain, 1000);
    let one = made.records.clone();
    made.records = one.iter().copied().cycle().take(30 * count).collect();
    for (k, record) in made.records.chunks_mut(30).enumerate() {
        for (axis, at) in
            [(k % 800) as i32 * 50, (k / 800) as i32 * 50, (k % 7) as i32].into_iter().enumerate()
        {
            record[4 * axis..4 * axis + 4].copy_from_slice(&at.to_le_bytes());
        }
        let class = if k % 4 == 0 { 5 } else { 2 };
        record[15..17].copy_from_slice(&[0, if (250_003..250_010).contains(&k) { 15 } else { class }]);
    }
    made.header = Some(([0.01; 3], [0.0; 3]));
    fs::write(here.join("big.las"), made.bytes()).unwrap();
    let (_, _, page) = typed(here, "info big.las");
    assert!(page.contains("classes      estimates, from "), "{page}");
    assert!(page.contains("~") && page.contains(" ground") && page.contains("--scan counts"), "{page}");
    let json = |line: &str| -> serde_json::Value {
        let (code, said, printed) = typed(here, line);
        assert_eq!(code, Some(0), "{said}");
        serde_json::from_str(&printed).unwrap()
    };
    let told = json("info big.las --json -");
    assert_eq!(told["all"]["classes_counted"], false);
    let ground = told["all"]["classes"].as_array().unwrap().iter().find(|class| class["class"] == 2).unwrap();
    assert!((250_000..350_000).contains(&ground["points"].as_u64().unwrap()), "{ground}");
    let (_, _, page) = typed(here, "info big.las --scan");
    assert!(!page.contains("estimates") && !page.contains('~'), "{page}");
    for line in [
        " 2 299,995  75.0 %  ground",
        " 5  99,998  25.0 %  high vegetation",
        "15       7   0.0 %  transmission tower",
    ] {
        assert!(page.contains(line), "{line} is not in\n{page}");
    }
    let told = json("info big.las --scan --json -");
    assert_eq!(
        (&told["all"]["classes_counted"], &told["all"]["classes"][2]["points"]),
        (&true.into(), &7.into())
    );
    // What is small is counted as it is opened, hidden classes included.
    let mut made = Made::new(6, Packing::Plain, 900);
    made.records.chunks_mut(30).enumerate().for_each(|(k, record)| {
        record[15..17].copy_from_slice(&[0, if k < 3 { 7 } else { 2 }]);
    });
    fs::write(here.join("small.las"), made.bytes()).unwrap();
    let (_, _, page) = typed(here, "info small.las");
    for line in [" 2 897  99.7 %  ground", " 7   3   0.3 %  low point (noise)"] {
        assert!(page.contains(line) && !page.contains('~'), "{line} is not in\n{page}");
    }
    assert_eq!(json("info small.las --json -")["all"]["classes_counted"], true);
}

/// What pictures took, of several files too, and files that lie far from each other.
#[test]
fn figures_of_each_picture_have_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    for (name, east) in [("a.las", 500.0), ("b.las", 560.0), ("c.las", 9_000_500.0)] {
        fs::write(here.join(name), field([east, 700.0], projected(9001))).unwrap();
    }
    let (code, said, printed) = typed(here, "render a.las b.las --each --size 32x18 --json -");
    assert_eq!(code, Some(0), "{said}");
    let figures: serde_json::Value = serde_json::from_str(&printed).unwrap();
    let pictures: Vec<_> = figures.as_array().unwrap().iter().map(|one| one["picture"].clone()).collect();
    assert_eq!(pictures, ["a.png", "b.png"]);
    assert!(figures.as_array().unwrap().iter().all(|one| one["points_seen"] == 7200), "{printed}");
    let (code, said, printed) = typed(here, "render --demo --size 32x18 -o demo.png --json -");
    assert_eq!((code, &*printed), (Some(0), "[]\n"), "{said}");

    let said = done(here, "render a.las b.las c.las --size 32x18 -o far.png");
    let far = "warning: the data lies at places 9000 km apart: with all of it framed, each is small (c.las)";
    assert!(said.contains(far), "{said}");
}
