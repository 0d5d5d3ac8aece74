//! What a benchmark found: as JSON for programs, as tables for people.

use super::steady::Repeats;
use crate::output::Signed;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::ser::{Formatter, PrettyFormatter};
use std::collections::BTreeMap;
use std::fmt::{self, Write as _};
use std::io::{self, Write};

/// Commit that this program was built from, with `-dirty` where files were changed; `unknown` in a debug build and in
/// one from a package.
pub const COMMIT: &str = match option_env!("LASRAY_COMMIT") {
    Some(commit) => commit,
    None => "unknown",
};

/// Numbers that were measured one by one, and what they come to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stat {
    /// Sum over count.
    pub mean: f64,
    /// Half are at or below it.
    pub median: f64,
    /// 95 % are at or below it.
    pub p95: f64,
    /// Largest.
    pub max: f64,
    /// In the order in which they were measured.
    pub samples: Vec<f64>,
}

impl Stat {
    /// Of what is finite among `samples`; `None` if nothing is: a stage that does not exist.
    pub fn of(mut samples: Vec<f64>) -> Option<Stat> {
        samples.retain(|s| s.is_finite());
        let mut sorted = samples.clone();
        sorted.sort_by(f64::total_cmp);
        let max = *sorted.last()?;
        let mean = samples.iter().sum::<f64>() / samples.len() as f64;
        Some(Stat { mean, median: percentile(&sorted, 0.5), p95: percentile(&sorted, 0.95), max, samples })
    }
}

/// `share` of the way through `sorted`, between two neighbours if need be. At least one number.
fn percentile(sorted: &[f64], share: f64) -> f64 {
    let at = share * (sorted.len() - 1) as f64;
    let (low, high) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    low + (high - low) * at.fract()
}

/// Which way from sections to a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Pipeline {
    /// As in the thesis: all of the window is prepared and copied for each frame.
    Thesis,
    /// Sections stay on the device; what is new is copied beside tracing.
    Pool,
}

impl Pipeline {
    /// In the order of reports.
    pub const ALL: [Pipeline; 2] = [Pipeline::Thesis, Pipeline::Pool];

    /// In reports.
    pub fn name(self) -> &'static str {
        match self {
            Pipeline::Thesis => "thesis",
            Pipeline::Pool => "pool",
        }
    }
}

/// One path flown through one configuration by one pipeline. A stage that does not exist is `None`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Which pipeline.
    pub pipeline: Pipeline,
    /// Sections along a side of the window.
    pub grid: u32,
    /// Levels of a section's pyramid.
    pub levels: u32,
    /// Name of the camera path.
    pub path: String,
    /// Frames measured.
    pub frames: u32,
    /// Rays a frame.
    pub rays: u64,
    /// Host: section buffers made ready, ms a frame.
    pub prepare_ms: Option<Stat>,
    /// Copied to the device, ms a frame.
    pub copy_ms: Option<Stat>,
    /// Copied to the device, bytes a frame.
    pub copy_bytes: Option<Stat>,
    /// Traversal by the device's clock, ms a frame.
    pub trace_ms: Option<Stat>,
    /// Traversal from submit to seen done, ms a frame.
    pub trace_wall_ms: Option<Stat>,
    /// All of the frame, ms.
    pub total_ms: Option<Stat>,
    /// Section table built, ms a frame.
    #[serde(default)]
    pub table_ms: Option<Stat>,
    /// Waited for what was not there yet, ms a frame.
    #[serde(default)]
    pub wait_ms: Option<Stat>,
    /// Sections that were to be seen and were not there, over all frames.
    #[serde(default)]
    pub missing_sections: Option<u64>,
    /// Traversal steps a ray.
    #[serde(default)]
    pub steps_per_ray: Option<f64>,
    /// Traversal time a step.
    #[serde(default)]
    pub ns_per_step: Option<f64>,
    /// Largest share of pixels in which a picture differs from the other pipeline's.
    #[serde(default)]
    pub differ: Option<f64>,
    /// Each pass of `trace_ms` by its name, ms a frame.
    #[serde(default)]
    pub passes_ms: BTreeMap<String, Stat>,
    /// The timed frames together, once for each time that they were timed: see [`super::steady`].
    #[serde(default)]
    pub repeats: Repeats,
    /// By how much those differ, of the least.
    #[serde(default)]
    pub spread: Option<f64>,
    /// They are alike, and were taken at a clock that had time to rise: only then there is a ratio.
    #[serde(default)]
    pub steady: bool,
    /// The device's clock follows its load: `total_ms` is at clocks that nobody knows, and is not compared.
    #[serde(default)]
    pub clock_wanders: bool,
    /// Pixels that a workgroup of the thesis' kernel covers.
    #[serde(default)]
    pub strip: Option<[u32; 2]>,
}

/// Thesis over pool under one configuration, path by path.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ratios {
    /// Sections along a side of the window.
    pub grid: u32,
    /// Levels of a section's pyramid.
    pub levels: u32,
    /// Names of the paths that both have flown.
    pub paths: Vec<String>,
    /// Mean bytes copied a frame; `None`: the pool copies nothing.
    pub bytes: Vec<Option<f64>>,
    /// Mean time to prepare; `None`: the pool prepares nothing.
    pub prepare: Vec<Option<f64>>,
    /// Median time to trace; `None` where one of both was not steady.
    pub trace: Vec<Option<f64>>,
    /// Median of `trace`.
    pub trace_median: Option<f64>,
}

impl Row {
    /// With nothing measured.
    pub fn new(pipeline: Pipeline, grid: u32, levels: u32, path: impl Into<String>) -> Row {
        Row {
            pipeline,
            grid,
            levels,
            path: path.into(),
            frames: 0,
            rays: 0,
            prepare_ms: None,
            copy_ms: None,
            copy_bytes: None,
            trace_ms: None,
            trace_wall_ms: None,
            total_ms: None,
            table_ms: None,
            wait_ms: None,
            missing_sections: None,
            steps_per_ray: None,
            ns_per_step: None,
            differ: None,
            passes_ms: BTreeMap::new(),
            repeats: Repeats::default(),
            spread: None,
            steady: false,
            clock_wanders: false,
            strip: None,
        }
    }

    /// Means of prepare, copy, trace, total (ms) and bytes copied. Tracing by the device's clock, or, without one,
    /// by the wall's.
    pub fn means(&self) -> [Option<f64>; 5] {
        let trace = self.trace_ms.as_ref().or(self.trace_wall_ms.as_ref());
        let [prepare, copy, total, bytes] =
            [&self.prepare_ms, &self.copy_ms, &self.total_ms, &self.copy_bytes].map(Option::as_ref);
        [prepare, copy, trace, total, bytes].map(|stat| stat.map(|s| s.mean))
    }
}

