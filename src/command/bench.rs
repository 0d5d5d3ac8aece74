//! `lasray bench`: the timing harness.

use super::outcome::{Outcome, UsageError, usage_of_load};
use super::placement::PlacementArgs;
use super::targets::check_targets;
use super::values::{bytes, count, positive, size};
use crate::bench::frames::{self, Options, PoolRun, ThesisRun, Traced};
use crate::bench::ingest::{self, IngestOptions};
use crate::bench::load as loading;
use crate::bench::report::{Pipeline, Report, Row, ScalingRow, Skipped, Stat};
use crate::bench::steady::Repeats;
use crate::bench::stream;
use crate::bench::thesis::{Config, STRIPS, Thesis};
use crate::bench::towns::{Set, Towns};
use crate::bench::world::{self, TOWN_POINTS, World};
use crate::bench::{self, FrameTimes, Stopped, plot};
use crate::gpu::{DeviceKind, Gpu, GpuError, GpuOptions};
use crate::ingest::bins::Budget;
use crate::load::{self, LoadOptions};
use crate::output::{Protected, Target, print};
use crate::problems::Problems;
use crate::render::frame::{Shade, check_size};
use crate::render::path::{CameraPath, PathKind};
use crate::source::inputs::{self, Inputs};
use crate::source::learned::Cache;
use crate::source::placement::Fit;
use crate::synth;
use anyhow::Context;
use serde_json::json;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// Share of pixels in which the pipelines' pictures may differ.
const MOST_DIFFER: f64 = 1e-3;
/// Points of a file that is read.
const INGEST_POINTS: u64 = 20_000_000;
/// Points of a file that is loaded.
const LOAD_POINTS: u64 = 4_000_000;
/// Runs that figures of loading and of scaling are medians of.
const LOAD_RUNS: u32 = 3;
/// Points of each town that is streamed.
const STREAM_POINTS: u64 = 20_000_000;
/// Frames of a path that is streamed.
const STREAM_FRAMES: u32 = 120;
/// Pixels of a frame.
const SIZE: [u32; 2] = [640, 360];
/// Pixels that a peer traces.
#[cfg(feature = "embree")]
const PEER_SIZE: [u32; 2] = [1920, 1080];
/// Frames of a path that scaling is measured by, and the paths.
const SCALING_FRAMES: u32 = 30;
/// Times that they are drawn, a part of them each.
const SCALING_ROUNDS: u32 = 3;
const SCALING_PATHS: [PathKind; 3] = [PathKind::Rest, PathKind::Turn, PathKind::Grazing];

/// Arguments of `lasray bench`.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = HELP)]
pub struct Args {
    /// Files, folders, @lists and patterns; none: a synthetic town
    #[arg(value_name = "INPUT")]
    inputs: Vec<OsString>,

    /// Frames: all seven configurations of the thesis' Table 4.1
    #[arg(long, conflicts_with = "grid", help_heading = "Parts")]
    table: bool,
    /// Reading and binning beside decoding alone, warm and cold
    #[arg(long, help_heading = "Parts")]
    ingest: bool,
    /// Time until all is loaded: the thesis' 16 threads beside our pipeline
    #[arg(long, help_heading = "Parts")]
    load: bool,
    /// What four times the cells under the same picture cost, and four times the points
    #[arg(long, help_heading = "Parts")]
    scaling: bool,
    /// Intel Embree on the same cells and rays (needs a build with the feature `embree`)
    #[arg(long, help_heading = "Parts")]
    peer: bool,

    /// Frames while files stream in beside the same frames with everything there: whether any waits, and how
    /// much longer they take
    #[arg(long, help_heading = "Parts")]
    stream: bool,

