//! The program as its users meet it when something is wrong: every bad input and argument ends with a message that
//! names file, place and reason, with the right exit code, in bounded memory and time, and leaves nothing half-written.

mod made;
mod outputs;
mod typed;

use lasray::source::{FLAG_OVERLAP, FLAG_SYNTHETIC, FLAG_WITHHELD, LidarFile};
use made::{Made, Packing, data_dir, lidar_files};
use std::ffi::{OsStr, OsString};
use std::fs;
use std::io::Read;
#[cfg(unix)]
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// Longer than any case takes in a debug build on a busy machine.
const TIME: Duration = Duration::from_secs(60);
/// Resident memory that no case may pass, driver and its "device" memory included; where it can be measured.
const MEMORY: u64 = 700 << 20;
/// Lines that nobody minds.
const LINES: usize = 30;

/// What came of one call.
struct Ran {
    code: Option<i32>,
    /// Standard error.
    said: String,
    /// Standard output.
    printed: String,
    /// Largest resident memory seen, bytes; 0 where the system does not tell.
    peak: u64,
    took: Duration,
}

/// Runs the program in `folder`.
fn run(folder: &Path, arguments: &[OsString], environment: &[(&str, &str)]) -> Ran {
    let start = Instant::now();
    let mut child = Command::new(env!("CARGO_BIN_EXE_lasray"))
        .args(arguments)
        .current_dir(folder)
        .env("LASRAY_CACHE", folder.join("cache"))
        .envs(environment.iter().copied())
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let [said, printed] =
        [read_aside(child.stderr.take().unwrap()), read_aside(child.stdout.take().unwrap())];
    let mut peak = 0;
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break Some(status);
        }
        peak = peak.max(resident_peak(child.id()));
        if start.elapsed() > TIME {
            child.kill().unwrap();
            child.wait().unwrap();
            break None;
        }
        std::thread::sleep(Duration::from_millis(3));
    };
    let [said, printed] = [said, printed].map(|reader| reader.join().unwrap());
    Ran { code: status.and_then(|s| s.code()), said, printed, peak, took: start.elapsed() }
}

/// Reads on, so that the writer never waits.
fn read_aside(mut pipe: impl Read + Send + 'static) -> std::thread::JoinHandle<String> {
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        pipe.read_to_end(&mut bytes).unwrap();
        String::from_utf8_lossy(&bytes).into_owned()
    })
}

/// Linux alone tells of another process; elsewhere 0.
fn resident_peak(process: u32) -> u64 {
    let status = fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    line.and_then(|l| l.trim().trim_end_matches(" kB").parse::<u64>().ok()).map_or(0, |kb| kb << 10)
}

type Make = dyn Fn(&Path) -> Option<Vec<OsString>> + Send + Sync;

/// A call and what must come of it. Files are made in a folder of its own, pictures go to its `out`.
struct Case {
    name: String,
    /// Makes the files; gives the arguments behind `render`. `None`: cannot be tried here, and has said why.
    make: Box<Make>,
    environment: Vec<(&'static str, &'static str)>,
    code: i32,
    /// Each occurs on standard error.
    says: Vec<&'static str>,
    /// Files in `out` afterwards.
    pictures: Vec<&'static str>,
    memory: u64,
}

impl Case {
    fn new(
        name: impl ToString,
        code: i32,
        says: &[&'static str],
        make: impl Fn(&Path) -> Option<Vec<OsString>> + Send + Sync + 'static,
    ) -> Case {
        Case {
            name: name.to_string(),
            make: Box::new(make),
            environment: Vec::new(),
            code,
            says: says.to_vec(),
            pictures: if code == 0 { vec!["a.png"] } else { Vec::new() },
            memory: MEMORY,
        }
    }

    fn leaving(mut self, pictures: &[&'static str]) -> Case {
        self.pictures = pictures.to_vec();
        self
    }

    /// One file `name` with these bytes.
    fn file(name: &'static str, bytes: Vec<u8>, code: i32, says: &[&'static str]) -> Case {
        Case::file_with(name, bytes, &[], code, says)
    }

    /// The same with further arguments.
    fn file_with(
        name: &'static str,
        bytes: Vec<u8>,
        more: &'static [&'static str],
        code: i32,
        says: &[&'static str],
    ) -> Case {
        let title = format!("{name} {}", more.join(" "));
        let case = Case::new(title, code, says, move |folder| {
            fs::write(folder.join(name), &bytes).unwrap();
            Some(words([name, "-o", "out/a.png"].into_iter().chain(more.iter().copied())))
        });
        // Where a file fails, its name is said.
        if says.iter().any(|s| s.contains(name)) || code == 0 { case } else { panic!("{name} must be named") }
    }

    /// A sound file with these further arguments.
    fn arguments(more: &'static [&'static str], code: i32, says: &[&'static str]) -> Case {
        Case::new(more.join(" "), code, says, move |folder| {
            fs::write(folder.join("good.las"), las(300)).unwrap();
            let output: &[&str] = if more.contains(&"-o") { &[] } else { &["-o", "out/a.png"] };
            Some(words(["good.las"].iter().chain(output).chain(more).copied()))
        })
    }

    /// Runs it; gives what is wrong.
    fn wrong(&self) -> Vec<String> {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        fs::create_dir(&out).unwrap();
        let Some(mut arguments) = (self.make)(folder.path()) else { return Vec::new() };
        arguments.insert(0, "render".into());
        if !arguments.iter().any(|a| a == "--size" || a == "--ortho") {
            arguments.extend(words(["--size", "64x36"]));
        }
        let ran = run(folder.path(), &arguments, &self.environment);
        let mut left: Vec<_> = fs::read_dir(&out)
            .map(|entries| {
                entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect::<Vec<_>>()
            })
            .unwrap_or_default();
        left.sort();
        let mut wrong = Vec::new();
        let mut check = |holds: bool, what: String| {
            if !holds {
                wrong.push(what);
            }
        };
        check(ran.code == Some(self.code), format!("exit code {:?}, not {}", ran.code, self.code));
        for &words in &self.says {
            check(ran.said.contains(words), format!("does not say {words:?}"));
        }
        check(!ran.said.contains("panicked"), "panics".into());
        check(ran.said.lines().count() <= LINES, format!("{} lines", ran.said.lines().count()));
        check(left == self.pictures, format!("leaves {left:?}, not {:?}", self.pictures));
        check(ran.peak <= self.memory, format!("takes {} MiB", ran.peak >> 20));
        check(ran.took < TIME, "takes too long".into());
        if !wrong.is_empty() {
            wrong.push(format!("it said: {}", ran.said));
        }
        wrong.into_iter().map(|w| format!("{}: {w}", self.name)).collect()
    }
}

fn words<'a>(words: impl IntoIterator<Item = &'a str>) -> Vec<OsString> {
    words.into_iter().map(OsString::from).collect()
}

/// Runs all on two threads and tells of every failure.
fn try_all(cases: Vec<Case>) {
    let (next, wrong) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                while let Some(case) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let found = case.wrong();
                    wrong.lock().unwrap().extend(found);
                }
            });
        }
    });
    let wrong = wrong.into_inner().unwrap();
    assert!(wrong.is_empty(), "{} cases\n{}", cases.len(), wrong.join("\n"));
}

/// A LAS 1.2 file of format 3: header to byte 227, then a record that names no CRS, then records of 34 bytes.
fn las(points: usize) -> Vec<u8> {
    Made::new(3, Packing::Plain, points).bytes()
}

fn with(mut bytes: Vec<u8>, at: usize, field: &[u8]) -> Vec<u8> {
    bytes[at..at + field.len()].copy_from_slice(field);
    bytes
}

/// Offset to the points.
fn points_at(bytes: &[u8]) -> usize {
    u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize
}

/// Bytes cut off so that `records` and a half remain.
fn cut(mut bytes: Vec<u8>, records: usize) -> Vec<u8> {
    let record = usize::from(u16::from_le_bytes([bytes[105], bytes[106]]));
    bytes.truncate(points_at(&bytes) + records * record + record / 2);
    bytes
}

fn open(bytes: &[u8]) -> LidarFile {
    let file = tempfile::NamedTempFile::new().unwrap();
    fs::write(file.path(), bytes).unwrap();
    LidarFile::open(file.path()).unwrap()
}

/// A layered file of five chunks, the third of which says that its layers are 4 GB long.
fn broken_chunk() -> Vec<u8> {
    let bytes = Made::new(7, Packing::Fixed(40), 200).bytes();
    let chunk = open(&bytes).chunks[2].byte_offset as usize;
    with(bytes, chunk + 36 + 4, &[0xff; 36])
}

/// A chunk table at the end of the file that claims 4 billion chunks.
fn broken_table() -> Vec<u8> {
    let bytes = Made::new(7, Packing::Fixed(40), 200).bytes();
    let points = points_at(&bytes);
    let table = u64::from_le_bytes(bytes[points..points + 8].try_into().unwrap()) as usize;
    with(bytes, table + 4, &[0xff; 4])
}

fn broken_hierarchy() -> Vec<u8> {
    let bytes = Made::new(7, Packing::Copc(vec![30, 50, 60, 20]), 160).bytes();
    // The root page's offset in the info record.
    with(bytes, 375 + 54 + 40, &u64::MAX.to_le_bytes())
}

