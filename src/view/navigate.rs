//! Moves of the camera. Pure, in world coordinates, without roll.

use crate::coords::Bounds;
use crate::render::camera::{Camera, CameraError, Projection};
use glam::DVec3;

/// Elevations that turning comes to at most, degrees: straight down has no azimuth.
const STEEPEST: f64 = 89.9;

/// Closest to what is zoomed to, in the data's lengths.
const NEAREST: f64 = 1e-6;
/// Farthest from the data, in its lengths.
const FARTHEST: f64 = 50.0;

/// Views that a key calls up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standard {
    /// From above, north on top.
    Top,
    /// Looking north, 20° down.
    North,
    /// Looking east.
    East,
    /// Looking south.
    South,
    /// Looking west.
    West,
    /// As images are framed without a camera.
    Oblique,
}

impl Standard {
    /// In the order of their keys, 1 to 6.
    pub const ALL: [Standard; 6] =
        [Standard::Top, Standard::North, Standard::East, Standard::South, Standard::West, Standard::Oblique];

    /// Azimuth and elevation, degrees.
    pub fn angles(self) -> [f64; 2] {
        match self {
            Standard::Top => [0.0, 90.0],
            Standard::North => [0.0, 20.0],
            Standard::East => [90.0, 20.0],
            Standard::South => [180.0, 20.0],
            Standard::West => [270.0, 20.0],
            Standard::Oblique => crate::render::camera::DEFAULT_ORBIT,
        }
    }
}

/// Direction of the ray through `at` (shares of the image's width and height); its part along the view is 1 for
/// perspectives. Where it starts, too.
pub fn ray(camera: &Camera, at: [f64; 2], size: [u32; 2]) -> Result<(DVec3, DVec3), CameraError> {
    let basis = camera.basis(size)?;
    let [px, py] = pixel(at, size);
    Ok((basis.origin(px, py), basis.direction(px, py)))
}

fn pixel(at: [f64; 2], size: [u32; 2]) -> [f64; 2] {
    std::array::from_fn(|axis| at[axis] * f64::from(size[axis]) - 0.5)
}

/// Where `place` is seen, shares of the image's width and height; `None` behind the camera.
pub fn seen_at(camera: &Camera, place: DVec3, size: [u32; 2]) -> Option<[f64; 2]> {
    let away = place - camera.eye();
    let [x, y, depth] = [camera.right(), camera.up(), camera.forward()].map(|axis| away.dot(axis));
    let step = match camera.projection() {
        Projection::Perspective { .. } if depth <= 0.0 => return None,
        Projection::Perspective { fov } => 2.0 * (fov.to_radians() * 0.5).tan() / f64::from(size[1]) * depth,
        Projection::Orthographic { units_per_pixel } => units_per_pixel,
    };
    Some([0.5 + x / step / f64::from(size[0]), 0.5 - y / step / f64::from(size[1])])
}

/// The place under `at` as far away as the camera's target: where nothing better is known.
pub fn on_target_plane(camera: &Camera, at: [f64; 2], size: [u32; 2]) -> Result<DVec3, CameraError> {
    let (origin, direction) = ray(camera, at, size)?;
    let depth = (camera.target() - camera.eye()).dot(camera.forward());
    Ok(origin + direction * depth)
}

/// CRS units that a pixel is wide at `place`.
pub fn units_per_pixel(camera: &Camera, place: DVec3, size: [u32; 2]) -> f64 {
    match camera.projection() {
        Projection::Perspective { fov } => {
            let depth = (place - camera.eye()).dot(camera.forward()).max(0.0);
            2.0 * (fov.to_radians() * 0.5).tan() / f64::from(size[1]) * depth
        }
        Projection::Orthographic { units_per_pixel } => units_per_pixel,
    }
}

/// Turns about `pivot`, which stays where it is in the image. `turn`: degrees of azimuth and elevation.
pub fn orbit(camera: &Camera, pivot: DVec3, turn: [f64; 2]) -> Result<Camera, CameraError> {
    let [azimuth, elevation] = camera.angles();
    let angles = [azimuth + turn[0], (elevation + turn[1]).clamp(-STEEPEST, STEEPEST)];
    let turned = Camera::looking(camera.eye(), angles, camera.projection())?;
    // The pivot as the camera sees it stays the same.
    let away = pivot - camera.eye();
    let [x, y, z] = [camera.right(), camera.up(), camera.forward()].map(|axis| away.dot(axis));
    let eye = pivot - (turned.right() * x + turned.up() * y + turned.forward() * z);
    let distance = (camera.target() - camera.eye()).length();
    Camera::orbit(eye + turned.forward() * distance, angles, distance, camera.projection())
}

