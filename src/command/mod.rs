//! The commands: one file each, arguments and `run`.

pub mod bench;
pub mod info;
pub mod placement;
pub mod render;
pub mod synth;
#[cfg(feature = "view")]
pub mod view;

/// Arguments that are wrong for themselves or together: exit code 2.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct UsageError(pub String);

/// What a command that did its work tells the shell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// All of it.
    Done,
    /// Some input failed and `--strict` was given.
    Incomplete,
}
