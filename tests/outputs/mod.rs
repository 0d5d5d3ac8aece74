//! What the program writes: never over data, each option, each kind of file; and what its last line counts.

use super::made::{Made, Packing};
use super::{las, run, words};
use clap::CommandFactory;
use lasray::output::Target;
use std::any::TypeId;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

/// What a file named by an option is for.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Use {
    Reads,
    /// Tried against every kind of file below.
    Writes,
}

/// Every argument that takes the name of a file.
const ARGUMENTS: [(&str, &str, Use); 16] = [
    ("bench", "inputs", Use::Reads),
    ("bench", "json", Use::Writes),
    ("bench", "path", Use::Reads),
    ("bench", "plot", Use::Writes),
    ("info", "inputs", Use::Reads),
    ("info", "json", Use::Writes),
    ("render", "inputs", Use::Reads),
    ("render", "json", Use::Writes),
    ("render", "output", Use::Writes),
    ("render", "path", Use::Reads),
    ("synth", "out", Use::Writes),
    ("view", "hidden", Use::Reads),
    ("view", "inputs", Use::Reads),
    ("view", "json", Use::Writes),
    ("view", "path", Use::Reads),
    ("view", "saved", Use::Reads),
];

/// Command lines in which `TO` is written; the argument that they try.
fn lines() -> Vec<(&'static str, &'static str, &'static str)> {
    let mut lines = vec![
        ("bench", "json", "bench good.las --ingest --json TO"),
        ("bench", "json", "bench --load --json TO"),
        ("bench", "plot", "bench good.las --plot TO"),
        ("info", "json", "info good.las --json TO"),
        ("info", "json", "info --devices --json TO"),
        ("info", "json", "info tile.las good.las cloud --json TO -q"),
        ("render", "json", "render good.las -o new.png --json TO"),
        ("render", "json", "render good.las tile.las --path fly.json -o new%d.png --json TO"),
        ("render", "output", "render good.las -o TO"),
        ("render", "output", "render good.las --ortho 1 -o TO"),
        ("render", "output", "render --demo -o TO"),
        ("render", "output", "render good.las --path fly.json -o TO"),
        ("synth", "out", "synth TO --points 100 -q"),
        ("synth", "out", "synth TO --points 100 --force -q"),
    ];
    if cfg!(feature = "view") {
        lines.push(("view", "json", "view good.las --json TO"));
        lines.push(("view", "json", "view good.las --path fly.json --json TO"));
    }
    lines
}

#[test]
fn every_argument_that_names_a_file_is_tried() {
    let files = [TypeId::of::<PathBuf>(), TypeId::of::<OsString>(), TypeId::of::<Target>()];
    let mut found = Vec::new();
    for command in lasray::cli::Cli::command().get_subcommands() {
        for argument in command.get_arguments() {
            let parsed = argument.get_value_parser().type_id();
            let names: Vec<_> =
                argument.get_value_names().unwrap_or_default().iter().map(|n| n.as_str()).collect();
            let is_named = ["FILE", "PATH", "FOLDER", "DIR"].iter().any(|n| names.concat().contains(n));
            let takes = argument.get_action().takes_values();
            if takes && (files.iter().any(|file| parsed == *file) || is_named) {
                found.push((command.get_name().to_owned(), argument.get_id().to_string()));
            }
        }
    }
    found.sort();
    let is_built = |command: &str| command != "view" || cfg!(feature = "view");
    let known = ARGUMENTS.iter().filter(|(command, ..)| is_built(command));
    let known: Vec<_> = known.map(|&(command, name, _)| (command.to_owned(), name.to_owned())).collect();
    assert_eq!(
        found, known,
        "a new argument that names a file belongs into ARGUMENTS and, if it writes, into lines()"
    );
    for (command, name, _) in ARGUMENTS.iter().filter(|(c, _, role)| *role == Use::Writes && is_built(c)) {
        assert!(lines().iter().any(|(c, n, _)| (c, n) == (command, name)), "{command} {name} is not tried");
    }
}