/// Turns the camera where it is.
pub fn look(camera: &Camera, turn: [f64; 2]) -> Result<Camera, CameraError> {
    orbit(camera, camera.eye(), turn)
}

/// Moves by `by` without turning.
pub fn shift(camera: &Camera, by: DVec3) -> Result<Camera, CameraError> {
    let distance = (camera.target() - camera.eye()).length();
    Camera::orbit(camera.target() + by, angles(camera), distance, camera.projection())
}

/// The camera's angles, straight down and up as such.
fn angles(camera: &Camera) -> [f64; 2] {
    let [azimuth, elevation] = camera.angles();
    [azimuth, elevation.clamp(-90.0, 90.0)]
}

/// Moves across the view by pixels, so that what is as far away as `held` follows the cursor.
pub fn pan(camera: &Camera, held: DVec3, pixels: [f64; 2], size: [u32; 2]) -> Result<Camera, CameraError> {
    let step = units_per_pixel(camera, held, size);
    shift(camera, camera.right() * (-pixels[0] * step) + camera.up() * (pixels[1] * step))
}

/// Brings the eye to `factor` times its distance from `place`, which stays where it is in the image.
pub fn zoom(camera: &Camera, place: DVec3, factor: f64, bounds: &Bounds) -> Result<Camera, CameraError> {
    if let Projection::Orthographic { units_per_pixel } = camera.projection() {
        let projection = Projection::Orthographic { units_per_pixel: units_per_pixel * factor };
        let by = (place - camera.eye()) * (1.0 - factor);
        let across = by - camera.forward() * by.dot(camera.forward());
        let distance = (camera.target() - camera.eye()).length();
        return Camera::orbit(camera.target() + across, angles(camera), distance, projection);
    }
    let away = (place - camera.eye()).length();
    let length = match (bounds.max - bounds.min).length() {
        0.0 => 1.0,
        length => length,
    };
    // What is out of the range already may still come back.
    let [least, most] = [(length * NEAREST).min(away), (length * FARTHEST).max(away)];
    let factor = (away * factor).clamp(least, most) / away.max(f64::MIN_POSITIVE);
    let eye = place + (camera.eye() - place) * factor;
    let distance = ((camera.target() - camera.eye()).length() * factor).max(length * NEAREST);
    Camera::orbit(eye + camera.forward() * distance, angles(camera), distance, camera.projection())
}

