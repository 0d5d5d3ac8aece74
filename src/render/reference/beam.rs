//! The twin of `shaders/beam.comp`, step by step in f32 as the shader goes: what a beam reaches is its choice. What stands
//! in a node comes from the finest cells, not from pyramids; above them, from the section table.

use super::columns::ColumnMap;
use crate::coords::{Grid, Height, SECTION_LOG2};
use crate::render::camera::CameraError;
use crate::render::frame::{FrameConstants, View, ViewRays};
use crate::resident::table::Table;
use crate::shared::node::{KEY_LEVEL_SHIFT, NO_KEY};
use std::collections::HashMap;

/// As in `shaders/frame.glsl`.
const FAR: f32 = 1e15;
/// Coarsest level of nodes that a beam takes.
const COARSEST: i32 = 20;
/// Highest thing where nothing is.
const NOTHING: f32 = -3e38;
/// Bits of a beam's word that hold its level.
const LEVEL_BITS: u32 = 31;

/// What a beam's word says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// How far all rays of the tile are sure to be above everything: depth from the eye on, lengths (powers of two of CRS
    /// units, at most a cell). Rounded down to 18 bits.
    pub depth: f32,
    /// Of nodes near there.
    pub level: u32,
}

impl Beam {
    /// Reads a word.
    pub fn of(word: u32) -> Beam {
        Beam { depth: f32::from_bits(word & !LEVEL_BITS), level: word & LEVEL_BITS }
    }

    fn word(s: f32, level: i32, depth: f32) -> u32 {
        ((s + depth) * 0.999_999_8).max(0.0).to_bits() & !LEVEL_BITS | level as u32
    }
}

/// Highest things: by node of the levels below a section's own, steps from the anchor; and of the table's nodes.
struct Tops {
    below: Vec<HashMap<[i32; 2], i32>>,
    table: HashMap<(u32, [i32; 2]), f32>,
}

impl Tops {
    fn of(map: &ColumnMap, table: &Table, grid: &Grid, anchor: Height) -> Tops {
        let mut below = vec![HashMap::new(); SECTION_LOG2 as usize];
        for (cell, column) in map.cells() {
            let cell: [i32; 2] = std::array::from_fn(|axis| (cell[axis] - grid.anchor[axis]) as i32);
            let top = (column.height_steps - i64::from(anchor.0)) as i32;
            for (level, nodes) in below.iter_mut().enumerate() {
                let highest = nodes.entry(cell.map(|index| index >> level)).or_insert(top);
                *highest = top.max(*highest);
            }
        }
        let used = table.slots.iter().filter(|node| node.key[0] != NO_KEY);
        let index = |[east, north]: [u32; 2]| {
            let unused = 32 - KEY_LEVEL_SHIFT;
            [(east << unused) as i32 >> unused, north as i32]
        };
        let table =
            used.map(|node| ((node.key[0] >> KEY_LEVEL_SHIFT, index(node.key)), f32::from_bits(node.top)));
        Tops { below, table: table.collect() }
    }

    fn at(&self, level: i32, node: [i32; 2]) -> f32 {
        match self.below.get(level as usize) {
            Some(nodes) => nodes.get(&node).map_or(NOTHING, |&top| top as f32),
            None => self.table.get(&(level as u32, node)).copied().unwrap_or(NOTHING),
        }
    }
}

/// The words of the beams of tiles of `side` pixels of `view`, which sees all of `map` by `table`, whose heights count
/// from `anchor`; going on from those of wider tiles, if there are any: their side and words. Row by row.
///
/// Errors: the view takes in too much to be drawn.
pub fn beams(
    (view, grid, anchor): (&View, &Grid, Height),
    (map, table): (&ColumnMap, &Table),
    side: u32,
    before: Option<(u32, &[u32])>,
) -> Result<Vec<u32>, CameraError> {
    let rays = ViewRays::of(view, grid, anchor)?;
    let constants = FrameConstants::new(view, &rays, grid, anchor);
    let tops = Tops::of(map, table, grid, anchor);
    let [width, height] = view.size;
    let mut words = Vec::new();
    for y in 0..height.div_ceil(side) {
        for x in 0..width.div_ceil(side) {
            let wide = before.map(|(wide, words)| {
                words[(y * side / wide * width.div_ceil(wide) + x * side / wide) as usize]
            });
            words.push(reach(&Tile::of(&constants, [x, y], side), &constants, table, &tops, wide));
        }
    }
    Ok(words)
}

/// The rays through a tile's corners: origins from the first one's cell, directions a unit of depth.
struct Tile {
    from: [i32; 3],
    origin: [[f32; 4]; 3],
    direction: [[f32; 4]; 3],
}

