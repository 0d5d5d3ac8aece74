//! What the threads of a pass do, told by themselves: a renderer whose pass is logged reads their logs back.

use super::bands::{Band, band_rows, check_size};
use super::error::FrameError;
use super::options::{Logged, View};
use super::renderer::{Renderer, derive_colors};
use crate::gpu::{Buffer, BufferCopy, MemoryKind};
use crate::resident::pool::Access;
use crate::resident::scene::Scene;
pub use crate::shared::passes::LOG_STEP;
use crate::shared::passes::{self, TILE, WIDE_TILE};

/// Words that a thread of a logged pass writes.
pub const LOG_WORDS: usize = passes::LOG_WORDS as usize;
/// Of the logs of one submit.
const LOG_BYTES: u64 = 128 << 20;

impl Renderer {
    /// What the threads of the logged pass do for `view`, in bands from the top down: `each` is given how many threads
    /// there are across, and of each thread, row by row, [`LOG_WORDS`] words. See `shaders/log.glsl`.
    ///
    /// # Panics
    /// Without [`super::PassOptions::logged`], or where the pool is not reached by address.
    pub fn log(
        &mut self,
        scene: &mut Scene,
        view: &View,
        mut each: impl FnMut(usize, &[u32]),
    ) -> Result<(), FrameError> {
        let logged = self.options.logged.expect("a logged pass");
        assert_eq!(self.access, Access::Address, "lines are told by their addresses");
        check_size(scene.gpu(), view.size)?;
        let rays = self.rays(view)?;
        let table = self.table(scene);
        let [width, height] = view.size;
        let side = match logged {
            Logged::WideBeams => WIDE_TILE,
            Logged::Beams => TILE,
            Logged::Trace => 1,
        };
        let threads = |rows: u32| u64::from(width.div_ceil(side)) * u64::from(rows.div_ceil(side));
        let thread_bytes = 4 * LOG_WORDS as u64;
        // Whole wide tiles, of which beams are made.
        let most = (LOG_BYTES / (threads(WIDE_TILE) * thread_bytes)).max(1) as u32 * WIDE_TILE;
        let rows = most.min(band_rows(view.size)).min(height);
        let make = |name, kind| Buffer::new(scene.gpu(), name, kind, threads(rows) * thread_bytes);
        self.log = Some([make("log", MemoryKind::Device)?, make("log read back", MemoryKind::Readback)?]);
        let mut words = vec![0u32; (threads(rows) as usize) * LOG_WORDS];
        for first_row in (0..height).step_by(rows as usize) {
            let rows = rows.min(height - first_row);
            let band =
                Band { first_row, rows, sample: 0, samples: 1, read: false, screen: false, whole: false };
            derive_colors(scene, view)?;
            let (mut commands, slot) = scene.order.begin_frame("log")?;
            self.record(scene, (&mut commands, slot), view, &table, &rays, band, None)?;
            let [log, back] = self.log.as_ref().expect("made above");
            let size = threads(rows) * thread_bytes;
            scene.order.readback(&mut commands, &[(log, back, BufferCopy { from: 0, to: 0, size })]);
            let point = scene.order.submit(commands)?;
            scene.frame_submitted(point);
            let words = &mut words[..size as usize / 4];
            scene.order.read(point, back, 0, bytemuck::cast_slice_mut(words))?;
            each(width.div_ceil(side) as usize, words);
        }
        self.log = None;
        Ok(())
    }
}
