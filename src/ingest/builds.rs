//! Sections that are being made: which chunks of which files each still lacks, and which chunk is read next. Pure but
//! for the files that chunks belong to.
//!
//! A chunk that is read serves every section that lacks it and that it may touch, at every level. A section is finished
//! when it lacks none; since a column keeps the maximum, it then is the same whatever came first, and a chunk that is
//! read twice does no harm.

use super::bins::{self, Shared};
use super::counts::{self, FileCounts};
use super::input::{Input, OpenInput, SeenKinds};
use crate::attribute::{Kind, KindCounts, Kinds};
use crate::coords::{Extent, Grid, SectionKey};
use crate::limits::LIMITS;
use crate::sample::SampledKinds;
use crate::section::{PayloadKey, PayloadKind, Surface};
use crate::source::known::{RawBounds, Told};
use crate::source::learned::Counts;
use crate::source::{Reading, SourceError};
use glam::DVec3;
use roaring::RoaringBitmap;
use std::collections::{HashMap, HashSet, VecDeque};
use std::sync::{Arc, Mutex};

/// Finest cells: first, and the one after the last.
pub type Cells = [[i32; 2]; 2];

/// A file as it is read here.
pub struct Source {
    /// How its points are read.
    pub input: Arc<Input>,
    /// Cells outside of which it has no points, where that is known.
    reach: Option<Cells>,
    /// Where it is seen.
    pub extent: Option<Extent>,
    /// Its points are shown.
    pub visible: bool,
    /// It cannot be read any more.
    lost: bool,
    /// Its first chunk in `Builds::chunks`.
    first: u32,
    /// Chunks of it that are being read.
    busy: u32,
    /// More was learned of its chunks than has been handed out.
    has_learned: bool,
    /// What its points are.
    counts: FileCounts,
    /// The same of those that take part, where not all do.
    selected: Option<FileCounts>,
}

impl Source {
    /// What the points are that take part.
    fn now(&self) -> &FileCounts {
        self.selected.as_ref().unwrap_or(&self.counts)
    }
}

/// What is known of a chunk.
struct Chunk {
    source: u32,
    /// Cells that hold its points, where that is known, and who says so.
    cells: Option<(Told, Cells)>,
    /// Bounds of its points, learned by reading them or before.
    learned: Option<RawBounds>,
    busy: bool,
    /// It was read, whole or not: what it lacks stays away.
    broken: bool,
    /// It was said that points of it are nowhere.
    is_told: bool,
    /// Its points are among those of [`Source::counts`].
    is_counted: bool,
    /// And among those of [`Source::selected`].
    is_selected_counted: bool,
    /// Sections that lack it.
    lacked_by: u32,
}

impl Chunk {
    /// One section less lacks it; `lacking`: chunks that any lacks.
    fn let_go(&mut self, lacking: &mut u64) {
        self.lacked_by -= 1;
        *lacking -= u64::from(self.lacked_by == 0);
    }
}

/// A section that is being made.
struct Build {
    columns: Shared,
    lacks: RoaringBitmap,
    bytes: u64,
    damaged: bool,
}

/// A section that lacks nothing any more.
pub struct Finished {
    /// Which one.
    pub key: PayloadKey,
    /// Its points.
    pub columns: Shared,
    /// Some of its points could not be read.
    pub damaged: bool,
    /// Changes to the set of files that it knows of.
    pub revision: u64,
    /// Bytes that its columns take until [`Builds::release_columns`] says that they are gone.
    pub bytes: u64,
}

/// A chunk to be read, and the sections that want it.
pub struct Job {
    chunk: u32,
    /// Its file.
    pub input: Arc<Input>,
    /// Its index there.
    pub index: usize,
    /// Who lacks it.
    pub targets: Vec<(PayloadKey, Shared)>,
    /// Its points that take part are to be counted.
    pub counts: bool,
    /// Which those are, and what their records hold.
    pub reading: Arc<Reading>,
}

/// How sections are made of points.
#[derive(Clone, Debug)]
pub struct Made {
    /// What the points of a column stand for.
    pub surface: Surface,
    /// Which points take part, and what their records hold.
    pub reading: Reading,
}

impl From<Surface> for Made {
    /// Of all points, as they are stored.
    fn from(surface: Surface) -> Made {
        Made { surface, reading: Reading::default() }
    }
}

