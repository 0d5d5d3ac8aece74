//! What is derived of stacks against the same rules on the host, code for code: which spans float and what is solid, bridges
//! of that, mean heights, what is filled from them and how far, lists, and the pyramid.

use crate::common::{self, LAVAPIPE};
use crate::derived::bridge;
use glam::{IVec2, ivec2};
use lasray::attribute::{Attributes, ClassMask, Flags, Record};
use lasray::coords::{Grid, HEIGHT_STEP, Height, SECTION_COLUMNS, SECTION_SIDE, SectionKey};
use lasray::gpu::Order;
use lasray::resident::pool::Access;
use lasray::resident::scene::{ReadBack, Scene};
use lasray::resident::visibility::{ColumnData, Visibility};
use lasray::section::{Columns, Derived, Layout, Payload, Surface, column_at};
use lasray::shared::payload::{
    FLOAT_MEANS, LIST_CODES, LIST_COUNTS, LIST_ROWS, LIST_SOLID, LIST_TOP, STACK_LEVEL_1, STACK_LEVEL_2,
    STACK_LIST, STACK_SPANS,
};
use lasray::source::{FLAG_KEY_POINT, FLAG_OVERLAP, FLAG_SYNTHETIC, FLAG_WITHHELD};

const GRID: Grid = Grid { base_cell: 0.25, coarsen: 0, anchor: [0; 2], height_step: HEIGHT_STEP };
const SIDE: usize = SECTION_SIDE as usize;
/// Blocks of 4 × 4 columns on a side.
const BLOCKS: usize = SIDE / 4;
/// Lattice steps: an eighth of a finest cell; a finest cell; two.
const TIE: i64 = 32;
const THICKNESS: i64 = 256;
const GAP: i64 = 512;
/// Columns each way that tell whether what is not classified floats, and how many of them must be lower, of the finest level and of
/// the two above.
const AROUND: [(usize, usize); 3] = [(2, 3), (1, 2), (0, 1)];
/// Columns under crowns without any ground, x and y from and to.
const HOLLOW: [[u32; 2]; 2] = [[88, 190], [116, 222]];

/// Open land in the west, then a forest in which one column of ten has ground and a part has none; a pond of which nothing is
/// known, roofs with unclassified eaves, a wire and a deck over all. `high`: a point beyond 16 bits.
fn forest(SectionKey { level, i, j }: SectionKey, high: bool) -> Payload {
    let mut columns = Columns::new(Surface::Stacks, GRID.stacking(level));
    for at in 0..SECTION_SIDE * SECTION_SIDE {
        let (x, y) = (at % SECTION_SIDE, at / SECTION_SIDE);
        let hash = |k: u32| (at ^ k << 17 ^ ((i * 5 + j + 9) as u32) << 22).wrapping_mul(2_654_435_761) >> 12;
        let mut add = |height: u32, class: u8, flags: u8| {
            let height = Height(height as i32);
            let (rgb, returns) = ([8, 9, 10].map(|k| hash(k) as u8), hash(11) as u8);
            let intensity = hash(12) as u16;
            columns.add(x, y, Record::pack(Attributes { height, class, intensity, rgb, returns, flags }));
        };
        let from_pond = [x.abs_diff(215), y.abs_diff(50)].map(|d| d * d);
        if x + y < 30 || from_pond[0] + from_pond[1] < 500 {
            continue;
        }
        let is_in = |[from, to]: [u32; 2], v: u32| from <= v && v < to;
        let is_hollow = is_in(HOLLOW[0], x) && is_in(HOLLOW[1], y);
        let (is_open, is_roof) = (x < 44, is_in([12, 33], x) && is_in([60, 81], y));
        let ground = 20_000 + x * 3 + y * 5 + hash(1) % 60;
        let flags = match hash(2) {
            withheld if withheld % 23 == 0 => FLAG_WITHHELD,
            made if made % 29 == 0 => FLAG_SYNTHETIC | FLAG_KEY_POINT,
            other => (other % 5 / 4) as u8 * FLAG_OVERLAP,
        };
        if is_roof {
            // Eaves, a little lower or higher than the rest, now and then over ground.
            let is_rim = x < 15 || y > 77;
            add(23_000 + hash(3) % 40, if is_rim { [1, 12, 0][hash(4) as usize % 3] } else { 6 }, flags);
            if is_rim && hash(5) % 3 == 0 {
                add(ground, 2, 0);
            }
        } else if !is_hollow && hash(6) % 100 < if is_open { 80 } else { 10 } {
            add(ground, 2, flags);
        }
        if !is_hollow && hash(7) % 9 == 0 {
            // About the ground, or well above it.
            let height = ground + hash(8) % [40, 700, 4000][hash(9) as usize % 3];
            add(height, [0, 1, 12, 200][hash(13) as usize % 4], flags);
        }
        if !is_open && !is_roof && hash(14) % 3 > 0 {
            for k in 0..1 + hash(15) % 4 {
                let class = [3, 4, 5, 5][(hash(16 + k) % 4) as usize];
                add(ground + 800 + hash(20 + k) % 9000, class, flags);
            }
        }
        if y == 30 || is_in([100, 103], y) && x > 20 {
            add(ground + 9500, if y == 30 { 14 } else { 17 }, 0);
        }
        if high && (x, y) == (8, 90) {
            add(300_000, 2, 0);
        }
    }
    columns.pack()
}

