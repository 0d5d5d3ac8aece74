//! What the window opens with.

use super::data;
use crate::attribute::ColorMode;
use crate::gpu::GpuOptions;
use crate::output::{Protected, Target};
use crate::render::path::CameraPath;
use glam::DVec3;
use std::ffi::OsString;

/// What the window opens with.
pub struct WindowOptions {
    /// Files, folders, lists and patterns.
    pub inputs: Vec<OsString>,
    /// How they are read, and what is shown of them.
    pub data: data::ReadOptions,
    /// The device.
    pub gpu: GpuOptions,
    /// The window's size, in the pixels of a screen of usual density.
    pub size: [u32; 2],
    /// What colours show; `None`: chosen from the data.
    pub color: Option<ColorMode>,
    /// Vertical exaggeration.
    pub z_scale: f64,
    /// Where the camera is: E, N, U of the files.
    pub eye: Option<DVec3>,
    /// What it looks at.
    pub target: Option<DVec3>,
    /// Azimuth and elevation, degrees, and a distance.
    pub orbit: Option<([f64; 2], Option<f64>)>,
    /// Vertical field of view, degrees.
    pub fov: f64,
    /// A camera path that is played, and how many frames of it.
    pub path: Option<(CameraPath, u32)>,
    /// How often.
    pub laps: u32,
    /// Close when the path is at its end.
    pub quit: bool,
    /// Where statistics of the frames go.
    pub json: Option<Target>,
    /// What they are not written over.
    pub protected: Protected,
    /// Tell on standard output what happens, for tests.
    pub log_events: bool,
}
