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

/// A number in few letters: 812, 45.1 k, 12.3 M, 3.21 G.
pub fn short(n: u64) -> String {
    let scaled = |unit: f64, name: &str| {
        let value = n as f64 / unit;
        let digits = if value < 10.0 { 2 } else { usize::from(value < 100.0) };
        format!("{value:.digits$} {name}")
    };
    match n {
        0..10_000 => n.to_string(),
        10_000..1_000_000 => scaled(1e3, "k"),
        1_000_000..1_000_000_000 => scaled(1e6, "M"),
        _ => scaled(1e9, "G"),
    }
}

/// Words that are said beside others.
pub fn weak(words: impl Into<String>) -> RichText {
    RichText::new(words).color(WEAK)
}

/// A colour.
pub fn swatch(ui: &mut Ui, [r, g, b]: [u8; 3]) {
    let (rect, _) = ui.allocate_exact_size(vec2(12.0, 12.0), Sense::hover());
    ui.painter().rect_filled(rect, 2.0, Color32::from_rgb(r, g, b));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        let numbers = [0, 999, 9_999, 12_345, 812_000, 1_234_567, 45_600_000, 3_210_000_000];
        let words = ["0", "999", "9999", "12.3 k", "812 k", "1.23 M", "45.6 M", "3.21 G"];
        assert_eq!(numbers.map(short), words);
    }
}
