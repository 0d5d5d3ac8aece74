//! The index of chunks: what can be read, cut into units of reading.

use super::{Chunk, FileHeader, Warning};

/// Records in a chunk of uncompressed LAS: LASzip's usual chunk.
const LAS_CHUNK_RECORDS: u64 = 50_000;

/// Cuts the records of a LAS file that its length allows for.
pub(super) fn index_las(header: &FileHeader, file_len: u64, warnings: &mut Vec<Warning>) -> Vec<Chunk> {
    let record_len = u64::from(header.record_len);
    let room = file_len.saturating_sub(header.offset_to_points) / record_len;
    let claimed = header.claimed_points;
    let readable = claimed.min(room);
    if readable < claimed {
        warnings.push(Warning::PointsMissing { claimed, readable });
    }
    (0..readable.div_ceil(LAS_CHUNK_RECORDS))
        .map(|index| {
            let first_record = index * LAS_CHUNK_RECORDS;
            let records = LAS_CHUNK_RECORDS.min(readable - first_record);
            Chunk {
                index,
                byte_offset: header.offset_to_points + first_record * record_len,
                byte_len: records * record_len,
                first_record,
                records,
            }
        })
        .collect()
}
