//! Buffers of a frame: what is written for each one in flight, and what its passes draw into.

use super::bands::{Band, band_rows};
use super::mirrors::FrameConstants;
use super::pipelines::FramePass;
use crate::coords::{LowSurface, Slab};
use crate::gpu::{Binding, BindingCache, Buffer, Commands, Gpu, GpuError, MemoryKind};
use crate::resident::pool::Access;
use crate::resident::table::Table;
use crate::shared::passes::{GROUND_SIDE, RAMP_ENTRIES, TILE, WIDE_TILE};
use std::sync::{Arc, Weak};

/// How far a beam came and its level, in one word.
const BYTES_PER_BEAM: u64 = 4;

/// Of a hit record, and of a sum of colours.
pub(super) const BYTES_PER_PIXEL: u64 = 16;

/// Of the buffer of a section table: one that is rebuilt while sections arrive costs a frame, on lavapipe even a new
/// translation of the passes that read it.
const LEAST_TABLE_BYTES: u64 = 1 << 20;

/// Buffers that exist once for every frame in flight: what its passes are given.
pub(super) struct FrameInputs {
    frame: Buffer,
    table: Buffer,
    /// What `table` holds: it is written only where it is another.
    written: Weak<Table>,
    ramp: Buffer,
    /// Whose heights lie behind the ramp; `None`: none yet.
    ground: Option<Weak<LowSurface>>,
    bindings: BindingCache,
}

impl FrameInputs {
    /// Those of `kept` where a table of so many bytes fits them, else new ones.
    pub fn with_room(
        kept: Option<FrameInputs>,
        gpu: &Gpu,
        table_bytes: u64,
    ) -> Result<FrameInputs, GpuError> {
        if let Some(kept) = kept.filter(|inputs| inputs.table.size() >= table_bytes) {
            return Ok(kept);
        }
        let make = |name: &str, size| Buffer::new(gpu, name, MemoryKind::Upload, size);
        Ok(FrameInputs {
            frame: make("frame constants", size_of::<FrameConstants>() as u64)?,
            table: make("section table", LEAST_TABLE_BYTES.max(table_bytes))?,
            written: Weak::new(),
            ramp: make(
                "colour ramp and ground",
                u64::from(RAMP_ENTRIES) * 16 + u64::from(GROUND_SIDE * GROUND_SIDE) * 4,
            )?,
            ground: None,
            bindings: BindingCache::default(),
        })
    }

    /// Writes all of them; the ramp: 256 colours; `heights` of the ground that `slab` rests on.
    pub fn write(
        &mut self,
        constants: &FrameConstants,
        table: &Arc<Table>,
        ramp: &[u8],
        slab: Option<&Slab>,
        heights: impl FnOnce() -> Vec<f32>,
    ) {
        // What is pointed to weakly keeps its place in memory.
        if !std::ptr::eq(self.written.as_ptr(), Arc::as_ptr(table)) {
            self.table.write(0, bytemuck::cast_slice(&table.slots));
            self.written = Arc::downgrade(table);
        }
        self.ramp.write(0, ramp);
        let ground = slab.map_or(Weak::new(), |slab| Arc::downgrade(&slab.low));
        if !self.ground.as_ref().is_some_and(|written| written.ptr_eq(&ground)) {
            self.ramp.write(u64::from(RAMP_ENTRIES) * 16, bytemuck::cast_slice(&heights()));
            self.ground = Some(ground);
        }
        self.frame.write(0, bytemuck::bytes_of(constants));
    }

    /// The section table and the ramp.
    pub fn table_and_ramp(&self) -> [&Buffer; 2] {
        [&self.table, &self.ramp]
    }

    /// Keeps them until `commands` are done.
    pub fn keep(&self, commands: &mut Commands) {
        [&self.frame, &self.table, &self.ramp].into_iter().for_each(|buffer| commands.keep(buffer.clone()));
    }

