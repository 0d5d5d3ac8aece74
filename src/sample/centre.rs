//! Where the middle of a file lies, before anything is known of it: what coordinate systems are judged by.

use super::open::Opened;
use super::parallel::parallel;
use super::quantile::median;
use super::seen::{Seen, append, unpack};
use crate::source::crs::{Crs, CrsKind};
use crate::source::{LidarFile, Selection};
use glam::DVec3;

/// Files with fewer chunks are looked into: one wrong point among their first ones would count too much.
const FEW_CHUNKS: usize = 4;
/// Records from the start of each of their chunks.
const RECORDS: u64 = 256;

/// The middle of each file, file coordinates, each axis by itself: of the first points of its chunks, `firsts`, or of
/// the first records where those are few. Points at 0, 0, the mark of those without a position, count where there is
/// nothing else. NaN where there is no point.
pub(super) fn of_files(files: &[Opened], firsts: &[Vec<Seen>]) -> Vec<DVec3> {
    parallel(files.len(), |decoder, index| {
        let file = &files[index].file;
        // Of a projected system that is drawn as it is nothing is judged by the middle but which of several operations
        // leads to another, to hundreds of kilometres.
        let is_plain = |crs: &Crs| {
            crs.kind == CrsKind::Projected
                && crs.system.is_none_or(|system| system.ground_scale(0.0).is_none())
        };
        let is_sure = file.chunks.len() >= FEW_CHUNKS || files[index].crs.as_ref().is_some_and(is_plain);
        if firsts[index].is_empty() || is_sure {
            return middle(file, &firsts[index]);
        }
        let mut seen = Vec::new();
        for chunk in &file.chunks {
            // A broken chunk is reported when it is drawn; here it only tells less.
            let _ = decoder.decode(file, chunk, 0..RECORDS, &mut |block| {
                append(block, &Selection::default(), &mut seen)
            });
        }
        file.bytes.release();
        middle(file, if seen.is_empty() { &firsts[index] } else { &seen })
    })
}

fn middle(file: &LidarFile, seen: &[Seen]) -> DVec3 {
    let points = seen.iter().map(|seen| unpack(file, seen.raw));
    // What rounding leaves of 0.
    let step = file.header.scale.truncate().abs() * 0.5;
    let placed = |point: &DVec3| point.truncate().abs().cmpge(step).any();
    match points.clone().any(|point| placed(&point)) {
        true => median(points.filter(placed)),
        false => median(points),
    }
}