/// Whether the system had a file's bytes in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Cache {
    /// It had.
    Warm,
    /// They came from the disk.
    Cold,
}

/// Says `"kind": "ingest"`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum IngestKind {
    /// Reading a file into sections.
    #[default]
    Ingest,
}

/// What one run took, seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct IngestSample {
    /// Decoding alone.
    pub decode_s: f64,
    /// From points to finished sections.
    pub total_s: f64,
    /// In positioned reads, all threads together.
    pub read_s: f64,
    /// In decoding what was read, all threads together.
    pub unpack_s: f64,
    /// In binning and finishing, all threads together.
    pub prepare_s: f64,
    /// Decoding every layer, alone.
    pub all_layers_s: Option<f64>,
}

/// One file read into sections. Rates are medians over the runs, of wall time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct IngestRow {
    /// Always the same.
    #[serde(default)]
    pub kind: IngestKind,
    /// Point format.
    pub format: u8,
    /// LAZ.
    pub compressed: bool,
    /// Name.
    pub file: String,
    /// Points read in a run.
    pub points: u64,
    /// Side of a cell, CRS units.
    #[serde(default)]
    pub cell: f64,
    /// Threads that read.
    pub threads: u32,
    /// Where the bytes were.
    pub cache: Cache,
    /// Share of the threads' time spent in reading bytes.
    pub read_share: Option<f64>,
    /// Share of it in decoding points.
    pub decode_share: Option<f64>,
    /// Share of it in binning and packing.
    pub prepare_share: Option<f64>,
    /// Decoded alone, million points a second.
    #[serde(deserialize_with = "or_nan")]
    pub decode_mpts_s: f64,
    /// Binned alone, million points a second.
    #[serde(deserialize_with = "or_nan")]
    pub prepare_mpts_s: f64,
    /// All of it, million points a second.
    #[serde(deserialize_with = "or_nan")]
    pub total_mpts_s: f64,
    /// All of it with every layer of the file decoded, million points a second.
    #[serde(default)]
    pub all_layers_mpts_s: Option<f64>,
    /// Share of the file's bytes that were never read, because nobody asked for their layers.
    #[serde(default)]
    pub skipped_bytes_share: Option<f64>,
    /// Run by run.
    #[serde(default)]
    pub samples: Vec<IngestSample>,
    /// What a reader must know.
    #[serde(default)]
    pub note: Option<String>,
}

/// JSON has no NaN: it is written as null.
fn or_nan<'de, D: Deserializer<'de>>(value: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(value)?.unwrap_or(f64::NAN))
}

/// A file loaded as the thesis does, and as we do: time until all of it is there. Seconds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LoadRow {
    /// Name.
    pub file: String,
    /// Points in it.
    pub points: u64,
    /// Points that lie in the thesis' 4 × 4 sections.
    pub kept: u64,
    /// Finest cells along a side of such a section.
    pub side: u32,
    /// Levels of its pyramid.
    pub levels: u32,
    /// Side of a cell, CRS units.
    pub cell: f64,
    /// Threads that read for us; the thesis has one a section.
    pub threads: u32,
    /// Whether the outer sections' threads had the lowest priority.
    pub prioritized: bool,
    /// Thesis: the four sections around the camera are full.
    pub thesis_middle_s: Stat,
    /// Thesis: all sixteen are.
    pub thesis_all_s: Stat,
    /// Ours: opened and looked at.
    pub open_s: Stat,
    /// Ours: read and binned.
    pub read_s: Stat,
    /// Ours: packed, copied and derived.
    pub upload_s: Stat,
    /// Ours: of that, the host's time to pack.
    pub pack_s: Stat,
    /// Ours: all of it.
    pub total_s: Stat,
}

/// A filter's ground beside classes that are the truth, point by point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TruthRow {
    /// File.
    pub file: String,
    /// Points that were compared: no noise, not withheld.
    pub points: u64,
    /// Share of them that is ground.
    pub ground: f64,
    /// Share of them that is told wrong.
    pub total: f64,
    /// Of the ground, what is told to be an object.
    pub type_1: f64,
    /// Of objects, what is told to be ground; `None`: there are none.
    pub type_2: Option<f64>,
    /// Cohen's; `None`: there are no objects.
    pub kappa: Option<f64>,
}

/// Ground tiles made of files.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GroundRow {
    /// Points that were gathered.
    pub points: u64,
    /// Points that had no cell or height.
    pub outside: u64,
    /// Side of a ground cell, CRS units.
    pub cell: f64,
    /// Tiles with points.
    pub tiles: u64,
    /// Threads.
    pub threads: u32,
    /// From files to tiles of stage 1, s.
    pub gather_s: f64,
    /// Time of one core from stage 1 to the ground, µs a tile cell, run by run.
    pub infer_us: Stat,
    /// Shares of the tiles' cells with measured ground, filled ground, an object, a low outlier.
    pub shares: [f64; 4],
    /// File by file, where classes are the truth.
    pub truth: Vec<TruthRow>,
}

/// What four times the work costs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScalingRow {
    /// What was done.
    pub what: String,
    /// Four times what: cells under the same picture, or points.
    pub of: String,
    /// Less and more of it.
    pub amount: [f64; 2],
    /// Median times, ms.
    pub ms: [f64; 2],
    /// Of each, how much its repeats differ, of the least; `None`: they tell nothing of a clock (points are read on CPUs).
    #[serde(default)]
    pub spreads: [Option<f64>; 2],
    /// Time over time; `None`: the times are not alike enough to be compared.
    pub ratio: Option<f64>,
}

/// A peer on the CPU and our pipeline, tracing the same rays.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PeerRow {
    /// Which peer, which scene.
    pub scene: String,
    /// Its fastest kind of query.
    pub query: String,
    /// Cells along a side.
    pub cells: u32,
    /// Rays.
    pub rays: u64,
    /// Threads of the peer.
    pub threads: u32,
    /// Seconds that the peer took to build its scene.
    pub build_s: f64,
    /// Seconds that it took to trace all rays.
    pub trace_s: Stat,
    /// Our trace, device time, ms.
    pub pool_ms: Stat,
    /// Million rays a second by medians: the peer's, ours.
    pub mrays_s: [f64; 2],
    /// How much the repeats of each differ, of the least.
    #[serde(default)]
    pub spreads: [Option<f64>; 2],
    /// Ours over the peer's; `None`: the times of one are not alike enough.
    pub ratio: Option<f64>,
    /// Share of the rays at whose end both are, within a thousandth or a cell; meshes are another surface.
    pub agree: f64,
}

/// Says `"kind": "stream"`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum StreamKind {
    /// Frames while files stream in.
    #[default]
    Stream,
}

