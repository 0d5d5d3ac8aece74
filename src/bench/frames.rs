//! Both pipelines along camera paths, frame by frame.

use super::FrameTimes;
use super::pool::Pool;
use super::thesis::{Config, Picture, Thesis};
use super::world::World;
use crate::gpu::Gpu;
use crate::render::camera::{Bounds, Camera};
use crate::render::frame::{Background, Shade, Traversal, View};
use crate::render::image::{Image, MISS_CLASS};
use crate::render::path::{CameraPath, PathKind, Stage};
use glam::{DVec2, DVec3};

/// Frames that our pipeline looks ahead, at the speed of the moment.
const AHEAD: i32 = 3;

/// What is run.
pub struct Options {
    /// Pixels.
    pub size: [u32; 2],
    /// Frames of each path that are drawn and measured; the pool streams in all of them.
    pub frames: u32,
    /// Seed of the random path.
    pub seed: u64,
}

/// One path under one configuration.
pub struct Run {
    /// The path.
    pub path: PathKind,
    /// Of the drawn frames.
    pub thesis: Vec<FrameTimes>,
    /// Of the drawn frames.
    pub pool: Vec<FrameTimes>,
    /// Of every frame: prepare and copy alone.
    pub stream: Vec<FrameTimes>,
    /// Sections that frames did without because they were still on their way.
    pub missing: usize,
    /// Largest share of pixels that differ between the pipelines' pictures.
    pub differ: f64,
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
fn window(config: Config, world: &World, eye: DVec3) -> [[i32; 2]; 2] {
    let cell = world.grid.cell();
    let index = |v: f64, axis: usize| ((v / cell).floor() as i64 - world.grid.anchor[axis]) as i32;
    config.window([index(eye.x, 0), index(eye.y, 1)])
}

fn view<'a>(world: &'a World, camera: &'a Camera, size: [u32; 2], window: [[i32; 2]; 2]) -> View<'a> {
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

/// Runs `kind` under `config` through both pipelines.
pub fn run(
    gpu: &Gpu,
    world: &World,
    config: Config,
    kind: PathKind,
    thesis: &mut Thesis,
    options: &Options,
) -> anyhow::Result<Run> {
    let path = kind.path(&stage(world, config), options.seed)?;
    let drawn: Vec<u32> = path.spread(options.frames.min(path.frames())).collect();
    let (first, last) = (drawn[0], *drawn.last().expect("a path has a frame"));
    let camera = |path: &CameraPath, frame| path.camera(frame);
    let (mut pool, mut stream) = (Vec::new(), Vec::new());
    let (mut missing, mut differ) = (0, 0.0f64);

    let mut resident = Pool::new(gpu, world)?;
    resident.load(world, window(config, world, camera(&path, 0)?.eye()))?;
    let mut pictures = Vec::new();
    for frame in 0..path.frames() {
        let now = camera(&path, frame)?;
        let here = window(config, world, now.eye());
        // Where the motion of the last frame leads to.
        let motion = now.eye() - camera(&path, frame.saturating_sub(1))?.eye();
        let ahead: Vec<_> =
            (1..=AHEAD).map(|n| window(config, world, now.eye() + motion * f64::from(n))).collect();
        let draws = drawn.binary_search(&frame).is_ok();
        let view = view(world, &now, options.size, here);
        let (times, late) = resident.frame(world, here, &ahead, draws.then_some(&view))?;
        missing += late;
        stream.push(times);
        if draws {
            pool.push(times);
        }
        if frame == first || frame == last {
            pictures.push((frame, resident.picture(&view)?));
        }
    }
    drop(resident);

    let mut theirs = Vec::new();
    for frame in drawn {
        let now = camera(&path, frame)?;
        let here = window(config, world, now.eye());
        let view = view(world, &now, options.size, here);
        thesis.load(world, here);
        theirs.push(thesis.frame(&view, world)?);
        if let Some((_, ours)) = pictures.iter().find(|(at, _)| *at == frame) {
            let other = differing(ours, &thesis.picture(&view, world)?);
            differ = differ.max(other as f64 / ours.class.len() as f64);
        }
    }
    Ok(Run { path: kind, thesis: theirs, pool, stream, missing, differ })
}
