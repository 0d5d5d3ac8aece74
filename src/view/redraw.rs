//! One frame: what has arrived, the toolkit's part, the next piece of the picture, and both onto the window.

use super::data::{Data, Status};
use super::flight::Flight;
use super::panel::{self, Settings, Shown};
use super::statistics::Flown;
use super::{LATER, Options, PATIENCE, PROGRESS, Question, SAMPLES, SOON, Viewer, Wanted, overlay};
use crate::attribute::{ColorMode, ColorTable};
use crate::gpu::Drawing;
use crate::render::camera::Camera;
use crate::render::frame::{Background, Renderer, Shade, Traversal, View, check_size};
use crate::resident::live::FRAME_BYTES;
use egui::{Color32, FontId, Rect};
use std::ffi::OsString;
use std::time::{Duration, Instant};

/// Where lit pictures end.
pub(super) fn floor(data: &Data) -> Option<f64> {
    Some(data.about()?.floor(data.grid().0.cell()))
}

/// The picture of `size` pixels; `None` while nothing is known of the data.
pub(super) fn traced<'a>(
    data: &Data,
    settings: &Settings,
    camera: &'a Camera,
    colors: Option<&'a (ColorMode, ColorTable)>,
    size: [u32; 2],
) -> Option<View<'a>> {
    let bounds = data.about()?.bounds;
    Some(View {
        camera,
        size,
        samples: SAMPLES,
        z_scale: settings.z_scale,
        pivot: bounds.min.z,
        bounds,
        floor: floor(data)?,
        colors: &colors?.1,
        shade: settings.shade,
        background: Background::Sky,
        traversal: Traversal::Fast,
        window: None,
    })
}

impl Viewer {
    /// Takes what has arrived, and asks for a frame when one is due.
    pub(super) fn look(&mut self) -> anyhow::Result<()> {
        let now = Instant::now();
        if now < self.last_look + SOON / 2 {
            // News come in crowds.
            self.next = Some(self.next.map_or(now + SOON, |next| next.min(now + SOON)));
            return Ok(());
        }
        self.take_news()?;
        self.plan_next();
        Ok(())
    }

    /// Takes what has come from files, other threads and the device. Waits for nothing.
    pub(super) fn take_news(&mut self) -> anyhow::Result<()> {
        let begun = Instant::now();
        self.last_look = begun;
        if !self.has_programs && self.programs.are_there()? {
            self.has_programs = true;
            self.data.hold(false);
            self.log(format_args!("programs {:.0} ms", self.started.elapsed().as_secs_f64() * 1e3));
        }
        self.take_saved()?;
        if self.saving.is_none() {
            self.take_data()?;
        }
        self.upload_ms += begun.elapsed().as_secs_f64() * 1e3;
        if let Some((point, drawn)) = self.drawn
            && self.data.scene_mut().order.reached(point)?
        {
            let now = Instant::now();
            self.rest.after(now - drawn, now);
            self.drawn = None;
        }
        if let Some(renderer) = &self.renderer {
            for pick in self.screen.take_picks(renderer, self.data.scene_mut())? {
                if let Some(place) = &pick.place {
                    let at = place.shown;
                    self.log(format_args!(
                        "pick {:.3} {:.3} {:.3} class {}",
                        at.x, at.y, place.height, place.class
                    ));
                }
                // While data arrive, the next frame tells.
                if self.data.is_complete() {
                    self.window.request_redraw();
                }
                self.pick = Some((pick, self.camera));
                self.answers_due = false;
            }
        }
        for (pixels, ms) in self.screen.take_times(self.data.scene_mut())? {
            self.pace.learn(pixels, ms);
            self.times.trace.push(ms);
        }
        Ok(())
    }

