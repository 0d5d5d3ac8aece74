//! Both pipelines along camera paths, frame by frame.

use super::failure::{Stopped, is_too_large};
use super::pool::{AHEAD, PoolPipeline};
use super::steady::{self, Repeats, Timing, WarmUp};
use super::thesis::{Config, Kernel, Thesis, ThesisImage};
use super::times::FrameTimes;
use super::world::World;
use crate::coords::{Bounds, CELL_LIMIT};
use crate::gpu::{Gpu, QueueKind, Timestamps};
use crate::load;
use crate::render::benchmark_path::PathStage;
use crate::render::camera::Camera;
use crate::render::frame::{Background, Shade, Traversal, View};
use crate::render::image::{Image, MISS_CLASS};
use crate::render::path::CameraPath;
use glam::{DVec2, DVec3};
use std::sync::atomic::{AtomicBool, Ordering};

/// What is run.
pub struct FlightOptions<'a> {
    /// Pixels.
    pub size: [u32; 2],
    /// Frames of each path that are drawn and measured, spread over it; the pool streams in all of them.
    pub frames: u32,
    /// Times that the passes of a frame are timed at steady clocks: see [`Traced`].
    pub rounds: u32,
    /// No progress bar.
    pub quiet: bool,
    /// Set: ends before the next frame.
    pub stop: &'a AtomicBool,
}

impl FlightOptions<'_> {
    fn drawn(&self, path: &CameraPath) -> Vec<u32> {
        path.spread(self.frames.max(1)).collect()
    }

    fn check(&self) -> anyhow::Result<()> {
        if self.stop.load(Ordering::Relaxed) { Err(Stopped.into()) } else { Ok(()) }
    }
}

/// Frames of a path whose passes are timed at steady clocks, at most.
const TRACED_FRAMES: usize = 24;
/// Times that each is, usually.
pub const ROUNDS: u32 = 3;

/// The passes of some of the drawn frames, each timed several times, in turn with the other pipeline's, at steady clocks
/// (see [`steady`]). Nothing on a device without timestamps.
#[derive(Default)]
pub struct Traced {
    /// All passes, frame by frame.
    pub all: Vec<Repeats>,
    /// Each pass, frame by frame.
    pub passes: Vec<(&'static str, Vec<Repeats>)>,
}

impl Traced {
    /// Another time of the frame that the last one was of, or of the next.
    fn add(&mut self, is_next: bool, timing: &Timing) {
        let push = |frames: &mut Vec<Repeats>, ms| {
            if is_next || frames.is_empty() {
                frames.push(Repeats::default());
            }
            frames.last_mut().expect("there is one").push(ms, timing.is_warm);
        };
        push(&mut self.all, timing.all_ms);
        for &(name, ms) in &timing.passes {
            let at = self.passes.iter().position(|(known, _)| *known == name).unwrap_or_else(|| {
                self.passes.push((name, Vec::new()));
                self.passes.len() - 1
            });
            push(&mut self.passes[at].1, ms);
        }
    }

