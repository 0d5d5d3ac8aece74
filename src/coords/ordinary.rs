//! Cells and lattice heights of many points at a time.

use super::grid::{CELL_LIMIT, Grid};
use super::heights::Height;

/// [`Grid::cell_of`] and [`Grid::height`] for many ordinary points at a time, without a division where the cell
/// size allows: the same numbers, in loops that a compiler turns into vector instructions.
pub struct Ordinary {
    cell: f64,
    /// 1 / cell where that is exact: then so is every product.
    inverse: Option<f64>,
    coarsen: u32,
    /// The grid's anchor, modulo 2³²: cells are small numbers beside it.
    anchor: [i32; 2],
    /// First cell of the base grid and the one after the last, on each axis.
    range: [[f64; 2]; 2],
    /// Height steps in a CRS unit: exact, since the step is a power of two.
    steps_per_unit: f64,
}

/// Added to a number below 2³¹ it leaves the nearest integer in the low bits.
const TO_INTEGER: f64 = 6_755_399_441_055_744.0; // 1.5 · 2⁵²

impl Ordinary {
    /// Points are ordinary in those cells of the base grid that lie in `core` and that `grid` can count.
    pub fn new(grid: &Grid, core: &[std::ops::Range<i64>; 2]) -> Ordinary {
        let cell = grid.base_cell;
        let inverse = 1.0 / cell;
        let power_of_two = cell.to_bits() << 12 == 0 && cell.is_normal() && inverse.is_normal();
        let range = std::array::from_fn(|axis| {
            let counted = [-CELL_LIMIT, CELL_LIMIT].map(|limit| (grid.anchor[axis] + limit) << grid.coarsen);
            let first = core[axis].start.max(counted[0]).max(i32::MIN.into());
            let end = core[axis].end.min(counted[1]).min(i32::MAX.into());
            [first as f64, end as f64]
        });
        Ordinary {
            cell,
            inverse: power_of_two.then_some(inverse),
            coarsen: grid.coarsen,
            anchor: grid.anchor.map(|a| a as i32),
            range,
            steps_per_unit: grid.height_step.recip(),
        }
    }

    /// Cell indices along `axis` (0: east) of coordinates; `false`, and nothing meant, if one is not ordinary.
    pub fn cells(&self, axis: usize, coordinates: &[f64], indices: &mut [i32]) -> bool {
        match self.inverse {
            Some(inverse) => self.cells_by(axis, coordinates, indices, |v| v * inverse),
            None => self.cells_by(axis, coordinates, indices, |v| v / self.cell),
        }
    }

    #[inline]
    fn cells_by(&self, axis: usize, from: &[f64], to: &mut [i32], in_cells: impl Fn(f64) -> f64) -> bool {
        let ([first, end], anchor) = (self.range[axis], self.anchor[axis]);
        let mut ordinary = true;
        for (to, &from) in to.iter_mut().zip(from) {
            let v = in_cells(from);
            // NaN fails.
            ordinary &= (v >= first) & (v < end);
            let near = v + TO_INTEGER;
            let floor = (near.to_bits() as i32).wrapping_sub(i32::from(near - TO_INTEGER > v));
            *to = (floor >> self.coarsen).wrapping_sub(anchor);
        }
        ordinary
    }

    /// Lattice heights of `units`; `false`, and nothing meant, if one has none.
    pub fn heights(&self, units: &[f64], heights: &mut [Height]) -> bool {
        let mut ordinary = true;
        for (to, &u) in heights.iter_mut().zip(units) {
            let v = u * self.steps_per_unit;
            ordinary &= v.abs() < 2_147_483_646.0;
            let near = v + TO_INTEGER;
            *to = Height((near.to_bits() as i32).wrapping_add(i32::from(near - TO_INTEGER < v)));
        }
        ordinary
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn many_points_are_placed_as_one_is(
            cell in prop_oneof![(-8i32..8).prop_map(|k| f64::from(k).exp2()), 0.001f64..100.0],
            coarsen in 0u32..4,
            whole in -20_000_000i64..20_000_000,
            parts in prop::collection::vec((-2_000i32..2_000, 0u8..4, any::<f64>()), 1..40),
            step in -30i32..30,
            u in prop::collection::vec((prop_oneof![-3e9..3e9, Just(f64::NAN), any::<f64>()], 0u8..4), 1..9),
        ) {
            let height_step = f64::from(step).exp2();
            let grid = Grid { base_cell: cell, coarsen, anchor: [(whole >> 8 >> coarsen) << 8, 0], height_step };
            let core = [whole - 100_000..whole + 1_000, -1_000..1_000];
            let points = Ordinary::new(&grid, &core);
            for (tenths, kind, any) in parts {
                // On borders, beside them, anywhere.
                let e = (whole as f64 + f64::from(tenths) / 10.0) * cell;
                let e = [e, e.next_up(), e.next_down(), any][usize::from(kind)];
                let mut index = [0];
                let ordinary = points.cells(0, &[e], &mut index);
                let v = e / cell;
                let inside = v >= core[0].start as f64 && v < core[0].end as f64 && v.abs() < 2e9;
                prop_assert_eq!(ordinary, inside && grid.cell_of(e, 0.0).is_some());
                if ordinary {
                    prop_assert_eq!(index[0], grid.cell_of(e, 0.0).unwrap().i);
                }
            }
            for (steps, kind) in u {
                let steps: f64 = steps;
                // On the lattice, beside it, between, anywhere.
                let on = steps.round() * height_step;
                let u = [on, on.next_up(), on.next_down(), steps * height_step][usize::from(kind)];
                let (mut height, one) = ([Height(0)], grid.height(u));
                let ordinary = points.heights(&[u], &mut height);
                prop_assert_eq!(ordinary, (u / height_step).abs() < 2_147_483_646.0);
                if ordinary {
                    prop_assert_eq!(Some(height[0]), one);
                }
                // Below the smallest ordinary numbers a quotient is rounded to 0.
                if let Some(height) = one.filter(|_| u == 0.0 || u.abs() > 1e-290) {
                    // At or above, by no more than rounding makes of less than a step.
                    let above = grid.units(height) - u;
                    prop_assert!((0.0..=height_step).contains(&above), "{} of {}", above, height_step);
                    prop_assert_eq!(grid.height(grid.units(height)), Some(height));
                }
            }
        }
    }
}
