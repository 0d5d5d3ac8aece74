//! What there is of the values that selections go by, as far as the sample has seen it: what is said where nothing is selected,
//! or everything.

use super::seen::Seen;
use super::weighted::Weighted;
use crate::source::{Interval, Returns, Selection, SourceIds};
use crate::text::tidy;
use std::collections::BTreeSet;

/// See the module. By default nothing was seen.
#[derive(Clone, Debug, Default)]
pub struct Present {
    source_ids: BTreeSet<u16>,
    intensity: Option<Interval>,
    /// U, units of the picture.
    heights: Option<Interval>,
    /// Of points that have one, s.
    gps_time: Option<Interval>,
    /// Some point has the number of its return.
    has_returns: bool,
    /// Not every point was seen.
    is_part: bool,
}

/// Makes `range` reach to `value`, if that is a number.
fn widen(range: &mut Option<Interval>, value: f64) {
    if value.is_finite() {
        let known = range.unwrap_or(Interval { low: value, high: value });
        *range = Some(Interval { low: known.low.min(value), high: known.high.max(value) });
    }
}

impl Present {
    /// Of the points of a sample that count; `is_part`: there are others. O(points).
    pub(super) fn of(sample: &Weighted, counts: impl Fn(&Seen) -> bool, is_part: bool) -> Present {
        let mut present = Present { is_part, ..Present::default() };
        for (file, points) in sample.points.iter().enumerate() {
            for (seen, _) in points.iter().filter(|(seen, _)| counts(seen)) {
                present.source_ids.insert(seen.source_id);
                widen(&mut present.intensity, seen.intensity.into());
                widen(&mut present.gps_time, seen.gps_time);
                widen(&mut present.heights, sample.place(file, seen).z);
                present.has_returns |= seen.returns != 0;
            }
        }
        present
    }

    /// Takes in what there is of more files.
    pub fn join(&mut self, more: &Present) {
        self.source_ids.extend(&more.source_ids);
        for (range, more) in [
            (&mut self.intensity, more.intensity),
            (&mut self.heights, more.heights),
            (&mut self.gps_time, more.gps_time),
        ] {
            more.iter().flat_map(|more| [more.low, more.high]).for_each(|value| widen(range, value));
        }
        self.has_returns |= more.has_returns;
        self.is_part |= more.is_part;
    }

    /// What there is of that which a selection asks for, as words that come after others: `; there is source id 3,7-9`.
    /// Nothing where nothing is known.
    pub fn beside(&self, selection: &Selection) -> String {
        let range = |name: &str, range: Option<Interval>| {
            let ends = |range: Interval| {
                let (low, high) = ((range.low * 100.0).floor() / 100.0, (range.high * 100.0).ceil() / 100.0);
                format!("{name} {}..{}", tidy(low), tidy(high))
            };
            range.map(ends)
        };
        let ids = SourceIds::from_iter(self.source_ids.iter().copied());
        let there = [
            (!selection.source_ids.is_all() && !ids.is_all()).then(|| format!("source id {ids}")),
            range("intensities", self.intensity.filter(|_| !selection.intensity.is_all())),
            range("heights", self.heights.filter(|_| !selection.heights.is_all())),
            range("GPS times", self.gps_time.filter(|_| !selection.gps_time.is_all())),
        ];
        let there: Vec<String> = there.into_iter().flatten().collect();
        let who = if self.is_part { "a sample has" } else { "there is" };
        if there.is_empty() { String::new() } else { format!("; {who} {}", there.join(", ")) }
    }

    /// What a selection asks for that points do not tell: it holds of all of them, or of none.
    pub fn doubts(&self, selection: &Selection) -> Vec<String> {
        if self.source_ids.is_empty() {
            // Nothing was seen.
            return Vec::new();
        }
        let none = if self.is_part { "no point of the sample" } else { "no point" };
        let mut doubts = Vec::new();
        if selection.returns != Returns::All && !self.has_returns {
            doubts.push(format!(
                "{none} has the number of its return: each counts as the only one of its pulse"
            ));
        }
        if selection.needs_time() && self.gps_time == Some(Interval { low: 0.0, high: 0.0 }) {
            doubts.push(format!("{none} has a GPS time other than 0"));
        }
        doubts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_there_is_is_said_of_what_was_asked_for() {
        let range = |low, high| Some(Interval { low, high });
        let mut present = Present {
            source_ids: [3, 8].into(),
            heights: range(42.2138, 64.35),
            gps_time: range(0.0, 0.0),
            ..Present::default()
        };
        let lines = Selection { source_ids: "12".parse().unwrap(), ..Selection::default() };
        assert_eq!(present.beside(&lines), "; there is source id 3,8");
        let high = Selection { heights: "500..".parse().unwrap(), ..lines.clone() };
        assert_eq!(present.beside(&high), "; there is source id 3,8, heights 42.21..64.35");
        let early = Selection { gps_time: "..5".parse().unwrap(), ..Selection::default() };
        let firsts = Selection { returns: Returns::First, ..Selection::default() };
        assert_eq!(present.doubts(&early), ["no point has a GPS time other than 0"]);
        assert!(present.doubts(&firsts)[0].starts_with("no point has the number of its return"));
        let more = Present { is_part: true, has_returns: true, gps_time: range(1.0, 7.5), ..present.clone() };
        present.join(&Present { source_ids: [9].into(), ..more });
        assert_eq!(present.beside(&lines), "; a sample has source id 3,8,9");
        assert_eq!(present.beside(&early), "; a sample has GPS times 0..7.5");
        assert!(present.doubts(&early).is_empty() && present.doubts(&firsts).is_empty());
        assert_eq!(Present::default().beside(&high), "");
        assert!(Present::default().doubts(&firsts).is_empty());
    }
}
