//! Frames of a scene: their passes are recorded and submitted, and come back as an image where one is wanted.

use super::super::camera::CameraError;
use super::super::image::{Image, Values};
use super::bands::{Band, band_rows, check_size};
use super::buffers::{BYTES_PER_PIXEL, FrameInputs, FrameTargets};
use super::error::FrameError;
use super::mirrors::{FrameConstants, FramePush, HitRecord, distance_and_height, ground_heights, halves};
use super::options::{PassOptions, PassRepeats, View};
use super::pipelines::{FramePass, FramePipelines, Seen};
use super::rays::ViewRays;
use crate::attribute::ColorMode;
use crate::coords::{Grid, Height};
use crate::gpu::{Binding, Buffer, BufferCopy, Commands, GpuError, SyncPoint, Timestamps};
use crate::resident::cut::Shown;
use crate::resident::live::Live;
use crate::resident::pool::Access;
use crate::resident::scene::Scene;
use crate::resident::table::Table;
use crate::resident::visibility::ColumnData;
use crate::shared::passes::{
    BITS_CLASS_MASK, BITS_FACE_MASK, BITS_FACE_SHIFT, BITS_MISS, BITS_ORIGIN_MASK, BITS_ORIGIN_SHIFT,
    HIT_VALUE_SHIFT, MOST_STEPS,
};
use bytemuck::Zeroable;
#[cfg(feature = "view")]
use glam::DVec3;
use std::sync::Arc;

/// Has the columns of `scene` show what `view` colours by. Before a frame begins: it may be work of its own.
pub(in super::super) fn derive_colors(scene: &mut Scene, view: &View) -> Result<(), GpuError> {
    match view.colors.mode {
        ColorMode::Rgb => scene.set_column_data(ColumnData::Colors),
        ColorMode::Intensity
        | ColorMode::Return
        | ColorMode::SourceId
        | ColorMode::ScanAngle
        | ColorMode::GpsTime
        | ColorMode::HeightAboveGround
        | ColorMode::Density
        | ColorMode::LineDifference => scene.set_column_data(ColumnData::Values),
        ColorMode::Class | ColorMode::Height => Ok(()),
    }
}

/// Makes images of a scene.
pub struct Renderer {
    pipelines: FramePipelines,
    pub(super) access: Access,
    pub(super) options: PassOptions,
    repeats: PassRepeats,
    /// Of a logged pass: on the device, and for the host.
    pub(super) log: Option<[Buffer; 2]>,
    in_flight: Vec<Option<FrameInputs>>,
    targets: Option<FrameTargets>,
    /// Lattice height of local height 0.
    anchor: Height,
    grid: Grid,
    /// The table of [`Renderer::table_of_live`], and of which generation of the scene and of what is shown.
    live_table: Option<([u64; 2], Arc<Table>)>,
}

impl Renderer {
    /// For scenes on `grid`, with heights counted from `anchor` on the device.
    pub fn new(scene: &Scene, grid: Grid, anchor: Height) -> Result<Renderer, GpuError> {
        Renderer::with_options(scene, grid, anchor, PassOptions::of(scene.gpu().info().kind))
    }

    /// The same with other groups or orders.
    pub fn with_options(
        scene: &Scene,
        grid: Grid,
        anchor: Height,
        options: PassOptions,
    ) -> Result<Renderer, GpuError> {
        let access = scene.pool().access();
        Ok(Renderer {
            pipelines: FramePipelines::new(scene.gpu(), access, options)?,
            access,
            options,
            repeats: PassRepeats::ONCE,
            log: None,
            in_flight: Vec::new(),
            targets: None,
            anchor,
            grid,
            live_table: None,
        })
    }

    /// Draws `view` of all that is live, and waits for it.
    pub fn draw(&mut self, scene: &mut Scene, view: &View) -> Result<Image, FrameError> {
        let table = self.table(scene);
        self.draw_table(scene, view, &table)
    }

