//! The public header block, checked against the file (LAS 1.4 R15, 2.4).

use super::{FileBytes, SourceError, Warning, kept_apart::KeptApart};
use crate::text::tidy;
use glam::DVec3;
use std::io::Read;

/// The part of a LAS header that matters here; every field as stored, checked where its comment says so.
#[derive(Clone, Debug)]
pub struct FileHeader {
    /// LAS version, major and minor (checked: 1.0 to 1.4).
    pub version: (u8, u8),
    /// Point data record format, 0 to 10 (checked), without the compression bits: what the points mean.
    pub format: u8,
    /// The format in which the records are kept: another one only in LASzip's compatibility mode.
    pub stored_format: u8,
    /// LAZ.
    pub compressed: bool,
    /// A COPC info VLR is present and sane.
    pub copc: bool,
    /// Global encoding bits; bit 4: the CRS is WKT.
    pub global_encoding: u16,
    /// Bytes in a record (checked: at least the format's).
    pub record_len: u16,
    /// First byte of the point data (checked: behind the header; may lie past the end of the file).
    pub offset_to_points: u64,
    /// X, Y, Z scale (checked: positive, at most 1e6).
    pub scale: DVec3,
    /// X, Y, Z offset (checked: within ±1e12).
    pub offset: DVec3,
    /// Lower bounds as stored: may be NaN, infinite, inverted or simply wrong.
    pub min: DVec3,
    /// Upper bounds as stored: likewise.
    pub max: DVec3,
    /// Point count as stored.
    pub claimed_points: u64,
    /// Where LASzip's compatibility mode keeps what `stored_format` has no room for.
    pub(super) kept_apart: Option<KeptApart>,
}

/// What [`read`] found, with what only the walk over the records needs.
pub(super) struct Parsed {
    pub header: FileHeader,
    /// Its bytes, as far as the longest kind reaches.
    pub raw: Vec<u8>,
    /// Where the variable length records begin.
    pub vlr_start: u64,
    pub vlr_count: u64,
    /// First byte and count of the extended records; LAS 1.4 only.
    pub evlrs: Option<(u64, u64)>,
}

/// Bytes in a record of each format (LAS 1.4 R15, tables 7 to 18).
pub(super) const FORMAT_LEN: [u16; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];

/// Nothing is measured in coarser steps; a broken field that is let through would put the file so far away that
/// others shrink to a dot beside it.
const MOST_SCALE: f64 = 1e6;
/// The Earth is 4e10 mm around.
const MOST_OFFSET: f64 = 1e12;

/// Bytes in the header of LAS 1.`minor`.
fn header_len(minor: u8) -> u16 {
    match minor {
        0..=2 => 227,
        3 => 235,
        _ => 375,
    }
}

/// The two point counts of a LAS 1.4 header, where they may differ.
struct Counts {
    legacy: u32,
    large: u64,
    /// Records that the file has room for, where they are not compressed and nothing is left over.
    held: Option<u64>,
}

impl Counts {
    /// The count that is to be believed, and why. LAS 1.4 R15, 2.4: in formats 6 to 10 the 32-bit count must be 0,
    /// so only the other one counts; in formats 0 to 5 it is the same number, and readers of older versions know no
    /// other.
    fn choose(&self, format: u8) -> (u64, &'static str) {
        let legacy = u64::from(self.legacy);
        if format >= 6 {
            return match (self.large, legacy) {
                (0, 1..) => (legacy, "the other one is 0"),
                _ => (self.large, "point formats 6 to 10 have no 32-bit count"),
            };
        }
        match self.large {
            0 => (legacy, "the other one is 0"),
            large if legacy == 0 => (large, "the other one is 0"),
            large if large > u64::from(u32::MAX) => (large, "the other one cannot hold as many"),
            large if self.held == Some(large) => (large, "the file is as long as that"),
            _ => (legacy, "it is the one that readers of all versions go by"),
        }
    }
}