/// Frames of a path, those of all runs one after the other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StreamFrames {
    /// All of the frame by the host's clock, ms: from the camera until its picture is seen done.
    pub frame_ms: Stat,
    /// Of it, residency: what is wanted, what has arrived, uploads and derived passes submitted, ms.
    pub tick_ms: Stat,
    /// Of it, the section table, ms.
    pub table_ms: Stat,
    /// Passes of the picture by the device's clock, ms.
    pub trace_ms: Option<Stat>,
    /// Copies and derived passes that ended in the frame, by the device's clock, ms.
    pub update_ms: Option<Stat>,
    /// Copied to the device.
    pub upload_bytes: Stat,
    /// Sections that the camera wanted.
    pub wanted: Stat,
    /// Of those, what was there, or known to be empty, when the frame was drawn.
    pub ready: Stat,
}

impl StreamFrames {
    /// Share of the wanted sections that was there: mean over the frames, and the least.
    pub fn ready_share(&self) -> [f64; 2] {
        let pairs = self.ready.samples.iter().zip(&self.wanted.samples);
        let shares: Vec<_> = pairs.map(|(r, w)| if *w > 0.0 { r / w } else { 1.0 }).collect();
        let mean = shares.iter().sum::<f64>() / shares.len() as f64;
        [mean, shares.into_iter().fold(1.0, f64::min)]
    }
}

/// A path flown while its files stream in, and with all that it wants there.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StreamRow {
    /// Always the same.
    #[serde(default)]
    pub kind: StreamKind,
    /// Name of the data.
    pub data: String,
    /// Points in it.
    pub points: u64,
    /// Side of a cell, CRS units.
    pub cell: f64,
    /// Name of the camera path.
    pub path: String,
    /// Frames of a run.
    pub frames: u32,
    /// Runs; both ways in turn.
    pub runs: u32,
    /// Pixels.
    pub size: [u32; 2],
    /// Threads that read.
    pub threads: u32,
    /// Budget of device memory, bytes.
    pub device_bytes: u64,
    /// Budget of host memory, bytes.
    pub host_bytes: u64,
    /// With nothing there at first, threads reading.
    pub streaming: StreamFrames,
    /// With everything there, nothing being read; two flights a run.
    pub resident: StreamFrames,
    /// Streaming over resident, 95th percentiles of a run's frames: median of the runs that have one.
    pub ratio_p95: Option<f64>,
    /// Run by run; `None`: its resident flights were too different.
    pub ratios: Vec<Option<f64>>,
    /// By how much the 95th percentiles of each run's two resident flights differ, of the lesser.
    #[serde(default)]
    pub spreads: Vec<f64>,
    /// Times that a frame waited for an upload: 0, or an error.
    pub waits: u64,
    /// Bytes of files read while streaming, all runs.
    pub bytes_read: u64,
    /// Streaming frames that had nothing to show yet.
    pub empty_frames: u64,
    /// Streaming frames in which cells were coarser than asked for, for lack of device memory.
    pub coarser_frames: u64,
    /// Resident frames that were not: something was missing, came, or was coarser. The budget is too small then.
    pub not_resident: u64,
}

/// Says `"kind": "layers"`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LayersKind {
    /// Other classes are shown.
    #[default]
    Layers,
}

/// Other classes are shown while everything is there: all changes, one after the other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LayersRow {
    /// Always the same.
    #[serde(default)]
    pub kind: LayersKind,
    /// Name of the data.
    pub data: String,
    /// Pixels.
    pub size: [u32; 2],
    /// Until every section on the device showed them, ms.
    pub took_ms: Stat,
    /// Until those in sight did, ms.
    pub in_sight_ms: Stat,
    /// Sections that were derived again.
    pub sections: Stat,
    /// Parts that they were derived in, beside a frame each.
    pub parts: Stat,
    /// Frames before and after, ms by the host's clock.
    pub resting_ms: Stat,
    /// Frames meanwhile.
    pub frame_ms: Stat,
    /// Each of those over the median of the frames before, or of those after if that is larger.
    pub ratios: Stat,
    /// Bytes of sections copied to the device meanwhile.
    pub section_bytes: u64,
}

/// A configuration that was not run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Skipped {
    /// Sections along a side of the window.
    pub grid: u32,
    /// Levels of a section's pyramid.
    pub levels: u32,
    /// Which pipeline.
    pub pipeline: Pipeline,
    /// Why.
    pub reason: String,
}

/// All that one call of `lasray bench` found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Name of the device.
    pub device: String,
    /// Its driver and version.
    pub driver: String,
    /// See [`COMMIT`].
    pub commit: String,
    /// What was asked for.
    #[serde(default)]
    pub settings: serde_json::Value,
    /// Frames.
    #[serde(default)]
    pub rows: Vec<Row>,
    /// Files.
    #[serde(default)]
    pub ingest: Vec<IngestRow>,
    /// What could not be run.
    #[serde(default)]
    pub skipped: Vec<Skipped>,
    /// Loading.
    #[serde(default)]
    pub load: Vec<LoadRow>,
    /// The ground of unclassified points.
    #[serde(default)]
    pub ground: Vec<GroundRow>,
    /// Four times the cells, four times the points.
    #[serde(default)]
    pub scaling: Vec<ScalingRow>,
    /// Other ray tracers.
    #[serde(default)]
    pub peer: Vec<PeerRow>,
    /// Frames while files stream in.
    #[serde(default)]
    pub stream: Vec<StreamRow>,
    /// Frames while other classes are shown.
    #[serde(default)]
    pub layers: Vec<LayersRow>,
    /// See [`Report::compare`].
    #[serde(default)]
    pub ratios: Vec<Ratios>,
    /// It was asked to end before all was measured.
    #[serde(default)]
    pub stopped: bool,
}

impl Report {
    /// An empty one of this build.
    pub fn new(device: impl Into<String>, driver: impl Into<String>, settings: serde_json::Value) -> Report {
        Report {
            device: device.into(),
            driver: driver.into(),
            commit: COMMIT.to_owned(),
            settings,
            rows: Vec::new(),
            ingest: Vec::new(),
            skipped: Vec::new(),
            load: Vec::new(),
            ground: Vec::new(),
            scaling: Vec::new(),
            peer: Vec::new(),
            stream: Vec::new(),
            layers: Vec::new(),
            ratios: Vec::new(),
            stopped: false,
        }
    }

