//! The resident sections: copied, derived, published, and given back, in the order that `gpu::Order` keeps.
//!
//! A payload's *version* is copied once, into slots of its own ([`Scene::upload`], [`Scene::try_upload`]); then its derived
//! part is built (columns under the mask, bridges and pyramid); when the host has seen that reached, it is *published*:
//! tables may name it. Each of these steps happens in a call of [`Scene::advance`]. Another mask derives again what is
//! resident and copies nothing: all at once ([`Scene::set_visibility`]), or some sections beside each frame
//! ([`Scene::switch_visibility`]). Passes of a section are never cut by a frame: it shows what it did, or what it is to.
//! [`Scene::evict`] evicts.

use super::derive::{Changed, Derive, Task};
use super::pool::{Access, Pool};
use super::switch::{Switch, SwitchOrder, SwitchPace, Switched};
use super::table::Entry;
use super::transfer::{Slots, Ticket, Transfer};
use super::visibility::{ColumnData, Visibility};
use super::work::{Submits, Submitter, Work};
use crate::attribute::{Kind, Kinds, is_always_solid, tells_nothing};
use crate::coords::{Grid, Height, SectionKey};
use crate::gpu::{Buffer, BufferCopy, Gpu, GpuError, MemoryKind, Order, SyncPoint};
use crate::limits::LIMITS;
use crate::section::{HighestOf, Layout, Payload, PayloadKey, device_bytes};
use crate::shared::passes::JUMP_QUARTERS;
use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::sync::Arc;
use std::time::Instant;

/// Most height steps a cell by which the ends of a gap may differ and it still be a slope: the ends of a gap are up to five
/// cells apart, and their rise must fit a signed number of 32 bits.
const STEEPEST: f64 = (i32::MAX / 5) as f64;
/// The same of what is a jump: three of them fit a signed number.
const MOST_JUMP: f64 = (i32::MAX / 5) as f64;
/// Heights are alike, where near ties count, if they differ by less than this share of a finest cell's side,
const TIE: f64 = 0.125;
/// and by no more units.
const MOST_TIE: f64 = 0.1;

/// Heights that differ by no more lattice steps are alike where near ties count, at every level of detail.
fn tie_steps(grid: &Grid) -> u32 {
    let units = (TIE * grid.cell()).min(MOST_TIE);
    (units / grid.height_step).clamp(1.0, STEEPEST) as u32
}

/// What has been copied and derived since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Bytes of payloads copied to the device.
    pub section_bytes: u64,
    /// Versions copied.
    pub sections: u64,
    /// Sections whose derived part was built or built again.
    pub builds: u64,
    /// Times that an upload waited for the device.
    pub waits: u64,
    /// Buffers made for what derived passes read.
    pub buffers: u64,
}

/// What came of [`Scene::try_upload`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Upload {
    /// It is on its way.
    Started,
    /// There will be room when the device is done with what was given back, or with earlier copies.
    Later,
    /// The pool has no room.
    Full,
}

/// How far a version is.
enum State {
    /// Until its copy is over.
    Copying(Ticket),
    /// Until its derived part is there.
    Building(SyncPoint),
    /// Tables may name it.
    Published,
}

impl State {
    /// What the version waits for, or did; `None`: nothing that has been submitted.
    fn point(&self) -> Option<SyncPoint> {
        match self {
            State::Copying(ticket) => ticket.point(),
            State::Building(point) => Some(*point),
            State::Published => None,
        }
    }
}

/// One version of a payload.
struct Version {
    slots: Slots,
    layout: Layout,
    highest_of: HighestOf,
    state: State,
    /// Under what its derived part is, once that is there.
    shown: Visibility,
}

impl Version {
    /// Whether there is a derived part.
    fn is_derived(&self) -> bool {
        !matches!(self.state, State::Copying(_))
    }
}

/// A payload: the version that tables name, and the one on its way.
#[derive(Default)]
struct Resident {
    published: Option<Version>,
    pending: Option<Version>,
}

