//! Worker threads: chunks into the sections that request them, finished sections into payloads.
//!
//! The threads have the lowest priority, so one that holds the lock may not run for a while. Frames therefore send the
//! threads messages and receive arrivals and notices through channels; where a frame has to look at, or change, what the
//! threads share, it does so when the lock happens to be free ([`Feed::try_lock`]), in this frame or a later one. It never
//! waits for them.
//!
//! The calls, in order: [`Feed::new`], [`Feed::start`] once; then [`Feed::request`] what is missing and [`Feed::try_take`]
//! what has arrived, each frame; a payload that has been taken is confirmed ([`Feed::received`]), so that it may be
//! requested again.

use super::bins::{Binner, Core, Shared, lock};
use super::budget::Shares;
use super::builds::{Builds, Finished, Job, Learned, Outcome, Progress};
use super::counts::Histogram;
use super::input::Input;
use super::selecting::Selector;
use super::sparse::{self, Sparse};
use super::workers::panicked;
use crate::attribute::{KindCounts, Kinds};
use crate::coords::{Grid, SectionKey};
use crate::limits::LIMITS;
use crate::section::{Columns, Measure, Payload, PayloadKey, PayloadKind};
use crate::source::contain::caught;
use crate::source::known::RawBounds;
use crate::source::learned::Cache;
use crate::source::{Decoder, Fields, LayerMemory, PointBlock, Reading};
use crossbeam_channel::{Receiver, Sender};
use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError, TryLockError};
use std::time::{Duration, Instant};
use thread_priority::{ThreadPriority, set_current_thread_priority};

/// A finished section.
pub struct Arrival {
    /// Which one.
    pub key: PayloadKey,
    /// `None`: it holds no point.
    pub payload: Option<Payload>,
    /// Some of its points could not be read.
    pub damaged: bool,
    /// Changes to the set of files that it knows of; see [`Builds::revision`].
    pub revision: u64,
    /// Bytes that it is charged with until it is taken.
    bytes: u64,
}

/// Most bytes that columns of so many take once they are packed.
fn packed_bytes_at_most(columns: u64) -> u64 {
    // A byte more for each column's twelve, and the head: places of stacks are 24 KiB.
    columns + columns / 8 + (32 << 10)
}

/// Sections of the sparse sample.
type Sections = Arc<Mutex<HashMap<SectionKey, Shared>>>;

/// The sparse sample, while it is taken.
struct Sample {
    level: u8,
    /// Points wanted of a file.
    most: usize,
    /// Files left, the next one last.
    left: Vec<usize>,
    /// Files that are being read.
    busy: usize,
    sections: Sections,
    revision: u64,
}

struct State {
    /// Nothing more is begun.
    paused: bool,
    builds: Builds,
    core: Arc<Core>,
    sample: Option<Sample>,
    /// What was read for it, by file: files that come and go are read for it once.
    sparse: HashMap<usize, (Arc<Input>, Arc<Sparse>)>,
    /// Where it is kept what was learned, and when that was done last.
    cache: Option<(Arc<Cache>, Instant)>,
}

/// What frames tell the threads.
enum Message {
    /// See [`Builds::request`].
    Request(Vec<PayloadKey>),
    /// See [`Builds::received`].
    Received(PayloadKey),
    /// Nothing more is begun, or it goes on.
    Pause(bool),
    /// What is learned of files is kept there, now and then and at the end.
    Cache(Cache),
}

/// What the threads tell frames.
pub enum Notice {
    /// Something went wrong.
    Error(String),
    /// Something is not as it should be, but takes nothing away.
    Warning(String),
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
    messages: Receiver<Message>,
    notices: Sender<Notice>,
    /// No sparse sample is being taken.
    sampled: AtomicBool,
    /// Bytes of sections that are being packed, or wait to be taken, and how many there may be.
    arriving: AtomicU64,
    most_arriving: u64,
    /// A section waits to be packed until there is room.
    is_throttled: AtomicBool,
    /// What decoders share.
    layers: LayerMemory,
    /// Why nothing will be read any more.
    failed: OnceLock<String>,
}

