//! The commands: one file each, arguments and `run`.

pub mod info;
pub mod synth;
