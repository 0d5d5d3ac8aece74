//! What has come from files, other threads and the device is taken: often, and with nothing drawn.

use super::canvas::Purpose;
use super::pick;
use super::viewer::Viewer;
use crate::limits::LIMITS;
use crate::render::frame::Shade;
use crate::resident::switch::Switched;
use std::time::Instant;

impl Viewer {
    /// Takes what has arrived, and asks for a frame when one is due.
    pub(super) fn look(&mut self) -> anyhow::Result<()> {
        if self.redraw.wants_look(Instant::now()) {
            self.take_news()?;
            self.plan_next();
        }
        Ok(())
    }

    /// Decides when to look again, and asks for a frame when one is due.
    pub(super) fn plan_next(&mut self) {
        let notice = self.notice.as_ref().map(|(_, end)| *end);
        if self.redraw.plan(Instant::now(), self.data.is_complete(), notice).is_some() {
            self.window.request_redraw();
        }
    }

    /// Takes what has come from files, other threads and the device. Waits for nothing.
    pub(super) fn take_news(&mut self) -> anyhow::Result<()> {
        let begun = Instant::now();
        self.redraw.looked(begun);
        if self.pipelines.become_ready()? {
            self.data.hold_uploads(false);
            self.log.line(format_args!("programs {:.0} ms", self.timing.since_start()));
        }
        self.take_saved()?;
        if self.saving.is_none() {
            self.take_data()?;
        }
        self.timing.took(begun);
        if let Some(point) = self.drawing
            && self.data.scene_mut().order.reached(point)?
        {
            self.redraw.device_done(Instant::now());
            self.drawing = None;
        }
        for (answer, purpose) in self.canvas.take_picks(&mut self.data, &self.navigation.camera)? {
            if purpose == Purpose::Middle {
                let middle = self.canvas.middle(&self.navigation.camera).and_then(|pick| pick.point);
                let middle = middle.map(|point| point.shown);
                self.navigation.toggle(middle, (&self.data, &self.settings, &self.canvas));
                self.window.request_redraw();
                self.redraw.asks(false);
                continue;
            }
            let name = if purpose == Purpose::Kept { "kept" } else { "pick" };
            let size = self.canvas.size();
            let [x, y] = [0, 1].map(|axis| answer.at[axis] * f64::from(size[axis]));
            self.log.line(format_args!("{name} {} at {x:.0} {y:.0}", pick::logged(answer.point.as_ref())));
            // While data arrive, the next frame tells.
            if self.data.is_complete() {
                self.window.request_redraw();
            }
            self.redraw.asks(false);
        }
        for ms in self.canvas.take_times(&mut self.data)? {
            self.timing.times.trace.push(ms);
        }
        Ok(())
    }

    /// Takes what was read, and has some of it uploaded.
    pub(super) fn take_data(&mut self) -> anyhow::Result<()> {
        let frame_ms = self.canvas.frame_ms();
        self.data.scene_mut().set_frame_ms(frame_ms);
        let tick = self.data.tick(
            &self.gpu,
            &self.navigation.camera,
            self.canvas.size(),
            self.settings.z_scale,
            self.settings.shade == Shade::Lit,
            self.canvas.upload_bytes(LIMITS.frame_bytes),
        )?;
        if tick.changed {
            self.redraw.outdate();
        }
        self.redraw.uploads(tick.is_busy);
        if let Some(switched) = self.data.scene_mut().take_switched() {
            let Switched { took, in_sight, sections, parts } = switched;
            let [took, in_sight] = [took, in_sight].map(|time| time.as_secs_f64() * 1e3);
            self.timing.switched(took);
            self.log.line(format_args!(
                "switched in {took:.0} ms, in sight {in_sight:.0} ms, {sections} sections in {parts} parts"
            ));
        }
        for words in self.data.take_notices() {
            self.notify(words);
        }
        if tick.is_new_scene {
            self.canvas.forget_scene();
            self.redraw.new_scene();
            self.drawing = None;
            self.log.line(format_args!("scene"));
        }
        Ok(())
    }
}
