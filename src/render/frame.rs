//! One picture of a scene: the passes of a frame, and what comes back.

use super::camera::{Camera, CameraError, RayBasis};
use super::image::Image;
use crate::attribute::{ColorMode, ColorTable};
use crate::coords::{Bounds, CELL_LIMIT, Grid, Height, power_of_two_at_most};
use crate::gpu::{
    Binding, BindingCache, BindingKind, Buffer, BufferCopy, Commands, ComputePipeline, DeviceKind, Gpu,
    GpuError, MemoryKind, Recipe, SyncPoint, Timestamps, shaders,
};
use crate::resident::cut::Shown;
use crate::resident::live::Live;
use crate::resident::pool::Access;
use crate::resident::scene::Scene;
use crate::resident::table::Table;
use crate::resident::visibility::Carried;
use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use std::collections::HashMap;
use std::sync::{Arc, Weak};

/// Which traversal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Traversal {
    /// Table, pyramid, column.
    Fast,
    /// The plain algorithm of the thesis, §3.2.3.
    Plain,
}

/// What is behind the data.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Background {
    /// A soft sky.
    Sky,
    /// White.
    White,
    /// Nothing: transparent.
    None,
}

/// How hits are coloured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Shade {
    /// Exactly the column's colour.
    None,
    /// Sun and sky.
    Lit,
}

/// A picture to be made.
#[derive(Clone, Debug)]
pub struct View<'a> {
    /// From where.
    pub camera: &'a Camera,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Rays a pixel.
    pub samples: u32,
    /// Vertical exaggeration about `pivot`.
    pub z_scale: f64,
    /// Height that stays where it is, CRS units.
    pub pivot: f64,
    /// Where most of the data is, not exaggerated. Numbers are finest from its near side on.
    pub bounds: Bounds,
    /// Lit pictures end at this height, CRS units: columns are solid without end, which nobody wants to see.
    pub floor: f64,
    /// Colour of hits.
    pub colors: &'a ColorTable,
    /// Light.
    pub shade: Shade,
    /// What is behind.
    pub background: Background,
    /// Which traversal.
    pub traversal: Traversal,
    /// Only these cells are there, counted from the grid's anchor: lower corner, upper corner (exclusive).
    pub window: Option<[[i32; 2]; 2]>,
}

/// What went wrong with a picture.
#[derive(Debug, thiserror::Error)]
pub enum FrameError {
    /// The device.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The camera.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// More pixels than the device can write at once.
    #[error("a picture of {width}x{height} pixels is too large for the device: its limit is {limit}")]
    Size {
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
        /// The device's, in words.
        limit: String,
    },
}

/// Mirrors `Frame` in `shaders/frame.glsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct FrameConstants {
    table: [u32; 2],
    hits: [u32; 2],
    colors: [u32; 2],
    ramp: [u32; 2],
    beams: [u32; 2],
    wide_beams: [u32; 2],
    table_mask: u32,
    top_level: i32,
    section_level: i32,
    low: [i32; 2],
    high: [i32; 2],
    width: u32,
    height: u32,
    origin_int: [i32; 3],
    origin_fraction: [u32; 3],
    right_int: [i32; 3],
    right_fraction: [u32; 3],
    down_int: [i32; 3],
    down_fraction: [u32; 3],
    depth: f32,
    forward: [f32; 3],
    right: [f32; 3],
    down: [f32; 3],
    to_local: [f32; 3],
    origin_step: f32,
    height_anchor: i32,
    shade: u32,
    color_source: u32,
    range_low: u32,
    range_scale: f32,
    cell_steps: f32,
    sun: [f32; 3],
    background: u32,
    floor: f32,
}

impl FrameConstants {
    /// The same over what the thesis' kernel reads: heights, hits, image and colours; log2 of the section's side;
    /// its coarsest level; where it lies.
    pub(crate) fn over(
        self,
        [heights, hits, image, colors]: [&Buffer; 4],
        side_log2: u32,
        top_level: i32,
        [low, high]: [[i32; 2]; 2],
    ) -> FrameConstants {
        FrameConstants {
            table: halves(heights.address()),
            hits: halves(hits.address()),
            colors: halves(image.address()),
            ramp: halves(colors.address()),
            table_mask: side_log2,
            top_level,
            low,
            high,
            ..self
        }
    }

    /// What `view` alone says: places, table and window are left 0.
    pub(crate) fn new(view: &View, rays: &Rays, grid: &Grid, height_anchor: Height) -> FrameConstants {
        let cell = grid.cell();
        let Origins { origin, right, down, step } = rays.origins;
        let (origin_int, origin_fraction) = parts(origin);
        let (right_int, right_fraction) = parts(right.map(|step| step * 16));
        let (down_int, down_fraction) = parts(down.map(|step| step * 16));
        let to_local =
            DVec3::new(1.0 / cell, 1.0 / cell, 1.0 / (grid.height_step * view.z_scale)) * rays.unit;
        // From the north-west, 45° high, as on maps.
        let sun = DVec3::new(-0.5, 0.5, std::f64::consts::FRAC_1_SQRT_2);
        FrameConstants {
            width: view.size[0],
            height: view.size[1],
            origin_int,
            origin_fraction,
            right_int,
            right_fraction,
            down_int,
            down_fraction,
            depth: (rays.shown.advanced() / rays.unit) as f32,
            forward: rays.shown.d0.as_vec3().to_array(),
            right: (rays.shown.dx / 16.0).as_vec3().to_array(),
            down: (rays.shown.dy / 16.0).as_vec3().to_array(),
            to_local: to_local.as_vec3().to_array(),
            origin_step: step as f32,
            height_anchor: height_anchor.0,
            shade: u32::from(view.shade == Shade::Lit),
            color_source: match view.colors.mode {
                ColorMode::Rgb => 0,
                ColorMode::Height => 1,
                ColorMode::Class => 2,
                ColorMode::Intensity => 3,
                ColorMode::Return => 4,
            },
            range_low: view.colors.lo,
            range_scale: view.colors.scale,
            cell_steps: (grid.cell_steps(0) / view.z_scale) as f32,
            sun: sun.as_vec3().to_array(),
            background: match view.background {
                Background::None => 0,
                Background::White => 1,
                Background::Sky => 2,
            },
            floor: match view.shade {
                Shade::None => f32::NEG_INFINITY,
                Shade::Lit => (view.floor / grid.height_step - f64::from(height_anchor.0)) as f32,
            },
            ..FrameConstants::zeroed()
        }
    }
}

