//! The camera and the image size that the arguments ask for.

use super::args::Args;
use crate::command::UsageError;
use crate::command::values::Orbit;
use crate::coords::{Bounds, Grid, Hull};
use crate::load::About;
use crate::render::camera::{Camera, CameraError, DEFAULT_ORBIT, Projection};
use crate::render::frame::Shade;
use crate::text::tidy;
use glam::DVec3;

/// Straight down: a map.
const PLUMB: f64 = 90.0;
/// Most pixels each way of a picture that is as large as the data.
const MOST_PIXELS: f64 = 65_536.0;

/// What is framed of the data as they are shown.
pub(super) fn framed(args: &Args, about: &About, grid: &Grid) -> Hull {
    let (cell, height_step) = (grid.cell(), grid.height_step);
    // A map is of the points' extent; in a view, the cells of a few points reach far beyond it.
    let hull = match args.ortho {
        Some(_) if about.outline.hull.bounds().size().max_element() < cell => {
            Hull::from(&about.outline.hull.bounds().at_least(cell))
        }
        Some(_) => about.outline.hull.clone(),
        None => about.outline.hull.of_cells(cell),
    };
    let solid = match args.shade {
        // What is interpolated is rounded, so that it is the same wherever in its CRS the data lies.
        Shade::Lit => hull.on_slab(&about.slab(cell)).snapped(height_step),
        Shade::None => hull,
    };
    solid.exaggerated(args.z_scale, about.bounds.min.z)
}

/// What the arguments say of the camera, in E, N, U as they are shown.
pub(super) struct Asked {
    /// Units that a pixel of parallel rays shows.
    pub(super) units: Option<f64>,
    pub(super) eye: Option<DVec3>,
    pub(super) target: Option<DVec3>,
}

/// Camera and image size that the arguments ask for, over `hull` as it is shown.
pub(super) fn camera(args: &Args, hull: &Hull, asked: &Asked) -> anyhow::Result<(Camera, [u32; 2])> {
    let projection = match asked.units {
        Some(units_per_pixel) => Projection::Orthographic { units_per_pixel },
        None => Projection::Perspective { fov: args.fov },
    };
    let orbit = args.orbit.unwrap_or(Orbit {
        angles: if asked.units.is_some() { [0.0, PLUMB] } else { DEFAULT_ORBIT },
        distance: None,
    });
    let bounds = hull.bounds();
    let map = asked.units.filter(|_| orbit.angles[1] == PLUMB);
    let size = match (args.size, asked.units) {
        (Some(size), _) => size,
        (None, Some(units)) => match map {
            Some(units) => of_pixels(pixels_around(&bounds, units), units)?,
            None => ortho_size(hull, orbit.angles, units)?,
        },
        (None, None) => [1280, 720],
    };
    // Pixels of maps lie on one grid.
    let placed = |middle: DVec3| map.map_or(middle, |units| on_grid(middle, size, units));
    let camera = match (asked.eye, asked.target, orbit.distance) {
        // Places that were typed stay where they are.
        (Some(eye), Some(target), _) => Camera::look_at(eye, target, projection),
        (_, target, Some(distance)) => {
            Camera::orbit(placed(target.unwrap_or(bounds.center())), orbit.angles, distance, projection)
        }
        (_, target, None) => {
            let framed = Camera::frame_hull(hull, orbit.angles, projection, size).map_err(usage)?;
            match target.or(map.map(|_| bounds.center())) {
                Some(target) => {
                    let distance = (framed.eye() - bounds.center()).length();
                    Camera::orbit(placed(target), orbit.angles, distance, projection)
                }
                None => Ok(framed),
            }
        }
    };
    Ok((camera.map_err(usage)?, size))
}

