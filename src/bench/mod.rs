//! The benchmark: what is measured, how it is reported and drawn.

#[cfg(feature = "embree")]
pub mod peer;
pub mod plot;
pub mod report;