/// The rays of a picture, from a plane just before the data on.
#[derive(Clone)]
pub(crate) struct Rays {
    /// As they are shown.
    shown: RayBasis,
    /// As they run through unexaggerated data.
    through: RayBasis,
    /// Of those, what the device is given.
    origins: Origins,
    /// CRS units in one of the device's lengths: a power of two, so that it rounds nothing, and not above a cell, so that
    /// the device computes with the same numbers whatever the unit is.
    unit: f64,
}

/// Origins of rays as the device has them: cells, cells and height steps from the anchors, in 32.32 fixed point.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Origins {
    /// At the top left corner of the image's middle pixel.
    origin: [i64; 3],
    /// Per sixteenth of a pixel, of which samples and the centre of an odd size are whole numbers.
    right: [i64; 3],
    down: [i64; 3],
    /// Height steps in one of the third coordinate: 1, or a power of two where the picture reaches farther up or down
    /// than whole steps can be counted.
    step: f64,
}

/// Steps of a plane before the data's depth, in height steps: it is rounded so that it does not depend on where in its
/// CRS the data lies.
const STEPS_OF_DEPTH: f64 = 64.0;

/// Whole cells and height steps from the anchors within which origins must lie, each way: differences from what is there
/// fit 32 bits.
const ORIGIN_REACH: i128 = 1 << 30;
const _: () = assert!(ORIGIN_REACH + CELL_LIMIT as i128 <= 1 << 31);

/// More doublings of [`Origins::step`] than any picture needs whose width can be counted in cells.
const MOST_STEP_LOG2: i32 = 64;

impl Rays {
    /// Of `view`, over cells and heights of `grid`, the heights counted from `anchor` on the device.
    /// Errors: the picture takes in too much to be counted in cells.
    pub(crate) fn of(view: &View, grid: &Grid, anchor: Height) -> Result<Rays, CameraError> {
        let shown = view.camera.drawn_basis(view.size, grid.height_step)?;
        let bounds = view.bounds.exaggerated(view.z_scale, view.pivot);
        // Not less than a cell before the data, so that rounding does not reach it.
        let depth = shown.depth_of(&bounds, view.camera.forward(), view.size) - grid.cell();
        let step = STEPS_OF_DEPTH * grid.height_step;
        let shown = shown.advance(((depth / step).floor() * step).max(0.0));
        let through = shown.exaggerated(view.z_scale, view.pivot)?;
        let origins = Origins::of(&through, view.size, grid, anchor).ok_or_else(|| CameraError::TooWide {
            width: [through.ox, through.oy]
                .into_iter()
                .zip(view.size)
                .map(|(pixel, pixels)| pixel.length() * f64::from(pixels))
                .fold(0.0, f64::max),
            cell: grid.cell(),
        })?;
        Ok(Rays { shown, through, origins, unit: power_of_two_at_most(grid.cell()) })
    }
}

impl Origins {
    /// `None` where a ray of the picture starts too many cells from the anchor.
    fn of(rays: &RayBasis, size: [u32; 2], grid: &Grid, height_anchor: Height) -> Option<Origins> {
        let cell = grid.cell();
        let anchor = DVec3::new(grid.anchor[0] as f64, grid.anchor[1] as f64, f64::from(height_anchor.0));
        // Divided as cell indices are: a border is a whole number.
        let eye = rays.eye / DVec3::new(cell, cell, grid.height_step) - anchor;
        let per_unit = DVec3::new(1.0 / cell, 1.0 / cell, grid.height_step.recip());
        let odd_half = size.map(|pixels| -8 * i128::from(pixels & 1));
        (0..MOST_STEP_LOG2).find_map(|log2| {
            let step = f64::from(log2).exp2();
            let counted = DVec3::new(1.0, 1.0, step);
            // Added in fixed point, so that what is left of the eye's place in the world does not round the rest; and
            // before they have to fit 64 bits: eyes may be far from the data, origins are near.
            let [eye, from_eye] = [eye, rays.o0 * per_unit].map(|v| fixed3(v / counted));
            let [right, down] = [rays.ox, rays.oy].map(|pixel| fixed3(pixel / 16.0 * per_unit / counted));
            let (eye, from_eye, right, down) = (eye?, from_eye?, right?, down?);
            let origin: [i128; 3] = std::array::from_fn(|axis| {
                eye[axis] + from_eye[axis] + right[axis] * odd_half[0] + down[axis] * odd_half[1]
            });
            // Beams' corners lie up to a wide tile beyond the edge.
            let [x, y] = size.map(|pixels| 16 * i128::from(pixels / 2 + WIDE_TILE));
            let fits = (0..3).all(|axis| {
                let reach = origin[axis].abs() + right[axis].abs() * x + down[axis].abs() * y;
                reach >> 32 < ORIGIN_REACH
            });
            let narrow = |v: [i128; 3]| v.map(|bits| bits as i64);
            fits.then(|| Origins { origin: narrow(origin), right: narrow(right), down: narrow(down), step })
        })
    }
}

