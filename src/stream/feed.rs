//! Threads that read what is wanted: chunks into sections, finished sections into packed ones.

use super::bins::{Binner, Core, Shared, lock};
use super::builds::{Builds, Finished, Job, Outcome, Progress};
use super::workers::Input;
use crate::coords::{Grid, SectionKey};
use crate::section::Packed;
use crate::source::known::RawBounds;
use crate::source::learned::Cache;
use crate::source::{Decoder, LidarFile, PointBlock};
use crossbeam_channel::{Receiver, Sender};
use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use thread_priority::{ThreadPriority, set_current_thread_priority};

/// Packed sections that wait to be taken.
const QUEUE: usize = 16;
/// Points of the sparse sample, about.
const SAMPLE_POINTS: usize = 1 << 17;
/// Most records of a chunk of LAS in the sample.
const RECORDS_OF_A_CHUNK: u64 = 256;
/// What was learned is kept so often: a process that is killed loses no more.
const KEEP_EVERY: Duration = Duration::from_secs(20);

/// A finished section.
pub struct Arrival {
    /// Which one.
    pub key: SectionKey,
    /// Its words; `None`: it holds no point.
    pub packed: Option<Packed>,
    /// Some of its points could not be read.
    pub damaged: bool,
    /// Changes to the set of files that it knows of; see [`Builds::change`].
    pub change: u64,
    /// It is of the sparse sample.
    pub sparse: bool,
}

/// The sparse sample, while it is taken.
struct Sample {
    level: u8,
    /// Points wanted of a file.
    of_file: usize,
    /// Files left, the next one last.
    left: Vec<usize>,
    /// Files that are being read.
    busy: usize,
    sections: Arc<Mutex<HashMap<SectionKey, Shared>>>,
    change: u64,
}

struct State {
    /// Nothing more is begun.
    paused: bool,
    builds: Builds,
    core: Arc<Core>,
    sample: Option<Sample>,
    /// Where it is kept what was learned, and when that was done last.
    cache: Option<(Arc<Cache>, Instant)>,
}

struct Inner {
    state: Mutex<State>,
    /// There may be something to do.
    work: Condvar,
    stop: AtomicBool,
    grid: Grid,
}

impl Inner {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What a thread does next.
enum Task {
    Sample {
        source: usize,
        input: Arc<Input>,
        level: u8,
        of_file: usize,
        sections: Arc<Mutex<HashMap<SectionKey, Shared>>>,
    },
    Chunk(Job),
    Pack(Finished),
}

/// The threads. Dropped, they end.
pub struct Feed {
    inner: Arc<Inner>,
    threads: Vec<JoinHandle<()>>,
    arrivals: Receiver<Arrival>,
}

/// [`Grid`] whose cells are those of a detail level.
fn grid_at(grid: &Grid, level: u8) -> Grid {
    Grid {
        coarsen: grid.coarsen + u32::from(level),
        anchor: grid.anchor.map(|anchor| anchor >> level),
        ..*grid
    }
}

impl Feed {
    /// Starts `threads` threads; `wake` is called when something has arrived.
    pub fn new(
        builds: Builds,
        grid: Grid,
        core: Core,
        threads: usize,
        wake: impl Fn() + Send + Sync + 'static,
    ) -> Feed {
        let inner = Arc::new(Inner {
            state: Mutex::new(State {
                paused: false,
                builds,
                core: Arc::new(core),
                sample: None,
                cache: None,
            }),
            work: Condvar::new(),
            stop: AtomicBool::new(false),
            grid,
        });
        let (send, arrivals) = crossbeam_channel::bounded(QUEUE);
        let wake: Arc<dyn Fn() + Send + Sync> = Arc::new(wake);
        let threads = (0..threads.max(1))
            .map(|_| {
                let (inner, send, wake) = (Arc::clone(&inner), send.clone(), Arc::clone(&wake));
                std::thread::spawn(move || work(&inner, &send, &*wake))
            })
            .collect();
        Feed { inner, threads, arrivals }
    }

    /// Points outside of these cells are left out from now on.
    pub fn set_core(&self, core: Core) {
        self.inner.lock().core = Arc::new(core);
    }

    /// Keeps what is learned of files there, now and then and at the end.
    pub fn keep_learned(&self, cache: Cache) {
        self.inner.lock().cache = Some((Arc::new(cache), Instant::now()));
    }

    /// Looks at, or changes, what is being made.
    pub fn with<R>(&self, look: impl FnOnce(&mut Builds) -> R) -> R {
        let result = look(&mut self.inner.lock().builds);
        self.inner.work.notify_all();
        result
    }

    /// Takes the sparse sample of all files that are shown, into sections of `level`.
    pub fn sample(&self, level: u8) {
        let mut state = self.inner.lock();
        let sources = state.builds.sources();
        let left: Vec<_> = (0..sources.len()).rev().filter(|&source| sources[source].shown).collect();
        let of_file = (SAMPLE_POINTS / left.len().max(1)).max(1);
        let change = state.builds.change();
        state.sample = Some(Sample { level, of_file, left, busy: 0, sections: Arc::default(), change });
        drop(state);
        self.inner.work.notify_all();
    }