/// A section as the mask leaves it; columns row by row.
struct Host {
    key: SectionKey,
    layout: Layout,
    columns: Vec<Column>,
}

#[derive(Clone, Default)]
struct Column {
    /// Height of its lowest point.
    lowest: Option<i64>,
    /// Height of what is solid, and what is shown of it.
    solid: Option<(i32, u32)>,
    /// Top, bottom and what is shown of what floats, the highest first.
    floating: Vec<(i64, i64, u32)>,
}

fn shows(record: &Record, column_data: ColumnData) -> u32 {
    let Attributes { class, rgb: [r, g, b], intensity, returns, .. } = record.unpack().expect("a run");
    u32::from_le_bytes(match column_data {
        ColumnData::Colors => [r, g, b, class],
        ColumnData::Values => [intensity as u8, (intensity >> 8) as u8, returns, class],
    })
}

impl Host {
    fn of(key: SectionKey, packed: &Payload, shown: &Visibility, column_data: ColumnData) -> Host {
        let stacking = GRID.stacking(key.level);
        let (gap, thickness) = (GAP << key.level, THICKNESS << key.level);
        let (reach, least) = AROUND[usize::from(key.level)];
        // Of each column the spans that are shown, highest first, with their lowest heights.
        let mut spans: Vec<Vec<(Record, i64)>> = vec![Vec::new(); SECTION_COLUMNS];
        packed.columns_with_depths(|column, runs, depths| {
            let [x, y] = column_at(column).map(|v| v as usize);
            let seen = runs.iter().zip(depths);
            let seen = seen.filter(|(r, _)| shown.shows(r.kind()));
            let low = |r: &Record, depth| stacking.height_at_depth(r.height().expect("a run"), depth);
            spans[y * SIDE + x].extend(seen.map(|(r, depth)| (*r, low(r, *depth))));
        });
        let lowest: Vec<Option<i64>> = spans.iter().map(|s| s.iter().map(|(_, low)| *low).min()).collect();
        let mut columns = vec![Column::default(); SECTION_COLUMNS];
        for (at, column) in columns.iter_mut().enumerate() {
            let (x, y) = (at % SIDE, at / SIDE);
            let near = |v: usize| v.saturating_sub(reach)..(v + reach + 1).min(SIDE);
            let is_over_lower = |low: i64| {
                let around = near(y).flat_map(|y| near(x).map(move |x| y * SIDE + x));
                around.filter(|&k| lowest[k].is_some_and(|other| other < low - gap)).count() >= least
            };
            column.lowest = lowest[at];
            for (k, (record, low)) in spans[at].iter().enumerate() {
                let top = record.height().expect("a run").0;
                let floats = match record.class() {
                    2 | 6 | 9 | 10 | 11 | 41 => false,
                    3 | 4 | 5 | 7 | 13..=19 => true,
                    _ => is_over_lower(*low),
                };
                if floats {
                    column.floating.push((top.into(), low - thickness, shows(record, column_data)));
                    continue;
                }
                let tells = |class: u8| !matches!(class, 0 | 1 | 12);
                let is_as_high = |(r, _): &&(Record, i64)| {
                    i64::from(top) - i64::from(r.height().expect("a run").0) <= TIE && tells(r.class())
                };
                let other = if shown.near_ties && !tells(record.class()) {
                    spans[at][k + 1..].iter().find(is_as_high).map(|(r, _)| r)
                } else {
                    None
                };
                column.solid = Some((top, shows(other.unwrap_or(record), column_data)));
                break;
            }
        }
        Host { key, layout: packed.layout, columns }
    }

