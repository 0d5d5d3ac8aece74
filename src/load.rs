//! From inputs to sections: open, choose once for all files, read and bin. What every command starts with.

use crate::attribute::{
    AttributeSample, AttributeSummary, Attributes, Channel, ColorMode, Flags, Kinds, Scales, Spread,
    TimeScale,
};
use crate::coords::{
    Bounds, CELL_LIMIT, Grid, HEIGHT_REACH, Hull, LowSurface, Outline, SectionKey, Slab, height_step,
};
use crate::ingest::bins::{Binner, Bins, Budget, Core, Meaning};
use crate::ingest::budget::layer_bytes;
use crate::ingest::input::{Input, OpenInput, SeenKinds};
use crate::ingest::workers::{ReadProgress, read_all};
use crate::problems::Problems;
use crate::sample::{self, Asked, FileSample, Opened, Present, RgbDepth};
use crate::section::{Columns, Surface};
use crate::source::known::{Known, Told};
use crate::source::lax::{self, LaxError};
use crate::source::learned::{Cache, Counts};
use crate::source::length::{Length, NoUnit};
use crate::source::placement::{Fit, KnownWorld, Operations, PlacementNote, PlacementOptions, Treatment};
use crate::source::{LayerMemory, LidarFile, PointBlock, Reading, Selection, crs::Crs, crs::Unit};
use crate::synth;
use crate::text::tidy;
use glam::DVec3;
use indicatif::{HumanBytes, ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::collections::{BTreeMap, BTreeSet};
use std::io::IsTerminal;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// What the user decides about reading.
#[derive(Clone, Debug)]
pub struct LoadOptions {
    /// What the points of a column stand for.
    pub surface: Surface,
    /// Side of a finest cell; `None`: chosen from the data.
    pub cell: Option<Length>,
    /// Coordinate systems and units.
    pub placement: PlacementOptions,
    /// 8 or 16: what RGB fields hold, whatever the sample says.
    pub rgb_bits: Option<u8>,
    /// What is to be shown at first.
    pub asked: Asked,
    /// Memory.
    pub budget: Budget,
    /// Where it is kept what was learned of files; `None`: neither read nor written.
    pub cache: Option<Cache>,
    /// No progress.
    pub quiet: bool,
}

/// Why nothing can be drawn.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// No input is left.
    #[error("nothing to draw: {0}")]
    Nothing(&'static str),
    /// None of the points takes part.
    #[error("nothing to draw: no point is selected ({asked}){there}")]
    NoneSelected {
        /// Which were asked for.
        asked: String,
        /// What there is instead, as far as that is known.
        there: String,
    },
    /// More cells than the grid can count.
    #[error(
        "cell size {} is too small: {what} {} units would be {} cells, {most:.0} are possible",
        tidy(*cell),
        tidy(*length),
        tidy((length / cell).round())
    )]
    TooFine {
        /// Asked for.
        cell: f64,
        /// What is too long.
        what: &'static str,
        /// Its length, CRS units.
        length: f64,
        /// The grid's limit, cells.
        most: f64,
    },
    /// Coordinates that no cell size makes countable.
    #[error("nothing to draw: coordinates reach to {0:e} units, no grid can hold that")]
    TooWide(f64),
    /// Heights that no lattice holds beside such cells.
    #[error(
        "heights reach from {} to {} units, too far from 0 to be told apart in steps of a cell of {}",
        tidy(*low),
        tidy(*high),
        tidy(*cell)
    )]
    TooHigh {
        /// Lowest of most heights, CRS units.
        low: f64,
        /// Highest of them.
        high: f64,
        /// Side of a cell, CRS units.
        cell: f64,
    },
    /// A cell size in a unit, for coordinates in none.
    #[error("--cell {0}")]
    NoUnit(NoUnit),
    /// Even the coarsest cells do not fit.
    #[error(
        "the sections do not fit {} of host and {} of device memory at any cell size",
        HumanBytes(*host),
        HumanBytes(*device)
    )]
    Budget {
        /// Host budget, bytes.
        host: u64,
        /// Device budget, bytes.
        device: u64,
    },
}

impl LoadError {
    /// None of the points takes part that are selected so; `present`: what there is instead.
    pub fn none_selected(selection: &Selection, present: &Present) -> LoadError {
        LoadError::NoneSelected { asked: selection.words(), there: present.beside(selection) }
    }
}

/// Everything about the data but the pixels.
pub struct Loaded {
    /// The grid that the sections lie on.
    pub grid: Grid,
    /// What is known of the whole.
    pub about: About,
    /// In key order.
    pub sections: Vec<(SectionKey, Columns)>,
    /// Points read.
    pub points: u64,
    /// Those of them that are in a section: all that take part, but for such as no cell or height can hold.
    pub binned: u64,
}

