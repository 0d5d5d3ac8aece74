//! The camera, in world coordinates, and the rays of its pixels. All f64.

pub use super::camera_error::CameraError;
use super::camera_error::{finite, finite3, positive};
pub use super::ray_basis::RayBasis;
use crate::coords::{Bounds, Hull, on_lattice};
use glam::DVec3;

/// Share of the image's half-width and half-height that framed data fill.
const FRAME_FILL: f64 = 0.96;

/// Least depth of framed data, in radii of their box.
const NEAREST: f64 = 0.05;

/// Halvings until the middle is found to the last bit.
const HALVINGS: u32 = 60;

/// Eyes, as rays start there, lie on a lattice of so many steps in one of the heights' lattice: the same image then
/// has the same rays bit by bit wherever in its CRS the data lies.
const STEPS_PER_HEIGHT_STEP: f64 = 1024.0;

/// Vertical field of view when none is asked for, degrees.
pub const DEFAULT_FOV: f64 = 45.0;
/// Azimuth and elevation when none are asked for, degrees: looking north, 35° down.
pub const DEFAULT_ORBIT: [f64; 2] = [0.0, 35.0];

/// How rays spread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// From the eye.
    Perspective {
        /// Vertical field of view, degrees, in (0, 180).
        fov: f64,
    },
    /// Parallel, from the plane through the eye across the direction of view.
    Orthographic {
        /// CRS units a pixel, both ways.
        units_per_pixel: f64,
    },
}

impl Default for Projection {
    fn default() -> Projection {
        Projection::Perspective { fov: DEFAULT_FOV }
    }
}

impl Projection {
    pub(super) fn check(self) -> Result<Projection, CameraError> {
        match self {
            Projection::Perspective { fov } if !(fov > 0.0 && fov < 180.0) => Err(CameraError::Fov(fov)),
            Projection::Orthographic { units_per_pixel } => {
                positive("units per pixel", units_per_pixel).map(|_| self)
            }
            Projection::Perspective { .. } => Ok(self),
        }
    }
}

/// A direction of view without roll.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Axes {
    forward: DVec3,
    right: DVec3,
    up: DVec3,
}

impl Axes {
    /// Azimuth clockwise from north, positive elevation down; degrees. At ±90° north counts as azimuth.
    fn from_angles([azimuth, elevation]: [f64; 2]) -> Result<Axes, CameraError> {
        finite("azimuth", azimuth)?;
        if !(-90.0..=90.0).contains(&elevation) {
            return Err(CameraError::Elevation(elevation));
        }
        let (sin_el, cos_el) = sin_cos_degrees(elevation);
        let (sin_az, cos_az) = if cos_el == 0.0 { (0.0, 1.0) } else { sin_cos_degrees(azimuth) };
        let forward = DVec3::new(sin_az * cos_el, cos_az * cos_el, -sin_el);
        Ok(Axes::of(forward, DVec3::new(cos_az, -sin_az, 0.0)))
    }

    fn from_direction(forward: DVec3) -> Axes {
        let level = forward.x.hypot(forward.y);
        let right = if level > 0.0 { DVec3::new(forward.y, -forward.x, 0.0) / level } else { DVec3::X };
        Axes::of(forward, right)
    }

    fn of(forward: DVec3, right: DVec3) -> Axes {
        Axes { forward, right, up: right.cross(forward) }
    }
}

/// Sine and cosine, exact at multiples of 90°, so that a view along an axis is along the axis.
fn sin_cos_degrees(angle: f64) -> (f64, f64) {
    let turn = angle.rem_euclid(360.0);
    match turn {
        0.0 | 360.0 => (0.0, 1.0),
        90.0 => (1.0, 0.0),
        180.0 => (0.0, -1.0),
        270.0 => (-1.0, 0.0),
        _ => turn.to_radians().sin_cos(),
    }
}

/// Where images are taken from: world coordinates (CRS units; heights as shown, i.e. after vertical
/// exaggeration), no roll, z up; straight down has north on top.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// A place that the data or the user gives: the eye itself, what is turned about, or the middle of what is framed.
    from: DVec3,
    /// From there to the eye. Apart, since it is the same wherever in its CRS the data lies.
    offset: DVec3,
    target: DVec3,
    axes: Axes,
    projection: Projection,
}

