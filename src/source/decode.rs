//! Chunks to columns.

use super::{BLOCK_RECORDS, Chunk, FileHeader, LidarFile, PointBlock, SourceError};
use std::ops::Range;

/// Bytes of raw records that are read and taken apart at a time: stays in the second-level cache.
const RAW_BYTES: usize = 512 << 10;

/// Turns chunks into blocks of columns; one a worker thread, its buffers are reused.
#[derive(Debug, Default)]
pub struct Decoder {
    raw: Vec<u8>,
    block: PointBlock,
}

impl Decoder {
    /// A decoder with empty buffers.
    pub fn new() -> Decoder {
        Decoder::default()
    }

    /// Hands the points `records` (counted from the chunk's first, clamped to what it holds) of `chunk` to
    /// `sink`, in order, in blocks of at most [`BLOCK_RECORDS`]. `chunk` is one of `file.chunks`.
    ///
    /// On damage, the blocks before it have been handed out; the error says how many points that were.
    pub fn decode(
        &mut self,
        file: &LidarFile,
        chunk: &Chunk,
        records: Range<u64>,
        sink: &mut dyn FnMut(&PointBlock),
    ) -> Result<(), SourceError> {
        let records = records.start.min(chunk.records)..records.end.min(chunk.records);
        self.decode_las(file, chunk, records, sink)
    }

    fn decode_las(
        &mut self,
        file: &LidarFile,
        chunk: &Chunk,
        records: Range<u64>,
        sink: &mut dyn FnMut(&PointBlock),
    ) -> Result<(), SourceError> {
        let handle = file.bytes.handle()?;
        let layout = RecordLayout::of(&file.header);
        let run = layout.records_in(RAW_BYTES);
        let mut next = records.start;
        while next < records.end {
            let n = run.min(records.end - next);
            self.raw.resize(n as usize * layout.len, 0);
            handle.read_exact_at(&mut self.raw, chunk.byte_offset + next * layout.len as u64)?;
            self.block.first_record = chunk.first_record + next;
            layout.extract(&self.raw, &mut self.block);
            sink(&self.block);
            next += n;
        }
        Ok(())
    }
}

/// Where the columns stand in a raw record (LAS 1.4 R15, tables 7 to 18).
#[derive(Clone, Copy, Debug)]
struct RecordLayout {
    /// Bytes in a record.
    len: usize,
    /// Formats 6 to 10.
    extended: bool,
    /// First byte of R, G, B.
    rgb: Option<usize>,
}

impl RecordLayout {
    fn of(header: &FileHeader) -> RecordLayout {
        let rgb = match header.format {
            2 => Some(20),
            3 | 5 => Some(28),
            7 | 8 | 10 => Some(30),
            _ => None,
        };
        RecordLayout { len: header.record_len.into(), extended: header.format >= 6, rgb }
    }

    /// Whole records in `bytes`, at least one, at most a block.
    fn records_in(&self, bytes: usize) -> u64 {
        (bytes / self.len).clamp(1, BLOCK_RECORDS) as u64
    }

    /// Takes whole records apart into `block`.
    fn extract(&self, raw: &[u8], block: &mut PointBlock) {
        let n = raw.len() / self.len;
        block.x.resize(n, 0);
        block.y.resize(n, 0);
        block.z.resize(n, 0);
        block.class.resize(n, 0);
        block.flags.resize(n, 0);
        block.intensity.resize(n, 0);
        block.returns.resize(n, 0);
        // Slices of one length let the compiler drop the bounds checks.
        let (x, y, z) = (&mut block.x[..n], &mut block.y[..n], &mut block.z[..n]);
        let (class, flags) = (&mut block.class[..n], &mut block.flags[..n]);
        let (intensity, returns) = (&mut block.intensity[..n], &mut block.returns[..n]);
        for (i, record) in raw.chunks_exact(self.len).enumerate() {
            let r: &[u8; 20] = record[..20].try_into().unwrap();
            x[i] = i32::from_le_bytes([r[0], r[1], r[2], r[3]]);
            y[i] = i32::from_le_bytes([r[4], r[5], r[6], r[7]]);
            z[i] = i32::from_le_bytes([r[8], r[9], r[10], r[11]]);
            intensity[i] = u16::from_le_bytes([r[12], r[13]]);
            if self.extended {
                returns[i] = r[14];
                flags[i] = r[15] & 0xf;
                class[i] = r[16];
            } else {
                returns[i] = r[14] & 7 | (r[14] << 1) & 0x70;
                flags[i] = r[15] >> 5;
                class[i] = r[15] & 0x1f;
            }
        }
        block.rgb.clear();
        if let Some(at) = self.rgb {
            block.rgb.extend(raw.chunks_exact(self.len).map(|record| {
                let c: &[u8; 6] = record[at..at + 6].try_into().unwrap();
                [0, 2, 4].map(|k| u16::from_le_bytes([c[k], c[k + 1]]))
            }));
        }
    }
}
