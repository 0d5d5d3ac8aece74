//! Points to stacks: what is solid and what floats in each finest cell under one mask, from the points themselves; and the
//! rays among them.
//!
//! A column is solid from its highest solid span down without end. Above that, spans float: points of one class and flags
//! that lie close enough one below the other, from the highest of them down to one thickness below the lowest. Spans are closed in
//! height; a ray hits what it first is within, of several the one with the larger record.

use super::columns::{Column, ColumnMap, Point};
use super::trace::{Contact, Hit, Stay, each_pixel};
use crate::attribute::ClassMask;
use crate::coords::SECTION_SIDE;
use crate::render::camera::RayBasis;
use std::cmp::Reverse;
use std::collections::{BTreeMap, HashMap};

/// Class flags that, with the class, tell which points may be of one span: synthetic, key-point, withheld, overlap.
const KEY_FLAGS: u8 = 15;
/// What spans go by, steps of the heights' lattice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spacing {
    /// So far down reaches every point of a span that floats.
    pub thickness: i64,
    /// Points of a span are at most so far apart.
    pub gap: i64,
    /// Columns each way, all around, that tell whether an unclassified span floats: more of them than this must hold a point that is
    /// lower by more than a gap. 2 on the finest level, 1 on the next, 0 above.
    pub around: i64,
}

/// A span that floats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Floating {
    /// Its highest point.
    pub top: Column,
    /// Where it ends below, lattice steps.
    pub bottom_steps: i64,
}

/// A column.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Stack {
    /// The highest point of what is solid from there down.
    pub solid: Option<Column>,
    /// What floats above that, the larger record first.
    pub floating: Vec<Floating>,
}

/// All stacks at the finest level under one mask.
#[derive(Debug)]
pub struct StackMap {
    /// The highest point of every stack.
    tops: ColumnMap,
    /// In the order of those.
    stacks: Vec<Stack>,
}

/// Points of one class and flags, close enough to one another.
#[derive(Clone, Copy)]
struct Span {
    top: Column,
    lowest: i64,
}

/// A column on its own.
struct Spans {
    spans: Vec<Span>,
    /// Height of the lowest of its points.
    lowest: Option<i64>,
}

/// What a class says of standing on something.
#[derive(PartialEq)]
enum Standing {
    Solid,
    Floats,
    Unclear,
}

fn standing(class: u8) -> Standing {
    match class {
        // Ground, building, water, rail, road, the surface of water.
        2 | 6 | 9 | 10 | 11 | 41 => Standing::Solid,
        // Vegetation, wires and what holds them, bridges, what stands over; noise.
        3..=5 | 7 | 13..=19 => Standing::Floats,
        _ => Standing::Unclear,
    }
}

impl Spans {
    /// Of the visible points of a column.
    fn of(points: Vec<Column>, gap: i64) -> Spans {
        let mut keys: BTreeMap<(u8, u8), Vec<Column>> = BTreeMap::new();
        for point in points {
            keys.entry((point.class, point.flags & KEY_FLAGS)).or_default().push(point);
        }
        let (mut spans, mut lowest) = (Vec::new(), None::<i64>);
        for ((class, _), mut points) in keys {
            points.sort_by_key(|&point| Reverse(point));
            if standing(class) == Standing::Solid {
                // What is below the highest is within what is solid, and counts nowhere.
                points.truncate(1);
            }
            let last = points[points.len() - 1].height_steps;
            lowest = Some(lowest.map_or(last, |lowest| lowest.min(last)));
            let pieces = points.chunk_by(|upper, lower| upper.height_steps - lower.height_steps <= gap);
            spans.extend(
                pieces.map(|piece| Span { top: piece[0], lowest: piece[piece.len() - 1].height_steps }),
            );
        }
        Spans { spans, lowest }
    }
}

/// Whether columns around that are of its section hold points below an unclassified span of `cell`, and below a gap.
fn is_over_lower(
    columns: &HashMap<[i64; 2], Spans>,
    cell: [i64; 2],
    span: &Span,
    Spacing { gap, around: reach, .. }: Spacing,
) -> bool {
    let section = |cell: [i64; 2]| cell.map(|index| index.div_euclid(SECTION_SIDE.into()));
    let around = (-reach..=reach).flat_map(|j| (-reach..=reach).map(move |i| [cell[0] + i, cell[1] + j]));
    let lower = around.filter(|&near| section(near) == section(cell)).filter(|near| {
        let lowest = columns.get(near).and_then(|column| column.lowest);
        lowest.is_some_and(|height| height < span.lowest - gap)
    });
    lower.count() as i64 > reach
}

