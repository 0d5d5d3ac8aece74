//! What both pipelines draw: sections in host memory, repeated without end, so that no path runs out of land.

use crate::attribute::{AttributeError, ClassMask, ColorTable, Flags, Record};
use crate::coords::{Bounds, Grid, Height, SECTION_SIDE, SectionKey};
use crate::load::{self, LoadError, LoadOptions, Loaded};
use crate::problems::Problems;
use crate::resident::visibility::Visibility;
use crate::section::slot::slot_bytes;
use crate::section::{Columns, Payload, column_at};
use crate::synth;
use std::collections::HashMap;

/// Binned columns on a torus: the section at (i, j) is the one at (i mod width, j mod depth).
pub struct World {
    /// The grid.
    pub grid: Grid,
    /// What is seen of it.
    pub visibility: Visibility,
    /// How hits are coloured.
    pub colors: ColorTable,
    /// Lattice height from which heights count on the device.
    pub anchor: Height,
    /// Where the data really is.
    pub bounds: Bounds,
    /// South-western section, and how many there are each way.
    origin: [i32; 2],
    period: [i32; 2],
    sections: HashMap<[i32; 2], Columns>,
    /// Of every column, row by row from the south-west: top in lattice steps from the anchor (negative infinity:
    /// nothing there), and colour as RGBA8.
    tops: Vec<f32>,
    map: Vec<u32>,
}

/// sRGB bytes of a record, red lowest.
fn rgba(record: &Record, colors: &ColorTable) -> u32 {
    let [r, g, b] = colors.color(*record).map(|v| (v * 255.0).round() as u8);
    u32::from_le_bytes([r, g, b, 255])
}

/// The visible top of every column of a packed section: column (y << 8 | x), record.
fn tops(packed: &Payload, visibility: &Visibility, mut each: impl FnMut(usize, Record)) {
    packed.columns(|column, runs| {
        let shown = |r: &&Record| visibility.shows(r.kind());
        if let Some(&record) = runs.iter().find(shown) {
            let [x, y] = column_at(column);
            each((y << 8 | x) as usize, record);
        }
    });
}

/// Points of the town that is flown over: 4096 × 4096 cells.
pub const TOWN_POINTS: u64 = 1 << 25;
/// Points of it in a cell, on average: nearly every cell is hit.
const POINTS_PER_CELL: f64 = 2.0;

/// A town of `points` in memory, in the cells that `options` name. It is as large as `points` fill cells of `cell`, and
/// its border is one of sections of cells of `widest`, so that it repeats without a gap.
pub fn town(
    seed: u64,
    points: u64,
    [cell, widest]: [f64; 2],
    options: &LoadOptions,
    problems: &mut Problems,
) -> Result<Loaded, LoadError> {
    let section = f64::from(SECTION_SIDE) * widest;
    let sections = ((points as f64 / POINTS_PER_CELL).sqrt() * cell / section).ceil().max(1.0);
    let side = sections * section;
    let corner = synth::ORIGIN.map(|o| ((o - side / 2.0) / section).round() * section - o);
    let tiles = synth::square(corner, side, points);
    load::tiles_of(&synth::Town::new(seed), &tiles, None, options, problems)
}

impl World {
    /// What the harness draws of what was loaded: every class, in the colours that the data has.
    pub fn of(loaded: Loaded) -> Result<World, AttributeError> {
        let colors = ColorTable::new(loaded.about.color, &loaded.about.summary, &loaded.grid, None, None)?;
        let seen = Visibility {
            classes: ClassMask::default(),
            hidden_flags: Flags::WITHHELD,
            bridge: 0,
            near_ties: false,
        };
        Ok(World::new(loaded, seen, colors))
    }