    /// Draws `view` of what `table` names, and waits for it.
    pub fn draw_table(
        &mut self,
        scene: &mut Scene,
        view: &View,
        table: &Arc<Table>,
    ) -> Result<Image, FrameError> {
        check_size(scene.gpu(), view.size)?;
        let rays = self.rays(view)?;
        let mut image = Image::new(view.size);
        let codes = || vec![0; image.class.len()];
        image.values = view.colors.channel.map(|channel| Values { channel, codes: codes() });
        let [width, height] = view.size;
        let samples = view.samples.max(1);
        let mut hits = Vec::new();
        for first_row in (0..height).step_by(band_rows(view.size) as usize) {
            let rows = band_rows(view.size).min(height - first_row);
            let mut last = None;
            for sample in 0..samples {
                let band = Band {
                    first_row,
                    rows,
                    sample,
                    samples,
                    read: sample + 1 == samples,
                    screen: false,
                    whole: false,
                };
                last = Some(self.submit(scene, view, table, &rays, band, None)?);
            }
            let point = last.expect("there is a sample");
            let targets = self.targets.as_ref().expect("submit made it");
            let (from, pixels) = (first_row as usize * width as usize, rows as usize * width as usize);
            hits.resize(pixels, HitRecord::zeroed());
            let colors = bytemuck::cast_slice_mut(&mut image.color[from..from + pixels]);
            let [hits_back, colors_back] = targets.back.as_ref().expect("the last sample was copied back");
            scene.order.read(point, hits_back, 0, bytemuck::cast_slice_mut(&mut hits))?;
            scene.order.read(point, colors_back, 0, colors)?;
            self.finish(&rays, &hits, from, &mut image);
        }
        Ok(image)
    }

    /// Submits one sample of every pixel and waits for nothing but the frame before the last; nothing is copied
    /// back. An image of more pixels than one submit may trace (2²¹) goes in bands, each a submit over the one before.
    /// With a `clock` of one stage for each pass, its stages are the passes, bands added up; each band but the last is then
    /// waited for.
    pub fn submit_frame(
        &mut self,
        scene: &mut Scene,
        view: &View,
        table: &Arc<Table>,
        mut clock: Option<&mut Timestamps>,
    ) -> Result<SyncPoint, FrameError> {
        check_size(scene.gpu(), view.size)?;
        let rays = self.rays(view)?;
        let (height, of_band) = (view.size[1], band_rows(view.size));
        let mut first_row = 0;
        loop {
            let rows = of_band.min(height - first_row);
            let band =
                Band { first_row, rows, sample: 0, samples: 1, read: false, screen: true, whole: false };
            let point = self.submit(scene, view, table, &rays, band, clock.as_deref_mut())?;
            first_row += rows;
            if first_row >= height {
                return Ok(point);
            }
            if let Some(clock) = clock.as_deref_mut() {
                clock.go_on(&mut scene.order, point)?;
            }
        }
    }

    /// How often the passes of the frames to come run.
    pub fn repeat(&mut self, repeats: PassRepeats) {
        self.repeats = repeats;
    }

    /// Errors: `view` takes in too much to be drawn.
    #[cfg(feature = "view")]
    pub fn check(&self, view: &View) -> Result<(), CameraError> {
        self.rays(view).map(drop)
    }

    /// The rays of `view`. Errors: it takes in too much to be drawn.
    pub(in super::super) fn rays(&self, view: &View) -> Result<ViewRays, CameraError> {
        ViewRays::of(view, &self.grid, self.anchor)
    }

    /// All that a frame may see now.
    pub fn table(&self, scene: &Scene) -> Arc<Table> {
        Arc::new(Table::build(&scene.entries(), self.anchor))
    }

    /// Places and the sections that they are to show, as far as those are live: see [`Scene::entries_for`].
    pub fn table_of(&self, scene: &Scene, shown: &[Shown]) -> Arc<Table> {
        Arc::new(Table::build(&scene.entries_for(shown.iter().copied()), self.anchor))
    }

    /// The same of what `live` shows of `scene`, which are always the same two: made when either has changed.
    pub fn table_of_live(&mut self, scene: &Scene, live: &Live) -> Arc<Table> {
        let generations = [scene.generation(), live.shown_version()];
        if let Some((of, table)) = &self.live_table
            && *of == generations
        {
            return Arc::clone(table);
        }
        let table = self.table_of(scene, live.shown());
        self.live_table = Some((generations, Arc::clone(&table)));
        table
    }

    /// Beams of the band that was recorded last, and the wide ones before them, a word each: for checks.
    pub fn beams(&self) -> Option<[&Buffer; 2]> {
        self.targets.as_ref().map(|targets| [&targets.beams, &targets.wide_beams])
    }

