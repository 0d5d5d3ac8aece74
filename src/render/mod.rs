//! Camera and its paths, passes of a frame, the image, and a CPU reference that checks it.

pub mod camera;
pub mod frame;
pub mod image;
pub mod path;
pub mod reference;
#[cfg(feature = "view")]
pub mod screen;
pub mod sight;
