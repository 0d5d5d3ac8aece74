//! The camera path that is flown, lap after lap: how far it is, and where the camera is to be.

use crate::render::camera::{Camera, CameraError};
use crate::render::path::CameraPath;

/// What a frame does of the path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlightStep {
    /// There is none, or no more.
    Ended,
    /// It waits for what the lap needs.
    Gathers,
    /// It is the path's next.
    Flies,
}

/// How far the flight is.
#[derive(Clone, Copy, Debug, Default)]
pub struct FlightProgress {
    /// Laps that are flown.
    pub lap: u32,
    /// Frames of this one.
    pub frame: u32,
    /// Frames of this one that lack nothing.
    gathered: u32,
}

impl FlightProgress {
    /// A frame was shown; whether it was the lap's last of `frames`.
    pub fn advance(&mut self, frames: u32) -> bool {
        self.frame += 1;
        let is_last = self.frame >= frames;
        if is_last {
            *self = FlightProgress { lap: self.lap + 1, ..FlightProgress::default() };
        }
        is_last
    }

    /// Whether data are gathered before the lap of so many frames begins: of all but the first.
    pub fn gathers(&self, frames: u32) -> bool {
        self.lap > 0 && self.gathered < frames
    }

    /// Where the camera is for what is gathered next.
    pub fn gathering(&self, path: &CameraPath, frames: u32) -> Result<Option<Camera>, CameraError> {
        at(path, frames, self.gathered)
    }

    /// A frame of the lap lacks nothing.
    pub fn gathered(&mut self) {
        self.gathered += 1;
    }

    /// Where the camera is in the lap's next frame.
    pub fn camera(&self, path: &CameraPath, frames: u32) -> Result<Option<Camera>, CameraError> {
        at(path, frames, self.frame)
    }
}

fn at(path: &CameraPath, frames: u32, frame: u32) -> Result<Option<Camera>, CameraError> {
    path.spread(frames).nth(frame as usize).map(|at| path.camera(at)).transpose()
}