/// Files that a line names, at most.
const MOST_NAMED: usize = 3;
/// Largest absolute cell index: beyond it, f64 no longer tells neighbours apart.
const REACH_CELLS: f64 = 9e15;
/// Widest extent in cells: far enough from the limit that strays near the data have cells too.
const EXTENT_CELLS: f64 = (CELL_LIMIT / 4) as f64;

/// Extent of the data and their distance from the origin, CRS units.
fn spans(bounds: &Bounds) -> [f64; 2] {
    let extent = (bounds.max - bounds.min).truncate().max_element();
    let reach = bounds.max.truncate().abs().max(bounds.min.truncate().abs()).max_element();
    [extent, reach]
}

/// `chosen`, or the smallest power of two above it whose grid holds the data.
pub(crate) fn auto_cell(chosen: f64, bounds: &Bounds) -> Result<f64, LoadError> {
    let [extent, reach] = spans(bounds);
    let mut least = (extent / EXTENT_CELLS).max(reach / REACH_CELLS);
    if least > 1e15 || !extent.is_finite() {
        return Err(LoadError::TooWide(reach));
    }
    if extent <= chosen {
        // All of it lies in a cell or two, however large: one beside which heights can be held.
        let up = bounds.max.z.abs().max(bounds.min.z.abs());
        least = least.max((up / HEIGHT_REACH).min(1e15));
    }
    Ok(if chosen >= least { chosen } else { least.log2().ceil().exp2() })
}

/// An error where cells of `cell` would be too many.
fn check_cell(cell: f64, bounds: &Bounds) -> Result<(), LoadError> {
    let [extent, reach] = spans(bounds);
    let limits = [("an extent of", extent, EXTENT_CELLS), ("coordinates of", reach, REACH_CELLS)];
    for (what, length, most) in limits {
        if length / cell > most {
            return Err(LoadError::TooFine { cell, what, length, most });
        }
    }
    Ok(())
}

/// The grid of `cell`, anchored near the data so that cells are counted in i32, and with the step of their heights.
pub(crate) fn grid(cell: f64, bounds: &Bounds) -> Result<Grid, LoadError> {
    check_cell(cell, bounds)?;
    // A multiple that stays one of a section's side through every coarsening.
    const ANCHOR: f64 = (1 << 28) as f64;
    let middle = bounds.center();
    let anchor = [middle.x, middle.y].map(|v| ((v / cell) / ANCHOR).floor() as i64 * ANCHOR as i64);
    let (low, high) = (bounds.min.z, bounds.max.z);
    let height_step = height_step(cell, [low, high]).ok_or(LoadError::TooHigh { low, high, cell })?;
    Ok(Grid { base_cell: cell, coarsen: 0, anchor, height_step })
}

/// Cells that the data lies in: the bounds, and as much again on every side.
pub(crate) fn core(cell: f64, bounds: &Bounds) -> Core {
    let size = (bounds.max - bounds.min).truncate().max_element().max(1000.0 * cell);
    [(bounds.min.x, bounds.max.x), (bounds.min.y, bounds.max.y)]
        .map(|(lo, hi)| ((lo - size) / cell).floor() as i64..((hi + size) / cell).ceil() as i64)
}

/// Threads to read with.
pub fn threads() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// A progress bar where someone is looking. `template` is a constant.
pub fn bar(total: u64, quiet: bool, template: &str) -> ProgressBar {
    let bar = ProgressBar::new(total);
    if quiet || !std::io::stderr().is_terminal() {
        bar.set_draw_target(ProgressDrawTarget::hidden());
    }
    bar.set_style(ProgressStyle::with_template(template).expect("a constant template"));
    bar
}

/// Opens and reads `paths`. Problems are added even when this fails.
pub fn paths(paths: &[PathBuf], options: &LoadOptions, problems: &mut Problems) -> Result<Loaded, LoadError> {
    read(open(paths, options, problems)?, options, problems)
}

/// Reads what is open. Problems are added even when this fails.
pub fn read(opening: Opening, options: &LoadOptions, problems: &mut Problems) -> Result<Loaded, LoadError> {
    let Opening { inputs, grid, core, about, reading } = opening;
    // Sections and decoders share the host's memory.
    let layer_bytes = layer_bytes(options.budget.host_bytes);
    let layers = LayerMemory::new(layer_bytes);
    let host_bytes = options.budget.host_bytes - layer_bytes;
    let bins =
        Bins::new(options.surface, grid, core, Budget { host_bytes, ..options.budget }).with_reading(reading);
    let total = inputs.iter().map(|i| i.input.file.points()).sum();
    let inputs: Vec<_> = inputs.into_iter().map(|i| i.input).collect();
    let progress = ReadProgress::default();
    let errors =
        watched(total, options.quiet, &progress, || read_all(&inputs, &bins, threads(), &layers, &progress));
    errors.iter().for_each(|error| problems.error(error));
    finish(bins, about, progress.points.into_inner(), options, problems)
}

