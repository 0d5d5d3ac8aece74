//! What is shown of the points, and why nothing is to be seen where every one is hidden.

use crate::attribute::{ClassMask, Kinds};
use crate::sample::Asked;
use std::collections::BTreeSet;

/// What is shown: part of the derived data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Visibility {
    /// Classes that are shown.
    pub classes: ClassMask,
    /// Show withheld points too.
    pub withheld: bool,
    /// Longest hole to bridge, cells (0 to 4).
    pub bridge: u32,
    /// Of points that are as high as a column's top but for an eighth of a finest cell's side, at most 0.1 units, it shows one
    /// whose class tells more.
    pub near_ties: bool,
}

impl Visibility {
    /// What of the points is asked for, of those that take part.
    pub fn asked(&self) -> Asked {
        Asked { classes: self.classes, withheld: self.withheld, ..Asked::default() }
    }

    /// Whether points of this class are shown.
    pub fn shows(&self, class: u8, withheld: bool) -> bool {
        self.classes.shows(class) && (self.withheld || !withheld)
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
    if kinds.is_empty() || kinds.iter().any(|&(class, withheld)| visibility.shows(class, withheld)) {
        return None;
    }
    // Classes of the points that need these two: another list of classes, and the withheld ones.
    let needing = |other_class: bool, withheld_ones: bool| -> BTreeSet<u8> {
        let needs = |&&(class, withheld): &&(u8, bool)| {
            visibility.classes.shows(class) != other_class
                && (withheld && !visibility.withheld) == withheld_ones
        };
        kinds.iter().filter(needs).map(|(class, _)| *class).collect()
    };
    let (withheld, of_class, both) = (needing(false, true), needing(true, false), needing(true, true));
    if withheld.is_empty() && !of_class.is_empty() {
        let all = listed(&of_class.union(&both).copied().collect());
        let those = if both.is_empty() { "them" } else { "those that are not withheld" };
        return Some(format!(
            "no point is of a class that is shown; there are {all} (--classes {all} shows {those})"
        ));
    }
    let mut reasons = Vec::new();
    if !withheld.is_empty() {
        reasons.push("withheld (--withheld shows them)".to_owned());
    }
    if !of_class.is_empty() {
        let list = listed(&of_class);
        reasons.push(format!("of a class that is not shown (--classes {list} shows them)"));
    }
    if !both.is_empty() {
        let list = listed(&both);
        reasons.push(format!("both withheld and of such a class (--withheld --classes {list} shows them)"));
    }
    Some(format!("every point is {}", reasons.join(", or ")))
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
    use crate::attribute::ClassMask;

    #[test]
    fn the_reason_names_what_shows_the_points() {
        let why = |kinds: &[(u8, bool)], classes: ClassMask, withheld: bool| {
            let visibility = Visibility { classes, withheld, bridge: 4, near_ties: false };
            why_hidden(&kinds.iter().copied().collect(), &visibility)
        };
        let usual = ClassMask::default();
        assert_eq!(why(&[], usual, false), None);
        assert_eq!(why(&[(2, true), (2, false)], usual, false), None);
        assert_eq!(why(&[(2, true), (7, false)], usual, true), None);
        type Case<'a> = (&'a [(u8, bool)], ClassMask, bool, &'a str);
        let cases: [Case; 6] = [
            (&[(2, true), (6, true)], usual, false, "every point is withheld (--withheld shows them)"),
            (
                &[(7, false), (18, false)],
                usual,
                false,
                "no point is of a class that is shown; there are 7,18 (--classes 7,18 shows them)",
            ),
            (
                &[(2, false), (6, true)],
                ClassMask::only(&[9]),
                true,
                "no point is of a class that is shown; there are 2,6 (--classes 2,6 shows them)",
            ),
            (
                &[(2, true), (7, false)],
                usual,
                false,
                "every point is withheld (--withheld shows them), or of a class that is not shown (--classes 7 shows them)",
            ),
            (
                &[(7, true)],
                usual,
                false,
                "every point is both withheld and of such a class (--withheld --classes 7 shows them)",
            ),
            (
                &[(2, true), (7, true), (18, false)],
                usual,
                false,
                "every point is withheld (--withheld shows them), or of a class that is not shown (--classes 18 shows them), \
                 or both withheld and of such a class (--withheld --classes 7 shows them)",
            ),
        ];
        assert_eq!(listed(&[0, 1, 2, 5, 7, 8, 254, 255].into()), "0-2,5,7,8,254,255");
        for (kinds, classes, withheld, words) in cases {
            assert_eq!(why(kinds, classes, withheld).as_deref(), Some(words));
        }
    }
}
