//! Files in, points out: headers, chunk index, decoding in blocks of columns.

pub mod crs;
pub mod inputs;
pub mod placement;
mod wkt;

use glam::DVec3;
use std::path::PathBuf;

/// Most records a [`PointBlock`] holds.
pub const BLOCK_RECORDS: usize = 65_536;

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

/// Up to [`BLOCK_RECORDS`] decoded points of one chunk, as columns of equal length.
#[derive(Debug, Default)]
pub struct PointBlock {
    /// Index in the file of the block's first record.
    pub first_record: u64,
    /// Raw X of the record (E = X · scale + offset).
    pub x: Vec<i32>,
    /// Raw Y.
    pub y: Vec<i32>,
    /// Raw Z.
    pub z: Vec<i32>,
    /// ASPRS class, the whole byte (formats 0-5: the low five bits).
    pub class: Vec<u8>,
    /// [`FLAG_SYNTHETIC`] and its neighbours.
    pub flags: Vec<u8>,
    /// Pulse return magnitude.
    pub intensity: Vec<u16>,
    /// Return number in the low nibble, number of returns in the high nibble.
    pub returns: Vec<u8>,
    /// R, G, B as stored; empty when the format has none.
    pub rgb: Vec<[u16; 3]>,
}

/// Class flag: made by other means than the laser (LAS 1.4 R15, table 9).
pub const FLAG_SYNTHETIC: u8 = 1;
/// Class flag: model key-point.
pub const FLAG_KEY_POINT: u8 = 2;
/// Class flag: withheld, i.e. deleted.
pub const FLAG_WITHHELD: u8 = 4;
/// Class flag: in the overlap of two flight lines (formats 6-10).
pub const FLAG_OVERLAP: u8 = 8;

/// The part of a LAS header that matters here; every field as stored, checked where its comment says so.
#[derive(Clone, Debug)]
pub struct FileHeader {
    /// LAS version, major and minor.
    pub version: (u8, u8),
    /// Point data record format, 0 to 10 (checked), without the compression bits.
    pub format: u8,
    /// LAZ.
    pub compressed: bool,
    /// A COPC info VLR is present and sane.
    pub copc: bool,
    /// Bytes in a record (checked: at least the format's).
    pub record_len: u16,
    /// X, Y, Z scale (checked: finite, positive).
    pub scale: DVec3,
    /// X, Y, Z offset (checked: finite).
    pub offset: DVec3,
    /// Lower bounds as stored: may be NaN, infinite, inverted or simply wrong.
    pub min: DVec3,
    /// Upper bounds as stored: likewise.
    pub max: DVec3,
    /// Point count as stored.
    pub claimed_points: u64,
}

/// What cannot be read, and why.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// Named file cannot be opened or read.
    #[error("{path}: {what}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What was tried.
        what: String,
        /// The system's word.
        source: std::io::Error,
    },
}
