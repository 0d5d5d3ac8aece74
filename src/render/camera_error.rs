//! What cannot be seen, and why; and the checks of numbers that cameras and their rays share.

use crate::text::tidy;
use glam::DVec3;

/// What cannot be seen, and why.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum CameraError {
    /// No direction to look in.
    #[error("eye and target are both at {}: the camera has no direction", triple(.0))]
    EyeIsTarget(DVec3),
    /// NaN or infinity, given or arisen.
    #[error("{what} is {value}: it must be finite")]
    NotFinite {
        /// What it is the value of.
        what: &'static str,
        /// The value.
        value: f64,
    },
    /// Too small or negative.
    #[error("{what} is {value}: it must be above 0")]
    NotPositive {
        /// What it is the value of.
        what: &'static str,
        /// The value.
        value: f64,
    },
    /// Vertical field of view.
    #[error("field of view is {0}°: it must lie between 0 and 180")]
    Fov(f64),
    /// Over the top.
    #[error("elevation is {0}°: it must lie between -90 (straight up) and 90 (straight down)")]
    Elevation(f64),
    /// Image without pixels.
    #[error("image size is {0}x{1}: neither may be 0")]
    Size(u32, u32),
    /// The image takes in more than rays can be counted over.
    #[error(
        "from so far away the picture is {} units wide where the data begins, more than 2^30 cells of {}: \
         take the camera nearer, a narrower field of view, or fewer units a pixel",
        tidy(*width),
        tidy(*cell)
    )]
    TooWide {
        /// Its longer side, CRS units.
        width: f64,
        /// Side of a cell, CRS units.
        cell: f64,
    },
}

fn triple(v: &DVec3) -> String {
    format!("{},{},{}", v.x, v.y, v.z)
}

pub(super) fn finite(what: &'static str, value: f64) -> Result<f64, CameraError> {
    if value.is_finite() { Ok(value) } else { Err(CameraError::NotFinite { what, value }) }
}

pub(super) fn positive(what: &'static str, value: f64) -> Result<f64, CameraError> {
    if finite(what, value)? > 0.0 { Ok(value) } else { Err(CameraError::NotPositive { what, value }) }
}

pub(super) fn finite3(names: [&'static str; 3], v: DVec3) -> Result<DVec3, CameraError> {
    names.into_iter().zip(v.to_array()).try_for_each(|(what, value)| finite(what, value).map(drop))?;
    Ok(v)
}
