//! Rays to hits, the twin of `shaders/trace.glsl`: cell by cell in f64, without table or pyramid.

use super::columns::{Column, ColumnMap};
use crate::render::camera::RayBasis;
use glam::DVec3;
use std::thread;

/// What a ray struck; numbered as the device does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Face {
    /// The top of a column, or of a span that floats in it.
    Top = 0,
    /// The side that faces west; the ray runs east.
    West = 1,
    /// The side that faces east.
    East = 2,
    /// The side that faces south.
    South = 3,
    /// The side that faces north.
    North = 4,
    /// None: the ray starts inside the column or span.
    Inside = 5,
    /// The bottom of a span that floats.
    Bottom = 6,
}

/// Where a ray first meets a column.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// From eye to hit along the ray, CRS units as seen.
    pub distance: f64,
    /// U of the hit, CRS units.
    pub height: f64,
    /// ASPRS class of the column.
    pub class: u8,
    /// What was struck.
    pub face: Face,
    /// floor(E / c), floor(N / c).
    pub cell: [i64; 2],
    /// The point that won the cell, or the highest of the span.
    pub column: Column,
}

/// A ray while it is in a cell.
pub(super) struct Stay {
    pub cell: [i64; 2],
    pub origin: DVec3,
    pub direction: DVec3,
    pub t_in: f64,
    pub t_out: f64,
    /// Whether the borders it comes in and leaves by belong to the cell.
    pub in_closed: bool,
    pub out_closed: bool,
    /// What it comes in by.
    pub side: Face,
}

/// Where a ray first meets something.
#[derive(Clone, Copy, Debug)]
pub(super) struct Contact {
    pub t: f64,
    pub height: f64,
    pub face: Face,
}

impl Stay {
    /// The first contact with what reaches from `bottom` up to `top`, both of them included.
    pub fn contact(&self, [bottom, top]: [f64; 2]) -> Option<Contact> {
        let (o, d) = (self.origin, self.direction);
        let [t_bottom, t_top] = [bottom, top].map(|u| (u - o.z) / d.z);
        let after_entry = |t: f64| self.t_in < t || (self.t_in == t && self.in_closed);
        let before_exit = |t: f64| t < self.t_out || (t == self.t_out && self.out_closed);
        let is_within_on_entry = if d.z < 0.0 {
            self.t_in > t_top && after_entry(t_bottom)
        } else if d.z > 0.0 {
            self.t_in >= t_bottom && after_entry(t_top)
        } else {
            (bottom..=top).contains(&o.z)
        };
        if is_within_on_entry {
            return Some(Contact { t: self.t_in, height: o.z + self.t_in * d.z, face: self.side });
        }
        let (t, height, face) = if d.z < 0.0 {
            (t_top, top, Face::Top)
        } else if d.z > 0.0 {
            (t_bottom, bottom, Face::Bottom)
        } else {
            return None;
        };
        (t >= self.t_in && before_exit(t)).then_some(Contact { t, height, face })
    }
}

impl ColumnMap {
    /// Walks the ray of a pixel (whole numbers = pixel centres) cell by cell to its first hit.
    pub fn trace(&self, basis: &RayBasis, px: f64, py: f64) -> Option<Hit> {
        self.walk(basis, [px, py], |stay| {
            let column = *self.column(stay.cell)?;
            Some((stay.contact([f64::NEG_INFINITY, self.top(&column)])?, column))
        })
    }

