//! The pipelines of a frame's passes: which there are, for each way to the pool, and how they are specialised.

use super::bands::Band;
use super::mirrors::FramePush;
use super::options::{Logged, PassOptions, Shade, Traversal, View};
use crate::attribute::ColorMode;
#[cfg(feature = "view")]
use crate::gpu::DeviceKind;
use crate::gpu::{BindingKind, ComputePipeline, Gpu, GpuError, PipelineDesc, shaders};
use crate::resident::pool::Access;
use crate::resident::table::Table;
#[cfg(feature = "view")]
use crate::section::Surface;
use crate::shared::passes::{
    ID_BEAMED, ID_BEFORE, ID_DEALT, ID_GROUP_X, ID_GROUP_Y, ID_RAMPED, ID_SCREEN, ID_SIDE, TILE, WIDE_TILE,
};
use std::collections::HashMap;

/// What the passes are given where the pool is a storage buffer: pool, table, constants, hits, colours, ramp, beams,
/// wide beams.
const fn buffers(constants: BindingKind) -> [BindingKind; 8] {
    let mut all = [BindingKind::Storage; 8];
    all[2] = constants;
    all
}

/// And where it is read as texels: constants, pool, table, beams.
const fn texels(constants: BindingKind) -> [BindingKind; 4] {
    let mut all = [BindingKind::Texels; 4];
    all[0] = constants;
    all
}

/// What a pass is given, with each [`Access`].
struct Bindings {
    by_address: [BindingKind; 1],
    by_texels: [BindingKind; 4],
    by_buffer: [BindingKind; 8],
}

impl Bindings {
    const fn new(constants: BindingKind) -> Bindings {
        Bindings { by_address: [constants], by_texels: texels(constants), by_buffer: buffers(constants) }
    }
}

/// Constants in a uniform block; and, where `shaders/frame.glsl` says so by `FRAME_STORED`, in a storage buffer.
static UNIFORM: Bindings = Bindings::new(BindingKind::Uniform);
static STORED: Bindings = Bindings::new(BindingKind::Storage);

/// A pass's shader for each [`Access`].
struct Variants {
    bindings: &'static Bindings,
    by_address: &'static [u32],
    by_texels: &'static [u32],
    by_buffer: &'static [u32],
}

macro_rules! variants {
    ($bindings:ident, $address:ident, $texels:ident, $buffer:ident) => {
        Variants {
            bindings: &$bindings,
            by_address: shaders::$address,
            by_texels: shaders::$texels,
            by_buffer: shaders::$buffer,
        }
    };
}

static BEAM: Variants = variants!(UNIFORM, BEAM, BEAM_TEXELS, BEAM_SSBO);
static TRACE: Variants = variants!(STORED, TRACE, TRACE_TEXELS, TRACE_SSBO);
static EXACT: Variants = variants!(UNIFORM, EXACT, EXACT_TEXELS, EXACT_SSBO);
static PLAIN: Variants = variants!(UNIFORM, PLAIN, PLAIN_TEXELS, PLAIN_SSBO);
static SHADE: Variants = variants!(STORED, SHADE, SHADE_TEXELS, SHADE_SSBO);
/// Those that look for what floats.
static TRACE_FLOATS: Variants = variants!(STORED, TRACE_STACKED, TRACE_STACKED_TEXELS, TRACE_STACKED_SSBO);
static EXACT_FLOATS: Variants = variants!(UNIFORM, EXACT_STACKED, EXACT_STACKED_TEXELS, EXACT_STACKED_SSBO);
static SHADE_FLOATS: Variants = variants!(STORED, SHADE_STACKED, SHADE_STACKED_TEXELS, SHADE_STACKED_SSBO);
/// And those that look for a smooth surface besides.
static TRACE_SMOOTH: Variants = variants!(STORED, TRACE_SMOOTH, TRACE_SMOOTH_TEXELS, TRACE_SMOOTH_SSBO);
static EXACT_SMOOTH: Variants = variants!(UNIFORM, EXACT_SMOOTH, EXACT_SMOOTH_TEXELS, EXACT_SMOOTH_SSBO);
static SHADE_SMOOTH: Variants = variants!(STORED, SHADE_SMOOTH, SHADE_SMOOTH_TEXELS, SHADE_SMOOTH_SSBO);

/// What is looked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Seen {
    /// Columns, each solid from its top down.
    Columns,
    /// And what floats.
    Floats,
    /// Or a smooth surface, and what floats.
    Smooth,
}

impl Seen {
    /// Of all that `table` names.
    pub fn of(table: &Table) -> Seen {
        match (table.smooth, table.floats) {
            (true, _) => Seen::Smooth,
            (false, true) => Seen::Floats,
            (false, false) => Seen::Columns,
        }
    }
}

impl Variants {
    fn desc(&self, name: &'static str, access: Access, constants: Vec<(u32, u32)>) -> PipelineDesc {
        let (words, bindings) = match access {
            Access::Address => (self.by_address, &self.bindings.by_address[..]),
            Access::Texels => (self.by_texels, &self.bindings.by_texels[..]),
            Access::StorageBuffer => (self.by_buffer, &self.bindings.by_buffer[..]),
        };
        PipelineDesc { name, words, constants, push_bytes: size_of::<FramePush>() as u32, bindings }
    }
}

