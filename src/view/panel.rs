//! The panel beside the image, the status bar below it, and the small boxes over it.

use super::boxes::{Boxes, OpenRequest};
use super::class_part;
use super::color_part;
use super::data::{DataAbout, DataStatus};
use super::fates::Refused;
use super::file_list::{self, FileRequest};
use super::layers::{Alone, FLAGS};
use super::numbers::short;
use super::pick;
use super::selection_part::SelectionPart;
use super::settings::{BRIDGE, Settings};
use super::state::State;
use super::widgets::{ACCENT, LINE, TEXT, WARN, WEAK, weak};
use crate::attribute::{Channel, ColorMode, ColorTable, Flags, class_color, class_name};
use crate::render::frame::Shade;
use crate::render::screen::PickedPoint;
use crate::section::Surface;
use crate::text::{harmless, tidy};
use egui::{
    Align, Align2, Button, Color32, FontId, Layout, Margin, Pos2, RichText, ScrollArea, Sense, Slider,
    Stroke, Ui, pos2, vec2,
};
use std::collections::{BTreeMap, VecDeque};

/// Width of the panel, points.
const WIDTH: f32 = 296.0;
/// Frames that a plot shows.
const PLOTTED: usize = 120;
const GROUND: Color32 = Color32::from_rgb(27, 29, 33);
const WELL: Color32 = Color32::from_rgb(18, 19, 22);
/// The last values of something, for a plot.
#[derive(Default)]
pub struct History {
    values: VecDeque<f32>,
}

impl History {
    /// Adds the latest.
    pub fn push(&mut self, value: f64) {
        if self.values.len() == PLOTTED {
            self.values.pop_front();
        }
        self.values.push_back(value as f32);
    }
}

/// Milliseconds of the stages of frames.
#[derive(Default)]
pub struct StageTimes {
    /// From one frame to the next, while there is something to do.
    pub frame: History,
    /// On the device.
    pub trace: History,
    /// Taking what has arrived.
    pub upload: History,
    /// Until all that is on the device showed the classes that were chosen last, milliseconds.
    pub switched: Option<f64>,
}

/// What the panel shows.
pub struct PanelContent<'a> {
    /// Files, classes, units.
    pub about: Option<&'a DataAbout>,
    /// Progress, memory, messages.
    pub status: &'a DataStatus,
    /// The colours in use, with what they were made for.
    pub colors: Option<(ColorMode, &'a ColorTable)>,
    /// Plots.
    pub times: &'a StageTimes,
    /// What was clicked on, else what lies under the cursor.
    pub point: Option<PickedPoint>,
    /// It was clicked on.
    pub is_kept: bool,
    /// What is going on.
    pub going_on: State,
    /// The same, in short.
    pub state: String,
    /// Files that are not shown.
    pub refused: &'a [Refused],
    /// Nothing is open.
    pub is_empty: bool,
    /// What the points stand for.
    pub surface: Surface,
}

/// What the user asks for.
#[derive(Debug, Default)]
pub struct PanelRequests {
    /// What is to become of a file.
    pub file: Option<FileRequest>,
    /// Coordinates to go to, as typed: E, N and perhaps U, of the files.
    pub go_to: Option<(f64, f64, Option<f64>)>,
    /// What to open.
    pub open: Option<OpenRequest>,
    /// What the points are to stand for.
    pub surface: Option<Surface>,
    /// Where parts in sight lie that can be clicked, by their names, points.
    pub places: Vec<(String, Pos2)>,
    /// Where the list of keys lies, and whether all of it is in sight.
    pub keys: Option<(egui::Rect, bool)>,
}

/// The panel and its boxes.
pub struct Panel {
    /// The panel is there.
    pub is_open: bool,
    /// The small boxes over the image.
    pub boxes: Boxes,
    /// The class that is shown alone.
    alone: Alone,
    /// What is typed of the points that take part.
    points: SelectionPart,
}

/// Looks: dark, quiet, one accent.
pub fn style(context: &egui::Context) {
    context.set_theme(egui::Theme::Dark);
    context.all_styles_mut(|style| {
        for (kind, size) in [
            (egui::TextStyle::Body, 13.0),
            (egui::TextStyle::Button, 13.0),
            (egui::TextStyle::Small, 11.0),
            (egui::TextStyle::Monospace, 12.0),
            (egui::TextStyle::Heading, 15.0),
        ] {
            if let Some(font) = style.text_styles.get_mut(&kind) {
                font.size = size;
            }
        }
        style.spacing.item_spacing = vec2(8.0, 5.0);
        style.spacing.interact_size.y = LINE;
        style.spacing.scroll = egui::style::ScrollStyle::thin();
        style.animation_time = 0.0;
        let visuals = &mut style.visuals;
        visuals.panel_fill = GROUND;
        visuals.window_fill = GROUND;
        visuals.window_stroke = Stroke::new(1.0, Color32::from_gray(60));
        visuals.extreme_bg_color = WELL;
        visuals.override_text_color = Some(TEXT);
        visuals.weak_text_color = Some(WEAK);
        visuals.selection.bg_fill = ACCENT.gamma_multiply(0.55);
        visuals.selection.stroke = Stroke::new(1.0, Color32::WHITE);
        visuals.widgets.noninteractive.bg_stroke = Stroke::new(1.0, Color32::from_gray(48));
        visuals.slider_trailing_fill = true;
    });
}