/// Everything in a folder, and what is in it.
fn bytes_of(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        match path.is_dir() {
            true => all.extend(bytes_of(&path)),
            false => drop(all.insert(path.clone(), fs::read(&path).unwrap())),
        }
    }
    all
}

const FLY: &str = r#"{"version": 1, "keyframes": [{"time": 0, "eye": [0, -300, 500], "target": [0, 0, 0]}]}"#;

/// A folder with inputs of every kind, and what is not to be written over, each under the names that options take.
fn victims(folder: &Path) -> Vec<String> {
    let at = |name: &str| folder.join(name);
    fs::create_dir(at("sub")).unwrap();
    fs::write(at("good.las"), las(300)).unwrap();
    fs::write(at("fly.json"), FLY).unwrap();
    let mut names = Vec::new();
    let mut file = |name: &str, bytes: &[u8]| {
        fs::write(at(name), bytes).unwrap();
        names.push(name.to_owned());
    };
    file("tile.las", &las(40));
    file("tile.laz", &Made::new(7, Packing::Fixed(40), 90).bytes());
    file("tile.copc.laz", &Made::new(7, Packing::Copc(vec![30, 50]), 80).bytes());
    file("TILE2.LAZ", &Made::new(7, Packing::Fixed(40), 90).bytes());
    file("tile3.Las", b"an empty promise");
    file("index.lax", b"LASX");
    // What is no point cloud by its bytes, and none by its name.
    file("cloud", b"not LAS");
    for extension in ["png", "jpg", "exr", "json", "svg"] {
        fs::write(at(&format!("cloud.{extension}")), las(20)).unwrap();
        fs::hard_link(at("good.las"), at(&format!("hard.{extension}"))).unwrap();
        names.extend([
            format!("cloud.{extension}"),
            format!("hard.{extension}"),
            format!("./sub/../cloud.{extension}"),
        ]);
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink("good.las", at(&format!("soft.{extension}"))).unwrap();
            names.push(format!("soft.{extension}"));
        }
    }
    names.push("./tile.las".to_owned());
    names.push(at("sub/../tile.laz").to_str().unwrap().to_owned());
    // Not there yet.
    names.extend(["new.las", "new.copc.LAZ"].map(str::to_owned));
    names
}

#[test]
fn no_option_writes_over_data() {
    let folder = tempfile::tempdir().unwrap();
    let victims = victims(folder.path());
    let before = bytes_of(folder.path());
    let mut tried = 0;
    for (command, name, line) in lines() {
        for victim in &victims {
            // `cloud` is an input of some only, and a new point cloud is what `synth` is for.
            let is_input = line.contains("cloud");
            let is_free = victim.starts_with("new") && command == "synth" || victim == "cloud" && !is_input;
            // What ends in none of its extensions is a folder to `synth`; a dead end, too, where it is a file.
            let extension = victim.rsplit('.').next().unwrap().to_ascii_lowercase();
            let code = if command == "synth" && extension != "las" && extension != "laz" { 1 } else { 2 };
            if is_free {
                continue;
            }
            let ran =
                run(folder.path(), &words(line.split(' ').map(|w| if w == "TO" { victim } else { w })), &[]);
            let what = format!("{line}, {name} {victim}: {}", ran.said);
            assert_eq!((ran.code, ran.printed.as_str()), (Some(code), ""), "{what}");
            assert!(ran.said.contains(victim.as_str()), "{what}");
            assert!(!ran.said.contains("panicked"), "{what}");
            let says = ["refused: ", "pictures are written as .png, .jpg or .exr", "cannot make the folder"];
            assert!(says.iter().any(|says| ran.said.contains(says)), "{what}");
            let after = bytes_of(folder.path());
            assert!(after == before, "{what}: {:?}", after.keys().collect::<Vec<_>>());
            tried += 1;
        }
    }
    assert!(tried > 200, "{tried}");
}

