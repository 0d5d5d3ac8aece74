//! `lasray view`: the window.

use super::layers::LayerArgs;
use super::outcome::{Outcome, UsageError};
use super::placement::PlacementArgs;
use super::saved::{self, SavedWords};
use super::targets::check_targets;
use super::values::{self, Cell, Color, Orbit, Place, SelectionArgs};
use crate::attribute::{ColorRange, Ramp};
use crate::gpu::{GpuError, GpuOptions};
use crate::load::LoadError;
use crate::output::{Protected, Target};
use crate::problems::Problems;
use crate::render::camera::{Camera, DEFAULT_FOV, Projection};
use crate::render::frame::Shade;
use crate::render::path::CameraPath;
use crate::resident::visibility::Visibility;
use crate::section::Surface;
use crate::source::inputs;
use crate::source::learned::Cache;
use crate::view;
use clap::Parser as _;
use glam::DVec3;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Arguments of `lasray view`.
#[derive(Clone, Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Args {
    /// Files, folders, @lists and patterns, or a saved view (.json); without any the window asks for them
    #[arg(value_name = "INPUT")]
    inputs: Vec<OsString>,

    /// Width and height of the window, in the pixels of a screen of usual density; a width alone is 16:9
    #[arg(long, default_value = "1280x800", value_parser = values::size, help_heading = "Picture", value_name = "WxH")]
    size: [u32; 2],
    /// Vertical exaggeration
    #[arg(long, default_value_t = 1.0, value_parser = values::positive, help_heading = "Picture")]
    z_scale: f64,
    /// What colours show: auto (RGB, else classes, else heights), rgb, height (or elevation, z), class, intensity, return,
    /// source-id, scan-angle, gps-time, height-above-ground (or hag), density (points in a square unit, over squares of four
    /// cells each way, noise and withheld points left out) or line-difference (how far flight lines are apart there)
    #[arg(long, visible_alias = "colour", default_value = "auto", value_parser = values::color, help_heading = "Picture")]
    color: Color,
    /// Colour ramp of heights, intensities, angles, times, densities and differences
    #[arg(long, value_enum, help_heading = "Picture")]
    ramp: Option<Ramp>,
    /// Values at the ramp's ends, or percentiles of what the data have: 180..260, 2%..98% or 0..98% [default: 2%..98%; of scan
    /// angles and times all; of heights above ground, densities and differences from 0]
    #[arg(long, value_parser = values::range, allow_hyphen_values = true, help_heading = "Picture", value_name = "A..B")]
    range: Option<ColorRange>,
    /// Light, or plain colours
    #[arg(long, value_enum, default_value = "lit", help_heading = "Picture")]
    shade: Shade,
    /// What the points stand for
    #[arg(long, value_enum, default_value = "stacks", help_heading = "Picture")]
    surface: Surface,
    /// Show holes of up to four cells, which are bridged otherwise
    #[arg(long, help_heading = "Picture")]
    no_bridge: bool,

    #[command(flatten)]
    layers: LayerArgs,
    #[command(flatten)]
    selection: SelectionArgs,

    /// Where the camera is: E,N,U
    #[arg(long, value_parser = in_window, requires = "target", conflicts_with = "orbit", allow_hyphen_values = true, help_heading = "Camera", value_name = "E,N,U")]
    eye: Option<DVec3>,
    /// What it looks at: E,N,U
    #[arg(long, value_parser = in_window, allow_hyphen_values = true, help_heading = "Camera", value_name = "E,N,U")]
    target: Option<DVec3>,
    /// Direction of view in degrees: azimuth clockwise from north, elevation (positive looks down), and a
    /// distance if not all of the data is to be framed [default: 0,35]
    #[arg(long, value_parser = values::orbit, allow_hyphen_values = true, help_heading = "Camera", value_name = "AZ,EL[,DIST]")]
    orbit: Option<Orbit>,
    /// Vertical field of view, degrees
    #[arg(long, default_value_t = DEFAULT_FOV, value_parser = values::fov, help_heading = "Camera")]
    fov: f64,
    /// Parallel rays, at this many units a pixel; from above unless --orbit says otherwise
    #[arg(long, value_parser = values::positive, conflicts_with_all = ["fov", "path"], help_heading = "Camera", value_name = "UNITS")]
    ortho: Option<f64>,
    /// Camera path to fly: see docs/camera-paths.md
    #[arg(long, conflicts_with_all = ["eye", "target", "orbit"], help_heading = "Camera", value_name = "FILE")]
    path: Option<PathBuf>,
    /// Frames of the path, spread evenly over it [default: all]
    #[arg(long, requires = "path", value_parser = clap::value_parser!(u32).range(1..), help_heading = "Camera", value_name = "N")]
    frames: Option<u32>,
    /// Fly the path so often; from the second time on when all that it shows is there
    #[arg(long, requires = "path", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..), help_heading = "Camera", value_name = "N")]
    laps: u32,
    /// Close the window at the end of the path
    #[arg(long, requires = "path", help_heading = "Camera")]
    quit: bool,

    /// Side of a cell in units of the picture (metres where the data are in degrees or Mercator), with a unit, 50cm, or
    /// auto
    #[arg(long, default_value = "auto", value_parser = values::cell, help_heading = "Data")]
    cell: Cell,
    #[command(flatten)]
    placement: PlacementArgs,
    /// Bits of the RGB fields, where the choice from the data is wrong
    #[arg(long, value_parser = ["8", "16"], help_heading = "Data")]
    rgb_bits: Option<String>,
    /// Neither use nor keep what was learned of files, and compiled programs, in the user's cache folder
    #[arg(long, help_heading = "Data")]
    no_cache: bool,
    /// Bytes of device memory for sections, at most 7/8 of what is free there
    #[arg(long, default_value = "1GiB", value_parser = values::bytes, help_heading = "Data", value_name = "BYTES")]
    device_memory: u64,
    /// Bytes of host memory for sections while they are read
    #[arg(long, default_value = "2GiB", value_parser = values::bytes, help_heading = "Data", value_name = "BYTES")]
    host_memory: u64,

    /// Device to draw on, by its number in `lasray info --devices`
    #[arg(long, help_heading = "Device")]
    device: Option<usize>,
    /// Turn on the Vulkan validation layers
    #[arg(long, help_heading = "Device")]
    validate: bool,
    /// Write times of frames there at the end, - for standard output
    #[arg(long, help_heading = "Device", value_name = "FILE")]
    json: Option<Target>,
    /// Tell what happens on standard output, for tests
    #[arg(long, hide = true)]
    log_events: bool,
    /// Files of the inputs that are not shown at first: of a saved view
    #[arg(long, hide = true, value_name = "FILE")]
    hidden: Vec<PathBuf>,
    /// The saved view whose camera is the first
    #[arg(long, hide = true, conflicts_with = "path", value_name = "FILE")]
    saved: Option<PathBuf>,
}

