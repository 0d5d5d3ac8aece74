//! Times of frames: for the panel's plots, for the statistics that are written at the end, and for the first of each kind.

use super::log::EventLog;
use super::panel::StageTimes;
use super::statistics::{Flown, Statistics};
use std::time::{Duration, Instant};

/// A frame that was shown.
pub struct ShownFrame {
    /// When it was begun.
    pub begun: Instant,
    /// When the one before was shown, and this one.
    pub before: Option<Instant>,
    /// This one.
    pub now: Instant,
    /// The next follows at once.
    pub goes_on: bool,
    /// Something of the data is seen.
    pub has_image: bool,
    /// Everything that the view needs is there.
    pub is_complete: bool,
    /// Of a path: which frame of the lap, and pixels of its image, of those of one at rest; and times that a frame has
    /// waited for a section since the start.
    pub flown: Option<(u32, f64, u64)>,
}

/// See the module.
pub struct FrameTiming {
    started: Instant,
    /// For the panel.
    pub times: StageTimes,
    /// For the file.
    pub statistics: Statistics,
    /// Milliseconds since the last frame that went into taking what arrived.
    upload_ms: f64,
    /// When the frame was begun that this one follows.
    last_frame: Option<Instant>,
}

fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

impl FrameTiming {
    /// Of a program that started at `started`.
    pub fn new(started: Instant) -> FrameTiming {
        FrameTiming {
            started,
            times: StageTimes::default(),
            statistics: Statistics::default(),
            upload_ms: 0.0,
            last_frame: None,
        }
    }

    /// Milliseconds since the program started.
    pub fn since_start(&self) -> f64 {
        ms(self.started.elapsed())
    }

    /// What arrived was taken since `begun`.
    pub fn took(&mut self, begun: Instant) {
        self.upload_ms += ms(begun.elapsed());
    }

    /// A lap of the path was flown; the next frame follows none.
    pub fn end_lap(&mut self) {
        self.statistics.end_lap();
        self.last_frame = None;
    }

    /// Another choice of classes was shown after so many milliseconds.
    pub fn switched(&mut self, ms: f64) {
        self.times.switched = Some(ms);
        self.statistics.switches.push(ms);
    }

    /// Notes a frame.
    pub fn note(&mut self, frame: &ShownFrame, log: &EventLog) {
        let upload_ms = std::mem::take(&mut self.upload_ms);
        let since_last = self.last_frame.map(|last| ms(frame.begun - last));
        if let Some(ms) = since_last {
            self.times.frame.push(ms);
            self.times.upload.push(upload_ms);
            self.statistics.frames.push(ms);
        }
        self.last_frame = frame.goes_on.then_some(frame.begun);
        if let Some((at, share, waits)) = frame.flown {
            self.statistics.flown(Flown {
                // What came before a lap is none of it.
                ms: since_last.filter(|_| at > 0),
                upload_ms,
                share,
                is_complete: frame.is_complete,
                waits,
            });
        }
        let since_start = self.since_start();
        let statistics = &mut self.statistics;
        let gap = frame.before.map(|last| ms(frame.now - last));
        if statistics.first_image.is_none() {
            statistics.longest_gap = gap.into_iter().chain(statistics.longest_gap).reduce(f64::max);
        }
        if statistics.first_frame.is_none() {
            statistics.first_frame = Some(since_start);
            log.line(format_args!("first frame {since_start:.0} ms"));
        }
        if statistics.first_image.is_none() && frame.has_image {
            statistics.first_image = Some(since_start);
            let gap = statistics.longest_gap.unwrap_or(0.0);
            log.line(format_args!("first picture {since_start:.0} ms, longest gap {gap:.0} ms"));
        }
        if statistics.complete.is_none() && frame.has_image && frame.is_complete {
            statistics.complete = Some(since_start);
            log.line(format_args!("complete {since_start:.0} ms"));
        }
    }
}
