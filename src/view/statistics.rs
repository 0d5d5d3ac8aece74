//! Times of a window's frames, for programs.

use crate::output::Signed;
use serde::Serialize;

/// What is written at the end.
#[derive(Serialize)]
struct WindowReport<'a> {
    /// From the start of the program to the first frame with the window's own, to the first with something of the
    /// data, and until everything that the view needs was there for the first time; milliseconds.
    first_frame_ms: Option<f64>,
    first_picture_ms: Option<f64>,
    complete_ms: Option<f64>,
    /// The longest time from a frame to the next between the first one and the first image.
    longest_gap_ms: Option<f64>,
    /// Frames that followed another one at once.
    #[serde(flatten)]
    frames: TimesSummary,
    /// Frames that stood still for the sake of a section.
    waited_for_section: u64,
    /// Of changes of the classes that are shown: until all of what is on the device showed them.
    switches_ms: &'a [f64],
    /// Of a path.
    laps: &'a [LapReport],
}

/// Of frames that followed one another at once.
#[derive(Serialize)]
struct TimesSummary {
    frames: usize,
    median_ms: Option<f64>,
    p95_ms: Option<f64>,
    max_ms: Option<f64>,
}

impl TimesSummary {
    fn of(times: &[f64]) -> TimesSummary {
        let sorted = sorted(times);
        let at = |share| at(&sorted, share);
        TimesSummary { frames: sorted.len(), median_ms: at(0.5), p95_ms: at(0.95), max_ms: at(1.0) }
    }
}

fn sorted(values: &[f64]) -> Vec<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    sorted
}

fn at(sorted: &[f64], share: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1)?;
    Some(sorted[(share * last as f64).round() as usize])
}

/// A frame of a path.
pub struct Flown {
    /// Milliseconds since the one before, but for the first.
    pub ms: Option<f64>,
    /// Milliseconds that it took to take what had arrived.
    pub upload_ms: f64,
    /// Pixels of its image, of those of one at rest.
    pub share: f64,
    /// Whether it showed all that its view needs.
    pub is_complete: bool,
    /// Times that a frame has waited for the device to take a section, since the start.
    pub waits: u64,
}

/// Frames of one lap.
#[derive(Serialize)]
struct LapReport {
    #[serde(flatten)]
    frames: TimesSummary,
    /// Frames that showed something coarser, or nothing, in the place of what was still to come.
    incomplete_frames: usize,
    /// Frames that stood still for the sake of a section.
    waited_for_section: u64,
    /// Longest time that a frame took what had arrived.
    upload_max_ms: Option<f64>,
    /// Median pixels of an image, of those of one at rest.
    picture_share: Option<f64>,
}

/// Collects them.
#[derive(Default)]
pub struct Statistics {
    /// Milliseconds to the first frame.
    pub first_frame: Option<f64>,
    /// And to the first that shows something of the data.
    pub first_image: Option<f64>,
    /// And until all was there.
    pub complete: Option<f64>,
    /// Longest gap between two frames until there was an image, milliseconds.
    pub longest_gap: Option<f64>,
    /// Milliseconds from a frame to the next.
    pub frames: Vec<f64>,
    /// Milliseconds until other classes were shown.
    pub switches: Vec<f64>,
    lap: Vec<Flown>,
    laps: Vec<LapReport>,
    /// Waits before the lap.
    waits: u64,
}

impl Statistics {
    /// A frame of a path was shown.
    pub fn flown(&mut self, frame: Flown) {
        self.lap.push(frame);
    }

    /// It was the last of its lap.
    pub fn end_lap(&mut self) {
        let lap = std::mem::take(&mut self.lap);
        let values = |of: fn(&Flown) -> f64| sorted(&lap.iter().map(of).collect::<Vec<_>>());
        let waits = lap.last().map_or(self.waits, |frame| frame.waits);
        self.laps.push(LapReport {
            frames: TimesSummary::of(&lap.iter().filter_map(|frame| frame.ms).collect::<Vec<_>>()),
            incomplete_frames: lap.iter().filter(|frame| !frame.is_complete).count(),
            waited_for_section: waits - self.waits,
            upload_max_ms: at(&values(|frame| frame.upload_ms), 1.0),
            picture_share: at(&values(|frame| frame.share), 0.5),
        });
        self.waits = waits;
    }

    /// As JSON; `waited`: frames that stood still for the sake of a section.
    pub fn json(&self, waited: u64) -> anyhow::Result<String> {
        let report = WindowReport {
            first_frame_ms: self.first_frame,
            first_picture_ms: self.first_image,
            complete_ms: self.complete,
            longest_gap_ms: self.longest_gap,
            frames: TimesSummary::of(&self.frames),
            waited_for_section: waited,
            switches_ms: &self.switches,
            laps: &self.laps,
        };
        Ok(serde_json::to_string_pretty(&Signed::new(report))? + "\n")
    }
}