    fn code(&self, height: i64) -> u32 {
        let most = if self.layout.code.wide { u32::MAX } else { 0xFFFF };
        (height - i64::from(self.layout.code.base)).clamp(1, most.into()) as u32
    }

    /// Codes of what is solid and measured.
    fn measured(&self) -> Vec<u32> {
        self.columns.iter().map(|c| c.solid.map_or(0, |(height, _)| self.code(height.into()))).collect()
    }
}

/// Mean of those that are not 0, rounded down; 0: none is.
fn mean(codes: &[u32]) -> u32 {
    let (sum, n) = codes.iter().filter(|c| **c != 0).fold((0, 0), |(s, n), c| (s + u64::from(*c), n + 1));
    sum.checked_div(n).unwrap_or(0) as u32
}

/// Mean heights in nodes of 4, 8 and 16 columns, of codes of what is measured: of four, of four such, and so on.
fn means_of(measured: &[u32]) -> [Vec<u32>; 3] {
    let halved = |codes: &[u32]| -> Vec<u32> {
        let side = codes.len().isqrt();
        let node = |k: usize| k / (side / 2) * 2 * side + k % (side / 2) * 2;
        let four = |k: usize| [codes[k], codes[k + 1], codes[k + side], codes[k + side + 1]];
        (0..codes.len() / 4).map(|k| mean(&four(node(k)))).collect()
    };
    let level_2: Vec<u32> = (0..BLOCKS * BLOCKS)
        .map(|k| {
            let first = k / BLOCKS * 4 * SIDE + k % BLOCKS * 4;
            let rows = [0, 1, 2, 3].map(|row| mean(&measured[first + row * SIDE..][..4]));
            mean(&rows)
        })
        .collect();
    let level_3 = halved(&level_2);
    let level_4 = halved(&level_3);
    [level_2, level_3, level_4]
}

/// What a hole of a section is filled with, from means and codes of what is measured: its code, and the column that it shows.
fn filling(measured: &[u32], means: &[Vec<u32>; 3], [x, y]: [usize; 2]) -> Option<(u32, usize)> {
    (2..=4).zip(means).find_map(|(level, means)| {
        let (size, side) = (1 << level, SIDE >> level);
        // Of three nodes in a row, twice a node's length: what a square of two nodes' length about the column, smeared by half
        // a node, has of each.
        let shares = |v: usize| [2 * size - (2 * (v % size) + 1), 2 * size, 2 * (v % size) + 1];
        let (of_x, of_y) = (shares(x), shares(y));
        let (mut sum, mut all, mut best) = (0, 0, (0, [0; 2]));
        for (k, l) in (0..3).flat_map(|l| (0..3).map(move |k| (k, l))) {
            let [Some(a), Some(b)] = [(x / size + k).checked_sub(1), (y / size + l).checked_sub(1)] else {
                continue;
            };
            if a >= side || b >= side || means[b * side + a] == 0 {
                continue;
            }
            let share = (of_x[k] * of_y[l]) as u64;
            sum += share * u64::from(means[b * side + a]);
            all += share;
            if share > best.0 {
                best = (share, [a, b]);
            }
        }
        let (_, [a, b]) = best;
        // The last measured column of the node, half by half; of 4 x 4 the last row by row.
        let last = |[x, y]: [usize; 2]| {
            let halves = (2..level).rev().map(|bit| (y >> bit & 1) * 2 + (x >> bit & 1));
            (halves.fold(0, |order, half| order * 4 + half), y % 4, x % 4)
        };
        let columns = (0..size * size).map(|k| [a * size + k % size, b * size + k / size]);
        let source = columns.filter(|[x, y]| measured[y * SIDE + x] != 0).max_by_key(|at| last(*at));
        let [source_x, source_y] = source.filter(|_| all > 0)?;
        Some(((sum / all) as u32, source_y * SIDE + source_x))
    })
}

