//! The window, driven as by a user: a display of its own (Xvfb), mouse and keys by xdotool, under validation.
#![cfg(all(feature = "view", target_os = "linux"))]

mod common;

use common::LAVAPIPE;
use common::made::{field, write};
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Longer than anything takes in a debug build on a busy machine.
const PATIENCE: Duration = Duration::from_secs(40);

/// A display without a screen. Gone when dropped.
struct Display {
    server: Child,
    name: String,
}

impl Display {
    /// `None`, and why is said, where the programs are not there.
    fn open(test: &str) -> Option<Display> {
        for program in ["Xvfb", "xdotool"] {
            let there = std::env::split_paths(&std::env::var_os("PATH")?).any(|p| p.join(program).is_file());
            if !there {
                println!("{test}: {program} is not installed: skipped");
                return None;
            }
        }
        let arguments = ["-displayfd", "1", "-screen", "0", "1280x900x24", "-nolisten", "tcp"];
        let mut server = Command::new("Xvfb")
            .args(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut number = String::new();
        BufReader::new(server.stdout.as_mut().unwrap()).read_line(&mut number).unwrap();
        assert!(!number.trim().is_empty(), "Xvfb did not start");
        Some(Display { server, name: format!(":{}", number.trim()) })
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

/// A running window.
struct Window<'a> {
    display: &'a Display,
    program: Child,
    id: String,
    lines: Receiver<String>,
    /// Where the parts of the panel are that can be clicked, by their names.
    places: RefCell<BTreeMap<String, [String; 2]>>,
    said: Option<JoinHandle<String>>,
}

impl<'a> Window<'a> {
    fn open(display: &'a Display, folder: &Path, arguments: &[&str]) -> Window<'a> {
        Window::with(display, folder, &[&["view", "--validate", "--log-events"], arguments].concat())
    }

    /// By these words alone.
    fn with(display: &'a Display, folder: &Path, arguments: &[&str]) -> Window<'a> {
        let mut program = Command::new(env!("CARGO_BIN_EXE_lasray"))
            .args(arguments)
            .current_dir(folder)
            .env("DISPLAY", &display.name)
            .envs([common::cache()])
            .env_remove("WAYLAND_DISPLAY")
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let (send, lines) = channel();
        let printed = BufReader::new(program.stdout.take().unwrap());
        std::thread::spawn(move || {
            for line in printed.lines().map_while(Result::ok) {
                if send.send(line).is_err() {
                    return;
                }
            }
        });
        let mut errors = program.stderr.take().unwrap();
        let said = std::thread::spawn(move || {
            let mut text = String::new();
            let _ = errors.read_to_string(&mut text);
            text
        });
        let places = RefCell::default();
        Window { display, program, id: String::new(), lines, places, said: Some(said) }
    }

    /// Takes in what a line tells of where things are.
    fn note(&self, line: &str) {
        if let [name @ .., x, y] = &line.split(' ').collect::<Vec<_>>()[..]
            && [x, y].iter().all(|v| v.parse::<i32>().is_ok())
        {
            self.places.borrow_mut().insert(name.join(" "), [x.to_string(), y.to_string()]);
        }
    }

    /// Clicks on a part of the panel.
    fn click(&self, name: &str) {
        self.skip();
        let [x, y] = self.places.borrow().get(name).unwrap_or_else(|| panic!("no {name}")).clone();
        self.xdotool(&["mousemove", &x, &y, "click", "1"]);
    }

    /// Types words into the box that is open.
    fn enter(&self, words: &str) {
        self.xdotool(&["type", "--delay", "15", words]);
        self.xdotool(&["key", "Return"]);
    }

    /// Opens by the box that asks for it.
    fn ask_for(&self, words: &str) {
        self.key("ctrl+o");
        self.wait("open box");
        self.enter(words);
    }

    /// The first line from now on that starts so; what follows, word by word.
    fn wait(&self, start: &str) -> Vec<String> {
        words(&self.wait_all(start).1)
    }

    /// The lines before that, and what follows in it.
    fn wait_all(&self, start: &str) -> (Vec<String>, String) {
        let end = Instant::now() + PATIENCE;
        let mut seen = Vec::new();
        loop {
            let left = end.saturating_duration_since(Instant::now());
            let Ok(line) = self.lines.recv_timeout(left) else {
                panic!("no line '{start} …' but {seen:#?}");
            };
            self.note(&line);
            if let Some(rest) = line.strip_prefix(start) {
                return (seen, rest.to_owned());
            }
            seen.push(line);
        }
    }

    /// Forgets the lines so far.
    fn skip(&self) {
        while let Ok(line) = self.lines.try_recv() {
            self.note(&line);
        }
    }

    fn xdotool(&self, words: &[&str]) -> String {
        let run = Command::new("xdotool").args(words).env("DISPLAY", &self.display.name).output().unwrap();
        String::from_utf8(run.stdout).unwrap().trim().to_owned()
    }

    /// Finds the window and gives it the keys: there is no window manager that would.
    fn focus(&mut self) {
        let end = Instant::now() + PATIENCE;
        while self.id.is_empty() {
            assert!(Instant::now() < end, "there is no window");
            let found = self.xdotool(&["search", "--onlyvisible", "--name", "lasray"]);
            self.id = found.lines().last().unwrap_or_default().to_owned();
        }
        self.xdotool(&["windowfocus", "--sync", &self.id]);
    }

    fn key(&self, key: &str) {
        self.skip();
        self.xdotool(&["key", key]);
    }

    /// Ends it as Ctrl-C in the terminal does; its exit code, and that nothing was said by the validation layer.
    fn end(mut self) -> Option<i32> {
        self.interrupt();
        self.ended()
    }

    /// What the process holds of the machine's memory.
    fn resident_bytes(&self) -> u64 {
        let status = fs::read_to_string(format!("/proc/{}/status", self.program.id())).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
        line.trim().trim_end_matches(" kB").parse::<u64>().unwrap() << 10
    }

    fn interrupt(&self) {
        // The shell's own: a small system has no program for it.
        let kill = format!("kill -INT {}", self.program.id());
        assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success());
    }

    fn ended(&mut self) -> Option<i32> {
        let end = Instant::now() + PATIENCE;
        let status = loop {
            if let Some(status) = self.program.try_wait().unwrap() {
                break status;
            }
            assert!(Instant::now() < end, "the window does not close");
            std::thread::sleep(Duration::from_millis(10));
        };
        let said = self.said.take().unwrap().join().unwrap();
        assert_eq!(said, "", "standard error");
        status.code()
    }
}

impl Drop for Window<'_> {
    fn drop(&mut self) {
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}

fn words(line: &str) -> Vec<String> {
    line.split_whitespace().map(str::to_owned).collect()
}

/// A small town, in a folder of its own.
fn town() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a town.las");
    let run = Command::new(env!("CARGO_BIN_EXE_lasray"))
        .args(["synth", file.to_str().unwrap(), "--points", "200k"])
        .output()
        .unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    (folder, file)
}

/// A town in two tiles, in a folder of its own.
fn two_tiles() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let run = Command::new(env!("CARGO_BIN_EXE_lasray"))
        .args(["synth", "tiles", "--points", "200k", "--tiles", "2x1"])
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    folder
}

/// Width and pixels of a picture that was saved.
fn pixels(path: &Path) -> (usize, Vec<u8>) {
    let mut reader = png::Decoder::new(BufReader::new(fs::File::open(path).unwrap())).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut pixels).unwrap();
    (reader.info().width as usize, pixels)
}

/// Eye and angles of a line `settled WxH eye E,N,U look AZ,EL`.
fn view(words: &[String]) -> ([f64; 3], [f64; 2]) {
    let numbers = |word: &str| word.split(',').map(|v| v.parse().unwrap()).collect::<Vec<f64>>();
    (numbers(&words[2]).try_into().unwrap(), numbers(&words[4]).try_into().unwrap())
}

