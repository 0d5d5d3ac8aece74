//! Time until everything around a camera is there: the thesis' loading beside ours.
//!
//! The thesis (§3.2.1, §3.3.5) keeps 4 × 4 sections around the camera, each as wide as the camera section and with a
//! thread of its own that scans the whole file, leaves out what lies elsewhere, and puts each point into its pyramid
//! from the finest level up until a level is as high already. The four around the camera have priority. Points come
//! from our decoder here, which is faster than the one it used.

use super::failure::Stopped;
use super::ingest::Case;
use super::memory::free_bytes;
use super::report::{LoadRow, Stat};
use crate::attribute::{ClassMask, Flags};
use crate::gpu::{Gpu, Order};
use crate::ingest::bins::{Bins, Budget, Meaning};
use crate::ingest::input::Input;
use crate::ingest::workers::{ReadProgress, read_all};
use crate::load;
use crate::resident::pool::Access;
use crate::resident::scene::Scene;
use crate::resident::visibility::Visibility;
use crate::section::Surface;
use crate::source::{Decoder, LayerMemory};
use anyhow::{Context, ensure};
use std::path::Path;
use std::sync::Barrier;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use thread_priority::{ThreadPriority, set_current_thread_priority};

/// Sections along a side of the thesis' array.
const ARRAY: usize = 4;
/// Levels of a pyramid, unless a section has fewer.
const LEVELS: u32 = 8;
/// Device memory for our sections, bytes.
const POOL_BYTES: u64 = 3 << 30;

/// A section that a thread fills: heights of all levels, finest first, and colours.
struct Filling {
    low: [i64; 2],
    side: usize,
    levels: Vec<Vec<f32>>,
    colors: Vec<u32>,
    points: u64,
}

impl Filling {
    fn new(low: [i64; 2], side: usize, levels: u32) -> Filling {
        let level = |l: u32| vec![f32::NEG_INFINITY; (side >> l).pow(2)];
        Filling {
            low,
            side,
            levels: (0..levels).map(level).collect(),
            colors: vec![0; side * side],
            points: 0,
        }
    }

    /// Scans the file from start to end.
    fn fill(&mut self, input: &Input, cell: f64, stop: &AtomicBool) -> anyhow::Result<()> {
        let mut decoder = Decoder::default();
        for chunk in &input.file.chunks {
            if stop.load(Ordering::Relaxed) {
                break;
            }
            decoder.decode(&input.file, chunk, 0..chunk.records, &mut |block| {
                for i in 0..block.len() {
                    let at = input.world(block, i);
                    let [x, y] = [at.x, at.y].map(|v| (v / cell).floor() as i64);
                    let [x, y] = [x.wrapping_sub(self.low[0]) as u64, y.wrapping_sub(self.low[1]) as u64];
                    if x < self.side as u64 && y < self.side as u64 {
                        self.points += 1;
                        self.insert([x as usize, y as usize], at.z as f32, || {
                            let [r, g, b] = input.rgb(block, i);
                            u32::from_le_bytes([r, g, b, 255])
                        });
                    }
                }
            })?;
        }
        Ok(())
    }

    #[inline]
    fn insert(&mut self, [x, y]: [usize; 2], height: f32, color: impl FnOnce() -> u32) {
        let mut color = Some(color);
        for (l, level) in self.levels.iter_mut().enumerate() {
            let top = &mut level[(y >> l) * (self.side >> l) + (x >> l)];
            if *top >= height {
                return;
            }
            *top = height;
            if let Some(color) = color.take() {
                self.colors[y * self.side + x] = color();
            }
        }
    }
}

/// Seconds until the middle four are full and until all are; points kept; whether priorities could be set.
fn thesis(case: &Case, side: usize, levels: u32, stop: &AtomicBool) -> anyhow::Result<([f64; 2], u64, bool)> {
    let (input, cell) = (&case.input[0], case.cell);
    let middle = case.bounds.center();
    let low = [middle.x, middle.y].map(|v| (v / cell).floor() as i64 - (ARRAY / 2 * side) as i64);
    let mut sections: Vec<_> = (0..ARRAY * ARRAY)
        .map(|k| {
            let at = [k % ARRAY, k / ARRAY];
            Filling::new([0, 1].map(|a| low[a] + (at[a] * side) as i64), side, levels)
        })
        .collect();
    let start = Barrier::new(sections.len() + 1);
    let done = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..)
            .zip(&mut sections)
            .map(|(k, section)| {
                let start = &start;
                let in_middle = [k % ARRAY, k / ARRAY].iter().all(|at| (1..=2).contains(at));
                scope.spawn(move || {
                    let set = in_middle || set_current_thread_priority(ThreadPriority::Min).is_ok();
                    start.wait();
                    section.fill(input, cell, stop).map(|()| (in_middle, set, Instant::now()))
                })
            })
            .collect();
        // Before the others go: this thread may be the last to run again.
        let begin = Instant::now();
        start.wait();
        let ends = workers.into_iter().map(|worker| {
            let (in_middle, set, end) =
                worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
            Ok((in_middle, set, end.duration_since(begin).as_secs_f64()))
        });
        ends.collect::<anyhow::Result<Vec<_>>>()
    })?;
    let last = |of: fn(bool) -> bool| done.iter().filter(|d| of(d.0)).map(|d| d.2).fold(0.0, f64::max);
    let points = sections.iter().map(|section| section.points).sum();
    Ok(([last(|in_middle| in_middle), last(|_| true)], points, done.iter().all(|d| d.1)))
}