impl Inner {
    /// The state as all messages have made it.
    fn lock(&self) -> MutexGuard<'_, State> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        self.read_messages(&mut state);
        state
    }

    /// The same, unless one would have to wait for it.
    fn try_lock(&self) -> Option<MutexGuard<'_, State>> {
        let mut state = match self.state.try_lock() {
            Ok(state) => state,
            Err(TryLockError::Poisoned(state)) => state.into_inner(),
            Err(TryLockError::WouldBlock) => return None,
        };
        self.read_messages(&mut state);
        Some(state)
    }

    /// An arrival has been taken: there is room for another.
    fn release_arrival(&self, arrival: &Arrival) {
        self.arriving.fetch_sub(arrival.bytes, Ordering::Relaxed);
    }

    /// Whether a section whose columns take so many bytes may be packed; then it is charged.
    fn may_pack(&self, columns: u64) -> bool {
        let bytes = packed_bytes_at_most(columns);
        let room = |now: u64| (now == 0 || now + bytes <= self.most_arriving).then_some(now + bytes);
        let may = self.arriving.fetch_update(Ordering::Relaxed, Ordering::Relaxed, room).is_ok();
        self.is_throttled.store(!may, Ordering::Relaxed);
        may
    }

    /// Ends all reading for a fault of this program.
    fn fail(&self, reason: &str) {
        // The first one is told.
        let _ = self.failed.set(format!("reading has ended in a fault of the program: {reason}"));
        self.stop.store(true, Ordering::Relaxed);
        self.work.notify_all();
    }

    fn read_messages(&self, state: &mut State) {
        let mut order = None;
        for message in self.messages.try_iter() {
            match message {
                Message::Request(keys) => order = Some(keys),
                Message::Received(key) => {
                    // In the order of the messages: what was asked for before it was taken is not asked for again.
                    if let Some(order) = order.take() {
                        state.builds.request(order);
                    }
                    state.builds.received(key);
                }
                Message::Pause(paused) => {
                    state.paused = paused;
                    self.work.notify_all();
                }
                Message::Cache(cache) => state.cache = Some((Arc::new(cache), Instant::now())),
            }
        }
        if let Some(order) = order {
            state.builds.request(order);
            self.work.notify_all();
        }
    }

    /// Tells frames what has come up; gives whether anything has.
    fn report(&self, builds: &mut Builds) -> bool {
        let mut told = false;
        let errors = builds.take_errors().into_iter().map(Notice::Error);
        let warnings = builds.take_warnings().into_iter().map(Notice::Warning);
        let corrected = builds.take_corrected().into_iter().map(Notice::Corrected);
        for notice in errors.chain(warnings).chain(corrected) {
            // Nobody may be left to hear it.
            let _ = self.notices.send(notice);
            told = true;
        }
        told
    }
}

/// What a thread does next.
enum Task {
    Sample {
        source: usize,
        input: Arc<Input>,
        level: u8,
        most: usize,
        read: Option<Arc<Sparse>>,
        sections: Sections,
        reading: Arc<Reading>,
    },
    Chunk(Job),
    Pack(Finished),
}

/// The threads. Dropped, they end with the chunk that they are at, which is not waited for: it may be a whole file.
pub struct Feed {
    inner: Arc<Inner>,
    arrivals: Receiver<Arrival>,
    /// Until the threads are started.
    send: Option<Sender<Arrival>>,
    messages: Sender<Message>,
    notices: Receiver<Notice>,
}

/// What the threads share, held by someone who looks at it or changes it; they go on when it is dropped.
pub struct FeedGuard<'a> {
    inner: &'a Inner,
    state: MutexGuard<'a, State>,
}

impl FeedGuard<'_> {
    /// What is being made.
    pub fn builds(&mut self) -> &mut Builds {
        &mut self.state.builds
    }

    /// Points outside of these cells are left out from now on.
    pub fn set_core(&mut self, core: Core) {
        self.state.core = Arc::new(core);
    }

    /// Takes the sparse sample of all files that are shown, into sections of `level`.
    pub fn sample(&mut self, level: u8) {
        let State { builds, sparse, sample, .. } = &mut *self.state;
        sparse.retain(|source, (of, _)| Arc::ptr_eq(of, &builds.sources()[*source].input));
        let sources = builds.sources();
        let left: Vec<_> = (0..sources.len()).rev().filter(|&source| sources[source].visible).collect();
        let most = sparse::points_of_file(left.len());
        let revision = builds.revision();
        self.inner.sampled.store(left.is_empty(), Ordering::Release);
        *sample = (!left.is_empty()).then(|| Sample {
            level,
            most,
            left,
            busy: 0,
            sections: Arc::default(),
            revision,
        });
    }
}

