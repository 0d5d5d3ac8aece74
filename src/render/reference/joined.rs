//! What floats over a smooth surface: thin and round where it is thin, and joined with what is beside it.
//!
//! Spans of a class that touch in a column are one. One that is no higher than a gap is a tube: from the middle of its column,
//! halfway up, to the border of each of the eight columns around in which the thin or thick thing of its class that is nearest
//! in height is no farther than a jump, at the mean of both heights; to a corner only where no column beside leads there, or where all
//! four that meet at it are joined: then there, and not to the borders beside. With
//! two ends that are not side by side it goes from one to the other; without any it is a ball, and where all that it leads to is such a
//! corner, one about that. Its radius is half a pixel, but
//! within [`RADIUS`] of a cell. Where five or more of those around go on it is a slab, and so are all decks of bridges, and what is
//! thicker where four or more around are as high: its top and its bottom lie between corners that it shares with those of its
//! class around, as what is solid, on decks of bridges those less than half a jump apart. Else what is thicker stands upright, a capsule as wide as its column. Wires and towers are
//! never slabs.
//!
//! Heights of ends are rounded down to whole steps of 2⁻⁷ of a gap, those of corners to 2⁻⁶, at least to lattice steps.

use super::columns::Column;
use super::corners::{Corners, mean_corner, normal_of};
use super::stacks::Stack;
use super::trace::{Contact, Face, Hit, Stay};
use glam::DVec3;

/// Least and greatest radius of a tube, cells.
const RADIUS: [f64; 2] = [0.2, 0.5];
/// Spans of a column that are joined with others, from the highest down.
const MOST_JOINED: usize = 24;
/// So many of those around make a slab of what is thin, and of what is thick.
const LEAST_SHEET: usize = 5;
const LEAST_CROWN: usize = 4;
/// What is round is met on a side where it faces up or down by less.
const LEAST_UP: f64 = 0.5;
const BRIDGE_DECK: u8 = 17;

/// What is of one class in a column and hangs together; lattice steps.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Whole {
    highest: Column,
    bottom: i64,
}

/// Where a tube leads.
struct End {
    way: [i64; 2],
    height: i64,
    /// To a corner at which all four are joined.
    meets_four: bool,
}

/// The lattice, and what joins.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lattice {
    pub cell_size: f64,
    pub height_step: f64,
    /// Most steps from a column to the next.
    pub jump: i64,
    /// Most steps between points of a span.
    pub gap: i64,
}

/// A span as it is seen. CRS units.
#[derive(Clone, Debug)]
pub(super) enum Shape {
    /// Pieces of a tube.
    Tube(Vec<[DVec3; 2]>),
    /// What stands upright: its axis.
    Upright([DVec3; 2]),
    /// Corners of the top and of the bottom: south-west, south-east, north-west, north-east.
    Slab([Corners; 2]),
}

impl Whole {
    fn top(&self) -> i64 {
        self.highest.height_steps
    }

    fn middle(&self) -> i64 {
        self.bottom + (self.top() - self.bottom).div_euclid(2)
    }

    fn is_thin(&self, gap: i64) -> bool {
        self.top() - self.bottom <= gap
    }

    fn is_wire(&self) -> bool {
        (13..=16).contains(&self.highest.class)
    }

    /// Where a tube of the height `middle` meets it.
    fn meets(&self, middle: i64, gap: i64) -> i64 {
        if self.is_thin(gap) { self.middle() } else { middle.clamp(self.bottom, self.top()) }
    }
}

fn wholes(stack: &Stack) -> Vec<Whole> {
    let mut wholes: Vec<Whole> = Vec::new();
    for span in &stack.floating {
        let of_class = wholes.iter_mut().rev().find(|whole| whole.highest.class == span.top.class);
        match of_class {
            Some(whole) if span.top.height_steps >= whole.bottom => {
                whole.bottom = whole.bottom.min(span.bottom_steps);
            }
            _ => wholes.push(Whole { highest: span.top, bottom: span.bottom_steps }),
        }
    }
    wholes
}

