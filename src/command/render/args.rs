//! The command line of `lasray render`.

use crate::attribute::{ColorRange, Ramp};
use crate::command::layers::LayerArgs;
use crate::command::placement::PlacementArgs;
use crate::command::values::{
    self, Cell, Color, Orbit, Ortho, Place, SelectionArgs, bytes, cell, color, detail, fov, orbit, ortho,
    place, positive, range, size,
};
use crate::gpu::Gpu;
use crate::output::Target;
use crate::render::camera::DEFAULT_FOV;
use crate::render::frame::{Background, Shade};
use crate::render::image::Format;
use crate::resident::visibility::Visibility;
use crate::section::Surface;
use crate::source::learned::Cache;
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

/// Arguments of `lasray render`.
#[derive(Clone, Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Args {
    /// Files, folders, @lists and patterns; a name of a picture at their end is that of the picture to write
    #[arg(required_unless_present_any = ["demo", "path"], value_name = "INPUT")]
    pub(super) inputs: Vec<OsString>,
    /// Picture to write: .png, .jpg or .exr; with --each, {stem} stands for the input's name; with --path, %d or
    /// %04d for the number of the picture, from 0 [default: the first input's name, .png, in the current folder]
    #[arg(short, long, value_name = "FILE")]
    pub(super) output: Option<PathBuf>,
    /// Draw the embedded synthetic town
    #[arg(long)]
    pub(super) demo: bool,
    /// One picture a file, all with the same cells, colours and pixel grid
    #[arg(long, conflicts_with = "demo")]
    pub(super) each: bool,
    /// Fail (exit code 1) when any input is missing or damaged
    #[arg(long)]
    pub(super) strict: bool,

    /// Width and height in pixels: 800x600; a width alone, 800, is 16:9 [default: 1280x720; with --ortho what the data
    /// needs]
    #[arg(long, value_parser = size, help_heading = "Picture", value_name = "WxH")]
    pub(super) size: Option<[u32; 2]>,
    /// Rays a pixel in a PNG [default: 4, with --shade none 1]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=256), help_heading = "Picture")]
    pub(super) samples: Option<u32>,
    /// What is behind the data [default: sky, with --ortho white]
    #[arg(long, value_enum, help_heading = "Picture")]
    pub(super) background: Option<Background>,
    /// Light: `none` gives exact colours, pixel by pixel
    #[arg(long, value_enum, default_value = "lit", help_heading = "Picture")]
    pub(super) shade: Shade,
    /// What the points stand for
    #[arg(long, value_enum, default_value = "stacks", help_heading = "Picture")]
    pub(super) surface: Surface,
    /// Show holes of up to four cells, which are bridged otherwise
    #[arg(long, help_heading = "Picture")]
    pub(super) no_bridge: bool,

    /// Where the camera is: E,N,U; U may be +3: 3 units above what is shown at E,N
    #[arg(long, value_parser = place, requires = "target", conflicts_with = "orbit", allow_hyphen_values = true, help_heading = "Camera", value_name = "E,N,U")]
    pub(super) eye: Option<Place>,
    /// What it looks at: E,N,U, or E,N,+3 likewise
    #[arg(long, value_parser = place, allow_hyphen_values = true, help_heading = "Camera", value_name = "E,N,U")]
    pub(super) target: Option<Place>,
    /// Direction of view in degrees: azimuth clockwise from north, elevation (positive looks down), and a
    /// distance if not all of the data is to be framed [default: 0,35]
    #[arg(long, value_parser = orbit, allow_hyphen_values = true, help_heading = "Camera", value_name = "AZ,EL[,DIST]")]
    pub(super) orbit: Option<Orbit>,
    /// Vertical field of view, degrees
    #[arg(long, default_value_t = DEFAULT_FOV, value_parser = fov, help_heading = "Camera")]
    pub(super) fov: f64,
    /// Parallel rays, at this many units a pixel (0.25, 25cm), without a number one pixel a cell; from above, with world
    /// file and edges at multiples of the pixel, unless --orbit, or --eye and --target, say otherwise
    #[arg(
        long,
        value_parser = ortho,
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = values::CELL,
        conflicts_with = "fov",
        help_heading = "Camera",
        value_name = "UNITS"
    )]
    pub(super) ortho: Option<Ortho>,
    /// Camera path to draw, a picture a frame (see docs/camera-paths.md); without inputs a saved view, with its files,
    /// colours and layers
    #[arg(long, conflicts_with_all = ["eye", "target", "orbit", "fov", "ortho", "each"], help_heading = "Camera", value_name = "FILE")]
    pub(super) path: Option<PathBuf>,
    /// Pictures to draw, spread evenly over the path [default: all of its frames]
    #[arg(long, requires = "path", value_parser = clap::value_parser!(u32).range(1..), help_heading = "Camera", value_name = "N")]
    pub(super) frames: Option<u32>,
    /// Vertical exaggeration
    #[arg(long, default_value_t = 1.0, value_parser = positive, help_heading = "Camera")]
    pub(super) z_scale: f64,

    /// What colours show: auto (RGB, else classes, else heights), rgb, height (or elevation, z), class, intensity, return,
    /// source-id, scan-angle, gps-time, height-above-ground (or hag), density (points in a square unit, over squares of four
    /// cells each way, noise and withheld points left out) or line-difference (how far flight lines are apart there)
    #[arg(long, visible_alias = "colour", default_value = "auto", value_parser = color, help_heading = "Colour")]
    pub(super) color: Color,
    /// Colour ramp of heights, intensities, angles, times, densities and differences
    #[arg(long, value_enum, help_heading = "Colour")]
    pub(super) ramp: Option<Ramp>,
    /// Values at the ramp's ends, or percentiles of what the data have: 180..260, 2%..98% or 0..98% [default: 2%..98%; of scan
    /// angles and times all; of heights above ground, densities and differences from 0]
    #[arg(long, value_parser = range, allow_hyphen_values = true, help_heading = "Colour", value_name = "A..B")]
    pub(super) range: Option<ColorRange>,
    /// Bits of the RGB fields, where the choice from the data is wrong
    #[arg(long, value_parser = ["8", "16"], help_heading = "Colour")]
    pub(super) rgb_bits: Option<String>,

    #[command(flatten)]
    pub(super) layers: LayerArgs,
    #[command(flatten)]
    pub(super) selection: SelectionArgs,

    /// Side of a cell in units of the picture (metres where the data are in degrees or Mercator), with a unit, 50cm, or
    /// auto
    #[arg(long, default_value = "auto", value_parser = cell, help_heading = "Data")]
    pub(super) cell: Cell,
    #[command(flatten)]
    pub(super) placement: PlacementArgs,
    /// Pixels that a cell may cover: farther away cells are coarser; 0: finest cells everywhere [default: 1, for
    /// exact pictures (--shade none, EXR) 0]
    #[arg(long, value_parser = detail, help_heading = "Data", value_name = "PIXELS")]
    pub(super) detail: Option<f64>,
    /// When to draw: when all that the picture needs is there, or as soon as there is something to see
    #[arg(long, value_enum, default_value = "complete", conflicts_with = "demo", help_heading = "Data")]
    pub(super) wait: Wait,
    /// Write what each picture took there, - for standard output: sections, bytes read, memory, detail
    #[arg(long, help_heading = "Data", value_name = "FILE")]
    pub(super) json: Option<Target>,
    /// Neither use nor keep what was learned of files, and compiled programs, in the user's cache folder
    #[arg(long, help_heading = "Data")]
    pub(super) no_cache: bool,
    /// Bytes of device memory for sections, at most 7/8 of what is free there
    #[arg(long, default_value = "1GiB", value_parser = bytes, help_heading = "Data", value_name = "BYTES")]
    pub(super) device_memory: u64,
    /// Bytes of host memory for sections
    #[arg(long, default_value = "2GiB", value_parser = bytes, help_heading = "Data", value_name = "BYTES")]
    pub(super) host_memory: u64,

    /// Device to draw on, by its number in `lasray info --devices`
    #[arg(long, help_heading = "Device")]
    pub(super) device: Option<usize>,
    /// Turn on the Vulkan validation layers
    #[arg(long, help_heading = "Device")]
    pub(super) validate: bool,
    /// The plain traversal of the thesis, to compare
    #[arg(long, help_heading = "Device")]
    pub(super) plain: bool,
    /// No progress, no summary
    #[arg(short, long)]
    pub(super) quiet: bool,
}

