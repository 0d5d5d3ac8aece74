//! What cameras frame: points whose convex hull holds the data.

use super::bounds::{Bounds, on_lattice};
use super::low_surface::{LowSurface, Slab};
use glam::DVec3;
use std::f64::consts::PI;

/// Directions on the sphere in which the outermost point is kept.
const DIRECTIONS: usize = 512;
/// A point is farther out than another if it is by this share of the box: what lies equally far is the same one wherever
/// in its CRS the data lies.
const EQUAL: f64 = 1e-7;
/// Shapes that reach less of their box than this, along any axis, say nothing of it.
const LEAST_REACH: f64 = 0.5;

/// A few points whose convex hull holds many others, but for about 1 % of their extent. Never empty.
#[derive(Clone, Debug, PartialEq)]
pub struct Hull {
    points: Vec<DVec3>,
}

impl From<&Bounds> for Hull {
    fn from(bounds: &Bounds) -> Hull {
        Hull { points: bounds.corners().to_vec() }
    }
}

impl Hull {
    /// Of `points`; `None` where there are none. O(512 points).
    pub fn of(points: &[DVec3]) -> Option<Hull> {
        let bounds = Bounds::around(points)?;
        let whole = bounds.size();
        let local: Vec<DVec3> = points
            .iter()
            .map(|p| DVec3::select(whole.cmpgt(DVec3::ZERO), (p - bounds.min) / whole, DVec3::ZERO))
            .collect();
        let mut kept: Vec<usize> =
            directions().filter_map(|direction| outermost(&local, direction)).collect();
        kept.sort_unstable();
        kept.dedup();
        Some(Hull { points: kept.into_iter().map(|index| points[index]).collect() })
    }

    /// Of all of them; `None` for none.
    pub fn union<'h>(hulls: impl IntoIterator<Item = &'h Hull>) -> Option<Hull> {
        let mut hulls = hulls.into_iter().peekable();
        let first = hulls.next()?;
        if hulls.peek().is_none() {
            return Some(first.clone());
        }
        let points: Vec<DVec3> =
            first.points.iter().chain(hulls.flat_map(|hull| &hull.points)).copied().collect();
        Hull::of(&points)
    }

    /// Its points, one or more.
    pub fn points(&self) -> &[DVec3] {
        &self.points
    }

    /// The box around it.
    pub fn bounds(&self) -> Bounds {
        Bounds::around(&self.points).expect("hulls have points")
    }

    /// Stretched along the axes until it fills `bounds`, which hold what it is a sample of; the box where it shows too
    /// little of that.
    pub fn stretched(&self, bounds: &Bounds) -> Hull {
        let own = self.bounds();
        let (from, to) = (own.size(), bounds.size());
        let is_like = from.cmpge(to * LEAST_REACH).all();
        if !is_like {
            return Hull::from(bounds);
        }
        let factor = DVec3::select(from.cmpgt(DVec3::ZERO), to / from, DVec3::ONE);
        // The ends exactly.
        let place = |p: &DVec3| {
            let inner = bounds.min + (p - own.min) * factor;
            DVec3::select(p.cmpeq(own.max), bounds.max, inner)
        };
        Hull { points: self.points.iter().map(place).collect() }
    }

    /// How far it reaches along an axis of length 1.
    pub fn extent(&self, axis: DVec3) -> f64 {
        let middle = self.bounds().center();
        let along = self.points.iter().map(|p| (p - middle).dot(axis));
        let (low, high) =
            along.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        high - low
    }

    /// With the corners on the ground of `bounds`, which it lies in, that it comes near to: within this share of the sides, both
    /// together. A sample hardly ever holds the points that lie in a corner.
    pub fn with_near_corners(mut self, bounds: &Bounds, near: f64) -> Hull {
        let size = bounds.size();
        let share = |v: DVec3| DVec3::select(size.cmpgt(DVec3::ZERO), v / size, DVec3::ZERO);
        for corner in bounds.corners().into_iter().take(4) {
            let off = |p: &DVec3| share((p - corner).abs()).truncate().element_sum();
            let nearest = self.points.iter().min_by(|a, b| off(a).total_cmp(&off(b)));
            if let Some(nearest) = nearest.copied().filter(|nearest| off(nearest) < near) {
                self.points.push(corner.with_z(nearest.z));
            }
        }
        self
    }

    /// Without what is below the ground, such as stray points, which nobody sees from outside.
    pub fn above(&self, low: &LowSurface) -> Hull {
        let raised = |p: &DVec3| p.with_z(p.z.max(low.at(p.truncate())));
        Hull { points: self.points.iter().map(raised).collect() }
    }

    /// With room for what stands on it unseen, `by` high, but not above `top`.
    pub fn lifted(mut self, by: f64, top: f64) -> Hull {
        let above: Vec<DVec3> = self.points.iter().map(|p| p.with_z((p.z + by).min(top).max(p.z))).collect();
        self.points.extend(above);
        self
    }

    /// To the nearest multiples of `step`, a power of two.
    pub fn snapped(&self, step: f64) -> Hull {
        Hull { points: self.points.iter().map(|&p| on_lattice(p, step)).collect() }
    }

    /// As it is shown under vertical exaggeration about `pivot_u`.
    pub fn exaggerated(&self, z_scale: f64, pivot_u: f64) -> Hull {
        let shown = |p: &DVec3| p.with_z(pivot_u + (p.z - pivot_u) * z_scale);
        Hull { points: self.points.iter().map(shown).collect() }
    }

    /// Out to the borders of the cells of `cell` that its points touch.
    pub fn of_cells(&self, cell: f64) -> Hull {
        let corners = |p: &DVec3| {
            let Bounds { min, max } = Bounds { min: *p, max: *p }.of_cells(cell);
            [(min.x, min.y), (max.x, min.y), (min.x, max.y), (max.x, max.y)]
                .map(|(x, y)| DVec3::new(x, y, p.z))
        };
        Hull { points: self.points.iter().flat_map(corners).collect() }
    }

    /// With what is below it down to the slab's lower side, as columns are solid.
    pub fn on_slab(&self, slab: &Slab) -> Hull {
        let both = |p: &DVec3| [*p, p.with_z(slab.low.at(p.truncate()).min(p.z) - slab.thickness)];
        Hull { points: self.points.iter().flat_map(both).collect() }
    }
}

