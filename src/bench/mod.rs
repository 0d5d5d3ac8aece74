//! The benchmark: what is measured, how it is reported and drawn.

pub mod plot;
pub mod report;