/// What became of a file that was to be opened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Fate {
    /// It is shown.
    Shown(Treatment),
    /// It has no place among the others, and why.
    LeftOut(String),
    /// It cannot be read, or holds nothing that could be shown, and why.
    Failed(String),
}

/// What became of each file, by its path as it was given.
pub type Fates = Vec<(PathBuf, Fate)>;

/// Files that are open, and all that is decided before they are read.
pub struct Opening {
    /// The files that are drawn.
    pub inputs: Vec<OpenInput>,
    /// The grid of everything.
    pub grid: Grid,
    /// Cells that the data is believed to lie in.
    pub core: Core,
    /// What is known of the whole.
    pub about: About,
    /// Which points take part, and what their records hold: intensities, unless [`Opening::colored`] says otherwise.
    pub reading: Reading,
}

impl Opening {
    /// The same for pictures in these colours; `legend`: what those are chosen by. Says what files lack for that.
    pub fn colored(mut self, mode: ColorMode, legend: &AttributeSummary, problems: &mut Problems) -> Opening {
        if let Some(channel) = mode.channel(legend) {
            self.reading.channel = channel;
        }
        self.say_lacking(problems);
        self
    }

    /// Files that lack what is asked for, each once.
    fn say_lacking(&self, problems: &mut Problems) {
        for input in &self.inputs {
            let file = &input.input.file;
            if let Some(words) = self.reading.lacks(file.header.format) {
                problems.warn(format!("{}: {words}", file.path().display()));
            }
        }
    }
}

impl Opening {
    /// As if nothing certain had been asked for at first: what is framed is what is shown by default.
    pub fn of_all(mut self) -> Opening {
        for input in &mut self.inputs {
            input.hull = input.hull_of_all.take().or(input.hull.take());
        }
        if let Some(outline) = self.about.outline_of_all.take() {
            self.about.outline = outline;
        }
        self
    }
}

/// Opens `paths` and takes the opening sample.
pub fn open(paths: &[PathBuf], options: &LoadOptions, problems: &mut Problems) -> Result<Opening, LoadError> {
    open_and_tell(paths, options, true, problems, &mut Fates::new())
}

