//! Files to finished sections: how fast, beside decoding alone, and where the time goes.
//!
//! Everything that is compared is run in turn, so that a machine that slows down slows all of it; figures are medians.

use super::cache;
use super::failure::Stopped;
pub use super::report::{Cache, IngestKind, IngestRow, IngestSample};
use super::towns::{Set, Towns};
use crate::coords::{Bounds, Grid};
use crate::ingest::bins::{Bins, Budget};
use crate::ingest::input::Input;
use crate::ingest::workers::{Clocks, ReadProgress, read_all};
use crate::load::{self, LoadError};
use crate::sample;
use crate::section::Surface;
use crate::source::placement::PlacementOptions;
use crate::source::{Decoder, LayerMemory, LidarFile};
use crate::synth::Format;
use anyhow::{Context, ensure};
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Instant;

/// A small file is gone through until so many points have been read.
const LEAST_POINTS: u64 = 1_000_000;

/// What is measured.
#[derive(Clone, Debug)]
pub struct IngestOptions {
    /// Which town files are made of.
    pub seed: u64,
    /// Points in each made file.
    pub points: u64,
    /// Cache folder in which made files are kept; `None`: nowhere.
    pub kept: Option<PathBuf>,
    /// No progress bar.
    pub quiet: bool,
    /// Runs that a figure is the median of.
    pub runs: u32,
    /// Files to read; none: LAS and LAZ of formats 3 and 7, made: see [`Towns`].
    pub files: Vec<PathBuf>,
    /// What the points of a column stand for.
    pub surface: Surface,
    /// Side of a cell; `None`: chosen from the data.
    pub cell: Option<f64>,
    /// Numbers of threads.
    pub threads: Vec<u32>,
    /// Rows of a cold cache too.
    pub cold: bool,
}

impl Default for IngestOptions {
    fn default() -> IngestOptions {
        let all = std::thread::available_parallelism().map_or(1, |n| n.get() as u32);
        let threads = if all == 1 { vec![1] } else { vec![1, all] };
        IngestOptions {
            seed: 1,
            points: 20_000_000,
            kept: None,
            quiet: true,
            runs: 5,
            files: Vec::new(),
            surface: Surface::default(),
            cell: None,
            threads,
            cold: true,
        }
    }
}

impl IngestRow {
    /// Rate of reading and binning as a share of decoding alone, median of the runs' own ratios.
    pub fn share_of_decoding(&self) -> f64 {
        median(self.samples.iter().map(|s| s.decode_s / s.total_s))
    }

    /// How many times as fast decoding is without the layers that are skipped, median of the runs' own ratios.
    pub fn gain_of_skipping(&self) -> Option<f64> {
        self.all_layers_mpts_s?;
        Some(median(self.samples.iter().filter_map(|s| Some(s.all_layers_s? / s.decode_s))))
    }
}

/// Measures and adds to `rows`; `progress` is told what comes next; ends between runs once `stop` is set.
///
/// # Errors
/// What cannot be made or read, [`Stopped`]; `rows` has what was measured whole by then.
pub fn run(
    options: &IngestOptions,
    progress: &mut dyn FnMut(&str),
    stop: &AtomicBool,
    rows: &mut Vec<IngestRow>,
) -> anyhow::Result<()> {
    ensure!(options.runs > 0 && options.points > 0, "at least one run of one point");
    for path in &options.files {
        measure(path, options, progress, stop, rows)?;
    }
    if options.files.is_empty() {
        let mut towns = Towns::new(options.kept.as_deref(), options.quiet, stop);
        let set = |name, format, compress| {
            let IngestOptions { seed, points, .. } = *options;
            Set { name, format, compress, is_tiled: false, seed, points }
        };
        let sets = [("town3", Format::Three), ("town7", Format::Seven)];
        let sets = sets.map(|(name, format)| [false, true].map(|compress| set(name, format, compress)));
        for path in towns.files(sets.as_flattened(), progress)?.iter().flatten() {
            measure(path, options, progress, stop, rows)?;
        }
    }
    Ok(())
}

/// A file and how it is to be binned.
pub(super) struct Case {
    /// One, as the workers want it.
    pub input: [Input; 1],
    pub bounds: Bounds,
    pub cell: f64,
}

