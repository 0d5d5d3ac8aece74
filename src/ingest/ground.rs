//! Points of files to tiles of the ground.

use super::input::Input;
use super::meaning::Meaning;
use super::workers::Sink;
use crate::ground::{Gatherer, LowTiles};
use crate::source::{Fields, PointBlock};

impl Sink for LowTiles {
    type Own = Gatherer;
    fn fields(&self) -> Fields {
        Fields::default()
    }
    fn take(&self, own: &mut Gatherer, _: usize, input: &Input, block: &PointBlock) {
        self.add(own, block, |first, axes| input.world_of_many(block, first, axes));
    }
}