const AROUND: [[i64; 2]; 8] = [[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1]];

/// A column and those around, row by row from the south-west.
struct Patch {
    columns: [Vec<Whole>; 9],
    lattice: Lattice,
}

impl Patch {
    fn of_class(&self, [east, north]: [i64; 2], class: u8) -> impl Iterator<Item = &Whole> {
        self.columns[(4 + east + 3 * north) as usize].iter().filter(move |w| w.highest.class == class)
    }

    /// The nearest to a tube of a class in the column that lies `way`, and where they meet.
    fn nearest(&self, way: [i64; 2], class: u8, middle: i64, thin: bool) -> Option<(&Whole, i64)> {
        let Lattice { gap, jump, .. } = self.lattice;
        self.of_class(way, class)
            .filter(|whole| !thin || whole.is_thin(gap))
            .map(|whole| (whole, whole.meets(middle, gap)))
            .filter(|(_, height)| (height - middle).abs() <= jump)
            .min_by_key(|(_, height)| (height - middle).abs())
    }

    /// Heights of a tube's ends, by where they lead; `None`: it is one of many.
    fn ends(&self, whole: &Whole) -> Option<Vec<End>> {
        let Lattice { gap, jump, .. } = self.lattice;
        let class = whole.highest.class;
        let met = AROUND.map(|way| {
            let (other, height) = self.nearest(way, class, whole.middle(), false)?;
            let is_mutual = !other.is_thin(gap)
                || self.nearest([0, 0], class, height, true).is_some_and(|(back, _)| back == whole);
            is_mutual.then_some(height)
        });
        if !whole.is_wire() && met.iter().flatten().count() >= LEAST_SHEET {
            return None;
        }
        let is_joined = |k: usize| met[k % 8].is_some();
        let is_full = |corner: usize| [7, 0, 1].iter().all(|turn| is_joined(corner + turn));
        let step = (gap >> 7).max(1);
        let ends = (0..8).filter_map(|k| {
            let height = met[k]?;
            let beside = [(k + 7) % 8, (k + 1) % 8].map(|side| met[side]);
            let leads_there =
                |beside: &Option<i64>| beside.is_some_and(|beside| (beside - height).abs() <= jump);
            let (is_end, sum, n) = match (k % 2 == 1, is_full(k)) {
                (true, true) => (true, beside.iter().flatten().sum::<i64>() + height + whole.middle(), 4),
                (true, false) => (!beside.iter().any(leads_there), height + whole.middle(), 2),
                (false, _) => (!is_full(k + 7) && !is_full(k + 1), height + whole.middle(), 2),
            };
            let height = sum.div_euclid(n).div_euclid(step) * step;
            is_end.then_some(End { way: AROUND[k], height, meets_four: n == 4 })
        });
        Some(ends.take(7).collect())
    }

    fn nearest_top(&self, way: [i64; 2], whole: &Whole) -> Option<&Whole> {
        self.of_class(way, whole.highest.class).min_by_key(|other| (other.top() - whole.top()).abs())
    }

    /// Whether what is thick is as high as most around.
    fn is_crown(&self, whole: &Whole) -> bool {
        let Lattice { gap, jump, .. } = self.lattice;
        let is_as_high = |other: &&Whole| !other.is_thin(gap) && (other.top() - whole.top()).abs() <= jump;
        AROUND.iter().filter_map(|way| self.nearest_top(*way, whole)).filter(is_as_high).count()
            >= LEAST_CROWN
    }

