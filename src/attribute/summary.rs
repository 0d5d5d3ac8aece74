//! What a sample of points says of their attributes: the spread of values, and which occur.

use super::channel::{AboveScale, Steps, TimeScale};
use super::record::Attributes;
use crate::coords::Grid;

/// Widest that stands on the ground, metres, where no class tells what is ground.
const REACH: f64 = 30.0;
const MILLIMETRE: f64 = 1.0 / 1024.0;
/// How far lengths are told apart at least, metres, where heights are not much less: towers that no sample has seen.
const TOWER: f64 = 250.0;
/// How far beyond the heights that were seen lengths are told apart at least.
const BEYOND: f64 = 1.25;
/// And how far where they are less than [`TOWER`].
const FAR_BEYOND: f64 = 16.0;
/// Codes of a density that is as large as that of everything: there are 256 times as many.
const DENSITY_CODES: f64 = 256.0;

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

/// What 16 bits tell apart. It follows from all points that count (neither noise nor withheld), whether they are shown
/// or not, since that is what measures are of: a code means the same whatever is shown.
#[derive(Clone, Debug, PartialEq)]
pub struct Scales {
    /// CRS units in a metre; 1 where that is not known.
    pub metre: f64,
    /// What GPS times are told apart by; `None`: there are none.
    pub times: Option<TimeScale>,
    /// Lengths are told apart up to here, CRS units.
    pub reach: f64,
    /// Points in a square unit, roughly; 0: unknown.
    pub density: f64,
    /// Point source ids that were seen, ascending.
    pub lines: Vec<u16>,
}

impl Default for Scales {
    fn default() -> Scales {
        Scales { metre: 1.0, times: None, reach: TOWER, density: 0.0, lines: Vec::new() }
    }
}

impl Scales {
    /// Other points count, too. What codes mean already stays: what is beyond that is told as such.
    pub fn join(&mut self, others: &Scales) {
        self.lines.extend(&others.lines);
        self.lines.sort_unstable();
        self.lines.dedup();
        // Where there were no times none were coded.
        self.times = self.times.or(others.times);
    }

    /// How far lengths are to be told apart where points have these heights, which are spread like that, CRS units.
    pub fn reach_of(heights: impl Iterator<Item = f64>, spread: &Spread, metre: f64) -> f64 {
        let ends = |(low, high): (f64, f64), height: f64| (low.min(height), high.max(height));
        let finite = heights.filter(|height| height.is_finite());
        let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), ends);
        let Spread { min, max, .. } = *spread;
        // A mast on flat land is a stray to the spread.
        let seldom = (FAR_BEYOND * (max - min)).max(BEYOND * (high - low)).min(TOWER * metre);
        let reach = (BEYOND * (max - min)).max(seldom);
        if reach > 0.0 && reach.is_finite() { reach } else { TOWER * metre }
    }

    /// A power of two of CRS units, of which 60,000 are the reach.
    fn length_unit(&self) -> f64 {
        (self.reach / 60_000.0).log2().ceil().exp2()
    }

    /// What heights above the ground are told apart by.
    pub fn above_scale(&self) -> AboveScale {
        AboveScale { unit: self.length_unit(), reach: REACH * self.metre }
    }

    /// What densities are.
    pub fn density_steps(&self) -> Steps {
        let density = if self.density > 0.0 { self.density } else { 1.0 };
        Steps { unit: (density / DENSITY_CODES).log2().floor().exp2() }
    }

    /// What differences of flight lines are: as finely as lasers measure, or finer where all heights are near each other.
    pub fn difference_steps(&self) -> Steps {
        let finest = (2.0 * MILLIMETRE * self.metre).log2().floor().exp2();
        Steps { unit: self.length_unit().min(finest) }
    }
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
        let heights = || p.iter().map(|a| grid.units(a.height));
        let height = Spread::of(heights().map(|height| (height, 1.0)));
        AttributeSummary {
            points: p.len() as u64,
            is_of_shown: true,
            source_ids: Vec::new(),
            scan_angle: Spread::default(),
            above: Spread::default(),
            time: Spread::default(),
            scales: Scales { reach: Scales::reach_of(heights(), &height, 1.0), ..Scales::default() },
            height,
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
    /// They are such as are shown: of those that were asked for the sample has seen some.
    pub is_of_shown: bool,
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
    /// GPS time, seconds as stored.
    pub time: Spread,
    /// What codes of values mean: of all points.
    pub scales: Scales,
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
    use super::super::channel::Channel;
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
    fn files_that_come_bring_their_lines_and_the_first_times() {
        let times = |from| Some(TimeScale { from, to: from + 9.0 });
        let mut known = Scales { lines: vec![4, 7], ..Scales::default() };
        known.join(&Scales { lines: vec![1, 7, 9], times: times(100.0), reach: 1.0, ..Scales::default() });
        assert_eq!(known, Scales { lines: vec![1, 4, 7, 9], times: times(100.0), ..Scales::default() });
        known.join(&Scales { times: times(0.0), ..Scales::default() });
        assert_eq!(known.times, times(100.0), "what codes mean stays");
    }

    #[test]
    fn codes_reach_beyond_the_heights_that_were_seen() {
        let reach = |heights: &[f64], metre| {
            let spread = Spread::of(heights.iter().map(|height| (*height, 1.0)));
            Scales::reach_of(heights.iter().copied(), &spread, metre)
        };
        let flat = |tower: f64| [[0.0, 0.5].repeat(500), vec![tower]].concat();
        // Nothing is known; little is; a mast on flat land; mountains; feet; a stray.
        assert_eq!(reach(&[], 1.0), TOWER);
        assert_eq!(reach(&[7.0], 1.0), TOWER);
        assert_eq!(reach(&[0.0, 0.25], 1.0), 4.0);
        assert_eq!(reach(&flat(50.0), 1.0), 62.5);
        assert_eq!(reach(&[0.0, 1600.0], 1.0), 2000.0);
        assert_eq!(reach(&[0.0, 100.0], 3.28), 250.0 * 3.28);
        assert_eq!(reach(&flat(180_000.0), 1.0), TOWER);
        let steps = |reach| Scales { reach, density: 8.75, ..Scales::default() };
        let highest = |channel: Channel| channel.value(u16::MAX).unwrap();
        assert!(highest(Channel::AboveGround(steps(62.5).above_scale())) > 62.5);
        assert!(highest(Channel::LineDifference(steps(62.5).difference_steps())) > 62.5);
        assert!(highest(Channel::Density(steps(62.5).density_steps())) > 200.0 * 8.75);
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
