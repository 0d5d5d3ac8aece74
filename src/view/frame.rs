//! One frame: what has arrived, the toolkit's part, the next piece of the image, and both onto the window.

use super::flight::FlightStep;
use super::layout::UserInterface;
use super::options::WindowOptions;
use super::redraw::{FrameState, LATER, SOON};
use super::state::{self, State};
use super::timing::ShownFrame;
use super::viewer::Viewer;
use crate::gpu::Drawing;
use crate::render::camera::Projection;
use std::time::{Duration, Instant};

/// How long the device may still work at the frame before the last, until the window looks after its events again.
const PATIENCE: Duration = Duration::from_millis(30);
/// How long one frame looks whether what a lap needs is there.
const LOOKS: Duration = Duration::from_millis(50);

impl Viewer {
    /// Draws a frame; `true` when the window is to be closed.
    pub(super) fn draw(&mut self, options: &WindowOptions) -> anyhow::Result<bool> {
        let begun = Instant::now();
        self.take_dropped(options)?;
        // Events are looked after while the device is behind.
        if !self.data.scene_mut().order.has_free_frame(PATIENCE)? {
            self.redraw.late(Instant::now() + SOON);
            return Ok(false);
        }
        self.take_news()?;
        let by = self.input.is_flying().then(|| self.input.flight());
        self.navigation.fly(by, (&self.data, &self.settings, &self.canvas));
        let step = self.play(options)?;

        let mut interface = self.lay_out(options)?;
        let freed = std::mem::take(&mut interface.freed_textures);
        if !self.navigation.is_framed() && self.data.about().is_some() && !self.canvas.size().contains(&0) {
            self.frame_data()?;
        }
        // An image that is being saved stays as it was begun.
        if self.saving.is_none() {
            self.apply_settings()?;
        } else if !self.is_applied() && self.notice.is_none() {
            self.notify("The picture is being saved: the change comes after it");
        }

        if self.saving.is_none() {
            self.navigation.keep_before(&self.data, &self.settings);
        }
        let is_outdated = self.redraw.take_outdated();
        let has_more = self.plan_image(is_outdated)?;
        self.redraw.planned(has_more);
        let is_submitted = self.submit(&interface)?;
        self.textures.free(freed);
        if !is_submitted {
            // Minimised, or in the middle of a change.
            self.redraw.late(begun + LATER);
            return Ok(false);
        }
        self.data.scene_mut().order.collect()?;

        let is_flown = step == FlightStep::Flies;
        let after = self.redraw.shown(
            begun,
            FrameState {
                is_moving: self.input.is_flying() || is_flown,
                is_saving: self.saving.is_some(),
                is_complete: self.data.is_complete(),
                is_urgent: self.canvas.is_urgent(),
                repaint: interface.repaint,
            },
        );
        self.note_frame(begun, after.goes_on, is_flown);
        let lap = options.path.as_ref().filter(|_| is_flown);
        if lap.is_some_and(|(_, frames)| self.flown.advance(*frames)) {
            self.timing.end_lap();
            self.log.line(format_args!("lap {}", self.flown.lap));
        }
        if after.is_due {
            self.window.request_redraw();
        }
        if after.has_settled {
            self.log_settled();
        }
        self.plan_next();
        Ok(options.quit && options.path.is_some() && self.flown.lap >= options.laps)
    }

    /// Brings the camera to the path's next frame. Laps after the first begin when all that they will see is there.
    fn play(&mut self, options: &WindowOptions) -> anyhow::Result<FlightStep> {
        let Some((path, frames)) = &options.path else { return Ok(FlightStep::Ended) };
        let is_there = self.timing.statistics.first_image.is_some()
            || self.pipelines.are_ready() && self.data.is_complete();
        let is_over = self.flown.lap >= options.laps;
        let may_fly = self.navigation.is_framed() && is_there && !is_over;
        let Some(about) = self.data.about().filter(|_| may_fly) else { return Ok(FlightStep::Ended) };
        let placed = path.placed(|v| about.base.place(v))?;
        let end = Instant::now() + LOOKS;
        while self.flown.gathers(*frames) {
            if let Some(camera) = self.flown.gathering(&placed, *frames)? {
                self.navigation.camera = camera;
            }
            self.take_news()?;
            if !self.data.is_complete() || Instant::now() > end {
                return Ok(FlightStep::Gathers);
            }
            self.flown.gathered();
        }
        if let Some(camera) = self.flown.camera(&placed, *frames)? {
            self.navigation.camera = camera;
        }
        Ok(FlightStep::Flies)
    }

    /// The first view of the data.
    fn frame_data(&mut self) -> anyhow::Result<()> {
        let seen = (&self.data, &self.settings, &self.canvas);
        if self.navigation.first_view(&self.view, seen)? {
            if let (None, Some(about)) = (self.view.color, self.data.about()) {
                self.settings.color = about.color;
                if let Some(scale) = self.settings.scale_mut() {
                    (scale.ramp, scale.range) = (self.view.ramp, self.view.range);
                }
            }
            self.window.request_redraw();
        }
        // What was looked for so far was for a camera that nobody sees by.
        self.take_data()
    }