    /// Steps of a corner of a slab, and of the bottom's.
    fn corner(&self, whole: &Whole, is_alone: bool, [east, north]: [i64; 2]) -> [i64; 2] {
        let ways = [[0, 0], [east, 0], [east, north], [0, north]];
        let those = ways.map(|way| {
            if way == [0, 0] {
                return Some(*whole);
            }
            self.nearest_top(way, whole).copied().filter(|_| !is_alone)
        });
        let step = (self.lattice.gap >> 6).max(1);
        let is_deck = whole.highest.class == BRIDGE_DECK;
        let jump = if is_deck { self.lattice.jump / 2 } else { self.lattice.jump };
        let mean =
            |heights: [Option<i64>; 4]| mean_corner(heights, jump).expect("its own").div_euclid(step) * step;
        let top = mean(those.map(|whole| Some(whole?.top())));
        let bottom = mean(those.map(|whole| Some(whole?.bottom)));
        [top, bottom.min(top - step)]
    }

    fn shape(&self, cell: [i64; 2], whole: &Whole, is_alone: bool) -> Shape {
        let Lattice { cell_size, height_step, gap, .. } = self.lattice;
        let units = |steps: i64| steps as f64 * height_step;
        let place = |[east, north]: [f64; 2], height: f64| {
            let [e, n] = [cell[0] as f64 + 0.5 + east, cell[1] as f64 + 0.5 + north];
            DVec3::new(e * cell_size, n * cell_size, height)
        };
        let (is_deck, is_thin) = (whole.highest.class == BRIDGE_DECK, whole.is_thin(gap));
        let ends = match is_thin && !is_deck {
            true if is_alone => Some(Vec::new()),
            true => self.ends(whole),
            false => None,
        };
        let Some(ends) = ends else {
            if !is_thin && !is_deck && (is_alone || whole.is_wire() || !self.is_crown(whole)) {
                let (middle, reach) = (units(whole.middle()), units(whole.top() - whole.bottom) / 2.0);
                let up = (reach - RADIUS[1] * cell_size).max(0.0);
                return Shape::Upright([-up, up].map(|up| place([0.0; 2], middle + up)));
            }
            let corners =
                [[-1, -1], [1, -1], [-1, 1], [1, 1]].map(|way| self.corner(whole, is_alone, way).map(units));
            return Shape::Slab([0, 1].map(|end| corners.map(|corner| corner[end])));
        };
        let middle = place([0.0; 2], units(whole.middle()));
        let at = |end: &End| place(end.way.map(|side| 0.5 * side as f64), units(end.height));
        let pieces = match &ends[..] {
            [] => vec![[middle; 2]],
            [only] if only.meets_four => vec![[at(only); 2]],
            [a, b] if a.way[0] * b.way[0] + a.way[1] * b.way[1] <= 0 => vec![[at(a), at(b)]],
            ends => ends.iter().map(|end| [middle, at(end)]).collect(),
        };
        Shape::Tube(pieces)
    }
}

/// What floats in a column, of nine row by row from the south-west: the highest record of each, and its shape.
pub(super) fn shapes(cell: [i64; 2], stacks: [Option<&Stack>; 9], lattice: Lattice) -> Vec<(Column, Shape)> {
    let patch = Patch { columns: stacks.map(|stack| stack.map_or_else(Vec::new, wholes)), lattice };
    let shape = |(k, whole): (usize, &Whole)| (whole.highest, patch.shape(cell, whole, k >= MOST_JOINED));
    patch.columns[4].iter().enumerate().map(shape).collect()
}

impl Shape {
    /// The first contact of a ray in its column. `pixel`: CRS units from ray to ray where it comes in.
    pub fn contact(&self, stay: &Stay, cell_size: f64, pixel: f64) -> Option<Contact> {
        match self {
            Shape::Tube(pieces) => {
                let radius = (0.5 * pixel).clamp(RADIUS[0] * cell_size, RADIUS[1] * cell_size);
                pieces
                    .iter()
                    .filter_map(|piece| stay.tube_contact(*piece, radius))
                    .min_by(|a, b| a.t.total_cmp(&b.t))
            }
            Shape::Upright(axis) => stay.tube_contact(*axis, RADIUS[1] * cell_size),
            Shape::Slab([tops, bottoms]) => stay.slab_contact(cell_size, *tops, *bottoms),
        }
    }