/// Columns to the nearest one, along the longer axis; those beyond the border are none.
fn distances(is_there: &[bool]) -> Vec<u32> {
    let mut distances: Vec<u32> = is_there.iter().map(|is| if *is { 0 } else { 1 << 20 }).collect();
    let mut relax = |at: usize, near: [[i32; 2]; 4]| {
        for [dx, dy] in near {
            let (x, y) = ((at % SIDE) as i32 + dx, (at / SIDE) as i32 + dy);
            if x >= 0 && y >= 0 && x < SIDE as i32 && y < SIDE as i32 {
                distances[at] = distances[at].min(distances[y as usize * SIDE + x as usize] + 1);
            }
        }
    };
    let before = [[-1, 0], [-1, -1], [0, -1], [1, -1]];
    (0..SECTION_COLUMNS).for_each(|at| relax(at, before));
    (0..SECTION_COLUMNS).rev().for_each(|at| relax(at, before.map(|near| near.map(|v| -v))));
    distances
}

/// Of each block of 4 × 4 columns, row by row.
struct InBlocks {
    /// Something floats in it.
    float: Vec<bool>,
    /// It holds anything measured, solid or floating.
    hold: Vec<bool>,
}

impl InBlocks {
    fn of(host: &Host) -> InBlocks {
        let any = |is: fn(&Column) -> bool| -> Vec<bool> {
            let first = |block: usize| block / BLOCKS * 4 * SIDE + block % BLOCKS * 4;
            let columns = |block: usize| (0..16).map(move |k| first(block) + k / 4 * SIDE + k % 4);
            (0..BLOCKS * BLOCKS).map(|block| columns(block).any(|at| is(&host.columns[at]))).collect()
        };
        InBlocks {
            float: any(|column| !column.floating.is_empty()),
            hold: any(|column| !column.floating.is_empty() || column.solid.is_some()),
        }
    }

    /// Of the nine around a block; `beyond`: of those beyond the border.
    fn around(block: usize, of: &[bool], beyond: bool) -> [bool; 9] {
        std::array::from_fn(|k| {
            let at = [block % BLOCKS + k % 3, block / BLOCKS + k / 3].map(|v| v.wrapping_sub(1));
            if at.iter().all(|v| *v < BLOCKS) { of[at[1] * BLOCKS + at[0]] } else { beyond }
        })
    }

    fn anything_floats_around(&self, block: usize) -> bool {
        InBlocks::around(block, &self.float, false).contains(&true)
    }

    /// It does not lie beside where there is nothing.
    fn is_inner(&self, block: usize) -> bool {
        !InBlocks::around(block, &self.hold, true).contains(&false)
    }
}

/// How many columns are of each kind.
#[derive(Debug, Default, Clone, Copy)]
struct Counted {
    floating: usize,
    bridged: usize,
    filled: usize,
    /// Beneath what floats, too far from all that is measured.
    open: usize,
    /// Holes of which nothing floats nearby, or beside the end of what there is.
    outside: usize,
}

/// What was read back of a section.
struct Found {
    words: Vec<u32>,
    derived: Derived,
}

impl Found {
    fn code(&self, first: u32, k: usize) -> u32 {
        match self.derived.wide {
            true => self.words[first as usize + k],
            false => self.words[first as usize + k / 2] >> (16 * (k % 2)) & 0xFFFF,
        }
    }

    fn word(&self, at: u32) -> u32 {
        self.words[at as usize]
    }

    fn list(&self, block: usize) -> u32 {
        self.in_block(block, STACK_LIST)
    }

    fn in_block(&self, block: usize, word: u32) -> u32 {
        self.word(block as u32 * self.derived.block_words() + word)
    }
}