/// The same; adds to `fates` what becomes of each file, even when this fails: then of those that it fails by. `needs_points`: it
/// fails where none of the points takes part.
pub fn open_and_tell(
    paths: &[PathBuf],
    options: &LoadOptions,
    needs_points: bool,
    problems: &mut Problems,
    fates: &mut Fates,
) -> Result<Opening, LoadError> {
    let mut opened = open_files(paths, problems, fates);
    say_warnings(&opened, problems);
    look_up(&mut opened, options.cache.as_ref(), problems);
    // What is said of the whole names the file where there is but one.
    let subject = match &opened[..] {
        [] => return Err(LoadError::Nothing("no input could be read")),
        [only] => format!("{}: ", only.file.path().display()),
        _ => String::new(),
    };
    let mut sample =
        sample::take(&opened, &options.placement, &options.asked, &sample::SampleBudget::default());
    say_notes(&sample, &opened, &subject, problems);
    let selection = &options.asked.selection;
    let is_none = sample.whole && sample.selected == 0 && sample.points > 0 && !selection.is_all();
    if is_none && needs_points {
        none_selected(&opened, &sample.world.treatments, selection, fates, problems);
        return Err(LoadError::none_selected(selection, &sample.present));
    }
    sample.present.doubts(selection).iter().for_each(|doubt| problems.note(format!("{subject}{doubt}")));
    let Some(bounds) = sample.bounds else {
        none_shown(&opened, &sample.world.treatments, fates);
        let mut errors: Vec<_> = sample.problems.iter().map(|(_, error)| error.to_string()).collect();
        errors.dedup();
        errors.iter().for_each(|error| problems.error(error));
        if sample.points == 0 {
            return Err(LoadError::Nothing("the inputs hold no points"));
        }
        if errors.is_empty() {
            let all = sample.points;
            problems
                .error(format!("{subject}none of {all} points lies where a cell and a height can hold it"));
        }
        return Err(LoadError::Nothing("no point is left"));
    };
    let cell = match options.cell {
        Some(cell) => cell.in_units(sample.world.unit.as_ref()).map_err(LoadError::NoUnit)?,
        None => auto_cell(sample.cell.cell, &bounds)?,
    };
    check_cell(cell, &bounds)?;
    let (too_high, bounds) = without_too_high(&opened, &sample, cell, bounds, problems)?;
    if too_high.contains(&true) {
        let files = sample.files.iter().zip(&too_high);
        let held: Vec<_> = files.filter(|(file, too_high)| file.is_in_frame && !**too_high).collect();
        let hull = Hull::union(held.iter().filter_map(|(file, _)| file.hull.as_ref()));
        let of_all = Hull::union(held.iter().filter_map(|(file, _)| file.hull_of_all.as_ref()));
        for (shape, hull) in [(&mut sample.shape, hull), (&mut sample.shape_of_all, of_all)] {
            let low = shape.take().map(|(_, low)| low.within(&bounds));
            *shape = low.map(|low| (hull.unwrap_or_else(|| Hull::from(&bounds)), low));
        }
    }
    let grid = grid(cell, &bounds)?;
    let bounds = bounds.snapped(grid.height_step);

    let snapped = |hull: Option<&Hull>| hull.map(|hull| hull.snapped(grid.height_step));
    let mut inputs = Vec::new();
    for (index, opened) in opened.into_iter().enumerate() {
        let fate = match sample.world.treatments[index].clone() {
            Treatment::LeftOut { why } => Fate::LeftOut(why),
            _ if too_high[index] => {
                Fate::LeftOut("its heights are too far from 0 for these cells".to_owned())
            }
            treatment => Fate::Shown(treatment),
        };
        fates.push((opened.file.path().to_owned(), fate));
        if let Some(placement) = sample.world.placements[index].clone().filter(|_| !too_high[index]) {
            let rgb = match (sample.files[index].rgb, options.rgb_bits) {
                (_, Some(8)) => RgbDepth::Eight,
                (_, Some(_)) => RgbDepth::Sixteen,
                (chosen, None) => chosen,
            };
            let FileSample { bounds, is_in_frame, reach, in_nodes, contradicted, .. } = sample.files[index];
            let FileSample { hull, hull_of_all, .. } = &sample.files[index];
            let [hull, hull_of_all] = [hull, hull_of_all].map(|hull| snapped(hull.as_ref()));
            let kinds = SeenKinds {
                sampled: std::mem::take(&mut sample.files[index].kinds),
                // Who is wrong about bounds is not believed in anything.
                kept: if contradicted.is_none() { opened.counts } else { Counts::new() },
                selected: sample.files[index].selected.take().map(|seen| (selection.clone(), seen)),
            };
            let known = match contradicted {
                None => opened.known,
                Some(told) => {
                    disbelieve(&opened.file, told, options.cache.as_ref(), problems);
                    Known::default()
                }
            };
            let system = opened.crs.map(|crs| crs.name);
            let input = Input { file: opened.file, placement, rgb };
            inputs.push(OpenInput {
                input,
                bounds,
                is_in_frame,
                hull,
                hull_of_all,
                reach,
                in_nodes,
                known,
                system,
                kinds,
            });
        }
    }
    let outline = |(hull, low): (Hull, LowSurface)| Outline::new(hull.snapped(grid.height_step), low, cell);
    let about = About {
        subject,
        bounds,
        outline: outline(sample.shape.expect("what has bounds has a shape")),
        outline_of_all: sample.shape_of_all.map(outline),
        summary: sample.attributes,
        kinds: sample.kinds,
        present: sample.present,
        color: sample.color,
        crs: sample.world.crs,
        unit: sample.world.unit,
        base: sample.world.base,
        operations: sample.world.operations,
        cell,
    };
    let reading = Reading { selection: selection.clone(), channel: Channel::Intensity };
    Ok(Opening { inputs, grid, core: core(cell, &bounds), about, reading })
}

/// The files of `paths` that can be opened; of the others it is said why not.
fn open_files(paths: &[PathBuf], problems: &mut Problems, fates: &mut Fates) -> Vec<Opened> {
    let mut opened = Vec::new();
    for (path, result) in paths.iter().zip(sample::open_all(paths)) {
        match result {
            Ok(file) => opened.push(file),
            Err(error) => {
                let words = error.to_string();
                let reason = words.strip_prefix(&format!("{}: ", path.display())).unwrap_or(&words);
                fates.push((path.clone(), Fate::Failed(reason.to_owned())));
                problems.error(error);
            }
        }
    }
    opened
}