    /// Fills `ratios` from `rows`.
    pub fn compare(&mut self) {
        let ratios = self.configurations().into_iter().map(|[grid, levels]| {
            let mut paths: Vec<String> = Vec::new();
            let [mut bytes, mut prepare, mut trace] = [const { Vec::new() }; 3];
            let of = |pipeline| {
                self.rows
                    .iter()
                    .filter(move |row| (row.pipeline, row.grid, row.levels) == (pipeline, grid, levels))
            };
            for thesis in of(Pipeline::Thesis) {
                let Some(pool) = of(Pipeline::Pool).find(|row| row.path == thesis.path) else { continue };
                let mean = |of: fn(&Row) -> &Option<Stat>| {
                    let [a, b] = [of(thesis).as_ref()?.mean, of(pool).as_ref()?.mean];
                    Some(a / b).filter(|r| r.is_finite())
                };
                paths.push(thesis.path.clone());
                bytes.push(mean(|row| &row.copy_bytes));
                prepare.push(mean(|row| &row.prepare_ms));
                let median = |row: &Row| row.trace_ms.as_ref().map(|s| s.median);
                let both = thesis.steady && pool.steady;
                let pair = median(thesis).zip(median(pool)).filter(|_| both);
                trace.push(pair.map(|(a, b)| a / b).filter(|r| r.is_finite()));
            }
            let trace_median = Stat::of(trace.iter().copied().flatten().collect()).map(|s| s.median);
            Ratios { grid, levels, paths, bytes, prepare, trace, trace_median }
        });
        self.ratios = ratios.filter(|r| !r.paths.is_empty()).collect();
    }

    /// As JSON. What is not finite becomes null.
    pub fn json(&self) -> io::Result<String> {
        let mut out = Vec::new();
        Signed::new(self)
            .serialize(&mut serde_json::Serializer::with_formatter(&mut out, Lines::default()))?;
        out.push(b'\n');
        String::from_utf8(out).map_err(io::Error::other)
    }