    /// Begins an image where one is wanted and can be drawn; whether there is something left to trace.
    fn plan_image(&mut self, is_outdated: bool) -> anyhow::Result<bool> {
        let is_known = self.data.about().is_some() && self.navigation.is_framed();
        if !self.pipelines.are_ready() || !is_known || self.canvas.size().contains(&0) {
            return Ok(false);
        }
        let seen = (&self.navigation.camera, &self.settings);
        self.canvas.plan(&self.gpu, &self.data, seen, is_outdated)
    }

    /// Records and submits the frame, and shows it; `false` where the window gives no image.
    fn submit(&mut self, interface: &UserInterface) -> anyhow::Result<bool> {
        let seen = (&self.settings, &self.navigation.camera);
        let table = self.canvas.prepare(&mut self.data, seen)?;
        let begun = Instant::now();
        let (mut commands, slot) = self.data.scene_mut().order.begin_frame("window")?;
        let Some(image) = self.swapchain.acquire(slot)? else { return Ok(false) };
        self.log.window_size(image.size());
        if self.canvas.record(&mut self.data, seen, (&mut commands, slot), &table)? {
            let mut is_copied = false;
            if let Some(saving) = &mut self.saving {
                is_copied = saving.record(&mut self.data, (&mut commands, slot), self.canvas.rows())?;
            }
            let cursor = self.input.cursor();
            let is_toggling = self.navigation.is_toggling();
            let what = (is_toggling, is_copied);
            if self.canvas.ask(&mut self.data, (&mut commands, slot), cursor, what)? {
                self.redraw.asks(true);
            } else if is_toggling && !is_copied && !self.canvas.awaits_middle() {
                // It was answered before, or there is nothing to ask.
                let camera = &self.navigation.camera;
                let middle = self.canvas.middle(camera).and_then(|pick| pick.point).map(|point| point.shown);
                self.navigation.toggle(middle, (&self.data, &self.settings, &self.canvas));
                self.window.request_redraw();
            }
        }
        let pixels_per_point = interface.pixels_per_point;
        let mut drawing = Drawing::new(pixels_per_point);
        if let Some(traced) = self.canvas.shown(pixels_per_point) {
            drawing.traced_image(traced);
        }
        self.textures.draw(&mut drawing, pixels_per_point, &interface.primitives);
        let overlay = &mut self.overlay;
        let scene = self.data.scene_mut();
        scene
            .order
            .draw(&mut commands, &image, |commands| overlay.paint(commands, slot, &image, &drawing))?;
        let point = scene.order.submit(commands)?;
        scene.frame_submitted(point);
        self.canvas.submitted(slot, point);
        if let Some(saving) = &mut self.saving {
            saving.submitted(slot, point);
        }
        self.drawing.get_or_insert(point);
        self.redraw.submitted(begun);
        self.window.pre_present_notify();
        self.swapchain.present(image)?;
        Ok(true)
    }

    fn note_frame(&mut self, begun: Instant, goes_on: bool, is_flown: bool) {
        let pixels = |[width, height]: [u32; 2]| f64::from(width) * f64::from(height);
        let traced = self.canvas.traced_size().map_or(0.0, pixels);
        let share = traced / pixels(self.canvas.size()).max(1.0);
        let now = Instant::now();
        let frame = ShownFrame {
            begun,
            before: self.redraw.presented(now),
            now,
            goes_on,
            has_image: self.canvas.samples() > 0 && !self.data.scene().shows_nothing(),
            is_complete: self.data.is_complete(),
            flown: is_flown.then(|| (self.flown.frame, share, self.data.status().frames_waited)),
        };
        self.timing.note(&frame, &self.log);
    }

    /// Everything has come and the image is finished.
    fn log_settled(&mut self) {
        let ([width, height], status) = (self.canvas.size(), self.data.status());
        if let Some(why) = &status.failed {
            self.log.line(format_args!("failed {why}"));
        }
        let going_on = State::of(&status, self.data.scene().shows_nothing());
        self.log.line(format_args!("state {}", going_on.in_short(&status, None)));
        self.log.line(format_args!("points {}", state::logged_counts(&status)));
        if let Some(why) = &status.unselected {
            self.log.line(format_args!("unselected {why}"));
        }
        if let Some(why) = &status.hidden {
            self.log.line(format_args!("hidden {why}"));
        }
        let camera = &self.navigation.camera;
        match camera.projection() {
            Projection::Perspective { fov } => {
                self.log.state("projection", format_args!("perspective {fov}"));
            }
            Projection::Orthographic { units_per_pixel } => {
                self.log.state("projection", format_args!("parallel {units_per_pixel}"));
            }
        }
        let (eye, [azimuth, elevation]) = (camera.eye(), camera.angles());
        self.log.line(format_args!(
            "settled {width}x{height} eye {:.2},{:.2},{:.2} look {azimuth:.2},{elevation:.2} sections {} buffers {}",
            eye.x,
            eye.y,
            eye.z,
            status.sections_resident,
            self.gpu.allocated_bytes()
        ));
    }
}