/// Sections that are derived again, some beside each frame.
struct Switching {
    switch: Switch,
    /// The end of the part that the device may not be done with, and its sections.
    part: Option<(SyncPoint, usize)>,
}

impl Resident {
    fn versions(&self) -> impl Iterator<Item = &Version> {
        self.published.iter().chain(&self.pending)
    }

    /// The copy of the version on its way, if not all of it has been submitted.
    fn unsubmitted(&self) -> Option<Ticket> {
        match &self.pending.as_ref()?.state {
            State::Copying(ticket) if ticket.point().is_none() => Some(ticket.clone()),
            _ => None,
        }
    }
}

/// A section and its eight neighbours, row by row from the south-west.
fn around(key: PayloadKey) -> [PayloadKey; 9] {
    let SectionKey { level, i, j } = key.section;
    std::array::from_fn(|n| {
        let (di, dj) = (n as i32 % 3 - 1, n as i32 / 3 - 1);
        let section = SectionKey { level, i: i.wrapping_add(di), j: j.wrapping_add(dj) };
        PayloadKey { section, ..key }
    })
}

/// A section as the device has it.
pub struct ReadBack {
    /// Where the parts of what was uploaded start.
    pub layout: Layout,
    /// The words that were copied.
    pub uploaded: Vec<u32>,
    /// And those that were derived from them: see [`crate::section::Derived`].
    pub derived: Vec<u32>,
}

/// Sections on the device.
pub struct Scene {
    /// Who waits for whom. One thread submits.
    pub order: Order,
    gpu: Gpu,
    submits: Submits,
    transfer: Transfer,
    derive: Derive,
    sections: HashMap<PayloadKey, Resident>,
    visibility: Visibility,
    column_data: ColumnData,
    grid: Grid,
    counters: Counters,
    generation: u64,
    defers_uploads: bool,
    /// A smooth surface is or was among what is here.
    smooth: bool,
    pace: SwitchPace,
    switching: Option<Switching>,
    /// How the last change of the mask went, until it was asked for.
    switched: Option<Switched>,
}

/// What transfers and derived passes are submitted with, beside them.
macro_rules! submitter {
    ($scene:ident) => {
        &mut Submitter { order: &mut $scene.order, submits: &mut $scene.submits }
    };
}

impl Scene {
    /// An empty scene, of sections on `grid`. `budget_bytes`: of the pool.
    pub fn new(
        gpu: &Gpu,
        order: impl FnOnce(Order) -> Order,
        access: Access,
        budget_bytes: u64,
        visibility: Visibility,
        grid: Grid,
    ) -> Result<Scene, GpuError> {
        Ok(Scene {
            order: order(Order::new(gpu, LIMITS.frames_in_flight)?),
            gpu: gpu.clone(),
            submits: Submits::new(gpu),
            transfer: Transfer::new(gpu, access, budget_bytes)?,
            derive: Derive::new(gpu),
            sections: HashMap::new(),
            visibility,
            column_data: ColumnData::Colors,
            grid,
            counters: Counters::default(),
            generation: 0,
            defers_uploads: false,
            smooth: false,
            pace: SwitchPace::default(),
            switching: None,
            switched: None,
        })
    }

    /// While uploads are deferred, [`Scene::try_upload`] starts none: the pipelines that it leads to are being made elsewhere.
    #[cfg(feature = "view")]
    pub fn defer_uploads(&mut self, defers_uploads: bool) {
        self.defers_uploads = defers_uploads;
    }

    /// Starts to copy a new version; the old one, if any, stays named until this one is published. `false` when the pool
    /// has no room. May wait for the device.
    pub fn upload(&mut self, key: impl Into<PayloadKey>, payload: &Payload) -> Result<bool, GpuError> {
        self.upload_with(key, payload.layout, |words| {
            words.copy_from_slice(&payload.words);
            payload.highest_of.clone()
        })
    }

