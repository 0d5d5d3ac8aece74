//! Measures: values of columns that follow from all points of a section, not from one.
//!
//! What they need is gathered beside the columns while points arrive, only where a measure is asked for, and forgotten when
//! the section is packed: the measure then stands in each record's 16 bits that are its intensity otherwise. Sums, minima
//! and sets: nothing depends on the order of points, and what is gathered of four sections makes that of the one around
//! them.

use super::ground::{self, Lowest};
use super::layout::{column_at, column_index};
use crate::attribute::{AboveScale, Channel, ClassMask, Record, Steps};
use crate::coords::{Grid, Height, SECTION_COLUMNS, SECTION_SIDE};
use crate::shared::payload::RUN_INTENSITY_SHIFT;
use crate::source::FLAG_WITHHELD;
use foldhash::fast::FixedState;
use std::collections::HashMap;

/// Columns on the sides of the squares that points are counted in, and differences of lines are told of.
pub const SQUARE: u32 = 1 << SQUARE_LOG2;
const SQUARE_LOG2: u32 = 2;
/// Squares on a section's side.
const SQUARES: usize = (SECTION_SIDE >> SQUARE_LOG2) as usize;

/// What is measured, and what its codes are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Measure {
    /// How far a record is above the ground below it, see `section::ground`, one more; below it: 1; where nothing is known of
    /// the ground: 0.
    AboveGround {
        /// Codes that a step of the lattice is.
        codes_a_step: f64,
        /// What stands on the ground is no wider, columns: where no class tells what is ground.
        reach: f64,
    },
    /// Points in the square of [`SQUARE`] columns each way around, over its area. 0: none.
    Density {
        /// Codes that one point is; 0: points tell nothing of densities.
        codes_a_point: f64,
    },
    /// How far flight lines are apart: of each column that several point source ids have seen, from the lowest to the
    /// highest of the lowest points of each; of those of a square of [`SQUARE`] columns each way the one in the middle (of an even
    /// number the lesser). Source ids stand in records in the place of intensities. 0: no column of the square was seen
    /// by several; else one more than the difference.
    LineDifference {
        /// Codes that a step of the lattice is.
        codes_a_step: f64,
    },
}

impl Measure {
    /// What `channel` takes of the sections of a level of `grid`; `None`: it is what records hold.
    pub fn of(channel: &Channel, grid: &Grid, level: u8) -> Option<Measure> {
        let cell = grid.cell() * f64::from(level).exp2();
        Some(match channel {
            Channel::AboveGround(AboveScale { unit, reach }) => {
                Measure::AboveGround { codes_a_step: grid.height_step / unit, reach: reach / cell }
            }
            Channel::Density(Steps { unit }) => {
                let side = f64::from(SQUARE) * cell;
                Measure::Density { codes_a_point: 1.0 / (side * side * unit) }
            }
            Channel::LineDifference(Steps { unit }) => {
                Measure::LineDifference { codes_a_step: grid.height_step / unit }
            }
            Channel::Intensity | Channel::SourceId | Channel::ScanAngle | Channel::GpsTime(_) => return None,
        })
    }

    /// The same of a few of the points.
    pub fn of_sample(self) -> Measure {
        match self {
            Measure::Density { .. } => Measure::Density { codes_a_point: 0.0 },
            other => other,
        }
    }
}

/// Whether a record counts: neither noise nor withheld.
#[inline]
fn counts(record: Record) -> bool {
    ClassMask::default().shows(record.class()) && record.flags() & FLAG_WITHHELD == 0
}

/// The 16 bits of a record that are its intensity, as a rule.
#[inline]
fn code_of(record: Record) -> u16 {
    (record.0[1] >> RUN_INTENSITY_SHIFT) as u16
}

/// The same record with others.
#[inline]
pub(super) fn with_code(record: Record, code: u16) -> Record {
    let [height, word, rest] = record.0;
    let mask = u32::from(u16::MAX) << RUN_INTENSITY_SHIFT;
    Record([height, word & !mask | u32::from(code) << RUN_INTENSITY_SHIFT, rest])
}

