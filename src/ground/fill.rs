//! Fills cells of a raster from known ones around: of each octant the nearest within [`REACH`] cells, weighed by 1 / d².
//!
//! Known cells are bits, a row in words, so that a row's nearest on either side is a count of zeros: a cell takes at most 41
//! rows, whatever lies around.

use super::lows::NONE;
use std::ops::Range;

/// How far away a cell may be that fills another, cells.
pub(super) const REACH: usize = 20;
/// Weight of a cell one away; others have it over their squared distance.
const UNIT: i64 = 1 << 24;

/// Rows of bits, one a cell.
pub(super) struct Bits {
    /// Words of a row: one of none, those of its cells, one of none, so that 64 cells can be read around each.
    row: usize,
    words: Vec<u64>,
}

impl Bits {
    pub fn new(side: usize) -> Bits {
        let row = side.div_ceil(64) + 2;
        Bits { row, words: vec![0; row * side] }
    }

    /// Those of rows, where `is_set` says so, cell by cell.
    pub fn set_row(&mut self, y: usize, is_set: impl Iterator<Item = bool>) {
        let row = &mut self.words[y * self.row..(y + 1) * self.row];
        row.fill(0);
        for (x, is_set) in is_set.enumerate() {
            row[x / 64 + 1] |= u64::from(is_set) << (x % 64);
        }
    }

    #[inline]
    pub fn has(&self, x: usize, y: usize) -> bool {
        self.words[y * self.row + x / 64 + 1] >> (x % 64) & 1 != 0
    }

    pub fn set(&mut self, x: usize, y: usize) {
        self.words[y * self.row + x / 64 + 1] |= 1 << (x % 64);
    }

    pub fn clear_all(&mut self) {
        self.words.fill(0);
    }

    #[inline]
    pub fn clear(&mut self, x: usize, y: usize) {
        self.words[y * self.row + x / 64 + 1] &= !(1 << (x % 64));
    }

    /// Clears those of `other`.
    pub fn take_out(&mut self, other: &Bits) {
        self.words.iter_mut().zip(&other.words).for_each(|(to, from)| *to &= !from);
    }

    /// Sets those of `other`.
    pub fn put_in(&mut self, other: &Bits) {
        self.words.iter_mut().zip(&other.words).for_each(|(to, from)| *to |= from);
    }

    /// Whether a bit lies within [`REACH`] columns of `x`.
    fn has_near(&self, x: usize, y: usize) -> bool {
        let [east, west] = self.sides(x, y);
        east << (63 - REACH) != 0 || west >> (63 - REACH) != 0
    }

    /// Each row with all that lie within [`REACH`] rows of it.
    fn spread_over_rows(&self) -> Bits {
        let mut spread = Bits { row: self.row, words: self.words.clone() };
        for rows in 1..=REACH {
            let words = self.words.len().saturating_sub(rows * self.row);
            let step = rows * self.row;
            spread.words[..words].iter_mut().zip(&self.words[step..]).for_each(|(to, from)| *to |= from);
            spread.words[step..].iter_mut().zip(&self.words[..words]).for_each(|(to, from)| *to |= from);
        }
        spread
    }

    /// Row `y` from `x` on: to the east from bit 0 up, to the west from bit 63 down.
    #[inline]
    fn sides(&self, x: usize, y: usize) -> [u64; 2] {
        let (at, shift) = (y * self.row + x / 64, x % 64);
        let [before, here, behind] = [0, 1, 2].map(|k| self.words[at + k]);
        [here >> shift | behind << 1 << (63 - shift), here << (63 - shift) | before >> 1 >> shift]
    }
}

/// How far a row `dy` away reaches within the circle.
const ALONG: [usize; REACH + 1] = {
    let mut along = [0; REACH + 1];
    let mut dy = 0;
    while dy <= REACH {
        along[dy] = (REACH * REACH - dy * dy).isqrt();
        dy += 1;
    }
    along
};

/// Square of a distance beyond reach.
const FAR: u32 = (REACH * REACH) as u32 + 1;

/// The nearest known cell of an octant: squared distance, and where it is from the cell.
#[derive(Clone, Copy)]
struct Nearest {
    square: u32,
    offset: [i32; 2],
}

