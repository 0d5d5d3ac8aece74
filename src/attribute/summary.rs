//! What a sample of points says of their attributes: the spread of values, and which occur.

use super::channel::{AboveScale, Steps, TimeScale};
use super::record::Attributes;
use crate::coords::Grid;

/// Widest that stands on the ground, metres, where no class tells what is ground.
const REACH: f64 = 30.0;
const MILLIMETRE: f64 = 1.0 / 1024.0;

/// Quantiles that are kept, in steps of a thousandth.
const QUANTILES: usize = 1001;

/// How a value is spread over a sample.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Spread {
    /// Lowest value, strays left out (more than ten spans of percentiles 1-99 away).
    pub min: f64,
    /// Highest value, strays left out.
    pub max: f64,
    /// Values that so many thousandths are at or below, strays left out; empty where there are no values.
    quantiles: Vec<f64>,
}

impl Spread {
    /// Of values and their weights, in any order; what is not finite is left out. Zeros when there are none.
    pub fn of(values: impl Iterator<Item = (f64, f64)>) -> Spread {
        let mut values: Vec<(f64, f64)> = values.filter(|(value, _)| value.is_finite()).collect();
        values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let total: f64 = values.iter().map(|(_, weight)| weight).sum();
        let (mut quantiles, mut below) = (Vec::with_capacity(QUANTILES), 0.0);
        let Some(&(last, _)) = values.last() else { return Spread::default() };
        for (value, weight) in &values {
            below += weight;
            while quantiles.len() < QUANTILES
                && below >= quantiles.len() as f64 / (QUANTILES - 1) as f64 * total
            {
                quantiles.push(*value);
            }
        }
        // What rounding has left.
        quantiles.resize(QUANTILES, last);
        let [p1, p99] = [quantiles[10], quantiles[990]];
        // With p1 = p99 nothing tells a stray from a roof: all values count.
        let reach = if p99 > p1 { 10.0 * (p99 - p1) } else { f64::INFINITY };
        let is_near = |value: &f64| (p1 - reach..=p99 + reach).contains(value);
        let near = || values.iter().map(|(value, _)| *value).filter(is_near);
        let (min, max) = (near().next().unwrap_or(p1), near().next_back().unwrap_or(p99));
        quantiles.iter_mut().for_each(|value| *value = value.clamp(min, max));
        Spread { min, max, quantiles }
    }

    /// The value that `percent` of a hundred are at or below; 0: the lowest, 100: the highest, strays left out.
    pub fn percentile(&self, percent: f64) -> f64 {
        let Some(last) = self.quantiles.len().checked_sub(1) else { return 0.0 };
        if percent >= 100.0 {
            return self.max;
        }
        let at = (percent.max(0.0) * 10.0).min(last as f64);
        // Steps of a thousandth are met, however they were typed.
        let at = if (at - at.round()).abs() < 1e-9 { at.round() } else { at };
        let (below, above) = (self.quantiles[at as usize], self.quantiles[(at as usize + 1).min(last)]);
        below + (above - below) * at.fract()
    }

    /// Percentiles 2 to 98, or lowest to highest where those are equal.
    pub(super) fn middle(&self) -> (f64, f64) {
        let (low, high) = (self.percentile(2.0), self.percentile(98.0));
        if low < high { (low, high) } else { (self.min, self.max) }
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
            above: Spread::default(),
            density: 0.0,
            metre: 1.0,
            time: Spread::default(),
            times: None,
            is_timed: false,
            height: Spread::of(p.iter().map(|a| (grid.units(a.height), 1.0))),
            intensity: Spread::of(p.iter().map(|a| (f64::from(a.intensity), 1.0))),
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
    /// Above the low surface of the sample, CRS units: roughly above the ground.
    pub above: Spread,
    /// Points in a square unit, roughly; 0: unknown.
    pub density: f64,
    /// CRS units in a metre; 1 where that is not known.
    pub metre: f64,
    /// GPS time, seconds as stored.
    pub time: Spread,
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

impl AttributeSummary {
    /// A power of two of CRS units, of which 60,000 are all heights.
    fn height_unit(&self) -> f64 {
        let extent = self.height.max - self.height.min;
        if extent > 0.0 { (extent / 60_000.0).log2().ceil().exp2() } else { MILLIMETRE * self.metre }
    }

    /// What heights above the ground are told apart by.
    pub fn above_scale(&self) -> AboveScale {
        AboveScale { unit: self.height_unit(), reach: REACH * self.metre }
    }

    /// What densities are.
    pub fn density_steps(&self) -> Steps {
        let density = if self.density > 0.0 { self.density } else { 1.0 };
        Steps { unit: (density / 1024.0).log2().floor().exp2() }
    }

    /// What differences of flight lines are: as finely as lasers measure, where heights allow for no less.
    pub fn difference_steps(&self) -> Steps {
        let finest = (2.0 * MILLIMETRE * self.metre).log2().floor().exp2();
        Steps { unit: self.height_unit().min(finest) }
    }
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
        assert!((a.height.percentile(98.0) - b.height.percentile(98.0)).abs() < 0.02);
    }

    #[test]
    fn percentiles_lie_between_values_and_end_where_strays_begin() {
        let spread = Spread::of((0..=1000).rev().map(|k| (f64::from(k), 1.0)));
        for (percent, value) in
            [(0.0, 0.0), (0.1, 1.0), (2.0, 20.0), (33.3, 333.0), (98.0, 980.0), (100.0, 1000.0)]
        {
            assert_eq!(spread.percentile(percent), value, "{percent}");
        }
        assert!((spread.percentile(99.95) - 999.5).abs() < 1e-6);
        // Weights count, order does not.
        let weighted = Spread::of([(7.0, 1.0), (5.0, 3.0), (f64::NAN, 9.0)].into_iter());
        assert_eq!([74.0, 76.0].map(|p| weighted.percentile(p)), [5.0, 7.0]);
        let strays = Spread::of((0..1000).map(|k| (f64::from(k), 1.0)).chain([(1e9, 1.0)]));
        assert_eq!((strays.max, strays.percentile(100.0)), (999.0, 999.0));
        assert_eq!(Spread::of(std::iter::empty()).percentile(50.0), 0.0);
    }
}
