//! The section table: what the traversal may see in one frame. Pure.
//!
//! A quadtree over sections as an open-addressed hash: a node is either a section or an ancestor of one, and
//! carries the highest thing below it. Empty land has no node, so one stray point 185 km away costs a few
//! slots. Laid out for `shaders/frame.glsl`.

use crate::coords::{Height, SECTION_LOG2, SectionKey};
use crate::shared::node::{
    HASH_EAST, HASH_LAST_SHIFT, HASH_LEVEL, HASH_MIX, HASH_NORTH, HASH_SHIFT, KEY_INDEX_MASK,
    KEY_LEVEL_SHIFT, META_DETAIL_SHIFT, NO_KEY, NO_NODE, NODE_BASE, NODE_BESIDE, NODE_CORNERS, NODE_FLOATS,
    NODE_FORM, NODE_JOINS, NODE_KEY, NODE_META, NODE_PYRAMID, NODE_TOP, NODE_WORDS, TOP_SECTION,
};
use bytemuck::{Pod, Zeroable};
use std::collections::HashMap;
use std::mem::offset_of;

/// One slot. `shaders/frame.glsl` has the same struct.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable, PartialEq)]
pub struct Node {
    /// Level (log2 cells) << 26 | index east (26 bits), index north; all ones in the first: unused.
    pub key: [u32; 2],
    /// Highest thing below, lattice steps from the anchor, rounded up; bits of an f32, the last one set for sections.
    pub top: u32,
    /// Level; of sections also the detail level of what is shown << 16.
    pub meta: u32,
    /// Where its pyramid lies: its device address (or word), low half first. Drivers hand out addresses of all 64 bits
    /// (RADV's begin at 0xffff800000000000), so none of them can mean anything else.
    pub pyramid: [u32; 2],
    /// Lattice height of code 0, from the anchor.
    pub base: i32,
    /// How what is derived of its section lies: `FORM_WIDE`, `FORM_FLOATS`.
    pub form: u32,
    /// Slots of the sections of its size and detail to the east, west, north and south; all ones where there is none.
    pub beside: [u32; 4],
    /// Where something of its section may float: 1 + log2 of the lattice steps that the words of its blocks count by; 0: nothing does.
    pub floats: u32,
    /// First word of its corners where its tops are a smooth surface; 0: they are not.
    pub corners: u32,
    /// Words from a span of it to what it is joined with; 0: spans are boxes.
    pub joins: u32,
    /// Up to a cache line.
    pub pad: u32,
}

const _: () = {
    let words = [
        NODE_KEY,
        NODE_TOP,
        NODE_META,
        NODE_PYRAMID,
        NODE_BASE,
        NODE_FORM,
        NODE_BESIDE,
        NODE_FLOATS,
        NODE_CORNERS,
        NODE_JOINS,
        NODE_WORDS,
    ];
    let bytes = [
        offset_of!(Node, key),
        offset_of!(Node, top),
        offset_of!(Node, meta),
        offset_of!(Node, pyramid),
        offset_of!(Node, base),
        offset_of!(Node, form),
        offset_of!(Node, beside),
        offset_of!(Node, floats),
        offset_of!(Node, corners),
        offset_of!(Node, joins),
        size_of::<Node>(),
    ];
    let mut k = 0;
    while k < words.len() {
        assert!(bytes[k] == 4 * words[k] as usize);
        k += 1;
    }
};

/// The f32 at or above `top` whose last bit is `section`.
fn marked(top: f32, section: u32) -> u32 {
    if top.to_bits() & TOP_SECTION == section { top.to_bits() } else { top.next_up().to_bits() }
}

/// The slot of no node.
const UNUSED: Node = Node {
    key: [NO_KEY; 2],
    top: 0,
    meta: 0,
    pyramid: [0; 2],
    base: 0,
    form: 0,
    beside: [NO_NODE; 4],
    floats: 0,
    corners: 0,
    joins: 0,
    pad: 0,
};

/// An index has at most 22 bits: cells count to 2²⁹, nodes are 2⁸ of them.
fn key(level: u32, index: [i32; 2]) -> [u32; 2] {
    [level << KEY_LEVEL_SHIFT | index[0] as u32 & KEY_INDEX_MASK, index[1] as u32]
}

/// A section that is to be named in a table.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// Where it is shown.
    pub key: SectionKey,
    /// Detail level of what is shown there: that of `key`, or of a coarser section that holds it.
    pub detail: u8,
    /// Its pyramid's place.
    pub pyramid: [u32; 2],
    /// Height of code 0.
    pub base: Height,
    /// How what is derived lies (see [`crate::section::Derived::form`]).
    pub form: u32,
    /// Where something of it may float: log2 lattice steps that the words of its blocks count by.
    pub floats: Option<u32>,
    /// First word of its corners, where its tops are a smooth surface.
    pub corners: Option<u32>,
    /// Words from a span to what it is joined with, where its tops are a smooth surface.
    pub joins: Option<u32>,
    /// Nothing that it shows is higher.
    pub top: Height,
}

