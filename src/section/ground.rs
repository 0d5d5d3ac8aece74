//! The ground below a section's columns, from its own points alone.
//!
//! Where classes tell what is ground (ground, water, rails, roads), it is the highest such record of each column, and
//! between those what push-pull fills in (Gortler et al. 1996, section 3.4.2). Elsewhere it is a low surface: nodes as wide
//! as what may stand on the ground, each the low of what its columns rise above the surface of nodes twice as wide, so that slopes
//! are slopes and no steps. Roofs, and what lies on them, are no part of that: where there is nothing else, the ground is not known.

use super::layout::column_at;
use crate::attribute::{Record, is_always_solid};
use crate::coords::{SECTION_COLUMNS, SECTION_SIDE};
use crate::source::FLAG_WITHHELD;

const SIDE: usize = SECTION_SIDE as usize;

/// Classes that are ground, or as good as that: ground, water, rails, roads, water of bathymetric scans.
const GROUND: [u8; 5] = [2, 9, 10, 11, 41];
/// Columns with ground from which on classes are taken to tell it.
const ENOUGH: usize = 32;
/// Share of a node's columns that are below its low; where fewer of them are no roofs, it has none.
const LOW: f64 = 0.05;
/// Columns of a node that say anything of it.
const FEW: usize = 4;
/// Most nodes on a side.
const MOST_NODES: usize = 32;

/// Lowest points of each column; none: `i32::MAX`.
pub(super) struct Lowest {
    /// Of roofs: what is as solid as the ground, and is none.
    roofs: Vec<i32>,
    /// Of all else.
    others: Vec<i32>,
}

/// What a column says of the ground.
#[derive(Clone, Copy, PartialEq)]
enum Low {
    Nothing,
    /// It is roofs, and what lies on them.
    Roof,
    At(i32),
}

impl Lowest {
    pub(super) fn none() -> Lowest {
        Lowest { roofs: vec![i32::MAX; SECTION_COLUMNS], others: vec![i32::MAX; SECTION_COLUMNS] }
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&self.roofs[..]) + size_of_val(&self.others[..])
    }

    #[inline]
    pub(super) fn see(&mut self, column: u16, height: i32, class: u8) {
        let is_roof = is_always_solid(class) && !GROUND.contains(&class);
        let lows = if is_roof { &mut self.roofs } else { &mut self.others };
        let lowest = &mut lows[usize::from(column)];
        *lowest = height.min(*lowest);
    }

    /// Puts them into those of the section around; `of_parent`: its column that a column lies in.
    pub(super) fn coarsen_into(&self, coarse: &mut Lowest, of_parent: impl Fn(u16) -> u16) {
        for (fine, coarse) in [(&self.roofs, &mut coarse.roofs), (&self.others, &mut coarse.others)] {
            for (column, low) in fine.iter().enumerate() {
                let lowest = &mut coarse[usize::from(of_parent(column as u16))];
                *lowest = (*low).min(*lowest);
            }
        }
    }

    fn of_column(&self, column: u16) -> Low {
        match (self.others[usize::from(column)], self.roofs[usize::from(column)]) {
            (i32::MAX, i32::MAX) => Low::Nothing,
            (other, roof) if other < roof => Low::At(other),
            _ => Low::Roof,
        }
    }
}

/// Height of the ground below each column (by its index), lattice steps; NaN where nothing is known of it. `reach`: what stands on it is no wider, columns.
pub(super) fn of(lowest: &Lowest, reach: f64, records: impl FnOnce(&mut dyn FnMut(u16, Record))) -> Vec<f64> {
    let mut known = vec![f64::NAN; SECTION_COLUMNS];
    let mut columns = 0;
    records(&mut |column, record| {
        let Some(height) = record.height().filter(|_| record.flags() & FLAG_WITHHELD == 0) else { return };
        if GROUND.contains(&record.class()) {
            let ground = &mut known[row_by_row(column)];
            columns += usize::from(ground.is_nan());
            // NaN is no maximum.
            *ground = ground.max(height.0.into());
        }
    });
    let ground = match columns {
        ENOUGH.. => filled(known),
        // A little ground says more than none.
        _ => low_surface(lowest, reach).unwrap_or_else(|| filled(known)),
    };
    (0..SECTION_COLUMNS).map(|column| ground[row_by_row(column as u16)]).collect()
}

