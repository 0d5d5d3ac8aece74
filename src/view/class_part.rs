//! The part of the panel about classes: which are shown, one by one or by presets, and how many points they have.

use super::layers::{Alone, PRESETS, inverted};
use super::numbers::{grouped, rough};
use super::widgets::{LINE, TEXT, WEAK, swatch, weak};
use crate::attribute::{ClassMask, Flags, KindCounts, class_color, class_name};
use crate::resident::visibility::Visibility;
use egui::{
    Align, Align2, Button, Checkbox, FontId, Id, Label, Layout, Pos2, Rect, RichText, Sense, Ui, vec2,
};

/// Classes that are listed even if there are none: they are hidden at first.
const NOISE: [u8; 2] = [7, 18];

/// What the number of points of a class is.
fn about_count(class: u8, counts: &KindCounts) -> String {
    let number = if counts.is_exact { grouped } else { rough };
    let of_flag = |(flag, name)| match counts.flagged(class, flag) {
        0 => None,
        n if flag == Flags::WITHHELD => Some(format!("{} are withheld", number(n))),
        n => Some(format!("{} are flagged {name}", number(n))),
    };
    let flagged: Vec<_> = Flags::ALL.each().filter_map(of_flag).collect();
    let of_which = if flagged.is_empty() { "" } else { ", of which " };
    let estimated = if counts.is_exact { "" } else { ": estimated, until every point was read" };
    format!("{} points{of_which}{}{estimated}", number(counts.of_class(class)), flagged.join(", "))
}

/// What is done with a class.
#[derive(Clone, Copy, PartialEq)]
enum Asked {
    Toggle,
    Alone,
}

/// The line of a class. `is_alone`: it is shown alone since that was asked for.
fn line(
    ui: &mut Ui,
    class: u8,
    [mut is_shown, is_alone]: [bool; 2],
    counts: &KindCounts,
    places: &mut Vec<(String, Pos2)>,
) -> Option<Asked> {
    let mut asked = None;
    let rect = Rect::from_min_size(ui.cursor().min, vec2(ui.available_width(), LINE));
    let is_hovered = ui.rect_contains_pointer(rect.expand2(ui.spacing().item_spacing * vec2(0.0, 0.5)));
    // Where a window manager leaves it to the window.
    let clicked = if ui.input(|input| input.modifiers.alt) { Asked::Alone } else { Asked::Toggle };
    ui.horizontal(|ui| {
        let check = ui.add(Checkbox::without_text(&mut is_shown));
        places.push((format!("class {class}"), check.rect.center()));
        asked = check.changed().then_some(clicked);
        swatch(ui, class_color(class));
        // Numbers of one to three digits, names in line.
        let (number, _) = ui.allocate_exact_size(vec2(20.0, LINE), Sense::hover());
        let font = FontId::proportional(13.0);
        ui.painter().text(number.right_center(), Align2::RIGHT_CENTER, class, font, WEAK);
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            let points = counts.of_class(class);
            if points > 0 {
                let words = if counts.is_exact { grouped(points) } else { rough(points) };
                ui.label(weak(words)).on_hover_text(about_count(class, counts));
            }
            if is_hovered || is_alone {
                let (words, hint) = match is_alone {
                    true => ("back", "what was shown before"),
                    false => ("only", "this class alone, as Alt and a click on its name"),
                };
                let button = ui.add(Button::new(RichText::new(words).size(11.0)).small().selected(is_alone));
                places.push((format!("{words} {class}"), button.rect.center()));
                if button.on_hover_text(hint).clicked() {
                    asked = Some(Asked::Alone);
                }
            }
            // The name has what is left.
            ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
                let name = RichText::new(class_name(class)).color(if is_shown { TEXT } else { WEAK });
                let label = ui.add(Label::new(name).selectable(false).truncate());
                // By a name of its own: it is the same whether there is a button before it or not.
                let label = ui.interact(label.rect, Id::new(("class", class)), Sense::click());
                places.push((format!("name {class}"), label.rect.left_center() + vec2(8.0, 0.0)));
                if label.clicked() {
                    asked = Some(clicked);
                }
            });
        });
    });
    asked
}

/// Buttons for many classes at once.
fn buttons(ui: &mut Ui, visibility: &mut Visibility, counts: &KindCounts, places: &mut Vec<(String, Pos2)>) {
    let words = |label: &str| RichText::new(label).size(12.0);
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing = vec2(4.0, 4.0);
        let mask = &mut visibility.classes;
        for preset in &PRESETS {
            let shows_any = preset.shows_any(counts, visibility.hidden_flags);
            let is_shown = shows_any && preset.is_shown(mask, counts);
            let button = Button::new(words(preset.label)).small().selected(is_shown);
            let button = ui.add_enabled(shows_any, button).on_hover_text(preset.words());
            let place = if shows_any { "preset" } else { "no preset" };
            places.push((format!("{place} {}", preset.name), button.rect.center()));
            let none = || format!("no point that is known is of {}", preset.words());
            if button.on_disabled_hover_text(none()).clicked() {
                *mask = preset.mask();
            }
        }
        for (label, hint, name, change) in [
            ("All", "noise, too", "all classes", (|_| ClassMask::all()) as fn(ClassMask) -> ClassMask),
            ("None", "nothing", "no classes", |_| ClassMask::only(&[])),
            ("Invert", "what is hidden, and nothing else", "invert classes", inverted),
        ] {
            let button = ui.add(Button::new(words(label)).small()).on_hover_text(hint);
            places.push((name.to_owned(), button.rect.center()));
            if button.clicked() {
                *mask = change(*mask);
            }
        }
    });
}

/// The part. `counts`: points of each class, once something is known of the data; `places`: where what can be clicked lies,
/// by names.
pub fn show(
    ui: &mut Ui,
    visibility: &mut Visibility,
    (alone, counts): (&mut Alone, Option<&KindCounts>),
    places: &mut Vec<(String, Pos2)>,
) {
    let Some(counts) = counts else {
        ui.label(weak("…"));
        return;
    };
    let listed = |class: &u8| counts.of_class(*class) > 0 || NOISE.contains(class);
    let mask = &mut visibility.classes;
    for class in (0..=255u8).filter(listed) {
        let is_shown = mask.shows(class);
        match line(ui, class, [is_shown, alone.is(class, mask)], counts, places) {
            Some(Asked::Toggle) if is_shown => *mask = mask.without(&[class]),
            Some(Asked::Toggle) => *mask = mask.with(&[class]),
            Some(Asked::Alone) => alone.toggle(class, mask),
            None => {}
        }
    }
    buttons(ui, visibility, counts, places);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_say_what_they_are() {
        let counts = |of: &[(Flags, u64)], is_exact| {
            let of = of.iter().map(|(flags, points)| ((2, *flags), *points)).collect();
            about_count(2, &KindCounts { of, is_exact })
        };
        assert_eq!(counts(&[(Flags::NONE, 72_763)], true), "72,763 points");
        assert_eq!(
            counts(&[(Flags::NONE, 23_900), (Flags::WITHHELD, 512)], false),
            "~24 k points, of which ~510 are withheld: estimated, until every point was read"
        );
        let both = Flags::WITHHELD.with(Flags::OVERLAP);
        assert_eq!(
            counts(&[(Flags::NONE, 7), (Flags::OVERLAP, 2), (both, 3)], true),
            "12 points, of which 3 are withheld, 5 are flagged overlap"
        );
    }
}
