//! How much of an image one frame traces, so that the window stays at hand on slow devices. Pure.

use std::time::{Duration, Instant};

/// What one frame may take on the device, milliseconds.
const FRAME_MS: f64 = 50.0;
/// Coarsest images: this share of the width and height.
const COARSEST: f64 = 0.25;
/// Steps of the share, so that sizes do not flicker.
const STEPS: f64 = 16.0;
/// Weight of the latest frame.
const LATEST: f64 = 0.3;

/// What a pixel costs.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    ms_per_pixel: f64,
}

impl Pace {
    /// A guess for the first frame: `is_slow` for devices that trace on the CPU.
    pub fn new(is_slow: bool) -> Pace {
        Pace { ms_per_pixel: if is_slow { 3e-4 } else { 5e-6 } }
    }

    /// Learns from a frame.
    pub fn learn(&mut self, pixels: u64, ms: f64) {
        if pixels > 0 && ms > 0.0 {
            self.ms_per_pixel += LATEST * (ms / pixels as f64 - self.ms_per_pixel);
        }
    }

    /// Milliseconds that an image takes.
    pub fn ms(&self, [width, height]: [u32; 2]) -> f64 {
        self.ms_per_pixel * f64::from(width) * f64::from(height)
    }

    /// Share of the width and height of an image of `full` pixels that is traced while things move.
    fn share(&self, full: [u32; 2]) -> f64 {
        let pixels = f64::from(full[0]) * f64::from(full[1]);
        let share = (FRAME_MS / (self.ms_per_pixel * pixels)).sqrt();
        ((share * STEPS).floor() / STEPS).clamp(COARSEST, 1.0)
    }

    /// Size of the image while things move, for one of `full` at rest.
    pub fn coarse(&self, full: [u32; 2]) -> [u32; 2] {
        let share = self.share(full);
        full.map(|side| ((f64::from(side) * share).round() as u32).max(1))
    }

    /// Bytes of sections to upload in a frame while things move, for `most` at rest: what is derived of them takes the
    /// device's time from the image.
    pub fn upload_bytes(&self, full: [u32; 2], most: u64) -> u64 {
        (most as f64 * self.share(full).powi(2)) as u64
    }

    /// Rows of an image `width` pixels wide that a frame may trace.
    pub fn rows(&self, width: u32) -> u32 {
        (FRAME_MS / (self.ms_per_pixel * f64::from(width))).clamp(1.0, 1e6) as u32
    }
}

/// Longest frame that is rested after in full, milliseconds: the first ones may be far longer than what follows.
const LONGEST: Duration = Duration::from_millis(125);

/// When frames may be drawn that nothing but arriving data asks for: they take a third of the time at most, the rest is
/// left to the reading. Pure.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rest {
    end: Option<Instant>,
}

impl Rest {
    /// A frame is done at `now`, and `took` so long.
    pub fn after(&mut self, took: Duration, now: Instant) {
        self.end = Some(now + 2 * took.min(LONGEST));
    }

    /// From when on, at or after `now`.
    pub fn end(&self, now: Instant) -> Instant {
        self.end.map_or(now, |end| end.max(now))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_devices_are_given_less_at_a_time() {
        let full = [1920, 1080];
        assert_eq!(Pace::new(false).upload_bytes(full, 4 << 20), 4 << 20);
        assert_eq!(Pace::new(true).upload_bytes(full, 4 << 20), 4 << 16);
    }

    #[test]
    fn a_third_of_the_time_is_for_frames_of_arriving_data() {
        let start = Instant::now();
        let mut rest = Rest::default();
        assert_eq!(rest.end(start), start);
        let (mut now, mut drawn) = (start, Duration::ZERO);
        for ms in [20, 50, 5, 100] {
            let took = Duration::from_millis(ms);
            now = rest.end(now) + took;
            drawn += took;
            rest.after(took, now);
        }
        assert_eq!(rest.end(now) - start, 3 * drawn);
        rest.after(Duration::from_secs(5), now);
        assert_eq!(rest.end(now) - now, 2 * LONGEST);
    }

    #[test]
    fn slow_devices_trace_less_and_fast_ones_all() {
        let full = [1000, 800];
        let mut pace = Pace::new(false);
        assert_eq!(pace.coarse(full), full);
        assert!(pace.rows(1000) > 800);
        for _ in 0..50 {
            pace.learn(800_000, 200.0);
        }
        // A quarter of the pixels takes a quarter of the time.
        assert_eq!(pace.coarse(full), [500, 400]);
        assert!((pace.ms([500, 400]) - 50.0).abs() < 0.1);
        assert_eq!(pace.rows(1000), 200);
        for _ in 0..50 {
            pace.learn(1000, 1e6);
        }
        assert_eq!(pace.coarse(full), [250, 200]);
        assert_eq!(pace.rows(1000), 1);
        assert_eq!(pace.coarse([1, 1]), [1, 1]);
    }
}
