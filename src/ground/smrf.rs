//! Stage 2, the ground filter: the simple morphological filter (SMRF) of Pingel, Clarke, McBride 2013, on integers.
//!
//! A tile is made of the 3 × 3 tiles of stage 1 around it and nothing else; what lies farther than [`MARGIN`] cells from it
//! changes nothing. So a cell that two tiles come to is the same in both.

use super::fill::{Bits, REACH, fill};
use super::grid::{GroundGrid, MOST_WINDOWS, TILE_SIDE};
use super::lows::{LowTile, NONE};
use super::opening::{Opening, Raster};
use super::tile::{CLASSIFIED, FILLED, GroundTile, LOW, MEASURED, OBJECT, RINGED};
use std::ops::Range;

/// A cell that drops by more than this times the radius of an opening is an object, rise over run.
const OBJECT_SLOPE: f64 = 0.15;
/// A cell that lies lower than this times a cell below a closing by one cell is a low outlier.
const LOW_SLOPE: f64 = 5.0;
/// Octants in which points lie around what is filled before openings: more than half, so that what stands at the border of
/// the data is not drawn out beyond it.
const ENCLOSED: usize = 5;
/// Radius of the openings that take crowns away before low outliers are told from ground below crowns, m. Wider ones take away the
/// land between outliers: that between those of a grid of 1.4 times as much.
const CROWN_M: f64 = 4.0;
const CROWN_CELLS: usize = CROWN_M as usize;

/// How far around a tile stages are computed, cells: slopes of the ring need one more.
const SURFACE: usize = 2;
const OPENED: usize = SURFACE + REACH;
const OPENINGS: usize = OPENED + 2 * MOST_WINDOWS;
const CLOSED: usize = OPENINGS + REACH;
const BARE: usize = CLOSED + 2;
const CROWNS: usize = BARE + REACH;
const FIRST: usize = CROWNS + 2 * CROWN_CELLS;
/// Cells around a tile that its ground depends on.
pub const MARGIN: usize = FIRST + REACH;
const SIDE: usize = TILE_SIDE + 2 * MARGIN;
// Within the neighbours.
const _: () = assert!(MARGIN <= TILE_SIDE);

/// Rows and columns of the raster that lie within `around` cells of the tile.
const fn within(around: usize) -> Range<usize> {
    MARGIN - around..MARGIN + TILE_SIDE + around
}

/// Makes tiles of the ground; one a thread, its memory is reused.
pub struct GroundFilter {
    surface: Raster,
    /// Without crowns.
    bare: Raster,
    opened: [Raster; 2],
    known: Bits,
    trusted: Bits,
    low: Bits,
    crowns: Bits,
    object: Vec<bool>,
    opening: Opening,
}

impl Default for GroundFilter {
    fn default() -> GroundFilter {
        let raster = || vec![NONE; SIDE * SIDE];
        GroundFilter {
            surface: raster(),
            bare: raster(),
            opened: [raster(), raster()],
            known: Bits::new(SIDE),
            trusted: Bits::new(SIDE),
            low: Bits::new(SIDE),
            crowns: Bits::new(SIDE),
            object: vec![false; SIDE * SIDE],
            opening: Opening::new(SIDE, MOST_WINDOWS),
        }
    }
}

impl GroundFilter {
    /// The ground of the tile in the middle of `near`, row by row from the south-west. O(cells).
    pub fn tile(&mut self, ground: &GroundGrid, near: [Option<&LowTile>; 9]) -> GroundTile {
        if near.iter().all(Option::is_none) {
            return GroundTile::void();
        }
        self.load(near);
        // Between the points, so that openings have a surface.
        fill(&mut self.surface, SIDE, [&self.known, &self.known], within(FIRST), ENCLOSED);
        if self.find_low(ground) {
            fill(&mut self.surface, SIDE, [&self.known, &self.low], within(OPENINGS), ENCLOSED);
        }
        self.find_objects(ground, ground.windows(), within(OPENED));
        self.take_out_objects();
        fill(&mut self.surface, SIDE, [&self.known, &self.known], within(SURFACE), 1);
        self.finish(ground)
    }

    /// Lowest heights around the tile, those of points that are classified as ground where there are any.
    fn load(&mut self, near: [Option<&LowTile>; 9]) {
        for y in 0..SIDE {
            // Rows and columns from the south-western corner of the nine tiles.
            let row = y + TILE_SIDE - MARGIN;
            let (south, inside) = (row / TILE_SIDE, row % TILE_SIDE * TILE_SIDE);
            let mut from = TILE_SIDE - MARGIN;
            let lows = &mut self.surface[y * SIDE..(y + 1) * SIDE];
            let mut is_trusted = [false; SIDE];
            let mut x = 0;
            while x < SIDE {
                let n = (TILE_SIDE - from % TILE_SIDE).min(SIDE - x);
                let cells = inside + from % TILE_SIDE..inside + from % TILE_SIDE + n;
                let lows = &mut lows[x..x + n];
                match near[south * 3 + from / TILE_SIDE] {
                    Some(tile) => {
                        lows.copy_from_slice(&tile.lowest()[cells.clone()]);
                        if let Some(trusted) = tile.trusted() {
                            let to = lows.iter_mut().zip(&mut is_trusted[x..x + n]);
                            for ((low, is_trusted), &trusted) in to.zip(&trusted[cells]) {
                                *is_trusted = trusted != NONE;
                                *low = if *is_trusted { trusted } else { *low };
                            }
                        }
                    }
                    None => lows.fill(NONE),
                }
                (x, from) = (x + n, from + n);
            }
            self.known.set_row(y, lows.iter().map(|&low| low != NONE));
            self.trusted.set_row(y, is_trusted.into_iter());
        }
    }

