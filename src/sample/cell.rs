//! The automatic cell size: as fine as the points allow without holes.

use std::collections::HashMap;

/// A void in which a square of this many cells a side fits is no footprint (a lake, the outside).
const VOID_CELLS: usize = 13;
/// Points a cell holds on average at the finest size that is thought of. Less than 1, so that densities of 1, 4
/// or 16 points a unit, which surveys are planned for, lie on one side of it.
const LEAST_POINTS: f64 = 0.8;
/// With fewer holes than this share of the footprint's cells left open by the bridges that pictures make over
/// gaps of four cells, cells are coarse enough.
const OPEN_HOLES: f64 = 0.03;
/// With more holes than this share, bridged or not, larger cells are worth it in any case. 3 %, as for pictures
/// without bridges, chose cells of 1 m for a suburb and 2 m for a city that read well at half of that.
const HOLES: f64 = 0.50;
/// Longest gap that pictures bridge, cells.
const BRIDGE: usize = 4;
/// log2 of the finest cell that is thought of. A broken header may put all points within 1e-312 units: cells would
/// be halved until they are 0, without end.
const FINEST_LOG2: f64 = -40.0;
/// Most doublings from the size at which there is one point a cell.
const DOUBLINGS: u32 = 3;

/// The choice, with what it rests on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellChoice {
    /// Side of a cell, CRS units; a power of two.
    pub cell: f64,
    /// Points of different E, N in a square unit of the footprint.
    pub density: f64,
    /// Share of the footprint's cells that hold a point.
    pub coverage: f64,
}

/// Points of one place, complete for one pass over it.
#[derive(Clone, Debug, Default)]
pub struct GroundPatch {
    /// E, N; no two alike.
    pub points: Vec<[f64; 2]>,
    /// How many such passes (overlapping flight lines, other parts of the file) cover the ground on
    /// average; 1 where the patch holds everything that lies there.
    pub passes: f64,
}

/// Chooses from what `patches` show; `finest` (the step of the coordinates) is a lower bound. Without an
/// extent to go by (no point, one point) the cell is 1 unit and the density 0.
pub fn choose(patches: &[GroundPatch], finest: f64) -> CellChoice {
    let none = CellChoice { cell: 1.0, density: 0.0, coverage: 1.0 };
    // One point a cell if the bounds were filled evenly: a place to start from.
    let spacing = patches.iter().filter_map(|patch| {
        let bounds = |axis: usize| {
            patch.points.iter().fold((f64::MAX, f64::MIN), |(lo, hi), p| (lo.min(p[axis]), hi.max(p[axis])))
        };
        let ((w, e), (s, n)) = (bounds(0), bounds(1));
        let (width, height, count) = (e - w, n - s, patch.points.len() as f64);
        let spacing = (width * height / count).sqrt().max(width.max(height) / count);
        (spacing > 0.0 && spacing.is_finite()).then_some(spacing)
    });
    let Some(spacing) = spacing.reduce(f64::max) else { return none };
    let mut cell = power_of_two_above(spacing);
    let mut here = Tally::of(patches, cell);
    while here.points_per_cell() < LEAST_POINTS && cell < 1e18 {
        cell *= 2.0;
        here = Tally::of(patches, cell);
    }
    // Rounded up to a power of two.
    let finest = finest.max(spacing * 2f64.powi(-40)).max(FINEST_LOG2.exp2());
    while cell / 2.0 >= finest {
        let finer = Tally::of(patches, cell / 2.0);
        if finer.points_per_cell() < LEAST_POINTS {
            break;
        }
        (cell, here) = (cell / 2.0, finer);
    }
    let density = here.points_per_cell() / (cell * cell);
    // Only holes that doubling closes speak for it: in canals, in shadows of roofs, or on ground under trees
    // others remain whatever the size.
    for _ in 0..DOUBLINGS {
        if here.share(here.closable) <= HOLES && here.share(here.open) <= OPEN_HOLES {
            break;
        }
        cell *= 2.0;
        here = Tally::of(patches, cell);
    }
    CellChoice { cell, density, coverage: here.coverage() }
}

/// Area of the footprint of one pass, square CRS units, with cells of `cell`.
pub fn footprint_area(points: &[[f64; 2]], cell: f64) -> f64 {
    Coverage::of(points, cell).footprint as f64 * cell * cell
}

fn power_of_two_above(size: f64) -> f64 {
    size.log2().ceil().clamp(FINEST_LOG2, 60.0).exp2()
}

