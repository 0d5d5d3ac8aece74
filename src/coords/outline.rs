//! What is framed of data, and what lit images end in below it.

use super::hull::Hull;
use super::low_surface::{LowSurface, Slab};
use std::sync::Arc;

/// Thickness of the slab below lit images, in lengths of what is framed,
const SLAB: f64 = 0.01;
/// but no more than so many finest cells: who looks at one place of many sees no cliff.
const SLAB_CELLS: f64 = 40.0;

/// What is framed of some points, and the ground below them, roughly.
#[derive(Clone, Debug)]
pub struct Outline {
    /// What is framed.
    pub hull: Hull,
    /// Where lit images end, but for a slab.
    pub low: Arc<LowSurface>,
    /// Thickness of that, but for a cell.
    thickness: f64,
}

impl Outline {
    /// `cell`: side of a finest one.
    pub fn new(hull: Hull, low: LowSurface, cell: f64) -> Outline {
        let length = hull.bounds().size().truncate().max_element();
        Outline { hull, low: Arc::new(low), thickness: (SLAB * length).min(SLAB_CELLS * cell) }
    }

    /// What lit images of cells of `cell` end in.
    pub fn slab(&self, cell: f64) -> Slab {
        Slab { low: Arc::clone(&self.low), thickness: self.thickness + cell }
    }

    /// With that of other points; slabs stay as thick as they are.
    pub fn joined(&self, other: &Outline) -> Outline {
        Outline {
            hull: Hull::union([&self.hull, &other.hull]).expect("two hulls"),
            low: Arc::new(self.low.joined(&other.low)),
            thickness: self.thickness,
        }
    }
}
