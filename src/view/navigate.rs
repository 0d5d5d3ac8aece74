//! Moves of the camera. Pure, in world coordinates, without roll.

use crate::coords::{Bounds, Hull};
use crate::render::camera::{Camera, CameraError, Projection};
use glam::DVec3;

/// Elevations that turning comes to at most, degrees: straight down has no azimuth.
const STEEPEST: f64 = 89.9;

/// Closest to what is zoomed to, in the data's lengths.
const NEAREST: f64 = 1e-6;
/// Farthest from the data, in its lengths.
const FARTHEST: f64 = 50.0;
/// Shares of the data's length that a pixel of a parallel view may be wide.
const PIXELS: [f64; 2] = [1e-9, 0.05];
/// Share of the image that framed data fill in a parallel view.
const FILL: f64 = 0.96;

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
            Standard::North => [0.0, 0.0],
            Standard::East => [90.0, 0.0],
            Standard::South => [180.0, 0.0],
            Standard::West => [270.0, 0.0],
            Standard::Oblique => crate::render::camera::DEFAULT_ORBIT,
        }
    }

    /// Whether rays are parallel: of all but the oblique one.
    pub fn is_parallel(self) -> bool {
        self != Standard::Oblique
    }
}

/// Whether rays are parallel.
pub fn is_parallel(projection: Projection) -> bool {
    matches!(projection, Projection::Orthographic { .. })
}

/// A camera that shows all of `hull` from `angles`. A parallel one gets the scale that this takes.
pub fn framing(
    hull: &Hull,
    angles: [f64; 2],
    projection: Projection,
    size: [u32; 2],
) -> Result<Camera, CameraError> {
    let camera = Camera::frame_hull(hull, angles, projection, size)?;
    if !is_parallel(projection) {
        return Ok(camera);
    }
    let [width, height] = size.map(|side| f64::from(side) * FILL);
    let fit = (hull.extent(camera.right()) / width).max(hull.extent(camera.up()) / height);
    // A lone point is framed as a box of one unit.
    let units_per_pixel = if fit > 0.0 { fit } else { 1.0 / width.min(height) };
    Camera::frame_hull(hull, angles, Projection::Orthographic { units_per_pixel }, size)
}

/// A parallel camera that has all of `bounds` before it, as rays start at its eye; what it sees of them is the same.
pub fn before_all(camera: &Camera, bounds: &Bounds) -> Result<Camera, CameraError> {
    if !is_parallel(camera.projection()) {
        return Ok(*camera);
    }
    let depth = |corner: DVec3| (corner - camera.eye()).dot(camera.forward());
    let nearest = bounds.corners().map(depth).into_iter().fold(f64::INFINITY, f64::min);
    let room = 0.05 * bounds.size().length();
    if nearest >= 0.0 {
        return Ok(*camera);
    }
    let distance = (camera.target() - camera.eye()).length() + room - nearest;
    Camera::orbit(camera.target(), angles(camera), distance, camera.projection())
}

/// From perspective to parallel and back: what is `depth` before the eye in the middle of the image stays there, as large
/// as it is. `fov`: of perspectives, degrees.
pub fn toggled(camera: &Camera, depth: f64, fov: f64, [_, height]: [u32; 2]) -> Result<Camera, CameraError> {
    let place = camera.eye() + camera.forward() * depth;
    let span = |fov: f64| 2.0 * (fov.to_radians() * 0.5).tan() / f64::from(height);
    let (distance, projection) = match camera.projection() {
        Projection::Perspective { fov } => {
            (depth, Projection::Orthographic { units_per_pixel: span(fov) * depth })
        }
        Projection::Orthographic { units_per_pixel } => {
            (units_per_pixel / span(fov), Projection::Perspective { fov })
        }
    };
    Camera::orbit(place, angles(camera), distance, projection)
}

/// Turns about the target until north is up; what looks down nearly straight looks down straight.
pub fn north_up(camera: &Camera) -> Result<Camera, CameraError> {
    let [_, elevation] = camera.angles();
    let elevation = if elevation > STEEPEST - 1e-3 { 90.0 } else { elevation.clamp(-90.0, 90.0) };
    let distance = (camera.target() - camera.eye()).length();
    Camera::orbit(camera.target(), [0.0, elevation], distance, camera.projection())
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
        let [least, most] = PIXELS.map(|share| share * length_of(bounds));
        let to = (units_per_pixel * factor).clamp(least.min(units_per_pixel), most.max(units_per_pixel));
        let factor = to / units_per_pixel;
        let projection = Projection::Orthographic { units_per_pixel: units_per_pixel * factor };
        let by = (place - camera.eye()) * (1.0 - factor);
        let across = by - camera.forward() * by.dot(camera.forward());
        let distance = (camera.target() - camera.eye()).length();
        return Camera::orbit(camera.target() + across, angles(camera), distance, projection);
    }
    let away = (place - camera.eye()).length();
    let length = length_of(bounds);
    // What is out of the range already may still come back.
    let [least, most] = [(length * NEAREST).min(away), (length * FARTHEST).max(away)];
    let factor = (away * factor).clamp(least, most) / away.max(f64::MIN_POSITIVE);
    let eye = place + (camera.eye() - place) * factor;
    let distance = ((camera.target() - camera.eye()).length() * factor).max(length * NEAREST);
    Camera::orbit(eye + camera.forward() * distance, angles(camera), distance, camera.projection())
}