    /// The same with `write`, which is given the words that are uploaded, all of them to be written once and in
    /// order, right in the upload ring.
    pub fn upload_with(
        &mut self,
        key: impl Into<PayloadKey>,
        layout: Layout,
        write: impl FnOnce(&mut [u32]) -> HighestOf,
    ) -> Result<bool, GpuError> {
        let key = key.into();
        if let Some(ticket) = self.sections.get(&key).and_then(Resident::unsubmitted) {
            self.transfer.finish(submitter!(self), &ticket)?;
        }
        let Some(slots) = self.transfer.allocate_or_wait(submitter!(self), &layout)? else {
            return Ok(false);
        };
        let (ticket, highest_of) = self.transfer.upload(submitter!(self), &slots, &layout, write)?;
        self.add_version(
            key,
            Version { slots, layout, highest_of, state: State::Copying(ticket), shown: self.visibility },
        );
        Ok(true)
    }

    /// [`Scene::upload`] without ever waiting for the device: for frames.
    pub fn try_upload(
        &mut self,
        key: impl Into<PayloadKey>,
        payload: &Arc<Payload>,
    ) -> Result<Upload, GpuError> {
        let key = key.into();
        if self.defers_uploads || self.sections.get(&key).and_then(Resident::unsubmitted).is_some() {
            return Ok(Upload::Later);
        }
        let layout = payload.layout;
        if self.transfer.waits_for_pieces(&layout) {
            return Ok(Upload::Later);
        }
        let Some(slots) = self.transfer.allocate(submitter!(self), &layout)? else {
            return Ok(if self.transfer.has_freed() { Upload::Later } else { Upload::Full });
        };
        let Some(ticket) = self.transfer.try_upload(submitter!(self), &slots, payload)? else {
            self.transfer.free(slots);
            return Ok(Upload::Later);
        };
        let (highest_of, state) = (payload.highest_of.clone(), State::Copying(ticket));
        let shown = self.visibility;
        self.add_version(key, Version { slots, layout, highest_of, state, shown });
        Ok(Upload::Started)
    }

    /// Bytes of host memory that are held for a payload larger than the ring.
    pub fn staged_bytes(&self) -> u64 {
        self.transfer.held_bytes()
    }

    /// A version is on its way.
    fn add_version(&mut self, key: PayloadKey, version: Version) {
        self.counters.section_bytes += version.layout.uploaded_bytes();
        self.counters.sections += 1;
        self.smooth |= version.layout.smooth;
        let overtaken = self.sections.entry(key).or_default().pending.replace(version);
        if let Some(old) = overtaken {
            self.release(old);
        }
    }

    /// Submits the copies recorded so far.
    pub fn flush(&mut self) -> Result<(), GpuError> {
        self.transfer.flush(submitter!(self))
    }

    /// Measures every copy and build from now on; see [`Scene::take_times`].
    pub fn measure(&mut self) {
        self.submits.measure();
    }

    /// Device times of the work that is done and was not asked for yet, nanoseconds; empty on a device that
    /// cannot tell.
    pub fn take_times(&mut self) -> Result<Vec<(Work, f64)>, GpuError> {
        self.submits.take_times(&mut self.order)
    }

    /// Takes payloads out; their slots are free once nothing can read them any more. Their neighbours lose the
    /// bridges that led to them.
    pub fn evict(&mut self, keys: &[impl Into<PayloadKey> + Copy]) -> Result<(), GpuError> {
        if keys.is_empty() {
            return Ok(());
        }
        self.flush()?;
        self.generation += 1;
        let gone: BTreeMap<_, _> = keys
            .iter()
            .map(|&key| key.into())
            .filter_map(|key| Some((key, self.sections.remove(&key)?)))
            .collect();
        let near = self.tasks(&self.changed_by(gone.keys().copied()), &BTreeSet::new());
        self.derive(Work::Build, [&[], &near], &[])?;
        for resident in gone.into_values() {
            if let Some(ticket) = resident.unsubmitted() {
                // Its pieces may still be on their way into the slot.
                self.transfer.give_up(&ticket, self.submits.last_copy);
            }
            resident.published.into_iter().chain(resident.pending).for_each(|version| self.release(version));
        }
        Ok(())
    }

