//! What is shown of the points, and why nothing is to be seen where every one is hidden.

use crate::attribute::{ClassMask, Flags, Kind, Kinds};
use crate::sample::Asked;
use std::collections::BTreeSet;

/// What is shown: part of the derived data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Visibility {
    /// Classes that are shown.
    pub classes: ClassMask,
    /// Points that have one of these flags are hidden.
    pub hidden_flags: Flags,
    /// Longest hole to bridge, cells (0 to 4).
    pub bridge: u32,
    /// Of points that are as high as a column's top but for an eighth of a finest cell's side, at most 0.1 units, it shows one
    /// whose class tells more.
    pub near_ties: bool,
}

impl Visibility {
    /// What of the points is asked for, of those that take part.
    pub fn asked(&self) -> Asked {
        Asked { classes: self.classes, hidden_flags: self.hidden_flags, ..Asked::default() }
    }

    /// Whether points of this kind are shown.
    pub fn shows(&self, (class, flags): Kind) -> bool {
        self.classes.shows(class) && !flags.has_any(self.hidden_flags)
    }
}

/// What columns show besides their class.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColumnData {
    /// RGB.
    Colors,
    /// Intensity and returns.
    Values,
}

/// Why points of these kinds, of which there is at least one, are all hidden, and what shows them; `None` if some are
/// shown.
pub fn why_hidden(kinds: &Kinds, visibility: &Visibility) -> Option<String> {
    if kinds.is_empty() || kinds.iter().any(|&kind| visibility.shows(kind)) {
        return None;
    }
    // Classes of the points that need these two, another list of classes and flags that are not hidden, and such flags.
    let needing = |other_class: bool, other_flags: bool| -> (BTreeSet<u8>, Flags) {
        let needed = |(class, flags): &Kind| {
            let hidden = flags.and(visibility.hidden_flags);
            let needs = [!visibility.classes.shows(*class), !hidden.is_empty()];
            (needs == [other_class, other_flags]).then_some((*class, hidden))
        };
        let (classes, flags): (_, Vec<_>) = kinds.iter().filter_map(needed).unzip();
        (classes, flags.into_iter().fold(Flags::NONE, Flags::with))
    };
    let ((_, flagged), (of_class, _), (of_both, both)) =
        (needing(false, true), needing(true, false), needing(true, true));
    if flagged.is_empty() && !of_class.is_empty() {
        let all = listed(&of_class.union(&of_both).copied().collect());
        let those = match both.is_empty() {
            true => "them".to_owned(),
            false => format!("those that are not {}", said(both)),
        };
        return Some(format!(
            "no point is of a class that is shown; there are {all} (--classes {all} shows {those})"
        ));
    }
    let mut reasons = Vec::new();
    if !flagged.is_empty() {
        reasons.push(format!("{} ({} shows them)", said(flagged), shown_by(flagged, None)));
    }
    if !of_class.is_empty() {
        let list = listed(&of_class);
        reasons.push(format!("of a class that is not shown (--classes {list} shows them)"));
    }
    if !both.is_empty() {
        let what = shown_by(both, Some(listed(&of_both)));
        reasons.push(format!("both {} and of such a class ({what} shows them)", said(both)));
    }
    Some(format!("every point is {}", reasons.join(", or ")))
}

/// What a point is that has any of these flags.
fn said(flags: Flags) -> String {
    let word = |(flag, name)| match flag {
        Flags::WITHHELD => "withheld".to_owned(),
        _ => format!("flagged {name}"),
    };
    flags.each().map(word).collect::<Vec<_>>().join(" or ")
}

/// The options that show points of these flags and classes.
fn shown_by(flags: Flags, classes: Option<String>) -> String {
    let others = flags.without(Flags::WITHHELD);
    let withheld = flags.has_any(Flags::WITHHELD).then(|| "--withheld".to_owned());
    let classes = classes.map(|list| format!("--classes {list}"));
    let without = (!others.is_empty()).then(|| format!("--hide-flags without {}", others.list()));
    let options: Vec<_> = [withheld, classes, without].into_iter().flatten().collect();
    options.join(" ")
}