/// Names that come of patterns, and two options of one name.
#[test]
fn names_that_are_made_are_looked_at_too() {
    let folder = tempfile::tempdir().unwrap();
    victims(folder.path());
    fs::hard_link(folder.path().join("tile.las"), folder.path().join("tile.png")).unwrap();
    fs::copy(folder.path().join("cloud.png"), folder.path().join("3.png")).unwrap();
    fs::write(folder.path().join("list.json"), "good.las\n").unwrap();
    fs::write(folder.path().join("sub/notes.json"), "{}").unwrap();
    fs::write(folder.path().join("sub/a.las"), las(30)).unwrap();
    let long =
        FLY.replace("}]}", r#"}, {"time": 1, "eye": [9, -300, 500], "target": [0, 0, 0]}], "fps": 9}"#);
    fs::write(folder.path().join("long.json"), long).unwrap();
    let before = bytes_of(folder.path());
    let mut cases = vec![
        (
            "render good.las tile.las --each -o {stem}.png",
            "-o tile.png: refused: it is an input of this command (tile.las)",
        ),
        ("render good.las --path long.json -o %d.png", "-o 3.png: refused: the file there is a point cloud"),
        (
            "render good.las --path long.json -o a%d.png --json long.json",
            "--json long.json: refused: it is an input",
        ),
        ("bench good.las --path fly.json --plot fly.json", "--plot fly.json: refused: it is an input"),
        ("info @list.json --json list.json", "--json list.json: refused: it is an input"),
        ("info @list.json --json sub/../list.json", "refused: it is an input of this command (list.json)"),
        ("info sub --json sub/notes.json", "lies in the input folder sub and is not of lasray's making"),
        ("info * --json sub/notes.json", "lies in the input folder sub"),
        ("bench good.las --json a.x --plot ./a.x", "--plot ./a.x: refused: --json names the same file"),
        ("render good.las -o a.png --json sub/../a.png", "-o a.png: refused: --json names the same file"),
        ("bench --json - --plot -", "--plot -: --json takes standard output"),
        ("info good.las --json gone/a.json", "--json gone/a.json: cannot be written: gone does not exist"),
        ("render good.las -o a.png --json sub", "--json sub: cannot be written: it is a folder"),
    ];
    if cfg!(unix) {
        cases.push(("info good.las --json /dev/null", "--json /dev/null: refused: it is no regular file"));
    }
    for (line, says) in cases {
        let ran = run(folder.path(), &words(line.split(' ')), &[]);
        assert_eq!((ran.code, ran.printed.as_str()), (Some(2), ""), "{line}: {}", ran.said);
        assert!(ran.said.contains(says), "{line}: {}", ran.said);
        assert!(bytes_of(folder.path()) == before, "{line}");
    }
}

/// What the program wrote is written anew, among inputs, too; standard output carries nothing but what was asked for.
#[test]
fn own_files_are_written_again() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.las"), las(300)).unwrap();
    let lines = [
        "render . -o a.png --size 32x18 --json r.json",
        "render . -o a.exr --size 32x18 --json r.json",
        "render a.las -o a.png --size 32x18 --json -",
        "info . --json i.json",
        "info . --scan --json - -q",
        "info --devices --json -",
        "bench . --load --cell 1 --json b.json",
        "bench . --load --cell 1 --json - -q",
        "bench --frames 1 --grid 16/5 --paths turn --size 32x18 --points 20k --cell 1 --plot p.svg --json - -q",
        "bench . --frames 1 --grid 16/5 --paths turn --size 32x18 --cell 1 --plot p.svg -q",
    ];
    for line in lines.iter().chain(&lines) {
        let ran = run(folder.path(), &words(line.split(' ')), &[]);
        assert_eq!(ran.code, Some(0), "{line}: {}", ran.said);
        if line.contains("--json -") {
            serde_json::from_str::<serde_json::Value>(&ran.printed).unwrap_or_else(|e| panic!("{line}: {e}"));
        }
    }
    let ran = run(folder.path(), &words("bench a.las --load --cell 1 --json -".split(' ')), &[]);
    assert!(ran.said.contains("loading a.las") && ran.printed.starts_with("{\n"), "{}", ran.said);
    for name in ["r.json", "i.json", "b.json"] {
        let text = fs::read_to_string(folder.path().join(name)).unwrap();
        assert!(text.contains("\"software\": \"lasray ") || text == "[]\n", "{name}: {text}");
    }
}