fn length_of(bounds: &Bounds) -> f64 {
    match (bounds.max - bounds.min).length() {
        0.0 => 1.0,
        length => length,
    }
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

    /// Shares of the image's height between two places as they are seen.
    fn seen_size(camera: &Camera, place: DVec3) -> f64 {
        let step = units_per_pixel(camera, place, SIZE);
        1.0 / step
    }

    #[test]
    fn the_other_projection_keeps_the_middle_and_its_size() {
        for angles in [[0.0, 90.0], [35.0, 20.0], [120.0, -5.0]] {
            let before = camera(angles, Projection::Perspective { fov: 40.0 });
            for depth in [50.0, 800.0, 4000.0] {
                let place = before.eye() + before.forward() * depth;
                let parallel = toggled(&before, depth, 40.0, SIZE).unwrap();
                let parallel = before_all(&parallel, &DATA).unwrap();
                assert!(is_parallel(parallel.projection()));
                let ahead = |corner: DVec3| (corner - parallel.eye()).dot(parallel.forward());
                assert!(DATA.corners().into_iter().all(|corner| ahead(corner) >= 0.0));
                let again = toggled(&parallel, ahead(place), 40.0, SIZE).unwrap();
                for camera in [&parallel, &again] {
                    assert!(apart(seen_at(camera, place, SIZE).unwrap(), [0.5, 0.5]) < 1e-3);
                    assert!((seen_size(camera, place) / seen_size(&before, place) - 1.0).abs() < 1e-6);
                    assert!((camera.forward() - before.forward()).length() < 1e-9);
                }
                assert!((again.eye() - before.eye()).length() < 1e-3);
            }
        }
    }

    #[test]
    fn north_comes_up_and_nothing_else_changes() {
        for projection in [Projection::default(), Projection::Orthographic { units_per_pixel: 2.0 }] {
            let before = camera([217.0, 30.0], projection);
            let after = north_up(&before).unwrap();
            let [azimuth, elevation] = after.angles();
            assert!(azimuth == 0.0 && (elevation - 30.0).abs() < 1e-9);
            assert!((after.target() - before.target()).length() < 1e-6);
            assert_eq!(after.projection(), projection);
            // A map that was turned by a drag is one again.
            let turned = orbit(&camera([0.0, 90.0], projection), DATA.center(), [25.0, 0.0]).unwrap();
            assert_eq!(north_up(&turned).unwrap().angles(), [0.0, 90.0]);
        }
    }

    #[test]
    fn a_parallel_view_has_its_eye_before_the_data_however_it_is_turned() {
        let mut at = camera([0.0, 20.0], Projection::Orthographic { units_per_pixel: 0.1 });
        let place = DATA.max;
        for _ in 0..40 {
            let turned = orbit(&at, place, [31.0, 3.0]).unwrap();
            let moved = before_all(&turned, &DATA).unwrap();
            for corner in DATA.corners() {
                assert!((corner - moved.eye()).dot(moved.forward()) >= 0.0);
                let [before, after] = [&turned, &moved].map(|camera| seen_at(camera, corner, SIZE).unwrap());
                assert!(apart(before, after) < 0.05, "what is seen is the same");
            }
            at = moved;
        }
    }

    #[test]
    fn standard_views_show_all_of_the_data() {
        for standard in Standard::ALL {
            let projection = match standard.is_parallel() {
                true => Projection::Orthographic { units_per_pixel: 1.0 },
                false => Projection::default(),
            };
            let camera = framing(&Hull::from(&DATA), standard.angles(), projection, SIZE).unwrap();
            let mut widest = 0.0f64;
            for corner in DATA.corners() {
                let [x, y] = seen_at(&camera, corner, SIZE).unwrap();
                widest = widest.max(2.0 * (x - 0.5).abs()).max(2.0 * (y - 0.5).abs());
            }
            assert!(widest > 0.9 && widest <= 1.0, "{standard:?}: the data fill {widest}");
            for corner in [DATA.min, DATA.max, DATA.min.with_x(DATA.max.x), DATA.max.with_y(DATA.min.y)] {
                let [x, y] = seen_at(&camera, corner, SIZE).unwrap();
                assert!((0.0..=1.0).contains(&x) && (0.0..=1.0).contains(&y), "{standard:?} {x} {y}");
            }
            level(&camera);
        }
    }
}