/// What a saved view says, as if it had been typed.
#[derive(Debug, clap::Parser)]
#[command(no_binary_name = true)]
struct Typed {
    #[command(flatten)]
    args: Args,
}

impl Args {
    /// The saved view that is to be opened, and the words that it takes the place of, if it is that: the only input, or a path
    /// without inputs.
    pub fn saved_view(&self) -> Option<(&Path, bool)> {
        match (&self.inputs[..], &self.path) {
            ([only], None) if saved::is_view_name(only) && Path::new(only).is_file() => {
                Some((Path::new(only), true))
            }
            ([], Some(path)) => Some((path, false)),
            _ => None,
        }
    }

    fn cache(&self) -> Option<Cache> {
        if self.no_cache { None } else { Cache::of_user() }
    }

    /// What is seen.
    fn view(&self) -> Result<view::ViewOptions, UsageError> {
        let (classes, hidden_flags) = (self.layers.classes(), self.layers.hidden_flags());
        let bridge = if self.no_bridge { 0 } else { 4 };
        let is_typed = self.target.is_some() || self.orbit.is_some() || self.ortho.is_some();
        let read = |file: &PathBuf| CameraPath::read(file).map_err(|error| UsageError(error.to_string()));
        Ok(view::ViewOptions {
            inputs: self.inputs.clone(),
            hidden: self.hidden.clone(),
            data: view::data::ReadOptions {
                surface: self.surface,
                cell: self.cell.0,
                placement: self.placement.options(),
                rgb_bits: self.rgb_bits.as_ref().map(|bits| if bits == "8" { 8 } else { 16 }),
                host_bytes: self.host_memory,
                device_bytes: self.device_memory,
                visibility: Visibility { classes, hidden_flags, bridge, near_ties: true },
                selection: self.selection.selection(),
                color: self.color.0,
                cache: self.cache(),
            },
            color: self.color.0,
            ramp: self.ramp,
            range: self.range,
            shade: self.shade,
            z_scale: self.z_scale,
            eye: self.eye,
            target: self.target,
            orbit: self.orbit.map(|orbit| (orbit.angles, orbit.distance)),
            fov: self.fov,
            ortho: self.ortho,
            // A camera that is typed counts before the saved one.
            saved: self.saved.as_ref().filter(|_| !is_typed).map(read).transpose()?,
        })
    }
}

