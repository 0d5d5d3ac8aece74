//! The image in a window: one sample after the other while nothing changes, a band of rows a frame, and what lies
//! under the cursor.

use super::frame::{Band, FrameError, HitRecord, Renderer, View, ViewRays, derive_colors, halves, sample_at};
use crate::attribute::Channel;
use crate::gpu::{
    Buffer, BufferCopy, Commands, ComputePipeline, GpuError, MemoryKind, PipelineDesc, QueueKind, SyncPoint,
    Timestamps, TracedImage, shaders,
};
use crate::resident::scene::Scene;
use crate::resident::table::Table;
use crate::shared::passes::{
    BITS_CLASS_MASK, BITS_DETAIL_MASK, BITS_DETAIL_SHIFT, BITS_FACE_MASK, BITS_FACE_SHIFT, BITS_ORIGIN_MASK,
    BITS_ORIGIN_SHIFT, BITS_STANDS_IN, FACE_TOP, HIT_VALUE_SHIFT, ORIGIN_BRIDGED, SCREEN_THREADS, WIDE_TILE,
};
use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use std::sync::Arc;

/// Threads of a workgroup of `shaders/screen.comp`.
const GROUP: u32 = SCREEN_THREADS;
/// Bytes of a hit record.
const HIT_BYTES: u64 = size_of::<HitRecord>() as u64;
/// Bands start at multiples of this many rows, the side of the widest beams.
const ROWS: u32 = WIDE_TILE;

/// Mirrors the push constants of `shaders/screen.comp`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct ScreenPush {
    sums: [u32; 2],
    words: [u32; 2],
    width: u32,
    scale: f32,
}

/// What a ray has hit: a place on a column, and the record that the column is of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PickedPoint {
    /// The place as it is shown, vertical exaggeration included.
    pub shown: DVec3,
    /// True height of the record, to half a step of the heights' lattice: the highest of its column that is shown.
    pub height: f64,
    /// Class of the record; of one that is as high, where near ties count: see [`crate::resident::visibility::Visibility`].
    pub class: u8,
    /// What the record holds in its channel, where colours are by that.
    pub value: Option<(Channel, u16)>,
    /// How far the place lies below the record, on the column's side (or within it, where the eye is); `None`: on its top.
    pub below: Option<f64>,
    /// The column holds no record: it bridges a hole, as high as those around.
    pub is_bridged: bool,
    /// Of the column's side, CRS units, where it is not one of the finest cells.
    pub coarse_cell: Option<f64>,
    /// The column stands in for finer ones, which are still to come.
    pub stands_in: bool,
}

impl PickedPoint {
    /// Of a finished hit record; `None`: nothing was hit.
    fn of(renderer: &Renderer, asked: &PendingPick, hit: &HitRecord) -> Option<PickedPoint> {
        let class = u8::try_from(hit.bits & BITS_CLASS_MASK).ok()?;
        let (shown, [place, height]) = renderer.point_of(&asked.rays, hit, asked.pixel);
        let is_top = hit.bits >> BITS_FACE_SHIFT & BITS_FACE_MASK == FACE_TOP;
        let detail = hit.bits >> BITS_DETAIL_SHIFT & BITS_DETAIL_MASK;
        Some(PickedPoint {
            shown,
            height,
            class,
            value: asked.channel.map(|channel| (channel, (hit.rest >> HIT_VALUE_SHIFT) as u16)),
            below: (!is_top).then(|| (height - place).max(0.0)),
            is_bridged: hit.bits >> BITS_ORIGIN_SHIFT & BITS_ORIGIN_MASK == ORIGIN_BRIDGED,
            coarse_cell: (detail > 0).then(|| renderer.cell_of(detail)),
            stands_in: hit.bits & BITS_STANDS_IN != 0,
        })
    }
}

/// What was found under a point of the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pick {
    /// Shares of the image's width and height, from the top left.
    pub at: [f64; 2],
    /// `None`: nothing but background.
    pub point: Option<PickedPoint>,
}

/// The image that is being made.
struct Refinement {
    size: [u32; 2],
    sample: u32,
    next_row: u32,
}

/// Hit records on the device, and what their rays were.
#[derive(Clone)]
struct Hits {
    rays: ViewRays,
    /// What values of records mean, where colours are by those.
    channel: Option<Channel>,
    size: [u32; 2],
    /// Where in a pixel the rays went through, pixels from its centre.
    offset: [f64; 2],
}

/// A hit record on its way to the host.
struct PendingPick {
    at: [f64; 2],
    pixel: [f64; 2],
    rays: ViewRays,
    channel: Option<Channel>,
    point: Option<SyncPoint>,
}

/// What exists once for every frame in flight.
#[derive(Default)]
struct ScreenSlot {
    back: Option<Buffer>,
    asked: Option<PendingPick>,
    clock: Option<Timestamps>,
    /// What is timed, and its pixels.
    timed: Option<(SyncPoint, u64)>,
}

