//! The ground in rough outline: where lit images end below.

use super::bounds::Bounds;
use crate::shared::passes::GROUND_SIDE;
use glam::{DVec2, DVec3};
use std::sync::Arc;

/// Cells each way.
pub const LOW_SIDE: usize = GROUND_SIDE as usize;
/// What lies on a cell's border but for rounding lies on it, wherever in its CRS the data lies; in cells.
const ON_BORDER: f64 = 1e-6;
/// Share of a cell's points below its height: strays below the ground are fewer.
const LOW: f64 = 0.02;
/// Cells each way of the blocks that tell how steep the ground is.
const BLOCK: usize = 8;
/// What is so many times as steep as the land is at half of its places is a wall, not a hillside.
const STEEP: f64 = 4.0;
/// And at least so steep.
const LEAST_STEEP: f64 = 0.15;
const NEAR: [[isize; 2]; 8] = [[-1, -1], [0, -1], [1, -1], [-1, 0], [1, 0], [-1, 1], [0, 1], [1, 1]];

/// Heights of the ground, or of the lowest that there is, over a box, bilinear between the middles of its cells.
#[derive(Clone, Debug, PartialEq)]
pub struct LowSurface {
    /// South-west corner.
    pub origin: DVec2,
    /// Sides of a cell.
    pub cell: DVec2,
    /// Row by row from the south, [`LOW_SIDE`] each way.
    pub heights: Vec<f64>,
}

/// What lit images end in below: columns are solid without end, which nobody wants to see. Thin, and as the ground is.
#[derive(Clone, Debug)]
pub struct Slab {
    /// Its upper side, where a column is not lower.
    pub low: Arc<LowSurface>,
    /// Thickness, CRS units.
    pub thickness: f64,
}

impl LowSurface {
    /// Of points in `bounds`; flat at its bottom where there are none.
    pub fn of(bounds: &Bounds, points: &[DVec3]) -> LowSurface {
        let cell = (bounds.size().truncate() / LOW_SIDE as f64).max(DVec2::splat(f64::MIN_POSITIVE));
        let mut surface = LowSurface {
            origin: bounds.min.truncate(),
            cell,
            heights: vec![bounds.min.z; LOW_SIDE * LOW_SIDE],
        };
        let mut low = surface.lowest(points);
        if low.iter().any(Option::is_some) {
            fill(&mut low);
            surface.heights = low.into_iter().flatten().collect();
            surface.below_walls();
            surface.smooth();
        }
        surface
    }

    /// Cells and what is beyond the middle of one, towards the next, each way; held at the border.
    fn place(&self, at: DVec2) -> ([usize; 2], DVec2) {
        let last = (LOW_SIDE - 1) as f64;
        let on = ((at - self.origin) / self.cell - 0.5).clamp(DVec2::ZERO, DVec2::splat(last));
        let first = on.floor().min(DVec2::splat(last - 1.0));
        ([first.x as usize, first.y as usize], on - first)
    }

    /// Height at E, N; beyond the box that of its border.
    pub fn at(&self, at: DVec2) -> f64 {
        let ([i, j], beyond) = self.place(at);
        let row = |j: usize| {
            let [a, b] = [0, 1].map(|k| self.heights[j * LOW_SIDE + i + k]);
            a + (b - a) * beyond.x
        };
        let [south, north] = [row(j), row(j + 1)];
        south + (north - south) * beyond.y
    }

    /// With that of what lies elsewhere, or beside it: where both are, the lower.
    pub fn joined(&self, other: &LowSurface) -> LowSurface {
        let ends = |of: &LowSurface| [of.origin, of.origin + of.cell * LOW_SIDE as f64];
        let [own, others] = [ends(self), ends(other)];
        let (origin, end) = (own[0].min(others[0]), own[1].max(others[1]));
        let cell = ((end - origin) / LOW_SIDE as f64).max(DVec2::splat(f64::MIN_POSITIVE));
        let off = |[low, high]: [DVec2; 2], at: DVec2| at.distance(at.clamp(low, high));
        let height = |k: usize| {
            let at = origin + cell * (DVec2::new((k % LOW_SIDE) as f64, (k / LOW_SIDE) as f64) + 0.5);
            match off(own, at).total_cmp(&off(others, at)) {
                std::cmp::Ordering::Less => self.at(at),
                std::cmp::Ordering::Equal => self.at(at).min(other.at(at)),
                std::cmp::Ordering::Greater => other.at(at),
            }
        };
        LowSurface { origin, cell, heights: (0..LOW_SIDE * LOW_SIDE).map(height).collect() }
    }

