//! Both pipelines along camera paths, frame by frame.

use super::FrameTimes;
use super::pool::{AHEAD, Pool};
use super::thesis::{Config, Picture, Thesis};
use super::world::World;
use crate::coords::CELL_LIMIT;
use crate::gpu::Gpu;
use crate::render::camera::{Bounds, Camera};
use crate::render::frame::{Background, Shade, Traversal, View};
use crate::render::image::{Image, MISS_CLASS};
use crate::render::path::{CameraPath, Stage};
use glam::{DVec2, DVec3};
use std::sync::atomic::{AtomicBool, Ordering};

/// What is run.
pub struct Options<'a> {
    /// Pixels.
    pub size: [u32; 2],
    /// Frames of each path that are drawn and measured, spread over it; the pool streams in all of them.
    pub frames: u32,
    /// Set: ends before the next frame.
    pub stop: &'a AtomicBool,
}

impl Options<'_> {
    fn drawn(&self, path: &CameraPath) -> Vec<u32> {
        path.spread(self.frames.max(1)).collect()
    }

    fn check(&self) -> anyhow::Result<()> {
        if self.stop.load(Ordering::Relaxed) { Err(Stopped.into()) } else { Ok(()) }
    }
}

/// [`Options::stop`] was set.
#[derive(Clone, Copy, Debug, thiserror::Error)]
#[error("stopped")]
pub struct Stopped;

/// One path through our pipeline.
pub struct PoolRun {
    /// Of the drawn frames.
    pub drawn: Vec<FrameTimes>,
    /// Of every frame: prepare and copy alone.
    pub stream: Vec<FrameTimes>,
    /// Sections that frames did without because they were still on their way.
    pub missing: usize,
    /// The first and the last drawn frame.
    pub pictures: Vec<(u32, Image)>,
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
pub struct ThesisRun {
    /// Of the drawn frames.
    pub drawn: Vec<FrameTimes>,
    /// Largest share of pixels that differ from our pictures; `None`: there were none.
    pub differ: Option<f64>,
}

/// Pixels that differ: hit in one and missed in the other, or in colour by more than 1/255 of sRGB.
pub fn differing(ours: &Image, theirs: &Picture) -> usize {
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
        floor: f64::NEG_INFINITY,
        colors: &world.colors,
        shade: Shade::None,
        background: Background::None,
        traversal: Traversal::Fast,
        window: Some(window),
    }
}

/// Where the paths are flown over `world` with windows of `config`.
pub fn stage(world: &World, config: Config) -> Stage {
    let b = &world.bounds;
    let cell = world.grid.cell();
    let [ground, top] = world.relief();
    Stage { center: b.center().truncate(), ground, top, cell, side: f64::from(config.side()) * cell }
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

/// Runs `path` under `config` through our pipeline.
pub fn run_pool(
    gpu: &Gpu,
    world: &World,
    config: Config,
    path: &CameraPath,
    options: &Options,
) -> anyhow::Result<PoolRun> {
    let drawn = options.drawn(path);
    let mut run = PoolRun { drawn: Vec::new(), stream: Vec::new(), missing: 0, pictures: Vec::new() };
    let mut resident = Pool::new(gpu, world, config.side())?;
    resident.load(world, window(config, world, path.camera(0)?.eye()))?;
    // Drivers compile on first use: a picture that is not measured.
    let start = path.camera(0)?;
    resident.picture(&view(world, &start, options.size, window(config, world, start.eye())))?;
    for frame in 0..path.frames() {
        options.check()?;
        let now = path.camera(frame)?;
        let here = window(config, world, now.eye());
        // Where the motion of the last frame leads to.
        let motion = now.eye() - path.camera(frame.saturating_sub(1))?.eye();
        let ahead: Vec<_> =
            (1..=AHEAD).map(|n| window(config, world, now.eye() + motion * f64::from(n))).collect();
        let draws = drawn.binary_search(&frame).is_ok();
        let view = view(world, &now, options.size, here);
        let (times, late) = resident.frame(world, here, &ahead, draws.then_some(&view))?;
        run.missing += late;
        run.stream.push(times);
        if draws {
            run.drawn.push(times);
        }
        if Some(&frame) == drawn.first() || Some(&frame) == drawn.last() {
            run.pictures.push((frame, resident.picture(&view)?));
        }
    }
    Ok(run)
}

/// Runs the same through the pipeline of the thesis, and compares it with our `pictures`.
pub fn run_thesis(
    world: &World,
    config: Config,
    path: &CameraPath,
    thesis: &mut Thesis,
    options: &Options,
    pictures: &[(u32, Image)],
) -> anyhow::Result<ThesisRun> {
    let mut run = ThesisRun { drawn: Vec::new(), differ: None };
    // As above.
    let start = path.camera(0)?;
    let here = window(config, world, start.eye());
    thesis.load(world, here);
    thesis.frame(&view(world, &start, options.size, here), world)?;
    for frame in options.drawn(path) {
        options.check()?;
        let now = path.camera(frame)?;
        let here = window(config, world, now.eye());
        let view = view(world, &now, options.size, here);
        thesis.load(world, here);
        run.drawn.push(thesis.frame(&view, world)?);
        if let Some((_, ours)) = pictures.iter().find(|(at, _)| *at == frame) {
            let other = differing(ours, &thesis.picture(&view, world)?);
            let share = other as f64 / ours.class.len() as f64;
            run.differ = Some(run.differ.unwrap_or(0.0).max(share));
        }
    }
    Ok(run)
}
