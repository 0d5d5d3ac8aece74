//! A disk that fails, for tests. Preloaded, it stands before the C library's `pread64`, which Rust's positioned reads
//! call: reads of files whose path holds `FAILING_DISK` end with an input/output error from byte `FAILING_DISK_FROM` on
//! (decimal; without it from byte 0); others take `FAILING_DISK_MS` milliseconds longer (without it none).
#![cfg(target_os = "linux")]

use libc::{EIO, SYS_pread64, c_int, c_long, c_void, off64_t, size_t, ssize_t};
use std::ffi::OsString;
use std::os::unix::ffi::OsStrExt;
use std::sync::OnceLock;
use std::time::Duration;

/// The variables that this library reads.
pub const VARIABLES: [&str; 3] = ["FAILING_DISK", "FAILING_DISK_FROM", "FAILING_DISK_MS"];

struct Plan {
    path: OsString,
    from: i64,
    delay: Duration,
}

fn plan() -> &'static Plan {
    static PLAN: OnceLock<Plan> = OnceLock::new();
    PLAN.get_or_init(|| {
        let number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse::<u64>().ok());
        Plan {
            path: std::env::var_os(VARIABLES[0]).unwrap_or_default(),
            from: number(VARIABLES[1]).unwrap_or(0) as i64,
            delay: Duration::from_millis(number(VARIABLES[2]).unwrap_or(0)),
        }
    })
}

/// Whether the file behind a descriptor is one of those that fail.
fn is_failing(fd: c_int, plan: &Plan) -> bool {
    let Ok(path) = std::fs::read_link(format!("/proc/self/fd/{fd}")) else { return false };
    let (path, part) = (path.as_os_str().as_bytes(), plan.path.as_bytes());
    !part.is_empty() && path.windows(part.len()).any(|window| window == part)
}

/// Stands before the C library's function of this name.
///
/// # Safety
/// As for that: `buffer` has room for `count` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pread64(fd: c_int, buffer: *mut c_void, count: size_t, offset: off64_t) -> ssize_t {
    let plan = plan();
    if offset.saturating_add(count as i64) > plan.from && is_failing(fd, plan) {
        // SAFETY: it gives the calling thread's own number.
        unsafe { *libc::__errno_location() = EIO };
        return -1;
    }
    if !plan.delay.is_zero() {
        std::thread::sleep(plan.delay);
    }
    let [fd, count] = [c_long::from(fd), count as c_long];
    // SAFETY: as promised by whoever calls.
    unsafe { libc::syscall(SYS_pread64, fd, buffer, count, offset) as ssize_t }
}
