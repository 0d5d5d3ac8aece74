//! The part of the panel about colours: the mode, its ramp and range, its legend.

use super::data::DataAbout;
use super::settings::{MORE_MODES, Scale, Settings, has_mode, modes};
use super::widgets::{WEAK, swatch, weak};
use crate::attribute::{Channel, ColorMode, ColorRange, ColorTable, Ramp, RangeEnd, ReturnKind, Spread};
use clap::ValueEnum;
use egui::{
    Align, Align2, Button, ComboBox, DragValue, FontId, Layout, Mesh, Pos2, Sense, Shape, Ui, pos2, vec2,
};
use std::cell::Cell;

const RETURNS: [ReturnKind; 5] =
    [ReturnKind::Single, ReturnKind::First, ReturnKind::Intermediate, ReturnKind::Last, ReturnKind::Unknown];

/// The ramp, with the values at its ends and in its middle.
fn legend(ui: &mut Ui, table: &ColorTable, (low, high): (f64, f64), unit: &str) {
    let (rect, _) = ui.allocate_exact_size(vec2(ui.available_width(), 14.0), Sense::hover());
    let mut mesh = Mesh::default();
    for (k, [r, g, b, _]) in table.table.iter().enumerate().step_by(3) {
        let [r, g, b] = [r, g, b].map(|v| (v * 255.0).round() as u8);
        let x = rect.left() + rect.width() * k as f32 / 255.0;
        for y in [rect.top(), rect.bottom()] {
            mesh.colored_vertex(pos2(x, y), egui::Color32::from_rgb(r, g, b));
        }
        if k > 0 {
            let n = mesh.vertices.len() as u32;
            mesh.add_triangle(n - 4, n - 3, n - 2);
            mesh.add_triangle(n - 3, n - 2, n - 1);
        }
    }
    ui.painter().add(Shape::mesh(mesh));
    let digits = if high - low < 20.0 { 1 } else { 0 };
    let number = |v: f64| format!("{v:.digits$}");
    let (line, _) = ui.allocate_exact_size(vec2(ui.available_width(), 14.0), Sense::hover());
    let font = FontId::proportional(11.0);
    let words = [number(low), number((low + high) / 2.0), format!("{} {unit}", number(high))];
    let aligns = [Align2::LEFT_CENTER, Align2::CENTER_CENTER, Align2::RIGHT_CENTER];
    let places = [line.left_center(), line.center(), line.right_center()];
    for ((words, align), at) in words.into_iter().zip(aligns).zip(places) {
        ui.painter().text(at, align, words, font.clone(), WEAK);
    }
}

/// Chooses the ramp and the values at its ends, of what is spread like `spread`; `None`: no percentiles are known.
fn choices(
    ui: &mut Ui,
    scale: &mut Scale,
    (shown, spread): ((f64, f64), Option<&Spread>),
    places: &mut Vec<(String, Pos2)>,
) {
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        let name = scale.ramp.map_or("usual ramp".to_owned(), Ramp::name);
        let ramps = ComboBox::from_id_salt("ramp").width(92.0).selected_text(name).show_ui(ui, |ui| {
            ui.selectable_value(&mut scale.ramp, None, "usual ramp");
            for ramp in Ramp::value_variants() {
                let choice = ui.selectable_value(&mut scale.ramp, Some(*ramp), ramp.name());
                places.push((format!("ramp {}", ramp.name()), choice.rect.center()));
            }
        });
        places.push(("ramps".to_owned(), ramps.response.rect.center()));
        let (low, high) = shown;
        let step = ((high - low) / 200.0).max(1e-3);
        let digits = (3.0 - (high - low).log10().floor()).clamp(1.0, 4.0) as usize;
        let value_of = |end: RangeEnd| match (end, spread) {
            (RangeEnd::Value(value), _) => Some(value),
            (percentile, spread) => spread.map(|spread| percentile.value(spread)),
        };
        let hint = if spread.is_some() { "a value, or a percentile such as 2%" } else { "a value" };
        // The end that was chosen.
        let mut end = |ui: &mut Ui, before: f64, asked: Option<RangeEnd>, name: &str| {
            let mut value = before;
            let typed = Cell::new(None);
            let parse = |text: &str| {
                let end = text.parse::<RangeEnd>().ok();
                let value = end.and_then(value_of);
                typed.set(end.filter(|_| value.is_some()));
                value
            };
            let edit = DragValue::new(&mut value)
                .speed(step)
                .max_decimals(digits)
                .update_while_editing(false)
                .custom_parser(parse);
            let what = match asked {
                Some(percentile @ RangeEnd::Percentile(_)) => format!(", {percentile} of the points"),
                _ => String::new(),
            };
            let edit = ui.add_sized(vec2(54.0, 18.0), edit);
            let edit = edit.on_hover_text(format!("{name} end of the ramp{what}: {hint}"));
            places.push((format!("range {name}"), edit.rect.center()));
            if edit.has_focus() {
                places.push((format!("typing range {name}"), edit.rect.center()));
            }
            // What is left as it was shown is left as it was, with all its digits.
            let is_other = (value - before).abs() > 0.51 * 0.1_f64.powi(digits as i32);
            let percentile = typed.get().filter(|end| matches!(end, RangeEnd::Percentile(_)));
            percentile.or((edit.changed() && is_other).then_some(RangeEnd::Value(value)))
        };
        let asked = scale.range.map(|range| [range.low, range.high]);
        let new_low = end(ui, low, asked.map(|[low, _]| low), "low");
        let new_high = end(ui, high, asked.map(|[_, high]| high), "high");
        if new_low.is_some() || new_high.is_some() {
            let [was_low, was_high] = asked.unwrap_or([low, high].map(RangeEnd::Value));
            let range = ColorRange { low: new_low.unwrap_or(was_low), high: new_high.unwrap_or(was_high) };
            if let (Some(low), Some(high)) = (value_of(range.low), value_of(range.high))
                && low < high
            {
                scale.range = Some(range);
            }
        }
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            let is_chosen = *scale != Scale::default();
            let reset =
                ui.add_enabled(is_chosen, Button::new("↺").small()).on_hover_text("as chosen from the data");
            places.push(("reset ramp".to_owned(), reset.rect.center()));
            if reset.clicked() {
                *scale = Scale::default();
            }
        });
    });
}

