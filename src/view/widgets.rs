//! What the parts of the panel are made of: colours, words, small signs.

use egui::{Color32, RichText, Sense, Ui, vec2};

/// Height of a line of a list.
pub const LINE: f32 = 20.0;
/// What is to be read.
pub const TEXT: Color32 = Color32::from_rgb(218, 221, 226);
/// What is said beside it.
pub const WEAK: Color32 = Color32::from_rgb(142, 148, 158);
/// What is on, or done.
pub const ACCENT: Color32 = Color32::from_rgb(86, 156, 214);
/// What is not as it should be.
pub const WARN: Color32 = Color32::from_rgb(230, 170, 80);

/// Words that are said beside others.
pub fn weak(words: impl Into<String>) -> RichText {
    RichText::new(words).color(WEAK)
}

/// A colour.
pub fn swatch(ui: &mut Ui, [r, g, b]: [u8; 3]) {
    let (rect, _) = ui.allocate_exact_size(vec2(12.0, 12.0), Sense::hover());
    ui.painter().rect_filled(rect, 2.0, Color32::from_rgb(r, g, b));
}