    /// Bindings of each pass to these, to `targets` and to the pool's derived page.
    pub fn bind(
        &mut self,
        passes: &[FramePass],
        access: Access,
        pool: Option<&Buffer>,
        targets: &FrameTargets,
    ) -> Result<Vec<Binding>, GpuError> {
        self.bindings.begin();
        let (frame, table) = (&self.frame, &self.table);
        // An empty scene has no page; the table is never followed into it.
        let pool = pool.unwrap_or(table);
        let bindings = &mut self.bindings;
        let mut bind = |pipeline| match access {
            Access::Address => bindings.get(pipeline, &[frame]),
            Access::Texels => bindings.get(pipeline, &[frame, pool, table, &targets.beams]),
            Access::StorageBuffer => {
                let FrameTargets { hits, colors, beams, wide_beams, .. } = targets;
                bindings.get(pipeline, &[pool, table, frame, hits, colors, &self.ramp, beams, wide_beams])
            }
        };
        passes.iter().map(|pass| bind(&pass.pipeline)).collect()
    }
}

/// What the passes write: buffers of one image size.
pub(super) struct FrameTargets {
    size: [u32; 2],
    pub hits: Buffer,
    pub colors: Buffer,
    pub beams: Buffer,
    pub wide_beams: Buffer,
    /// Hits and colours for the host; made when first read back.
    pub back: Option<[Buffer; 2]>,
    /// First row, rows and sample of the band whose beams these hold.
    beamed: Option<(u32, u32, u32)>,
}

impl FrameTargets {
    /// Makes `kept` ones that `band` of an image of `size` fits.
    pub fn prepare(
        kept: &mut Option<FrameTargets>,
        gpu: &Gpu,
        size: [u32; 2],
        band: Band,
    ) -> Result<(), GpuError> {
        let rows = if band.whole { size[1] } else { band_rows(size) };
        let bytes = u64::from(size[0]) * u64::from(rows) * BYTES_PER_PIXEL;
        let tile_bytes =
            |side: u32| u64::from(size[0].div_ceil(side)) * u64::from(rows.div_ceil(side)) * BYTES_PER_BEAM;
        let fits = |t: &FrameTargets| {
            t.hits.size() >= bytes
                && t.beams.size() >= tile_bytes(TILE)
                && t.wide_beams.size() >= tile_bytes(WIDE_TILE)
        };
        // A window's image is now coarse, now fine: what is large enough is kept.
        let is_kept = kept.as_ref().is_some_and(|t| if band.whole { fits(t) } else { t.size == size });
        if !is_kept {
            *kept = None;
            let device = |name, bytes| Buffer::new(gpu, name, MemoryKind::Device, bytes);
            *kept = Some(FrameTargets {
                size,
                hits: device("hits", bytes)?,
                colors: device("colors", bytes)?,
                beams: device("beams", tile_bytes(TILE))?,
                wide_beams: device("wide beams", tile_bytes(WIDE_TILE))?,
                back: None,
                beamed: None,
            });
        }
        let targets = kept.as_mut().expect("just made");
        if band.read && targets.back.as_ref().is_none_or(|[hits, _]| hits.size() < bytes) {
            let back = |name| Buffer::new(gpu, name, MemoryKind::Readback, bytes);
            targets.back = Some([back("hits read back")?, back("colors read back")?]);
        }
        Ok(())
    }

    /// Notes that `band` is drawn next; whether the beams of its pixels are here already. A beam holds for every sample of
    /// its pixels.
    pub fn has_beams_for(&mut self, band: Band) -> bool {
        let before = self.beamed.replace((band.first_row, band.rows, band.sample));
        band.sample > 0 && before == Some((band.first_row, band.rows, band.sample - 1))
    }

    /// Keeps them until `commands` are done.
    pub fn keep(&self, commands: &mut Commands) {
        for buffer in [&self.hits, &self.colors, &self.beams, &self.wide_beams] {
            commands.keep(buffer.clone());
        }
    }
}
