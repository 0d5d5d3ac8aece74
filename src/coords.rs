//! Units as types: heights on one lattice, cells, sections.

/// Step of the heights' lattice where nothing speaks against it, CRS units: 2⁻¹⁰.
pub const HEIGHT_STEP: f64 = 1.0 / 1024.0;
/// Smallest cell for which that is fine enough.
const LEAST_CELL_OF_HEIGHT_STEP: f64 = 1.0 / 64.0;
/// Height steps in a cell of another size, or up to twice as many.
const STEPS_IN_A_CELL: f64 = 256.0;
/// Steps from U = 0 to the highest and lowest of most heights: 31 bits with the sign. [`Height`] has one more, for what
/// stands out of them and for differences.
pub const HEIGHT_REACH: f64 = (1u32 << 30) as f64;

/// log2 of a section's side in cells.
pub const SECTION_LOG2: u32 = 8;
/// A section's side in cells.
pub const SECTION_SIDE: u32 = 1 << SECTION_LOG2;
/// Columns in a section.
pub const SECTION_COLUMNS: usize = (SECTION_SIDE * SECTION_SIDE) as usize;

/// Largest distance of a cell index from the grid's origin that the device can address (i32 with room).
pub const CELL_LIMIT: i64 = 1 << 29;

/// A height on the lattice of [`Grid::height_step`]: `ceil(U / step)`. `i32::MIN` never occurs: it stands for "no point".
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Height(pub i32);

/// The step of the lattice, anchored at U = 0, for cells of `cell` and heights most of which lie between `low` and
/// `high` (CRS units): [`HEIGHT_STEP`] if cells are not tiny and 31 bits count those heights in it, else the largest
/// power of two that is at most 1/256 of a cell, raised until they do. `None` where it would be larger than a cell:
/// the heights then are too many cells from 0 to be told apart.
pub fn height_step(cell: f64, [low, high]: [f64; 2]) -> Option<f64> {
    // As far as it takes: the smallest step that counts the heights.
    let least = low.abs().max(high.abs()) / HEIGHT_REACH;
    if cell >= LEAST_CELL_OF_HEIGHT_STEP && least <= HEIGHT_STEP {
        return Some(HEIGHT_STEP);
    }
    let step = power_of_two_at_most(cell / STEPS_IN_A_CELL);
    let step = if least <= step { step } else { power_of_two_at_most(least.next_down()) * 2.0 };
    (step <= cell && step.is_normal() && step.recip().is_normal()).then_some(step)
}

/// The largest power of two that is at most `size`, which is positive and finite.
pub fn power_of_two_at_most(size: f64) -> f64 {
    // The exponent alone; what is smaller than those that have one becomes 0.
    f64::from_bits(size.to_bits() & 0x7FF0_0000_0000_0000)
}

/// A finest cell of the grid: indices relative to [`Grid::anchor`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CellIndex {
    /// Eastward index.
    pub i: i32,
    /// Northward index.
    pub j: i32,
}

/// A section of the quadtree: `SECTION_SIDE` cells of `c·2^level` on a side, at section indices (i, j)
/// relative to [`Grid::anchor`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SectionKey {
    /// Detail level k: cells are `c·2^k` wide.
    pub level: u8,
    /// Eastward section index at this level.
    pub i: i32,
    /// Northward section index at this level.
    pub j: i32,
}

impl SectionKey {
    /// The section that holds `cell` at the finest level.
    #[inline]
    pub fn of(cell: CellIndex) -> SectionKey {
        SectionKey { level: 0, i: cell.i >> SECTION_LOG2, j: cell.j >> SECTION_LOG2 }
    }

    /// The section one level coarser that covers this one.
    pub fn parent(self) -> SectionKey {
        SectionKey { level: self.level + 1, i: self.i >> 1, j: self.j >> 1 }
    }

    /// One of the four one level finer: quarter 0 is south-west, 1 south-east, 2 north-west.
    pub fn child(self, quarter: i32) -> SectionKey {
        SectionKey { level: self.level - 1, i: self.i * 2 + (quarter & 1), j: self.j * 2 + (quarter >> 1) }
    }

