//! The toolkit's part of a frame: panel, status bar, boxes, and what is drawn over the image.

use super::data::DataStatus;
use super::options::WindowOptions;
use super::overlay::{self, ImageArea, ScalePlace};
use super::panel::{PanelContent, PanelRequests};
use super::settings::{SAMPLES, Settings};
use super::state::State;
use super::viewer::Viewer;
use crate::render::camera::Camera;
use crate::render::screen::PickedPoint;
use egui::{Color32, FontId, Painter, Rect};
use glam::DVec3;
use std::time::{Duration, Instant};

/// What the toolkit gives to be painted.
pub struct UserInterface {
    /// Of the screen.
    pub pixels_per_point: f32,
    /// Triangles.
    pub primitives: Vec<egui::ClippedPrimitive>,
    /// Textures that are of no use after this frame.
    pub freed_textures: Vec<egui::TextureId>,
    /// After how long it wants the next frame.
    pub repaint: Option<Duration>,
}

/// What is drawn over the image.
struct ImageOverlay<'a> {
    /// Where it sees the data.
    camera: Option<&'a Camera>,
    /// What was clicked on.
    kept: Option<DVec3>,
    /// Where a scale holds.
    scale: Option<ScalePlace>,
    /// A line of words.
    notice: Option<&'a str>,
    /// Nothing is open.
    is_free: bool,
    /// Nothing is seen of the data.
    is_empty: bool,
    /// Pixels of the image before this frame.
    size: [u32; 2],
}

impl ImageOverlay<'_> {
    /// Gives the words of the scale bar.
    fn paint(
        &self,
        painter: &Painter,
        rect: Rect,
        settings: &Settings,
        content: &PanelContent,
    ) -> Option<String> {
        let area = ImageArea { rect, size: self.size };
        let mut scale = None;
        if let (Some(camera), Some(about)) = (self.camera, content.about) {
            if self.is_empty {
                let bounds = about.bounds.exaggerated(settings.z_scale, about.bounds.min.z);
                overlay::frame(painter, area, camera, &bounds);
            }
            self.kept.inspect(|&kept| overlay::mark(painter, area, camera, kept));
            overlay::north_arrow(painter, area, camera);
            let unit = about.unit.as_ref().map(|unit| unit.symbol());
            scale = self.scale.and_then(|place| overlay::scale_bar(painter, area, camera, place, unit));
        }
        if self.is_free {
            overlay::invitation(painter, area);
        }
        if let Some(words) = self.notice {
            overlay::notice(painter, area, words);
        }
        if let Some((words, share)) =
            content.going_on.over_image(content.status).filter(|_| self.is_empty && !self.is_free)
        {
            progress(painter, rect, words, share);
        }
        scale
    }
}

impl Viewer {
    /// What lies under the cursor.
    pub(super) fn under_cursor(&self) -> Option<PickedPoint> {
        let (pick, _) = self.canvas.pick()?;
        pick.point.filter(|_| self.input.cursor().is_some())
    }

