//! What is drawn over the image: north arrow, scale bar, the frame of data that is still to come.

use super::navigate::{seen_at, units_per_pixel};
use crate::coords::Bounds;
use crate::render::camera::{Camera, Projection};
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

/// Where the compass is: its middle and its radius, points.
pub fn compass(area: ImageArea) -> (Pos2, f32) {
    let radius = 26.0;
    (pos2(area.rect.right() - MARGIN - radius, area.rect.top() + MARGIN + radius), radius)
}

/// Points to the north: a compass that lies flat, whatever the elevation.
pub fn north_arrow(painter: &Painter, area: ImageArea, camera: &Camera) {
    let (sin, cos) = (camera.angles()[0].to_radians() as f32).sin_cos();
    let north = vec2(-sin, -cos);
    let (center, radius) = compass(area);
    painter.circle_filled(center, radius, Color32::from_black_alpha(120));
    painter.circle_stroke(center, radius, Stroke::new(1.0, Color32::from_white_alpha(60)));
    let across = north.rot90() * 5.0;
    let middle = center - north * 4.0;
    let [tip, tail] = [middle + north * 15.0, middle - north * 15.0];
    painter.add(Shape::convex_polygon(vec![tip, middle + across, middle - across], NORTH, Stroke::NONE));
    painter.add(Shape::convex_polygon(vec![tail, middle - across, middle + across], INK, Stroke::NONE));
    text(painter, center + north * 18.5, Align2::CENTER_CENTER, "N", 11.0);
}

/// Where a scale bar holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ScalePlace {
    /// Everywhere: rays are parallel.
    Everywhere,
    /// As far away as what lies under the cursor.
    Cursor(DVec3),
    /// As far away as what lies in the middle of the image.
    Middle(DVec3),
}

impl ScalePlace {
    /// Of a camera's image, where something is known to lie under the cursor, or in the middle; `None`: nothing tells.
    pub fn of(camera: &Camera, cursor: Option<DVec3>, middle: Option<DVec3>) -> Option<ScalePlace> {
        match (camera.projection(), cursor, middle) {
            (Projection::Orthographic { .. }, ..) => Some(ScalePlace::Everywhere),
            (Projection::Perspective { .. }, Some(place), _) => Some(ScalePlace::Cursor(place)),
            (Projection::Perspective { .. }, None, middle) => middle.map(ScalePlace::Middle),
        }
    }
}

/// A bar of a round length, and where that holds; gives its words.
pub fn scale_bar(
    painter: &Painter,
    area: ImageArea,
    camera: &Camera,
    place: ScalePlace,
    unit: Option<&str>,
) -> Option<String> {
    let (at, holds) = match place {
        ScalePlace::Everywhere => (camera.target(), ""),
        ScalePlace::Cursor(at) => (at, " at the cursor"),
        ScalePlace::Middle(at) => (at, " in the middle"),
    };
    let points_per_pixel = f64::from(area.rect.width()) / f64::from(area.size[0].max(1));
    let per_point = units_per_pixel(camera, at, area.size) / points_per_pixel;
    if !(per_point.is_finite() && per_point > 0.0) {
        return None;
    }
    let length = round_length(LONGEST * per_point);
    let width = (length / per_point) as f32;
    let left = pos2(area.rect.left() + MARGIN, area.rect.bottom() - MARGIN);
    let words = format!("{}{holds}", length_text(length, unit));
    let galley = painter.layout_no_wrap(words.clone(), FontId::proportional(13.0), INK);
    // On a plate of its own: what is behind may be white.
    let [high, wide] = [galley.size().y, width.max(galley.size().x)];
    let plate = Rect::from_min_max(left - vec2(0.0, 8.0 + high), left + vec2(wide, 1.0));
    painter.rect_filled(plate.expand2(vec2(8.0, 6.0)), 5.0, Color32::from_black_alpha(130));
    let line = |painter: &Painter, by: Vec2, stroke: Stroke| {
        let (a, b) = (left + by, left + by + vec2(width, 0.0));
        painter.line_segment([a, b], stroke);
        for end in [a, b] {
            painter.line_segment([end - vec2(0.0, 6.0), end], stroke);
        }
    };
    line(painter, vec2(0.0, 1.0), Stroke::new(3.5, SHADOW));
    line(painter, Vec2::ZERO, Stroke::new(2.0, INK));
    // Over the bar's middle, but not over the image's border.
    let across = (width - galley.size().x).max(0.0) / 2.0;
    text(painter, left + vec2(across, -6.0), Align2::LEFT_BOTTOM, &words, 13.0);
    Some(words)
}

/// What an empty window says: title, and what can be done.
pub fn invitation(painter: &Painter, area: ImageArea) {
    let lines = [
        (20.0, "Drop LAS or LAZ files, or a folder of them, here"),
        (14.0, "Ctrl+O opens a folder, files or a saved view"),
        (14.0, "? lists keys and mouse"),
    ];
    let room = area.rect.width() - 2.0 * MARGIN;
    let mut at = area.rect.center() - vec2(0.0, 44.0);
    for (size, words) in lines {
        let galley = painter.layout(words.to_owned(), FontId::proportional(size), INK, room);
        painter.galley(at - vec2(galley.size().x / 2.0, 0.0), galley.clone(), INK);
        at.y += galley.size().y + 12.0;
    }
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
    fn a_scale_says_where_it_holds_or_is_not_there() {
        let camera = |projection| Camera::orbit(DVec3::ZERO, [0.0, 90.0], 10.0, projection).unwrap();
        let perspective = camera(Projection::default());
        let parallel = camera(Projection::Orthographic { units_per_pixel: 1.0 });
        let [cursor, middle] = [DVec3::X, DVec3::Y];
        let of = |camera, cursor, middle| ScalePlace::of(camera, cursor, middle);
        assert_eq!(of(&parallel, Some(cursor), None), Some(ScalePlace::Everywhere));
        assert_eq!(of(&perspective, Some(cursor), Some(middle)), Some(ScalePlace::Cursor(cursor)));
        assert_eq!(of(&perspective, None, Some(middle)), Some(ScalePlace::Middle(middle)));
        assert_eq!(of(&perspective, None, None), None);
    }

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