#[expect(clippy::too_many_lines, reason = "a table")]
fn bad_files() -> Vec<Case> {
    let f = |value: f64| value.to_le_bytes();
    let mut cases = vec![
        Case::file("empty.las", vec![], 1, &["empty.las: empty file"]),
        Case::file(
            "text.las",
            b"Once upon a time".to_vec(),
            1,
            &["text.las: not a LAS file: starts with \"Once\""],
        ),
        Case::file("photo.png", b"\x89PNG\r\n\x1a\n".to_vec(), 1, &["photo.png: not a LAS file"]),
        Case::file(
            "head.las",
            las(9)[..100].to_vec(),
            1,
            &["head.las: ends inside its header: 100 bytes, a LAS 1.2 header has 227"],
        ),
        Case::file(
            "version.las",
            with(las(9), 24, &[2, 0]),
            1,
            &["version.las: header byte 24: version is 2.0"],
        ),
        Case::file(
            "format.las",
            with(las(9), 104, &[63]),
            1,
            &["format.las: header byte 104: point format is 63"],
        ),
        Case::file(
            "cut.las",
            cut(las(1000), 600),
            0,
            &["warning: cut.las: header claims 1000 points, 600 can be read, 400 are missing"],
        ),
        Case::file_with(
            "cut.las",
            cut(las(1000), 600),
            &["--strict"],
            1,
            &["cut.las: header claims 1000 points, 600 can be read, 400 are missing"],
        )
        .leaving(&["a.png"]),
        Case::file(
            "count.las",
            with(las(1000), 107, &[0xff; 4]),
            0,
            &["count.las: header claims 4294967295 points, 1000 can be read, 4294966295 are missing"],
        ),
        Case::file(
            "count64.las",
            with(Made::new(6, Packing::Plain, 300).bytes(), 247, &[0xff; 8]),
            0,
            &["count64.las: header claims 18446744073709551615 points, 300 can be read"],
        ),
        Case::file(
            "behind.las",
            with(las(9), 96, &[0xff, 0xff, 0xff, 0x7f]),
            1,
            &["behind.las: header byte 96: offset to point data is 2147483647, the file ends at"],
        ),
        Case::file(
            "inside.las",
            with(las(9), 96, &[9, 0, 0, 0]),
            1,
            &[
                "inside.las: header byte 96: offset to point data is 9, points cannot begin inside a header of 227 bytes",
            ],
        ),
        Case::file(
            "short.las",
            with(las(9), 105, &[10, 0]),
            1,
            &[
                "short.las: header byte 105: point record length is 10, a record of format 3 has at least 34 bytes",
            ],
        ),
        Case::file(
            "nan.las",
            with(las(300), 179, &f(f64::NAN)),
            0,
            &["nan.las: header byte 179: bounds are not finite or inverted"],
        ),
        Case::file(
            "infinite.las",
            with(las(300), 179, &f(f64::INFINITY)),
            0,
            &["infinite.las: header byte 179"],
        ),
        Case::file(
            "inverted.las",
            with(las(300), 187, &f(7e6)),
            0,
            &["inverted.las: header byte 179: bounds are not finite or inverted"],
        ),
        Case::file(
            "scale0.las",
            with(las(9), 131, &f(0.0)),
            1,
            &["scale0.las: header byte 131: X scale is 0, must be above 0 and at most 1e6"],
        ),
        Case::file(
            "scale-1.las",
            with(las(9), 147, &f(-1.0)),
            1,
            &["scale-1.las: header byte 147: Z scale is -1, must be above 0 and at most 1e6"],
        ),
        Case::file(
            "scaleinf.las",
            with(las(9), 139, &f(f64::INFINITY)),
            1,
            &["scaleinf.las: header byte 139: Y scale is inf"],
        ),
        Case::file(
            "scale1e305.las",
            with(las(300), 131, &f(1e305)),
            1,
            &["scale1e305.las: header byte 131: X scale is 1e305, must be above 0 and at most 1e6"],
        ),
        Case::file("scale1e290.las", with(las(300), 131, &f(1e290)), 1, &["scale1e290.las: header byte 131"]),
        Case::file("scale1e-300.las", with(las(300), 131, &f(1e-300)), 0, &[]),
        // Both points within 1e-312 units of 0, 0, and nothing between them to end a search for the cell size.
        Case::file(
            "speck.las",
            with(las(2), 131, &[f(1e-318), f(1e-318), f(1.0), f(0.0), f(0.0)].concat()),
            0,
            &[],
        ),
        Case::file(
            "offset.las",
            with(las(9), 155, &f(f64::NAN)),
            1,
            &["offset.las: header byte 155: X offset is NaN, must lie within ±1e12"],
        ),
        Case::file(
            "far.las",
            with(las(300), 155, &f(1e300)),
            1,
            &["far.las: header byte 155: X offset is 1e300, must lie within ±1e12"],
        ),
        Case::file(
            "high.las",
            with(las(300), 147, &f(1e6)),
            1,
            &[
                "high.las: heights reach from ",
                " units, too far from 0 to be told apart in steps of a cell of ",
            ],
        ),
        Case::file("mountain.las", with(las(300), 171, &f(1e8)), 0, &[]),
        Case::file(
            "chunk.laz",
            broken_chunk(),
            0,
            &["error: chunk.laz: chunk 2 at byte ", "of 40 points read"],
        ),
        Case::file_with(
            "chunk.laz",
            broken_chunk(),
            &["--strict"],
            1,
            &["error: chunk.laz: chunk 2 at byte "],
        )
        .leaving(&["a.png"]),
        Case::file("table.laz", broken_table(), 0, &["warning: table.laz: byte ", "chunk table: "]),
        Case::file(
            "vlr.laz",
            with(Made::new(3, Packing::Fixed(40), 90).bytes(), 227 + 54 + 10 + 54, &[0xff; 2]),
            1,
            &["vlr.laz: byte ", "LASzip record: compressor is 65535"],
        ),
        Case::file(
            "octree.copc.laz",
            broken_hierarchy(),
            0,
            &["warning: octree.copc.laz: byte ", "COPC hierarchy: "],
        ),
        Case::file("none.las", las(0), 1, &["none.las: holds no points", "nothing to draw"]),
        Case::file(
            "none.laz",
            Made::new(6, Packing::Fixed(40), 0).bytes(),
            1,
            &["none.laz: holds no points"],
        ),
        Case::file("one.las", las(1), 0, &["1 point read, 1 section"]),
        // Sections of one point each: the budget is looked at before there are thousands of them.
        Case {
            memory: 500 << 20,
            ..Case::file_with(
                "fine.las",
                scattered(60_000),
                &["--cell", "1e-5", "--host-memory", "16MiB", "--device-memory", "16MiB", "--shade", "none"],
                0,
                &["fine.las: cell size ", "instead of 0.00001"],
            )
        },
        // What is coarse on the picture need not be fine in memory.
        Case {
            memory: 500 << 20,
            ..Case::file_with(
                "fine.las",
                scattered(60_000),
                &["--cell", "1e-5", "--host-memory", "16MiB", "--device-memory", "16MiB"],
                0,
                &["60000 points read", "cells of 0.00001 units"],
            )
        },
    ];
    for (name, at) in [("last.las", 1), ("half.las", 18)] {
        let mut bytes = las(2);
        bytes.truncate(bytes.len() - at);
        cases.push(Case::file(name, bytes, 0, &["header claims 2 points, 1 can be read, 1 are missing"]));
    }
    cases
}

/// What was wrong with files is told even where there is no picture for another reason.
#[test]
fn broken_files_are_named_where_the_picture_fails() {
    try_all(vec![Case::file_with(
        "chunk.laz",
        broken_chunk(),
        &["--device-memory", "1KiB"],
        1,
        &["error: chunk.laz: chunk 2 at byte ", "the sections do not fit"],
    )]);
}

#[test]
fn each_bad_file_by_itself() {
    try_all(bad_files());
}

#[test]
fn all_bad_files_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let cases = bad_files();
    for case in &cases {
        (case.make)(folder.path());
    }
    let refused = || cases.iter().filter(|case| case.code == 1 && case.pictures.is_empty());
    let ran = run(folder.path(), &words(["render", ".", "-o", "a.png", "--size", "64x36"]), &[]);
    assert_eq!(ran.code, Some(0), "{}", ran.said);
    assert!(folder.path().join("a.png").exists());
    assert!(ran.peak <= MEMORY, "{} MiB", ran.peak >> 20);
    assert!(!ran.said.contains("panicked"), "{}", ran.said);
    let ran = run(folder.path(), &words(["info", ".", "photo.png", "--scan"]), &[]);
    assert_eq!(ran.code, Some(0), "{}", ran.said);
    assert!(!ran.said.contains("panicked"), "{}", ran.said);
    for case in refused() {
        let name = case.name.split(' ').next().unwrap();
        let named = [&ran.said, &ran.printed].iter().any(|text| text.contains(name));
        assert!(named, "{name} is not named:\n{}{}", ran.said, ran.printed);
    }
    // What is sound is there all the same.
    assert!(ran.printed.contains("fine.las"), "{}", ran.printed);
}

/// Points strewn evenly over 200 m.
fn scattered(points: usize) -> Vec<u8> {
    let mut bytes = las(points);
    let start = points_at(&bytes);
    let mut state = 1u64;
    for record in bytes[start..].chunks_exact_mut(34) {
        for axis in 0..2 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            let value = 1_000_000 + ((state >> 33) % 20_000) as i32;
            record[4 * axis..4 * axis + 4].copy_from_slice(&value.to_le_bytes());
        }
    }
    bytes
}

#[test]
fn wrong_arguments() {
    let mut cases: Vec<_> = [
        (&["--cell", "0"][..], "0 is not above 0"),
        (&["--cell", "-1"], "-1 is not above 0"),
        (&["--cell", "NaN"], "'NaN' is not finite"),
        (&["--cell", "1e-30"], "cell size 1e-30 is too small"),
        (&["--cell", "1e-13"], "cell size 1e-13 is too small"),
        (&["--eye", "1,2,3", "--target", "1,2,3"], "eye and target are both at 1,2,3"),
        (&["--eye", "1,2,3"], "--target"),
        (&["--eye", "inf,2,3", "--target", "1,2,3"], "'inf' is not finite"),
        (&["--eye", "1e300,2,3", "--target", "1,2,3"], "must be finite"),
        (&["--orbit", "0,91"], "elevation 91 is not within"),
        (&["--orbit", "0,35,-2"], "distance -2 is not above 0"),
        (&["--fov", "180"], "180 degrees is not below 180"),
        (&["--z-scale", "-2"], "-2 is not above 0"),
        (&["--size", "0x36"], "at least one pixel each way"),
        (&["--size", "wide"], "'wide' is not WIDTHxHEIGHT"),
        (&["--size", "4294967295x4294967295"], "4294967295x4294967295 pixels is too large for the device"),
        (&["--size", "4294967295x1"], "4294967295x1 pixels is too large for the device"),
        (&["--ortho", "1e-9"], "give --size, or more units"),
        (
            &["--ortho", "1e9", "--size", "64x36"],
            "units wide where the data begins, more than 2^30 cells of ",
        ),
        (&["--classes", "256"], "class 256 is out of range: classes are 0 to 255"),
        (&["--classes", "7-3"], "7 is above 3"),
        (&["--hide", "gorund"], "'gorund' is not a class"),
        (
            &["--hide-flags", "overlap,noise"],
            "'noise' is not a flag: those are withheld, overlap, synthetic, key-point",
        ),
        (&["--range", "5,1"], "5 is not below 1"),
        (&["--range", "NaN,1"], "'NaN' is not finite"),
        (&["--range", "5..1"], "5 is not below 1"),
        (&["--range", "98%..2%"], "98% is not below 2%"),
        (&["--range", "0%..101%"], "101% is not within 0% and 100%"),
        (
            &["--color", "density", "--range", "2%..98%"],
            "colour range 2%..98%: no percentiles of point density are known before all points are read; give values, such as 0..",
        ),
        (&["--range", "3"], "'3' is not A..B, such as 180..260 or 2%..98%"),
        (&["--samples", "0"], "0 is not in 1..=256"),
        (&["--device", "99"], "there is no device 99; the devices are:"),
        (&["--device-memory", "plenty"], "'plenty' is not a number of bytes"),
        (&["--z-unit", "cubit"], "unknown unit cubit"),
        (&["--color", "beige"], "'beige'"),
        (&["--returns", "second"], "'second'"),
        (&["--source-id", "3,x"], "'x' is not a point source id, such as 3,7-9"),
        (&["--source-id", "9-3"], "9 is above 3"),
        (&["--source-id", "65536"], "65536 is out of range: point source ids are 0 to 65535"),
        (&["--intensity", "100,2000"], "'100,2000' is not a number; a range is 100..2000, 100.. or ..2000"),
        (&["--intensity", "9..3"], "9 is above 3"),
        (&["--heights", "low..high"], "'low' is not a number"),
        (&["--heights", "-9..-10"], "-9 is above -10"),
        (&["--gps-time", "..inf"], "'inf' is not finite"),
        (&["--wrong"], "--wrong"),
        (&["-o", "out/a.bmp"], "out/a.bmp: pictures are written as .png, .jpg or .exr"),
        (&["-o", "out/a"], "out/a: pictures are written as .png, .jpg or .exr"),
        (&["--each", "-o", "out/a.png"], "--each needs {stem} in the output's name"),
    ]
    .into_iter()
    .map(|(more, says)| Case::arguments(more, 2, &[says]))
    .collect();
    cases.push(Case::new("no input", 2, &["INPUT"], |_| Some(words(["-o", "out/a.png"]))));
    cases.push(Case::arguments(
        &["--hide", "0-255"],
        1,
        &["nothing to draw: no point is of a class that is shown"],
    ));
    cases.push(
        Case::arguments(
            &["--ortho", "0.1", "--size", "16x9"],
            0,
            &["out/a.png: the picture is of a part of the data: all of it takes "],
        )
        .leaving(&["a.pgw", "a.png"]),
    );
    cases.push(Case::arguments(
        &["--device-memory", "1"],
        1,
        &["do not fit 2.00 GiB of host and 1 B of device memory"],
    ));
    try_all(cases);
}

