//! Camera, passes of a frame, the image, and a CPU reference that checks it.

pub mod camera;
