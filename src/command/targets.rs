//! Where a command may write.

use super::outcome::UsageError;
use crate::output::{Protected, Target};
use std::path::PathBuf;

/// Finds out before the work that a target, named by its option, may not be written.
pub(super) fn check_targets<'t>(
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