/// Square of a column.
#[inline]
fn square_of(column: u16) -> usize {
    let [x, y] = column_at(column);
    (y >> SQUARE_LOG2) as usize * SQUARES + (x >> SQUARE_LOG2) as usize
}

/// The lowest points of each line in each column.
pub(super) struct Lines {
    /// Of each column a line that has seen it, [`NO_LINE`] for none, and its lowest point: most columns have but one.
    firsts: Vec<(u32, i32)>,
    /// Of the others, by `line << 16 | column`.
    others: HashMap<u32, i32, FixedState>,
}

/// More than any id.
const NO_LINE: u32 = u32::MAX;

impl Lines {
    fn none() -> Lines {
        Lines { firsts: vec![(NO_LINE, 0); SECTION_COLUMNS], others: HashMap::default() }
    }

    #[inline]
    fn see(&mut self, column: u16, line: u16, low: i32) {
        let (first, lowest) = &mut self.firsts[usize::from(column)];
        if *first == u32::from(line) {
            *lowest = low.min(*lowest);
        } else if *first == NO_LINE {
            (*first, *lowest) = (line.into(), low);
        } else {
            let key = u32::from(line) << 16 | u32::from(column);
            let lowest = self.others.entry(key).or_insert(low);
            *lowest = low.min(*lowest);
        }
    }

    /// Bytes held: a byte beside each entry of the map tells whether there is one.
    fn bytes(&self) -> usize {
        size_of_val(&self.firsts[..]) + self.others.capacity() * (2 * size_of::<u32>() + 1)
    }

    /// Each line's lowest point in each column that it has seen, in any order.
    fn each(&self) -> impl Iterator<Item = (u16, u16, i32)> {
        let firsts = self.firsts.iter().enumerate().filter(|(_, (line, _))| *line != NO_LINE);
        let firsts = firsts.map(|(column, &(line, low))| (column as u16, line as u16, low));
        firsts.chain(self.others.iter().map(|(&key, &low)| (key as u16, (key >> 16) as u16, low)))
    }

    /// Of each square the differences of those columns that several lines have seen, steps: from the lowest of their lowest
    /// points to the highest.
    fn differences(&self) -> Vec<Vec<u32>> {
        let mut columns = vec![(i32::MAX, i32::MIN, 0u32); SECTION_COLUMNS];
        for (column, _, of) in self.each() {
            let (low, high, lines) = &mut columns[usize::from(column)];
            (*low, *high, *lines) = (of.min(*low), of.max(*high), *lines + 1);
        }
        let mut differences = vec![Vec::new(); SQUARES * SQUARES];
        for (column, (low, high, _)) in columns.into_iter().enumerate().filter(|(_, (.., lines))| *lines > 1)
        {
            differences[square_of(column as u16)].push(high.abs_diff(low));
        }
        differences
    }
}

/// What is gathered.
pub(super) enum Gathered {
    Lowest(Lowest),
    /// Points of each square.
    Counts(Vec<u64>),
    Lines(Lines),
}

/// A measure while points arrive.
pub(super) struct Measuring {
    pub(super) measure: Measure,
    gathered: Gathered,
}

impl Measuring {
    pub(super) fn new(measure: Measure) -> Measuring {
        let gathered = match measure {
            Measure::AboveGround { .. } => Gathered::Lowest(Lowest::none()),
            Measure::Density { .. } => Gathered::Counts(vec![0; SQUARES * SQUARES]),
            Measure::LineDifference { .. } => Gathered::Lines(Lines::none()),
        };
        Measuring { measure, gathered }
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        match &self.gathered {
            Gathered::Lowest(lowest) => lowest.bytes(),
            Gathered::Counts(counts) => size_of_val(&counts[..]),
            Gathered::Lines(lines) => lines.bytes(),
        }
    }