/// What came of a job.
#[derive(Default)]
pub struct Outcome {
    /// Bounds of the points that were read.
    pub bounds: Option<RawBounds>,
    /// Why it was not read whole.
    pub error: Option<SourceError>,
    /// Points read.
    pub points: u64,
    /// Of those, such as no cell or height can hold, or that have no place in the world's coordinate system.
    pub nowhere: u64,
    /// Points of each kind that take part, where they were counted.
    pub kinds: Option<Vec<(Kind, u64)>>,
}

/// What was learned of a file.
pub struct Learned {
    /// The file.
    pub input: Arc<Input>,
    /// Of each chunk, where its points lie.
    pub bounds: Vec<Option<RawBounds>>,
    /// Its points of each kind; empty: not all of them were counted.
    pub kinds: Counts,
}

/// How far reading is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Progress {
    /// Points in all files that are shown.
    pub points: u64,
    /// Points decoded since the start, each as often as it was.
    pub points_read: u64,
    /// Points of the files that are shown which were decoded at least once, by whomever.
    pub points_seen: u64,
    /// Bytes of the chunks that were read.
    pub bytes_read: u64,
    /// Chunks, and those that were read at least once.
    pub chunks: u64,
    /// Those whose bounds are known.
    pub chunks_known: u64,
    /// Sections that are being made.
    pub builds: u64,
    /// Bytes that they take, and those that wait to be packed.
    pub build_bytes: u64,
    /// Chunks that the sections which are being made lack.
    pub lacking: u64,
}

/// All of it.
pub struct Builds {
    grid: Grid,
    surface: Surface,
    reading: Arc<Reading>,
    sources: Vec<Source>,
    chunks: Vec<Chunk>,
    builds: HashMap<PayloadKey, Build>,
    /// What is wanted, most urgent first.
    order: Vec<PayloadKey>,
    budget_bytes: u64,
    revision: u64,
    finished: VecDeque<Finished>,
    /// Bytes of those, and of those that are being packed.
    waiting_bytes: u64,
    /// Finished, on their way to whoever wanted them.
    in_transit: HashSet<PayloadKey>,
    errors: Vec<String>,
    /// What is no error, but not as it should be.
    warnings: Vec<String>,
    corrected: Vec<usize>,
    /// Files of which wrong bounds were kept.
    forgotten: Vec<usize>,
    progress: Progress,
    /// Changes to what is known of kinds of points, since the start.
    counted: u64,
}

/// The cells of a box, if the grid can count them.
pub fn cells_of(grid: &Grid, min: DVec3, max: DVec3) -> Option<Cells> {
    let (low, high) = (grid.cell_of(min.x, min.y)?, grid.cell_of(max.x, max.y)?);
    Some([[low.i, low.j], [high.i + 1, high.j + 1]])
}

fn around([low, high]: Cells) -> Cells {
    [low.map(|cell| cell - 1), high.map(|cell| cell + 1)]
}

/// The cells of a chunk's bounds.
fn cells_of_raw(grid: &Grid, input: &Input, bounds: &RawBounds) -> Option<Cells> {
    let [low, high] = bounds.unpacked(&input.file.header);
    let [low, high] = input.placement.bounds(low, high)?;
    cells_of(grid, low, high)
}

/// Chunks of which it is known where they lie.
fn known(chunks: &[Chunk]) -> u64 {
    chunks.iter().filter(|chunk| chunk.cells.is_some()).count() as u64
}

/// Whether some cells of `inner` are none of `outer`.
fn reaches_out(inner: Cells, outer: Cells) -> bool {
    (0..2).any(|axis| inner[0][axis] < outer[0][axis] || inner[1][axis] > outer[1][axis])
}

impl Builds {
    /// Nothing yet, on `grid`, of columns and points as `made` has them. `budget_bytes`: of sections that are being made, until
    /// they are packed.
    pub fn new(made: impl Into<Made>, grid: Grid, budget_bytes: u64) -> Builds {
        let Made { surface, reading } = made.into();
        Builds {
            grid,
            surface,
            reading: Arc::new(reading),
            sources: Vec::new(),
            chunks: Vec::new(),
            builds: HashMap::new(),
            order: Vec::new(),
            budget_bytes,
            revision: 0,
            finished: VecDeque::new(),
            waiting_bytes: 0,
            in_transit: HashSet::new(),
            errors: Vec::new(),
            warnings: Vec::new(),
            corrected: Vec::new(),
            forgotten: Vec::new(),
            progress: Progress::default(),
            counted: 0,
        }
    }