    /// First finest cell and the one after the last, along an axis.
    pub fn cells(self, axis: usize) -> [i64; 2] {
        let log2 = SECTION_LOG2 + u32::from(self.level);
        let first = i64::from([self.i, self.j][axis]) << log2;
        [first, first + (1 << log2)]
    }

    /// Whether it holds some of the finest cells from `low` to below `high`.
    pub fn touches(self, low: [i32; 2], high: [i32; 2]) -> bool {
        (0..2).all(|axis| {
            let [first, end] = self.cells(axis);
            first < high[axis].into() && i64::from(low[axis]) < end
        })
    }
}

/// Where a file's points are believed to lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// First finest cell, east and north.
    pub low: [i32; 2],
    /// The cell after the last.
    pub high: [i32; 2],
    /// Lowest and highest point, CRS units.
    pub up: [f64; 2],
}

/// The one grid that every file and every run shares: cell index = floor(E / c), anchored at the CRS
/// origin, optionally coarsened by whole powers of two (index >> coarsen); and the lattice that heights lie on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Cell size c before coarsening, CRS units.
    pub base_cell: f64,
    /// Doublings applied on top of `base_cell`.
    pub coarsen: u32,
    /// Added to device-side indices to get absolute ones (in coarsened cells; a multiple of
    /// `SECTION_SIDE`), so that northing 6,000,000 is as small a number as 0.
    pub anchor: [i64; 2],
    /// Step of the heights' lattice, CRS units; a power of two, chosen once (see [`height_step`]). Coarser cells keep it.
    pub height_step: f64,
}

impl Grid {
    /// The lattice height at or just above `u` (CRS units); `None` for NaN and from ±(2³¹ - 1) steps on.
    #[inline]
    pub fn height(&self, u: f64) -> Option<Height> {
        let h = (u / self.height_step).ceil();
        // NaN fails both comparisons.
        if h > -2_147_483_648.0 && h < 2_147_483_647.0 { Some(Height(h as i32)) } else { None }
    }

    /// CRS units above U = 0.
    pub fn units(&self, height: Height) -> f64 {
        f64::from(height.0) * self.height_step
    }

    /// Height steps in the side of a cell of detail level `level`.
    pub fn cell_steps(&self, level: u8) -> f64 {
        self.cell() * f64::from(level).exp2() / self.height_step
    }

    /// Side of a finest cell, CRS units.
    pub fn cell(&self) -> f64 {
        self.base_cell * f64::from(self.coarsen).exp2()
    }

    /// The cell that holds (e, n); `None` when it lies more than [`CELL_LIMIT`] cells from the anchor
    /// or is not finite.
    #[inline]
    pub fn cell_of(&self, e: f64, n: f64) -> Option<CellIndex> {
        let i = (e / self.base_cell).floor();
        let j = (n / self.base_cell).floor();
        if !(i.abs() < 9e15 && j.abs() < 9e15) {
            return None;
        }
        let i = ((i as i64) >> self.coarsen) - self.anchor[0];
        let j = ((j as i64) >> self.coarsen) - self.anchor[1];
        let inside = -CELL_LIMIT..CELL_LIMIT;
        (inside.contains(&i) && inside.contains(&j)).then_some(CellIndex { i: i as i32, j: j as i32 })
    }
}

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

