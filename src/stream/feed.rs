//! Threads that read what is wanted: chunks into sections, finished sections into packed ones.
//!
//! The threads have the lowest priority, so one that holds the lock may not run for a while. What a frame tells them goes
//! by letter therefore, and what they tell it by channels: a frame never waits for them.

use super::bins::{Binner, Core, Shared, lock};
use super::builds::{Builds, Finished, Job, Outcome, Progress, cells_of, placed};
use super::workers::Input;
use crate::coords::{Grid, SectionKey};
use crate::section::Packed;
use crate::source::{Decoder, LidarFile, PointBlock};
use crossbeam_channel::{Receiver, Sender};
use glam::DVec3;
use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, TryLockError};
use std::thread::JoinHandle;
use std::time::Duration;
use thread_priority::{ThreadPriority, set_current_thread_priority};

/// Packed sections that wait to be taken.
const QUEUE: usize = 16;
/// Points of the sparse sample, about.
const SAMPLE_POINTS: usize = 1 << 17;
/// Most records of a chunk of LAS in the sample.
const RECORDS_OF_A_CHUNK: u64 = 256;

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
}

/// What frames tell the threads.
enum Letter {
    /// See [`Builds::want`].
    Want(Vec<SectionKey>),
    /// See [`Builds::taken`].
    Taken(SectionKey),
}

/// What the threads tell frames.
enum News {
    /// Something went wrong.
    Error(String),
    /// See [`Builds::take_corrected`].
    Corrected(usize),
}

struct Inner {
    state: Mutex<State>,
    /// There may be something to do.
    work: Condvar,
    stop: AtomicBool,
    grid: Grid,
    /// Not read yet.
    letters: Receiver<Letter>,
    news: Sender<News>,
    /// No sparse sample is being taken.
    sampled: AtomicBool,
}

impl Inner {
    /// The state as all letters have made it.
    fn lock(&self) -> MutexGuard<'_, State> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        self.read_letters(&mut state);
        state
    }

    fn read_letters(&self, state: &mut State) {
        let mut order = None;
        for letter in self.letters.try_iter() {
            match letter {
                Letter::Want(keys) => order = Some(keys),
                Letter::Taken(key) => state.builds.taken(key),
            }
        }
        if let Some(order) = order {
            state.builds.want(order);
            self.work.notify_all();
        }
    }

    /// Tells frames what has come up.
    fn report(&self, builds: &mut Builds) {
        let errors = builds.take_errors().into_iter().map(News::Error);
        for news in errors.chain(builds.take_corrected().into_iter().map(News::Corrected)) {
            // Nobody may be left to hear it.
            let _ = self.news.send(news);
        }
    }
}

/// What a thread does next.
enum Task {
    Sample { input: Arc<Input>, level: u8, of_file: usize, sections: Arc<Mutex<HashMap<SectionKey, Shared>>> },
    Chunk(Job),
    Pack(Finished),
}

/// The threads. Dropped, they end.
pub struct Feed {
    inner: Arc<Inner>,
    threads: Vec<JoinHandle<()>>,
    arrivals: Receiver<Arrival>,
    letters: Sender<Letter>,
    news: Receiver<News>,
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
        let (letters, read) = crossbeam_channel::unbounded();
        let (tell, news) = crossbeam_channel::unbounded();
        let inner = Arc::new(Inner {
            state: Mutex::new(State { paused: false, builds, core: Arc::new(core), sample: None }),
            work: Condvar::new(),
            stop: AtomicBool::new(false),
            grid,
            letters: read,
            news: tell,
            sampled: AtomicBool::new(true),
        });
        let (send, arrivals) = crossbeam_channel::bounded(QUEUE);
        let wake: Arc<dyn Fn() + Send + Sync> = Arc::new(wake);
        let threads = (0..threads.max(1))
            .map(|_| {
                let (inner, send, wake) = (Arc::clone(&inner), send.clone(), Arc::clone(&wake));
                std::thread::spawn(move || work(&inner, &send, &*wake))
            })
            .collect();
        Feed { inner, threads, arrivals, letters, news }
    }

    /// Points outside of these cells are left out from now on.
    pub fn set_core(&self, core: Core) {
        self.inner.lock().core = Arc::new(core);
    }

    /// Looks at, or changes, what is being made. Waits for a thread that does so too.
    pub fn with<R>(&self, look: impl FnOnce(&mut Builds) -> R) -> R {
        let result = look(&mut self.inner.lock().builds);
        self.inner.work.notify_all();
        result
    }

    /// What is wanted from now on, most urgent first; see [`Builds::want`].
    pub fn want(&self, order: Vec<SectionKey>) {
        self.tell(Letter::Want(order));
    }

    /// A finished section has arrived; see [`Builds::taken`].
    pub fn taken(&self, key: SectionKey) {
        self.tell(Letter::Taken(key));
    }

    fn tell(&self, letter: Letter) {
        // The threads go when this does.
        let _ = self.letters.send(letter);
        self.nudge();
    }

    /// Wakes the threads where letters lie unread, unless one of them is awake and about to read them. Once a frame: a
    /// thread that was about to sleep may have missed the last call.
    pub fn nudge(&self) {
        if !self.letters.is_empty() && !matches!(self.inner.state.try_lock(), Err(TryLockError::WouldBlock)) {
            self.inner.work.notify_all();
        }
    }

    /// What went wrong, and the files whose points turned out to lie elsewhere, since this was asked last.
    pub fn take_news(&self) -> (Vec<String>, Vec<usize>) {
        let (mut errors, mut corrected) = (Vec::new(), Vec::new());
        for news in self.news.try_iter() {
            match news {
                News::Error(error) => errors.push(error),
                News::Corrected(source) => corrected.push(source),
            }
        }
        (errors, corrected)
    }

    /// Takes the sparse sample of all files that are shown, into sections of `level`.
    pub fn sample(&self, level: u8) {
        let mut state = self.inner.lock();
        let sources = state.builds.sources();
        let left: Vec<_> = (0..sources.len()).rev().filter(|&source| sources[source].shown).collect();
        let of_file = (SAMPLE_POINTS / left.len().max(1)).max(1);
        let change = state.builds.change();
        self.inner.sampled.store(left.is_empty(), Ordering::Relaxed);
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
        self.inner.sampled.load(Ordering::Relaxed)
    }

    /// Waits for what arrives next.
    pub fn take(&self, timeout: Duration) -> Option<Arrival> {
        self.arrivals.recv_timeout(timeout).ok()
    }

    /// How far it is. Waits as [`Feed::with`] does.
    pub fn progress(&self) -> Progress {
        self.inner.lock().builds.progress()
    }

    /// The same, unless one would have to wait for it.
    pub fn try_progress(&self) -> Option<Progress> {
        match self.inner.state.try_lock() {
            Ok(state) => Some(state.builds.progress()),
            Err(TryLockError::Poisoned(state)) => Some(state.into_inner().builds.progress()),
            Err(TryLockError::WouldBlock) => None,
        }
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
    }
}