    /// Adds a file; gives its number.
    pub fn add(&mut self, input: OpenInput) -> usize {
        let source = self.sources.len();
        let first = self.chunks.len() as u32;
        let (file, chunks) = self.source(source, first, input);
        self.progress.points += file.input.file.points();
        self.progress.chunks += chunks.len() as u64;
        self.progress.chunks_known += known(&chunks);
        self.chunks.extend(chunks);
        self.sources.push(file);
        self.changed(source);
        source
    }

    /// Another file in the place of one, and under its number; shown if that was.
    pub fn replace(&mut self, source: usize, input: OpenInput) {
        // What it touched, and below what it touches now; in between nothing is begun that lacks its old chunks.
        self.drop_touched(source);
        let of_old = self.chunks_of(source);
        let fits = input.input.file.chunks.len() <= of_old.len();
        let first = if fits { of_old.start } else { self.chunks.len() as u32 };
        let (file, chunks) = self.source(source, first, input);
        let file = Source { visible: self.sources[source].visible, ..file };
        if file.visible {
            self.progress.points -= self.sources[source].input.file.points();
            self.progress.points += file.input.file.points();
        }
        self.progress.chunks = self.progress.chunks + chunks.len() as u64 - of_old.len() as u64;
        let old = &self.chunks[of_old.start as usize..of_old.end as usize];
        self.progress.chunks_known = self.progress.chunks_known + known(&chunks) - known(old);
        if fits {
            self.chunks[first as usize..first as usize + chunks.len()].swap_with_slice(&mut { chunks }[..]);
        } else {
            self.chunks.extend(chunks);
        }
        self.sources[source] = file;
        self.changed(source);
    }

    /// A file and its chunks, of which the first is to be `first`.
    fn source(&self, source: usize, first: u32, open: OpenInput) -> (Source, Vec<Chunk>) {
        let OpenInput {
            input,
            bounds,
            reach,
            in_nodes,
            known,
            kinds,
            hull: _,
            hull_of_all: _,
            system: _,
            is_in_frame: _,
        } = open;
        let SeenKinds { sampled, kept, selected } = kinds;
        let selected = selected.filter(|(selection, _)| *selection == self.reading.selection);
        let selected = self.counts_of_selected(input.file.points(), selected.map(|(_, seen)| seen));
        let counts = FileCounts::new(input.file.points(), sampled, kept);
        let grid = self.grid;
        let extent = bounds.and_then(|b| {
            let [low, high] = cells_of(&grid, b.min, b.max)?;
            Some(Extent { low, high, up: [b.min.z, b.max.z] })
        });
        let file = &input.file;
        let mut chunks = Vec::with_capacity(file.chunks.len());
        for chunk in &file.chunks {
            let known = known.of(chunk);
            let node = || {
                let [low, high] = file.chunk_bounds(chunk).filter(|_| in_nodes)?;
                let [low, high] = input.placement.bounds(low, high)?;
                Some((Told::File, cells_of(&grid, low, high)?))
            };
            let cells = known.and_then(|(told, bounds)| Some((told, cells_of_raw(&grid, &input, &bounds)?)));
            let cells = cells.or_else(node).map(|(told, cells)| (told, around(cells)));
            let learned = known.filter(|(told, _)| *told == Told::Cache).map(|(_, bounds)| bounds);
            let source = source as u32;
            chunks.push(Chunk {
                source,
                cells,
                learned,
                busy: false,
                broken: false,
                is_told: false,
                is_counted: false,
                is_selected_counted: false,
                lacked_by: 0,
            });
        }
        let source = Source {
            input: Arc::new(input),
            reach: reach.and_then(|b| cells_of(&grid, b.min, b.max)).map(around),
            extent,
            visible: true,
            lost: false,
            first,
            busy: 0,
            has_learned: false,
            counts,
            selected,
        };
        (source, chunks)
    }

    /// What is counted of the points that take part, of so many; `None`: all do.
    fn counts_of_selected(&self, points: u64, seen: Option<SampledKinds>) -> Option<FileCounts> {
        let is_all = self.reading.selection.is_all();
        (!is_all).then(|| FileCounts::new(points, seen.unwrap_or_default(), Default::default()))
    }