/// A finished table.
#[derive(Debug, PartialEq)]
pub struct Table {
    /// A power of two of slots.
    pub slots: Vec<Node>,
    /// Something may float.
    pub floats: bool,
    /// Tops are a smooth surface somewhere.
    pub smooth: bool,
    /// log2 cells of the coarsest nodes' side.
    pub top_level: u32,
    /// log2 cells of the largest section's side.
    pub section_level: u32,
    /// Cells covered: lower corner.
    pub low: [i32; 2],
    /// Upper corner, exclusive.
    pub high: [i32; 2],
}

/// Lattice steps above `anchor` as the f32 at or just above.
pub fn steps_above(height: Height, anchor: Height) -> f32 {
    let steps = i64::from(height.0) - i64::from(anchor.0);
    let rounded = steps as f32;
    if (rounded as i64) < steps { rounded.next_up() } else { rounded }
}

fn hash(level: u32, index: [i32; 2]) -> u32 {
    let h = (index[0] as u32).wrapping_mul(HASH_EAST)
        ^ (index[1] as u32).wrapping_mul(HASH_NORTH)
        ^ level.wrapping_mul(HASH_LEVEL);
    let h = (h ^ h >> HASH_SHIFT).wrapping_mul(HASH_MIX);
    h ^ h >> HASH_LAST_SHIFT
}

impl Default for Table {
    /// It names nothing.
    fn default() -> Table {
        Table::build(&[], Height(0))
    }
}