impl Case {
    pub fn open(path: &Path, cell: Option<f64>) -> anyhow::Result<Case> {
        let mut opened = sample::open_all(&[path.to_owned()]);
        let opened = [opened.remove(0)?];
        let sample = sample::take(
            &opened,
            &PlacementOptions::default(),
            &sample::Asked::default(),
            &sample::SampleBudget::default(),
        );
        let placed = sample.bounds.zip(sample.world.placements[0].clone());
        let (bounds, placement) =
            placed.with_context(|| format!("{}: no point can be drawn", path.display()))?;
        let bounds = Bounds { min: bounds.min, max: bounds.max };
        let cell = match cell {
            Some(cell) => cell,
            None => load::auto_cell(sample.cell.cell, &bounds)?,
        };
        let [opened] = opened;
        let bounds = bounds.snapped(load::grid(cell, &bounds)?.height_step);
        Ok(Case { input: [Input { file: opened.file, placement, rgb: sample.files[0].rgb }], bounds, cell })
    }

    /// Of its cells and heights.
    pub fn grid(&self) -> Result<Grid, LoadError> {
        load::grid(self.cell, &self.bounds)
    }

    fn file(&self) -> &LidarFile {
        &self.input[0].file
    }

    /// Seconds to decode every chunk, throwing the points away.
    fn decode(&self, threads: u32, decoder: impl Fn() -> Decoder + Sync) -> anyhow::Result<f64> {
        let start = Instant::now();
        let (next, failed) = (AtomicUsize::new(0), Mutex::new(None));
        std::thread::scope(|scope| {
            for _ in 0..threads {
                scope.spawn(|| {
                    let mut decoder = decoder();
                    while let Some(chunk) = self.file().chunks.get(next.fetch_add(1, Ordering::Relaxed)) {
                        let result = decoder.decode(self.file(), chunk, 0..chunk.records, &mut |block| {
                            black_box(block.z.last());
                        });
                        if let Err(error) = result {
                            *failed.lock().unwrap_or_else(|e| e.into_inner()) = Some(error);
                            return;
                        }
                    }
                });
            }
        });
        let seconds = start.elapsed().as_secs_f64();
        failed.into_inner().unwrap_or_else(|e| e.into_inner()).map_or(Ok(seconds), |e| Err(e.into()))
    }

    /// Seconds from points to finished sections, and of all threads together in reads, decoding and binning.
    fn ingest(&self, surface: Surface, threads: u32) -> anyhow::Result<[f64; 4]> {
        let budget = Budget { host_bytes: u64::MAX, device_bytes: u64::MAX };
        let bins = Bins::new(surface, self.grid()?, load::core(self.cell, &self.bounds), budget);
        let progress = ReadProgress::default();
        let start = Instant::now();
        let errors = read_all(&self.input, &bins, threads as usize, &LayerMemory::default(), &progress);
        let finish = Instant::now();
        let binned = bins.finish().context("no budget is too small")?;
        let (seconds, finish) = (start.elapsed().as_secs_f64(), finish.elapsed().as_secs_f64());
        black_box(binned.sections.len());
        if let Some(error) = errors.into_iter().next() {
            return Err(error.into());
        }
        let Clocks { read, decode, prepare } = progress.clocks;
        let [read, decode, prepare] = [read, decode, prepare].map(|c| c.into_inner() as f64 / 1e9);
        Ok([seconds, read, decode, prepare + finish])
    }

    /// Share of the chunks' bytes that are never read; `None` without layers.
    fn skipped(&self) -> anyhow::Result<Option<f64>> {
        let file = self.file();
        if !file.header.compressed || file.header.format < 6 {
            return Ok(None);
        }
        let decoder = Decoder::default();
        let (mut read, mut all) = (0, 0);
        for chunk in &file.chunks {
            read += decoder.bytes_read(file, chunk)?;
            all += chunk.byte_len;
        }
        Ok(Some(1.0 - read as f64 / all.max(1) as f64))
    }
}