fn row_by_row(column: u16) -> usize {
    let [x, y] = column_at(column);
    y as usize * SIDE + x as usize
}

/// Where `at` (nodes, the first in the middle at 0) lies between nodes of which there are `nodes`: the first of two, and how far
/// beyond it.
fn between(at: f64, nodes: usize) -> (usize, f64) {
    let first = at.floor().clamp(0.0, (nodes.max(2) - 2) as f64);
    (first as usize, at - first)
}

/// Values of nodes, `side` each way, row by row: bilinear at (x, y).
fn bilinear(nodes: &[f64], side: usize, (i, beyond_x): (usize, f64), (j, beyond_y): (usize, f64)) -> f64 {
    let next = usize::from(side > 1);
    let row = |j: usize| {
        let [a, b] = [nodes[j * side + i], nodes[j * side + i + next]];
        a + (b - a) * beyond_x
    };
    let [south, north] = [row(j), row(j + next)];
    south + (north - south) * beyond_y
}

/// Fills what is NaN of a square of values: push-pull.
fn filled(values: Vec<f64>) -> Vec<f64> {
    let mut levels = vec![(SIDE, values)];
    while let Some((side, fine)) = levels.last().filter(|(side, _)| *side > 1) {
        let half = side / 2;
        let mean = |k: usize| {
            let [x, y] = [k % half * 2, k / half * 2];
            let four = [0, 1, *side, side + 1].map(|off| fine[y * side + x + off]);
            let known = four.iter().filter(|v| !v.is_nan());
            let (sum, n) = known.fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
            // Of none it is NaN.
            sum / n
        };
        let coarse = (half, (0..half * half).map(mean).collect());
        levels.push(coarse);
    }
    let (mut side, mut coarse) = levels.pop().expect("there is one");
    while let Some((fine_side, mut fine)) = levels.pop() {
        for (k, value) in fine.iter_mut().enumerate().filter(|(_, value)| value.is_nan()) {
            let last = (side - 1) as f64;
            let [x, y] = [k % fine_side, k / fine_side].map(|at| {
                // Nothing is known beyond the section.
                between((at as f64 * 0.5 - 0.25).clamp(0.0, last), side)
            });
            *value = bilinear(&coarse, side, x, y);
        }
        (side, coarse) = (fine_side, fine);
    }
    coarse
}

/// The low surface of the lowest points; `None`: too few of them are no roofs.
fn low_surface(lowest: &Lowest, reach: f64) -> Option<Vec<f64>> {
    let mut heights = vec![f64::NAN; SECTION_COLUMNS];
    let mut roofs = vec![false; SECTION_COLUMNS];
    for column in 0..SECTION_COLUMNS {
        let at = row_by_row(column as u16);
        match lowest.of_column(column as u16) {
            Low::Nothing => {}
            Low::Roof => roofs[at] = true,
            Low::At(low) => heights[at] = low.into(),
        }
    }
    // Where a section is covered in part, nodes without columns have its slope.
    let mut surface = plane(&heights);
    let mut nodes = 1;
    loop {
        let width = SIDE / nodes;
        let mut lows = lows((&heights, &roofs), &surface, nodes);
        if lows.iter().all(|low| low.is_nan()) {
            if nodes == 1 {
                return None;
            }
            // As fine as there are enough.
            break;
        }
        fill_around(&mut lows, nodes);
        for (k, height) in surface.iter_mut().enumerate() {
            let place = |at: usize| between((at as f64 + 0.5) / width as f64 - 0.5, nodes);
            *height += bilinear(&lows, nodes, place(k % SIDE), place(k / SIDE));
        }
        if nodes == MOST_NODES || (width / 2) as f64 <= reach {
            break;
        }
        nodes *= 2;
    }
    // The records of a sloping column are higher than its lowest point.
    let rise = |k: usize| {
        let (x, y) = (k % SIDE, k / SIDE);
        let slope = |a: usize, b: usize, n: usize| (surface[a] - surface[b]).abs() / n as f64;
        let [west, east] = [x.saturating_sub(1), (x + 1).min(SIDE - 1)];
        let [south, north] = [y.saturating_sub(1), (y + 1).min(SIDE - 1)];
        slope(y * SIDE + west, y * SIDE + east, east - west)
            + slope(south * SIDE + x, north * SIDE + x, north - south)
    };
    Some((0..SECTION_COLUMNS).map(|k| surface[k] + rise(k)).collect())
}

