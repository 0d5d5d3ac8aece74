//! What a file says of itself, beside its first points: what its placement is decided by, and whether its points lie
//! where its header and its hierarchy have them.

use super::centre;
use super::open::Opened;
use super::quantile::quantile;
use super::seen::{Seen, unpack};
use crate::coords::Bounds;
use crate::source::LidarFile;
use crate::source::placement::{FileFacts, Placement};
use glam::DVec3;

/// Whether the first points of chunks, at an even stride, lie in the nodes that the chunks are.
pub(super) fn in_nodes(file: &LidarFile, firsts: &[Seen]) -> bool {
    let stride = file.chunks.len().div_ceil(firsts.len().max(1)).max(1);
    !firsts.is_empty()
        && file.chunks.iter().step_by(stride).zip(firsts).all(|(chunk, seen)| {
            let Some([low, high]) = file.chunk_bounds(chunk) else { return false };
            let (point, scale) = (unpack(file, seen.raw), file.header.scale.abs());
            point.cmpge(low - scale).all() && point.cmple(high + scale).all()
        })
}

pub(super) fn facts<'a>(files: &'a [Opened], firsts: &[Vec<Seen>]) -> Vec<FileFacts<'a>> {
    let centres = centre::of_files(files, firsts);
    let facts = |((Opened { file, crs, .. }, seen), centre): ((&'a Opened, &Vec<Seen>), DVec3)| FileFacts {
        path: file.path(),
        crs: crs.as_ref(),
        points: file.points(),
        centre,
        extent: extent(file, seen),
        step: file.header.scale.truncate().max_element(),
    };
    files.iter().zip(firsts).zip(centres).map(facts).collect()
}

/// First points from which on their spread tells how wide a file is; with fewer its header does.
const TELLING: usize = 50;

/// How far a file's points spread, file coordinates: strays aside, as far as the first points show.
fn extent(file: &LidarFile, firsts: &[Seen]) -> DVec3 {
    if firsts.len() < TELLING {
        let of_header = file.header.max - file.header.min;
        return if of_header.is_finite() { of_header.max(DVec3::ZERO) } else { DVec3::ZERO };
    }
    let points: Vec<DVec3> = firsts.iter().map(|seen| unpack(file, seen.raw)).collect();
    let spread = |axis: usize| {
        let mut values: Vec<(f64, f64)> = points.iter().map(|point| (point[axis], 1.0)).collect();
        let mut at = |share| quantile(&mut values, share).unwrap_or(0.0);
        at(0.95) - at(0.05)
    };
    DVec3::new(spread(0), spread(1), spread(2))
}

/// Header bounds in the world, where points of the file can lie at them, wider by `slack` file units on each side.
pub(super) fn header_bounds(file: &LidarFile, placement: &Placement, slack: DVec3) -> Option<Bounds> {
    let (min, max) = (file.header.min, file.header.max);
    // Raw coordinates are i32; half a step is what rounding takes.
    let stored = |corner: DVec3| {
        ((corner - file.header.offset) / file.header.scale).abs().max_element() < 2_147_483_648.5
    };
    if !placement.keeps_axes() || !stored(min) || !stored(max) || !min.cmple(max).all() {
        return None;
    }
    let [min, max] = placement.bounds(min - slack, max + slack)?;
    Bounds::new(min, max)
}