    /// Grid and levels of all rows, each once, in order.
    pub fn configurations(&self) -> Vec<[u32; 2]> {
        let mut all: Vec<_> = self.rows.iter().map(|row| [row.grid, row.levels]).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Mean over the paths of what [`Row::means`] says, each over the paths that have it.
    pub fn mean_of_paths(&self, pipeline: Pipeline, [grid, levels]: [u32; 2]) -> [Option<f64>; 5] {
        let rows: Vec<_> = self
            .rows
            .iter()
            .filter(|row| (row.pipeline, row.grid, row.levels) == (pipeline, grid, levels))
            .map(Row::means)
            .collect();
        std::array::from_fn(|k| mean(rows.iter().filter_map(|means| means[k])))
    }

    /// Tables for people, no line longer than 110 letters.
    pub fn table(&self) -> String {
        let mut out = String::new();
        let _ = writeln!(out, "{}, {}, commit {}", self.device, self.driver, self.commit);
        for configuration in self.configurations() {
            out.push('\n');
            self.block(&mut out, configuration);
            let here = |r: &&Ratios| [r.grid, r.levels] == configuration;
            self.ratios.iter().filter(here).for_each(|ratios| ratio_lines(&mut out, ratios));
            self.notes(&mut out, configuration);
        }
        for Skipped { grid, levels, pipeline, reason } in &self.skipped {
            let _ = writeln!(out, "\nnot run: {grid}x{grid}/{levels}, {}: {reason}", pipeline.name());
        }
        if !self.ingest.is_empty() {
            out.push('\n');
            ingest_table(&mut out, &self.ingest);
        }
        self.load.iter().for_each(|row| load_lines(&mut out, row));
        self.ground.iter().for_each(|row| ground_lines(&mut out, row));
        if !self.scaling.is_empty() {
            let _ = writeln!(out, "\n{:<44}{:<12}{:>14}{:>14}{:>10}", "scaling", "4x", "ms", "ms", "ratio");
        }
        for ScalingRow { what, of, ms, ratio, spreads, .. } in &self.scaling {
            let [less, more] = ms.map(number);
            let _ = writeln!(
                out,
                "{:<44}{of:<12}{less:>14}{more:>14}{:>10}{}",
                cut(what, 43),
                times(*ratio),
                unsteady(*ratio, *spreads)
            );
        }
        if !self.stream.is_empty() {
            out.push('\n');
            stream_table(&mut out, &self.stream);
        }
        self.layers.iter().for_each(|row| layers_lines(&mut out, row));
        for row in &self.peer {
            let [peer, pool] = row.mrays_s.map(number);
            let _ = writeln!(
                out,
                "\n{}, {} cells a side, {} rays, {} threads, {}: built in {} s, {peer} M rays/s",
                row.scene,
                row.cells,
                row.rays,
                row.threads,
                row.query,
                number(row.build_s)
            );
            let _ = writeln!(
                out,
                "  pool {pool} M rays/s: {}{}; {:.2} % of the rays end in the same place",
                times(row.ratio),
                unsteady(row.ratio, row.spreads),
                100.0 * row.agree
            );
        }
        if self.stopped {
            out.push_str("\nstopped: not everything that was asked for was measured\n");
        }
        out
    }

    /// What was late, and what differs.
    fn notes(&self, out: &mut String, configuration: [u32; 2]) {
        let here = || self.rows.iter().filter(|row| [row.grid, row.levels] == configuration);
        let strip = here().find_map(|row| row.strip);
        words(out, "thesis in strips of", strip.map(|[w, h]| format!("{w}x{h}")).into_iter());
        let names = ["wide beams", "beams", "trace", "shade"];
        let passes = here().filter(|row| row.pipeline == Pipeline::Pool).filter_map(|row| {
            let some = names.iter().filter_map(|&name| Some(number(row.passes_ms.get(name)?.median)));
            let some: Vec<_> = some.collect();
            (!some.is_empty()).then(|| format!("{} {}", row.path, some.join(" + ")))
        });
        words(out, "pool, wide beams + beams + trace, ms", passes);
        let spread = here().filter_map(|row| {
            let mark = if row.steady { "" } else { " (not steady)" };
            Some(format!("{} {} {:.1} %{mark}", row.path, row.pipeline.name(), 100.0 * row.spread?))
        });
        words(out, "times of the same frames differ by", spread);
        let late = here().filter(|row| row.missing_sections.is_some_and(|n| n > 0));
        let late = late.map(|row| format!("{} {}", row.path, row.missing_sections.unwrap_or(0)));
        words(out, "sections late", late);
        let differ = here().filter_map(|row| Some((&row.path, row.differ?)));
        words(out, "pixels that differ", differ.map(|(path, d)| format!("{path} {:.3} %", 100.0 * d)));
    }

    fn block(&self, out: &mut String, [grid, levels]: [u32; 2]) {
        let _ = writeln!(
            out,
            "{:<18}{:>16}{:>16}{:>16}{:>16}{:>20}",
            format!("{grid}x{grid}/{levels}"),
            "prepare ms",
            "copy ms",
            "trace ms",
            "total ms",
            "bytes a frame"
        );
        let names = Pipeline::ALL.map(Pipeline::name);
        let _ = write!(out, "{:<18}", "path");
        for width in [8, 8, 8, 8, 10] {
            let _ = write!(out, "{:>width$}{:>width$}", names[0], names[1]);
        }
        let _ = writeln!(out, "{:>8}", "ratio");
        let mut paths: Vec<&str> = Vec::new();
        let here = || self.rows.iter().filter(move |row| [row.grid, row.levels] == [grid, levels]);
        here().for_each(|row| {
            if !paths.contains(&row.path.as_str()) {
                paths.push(&row.path);
            }
        });
        let mut totals = Vec::new();
        for path in paths {
            let means = Pipeline::ALL.map(|pipeline| {
                let row = here().find(|row| row.path == path && row.pipeline == pipeline);
                row.map_or([None; 5], Row::means)
            });
            let pair = means[0][3].zip(means[1][3]);
            let pair = pair.filter(|_| !here().any(|row| row.path == path && row.clock_wanders));
            totals.extend(pair);
            line(out, path, means, pair.map(|(thesis, pool)| thesis / pool));
        }
        let means = Pipeline::ALL.map(|pipeline| self.mean_of_paths(pipeline, [grid, levels]));
        // Over the paths that both have flown.
        let [thesis, pool] =
            [totals.iter().map(|t| t.0).sum::<f64>(), totals.iter().map(|t| t.1).sum::<f64>()];
        line(out, "mean of the paths", means, (!totals.is_empty()).then_some(thesis / pool));
    }
}

/// `title: a, b, c`, in lines of at most 110 letters; nothing without a word.
fn words(out: &mut String, title: &str, words: impl Iterator<Item = String>) {
    let mut line = format!("{title}:");
    let (first, mut any) = (line.chars().count(), false);
    for word in words {
        if any {
            line.push(',');
        }
        if line.chars().count() + word.chars().count() > 107 && any {
            let _ = writeln!(out, "{line}");
            line = " ".repeat(first);
        }
        let _ = write!(line, " {word}");
        any = true;
    }
    if any {
        let _ = writeln!(out, "{line}");
    }
}

/// `2.00x`, or `-`.
fn times(ratio: Option<f64>) -> String {
    ratio.map_or("-".to_owned(), |ratio| number(ratio) + "x")
}

/// Why there is no ratio: how much the repeats of both sides differ.
fn unsteady(ratio: Option<f64>, spreads: [Option<f64>; 2]) -> String {
    if ratio.is_some() {
        return String::new();
    }
    let [less, more] =
        spreads.map(|spread| spread.map_or("once".to_owned(), |s| format!("{:.1} %", 100.0 * s)));
    format!(" (not steady: {less}, {more})")
}

fn ratio_lines(out: &mut String, ratios: &Ratios) {
    let each = |values: &[Option<f64>], none: &str| {
        let text = |(path, value): (&String, &Option<f64>)| {
            format!("{path} {}", value.map_or(none.to_owned(), |r| number(r) + "x"))
        };
        ratios.paths.iter().zip(values).map(text).collect::<Vec<_>>()
    };
    words(out, "thesis / pool, bytes", each(&ratios.bytes, "all").into_iter());
    words(out, "thesis / pool, prepare", each(&ratios.prepare, "all").into_iter());
    let median = ratios.trace_median.map(|m| format!("median {}x", number(m)));
    words(out, "thesis / pool, trace", each(&ratios.trace, "-").into_iter().chain(median));
}

/// One path: a pair of columns for each stage, then thesis over pool.
fn line(out: &mut String, path: &str, [thesis, pool]: [[Option<f64>; 5]; 2], ratio: Option<f64>) {
    let _ = write!(out, "{:<18}", path.chars().take(17).collect::<String>());
    for k in 0..5 {
        for value in [thesis[k], pool[k]] {
            let _ = match value {
                None => write!(out, "{:>1$}", "-", if k == 4 { 10 } else { 8 }),
                Some(bytes) if k == 4 => write!(out, "{:>10}", bytes_text(bytes)),
                Some(ms) => write!(out, "{:>8}", number(ms)),
            };
        }
    }
    let _ = writeln!(out, "{:>8}", ratio.map_or("-".to_owned(), |r| number(r) + "x"));
}

fn load_lines(out: &mut String, row: &LoadRow) {
    let s = |stat: &Stat| number(stat.median);
    let _ = writeln!(
        out,
        "\nloading {}, {} points, cells of {}: seconds until full, medians",
        cut(&row.file, 40),
        count(row.points),
        row.cell
    );
    let _ = writeln!(
        out,
        "  thesis, 16 sections of {0} x {0} cells, a thread each: {1} the middle four, {2} all{3}",
        row.side,
        s(&row.thesis_middle_s),
        s(&row.thesis_all_s),
        if row.prioritized { "" } else { " (without priorities)" }
    );
    let ratio = |stat: &Stat| number(stat.median / row.total_s.median);
    let _ = writeln!(
        out,
        "  pool, {} threads: {} all (open {}, read and bin {}, pack, copy and derive {}, packing {} of it)",
        row.threads,
        s(&row.total_s),
        s(&row.open_s),
        s(&row.read_s),
        s(&row.upload_s),
        s(&row.pack_s)
    );
    let _ = writeln!(
        out,
        "  thesis / pool: {}x to the middle four, {}x to all",
        ratio(&row.thesis_middle_s),
        ratio(&row.thesis_all_s)
    );
}

fn ground_lines(out: &mut String, row: &GroundRow) {
    let [measured, filled, object, low] = row.shares.map(|share| 100.0 * share);
    let _ = writeln!(
        out,
        "\nground: {} points in {:.2} s on {} threads to {} tiles, cells of {}; {:.3} us a tile cell of one core",
        count(row.points),
        row.gather_s,
        row.threads,
        row.tiles,
        row.cell,
        row.infer_us.median
    );
    let _ = writeln!(
        out,
        "  cells: {measured:.1} % measured, {filled:.1} % filled, {object:.1} % objects, {low:.2} % low outliers"
    );
    if row.outside > 0 {
        let _ = writeln!(out, "  {} points had no cell or height", row.outside);
    }
    if row.truth.is_empty() {
        return;
    }
    let heads = ["points", "ground", "total", "type I", "type II", "kappa"];
    let _ = write!(out, "\n{:<36}", "errors, %");
    heads.iter().for_each(|head| out.push_str(&format!("{head:>11}")));
    out.push('\n');
    let percent = |share: f64| format!("{:.2}", 100.0 * share);
    for truth in &row.truth {
        let _ = writeln!(
            out,
            "{:<36}{:>11}{:>11}{:>11}{:>11}{:>11}{:>11}",
            cut(&truth.file, 35),
            truth.points,
            percent(truth.ground),
            percent(truth.total),
            percent(truth.type_1),
            truth.type_2.map_or("-".to_owned(), percent),
            truth.kappa.map_or("-".to_owned(), percent)
        );
    }
    let mean = row.truth.iter().map(|truth| truth.total).sum::<f64>() / row.truth.len() as f64;
    let _ = writeln!(out, "{:<58}{:>11}", "mean of the files", percent(mean));
}

fn ingest_table(out: &mut String, rows: &[IngestRow]) {
    let _ = writeln!(
        out,
        "{:<24}{:<7}{:>7}{:>8}{:>6}{:>6}{:>8}{:>9}{:>8}{:>9}{:>7}{:>11}",
        "ingest, M points/s",
        "format",
        "points",
        "threads",
        "cache",
        "read",
        "decode",
        "prepare",
        "decode",
        "prepare",
        "all",
        "all layers"
    );
    let share = |s: Option<f64>| s.map_or("-".to_owned(), |s| format!("{:.0} %", 100.0 * s));
    for row in rows {
        let _ = writeln!(
            out,
            "{:<24}{:<7}{:>7}{:>8}{:>6}{:>6}{:>8}{:>9}{:>8}{:>9}{:>7}{:>11}",
            cut(&row.file, 23),
            format!("{} {}", row.format, if row.compressed { "LAZ" } else { "LAS" }),
            count(row.points),
            row.threads,
            match row.cache {
                Cache::Warm => "warm",
                Cache::Cold => "cold",
            },
            share(row.read_share),
            share(row.decode_share),
            share(row.prepare_share),
            number(row.decode_mpts_s),
            number(row.prepare_mpts_s),
            number(row.total_mpts_s),
            row.all_layers_mpts_s.map_or("-".to_owned(), number)
        );
    }
}

fn stream_table(out: &mut String, rows: &[StreamRow]) {
    let _ = writeln!(
        out,
        "{:<18}{:>7}{:>24}{:>24}{:>7}{:>21}{:>9}",
        "streaming", "", "streaming frame ms", "resident frame ms", "p95", "tick ms", "ready"
    );
    let three = "median    p95    max";
    let _ = writeln!(
        out,
        "{:<18}{:>7}{three:>24}{three:>24}{:>7}{three:>21}{:>9}",
        "data, path", "frames", "ratio", "mean min"
    );
    let stat = |s: &Stat, width: usize| {
        let each = [s.median, s.p95, s.max].map(|v| format!("{:>width$}", short(v)));
        each.concat()
    };
    for row in rows {
        let StreamRow { streaming, resident, .. } = row;
        let [mean, least] = streaming.ready_share().map(|share| 100.0 * share);
        let _ = writeln!(
            out,
            "{:<18}{:>7}{:>24}{:>24}{:>7}{:>21}{:>9}",
            cut(&format!("{} {}", row.data, row.path), 17),
            format!("{}x{}", row.runs, row.frames),
            stat(&streaming.frame_ms, 8),
            stat(&resident.frame_ms, 8),
            row.ratio_p95.map_or("-".to_owned(), |ratio| number(ratio) + "x"),
            stat(&streaming.tick_ms, 7),
            format!("{mean:.0} {least:.0} %")
        );
    }
    let name = |row: &StreamRow| format!("{} {}", row.data, row.path);
    let each = |of: &dyn Fn(&StreamRow) -> String| {
        rows.iter().map(|row| format!("{} {}", name(row), of(row))).collect::<Vec<_>>()
    };
    let uploaded = |row: &StreamRow| bytes_text(row.streaming.upload_bytes.samples.iter().sum());
    words(out, "uploaded", each(&uploaded).into_iter());
    words(out, "read", each(&|row| bytes_text(row.bytes_read as f64)).into_iter());
    let counted = |title: &str, out: &mut String, of: &dyn Fn(&StreamRow) -> u64| {
        let some = rows.iter().filter(|row| of(row) > 0);
        words(out, title, some.map(|row| format!("{} {}", name(row), of(row))));
    };
    counted("frames with nothing to show yet", out, &|row| row.empty_frames);
    counted("frames of reduced detail, for lack of device memory", out, &|row| row.coarser_frames);
    counted("frames that should have been resident and were not", out, &|row| row.not_resident);
    counted("runs without a ratio, resident flights differ by more than 10 %", out, &|row| {
        row.ratios.iter().filter(|ratio| ratio.is_none()).count() as u64
    });
    let waits: u64 = rows.iter().map(|row| row.waits).sum();
    let frames: u64 = rows.iter().map(|row| 3 * u64::from(row.runs) * u64::from(row.frames)).sum();
    let _ = writeln!(out, "frames that waited for streaming: {waits} of {frames}");
    if let Some(worst) = rows.iter().filter_map(|row| row.ratio_p95).reduce(f64::max) {
        let _ = writeln!(out, "largest ratio of 95th percentiles: {}x", number(worst));
    }
}

fn layers_lines(out: &mut String, row: &LayersRow) {
    let LayersRow { data, took_ms, in_sight_ms, sections, parts, resting_ms, frame_ms, ratios, .. } = row;
    let _ = writeln!(
        out,
        "other classes, {}: {} ms, {} in sight (medians of {}); {:.0} sections in {:.0} parts, {} copied",
        cut(data, 17),
        short(took_ms.median),
        short(in_sight_ms.median),
        took_ms.samples.len(),
        sections.median,
        parts.median,
        bytes_text(row.section_bytes as f64)
    );
    let of = |stat: &Stat| [stat.median, stat.p95, stat.max].map(short).join(" ");
    let _ = writeln!(
        out,
        "  frame ms meanwhile, median p95 max: {}; at rest {}; ratio {}",
        of(frame_ms),
        of(resting_ms),
        of(ratios)
    );
}

/// Two figures or three, never wider than 6.
fn short(value: f64) -> String {
    match value {
        v if v < 9.995 => format!("{value:.2}"),
        v if v < 99.95 => format!("{value:.1}"),
        _ => format!("{value:.0}"),
    }
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

/// Three figures or so, never wider than 7.
pub(crate) fn number(value: f64) -> String {
    match value.abs() {
        v if !v.is_finite() => "-".to_owned(),
        v if v < 99.995 => format!("{value:.2}"),
        v if v < 9999.5 => format!("{value:.1}"),
        v if v < 999_999.5 => format!("{value:.0}"),
        _ => format!("{value:.1e}"),
    }
}

fn bytes_text(bytes: f64) -> String {
    match bytes {
        b if b < 999.5 => format!("{b:.0} B"),
        b if b < 999.5e3 => format!("{:.1} kB", b / 1e3),
        b if b < 999.5e6 => format!("{:.1} MB", b / 1e6),
        b if b < 999.5e9 => format!("{:.1} GB", b / 1e9),
        b => format!("{:.1} TB", b / 1e12),
    }
}

fn count(points: u64) -> String {
    match points as f64 {
        n if n < 9999.5 => points.to_string(),
        n if n < 999.5e3 => format!("{:.0}k", n / 1e3),
        n if n < 9.995e6 => format!("{:.1}M", n / 1e6),
        n => format!("{:.0}M", n / 1e6),
    }
}

/// The end of `text`, at most `width` letters.
fn cut(text: &str, width: usize) -> String {
    let letters = text.chars().count();
    if letters <= width { text.to_owned() } else { text.chars().skip(letters - width).collect() }
}

/// A line a field; lists of numbers stay in one.
#[derive(Default)]
struct Lines(PrettyFormatter<'static>);

impl Formatter for Lines {
    fn begin_object<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.0.begin_object(writer)
    }

    fn end_object<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.0.end_object(writer)
    }

    fn begin_object_key<W: ?Sized + Write>(&mut self, writer: &mut W, first: bool) -> io::Result<()> {
        self.0.begin_object_key(writer, first)
    }

    fn begin_object_value<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.0.begin_object_value(writer)
    }

