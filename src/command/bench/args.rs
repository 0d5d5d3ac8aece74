//! The command line of `lasray bench`.

use crate::bench::thesis::Config;
use crate::command::placement::PlacementArgs;
use crate::command::values::{bytes, count, pair, positive, size};
use crate::ingest::bins::Budget;
use crate::load::{self, LoadOptions};
use crate::output::Target;
use crate::render::benchmark_path::PathKind;
use crate::render::frame::Shade;
use crate::sample::Asked;
use crate::section::Surface;
use std::ffi::OsString;
use std::path::PathBuf;

/// Arguments of `lasray bench`.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = HELP)]
pub struct Args {
    /// Files, folders, @lists and patterns; none: a synthetic town
    #[arg(value_name = "INPUT")]
    pub(super) inputs: Vec<OsString>,

    /// Frames: all seven configurations of the thesis' Table 4.1
    #[arg(long, conflicts_with = "grid", help_heading = "Parts")]
    pub(super) table: bool,
    /// Reading and binning beside decoding alone, warm and cold
    #[arg(long, help_heading = "Parts")]
    pub(super) ingest: bool,
    /// Time until all is loaded: the thesis' 16 threads beside our pipeline
    #[arg(long, help_heading = "Parts")]
    pub(super) load: bool,
    /// What four times the cells under the same picture cost, and four times the points
    #[arg(long, help_heading = "Parts")]
    pub(super) scaling: bool,
    /// Intel Embree on the same cells and rays (needs a build with the feature `embree`)
    #[arg(long, help_heading = "Parts")]
    pub(super) peer: bool,

    /// The ground below unclassified points: time of reading into ground tiles and of the ground filter
    #[arg(long, help_heading = "Parts")]
    pub(super) complete: bool,
    /// Classes are the truth (2, 9, 10, 11, 41: ground): the filter knows nothing of them, and its errors are counted point by point
    #[arg(long, requires = "complete", help_heading = "Parts")]
    pub(super) truth: bool,

    /// Frames while files stream in beside the same frames with everything there: whether any waits, and how
    /// much longer they take; and what it takes to show other classes
    #[arg(long, help_heading = "Parts")]
    pub(super) stream: bool,

    /// Configurations GRID/LEVELS [default: 32/8]
    #[arg(long, value_delimiter = ',', value_parser = config, help_heading = "Frames", value_name = "G/L,…")]
    pub(super) grid: Vec<Config>,
    /// Camera paths [default: all, with --stream those that move; none beside --path]
    #[arg(long, value_enum, value_delimiter = ',', help_heading = "Frames", value_name = "NAME,…")]
    pub(super) paths: Vec<PathKind>,
    /// Camera path files to fly, see docs/camera-paths.md
    #[arg(long, help_heading = "Frames", value_name = "FILE")]
    pub(super) path: Vec<PathBuf>,
    /// Frames of each path to draw, spread evenly over it [default: all, with --stream 120]; but for --stream,
    /// sections stream in all of them
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..), help_heading = "Frames", value_name = "N")]
    pub(super) frames: Option<u32>,
    /// Width and height in pixels [default: 640x360, with --peer alone 1920x1080]
    #[arg(long, value_parser = size, help_heading = "Frames", value_name = "WxH")]
    pub(super) size: Option<[u32; 2]>,
    /// Pixels a workgroup of the thesis' pipeline covers: an upright strip [default: the fastest of 1x64, 8x32 and 8x8,
    /// by a short run]
    #[arg(long, value_parser = pair, help_heading = "Frames", value_name = "WxH")]
    pub(super) strip: Option<[u32; 2]>,

    /// Numbers of threads that read, `all`: one a core [default: --ingest 1,all, --load all]
    #[arg(long, value_delimiter = ',', value_parser = number_of_threads, help_heading = "Reading", value_name = "N,…")]
    pub(super) threads: Vec<Threads>,

    /// Light
    #[arg(long, value_enum, default_value = "lit", requires = "stream", help_heading = "Streaming")]
    pub(super) shade: Shade,
    /// Times that each path is flown both ways, in turn
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..), requires = "stream", help_heading = "Streaming", value_name = "N")]
    pub(super) runs: u32,
    /// Files that the synthetic town is made of
    #[arg(
        long,
        value_enum,
        value_delimiter = ',',
        default_value = "las,laz",
        requires = "stream",
        help_heading = "Streaming",
        value_name = "KIND,…"
    )]
    pub(super) format: Vec<TownKind>,
    /// Bytes of device memory for sections, at most 7/8 of what is free there
    #[arg(long, default_value = "1GiB", value_parser = bytes, requires = "stream", help_heading = "Streaming", value_name = "BYTES")]
    pub(super) device_memory: u64,
    /// Bytes of host memory for sections
    #[arg(long, default_value = "2GiB", value_parser = bytes, requires = "stream", help_heading = "Streaming", value_name = "BYTES")]
    pub(super) host_memory: u64,

    /// What the points of a column stand for, with --stream and --ingest [default: stacks]; all other parts compare columns
    #[arg(long, value_enum, help_heading = "Data")]
    pub(super) surface: Option<Surface>,
    /// Side of a cell, CRS units
    #[arg(long, default_value_t = 0.25, value_parser = positive, help_heading = "Data")]
    pub(super) cell: f64,
    /// Points of synthetic data; 500k and 2M are understood [default: 2 a cell of 4096x4096; for
    /// --ingest, --scaling and --stream 20M, for --load 4M]
    #[arg(long, value_parser = count, help_heading = "Data")]
    pub(super) points: Option<u64>,
    /// Which town, which random path
    #[arg(long, default_value_t = 1, help_heading = "Data")]
    pub(super) seed: u64,
    /// Neither use nor keep synthetic files, and compiled programs, in the user's cache folder
    #[arg(long, help_heading = "Data")]
    pub(super) no_cache: bool,
    #[command(flatten)]
    pub(super) placement: PlacementArgs,

    /// Write all figures there, - for standard output; the tables go to standard error then, with --quiet nowhere
    #[arg(long, help_heading = "Output", value_name = "FILE")]
    pub(super) json: Option<Target>,
    /// Draw the frames' times as bars; - as for --json
    #[arg(long, help_heading = "Output", value_name = "FILE.svg")]
    pub(super) plot: Option<Target>,
    /// No progress
    #[arg(short, long, help_heading = "Output")]
    pub(super) quiet: bool,

    /// Device to trace on, by its number in `lasray info --devices`
    #[arg(long, help_heading = "Device")]
    pub(super) device: Option<usize>,
}

