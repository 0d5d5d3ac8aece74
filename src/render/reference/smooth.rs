//! Stacks whose solid part is a smooth surface: the rule of the corners, and the rays that meet the surface between them.
//!
//! A column's top is bilinear between four corners. At a corner four columns meet; its height for one of them is the mean top of
//! those that hang together with it: side by side, and neither a jump higher nor lower. A ray hits the surface where it comes
//! through it from above, and a side where it comes into a column below the surface.

use super::columns::Column;
use super::stacks::{StackMap, first};
use super::trace::{Contact, Face, Hit, Stay, each_pixel};
use crate::render::camera::RayBasis;

/// A surface at the finest level under one mask.
#[derive(Debug)]
pub struct SmoothMap {
    stacks: StackMap,
    /// Most steps of the heights' lattice from a column to the next.
    jump: i64,
}

/// Corners of a column, U: south-west, south-east, north-west, north-east.
type Corners = [f64; 4];

impl SmoothMap {
    /// Of the solid parts of `stacks`, which end where columns beside each other differ by more than `jump` lattice steps.
    pub fn new(stacks: StackMap, jump: i64) -> SmoothMap {
        SmoothMap { stacks, jump }
    }

    fn top(&self, cell: [i64; 2]) -> Option<i64> {
        Some(self.stacks.stack(cell)?.solid?.height_steps)
    }

    /// Height of the corner of a column that lies `east` and `north` of its middle, -1 or 1, lattice steps.
    fn corner(&self, [i, j]: [i64; 2], [east, north]: [i64; 2]) -> Option<i64> {
        // In a circle: each is beside the one before.
        let around = [[i, j], [i + east, j], [i + east, j + north], [i, j + north]];
        let tops = around.map(|cell| self.top(cell));
        tops[0]?;
        let mut hangs_together = [true, false, false, false];
        // As far as any is from the first.
        for _ in 0..3 {
            for k in 0..4 {
                let beside = [(k + 1) % 4, (k + 3) % 4];
                let joins = |&n: &usize| {
                    hangs_together[n] && tops[n].zip(tops[k]).is_some_and(|(a, b)| (a - b).abs() <= self.jump)
                };
                hangs_together[k] |= beside.iter().any(joins);
            }
        }
        let those = (0..4).filter(|&k| hangs_together[k]).filter_map(|k| tops[k]);
        let (sum, n) = those.fold((0, 0), |(sum, n), top| (sum + top, n + 1));
        Some(sum.div_euclid(n))
    }

    /// The corners of a column that holds anything solid.
    pub fn corners(&self, cell: [i64; 2]) -> Option<Corners> {
        let corner = |at: [i64; 2]| Some(self.stacks.units(self.corner(cell, at)?));
        Some([corner([-1, -1])?, corner([1, -1])?, corner([-1, 1])?, corner([1, 1])?])
    }

    /// Slope of the surface at a place of a column: units up a unit east and north.
    pub fn slope(&self, cell: [i64; 2], [e, n]: [f64; 2]) -> Option<[f64; 2]> {
        let [sw, se, nw, ne] = self.corners(cell)?;
        let size = self.stacks.tops().cell_size;
        let [x, y] = [e / size - cell[0] as f64, n / size - cell[1] as f64].map(|v| v.clamp(0.0, 1.0));
        let mix = |a: f64, b: f64, at: f64| a + (b - a) * at;
        Some([mix(se - sw, ne - nw, y) / size, mix(nw - sw, ne - se, x) / size])
    }

    /// Walks the ray of a pixel (whole numbers = pixel centres) cell by cell to its first hit.
    pub fn trace(&self, basis: &RayBasis, px: f64, py: f64) -> Option<Hit> {
        self.stacks.tops().walk(basis, [px, py], |stay| self.contact(stay))
    }

    /// All pixels of an image, row by row from the top.
    pub fn render(&self, basis: &RayBasis, size: [u32; 2]) -> Vec<Option<Hit>> {
        each_pixel(size, |x, y| self.trace(basis, x, y))
    }

    /// What of a stack a ray meets first; of several at once the larger record.
    fn contact(&self, stay: &Stay) -> Option<(Contact, Column)> {
        let solid = self.corners(stay.cell).and_then(|corners| {
            let contact = stay.surface_contact(self.stacks.tops().cell_size, corners)?;
            Some((contact, self.stacks.stack(stay.cell)?.solid?))
        });
        let floating = self.stacks.floating_contact(stay);
        first(solid.into_iter().chain(floating))
    }
}

impl Stay {
    /// The first contact with what is solid below a surface between `corners`, in cells of `size`.
    fn surface_contact(&self, size: f64, [sw, se, nw, ne]: Corners) -> Option<Contact> {
        let (o, d) = (self.origin, self.direction);
        let start = o + d * self.t_in;
        let [x, y] = [start.x / size - self.cell[0] as f64, start.y / size - self.cell[1] as f64]
            .map(|v| v.clamp(0.0, 1.0));
        let (dx, dy) = (d.x / size, d.y / size);
        let (east, north, twist) = (se - sw, nw - sw, ne - nw - se + sw);
        // Height above the surface s after the entry: a + b s + c s².
        let a = start.z - (sw + east * x + north * y + twist * x * y);
        let b = d.z - (east * dx + north * dy + twist * (x * dy + y * dx));
        let c = -twist * dx * dy;
        if a <= 0.0 {
            return Some(Contact { t: self.t_in, height: start.z, face: self.side });
        }
        let square = b * b - 4.0 * a * c;
        if square < 0.0 {
            return None;
        }
        let q = -0.5 * (b + square.sqrt().copysign(b));
        let s = [a / q, q / c].into_iter().filter(|s| *s > 0.0).fold(f64::INFINITY, f64::min);
        let t = self.t_in + s;
        let is_there = t < self.t_out || (t == self.t_out && self.out_closed);
        is_there.then_some(Contact { t, height: start.z + s * d.z, face: Face::Top })
    }
}
