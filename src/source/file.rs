//! A file that was opened: its header, its variable length records, and the index of its chunks, all checked against the
//! file's length. No point is read here.

use super::{
    Chunk, Copc, FileBytes, FileHeader, SourceError, VlrEntry, Warning, chunks, compatible, copc, header,
    laszip::{self, Laszip},
    vlr,
};
use glam::DVec3;
use std::path::Path;
use xxhash_rust::xxh3::Xxh3Default;

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
    pub(super) laszip: Option<Laszip>,
    /// The last chunk's count is an upper bound: it ends with its bytes.
    pub(super) open_end: bool,
    /// Of its header and its chunks.
    digest: u64,
}

impl LidarFile {
    /// Opens `path`, checks it and indexes its chunks; reads no points, and closes the file again.
    pub fn open(path: &Path) -> Result<LidarFile, SourceError> {
        let bytes = FileBytes::open(path)?;
        let mut warnings = Vec::new();
        let parsed = header::read(&bytes, &mut warnings)?;
        let mut header = parsed.header;

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

        compatible::undo(&bytes, &mut header, &vlrs, &mut warnings)?;
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
        file.index_chunks()?;
        file.digest = digest(&parsed.raw, &file.chunks);
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
        let laszip = Laszip::read(&self.bytes, &self.vlrs, &self.header)?;
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

/// Digest of a header's bytes and of the chunks that were found.
fn digest(header: &[u8], chunks: &[Chunk]) -> u64 {
    let mut digest = Xxh3Default::new();
    digest.update(header);
    for Chunk { byte_offset, byte_len, first_record, records, .. } in chunks {
        for number in [byte_offset, byte_len, first_record, records] {
            digest.update(&number.to_le_bytes());
        }
    }
    digest.digest()
}