fn measure(
    path: &Path,
    options: &IngestOptions,
    progress: &mut dyn FnMut(&str),
    stop: &AtomicBool,
    rows: &mut Vec<IngestRow>,
) -> anyhow::Result<()> {
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    let case = Case::open(path, options.cell)?;
    let skipped_bytes_share = case.skipped()?;
    let points = case.file().points();
    ensure!(points > 0, "{}: holds no points", path.display());
    for cold in [false, true] {
        if cold && !options.cold {
            continue;
        }
        let passes = if cold { 1 } else { (LEAST_POINTS / points).clamp(1, 64) };
        let mut note = (passes > 1).then(|| format!("{passes} passes a run"));
        let mut samples = vec![Vec::new(); options.threads.len()];
        if !cold {
            progress(&format!("{name}: warming up"));
            case.decode(options.threads.iter().copied().max().unwrap_or(1), Decoder::default)?;
        }
        for run in 1..=options.runs {
            for (&threads, samples) in options.threads.iter().zip(&mut samples) {
                ensure!(!stop.load(Ordering::Relaxed), Stopped);
                let state = if cold { "cold" } else { "warm" };
                progress(&format!("{name}: {state}, {threads} threads, run {run} of {}", options.runs));
                let mut before = || {
                    if cold && let Some(why) = drop_cache(path, case.file()) {
                        note = Some(why);
                    }
                };
                let mut sum = IngestSample::default();
                for _ in 0..passes {
                    before();
                    sum.decode_s += case.decode(threads, Decoder::default)?;
                    before();
                    let [total, read, unpack, prepare] = case.ingest(options.surface, threads)?;
                    sum.total_s += total;
                    sum.read_s += read;
                    sum.unpack_s += unpack;
                    sum.prepare_s += prepare;
                    if skipped_bytes_share.is_some() {
                        before();
                        let seconds = case.decode(threads, || Decoder::default().with_all_layers())?;
                        *sum.all_layers_s.get_or_insert(0.0) += seconds;
                    }
                }
                samples.push(sum);
            }
        }
        for (&threads, samples) in options.threads.iter().zip(samples) {
            let points = points * passes;
            let rate = |seconds: f64| points as f64 / seconds / 1e6;
            let share = |part: fn(&IngestSample) -> f64| {
                median(samples.iter().map(|s| part(s) / (s.read_s + s.unpack_s + s.prepare_s)))
            };
            let all_layers = samples.iter().filter_map(|s| s.all_layers_s);
            rows.push(IngestRow {
                kind: IngestKind::Ingest,
                file: name.clone(),
                format: case.file().header.format,
                compressed: case.file().header.compressed,
                points,
                cell: case.cell,
                threads,
                cache: if cold { Cache::Cold } else { Cache::Warm },
                decode_mpts_s: rate(median(samples.iter().map(|s| s.decode_s))),
                prepare_mpts_s: rate(median(samples.iter().map(|s| s.prepare_s / f64::from(threads)))),
                total_mpts_s: rate(median(samples.iter().map(|s| s.total_s))),
                read_share: Some(share(|s| s.read_s)),
                decode_share: Some(share(|s| s.unpack_s)),
                prepare_share: Some(share(|s| s.prepare_s)),
                all_layers_mpts_s: skipped_bytes_share.map(|_| rate(median(all_layers))),
                skipped_bytes_share,
                samples,
                note: note.clone(),
            });
        }
    }
    Ok(())
}

/// Empties the page cache of a file; says what is left in it.
fn drop_cache(path: &Path, file: &LidarFile) -> Option<String> {
    file.bytes.release();
    match cache::drop(path) {
        Ok(0.0) => None,
        Ok(share) => Some(format!("{:.0} % of the file stayed in the page cache", 100.0 * share)),
        Err(error) => Some(format!("the page cache could not be emptied: {error}")),
    }
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<_> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_add_up() {
        let options =
            IngestOptions { points: 10_000, runs: 1, threads: vec![1, 2], ..IngestOptions::default() };
        let mut said = 0;
        let mut rows = Vec::new();
        run(&options, &mut |_| said += 1, &AtomicBool::new(false), &mut rows).unwrap();
        assert_eq!(rows.len(), 4 * 2 * 2);
        assert!(said >= rows.len());
        for row in &rows {
            let shares: f64 =
                [row.read_share, row.decode_share, row.prepare_share].into_iter().flatten().sum();
            assert!((shares - 1.0).abs() < 1e-6, "{row:?}");
            assert!(row.total_mpts_s > 0.0 && row.decode_mpts_s > 0.0 && row.prepare_mpts_s > 0.0);
            assert_eq!(row.gain_of_skipping().is_some(), row.compressed && row.format == 7);
            assert!(row.skipped_bytes_share.is_none_or(|share| share > 0.05 && share < 0.9));
        }
    }
}
