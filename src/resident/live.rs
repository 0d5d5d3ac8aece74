//! What is seen, kept resident: in each frame what the view wants, what it lacks requested, what has arrived uploaded,
//! what is not seen any more evicted.
//!
//! [`Live::tick`] is called once a frame and never waits. It takes what the threads have made ([`Feed`]) into host memory
//! (`host_cache`), asks `demand` what the camera wants and `policy` what to do, and does that to the
//! [`Scene`].

use super::cut::{Domain, Shown, Sight};
use super::demand::Demand;
use super::payloads::Payloads;
use super::policy::{self, Wanted};
use super::scene::Scene;
use super::switch::SwitchOrder;
use crate::attribute::KindCounts;
use crate::coords::{Grid, SectionKey};
use crate::gpu::GpuError;
use crate::ingest::bins::Core;
use crate::ingest::budget::Shares;
use crate::ingest::builds::{Builds, Made, Progress};
use crate::ingest::changes::{Change, Changes};
use crate::ingest::feed::{Arrival, Feed, Notice};
use crate::ingest::input::OpenInput;
use crate::ingest::sparse;
use crate::section::{Payload, PayloadKey, PayloadKind};
use crate::source::Reading;
use crate::source::learned::Cache;
use std::collections::HashSet;
use std::sync::Arc;
use std::time::Duration;

/// What a tick has changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tick {
    /// Another picture is to be drawn.
    pub changed: bool,
    /// Everything that is wanted is there.
    pub complete: bool,
    /// Not even the coarsest sections fit the device memory.
    pub stuck: bool,
    /// Nothing will be read any more: [`Live::failed`] says why.
    pub failed: bool,
}

/// How things stand.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Status {
    /// Files and chunks.
    #[serde(flatten)]
    pub progress: Progress,
    /// Sections that the camera wants, and how many of them are live or known to be empty.
    pub wanted: usize,
    /// See there.
    pub ready: usize,
    /// Sections on the device, wanted or not; without the sparse sample's.
    pub resident: usize,
    /// Sections that a file's fault has touched, of those that were made.
    pub damaged: usize,
    /// Bytes in host memory: of sections that are being made, waiting or kept, and of chunks that are being decoded.
    pub host_bytes: u64,
    /// Bytes of sections on the device.
    pub device_bytes: u64,
    /// How many times as many pixels as asked for a cell may cover, for lack of memory; 1: as asked for.
    pub coarser: f64,
}

/// The sparse sample of the files as they are.
#[derive(Default)]
struct Sample {
    level: u8,
    /// Some of it has arrived, or there is none.
    is_there: bool,
    /// What has arrived of it, until what was of earlier ones has been evicted.
    arrived: Option<HashSet<SectionKey>>,
}

/// See the module.
pub struct Live {
    feed: Feed,
    grid: Grid,
    shares: Shares,
    /// Files that were ever added.
    sources: usize,
    changes: Changes,
    demand: Demand,
    payloads: Payloads,
    sample: Sample,
    /// What was requested last.
    requested: Vec<PayloadKey>,
    /// Has come, but whether it is of the files as they are is not known yet.
    doubtful: Vec<Arrival>,
    /// Bytes that the scene holds of a payload that goes to the device in pieces.
    staged_bytes: u64,
    generation: Option<u64>,
    stuck: bool,
    /// Something arrived that no section on the device tells of.
    news: bool,
    /// What went wrong and was not told yet.
    errors: Vec<String>,
    /// The same, where nothing is lost by it.
    warnings: Vec<String>,
}

/// Where all files that are shown lie, and the level of a sparse sample of them.
fn domain_of(grid: &Grid, builds: &Builds) -> (Domain, u8) {
    let shown = || builds.sources().iter().filter(|source| source.visible);
    let extents: Vec<_> = shown().filter_map(|source| source.extent).collect();
    let cells: f64 = extents
        .iter()
        .map(|e| (0..2).map(|axis| f64::from(e.high[axis]) - f64::from(e.low[axis])).product::<f64>())
        .sum();
    let domain = Domain::new(grid, extents);
    let root = domain.roots().first().map_or(0, |key| key.level);
    let points = sparse::points(shown().map(|source| &source.input.file));
    (domain, sparse::level(points, cells, root))
}