/// Both ways along the axes first, then a spiral over the sphere.
fn directions() -> impl Iterator<Item = DVec3> {
    let golden = PI * (3.0 - 5f64.sqrt());
    let spiral = move |k: usize| {
        let z = 1.0 - (2 * k + 1) as f64 / DIRECTIONS as f64;
        let (sin, cos) = (golden * k as f64).sin_cos();
        let across = (1.0 - z * z).sqrt();
        DVec3::new(cos * across, sin * across, z)
    };
    DVec3::AXES.into_iter().flat_map(|axis| [axis, -axis]).chain((0..DIRECTIONS).map(spiral))
}

/// The first of the points that are farthest along `direction`.
fn outermost(points: &[DVec3], direction: DVec3) -> Option<usize> {
    let mut best: Option<(usize, f64)> = None;
    for (index, point) in points.iter().enumerate() {
        let along = point.dot(direction);
        if best.is_none_or(|(_, most)| along > most + EQUAL) {
            best = Some((index, along));
        }
    }
    best.map(|(index, _)| index)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn extent(points: &[DVec3], along: DVec3) -> [f64; 2] {
        let values = points.iter().map(|p| p.dot(along));
        values.fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], v| [lo.min(v), hi.max(v)])
    }

    proptest! {
        #[test]
        fn few_points_reach_as_far_as_all(
            points in prop::collection::vec([-500.0f64..500.0, -90.0f64..90.0, 0.0f64..30.0], 1..400),
            to in [-1.0f64..1.0, -1.0f64..1.0, -1.0f64..1.0],
        ) {
            let points: Vec<DVec3> = points.into_iter().map(DVec3::from_array).collect();
            let hull = Hull::of(&points).unwrap();
            let (all, few) = (extent(&points, DVec3::from(to)), extent(hull.points(), DVec3::from(to)));
            let most = 0.02 * (all[1] - all[0]) + 0.005 * (hull.bounds().size() * DVec3::from(to).abs()).element_sum();
            prop_assert!(all[0] <= few[0] && few[1] <= all[1]);
            prop_assert!(few[0] - all[0] <= most + 1e-3 && all[1] - few[1] <= most + 1e-3);
            prop_assert!((hull.bounds().size() - Bounds::around(&points).unwrap().size()).abs().max_element() < 1e-3);
        }
    }

    #[test]
    fn a_sample_is_stretched_to_what_it_is_of() {
        let corridor: Vec<DVec3> =
            (0..=40).map(|k| DVec3::new(f64::from(k), f64::from(k) * 2.0, 5.0)).collect();
        let hull = Hull::of(&corridor).unwrap();
        let bounds = Bounds { min: DVec3::new(-1.0, 0.0, 5.0), max: DVec3::new(43.0, 88.0, 5.0) };
        let stretched = hull.stretched(&bounds);
        assert_eq!(stretched.bounds(), bounds);
        assert!(stretched.points().len() < 8, "a line has two ends: {stretched:?}");
        let far = Bounds { max: DVec3::new(430.0, 88.0, 5.0), ..bounds };
        assert_eq!(hull.stretched(&far), Hull::from(&far), "a sample of a tenth");
        assert_eq!(Hull::of(&[]), None);
    }

    #[test]
    fn corners_that_are_nearly_reached_are_in_it() {
        let bounds = Bounds { min: DVec3::ZERO, max: DVec3::new(100.0, 50.0, 9.0) };
        let tile = [[4.0, 3.0, 1.0], [98.0, 2.0, 2.0], [97.0, 50.0, 9.0], [0.0, 40.0, 4.0], [60.0, 0.0, 5.0]];
        let hull = Hull::of(&tile.map(DVec3::from_array)).unwrap().with_near_corners(&bounds, 0.15);
        let is_in = |x: f64, y: f64, z: f64| hull.points().contains(&DVec3::new(x, y, z));
        assert!(is_in(0.0, 0.0, 1.0) && is_in(100.0, 0.0, 2.0) && is_in(100.0, 50.0, 9.0));
        assert!(
            !hull.points().iter().any(|p| p.x == 0.0 && p.y == 50.0),
            "a fifth of a side is missing there"
        );
    }

    #[test]
    fn it_is_the_same_wherever_it_lies() {
        let points = |by: DVec3| -> Vec<DVec3> {
            let at =
                |i: i32, j: i32| DVec3::new(f64::from(i) * 0.7, f64::from(j) * 0.3, f64::from((i * j) % 5));
            (0..30).flat_map(|i| (0..30).map(move |j| at(i, j) + by)).collect()
        };
        let by = DVec3::new(512_000.0, 5_400_000.0, 0.0);
        let (near, far) = (Hull::of(&points(DVec3::ZERO)).unwrap(), Hull::of(&points(by)).unwrap());
        let step = 1.0 / 1024.0;
        let moved = Hull { points: far.points().iter().map(|p| on_lattice(*p, step) - by).collect() };
        assert_eq!(near.snapped(step), moved);
    }
}
