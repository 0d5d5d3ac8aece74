//! The pipeline of the thesis, as fast as its description allows: in each frame the camera section is cut out of
//! an array of sections, row by row, into one mapped buffer (§3.2.2), copied to the device in two pieces, heights
//! and colours (§3.1.2), and traced by the plain traversal (§3.2.3) in upright strips (§3.3.2).

use super::steady::{Timing, WarmUp};
use super::times::{FrameTimes, ms};
use super::world::World;
use crate::gpu::{
    BindingKind, Buffer, BufferCopy, Commands, ComputePipeline, Gpu, GpuError, MemoryKind, Order,
    PipelineDesc, QueueKind, SyncPoint, Timestamps, shaders,
};
use crate::render::frame::{
    FrameConstants, FrameError, FramePush, LOG_WORDS, PassRepeats, View, ViewRays, halves,
};
use crate::shared::passes::{ID_GROUP_X, ID_GROUP_Y, ID_THESIS_SCREEN};
use cpu_time::ThreadTime;
use std::collections::VecDeque;
use std::time::Instant;

/// A configuration of Table 4.1: `grid` × `grid` cells of the coarsest of `levels` levels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Coarsest cells a side, a power of two.
    pub grid: u32,
    /// Levels.
    pub levels: u32,
}

impl Config {
    /// Those of the thesis, in its order.
    pub const ALL: [Config; 7] = [
        Config { grid: 16, levels: 8 },
        Config { grid: 16, levels: 9 },
        Config { grid: 32, levels: 7 },
        Config { grid: 32, levels: 8 },
        Config { grid: 32, levels: 9 },
        Config { grid: 64, levels: 7 },
        Config { grid: 64, levels: 8 },
    ];

    /// Finest cells a side.
    pub fn side(self) -> u32 {
        self.grid << (self.levels - 1)
    }

    /// Finest cells in one of the coarsest.
    fn coarsest(self) -> i32 {
        1 << (self.levels - 1)
    }

    /// Heights of all levels, finest first (§3.3.1).
    pub fn heights(self) -> usize {
        (0..self.levels).map(|l| self.level(l).pow(2)).sum()
    }

    /// Cells a side of level `l`.
    fn level(self, l: u32) -> usize {
        (self.side() >> l) as usize
    }

    /// Bytes of a camera section.
    pub fn bytes(self) -> u64 {
        4 * (self.heights() as u64 + u64::from(self.side()).pow(2))
    }

    /// The camera section around cell (i, j): low corner and high corner (exclusive), aligned to the coarsest
    /// cells (§3.3.3).
    pub fn window(self, cell: [i32; 2]) -> [[i32; 2]; 2] {
        let half = (self.grid / 2) as i32;
        let low = cell.map(|c| (c.div_euclid(self.coarsest()) - half) * self.coarsest());
        [low, low.map(|l| l + self.side() as i32)]
    }
}

/// A section of the array: as wide as the camera section, its levels in one allocation.
struct Section {
    at: [i32; 2],
    heights: Vec<f32>,
    colors: Vec<u32>,
}

impl Section {
    /// Filled, as its thread would have left it (§3.2.1).
    fn new(config: Config, at: [i32; 2], world: &World, reuse: Option<Section>) -> Section {
        let side = config.side() as usize;
        let mut section = match reuse {
            Some(old) => Section { at, ..old },
            None => Section { at, heights: vec![0.0; config.heights()], colors: vec![0; side * side] },
        };
        let [x, y] = at.map(|a| a * side as i32);
        for row in 0..side {
            let cells = row * side..(row + 1) * side;
            world.row([x, y + row as i32], &mut section.heights[cells.clone()], &mut section.colors[cells]);
        }
        let mut rest = &mut section.heights[..];
        for l in 0..config.levels - 1 {
            let n = config.level(l);
            let (fine, coarser) = rest.split_at_mut(n * n);
            for (row, pair) in coarser[..n * n / 4].chunks_exact_mut(n / 2).zip(fine.chunks_exact(2 * n)) {
                let (south, north) = pair.split_at(n);
                for ((top, s), n) in row.iter_mut().zip(south.chunks_exact(2)).zip(north.chunks_exact(2)) {
                    *top = s[0].max(s[1]).max(n[0].max(n[1]));
                }
            }
            rest = coarser;
        }
        section
    }
}