/// The plane that fits heights best, row by row; flat where they lie in a line.
fn plane(heights: &[f64]) -> Vec<f64> {
    let middle = (SIDE / 2) as f64;
    let place = |k: usize| ((k % SIDE) as f64 - middle, (k / SIDE) as f64 - middle);
    let known = || (0..SECTION_COLUMNS).filter(|&k| !heights[k].is_nan());
    let n = known().count().max(1) as f64;
    let mean = |of: &dyn Fn(usize) -> f64| known().map(of).sum::<f64>() / n;
    let (x0, y0) = (mean(&|k| place(k).0), mean(&|k| place(k).1));
    let z0 = mean(&|k| heights[k]);
    let (mut xx, mut xy, mut yy, mut xz, mut yz) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for k in known() {
        let (x, y, z) = (place(k).0 - x0, place(k).1 - y0, heights[k] - z0);
        (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
        (xz, yz) = (xz + x * z, yz + y * z);
    }
    let det = xx * yy - xy * xy;
    let is_flat = det <= 1e-3 * (xx + yy) * (xx + yy);
    let slope = if is_flat { (0.0, 0.0) } else { ((yy * xz - xy * yz) / det, (xx * yz - xy * xz) / det) };
    (0..SECTION_COLUMNS).map(|k| z0 + slope.0 * (place(k).0 - x0) + slope.1 * (place(k).1 - y0)).collect()
}

/// The low of each node's columns above `surface`; NaN where there are few, or hardly any beside those of roofs.
fn lows((heights, roofs): (&[f64], &[bool]), surface: &[f64], nodes: usize) -> Vec<f64> {
    let width = SIDE / nodes;
    let low = |node: usize| {
        let (west, south) = (node % nodes * width, node / nodes * width);
        let places = || (0..width * width).map(|k| (south + k / width) * SIDE + west + k % width);
        let mut above: Vec<f64> =
            places().map(|at| heights[at] - surface[at]).filter(|above| !above.is_nan()).collect();
        let all = above.len() + places().filter(|at| roofs[*at]).count();
        if above.len() < FEW.min(width * width) || (above.len() as f64) < LOW * all as f64 {
            return f64::NAN;
        }
        let at = (LOW * (above.len() - 1) as f64).round() as usize;
        *above.select_nth_unstable_by(at, f64::total_cmp).1
    };
    (0..nodes * nodes).map(low).collect()
}

/// Fills nodes that are NaN from those around, ring by ring; there is one that is not.
fn fill_around(nodes: &mut [f64], side: usize) {
    while nodes.iter().any(|v| v.is_nan()) {
        let before = nodes.to_vec();
        for (k, value) in nodes.iter_mut().enumerate().filter(|(_, value)| value.is_nan()) {
            let (x, y) = ((k % side) as isize, (k / side) as isize);
            let near = (0..9).map(|n| (x + n % 3 - 1, y + n / 3 - 1)).filter_map(|(x, y)| {
                let inside = (0..side as isize).contains(&x) && (0..side as isize).contains(&y);
                inside.then(|| before[y as usize * side + x as usize]).filter(|v| !v.is_nan())
            });
            let (sum, n) = near.fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
            *value = sum / n;
        }
    }
}