    /// Configurations GRID/LEVELS [default: 32/8]
    #[arg(long, value_delimiter = ',', value_parser = config, help_heading = "Frames", value_name = "G/L,…")]
    grid: Vec<Config>,
    /// Camera paths [default: all, with --stream those that move; none beside --path]
    #[arg(long, value_enum, value_delimiter = ',', help_heading = "Frames", value_name = "NAME,…")]
    paths: Vec<PathKind>,
    /// Camera path files to fly, see docs/camera-paths.md
    #[arg(long, help_heading = "Frames", value_name = "FILE")]
    path: Vec<PathBuf>,
    /// Frames of each path to draw, spread evenly over it [default: all, with --stream 120]; but for --stream,
    /// sections stream in all of them
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..), help_heading = "Frames", value_name = "N")]
    frames: Option<u32>,
    /// Width and height in pixels [default: 640x360, with --peer alone 1920x1080]
    #[arg(long, value_parser = size, help_heading = "Frames", value_name = "WxH")]
    size: Option<[u32; 2]>,
    /// Pixels a workgroup of the thesis' pipeline covers: an upright strip [default: the fastest of 1x64, 8x32 and 8x8,
    /// by a short run]
    #[arg(long, value_parser = size, help_heading = "Frames", value_name = "WxH")]
    strip: Option<[u32; 2]>,

    /// Numbers of threads that read, `all`: one a core [default: --ingest 1,all, --load all]
    #[arg(long, value_delimiter = ',', value_parser = number_of_threads, help_heading = "Reading", value_name = "N,…")]
    threads: Vec<Threads>,

    /// Light
    #[arg(long, value_enum, default_value = "lit", requires = "stream", help_heading = "Streaming")]
    shade: Shade,
    /// Times that each path is flown both ways, in turn
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..), requires = "stream", help_heading = "Streaming", value_name = "N")]
    runs: u32,
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
    format: Vec<Kind>,
    /// Bytes of device memory for sections, at most 7/8 of what is free there
    #[arg(long, default_value = "1GiB", value_parser = bytes, requires = "stream", help_heading = "Streaming", value_name = "BYTES")]
    device_memory: u64,
    /// Bytes of host memory for sections
    #[arg(long, default_value = "2GiB", value_parser = bytes, requires = "stream", help_heading = "Streaming", value_name = "BYTES")]
    host_memory: u64,

    /// Side of a cell, CRS units
    #[arg(long, default_value_t = 0.25, value_parser = positive, help_heading = "Data")]
    cell: f64,
    /// Points of synthetic data; 500k and 2M are understood [default: 2 a cell of 4096x4096; for
    /// --ingest, --scaling and --stream 20M, for --load 4M]
    #[arg(long, value_parser = count, help_heading = "Data")]
    points: Option<u64>,
    /// Which town, which random path
    #[arg(long, default_value_t = 1, help_heading = "Data")]
    seed: u64,
    /// Neither use nor keep synthetic files, and compiled programs, in the user's cache folder
    #[arg(long, help_heading = "Data")]
    no_cache: bool,
    #[command(flatten)]
    placement: PlacementArgs,

    /// Write all figures there, - for standard output; the tables go to standard error then, with --quiet nowhere
    #[arg(long, help_heading = "Output", value_name = "FILE")]
    json: Option<Target>,
    /// Draw the frames' times as bars; - as for --json
    #[arg(long, help_heading = "Output", value_name = "FILE.svg")]
    plot: Option<Target>,
    /// No progress
    #[arg(short, long, help_heading = "Output")]
    quiet: bool,

    /// Device to trace on, by its number in `lasray info --devices`
    #[arg(long, help_heading = "Device")]
    device: Option<usize>,
}

const HELP: &str = "\
Without a part: frames. Both pipelines trace the same cells along the same paths; the land repeats without end.
Times are device timestamps where the device has them; docs/performance.md says what is measured and how.

--stream: each path is flown from nothing, frame upon frame, while threads read the files; then what all of its
cameras want is fetched, reading stops, and the same frames are drawn twice more. All in turn, --runs times; the ratio
is the median of those of the runs in which the last two flights are alike, the other figures are over all frames. The fast path goes back and forth over
the data, 256 cells a frame. Shaders are compiled before.

Ctrl-C and, on Unix, SIGTERM end it after the frame or run at hand, with tables, --json and --plot of all that was
measured whole until then; a second one ends it at once.

Exit codes: 0 done; 1 failed, stopped, a frame that waited for streaming, or pictures that differ in more than 0.1 % of
the pixels; 2 wrong arguments.
";

/// Files of a synthetic town.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Kind {
    /// Records as they are.
    Las,
    /// Compressed.
    Laz,
}

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Kind::Las => "las",
            Kind::Laz => "laz",
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
struct Threads(u32);

fn number_of_threads(text: &str) -> Result<Threads, String> {
    let number = match text.trim() {
        "all" => Some(load::threads() as u32),
        text => text.parse().ok().filter(|n| (1..=1024).contains(n)),
    };
    number.map(Threads).ok_or_else(|| format!("'{text}' is not a number of threads from 1 to 1024, or all"))
}