/// Sections kept filled. The thesis keeps sixteen; a camera section never touches more than four, and how many lie
/// idle beside them changes no time of a frame.
const FILLED: usize = 6;

/// Strips of which the fastest is the baseline; the first one runs on every device.
pub const STRIPS: [[u32; 2]; 3] = [[1, 64], [8, 32], [8, 8]];

/// The kernel in strips of one shape. A clone is another handle.
#[derive(Clone)]
pub struct Kernel {
    /// What is timed: a word a pixel, for the screen.
    screen: ComputePipeline,
    /// With records of the hits, for checks.
    records: ComputePipeline,
    group: [u32; 2],
}

impl Kernel {
    /// `group`: pixels that a workgroup covers.
    pub fn new(gpu: &Gpu, group: [u32; 2]) -> Result<Kernel, GpuError> {
        let screen = Kernel::desc(group).make(gpu)?;
        let records = Kernel::desc_of(group, shaders::THESIS, false).make(gpu)?;
        Ok(Kernel { screen, records, group })
    }

    /// The pipeline that is timed.
    pub fn desc(group: [u32; 2]) -> PipelineDesc {
        Kernel::desc_of(group, shaders::THESIS, true)
    }

    fn desc_of(group: [u32; 2], words: &'static [u32], screen: bool) -> PipelineDesc {
        PipelineDesc {
            name: "thesis",
            words,
            constants: vec![
                (ID_GROUP_X, group[0]),
                (ID_GROUP_Y, group[1]),
                (ID_THESIS_SCREEN, u32::from(screen)),
            ],
            push_bytes: size_of::<FramePush>() as u32,
            bindings: &[BindingKind::Uniform],
        }
    }
}

/// Rows of a picture that are logged at a time.
const LOG_ROWS: u32 = 64;

/// The pipeline for one configuration.
pub struct Thesis {
    config: Config,
    order: Order,
    sections: VecDeque<Section>,
    kernel: Kernel,
    staging: Buffer,
    heights: Buffer,
    colors: Buffer,
    constants: Buffer,
    hits: Buffer,
    image: Buffer,
    hits_back: Buffer,
    image_back: Buffer,
    clocks: Option<[Timestamps; 2]>,
    size: [u32; 2],
}

/// What a pixel shows, for comparisons.
pub struct ThesisImage {
    /// t of the hit as float bits; [`u32::MAX`] in the second word: a miss.
    pub hits: Vec<[u32; 4]>,
    /// Linear.
    pub colors: Vec<[f32; 4]>,
}

/// Copies the `n` × `n` cells from `low` on out of the planes of the (up to four) sections that they lie in.
fn cut<'a, T: Copy + 'a>(to: &mut [T], n: usize, low: [i32; 2], plane: impl Fn([i32; 2]) -> &'a [T]) {
    let (first, inner) = (low.map(|c| c.div_euclid(n as i32)), low.map(|c| c.rem_euclid(n as i32) as usize));
    // Rows and columns of the first section, then those of the one behind it, if any.
    let parts =
        |axis: usize| [(first[axis], inner[axis]..n, 0), (first[axis] + 1, 0..inner[axis], n - inner[axis])];
    for (j, rows, y0) in parts(1).into_iter().filter(|(_, rows, _)| !rows.is_empty()) {
        for (i, columns, x0) in parts(0).into_iter().filter(|(_, columns, _)| !columns.is_empty()) {
            let from = plane([i, j]);
            for (y, row) in rows.clone().enumerate() {
                let part = &from[row * n..][columns.clone()];
                to[(y0 + y) * n + x0..][..part.len()].copy_from_slice(part);
            }
        }
    }
}