#[test]
fn side_files_of_others_stay() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let synth = run(folder.path(), &words("synth tile.laz --points 2k -q".split(' ')), &[]);
    assert_eq!(synth.code, Some(0), "{}", synth.said);
    let scan = fs::read(at("tile.laz")).unwrap();
    fs::write(at("tile.prj"), "the user's own").unwrap();
    let draw = |more: &str| {
        let line = format!("render tile.laz --size 32x18 -o tile.png{more}");
        let ran = run(folder.path(), &words(line.split(' ')), &[]);
        assert_eq!(ran.code, Some(0), "{line}: {}", ran.said);
        assert_eq!(fs::read_to_string(at("tile.prj")).unwrap(), "the user's own", "{line}");
        ran.said
    };
    for units in ["1", "2"] {
        let said = draw(&format!(" --ortho {units}"));
        assert!(said.contains("warning: tile.prj: not written beside tile.png: left as it is"), "{said}");
        assert!(fs::read_to_string(at("tile.pgw")).unwrap().starts_with(&format!("{units}\n")));
    }
    let said = draw("");
    assert!(said.contains("warning: tile.pgw: does not belong to tile.png"), "{said}");
    fs::hard_link(at("tile.laz"), at("map.pgw")).unwrap();
    let ran = run(folder.path(), &words("render tile.laz --size 32x18 --ortho 1 -o map.png".split(' ')), &[]);
    assert_eq!(ran.code, Some(0), "{}", ran.said);
    assert!(ran.said.contains("warning: map.pgw: not written beside map.png: refused: "), "{}", ran.said);
    assert!(fs::read_to_string(at("map.prj")).unwrap().starts_with("PROJCS"));
    assert!(fs::read(at("tile.laz")).unwrap() == scan && at("map.png").exists());
}

#[test]
fn other_kinds_of_files_say_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let ustar = [&[0; 257][..], b"ustar\0"].concat();
    let cases: [(&str, &[u8], &str); 21] = [
        ("a.zip", b"PK\x03\x04", "not a LAS file but a ZIP archive: unpack it first"),
        ("b.laz", b"PK\x03\x04", "not a LAS file but a ZIP archive: unpack it first"),
        ("a.las.gz", b"\x1f\x8b\x08\0", "a gzip archive: unpack it first"),
        ("a.7z", b"7z\xbc\xaf\x27\x1c", "a 7z archive: unpack it first"),
        ("a.tar", &ustar, "a tar archive: unpack it first"),
        (
            "a.e57",
            b"ASTM-E57",
            "an E57 file: convert it to LAS or LAZ first, for instance with PDAL or CloudCompare",
        ),
        ("a.ply", b"ply\nformat", "a PLY file: convert it"),
        ("a.xyz", b"1 2 3\n", "a text file: convert it"),
        ("a.TXT", b"1 2 3\n", "a text file: convert it"),
        ("a.csv", b"x,y,z\n", "a text file: convert it"),
        ("a.pts", b"3\n1 2 3\n", "a text file: convert it"),
        ("a.obj", b"v 1 2 3\n", "a mesh (OBJ): convert it"),
        ("ept.json", b"{}", "an Entwine point tile set (EPT): give its folder ept-data"),
        ("a.ept", b"{}", "an Entwine point tile set (EPT)"),
        ("a.tif", b"II*\0", "a raster (TIFF): it holds no points"),
        ("a.asc", b"ncols 4\n", "a raster (ASCII grid): it holds no points"),
        ("a.gpkg", b"SQLite format 3\0", "a GeoPackage: it holds no points"),
        ("a.shp", b"\0\0\x27\x0a", "a shapefile: it holds no points"),
        ("page.laz", b"<!DOCTYPE html>", "a web page: the download ended at a page"),
        ("lfs.laz", b"version https://git-lfs.github.com/spec/v1", "a Git LFS pointer: "),
        ("other.las", b"Once upon", "not a LAS file: starts with \"Once\" instead of \"LASF\""),
    ];
    for (name, bytes, says) in cases {
        fs::write(folder.path().join(name), bytes).unwrap();
        let ran = run(folder.path(), &words(["info", name]), &[]);
        assert_eq!((ran.code, ran.printed.as_str()), (Some(1), ""), "{name}: {}", ran.said);
        assert!(
            ran.said.starts_with(&format!("error: {name}: ")) && ran.said.contains(says),
            "{name}: {}",
            ran.said
        );
    }
    for (word, says) in [
        ("https://a.org/b.copc.laz", "https://a.org/b.copc.laz: a remote file: download it first"),
        ("s3://bucket/b.laz", "s3://bucket/b.laz: a remote file: download it first"),
        ("-", "-: standard input: give the name of a file"),
    ] {
        for command in ["info", "render -o a.png", "bench --ingest"] {
            let ran = run(folder.path(), &words(command.split(' ').chain([word])), &[]);
            assert_eq!(ran.code, Some(1), "{command} {word}: {}", ran.said);
            assert!(ran.said.contains(says), "{command} {word}: {}", ran.said);
        }
    }
}