/// The coordinate systems that files which are shown name, with how many do; those that name none last.
fn systems(about: &DataAbout) -> Vec<(String, usize)> {
    let mut named: BTreeMap<(bool, &str), usize> = BTreeMap::new();
    for file in about.files.iter().filter(|file| file.is_seen()) {
        let name = file.system.as_deref();
        *named.entry((name.is_none(), name.unwrap_or("none that is named"))).or_default() += 1;
    }
    named.into_iter().map(|((_, name), files)| (harmless(name), files)).collect()
}

/// Bytes in few letters.
pub fn bytes(n: u64) -> String {
    let mib = n as f64 / f64::from(1 << 20);
    if mib >= 1000.0 { format!("{:.2} GiB", mib / 1024.0) } else { format!("{mib:.0} MiB") }
}

/// A part of the panel; gives where its title lies.
fn part(ui: &mut Ui, name: &str, is_open: bool, content: impl FnOnce(&mut Ui)) -> Pos2 {
    let title = RichText::new(name).strong().color(Color32::from_gray(235));
    let shown = egui::CollapsingHeader::new(title).default_open(is_open).show_unindented(ui, content);
    ui.add_space(4.0);
    shown.header_response.rect.left_center() + vec2(24.0, 0.0)
}

/// Words on the left, words on the right.
fn pair(ui: &mut Ui, left: &str, right: impl Into<String>) {
    ui.horizontal(|ui| {
        ui.label(weak(left));
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| ui.label(right.into()));
    });
}

/// How much of a whole.
fn bar(ui: &mut Ui, name: &str, [part, whole]: [u64; 2], words: String) {
    pair(ui, name, words);
    let share = if whole == 0 { 0.0 } else { (part as f64 / whole as f64).clamp(0.0, 1.0) as f32 };
    let (rect, _) = ui.allocate_exact_size(vec2(ui.available_width(), 4.0), Sense::hover());
    ui.painter().rect_filled(rect, 2.0, WELL);
    let fill = rect.with_max_x(rect.left() + rect.width() * share);
    ui.painter().rect_filled(fill, 2.0, if share > 0.95 && name.ends_with("memory") { WARN } else { ACCENT });
    ui.add_space(2.0);
}

/// The last values as a line under its name and number.
fn plot(ui: &mut Ui, name: &str, history: &History) {
    let last = history.values.back().map_or("–".to_owned(), |v| format!("{v:.1} ms"));
    let most = history.values.iter().copied().fold(0.0, f32::max);
    pair(ui, name, last);
    let (rect, _) = ui.allocate_exact_size(vec2(ui.available_width(), 26.0), Sense::hover());
    ui.painter().rect_filled(rect, 2.0, WELL);
    let inner = rect.shrink(3.0);
    let points: Vec<_> = history
        .values
        .iter()
        .enumerate()
        .map(|(k, v)| {
            let x = inner.left() + inner.width() * k as f32 / (PLOTTED - 1) as f32;
            pos2(x, inner.bottom() - inner.height() * v / most.max(1e-3))
        })
        .collect();
    if points.len() > 1 {
        ui.painter().line(points, Stroke::new(1.2, ACCENT));
    }
    if most > 0.0 {
        let font = FontId::proportional(10.0);
        ui.painter().text(inner.right_top(), Align2::RIGHT_TOP, format!("{most:.0}"), font, WEAK);
    }
}

impl Default for Panel {
    fn default() -> Panel {
        Panel {
            is_open: true,
            boxes: Boxes::default(),
            alone: Alone::default(),
            points: SelectionPart::default(),
        }
    }
}

impl Panel {
    /// Nothing is typed any more: something else is open.
    pub fn forget(&mut self) {
        (self.alone, self.points) = (Alone::default(), SelectionPart::default());
    }