impl Camera {
    /// Looks from `eye` to `target`.
    pub fn look_at(eye: DVec3, target: DVec3, projection: Projection) -> Result<Camera, CameraError> {
        finite3(["eye E", "eye N", "eye U"], eye)?;
        finite3(["target E", "target N", "target U"], target)?;
        let distance = finite("distance from eye to target", (target - eye).length())?;
        if distance == 0.0 {
            return Err(CameraError::EyeIsTarget(eye));
        }
        let axes = Axes::from_direction((target - eye) / distance);
        Ok(Camera { from: eye, offset: DVec3::ZERO, target, axes, projection: projection.check()? })
    }

    /// Looks at `target` from `distance` (CRS units) away. `angles`: azimuth, the direction the camera
    /// looks to, clockwise from north; elevation, positive looks down, -90 to 90; both in degrees.
    pub fn orbit(
        target: DVec3,
        angles: [f64; 2],
        distance: f64,
        projection: Projection,
    ) -> Result<Camera, CameraError> {
        finite3(["target E", "target N", "target U"], target)?;
        let axes = Axes::from_angles(angles)?;
        let offset = -(axes.forward * positive("distance", distance)?);
        let eye = finite3(["eye E", "eye N", "eye U"], target + offset)?;
        if eye == target {
            return Err(CameraError::EyeIsTarget(eye));
        }
        Ok(Camera { from: target, offset, target, axes, projection: projection.check()? })
    }

    /// Looks from `eye` in the direction of `angles` (as in [`Camera::orbit`]); the target is one unit ahead.
    pub fn looking(eye: DVec3, angles: [f64; 2], projection: Projection) -> Result<Camera, CameraError> {
        finite3(["eye E", "eye N", "eye U"], eye)?;
        let (axes, offset) = (Axes::from_angles(angles)?, DVec3::ZERO);
        Ok(Camera { from: eye, offset, target: eye + axes.forward, axes, projection: projection.check()? })
    }

    /// [`Camera::frame_hull`] of a box.
    pub fn frame(
        bounds: &Bounds,
        angles: [f64; 2],
        projection: Projection,
        size: [u32; 2],
    ) -> Result<Camera, CameraError> {
        finite3(["bounds: west", "bounds: south", "bounds: bottom"], bounds.min)?;
        finite3(["bounds: east", "bounds: north", "bounds: top"], bounds.max)?;
        // A lone point is framed as a box of one unit.
        let is_point = bounds.min == bounds.max;
        Camera::frame_hull(
            &Hull::from(&bounds.at_least(if is_point { 1.0 } else { 0.0 })),
            angles,
            projection,
            size,
        )
    }

    /// Looks in the direction of `angles` (as in [`Camera::orbit`]) from where all of `hull`, which is more than a point,
    /// just fits into an image of `size` pixels, with a small margin, and in its middle. An orthographic projection keeps its
    /// scale and looks at the middle from outside.
    pub fn frame_hull(
        hull: &Hull,
        angles: [f64; 2],
        projection: Projection,
        size: [u32; 2],
    ) -> Result<Camera, CameraError> {
        let [width, height] = checked_size(size)?;
        let axes = Axes::from_angles(angles)?;
        let bounds = hull.bounds();
        let center = bounds.center();
        // Right, up and forward of the middle: small numbers, whatever the northing.
        let local: Vec<DVec3> = hull
            .points()
            .iter()
            .map(|p| {
                let d = p - center;
                DVec3::new(d.dot(axes.right), d.dot(axes.up), d.dot(axes.forward))
            })
            .collect();
        let radius = local.iter().map(|p| p.length()).fold(0.0, f64::max);
        let (eye, depth) = match projection.check()? {
            Projection::Orthographic { .. } => {
                let [x, y] = [0, 1].map(|axis| {
                    let (low, high) = ends(local.iter().map(|p| p[axis]));
                    0.5 * (low + high)
                });
                (DVec3::new(x, y, -2.0 * radius), 2.0 * radius)
            }
            Projection::Perspective { fov } => {
                let tan_y = (fov.to_radians() * 0.5).tan() * FRAME_FILL;
                let across: Vec<_> = local.iter().map(|p| [p.x, p.z]).collect();
                let upward: Vec<_> = local.iter().map(|p| [p.y, p.z]).collect();
                // A wide angle would put the eye onto an edge of a flat box.
                let (nearest, _) = ends(local.iter().map(|p| p.z));
                let depths = [fit(&across, tan_y * width / height), fit(&upward, tan_y)];
                let z = depths.into_iter().fold(nearest - NEAREST * radius, f64::min);
                (DVec3::new(centred(&across, z), centred(&upward, z), z), -z)
            }
        };
        let offset = axes.right * eye.x + axes.up * eye.y + axes.forward * eye.z;
        let eye = finite3(["eye E", "eye N", "eye U"], center + offset)?;
        Ok(Camera { from: center, offset, target: eye + axes.forward * depth, axes, projection })
    }