#[test]
fn the_last_line_counts_what_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir(at("in")).unwrap();
    for name in ["a.las", "b.las"] {
        fs::write(at("in").join(name), las(300)).unwrap();
    }
    (0..9).for_each(|k| fs::write(at(&format!("in/empty{k}.las")), "").unwrap());
    fs::write(at("in/cut.las"), &las(300)[..9000]).unwrap();
    let hint = ", --strict fails on that";
    let cases = [
        ("render in gone.las -o a.png --size 32x18", 0, format!("11 of 13 inputs left out or failed{hint}")),
        (
            "render in gone.las -o a.png --size 32x18 --strict",
            1,
            "11 of 13 inputs left out or failed".to_owned(),
        ),
        (
            "render in gone.las -o {stem}.png --each --size 32x18",
            0,
            format!("11 of 13 inputs left out or failed{hint}"),
        ),
        (
            "render in gone.las -o a.png --size 32x18 -q --shade none",
            0,
            format!("11 of 13 inputs left out or failed{hint}"),
        ),
        (
            "render gone.las in/empty1.las -o a.png --size 32x18",
            1,
            "2 of 2 inputs left out or failed".to_owned(),
        ),
        ("render gone.las -o a.png --size 32x18", 1, "1 of 1 input left out or failed".to_owned()),
        ("info in gone.las", 0, format!("11 of 13 inputs left out or failed{hint}")),
        ("info in gone.las --scan --json - -q", 0, format!("11 of 13 inputs left out or failed{hint}")),
        ("info in gone.las --strict", 1, "11 of 13 inputs left out or failed".to_owned()),
        (
            "bench in gone.las --frames 1 --grid 16/5 --paths turn --size 32x18 --cell 1",
            0,
            "11 of 13 inputs left out or failed".to_owned(),
        ),
        (
            "bench in/cut.las in/a.las in/b.las --stream --frames 2 --runs 1 --paths turn --size 32x18 --cell 1",
            0,
            "1 of 3 inputs left out or failed".to_owned(),
        ),
        ("bench in/a.las in/empty1.las --load", 1, "1 of 2 inputs left out or failed".to_owned()),
    ];
    for (line, code, last) in cases {
        let ran = run(folder.path(), &words(line.split(' ')), &[]);
        assert_eq!(
            (ran.code, ran.said.lines().last()),
            (Some(code), Some(last.as_str())),
            "{line}: {}",
            ran.said
        );
        assert!(!ran.printed.contains("empty file") || line.contains("--json -"), "{line}: {}", ran.printed);
    }
    for line in ["render in/a.las -o a.png --size 32x18 -q", "info in/a.las in/b.las"] {
        let ran = run(folder.path(), &words(line.split(' ')), &[]);
        assert_eq!(ran.code, Some(0), "{line}");
        assert!(!ran.said.contains("left out or failed"), "{line}: {}", ran.said);
    }
}