    /// Other points take part, or their records hold something else: every section is to be rebuilt.
    pub fn set_reading(&mut self, reading: Reading) {
        let is_other = reading.selection != self.reading.selection;
        self.reading = Arc::new(reading);
        self.revision += 1;
        if is_other {
            for source in 0..self.sources.len() {
                let points = self.sources[source].input.file.points();
                self.sources[source].selected = self.counts_of_selected(points, None);
            }
            self.chunks.iter_mut().for_each(|chunk| chunk.is_selected_counted = false);
            self.counted += 1;
        }
        let all: Vec<_> = self.builds.keys().copied().collect();
        all.into_iter().for_each(|key| self.drop_build(key));
        self.in_transit.clear();
        let bytes: u64 = self.finished.drain(..).map(|finished| finished.bytes).sum();
        self.waiting_bytes -= bytes;
        self.admit();
    }

    /// Which points take part, and what their records hold.
    pub fn reading(&self) -> &Arc<Reading> {
        &self.reading
    }

    /// Shows or hides a file.
    pub fn set_visible(&mut self, source: usize, shown: bool) {
        if self.sources[source].visible == shown {
            return;
        }
        self.sources[source].visible = shown;
        let points = self.sources[source].input.file.points();
        self.progress.points =
            if shown { self.progress.points + points } else { self.progress.points - points };
        self.changed(source);
    }

    /// Sections that a file touches are to be rebuilt.
    fn changed(&mut self, source: usize) {
        self.drop_touched(source);
        self.admit();
    }

    /// No section that a file touches is being made any more.
    fn drop_touched(&mut self, source: usize) {
        self.revision += 1;
        let touched: Vec<_> =
            self.builds.keys().copied().filter(|&key| self.touches(source, key.section)).collect();
        touched.into_iter().for_each(|key| self.drop_build(key));
        let out = std::mem::take(&mut self.in_transit);
        self.in_transit = out.into_iter().filter(|&key| !self.touches(source, key.section)).collect();
    }

    /// Whether a file may have points in a section.
    pub fn touches(&self, source: usize, key: SectionKey) -> bool {
        self.reaches(source, key) && self.chunks_of(source).any(|chunk| self.may_hold(chunk, key))
    }

    fn reaches(&self, source: usize, key: SectionKey) -> bool {
        self.sources[source].reach.is_none_or(|[low, high]| key.touches(low, high))
    }

    fn chunks_of(&self, source: usize) -> std::ops::Range<u32> {
        let source = &self.sources[source];
        source.first..source.first + source.input.file.chunks.len() as u32
    }

    fn may_hold(&self, chunk: u32, key: SectionKey) -> bool {
        self.chunks[chunk as usize].cells.is_none_or(|(_, [low, high])| key.touches(low, high))
    }

    /// The files.
    pub fn sources(&self) -> &[Source] {
        &self.sources
    }

    /// Changes to the set of files since the start.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// What is wanted from now on, most urgent first. What is not wanted any more is kept while there is room.
    pub fn request(&mut self, order: Vec<PayloadKey>) {
        debug_assert!(order.iter().all(|key| key.kind == PayloadKind::Columns), "samples are not requested");
        self.order = order;
        self.admit();
    }

    fn bytes(&self) -> u64 {
        self.waiting_bytes
            + self.builds.values().map(|build| build.bytes.max(LIMITS.section_bytes)).sum::<u64>()
    }

    fn drop_build(&mut self, key: PayloadKey) {
        for chunk in self.builds.remove(&key).iter().flat_map(|build| &build.lacks) {
            self.chunks[chunk as usize].let_go(&mut self.progress.lacking);
        }
    }

    /// Starts what is wanted, as far as there is room.
    fn admit(&mut self) {
        let mut bytes = self.bytes();
        let mut tidied = false;
        for key in self.order.clone() {
            if self.builds.contains_key(&key) || self.in_transit.contains(&key) {
                continue;
            }
            if bytes + LIMITS.section_bytes > self.budget_bytes && !std::mem::replace(&mut tidied, true) {
                let wanted: HashSet<_> = self.order.iter().copied().collect();
                let unwanted: Vec<_> =
                    self.builds.keys().copied().filter(|key| !wanted.contains(key)).collect();
                unwanted.into_iter().for_each(|key| self.drop_build(key));
                bytes = self.bytes();
            }
            // One is always made, or nothing would ever be.
            if bytes + LIMITS.section_bytes > self.budget_bytes && bytes > 0 {
                break;
            }
            bytes += LIMITS.section_bytes;
            self.start(key);
        }
    }

