//! One frame of a scene: what is asked of it, what its shaders are given, their pipelines, and the recording.

mod bands;
mod buffers;
mod error;
mod log;
mod mirrors;
mod options;
mod pipelines;
mod rays;
mod renderer;

#[cfg(feature = "view")]
pub(super) use bands::Band;
pub use bands::check_size;
pub use error::FrameError;
pub use log::{LOG_STEP, LOG_WORDS};
pub(super) use mirrors::sun;
pub(crate) use mirrors::{FrameConstants, FramePush, halves};
#[cfg(feature = "view")]
pub(super) use mirrors::{HitRecord, sample_at};
pub use options::{Background, Logged, PASSES, PassOptions, PassRepeats, Shade, Traversal, View};
#[cfg(feature = "view")]
pub use pipelines::pipeline_descs;
pub(crate) use rays::ViewRays;
pub use renderer::Renderer;
#[cfg(feature = "view")]
pub(super) use renderer::derive_colors;