    /// Runs the toolkit, and does what was asked for in the panel.
    pub(super) fn lay_out(&mut self, options: &WindowOptions) -> anyhow::Result<UserInterface> {
        let raw = self.toolkit.take_egui_input(&self.window);
        let status = self.data.status();
        let kept = self.canvas.kept();
        let is_empty = self.data.scene().shows_nothing();
        let going_on = State::of(&status, is_empty);
        let content = PanelContent {
            about: self.data.about(),
            status: &status,
            colors: self.canvas.colors().map(|(choice, table)| (choice.mode(), table)),
            times: &self.timing.times,
            point: kept.or(self.under_cursor()),
            is_kept: kept.is_some(),
            going_on,
            state: self.state(going_on, &status),
            refused: self.data.refused(),
            is_empty: self.data.is_empty(),
            surface: self.data.options().surface,
        };
        self.notice = self.notice.take().filter(|(_, end)| *end > Instant::now());
        let notice = self.notice.as_ref().map(|(words, _)| &words[..]);
        let camera = self.navigation.is_framed().then_some(&self.navigation.camera);
        let at_cursor = self.canvas.pick().and_then(|(pick, _)| pick.point).map(|point| point.shown);
        let in_middle =
            |camera| self.canvas.middle(camera).and_then(|pick| pick.point).map(|point| point.shown);
        let over = ImageOverlay {
            camera,
            scale: camera.and_then(|camera| ScalePlace::of(camera, at_cursor, in_middle(camera))),
            kept: self
                .data
                .about()
                .and_then(|about| self.canvas.kept_place(self.settings.z_scale, about.bounds.min.z)),
            notice: status.failed.as_deref().or(notice),
            is_free: content.is_empty,
            is_empty,
            size: self.canvas.size(),
        };
        let (panel, settings, context) = (&mut self.panel, &mut self.settings, self.context.clone());
        let (mut requests, mut rect, mut scale) = (PanelRequests::default(), Rect::ZERO, None);
        let output = context.run_ui(raw, |ui| {
            requests = panel.show(ui, settings, &content);
            rect = ui.available_rect_before_wrap();
            scale = over.paint(&ui.painter().with_clip_rect(rect), rect, settings, &content);
        });
        let egui::FullOutput {
            platform_output,
            mut textures_delta,
            shapes,
            pixels_per_point,
            viewport_output,
        } = output;
        self.toolkit.handle_platform_output(&self.window, platform_output);
        let scaled = rect * pixels_per_point;
        let side = |low: f32, high: f32| (high.round() - low.round()).max(0.0) as u32;
        let size = [side(scaled.left(), scaled.right()), side(scaled.top(), scaled.bottom())];
        self.canvas.area = ImageArea { rect, size };
        self.log.state("scale", format_args!("{}", scale.as_deref().unwrap_or("none")));
        self.answer(options, requests, pixels_per_point)?;
        self.textures.change(std::mem::take(&mut textures_delta.set))?;
        Ok(UserInterface {
            pixels_per_point,
            primitives: self.context.tessellate(shapes, pixels_per_point),
            freed_textures: textures_delta.free.drain().collect(),
            repaint: viewport_output.get(&egui::ViewportId::ROOT).map(|out| out.repaint_delay),
        })
    }

    /// Does what was asked for in the panel.
    fn answer(
        &mut self,
        options: &WindowOptions,
        requests: PanelRequests,
        pixels_per_point: f32,
    ) -> anyhow::Result<()> {
        self.log.places(requests.places, pixels_per_point);
        if let Some((rect, is_whole)) = requests.keys {
            let [left, top, right, bottom] = [rect.left(), rect.top(), rect.right(), rect.bottom()];
            let whole = if is_whole { "whole" } else { "scrolled" };
            self.log.state("keys", format_args!("{whole} {left:.0} {top:.0} {right:.0} {bottom:.0}"));
        }
        if let Some(request) = requests.file {
            self.do_with_file(options, request)?;
        }
        if let Some(surface) = requests.surface {
            self.show_as(surface)?;
        }
        if let Some(place) = requests.go_to
            && self.navigation.go_to(place, (&self.data, &self.settings, &self.canvas))
        {
            self.window.request_redraw();
        }
        if let Some(request) = requests.open {
            self.open(options, request)?;
        }
        Ok(())
    }

    /// What is going on, in short.
    fn state(&self, state: State, status: &DataStatus) -> String {
        if let Some(saving) = &self.saving {
            return format!("saving {} of {SAMPLES}", saving.samples());
        }
        let is_refining = self.canvas.is_refining() && self.canvas.is_drawn();
        state.in_short(status, is_refining.then(|| [self.canvas.samples(), SAMPLES]))
    }
}

/// Where nothing is seen of the data: why, and how much of that is done.
fn progress(painter: &Painter, rect: Rect, words: String, share: Option<f64>) {
    let room = (rect.width() - 80.0).max(200.0);
    let galley = painter.layout(words, FontId::proportional(14.0), Color32::WHITE, room);
    let high = galley.size().y + if share.is_some() { 38.0 } else { 24.0 };
    let size = egui::vec2((galley.size().x + 40.0).max(260.0), high);
    let whole = Rect::from_center_size(rect.center(), size);
    painter.rect_filled(whole, 6.0, Color32::from_black_alpha(190));
    let up = if share.is_some() { 7.0 } else { 0.0 };
    painter.galley(rect.center() - egui::vec2(0.0, up) - galley.size() / 2.0, galley, Color32::WHITE);
    if let Some(share) = share {
        let below = whole.center_bottom() - egui::vec2(0.0, 15.0);
        let line = Rect::from_center_size(below, egui::vec2(220.0, 4.0));
        painter.rect_filled(line, 2.0, Color32::from_white_alpha(40));
        let done = line.left() + line.width() * share.clamp(0.0, 1.0) as f32;
        painter.rect_filled(line.with_max_x(done), 2.0, Color32::from_rgb(86, 156, 214));
    }
}