static STOP: AtomicBool = AtomicBool::new(false);

/// Measures.
pub fn run(args: Args, problems: &mut Problems) -> anyhow::Result<Outcome> {
    let usage = |e: &dyn std::fmt::Display| anyhow::Error::from(UsageError(e.to_string()));
    let files = args.path.iter().map(|file| {
        let path = CameraPath::read(file).map_err(|e| usage(&e))?;
        let stem = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let name = path.name().map_or(stem, str::to_owned);
        Ok(path.named(name))
    });
    let files = files.collect::<anyhow::Result<Vec<_>>>()?;
    let found = inputs::expand(&args.inputs);
    let mut protected = Protected::of(&found);
    args.path.iter().for_each(|path| protected.add(path));
    let json = args.json.iter().map(|to| ("--json", to));
    check_targets(&protected, [], json.chain(args.plot.iter().map(|to| ("--plot", to))))?;
    if args.peer && cfg!(not(feature = "embree")) {
        return Err(usage(&"--peer: this build is without Embree (cargo build --features embree)"));
    }
    let parts = args.ingest || args.load || args.scaling || args.peer || args.stream;
    // What chooses frames for --scaling and --stream too asks for none of its own.
    let chosen = !args.grid.is_empty() || !args.paths.is_empty() && !args.stream;
    let draws = !parts || args.table || !files.is_empty() && !args.stream || chosen && !args.scaling;
    if args.scaling && args.grid.first().is_some_and(|config| config.levels < 2) {
        return Err(usage(&"--scaling: a configuration of at least two levels is needed"));
    }
    if args.plot.is_some() && !draws {
        return Err(usage(&"--plot: no frames are measured"));
    }
    if !args.threads.is_empty() && !args.ingest && !args.load {
        return Err(usage(&"--threads: only --ingest and --load take it"));
    }
    let cache = if args.no_cache { None } else { Cache::of_user() };
    let cache = cache.map(|cache| cache.folder().to_owned());
    let gpu = Gpu::new(&GpuOptions { device: args.device, cache: cache.clone(), ..Default::default() })
        .map_err(|e| match e {
            GpuError::NoSuchDevice { .. } => usage(&e),
            e => e.into(),
        })?;
    let size = args.size.unwrap_or(SIZE);
    check_size(&gpu, size).map_err(|e| usage(&e))?;
    let most = gpu.limits().workgroup_size;
    if args.strip.is_some_and(|[x, y]| x.saturating_mul(y) > most) {
        return Err(usage(&format!("--strip: the device's workgroups have at most {most} invocations")));
    }
    let stop = || {
        if STOP.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    };
    crate::stop::on_request(stop)?;

    let settings = json!({
        "inputs": args.inputs.iter().map(|i| i.to_string_lossy()).collect::<Vec<_>>(),
        "size": size,
        "strip": args.strip,
        "cell": args.cell,
        "points": args.points,
        "seed": args.seed,
        "frames": args.frames,
        "shade": args.stream.then(|| format!("{:?}", args.shade).to_lowercase()),
        "runs": args.stream.then_some(args.runs),
        "device_memory": args.stream.then_some(args.device_memory),
        "host_memory": args.stream.then_some(args.host_memory),
    });
    let mut report = Report::new(&gpu.info().name, &gpu.info().driver, settings);
    problems.look_at(&found);
    let mut harness =
        Harness { args: &args, found: &found, size, cache, gpu: &gpu, report: &mut report, problems };
    let mut result = Ok(());
    if draws {
        result = harness.frames(files.clone());
    }
    // Between parts, too.
    let go_on = |result: anyhow::Result<()>| {
        if STOP.load(Ordering::Relaxed) { result.and(Err(Stopped.into())) } else { result }
    };
    result = go_on(result);
    if args.stream && result.is_ok() {
        result = go_on(harness.stream(files));
    }
    if args.ingest && result.is_ok() {
        result = go_on(harness.ingest());
    }
    if args.load && result.is_ok() {
        result = go_on(harness.load());
    }
    if args.scaling && result.is_ok() {
        result = go_on(harness.scaling());
    }
    #[cfg(feature = "embree")]
    if args.peer && result.is_ok() {
        result = go_on(harness.peer());
    }
    // What was measured before an error or the wish to stop is worth its file.
    report.compare();
    if let Err(error) = &result {
        report.stopped = error.is::<Stopped>();
        problems.blame(&error.to_string());
    }
    // What no part has printed.
    let _ = problems.finish(!args.quiet, &mut std::io::stderr().lock());
    match [&args.json, &args.plot].contains(&&Some(Target::Stdout)) {
        true if args.quiet => {}
        true => eprint!("{}", report.table()),
        false => print(&report.table()).context("cannot write to standard output")?,
    }
    if let Some(to) = &args.json {
        to.write(&report.json()?, &protected)?;
    }
    if let Some(to) = &args.plot
        && (result.is_ok() || !report.rows.is_empty())
    {
        to.write(&plot::svg(&report)?, &protected)?;
    }
    result?;
    let waits: u64 = report.stream.iter().map(|row| row.waits).sum();
    anyhow::ensure!(waits == 0, "frames waited for streaming {waits} times");
    let differ = report.rows.iter().filter_map(|row| row.differ).fold(0.0, f64::max);
    anyhow::ensure!(
        differ <= MOST_DIFFER,
        "pictures of the two pipelines differ in {:.2} % of the pixels",
        100.0 * differ
    );
    Ok(Outcome::Done)
}