/// What is not obvious about where files lie, and what is framed of them; `subject`: what stands before what is said of the
/// whole.
fn say_notes(sample: &sample::Sample, opened: &[Opened], subject: &str, problems: &mut Problems) {
    for note in &sample.world.notes {
        let line = match note.file() {
            Some(file) => format!("{}: {note}", opened[file].file.path().display()),
            None => format!("{subject}{note}"),
        };
        match note {
            PlacementNote::LeftOut { .. } => problems.error(line),
            PlacementNote::NotDegrees { .. }
            | PlacementNote::NotGeocentric { .. }
            | PlacementNote::VerticalSystems(_)
            | PlacementNote::NoFit(_) => problems.warn(line),
            _ => problems.note(line),
        }
    }
    for note in &sample.notes {
        let words = note.words(sample.world.unit.as_ref());
        let line = match note.file() {
            Some(file) => format!("{}: {words}", opened[file].file.path().display()),
            None => {
                let names = note.files().iter().map(|&file| opened[file].file.path().display().to_string());
                let names: Vec<String> = names.collect();
                let first = names[..names.len().min(MOST_NAMED)].join(", ");
                match names.len() {
                    0 => format!("{subject}{words}"),
                    1..=MOST_NAMED => format!("{subject}{words} ({first})"),
                    n => format!("{subject}{words} ({first} and {} more)", n - MOST_NAMED),
                }
            }
        };
        match note.is_warning() {
            true => problems.warn(line),
            false => problems.note(line),
        }
    }
}

/// What is odd about files themselves.
fn say_warnings(opened: &[Opened], problems: &mut Problems) {
    for Opened { file, crs_errors, .. } in opened {
        let path = file.path().display();
        file.warnings.iter().for_each(|warning| problems.warn(format!("{path}: {warning}")));
        crs_errors.iter().for_each(|error| problems.warn(format!("{path}: {error}")));
        if file.points() < file.header.claimed_points {
            problems.lost(file.path());
        }
        if file.header.claimed_points == 0 && file.points() == 0 {
            problems.warn(format!("{path}: holds no points"));
        }
    }
}

/// What becomes of files where no point of any of them takes part; what they lack that is asked for is said.
fn none_selected(
    opened: &[Opened],
    treatments: &[Treatment],
    selection: &Selection,
    fates: &mut Fates,
    problems: &mut Problems,
) {
    none_shown(opened, treatments, fates);
    let reading = Reading { selection: selection.clone(), ..Reading::default() };
    for file in opened.iter().map(|opened| &opened.file) {
        if let Some(words) = reading.lacks(file.header.format) {
            problems.warn(format!("{}: {words}", file.path().display()));
        }
    }
}

/// What becomes of files none of which has a point that could be shown.
fn none_shown(opened: &[Opened], treatments: &[Treatment], fates: &mut Fates) {
    for (opened, treatment) in opened.iter().zip(treatments) {
        let fate = match treatment {
            Treatment::LeftOut { why } => Fate::LeftOut(why.clone()),
            _ if opened.file.points() == 0 => Fate::Failed("it holds no points".to_owned()),
            _ => Fate::Failed("no point of it lies where it could be shown".to_owned()),
        };
        fates.push((opened.file.path().to_owned(), fate));
    }
}

/// Which files are left out since no step holds their heights, which is said, and the box of the others; `bounds`, of all,
/// where there is none.
fn without_too_high(
    opened: &[Opened],
    sample: &sample::Sample,
    cell: f64,
    bounds: Bounds,
    problems: &mut Problems,
) -> Result<(Vec<bool>, Bounds), LoadError> {
    let (mut too_high, mut held) = (vec![false; opened.len()], None);
    for ((file, opened), too_high) in sample.files.iter().zip(opened).zip(&mut too_high) {
        let Some(bounds) = file.bounds else { continue };
        let (low, high) = (bounds.min.z, bounds.max.z);
        if height_step(cell, [low, high]).is_some() {
            held = Some(held.map_or(bounds, |held| bounds.union(held)));
        } else {
            *too_high = true;
            let path = opened.file.path().display();
            problems.error(format!("{path}: {}", LoadError::TooHigh { low, high, cell }));
        }
    }
    if !too_high.contains(&true) {
        return Ok((too_high, bounds));
    }
    let held = held.ok_or(LoadError::Nothing("no point is left"))?;
    Ok((too_high, held))
}