    /// Marks low outliers and takes them out of what is known; whether there are any. What is surrounded by crowns alone is
    /// ground: outliers lie as deep below the surface without crowns, too.
    fn find_low(&mut self, ground: &GroundGrid) -> bool {
        self.low.clear_all();
        let most = ground.steps(LOW_SLOPE * ground.cell());
        let cells = || within(CLOSED).flat_map(|y| within(CLOSED).map(move |x| (x, y)));
        let is_deep = |closed: &Raster, surface: &Raster, at: usize| {
            i64::from(closed[at]) - i64::from(surface[at]) > i64::from(most)
        };
        self.opening.close_by_one(&self.surface, within(CLOSED), &mut self.opened[0]);
        let mut found = false;
        for (x, y) in cells() {
            if is_deep(&self.opened[0], &self.surface, y * SIDE + x)
                && self.known.has(x, y)
                && !self.trusted.has(x, y)
            {
                self.low.set(x, y);
                found = true;
            }
        }
        if !found {
            return false;
        }
        self.clear_crowns(ground);
        self.opening.close_by_one(&self.bare, within(CLOSED), &mut self.opened[0]);
        found = false;
        for (x, y) in cells() {
            if self.low.has(x, y) {
                let at = y * SIDE + x;
                // Nothing surrounds what was taken away itself, with nothing to fill it from.
                if self.bare[at] != NONE && is_deep(&self.opened[0], &self.surface, at) {
                    self.known.clear(x, y);
                    found = true;
                } else {
                    self.low.clear(x, y);
                }
            }
        }
        found
    }

    /// Makes the surface without what openings up to the size of a crown take away.
    fn clear_crowns(&mut self, ground: &GroundGrid) {
        self.find_objects(ground, ground.cells_of(CROWN_M, CROWN_CELLS), within(CROWNS));
        self.bare.copy_from_slice(&self.surface);
        self.crowns.clear_all();
        for (y, row) in self.object.chunks_exact(SIDE).enumerate() {
            self.crowns.set_row(y, row.iter().copied());
        }
        self.known.take_out(&self.crowns);
        fill(&mut self.bare, SIDE, [&self.known, &self.crowns], within(BARE), ENCLOSED);
        self.known.put_in(&self.crowns);
    }

    /// Marks objects by openings of radii up to `widest` cells.
    fn find_objects(&mut self, ground: &GroundGrid, widest: usize, range: Range<usize>) {
        self.object.fill(false);
        let [before, opened] = &mut self.opened;
        before.copy_from_slice(&self.surface);
        for radius in 1..=widest {
            let most = ground.steps(OBJECT_SLOPE * radius as f64 * ground.cell());
            self.opening.open(&self.surface, radius, range.clone(), opened);
            for y in range.clone() {
                let row = y * SIDE + range.start..y * SIDE + range.end;
                let pairs = before[row.clone()].iter().zip(&opened[row.clone()]);
                for (object, (&before, &opened)) in self.object[row].iter_mut().zip(pairs) {
                    *object |= i64::from(before) - i64::from(opened) > i64::from(most);
                }
            }
            std::mem::swap(before, opened);
        }
        for y in range.clone() {
            for x in range.clone() {
                self.object[y * SIDE + x] &= self.known.has(x, y) && !self.trusted.has(x, y);
            }
        }
    }

    /// Takes objects out of what is known, and leaves nothing of the surface but that.
    fn take_out_objects(&mut self) {
        for y in within(OPENED) {
            for x in within(OPENED).filter(|&x| self.object[y * SIDE + x]) {
                self.known.clear(x, y);
            }
        }
        for y in within(SURFACE) {
            for x in within(SURFACE).filter(|&x| !self.known.has(x, y)) {
                self.surface[y * SIDE + x] = NONE;
            }
        }
    }

    /// The tile and its ring.
    fn finish(&self, ground: &GroundGrid) -> GroundTile {
        let mut tile = GroundTile::void();
        let steps = ground.cell() / ground.grid.height_step;
        for (row, y) in within(1).enumerate() {
            for (column, x) in within(1).enumerate() {
                let (at, to) = (y * SIDE + x, row * RINGED + column);
                let height = self.surface[at];
                let known = self.known.has(x, y);
                tile.heights[to] = height;
                let flags = [
                    (known, MEASURED),
                    (!known && height != NONE, FILLED),
                    (self.object[at], OBJECT),
                    (self.low.has(x, y), LOW),
                    (self.trusted.has(x, y), CLASSIFIED),
                ];
                tile.flags[to] = flags.iter().filter(|(is, _)| *is).fold(0, |flags, (_, flag)| flags | flag);
                if height != NONE {
                    let rise = [1, SIDE].map(|step| {
                        // Over two cells; at voids over one.
                        let [back, ahead] = [self.surface[at - step], self.surface[at + step]];
                        let ends = [back, ahead].map(|end| if end == NONE { height } else { end });
                        let cells = u8::from(back != NONE) + u8::from(ahead != NONE);
                        let rise = (i64::from(ends[1]) - i64::from(ends[0])) as f64;
                        rise / (f64::from(cells.max(1)) * steps)
                    });
                    tile.slopes[to] = (rise[0] * rise[0] + rise[1] * rise[1]).sqrt() as f32;
                }
            }
        }
        tile
    }
}
