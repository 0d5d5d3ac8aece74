//! The camera and the image size that the arguments ask for.

use super::args::Args;
use crate::command::UsageError;
use crate::command::values::Orbit;
use crate::coords::Bounds;
use crate::render::camera::{Camera, DEFAULT_ORBIT, Projection};
use crate::render::frame::Shade;
use glam::DVec3;

/// What is framed of `bounds` as they are shown; `floor`: where lit columns end, `cell`: side of a cell.
pub(super) fn framed(args: &Args, bounds: &Bounds, floor: f64, cell: f64) -> Bounds {
    let pivot = bounds.min.z;
    let slab = Bounds { min: bounds.min.with_z(floor), ..*bounds };
    let solid = if args.shade == Shade::Lit { slab } else { *bounds };
    let shown = solid.exaggerated(args.z_scale, pivot);
    // A map is of the points' extent; in a view, the cells of a few points reach far beyond it.
    if args.ortho.is_none() { shown.of_cells(cell) } else { shown.at_least(cell) }
}

/// Camera and image size that the arguments ask for, over `bounds` as they are shown.
pub(super) fn camera(
    args: &Args,
    bounds: &Bounds,
    place: impl Fn(DVec3) -> DVec3,
) -> anyhow::Result<(Camera, [u32; 2])> {
    let usage = |e: crate::render::camera::CameraError| UsageError(e.to_string());
    let projection = match args.ortho {
        Some(units_per_pixel) => Projection::Orthographic { units_per_pixel },
        None => Projection::Perspective { fov: args.fov },
    };
    let orbit = args.orbit.unwrap_or(Orbit {
        angles: if args.ortho.is_some() { [0.0, 90.0] } else { DEFAULT_ORBIT },
        distance: None,
    });
    let size = match (args.size, args.ortho) {
        (Some(size), _) => size,
        (None, Some(units)) => ortho_size(bounds, orbit.angles, units)?,
        (None, None) => [1280, 720],
    };
    let camera = match (args.eye, args.target) {
        (Some(eye), Some(target)) => Camera::look_at(place(eye), place(target), projection),
        (_, target) => match orbit.distance {
            Some(distance) => {
                let target = target.map_or(bounds.center(), place);
                Camera::orbit(target, orbit.angles, distance, projection)
            }
            None => match target {
                Some(target) => {
                    let framed = Camera::frame(bounds, orbit.angles, projection, size).map_err(usage)?;
                    let distance = (framed.eye() - bounds.center()).length();
                    Camera::orbit(place(target), orbit.angles, distance, projection)
                }
                None => Camera::frame(bounds, orbit.angles, projection, size),
            },
        },
    };
    Ok((camera.map_err(usage)?, size))
}

/// Pixels that show all of `bounds` at `units` a pixel.
fn ortho_size(bounds: &Bounds, angles: [f64; 2], units: f64) -> anyhow::Result<[u32; 2]> {
    let looking = Camera::looking(DVec3::ZERO, angles, Projection::Orthographic { units_per_pixel: units })
        .map_err(|e| UsageError(e.to_string()))?;
    let half = (bounds.max - bounds.min) * 0.5;
    // Extent of a box along an axis.
    let along = |axis: DVec3| 2.0 * half.dot(axis.abs());
    let pixels = [along(looking.right()), along(looking.up())].map(|extent| (extent / units).ceil().max(1.0));
    if pixels.iter().any(|&p| p > 65_536.0) {
        let [w, h] = pixels;
        let why =
            format!("at {units} units a pixel the data takes {w}x{h} pixels: give --size, or more units");
        return Err(UsageError(why).into());
    }
    Ok(pixels.map(|p| p as u32))
}
