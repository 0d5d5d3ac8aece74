//! The list of files in the panel: what is shown, what was done with each, and what is to become of it.

use super::data::FileAbout;
use super::fates::Refused;
use super::numbers::short;
use super::remarks;
use super::widgets::{ACCENT, LINE, TEXT, WARN, WEAK, weak};
use crate::text::harmless;
use egui::{Align, Button, Checkbox, Color32, Layout, Pos2, Response, RichText, ScrollArea, Ui};

/// Files in sight at a time.
const ROWS: usize = 8;

/// What is to become of a file, by its place in the list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileRequest {
    /// It is shown, or hidden.
    Show(usize, bool),
    /// The camera goes to it.
    ZoomTo(usize),
    /// It leaves the list.
    Remove(usize),
    /// One that is not shown leaves the list.
    Dismiss(usize),
    /// The list goes to the clipboard.
    Copy,
}

/// What is asked for, and where what can be clicked lies, by names.
type Asked<'a> = (&'a mut Option<FileRequest>, &'a mut Vec<(String, Pos2)>);

/// A row of the list.
enum Row<'a> {
    File(usize, &'a FileAbout),
    Refused(usize, &'a Refused),
}

fn badge_color(badge: &str) -> Color32 {
    if matches!(badge, "transformed") { ACCENT } else { WARN }
}

/// A small sign that can be clicked.
fn sign(ui: &mut Ui, sign: &str, hover: &str) -> Response {
    ui.add(Button::new(RichText::new(sign).small().color(WEAK)).frame(false).small()).on_hover_text(hover)
}

fn name(ui: &mut Ui, name: &str, path: &str, words: &str, color: Color32, is_struck: bool) {
    ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
        let name = RichText::new(name).color(color);
        let name = if is_struck { name.strikethrough() } else { name };
        ui.add(egui::Label::new(name).truncate()).on_hover_text(format!("{path}\n{words}"));
    });
}

fn file_row(ui: &mut Ui, index: usize, file: &FileAbout, (request, places): Asked) {
    let mut is_shown = file.shown;
    let check = ui.add(Checkbox::without_text(&mut is_shown));
    let place = |what: &str, response: &Response| (format!("{what} {index}"), response.rect.center());
    places.push(place("check", &check));
    if check.changed() {
        *request = Some(FileRequest::Show(index, is_shown));
    }
    ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
        ui.spacing_mut().item_spacing.x = 5.0;
        let remove = sign(ui, "✖", "remove from the list");
        let zoom = sign(ui, "🔍", "zoom to this file");
        places.extend([place("remove", &remove), place("zoom", &zoom)]);
        if remove.clicked() {
            *request = Some(FileRequest::Remove(index));
        }
        if zoom.clicked() {
            *request = Some(FileRequest::ZoomTo(index));
        }
        match remarks::badge(file) {
            Some(badge) => ui.label(RichText::new(badge).small().color(badge_color(badge))),
            None => ui.label(weak(short(file.points))),
        };
        let words = format!("{} points, {}", short(file.points), remarks::words(file));
        let short_name = harmless(&file.path.file_name().unwrap_or_default().to_string_lossy());
        let color = if file.shown { TEXT } else { WEAK };
        name(ui, &short_name, &harmless(&file.path.to_string_lossy()), &words, color, file.is_gone);
    });
}

fn refused_row(ui: &mut Ui, index: usize, refused: &Refused, (request, places): Asked) {
    // As wide as a check.
    ui.add_space(22.0);
    ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
        ui.spacing_mut().item_spacing.x = 5.0;
        let remove = sign(ui, "✖", "remove from the list");
        places.push((format!("dismiss {index}"), remove.rect.center()));
        if remove.clicked() {
            *request = Some(FileRequest::Dismiss(index));
        }
        ui.label(RichText::new(refused.badge).small().color(badge_color(refused.badge)));
        name(ui, refused.short_name(), &refused.name, &refused.why, WEAK, false);
    });
}

/// The list; what is asked for in it.
pub fn show(
    ui: &mut Ui,
    (files, refused): (&[FileAbout], &[Refused]),
    places: &mut Vec<(String, Pos2)>,
) -> Option<FileRequest> {
    let request = &mut None;
    let listed = files.iter().enumerate().filter(|(_, file)| !file.is_removed);
    let of_refused = refused.iter().enumerate();
    let rows: Vec<Row> = listed
        .map(|(index, file)| Row::File(index, file))
        .chain(of_refused.map(|(index, refused)| Row::Refused(index, refused)))
        .collect();
    if rows.is_empty() {
        ui.label(weak("Drop files or folders into the window"));
        return None;
    }
    // Thousands of files are no more to lay out than those in sight.
    let height = rows.len().min(ROWS) as f32 * (LINE + 5.0);
    let area = ScrollArea::vertical().id_salt("files").max_height(height).auto_shrink([false, true]);
    area.show_rows(ui, LINE, rows.len(), |ui, in_sight| {
        for row in &rows[in_sight] {
            ui.horizontal(|ui| match row {
                Row::File(index, file) => file_row(ui, *index, file, (request, places)),
                Row::Refused(index, refused) => refused_row(ui, *index, refused, (request, places)),
            });
        }
    });
    ui.horizontal(|ui| {
        let copy = ui.small_button("Copy list").on_hover_text("what was done with each file, as a table");
        places.push(("copy list".to_owned(), copy.rect.center()));
        if copy.clicked() {
            *request = Some(FileRequest::Copy);
        }
        let marked = files.iter().filter(|file| !file.is_removed && remarks::badge(file).is_some()).count();
        let said = marked + refused.len();
        if said > 0 {
            ui.label(weak(format!("{said} with a remark")).small());
        }
    });
    request.take()
}