#[test]
fn a_user_looks_around() {
    common::run("a_user_looks_around", LAVAPIPE, |_| {
        let Some(display) = Display::open("a_user_looks_around") else { return };
        let (folder, file) = town();
        let options = ["--size", "900x640", "--z-unit", "m", "--rgb-bits", "16", "--mix-crs", "--withheld"];
        let options = [&options[..], &["--hide-flags", "key-point,synthetic"]].concat();
        let mut window =
            Window::open(&display, folder.path(), &[&options[..], &[file.to_str().unwrap()]].concat());
        window.wait("first frame");
        window.focus();
        let first = window.wait("settled");
        let (eye, [azimuth, elevation]) = view(&first);

        // What lies under the cursor is told.
        window.skip();
        window.xdotool(&["mousemove", "600", "330"]);
        let pick = window.wait("pick");
        assert!((500_000.0..520_000.0).contains(&pick[0].parse::<f64>().unwrap()), "{pick:?}");

        // To the right and down: the world turns so, the eye rises.
        window.skip();
        window.xdotool(&["mousedown", "1"]);
        for _ in 0..8 {
            window.xdotool(&["mousemove_relative", "--", "6", "4"]);
        }
        window.xdotool(&["mouseup", "1"]);
        let orbited = window.wait("settled");
        let (orbit_eye, [orbit_azimuth, orbit_elevation]) = view(&orbited);
        assert!(orbit_azimuth > azimuth + 1.0 && orbit_elevation > elevation + 1.0, "{first:?} {orbited:?}");
        assert_ne!(orbit_eye, eye);

        window.skip();
        for _ in 0..5 {
            window.xdotool(&["click", "4"]);
        }
        let (zoom_eye, zoom_angles) = view(&window.wait("settled"));
        assert!(zoom_eye[2] < orbit_eye[2] - 1.0, "nearer to the ground: {orbit_eye:?} {zoom_eye:?}");
        assert_eq!(zoom_angles, [orbit_azimuth, orbit_elevation]);

        // Back before the zoom, and before the turn.
        window.key("BackSpace");
        assert_eq!(view(&window.wait("settled")).0, orbit_eye);
        window.key("1");
        assert_eq!(view(&window.wait("settled")).1, [0.0, 90.0]);

        // The check of the second class of the list.
        window.skip();
        window.xdotool(&["mousemove", "22", "124", "click", "1"]);
        assert_eq!(window.wait("classes shown")[0], "253");
        let colors: BTreeSet<_> = (0..5)
            .map(|_| {
                window.key("c");
                window.wait("color")[0].clone()
            })
            .collect();
        assert_eq!(colors.len(), 5, "{colors:?}");

        window.key("ctrl+c");
        let command = window.wait("command").join(" ");
        assert!(command.contains("a town.las'") && command.contains("--hide "), "{command}");
        for option in [
            "--z-unit m",
            "--rgb-bits 16",
            "--mix-crs",
            "--withheld",
            "--ortho ",
            "--hide-flags synthetic,key-point ",
        ] {
            assert!(command.contains(option), "{option}: {command}");
        }
        for option in ["--fov", "--z-scale", "--cell"] {
            assert!(!command.contains(option), "what is chosen anyway: {option}: {command}");
        }
        window.key("ctrl+s");
        window.wait("notice View saved");
        assert!(folder.path().join("lasray-view-0001.json").is_file());

        window.key("p");
        // What is saved is what was seen then, whatever comes after.
        window.xdotool(&["key", "3"]);
        window.wait("saved");
        window.key("1");
        window.wait("settled");
        window.key("p");
        window.wait("saved");
        let [moved, resting] = [1, 2].map(|n| pixels(&folder.path().join(format!("lasray-000{n}.png"))));
        assert!(moved == resting, "the camera that moved on was seen in the picture");
        let (_, pixels) = pixels(&folder.path().join("lasray-0001.png"));
        assert!(pixels.iter().collect::<BTreeSet<_>>().len() > 50, "the picture is uniform");

        window.skip();
        window.xdotool(&["windowsize", &window.id, "700", "500"]);
        let [width, height] =
            window.wait("settled")[0].split('x').map(|v| v.parse().unwrap()).collect::<Vec<u32>>()[..]
        else {
            panic!("a size")
        };
        assert!(width < 500 && height < 500, "{width}x{height}");
        assert_eq!(window.end(), Some(0));
    });
}

#[test]
fn a_file_is_hidden_and_shown_again() {
    common::run("a_file_is_hidden_and_shown_again", LAVAPIPE, |_| {
        let Some(display) = Display::open("a_file_is_hidden_and_shown_again") else { return };
        let folder = two_tiles();
        let mut window = Window::open(&display, folder.path(), &["--size", "640x820", "tiles"]);
        window.wait("first frame");
        window.focus();
        // Where they lie in the end: what is above them may come later.
        let (lines, _) = window.wait_all("settled");
        let check = |file| {
            let start = format!("check {file} ");
            let last = lines.iter().rev().find_map(|line| line.strip_prefix(&start));
            words(last.unwrap_or_else(|| panic!("no check of file {file}: {lines:#?}")))
        };
        let checks = [check(0), check(1)];
        let mut saved = 0;
        let mut save = |window: &Window| {
            window.key("p");
            window.wait("saved");
            saved += 1;
            pixels(&folder.path().join(format!("lasray-{saved:04}.png")))
        };
        let toggle = |window: &Window, [x, y]: [&str; 2]| {
            window.skip();
            window.xdotool(&["mousemove", x, y, "click", "1"]);
        };
        let (width, both) = save(&window);
        let half_of = |at: usize| usize::from(at / 3 % width >= width / 2);
        for (file, check) in checks.iter().enumerate() {
            let check = [&*check[0], &*check[1]];
            toggle(&window, check);
            window.wait(&format!("file {file} hidden"));
            window.wait("settled");
            let (_, one) = save(&window);
            let mut changed = [0; 2];
            (0..both.len()).filter(|&at| both[at] != one[at]).for_each(|at| changed[half_of(at)] += 1);
            // From the south, the western tile is on the left.
            assert!(changed[file] > both.len() / 20, "file {file} is still there: {changed:?}");
            assert!(changed[1 - file] < changed[file] / 10, "the other changed: {changed:?}");
            toggle(&window, check);
            window.wait(&format!("file {file} shown"));
            window.wait("settled");
            assert!(save(&window).1 == both, "file {file} is back as it was");
        }
        assert_eq!(window.end(), Some(0));
    });
}

#[test]
fn a_window_that_changes_all_the_time_goes_on() {
    common::run("a_window_that_changes_all_the_time_goes_on", LAVAPIPE, |_| {
        let Some(display) = Display::open("a_window_that_changes_all_the_time_goes_on") else { return };
        let (folder, file) = town();
        let mut window =
            Window::open(&display, folder.path(), &["--size", "640x480", file.to_str().unwrap()]);
        window.wait("first frame");
        window.focus();
        window.wait("settled");
        let resize = |window: &Window, [width, height]: [u32; 2]| {
            window.skip();
            window.xdotool(&["windowsize", &window.id, &width.to_string(), &height.to_string()]);
            window.wait(&format!("size {width}x{height}"));
        };
        let sizes = |k: u32| [500 + k * 37 % 400, 340 + k * 53 % 300];
        // Bytes of buffers, and of the whole process.
        let held = |window: &Window| {
            resize(window, [900, 640]);
            let settled = window.wait("settled");
            let buffers: u64 = settled.last().unwrap().parse().unwrap();
            [buffers, window.resident_bytes()]
        };
        let mut warm = [0; 2];
        for k in 0..500 {
            resize(&window, sizes(k));
            if k == 50 {
                warm = held(&window);
            }
            // Away and back: there are no images to draw on meanwhile.
            if k % 100 == 99 {
                window.xdotool(&["windowunmap", "--sync", &window.id]);
                window.xdotool(&["windowmap", "--sync", &window.id]);
            }
        }
        let end = held(&window);
        println!("buffers, process: {warm:?} bytes after 50 sizes, {end:?} after 500");
        assert!(end[0] <= warm[0] + warm[0] / 10, "{warm:?} bytes after 50 sizes, {end:?} after 500");
        let most = warm[1] + warm[1] / 10 + (32 << 20);
        assert!(end[1] < most, "{warm:?} bytes after 50 sizes, {end:?} after 500");
        window.skip();
        window.xdotool(&["windowsize", &window.id, "777", "555"]);
        // Once more through all of it: the last size is drawn.
        while window.wait("settled")[0] != "481x529" {}
        assert_eq!(window.end(), Some(0));
    });
}