    /// Begins nothing more, or goes on.
    pub fn pause(&self, paused: bool) {
        self.inner.lock().paused = paused;
        self.inner.work.notify_all();
    }

    /// What has arrived.
    pub fn try_take(&self) -> Option<Arrival> {
        self.arrivals.try_recv().ok()
    }

    /// Whether no sparse sample is being taken.
    pub fn is_sampled(&self) -> bool {
        self.inner.lock().sample.as_ref().is_none_or(|sample| sample.left.is_empty() && sample.busy == 0)
    }

    /// Waits for what arrives next.
    pub fn take(&self, timeout: Duration) -> Option<Arrival> {
        self.arrivals.recv_timeout(timeout).ok()
    }

    /// How far it is.
    pub fn progress(&self) -> Progress {
        self.inner.lock().builds.progress()
    }
}

impl Drop for Feed {
    fn drop(&mut self) {
        {
            // Under the lock, so that no thread is between looking and waiting.
            let _state = self.inner.lock();
            self.inner.stop.store(true, Ordering::Relaxed);
        }
        self.inner.work.notify_all();
        // A thread may be sending.
        let (_, closed) = crossbeam_channel::bounded(0);
        drop(std::mem::replace(&mut self.arrivals, closed));
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
        let mut state = self.inner.lock();
        if let Some((cache, _)) = state.cache.take() {
            let learned = state.builds.take_learned();
            drop(state);
            keep(&cache, &learned);
        }
    }
}

fn next(inner: &Inner) -> Option<Task> {
    let mut state = inner.lock();
    loop {
        if inner.stop.load(Ordering::Relaxed) {
            return None;
        }
        if state.paused {
            state = inner.work.wait(state).unwrap_or_else(PoisonError::into_inner);
            continue;
        }
        let State { builds, sample, .. } = &mut *state;
        if let Some(sample) = sample
            && let Some(source) = sample.left.pop()
        {
            sample.busy += 1;
            let input = Arc::clone(&builds.sources()[source].input);
            let sections = Arc::clone(&sample.sections);
            let (level, of_file) = (sample.level, sample.of_file);
            return Some(Task::Sample { source, input, level, of_file, sections });
        }
        if let Some(finished) = builds.take_finished() {
            return Some(Task::Pack(finished));
        }
        if let Some(job) = builds.next_job() {
            return Some(Task::Chunk(job));
        }
        state = inner.work.wait(state).unwrap_or_else(PoisonError::into_inner);
    }
}

fn work(inner: &Inner, send: &Sender<Arrival>, wake: &dyn Fn()) {
    // Frames come first (thesis, §3.3.5). Where that is not allowed they share.
    let _ = set_current_thread_priority(ThreadPriority::Min);
    let (mut decoder, mut binner) = (Decoder::default(), Binner::default());
    while let Some(task) = next(inner) {
        let core = Arc::clone(&inner.lock().core);
        let mut packs = Vec::new();
        match task {
            Task::Pack(finished) => packs.push((finished, false)),
            Task::Chunk(job) => {
                let outcome = read(&inner.grid, &core, &mut decoder, &mut binner, &job);
                inner.lock().builds.done(job, outcome);
                inner.work.notify_all();
                look_after(inner);
            }
            Task::Sample { source, input, level, of_file, sections } => {
                // What cannot be read is named when it is read for good.
                let mut seen = Vec::new();
                let _ = sparse(
                    (&grid_at(&inner.grid, level), level),
                    &core,
                    &mut decoder,
                    &mut binner,
                    &input,
                    of_file,
                    &sections,
                    &mut seen,
                );
                input.file.bytes.release();
                let mut state = inner.lock();
                state.builds.saw(source, &seen);
                if let Some(sample) = &mut state.sample
                    && Arc::ptr_eq(&sample.sections, &sections)
                {
                    sample.busy -= 1;
                    if sample.busy == 0 && sample.left.is_empty() {
                        let sample = state.sample.take().expect("just seen");
                        packs.extend(lock(&sample.sections).drain().map(|(key, columns)| {
                            (Finished { key, columns, damaged: false, change: sample.change }, true)
                        }));
                    }
                }
                drop(state);
                look_after(inner);
            }
        }
        for (Finished { key, columns, damaged, change }, sparse) in packs {
            let columns = lock(&columns);
            let packed = (columns.points() > 0).then(|| columns.pack());
            drop(columns);
            if send.send(Arrival { key, packed, damaged, change, sparse }).is_err() {
                return;
            }
            wake();
        }
    }
}

/// Forgets and keeps, where it is time.
fn look_after(inner: &Inner) {
    let mut state = inner.lock();
    let State { builds, cache: Some((cache, kept)), .. } = &mut *state else { return };
    let forgotten = builds.take_forgotten();
    let is_time = kept.elapsed() > KEEP_EVERY;
    let learned = if is_time { builds.take_learned() } else { Vec::new() };
    if is_time {
        *kept = Instant::now();
    }
    let cache = Arc::clone(cache);
    drop(state);
    forgotten.iter().for_each(|input| cache.forget(&input.file));
    keep(&cache, &learned);
}

/// Keeps what was learned. What cannot be kept is learned again.
fn keep(cache: &Cache, learned: &[(Arc<Input>, Vec<Option<RawBounds>>)]) {
    let kept = learned.iter().try_for_each(|(input, bounds)| cache.save(&input.file, bounds));
    if let Err(error) = kept.and_then(|()| if learned.is_empty() { Ok(()) } else { cache.tidy() }) {
        tracing::debug!("what was learned of files cannot be kept: {error}");
    }
}

/// Reads a chunk into all that lack it.
fn read(grid: &Grid, core: &Core, decoder: &mut Decoder, binner: &mut Binner, job: &Job) -> Outcome {
    let file = &job.input.file;
    let chunk = &file.chunks[job.index];
    let mut levels: HashMap<u8, HashMap<SectionKey, &Shared>> = HashMap::new();
    for (key, columns) in &job.targets {
        levels.entry(key.level).or_default().insert(SectionKey { level: 0, ..*key }, columns);
    }
    let levels: Vec<_> =
        levels.into_iter().map(|(level, of_level)| (grid_at(grid, level), of_level)).collect();
    let mut outcome = Outcome::default();
    let mut raw = RawBounds::NOTHING;
    let result = decoder.decode(file, chunk, 0..chunk.records, &mut |block: &PointBlock| {
        outcome.points += block.len() as u64;
        for (axis, values) in [&block.x, &block.y, &block.z].into_iter().enumerate() {
            raw.widen(axis, values);
        }
        for (grid, of_level) in &levels {
            binner
                .bin_into(grid, core, &*job.input, block, &|key| of_level.get(&key).map(|&s| Arc::clone(s)));
        }
    });
    outcome.bounds = raw.is_sound().then_some(raw);
    outcome.error = result.err();
    outcome
}

/// Records of a chunk that a sample of `most` points of a file takes: of LAS, any can be read alone, of others the
/// first is stored raw.
fn sparse_of_chunk(file: &LidarFile, most: usize) -> u64 {
    if file.header.compressed {
        return 1;
    }
    (most / file.chunks.len().max(1)).clamp(1, RECORDS_OF_A_CHUNK as usize) as u64
}

/// Points in the sparse sample of such files.
pub fn sparse_points<'a>(files: impl Iterator<Item = &'a LidarFile> + Clone) -> u64 {
    let most = (SAMPLE_POINTS / files.clone().count().max(1)).max(1);
    let of_file = |file: &LidarFile| {
        (file.chunks.len().min(most) as u64 * sparse_of_chunk(file, most)).min(file.points())
    };
    files.map(of_file).sum()
}