/// What was learned before, and what spatial indices tell.
fn look_up(opened: &mut [Opened], cache: Option<&Cache>, problems: &mut Problems) {
    let found = sample::parallel(opened.len(), |_, index| {
        let file = &opened[index].file;
        let (mut known, counts) = cache.map(|cache| cache.load_all(file)).unwrap_or_default();
        let index = if known.is_whole(file) { Ok(Known::default()) } else { lax::look_up(file) };
        file.bytes.release();
        let error = index.map(|index| known.fill_from(index)).err();
        (known, counts, error)
    });
    for (opened, (known, counts, error)) in opened.iter_mut().zip(found) {
        (opened.known, opened.counts) = (known, counts);
        match error {
            Some(error @ LaxError::Older { .. }) => problems.note(error),
            Some(error) => problems.warn(error),
            None => {}
        }
    }
}

/// Bounds that are wrong are said to be, and not kept.
fn disbelieve(file: &LidarFile, told: Told, cache: Option<&Cache>, problems: &mut Problems) {
    if let (Told::Cache, Some(cache)) = (told, cache) {
        cache.forget(file);
    }
    problems.warn(format!("{}: {}", file.path().display(), told.contradicted()));
}

/// The embedded scene: the synthetic town, made in memory.
pub fn demo(
    color: Option<ColorMode>,
    options: &LoadOptions,
    problems: &mut Problems,
) -> Result<Loaded, LoadError> {
    let (town, tiles) = synth::demo();
    tiles_of(&town, &tiles, color, options, problems)
}

/// What the scan of a synthetic town means.
struct Scan;

impl Meaning for Scan {
    fn world(&self, block: &PointBlock, i: usize) -> DVec3 {
        let [x, y, z] = [block.x[i], block.y[i], block.z[i]].map(|v| f64::from(v) * synth::SCALE);
        DVec3::new(x + synth::ORIGIN[0], y + synth::ORIGIN[1], z)
    }
    fn rgb(&self, block: &PointBlock, i: usize) -> [u8; 3] {
        block.rgb[i].map(|v| (v >> 8) as u8)
    }
}

/// Every 32nd point of such a scan that is neither noise nor withheld.
#[derive(Default)]
struct ScanSample {
    /// Of those that take part.
    attributes: AttributeSample,
    kinds: Kinds,
    places: Vec<DVec3>,
    source_ids: BTreeMap<u16, u64>,
    angles: Vec<f64>,
    /// Of all.
    all_places: Vec<DVec3>,
    lines: BTreeSet<u16>,
    /// First and last time of every point.
    times: Option<TimeScale>,
}

impl ScanSample {
    fn add(&mut self, block: &PointBlock, selection: &Selection, grid: &Grid) {
        for &time in &block.gps_time {
            let times = self.times.get_or_insert(TimeScale { from: time, to: time });
            (times.from, times.to) = (times.from.min(time), times.to.max(time));
        }
        for i in (0..block.len()).step_by(32) {
            let place = Scan.world(block, i);
            let Some(height) = grid.height(place.z) else { continue };
            if sample::hidden_by_default(block.class[i], block.flags[i]) {
                continue;
            }
            self.all_places.push(place);
            self.lines.insert(block.source_id[i]);
            if selection.holds(block, i) && selection.holds_height(place.z) {
                self.places.push(place);
                self.kinds.insert((block.class[i], Flags::of(block.flags[i])));
                *self.source_ids.entry(block.source_id[i]).or_default() += 1;
                self.angles.push(f64::from(block.scan_angle[i]) * 0.006);
                self.attributes.push(Attributes {
                    height,
                    class: block.class[i],
                    intensity: block.intensity[i],
                    rgb: Scan.rgb(block, i),
                    returns: block.returns[i],
                    flags: block.flags[i],
                });
            }
        }
    }

    /// Whichever thread came first.
    fn sort(&mut self) {
        for places in [&mut self.places, &mut self.all_places] {
            places.sort_unstable_by(|a, b| {
                a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z))
            });
        }
    }

    /// What colours are chosen by where the scan has `density` points a square metre and lies in `flat`.
    fn summary(&self, grid: &Grid, flat: &Bounds, density: f64) -> AttributeSummary {
        let low = LowSurface::of(flat, &self.all_places);
        let above = |place: &DVec3| (place.z - low.at(place.truncate()), 1.0);
        let heights = || self.all_places.iter().map(|place| place.z);
        let times = self.times;
        AttributeSummary {
            source_ids: self.source_ids.iter().map(|(id, points)| (*id, *points)).collect(),
            scan_angle: Spread::of(self.angles.iter().map(|angle| (*angle, 1.0))),
            above: Spread::of(self.places.iter().map(above)),
            // Evenly, as they are flown.
            time: Spread::of(times.iter().flat_map(|times| {
                (0..=100).map(|k| (times.from + (times.to - times.from) * f64::from(k) / 100.0, 1.0))
            })),
            scales: Scales {
                metre: 1.0,
                times,
                reach: Scales::reach_of(heights(), &Spread::of(heights().map(|height| (height, 1.0))), 1.0),
                density,
                lines: self.lines.iter().copied().collect(),
            },
            ..self.attributes.summary(grid)
        }
    }
}