/// A pipeline for exact images: only what they need is in it.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct Exact {
    ramped: bool,
    screen: bool,
    seen: Seen,
}

/// The passes that are there from the start: wide beams, beams, trace, shade.
fn passes(access: Access, options: PassOptions) -> [PipelineDesc; 4] {
    let shared =
        |[x, y]: [u32; 2]| vec![(ID_GROUP_X, x), (ID_GROUP_Y, y), (ID_DEALT, u32::from(options.dealt))];
    let beams = |name, side: u32, before: u32| {
        let sides = [(ID_SIDE, side), (ID_BEFORE, before)];
        BEAM.desc(name, access, [shared(options.beam_group), sides.to_vec()].concat())
    };
    let trace = [shared(options.group), vec![(ID_BEAMED, u32::from(options.beams))]].concat();
    let [mut wide_beams, mut beams] = [beams("wide beams", WIDE_TILE, 0), beams("beams", TILE, WIDE_TILE)];
    match options.logged {
        Some(Logged::WideBeams) => wide_beams.words = shaders::BEAM_LOGGED,
        Some(Logged::Beams) => beams.words = shaders::BEAM_LOGGED,
        Some(Logged::Trace) | None => {}
    }
    [
        wide_beams,
        beams,
        TRACE.desc("trace", access, trace),
        SHADE.desc("shade", access, shared(options.group)),
    ]
}

/// Trace and shade where things float, or where tops are a smooth surface too. Beams know nothing of such: there rays start at the
/// eye.
fn floating(access: Access, options: PassOptions, smooth: bool) -> [PipelineDesc; 2] {
    let [x, y] = options.group;
    let shared = vec![(ID_GROUP_X, x), (ID_GROUP_Y, y), (ID_DEALT, u32::from(options.dealt))];
    let trace = [shared.clone(), vec![(ID_BEAMED, u32::from(options.beams && !smooth))]].concat();
    let [tracing, shading] =
        if smooth { [&TRACE_SMOOTH, &SHADE_SMOOTH] } else { [&TRACE_FLOATS, &SHADE_FLOATS] };
    [tracing.desc("trace", access, trace), shading.desc("shade", access, shared)]
}

impl Exact {
    fn desc(self, access: Access, options: PassOptions) -> PipelineDesc {
        let Exact { ramped, screen, seen } = self;
        let PassOptions { group, dealt, .. } = options;
        let beams = options.beams && seen != Seen::Smooth;
        let flags = [(ID_RAMPED, ramped), (ID_SCREEN, screen), (ID_DEALT, dealt), (ID_BEAMED, beams)];
        let flags = flags.map(|(id, on)| (id, u32::from(on)));
        let shaders = match seen {
            Seen::Columns => &EXACT,
            Seen::Floats => &EXACT_FLOATS,
            Seen::Smooth => &EXACT_SMOOTH,
        };
        let mut desc = shaders.desc(
            "exact",
            access,
            [&[(ID_GROUP_X, group[0]), (ID_GROUP_Y, group[1])], &flags[..]].concat(),
        );
        if options.logged == Some(Logged::Trace) {
            desc.words = shaders::EXACT_LOGGED;
        }
        desc
    }
}

fn plain(access: Access, options: PassOptions) -> PipelineDesc {
    let [x, y] = options.group;
    let mut desc = PLAIN.desc("plain", access, vec![(ID_GROUP_X, x), (ID_GROUP_Y, y)]);
    if options.logged == Some(Logged::Trace) {
        desc.words = shaders::PLAIN_LOGGED;
    }
    desc
}

impl PassOptions {
    /// The pipelines of an image's passes, in their order.
    pub fn pipeline_descs(self, access: Access, traversal: Traversal, shade: Shade) -> Vec<PipelineDesc> {
        let [wide_beams, beams, trace, shading] = passes(access, self);
        let mut pipeline_descs = match traversal {
            Traversal::Fast if self.beams => vec![wide_beams, beams],
            _ => Vec::new(),
        };
        match (traversal, shade) {
            (Traversal::Fast, Shade::None) => {
                let exact = Exact { ramped: false, screen: true, seen: Seen::Columns };
                pipeline_descs.push(exact.desc(access, self));
            }
            (Traversal::Fast, Shade::Lit) => pipeline_descs.extend([trace, shading]),
            (Traversal::Plain, _) => pipeline_descs.extend([plain(access, self), shading]),
        }
        pipeline_descs
    }
}

/// A pass of a frame: what it is called where it is timed, its pipeline, and its workgroups.
pub(super) struct FramePass {
    pub name: &'static str,
    pub pipeline: ComputePipeline,
    pub groups: [u32; 3],
}

