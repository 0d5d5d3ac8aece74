//! The octree of a COPC file (COPC 1.0): info record, hierarchy pages.

use super::{Chunk, FileBytes, FileHeader, SourceError, VlrEntry, chunks::RECORDS_PER_BYTE};
use glam::DVec3;
use std::collections::HashSet;

/// Bytes in a hierarchy entry: key, offset, size, count.
const ENTRY: u64 = 32;
/// Most entries that are read at a time.
const PAGE_PIECE: u64 = 64 << 10;
/// Deepest level: x, y, z are i32.
const MAX_LEVEL: i32 = 30;

/// A node of the octree: cube (x, y, z) of the 2^level on a side.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct VoxelKey {
    /// 0 is the whole cube.
    pub level: u8,
    /// Eastward index, below 2^level.
    pub x: i32,
    /// Northward index.
    pub y: i32,
    /// Upward index.
    pub z: i32,
}

/// The octree of a COPC file: a node for each chunk.
#[derive(Clone, Debug)]
pub struct Copc {
    /// Centre of the root cube, CRS units (checked: finite).
    pub center: DVec3,
    /// Half a side of the root cube, CRS units (checked: finite, positive).
    pub halfsize: f64,
    /// Space between points at the root, CRS units; halved at each level. As stored.
    pub spacing: f64,
    /// The node of each chunk, by [`Chunk::index`].
    pub nodes: Vec<VoxelKey>,
}

impl Copc {
    /// Lower and upper bounds of a node's cube, CRS units.
    pub fn bounds(&self, key: VoxelKey) -> [DVec3; 2] {
        let side = 2.0 * self.halfsize / f64::from(key.level).exp2();
        let min = self.center - self.halfsize + DVec3::new(key.x.into(), key.y.into(), key.z.into()) * side;
        [min, min + side]
    }
}

/// Why a hierarchy is of no use.
pub(super) enum Broken {
    /// The file itself cannot be read.
    Source(SourceError),
    /// It says something that cannot be.
    Hierarchy {
        /// Where.
        offset: u64,
        /// What.
        reason: String,
    },
}

impl From<SourceError> for Broken {
    fn from(error: SourceError) -> Broken {
        Broken::Source(error)
    }
}

/// A node with points, as read.
struct Node {
    key: VoxelKey,
    offset: u64,
    len: u64,
    records: u64,
}

/// Walks the hierarchy that the info record `info` names; every page and node is checked against the file.
/// Chunks come in file order, so that record indices are those of the LAZ file.
pub(super) fn read(
    bytes: &FileBytes,
    header: &FileHeader,
    info: &VlrEntry,
) -> Result<(Copc, Vec<Chunk>), Broken> {
    let broken = |offset, reason: String| Err(Broken::Hierarchy { offset, reason });
    if info.len < 160 {
        return broken(info.offset, format!("the info record has {} bytes instead of 160", info.len));
    }
    let mut raw = [0; 160];
    bytes.read_exact_at(&mut raw, info.offset)?;
    let float = |i: usize| f64::from_le_bytes(raw[8 * i..8 * i + 8].try_into().unwrap());
    let mut copc = Copc {
        center: DVec3::new(float(0), float(1), float(2)),
        halfsize: float(3),
        spacing: float(4),
        nodes: Vec::new(),
    };
    if !(copc.center.is_finite() && copc.halfsize.is_finite() && copc.halfsize > 0.0) {
        let reason = format!("the root cube has centre {} and half size {}", copc.center, copc.halfsize);
        return broken(info.offset, reason);
    }
    let root = (float(5).to_bits(), float(6).to_bits());
    let mut nodes = read_pages(bytes, header, root)?;
    nodes.sort_unstable_by_key(|n| n.offset);
    let mut chunks = Vec::with_capacity(nodes.len());
    let (mut end, mut first_record) = (header.offset_to_points + 8, 0);
    for (index, node) in nodes.iter().enumerate() {
        let Node { key, offset, len, records } = *node;
        if offset < end {
            return broken(offset, format!("node {key:?} overlaps with what ends at byte {end}"));
        }
        end = offset + len;
        chunks.push(Chunk { index: index as u64, byte_offset: offset, byte_len: len, first_record, records });
        copc.nodes.push(key);
        first_record += records;
    }
    if first_record != header.claimed_points {
        let reason = format!("it has {first_record} points, the header says {}", header.claimed_points);
        return broken(root.0, reason);
    }
    Ok((copc, chunks))
}

fn read_pages(bytes: &FileBytes, header: &FileHeader, root: (u64, u64)) -> Result<Vec<Node>, Broken> {
    let broken = |offset, reason: String| Err(Broken::Hierarchy { offset, reason });
    let file = bytes.handle()?;
    let mut pages = vec![root];
    let mut seen_pages = HashSet::from([root.0]);
    let mut seen_keys = HashSet::new();
    let mut nodes = Vec::new();
    let mut entries_left = bytes.len() / ENTRY;
    let mut piece = Vec::new();
    while let Some((page, len)) = pages.pop() {
        if len == 0 || len % ENTRY != 0 || page.checked_add(len).is_none_or(|e| e > bytes.len()) {
            return broken(page, format!("a page of {len} bytes does not fit into the file"));
        }
        // Pages that overlap could make a small file walk for very long.
        let Some(left) = entries_left.checked_sub(len / ENTRY) else {
            return broken(page, "more entries than the file can hold".into());
        };
        entries_left = left;
        let mut done = 0;
        while done < len {
            piece.resize(PAGE_PIECE.min(len - done) as usize, 0);
            file.read_exact_at(&mut piece, page + done)?;
            for (i, entry) in piece.chunks_exact(ENTRY as usize).enumerate() {
                let at = page + done + i as u64 * ENTRY;
                let int = |k: usize| i32::from_le_bytes(entry[k..k + 4].try_into().unwrap());
                let (level, x, y, z, len, records) = (int(0), int(4), int(8), int(12), int(24), int(28));
                let offset = u64::from_le_bytes(entry[16..24].try_into().unwrap());
                if !(0..=MAX_LEVEL).contains(&level) || [x, y, z].iter().any(|&i| i < 0 || i >> level != 0) {
                    return broken(at, format!("there is no node {level}-{x}-{y}-{z}"));
                }
                let key = VoxelKey { level: level as u8, x, y, z };
                match (records, u64::try_from(len)) {
                    (0, _) => {}
                    (-1, Ok(len)) => {
                        if !seen_pages.insert(offset) {
                            return broken(at, format!("the page at byte {offset} is named twice"));
                        }
                        pages.push((offset, len));
                    }
                    (1.., Ok(len)) => {
                        let fits = offset.checked_add(len).is_some_and(|e| e <= bytes.len());
                        let most = len.saturating_mul(RECORDS_PER_BYTE);
                        if !fits || len < u64::from(header.record_len) || records as u64 > most {
                            let reason = format!(
                                "node {level}-{x}-{y}-{z} of {records} points has {len} bytes at byte {offset}"
                            );
                            return broken(at, reason);
                        }
                        if !seen_keys.insert(key) {
                            return broken(at, format!("node {level}-{x}-{y}-{z} occurs twice"));
                        }
                        nodes.push(Node { key, offset, len, records: records as u64 });
                    }
                    _ => {
                        let reason = format!("node {level}-{x}-{y}-{z} has {records} points in {len} bytes");
                        return broken(at, reason);
                    }
                }
            }
            done += piece.len() as u64;
        }
    }
    Ok(nodes)
}
