//! Sections: 256 × 256 columns, as points make them and, word for word, as the device has them.

mod blocks;
mod columns;
mod ground;
mod layout;
mod measure;
mod payload;
pub mod slot;
mod stacks;
mod surface;

pub use columns::Columns;
pub use layout::{Derived, Floats, HeightCode, Layout, SECTION_BLOCKS, column_at, column_index};
pub use measure::{Measure, SQUARE};
pub use payload::{HighestOf, Payload, PayloadKey, PayloadKind, device_bytes};
pub use surface::Surface;