/// Points that the header claims: of two counts the one that is meant.
fn claimed_points(bytes: &FileBytes, raw: &las::raw::Header, format: u8, warnings: &mut Vec<Warning>) -> u64 {
    let compressed = raw.point_data_record_format & 0x80 != 0;
    let record_len = raw.point_data_record_length;
    let offset_to_points = u64::from(raw.offset_to_point_data);
    match &raw.large_file {
        Some(large) => {
            // Points end where the first extended record begins, if that is where there are any.
            let evlrs = raw
                .evlr
                .as_ref()
                .filter(|evlr| evlr.number_of_evlrs > 0)
                .map(|evlr| evlr.start_of_first_evlr);
            let end = evlrs.filter(|&at| at > offset_to_points).map_or(bytes.len(), |at| at.min(bytes.len()));
            let room = end.saturating_sub(offset_to_points);
            let counts = Counts {
                legacy: raw.number_of_point_records,
                large: large.number_of_point_records,
                // What compressed points take tells nothing of how many they are.
                held: (!compressed && room % u64::from(record_len) == 0)
                    .then_some(room / u64::from(record_len)),
            };
            let (used, why) = counts.choose(format);
            let Counts { legacy, large, .. } = counts;
            // A 32-bit count of 0 says that the other one is meant.
            if legacy != 0 && u64::from(legacy) != large {
                warnings.push(Warning::CountsDiffer { legacy, large, used, why });
            }
            used
        }
        None => u64::from(raw.number_of_point_records),
    }
}