    /// Sums and hit records of the image that was recorded last, 16 bytes a pixel each.
    #[cfg(feature = "view")]
    pub(in super::super) fn sums_and_hits(&self) -> Option<[&Buffer; 2]> {
        self.targets.as_ref().map(|targets| [&targets.colors, &targets.hits])
    }

    /// Where the ray of pixel (px, py) has hit, as shown; U there, and U of what its column is as high as: rounded up to a
    /// step of the lattice, it is in the middle of that step.
    #[cfg(feature = "view")]
    pub(in super::super) fn point_of(
        &self,
        rays: &ViewRays,
        hit: &HitRecord,
        pixel: [f64; 2],
    ) -> (DVec3, [f64; 2]) {
        let [distance, height] = distance_and_height(rays, hit, pixel, &self.grid, self.anchor);
        let [px, py] = pixel;
        let along = distance / rays.shown.length(px, py);
        let from_plane = along - rays.shown.advanced();
        let shown = rays.shown.origin(px, py) + rays.shown.direction(px, py) * from_plane;
        let top = self.grid.units(Height(hit.top.wrapping_add(self.anchor.0)));
        (shown, [height, top - 0.5 * self.grid.height_step])
    }

    /// Side of a cell of a detail level, CRS units.
    #[cfg(feature = "view")]
    pub(in super::super) fn cell_of(&self, level: u32) -> f64 {
        self.grid.cell() * f64::from(level).exp2()
    }

    fn submit(
        &mut self,
        scene: &mut Scene,
        view: &View,
        table: &Arc<Table>,
        rays: &ViewRays,
        band: Band,
        clock: Option<&mut Timestamps>,
    ) -> Result<SyncPoint, FrameError> {
        derive_colors(scene, view)?;
        let (mut commands, slot) = scene.order.begin_frame("frame")?;
        self.record(scene, (&mut commands, slot), view, table, rays, band, clock)?;
        if band.read {
            let targets = self.targets.as_ref().expect("recorded");
            let [hits_back, colors_back] = targets.back.as_ref().expect("made to be read");
            let pixels = u64::from(view.size[0]) * u64::from(band.rows);
            let all = BufferCopy { from: 0, to: 0, size: pixels * BYTES_PER_PIXEL };
            let copies = [(&targets.hits, hits_back, all), (&targets.colors, colors_back, all)];
            scene.order.readback(&mut commands, &copies);
        }
        let point = scene.order.submit(commands)?;
        scene.frame_submitted(point);
        Ok(point)
    }

    /// Records the passes of a band in frame `slot`, for which [`derive_colors`] was called.
    pub(in super::super) fn record(
        &mut self,
        scene: &mut Scene,
        (commands, slot): (&mut Commands, usize),
        view: &View,
        table: &Arc<Table>,
        rays: &ViewRays,
        band: Band,
        clock: Option<&mut Timestamps>,
    ) -> Result<(), FrameError> {
        let gpu = scene.gpu().clone();
        FrameTargets::prepare(&mut self.targets, &gpu, view.size, band)?;
        self.in_flight.resize_with(self.in_flight.len().max(slot + 1), || None);
        let mut inputs =
            FrameInputs::with_room(self.in_flight[slot].take(), &gpu, size_of_val(&table.slots[..]) as u64)?;
        let targets = self.targets.as_ref().expect("prepared");
        let constants = self.constants(view, rays, table, (&inputs, targets), band);
        let slab = view.slab.as_ref();
        let heights = || ground_heights(slab, &self.grid, self.anchor);
        let ramp = bytemuck::cast_slice(view.colors.table.as_slice());
        inputs.write(&constants, table, ramp, slab, heights);

        let has_beams = self.targets.as_mut().expect("prepared").has_beams_for(band);
        let passes = self.pipelines.passes(&gpu, view, band, has_beams, Seen::of(table))?;
        if self.options.logged.is_some() {
            commands.keep(self.log.as_ref().expect("Renderer::log made it")[0].clone());
        }
        let targets = self.targets.as_ref().expect("prepared");
        inputs.keep(commands);
        targets.keep(commands);
        scene.pool().buffers().for_each(|b| commands.keep(b.clone()));
        let bindings = inputs.bind(&passes, self.access, scene.pool().derived_page(), targets)?;
        let push = FramePush::new(&constants, [band.sample, band.samples], [band.first_row, band.rows]);
        self.dispatch(scene, commands, &passes, &bindings, &push, clock);
        self.in_flight[slot] = Some(inputs);
        Ok(())
    }