impl Thesis {
    /// For pictures of `size`; `group`: pixels a workgroup covers.
    pub fn new(gpu: &Gpu, config: Config, size: [u32; 2], group: [u32; 2]) -> Result<Thesis, GpuError> {
        let pixels = 16 * u64::from(size[0]) * u64::from(size[1]);
        let make = |name: &str, kind, bytes| Buffer::new(gpu, name, kind, bytes);
        let height_bytes = 4 * config.heights() as u64;
        let clock = |queue| Timestamps::new(gpu, "thesis", queue, 1);
        let clocks = clock(QueueKind::Transfer)?.zip(clock(QueueKind::Compute)?);
        Ok(Thesis {
            config,
            order: Order::new(gpu, 1)?,
            sections: VecDeque::new(),
            kernel: Kernel::new(gpu, group)?,
            staging: make("camera section, host", MemoryKind::Upload, config.bytes())?,
            heights: make("camera section, heights", MemoryKind::Device, height_bytes)?,
            colors: make("camera section, colours", MemoryKind::Device, config.bytes() - height_bytes)?,
            constants: make("thesis constants", MemoryKind::Upload, size_of::<FrameConstants>() as u64)?,
            hits: make("thesis hits", MemoryKind::Device, pixels)?,
            image: make("thesis image", MemoryKind::Device, pixels)?,
            hits_back: make("thesis hits read back", MemoryKind::Readback, pixels)?,
            image_back: make("thesis image read back", MemoryKind::Readback, pixels)?,
            clocks: clocks.map(|(a, b)| [a, b]),
            size,
        })
    }

    /// Host bytes that it takes beside its buffers.
    pub fn host_bytes(config: Config) -> u64 {
        config.bytes() * FILLED as u64
    }

    /// Fills the sections that the camera section at `window` touches. Its time is the loading threads', not the
    /// frame's.
    pub fn load(&mut self, world: &World, window: [[i32; 2]; 2]) {
        let side = self.config.side() as i32;
        let [low, high] = window.map(|corner| corner.map(|c| c.div_euclid(side)));
        for at in (low[1]..=high[1]).flat_map(|j| (low[0]..=high[0]).map(move |i| [i, j])) {
            // An aligned window ends where the next section begins.
            if at[0] * side >= window[1][0] || at[1] * side >= window[1][1] {
                continue;
            }
            let section = match self.sections.iter().position(|s| s.at == at) {
                Some(known) => self.sections.remove(known).expect("just found"),
                None => {
                    let idle = (self.sections.len() >= FILLED).then(|| self.sections.pop_front()).flatten();
                    Section::new(self.config, at, world, idle)
                }
            };
            self.sections.push_back(section);
        }
    }

    /// Cuts the camera section out of the array into the mapped buffer: heights of all levels, then colours.
    fn extract(&self, [low, _]: [[i32; 2]; 2]) {
        let config = self.config;
        let section =
            |at: [i32; 2]| self.sections.iter().find(|s| s.at == at).expect("loaded before the frame");
        self.staging.write_with(0, config.bytes(), |bytes| {
            let (heights, colors) = bytes.split_at_mut(4 * config.heights());
            let mut heights: &mut [f32] = bytemuck::cast_slice_mut(heights);
            let colors: &mut [u32] = bytemuck::cast_slice_mut(colors);
            let mut offset = 0;
            for l in 0..config.levels {
                let n = config.level(l);
                let (level, rest) = heights.split_at_mut(n * n);
                cut(level, n, low.map(|c| c >> l), |at| &section(at).heights[offset..offset + n * n]);
                offset += n * n;
                heights = rest;
            }
            cut(colors, config.level(0), low, |at| &section(at).colors);
        });
    }

    /// Pixels that a workgroup covers.
    pub fn strip(&self) -> [u32; 2] {
        self.kernel.group
    }

    /// The kernel of the frames to come.
    pub fn use_kernel(&mut self, kernel: &Kernel) {
        self.kernel = kernel.clone();
    }

    /// Cuts out and copies the camera section at `window`, which is loaded; waits for it.
    pub fn place(&mut self, window: [[i32; 2]; 2]) -> Result<(), FrameError> {
        self.extract(window);
        let copied = self.copy()?;
        self.take(copied)?;
        if let Some([clock, _]) = &mut self.clocks {
            clock.resolve(&mut self.order, copied)?;
        }
        self.order.collect()?;
        Ok(())
    }

