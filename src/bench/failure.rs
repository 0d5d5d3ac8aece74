//! Why a benchmark ends before its end: somebody stopped it, or the device is too small.

use crate::gpu::GpuError;
use crate::render::frame::FrameError;

/// `FlightOptions::stop` was set.
#[derive(Clone, Copy, Debug, thiserror::Error)]
#[error("stopped")]
pub struct Stopped;

/// Whether `error` says that the device is too small, and nothing worse.
pub fn is_too_large(error: &anyhow::Error) -> bool {
    let gpu = match error.downcast_ref() {
        Some(FrameError::Gpu(gpu)) => Some(gpu),
        Some(_) => return false,
        None => error.downcast_ref::<GpuError>(),
    };
    !error.is::<Stopped>() && gpu.is_none_or(|gpu| matches!(gpu, GpuError::Memory { .. }))
}