    fn release(&mut self, version: Version) {
        let Submits { last_build, last_frame, .. } = self.submits;
        let uses = version.state.point().into_iter().chain(last_build).chain(last_frame).collect();
        self.transfer.retire(version.slots, uses);
    }

    /// Moves every version on that the device is done with: copied ones are built (together with the
    /// neighbours whose bridges they change), built ones are published. Never waits. Call it once a frame.
    pub fn advance(&mut self) -> Result<(), GpuError> {
        self.transfer.advance(submitter!(self))?;
        let (mut copied, mut done) = (Vec::new(), Vec::new());
        for (&key, resident) in &self.sections {
            match resident.pending.as_ref().map(|version| &version.state) {
                Some(State::Copying(ticket)) => {
                    if let Some(point) = ticket.point()
                        && self.order.reached(point)?
                    {
                        copied.push((key, point));
                    }
                }
                Some(State::Building(point)) if self.order.is_live(*point)? => done.push(key),
                _ => {}
            }
        }
        for key in done {
            let resident = self.sections.get_mut(&key).expect("just seen");
            let mut version = resident.pending.take().expect("just seen");
            version.state = State::Published;
            if let Some(old) = resident.published.replace(version) {
                self.release(old);
            }
            self.generation += 1;
        }
        if copied.is_empty() {
            return Ok(());
        }
        let points: Vec<_> = copied.iter().map(|&(_, point)| point).collect();
        let fresh: BTreeSet<_> = copied.into_iter().map(|(key, _)| key).collect();
        let own: Vec<_> = fresh.iter().filter_map(|&key| self.task_of_pending(key, &fresh)).collect();
        let all = self.tasks(&self.changed_by(fresh.iter().copied()), &fresh);
        self.derive(Work::Build, [&own, &all], &points)?;
        // What follows on this queue comes after it.
        let built = self.submits.last_build.expect("just submitted");
        for key in fresh {
            if let Some(version) = self.sections.get_mut(&key).and_then(|r| r.pending.as_mut()) {
                (version.state, version.shown) = (State::Building(built), self.visibility);
            }
        }
        Ok(())
    }

    /// Submits derived passes: those of sections alone for the first tasks, the others for the second.
    fn derive(&mut self, work: Work, tasks: [&[Task]; 2], copied: &[SyncPoint]) -> Result<(), GpuError> {
        let shown = (&self.visibility, self.column_data);
        let built = self.derive.run(submitter!(self), work, self.transfer.pool(), shown, tasks, copied)?;
        self.counters.builds += built;
        Ok(())
    }

    /// Whether anything of a section follows from what its neighbours hold.
    fn follows_from_neighbours(&self) -> bool {
        self.visibility.bridge > 0 || self.smooth
    }

    /// What follows from columns of `keys` that have come, changed or gone: those sections and their neighbours.
    fn changed_by(&self, keys: impl Iterator<Item = PayloadKey>) -> BTreeMap<PayloadKey, Changed> {
        let mut changed: BTreeMap<_, Changed> = BTreeMap::new();
        if !self.follows_from_neighbours() {
            // Nothing follows from what neighbours hold.
            return changed;
        }
        for key in keys {
            for (n, neighbour) in around(key).into_iter().enumerate() {
                // Seen from there it lies the other way.
                changed.entry(neighbour).or_default().insert(8 - n);
            }
        }
        changed
    }