/// Modes in words that have no button.
fn more_words(mode: ColorMode) -> &'static str {
    match mode {
        ColorMode::SourceId => "Source id (flight line)",
        ColorMode::ScanAngle => "Scan angle",
        ColorMode::HeightAboveGround => "Height above ground",
        ColorMode::Density => "Point density",
        ColorMode::LineDifference => "Difference between flight lines",
        _ => "GPS time",
    }
}

/// Point source ids that are listed, those with most points.
const MOST_SOURCES: usize = 12;

/// The part. `colors`: those in use, with what they were made for; `places`: where what can be clicked lies, by names.
pub fn show(
    ui: &mut Ui,
    settings: &mut Settings,
    (about, colors): (Option<&DataAbout>, Option<(ColorMode, &ColorTable)>),
    places: &mut Vec<(String, Pos2)>,
) {
    let unit = about.and_then(|about| about.unit.as_ref()).map_or("", |u| u.symbol());
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 2.0;
        for mode in modes(about) {
            let words = match mode {
                ColorMode::Rgb => "RGB",
                ColorMode::Height => "Height",
                ColorMode::Class => "Class",
                ColorMode::Intensity => "Intensity",
                ColorMode::Return => "Return",
                _ => continue,
            };
            let choice = ui.selectable_value(&mut settings.color, mode, words);
            places.push((format!("mode {}", mode.name()), choice.rect.center()));
        }
        let more = ui.menu_button("…", |ui| {
            for mode in MORE_MODES.into_iter().filter(|mode| has_mode(about, *mode)) {
                let choice = ui.selectable_value(&mut settings.color, mode, more_words(mode));
                places.push((format!("mode {}", mode.name()), choice.rect.center()));
            }
        });
        let more = more
            .response
            .on_hover_text("heights above ground, flight lines and more: points are read again for them");
        places.push(("more modes".to_owned(), more.rect.center()));
    });
    if MORE_MODES.contains(&settings.color) {
        ui.label(more_words(settings.color));
    }
    let Some((made_for, table)) = colors else { return };
    // Until the points are read again.
    let is_before = made_for != settings.color;
    if is_before {
        ui.label(weak(format!("until the points are read again: {}", made_for.name())));
    }
    if let Some(constant) = &table.constant {
        ui.label(weak(constant));
        return;
    }
    match (table.mode, table.range) {
        (mode, Some(range)) => {
            let unit = match &table.channel {
                Some(channel) => channel.unit((!unit.is_empty()).then_some(unit)),
                None if mode == ColorMode::Height => unit.to_owned(),
                None => String::new(),
            };
            legend(ui, table, range, &unit);
            if let Some(scale) = settings.scale_mut().filter(|_| !is_before) {
                choices(ui, scale, (range, about.and_then(|about| mode.spread(&about.summary))), places);
            }
            if let Some(channel) = table.channel.filter(Channel::knows_none) {
                ui.horizontal(|ui| {
                    swatch(ui, table.of_channel(0));
                    ui.label(weak(channel.none_words()));
                });
            }
        }
        (ColorMode::Return, None) => {
            for kind in RETURNS {
                ui.horizontal(|ui| {
                    swatch(ui, kind.color());
                    ui.label(kind.name());
                });
            }
        }
        (ColorMode::SourceId, None) => {
            let mut ids = about.map_or(Vec::new(), |about| about.summary.source_ids.clone());
            let others = ids.len().saturating_sub(MOST_SOURCES);
            ids.sort_by_key(|(id, points)| (std::cmp::Reverse(*points), *id));
            ids.truncate(MOST_SOURCES);
            ids.sort_unstable();
            ui.horizontal_wrapped(|ui| {
                for (id, _) in ids {
                    swatch(ui, table.of_channel(id));
                    ui.label(id.to_string());
                }
                if others > 0 {
                    ui.label(weak(format!("and {others} more")));
                }
            });
        }
        (ColorMode::Class, None) => {
            ui.label(weak("the colours of the list of classes"));
        }
        (_, None) => {}
    }
}