/// Brings `place` to the middle of the image, as far away as it is.
pub fn recentre(camera: &Camera, place: DVec3) -> Result<Camera, CameraError> {
    let before = (camera.target() - camera.eye()).length();
    let distance = (place - camera.eye()).dot(camera.forward()).max(before * NEAREST);
    Camera::orbit(place, angles(camera), distance, camera.projection())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SIZE: [u32; 2] = [1000, 700];
    const DATA: Bounds = Bounds {
        min: DVec3::new(512_000.0, 5_402_000.0, 150.0),
        max: DVec3::new(514_000.0, 5_404_000.0, 320.0),
    };

    fn camera(angles: [f64; 2], projection: Projection) -> Camera {
        Camera::frame(&DATA, angles, projection, SIZE).unwrap()
    }

    fn level(camera: &Camera) {
        assert_eq!(camera.right().z, 0.0, "no roll");
        assert!(camera.up().z >= 0.0);
    }

    fn apart(a: [f64; 2], b: [f64; 2]) -> f64 {
        ((a[0] - b[0]) * f64::from(SIZE[0])).hypot((a[1] - b[1]) * f64::from(SIZE[1]))
    }

    fn projections() -> impl Strategy<Value = Projection> {
        prop_oneof![
            (20.0..90.0).prop_map(|fov| Projection::Perspective { fov }),
            (0.1..10.0).prop_map(|units_per_pixel| Projection::Orthographic { units_per_pixel }),
        ]
    }

    proptest! {
        #[test]
        fn what_is_turned_about_and_zoomed_to_stays_under_the_cursor(
            angles in (0.0..360.0, -60.0..85.0),
            projection in projections(),
            at in (0.1..0.9, 0.1..0.9),
            depth in 0.3f64..2.0,
            turn in (-300.0..300.0, -20.0..20.0),
            factor in 0.3f64..3.0,
        ) {
            let before = camera(angles.into(), projection);
            let (origin, direction) = ray(&before, at.into(), SIZE).unwrap();
            let pivot = origin + direction * (depth * (before.target() - before.eye()).length());
            prop_assert!(apart(seen_at(&before, pivot, SIZE).unwrap(), at.into()) < 1e-3);
            let turned = orbit(&before, pivot, turn.into()).unwrap();
            prop_assert!(apart(seen_at(&turned, pivot, SIZE).unwrap(), at.into()) < 0.1);
            level(&turned);
            let nearer = zoom(&before, pivot, factor, &DATA).unwrap();
            prop_assert!(apart(seen_at(&nearer, pivot, SIZE).unwrap(), at.into()) < 0.1);
            level(&nearer);
            if let Projection::Perspective { .. } = projection {
                let ratio = (nearer.eye() - pivot).length() / (before.eye() - pivot).length();
                prop_assert!((ratio - factor).abs() < 1e-6, "{} instead of {}", ratio, factor);
            }
            let panned = pan(&before, pivot, [40.0, -25.0], SIZE).unwrap();
            let moved = [at.0 + 40.0 / 1000.0, at.1 - 25.0 / 700.0];
            prop_assert!(apart(seen_at(&panned, pivot, SIZE).unwrap(), moved) < 0.1);
            level(&panned);
        }
    }

    #[test]
    fn turning_stops_at_the_poles_and_keeps_its_azimuth() {
        let mut turned = camera([30.0, 35.0], Projection::default());
        for _ in 0..100 {
            turned = orbit(&turned, DATA.center(), [0.0, 5.0]).unwrap();
        }
        let [azimuth, elevation] = turned.angles();
        assert!(
            (azimuth - 30.0).abs() < 0.01 && (elevation - STEEPEST).abs() < 1e-3,
            "{azimuth} {elevation}"
        );
        for _ in 0..100 {
            turned = orbit(&turned, DATA.center(), [0.0, -5.0]).unwrap();
        }
        let [azimuth, elevation] = turned.angles();
        assert!(
            (azimuth - 30.0).abs() < 0.01 && (elevation + STEEPEST).abs() < 1e-3,
            "{azimuth} {elevation}"
        );
        // The view from above may be turned, too.
        level(&orbit(&camera([0.0, 90.0], Projection::default()), DATA.center(), [10.0, 0.0]).unwrap());
    }

    #[test]
    fn looking_around_and_moving_keep_what_they_must() {
        let before = camera([200.0, 10.0], Projection::default());
        let looked = look(&before, [33.0, -4.0]).unwrap();
        assert!((looked.eye() - before.eye()).length() < 1e-5);
        let [azimuth, elevation] = looked.angles();
        assert!((azimuth - 233.0).abs() < 1e-6 && (elevation - 6.0).abs() < 1e-6);
        let moved = shift(&before, DVec3::new(3.0, -2.0, 1.0)).unwrap();
        assert!((moved.eye() - before.eye() - DVec3::new(3.0, -2.0, 1.0)).length() < 1e-5);
        assert!((moved.forward() - before.forward()).length() < 1e-9);
    }

    #[test]
    fn what_is_recentred_is_in_the_middle_and_as_far_away() {
        let before = camera([120.0, 40.0], Projection::default());
        let place = on_target_plane(&before, [0.2, 0.7], SIZE).unwrap();
        let after = recentre(&before, place).unwrap();
        assert!(apart(seen_at(&after, place, SIZE).unwrap(), [0.5, 0.5]) < 1e-3);
        assert!(
            (units_per_pixel(&after, place, SIZE) / units_per_pixel(&before, place, SIZE) - 1.0).abs() < 1e-6
        );
    }

    #[test]
    fn zooming_has_ends_and_comes_back() {
        let mut at = camera([0.0, 35.0], Projection::default());
        let place = DATA.center();
        for _ in 0..500 {
            at = zoom(&at, place, 0.8, &DATA).unwrap();
        }
        assert!((at.eye() - place).length() < 1.0);
        for _ in 0..500 {
            at = zoom(&at, place, 1.25, &DATA).unwrap();
        }
        let far = (at.eye() - place).length();
        assert!(far > 1e4 && far < 1e6, "{far}");
    }

    #[test]
    fn standard_views_show_all_of_the_data() {
        for standard in Standard::ALL {
            let camera = camera(standard.angles(), Projection::default());
            for corner in [DATA.min, DATA.max, DATA.min.with_x(DATA.max.x), DATA.max.with_y(DATA.min.y)] {
                let [x, y] = seen_at(&camera, corner, SIZE).unwrap();
                assert!((0.0..=1.0).contains(&x) && (0.0..=1.0).contains(&y), "{standard:?} {x} {y}");
            }
            level(&camera);
        }
    }
}
