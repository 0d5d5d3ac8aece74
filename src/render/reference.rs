//! What the picture must be: brute force over the finest cells, one by one, in f64.
//!
//! The exact image contract: a column is solid from its highest shown point down without end; a cell
//! without points is empty; cells are half-open, `[i, i + 1) · c`; a ray hits where it first is at or
//! below a column's top inside that cell. Written apart from the sections, pyramids and shaders that it
//! checks, and shares with them the rays and the class mask alone.

use crate::attribute::ClassMask;
use crate::render::camera::RayBasis;
use crate::render::image::MISS_CLASS;
use std::collections::HashMap;
use std::fmt;
use std::thread;

/// Class flag bit of a withheld point (LAS 1.4 R15, table 9).
const WITHHELD: u8 = 4;
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

/// What a ray struck.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Face {
    /// The top of a column.
    Top,
    /// The side that faces west; the ray runs east.
    West,
    /// The side that faces east.
    East,
    /// The side that faces south.
    South,
    /// The side that faces north.
    North,
    /// None: the ray starts inside the column.
    Inside,
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
    /// The point that won the cell.
    pub column: Column,
}

/// All columns at the finest level under one mask.
#[derive(Debug)]
pub struct ColumnMap {
    cell_size: f64,
    /// Of the heights' lattice, CRS units.
    height_step: f64,
    /// First and last occupied cell, both ways.
    first: [i64; 2],
    last: [i64; 2],
    /// Top of the highest column, CRS units.
    highest: f64,
    columns: Vec<Column>,
    index: Index,
}

/// Cell → place in `columns`.
#[derive(Debug)]
enum Index {
    /// Row by row over the bounding box; `u32::MAX` where there is no point.
    Dense(Vec<u32>),
    /// For a box that strays have blown up.
    Sparse(HashMap<[i64; 2], u32>),
}