fn next(inner: &Inner) -> Option<Task> {
    let mut state = inner.lock();
    loop {
        if inner.stop.load(Ordering::Relaxed) {
            return None;
        }
        inner.read_letters(&mut state);
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
            return Some(Task::Sample { input, level: sample.level, of_file: sample.of_file, sections });
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
                let mut state = inner.lock();
                state.builds.done(job, outcome);
                inner.report(&mut state.builds);
                drop(state);
                inner.work.notify_all();
            }
            Task::Sample { input, level, of_file, sections } => {
                // What cannot be read is named when it is read for good.
                let _ = sparse(
                    (&grid_at(&inner.grid, level), level),
                    &core,
                    &mut decoder,
                    &mut binner,
                    &input,
                    of_file,
                    &sections,
                );
                input.file.bytes.release();
                let mut state = inner.lock();
                if let Some(sample) = &mut state.sample
                    && Arc::ptr_eq(&sample.sections, &sections)
                {
                    sample.busy -= 1;
                    if sample.busy == 0 && sample.left.is_empty() {
                        let sample = state.sample.take().expect("just seen");
                        inner.sampled.store(true, Ordering::Relaxed);
                        packs.extend(lock(&sample.sections).drain().map(|(key, columns)| {
                            (Finished { key, columns, damaged: false, change: sample.change }, true)
                        }));
                    }
                }
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
    let mut raw: Option<[[i32; 2]; 2]> = None;
    let result = decoder.decode(file, chunk, 0..chunk.records, &mut |block: &PointBlock| {
        outcome.points += block.len() as u64;
        for (axis, values) in [&block.x, &block.y].into_iter().enumerate() {
            let (low, high) =
                values.iter().fold((i32::MAX, i32::MIN), |(low, high), &v| (low.min(v), high.max(v)));
            let raw = raw.get_or_insert([[i32::MAX; 2], [i32::MIN; 2]]);
            raw[0][axis] = raw[0][axis].min(low);
            raw[1][axis] = raw[1][axis].max(high);
        }
        for (grid, of_level) in &levels {
            binner
                .bin_into(grid, core, &*job.input, block, &|key| of_level.get(&key).map(|&s| Arc::clone(s)));
        }
    });
    let header = &file.header;
    let in_file =
        |[x, y]: [i32; 2]| DVec3::new(f64::from(x), f64::from(y), 0.0) * header.scale + header.offset;
    outcome.cells = raw
        .and_then(|[low, high]| placed(&job.input.placement, [in_file(low), in_file(high)]))
        .and_then(|[low, high]| cells_of(grid, low, high));
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

/// Reads a few points of every chunk of a file.
fn sparse(
    (grid, level): (&Grid, u8),
    core: &Core,
    decoder: &mut Decoder,
    binner: &mut Binner,
    input: &Input,
    most: usize,
    sections: &Mutex<HashMap<SectionKey, Shared>>,
) -> Result<(), crate::source::SourceError> {
    let file = &input.file;
    if file.chunks.is_empty() {
        return Ok(());
    }
    let mut bin = |block: &PointBlock| {
        let section = |key: SectionKey| {
            let key = SectionKey { level, ..key };
            Some(Arc::clone(lock(sections).entry(key).or_default()))
        };
        binner.bin_into(grid, core, input, block, &section);
    };
    match sparse_of_chunk(file, most) {
        1 => bin(decoder.first_points(file, most)?),
        of_chunk => decoder.sparse_records(file, of_chunk, &mut bin)?,
    }
    Ok(())
}
