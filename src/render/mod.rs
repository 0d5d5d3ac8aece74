//! Camera and its paths, passes of a frame, the image, and a CPU reference that checks it.

pub mod benchmark_path;
pub mod camera;
mod camera_error;
pub mod frame;
pub mod image;
pub mod path;
mod ray_basis;
pub mod reference;
pub mod saved_view;
#[cfg(feature = "view")]
pub mod screen;
pub mod side_files;
pub mod sight;