    /// Where rays start.
    pub fn eye(&self) -> DVec3 {
        self.from + self.offset
    }

    /// What is turned about: a point straight ahead.
    pub fn target(&self) -> DVec3 {
        self.target
    }

    /// Direction of view, length 1.
    pub fn forward(&self) -> DVec3 {
        self.axes.forward
    }

    /// To the right in the image, length 1, level.
    pub fn right(&self) -> DVec3 {
        self.axes.right
    }

    /// To the top of the image, length 1.
    pub fn up(&self) -> DVec3 {
        self.axes.up
    }

    /// How rays spread.
    pub fn projection(&self) -> Projection {
        self.projection
    }

    /// Azimuth (0 to 360, clockwise from north) and elevation (positive down), degrees, never -0.
    pub fn angles(&self) -> [f64; 2] {
        let (f, r) = (self.axes.forward, self.axes.right);
        let azimuth = (-r.y).atan2(r.x).to_degrees().rem_euclid(360.0);
        [azimuth, (0.0 - f.z).atan2(f.x.hypot(f.y)).to_degrees()]
    }

    /// The rays of an image of `width` × `height` pixels as they are drawn, over heights on a lattice of `height_step`:
    /// those of [`Camera::basis`], whose eye is moved to the nearest 1/1024 of that. The direction of view is the
    /// camera's, whatever the eye is rounded to.
    pub fn drawn_basis(&self, size: [u32; 2], height_step: f64) -> Result<RayBasis, CameraError> {
        let step = height_step / STEPS_PER_HEIGHT_STEP;
        let eye = on_lattice(self.from, step) + on_lattice(self.offset, step);
        Ok(RayBasis { eye: finite3(["eye E", "eye N", "eye U"], eye)?, ..self.basis(size)? })
    }

    /// The rays of an image of `width` × `height` pixels.
    pub fn basis(&self, size: [u32; 2]) -> Result<RayBasis, CameraError> {
        let [width, height] = checked_size(size)?;
        let Axes { forward, right, up } = self.axes;
        let still = RayBasis {
            eye: self.eye(),
            middle: [0.5 * width - 0.5, 0.5 * height - 0.5],
            o0: DVec3::ZERO,
            ox: DVec3::ZERO,
            oy: DVec3::ZERO,
            d0: forward,
            dx: DVec3::ZERO,
            dy: DVec3::ZERO,
            advanced: 0.0,
            z_scale: 1.0,
        };
        Ok(match self.projection {
            Projection::Perspective { fov } => {
                let step = 2.0 * (fov.to_radians() * 0.5).tan() / height;
                RayBasis { dx: right * step, dy: up * -step, ..still }
            }
            Projection::Orthographic { units_per_pixel: step } => {
                RayBasis { ox: right * step, oy: up * -step, ..still }
            }
        })
    }
}

fn checked_size([width, height]: [u32; 2]) -> Result<[f64; 2], CameraError> {
    if width == 0 || height == 0 {
        Err(CameraError::Size(width, height))
    } else {
        Ok([width.into(), height.into()])
    }
}

/// Lowest and highest.
fn ends(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
}

/// Farthest-forward depth of an eye that sees all `points` ([across, depth]) within the slope `tan` to either side.
fn fit(points: &[[f64; 2]], tan: f64) -> f64 {
    // |x - eye_x| ≤ tan (z - eye_z) for all: two bounds on eye_x that meet at the largest eye_z.
    let (_, low) = ends(points.iter().map(|[x, z]| x - tan * z));
    let (high, _) = ends(points.iter().map(|[x, z]| x + tan * z));
    (high - low) / (2.0 * tan)
}