    fn take_data(&mut self) -> anyhow::Result<()> {
        let upload_bytes = match self.is_urgent {
            true => self.pace.upload_bytes(self.place.size, FRAME_BYTES),
            false => FRAME_BYTES,
        };
        let tick = self.data.tick(
            &self.gpu,
            &self.camera,
            self.place.size,
            self.settings.z_scale,
            self.settings.shade == Shade::Lit,
            upload_bytes,
        )?;
        self.has_news |= tick.changed;
        self.is_busy = tick.is_busy;
        if tick.is_new_scene {
            self.renderer = None;
            self.colors = None;
            self.screen.forget();
            (self.asked, self.answers_due, self.drawn) = (None, false, None);
            // The sooner it is framed, the sooner what is seen is read.
            self.is_late = true;
            self.log(format_args!("scene"));
        }
        Ok(())
    }

    /// When to look again if nothing happens, and whether a frame is due. What the user does is drawn at once; what only
    /// arrives, when the frames before it have rested long enough.
    fn plan_next(&mut self) {
        let now = Instant::now();
        let is_settled = self.has_settled && self.data.is_complete();
        let mut due = self.repaint.into_iter().chain(self.notice.as_ref().map(|(_, end)| *end)).min();
        let mut at = |when: Instant| due = Some(due.map_or(when, |due: Instant| due.min(when)));
        if self.is_late {
            at(now);
        }
        // While the device draws it is not known how long that takes.
        if self.drawn.is_none() {
            let rested = self.rest.end(now);
            if self.has_news || self.has_more {
                at(rested);
            } else if !is_settled {
                // Progress moves without news.
                at(rested.max(self.last_shown.unwrap_or(now) + PROGRESS));
            }
        }
        if due.is_some_and(|due| due <= now) {
            self.window.request_redraw();
            due = Some(now + LATER);
        }
        let is_watched = self.drawn.is_some() && !is_settled;
        let soon = (self.is_busy || self.answers_due || is_watched).then_some(now + SOON);
        self.next = due.into_iter().chain(soon).min();
    }

    /// Draws a frame; `true` when the window is to be closed.
    pub(super) fn redraw(&mut self, options: &Options) -> anyhow::Result<bool> {
        let begun = Instant::now();
        self.take_dropped();
        // Events are looked after while the device is behind.
        if !self.data.scene_mut().order.has_free_frame(PATIENCE)? {
            (self.is_late, self.next) = (true, Some(Instant::now() + SOON));
            return Ok(false);
        }
        self.take_news()?;
        self.fly();
        let flight = self.play(options)?;

        let mut output = self.lay_out()?;
        let pixels_per_point = output.pixels_per_point;
        let textures = &mut output.textures_delta;
        let (set, free) = (std::mem::take(&mut textures.set), std::mem::take(&mut textures.free));
        self.textures.change(set)?;
        let primitives = self.context.tessellate(output.shapes, pixels_per_point);
        if !self.is_framed && self.data.about().is_some() && !self.place.size.contains(&0) {
            self.first_view(options)?;
            // What was looked for so far was for a camera that nobody sees by.
            self.take_data()?;
        }
        // A picture that is being saved stays as it was begun.
        if self.saving.is_none() {
            self.has_news |= self.apply_settings()?;
        } else if !self.is_applied() && self.notice.is_none() {
            self.notify("The picture is being saved: the change comes after it");
        }

        let has_news = std::mem::take(&mut self.has_news);
        self.has_more = self.plan(has_news)?;
        let submitted = self.submit((pixels_per_point, &primitives))?;
        self.textures.free(free);
        if !submitted {
            // Minimised, or in the middle of a change.
            (self.is_late, self.next) = (true, Some(begun + LATER));
            return Ok(false);
        }
        self.is_late = false;
        self.data.scene_mut().order.collect()?;

        let is_moving = self.input.is_flying() || flight == Flight::Flies;
        let is_complete = self.data.is_complete();
        let goes_on = is_moving || self.saving.is_some() || self.has_more && (is_complete || self.is_urgent);
        self.note_times(begun, goes_on, flight == Flight::Flies);
        let lap = options.path.as_ref().filter(|_| flight == Flight::Flies);
        if lap.is_some_and(|(_, frames)| self.flown.advance(*frames)) {
            self.statistics.end_lap();
            self.last_frame = None;
            self.log(format_args!("lap {}", self.flown.lap));
        }
        let repaint = output.viewport_output.get(&egui::ViewportId::ROOT).map(|out| out.repaint_delay);
        self.repaint = repaint.filter(|delay| !delay.is_zero()).and_then(|delay| begun.checked_add(delay));
        if goes_on || repaint.is_some_and(|delay| delay.is_zero()) {
            self.window.request_redraw();
        }
        let has_settled = !self.has_more && !self.has_news && !self.is_busy && !is_moving && is_complete;
        if has_settled && !self.has_settled {
            self.log_settled();
        }
        self.has_settled = has_settled;
        self.plan_next();
        Ok(options.quit && options.path.is_some() && self.flown.lap >= options.laps)
    }

