//! The toolkit's part of a frame: panel, status bar, boxes, and what is drawn over the image.

use super::data::DataStatus;
use super::options::WindowOptions;
use super::overlay::{self, ImageArea, ScalePlace};
use super::panel::{PanelContent, PanelRequests};
use super::settings::{SAMPLES, Settings};
use super::viewer::Viewer;
use super::widgets::short;
use crate::render::camera::Camera;
use egui::{Color32, FontId, Painter, Rect};
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
            overlay::north_arrow(painter, area, camera);
            let unit = about.unit.as_ref().map(|unit| unit.symbol());
            scale = self.scale.and_then(|place| overlay::scale_bar(painter, area, camera, place, unit));
        }
        if self.is_free {
            overlay::invitation(painter, area);
        }
        match self.notice {
            Some(words) => overlay::notice(painter, area, words),
            None if self.is_empty && !self.is_free => opening(painter, rect, content.status),
            None => {}
        }
        scale
    }
}

impl Viewer {
    /// Runs the toolkit, and does what was asked for in the panel.
    pub(super) fn lay_out(&mut self, options: &WindowOptions) -> anyhow::Result<UserInterface> {
        let raw = self.toolkit.take_egui_input(&self.window);
        let status = self.data.status();
        let under_cursor =
            self.canvas.pick().and_then(|(pick, _)| pick.point).filter(|_| self.input.cursor().is_some());
        let content = PanelContent {
            about: self.data.about(),
            status: &status,
            colors: self.canvas.colors().map(|(_, table)| table),
            times: &self.timing.times,
            under_cursor,
            state: self.state(&status),
            refused: self.data.refused(),
            is_empty: self.data.is_empty(),
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
            is_free: content.is_empty,
            notice: status.failed.as_deref().or(notice).or(status.hidden.as_deref()),
            is_empty: self.data.scene().shows_nothing(),
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
            self.do_with_file(request)?;
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
    fn state(&self, status: &DataStatus) -> String {
        let samples = self.canvas.samples();
        if let Some(saving) = &self.saving {
            return format!("saving {} of {SAMPLES}", saving.samples());
        }
        match () {
            _ if self.data.is_empty() => "nothing is open".to_owned(),
            _ if !status.is_complete && status.points > 0 && status.points_decoded < status.points => {
                let share = status.points_decoded as f64 / status.points as f64 * 100.0;
                format!("reading {share:.0} %")
            }
            _ if !status.is_complete => "reading".to_owned(),
            _ if self.canvas.is_refining() => format!("refining {samples} of {SAMPLES}"),
            _ => format!("{} points", short(status.points_decoded)),
        }
    }
}

/// What is to be seen before anything else is: that it is being read.
fn opening(painter: &Painter, rect: Rect, status: &DataStatus) {
    let words = match (status.points, status.points_decoded) {
        (0, _) => "Opening …".to_owned(),
        (all, read) => format!("Reading {} of {} points", short(read), short(all)),
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
