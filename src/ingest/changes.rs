//! What becomes of the files while they are seen, and which sections are made of other files or points since.
//!
//! What is read of all files changes in the same way, and then everything is made anew. A change is [queued](Changes::push) by whoever shows, hides, adds or replaces files, and [applied](Changes::apply) as soon
//! as the threads that read let go of what they share. From then on [`Changes::is_outdated`] tells what was made before.

use super::bins::Core;
use super::builds::Builds;
use super::feed::{Arrival, Feed, FeedGuard};
use super::input::OpenInput;
use crate::section::{PayloadKey, PayloadKind};
use crate::source::Reading;
use std::collections::{HashMap, HashSet, VecDeque};

/// What is to become of the files.
pub enum Change {
    /// Some are shown, or hidden.
    Show(Vec<usize>, bool),
    /// More; where all of them lie.
    Add(Vec<OpenInput>, Core),
    /// Others in the place of some; where all of them lie.
    Replace(Vec<(usize, OpenInput)>, Core),
    /// The points of some lie elsewhere than was believed.
    Corrected(Vec<usize>),
    /// Other points of all take part, or their records hold something else.
    Read(Reading),
}

/// See the module. It does not grow with the number of changes.
#[derive(Default)]
pub struct Changes {
    /// In the order in which they are to be applied.
    pending: VecDeque<Change>,
    /// The last change of each file: sections that it touches.
    of_file: HashMap<usize, u64>,
    /// The last one after which any section may be another.
    of_all: u64,
    /// The last of all.
    last: u64,
}

/// Sections among `known` that some files may have points in.
fn touched(builds: &Builds, sources: &[usize], known: &HashSet<PayloadKey>) -> Vec<PayloadKey> {
    let is_touched = |key: &&PayloadKey| sources.iter().any(|&source| builds.touches(source, key.section));
    let columns = known.iter().filter(|key| key.kind == PayloadKind::Columns);
    columns.filter(is_touched).copied().collect()
}

impl Changes {
    /// To be applied, after those before. What is to be read of all files takes the place of what was to be before.
    pub fn push(&mut self, change: Change) {
        if matches!(change, Change::Read(_)) {
            self.pending.retain(|pending| !matches!(pending, Change::Read(_)));
        }
        self.pending.push_back(change);
    }

    /// Whether some wait to be applied.
    pub fn is_pending(&self) -> bool {
        !self.pending.is_empty()
    }

    /// Applies all; gives the sections, among those of which something is known, that are made of other files by now.
    pub fn apply(&mut self, held: &mut FeedGuard, known: &HashSet<PayloadKey>) -> Vec<PayloadKey> {
        let mut all_touched = Vec::new();
        for change in std::mem::take(&mut self.pending) {
            let mut changed = |builds: &Builds, sources: &[usize]| {
                all_touched.extend(touched(builds, sources, known));
                self.add(builds.revision(), sources.iter().copied());
            };
            match change {
                Change::Show(sources, shown) => {
                    sources.iter().for_each(|&source| held.builds().set_visible(source, shown));
                    changed(held.builds(), &sources);
                }
                Change::Add(inputs, core) => {
                    held.set_core(core);
                    let sources: Vec<_> = inputs.into_iter().map(|input| held.builds().add(input)).collect();
                    changed(held.builds(), &sources);
                }
                Change::Replace(files, core) => {
                    held.set_core(core);
                    let sources: Vec<_> = files.iter().map(|(source, _)| *source).collect();
                    changed(held.builds(), &sources);
                    let builds = held.builds();
                    files.into_iter().for_each(|(source, input)| builds.replace(source, input));
                    changed(builds, &sources);
                    // Where the old ones lay is forgotten: whatever is under way is made again.
                    self.add_all(builds.revision());
                }
                Change::Corrected(sources) => changed(held.builds(), &sources),
                Change::Read(reading) => {
                    let builds = held.builds();
                    if **builds.reading() == reading {
                        continue;
                    }
                    builds.set_reading(reading);
                    all_touched.extend(known.iter().filter(|key| key.kind == PayloadKind::Columns));
                    self.add_all(builds.revision());
                }
            }
        }
        all_touched
    }

    fn add(&mut self, change: u64, sources: impl IntoIterator<Item = usize>) {
        self.last = self.last.max(change);
        self.of_file.extend(sources.into_iter().map(|source| (source, change)));
    }

    fn add_all(&mut self, change: u64) {
        (self.of_all, self.last) = (change, self.last.max(change));
        self.of_file.retain(|_, since| *since > change);
    }

    /// Whether an arrival is not of the files as they are; `None`: a thread is in the way of finding out.
    pub fn is_outdated(&self, arrival: &Arrival, feed: &Feed) -> Option<bool> {
        if arrival.revision >= self.last {
            return Some(false);
        }
        if arrival.key.kind == PayloadKind::Sample || arrival.revision < self.of_all {
            return Some(true);
        }
        let mut held = feed.try_lock()?;
        let builds = held.builds();
        let mut since = self.of_file.iter().filter(|(_, since)| **since > arrival.revision);
        Some(since.any(|(&source, _)| builds.touches(source, arrival.key.section)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_do_not_grow_with_their_number() {
        let mut changes = Changes::default();
        for change in 1..1000 {
            changes.add(change, [change as usize % 7]);
        }
        assert_eq!((changes.of_file.len(), changes.last, changes.of_all), (7, 999, 0));
        // The last of each file counts.
        assert!((993..1000).all(|change| changes.of_file[&(change as usize % 7)] == change));
        changes.add_all(1000);
        assert_eq!((changes.of_file.len(), changes.last, changes.of_all), (0, 1000, 1000));
        changes.add(1001, [3]);
        assert_eq!((changes.of_file[&3], changes.last), (1001, 1001));
    }
}