/// Where no point takes part, or a file cannot tell whether its points do, that is said.
#[test]
fn what_is_selected_is_drawn_or_said_to_be_nothing() {
    let mut cases = Vec::new();
    for way in [&["--shade", "none"][..], &[]] {
        let nothing: [(&[&str], &str); 2] = [
            (
                &["--source-id", "9,60000-60010", "--returns", "only"],
                "nothing to draw: no point is selected (single returns, source id 9,60000-60010); there is source id ",
            ),
            (
                &["--heights", "1e6.."],
                "nothing to draw: no point is selected (heights 1000000..); there is heights ",
            ),
        ];
        let some: [(&[&str], &str); 3] = [
            (&["--returns", "first", "--intensity", "..2900"], "points read"),
            (&["--source-id", "0-2", "--color", "source-id"], "coloured by source-id"),
            (&["--color", "scan-angle", "--range", "-5,5"], "coloured by scan-angle from -5.0 to 5.0"),
        ];
        for (code, (more, says)) in
            nothing.map(|case| (1, case)).into_iter().chain(some.map(|case| (0, case)))
        {
            let words_of = [way, more].concat();
            cases.push(Case::new(words_of.join(" "), code, &[says], move |folder| {
                fs::write(folder.join("good.las"), las(300)).unwrap();
                Some(words(["good.las", "-o", "out/a.png"].iter().chain(&words_of).copied()))
            }));
        }
        // A format without times: once, and of which file.
        let untimed: [(&[&str], i32, &str); 2] = [
            (
                &["--gps-time", "0..1e18"],
                1,
                "a.las: point format 2 has no GPS time: none of its points is selected by time",
            ),
            (&["--color", "gps-time"], 0, "a.las: point format 2 has no GPS time: its points are grey"),
        ];
        for (more, code, says) in untimed {
            let words_of = [way, more].concat();
            cases.push(Case::new(words_of.join(" "), code, &[says], move |folder| {
                fs::write(folder.join("a.las"), Made::new(2, Packing::Plain, 300).bytes()).unwrap();
                Some(words(["a.las", "-o", "out/a.png"].iter().chain(&words_of).copied()))
            }));
        }
    }
    try_all(cases);
}

/// More points than are read before a picture is begun: none of them is selected, or those that are are counted.
#[test]
fn what_is_selected_of_many_points_is_known_once_they_are_read() {
    let case = |code, says: &[&'static str], more: &'static [&'static str]| {
        Case::new(more.join(" "), code, says, move |folder| {
            let mut made = Made::new(1, Packing::Plain, 2_000_100);
            for (k, record) in made.records.chunks_mut(28).enumerate() {
                let at = [(k % 2000) as i32, (k / 2000) as i32, 1000];
                record[..12].copy_from_slice(&at.map(i32::to_le_bytes).concat());
                record[14..16].copy_from_slice(&[0, 2]);
                record[18..20].copy_from_slice(&u16::from(k >= 2_000_000).to_le_bytes());
                record[20..28].copy_from_slice(&0f64.to_le_bytes());
            }
            made.header = Some(([0.5; 3], [0.0; 3]));
            fs::write(folder.join("many.las"), made.bytes()).unwrap();
            Some(words(["many.las", "--size", "64x36", "-o", "out/a.png"].iter().chain(more).copied()))
        })
    };
    try_all(vec![
        case(
            1,
            &["nothing to draw: no point is selected (heights 600..); a sample has heights 500..500"],
            &["--heights", "600.."],
        ),
        case(1, &["no point is selected (heights 600..)"], &["--heights", "600..", "--shade", "none"]),
        case(0, &["2000100 points read, 100 selected, ", "cells of 0.5 unit"], &["--source-id", "1"]),
        case(
            0,
            &[
                "many.las: no point of the sample has the number of its return",
                "many.las: no point of the sample has a GPS time other than 0",
                "2000100 points read, 2000100 selected, ",
            ],
            &["--returns", "last", "--gps-time", "..5"],
        ),
    ]);
}

/// A first picture of a file with few chunks shows points, not the few cells of a sample of one point a chunk.
#[test]
fn a_first_picture_shows_something() {
    try_all(vec![Case::new("few chunks", 0, &["pixels, 300 points read, "], |folder| {
        fs::write(folder.join("few.laz"), Made::new(1, Packing::Fixed(100), 300).bytes()).unwrap();
        Some(words(["few.laz", "--wait", "none", "-o", "out/a.png"]))
    })]);
}

/// A path of three frames and some that are none, with `more`.
/// Points of these kinds, by turns: class, and flags.
fn of_kinds(kinds: &[(u8, u8)]) -> Vec<u8> {
    let mut made = Made::new(6, Packing::Fixed(200), 300);
    for (record, &(class, flags)) in made.records.chunks_mut(30).zip(kinds.iter().cycle()) {
        record[15..17].copy_from_slice(&[flags, class]);
    }
    made.bytes()
}

/// Where every point is hidden, nothing is drawn, and it is said what shows them; in both ways of drawing.
#[test]
fn hidden_points_are_said_to_be_hidden() {
    type Words = &'static [&'static str];
    type Kinds = &'static [(u8, u8)];
    let cases: [(Kinds, Words, &'static str, Words); 6] = [
        (&[(2, FLAG_WITHHELD)], &[], "every point is withheld (--withheld shows them)", &["--withheld"]),
        (
            &[(7, 0), (18, 0)],
            &[],
            "no point is of a class that is shown; there are 7,18 (--classes 7,18 shows them)",
            &["--classes", "7,18"],
        ),
        (
            &[(2, 0), (6, 0)],
            &["--classes", "9"],
            "there are 2,6 (--classes 2,6 shows them)",
            &["--classes", "2,6"],
        ),
        (
            &[(7, FLAG_WITHHELD)],
            &[],
            "every point is both withheld and of such a class (--withheld --classes 7 shows them)",
            &["--withheld", "--classes", "7"],
        ),
        (
            &[(2, FLAG_OVERLAP), (6, FLAG_SYNTHETIC)],
            &["--hide-flags", "synthetic,overlap"],
            "flagged overlap or flagged synthetic (--hide-flags without overlap,synthetic shows them)",
            &["--hide-flags", "key-point"],
        ),
        (
            &[(2, FLAG_WITHHELD), (7, 0)],
            &[],
            "withheld (--withheld shows them), or of a class that is not shown (--classes 7 shows them)",
            &["--classes", "7"],
        ),
    ];
    let mut all = Vec::new();
    for (kinds, arguments, says, shows) in cases {
        for way in [&["--shade", "none"][..], &[]] {
            for (more, code) in [(arguments, 1), (shows, 0)] {
                let says = if code == 1 { ["lasray: nothing to draw: ", says] } else { ["300 points"; 2] };
                all.push(Case::new(format!("{kinds:?} {way:?} {more:?}"), code, &says, move |folder| {
                    fs::write(folder.join("a.laz"), of_kinds(kinds)).unwrap();
                    let output = ["a.laz", "-o", "out/a.png"];
                    Some(words(output.iter().chain(way).chain(more).copied()))
                }));
            }
        }
    }
    try_all(all);
}

/// Points of flags are layers as classes are: those that are hidden are not there.
#[test]
fn hidden_flags_are_drawn_as_if_their_points_were_not_there() {
    let folder = tempfile::tempdir().unwrap();
    let lasray = |arguments: &[&str]| {
        let ran = run(folder.path(), &words(arguments.iter().copied()), &[]);
        assert_eq!(ran.code, Some(0), "{arguments:?}: {}", ran.said);
    };
    lasray(&["synth", "all.las", "--points", "60k", "-q"]);
    let mut all = fs::read(folder.path().join("all.las")).unwrap();
    let (first, length) = (points_at(&all), usize::from(u16::from_le_bytes([all[105], all[106]])));
    for (k, record) in all[first..].chunks_exact_mut(length).enumerate() {
        let flags = [k % 7 == 0, k % 3 == 0, k % 5 == 0, k % 4 == 1].map(u8::from);
        record[15] = record[15] & 0xF0 | flags[0] | flags[1] << 1 | flags[2] << 2 | flags[3] << 3;
    }
    fs::write(folder.path().join("all.las"), &all).unwrap();
    let draw = |input: &str, output: &str, more: &[&str]| {
        let camera = "--ortho=2 --eye 512000,5403000,900 --target 512010,5403030,200 --size 160x120 --cell 2";
        let way = camera.split(' ').chain("--color class --shade none --background white -q".split(' '));
        lasray(
            &["render", input, "-o", output]
                .into_iter()
                .chain(way)
                .chain(more.iter().copied())
                .collect::<Vec<_>>(),
        );
        pixels(&folder.path().join(output))
    };
    let mut seen = Vec::new();
    for (options, hidden) in [
        (&[][..], FLAG_WITHHELD),
        (&["--hide-flags", "withheld"], FLAG_WITHHELD),
        (&["--withheld"], 0),
        (&["--hide-flags", "overlap"], FLAG_WITHHELD | FLAG_OVERLAP),
        (&["--withheld", "--hide-flags", "overlap,key-point,synthetic"], 11),
    ] {
        let kept: Vec<_> =
            all[first..].chunks_exact(length).filter(|record| record[15] & hidden == 0).collect();
        let some = with([&all[..first], &kept.concat()].concat(), 247, &(kept.len() as u64).to_le_bytes());
        fs::write(folder.path().join("some.las"), some).unwrap();
        let is = draw("all.las", "is.png", options);
        assert!(is == draw("some.las", "should.png", &["--withheld"]), "{options:?}");
        seen.push(is);
    }
    assert!(seen[0] == seen[1] && seen[2..].iter().all(|other| *other != seen[0]));
}

/// What files say of themselves reaches no terminal as a command.
#[test]
fn words_of_files_are_harmless() {
    let folder = tempfile::tempdir().unwrap();
    let citation = b"Grid \x1b[31mRED\x1b]0;x\x07 \xe2\x80\xaeend|\0".to_vec();
    let keys = [1u16, 1, 0, 3, 1024, 0, 1, 1, 1026, 34737, citation.len() as u16 - 1, 0, 3076, 0, 1, 9001];
    let mut made = Made::new(3, Packing::Plain, 300);
    made.vlrs = vec![
        ("LASF_Projection", 34735, keys.iter().flat_map(|key| key.to_le_bytes()).collect()),
        ("LASF_Projection", 34737, citation),
    ];
    // Windows has no such names.
    let name = if cfg!(unix) { "a\x1b[2J\nlasray: all is well.las" } else { "a.las" };
    fs::write(folder.path().join(name), made.bytes()).unwrap();
    fs::write(folder.path().join(format!("bad {name}")), "").unwrap();
    for (arguments, harmless) in [
        (&["info", "."][..], r"Grid \u{1b}[31mRED\u{1b}]0;x\u{7} \u{202e}end"),
        (&["info", ".", "--json=-"], r"Grid \\u{1b}[31mRED\\u{1b}]0;x\\u{7} \\u{202e}end"),
        (&["info", ".", "--scan"], ""),
        (&["render", ".", "-o", "a.png", "--size", "64x36"], ""),
        (&["render", ".", "--each", "-o", "{stem}.png", "--size", "64x36"], ""),
        (&["view", "no such\x1b[2J.las"], ""),
    ] {
        let ran = run(folder.path(), &words(arguments.iter().copied()), &[]);
        let all = format!("{}{}", ran.printed, ran.said);
        assert!(all.contains(harmless), "{all:?}");
        let acts = |c: char| c.is_control() && c != '\n' || c == '\u{202e}';
        assert!(!all.contains(acts), "{arguments:?}: {all:?}");
        assert!(!all.lines().any(|line| line.starts_with("lasray: all is well")), "{all:?}");
    }
    if cfg!(unix) {
        let ran = run(folder.path(), &words(["info", ".", "--json=-"]), &[]);
        assert!(ran.printed.contains(r"./a\\u{1b}[2J\\nlasray: all is well.las"), "{}", ran.printed);
    }
}

/// A field that has one value is described as that value.
#[test]
fn constant_colours_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let draw = |color: &str, rgb: [u16; 3]| {
        let mut bytes = las(300);
        let start = points_at(&bytes);
        for record in bytes[start..].chunks_exact_mut(34) {
            record[12..16].copy_from_slice(&[9, 0, 0x09, 6]);
            record[28..34].copy_from_slice(&rgb.map(u16::to_le_bytes).concat());
        }
        fs::write(folder.path().join("a.las"), bytes).unwrap();
        let picture =
            ["render", "a.las", "-o", "a.png", "--size", "64x36", "--shade", "none", "--color", color];
        let picture = picture.iter().chain(&["--background", "none"]).copied();
        let ran = run(folder.path(), &words(picture), &[]);
        assert_eq!(ran.code, Some(0), "{}", ran.said);
        let pixels = pixels(&folder.path().join("a.png"));
        let drawn: Vec<_> =
            pixels.chunks(4).filter(|pixel| pixel[3] == 255).map(|pixel| &pixel[..3]).collect();
        assert!(drawn.len() > 100 && drawn.windows(2).all(|two| two[0] == two[1]), "{color}: one colour");
        (ran.said, drawn[0].to_vec())
    };
    for (color, rgb, says, drawn) in [
        ("rgb", [65_535; 3], "note: colour is 255,255,255 everywhere, drawn in that colour", [255; 3]),
        ("rgb", [255, 128, 1], "note: colour is 255,128,1 everywhere, drawn in that colour", [255, 128, 1]),
        ("rgb", [0; 3], "note: colour is 0,0,0 everywhere, drawn grey", [166; 3]),
        ("class", [0; 3], "note: class is 6 (building) everywhere, drawn in its colour", [190, 118, 100]),
        ("return", [0; 3], "note: return is single everywhere, drawn in its colour", [222, 208, 178]),
        ("intensity", [0; 3], "note: intensity is 9 everywhere, drawn grey", [166; 3]),
    ] {
        let (said, pixel) = draw(color, rgb);
        assert!(said.contains(says), "{said}");
        assert!(
            pixel.iter().zip(drawn).all(|(a, b)| a.abs_diff(b) <= 1),
            "{color}: {pixel:?}, not {drawn:?}"
        );
    }
}

