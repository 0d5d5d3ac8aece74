//! The camera and the image size that the arguments ask for.

use super::args::Args;
use crate::command::UsageError;
use crate::command::values::Orbit;
use crate::coords::Hull;
use crate::load::About;
use crate::render::camera::{Camera, DEFAULT_ORBIT, Projection};
use crate::render::frame::Shade;
use glam::DVec3;

/// What is framed of the data as they are shown; `cell`: side of a cell.
pub(super) fn framed(args: &Args, about: &About, cell: f64) -> Hull {
    // A map is of the points' extent; in a view, the cells of a few points reach far beyond it.
    let hull = match args.ortho {
        Some(_) if about.hull.bounds().size().max_element() < cell => {
            Hull::from(&about.hull.bounds().at_least(cell))
        }
        Some(_) => about.hull.clone(),
        None => about.hull.of_cells(cell),
    };
    let solid = if args.shade == Shade::Lit { hull.on_slab(&about.slab(cell)) } else { hull };
    solid.exaggerated(args.z_scale, about.bounds.min.z)
}

/// Camera and image size that the arguments ask for, over `hull` as it is shown.
pub(super) fn camera(
    args: &Args,
    hull: &Hull,
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
        (None, Some(units)) => ortho_size(hull, orbit.angles, units)?,
        (None, None) => [1280, 720],
    };
    let center = hull.bounds().center();
    let camera = match (args.eye, args.target) {
        (Some(eye), Some(target)) => Camera::look_at(place(eye), place(target), projection),
        (_, target) => match orbit.distance {
            Some(distance) => {
                let target = target.map_or(center, place);
                Camera::orbit(target, orbit.angles, distance, projection)
            }
            None => match target {
                Some(target) => {
                    let framed = Camera::frame_hull(hull, orbit.angles, projection, size).map_err(usage)?;
                    let distance = (framed.eye() - center).length();
                    Camera::orbit(place(target), orbit.angles, distance, projection)
                }
                None => Camera::frame_hull(hull, orbit.angles, projection, size),
            },
        },
    };
    Ok((camera.map_err(usage)?, size))
}

/// Pixels that show all of `hull` at `units` a pixel.
fn ortho_size(hull: &Hull, angles: [f64; 2], units: f64) -> anyhow::Result<[u32; 2]> {
    let looking = Camera::looking(DVec3::ZERO, angles, Projection::Orthographic { units_per_pixel: units })
        .map_err(|e| UsageError(e.to_string()))?;
    let along = |axis: DVec3| hull.extent(axis);
    let pixels = [along(looking.right()), along(looking.up())].map(|extent| (extent / units).ceil().max(1.0));
    if pixels.iter().any(|&p| p > 65_536.0) {
        let [w, h] = pixels;
        let why =
            format!("at {units} units a pixel the data takes {w}x{h} pixels: give --size, or more units");
        return Err(UsageError(why).into());
    }
    Ok(pixels.map(|p| p as u32))
}
