//! `lasray render`: pictures without a window.

mod frames;

use super::placement::PlacementArgs;
use super::{Outcome, UsageError, check_targets};
use crate::attribute::{ClassMask, ColorMode, ColorTable, Kinds, Ramp};
use crate::coords::{Bounds, Grid, SectionKey};
use crate::gpu::{Gpu, GpuError, GpuOptions, Order};
use crate::ingest::bins::{Budget, Core};
use crate::ingest::builds::OpenInput;
use crate::load::{self, About, LoadError, LoadOptions, Loaded, Opening};
use crate::output::{self, Output, Protected, Signed, Target};
use crate::problems::Problems;
use crate::render::camera::{Camera, DEFAULT_FOV, DEFAULT_ORBIT, Projection};
use crate::render::frame::{Background, FrameError, Renderer, Shade, Traversal, View, check_size};
use crate::render::image::{Format, Image, SideFiles, WorldFile, notes};
use crate::render::path::CameraPath;
use crate::render::sight::sight;
use crate::resident::cut::Sight;
use crate::resident::live::{Live, Status};
use crate::resident::pool::Access;
use crate::resident::scene::Scene;
use crate::resident::visibility::Visibility;
use crate::resident::visibility::why_hidden;
use crate::section::slot::slot_bytes;
use crate::section::{Columns, Payload};
use crate::source::crs::Crs;
use crate::source::inputs::{self, Inputs};
use crate::source::learned::Cache;
use crate::text::{harmless, tidy};
use anyhow::Context;
use frames::Pattern;
use glam::DVec3;
use std::collections::HashSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Arguments of `lasray render`.
#[derive(Clone, Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Args {
    /// Files, folders, @lists and patterns
    #[arg(required_unless_present = "demo", value_name = "INPUT")]
    inputs: Vec<OsString>,
    /// Picture to write: .png or .exr; with --each, {stem} stands for the input's name; with --path, %d or
    /// %04d for the number of the picture, from 0
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Draw the embedded synthetic town
    #[arg(long, conflicts_with = "inputs")]
    demo: bool,
    /// One picture a file
    #[arg(long, conflicts_with = "demo")]
    each: bool,
    /// Fail (exit code 1) when any input is missing or damaged
    #[arg(long)]
    strict: bool,

    /// Width and height in pixels [default: 1280x720; with --ortho what the data needs]
    #[arg(long, value_parser = size, help_heading = "Picture", value_name = "WxH")]
    size: Option<[u32; 2]>,
    /// Rays a pixel in a PNG [default: 4, with --shade none 1]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=256), help_heading = "Picture")]
    samples: Option<u32>,
    /// What is behind the data [default: sky, with --ortho white]
    #[arg(long, value_enum, help_heading = "Picture")]
    background: Option<Background>,
    /// Light: `none` gives exact colours, pixel by pixel
    #[arg(long, value_enum, default_value = "lit", help_heading = "Picture")]
    shade: Shade,
    /// What the points stand for
    #[arg(long, value_enum, default_value = "columns", help_heading = "Picture")]
    surface: Surface,
    /// Show holes of up to four cells, which are bridged otherwise
    #[arg(long, help_heading = "Picture")]
    no_bridge: bool,

    /// Where the camera is: E,N,U
    #[arg(long, value_parser = vector, requires = "target", conflicts_with = "orbit", allow_hyphen_values = true, help_heading = "Camera", value_name = "E,N,U")]
    eye: Option<DVec3>,
    /// What it looks at: E,N,U
    #[arg(long, value_parser = vector, allow_hyphen_values = true, help_heading = "Camera", value_name = "E,N,U")]
    target: Option<DVec3>,
    /// Direction of view in degrees: azimuth clockwise from north, elevation (positive looks down), and a
    /// distance if not all of the data is to be framed [default: 0,35]
    #[arg(long, value_parser = orbit, allow_hyphen_values = true, help_heading = "Camera", value_name = "AZ,EL[,DIST]")]
    orbit: Option<Orbit>,
    /// Vertical field of view, degrees
    #[arg(long, default_value_t = DEFAULT_FOV, value_parser = fov, help_heading = "Camera")]
    fov: f64,
    /// Parallel rays, at this many units a pixel; from above unless --orbit says otherwise, then with
    /// world file
    #[arg(long, value_parser = positive, conflicts_with = "fov", help_heading = "Camera", value_name = "UNITS")]
    ortho: Option<f64>,
    /// Camera path to draw, a picture a frame: see docs/camera-paths.md
    #[arg(long, conflicts_with_all = ["eye", "target", "orbit", "fov", "ortho", "each"], help_heading = "Camera", value_name = "FILE")]
    path: Option<PathBuf>,
    /// Pictures to draw, spread evenly over the path [default: all of its frames]
    #[arg(long, requires = "path", value_parser = clap::value_parser!(u32).range(1..), help_heading = "Camera", value_name = "N")]
    frames: Option<u32>,
    /// Vertical exaggeration
    #[arg(long, default_value_t = 1.0, value_parser = positive, help_heading = "Camera")]
    z_scale: f64,

    /// What colours show: auto (RGB, else classes, else heights), rgb, height, class, intensity or return
    #[arg(long, default_value = "auto", value_parser = color, help_heading = "Colour")]
    color: Color,
    /// Colour ramp of heights and intensities
    #[arg(long, value_enum, help_heading = "Colour")]
    ramp: Option<Ramp>,
    /// Values at the ramp's ends: LO,HI [default: percentiles 2 and 98]
    #[arg(long, value_parser = range, allow_hyphen_values = true, help_heading = "Colour", value_name = "LO,HI")]
    range: Option<(f64, f64)>,
    /// Bits of the RGB fields, where the choice from the data is wrong
    #[arg(long, value_parser = ["8", "16"], help_heading = "Colour")]
    rgb_bits: Option<String>,

    /// Show only these classes: 2,6 or 3-5
    #[arg(long, value_parser = classes, help_heading = "Layers", value_name = "LIST")]
    classes: Option<ClassList>,
    /// Hide these classes (7 and 18, noise, are hidden unless asked for)
    #[arg(long, value_parser = classes, help_heading = "Layers", value_name = "LIST")]
    hide: Option<ClassList>,
    /// Show withheld points
    #[arg(long, help_heading = "Layers")]
    withheld: bool,

    /// Side of a cell in units of the picture (metres where the data are in degrees or Mercator), or auto
    #[arg(long, default_value = "auto", value_parser = cell, help_heading = "Data")]
    cell: Cell,
    #[command(flatten)]
    placement: PlacementArgs,
    /// Pixels that a cell may cover: farther away cells are coarser; 0: finest cells everywhere [default: 1, for
    /// exact pictures (--shade none, EXR) 0]
    #[arg(long, value_parser = detail, help_heading = "Data", value_name = "PIXELS")]
    detail: Option<f64>,
    /// When to draw: when all that the picture needs is there, or as soon as there is something to see
    #[arg(long, value_enum, default_value = "complete", conflicts_with = "demo", help_heading = "Data")]
    wait: Wait,
    /// Write what each picture took there, - for standard output: sections, bytes read, memory, detail
    #[arg(long, conflicts_with_all = ["demo", "each"], help_heading = "Data", value_name = "FILE")]
    json: Option<Target>,
    /// Neither use nor keep what was learned of files, and compiled programs, in the user's cache folder
    #[arg(long, help_heading = "Data")]
    no_cache: bool,
    /// Bytes of device memory for sections, at most 7/8 of what is free there
    #[arg(long, default_value = "1GiB", value_parser = bytes, help_heading = "Data", value_name = "BYTES")]
    device_memory: u64,
    /// Bytes of host memory for sections
    #[arg(long, default_value = "2GiB", value_parser = bytes, help_heading = "Data", value_name = "BYTES")]
    host_memory: u64,

    /// Device to draw on, by its number in `lasray info --devices`
    #[arg(long, help_heading = "Device")]
    device: Option<usize>,
    /// Turn on the Vulkan validation layers
    #[arg(long, help_heading = "Device")]
    validate: bool,
    /// The plain traversal of the thesis, to compare
    #[arg(long, help_heading = "Device")]
    plain: bool,
    /// No progress, no summary
    #[arg(short, long)]
    quiet: bool,
}