impl Drop for FeedGuard<'_> {
    fn drop(&mut self) {
        self.inner.work.notify_all();
    }
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
    /// Of what `builds` says, in host memory of `shares`. Nothing is read before [`Feed::start`].
    pub fn new(builds: Builds, grid: Grid, core: Core, shares: Shares) -> Feed {
        let (messages, read) = crossbeam_channel::unbounded();
        let (notify, notices) = crossbeam_channel::unbounded();
        let inner = Arc::new(Inner {
            state: Mutex::new(State {
                paused: false,
                builds,
                core: Arc::new(core),
                sample: None,
                sparse: HashMap::new(),
                cache: None,
            }),
            work: Condvar::new(),
            stop: AtomicBool::new(false),
            grid,
            messages: read,
            notices: notify,
            sampled: AtomicBool::new(true),
            arriving: AtomicU64::new(0),
            most_arriving: shares.arriving,
            is_throttled: AtomicBool::new(false),
            layers: LayerMemory::new(shares.layers),
            failed: OnceLock::new(),
        });
        let (send, arrivals) = crossbeam_channel::bounded(LIMITS.arrivals);
        Feed { inner, arrivals, send: Some(send), messages, notices }
    }

    /// Starts `threads` threads, once; `wake` is called when something has arrived.
    pub fn start(&mut self, threads: usize, wake: impl Fn() + Send + Sync + 'static) {
        let Some(send) = self.send.take() else { return };
        let wake: Arc<dyn Fn() + Send + Sync> = Arc::new(wake);
        for _ in 0..threads.max(1) {
            let (inner, send, wake) = (Arc::clone(&self.inner), send.clone(), Arc::clone(&wake));
            std::thread::spawn(move || {
                // Panics in what is done for a chunk or a section are contained there. Others leave no sound books.
                if let Err(reason) = caught(|| work(&inner, &send, &*wake)) {
                    inner.fail(&reason);
                    // It may be what has panicked.
                    let _ = caught(&*wake);
                }
            });
        }
    }

    /// Why nothing will be read any more, where that is so.
    pub fn failed(&self) -> Option<&str> {
        self.inner.failed.get().map(String::as_str)
    }

    /// Keeps what is learned of files there, now and then and at the end.
    pub fn save_learned_to(&self, cache: Cache) {
        self.send(Message::Cache(cache));
    }

    /// Looks at, or changes, what the threads share, unless one of them does so now: never waits.
    pub fn try_lock(&self) -> Option<FeedGuard<'_>> {
        Some(FeedGuard { inner: &self.inner, state: self.inner.try_lock()? })
    }

    /// The same, but waits. Not for frames.
    pub fn lock(&self) -> FeedGuard<'_> {
        FeedGuard { inner: &self.inner, state: self.inner.lock() }
    }

    /// Holds the state while it does what it is given.
    #[doc(hidden)]
    pub fn holder(&self) -> impl FnOnce(&mut dyn FnMut()) + Send + 'static {
        let inner = Arc::clone(&self.inner);
        move |work| {
            let _state = inner.lock();
            work();
        }
    }

    /// What is wanted from now on, most urgent first; see [`Builds::request`].
    pub fn request(&self, order: Vec<PayloadKey>) {
        self.send(Message::Request(order));
    }

    /// A finished section has arrived; see [`Builds::received`].
    pub fn received(&self, key: PayloadKey) {
        self.send(Message::Received(key));
    }

    fn send(&self, message: Message) {
        // The threads go when this does.
        let _ = self.messages.send(message);
        self.wake();
    }

    /// Wakes the threads where messages lie unread or there may be room again, unless one of them is awake and about to
    /// read them. Once a frame: a thread that was about to sleep may have missed the last call.
    pub fn wake(&self) {
        let is_due = !self.messages.is_empty() || self.inner.is_throttled.load(Ordering::Relaxed);
        if is_due && !matches!(self.inner.state.try_lock(), Err(TryLockError::WouldBlock)) {
            self.inner.work.notify_all();
        }
    }

    /// What has come up since this was asked last.
    pub fn notices(&self) -> impl Iterator<Item = Notice> {
        self.notices.try_iter()
    }

    /// Whether something has. What is told of a chunk is told before a section that it was in arrives.
    pub fn has_notices(&self) -> bool {
        !self.notices.is_empty()
    }

    /// Begins nothing more, or goes on.
    pub fn pause(&self, paused: bool) {
        self.send(Message::Pause(paused));
    }

    /// What has arrived.
    pub fn try_take(&self) -> Option<Arrival> {
        let arrival = self.arrivals.try_recv().ok();
        arrival.inspect(|arrival| self.inner.release_arrival(arrival))
    }

    /// Whether no sparse sample is being taken: all of the last one has arrived, or waits to be taken.
    pub fn is_sampled(&self) -> bool {
        // All that was sent before it was said is there.
        self.inner.sampled.load(Ordering::Acquire)
    }

    /// Waits for what arrives next.
    pub fn take(&self, timeout: Duration) -> Option<Arrival> {
        let arrival = self.arrivals.recv_timeout(timeout).ok();
        arrival.inspect(|arrival| self.inner.release_arrival(arrival))
    }

    /// Bytes of host memory that are on the way here, and that decoders hold.
    pub fn passing_bytes(&self) -> u64 {
        self.inner.arriving.load(Ordering::Relaxed) + self.inner.layers.held()
    }

    /// What points there are, and a number that changes with that; `None` where it is still `known`, or one would have to
    /// wait. See [`Builds::kinds`].
    pub fn try_kinds(&self, known: Option<[u64; 2]>) -> Option<([u64; 2], KindCounts)> {
        self.inner.try_lock()?.builds.kinds(known)
    }

    /// Points of each kind that take part. Waits as [`Feed::lock`] does.
    pub fn kinds(&self) -> KindCounts {
        self.inner.lock().builds.kinds(None).map(|(_, kinds)| kinds).unwrap_or_default()
    }

    /// How far it is. Waits as [`Feed::lock`] does.
    pub fn progress(&self) -> Progress {
        self.inner.lock().builds.progress()
    }

    /// The same, unless one would have to wait for it.
    pub fn try_progress(&self) -> Option<Progress> {
        Some(self.inner.try_lock()?.builds.progress())
    }
}

