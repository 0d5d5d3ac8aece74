//! What a sample of points says of their attributes: the spread of values, and which occur.

use super::channel::TimeScale;
use super::record::Attributes;
use crate::coords::Grid;

/// How a value is spread over a sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spread {
    /// Lowest value, strays left out (more than ten spans of percentiles 1-99 away).
    pub min: f64,
    /// Highest value, strays left out.
    pub max: f64,
    /// Percentile 2.
    pub p2: f64,
    /// Percentile 98.
    pub p98: f64,
}

impl Spread {
    /// Of `values` in any order; zeros when there are none.
    pub fn of(mut values: Vec<f64>) -> Spread {
        values.sort_unstable_by(f64::total_cmp);
        let Some(last) = values.len().checked_sub(1) else { return Spread::default() };
        let percentile = |p: f64| values[(p / 100.0 * last as f64).round() as usize];
        let (p1, p99) = (percentile(1.0), percentile(99.0));
        // With p1 = p99 nothing tells a stray from a roof: all values count.
        let reach = if p99 > p1 { 10.0 * (p99 - p1) } else { f64::INFINITY };
        let near: Vec<f64> =
            values.iter().copied().filter(|&v| v >= p1 - reach && v <= p99 + reach).collect();
        Spread { min: near[0], max: near[near.len() - 1], p2: percentile(2.0), p98: percentile(98.0) }
    }

    /// Percentiles 2 to 98, or lowest to highest where those are equal.
    pub(super) fn middle(&self) -> (f64, f64) {
        if self.p2 < self.p98 { (self.p2, self.p98) } else { (self.min, self.max) }
    }
}

/// Collects the opening sample; feed it the points that are shown.
#[derive(Debug, Default)]
pub struct AttributeSample {
    points: Vec<Attributes>,
}

impl AttributeSample {
    /// Adds one point.
    pub fn push(&mut self, point: Attributes) {
        self.points.push(point);
    }

    /// What the colours are chosen by; the same for any order of points. `grid`: whose lattice heights are on.
    pub fn summary(&self, grid: &Grid) -> AttributeSummary {
        let p = &self.points;
        let (mut classes, mut returns) = (Box::new([0; 256]), Box::new([0; 256]));
        for a in p {
            classes[usize::from(a.class)] += 1;
            returns[usize::from(a.returns)] += 1;
        }
        let first = p.first().map_or([0; 3], |a| a.rgb);
        AttributeSummary {
            points: p.len() as u64,
            source_ids: Vec::new(),
            scan_angle: Spread::default(),
            times: None,
            is_timed: false,
            height: Spread::of(p.iter().map(|a| grid.units(a.height)).collect()),
            intensity: Spread::of(p.iter().map(|a| f64::from(a.intensity)).collect()),
            classes,
            returns,
            has_rgb: true,
            colored: p.iter().filter(|a| a.rgb != [0; 3]).count() as u64,
            rgb_constant: p.iter().all(|a| a.rgb == first).then_some(first),
        }
    }
}

/// The opening sample in short.
#[derive(Clone, Debug, PartialEq)]
pub struct AttributeSummary {
    /// Points sampled.
    pub points: u64,
    /// CRS units.
    pub height: Spread,
    /// As stored.
    pub intensity: Spread,
    /// Point source ids that were seen, ascending, with how many points have each.
    pub source_ids: Vec<(u16, u64)>,
    /// Degrees from the nadir.
    pub scan_angle: Spread,
    /// What GPS times are told apart by: those of all points, asked for or not; `None`: there are none.
    pub times: Option<TimeScale>,
    /// Every point has a GPS time.
    pub is_timed: bool,
    /// Points of each class.
    pub classes: Box<[u64; 256]>,
    /// Points of each `returns` byte.
    pub returns: Box<[u64; 256]>,
    /// Whether there is a field for RGB at all.
    pub has_rgb: bool,
    /// Points whose RGB is not black.
    pub colored: u64,
    /// The one RGB of all points, if there is one.
    pub rgb_constant: Option<[u8; 3]>,
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::coords::{HEIGHT_STEP, Height};

    pub const GRID: Grid = Grid { base_cell: 1.0, coarsen: 0, anchor: [0; 2], height_step: HEIGHT_STEP };

    pub fn point(h: i32, class: u8, intensity: u16, rgb: [u8; 3]) -> Attributes {
        Attributes { height: Height(h), class, intensity, rgb, returns: 0x11, flags: 0 }
    }

    pub fn summary(points: impl IntoIterator<Item = Attributes>) -> AttributeSummary {
        AttributeSample { points: points.into_iter().collect() }.summary(&GRID)
    }

    #[test]
    fn a_stray_point_changes_no_range() {
        let clean: Vec<_> = (0..1000).map(|k| point(k * 10, 2, 5, [0; 3])).collect();
        let stray = point(180_000 * 1024, 2, 5, [0; 3]);
        let (a, b) = (summary(clean.clone()), summary(clean.into_iter().chain([stray])));
        assert_eq!((a.height.min, a.height.max), (b.height.min, b.height.max));
        assert!((a.height.p98 - b.height.p98).abs() < 0.02);
    }
}
