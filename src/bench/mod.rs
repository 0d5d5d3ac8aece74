//! The timing harness: the thesis' pipeline and ours on the same cells, the same camera paths, the same pixels;
//! reading, decoding and binning beside decoding alone; and frames while files stream in.

mod cache;
mod failure;
pub mod frames;
pub mod ground;
pub mod ingest;
pub mod load;
pub mod log;
mod memory;
#[cfg(feature = "embree")]
pub mod peer;
pub mod plot;
pub mod pool;
pub mod report;
pub mod steady;
pub mod stream;
pub mod thesis;
mod times;
pub mod towns;
pub mod world;

pub use failure::{Stopped, is_too_large};
pub use memory::free_bytes;
pub use times::FrameTimes;