/// A block of a scan with all fields that are decoded of files.
fn block_of(scan: &synth::ScanBlock) -> PointBlock {
    PointBlock {
        source_id: scan.source_id.clone(),
        scan_angle: scan.scan_angle.iter().map(|degrees| (degrees / 0.006).round() as i16).collect(),
        gps_time: scan.gps_time.clone(),
        ..scan.points.clone()
    }
}

/// Scans `tiles` on all cores: `each` block goes with what `start` has made for its thread.
fn scan_all<S>(
    town: &synth::Town,
    tiles: &[synth::Tile],
    start: impl Fn() -> S + Sync,
    each: impl Fn(&mut S, &PointBlock) + Sync,
) {
    let next = std::sync::atomic::AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for _ in 0..threads() {
            scope.spawn(|| {
                let mut state = start();
                while let Some(tile) = tiles.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let Ok(()) = synth::scan(town, tile, |scan| {
                        each(&mut state, &block_of(scan));
                        Ok::<(), std::convert::Infallible>(())
                    });
                }
            });
        }
    });
}

/// The scan of `tiles`, at least one, of a synthetic town, made in memory, for pictures in these colours.
pub fn tiles_of(
    town: &synth::Town,
    tiles: &[synth::Tile],
    color: Option<ColorMode>,
    options: &LoadOptions,
    problems: &mut Problems,
) -> Result<Loaded, LoadError> {
    let side = |axis: usize| {
        let low = tiles.iter().map(|t| t.corner[axis]).fold(f64::INFINITY, f64::min);
        let high = tiles.iter().map(|t| t.corner[axis] + t.size[axis]).fold(f64::NEG_INFINITY, f64::max);
        (low + synth::ORIGIN[axis], high + synth::ORIGIN[axis])
    };
    let ((west, east), (south, north)) = (side(0), side(1));
    // No town is higher.
    let flat = Bounds { min: DVec3::new(west, south, 0.0), max: DVec3::new(east, north, 1000.0) };
    let metre = Unit::metre();
    let cell = options.cell.unwrap_or(0.5.into()).in_units(Some(&metre)).map_err(LoadError::NoUnit)?;
    let grid = grid(cell, &flat)?;
    let selection = &options.asked.selection;
    let all_points: u64 = tiles.iter().map(|tile| tile.points).sum();
    let sampled = Mutex::new(ScanSample::default());
    let sample = |block: &PointBlock| {
        sampled.lock().unwrap_or_else(PoisonError::into_inner).add(block, selection, &grid);
    };
    let summary = || {
        let mut sampled = sampled.lock().unwrap_or_else(PoisonError::into_inner);
        sampled.sort();
        sampled.summary(&grid, &flat, all_points as f64 / ((east - west) * (north - south)))
    };
    // What codes mean is known before points are coded.
    let is_scaled = color.is_some_and(ColorMode::is_scaled);
    if is_scaled {
        scan_all(town, tiles, || (), |(), block| sample(block));
    }
    let legend = if is_scaled { summary() } else { AttributeSample::default().summary(&grid) };
    let channel = color.and_then(|color| color.channel(&legend));
    let reading = Reading { selection: selection.clone(), channel: channel.unwrap_or_default() };
    let bins = Bins::new(options.surface, grid, core(cell, &flat), options.budget).with_reading(reading);
    let progress = ReadProgress::default();
    watched(all_points, options.quiet, &progress, || {
        scan_all(town, tiles, Binner::default, |binner, block| {
            binner.bin(&bins, &Scan, block);
            progress.points.fetch_add(block.len() as u64, Ordering::Relaxed);
            if !is_scaled {
                sample(block);
            }
        });
    });
    let summary = summary();
    let ScanSample { kinds, places, .. } = sampled.into_inner().unwrap_or_else(PoisonError::into_inner);
    if places.is_empty() && !selection.is_all() {
        return Err(LoadError::none_selected(selection, &Present::default()));
    }
    let bounds =
        Bounds { min: flat.min.with_z(summary.height.min), max: flat.max.with_z(summary.height.max) };
    let points = progress.points.into_inner();
    let unit = Some(metre);
    let hull = match Hull::of(&places) {
        Some(hull) if selection.is_all() => hull.stretched(&bounds),
        // Some of them lie where they do.
        Some(hull) => hull,
        None => Hull::from(&bounds),
    };
    let about = About {
        subject: String::new(),
        bounds,
        outline: Outline::new(hull, LowSurface::of(&bounds, &places), cell),
        outline_of_all: None,
        kinds,
        summary,
        present: Present::default(),
        color: ColorMode::Rgb,
        crs: None,
        unit,
        base: Fit::AsIs,
        operations: Operations::new(),
        cell,
    };
    finish(bins, about, points, options, problems)
}

