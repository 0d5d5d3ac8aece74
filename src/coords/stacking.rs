//! How points of a column become spans that may float: thickness, slices, and the low points of runs.

use super::heights::Height;
use crate::shared::payload::MOST_WORD_STEP;

/// Largest thickness, and log2 of the largest slice: beyond it all heights lie in four slices.
const MOST_LOG2: u32 = 30;

/// log2 of the steps that a low may count.
const LOW_BITS: u32 = crate::shared::payload::LOW_BITS;

/// What the columns of a level are stacked by; lattice steps. See [`super::Grid::stacking`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stacking {
    /// Every point of a span that floats reaches so far down.
    pub thickness: i32,
    /// log2 of the height of slices: of a column's points of a kind in a slice, the highest and the lowest are kept. Spans
    /// whose ends are farther apart than a slice is high are two.
    pub slice_log2: u32,
    /// Columns around one, each way, whose lower points let what is not classified float there, if there are more such columns than this: two of the
    /// finest level, and so many as those are on coarser ones, so that a roof stands on all of them.
    pub reach: u32,
}

impl Stacking {
    /// Of cells of so many steps, before they were made coarser by `doublings`.
    pub(super) fn new(cell_steps: f64, doublings: u32) -> Stacking {
        let fits = |log2: &u32| f64::from(*log2).exp2() >= 2.0 * cell_steps;
        // The slices of a coarser level are whole ones of a finer level, whatever is rounded.
        let finest = (0..MOST_LOG2).find(fits).unwrap_or(MOST_LOG2);
        let slice_log2 = finest.saturating_add(doublings).min(MOST_LOG2);
        let thickness = (cell_steps * f64::from(doublings).exp2()).ceil();
        Stacking {
            thickness: thickness.clamp(1.0, f64::from(1 << MOST_LOG2)) as i32,
            slice_log2,
            reach: Self::REACH,
        }
    }

    /// [`Self::reach`] on the finest level.
    pub const REACH: u32 = 2;

    /// Steps between the ends of two spans at most, or they are one: the height of a slice.
    pub const fn gap(self) -> i32 {
        1 << self.slice_log2
    }

    /// log2 of the slices of cells twice as wide.
    pub(crate) fn coarser_log2(self) -> u32 {
        (self.slice_log2 + 1).min(MOST_LOG2)
    }

    /// log2 of the steps that a low counts by.
    pub const fn low_step_log2(self) -> u32 {
        self.slice_log2.saturating_sub(LOW_BITS)
    }

    /// The lowest height of the slice of a height.
    pub const fn slice_bottom(self, height: Height) -> Height {
        Height(height.0 >> self.slice_log2 << self.slice_log2)
    }

    /// How far above the bottom of its slice a height lies, rounded down to what a low can tell.
    pub const fn low_of(self, height: Height) -> u16 {
        ((height.0 - self.slice_bottom(height).0) >> self.low_step_log2()) as u16
    }

    /// The height that `low` says, of a run in the slice of `height`.
    pub const fn low_height(self, height: Height, low: u16) -> Height {
        Height(self.slice_bottom(height).0 + ((low as i32) << self.low_step_log2()))
    }

    /// log2 of the steps that a depth counts by: 16 bits hold four slices and more.
    pub const fn depth_step_log2(self) -> u32 {
        self.slice_log2.saturating_sub(crate::shared::payload::DEPTH_SLICE_BITS)
    }

    /// log2 of the steps by which a node's word counts how far below the highest thing what is solid lies, and what floats begins.
    pub const fn word_step_log2(self) -> u32 {
        let step = self.slice_log2.saturating_sub(1);
        if step < MOST_WORD_STEP { step } else { MOST_WORD_STEP }
    }

    /// How far below its highest point a span that is to grow no more may reach, steps: from there on to the next point, a gap
    /// further at most, a depth can tell.
    pub const fn most_depth(self) -> i64 {
        ((u16::MAX as i64) << self.depth_step_log2()) - self.gap() as i64
    }

