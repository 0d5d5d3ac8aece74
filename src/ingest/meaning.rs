//! What decoded numbers mean: places in the world, and colours.

use crate::source::PointBlock;

/// What a file's points mean: set once a file.
pub trait Meaning {
    /// World coordinates of point `i` of `block`, CRS units.
    fn world(&self, block: &PointBlock, i: usize) -> glam::DVec3;
    /// Its colour in 8 bits.
    fn rgb(&self, block: &PointBlock, i: usize) -> [u8; 3];
    /// [`Meaning::world`] of the points from `first` on, axis by axis.
    fn world_of_many(&self, block: &PointBlock, first: usize, [e, n, u]: [&mut [f64]; 3]) {
        for (k, ((e, n), u)) in e.iter_mut().zip(n).zip(u).enumerate() {
            (*e, *n, *u) = self.world(block, first + k).into();
        }
    }
}