    /// Which way it faces where it was hit; `None`: on a side.
    pub fn normal(&self, hit: &Hit, place: DVec3, cell_size: f64) -> Option<DVec3> {
        match self {
            Shape::Tube(pieces) => {
                let offs = pieces.iter().map(|piece| off(*piece, place));
                offs.min_by(|a, b| a.length().total_cmp(&b.length()))?.try_normalize()
            }
            Shape::Upright(axis) => off(*axis, place).try_normalize(),
            Shape::Slab(_) if !matches!(hit.face, Face::Top | Face::Bottom) => None,
            Shape::Slab(corners) => {
                let corners = corners[usize::from(hit.face == Face::Bottom)];
                Some(normal_of(corners, hit.cell, place, cell_size))
            }
        }
    }
}

/// Way from the nearest place of a piece.
fn off([a, b]: [DVec3; 2], place: DVec3) -> DVec3 {
    let along = (place - a).dot(b - a) / (b - a).length_squared();
    // Of a ball: not a number.
    let nearest = if along > 0.0 { a.lerp(b, along.min(1.0)) } else { a };
    place - nearest
}

impl Stay {
    /// How far a ray is from a piece has one minimum: that is narrowed down, and then where it comes near enough before.
    fn tube_contact(&self, piece: [DVec3; 2], radius: f64) -> Option<Contact> {
        let at = |t: f64| self.origin + self.direction * t;
        let distance = |t: f64| off(piece, at(t)).length();
        let contact = |t: f64, face: Face| Contact { t, height: at(t).z, face };
        if distance(self.t_in) <= radius {
            return Some(contact(self.t_in, self.side));
        }
        // No part of it is farther from its middle.
        let middle = piece[0].midpoint(piece[1]);
        let reach = radius + piece[0].distance(middle);
        let (nearest, half) = {
            let speed = self.direction.length();
            ((middle - self.origin).dot(self.direction) / (speed * speed), reach / speed)
        };
        let [mut low, mut high] = [(nearest - half).max(self.t_in), (nearest + half).min(self.t_out)];
        if low >= high || at(nearest).distance(middle) > reach {
            return None;
        }
        let first = low;
        for _ in 0..100 {
            let [a, b] = [low + (high - low) / 3.0, high - (high - low) / 3.0];
            if distance(a) < distance(b) { high = b } else { low = a }
        }
        let (mut outside, mut inside) = (first, 0.5 * (low + high));
        if distance(inside) > radius {
            return None;
        }
        for _ in 0..100 {
            let middle = 0.5 * (outside + inside);
            if distance(middle) > radius { outside = middle } else { inside = middle }
        }
        let normal = off(piece, at(inside)).normalize();
        let face = if normal.z.abs() >= LEAST_UP {
            if normal.z > 0.0 { Face::Top } else { Face::Bottom }
        } else if normal.x.abs() > normal.y.abs() {
            if normal.x < 0.0 { Face::West } else { Face::East }
        } else if normal.y < 0.0 {
            Face::South
        } else {
            Face::North
        };
        Some(contact(inside, face))
    }

    fn slab_contact(&self, size: f64, tops: Corners, bottoms: Corners) -> Option<Contact> {
        let from_above = self.surface_contact(size, tops);
        // The top is met before it is below that, or the ray was below it from the first.
        let is_above = from_above.is_none_or(|contact| contact.face == Face::Top);
        if is_above {
            return from_above;
        }
        let flip = |v: DVec3| DVec3 { z: -v.z, ..v };
        let flipped = Stay { origin: flip(self.origin), direction: flip(self.direction), ..*self };
        let from_below = flipped.surface_contact(size, bottoms.map(|height| -height))?;
        let face = if from_below.face == Face::Top { Face::Bottom } else { from_below.face };
        Some(Contact { height: -from_below.height, face, ..from_below })
    }
}