/// The image in a window.
#[derive(Default)]
pub struct Screen {
    /// Made when first used.
    pack: Option<ComputePipeline>,
    words: Option<Buffer>,
    shown: Option<[u32; 2]>,
    work: Option<Refinement>,
    hits: Option<Hits>,
    slots: Vec<ScreenSlot>,
    /// Rows that the frame being recorded traces.
    rows: u32,
    /// And the pixels that are timed.
    clocked: Option<u64>,
}

/// The pipeline of images in a window, beside those of [`super::frame::pipeline_descs`].
pub fn desc() -> PipelineDesc {
    let push_bytes = size_of::<ScreenPush>() as u32;
    PipelineDesc { name: "screen", words: shaders::SCREEN, constants: Vec::new(), push_bytes, bindings: &[] }
}

impl Screen {
    /// Forgets what is under way: the scene is another one. The last image stays.
    pub fn forget(&mut self) {
        (self.work, self.hits) = (None, None);
        self.slots.clear();
    }

    /// Begins an image of `size`; the last one that is whole stays until its first sample is there.
    pub fn start(&mut self, size: [u32; 2]) {
        self.work = Some(Refinement { size, sample: 0, next_row: 0 });
    }

    /// Pixels of the image that is being made.
    pub fn size(&self) -> Option<[u32; 2]> {
        self.work.as_ref().map(|work| work.size)
    }

    /// Samples that are whole of the image being made.
    pub fn samples(&self) -> u32 {
        self.work.as_ref().map_or(0, |work| work.sample)
    }

    /// Has the scene derive what `view` colours by; before the frame begins.
    pub fn prepare(&self, scene: &mut Scene, view: &View) -> Result<(), GpuError> {
        derive_colors(scene, view)
    }

    /// Records the next band of `view`, whose size is that of [`Screen::start`], in frame `slot`: at most `rows` rows
    /// (rounded up to 64) of one of `view.samples` samples. Nothing when all samples are there.
    pub fn record(
        &mut self,
        renderer: &mut Renderer,
        scene: &mut Scene,
        (commands, slot): (&mut Commands, usize),
        view: &View,
        table: &Arc<Table>,
        rows: u32,
    ) -> Result<(), FrameError> {
        (self.rows, self.clocked) = (0, None);
        let Some(Refinement { size, sample, next_row }) = self.work else { return Ok(()) };
        if sample >= view.samples {
            return Ok(());
        }
        assert_eq!(size, view.size, "the image that was started");
        let [width, height] = size;
        let rows = rows.max(1).next_multiple_of(ROWS).min(height - next_row);
        let samples = view.samples;
        let band =
            Band { first_row: next_row, rows, sample, samples, read: false, screen: false, whole: true };
        let rays = renderer.rays(view)?;
        self.slot(slot);
        let timed = &mut self.slots[slot];
        if timed.clock.is_none() {
            timed.clock = Timestamps::new(scene.gpu(), "window", QueueKind::Compute, super::frame::PASSES)?;
        }
        let clock = timed.clock.as_mut().filter(|_| timed.timed.is_none());
        self.clocked = clock.is_some().then(|| u64::from(width) * u64::from(rows));
        renderer.record(scene, (commands, slot), view, table, &rays, band, clock)?;
        self.rows = rows;
        let done = next_row + rows == height;
        // Of a first sample in bands, records are of two images until it is whole.
        if sample == 0 && !done {
            self.hits = None;
        }
        self.work = Some(if done {
            Refinement { size, sample: sample + 1, next_row: 0 }
        } else {
            Refinement { size, sample, next_row: next_row + rows }
        });
        if done {
            let offset = sample_at(sample, samples).map(|sixteenths| f64::from(sixteenths - 8) / 16.0);
            self.hits = Some(Hits { rays, channel: view.colors.channel, size, offset });
            let bytes = u64::from(width) * u64::from(height) * 4;
            let words = match self.words.take().filter(|b| b.size() >= bytes) {
                Some(words) => words,
                None => Buffer::new(scene.gpu(), "window", MemoryKind::Device, bytes)?,
            };
            let [sums, _] = renderer.sums_and_hits().expect("recorded");
            let push = ScreenPush {
                sums: halves(sums.address()),
                words: halves(words.address()),
                width,
                scale: samples as f32 / (sample + 1) as f32,
            };
            scene.order.next_pass(commands);
            let pack = match self.pack.take() {
                Some(pack) => pack,
                None => desc().make(scene.gpu())?,
            };
            commands.bind(&pack);
            self.pack = Some(pack);
            commands.push(bytemuck::bytes_of(&push));
            commands.keep(sums.clone());
            commands.keep(words.clone());
            commands.dispatch([width.div_ceil(GROUP), height, 1]);
            self.words = Some(words);
            self.shown = Some(size);
        }
        Ok(())
    }

