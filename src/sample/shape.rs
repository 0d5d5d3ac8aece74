//! The shape of what is framed: a few of the sampled points.

use crate::coords::{Bounds, Hull};
use glam::DVec3;

/// Cells each way that a file's box is divided into; in each, the outermost points count.
const CELLS: usize = 32;
/// Of more files than this the boxes are shape enough.
const FEW_FILES: usize = 64;
/// How high the trees and masts are that a sample of parts has not seen, in lengths of the file.
const UNSEEN: f64 = 0.04;
/// Rounding decides nothing, so that a shape is the same wherever in its CRS the data lies: cells, and shares of the box.
const EQUAL: f64 = 1e-6;
/// Directions, and their opposites, in which a cell's outermost points are taken.
const WAYS: [DVec3; 5] =
    [DVec3::X, DVec3::Y, DVec3::Z, DVec3::new(1.0, 1.0, 0.0), DVec3::new(1.0, -1.0, 0.0)];

/// How well a file was seen.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Seen {
    /// Every point.
    Whole,
    /// Points all over it.
    AllOver,
    /// A few runs of neighbouring points.
    InParts,
}

/// The shape of a file that has `bounds`, one of `files`, from `points` in it, seen so well. Strays, outside of
/// the box, do not count.
pub(super) fn shape(bounds: &Bounds, points: impl Iterator<Item = DVec3>, files: usize, seen: Seen) -> Hull {
    if files > FEW_FILES {
        return Hull::from(bounds);
    }
    // So small beside the others that fewer will do.
    let side = (CELLS as f64 / (files as f64).sqrt()).ceil() as usize;
    let size = bounds.size();
    let least = EQUAL * size.max_element();
    // Farthest along each way, and against it.
    let mut cells: Vec<Option<[DVec3; 2 * WAYS.len()]>> = vec![None; side * side];
    for point in points {
        if !(point.cmpge(bounds.min).all() && point.cmple(bounds.max).all()) {
            continue;
        }
        let at = DVec3::select(size.cmpgt(DVec3::ZERO), (point - bounds.min) / size, DVec3::ZERO);
        let index = |v: f64| ((v * side as f64 + EQUAL) as usize).min(side - 1);
        match &mut cells[index(at.y) * side + index(at.x)] {
            none @ None => *none = Some([point; 2 * WAYS.len()]),
            Some(outermost) => {
                for (pair, way) in outermost.chunks_exact_mut(2).zip(WAYS) {
                    let along = (point - bounds.min).dot(way);
                    if along > (pair[0] - bounds.min).dot(way) + least {
                        pair[0] = point;
                    }
                    if along < (pair[1] - bounds.min).dot(way) - least {
                        pair[1] = point;
                    }
                }
            }
        }
    }
    let outermost: Vec<DVec3> = cells.into_iter().flatten().flatten().collect();
    match Hull::of(&outermost) {
        Some(hull) if seen == Seen::Whole => hull,
        Some(hull) => {
            let near = if seen == Seen::AllOver { 0.15 } else { 0.4 };
            let unseen = UNSEEN * bounds.size().truncate().max_element();
            hull.stretched(bounds).with_near_corners(bounds, near).lifted(unseen, bounds.max.z)
        }
        None => Hull::from(bounds),
    }
}
