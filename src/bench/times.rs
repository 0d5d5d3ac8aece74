//! One frame's times and bytes, and the host's clock.

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

pub(super) fn ms(from: std::time::Instant) -> f64 {
    from.elapsed().as_secs_f64() * 1e3
}