    /// Copies the mapped buffer in its two pieces, and waits for that.
    fn copy(&mut self) -> Result<SyncPoint, FrameError> {
        let mut copy = self.order.begin_copy("camera section", &[])?;
        if let Some([clock, _]) = &mut self.clocks {
            clock.begin(&mut copy);
        }
        let height_bytes = self.heights.size();
        let heights = BufferCopy { from: 0, to: 0, size: height_bytes };
        let colors = BufferCopy { from: height_bytes, to: 0, size: self.colors.size() };
        copy.copy(&self.staging, &self.heights, &[heights]);
        copy.copy(&self.staging, &self.colors, &[colors]);
        if let Some([clock, _]) = &mut self.clocks {
            clock.end(&mut copy, "copy");
        }
        let copied = self.order.submit(copy)?;
        self.order.wait(copied)?;
        Ok(copied)
    }

    /// Takes what was copied over to the compute queue.
    fn take(&mut self, copied: SyncPoint) -> Result<(), FrameError> {
        let taken = self.order.begin_build("camera section", &[copied])?;
        self.order.submit(taken)?;
        Ok(())
    }

    /// Draws a frame: the camera section at `window` is cut out, copied and traced, one after the other.
    pub fn frame(&mut self, view: &View, world: &World) -> Result<FrameTimes, FrameError> {
        let window = view.window.expect("a camera section");
        let (begin, ran) = (Instant::now(), ThreadTime::now());
        self.extract(window);
        let prepare_ms = ran.elapsed().as_secs_f64() * 1e3;

        let copying = Instant::now();
        let copied = self.copy()?;
        let copy_wall_ms = ms(copying);

        let tracing = Instant::now();
        self.take(copied)?;
        let mut clocks = self.clocks.take();
        let traced = self.submit(view, world, PassRepeats::ONCE, clocks.as_mut().map(|[_, clock]| clock))?;
        self.clocks = clocks;
        self.order.wait(traced)?;
        let trace_wall_ms = ms(tracing);
        let total_ms = ms(begin);
        let (mut copy_ms, mut trace_ms) = (copy_wall_ms, trace_wall_ms);
        if let Some([copy, trace]) = &mut self.clocks {
            copy_ms = copy.resolve(&mut self.order, copied)?[0].1 / 1e6;
            trace_ms = trace.resolve(&mut self.order, traced)?[0].1 / 1e6;
        }
        self.order.collect()?;
        let copy_bytes = self.config.bytes();
        Ok(FrameTimes {
            prepare_ms,
            copy_ms,
            copy_bytes,
            trace_ms,
            trace_wall_ms,
            total_ms,
            ..FrameTimes::default()
        })
    }

    /// Times the kernel for `view` of the camera section that was copied last; `clock` has [`WarmUp::STAGES`].
    pub fn time(
        &mut self,
        view: &View,
        world: &World,
        warm_up: &mut WarmUp,
        clock: &mut Timestamps,
    ) -> Result<Timing, FrameError> {
        warm_up.time(|repeats| {
            let point = self.submit(view, world, repeats, Some(clock))?;
            Ok(clock.resolve(&mut self.order, point)?)
        })
    }

    /// Traces `view` as often as `repeats` says. With a `clock` of `repeats.stages(1)` stages, the timed runs are stages
    /// `"trace"` of it.
    fn submit(
        &mut self,
        view: &View,
        world: &World,
        repeats: PassRepeats,
        mut clock: Option<&mut Timestamps>,
    ) -> Result<SyncPoint, FrameError> {
        let image = self.image.clone();
        let (mut commands, constants) = self.begin(view, world, &image)?;
        if let Some(clock) = clock.as_mut() {
            clock.begin(&mut commands);
        }
        let kernel = &self.kernel.screen;
        let binding = kernel.binding(&[&self.constants])?;
        for run in 0..repeats.before + repeats.timed {
            if run > 0 {
                self.order.next_pass(&mut commands);
            }
            commands.bind(kernel);
            commands.push(bytemuck::bytes_of(&FramePush::whole(&constants)));
            commands.bind_buffers(&binding);
            commands.dispatch(self.groups(self.size[1]));
            if let Some(clock) = clock.as_mut().filter(|_| run + 1 >= repeats.before) {
                clock.end(&mut commands, if run < repeats.before { "before" } else { "trace" });
            }
        }
        Ok(self.order.submit(commands)?)
    }

    fn groups(&self, rows: u32) -> [u32; 3] {
        let [x, y] = self.kernel.group;
        [self.size[0].div_ceil(x), rows.div_ceil(y), 1]
    }