impl Live {
    /// Of files, on `grid`, with columns and points as `made` has them. `host_bytes`: of everything that is held in host memory; `wake` is called when there is
    /// something for [`Live::tick`].
    pub fn new(
        inputs: Vec<OpenInput>,
        made: impl Into<Made>,
        grid: Grid,
        core: Core,
        host_bytes: u64,
        threads: usize,
        wake: impl Fn() + Send + Sync + 'static,
    ) -> Live {
        let shares = Shares::of(host_bytes);
        let mut builds = Builds::new(made, grid, shares.builds);
        let sources = inputs.len();
        for input in inputs {
            builds.add(input);
        }
        let (domain, level) = domain_of(&grid, &builds);
        let mut feed = Feed::new(builds, grid, core, shares);
        // Nobody else holds it before the threads are started.
        feed.lock().sample(level);
        feed.start(threads, wake);
        let mut live = Live {
            feed,
            grid,
            shares,
            sources,
            changes: Changes::default(),
            demand: Demand::default(),
            payloads: Payloads::new(shares.kept),
            sample: Sample::default(),
            requested: Vec::new(),
            doubtful: Vec::new(),
            staged_bytes: 0,
            generation: None,
            stuck: false,
            news: false,
            errors: Vec::new(),
            warnings: Vec::new(),
        };
        live.set_domain(domain, level);
        live
    }

    /// The files are others; a sparse sample of them, of `level`, has been asked for.
    fn set_domain(&mut self, domain: Domain, level: u8) {
        self.sample = Sample { level, is_there: false, arrived: Some(HashSet::new()) };
        self.payloads.cache.forget_all(PayloadKind::Sample);
        self.demand.set_domain(domain);
    }

    /// Shows or hides a file: the sections that it touches are rebuilt, from the files that touch those.
    pub fn set_file_visible(&mut self, source: usize, shown: bool) {
        self.set_files_visible(&[source], shown);
    }

    /// The same with several at once.
    pub fn set_files_visible(&mut self, sources: &[usize], shown: bool) {
        self.change(Change::Show(sources.to_vec(), shown));
    }

    /// Adds files; gives their numbers. `core`: of all.
    pub fn add_files(&mut self, inputs: Vec<OpenInput>, core: Core) -> Vec<usize> {
        let sources = self.sources..self.sources + inputs.len();
        self.sources = sources.end;
        self.change(Change::Add(inputs, core));
        sources.collect()
    }

    /// Other files in the place of some: what either touches is rebuilt.
    pub fn replace_files(&mut self, files: Vec<(usize, OpenInput)>, core: Core) {
        self.change(Change::Replace(files, core));
    }

    /// Reads other points of all files, or something else of them: everything is rebuilt, what is seen first. Until then the old
    /// versions stay.
    pub fn set_reading(&mut self, reading: Reading) {
        self.change(Change::Read(reading));
    }

    fn change(&mut self, change: Change) {
        self.changes.push(change);
        self.apply_changes();
    }

    /// Does what is to become of files, unless a thread that reads is in the way: then in a later frame.
    fn apply_changes(&mut self) {
        if !self.changes.is_pending() {
            return;
        }
        let known = self.payloads.known();
        let Some(mut held) = self.feed.try_lock() else { return };
        let touched = self.changes.apply(&mut held, &known);
        let (domain, level) = domain_of(&self.grid, held.builds());
        held.sample(level);
        drop(held);
        self.payloads.outdate(touched);
        // What was requested may have been thrown away.
        self.requested.clear();
        self.set_domain(domain, level);
    }