/// Mirrors the push constants of `shaders/frame.glsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(crate) struct Push {
    sample_at: [i32; 2],
    sample_index: u32,
    sample_weight: f32,
    first_row: u32,
    rows: u32,
    origin_int: [i32; 3],
    origin_fraction: [u32; 3],
}

/// Mirrors a hit record after shading.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(super) struct Hit {
    t: f32,
    /// Class (256: a miss) | origin << 9 | face << 12.
    pub(super) bits: u32,
    /// Nodes that the traversal looked at.
    steps: u32,
    /// Lattice steps from the anchor.
    top: i32,
}

/// What the ray of pixel (px, py) has hit: distance from the eye as shown, and U; heights count from `anchor`.
fn distance_and_height(
    Rays { shown, through, unit, .. }: &Rays,
    hit: &Hit,
    [px, py]: [f64; 2],
    grid: &Grid,
    anchor: Height,
) -> [f64; 2] {
    let t = f64::from(hit.t) * unit;
    let height = if hit.bits >> 12 == FACE_TOP {
        grid.units(Height(hit.top.wrapping_add(anchor.0)))
    } else {
        let along = through.direction(px, py).z / through.length(px, py);
        through.origin(px, py).z + t * along
    };
    [shown.distance_eye_to_plane(px, py) + t, height]
}

impl Push {
    /// One sample of every pixel of `rows` rows from `first_row` on, under `constants`.
    pub(crate) fn new(
        constants: &FrameConstants,
        [sample, samples]: [u32; 2],
        [first_row, rows]: [u32; 2],
    ) -> Push {
        let sample_at = sample_at(sample, samples);
        let [origin, right, down] = [
            joined(constants.origin_int, constants.origin_fraction),
            joined(constants.right_int, constants.right_fraction),
            joined(constants.down_int, constants.down_fraction),
        ];
        let sixteenth = |step: [i64; 3]| step.map(|bits| bits >> 4);
        let origin = added(origin, sixteenth(right), sample_at[0].into());
        let (origin_int, origin_fraction) = parts(added(origin, sixteenth(down), sample_at[1].into()));
        let sample_weight = 1.0 / samples as f32;
        Push { sample_at, sample_index: sample, sample_weight, first_row, rows, origin_int, origin_fraction }
    }

    /// One sample of every pixel, in its centre.
    pub(crate) fn whole(constants: &FrameConstants) -> Push {
        Push::new(constants, [0, 1], [0, constants.height])
    }
}

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

/// A pass's program for each [`Access`].
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

/// How often the passes of a frame run, for measurements: a device's clock rises while it works.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Repeats {
    /// Runs before those that are timed; together they are a stage of the clock, `"before"`, if there are any.
    pub before: u32,
    /// Runs whose passes are stages of the clock, one run after the other.
    pub timed: u32,
}

impl Repeats {
    /// As frames run.
    pub const ONCE: Repeats = Repeats { before: 0, timed: 1 };

    /// Stages that a clock of `passes` passes must have room for.
    pub const fn stages(self, passes: u32) -> u32 {
        (self.before > 0) as u32 + self.timed * passes
    }
}

/// A pass whose threads write down what they do: see `shaders/log.glsl`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Logged {
    /// The wide beams; the passes after it do not run.
    WideBeams,
    /// The beams; the passes after it do not run.
    Beams,
    /// Trace and exact colours, or the plain traversal.
    Trace,
}

/// How the passes of a picture are cut into groups and ordered; pictures do not depend on it. The default is what the
/// program draws with, others are for benchmarks.
///
/// Widths are multiples of 8: with groups of 12 × 6, lavapipe (Mesa 22.3) drew other pictures by address, though not by
/// texels; why is not known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PassOptions {
    /// Pixels that a workgroup of trace and shade covers.
    pub group: [u32; 2],
    /// Tiles that a workgroup of the beams covers.
    pub beam_group: [u32; 2],
    /// Rows of groups are dealt out, the even ones first; otherwise groups have their own order.
    pub dealt: bool,
    /// Rays start behind beams, not at the eye.
    pub beams: bool,
    /// Set: [`Renderer::log`] is what the renderer is for.
    pub logged: Option<Logged>,
}

impl Default for PassOptions {
    fn default() -> PassOptions {
        PassOptions { group: GROUP, beam_group: [GROUP[0], 1], dealt: true, beams: true, logged: None }
    }
}

impl PassOptions {
    /// What is fastest on devices of a kind. Beams and dealt groups suit CPU drivers; on a graphics card the two beam passes
    /// have few threads, each a long chain of loads, and cost more than they save: see `docs/performance.md`.
    pub fn of(kind: DeviceKind) -> PassOptions {
        let is_cpu = kind == DeviceKind::Cpu;
        PassOptions { beams: is_cpu, dealt: is_cpu, ..PassOptions::default() }
    }

    /// The programs of a picture's passes, in their order.
    pub fn recipes(self, access: Access, traversal: Traversal, shade: Shade) -> Vec<Recipe> {
        let [wide_beams, beams, trace, shading] = passes(access, self);
        let mut recipes = match traversal {
            Traversal::Fast if self.beams => vec![wide_beams, beams],
            _ => Vec::new(),
        };
        match (traversal, shade) {
            (Traversal::Fast, Shade::None) => {
                recipes.push(Exact { ramped: false, screen: true }.recipe(access, self));
            }
            (Traversal::Fast, Shade::Lit) => recipes.extend([trace, shading]),
            (Traversal::Plain, _) => recipes.extend([plain(access, self), shading]),
        }
        recipes
    }
}

