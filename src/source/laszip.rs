//! LASzip's own record and chunk table (LASzip specification; Isenburg 2013).

use super::{
    FileBytes, FileHeader, SourceError, VlrEntry, contain::contain, header::FORMAT_LEN, stream::ByteStream,
};
use laz::{
    LazItem, LazItemType, LazVlr, decoders::ArithmeticDecoder, decompressors::IntegerDecompressorBuilder,
};
use std::{io, ops::Range};

/// How the points of a LAZ file are compressed; every item checked against the point format.
#[derive(Clone, Debug)]
pub(super) struct Laszip {
    pub compressor: Compressor,
    /// Records in a chunk; `None` where each chunk has its own count.
    pub chunk_size: Option<u64>,
    /// The parts of a record, in order.
    pub items: Vec<LazItem>,
    /// First byte and count of extended records that were appended to the file.
    pub special_evlrs: Option<(u64, u64)>,
}

/// How chunks are laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Compressor {
    /// All points in one chunk, no table.
    PointWise,
    /// Chunks of interleaved records (formats 0 to 5).
    Chunked,
    /// Chunks of one layer an attribute (formats 6 to 10).
    Layered,
}

/// Longest LASzip record that is read: 34 bytes and six for each of a handful of items.
const MAX_VLR: u64 = 1024;

/// Most extra bytes in a record of formats 0 to 5, where each costs a model of 2 KiB.
const MAX_EXTRA_BYTES: u16 = 4096;

impl Laszip {
    /// Reads and checks the record that says how `header`'s points are compressed.
    pub fn read(bytes: &FileBytes, vlrs: &[VlrEntry], header: &FileHeader) -> Result<Laszip, SourceError> {
        let entry = vlrs.iter().find(|v| v.is(LazVlr::USER_ID, LazVlr::RECORD_ID));
        let offset = entry.map_or(0, |e| e.offset);
        let bad = |reason: String| SourceError::Laszip { path: bytes.path().to_owned(), offset, reason };
        let entry = entry.ok_or_else(|| bad("missing, though the point format says LAZ".into()))?;
        let raw = entry.read(bytes, MAX_VLR)?;
        if raw.len() < 34 {
            return Err(bad(format!("{} bytes, at least 34 are needed", raw.len())));
        }
        let word = |at: usize| u16::from_le_bytes([raw[at], raw[at + 1]]);
        let (compressor, coder, items) = (word(0), word(2), usize::from(word(32)));
        let compressor = match compressor {
            1 => Compressor::PointWise,
            2 => Compressor::Chunked,
            3 => Compressor::Layered,
            other => return Err(bad(format!("compressor is {other}, not 1, 2 or 3"))),
        };
        if coder != 0 {
            return Err(bad(format!("coder is {coder}, not 0 (arithmetic)")));
        }
        if raw.len() < 34 + 6 * items {
            return Err(bad(format!("{items} items do not fit into {} bytes", raw.len())));
        }
        let vlr = LazVlr::from_buffer(&raw).map_err(|e| bad(e.to_string()))?;
        check_items(vlr.items(), header, compressor).map_err(bad)?;
        let chunk_size = (!vlr.uses_variable_size_chunks()).then(|| vlr.chunk_size().into());
        let long = |at: usize| i64::from_le_bytes(raw[at..at + 8].try_into().unwrap());
        // -1: none.
        let special = u64::try_from(long(24)).ok().zip(u64::try_from(long(16)).ok());
        let special_evlrs = special.filter(|(start, count)| *start > 0 && *count > 0);
        Ok(Laszip { compressor, chunk_size, items: vlr.items().clone(), special_evlrs })
    }
}

/// Whether `items` are those of the header's format and length, in versions that are known.
fn check_items(items: &[LazItem], header: &FileHeader, compressor: Compressor) -> Result<(), String> {
    use LazItemType::*;
    let layered = compressor == Compressor::Layered;
    let extra = header.record_len - FORMAT_LEN[usize::from(header.stored_format)];
    let mut wanted: Vec<LazItemType> = match header.stored_format {
        0 => vec![Point10],
        1 => vec![Point10, GpsTime],
        2 => vec![Point10, RGB12],
        3 => vec![Point10, GpsTime, RGB12],
        4 => vec![Point10, GpsTime, WavePacket13],
        5 => vec![Point10, GpsTime, RGB12, WavePacket13],
        6 => vec![Point14],
        7 => vec![Point14, RGB14],
        8 => vec![Point14, RGBNIR14],
        9 => vec![Point14, WavePacket14],
        _ => vec![Point14, RGBNIR14, WavePacket14],
    };
    if extra > 0 {
        wanted.push(if header.stored_format < 6 { Byte(extra) } else { Byte14(extra) });
    }
    if !items.iter().map(LazItem::item_type).eq(wanted.iter().copied()) {
        let found: Vec<_> = items.iter().map(LazItem::item_type).collect();
        let (format, len) = (header.stored_format, header.record_len);
        return Err(format!(
            "items are {found:?}, a record of format {format} and {len} bytes has {wanted:?}"
        ));
    }
    if layered != (header.stored_format >= 6) {
        return Err(format!("compressor {compressor:?} cannot hold point format {}", header.stored_format));
    }
    if !layered && extra > MAX_EXTRA_BYTES {
        return Err(format!("{extra} extra bytes in a record, at most {MAX_EXTRA_BYTES} are decoded"));
    }
    let known = if layered { 3..=4 } else { 1..=2 };
    match items.iter().find(|i| !known.contains(&i.version())) {
        Some(item) => {
            Err(format!("item {:?} has version {}, known are {known:?}", item.item_type(), item.version()))
        }
        None => Ok(()),
    }
}

