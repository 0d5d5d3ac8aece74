//! What the window opens with.

use super::data;
use crate::attribute::{ColorMode, ColorRange, Ramp};
use crate::gpu::GpuOptions;
use crate::output::{Protected, Target};
use crate::render::frame::Shade;
use crate::render::path::CameraPath;
use glam::DVec3;
use std::ffi::OsString;
use std::path::PathBuf;

/// What is seen: files, how they are read and shown, and from where.
#[derive(Clone)]
pub struct ViewOptions {
    /// Files, folders, lists and patterns.
    pub inputs: Vec<OsString>,
    /// Files of those that are not shown at first.
    pub hidden: Vec<PathBuf>,
    /// How they are read, and what is shown of them.
    pub data: data::ReadOptions,
    /// What colours show; `None`: chosen from the data.
    pub color: Option<ColorMode>,
    /// The ramp of `color`; `None`: that of the mode.
    pub ramp: Option<Ramp>,
    /// Values at its ends; `None`: chosen from the data.
    pub range: Option<ColorRange>,
    /// Light.
    pub shade: Shade,
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
    /// Parallel rays, at so many units a pixel.
    pub ortho: Option<f64>,
    /// The camera of a saved view, before all of these.
    pub saved: Option<CameraPath>,
}

impl ViewOptions {
    /// The same of other files, without a camera.
    pub fn of_others(&self, inputs: Vec<OsString>) -> ViewOptions {
        let others = ViewOptions { inputs, hidden: Vec::new(), saved: None, ..self.clone() };
        ViewOptions { eye: None, target: None, orbit: None, ortho: None, ..others }
    }
}

/// A saved view that was read.
pub enum OpenedView {
    /// With the files that it is of.
    Whole(Box<ViewOptions>),
    /// Where the camera is, of whatever is open.
    Camera(CameraPath),
}

/// What the window opens with.
pub struct WindowOptions {
    /// What is seen at first.
    pub view: ViewOptions,
    /// Reads a saved view. Errors: why there is none, in words.
    pub read_view: fn(&std::path::Path) -> Result<OpenedView, String>,
    /// The device.
    pub gpu: GpuOptions,
    /// The window's size, in the pixels of a screen of usual density.
    pub size: [u32; 2],
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
