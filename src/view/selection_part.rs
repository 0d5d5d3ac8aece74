//! The part of the panel about the points that take part: returns, flight lines, intensity, height and time. What is chosen
//! reads points again.

use super::data::DataStatus;
use super::widgets::{ACCENT, WARN, WEAK, weak};
use crate::source::{Returns, Selection};
use egui::{Align, Button, Id, Layout, Pos2, RichText, TextEdit, Ui, vec2};
use std::fmt::Display;
use std::str::FromStr;

/// A value as it is typed.
#[derive(Debug, Default)]
struct Field {
    /// While it is typed, or is no value.
    text: Option<String>,
    /// Why it is none.
    wrong: Option<String>,
}

impl Field {
    /// `value` as a line of text with a `name`; whether another one was typed. Nothing typed is the default.
    fn show<T: FromStr<Err = String> + Display + Default + PartialEq>(
        &mut self,
        ui: &mut Ui,
        [name, hint, explained]: [&str; 3],
        value: &mut T,
        places: &mut Vec<(String, Pos2)>,
    ) {
        ui.horizontal(|ui| {
            ui.label(weak(name));
            ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
                let is_default = *value == T::default();
                let known = || if is_default { String::new() } else { value.to_string() };
                let mut text = self.text.clone().unwrap_or_else(known);
                let hint = RichText::new(hint).color(WEAK.gamma_multiply(0.7));
                let edit = TextEdit::singleline(&mut text).id(Id::new(("points", name))).hint_text(hint);
                let edit = ui.add_sized(vec2(150.0, 18.0), edit).on_hover_text(explained);
                places.push((format!("points {name}"), edit.rect.center()));
                if edit.has_focus() {
                    places.push((format!("typing points {name}"), edit.rect.center()));
                } else if !edit.lost_focus() && self.wrong.is_none() {
                    // The panel was closed while it was typed.
                    self.text = None;
                }
                if edit.changed() {
                    self.text = Some(text.clone());
                }
                if edit.lost_focus()
                    && let Some(text) = &self.text
                {
                    let typed = if text.trim().is_empty() { Ok(T::default()) } else { text.parse() };
                    match typed {
                        Ok(typed) => {
                            *value = typed;
                            *self = Field::default();
                        }
                        Err(why) => self.wrong = Some(why),
                    }
                }
            });
        });
        if let Some(why) = &self.wrong {
            ui.label(RichText::new(why).color(WARN).small());
        }
    }
}

/// What is typed into the part.
#[derive(Debug, Default)]
pub struct SelectionPart {
    source_ids: Field,
    intensity: Field,
    heights: Field,
    gps_time: Field,
}

impl SelectionPart {
    /// The part. `unit`: of heights; `has_times`: there are GPS times; `places`: where what can be clicked lies, by names.
    pub fn show(
        &mut self,
        ui: &mut Ui,
        selection: &mut Selection,
        (status, unit, has_times): (&DataStatus, &str, bool),
        places: &mut Vec<(String, Pos2)>,
    ) {
        ui.horizontal(|ui| {
            ui.spacing_mut().item_spacing.x = 2.0;
            ui.label(weak("returns "));
            for (returns, words, hint) in [
                (Returns::All, "All", "every return of a pulse"),
                (Returns::First, "First", "the first return of each pulse"),
                (Returns::Last, "Last", "the last return of each pulse"),
                (Returns::Only, "Only", "returns of pulses that have no other"),
            ] {
                let choice = ui.selectable_value(&mut selection.returns, returns, words).on_hover_text(hint);
                places.push((format!("returns {}", returns.name()), choice.rect.center()));
            }
        });
        let ends = "both ends among them; open: 100.. or ..2000";
        let names = ["source id", "e.g. 3,7-9", "point source ids: flight lines, as a rule"];
        self.source_ids.show(ui, names, &mut selection.source_ids, places);
        let names = ["intensity", "e.g. 100..2000", &format!("as stored, {ends}")];
        self.intensity.show(ui, names, &mut selection.intensity, places);
        let names = ["heights", "e.g. 120..200", &format!("{unit}, {ends}")];
        self.heights.show(ui, names, &mut selection.heights, places);
        if has_times || !selection.gps_time.is_all() {
            let names = ["GPS time", "from..to", &format!("s, as stored, {ends}")];
            self.gps_time.show(ui, names, &mut selection.gps_time, places);
        }
        if !selection.is_all() {
            ui.horizontal(|ui| {
                let button = ui.add(Button::new(RichText::new("All points").size(12.0)).small());
                places.push(("all points".to_owned(), button.rect.center()));
                if button.clicked() {
                    *selection = Selection::default();
                    *self = SelectionPart::default();
                }
            });
        }
        if let Some(words) = rereading(status) {
            ui.label(RichText::new(words).color(ACCENT).small());
        }
    }
}

/// What is read again, and how far that is.
pub fn rereading(status: &DataStatus) -> Option<String> {
    let what = status.rereading.as_ref()?;
    let [ready, wanted] = [status.sections_resident, status.sections_wanted];
    Some(format!("re-reading points: {what}, {ready} of {wanted} sections"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::SourceIds;

    #[test]
    fn what_was_typed_and_left_is_forgotten_but_for_what_is_wrong() {
        let shown = |field: &mut Field| {
            let mut value = SourceIds::default();
            let mut output = egui::Context::default().run_ui(egui::RawInput::default(), |ui| {
                field.show(ui, ["source id", "", ""], &mut value, &mut Vec::new());
            });
            output.textures_delta.clear();
            (value.is_all(), field.text.clone())
        };
        let typed = || Some("7-".to_owned());
        assert_eq!(shown(&mut Field { text: typed(), wrong: None }), (true, None));
        assert_eq!(shown(&mut Field { text: typed(), wrong: typed() }), (true, typed()));
    }

    #[test]
    fn what_is_read_again_is_told_while_it_is() {
        let mut status = DataStatus { sections_resident: 37, sections_wanted: 120, ..DataStatus::default() };
        assert_eq!(rereading(&status), None);
        status.rereading = Some("first returns".to_owned());
        assert_eq!(rereading(&status).unwrap(), "re-reading points: first returns, 37 of 120 sections");
    }
}
