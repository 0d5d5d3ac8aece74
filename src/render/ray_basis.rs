//! The rays of an image as numbers: affine in the pixel, from an eye, from a plane before the data, and through data that
//! are shown exaggerated.

use super::camera_error::{CameraError, finite, positive};
use crate::coords::Bounds;
use glam::DVec3;

/// The rays of an image, affine in the pixel: what host, shaders and reference share.
///
/// Pixel (px, py) counts from the top left; whole numbers are pixel centres, so a sub-pixel sample lies
/// within ±½. `direction` is not normalised: without exaggeration its share along the view is 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayBasis {
    /// Where the camera is. Origins count from here: small numbers, the same ones wherever the data lies.
    pub eye: DVec3,
    /// The middle of the image, pixels. Rays count from it, so that what is symmetrical in the image is
    /// so to the last bit.
    pub middle: [f64; 2],
    /// Origin of the ray through the middle, from the eye.
    pub o0: DVec3,
    /// Change of origin from a pixel to the one on its right (zero from an eye).
    pub ox: DVec3,
    /// Change of origin from a pixel to the one below.
    pub oy: DVec3,
    /// Direction of the ray through the middle.
    pub d0: DVec3,
    /// Change of direction from a pixel to the one on its right (zero for parallel rays).
    pub dx: DVec3,
    /// Change of direction from a pixel to the one below.
    pub dy: DVec3,
    /// How many times `direction` the origins lie ahead of the eye.
    pub(super) advanced: f64,
    /// Vertical exaggeration that was undone.
    pub(super) z_scale: f64,
}

impl RayBasis {
    /// Start of the pixel's ray, world coordinates.
    pub fn origin(&self, px: f64, py: f64) -> DVec3 {
        self.eye + self.origin_from_eye(px, py)
    }

    /// Start of the pixel's ray, counted from the eye.
    pub fn origin_from_eye(&self, px: f64, py: f64) -> DVec3 {
        self.o0 + self.ox * (px - self.middle[0]) + self.oy * (py - self.middle[1])
    }

    /// Direction of the pixel's ray.
    pub fn direction(&self, px: f64, py: f64) -> DVec3 {
        self.d0 + self.dx * (px - self.middle[0]) + self.dy * (py - self.middle[1])
    }

    /// The same rays with their origins moved on to the plane `depth` CRS units ahead along the direction
    /// of view, just before the data: from there f32 is enough.
    pub fn advance(&self, depth: f64) -> RayBasis {
        RayBasis {
            o0: self.o0 + self.d0 * depth,
            ox: self.ox + self.dx * depth,
            oy: self.oy + self.dy * depth,
            advanced: self.advanced + depth,
            ..*self
        }
    }

    /// How many times its direction every ray's origin lies ahead of where it starts.
    pub fn advanced(&self) -> f64 {
        self.advanced
    }

    /// Length of the pixel's `direction` as seen, CRS units: hits at origin + t · direction are
    /// `t · length + distance_eye_to_plane` away.
    pub fn length(&self, px: f64, py: f64) -> f64 {
        let d = self.direction(px, py);
        DVec3::new(d.x, d.y, d.z * self.z_scale).length()
    }

    /// Length of the pixel's ray from the eye to the plane it was moved to, as seen, CRS units.
    pub fn distance_eye_to_plane(&self, px: f64, py: f64) -> f64 {
        self.advanced * self.length(px, py)
    }

    /// The rays as they run through unexaggerated data: what is shown at `pivot_u + (U - pivot_u) · z_scale`
    /// is U. Distances stay those of the shown space, in which camera and eye are given; heights of hits
    /// are true ones.
    ///
    /// Errors: `z_scale` not finite or not above 0, `pivot_u` not finite.
    pub fn exaggerated(&self, z_scale: f64, pivot_u: f64) -> Result<RayBasis, CameraError> {
        positive("z scale", z_scale)?;
        finite("pivot of the z scale", pivot_u)?;
        let flat = |v: DVec3| DVec3 { z: v.z / z_scale, ..v };
        Ok(RayBasis {
            eye: DVec3 { z: pivot_u + (self.eye.z - pivot_u) / z_scale, ..self.eye },
            middle: self.middle,
            o0: flat(self.o0),
            ox: flat(self.ox),
            oy: flat(self.oy),
            d0: flat(self.d0),
            dx: flat(self.dx),
            dy: flat(self.dy),
            advanced: self.advanced,
            z_scale: self.z_scale * z_scale,
        })
    }

    /// Smallest depth along the view (the unit of [`RayBasis::advance`]) of a column that stands in `bounds`
    /// and has no end below, as far down as a ray of the image can reach; at least 0. `forward` is the
    /// camera's. For shown space, i.e. before [`RayBasis::exaggerated`].
    pub fn depth_of(&self, bounds: &Bounds, forward: DVec3, [width, height]: [u32; 2]) -> f64 {
        let depths = |b: &Bounds| b.corners().map(|p| (p - self.eye).dot(forward));
        let farthest = depths(bounds).into_iter().fold(0.0, f64::max);
        let [w, h] = [width, height].map(|n| f64::from(n) - 0.5);
        let lowest = [(-0.5, -0.5), (w, -0.5), (-0.5, h), (w, h)]
            .map(|(x, y)| {
                let near = self.origin(x, y).z;
                near.min(near + self.direction(x, y).z * farthest)
            })
            .into_iter()
            .fold(bounds.min.z, f64::min);
        let solid = Bounds { min: bounds.min.with_z(lowest), ..*bounds };
        depths(&solid).into_iter().fold(f64::INFINITY, f64::min).max(0.0)
    }
}
