//! The timing harness: the thesis' pipeline and ours on the same cells, the same camera paths, the same pixels;
//! reading, decoding and binning beside decoding alone; and frames while files stream in.

mod cache;
pub mod frames;
pub mod ingest;
pub mod load;
pub mod log;
#[cfg(feature = "embree")]
pub mod peer;
pub mod plot;
pub mod pool;
pub mod report;
pub mod steady;
pub mod stream;
pub mod thesis;
pub mod towns;
pub mod world;

use crate::gpu::GpuError;
use crate::render::frame::FrameError;

/// One frame's times and bytes.
#[derive(Clone, Copy, Debug, Default)]
pub struct FrameTimes {
    /// Time that the host's thread ran for, from binned columns to upload form, ms: what else the host does meanwhile, a
    /// software driver's tracing above all, is not part of it.
    pub prepare_ms: f64,
    /// Device time of copies, and of what is derived from them, ms.
    pub copy_ms: f64,
    /// Copied.
    pub copy_bytes: u64,
    /// Device time of the passes of a picture, ms.
    pub trace_ms: f64,
    /// From submit to the host's seeing it done, ms.
    pub trace_wall_ms: f64,
    /// The whole frame on the host's clock, ms.
    pub total_ms: f64,
    /// Making the section table, ms.
    pub table_ms: f64,
    /// Waiting for room in the upload ring and for slots, and submitting, ms.
    pub wait_ms: f64,
}

/// Bytes of memory that nobody uses, where the system tells.
pub fn free_bytes() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix("MemAvailable:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? << 10)
}

/// Whether `error` says that the device is too small, and nothing worse.
pub fn is_too_large(error: &anyhow::Error) -> bool {
    let gpu = match error.downcast_ref() {
        Some(FrameError::Gpu(gpu)) => Some(gpu),
        Some(_) => return false,
        None => error.downcast_ref::<GpuError>(),
    };
    !error.is::<frames::Stopped>() && gpu.is_none_or(|gpu| matches!(gpu, GpuError::Memory { .. }))
}

fn ms(from: std::time::Instant) -> f64 {
    from.elapsed().as_secs_f64() * 1e3
}
