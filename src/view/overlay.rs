//! What is drawn over the image: north arrow, scale bar, the frame of data that is still to come.

use super::navigate::{seen_at, units_per_pixel};
use crate::coords::Bounds;
use crate::render::camera::Camera;
use crate::text::tidy;
use egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Shape, Stroke, Vec2, pos2, vec2};
use glam::DVec3;

/// Over an image of any brightness.
const INK: Color32 = Color32::from_rgb(246, 247, 248);
const SHADOW: Color32 = Color32::from_black_alpha(150);
const NORTH: Color32 = Color32::from_rgb(232, 86, 66);
/// Distance from the image's corner, points.
const MARGIN: f32 = 18.0;
/// Longest scale bar, points.
const LONGEST: f64 = 180.0;

/// The image's part of the window: points, and the pixels in it.
#[derive(Clone, Copy)]
pub struct ImageArea {
    /// In points.
    pub rect: Rect,
    /// In pixels.
    pub size: [u32; 2],
}

impl ImageArea {
    /// A place in the image, pixels from its corner, in shares of its width and height.
    pub fn share(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [width, height] = self.size.map(|n| f64::from(n.max(1)));
        [x / width, y / height]
    }
}

/// 1, 2 or 5 times a power of ten, at most `most`.
pub fn round_length(most: f64) -> f64 {
    let power = most.log10().floor();
    let unit = 10f64.powf(power);
    [5.0, 2.0, 1.0]
        .into_iter()
        .map(|k| k * unit)
        .find(|length| *length <= most * (1.0 + 1e-9))
        .unwrap_or(unit)
}

/// A length with its unit; metres turn into kilometres, other units stay what they are.
pub fn length_text(length: f64, unit: Option<&str>) -> String {
    match unit {
        Some("m") if length >= 1000.0 => format!("{} km", tidy(length / 1000.0)),
        Some("m") if length < 1.0 => format!("{} cm", tidy((length * 1e4).round() / 100.0)),
        Some(unit) => format!("{} {unit}", tidy(length)),
        None => format!("{} units", tidy(length)),
    }
}

fn text(painter: &Painter, at: Pos2, align: Align2, words: &str, size: f32) -> Rect {
    let font = FontId::proportional(size);
    painter.text(at + vec2(0.0, 1.0), align, words, font.clone(), SHADOW);
    painter.text(at, align, words, font, INK)
}

/// Points to the north: a compass that lies flat, whatever the elevation.
pub fn north_arrow(painter: &Painter, area: ImageArea, camera: &Camera) {
    let (sin, cos) = (camera.angles()[0].to_radians() as f32).sin_cos();
    let north = vec2(-sin, -cos);
    let radius = 26.0;
    let center = pos2(area.rect.right() - MARGIN - radius, area.rect.top() + MARGIN + radius);
    painter.circle_filled(center, radius, Color32::from_black_alpha(120));
    painter.circle_stroke(center, radius, Stroke::new(1.0, Color32::from_white_alpha(60)));
    let across = north.rot90() * 5.0;
    let middle = center - north * 4.0;
    let [tip, tail] = [middle + north * 15.0, middle - north * 15.0];
    painter.add(Shape::convex_polygon(vec![tip, middle + across, middle - across], NORTH, Stroke::NONE));
    painter.add(Shape::convex_polygon(vec![tail, middle - across, middle + across], INK, Stroke::NONE));
    text(painter, center + north * 18.5, Align2::CENTER_CENTER, "N", 11.0);
}

/// A bar of a round length at the distance of `target`, the middle of what is looked at.
pub fn scale_bar(painter: &Painter, area: ImageArea, camera: &Camera, target: DVec3, unit: Option<&str>) {
    let points_per_pixel = f64::from(area.rect.width()) / f64::from(area.size[0].max(1));
    let per_point = units_per_pixel(camera, target, area.size) / points_per_pixel;
    if !(per_point.is_finite() && per_point > 0.0) {
        return;
    }
    let length = round_length(LONGEST * per_point);
    let width = (length / per_point) as f32;
    let left = pos2(area.rect.left() + MARGIN, area.rect.bottom() - MARGIN);
    let line = |painter: &Painter, by: Vec2, stroke: Stroke| {
        let (a, b) = (left + by, left + by + vec2(width, 0.0));
        painter.line_segment([a, b], stroke);
        for end in [a, b] {
            painter.line_segment([end - vec2(0.0, 6.0), end], stroke);
        }
    };
    line(painter, vec2(0.0, 1.0), Stroke::new(3.5, SHADOW));
    line(painter, Vec2::ZERO, Stroke::new(2.0, INK));
    let middle = left + vec2(width / 2.0, -6.0);
    text(painter, middle, Align2::CENTER_BOTTOM, &length_text(length, unit), 13.0);
}

/// A ring around a place, seen through whatever is before it.
pub fn mark(painter: &Painter, area: ImageArea, camera: &Camera, place: DVec3) {
    let Some([x, y]) = seen_at(camera, place, area.size) else { return };
    let at = area.rect.min + vec2(x as f32 * area.rect.width(), y as f32 * area.rect.height());
    painter.circle_stroke(at, 7.0, Stroke::new(3.5, SHADOW));
    painter.circle_stroke(at, 7.0, Stroke::new(1.8, INK));
}

/// The edges of `bounds`.
pub fn frame(painter: &Painter, area: ImageArea, camera: &Camera, bounds: &Bounds) {
    let corner = |k: usize| {
        let pick = |bit: usize, a: f64, b: f64| if k & bit == 0 { a } else { b };
        let (low, high) = (bounds.min, bounds.max);
        DVec3::new(pick(1, low.x, high.x), pick(2, low.y, high.y), pick(4, low.z, high.z))
    };
    let at = |k: usize| {
        let [x, y] = seen_at(camera, corner(k), area.size)?;
        Some(area.rect.min + vec2(x as f32 * area.rect.width(), y as f32 * area.rect.height()))
    };
    for a in 0..8 {
        for bit in [1, 2, 4] {
            if a & bit == 0
                && let (Some(from), Some(to)) = (at(a), at(a | bit))
            {
                painter.line_segment([from, to], Stroke::new(1.0, Color32::from_white_alpha(120)));
            }
        }
    }
}

/// A line for the user in the image's lower middle.
pub fn notice(painter: &Painter, area: ImageArea, words: &str) {
    let at = pos2(area.rect.center().x, area.rect.bottom() - 60.0);
    let room = area.rect.width() - 2.0 * MARGIN;
    let galley = painter.layout(words.to_owned(), FontId::proportional(14.0), INK, room);
    let rect = Rect::from_center_size(at, galley.size());
    painter.rect_filled(rect.expand2(vec2(14.0, 9.0)), 6.0, Color32::from_black_alpha(190));
    painter.galley(rect.min, galley, INK);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_have_round_lengths_in_their_unit() {
        assert_eq!(round_length(183.0), 100.0);
        assert_eq!(round_length(1000.0), 1000.0);
        assert_eq!(round_length(0.7), 0.5);
        assert_eq!(length_text(2000.0, Some("m")), "2 km");
        assert_eq!(length_text(500.0, Some("m")), "500 m");
        assert_eq!(length_text(0.2, Some("m")), "20 cm");
        assert_eq!(length_text(2000.0, Some("ft")), "2000 ft", "feet stay feet");
        assert_eq!(length_text(5.0, None), "5 units");
    }
}