/// Twenty points have large cells: all of them are in the picture.
#[test]
fn few_points_are_in_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = scattered(20);
    let start = points_at(&bytes);
    for (k, record) in bytes[start..].chunks_exact_mut(34).enumerate() {
        record[8..12].copy_from_slice(&(k as i32 * 100).to_le_bytes());
    }
    fs::write(folder.path().join("a.las"), bytes).unwrap();
    for more in [&[][..], &["--shade", "none"], &["--orbit", "60,50"]] {
        let picture = ["render", "a.las", "-o", "a.png", "--size", "160x90", "--background", "none"];
        let ran = run(folder.path(), &words(picture.iter().chain(more).copied()), &[]);
        assert_eq!(ran.code, Some(0), "{}", ran.said);
        let pixels = pixels(&folder.path().join("a.png"));
        let hit: Vec<bool> = pixels.chunks(4).map(|pixel| pixel[3] > 0).collect();
        let border = (0..hit.len()).filter(|&k| hit[k]).filter_map(|k| {
            let (x, y) = (k % 160, k / 160);
            // Without light, columns have no end below.
            let is_below = y == 89 && !more.contains(&"none");
            (x == 0 || y == 0 || x == 159 || is_below).then_some([x, y])
        });
        let border: Vec<_> = border.collect();
        assert!(hit.iter().filter(|hit| **hit).count() > 500);
        assert!(border.is_empty(), "{more:?}: {border:?}");
    }
}

fn path_case(code: i32, says: &[&'static str], more: &'static [&'static str]) -> Case {
    Case::new(more.join(" "), code, says, move |folder| {
        fs::write(folder.join("good.las"), las(300)).unwrap();
        let keyframe = |time: f64, e: f64| {
            format!(r#"{{"time": {time}, "eye": [{e}, -300, 500], "target": [0, 0, 0]}}"#)
        };
        let path = |keyframes: &[String]| {
            format!("{{\"version\": 1, \"fps\": 3,\n\"keyframes\": [{}]}}", keyframes.join(","))
        };
        fs::write(folder.join("three.json"), path(&[keyframe(0.0, 0.0), keyframe(1.0, 9.0)])).unwrap();
        fs::write(folder.join("view.json"), path(&[keyframe(0.0, 0.0)])).unwrap();
        fs::write(folder.join("back.json"), path(&[keyframe(1.0, 0.0), keyframe(0.0, 9.0)])).unwrap();
        fs::write(folder.join("typo.json"), path(&[keyframe(0.0, 0.0).replace("eye", "eve")])).unwrap();
        let keyframe = |time| format!(r#"{{"time": {time}, "eye": [0, {time}, 0], "target": [0, 3, 0]}}"#);
        fs::write(folder.join("through.json"), path(&[keyframe(0), keyframe(9)])).unwrap();
        Some(words(["good.las"].iter().chain(more).copied()))
    })
}

#[test]
fn paths() {
    try_all(vec![
        path_case(
            0,
            &["3 pictures of 64x36 pixels, 0 of 300 points read"],
            &["--path", "three.json", "-o", "out/%03d.png"],
        )
        .leaving(&["000.png", "001.png", "002.png"]),
        path_case(0, &["2 pictures"], &["--path", "three.json", "--frames", "2", "-o", "out/a%d.exr"])
            .leaving(&["a0.exr", "a1.exr"]),
        path_case(0, &["1 picture of"], &["--path", "view.json", "-o", "out/a.png"]),
        path_case(0, &["1 picture of"], &["--path", "three.json", "--frames", "1", "-o", "out/a.png"]),
        path_case(
            2,
            &["3 pictures need a number in the output's name"],
            &["--path", "three.json", "-o", "out/a.png"],
        ),
        path_case(2, &["'%s' in the output's name"], &["--path", "three.json", "-o", "out/%s.png"]),
        path_case(2, &["two numbers, %d and %04d"], &["--path", "three.json", "-o", "out/%d%04d.png"]),
        path_case(
            2,
            &["--frames 4: three.json has 3"],
            &["--path", "three.json", "--frames", "4", "-o", "out/%d.png"],
        ),
        path_case(2, &["0 is not in 1.."], &["--path", "three.json", "--frames", "0", "-o", "out/%d.png"]),
        path_case(2, &["--path <FILE>"], &["--frames", "2", "-o", "out/%d.png"]),
        path_case(2, &["cannot be used with"], &["--path", "view.json", "--orbit", "0,9", "-o", "out/a.png"]),
        path_case(2, &["cannot be used with"], &["--path", "view.json", "--each", "-o", "out/{stem}.png"]),
        path_case(2, &["cannot be used with"], &["--path", "view.json", "--fov", "30", "-o", "out/a.png"]),
        path_case(2, &["gone.json: cannot be read"], &["--path", "gone.json", "-o", "out/a.png"]),
        path_case(
            2,
            &["good.las: a point cloud, not a camera path"],
            &["--path", "good.las", "-o", "out/a.png"],
        ),
        path_case(
            2,
            &["view.json: it says where a camera is: lasray render --path view.json draws it"],
            &["view.json", "-o", "out/a.png"],
        ),
        path_case(
            2,
            &["typo.json: line 2, column 31: unknown field `eve`"],
            &["--path", "typo.json", "-o", "out/a.png"],
        ),
        path_case(
            2,
            &["back.json: keyframe 2: time 0 is not after 1"],
            &["--path", "back.json", "-o", "out/a.png"],
        ),
        path_case(
            2,
            &["camera path: frame 9: eye and target are both at 0,3,0"],
            &["--path", "through.json", "-o", "out/%d.png"],
        ),
        path_case(
            1,
            &["gone/%d.png: cannot be written: the folder gone does not exist"],
            &["--path", "three.json", "-o", "gone/%d.png"],
        ),
    ]);
}

/// Ctrl-C between two pictures: what is there is whole, the rest is not begun.
#[cfg(unix)]
#[test]
fn a_path_can_be_stopped() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("good.las"), las(300)).unwrap();
    let path = r#"{"version": 1, "keyframes": [{"time": 0, "eye": [0, -300, 500], "target": [0, 0, 0]},
        {"time": 60, "eye": [90, -300, 500], "target": [0, 0, 0]}]}"#;
    fs::write(folder.path().join("long.json"), path).unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_lasray"))
        .args(words("render good.las --path long.json -o %d.png --size 64x36 --no-cache".split(' ')))
        .current_dir(folder.path())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let start = Instant::now();
    while !folder.path().join("2.png").exists() {
        assert!(start.elapsed() < TIME && child.try_wait().unwrap().is_none());
        std::thread::sleep(Duration::from_millis(2));
    }
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let said = read_aside(child.stderr.take().unwrap());
    let status = child.wait().unwrap();
    let said = said.join().unwrap();
    assert_eq!(status.code(), Some(1), "{said}");
    let pictures = fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().path()).filter(|p| {
        assert_ne!(p.extension(), Some(OsStr::new("part")), "nothing is left half-written");
        p.extension() == Some(OsStr::new("png"))
    });
    let pictures: Vec<_> = pictures.collect();
    assert!(said.contains(&format!("stopped after {} of 3600 pictures", pictures.len())), "{said}");
    assert!(pictures.iter().all(|p| pixels(p).len() == 64 * 36 * 3));
}