impl Args {
    /// The camera path that is to say what is drawn, without inputs; and the picture, where its name is the only word.
    pub fn saved_view(&self) -> Option<(&Path, Option<&OsStr>)> {
        let picture = match &self.inputs[..] {
            [] => None,
            [only] if values::is_picture(only) => Some(&**only),
            _ => return None,
        };
        self.path.as_deref().map(|path| (path, picture))
    }

    /// Where it is kept what was learned of files.
    pub(super) fn cache(&self) -> Option<Cache> {
        if self.no_cache { None } else { Cache::of_user() }
    }

    /// Bytes that sections may take on the device: what was asked for, and what it has beside the picture.
    pub(super) fn device_budget(&self, gpu: &Gpu) -> u64 {
        gpu.bytes_for_sections(self.device_memory)
    }

    /// Pictures whose pixels are specified exactly.
    pub(super) fn is_exact(&self, output: &Path) -> bool {
        self.shade == Shade::None || Format::of(output).is_ok_and(|format| format == Format::Exr)
    }

    /// What of the points is shown.
    pub(super) fn visibility(&self, exact: bool) -> Visibility {
        let bridge = if self.no_bridge || self.shade == Shade::None { 0 } else { 4 };
        let (classes, hidden_flags) = (self.layers.classes(), self.layers.hidden_flags());
        Visibility { classes, hidden_flags, bridge, near_ties: !exact }
    }
}

/// When a picture is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Wait {
    /// When all that it needs is there.
    Complete,
    /// As soon as there is something to see.
    None,
}