/// A saved view, for a window that is open. Errors: in words.
fn read_view(file: &Path) -> Result<view::OpenedView, String> {
    let camera = CameraPath::read(file).map_err(|error| error.to_string())?;
    let Some(saved) = camera.saved_view() else { return Ok(view::OpenedView::Camera(camera)) };
    let SavedWords { inputs, hidden, options } = SavedWords::of(file, saved, |name| name != "size");
    let typed =
        Typed::try_parse_from(&options).map_err(|error| saved::wrong_option(file, &error).to_string())?;
    let hidden_paths = hidden.iter().map(PathBuf::from).collect();
    let args = Args { inputs: [inputs, hidden].concat(), hidden: hidden_paths, ..typed.args };
    let view = args.view().map_err(|error| error.to_string())?;
    Ok(view::OpenedView::Whole(Box::new(view::ViewOptions { saved: Some(camera), ..view })))
}

/// The window has a camera before it has points.
fn in_window(text: &str) -> Result<DVec3, String> {
    match values::place(text)? {
        Place::At(place) => Ok(place),
        Place::Above(..) => Err(format!(
            "'{text}': the window takes no heights above what is shown: give E,N,U, or draw it with `lasray render`"
        )),
    }
}

/// Opens the window.
pub fn run(args: Args, problems: &mut Problems) -> anyhow::Result<Outcome> {
    let usage = |e: &dyn std::fmt::Display| UsageError(e.to_string());
    if let (Some(eye), Some(target)) = (args.eye, args.target) {
        Camera::look_at(eye, target, Projection::default()).map_err(|e| usage(&e))?;
    }
    // A window with nothing in it says less than a line.
    let is_gone =
        |word: &OsString| !Path::new(word).exists() && !word.to_string_lossy().contains(['@', '*', '?', '[']);
    if !args.inputs.is_empty() && args.inputs.iter().all(is_gone) {
        problems.look_at(&inputs::expand(&args.inputs));
        let _ = problems.finish(true, &mut std::io::stderr().lock());
        return Err(LoadError::Nothing("no input could be read").into());
    }
    let mut protected = Protected::default();
    if let Some(to) = &args.json {
        protected = Protected::of(&inputs::expand(&args.inputs));
        args.path.iter().chain(&args.saved).for_each(|path| protected.add(path));
        check_targets(&protected, [], [("--json", to)])?;
        if args.log_events && *to == Target::Stdout {
            return Err(usage(&"--json -: --log-events takes standard output").into());
        }
    }
    let path = match &args.path {
        Some(file) => {
            let path = CameraPath::read(file).map_err(|e| usage(&e))?;
            let frames = args.frames.unwrap_or(path.frames());
            if frames > path.frames() {
                let (file, all) = (file.display(), path.frames());
                return Err(usage(&format!("--frames {frames}: {file} has {all}")).into());
            }
            Some((path, frames))
        }
        None => None,
    };
    let options = view::WindowOptions {
        view: args.view()?,
        read_view,
        gpu: GpuOptions {
            device: args.device,
            validate: args.validate,
            cache: args.cache().map(|cache| cache.folder().to_owned()),
            ..GpuOptions::default()
        },
        size: args.size,
        path,
        laps: args.laps,
        quit: args.quit,
        json: args.json,
        protected,
        log_events: args.log_events,
    };
    view::run(options, problems).map_err(|error| match error.downcast_ref::<GpuError>() {
        Some(GpuError::NoSuchDevice { .. }) => usage(&error).into(),
        _ => error,
    })?;
    Ok(Outcome::Done)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_say_what_points_stand_for() {
        let surface =
            |options: &[&str]| Typed::try_parse_from(options).unwrap().args.view().unwrap().data.surface;
        assert_eq!(surface(&[]), Surface::Stacks);
        assert_eq!(surface(&["--surface=columns"]), Surface::Columns);
        for kind in [Surface::Columns, Surface::Stacks, Surface::Smooth] {
            assert_eq!(surface(&["--surface", kind.name()]), kind);
        }
    }
}