/// A number for people: at most six digits behind the point, none of them idle; an exponent where it would be long.
pub fn tidy(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && !(1e-6..1e15).contains(&size) {
        // Four digits, again without idle ones.
        return format!("{value:.3e}")
            .parse::<f64>()
            .map_or_else(|_| value.to_string(), |v| format!("{v:e}"));
    }
    let fixed = format!("{value:.6}");
    fixed.trim_end_matches('0').trim_end_matches('.').to_owned()
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

    #[test]
    fn numbers_are_tidy() {
        let numbers =
            [0.0, 1.0, -0.25, 17.275000000000002, 6_277_568.0, 100.0, 1e-6, 1e-30, 1.0 / 3e9, 1e300];
        let words =
            ["0", "1", "-0.25", "17.275", "6277568", "100", "0.000001", "1e-30", "3.333e-10", "1e300"];
        assert_eq!(numbers.map(tidy), words);
        assert_eq!(tidy(f64::NAN), "NaN");
    }

    #[test]
    fn heights_round_up_onto_the_lattice() {
        let grid = Grid { base_cell: 0.5, coarsen: 0, anchor: [0; 2], height_step: HEIGHT_STEP };
        assert_eq!(grid.height(1.0), Some(Height(1024)));
        assert_eq!(grid.height(1.0001), Some(Height(1025)));
        assert_eq!(grid.height(-1.0001), Some(Height(-1024)));
        assert_eq!(grid.height(f64::NAN), None);
        assert_eq!(grid.height(3e6), None);
        assert_eq!(grid.height(-3e6), None);
        assert_eq!((grid.cell_steps(0), grid.cell_steps(3)), (512.0, 4096.0));
    }

    #[test]
    fn the_step_follows_cells_and_heights() {
        let step = |cell: f64, low: f64, high: f64| height_step(cell, [low, high]);
        // Ordinary surveys, and very coarse cells.
        assert_eq!(step(0.5, -400.0, 8_848.0), Some(HEIGHT_STEP));
        assert_eq!(step(1.0 / 64.0, 0.0, 0.0), Some(HEIGHT_STEP));
        assert_eq!(step(1e6, 0.0, 1e6), Some(HEIGHT_STEP));
        // Small things: 1/256 of a cell, rounded down.
        assert_eq!(step(1.0 / 128.0, 0.0, 3.0), Some(1.0 / 32_768.0));
        assert_eq!(step(0.01, 0.0, 3.0), Some(1.0 / 32_768.0));
        // Millimetres at 3,000 m, centimetres at 10⁸, metres from the centre of the Earth.
        assert_eq!(step(512.0, 2_990_000.0, 3_010_000.0), Some(2.0));
        assert_eq!(step(32.0, 99_990_000.0, 100_020_000.0), Some(0.125));
        assert_eq!(step(0.5, 5e6, 5.1e6), Some(1.0 / 128.0));
        assert_eq!(step(1.0, -1e8, 1e8), Some(0.125));
        // 31 bits, to the step.
        let reach = f64::from(1 << 20);
        assert_eq!(step(1.0, -reach, reach), Some(HEIGHT_STEP));
        assert_eq!(step(1.0, 0.0, reach.next_up()), Some(1.0 / 256.0));
        let reach = f64::from(1 << 22);
        assert_eq!(step(1.0, 0.0, reach), Some(1.0 / 256.0));
        assert_eq!(step(1.0, 0.0, reach.next_up()), Some(1.0 / 128.0));
        // A step as large as a cell, and no larger.
        assert_eq!(step(1.0, 0.0, f64::from(1 << 30)), Some(1.0));
        assert_eq!(step(1.0, 0.0, f64::from(1 << 30).next_up()), None);
        assert_eq!(step(1e-30, 0.0, 0.0).map(|step| step.log2()), Some(-108.0));
        assert_eq!(step(1e-320, 0.0, 0.0), None);
    }

    #[test]
    fn coarsening_equals_a_shift_of_the_fine_index() {
        let fine = Grid { base_cell: 0.3, coarsen: 0, anchor: [0, 0], height_step: HEIGHT_STEP };
        let coarse = Grid { coarsen: 1, ..fine };
        for k in -2000..2000 {
            let e = f64::from(k) * 0.1;
            let (f, g) = (fine.cell_of(e, -e).unwrap(), coarse.cell_of(e, -e).unwrap());
            assert_eq!((f.i >> 1, f.j >> 1), (g.i, g.j));
        }
    }

    #[test]
    fn a_far_northing_is_a_small_index() {
        let grid =
            Grid { base_cell: 0.5, coarsen: 0, anchor: [1_000_192, 12_000_000], height_step: HEIGHT_STEP };
        assert_eq!(grid.cell_of(500_100.0, 6_000_000.25), Some(CellIndex { i: 8, j: 0 }));
        assert_eq!(grid.cell_of(f64::INFINITY, 0.0), None);
        assert_eq!(grid.cell_of(1e12, 0.0), None);
    }
}