impl Drop for Feed {
    fn drop(&mut self) {
        // Under the lock, so that no thread is between looking and waiting.
        let mut state = self.inner.lock();
        self.inner.stop.store(true, Ordering::Relaxed);
        self.inner.work.notify_all();
        if let Some((cache, _)) = state.cache.take() {
            let learned = state.builds.take_learned();
            drop(state);
            save_learned(&cache, &learned);
        }
    }
}

fn next(inner: &Inner) -> Option<Task> {
    let mut state = inner.lock();
    loop {
        if inner.stop.load(Ordering::Relaxed) {
            return None;
        }
        inner.read_messages(&mut state);
        if state.paused {
            state = inner.work.wait(state).unwrap_or_else(PoisonError::into_inner);
            continue;
        }
        let State { builds, sample, sparse, .. } = &mut *state;
        if let Some(sample) = sample
            && let Some(source) = sample.left.pop()
        {
            sample.busy += 1;
            let input = Arc::clone(&builds.sources()[source].input);
            let sections = Arc::clone(&sample.sections);
            let (level, most) = (sample.level, sample.most);
            // Half as many will do: files that come and go change how many each is to give.
            let enough = |(of, read): &&(Arc<Input>, Arc<Sparse>)| {
                Arc::ptr_eq(of, &input) && (read.most() >= most / 2 || read.has_all())
            };
            let read = sparse.get(&source).filter(enough).map(|(_, read)| Arc::clone(read));
            let reading = Arc::clone(builds.reading());
            return Some(Task::Sample { source, input, level, most, read, sections, reading });
        }
        let may_pack = builds.next_finished().is_some_and(|columns| inner.may_pack(columns));
        if may_pack && let Some(finished) = builds.take_finished() {
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
    let mut tools = Tools::new(&inner.layers);
    while let Some(task) = next(inner) {
        let core = Arc::clone(&inner.lock().core);
        let mut packs = Vec::new();
        let mut sampled = None;
        match task {
            Task::Pack(finished) => packs.push(finished),
            Task::Chunk(job) => {
                let outcome = read(inner, &core, &mut tools, &job);
                let mut state = inner.lock();
                state.builds.finish_job(job, outcome);
                let told = inner.report(&mut state.builds);
                drop(state);
                inner.work.notify_all();
                if told {
                    wake();
                }
                maintain_cache(inner);
            }
            Task::Sample { source, input, level, most, read, sections, reading } => {
                let taken = caught(|| {
                    let Tools { decoder, binner, histogram, selector } = &mut tools;
                    // All of them: they cost next to nothing here, and any of them may be asked for later.
                    decoder.set_fields(Fields::ALL);
                    let of_file = read.unwrap_or_else(|| Arc::new(Sparse::read(decoder, &input.file, most)));
                    let measure = Measure::of(&reading.channel, &inner.grid, level).map(Measure::of_sample);
                    let section = |key: SectionKey| {
                        let make = || Arc::new(Mutex::new(Columns::default().measuring(measure)));
                        let mut sections = lock(&sections);
                        Some(Arc::clone(sections.entry(SectionKey { level, ..key }).or_insert_with(make)))
                    };
                    for block in of_file.blocks() {
                        let block = selector.apply(&reading, &*input, block);
                        histogram.add(block);
                        binner.bin_into(&grid_at(&inner.grid, level), &core, &*input, block, &section);
                    }
                    let kinds = histogram.take().into_iter().map(|(kind, _)| kind).collect();
                    (of_file, kinds)
                });
                let mut told = false;
                let (of_file, kinds): (_, Kinds) = taken.unwrap_or_else(|reason| {
                    tools = Tools::new(&inner.layers);
                    let path = input.file.path().display();
                    let line = format!("{path}: looking at it ended in a fault of the program: {reason}");
                    // Nobody may be left to hear it.
                    told = inner.notices.send(Notice::Error(line)).is_ok();
                    Default::default()
                });
                let mut state = inner.lock();
                let State { builds, sample, sparse, .. } = &mut *state;
                // Another file may be in its place by now.
                if Arc::ptr_eq(&input, &builds.sources()[source].input) {
                    builds.check_sample(source, of_file.bounds());
                    if builds.reading().selection == reading.selection {
                        builds.note_kinds(source, &kinds);
                    }
                    if of_file.is_whole() {
                        sparse.insert(source, (input, of_file));
                    }
                }
                told |= inner.report(builds);
                let of_last = |sample: &Sample| Arc::ptr_eq(&sample.sections, &sections);
                if let Some(sample) = sample.as_mut().filter(|sample| of_last(sample)) {
                    if sample.busy > 1 || !sample.left.is_empty() {
                        sample.busy -= 1;
                    } else {
                        let revision = sample.revision;
                        packs.extend(lock(&sections).drain().map(|(key, columns)| Finished {
                            key: PayloadKey::sample(key),
                            columns,
                            damaged: false,
                            revision,
                            bytes: 0,
                        }));
                        sampled = Some(sections);
                    }
                }
                drop(state);
                if told {
                    wake();
                }
                maintain_cache(inner);
            }
        }
        for finished in packs {
            let arrival = pack(inner, finished);
            if send.send(arrival).is_err() {
                return;
            }
            wake();
        }
        if let Some(sections) = sampled {
            let mut state = inner.lock();
            if state.sample.as_ref().is_some_and(|sample| Arc::ptr_eq(&sample.sections, &sections)) {
                state.sample = None;
                inner.sampled.store(true, Ordering::Release);
            }
            drop(state);
            wake();
        }
    }
}

/// What a thread reads with.
struct Tools {
    decoder: Decoder,
    binner: Binner,
    histogram: Histogram,
    selector: Selector,
}

impl Tools {
    fn new(layers: &LayerMemory) -> Tools {
        Tools {
            decoder: Decoder::sharing(layers),
            binner: Binner::default(),
            histogram: Histogram::default(),
            selector: Selector::default(),
        }
    }
}

/// Packs a section, and lets go of its columns.
fn pack(inner: &Inner, finished: Finished) -> Arrival {
    let Finished { key, columns, mut damaged, revision, bytes: column_bytes } = finished;
    // Those of the sample are few, and no part of what is being made.
    let is_sample = key.kind == PayloadKind::Sample;
    let charged = if is_sample { 0 } else { packed_bytes_at_most(column_bytes) };
    let payload = caught(|| {
        let mut columns = lock(&columns);
        columns.finish_measure();
        (columns.points() > 0).then(|| columns.pack())
    });
    drop(columns);
    let payload = payload.unwrap_or_else(|reason| {
        let SectionKey { level, i, j } = key.section;
        let line = format!(
            "section {i}, {j} of level {level}: packing it ended in a fault of the program: {reason}"
        );
        // Nobody may be left to hear it.
        let _ = inner.notices.send(Notice::Error(line));
        damaged = true;
        None
    });
    let bytes = payload.as_ref().map_or(0, Payload::uploaded_bytes);
    inner.arriving.fetch_add(bytes, Ordering::Relaxed);
    inner.arriving.fetch_sub(charged, Ordering::Relaxed);
    if !is_sample {
        inner.lock().builds.release_columns(column_bytes);
        inner.work.notify_all();
    }
    Arrival { key, payload, damaged, revision, bytes }
}

/// Forgets and keeps, where it is time.
fn maintain_cache(inner: &Inner) {
    let mut state = inner.lock();
    let State { builds, cache: Some((cache, kept)), .. } = &mut *state else { return };
    let forgotten = builds.take_forgotten();
    let is_time = kept.elapsed() > LIMITS.keep_every;
    let learned = if is_time { builds.take_learned() } else { Vec::new() };
    if is_time {
        *kept = Instant::now();
    }
    let cache = Arc::clone(cache);
    drop(state);
    forgotten.iter().for_each(|input| cache.forget(&input.file));
    save_learned(&cache, &learned);
}

/// Keeps what was learned. What cannot be kept is learned again.
fn save_learned(cache: &Cache, learned: &[Learned]) {
    let kept = learned
        .iter()
        .try_for_each(|Learned { input, bounds, kinds }| cache.save_all(&input.file, bounds, kinds));
    if let Err(error) = kept.and_then(|()| if learned.is_empty() { Ok(()) } else { cache.tidy() }) {
        tracing::debug!("what was learned of files cannot be kept: {error}");
    }
}

/// Reads a chunk into all that lack it.
fn read(inner: &Inner, core: &Core, tools: &mut Tools, job: &Job) -> Outcome {
    let file = &job.input.file;
    let chunk = &file.chunks[job.index];
    let mut levels: HashMap<u8, HashMap<SectionKey, &Shared>> = HashMap::new();
    for (key, columns) in &job.targets {
        let key = key.section;
        levels.entry(key.level).or_default().insert(SectionKey { level: 0, ..key }, columns);
    }
    let levels: Vec<_> =
        levels.into_iter().map(|(level, of_level)| (grid_at(&inner.grid, level), of_level)).collect();
    let mut outcome = Outcome::default();
    let mut raw = RawBounds::NOTHING;
    let Tools { decoder, binner, histogram, selector } = &mut *tools;
    decoder.set_fields(job.reading.fields());
    let result = caught(|| {
        decoder.decode(file, chunk, 0..chunk.records, &mut |block: &PointBlock| {
            outcome.points += block.len() as u64;
            for (axis, values) in [&block.x, &block.y, &block.z].into_iter().enumerate() {
                raw.widen(axis, values);
            }
            let block = selector.apply(&job.reading, &*job.input, block);
            if job.counts {
                histogram.add(block);
            }
            let mut nowhere = 0;
            for (grid, of_level) in &levels {
                let section = |key| of_level.get(&key).map(|&s| Arc::clone(s));
                nowhere = binner.bin_into(grid, core, &*job.input, block, &section);
            }
            outcome.nowhere += nowhere;
        })
    });
    outcome.kinds = job.counts.then(|| histogram.take());
    let result = result.unwrap_or_else(|reason| {
        *tools = Tools::new(&inner.layers);
        Err(panicked(file, chunk, outcome.points, &reason))
    });
    outcome.bounds = raw.is_sound().then_some(raw);
    outcome.error = result.err();
    outcome
}