#[test]
fn a_path_is_flown_and_its_frames_are_told() {
    common::run("a_path_is_flown_and_its_frames_are_told", LAVAPIPE, |_| {
        let Some(display) = Display::open("a_path_is_flown_and_its_frames_are_told") else { return };
        let (folder, file) = town();
        let path = folder.path().join("path.json");
        let keyframes = r#"[{"time": 0, "eye": [512000, 5402500, 500], "target": [512000, 5402900, 200]},
            {"time": 1, "eye": [512200, 5402600, 400], "target": [512000, 5402900, 200]}]"#;
        fs::write(&path, format!(r#"{{"version": 1, "keyframes": {keyframes}}}"#)).unwrap();
        let json = folder.path().join("times.json");
        let (path, json) = (path.to_str().unwrap(), json.to_str().unwrap());
        let arguments = [
            "--size",
            "640x480",
            "--path",
            path,
            "--frames",
            "20",
            "--laps",
            "2",
            "--quit",
            "--json",
            json,
            file.to_str().unwrap(),
        ];
        let mut window = Window::open(&display, folder.path(), &arguments);
        assert_eq!(window.ended(), Some(0));
        let report: serde_json::Value = serde_json::from_str(&fs::read_to_string(json).unwrap()).unwrap();
        assert!(report["frames"].as_u64().unwrap() >= 38, "{report}");
        // Reading is over long before the path is on a quick machine; on any, few frames are in its way.
        assert!(report["waited_for_section"].as_u64().unwrap() < 10, "{report}");
        assert!(report["median_ms"].as_f64().unwrap() > 0.0, "{report}");
        assert!(report["first_frame_ms"].as_f64() < report["first_picture_ms"].as_f64(), "{report}");
        let laps = report["laps"].as_array().unwrap();
        assert_eq!(laps.len(), 2, "{report}");
        for lap in laps {
            assert_eq!(lap["frames"], 19, "times between 20 frames: {report}");
            assert_eq!(lap["waited_for_section"], 0, "{report}");
            let [median, p95, max] = ["median_ms", "p95_ms", "max_ms"].map(|of| lap[of].as_f64().unwrap());
            assert!(0.0 < median && median <= p95 && p95 <= max, "{report}");
        }
        assert_eq!(laps[1]["incomplete_frames"], 0, "all was there before: {report}");
    });
}

#[test]
fn without_anything_to_see_the_window_says_why() {
    common::run("without_anything_to_see_the_window_says_why", LAVAPIPE, |_| {
        let Some(display) = Display::open("without_anything_to_see_the_window_says_why") else { return };
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("broken.las"), b"not LAS").unwrap();
        let mut window = Window::open(&display, folder.path(), &["broken.las"]);
        window.wait("first frame");
        window.wait("failed");
        window.interrupt();
        let status = window.program.wait().unwrap();
        let said = window.said.take().unwrap().join().unwrap();
        assert_eq!(status.code(), Some(1), "{said}");
        let lines: Vec<_> = said.lines().collect();
        let [file, nothing, count] = lines[..] else { panic!("{said}") };
        assert!(file.starts_with("error: broken.las: not a LAS file"), "{said}");
        assert!(nothing.starts_with("lasray: nothing to draw"), "{said}");
        assert_eq!(count, "1 of 1 input left out or failed");
    });
}

#[test]
fn where_every_point_is_hidden_the_window_says_what_shows_them() {
    common::run("where_every_point_is_hidden_the_window_says_what_shows_them", LAVAPIPE, |_| {
        let test = "where_every_point_is_hidden_the_window_says_what_shows_them";
        let Some(display) = Display::open(test) else { return };
        let (folder, _) = town();
        let window = Window::open(&display, folder.path(), &["--classes", "99", "."]);
        let (before, why) = window.wait_all("hidden ");
        assert!(before.iter().any(|line| line == "state every point is hidden"), "{before:?}");
        assert!(
            why.starts_with("nothing to draw: no point is of a class that is shown; there are "),
            "{why}"
        );
        assert!(why.contains(" (--classes ") && why.ends_with(" shows them)"), "{why}");
        assert_eq!(window.end(), Some(0));
    });
}

#[test]
fn what_is_clicked_on_is_kept_and_copied() {
    common::run("what_is_clicked_on_is_kept_and_copied", LAVAPIPE, |_| {
        let Some(display) = Display::open("what_is_clicked_on_is_kept_and_copied") else { return };
        let (folder, file) = town();
        let options = ["--size", "900x640", "--orbit", "20,15"];
        let mut window =
            Window::open(&display, folder.path(), &[&options[..], &[file.to_str().unwrap()]].concat());
        window.wait("first frame");
        window.focus();
        window.wait("settled");
        // The image begins beside the panel. Answers to what was asked before may come first.
        let at = |x: u32, y: u32| {
            window.xdotool(&["mousemove", &x.to_string(), &y.to_string()]);
            let place = [(x - 296).to_string(), y.to_string()];
            loop {
                let mut pick = window.wait("pick ");
                let asked = pick.split_off(pick.len() - 3);
                if asked[1..] == place {
                    return pick;
                }
            }
        };
        // From low over the ground, walls are seen: the record above is told, and that this is its side.
        let places = || (0..200u32).map(|k| (330 + k * 37 % 540, 150 + k * 53 % 400));
        let find = |is: &dyn Fn(&[String]) -> bool| {
            let found = places().map(|(x, y)| at(x, y)).find(|pick| is(pick));
            found.expect("there is such a place")
        };
        let side = find(&|pick| pick.iter().any(|word| word == "side"));
        let below: f64 = side[side.iter().position(|w| w == "side").unwrap() + 1].parse().unwrap();
        assert!(below > 0.0, "{side:?}");
        let click = |window: &Window| {
            window.skip();
            window.xdotool(&["click", "1"]);
            let mut kept = window.wait("kept ");
            kept.truncate(kept.len() - 3);
            kept
        };
        assert_eq!(click(&window), side);
        // It stays whatever lies under the cursor.
        let other = find(&|pick| pick[0] != "nothing" && pick[..3] != side[..3]);
        let copied = |window: &Window| {
            window.key("ctrl+shift+c");
            let words = window.wait("copied ");
            words.iter().map(|word| word.trim_end_matches(',').to_owned()).collect::<Vec<_>>()
        };
        assert_eq!(copied(&window), side[..3]);
        window.key("Escape");
        assert_eq!(copied(&window), other[..3]);
        assert_eq!(click(&window), other);
        // A drag keeps nothing.
        window.skip();
        window.xdotool(&["mousedown", "1", "mousemove_relative", "--", "40", "0"]);
        window.xdotool(&["mouseup", "1"]);
        window.wait("settled");
        assert_eq!(copied(&window), other[..3]);
        // The sky is nothing to keep.
        assert_eq!(at(600, 5), ["nothing"]);
        assert_eq!(click(&window), ["nothing"]);
        let under = find(&|pick| pick[0] != "nothing");
        assert_eq!(copied(&window), under[..3]);
        assert_eq!(window.end(), Some(0));

        // In degrees, finer than a centimetre.
        let options = ["--size", "640x480", "--crs", "EPSG:4326", "--orbit", "0,90"];
        let mut window =
            Window::open(&display, folder.path(), &[&options[..], &[file.to_str().unwrap()]].concat());
        window.wait("first frame");
        window.focus();
        window.wait("settled");
        window.skip();
        window.xdotool(&["mousemove", "468", "226"]);
        window.wait("pick ");
        let copied = copied(&window);
        let digits = copied.iter().map(|number| number.split_once('.').unwrap().1.len());
        assert_eq!(digits.collect::<Vec<_>>(), [8, 8, 3], "{copied:?}");
        let place: Vec<f64> = copied.iter().map(|number| number.parse().unwrap()).collect();
        assert!((place[0] - 9.16).abs() < 0.05 && (place[1] - 48.78).abs() < 0.05, "{copied:?}");
        assert_eq!(window.end(), Some(0));
    });
}

#[test]
fn what_is_said_of_the_data_is_true() {
    common::run("what_is_said_of_the_data_is_true", LAVAPIPE, |_| {
        let Some(display) = Display::open("what_is_said_of_the_data_is_true") else { return };
        let folder = two_tiles();
        let run = Command::new(env!("CARGO_BIN_EXE_lasray"))
            .args(["info", "tiles", "--scan", "--json", "-"])
            .current_dir(folder.path())
            .output()
            .unwrap();
        let scan: serde_json::Value = serde_json::from_slice(&run.stdout).unwrap();
        // As the window lists them.
        let classes = |scan: &serde_json::Value| {
            let classes = scan["classes"].as_array().unwrap_or_else(|| panic!("{scan}")).iter();
            let listed: Vec<_> = classes.map(|c| format!("{}:{}", c["class"], c["points"])).collect();
            listed.join(" ")
        };
        let files = scan["files"].as_array().unwrap();
        let mut window = Window::open(&display, folder.path(), &["--size", "640x820", "tiles"]);
        window.wait("first frame");
        window.focus();
        let settled = |window: &Window| {
            let (lines, _) = window.wait_all("settled");
            let last = |start: &str| {
                let line = lines.iter().rev().find_map(|line| line.strip_prefix(start));
                line.unwrap_or_else(|| panic!("no line '{start} …' in {lines:#?}")).to_owned()
            };
            ([last("state "), last("points ")], lines.clone())
        };
        let (said, lines) = settled(&window);
        assert_eq!(said, ["200 k points".to_owned(), format!("exact {}", classes(&scan["all"]["scan"]))]);
        let check = |file: usize| {
            let start = format!("check {file} ");
            words(lines.iter().rev().find_map(|line| line.strip_prefix(&start)).unwrap())
        };
        let toggle = |window: &Window, at: &[String]| {
            window.skip();
            window.xdotool(&["mousemove", &at[0], &at[1], "click", "1"]);
        };
        let [first, second] = [check(0), check(1)];
        toggle(&window, &first);
        let (said, _) = settled(&window);
        assert_eq!(said[1], format!("exact {}", classes(&files[1]["scan"])));
        toggle(&window, &second);
        let (said, lines) = settled(&window);
        assert_eq!(said, ["no file is shown", "exact "]);
        assert!(lines.iter().all(|line| !line.starts_with("hidden")), "{lines:?}");
        assert_eq!(window.end(), Some(0));
    });
}