    /// Does what can be done now for a camera that sees `sight`, uploading `most_bytes` at most.
    pub fn tick(&mut self, scene: &mut Scene, sight: &Sight, most_bytes: u64) -> Result<Tick, GpuError> {
        self.payloads.begin_tick();
        self.take_news();
        self.apply_changes();
        self.payloads.trim_stale(scene);
        self.staged_bytes = scene.staged_bytes();
        let is_sampled = self.take_arrivals();
        self.evict_outdated(scene, is_sampled)?;
        let mut news = std::mem::take(&mut self.news);
        let moved = self.demand.is_other(sight);
        if moved {
            self.stuck = false;
            self.demand.refine_after_a_while(self.payloads.tick());
            self.look(sight);
        }
        if self.demand.look_ahead(sight, moved) {
            self.payloads.touch(self.demand.wanted().ahead);
        }
        news |= self.upload(scene, sight, most_bytes)?;
        scene.advance()?;
        let mut changed = moved || news || self.generation != Some(scene.generation());
        if changed {
            self.show(scene);
        }
        changed |= self.derive_next(scene)?;
        self.generation = Some(scene.generation());
        self.request(scene);
        self.sample.is_there |= self.feed.is_sampled();
        // A correction that has come meanwhile takes something away that seems to be there.
        let failed = self.feed.failed().is_some();
        let is_settled = !self.changes.is_pending() && !self.feed.has_notices() && !failed;
        let is_outdated =
            scene.is_switching() && self.demand.wanted().shown.iter().any(|&key| scene.is_outdated(key));
        let complete = self.sample.is_there && !self.is_missing_any(scene) && is_settled && !is_outdated;
        Ok(Tick { changed, complete, stuck: self.stuck, failed })
    }

    /// Derives the next sections again where another mask is to be shown, those in sight first; gives whether anything of what is
    /// shown is another.
    fn derive_next(&self, scene: &mut Scene) -> Result<bool, GpuError> {
        let Wanted { seen, ahead, shown } = self.demand.wanted();
        let derived = scene.derive_next(|outdated| SwitchOrder::of([seen, ahead], shown, outdated))?;
        Ok(derived.iter().any(|key| shown.contains(key)))
    }

    /// Takes what has arrived, as far as there is room; gives whether all of the sparse sample has.
    fn take_arrivals(&mut self) -> bool {
        let is_sampled = self.feed.is_sampled();
        for arrival in std::mem::take(&mut self.doubtful) {
            self.news |= self.arrive(arrival);
        }
        while self.has_room() {
            match self.feed.try_take() {
                Some(arrival) => self.news |= self.arrive(arrival),
                None => return is_sampled,
            }
        }
        false
    }

    /// Takes off the device what is not of the files as they are and will not be replaced.
    fn evict_outdated(&mut self, scene: &mut Scene, is_sampled: bool) -> Result<(), GpuError> {
        // All of it since the files changed, until the new sample is there; then what turns out to be empty.
        let mut resident = Vec::new();
        if self.sample.arrived.is_some() {
            resident.extend(scene.resident());
        }
        let sample = (self.sample.level, self.sample.arrived.as_ref().filter(|_| is_sampled));
        let stale = self.payloads.stale().filter(|&key| self.payloads.cache.is_empty(key));
        let candidates: HashSet<_> = stale.chain(resident).collect();
        let roots = self.demand.root_level();
        let outdated = policy::outdated(&self.payloads.on(scene), candidates, roots, sample);
        if is_sampled {
            self.sample.arrived = None;
        }
        self.payloads.evict(scene, &outdated)
    }

    /// Waits until something arrives, or for so long.
    pub fn wait(&mut self, timeout: Duration) {
        if !self.has_room() {
            std::thread::sleep(timeout);
        } else if let Some(arrival) = self.feed.take(timeout) {
            self.news |= self.arrive(arrival);
        }
    }

    /// Whether more may arrive: what has not is held back by the threads' queue.
    fn has_room(&self) -> bool {
        self.arrived_bytes() < self.shares.arrived.max(1)
    }

