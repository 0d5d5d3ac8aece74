//! What is asked of a frame: the view, and how its passes run.

use super::super::camera::Camera;
use crate::attribute::ColorTable;
use crate::coords::{Bounds, Slab};
use crate::gpu::DeviceKind;

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

/// An image to be made.
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
    /// What lit images end in below; `None`: columns are solid without end in them, too.
    pub slab: Option<Slab>,
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

/// Pixels a workgroup covers.
pub(super) const GROUP: [u32; 2] = [8, 8];

/// Passes of a frame.
pub const PASSES: u32 = 4;

/// How often the passes of a frame run, for measurements: a device's clock rises while it works.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PassRepeats {
    /// Runs before those that are timed; together they are a stage of the clock, `"before"`, if there are any.
    pub before: u32,
    /// Runs whose passes are stages of the clock, one run after the other.
    pub timed: u32,
}

impl PassRepeats {
    /// As frames run.
    pub const ONCE: PassRepeats = PassRepeats { before: 0, timed: 1 };

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

/// How the passes of an image are cut into groups and ordered; images do not depend on it. The default is what the
/// binary draws with, others are for benchmarks.
///
/// Widths are multiples of 8: with groups of 12 × 6, lavapipe (Mesa 22.3) drew other images by address, though not by
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
    /// Set: [`super::Renderer::log`] is what the renderer is for.
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
}