/// When a picture is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Wait {
    /// When all that it needs is there.
    Complete,
    /// As soon as there is something to see.
    None,
}

/// What the points stand for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Surface {
    /// Each cell is solid from its highest point down.
    Columns,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cell(pub(super) Option<f64>);

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Color(pub(super) Option<ColorMode>);

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Orbit {
    pub(super) angles: [f64; 2],
    pub(super) distance: Option<f64>,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct ClassList(pub(super) Vec<u8>);

fn number(text: &str) -> Result<f64, String> {
    let value: f64 = text.trim().parse().map_err(|_| format!("'{text}' is not a number"))?;
    if value.is_finite() { Ok(value) } else { Err(format!("'{text}' is not finite")) }
}

pub(super) fn positive(text: &str) -> Result<f64, String> {
    let value = number(text)?;
    if value > 0.0 { Ok(value) } else { Err(format!("{value} is not above 0")) }
}

fn detail(text: &str) -> Result<f64, String> {
    let value = number(text)?;
    if value >= 0.0 { Ok(value) } else { Err(format!("{value} is below 0")) }
}

pub(super) fn fov(text: &str) -> Result<f64, String> {
    let value = positive(text)?;
    if value < 180.0 { Ok(value) } else { Err(format!("{value} degrees is not below 180")) }
}

pub(super) fn cell(text: &str) -> Result<Cell, String> {
    if text == "auto" { Ok(Cell(None)) } else { positive(text).map(|c| Cell(Some(c))) }
}

pub(super) fn color(text: &str) -> Result<Color, String> {
    if text == "auto" {
        return Ok(Color(None));
    }
    let mode = clap::ValueEnum::from_str(text, true);
    mode.map(|m| Color(Some(m)))
        .map_err(|_| "possible values: auto, rgb, height, class, intensity, return".to_owned())
}

fn numbers(text: &str) -> Result<Vec<f64>, String> {
    text.split(',').map(number).collect()
}

pub(super) fn vector(text: &str) -> Result<DVec3, String> {
    match numbers(text)?[..] {
        [e, n, u] => Ok(DVec3::new(e, n, u)),
        _ => Err(format!("'{text}' is not E,N,U")),
    }
}

pub(super) fn orbit(text: &str) -> Result<Orbit, String> {
    match numbers(text)?[..] {
        [_, elevation, ..] if elevation.abs() > 90.0 => {
            Err(format!("elevation {elevation} is not within -90 (straight up) and 90 (straight down)"))
        }
        [azimuth, elevation] => Ok(Orbit { angles: [azimuth, elevation], distance: None }),
        [azimuth, elevation, d] if d > 0.0 => Ok(Orbit { angles: [azimuth, elevation], distance: Some(d) }),
        [_, _, d] => Err(format!("distance {d} is not above 0")),
        _ => Err(format!("'{text}' is not AZIMUTH,ELEVATION or AZIMUTH,ELEVATION,DISTANCE")),
    }
}

fn range(text: &str) -> Result<(f64, f64), String> {
    match numbers(text)?[..] {
        [lo, hi] if lo < hi => Ok((lo, hi)),
        [lo, hi] => Err(format!("{lo} is not below {hi}")),
        _ => Err(format!("'{text}' is not LO,HI")),
    }
}

pub(super) fn size(text: &str) -> Result<[u32; 2], String> {
    let side = |s: &str| s.trim().parse::<u32>().ok();
    let parsed = text.split_once(['x', 'X', '×']).and_then(|(w, h)| Some([side(w)?, side(h)?]));
    match parsed {
        Some([w, h]) if w > 0 && h > 0 => Ok([w, h]),
        Some(_) => Err("a picture has at least one pixel each way".to_owned()),
        None => Err(format!("'{text}' is not WIDTHxHEIGHT such as 1280x720")),
    }
}

pub(super) fn classes(text: &str) -> Result<ClassList, String> {
    let class = |s: &str| {
        let value: u32 = s
            .trim()
            .parse()
            .map_err(|_| format!("'{s}' is not a class: those are numbers, such as 3,4,5"))?;
        u8::try_from(value).map_err(|_| format!("class {value} is out of range: classes are 0 to 255"))
    };
    let mut list = Vec::new();
    for part in text.split(',') {
        match part.split_once('-') {
            Some((lo, hi)) => {
                let (lo, hi) = (class(lo)?, class(hi)?);
                if lo > hi {
                    return Err(format!("classes {lo}-{hi}: {lo} is above {hi}"));
                }
                list.extend(lo..=hi);
            }
            None => list.push(class(part)?),
        }
    }
    Ok(ClassList(list))
}

pub(super) fn bytes(text: &str) -> Result<u64, String> {
    let wrong = || format!("'{text}' is not a number of bytes such as 512MiB or 2GiB");
    let split = text.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(text.len());
    let (digits, unit) = text.split_at(split);
    let shift = match unit.to_ascii_lowercase().as_str() {
        "" | "b" => 0,
        "k" | "kib" | "kb" => 10,
        "m" | "mib" | "mb" => 20,
        "g" | "gib" | "gb" => 30,
        "t" | "tib" | "tb" => 40,
        _ => return Err(wrong()),
    };
    let value = digits.trim().parse::<f64>().map_err(|_| wrong())? * f64::from(shift).exp2();
    if (1.0..9e18).contains(&value) { Ok(value as u64) } else { Err(wrong()) }
}

/// Where it is kept what was learned of files.
fn cache(args: &Args) -> Option<Cache> {
    if args.no_cache { None } else { Cache::of_user() }
}

/// Bytes that sections may take on the device: what was asked for, and what it has beside the picture.
fn device_budget(gpu: &Gpu, args: &Args) -> u64 {
    gpu.bytes_for_sections(args.device_memory)
}

/// Draws.
pub fn run(args: Args, problems: &mut Problems) -> anyhow::Result<Outcome> {
    check_output(&args.output, args.each)?;
    let film = args.path.as_deref().map(|path| Film::new(path, &args)).transpose()?;
    if let (Some(eye), Some(target)) = (args.eye, args.target) {
        Camera::look_at(eye, target, Projection::default()).map_err(|e| UsageError(e.to_string()))?;
    }
    let found = inputs::expand(&args.inputs);
    let mut protected = Protected::of(&found);
    args.path.iter().for_each(|path| protected.add(path));
    let pictures: Box<dyn Iterator<Item = PathBuf>> = match &film {
        Some(film) => Box::new((0..film.frames.len() as u32).map(|number| film.pattern.file(number))),
        None if args.each => Box::new(found.files.iter().map(|path| each_output(&args.output, path))),
        None => Box::new(std::iter::once(args.output.clone())),
    };
    if let (Some(Target::File(json)), Some(_)) = (&args.json, args.ortho)
        && ["pgw", "wld", "prj"].iter().any(|side| *json == args.output.with_extension(side))
    {
        let why =
            format!("--json {}: refused: it is written beside the map: give another name", json.display());
        return Err(UsageError(why).into());
    }
    check_targets(&protected, pictures.map(|path| ("-o", path)), args.json.iter().map(|to| ("--json", to)))?;
    let options = GpuOptions {
        device: args.device,
        validate: args.validate,
        cache: cache(&args).map(|cache| cache.folder().to_owned()),
        ..Default::default()
    };
    let gpu = Gpu::new(&options).map_err(|e| match e {
        GpuError::NoSuchDevice { .. } => UsageError(e.to_string()).into(),
        e => anyhow::Error::from(e),
    })?;
    let options = LoadOptions {
        cell: args.cell.0,
        placement: args.placement.options(),
        rgb_bits: args.rgb_bits.as_ref().map(|b| if b == "8" { 8 } else { 16 }),
        budget: Budget {
            host_bytes: args.host_memory,
            // Pages of the pool do not fill up to the last byte.
            device_bytes: device_budget(&gpu, &args) - device_budget(&gpu, &args) / 8,
        },
        cache: cache(&args),
        quiet: args.quiet,
    };
    if let Some(size) = args.size {
        check_size(&gpu, size).map_err(|e| UsageError(e.to_string()))?;
    }

    problems.look_at(&found);
    if args.each {
        let drawn = each(&gpu, &found, &args, &options, &protected, problems);
        finish(problems, &args);
        drawn?;
    } else {
        let data = if args.demo {
            load::demo(&options, problems).map(Data::Whole)
        } else {
            Data::of(&found.files, &args, &options, problems)
        };
        say(problems, &args);
        let drawn = data
            .map_err(usage_of_load)
            .and_then(|d| draw(&gpu, d, &args, &args.output, film.as_ref(), &protected, problems));
        finish(problems, &args);
        drawn?;
    }
    anyhow::ensure!(gpu.messages().is_empty() || !args.validate, "the validation layers reported errors");
    Ok(if args.strict && problems.failed { Outcome::Incomplete } else { Outcome::Done })
}

/// One picture a file. What is wrong with one of them does not stop the others.
fn each(
    gpu: &Gpu,
    found: &Inputs,
    args: &Args,
    options: &LoadOptions,
    protected: &Protected,
    problems: &mut Problems,
) -> anyhow::Result<()> {
    let mut taken = HashSet::new();
    let (mut drawn, mut usage) = (false, None);
    for path in &found.files {
        let output = each_output(&args.output, path);
        if !taken.insert(output::one_name(&output)) {
            let (path, output) = (path.display(), output.display());
            problems.error(format!("{path}: not drawn into {output}: another input has that name"));
            continue;
        }
        let said = problems.said();
        let data = Data::of(std::slice::from_ref(path), args, options, problems).map_err(usage_of_load);
        match data.and_then(|data| draw(gpu, data, args, &output, None, protected, problems)) {
            Ok(()) => drawn = true,
            // Why nothing is left has been said.
            Err(error) if error.is::<LoadError>() && problems.said() > said => problems.lost(path),
            Err(error) => {
                problems.error(format!("{}: {error}", path.display()));
                usage = usage.or(error.downcast::<UsageError>().ok());
            }
        }
        say(problems, args);
    }
    match usage {
        _ if drawn => Ok(()),
        Some(usage) => Err(usage.into()),
        None => anyhow::bail!("nothing could be drawn"),
    }
}

/// A cell size that is too small is a wrong argument.
pub(super) fn usage_of_load(error: LoadError) -> anyhow::Error {
    match error {
        LoadError::TooFine { .. } => UsageError(error.to_string()).into(),
        error => error.into(),
    }
}

/// Prints what has come up so far.
fn say(problems: &mut Problems, args: &Args) {
    // A closed stderr is nothing to stop for.
    let _ = problems.print(!args.quiet, &mut std::io::stderr().lock());
}

/// Prints what has come up.
fn finish(problems: &mut Problems, args: &Args) {
    let _ = problems.finish(!args.quiet, &mut std::io::stderr().lock());
}

/// `{stem}` in `pattern` by the input's name without its extensions.
fn each_output(pattern: &Path, input: &Path) -> PathBuf {
    let name = input.file_name().unwrap_or_default().to_string_lossy();
    let lower = name.to_lowercase();
    let cut = [".copc.laz", ".laz", ".las"].iter().find(|e| lower.ends_with(**e)).map_or(0, |e| e.len());
    PathBuf::from(pattern.to_string_lossy().replace("{stem}", &name[..name.len() - cut]))
}

/// Finds out before the work whether its result can be written.
fn check_output(output: &Path, each: bool) -> anyhow::Result<()> {
    Format::of(output).map_err(|e| UsageError(e.to_string()))?;
    if each && !output.to_string_lossy().contains("{stem}") {
        return Err(UsageError("--each needs {stem} in the output's name: -o '{stem}.png'".to_owned()).into());
    }
    if !each && output.to_string_lossy().contains("{stem}") {
        return Err(UsageError("{stem} in the output's name goes with --each".to_owned()).into());
    }
    let folder = match output.parent() {
        Some(p) if !p.as_os_str().is_empty() && !p.to_string_lossy().contains("{stem}") => p,
        Some(p) if p.to_string_lossy().contains("{stem}") => return Ok(()),
        _ => Path::new("."),
    };
    let wrong = if output.is_dir() {
        "it is a folder".to_owned()
    } else if !folder.exists() {
        format!("the folder {} does not exist", folder.display())
    } else {
        match tempfile::tempfile_in(folder) {
            Ok(_) => return Ok(()),
            Err(error) => format!("{}: {error}", folder.display()),
        }
    };
    anyhow::bail!("{}: cannot be written: {wrong}", output.display())
}

fn visibility(args: &Args) -> Visibility {
    let mut classes = match &args.classes {
        Some(list) => ClassMask::only(&list.0),
        None => ClassMask::default(),
    };
    if let Some(list) = &args.hide {
        classes = classes.without(&list.0);
    }
    let bridge = if args.no_bridge || args.shade == Shade::None { 0 } else { 4 };
    Visibility { classes, withheld: args.withheld, bridge }
}

/// Packs on one thread while another copies; what is packed is freed.
pub fn upload(scene: &mut Scene, sections: Vec<(SectionKey, Columns)>) -> anyhow::Result<()> {
    let (send, receive) = crossbeam_channel::bounded::<(SectionKey, Payload)>(4);
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let work = std::sync::Mutex::new(sections.into_iter());
    std::thread::scope(|scope| {
        for _ in 0..threads {
            let (send, work) = (send.clone(), &work);
            scope.spawn(move || {
                loop {
                    let next = work.lock().unwrap_or_else(|e| e.into_inner()).next();
                    let Some((key, columns)) = next else { return };
                    // The receiver hangs up when the device fails: then there is nothing left to do.
                    if send.send((key, columns.pack())).is_err() {
                        return;
                    }
                }
            });
        }
        drop(send);
        for (key, packed) in receive {
            anyhow::ensure!(
                scene.upload(key, &packed)?,
                "the sections do not fit the device memory: give more with --device-memory, or a larger --cell"
            );
        }
        Ok(())
    })?;
    scene.settle()?;
    Ok(())
}

/// The frames of a path that are to be drawn, and where they go.
struct Film {
    path: CameraPath,
    frames: Vec<u32>,
    pattern: Pattern,
}

impl Film {
    fn new(file: &Path, args: &Args) -> Result<Film, UsageError> {
        let usage = |e: &dyn std::fmt::Display| UsageError(e.to_string());
        let path = CameraPath::read(file).map_err(|e| usage(&e))?;
        let (all, count) = (path.frames(), args.frames.unwrap_or(path.frames()));
        if count > all {
            return Err(usage(&format!("--frames {count}: {} has {all}", file.display())));
        }
        let pattern = Pattern::new(&args.output, count).map_err(|e| usage(&e))?;
        Ok(Film { frames: path.spread(count).collect(), path, pattern })
    }

    /// One a picture. `place`: from the coordinates of the file to the world's.
    fn cameras(&self, place: impl Fn(DVec3) -> DVec3) -> Result<Vec<Camera>, UsageError> {
        let path = self.path.placed(place).map_err(|e| UsageError(format!("camera path: {e}")))?;
        let camera = |&frame: &u32| {
            path.camera(frame).map_err(|e| UsageError(format!("camera path: frame {frame}: {e}")))
        };
        self.frames.iter().map(camera).collect()
    }
}

/// What is drawn.
enum Data {
    /// All of it in memory, at the finest level.
    Whole(Loaded),
    /// What pictures need of it is read when they need it.
    Live(Opening),
}

impl Data {
    fn of(
        files: &[PathBuf],
        args: &Args,
        options: &LoadOptions,
        problems: &mut Problems,
    ) -> Result<Data, LoadError> {
        // Exact pictures are made of the finest cells, all of them; the plain traversal knows no others.
        let whole = args.plain || args.detail.is_none() && is_exact(args) && args.wait == Wait::Complete;
        match whole {
            true => load::paths(files, options, problems).map(Data::Whole),
            false => load::open(files, options, problems).map(Data::Live),
        }
    }
}

/// Pictures whose pixels are specified exactly.
fn is_exact(args: &Args) -> bool {
    args.shade == Shade::None || Format::of(&args.output).is_ok_and(|format| format == Format::Exr)
}

/// Bytes uploaded between two looks at what else there is to do.
const UPLOAD_BYTES: u64 = 8 << 20;

/// Draws the picture that the arguments ask for, or all of `film`.
fn draw(
    gpu: &Gpu,
    data: Data,
    args: &Args,
    output: &Path,
    film: Option<&Film>,
    protected: &Protected,
    problems: &mut Problems,
) -> anyhow::Result<()> {
    let (grid, about, content) = match data {
        Data::Whole(Loaded { grid, about, sections, points }) => {
            (grid, about, Content::Whole(sections, points))
        }
        Data::Live(Opening { inputs, grid, core, about }) => (grid, about, Content::Live(inputs, core)),
    };
    let floor = about.floor(grid.cell());
    let About { bounds, summary, color, crs, unit, base, .. } = about;
    let pivot = bounds.min.z;
    let shown = bounds.exaggerated(args.z_scale, pivot);
    let place = |v: DVec3| base.place(v);
    let slab = Bounds { min: bounds.min.with_z(floor), ..bounds };
    let framed = if args.shade == Shade::Lit { slab.exaggerated(args.z_scale, pivot) } else { shown };
    // A map is of the points' extent; in a view, the cells of a few points reach far beyond it.
    let framed =
        if args.ortho.is_none() { framed.of_cells(grid.cell()) } else { framed.at_least(grid.cell()) };
    let (cameras, size) = match film {
        Some(film) => (film.cameras(place)?, args.size.unwrap_or([1280, 720])),
        None => camera(args, &framed, place).map(|(camera, size)| (vec![camera], size))?,
    };

    let pool_bytes = device_budget(gpu, args);
    let access = Access::best(
        gpu,
        match &content {
            Content::Whole(sections, _) => {
                sections.iter().map(|(_, columns)| slot_bytes(columns.layout().derived_bytes())).sum()
            }
            // Derived parts are less than half of what sections take.
            Content::Live(..) => pool_bytes / 2,
        },
    );
    let mut scene = Scene::new(gpu, |order: Order| order, access, pool_bytes, visibility(args), grid)?;
    let (mut live, points, sections) = match content {
        Content::Whole(sections, points) => {
            let count = sections.len();
            upload(&mut scene, sections)?;
            if let Some(why) = why_hidden(&scene.kinds(), &scene.visibility()) {
                anyhow::bail!("nothing to draw: {why}");
            }
            (None, points, count)
        }
        Content::Live(inputs, core) => {
            let points = inputs.iter().map(|input| input.input.file.points()).sum();
            let host_bytes = args.host_memory;
            let mut live = Live::new(inputs, grid, core, host_bytes, load::threads(), || ());
            if film.is_none() {
                live.keep_no_copies();
            }
            if let Some(cache) = cache(args) {
                live.keep_learned(cache);
            }
            (Some(live), points, 0)
        }
    };

    let mode = args.color.0.unwrap_or(color);
    let colors = ColorTable::new(mode, &summary, &grid, args.ramp, args.range)
        .map_err(|e| UsageError(e.to_string()))?;
    if let Some(constant) = &colors.constant
        && !args.quiet
    {
        eprintln!("note: {constant}");
    }

    let exr = Format::of(output)? == Format::Exr;
    let exact = is_exact(args);
    let detail = args.detail.unwrap_or(if exact { 0.0 } else { 1.0 });
    let parallel = matches!(cameras[0].projection(), Projection::Orthographic { .. });
    let view = View {
        camera: &cameras[0],
        size,
        samples: if exr { 1 } else { args.samples.unwrap_or(if exact { 1 } else { 4 }) },
        z_scale: args.z_scale,
        pivot,
        bounds,
        floor,
        colors: &colors,
        shade: args.shade,
        background: args.background.unwrap_or(if parallel { Background::White } else { Background::Sky }),
        traversal: if args.plain { Traversal::Plain } else { Traversal::Fast },
        window: None,
    };
    let anchor = grid.height(bounds.center().z).context("heights are beyond what can be drawn")?;
    let mut renderer = Renderer::new(&scene, grid, anchor)?;
    // Solid columns are seen from below, too.
    let seen_down_to = if args.shade == Shade::Lit { floor } else { bounds.solid_down_to() };
    let side = film.is_none().then(|| {
        let world = args.ortho.and_then(|_| {
            // In the world's own coordinates, degrees among them, not in those that are drawn.
            let [east, north] = base.horizontal_scale()?;
            Some(WorldFile::of(&cameras[0].basis(size).ok()?)?.scaled([1.0 / east, 1.0 / north]))
        });
        SideFiles::new(output, world.as_ref(), crs.as_ref().and_then(Crs::prj).as_deref())
    });
    let beside = side.as_ref().map_or(String::new(), SideFiles::note);
    let mut status = None;
    let mut all = Vec::new();
    let mut picture = |camera: &Camera, output: &Path| -> anyhow::Result<()> {
        let view = View { camera, ..view.clone() };
        let usage = |error: FrameError| match error {
            FrameError::Size { .. } | FrameError::Camera(_) => UsageError(error.to_string()).into(),
            error => anyhow::Error::from(error),
        };
        let table = match &mut live {
            None => renderer.table(&scene),
            Some(live) => {
                check_size(scene.gpu(), size).map_err(usage)?;
                let sight = sight(camera, size, [args.z_scale, pivot], seen_down_to, detail)
                    .map_err(|error| usage(error.into()))?;
                live.pause(false);
                live.restore_detail();
                let filled = fill(live, &mut scene, &sight, args);
                live.pause(true);
                // What was wrong with files is told even where the picture fails for another reason.
                live.take_errors().iter().for_each(|error| problems.error(error));
                live.take_warnings().iter().for_each(|warning| problems.warn(warning));
                let now = filled?;
                if now.coarser > 1.0 && status.is_none_or(|before: Status| before.coarser < now.coarser) {
                    problems.warn(format!(
                        "detail is reduced: cells may cover {:.1} times as many pixels, for lack of device memory (--device-memory)",
                        now.coarser
                    ));
                }
                status = Some(now);
                all.push(now);
                renderer.table_of_live(&scene, live)
            }
        };
        // Where nothing is in sight, the sample tells what there is elsewhere.
        let seen: Kinds = scene.kinds().union(&about.kinds).copied().collect();
        if let Some(why) = why_hidden(&seen, &scene.visibility()) {
            anyhow::bail!("nothing to draw: {why}");
        }
        let image = renderer.draw_table(&mut scene, &view, &table).map_err(usage)?;
        write(&image, &view, &grid, Output::over(output, protected), &beside)
    };
    match film {
        Some(film) => draw_film(film, &cameras, args.quiet, picture)?,
        None => picture(&cameras[0], output)?,
    }
    side.iter().flat_map(|side| side.write(protected)).for_each(|line| problems.warn(line));
    if let Some(to) = &args.json {
        let all: Vec<_> = all.into_iter().map(Signed::new).collect();
        let text = serde_json::to_string_pretty(&all).context("numbers as JSON")?;
        to.write(&(text + "\n"), protected)?;
    }
    if !args.quiet {
        let cell = tidy(grid.cell());
        let unit = unit.as_ref().map_or(if cell == "1" { "unit" } else { "units" }, |u| u.symbol());
        let plural = |n: u64, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
        let legend = colors.range.map_or(String::new(), |(lo, hi)| format!(" from {lo:.1} to {hi:.1}"));
        let pictures = film.map_or(String::new(), |f| plural(f.frames.len() as u64, "picture") + " of ");
        eprintln!(
            "{}: {pictures}{}x{} pixels, {} in {}, cells of {cell} {unit}, coloured by {}{legend}",
            harmless(&output.to_string_lossy()),
            size[0],
            size[1],
            plural(points, "point"),
            plural(status.map_or(sections, |status: Status| status.resident) as u64, "section"),
            mode.name()
        );
    }
    Ok(())
}

/// What scenes are filled from.
enum Content {
    /// Sections, and how many points are in them.
    Whole(Vec<(SectionKey, Columns)>, u64),
    /// Files to be read.
    Live(Vec<OpenInput>, Core),
}

/// Reads and uploads what a picture needs, or until there is something to see.
fn fill(live: &mut Live, scene: &mut Scene, sight: &Sight, args: &Args) -> anyhow::Result<Status> {
    let bar = load::bar(0, args.quiet, "reading {wide_bar} {human_pos}/{human_len} sections {eta}");
    loop {
        let tick = live.tick(scene, sight, UPLOAD_BYTES)?;
        let enough = match args.wait {
            Wait::Complete => tick.complete,
            Wait::None => tick.complete || live.sampled() && !live.shown().is_empty(),
        };
        if enough {
            if args.wait == Wait::Complete {
                live.drop_unseen(scene)?;
            }
            break;
        }
        if let Some(why) = live.failed() {
            anyhow::bail!(why);
        }
        if tick.stuck {
            let (host, device) = (args.host_memory, args.device_memory);
            return Err(LoadError::Budget { host, device }.into());
        }
        if !bar.is_hidden() {
            let status = live.status(scene);
            bar.set_length(status.wanted as u64);
            bar.set_position(status.ready as u64);
        }
        scene.flush()?;
        live.wait(Duration::from_millis(2));
    }
    bar.finish_and_clear();
    Ok(live.status(scene))
}

/// Draws one picture after the other. Ctrl-C ends it between two of them, a second one at once.
fn draw_film(
    film: &Film,
    cameras: &[Camera],
    quiet: bool,
    mut picture: impl FnMut(&Camera, &Path) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    static STOP: AtomicBool = AtomicBool::new(false);
    let stop = || {
        if STOP.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    };
    crate::stop::on_request(stop)?;
    let bar =
        load::bar(cameras.len() as u64, quiet, "drawing {wide_bar} {human_pos}/{human_len} pictures {eta}");
    for (number, camera) in (0..).zip(cameras) {
        if STOP.load(Ordering::Relaxed) {
            bar.finish_and_clear();
            anyhow::bail!("stopped after {number} of {} pictures", cameras.len());
        }
        picture(camera, &film.pattern.file(number))?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(())
}

/// Writes a picture; `beside`: what it says of its side files.
fn write(image: &Image, view: &View, grid: &Grid, output: Output, beside: &str) -> anyhow::Result<()> {
    let of_view = notes(view.camera, grid);
    let mut notes: Vec<_> = of_view.iter().map(|(key, value)| (*key, value.as_str())).collect();
    if !beside.is_empty() {
        notes.push(("Beside", beside));
    }
    image.write(output, view.background == Background::None, &notes)?;
    Ok(())
}

/// Camera and picture size that the arguments ask for, over `bounds` as they are shown.
fn camera(
    args: &Args,
    bounds: &Bounds,
    place: impl Fn(DVec3) -> DVec3,
) -> anyhow::Result<(Camera, [u32; 2])> {
    let usage = |e: crate::render::camera::CameraError| UsageError(e.to_string());
    let projection = match args.ortho {
        Some(units_per_pixel) => Projection::Orthographic { units_per_pixel },
        None => Projection::Perspective { fov: args.fov },
    };
    let orbit = args.orbit.unwrap_or(Orbit {
        angles: if args.ortho.is_some() { [0.0, 90.0] } else { DEFAULT_ORBIT },
        distance: None,
    });
    let size = match (args.size, args.ortho) {
        (Some(size), _) => size,
        (None, Some(units)) => ortho_size(bounds, orbit.angles, units)?,
        (None, None) => [1280, 720],
    };
    let camera = match (args.eye, args.target) {
        (Some(eye), Some(target)) => Camera::look_at(place(eye), place(target), projection),
        (_, target) => match orbit.distance {
            Some(distance) => {
                let target = target.map_or(bounds.center(), place);
                Camera::orbit(target, orbit.angles, distance, projection)
            }
            None => match target {
                Some(target) => {
                    let framed = Camera::frame(bounds, orbit.angles, projection, size).map_err(usage)?;
                    let distance = (framed.eye() - bounds.center()).length();
                    Camera::orbit(place(target), orbit.angles, distance, projection)
                }
                None => Camera::frame(bounds, orbit.angles, projection, size),
            },
        },
    };
    Ok((camera.map_err(usage)?, size))
}

/// Pixels that show all of `bounds` at `units` a pixel.
fn ortho_size(bounds: &Bounds, angles: [f64; 2], units: f64) -> anyhow::Result<[u32; 2]> {
    let looking = Camera::looking(DVec3::ZERO, angles, Projection::Orthographic { units_per_pixel: units })
        .map_err(|e| UsageError(e.to_string()))?;
    let half = (bounds.max - bounds.min) * 0.5;
    // Extent of a box along an axis.
    let along = |axis: DVec3| 2.0 * half.dot(axis.abs());
    let pixels = [along(looking.right()), along(looking.up())].map(|extent| (extent / units).ceil().max(1.0));
    if pixels.iter().any(|&p| p > 65_536.0) {
        let [w, h] = pixels;
        let why =
            format!("at {units} units a pixel the data takes {w}x{h} pixels: give --size, or more units");
        return Err(UsageError(why).into());
    }
    Ok(pixels.map(|p| p as u32))
}