/// Sums over patches.
#[derive(Default)]
struct Tally {
    points: f64,
    hit: f64,
    closable: f64,
    open: f64,
    footprint: f64,
}

impl Tally {
    fn of(patches: &[GroundPatch], cell: f64) -> Tally {
        let mut tally = Tally::default();
        for patch in patches {
            let coverage = Coverage::of(&patch.points, cell);
            let (hit, footprint) = (coverage.hit as f64, coverage.footprint as f64);
            // Places are met as often as they hold points: dense ground must not count for more.
            let weight = 1.0 / patch.points.len().max(1) as f64;
            tally.points += weight * patch.points.len() as f64 * patch.passes;
            tally.footprint += weight * footprint;
            let empty = footprint - hit;
            let (beside, open) = (coverage.closable as f64, coverage.open as f64);
            let after = |cells: f64| footprint * holes_after(cells / footprint.max(1.0), patch.passes);
            tally.hit += weight * (footprint - after(empty));
            tally.closable += weight * (after(empty) - after(empty - beside));
            tally.open += weight * (after(empty) - after(empty - open));
        }
        tally
    }

    fn points_per_cell(&self) -> f64 {
        self.points / self.footprint.max(f64::MIN_POSITIVE)
    }

    fn share(&self, cells: f64) -> f64 {
        cells / self.footprint.max(f64::MIN_POSITIVE)
    }

    fn coverage(&self) -> f64 {
        self.hit / self.footprint.max(f64::MIN_POSITIVE)
    }
}

/// Share of cells left empty by `passes` independent passes that leave `holes` each; between whole
/// numbers a part of the ground has one pass more than the rest.
fn holes_after(holes: f64, passes: f64) -> f64 {
    let (whole, part) = (passes.floor(), passes.fract());
    holes.powf(whole) * (1.0 - part + part * holes)
}

/// Cells hit, and cells that are footprint, hit or not.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Coverage {
    hit: u64,
    /// Footprint without a point beside a point: cells of twice the side have none of these.
    closable: u64,
    /// Of those, what no bridge closes.
    open: u64,
    footprint: u64,
}

/// Side of a tile of the sparse cell map, in cells: one row is one `u64`.
const TILE: usize = 64;
/// Cells beyond a tile's border that decide what is a void inside it.
const HALO: usize = VOID_CELLS - 1;

impl Coverage {
    /// O(points); memory grows with the tiles that hold points, not with the extent.
    fn of(points: &[[f64; 2]], cell: f64) -> Coverage {
        let mut index: HashMap<[i64; 2], usize> = HashMap::new();
        let mut tiles: Vec<[u64; TILE]> = Vec::new();
        let mut last = ([i64::MIN; 2], 0);
        for point in points {
            let [i, j] = point.map(|value| (value / cell).floor() as i64);
            let key = [i.div_euclid(TILE as i64), j.div_euclid(TILE as i64)];
            // Neighbours in the file are neighbours on the ground.
            if key != last.0 {
                let at = *index.entry(key).or_insert_with(|| {
                    tiles.push([0; TILE]);
                    tiles.len() - 1
                });
                last = (key, at);
            }
            let (column, row) = (i.rem_euclid(TILE as i64), j.rem_euclid(TILE as i64));
            tiles[last.1][row as usize] |= 1 << column;
        }
        let mut coverage = Coverage::default();
        // A tile without points is a void as a whole: it is wider than one.
        for (&[i, j], &at) in &index {
            let neighbour = |di: i64, dj: i64| index.get(&[i + di, j + dj]).map(|&at| &tiles[at]);
            let around = [-1, 0, 1].map(|dj| [-1, 0, 1].map(|di| neighbour(di, dj)));
            coverage.hit += tiles[at].iter().map(|row| u64::from(row.count_ones())).sum::<u64>();
            let window = window(&around);
            let (footprint, bridged) = (footprint_of_tile(&window), bridged_in_tile(&window));
            let pairs = footprint.chunks_exact(2).zip(bridged.chunks_exact(2));
            for (rows, (footprint, bridged)) in tiles[at].chunks_exact(2).zip(pairs) {
                let either = rows[0] | rows[1];
                let pair = (either | (either >> 1)) & 0x5555_5555_5555_5555;
                let coarse = pair | (pair << 1);
                for ((row, footprint), bridged) in rows.iter().zip(footprint).zip(bridged) {
                    let closable = footprint & !row & coarse;
                    coverage.footprint += u64::from(footprint.count_ones());
                    coverage.closable += u64::from(closable.count_ones());
                    coverage.open += u64::from((closable & !bridged).count_ones());
                }
            }
        }
        coverage
    }
}