    /// A frame that keeps what the kernel reads and writes, and the constants of `view`, written already.
    fn begin(
        &mut self,
        view: &View,
        world: &World,
        image: &Buffer,
    ) -> Result<(Commands, FrameConstants), FrameError> {
        let rays = ViewRays::of(view, &world.grid, world.anchor)?;
        let [low, high] = view.window.expect("a camera section");
        // The kernel reads the same constants over its own buffers.
        let constants = FrameConstants {
            table: halves(self.heights.address()),
            hits: halves(self.hits.address()),
            colors: halves(image.address()),
            ramp: halves(self.colors.address()),
            table_mask: self.config.side().ilog2(),
            top_level: self.config.levels as i32 - 1,
            low,
            high,
            ..FrameConstants::new(view, &rays, &world.grid, world.anchor)
        };
        let (mut commands, _) = self.order.begin_frame("thesis frame")?;
        self.constants.write(0, bytemuck::bytes_of(&constants));
        for buffer in [&self.heights, &self.colors, &self.constants, &self.hits, image] {
            commands.keep(buffer.clone());
        }
        Ok((commands, constants))
    }

    /// The picture of the camera section that was copied last.
    pub fn picture(&mut self, view: &View, world: &World) -> Result<ThesisImage, FrameError> {
        let image = self.image.clone();
        let (mut commands, constants) = self.begin(view, world, &image)?;
        self.dispatch(&mut commands, &self.kernel.records, FramePush::whole(&constants), self.size[1])?;
        let all = BufferCopy { from: 0, to: 0, size: self.hits.size() };
        let copies = [(&self.hits, &self.hits_back, all), (&self.image, &self.image_back, all)];
        self.order.readback(&mut commands, &copies);
        let point = self.order.submit(commands)?;
        let pixels = self.size[0] as usize * self.size[1] as usize;
        let mut picture = ThesisImage { hits: vec![[0; 4]; pixels], colors: vec![[0.0; 4]; pixels] };
        self.order.read(point, &self.hits_back, 0, bytemuck::cast_slice_mut(&mut picture.hits))?;
        self.order.read(point, &self.image_back, 0, bytemuck::cast_slice_mut(&mut picture.colors))?;
        Ok(picture)
    }

    /// What the kernel's threads do for `view`, row by row from the top: `each` is given the width and [`LOG_WORDS`] words
    /// of each thread of some rows. See `shaders/log.glsl`.
    pub fn log(
        &mut self,
        gpu: &Gpu,
        view: &View,
        world: &World,
        mut each: impl FnMut(usize, &[u32]),
    ) -> Result<(), FrameError> {
        let [width, height] = self.size;
        let bytes = |rows: u32| 4 * LOG_WORDS as u64 * u64::from(width) * u64::from(rows);
        let log = Buffer::new(gpu, "log", MemoryKind::Device, bytes(LOG_ROWS))?;
        let back = Buffer::new(gpu, "log read back", MemoryKind::Readback, bytes(LOG_ROWS))?;
        let pipeline = Kernel::desc_of(self.kernel.group, shaders::THESIS_LOGGED, false).make(gpu)?;
        let mut words = vec![0u32; bytes(LOG_ROWS) as usize / 4];
        for first_row in (0..height).step_by(LOG_ROWS as usize) {
            let rows = LOG_ROWS.min(height - first_row);
            let (mut commands, constants) = self.begin(view, world, &log)?;
            let push = FramePush::new(&constants, [0, 1], [first_row, rows]);
            self.dispatch(&mut commands, &pipeline, push, rows)?;
            let all = BufferCopy { from: 0, to: 0, size: bytes(rows) };
            self.order.readback(&mut commands, &[(&log, &back, all)]);
            let point = self.order.submit(commands)?;
            let words = &mut words[..bytes(rows) as usize / 4];
            self.order.read(point, &back, 0, bytemuck::cast_slice_mut(words))?;
            each(width as usize, words);
        }
        Ok(())
    }

    fn dispatch(
        &self,
        commands: &mut Commands,
        pipeline: &ComputePipeline,
        push: FramePush,
        rows: u32,
    ) -> Result<(), GpuError> {
        commands.bind(pipeline);
        commands.push(bytemuck::bytes_of(&push));
        commands.bind_buffers(&pipeline.binding(&[&self.constants])?);
        commands.dispatch(self.groups(rows));
        Ok(())
    }
}
