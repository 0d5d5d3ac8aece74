//! The twin of `shaders/color.glsl` and `shaders/shade.comp`: hits to linear colours, in f64 over the finest cells.

use super::columns::{Column, ColumnMap};
use super::trace::{Face, Hit};
use crate::attribute::{ColorMode, ColorTable};
use crate::render::camera::RayBasis;
use crate::render::frame::{Background, Shade, View, sun};
use glam::{DVec2, DVec3};

/// Columns at these distances dim the sky.
const REACH: [i64; 5] = [1, 2, 4, 7, 12];
/// In these directions.
const WAYS: [[i64; 2]; 8] = [[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1]];

/// Linear colour and coverage of a pixel of `view` whose ray, as it runs through unexaggerated data, has hit `hit`.
pub fn shade(
    map: &ColumnMap,
    view: &View,
    rays: &RayBasis,
    [px, py]: [f64; 2],
    hit: Option<Hit>,
) -> [f64; 4] {
    let along = rays.direction(px, py) * DVec3::new(1.0, 1.0, view.z_scale);
    let lit = view.shade == Shade::Lit;
    // Below the slab a lit image shows what is behind the sides of columns.
    let Some(hit) = hit.filter(|hit| !lit || is_seen(map, view, hit)) else {
        return background(view.background, along.normalize());
    };
    let is_slab =
        lit && hit.face != Face::Top && ground(map, view, &hit).is_some_and(|ground| hit.height < ground);
    let albedo = if is_slab { SLAB } else { srgb(view.colors, &hit.column).map(linear) };
    let color = if lit { DVec3::from(albedo) * light(map, view, &hit, is_slab) } else { DVec3::from(albedo) };
    [color.x, color.y, color.z, 1.0]
}

/// What the slab below the ground is of, linear.
const SLAB: [f64; 3] = [0.26, 0.25, 0.235];

/// Height of the ground at a hit's column, in rough outline; `None` where nothing ends below.
fn ground(map: &ColumnMap, view: &View, hit: &Hit) -> Option<f64> {
    let middle = DVec2::new(hit.cell[0] as f64 + 0.5, hit.cell[1] as f64 + 0.5) * map.cell_size;
    view.slab.as_ref().map(|slab| slab.low.at(middle))
}

/// Whether a lit image shows this, and not what is behind it.
pub fn is_seen(map: &ColumnMap, view: &View, hit: &Hit) -> bool {
    let (Some(ground), Some(slab)) = (ground(map, view, hit), &view.slab) else { return true };
    hit.face == Face::Top || hit.height >= ground.min(map.top(&hit.column)) - slab.thickness
}

/// Colour of a column, sRGB: see [`ColorTable`].
fn srgb(colors: &ColorTable, column: &Column) -> [f64; 3] {
    let value = match colors.mode {
        ColorMode::Rgb => return column.rgb.map(|v| f64::from(v) / 255.0),
        ColorMode::Height => (column.height_steps + (1 << 31)) as u32,
        ColorMode::Class => column.class.into(),
        ColorMode::GpsTime
        | ColorMode::HeightAboveGround
        | ColorMode::Density
        | ColorMode::LineDifference
            if column.intensity == 0 =>
        {
            return [0.65; 3];
        }
        ColorMode::Intensity
        | ColorMode::ScanAngle
        | ColorMode::GpsTime
        | ColorMode::HeightAboveGround
        | ColorMode::Density
        | ColorMode::LineDifference => column.intensity.into(),
        ColorMode::SourceId => {
            let entry = (u32::from(column.intensity) + column.intensity as u32 / 256 * colors.lo) % 256;
            let [r, g, b, _] = colors.table[entry as usize].map(f64::from);
            return [r, g, b];
        }
        ColorMode::Return => column.returns.into(),
    };
    let beyond = f64::from(value.saturating_sub(colors.lo)) * f64::from(colors.scale);
    let entry = (beyond + f64::from(colors.offset)).clamp(0.0, 255.0);
    let [below, above] =
        [entry as usize, (entry as usize + 1).min(255)].map(|k| colors.table[k].map(f64::from));
    std::array::from_fn(|k| below[k] + (above[k] - below[k]) * entry.fract())
}

fn linear(v: f64) -> f64 {
    if v > 0.04045 { ((v + 0.055) / 1.055).powf(2.4) } else { v / 12.92 }
}

