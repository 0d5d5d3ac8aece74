//! Where a set is read: everywhere, or at a few places.

use super::budget::SampleBudget;
use super::open::Opened;
use crate::source::{Chunk, Copc, LidarFile, VoxelKey};
use std::collections::HashMap;

/// A place of a file that is read: which records, and the window that counts, if not everything does.
#[derive(Clone, Debug)]
pub(super) struct Place {
    pub file: usize,
    /// Chunk index and records of it from its start.
    pub chunks: Vec<(usize, u64)>,
    /// West, south, east, north in file coordinates: all that lies in it is in `chunks`.
    pub window: Option<[f64; 4]>,
}

/// The places of a set that is read whole: its files.
pub(super) fn every_place(files: &[Opened], drawn: &[usize]) -> Vec<Place> {
    let all = |file: usize| files[file].file.chunks.iter().map(|chunk| (chunk.index as usize, chunk.records));
    let place = |file| Place { file, chunks: all(file).collect(), window: None };
    drawn.iter().copied().map(place).collect()
}

/// `budget.places` places at even distances in the order of points.
pub(super) fn chosen_places(
    files: &[Opened],
    drawn: &[usize],
    points: u64,
    budget: &SampleBudget,
) -> Vec<Place> {
    let mut places: Vec<Place> = Vec::new();
    for (index, at) in even_chunks(files, drawn, points, budget.places) {
        let file = &files[index].file;
        let place = match &file.copc {
            Some(copc) => window_at(index, file, copc, at, budget),
            None => run_at(index, &file.chunks, at, budget.place_points),
        };
        // Large chunks, or windows that grew, may come up twice.
        if !places.iter().any(|known| known.file == place.file && known.chunks == place.chunks) {
            places.push(place);
        }
    }
    places
}

/// The heads of `budget.heads` chunks at even distances in the order of points.
pub(super) fn heads(files: &[Opened], drawn: &[usize], points: u64, budget: &SampleBudget) -> Vec<Place> {
    let mut chunks = even_chunks(files, drawn, points, budget.heads);
    chunks.dedup();
    let head = |(file, chunk)| Place { file, chunks: vec![(chunk, HEAD_POINTS)], window: None };
    chunks.into_iter().map(head).collect()
}

/// Points of a chunk's head.
const HEAD_POINTS: u64 = 1024;

/// `count` chunks (file, index) at even distances in the order of points.
fn even_chunks(files: &[Opened], drawn: &[usize], points: u64, count: u64) -> Vec<(usize, usize)> {
    let mut chunks = Vec::new();
    let (mut before, mut next) = (0, 0);
    for &index in drawn {
        let file = &files[index].file;
        while next < count {
            let wanted = (u128::from(points) * u128::from(2 * next + 1) / u128::from(2 * count)) as u64;
            let Some(record) = wanted.checked_sub(before).filter(|&record| record < file.points()) else {
                break;
            };
            chunks.push((index, file.chunks.partition_point(|chunk| chunk.first_record <= record) - 1));
            next += 1;
        }
        before += file.points();
    }
    chunks
}

/// Neighbouring chunks from `at` on, until there are enough points to have an inside.
fn run_at(file: usize, chunks: &[Chunk], at: usize, wanted: u64) -> Place {
    let (mut run, mut points) = (Vec::new(), 0);
    for (index, chunk) in chunks.iter().enumerate().skip(at) {
        let records = chunk.records.min(wanted - points);
        run.push((index, records));
        points += records;
        if points >= wanted / 2 {
            break;
        }
    }
    Place { file, chunks: run, window: None }
}

/// All nodes over one small window: a node holds one level of its region, so the node `at` is followed
/// down to a leaf, and the window is widened to the leaf's ancestors until it holds enough points.
fn window_at(file: usize, lidar: &LidarFile, copc: &Copc, at: usize, budget: &SampleBudget) -> Place {
    let records: HashMap<VoxelKey, usize> =
        copc.nodes.iter().enumerate().map(|(index, &key)| (key, index)).collect();
    let count = |key: &VoxelKey| records.get(key).map_or(0, |&index| lidar.chunks[index].records);
    let mut key = copc.nodes[at];
    loop {
        let child = |corner: i32| VoxelKey {
            level: key.level + 1,
            x: key.x * 2 + (corner & 1),
            y: key.y * 2 + (corner >> 1 & 1),
            z: key.z * 2 + (corner >> 2),
        };
        if key.level >= 29 {
            break;
        }
        match (0..8)
            .map(child)
            .filter(|child| records.contains_key(child))
            .max_by_key(|child| (count(child), -child.z))
        {
            Some(child) => key = child,
            None => break,
        }
    }
    let mut best = None;
    loop {
        // The whole column over the node's square, whatever its height.
        let over = |node: &VoxelKey| {
            let shift = i32::from(node.level) - i32::from(key.level);
            if shift >= 0 {
                (node.x >> shift, node.y >> shift) == (key.x, key.y)
            } else {
                (node.x, node.y) == (key.x >> -shift, key.y >> -shift)
            }
        };
        let chunks: Vec<(usize, u64)> = copc
            .nodes
            .iter()
            .enumerate()
            .filter(|(_, node)| over(node))
            // A node of millions of points is no COPC to speak of: part of it has to do.
            .map(|(index, _)| (index, lidar.chunks[index].records.min(budget.window_points)))
            .collect();
        // Of a coarser node one part in four a level lies in the window.
        let cost: u64 = chunks.iter().map(|(_, records)| records).sum();
        let inside: u64 = chunks
            .iter()
            .map(|&(index, records)| {
                records >> (2 * key.level.saturating_sub(copc.nodes[index].level)).min(63)
            })
            .sum();
        if best.is_some() && cost > budget.window_points {
            break;
        }
        let [min, max] = copc.bounds(key);
        best = Some(Place { file, chunks, window: Some([min.x, min.y, max.x, max.y]) });
        if inside >= budget.place_points / 2 || key.level == 0 {
            break;
        }
        key = VoxelKey { level: key.level - 1, x: key.x >> 1, y: key.y >> 1, z: key.z >> 1 };
    }
    best.expect("the first window is always taken")
}
