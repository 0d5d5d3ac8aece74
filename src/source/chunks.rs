//! The index of chunks: what can be read, cut into units of reading.

use super::{
    FileBytes, FileHeader, SourceError, Warning,
    laszip::{Compressor, Laszip, Table, read_table},
    layers::ChunkLayers,
};

/// Records in a chunk of uncompressed LAS: LASzip's usual chunk.
const LAS_CHUNK_RECORDS: u64 = 50_000;

/// Most records in a compressed byte: a record takes at least one symbol of 64, the likeliest of which
/// shrinks the coder's interval by 63/32,768 or more, so that 2,900 of them use up a byte.
pub(super) const RECORDS_PER_BYTE: u64 = 4096;

/// What one chunk is: a LAZ chunk, a COPC node, or about 50,000 LAS records.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Chunk {
    /// Index of the chunk in its file.
    pub index: u64,
    /// First byte in the file.
    pub byte_offset: u64,
    /// Bytes it takes in the file; checked against the file's length.
    pub byte_len: u64,
    /// Index of its first record in the file.
    pub first_record: u64,
    /// Records it holds.
    pub records: u64,
}

/// Chunks in file order, and how sure the last one's count is.
#[derive(Debug, Default)]
pub(super) struct Index {
    pub chunks: Vec<Chunk>,
    /// The last chunk's count is an upper bound: it ends with its bytes.
    pub open_end: bool,
}

impl Index {
    /// Records in all chunks.
    fn records(&self) -> u64 {
        self.chunks.last().map_or(0, |c| c.first_record + c.records)
    }

    /// First byte behind the last chunk, or `start` if there is none.
    fn end(&self, start: u64) -> u64 {
        self.chunks.last().map_or(start, |c| c.byte_offset + c.byte_len)
    }

    /// Appends a chunk behind the others.
    fn push(&mut self, byte_offset: u64, byte_len: u64, records: u64) {
        let (index, first_record) = (self.chunks.len() as u64, self.records());
        self.chunks.push(Chunk { index, byte_offset, byte_len, first_record, records });
    }
}

/// Cuts the records of a LAS file that there is room for before byte `end`.
pub(super) fn index_las(header: &FileHeader, end: u64, warnings: &mut Vec<Warning>) -> Index {
    let record_len = u64::from(header.record_len);
    let room = end.saturating_sub(header.offset_to_points) / record_len;
    let claimed = header.claimed_points;
    // A writer that was stopped leaves a count of 0; any other count knows what follows the points.
    let readable = if claimed == 0 { room } else { claimed.min(room) };
    if readable < claimed {
        warnings.push(Warning::PointsMissing { claimed, readable });
    } else if readable > claimed {
        warnings.push(Warning::PointsUnclaimed { claimed, found: room, read: readable });
    }
    let mut index = Index::default();
    for first in (0..readable).step_by(LAS_CHUNK_RECORDS as usize) {
        let records = LAS_CHUNK_RECORDS.min(readable - first);
        index.push(header.offset_to_points + first * record_len, records * record_len, records);
    }
    index
}

/// Indexes the chunks of a LAZ file by its chunk table, as far as that can be trusted; what lies beyond is
/// found from the data where they allow it.
pub(super) fn index_laz(
    bytes: &FileBytes,
    header: &FileHeader,
    laszip: &Laszip,
    warnings: &mut Vec<Warning>,
) -> Result<Index, SourceError> {
    let claimed = header.claimed_points;
    let mut index = Index::default();
    if laszip.compressor == Compressor::PointWise {
        let len = bytes.len().saturating_sub(header.offset_to_points);
        push_stream(&mut index, header, header.offset_to_points, len);
    } else {
        let record_len = u64::from(header.record_len);
        let table = read_table(bytes, header.offset_to_points, record_len, laszip.chunk_size.is_none())?;
        match laszip.chunk_size {
            None => {
                for entry in &table.entries {
                    let most = entry.bytes.saturating_mul(RECORDS_PER_BYTE);
                    index.push(entry.offset, entry.bytes, entry.records.unwrap_or(0).min(most));
                }
            }
            Some(size) => push_fixed(bytes, header, size, &table, &mut index)?,
        }
        if let Some(reason) = &table.broken
            && claimed > 0
        {
            let rescue = recover(bytes, header, laszip, &table, &mut index)?;
            warnings.push(Warning::ChunkTable { offset: table.offset, reason: reason.clone(), rescue });
        }
    }
    let found = index.records();
    if found < claimed {
        warnings.push(Warning::PointsMissing { claimed, readable: found });
    } else if found > claimed {
        warnings.push(Warning::PointsUnclaimed { claimed, found, read: found });
    }
    Ok(index)
}

/// Chunks of `size` records each; the last one has the rest.
fn push_fixed(
    bytes: &FileBytes,
    header: &FileHeader,
    size: u64,
    table: &Table,
    index: &mut Index,
) -> Result<(), SourceError> {
    for (i, entry) in table.entries.iter().enumerate() {
        let before = index.records();
        let most = size.min(entry.bytes.saturating_mul(RECORDS_PER_BYTE));
        let last = i + 1 == table.entries.len() && table.broken.is_none();
        let rest = header.claimed_points.saturating_sub(before);
        let records = match rest {
            _ if !last => most,
            1.. if rest <= most => rest,
            // The header's count cannot be that of these chunks: the last one's own word decides.
            _ => match ChunkLayers::read(&bytes.handle()?, header, entry.offset, entry.bytes)? {
                Ok(layers) if header.stored_format >= 6 => layers.records.min(most),
                _ => {
                    index.open_end = true;
                    most
                }
            },
        };
        index.push(entry.offset, entry.bytes, records);
    }
    Ok(())
}

/// One chunk from `start`, decoded until all claimed points are there or its bytes end.
fn push_stream(index: &mut Index, header: &FileHeader, start: u64, len: u64) {
    let rest = header.claimed_points.saturating_sub(index.records());
    let records = rest.min(len.saturating_mul(RECORDS_PER_BYTE));
    if len >= u64::from(header.record_len) && records > 0 {
        index.push(start, len, records);
    }
}

/// Finds chunks behind those that a broken table gives, and says how.
fn recover(
    bytes: &FileBytes,
    header: &FileHeader,
    laszip: &Laszip,
    table: &Table,
    index: &mut Index,
) -> Result<String, SourceError> {
    let by_table = index.chunks.len();
    let mut at = index.end(header.offset_to_points + 8);
    match (laszip.compressor, laszip.chunk_size) {
        // Each chunk says how long it is.
        (Compressor::Layered, _) => {
            let file = bytes.handle()?;
            while index.records() < header.claimed_points
                && let Ok(layers) = ChunkLayers::read(&file, header, at, table.data_end.saturating_sub(at))?
            {
                let most = header.claimed_points - index.records();
                let records = layers.records.min(layers.byte_len().saturating_mul(RECORDS_PER_BYTE));
                index.push(at, layers.byte_len(), records.min(most));
                at += layers.byte_len();
            }
            let walked = index.chunks.len() - by_table;
            Ok(format!("{by_table} chunks are read by it and {walked} by their own headers"))
        }
        // A decoder stops exactly where the next chunk begins.
        (_, Some(_)) => {
            push_stream(index, header, at, table.data_end.saturating_sub(at));
            Ok(format!("{by_table} chunks are read by it, what follows one after the other"))
        }
        // Nothing else says how many points a chunk has.
        (_, None) => Ok(format!("{by_table} chunks are read by it, what follows is lost")),
    }
}
