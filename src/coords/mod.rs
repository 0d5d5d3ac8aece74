//! Units as types: heights on one lattice, cells, sections, boxes.

mod bounds;
mod grid;
mod heights;
mod hull;
mod low_surface;
mod ordinary;
mod outline;
mod section;
mod stacking;

pub use bounds::{Bounds, on_lattice};
pub use grid::{CELL_LIMIT, Extent, Grid};
pub use heights::{HEIGHT_REACH, HEIGHT_STEP, Height, height_step, power_of_two_at_most};
pub use hull::Hull;
pub use low_surface::{LOW_SIDE, LowSurface, Slab};
pub use ordinary::Ordinary;
pub use outline::Outline;
pub use section::{CellIndex, SECTION_COLUMNS, SECTION_LOG2, SECTION_SIDE, SectionKey};
pub use stacking::Stacking;