/// The options of reading.
fn load_options(args: &Args) -> LoadOptions {
    LoadOptions {
        cell: Some(args.cell),
        placement: args.placement.options(),
        rgb_bits: None,
        // Nothing is coarsened: cells are what is compared.
        budget: Budget { host_bytes: u64::MAX, device_bytes: u64::MAX },
        cache: None,
        quiet: args.quiet,
    }
}

/// What the inputs hold, or a town, in cells of `cell`.
fn world(
    args: &Args,
    found: &Inputs,
    [cell, widest]: [f64; 2],
    problems: &mut Problems,
) -> anyhow::Result<(World, Fit)> {
    let options = LoadOptions { cell: Some(cell), ..load_options(args) };
    let loaded = if args.inputs.is_empty() {
        let points = args.points.unwrap_or(TOWN_POINTS);
        world::town(args.seed, points, [args.cell, widest], &options, problems)
    } else {
        load::paths(&found.files, &options, problems)
    };
    let _ = problems.finish(!args.quiet, &mut std::io::stderr().lock());
    let loaded = loaded.map_err(usage_of_load)?;
    let base = loaded.about.base;
    Ok((World::of(loaded)?, base))
}

/// What is run, and where it is written down.
struct Harness<'a> {
    args: &'a Args,
    found: &'a Inputs,
    size: [u32; 2],
    /// The user's cache folder, if it is to be used.
    cache: Option<PathBuf>,
    gpu: &'a Gpu,
    report: &'a mut Report,
    problems: &'a mut Problems,
}

