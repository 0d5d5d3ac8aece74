//! Positioned reads: `pread`.

use std::{fs::File, io, os::unix::fs::FileExt};

/// Reads up to `buf.len()` bytes at `offset`; 0 at the end of the file.
pub(super) fn read_at(file: &File, buf: &mut [u8], offset: u64) -> io::Result<usize> {
    file.read_at(buf, offset)
}