    /// How far below `top` a height lies, rounded up to what a depth can tell.
    pub fn depth_of(self, top: Height, lowest: i64) -> u16 {
        let steps = (i64::from(top.0) - lowest + (1 << self.depth_step_log2()) - 1) >> self.depth_step_log2();
        steps.try_into().expect("spans are no longer than depths can tell")
    }

    /// The height that a depth below `top` says, which may be lower than all heights.
    pub fn height_at_depth(self, top: Height, depth: u16) -> i64 {
        i64::from(top.0) - (i64::from(depth) << self.depth_step_log2())
    }

    /// Lower bound of the bottoms of spans whose points are at `lowest` and above.
    pub fn lowest_bottom(self, lowest: Height) -> Height {
        let step = self.low_step_log2();
        let rounded = (1 << self.depth_step_log2()) - 1;
        // No height is i32::MIN.
        let bottom = (lowest.0 >> step << step).saturating_sub(rounded).saturating_sub(self.thickness);
        Height(bottom.max(i32::MIN + 1))
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Grid, HEIGHT_STEP};
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn thickness_is_a_cell_and_slices_are_two_or_more() {
        let grid = |base_cell, coarsen| Grid { base_cell, coarsen, anchor: [0; 2], height_step: HEIGHT_STEP };
        for (cell, coarsen, level, thickness, slice_log2) in [
            (0.5, 0, 0, 512, 10),
            (0.5, 0, 3, 4096, 13),
            (0.5, 2, 1, 4096, 13),
            // 307.2 steps; twice that is rounded up to 1,024 once, and doubled.
            (0.3, 0, 0, 308, 10),
            (0.3, 1, 0, 615, 11),
            (0.3, 0, 2, 1229, 12),
            (HEIGHT_STEP, 0, 0, 1, 1),
            (HEIGHT_STEP / 8.0, 0, 0, 1, 0),
            // Cells higher than all heights.
            (1e15, 0, 0, 1 << 30, 30),
            (0.5, 0, 30, 1 << 30, 30),
        ] {
            let stacking = grid(cell, coarsen).stacking(level);
            let reach = [2, 1, 0].get(usize::from(level)).copied().unwrap_or(0);
            assert_eq!(stacking, Stacking { thickness, slice_log2, reach }, "{cell} {coarsen} {level}");
            assert_eq!(stacking.gap(), 1 << slice_log2);
        }
    }

    proptest! {
        #[test]
        fn lows_are_rounded_down_in_their_slice(
            h in prop_oneof![(i32::MIN + 1)..=i32::MAX, -5000..5000],
            other in any::<u16>(),
            slice_log2 in 0u32..=30,
        ) {
            let (fine, high) = (Stacking { thickness: 7, slice_log2, reach: 2 }, Height(h));
            let low = fine.low_height(high, fine.low_of(high));
            prop_assert!(low <= high && i64::from(h) - i64::from(low.0) < 1 << fine.low_step_log2());
            prop_assert!(low >= fine.slice_bottom(high));
            prop_assert_eq!(low.0 >> slice_log2, h >> slice_log2);
            prop_assert!(fine.lowest_bottom(high).0 <= low.0.saturating_sub(7).max(i32::MIN + 1));
            // Every low of a slice is a height of it.
            let any = (u32::from(other) >> 16u32.saturating_sub(slice_log2)) as u16;
            let said = fine.low_height(high, any);
            prop_assert_eq!(said.0 >> slice_log2, h >> slice_log2);
            prop_assert_eq!(fine.low_of(said), any);
            // Coarser slices: rounding twice is rounding once.
            let coarse = Stacking { thickness: 14, slice_log2: fine.coarser_log2(), reach: 1 };
            prop_assert_eq!(coarse.low_of(low), coarse.low_of(high));
        }
    }
}