/// As `--classes` takes them: 2,5-7.
fn listed(classes: &BTreeSet<u8>) -> String {
    let mut runs: Vec<[u8; 2]> = Vec::new();
    for &class in classes {
        match runs.last_mut() {
            Some([_, last]) if class - *last == 1 => *last = class,
            _ => runs.push([class; 2]),
        }
    }
    let run = |[first, last]: [u8; 2]| match last - first {
        0 => first.to_string(),
        1 => format!("{first},{last}"),
        _ => format!("{first}-{last}"),
    };
    runs.into_iter().map(run).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: Flags = Flags::NONE;
    const WITHHELD: Flags = Flags::WITHHELD;
    const OVERLAP: Flags = Flags::OVERLAP;

    fn why(kinds: &[Kind], classes: ClassMask, hidden_flags: Flags) -> Option<String> {
        let visibility = Visibility { classes, hidden_flags, bridge: 4, near_ties: false };
        why_hidden(&kinds.iter().copied().collect(), &visibility)
    }

    type Case<'a> = (&'a [Kind], ClassMask, Flags, &'a str);

    fn check(cases: &[Case]) {
        for (kinds, classes, hidden, words) in cases {
            assert_eq!(why(kinds, *classes, *hidden).as_deref(), Some(*words));
        }
    }

    #[test]
    fn the_reason_names_what_shows_the_points() {
        let usual = ClassMask::default();
        assert_eq!(why(&[], usual, WITHHELD), None);
        assert_eq!(why(&[(2, WITHHELD), (2, NONE)], usual, WITHHELD), None);
        assert_eq!(why(&[(2, WITHHELD), (7, NONE)], usual, NONE), None);
        assert_eq!(listed(&[0, 1, 2, 5, 7, 8, 254, 255].into()), "0-2,5,7,8,254,255");
        check(&[
            (
                &[(2, WITHHELD), (6, WITHHELD)],
                usual,
                WITHHELD,
                "every point is withheld (--withheld shows them)",
            ),
            (
                &[(7, NONE), (18, NONE)],
                usual,
                WITHHELD,
                "no point is of a class that is shown; there are 7,18 (--classes 7,18 shows them)",
            ),
            (
                &[(2, NONE), (6, WITHHELD)],
                ClassMask::only(&[9]),
                NONE,
                "no point is of a class that is shown; there are 2,6 (--classes 2,6 shows them)",
            ),
            (
                &[(2, WITHHELD), (7, NONE)],
                usual,
                WITHHELD,
                "every point is withheld (--withheld shows them), or of a class that is not shown (--classes 7 shows them)",
            ),
            (
                &[(7, WITHHELD)],
                usual,
                WITHHELD,
                "every point is both withheld and of such a class (--withheld --classes 7 shows them)",
            ),
            (
                &[(2, WITHHELD), (7, WITHHELD), (18, NONE)],
                usual,
                WITHHELD,
                "every point is withheld (--withheld shows them), or of a class that is not shown (--classes 18 shows them), \
                 or both withheld and of such a class (--withheld --classes 7 shows them)",
            ),
        ]);
    }

    #[test]
    fn the_reason_names_every_flag_that_hides_them() {
        let usual = ClassMask::default();
        let hidden = WITHHELD.with(OVERLAP);
        assert_eq!(why(&[(2, OVERLAP)], usual, WITHHELD), None);
        assert_eq!(why(&[(2, hidden), (2, Flags::KEY_POINT)], usual, hidden), None);
        check(&[
            (
                &[(2, OVERLAP), (6, OVERLAP.with(Flags::KEY_POINT))],
                usual,
                hidden,
                "every point is flagged overlap (--hide-flags without overlap shows them)",
            ),
            (
                &[(2, OVERLAP), (6, WITHHELD)],
                usual,
                Flags::ALL,
                "every point is withheld or flagged overlap (--withheld --hide-flags without overlap shows them)",
            ),
            (
                &[(2, Flags::SYNTHETIC), (6, Flags::KEY_POINT), (7, NONE)],
                usual,
                Flags::ALL,
                "every point is flagged synthetic or flagged key-point (--hide-flags without synthetic,key-point shows them), \
                 or of a class that is not shown (--classes 7 shows them)",
            ),
            (
                &[(7, NONE), (18, OVERLAP)],
                usual,
                hidden,
                "no point is of a class that is shown; there are 7,18 (--classes 7,18 shows those that are not flagged overlap)",
            ),
            (
                &[(7, OVERLAP)],
                usual,
                hidden,
                "every point is both flagged overlap and of such a class (--classes 7 --hide-flags without overlap shows them)",
            ),
        ]);
    }
}