    fn arrived_bytes(&self) -> u64 {
        let doubtful = self.doubtful.iter().flat_map(|arrival| &arrival.payload).map(Payload::uploaded_bytes);
        doubtful.sum::<u64>() + self.payloads.cache.arrived_bytes() + self.staged_bytes
    }

    /// Whether it is news.
    fn arrive(&mut self, arrival: Arrival) -> bool {
        let Some(outdated) = self.changes.is_outdated(&arrival, &self.feed) else {
            self.doubtful.push(arrival);
            return false;
        };
        let Arrival { key, payload, damaged, .. } = arrival;
        let is_sample = key.kind == PayloadKind::Sample;
        if !is_sample {
            self.feed.received(key);
        }
        if outdated || is_sample && key.section.level != self.sample.level {
            // Who requested it is to request it again.
            self.requested.clear();
            return false;
        }
        if is_sample {
            self.sample.is_there = true;
            self.sample.arrived.iter_mut().for_each(|arrived| {
                arrived.insert(key.section);
            });
            if payload.is_some() {
                self.payloads.replace(key);
            }
        }
        self.payloads.cache.insert(key, payload.map(Arc::new), damaged);
        true
    }

    /// Another view.
    fn look(&mut self, sight: &Sight) {
        self.demand.look(sight, self.sample.level);
        self.payloads.touch(self.demand.wanted().seen);
    }

    fn missing(&self, scene: &Scene) -> usize {
        policy::missing(self.demand.wanted(), &self.payloads.on(scene)).count()
    }

    fn is_missing_any(&self, scene: &Scene) -> bool {
        policy::missing(self.demand.wanted(), &self.payloads.on(scene)).next().is_some()
    }

    /// Uploads what has arrived or is kept; gives whether what is seen is another for lack of room.
    fn upload(&mut self, scene: &mut Scene, sight: &Sight, most_bytes: u64) -> Result<bool, GpuError> {
        let most_bytes = (!self.stuck).then_some(most_bytes);
        let wanted = self.demand.wanted();
        let uploaded = policy::upload(wanted, &mut self.payloads.on_mut(scene), most_bytes)?;
        if !uploaded.is_full {
            return Ok(false);
        }
        let roots = self.demand.root_level();
        self.stuck = wanted.seen.iter().all(|key| key.section.level == roots);
        if !self.stuck {
            self.demand.coarsen(self.payloads.tick());
            self.look(sight);
        }
        Ok(!self.stuck)
    }

    /// Takes off the device what is not seen: holes are bridged across the borders of sections, and a picture that is
    /// finished is not to depend on what was seen before.
    pub fn evict_unseen(&mut self, scene: &mut Scene) -> Result<(), GpuError> {
        let wanted: HashSet<_> = self.demand.wanted().seen.iter().copied().collect();
        let unseen = |key: &PayloadKey| !wanted.contains(key) && key.kind != PayloadKind::Sample;
        let gone: Vec<_> = scene.resident().filter(unseen).collect();
        self.payloads.evict(scene, &gone)?;
        self.show(scene);
        Ok(())
    }

    /// Takes off the device what is of the files and points as they were: once all that is seen is of those as they are.
    pub fn evict_stale(&mut self, scene: &mut Scene) -> Result<(), GpuError> {
        let stale: HashSet<_> = self.payloads.stale().collect();
        let gone: Vec<_> = scene.resident().filter(|key| stale.contains(key)).collect();
        self.payloads.evict(scene, &gone)?;
        self.show(scene);
        Ok(())
    }

    /// Holds no copies in host memory of what is on the device: for a single picture, after which nothing comes back.
    pub fn keep_no_copies(&mut self) {
        self.payloads.cache.keep_no_copies();
    }

    fn show(&mut self, scene: &Scene) {
        let payloads = &mut self.payloads;
        self.demand.show(&|key| match scene.is_published(key) {
            true => Some(true),
            false => payloads.cache.is_empty(key).then_some(false),
        });
        payloads.touch(self.demand.wanted().shown);
        payloads.trim(scene);
    }

