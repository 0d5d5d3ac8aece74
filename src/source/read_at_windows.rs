//! Positioned reads: `ReadFile` with an `OVERLAPPED` offset (moves the handle's cursor, which nobody uses).

use std::{fs::File, io, os::windows::fs::FileExt};

/// Reads up to `buf.len()` bytes at `offset`; 0 at the end of the file.
pub(super) fn read_at(file: &File, buf: &mut [u8], offset: u64) -> io::Result<usize> {
    file.seek_read(buf, offset)
}