    /// One task for every built version of the sections that follow from a change, and for those of `fresh`, whose copies
    /// are there.
    fn tasks(&self, changed: &BTreeMap<PayloadKey, Changed>, fresh: &BTreeSet<PayloadKey>) -> Vec<Task> {
        let is_built = |key: &PayloadKey, version: &Version| version.is_derived() || fresh.contains(key);
        let mut tasks = Vec::new();
        for (key, &changed) in changed {
            let Some(resident) = self.sections.get(key) else { continue };
            let pending = resident.pending.as_ref().filter(|v| is_built(key, v));
            // Columns of the version that tables name stay as they are when another comes.
            let of_published = if fresh.contains(key) { changed.of_neighbours() } else { changed };
            let versions =
                resident.published.iter().map(|v| (v, of_published)).chain(pending.map(|v| (v, changed)));
            for (version, changed) in versions.filter(|(_, changed)| !changed.is_empty()) {
                tasks.push(self.task(*key, version, changed, &is_built));
            }
        }
        tasks
    }

    fn task(
        &self,
        key: PayloadKey,
        version: &Version,
        changed: Changed,
        is_built: &dyn Fn(&PayloadKey, &Version) -> bool,
    ) -> Task {
        let pool = self.transfer.pool();
        let newest = |key: PayloadKey| -> Option<&Version> {
            let resident = self.sections.get(&key)?;
            resident.pending.as_ref().filter(|v| is_built(&key, v)).or(resident.published.as_ref())
        };
        let derived = |v: &Version| {
            let [x, y] = pool.place(&v.slots.derived, 0);
            [x, y, v.layout.code.base as u32, v.layout.derived().form()]
        };
        let mut near = around(key).map(|near| newest(near).map_or([0; 4], derived));
        near[4] = derived(version);
        let [x, y] = pool.place(&version.slots.uploaded, 0);
        let Layout { counts, others, code, .. } = version.layout;
        let seen = || version.highest_of.iter().filter(|(kind, _)| self.visibility.shows(*kind));
        let has_ties = self.visibility.near_ties
            && seen().any(|((class, _), _)| tells_nothing(*class))
            && seen().any(|((class, _), _)| !tells_nothing(*class));
        Task {
            section: [x, y, counts, others],
            near,
            // Gaps steeper than 45° are edges.
            stacks: version.layout.floats.map(|floats| {
                let stacking = self.grid.stacking(key.section.level);
                [stacking.slice_log2, stacking.thickness as u32, floats.lists, stacking.reach]
            }),
            smooth: version.layout.corners().map(|first| {
                let jump = f64::from(JUMP_QUARTERS) / 4.0 * self.grid.cell_steps(key.section.level);
                [jump.clamp(1.0, MOST_JUMP) as u32, first, version.layout.joins().unwrap_or(0)]
            }),
            steepest: self.grid.cell_steps(key.section.level).clamp(1.0, STEEPEST) as u32,
            tie: if has_ties { tie_steps(&self.grid) } else { 0 },
            wide: code.wide,
            all: !has_ties && version.highest_of.iter().all(|(kind, _)| self.visibility.shows(*kind)),
            changed,
        }
    }

    /// The task of the version of `key` that is on its way.
    fn task_of_pending(&self, key: PayloadKey, fresh: &BTreeSet<PayloadKey>) -> Option<Task> {
        let version = self.sections.get(&key)?.pending.as_ref()?;
        let is_built = |key: &PayloadKey, v: &Version| v.is_derived() || fresh.contains(key);
        Some(self.task(key, version, Changed::ITSELF, &is_built))
    }

    /// Waits until the device is through with all copies and builds submitted so far.
    pub fn wait(&mut self) -> Result<(), GpuError> {
        self.flush()?;
        let pending = self.sections.values().filter_map(|r| r.pending.as_ref()?.state.point());
        let points: HashSet<_> = pending.chain(self.submits.last_build).collect();
        points.into_iter().try_for_each(|point| self.order.wait(point))
    }

