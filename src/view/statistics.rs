//! Times of a window's frames, for programs.

use serde::Serialize;
use std::path::Path;

/// What is written at the end.
#[derive(Serialize)]
struct Report {
    /// From the start of the program to the first frame with the window's own, and with the data's first picture,
    /// milliseconds.
    first_frame_ms: Option<f64>,
    first_picture_ms: Option<f64>,
    /// Frames that followed another one at once.
    frames: usize,
    median_ms: Option<f64>,
    p95_ms: Option<f64>,
    max_ms: Option<f64>,
    /// Frames that stood still for the sake of a section.
    waited_for_section: u64,
}

/// Collects them.
#[derive(Default)]
pub struct Statistics {
    /// Milliseconds to the first frame.
    pub first_frame: Option<f64>,
    /// And to the first that shows something of the data.
    pub first_picture: Option<f64>,
    /// Milliseconds from a frame to the next.
    pub frames: Vec<f64>,
}

impl Statistics {
    /// Writes JSON; `waited`: frames that stood still for the sake of a section.
    pub fn write(&self, waited: u64, path: &Path) -> anyhow::Result<()> {
        let mut sorted = self.frames.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        let at = |share: f64| {
            let last = sorted.len().checked_sub(1)?;
            Some(sorted[(share * last as f64).round() as usize])
        };
        let report = Report {
            first_frame_ms: self.first_frame,
            first_picture_ms: self.first_picture,
            frames: sorted.len(),
            median_ms: at(0.5),
            p95_ms: at(0.95),
            max_ms: at(1.0),
            waited_for_section: waited,
        };
        crate::render::whole_file::write_whole(path, |out| {
            serde_json::to_writer_pretty(out, &report).map_err(std::io::Error::from)
        })?;
        Ok(())
    }
}