    /// Everything has come and the picture is finished.
    fn log_settled(&self) {
        let ([width, height], status) = (self.place.size, self.data.status());
        if let Some(why) = &status.failed {
            self.log(format_args!("failed {why}"));
        }
        if let Some(why) = &status.hidden {
            self.log(format_args!("hidden {why}"));
        }
        let (eye, [azimuth, elevation]) = (self.camera.eye(), self.camera.angles());
        self.log(format_args!(
            "settled {width}x{height} eye {:.2},{:.2},{:.2} look {azimuth:.2},{elevation:.2} sections {} buffers {}",
            eye.x,
            eye.y,
            eye.z,
            status.sections_resident,
            self.gpu.allocated_bytes()
        ));
    }

    /// Files that were dropped onto the window: views and data.
    fn take_dropped(&mut self) {
        let is_view =
            |path: &std::path::PathBuf| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"));
        let (views, data): (Vec<_>, Vec<_>) =
            std::mem::take(&mut self.dropped).into_iter().partition(is_view);
        if let Some(view) = views.last() {
            self.open_view(view);
        }
        if !data.is_empty() {
            self.data.add(data.into_iter().map(OsString::from).collect());
        }
    }

    /// Runs the toolkit: panel, status bar, boxes, what is drawn over the picture.
    fn lay_out(&mut self) -> anyhow::Result<egui::FullOutput> {
        let raw = self.toolkit.take_egui_input(&self.window);
        let status = self.data.status();
        let under_cursor =
            self.pick.as_ref().and_then(|(pick, _)| pick.place).filter(|_| self.input.cursor().is_some());
        let shown = Shown {
            about: self.data.about(),
            status: &status,
            colors: self.colors.as_ref().map(|(_, table)| table),
            times: &self.times,
            under_cursor,
            state: self.state(&status),
        };
        self.notice = self.notice.take().filter(|(_, end)| *end > Instant::now());
        let (panel, settings, context) = (&mut self.panel, &mut self.settings, self.context.clone());
        let (camera, pick, notice) = (&self.camera, &self.pick, &self.notice);
        let (is_framed, is_empty) = (self.is_framed, self.data.scene().shows_nothing());
        let (mut asked, mut rect) = (panel::Asked::default(), Rect::ZERO);
        let old_size = self.place.size;
        let output = context.run_ui(raw, |ui| {
            asked = panel.show(ui, settings, &shown);
            rect = ui.available_rect_before_wrap();
            let painter = ui.painter().with_clip_rect(rect);
            let place = overlay::Place { rect, size: old_size };
            let unit = shown.about.and_then(|about| about.unit.as_ref()).map(|unit| unit.symbol().to_owned());
            if let (true, Some(about)) = (is_framed, shown.about) {
                if is_empty {
                    let bounds = about.bounds.exaggerated(settings.z_scale, about.bounds.min.z);
                    overlay::frame(&painter, place, camera, &bounds);
                }
                overlay::north_arrow(&painter, place, camera);
                let middle =
                    pick.as_ref().and_then(|(pick, _)| pick.place).map_or(camera.target(), |p| p.shown);
                overlay::scale_bar(&painter, place, camera, middle, unit.as_deref());
            }
            if let Some(why) = &status.failed {
                overlay::notice(&painter, place, why);
            } else if let Some((words, _)) = notice {
                overlay::notice(&painter, place, words);
            } else if let Some(why) = &status.hidden {
                overlay::notice(&painter, place, why);
            } else if is_empty {
                opening(&painter, rect, &status);
            }
        });
        let platform = output.platform_output.clone();
        self.toolkit.handle_platform_output(&self.window, platform);
        let scaled = rect * output.pixels_per_point;
        let side = |low: f32, high: f32| (high.round() - low.round()).max(0.0) as u32;
        let size = [side(scaled.left(), scaled.right()), side(scaled.top(), scaled.bottom())];
        self.place = overlay::Place { rect, size };

        if self.log_events && asked.checks != self.checks {
            for (file, at) in &asked.checks {
                let at = *at * output.pixels_per_point;
                self.log(format_args!("check {file} {:.0} {:.0}", at.x, at.y));
            }
            self.checks = asked.checks;
        }
        if let Some((file, is_shown)) = asked.file {
            self.log(format_args!("file {file} {}", if is_shown { "shown" } else { "hidden" }));
            self.data.set_visible(file, is_shown);
        }
        if let Some(place) = asked.go_to {
            self.go_to(place);
        }
        if let Some(path) = asked.open {
            self.open_view(&path);
        }
        Ok(output)
    }

