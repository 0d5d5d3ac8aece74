//! The timing harness: the thesis' pipeline and ours on the same cells, the same camera paths, the same pixels.

pub mod thesis;
pub mod world;