    fn start(&mut self, key: PayloadKey) {
        let mut lacks = Vec::new();
        let mut damaged = false;
        for source in
            (0..self.sources.len()).filter(|&s| self.sources[s].visible && self.reaches(s, key.section))
        {
            let touching = self.chunks_of(source).filter(|&chunk| self.may_hold(chunk, key.section));
            if self.sources[source].lost {
                damaged |= touching.count() > 0;
                continue;
            }
            let touching: Vec<_> = touching.collect();
            damaged |= touching.iter().any(|&chunk| self.chunks[chunk as usize].broken);
            lacks.extend(touching);
        }
        let lacks: RoaringBitmap = lacks.into_iter().collect();
        for chunk in &lacks {
            let chunk = &mut self.chunks[chunk as usize];
            self.progress.lacking += u64::from(chunk.lacked_by == 0);
            chunk.lacked_by += 1;
        }
        let columns = bins::columns(self.surface, &self.reading.channel, &self.grid, key.section.level);
        let columns = Arc::new(Mutex::new(columns));
        self.builds.insert(key, Build { columns, lacks, bytes: 0, damaged });
        self.finish_if_whole(key);
    }

    fn finish_if_whole(&mut self, key: PayloadKey) {
        if self.builds.get(&key).is_some_and(|build| build.lacks.is_empty()) {
            let Build { columns, damaged, bytes, .. } = self.builds.remove(&key).expect("just seen");
            self.order.retain(|other| *other != key);
            self.in_transit.insert(key);
            self.waiting_bytes += bytes;
            self.finished.push_back(Finished { key, columns, damaged, revision: self.revision, bytes });
        }
    }

    /// Bytes of the section that [`Builds::take_finished`] gives next.
    pub fn next_finished(&self) -> Option<u64> {
        self.finished.front().map(|finished| finished.bytes)
    }

    /// The columns of a finished section, which took so many bytes, are gone: there is room for others.
    pub fn release_columns(&mut self, bytes: u64) {
        self.waiting_bytes -= bytes;
        self.admit();
    }

    /// A section that is finished, once.
    pub fn take_finished(&mut self) -> Option<Finished> {
        self.finished.pop_front()
    }

    /// A finished section has reached whoever wanted it.
    pub fn received(&mut self, key: PayloadKey) {
        self.in_transit.remove(&key);
        // Whoever asked before it arrived has it now; else it is asked for again.
        self.order.retain(|wanted| *wanted != key);
    }

    /// The chunk that the most urgent section lacks.
    pub fn next_job(&mut self) -> Option<Job> {
        let free = |key: &PayloadKey| {
            let lacks = &self.builds.get(key)?.lacks;
            lacks.into_iter().find(|&chunk| !self.chunks[chunk as usize].busy)
        };
        let chunk = self.order.iter().find_map(free)?;
        self.chunks[chunk as usize].busy = true;
        let source = &mut self.sources[self.chunks[chunk as usize].source as usize];
        source.busy += 1;
        let targets = self
            .builds
            .iter()
            .filter(|(_, build)| build.lacks.contains(chunk))
            .map(|(&key, build)| (key, Arc::clone(&build.columns)))
            .collect();
        let state = &self.chunks[chunk as usize];
        let counts = !if source.selected.is_some() { state.is_selected_counted } else { state.is_counted };
        let reading = Arc::clone(&self.reading);
        let index = (chunk - source.first) as usize;
        Some(Job { chunk, input: Arc::clone(&source.input), index, targets, counts, reading })
    }