    /// What is going on, in short.
    fn state(&self, status: &Status) -> String {
        let samples = self.screen.samples();
        if let Some(saving) = &self.saving {
            return format!("saving {} of {SAMPLES}", saving.samples());
        }
        match () {
            _ if !status.is_complete && status.points > 0 && status.points_decoded < status.points => {
                let share = status.points_decoded as f64 / status.points as f64 * 100.0;
                format!("reading {share:.0} %")
            }
            _ if !status.is_complete => "reading".to_owned(),
            _ if self.is_coarse || samples < SAMPLES => format!("refining {samples} of {SAMPLES}"),
            _ => format!("{} points", panel::short(status.points_decoded)),
        }
    }

    /// Whether scene and colours are what the settings say.
    fn is_applied(&self) -> bool {
        self.data.scene().visibility() == self.settings.visibility
            && self.colors.as_ref().is_none_or(|(of, _)| *of == self.settings.color)
    }

    /// Makes the scene and the colours what the settings say; whether they were not.
    pub(super) fn apply_settings(&mut self) -> anyhow::Result<bool> {
        let mut is_changed = false;
        let visibility = self.settings.visibility;
        if self.data.scene().visibility() != visibility {
            let shown: Vec<_> = (0..=255u8).filter(|&c| visibility.classes.shows(c)).collect();
            self.log(format_args!("classes shown {} bridge {}", shown.len(), visibility.bridge));
            self.data.scene_mut().show(visibility)?;
            is_changed = true;
        }
        let color = self.settings.color;
        let is_current = self.colors.as_ref().is_some_and(|(of, _)| *of == color);
        if !is_current && let Some(about) = self.data.about() {
            self.colors =
                Some((color, ColorTable::new(color, &about.summary, &self.data.grid().0, None, None)?));
            self.log(format_args!("color {}", color.name()));
            is_changed = true;
        }
        Ok(is_changed)
    }

