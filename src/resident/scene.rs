//! The resident sections: copied, built, published, and given back, in the order that `gpu::Order` keeps.
//!
//! A section's *version* is copied once, into a new slot; then its derived part is built (tops under the
//! mask, bridges and pyramid); when the host has seen the build reached, tables may name it. Another mask
//! reruns the build on what is resident and copies nothing.

use super::pool::{Access, Part, Pool, Slot};
use super::table::Entry;
use super::visibility::{Carried, Visibility};
use crate::attribute::Kinds;
use crate::coords::{Grid, Height, SectionKey};
use crate::gpu::{
    BindingKind, Buffer, BufferCopy, Commands, ComputePipeline, Gpu, GpuError, MemoryKind, Order, QueueKind,
    Recipe, SyncPoint, Timestamps, UploadRing, shaders, stream_words,
};
use crate::section::slot::section_bytes;
use crate::section::{HighestOf, Layout, Packed, SECTION_BLOCKS};
use bytemuck::{Pod, Zeroable};
use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet, VecDeque};
use std::sync::Arc;

/// Bytes of the upload ring.
const RING_BYTES: u64 = 16 << 20;
/// Bytes of a section larger than the ring that a frame copies.
const PIECE_BYTES: u64 = 4 << 20;
/// Bytes of a buffer with what a dispatch of derived passes reads.
const CONSTANT_BYTES: u64 = 16 << 10;
const _: () = assert!(SUBMIT_SECTIONS * size_of::<Job>() <= CONSTANT_BYTES as usize);
/// Such buffers that wait to be used again.
const MOST_CONSTANTS: usize = 32;
/// Most height steps a cell by which the ends of a gap may differ and it still be a slope: the ends of a gap are up to five
/// cells apart, and their rise must fit a signed number of 32 bits.
const STEEPEST: f64 = (i32::MAX / 5) as f64;
/// Table copies, hence frames that may be under way at once. The window's swapchain has as many.
pub const FRAMES_IN_FLIGHT: usize = 2;

/// Sections that one submit builds.
const SUBMIT_SECTIONS: usize = 64;
/// Threads in a workgroup of the passes that take half blocks.
const PASS_THREADS: u32 = 64;

/// What has been copied and built since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Bytes of section payloads copied to the device.
    pub section_bytes: u64,
    /// Section versions copied.
    pub sections: u64,
    /// Sections whose derived part was built or built again.
    pub builds: u64,
    /// Times that an upload waited for the device.
    pub waits: u64,
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

/// How far a section is.
#[derive(Clone, Copy, Debug)]
enum State {
    /// In the copy that is being recorded.
    Staged,
    Copying(SyncPoint),
    Building(SyncPoint),
    Live,
}

/// Where a version lies.
struct Slots {
    uploaded: Slot,
    derived: Slot,
}

/// One version of a section.
struct Version {
    slots: Slots,
    layout: Layout,
    highest_of: HighestOf,
    state: State,
}

/// What the device did for sections, and when.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Work {
    /// Copies into slots.
    Copy,
    /// Derived passes.
    Build,
}

/// Times every submit on the device.
#[derive(Default)]
struct Clock {
    idle: Vec<(QueueKind, Timestamps)>,
    running: Vec<(Work, QueueKind, SyncPoint, Timestamps)>,
}

/// A section: the version that tables name, and the one on its way.
#[derive(Default)]
struct Resident {
    live: Option<Version>,
    coming: Option<Version>,
}

/// A section larger than the ring, on its way in pieces, one a frame.
struct Large {
    key: SectionKey,
    packed: Arc<Packed>,
    /// Bytes whose copies were recorded.
    copied: u64,
}

/// A slot that was given back: free once the last work that used it is over.
struct Freed {
    slots: Slots,
    uses: Vec<SyncPoint>,
}

/// Mirrors `Job` in `shaders/derive.glsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Job {
    section: [u32; 4],
    near: [[u32; 4]; 9],
    slopes: [u32; 4],
}

/// A job, and the variant of the passes that does it.
struct Task {
    job: Job,
    wide: bool,
    /// Every run is shown.
    all: bool,
}

/// Derived passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Pass {
    Tops,
    Bridge,
    Pyramid,
}

impl Pass {
    /// `variant`: wide heights, every run is shown, bridges follow.
    fn recipe(self, variant: [bool; 3], access: Access) -> Recipe {
        let (name, by_address, by_buffer) = match self {
            Pass::Tops => ("tops", shaders::TOPS, shaders::TOPS_SSBO),
            Pass::Bridge => ("bridge", shaders::BRIDGE, shaders::BRIDGE_SSBO),
            Pass::Pyramid => ("pyramid", shaders::PYRAMID, shaders::PYRAMID_SSBO),
        };
        let (words, push_bytes, bindings): (_, _, &[_]) = match access {
            Access::Address | Access::Texels => (by_address, 16, &[]),
            Access::StorageBuffer => (by_buffer, 0, &[BindingKind::Storage; 3]),
        };
        Recipe { name, words, constants: (0..).zip(variant.map(u32::from)).collect(), push_bytes, bindings }
    }
}