#[test]
#[expect(clippy::too_many_lines, reason = "a table")]
fn inputs_and_outputs() {
    let two = |folder: &Path| {
        for name in ["a.las", "b.las"] {
            fs::write(folder.join(name), las(300)).unwrap();
        }
    };
    let mut cases = vec![
        Case::new("missing", 1, &["error: gone.las: no such file or folder", "nothing to draw"], |_| {
            Some(words(["gone.las", "-o", "out/a.png"]))
        }),
        Case::new(
            "pattern",
            1,
            &["error: gone*.las: no .las or .laz file or folder fits this pattern"],
            |_| Some(words(["gone*.las", "-o", "out/a.png"])),
        ),
        Case::new("folder without", 1, &["error: sub: the folder holds no .las or .laz file"], |folder| {
            fs::create_dir(folder.join("sub")).unwrap();
            fs::write(folder.join("sub/readme.txt"), "no points").unwrap();
            Some(words(["sub", "-o", "out/a.png"]))
        }),
        Case::new(
            "folder named like a file",
            1,
            &["error: x.las: the folder holds no .las or .laz file"],
            |folder| {
                fs::create_dir(folder.join("x.las")).unwrap();
                Some(words(["x.las", "-o", "out/a.png"]))
            },
        ),
        Case::new("bad beside good", 0, &["error: ./bad.laz: empty file", "600 points "], move |folder| {
            two(folder);
            fs::write(folder.join("bad.laz"), "").unwrap();
            Some(words([".", "-o", "out/a.png"]))
        }),
        Case::new("bad beside good, strict", 1, &["bad.laz: empty file", "600 points "], move |folder| {
            two(folder);
            fs::write(folder.join("bad.laz"), "").unwrap();
            Some(words(["a.las", "b.las", "bad.laz", "--strict", "-o", "out/a.png"]))
        })
        .leaving(&["a.png"]),
        Case::new(
            "list",
            0,
            &["error: tiles.txt, line 3: gone.las: no such file or folder", "300 points "],
            move |folder| {
                two(folder);
                fs::write(folder.join("tiles.txt"), "# tiles\na.las\ngone.las\n").unwrap();
                Some(words(["@tiles.txt", "-o", "out/a.png"]))
            },
        ),
        Case::new("missing list", 1, &["error: gone.txt: cannot be read: "], |_| {
            Some(words(["@gone.txt", "-o", "out/a.png"]))
        }),
        Case::new(
            "list that is none",
            1,
            &["error: bytes.txt: not a text file in UTF-8 (byte 3)"],
            |folder| {
                fs::write(folder.join("bytes.txt"), b"abc\xff").unwrap();
                Some(words(["@bytes.txt", "-o", "out/a.png"]))
            },
        ),
        Case::new(
            "each",
            0,
            &["out/a.png: 64x36", "out/b.png: 64x36", "error: c.las: empty file"],
            move |folder| {
                two(folder);
                fs::write(folder.join("c.las"), "").unwrap();
                Some(words(["a.las", "b.las", "c.las", "--each", "-o", "out/{stem}.png"]))
            },
        )
        .leaving(&["a.png", "b.png"]),
        Case::new("each, one name twice", 0, &["out/a.png: 64x36", "out/sub-a.png: 64x36"], move |folder| {
            two(folder);
            fs::create_dir(folder.join("sub")).unwrap();
            fs::write(folder.join("sub/a.las"), las(300)).unwrap();
            Some(words(["a.las", "sub", "--each", "-o", "out/{stem}.png"]))
        })
        .leaving(&["a.png", "sub-a.png"]),
        Case::new("each, none", 1, &["error: c.las: empty file", "nothing could be drawn"], |folder| {
            fs::write(folder.join("c.las"), "").unwrap();
            Some(words(["c.las", "--each", "-o", "out/{stem}.png"]))
        }),
        Case::new("each, wrong for all", 2, &["error: good.las: at 0.000001 units a pixel"], |folder| {
            fs::write(folder.join("good.las"), las(300)).unwrap();
            Some(words(["good.las", "--each", "-o", "out/{stem}.png", "--ortho", "1e-6"]))
        }),
        Case::arguments(
            &["-o", "gone/a.png"],
            1,
            &["gone/a.png: cannot be written: the folder gone does not exist"],
        ),
        Case::arguments(&["-o", "good.las/a.png"], 1, &["good.las/a.png: cannot be written: good.las"]),
        Case::new("output is a folder", 1, &["sub.png: cannot be written: it is a folder"], move |folder| {
            two(folder);
            fs::create_dir(folder.join("sub.png")).unwrap();
            Some(words(["a.las", "-o", "sub.png"]))
        }),
        Case::new("names", 0, &["Bild größe 点.png: 64x36 pixels, 300 points"], |folder| {
            let sub = folder.join("Flug № 7 ñ");
            fs::create_dir(&sub).unwrap();
            fs::write(sub.join("Höhe 点群.LAS"), las(300)).unwrap();
            Some(words(["Flug № 7 ñ/Höhe 点群.LAS", "-o", "out/Bild größe 点.png"]))
        })
        .leaving(&["Bild größe 点.png"]),
        Case::new("names of broken files", 1, &["Flug № 7 ñ/Höhe [点群].LAS: empty file"], |folder| {
            let sub = folder.join("Flug № 7 ñ");
            fs::create_dir(&sub).unwrap();
            fs::write(sub.join("Höhe [点群].LAS"), "").unwrap();
            Some(words(["Flug № 7 ñ/Höhe [点群].LAS", "-o", "out/a.png"]))
        }),
        Case::new("names for each", 0, &["out/Höhe 点群.png: 64x36"], |folder| {
            fs::write(folder.join("Höhe 点群.LAS"), las(300)).unwrap();
            Some(words([".", "--each", "-o", "out/{stem}.png"]))
        })
        .leaving(&["Höhe 点群.png"]),
        Case {
            environment: vec![("VK_DRIVER_FILES", "/none.json"), ("VK_ICD_FILENAMES", "/none.json")],
            ..Case::arguments(&[], 1, &["no Vulkan device: install a driver", "apt install"])
        }
        .leaving(&[]),
        Case::new("a thousand alike", 0, &["error: and 995 more: empty file", "300 points "], |folder| {
            fs::create_dir(folder.join("tiles")).unwrap();
            fs::write(folder.join("tiles/good.las"), las(300)).unwrap();
            (0..1000).for_each(|k| fs::write(folder.join(format!("tiles/{k}.las")), "").unwrap());
            Some(words(["tiles", "-o", "out/a.png"]))
        }),
    ];
    cases.extend(of_this_system());
    try_all(cases);
}

#[cfg(unix)]
fn of_this_system() -> Vec<Case> {
    use std::os::unix::ffi::OsStrExt;
    use std::os::unix::fs::{PermissionsExt, symlink};
    vec![
        Case::new("dead link", 0, &["error: sub/y.las: cannot be read: ", "300 points "], |folder| {
            fs::create_dir(folder.join("sub")).unwrap();
            fs::write(folder.join("sub/a.las"), las(300)).unwrap();
            symlink("gone", folder.join("sub/y.las")).unwrap();
            Some(words(["sub", "-o", "out/a.png"]))
        }),
        Case::new("pipe", 1, &["error: pipe.las: cannot open: not a regular file"], |folder| {
            let made = Command::new("mkfifo").arg(folder.join("pipe.las")).status();
            if !made.is_ok_and(|status| status.success()) {
                eprintln!("skipped: no mkfifo here");
                return None;
            }
            Some(words(["pipe.las", "-o", "out/a.png"]))
        }),
        Case::new("unreadable", 1, &["error: shut.las: cannot open: Permission denied"], |folder| {
            let path = folder.join("shut.las");
            fs::write(&path, las(300)).unwrap();
            fs::set_permissions(&path, fs::Permissions::from_mode(0o000)).unwrap();
            if fs::File::open(&path).is_ok() {
                eprintln!("skipped: permissions do not hold for this user");
                return None;
            }
            Some(words(["shut.las", "-o", "out/a.png"]))
        }),
        Case::new(
            "read-only output",
            1,
            &["shut/a.png: cannot be written: shut: Permission denied"],
            |folder| {
                fs::write(folder.join("a.las"), las(300)).unwrap();
                let path = folder.join("shut");
                fs::create_dir(&path).unwrap();
                fs::set_permissions(&path, fs::Permissions::from_mode(0o555)).unwrap();
                if fs::write(path.join("x"), "").is_ok() {
                    eprintln!("skipped: permissions do not hold for this user");
                    return None;
                }
                Some(words(["a.las", "-o", "shut/a.png"]))
            },
        ),
        Case::new("output into /proc", 1, &["/proc/a.png: cannot be written: /proc: "], |folder| {
            if !Path::new("/proc/self").exists() {
                eprintln!("skipped: no /proc here");
                return None;
            }
            fs::write(folder.join("a.las"), las(300)).unwrap();
            Some(words(["a.las", "-o", "/proc/a.png"]))
        }),
        Case::new("name in no encoding", 0, &["300 points "], |folder| {
            let name = OsStr::from_bytes(b"ab\xffc.las").to_owned();
            if fs::write(folder.join(&name), las(300)).is_err() {
                eprintln!("skipped: this file system wants names in UTF-8");
                return None;
            }
            Some([name].into_iter().chain(words(["-o", "out/a.png"])).collect())
        }),
    ]
}

#[cfg(not(unix))]
fn of_this_system() -> Vec<Case> {
    Vec::new()
}

#[test]
fn odd_and_hostile_real_files() {
    let Some(data) = data_dir() else { return };
    let files: Vec<PathBuf> = ["hostile", "odd"].iter().flat_map(|f| lidar_files(&data.join(f))).collect();
    assert!(!files.is_empty());
    let cases = files.into_iter().map(|path| {
        let path = path.canonicalize().unwrap();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let refused = ["broken_", "no-points", "data_offset_past_eof", "empty_file", "pdrf_63", "scale_zero"];
        let code = i32::from(refused.iter().any(|r| name.starts_with(r)));
        let says: &[&str] = if code == 0 { &["64x36 pixels"] } else { &["nothing to draw"] };
        Case::new(name, code, says, move |_| {
            Some([path.clone().into()].into_iter().chain(words(["-o", "out/a.png"])).collect())
        })
    });
    try_all(cases.collect());
}

/// Width, and bytes of three channels.
fn pixels(path: &Path) -> Vec<u8> {
    let file = BufReader::new(fs::File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut bytes).unwrap();
    bytes
}

/// One more record, `by` units from the first one; the header says so.
fn with_stray(mut bytes: Vec<u8>, by: [f64; 3]) -> Vec<u8> {
    let start = points_at(&bytes);
    let mut record = bytes[start..start + 34].to_vec();
    for (axis, &by) in by.iter().enumerate() {
        let float = |at: usize| f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
        let (scale, offset, high) = (float(131 + 8 * axis), float(155 + 8 * axis), 179 + 16 * axis);
        let raw = i32::from_le_bytes(record[4 * axis..4 * axis + 4].try_into().unwrap());
        let stray = raw + (by / scale) as i32;
        let reached = float(high).max(f64::from(stray) * scale + offset);
        record[4 * axis..4 * axis + 4].copy_from_slice(&stray.to_le_bytes());
        bytes[high..high + 8].copy_from_slice(&reached.to_le_bytes());
    }
    bytes.extend(record);
    let count = u32::from_le_bytes(bytes[107..111].try_into().unwrap());
    with(bytes, 107, &(count + 1).to_le_bytes())
}

#[test]
fn one_stray_point_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let town = words("synth town.las --points 60k --size 90 --format 3 -q".split(' '));
    assert_eq!(run(folder.path(), &town, &[]).code, Some(0));
    let sound = fs::read(path("town.las")).unwrap();
    assert_eq!(sound[104], 3);
    let draw = |name: &str| {
        let ran = run(folder.path(), &words(["render", name, "-o", "a.png", "--size", "160x90"]), &[]);
        assert_eq!(ran.code, Some(0), "{}", ran.said);
        assert!(ran.peak <= MEMORY, "{name} takes {} MiB", ran.peak >> 20);
        (pixels(&path("a.png")), ran.said)
    };
    let (without, _) = draw("town.las");
    for (name, by) in [
        ("east.las", [185_000.0, 0.0, 0.0]),
        ("west.las", [-185_000.0, -185_000.0, 0.0]),
        ("high.las", [0.0, 0.0, 175_000.0]),
        ("deep.las", [0.0, 0.0, -175_000.0]),
        ("far.las", [185_000.0, 185_000.0, 175_000.0]),
    ] {
        fs::write(path(name), with_stray(sound.clone(), by)).unwrap();
        let (stray, said) = draw(name);
        assert!(said.contains("60001 points"), "{said}");
        let pairs = without.chunks_exact(3).zip(stray.chunks_exact(3));
        let same = pairs.filter(|(a, b)| a.iter().zip(*b).all(|(a, b)| a.abs_diff(*b) <= 2)).count();
        let share = same as f64 / (160.0 * 90.0);
        println!("{name}: {:.2} % of the pixels are the same", 100.0 * share);
        assert!(share > 0.97, "{name}: {share}");
    }
}