    /// Starts a picture where one is wanted; whether there is something left to trace.
    fn plan(&mut self, is_changed: bool) -> anyhow::Result<bool> {
        let size = self.place.size;
        if !self.has_programs || self.data.about().is_none() || !self.is_framed || size.contains(&0) {
            return Ok(false);
        }
        check_size(&self.gpu, size)?;
        if self.renderer.is_none() {
            let (grid, anchor) = self.data.grid();
            self.renderer = Some(Renderer::new(self.data.scene(), grid, anchor)?);
            self.wanted = None;
        }
        let wanted = Wanted { camera: self.camera, settings: self.settings.clone(), size };
        let coarse = self.pace.coarse(size);
        let is_wanted = self.wanted.as_ref() == Some(&wanted);
        if is_changed || !is_wanted {
            self.is_urgent = !is_wanted;
            self.wanted = Some(wanted);
            self.is_coarse = coarse != size;
            self.screen.start(coarse);
        } else if self.is_coarse && self.screen.samples() > 0 {
            self.is_coarse = false;
            self.screen.start(size);
        }
        // Until all is there the picture will be another one soon: what computes is left to the reading.
        let enough = if self.data.is_complete() { SAMPLES } else { 1 };
        Ok(self.is_coarse || self.screen.samples() < enough)
    }

    /// Records and submits the frame, and shows it; `false` where the window gives no image.
    fn submit(
        &mut self,
        (pixels_per_point, primitives): (f32, &[egui::ClippedPrimitive]),
    ) -> anyhow::Result<bool> {
        let size = self.screen.size().unwrap_or(self.place.size);
        let view = traced(&self.data, &self.settings, &self.camera, self.colors.as_ref(), size);
        // A coarse picture is one sample in the middle of each pixel.
        let view = view.map(|view| if self.is_coarse { View { samples: 1, ..view } } else { view });
        let table = self.renderer.as_mut().map(|renderer| self.data.table(renderer)).unwrap_or_default();
        let scene = self.data.scene_mut();
        if let Some(view) = &view {
            self.screen.prepare(scene, view)?;
        }
        let begun = Instant::now();
        let (mut commands, slot) = scene.order.begin_frame("window")?;
        let Some(image) = self.swapchain.acquire(slot)? else { return Ok(false) };
        if self.shown_size != image.size() {
            self.shown_size = image.size();
            let [width, height] = self.shown_size;
            if self.log_events {
                println!("size {width}x{height}");
            }
        }
        if let (Some(view), Some(renderer)) = (&view, &mut self.renderer) {
            let before = self.screen.samples();
            let rows = if self.is_coarse { size[1] } else { self.pace.rows(size[0]) };
            self.screen.record(renderer, scene, (&mut commands, slot), view, &table, rows)?;
            self.version += u64::from(self.screen.samples() != before && before == 0);
            let mut is_copied = false;
            if let Some(saving) = &mut self.saving {
                let rows = self.pace.rows(self.place.size[0]);
                is_copied = saving.record(&mut self.data, (&mut commands, slot), rows)?;
            }
            let scene = self.data.scene_mut();
            let scale = self.place.size.map(|n| f64::from(n.max(1)));
            let at = self.input.cursor().map(|c| [c[0] / scale[0], c[1] / scale[1]]);
            let is_inside = |at: &[f64; 2]| at.iter().all(|v| (0.0..1.0).contains(v));
            if let Some(cursor) = at.filter(is_inside) {
                let question = Question { cursor, version: self.version };
                if !is_copied
                    && self.asked != Some(question)
                    && self.screen.ask(renderer, scene, (&mut commands, slot), cursor)?
                {
                    self.asked = Some(question);
                    self.answers_due = true;
                }
            } else {
                self.pick = None;
            }
        }
        let corner = self.place.rect.min * pixels_per_point;
        let [left, top] = [corner.x, corner.y].map(|v| v.round().max(0.0) as u32);
        let [width, height] = self.place.size;
        let mut drawing = Drawing::new(pixels_per_point);
        if let Some(picture) = self.screen.picture([left, top, width, height]) {
            drawing.picture(picture);
        }
        self.textures.draw(&mut drawing, pixels_per_point, primitives);
        let overlay = &mut self.overlay;
        let scene = self.data.scene_mut();
        scene
            .order
            .draw(&mut commands, &image, |commands| overlay.paint(commands, slot, &image, &drawing))?;
        let point = scene.order.submit(commands)?;
        scene.drawn(point);
        self.screen.submitted(slot, point);
        if let Some(saving) = &mut self.saving {
            saving.submitted(slot, point);
        }
        self.drawn.get_or_insert((point, begun));
        self.window.pre_present_notify();
        self.swapchain.present(image)?;
        Ok(true)
    }