/// Rows of a tile and its halo: bit k of row r is the cell (k - HALO, r - HALO) of the tile.
type Window = [u128; WINDOW];
const WINDOW: usize = TILE + 2 * HALO;

/// `around[row][column]`, south and west first.
fn window(around: &[[Option<&[u64; TILE]>; 3]; 3]) -> Window {
    std::array::from_fn(|r| {
        let (tile, row) = match r {
            _ if r < HALO => (0, TILE - HALO + r),
            _ if r < HALO + TILE => (1, r - HALO),
            _ => (2, r - HALO - TILE),
        };
        let word = |column: usize| u128::from(around[tile][column].map_or(0, |tile| tile[row]));
        (word(0) >> (TILE - HALO)) | (word(1) << HALO) | ((word(2) << (HALO + TILE)) & ((1 << WINDOW) - 1))
    })
}

/// Cells of the middle tile that a bridge would close: hits on both sides along a row, a column or a diagonal,
/// as in `shaders/bridge.comp`.
fn bridged_in_tile(rows: &Window) -> [u64; TILE] {
    // Bit k of the row is whether the cell `steps` cells back along (dx, dy) is hit.
    let back = |r: usize, [dx, dy]: [i32; 2], steps: i32| {
        let row = rows[(r as i32 - dy * steps) as usize];
        let shift = dx * steps;
        if shift >= 0 { row << shift } else { row >> -shift }
    };
    std::array::from_fn(|r| {
        let mut bridged = 0u128;
        for (axis, most) in [([1, 0], BRIDGE + 1), ([0, 1], BRIDGE + 1), ([1, 1], 3), ([1, -1], 3)] {
            for near in 1..most as i32 {
                for far in 1..=most as i32 - near {
                    bridged |= back(r + HALO, axis, near) & back(r + HALO, axis, -far);
                }
            }
        }
        (bridged >> HALO) as u64
    })
}