    /// Waits until every section is published, and shows what is to be seen.
    pub fn settle(&mut self) -> Result<(), GpuError> {
        self.finish_switch()?;
        loop {
            self.advance()?;
            let next = self.sections.values().filter_map(|r| r.pending.as_ref()?.state.point());
            match next.max_by_key(|p| p.value()) {
                Some(point) => self.order.wait(point)?,
                None if self.transfer.is_in_pieces() => self.transfer.wait_for_ring(submitter!(self))?,
                None => break,
            }
        }
        if let Some(Switching { part: Some((point, _)), .. }) = self.switching {
            self.order.wait(point)?;
            self.derive_next(|_| SwitchOrder::default())?;
        }
        Ok(())
    }

    /// Shows other things: the derived parts of all resident sections are built again; nothing is copied.
    pub fn set_visibility(&mut self, visibility: Visibility) -> Result<(), GpuError> {
        if visibility != self.visibility || self.switching.is_some() {
            self.visibility = visibility;
            self.generation += 1;
            self.switching = None;
            self.derive_all()?;
        }
        Ok(())
    }

    /// Lets columns carry other things; as [`Scene::set_visibility`].
    pub fn set_column_data(&mut self, column_data: ColumnData) -> Result<(), GpuError> {
        if column_data != self.column_data {
            self.column_data = column_data;
            self.derive_all()?;
        }
        Ok(())
    }

    fn derive_all(&mut self) -> Result<(), GpuError> {
        let all = self.sections.keys().map(|&key| (key, Changed::ITSELF)).collect();
        let all = self.tasks(&all, &BTreeSet::new());
        self.derive(Work::Build, [&all, &all], &[])?;
        let visibility = self.visibility;
        let versions =
            self.sections.values_mut().flat_map(|of| of.published.iter_mut().chain(&mut of.pending));
        versions.filter(|version| version.is_derived()).for_each(|version| version.shown = visibility);
        Ok(())
    }

    /// Shows other points, the sections one after the other: [`Scene::derive_next`] derives some of them beside each frame; until
    /// then a section shows what it did. Nothing is copied. Where more than classes and flags changes, all are
    /// derived at once, as by [`Scene::set_visibility`].
    pub fn switch_visibility(&mut self, visibility: Visibility) -> Result<(), GpuError> {
        let Visibility { classes, hidden_flags, .. } = visibility;
        if (Visibility { classes, hidden_flags, ..self.visibility }) != visibility {
            return self.set_visibility(visibility);
        }
        if visibility != self.visibility {
            self.visibility = visibility;
            let part = self.switching.take().and_then(|switching| switching.part);
            self.switching = Some(Switching { switch: Switch::new(Instant::now()), part });
        }
        Ok(())
    }

    /// Whether sections show, or may show, what was to be seen before.
    pub fn is_switching(&self) -> bool {
        self.switching.is_some()
    }

    /// Whether a section shows what was to be seen before.
    pub fn is_outdated(&self, key: PayloadKey) -> bool {
        let is_outdated = |version: &Version| version.is_derived() && version.shown != self.visibility;
        self.switching.is_some() && self.sections.get(&key).is_some_and(|of| of.versions().any(is_outdated))
    }

    /// What a frame takes by itself, milliseconds: as much as it bears is derived again beside it.
    pub fn set_frame_ms(&mut self, ms: f64) {
        self.pace.set_frame_ms(ms);
    }