static BEAM: Variants = variants!(UNIFORM, BEAM, BEAM_TEXELS, BEAM_SSBO);
static TRACE: Variants = variants!(STORED, TRACE, TRACE_TEXELS, TRACE_SSBO);
static EXACT: Variants = variants!(UNIFORM, EXACT, EXACT_TEXELS, EXACT_SSBO);
static PLAIN: Variants = variants!(UNIFORM, PLAIN, PLAIN_TEXELS, PLAIN_SSBO);
static SHADE: Variants = variants!(STORED, SHADE, SHADE_TEXELS, SHADE_SSBO);

impl Variants {
    fn recipe(&self, name: &'static str, access: Access, constants: Vec<(u32, u32)>) -> Recipe {
        let (words, bindings) = match access {
            Access::Address => (self.by_address, &self.bindings.by_address[..]),
            Access::Texels => (self.by_texels, &self.bindings.by_texels[..]),
            Access::StorageBuffer => (self.by_buffer, &self.bindings.by_buffer[..]),
        };
        Recipe { name, words, constants, push_bytes: size_of::<Push>() as u32, bindings }
    }
}

/// Passes of a frame.
pub const PASSES: u32 = 4;

/// Pixels of the side of a beam's tile; `shaders/frame.glsl` has the same.
const TILE: u32 = 8;
/// And of the wide beams'.
const WIDE_TILE: u32 = 64;
/// How far a beam came and its level, in one word.
const BYTES_PER_BEAM: u64 = 4;

const BYTES_PER_PIXEL: u64 = 16;
/// Words that a thread of a logged pass writes; `shaders/log.glsl` has the same.
pub const LOG_WORDS: usize = 512;
/// Where a step begins in a log; other words are lines that were loaded from.
pub const LOG_STEP: u32 = u32::MAX;
/// Of the logs of one submit.
const LOG_BYTES: u64 = 128 << 20;
/// Of the buffer of a section table: one that is made anew while sections arrive costs a frame, on lavapipe even a new
/// translation of the passes that read it.
const LEAST_TABLE_BYTES: u64 = 1 << 20;
const FACE_TOP: u32 = 0;

/// Pixels a workgroup covers.
const GROUP: [u32; 2] = [8, 8];

/// Buffers that exist once for every frame in flight.
struct InFlight {
    frame: Buffer,
    table: Buffer,
    /// What `table` holds: it is written only where it is another.
    written: Weak<Table>,
    ramp: Buffer,
    bindings: BindingCache,
}

/// Buffers of one picture size.
struct Target {
    size: [u32; 2],
    hits: Buffer,
    colors: Buffer,
    beams: Buffer,
    wide_beams: Buffer,
    /// Hits and colours for the host; made when first read back.
    back: Option<[Buffer; 2]>,
}

/// A program for exact pictures: only what they need is in it.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct Exact {
    ramped: bool,
    screen: bool,
}

/// Of the specialisation constants of `shaders/frame.glsl` and `shaders/trace.glsl`.
const DEALT: u32 = 5;
const BEAMED: u32 = 6;

/// The passes that are there from the start: wide beams, beams, trace, shade.
fn passes(access: Access, options: PassOptions) -> [Recipe; 4] {
    let shared = |[x, y]: [u32; 2]| vec![(0, x), (1, y), (DEALT, u32::from(options.dealt))];
    let beams = |name, side: u32, before: u32| {
        let sides = [(2, side), (3, before)];
        BEAM.recipe(name, access, [shared(options.beam_group), sides.to_vec()].concat())
    };
    let trace = [shared(options.group), vec![(BEAMED, u32::from(options.beams))]].concat();
    let [mut wide_beams, mut beams] = [beams("wide beams", WIDE_TILE, 0), beams("beams", TILE, WIDE_TILE)];
    match options.logged {
        Some(Logged::WideBeams) => wide_beams.words = shaders::BEAM_LOGGED,
        Some(Logged::Beams) => beams.words = shaders::BEAM_LOGGED,
        Some(Logged::Trace) | None => {}
    }
    [
        wide_beams,
        beams,
        TRACE.recipe("trace", access, trace),
        SHADE.recipe("shade", access, shared(options.group)),
    ]
}

impl Exact {
    fn recipe(self, access: Access, options: PassOptions) -> Recipe {
        let Exact { ramped, screen } = self;
        let PassOptions { group, dealt, beams, .. } = options;
        let flags = [(3, ramped), (4, screen), (DEALT, dealt), (BEAMED, beams)];
        let flags = flags.map(|(id, on)| (id, u32::from(on)));
        let mut recipe =
            EXACT.recipe("exact", access, [&[(0, group[0]), (1, group[1])], &flags[..]].concat());
        if options.logged == Some(Logged::Trace) {
            recipe.words = shaders::EXACT_LOGGED;
        }
        recipe
    }
}

fn plain(access: Access, options: PassOptions) -> Recipe {
    let [x, y] = options.group;
    let mut recipe = PLAIN.recipe("plain", access, vec![(0, x), (1, y)]);
    if options.logged == Some(Logged::Trace) {
        recipe.words = shaders::PLAIN_LOGGED;
    }
    recipe
}

/// Programs of a window's pictures: those of lit ones, and those of others. Whoever holds them makes [`Renderer::new`]
/// and pictures quick.
#[cfg(feature = "view")]
pub fn recipes(kind: DeviceKind, access: Access) -> [Vec<Recipe>; 2] {
    let options = PassOptions::of(kind);
    let exact = [true, false].map(|ramped| Exact { ramped, screen: false }.recipe(access, options));
    [passes(access, options).into(), exact.into()]
}

/// Lets the columns of `scene` carry what `view` colours by. Before a frame begins: it may be work of its own.
pub(super) fn carry(scene: &mut Scene, view: &View) -> Result<(), GpuError> {
    match view.colors.mode {
        ColorMode::Rgb => scene.carry(Carried::Colors),
        ColorMode::Intensity | ColorMode::Return => scene.carry(Carried::Values),
        ColorMode::Class | ColorMode::Height => Ok(()),
    }
}