    /// Lays out everything but the image, which gets what is left of `ui`.
    pub fn show(&mut self, ui: &mut Ui, settings: &mut Settings, content: &PanelContent) -> PanelRequests {
        let mut requests = PanelRequests::default();
        let margin = Margin::symmetric(12, 3);
        let frame = egui::Frame::new().fill(GROUND).inner_margin(margin);
        egui::Panel::bottom("status").exact_size(26.0).frame(frame).show(ui, |ui| self.status(ui, content));
        if !self.is_open {
            self.points = SelectionPart::default();
        } else {
            let frame = egui::Frame::new().fill(GROUND).inner_margin(Margin {
                left: 12,
                right: 4,
                top: 10,
                bottom: 4,
            });
            egui::Panel::left("panel").exact_size(WIDTH).resizable(false).frame(frame).show(ui, |ui| {
                ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
                    ui.set_width(WIDTH - 30.0);
                    self.parts(ui, settings, content, &mut requests);
                });
            });
        }
        let asked = self.boxes.show(ui.ctx(), !content.is_empty, &mut requests.places);
        (requests.go_to, requests.open, requests.keys) = (asked.go_to, asked.open, asked.keys);
        requests
    }

    fn status(&self, ui: &mut Ui, content: &PanelContent) {
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            ui.label(weak("? keys"));
            ui.separator();
            ui.label(weak(&content.state));
            // What is left of the line: it ends before the state does, however narrow the window is.
            ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
                match (&content.point, content.about) {
                    (Some(point), Some(about)) => place(ui, point, content.is_kept, about),
                    _ => {
                        let crs = content.about.map(|about| match &about.crs {
                            Some(crs) => crs.name.clone(),
                            None => "no coordinate system is named".to_owned(),
                        });
                        ui.add(egui::Label::new(weak(crs.unwrap_or_default())).truncate());
                    }
                }
            });
        });
    }

    fn parts(
        &mut self,
        ui: &mut Ui,
        settings: &mut Settings,
        content: &PanelContent,
        requests: &mut PanelRequests,
    ) {
        part(ui, "Colour", true, |ui| {
            color_part::show(ui, settings, (content.about, content.colors), &mut requests.places);
        });
        part(ui, "Classes", true, |ui| {
            let counts = content.about.map(|_| &content.status.kinds);
            class_part::show(ui, &mut settings.visibility, (&mut self.alone, counts), &mut requests.places);
        });
        let title = part(ui, "Points", !settings.selection.is_all(), |ui| {
            let unit =
                content.about.and_then(|about| about.unit.as_ref()).map_or("units", |unit| unit.symbol());
            let has_times = content.about.is_some_and(|about| about.summary.scales.times.is_some());
            let about = (content.status, unit, has_times);
            self.points.show(ui, &mut settings.selection, about, &mut requests.places);
        });
        requests.places.push(("part points".to_owned(), title));
        part(ui, "Picture", true, |ui| {
            ui.horizontal(|ui| {
                ui.label("Height ×");
                ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
                    let is_scaled = settings.z_scale != 1.0;
                    if ui.add_enabled(is_scaled, Button::new("1").small()).clicked() {
                        settings.z_scale = 1.0;
                    }
                    ui.spacing_mut().slider_width = 110.0;
                    let slider =
                        Slider::new(&mut settings.z_scale, 0.2..=20.0).logarithmic(true).max_decimals(2);
                    ui.add(slider);
                });
            });
            let mut is_bridged = settings.visibility.bridge > 0;
            if ui.checkbox(&mut is_bridged, "Bridge small holes").changed() {
                settings.visibility.bridge = if is_bridged { BRIDGE } else { 0 };
            }
            let mut is_lit = settings.shade == Shade::Lit;
            if ui.checkbox(&mut is_lit, "Sun and sky").changed() {
                settings.shade = if is_lit { Shade::Lit } else { Shade::None };
            }
            flags(ui, &mut settings.visibility.hidden_flags, content, &mut requests.places);
            let surface = surface(ui, content.surface, !content.status.is_opening, &mut requests.places);
            requests.surface = (surface != content.surface).then_some(surface);
        });
        part(ui, "Files", true, |ui| {
            let files = content.about.map_or(&[][..], |about| &about.files);
            requests.file = file_list::show(ui, (files, content.refused), &mut requests.places);
        });
        part(ui, "Data", true, |ui| data(ui, content));
        part(ui, "Times", false, |ui| {
            plot(ui, "frame", &content.times.frame);
            plot(ui, "trace", &content.times.trace);
            plot(ui, "upload", &content.times.upload);
            pair(ui, "read", bytes(content.status.bytes_read));
            if let Some(ms) = content.times.switched {
                pair(ui, "classes changed in", format!("{ms:.0} ms"));
            }
        });
        if !content.status.messages.is_empty() {
            let name = format!("Messages ({})", content.status.messages.len());
            part(ui, &name, true, |ui| {
                for line in &content.status.messages {
                    ui.label(RichText::new(line).small());
                }
            });
        }
    }
}

