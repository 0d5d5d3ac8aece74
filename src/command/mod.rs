//! The commands: one file each, arguments and `run`.

pub mod bench;
pub mod info;
mod layers;
mod outcome;
pub mod placement;
pub mod render;
pub mod saved;
pub mod synth;
mod targets;
mod values;
#[cfg(feature = "view")]
pub mod view;

pub use outcome::{Outcome, UsageError};