/// Runs the program to its end: exit code and standard error.
fn run(folder: &Path, arguments: &[&str]) -> (Option<i32>, String) {
    let run = Command::new(env!("CARGO_BIN_EXE_lasray"))
        .args(arguments)
        .current_dir(folder)
        .envs([common::cache()])
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .output()
        .unwrap();
    (run.status.code(), String::from_utf8(run.stderr).unwrap())
}

/// A number of a line.
fn number(word: &str) -> f64 {
    word.trim_end_matches(',').parse().unwrap_or_else(|_| panic!("{word} is no number"))
}

/// The file with other bytes in the place of some.
fn changed(path: &Path, name: &str, old: &[u8], new: &[u8]) {
    let mut bytes = fs::read(path).unwrap();
    let places: Vec<_> = (0..bytes.len()).filter(|&at| bytes[at..].starts_with(old)).collect();
    assert!(!places.is_empty());
    places.into_iter().for_each(|at| bytes[at..at + new.len()].copy_from_slice(new));
    fs::write(path.with_file_name(name), bytes).unwrap();
}

#[test]
fn an_empty_window_says_what_to_do_and_opens_a_folder() {
    common::run("an_empty_window_says_what_to_do_and_opens_a_folder", LAVAPIPE, |_| {
        let Some(display) = Display::open("an_empty_window_says_what_to_do_and_opens_a_folder") else {
            return;
        };
        let folder = two_tiles();
        let mut window = Window::open(&display, folder.path(), &["--size", "800x600"]);
        window.wait("first frame");
        window.focus();
        window.wait("settled");

        // The list of keys is seen whole in a small window.
        window.key("question");
        let keys = window.wait("keys");
        let [left, top, right, bottom] = [1, 2, 3, 4].map(|at| number(&keys[at]));
        assert_eq!(keys[0], "whole", "{keys:?}");
        assert!(left >= 0.0 && top >= 0.0 && right <= 800.0 && bottom <= 600.0, "{keys:?}");
        window.xdotool(&["key", "Escape"]);

        // What cannot be opened is said in the box, which stays.
        window.ask_for("nowhere");
        window.xdotool(&["key", "ctrl+a"]);
        window.xdotool(&["type", "--delay", "15", "til"]);
        window.xdotool(&["key", "Tab"]);
        window.xdotool(&["key", "Return"]);
        window.wait("scene");
        while window.wait("settled")[6] == "0" {}
        let title = window.xdotool(&["getwindowname", &window.id]);
        assert_eq!(title, "tiles – lasray");

        // In the place of what is open.
        let tile = fs::read_dir(folder.path().join("tiles")).unwrap().next().unwrap().unwrap().file_name();
        let tile = tile.to_str().unwrap();
        window.key("ctrl+o");
        window.wait("open box");
        window.xdotool(&["type", "--delay", "15", &format!("tiles/{tile}")]);
        window.xdotool(&["key", "ctrl+Return"]);
        window.wait("opened 1 inputs");
        while window.wait("settled")[6] == "0" {}
        assert_eq!(window.xdotool(&["getwindowname", &window.id]), format!("{tile} – lasray"));
        assert_eq!(window.end(), Some(0));
    });
}

#[test]
fn the_name_alone_opens_a_window_or_says_how_to_go_on() {
    let test = "the_name_alone_opens_a_window_or_says_how_to_go_on";
    common::run(test, LAVAPIPE, |_| {
        let folder = tempfile::tempdir().unwrap();
        let (code, said) = run(folder.path(), &[]);
        assert_eq!(code, Some(2), "{said}");
        assert!(said.contains("Usage: lasray") && said.contains("Examples:"), "{said}");
        let (code, said) = run(folder.path(), &["view"]);
        assert_eq!(code, Some(1), "{said}");
        assert!(said.starts_with("lasray: no window can be opened"), "{said}");
        let Some(display) = Display::open(test) else { return };
        let mut window = Window::with(&display, folder.path(), &[]);
        window.focus();
        assert_eq!(window.end(), Some(0));
    });
}

#[test]
fn what_is_done_with_files_is_told_once_and_stays_in_the_list() {
    let test = "what_is_done_with_files_is_told_once_and_stays_in_the_list";
    common::run(test, LAVAPIPE, |_| {
        let Some(display) = Display::open(test) else { return };
        let folder = two_tiles();
        // Its own bytes: names no system.
        let run = run(folder.path(), &["synth", "named.las", "--points", "100k", "--format", "3"]);
        assert_eq!(run.0, Some(0), "{run:?}");
        changed(&folder.path().join("named.las"), "unnamed.las", b"LASF_Projection", b"OASF_Projection");
        fs::write(folder.path().join("broken.las"), b"not LAS").unwrap();
        let mut window = Window::open(&display, folder.path(), &["--size", "1100x880", "tiles"]);
        window.wait("first frame");
        window.focus();
        window.wait("settled");
        window.ask_for("unnamed.las broken.las");
        let said = window.wait_all("notice ").1;
        assert!(said.starts_with("2 files: 1 assumed to be in ") && said.contains(", 1 failed"), "{said}");
        window.wait("settled");
        window.click("copy list");
        let list: Vec<_> = (0..4).map(|_| window.wait_all("list ").1).collect();
        let state = |line: &String| line.split('\t').nth(1).unwrap().to_owned();
        assert_eq!(list.iter().map(state).collect::<Vec<_>>(), ["placed", "placed", "assumed", "failed"]);
        assert!(
            list[3].starts_with("broken.las\tfailed\t") && list[3].contains("not a LAS file"),
            "{list:?}"
        );
        assert!(list[2].contains("names no coordinate system"), "{list:?}");

        // To one of them, and back to what is shown.
        window.click("zoom 0");
        let (near, _) = view(&window.wait("settled"));
        window.click("check 2");
        window.wait("file 2 hidden");
        window.wait("settled");
        window.key("f");
        let (both, _) = view(&window.wait("settled"));
        assert!(both[2] > near[2] + 1.0, "{both:?} sees more than {near:?}");
        window.click("check 0");
        window.wait("file 0 hidden");
        window.wait("settled");
        window.key("f");
        let (one, _) = view(&window.wait("settled"));
        assert!(
            one[0] > both[0] + 10.0 && one[2] < both[2] - 1.0,
            "{one:?}: the eastern tile alone, {both:?}"
        );

        // Only what is shown is in the command.
        window.key("ctrl+c");
        let command = window.wait_all("command ").1;
        assert!(command.contains(" tiles/tile_") && !command.contains("unnamed"), "{command}");
        assert!(!command.contains(" tiles "), "{command}");
        window.click("dismiss 0");
        window.click("copy list");
        assert!(window.wait_all("list ").1.contains("hidden"), "it is in the list all the same");

        // The last one that goes leaves an empty window, which opens others.
        for file in ["remove 0", "remove 1", "remove 2"] {
            window.click(file);
            window.wait(&format!("file {} removed", &file[7..]));
            std::thread::sleep(Duration::from_millis(300));
        }
        window.wait("scene");
        window.ask_for("tiles");
        window.wait("scene");
        while window.wait("settled")[6] == "0" {}
        window.interrupt();
        assert!(window.program.wait().unwrap().success());
        let said = window.said.take().unwrap().join().unwrap();
        let lines: Vec<_> = said.lines().collect();
        assert!(lines.len() == 2 && lines[0].starts_with("error: broken.las: not a LAS file"), "{said}");
        assert!(lines[1].ends_with("left out or failed"), "{said}");
    });
}

#[test]
fn files_of_another_system_are_told_to_be_transformed() {
    let test = "files_of_another_system_are_told_to_be_transformed";
    common::run(test, LAVAPIPE, |_| {
        let Some(display) = Display::open(test) else { return };
        let (folder, _) = town();
        let arguments = ["--size", "1100x880", "--crs", "EPSG:25833", "a town.las"];
        let mut window = Window::open(&display, folder.path(), &arguments);
        window.focus();
        let (lines, _) = window.wait_all("settled");
        let said: Vec<_> = lines.iter().filter_map(|line| line.strip_prefix("notice ")).collect();
        let [said] = said[..] else { panic!("once: {said:?}") };
        assert!(said.starts_with("a town.las: transformed from ") && said.contains("zone 33N"), "{said}");
        window.click("copy list");
        let line = window.wait_all("list ").1;
        assert!(line.starts_with("a town.las\ttransformed\ttransformed from "), "{line}");
        window.key("ctrl+c");
        assert!(window.wait_all("command ").1.contains("--crs EPSG:25833"));
        assert_eq!(window.end(), Some(0));
    });
}