/// Reads a few points of every chunk of a file; `seen`: their bounds, by chunk.
fn sparse(
    (grid, level): (&Grid, u8),
    core: &Core,
    decoder: &mut Decoder,
    binner: &mut Binner,
    input: &Input,
    most: usize,
    sections: &Mutex<HashMap<SectionKey, Shared>>,
    seen: &mut Vec<(usize, RawBounds)>,
) -> Result<(), crate::source::SourceError> {
    let file = &input.file;
    if file.chunks.is_empty() {
        return Ok(());
    }
    let of_chunk = sparse_of_chunk(file, most);
    let stride = if of_chunk == 1 { Decoder::stride_of_firsts(file, most) } else { 1 };
    let mut chunk_of_point = file.chunks.iter().enumerate().step_by(stride).flat_map(|(index, chunk)| {
        std::iter::repeat_n(index, if of_chunk == 1 { 1 } else { of_chunk.min(chunk.records) as usize })
    });
    let mut bin = |block: &PointBlock| {
        for (i, index) in (0..block.len()).zip(&mut chunk_of_point) {
            if seen.last().is_none_or(|(last, _)| *last != index) {
                seen.push((index, RawBounds::NOTHING));
            }
            let (_, bounds) = seen.last_mut().expect("just pushed");
            [block.x[i], block.y[i], block.z[i]]
                .iter()
                .enumerate()
                .for_each(|(axis, v)| bounds.widen(axis, &[*v]));
        }
        let section = |key: SectionKey| {
            let key = SectionKey { level, ..key };
            Some(Arc::clone(lock(sections).entry(key).or_default()))
        };
        binner.bin_into(grid, core, input, block, &section);
    };
    match of_chunk {
        1 => bin(decoder.first_points(file, most)?),
        of_chunk => decoder.sparse_records(file, of_chunk, &mut bin)?,
    }
    Ok(())
}
