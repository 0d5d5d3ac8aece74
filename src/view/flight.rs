//! The camera path that is flown, lap after lap.

use super::{Options, Viewer};
use std::time::{Duration, Instant};

/// How long one frame looks whether what a lap needs is there.
const LOOKS: Duration = Duration::from_millis(50);

/// What a frame does of the path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flight {
    /// There is none, or no more.
    Over,
    /// It waits for what the lap needs.
    Gathers,
    /// It is the path's next.
    Flies,
}

/// How far the flight is.
#[derive(Clone, Copy, Debug, Default)]
pub struct Progress {
    /// Laps that are flown.
    pub lap: u32,
    /// Frames of this one.
    pub frame: u32,
    /// Frames of this one that lack nothing.
    gathered: u32,
}

impl Progress {
    /// A frame was shown; whether it was the lap's last of `frames`.
    pub fn advance(&mut self, frames: u32) -> bool {
        self.frame += 1;
        let is_last = self.frame >= frames;
        if is_last {
            *self = Progress { lap: self.lap + 1, ..Progress::default() };
        }
        is_last
    }
}

impl Viewer {
    /// Brings the camera to the path's next frame. Laps after the first begin when all that they will see is there.
    pub(super) fn play(&mut self, options: &Options) -> anyhow::Result<Flight> {
        let Some((path, frames)) = &options.path else { return Ok(Flight::Over) };
        let is_there =
            self.statistics.first_picture.is_some() || self.has_programs && self.data.is_complete();
        let is_over = self.flown.lap >= options.laps;
        let Some(about) = self.data.about().filter(|_| self.is_framed && is_there && !is_over) else {
            return Ok(Flight::Over);
        };
        let placed = path.placed(|v| about.base.place(v))?;
        let end = Instant::now() + LOOKS;
        while self.flown.lap > 0 && self.flown.gathered < *frames {
            if let Some(frame) = placed.spread(*frames).nth(self.flown.gathered as usize) {
                self.camera = placed.camera(frame)?;
            }
            self.take_news()?;
            if !self.data.is_complete() || Instant::now() > end {
                return Ok(Flight::Gathers);
            }
            self.flown.gathered += 1;
        }
        if let Some(frame) = placed.spread(*frames).nth(self.flown.frame as usize) {
            self.camera = placed.camera(frame)?;
        }
        Ok(Flight::Flies)
    }
}
