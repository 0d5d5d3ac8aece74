//! The commands: one file each, arguments and `run`.

pub mod bench;
pub mod info;
pub mod placement;
pub mod render;
pub mod synth;
#[cfg(feature = "view")]
pub mod view;

use crate::output::{Protected, Target};
use std::path::PathBuf;

/// Arguments that are wrong for themselves or together: exit code 2.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct UsageError(pub String);

/// Finds out before the work that a target, named by its option, may not be written.
pub(crate) fn check_targets<'t>(
    protected: &Protected,
    files: impl IntoIterator<Item = (&'static str, PathBuf)>,
    texts: impl IntoIterator<Item = (&'static str, &'t Target)>,
) -> Result<(), UsageError> {
    let (mut few, mut prints) = (Vec::new(), Vec::new());
    for (option, text) in texts {
        text.check_place().map_err(|error| UsageError(format!("{option} {error}")))?;
        match text {
            Target::File(path) => few.push((option, path.clone())),
            Target::Stdout => prints.push(option),
        }
    }
    if let [first, second, ..] = prints[..] {
        return Err(UsageError(format!("{second} -: {first} takes standard output")));
    }
    protected.check_all(files, &few).map_err(UsageError)
}

/// What a command that did its work tells the shell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// All of it.
    Done,
    /// Some input failed and `--strict` was given.
    Incomplete,
}
