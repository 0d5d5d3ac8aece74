//! Bounds that hold the data and not the stray points, and the ground that boxes cover.

use super::quantile;
use glam::DVec3;

/// An axis-aligned box in world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Lower corner.
    pub min: DVec3,
    /// Upper corner.
    pub max: DVec3,
}

impl Bounds {
    /// The box of finite, ordered corners.
    pub fn new(min: DVec3, max: DVec3) -> Option<Bounds> {
        (min.is_finite() && max.is_finite() && min.cmple(max).all()).then_some(Bounds { min, max })
    }

    /// Whether one of `points` is inside, or there is none.
    pub(super) fn holds_some(&self, points: &[(DVec3, f64)]) -> bool {
        let inside = |point: DVec3| point.cmpge(self.min).all() && point.cmple(self.max).all();
        points.is_empty() || points.iter().any(|(point, _)| inside(*point))
    }

    /// The smallest box around both.
    pub fn union(self, other: Bounds) -> Bounds {
        Bounds { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Upper corner minus lower corner.
    pub fn size(&self) -> DVec3 {
        self.max - self.min
    }

    /// The middle.
    pub fn center(&self) -> DVec3 {
        (self.min + self.max) / 2.0
    }
}

/// Share of a file's sample that may lie outside on either side of an axis.
const STRAY: f64 = 0.002;
/// With fewer points the sample cannot tell a stray point from the file's edge.
pub(super) const ENOUGH: usize = 30;

/// The box of one file: each side as its header has it, where the sample bears that out; else as far as
/// the sample reaches without stray points. `points` with weights; hidden points left out.
pub fn file_bounds(header: Option<Bounds>, points: &[(DVec3, f64)]) -> Option<Bounds> {
    if points.len() < ENOUGH && header.is_some() {
        return header;
    }
    let core = |axis: usize| {
        let mut values: Vec<(f64, f64)> =
            points.iter().map(|(point, weight)| (point[axis], *weight)).collect();
        Some((quantile(&mut values, STRAY)?, quantile(&mut values, 1.0 - STRAY)?))
    };
    let cores = [core(0)?, core(1)?, core(2)?];
    let width = |axis: usize| cores[axis].1 - cores[axis].0;
    let least = 1e-6 * width(0).max(width(1)).max(width(2));
    let (mut min, mut max) = (DVec3::ZERO, DVec3::ZERO);
    for axis in 0..3 {
        let (lo, hi) = cores[axis];
        // A tower or a shaft reaches far out of flat country, but not kilometres.
        let aside = if axis == 2 { 0.5 * width(0).max(width(1)) } else { 0.0 };
        let reach = if points.len() < ENOUGH { f64::MAX } else { (0.5 * width(axis)).max(aside).max(least) };
        let near = |value: f64| (lo - reach..=hi + reach).contains(&value);
        let inside = points.iter().map(|(point, _)| point[axis]).filter(|&value| near(value));
        let (first, last) = inside.fold((lo, hi), |(first, last), value| (value.min(first), value.max(last)));
        let side = |value: Option<f64>| value.filter(|&value| near(value));
        // A header that leaves out points is no better than the sample.
        min[axis] = side(header.map(|header| header.min[axis])).map_or(first, |value| value.min(first));
        max[axis] = side(header.map(|header| header.max[axis])).map_or(last, |value| value.max(last));
    }
    Bounds::new(min, max)
}

/// The box of the whole: of all files but those that lie far off and hold next to nothing (under 0.1 %
/// of the points together).
pub fn whole_bounds(files: &[(Bounds, u64)]) -> Option<Bounds> {
    let total: u64 = files.iter().map(|(_, points)| points).sum();
    let by_size = {
        let mut order: Vec<usize> = (0..files.len()).collect();
        order.sort_by_key(|&index| (std::cmp::Reverse(files[index].1), index));
        order
    };
    let mut whole: Option<Bounds> = None;
    let mut held = 0;
    for index in by_size {
        let (bounds, points) = files[index];
        whole = Some(match whole {
            None => bounds,
            Some(whole) => {
                let off = (whole.min - bounds.max).max(bounds.min - whole.max).max_element();
                let far = off > 2.0 * whole.size().max_element();
                let nothing = (total - held) as f64 <= 0.001 * total as f64;
                if far && nothing { whole } else { whole.union(bounds) }
            }
        });
        held += points;
    }
    whole
}

/// Ground that the boxes cover together, square units; O(n²) for n boxes.
pub fn covered_area(boxes: &[Bounds]) -> f64 {
    let mut edges: Vec<f64> = boxes.iter().flat_map(|b| [b.min.x, b.max.x]).collect();
    edges.sort_by(f64::total_cmp);
    edges.dedup();
    let mut by_south: Vec<&Bounds> = boxes.iter().collect();
    by_south.sort_by(|a, b| a.min.y.total_cmp(&b.min.y));
    let mut area = 0.0;
    for slab in edges.windows(2) {
        let (mut length, mut end) = (0.0, f64::MIN);
        for b in by_south.iter().filter(|b| b.min.x <= slab[0] && b.max.x >= slab[1]) {
            length += (b.max.y - b.min.y.max(end)).max(0.0);
            end = end.max(b.max.y);
        }
        area += length * (slab[1] - slab[0]);
    }
    area
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bounds(min: [f64; 3], max: [f64; 3]) -> Bounds {
        Bounds::new(min.into(), max.into()).unwrap()
    }

    fn grid(side: i32, z: f64) -> Vec<(DVec3, f64)> {
        let at = |i: i32, j: i32| DVec3::new(i.into(), j.into(), z + f64::from(i % 7));
        (0..side).flat_map(|i| (0..side).map(move |j| (at(i, j), 1.0))).collect()
    }

    #[test]
    fn a_sound_header_is_taken_to_the_digit() {
        let header = bounds([-0.5, -0.25, 1.0], [99.75, 99.5, 50.0]);
        assert_eq!(file_bounds(Some(header), &grid(100, 2.0)), Some(header));
        assert_eq!(file_bounds(Some(header), &[]), Some(header));
        assert_eq!(file_bounds(None, &[]), None);
    }

    #[test]
    fn stray_points_and_wrong_headers_are_seen_through() {
        let header = bounds([-0.5, -0.25, -175_000.0], [185_000.0, 99.5, 50.0]);
        let mut points = grid(100, 2.0);
        points.push((DVec3::new(185_000.0, 50.0, -175_000.0), 1.0));
        let found = file_bounds(Some(header), &points).unwrap();
        assert_eq!((found.min, found.max), (DVec3::new(-0.5, -0.25, 2.0), DVec3::new(99.0, 99.5, 50.0)));
        let small = bounds([10.0, 10.0, 3.0], [20.0, 20.0, 3.5]);
        let found = file_bounds(Some(small), &grid(100, 2.0)).unwrap();
        assert_eq!((found.min.x, found.max.x, found.max.z), (0.0, 99.0, 8.0));
    }

    #[test]
    fn a_far_file_counts_unless_it_is_nothing() {
        let here = bounds([0.0; 3], [1000.0, 1000.0, 10.0]);
        let far = bounds([185_000.0, 0.0, 0.0], [186_000.0, 10.0, 1.0]);
        assert_eq!(whole_bounds(&[(here, 1_000_000), (far, 500)]), Some(here));
        assert_eq!(whole_bounds(&[(here, 1_000_000), (far, 100_000)]), Some(here.union(far)));
        assert_eq!(whole_bounds(&[]), None);
    }

    #[test]
    fn overlaps_are_counted_once() {
        let a = bounds([0.0; 3], [10.0, 10.0, 1.0]);
        let b = bounds([5.0, 5.0, 0.0], [15.0, 15.0, 1.0]);
        let c = bounds([20.0, 0.0, 0.0], [30.0, 1.0, 1.0]);
        assert_eq!(covered_area(&[a, b, c, a]), 100.0 + 75.0 + 10.0);
        assert_eq!(covered_area(&[]), 0.0);
    }
}