    /// Takes in what came of a job.
    pub fn finish_job(&mut self, job: Job, outcome: Outcome) {
        let Job { chunk, input, index, targets, counts: _, reading } = job;
        self.progress.points_read += outcome.points;
        self.progress.bytes_read += input.file.chunks[index].byte_len;
        let state = &mut self.chunks[chunk as usize];
        let source = state.source as usize;
        if !Arc::ptr_eq(&input, &self.sources[source].input) {
            // Another file is in its place by now.
            return;
        }
        state.busy = false;
        if outcome.nowhere > 0 && !std::mem::replace(&mut state.is_told, true) {
            let (path, points) = (input.file.path().display(), outcome.nowhere);
            let are = if points == 1 { "point is" } else { "points are" };
            self.warnings.push(format!(
                "{path}: chunk {index}: {points} {are} not drawn: no place in the picture's coordinate system, or beyond what a height or cell can be"
            ));
        }
        let lost = matches!(outcome.error, Some(SourceError::Io { .. } | SourceError::Changed { .. }));
        let broken = outcome.error.is_some();
        // Of a damaged chunk there is no more than was read; one of a file that is lost may be there again.
        let is_of_now = reading.selection == self.reading.selection;
        if let Some(kinds) = outcome.kinds.filter(|_| !lost && is_of_now) {
            let (of_file, records) = (&mut self.sources[source], input.file.chunks[index].records);
            if let Some(selected) = &mut of_file.selected {
                if !std::mem::replace(&mut state.is_selected_counted, true) {
                    selected.count(records, kinds);
                }
            } else if !std::mem::replace(&mut state.is_counted, true) {
                of_file.counts.count(records, kinds);
                of_file.has_learned |= of_file.counts.news().is_some();
            }
            self.counted += 1;
        }
        if let Some(error) = outcome.error {
            // A file that vanished or changed, or a disk that fails, is named once, not once a chunk.
            let known = lost && std::mem::replace(&mut self.sources[source].lost, true);
            if !known && !state.broken {
                self.errors.push(error.to_string());
            }
            state.broken = true;
        }
        self.sources[source].busy -= 1;
        if self.sources[source].busy == 0 {
            input.file.bytes.release();
        }
        if let Some(bounds) = outcome.bounds {
            let cells = self.compare(chunk, &bounds);
            if !broken {
                self.learn(chunk, bounds, cells);
            }
        }
        let gone = if lost { self.chunks_of(source) } else { chunk..chunk + 1 };
        let cells = self.chunks[chunk as usize].cells.map(|(_, cells)| cells);
        let mut touched = Vec::new();
        for (&key, build) in &mut self.builds {
            let served =
                targets.iter().any(|(of, columns)| *of == key && Arc::ptr_eq(columns, &build.columns));
            if served {
                build.bytes = bins::lock(&build.columns).bytes() as u64;
            }
            let outside = cells.is_some_and(|[low, high]| !key.section.touches(low, high));
            let mut ends = RoaringBitmap::new();
            if lost {
                // Others may be writing: what they read ends by itself.
                let is_over = |c: &u32| *c == chunk || !self.chunks[*c as usize].busy;
                ends.extend(build.lacks.range(gone.clone()).filter(is_over));
            } else if (served || outside) && build.lacks.contains(chunk) {
                ends.insert(chunk);
            }
            build.lacks -= &ends;
            for chunk in &ends {
                self.chunks[chunk as usize].let_go(&mut self.progress.lacking);
            }
            if !ends.is_empty() {
                build.damaged |= broken && (lost || served);
                touched.push(key);
            }
        }
        drop(targets);
        touched.into_iter().for_each(|key| self.finish_if_whole(key));
        if self.bytes() > self.budget_bytes {
            self.make_room();
        }
        self.admit();
    }

    /// Compares points of a chunk with what is believed of it: whoever is wrong is not believed any more. Gives the cells
    /// that hold them.
    fn compare(&mut self, chunk: u32, bounds: &RawBounds) -> Option<Cells> {
        let source = self.chunks[chunk as usize].source as usize;
        let cells = cells_of_raw(&self.grid, &self.sources[source].input, bounds)?;
        // Two may be wrong.
        while let Some(told) = self.contradicted(chunk, cells) {
            self.distrust(source, told);
        }
        Some(cells)
    }

    /// Who says that a chunk has no points in some of these cells.
    fn contradicted(&self, chunk: u32, cells: Cells) -> Option<Told> {
        let state = &self.chunks[chunk as usize];
        let of_chunk = state.cells.filter(|(_, known)| reaches_out(cells, *known)).map(|(told, _)| told);
        let reach = self.sources[state.source as usize].reach;
        of_chunk.or_else(|| reach.filter(|known| reaches_out(cells, *known)).map(|_| Told::File))
    }

    /// Forgets what was told of a file; what it touches is to be rebuilt.
    fn distrust(&mut self, source: usize, told: Told) {
        let path = self.sources[source].input.file.path().display();
        let line = format!("{path}: {}", told.contradicted());
        match told {
            Told::File | Told::Points => self.errors.push(line),
            Told::Index | Told::Cache => self.warnings.push(line),
        }
        if told == Told::File {
            self.sources[source].reach = None;
        }
        let of_source = self.chunks_of(source);
        for chunk in &mut self.chunks[of_source.start as usize..of_source.end as usize] {
            if chunk.cells.is_some_and(|(by, _)| by == told) {
                chunk.cells = None;
                self.progress.chunks_known -= 1;
                chunk.learned = chunk.learned.filter(|_| told != Told::Cache && told != Told::Points);
            }
        }
        if told == Told::Cache {
            self.sources[source].counts.disbelieve();
            self.forgotten.push(source);
        }
        self.changed(source);
        self.corrected.push(source);
    }