/// One entry of a chunk table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct TableEntry {
    /// First byte of the chunk.
    pub offset: u64,
    /// Records in the chunk; `None` where the LASzip record says how many.
    pub records: Option<u64>,
    /// Bytes in the chunk.
    pub bytes: u64,
}

/// A chunk table, up to the first entry that makes no sense.
#[derive(Debug, Default)]
pub(super) struct Table {
    /// First byte of the table, or of the pointer to it where that is wrong.
    pub offset: u64,
    /// First byte behind the chunks.
    pub data_end: u64,
    /// Entries of chunks that hold points; they lie one behind the other within the data.
    pub entries: Vec<TableEntry>,
    /// Why there are no more entries, where there should be.
    pub broken: Option<String>,
}

/// Reads the chunk table of points that begin at `points` with the pointer to it.
pub(super) fn read_table(
    bytes: &FileBytes,
    points: u64,
    record_len: u64,
    with_counts: bool,
) -> Result<Table, SourceError> {
    let broken = |offset, reason: String| {
        Ok(Table { offset, data_end: bytes.len(), broken: Some(reason), ..Table::default() })
    };
    let file = bytes.handle()?;
    let word = |at: u64| {
        let mut raw = [0; 8];
        file.read_exact_at(&mut raw, at).map(|()| i64::from_le_bytes(raw))
    };
    let data = points + 8;
    if data > bytes.len() {
        return broken(points, "the file ends before the pointer to it".into());
    }
    let mut pointer_at = points;
    let mut pointer = word(points)?;
    if pointer <= points as i64 && bytes.len() >= data + 8 {
        // A writer that could not seek back leaves -1 and repeats the pointer at the very end.
        pointer_at = bytes.len() - 8;
        pointer = word(pointer_at)?;
    }
    let start = match u64::try_from(pointer) {
        Ok(p) if p >= data && p.checked_add(8).is_some_and(|e| e <= bytes.len()) => p,
        _ => {
            let reason = format!("it should lie at byte {pointer}, the points at {data} to {}", bytes.len());
            return broken(pointer_at, reason);
        }
    };
    let head = word(start)? as u64;
    let (version, count) = (head as u32, u64::from((head >> 32) as u32));
    let mut table = Table { offset: start, data_end: start, ..Table::default() };
    if version != 0 {
        table.broken = Some(format!("version {version} is unknown"));
        return Ok(table);
    }
    // A chunk begins with a raw record; a few writers leave empty ones.
    let most = (start - data) / record_len + 4096;
    if count > most {
        table.broken = Some(format!("{count} chunks are claimed, {} bytes cannot hold them", start - data));
        return Ok(table);
    }
    if count == 0 {
        return Ok(table);
    }
    let stream = ByteStream::new(file, Vec::new(), start + 8..bytes.len());
    let room = data..start;
    let entries = &mut table.entries;
    table.broken = match contain(|| decode_entries(stream, count, room, record_len, with_counts, entries)) {
        Ok(Ok(())) => None,
        Ok(Err(reason)) | Err(reason) => Some(reason),
    };
    Ok(table)
}

fn decode_entries(
    stream: ByteStream,
    count: u64,
    room: Range<u64>,
    record_len: u64,
    with_counts: bool,
    entries: &mut Vec<TableEntry>,
) -> Result<(), String> {
    let mut ints = IntegerDecompressorBuilder::new().bits(32).contexts(2).build_initialized();
    let mut decoder = ArithmeticDecoder::new(stream);
    let ended = |i: u64| move |e: io::Error| format!("entry {i} of {count}: {e}");
    decoder.read_init_bytes().map_err(ended(0))?;
    let (mut records, mut bytes, mut offset) = (0, 0, room.start);
    for i in 0..count {
        if with_counts {
            records = ints.decompress(&mut decoder, records, 0).map_err(ended(i))?;
        }
        bytes = ints.decompress(&mut decoder, bytes, 1).map_err(ended(i))?;
        let (len, records) = (u64::from(bytes as u32), with_counts.then_some(u64::from(records as u32)));
        if len > room.end - offset {
            return Err(format!("chunk {i} of {count} has {len} bytes, {} remain", room.end - offset));
        }
        // Writers leave empty chunks behind: the last one, or those with a count of 0.
        let empty = records == Some(0) || (records.is_none() && i + 1 == count && len < record_len);
        if !empty {
            if len < record_len {
                return Err(format!("chunk {i} of {count} has {len} bytes, a record has {record_len}"));
            }
            entries.push(TableEntry { offset, records, bytes: len });
        }
        offset += len;
    }
    Ok(())
}