    /// Asks in frame `slot` what lies at `at` (shares of the image's width and height); [`Screen::take_picks`] tells.
    /// `false`: no image is whole now, ask again.
    pub fn ask(
        &mut self,
        renderer: &Renderer,
        scene: &mut Scene,
        (commands, slot): (&mut Commands, usize),
        at: [f64; 2],
    ) -> Result<bool, GpuError> {
        let (Some(hits), Some([_, records])) = (self.hits.clone(), renderer.sums_and_hits()) else {
            return Ok(false);
        };
        self.slot(slot);
        let slot = &mut self.slots[slot];
        let pixel: [u32; 2] = std::array::from_fn(|axis| {
            ((at[axis] * f64::from(hits.size[axis])).floor().max(0.0) as u32).min(hits.size[axis] - 1)
        });
        let back = match &slot.back {
            Some(back) => back.clone(),
            None => Buffer::new(scene.gpu(), "record under the cursor", MemoryKind::Readback, HIT_BYTES)?,
        };
        let from = (u64::from(pixel[1]) * u64::from(hits.size[0]) + u64::from(pixel[0])) * HIT_BYTES;
        let copy = BufferCopy { from, to: 0, size: HIT_BYTES };
        scene.order.readback(commands, &[(records, &back, copy)]);
        slot.back = Some(back);
        let pixel = std::array::from_fn(|axis| f64::from(pixel[axis]) + hits.offset[axis]);
        slot.asked = Some(PendingPick { at, pixel, rays: hits.rays, channel: hits.channel, point: None });
        Ok(true)
    }

    /// Records that the sums of all samples are copied for the host, as [`super::image::Image::color`] has them; instead
    /// of [`Screen::ask`].
    pub fn copy(
        &self,
        renderer: &Renderer,
        scene: &mut Scene,
        commands: &mut Commands,
    ) -> Result<Option<Buffer>, GpuError> {
        let (Some([sums, _]), Some([width, height])) = (renderer.sums_and_hits(), self.shown) else {
            return Ok(None);
        };
        let size = u64::from(width) * u64::from(height) * 16;
        let back = Buffer::new(scene.gpu(), "picture read back", MemoryKind::Readback, size)?;
        scene.order.readback(commands, &[(sums, &back, BufferCopy { from: 0, to: 0, size })]);
        Ok(Some(back))
    }

    /// Tells that frame `slot` was submitted.
    pub fn submitted(&mut self, slot: usize, point: SyncPoint) {
        self.slot(slot);
        let slot = &mut self.slots[slot];
        if let Some(asked) = &mut slot.asked {
            asked.point.get_or_insert(point);
        }
        if let Some(pixels) = self.clocked.take() {
            slot.timed = Some((point, pixels));
        }
        self.rows = 0;
    }

    /// Rows that the frame being recorded traces.
    pub fn rows(&self) -> u32 {
        self.rows
    }

    /// What was asked for and is there by now, latest last; waits for nothing.
    pub fn take_picks(&mut self, renderer: &Renderer, scene: &mut Scene) -> Result<Vec<Pick>, GpuError> {
        let mut picks = Vec::new();
        for slot in &mut self.slots {
            let Some(PendingPick { point: Some(point), .. }) = slot.asked else { continue };
            if !scene.order.reached(point)? {
                continue;
            }
            let (Some(asked), Some(back)) = (slot.asked.take(), &slot.back) else { continue };
            let mut hit = HitRecord::zeroed();
            scene.order.read(point, back, 0, bytemuck::bytes_of_mut(&mut hit))?;
            let found = PickedPoint::of(renderer, &asked, &hit);
            picks.push((point.value(), Pick { at: asked.at, point: found }));
        }
        picks.sort_by_key(|(value, _)| *value);
        Ok(picks.into_iter().map(|(_, pick)| pick).collect())
    }

    /// Pixels that were traced and the milliseconds that it took, of frames that are done, each told once; waits for
    /// nothing.
    pub fn take_times(&mut self, scene: &mut Scene) -> Result<Vec<(u64, f64)>, GpuError> {
        let mut times = Vec::new();
        for slot in &mut self.slots {
            let (Some((point, pixels)), Some(clock)) = (slot.timed, &mut slot.clock) else { continue };
            if scene.order.reached(point)? {
                slot.timed = None;
                let passes = clock.resolve(&mut scene.order, point)?;
                times.push((pixels, passes.iter().map(|(_, ns)| ns / 1e6).sum()));
            }
        }
        Ok(times)
    }

    /// The last image that is whole, to be shown at `place` (see [`TracedImage`]).
    pub fn image_at(&self, place: [u32; 4]) -> Option<TracedImage<'_>> {
        Some(TracedImage { words: self.words.as_ref()?, size: self.shown?, place })
    }

    fn slot(&mut self, slot: usize) {
        self.slots.resize_with(self.slots.len().max(slot + 1), ScreenSlot::default);
    }
}
