//! LASzip's compatibility mode, undone: LAS 1.4 points that were written so that readers of older versions can open
//! them.
//!
//! Points of formats 6 to 10 lie in records of formats 1, 3, 4 or 5 of a LAS 1.0 to 1.3 file, and what those have no
//! room for lies in five (with near infrared: seven) extra bytes of each record, which the extra bytes record
//! (`LASF_Spec` 4; LAS 1.4 R15, table 24: 192 bytes an entry) names:
//!
//! | entry | type | what is in it |
//! |---|---|---|
//! | `LAS 1.4 scan angle` | i16 | steps of 0.006° to be added to the rank |
//! | `LAS 1.4 extended returns` | u8 | to be added: high nibble to the return number, low one to the number of returns |
//! | `LAS 1.4 classification` | u8 | to be added to the class: classes above 31 are kept as 0 |
//! | `LAS 1.4 flags and channel` | u8 | bit 0: overlap; bits 1 and 2: scanner channel |
//! | `LAS 1.4 NIR band` | u16 | formats 8 and 10 alone |
//!
//! The record `lascompatible` 22204 says that it is so, in 156 bytes or more: u16 LASzip's version, u16 the mode's
//! version, u32 unused, then the part of a LAS 1.4 header that older ones lack: u64 start of waveforms, u64 first
//! extended record, u32 how many of those, u64 point count (byte 28), 15 x u64 points by return. Writers fill the part
//! in or leave it at 0. A file that another program has cut out of such a one carries the record along, so its own
//! count is the better one.
//! Source: LASzip, `laszip_dll.cpp`, `laszip_open_reader` and `laszip_read_point`.

use super::{
    FileBytes, FileHeader, SourceError, VlrEntry, Warning, header::FORMAT_LEN, kept_apart::KeptApart,
};

/// Least bytes of the record that names the mode.
const RECORD_LEN: u64 = 156;
/// Where the 64-bit point count lies in it.
const COUNT_AT: usize = 28;
/// Bytes of an entry of the extra bytes record, and where its name lies.
const ENTRY: usize = 192;
const NAME: std::ops::Range<usize> = 4..36;
/// Most bytes of an extra bytes record: it has a 16-bit length.
const MAX_ENTRIES: u64 = 65_535;

/// Makes `header` that of the LAS 1.4 file which the file stands for, if it is such a one. `vlrs`: all records of the
/// file.
pub(super) fn undo(
    bytes: &FileBytes,
    header: &mut FileHeader,
    vlrs: &[VlrEntry],
    warnings: &mut Vec<Warning>,
) -> Result<(), SourceError> {
    let vlr = |user_id: &str, record_id: u16| vlrs.iter().find(|v| v.is(user_id, record_id));
    if header.version.1 > 3 || !matches!(header.format, 1 | 3 | 4 | 5) {
        return Ok(());
    }
    let Some(record) = vlr("lascompatible", 22204) else { return Ok(()) };
    let offset = record.offset;
    let odd = |reason: String| Warning::Compatibility { offset, reason };
    if record.len < RECORD_LEN {
        let format = header.format;
        let reason = format!(
            "{} bytes, at least {RECORD_LEN} are needed: points are read as format {format}",
            record.len
        );
        warnings.push(odd(reason));
        return Ok(());
    }
    let entries = match vlr("LASF_Spec", 4) {
        Some(entries) => entries.read(bytes, MAX_ENTRIES)?,
        None => Vec::new(),
    };
    let (kept_apart, has_infrared) = match find(&entries, header) {
        Ok(found) => found,
        Err(reason) => {
            warnings.push(odd(format!("{reason}: points are read as format {}", header.format)));
            return Ok(());
        }
    };
    let payload = record.read(bytes, u64::from(u16::MAX))?;
    let mut count = [0; 8];
    count.copy_from_slice(&payload[COUNT_AT..COUNT_AT + 8]);
    let (large, claimed) = (u64::from_le_bytes(count), header.claimed_points);
    let has_wkt = vlr("LASF_Projection", 2112).is_some();

    header.kept_apart = Some(kept_apart);
    header.format = match (header.stored_format, has_infrared) {
        (1, _) => 6,
        (3, false) => 7,
        (3, true) => 8,
        (4, _) => 9,
        _ => 10,
    };
    if has_wkt {
        header.global_encoding |= 16;
    }
    // A header counts to 32 bits; what counts less was cut out of a larger file, and took the record along.
    if claimed == 0 || claimed == u64::from(u32::MAX) && large > claimed {
        header.claimed_points = large;
    } else if large != 0 && large != claimed {
        warnings.push(odd(format!("it counts {large} points, the header {claimed}; {claimed} is used")));
    }
    Ok(())
}

/// Where the entries say that the fields lie, and whether there is near infrared.
fn find(entries: &[u8], header: &FileHeader) -> Result<(KeptApart, bool), String> {
    let base = usize::from(FORMAT_LEN[usize::from(header.stored_format)]);
    let mut fields = Vec::new();
    let mut at = base;
    for entry in entries.chunks_exact(ENTRY) {
        let name = &entry[NAME];
        let name = &name[..name.iter().position(|&b| b == 0).unwrap_or(name.len())];
        let len = entry_len(entry[2], entry[3]);
        fields.push((name, at, len));
        at += len;
    }
    let field = |name: &str, len: usize| {
        let found = fields.iter().find(|(known, _, _)| *known == name.as_bytes());
        let &(_, at, has) = found.ok_or_else(|| format!("the extra bytes record names no \"{name}\""))?;
        let fits = at + len <= usize::from(header.record_len);
        (has == len && fits).then_some(at).ok_or_else(|| {
            format!("\"{name}\" has {has} bytes from byte {at} of a record of {}", header.record_len)
        })
    };
    let kept_apart = KeptApart {
        angle: field("LAS 1.4 scan angle", 2)?,
        returns: field("LAS 1.4 extended returns", 1)?,
        class: field("LAS 1.4 classification", 1)?,
        flags: field("LAS 1.4 flags and channel", 1)?,
    };
    Ok((kept_apart, field("LAS 1.4 NIR band", 2).is_ok()))
}

/// Bytes that an entry of this type takes in a record (LAS 1.4 R15, table 25; pairs and triples as R11 had them).
fn entry_len(kind: u8, options: u8) -> usize {
    const ONE: [usize; 10] = [1, 1, 2, 2, 4, 4, 8, 8, 4, 8];
    match usize::from(kind) {
        // Bytes without a meaning: the options say how many.
        0 => options.into(),
        kind @ 1..=30 => ONE[(kind - 1) % 10] * ((kind - 1) / 10 + 1),
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_have_the_lengths_of_their_types() {
        assert_eq!((entry_len(4, 6), entry_len(13, 0), entry_len(0, 7)), (2, 4, 7));
    }
}