/// Boxes of withheld points, and of flags that points have or that are hidden.
fn flags(ui: &mut Ui, hidden: &mut Flags, content: &PanelContent, places: &mut Vec<(String, Pos2)>) {
    let there = content.status.kinds.flags().with(*hidden).with(Flags::WITHHELD);
    for (flag, name) in FLAGS.into_iter().filter(|(flag, _)| there.has_any(*flag)) {
        let mut is_shown = !hidden.has_any(flag);
        let check = ui.checkbox(&mut is_shown, name);
        places.push((name.to_lowercase(), check.rect.center()));
        if check.changed() {
            *hidden = if is_shown { hidden.without(flag) } else { hidden.with(flag) };
        }
    }
}

/// What the points stand for, and what was chosen; `can_change`: it may be.
fn surface(ui: &mut Ui, now: Surface, can_change: bool, places: &mut Vec<(String, Pos2)>) -> Surface {
    let mut chosen = now;
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 2.0;
        ui.label(weak("surface "));
        ui.add_enabled_ui(can_change, |ui| {
            for (surface, words, hint) in [
                (Surface::Columns, "Columns", "each cell is solid from its highest point down"),
                (Surface::Stacks, "Stacks", "what floats has air below it"),
                (Surface::Smooth, "Smooth", "as stacks, and what is solid is a smooth surface close up"),
            ] {
                let choice = ui.selectable_value(&mut chosen, surface, words);
                let choice = choice.on_hover_text(format!("{hint}; everything is read again"));
                places.push((format!("surface {}", surface.name()), choice.rect.center()));
            }
        });
    });
    chosen
}

/// What lies under the cursor, or was clicked on.
fn place(ui: &mut Ui, point: &PickedPoint, is_kept: bool, about: &DataAbout) {
    if is_kept {
        let hint = "what was clicked on; Ctrl+Shift+C copies it, Esc lets go";
        ui.label(RichText::new("kept").color(ACCENT)).on_hover_text(hint);
    }
    ui.label(RichText::new(pick::coordinates(point, about)).monospace());
    ui.separator();
    let [r, g, b] = class_color(point.class);
    let (rect, _) = ui.allocate_exact_size(vec2(10.0, 10.0), Sense::hover());
    ui.painter().circle_filled(rect.center(), 4.5, Color32::from_rgb(r, g, b));
    let unit = about.unit.as_ref().map(|unit| unit.symbol());
    let value = |(channel, code): (Channel, u16)| format!("   {}", channel.words(code, unit));
    let value = point.value.map_or(String::new(), value);
    let class = format!("{} {}{value}", point.class, class_name(point.class));
    match pick::caution(point, unit) {
        None => _ = ui.add(egui::Label::new(class).truncate()),
        Some(caution) => {
            ui.label(class);
            ui.separator();
            let words = RichText::new(&caution).color(WARN);
            ui.add(egui::Label::new(words).truncate()).on_hover_text(caution);
        }
    }
}

fn data(ui: &mut Ui, content: &PanelContent) {
    let status = content.status;
    let (read, all) = (status.points_read, status.points);
    bar(ui, "points read", [read, all], format!("{} of {}", short(read), short(all)));
    let [wanted, resident] = [status.sections_wanted, status.sections_resident];
    bar(ui, "sections resident", [resident, wanted], format!("{resident} of {wanted}"));
    for (name, [held, budget]) in [("host memory", status.host_bytes), ("device memory", status.device_bytes)]
    {
        bar(ui, name, [held, budget], format!("{} of {}", bytes(held), bytes(budget)));
    }
    if let Some(why) = &status.reduced_detail {
        ui.label(RichText::new(format!("Reduced detail: {why}")).color(WARN).small());
    }
    if let Some(about) = content.about {
        let unit = about.unit.as_ref().map_or("units", |u| u.symbol());
        let systems = systems(about);
        for (name, files) in &systems {
            let label = match (&systems[..], files) {
                ([_], _) => "system".to_owned(),
                (_, 1) => "1 file".to_owned(),
                (_, files) => format!("{files} files"),
            };
            ui.horizontal(|ui| {
                ui.label(weak(label));
                ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
                    ui.add(egui::Label::new(name).truncate()).on_hover_text(name);
                });
            });
        }
        if let Some(size) = status.extent.map(|extent| extent.size().round()) {
            pair(ui, "extent", format!("{} × {} × {} {unit}", tidy(size.x), tidy(size.y), tidy(size.z)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_few_letters() {
        assert_eq!(bytes(3 << 19), "2 MiB");
        assert_eq!(bytes(1 << 30), "1.00 GiB");
    }
}