/// Makes pictures of a scene.
pub struct Renderer {
    wide_beams: ComputePipeline,
    beams: ComputePipeline,
    trace: ComputePipeline,
    /// Made when first used.
    plain: Option<ComputePipeline>,
    shade: ComputePipeline,
    /// Trace and exact colours in one; made when first used.
    exact: HashMap<Exact, ComputePipeline>,
    access: Access,
    options: PassOptions,
    repeats: Repeats,
    /// Of a logged pass: on the device, and for the host.
    log: Option<[Buffer; 2]>,
    in_flight: Vec<Option<InFlight>>,
    target: Option<Target>,
    /// First row, rows and sample of the band whose beams the target holds.
    beamed: Option<(u32, u32, u32)>,
    /// Lattice height of local height 0.
    anchor: Height,
    grid: Grid,
    /// The table of [`Renderer::table_of_live`], and of which generation of the scene and of what is shown.
    live_table: Option<([u64; 2], Arc<Table>)>,
}

fn halves(address: u64) -> [u32; 2] {
    [address as u32, (address >> 32) as u32]
}

/// Fixed point with 32 bits of fraction, of places so far away that a few of them can be added and multiplied by pixels;
/// `None` beyond.
fn fixed3(v: DVec3) -> Option<[i128; 3]> {
    const REACH: f64 = (1u128 << 96) as f64;
    let bits = (v * 4_294_967_296.0).round();
    // NaN fails.
    bits.abs().cmplt(DVec3::splat(REACH)).all().then(|| bits.to_array().map(|bits| bits as i128))
}

/// `a + n · b`.
fn added(a: [i64; 3], b: [i64; 3], n: i64) -> [i64; 3] {
    std::array::from_fn(|axis| a[axis].wrapping_add(b[axis].wrapping_mul(n)))
}

/// Whole parts and fractions.
fn parts(fixed: [i64; 3]) -> ([i32; 3], [u32; 3]) {
    (fixed.map(|bits| (bits >> 32) as i32), fixed.map(|bits| bits as u32))
}

fn joined(int: [i32; 3], fraction: [u32; 3]) -> [i64; 3] {
    std::array::from_fn(|axis| i64::from(int[axis]) << 32 | i64::from(fraction[axis]))
}

/// Rays that one submit traces: large pictures go in bands of rows, one sample of a pixel at a time, so that no
/// submit runs for long (drivers end those that do) and device memory does not grow with the picture.
const SUBMIT_RAYS: u64 = 1 << 21;
/// Most pixels of a picture: 32 bytes each in host memory.
const MOST_PIXELS: u64 = 1 << 27;

/// And of its sides: rays count pixels from the middle, beams' corners up to a wide tile beyond the edge, and shaders
/// multiply that by 16 bits in 31.
const MOST_SIDE: u32 = 65_400;
const _: () = assert!(MOST_SIDE / 2 + WIDE_TILE < 1 << 15);

/// An error where a picture of `size` cannot be drawn.
pub fn check_size(gpu: &Gpu, size: [u32; 2]) -> Result<(), FrameError> {
    let limits = gpu.limits();
    let too_large = |limit| FrameError::Size { width: size[0], height: size[1], limit };
    let most = u64::from(GROUP[0]) * u64::from(limits.workgroups[0]);
    if size.iter().any(|&pixels| pixels > MOST_SIDE) {
        return Err(too_large(format!("{MOST_SIDE} pixels a side")));
    }
    if u64::from(size[0]) > most {
        return Err(too_large(format!("{most} pixels across")));
    }
    if u64::from(size[0]) * u64::from(size[1]) > MOST_PIXELS {
        return Err(too_large(format!("{MOST_PIXELS} pixels in all")));
    }
    Ok(())
}

/// Rows of one band of a picture of `size`.
fn band_rows(size: [u32; 2]) -> u32 {
    let rows = (SUBMIT_RAYS / u64::from(size[0])).max(1) as u32;
    rows.next_multiple_of(GROUP[1]).min(size[1])
}

/// Part of a picture that one submit works on.
#[derive(Clone, Copy)]
pub(super) struct Band {
    pub first_row: u32,
    pub rows: u32,
    pub sample: u32,
    pub samples: u32,
    /// What it draws is copied back.
    pub read: bool,
    /// Bytes for the screen, where the picture is exact, instead of sums and records.
    pub screen: bool,
    /// Sums and records of the whole picture are kept, not of the band alone.
    pub whole: bool,
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
        let [wide_beams, beams, trace, shade] =
            passes(access, options).map(|recipe| recipe.make(scene.gpu()));
        Ok(Renderer {
            wide_beams: wide_beams?,
            beams: beams?,
            trace: trace?,
            plain: None,
            shade: shade?,
            exact: HashMap::new(),
            access,
            options,
            repeats: Repeats::ONCE,
            log: None,
            in_flight: Vec::new(),
            target: None,
            beamed: None,
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
            let target = self.target.as_ref().expect("submit made it");
            let (from, pixels) = (first_row as usize * width as usize, rows as usize * width as usize);
            hits.resize(pixels, Hit::zeroed());
            let colors = bytemuck::cast_slice_mut(&mut image.color[from..from + pixels]);
            let [hits_back, colors_back] = target.back.as_ref().expect("the last sample was copied back");
            scene.order.read(point, hits_back, 0, bytemuck::cast_slice_mut(&mut hits))?;
            scene.order.read(point, colors_back, 0, colors)?;
            self.finish(&rays, &hits, from, &mut image);
        }
        Ok(image)
    }

    /// Submits one sample of every pixel and waits for nothing but the frame before the last; nothing is copied
    /// back. A picture of more pixels than one submit may trace (2²¹) goes in bands, each a submit over the one before.
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
    pub fn repeat(&mut self, repeats: Repeats) {
        self.repeats = repeats;
    }

