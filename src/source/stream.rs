//! A range of a file as a bounded stream for the decoders.

use super::{OpenFile, SourceError};
use std::{
    io::{self, Read, Seek, SeekFrom},
    ops::Range,
};

/// Bytes that are read at a time, and at first: often a few points at the start are all that is wanted.
const READ_BYTES: u64 = 256 << 10;
const FIRST_BYTES: u64 = 16 << 10;

/// A buffered stream over a byte range; `UnexpectedEof` at its end. An error of the file itself travels
/// inside the `io::Error`, see [`source_error`].
pub(super) struct ByteStream<'f> {
    file: OpenFile<'f>,
    buf: Vec<u8>,
    at: usize,
    /// What has not been read into `buf`.
    rest: Range<u64>,
}

impl<'f> ByteStream<'f> {
    /// Streams `range`, which lies inside the file; `buf` is scratch memory.
    pub fn new(file: OpenFile<'f>, mut buf: Vec<u8>, range: Range<u64>) -> ByteStream<'f> {
        buf.clear();
        ByteStream { file, buf, at: 0, rest: range }
    }

    /// Whether no byte is left.
    #[inline]
    pub fn exhausted(&self) -> bool {
        self.at == self.buf.len() && self.rest.is_empty()
    }

    /// Gives the scratch memory back.
    pub fn into_buf(self) -> Vec<u8> {
        self.buf
    }

    #[cold]
    fn read_slowly(&mut self, mut out: &mut [u8]) -> io::Result<()> {
        while !out.is_empty() {
            let n = self.read(out)?;
            if n == 0 {
                return Err(io::Error::new(io::ErrorKind::UnexpectedEof, "its compressed data end early"));
            }
            out = &mut out[n..];
        }
        Ok(())
    }
}

impl Read for ByteStream<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.at == self.buf.len() && !self.rest.is_empty() {
            let n = (2 * self.buf.len() as u64).clamp(FIRST_BYTES, READ_BYTES);
            let n = n.min(self.rest.end - self.rest.start);
            self.buf.resize(n as usize, 0);
            self.at = 0;
            if let Err(e) = self.file.read_exact_at(&mut self.buf, self.rest.start) {
                self.buf.clear();
                return Err(io::Error::other(e));
            }
            self.rest.start += n;
        }
        let n = out.len().min(self.buf.len() - self.at);
        out[..n].copy_from_slice(&self.buf[self.at..self.at + n]);
        self.at += n;
        Ok(n)
    }

    #[inline]
    fn read_exact(&mut self, out: &mut [u8]) -> io::Result<()> {
        match self.buf.get(self.at..self.at + out.len()) {
            Some(bytes) => {
                out.copy_from_slice(bytes);
                self.at += out.len();
                Ok(())
            }
            None => self.read_slowly(out),
        }
    }
}

/// Bytes made up in front, then ranges of a file, read straight into the caller's memory: a layered chunk
/// without the layers that nobody needs.
pub(super) struct Splice<'f> {
    pub front: io::Cursor<Vec<u8>>,
    pub file: OpenFile<'f>,
    pub ranges: Vec<Range<u64>>,
}

impl Read for Splice<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let n = self.front.read(out)?;
        if n > 0 {
            return Ok(n);
        }
        let Some(range) = self.ranges.iter_mut().find(|r| !r.is_empty()) else { return Ok(0) };
        let n = (range.end - range.start).min(out.len() as u64);
        self.file.read_exact_at(&mut out[..n as usize], range.start).map_err(io::Error::other)?;
        range.start += n;
        Ok(n as usize)
    }
}

impl Seek for Splice<'_> {
    /// Asked for by the decoder's bounds only: it seeks over layers that are not wanted, and none is here.
    fn seek(&mut self, _: SeekFrom) -> io::Result<u64> {
        Err(io::ErrorKind::Unsupported.into())
    }
}

/// The file's own error inside of `error`, if that is what it is.
pub(super) fn source_error(error: io::Error) -> Result<SourceError, io::Error> {
    error.downcast::<SourceError>()
}