/// Reads the header and checks what the rest relies on.
pub(super) fn read(bytes: &FileBytes, warnings: &mut Vec<Warning>) -> Result<Parsed, SourceError> {
    let path = || bytes.path().to_owned();
    let bad = |offset, field, value: String, reason: &str| SourceError::Header {
        path: path(),
        offset,
        field,
        value,
        reason: reason.into(),
    };
    if bytes.is_empty() {
        return Err(SourceError::Empty { path: path() });
    }
    let mut start = [0u8; 375];
    let have = bytes.len().min(start.len() as u64) as usize;
    bytes.read_exact_at(&mut start[..have], 0)?;
    if start[..have.min(4)] != b"LASF"[..have.min(4)] {
        let kind = super::kinds::of_file(&start[..have], bytes.path());
        return Err(SourceError::NotLas { path: path(), found: start[..have.min(4)].to_vec(), kind });
    }
    let (major, minor) = (start[24], start[25]);
    // A file that ends before its version is judged as the shortest kind.
    if have >= 26 && (major != 1 || minor > 4) {
        return Err(bad(24, "version", format!("{major}.{minor}"), "not one of 1.0 to 1.4"));
    }
    let need = header_len(minor);
    if have < usize::from(need) {
        return Err(SourceError::HeaderCut {
            path: path(),
            len: bytes.len(),
            major,
            minor,
            need: need.into(),
        });
    }
    // Zeros behind the end stand for padding that a wrong header size claims (65,535 bytes at most).
    let raw = las::raw::Header::read_from(start.chain(std::io::repeat(0)))
        .map_err(|e| bad(0, "header", "not readable".into(), &e.to_string()))?;

    let format_byte = raw.point_data_record_format;
    let (format, compressed) = (format_byte & 0x3f, format_byte & 0x80 != 0);
    if format > 10 || format_byte & 0x40 != 0 {
        return Err(bad(
            104,
            "point format",
            format_byte.to_string(),
            "not one of 0 to 10, or 128 to 138 for LAZ",
        ));
    }
    let (record_len, least) = (raw.point_data_record_length, FORMAT_LEN[usize::from(format)]);
    if record_len < least {
        let reason = format!("a record of format {format} has at least {least} bytes");
        return Err(bad(105, "point record length", record_len.to_string(), &reason));
    }
    let axes = [
        (131, "X scale", raw.x_scale_factor, 155, "X offset", raw.x_offset),
        (139, "Y scale", raw.y_scale_factor, 163, "Y offset", raw.y_offset),
        (147, "Z scale", raw.z_scale_factor, 171, "Z offset", raw.z_offset),
    ];
    for (scale_at, scale_name, scale, offset_at, offset_name, offset) in axes {
        if !(scale > 0.0 && scale <= MOST_SCALE) {
            let reason = format!("must be above 0 and at most {MOST_SCALE:e}");
            return Err(bad(scale_at, scale_name, tidy(scale), &reason));
        }
        if offset.is_nan() || offset.abs() > MOST_OFFSET {
            let reason = format!("must lie within ±{MOST_OFFSET:e}");
            return Err(bad(offset_at, offset_name, tidy(offset), &reason));
        }
    }
    let offset_to_points = u64::from(raw.offset_to_point_data);
    if offset_to_points < u64::from(need) {
        let reason = format!("points cannot begin inside a header of {need} bytes");
        return Err(bad(96, "offset to point data", offset_to_points.to_string(), &reason));
    }
    let claimed_points = claimed_points(bytes, &raw, format, warnings);
    if claimed_points > 0 && offset_to_points > bytes.len() {
        let reason = format!("the file ends at {}", bytes.len());
        return Err(bad(96, "offset to point data", offset_to_points.to_string(), &reason));
    }
    if raw.header_size < need {
        warnings.push(Warning::HeaderSize { claimed: raw.header_size, major, minor, need });
    }

    let (min, max) =
        (DVec3::new(raw.min_x, raw.min_y, raw.min_z), DVec3::new(raw.max_x, raw.max_y, raw.max_z));
    if claimed_points > 0 && !(min.is_finite() && max.is_finite() && min.cmple(max).all()) {
        warnings.push(Warning::Bounds);
    }
    Ok(Parsed {
        raw: start[..have].to_vec(),
        header: FileHeader {
            version: (major, minor),
            format,
            stored_format: format,
            compressed,
            copc: false,
            global_encoding: raw.global_encoding,
            record_len,
            offset_to_points,
            scale: DVec3::new(raw.x_scale_factor, raw.y_scale_factor, raw.z_scale_factor),
            offset: DVec3::new(raw.x_offset, raw.y_offset, raw.z_offset),
            min,
            max,
            claimed_points,
            kept_apart: None,
        },
        vlr_start: u64::from(raw.header_size.max(need)),
        vlr_count: u64::from(raw.number_of_variable_length_records),
        evlrs: raw.evlr.map(|e| (e.start_of_first_evlr, u64::from(e.number_of_evlrs))),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_count_that_is_meant_is_used() {
        let choose = |format, legacy, large, held| Counts { legacy, large, held }.choose(format).0;
        // Formats 6 to 10: the 64-bit count, whatever the file's length says.
        assert_eq!(choose(6, 100, 6000, Some(6000)), 6000);
        assert_eq!(choose(6, 100, 6000, Some(100)), 6000);
        assert_eq!(choose(10, u32::MAX, 6000, None), 6000);
        // Somebody who knew only the other one.
        assert_eq!(choose(7, 100, 0, None), 100);
        // Formats 0 to 5: the 32-bit count, unless it is 0, too small for the other, or plainly wrong.
        assert_eq!(choose(1, 100, 6000, None), 100);
        assert_eq!(choose(1, 100, 6000, Some(100)), 100);
        assert_eq!(choose(1, 100, 6000, Some(3000)), 100);
        assert_eq!(choose(1, 100, 6000, Some(6000)), 6000);
        assert_eq!(choose(3, 0, 6000, None), 6000);
        assert_eq!(choose(3, 100, 0, None), 100);
        assert_eq!(choose(3, 705_032_704, 5_000_000_000, None), 5_000_000_000);
    }
}
