//! Boxes in world coordinates.

use glam::DVec3;

/// An axis-parallel box in world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// West, south, lowest.
    pub min: DVec3,
    /// East, north, highest.
    pub max: DVec3,
}

impl Bounds {
    /// The box of finite, ordered corners.
    pub fn new(min: DVec3, max: DVec3) -> Option<Bounds> {
        (min.is_finite() && max.is_finite() && min.cmple(max).all()).then_some(Bounds { min, max })
    }

    /// The smallest box around points; `None` for none.
    pub fn around(points: &[DVec3]) -> Option<Bounds> {
        let first = *points.first()?;
        let (min, max) = points.iter().fold((first, first), |(min, max), p| (min.min(*p), max.max(*p)));
        Some(Bounds { min, max })
    }

    /// What both hold; `None` where that is nothing.
    pub fn within(self, other: Bounds) -> Option<Bounds> {
        Bounds::new(self.min.max(other.min), self.max.min(other.max))
    }

    /// The smallest box around both.
    pub fn union(self, other: Bounds) -> Bounds {
        Bounds { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Upper corner minus lower corner.
    pub fn size(&self) -> DVec3 {
        self.max - self.min
    }

    /// Middle of the box.
    pub fn center(&self) -> DVec3 {
        self.min + (self.max - self.min) * 0.5
    }

    /// The same to the nearest multiple of `step`, a power of two, so that its size does not depend on where it lies.
    pub fn snapped(&self, step: f64) -> Bounds {
        Bounds { min: on_lattice(self.min, step), max: on_lattice(self.max, step) }
    }

    /// The same, grown evenly on all sides until its longest side is at least `side`: what is smaller than a cell is
    /// drawn as large as one.
    pub fn at_least(&self, side: f64) -> Bounds {
        let grown = (0.5 * (side - (self.max - self.min).max_element())).max(0.0);
        Bounds { min: self.min - grown, max: self.max + grown }
    }

    /// How far down the sides of columns in the box, which have no end, are looked for: as far as a picture of the box
    /// shows any.
    pub fn solid_down_to(&self) -> f64 {
        self.min.z - 1000.0 * (self.max - self.min).max_element()
    }

    /// The box out to the borders of the cells of `cell` that it touches: what is drawn of points that lie in it.
    pub fn of_cells(&self, cell: f64) -> Bounds {
        let out = |v: f64, border: fn(f64) -> f64| border(v / cell) * cell;
        let [west, south] = [self.min.x, self.min.y].map(|v| out(v, f64::floor));
        let [east, north] = [self.max.x, self.max.y].map(|v| out(v, |v| v.floor() + 1.0));
        Bounds { min: DVec3::new(west, south, self.min.z), max: DVec3::new(east, north, self.max.z) }
    }

    /// The box as it is shown under vertical exaggeration about `pivot_u`.
    pub fn exaggerated(&self, z_scale: f64, pivot_u: f64) -> Bounds {
        let shown = |v: DVec3| DVec3 { z: pivot_u + (v.z - pivot_u) * z_scale, ..v };
        Bounds { min: shown(self.min), max: shown(self.max) }
    }

    /// Its eight corners.
    pub fn corners(&self) -> [DVec3; 8] {
        let pick = |bit: usize, a: f64, b: f64| if bit == 0 { a } else { b };
        std::array::from_fn(|k| {
            DVec3::new(
                pick(k & 1, self.min.x, self.max.x),
                pick(k & 2, self.min.y, self.max.y),
                pick(k & 4, self.min.z, self.max.z),
            )
        })
    }
}

/// To the nearest multiple of `step`, a power of two.
pub fn on_lattice(v: DVec3, step: f64) -> DVec3 {
    (v / step).round() * step
}