/// Mean difference of two pictures, of 255.
fn difference(a: &[u8], b: &[u8]) -> f64 {
    assert_eq!(a.len(), b.len());
    let sum: u64 = a.iter().zip(b).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    sum as f64 / a.len() as f64
}

/// A picture without its transparency.
fn rgb(path: &Path) -> Vec<u8> {
    let mut reader = png::Decoder::new(BufReader::new(fs::File::open(path).unwrap())).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let channels = reader.next_frame(&mut pixels).unwrap().color_type.samples();
    pixels.chunks_exact(channels).flat_map(|pixel| pixel[..3].to_vec()).collect()
}

#[test]
fn a_saved_view_opens_from_elsewhere_as_it_was() {
    let test = "a_saved_view_opens_from_elsewhere_as_it_was";
    common::run(test, LAVAPIPE, |_| {
        let Some(display) = Display::open(test) else { return };
        let folder = two_tiles();
        let size = ["--size", "800x880"];
        let mut window = Window::open(&display, folder.path(), &[&size[..], &["tiles"]].concat());
        window.wait("first frame");
        window.focus();
        window.wait("settled");
        // Another colour, ramp, layer, light, projection, and one file hidden.
        window.click("mode height");
        window.wait("color height usual");
        window.wait("settled");
        window.click("ramps");
        window.wait("ramp viridis");
        window.click("ramp viridis");
        window.wait("color height viridis");
        window.click("check 1");
        window.wait("file 1 hidden");
        window.key("b");
        assert_eq!(window.wait("classes shown")[2], "0");
        window.key("l");
        window.wait("settled");
        window.key("3");
        let saved = window.wait("settled");
        window.key("ctrl+s");
        window.wait("notice View saved");
        window.key("p");
        window.wait("saved");
        let picture = rgb(&folder.path().join("lasray-0001.png"));
        window.key("ctrl+c");
        let command = window.wait_all("command ").1;
        assert_eq!(window.end(), Some(0));

        // With its files, from another folder.
        let other = tempfile::tempdir().unwrap();
        let moved = other.path().join("moved");
        fs::rename(folder.path(), &moved).unwrap();
        let view_file = "moved/lasray-view-0001.json";
        let mut window = Window::with(
            &display,
            other.path(),
            &[view_file, "--validate", "--log-events", size[0], size[1]],
        );
        window.wait("first frame");
        window.focus();
        let (lines, settled) = window.wait_all("settled");
        assert_eq!(words(&settled)[..5], saved[..5]);
        assert!(lines.iter().any(|line| line.starts_with("projection parallel ")), "{lines:#?}");
        assert!(lines.iter().any(|line| line.starts_with("color height viridis")), "{lines:#?}");
        window.key("p");
        window.wait("saved");
        let again = rgb(&other.path().join("lasray-0001.png"));
        assert!(difference(&picture, &again) < 0.5, "{}", difference(&picture, &again));
        window.key("ctrl+c");
        let options = |command: &str| command[command.find("--eye").unwrap()..].to_owned();
        assert_eq!(options(&window.wait_all("command ").1), options(&command));
        window.click("copy list");
        let list: Vec<_> = (0..2).map(|_| window.wait_all("list ").1).collect();
        assert_eq!(list.iter().filter(|line| line.ends_with("; hidden")).count(), 1, "{list:?}");
        // The same in the window that is open, over what was changed there.
        window.key("c");
        window.wait("color");
        window.ask_for(view_file);
        window.wait("opened 2 inputs");
        window.wait("color height viridis");
        assert_eq!(window.wait("settled")[..5], saved[..5]);
        assert_eq!(window.end(), Some(0));

        // And as a picture of the command line.
        let draw = |name: &str, more: &[&str]| {
            let arguments = ["render", "--path", view_file, "-o", name, "--quiet"];
            run(other.path(), &[&arguments[..], more].concat())
        };
        let (code, said) = draw("drawn.png", &["--samples", "16"]);
        assert_eq!((code, &*said), (Some(0), ""));
        let drawn = rgb(&other.path().join("drawn.png"));
        assert!(difference(&picture, &drawn) < 4.0, "{}", difference(&picture, &drawn));
        // What is typed counts before what was saved.
        let (code, said) = draw("class.png", &["--color", "class", "--size", "64x48"]);
        assert_eq!((code, &*said), (Some(0), ""));
        assert_eq!(rgb(&other.path().join("class.png")).len(), 64 * 48 * 3);

        // What is missing is named.
        fs::rename(moved.join("tiles"), moved.join("gone")).unwrap();
        let (code, said) = draw("none.png", &[]);
        assert_eq!(code, Some(1), "{said}");
        assert!(said.contains("tiles/tile_") && said.contains("no such file or folder"), "{said}");
        let plain = r#"{"version": 1, "keyframes": [{"time": 0, "eye": [0, 0, 9], "target": [0, 0, 0]}]}"#;
        fs::write(other.path().join("plain.json"), plain).unwrap();
        for arguments in [&["render", "--path", "plain.json", "-o", "x.png"][..], &["plain.json"]] {
            let (code, said) = run(other.path(), arguments);
            assert_eq!(code, Some(2), "{said}");
            assert!(said.contains("plain.json: a camera path that names no files"), "{said}");
        }
    });
}