/// What is behind the data in a direction as shown.
fn background(background: Background, direction: DVec3) -> [f64; 4] {
    match background {
        Background::None => [0.0; 4],
        Background::White => [1.0; 4],
        Background::Sky => {
            let up = direction.z;
            let away = if up >= 0.0 { DVec3::new(0.30, 0.49, 0.76) } else { DVec3::new(0.62, 0.67, 0.72) };
            let sky = DVec3::new(0.82, 0.87, 0.92).lerp(away, smoothstep(0.0, 0.75, up.abs()));
            let [r, g, b] = sky.to_array().map(linear);
            [r, g, b, 1.0]
        }
    }
}

fn smoothstep(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Light on a hit: sun, sky, and what the ground throws back.
fn light(map: &ColumnMap, view: &View, hit: &Hit, is_slab: bool) -> DVec3 {
    // CRS units up that are seen as steep as a cell's side is long.
    let steep = map.cell_size / view.z_scale;
    let top = map.top(&hit.column);
    let z = if hit.face == Face::Top { top } else { hit.height };
    let slope = slope(map, hit.cell, top, steep);
    let slope = slope * (1.0 + 1.3 / (1.0 + 4.0 * slope.length_squared()));
    let up = DVec3::new(-slope.x, -slope.y, 1.0).normalize();
    let outward = match hit.face {
        Face::Top | Face::Inside | Face::Bottom => None,
        Face::West => Some(DVec2::NEG_X),
        Face::East => Some(DVec2::X),
        Face::South => Some(DVec2::NEG_Y),
        Face::North => Some(DVec2::Y),
    };
    // A low step of a slope is part of the slope; a wall is a wall.
    let normal = outward.map_or(up, |outward| {
        let wall = smoothstep(0.2, 1.5, (top - z) / steep + 0.6);
        up.lerp(outward.extend(0.0), wall).normalize()
    });
    // The slab is one plain band.
    let (normal, sky) = match is_slab {
        true => (outward.unwrap_or(DVec2::ZERO).extend(0.0), 1.0),
        false => (normal, sky(map, hit.cell, z, outward.unwrap_or(DVec2::ZERO), steep)),
    };
    let sunlight = DVec3::new(1.0, 0.96, 0.88) * 2.00 * normal.dot(sun()).max(0.0) * (0.5 + 0.5 * sky);
    let skylight = DVec3::new(0.62, 0.70, 0.82) * (0.55 + 0.45 * normal.z) * sky * sky;
    let light = sunlight + skylight * 0.28 + 0.02 + 0.20 * (1.0 - normal.z).powi(2);
    // Photographs hold light already.
    if view.colors.mode == ColorMode::Rgb { DVec3::splat(1.2).lerp(light, 0.6) } else { light }
}

fn top_at(map: &ColumnMap, [i, j]: [i64; 2], [di, dj]: [i64; 2]) -> Option<f64> {
    map.column([i + di, j + dj]).map(|column| map.top(column))
}

/// Slope that fits the 24 columns around, those on another surface counting little.
fn slope(map: &ColumnMap, cell: [i64; 2], top: f64, steep: f64) -> DVec2 {
    let (mut xx, mut xy, mut yy, mut xh) = (0.05, 0.0, 0.05, DVec2::ZERO);
    for (x, y) in (-2..=2).flat_map(|y| (-2..=2).map(move |x| (x, y))).filter(|at| *at != (0, 0)) {
        let Some(other) = top_at(map, cell, [x, y]) else { continue };
        let at = DVec2::new(x as f64, y as f64);
        let (d2, rise) = (at.length_squared(), (other - top) / steep);
        let excess = rise * rise / d2;
        let weight = 1.0 / (d2 * (1.0 + excess * excess));
        xx += weight * at.x * at.x;
        xy += weight * at.x * at.y;
        yy += weight * at.y * at.y;
        xh += weight * rise * at;
    }
    DVec2::new(yy * xh.x - xy * xh.y, xx * xh.y - xy * xh.x) / (xx * yy - xy * xy)
}

/// Share of the sky seen from height `z`, in directions with a part along `outward`.
fn sky(map: &ColumnMap, cell: [i64; 2], z: f64, outward: DVec2, steep: f64) -> f64 {
    let (mut seen, mut ways) = (0.0, 0.0);
    for [x, y] in WAYS {
        let way = DVec2::new(x as f64, y as f64);
        if way.dot(outward) < 0.0 {
            continue;
        }
        let horizon = REACH
            .into_iter()
            .filter_map(|r| {
                Some((top_at(map, cell, [x * r, y * r])? - z) / (steep * way.length() * r as f64) - 0.08)
            })
            .fold(0.0, f64::max);
        seen += 1.0 / (1.0 + horizon * horizon);
        ways += 1.0;
    }
    seen / f64::max(ways, 1.0)
}