    /// Each frame's median, ms.
    pub fn medians(frames: &[Repeats]) -> Vec<f64> {
        frames.iter().filter_map(Repeats::median).collect()
    }
}

/// What [`run`] found.
pub struct Flight {
    /// Our pipeline; an error: what it has no room for.
    pub pool: Option<anyhow::Result<PoolRun>>,
    /// The thesis'.
    pub thesis: Option<ThesisRun>,
}

/// One path through our pipeline.
#[derive(Default)]
pub struct PoolRun {
    /// Of the drawn frames.
    pub drawn: Vec<FrameTimes>,
    /// Of every frame: prepare and copy alone.
    pub stream: Vec<FrameTimes>,
    /// Sections that frames did without because they were still on their way.
    pub missing: usize,
    /// The first and the last drawn frame.
    pub pictures: Vec<(u32, Image)>,
    /// Times that may be compared.
    pub traced: Traced,
}

impl PoolRun {
    /// Traversal steps a ray, mean of the pictures.
    pub fn steps_per_ray(&self) -> f64 {
        let (steps, rays) = self
            .pictures
            .iter()
            .fold((0, 0), |(steps, rays), (_, picture)| (steps + picture.steps, rays + picture.class.len()));
        steps as f64 / rays as f64
    }
}

/// One path through the pipeline of the thesis.
#[derive(Default)]
pub struct ThesisRun {
    /// Of the drawn frames.
    pub drawn: Vec<FrameTimes>,
    /// Largest share of pixels that differ from our pictures; `None`: there were none.
    pub differ: Option<f64>,
    /// Times that may be compared.
    pub traced: Traced,
}

/// Pixels that differ: hit in one and missed in the other, or in colour by more than 1/255 of sRGB.
pub fn differing(ours: &Image, theirs: &ThesisImage) -> usize {
    let code = |v: f32| crate::attribute::linear_to_srgb(v.clamp(0.0, 1.0)) * 255.0;
    (0..ours.class.len())
        .filter(|&at| {
            let missed = [ours.class[at] == MISS_CLASS, theirs.hits[at][1] == u32::MAX];
            let other = |k: usize| (code(ours.color[at][k]) - code(theirs.colors[at][k])).abs() > 1.0;
            missed[0] != missed[1] || !missed[0] && (0..3).any(other)
        })
        .count()
}

/// The window around an eye.
pub fn window(config: Config, world: &World, eye: DVec3) -> [[i32; 2]; 2] {
    let cell = world.grid.cell();
    let index = |v: f64, axis: usize| ((v / cell).floor() as i64 - world.grid.anchor[axis]) as i32;
    config.window([index(eye.x, 0), index(eye.y, 1)])
}

/// A view of one window, unlit.
pub fn view<'a>(world: &'a World, camera: &'a Camera, size: [u32; 2], window: [[i32; 2]; 2]) -> View<'a> {
    let cell = world.grid.cell();
    let corner = |at: [i32; 2], z: f64| {
        let [e, n] = [0, 1].map(|a| (i64::from(at[a]) + world.grid.anchor[a]) as f64 * cell);
        DVec2::new(e, n).extend(z)
    };
    let bounds =
        Bounds { min: corner(window[0], world.bounds.min.z), max: corner(window[1], world.bounds.max.z) };
    View {
        camera,
        size,
        samples: 1,
        z_scale: 1.0,
        pivot: bounds.min.z,
        bounds,
        slab: None,
        colors: &world.colors,
        shade: Shade::None,
        background: Background::None,
        traversal: Traversal::Fast,
        window: Some(window),
    }
}

/// Where the paths are flown over `world` with windows of `config`.
pub fn stage(world: &World, config: Config) -> PathStage {
    let b = &world.bounds;
    let cell = world.grid.cell();
    let [ground, top] = world.relief();
    PathStage { center: b.center().truncate(), ground, top, cell, side: f64::from(config.side()) * cell }
}

/// Whether every eye of `path` lies where cells are counted.
pub fn fits(world: &World, path: &CameraPath) -> bool {
    let cell = world.grid.cell();
    (0..path.frames()).all(|frame| {
        path.camera(frame).is_ok_and(|camera| {
            let eye = camera.eye();
            [eye.x, eye.y]
                .iter()
                .zip(world.grid.anchor)
                .all(|(v, anchor)| (v / cell - anchor as f64).abs() < (CELL_LIMIT / 8) as f64)
        })
    })
}

/// Our pipeline on a path.
struct PoolFlight {
    pool: PoolPipeline,
    run: PoolRun,
}

impl PoolFlight {
    fn start(
        gpu: &Gpu,
        world: &World,
        config: Config,
        path: &CameraPath,
        options: &FlightOptions,
    ) -> anyhow::Result<PoolFlight> {
        let mut pool = PoolPipeline::new(gpu, world, config.side())?;
        let start = path.camera(0)?;
        let here = window(config, world, start.eye());
        pool.load(world, here)?;
        // Drivers compile on first use: a picture that is not measured.
        pool.picture(&view(world, &start, options.size, here))?;
        Ok(PoolFlight { pool, run: PoolRun::default() })
    }

