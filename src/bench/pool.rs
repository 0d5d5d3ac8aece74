//! Our pipeline in the harness: the persistent pool over the same window. A section is packed and copied once, when
//! the window comes near it; a frame draws what is resident and waits for none.

use super::steady::{Timing, WarmUp};
use super::times::{FrameTimes, ms};
use super::world::World;
use crate::coords::{SECTION_LOG2, SectionKey};
use crate::gpu::{Gpu, Order, QueueKind, SyncPoint, Timestamps};
use crate::render::frame::{FrameError, PASSES, PassRepeats, Renderer, View};
use crate::render::image::Image;
use crate::resident::pool::Access;
use crate::resident::scene::Scene;
use cpu_time::ThreadTime;
use std::collections::BTreeSet;
use std::time::{Duration, Instant};

/// Frames that are looked ahead, at the speed of the moment.
pub const AHEAD: u32 = 3;
/// Most device memory for sections, bytes.
pub const BUDGET: u64 = 3 << 30;

/// The pipeline for one window size.
pub struct PoolPipeline {
    scene: Scene,
    renderer: Renderer,
    clock: Option<Timestamps>,
    /// Asked for and not given up; those without a point are among them.
    wanted: BTreeSet<SectionKey>,
}

/// Sections that cells `low` to `high` (exclusive) lie in.
fn sections([low, high]: [[i32; 2]; 2]) -> BTreeSet<SectionKey> {
    let [i, j] = [0, 1].map(|a| low[a] >> SECTION_LOG2..=(high[a] - 1) >> SECTION_LOG2);
    j.flat_map(|j| i.clone().map(move |i| SectionKey { level: 0, i, j })).collect()
}

/// A section more on each side.
fn grown([low, high]: [[i32; 2]; 2]) -> [[i32; 2]; 2] {
    let side = 1 << SECTION_LOG2;
    [low.map(|c| c - side), high.map(|c| c + side)]
}

/// Times the passes of `view` by `renderer`; `clock` has [`WarmUp::STAGES`].
pub fn time(
    scene: &mut Scene,
    renderer: &mut Renderer,
    view: &View,
    warm_up: &mut WarmUp,
    clock: &mut Timestamps,
) -> Result<Timing, FrameError> {
    let table = renderer.table(scene);
    let timing = warm_up.time(|repeats| {
        renderer.repeat(repeats);
        let point = renderer.submit_frame(scene, view, &table, Some(clock))?;
        Ok(clock.resolve(&mut scene.order, point)?)
    });
    renderer.repeat(PassRepeats::ONCE);
    timing
}

impl PoolPipeline {
    /// An empty pool for windows of `cells` a side.
    pub fn new(gpu: &Gpu, world: &World, cells: u32) -> Result<PoolPipeline, FrameError> {
        let budget = gpu.bytes_for_sections(BUDGET);
        // Wherever it lies, with the margin, and what the motion leads to.
        let side = u64::from(cells.div_ceil(1 << SECTION_LOG2)) + 3;
        let count = side * (side + 2 * u64::from(AHEAD));
        let access = Access::best(gpu, count * world.mean_derived_bytes());
        PoolPipeline::with_access(gpu, world, access, budget)
    }

    /// The same, reached by `access`, of at most `budget` bytes.
    pub fn with_access(
        gpu: &Gpu,
        world: &World,
        access: Access,
        budget: u64,
    ) -> Result<PoolPipeline, FrameError> {
        let mut scene = Scene::new(gpu, |o: Order| o, access, budget, world.visibility, world.grid)?;
        scene.measure();
        let renderer = Renderer::new(&scene, world.grid, world.anchor)?;
        let clock = Timestamps::new(gpu, "frame", QueueKind::Compute, PASSES)?;
        Ok(PoolPipeline { scene, renderer, clock, wanted: BTreeSet::new() })
    }

    /// Packs and copies what `windows` (this frame's, and those it is believed to come to) hold and is not there
    /// yet; gives up what none of them holds. Adds its times to `times`.
    fn stream(
        &mut self,
        world: &World,
        windows: &[[[i32; 2]; 2]],
        times: &mut FrameTimes,
    ) -> anyhow::Result<()> {
        let begin = Instant::now();
        let needed = sections(windows[0]);
        let wanted: BTreeSet<_> = windows.iter().flat_map(|w| sections(*w)).collect();
        // What has only just left may come back.
        let kept: BTreeSet<_> = windows.iter().flat_map(|w| sections(grown(*w))).collect();
        let gone: Vec<_> = self.wanted.difference(&kept).copied().collect();
        if !gone.is_empty() {
            self.scene.evict(&gone)?;
            self.wanted.retain(|key| !gone.contains(key));
        }
        let before = self.scene.counters().section_bytes;
        let (mut packing, mut ran) = (Duration::ZERO, Duration::ZERO);
        let fresh = |of: &BTreeSet<SectionKey>| of.difference(&self.wanted).copied().collect::<Vec<_>>();
        let (first, mut then) = (fresh(&needed), fresh(&wanted));
        then.retain(|key| !needed.contains(key));
        for key in first.into_iter().chain(then) {
            let Some(columns) = world.columns(key) else {
                self.wanted.insert(key);
                continue;
            };
            let layout = columns.layout();
            let mut put = |scene: &mut Scene| {
                scene.upload_with(key, layout, |words| {
                    let (from, at) = (Instant::now(), ThreadTime::now());
                    let highest_of = columns.pack_with(words, crate::gpu::stream_words);
                    packing += from.elapsed();
                    ran += at.elapsed();
                    highest_of
                })
            };
            let mut room = put(&mut self.scene)?;
            // What is not wanted makes room; for what is needed now, what is wanted later does, too.
            for keep in [&wanted, &needed] {
                if room || !keep.contains(&key) {
                    break;
                }
                let spare: Vec<_> = self.wanted.difference(keep).copied().collect();
                self.scene.evict(&spare)?;
                self.wanted.retain(|key| keep.contains(key));
                room = put(&mut self.scene)?;
            }
            if !room {
                // What may be wanted later may have to come later.
                anyhow::ensure!(
                    !needed.contains(&key),
                    "the sections of the window do not fit the device's memory"
                );
                break;
            }
            self.wanted.insert(key);
        }
        self.scene.flush()?;
        times.prepare_ms += ran.as_secs_f64() * 1e3;
        times.copy_bytes += self.scene.counters().section_bytes - before;
        times.wait_ms += ms(begin) - packing.as_secs_f64() * 1e3;
        Ok(())
    }

