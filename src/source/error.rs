//! What cannot be read, and what can be read only in part.

use super::kinds::Kind;
use std::{io, path::PathBuf};

/// What cannot be read: names the file, the place in it, and why.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// The system refuses to open or read.
    #[error("{path}: {what}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What was tried.
        what: String,
        /// The system's word.
        source: io::Error,
    },
    /// The file is not the one that was opened first.
    #[error("{path}: changed while it was read ({was} bytes at first, {now} now)")]
    Changed {
        /// The file.
        path: PathBuf,
        /// Bytes it held when it was first opened.
        was: u64,
        /// Bytes it holds now.
        now: u64,
    },
    /// Nothing in it.
    #[error("{path}: empty file")]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// Another kind of file.
    #[error("{path}: not a LAS file{}", instead(.found, *.kind))]
    NotLas {
        /// The file.
        path: PathBuf,
        /// Its first bytes.
        found: Vec<u8>,
        /// What it is, where that can be told.
        kind: Option<&'static Kind>,
    },
    /// Ends inside the header.
    #[error("{path}: ends inside its header: {len} bytes, a LAS {major}.{minor} header has {need}")]
    HeaderCut {
        /// The file.
        path: PathBuf,
        /// Bytes it holds.
        len: u64,
        /// LAS version.
        major: u8,
        /// LAS version.
        minor: u8,
        /// Bytes in a header of that version.
        need: u64,
    },
    /// A header field without which no point can be placed.
    #[error("{path}: header byte {offset}: {field} is {value}, {reason}")]
    Header {
        /// The file.
        path: PathBuf,
        /// First byte of the field.
        offset: u64,
        /// The field.
        field: &'static str,
        /// Its value.
        value: String,
        /// What is wrong with it.
        reason: String,
    },
    /// LAZ whose compression cannot be understood.
    #[error("{path}: byte {offset}: LASzip record: {reason}")]
    Laszip {
        /// The file.
        path: PathBuf,
        /// Where the record lies (0 if there is none).
        offset: u64,
        /// What is wrong with it.
        reason: String,
    },
    /// A variable length record that cannot be read.
    #[error("{path}: byte {offset}: record \"{user_id}\" {record_id} of {len} bytes: {reason}")]
    Vlr {
        /// The file.
        path: PathBuf,
        /// Where its payload lies.
        offset: u64,
        /// Who defined it.
        user_id: String,
        /// Which it is.
        record_id: u16,
        /// Bytes of payload.
        len: u64,
        /// What is wrong with it.
        reason: String,
    },
    /// A chunk that cannot be read, or not to its end. Points before the damage were handed out.
    #[error("{path}: chunk {chunk} at byte {offset}: {reason} ({read} of {records} points read)")]
    Chunk {
        /// The file.
        path: PathBuf,
        /// Index of the chunk.
        chunk: u64,
        /// First byte of the chunk.
        offset: u64,
        /// Points handed out before the damage.
        read: u64,
        /// Points asked for.
        records: u64,
        /// What is wrong with it.
        reason: String,
    },
}

fn instead(found: &[u8], kind: Option<&Kind>) -> String {
    match kind {
        Some(kind) => format!(" but {kind}"),
        None => format!(": starts with \"{}\" instead of \"LASF\"", found.escape_ascii()),
    }
}

/// What is wrong with a file that can be read all the same, in part or in whole.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Warning {
    /// The file holds fewer points than its header says.
    #[error("header claims {claimed} points, {readable} can be read, {} are missing", claimed - readable)]
    PointsMissing {
        /// Count in the header.
        claimed: u64,
        /// Points that the file's length or its chunk table allows for.
        readable: u64,
    },
    /// The file holds more points than its header says.
    #[error("header claims {claimed} points, the file holds {found}; {read} are read")]
    PointsUnclaimed {
        /// Count in the header.
        claimed: u64,
        /// Points found.
        found: u64,
        /// Points that will be read.
        read: u64,
    },
    /// The two point counts of a LAS 1.4 header differ.
    #[error(
        "header bytes 107 and 247: 32-bit point count is {legacy}, 64-bit count is {large}; {used} is used: {why}"
    )]
    CountsDiffer {
        /// The 32-bit count.
        legacy: u32,
        /// The 64-bit count.
        large: u64,
        /// The one in use.
        used: u64,
        /// Why.
        why: &'static str,
    },
    /// LASzip's compatibility mode, with something about it that cannot be.
    #[error("byte {offset}: LASzip compatibility record: {reason}")]
    Compatibility {
        /// Where the record lies.
        offset: u64,
        /// What is wrong with it, and what is done.
        reason: String,
    },
    /// Bounds in the header that are no bounds.
    #[error("header byte 179: bounds are not finite or inverted")]
    Bounds,
    /// The header's own length is shorter than its version's.
    #[error("header byte 94: header size is {claimed}, a LAS {major}.{minor} header has {need} bytes")]
    HeaderSize {
        /// Size in the header.
        claimed: u16,
        /// LAS version.
        major: u8,
        /// LAS version.
        minor: u8,
        /// Bytes in a header of that version.
        need: u16,
    },
    /// Variable length records that lie outside of their place, or of the file.
    #[error("byte {offset}: {reason}; {read} of {claimed} {kind} read")]
    Vlrs {
        /// "variable length records" or "extended variable length records".
        kind: &'static str,
        /// Count in the header.
        claimed: u64,
        /// Records that could be indexed.
        read: u64,
        /// Where the walk ended.
        offset: u64,
        /// Why.
        reason: String,
    },
    /// A chunk table that is missing or broken.
    #[error("byte {offset}: chunk table: {reason}; {rescue}")]
    ChunkTable {
        /// Where the table lies, or should.
        offset: u64,
        /// What is wrong with it.
        reason: String,
        /// What is read all the same, and what is lost.
        rescue: String,
    },
    /// A COPC hierarchy that cannot be used.
    #[error("byte {offset}: COPC hierarchy: {reason}; the chunk table is used instead")]
    CopcHierarchy {
        /// Where it is wrong.
        offset: u64,
        /// What is wrong with it.
        reason: String,
    },
}