    /// Streams what frame `frame` and those after it need, and draws it if asked.
    fn frame(
        &mut self,
        world: &World,
        config: Config,
        path: &CameraPath,
        frame: u32,
        drawn: Option<&View>,
    ) -> anyhow::Result<()> {
        let now = path.camera(frame)?;
        let here = window(config, world, now.eye());
        // Where the motion of the last frame leads to.
        let motion = now.eye() - path.camera(frame.saturating_sub(1))?.eye();
        let ahead: Vec<_> =
            (1..=AHEAD).map(|n| window(config, world, now.eye() + motion * f64::from(n))).collect();
        let (times, late) = self.pool.frame(world, here, &ahead, drawn)?;
        self.run.missing += late;
        self.run.stream.push(times);
        if drawn.is_some() {
            self.run.drawn.push(times);
        }
        Ok(())
    }
}

/// Flies `path` under `config` with our pipeline (`with_pool`) and the thesis', in turn, frame by frame, and compares their
/// pictures. What our pipeline cannot do for lack of memory is an error of its own.
pub fn run(
    gpu: &Gpu,
    world: &World,
    config: Config,
    path: &CameraPath,
    with_pool: bool,
    mut thesis: Option<&mut Thesis>,
    options: &FlightOptions,
) -> anyhow::Result<Flight> {
    let drawn = options.drawn(path);
    let traced: Vec<_> = spread(drawn.len(), TRACED_FRAMES).map(|k| drawn[k]).collect();
    let start = path.camera(0)?;
    let here = window(config, world, start.eye());
    let mut pool = with_pool.then(|| PoolFlight::start(gpu, world, config, path, options));
    let mut flown = ThesisRun::default();
    if let Some(thesis) = &mut thesis {
        // As for ours.
        thesis.load(world, here);
        thesis.frame(&view(world, &start, options.size, here), world)?;
    }
    let mut clock = Timestamps::new(gpu, "traced", QueueKind::Compute, WarmUp::STAGES)?;
    let mut warm_ups = [WarmUp::new(gpu.info().kind); 2];
    let bar = load::bar(path.frames().into(), options.quiet, "{wide_bar} frame {pos} of {len} {eta}");
    for frame in 0..path.frames() {
        options.check()?;
        bar.set_position(frame.into());
        let draws = drawn.binary_search(&frame).is_ok();
        let now = path.camera(frame)?;
        let here = window(config, world, now.eye());
        let view = view(world, &now, options.size, here);
        let compares = Some(&frame) == drawn.first() || Some(&frame) == drawn.last();
        pool = match pool {
            Some(Ok(mut flight)) => {
                let mut done = flight.frame(world, config, path, frame, draws.then_some(&view));
                if compares && done.is_ok() {
                    done =
                        flight.pool.picture(&view).map(|picture| flight.run.pictures.push((frame, picture)));
                }
                Some(done.map(|()| flight))
            }
            Some(Err(error)) if !is_too_large(&error) => return Err(error),
            other => other,
        };
        if !draws {
            continue;
        }
        if let Some(thesis) = &mut thesis {
            thesis.load(world, here);
            flown.drawn.push(thesis.frame(&view, world)?);
            let ours = pool.as_ref().and_then(|pool| pool.as_ref().ok()).and_then(|p| p.run.pictures.last());
            if let Some((_, ours)) = ours.filter(|(at, _)| *at == frame) {
                let other = differing(ours, &thesis.picture(&view, world)?);
                let share = other as f64 / ours.class.len() as f64;
                flown.differ = Some(flown.differ.unwrap_or(0.0).max(share));
            }
        }
        let Some(clock) = clock.as_mut().filter(|_| traced.contains(&frame)) else { continue };
        for round in 0..options.rounds {
            if let Some(Ok(flight)) = &mut pool {
                let timing = flight.pool.time(&view, &mut warm_ups[0], clock)?;
                flight.run.traced.add(round == 0, &timing);
            }
            if let Some(thesis) = &mut thesis {
                let timing = thesis.time(&view, world, &mut warm_ups[1], clock)?;
                flown.traced.add(round == 0, &timing);
            }
        }
    }
    bar.finish_and_clear();
    let pool = pool.map(|flight| flight.map(|flight| flight.run));
    Ok(Flight { pool, thesis: thesis.map(|_| flown) })
}

/// Indices of `count` of `all`, spread evenly; all of them if there are no more.
fn spread(all: usize, count: usize) -> impl Iterator<Item = usize> {
    let count = count.min(all);
    (0..count).map(move |k| k * all / count)
}

/// Which of `strips` the thesis' kernel is fastest in, by the picture from the start of `path`.
pub fn best_strip(
    gpu: &Gpu,
    world: &World,
    config: Config,
    path: &CameraPath,
    thesis: &mut Thesis,
    size: [u32; 2],
    strips: &[[u32; 2]],
) -> anyhow::Result<Option<[u32; 2]>> {
    let Some(mut clock) = Timestamps::new(gpu, "strips", QueueKind::Compute, WarmUp::STAGES)? else {
        return Ok(None);
    };
    let camera = path.camera(0)?;
    let here = window(config, world, camera.eye());
    let view = view(world, &camera, size, here);
    thesis.load(world, here);
    thesis.place(here)?;
    let kernels = strips.iter().map(|&strip| Kernel::new(gpu, strip)).collect::<Result<Vec<_>, _>>()?;
    let mut warm_ups = vec![WarmUp::new(gpu.info().kind); strips.len()];
    let mut times = vec![Repeats::default(); strips.len()];
    for _ in 0..ROUNDS {
        for (k, kernel) in kernels.iter().enumerate() {
            thesis.use_kernel(kernel);
            let timing = thesis.time(&view, world, &mut warm_ups[k], &mut clock)?;
            times[k].push(timing.all_ms, timing.is_warm);
        }
    }
    let best = steady::best(&times);
    if let Some(best) = best {
        thesis.use_kernel(&kernels[best]);
    }
    Ok(best.map(|best| strips[best]))
}
