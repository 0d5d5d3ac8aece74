//! Stacks whose solid part is a smooth surface: the rule of the corners, and the rays that meet the surface between them.
//!
//! A column's top is bilinear between four corners. At a corner four columns meet; its height for one of them is the mean top of
//! those that hang together with it: side by side, and neither a jump higher nor lower. A ray hits the surface where it comes
//! through it from above, and a side where it comes into a column below the surface. What floats is as `joined` has it.
//!
//! The device computes in f32 and may be off by what [`SmoothMap::tolerance`] says: a thousandth of a cell to the side and a step of
//! the heights' lattice up or down, which along a ray that only grazes a surface is far. Classes and distances so agree on
//! 99.9 % of the pixels.

use super::columns::Column;
use super::compare::Tolerance;
use super::corners::{Corners, mean_corner, normal_of};
use super::joined::{Lattice, Shape, shapes};
use super::stacks::{StackMap, first};
use super::trace::{Contact, Face, Hit, Stay, each_pixel};
use crate::render::camera::RayBasis;
use glam::DVec3;
use std::sync::OnceLock;

/// A surface at the finest level under one mask.
#[derive(Debug)]
pub struct SmoothMap {
    stacks: StackMap,
    lattice: Lattice,
    /// What floats in each column, in the order of the stacks, once it was asked for.
    floating: Vec<OnceLock<Vec<(Column, Shape)>>>,
}

impl SmoothMap {
    /// Of `stacks` made with `gap`; surfaces end where columns beside each other differ by more than `jump`. Lattice steps.
    pub fn new(stacks: StackMap, jump: i64, gap: i64) -> SmoothMap {
        let tops = stacks.tops();
        let lattice = Lattice { cell_size: tops.cell_size, height_step: tops.height_step, jump, gap };
        let floating = (0..tops.len()).map(|_| OnceLock::new()).collect();
        SmoothMap { stacks, lattice, floating }
    }

    fn top(&self, cell: [i64; 2]) -> Option<i64> {
        Some(self.stacks.stack(cell)?.solid?.height_steps)
    }

    /// Height of the corner of a column that lies `east` and `north` of its middle, -1 or 1, lattice steps.
    fn corner(&self, [i, j]: [i64; 2], [east, north]: [i64; 2]) -> Option<i64> {
        // In a circle: each is beside the one before.
        let around = [[i, j], [i + east, j], [i + east, j + north], [i, j + north]];
        mean_corner(around.map(|cell| self.top(cell)), self.lattice.jump)
    }

    /// The corners of a column that holds anything solid, U: south-west, south-east, north-west, north-east.
    pub fn corners(&self, cell: [i64; 2]) -> Option<Corners> {
        let corner = |at: [i64; 2]| Some(self.stacks.units(self.corner(cell, at)?));
        Some([corner([-1, -1])?, corner([1, -1])?, corner([-1, 1])?, corner([1, 1])?])
    }

    /// Walks the ray of a pixel (whole numbers = pixel centres) cell by cell to its first hit.
    pub fn trace(&self, basis: &RayBasis, px: f64, py: f64) -> Option<Hit> {
        self.stacks.tops().walk(basis, [px, py], |stay| self.contact(stay, basis))
    }

    /// All pixels of an image, row by row from the top.
    pub fn render(&self, basis: &RayBasis, size: [u32; 2]) -> Vec<Option<Hit>> {
        each_pixel(size, |x, y| self.trace(basis, x, y))
    }

    /// What of a stack a ray meets first; of several at once the larger record.
    fn contact(&self, stay: &Stay, basis: &RayBasis) -> Option<(Contact, Column)> {
        let size = self.lattice.cell_size;
        let solid = self.corners(stay.cell).and_then(|corners| {
            let contact = stay.surface_contact(size, corners)?;
            Some((contact, self.stacks.stack(stay.cell)?.solid?))
        });
        let pixel = (basis.ox + basis.dx * stay.t_in).length();
        let floating = self.floating(stay.cell).iter();
        let floating = floating.filter_map(|(top, shape)| Some((shape.contact(stay, size, pixel)?, *top)));
        first(solid.into_iter().chain(floating))
    }

    fn floating(&self, cell: [i64; 2]) -> &[(Column, Shape)] {
        let place = self.stacks.tops().place(cell);
        let Some(known) = place.and_then(|place| self.floating.get(place)) else { return &[] };
        known.get_or_init(|| {
            let beside = |k: usize| [cell[0] + (k % 3) as i64 - 1, cell[1] + (k / 3) as i64 - 1];
            shapes(cell, std::array::from_fn(|k| self.stacks.stack(beside(k))), self.lattice)
        })
    }

    /// What a drawn distance may be off by at `hit`, CRS units: as where columns are flat (see [`Tolerance`]), and where something smooth or
    /// round is met what it takes the ray to come nearer to it by a step of the heights' lattice and by a thousandth of a cell to the
    /// side.
    pub fn tolerance(&self, hit: &Hit, basis: &RayBasis, [px, py]: [f64; 2]) -> f64 {
        let Lattice { cell_size, height_step, .. } = self.lattice;
        let flat = Tolerance { cell_size, height_step }.at(hit, basis, px, py);
        let (o, d, length) = (basis.origin(px, py), basis.direction(px, py), basis.length(px, py));
        let along = (hit.distance - basis.distance_eye_to_plane(px, py)) / length;
        let Some(normal) = self.normal(hit, o + d * along) else { return flat };
        let closing = normal.dot(d).abs() / length;
        flat + (height_step * normal.z.abs() + 0.001 * cell_size * normal.truncate().length()) / closing
    }

    /// Which way what is hit faces there; `None` where that is a side, or nothing.
    fn normal(&self, hit: &Hit, place: DVec3) -> Option<DVec3> {
        if let Some((_, shape)) = self.floating(hit.cell).iter().find(|(top, _)| *top == hit.column) {
            return shape.normal(hit, place, self.lattice.cell_size);
        }
        let corners = self.corners(hit.cell).filter(|_| hit.face == Face::Top)?;
        Some(normal_of(corners, hit.cell, place, self.lattice.cell_size))
    }
}