impl ColumnMap {
    /// Bins the points that `mask` shows into cells of `cell_size`, heights in steps of `height_step`; withheld ones
    /// only on demand. Points that are not finite or off the height lattice are left out.
    pub fn build(
        points: impl IntoIterator<Item = Point>,
        [cell_size, height_step]: [f64; 2],
        mask: &ClassMask,
        show_withheld: bool,
    ) -> ColumnMap {
        let mut cells: HashMap<[i64; 2], Column> = HashMap::new();
        for p in points {
            let steps = (p.u / height_step).ceil();
            let cell = [(p.e / cell_size).floor(), (p.n / cell_size).floor()];
            let on_grid = cell.iter().all(|v| v.abs() < 9e15) && steps.abs() < 2_147_483_648.0;
            if !on_grid || !mask.shows(p.class) || (p.flags & WITHHELD != 0 && !show_withheld) {
                continue;
            }
            let column = Column {
                height_steps: steps as i64,
                class: p.class,
                intensity: p.intensity,
                rgb: p.rgb,
                returns: p.returns,
                flags: p.flags,
            };
            cells.entry(cell.map(|v| v as i64)).and_modify(|c| *c = column.max(*c)).or_insert(column);
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
    pub fn column(&self, [i, j]: [i64; 2]) -> Option<&Column> {
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
        self.columns.get(place as usize)
    }

    /// Walks the ray of a pixel (whole numbers = pixel centres) cell by cell to its first hit.
    pub fn trace(&self, basis: &RayBasis, px: f64, py: f64) -> Option<Hit> {
        let (o, d) = (basis.origin(px, py), basis.direction(px, py));
        if self.is_empty() {
            return None;
        }
        // Parameter at which the ray is at the top of height `u`.
        let t_top = |u: f64| (u - o.z) / d.z;
        let t_highest = t_top(self.highest);
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
            if let Some(&column) = self.column(cell)
                && (t_in < t_out || (t_in == t_out && in_closed && out_closed))
            {
                let top = self.top(&column);
                let t_top = t_top(top);
                let below_on_entry = if d.z < 0.0 {
                    t_in > t_top
                } else if d.z > 0.0 {
                    t_in < t_top || (t_in == t_top && in_closed)
                } else {
                    o.z <= top
                };
                let through_top =
                    d.z < 0.0 && t_top >= t_in && (t_top < t_out || (t_top == t_out && out_closed));
                let hit = |t: f64, height: f64, face: Face| Hit {
                    distance: t * basis.length(px, py) + basis.distance_eye_to_plane(px, py),
                    height,
                    class: column.class,
                    face,
                    cell,
                    column,
                };
                if below_on_entry {
                    let face = if t_in > enter[0] && t_in > enter[1] {
                        Face::Inside
                    } else if enter[0] >= enter[1] {
                        if d.x > 0.0 { Face::West } else { Face::East }
                    } else if d.y > 0.0 {
                        Face::South
                    } else {
                        Face::North
                    };
                    return Some(hit(t_in, o.z + t_in * d.z, face));
                }
                if through_top {
                    return Some(hit(t_top, top, Face::Top));
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

    /// All pixels of a picture, row by row from the top.
    pub fn render(&self, basis: &RayBasis, [width, height]: [u32; 2]) -> Vec<Option<Hit>> {
        let mut hits = vec![None; width as usize * height as usize];
        let threads = thread::available_parallelism().map_or(1, |n| n.get());
        let rows = (height as usize).div_ceil(threads).max(1);
        thread::scope(|scope| {
            for (band, hits) in hits.chunks_mut((rows * width as usize).max(1)).enumerate() {
                scope.spawn(move || {
                    for (k, hit) in hits.iter_mut().enumerate() {
                        let [x, y] = [k % width as usize, band * rows + k / width as usize];
                        *hit = self.trace(basis, x as f64, y as f64);
                    }
                });
            }
        });
        hits
    }
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

/// What a rendered distance may be off by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Finest cell, CRS units.
    pub cell_size: f64,
    /// One step of the stored heights, CRS units.
    pub height_step: f64,
}

impl Tolerance {
    /// Distance that the rendering may be off by at `hit`: c/1000 over the ray's horizontal share, plus
    /// a stored height step over its vertical one, plus 2 ulp. A top met by a ray within c/1000 of a
    /// plumb line is owed no horizontal part: there it would excuse everything.
    pub fn at(&self, hit: &Hit, basis: &RayBasis, px: f64, py: f64) -> f64 {
        let (d, length) = (basis.direction(px, py), basis.length(px, py));
        let level = d.x.hypot(d.y) / length;
        let horizontal =
            if hit.face == Face::Top && level < 1e-3 { 0.0 } else { self.cell_size / 1000.0 / level };
        let horizontal = if hit.face == Face::Inside { 0.0 } else { horizontal };
        let vertical = if hit.face == Face::Inside { 0.0 } else { self.height_step / (d.z.abs() / length) };
        let nearest = hit.distance as f32;
        horizontal + vertical + 2.0 * f64::from(nearest.next_up() - nearest)
    }
}

/// How a rendered image differs from the reference.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// Pixels compared.
    pub pixels: usize,
    /// Pixels on which the reference hits.
    pub hits: usize,
    /// Hit in one, miss in the other.
    pub hit_or_miss_differs: usize,
    /// Hit in both, of another class.
    pub class_differs: usize,
    /// Same class, but the distance is beyond the tolerance.
    pub distance_differs: usize,
    /// Same class, where the tolerance is wider than a cell (flat rays): distance hardly checked.
    pub loose: usize,
    /// A few pixels of each kind of difference, the first ones, or for distances the worst.
    pub examples: Vec<Difference>,
}

/// One pixel that differs.
#[derive(Clone, Copy, Debug)]
pub struct Difference {
    /// Column and row.
    pub pixel: [u32; 2],
    /// What it should be.
    pub reference: Option<Hit>,
    /// What was rendered.
    pub distance: f32,
    /// What was rendered.
    pub class: u32,
    /// Distance off, in tolerances; 0 where hit, miss or class differ.
    pub tolerances: f64,
}

/// Compares planes `distance` (+inf on a miss) and `class` ([`MISS_CLASS`] on a miss) of `width` ×
/// `height` pixels with the reference.
///
/// # Panics
/// When the planes' lengths differ.
pub fn compare(
    reference: &[Option<Hit>],
    basis: &RayBasis,
    width: u32,
    distance: &[f32],
    class: &[u32],
    tolerance: Tolerance,
) -> Comparison {
    assert!(reference.len() == distance.len() && reference.len() == class.len(), "images of unequal size");
    const EXAMPLES: usize = 8;
    let mut result = Comparison {
        pixels: reference.len(),
        hits: reference.iter().flatten().count(),
        hit_or_miss_differs: 0,
        class_differs: 0,
        distance_differs: 0,
        loose: 0,
        examples: Vec::new(),
    };
    let mut far: Vec<Difference> = Vec::new();
    for (k, (&want, (&distance, &class))) in reference.iter().zip(distance.iter().zip(class)).enumerate() {
        let pixel = [(k % width as usize) as u32, (k / width as usize) as u32];
        let difference = Difference { pixel, reference: want, distance, class, tolerances: 0.0 };
        let missed = class == MISS_CLASS && distance == f32::INFINITY;
        let hit = class < MISS_CLASS && distance.is_finite();
        match want {
            None if missed => {}
            Some(want) if hit && class == u32::from(want.class) => {
                let [px, py] = pixel.map(f64::from);
                let allowed = tolerance.at(&want, basis, px, py);
                let off = (f64::from(distance) - want.distance).abs();
                result.loose += usize::from(allowed > tolerance.cell_size);
                if off > allowed {
                    result.distance_differs += 1;
                    far.push(Difference { tolerances: off / allowed, ..difference });
                }
            }
            _ => {
                let count = if want.is_some() && hit {
                    &mut result.class_differs
                } else {
                    &mut result.hit_or_miss_differs
                };
                *count += 1;
                if *count <= EXAMPLES {
                    result.examples.push(difference);
                }
            }
        }
    }
    far.sort_by(|a, b| b.tolerances.total_cmp(&a.tolerances));
    result.examples.extend(far.into_iter().take(EXAMPLES));
    result
}

impl Comparison {
    /// Share of the pixels that agree on hit or miss and on class.
    pub fn agreement(&self) -> f64 {
        let differ = self.hit_or_miss_differs + self.class_differs;
        if self.pixels == 0 { 1.0 } else { 1.0 - differ as f64 / self.pixels as f64 }
    }

    /// At least `share` of the pixels agree, and on those every distance lies within the tolerance.
    pub fn agrees(&self, share: f64) -> bool {
        self.agreement() >= share && self.distance_differs == 0
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{} pixels, {} hits: {:.4} % agree; hit or miss differs on {}, class on {}, distance on {}; {} are \
             loosely checked",
            self.pixels,
            self.hits,
            self.agreement() * 100.0,
            self.hit_or_miss_differs,
            self.class_differs,
            self.distance_differs,
            self.loose
        )?;
        for d in &self.examples {
            write!(f, "  pixel {},{}: class {} at {}", d.pixel[0], d.pixel[1], d.class, d.distance)?;
            match d.reference {
                None => write!(f, ", should miss")?,
                Some(h) => write!(
                    f,
                    ", should be class {} at {} ({:?} of cell {},{}, U {})",
                    h.class, h.distance, h.face, h.cell[0], h.cell[1], h.height
                )?,
            }
            if d.tolerances > 0.0 {
                write!(f, ": {:.1} tolerances off", d.tolerances)?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coords::HEIGHT_STEP as STEP;
    use crate::render::camera::{Camera, Projection};
    use glam::DVec3;
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng, rngs::StdRng, seq::SliceRandom};

    const ONE: [u32; 2] = [1, 1];

    fn point(e: f64, n: f64, u: f64, class: u8) -> Point {
        Point { e, n, u, class, intensity: 0, rgb: [0; 3], returns: 0x11, flags: 0 }
    }

    fn map(points: &[Point]) -> ColumnMap {
        ColumnMap::build(points.iter().copied(), [1.0, STEP], &ClassMask::default(), false)
    }

    /// The one ray from `eye` to `target`.
    fn ray(eye: [f64; 3], target: [f64; 3]) -> RayBasis {
        let (eye, target) = (DVec3::from(eye), DVec3::from(target));
        Camera::look_at(eye, target, Projection::default()).unwrap().basis(ONE).unwrap()
    }

    /// The middle ray hits `face` of `cell` after `distance`.
    fn expect(map: &ColumnMap, ray: RayBasis, face: Face, cell: [i64; 2], distance: f64) {
        let hit = map.trace(&ray, 0.0, 0.0).expect("a hit");
        assert_eq!((hit.face, hit.cell), (face, cell));
        assert!((hit.distance - distance).abs() < 1e-9, "{} for {distance}", hit.distance);
    }

    #[test]
    fn single_column_from_all_sides() {
        let map = map(&[point(10.5, 20.5, 3.0, 6)]);
        let cell = [10, 20];
        expect(&map, ray([10.5, 20.5, 13.0], [10.5, 20.5, 0.0]), Face::Top, cell, 10.0);
        expect(&map, ray([0.0, 20.5, 1.0], [10.5, 20.5, 1.0]), Face::West, cell, 10.0);
        expect(&map, ray([21.0, 20.5, 1.0], [10.5, 20.5, 1.0]), Face::East, cell, 10.0);
        expect(&map, ray([10.5, 10.0, -50.0], [10.5, 20.5, -50.0]), Face::South, cell, 10.0);
        expect(&map, ray([10.5, 31.0, 3.0], [10.5, 20.5, 3.0]), Face::North, cell, 10.0);
        expect(&map, ray([10.5, 20.5, 1.0], [10.5, 20.5, 9.0]), Face::Inside, cell, 0.0);
        // Down a slope of 1 in 1, onto the top and onto the side.
        expect(&map, ray([7.25, 20.5, 6.0], [10.25, 20.5, 3.0]), Face::Top, cell, 18f64.sqrt());
        expect(&map, ray([7.0, 20.5, 5.0], [10.0, 20.5, 2.0]), Face::West, cell, 18f64.sqrt());
        // From below, up through the open air beside it, and above it.
        expect(&map, ray([7.0, 20.5, -1.0], [10.0, 20.5, 2.0]), Face::West, cell, 18f64.sqrt());
        for (eye, target) in [
            ([10.5, 20.5, 3.5], [10.5, 20.5, 9.0]),
            ([7.0, 20.5, 1.0], [10.0, 20.5, 4.0]),
            ([0.0, 20.5, 3.001], [10.0, 20.5, 3.001]),
            ([9.5, 20.5, 9.0], [9.5, 20.5, 0.0]),
            ([20.0, 20.5, 1.0], [30.0, 20.5, 1.0]),
        ] {
            assert_eq!(map.trace(&ray(eye, target), 0.0, 0.0), None, "{eye:?} to {target:?}");
        }
    }

    #[test]
    fn cells_are_half_open() {
        let map = map(&[point(0.0, 0.0, 5.0, 2)]);
        let down = |e, n| map.trace(&ray([e, n, 9.0], [e, n, 0.0]), 0.0, 0.0).is_some();
        assert!(down(0.0, 0.0) && down(0.999, 0.999));
        assert!(!down(1.0, 0.5) && !down(0.5, 1.0) && !down(-1e-5, 0.5));
        let north = |e| map.trace(&ray([e, -4.0, 1.0], [e, 4.0, 1.0]), 0.0, 0.0).is_some();
        assert!(north(0.0) && !north(1.0), "along a border");
        let across = |from: [f64; 2], to: [f64; 2]| {
            map.trace(&ray([from[0], from[1], 1.0], [to[0], to[1], 1.0]), 0.0, 0.0).map(|hit| hit.distance)
        };
        // Diagonals that touch one corner point each: only the south-west one belongs to the cell.
        assert!((across([-2.0, 2.0], [2.0, -2.0]).unwrap() - 8f64.sqrt()).abs() < 1e-12);
        assert!((across([2.0, -2.0], [-2.0, 2.0]).unwrap() - 8f64.sqrt()).abs() < 1e-12);
        assert_eq!(across([-1.0, 3.0], [3.0, -1.0]), None);
        assert_eq!(across([3.0, -1.0], [-1.0, 3.0]), None);
        assert_eq!(across([-2.0, -1.0], [2.0, 3.0]), None);
        assert_eq!(across([2.0, 3.0], [-2.0, -1.0]), None);
        // Through two opposite corners.
        assert!((across([-2.0, -2.0], [2.0, 2.0]).unwrap() - 8f64.sqrt()).abs() < 1e-12);
        assert!((across([2.0, 2.0], [-2.0, -2.0]).unwrap() - 2f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn exaggerated_view_measures_what_is_seen() {
        let map = map(&[point(0.5, 10.5, 3.0, 6)]);
        let shown = ray([0.5, 10.5, 26.0], [0.5, 10.5, 0.0]).exaggerated(2.0, 1.0).unwrap();
        let hit = map.trace(&shown.advance(7.0), 0.0, 0.0).unwrap();
        // U 3 is shown at 1 + 2 · 2 = 5.
        assert_eq!((hit.distance, hit.height, hit.face), (21.0, 3.0, Face::Top));
    }

    #[test]
    fn fifty_kilometres_and_a_far_northing_change_nothing() {
        let near = map(&[point(3.5, 7.5, 12.0, 6), point(4.5, 7.5, 9.0, 2)]);
        let (e, n) = (500_000.0, 6_000_000.0);
        let far = map(&[point(e + 3.5, n + 7.5, 12.0, 6), point(e + 4.5, n + 7.5, 9.0, 2)]);
        let (a, b) = (
            near.trace(&ray([3.5, -50_000.0, 10_000.0], [3.5, 7.25, 12.0]), 0.0, 0.0).unwrap(),
            far.trace(&ray([e + 3.5, n - 50_000.0, 10_000.0], [e + 3.5, n + 7.25, 12.0]), 0.0, 0.0).unwrap(),
        );
        assert_eq!((a.face, a.height), (Face::Top, 12.0));
        assert!((a.distance - b.distance).abs() < 1e-6 && a.face == b.face);
        assert_eq!([a.cell[0] + 500_000, a.cell[1] + 6_000_000], b.cell);
    }

    #[test]
    fn winner_is_the_same_in_any_order() {
        let mut rng = StdRng::seed_from_u64(7);
        let mut points: Vec<Point> = (0..20_000)
            .map(|_| Point {
                e: rng.random_range(0.0..8.0),
                n: rng.random_range(0.0..8.0),
                u: f64::from(rng.random_range(0..3)),
                class: rng.random_range(0..4),
                intensity: rng.random_range(0..3),
                rgb: [rng.random_range(0..3), rng.random_range(0..3), 0],
                returns: rng.random_range(0..2),
                flags: rng.random_range(0..8),
            })
            .collect();
        let winners = |points: &[Point]| {
            let map = map(points);
            (0..8)
                .flat_map(|j| (0..8).map(move |i| [i, j]))
                .map(|c| map.column(c).copied())
                .collect::<Vec<_>>()
        };
        let before = winners(&points);
        points.shuffle(&mut rng);
        assert_eq!(before, winners(&points));
        assert!(
            before
                .iter()
                .flatten()
                .all(|c| c.height_steps == 2048 && c.class == 3 && c.flags & WITHHELD == 0)
        );
    }

    #[test]
    fn mask_and_rounding_decide_the_top() {
        let all = [point(0.5, 0.5, 1.0, 2), point(0.5, 0.5, 4.0001, 5), point(0.5, 0.5, 90.0, 7)];
        let top = |mask: &ClassMask| {
            ColumnMap::build(all, [1.0, STEP], mask, false).column([0, 0]).map(|c| (c.height_steps, c.class))
        };
        assert_eq!(top(&ClassMask::default()), Some((4097, 5)));
        assert_eq!(top(&ClassMask::default().without(&[5])), Some((1024, 2)));
        assert_eq!(top(&ClassMask::all()), Some((90 * 1024, 7)));
        assert_eq!(top(&ClassMask::only(&[6])), None);
        let mut withheld = point(0.5, 0.5, 50.0, 2);
        withheld.flags = WITHHELD;
        let seen = |show| ColumnMap::build([withheld], [1.0, STEP], &ClassMask::default(), show).len();
        assert_eq!((seen(false), seen(true)), (0, 1));
        let odd =
            [point(f64::NAN, 0.0, 0.0, 2), point(0.0, 0.0, f64::INFINITY, 2), point(1e300, 0.0, 0.0, 2)];
        assert!(map(&odd).is_empty());
        assert_eq!(map(&odd).trace(&ray([0.0; 3], [1.0; 3]), 0.0, 0.0), None);
    }

    /// A small town of columns around (e, n), some cells empty.
    fn town(seed: u64, cell: f64, e: f64, n: f64) -> Vec<Point> {
        let mut rng = StdRng::seed_from_u64(seed);
        let mut points = Vec::new();
        for j in 0..24 {
            for i in 0..24 {
                if rng.random_bool(0.8) {
                    let u = if rng.random_bool(0.15) {
                        rng.random_range(2.0..9.0)
                    } else {
                        rng.random_range(0.0..1.0)
                    };
                    let at = |k: i32| (f64::from(k) + rng.random_range(0.2..0.8)) * cell;
                    let [x, y] = [i, j].map(at);
                    points.push(point(e + x, n + y, u * cell, rng.random_range(0..7)));
                }
            }
        }
        points
    }

    /// The picture by looking at points along the ray, a thousandth of a cell apart. Nothing
    /// solid may lie before the hit, and something solid must lie at it.
    fn check_against_samples(
        map: &ColumnMap,
        basis: &RayBasis,
        px: f64,
        py: f64,
    ) -> Result<(), TestCaseError> {
        let c = map.cell_size;
        let hit = map.trace(basis, px, py);
        let (o, d) = (basis.origin(px, py), basis.direction(px, py));
        let solid = |t: f64| {
            let p = o + d * t;
            map.column([(p.x / c).floor() as i64, (p.y / c).floor() as i64])
                .is_some_and(|column| p.z <= map.top(column))
        };
        let (unit, step) = (basis.length(px, py), c / 1000.0);
        // Off the eye, coordinates at a far northing are good to 1e-9.
        let blur = 1e-8 * c.max(1.0) / unit;
        let end = hit.map_or(70.0 * c, |h| h.distance) / unit;
        let mut t = 0.0;
        while t < end - blur {
            // A sample that grazes a border within the blur says nothing.
            prop_assert!(
                !(solid(t) && solid(t - blur) && solid(t + blur)) || t < blur,
                "solid at {t}, before {hit:?}"
            );
            t += step / unit;
        }
        if let Some(hit) = hit {
            // Around and not only behind: a ray may touch no more than the corner of a cell.
            let p = o + d * (hit.distance / unit);
            let near = [-1.0, 0.0, 1.0].map(|k| k * blur * unit);
            let around = near.iter().any(|x| {
                near.iter().any(|y| {
                    let cell = [((p.x + x) / c).floor() as i64, ((p.y + y) / c).floor() as i64];
                    cell == hit.cell
                        && map.column(cell).is_some_and(|column| p.z + near[0] <= map.top(column))
                })
            });
            prop_assert!(around, "nothing at {hit:?}");
        }
        Ok(())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]
        #[test]
        fn walk_agrees_with_sampling(
            seed in 0u64..6, cell in prop_oneof![Just(1.0), Just(0.3), Just(2.5)], far: bool,
            eye in [-10.0f64..34.0, -10.0f64..34.0, -3.0f64..20.0], target in [0.0f64..24.0, 0.0f64..24.0, -1.0f64..6.0],
            round: bool,
        ) {
            // Half of the rays start and aim at cell corners.
            let place = |v: [f64; 3]| {
                let v = if round { v.map(f64::round) } else { v };
                let (e, n) = if far { (500_000.0, 6_000_000.0) } else { (0.0, 0.0) };
                [e + v[0] * cell, n + v[1] * cell, v[2] * cell]
            };
            let (eye, target, origin) = (place(eye), place(target), place([0.0; 3]));
            prop_assume!(eye != target);
            let points = town(seed, cell, origin[0], origin[1]);
            let map = ColumnMap::build(points, [cell, STEP], &ClassMask::all(), true);
            check_against_samples(&map, &ray(eye, target), 0.0, 0.0)?;
        }
    }

    #[test]
    fn flat_array_and_hash_map_agree() {
        let mut points = town(3, 1.0, 0.0, 0.0);
        let dense = map(&points);
        points.push(point(185_000.0, 90_000.0, 0.0, 2));
        let sparse = map(&points);
        assert!(matches!(dense.index, Index::Dense(_)) && matches!(sparse.index, Index::Sparse(_)));
        let eye = DVec3::new(12.0, -20.0, 25.0);
        let camera = Camera::look_at(eye, DVec3::new(12.0, 12.0, 0.0), Projection::default()).unwrap();
        let basis = camera.basis([32, 24]).unwrap();
        let (a, b) = (dense.render(&basis, [32, 24]), sparse.render(&basis, [32, 24]));
        assert_eq!(a, b);
        assert!(a.iter().flatten().count() > 200 && a.contains(&None));
        assert_eq!(a[5 * 32 + 9], dense.trace(&basis, 9.0, 5.0));
    }

    /// Planes as a perfect renderer writes them.
    fn planes(hits: &[Option<Hit>]) -> (Vec<f32>, Vec<u32>) {
        let distance = |h: &Option<Hit>| h.map_or(f32::INFINITY, |h| h.distance as f32);
        let class = |h: &Option<Hit>| h.map_or(MISS_CLASS, |h| h.class.into());
        (hits.iter().map(distance).collect(), hits.iter().map(class).collect())
    }

    #[test]
    fn comparison_finds_what_differs_and_nothing_else() {
        let map = map(&town(1, 1.0, 0.0, 0.0));
        let size = [40, 30];
        let camera =
            Camera::look_at(DVec3::new(12.0, -6.0, 30.0), DVec3::new(12.0, 12.0, 0.0), Projection::default());
        let basis = camera.unwrap().basis(size).unwrap();
        let hits = map.render(&basis, size);
        let tolerance = Tolerance { cell_size: 1.0, height_step: STEP };
        let run = |(distance, class): (Vec<f32>, Vec<u32>)| {
            compare(&hits, &basis, size[0], &distance, &class, tolerance)
        };
        let perfect = run(planes(&hits));
        assert!(perfect.agrees(1.0) && perfect.loose == 0 && perfect.hits > 300, "{perfect}");

        let hit = hits.iter().position(Option::is_some).unwrap();
        let miss = hits.iter().position(Option::is_none).unwrap();
        let mut wrong = planes(&hits);
        wrong.0[hit] += 0.1;
        let result = run(wrong.clone());
        assert!(!result.agrees(0.9) && result.distance_differs == 1 && result.agreement() == 1.0);
        assert!(result.to_string().contains("tolerances off"), "{result}");
        wrong.1[hit] = 99;
        wrong.0[miss] = 4.0;
        let result = run(wrong);
        assert_eq!((result.class_differs, result.hit_or_miss_differs, result.distance_differs), (1, 1, 0));
        assert!(result.to_string().contains("should miss") && result.agrees(0.99) && !result.agrees(0.9999));

        // Stored heights one step up are within the tolerance, eight are not.
        let raised = |steps: i64| {
            let cells = (0..24).flat_map(|j| (0..24).map(move |i| [i, j])).filter_map(|cell| {
                let column = *map.column(cell)?;
                Some((cell, Column { height_steps: column.height_steps + steps, ..column }))
            });
            run(planes(&ColumnMap::from_cells(cells, [1.0, STEP]).render(&basis, size)))
        };
        assert!(raised(1).agreement() > 0.99 && raised(1).distance_differs == 0, "{}", raised(1));
        assert!(raised(8).distance_differs > 100, "{}", raised(8));
    }

    #[test]
    fn plumb_rays_are_checked_tightly() {
        let map = map(&[point(0.5, 0.5, 3.0, 6)]);
        let down = ray([0.5, 0.5, 13.0], [0.5, 0.5, 0.0]);
        let hit = map.trace(&down, 0.0, 0.0).unwrap();
        let tolerance = Tolerance { cell_size: 1.0, height_step: STEP };
        assert!(tolerance.at(&hit, &down, 0.0, 0.0) < 1.1 / 1024.0);
        // A level ray onto a side says little about heights: allowed, and counted.
        let level = ray([-9.0, 0.5, 1.0], [0.0, 0.5, 1.0]);
        let hits = map.render(&level, ONE);
        let (distance, class) = planes(&hits);
        assert_eq!(compare(&hits, &level, 1, &distance, &class, tolerance).loose, 1);
    }
}