    /// From what was loaded, with `colors` and under `visibility`. Strays beyond the bounds are left out.
    pub fn new(loaded: Loaded, visibility: Visibility, colors: ColorTable) -> World {
        let Loaded { grid, sections, about, .. } = loaded;
        let bounds = about.bounds;
        let anchor = grid.height(bounds.center().z).expect("bounds of points that have heights");
        let side = f64::from(SECTION_SIDE) * grid.cell();
        let index = |v: f64, axis: usize| {
            ((v / side).floor() - grid.anchor[axis] as f64 / f64::from(SECTION_SIDE)) as i32
        };
        let low = [index(bounds.min.x, 0), index(bounds.min.y, 1)];
        let high = [index(bounds.max.x.next_down(), 0), index(bounds.max.y.next_down(), 1)];
        let sections: HashMap<_, _> = sections
            .into_iter()
            .map(|(key, columns)| ([key.i, key.j], columns))
            .filter(|([i, j], _)| (low[0]..=high[0]).contains(i) && (low[1]..=high[1]).contains(j))
            .collect();
        let period = [0, 1].map(|a| (high[a] - low[a] + 1).max(1));
        let [width, depth] = period.map(|n| n as usize * SECTION_SIDE as usize);
        let (mut top_of, mut map) = (vec![f32::NEG_INFINITY; width * depth], vec![0; width * depth]);
        for ([i, j], columns) in &sections {
            let [x0, y0] = [i - low[0], j - low[1]].map(|n| n as usize * SECTION_SIDE as usize);
            tops(&columns.pack(), &visibility, |column, record| {
                let at = (y0 + (column >> 8)) * width + x0 + (column & 0xFF);
                let height = record.height().expect("not empty");
                // Within 2²⁴ steps of the anchor, exact.
                top_of[at] = (height.0 - anchor.0) as f32;
                map[at] = rgba(&record, &colors);
            });
        }
        World { grid, visibility, colors, anchor, bounds, origin: low, period, sections, tops: top_of, map }
    }

    /// The columns of a section of level 0, wherever it lies; `None` where there is no point.
    pub fn columns(&self, key: SectionKey) -> Option<&Columns> {
        let at = [key.i, key.j];
        let at = [0, 1].map(|a| self.origin[a] + (at[a] - self.origin[a]).rem_euclid(self.period[a]));
        self.sections.get(&at)
    }

    /// What the derived part of a section takes of the pool, in the mean, bytes.
    pub fn mean_derived_bytes(&self) -> u64 {
        let all: u64 =
            self.sections.values().map(|columns| slot_bytes(columns.layout().derived_bytes())).sum();
        all / (self.sections.len() as u64).max(1)
    }

    /// Tops and colours of the cells (x.., y) in cells from the grid's anchor, as many as `heights` has.
    pub fn row(&self, [x, y]: [i32; 2], heights: &mut [f32], colors: &mut [u32]) {
        let side = SECTION_SIDE as i32;
        let [width, depth] = self.period.map(|n| (n * side) as usize);
        let row = (y - self.origin[1] * side).rem_euclid(depth as i32) as usize * width;
        let mut from = (x - self.origin[0] * side).rem_euclid(width as i32) as usize;
        let mut done = 0;
        while done < heights.len() {
            let n = (width - from).min(heights.len() - done);
            heights[done..done + n].copy_from_slice(&self.tops[row + from..][..n]);
            colors[done..done + n].copy_from_slice(&self.map[row + from..][..n]);
            (done, from) = (done + n, 0);
        }
    }

    /// Usual height of what is seen, and the highest of it, CRS units.
    pub fn relief(&self) -> [f64; 2] {
        let step = (self.tops.len() / 100_000).max(1);
        let mut some: Vec<_> = self.tops.iter().step_by(step).copied().filter(|t| t.is_finite()).collect();
        some.sort_by(f32::total_cmp);
        let highest = self.tops.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let units = |steps: f32| self.grid.units(Height(steps as i32 + self.anchor.0));
        [some.get(some.len() / 2).copied().unwrap_or(0.0), highest].map(units)
    }

    /// South-western cell of what repeats, counted from the grid's anchor.
    pub fn corner(&self) -> [i32; 2] {
        self.origin.map(|n| n * SECTION_SIDE as i32)
    }

    /// Cells that repeat, each way.
    pub fn cells(&self) -> [u32; 2] {
        self.period.map(|n| n as u32 * SECTION_SIDE)
    }
}
