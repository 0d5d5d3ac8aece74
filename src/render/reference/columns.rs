//! Points to columns: the finest cells under one mask, binned apart from the sections that they check.

use crate::attribute::ClassMask;
use std::collections::HashMap;

/// Most cells of a bounding box that are kept in a flat array.
const DENSE_CELLS: u64 = 1 << 24;

/// A decoded point, CRS units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// East.
    pub e: f64,
    /// North.
    pub n: f64,
    /// Up.
    pub u: f64,
    /// ASPRS class.
    pub class: u8,
    /// As stored.
    pub intensity: u16,
    /// 8 bit a channel.
    pub rgb: [u8; 3],
    /// Return number in the low nibble, number of returns in the high nibble.
    pub returns: u8,
    /// Class flags.
    pub flags: u8,
}

impl Point {
    /// Its cell, and what a column would keep of it; `None` if `mask` or one of its flags hides it, or no cell or height can hold it.
    pub(super) fn binned(
        &self,
        [cell_size, height_step]: [f64; 2],
        mask: &ClassMask,
        hidden_flags: u8,
    ) -> Option<([i64; 2], Column)> {
        let steps = (self.u / height_step).ceil();
        let cell = [(self.e / cell_size).floor(), (self.n / cell_size).floor()];
        let on_grid = cell.iter().all(|v| v.abs() < 9e15) && steps.abs() < 2_147_483_648.0;
        if !on_grid || !mask.shows(self.class) || self.flags & hidden_flags != 0 {
            return None;
        }
        let column = Column {
            height_steps: steps as i64,
            class: self.class,
            intensity: self.intensity,
            rgb: self.rgb,
            returns: self.returns,
            flags: self.flags,
        };
        Some((cell.map(|v| v as i64), column))
    }
}

/// The point that won a cell. Field by field, the larger wins.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Column {
    /// Top in steps of the heights' lattice: ceil(U / step).
    pub height_steps: i64,
    /// ASPRS class.
    pub class: u8,
    /// As stored.
    pub intensity: u16,
    /// 8 bit a channel.
    pub rgb: [u8; 3],
    /// Return number and count.
    pub returns: u8,
    /// Class flags.
    pub flags: u8,
}

/// All columns at the finest level under one mask.
#[derive(Debug)]
pub struct ColumnMap {
    pub(super) cell_size: f64,
    /// Of the heights' lattice, CRS units.
    pub(super) height_step: f64,
    /// First and last occupied cell, both ways.
    pub(super) first: [i64; 2],
    pub(super) last: [i64; 2],
    /// Top of the highest column, CRS units.
    pub(super) highest: f64,
    columns: Vec<Column>,
    pub(super) index: Index,
}

/// Cell → place in `columns`.
#[derive(Debug)]
pub(super) enum Index {
    /// Row by row over the bounding box; `u32::MAX` where there is no point.
    Dense(Vec<u32>),
    /// For a box that strays have blown up.
    Sparse(HashMap<[i64; 2], u32>),
}

impl ColumnMap {
    /// Bins the points that `mask` shows into cells of `cell_size`, heights in steps of `height_step`; those that
    /// have one of `hidden_flags` (bits of LAS 1.4 R15, table 9) are not among them. Points that are not finite or off the height lattice are left out.
    pub fn build(
        points: impl IntoIterator<Item = Point>,
        [cell_size, height_step]: [f64; 2],
        mask: &ClassMask,
        hidden_flags: u8,
    ) -> ColumnMap {
        let mut cells: HashMap<[i64; 2], Column> = HashMap::new();
        for p in points {
            let Some((cell, column)) = p.binned([cell_size, height_step], mask, hidden_flags) else {
                continue;
            };
            cells.entry(cell).and_modify(|c| *c = column.max(*c)).or_insert(column);
        }
        ColumnMap::from_cells(cells, [cell_size, height_step])
    }

    /// Takes columns that are binned already.
    pub fn from_cells(
        cells: impl IntoIterator<Item = ([i64; 2], Column)>,
        [cell_size, height_step]: [f64; 2],
    ) -> ColumnMap {
        let (keys, columns): (Vec<[i64; 2]>, Vec<Column>) = cells.into_iter().unzip();
        let mut first = [i64::MAX; 2];
        let mut last = [i64::MIN; 2];
        for key in &keys {
            for axis in 0..2 {
                first[axis] = first[axis].min(key[axis]);
                last[axis] = last[axis].max(key[axis]);
            }
        }
        let numbered = keys.iter().copied().zip(0u32..);
        let side = |axis: usize| last[axis].saturating_sub(first[axis]).unsigned_abs().saturating_add(1);
        let index = match side(0).checked_mul(side(1)) {
            Some(area) if !keys.is_empty() && area <= DENSE_CELLS => {
                let mut flat = vec![u32::MAX; area as usize];
                for ([i, j], place) in numbered {
                    flat[((j - first[1]) as u64 * side(0) + (i - first[0]) as u64) as usize] = place;
                }
                Index::Dense(flat)
            }
            _ => Index::Sparse(numbered.collect()),
        };
        let highest = columns.iter().map(|column| column.height_steps).max();
        let highest = highest.map_or(f64::NEG_INFINITY, |steps| steps as f64 * height_step);
        ColumnMap { cell_size, height_step, first, last, highest, columns, index }
    }

    /// Occupied cells.
    pub fn len(&self) -> usize {
        self.columns.len()
    }

    /// No point is shown.
    pub fn is_empty(&self) -> bool {
        self.columns.is_empty()
    }

    /// Top of a column, CRS units.
    pub fn top(&self, column: &Column) -> f64 {
        column.height_steps as f64 * self.height_step
    }

    /// The column of a cell.
    pub fn column(&self, cell: [i64; 2]) -> Option<&Column> {
        self.columns.get(self.place(cell)?)
    }

    /// Which of the columns, in the order that they came in, is that of a cell; one too high for a cell without any.
    pub(super) fn place(&self, [i, j]: [i64; 2]) -> Option<usize> {
        let inside =
            (self.first[0]..=self.last[0]).contains(&i) && (self.first[1]..=self.last[1]).contains(&j);
        let place = match &self.index {
            _ if !inside => return None,
            Index::Dense(flat) => {
                let row = (self.last[0] - self.first[0] + 1) as usize;
                flat[(j - self.first[1]) as usize * row + (i - self.first[0]) as usize]
            }
            Index::Sparse(map) => *map.get(&[i, j])?,
        };
        Some(place as usize)
    }

    /// All columns and their cells, in no order.
    pub fn cells(&self) -> impl Iterator<Item = ([i64; 2], &Column)> {
        let row = self.last[0].saturating_sub(self.first[0]).saturating_add(1);
        let places: Box<dyn Iterator<Item = ([i64; 2], u32)>> = match &self.index {
            Index::Dense(flat) => Box::new(
                (0i64..)
                    .zip(flat)
                    .map(move |(k, &place)| ([self.first[0] + k % row, self.first[1] + k / row], place)),
            ),
            Index::Sparse(map) => Box::new(map.iter().map(|(&cell, &place)| (cell, place))),
        };
        places.filter_map(|(cell, place)| Some((cell, self.columns.get(place as usize)?)))
    }
}