/// What is to be said of a view in parallel, of so many pixels, that shows a part of `hull`; `None`: it shows all, or it was said
/// where it looks.
pub(super) fn cropped(args: &Args, hull: &Hull, camera: &Camera, size: [u32; 2]) -> Option<String> {
    let is_framed = args.path.is_none() && args.eye.is_none() && args.target.is_none();
    let Projection::Orthographic { units_per_pixel } = camera.projection() else { return None };
    let needed = [camera.right(), camera.up()].map(|axis| hull.extent(axis) / units_per_pixel);
    // A map's edges lie on multiples of a pixel.
    let is_cropped = needed.iter().zip(size).any(|(needed, pixels)| *needed > f64::from(pixels) + 1.0);
    let [width, height] = needed.map(|pixels| pixels.ceil());
    (is_framed && is_cropped).then(|| {
        format!(
            "the picture is of a part of the data: all of it takes {width}x{height} pixels at {} units each",
            tidy(units_per_pixel)
        )
    })
}

fn usage(error: CameraError) -> UsageError {
    UsageError(error.to_string())
}

/// How far two numbers of pixels that are the same may be apart, for rounding.
const SAME_PIXEL: f64 = 1e-6;

/// Pixels of a map of `bounds`: edges lie on multiples of `units`, so that maps of neighbours fit.
fn pixels_around(bounds: &Bounds, units: f64) -> [f64; 2] {
    let around = |low: f64, high: f64| {
        ((high / units - SAME_PIXEL).ceil() - (low / units + SAME_PIXEL).floor()).max(1.0)
    };
    [around(bounds.min.x, bounds.max.x), around(bounds.min.y, bounds.max.y)]
}

/// The middle of the map of `size` pixels that lies nearest to one around `middle` and has its edges on multiples of
/// `units`.
fn on_grid(middle: DVec3, size: [u32; 2], units: f64) -> DVec3 {
    let [width, height] = size.map(|pixels| 0.5 * f64::from(pixels));
    let on_grid = |middle: f64, half: f64| ((middle / units - half + 0.5).floor() + half) * units;
    DVec3::new(on_grid(middle.x, width), on_grid(middle.y, height), middle.z)
}

/// Pixels that show all of `hull` at `units` a pixel.
fn ortho_size(hull: &Hull, angles: [f64; 2], units: f64) -> anyhow::Result<[u32; 2]> {
    let looking = Camera::looking(DVec3::ZERO, angles, Projection::Orthographic { units_per_pixel: units })
        .map_err(usage)?;
    let along = |axis: DVec3| hull.extent(axis);
    of_pixels(
        [along(looking.right()), along(looking.up())].map(|extent| (extent / units).ceil().max(1.0)),
        units,
    )
}

fn of_pixels(pixels: [f64; 2], units: f64) -> anyhow::Result<[u32; 2]> {
    if pixels.iter().all(|&pixels| pixels <= MOST_PIXELS) {
        return Ok(pixels.map(|pixels| pixels as u32));
    }
    let [w, h] = pixels;
    let why = format!("at {units} units a pixel the data takes {w}x{h} pixels: give --size, or more units");
    Err(UsageError(why).into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_of_maps_lie_on_multiples_of_a_pixel() {
        for units in [0.25, 0.5, 0.7, 1.0, 3.0] {
            for (low, width) in [(0.0, 10.0), (229_970.925, 245.355), (-77.3, 0.01), (500_000.5, 0.0)] {
                let min = DVec3::new(low, 6_000_000.0 + low, 0.0);
                let bounds = Bounds { min, max: min + DVec3::new(width, 2.0 * width, 5.0) };
                let size = pixels_around(&bounds, units).map(|pixels| pixels as u32);
                let middle = on_grid(bounds.center(), size, units);
                for (axis, pixels) in [(0, size[0]), (1, size[1])] {
                    let half = 0.5 * f64::from(pixels) * units;
                    let edges = [middle[axis] - half, middle[axis] + half];
                    for edge in edges {
                        assert!(
                            ((edge / units).round() * units - edge).abs() < 1e-6,
                            "{units} {low}: {edge}"
                        );
                    }
                    // All of it, and less than a pixel more on each side.
                    assert!(edges[0] <= bounds.min[axis] + 1e-5 && edges[1] >= bounds.max[axis] - 1e-5);
                    assert!(
                        pixels == 1
                            || edges[0] > bounds.min[axis] - units && edges[1] < bounds.max[axis] + units
                    );
                }
            }
        }
    }
}
