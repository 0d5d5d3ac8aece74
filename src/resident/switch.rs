//! Another mask is shown section by section: which are derived next, how many beside one frame, and how long all of it took.
//! Knows no device.

use crate::section::PayloadKey;
use std::collections::{HashMap, HashSet};
use std::time::{Duration, Instant};

/// Share of a frame's time that sections which are derived again may take beside it. Frames may take half as long again; what is
/// foreseen of a section is what others took.
const SHARE: f64 = 0.35;
/// Weight of the latest sections, where they took less than was foreseen.
const LATEST: f64 = 0.2;
/// What a frame takes where nobody has said, milliseconds.
const USUAL_FRAME_MS: f64 = 1000.0 / 60.0;

/// How many sections are derived again beside a frame.
#[derive(Clone, Copy, Debug)]
pub struct SwitchPace {
    frame_ms: f64,
    /// `None` until some were measured.
    section_ms: Option<f64>,
}

impl Default for SwitchPace {
    fn default() -> SwitchPace {
        SwitchPace { frame_ms: USUAL_FRAME_MS, section_ms: None }
    }
}

impl SwitchPace {
    /// A frame takes so many milliseconds by itself.
    pub fn set_frame_ms(&mut self, ms: f64) {
        if ms.is_finite() && ms > 0.0 {
            self.frame_ms = ms;
        }
    }

    /// So many sections took so long.
    pub fn learn(&mut self, sections: usize, ms: f64) {
        if sections == 0 || !ms.is_finite() {
            return;
        }
        let latest = ms / sections as f64;
        let known = self.section_ms.unwrap_or(latest);
        // Quick to give less, slow to give more.
        self.section_ms = Some(latest.max(known + LATEST * (latest - known)));
    }

    /// How many sections to derive beside a frame: at least one.
    pub fn sections(&self) -> usize {
        let Some(section_ms) = self.section_ms else { return 1 };
        // Beyond what can be counted where they take no time at all.
        (SHARE * self.frame_ms / section_ms).clamp(1.0, f64::from(u32::MAX)) as usize
    }
}

/// Sections that show what was to be seen before, in the order in which they are derived again.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SwitchOrder {
    /// All of them.
    pub keys: Vec<PayloadKey>,
    /// How many of them, the first, are in sight.
    pub in_sight: usize,
}

impl SwitchOrder {
    /// What is seen and shown, most urgent first; what else is shown, which may stand in for what is seen; what is seen but not
    /// shown yet; what will be seen (`ahead`); the rest.
    pub fn of(
        [seen, ahead]: [&[PayloadKey]; 2],
        shown: &HashSet<PayloadKey>,
        outdated: impl IntoIterator<Item = PayloadKey>,
    ) -> SwitchOrder {
        let places = |keys: &[PayloadKey]| -> HashMap<PayloadKey, usize> {
            keys.iter().enumerate().map(|(at, &key)| (key, at)).collect()
        };
        let (seen, ahead) = (places(seen), places(ahead));
        let rank = |key: PayloadKey| {
            let is_shown = shown.contains(&key);
            match (seen.get(&key), ahead.get(&key)) {
                (Some(&at), _) if is_shown => (0, at, key),
                _ if is_shown => (1, 0, key),
                (Some(&at), _) => (2, at, key),
                (None, Some(&at)) => (3, at, key),
                (None, None) => (4, 0, key),
            }
        };
        let outdated: HashSet<_> = outdated.into_iter().collect();
        let mut ranked: Vec<_> = outdated.into_iter().map(rank).collect();
        ranked.sort_unstable();
        let in_sight = ranked.iter().filter(|(rank, ..)| *rank < 2).count();
        SwitchOrder { keys: ranked.into_iter().map(|(.., key)| key).collect(), in_sight }
    }
}

/// How a change of the mask went.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Switched {
    /// Until all that is on the device showed what is to be seen.
    pub took: Duration,
    /// Until all did that was in sight.
    pub in_sight: Duration,
    /// Sections that were derived again.
    pub sections: u64,
    /// In so many parts, beside a frame each.
    pub parts: u64,
}

/// A change of the mask that is under way.
#[derive(Clone, Copy, Debug)]
pub struct Switch {
    began: Instant,
    in_sight: Option<Duration>,
    sections: u64,
    parts: u64,
}

impl Switch {
    /// Begins at `now`.
    pub fn new(now: Instant) -> Switch {
        Switch { began: now, in_sight: None, sections: 0, parts: 0 }
    }

    /// A part is given to the device.
    pub fn submitted(&mut self, sections: usize) {
        self.sections += sections as u64;
        self.parts += 1;
    }

