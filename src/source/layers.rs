//! The head of a layered chunk: first record, count, layer sizes (LASzip 3, point formats 6 to 10).

use super::{Fields, FileHeader, OpenFile, SourceError, header::FORMAT_LEN};
use std::ops::Range;

/// Layers of the point itself: x, y with returns and channel; z; class; flags; intensity; scan angle; user
/// data; source id; GPS time.
const POINT_LAYERS: usize = 9;
/// The first of them, up to intensity, are those that a [`PointBlock`](super::PointBlock) always stores.
const USUAL_LAYERS: usize = 5;

/// Layers that are decoded.
#[derive(Clone, Copy, Debug)]
pub(super) struct WantedLayers {
    /// Colours, which the format has.
    pub rgb: bool,
    /// What else is asked for; times are decoded apart.
    pub fields: Fields,
}

impl WantedLayers {
    fn has(&self, layer: usize) -> bool {
        match layer {
            0..USUAL_LAYERS => true,
            5 => self.fields.scan_angle,
            7 => self.fields.source_id,
            _ => layer == POINT_LAYERS && self.rgb,
        }
    }
}

/// Where the layers of a chunk lie; all inside of it.
#[derive(Debug)]
pub(super) struct ChunkLayers {
    /// Records in the chunk, in its own words.
    pub records: u64,
    /// The first record, raw.
    pub first: Vec<u8>,
    /// Bytes in each layer.
    sizes: Vec<u32>,
    /// First byte in the file of the first layer.
    start: u64,
    /// Bytes in front of the layers.
    head_len: u64,
}

impl ChunkLayers {
    /// Reads the head of the chunk at `offset` that may have `room` bytes; the inner error says why it
    /// cannot be one.
    pub fn read(
        file: &OpenFile,
        header: &FileHeader,
        offset: u64,
        room: u64,
    ) -> Result<Result<ChunkLayers, String>, SourceError> {
        let record_len = usize::from(header.record_len);
        let of_format = match header.stored_format {
            6 => 0,
            7 | 9 => 1,
            8 => 2,
            10 => 3,
            _ => return Ok(Err("point formats 0 to 5 have no layers".into())),
        };
        // Each extra byte has a layer of its own.
        let extra = usize::from(header.record_len - FORMAT_LEN[usize::from(header.stored_format)]);
        let count = POINT_LAYERS + of_format + extra;
        let head_len = record_len + 4 + 4 * count;
        if (head_len as u64) > room {
            return Ok(Err(format!("{room} bytes cannot hold the head of a layered chunk ({head_len})")));
        }
        let mut head = vec![0; head_len];
        file.read_exact_at(&mut head, offset)?;
        let words = head[record_len..].chunks_exact(4).map(|w| u32::from_le_bytes(w.try_into().unwrap()));
        let (records, sizes) = (words.clone().next().unwrap_or(0), words.skip(1).collect::<Vec<_>>());
        head.truncate(record_len);
        let layers = ChunkLayers {
            records: records.into(),
            first: head,
            sizes,
            start: offset + head_len as u64,
            head_len: head_len as u64,
        };
        if layers.byte_len() > room {
            return Ok(Err(format!("its layers need {} bytes, it has {room}", layers.byte_len())));
        }
        if records == 0 {
            return Ok(Err("it says that it has no points".into()));
        }
        Ok(Ok(layers))
    }

    /// Bytes in the chunk.
    pub fn byte_len(&self) -> u64 {
        self.head_len + self.sizes.iter().map(|&s| u64::from(s)).sum::<u64>()
    }

    /// Bytes in front of the layers.
    pub fn head_len(&self) -> u64 {
        self.head_len
    }

    /// Sizes of all layers.
    pub fn sizes(&self) -> &[u32] {
        &self.sizes
    }

    /// Where all layers lie in the file.
    pub fn range(&self) -> Range<u64> {
        self.start..self.start + self.byte_len() - self.head_len
    }

    /// Where the layer of returns, X and Y lies, and that of times.
    pub fn of_times(&self) -> [Range<u64>; 2] {
        let start =
            |layer: usize| self.start + self.sizes[..layer].iter().map(|&size| u64::from(size)).sum::<u64>();
        [0, 8].map(|layer| start(layer)..start(layer) + u64::from(self.sizes[layer]))
    }

    /// Where the point layers and, where it is wanted, the R, G, B layer lie in the file; of those that are not wanted, nothing.
    pub fn wanted(&self, wanted: WantedLayers) -> Vec<Range<u64>> {
        let mut start = self.start;
        let mut ranges = Vec::new();
        for (layer, &size) in self.sizes[..POINT_LAYERS + usize::from(wanted.rgb)].iter().enumerate() {
            let end = start + u64::from(size);
            ranges.push(if wanted.has(layer) { start..end } else { start..start });
            start = end;
        }
        ranges
    }

    /// The beginnings of those layers, in which the first `records` are sure to end but for odd data.
    pub fn wanted_of_first(&self, wanted: WantedLayers, records: u64) -> Vec<Range<u64>> {
        let cut = |range: Range<u64>| {
            // Coders learn: the first records take more than their share.
            let share = (range.end - range.start) * records / self.records;
            range.start..range.end.min(range.start + 3 * share + 4096)
        };
        self.wanted(wanted).into_iter().map(cut).collect()
    }

    /// Bytes of the layers that are decoded.
    pub fn needed_bytes(&self, wanted: WantedLayers) -> u64 {
        self.wanted(wanted).iter().map(|range| range.end - range.start).sum()
    }
}
