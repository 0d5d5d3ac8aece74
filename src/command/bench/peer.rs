//! Intel Embree on the same cells and rays.

use super::harness::Harness;
use crate::bench;
use crate::render::frame::check_size;

/// Pixels that a peer traces.
const PEER_SIZE: [u32; 2] = [1920, 1080];

impl Harness<'_> {
    /// Embree.
    pub(super) fn peer(&mut self) -> anyhow::Result<()> {
        let args = self.args;
        let (world, _) = self.world(args.cell, args.cell)?;
        let size = args.size.unwrap_or(PEER_SIZE);
        check_size(self.gpu, size)?;
        let mut say = |what: &str| self.say(format_args!("{what}"));
        self.report.peer = bench::peer::run(self.gpu, &world, size, &mut say)?;
        Ok(())
    }
}