/// Cells of the middle tile that no empty square of [`VOID_CELLS`] covers.
fn footprint_of_tile(rows: &Window) -> [u64; TILE] {
    // Bit k: cells k..k + 13 of the row are empty.
    let runs: [u128; WINDOW] = std::array::from_fn(|r| {
        let empty = !rows[r] & ((1 << WINDOW) - 1);
        let two = empty & (empty >> 1);
        let four = two & (two >> 2);
        let eight = four & (four >> 4);
        eight & (eight >> 5)
    });
    // The empty squares that begin in each row, spread over the cells that they cover.
    let mut void = [0u128; WINDOW];
    for r in 0..=WINDOW - VOID_CELLS {
        let corners = runs[r..r + VOID_CELLS].iter().fold(!0, |all, run| all & run);
        if corners != 0 {
            let two = corners | (corners << 1);
            let four = two | (two << 2);
            let eight = four | (four << 4);
            let covered = eight | (eight << 5);
            void[r..r + VOID_CELLS].iter_mut().for_each(|row| *row |= covered);
        }
    }
    std::array::from_fn(|r| !(void[HALO + r] >> HALO) as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    fn whole(points: Vec<[f64; 2]>) -> Vec<GroundPatch> {
        vec![GroundPatch { points, passes: 1.0 }]
    }

    fn random(count: usize, side: f64, seed: u64) -> Vec<[f64; 2]> {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
        (0..count).map(|_| [0, 1].map(|_| rng.random::<f64>() * side)).collect()
    }

    /// The definition, cell by cell.
    fn brute(points: &[[f64; 2]], cell: f64) -> Coverage {
        let hit: std::collections::HashSet<[i64; 2]> =
            points.iter().map(|p| p.map(|v| (v / cell).floor() as i64)).collect();
        let side = VOID_CELLS as i64;
        let (lo, hi) = hit.iter().flatten().fold((i64::MAX, i64::MIN), |(l, h), &v| (l.min(v), h.max(v)));
        let mut void = std::collections::HashSet::new();
        for (i, j) in (lo - side..=hi).flat_map(|i| (lo - side..=hi).map(move |j| (i, j))) {
            let square = || (i..i + side).flat_map(|i| (j..j + side).map(move |j| [i, j]));
            if square().all(|cell| !hit.contains(&cell)) {
                void.extend(square());
            }
        }
        let all = (lo..=hi).flat_map(|i| (lo..=hi).map(move |j| [i, j]));
        let footprint: Vec<[i64; 2]> = all.filter(|cell| !void.contains(cell)).collect();
        let coarse: std::collections::HashSet<[i64; 2]> =
            hit.iter().map(|cell| cell.map(|v| v >> 1)).collect();
        let beside = |cell: &&[i64; 2]| !hit.contains(*cell) && coarse.contains(&cell.map(|v| v >> 1));
        let closable = footprint.iter().filter(beside).count() as u64;
        let bridged = |cell: &&[i64; 2]| {
            [([1, 0], 5), ([0, 1], 5), ([1, 1], 3), ([1, -1], 3)].into_iter().any(|([dx, dy], most)| {
                let hit_at = |k: i64| hit.contains(&[cell[0] + dx * k, cell[1] + dy * k]);
                (1..most).any(|near| (1..=most - near).any(|far| hit_at(-near) && hit_at(far)))
            })
        };
        let open = footprint.iter().filter(beside).filter(|cell| !bridged(cell)).count() as u64;
        Coverage { hit: hit.len() as u64, closable, open, footprint: footprint.len() as u64 }
    }

    #[test]
    fn coverage_is_what_brute_force_says() {
        for seed in 0..2 {
            let mut points = random(400, 90.0, seed);
            // A lake, and negative indices across tile borders.
            points.retain(|p| (p[0] - 40.0).hypot(p[1] - 50.0) > 14.0);
            points.iter_mut().for_each(|p| *p = [p[0] - 45.0, p[1] - 30.0]);
            for cell in [0.7, 1.0, 3.0] {
                assert_eq!(Coverage::of(&points, cell), brute(&points, cell), "{seed} {cell}");
            }
        }
    }

    #[test]
    fn one_point_a_cell_suffices_on_a_grid() {
        let points = (0..200).flat_map(|i| (0..200).map(move |j| [f64::from(i), f64::from(j)])).collect();
        let choice = choose(&whole(points), 0.01);
        assert_eq!((choice.cell, choice.coverage), (1.0, 1.0));
        assert!((choice.density - 1.0).abs() < 1e-9);
    }

    #[test]
    fn bridges_close_the_holes_between_random_points() {
        // 1 - e^-λ is 86 % at 2 points a cell; the other cells lie beside points.
        let choice = choose(&whole(random(80_000, 200.0, 1)), 0.001);
        assert_eq!(choice.cell, 1.0);
        assert!((choice.density - 2.0).abs() < 0.1, "{choice:?}");
        // A point 185 km away, or a lake, changes nothing.
        let mut points = random(80_000, 200.0, 1);
        points.retain(|p| (p[0] - 90.0).hypot(p[1] - 90.0) > 50.0);
        points.push([185_000.0, -185_000.0]);
        assert_eq!(choose(&whole(points), 0.001).cell, 1.0);
        // Clusters leave holes that no bridge closes.
        let mut clumps = random(4_000, 200.0, 3);
        clumps = clumps.iter().flat_map(|p| (0..20).map(|k| [p[0] + 0.02 * f64::from(k), p[1]])).collect();
        assert!(choose(&whole(clumps), 0.001).cell >= 2.0);
    }

    #[test]
    fn passes_make_up_for_what_a_patch_lacks() {
        // One of four passes over the same ground; its own points would ask for cells of 1.
        let patch = GroundPatch { points: random(80_000, 200.0, 1), passes: 4.0 };
        let all = choose(&whole(random(320_000, 200.0, 2)), 0.001);
        let choice = choose(&[patch], 0.001);
        assert_eq!((choice.cell, all.cell), (0.5, 0.5));
        assert!((choice.density / all.density - 1.0).abs() < 0.05);
    }

    #[test]
    fn nothing_to_go_by() {
        for points in [vec![], vec![[5e5, 6e6]], vec![[5e5, 6e6]; 3]] {
            assert_eq!(choose(&whole(points), 0.01).cell, 1.0);
        }
        // Of a broken header.
        let speck = vec![[0.0, 0.0], [1e-312, 1e-312]];
        assert_eq!(choose(&whole(speck), 0.0).cell, FINEST_LOG2.exp2());
        // Points on a line have a spacing all the same.
        let line = (0..1000).map(|i| [f64::from(i) * 0.25, 7.0]).collect();
        assert_eq!(choose(&whole(line), 0.01).cell, 0.25);
    }
}