impl StackMap {
    /// Takes the points that `mask` shows, as [`ColumnMap::build`] does.
    pub fn build(
        points: impl IntoIterator<Item = Point>,
        lattice: [f64; 2],
        spacing: Spacing,
        mask: &ClassMask,
        hidden_flags: u8,
    ) -> StackMap {
        let mut cells: HashMap<[i64; 2], Vec<Column>> = HashMap::new();
        for (cell, point) in points.into_iter().filter_map(|p| p.binned(lattice, mask, hidden_flags)) {
            cells.entry(cell).or_default().push(point);
        }
        let columns: HashMap<[i64; 2], Spans> =
            cells.into_iter().map(|(cell, points)| (cell, Spans::of(points, spacing.gap))).collect();
        let stack = |(&cell, column): (&[i64; 2], &Spans)| {
            let floats = |span: &Span| match standing(span.top.class) {
                Standing::Solid => false,
                Standing::Floats => true,
                Standing::Unclear => is_over_lower(&columns, cell, span, spacing),
            };
            let (floating, solid): (Vec<Span>, Vec<Span>) =
                column.spans.iter().partition(|&span| floats(span));
            let solid = solid.into_iter().map(|span| span.top).max();
            let is_above = |span: &Span| solid.is_none_or(|solid| span.top > solid);
            let mut floating: Vec<Floating> = floating
                .into_iter()
                .filter(is_above)
                .map(|Span { top, lowest }| Floating { top, bottom_steps: lowest - spacing.thickness })
                .collect();
            floating.sort_by_key(|span| Reverse(span.top));
            (cell, Stack { solid, floating })
        };
        StackMap::from_cells(columns.iter().map(stack), lattice)
    }

    /// Takes stacks that are binned already, each of which holds a point.
    ///
    /// # Panics
    /// Where one holds none.
    pub fn from_cells(cells: impl IntoIterator<Item = ([i64; 2], Stack)>, lattice: [f64; 2]) -> StackMap {
        let (cells, stacks): (Vec<[i64; 2]>, Vec<Stack>) = cells.into_iter().unzip();
        let tops: Vec<Column> = stacks.iter().map(|stack| stack.top().expect("a point is in it")).collect();
        StackMap { tops: ColumnMap::from_cells(cells.into_iter().zip(tops), lattice), stacks }
    }

    /// What is highest in each stack: columns that are solid from there down.
    pub fn tops(&self) -> &ColumnMap {
        &self.tops
    }

    /// The stack of a cell.
    pub fn stack(&self, cell: [i64; 2]) -> Option<&Stack> {
        self.stacks.get(self.tops.place(cell)?)
    }

    /// All stacks and their cells, in no order.
    pub fn cells(&self) -> impl Iterator<Item = ([i64; 2], &Stack)> {
        self.tops.cells().filter_map(|(cell, _)| Some((cell, self.stack(cell)?)))
    }

    /// U of a lattice height, CRS units.
    pub fn units(&self, steps: i64) -> f64 {
        steps as f64 * self.tops.height_step
    }

    /// Walks the ray of a pixel (whole numbers = pixel centres) cell by cell to its first hit.
    pub fn trace(&self, basis: &RayBasis, px: f64, py: f64) -> Option<Hit> {
        self.tops.walk(basis, [px, py], |stay| self.contact(stay))
    }

    /// All pixels of an image, row by row from the top.
    pub fn render(&self, basis: &RayBasis, size: [u32; 2]) -> Vec<Option<Hit>> {
        each_pixel(size, |x, y| self.trace(basis, x, y))
    }

    /// What of its stack a ray meets first.
    fn contact(&self, stay: &Stay) -> Option<(Contact, Column)> {
        let solid = self.stack(stay.cell)?.solid.map(|top| (f64::NEG_INFINITY, top));
        let solid = solid.and_then(|reach| self.contact_with(stay, reach));
        first(solid.into_iter().chain(self.floating_contact(stay)))
    }

    /// The same of what floats alone.
    pub(super) fn floating_contact(&self, stay: &Stay) -> Option<(Contact, Column)> {
        let reaches =
            self.stack(stay.cell)?.floating.iter().map(|span| (self.units(span.bottom_steps), span.top));
        first(reaches.filter_map(|reach| self.contact_with(stay, reach)))
    }

    fn contact_with(&self, stay: &Stay, (bottom, top): (f64, Column)) -> Option<(Contact, Column)> {
        Some((stay.contact([bottom, self.units(top.height_steps)])?, top))
    }
}

/// The first of several contacts; of some at once that with the larger record.
pub(super) fn first(contacts: impl Iterator<Item = (Contact, Column)>) -> Option<(Contact, Column)> {
    contacts.min_by(|(a, a_top), (b, b_top)| a.t.total_cmp(&b.t).then(b_top.cmp(a_top)))
}

impl Stack {
    /// Its highest point.
    pub fn top(&self) -> Option<Column> {
        self.floating.first().map(|span| span.top).max(self.solid)
    }
}

/// Spans of a column's visible points, each its highest point and its lowest height, and the lowest of all heights.
#[cfg(test)]
pub(super) fn spans_of(
    points: Vec<Column>,
    gap: i64,
) -> (std::collections::BTreeSet<(Column, i64)>, Option<i64>) {
    let Spans { spans, lowest } = Spans::of(points, gap);
    (spans.into_iter().map(|span| (span.top, span.lowest)).collect(), lowest)
}
