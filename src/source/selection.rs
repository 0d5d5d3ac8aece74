//! Which points take part at all, as they are asked for: by return, flight line, intensity, height and time.
//!
//! Points that do not are skipped before they come into a section; what is stored tells nothing of them. Another selection
//! reads the points again.

use super::PointBlock;
use crate::text::tidy;
use std::fmt::Write as _;

/// Which returns of a pulse take part. A number or count of 0, which says nothing, is one of 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Returns {
    /// Any.
    #[default]
    #[value(alias = "any")]
    All,
    /// The first of each pulse, single ones among them.
    First,
    /// The last of each pulse, single ones among them.
    Last,
    /// Those of pulses with a single one.
    #[value(alias = "single")]
    Only,
}

impl Returns {
    /// As typed.
    pub fn name(self) -> &'static str {
        match self {
            Returns::All => "all",
            Returns::First => "first",
            Returns::Last => "last",
            Returns::Only => "only",
        }
    }

    /// Whether a return takes part: number in the low nibble, number of returns in the high nibble.
    #[inline]
    pub fn holds(self, returns: u8) -> bool {
        let (number, count) = (returns & 15, returns >> 4);
        match self {
            Returns::All => true,
            Returns::First => number <= 1,
            Returns::Last => number >= count,
            Returns::Only => count <= 1,
        }
    }
}

/// Values from one to another, both among them; open where that is infinite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Lowest.
    pub low: f64,
    /// Highest.
    pub high: f64,
}

impl Default for Interval {
    /// All.
    fn default() -> Interval {
        Interval { low: f64::NEG_INFINITY, high: f64::INFINITY }
    }
}

impl std::fmt::Display for Interval {
    /// As typed: `100..2000`, `100..`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let end = |value: f64| if value.is_finite() { value.to_string() } else { String::new() };
        write!(f, "{}..{}", end(self.low), end(self.high))
    }
}

impl std::str::FromStr for Interval {
    type Err = String;

    fn from_str(text: &str) -> Result<Interval, String> {
        let number = |text: &str| -> Result<f64, String> {
            let value: f64 = text.parse().map_err(|_| format!("'{text}' is not a number"))?;
            if value.is_finite() { Ok(value) } else { Err(format!("'{text}' is not finite")) }
        };
        let end = |text: &str, open: f64| if text.is_empty() { Ok(open) } else { number(text) };
        let text = text.trim();
        let (low, high) = match text.split_once("..") {
            Some((low, high)) => (end(low.trim(), f64::NEG_INFINITY)?, end(high.trim(), f64::INFINITY)?),
            None if text.is_empty() => return Err("a range is 100..2000, 100.. or ..2000".to_owned()),
            None => number(text)
                .map(|value| (value, value))
                .map_err(|why| format!("{why}; a range is 100..2000, 100.. or ..2000"))?,
        };
        if low > high {
            return Err(format!("{} is above {}", tidy(low), tidy(high)));
        }
        Ok(Interval { low, high })
    }
}

impl Interval {
    /// Whether every number is in it.
    pub fn is_all(&self) -> bool {
        self.low == f64::NEG_INFINITY && self.high == f64::INFINITY
    }

    /// Whether a number is in it. What is none is in none.
    #[inline]
    pub fn holds(&self, value: f64) -> bool {
        value >= self.low && value <= self.high
    }
}

/// Point source ids.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SourceIds {
    /// First and last of runs, ascending and apart; none: all ids.
    runs: Vec<[u16; 2]>,
}

impl std::fmt::Display for SourceIds {
    /// As typed: `3,7-9`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (k, [first, last]) in self.runs.iter().enumerate() {
            let comma = if k > 0 { "," } else { "" };
            match last - first {
                0 => write!(f, "{comma}{first}")?,
                1 => write!(f, "{comma}{first},{last}")?,
                _ => write!(f, "{comma}{first}-{last}")?,
            }
        }
        Ok(())
    }
}

impl std::str::FromStr for SourceIds {
    type Err = String;

    fn from_str(text: &str) -> Result<SourceIds, String> {
        let id = |text: &str| {
            let text = text.trim();
            let value: u64 =
                text.parse().map_err(|_| format!("'{text}' is not a point source id, such as 3,7-9"))?;
            u16::try_from(value)
                .map_err(|_| format!("{value} is out of range: point source ids are 0 to 65535"))
        };
        let run = |part: &str| {
            let ends = part.split_once("..").or_else(|| part.split_once('-')).unwrap_or((part, part));
            let (first, last) = (id(ends.0)?, id(ends.1)?);
            if first > last {
                Err(format!("{first}-{last}: {first} is above {last}"))
            } else {
                Ok([first, last])
            }
        };
        Ok(SourceIds::of(text.split(',').map(run).collect::<Result<_, _>>()?))
    }
}

