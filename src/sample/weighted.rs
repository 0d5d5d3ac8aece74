//! The points of the sample, each with how many it stands for, where they are in the world.

use super::absence;
use super::facts::header_bounds;
use super::frame;
use super::open::Opened;
use super::places::Place;
use super::seen::{Seen, unpack};
use super::shape;
use crate::coords::Bounds;
use crate::source::placement::World;
use glam::DVec3;

/// Runs of points at places, and how many points spread over the set each of the places is worth.
pub(super) type Part<'a> = (&'a Vec<Place>, &'a Vec<Vec<Seen>>, f64);

/// The points of each file, with their weights.
pub(super) struct Weighted<'a> {
    files: &'a [Opened],
    world: &'a World,
    /// Every point of every file is there.
    whole: bool,
    /// A file.
    pub points: Vec<Vec<(&'a Seen, f64)>>,
}

impl<'a> Weighted<'a> {
    /// All samples together stand for the whole. Neighbours are alike, so a place, or the head of a chunk, tells as much as a
    /// few points that are spread out, the first of chunks.
    pub fn new(
        files: &'a [Opened],
        world: &'a World,
        whole: bool,
        firsts: &'a [Vec<Seen>],
        parts: [Part<'a>; 2],
    ) -> Weighted<'a> {
        let drawn: Vec<usize> = (0..files.len()).filter(|&file| world.placements[file].is_some()).collect();
        let all: u64 = drawn.iter().map(|&file| files[file].file.points()).sum();
        let spread_out = drawn.iter().map(|&file| firsts[file].len()).sum::<usize>() as f64;
        let worth = parts.map(|(places, _, worth)| worth * places.len() as f64);
        let worth_of_all = (spread_out + worth.iter().sum::<f64>()).max(1.0);
        let share = |worth: f64| all as f64 * worth / worth_of_all;
        let mut points: Vec<Vec<(&Seen, f64)>> = vec![Vec::new(); files.len()];
        for &file in &drawn {
            let part = files[file].file.points() as f64 / all.max(1) as f64;
            let weight = share(spread_out) * part / firsts[file].len().max(1) as f64;
            points[file].extend(firsts[file].iter().map(|seen| (seen, weight)));
        }
        for ((places, seen, _), worth) in parts.into_iter().zip(worth) {
            let weight = share(worth) / seen.iter().map(Vec::len).sum::<usize>().max(1) as f64;
            for (place, seen) in places.iter().zip(seen) {
                points[place.file].extend(seen.iter().map(|seen| (seen, weight)));
            }
        }
        Weighted { files, world, whole, points }
    }

    /// Where a point of a file that is drawn lies in the world.
    pub fn place(&self, file: usize, seen: &Seen) -> DVec3 {
        let point = unpack(&self.files[file].file, seen.raw);
        let placement = self.world.placements[file].as_ref().expect("only files that are drawn are sampled");
        placement.place(point.x, point.y, point.z)
    }

    /// Those of a file that are to be shown, with their weights.
    pub fn placed(&self, file: usize, shown: impl Fn(&Seen) -> bool) -> impl Iterator<Item = (DVec3, f64)> {
        let points = self.points[file].iter().filter(move |(seen, _)| shown(seen));
        let placed = points.map(move |(seen, weight)| (self.place(file, seen), *weight));
        placed.filter(|(point, _)| point.is_finite())
    }

    /// Those of a file that are shown, and of the `others` those where more of such may lie than the sample has.
    pub fn may_hold(
        &self,
        file: usize,
        bounds: &Bounds,
        others: impl Fn(&Seen) -> bool,
        shown: impl Fn(&Seen) -> bool,
    ) -> Vec<DVec3> {
        let seen = self.points[file].iter().filter(|(seen, _)| others(seen) || shown(seen));
        let points: Vec<(DVec3, bool)> = seen
            .map(|(seen, _)| (self.place(file, seen), shown(seen)))
            .filter(|(p, _)| p.is_finite())
            .collect();
        let framed = absence::may_hold(bounds, &points);
        points
            .into_iter()
            .zip(framed)
            .filter(|(_, is_framed)| *is_framed)
            .map(|((point, _), _)| point)
            .collect()
    }

    /// How well a file was seen.
    pub fn seen(&self, file: usize) -> shape::Seen {
        match self.files[file].file.chunks.len() {
            _ if self.whole => shape::Seen::Whole,
            frame::ENOUGH.. => shape::Seen::AllOver,
            _ => shape::Seen::InParts,
        }
    }

    /// Where the points of a file are that are shown by default, strays aside.
    pub fn framed(&self, file: usize, shown: impl Fn(&Seen) -> bool) -> Option<frame::Framed> {
        let placement = self.world.placements[file].as_ref()?;
        let placed: Vec<(DVec3, f64)> = self.placed(file, shown).collect();
        let of = &self.files[file].file;
        // Points that are all known need no header; a header that leaves out the few that are known is wrong. Of a file
        // of another system the box is wider than what is in it; nothing may lie outside, since nothing is drawn there.
        let is_needed = !(self.whole && placed.len() < frame::ENOUGH);
        let header = header_bounds(of, placement, DVec3::ZERO)
            .filter(|bounds| is_needed && frame::holds_some(*bounds, &placed));
        let beyond = match self.seen(file) {
            shape::Seen::InParts => frame::SEEN_IN_PARTS,
            shape::Seen::Whole | shape::Seen::AllOver => frame::WELL_SEEN,
        };
        (of.points() > 0).then(|| frame::Framed::of(header, &placed, beyond))
    }

    /// A box that no point of a file lies outside of, as far as its header and the sample say; `None` where they do not.
    pub fn reach(&self, file: usize) -> Option<Bounds> {
        let (of, placement) = (&self.files[file].file, self.world.placements[file].as_ref()?);
        // Headers round; a step more holds what they mean, however small cells are.
        let header = header_bounds(of, placement, of.header.scale.abs())?;
        let inside = |(seen, _): &(&Seen, f64)| {
            let point = self.place(file, seen);
            point.cmpge(header.min).all() && point.cmple(header.max).all()
        };
        self.points[file].iter().all(inside).then_some(header)
    }
}