    /// Walks the ray of a pixel from cell to cell until there is contact with what stands in one.
    pub(super) fn walk(
        &self,
        basis: &RayBasis,
        [px, py]: [f64; 2],
        contact: impl Fn(&Stay) -> Option<(Contact, Column)>,
    ) -> Option<Hit> {
        let (o, d) = (basis.origin(px, py), basis.direction(px, py));
        if self.is_empty() {
            return None;
        }
        let t_highest = (self.highest - o.z) / d.z;
        let mut start = 0.0f64;
        if d.z < 0.0 {
            start = start.max(t_highest);
        } else if o.z > self.highest {
            return None;
        }
        let axes = [Axis { o: o.x, d: d.x, c: self.cell_size }, Axis { o: o.y, d: d.y, c: self.cell_size }];
        for axis in 0..2 {
            start =
                start.max(axes[axis].entry(if d[axis] < 0.0 { self.last[axis] } else { self.first[axis] }));
        }
        let mut cell = [0; 2];
        for axis in 0..2 {
            cell[axis] = axes[axis].cell_at(start, self.first[axis], self.last[axis])?;
        }
        loop {
            let enter = [axes[0].entry(cell[0]), axes[1].entry(cell[1])];
            let leave = [axes[0].exit(cell[0]), axes[1].exit(cell[1])];
            let t_in = enter[0].max(enter[1]).max(0.0);
            let t_out = leave[0].min(leave[1]);
            // Running west or south, the border left through belongs to the cell, the one entered by not.
            let in_closed = (0..2).all(|a| enter[a] < t_in || d[a] >= 0.0);
            let out_closed = (0..2).all(|a| leave[a] > t_out || d[a] < 0.0);
            if t_in < t_out || (t_in == t_out && in_closed && out_closed) {
                // On a border as well, if that belongs to the cell.
                let side = if t_in == 0.0 && in_closed {
                    Face::Inside
                } else if enter[0] >= enter[1] {
                    if d.x > 0.0 { Face::West } else { Face::East }
                } else if d.y > 0.0 {
                    Face::South
                } else {
                    Face::North
                };
                let stay = Stay { cell, origin: o, direction: d, t_in, t_out, in_closed, out_closed, side };
                if let Some((Contact { t, height, face }, column)) = contact(&stay) {
                    let distance = t * basis.length(px, py) + basis.distance_eye_to_plane(px, py);
                    return Some(Hit { distance, height, class: column.class, face, cell, column });
                }
            }
            if t_out == f64::INFINITY || (d.z > 0.0 && t_out > t_highest) {
                return None;
            }
            // At a corner the borders entered by a positive step belong to the cell beyond, so those
            // steps come first; of two alike both are taken at once.
            let corner = leave[0] == leave[1] && (d.x > 0.0) != (d.y > 0.0);
            for axis in 0..2 {
                if leave[axis] == t_out && !(corner && d[axis] < 0.0) {
                    cell[axis] += if d[axis] > 0.0 { 1 } else { -1 };
                    if !(self.first[axis]..=self.last[axis]).contains(&cell[axis]) {
                        return None;
                    }
                }
            }
        }
    }

    /// All pixels of an image, row by row from the top.
    pub fn render(&self, basis: &RayBasis, size: [u32; 2]) -> Vec<Option<Hit>> {
        each_pixel(size, |x, y| self.trace(basis, x, y))
    }
}

/// What `trace` finds for all pixels of an image, row by row from the top.
pub(super) fn each_pixel(
    [width, height]: [u32; 2],
    trace: impl Fn(f64, f64) -> Option<Hit> + Sync,
) -> Vec<Option<Hit>> {
    let mut hits = vec![None; width as usize * height as usize];
    let threads = thread::available_parallelism().map_or(1, |n| n.get());
    let rows = (height as usize).div_ceil(threads).max(1);
    let trace = &trace;
    thread::scope(|scope| {
        for (band, hits) in hits.chunks_mut((rows * width as usize).max(1)).enumerate() {
            scope.spawn(move || {
                for (k, hit) in hits.iter_mut().enumerate() {
                    let [x, y] = [k % width as usize, band * rows + k / width as usize];
                    *hit = trace(x as f64, y as f64);
                }
            });
        }
    });
    hits
}

/// One horizontal axis of a ray. Where it is in which cell is decided by comparing parameters of border
/// crossings alone, each computed from its border, so that nothing adds up on the way.
#[derive(Clone, Copy)]
struct Axis {
    o: f64,
    d: f64,
    c: f64,
}

impl Axis {
    fn crossing(&self, border: i64) -> f64 {
        (border as f64 * self.c - self.o) / self.d
    }

    /// Parameter at which the ray enters cells of index `i`.
    fn entry(&self, i: i64) -> f64 {
        match self.d {
            d if d > 0.0 => self.crossing(i),
            d if d < 0.0 => self.crossing(i + 1),
            _ => f64::NEG_INFINITY,
        }
    }

    /// Parameter at which the ray leaves cells of index `i`.
    fn exit(&self, i: i64) -> f64 {
        match self.d {
            d if d > 0.0 => self.crossing(i + 1),
            d if d < 0.0 => self.crossing(i),
            _ => f64::INFINITY,
        }
    }

    /// Index of the cell at `t`, which is not before the entry into the range; `None` beyond the range.
    fn cell_at(&self, t: f64, first: i64, last: i64) -> Option<i64> {
        if self.d == 0.0 {
            let i = (self.o / self.c).floor();
            return (i >= first as f64 && i <= last as f64).then_some(i as i64);
        }
        // The division may be a border off; the crossings decide.
        let guess = ((self.o + t * self.d) / self.c).floor();
        let mut i = if guess.is_finite() { guess.clamp(first as f64, last as f64) as i64 } else { first };
        let step = if self.d > 0.0 { 1 } else { -1 };
        while (first..=last).contains(&(i - step)) && self.entry(i) > t {
            i -= step;
        }
        // At a border: the cell beyond it running east or north, else the cell before it.
        while if self.d > 0.0 { self.exit(i) <= t } else { self.exit(i) < t } {
            i += step;
            if !(first..=last).contains(&i) {
                return None;
            }
        }
        Some(i)
    }
}