impl Harness<'_> {
    fn say(&self, what: std::fmt::Arguments) {
        if !self.args.quiet {
            eprintln!("{what}");
        }
    }

    /// An error once the program was asked to end.
    fn check(&self) -> Result<(), Stopped> {
        if STOP.load(Ordering::Relaxed) { Err(Stopped) } else { Ok(()) }
    }

    fn world(&mut self, cell: f64, widest: f64) -> anyhow::Result<(World, Fit)> {
        let world = world(self.args, self.found, [cell, widest], self.problems)?;
        self.check()?;
        Ok(world)
    }

    /// Both pipelines along all paths.
    fn frames(&mut self, files: Vec<CameraPath>) -> anyhow::Result<()> {
        let args = self.args;
        let configs = match (args.table, &args.grid[..]) {
            (true, _) => Config::ALL.to_vec(),
            (false, []) => vec![Config { grid: 32, levels: 8 }],
            (false, chosen) => chosen.to_vec(),
        };
        let kinds = match &args.paths[..] {
            [] if files.is_empty() => PathKind::ALL.to_vec(),
            chosen => chosen.to_vec(),
        };
        let (world, base) = self.world(args.cell, args.cell)?;
        let [width, depth] = world.cells();
        self.say(format_args!("{width} x {depth} cells, repeated without end"));
        let files = files.into_iter().map(|path| {
            let placed = path.placed(|v| base.place(v));
            let placed = placed.map_err(|e| UsageError(format!("camera path: {e}")))?;
            if frames::fits(&world, &placed) {
                Ok(placed)
            } else {
                Err(UsageError("camera path: it leads too far from the data".to_owned()))
            }
        });
        let files = files.collect::<Result<Vec<_>, _>>()?;
        for config in configs {
            let mut thesis = self.thesis(config)?;
            let stage = frames::stage(&world, config);
            let built_in = kinds.iter().map(|kind| kind.path(&stage, args.seed));
            let paths = built_in.collect::<Result<Vec<_>, _>>()?;
            let paths: Vec<_> = paths.iter().chain(&files).collect();
            if let (Some(thesis), Some(path)) = (&mut thesis, paths.first()) {
                self.choose_strip(&world, config, path, thesis)?;
            }
            let mut pool_fits = true;
            for path in paths {
                self.fly(&world, config, path, &mut thesis, &mut pool_fits)?;
            }
        }
        Ok(())
    }

    /// The pipeline of the thesis; `None`: too large, which is written down.
    fn thesis(&mut self, config: Config) -> anyhow::Result<Option<Thesis>> {
        let Config { grid, levels } = config;
        // Sections, the mapped buffer, and, where the device's memory is the host's, what is copied from it.
        let need = Thesis::host_bytes(config) + 2 * config.bytes();
        let reason = match bench::free_bytes() {
            Some(free) if need > free => format!("it needs {need} bytes of host memory, {free} are free"),
            _ => match Thesis::new(self.gpu, config, self.size, self.args.strip.unwrap_or(STRIPS[0])) {
                Ok(thesis) => return Ok(Some(thesis)),
                Err(error) => {
                    let error = anyhow::Error::from(error);
                    if !bench::is_too_large(&error) {
                        return Err(error);
                    }
                    error.to_string()
                }
            },
        };
        self.say(format_args!("{grid}/{levels} thesis: not run: {reason}"));
        self.report.skipped.push(Skipped { grid, levels, pipeline: Pipeline::Thesis, reason });
        Ok(None)
    }

    /// Without `--strip`: the fastest one.
    fn choose_strip(
        &self,
        world: &World,
        config: Config,
        path: &CameraPath,
        thesis: &mut Thesis,
    ) -> anyhow::Result<()> {
        if self.args.strip.is_some() {
            return Ok(());
        }
        let most = self.gpu.limits().workgroup_size;
        let strips: Vec<_> = STRIPS.into_iter().filter(|[x, y]| x * y <= most).collect();
        let best = frames::best_strip(self.gpu, world, config, path, thesis, self.size, &strips)?;
        if let Some([x, y]) = best {
            self.say(format_args!("{}/{} thesis: strips of {x}x{y}", config.grid, config.levels));
        }
        Ok(())
    }

    /// One path under one configuration.
    fn fly(
        &mut self,
        world: &World,
        config: Config,
        path: &CameraPath,
        thesis: &mut Option<Thesis>,
        pool_fits: &mut bool,
    ) -> anyhow::Result<()> {
        let args = self.args;
        let Config { grid, levels } = config;
        let name = path.name().unwrap_or("path");
        let frames = args.frames.unwrap_or(path.frames()).min(path.frames());
        let options =
            Options { size: self.size, frames, rounds: frames::ROUNDS, quiet: args.quiet, stop: &STOP };
        let rays = u64::from(self.size[0]) * u64::from(self.size[1]);
        let strip = thesis.as_ref().map(Thesis::strip);
        let flight = frames::run(self.gpu, world, config, path, *pool_fits, thesis.as_mut(), &options)?;
        let mut rows = Vec::new();
        let mut differ = None;
        if let Some(run) = flight.thesis {
            differ = run.differ;
            rows.push(Row { strip, ..thesis_row(&run, config, name, rays) });
        }
        match flight.pool {
            Some(Ok(run)) => rows.push(Row { differ, ..pool_row(&run, config, name, rays) }),
            Some(Err(error)) if bench::is_too_large(&error) => {
                let reason = format!("{name}: {error}");
                self.say(format_args!("{grid}/{levels} pool: not run: {reason}"));
                self.report.skipped.push(Skipped { grid, levels, pipeline: Pipeline::Pool, reason });
                *pool_fits = false;
            }
            Some(Err(error)) => return Err(error),
            None => {}
        }
        let clock_wanders = self.gpu.info().kind != DeviceKind::Cpu;
        rows.iter_mut().for_each(|row| row.clock_wanders = clock_wanders);
        for row in &rows {
            let [prepare, copy, trace, ..] = row.means().map(|v| v.unwrap_or(f64::NAN));
            let who = row.pipeline.name();
            self.say(format_args!(
                "{grid}/{levels} {name:8} {who:6} prepare {prepare:.3} copy {copy:.3} trace {trace:.3} ms"
            ));
        }
        self.report.rows.extend(rows);
        Ok(())
    }

    /// The inputs one by one.
    fn files(&self) -> anyhow::Result<Vec<PathBuf>> {
        match self.found.failed.first() {
            Some(_) => anyhow::bail!("an input cannot be used: files are timed all or none"),
            None => Ok(self.found.files.clone()),
        }
    }

    /// Frames while files stream in, and with everything there.
    fn stream(&mut self, files: Vec<CameraPath>) -> anyhow::Result<()> {
        let args = self.args;
        let options = stream::Options {
            size: self.size,
            frames: args.frames.unwrap_or(STREAM_FRAMES),
            runs: args.runs,
            shade: args.shade,
            device_bytes: self.gpu.bytes_for_sections(args.device_memory),
            host_bytes: args.host_memory,
            load: LoadOptions { quiet: true, ..load_options(args) },
            quiet: args.quiet,
            stop: &STOP,
        };
        let kinds = match &args.paths[..] {
            [] if files.is_empty() => &stream::PATHS[..],
            chosen => chosen,
        };
        let mut towns = self.towns();
        let mut data = Vec::new();
        match &args.inputs[..] {
            [] => {
                let points = args.points.unwrap_or(STREAM_POINTS);
                let set = |kind: &Kind| Set {
                    name: "town",
                    format: synth::Format::Seven,
                    compress: *kind == Kind::Laz,
                    is_tiled: true,
                    seed: args.seed,
                    points,
                };
                let sets: Vec<_> = args.format.iter().map(set).collect();
                let files = towns.files(&sets, &mut |what| self.say(format_args!("{what}")))?;
                data.extend(args.format.iter().map(|kind| kind.name().to_owned()).zip(files));
            }
            inputs => {
                let name = Path::new(&inputs[0]).file_stem().unwrap_or_default();
                data.push((name.to_string_lossy().into_owned(), self.files()?));
            }
        }
        for (name, inputs) in data {
            let case = stream::Case::open(self.gpu, name, inputs, &options, self.problems);
            let _ = self.problems.finish(!args.quiet, &mut std::io::stderr().lock());
            let mut case = case.map_err(|error| match error.downcast() {
                Ok(error) => usage_of_load(error),
                Err(error) => error,
            })?;
            let mut paths = Vec::new();
            for &kind in kinds {
                paths.push(case.path(kind, args.seed)?);
            }
            for path in &files {
                let placed = path.placed(|v| case.base().place(v));
                paths.push(placed.map_err(|e| UsageError(format!("camera path: {e}")))?);
            }
            self.say(format_args!("{} points, compiling", case.points()));
            let first = paths[0].camera(0)?;
            case.warm_up(&first)?;
            for path in &paths {
                let row = case.fly(path, &mut |what| self.say(format_args!("{what}")))?;
                self.say(format_args!(
                    "{} {}: p95 {:.1} ms streaming, {:.1} ms resident; {} waits",
                    row.data, row.path, row.streaming.frame_ms.p95, row.resident.frame_ms.p95, row.waits
                ));
                self.report.stream.push(row);
                self.check()?;
            }
            case.take_errors().iter().for_each(|error| self.problems.error(error));
        }
        Ok(())
    }

    /// The thesis' loading and ours.
    fn load(&mut self) -> anyhow::Result<()> {
        let args = self.args;
        let mut files = self.files()?;
        let mut towns = self.towns();
        if files.is_empty() {
            let set = Set {
                name: "town",
                format: synth::Format::Three,
                compress: false,
                is_tiled: false,
                seed: args.seed,
                points: args.points.unwrap_or(LOAD_POINTS),
            };
            let made = towns.files(&[set], &mut |what| self.say(format_args!("{what}")))?;
            files.extend(made.into_iter().flatten());
        }
        let threads = if args.threads.is_empty() { vec![load::threads() as u32] } else { self.threads() };
        for file in files {
            let mut say = |what: &str| self.say(format_args!("{what}"));
            let rows = loading::run(self.gpu, &file, args.cell, LOAD_RUNS, &threads, &mut say, &STOP)?;
            self.report.load.extend(rows);
            self.check()?;
        }
        Ok(())
    }

    /// Cells of twice the side and of `--cell`: the same data, the same window in units, the same cameras. Then
    /// files of a quarter of the points and of all.
    fn scaling(&mut self) -> anyhow::Result<()> {
        let args = self.args;
        let fine = args.grid.first().copied().unwrap_or(Config { grid: 32, levels: 8 });
        let coarse = Config { levels: fine.levels - 1, ..fine };
        let kinds = if args.paths.is_empty() { &SCALING_PATHS[..] } else { &args.paths };
        let frames = args.frames.unwrap_or(SCALING_FRAMES);
        let frames = frames.div_ceil(SCALING_ROUNDS);
        let options = Options { size: self.size, frames, rounds: 1, quiet: args.quiet, stop: &STOP };
        let mut sides = Vec::new();
        for (config, cell) in [(coarse, 2.0 * args.cell), (fine, args.cell)] {
            let (world, _) = self.world(cell, 2.0 * args.cell)?;
            sides.push((world, config, self.thesis(config)?));
        }
        let stage = frames::stage(&sides[0].0, coarse);
        let paths: Vec<_> =
            kinds.iter().map(|kind| kind.path(&stage, args.seed)).collect::<Result<_, _>>()?;
        for (world, config, thesis) in &mut sides {
            if let (Some(thesis), Some(path)) = (thesis, paths.first()) {
                self.choose_strip(world, *config, path, thesis)?;
            }
        }
        let cells = [coarse, fine].map(|config| f64::from(config.side()).powi(2));
        // In turn, so that what else the machine does is the same for both.
        for path in &paths {
            // [thesis, pool], coarse and fine.
            let mut times = [const { [const { Vec::new() }; 2] }; 2];
            for round in 1..=SCALING_ROUNDS {
                self.say(format_args!(
                    "scaling: {}, {round} of {SCALING_ROUNDS}",
                    path.name().unwrap_or("path")
                ));
                // A short film: what streams in meanwhile is not asked for.
                for (step, (world, config, thesis)) in sides.iter_mut().enumerate() {
                    let flight =
                        frames::run(self.gpu, world, *config, path, true, thesis.as_mut(), &options)?;
                    if let Some(pool) = flight.pool {
                        let pool = pool?;
                        times[1][step].extend(trace_ms(&pool.traced, &pool.drawn));
                    }
                    if let Some(thesis) = flight.thesis {
                        times[0][step].extend(trace_ms(&thesis.traced, &thesis.drawn));
                    }
                }
            }
            for (pipeline, times) in [Pipeline::Thesis, Pipeline::Pool].into_iter().zip(times) {
                let medians = times.map(|times| Stat::of(times).map(|stat| stat.median));
                let [Some(less), Some(more)] = medians else { continue };
                self.report.scaling.push(ScalingRow {
                    what: format!("trace, {}, {}", pipeline.name(), path.name().unwrap_or("path")),
                    of: "cells".to_owned(),
                    amount: cells,
                    ms: [less, more],
                    ratio: more / less,
                });
            }
        }
        if !args.inputs.is_empty() {
            return Ok(());
        }
        let all = args.points.unwrap_or(INGEST_POINTS);
        let mut read = Vec::new();
        for points in [(all / 4).max(1), all] {
            let options = IngestOptions {
                points,
                files: Vec::new(),
                cold: false,
                runs: LOAD_RUNS,
                threads: vec![load::threads() as u32],
                ..self.ingest_options()?
            };
            let mut rows = Vec::new();
            ingest::run(&options, &mut |what| self.say(format_args!("{what}")), &STOP, &mut rows)?;
            read.push(rows);
        }
        for (less, more) in read[0].iter().zip(&read[1]) {
            let rows = [less, more];
            let ms = rows.map(|row| row.points as f64 / row.total_mpts_s / 1e3);
            self.report.scaling.push(ScalingRow {
                what: format!("read and binned, {}, {} threads", less.file, less.threads),
                of: "points".to_owned(),
                amount: rows.map(|row| row.points as f64),
                ms,
                ratio: ms[1] / ms[0],
            });
        }
        Ok(())
    }

    /// Embree.
    #[cfg(feature = "embree")]
    fn peer(&mut self) -> anyhow::Result<()> {
        let args = self.args;
        let (world, _) = self.world(args.cell, args.cell)?;
        let size = args.size.unwrap_or(PEER_SIZE);
        check_size(self.gpu, size)?;
        let mut say = |what: &str| self.say(format_args!("{what}"));
        self.report.peer = bench::peer::run(self.gpu, &world, size, &mut say)?;
        Ok(())
    }

    /// Numbers of threads that were asked for, each once.
    fn threads(&self) -> Vec<u32> {
        let mut threads = Vec::new();
        for &Threads(number) in &self.args.threads {
            if !threads.contains(&number) {
                threads.push(number);
            }
        }
        threads
    }

    /// Files that are made.
    fn towns(&self) -> Towns<'static> {
        Towns::new(self.cache.as_deref(), self.args.quiet, &STOP)
    }

    fn ingest_options(&self) -> anyhow::Result<IngestOptions> {
        let args = self.args;
        Ok(IngestOptions {
            seed: args.seed,
            points: args.points.unwrap_or(INGEST_POINTS),
            kept: self.cache.clone(),
            quiet: args.quiet,
            files: self.files()?,
            cell: Some(args.cell),
            ..IngestOptions::default()
        })
    }

    /// Reading and binning.
    fn ingest(&mut self) -> anyhow::Result<()> {
        let mut options = self.ingest_options()?;
        if !self.args.threads.is_empty() {
            options.threads = self.threads();
        }
        let mut rows = Vec::new();
        let result = ingest::run(&options, &mut |what| self.say(format_args!("{what}")), &STOP, &mut rows);
        self.report.ingest = rows;
        result
    }
}