fn check(
    scene: &mut Scene,
    sections: &[(SectionKey, &Payload)],
    shown: Visibility,
    column_data: ColumnData,
) -> Counted {
    let mut counted = Counted::default();
    let hosts: Vec<Host> =
        sections.iter().map(|(key, packed)| Host::of(*key, packed, &shown, column_data)).collect();
    let side = SIDE as i32;
    let level = sections[0].0.level;
    let column_of = |at: IVec2| {
        let [i, j] = [at.x, at.y].map(|v| v.div_euclid(side));
        let host = hosts.iter().find(|host| host.key == SectionKey { level, i, j })?;
        host.columns[(at.y.rem_euclid(side) * side + at.x.rem_euclid(side)) as usize].solid
    };
    for host in &hosts {
        let ReadBack { layout, derived: words, .. } = scene.read_back(host.key).unwrap().expect("live");
        let what = format!("{shown:?}, {:?}", host.key);
        assert_eq!(layout.code, host.layout.code, "{what}");
        let found = Found { words, derived: layout.derived() };
        let measured = host.measured();
        let means = means_of(&measured);
        let distance = distances(&measured.iter().map(|code| *code != 0).collect::<Vec<_>>());
        let blocks = InBlocks::of(host);
        let mut solid = vec![0; SECTION_COLUMNS];
        let mut level: Vec<u32> = vec![0; SECTION_COLUMNS];
        let mut nodes = vec![Node::default(); SECTION_COLUMNS];
        for at in 0..SECTION_COLUMNS {
            let (x, y) = (at % SIDE, at / SIDE);
            let (column, block) = (&host.columns[at], y / 4 * BLOCKS + x / 4);
            let place = ivec2(host.key.i * side + x as i32, host.key.j * side + y as i32);
            let bridge = if column.solid.is_none() && shown.bridge > 0 {
                let height_at = |at| column_of(at).map(|(height, _)| height);
                bridge(height_at, place, shown.bridge as i32, host.key.level)
            } else {
                None
            };
            let is_hole = column.solid.is_none() && bridge.is_none();
            let may_fill = shown.bridge > 0
                && is_hole
                && blocks.anything_floats_around(block)
                && (blocks.is_inner(block) || !column.floating.is_empty());
            let filled = if may_fill { filling(&measured, &means, [x, y]) } else { None };
            let (code, shows) = match (column.solid, bridge, filled) {
                (Some((_, shows)), ..) => (measured[at], shows),
                (None, Some((height, source)), _) => {
                    (host.code(height.into()), column_of(place + source).expect("measured").1)
                }
                (None, None, Some((code, source))) => (code, host.columns[source].solid.expect("measured").1),
                _ => (0, 0),
            };
            let what = format!("{what}, column {x}, {y}");
            // How far away it is filled from.
            let by_distance = match distance[at] {
                ..=16 => may_fill,
                32.. => false,
                _ => filled.is_some(),
            };
            assert_eq!(filled.is_some(), by_distance, "{what}: {} columns from measured ones", distance[at]);
            counted.floating += usize::from(!column.floating.is_empty());
            counted.bridged += usize::from(bridge.is_some());
            counted.filled += usize::from(filled.is_some());
            counted.open += usize::from(may_fill && filled.is_none());
            counted.outside += usize::from(is_hole && !may_fill);

            let derived = found.derived;
            let first = block as u32 * derived.block_words();
            let bits = found.word((block as u32 & !1) * derived.block_words() + derived.measured());
            let bit = bits >> (y % 4 * 8 + x % 8) & 1;
            assert_eq!(bit != 0, column.solid.is_some(), "measured: {what}");
            let inner = y % 4 * 4 + x % 4;
            assert_eq!(found.word(first + derived.shown() + inner as u32), shows, "shown: {what}");
            solid[at] = code;
            level[at] = code.max(column.floating.first().map_or(0, |(top, ..)| host.code(*top)));
            nodes[at] = Node::of(host, column, code);
            assert_eq!(level[at], nodes[at].top);
            nodes[at].check(
                &found,
                found.in_block(block, inner as u32),
                host.key.level,
                &format!("level 0: {what}"),
            );
        }
        check_lists(host, &found, &solid, &what);
        if shown.bridge > 0 {
            check_means(&found, &means, &what);
        }
        check_pyramid(host, &found, nodes, &what);
    }
    counted
}

fn check_means(found: &Found, means: &[Vec<u32>; 3], what: &str) {
    let mut first = found.derived.floats() + FLOAT_MEANS;
    for (level, means) in (2..).zip(means) {
        let wrong = (0u32..).zip(means).find(|(k, mean)| found.word(first + k) != **mean);
        let said = wrong.map(|(k, mean)| (k, found.word(first + k), mean));
        assert_eq!(said, None, "{what}: mean of a node of level {level}, found and wanted");
        first += means.len() as u32;
    }
}