#[test]
fn a_view_written_by_hand_is_drawn_or_its_fault_is_named() {
    common::run("a_view_written_by_hand_is_drawn_or_its_fault_is_named", LAVAPIPE, |_| {
        let (folder, _) = town();
        let camera = r#""version": 1, "projection": {"units_per_pixel": 4.0},
            "keyframes": [{"time": 0, "eye": [512000, 5403000, 900], "target": [512000, 5403000, 200]}]"#;
        let draw = |options: &str| {
            let view = format!(r#"{{{camera}, "view": {{"inputs": ["a town.las"], "options": {options}}}}}"#);
            fs::write(folder.path().join("view.json"), view).unwrap();
            run(folder.path(), &["render", "--path", "view.json", "-o", "view.png", "--quiet"])
        };
        let (code, said) = draw(
            r#"{"size": "60x40", "classes": "6", "color": "class", "z-scale": 2, "withheld": true, "hide-flags": "overlap"}"#,
        );
        assert_eq!((code, &*said), (Some(0), ""));
        assert_eq!(rgb(&folder.path().join("view.png")).len(), 60 * 40 * 3);
        for (options, place, reason) in [
            (r#"{"output": "x.png"}"#, "view.json: line ", "`output` is none of a view's"),
            (r#"{"color": "pink"}"#, "view.json: ", "invalid value 'pink' for '--color"),
            (r#"{"classes": 300}"#, "view.json: ", "class 300 is out of range"),
            (r#"{"hide-flags": "noise"}"#, "view.json: ", "'noise' is not a flag"),
        ] {
            let (code, said) = draw(options);
            assert_eq!(code, Some(2), "{said}");
            assert!(said.starts_with(&format!("lasray: {place}")) && said.contains(reason), "{said}");
        }
    });
}

#[test]
fn parallel_views_are_true_to_scale() {
    common::run("parallel_views_are_true_to_scale", LAVAPIPE, |_| {
        let Some(display) = Display::open("parallel_views_are_true_to_scale") else { return };
        let (folder, file) = town();
        let mut window =
            Window::open(&display, folder.path(), &["--size", "700x520", file.to_str().unwrap()]);
        window.wait("first frame");
        window.focus();
        window.wait("settled");
        let at = |window: &Window, [x, y]: [i32; 2]| {
            window.skip();
            window.xdotool(&["mousemove", &x.to_string(), &y.to_string()]);
            let pick = window.wait("pick");
            [0, 1, 2].map(|axis| number(&pick[axis]))
        };
        // In perspective a scale says where it holds.
        let scale_until = |end: &str| while !window.wait_all("scale ").1.ends_with(end) {};
        at(&window, [500, 260]);
        window.skip();
        window.xdotool(&["mousemove", "100", "510"]);
        scale_until(" m in the middle");
        window.skip();
        window.xdotool(&["mousemove", "500", "250"]);
        scale_until(" m at the cursor");

        // In parallel it holds everywhere.
        window.key("1");
        scale_until(" m");
        let units = number(&window.wait("projection parallel")[0]);
        window.wait("settled");
        let (a, b) = (at(&window, [420, 250]), at(&window, [620, 190]));
        assert!((b[0] - a[0] - 200.0 * units).abs() < 1e-2, "{a:?} {b:?} at {units}");
        assert!((b[1] - a[1] - 60.0 * units).abs() < 1e-2, "{a:?} {b:?} at {units}");

        // The wheel leaves what is under the cursor there, to a pixel of the image before.
        window.skip();
        for _ in 0..4 {
            window.xdotool(&["click", "4"]);
        }
        let nearer = number(&window.wait("projection parallel")[0]);
        window.wait("settled");
        let notches = (nearer / units).ln() / 0.85f64.ln();
        assert!(notches >= 4.0 && (notches - notches.round()).abs() < 1e-6, "{nearer} {units}");
        at(&window, [610, 190]);
        let same = at(&window, [620, 190]);
        assert!((0..2).all(|axis| (same[axis] - b[axis]).abs() < units), "{b:?} {same:?}");
        // So does a drag.
        window.skip();
        window.xdotool(&["mousedown", "3"]);
        for _ in 0..5 {
            window.xdotool(&["mousemove_relative", "--", "-10", "6"]);
        }
        window.xdotool(&["mouseup", "3"]);
        window.wait("settled");
        at(&window, [560, 220]);
        let same = at(&window, [570, 220]);
        assert!((0..2).all(|axis| (same[axis] - b[axis]).abs() < units), "{b:?} {same:?}");

        // A picture from above says where it lies.
        window.key("p");
        let saved = window.wait_all("saved ").1;
        assert!(saved.ends_with(", with world file and .prj"), "{saved}");
        let world = fs::read_to_string(folder.path().join("lasray-0001.pgw")).unwrap();
        let world: Vec<f64> = world.lines().map(number).collect();
        assert_eq!((world[0], world[3]), (nearer, -nearer));
        // The image begins right of the panel; what is at 570, 220 is known.
        let (width, _) = pixels(&folder.path().join("lasray-0001.png"));
        let column = 570.0 - (700.0 - width as f64) - 0.5;
        let there = [world[4] + nearer * column, world[5] - nearer * 219.5];
        assert!((0..2).all(|axis| (there[axis] - same[axis]).abs() < 1.5 * nearer), "{there:?} {same:?}");
        assert!(fs::read_to_string(folder.path().join("lasray-0001.prj")).unwrap().contains("UTM"));

        // The other projection, and back: the middle stays, as large as it was.
        let [x, y] = [700 - width as i32 / 2, 247];
        let [before, beside] = [at(&window, [x, y]), at(&window, [x + 4, y])];
        window.key("o");
        window.wait("projection perspective 45");
        window.wait("settled");
        let after = at(&window, [x, y]);
        assert!((0..2).all(|axis| (after[axis] - before[axis]).abs() < nearer), "{before:?} {after:?}");
        let after_beside = at(&window, [x + 4, y]);
        let [wide, wide_after] = [beside[0] - before[0], after_beside[0] - after[0]];
        assert!((wide - wide_after).abs() < 0.3 * wide, "{wide} {wide_after}");
        window.key("o");
        let again = number(&window.wait("projection parallel")[0]);
        assert!((again / nearer - 1.0).abs() < 0.05, "{again} {nearer}");

        // From the side the data are before the eye, however the view is turned.
        window.key("2");
        window.wait("settled");
        window.skip();
        window.xdotool(&["mousemove", "480", "260", "mousedown", "1"]);
        for _ in 0..10 {
            window.xdotool(&["mousemove_relative", "--", "25", "0"]);
        }
        window.xdotool(&["mouseup", "1"]);
        let (_, [azimuth, _]) = view(&window.wait("settled"));
        assert!(azimuth > 30.0, "{azimuth}");
        // A click on the compass brings north up.
        window.skip();
        window.xdotool(&["mousemove", "656", "44", "click", "1"]);
        let (_, [azimuth, _]) = view(&window.wait("settled"));
        assert_eq!(azimuth, 0.0);
        assert_eq!(window.end(), Some(0));
    });
}

/// Shares of the width and height of a parallel view that are free to the left, right, above and below of what is shown, and
/// the share of what is neither; what is free is white.
fn free(path: &Path) -> ([f64; 4], f64) {
    let (width, pixels) = (pixels(path).0, rgb(path));
    let height = pixels.len() / 3 / width;
    let is_data = |at: usize| pixels[at * 3..][..3] != [255; 3];
    let data: Vec<_> = (0..width * height).filter(|&at| is_data(at)).collect();
    let columns = data.iter().map(|at| at % width);
    let (left, right) = (columns.clone().min().unwrap(), width - 1 - columns.max().unwrap());
    let (above, below) = (data[0] / width, height - 1 - data.last().unwrap() / width);
    let [w, h] = [width, height].map(|side| side as f64);
    let free = [left as f64 / w, right as f64 / w, above as f64 / h, below as f64 / h];
    (free, data.len() as f64 / (w * h))
}

#[test]
fn what_is_framed_follows_what_is_shown() {
    let test = "what_is_framed_follows_what_is_shown";
    common::run(test, LAVAPIPE, |_| {
        let Some(display) = Display::open(test) else { return };
        let folder = tempfile::tempdir().unwrap();
        // A block of houses in a corner of a field, and a tree far to the north.
        let block = field([30.0, 20.0], 0.5, |x, y| Some((8.0 + 0.05 * (x + y), 6)));
        let ground = field([200.0, 100.0], 1.0, |x, _| Some((0.02 * x, 2)));
        write(&folder.path().join("field.las"), ground.chain(block));
        let tree = field([10.0, 210.0], 0.5, |x, y| (y > 200.0).then_some((6.0 + 0.1 * x, 5)));
        write(&folder.path().join("tree.las"), tree);
        let arguments = ["--size", "560x820", "--classes", "6", "--orbit", "0,90", "--color", "class"];
        let mut window =
            Window::open(&display, folder.path(), &[&arguments[..], &["field.las", "tree.las"]].concat());
        window.wait("first frame");
        window.focus();
        window.wait("settled");
        let mut saved = 0;
        let mut framed = |window: &Window, what: &str| {
            window.key("1");
            window.wait("settled");
            window.key("f");
            window.key("p");
            window.wait("saved");
            saved += 1;
            let ([left, right, above, below], share) =
                free(&folder.path().join(format!("lasray-{saved:04}.png")));
            println!("{what}: free {left:.3}, {right:.3}, {above:.3}, {below:.3}; shown {share:.3}");
            let fills = |[a, b]: [f64; 2]| (0.004..0.08).contains(&a) && (0.004..0.08).contains(&b);
            assert!(fills([left, right]) || fills([above, below]), "{what}: neither way fills the frame");
            assert!((left - right).abs() < 0.03 && (above - below).abs() < 0.03, "{what}: not in the middle");
            share
        };
        // The houses alone are 30 by 20, all of it 200 by 210, less the empty north, the field 200 by 100.
        let wide = |share: f64| (0.1..0.7).contains(&share);
        assert!(wide(framed(&window, "houses")), "they fill it");
        window.click("preset surface");
        window.wait("classes shown 254");
        window.wait("settled");
        assert!(wide(framed(&window, "all")));
        window.click("check 1");
        window.wait("file 1 hidden");
        window.wait("settled");
        assert!(wide(framed(&window, "the field")), "the tree is not framed any more");
        // Ground lies deeper than what was asked for first: from the side it has no holes.
        window.key("2");
        window.wait("settled");
        window.key("p");
        window.wait("saved");
        let ([left, right, above, below], share) = free(&folder.path().join("lasray-0004.png"));
        let area = (1.0 - left - right) * (1.0 - above - below);
        println!("from the south: free {left:.3}, {right:.3}, {above:.3}, {below:.3}; shown {share:.3}");
        assert!(share > 0.2 * area, "{share} of {area}");
        assert_eq!(window.end(), Some(0));
    });
}

#[test]
fn layers_are_shown_by_presets_and_classes_alone() {
    let test = "layers_are_shown_by_presets_and_classes_alone";
    common::run(test, LAVAPIPE, |_| {
        let Some(display) = Display::open(test) else { return };
        let folder = tempfile::tempdir().unwrap();
        let block = field([30.0, 20.0], 0.5, |x, y| Some((8.0 + 0.05 * (x + y), 6)));
        let trees = field([60.0, 20.0], 0.5, |x, _| (x > 40.0).then_some((6.0 + 0.1 * x, 5)));
        let ground = field([80.0, 40.0], 1.0, |x, _| Some((0.02 * x, 2)));
        write(&folder.path().join("field.las"), ground.chain(block).chain(trees));
        let mut window = Window::open(&display, folder.path(), &["--size", "700x560", "field.las"]);
        window.wait("first frame");
        window.focus();
        // There are no wires.
        window.wait("no preset power-line");
        window.wait("settled");
        window.click("preset bare-earth");
        window.wait("classes shown 5 ");
        for (words, shown) in
            [("Buildings: classes 6", 1), ("Vegetation: classes 3,4,5", 3), ("Surface: all but noise", 254)]
        {
            window.key("v");
            window.wait(&format!("notice {words}"));
            window.wait(&format!("classes shown {shown} "));
        }

        // A class alone, by the button that is there under the cursor, and back.
        let at = |window: &Window, name: &str| window.places.borrow()[name].clone();
        let [x, y] = at(&window, "name 6");
        window.xdotool(&["mousemove", &x, &y]);
        window.wait("only 6");
        window.click("only 6");
        window.wait("classes shown 1 ");
        window.wait("back 6");
        window.wait("settled");
        window.key("ctrl+c");
        // The shortest that says so.
        assert!(window.wait_all("command ").1.contains(" --hide 2,5 "));
        window.click("back 6");
        window.wait("classes shown 254 ");
        // And by Alt.
        window.xdotool(&["keydown", "alt"]);
        for (name, shown) in [("name 2", 1), ("name 5", 1), ("name 5", 254)] {
            window.click(name);
            window.wait(&format!("classes shown {shown} "));
        }
        window.xdotool(&["keyup", "alt"]);
        for (name, shown) in [("name 5", 253), ("invert classes", 3), ("all classes", 256)] {
            window.click(name);
            window.wait(&format!("classes shown {shown} "));
        }
        assert_eq!(window.end(), Some(0));
    });
}

/// Flags that points have are layers with boxes of their own.
#[test]
fn flags_have_boxes_where_points_have_them() {
    let test = "flags_have_boxes_where_points_have_them";
    common::run(test, LAVAPIPE, |_| {
        let Some(display) = Display::open(test) else { return };
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("field.las");
        write(&file, field([40.0, 20.0], 0.5, |x, y| Some((0.05 * (x + y), 2))));
        let mut bytes = fs::read(&file).unwrap();
        let first = u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize;
        // Of format 0: the bit of synthetic points.
        bytes[first..].chunks_exact_mut(20).step_by(3).for_each(|record| record[15] |= 0x20);
        fs::write(&file, bytes).unwrap();
        let mut window = Window::open(&display, folder.path(), &["--size", "560x820", "field.las"]);
        window.wait("first frame");
        window.focus();
        window.wait("settled");
        let is_there = |window: &Window, name: &str| window.places.borrow().contains_key(name);
        assert!(is_there(&window, "withheld points") && !is_there(&window, "overlap points"));
        for (name, hidden) in [("synthetic", "withheld,synthetic"), ("withheld", "synthetic")] {
            window.click(&format!("{name} points"));
            assert_eq!(window.wait("classes shown 254 bridge 4 hidden"), [hidden]);
            window.wait("settled");
        }
        window.key("ctrl+c");
        let command = window.wait_all("command ").1;
        assert!(command.contains(" --withheld") && command.contains(" --hide-flags synthetic "), "{command}");
        window.click("synthetic points");
        assert_eq!(window.wait("classes shown 254 bridge 4 hidden"), [""; 0]);
        assert_eq!(window.end(), Some(0));
    });
}

/// Other classes, section by section: all of what is then shown is as if the program had been begun so.
#[test]
fn other_classes_are_shown_in_stacks_and_smooth_surfaces() {
    let test = "other_classes_are_shown_in_stacks_and_smooth_surfaces";
    common::run(test, LAVAPIPE, |_| {
        let Some(display) = Display::open(test) else { return };
        for surface in ["stacks", "smooth"] {
            let (folder, file) = town();
            let file = file.to_str().unwrap();
            let size = ["--size", "560x880", "--cell", "0.25", "--color", "class"];
            let times = folder.path().join("times.json");
            let named = ["--surface", surface, "--json", times.to_str().unwrap(), file];
            let mut window = Window::open(&display, folder.path(), &[&size[..], &named].concat());
            window.wait("first frame");
            window.focus();
            window.wait("settled");
            let (mut pictures, mut took) = (Vec::new(), Vec::new());
            for (preset, shown) in [("bare-earth", 5), ("vegetation", 3), ("building", 1), ("surface", 254)] {
                window.click(&format!("preset {preset}"));
                window.wait(&format!("classes shown {shown} "));
                let (_, switched) = window.wait_all("switched in ");
                let said = words(&switched);
                let [all, in_sight, sections, parts] = [0, 4, 6, 9].map(|at| number(&said[at]));
                println!("{surface}, {preset}: switched in {switched}");
                assert!(all >= in_sight && sections >= parts && parts >= 1.0, "{switched}");
                took.push(all);
                window.wait("settled");
                window.key("p");
                window.wait("saved");
                let saved = format!("lasray-{:04}.png", pictures.len() + 1);
                pictures.push(rgb(&folder.path().join(saved)));
            }
            // The last as the program draws it that was begun so.
            window.key("ctrl+s");
            window.wait("notice View saved");
            let view =
                ["render", "--path", "lasray-view-0001.json", "-o", "drawn.png", "--samples", "16", "-q"];
            assert_eq!(run(folder.path(), &view), (Some(0), String::new()));
            let off = difference(&pictures[3], &rgb(&folder.path().join("drawn.png")));
            assert!(off < 1.0, "{surface}: {off}");
            for (k, a) in pictures.iter().enumerate() {
                for b in &pictures[k + 1..] {
                    assert!(difference(a, b) > 1.0, "{}", difference(a, b));
                }
            }
            // One choice upon the other, faster than they can be shown.
            for preset in ["bare-earth", "vegetation", "surface"] {
                window.click(&format!("preset {preset}"));
            }
            window.wait("classes shown 254 ");
            window.wait("settled");
            window.key("p");
            window.wait("saved");
            let again = rgb(&folder.path().join("lasray-0005.png"));
            assert!(difference(&pictures[3], &again) < 0.5, "{}", difference(&pictures[3], &again));
            assert_eq!(window.end(), Some(0));
            let told: serde_json::Value = serde_json::from_str(&fs::read_to_string(times).unwrap()).unwrap();
            let told = told["switches_ms"].as_array().unwrap();
            assert!(told.len() > took.len(), "{told:?}");
            let is_as = |(ms, words): (&serde_json::Value, &f64)| (ms.as_f64().unwrap() - words).abs() <= 0.5;
            assert!(told.iter().zip(&took).all(is_as), "{told:?}, {took:?}");
        }
    });
}

#[test]
fn ramps_and_ranges_are_chosen_and_colours_offered_where_they_are() {
    let test = "ramps_and_ranges_are_chosen_and_colours_offered_where_they_are";
    common::run(test, LAVAPIPE, |_| {
        let Some(display) = Display::open(test) else { return };
        let folder = tempfile::tempdir().unwrap();
        let run = run(folder.path(), &["synth", "rgb.las", "--points", "100k", "--format", "3"]);
        assert_eq!(run.0, Some(0), "{run:?}");
        // The same points, colours being bytes that no format knows.
        let mut bytes = fs::read(folder.path().join("rgb.las")).unwrap();
        assert_eq!(bytes[104], 3);
        bytes[104] = 1;
        fs::write(folder.path().join("plain.las"), bytes).unwrap();
        let arguments = ["--size", "900x880", "--color", "height", "plain.las"];
        let mut window = Window::open(&display, folder.path(), &arguments);
        window.wait("first frame");
        window.focus();
        window.wait("settled");
        assert!(!window.places.borrow().contains_key("mode rgb"), "no file has colours");

        window.click("ramps");
        window.wait("ramp viridis");
        window.click("ramp viridis");
        let usual = window.wait("color height viridis")[0].clone();
        // A value that is left as it is shown is none that was chosen.
        let type_low = |words: Option<&str>| {
            window.click("range low");
            window.wait("typing range low");
            if let Some(words) = words {
                window.xdotool(&["key", "ctrl+a"]);
                window.xdotool(&["type", "--delay", "15", words]);
            }
            window.xdotool(&["key", "Return"]);
            // Nothing is typed into any more.
            window.wait("mode height");
        };
        type_low(None);
        window.key("ctrl+c");
        let command = window.wait_all("command ").1;
        assert!(command.contains(" --ramp viridis") && !command.contains("--range"), "{command}");
        type_low(Some("215"));
        let (low, high) = usual.split_once(',').unwrap();
        let range = window.wait("color height viridis")[0].clone();
        assert_eq!(range, format!("215.00,{high}"), "instead of {low}");
        window.wait("settled");
        window.key("ctrl+c");
        let command = window.wait_all("command ").1;
        assert!(command.contains(" --ramp viridis --range 215.."), "{command}");
        type_low(Some("10%"));
        window.wait("color height viridis");
        window.wait("settled");
        window.key("ctrl+c");
        let command = window.wait_all("command ").1;
        assert!(command.contains(" --ramp viridis --range 10%.."), "{command}");
        window.click("reset ramp");
        assert_eq!(window.wait("color height usual")[0], usual);

        // They come and go with the files that have them.
        window.ask_for("rgb.las");
        window.wait("mode rgb");
        window.wait("settled");
        window.click("mode rgb");
        window.wait("color rgb");
        window.wait("settled");
        window.click("remove 1");
        window.wait("notice No file has RGB");
        window.wait("color height");
        assert_eq!(window.end(), Some(0));
    });
}

/// The picture that the window shows, saved as the `number`th.
fn saved_picture(window: &Window, folder: &Path, number: u32) -> Vec<u8> {
    window.key("p");
    window.wait("saved");
    rgb(&folder.join(format!("lasray-{number:04}.png")))
}

#[test]
fn returns_are_chosen_and_points_are_read_again() {
    let test = "returns_are_chosen_and_points_are_read_again";
    common::run(test, LAVAPIPE, |_| {
        let Some(display) = Display::open(test) else { return };
        let (folder, file) = town();
        let arguments = ["--size", "1200x860", file.to_str().unwrap()];
        let mut window = Window::open(&display, folder.path(), &arguments);
        window.wait("first frame");
        window.focus();
        window.wait("settled");
        window.click("part points");
        window.wait("returns first");
        let all = saved_picture(&window, folder.path(), 1);

        window.click("returns first");
        assert_eq!(window.wait_all("reading ").1, "first returns; intensity");
        window.wait("settled");
        let first = saved_picture(&window, folder.path(), 2);
        assert!(first != all, "some are hidden");
        window.key("ctrl+c");
        assert!(window.wait_all("command ").1.contains(" --returns first "));
        window.click("returns all");
        assert_eq!(window.wait_all("reading ").1, "all points; intensity");
        window.wait("settled");
        assert!(saved_picture(&window, folder.path(), 3) == all, "and back");
        assert_eq!(window.end(), Some(0));
    });
}

#[test]
fn colours_are_chosen_by_the_points_that_take_part_now() {
    let test = "colours_are_chosen_by_the_points_that_take_part_now";
    common::run(test, LAVAPIPE, |_| {
        let Some(display) = Display::open(test) else { return };
        let (folder, file) = town();
        let file = file.to_str().unwrap();
        // Colour, and the values at the ends of its ramp.
        let open = |more: &[&str]| {
            let arguments =
                [&["--size", "1200x860", "--cell", "1", "--color", "hag"], more, &[file]].concat();
            let mut window = Window::open(&display, folder.path(), &arguments);
            let mut lines = window.wait_all("first frame").0;
            window.focus();
            lines.extend(window.wait_all("settled").0);
            let ends =
                lines.iter().rev().find_map(|line| line.strip_prefix("color height-above-ground usual "));
            let ends = ends.unwrap_or_else(|| panic!("no colours: {lines:?}")).to_owned();
            (window, ends)
        };
        let (mut window, of_all) = open(&[]);
        // Measures mean the same whatever takes part: the lowest metres tell of no roofs.
        let heights = |window: &mut Window| {
            window.click("mode height");
            window.wait("color height usual")[0].clone()
        };
        let all_heights = heights(&mut window);
        let low: f64 = all_heights.split_once(',').unwrap().0.parse().unwrap();
        assert_eq!(window.end(), Some(0));

        let some = format!("--heights={low}..{}", low + 2.0);
        let (mut window, of_some) = open(&[&some]);
        assert!(of_some != of_all, "{of_some}");
        window.click("all points");
        assert_eq!(window.wait_all("reading ").1, "all points; height above ground");
        assert_eq!(window.wait("color height-above-ground usual")[0], of_all);
        window.wait("settled");
        assert_eq!(heights(&mut window), all_heights);
        assert_eq!(window.end(), Some(0));
    });
}

/// A field of 60 x 40 from so far east on, a point a unit, all of one height and flight line.
fn strip(path: &Path, east: f64, up: f64, line: u16) {
    write(path, field([60.0, 40.0], 1.0, |_, _| Some((up, 2))).map(|([x, y, z], c)| ([x + east, y, z], c)));
    let mut bytes = fs::read(path).unwrap();
    let start = u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize;
    for record in bytes[start..].chunks_exact_mut(20) {
        record[18..20].copy_from_slice(&line.to_le_bytes());
    }
    // At once, as far as a window that looks can tell.
    let aside = path.with_extension("new");
    fs::write(&aside, bytes).unwrap();
    fs::rename(aside, path).unwrap();
}

/// What comes to a window is read as what it shows then, not as it was asked for at first.
#[test]
fn files_that_come_are_read_by_the_points_that_are_selected_then() {
    let test = "files_that_come_are_read_by_the_points_that_are_selected_then";
    common::run(test, LAVAPIPE, |_| {
        let Some(display) = Display::open(test) else { return };
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        strip(&at("a.las"), 0.0, 10.0, 7);
        strip(&at("b.las"), 60.0, 10.0, 8);
        strip(&at("c.las"), 120.0, 10.0, 8);
        let arguments = ["--size", "1200x860", "--source-id", "7", "a.las", "b.las"];
        let mut window = Window::open(&display, folder.path(), &arguments);
        window.wait("first frame");
        window.focus();
        let (before, _) = window.wait_all("settled");
        assert!(before.iter().any(|line| line == "state 2400 of 4800 points selected"), "{before:#?}");
        window.click("all points");
        assert!(window.wait_all("reading ").1.starts_with("all points; "));
        window.wait("settled");
        let until = |state: &str| while window.wait_all("state ").1 != state {};
        // Another line of it, higher.
        strip(&at("b.las"), 60.0, 11.0, 9);
        window.wait("settled");
        window.ask_for("c.las");
        until("7200 points");
        window.wait("settled");
        window.click("copy list");
        let list: Vec<_> = (0..3).map(|_| window.wait_all("list ").1).collect();
        assert!(list.iter().all(|line| !line.contains("not where it was")), "{list:?}");
        // None of the one that comes is selected; it is there all the same.
        window.click("points source id");
        window.wait("typing points source id");
        window.enter("9");
        assert!(window.wait_all("reading ").1.starts_with("source id 9; "));
        until("2400 of 7200 points selected");
        window.wait("settled");
        strip(&at("d.las"), 180.0, 10.0, 8);
        window.ask_for("d.las");
        until("2400 of 9600 points selected");
        assert_eq!(window.end(), Some(0));
    });
}

#[test]
fn points_are_selected_by_what_is_typed_and_shown_as_another_surface() {
    let test = "points_are_selected_by_what_is_typed_and_shown_as_another_surface";
    common::run(test, LAVAPIPE, |_| {
        let Some(display) = Display::open(test) else { return };
        let folder = tempfile::tempdir().unwrap();
        for (name, east, up, line) in [("a.las", 0.0, 10.0, 7), ("b.las", 60.0, 20.0, 8)] {
            strip(&folder.path().join(name), east, up, line);
        }
        let arguments = ["--size", "1200x860", "--color", "class", "a.las", "b.las"];
        let mut window = Window::open(&display, folder.path(), &arguments);
        window.wait("first frame");
        window.focus();
        window.wait("settled");
        window.click("part points");
        window.wait("points heights");
        let type_heights = |words: &str| {
            window.click("points heights");
            window.wait("typing points heights");
            window.xdotool(&["key", "ctrl+a"]);
            window.enter(words);
        };
        type_heights("15..");
        assert_eq!(window.wait_all("reading ").1, "heights 15..; intensity");
        let (before, _) = window.wait_all("settled");
        assert!(before.iter().any(|line| line == "state 2400 of 4800 points selected"), "{before:#?}");
        window.click("more modes");
        window.wait("mode source-id");
        window.click("mode source-id");
        assert_eq!(window.wait_all("reading ").1, "heights 15..; source id");
        window.wait("settled");
        let shown = saved_picture(&window, folder.path(), 1);
        window.key("ctrl+c");
        let command = window.wait_all("command ").1;
        assert!(command.contains(" --heights 15.. ") && command.contains(" --color source-id "), "{command}");
        // That draws the same: cells and colours of what was open before.
        let words: Vec<_> = command.split(' ').skip(1).chain(["--samples", "16", "--quiet"]).collect();
        let (code, said) = run(folder.path(), &words);
        assert_eq!((code, &*said), (Some(0), ""));
        let drawn = rgb(&folder.path().join("view.png"));
        assert!(difference(&shown, &drawn) < 4.0, "{}", difference(&shown, &drawn));

        type_heights("500..600");
        let why = window.wait_all("unselected ").1;
        assert_eq!(why, "nothing to draw: no point is selected (heights 500..600); there is heights 10..20");
        window.wait("settled");
        window.click("all points");
        assert_eq!(window.wait_all("reading ").1, "all points; source id");
        window.wait("settled");
        let stacks = saved_picture(&window, folder.path(), 2);
        // The device's programs are others then.
        let show_as = |window: &Window, surface: &str| {
            window.click(&format!("surface {surface}"));
            window.wait(&format!("surface {surface}"));
            (window.wait("programs"), window.wait("settled"))
        };
        let (_, settled) = show_as(&window, "columns");
        window.key("ctrl+c");
        let command = window.wait_all("command ").1;
        assert!(command.contains(" --surface columns") && command.contains("--color source-id"), "{command}");
        assert_eq!(show_as(&window, "stacks").1[..5], settled[..5], "seen from where it was");
        assert!(saved_picture(&window, folder.path(), 3) == stacks, "as it was");
        assert_eq!(window.end(), Some(0));
    });
}
