//! `lasray bench`: the timing harness.

mod args;
mod frames;
mod harness;
#[cfg(feature = "embree")]
mod peer;
mod reading;
mod rows;
mod run;
mod scaling;
mod stream;

pub use args::Args;
pub use run::run;