/// Position across of an eye at depth `eye_z` that has as much of all `points`, which lie before it, to its left as to its
/// right.
fn centred(points: &[[f64; 2]], eye_z: f64) -> f64 {
    let (mut low, mut high) = ends(points.iter().map(|[x, _]| *x));
    // Falls from one end to the other.
    let lean = |eye_x: f64| {
        let (left, right) = ends(points.iter().map(|[x, z]| (x - eye_x) / (z - eye_z)));
        left + right
    };
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        match lean(middle).total_cmp(&0.0) {
            std::cmp::Ordering::Greater => low = middle,
            std::cmp::Ordering::Less => high = middle,
            std::cmp::Ordering::Equal => return middle,
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SIZE: [u32; 2] = [64, 36];

    fn close(a: DVec3, b: DVec3) -> bool {
        (a - b).length() <= 1e-12 * (1.0 + a.length())
    }

    /// Pixel coordinates (whole = centre) at which `p` is seen, and its depth.
    fn project(camera: &Camera, size: [u32; 2], p: DVec3) -> [f64; 3] {
        let basis = camera.basis(size).unwrap();
        let z = (p - camera.eye()).dot(camera.forward());
        let per_pixel = match camera.projection {
            Projection::Perspective { .. } => basis.dx.length() * z,
            Projection::Orthographic { units_per_pixel } => units_per_pixel,
        };
        let x = (p - camera.eye()).dot(camera.right()) / per_pixel + f64::from(size[0]) / 2.0 - 0.5;
        let y = -(p - camera.eye()).dot(camera.up()) / per_pixel + f64::from(size[1]) / 2.0 - 0.5;
        [x, y, z]
    }

    #[test]
    fn axes_are_compass_directions() {
        let at = |az, el| Camera::orbit(DVec3::ZERO, [az, el], 10.0, Projection::default()).unwrap();
        assert_eq!(at(0.0, 0.0).forward(), DVec3::Y);
        assert_eq!(at(0.0, 0.0).right(), DVec3::X);
        assert_eq!(at(0.0, 0.0).up(), DVec3::Z);
        assert_eq!(at(90.0, 0.0).forward(), DVec3::X);
        assert_eq!(at(270.0, 0.0).forward(), at(-90.0, 0.0).forward());
        assert_eq!(at(180.0, 0.0).eye(), DVec3::Y * 10.0);
        assert!(at(0.0, 35.0).eye().z > 0.0, "positive elevation looks down");
        for az in [0.0, 90.0, 217.0] {
            let down = at(az, 90.0);
            assert_eq!([down.forward(), down.right(), down.up()], [-DVec3::Z, DVec3::X, DVec3::Y]);
        }
        let down = Camera::look_at(DVec3::Z * 7.0, DVec3::ZERO, Projection::default()).unwrap();
        assert_eq!([down.right(), down.up()], [DVec3::X, DVec3::Y], "north is on top");
    }

    #[test]
    fn angles_come_back() {
        for (az, el) in [(0.0, 35.0), (123.0, -20.0), (359.0, 89.0), (45.0, 0.0), (0.0, 90.0)] {
            let orbit =
                Camera::orbit(DVec3::new(5e5, 6e6, 30.0), [az, el], 800.0, Projection::default()).unwrap();
            let looked = Camera::look_at(orbit.eye(), orbit.target(), Projection::default()).unwrap();
            for camera in [orbit, looked] {
                let [a, e] = camera.angles();
                // As far as eyes are told apart at such a northing.
                assert!((a - az).abs() < 1e-7 && (e - el).abs() < 1e-7, "{az},{el} became {a},{e}");
            }
            assert!((orbit.right() - looked.right()).length() < 1e-9);
        }
    }

    #[test]
    fn a_direction_is_that_of_the_places_given_whatever_the_eye_is_rounded_to() {
        let (target, step) = (DVec3::new(500_000.3, 6_000_000.7, 150.1), 4.0);
        let eye = target + DVec3::new(0.01, 0.02, 150.0);
        let camera = Camera::look_at(eye, target, Projection::default()).unwrap();
        assert_eq!(camera.forward(), (target - eye).normalize());
        let [plain, drawn] =
            [camera.basis(SIZE), camera.drawn_basis(SIZE, step * STEPS_PER_HEIGHT_STEP)].map(|b| b.unwrap());
        assert_eq!(plain.eye, eye);
        assert_eq!(drawn, RayBasis { eye: DVec3::new(500_000.0, 6_000_000.0, 300.0), ..plain });
        // What is framed or turned about has the same rays from wherever it lies.
        let rays = |by: DVec3| {
            let bounds =
                Bounds { min: DVec3::new(0.5, 3.25, -7.75) + by, max: DVec3::new(90.0, 61.5, 4.0) + by };
            let framed = Camera::frame(&bounds, [33.0, 27.0], Projection::default(), SIZE).unwrap();
            let around = Camera::orbit(bounds.min, [71.0, 3.0], 12.3, Projection::default()).unwrap();
            [framed, around].map(|camera| {
                let basis = camera.drawn_basis(SIZE, 1.0 / 1024.0).unwrap();
                RayBasis { eye: basis.eye - by, ..basis }
            })
        };
        assert_eq!(rays(DVec3::ZERO), rays(DVec3::new(500_000.0, 6_000_000.0, 3_000.0)));
    }

    #[test]
    fn pixels_are_where_they_should_be() {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::Y, Projection::Perspective { fov: 90.0 }).unwrap();
        let basis = camera.basis([4, 2]).unwrap();
        // Half-height 1 at depth 1: pixels are 1 wide, centres at ±0.5 and ±1.5.
        assert!(close(basis.direction(0.0, 0.0), DVec3::new(-1.5, 1.0, 0.5)));
        assert!(close(basis.direction(3.0, 1.0), DVec3::new(1.5, 1.0, -0.5)));
        assert!(close(basis.direction(-0.5, -0.5), DVec3::new(-2.0, 1.0, 1.0)));
        assert_eq!(basis.origin(3.0, 1.0), DVec3::ZERO);
        assert!((basis.length(0.0, 0.0) - 3.5f64.sqrt()).abs() < 1e-12);

        let map = Projection::Orthographic { units_per_pixel: 0.5 };
        let basis = Camera::orbit(DVec3::ZERO, [0.0, 90.0], 9.0, map).unwrap().basis([4, 2]).unwrap();
        assert!(close(basis.origin(0.0, 0.0), DVec3::new(-0.75, 0.25, 9.0)));
        assert!(close(basis.origin(3.0, 1.0), DVec3::new(0.75, -0.25, 9.0)));
        assert_eq!(basis.direction(3.0, 1.0), -DVec3::Z);
    }

    #[test]
    fn exaggeration_keeps_distances_as_seen() {
        let camera =
            Camera::look_at(DVec3::new(0.0, -10.0, 40.0), DVec3::ZERO, Projection::default()).unwrap();
        let shown = camera.basis(SIZE).unwrap();
        let truth = shown.exaggerated(2.0, 8.0).unwrap().advance(3.0);
        for (px, py) in [(0.0, 0.0), (63.0, 35.0), (20.5, 7.25)] {
            let t = 5.0;
            let p = truth.origin(px, py) + truth.direction(px, py) * t;
            let seen = DVec3 { z: 8.0 + (p.z - 8.0) * 2.0, ..p };
            assert!(close(seen, shown.origin(px, py) + shown.direction(px, py) * (3.0 + t)));
            let distance = truth.distance_eye_to_plane(px, py) + t * truth.length(px, py);
            assert!((distance - (seen - camera.eye()).length()).abs() < 1e-9);
        }
        assert!(shown.exaggerated(0.0, 0.0).is_err() && shown.exaggerated(1.0, f64::NAN).is_err());
    }

    #[test]
    fn nonsense_is_named() {
        let p = Projection::default();
        let message = |r: Result<Camera, CameraError>| r.unwrap_err().to_string();
        assert_eq!(
            message(Camera::look_at(DVec3::ONE, DVec3::ONE, p)),
            "eye and target are both at 1,1,1: the camera has no direction"
        );
        assert_eq!(message(Camera::look_at(DVec3::NAN, DVec3::ONE, p)), "eye E is NaN: it must be finite");
        assert!(Camera::look_at(DVec3::ZERO, DVec3::X * 1e300, p).is_err(), "length overflows");
        for fov in [0.0, 180.0, -3.0, f64::NAN, f64::INFINITY] {
            let r = Camera::look_at(DVec3::ZERO, DVec3::X, Projection::Perspective { fov });
            assert!(matches!(r, Err(CameraError::Fov(_))));
        }
        for units_per_pixel in [0.0, -1.0, f64::NAN] {
            assert!(
                Camera::look_at(DVec3::ZERO, DVec3::X, Projection::Orthographic { units_per_pixel }).is_err()
            );
        }
        for distance in [0.0, -1.0, f64::INFINITY, 1e-300] {
            assert!(Camera::orbit(DVec3::ONE, [0.0, 0.0], distance, p).is_err());
        }
        for angles in [[f64::NAN, 0.0], [0.0, f64::NAN], [0.0, 90.1], [0.0, -91.0]] {
            assert!(Camera::orbit(DVec3::ONE, angles, 1.0, p).is_err());
        }
        let camera = Camera::look_at(DVec3::ZERO, DVec3::X, p).unwrap();
        assert_eq!(camera.basis([0, 5]), Err(CameraError::Size(0, 5)));
        let endless = Bounds { min: DVec3::ZERO, max: DVec3::INFINITY };
        assert!(Camera::frame(&endless, DEFAULT_ORBIT, p, SIZE).is_err());
    }

    #[test]
    fn a_lone_point_is_framed() {
        let p = DVec3::new(500_000.0, 6_000_000.0, 3.0);
        let camera =
            Camera::frame(&Bounds { min: p, max: p }, DEFAULT_ORBIT, Projection::default(), SIZE).unwrap();
        let [x, y, depth] = project(&camera, SIZE, p);
        assert!((x - 31.5).abs() < 3.0 && (y - 17.5).abs() < 3.0 && (0.5..10.0).contains(&depth));
        assert!(camera.angles()[0].min(360.0 - camera.angles()[0]) < 1e-9);
    }

    proptest! {
        #[test]
        fn framing_is_tight(
            x in 1.0f64..5000.0, y in 1.0f64..5000.0, z in 0.0f64..500.0,
            az in -360.0f64..360.0, el in -90.0f64..=90.0, fov in 5.0f64..120.0,
            width in 1u32..2000, height in 1u32..2000,
        ) {
            let min = DVec3::new(500_000.0, 6_000_000.0, 100.0);
            let bounds = Bounds { min, max: min + DVec3::new(x, y, z) };
            let size = [width, height];
            let camera = Camera::frame(&bounds, [az, el], Projection::Perspective { fov }, size).unwrap();
            // Widest use of the half-image by a corner: 1 = at the border.
            let mut fill: f64 = 0.0;
            let mut nearest = f64::INFINITY;
            for p in bounds.corners() {
                let [px, py, depth] = project(&camera, size, p);
                nearest = nearest.min(depth);
                fill = fill.max(((px + 0.5) * 2.0 / f64::from(width) - 1.0).abs());
                fill = fill.max(((py + 0.5) * 2.0 / f64::from(height) - 1.0).abs());
            }
            let least = NEAREST * 0.5 * (bounds.max - bounds.min).length();
            prop_assert!(nearest > least * 0.999);
            prop_assert!(fill < FRAME_FILL + 1e-5, "fills {fill}");
            prop_assert!(fill > FRAME_FILL - 1e-5 || nearest < least * 1.001, "fills {fill}");
        }

        #[test]
        fn advancing_moves_along_the_same_ray(
            depth in -100.0f64..60_000.0, px in -0.5f64..63.5, py in -0.5f64..35.5, parallel: bool,
        ) {
            let projection = if parallel { Projection::Orthographic { units_per_pixel: 2.0 } }
                else { Projection::Perspective { fov: 30.0 } };
            let camera = Camera::look_at(DVec3::new(5e5, 6e6, 900.0), DVec3::new(5.1e5, 6.02e6, 0.0), projection).unwrap();
            let near = camera.basis(SIZE).unwrap();
            let far = near.advance(depth * 0.25).advance(depth * 0.75);
            let moved = far.origin(px, py) - near.origin(px, py);
            prop_assert!((moved.dot(camera.forward()) - depth).abs() < 1e-6);
            prop_assert!(moved.cross(near.direction(px, py)).length() < 1e-6);
            prop_assert!((far.distance_eye_to_plane(px, py).abs() - moved.length()).abs() < 1e-6);
            prop_assert_eq!(far.direction(px, py), near.direction(px, py));
        }
    }
}