    /// A point of a column.
    #[inline]
    pub(super) fn see(&mut self, column: u16, height: Height, record: Record) {
        if !counts(record) {
            return;
        }
        match &mut self.gathered {
            Gathered::Lowest(lowest) => lowest.see(column, height.0, record.class()),
            Gathered::Counts(counts) => counts[square_of(column)] += 1,
            Gathered::Lines(lines) => lines.see(column, code_of(record), height.0),
        }
    }

    /// Puts what was gathered into that of the section around, of cells twice as wide; `of_parent`: its column that a
    /// column lies in.
    pub(super) fn coarsen_into(&self, parent: &mut Measuring, of_parent: impl Fn(u16) -> u16) {
        match (&self.gathered, &mut parent.gathered) {
            (Gathered::Lowest(fine), Gathered::Lowest(coarse)) => {
                fine.coarsen_into(coarse, of_parent);
            }
            (Gathered::Counts(fine), Gathered::Counts(coarse)) => {
                for (square, count) in fine.iter().enumerate() {
                    let [x, y] = [square % SQUARES, square / SQUARES].map(|at| (at as u32) << SQUARE_LOG2);
                    coarse[square_of(of_parent(column_index(x, y)))] += count;
                }
            }
            (Gathered::Lines(fine), Gathered::Lines(coarse)) => {
                fine.each().for_each(|(column, line, low)| coarse.see(of_parent(column), line, low));
            }
            _ => panic!("measures do not mix"),
        }
    }

    /// The codes of all records of the section, whose `records` are given one after the other with their columns.
    pub(super) fn finish(&self, records: impl FnOnce(&mut dyn FnMut(u16, Record))) -> Codes {
        match (self.measure, &self.gathered) {
            (Measure::AboveGround { codes_a_step, reach }, Gathered::Lowest(lowest)) => {
                Codes::Above { ground: ground::of(lowest, reach, records), codes_a_step }
            }
            (Measure::Density { codes_a_point }, Gathered::Counts(counts)) => {
                let code = |&n: &u64| match n {
                    0 => 0,
                    _ if codes_a_point == 0.0 => 0,
                    n => (n as f64 * codes_a_point).round().clamp(1.0, f64::from(u16::MAX)) as u16,
                };
                Codes::OfSquares(counts.iter().map(code).collect())
            }
            (Measure::LineDifference { codes_a_step }, Gathered::Lines(lines)) => {
                let code = |mut differences: Vec<u32>| {
                    let middle = differences.len().checked_sub(1)? / 2;
                    let (_, middle, _) = differences.select_nth_unstable(middle);
                    Some(one_more(f64::from(*middle) * codes_a_step))
                };
                Codes::OfSquares(lines.differences().into_iter().map(|of| code(of).unwrap_or(0)).collect())
            }
            _ => unreachable!("a measure gathers what it needs"),
        }
    }
}

/// The code of a length of so many: 0 is none.
fn one_more(codes: f64) -> u16 {
    codes.round().clamp(0.0, f64::from(u16::MAX) - 1.0) as u16 + 1
}

/// What a measure comes to.
pub(super) enum Codes {
    /// Ground below each column, lattice heights; NaN: nothing is known of it.
    Above { ground: Vec<f64>, codes_a_step: f64 },
    /// The code of each square.
    OfSquares(Vec<u16>),
}

