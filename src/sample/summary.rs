//! What colours are chosen by: the attributes of the points that are asked for.

use super::seen::Seen;
use crate::attribute::{AttributeSummary, Scales, Spread, TimeScale};
use std::collections::BTreeMap;

/// A point that is summarised, and how many it stands for.
pub(super) struct Shown<'a> {
    pub seen: &'a Seen,
    pub weight: f64,
    pub u: f64,
    pub rgb: [u8; 3],
}

pub(super) fn summarise(shown: &[Shown], has_rgb: bool) -> AttributeSummary {
    let (mut classes, mut returns) = (vec![0.0; 256], vec![0.0; 256]);
    for point in shown {
        classes[usize::from(point.seen.class)] += point.weight;
        returns[usize::from(point.seen.returns)] += point.weight;
    }
    let total = |keep: &dyn Fn(&Shown) -> bool| {
        shown.iter().filter(|point| keep(point)).map(|point| point.weight).sum::<f64>().round() as u64
    };
    let mut source_ids: BTreeMap<u16, f64> = BTreeMap::new();
    for point in shown {
        *source_ids.entry(point.seen.source_id).or_default() += point.weight;
    }
    let angle = |point: &Shown| (f64::from(point.seen.scan_angle) * 0.006, point.weight);
    let first = shown.first().map_or([0; 3], |point| point.rgb);
    AttributeSummary {
        points: total(&|_| true),
        is_of_shown: true,
        height: Spread::of(shown.iter().map(|point| (point.u, point.weight))),
        intensity: Spread::of(shown.iter().map(|point| (f64::from(point.seen.intensity), point.weight))),
        source_ids: source_ids.into_iter().map(|(id, weight)| (id, (weight.round() as u64).max(1))).collect(),
        scan_angle: Spread::of(shown.iter().map(angle)),
        above: Spread::default(),
        time: Spread::of(shown.iter().map(|point| (point.seen.gps_time, point.weight))),
        scales: Scales::default(),
        classes: counts(&classes),
        returns: counts(&returns),
        has_rgb,
        colored: total(&|point| point.rgb != [0; 3]),
        rgb_constant: shown.iter().all(|point| point.rgb == first).then_some(first),
    }
}

/// Whole points; what was seen at all is never 0.
pub(super) fn counts(weights: &[f64]) -> Box<[u64; 256]> {
    let count = |&weight: &f64| if weight > 0.0 { (weight.round() as u64).max(1) } else { 0 };
    let counts: Vec<u64> = weights.iter().map(count).collect();
    counts.into_boxed_slice().try_into().expect("one a class")
}

/// What times (with weights) are told apart by; `is_whole`: there are no others. `None`: there are none.
pub(super) fn times(values: impl Iterator<Item = (f64, f64)>, is_whole: bool) -> Option<TimeScale> {
    let mut values = values.filter(|(time, _)| time.is_finite()).peekable();
    values.peek()?;
    let Spread { min, max, .. } = Spread::of(values);
    // What was not seen reaches a little beyond.
    let beyond = if is_whole { 0.0 } else { (max - min) / 16.0 };
    Some(TimeScale { from: min - beyond, to: max + beyond })
}
