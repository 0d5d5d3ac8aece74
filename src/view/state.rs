//! What is going on, in words: in the status bar, and over an image on which nothing is seen.

use super::data::DataStatus;
use super::layers::FLAGS;
use super::numbers::short;
use super::selection_part::rereading;

/// What is going on with the data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum State {
    /// Nothing can be shown; [`DataStatus::failed`] says why.
    Failed,
    /// Headers and the opening sample are read.
    Opening,
    /// There is no file.
    NoFiles,
    /// Every file is hidden, or gone.
    NoFileShown,
    /// Points are read; the share of those that are needed now.
    Reading(f64),
    /// Everything needed is read, but not all of it is there to be drawn.
    Loading,
    /// Other classes are shown, section by section.
    Switching,
    /// All is there, and none of the points takes part; [`DataStatus::unselected`] says why.
    NoneSelected,
    /// All is there, and every point is hidden; [`DataStatus::hidden`] says why.
    AllHidden,
    /// All is there, and none of it is in sight.
    OutOfSight,
    /// All is there.
    Shown,
}

impl State {
    /// `is_empty`: nothing is seen of the data.
    pub fn of(status: &DataStatus, is_empty: bool) -> State {
        let [shown, files] = status.files;
        match () {
            _ if status.failed.is_some() => State::Failed,
            _ if files == 0 && status.is_opening => State::Opening,
            _ if files == 0 => State::NoFiles,
            _ if shown == 0 => State::NoFileShown,
            _ if !status.is_complete && status.share_read < 1.0 => State::Reading(status.share_read),
            _ if !status.is_complete && status.is_switching => State::Switching,
            _ if !status.is_complete => State::Loading,
            _ if status.unselected.is_some() => State::NoneSelected,
            _ if status.hidden.is_some() => State::AllHidden,
            _ if is_empty => State::OutOfSight,
            _ => State::Shown,
        }
    }

    /// For the status bar; `refining`: samples that the image has, where it is to have more, and those.
    pub fn in_short(self, status: &DataStatus, refining: Option<[u32; 2]>) -> String {
        match self {
            State::Failed => "failed".to_owned(),
            State::Opening => "opening".to_owned(),
            State::NoFiles => "no files".to_owned(),
            State::NoFileShown => "no file is shown".to_owned(),
            // Not 100 % before it is.
            State::Reading(_) | State::Loading if status.rereading.is_some() => {
                rereading(status).unwrap_or_default()
            }
            State::Reading(share) => format!("reading {:.0} %", (share * 100.0).floor()),
            State::Loading => "loading".to_owned(),
            State::Switching => "changing classes".to_owned(),
            State::NoneSelected => "no point is selected".to_owned(),
            State::AllHidden => "every point is hidden".to_owned(),
            State::OutOfSight => "nothing in sight".to_owned(),
            State::Shown => match refining {
                Some([samples, all]) => format!("refining {samples} of {all}"),
                None => taking_part(status),
            },
        }
    }

    /// For the middle of an image on which nothing is seen, and how much of it is done where that can be told; why
    /// something failed is told elsewhere.
    pub fn over_image(self, status: &DataStatus) -> Option<(String, Option<f64>)> {
        let words = |words: &str| Some((words.to_owned(), None));
        match self {
            State::Failed | State::Shown | State::Switching => None,
            State::NoneSelected => Some((capital(status.unselected.as_deref().unwrap_or_default()), None)),
            State::AllHidden => {
                let hidden = status.kinds.flags().and(status.hidden_flags);
                let boxes = FLAGS.iter().filter(|(flag, _)| hidden.has_any(*flag));
                let boxes: Vec<_> = boxes.map(|(_, name)| format!("“{name}”")).collect();
                match boxes.is_empty() {
                    true => words("Every point is hidden: check some of the classes"),
                    false => words(&format!("Every point is hidden: check classes, or {}", boxes.join(", "))),
                }
            }
            State::Opening => words("Opening …"),
            State::NoFiles => words("Drop files or folders here"),
            State::NoFileShown => words("No file is shown: check one in the list of files"),
            State::Reading(share) if status.rereading.is_some() => {
                Some((capital(&rereading(status).unwrap_or_default()), Some(share)))
            }
            State::Reading(share) => Some((format!("Reading: {}", read(status)), Some(share))),
            State::Loading => words("Loading …"),
            State::OutOfSight => words("Nothing of the data is in sight: F frames it"),
        }
    }
}