impl Codes {
    /// That of a record of a column.
    pub(super) fn of(&self, column: u16, record: Record) -> u16 {
        match self {
            Codes::Above { ground, codes_a_step } => {
                let height = f64::from(record.height().map_or(0, |height| height.0));
                let steps = height - ground[usize::from(column)];
                if steps.is_nan() { 0 } else { one_more(steps * codes_a_step) }
            }
            Codes::OfSquares(codes) => codes[square_of(column)],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attribute::Attributes;
    use crate::coords::Stacking;
    use crate::section::{Columns, Surface};
    use proptest::prelude::*;

    const FINE: Stacking = Stacking { thickness: 8, slice_log2: 4, reach: 2 };
    const COARSE: Stacking = Stacking { thickness: 16, slice_log2: 5, reach: 1 };

    /// Column, and the record of a point of a line.
    type Point = ([u32; 2], Record);

    fn point(x: u32, y: u32, height: i32, class: u8, line: u16, flags: u8) -> Point {
        let height = Height(height);
        let a = Attributes { height, class, intensity: line, rgb: [1, 2, 3], returns: 0x11, flags };
        ([x, y], Record::pack(a))
    }

    fn columns(surface: Surface, stacking: Stacking, measure: Measure, points: &[Point]) -> Columns {
        let mut columns = Columns::new(surface, stacking).measuring(Some(measure));
        points.iter().for_each(|&([x, y], record)| columns.add(x, y, record));
        columns
    }

    /// Codes of all records, by column and height.
    fn codes(measure: Measure, points: &[Point]) -> Vec<([u32; 2], i32, u16)> {
        let mut columns = columns(Surface::Columns, FINE, measure, points);
        columns.finish_measure();
        let mut codes = Vec::new();
        columns.each_record(|column, record| {
            codes.push((column_at(column), record.height().unwrap().0, code_of(record)));
        });
        codes
    }

    /// Of the same records twice as coarse: places of the parent's cells, of the sections to the south-west and north-east.
    fn measures(level: u32) -> [Measure; 3] {
        let cells = f64::from(1u32 << level);
        [
            Measure::AboveGround { codes_a_step: 0.25, reach: 40.0 / cells },
            Measure::Density { codes_a_point: 64.0 / (cells * cells) },
            Measure::LineDifference { codes_a_step: 0.5 },
        ]
    }

    fn points() -> impl Strategy<Value = Vec<Point>> {
        let class = prop_oneof![Just(1u8), Just(2), Just(5), Just(7)];
        let flags = prop_oneof![9 => Just(0), 1 => Just(FLAG_WITHHELD)];
        let place = || prop_oneof![0u32..12, 100u32..108, 250u32..256];
        let one = (place(), place(), -500i32..500, class, 0u16..4, flags)
            .prop_map(|(x, y, height, class, line, flags)| point(x, y, height, class, line, flags));
        prop::collection::vec(one, 1..200)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        /// What is gathered of four sections makes that of the one around them, word for word, and nothing depends on order.
        #[test]
        fn coarse_sections_are_made_of_fine_ones(
            of_children in prop::array::uniform4(points()),
            floats in any::<bool>(),
        ) {
            let surface = if floats { Surface::Stacks } else { Surface::Columns };
            for (fine, coarse) in measures(0).into_iter().zip(measures(1)) {
                let mut from_children = Columns::new(surface, COARSE).measuring(Some(coarse));
                let mut from_points = Columns::new(surface, COARSE).measuring(Some(coarse));
                for (k, points) in of_children.iter().enumerate() {
                    let (i, j) = (k as u32 % 2, k as u32 / 2);
                    columns(surface, FINE, fine, points).coarsen_into(i as i32, j as i32, &mut from_children);
                    for &([x, y], record) in points.iter().rev() {
                        from_points.add(i * 128 + x / 2, j * 128 + y / 2, record);
                    }
                }
                from_children.finish_measure();
                from_points.finish_measure();
                prop_assert_eq!(from_children.pack().words, from_points.pack().words, "{:?}", coarse);
            }
        }

        /// A density is what a count of points says, at any level.
        #[test]
        fn densities_are_points_over_area(points in points(), level in 0u32..4) {
            let measure = measures(level)[1];
            let at_level: Vec<Point> =
                points.iter().map(|&([x, y], record)| ([x >> level, y >> level], record)).collect();
            for ([x, y], _, code) in codes(measure, &at_level) {
                let size = SQUARE << level;
                let (west, south) = (x / SQUARE * size, y / SQUARE * size);
                let inside = |at: u32, from: u32| (from..from + size).contains(&at);
                let n = points.iter().filter(|([x, y], record)| {
                    inside(*x, west) && inside(*y, south) && record.class() != 7 && record.flags() == 0
                });
                let area = f64::from(size * size);
                let per_cell = n.count() as f64 / area;
                // A code is a point in 64 · 16 finest cells.
                let plain = (per_cell * 1024.0).round();
                prop_assert!((f64::from(code) - plain).abs() <= 0.5001, "{} for {}", code, plain);
            }
        }
    }

    #[test]
    fn lines_that_are_apart_are_told_by_how_much() {
        let apart = Measure::LineDifference { codes_a_step: 0.25 };
        let mut points = Vec::new();
        for (x, y) in (0..16).flat_map(|x| (0..8).map(move |y| (x, y))) {
            // A slope of a column's width in 20, seen by two lines, the second 40 steps higher; noise counts nothing.
            let ground = 50 * x as i32;
            points.push(point(x, y, ground, 2, 17, 0));
            points.push(point(x, y, ground - 900, 7, 18, 0));
            if x < 8 {
                points.push(point(x, y, ground + 40, 2, 18, 0));
                // Something stands on the first line's ground.
                points.push(point(x, y, ground + 700, 5, 17, 0));
            }
        }
        for ([x, _], _, code) in codes(apart, &points) {
            assert_eq!(code, if x < 8 { 11 } else { 0 }, "column {x}");
        }
        // A column of a square that several have seen tells of all of it, and three lines are as far apart as the outer two.
        let three = [
            point(0, 0, 0, 2, 1, 0),
            point(0, 0, 30, 2, 2, 0),
            point(0, 0, 80, 2, 3, 0),
            point(3, 3, 900, 2, 1, 0),
        ];
        assert!(codes(apart, &three).iter().all(|(.., code)| *code == 21));
        // As far apart as codes go.
        let far = [point(0, 0, i32::MIN + 1, 2, 1, 0), point(0, 0, i32::MAX, 2, 2, 0)];
        assert!(codes(apart, &far).iter().all(|(.., code)| *code == u16::MAX));
    }

    /// Land that slopes, with a house on it and a tree, a tower beside.
    fn land(ground: u8, other: u8, slope: [f64; 2]) -> Vec<Point> {
        let mut points = Vec::new();
        for (x, y) in (0..256u32).flat_map(|x| (0..256u32).map(move |y| (x, y))) {
            let height = (slope[0] * f64::from(x) + slope[1] * f64::from(y)) as i32;
            let is_in = |west: u32, south: u32, side: u32| {
                (west..west + side).contains(&x) && (south..south + side).contains(&y)
            };
            if is_in(100, 60, 24) {
                points.push(point(x, y, height + 8_000, if other == 1 { 1 } else { 6 }, 1, 0));
            } else if is_in(30, 180, 3) {
                points.push(point(x, y, height + 60_000, other, 1, 0));
            } else {
                // A crown that lets one pulse of five through.
                let is_tree = is_in(200, 200, 20);
                if !is_tree || (x + 2 * y) % 5 == 0 {
                    points.push(point(x, y, height, ground, 1, 0));
                }
                if is_tree {
                    points.push(point(x, y, height + 12_000, other, 1, 0));
                }
            }
        }
        points
    }

    #[test]
    fn what_stands_on_a_slope_is_as_high_as_it_is_above_it() {
        let above = Measure::AboveGround { codes_a_step: 1.0 / 16.0, reach: 30.0 };
        for slope in [[0.0f64, 0.0], [120.0, -40.0], [-300.0, 500.0]] {
            for (ground, other, tolerance) in [(2, 5, 60.0), (1, 1, 400.0)] {
                for ([x, y], height, code) in codes(above, &land(ground, other, slope)) {
                    let of_ground = (slope[0] * f64::from(x) + slope[1] * f64::from(y)) as i32;
                    let (stands, told) = (height - of_ground, (f64::from(code) - 1.0) * 16.0);
                    let most = if stands > 0 {
                        tolerance + 1.5 * (slope[0].abs() + slope[1].abs())
                    } else {
                        tolerance
                    };
                    assert!(
                        (told - f64::from(stands)).abs() <= most,
                        "{x}, {y}: {told} for {stands}, slope {slope:?}, class {ground}"
                    );
                }
            }
        }
    }

    #[test]
    fn below_the_ground_it_is_0_and_without_any_unknown() {
        let above = Measure::AboveGround { codes_a_step: 1.0, reach: 30.0 };
        let square = |height: i32, class: u8| {
            (0..64u32).flat_map(move |x| (0..64u32).map(move |y| point(x, y, height, class, 1, 0)))
        };
        let mut pit: Vec<Point> = square(5_000, 2).collect();
        pit.push(point(70, 70, -900, 1, 1, 0));
        assert!(codes(above, &pit).iter().all(|(.., code)| *code == 1));
        // Noise alone says nothing of the ground.
        assert_eq!(codes(above, &[point(3, 3, 700, 7, 1, 0)])[0].2, 0);
        // Nor does a roof, or what lies on it: in its columns, and in some of their own.
        let mut roof: Vec<Point> = square(5_000, 6).collect();
        let on_it = |points: &[Point]| codes(above, points).into_iter().all(|(.., code)| code == 0);
        assert!(on_it(&roof));
        roof.extend((0..500).map(|k| point(k % 64, k / 64, 5_400, 1, 1, 0)));
        roof.extend((0..100).map(|k| point(100 + k % 10, 100 + k / 10, 5_300, 1, 1, 0)));
        assert!(on_it(&roof));
        // A little ground beside it does, classified or not; then what lies on it alone would be as good.
        for (class, width) in [(2, 1), (2, 7), (1, 24)] {
            let mut beside = roof.clone();
            beside.retain(|([x, _], _)| *x < 64 || class == 2);
            beside.extend((0..width * 10).map(|k| point(200 + k % 10, 200 + k / 10, 1_000, class, 1, 0)));
            for ([x, _], height, code) in codes(above, &beside).into_iter().filter(|([x, _], ..)| *x < 64) {
                assert_eq!(i32::from(code) - 1, height - 1_000, "{x}: class {class}, {width}");
            }
        }
    }

    #[test]
    fn a_hall_stands_on_the_ground_around_it() {
        let above = Measure::AboveGround { codes_a_step: 1.0, reach: 60.0 };
        // All of the section but a strip of fewer columns than classes are taken to tell the ground by.
        for (class, step) in [(2, 10), (2, 64)] {
            let mut points = Vec::new();
            for (x, y) in (0..256u32).flat_map(|x| (0..256u32).map(move |y| (x, y))) {
                let is_land = x == 0 && y % step == 0;
                let (height, class) = if is_land { (3_000, class) } else { (13_000, 6) };
                points.push(point(x, y, height, class, 1, 0));
            }
            for ([x, y], height, code) in codes(above, &points) {
                assert_eq!(i32::from(code) - 1, height - 3_000, "{x}, {y}");
            }
        }
    }

    #[test]
    fn many_lines_in_few_columns_are_gathered_quickly() {
        let begun = std::time::Instant::now();
        let mut lines = Lines::none();
        for k in 0..1_000_000u32 {
            let line = (k.wrapping_mul(2_654_435_761) >> 16) as u16;
            lines.see((k % 9) as u16, line, -((k % 1000) as i32));
        }
        let differences = lines.differences();
        // A chain of all lines a column took minutes.
        assert!(begun.elapsed().as_secs() < 10, "{:?}", begun.elapsed());
        assert!(differences[0].iter().all(|of| *of > 900) && !differences[0].is_empty());
    }
}