/// Lists and spans: those of blocks in which something floats, and what they say.
fn check_lists(host: &Host, found: &Found, solid: &[u32], what: &str) {
    let (derived, wide) = (found.derived, u32::from(found.derived.wide));
    let floats = host.layout.floats.expect("stacks");
    let listed = (0..BLOCKS * BLOCKS).filter(|&block| found.list(block) != 0).count();
    assert_eq!(listed, 2 * floats.lists as usize, "{what}");
    let mut rooms = Vec::new();
    for block in 0..BLOCKS * BLOCKS {
        let what = format!("{what}, block {}, {}", block % BLOCKS, block / BLOCKS);
        let first = block / BLOCKS * 4 * SIDE + block % BLOCKS * 4;
        let columns: Vec<usize> = (0..16).map(|k| first + k / 4 * SIDE + k % 4).collect();
        let spans: Vec<&[(i64, i64, u32)]> =
            columns.iter().map(|&at| &host.columns[at].floating[..]).collect();
        let list = found.list(block);
        if list == 0 {
            assert!(
                spans.iter().all(|spans| spans.is_empty()),
                "{what}: something floats, and it has no list"
            );
            continue;
        }
        let from = list;
        let all = || spans.iter().copied().flatten();
        let top = all().map(|(top, ..)| host.code(*top)).max().unwrap_or(0);
        assert_eq!(found.word(from + LIST_TOP), top, "{what}: top");
        let counts: Vec<u32> = spans.iter().map(|spans| spans.len() as u32).collect();
        let words: &[u32] = &found.words[(from + LIST_COUNTS) as usize..][..4];
        let found_counts: Vec<u32> = words.iter().flat_map(|w| w.to_le_bytes()).map(u32::from).collect();
        assert_eq!(found_counts, counts, "{what}: spans of columns");
        let rows: Vec<u32> = counts.chunks(4).map(|row| row.iter().sum()).collect();
        let rows = rows[0] | (rows[0] + rows[1]) << 10 | rows[2] << 21;
        assert_eq!(found.word(from + LIST_ROWS), rows, "{what}: spans of rows");
        for (k, &at) in columns.iter().enumerate() {
            let code = |which: u32| found.code(from + LIST_SOLID + which * (LIST_CODES << wide), k);
            let lowest = host.columns[at].lowest.map_or(0, |lowest| host.code(lowest));
            assert_eq!([code(0), code(1)], [solid[at], lowest], "{what}, column {k}: solid and lowest");
        }
        let start = found.in_block(block, STACK_SPANS);
        for (k, &(top, bottom, shows)) in all().enumerate() {
            let at = start + k as u32 * derived.span_words();
            let span = [found.code(at, 0), found.code(at, 1), found.word(at + 1 + wide)];
            assert_eq!(span, [host.code(top), host.code(bottom), shows], "{what}: span {k}");
        }
        rooms.push([start, start + counts.iter().sum::<u32>() * derived.span_words()]);
    }
    rooms.sort_unstable();
    assert!(rooms.windows(2).all(|pair| pair[0][1] <= pair[1][0]), "{what}: spans of two blocks overlap");
    let ends =
        [rooms[0][0] >= derived.spans(floats), rooms[rooms.len() - 1][1] as usize <= found.words.len()];
    assert_eq!(ends, [true; 2], "{what}: spans lie elsewhere");
}

/// What a node holds, codes: the highest thing, the highest that is solid (0: nothing is), the lowest bottom of what floats.
#[derive(Clone, Copy, Default)]
struct Node {
    top: u32,
    solid: u32,
    bottom: Option<u32>,
}

impl Node {
    fn of(host: &Host, column: &Column, solid: u32) -> Node {
        let floating = column.floating.first().map_or(0, |(top, ..)| host.code(*top));
        let bottom = column.floating.iter().map(|(_, bottom, _)| host.code(*bottom)).min();
        Node { top: solid.max(floating), solid, bottom }
    }