/// What is known of the whole before it is read.
#[derive(Clone)]
pub struct About {
    /// What stands before a warning.
    subject: String,
    /// Where the points are, strays aside.
    pub bounds: Bounds,
    /// Of the points that were asked for: what is framed, and where lit images end.
    pub outline: Outline,
    /// The same where others are shown than were asked for at first, if that is another.
    pub outline_of_all: Option<Outline>,
    /// What colours are chosen by: of the points that were asked for.
    pub summary: AttributeSummary,
    /// Kinds of points that the sample has seen, hidden ones included.
    pub kinds: Kinds,
    /// What there is of the values that selections go by, as far as was seen.
    pub present: Present,
    /// What `--color auto` comes to.
    pub color: ColorMode,
    /// The data's coordinate system.
    pub crs: Option<Crs>,
    /// Unit of E, N and U.
    pub unit: Option<Unit>,
    /// Coordinates of the world's system to E, N, U as they are drawn: eyes, paths and picks go through it.
    pub base: Fit,
    /// The ways into that system that files took.
    pub operations: Operations,
    /// Side of a finest cell, CRS units.
    pub cell: f64,
}

impl About {
    /// What other files have to share to be shown beside these.
    pub fn world(&self) -> KnownWorld {
        KnownWorld {
            crs: self.crs.clone(),
            unit: self.unit.clone(),
            base: self.base,
            operations: self.operations.clone(),
        }
    }

    /// What lit images of cells of `cell` end in.
    pub fn slab(&self, cell: f64) -> Slab {
        self.outline.slab(cell)
    }

    /// U below which lit images show nothing.
    pub fn floor(&self, cell: f64) -> f64 {
        let floor = |outline: &Outline| {
            outline.low.lowest_height().min(self.bounds.min.z) - outline.slab(cell).thickness
        };
        self.outline_of_all.iter().map(floor).fold(floor(&self.outline), f64::min)
    }
}

fn finish(
    bins: Bins,
    about: About,
    points: u64,
    options: &LoadOptions,
    problems: &mut Problems,
) -> Result<Loaded, LoadError> {
    let Budget { host_bytes: host, device_bytes: device } = options.budget;
    let binned = bins.finish().ok_or(LoadError::Budget { host, device })?;
    if binned.outside > 0 {
        let points = if binned.outside == 1 { "point is" } else { "points are" };
        problems.warn(format!(
            "{}{} {points} not drawn: scattered far outside of the rest, or beyond what a height or cell can be",
            about.subject, binned.outside
        ));
    }
    if binned.grid.coarsen > 0 {
        let [was, now] = [about.cell, binned.grid.cell()].map(tidy);
        problems.warn(format!(
            "{}cell size {now} instead of {was}: at {was} the sections would not fit the memory budget (--device-memory, --host-memory)",
            about.subject
        ));
    }
    let selection = &options.asked.selection;
    if binned.sections.is_empty() && !selection.is_all() && binned.outside == 0 {
        return Err(LoadError::none_selected(selection, &about.present));
    }
    if binned.sections.is_empty() {
        return Err(LoadError::Nothing("no point is left"));
    }
    let in_sections = binned.sections.iter().map(|(_, columns)| columns.points()).sum();
    Ok(Loaded { grid: binned.grid, about, sections: binned.sections, points, binned: in_sections })
}

/// Runs `work` while a progress bar follows `progress`.
fn watched<T: Send>(total: u64, quiet: bool, progress: &ReadProgress, work: impl FnOnce() -> T + Send) -> T {
    let bar = bar(total, quiet, "reading {wide_bar} {human_pos}/{human_len} points {eta}");
    let result = std::thread::scope(|scope| {
        let worker = scope.spawn(work);
        while !worker.is_finished() {
            bar.set_position(progress.points.load(Ordering::Relaxed));
            std::thread::sleep(Duration::from_millis(if bar.is_hidden() { 2 } else { 40 }));
        }
        worker.join()
    });
    bar.finish_and_clear();
    // A panic of ours goes on its way; a decoder's was contained long before.
    result.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}
