//! Which cells of a tile are roofs: what stands more than 2 m above the ground, is planar, and covers more than 10 m².
//!
//! Made of 3 × 3 tiles of stage 1 and of the ground, and of nothing else; whatever lies farther than [`AROUND`] cells from the
//! tile changes nothing. Lowest points of a roof's cells lie on the roof, those of a crown anywhere in it or below.

use super::grid::{GroundGrid, TILE_CELLS, TILE_SIDE};
use super::lows::{LowTile, NONE};
use super::tile::GroundTile;

/// Least height above the ground, m.
const HEIGHT_M: f64 = 2.0;
/// Least area, m².
const AREA_M2: f64 = 10.0;
/// So many cells at most, of a metre at least.
const MOST_CELLS: usize = AREA_M2 as usize + 1;
/// How far from a plane the cells of a window lie, root mean square, m; and how much farther per unit of its slope, since the
/// lowest point is anywhere in its cell.
const ROUGH_M: f64 = 0.15;
const ROUGH_OF_SLOPE_M: f64 = 0.25;
/// Cells of a window of 3 × 3 that it has to have, and that a pulse with a single return has to have hit.
const FIT: usize = 6;
/// Heights in a window differ by no more, steps: what does is no plane, and squares stay whole numbers.
const MOST_STEPS: i64 = 1 << 22;

/// Cells around a tile that it depends on: what is connected, and two windows.
const AROUND: usize = MOST_CELLS + 2;
const SIDE: usize = TILE_SIDE + 2 * AROUND;
const _: () = assert!(AROUND <= TILE_SIDE);

/// Which cells of the tile in the middle are roofs, row by row from the south-west. `lows`, `grounds`: the 3 × 3 tiles around
/// it, row by row from the south-west.
pub fn roofs(
    ground: &GroundGrid,
    lows: [Option<&LowTile>; 9],
    grounds: [Option<&GroundTile>; 9],
) -> Vec<bool> {
    let (heights, is_single) = load(ground, lows, grounds);
    let fits = fitting(ground, &heights, &is_single);
    // A cell is planar that lies in a window that is: those of ridges and eaves lie beside some that are not.
    let mut planar = vec![false; SIDE * SIDE];
    for (x, y) in inner(1) {
        if fits[y * SIDE + x] {
            for at in window(x, y) {
                planar[at] |= heights[at] != NONE;
            }
        }
    }
    let cell_m2 = (ground.cell() / ground.metre).powi(2);
    let least = ((AREA_M2 / cell_m2).floor() as usize + 1).min(MOST_CELLS);
    keep_large(&mut planar, least);
    let cells = (0..TILE_CELLS).map(|cell| (cell % TILE_SIDE + AROUND, cell / TILE_SIDE + AROUND));
    cells.map(|(x, y)| planar[y * SIDE + x]).collect()
}

/// Places of the raster, but for so many cells at its border.
fn inner(border: usize) -> impl Iterator<Item = (usize, usize)> {
    let inside = border..SIDE - border;
    inside.clone().flat_map(move |y| inside.clone().map(move |x| (x, y)))
}

/// The 3 × 3 cells around a place, row by row.
fn window(x: usize, y: usize) -> impl Iterator<Item = usize> {
    (y - 1..=y + 1).flat_map(move |y| (x - 1..=x + 1).map(move |x| y * SIDE + x))
}

/// Lowest points that are high above the ground, and where a pulse had a single return.
fn load(
    ground: &GroundGrid,
    lows: [Option<&LowTile>; 9],
    grounds: [Option<&GroundTile>; 9],
) -> (Vec<i32>, Vec<bool>) {
    let most = i64::from(ground.steps(HEIGHT_M * ground.metre));
    let (mut heights, mut is_single) = (vec![NONE; SIDE * SIDE], vec![false; SIDE * SIDE]);
    for (x, y) in inner(0) {
        // From the south-western corner of the nine.
        let [column, row] = [x, y].map(|v| v + TILE_SIDE - AROUND);
        let tile = row / TILE_SIDE * 3 + column / TILE_SIDE;
        let (Some(low), Some(bare)) = (lows[tile], grounds[tile]) else { continue };
        let [column, row] = [column, row].map(|v| v % TILE_SIDE);
        let height = low.lowest()[row * TILE_SIDE + column];
        if height != NONE
            && let Some(bare) = bare.height([column as i32, row as i32])
            && i64::from(height) - i64::from(bare) > most
        {
            heights[y * SIDE + x] = height;
            is_single[y * SIDE + x] = low.has_only_return(row * TILE_SIDE + column);
        }
    }
    (heights, is_single)
}