impl FromIterator<u16> for SourceIds {
    fn from_iter<T: IntoIterator<Item = u16>>(ids: T) -> SourceIds {
        SourceIds::of(ids.into_iter().map(|id| [id; 2]).collect())
    }
}

impl SourceIds {
    /// Of runs in any order.
    fn of(mut runs: Vec<[u16; 2]>) -> SourceIds {
        runs.sort_unstable();
        let mut joined: Vec<[u16; 2]> = Vec::new();
        for [first, last] in runs {
            match joined.last_mut() {
                Some([_, end]) if u32::from(first) <= u32::from(*end) + 1 => *end = last.max(*end),
                _ => joined.push([first, last]),
            }
        }
        SourceIds { runs: joined }
    }

    /// Whether all are among them.
    pub fn is_all(&self) -> bool {
        self.runs.is_empty()
    }

    /// Whether an id is among them.
    #[inline]
    pub fn holds(&self, id: u16) -> bool {
        self.runs.is_empty() || self.runs.iter().any(|[first, last]| (*first..=*last).contains(&id))
    }
}

/// Which points take part: those of which all of this is so.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    /// Their place in the pulse.
    pub returns: Returns,
    /// Their point source id.
    pub source_ids: SourceIds,
    /// Their intensity, as stored.
    pub intensity: Interval,
    /// Their height as it is drawn: U, in units of the picture.
    pub heights: Interval,
    /// Their GPS time, as stored, s. Points without one are not in any, unless that is all.
    pub gps_time: Interval,
}

impl Selection {
    /// Whether every point takes part.
    pub fn is_all(&self) -> bool {
        *self == Selection::default()
    }

    /// Whether it asks for a time.
    pub fn needs_time(&self) -> bool {
        !self.gps_time.is_all()
    }

    /// Whether point `i` of a block takes part, as far as that does not depend on where it lies. A block that lacks a column
    /// that is asked for has no such points.
    #[inline]
    pub fn holds(&self, block: &PointBlock, i: usize) -> bool {
        self.returns.holds(block.returns[i])
            && (self.intensity.is_all() || self.intensity.holds(block.intensity[i].into()))
            && (self.source_ids.is_all()
                || block.source_id.get(i).is_some_and(|&id| self.source_ids.holds(id)))
            && (self.gps_time.is_all()
                || block.gps_time.get(i).is_some_and(|&time| self.gps_time.holds(time)))
    }

    /// Whether points that lie at `up` take part, as far as that depends on it. A height that is no number is in no interval.
    #[inline]
    pub fn holds_height(&self, up: f64) -> bool {
        self.heights.is_all() || self.heights.holds(up)
    }

    /// As options of a command line: names and values.
    pub fn options(&self) -> Vec<(&'static str, String)> {
        let mut options = Vec::new();
        if self.returns != Returns::All {
            options.push(("returns", self.returns.name().to_owned()));
        }
        if !self.source_ids.is_all() {
            options.push(("source-id", self.source_ids.to_string()));
        }
        for (name, interval) in
            [("intensity", self.intensity), ("heights", self.heights), ("gps-time", self.gps_time)]
        {
            if !interval.is_all() {
                options.push((name, interval.to_string()));
            }
        }
        options
    }

