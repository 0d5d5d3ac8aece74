//! What is seen, kept live: the cut of the moment, what it lacks asked for, what has arrived uploaded, what is not
//! seen any more given back. Called once a frame; never waits.

use super::cut::{Cut, Domain, MOST_LEVEL, MOST_NODES, Shown, Sight};
use super::motion::Motion;
use super::scene::{Scene, Upload};
use crate::coords::{Grid, SectionKey};
use crate::gpu::GpuError;
use crate::ingest::bins::Core;
use crate::ingest::budget::Shares;
use crate::ingest::builds::{Builds, OpenInput, Progress};
use crate::ingest::feed::{Arrival, Feed, News};
use crate::ingest::sparse;
use crate::section::Packed;
use crate::section::slot::section_bytes;
use crate::source::learned::Cache;
use std::collections::{HashMap, HashSet, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Bytes that one frame of something that moves may upload.
pub const FRAME_BYTES: u64 = 4 << 20;
/// Levels that the sparse sample's sections are coarser than the roots, at least: they are told apart by that.
const SPARSE_ABOVE: u8 = 1;
/// Points of the sample that a cell of its sections is to hold, about.
const SPARSE_POINTS: u64 = 3;
/// Ticks between two attempts to show more detail again.
const COARSER_TICKS: u64 = 60;
/// Places whose last use is remembered.
const MOST_USED: usize = 1 << 16;

/// A packed section in host memory.
struct Kept {
    packed: Arc<Packed>,
    used: u64,
}

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

/// What is to become of the files: done as soon as the threads that read let go of what they share.
enum Change {
    /// Some are shown, or hidden.
    Show(Vec<usize>, bool),
    /// More; where all of them lie.
    Add(Vec<OpenInput>, Core),
    /// Others in the place of some; where all of them lie.
    Replace(Vec<(usize, OpenInput)>, Core),
    /// The points of some lie elsewhere than was believed.
    Corrected(Vec<usize>),
}

/// From which change on sections are made of other files than before. It does not grow with the number of changes.
#[derive(Default)]
struct Changes {
    /// The last one of each file: sections that it touches.
    of_file: HashMap<usize, u64>,
    /// The last one after which any section may be another.
    of_all: u64,
    /// The last of all.
    last: u64,
}

impl Changes {
    fn add(&mut self, change: u64, sources: impl IntoIterator<Item = usize>) {
        self.last = self.last.max(change);
        self.of_file.extend(sources.into_iter().map(|source| (source, change)));
    }

    fn add_all(&mut self, change: u64) {
        (self.of_all, self.last) = (change, self.last.max(change));
        self.of_file.retain(|_, since| *since > change);
    }
}

/// What files come to as a whole.
struct Whole {
    domain: Domain,
    sparse_level: u8,
}

impl Whole {
    /// Of the files that are shown.
    fn of(grid: &Grid, builds: &Builds) -> Whole {
        let shown = || builds.sources().iter().filter(|source| source.shown);
        let samples = sparse::points(shown().map(|source| &source.input.file));
        let extents: Vec<_> = shown().filter_map(|source| source.extent).collect();
        let cells: f64 = extents
            .iter()
            .map(|e| (0..2).map(|axis| f64::from(e.high[axis]) - f64::from(e.low[axis])).product::<f64>())
            .sum();
        let domain = Domain::new(grid, extents);
        let root = domain.roots().first().map_or(0, |key| key.level);
        let of_level = |level: u8| cells * (-2.0 * f64::from(level)).exp2();
        let enough = |level: &u8| of_level(*level) * SPARSE_POINTS as f64 <= samples as f64;
        // The grid's anchor allows for no more.
        let coarsest = MOST_LEVEL + 2;
        let sparse_level = (root + SPARSE_ABOVE..coarsest).find(enough).unwrap_or(coarsest);
        Whole { domain, sparse_level }
    }
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

/// See the module.
pub struct Live {
    feed: Feed,
    grid: Grid,
    domain: Domain,
    shares: Shares,
    /// Files that were ever added.
    sources: usize,
    /// What is to become of them, in order.
    pending: VecDeque<Change>,
    sight: Option<Sight>,
    cut: Cut,
    /// Members that are seen, most urgent first.
    wanted: Vec<SectionKey>,
    /// What will be, too, if the camera goes on as it does.
    ahead: Vec<SectionKey>,
    motion: Motion,
    started: Instant,
    /// What was asked for last.
    asked: Vec<SectionKey>,
    shown: Vec<Shown>,
    shown_version: u64,
    generation: Option<u64>,
    sparse_level: u8,
    sparse_there: bool,
    /// Sections of the sparse sample as the files are now; `None`: what is not of it has been taken off the device.
    sparse_now: Option<HashSet<SectionKey>>,
    empty: HashSet<SectionKey>,
    damaged: HashSet<SectionKey>,
    /// Made, not uploaded yet.
    arrived: HashMap<SectionKey, Arc<Packed>>,
    /// Has come, but whether it is of the files as they are is not known yet.
    doubtful: Vec<Arrival>,
    /// Bytes that the scene holds of a section that goes to the device in pieces.
    staged_bytes: u64,
    /// Resident, but of the files as they were.
    stale: HashSet<SectionKey>,
    /// Some of them may not be resident.
    has_new_stale: bool,
    /// Uploaded before; the device may have given it back.
    kept: HashMap<SectionKey, Kept>,
    kept_bytes: u64,
    most_kept_bytes: u64,
    /// When a section was wanted or shown last.
    used: HashMap<SectionKey, u64>,
    changes: Changes,
    tick: u64,
    coarser: f64,
    /// Tick at which that was changed last.
    coarsened: u64,
    stuck: bool,
    /// Something arrived that no section on the device tells of.
    news: bool,
    /// Levels of former and present sparse samples, to be taken off the device: other sections have those keys.
    purged: Vec<u8>,
    /// What went wrong and was not told yet.
    errors: Vec<String>,
    /// The same, where nothing is lost by it.
    warnings: Vec<String>,
}

fn packed_bytes(packed: &Packed) -> u64 {
    4 * packed.words.len() as u64
}

/// Sections that some files may have points in.
fn touched(builds: &Builds, sources: &[usize], keys: &HashSet<SectionKey>) -> Vec<SectionKey> {
    let touches = |key: &&SectionKey| sources.iter().any(|&source| builds.touches(source, **key));
    keys.iter().filter(touches).copied().collect()
}

impl Live {
    /// Of files, on `grid`. `host_bytes`: of everything that is held in host memory; `wake` is called when there is
    /// something for [`Live::tick`].
    pub fn new(
        inputs: Vec<OpenInput>,
        grid: Grid,
        core: Core,
        host_bytes: u64,
        threads: usize,
        wake: impl Fn() + Send + Sync + 'static,
    ) -> Live {
        let shares = Shares::of(host_bytes);
        let mut builds = Builds::new(grid, shares.builds);
        let sources = inputs.len();
        for input in inputs {
            builds.add(input);
        }
        let whole = Whole::of(&grid, &builds);
        let mut feed = Feed::new(builds, grid, core, shares);
        // Nobody else holds it before the threads are started.
        feed.hold().sample(whole.sparse_level);
        feed.start(threads, wake);
        let mut live = Live {
            feed,
            grid,
            domain: Domain::default(),
            shares,
            sources,
            pending: VecDeque::new(),
            sight: None,
            cut: Cut::default(),
            wanted: Vec::new(),
            ahead: Vec::new(),
            motion: Motion::default(),
            started: Instant::now(),
            asked: Vec::new(),
            shown: Vec::new(),
            shown_version: 0,
            generation: None,
            sparse_level: 0,
            sparse_there: false,
            sparse_now: None,
            empty: HashSet::new(),
            damaged: HashSet::new(),
            arrived: HashMap::new(),
            doubtful: Vec::new(),
            staged_bytes: 0,
            stale: HashSet::new(),
            has_new_stale: false,
            kept: HashMap::new(),
            kept_bytes: 0,
            most_kept_bytes: shares.kept,
            used: HashMap::new(),
            changes: Changes::default(),
            tick: 0,
            coarser: 1.0,
            coarsened: 0,
            stuck: false,
            news: false,
            purged: Vec::new(),
            errors: Vec::new(),
            warnings: Vec::new(),
        };
        live.take_whole(whole);
        live
    }

    /// The files are others: their domain, and a sparse sample of them, which has been asked for.
    fn take_whole(&mut self, whole: Whole) {
        let old = self.sparse_level;
        Whole { domain: self.domain, sparse_level: self.sparse_level } = whole;
        self.sparse_there = false;
        self.sparse_now = Some(HashSet::new());
        self.arrived.retain(|key, _| key.level != old);
        if old != self.sparse_level {
            for level in [old, self.sparse_level] {
                self.arrived.retain(|key, _| key.level != level);
                self.empty.retain(|key| key.level != level);
                self.kept.retain(|key, _| key.level != level);
                self.stale.retain(|key| key.level != level);
                self.purged.push(level);
            }
        }
        self.kept_bytes = self.kept.values().map(|kept| packed_bytes(&kept.packed)).sum();
        self.sight = None;
    }

    /// Shows or hides a file: the sections that it touches are made anew, from the files that touch those.
    pub fn show_file(&mut self, source: usize, shown: bool) {
        self.show_files(&[source], shown);
    }

    /// The same with several at once.
    pub fn show_files(&mut self, sources: &[usize], shown: bool) {
        self.change(Change::Show(sources.to_vec(), shown));
    }

    /// Adds files; gives their numbers. `core`: of all.
    pub fn add(&mut self, inputs: Vec<OpenInput>, core: Core) -> Vec<usize> {
        let sources = self.sources..self.sources + inputs.len();
        self.sources = sources.end;
        self.change(Change::Add(inputs, core));
        sources.collect()
    }

    /// Other files in the place of some: what either touches is made anew.
    pub fn replace_files(&mut self, files: Vec<(usize, OpenInput)>, core: Core) {
        self.change(Change::Replace(files, core));
    }

    fn change(&mut self, change: Change) {
        self.pending.push_back(change);
        self.apply_changes();
    }

    /// Does what is to become of files, unless a thread that reads is in the way: then in a later frame.
    fn apply_changes(&mut self) {
        if self.pending.is_empty() {
            return;
        }
        let known = self.known();
        let Some(mut held) = self.feed.try_hold() else { return };
        let mut all_touched = Vec::new();
        for change in self.pending.drain(..) {
            let mut changed = |builds: &Builds, sources: &[usize]| {
                all_touched.extend(touched(builds, sources, &known));
                self.changes.add(builds.change(), sources.iter().copied());
            };
            match change {
                Change::Show(sources, shown) => {
                    sources.iter().for_each(|&source| held.builds().show(source, shown));
                    changed(held.builds(), &sources);
                }
                Change::Add(inputs, core) => {
                    held.set_core(core);
                    let sources: Vec<_> = inputs.into_iter().map(|input| held.builds().add(input)).collect();
                    changed(held.builds(), &sources);
                }
                Change::Replace(files, core) => {
                    held.set_core(core);
                    let sources: Vec<_> = files.iter().map(|(source, _)| *source).collect();
                    changed(held.builds(), &sources);
                    let builds = held.builds();
                    files.into_iter().for_each(|(source, input)| builds.replace(source, input));
                    changed(builds, &sources);
                    // Where the old ones lay is forgotten: whatever is under way is made anew.
                    self.changes.add_all(builds.change());
                }
                Change::Corrected(sources) => changed(held.builds(), &sources),
            }
        }
        let whole = Whole::of(&self.grid, held.builds());
        held.sample(whole.sparse_level);
        drop(held);
        self.remake(all_touched);
        self.take_whole(whole);
    }

    /// Sections of which something is known.
    fn known(&self) -> HashSet<SectionKey> {
        let made = self.empty.iter().chain(self.arrived.keys()).chain(self.kept.keys());
        made.chain(self.used.keys()).copied().collect()
    }

    fn remake(&mut self, touched: Vec<SectionKey>) {
        for key in touched {
            self.empty.remove(&key);
            self.damaged.remove(&key);
            self.arrived.remove(&key);
            if let Some(kept) = self.kept.remove(&key) {
                self.kept_bytes -= packed_bytes(&kept.packed);
            }
            self.stale.insert(key);
        }
        self.has_new_stale = true;
        // What was asked for may have been thrown away.
        self.asked.clear();
    }

    /// Does what can be done now for a camera that sees `sight`, uploading `most_bytes` at most.
    pub fn tick(&mut self, scene: &mut Scene, sight: &Sight, most_bytes: u64) -> Result<Tick, GpuError> {
        self.tick += 1;
        self.take_news();
        self.apply_changes();
        self.staged_bytes = scene.staged_bytes();
        if std::mem::take(&mut self.has_new_stale) {
            self.stale.retain(|&key| scene.is_live(key) || scene.is_coming(key));
        }
        if !self.purged.is_empty() {
            let purged = std::mem::take(&mut self.purged);
            let gone: Vec<_> = scene.resident().filter(|key| purged.contains(&key.level)).collect();
            scene.remove(&gone)?;
        }
        let sampled = self.feed.is_sampled();
        for arrival in std::mem::take(&mut self.doubtful) {
            self.news |= self.arrive(arrival);
        }
        let mut all_taken = false;
        while self.has_room() && !all_taken {
            match self.feed.try_take() {
                Some(arrival) => self.news |= self.arrive(arrival),
                None => all_taken = true,
            }
        }
        if sampled && all_taken {
            self.sweep(scene)?;
        }
        let mut news = std::mem::take(&mut self.news);
        let moved = self.sight.as_ref() != Some(sight);
        if moved {
            self.stuck = false;
            // Detail that was given up may fit another view, which is not tried in every frame.
            if self.tick > self.coarsened + COARSER_TICKS {
                self.coarser = (self.coarser * std::f64::consts::FRAC_1_SQRT_2).max(1.0);
                self.coarsened = self.tick;
            }
            self.look(sight);
        }
        self.look_ahead(sight, moved);
        news |= self.upload(scene, sight, most_bytes)?;
        scene.advance()?;
        let changed = moved || news || self.generation != Some(scene.generation());
        if changed {
            self.generation = Some(scene.generation());
            self.show(scene);
        }
        self.ask(scene);
        self.sparse_there |= self.feed.is_sampled();
        // A correction that has come meanwhile takes something away that seems to be there.
        let failed = self.feed.failed().is_some();
        let is_settled = self.pending.is_empty() && !self.feed.has_news() && !failed;
        let complete = self.sparse_there && self.missing(scene).next().is_none() && is_settled;
        Ok(Tick { changed, complete, stuck: self.stuck, failed })
    }

    /// Takes off the device what was of the sparse sample of the files as they were.
    fn sweep(&mut self, scene: &mut Scene) -> Result<(), GpuError> {
        let Some(now) = self.sparse_now.take() else { return Ok(()) };
        let of_old = |key: &SectionKey| key.level == self.sparse_level && !now.contains(key);
        let gone: Vec<_> = scene.resident().filter(of_old).collect();
        self.stale.retain(|key| !gone.contains(key));
        scene.remove(&gone)
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
        let doubtful = self.doubtful.iter().flat_map(|arrival| &arrival.packed).map(packed_bytes);
        let arrived = self.arrived.values().map(|packed| packed_bytes(packed));
        arrived.chain(doubtful).sum::<u64>() + self.staged_bytes
    }

    /// Whether an arrival is not of the files as they are; `None`: a thread is in the way of finding out.
    fn is_outdated(&self, arrival: &Arrival) -> Option<bool> {
        let Changes { of_file, of_all, last } = &self.changes;
        if arrival.change >= *last {
            return Some(false);
        }
        if arrival.sparse || arrival.change < *of_all {
            return Some(true);
        }
        let mut held = self.feed.try_hold()?;
        let builds = held.builds();
        let mut since = of_file.iter().filter(|(_, since)| **since > arrival.change);
        Some(since.any(|(&source, _)| builds.touches(source, arrival.key)))
    }

    /// Whether it is news.
    fn arrive(&mut self, arrival: Arrival) -> bool {
        let Some(outdated) = self.is_outdated(&arrival) else {
            self.doubtful.push(arrival);
            return false;
        };
        let Arrival { key, packed, damaged, sparse, .. } = arrival;
        if !sparse {
            self.feed.taken(key);
        }
        if outdated || sparse && key.level != self.sparse_level {
            // Who asked for it is to ask again.
            self.asked.clear();
            return false;
        }
        if sparse {
            self.sparse_there = true;
            if let Some(now) = &mut self.sparse_now {
                now.insert(key);
            }
        }
        if damaged {
            self.damaged.insert(key);
        }
        match packed {
            Some(packed) => {
                if sparse {
                    self.stale.insert(key);
                }
                self.arrived.insert(key, Arc::new(packed));
            }
            None => {
                self.empty.insert(key);
            }
        }
        true
    }

    /// Pixels that a cell may cover now.
    fn detail(&self, sight: &Sight) -> f64 {
        match sight.detail {
            // A quarter of a pixel is where giving up begins.
            0.0 if self.coarser > 1.0 => 0.25 * self.coarser,
            detail => detail * self.coarser,
        }
    }

    /// Another view.
    fn look(&mut self, sight: &Sight) {
        loop {
            self.cut = self.domain.cut(&Sight { detail: self.detail(sight), ..sight.clone() });
            if self.cut.nodes() < MOST_NODES {
                break;
            }
            self.coarser *= std::f64::consts::SQRT_2;
        }
        self.sight = Some(sight.clone());
        let live: HashMap<_, _> = self.shown.iter().copied().collect();
        let shown_level = |key: SectionKey| {
            let around = std::iter::successors(Some(key), |key| Some(key.parent()));
            let found = around.take(usize::from(MOST_LEVEL)).find_map(|key| live.get(&key));
            found.map_or(self.sparse_level, |from| from.level)
        };
        // By what is missing most on the screen: pixels of the cells that stand in.
        let mut wanted: Vec<_> = self
            .cut
            .wanted()
            .map(|(key, pixels)| (pixels * f64::from(shown_level(key)).exp2(), key))
            .collect();
        wanted.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        self.wanted = wanted.into_iter().map(|(_, key)| key).collect();
        self.used.extend(self.wanted.iter().map(|&key| (key, self.tick)));
    }

    /// What comes into sight if the camera goes on.
    fn look_ahead(&mut self, sight: &Sight, moved: bool) {
        let now = self.started.elapsed().as_secs_f64();
        let by = if moved { self.motion.frame(sight.eye, now) } else { None };
        match by {
            Some(by) => {
                let cut = self.domain.cut(&Sight { detail: self.detail(sight), ..sight.moved(by) });
                let wanted: HashSet<_> = self.wanted.iter().collect();
                let mut ahead: Vec<_> = cut.wanted().filter(|(key, _)| !wanted.contains(key)).collect();
                ahead.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
                self.ahead = ahead.into_iter().map(|(key, _)| key).collect();
                self.used.extend(self.ahead.iter().map(|&key| (key, self.tick)));
            }
            None if moved || self.motion.rests(now) => self.ahead.clear(),
            None => {}
        }
    }

    fn is_there(&self, scene: &Scene, key: SectionKey) -> bool {
        self.empty.contains(&key) || scene.is_live(key) && !scene.is_coming(key) && !self.stale.contains(&key)
    }

    fn missing<'a>(&'a self, scene: &'a Scene) -> impl Iterator<Item = SectionKey> + 'a {
        self.wanted.iter().copied().filter(|&key| !self.is_there(scene, key))
    }

    /// Uploads what has arrived or is kept, the sparse sample first; gives whether anything else than sections that
    /// become live is new.
    fn upload(&mut self, scene: &mut Scene, sight: &Sight, most_bytes: u64) -> Result<bool, GpuError> {
        let mut bytes = 0;
        let mut news = false;
        let sparse_level = self.sparse_level;
        let is_sparse = move |key: &&SectionKey| key.level == sparse_level;
        let mut order: Vec<SectionKey> = self.arrived.keys().filter(is_sparse).copied().collect();
        let ready = |key: &&SectionKey| self.arrived.contains_key(key) || self.kept.contains_key(key);
        order.extend(self.wanted.iter().filter(ready));
        let urgent = order.len();
        let mut room_ahead = true;
        order.extend(self.ahead.iter().filter(ready));
        for (place, &key) in order.iter().enumerate() {
            if scene.is_coming(key) || scene.is_live(key) && !self.stale.contains(&key) {
                // One that was made twice is not to lie about.
                if !scene.is_coming(key) && self.arrived.contains_key(&key) {
                    self.keep(key);
                }
                continue;
            }
            if bytes > most_bytes || self.stuck {
                break;
            }
            // One that was kept may have made room for one that has arrived since.
            let kept = || self.kept.get(&key).map(|kept| &kept.packed);
            let Some(packed) = self.arrived.get(&key).or_else(kept) else { continue };
            match scene.try_upload(key, packed)? {
                Upload::Started => {
                    bytes += packed_bytes(packed);
                    self.stale.remove(&key);
                    self.keep(key);
                }
                Upload::Later => break,
                // A stand-in is not worth the detail of what it stands in for.
                Upload::Full if is_sparse(&&key) => continue,
                // Nor what is not seen yet, of what is.
                Upload::Full if place >= urgent => {
                    room_ahead = self.make_room(
                        scene,
                        self.still_to_come(scene, &order[place..], most_bytes - bytes),
                        true,
                    )?;
                    break;
                }
                Upload::Full => {
                    let needed = self.still_to_come(scene, &order[place..urgent], most_bytes - bytes);
                    if !self.make_room(scene, needed, false)? {
                        let roots = self.domain.roots().first().map_or(0, |root| root.level);
                        self.stuck = self.wanted.iter().all(|key| key.level == roots);
                        if !self.stuck {
                            // Not even what is seen fits: all of it a little coarser.
                            self.coarser *= std::f64::consts::SQRT_2;
                            self.coarsened = self.tick;
                            self.look(sight);
                            news = true;
                        }
                    }
                    break;
                }
            }
        }
        // What is not wanted any more is worth keeping, not uploading.
        if !self.arrived.is_empty() {
            let ahead = if room_ahead { &self.ahead[..] } else { &[] };
            let wanted: HashSet<_> = self.wanted.iter().chain(ahead).collect();
            let unwanted = |key: &&SectionKey| !wanted.contains(key) && !is_sparse(key);
            let unwanted: Vec<_> = self.arrived.keys().filter(unwanted).copied().collect();
            unwanted.into_iter().for_each(|key| self.keep(key));
        }
        // What has become empty is not shown any more.
        let gone: Vec<_> = self.stale.iter().filter(|key| self.empty.contains(key)).copied().collect();
        if !gone.is_empty() {
            scene.remove(&gone)?;
            self.stale.retain(|key| !gone.contains(key));
        }
        Ok(news)
    }

    /// Bytes on the device of what is to be uploaded of `order`, about `most_bytes` at a time.
    fn still_to_come(&self, scene: &Scene, order: &[SectionKey], most_bytes: u64) -> u64 {
        let (mut uploaded, mut held) = (0, 0);
        for key in order {
            let kept = || self.kept.get(key).map(|kept| &kept.packed);
            let is_wanted = !scene.is_coming(*key) && !self.is_there(scene, *key);
            let Some(packed) = self.arrived.get(key).or_else(kept).filter(|_| is_wanted) else { continue };
            if uploaded > most_bytes {
                break;
            }
            uploaded += packed_bytes(packed);
            held += section_bytes(&packed.layout);
        }
        held
    }

    /// Gives back what is not wanted, what was used longest ago first and stand-ins last, until so many bytes are free;
    /// for what is not seen yet, what is seen or will be stays.
    fn make_room(&mut self, scene: &mut Scene, bytes: u64, for_ahead: bool) -> Result<bool, GpuError> {
        let shown: HashSet<_> = self.shown.iter().map(|(_, from)| *from).collect();
        let mut stays: HashSet<_> = self.wanted.iter().copied().collect();
        if for_ahead {
            stays.extend(self.ahead.iter().chain(&shown));
        }
        let mut spare: Vec<_> = scene
            .resident()
            .filter(|key| !stays.contains(key) && key.level != self.sparse_level)
            // What stands in for something goes last.
            .map(|key| (shown.contains(&key), self.used.get(&key).copied().unwrap_or(0), key))
            .collect();
        spare.sort_unstable();
        let mut room = 0;
        let mut gone = Vec::new();
        for (_, _, key) in spare {
            if room >= bytes {
                break;
            }
            room += scene.bytes_of(key);
            gone.push(key);
        }
        scene.remove(&gone)?;
        self.stale.retain(|key| !gone.contains(key));
        Ok(!gone.is_empty())
    }

    /// Takes off the device what is not seen: holes are bridged across the borders of sections, and a picture that is
    /// finished is not to depend on what was seen before.
    pub fn drop_unseen(&mut self, scene: &mut Scene) -> Result<(), GpuError> {
        let wanted: HashSet<_> = self.wanted.iter().copied().collect();
        let unseen = |key: &SectionKey| !wanted.contains(key) && key.level != self.sparse_level;
        let gone: Vec<_> = scene.resident().filter(unseen).collect();
        self.stale.retain(|key| !gone.contains(key));
        scene.remove(&gone)?;
        self.show(scene);
        Ok(())
    }

    /// Holds no copies in host memory of what is on the device: for a single picture, after which nothing comes back.
    pub fn keep_no_copies(&mut self) {
        self.most_kept_bytes = 0;
    }

    /// Keeps a section that has arrived as long as there is room, in the place of those that were used longest ago.
    fn keep(&mut self, key: SectionKey) {
        let used = self.used.get(&key).copied().unwrap_or(0);
        if let Some(kept) = self.kept.get_mut(&key) {
            kept.used = self.tick;
        }
        let Some(packed) = self.arrived.remove(&key).filter(|_| key.level != self.sparse_level) else {
            return;
        };
        self.kept_bytes += packed_bytes(&packed);
        if let Some(old) = self.kept.insert(key, Kept { packed, used }) {
            self.kept_bytes -= packed_bytes(&old.packed);
        }
        while self.kept_bytes > self.most_kept_bytes {
            let oldest = self.kept.iter().min_by_key(|(key, kept)| (kept.used, **key));
            let Some(oldest) = oldest.map(|(key, _)| *key) else { break };
            let old = self.kept.remove(&oldest).expect("just seen");
            self.kept_bytes -= packed_bytes(&old.packed);
        }
    }

    fn show(&mut self, scene: &Scene) {
        let live = |key: SectionKey| match scene.is_live(key) {
            true => Some(true),
            false => self.empty.contains(&key).then_some(false),
        };
        let shown = self.cut.shown(&live);
        if shown != self.shown {
            (self.shown, self.shown_version) = (shown, self.shown_version + 1);
        }
        self.used.extend(self.shown.iter().map(|(_, from)| (*from, self.tick)));
        if self.used.len() > MOST_USED {
            let (kept, now) = (&self.kept, self.tick);
            self.used.retain(|key, used| *used == now || kept.contains_key(key) || scene.is_live(*key));
        }
    }

    /// Asks for what is missing.
    fn ask(&mut self, scene: &Scene) {
        let there = |key: &SectionKey| {
            self.arrived.contains_key(key) || self.kept.contains_key(key) || scene.is_coming(*key)
        };
        let soon = self.ahead.iter().copied().filter(|&key| !self.is_there(scene, key));
        let missing: Vec<_> = self.missing(scene).chain(soon).filter(|key| !there(key)).collect();
        if missing != self.asked {
            self.feed.want(missing.clone());
            self.asked = missing;
        }
        self.feed.nudge();
    }

    /// Begins to read nothing more, or goes on: where one picture matters more than the next.
    pub fn pause(&self, paused: bool) {
        self.feed.pause(paused);
    }

    /// Each place and the section that it shows.
    pub fn shown(&self) -> &[Shown] {
        &self.shown
    }

    /// A number that changes whenever [`Live::shown`] does.
    pub fn shown_version(&self) -> u64 {
        self.shown_version
    }

    /// Sections that are seen, most urgent first.
    pub fn wanted(&self) -> &[SectionKey] {
        &self.wanted
    }

    /// Whether the sparse sample has arrived.
    pub fn sampled(&self) -> bool {
        self.sparse_there
    }

    /// How things stand. May wait for a thread that reads.
    pub fn status(&self, scene: &Scene) -> Status {
        self.status_with(scene, self.feed.progress())
    }

    /// The same, unless one would have to wait for it: for frames.
    pub fn try_status(&self, scene: &Scene) -> Option<Status> {
        Some(self.status_with(scene, self.feed.try_progress()?))
    }

    fn status_with(&self, scene: &Scene, progress: Progress) -> Status {
        let missing = self.missing(scene).count();
        let passing = self.feed.passing_bytes();
        Status {
            wanted: self.wanted.len(),
            ready: self.wanted.len() - missing,
            resident: scene.resident().filter(|key| key.level != self.sparse_level).count(),
            damaged: self.damaged.len(),
            host_bytes: progress.build_bytes + passing + self.arrived_bytes() + self.kept_bytes,
            device_bytes: scene.pool().held_bytes(),
            coarser: self.coarser,
            progress,
        }
    }

    /// Tries the detail that was asked for again: another picture is to come.
    pub fn restore_detail(&mut self) {
        (self.coarser, self.sight) = (1.0, None);
    }

    /// Keeps what is learned of files there, now and then and at the end.
    pub fn keep_learned(&self, cache: Cache) {
        self.feed.keep_learned(cache);
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
        for news in self.feed.news() {
            match news {
                News::Error(error) => self.errors.push(error),
                News::Warning(warning) => self.warnings.push(warning),
                News::Corrected(source) => corrected.push(source),
            }
        }
        if !corrected.is_empty() {
            self.pending.push_back(Change::Corrected(corrected));
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_do_not_grow_with_their_number() {
        let mut changes = Changes::default();
        for change in 1..1000 {
            changes.add(change, [change as usize % 7]);
        }
        assert_eq!((changes.of_file.len(), changes.last, changes.of_all), (7, 999, 0));
        // The last of each file counts.
        assert!((993..1000).all(|change| changes.of_file[&(change as usize % 7)] == change));
        changes.add_all(1000);
        assert_eq!((changes.of_file.len(), changes.last, changes.of_all), (0, 1000, 1000));
        changes.add(1001, [3]);
        assert_eq!((changes.of_file[&3], changes.last), (1001, 1001));
    }
}