    /// The same, no lower and no higher than `bounds`.
    pub fn within(mut self, bounds: &Bounds) -> LowSurface {
        self.heights.iter_mut().for_each(|height| *height = height.clamp(bounds.min.z, bounds.max.z));
        self
    }

    /// The lowest of it.
    pub fn lowest_height(&self) -> f64 {
        self.heights.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// A low height of each cell that has points.
    fn lowest(&self, points: &[DVec3]) -> Vec<Option<f64>> {
        let mut cells: Vec<Vec<f64>> = vec![Vec::new(); LOW_SIDE * LOW_SIDE];
        for point in points {
            let on = ((point.truncate() - self.origin) / self.cell + ON_BORDER).floor();
            let [i, j] = on.to_array().map(|v| v.clamp(0.0, (LOW_SIDE - 1) as f64) as usize);
            cells[j * LOW_SIDE + i].push(point.z);
        }
        let low = |mut heights: Vec<f64>| {
            let last = heights.len().checked_sub(1)?;
            let at = (LOW * last as f64).ceil() as usize;
            Some(*heights.select_nth_unstable_by(at, f64::total_cmp).1)
        };
        cells.into_iter().map(low).collect()
    }

    /// Steepest that the ground may be: from the lowest of each block of cells, which is ground almost anywhere.
    fn steepest(&self) -> f64 {
        let low = |i: usize, j: usize| {
            let cells =
                (0..BLOCK * BLOCK).map(|k| (j * BLOCK + k / BLOCK) * LOW_SIDE + i * BLOCK + k % BLOCK);
            cells.map(|at| self.heights[at]).fold(f64::INFINITY, f64::min)
        };
        let (blocks, side) = (LOW_SIDE / BLOCK - 1, self.cell * BLOCK as f64);
        let slope = |i: usize, j: usize| {
            let rise = DVec2::new(low(i + 1, j) - low(i, j), low(i, j + 1) - low(i, j));
            (rise / side).length()
        };
        let mut slopes: Vec<f64> = (0..blocks * blocks).map(|k| slope(k % blocks, k / blocks)).collect();
        let middle = slopes.len() / 2;
        (STEEP * *slopes.select_nth_unstable_by(middle, f64::total_cmp).1).max(LEAST_STEEP)
    }

    /// Lowers what rises more steeply than ground does, such as roofs that fill a cell.
    fn below_walls(&mut self) {
        let steepest = self.steepest();
        let all: Vec<usize> = (0..LOW_SIDE * LOW_SIDE).collect();
        // Each way twice: what came the other way round a corner goes on.
        for order in [&all[..], &all.iter().rev().copied().collect::<Vec<_>>()[..]].repeat(2) {
            for &at in order {
                for (to, [di, dj]) in near(at) {
                    let length = (self.cell * DVec2::new(di as f64, dj as f64)).length();
                    self.heights[at] = self.heights[at].min(self.heights[to] + steepest * length);
                }
            }
        }
    }

    fn smooth(&mut self) {
        let before = self.heights.clone();
        for (at, height) in self.heights.iter_mut().enumerate() {
            let (sum, count) =
                near(at).fold((before[at], 1.0), |(sum, n), (to, _)| (sum + before[to], n + 1.0));
            *height = sum / count;
        }
    }
}

/// Neighbours of a cell, and where they lie from it.
fn near(at: usize) -> impl Iterator<Item = (usize, [isize; 2])> {
    let (i, j) = (at % LOW_SIDE, at / LOW_SIDE);
    NEAR.into_iter().filter_map(move |[di, dj]| {
        let (i, j) = (i.checked_add_signed(di)?, j.checked_add_signed(dj)?);
        (i < LOW_SIDE && j < LOW_SIDE).then_some((j * LOW_SIDE + i, [di, dj]))
    })
}

/// Fills cells that have none from those around, ring by ring.
fn fill(cells: &mut [Option<f64>]) {
    while cells.iter().any(Option::is_none) {
        let before = cells.to_vec();
        for (at, cell) in cells.iter_mut().enumerate().filter(|(_, cell)| cell.is_none()) {
            let known = near(at).filter_map(|(to, _)| before[to]);
            *cell = known.reduce(f64::min);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bounds() -> Bounds {
        Bounds { min: DVec3::new(1000.0, 2000.0, 0.0), max: DVec3::new(1064.0, 2128.0, 40.0) }
    }

    fn points(height: impl Fn(f64, f64) -> Option<f64>) -> Vec<DVec3> {
        let at = |i: i32, j: i32| (f64::from(i) * 0.5 + 0.25, f64::from(j) * 0.5 + 0.25);
        let all = (0..128).flat_map(|i| (0..256).map(move |j| at(i, j)));
        all.filter_map(|(x, y)| Some(DVec3::new(1000.0 + x, 2000.0 + y, height(x, y)?))).collect()
    }

    #[test]
    fn it_is_the_ground_under_a_house_and_beside_it() {
        let house = |x: f64, y: f64| (20.0..32.0).contains(&x) && (30.0..50.0).contains(&y);
        let surface =
            LowSurface::of(&bounds(), &points(|x, y| Some(if house(x, y) { 12.0 } else { 0.02 * x })));
        for (x, y) in [(1.0, 1.0), (26.0, 40.0), (40.0, 100.0), (63.0, 127.0)] {
            let height = surface.at(DVec2::new(1000.0 + x, 2000.0 + y));
            assert!((-0.1..2.0).contains(&height), "{height} at {x}, {y}");
        }
        assert!(surface.lowest_height() >= 0.0);
        // A house at the very edge, as when a tile ends in it.
        let house = |x: f64, y: f64| x < 12.0 && (30.0..50.0).contains(&y);
        let surface = LowSurface::of(&bounds(), &points(|x, y| Some(if house(x, y) { 12.0 } else { 0.0 })));
        assert!(surface.at(DVec2::new(1000.0, 2040.0)) < 2.0);
    }

    #[test]
    fn it_is_the_same_wherever_it_lies() {
        // Centimetres, on the borders of many cells.
        let points = |by: [f64; 2]| -> Vec<DVec3> {
            let at = |k: i32, by: f64| f64::from(k) * 0.01 + by;
            let all = (0..=154).flat_map(|i| (0..=154).map(move |j| (i * 16, j * 16)));
            all.map(|(i, j)| DVec3::new(at(i, by[0]), at(j, by[1]), f64::from((i * 7 + j * 13) % 90)))
                .collect()
        };
        let surface = |by: [f64; 2]| {
            let min = DVec3::new(by[0], by[1], 0.0);
            let bounds = Bounds { min, max: DVec3::new(24.64 + by[0], 24.64 + by[1], 90.0) };
            LowSurface::of(&bounds, &points(by)).heights
        };
        let (near, far) = (surface([50.0, 70.0]), surface([500_050.0, 6_000_070.0]));
        let most = near.iter().zip(&far).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(most < 1e-5, "{most}");
    }

    #[test]
    fn those_of_two_places_are_joined() {
        let flat = |east: f64, z: f64| {
            let min = DVec3::new(1000.0 + east, 2000.0, z);
            let bounds = Bounds { min, max: min + DVec3::new(64.0, 64.0, 0.0) };
            LowSurface::of(&bounds, &[bounds.center()])
        };
        let joined = flat(0.0, 5.0).joined(&flat(128.0, 300.0));
        let at = |east: f64| joined.at(DVec2::new(1000.0 + east, 2032.0));
        assert_eq!([at(10.0), at(180.0)], [5.0, 300.0]);
        assert_eq!(flat(0.0, 5.0).joined(&flat(0.0, 3.0)).at(DVec2::new(1030.0, 2030.0)), 3.0);
        let point = LowSurface::of(&Bounds { min: DVec3::ONE, max: DVec3::ONE }, &[DVec3::ONE]);
        assert_eq!(point.joined(&point).at(DVec2::ONE), 1.0);
    }

    #[test]
    fn it_follows_a_mountain_and_crosses_a_lake() {
        let lake = |x: f64, y: f64| (x - 32.0).hypot(y - 64.0) < 15.0;
        let surface = LowSurface::of(&bounds(), &points(|x, y| (!lake(x, y)).then_some(1.2 * x)));
        for (x, y) in [(1.0, 1.0), (60.0, 10.0), (63.9, 127.9)] {
            let height = surface.at(DVec2::new(1000.0 + x, 2000.0 + y));
            assert!((height - 1.2 * x).abs() < 2.0, "{height} at {x}");
        }
        assert!(surface.heights.iter().all(|height| (0.0..80.0).contains(height)));
        let none = LowSurface::of(&bounds(), &[]);
        assert_eq!((none.at(DVec2::ZERO), none.lowest_height()), (0.0, 0.0));
    }
}