    fn note_times(&mut self, begun: Instant, goes_on: bool, is_flown: bool) {
        let ms = |time: Duration| time.as_secs_f64() * 1e3;
        let upload_ms = std::mem::take(&mut self.upload_ms);
        let since_last = self.last_frame.map(|last| ms(begun - last));
        if let Some(ms) = since_last {
            self.times.frame.push(ms);
            self.times.upload.push(upload_ms);
            self.statistics.frames.push(ms);
        }
        self.last_frame = goes_on.then_some(begun);
        if is_flown {
            let pixels = |[width, height]: [u32; 2]| f64::from(width) * f64::from(height);
            let picture = self.screen.size().map_or(0.0, pixels);
            let status = self.data.status();
            self.statistics.flown(Flown {
                // What came before a lap is none of it.
                ms: since_last.filter(|_| self.flown.frame > 0),
                upload_ms,
                share: picture / pixels(self.place.size).max(1.0),
                is_complete: status.is_complete,
                waits: status.frames_waited,
            });
        }
        let (now, since_start) = (Instant::now(), ms(self.started.elapsed()));
        let gap = self.last_shown.replace(now).map(|last| ms(now - last));
        if self.statistics.first_picture.is_none() {
            self.statistics.longest_gap = gap.into_iter().chain(self.statistics.longest_gap).reduce(f64::max);
        }
        if self.statistics.first_frame.is_none() {
            self.statistics.first_frame = Some(since_start);
            self.log(format_args!("first frame {since_start:.0} ms"));
        }
        let has_picture = self.screen.samples() > 0 && !self.data.scene().shows_nothing();
        if self.statistics.first_picture.is_none() && has_picture {
            self.statistics.first_picture = Some(since_start);
            let gap = self.statistics.longest_gap.unwrap_or(0.0);
            self.log(format_args!("first picture {since_start:.0} ms, longest gap {gap:.0} ms"));
        }
        if self.statistics.complete.is_none() && has_picture && self.data.is_complete() {
            self.statistics.complete = Some(since_start);
            self.log(format_args!("complete {since_start:.0} ms"));
        }
    }
}

/// What is to be seen before anything else is: that it is being read.
fn opening(painter: &egui::Painter, rect: Rect, status: &Status) {
    let words = match (status.points, status.points_decoded) {
        (0, _) => "Opening …".to_owned(),
        (all, read) => format!("Reading {} of {} points", panel::short(read), panel::short(all)),
    };
    let share = if status.points == 0 { 0.0 } else { status.points_decoded as f32 / status.points as f32 };
    let whole = Rect::from_center_size(rect.center(), egui::vec2(260.0, 54.0));
    painter.rect_filled(whole, 6.0, Color32::from_black_alpha(190));
    let line = Rect::from_center_size(rect.center() + egui::vec2(0.0, 12.0), egui::vec2(220.0, 4.0));
    painter.rect_filled(line, 2.0, Color32::from_white_alpha(40));
    painter.rect_filled(
        line.with_max_x(line.left() + line.width() * share.min(1.0)),
        2.0,
        Color32::from_rgb(86, 156, 214),
    );
    let at = rect.center() - egui::vec2(0.0, 10.0);
    painter.text(at, egui::Align2::CENTER_CENTER, words, FontId::proportional(14.0), Color32::WHITE);
}