    /// What the threads of the logged pass do for `view`, in bands from the top down: `each` is given how many threads
    /// there are across, and of each thread, row by row, [`LOG_WORDS`] words. See `shaders/log.glsl`.
    ///
    /// # Panics
    /// Without [`PassOptions::logged`], or where the pool is not reached by address.
    pub fn log(
        &mut self,
        scene: &mut Scene,
        view: &View,
        mut each: impl FnMut(usize, &[u32]),
    ) -> Result<(), FrameError> {
        let logged = self.options.logged.expect("a logged pass");
        assert_eq!(self.access, Access::Address, "lines are told by their addresses");
        check_size(scene.gpu(), view.size)?;
        let rays = Rays::of(view, &self.grid, self.anchor)?;
        let table = self.table(scene);
        let [width, height] = view.size;
        let side = match logged {
            Logged::WideBeams => WIDE_TILE,
            Logged::Beams => TILE,
            Logged::Trace => 1,
        };
        let threads = |rows: u32| u64::from(width.div_ceil(side)) * u64::from(rows.div_ceil(side));
        let thread_bytes = 4 * LOG_WORDS as u64;
        // Whole wide tiles, of which beams are made.
        let most = (LOG_BYTES / (threads(WIDE_TILE) * thread_bytes)).max(1) as u32 * WIDE_TILE;
        let rows = most.min(band_rows(view.size)).min(height);
        let make = |name, kind| Buffer::new(scene.gpu(), name, kind, threads(rows) * thread_bytes);
        self.log = Some([make("log", MemoryKind::Device)?, make("log read back", MemoryKind::Readback)?]);
        let mut words = vec![0u32; (threads(rows) as usize) * LOG_WORDS];
        for first_row in (0..height).step_by(rows as usize) {
            let rows = rows.min(height - first_row);
            let band =
                Band { first_row, rows, sample: 0, samples: 1, read: false, screen: false, whole: false };
            carry(scene, view)?;
            let (mut commands, slot) = scene.order.begin_frame("log")?;
            self.record(scene, (&mut commands, slot), view, &table, &rays, band, None)?;
            let [log, back] = self.log.as_ref().expect("made above");
            let size = threads(rows) * thread_bytes;
            scene.order.readback(&mut commands, &[(log, back, BufferCopy { from: 0, to: 0, size })]);
            let point = scene.order.submit(commands)?;
            scene.drawn(point);
            let words = &mut words[..size as usize / 4];
            scene.order.read(point, back, 0, bytemuck::cast_slice_mut(words))?;
            each(width.div_ceil(side) as usize, words);
        }
        self.log = None;
        Ok(())
    }

    /// The program for exact pictures that need so much.
    fn exact(&mut self, gpu: &Gpu, exact: Exact) -> Result<ComputePipeline, GpuError> {
        if let Some(program) = self.exact.get(&exact) {
            return Ok(program.clone());
        }
        let program = exact.recipe(self.access, self.options).make(gpu)?;
        self.exact.insert(exact, program.clone());
        Ok(program)
    }

    fn plain(&mut self, gpu: &Gpu) -> Result<ComputePipeline, GpuError> {
        if self.plain.is_none() {
            self.plain = Some(plain(self.access, self.options).make(gpu)?);
        }
        Ok(self.plain.clone().expect("just made"))
    }

    /// Errors: `view` takes in too much to be drawn.
    #[cfg(feature = "view")]
    pub fn check(&self, view: &View) -> Result<(), CameraError> {
        self.rays(view).map(drop)
    }

    /// The rays of `view`. Errors: it takes in too much to be drawn.
    pub(super) fn rays(&self, view: &View) -> Result<Rays, CameraError> {
        Rays::of(view, &self.grid, self.anchor)
    }

    /// All that a frame may see now.
    pub fn table(&self, scene: &Scene) -> Arc<Table> {
        Arc::new(Table::build(&scene.entries(), self.anchor))
    }

