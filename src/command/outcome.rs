//! How a command ends, and which errors are the fault of its arguments.

use crate::load::LoadError;

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

/// A cell size that is too small, or in a unit that cannot be converted, is a wrong argument.
pub(super) fn usage_of_load(error: LoadError) -> anyhow::Error {
    match error {
        LoadError::TooFine { .. } | LoadError::NoUnit(_) => UsageError(error.to_string()).into(),
        error => error.into(),
    }
}