/// Pipelines that one renderer draws with.
pub(super) struct FramePipelines {
    wide_beams: ComputePipeline,
    beams: ComputePipeline,
    trace: ComputePipeline,
    /// Made when first used.
    plain: Option<ComputePipeline>,
    shade: ComputePipeline,
    /// Trace and shade where things float; made when first used.
    floating: HashMap<Seen, [ComputePipeline; 2]>,
    /// Trace and exact colours in one; made when first used.
    exact: HashMap<Exact, ComputePipeline>,
    access: Access,
    options: PassOptions,
}

impl FramePipelines {
    pub fn new(gpu: &Gpu, access: Access, options: PassOptions) -> Result<FramePipelines, GpuError> {
        let [wide_beams, beams, trace, shade] = passes(access, options).map(|desc| desc.make(gpu));
        Ok(FramePipelines {
            wide_beams: wide_beams?,
            beams: beams?,
            trace: trace?,
            plain: None,
            shade: shade?,
            floating: HashMap::new(),
            exact: HashMap::new(),
            access,
            options,
        })
    }

    /// The passes of `band` of `view` in their order; those of the beams are left out where `has_beams`. `seen`: what
    /// may be hit.
    pub fn passes(
        &mut self,
        gpu: &Gpu,
        view: &View,
        band: Band,
        has_beams: bool,
        seen: Seen,
    ) -> Result<Vec<FramePass>, GpuError> {
        let seen = if view.traversal == Traversal::Fast { seen } else { Seen::Columns };
        let groups = |[x, y]: [u32; 2], side: u32| {
            [view.size[0].div_ceil(side).div_ceil(x), band.rows.div_ceil(side).div_ceil(y), 1]
        };
        let (tiles, pixels) = (|side| groups(self.options.beam_group, side), groups(self.options.group, 1));
        let mut passes = vec![];
        let mut add = |name, pipeline, groups| passes.push(FramePass { name, pipeline, groups });
        if view.traversal == Traversal::Fast && self.options.beams && !has_beams && seen != Seen::Smooth {
            add("wide beams", self.wide_beams.clone(), tiles(WIDE_TILE));
            add("beams", self.beams.clone(), tiles(TILE));
        }
        match (view.traversal, view.shade) {
            (Traversal::Fast, Shade::None) => {
                let ramped = view.colors.mode != ColorMode::Rgb;
                let exact = Exact { ramped, screen: band.screen, seen };
                add("trace", self.exact(gpu, exact)?, pixels);
            }
            (Traversal::Fast, Shade::Lit) if seen != Seen::Columns => {
                let [trace, shade] = self.floating(gpu, seen)?;
                add("trace", trace, pixels);
                add("shade", shade, pixels);
            }
            (traversal, _) => {
                let trace = if traversal == Traversal::Fast { self.trace.clone() } else { self.plain(gpu)? };
                add("trace", trace, pixels);
                add("shade", self.shade.clone(), pixels);
            }
        }
        if let Some(logged) = self.options.logged {
            passes.truncate(match logged {
                Logged::WideBeams => 1,
                Logged::Beams => 2,
                // Nor is the log coloured.
                Logged::Trace => passes.len() - passes.iter().filter(|pass| pass.name == "shade").count(),
            });
        }
        Ok(passes)
    }

    fn floating(&mut self, gpu: &Gpu, seen: Seen) -> Result<[ComputePipeline; 2], GpuError> {
        if let Some(known) = self.floating.get(&seen) {
            return Ok(known.clone());
        }
        let descs = floating(self.access, self.options, seen == Seen::Smooth);
        let [trace, shade] = descs.map(|desc| desc.make(gpu));
        let made = [trace?, shade?];
        self.floating.insert(seen, made.clone());
        Ok(made)
    }

    /// The pipeline for exact images that need so much.
    fn exact(&mut self, gpu: &Gpu, exact: Exact) -> Result<ComputePipeline, GpuError> {
        if let Some(pipeline) = self.exact.get(&exact) {
            return Ok(pipeline.clone());
        }
        let pipeline = exact.desc(self.access, self.options).make(gpu)?;
        self.exact.insert(exact, pipeline.clone());
        Ok(pipeline)
    }

    fn plain(&mut self, gpu: &Gpu) -> Result<ComputePipeline, GpuError> {
        if self.plain.is_none() {
            self.plain = Some(plain(self.access, self.options).make(gpu)?);
        }
        Ok(self.plain.clone().expect("just made"))
    }
}

/// Pipelines of a window's images: those of lit ones, and those of others. Whoever holds them makes [`super::Renderer::new`]
/// and images quick.
#[cfg(feature = "view")]
pub fn pipeline_descs(kind: DeviceKind, access: Access, surface: Surface) -> [Vec<PipelineDesc>; 2] {
    let options = PassOptions::of(kind);
    let (seen, smooth) = match surface {
        Surface::Columns => (Seen::Columns, false),
        Surface::Stacks => (Seen::Floats, false),
        Surface::Smooth => (Seen::Smooth, true),
    };
    let exact = [true, false].map(|ramped| Exact { ramped, screen: false, seen }.desc(access, options));
    // What nothing floats in is drawn without looking for it, the sparse sample, too.
    let floating = surface.floats().then(|| floating(access, options, smooth)).into_iter().flatten();
    [passes(access, options).into_iter().chain(floating).collect(), exact.into()]
}
