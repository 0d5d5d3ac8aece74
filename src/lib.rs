//! Opens raw airborne LiDAR (LAS, LAZ, COPC) and ray-traces it on any Vulkan GPU.
//!
//! Data moves one way: `source` (files, chunks) → `ingest` (points to sections) → `resident` (sections on the device) →
//! `render` (traversal, image) → `view` (window). Imports run downward only.

pub mod attribute;
pub mod bench;
pub mod cli;
pub mod command;
pub mod coords;
pub mod gpu;
pub mod ground;
pub mod ingest;
pub mod limits;
pub mod load;
pub mod output;
pub mod problems;
pub mod render;
pub mod resident;
pub mod sample;
pub mod section;
pub mod shared;
pub mod source;
pub mod stop;
pub mod synth;
pub mod text;
#[cfg(feature = "view")]
pub mod view;