/// Good real files: drawn, and nothing is said but what is known of them.
#[test]
fn good_real_files_are_drawn_without_complaint() {
    let Some(data) = data_dir() else { return };
    let folder = tempfile::tempdir().unwrap();
    let bad = |path: &Path| ["hostile", "odd", "reports"].iter().any(|f| path.starts_with(data.join(f)));
    let files: Vec<_> = lidar_files(&data).into_iter().filter(|path| !bad(path)).collect();
    assert!(files.len() > 50);
    // What a surveyor would want to know of these files.
    let known = [
        ("lone-star.copc.laz", "warning: ", "geocentric"),
        ("1.2-with-color.copc.laz", "note: ", "heights are in US survey foot"),
    ];
    let (next, wrong) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                loop {
                    let at = next.fetch_add(1, Ordering::Relaxed);
                    let Some(path) = files.get(at) else { return };
                    let path = path.canonicalize().unwrap();
                    let picture = folder.path().join(format!("{at}.png"));
                    let mut arguments = words(["render", "--size", "64x36", "-o"]);
                    arguments.extend([picture.into(), path.clone().into()]);
                    let ran = run(folder.path(), &arguments, &[]);
                    let expected = |line: &str| {
                        line.contains(": 64x36 pixels, ")
                            || line.starts_with("note: height is ")
                                && line.ends_with("everywhere, drawn grey")
                            || known.iter().any(|&(file, start, says)| {
                                path.ends_with(file) && line.starts_with(start) && line.contains(says)
                            })
                    };
                    if ran.code != Some(0) || !ran.said.lines().all(expected) {
                        wrong.lock().unwrap().push(format!(
                            "{}: {:?} {}",
                            path.display(),
                            ran.code,
                            ran.said
                        ));
                    }
                }
            });
        }
    });
    let wrong = wrong.into_inner().unwrap();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// What was learned is kept in the user's cache folder, unless that is not wanted or cannot be.
#[test]
fn the_cache_is_never_needed() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let render = |picture: &str, cache: &str, more: &[&str]| {
        let size = "render town.laz --size 160x90 --cell 0.125 --orbit 0,90,20 -q --json a.json";
        let all = words(size.split(' ').chain(more.iter().copied()).chain(["-o", picture]));
        let ran = run(folder.path(), &all, &[("LASRAY_CACHE", at(cache).to_str().unwrap())]);
        assert_eq!((ran.code, ran.said.as_str()), (Some(0), ""), "{picture}");
        let json: serde_json::Value = serde_json::from_slice(&fs::read(at("a.json")).unwrap()).unwrap();
        json[0]["bytes_read"].as_u64().unwrap()
    };
    let made = run(folder.path(), &words(["synth", "town.laz", "--points", "400k"]), &[]);
    assert_eq!(made.code, Some(0), "{}", made.said);
    let all = render("none.png", "none", &["--no-cache"]);
    assert!(!at("none").exists());
    assert_eq!(render("first.png", "kept", &[]), all);
    // Beside what was learned of the file lie compiled programs.
    let entries = || -> Vec<_> {
        let all = fs::read_dir(at("kept")).unwrap().map(|entry| entry.unwrap().path());
        all.filter(|path| path.extension().is_some_and(|e| e == "bounds")).collect()
    };
    assert_eq!(entries().len(), 1);
    let then = render("second.png", "kept", &[]);
    assert!(then < all, "{then} of {all} bytes");
    // The last line tells the points that were read.
    let line = "render town.laz --size 160x90 --cell 0.125 --orbit 0,90,20 -o told.png";
    let told = run(folder.path(), &words(line.split(' ')), &[("LASRAY_CACHE", at("kept").to_str().unwrap())]);
    assert!(told.said.contains(" of 400000 points read, "), "{}", told.said);
    // A file in the place of the folder, and another one in the place of the entry.
    assert_eq!(render("file.png", "town.laz", &[]), all);
    fs::write(&entries()[0], "nonsense").unwrap();
    assert_eq!(render("nonsense.png", "kept", &[]), all);
    for name in ["first.png", "second.png", "file.png", "nonsense.png"] {
        assert!(pixels(&at(name)) == pixels(&at("none.png")), "{name}");
    }
}

#[test]
fn help_is_readable() {
    let folder = tempfile::tempdir().unwrap();
    for arguments in
        [&["--help"][..], &["render", "--help"], &["bench", "--help"], &["synth", "--help"], &["--version"]]
    {
        let output = Command::new(env!("CARGO_BIN_EXE_lasray"))
            .args(arguments)
            .current_dir(folder.path())
            .env("COLUMNS", "100")
            .output()
            .unwrap();
        assert!(output.status.success());
        let page = String::from_utf8(output.stdout).unwrap();
        assert!(page.lines().all(|line| line.chars().count() <= 100), "{page}");
    }
    let nothing = run(folder.path(), &[], &[]);
    assert_eq!(nothing.code, Some(2));
    assert!(nothing.said.contains("Usage: lasray <COMMAND>"), "{}", nothing.said);
}