    /// Requests what is missing.
    fn request(&mut self, scene: &Scene) {
        let missing = policy::requests(self.demand.wanted(), &self.payloads.on(scene));
        if missing != self.requested {
            self.feed.request(missing.clone());
            self.requested = missing;
        }
        self.feed.wake();
    }

    /// Begins to read nothing more, or goes on: where one picture matters more than the next.
    pub fn pause(&self, paused: bool) {
        self.feed.pause(paused);
    }

    /// Each place and what it shows.
    pub fn shown(&self) -> &[Shown] {
        self.demand.shown()
    }

    /// A number that changes whenever [`Live::shown`] does.
    pub fn shown_version(&self) -> u64 {
        self.demand.shown_version()
    }

    /// Sections that are seen, most urgent first.
    pub fn wanted(&self) -> impl ExactSizeIterator<Item = SectionKey> + '_ {
        self.demand.wanted().seen.iter().map(|key| key.section)
    }

    /// Whether the sparse sample has arrived.
    pub fn has_sample(&self) -> bool {
        self.sample.is_there
    }

    /// How things stand. May wait for a thread that reads.
    pub fn status(&self, scene: &Scene) -> Status {
        self.status_with(scene, self.feed.progress())
    }

    /// The same, unless one would have to wait for it: for frames.
    pub fn try_status(&self, scene: &Scene) -> Option<Status> {
        Some(self.status_with(scene, self.feed.try_progress()?))
    }

    /// What points the files that are shown have, and a number that changes with that; `None` where it is still `known`, or
    /// one would have to wait for a thread that reads.
    pub fn try_kinds(&self, known: Option<[u64; 2]>) -> Option<([u64; 2], KindCounts)> {
        self.feed.try_kinds(known)
    }

    /// Points of each kind that take part. Waits for the threads' lock.
    pub fn kinds(&self) -> KindCounts {
        self.feed.kinds()
    }

    fn status_with(&self, scene: &Scene, progress: Progress) -> Status {
        let missing = self.missing(scene);
        let wanted = self.demand.wanted().seen.len();
        let passing = self.feed.passing_bytes();
        Status {
            wanted,
            ready: wanted - missing,
            resident: scene.resident().filter(|key| key.kind != PayloadKind::Sample).count(),
            damaged: self.payloads.cache.damaged(),
            host_bytes: progress.build_bytes
                + passing
                + self.arrived_bytes()
                + self.payloads.cache.copied_bytes(),
            device_bytes: scene.pool().held_bytes(),
            coarser: self.demand.coarser(),
            progress,
        }
    }

    /// Tries the detail that was asked for again: another picture is to come.
    pub fn restore_detail(&mut self) {
        self.demand.restore_detail();
    }

    /// Keeps what is learned of files there, now and then and at the end.
    pub fn save_learned_to(&self, cache: Cache) {
        self.feed.save_learned_to(cache);
    }

    /// Why nothing will be read any more, where that is so.
    pub fn failed(&self) -> Option<String> {
        self.feed.failed().map(str::to_owned)
    }

    /// What holds the threads' state while something else is done, as one of them does that is not given time. For
    /// tests.
    #[doc(hidden)]
    pub fn holder(&self) -> impl FnOnce(&mut dyn FnMut()) + Send + 'static {
        self.feed.holder()
    }

    fn take_news(&mut self) {
        let mut corrected = Vec::new();
        for notice in self.feed.notices() {
            match notice {
                Notice::Error(error) => self.errors.push(error),
                Notice::Warning(warning) => self.warnings.push(warning),
                Notice::Corrected(source) => corrected.push(source),
            }
        }
        if !corrected.is_empty() {
            self.changes.push(Change::Corrected(corrected));
        }
    }

    /// What is not as it should be, but takes nothing away, since this was asked last.
    pub fn take_warnings(&mut self) -> Vec<String> {
        self.take_news();
        std::mem::take(&mut self.warnings)
    }

    /// What went wrong since this was asked last.
    pub fn take_errors(&mut self) -> Vec<String> {
        self.take_news();
        std::mem::take(&mut self.errors)
    }
}
