//! The operating system's page cache: a cold start can only be measured without it.

use std::fs::File;
use std::io;
use std::path::Path;

/// Places in a file that are asked for.
const PROBES: u64 = 16;

/// Writes `path` out and asks the system to forget it; gives the share of probed pages that it still holds.
/// What lies below the system (a disk's cache, a virtual machine's host) is not reached.
#[cfg(target_os = "linux")]
pub fn drop(path: &Path) -> io::Result<f64> {
    use rustix::fs::{Advice, fadvise};
    use rustix::io::{Errno, ReadWriteFlags, preadv2};
    let file = File::open(path)?;
    file.sync_all()?;
    fadvise(&file, 0, None, Advice::DontNeed)?;
    let len = file.metadata()?.len();
    let mut held = 0;
    for probe in 0..PROBES {
        let mut byte = [0];
        let at = len / (2 * PROBES) * (2 * probe + 1);
        match preadv2(&file, &mut [io::IoSliceMut::new(&mut byte)], at, ReadWriteFlags::NOWAIT) {
            Ok(_) => held += 1,
            Err(Errno::AGAIN) => {}
            Err(error) => return Err(error.into()),
        }
    }
    // A probe may have started to read ahead.
    fadvise(&file, 0, None, Advice::DontNeed)?;
    Ok(held as f64 / PROBES as f64)
}

/// Not done on this system.
#[cfg(not(target_os = "linux"))]
pub fn drop(_: &Path) -> io::Result<f64> {
    Err(io::ErrorKind::Unsupported.into())
}
