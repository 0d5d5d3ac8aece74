//! Morphological openings by discs, whose chords are minima of rows of any length by doubling.

use super::lows::NONE;
use std::ops::Range;

/// A raster, `side` cells a row.
pub(super) type Raster = Vec<i32>;

/// Memory that openings reuse.
pub(super) struct Opening {
    side: usize,
    /// Of a row: the extreme of 1, 2, 4, … cells from each on.
    doubled: Vec<Vec<i32>>,
    chord: Vec<i32>,
    /// Between the two halves of an opening.
    between: Raster,
}

/// Half the chord of a disc of `radius` cells in the row `dy` from its middle; of 1 cell it is 3 × 3.
pub(super) fn half_chord(radius: usize, dy: usize) -> usize {
    if radius == 1 { 1 } else { (radius * radius - dy * dy).isqrt() }
}

fn around(range: &Range<usize>, cells: usize) -> Range<usize> {
    range.start - cells..range.end + cells
}

impl Opening {
    pub fn new(side: usize, widest: usize) -> Opening {
        let levels = (2 * widest + 1).ilog2() as usize + 1;
        Opening {
            side,
            doubled: vec![vec![0; side]; levels],
            chord: vec![0; side],
            between: vec![0; side * side],
        }
    }

    /// The opening of `heights` by a disc of `radius` cells, in the rows and columns of `range`, in `opened`. Cells of
    /// [`NONE`] are no part of it: a disc covers what is left of it there, and its middle lies on none. Reads twice `radius`
    /// around `range`.
    pub fn open(&mut self, heights: &[i32], radius: usize, range: Range<usize>, opened: &mut [i32]) {
        let mut eroded = std::mem::take(&mut self.between);
        // What is none is above everything.
        self.spread(heights, radius, around(&range, radius), i32::min, &mut eroded);
        self.leave_out(heights, i32::MIN, around(&range, radius), &mut eroded);
        self.spread(&eroded, radius, range, i32::max, opened);
        self.between = eroded;
    }

    /// The closing by 3 × 3 cells, likewise.
    pub fn close_by_one(&mut self, heights: &[i32], range: Range<usize>, closed: &mut [i32]) {
        let mut dilated = std::mem::take(&mut self.between);
        let highest = |a: i32, b: i32| match (a, b) {
            (NONE, other) | (other, NONE) => other,
            (a, b) => a.max(b),
        };
        self.spread(heights, 1, around(&range, 1), highest, &mut dilated);
        self.leave_out(heights, i32::MAX, around(&range, 1), &mut dilated);
        self.spread(&dilated, 1, range, i32::min, closed);
        self.between = dilated;
    }

    /// Nothing has its middle where there is none.
    fn leave_out(&self, heights: &[i32], neutral: i32, range: Range<usize>, spread: &mut [i32]) {
        for y in range.clone() {
            let row = y * self.side + range.start..y * self.side + range.end;
            for (spread, &height) in spread[row.clone()].iter_mut().zip(&heights[row]) {
                *spread = if height == NONE { neutral } else { *spread };
            }
        }
    }

    /// The extreme of the disc around each cell of `range`.
    fn spread(
        &mut self,
        from: &[i32],
        radius: usize,
        range: Range<usize>,
        extreme: impl Fn(i32, i32) -> i32 + Copy,
        to: &mut [i32],
    ) {
        let (side, width) = (self.side, range.len());
        for y in around(&range, radius) {
            let row = &from[y * side + range.start - radius..y * side + range.end + radius];
            self.double(row, radius, extreme);
            let mut half = usize::MAX;
            for dy in (0..=radius).rev() {
                let wanted = half_chord(radius, dy);
                if wanted != half {
                    half = wanted;
                    let level = (2 * half + 1).ilog2() as usize;
                    let first = &self.doubled[level][radius - half..][..width];
                    let last = &self.doubled[level][radius + half + 1 - (1 << level)..][..width];
                    let pairs = first.iter().zip(last);
                    self.chord[..width].iter_mut().zip(pairs).for_each(|(to, (a, b))| *to = extreme(*a, *b));
                }
                let chord = &self.chord[..width];
                let row_of = |y: usize| y * side + range.start..y * side + range.end;
                // Rows are met from below: what lies farthest above is met first.
                if range.contains(&(y + dy)) {
                    let to = &mut to[row_of(y + dy)];
                    if dy == radius {
                        to.copy_from_slice(chord);
                    } else {
                        to.iter_mut().zip(chord).for_each(|(to, from)| *to = extreme(*to, *from));
                    }
                }
                if dy > 0 && y >= dy && range.contains(&(y - dy)) {
                    let to = &mut to[row_of(y - dy)];
                    to.iter_mut().zip(chord).for_each(|(to, from)| *to = extreme(*to, *from));
                }
            }
        }
    }

    fn double(&mut self, row: &[i32], radius: usize, extreme: impl Fn(i32, i32) -> i32 + Copy) {
        self.doubled[0][..row.len()].copy_from_slice(row);
        for level in 1..=(2 * radius + 1).ilog2() as usize {
            let (finer, coarser) = self.doubled.split_at_mut(level);
            let (finer, step) = (&finer[level - 1], 1 << (level - 1));
            let pairs = finer[..row.len() - step].iter().zip(&finer[step..row.len()]);
            coarser[0].iter_mut().zip(pairs).for_each(|(to, (a, b))| *to = extreme(*a, *b));
        }
    }
}