/// Programs of the derived passes: those of usual sections, with or without bridges, and all others. Whoever holds them
/// makes uploads quick.
#[cfg(feature = "view")]
pub fn recipes(access: Access, bridge: bool) -> [Vec<Recipe>; 2] {
    let all = (0..8u8).map(|bits| [0, 1, 2].map(|bit| bits >> bit & 1 == 1)).flat_map(|variant| {
        let [_, all, bridge] = variant;
        let passes: &[Pass] =
            if all || bridge { &[Pass::Tops] } else { &[Pass::Tops, Pass::Bridge, Pass::Pyramid] };
        passes.iter().map(move |&pass| (pass, variant))
    });
    let is_usual = |&(pass, [wide, _, bridged]): &(Pass, [bool; 3])| {
        !wide && (pass != Pass::Tops || bridged == bridge) && (bridge || pass != Pass::Bridge)
    };
    let (usual, others): (Vec<_>, Vec<_>) = all.partition(is_usual);
    [usual, others].map(|part| part.into_iter().map(|(pass, variant)| pass.recipe(variant, access)).collect())
}

/// Mirrors `Derive` in `shaders/derive.glsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Derive {
    visible: [u32; 8],
    visible_withheld: [u32; 8],
    bridge: u32,
    values: u32,
}

