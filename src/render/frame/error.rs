//! What can be wrong with a frame.

use super::super::camera::CameraError;
use crate::gpu::GpuError;

/// What went wrong with an image.
#[derive(Debug, thiserror::Error)]
pub enum FrameError {
    /// The device.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The camera.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// More pixels than the device can write at once.
    #[error("a picture of {width}x{height} pixels is too large for the device: its limit is {limit}")]
    Size {
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
        /// The device's, in words.
        limit: String,
    },
}