    /// Derives the next sections again after [`Scene::switch_visibility`], in the order that `order` gives those in that are left,
    /// as many as a frame bears, once the device is done with those before. Never waits. Call it once a frame. Gives the
    /// sections of which anything is derived: those, and the neighbours that follow from them.
    pub fn derive_next(
        &mut self,
        order: impl FnOnce(Vec<PayloadKey>) -> SwitchOrder,
    ) -> Result<Vec<PayloadKey>, GpuError> {
        let Some(switching) = &mut self.switching else { return Ok(Vec::new()) };
        if let Some((point, sections)) = switching.part {
            if !self.order.reached(point)? {
                return Ok(Vec::new());
            }
            switching.part = None;
            if let Some(ms) = self.submits.take_again_ms(&mut self.order)? {
                self.pace.learn(sections, ms);
            }
        }
        let left = order(self.sections.keys().copied().filter(|&key| self.is_outdated(key)).collect());
        let switching = self.switching.as_mut().expect("as before");
        switching.switch.done(left.in_sight, Instant::now());
        if left.keys.is_empty() {
            self.switched = self.switching.take().map(|switching| switching.switch.end(Instant::now()));
            return Ok(Vec::new());
        }
        let next = &left.keys[..self.pace.sections().min(left.keys.len())];
        let own = next.iter().map(|&key| (key, Changed::ITSELF)).collect();
        let own = self.tasks(&own, &BTreeSet::new());
        let changed = self.changed_by(next.iter().copied());
        let all = self.tasks(&changed, &BTreeSet::new());
        self.derive(Work::Again, [&own, &all], &[])?;
        // Tables say how high sections are.
        self.generation += 1;
        for key in next {
            let of = self.sections.get_mut(key).expect("just derived");
            for version in of.published.iter_mut().chain(&mut of.pending).filter(|v| v.is_derived()) {
                version.shown = self.visibility;
            }
        }
        let switching = self.switching.as_mut().expect("as before");
        switching.switch.submitted(next.len());
        switching.part = self.submits.last_build.map(|point| (point, next.len()));
        let near = changed.into_keys().filter(|key| self.sections.contains_key(key));
        Ok(next.iter().copied().chain(near).collect())
    }

    /// Derives at once what is left after [`Scene::switch_visibility`].
    pub fn finish_switch(&mut self) -> Result<(), GpuError> {
        if self.switching.is_none() {
            return Ok(());
        }
        self.generation += 1;
        self.derive_all()?;
        let (sections, built) = (self.sections.len(), self.submits.last_build);
        if let Some(Switching { switch, part }) = &mut self.switching {
            switch.submitted(sections);
            // What a section takes beside frames is not learned from it.
            *part = built.map(|point| (point, 0));
        }
        Ok(())
    }

    /// How the last change of the mask went, once: by [`Scene::switch_visibility`], all of it.
    pub fn take_switched(&mut self) -> Option<Switched> {
        self.switched.take()
    }

    /// Reads a published section back. For tests; waits.
    pub fn read_back(&mut self, key: impl Into<PayloadKey>) -> Result<Option<ReadBack>, GpuError> {
        let Some(version) = self.sections.get(&key.into()).and_then(|r| r.published.as_ref()) else {
            return Ok(None);
        };
        let layout = version.layout;
        let parts = [
            (&version.slots.uploaded, layout.uploaded_bytes()),
            (&version.slots.derived, layout.derived_bytes()),
        ]
        .map(|(slot, size)| (self.transfer.pool().buffer(slot).clone(), slot.offset(), size));
        let mut read = [const { Vec::new() }; 2];
        for ((pool, from, size), words) in parts.into_iter().zip(&mut read) {
            let back = Buffer::new(&self.gpu, "section read back", MemoryKind::Readback, size)?;
            let (mut commands, _) = self.order.begin_frame("section read back")?;
            self.order.readback(&mut commands, &[(&pool, &back, BufferCopy { from, to: 0, size })]);
            let point = self.order.submit(commands)?;
            words.resize(size as usize / 4, 0);
            self.order.read(point, &back, 0, bytemuck::cast_slice_mut(words))?;
        }
        let [uploaded, derived] = read;
        Ok(Some(ReadBack { layout, uploaded, derived }))
    }

    /// The highest thing that is shown of a published section.
    fn highest(&self, key: PayloadKey) -> Option<Height> {
        let version = self.sections.get(&key)?.published.as_ref()?;
        let shown = version.highest_of.iter().filter(|(kind, _)| version.shown.shows(*kind));
        shown.map(|(_, h)| *h).max()
    }

    /// Whether tables have nothing to name: no published section shows anything.
    pub fn shows_nothing(&self) -> bool {
        self.sections.keys().all(|&key| self.highest(key).is_none())
    }