    fn around(self, other: Node) -> Node {
        Node {
            top: self.top.max(other.top),
            solid: self.solid.max(other.solid),
            bottom: self.bottom.into_iter().chain(other.bottom).min(),
        }
    }

    /// Checks the word of a node of a block: what it says of what is solid and of what floats is as near as its steps let it be, the
    /// latter made of what those of columns say.
    fn check(self, found: &Found, word: u32, level: u8, what: &str) {
        if found.derived.wide {
            assert_eq!(word, self.top, "{what}");
            return;
        }
        let [top, solid, bottom] = [word & 0xFFFF, word >> 16 & 0xFF, word >> 24];
        assert_eq!(top, self.top, "{what}");
        let Some(lowest) = self.bottom else {
            assert_eq!([solid, bottom], [0; 2], "{what}: nothing floats");
            return;
        };
        // Half a gap, which doubles with each level.
        let step = (GAP as u32 / 2) << level;
        assert_eq!(solid, ((top - self.solid) / step).min(255), "{what}: solid");
        let exact = (top - lowest).div_ceil(step).max(1);
        assert!(
            (exact.min(255)..=(exact + 1).min(255)).contains(&bottom),
            "{what}: bottom {bottom}, not {exact}"
        );
    }
}

/// Levels 1 to 8 above `nodes`, which are level 0.
fn check_pyramid(host: &Host, found: &Found, mut nodes: Vec<Node>, what: &str) {
    let mut side = SIDE;
    for number in 1..=8 {
        side /= 2;
        nodes = (0..side * side)
            .map(|k| (k / side * 2 * 2 * side) + k % side * 2)
            .map(|k| {
                nodes[k].around(nodes[k + 1]).around(nodes[k + 2 * side]).around(nodes[k + 2 * side + 1])
            })
            .collect();
        for (k, node) in nodes.iter().enumerate() {
            let (x, y) = (k % side, k / side);
            let what = || format!("{what}: node {x}, {y} of level {number}");
            match number {
                1 => {
                    let word = STACK_LEVEL_1 + (y % 2 * 2 + x % 2) as u32;
                    node.check(found, found.in_block(y / 2 * BLOCKS + x / 2, word), host.key.level, &what());
                }
                2 => node.check(found, found.in_block(k, STACK_LEVEL_2), host.key.level, &what()),
                _ => {}
            }
            if number > 1 {
                let code = found.code(found.derived.upper_levels(), (0x4000 - 4 * side * side) / 3 + k);
                assert_eq!(code, node.top, "{}", what());
            }
        }
    }
}

fn key(i: i32, j: i32) -> SectionKey {
    SectionKey { level: 0, i, j }
}