fn stat(times: &[FrameTimes], of: impl Fn(&FrameTimes) -> f64) -> Option<Stat> {
    // A sum of nothing is -0.
    Stat::of(times.iter().map(|t| of(t) + 0.0).collect())
}

/// Device times of pictures, ms: at steady clocks, or, where the device has none, as they were drawn.
fn trace_ms(traced: &Traced, drawn: &[FrameTimes]) -> Vec<f64> {
    if traced.all.is_empty() {
        return drawn.iter().map(|t| t.trace_ms).collect();
    }
    Traced::medians(&traced.all)
}

/// What both pipelines have: streaming over `streamed` frames, others over `drawn` ones, tracing over `traced` ones.
fn row(
    pipeline: Pipeline,
    config: Config,
    path: &str,
    rays: u64,
    [streamed, drawn]: [&[FrameTimes]; 2],
    traced: &Traced,
) -> Row {
    let repeats = Repeats::sum(&traced.all);
    let passes = traced.passes.iter();
    let passes = passes.filter_map(|(name, f)| Some(((*name).to_owned(), Stat::of(Traced::medians(f))?)));
    Row {
        passes_ms: passes.collect(),
        spread: repeats.spread(),
        steady: repeats.is_steady(),
        repeats,
        frames: drawn.len() as u32,
        rays,
        prepare_ms: stat(streamed, |t| t.prepare_ms),
        copy_ms: stat(streamed, |t| t.copy_ms),
        copy_bytes: stat(streamed, |t| t.copy_bytes as f64),
        trace_ms: Stat::of(trace_ms(traced, drawn)),
        trace_wall_ms: stat(drawn, |t| t.trace_wall_ms),
        total_ms: stat(drawn, |t| t.total_ms),
        ..Row::new(pipeline, config.grid, config.levels, path)
    }
}

fn thesis_row(run: &ThesisRun, config: Config, path: &str, rays: u64) -> Row {
    row(Pipeline::Thesis, config, path, rays, [&run.drawn; 2], &run.traced)
}

/// Streaming over every frame, tracing over those that were drawn.
fn pool_row(run: &PoolRun, config: Config, path: &str, rays: u64) -> Row {
    let both = row(Pipeline::Pool, config, path, rays, [&run.stream, &run.drawn], &run.traced);
    let steps = run.steps_per_ray();
    Row {
        table_ms: stat(&run.drawn, |t| t.table_ms),
        wait_ms: stat(&run.stream, |t| t.wait_ms),
        missing_sections: Some(run.missing as u64),
        steps_per_ray: Some(steps),
        ns_per_step: both.trace_ms.as_ref().map(|t| t.median * 1e6 / (rays as f64 * steps)),
        ..both
    }
}
