//! From decoded points to those that take part, with what the channel of their records holds: see [`Reading`].

use super::meaning::Meaning;
use crate::attribute::Channel;
use crate::source::{PointBlock, Reading};

/// Picks points out of blocks; one a thread, its buffers are reused.
#[derive(Default)]
pub struct Selector {
    picked: PointBlock,
    kept: Vec<u32>,
    east: Vec<f64>,
    north: Vec<f64>,
    up: Vec<f64>,
}

/// Those of `values` that are `kept`.
fn pick<T: Copy>(kept: &[u32], values: &[T], to: &mut Vec<T>) {
    to.clear();
    // A column may be missing.
    if !values.is_empty() {
        to.extend(kept.iter().map(|&i| values[i as usize]));
    }
}

impl Selector {
    /// The points of `block` that take part as `reading` says, with their channel in the place of the intensity. O(points);
    /// nothing is done where all do, as they are.
    pub fn apply<'a>(
        &'a mut self,
        reading: &Reading,
        meaning: &impl Meaning,
        block: &'a PointBlock,
    ) -> &'a PointBlock {
        if reading.is_plain() {
            return block;
        }
        self.keep(reading, meaning, block);
        let (kept, to) = (&self.kept[..], &mut self.picked);
        to.first_record = block.first_record;
        for (from, to) in [(&block.x, &mut to.x), (&block.y, &mut to.y), (&block.z, &mut to.z)] {
            pick(kept, from, to);
        }
        for (from, to) in
            [(&block.class, &mut to.class), (&block.flags, &mut to.flags), (&block.returns, &mut to.returns)]
        {
            pick(kept, from, to);
        }
        pick(kept, &block.rgb, &mut to.rgb);
        // What else was decoded has done its part.
        to.intensity.clear();
        let kept = kept.iter().map(|&i| i as usize);
        match reading.channel {
            Channel::Intensity => to.intensity.extend(kept.map(|i| block.intensity[i])),
            // What follows from all points of a section comes when all are there.
            Channel::AboveGround(_) | Channel::Density(_) => to.intensity.extend(kept.map(|_| 0)),
            Channel::SourceId | Channel::LineDifference(_) => {
                to.intensity.extend(kept.map(|i| block.source_id.get(i).copied().unwrap_or(0)))
            }
            Channel::ScanAngle => to
                .intensity
                .extend(kept.map(|i| Channel::of_angle(block.scan_angle.get(i).copied().unwrap_or(0)))),
            channel @ Channel::GpsTime(_) => to
                .intensity
                .extend(kept.map(|i| channel.code(block.gps_time.get(i).copied().unwrap_or(f64::NAN)))),
        }
        to
    }

    /// Finds the points that take part.
    fn keep(&mut self, reading: &Reading, meaning: &impl Meaning, block: &PointBlock) {
        let selection = &reading.selection;
        self.kept.clear();
        self.kept.extend((0..block.len() as u32).filter(|&i| selection.holds(block, i as usize)));
        if selection.heights.is_all() {
            return;
        }
        for axis in [&mut self.east, &mut self.north, &mut self.up] {
            axis.resize(block.len(), 0.0);
        }
        meaning.world_of_many(block, 0, [&mut self.east, &mut self.north, &mut self.up]);
        self.kept.retain(|&i| selection.holds_height(self.up[i as usize]));
    }
}