    /// Makes everything that `window` holds resident, and a section more on each side, as if it had been near for long.
    pub fn load(&mut self, world: &World, window: [[i32; 2]; 2]) -> anyhow::Result<FrameTimes> {
        let mut times = FrameTimes::default();
        self.stream(world, &[window, grown(window)], &mut times)?;
        self.scene.settle()?;
        times.copy_ms = self.device_ms()?;
        Ok(times)
    }

    /// Makes what `window` holds resident, and no more than that if there is no room.
    pub fn place(&mut self, world: &World, window: [[i32; 2]; 2]) -> anyhow::Result<()> {
        self.stream(world, &[window], &mut FrameTimes::default())?;
        self.scene.settle()?;
        self.device_ms()?;
        Ok(())
    }

    /// Times the passes of `view`, with all that is on its way there.
    pub fn time(
        &mut self,
        view: &View,
        warm_up: &mut WarmUp,
        clock: &mut Timestamps,
    ) -> anyhow::Result<Timing> {
        self.scene.settle()?;
        Ok(time(&mut self.scene, &mut self.renderer, view, warm_up, clock)?)
    }

    /// For frames of other renderers than its own.
    pub fn scene(&mut self) -> &mut Scene {
        &mut self.scene
    }

    /// Device time of the copies and derived passes that have ended since the last look, ms.
    fn device_ms(&mut self) -> anyhow::Result<f64> {
        Ok(self.scene.take_times()?.into_iter().map(|(_, ns)| ns / 1e6).sum())
    }

    /// Sections of `window` that a frame does not see now though there are points in them.
    fn missing(&self, world: &World, window: [[i32; 2]; 2]) -> usize {
        let live: BTreeSet<_> = self.scene.entries().into_iter().map(|e| e.key).collect();
        sections(window).iter().filter(|key| !live.contains(key) && world.columns(**key).is_some()).count()
    }

    /// One frame of a path: draws `view` while `ahead`, the windows to come, are streamed; without a view it only
    /// streams, and gives the device time for that as a frame would. Also gives how many sections were late.
    pub fn frame(
        &mut self,
        world: &World,
        window: [[i32; 2]; 2],
        ahead: &[[[i32; 2]; 2]],
        view: Option<&View>,
    ) -> anyhow::Result<(FrameTimes, usize)> {
        let mut times = FrameTimes::default();
        if view.is_none() {
            self.scene.wait()?;
        }
        let mut begin = Instant::now();
        self.scene.advance()?;
        // Off the clock: it is the harness that wants to know.
        let counting = Instant::now();
        let late = self.missing(world, window);
        begin += counting.elapsed();
        let mut drawn: Option<(SyncPoint, Instant)> = None;
        if let Some(view) = view {
            let from = Instant::now();
            let table = self.renderer.table(&self.scene);
            times.table_ms = ms(from);
            let point = self.renderer.submit_frame(&mut self.scene, view, &table, self.clock.as_mut())?;
            drawn = Some((point, Instant::now()));
        }
        let windows: Vec<_> = std::iter::once(window).chain(ahead.iter().copied()).collect();
        self.stream(world, &windows, &mut times)?;
        if let Some((point, submitted)) = drawn {
            self.scene.order.wait(point)?;
            times.trace_wall_ms = ms(submitted);
            times.total_ms = ms(begin);
            times.trace_ms = match &mut self.clock {
                Some(clock) => {
                    let stages = clock.resolve(&mut self.scene.order, point)?;
                    stages.iter().map(|(_, ns)| ns / 1e6).sum()
                }
                None => times.trace_wall_ms,
            };
        }
        times.copy_ms = self.device_ms()?;
        Ok((times, late))
    }

    /// The picture of `view` with everything of its window there.
    pub fn picture(&mut self, view: &View) -> anyhow::Result<Image> {
        self.scene.settle()?;
        Ok(self.renderer.draw(&mut self.scene, view)?)
    }
}