    fn end_object_value<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.0.end_object_value(writer)
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&self.table())
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Numbers like those of the thesis, and what a pool might do.
    pub fn example() -> Report {
        let mut report = Report::new(
            "llvmpipe (LLVM 15.0.6, 256 bits)",
            "Mesa 22.3.6",
            serde_json::json!({"size": [1920, 1080]}),
        );
        let thesis = [
            ([16, 8], [4.71, 6.49, 5.98]),
            ([16, 9], [17.48, 25.48, 10.29]),
            ([32, 7], [4.72, 6.48, 11.06]),
            ([32, 8], [17.35, 25.41, 13.88]),
            ([32, 9], [69.89, 101.52, 14.33]),
            ([64, 7], [17.22, 25.39, 17.61]),
            ([64, 8], [71.0, 102.96, 19.19]),
        ];
        for (k, ([grid, levels], [prepare, copy, trace])) in (0..).zip(thesis) {
            for (path, factor) in [("at rest", 0.9), ("turn", 1.0), ("fast", 1.1)] {
                for pipeline in Pipeline::ALL {
                    let pool = pipeline == Pipeline::Pool;
                    let moves = f64::from(path == "fast");
                    let cells = f64::from(grid << (levels - 1));
                    let [prepare, copy, bytes] = match pool {
                        true => [0.31 * moves, 0.12 * moves, 256.0 * 4096.0 * moves],
                        false => [prepare, copy, cells * cells * 4.0 * 1.35],
                    };
                    let trace = trace * factor * if pool { 0.6 } else { 1.0 };
                    let stat = |v: f64| Stat::of(vec![v * 0.9, v, v * 1.1]);
                    report.rows.push(Row {
                        frames: 3,
                        rays: 1920 * 1080,
                        prepare_ms: stat(prepare),
                        copy_ms: stat(copy),
                        copy_bytes: stat(bytes),
                        trace_ms: stat(trace),
                        trace_wall_ms: stat(trace + 0.1),
                        total_ms: stat(prepare + copy + trace + 0.2 + 0.01 * f64::from(k)),
                        spread: Some(0.02),
                        steady: true,
                        ..Row::new(pipeline, grid, levels, path)
                    });
                }
            }
        }
        report.skipped.push(Skipped {
            grid: 64,
            levels: 9,
            pipeline: Pipeline::Thesis,
            reason: "its buffer of 1.4 GB is larger than the device's 1 GiB".to_owned(),
        });
        report.ingest.push(IngestRow {
            kind: IngestKind::Ingest,
            format: 7,
            compressed: true,
            file: "some/where/quite/far/down/tile_512000_5403000.laz".to_owned(),
            points: 20_000_000,
            threads: 2,
            cache: Cache::Warm,
            read_share: Some(0.013),
            decode_share: Some(0.85),
            prepare_share: None,
            decode_mpts_s: 4.7,
            prepare_mpts_s: f64::NAN,
            total_mpts_s: 3.9,
            all_layers_mpts_s: Some(2.8),
            skipped_bytes_share: Some(0.21),
            cell: 1.0,
            samples: Vec::new(),
            note: None,
        });
        report
    }

    /// A flight with a slow first frame.
    fn stream_row(path: &str) -> StreamRow {
        let stat = |samples: &[f64]| Stat::of(samples.to_vec()).unwrap();
        let streaming = StreamFrames {
            frame_ms: stat(&[1234.5, 40.0, 44.0, 50.0]),
            tick_ms: stat(&[0.11, 0.12, 0.13, 12.5]),
            table_ms: stat(&[0.05; 4]),
            trace_ms: None,
            update_ms: None,
            upload_bytes: stat(&[0.0, 4e6, 4e6, 1e6]),
            wanted: stat(&[0.0, 20.0, 20.0, 20.0]),
            ready: stat(&[0.0, 5.0, 10.0, 20.0]),
        };
        StreamRow {
            kind: StreamKind::Stream,
            data: "a long name".to_owned(),
            points: 1_000_000,
            cell: 0.25,
            path: path.to_owned(),
            frames: 4,
            runs: 1,
            size: [640, 360],
            threads: 2,
            device_bytes: 1 << 30,
            host_bytes: 1 << 31,
            resident: StreamFrames { frame_ms: stat(&[39.0, 40.0, 41.0, 42.0]), ..streaming.clone() },
            streaming,
            ratio_p95: Some(1.25),
            ratios: vec![Some(1.25), None],
            spreads: vec![0.02, 0.5],
            waits: 0,
            bytes_read: 123_456_789,
            empty_frames: 1,
            coarser_frames: 0,
            not_resident: 0,
        }
    }

    #[test]
    fn scaling_of_unlike_times_has_no_ratio() {
        let row = |times: [&[f64]; 2]| {
            let [coarse, fine] = times.map(|ms| Repeats { ms: ms.to_vec(), is_cold: false });
            ScalingRow {
                what: "trace, pool, turn".to_owned(),
                of: "cells".to_owned(),
                amount: [1.0, 4.0],
                ms: [coarse.median().unwrap(), fine.median().unwrap()],
                spreads: [coarse.spread(), fine.spread()],
                ratio: fine.ratio_to(&coarse),
            }
        };
        let mut report = Report::new("device", "driver", serde_json::Value::Null);
        report.scaling = vec![row([&[2.0, 2.0, 2.1], &[3.0, 3.0]]), row([&[2.0, 2.9], &[3.0, 3.0]])];
        let text = report.table();
        let lines: Vec<_> = text.lines().filter(|line| line.starts_with("trace, pool, turn")).collect();
        assert!(lines[0].ends_with("1.50x"), "{text}");
        assert!(lines[1].ends_with("- (not steady: 45.0 %, 0.0 %)"), "{text}");
    }

    #[test]
    fn streaming_is_shown() {
        let mut report = Report::new("device", "driver", serde_json::Value::Null);
        report.stream = vec![stream_row("slow"), stream_row("fast"), stream_row("turn")];
        report.stream[1].waits = 3;
        report.stream[1].ratio_p95 = Some(2.0);
        report.stream[2].ratio_p95 = None;
        let stat = |samples: &[f64]| Stat::of(samples.to_vec()).unwrap();
        report.layers.push(LayersRow {
            kind: LayersKind::Layers,
            data: "a long name".to_owned(),
            size: [640, 360],
            took_ms: stat(&[800.0, 840.0]),
            in_sight_ms: stat(&[300.0; 2]),
            sections: stat(&[41.0; 2]),
            parts: stat(&[9.0; 2]),
            resting_ms: stat(&[10.0; 8]),
            frame_ms: stat(&[11.0, 12.0, 13.0, 14.0]),
            ratios: stat(&[1.1, 1.2, 1.3, 1.4]),
            section_bytes: 0,
        });
        let table = report.table();
        println!("{table}");
        assert!(table.lines().all(|line| line.chars().count() <= 110));
        let line = table.lines().find(|line| line.starts_with("a long name slow")).unwrap();
        assert!(line.contains("1.25x") && line.contains("1234") && line.ends_with("69 25 %"), "{line}");
        assert!(table.contains("uploaded: a long name slow 9.0 MB, "));
        assert!(table.contains("frames with nothing to show yet: a long name slow 1, "));
        assert!(!table.contains("reduced detail"));
        assert!(
            table.contains(
                "runs without a ratio, resident flights differ by more than 10 %: a long name slow 1"
            )
        );
        assert!(table.contains("frames that waited for streaming: 3 of 36\n"));
        assert!(table.contains("largest ratio of 95th percentiles: 2.00x"));
        assert!(table.contains(
            "other classes, a long name: 820 ms, 300 in sight (medians of 2); 41 sections in 9 parts, 0 B copied\n"
        ));
        assert!(table.contains(
            "  frame ms meanwhile, median p95 max: 12.5 13.8 14.0; at rest 10.0 10.0 10.0; ratio 1.25 1.38 1.40\n"
        ));
        let text = serde_json::to_string(&report).unwrap();
        assert!(text.contains("\"kind\":\"stream\""));
        assert_eq!(serde_json::from_str::<Report>(&text).unwrap(), report);
    }

    #[test]
    fn percentiles() {
        let stat = Stat::of((1..=101).rev().map(f64::from).collect()).unwrap();
        assert_eq!((stat.mean, stat.median, stat.p95, stat.max), (51.0, 51.0, 96.0, 101.0));
        assert_eq!(stat.samples[0], 101.0, "as measured");
        let stat = Stat::of(vec![1.0, 2.0]).unwrap();
        assert_eq!((stat.mean, stat.median, stat.max), (1.5, 1.5, 2.0));
        assert!((stat.p95 - 1.95).abs() < 1e-12);
        assert_eq!(Stat::of(vec![7.0]).unwrap().p95, 7.0);
        assert_eq!(Stat::of(vec![]), None);
        assert_eq!(Stat::of(vec![f64::NAN, f64::INFINITY]), None);
        assert_eq!(Stat::of(vec![f64::NAN, 3.0]).unwrap().samples, [3.0]);
    }

    #[test]
    fn json_comes_back() {
        let mut report = example();
        report.rows[0].ns_per_step = Some(f64::INFINITY);
        let text = report.json().unwrap();
        assert!(crate::output::is_ours(text.as_bytes()));
        let json: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(json["rows"][0]["pipeline"], "thesis");
        assert_eq!(json["rows"][0]["trace_ms"]["samples"].as_array().unwrap().len(), 3);
        assert!(json["rows"][0]["table_ms"].is_null() && json["rows"][0]["ns_per_step"].is_null());
        assert_eq!(json["ingest"][0]["kind"], "ingest");
        assert_eq!(json["ingest"][0]["cache"], "warm");
        assert!(json["ingest"][0]["prepare_mpts_s"].is_null());
        assert_eq!(json["skipped"][0]["grid"], 64);
        assert!(text.contains("\"samples\": [4"), "lists stay in one line");
        let mut back: Report = serde_json::from_str(&text).unwrap();
        assert!(back.ingest[0].prepare_mpts_s.is_nan());
        back.ingest[0].prepare_mpts_s = 1.0;
        report.ingest[0].prepare_mpts_s = 1.0;
        report.rows[0].ns_per_step = None;
        assert_eq!(back, report);
    }

    #[test]
    fn tables_are_readable() {
        let mut report = example();
        report.rows.push(Row::new(Pipeline::Pool, 16, 8, "a path with a name that is long"));
        let truth = TruthRow {
            file: "a tile with a name that is longer than a table has room for.laz".to_owned(),
            points: 123_456_789,
            ground: 0.5,
            total: 0.042,
            type_1: 0.01,
            type_2: None,
            kappa: Some(0.9),
        };
        report.ground.push(GroundRow {
            points: 123_456_789,
            outside: 7,
            cell: 1.0,
            tiles: 1234,
            threads: 128,
            gather_s: 1234.5,
            infer_us: Stat::of(vec![0.5]).unwrap(),
            shares: [0.7, 0.2, 0.1, 0.0],
            truth: vec![truth.clone(), TruthRow { total: 0.02, ..truth }],
        });
        report.rows.push(Row {
            total_ms: Stat::of(vec![123_456_789.0]),
            copy_bytes: Stat::of(vec![1.5e12]),
            ..Row::new(Pipeline::Thesis, 128, 12, "slow")
        });
        let table = report.table();
        println!("{table}");
        assert!(table.lines().all(|line| line.chars().count() <= 110));
        let lines: Vec<_> = table.lines().collect();
        assert_eq!(lines[2].split_whitespace().next(), Some("16x16/8"));
        assert_eq!(
            lines[4].split_whitespace().collect::<Vec<_>>(),
            [
                "at", "rest", "4.71", "0.00", "6.49", "0.00", "5.38", "3.23", "16.78", "3.43", "22.6", "MB",
                "0", "B", "4.89x"
            ]
        );
        let mean = lines.iter().find(|line| line.starts_with("mean of the paths")).unwrap();
        assert!(mean.ends_with("x") && mean.contains(" 4.71 "), "{mean}");
        assert!(table.contains("not run: 64x64/9, thesis: its buffer"));
        assert!(table.contains("tile_512000_5403000.laz 7 LAZ"));
        assert!(lines.iter().any(|line| line.starts_with("mean of the files") && line.ends_with(" 3.10")));
    }
}