impl Tile {
    fn of(constants: &FrameConstants, tile: [u32; 2], side: u32) -> Tile {
        let size = [constants.width, constants.height];
        let joined = |int: [i32; 3], fraction: [u32; 3], axis: usize| {
            i64::from(int[axis]) << 32 | i64::from(fraction[axis])
        };
        let mut made = Tile { from: [0; 3], origin: [[0.0; 4]; 3], direction: [[0.0; 4]; 3] };
        for corner in 0..4 {
            let beside = [corner as u32 & 1, corner as u32 >> 1];
            let steps: [i32; 2] =
                std::array::from_fn(|a| ((tile[a] + beside[a]) * side) as i32 - size[a] as i32 / 2);
            let from_centre: [f32; 2] =
                std::array::from_fn(|a| (steps[a] * 16 - (size[a] & 1) as i32 * 8) as f32);
            for axis in 0..3 {
                let right = joined(constants.right_int, constants.right_fraction, axis);
                let down = joined(constants.down_int, constants.down_fraction, axis);
                let exact = joined(constants.origin_int, constants.origin_fraction, axis)
                    .wrapping_add(right.wrapping_mul(steps[0].into()))
                    .wrapping_add(down.wrapping_mul(steps[1].into()));
                let even = exact.wrapping_add(127 + (exact >> 8 & 1));
                let (cell, rest) = ((even >> 32) as i32, (even as u32 >> 8) as f32 * 5.960_464_5e-8);
                if corner == 0 {
                    made.from[axis] = cell;
                }
                let step = if axis == 2 { constants.origin_step } else { 1.0 };
                made.origin[axis][corner] = ((cell - made.from[axis]) as f32 + rest) * step;
                made.direction[axis][corner] = (constants.forward[axis]
                    + from_centre[0] * constants.right[axis]
                    + from_centre[1] * constants.down[axis])
                    * constants.to_local[axis];
            }
        }
        made
    }

    /// Of an axis, at s.
    fn at(&self, axis: usize, s: f32) -> [f32; 4] {
        std::array::from_fn(|k| s * self.direction[axis][k] + self.origin[axis][k])
    }
}

fn least(v: [f32; 4]) -> f32 {
    v[0].min(v[1]).min(v[2].min(v[3]))
}

fn most(v: [f32; 4]) -> f32 {
    v[0].max(v[1]).max(v[2].max(v[3]))
}

/// The word of a tile's beam.
fn reach(tile: &Tile, constants: &FrameConstants, table: &Table, tops: &Tops, wide: Option<u32>) -> u32 {
    let top_level = table.top_level as i32;
    let inverse = [0, 1].map(|a| tile.direction[a].map(|d| 1.0 / if d.abs() < 1e-20 { 1e-20 } else { d }));
    let low: [i32; 2] = std::array::from_fn(|a| table.low[a] - tile.from[a]);
    let high: [i32; 2] = std::array::from_fn(|a| table.high[a] - tile.from[a]);
    let base = tile.from[2] as f32 * constants.origin_step;
    let ahead = [0, 1].map(|a| tile.direction[a][0] + tile.direction[a][3] >= 0.0);
    let (mut s, mut level) = (-constants.depth, top_level);
    if let Some(word) = wide {
        let Beam { depth, level: near } = Beam::of(word);
        (s, level) = (depth - constants.depth, near as i32);
    }
    let mut gone = s > FAR;
    for _ in 0..96 {
        if gone {
            break;
        }
        let at = [0, 1, 2].map(|axis| tile.at(axis, s));
        let slack = [0, 1].map(|a| 0.03 + 5e-7 * least(at[a]).abs().max(most(at[a]).abs()));
        let lo: [f32; 2] = std::array::from_fn(|a| least(at[a]) - slack[a]);
        let hi: [f32; 2] = std::array::from_fn(|a| most(at[a]) + slack[a]);
        let mut size = (1 << level) as f32;
        let widest = (hi[0] - lo[0]).max(hi[1] - lo[1]);
        if widest >= size {
            if level >= COARSEST {
                break;
            }
            // The box has outgrown the nodes.
            level += 1;
            if widest >= 2.0 * size {
                continue;
            }
            size *= 2.0;
        }
        // 2x2 nodes, the beam entering them.
        let first: [i32; 2] = std::array::from_fn(|a| {
            let near = if ahead[a] { lo[a] } else { hi[a] }.floor() as i32;
            ((near + tile.from[a]) >> level) - i32::from(!ahead[a])
        });
        let corner_low: [i32; 2] = std::array::from_fn(|a| (first[a] << level) - tile.from[a]);
        let corner_high: [i32; 2] = std::array::from_fn(|a| ((first[a] + 2) << level) - tile.from[a]);
        let exits = [0, 1].map(|a| {
            least(std::array::from_fn(|k| {
                let ends = [corner_low[a] as f32 + slack[a], corner_high[a] as f32 - slack[a]];
                (ends[usize::from(tile.direction[a][k] > 0.0)] - tile.origin[a][k]) * inverse[a][k]
            }))
        });
        let s_exit = exits[0].min(exits[1]);
        if s_exit <= s || s_exit.is_nan() {
            // Not even the box itself lies in them, slack included.
            if level >= COARSEST {
                break;
            }
            level += 1;
            continue;
        }
        let mut lowest = least(at[2]).min(least(tile.at(2, s_exit)));
        lowest += base - 1.0 - 1e-6 * (lowest.abs() + base.abs());
        let outside = (0..2).any(|a| corner_low[a] >= high[a] || corner_high[a] <= low[a]);
        let clear = outside
            || level <= top_level && {
                let beside = [[0, 0], [1, 0], [0, 1], [1, 1]];
                beside.iter().all(|[i, j]| lowest > tops.at(level, [first[0] + i, first[1] + j]))
            };
        if clear {
            // Away from everything: no corner comes back.
            gone = (0..2).any(|a| {
                lo[a] >= high[a] as f32 && least(tile.direction[a]) >= 0.0
                    || hi[a] <= low[a] as f32 && most(tile.direction[a]) <= 0.0
            });
            s = s_exit;
            level = (level + 1).min(COARSEST);
        } else {
            if level == 0 || widest >= 0.5 * size {
                break;
            }
            level -= 1;
        }
    }
    Beam::word(if gone { 2.0 * FAR } else { s }, level, constants.depth)
}
