//! Sections: 256 × 256 columns, as points make them and, word for word, as the device has them.

mod columns;
mod layout;
mod payload;
pub mod slot;

pub use columns::Columns;
pub use layout::{Derived, HeightCode, Layout, SECTION_BLOCKS, column_at, column_index};
pub use payload::{HighestOf, Payload, PayloadKey, PayloadKind, device_bytes};