    /// Keeps the bounds of a chunk that was read whole.
    fn learn(&mut self, chunk: u32, bounds: RawBounds, cells: Option<Cells>) {
        let state = &mut self.chunks[chunk as usize];
        self.progress.chunks_known += u64::from(state.cells.is_none() && cells.is_some());
        state.cells = cells.map(|cells| (Told::Points, cells)).or(state.cells);
        if state.learned.replace(bounds) != Some(bounds) {
            self.sources[state.source as usize].has_learned = true;
        }
    }

    /// Compares some points of each of these chunks of a file with what is believed.
    pub fn check_sample(&mut self, source: usize, seen: &[(usize, RawBounds)]) {
        let first = self.sources[source].first;
        for (index, bounds) in seen {
            self.compare(first + *index as u32, bounds);
        }
    }

    /// Points of these kinds that take part were seen in a file.
    pub fn note_kinds(&mut self, source: usize, kinds: &Kinds) {
        let source = &mut self.sources[source];
        source.selected.as_mut().unwrap_or(&mut source.counts).note(kinds);
        self.counted += 1;
    }

    /// What the points of the files that are shown are, as far as they take part, and a number that changes with that; `None` where it is still
    /// `known`.
    pub fn kinds(&self, known: Option<[u64; 2]>) -> Option<([u64; 2], KindCounts)> {
        let version = [self.revision, self.counted];
        let shown = || self.sources.iter().filter(|source| source.visible).map(Source::now);
        (known != Some(version)).then(|| (version, counts::of_all(shown())))
    }

    /// Files of which something was learned since this was asked last, with all that is known of their chunks, and what was
    /// counted of them if that is all of it.
    pub fn take_learned(&mut self) -> Vec<Learned> {
        let mut learned = Vec::new();
        for source in 0..self.sources.len() {
            if std::mem::take(&mut self.sources[source].has_learned) {
                let bounds =
                    self.chunks_of(source).map(|chunk| self.chunks[chunk as usize].learned).collect();
                let Source { input, counts, .. } = &self.sources[source];
                let kinds = counts.news().cloned().unwrap_or_default();
                learned.push(Learned { input: Arc::clone(input), bounds, kinds });
            }
        }
        learned
    }

    /// Files of which wrong bounds were kept, since this was asked last.
    pub fn take_forgotten(&mut self) -> Vec<Arc<Input>> {
        let forgotten = std::mem::take(&mut self.forgotten);
        forgotten.into_iter().map(|source| Arc::clone(&self.sources[source].input)).collect()
    }

    /// The least urgent ones go.
    fn make_room(&mut self) {
        let rank: HashMap<_, _> = self.order.iter().zip(0usize..).collect();
        let mut last: Vec<_> =
            self.builds.keys().map(|key| (rank.get(key).copied().unwrap_or(usize::MAX), *key)).collect();
        last.sort_unstable();
        while self.bytes() > self.budget_bytes
            && self.builds.len() > 1
            && let Some((_, key)) = last.pop()
        {
            self.drop_build(key);
        }
    }

    /// Files whose points turned out to lie elsewhere than was believed: what they touch is to be rebuilt.
    pub fn take_corrected(&mut self) -> Vec<usize> {
        std::mem::take(&mut self.corrected)
    }

    /// What went wrong since this was asked last.
    pub fn take_errors(&mut self) -> Vec<String> {
        std::mem::take(&mut self.errors)
    }

    /// What is not as it should be, since this was asked last.
    pub fn take_warnings(&mut self) -> Vec<String> {
        std::mem::take(&mut self.warnings)
    }

    /// How far it is.
    pub fn progress(&self) -> Progress {
        let shown = self.sources.iter().filter(|source| source.visible);
        Progress {
            points_seen: shown.map(|source| source.input.file.points() - source.now().left()).sum(),
            builds: self.builds.len() as u64,
            build_bytes: self.waiting_bytes + self.builds.values().map(|build| build.bytes).sum::<u64>(),
            ..self.progress
        }
    }
}