#[test]
fn stacks_are_derived_as_specified() {
    common::run("filled::stacks_are_derived_as_specified", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        // The second has wide codes; the place beside the last is empty.
        let sections: Vec<_> = [([0, 0], false), ([1, 0], true), ([0, 1], false)]
            .map(|([i, j], high)| (key(i, j), forest(key(i, j), high)))
            .into();
        assert_eq!([0, 1, 2].map(|k: usize| sections[k].1.layout.code.wide), [false, true, false]);
        let all: Vec<_> = sections.iter().map(|(key, packed)| (*key, packed)).collect();
        let usual = Visibility {
            classes: ClassMask::default(),
            hidden_flags: Flags::WITHHELD,
            bridge: 4,
            near_ties: true,
        };
        for access in [Access::Address, Access::StorageBuffer] {
            let mut scene = Scene::new(&gpu, |o: Order| o, access, 100 << 20, usual, GRID).unwrap();
            // Alone, with its neighbours, and without one again.
            for (k, (key, packed)) in sections.iter().enumerate() {
                assert!(scene.upload(*key, packed).unwrap());
                scene.settle().unwrap();
                check(&mut scene, &all[..=k], usual, ColumnData::Colors);
            }
            scene.evict(&[sections[1].0]).unwrap();
            scene.settle().unwrap();
            check(&mut scene, &[all[0], all[2]], usual, ColumnData::Colors);
            assert!(scene.upload(sections[1].0, &sections[1].1).unwrap());
            scene.settle().unwrap();
            let counted = check(&mut scene, &all, usual, ColumnData::Colors);
            println!("{access:?}: {counted:?}");
            let Counted { floating, bridged, filled, open, outside } = counted;
            assert!([floating, bridged, filled].iter().all(|n| *n > 20_000), "{counted:?}");
            assert!(open > 1000 && outside > 1000, "{counted:?}");
            for (classes, hidden_flags, bridge, near_ties, column_data) in [
                (ClassMask::all(), Flags::NONE, 4, false, ColumnData::Values),
                (ClassMask::only(&[2, 5, 14]), Flags::WITHHELD, 2, true, ColumnData::Colors),
                (ClassMask::default().without(&[2]), Flags::WITHHELD, 4, true, ColumnData::Colors),
                (ClassMask::only(&[0, 1, 2, 12, 200]), Flags::NONE, 1, true, ColumnData::Values),
                (ClassMask::default().without(&[5]), Flags::WITHHELD, 0, true, ColumnData::Colors),
                (ClassMask::only(&[99]), Flags::WITHHELD, 4, false, ColumnData::Colors),
                (ClassMask::all(), Flags::OVERLAP, 4, true, ColumnData::Values),
                (ClassMask::default(), Flags::ALL, 4, true, ColumnData::Colors),
            ] {
                let shown = Visibility { classes, hidden_flags, bridge, near_ties };
                scene.set_visibility(shown).unwrap();
                scene.set_column_data(column_data).unwrap();
                println!("{shown:?}: {:?}", check(&mut scene, &all, shown, column_data));
            }
            scene.set_visibility(usual).unwrap();
            for level in 1..=2 {
                let (key, high) = (SectionKey { level, i: 3, j: 3 }, level == 2);
                let packed = forest(key, high);
                assert!(scene.upload(key, &packed).unwrap());
                scene.settle().unwrap();
                let counted = check(&mut scene, &[(key, &packed)], usual, ColumnData::Colors);
                println!("level {level}: {counted:?}");
                assert!(counted.floating > 5000 && counted.filled > 5000, "level {level}: {counted:?}");
            }
        }
        assert_eq!(gpu.messages(), [""; 0]);
    });
}

/// Crowns over all of a section whose western part alone has ground: that goes on beneath them, and ends.
#[test]
fn ground_goes_on_beneath_crowns_and_ends() {
    common::run("filled::ground_goes_on_beneath_crowns_and_ends", LAVAPIPE, |setup| {
        let gpu = setup.gpu();
        let shown =
            Visibility { classes: ClassMask::all(), hidden_flags: Flags::NONE, bridge: 4, near_ties: true };
        let mut scene = Scene::new(&gpu, |o: Order| o, Access::Address, 100 << 20, shown, GRID).unwrap();
        for ground in [95, 96, 103, 111] {
            let mut columns = Columns::new(Surface::Stacks, GRID.stacking(0));
            for (x, y) in (0..SECTION_SIDE).flat_map(|y| (0..SECTION_SIDE).map(move |x| (x, y))) {
                let mut add = |height: i32, class: u8| {
                    let height = Height(height);
                    let attributes =
                        Attributes { height, class, intensity: 9, rgb: [7; 3], returns: 0x11, flags: 0 };
                    columns.add(x, y, Record::pack(attributes));
                };
                add(15_000, 5);
                if x <= ground {
                    add(9000, 2);
                }
            }
            let packed = columns.pack();
            assert!(scene.upload(key(0, 0), &packed).unwrap());
            scene.settle().unwrap();
            let ReadBack { layout, derived: words, .. } = scene.read_back(key(0, 0)).unwrap().expect("live");
            let found = Found { words, derived: layout.derived() };
            let level = (9000 - layout.code.base) as u32;
            for (x, y) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y))) {
                let list = found.list(y / 4 * BLOCKS + x / 4);
                let code = found.code(list + LIST_SOLID, y % 4 * 4 + x % 4);
                let reach = x.saturating_sub(ground as usize);
                let is_filled = reach <= 16 || code != 0;
                assert_eq!(code, if is_filled { level } else { 0 }, "{ground}: column {x}, {y}");
                assert!(code == 0 || reach <= 31, "{ground}: {reach} columns from the ground, at {x}, {y}");
            }
        }
        assert_eq!(gpu.messages(), [""; 0]);
    });
}
