//! A file as bytes: positioned reads against a length that was checked once.

use super::SourceError;
use std::{
    cell::Cell,
    fs::File,
    io,
    path::{Path, PathBuf},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant, SystemTime},
};

thread_local! {
    static READING: Cell<Duration> = const { Cell::new(Duration::ZERO) };
}

/// How long the calling thread has spent in positioned reads since it started.
pub fn time_reading() -> Duration {
    READING.get()
}

#[cfg(unix)]
#[path = "read_at_unix.rs"]
mod read_at;
#[cfg(windows)]
#[path = "read_at_windows.rs"]
mod read_at;

/// A file that is opened when it is first read and can be closed in between, so that thousands may be
/// listed. All offsets hold for the length it had at first: a file that has changed since is an error.
#[derive(Debug)]
pub struct FileBytes {
    path: PathBuf,
    len: u64,
    modified: Option<SystemTime>,
    handle: Mutex<Option<Arc<File>>>,
}

/// An open handle with positioned reads; keeps the file open until dropped.
#[derive(Clone, Debug)]
pub struct OpenFile<'f> {
    bytes: &'f FileBytes,
    file: Arc<File>,
}

impl FileBytes {
    /// Opens `path` and notes its length.
    pub fn open(path: &Path) -> Result<FileBytes, SourceError> {
        let io_error =
            |what: &str, source| SourceError::Io { path: path.to_owned(), what: what.into(), source };
        // Asked of the path first: opening a pipe would wait for its writer.
        let metadata = std::fs::metadata(path).map_err(|e| io_error("cannot open", e))?;
        if !metadata.is_file() {
            return Err(io_error("cannot open", io::Error::other("not a regular file")));
        }
        let file = File::open(path).map_err(|e| io_error("cannot open", e))?;
        let metadata = file.metadata().map_err(|e| io_error("cannot ask its length", e))?;
        Ok(FileBytes {
            path: path.to_owned(),
            len: metadata.len(),
            modified: metadata.modified().ok(),
            handle: Mutex::new(Some(Arc::new(file))),
        })
    }

    /// Where it lies.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Bytes it held when it was first opened.
    pub fn len(&self) -> u64 {
        self.len
    }

    /// When it had been changed last, where the system tells.
    pub fn modified(&self) -> Option<SystemTime> {
        self.modified
    }

    /// Whether it held no bytes.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The handle, opened anew after [`FileBytes::release`]; fails if the file has changed since.
    pub fn handle(&self) -> Result<OpenFile<'_>, SourceError> {
        let mut slot = self.lock();
        let file = match &*slot {
            Some(file) => file.clone(),
            None => {
                let file = File::open(&self.path).map_err(|e| self.io_error("cannot reopen", e))?;
                self.check_unchanged(&file)?;
                slot.insert(Arc::new(file)).clone()
            }
        };
        Ok(OpenFile { bytes: self, file })
    }

    /// Closes the file until the next read (reads under way finish on their own handle).
    pub fn release(&self) {
        self.lock().take();
    }

    /// Fills `buf` from `offset`.
    pub fn read_exact_at(&self, buf: &mut [u8], offset: u64) -> Result<(), SourceError> {
        self.handle()?.read_exact_at(buf, offset)
    }

    fn lock(&self) -> MutexGuard<'_, Option<Arc<File>>> {
        // The slot is whole at every moment, so a panic elsewhere cannot have torn it.
        self.handle.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn check_unchanged(&self, file: &File) -> Result<(), SourceError> {
        let metadata = file.metadata().map_err(|e| self.io_error("cannot ask its length", e))?;
        if metadata.len() != self.len || metadata.modified().ok() != self.modified {
            return Err(SourceError::Changed { path: self.path.clone(), was: self.len, now: metadata.len() });
        }
        Ok(())
    }

    fn io_error(&self, what: &str, source: io::Error) -> SourceError {
        SourceError::Io { path: self.path.clone(), what: what.into(), source }
    }
}

impl<'f> OpenFile<'f> {
    /// The file that this is a handle of.
    pub fn bytes(&self) -> &'f FileBytes {
        self.bytes
    }

    /// Fills `buf` from `offset`; a file that ends early has changed since it was opened.
    pub fn read_exact_at(&self, buf: &mut [u8], offset: u64) -> Result<(), SourceError> {
        let start = Instant::now();
        let result = self.read_all_at(buf, offset);
        READING.set(READING.get() + start.elapsed());
        result
    }

    fn read_all_at(&self, mut buf: &mut [u8], mut offset: u64) -> Result<(), SourceError> {
        while !buf.is_empty() {
            match read_at::read_at(&self.file, buf, offset) {
                Ok(0) => {
                    self.bytes.check_unchanged(&self.file)?;
                    let what = format!("cannot read {} bytes at byte {offset}", buf.len());
                    return Err(self.bytes.io_error(&what, io::ErrorKind::UnexpectedEof.into()));
                }
                Ok(n) => {
                    buf = &mut buf[n..];
                    offset += n as u64;
                }
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => {
                    let what = format!("cannot read {} bytes at byte {offset}", buf.len());
                    return Err(self.bytes.io_error(&what, e));
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_changed_while_closed_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("größe mit leerzeichen.las");
        std::fs::write(&path, [7u8; 100]).unwrap();
        let bytes = FileBytes::open(&path).unwrap();
        let mut buf = [0u8; 10];
        bytes.read_exact_at(&mut buf, 90).unwrap();
        assert_eq!(buf, [7; 10]);
        bytes.release();
        bytes.read_exact_at(&mut buf, 0).unwrap();
        bytes.release();
        std::fs::write(&path, [7u8; 99]).unwrap();
        let error = bytes.read_exact_at(&mut buf, 0).unwrap_err();
        assert!(matches!(error, SourceError::Changed { was: 100, now: 99, .. }), "{error}");
        std::fs::remove_file(&path).unwrap();
        let error = bytes.read_exact_at(&mut buf, 0).unwrap_err();
        assert!(error.to_string().contains("größe mit leerzeichen.las: cannot reopen"), "{error}");
    }

    #[test]
    fn a_file_cut_short_under_an_open_handle_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("cut.las");
        std::fs::write(&path, [7u8; 100]).unwrap();
        let bytes = FileBytes::open(&path).unwrap();
        std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(50).unwrap();
        let error = bytes.read_exact_at(&mut [0; 20], 40).unwrap_err();
        assert!(matches!(error, SourceError::Changed { was: 100, now: 50, .. }), "{error}");
    }
}
