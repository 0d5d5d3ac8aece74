//! A camera as residency needs it: half spaces and the size of a pixel.

use super::camera::{Camera, CameraError, Projection};
use crate::resident::cut::Sight;

/// Pixels around the image that are loaded, too: shading looks beyond its edge.
const MARGIN: f64 = 8.0;

/// What `camera` sees in an image of `size`; see [`Sight`] for the rest.
pub fn sight(
    camera: &Camera,
    size: [u32; 2],
    [z_scale, pivot]: [f64; 2],
    floor: f64,
    detail: f64,
) -> Result<Sight, CameraError> {
    let basis = camera.basis(size)?;
    let [w, h] = size.map(f64::from);
    let (left, top, right, bottom) = (-0.5 - MARGIN, -0.5 - MARGIN, w - 0.5 + MARGIN, h - 0.5 + MARGIN);
    let corners = [(left, top), (right, top), (right, bottom), (left, bottom)];
    let [middle_x, middle_y] = basis.middle;
    let forward = camera.forward();
    let mut planes = vec![(forward, forward.dot(camera.eye()))];
    for (at, &(x, y)) in corners.iter().enumerate() {
        let (next_x, next_y) = corners[(at + 1) % 4];
        let (origin, direction) = (basis.origin(x, y), basis.direction(x, y));
        let edge = basis.origin(next_x, next_y) + basis.direction(next_x, next_y) - origin - direction;
        let normal = direction.cross(edge).normalize();
        let inside = basis.origin(middle_x, middle_y) + basis.direction(middle_x, middle_y);
        let normal = if normal.dot(inside - origin) < 0.0 { -normal } else { normal };
        planes.push((normal, normal.dot(origin)));
    }
    let (eye, pixel) = match camera.projection() {
        Projection::Perspective { fov } => (Some(camera.eye()), 2.0 * (fov.to_radians() * 0.5).tan() / h),
        Projection::Orthographic { units_per_pixel } => (None, units_per_pixel),
    };
    Ok(Sight { planes, eye, pixel, z_scale, pivot, floor, detail })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn sees(sight: &Sight, at: DVec3) -> bool {
        sight.planes.iter().all(|(normal, least)| normal.dot(at) >= *least)
    }

    #[test]
    fn what_rays_reach_is_seen_and_little_else() {
        let eye = DVec3::new(500_000.0, 6_000_000.0, 300.0);
        for projection in
            [Projection::Perspective { fov: 45.0 }, Projection::Orthographic { units_per_pixel: 0.5 }]
        {
            let target = eye + DVec3::new(300.0, 400.0, -200.0);
            let camera = Camera::look_at(eye, target, projection).unwrap();
            let size = [320, 180];
            let sight = sight(&camera, size, [1.0, 0.0], 0.0, 1.0).unwrap();
            let basis = camera.basis(size).unwrap();
            for (x, y, seen) in [
                (0.0, 0.0, true),
                (319.0, 179.0, true),
                (160.0, 90.0, true),
                (-30.0, 90.0, false),
                (350.0, 90.0, false),
                (160.0, -30.0, false),
                (160.0, 210.0, false),
            ] {
                for t in [1.0, 100.0, 5000.0] {
                    let at = basis.origin(x, y) + basis.direction(x, y) * t;
                    assert_eq!(sees(&sight, at), seen, "{projection:?} {x} {y} {t}");
                    assert!(!sees(&sight, basis.origin(x, y) - basis.direction(x, y) * t));
                }
            }
        }
    }
}
