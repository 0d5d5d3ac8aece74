//! Files in, points out: headers, chunk index, decoding in blocks of columns.
//!
//! [`LidarFile::open`] reads the header, the index of variable length records and the index of chunks,
//! each checked against the file's length. A [`Decoder`] (one a worker thread) turns chunks into
//! [`PointBlock`]s. Nothing is printed here: what is wrong is a [`SourceError`], or a [`Warning`] in
//! [`LidarFile::warnings`] where points can be read all the same.

mod bytes;
mod chunks;
mod compatible;
pub(crate) mod contain;
mod copc;
pub mod crs;
mod decode;
mod error;
mod fields;
mod header;
pub mod inputs;
pub mod kinds;
pub mod known;
mod laszip;
pub mod lax;
mod layers;
pub mod learned;
pub mod placement;
pub mod reproject;
mod stream;
pub mod system;
mod vlr;
mod wkt;

pub use bytes::{FileBytes, OpenFile, time_reading};
pub use copc::{Copc, VoxelKey};
pub use decode::{Decoder, LayerMemory};
pub use error::{SourceError, Warning};
pub use header::FileHeader;
pub use vlr::VlrEntry;

use glam::DVec3;
use std::path::Path;

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
#[derive(Clone, Debug, Default, PartialEq)]
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

impl PointBlock {
    /// Points in it.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// Whether it holds no point.
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }
}

/// Class flag: made by other means than the laser (LAS 1.4 R15, table 9).
pub const FLAG_SYNTHETIC: u8 = 1;
/// Class flag: model key-point.
pub const FLAG_KEY_POINT: u8 = 2;
/// Class flag: withheld, i.e. deleted.
pub const FLAG_WITHHELD: u8 = 4;
/// Class flag: in the overlap of two flight lines (formats 6-10).
pub const FLAG_OVERLAP: u8 = 8;

/// An opened LAS, LAZ or COPC file: everything but the points.
#[derive(Debug)]
pub struct LidarFile {
    /// The file's bytes; [`FileBytes::release`] closes it until it is read again.
    pub bytes: FileBytes,
    /// The header.
    pub header: FileHeader,
    /// Variable length records, extended ones last.
    pub vlrs: Vec<VlrEntry>,
    /// All that can be read, in file order.
    pub chunks: Vec<Chunk>,
    /// The octree, if it is a COPC file with a sane hierarchy; then each chunk is a node.
    pub copc: Option<Copc>,
    /// What is wrong with it; the points that are missing are counted.
    pub warnings: Vec<Warning>,
    /// How its points are compressed.
    laszip: Option<laszip::Laszip>,
    /// The last chunk's count is an upper bound: it ends with its bytes.
    open_end: bool,
    /// Of its header and its chunks.
    digest: u64,
}

impl LidarFile {
    /// Opens `path`, checks it and indexes its chunks; reads no points, and closes the file again.
    pub fn open(path: &Path) -> Result<LidarFile, SourceError> {
        let bytes = FileBytes::open(path)?;
        let mut warnings = Vec::new();
        let parsed = header::read(&bytes, &mut warnings)?;
        let header = parsed.header;

        let mut vlrs = Vec::new();
        let walk = vlr::Walk {
            extended: false,
            start: parsed.vlr_start,
            claimed: parsed.vlr_count,
            end: header.offset_to_points,
        };
        walk.run(&bytes, &mut vlrs, &mut warnings)?;
        if let Some((start, claimed)) = parsed.evlrs {
            let walk = vlr::Walk { extended: true, start, claimed, end: bytes.len() };
            walk.run(&bytes, &mut vlrs, &mut warnings)?;
        }

        let mut file = LidarFile {
            bytes,
            header,
            vlrs,
            chunks: Vec::new(),
            copc: None,
            warnings,
            laszip: None,
            open_end: false,
            digest: 0,
        };
        compatible::undo(&mut file)?;
        file.index_chunks()?;
        file.digest = learned::digest(&parsed.raw, &file.chunks);
        file.bytes.release();
        Ok(file)
    }

    fn index_chunks(&mut self) -> Result<(), SourceError> {
        if !self.header.compressed {
            // Records may not run into an extended record that was found behind them.
            let first_evlr = self.vlrs.iter().find(|v| v.extended).map(|v| v.offset - vlr::EVLR_HEADER);
            let end = first_evlr.filter(|&e| e >= self.header.offset_to_points).unwrap_or(self.bytes.len());
            self.chunks = chunks::index_las(&self.header, end, &mut self.warnings).chunks;
            return Ok(());
        }
        let laszip = laszip::Laszip::read(&self.bytes, &self.vlrs, &self.header)?;
        if let Some((start, claimed)) = laszip.special_evlrs {
            // Records that LAStools has appended, of which the header does not know.
            let walk = vlr::Walk { extended: true, start, claimed, end: self.bytes.len() };
            walk.run(&self.bytes, &mut self.vlrs, &mut self.warnings)?;
        }
        let laszip = self.laszip.insert(laszip);
        if let Some(info) = self.vlrs.iter().find(|v| v.is("copc", 1))
            && laszip.compressor == laszip::Compressor::Layered
        {
            match copc::read(&self.bytes, &self.header, info) {
                Ok((copc, chunks)) => {
                    self.header.copc = true;
                    (self.copc, self.chunks) = (Some(copc), chunks);
                    return Ok(());
                }
                Err(copc::Broken::Source(error)) => return Err(error),
                Err(copc::Broken::Hierarchy { offset, reason }) => {
                    self.warnings.push(Warning::CopcHierarchy { offset, reason });
                }
            }
        }
        let index = chunks::index_laz(&self.bytes, &self.header, laszip, &mut self.warnings)?;
        (self.chunks, self.open_end) = (index.chunks, index.open_end);
        Ok(())
    }

    /// Where it lies.
    pub fn path(&self) -> &Path {
        self.bytes.path()
    }

    /// Points that its chunks hold (what its header claims, unless there is a warning).
    pub fn points(&self) -> u64 {
        self.chunks.last().map_or(0, |c| c.first_record + c.records)
    }

    /// Lower and upper bounds of a chunk in CRS units, where they are known without decoding it (COPC).
    pub fn chunk_bounds(&self, chunk: &Chunk) -> Option<[DVec3; 2]> {
        let copc = self.copc.as_ref()?;
        copc.nodes.get(chunk.index as usize).map(|&key| copc.bounds(key))
    }

    /// Tells this file from another one of the same size: of its header and of where its chunks lie.
    pub fn digest(&self) -> u64 {
        self.digest
    }

    /// The first variable length record of that name, extended or not.
    pub fn vlr(&self, user_id: &str, record_id: u16) -> Option<&VlrEntry> {
        self.vlrs.iter().find(|v| v.is(user_id, record_id))
    }
}
