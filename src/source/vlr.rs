//! Variable length records (LAS 1.4 R15, 2.5 and 2.7), walked against the file's length.

use super::{FileBytes, SourceError, Warning};
use crate::text::harmless;

/// Most records that are indexed in a file: real files carry a few dozen.
const MAX_RECORDS: u64 = 65_536;

/// Bytes in front of a record's payload.
const VLR_HEADER: u64 = 54;
/// Bytes in front of an extended record's payload.
pub(super) const EVLR_HEADER: u64 = 60;

/// Where a variable length record lies; its payload is read when asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VlrEntry {
    /// Who defined it, without trailing zeros; made harmless.
    pub user_id: String,
    /// Which it is.
    pub record_id: u16,
    /// First byte of its payload.
    pub offset: u64,
    /// Bytes of payload; inside the file.
    pub len: u64,
    /// Stands behind the points (EVLR).
    pub extended: bool,
}

impl VlrEntry {
    /// Whether this is record `record_id` of `user_id`.
    pub fn is(&self, user_id: &str, record_id: u16) -> bool {
        self.record_id == record_id && self.user_id == user_id
    }

    /// Reads the payload if it has at most `limit` bytes.
    pub fn read(&self, bytes: &FileBytes, limit: u64) -> Result<Vec<u8>, SourceError> {
        if self.len > limit {
            return Err(SourceError::Vlr {
                path: bytes.path().to_owned(),
                offset: self.offset,
                user_id: self.user_id.clone(),
                record_id: self.record_id,
                len: self.len,
                reason: format!("longer than the {limit} bytes that are read of it"),
            });
        }
        let mut payload = vec![0; self.len as usize];
        bytes.read_exact_at(&mut payload, self.offset)?;
        Ok(payload)
    }
}

/// One of the two kinds of records, and where they may lie.
pub(super) struct Walk {
    pub extended: bool,
    /// First byte of the first record.
    pub start: u64,
    /// Records that the header claims.
    pub claimed: u64,
    /// First byte that no record may touch.
    pub end: u64,
}

impl Walk {
    /// Appends what can be indexed to `entries`; what cannot becomes a warning.
    pub fn run(
        &self,
        bytes: &FileBytes,
        entries: &mut Vec<VlrEntry>,
        warnings: &mut Vec<Warning>,
    ) -> Result<(), SourceError> {
        let file = bytes.handle()?;
        let end = self.end.min(bytes.len());
        let header_len = if self.extended { EVLR_HEADER } else { VLR_HEADER };
        let mut offset = self.start;
        for read in 0..self.claimed {
            let mut stop = |reason: String| {
                let kind = if self.extended {
                    "extended variable length records"
                } else {
                    "variable length records"
                };
                warnings.push(Warning::Vlrs { kind, claimed: self.claimed, read, offset, reason });
            };
            if read == MAX_RECORDS {
                stop("more records than any real file has".into());
                break;
            }
            if offset.checked_add(header_len).is_none_or(|e| e > end) {
                stop(format!("the next record would begin past byte {end}, where records must end"));
                break;
            }
            let mut raw = [0u8; EVLR_HEADER as usize];
            let raw = &mut raw[..header_len as usize];
            file.read_exact_at(raw, offset)?;
            let len = if self.extended {
                u64::from_le_bytes(raw[20..28].try_into().unwrap())
            } else {
                u64::from(u16::from_le_bytes(raw[20..22].try_into().unwrap()))
            };
            let payload = offset + header_len;
            if payload.checked_add(len).is_none_or(|e| e > end) {
                stop(format!("a record of {len} bytes reaches past byte {end}, where records must end"));
                break;
            }
            let user_id = &raw[2..18];
            let user_id = &user_id[..user_id.iter().position(|&b| b == 0).unwrap_or(16)];
            entries.push(VlrEntry {
                user_id: harmless(&String::from_utf8_lossy(user_id)),
                record_id: u16::from_le_bytes([raw[18], raw[19]]),
                offset: payload,
                len,
                extended: self.extended,
            });
            offset = payload + len;
        }
        Ok(())
    }
}