/// Seconds to read and bin, to pack, copy and derive until the device has all, and of those to pack. The scene is empty before and after.
fn ours(scene: &mut Scene, case: &Case, threads: usize) -> anyhow::Result<[f64; 3]> {
    let grid = case.grid()?;
    let begin = Instant::now();
    let budget = Budget { host_bytes: u64::MAX, device_bytes: u64::MAX };
    let bins = Bins::new(Surface::Columns, grid, load::core(case.cell, &case.bounds), budget);
    let errors = read_all(&case.input, &bins, threads, &LayerMemory::default(), &ReadProgress::default());
    if let Some(error) = errors.into_iter().next() {
        return Err(error.into());
    }
    let binned = bins.finish().context("no budget is too small")?;
    let read = begin.elapsed().as_secs_f64();
    let mut packing = Duration::ZERO;
    for (key, columns) in &binned.sections {
        let room = scene.upload_with(*key, columns.layout(), |words| {
            let from = Instant::now();
            let highest_of = columns.pack_with(words, crate::gpu::stream_words);
            packing += from.elapsed();
            highest_of
        })?;
        ensure!(room, "the sections do not fit the device's memory");
    }
    scene.flush()?;
    scene.settle()?;
    let upload = begin.elapsed().as_secs_f64() - read;
    let keys: Vec<_> = scene.entries().into_iter().map(|entry| entry.key).collect();
    scene.evict(&keys)?;
    scene.settle()?;
    Ok([read, upload, packing.as_secs_f64()])
}

/// Loads `path` both ways, `runs` times in turn, warm; fewer times once `stop` is set. A row for each of `threads`, ours
/// with so many, the thesis' the same in all.
pub fn run(
    gpu: &Gpu,
    path: &Path,
    cell: f64,
    runs: u32,
    threads: &[u32],
    progress: &mut dyn FnMut(&str),
    stop: &AtomicBool,
) -> anyhow::Result<Vec<LoadRow>> {
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    let case = Case::open(path, Some(cell))?;
    let extent = (case.bounds.max - case.bounds.min).truncate().max_element() / cell;
    // One more than there are, since the middle is that of a cell.
    let side = ((extent + 2.0) / ARRAY as f64).ceil().max(16.0) as usize;
    let side = side.next_power_of_two();
    let levels = LEVELS.min(side.ilog2());
    let bytes = (ARRAY * side).pow(2) as u64 * 28 / 3;
    ensure!(
        free_bytes().is_none_or(|free| bytes < free),
        "{name}: 16 sections of {side} x {side} cells do not fit the host's memory"
    );
    progress(&format!("{name}: warming up"));
    // One scene for all runs: drivers compile on first use.
    let seen = Visibility {
        classes: ClassMask::default(),
        hidden_flags: Flags::WITHHELD,
        bridge: 0,
        near_ties: false,
    };
    let bytes = gpu.bytes_for_sections(POOL_BYTES);
    let mut scene = Scene::new(gpu, |order: Order| order, Access::Address, bytes, seen, case.grid()?)?;
    ours(&mut scene, &case, threads.iter().copied().max().unwrap_or(1) as usize)?;
    let [mut middle, mut all] = [const { Vec::new() }; 2];
    // Of each number of threads: open, read, upload, pack, all.
    let mut times = vec![[const { Vec::new() }; 5]; threads.len()];
    let (mut kept, mut prioritized) = (0, true);
    for run in 1..=runs {
        progress(&format!("{name}: loading, run {run} of {runs}"));
        let ([first, last], points, set) = thesis(&case, side, levels, stop)?;
        if stop.load(Ordering::Relaxed) {
            // Whole runs count.
            ensure!(run > 1, Stopped);
            break;
        }
        (kept, prioritized) = (points, prioritized && set);
        middle.push(first);
        all.push(last);
        for (&threads, times) in threads.iter().zip(&mut times) {
            let begin = Instant::now();
            // Ours has to look at the data first: bounds, coordinate system. On all cores, whatever `threads` is.
            let case = Case::open(path, Some(cell))?;
            let open = begin.elapsed().as_secs_f64();
            let [read, upload, pack] = ours(&mut scene, &case, threads as usize)?;
            let all = [open, read, upload, pack, open + read + upload];
            times.iter_mut().zip(all).for_each(|(times, seconds)| times.push(seconds));
        }
    }
    let stat = |samples| Stat::of(samples).context("at least one run");
    let row = |(&threads, times): (&u32, [Vec<f64>; 5])| {
        let [open_s, read_s, upload_s, pack_s, total_s] = times.map(stat);
        Ok(LoadRow {
            file: name.clone(),
            points: case.input[0].file.points(),
            kept,
            side: side as u32,
            levels,
            cell,
            threads,
            prioritized,
            thesis_middle_s: stat(middle.clone())?,
            thesis_all_s: stat(all.clone())?,
            open_s: open_s?,
            read_s: read_s?,
            upload_s: upload_s?,
            pack_s: pack_s?,
            total_s: total_s?,
        })
    };
    threads.iter().zip(times).map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_climb_until_a_level_is_higher() {
        let mut section = Filling::new([0, 0], 4, 3);
        let mut insert = |at, height, color| section.insert(at, height, || color);
        insert([0, 0], 5.0, 1);
        insert([1, 0], 3.0, 2);
        insert([0, 0], 4.0, 3);
        insert([3, 3], 7.0, 4);
        assert_eq!(section.levels[0][..2], [5.0, 3.0]);
        assert_eq!(section.levels[1], [5.0, f32::NEG_INFINITY, f32::NEG_INFINITY, 7.0]);
        assert_eq!(section.levels[2], [7.0]);
        assert_eq!([section.colors[0], section.colors[1], section.colors[15]], [1, 2, 4]);
    }
}