/// With a capital at its start.
fn capital(words: &str) -> String {
    let mut letters = words.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

/// Points that take part, where not all do; else those that were read.
fn taking_part(status: &DataStatus) -> String {
    if !status.is_selection {
        return read(status);
    }
    let about = if status.kinds.is_exact { "" } else { "~" };
    format!("{about}{} of {} points selected", short(status.kinds.all()), short(status.points))
}

/// Points that were read, and of how many.
pub fn read(status: &DataStatus) -> String {
    match status.points_read < status.points {
        true => format!("{} of {} points", short(status.points_read), short(status.points)),
        false => format!("{} points", short(status.points)),
    }
}

/// Points of each class, for the log of events.
pub fn logged_counts(status: &DataStatus) -> String {
    let counts = &status.kinds;
    let classes = (0..=255u8).map(|class| (class, counts.of_class(class)));
    let listed: Vec<_> = classes.filter(|(_, n)| *n > 0).map(|(class, n)| format!("{class}:{n}")).collect();
    format!("{} {}", if counts.is_exact { "exact" } else { "estimated" }, listed.join(" "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attribute::{Flags, KindCounts};

    /// Files (shown, all), opening, complete, share read, failed, hidden.
    fn status(files: [u64; 2], is_opening: bool, is_complete: bool, share_read: f64) -> DataStatus {
        let points = files[0] * 978_000;
        let points_read = (share_read * points as f64) as u64;
        DataStatus {
            points,
            points_read,
            share_read,
            files,
            is_opening,
            is_complete,
            ..DataStatus::default()
        }
    }

    #[test]
    fn what_is_said_is_what_is_going_on() {
        let why = || Some("why".to_owned());
        let all = status([1, 1], false, true, 1.0);
        let over = |status: &DataStatus| State::of(status, true).over_image(status).map(|(words, _)| words);
        let short = |status: &DataStatus, is_empty: bool| State::of(status, is_empty).in_short(status, None);
        let (withheld, overlap) = (Flags::WITHHELD, Flags::OVERLAP);
        let flagged = KindCounts { of: [((2, withheld), 5), ((2, overlap), 5)].into(), is_exact: true };
        let hiding =
            |hidden_flags| DataStatus { hidden: why(), kinds: flagged.clone(), hidden_flags, ..all.clone() };
        let cases = [
            (status([0, 0], true, false, 0.0), "opening", Some("Opening …")),
            (status([0, 0], false, true, 0.0), "no files", Some("Drop files or folders here")),
            (status([1, 1], false, false, 0.0), "reading 0 %", Some("Reading: 0 of 978 k points")),
            (status([1, 1], false, false, 0.999), "reading 99 %", Some("Reading: 977 k of 978 k points")),
            (status([1, 1], false, false, 1.0), "loading", Some("Loading …")),
            (
                status([0, 3], false, true, 1.0),
                "no file is shown",
                Some("No file is shown: check one in the list of files"),
            ),
            (
                status([0, 3], false, false, 0.5),
                "no file is shown",
                Some("No file is shown: check one in the list of files"),
            ),
            (
                DataStatus { is_switching: true, ..status([1, 1], false, false, 1.0) },
                "changing classes",
                None,
            ),
            // More files are opened beside those that are there.
            (status([1, 1], true, false, 1.0), "loading", Some("Loading …")),
            (
                DataStatus { hidden: why(), ..all.clone() },
                "every point is hidden",
                Some("Every point is hidden: check some of the classes"),
            ),
            (
                hiding(withheld),
                "every point is hidden",
                Some("Every point is hidden: check classes, or “Withheld points”"),
            ),
            (
                hiding(Flags::ALL),
                "every point is hidden",
                Some("Every point is hidden: check classes, or “Withheld points”, “Overlap points”"),
            ),
            (
                DataStatus { unselected: why(), is_selection: true, ..all.clone() },
                "no point is selected",
                Some("Why"),
            ),
            (DataStatus { failed: why(), ..all.clone() }, "failed", None),
            (DataStatus { failed: why(), hidden: why(), ..status([0, 0], false, true, 0.0) }, "failed", None),
            (all.clone(), "nothing in sight", Some("Nothing of the data is in sight: F frames it")),
        ];
        for (status, bar, image) in &cases {
            assert_eq!((&*short(status, true), over(status).as_deref()), (*bar, *image), "{status:?}");
        }
        // With an image.
        assert_eq!(short(&all, false), "978 k points");
        assert_eq!(short(&DataStatus { points_read: 1000, ..all.clone() }, false), "1000 of 978 k points");
        let kinds = |is_exact| KindCounts {
            of: [((2, Flags::NONE), 1200), ((5, Flags::WITHHELD), 34)].into(),
            is_exact,
        };
        let selected = |is_exact| DataStatus { is_selection: true, kinds: kinds(is_exact), ..all.clone() };
        assert_eq!(short(&selected(true), false), "1234 of 978 k points selected");
        assert_eq!(short(&selected(false), false), "~1234 of 978 k points selected");
        assert_eq!(State::of(&all, false).in_short(&all, Some([3, 16])), "refining 3 of 16");
        assert_eq!(State::of(&all, false).over_image(&all), None);
        // Whatever else is so: reading is told of nothing that is read.
        for bits in 0..64u32 {
            let is = |bit: u32| bits >> bit & 1 != 0;
            let status = DataStatus {
                failed: is(3).then(|| "why".to_owned()),
                hidden: is(4).then(|| "why".to_owned()),
                ..status([u64::from(is(0)), 1], is(1), is(2), 1.0)
            };
            let said = short(&status, is(5)) + &over(&status).unwrap_or_default();
            assert!(!said.to_lowercase().contains("reading"), "{said}: {status:?}");
            assert!(is(2) || is(3) || !said.contains("sight"), "{said}: {status:?}");
        }
    }
}