    /// Places and the sections that they are to show, as far as those are live: see [`Scene::entries_of`].
    pub fn table_of(&self, scene: &Scene, shown: &[Shown]) -> Arc<Table> {
        Arc::new(Table::build(&scene.entries_of(shown.iter().copied()), self.anchor))
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

    /// Sums and hit records of the picture that was recorded last, 16 bytes a pixel each.
    #[cfg(feature = "view")]
    pub(super) fn sums_and_hits(&self) -> Option<[&Buffer; 2]> {
        self.target.as_ref().map(|target| [&target.colors, &target.hits])
    }

    /// Where the ray of pixel (px, py) has hit, as shown, and U there.
    #[cfg(feature = "view")]
    pub(super) fn place_of(&self, rays: &Rays, hit: &Hit, pixel: [f64; 2]) -> (DVec3, f64) {
        let [distance, height] = distance_and_height(rays, hit, pixel, &self.grid, self.anchor);
        let [px, py] = pixel;
        let along = distance / rays.shown.length(px, py);
        let from_plane = along - rays.shown.advanced();
        (rays.shown.origin(px, py) + rays.shown.direction(px, py) * from_plane, height)
    }

    fn prepare(&mut self, scene: &Scene, slot: usize, size: [u32; 2], band: Band) -> Result<(), FrameError> {
        let gpu = scene.gpu();
        let rows = if band.whole { size[1] } else { band_rows(size) };
        let bytes = u64::from(size[0]) * u64::from(rows) * BYTES_PER_PIXEL;
        let tile_bytes =
            |side: u32| u64::from(size[0].div_ceil(side)) * u64::from(rows.div_ceil(side)) * BYTES_PER_BEAM;
        let fits = |t: &Target| {
            t.hits.size() >= bytes
                && t.beams.size() >= tile_bytes(TILE)
                && t.wide_beams.size() >= tile_bytes(WIDE_TILE)
        };
        // A window's picture is now coarse, now fine: what is large enough is kept.
        let kept = self.target.as_ref().is_some_and(|t| if band.whole { fits(t) } else { t.size == size });
        if !kept {
            (self.target, self.beamed) = (None, None);
            let device = |name, bytes| Buffer::new(gpu, name, MemoryKind::Device, bytes);
            self.target = Some(Target {
                size,
                hits: device("hits", bytes)?,
                colors: device("colors", bytes)?,
                beams: device("beams", tile_bytes(TILE))?,
                wide_beams: device("wide beams", tile_bytes(WIDE_TILE))?,
                back: None,
            });
        }
        let target = self.target.as_mut().expect("just made");
        if band.read && target.back.as_ref().is_none_or(|[hits, _]| hits.size() < bytes) {
            let back = |name| Buffer::new(gpu, name, MemoryKind::Readback, bytes);
            target.back = Some([back("hits read back")?, back("colors read back")?]);
        }
        self.in_flight.resize_with(self.in_flight.len().max(slot + 1), || None);
        Ok(())
    }

    fn submit(
        &mut self,
        scene: &mut Scene,
        view: &View,
        table: &Arc<Table>,
        rays: &Rays,
        band: Band,
        clock: Option<&mut Timestamps>,
    ) -> Result<SyncPoint, FrameError> {
        carry(scene, view)?;
        let (mut commands, slot) = scene.order.begin_frame("frame")?;
        self.record(scene, (&mut commands, slot), view, table, rays, band, clock)?;
        if band.read {
            let target = self.target.as_ref().expect("recorded");
            let [hits_back, colors_back] = target.back.as_ref().expect("made to be read");
            let pixels = u64::from(view.size[0]) * u64::from(band.rows);
            let all = BufferCopy { from: 0, to: 0, size: pixels * BYTES_PER_PIXEL };
            let copies = [(&target.hits, hits_back, all), (&target.colors, colors_back, all)];
            scene.order.readback(&mut commands, &copies);
        }
        let point = scene.order.submit(commands)?;
        scene.drawn(point);
        Ok(point)
    }

    /// Records the passes of a band in frame `slot`, for which the scene carries what `view` shows (see [`carry`]).
    pub(super) fn record(
        &mut self,
        scene: &mut Scene,
        (commands, slot): (&mut Commands, usize),
        view: &View,
        table: &Arc<Table>,
        rays: &Rays,
        band: Band,
        mut clock: Option<&mut Timestamps>,
    ) -> Result<(), FrameError> {
        self.prepare(scene, slot, view.size, band)?;
        let table_bytes: &[u8] = bytemuck::cast_slice(&table.slots);
        let gpu = scene.gpu().clone();
        let kept = self.in_flight[slot].take().filter(|f| f.table.size() >= table_bytes.len() as u64);
        let mut buffers = match kept {
            Some(buffers) => buffers,
            None => {
                let make = |name: &str, size| Buffer::new(&gpu, name, MemoryKind::Upload, size);
                InFlight {
                    frame: make("frame constants", size_of::<FrameConstants>() as u64)?,
                    table: make("section table", LEAST_TABLE_BYTES.max(table_bytes.len() as u64))?,
                    written: Weak::new(),
                    ramp: make("colour ramp", 256 * 16)?,
                    bindings: BindingCache::default(),
                }
            }
        };
        let target = self.target.as_ref().expect("prepared");
        let constants = FrameConstants {
            table_mask: table.slots.len() as u32 - 1,
            top_level: table.top_level as i32,
            section_level: table.section_level as i32,
            low: std::array::from_fn(|a| {
                view.window.map_or(table.low[a], |[low, _]| low[a].max(table.low[a]))
            }),
            high: std::array::from_fn(|a| {
                view.window.map_or(table.high[a], |[_, high]| high[a].min(table.high[a]))
            }),
            ..self.constants(view, rays, &buffers, target, band)
        };
        // What is pointed to weakly keeps its place in memory.
        if !std::ptr::eq(buffers.written.as_ptr(), Arc::as_ptr(table)) {
            buffers.table.write(0, table_bytes);
            buffers.written = Arc::downgrade(table);
        }
        buffers.ramp.write(0, bytemuck::cast_slice(view.colors.table.as_slice()));
        buffers.frame.write(0, bytemuck::bytes_of(&constants));

        let groups = |[x, y]: [u32; 2], side: u32| {
            [view.size[0].div_ceil(side).div_ceil(x), band.rows.div_ceil(side).div_ceil(y), 1]
        };
        let (tiles, pixels) = (|side| groups(self.options.beam_group, side), groups(self.options.group, 1));
        let mut passes = vec![];
        // A beam holds for every sample of its pixels.
        let is_next_sample =
            band.sample > 0 && self.beamed == Some((band.first_row, band.rows, band.sample - 1));
        self.beamed = Some((band.first_row, band.rows, band.sample));
        if view.traversal == Traversal::Fast && self.options.beams && !is_next_sample {
            passes.push(("wide beams", self.wide_beams.clone(), tiles(WIDE_TILE)));
            passes.push(("beams", self.beams.clone(), tiles(TILE)));
        }
        match (view.traversal, view.shade) {
            (Traversal::Fast, Shade::None) => {
                let exact = Exact { ramped: view.colors.mode != ColorMode::Rgb, screen: band.screen };
                passes.push(("trace", self.exact(&gpu, exact)?, pixels));
            }
            (traversal, _) => {
                let trace = if traversal == Traversal::Fast { self.trace.clone() } else { self.plain(&gpu)? };
                passes.push(("trace", trace, pixels));
                passes.push(("shade", self.shade.clone(), pixels));
            }
        }
        if let Some(logged) = self.options.logged {
            passes.truncate(match logged {
                Logged::WideBeams => 1,
                Logged::Beams => 2,
                // Nor is the log coloured.
                Logged::Trace => passes.len() - passes.iter().filter(|pass| pass.0 == "shade").count(),
            });
            commands.keep(self.log.as_ref().expect("Renderer::log made it")[0].clone());
        }
        let target = self.target.as_ref().expect("prepared");
        for buffer in [
            &buffers.frame,
            &buffers.table,
            &buffers.ramp,
            &target.hits,
            &target.colors,
            &target.beams,
            &target.wide_beams,
        ] {
            commands.keep(buffer.clone());
        }
        scene.pool().buffers().for_each(|b| commands.keep(b.clone()));
        let pool = scene.pool().derived_page().cloned();
        buffers.bindings.begin();
        let mut bindings = |program: &ComputePipeline| -> Result<Binding, GpuError> {
            let cache = &mut buffers.bindings;
            // An empty scene has no page; the table is never followed into it.
            let pool = pool.as_ref().unwrap_or(&buffers.table);
            match self.access {
                Access::Address => cache.get(program, &[&buffers.frame]),
                Access::Texels => cache.get(program, &[&buffers.frame, pool, &buffers.table, &target.beams]),
                Access::StorageBuffer => {
                    let all = [
                        pool,
                        &buffers.table,
                        &buffers.frame,
                        &target.hits,
                        &target.colors,
                        &buffers.ramp,
                        &target.beams,
                        &target.wide_beams,
                    ];
                    cache.get(program, &all)
                }
            }
        };
        let push = Push::new(&constants, [band.sample, band.samples], [band.first_row, band.rows]);
        let passes = passes
            .into_iter()
            .map(|(name, program, groups)| Ok((name, bindings(&program)?, program, groups)))
            .collect::<Result<Vec<_>, GpuError>>()?;
        if let Some(clock) = clock.as_mut() {
            clock.begin(commands);
        }
        let Repeats { before, timed } = self.repeats;
        for run in 0..before + timed {
            for (pass, (name, binding, program, groups)) in passes.iter().enumerate() {
                if run > 0 || pass > 0 {
                    scene.order.next_pass(commands);
                }
                commands.bind(program);
                commands.push(bytemuck::bytes_of(&push));
                commands.bind_buffers(binding);
                commands.dispatch(*groups);
                if let Some(clock) = clock.as_mut().filter(|_| run >= before) {
                    clock.end(commands, name);
                }
            }
            if let Some(clock) = clock.as_mut().filter(|_| run + 1 == before) {
                clock.end(commands, "before");
            }
        }
        self.in_flight[slot] = Some(buffers);
        Ok(())
    }

    /// All but what is said of the table.
    fn constants(
        &self,
        view: &View,
        rays: &Rays,
        buffers: &InFlight,
        target: &Target,
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
        FrameConstants {
            table: place(&buffers.table),
            hits: from(&target.hits),
            colors: self.log.as_ref().map_or_else(|| from(&target.colors), |[log, _]| place(log)),
            ramp: place(&buffers.ramp),
            beams: place(&target.beams),
            wide_beams: place(&target.wide_beams),
            ..FrameConstants::new(view, rays, &self.grid, self.anchor)
        }
    }

    /// Channels of the picture's pixels from `from` on: distances and heights in f64 from what the device found.
    fn finish(&self, rays: &Rays, hits: &[Hit], from: usize, image: &mut Image) {
        let width = image.width;
        for (at, hit) in (from..).zip(hits) {
            image.steps += u64::from(hit.steps);
            let class = hit.bits & 0x1FF;
            image.class[at] = class;
            if class == 256 {
                continue;
            }
            let pixel = [f64::from(at as u32 % width), f64::from(at as u32 / width)];
            let [distance, height] = distance_and_height(rays, hit, pixel, &self.grid, self.anchor);
            image.distance[at] = distance as f32;
            image.origin[at] = hit.bits >> 9 & 7;
            image.hit_height[at] = height as f32;
        }
    }
}

/// Where in a pixel its sample lies, sixteenths from the top left corner. One: the centre; more: a lattice
/// that puts each into a row and a column of its own.
pub(super) fn sample_at(sample: u32, samples: u32) -> [i32; 2] {
    if samples == 1 {
        return [8, 8];
    }
    // The R2 sequence: low discrepancy for any count.
    let at = |step: f64| ((0.5 + f64::from(sample) * step).fract() * 16.0) as i32;
    match (samples, sample) {
        (4, k) => [[6, 2], [14, 6], [2, 10], [10, 14]][k as usize],
        _ => [at(0.754_877_666_246_693), at(0.569_840_290_998_053)],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::layout::{assert_in, members};
    use crate::resident::readers::{readers_of_tables, readers_of_texels};

    #[test]
    fn shaders_see_the_structs_as_they_are_written() {
        let readers = readers_of_tables();
        let constants = members!(FrameConstants {
            table,
            hits,
            colors,
            ramp,
            beams,
            wide_beams,
            table_mask,
            top_level,
            section_level,
            low,
            high,
            width,
            height,
            origin_int,
            origin_fraction,
            right_int,
            right_fraction,
            down_int,
            down_fraction,
            depth,
            forward,
            right,
            down,
            to_local,
            origin_step,
            height_anchor,
            shade,
            color_source,
            range_low,
            range_scale,
            cell_steps,
            sun,
            background,
            floor,
        });
        let texels = readers_of_texels();
        assert_in(&readers, &constants);
        assert_in(&texels, &constants);
        let push = members!(Push {
            sample_at,
            sample_index,
            sample_weight,
            first_row,
            rows,
            origin_int,
            origin_fraction
        });
        assert_in(&readers, &push);
        assert_in(&texels, &push);
    }
}