    /// Kinds of points in published sections, shown or not.
    pub fn kinds(&self) -> Kinds {
        let versions = self.sections.values().filter_map(|resident| resident.published.as_ref());
        versions.flat_map(|version| &version.highest_of).map(|&(kind, _)| kind).collect()
    }

    /// What a table may name now: published sections that show anything, in key order.
    pub fn entries(&self) -> Vec<Entry> {
        self.entries_for(self.sections.keys().map(|&key| (key.section, key)))
    }

    /// The same for some places and the section that each is to show: its own, or a coarser one around it. In the
    /// order of the places.
    pub fn entries_for(&self, shown: impl IntoIterator<Item = (SectionKey, PayloadKey)>) -> Vec<Entry> {
        let highest = |key: &PayloadKey| self.highest(*key);
        let entry = |(at, key): (SectionKey, PayloadKey)| {
            let version = self.sections.get(&key)?.published.as_ref()?;
            // Bridges and corners rise no higher than what they lead to, which may be a neighbour's.
            let top = match self.follows_from_neighbours() {
                false => highest(&key)?,
                true => around(key).iter().filter_map(highest).max()?,
            };
            let pyramid = self.transfer.pool().place_to_read(&version.slots.derived, 0);
            Some(Entry {
                key: at,
                detail: key.section.level,
                pyramid,
                base: Height(version.layout.code.base),
                form: version.layout.derived().form(),
                floats: Self::may_float(version)
                    .then(|| self.grid.stacking(key.section.level).word_step_log2()),
                corners: version.layout.corners(),
                joins: version.layout.joins(),
                top,
            })
        };
        let mut entries: Vec<_> = shown.into_iter().filter_map(entry).collect();
        entries.sort_unstable_by_key(|e| e.key);
        entries
    }

    /// Whether anything of a section may float under the mask that it shows, which is another while classes are switched.
    fn may_float(version: &Version) -> bool {
        let may = |&(kind, _): &(Kind, Height)| !is_always_solid(kind.0) && version.shown.shows(kind);
        version.layout.floats.is_some_and(|floats| floats.spans > 0) && version.highest_of.iter().any(may)
    }

    /// Whether tables may name a section.
    pub fn is_published(&self, key: impl Into<PayloadKey>) -> bool {
        self.sections.get(&key.into()).is_some_and(|resident| resident.published.is_some())
    }

    /// A number that changes whenever tables may name other things.
    pub fn generation(&self) -> u64 {
        self.generation
    }

    /// Whether a version of a section is on its way.
    pub fn is_uploading(&self, key: impl Into<PayloadKey>) -> bool {
        self.sections.get(&key.into()).is_some_and(|resident| resident.pending.is_some())
    }

    /// Whether versions are on their way, or sections are derived again.
    pub fn is_busy(&self) -> bool {
        self.switching.is_some() || self.sections.values().any(|resident| resident.pending.is_some())
    }

    /// Bytes of the pool that a section takes.
    pub fn bytes_of(&self, key: impl Into<PayloadKey>) -> u64 {
        let versions = self.sections.get(&key.into()).into_iter().flat_map(Resident::versions);
        versions.map(|version| device_bytes(&version.layout)).sum()
    }

    /// Sections that are here or on their way.
    pub fn resident(&self) -> impl Iterator<Item = PayloadKey> {
        self.sections.keys().copied()
    }

    /// Tells that a frame which could read every published section was submitted.
    pub fn frame_submitted(&mut self, frame: SyncPoint) {
        self.submits.last_frame = Some(frame);
    }

    /// The pool: its pages are kept by the commands that read them.
    pub fn pool(&self) -> &Pool {
        self.transfer.pool()
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// What is shown.
    pub fn visibility(&self) -> Visibility {
        self.visibility
    }

    /// What has been copied and built since the start.
    pub fn counters(&self) -> Counters {
        Counters { waits: self.transfer.waits(), buffers: self.derive.buffers_made(), ..self.counters }
    }
}