    /// In words: `first returns, intensity 100..2000`; of everything: `all points`.
    pub fn words(&self) -> String {
        if self.is_all() {
            return "all points".to_owned();
        }
        let mut words = match self.returns {
            Returns::All => String::new(),
            Returns::Only => "single returns".to_owned(),
            returns => format!("{} returns", returns.name()),
        };
        for (name, value) in self.options() {
            let name = match name {
                "returns" => continue,
                "source-id" => "source id",
                "gps-time" => "GPS time",
                name => name,
            };
            let comma = if words.is_empty() { "" } else { ", " };
            let _ = write!(words, "{comma}{name} {value}");
        }
        words
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn value() -> impl Strategy<Value = f64> {
        prop_oneof![-1e9f64..1e9, (-1000i32..1000).prop_map(f64::from), Just(0.0), 3e8f64..3.1e8]
    }

    proptest! {
        #[test]
        fn intervals_are_read_as_they_are_written(low in prop::option::of(value()), high in prop::option::of(value())) {
            let (low, high) = (low.unwrap_or(f64::NEG_INFINITY), high.unwrap_or(f64::INFINITY));
            let interval = Interval { low: low.min(high), high: low.max(high) };
            let text = interval.to_string();
            prop_assert_eq!(text.parse(), Ok(interval), "{}", text);
            prop_assert_eq!(format!(" {text} ").parse(), Ok(interval));
            for inside in [interval.low.max(-1e300), interval.high.min(1e300)] {
                prop_assert!(interval.holds(inside));
            }
            if low != high {
                let reversed = Interval { low: interval.high, high: interval.low }.to_string();
                let is_open = low.is_infinite() || high.is_infinite();
                prop_assert_eq!(reversed.parse::<Interval>().is_err(), !is_open);
            }
        }

        #[test]
        fn nothing_that_is_typed_ends_in_a_panic(text in "[-0-9., eInNaf:]{0,12}") {
            if let Ok(interval) = text.parse::<Interval>() {
                prop_assert!(interval.low <= interval.high && interval.low < f64::INFINITY);
                prop_assert_eq!(interval.to_string().parse(), Ok(interval));
            }
            if let Ok(ids) = text.parse::<SourceIds>() {
                prop_assert_eq!(ids.to_string().parse(), Ok(ids));
            }
        }

        #[test]
        fn ids_are_those_that_were_typed(runs in prop::collection::vec((any::<u16>(), 0u16..40), 1..8), id in any::<u16>()) {
            let runs: Vec<_> = runs.into_iter().map(|(first, n)| [first, first.saturating_add(n)]).collect();
            let typed: Vec<_> = runs.iter().map(|[first, last]| format!("{first}-{last}")).collect();
            let ids: SourceIds = typed.join(",").parse().unwrap();
            for id in runs.iter().flat_map(|[first, last]| [*first, *last, first.wrapping_sub(1)]).chain([id]) {
                let is_typed = runs.iter().any(|[first, last]| (*first..=*last).contains(&id));
                prop_assert_eq!(ids.holds(id), is_typed, "{} of {}", id, ids);
            }
            prop_assert_eq!(ids.to_string().parse(), Ok(ids));
        }
    }

    #[test]
    fn what_is_wrong_with_a_range_is_named() {
        let interval = |text: &str| text.parse::<Interval>();
        assert_eq!(interval("100..2000"), Ok(Interval { low: 100.0, high: 2000.0 }));
        assert_eq!(interval("-3.5.."), Ok(Interval { low: -3.5, ..Interval::default() }));
        assert_eq!(interval(".."), Ok(Interval::default()));
        assert_eq!(interval("7"), Ok(Interval { low: 7.0, high: 7.0 }));
        for (text, why) in [
            ("", "a range is 100..2000, 100.. or ..2000"),
            ("9..3", "9 is above 3"),
            ("a..3", "'a' is not a number"),
            ("100,2000", "'100,2000' is not a number; a range is 100..2000"),
            ("inf..", "'inf' is not finite"),
            ("1..nan", "'nan' is not finite"),
        ] {
            let error = interval(text).unwrap_err();
            assert!(error.starts_with(why), "{text}: {error}");
        }
        let ids = |text: &str| text.parse::<SourceIds>().map(|ids| ids.to_string());
        assert_eq!(ids("9,3,7-8, 4"), Ok("3,4,7-9".to_owned()));
        assert_eq!(ids("7..9"), Ok("7-9".to_owned()));
        assert!(ids("70000").unwrap_err().contains("out of range"));
        assert!(ids("9-7").unwrap_err().contains("9 is above 7"));
        assert!(
            ids("").unwrap_err().contains("not a point source id") && ids("x").is_err() && ids("-3").is_err()
        );
    }

    #[test]
    fn returns_are_those_of_the_pulse() {
        let kept = |returns: Returns| -> Vec<u8> {
            [0x00, 0x11, 0x21, 0x22, 0x31, 0x32, 0x33].into_iter().filter(|&r| returns.holds(r)).collect()
        };
        assert_eq!(kept(Returns::All).len(), 7);
        assert_eq!(kept(Returns::First), [0x00, 0x11, 0x21, 0x31]);
        assert_eq!(kept(Returns::Last), [0x00, 0x11, 0x22, 0x33]);
        assert_eq!(kept(Returns::Only), [0x00, 0x11]);
    }

    #[test]
    fn a_selection_is_told_in_words_and_options() {
        assert_eq!(Selection::default().words(), "all points");
        assert_eq!(Selection::default().options(), []);
        let selection = Selection {
            returns: Returns::First,
            source_ids: "3,7-9".parse().unwrap(),
            intensity: "100..".parse().unwrap(),
            heights: Interval::default(),
            gps_time: "..5.5".parse().unwrap(),
        };
        assert_eq!(selection.words(), "first returns, source id 3,7-9, intensity 100.., GPS time ..5.5");
        let options: Vec<_> =
            selection.options().iter().map(|(name, value)| format!("--{name} {value}")).collect();
        assert_eq!(options.join(" "), "--returns first --source-id 3,7-9 --intensity 100.. --gps-time ..5.5");
    }
}