#[test]
fn bench_measures_both_pipelines() {
    let folder = tempfile::tempdir().unwrap();
    let ran = run(
        folder.path(),
        &words(
            "bench --frames 2 --grid 16/5 --paths turn,fast --size 64x36 --points 50k --json a.json --plot a.svg -q"
                .split(' '),
        ),
        &[],
    );
    assert_eq!((ran.code, ran.said.as_str()), (Some(0), ""));
    for said in
        ["thesis / pool, trace: turn ", "thesis in strips of: ", "times of the same frames differ by: turn "]
    {
        assert!(ran.printed.contains(said), "{}", ran.printed);
    }
    assert!(ran.printed.lines().all(|line| line.chars().count() <= 110), "{}", ran.printed);
    let json = fs::read_to_string(folder.path().join("a.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let rows = json["rows"].as_array().unwrap();
    let named: Vec<_> =
        rows.iter().map(|row| [&row["path"], &row["pipeline"]].map(|v| v.as_str().unwrap())).collect();
    assert_eq!(named, [["turn", "thesis"], ["turn", "pool"], ["fast", "thesis"], ["fast", "pool"]]);
    let samples = |row: &serde_json::Value, what: &str| row[what]["samples"].as_array().unwrap().len();
    for row in rows {
        let pool = row["pipeline"] == "pool";
        assert_eq!((row["grid"].as_u64(), row["levels"].as_u64()), (Some(16), Some(5)));
        assert_eq!((row["frames"].as_u64(), row["rays"].as_u64()), (Some(2), Some(64 * 36)));
        assert_eq!([samples(row, "trace_ms"), samples(row, "total_ms")], [2, 2]);
        // The pool streams in every frame of 20 s.
        assert_eq!(samples(row, "copy_bytes"), if pool { 1200 } else { 2 });
        assert!(row["trace_ms"]["median"].as_f64().unwrap() > 0.0);
        // Each frame was timed three times, and the passes with it.
        assert_eq!(row["repeats"]["ms"].as_array().unwrap().len(), 3);
        assert!(row["spread"].as_f64().unwrap() >= 0.0);
        let passes = row["passes_ms"].as_object().unwrap();
        let names = passes.keys().map(String::as_str).collect::<Vec<_>>();
        assert_eq!(names, if pool { vec!["beams", "trace", "wide beams"] } else { vec!["trace"] });
        assert!(passes.keys().all(|name| samples(&row["passes_ms"], name) == 2));
        assert_eq!(row["strip"].is_array(), !pool);
        if pool {
            assert!(row["differ"].as_f64().unwrap() <= 1e-3, "{row}");
            assert!(row["steps_per_ray"].as_f64().unwrap() > 0.0);
            assert!(row["ns_per_step"].as_f64().unwrap() > 0.0);
        } else {
            // 16² cells of the coarsest of five levels: heights of all levels, colours of the finest.
            let heights: u64 = (0..5).map(|level| (256u64 >> level).pow(2)).sum();
            assert_eq!(row["copy_bytes"]["mean"].as_f64(), Some(4.0 * (heights + 256 * 256) as f64));
        }
    }
    assert_eq!(rows[1]["copy_bytes"]["max"].as_f64(), Some(0.0), "a turn on the spot copies nothing");
    let ratios = &json["ratios"][0];
    assert_eq!(ratios["paths"].as_array().unwrap().len(), 2);
    assert!(ratios["bytes"][0].is_null() && ratios["bytes"][1].as_f64().unwrap() > 0.0);
    // Times that are not alike have no ratio.
    let steady = |pair: &[serde_json::Value]| pair.iter().all(|row| row["steady"] == true);
    let has_ratio =
        ratios["trace"].as_array().unwrap().iter().map(|ratio| ratio.as_f64().is_some_and(|r| r > 0.0));
    assert_eq!(has_ratio.collect::<Vec<_>>(), rows.chunks(2).map(steady).collect::<Vec<_>>());
    assert!(json["skipped"].as_array().unwrap().is_empty());
    assert!(fs::read_to_string(folder.path().join("a.svg")).unwrap().starts_with("<svg"));
}

#[test]
fn bench_loads_as_the_thesis_does() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = "bench --load --threads 1,2,1 --points 20k --json a.json -q";
    let ran = run(folder.path(), &words(arguments.split(' ')), &[]);
    assert_eq!((ran.code, ran.said.as_str()), (Some(0), ""));
    assert!(ran.printed.contains("loading town.las, 20k points"), "{}", ran.printed);
    let json = fs::read_to_string(folder.path().join("a.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert!(json["rows"].as_array().unwrap().is_empty(), "no frames were asked for");
    let threads = |json: &serde_json::Value, part: &str| -> Vec<_> {
        json[part].as_array().unwrap().iter().map(|row| row["threads"].as_u64().unwrap()).collect()
    };
    assert_eq!(threads(&json, "load"), [1, 2]);
    for arguments in
        ["synth a.las --points 1k", "bench --ingest a.las --threads 2,all,1,2 --cell 1 --json b.json -q"]
    {
        assert_eq!(run(folder.path(), &words(arguments.split(' ')), &[]).code, Some(0));
    }
    let read = fs::read_to_string(folder.path().join("b.json")).unwrap();
    let read = threads(&serde_json::from_str(&read).unwrap(), "ingest");
    let (warm, cold) = read.split_at(read.len() / 2);
    let all = std::thread::available_parallelism().map_or(1, |n| n.get() as u64);
    let mut asked = vec![2, all, 1];
    asked.dedup();
    assert_eq!((warm, cold), (&asked[..], &asked[..]));
    let row = &json["load"][0];
    assert_eq!((row["points"].as_u64(), row["kept"].as_u64()), (Some(20_000), Some(20_000)));
    let median = |what: &str| row[what]["median"].as_f64().unwrap();
    assert!(median("thesis_middle_s") <= median("thesis_all_s"));
    assert!(median("thesis_middle_s") > 0.0 && median("upload_s") > 0.0);
    assert!(median("total_s") >= median("read_s"));
}

/// Files are made once; what is damaged is not read.
#[test]
fn bench_compares_the_ground_with_classes() {
    let folder = tempfile::tempdir().unwrap();
    let ran = |arguments: &str| run(folder.path(), &words(arguments.split(' ')), &[]);
    assert_eq!(ran("synth town.las --points 200k").code, Some(0));
    let told = ran("bench --complete --truth town.las --json a.json -q");
    assert_eq!((told.code, told.said.as_str()), (Some(0), ""));
    for said in ["ground: 200k points in ", " us a tile cell of one core", "errors, %", "mean of the files"] {
        assert!(told.printed.contains(said), "{}", told.printed);
    }
    let json: serde_json::Value =
        serde_json::from_slice(&fs::read(folder.path().join("a.json")).unwrap()).unwrap();
    let row = &json["ground"][0];
    assert_eq!((row["points"].as_u64(), row["cell"].as_f64()), (Some(200_000), Some(1.0)));
    assert!(row["truth"][0]["total"].as_f64().unwrap() < 0.1, "{row}");
    assert!(ran("bench --complete --points 20k -q").printed.contains("ground: 20k points"));
    // Nothing is classified: no truth.
    let mut records = two_lines(15.0);
    records.chunks_mut(28).for_each(|record| record[15] = 1);
    let made = Made { records, header: Some(([0.01; 3], [0.0; 3])), ..Made::new(1, Packing::Plain, 1) };
    fs::write(folder.path().join("none.las"), made.bytes()).unwrap();
    let none = ran("bench --complete --truth none.las -q");
    assert_eq!(none.code, Some(1));
    assert!(none.said.contains("none.las: none of its points is classified as ground"), "{}", none.said);
}

#[test]
fn bench_keeps_the_files_that_it_makes() {
    let folder = tempfile::tempdir().unwrap();
    let kept = || -> Vec<PathBuf> {
        let sets = fs::read_dir(folder.path().join("cache/bench")).into_iter().flatten();
        let files = sets.flat_map(|set| fs::read_dir(set.unwrap().path()).unwrap());
        files
            .map(|file| file.unwrap().path())
            .filter(|file| file.extension() == Some(OsStr::new("las")))
            .collect()
    };
    let bench = |more: &str| {
        let arguments = format!("bench --load --threads all --points 20k{more}");
        let ran = run(folder.path(), &words(arguments.split(' ')), &[]);
        assert_eq!(ran.code, Some(0), "{}", ran.said);
        ran.said.contains("writing 20000 points as las")
    };
    assert!(bench(" --no-cache") && kept().is_empty());
    assert!(bench(""));
    let [file] = &kept()[..] else { panic!("{:?}", kept()) };
    let whole = fs::read(file).unwrap();
    assert!(!bench(""));
    fs::write(file, &whole[..whole.len() / 2]).unwrap();
    assert!(bench(""));
    assert!(fs::read(file).unwrap().len() == whole.len() && !bench(""));
}

#[test]
fn bench_streams_and_no_frame_waits() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = "bench --stream --frames 6 --runs 2 --paths slow,fast --size 48x27 --points 60k --shade none --json a.json";
    let ran = run(folder.path(), &words(arguments.split(' ')), &[]);
    assert_eq!(ran.code, Some(0), "{}", ran.said);
    assert!(ran.said.contains("las: slow, run 1 of 2: streaming"), "{}", ran.said);
    assert!(ran.printed.contains("frames that waited for streaming: 0 of 144"), "{}", ran.printed);
    assert!(ran.printed.lines().all(|line| line.chars().count() <= 110), "{}", ran.printed);
    let json = fs::read_to_string(folder.path().join("a.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    for what in ["device", "driver", "commit", "settings"] {
        assert!(!json[what].is_null(), "{what}");
    }
    assert!(json["rows"].as_array().unwrap().is_empty(), "nothing else was asked for");
    let rows = json["stream"].as_array().unwrap();
    let named: Vec<_> =
        rows.iter().map(|row| [&row["data"], &row["path"]].map(|v| v.as_str().unwrap())).collect();
    assert_eq!(named, [["las", "slow"], ["las", "fast"], ["laz", "slow"], ["laz", "fast"]]);
    for row in rows {
        assert_eq!((row["kind"].as_str(), row["waits"].as_u64()), (Some("stream"), Some(0)));
        assert_eq!((row["frames"].as_u64(), row["runs"].as_u64()), (Some(6), Some(2)));
        assert_eq!(row["ratios"].as_array().unwrap().len(), 2);
        // Only what is steady is compared, which so few frames need not be.
        let spreads = row["spreads"].as_array().unwrap();
        for (ratio, spread) in row["ratios"].as_array().unwrap().iter().zip(spreads) {
            assert_eq!(ratio.is_number(), spread.as_f64().unwrap() <= 0.1, "{row}");
        }
        assert_eq!(
            row["ratio_p95"].is_number(),
            row["ratios"].as_array().unwrap().iter().any(|r| r.is_number())
        );
        // A small town fits.
        assert_eq!((row["not_resident"].as_u64(), row["coarser_frames"].as_u64()), (Some(0), Some(0)));
        let samples = |way: &str, what: &str| -> Vec<f64> {
            let samples = row[way][what]["samples"].as_array().unwrap();
            samples.iter().map(|v| v.as_f64().unwrap()).collect()
        };
        for way in ["streaming", "resident"] {
            for what in ["frame_ms", "tick_ms", "table_ms", "upload_bytes", "wanted", "ready"] {
                assert_eq!(samples(way, what).len(), if way == "resident" { 24 } else { 12 }, "{way} {what}");
            }
            let (frames, ticks) = (samples(way, "frame_ms"), samples(way, "tick_ms"));
            assert!(frames.iter().zip(ticks).all(|(frame, tick)| *frame > tick && tick > 0.0));
        }
        assert_eq!(samples("resident", "ready"), samples("resident", "wanted"));
        assert!(samples("resident", "wanted").iter().any(|&wanted| wanted > 0.0));
        assert!(samples("resident", "upload_bytes").iter().all(|&bytes| bytes == 0.0));
        // Each run begins with nothing.
        assert_eq!([samples("streaming", "ready")[0], samples("streaming", "ready")[6]], [0.0; 2]);
    }
    assert_eq!(json["settings"]["surface"], "stacks", "as files are drawn");
    let rows = json["layers"].as_array().unwrap();
    assert_eq!(rows.iter().map(|row| row["data"].as_str().unwrap()).collect::<Vec<_>>(), ["las", "laz"]);
    for row in rows {
        assert_eq!((row["kind"].as_str(), row["section_bytes"].as_u64()), (Some("layers"), Some(0)));
        let samples = |what: &str| -> Vec<f64> {
            row[what]["samples"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
        };
        // To bare earth and back in each run.
        for what in ["took_ms", "in_sight_ms", "sections", "parts"] {
            assert_eq!(samples(what).len(), 4, "{what}");
            assert!(samples(what).iter().all(|v| *v > 0.0), "{what}");
        }
        assert!(samples("took_ms").iter().zip(samples("in_sight_ms")).all(|(all, seen)| seen <= *all));
        assert_eq!(samples("resting_ms").len(), 4 * 20);
        assert!(samples("frame_ms").len() as f64 >= samples("parts").iter().sum());
        assert_eq!(samples("ratios").len(), samples("frame_ms").len());
    }
}

#[test]
fn bench_streams_columns_and_smooth_surfaces_too() {
    let folder = tempfile::tempdir().unwrap();
    for surface in ["columns", "smooth"] {
        let arguments = format!(
            "bench --stream --frames 3 --runs 1 --paths slow --size 48x27 --points 60k --format las \
             --surface {surface} --json a.json -q"
        );
        let ran = run(folder.path(), &words(arguments.split_whitespace()), &[]);
        assert_eq!(ran.code, Some(0), "{}", ran.said);
        let json = fs::read_to_string(folder.path().join("a.json")).unwrap();
        let json: serde_json::Value = serde_json::from_str(&json).unwrap();
        assert_eq!((&json["settings"]["surface"], &json["stream"][0]["waits"]), (&surface.into(), &0.into()));
        assert!(json["layers"][0]["took_ms"]["median"].as_f64().unwrap() > 0.0);
    }
}

/// As `timeout` does: what was measured until then is told, in every form, and the code says that it is not all.
#[cfg(unix)]
#[test]
fn bench_tells_what_it_has_when_it_is_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let cases = [
        ("--frames 2 --paths turn,fast --plot a.svg", "TERM", "32/8 turn     pool", "rows"),
        ("--stream --frames 6 --format las --shade none --runs 1000000", "INT", "run 2 of", "stream"),
    ];
    for (arguments, signal, seen, part) in cases {
        let arguments = format!("bench {arguments} --size 48x27 --points 60k --json a.json");
        let mut child = Command::new(env!("CARGO_BIN_EXE_lasray"))
            .args(words(arguments.split(' ')))
            .current_dir(folder.path())
            .env("LASRAY_CACHE", folder.path().join("cache"))
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let printed = read_aside(child.stdout.take().unwrap());
        let mut said = String::new();
        let mut lines = BufReader::new(child.stderr.take().unwrap());
        while !said.contains(seen) {
            assert!(lines.read_line(&mut said).unwrap() > 0, "{said}");
        }
        let kill = [format!("-{signal}"), child.id().to_string()];
        assert!(Command::new("kill").args(kill).status().unwrap().success());
        lines.read_to_string(&mut said).unwrap();
        let (status, printed) = (child.wait().unwrap(), printed.join().unwrap());
        assert_eq!(status.code(), Some(1), "{said}");
        assert!(said.contains("lasray: stopped"), "{said}");
        assert!(printed.contains("stopped: not everything that was asked for was measured"), "{printed}");
        let json = fs::read_to_string(folder.path().join("a.json")).unwrap();
        let json: serde_json::Value = serde_json::from_str(&json).unwrap();
        assert_eq!(json["stopped"], true);
        assert!(!json[part].as_array().unwrap().is_empty(), "{said}");
        assert!(folder.path().join("a.svg").exists());
    }
}

#[test]
fn bench_says_when_the_budget_holds_no_path() {
    let folder = tempfile::tempdir().unwrap();
    let synth = words("synth town.las --points 400k --density 2".split(' '));
    assert_eq!(run(folder.path(), &synth, &[]).code, Some(0));
    let arguments = "bench --stream town.las --frames 8 --runs 1 --paths turn --size 320x180 --cell 0.25 -q \
                     --device-memory 12MiB --json a.json";
    let ran = run(folder.path(), &words(arguments.split_whitespace()), &[]);
    assert_eq!(ran.code, Some(0), "{}", ran.said);
    let json = fs::read_to_string(folder.path().join("a.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let row = &json["stream"][0];
    assert_eq!((row["data"].as_str(), row["waits"].as_u64()), (Some("town"), Some(0)));
    assert!(row["not_resident"].as_u64().unwrap() > 0, "{}", ran.printed);
    assert!(ran.printed.contains("frames that should have been resident and were not: town turn"));
}

#[test]
fn bench_names_wrong_arguments() {
    let folder = tempfile::tempdir().unwrap();
    let mut cases = vec![
        ("--grid 33/8", "a grid of 33: expected a power of two"),
        ("--grid 32", "'32' is not GRID/LEVELS"),
        ("--grid 32/10", "10 levels: expected 1 to 9"),
        ("--grid 32/8 --table", "cannot be used with"),
        ("--paths sideways", "at-rest"),
        ("--frames 0", "0 is not in"),
        ("--size 0x4", "at least one pixel"),
        ("--cell 0", "0 is not above 0"),
        ("--points none", "'none' is not a count"),
        ("--strip 4096x4096", "at most"),
        ("--path missing.json", "missing.json"),
        ("--json nowhere/a.json", "--json nowhere/a.json: cannot be written: nowhere does not exist"),
        ("--ingest --plot a.svg", "no frames are measured"),
        ("--scaling --grid 16/1", "at least two levels"),
        ("--truth", "--complete"),
        ("--complete --plot a.svg", "no frames are measured"),
        ("--runs 2", "--stream"),
        ("--surface stacks", "--surface: only --stream and --ingest take it"),
        ("--threads 2", "--threads: only --ingest and --load"),
        ("--ingest --threads 1,0", "'0' is not a number of threads"),
        ("--load --threads many", "'many' is not a number of threads"),
        ("--stream --runs 0", "0 is not in"),
        ("--stream --device-memory much", "not a number of bytes"),
        ("--stream --plot a.svg", "no frames are measured"),
        ("--device 99", "there is no device 99"),
    ];
    if cfg!(not(feature = "embree")) {
        cases.push(("--peer", "without Embree"));
    }
    for (arguments, says) in cases {
        let ran = run(folder.path(), &words(["bench"].into_iter().chain(arguments.split(' '))), &[]);
        assert_eq!(ran.code, Some(2), "{arguments}: {}", ran.said);
        assert!(ran.said.contains(says), "{arguments}: {}", ran.said);
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// Records of format 1, scale 0.01: land at 10 with four points of line 1 in each square metre of 64 x 64, a `roof` in one
/// place; in the east two points more of line 2, a quarter higher.
fn two_lines(roof: f64) -> Vec<u8> {
    let mut records = Vec::new();
    let mut add = |x: f64, y: f64, z: f64, class: u8, line: u16| {
        for v in [x, y, z] {
            records.extend(((v * 100.0).round() as i32).to_le_bytes());
        }
        records.extend([0, 0, 0x09, class, 0, 0]);
        records.extend(line.to_le_bytes());
        records.extend(0f64.to_le_bytes());
    };
    for (i, j) in (0..64).flat_map(|i| (0..64).map(move |j| (i, j))) {
        let (x, y) = (f64::from(i), f64::from(j));
        let is_roof = (8..16).contains(&i) && (8..16).contains(&j);
        let (z, class) = if is_roof { (roof, 6) } else { (10.0, 2) };
        for k in 0..4 {
            add(x + 0.25 + 0.5 * f64::from(k % 2), y + 0.25 + 0.5 * f64::from(k / 2), z, class, 1);
        }
        if i >= 32 {
            add(x + 0.3, y + 0.6, z + 0.25, class, 2);
            add(x + 0.7, y + 0.4, z + 0.25, class, 2);
        }
    }
    records
}

/// What a channel of an EXR has where something was hit, and its height there.
fn hit_values(path: &Path, name: &str) -> Vec<[f32; 2]> {
    use exr::prelude::FlatSamples;
    let image = exr::prelude::read_first_flat_layer_from_file(path).unwrap();
    let channel = |name: &str| {
        let channels = &image.layer_data.channel_data.list;
        match &channels.iter().find(|channel| channel.name.to_string() == name).unwrap().sample_data {
            FlatSamples::F32(values) => values,
            _ => panic!("{name} are no f32"),
        }
    };
    let hits = channel("distance").iter().map(|distance| distance.is_finite());
    let values = channel(name).iter().zip(channel("height")).map(|(value, height)| [*value, *height]);
    values.zip(hits).filter(|(_, is_hit)| *is_hit).map(|(values, _)| values).collect()
}

/// A file of records of format 1, scale 0.01.
fn write_lines(path: &Path, records: Vec<u8>) {
    let made = Made { records, header: Some(([0.01; 3], [0.0; 3])), ..Made::new(1, Packing::Plain, 1) };
    fs::write(path, made.bytes()).unwrap();
}

/// Values of a measure of a map of `lines.las`, one a unit.
fn mapped(folder: &Path, color: &str, more: &[&str]) -> Vec<f32> {
    let line = ["render", "lines.las", "-o", "a.exr", "--shade", "none", "--ortho=1", "--color", color];
    let ran = run(folder, &words(line.iter().chain(more).copied()), &[]);
    assert_eq!(ran.code, Some(0), "{}", ran.said);
    hit_values(&folder.join("a.exr"), &color.replace('-', "_")).into_iter().map(|[value, _]| value).collect()
}

#[test]
fn measures_do_not_depend_on_what_is_shown() {
    let folder = tempfile::tempdir().unwrap();
    let mut records = two_lines(60.0);
    let mut beside = two_lines(60.0);
    // A wire of few points over the land.
    for (k, record) in beside.chunks_exact_mut(28).take(20).enumerate() {
        let (x, z) = (1000 + 200 * k as i32, 4000 + k as i32 % 2);
        record[..12].copy_from_slice(&[x, 4050, z].map(i32::to_le_bytes).concat());
        record[15] = 14;
    }
    records.extend_from_slice(&beside[..20 * 28]);
    write_lines(&folder.path().join("lines.las"), records);
    let spread = |color: &str, more: &[&str]| {
        let all = [&["--cell", "1", "--surface", "columns"], more].concat();
        let values = mapped(folder.path(), color, &all);
        let ends = values.iter().fold([f32::MAX, f32::MIN], |[a, b], v| [a.min(*v), b.max(*v)]);
        (values.len(), ends)
    };
    // As exactly as 16 bits tell of heights up to 250.
    let near = |value: f32, want: f32| (value - want).abs() < 0.006;
    let (pixels, [low, high]) = spread("height-above-ground", &["--classes", "6"]);
    assert!(pixels == 64 && near(low, 50.0) && near(high, 50.0), "{pixels}, {low} to {high}");
    let (pixels, [low, high]) = spread("height-above-ground", &["--classes", "14"]);
    // In the east the ground is a quarter higher.
    assert!(pixels > 18 && near(low, 29.75) && near(high, 30.01), "{pixels}, {low} to {high}");
    assert_eq!(spread("density", &["--classes", "6"]), (64, [4.0; 2]));
    // One or two of the wire's points beside the 64 or 96 of a square.
    assert_eq!(spread("density", &["--classes", "14"]).1, [4.0625, 6.125]);
    let (pixels, [low, high]) = spread("line-difference", &["--classes", "14"]);
    assert!(pixels > 3 && near(low, 0.25) && near(high, 0.25), "{pixels}, {low} to {high}");
}

#[test]
fn a_hall_wider_than_a_section_is_as_high_as_it_is_or_unknown() {
    let folder = tempfile::tempdir().unwrap();
    let mut records = Vec::new();
    for (i, j) in (0..600).flat_map(|i| (0..600).map(move |j| (i, j))) {
        let is_hall = (60..540).contains(&i) && (60..540).contains(&j);
        let (z, class) = if is_hall { (2000, 6) } else { (1000, 2) };
        records.extend([25 + 50 * i, 25 + 50 * j, z].map(i32::to_le_bytes).concat());
        records.extend([0, 0, 0x09, class, 0, 0, 1, 0]);
        records.extend(0f64.to_le_bytes());
    }
    write_lines(&folder.path().join("lines.las"), records);
    for (cell, least) in [("0.5", 0.6), ("1", 0.95), ("4", 0.99)] {
        let line =
            ["render", "lines.las", "-o", "a.exr", "--shade", "none", "--ortho", "--color", "hag", "--cell"];
        let ran = run(folder.path(), &words(line.into_iter().chain([cell])), &[]);
        assert_eq!(ran.code, Some(0), "{}", ran.said);
        let values = hit_values(&folder.path().join("a.exr"), "height_above_ground");
        let roofs: Vec<f32> =
            values.iter().filter(|[_, height]| *height > 15.0).map(|[above, _]| *above).collect();
        assert!(roofs.iter().all(|above| above.is_nan() || (above - 10.0).abs() < 0.01), "cells of {cell}");
        let known = roofs.iter().filter(|above| !above.is_nan()).count() as f64 / roofs.len() as f64;
        assert!(known >= least, "cells of {cell}: {known} are known");
        assert!(values.iter().all(|[above, height]| *height > 15.0 || *above == 0.0), "cells of {cell}");
    }
}

#[test]
fn measures_of_the_demo_are_those_of_its_town() {
    let folder = tempfile::tempdir().unwrap();
    let values = |color: &str, name: &str| {
        let line = ["render", "--demo", "-o", "a.exr", "--shade", "none", "--cell", "2", "--color", color];
        let ran = run(folder.path(), &words(line.into_iter().chain(["--size", "320x180"])), &[]);
        assert_eq!(ran.code, Some(0), "{}", ran.said);
        (hit_values(&folder.path().join("a.exr"), name), ran.said)
    };
    let (above, said) = values("hag", "height_above_ground");
    let highest = above.iter().fold(0.0f32, |high, [above, _]| high.max(*above));
    assert!((20.0..60.0).contains(&highest), "{highest}");
    assert!(said.contains("from 0.0 to") && !said.contains("to 1.0"), "{said}");
    let (apart, _) = values("line-difference", "line_difference");
    let mut apart: Vec<f32> = apart.into_iter().map(|[apart, _]| apart).filter(|v| !v.is_nan()).collect();
    apart.sort_by(f32::total_cmp);
    assert!(apart[apart.len() / 2] < 2.0, "{}", apart[apart.len() / 2]);
    let (density, said) = values("density", "density");
    let mean = density.iter().map(|[density, _]| density).sum::<f32>() / density.len() as f32;
    assert!((5.0..40.0).contains(&mean) && !said.contains("to 2.0"), "{mean}: {said}");
}

#[test]
fn options_that_change_nothing_and_lines_that_cannot_differ_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let mut records = two_lines(15.0);
    // One line flew all of it.
    for (k, record) in records.chunks_exact_mut(28).enumerate() {
        (record[15], record[18], record[19]) = (if k % 3 == 0 { 6 } else { 2 }, 17, 0);
    }
    write_lines(&folder.path().join("lines.las"), records);
    for (arguments, says) in [
        ("--color class --range 0..5", "note: --range changes nothing: colours by class have no ramp"),
        ("--color source-id --ramp magma", "note: --ramp changes nothing: colours by source-id have no ramp"),
        ("--color source-id", "note: source id is 17 everywhere, drawn in one colour"),
        (
            "--color line-difference",
            "note: all points that were seen are of one flight line (source id 17), drawn grey",
        ),
        ("--color height --range 0..5", ""),
        // What is shown changes nothing of it.
        ("--classes 2", "coloured by class"),
        ("", "coloured by class"),
    ] {
        let line = format!("render lines.las -o a.png --size 64x48 {arguments}");
        let ran = run(folder.path(), &words(line.split_whitespace()), &[]);
        assert_eq!(ran.code, Some(0), "{arguments}: {}", ran.said);
        assert!(ran.said.contains(says), "{arguments}: {}", ran.said);
        assert_eq!(
            ran.said.contains("note:"),
            says.starts_with("note:") || arguments == "--classes 2",
            "{arguments}: {}",
            ran.said
        );
    }
}

#[test]
fn measures_of_a_made_file_are_what_it_was_made_with() {
    let folder = tempfile::tempdir().unwrap();
    write_lines(&folder.path().join("lines.las"), two_lines(15.0));
    let values = |color: &str, more: &[&str]| {
        let seen = mapped(folder.path(), color, more);
        assert!((4096 - 64..=4096).contains(&seen.len()), "{} pixels of {color}", seen.len());
        seen
    };
    for surface in ["columns", "stacks"] {
        for cell in ["1", "2"] {
            let more = ["--cell", cell, "--surface", surface];
            let what = format!("{surface}, cells of {cell}");
            let shares = |values: &[f32], value: f32| {
                let n = values.iter().filter(|v| **v == value || v.is_nan() && value.is_nan()).count();
                n as f64 / values.len() as f64
            };
            let densities = values("density", &more);
            for density in [4.0, 6.0] {
                assert!((shares(&densities, density) - 0.5).abs() < 0.01, "{what}: {densities:?}");
            }
            let apart = values("line-difference", &more);
            assert!((shares(&apart, f32::NAN) - 0.5).abs() < 0.01, "{what}: {apart:?}");
            assert!((shares(&apart, 0.25) - 0.5).abs() < 0.01, "{what}: {apart:?}");
            let above = values("height-above-ground", &more);
            assert!((shares(&above, 5.0) - 64.0 / 4096.0).abs() < 0.001, "{what}: {above:?}");
            assert!(shares(&above, 5.0) + shares(&above, 0.0) > 0.999, "{what}: {above:?}");
        }
    }
}