/// A section and its eight neighbours, row by row from the south-west.
fn around(key: SectionKey) -> [SectionKey; 9] {
    std::array::from_fn(|n| {
        let (di, dj) = (n as i32 % 3 - 1, n as i32 / 3 - 1);
        SectionKey { level: key.level, i: key.i.wrapping_add(di), j: key.j.wrapping_add(dj) }
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
    pool: Pool,
    ring: UploadRing,
    /// Made when first used, by their specialisation constants.
    passes: HashMap<(Pass, [bool; 3]), ComputePipeline>,
    sections: HashMap<SectionKey, Resident>,
    freed: Vec<Freed>,
    /// The latest work, of each queue, that used a slot which is free again: copies go after it.
    reclaimed: Vec<SyncPoint>,
    last_frame: Option<SyncPoint>,
    last_copy: Option<SyncPoint>,
    /// Builds write to live slots, too, and read those of neighbours.
    last_build: Option<SyncPoint>,
    visibility: Visibility,
    carried: Carried,
    grid: Grid,
    counters: Counters,
    generation: u64,
    /// The copy that is being recorded, and whose sections it moves.
    batch: Option<(Commands, Option<Timestamps>)>,
    staged: Vec<SectionKey>,
    large: Option<Large>,
    /// What derived passes of submits read, oldest first, to be used again.
    constants: VecDeque<(SyncPoint, Buffer)>,
    /// And those of the submit that is being recorded.
    recorded_constants: Vec<Buffer>,
    clock: Option<Clock>,
    is_held: bool,
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
            order: order(Order::new(gpu, FRAMES_IN_FLIGHT)?),
            gpu: gpu.clone(),
            pool: Pool::new(gpu, access, budget_bytes),
            ring: UploadRing::new(gpu, "upload ring", RING_BYTES)?,
            passes: HashMap::new(),
            sections: HashMap::new(),
            freed: Vec::new(),
            reclaimed: Vec::new(),
            last_frame: None,
            last_copy: None,
            last_build: None,
            visibility,
            carried: Carried::Colors,
            grid,
            counters: Counters::default(),
            generation: 0,
            batch: None,
            staged: Vec::new(),
            large: None,
            constants: VecDeque::new(),
            recorded_constants: Vec::new(),
            clock: None,
            is_held: false,
        })
    }

    /// While held, [`Scene::try_upload`] puts everything off: the programs that it leads to are being made elsewhere.
    #[cfg(feature = "view")]
    pub fn hold(&mut self, is_held: bool) {
        self.is_held = is_held;
    }

    /// Starts to copy a section's new version; the old one, if any, stays named until this one is live.
    /// `false` when the pool has no room.
    pub fn upload(&mut self, key: SectionKey, packed: &Packed) -> Result<bool, GpuError> {
        self.upload_with(key, packed.layout, |words| {
            words.copy_from_slice(&packed.words);
            packed.highest_of.clone()
        })
    }

    /// The same with `write`, which is given the words that are uploaded, all of them to be written once and in
    /// order, right in the upload ring.
    pub fn upload_with(
        &mut self,
        key: SectionKey,
        layout: Layout,
        write: impl FnOnce(&mut [u32]) -> HighestOf,
    ) -> Result<bool, GpuError> {
        while self.large.as_ref().is_some_and(|large| large.key == key) {
            self.wait_for_ring()?;
            self.stage_piece()?;
        }
        if self.staged.contains(&key) {
            self.flush()?;
        }
        let Some(slots) = self.slots(&layout)? else { return Ok(false) };
        let len = layout.uploaded_bytes();
        let highest_of = if len <= RING_BYTES {
            let from = self.ring_place(len)?;
            let highest_of =
                self.ring.buffer().write_with(from, len, |bytes| write(bytemuck::cast_slice_mut(bytes)));
            self.stage(&self.pool.buffer(&slots.uploaded).clone(), slots.uploaded.offset(), from, len)?;
            highest_of
        } else {
            // A payload that is larger than the ring goes in pieces.
            let mut words = vec![0; layout.words as usize];
            let highest_of = write(&mut words);
            let piece_bytes = RING_BYTES as usize / 2;
            for (piece, part) in bytemuck::cast_slice::<u32, u8>(&words).chunks(piece_bytes).enumerate() {
                let from = self.ring_place(part.len() as u64)?;
                self.ring.buffer().write(from, part);
                let at = slots.uploaded.offset() + (piece * piece_bytes) as u64;
                self.stage(&self.pool.buffer(&slots.uploaded).clone(), at, from, part.len() as u64)?;
            }
            highest_of
        };
        self.comes(key, slots, layout, highest_of);
        self.staged.push(key);
        Ok(true)
    }

    /// [`Scene::upload`] without ever waiting for the device: for frames.
    pub fn try_upload(&mut self, key: SectionKey, packed: &Arc<Packed>) -> Result<Upload, GpuError> {
        let len = packed.layout.uploaded_bytes();
        let is_large = len > RING_BYTES;
        if self.is_held
            || self.staged.contains(&key)
            || self.large.as_ref().is_some_and(|l| is_large || l.key == key)
        {
            return Ok(Upload::Later);
        }
        let Some(slots) = self.slots_now(&packed.layout)? else {
            return Ok(if self.freed.is_empty() { Upload::Full } else { Upload::Later });
        };
        if is_large {
            // Each call of `advance` copies a piece.
            self.comes(key, slots, packed.layout, packed.highest_of.clone());
            self.large = Some(Large { key, packed: Arc::clone(packed), copied: 0 });
            return Ok(Upload::Started);
        }
        let Some(from) = self.ring.reserve(&mut self.order, len)? else {
            self.pool.free(slots.uploaded);
            self.pool.free(slots.derived);
            return Ok(Upload::Later);
        };
        self.ring.buffer().write_with(from, len, |bytes| {
            stream_words(bytemuck::cast_slice_mut(bytes), &packed.words);
        });
        self.stage(&self.pool.buffer(&slots.uploaded).clone(), slots.uploaded.offset(), from, len)?;
        self.comes(key, slots, packed.layout, packed.highest_of.clone());
        self.staged.push(key);
        Ok(Upload::Started)
    }

    /// Records the copy of the next piece of a section larger than the ring, if the ring has room for it now.
    fn stage_piece(&mut self) -> Result<(), GpuError> {
        let Some(Large { key, packed, copied }) = &self.large else { return Ok(()) };
        let (key, packed, copied) = (*key, Arc::clone(packed), *copied);
        let all = packed.layout.uploaded_bytes();
        let len = PIECE_BYTES.min(all - copied);
        let Some(from) = self.ring.reserve(&mut self.order, len)? else { return Ok(()) };
        let words = &packed.words[copied as usize / 4..(copied + len) as usize / 4];
        self.ring.buffer().write_with(from, len, |bytes| {
            stream_words(bytemuck::cast_slice_mut(bytes), words);
        });
        let version = self.sections.get(&key).and_then(|resident| resident.coming.as_ref());
        let slot = &version.expect("it comes until all of it is copied").slots.uploaded;
        let (buffer, at) = (self.pool.buffer(slot).clone(), slot.offset() + copied);
        self.stage(&buffer, at, from, len)?;
        self.large = (copied + len < all).then(|| Large { key, packed, copied: copied + len });
        if self.large.is_none() {
            self.staged.push(key);
        }
        Ok(())
    }

    /// Bytes of host memory that are held for a section larger than the ring.
    pub fn staged_bytes(&self) -> u64 {
        self.large.as_ref().map_or(0, |large| 4 * large.packed.words.len() as u64)
    }

    /// A version is on its way.
    fn comes(&mut self, key: SectionKey, slots: Slots, layout: Layout, highest_of: HighestOf) {
        self.counters.section_bytes += layout.uploaded_bytes();
        self.counters.sections += 1;
        let version = Version { slots, layout, highest_of, state: State::Staged };
        let overtaken = self.sections.entry(key).or_default().coming.replace(version);
        if let Some(old) = overtaken {
            self.release(old);
        }
    }

    /// Slots for a version, if there are any now.
    fn slots_now(&mut self, layout: &Layout) -> Result<Option<Slots>, GpuError> {
        let alloc = |pool: &mut Pool| -> Result<Option<Slots>, GpuError> {
            let Some(derived) = pool.alloc(Part::Derived, layout.derived_bytes())? else { return Ok(None) };
            let Some(uploaded) = pool.alloc(Part::Uploaded, layout.uploaded_bytes())? else {
                pool.free(derived);
                return Ok(None);
            };
            Ok(Some(Slots { uploaded, derived }))
        };
        if let Some(slots) = alloc(&mut self.pool)? {
            return Ok(Some(slots));
        }
        // The copy being recorded knows nothing of slots that come back from here on.
        self.flush()?;
        self.reclaim()?;
        alloc(&mut self.pool)
    }

    /// Slots for a version; `None` when there are none even after all that was given back is free.
    fn slots(&mut self, layout: &Layout) -> Result<Option<Slots>, GpuError> {
        loop {
            if let Some(slots) = self.slots_now(layout)? {
                return Ok(Some(slots));
            }
            let Some(last_use) = self.freed.first().and_then(|f| f.uses.last()) else { return Ok(None) };
            self.counters.waits += 1;
            self.order.wait(*last_use)?;
        }
    }

    /// A place for `len` bytes in the upload ring: waits for older copies if it must.
    fn ring_place(&mut self, len: u64) -> Result<u64, GpuError> {
        loop {
            if let Some(from) = self.ring.reserve(&mut self.order, len)? {
                return Ok(from);
            }
            self.wait_for_ring()?;
        }
    }

    /// Waits until a part of the ring is free that is not now.
    fn wait_for_ring(&mut self) -> Result<(), GpuError> {
        self.flush()?;
        if let Some(oldest) = self.ring.oldest() {
            self.counters.waits += 1;
            self.order.wait(oldest)?;
        }
        Ok(())
    }

    /// Records the copy of `len` bytes at `from` of the ring to byte `at` of a page.
    fn stage(&mut self, page: &Buffer, at: u64, from: u64, len: u64) -> Result<(), GpuError> {
        let (mut commands, timestamps) = match self.batch.take() {
            Some(batch) => batch,
            None => {
                let mut after = self.reclaimed.clone();
                if self.pool.access() == Access::StorageBuffer {
                    // Validation takes a bound buffer as touched all over.
                    after.extend(self.last_build.into_iter().chain(self.last_frame));
                }
                let mut commands = self.order.begin_copy("uploads", &after)?;
                let timestamps = self.start_clock(&mut commands)?;
                (commands, timestamps)
            }
        };
        commands.copy(self.ring.buffer(), page, &[BufferCopy { from, to: at, size: len }]);
        self.batch = Some((commands, timestamps));
        Ok(())
    }

    /// Submits the copies recorded so far.
    pub fn flush(&mut self) -> Result<(), GpuError> {
        let Some((commands, timestamps)) = self.batch.take() else { return Ok(()) };
        let point = self.submit(Work::Copy, commands, timestamps)?;
        self.last_copy = Some(point);
        self.ring.seal(point);
        for key in std::mem::take(&mut self.staged) {
            if let Some(version) = self.sections.get_mut(&key).and_then(|r| r.coming.as_mut()) {
                version.state = State::Copying(point);
            }
        }
        Ok(())
    }

    /// Measures every copy and build from now on; see [`Scene::take_times`].
    pub fn time(&mut self) {
        self.clock.get_or_insert_default();
    }

    /// Device times of the work that is done and was not asked for yet, nanoseconds; empty on a device that
    /// cannot tell.
    pub fn take_times(&mut self) -> Result<Vec<(Work, f64)>, GpuError> {
        let Some(clock) = &mut self.clock else { return Ok(Vec::new()) };
        let (mut times, mut still) = (Vec::new(), Vec::new());
        for (work, queue, point, mut timestamps) in clock.running.drain(..) {
            if self.order.reached(point)? {
                times.extend(
                    timestamps.resolve(&mut self.order, point)?.into_iter().map(|(_, ns)| (work, ns)),
                );
                clock.idle.push((queue, timestamps));
            } else {
                still.push((work, queue, point, timestamps));
            }
        }
        clock.running = still;
        Ok(times)
    }

    fn start_clock(&mut self, commands: &mut Commands) -> Result<Option<Timestamps>, GpuError> {
        let Some(clock) = &mut self.clock else { return Ok(None) };
        let queue = commands.queue();
        let idle = clock.idle.iter().position(|(of, _)| *of == queue).map(|at| clock.idle.swap_remove(at).1);
        let mut timestamps = match idle {
            Some(timestamps) => Some(timestamps),
            None => Timestamps::new(&self.gpu, "sections", queue, 1)?,
        };
        timestamps.iter_mut().for_each(|t| t.begin(commands));
        Ok(timestamps)
    }

    fn submit(
        &mut self,
        work: Work,
        mut commands: Commands,
        timestamps: Option<Timestamps>,
    ) -> Result<SyncPoint, GpuError> {
        let queue = commands.queue();
        let timestamps = timestamps.map(|mut timestamps| {
            timestamps.end(&mut commands, "all");
            timestamps
        });
        let point = self.order.submit(commands)?;
        if work == Work::Build {
            self.constants.extend(self.recorded_constants.drain(..).map(|buffer| (point, buffer)));
        }
        if let (Some(clock), Some(timestamps)) = (&mut self.clock, timestamps) {
            clock.running.push((work, queue, point, timestamps));
        }
        Ok(point)
    }

    /// Takes sections out; their slots are free once nothing can read them any more. Their neighbours lose the
    /// bridges that led to them.
    pub fn remove(&mut self, keys: &[SectionKey]) -> Result<(), GpuError> {
        if keys.is_empty() {
            return Ok(());
        }
        self.flush()?;
        if let Some(large) = self.large.take_if(|large| keys.contains(&large.key))
            && let Some(version) = self.sections.get_mut(&large.key).and_then(|r| r.coming.as_mut())
            && let Some(point) = self.last_copy
        {
            // Its pieces may still be on their way into the slot.
            version.state = State::Copying(point);
        }
        self.generation += 1;
        let gone: BTreeMap<_, _> =
            keys.iter().filter_map(|&key| Some((key, self.sections.remove(&key)?))).collect();
        let near = self.jobs(&self.rebuilt_with(&gone.keys().copied().collect()), &BTreeSet::new());
        self.build(&[], &near, &[])?;
        for resident in gone.into_values() {
            resident.live.into_iter().chain(resident.coming).for_each(|v| self.release(v));
        }
        Ok(())
    }

    fn release(&mut self, version: Version) {
        let mut uses = Vec::new();
        if let State::Copying(point) | State::Building(point) = version.state {
            uses.push(point);
        }
        uses.extend(self.last_build);
        uses.extend(self.last_frame);
        self.freed.push(Freed { slots: version.slots, uses });
    }

    /// Gives slots back to the pool whose last use the host has seen over.
    fn reclaim(&mut self) -> Result<(), GpuError> {
        let mut still = Vec::new();
        for freed in std::mem::take(&mut self.freed) {
            let mut over = true;
            for &point in &freed.uses {
                over &= self.order.reached(point)?;
            }
            if over {
                for point in freed.uses {
                    match self.reclaimed.iter_mut().find(|p| p.queue() == point.queue()) {
                        Some(known) if known.value() >= point.value() => {}
                        Some(known) => *known = point,
                        None => self.reclaimed.push(point),
                    }
                }
                self.pool.free(freed.slots.uploaded);
                self.pool.free(freed.slots.derived);
            } else {
                still.push(freed);
            }
        }
        self.freed = still;
        self.order.collect()
    }

    /// Moves every version on that the device is done with: copied ones are built (together with the
    /// neighbours whose bridges they change), built ones go live. Never waits. Call it once a frame.
    pub fn advance(&mut self) -> Result<(), GpuError> {
        self.stage_piece()?;
        self.flush()?;
        self.reclaim()?;
        let (mut copied, mut done) = (Vec::new(), Vec::new());
        for (&key, resident) in &self.sections {
            match resident.coming.as_ref().map(|v| v.state) {
                Some(State::Copying(point)) if self.order.reached(point)? => copied.push((key, point)),
                Some(State::Building(point)) if self.order.is_live(point)? => done.push(key),
                _ => {}
            }
        }
        for key in done {
            let resident = self.sections.get_mut(&key).expect("just seen");
            let mut version = resident.coming.take().expect("just seen");
            version.state = State::Live;
            if let Some(old) = resident.live.replace(version) {
                self.release(old);
            }
            self.generation += 1;
        }
        if copied.is_empty() {
            return Ok(());
        }
        let points: Vec<_> = copied.iter().map(|&(_, point)| point).collect();
        let fresh: BTreeSet<_> = copied.into_iter().map(|(key, _)| key).collect();
        let tops: Vec<_> = fresh.iter().filter_map(|&key| self.job_of_coming(key, &fresh)).collect();
        let all = self.jobs(&self.rebuilt_with(&fresh), &fresh);
        self.build(&tops, &all, &points)?;
        // What follows on this queue comes after the build.
        let built = self.last_build.expect("just submitted");
        for key in fresh {
            if let Some(version) = self.sections.get_mut(&key).and_then(|r| r.coming.as_mut()) {
                version.state = State::Building(built);
            }
        }
        Ok(())
    }

    /// Sections whose bridges and pyramids follow from the columns of `keys`.
    fn rebuilt_with(&self, keys: &BTreeSet<SectionKey>) -> BTreeSet<SectionKey> {
        match self.visibility.bridge {
            0 => keys.clone(),
            _ => keys.iter().flat_map(|&key| around(key)).collect(),
        }
    }

    /// The job of the version of `key` that is on its way.
    fn job_of_coming(&self, key: SectionKey, fresh: &BTreeSet<SectionKey>) -> Option<Task> {
        let [x, y] = self.pool.place(&self.sections.get(&key)?.coming.as_ref()?.slots.uploaded, 0);
        self.jobs(&BTreeSet::from([key]), fresh).into_iter().find(|task| task.job.section[..2] == [x, y])
    }

    /// Waits until the device is through with all copies and builds submitted so far.
    pub fn wait(&mut self) -> Result<(), GpuError> {
        self.flush()?;
        let coming = self.sections.values().filter_map(|r| match r.coming.as_ref()?.state {
            State::Copying(point) | State::Building(point) => Some(point),
            State::Staged | State::Live => None,
        });
        let points: HashSet<_> = coming.chain(self.last_build).collect();
        points.into_iter().try_for_each(|point| self.order.wait(point))
    }

    /// Waits until every section is live.
    pub fn settle(&mut self) -> Result<(), GpuError> {
        loop {
            self.advance()?;
            let next = self.sections.values().filter_map(|r| match r.coming.as_ref()?.state {
                State::Copying(point) | State::Building(point) => Some(point),
                State::Staged | State::Live => None,
            });
            match next.max_by_key(|p| p.value()) {
                Some(point) => self.order.wait(point)?,
                None if self.large.is_some() => self.wait_for_ring()?,
                None => return Ok(()),
            }
        }
    }

    /// Shows other things: the derived parts of all resident sections are built again; nothing is copied.
    pub fn show(&mut self, visibility: Visibility) -> Result<(), GpuError> {
        if visibility != self.visibility {
            self.visibility = visibility;
            self.generation += 1;
            self.rebuild()?;
        }
        Ok(())
    }

    /// Lets columns carry other things; as [`Scene::show`].
    pub fn carry(&mut self, carried: Carried) -> Result<(), GpuError> {
        if carried != self.carried {
            self.carried = carried;
            self.rebuild()?;
        }
        Ok(())
    }

    fn rebuild(&mut self) -> Result<(), GpuError> {
        let all: BTreeSet<_> = self.sections.keys().copied().collect();
        let tops = self.jobs(&all, &BTreeSet::new());
        self.build(&tops, &tops, &[])
    }

    /// One job for every built version of `keys`, and for those of `fresh`, whose copies are there.
    fn jobs(&self, keys: &BTreeSet<SectionKey>, fresh: &BTreeSet<SectionKey>) -> Vec<Task> {
        let is_built = |key: &SectionKey, v: &Version| {
            !matches!(v.state, State::Staged | State::Copying(_)) || fresh.contains(key)
        };
        let newest = |key: SectionKey| -> Option<&Version> {
            let resident = self.sections.get(&key)?;
            resident.coming.as_ref().filter(|v| is_built(&key, v)).or(resident.live.as_ref())
        };
        let derived = |v: &Version| {
            let [x, y] = self.pool.place(&v.slots.derived, 0);
            [x, y, v.layout.code.base as u32, v.layout.code.wide.into()]
        };
        let mut jobs = Vec::new();
        for key in keys {
            let Some(resident) = self.sections.get(key) else { continue };
            let coming = resident.coming.as_ref().filter(|v| is_built(key, v));
            for version in resident.live.iter().chain(coming) {
                let mut near = around(*key).map(|near| newest(near).map_or([0; 4], derived));
                near[4] = derived(version);
                let [x, y] = self.pool.place(&version.slots.uploaded, 0);
                let Layout { counts, others, .. } = version.layout;
                // Gaps steeper than 45° are edges.
                let steep = self.grid.cell_steps(key.level).clamp(1.0, STEEPEST) as u32;
                let job = Job { section: [x, y, counts, others], near, slopes: [steep, 0, 0, 0] };
                let all = version.highest_of.iter().all(|(c, w, _)| self.visibility.shows(*c, *w));
                jobs.push(Task { job, wide: version.layout.code.wide, all });
            }
        }
        jobs
    }

    /// Submits the derived passes: tops of `tops`, then bridges and pyramids of `all`. Nothing runs for long: a
    /// frame is never far behind.
    fn build(&mut self, tops: &[Task], all: &[Task], copied: &[SyncPoint]) -> Result<(), GpuError> {
        // Without bridges nothing follows from what others hold.
        let bridge = self.visibility.bridge > 0;
        let all = if bridge { all } else { tops };
        if tops.is_empty() && all.is_empty() {
            return Ok(());
        }
        let words = self.visibility.classes.0;
        let derive = Derive {
            visible: words,
            visible_withheld: if self.visibility.withheld { words } else { [0; 8] },
            bridge: self.visibility.bridge.min(4),
            values: (self.carried == Carried::Values).into(),
        };
        let params = self.constant(bytemuck::bytes_of(&derive))?;
        let mut after = copied.to_vec();
        if self.pool.access() == Access::StorageBuffer {
            // Validation takes a bound buffer as touched all over.
            after.extend(self.last_copy);
        }
        for tasks in tops.chunks(SUBMIT_SECTIONS) {
            let mut commands = self.order.begin_build("tops", &after)?;
            let timestamps = self.start_clock(&mut commands)?;
            self.run(&mut commands, Pass::Tops, tasks, &params)?;
            if !bridge {
                self.order.next_pass(&mut commands);
                self.run(&mut commands, Pass::Pyramid, tasks, &params)?;
            }
            self.last_build = Some(self.submit(Work::Build, commands, timestamps)?);
        }
        for tasks in all.chunks(SUBMIT_SECTIONS).filter(|_| bridge) {
            let mut commands =
                self.order.begin_build("bridges and pyramids", if tops.is_empty() { &after } else { &[] })?;
            let timestamps = self.start_clock(&mut commands)?;
            self.run(&mut commands, Pass::Bridge, tasks, &params)?;
            self.order.next_pass(&mut commands);
            self.run(&mut commands, Pass::Pyramid, tasks, &params)?;
            self.last_build = Some(self.submit(Work::Build, commands, timestamps)?);
        }
        self.counters.builds += all.len() as u64;
        // All of its submits read it.
        self.constants.extend(self.last_build.map(|point| (point, params)));
        let too_many = self.constants.len().saturating_sub(MOST_CONSTANTS);
        self.constants.drain(..too_many);
        Ok(())
    }

    /// Dispatches one pass, each variant for the sections that want it.
    fn run(
        &mut self,
        commands: &mut Commands,
        pass: Pass,
        tasks: &[Task],
        params: &Buffer,
    ) -> Result<(), GpuError> {
        let bridge = self.visibility.bridge > 0;
        let variant = |task: &Task| match pass {
            Pass::Tops => [task.wide, task.all, bridge],
            Pass::Bridge | Pass::Pyramid => [task.wide, false, false],
        };
        let mut variants: BTreeMap<_, Vec<Job>> = BTreeMap::new();
        tasks.iter().for_each(|task| variants.entry(variant(task)).or_default().push(task.job));
        for (k, (variant, jobs)) in variants.into_iter().enumerate() {
            if k > 0 && self.pool.access() == Access::StorageBuffer {
                // Validation takes a bound buffer as touched all over.
                self.order.next_pass(commands);
            }
            let n = jobs.len() as u32;
            let groups = match pass {
                // A thread a half block.
                Pass::Tops | Pass::Bridge => [2 * SECTION_BLOCKS as u32 / PASS_THREADS, n, 1],
                Pass::Pyramid => [n, 1, 1],
            };
            let program = self.program(pass, variant)?;
            self.dispatch(commands, &program, &jobs, params, groups)?;
        }
        Ok(())
    }

    fn program(&mut self, pass: Pass, variant: [bool; 3]) -> Result<ComputePipeline, GpuError> {
        if let Some(known) = self.passes.get(&(pass, variant)) {
            return Ok(known.clone());
        }
        let program = pass.recipe(variant, self.pool.access()).make(&self.gpu)?;
        self.passes.insert((pass, variant), program.clone());
        Ok(program)
    }

    fn dispatch(
        &mut self,
        commands: &mut Commands,
        program: &ComputePipeline,
        jobs: &[Job],
        params: &Buffer,
        groups: [u32; 3],
    ) -> Result<(), GpuError> {
        let jobs = self.constant(bytemuck::cast_slice(jobs))?;
        self.recorded_constants.push(jobs.clone());
        commands.bind(program);
        match self.pool.access() {
            Access::Address | Access::Texels => {
                commands.push(bytemuck::cast_slice(&[jobs.address(), params.address()]));
                self.pool.buffers().for_each(|b| commands.keep(b.clone()));
                commands.keep(jobs);
                commands.keep(params.clone());
            }
            Access::StorageBuffer => {
                let pool = self.pool.buffers().next().expect("a section is resident");
                commands.bind_buffers(&program.binding(&[pool, &jobs, params])?);
            }
        }
        commands.dispatch(groups);
        Ok(())
    }

    /// A buffer that begins with `bytes`, of which there are no more than [`CONSTANT_BYTES`]: one that an earlier build
    /// is known to be done with, if there is one.
    fn constant(&mut self, bytes: &[u8]) -> Result<Buffer, GpuError> {
        let is_free = match self.constants.front() {
            Some((point, _)) => self.order.is_known_done(*point),
            None => false,
        };
        let free = if is_free { self.constants.pop_front() } else { None };
        let buffer = match free {
            Some((_, buffer)) => buffer,
            None => Buffer::new(&self.gpu, "what derived passes read", MemoryKind::Upload, CONSTANT_BYTES)?,
        };
        buffer.write(0, bytes);
        Ok(buffer)
    }

    /// Reads a live section back. For tests; waits.
    pub fn read(&mut self, key: SectionKey) -> Result<Option<ReadBack>, GpuError> {
        let Some(version) = self.sections.get(&key).and_then(|r| r.live.as_ref()) else { return Ok(None) };
        let layout = version.layout;
        let parts = [
            (&version.slots.uploaded, layout.uploaded_bytes()),
            (&version.slots.derived, layout.derived_bytes()),
        ]
        .map(|(slot, size)| (self.pool.buffer(slot).clone(), slot.offset(), size));
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

    /// The highest thing that is shown of a live section.
    fn highest(&self, key: SectionKey) -> Option<Height> {
        let version = self.sections.get(&key)?.live.as_ref()?;
        let shown = version.highest_of.iter().filter(|(c, w, _)| self.visibility.shows(*c, *w));
        shown.map(|(_, _, h)| *h).max()
    }

    /// Whether tables have nothing to name: no live section shows anything.
    pub fn shows_nothing(&self) -> bool {
        self.sections.keys().all(|&key| self.highest(key).is_none())
    }

    /// Kinds of points in live sections, shown or not.
    pub fn kinds(&self) -> Kinds {
        let versions = self.sections.values().filter_map(|resident| resident.live.as_ref());
        versions
            .flat_map(|version| &version.highest_of)
            .map(|&(class, withheld, _)| (class, withheld))
            .collect()
    }

    /// What a table may name now: live sections that show anything, in key order.
    pub fn entries(&self) -> Vec<Entry> {
        self.entries_of(self.sections.keys().map(|&key| (key, key)))
    }

    /// The same for some places and the section that each is to show: its own, or a coarser one around it. In the
    /// order of the places.
    pub fn entries_of(&self, shown: impl IntoIterator<Item = (SectionKey, SectionKey)>) -> Vec<Entry> {
        let highest = |key: &SectionKey| self.highest(*key);
        let entry = |(at, key): (SectionKey, SectionKey)| {
            let version = self.sections.get(&key)?.live.as_ref()?;
            // Bridges rise no higher than what they lead to, which may be a neighbour's.
            let top = match self.visibility.bridge {
                0 => highest(&key)?,
                _ => around(key).iter().filter_map(highest).max()?,
            };
            let pyramid = self.pool.place_to_read(&version.slots.derived, 0);
            Some(Entry { key: at, detail: key.level, pyramid, code: version.layout.code, top })
        };
        let mut entries: Vec<_> = shown.into_iter().filter_map(entry).collect();
        entries.sort_unstable_by_key(|e| e.key);
        entries
    }

    /// Whether tables may name a section.
    pub fn is_live(&self, key: SectionKey) -> bool {
        self.sections.get(&key).is_some_and(|resident| resident.live.is_some())
    }

    /// A number that changes whenever tables may name other things.
    pub fn generation(&self) -> u64 {
        self.generation
    }

    /// Whether a version of a section is on its way.
    pub fn is_coming(&self, key: SectionKey) -> bool {
        self.sections.get(&key).is_some_and(|resident| resident.coming.is_some())
    }

    /// Whether versions are on their way.
    pub fn is_busy(&self) -> bool {
        self.sections.values().any(|resident| resident.coming.is_some())
    }

    /// Bytes of the pool that a section takes.
    pub fn bytes_of(&self, key: SectionKey) -> u64 {
        let versions = self.sections.get(&key).into_iter().flat_map(|r| r.live.iter().chain(&r.coming));
        versions.map(|version| section_bytes(&version.layout)).sum()
    }

    /// Sections that are here or on their way.
    pub fn resident(&self) -> impl Iterator<Item = SectionKey> {
        self.sections.keys().copied()
    }

    /// Tells that a frame which could read every live section was submitted.
    pub fn drawn(&mut self, frame: SyncPoint) {
        self.last_frame = Some(frame);
    }

    /// The pool: its pages are kept by the commands that read them.
    pub fn pool(&self) -> &Pool {
        &self.pool
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
        self.counters
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::layout::{assert_in, members};

    #[test]
    fn shaders_see_jobs_and_masks_as_they_are_written() {
        let first = [("tops", shaders::TOPS), ("tops, POOL_SSBO", shaders::TOPS_SSBO)];
        let second = [("bridge", shaders::BRIDGE), ("bridge, POOL_SSBO", shaders::BRIDGE_SSBO)];
        let third = [("pyramid", shaders::PYRAMID), ("pyramid, POOL_SSBO", shaders::PYRAMID_SSBO)];
        let masked = members!(Derive { visible, visible_withheld, bridge, values });
        for pass in [&first, &second, &third] {
            assert_in(pass, &members!(Job { section, near, slopes }));
        }
        // The pyramid is built from what the mask has left.
        assert_in(&first, &masked);
        assert_in(&second, &masked);
    }
}