/// Places whose window lies in a plane.
fn fitting(ground: &GroundGrid, heights: &[i32], is_single: &[bool]) -> Vec<bool> {
    let mut fits = vec![false; SIDE * SIDE];
    let metre = ground.metre / ground.grid.height_step;
    let cell_m = ground.cell() / ground.metre;
    for (x, y) in inner(1) {
        let middle = heights[y * SIDE + x];
        if middle == NONE || window(x, y).filter(|&at| is_single[at]).count() < FIT {
            continue;
        }
        let mut points = [[0i64; 3]; 9];
        let (mut n, mut is_near) = (0, true);
        for (k, at) in window(x, y).enumerate() {
            if heights[at] != NONE {
                let rise = i64::from(heights[at]) - i64::from(middle);
                is_near &= rise.abs() <= MOST_STEPS;
                points[n] = [k as i64 % 3 - 1, k as i64 / 3 - 1, rise];
                n += 1;
            }
        }
        if n >= FIT && is_near {
            let (square, slope) = plane(&points[..n]);
            let most = ROUGH_M + ROUGH_OF_SLOPE_M * slope / (metre * cell_m);
            fits[y * SIDE + x] = square.sqrt() <= most * metre;
        }
    }
    fits
}

/// Mean square of what points (cells, cells, steps) are off the plane that fits them best, per degree of freedom, and its slope, steps
/// a cell. Six of a window of 3 × 3 are not in a line.
fn plane(points: &[[i64; 3]]) -> (f64, f64) {
    let sum = |of: &dyn Fn(&[i64; 3]) -> i64| points.iter().map(of).sum::<i64>();
    let n = points.len() as i64;
    let [x, y, z] = [0, 1, 2].map(|axis| sum(&|p| p[axis]));
    // Moments about the middle, n² times: whole numbers.
    let moment = |a: usize, b: usize, of_a: i64, of_b: i64| (n * sum(&|p| p[a] * p[b]) - of_a * of_b) as f64;
    let (xx, xy, yy) = (moment(0, 0, x, x), moment(0, 1, x, y), moment(1, 1, y, y));
    let (xz, yz, zz) = (moment(0, 2, x, z), moment(1, 2, y, z), moment(2, 2, z, z));
    let det = xx * yy - xy * xy;
    let [east, north] = [(yy * xz - xy * yz) / det, (xx * yz - xy * xz) / det];
    let rest = (zz - east * xz - north * yz).max(0.0) / n as f64;
    (rest / (n - 3) as f64, (east * east + north * north).sqrt())
}

/// Clears what is connected, side by side, in fewer than `least` cells. What reaches the border of the raster from the tile is
/// longer than that.
fn keep_large(cells: &mut [bool], least: usize) {
    let mut seen = vec![false; cells.len()];
    let mut part = Vec::new();
    for (x, y) in inner(0) {
        let first = y * SIDE + x;
        if !cells[first] || seen[first] {
            continue;
        }
        part.clear();
        part.push(first);
        seen[first] = true;
        let mut next = 0;
        while let Some(&at) = part.get(next) {
            next += 1;
            let (x, y) = (at % SIDE, at / SIDE);
            let beside = [
                (x > 0).then(|| at - 1),
                (x + 1 < SIDE).then(|| at + 1),
                (y > 0).then(|| at - SIDE),
                (y + 1 < SIDE).then(|| at + SIDE),
            ];
            for at in beside.into_iter().flatten() {
                if cells[at] && !seen[at] {
                    seen[at] = true;
                    part.push(at);
                }
            }
        }
        if part.len() < least {
            part.iter().for_each(|&at| cells[at] = false);
        }
    }
}
