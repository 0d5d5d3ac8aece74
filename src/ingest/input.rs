//! A file that is to be read, and what its numbers mean: from raw records to world coordinates and colours.

use super::meaning::Meaning;
use crate::coords::{Bounds, Hull};
use crate::sample::{RgbDepth, SampledKinds};
use crate::source::known::Known;
use crate::source::learned::Counts;
use crate::source::placement::Placement;
use crate::source::{LidarFile, PointBlock, Selection};
use glam::DVec3;

/// A file that is to be read, and what its numbers mean.
pub struct Input {
    /// Opened.
    pub file: LidarFile,
    /// File coordinates to world coordinates.
    pub placement: Placement,
    /// How to read its colours.
    pub rgb: RgbDepth,
}

impl Meaning for Input {
    #[inline]
    fn world(&self, block: &PointBlock, i: usize) -> DVec3 {
        let h = &self.file.header;
        // E = X · scale + offset (LAS 1.4 R15, 2.4), each step rounded as written.
        let e = f64::from(block.x[i]) * h.scale.x + h.offset.x;
        let n = f64::from(block.y[i]) * h.scale.y + h.offset.y;
        let u = f64::from(block.z[i]) * h.scale.z + h.offset.z;
        self.placement.place(e, n, u)
    }

    fn world_of_many(&self, block: &PointBlock, first: usize, [e, n, u]: [&mut [f64]; 3]) {
        let h = &self.file.header;
        let axes = [
            (&mut *e, &block.x, h.scale.x, h.offset.x),
            (&mut *n, &block.y, h.scale.y, h.offset.y),
            (&mut *u, &block.z, h.scale.z, h.offset.z),
        ];
        for (to, raw, scale, offset) in axes {
            to.iter_mut().zip(&raw[first..]).for_each(|(to, &raw)| *to = f64::from(raw) * scale + offset);
        }
        if !self.placement.is_identity() {
            self.placement.place_many(e, n, u);
        }
    }

    #[inline]
    fn rgb(&self, block: &PointBlock, i: usize) -> [u8; 3] {
        block.rgb.get(i).map_or([0; 3], |&rgb| self.rgb.to_8_bit(rgb))
    }
}

/// A file that is to be read, and where.
pub struct OpenInput {
    /// How to read it.
    pub input: Input,
    /// World box without stray points.
    pub bounds: Option<Bounds>,
    /// It does not lie so far from the others that these are framed without it.
    pub is_in_frame: bool,
    /// What is framed of it.
    pub hull: Option<Hull>,
    /// The same where others are shown than were asked for at first, if that is another.
    pub hull_of_all: Option<Hull>,
    /// World box that no point lies outside of, where that is known.
    pub reach: Option<Bounds>,
    /// Points lie in the nodes that a COPC hierarchy has them in.
    pub in_nodes: bool,
    /// What else is known of where its chunks lie.
    pub known: Known,
    /// The coordinate system that it names.
    pub system: Option<String>,
    /// What its points are, as far as that is known before it is read.
    pub kinds: SeenKinds,
}

/// What is known of the kinds of a file's points before it is read.
#[derive(Clone, Debug, Default)]
pub struct SeenKinds {
    /// By the opening sample.
    pub sampled: SampledKinds,
    /// By what counted all of it before; empty: nothing did.
    pub kept: Counts,
    /// The same of the points that a selection holds, as the opening sample has seen them.
    pub selected: Option<(Selection, SampledKinds)>,
}