    /// Records `passes` one after the other, as often as [`Renderer::repeat`] says.
    fn dispatch(
        &self,
        scene: &mut Scene,
        commands: &mut Commands,
        passes: &[FramePass],
        bindings: &[Binding],
        push: &FramePush,
        mut clock: Option<&mut Timestamps>,
    ) {
        if let Some(clock) = clock.as_mut() {
            clock.begin(commands);
        }
        let PassRepeats { before, timed } = self.repeats;
        for run in 0..before + timed {
            for (at, (pass, binding)) in passes.iter().zip(bindings).enumerate() {
                if run > 0 || at > 0 {
                    scene.order.next_pass(commands);
                }
                commands.bind(&pass.pipeline);
                commands.push(bytemuck::bytes_of(push));
                commands.bind_buffers(binding);
                commands.dispatch(pass.groups);
                if let Some(clock) = clock.as_mut().filter(|_| run >= before) {
                    clock.end(commands, pass.name);
                }
            }
            if let Some(clock) = clock.as_mut().filter(|_| run + 1 == before) {
                clock.end(commands, "before");
            }
        }
    }

    /// What `band` of `view` says, over `table` and these buffers.
    fn constants(
        &self,
        view: &View,
        rays: &ViewRays,
        table: &Table,
        (inputs, targets): (&FrameInputs, &FrameTargets),
        band: Band,
    ) -> FrameConstants {
        // Shaders count the band's pixels from 0.
        let before = if band.whole {
            u64::from(band.first_row) * u64::from(view.size[0]) * BYTES_PER_PIXEL
        } else {
            0
        };
        assert!(before == 0 || self.access != Access::StorageBuffer, "bindings are of whole buffers");
        let from = |b: &Buffer| match self.access {
            Access::Address | Access::Texels => halves(b.address() + before),
            Access::StorageBuffer => [0; 2],
        };
        let place = match self.access {
            Access::Address | Access::Texels => |b: &Buffer| halves(b.address()),
            Access::StorageBuffer => |_: &Buffer| [0; 2],
        };
        let [table_buffer, ramp] = inputs.table_and_ramp();
        FrameConstants {
            table: place(table_buffer),
            hits: from(&targets.hits),
            colors: self.log.as_ref().map_or_else(|| from(&targets.colors), |[log, _]| place(log)),
            ramp: place(ramp),
            beams: place(&targets.beams),
            wide_beams: place(&targets.wide_beams),
            table_mask: table.slots.len() as u32 - 1,
            top_level: table.top_level as i32,
            section_level: table.section_level as i32,
            low: std::array::from_fn(|a| {
                view.window.map_or(table.low[a], |[low, _]| low[a].max(table.low[a]))
            }),
            high: std::array::from_fn(|a| {
                view.window.map_or(table.high[a], |[_, high]| high[a].min(table.high[a]))
            }),
            ..FrameConstants::new(view, rays, &self.grid, self.anchor)
        }
    }

    /// Channels of the image's pixels from `from` on: distances and heights in f64 from what the device found.
    fn finish(&self, rays: &ViewRays, hits: &[HitRecord], from: usize, image: &mut Image) {
        let width = image.width;
        for (at, hit) in (from..).zip(hits) {
            image.steps += u64::from(hit.rest & MOST_STEPS);
            if let Some(values) = &mut image.values {
                values.codes[at] = (hit.rest >> HIT_VALUE_SHIFT) as u16;
            }
            let class = hit.bits & BITS_CLASS_MASK;
            image.class[at] = class;
            if class == BITS_MISS {
                continue;
            }
            let pixel = [f64::from(at as u32 % width), f64::from(at as u32 / width)];
            let [distance, height] = distance_and_height(rays, hit, pixel, &self.grid, self.anchor);
            image.distance[at] = distance as f32;
            image.origin[at] = hit.bits >> BITS_ORIGIN_SHIFT & BITS_ORIGIN_MASK;
            image.hit_height[at] = height as f32;
            image.face[at] = (hit.bits >> BITS_FACE_SHIFT & BITS_FACE_MASK) as u8;
        }
    }
}