impl Table {
    /// Names `entries`; no two may overlap. Heights count from `anchor`. O(entries · levels).
    pub fn build(entries: &[Entry], anchor: Height) -> Table {
        let node_of = |e: &Entry| (SECTION_LOG2 + u32::from(e.key.level), [e.key.i, e.key.j]);
        // The coarsest level at which at most 2×2 nodes cover everything: higher ones would only be walked through.
        let section_level = entries.iter().map(|e| node_of(e).0).max().unwrap_or(SECTION_LOG2);
        let mut top_level = section_level;
        let (low, high) = loop {
            let (mut low, mut high) = ([i32::MAX; 2], [i32::MIN; 2]);
            for e in entries {
                let (level, index) = node_of(e);
                for axis in 0..2 {
                    let at = index[axis] >> (top_level - level);
                    low[axis] = low[axis].min(at);
                    high[axis] = high[axis].max(at);
                }
            }
            if entries.is_empty() {
                break ([0; 2], [-1; 2]);
            }
            if (0..2).all(|a| i64::from(high[a]) - i64::from(low[a]) <= 1) {
                break (low, high);
            }
            top_level += 1;
        };

        let mut nodes = HashMap::<(u32, [i32; 2]), Node>::new();
        for e in entries {
            let (level, index) = node_of(e);
            let top = steps_above(e.top, anchor);
            let node = Node {
                key: key(level, index),
                meta: level | u32::from(e.detail) << META_DETAIL_SHIFT,
                top: marked(top, TOP_SECTION),
                pyramid: e.pyramid,
                base: e.base.0.wrapping_sub(anchor.0),
                form: e.form,
                floats: e.floats.map_or(0, |step_log2| 1 + step_log2),
                corners: e.corners.unwrap_or(0),
                joins: e.joins.unwrap_or(0),
                ..UNUSED
            };
            let other = nodes.insert((level, index), node);
            assert!(other.is_none(), "{:?} is named twice, or lies over a finer section", e.key);
            for above in level + 1..=top_level {
                let index = [index[0] >> (above - level), index[1] >> (above - level)];
                let node = nodes.entry((above, index)).or_insert(Node {
                    key: key(above, index),
                    meta: above,
                    top: marked(top, 0),
                    ..UNUSED
                });
                assert!(node.top & TOP_SECTION == 0, "{:?} lies under a coarser section", e.key);
                node.top = marked(f32::from_bits(node.top).max(top), 0);
            }
        }

        // At most half full; the shader's probe ends at the first unused slot.
        let size = (nodes.len() * 2).next_power_of_two().max(2);
        let mut slots = vec![UNUSED; size];
        // In key order, so that the same entries always give the same bytes.
        let mut nodes: Vec<_> = nodes.into_iter().collect();
        nodes.sort_unstable_by_key(|(key, _)| *key);
        let mut slot_of = HashMap::with_capacity(entries.len());
        for ((level, index), node) in nodes {
            let mut slot = hash(level, index) as usize & (size - 1);
            while slots[slot] != UNUSED {
                slot = (slot + 1) & (size - 1);
            }
            slots[slot] = node;
            if node.top & TOP_SECTION != 0 {
                slot_of.insert((level, index), slot);
            }
        }
        for (&(level, [i, j]), &slot) in &slot_of {
            let beside = [[i + 1, j], [i - 1, j], [i, j + 1], [i, j - 1]].map(|at| {
                let as_fine = |&&s: &&usize| slots[s].meta == slots[slot].meta;
                slot_of.get(&(level, at)).filter(as_fine).map_or(NO_NODE, |&s| s as u32)
            });
            slots[slot].beside = beside;
        }
        Table {
            slots,
            floats: entries.iter().any(|e| e.floats.is_some()),
            smooth: entries.iter().any(|e| e.corners.is_some()),
            top_level,
            section_level,
            low: low.map(|i| i << top_level),
            high: high.map(|i| ((i64::from(i) + 1) << top_level) as i32),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::layout::{assert_in, members};
    use crate::resident::readers::readers_of_tables;
    use crate::shared::payload::{FORM_FLOATS, FORM_WIDE};

    #[test]
    fn shaders_see_nodes_as_they_are_written() {
        assert_in(
            &readers_of_tables(),
            &members!(Node { key, top, meta, pyramid, base, form, beside, floats, corners, joins, pad }),
        );
        // Where they are texels, `node_word` counts words.
        let words = [
            std::mem::offset_of!(Node, key),
            std::mem::offset_of!(Node, top),
            std::mem::offset_of!(Node, meta),
            std::mem::offset_of!(Node, pyramid),
            std::mem::offset_of!(Node, base),
            std::mem::offset_of!(Node, form),
            std::mem::offset_of!(Node, beside),
            size_of::<Node>(),
        ];
        assert_eq!(words, [0, 2, 3, 4, 6, 7, 8, 16].map(|word| 4 * word));
    }

    fn entry(i: i32, j: i32, top: i32) -> Entry {
        Entry {
            key: SectionKey { level: 0, i, j },
            detail: 0,
            base: Height(0),
            form: 0,
            pyramid: [i as u32, j as u32 & 0xFFFF],
            top: Height(top),
            floats: None,
            corners: None,
            joins: None,
        }
    }

    fn find(table: &Table, level: u32, index: [i32; 2]) -> Option<Node> {
        let mask = table.slots.len() - 1;
        let mut slot = hash(level, index) as usize & mask;
        loop {
            let node = table.slots[slot];
            if node == UNUSED {
                return None;
            }
            if node.key == key(level, index) {
                return Some(node);
            }
            slot = (slot + 1) & mask;
        }
    }

    #[test]
    fn every_section_and_ancestor_is_found() {
        let entries: Vec<_> =
            (0..40).flat_map(|i| (0..30).map(move |j| entry(i - 7, j - 9, i * 100 + j))).collect();
        let table = Table::build(&entries, Height(50));
        for e in &entries {
            let node = find(&table, 8, [e.key.i, e.key.j]).unwrap();
            assert_eq!((node.pyramid, node.top & TOP_SECTION), (e.pyramid, TOP_SECTION));
            for level in 9..=table.top_level {
                let above = find(&table, level, [e.key.i >> (level - 8), e.key.j >> (level - 8)]).unwrap();
                assert!(f32::from_bits(above.top) >= (e.top.0 - 50) as f32 && above.top & TOP_SECTION == 0);
            }
            for axis in 0..2 {
                let cell = [e.key.i, e.key.j][axis] * 256;
                assert!(table.low[axis] <= cell && cell + 256 <= table.high[axis]);
            }
        }
        assert!(find(&table, 8, [33, 0]).is_none());
        // 40 sections reach over at most two nodes of 32.
        assert!(table.top_level <= 14, "{}", table.top_level);
    }

    #[test]
    fn places_keep_all_their_bits() {
        for (k, address) in
            [0xffff_8000_0000_1000u64, u64::MAX, 1 << 63, 0x7fff_0000_0000].into_iter().enumerate()
        {
            for form in [0, FORM_WIDE, FORM_FLOATS] {
                let pyramid = [address as u32, (address >> 32) as u32];
                let entry = Entry { pyramid, base: Height(7), form, ..entry(k as i32, 0, 9) };
                let node = find(&Table::build(&[entry], Height(0)), 8, [k as i32, 0]).unwrap();
                assert_eq!((node.pyramid, node.form, node.base), (pyramid, form, 7), "{address:x}");
            }
        }
    }

    #[test]
    fn one_stray_section_costs_a_few_slots() {
        let mut entries: Vec<_> = (0..16).map(|i| entry(i % 4, i / 4, 0)).collect();
        entries.push(entry(1 << 20, -(1 << 20), 9));
        let table = Table::build(&entries, Height(0));
        assert!(table.slots.len() <= 256);
        assert!(find(&table, table.top_level, [0, 0]).is_some());
    }

    #[test]
    fn tops_round_up() {
        assert_eq!(steps_above(Height(1 << 30), Height(1)), (1 << 30) as f32);
        assert!(steps_above(Height(16_777_217), Height(0)) >= 16_777_217.0);
        assert!(Table::build(&[], Height(0)).slots.iter().all(|n| *n == UNUSED));
    }
}