impl Args {
    /// What the points of a column stand for where that can be chosen.
    pub(super) fn surface(&self) -> Surface {
        self.surface.unwrap_or_default()
    }

    /// The options of reading, columns.
    pub(super) fn load_options(&self) -> LoadOptions {
        LoadOptions {
            surface: Surface::Columns,
            cell: Some(self.cell.into()),
            placement: self.placement.options(),
            rgb_bits: None,
            asked: Asked::default(),
            // Nothing is coarsened: cells are what is compared.
            budget: Budget { host_bytes: u64::MAX, device_bytes: u64::MAX },
            cache: None,
            quiet: self.quiet,
        }
    }
}

const HELP: &str = "\
Without a part: frames. Both pipelines trace the same cells along the same paths; the land repeats without end.
Times are device timestamps where the device has them; docs/performance.md says what is measured and how.

--stream: each path is flown from nothing, frame upon frame, while threads read the files; then what all of its
cameras want is fetched, reading stops, and the same frames are drawn twice more. All in turn, --runs times; the ratio
is the median of those of the runs in which the last two flights are alike, the other figures are over all frames. The fast path goes back and forth over
the data, 256 cells a frame. Shaders are compiled before. At last, from the middle of the first path and with everything there,
bare earth is shown and then all classes, --runs times: how long it takes, and how much longer frames take meanwhile.

Ctrl-C and, on Unix, SIGTERM end it after the frame or run at hand, with tables, --json and --plot of all that was
measured whole until then; a second one ends it at once.

Exit codes: 0 done; 1 failed, stopped, a frame that waited for streaming, or pictures that differ in more than 0.1 % of
the pixels; 2 wrong arguments.
";

/// Files of a synthetic town.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum TownKind {
    /// Records as they are.
    Las,
    /// Compressed.
    Laz,
}

impl TownKind {
    pub(super) fn name(self) -> &'static str {
        match self {
            TownKind::Las => "las",
            TownKind::Laz => "laz",
        }
    }
}

/// `32/8`: a power of two, and levels.
fn config(text: &str) -> Result<Config, String> {
    let pair = text.split_once('/').and_then(|(g, l)| Some((g.trim().parse().ok()?, l.trim().parse().ok()?)));
    let (grid, levels): (u32, u32) =
        pair.ok_or_else(|| format!("'{text}' is not GRID/LEVELS such as 32/8"))?;
    if !grid.is_power_of_two() || !(2..=256).contains(&grid) {
        return Err(format!("a grid of {grid}: expected a power of two from 2 to 256"));
    }
    if !(1..=9).contains(&levels) {
        return Err(format!("{levels} levels: expected 1 to 9"));
    }
    Ok(Config { grid, levels })
}

/// A number of threads.
#[derive(Clone, Copy, Debug)]
pub(super) struct Threads(pub(super) u32);

fn number_of_threads(text: &str) -> Result<Threads, String> {
    let number = match text.trim() {
        "all" => Some(load::threads() as u32),
        text => text.parse().ok().filter(|n| (1..=1024).contains(n)),
    };
    number.map(Threads).ok_or_else(|| format!("'{text}' is not a number of threads from 1 to 1024, or all"))
}