    /// The device is done with all parts, and so many sections in sight are left.
    pub fn done(&mut self, in_sight: usize, now: Instant) {
        if in_sight == 0 {
            self.in_sight.get_or_insert(now - self.began);
        }
    }

    /// All is done at `now`.
    pub fn end(self, now: Instant) -> Switched {
        let took = now - self.began;
        let Switch { in_sight, sections, parts, .. } = self;
        Switched { took, in_sight: in_sight.unwrap_or(took), sections, parts }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coords::SectionKey;
    use proptest::prelude::*;

    fn key(k: u8) -> PayloadKey {
        PayloadKey::columns(SectionKey { level: 0, i: k.into(), j: 0 })
    }

    #[test]
    fn what_is_seen_comes_first_and_the_rest_last() {
        let (seen, ahead) = ([key(9), key(3), key(7)], [key(5), key(1)]);
        // One that is seen is not shown yet; another section stands in for it.
        let shown = HashSet::from([key(9), key(7), key(20)]);
        let order_of = |outdated: Vec<PayloadKey>| SwitchOrder::of([&seen, &ahead], &shown, outdated);
        let order = order_of((0..=20).map(key).collect());
        let first = [9, 7, 20, 3, 5, 1].map(key);
        assert_eq!(order.keys[..6], first);
        assert_eq!(order.in_sight, 3);
        assert!(order.keys[6..].is_sorted() && order.keys.len() == 21);
        // What shows what it should is left alone.
        let order = order_of([1, 20, 7].map(key).to_vec());
        assert_eq!(order, SwitchOrder { keys: [7, 20, 1].map(key).to_vec(), in_sight: 2 });
        assert_eq!(order_of(Vec::new()), SwitchOrder::default());
    }

    #[test]
    fn frames_are_given_as_many_sections_as_they_bear() {
        let mut pace = SwitchPace::default();
        assert_eq!(pace.sections(), 1, "nothing is known");
        pace.set_frame_ms(50.0);
        pace.learn(1, 2.0);
        assert_eq!(pace.sections(), 8);
        // One that takes longer counts at once, those that take less by and by.
        pace.learn(8, 40.0);
        assert_eq!(pace.sections(), 3);
        pace.learn(3, 3.0);
        assert_eq!(pace.sections(), 4);
        (0..50).for_each(|_| pace.learn(3, 3.0));
        assert_eq!(pace.sections(), 17);
        // Never none.
        pace.learn(1, 1e6);
        assert_eq!(pace.sections(), 1);
        // What cannot be is left out.
        for ms in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            pace.set_frame_ms(ms);
        }
        pace.learn(0, 1.0);
        pace.learn(1, f64::NAN);
        assert_eq!((pace.frame_ms, pace.sections()), (50.0, 1));
    }

    proptest! {
        /// Where sections take up to 1.4 times as long as others, frames take at most half as long again, but for those that one
        /// section alone is too much for.
        #[test]
        fn frames_take_at_most_half_as_long_again(
            costs in prop::collection::vec(1.0f64..1.4, 200),
            frame_ms in 1.0f64..200.0,
        ) {
            let mut pace = SwitchPace::default();
            pace.set_frame_ms(frame_ms);
            let (mut left, mut parts) = (&costs[..], 0);
            while !left.is_empty() {
                let (part, rest) = left.split_at(pace.sections().min(left.len()));
                let ms: f64 = part.iter().sum();
                prop_assert!(part.len() == 1 || ms <= 0.5 * frame_ms, "{} of {} ms", part.len(), ms);
                pace.learn(part.len(), ms);
                (left, parts) = (rest, parts + 1);
            }
            // Nor is there less in them than they bear.
            let bears = (SHARE * frame_ms / 1.4).floor().max(1.0);
            prop_assert!(f64::from(parts) <= 200.0 / bears + 2.0, "{parts} parts");
        }
    }

    #[test]
    fn how_long_it_took_is_told() {
        let began = Instant::now();
        let at = |ms| began + Duration::from_millis(ms);
        let mut switch = Switch::new(began);
        for (sections, in_sight, ms) in [(1, 3, 10), (4, 0, 20), (4, 0, 30)] {
            switch.submitted(sections);
            switch.done(in_sight, at(ms));
        }
        let [took, in_sight] = [40, 20].map(Duration::from_millis);
        assert_eq!(switch.end(at(40)), Switched { took, in_sight, sections: 9, parts: 3 });
        let nothing = Switch::new(began).end(at(1));
        assert_eq!((nothing.took, nothing.in_sight), (Duration::from_millis(1), Duration::from_millis(1)));
    }
}