/// Of each octant, counterclockwise from east, with its first border and without its second: the nearest known cell around
/// (x, y). Of two that are equally far, the one in the nearer row.
#[inline]
fn nearest(known: &Bits, x: usize, y: usize) -> [Nearest; 8] {
    let mut found = [Nearest { square: FAR, offset: [0; 2] }; 8];
    // The nearest of a side that is at least `from` and less than `end` columns away.
    let mut take = |octant: usize, columns: u32, end: usize, [dx, dy]: [i32; 2]| {
        if columns < end as u32 {
            let columns = columns as i32;
            let square = (columns * columns + dy * dy) as u32;
            if square < found[octant].square {
                found[octant] = Nearest { square, offset: [dx * columns, dy] };
            }
        }
        found[octant].square
    };
    let east_of = |side: u64, from: usize| (side >> from).trailing_zeros() + from as u32;
    let west_of = |side: u64, from: usize| (side << from).leading_zeros() + from as u32;
    let [east, west] = known.sides(x, y);
    take(0, east_of(east, 1), REACH + 1, [1, 0]);
    take(4, west_of(west, 1), REACH + 1, [-1, 0]);
    // Of octants that rows meet first, and of those that they meet at their diagonals.
    let (mut steep, mut flat) = (FAR, FAR);
    for (dy, along) in ALONG.into_iter().enumerate().skip(1) {
        let (square, end) = ((dy * dy) as u32, along + 1);
        let (north, south) = (dy as i32, -(dy as i32));
        let (is_steep, is_flat) = (square < steep, 2 * square < flat);
        if !is_steep && !is_flat {
            break;
        }
        let [east, west] = known.sides(x, y + dy);
        let [south_east, south_west] = known.sides(x, y - dy);
        if is_steep {
            let first = take(1, east_of(east, 1), end.min(dy + 1), [1, north]);
            let second = take(2, west_of(west, 0), end.min(dy), [-1, north]);
            let third = take(5, west_of(south_west, 1), end.min(dy + 1), [-1, south]);
            let fourth = take(6, east_of(south_east, 0), end.min(dy), [1, south]);
            steep = first.max(second).max(third.max(fourth));
        }
        if is_flat {
            let first = take(0, east_of(east, dy + 1), end, [1, north]);
            let second = take(3, west_of(west, dy), end, [-1, north]);
            let third = take(4, west_of(south_west, dy + 1), end, [-1, south]);
            let fourth = take(7, east_of(south_east, dy), end, [1, south]);
            flat = first.max(second).max(third.max(fourth));
        }
    }
    found
}

/// Fills those cells of `heights` (`side` a row) in the columns and rows of `range` that are not `known`, where known cells
/// lie in at least `octants` of the eight; the others become [`NONE`]. Known ones stay as they are, and so do those that
/// are not within [`REACH`] rows and columns of one of `changed`. Within [`REACH`] cells of `range` there are bits.
pub(super) fn fill(
    heights: &mut [i32],
    side: usize,
    [known, changed]: [&Bits; 2],
    range: Range<usize>,
    octants: usize,
) {
    let changed = changed.spread_over_rows();
    for y in range.clone() {
        for x in range.clone().filter(|&x| changed.has_near(x, y) && !known.has(x, y)) {
            heights[y * side + x] = filled(heights, side, known, [x, y], octants);
        }
    }
}

#[inline]
fn filled(heights: &[i32], side: usize, known: &Bits, [x, y]: [usize; 2], octants: usize) -> i32 {
    let (mut sum, mut weights, mut count) = (0i64, 0i64, 0);
    for Nearest { square, offset: [dx, dy] } in nearest(known, x, y) {
        if square != FAR {
            let at = (y as i32 + dy) as usize * side + (x as i32 + dx) as usize;
            let weight = UNIT / i64::from(square);
            sum += weight * i64::from(heights[at]);
            weights += weight;
            count += 1;
        }
    }
    // The nearest step, of two the higher.
    if count >= octants { (2 * sum + weights).div_euclid(2 * weights) as i32 } else { NONE }
}
